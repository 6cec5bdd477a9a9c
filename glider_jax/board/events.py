"""Find what the motors did and what it cost: pump strokes, brake, servo bursts and the steady load; NumPy
only.

Two sources: board samples, where each motor has its own channel, and glider recordings, which carry one
current of the
whole vehicle a few seconds apart. There the load of everything else during a stroke is taken from the
cycles just before
and after it, and the brake cannot be told from the pump. Energies are joules from the battery.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glider_jax.errors import DataError
from glider_jax.records import Recording

DIVE_TO_CLIMB, CLIMB_TO_DIVE, AT_SURFACE = "dive_to_climb", "climb_to_dive", "at_surface"
SURFACE_DEPTH = 3.0
_QUIET_CYCLES = 6
_LAG_CYCLES = 3
_LARGEST_STEP = 60.0


@dataclass(frozen=True)
class Event:
    """One thing a motor did.

    Attributes
    ----------
    kind : ``pump``, ``brake_unlock``, ``brake_lock``, ``pitch`` or ``fin``.
    direction : of a pump stroke or its brake, one of the three names above; empty for servos.
    time, duration : s since 1970 at the start, s.
    depth : m at the start of the stroke; NaN unknown.
    volume : m3 moved, positive out; NaN unknown.
    peak : largest current above the load of everything else, A.
    charge, energy : C and J above that load, with ``energy_sd`` their 1-sigma for this event alone.
    voltage : V, mean during the event.
    group : number of the inflection it belongs to, -1 for none.
    complete : False where samples are missing within it; its energy is then too small.
    """

    kind: str
    direction: str
    time: float
    duration: float
    depth: float
    volume: float
    peak: float
    charge: float
    energy: float
    energy_sd: float
    voltage: float
    group: int = -1
    complete: bool = True


@dataclass(frozen=True)
class GliderRecord:
    """The glider's own record as plain arrays, all (row,), one row per vehicle cycle, ascending in time.

    ``time`` s; ``depth`` m; ``voltage`` V; ``current`` A of the whole vehicle, mean or sample of the cycle
    that ends at
    the row; ``charge`` C counter; ``volume`` m3 pumped; ``moving`` whether the pump runs; ``segment``
    number of the file.
    NaN where a channel was not updated; depth, voltage and volume are interpolated over at most a minute.
    """

    time: NDArray[np.float64]
    depth: NDArray[np.float64]
    voltage: NDArray[np.float64]
    current: NDArray[np.float64] | None = None
    charge: NDArray[np.float64] | None = None
    volume: NDArray[np.float64] | None = None
    moving: NDArray[np.bool_] | None = None
    segment: NDArray[np.int64] | None = None
    states: dict[str, NDArray[np.float64]] | None = None
    name: str = "recording"


def interpolate(
    at: NDArray[np.float64], time: NDArray[np.float64], values: NDArray[np.float64], longest: float
) -> NDArray[np.float64]:
    """Linear between finite values; NaN farther than ``longest`` s from the nearest one."""
    known = np.isfinite(values) & np.isfinite(time)
    if not known.any():
        return np.full(at.shape, np.nan)
    out = np.interp(at, time[known], values[known])
    after = np.clip(np.searchsorted(time[known], at), 0, known.sum() - 1)
    before = np.maximum(after - 1, 0)
    far = np.minimum(np.abs(time[known][after] - at), np.abs(at - time[known][before])) > longest
    return np.where(far, np.nan, out)


STATES = ("science_on", "gps_on", "iridium_on", "iridium_connected", "air_pump", "argos_on")


def glider_record(recording: Recording, need_current: bool = True) -> GliderRecord:
    """Take what the event finder needs from a recording; rows are the flight computer's cycles.

    Parameters
    ----------
    recording : of one glider.
    need_current : False beside board samples, where depth and voltage are enough.

    Raises
    ------
    DataError : no current was recorded, or no voltage or depth.
    """
    wanted = ("current", "battery_voltage", "depth")
    for name in wanted if need_current else wanted[1:]:
        if name not in recording or not np.isfinite(recording[name]).any():
            raise DataError(
                f"{recording.name}: channel '{name}': expected values for an energy fit, found none. "
                "Use a recording with m_coulomb_current, m_battery and m_depth."
            )
    has_current = "current" in recording and bool(np.isfinite(recording["current"]).any())
    rows = np.isfinite(recording["current" if has_current else "depth"])
    time = recording.time[rows]

    def channel(name: str, longest: float) -> NDArray[np.float64] | None:
        if name not in recording or not np.isfinite(recording[name]).any():
            return None
        return interpolate(time, recording.time, recording[name], longest)

    def latest(name: str) -> NDArray[np.float64]:
        values = recording[name]
        index = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), 0))
        return values[index][rows]

    moving = None
    if "pump_moving" in recording and np.isfinite(recording["pump_moving"]).any():
        moving = np.nan_to_num(recording["pump_moving"][rows]) > 0.5
    voltage, depth = channel("battery_voltage", 600.0), channel("depth", 60.0)
    assert voltage is not None and depth is not None
    return GliderRecord(
        time=time,
        depth=depth,
        voltage=voltage,
        current=recording["current"][rows] if has_current else None,
        charge=recording["charge_used"][rows] if "charge_used" in recording else None,
        volume=channel("pumped_volume", 60.0),
        moving=moving,
        segment=np.searchsorted(recording.segment_start, time, side="right"),
        states={name: latest(name) for name in STATES if name in recording},
        name=recording.name,
    )


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(run, 2) first index and index after the last of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges.reshape(-1, 2)


def _stroke_runs(record: GliderRecord) -> NDArray[np.int64]:
    """Rows during which the pump ran: its flag, or a changing volume where there is no flag."""
    if record.moving is not None and record.moving.any():
        mask = record.moving
    elif record.volume is not None:
        step = np.abs(np.diff(record.volume, prepend=record.volume[:1]))
        mask = np.nan_to_num(step) > 5e-6
    else:
        raise DataError(
            f"{record.name}: expected a pump flag or a pumped volume to find strokes by, found neither. "
            "Use a recording with m_ballast_pumped or m_de_oil_vol."
        )
    runs = _runs(mask)
    if len(runs) > 1:
        apart = runs[1:, 0] - runs[:-1, 1] > _LAG_CYCLES
        starts = np.concatenate([[0], np.flatnonzero(apart) + 1])
        ends = np.concatenate([np.flatnonzero(apart), [len(runs) - 1]])
        runs = np.stack([runs[starts, 0], runs[ends, 1]], axis=1)
    return runs


def direction_of(volume: float, depth: float, sinking: bool) -> str:
    """Name of a stroke: by the volume moved if known, else by whether the glider was sinking."""
    out = volume > 0 if np.isfinite(volume) else sinking
    if not out:
        return CLIMB_TO_DIVE
    return AT_SURFACE if np.isfinite(depth) and depth < SURFACE_DEPTH else DIVE_TO_CLIMB


def events_from_glider(record: GliderRecord, least_volume: float = 20e-6) -> list[Event]:
    """Pump strokes of a recording that carries the current of the whole vehicle.

    The recorded current trails the pump flag by one or two cycles, so the window runs two cycles past the
    flag. Where the
    recording has a charge counter, its difference is a second estimate whose error (one count at each end) is
    independent of when the current was sampled; the two are averaged by their variances.

    Parameters
    ----------
    record : from :func:`glider_record`.
    least_volume : m3; smaller strokes are trimming, not inflections.

    Raises
    ------
    DataError : no current, or nothing to find strokes by.
    """
    if record.current is None:
        raise DataError(
            f"{record.name}: expected the vehicle's current, found none. Use board samples instead."
        )
    time, current = record.time, record.current
    step = np.diff(time, prepend=time[0])
    segment = record.segment if record.segment is not None else np.zeros(time.size, dtype=np.int64)
    quiet = np.ones(time.size, dtype=bool)
    runs = _stroke_runs(record)
    for begin, end in runs:
        quiet[max(begin - 1, 0) : end + _LAG_CYCLES] = False
    counter = counter_step(record.charge)
    events = []
    for begin, end in runs:
        first, last = begin - 1, end - 1 + _LAG_CYCLES
        if first < 0 or last >= time.size or segment[first] != segment[last]:
            continue
        inside = slice(first + 1, last + 1)
        if step[inside].max() > _LARGEST_STEP or not np.isfinite(record.voltage[inside]).all():
            continue
        around = np.arange(max(first - _QUIET_CYCLES, 0), min(last + 1 + _QUIET_CYCLES, time.size))
        around = around[quiet[around] & (segment[around] == segment[first])]
        before, after = current[around[around < begin]], current[around[around > last]]
        if before.size == 0 or after.size == 0:
            continue
        low, high = np.median(before), np.median(after)
        window, volts = step[inside], record.voltage[inside]
        above = current[inside] - 0.5 * (low + high)
        charge = float((above * window).sum())
        level = float(np.median(above[above > 0.5 * above.max()])) if above.max() > 0 else 0.0
        # A pulse sampled once per cycle is known to a cycle at its ends; other loads may switch anywhere
        # in it.
        cycle = float(np.median(window))
        sd = level * cycle / 12**0.5
        if counter > 0 and record.charge is not None:
            counted = float(record.charge[last] - record.charge[first]) - 0.5 * (low + high) * window.sum()
            sd_counted = counter / 6**0.5
            if np.isfinite(counted):
                share = sd_counted**2 / (sd**2 + sd_counted**2)
                charge = share * charge + (1 - share) * counted
                sd = float((1 / sd**2 + 1 / sd_counted**2) ** -0.5) if sd > 0 else sd
        sd = float(np.hypot(sd, abs(high - low) / 12**0.5 * window.sum()))
        voltage = float(np.average(volts, weights=np.maximum(above, 1e-3)))
        volume = float("nan")
        if record.volume is not None:
            volume = float(record.volume[last] - record.volume[first])
            if abs(volume) < least_volume:
                continue
        depth = float(record.depth[begin])
        sinking = bool(record.depth[begin] > record.depth[max(begin - 5, 0)])
        events.append(
            Event(
                kind="pump",
                direction=direction_of(volume, depth, sinking),
                time=float(time[first]),
                duration=float(window.sum()),
                depth=depth,
                volume=volume,
                peak=float(above.max()),
                charge=charge,
                energy=charge * voltage,
                energy_sd=sd * voltage,
                voltage=voltage,
                group=len(events),
            )
        )
    return events


def counter_step(charge: NDArray[np.float64] | None) -> float:
    """Size of one count of a charge counter, C; 0 where there is none."""
    if charge is None:
        return 0.0
    steps = np.diff(charge[np.isfinite(charge)])
    steps = steps[steps > 1e-6]
    return float(np.percentile(steps, 10)) if steps.size > 10 else 0.0


def counter_ratio(record: GliderRecord) -> tuple[float, float]:
    """Integrated current over the counter's increase, less one, and how far one count may move it.

    Segments are integrated one by one, the current by the trapezium rule, and added.
    """
    if record.charge is None or record.current is None:
        return float("nan"), float("nan")
    segment = record.segment if record.segment is not None else np.zeros(record.time.size, dtype=np.int64)
    integral = counted = 0.0
    number = 0
    for value in np.unique(segment):
        rows = np.flatnonzero((segment == value) & np.isfinite(record.charge))
        if rows.size < 100:
            continue
        step = np.diff(record.time[rows])
        middle = 0.5 * (record.current[rows][1:] + record.current[rows][:-1])
        # Over a longer pause the current of its end says little about the rest.
        usable = step < 3.0 * np.median(step)
        integral += float((middle * step)[usable].sum())
        counted += float(np.diff(record.charge[rows])[usable].sum())
        number += 1
    if counted <= 0:
        return float("nan"), float("nan")
    return integral / counted - 1.0, counter_step(record.charge) * (number / 6) ** 0.5 / counted


def pair_inflections(events: list[Event], within: float = 20.0) -> list[Event]:
    """Give every pump stroke a number and the brake events next to it the same; the brake takes the
    stroke's direction.

    Parameters
    ----------
    within : s; a brake event belongs to a stroke if it ends or begins no further from it.
    """
    pumps = sorted((e for e in events if e.kind == "pump"), key=lambda e: e.time)
    begins = np.array([e.time for e in pumps])
    ends = np.array([e.time + e.duration for e in pumps])
    out = []
    numbers = {id(e): n for n, e in enumerate(pumps)}
    for event in events:
        if event.kind == "pump":
            out.append(replace(event, group=numbers[id(event)]))
        elif event.kind == "brake" and begins.size:
            before = begins - (event.time + event.duration)
            after = event.time - ends
            distance = np.maximum(before, after)
            nearest = int(np.argmin(np.abs(distance)))
            if distance[nearest] > within:
                out.append(event)
                continue
            kind = "brake_unlock" if event.time < begins[nearest] else "brake_lock"
            stroke = pumps[nearest]
            out.append(
                replace(
                    event,
                    kind=kind,
                    direction=stroke.direction,
                    group=nearest,
                    depth=stroke.depth,
                    volume=stroke.volume,
                )
            )
        else:
            out.append(event)
    return sorted(out, key=lambda e: e.time)
