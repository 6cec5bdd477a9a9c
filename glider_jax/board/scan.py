"""Find frames in a buffer of bytes, all at once; NumPy only.

A frame is believed only where the sync bytes, a known pair of revision and type, the one length that the
pair may
have, both CRC-16s and zero padding agree. Sync bytes inside a payload are no trouble: they fail the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from glider_jax.board import frames, revision2
from glider_jax.board.crc import crc_many


def _known_lengths() -> NDArray[np.bool_]:
    """(256, 256) whether byte 2 (revision and type) may go with byte 3 (payload length)."""
    known = np.zeros((256, 256), dtype=bool)
    for kind, layout in frames.REVISION_1.items():
        known[(1 << 4) | kind, layout.payload] = True
    known[(2 << 4) | frames.SETUP, revision2.SETUP_PAYLOAD] = True
    known[(2 << 4) | frames.EVENT, 10] = True
    known[(2 << 4) | frames.CLOCK, 10] = True
    for channels in range(1, 9):
        mask = (1 << channels) - 1
        known[(2 << 4) | frames.SAMPLES, revision2.samples_payload(mask)] = True
        known[(2 << 4) | frames.SUBSET, revision2.subset_payload(mask)] = True
    return known


_KNOWN = _known_lengths()
# A revision that this version does not know may have any even length; it is checked so that it can be named.
_FOREIGN = np.zeros((256, 256), dtype=bool)
for _byte in range(256):
    if (_byte >> 4) not in frames.REVISIONS:
        _FOREIGN[_byte, 2 : frames.LARGEST_PAYLOAD + 1 : 2] = True
_PLAUSIBLE = _KNOWN | _FOREIGN


@dataclass
class Found:
    """Frames found in one buffer, in the order of their first byte.

    ``offset`` and ``size`` in bytes, ``label`` is byte 2, ``boot`` and ``flags`` the halves of byte 4,
    ``sequence`` the
    24-bit number. ``damaged`` counts plausible headers whose checks failed outside good frames;
    ``foreign`` counts
    intact frames by unknown revision. ``rest`` is where the bytes begin that may still become a frame.
    """

    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    label: NDArray[np.uint8]
    boot: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    sequence: NDArray[np.int64]
    rest: int
    damaged: int = 0
    foreign: dict[int, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.offset.size


def distinct(values: NDArray[np.integer]) -> list[int]:
    """The different small non-negative integers in an array, ascending; faster than sorting."""
    return np.flatnonzero(np.bincount(values)).tolist() if values.size else []


def rows_at(data: NDArray[np.uint8], offsets: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Copy ``size`` bytes at each offset: (frame, size)."""
    return as_strided(data, (data.size - size + 1, size), (1, 1), writeable=False)[offsets]


def _intact(data: NDArray[np.uint8], offsets: NDArray[np.int64], length: int) -> NDArray[np.bool_]:
    """Whether both checks of frames with one payload length hold."""
    body = rows_at(data, offsets + 2, length + frames.OVERHEAD - 2).view("<u2")
    checks = body[:, -2].astype(np.uint32) | (body[:, -1].astype(np.uint32) << np.uint32(16))
    return crc_many(body[:, :-2]) == checks


def _consistent(
    data: NDArray[np.uint8], offsets: NDArray[np.int64], label: int, length: int
) -> NDArray[np.bool_]:
    """Whether mask, length and zero padding agree with the frame type."""
    revision, kind = label >> 4, label & 15
    if revision == 1:
        layout = frames.REVISION_1[kind]
        packed = rows_at(data, offsets + 8 + length - layout.packed, layout.packed)
        return frames.padding_is_zero(packed, len(layout.channels))
    if kind not in (frames.SAMPLES, frames.SUBSET):
        return np.ones(offsets.size, dtype=bool)
    payload = rows_at(data, offsets + 8, length)
    masks = payload[:, 4 if kind == frames.SAMPLES else 6]
    good = np.zeros(offsets.size, dtype=bool)
    for mask in distinct(masks):
        channels = int(mask).bit_count()
        rows = masks == mask
        if kind == frames.SAMPLES and length == revision2.samples_payload(int(mask)):
            good[rows] = frames.padding_is_zero(payload[rows, 6:], channels)
        if kind == frames.SUBSET and length == revision2.subset_payload(int(mask)):
            good[rows] = frames.padding_is_zero(payload[rows, 8 + 2 * channels :], 2 * channels)
    return good


def _without_overlap(offset: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Keep the earlier of two frames that share bytes; nearly always there are none.

    A frame cut short by a byte or two whose next frame begins with just those bytes is intact, and so is
    the next.
    """
    keep = np.ones(offset.size, dtype=bool)
    if offset.size < 2 or (offset[1:] >= offset[:-1] + size[:-1] - frames.TRAILER).all():
        return keep
    end = -1
    for index in range(offset.size):
        if offset[index] < end - frames.TRAILER:
            keep[index] = False
        else:
            end = offset[index] + size[index]
    return keep


def find_frames(data: NDArray[np.uint8]) -> Found:
    """Find every intact frame in a buffer.

    Parameters
    ----------
    data : (byte,) contiguous; a frame cut by the end of the buffer is left for the next one, see
        ``Found.rest``.
    """
    at = np.flatnonzero((data[:-1] == frames.SYNC[0]) & (data[1:] == frames.SYNC[1])) if data.size > 1 else []
    at = np.asarray(at, dtype=np.int64)
    whole_header = at + frames.HEADER <= data.size
    waiting = at[~whole_header]
    at = at[whole_header]
    label, length = data[at + 2], data[at + 3]
    plausible = _PLAUSIBLE[label, length]
    at, label, length = at[plausible], label[plausible], length[plausible].astype(np.int64)
    size = length + frames.OVERHEAD
    whole = at + size <= data.size
    waiting = np.concatenate([waiting, at[~whole]])
    at, label, length, size = at[whole], label[whole], length[whole], size[whole]

    good = np.zeros(at.size, dtype=bool)
    for value in distinct(length):
        rows = np.flatnonzero(length == value)
        good[rows] = _intact(data, at[rows], value)
    for byte in distinct(label[good]):
        for value in distinct(length[good & (label == byte)]):
            if _KNOWN[byte, value]:
                rows = np.flatnonzero(good & (label == byte) & (length == value))
                good[rows] = _consistent(data, at[rows], byte, value)

    index = np.flatnonzero(good)
    index = index[_without_overlap(at[index], size[index])]
    offset, size, label_good = at[index], size[index], label[index]
    end = int(offset[-1] + size[-1]) if offset.size else 0
    bad = at[~good]
    inside = np.searchsorted(offset, bad, side="right") - 1
    hidden = (
        (inside >= 0) & (bad < (offset + size)[inside]) if offset.size else np.zeros(bad.size, dtype=bool)
    )
    waiting = waiting[waiting >= end - frames.TRAILER]
    if waiting.size:
        rest = int(waiting.min())
    else:
        rest = data.size - 1 if data.size > end and data[-1] == frames.SYNC[0] else data.size
    known = np.isin(label_good >> 4, frames.REVISIONS)
    revisions, number = np.unique(label_good[~known] >> 4, return_counts=True)
    header = rows_at(data, offset, frames.HEADER) if offset.size else np.empty((0, 8), dtype=np.uint8)
    header = header[known]
    return Found(
        offset=offset[known],
        size=size[known],
        label=label_good[known],
        boot=header[:, 4] & np.uint8(15),
        flags=header[:, 4] >> np.uint8(4),
        sequence=frames.from_integers(header[:, 5:8]),
        rest=rest,
        damaged=int(np.count_nonzero(~hidden)),
        foreign={int(r): int(n) for r, n in zip(revisions, number, strict=True)},
    )
