"""When a motor runs, told from the recording's own noise; NumPy only.

A current counts as running where the mean over a fraction of a second departs from the channel's level at rest by six
times the scatter that the same mean has while the motor rests. Level and scatter are taken from the recording, minute
by minute and piece by piece, so that a quiet board finds weak strokes and a noisy one raises no false alarms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration
from glider_jax.board.frames import PRE_ROLL, TRIGGERED
from glider_jax.board.record import BoardRecord

SIGMAS = 6.0
# Without noise a zero between two codes flips by one count as it drifts.
LEAST_COUNTS = 1.5
_MINUTE = 60.0
_MINUTES = 11
_BLOCK = 0.5
_PIECE = 1 << 18
_FEW = 64
_PAUSE = 10.0


@dataclass(frozen=True)
class Running:
    """Times at which a motor ran, all (run,).

    ``epoch``; ``first`` and ``last`` tick with a current, found at half of its height; ``threshold`` A that it passed.
    """

    epoch: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    threshold: NDArray[np.float64]

    def __len__(self) -> int:
        return self.epoch.size

    def covers(self, record: BoardRecord, margin: float) -> NDArray[np.bool_]:
        """(row,) whether a row lies in a run or within ``margin`` s of one."""
        out = np.zeros(len(record.tick), dtype=bool)
        more = int(np.ceil(margin / record.period))
        for epoch, first, last in zip(self.epoch, self.first, self.last, strict=True):
            out[record.rows_between(int(epoch), int(first) - more, int(last) + more)] = True
        return out


def rest_level(
    record: BoardRecord, channel: str, zero: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Level of a channel at rest, as knots: rows (knot,) and counts (knot,).

    A log that records only around triggers is at rest before each of them. Elsewhere the level at which the channel
    stays most is taken, over eleven minutes about each minute; a motor that runs for a third of them does not shift it.

    Parameters
    ----------
    record : rows of one rate.
    zero : counts, used where the record has no row at rest.
    """
    counts = record.counts[:, record.column(channel)]
    if bool(((record.flags & (TRIGGERED | PRE_ROLL)) != 0).any()):
        return _level_before_triggers(record, counts, zero)
    block = max(int(round(_BLOCK / record.spacing)), 1)
    whole = counts.size // block
    if whole < 2:
        return np.zeros(1), np.array([float(np.median(counts))])
    means = np.concatenate(
        [
            counts[begin * block : min(begin + 4096, whole) * block].reshape(-1, block).mean(axis=1)
            for begin in range(0, whole, 4096)
        ]
    )
    step = max(int(round(_MINUTE / (block * record.spacing))), 1)
    reach = _MINUTES * step // 2
    middles = np.arange(min(step // 2, whole // 2), whole, step)
    levels = np.empty(middles.size)
    inside = (middles >= reach) & (middles + reach < whole)
    for index in np.flatnonzero(~inside):
        part = means[max(middles[index] - reach, 0) : middles[index] + reach + 1]
        levels[index] = densest_half(part[None])[0][0]
    if inside.any():
        views = np.lib.stride_tricks.sliding_window_view(means, 2 * reach + 1)
        for rows in np.array_split(np.flatnonzero(inside), max(int(inside.sum()) // 256, 1)):
            levels[rows] = densest_half(views[middles[rows] - reach])[0]
    return (middles + 0.5) * block - 0.5, levels


def _level_before_triggers(
    record: BoardRecord, counts: NDArray[np.integer], zero: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    before = np.flatnonzero(record.flags & PRE_ROLL)
    cuts = np.flatnonzero(np.diff(before) > 1) + 1
    groups = [group for group in np.split(before, cuts) if group.size >= 2]
    if not groups:
        return np.zeros(1), np.array([zero])
    # The last rows before a trigger may hold the start of what pulled it.
    levels = [float(np.mean(counts[group[: max(group.size - 2, 2)]])) for group in groups]
    return np.array([float(group[-1]) for group in groups]), np.array(levels)


def densest_half(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and width of the shortest interval that holds half of the values, along the last axis."""
    ordered = np.sort(values, axis=-1)
    half = ordered.shape[-1] // 2 + 1
    width = ordered[..., half - 1 :] - ordered[..., : ordered.shape[-1] - half + 1]
    # Values in whole counts tie; the middle of the ties is the middle of the level.
    ties = width <= width.min(axis=-1, keepdims=True)
    first = ties.argmax(axis=-1)
    last = ties.shape[-1] - 1 - ties[..., ::-1].argmax(axis=-1)
    total = np.concatenate([np.zeros((*ordered.shape[:-1], 1)), np.cumsum(ordered, axis=-1)], axis=-1)
    end = np.take_along_axis(total, (last + half)[..., None], -1)[..., 0]
    begin = np.take_along_axis(total, first[..., None], -1)[..., 0]
    return (end - begin) / (last + half - first), width.min(axis=-1)


# Half of a normal distribution lies within this many sigma of its middle.
_HALF = 0.6745


def _noise(smooth: NDArray[np.float64]) -> float:
    """Scatter of a mean while the motor rests: from the densest half, then from all that is near it."""
    middle, width = densest_half(smooth[None])
    level, scale = float(middle[0]), float(width[0]) / (2.0 * _HALF)
    for _ in range(5):
        inside = smooth[np.abs(smooth - level) <= 4.0 * max(scale, 1e-12)]
        if inside.size < _FEW:
            break
        level, scale = float(inside.mean()), float(inside.std())
    return scale


def find_running(
    record: BoardRecord,
    channels: tuple[str, ...],
    calibration: Calibration,
    smooth: float,
    join: float,
    least: float,
) -> Running:
    """Find when a motor runs.

    Parameters
    ----------
    record : rows in which all of ``channels`` were sampled, of one rate.
    channels : of the motor; their currents are added.
    smooth : s over which the current is averaged to tell a run from noise.
    join, least : s; runs closer than ``join`` are one, shorter ones than ``least`` are spikes.
    """
    count = len(record.tick)
    width = max(int(round(smooth / record.spacing)), 1)
    if count < 2:
        return _runs_to_ticks(record, [], join, least)
    knots = {name: rest_level(record, name, calibration[name].zero) for name in channels}
    scales = {name: calibration[name].amperes_per_count for name in channels}
    floor = LEAST_COUNTS * float(np.hypot.reduce(np.array(list(scales.values()))))
    fallback = float(np.hypot.reduce(np.array([calibration[name].noise for name in channels]))) / width**0.5
    pieces = max(-(-count // _PIECE), 1)
    edges = np.linspace(0, count, pieces + 1).astype(np.int64)
    found: list[tuple[int, int, float]] = []
    kernel = np.full(width, 1.0 / width)
    for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        low, high = max(begin - 4 * width, 0), min(end + 4 * width, count)
        at = np.arange(low, high, dtype=np.float64)
        total = np.zeros(high - low)
        for name in channels:
            level = np.interp(at, *knots[name])
            total += (record.counts[low:high, record.column(name)] - level) * scales[name]
        mean = np.convolve(total, kernel, mode="same") if total.size >= width else total
        flags = record.flags[low:high]
        rest = (flags & PRE_ROLL).astype(bool)
        if not ((flags & (TRIGGERED | PRE_ROLL)) != 0).any():
            rest = np.ones(high - low, dtype=bool)
        noise = _noise(mean[rest]) if rest.sum() >= _FEW else fallback
        threshold = max(SIGMAS * noise, floor)
        found += _edges(total, mean, threshold, width, low, begin, end)
    return _runs_to_ticks(record, found, join, least)


def _edges(
    total: NDArray[np.float64],
    mean: NDArray[np.float64],
    threshold: float,
    width: int,
    low: int,
    begin: int,
    end: int,
) -> list[tuple[int, int, float]]:
    """Runs of a piece that touch rows ``begin`` to ``end``, their ends moved to half of the run's own height."""
    out = []
    for sign in (1.0, -1.0):
        # A run goes on until its mean falls to half of what it had to pass.
        mask = np.concatenate([[0], (sign * mean > 0.5 * threshold).astype(np.int8), [0]])
        runs = np.flatnonzero(np.diff(mask)).reshape(-1, 2)
        passed = np.concatenate([[0], np.cumsum(sign * mean > threshold)])
        for first, last in runs[passed[runs[:, 1]] > passed[runs[:, 0]]].tolist():
            first, last = max(first - width // 2, 0), min(last + width // 2, total.size)
            if last + low <= begin or first + low >= end:
                continue
            part = sign * total[first:last]
            # The median of three passes no single spike.
            calm = (
                np.median(np.stack([np.roll(part, 1), part, np.roll(part, -1)]), axis=0)
                if part.size > 2
                else part
            )
            high = calm[calm > threshold]
            if high.size == 0:
                high = np.array([float(mean[first:last].max() if sign > 0 else -mean[first:last].min())])
            on = np.flatnonzero(calm > 0.5 * float(np.median(high)))
            if on.size and float(calm[on[0] : on[-1] + 1].mean()) > threshold:
                out.append((low + first + int(on[0]), low + first + int(on[-1]), threshold))
    return out


def _runs_to_ticks(
    record: BoardRecord, found: list[tuple[int, int, float]], join: float, least: float
) -> Running:
    """Join runs of the same start of the board that are close, and drop spikes."""
    joined: list[list[float]] = []
    for first, last, threshold in sorted(_without_pauses(record, found, join)):
        epoch, begin, end = int(record.epoch[first]), int(record.tick[first]), int(record.tick[last])
        before = joined[-1] if joined else None
        if before is not None and before[0] == epoch and (begin - before[2]) * record.period <= join:
            before[2] = max(before[2], end)
            continue
        joined.append([epoch, begin, end, threshold])
    kept = [run for run in joined if (run[2] - run[1] + record.stride) * record.period >= least]
    table = np.array(kept, dtype=np.float64).reshape(-1, 4)
    whole = table[:, :3].astype(np.int64)
    return Running(whole[:, 0], whole[:, 1], whole[:, 2], table[:, 3])


def _without_pauses(
    record: BoardRecord, found: list[tuple[int, int, float]], join: float
) -> list[tuple[int, int, float]]:
    """Cut runs of rows where the log paused, or the board started anew; a shorter loss within a run leaves it one."""
    out = []
    for first, last, threshold in found:
        rows = slice(first, last + 1)
        pause = np.diff(record.tick[rows]) * record.period > max(join, _PAUSE)
        cuts = first + 1 + np.flatnonzero(pause | (np.diff(record.epoch[rows]) != 0))
        starts, ends = [first, *cuts.tolist()], [*(cuts - 1).tolist(), last]
        out += [(start, end, threshold) for start, end in zip(starts, ends, strict=True)]
    return out


def merge_runs(parts: list[Running], period: float, join: float) -> Running:
    """One list of runs from channels that were searched one by one; overlapping and close ones are one."""
    rows = sorted(
        (int(e), int(f), int(g), float(t))
        for p in parts
        for e, f, g, t in zip(p.epoch, p.first, p.last, p.threshold, strict=True)
    )
    out: list[list[float]] = []
    for epoch, first, last, threshold in rows:
        if out and out[-1][0] == epoch and (first - out[-1][2]) * period <= join:
            out[-1][2] = max(out[-1][2], last)
        else:
            out.append([epoch, first, last, threshold])
    table = np.array(out, dtype=np.float64).reshape(-1, 4)
    whole = table[:, :3].astype(np.int64)
    return Running(whole[:, 0], whole[:, 1], whole[:, 2], table[:, 3])
