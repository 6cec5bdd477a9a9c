"""Decoded board records: in memory, or as NumPy files written piece by piece with constant memory.

A record folder holds ``counts.npy`` (row, channel), ``tick.npy``, ``epoch.npy``, ``flags.npy``, ``clock.npy`` and
``report.json``. :func:`open_record` maps them, so that a month of samples need not fit into memory. Where channels are
sampled at different rates a row holds ``NOT_SAMPLED`` for a channel that had no turn; :meth:`BoardRecord.only` gives
the rows of a channel at its own rate.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from glider_jax.board.clock import Clock, fit_clock, read_arrivals, stamps_from_arrival
from glider_jax.board.decoder import Batch, Decoder, Samples, decode_pieces, read_pieces
from glider_jax.board.frames import CHANNELS_8, TICK
from glider_jax.errors import DataError, did_you_mean

_ARRAYS = ("counts", "tick", "epoch", "flags")
NOT_SAMPLED = 0xFFFF
_PIECE = 1 << 18


@dataclass(frozen=True)
class BoardRecord:
    """Samples of a board.

    ``tick``, ``epoch``, ``flags`` (row,), ``counts`` (row, channel); rows are ``stride`` ticks of ``period`` s apart,
    and a larger step is a gap. ``mixed`` says that not every row has every channel: take :meth:`only` what is needed
    together. ``clock`` places the rows in UTC, ``report`` says what was lost.
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
    stride: int = 1
    mixed: bool = False

    @property
    def spacing(self) -> float:
        """Time from one row to the next, s."""
        return self.period * self.stride

    def only(self, *channels: str) -> BoardRecord:
        """The rows in which all of some channels were sampled, at the rate at which they come together."""
        columns = [self.column(channel) for channel in channels]
        if not self.mixed:
            return self
        rows = np.flatnonzero((self.counts[:, columns] != NOT_SAMPLED).all(axis=1))
        tick = self.tick[rows]
        return replace(
            self,
            channels=channels,
            tick=tick,
            epoch=self.epoch[rows],
            counts=self.counts[rows][:, columns],
            flags=self.flags[rows],
            stride=_stride(tick),
            mixed=False,
        )

    def rows_between(self, epoch: int, first: int, last: int) -> slice:
        """Rows of an epoch whose ticks lie from ``first`` to ``last``, both included."""
        begin, end = np.searchsorted(self.epoch, [epoch, epoch + 1])
        low, high = np.searchsorted(self.tick[begin:end], [first, last + 1])
        return slice(int(begin + low), int(begin + high))

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

    def clock_at(self, epoch: int, ticks: list[int]) -> NDArray[np.float64]:
        """UTC of some ticks of an epoch, s since 1970; counted from tick 0 if the board knew no UTC."""
        at = np.asarray(ticks, dtype=np.int64)
        times = self.clock.utc(np.full(at.shape, epoch), at)
        return np.where(np.isfinite(times), times, at * self.period)

    def require_usable(self, channel: str, share: float = 0.01) -> None:
        """Raise if more than ``share`` of a channel's samples sit on a rail of the converter."""
        column = self.column(channel)
        total = len(self.tick)
        number = int(self.report.get("samples_on_a_rail", {}).get(channel, 0))
        if self.mixed:
            total = int(np.count_nonzero(self.counts[:, column] != NOT_SAMPLED))
        if not self.report:
            values = self.counts[:, column]
            number = int(np.count_nonzero((values == 0) | (values == 1023)))
        if total and number > share * total:
            raise DataError(
                f"{self.name}: channel {channel}: expected counts between 1 and 1022, found {number} of {total} "
                "samples saturated. The sensor is unplugged, broken or too small for the current."
            )


def _stride(tick: NDArray[np.int64]) -> int:
    """Ticks from one row to the next where nothing is lost: the largest that divides all steps and ticks."""
    return max(int(np.gcd.reduce(tick)), 1) if tick.size > 1 else 1


def _one_period(ticks: list[float], name: str) -> float:
    """Length of a tick, s, as the setup frames say; 32 ms where there is none."""
    if len(set(ticks)) > 1:
        raise DataError(
            f"{name}: expected one length of a tick, found {', '.join(f'{1e3 * t:g} ms' for t in sorted(set(ticks)))}. "
            "The board was set up anew; decode the parts of the log one by one."
        )
    return ticks[0] if ticks else TICK


def _in_order(channels: set[str] | frozenset[str]) -> tuple[str, ...]:
    return tuple(name for name in CHANNELS_8 if name in channels)


def _no_samples(name: str) -> DataError:
    return DataError(f"{name}: expected samples, found none. A link subset holds window means only.")


def _merge(parts: list[Samples], channels: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Rows of several sets of channels in the order of their ticks, with ``NOT_SAMPLED`` where one had no turn."""
    out: dict[str, NDArray[Any]] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS[1:]
    }
    counts = np.full((out["tick"].size, len(channels)), NOT_SAMPLED, dtype=np.uint16)
    begin = 0
    for part in parts:
        rows = slice(begin, begin + len(part.tick))
        counts[rows, [channels.index(name) for name in part.channels]] = part.counts
        begin = rows.stop
    tick, epoch = out["tick"], out["epoch"]
    out["counts"] = counts
    if tick.size > 1 and ((np.diff(tick) <= 0) & (np.diff(epoch) == 0)).any():
        order = np.lexsort((tick, epoch))
        out = {name: values[order] for name, values in out.items()}
    return out


def _stamps(batch: Batch, arrivals: NDArray[np.int64]) -> NDArray[np.int64]:
    """The board's own stamps, or those of the host where the board sent none."""
    if batch.clock.size or not arrivals.size:
        return batch.clock
    parts = [stamps_from_arrival(arrivals, part.end, part.epoch, part.tick) for part in batch.samples]
    return np.concatenate([batch.clock, *parts])


def collect(
    batches: list[Batch], name: str, report: dict[str, Any], arrivals: NDArray[np.int64] | None = None
) -> BoardRecord:
    """Join batches in memory."""
    parts = [part for batch in batches for part in batch.samples if len(part.tick)]
    if not parts:
        raise _no_samples(name)
    sets = {part.channels for part in parts}
    channels = _in_order(set().union(*sets))
    ticks = [setup.tick for batch in batches for setup in batch.setups]
    period = _one_period(ticks, name)
    known = np.empty((0, 2), dtype=np.int64) if arrivals is None else arrivals
    if any(batch.clock.size for batch in batches):
        known = known[:0]
    stamps = np.concatenate([_stamps(batch, known) for batch in batches])
    rows = _merge(parts, channels)
    second = report.get("revision") == 2
    return BoardRecord(
        channels=channels,
        **rows,
        clock=fit_clock(stamps, int(rows["epoch"].max()) + 1, period),
        name=name,
        period=period,
        report=report | _extra(rows["counts"], channels, period, name, second and not ticks),
        stride=_stride(rows["tick"]) if second and len(sets) == 1 else 1,
        mixed=len(sets) > 1,
    )


def _extra(
    counts: NDArray[np.uint16], channels: tuple[str, ...], period: float, name: str, assumed: bool
) -> dict[str, Any]:
    """What a record adds to the decoder's report."""
    numbers = np.zeros(len(channels), dtype=np.int64)
    for begin in range(0, len(counts), _PIECE):
        numbers += np.count_nonzero(counts[begin : begin + _PIECE] != NOT_SAMPLED, axis=0)
    return {
        "channels": list(channels),
        "samples_by_channel": dict(zip(channels, numbers.tolist(), strict=True)),
        "period_s": period,
        "period_assumed": assumed,
        "log": name,
    }


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
    sets: set[tuple[str, ...]] = set()
    ticks: list[float] = []
    stamps, channels, stride = [], (), 0
    for batch in decode_pieces(pieces, decoder):
        ticks += [setup.tick for setup in batch.setups]
        if batch.clock.size and host.size:
            host, stamps = host[:0], []
        stamps.append(_stamps(batch, host))
        parts = [part for part in batch.samples if len(part.tick)]
        if not parts:
            continue
        sets |= {part.channels for part in parts}
        wanted = _in_order(set().union(*sets))
        if not files:
            kinds = (np.uint16, np.int64, np.int32, np.uint8)
            for key, kind in zip(_ARRAYS, kinds, strict=True):
                files[key] = _GrowingArray(
                    where / f"{key}.npy", kind, (len(wanted),) if key == "counts" else ()
                )
        elif wanted != channels:
            files["counts"] = _widened(files["counts"], channels, wanted)
        channels = wanted
        rows = _merge(parts, channels)
        stride = int(np.gcd(stride, np.gcd.reduce(rows["tick"])))
        for key in _ARRAYS:
            files[key].append(rows[key])
    if not files:
        raise _no_samples(name)
    period = _one_period(ticks, name)
    for file in files.values():
        file.close()
    np.save(where / "clock.npy", np.concatenate(stamps))
    counts = np.load(where / "counts.npy", mmap_mode="r")
    second = decoder.report.revision == 2
    report = decoder.report.as_dict() | _extra(counts, channels, period, name, second and not ticks)
    report |= {"mixed": len(sets) > 1, "stride": max(stride, 1) if second and len(sets) == 1 else 1}
    (where / "report.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    return open_record(where), decoder


def _widened(old: _GrowingArray, before: tuple[str, ...], after: tuple[str, ...]) -> _GrowingArray:
    """The same rows with room for channels that came later."""
    old.close()
    narrow = np.load(old.path, mmap_mode="r")
    wide = _GrowingArray(old.path, np.uint16, (len(after),))
    columns = [after.index(name) for name in before]
    for begin in range(0, len(narrow), _PIECE):
        piece = np.full((len(narrow[begin : begin + _PIECE]), len(after)), NOT_SAMPLED, dtype=np.uint16)
        piece[:, columns] = narrow[begin : begin + _PIECE]
        wide.append(piece)
    return wide


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
        stride=int(report.get("stride", 1)),
        mixed=bool(report.get("mixed", False)),
        **arrays,
    )
