"""The load while no motor runs: its levels by phase and by which devices are on; NumPy only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.events import _LAG_CYCLES, Event, GliderRecord, _stroke_runs
from glider_jax.errors import DataError

AT_SURFACE_DEPTH = 1.5
BLOCK = 300.0


@dataclass(frozen=True)
class Level:
    """Steady load in one phase and one state of the devices.

    ``phase`` is ``dive``, ``climb``, ``surface`` or ``submerged`` (dive and climb together); ``state``
    names the flags that
    were on, empty for all states. ``mean``, ``mean_sd``, ``median``, ``floor`` (5th percentile) W;
    ``seconds`` observed.
    """

    phase: str
    state: str
    mean: float
    mean_sd: float
    median: float
    floor: float
    seconds: float


def phases(time: NDArray[np.float64], depth: NDArray[np.float64]) -> NDArray[np.str_]:
    """Phase of each row: ``surface``, ``dive``, ``climb``; empty where the depth is unknown."""
    rate = np.zeros(time.size)
    if time.size > 2:
        ahead, behind = (
            np.minimum(np.arange(time.size) + 2, time.size - 1),
            np.maximum(np.arange(time.size) - 2, 0),
        )
        rate = (depth[ahead] - depth[behind]) / np.maximum(time[ahead] - time[behind], 1e-3)
    out = np.where(rate > 0, "dive", "climb")
    out = np.where(depth < AT_SURFACE_DEPTH, "surface", out)
    return np.where(np.isfinite(depth) & np.isfinite(rate), out, "")


def mean_of_blocks(
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    weight: NDArray[np.float64],
    segment: NDArray[np.int64],
) -> tuple[float, float]:
    """Weighted mean and its 1-sigma from the scatter of blocks of five minutes, and of whole segments
    where larger.

    A load holds its level for minutes, so that single cycles are far from independent; they are never better than that.
    """
    mean = float(np.average(values, weights=weight))
    share = weight / weight.sum()
    sds = [float(np.sqrt((share**2).sum() * (share * (values - mean) ** 2).sum()))]
    for label in (np.floor(time / BLOCK).astype(np.int64), segment):
        _, block = np.unique(label, return_inverse=True)
        total = np.bincount(block, weights=weight)
        level = np.bincount(block, weights=weight * values) / total
        if level.size > 1:
            share = total / total.sum()
            effective = 1.0 / (share**2).sum()
            variance = float((share * (level - mean) ** 2).sum()) / max(effective - 1.0, 0.5)
            sds.append(variance**0.5)
    return mean, max(*sds, 1e-6)


def state_names(record: GliderRecord, time: NDArray[np.float64]) -> NDArray[np.object_]:
    """Which devices were on at some times, their names joined by ``+``; a device that never changed is left out."""
    states = np.full(time.size, "", dtype=object)
    row = np.clip(np.searchsorted(record.time, time, side="right") - 1, 0, record.time.size - 1)
    for name, values in (record.states or {}).items():
        on = np.nan_to_num(values) > 0.5
        if on.any() and not on.all():
            states[on[row]] = [f"{label}+{name}" if label else name for label in states[on[row]]]
    return states


def _level(
    phase: str,
    state: str,
    record: GliderRecord,
    power: NDArray[np.float64],
    step: NDArray[np.float64],
    rows: NDArray[np.bool_],
) -> Level:
    segment = record.segment if record.segment is not None else np.zeros(record.time.size, dtype=np.int64)
    mean, sd = mean_of_blocks(record.time[rows], power[rows], step[rows], segment[rows])
    return Level(
        phase,
        state,
        mean,
        sd,
        float(np.median(power[rows])),
        float(np.percentile(power[rows], 5)),
        float(step[rows].sum()),
    )


def _settled(labels: NDArray[Any]) -> NDArray[np.bool_]:
    """Rows whose label has held for as many cycles as the recorded current may trail."""
    out = np.ones(labels.size, dtype=bool)
    for lag in range(1, _LAG_CYCLES):
        out[lag:] &= labels[lag:] == labels[:-lag]
    return out


def steady_levels(
    record: GliderRecord, least_seconds: float = 60.0, motors: Sequence[Event] = ()
) -> list[Level]:
    """Levels of the whole vehicle's load in cycles during which, and about which, the pump rests.

    Parameters
    ----------
    record : with a current of the whole vehicle.
    least_seconds : states seen for less are left out.
    motors : events of a board on the same vehicle; cycles in which any motor ran are then left out as well.

    Raises
    ------
    DataError : there is no current, or no quiet cycle.
    """
    if record.current is None:
        raise DataError(
            f"{record.name}: expected the vehicle's current, found none. Use the board's main channel."
        )
    quiet = np.isfinite(record.voltage) & np.isfinite(record.current)
    if record.moving is not None or record.volume is not None:
        for begin, end in _stroke_runs(record):
            quiet[max(begin - 1, 0) : end + _LAG_CYCLES] = False
    for event in motors:
        # A row carries the mean of the cycle that ends at it, and trails by some cycles.
        begin, end = np.searchsorted(record.time, [event.time, event.time + event.duration])
        quiet[begin : end + _LAG_CYCLES] = False
    step = np.diff(record.time, prepend=record.time[0])
    quiet &= (step > 0) & (step < 3.0 * np.median(step))
    phase = phases(record.time, record.depth)
    if not (quiet & (phase != "")).any():
        raise DataError(
            f"{record.name}: expected cycles without a motor to measure the steady load, found none."
        )
    power = record.current * record.voltage
    states = state_names(record, record.time)
    below = _settled(np.where(phase == "surface", "surface", "submerged"))
    settled = _settled(phase)
    out = []
    for chosen, rows in [
        ("submerged", quiet & below & ((phase == "dive") | (phase == "climb"))),
        *((name, quiet & settled & (phase == name)) for name in ("dive", "climb", "surface")),
    ]:
        if step[rows].sum() >= least_seconds:
            out.append(_level(chosen, "", record, power, step, rows))
        if chosen == "submerged":
            continue
        for state in sorted(set(states[rows])):
            some = rows & (states == state) & _settled(states)
            if state and step[some].sum() >= least_seconds:
                out.append(_level(chosen, state, record, power, step, some))
    return out
