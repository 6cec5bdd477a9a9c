"""Decoded board records: in memory, or as NumPy files written piece by piece with constant memory.

A record folder holds ``counts.npy`` (sample, channel), ``tick.npy``, ``epoch.npy``, ``flags.npy``,
``clock.npy`` and
``report.json``. :func:`open_record` maps them, so that a month of samples need not fit into memory.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from glider_jax.board.clock import Clock, fit_clock, read_arrivals, stamps_from_arrival
from glider_jax.board.decoder import Batch, Decoder, decode_pieces, read_pieces
from glider_jax.board.frames import TICK
from glider_jax.errors import DataError, did_you_mean

_ARRAYS = ("counts", "tick", "epoch", "flags")


@dataclass(frozen=True)
class BoardRecord:
    """Samples of a board that sends all channels at every tick.

    ``tick``, ``epoch``, ``flags`` (sample,), ``counts`` (sample, channel); a jump in ``tick`` is a gap.
    ``clock`` places
    them in UTC, ``report`` says what was lost.
    """

    channels: tuple[str, ...]
    tick: NDArray[np.int64]
    epoch: NDArray[np.int32]
    counts: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    clock: Clock
    name: str = "record"
    period: float = TICK
    report: dict[str, Any] = field(default_factory=dict)

    def column(self, channel: str) -> int:
        """Index of a channel by name."""
        if channel not in self.channels:
            raise DataError(
                f"{self.name}: no channel '{channel}'.{did_you_mean(channel, self.channels)} "
                f"Recorded: {', '.join(self.channels)}."
            )
        return self.channels.index(channel)

    def utc(self, rows: slice | NDArray[np.int64]) -> NDArray[np.float64]:
        """UTC of some samples, s since 1970; counted from tick 0 if the board knew no UTC."""
        times = self.clock.utc(self.epoch[rows], self.tick[rows])
        return np.where(np.isfinite(times), times, self.tick[rows] * self.period)

    def require_usable(self, channel: str, share: float = 0.01) -> None:
        """Raise if more than ``share`` of a channel's samples sit on a rail of the converter."""
        column = self.column(channel)
        total = len(self.tick)
        number = int(self.report.get("samples_on_a_rail", {}).get(channel, 0))
        if not self.report:
            values = self.counts[:, column]
            number = int(np.count_nonzero((values == 0) | (values == 1023)))
        if total and number > share * total:
            raise DataError(
                f"{self.name}: channel {channel}: expected counts between 1 and 1022, found {number} of {total} "
                "samples saturated. The sensor is unplugged, broken or too small for the current."
            )


def _all_channels(batches: list[Batch], name: str) -> tuple[str, ...]:
    kinds = {part.channels for batch in batches for part in batch.samples}
    if not kinds:
        raise DataError(f"{name}: expected samples, found none. A link subset holds window means only.")
    return max(kinds, key=len)


def _stamps(batch: Batch, arrivals: NDArray[np.int64]) -> NDArray[np.int64]:
    """The board's own stamps, or those of the host where the board sent none."""
    if batch.clock.size or not arrivals.size:
        return batch.clock
    parts = [stamps_from_arrival(arrivals, part.end, part.epoch, part.tick) for part in batch.samples]
    return np.concatenate([batch.clock, *parts])


def collect(
    batches: list[Batch], name: str, report: dict[str, Any], arrivals: NDArray[np.int64] | None = None
) -> BoardRecord:
    """Join batches; samples of a revision 2 log that lack a channel of the fullest set are left out."""
    channels = _all_channels(batches, name)
    parts = [part for batch in batches for part in batch.samples if part.channels == channels]
    setups = [setup for batch in batches for setup in batch.setups]
    period = setups[0].tick if setups else TICK
    order = slice(None)
    epoch = np.concatenate([part.epoch for part in parts])
    tick = np.concatenate([part.tick for part in parts])
    if tick.size > 1 and ((np.diff(tick) <= 0) & (np.diff(epoch) == 0)).any():
        order = np.lexsort((tick, epoch))
    known = np.empty((0, 2), dtype=np.int64) if arrivals is None else arrivals
    if any(batch.clock.size for batch in batches):
        known = known[:0]
    stamps = np.concatenate([_stamps(batch, known) for batch in batches])
    return BoardRecord(
        channels=channels,
        tick=tick[order],
        epoch=epoch[order],
        counts=np.concatenate([part.counts for part in parts])[order],
        flags=np.concatenate([part.flags for part in parts])[order],
        clock=fit_clock(stamps, int(epoch.max()) + 1 if epoch.size else 1, period),
        name=name,
        period=period,
        report=report,
    )


def read_log(path: str | Path, revision: int | None = None) -> BoardRecord:
    """Decode a log or a capture folder into memory.

    Raises
    ------
    DataError : nothing of ours in it; what is damaged is left out and counted instead.
    """
    if (Path(path) / "report.json").is_file():
        return open_record(path)
    decoder = Decoder(revision, str(path))
    batches = list(decode_pieces(read_pieces(path), decoder))
    return collect(batches, Path(path).name, decoder.report.as_dict(), read_arrivals(Path(path)))


class _GrowingArray:
    """A ``.npy`` file written front to back; the header leaves room for the final length."""

    def __init__(self, path: Path, dtype: Any, tail: tuple[int, ...]) -> None:
        self.path, self.dtype, self.tail, self.rows = path, np.dtype(dtype), tail, 0
        self._stream = open(path.with_suffix(".npy.part"), "wb+")
        self._header()

    def _header(self) -> None:
        self._stream.seek(0)
        described = {
            "descr": npy.dtype_to_descr(self.dtype),
            "fortran_order": False,
            "shape": (self.rows, *self.tail),
        }
        npy.write_array_header_1_0(self._stream, described)

    def append(self, values: NDArray[Any]) -> None:
        np.ascontiguousarray(values, dtype=self.dtype).tofile(self._stream)
        self.rows += len(values)

    def close(self) -> None:
        length = self._stream.tell()
        self._header()
        self._stream.seek(length)
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        self.path.with_suffix(".npy.part").rename(self.path)


def write_record(
    pieces: Iterator[bytes],
    folder: str | Path,
    name: str,
    revision: int | None = None,
    arrivals: NDArray[np.int64] | None = None,
) -> tuple[BoardRecord, Decoder]:
    """Decode a stream into a record folder with constant memory.

    Parameters
    ----------
    pieces : bytes, as :func:`decoder.read_pieces` gives them.
    folder : made if absent; an earlier record in it is replaced.
    name : of the log, for messages.
    arrivals : from ``clock.read_arrivals``, used where the board sends no UTC.
    """
    host = np.empty((0, 2), dtype=np.int64) if arrivals is None else arrivals
    where = Path(folder)
    where.mkdir(parents=True, exist_ok=True)
    decoder = Decoder(revision, name)
    files: dict[str, _GrowingArray] = {}
    stamps, channels, period, left_out = [], (), TICK, 0
    for batch in decode_pieces(pieces, decoder):
        period = batch.setups[0].tick if batch.setups else period
        if batch.clock.size and host.size:
            host, stamps = host[:0], []
        stamps.append(_stamps(batch, host))
        for part in batch.samples:
            if not files:
                channels = max((p.channels for p in batch.samples), key=len)
                kinds = (np.uint16, np.int64, np.int32, np.uint8)
                for key, kind in zip(_ARRAYS, kinds, strict=True):
                    tail = (len(channels),) if key == "counts" else ()
                    files[key] = _GrowingArray(where / f"{key}.npy", kind, tail)
            if part.channels != channels:
                left_out += len(part.tick)
                continue
            for key in _ARRAYS:
                files[key].append(getattr(part, key))
    if not files:
        raise DataError(f"{name}: expected samples, found none. A link subset holds window means only.")
    for file in files.values():
        file.close()
    np.save(where / "clock.npy", np.concatenate(stamps))
    report = decoder.report.as_dict()
    report |= {
        "channels": list(channels),
        "period_s": period,
        "samples_without_all_channels": left_out,
        "log": name,
    }
    (where / "report.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    return open_record(where), decoder


def open_record(folder: str | Path) -> BoardRecord:
    """Map a record folder written by :func:`write_record`."""
    where = Path(folder)
    try:
        report = json.loads((where / "report.json").read_text(encoding="utf-8"))
        arrays = {key: np.load(where / f"{key}.npy", mmap_mode="r") for key in _ARRAYS}
        stamps = np.load(where / "clock.npy")
    except FileNotFoundError as error:
        raise DataError(
            f"{where}: expected a decoded board record, found no {Path(error.filename).name}."
        ) from None
    epochs = int(arrays["epoch"].max()) + 1 if arrays["epoch"].size else 1
    period = float(report["period_s"])
    return BoardRecord(
        channels=tuple(report["channels"]),
        clock=fit_clock(stamps, epochs, period),
        name=str(report.get("log", where.name)),
        period=period,
        report=report,
        **arrays,
    )
