"""Bytes to samples: a streaming decoder with constant memory and an account of everything lost; NumPy only.

Feed bytes in pieces of any size and get batches of intact samples. The result does not depend on how the
bytes were
cut. Nothing is interpolated: a sample that did not arrive intact is a gap with a length, never a number.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_jax.board import frames, revision2
from glider_jax.board.scan import Found, distinct, find_frames, rows_at
from glider_jax.board.sequence import Follower
from glider_jax.errors import ConfigError, DataError

PIECE = 1 << 20


@dataclass(frozen=True)
class Samples:
    """Intact samples of one set of channels.

    ``tick`` (sample,) since the board's start, ``epoch`` (sample,) counts the starts, ``counts`` (sample,
    channel) A/D
    counts, ``flags`` (sample,) trigger and saturation bits, ``end`` (sample,) the byte of the stream after
    its frame.
    """

    channels: tuple[str, ...]
    tick: NDArray[np.int64]
    epoch: NDArray[np.int32]
    counts: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    end: NDArray[np.int64]


@dataclass(frozen=True)
class Window:
    """One entry per window of the decimated subset.

    ``tick`` is the first of ``window`` ticks; ``mean`` in counts with 1/64 resolution, ``least`` and
    ``most`` in counts, all
    (entry, channel).
    """

    channels: tuple[str, ...]
    tick: NDArray[np.int64]
    epoch: NDArray[np.int32]
    window: NDArray[np.int64]
    mean: NDArray[np.float64]
    least: NDArray[np.uint16]
    most: NDArray[np.uint16]


@dataclass(frozen=True)
class Trigger:
    """A trigger window began or ended: at which tick, which channels may fire, how many samples were
    logged."""

    epoch: int
    tick: int
    started: bool
    channels: tuple[str, ...]
    logged: int


@dataclass(frozen=True)
class Batch:
    """What one piece of the stream held; ``clock`` rows are (epoch, tick, UTC in ms since 1970)."""

    samples: tuple[Samples, ...] = ()
    subset: tuple[Window, ...] = ()
    triggers: tuple[Trigger, ...] = ()
    clock: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), dtype=np.int64))
    setups: tuple[revision2.Setup, ...] = ()


@dataclass
class Report:
    """Everything counted while decoding.

    ``missing`` is the number of frames lost by sequence within epochs; for revision 1 that is the number
    of samples of
    all channels. ``noise`` counts bytes that belong to no intact frame. What was lost across a restart of
    the board
    cannot be known from sequence numbers and is not in ``missing``.
    """

    bytes: int = 0
    frames: int = 0
    samples: int = 0
    noise: int = 0
    damaged: int = 0
    other_revision: int = 0
    other_layout: int = 0
    odd_setups: int = 0
    revision: int = 0
    channels: tuple[str, ...] = ()
    foreign: dict[int, int] = field(default_factory=dict)
    rails: dict[str, int] = field(default_factory=dict)
    follower: Follower = field(default_factory=Follower)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        f = self.follower
        return {
            "bytes": self.bytes,
            "revision": self.revision,
            "channels": list(self.channels),
            "frames": self.frames,
            "samples": self.samples,
            "frames_missing": f.missing,
            "gaps": f.gap_count,
            "repeats": f.repeats,
            "restarts": f.restarts,
            "strays": f.strays,
            "damaged_frames": self.damaged,
            "noise_bytes": self.noise,
            "frames_of_other_revision": self.other_revision,
            "frames_of_other_layout": self.other_layout,
            "odd_setups": self.odd_setups,
            "unknown_revisions": {str(k): v for k, v in self.foreign.items()},
            "samples_on_a_rail": dict(self.rails),
            "first_frame_numbers": f.first[:16],
            "first_gaps": [{"epoch": g.epoch, "after": g.before, "missing": g.missing} for g in f.gaps[:100]],
        }

    def sentences(self) -> list[str]:
        """What was lost, for the user."""
        f = self.follower
        out = [f"{self.samples} samples in {self.frames} intact frames of revision {self.revision}"]
        if f.missing:
            out.append(f"{f.missing} frames are missing in {f.gap_count} gaps, counted by sequence number")
        for number, text in (
            (f.repeats, "repeated frames were dropped"),
            (f.strays, "frames with a number that fits nowhere were dropped"),
            (f.restarts, "restarts of the board; what was lost across them cannot be counted"),
            (self.damaged, "frames had a readable header but failed their checks"),
            (self.noise, "bytes belong to no intact frame"),
            (self.other_revision, "intact frames of another revision were left out"),
            (self.other_layout, "intact frames with other channels were left out"),
            (self.odd_setups, "intact setup frames hold numbers no board can have and were left out"),
        ):
            if number:
                out.append(f"{number} {text}")
        for name, number in self.rails.items():
            if number:
                out.append(f"channel {name}: {number} samples on a rail of the converter")
        return out


class Decoder:
    """Decode a stream fed in pieces.

    Parameters
    ----------
    revision : 1 or 2 to accept only that one, None to take that of the first intact frames.
    name : of the file or port, for error messages.
    """

    def __init__(self, revision: int | None = None, name: str = "stream") -> None:
        self.name = name
        self.wanted = revision
        self.report = Report()
        self._rest = np.empty(0, dtype=np.uint8)
        self._start = 0

    @property
    def pending(self) -> int:
        """Bytes fed so far that may be the beginning of a frame not yet complete."""
        return self._rest.size

    def feed(self, data: bytes | NDArray[np.uint8], final: bool = False) -> Batch:
        """Decode the next bytes; ``final`` says that no more will come."""
        new = (
            np.frombuffer(data, dtype=np.uint8) if isinstance(data, bytes | bytearray | memoryview) else data
        )
        self.report.bytes += new.size
        buffer = np.concatenate([self._rest, new]) if self._rest.size else np.ascontiguousarray(new)
        found = find_frames(buffer)
        report = self.report
        if report.revision == 0 and len(found):
            report.revision = self.wanted or int(np.bincount(found.label >> 4).argmax())
        keep, number, epoch, used = self._follow(found, final)
        if used < len(found):
            rest = int(found.offset[used])
        else:
            rest = buffer.size if final else found.rest
        own = np.minimum(found.size[:used], np.diff(found.offset[:used], append=buffer.size))
        taken = int(own.sum())
        report.noise += rest - taken
        report.damaged += found.damaged
        for revision, count in found.foreign.items():
            report.foreign[revision] = report.foreign.get(revision, 0) + count
        self._start = report.bytes - buffer.size
        self._rest = buffer[rest:].copy()
        rows = np.flatnonzero(keep)
        report.frames += rows.size
        return self._batch(buffer, found, rows, number[rows], epoch[rows])

    def _follow(
        self, found: Found, final: bool
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int32], int]:
        """Sequence numbers of the frames of the accepted revision; the others are only counted."""
        mine = (found.label >> 4) == self.report.revision
        if mine.all():
            return self.report.follower.follow(found.boot, found.sequence, final)
        rows = np.flatnonzero(mine)
        keep_m, number_m, epoch_m, used_m = self.report.follower.follow(
            found.boot[rows], found.sequence[rows], final
        )
        used = len(found) if used_m == rows.size else int(rows[used_m])
        self.report.other_revision += int(np.count_nonzero(~mine[:used]))
        keep = np.zeros(len(found), dtype=bool)
        number = np.zeros(len(found), dtype=np.int64)
        epoch = np.zeros(len(found), dtype=np.int32)
        keep[rows], number[rows], epoch[rows] = keep_m, number_m, epoch_m
        return keep, number, epoch, used

    def _batch(
        self,
        buffer: NDArray[np.uint8],
        found: Found,
        rows: NDArray[np.int64],
        number: NDArray[np.int64],
        epoch: NDArray[np.int32],
    ) -> Batch:
        if rows.size == 0:
            return Batch()
        if self.report.revision == 1:
            return self._revision_1(buffer, found, rows, number, epoch)
        return self._revision_2(buffer, found, rows, epoch)

    def _count(self, channels: tuple[str, ...], counts: NDArray[np.uint16]) -> None:
        self.report.samples += len(counts)
        rails = (counts == 0) | (counts == frames.FULL_SCALE)
        if rails.any():
            for name, count in zip(channels, rails.sum(axis=0).tolist(), strict=True):
                self.report.rails[name] = self.report.rails.get(name, 0) + count

    def _revision_1(
        self,
        buffer: NDArray[np.uint8],
        found: Found,
        rows: NDArray[np.int64],
        number: NDArray[np.int64],
        epoch: NDArray[np.int32],
    ) -> Batch:
        kinds = found.label[rows] & 15
        if not self.report.channels:
            self.report.channels = frames.REVISION_1[int(kinds[0])].channels
        channels = self.report.channels
        accepted = [kind for kind, layout in frames.REVISION_1.items() if layout.channels == channels]
        fitting = np.isin(kinds, accepted)
        if not fitting.all():
            self.report.other_layout += int(np.count_nonzero(~fitting))
            rows, kinds, number, epoch = rows[fitting], kinds[fitting], number[fitting], epoch[fitting]
        counts = np.empty((rows.size, len(channels)), dtype=np.uint16)
        clock = np.empty((0, 3), dtype=np.int64)
        for kind in accepted:
            layout = frames.REVISION_1[kind]
            where = np.flatnonzero(kinds == kind)
            if where.size == 0:
                continue
            payload = rows_at(buffer, found.offset[rows[where]] + frames.HEADER, layout.payload)
            counts[where] = frames.unpack_samples(payload[:, layout.payload - layout.packed :], len(channels))
            if layout.timed:
                clock = np.stack(
                    [epoch[where], number[where], frames.from_integers(payload[:, :6])], axis=1
                ).astype(np.int64)
        self._count(channels, counts)
        end = self._start + found.offset[rows] + found.size[rows]
        return Batch(samples=(Samples(channels, number, epoch, counts, found.flags[rows], end),), clock=clock)

    def _revision_2(
        self, buffer: NDArray[np.uint8], found: Found, rows: NDArray[np.int64], epoch: NDArray[np.int32]
    ) -> Batch:
        samples, subset, triggers, setups = [], [], [], []
        clock = np.empty((0, 3), dtype=np.int64)
        kinds = found.label[rows] & 15
        for kind in distinct(kinds):
            for size in distinct(found.size[rows[kinds == kind]]):
                where = np.flatnonzero((kinds == kind) & (found.size[rows] == size))
                payload = rows_at(buffer, found.offset[rows[where]] + frames.HEADER, size - frames.OVERHEAD)
                ticks, at = frames.from_integers(payload[:, :4]), epoch[where]
                if kind == frames.SETUP:
                    setups += self._setups(payload)
                elif kind == frames.CLOCK:
                    clock = np.stack([at, ticks, frames.from_integers(payload[:, 4:10])], axis=1).astype(
                        np.int64
                    )
                elif kind == frames.EVENT:
                    triggers += [_trigger(row, int(e)) for row, e in zip(payload, at, strict=True)]
                elif kind == frames.SAMPLES:
                    mine = rows[where]
                    end = self._start + found.offset[mine] + found.size[mine]
                    samples += self._by_mask(payload, ticks, at, found.flags[mine], end)
                else:
                    subset += _windows(payload, ticks, at)
        triggers.sort(key=lambda t: (t.epoch, t.tick, not t.started))
        return Batch(tuple(samples), tuple(subset), tuple(triggers), clock, tuple(setups))

    def _setups(self, payload: NDArray[np.uint8]) -> list[revision2.Setup]:
        out = []
        for row in payload:
            try:
                out.append(revision2.Setup.from_payload(row))
            except ConfigError:
                self.report.odd_setups += 1
        return out

    def _by_mask(
        self,
        payload: NDArray[np.uint8],
        ticks: NDArray[np.int64],
        epoch: NDArray[np.int32],
        flags: NDArray[np.uint8],
        end: NDArray[np.int64],
    ) -> list[Samples]:
        out = []
        for mask in distinct(payload[:, 4]):
            chosen = payload[:, 4] == mask
            channels = _names(mask)
            counts = frames.unpack_samples(payload[chosen, 6:], len(channels))
            self._count(channels, counts)
            out.append(Samples(channels, ticks[chosen], epoch[chosen], counts, flags[chosen], end[chosen]))
        return out

    def check(self) -> None:
        """Raise if so far nothing says that this is a stream of ours.

        Raises
        ------
        DataError : noise, a wrong baud rate, a foreign log, an unknown revision or not the revision asked
            for.
        """
        report = self.report
        if report.frames:
            return
        if report.other_revision:
            raise DataError(
                f"{self.name}: expected frames of revision {self.wanted}, found {report.other_revision} intact "
                "frames of another revision. Leave the revision out to let the decoder recognise it."
            )
        if report.foreign:
            found = ", ".join(f"{n} of revision {r}" for r, n in sorted(report.foreign.items()))
            raise DataError(
                f"{self.name}: expected frames of revision 1 or 2, found intact frames only: {found}. "
                "Update this program, or set the board to revision 1 or 2."
            )
        what = "an empty stream" if report.bytes == 0 else f"no intact frame in {report.bytes} bytes"
        why = "Check that the board is on and the port is the right one."
        if report.bytes:
            why = (
                f"{report.damaged} damaged frames. "
                "All noise, a wrong baud rate (the board sends 9,600 8N1), or not a log of this board."
            )
        raise DataError(f"{self.name}: expected frames of the measurement board, found {what}. {why}")


def _names(mask: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(revision2.CHANNELS) if mask >> bit & 1)


def _trigger(payload: NDArray[np.uint8], epoch: int) -> Trigger:
    row = payload[None]
    return Trigger(
        epoch=epoch,
        tick=int(frames.from_integers(row[:, :4])[0]),
        started=int(payload[4]) == revision2.TRIGGER_START,
        channels=_names(int(payload[5])),
        logged=int(frames.from_integers(row[:, 6:10])[0]),
    )


def _windows(payload: NDArray[np.uint8], ticks: NDArray[np.int64], epoch: NDArray[np.int32]) -> list[Window]:
    out = []
    for mask in distinct(payload[:, 6]):
        rows = payload[payload[:, 6] == mask]
        channels = _names(mask)
        number = len(channels)
        means = np.stack(
            [frames.from_integers(rows[:, 8 + 2 * c : 10 + 2 * c]) for c in range(number)], axis=1
        )
        extremes = frames.unpack_samples(rows[:, 8 + 2 * number :], 2 * number)
        chosen = payload[:, 6] == mask
        window = frames.from_integers(rows[:, 4:6])
        out.append(
            Window(
                channels,
                ticks[chosen],
                epoch[chosen],
                window,
                means / 64,
                extremes[:, ::2],
                extremes[:, 1::2],
            )
        )
    return out


def decode_pieces(pieces: Iterator[bytes], decoder: Decoder) -> Iterator[Batch]:
    """Decode pieces one after the other; raises at the end if nothing was ours."""
    for piece in pieces:
        yield decoder.feed(piece)
    yield decoder.feed(b"", final=True)
    decoder.check()


def read_pieces(path: str | Path, size: int = PIECE) -> Iterator[bytes]:
    """Read a log in pieces, or several in the order of their names if ``path`` is a folder.

    Raises
    ------
    DataError : the file is absent, or the folder holds no log.
    """
    where = Path(path)
    if where.is_dir():
        logs = sorted(p for p in where.iterdir() if p.name.endswith((".bin", ".bin.part")))
        if not logs:
            raise DataError(
                f"{where}: expected board logs named *.bin, found none. Name a log or a capture folder."
            )
    elif where.is_file():
        logs = [where]
    else:
        raise DataError(f"{where}: expected a board log or a capture folder, found nothing. Check the path.")
    for log in logs:
        with open(log, "rb") as stream:
            while piece := stream.read(size):
                yield piece


def decode_bytes(data: bytes, revision: int | None = None, name: str = "stream") -> tuple[Batch, Report]:
    """Decode a whole stream held in memory; see :class:`Decoder`."""
    decoder = Decoder(revision, name)
    batch = decoder.feed(data, final=True)
    decoder.check()
    return batch, decoder.report
