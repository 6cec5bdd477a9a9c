"""Revision 2 of the board: a rate per channel, triggers with pre-roll, a local log and a subset for the link.

The board samples every *tick*. ``sample`` runs a :class:`Setup` over all ticks and returns two byte
streams: the
local log (every sample that the rates and triggers keep) and the link (window means, minima and maxima,
with the
same clock and event frames). A log that is silent because nothing happened has no gap in its sequence
numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board import frames
from glider_jax.errors import ConfigError

CHANNELS = frames.CHANNELS_8
TRIGGER_START, TRIGGER_END = 1, 2
_MEAN_PARTS = 64


@dataclass(frozen=True)
class Setup:
    """What the board was told to do; sent as the first frame of every log.

    Attributes
    ----------
    dividers : (8,) a channel is sampled each so many ticks; 0 leaves it out.
    tick_us : length of a tick, microseconds, 4,000 to 65,535.
    trigger_channels : names whose departure from ``zero`` by ``threshold`` counts starts the logging;
        empty logs always.
    zero, threshold : (8,) counts.
    pre_roll, post_roll : ticks kept before and after a trigger.
    subset_window : ticks per entry of the decimated subset.
    serial : number of the board.
    """

    dividers: tuple[int, ...] = (1, 0, 0, 1, 1, 1, 1, 1)
    tick_us: int = 32_000
    trigger_channels: tuple[str, ...] = ()
    zero: tuple[int, ...] = (512,) * 8
    threshold: tuple[int, ...] = (8,) * 8
    pre_roll: int = 31
    post_roll: int = 62
    subset_window: int = 1875
    serial: int = 0

    def __post_init__(self) -> None:
        for name in ("dividers", "zero", "threshold"):
            if len(getattr(self, name)) != len(CHANNELS):
                found = len(getattr(self, name))
                raise ConfigError(f"board setup: {name}: expected {len(CHANNELS)} numbers, found {found}.")
        limits = {
            "dividers": (0, 255),
            "zero": (0, frames.FULL_SCALE),
            "threshold": (1, frames.FULL_SCALE),
            "tick_us": (4_000, 65_535),
            "pre_roll": (0, 65_535),
            "post_roll": (0, 65_535),
            "subset_window": (1, 65_535),
            "serial": (0, 65_535),
        }
        for name, (low, high) in limits.items():
            values = np.atleast_1d(getattr(self, name))
            if values.min() < low or values.max() > high:
                raise ConfigError(
                    f"board setup: {name}: expected {low} to {high}, found {getattr(self, name)}."
                )
        for name in self.trigger_channels:
            if name not in CHANNELS or not self.dividers[CHANNELS.index(name)]:
                raise ConfigError(
                    f"board setup: trigger channel '{name}' is not sampled. Give it a divider above 0."
                )
        if self.subset_window < max(self.dividers):
            raise ConfigError(
                f"board setup: subset_window: expected at least the largest divider ({max(self.dividers)}), found "
                f"{self.subset_window}. A shorter window would hold no sample of that channel."
            )
        if not any(self.dividers):
            raise ConfigError("board setup: dividers: expected at least one sampled channel, found none.")

    @property
    def mask(self) -> int:
        """One bit per sampled channel, the first channel in bit 0."""
        return sum(1 << bit for bit, divider in enumerate(self.dividers) if divider)

    @property
    def tick(self) -> float:
        """Length of a tick, s."""
        return self.tick_us * 1e-6

    def bytes_per_second(self) -> float:
        """Bytes per second of the local log while logging."""
        ticks = np.arange(int(np.lcm.reduce([d for d in self.dividers if d])))
        masks = _masks(self, ticks)
        sizes = np.array(
            [frames.packed_size(int(m).bit_count()) + 6 + frames.OVERHEAD if m else 0 for m in masks]
        )
        return float(sizes.mean() / self.tick)

    def payload(self) -> NDArray[np.uint8]:
        """The payload of a ``SETUP`` frame, (1, 56)."""
        trigger = sum(1 << CHANNELS.index(name) for name in self.trigger_channels)
        numbers = [(self.tick_us, 2), (trigger, 2), (self.pre_roll, 2), (self.post_roll, 2)]
        numbers += [(self.subset_window, 2), (self.serial, 2), (0, 4)]
        numbers += (
            [(d, 1) for d in self.dividers] + [(z, 2) for z in self.zero] + [(t, 2) for t in self.threshold]
        )
        return np.concatenate([frames.integers(np.array([value]), size) for value, size in numbers], axis=1)

    @staticmethod
    def from_payload(data: NDArray[np.uint8]) -> Setup:
        """Read a ``SETUP`` payload, (56,)."""

        def number(start: int, size: int = 2) -> int:
            return int(frames.from_integers(data[None, start : start + size])[0])

        trigger = number(2)
        return Setup(
            tick_us=number(0),
            trigger_channels=tuple(n for bit, n in enumerate(CHANNELS) if trigger >> bit & 1),
            pre_roll=number(4),
            post_roll=number(6),
            subset_window=number(8),
            serial=number(10),
            dividers=tuple(int(d) for d in data[16:24]),
            zero=tuple(number(24 + 2 * i) for i in range(8)),
            threshold=tuple(number(40 + 2 * i) for i in range(8)),
        )


SETUP_PAYLOAD = 56


def samples_payload(mask: int) -> int:
    """Payload bytes of a ``SAMPLES`` frame with this channel mask: tick 4, mask 1, spare 1, samples."""
    return 6 + frames.packed_size(mask.bit_count())


def subset_payload(mask: int) -> int:
    """Payload bytes of a ``SUBSET`` frame: tick 4, window 2, mask 1, spare 1, means 2 each, minima,
    maxima."""
    return 8 + 2 * mask.bit_count() + frames.packed_size(2 * mask.bit_count())


def _masks(setup: Setup, ticks: NDArray[np.int64]) -> NDArray[np.uint8]:
    masks = np.zeros(ticks.shape, dtype=np.uint8)
    for bit, divider in enumerate(setup.dividers):
        if divider:
            masks |= np.where(ticks % divider == 0, np.uint8(1 << bit), np.uint8(0))
    return masks


def trigger_windows(setup: Setup, counts: NDArray[np.integer], masks: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Windows of ticks to be logged, (window, 3): first tick, tick of the trigger, last tick; ascending,
    disjoint.

    Parameters
    ----------
    counts : (tick, 8) counts of all channels.
    masks : (tick,) which channels are sampled at each tick.
    """
    fired = np.zeros(len(counts), dtype=bool)
    for name in setup.trigger_channels:
        bit = CHANNELS.index(name)
        away = np.abs(counts[:, bit].astype(np.int32) - setup.zero[bit]) >= setup.threshold[bit]
        fired |= away & ((masks >> bit) & 1).astype(bool)
    hits = np.flatnonzero(fired)
    if hits.size == 0:
        return np.empty((0, 3), dtype=np.int64)
    apart = np.flatnonzero(np.diff(hits) > setup.pre_roll + setup.post_roll + 1)
    first = hits[np.concatenate([[0], apart + 1])]
    last = hits[np.concatenate([apart, [hits.size - 1]])]
    return np.stack(
        [np.maximum(first - setup.pre_roll, 0), first, np.minimum(last + setup.post_roll, len(counts) - 1)],
        axis=1,
    )


def sample_frames(
    setup: Setup,
    counts: NDArray[np.integer],
    ticks: NDArray[np.int64],
    flags: NDArray[np.uint8],
    masks: NDArray[np.uint8],
) -> list[tuple[NDArray[np.int64], int, NDArray[np.uint8], NDArray[np.uint8]]]:
    """Payloads of ``SAMPLES`` frames, grouped by mask: (rows, kind, payload, flags) for each group."""
    groups = []
    for mask in np.unique(masks):
        if mask == 0:
            continue
        rows = np.flatnonzero(masks == mask)
        bits = [bit for bit in range(8) if mask >> bit & 1]
        chosen = counts[rows][:, bits]
        head = np.zeros((rows.size, 6), dtype=np.uint8)
        head[:, :4] = frames.integers(ticks[rows], 4)
        head[:, 4] = mask
        rails = ((chosen == 0) | (chosen == frames.FULL_SCALE)).any(axis=1)
        group_flags = flags[rows] | np.where(rails, frames.SATURATED, 0).astype(np.uint8)
        groups.append(
            (rows, frames.SAMPLES, np.concatenate([head, frames.pack_samples(chosen)], axis=1), group_flags)
        )
    return groups


def subset_frames(
    setup: Setup, counts: NDArray[np.integer], first_tick: int
) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Window means (in 1/64 count), minima and maxima of the sampled channels: (row of the window's end,
    payload)."""
    window = setup.subset_window
    whole = len(counts) // window
    bits = [bit for bit in range(8) if setup.mask >> bit & 1]
    means = np.empty((whole, len(bits)), dtype=np.int64)
    extremes = np.empty((whole, 2 * len(bits)), dtype=np.int64)
    ticks = first_tick + np.arange(whole * window, dtype=np.int64).reshape(whole, window)
    for column, bit in enumerate(bits):
        block = counts[: whole * window, bit].reshape(whole, window)
        taken = ticks % setup.dividers[bit] == 0
        number = taken.sum(axis=1)
        means[:, column] = np.rint(_MEAN_PARTS * np.where(taken, block, 0).sum(axis=1) / number)
        extremes[:, 2 * column] = np.where(taken, block, frames.FULL_SCALE).min(axis=1)
        extremes[:, 2 * column + 1] = np.where(taken, block, 0).max(axis=1)
    head = np.zeros((whole, 8), dtype=np.uint8)
    head[:, :4] = frames.integers(ticks[:, 0] if whole else np.empty(0, dtype=np.int64), 4)
    head[:, 4:6] = frames.integers(np.full(whole, window), 2)
    head[:, 6] = setup.mask
    mean_bytes = np.concatenate([frames.integers(means[:, c], 2) for c in range(len(bits))], axis=1)
    return ticks[:, -1] - first_tick, np.concatenate(
        [head, mean_bytes, frames.pack_samples(extremes)], axis=1
    )


def event_payload(tick: int, what: int, mask: int, logged: int) -> NDArray[np.uint8]:
    """Payload of an ``EVENT`` frame, (1, 10): tick 4, what 1, channels that fired 1, samples logged 4."""
    parts = [(tick, 4), (what, 1), (mask, 1), (logged, 4)]
    return np.concatenate([frames.integers(np.array([value]), size) for value, size in parts], axis=1)


def clock_payload(ticks: NDArray[np.int64], utc_ms: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Payload of ``CLOCK`` frames, (frame, 10): tick 4, UTC in ms since 1970 6."""
    return np.concatenate([frames.integers(ticks, 4), frames.integers(utc_ms, 6)], axis=1)


def _assemble(
    pieces: list[tuple[NDArray[np.int64], int, NDArray[np.uint8], NDArray[np.uint8]]], boot: int
) -> bytes:
    """Order frames of all kinds by row, number them and join their bytes."""
    rows = np.concatenate([piece[0] for piece in pieces])
    order = np.argsort(rows, kind="stable")
    sequence = np.empty(rows.size, dtype=np.int64)
    sequence[order] = np.arange(rows.size)
    blocks: list[bytes] = [b""] * rows.size
    start = 0
    for piece_rows, kind, payload, flags in pieces:
        numbers = sequence[start : start + piece_rows.size]
        built = frames.build(2, kind, payload, numbers, boot, flags)
        size = built.shape[1]
        whole = built.tobytes()
        for index, number in enumerate(numbers):
            blocks[number] = whole[index * size : (index + 1) * size]
        start += piece_rows.size
    return b"".join(blocks)


def sample(
    setup: Setup,
    counts: NDArray[np.integer],
    boot: int = 0,
    utc_ms: NDArray[np.integer] | None = None,
    clock_every: int = 1875,
) -> tuple[bytes, bytes]:
    """Run the board over all ticks.

    Parameters
    ----------
    counts : (tick, 8) what the A/D would read on each channel of ``CHANNELS``, sampled or not.
    boot : start counter of the board.
    utc_ms : (tick,) UTC in ms since 1970, sent each ``clock_every`` ticks where the board knows it.

    Returns
    -------
    The local log and the link stream, each with its own sequence numbers.
    """
    counts = np.asarray(counts)
    ticks = np.arange(len(counts), dtype=np.int64)
    masks = _masks(setup, ticks)
    flags = np.zeros(len(counts), dtype=np.uint8)
    none = np.zeros(1, dtype=np.uint8)
    common = [(np.array([-1]), frames.SETUP, setup.payload(), none)]
    if utc_ms is not None:
        at = np.arange(0, len(counts), clock_every)
        payload = clock_payload(at, np.asarray(utc_ms)[at])
        common.append((at, frames.CLOCK, payload, np.zeros(at.size, dtype=np.uint8)))
    kept = masks
    if setup.trigger_channels:
        kept = np.zeros_like(masks)
        fired = sum(1 << CHANNELS.index(name) for name in setup.trigger_channels)
        for first, trigger, last in trigger_windows(setup, counts, masks):
            kept[first : last + 1] = masks[first : last + 1]
            flags[first:trigger] = frames.PRE_ROLL
            flags[trigger : last + 1] = frames.TRIGGERED
            logged = int(np.count_nonzero(masks[first : last + 1]))
            for row, tick, what, number in (
                (first, trigger, TRIGGER_START, 0),
                (last, last, TRIGGER_END, logged),
            ):
                common.append((np.array([row]), frames.EVENT, event_payload(tick, what, fired, number), none))
    local = _assemble(common + sample_frames(setup, counts, ticks, flags, kept), boot)
    ends, payload = subset_frames(setup, counts, 0)
    link = _assemble(common + [(ends, frames.SUBSET, payload, np.zeros(ends.size, dtype=np.uint8))], boot)
    return local, link
