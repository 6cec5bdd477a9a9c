"""Windows of a recording in which energy, voltage, turning depths and drift are measured.

NumPy only. A newcomer would get wrong: a recorded current is the mean since the row before, so a window's energy
leaves out its first row; a pump stroke's window holds hotel load too, which the replay adds back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glider_jax.inference.controls import Rows, at
from glider_jax.readers.dead_reckoning import finite, metres
from glider_jax.readers.dives import DESCENT, Leg, Surfacing
from glider_jax.records import Array, Recording

#: s; longer rows are holes and end a window.
LONGEST_ROW = 30.0
#: Rows with a current, near enough to the one before, below which no power is summed.
FEWEST_ROWS = 50
#: A row that lasts this many times longer than usual follows one that was lost.
LOST_ROW = 1.6
#: Blocks per segment and phase into which quiet power is averaged.
BLOCKS = 3


class Power(NamedTuple):
    """Electrical rows: time, step s, energy since the row before J, current A, voltage V, pump runs or just ran.

    ``fresh`` marks rows in which the voltage itself was measured; it is interpolated in the others.
    """

    time: Array
    step: Array
    energy: Array
    current: Array
    voltage: Array
    busy: Array
    fresh: Array


class Window(NamedTuple):
    """Sums over one window: energy J and seconds, mean voltage and current, middle time."""

    energy: float
    seconds: float
    voltage: float
    current: float
    time: float
    rows: int


def why_no_power(recording: Recording) -> str:
    """Why power cannot be summed over rows; empty where it can."""
    time, _ = finite(recording, "current")
    if time.size < FEWEST_ROWS:
        return "no battery current"
    near = np.diff(time) <= LONGEST_ROW
    if near.sum() < FEWEST_ROWS:
        every = float(np.median(np.diff(time)))
        return f"the battery current is there every {every:.0f} s, sums need a row every {LONGEST_ROW:.0f} s"
    return ""


def power_rows(recording: Recording) -> Power | None:
    """Rows with a current; None where :func:`why_no_power` says so."""
    if why_no_power(recording):
        return None
    time, current = finite(recording, "current")
    moments, volts = finite(recording, "battery_voltage_instant")
    if moments.size < 100:
        # A filtered voltage hides the sag of short pulses, so the instantaneous one comes first.
        moments, volts = finite(recording, "battery_voltage")
    voltage = np.interp(time, moments, volts) if moments.size > 2 else np.full(time.size, 14.0)
    near = np.clip(np.searchsorted(moments, time), 1, max(moments.size - 1, 1))
    fresh = np.zeros(time.size, bool)
    if moments.size > 2:
        fresh = np.minimum(np.abs(moments[near] - time), np.abs(moments[near - 1] - time)) < 1.5
    step = np.diff(time, prepend=time[0] - np.median(np.diff(time)))
    step = np.where(step > LONGEST_ROW, np.nan, step)
    usual = float(np.nanmedian(step))
    move_time, moving = finite(recording, "pump_moving")
    vol_time, volume = finite(recording, "pumped_volume")
    if move_time.size > 0.3 * time.size and moving.max() > 0:
        busy = np.interp(time, move_time, moving) > 0.0
    elif vol_time.size > 10:
        moved = np.interp(time, vol_time, volume)
        reach = moved.max() - moved.min()
        busy = np.abs(np.diff(moved, prepend=moved[0])) > max(0.02 * reach, 3e-6)
    else:
        busy = np.zeros(time.size, bool)
    # The stroke begins and ends between rows, and its brake acts before the flag is up.
    wide = busy.copy()
    for shift in range(1, max(1, int(np.ceil(16.0 / usual))) + 1):
        wide[:-shift] |= busy[shift:]
        wide[shift:] |= busy[:-shift]
    return Power(time, step, current * voltage * step, current, voltage, wide, fresh)


def total(power: Power, rows: Array) -> Window | None:
    """Sums over rows; None where a hole or too little is in them."""
    if rows.size == 0:
        return None
    seconds = float(power.step[rows].sum())
    if not np.isfinite(seconds):
        return None
    return Window(
        float(power.energy[rows].sum()),
        seconds,
        float(power.voltage[rows].mean()),
        float(power.current[rows].mean()),
        float(0.5 * (power.time[rows[0]] + power.time[rows[-1]])),
        int(rows.size),
    )


class Stroke(NamedTuple):
    """One pump stroke: window, whether out (dive to climb), depth m, volume moved m3, leg that follows, K.

    ``whole`` is False where rows are missing in the window: a mean current is then taken for too long.
    """

    window: Window
    out: bool
    depth: float
    volume: float
    leg: int
    temperature: float
    whole: bool = True


def strokes(power: Power, rows: Rows, ways: list[Leg], recording: Recording) -> list[Stroke]:
    """Pump strokes at turns under water, each with the window of rows that it fills."""
    if not power.busy.any():
        return []
    edges = np.flatnonzero(np.diff(power.busy.astype(int), prepend=0, append=0))
    first, last = edges[::2], edges[1::2] - 1
    begin, end = power.time[first], power.time[last]
    moments, volume = finite(recording, "pumped_volume")
    usual = float(np.nanmedian(power.step))
    found = []
    for number in range(1, len(ways)):
        one, two = ways[number - 1], ways[number]
        if one.end_time != two.start_time or one.phase == two.phase:
            continue
        out = one.phase == DESCENT
        near = np.flatnonzero((end > two.start_time - 90.0) & (begin < two.start_time + 60.0))
        if near.size != 1:
            continue
        mine = np.arange(first[near[0]], last[near[0]] + 1)
        window = total(power, mine)
        if window is None:
            continue
        moved = 460e-6
        if moments.size > 10:
            ends = np.interp([begin[near[0]] - 10.0, end[near[0]] + 5.0], moments, volume)
            moved = float(abs(ends[1] - ends[0]))
            if moved < 30e-6:
                continue
        depth = float(one.end_depth)
        warm = float(np.interp(two.start_time, rows.time, rows.temperature))
        whole = float(power.step[mine].max()) < LOST_ROW * usual
        found.append(Stroke(window, out, depth, moved, number, warm, whole))
    return found


class Sorted(NamedTuple):
    """Strokes like the others of their way; those of the usual window and volume, and without a lost row, whose energy
    is not, J beyond."""

    alike: list[Stroke]
    odd: list[tuple[Stroke, float]]


def sort_strokes(listed: list[Stroke]) -> Sorted:
    """Part strokes of one way by window, volume and energy: a row lost in a window is no physics."""
    if len(listed) < 6:
        return Sorted(listed, [])
    seconds = np.array([s.window.seconds for s in listed])
    volume = np.array([s.volume for s in listed])
    energy = np.array([s.window.energy for s in listed])
    depth = np.array([s.depth for s in listed])
    good = np.abs(seconds / np.median(seconds) - 1.0) < 0.35
    good &= np.abs(volume / np.median(volume) - 1.0) < 0.3
    whole, left = good & np.array([s.whole for s in listed]), np.zeros(energy.size)
    for _ in range(3):
        if good.sum() < 6:
            return Sorted(listed, [])
        line = np.polyfit(depth[good], energy[good], 1) if np.ptp(depth[good]) > 1.0 else [0.0, np.median(energy[good])]
        left = energy - np.polyval(line, depth)
        scatter = 1.4826 * np.median(np.abs(left[good] - np.median(left[good])))
        good &= np.abs(left - np.median(left[good])) < 6.0 * max(scatter, 2.0)
    alike = [s for s, keep in zip(listed, good, strict=True) if keep]
    return Sorted(alike, [(listed[k], float(left[k])) for k in np.flatnonzero(whole & ~good)])


class Load(NamedTuple):
    """Quiet power of a phase: window, direction, segment, mean depth and height above the bottom, temperatures."""

    window: Window
    direction: float
    segment: int
    depth: float


def quiet_loads(power: Power, rows: Rows, spans: Array) -> list[Load]:
    """Windows without a stroke: per segment and phase, in ``BLOCKS`` parts of each segment.

    ``spans`` (segment, 2) are the times under water.
    """
    place = np.clip(np.searchsorted(rows.time, power.time), 0, rows.time.size - 1)
    direction, depth = rows.direction[place], rows.depth[place]
    quiet = ~power.busy & np.isfinite(power.step)
    found = []
    for number, (begin, end) in enumerate(spans):
        edges = np.linspace(begin + 90.0, end - 60.0, BLOCKS + 1)
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            inside = quiet & (power.time > low) & (power.time <= high)
            for way in (-1.0, 1.0):
                mine = np.flatnonzero(inside & (direction == way))
                window = total(power, mine) if mine.size >= 5 else None
                if window is not None:
                    found.append(Load(window, way, number, float(depth[mine].mean())))
    return found


def surface_loads(power: Power, stays: list[Surfacing]) -> list[tuple[int, Window, float]]:
    """Stays at the surface with both ends known: number, window without its edges, length of the stay s."""
    found = []
    for number, stay in enumerate(stays):
        if not (np.isfinite(stay.start) and np.isfinite(stay.end)) or stay.end - stay.start < 120.0:
            continue
        mine = np.flatnonzero((power.time > stay.start + 45.0) & (power.time < stay.end - 30.0) & ~power.busy)
        window = total(power, mine) if mine.size >= 5 else None
        if window is not None:
            found.append((number, window, float(stay.end - stay.start)))
    return found


def usual_rate(depth: Array, direction: Array, rate: Array) -> Array:
    """Depth rate that is usual at each depth and direction, m/s, positive down: medians in depth, joined by lines."""
    usual = rate.copy()
    for way in np.unique(direction):
        mine = np.flatnonzero(direction == way)
        count = min(12, mine.size // 8)
        if count < 2:
            usual[mine] = np.median(rate[mine])
            continue
        parts = np.array_split(mine[np.argsort(depth[mine], kind="stable")], count)
        middle = [np.median(depth[part]) for part in parts]
        usual[mine] = np.interp(depth[mine], middle, [np.median(rate[part]) for part in parts])
    return usual


def drift_weights(stay: Surfacing, origin: tuple[float, float]) -> tuple[float, float, float] | None:
    """Drift east and north in m/s over a stay's fixes, and the seconds they span; None with too few fixes.

    The median over pairs of fixes: one wrong fix does not turn it.
    """
    if stay.time.size < 4 or stay.time[-1] - stay.time[0] < 150.0:
        return None
    east, north = metres(stay.latitude, stay.longitude, origin)
    span = float(stay.time[-1] - stay.time[0])
    i, j = np.triu_indices(stay.time.size, 1)
    far = stay.time[j] - stay.time[i] > 0.4 * span
    i, j = i[far], j[far]
    lapse = stay.time[j] - stay.time[i]
    drift = np.median((east[j] - east[i]) / lapse), np.median((north[j] - north[i]) / lapse)
    return (float(drift[0]), float(drift[1]), span) if np.hypot(*drift) < 2.5 else None


def surface_depths(recording: Recording, stays: list[Surfacing]) -> list[tuple[int, float, float]]:
    """Median recorded depth in m while certainly at the surface: number of the stay, time, depth."""
    time, depth = finite(recording, "depth")
    found = []
    for number, stay in enumerate(stays):
        if stay.time.size < 4:
            continue
        mine = depth[(time > stay.time[1]) & (time < stay.time[-2])]
        if mine.size >= 5:
            found.append((number, float(stay.time.mean()), float(np.median(mine))))
    return found


def charge_ratios(recording: Recording, spans: Array) -> list[tuple[int, float, float, float]]:
    """Counted over integrated charge per segment: number, time, logarithm of the ratio, coulombs."""
    time, current = finite(recording, "current")
    when, charge = finite(recording, "charge_used")
    if time.size < 50 or when.size < 50:
        return []
    step = np.diff(time, prepend=time[0])
    integral = np.concatenate([[0.0], np.cumsum(current[1:] * step[1:])])
    found = []
    for number, (begin, end) in enumerate(spans):
        inside = (time >= begin) & (time <= end)
        if inside.sum() < 20 or step[inside][1:].max() > 60.0:
            continue
        low, high = time[inside][0], time[inside][-1]
        counted = float(np.diff(np.interp([low, high], when, charge))[0])
        summed = float(np.diff(np.interp([low, high], time, integral))[0])
        if counted > 0.0 and summed > 20.0:
            found.append((number, 0.5 * (low + high), float(np.log(counted / summed)), summed))
    return found


__all__ = ["Load", "Power", "Stroke", "Window", "at"]
