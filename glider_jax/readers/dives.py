"""When a glider was under water and what it did there: surfacings, yo legs, inflections, phases, gaps, sampling.

NumPy only. Conventions a newcomer would get wrong: depth alone does not tell a surfacing from a shallow inflection,
a GPS fix does; the antenna sits at the tail, so fixes go on coming while the depth sensor already reads 4 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Array, Recording

#: m; deeper than this the glider is diving whatever its sensor's offset; shallower than that it may be at the surface.
DEEP, SHALLOW = 5.0, 1.0
#: s; by then a surfaced glider has its first fix.
FIRST_FIX = 120.0
#: s; a shorter excursion below DEEP is not a dive.
SHORTEST_DIVE = 60.0
#: s; longer holes in the depth record are reported as gaps.
LONGEST_HOLE = 600.0
#: m/s; vertical speed assumed where a dive begins or ends between two samples far apart.
TYPICAL_RATE = 0.15
ASCENT, DESCENT, SURFACE = 1, 2, 3


@dataclass(frozen=True)
class Surfacing:
    """A stay at the surface: when it began and ended (NaN where the recording does not say), and its GPS fixes."""

    start: float
    end: float
    time: Array
    latitude: Array
    longitude: Array


@dataclass(frozen=True)
class Leg:
    """One way down or up between two turning points; ``phase`` 2 descent, 1 ascent; ``pitch`` rad, mean, nose up."""

    start_time: float
    end_time: float
    start_depth: float
    end_depth: float
    phase: int
    pitch: float


@dataclass(frozen=True)
class Inflection:
    """A turning point under water: ``kind`` is ``dive_to_climb`` or ``climb_to_dive``."""

    time: float
    depth: float
    kind: str


def fixes(recording: Recording) -> tuple[Array, Array, Array]:
    """Times, latitudes and longitudes of the GPS fixes.

    A product without fixes gives its positions at the surface instead (``fixes_are_positions`` tells).
    """
    names = ("latitude", "longitude") if fixes_are_positions(recording) else ("gps_latitude", "gps_longitude")
    if names[0] not in recording or names[1] not in recording:
        return np.empty(0), np.empty(0), np.empty(0)
    good = np.isfinite(recording[names[0]]) & np.isfinite(recording[names[1]])
    if fixes_are_positions(recording):
        time, depth = finite(recording, "depth")
        if time.size < 2:
            return np.empty(0), np.empty(0), np.empty(0)
        wet = time[depth >= SHALLOW]
        place = np.searchsorted(wet, recording.time, side="right")
        since = recording.time - wet[np.clip(place - 1, 0, None)] if wet.size else np.full(good.size, np.inf)
        # Until the first fix a surfaced glider still reports where it believes to be.
        good &= (np.interp(recording.time, time, depth) < SHALLOW) & ((since >= FIRST_FIX) | (place == 0))
    return recording.time[good], recording[names[0]][good], recording[names[1]][good]


def fixes_are_positions(recording: Recording) -> bool:
    """Whether positions at the surface stand in for GPS fixes that the recording does not have."""
    return "gps_latitude" not in recording or "gps_longitude" not in recording


def underwater(recording: Recording) -> Array:
    """Intervals (dive, 2) under water: when the surface was left and reached again, s.

    A dive is a run of depths beyond 5 m without a GPS fix in it. Its ends are where depth passes 1 m; where no
    sample is that shallow (a sensor with an offset, a sparse recording) they are extrapolated, never past a fix.
    """
    time, depth = finite(recording, "depth")
    fix_time = fixes(recording)[0]
    deep = np.flatnonzero(depth > DEEP)
    if deep.size == 0:
        return np.empty((0, 2))
    between = np.searchsorted(fix_time, time[deep])
    apart = np.flatnonzero((np.diff(between) > 0) | _surfaced(time, depth, deep) | (np.diff(time[deep]) > 6 * 3600.0))
    spans = []
    for rows in np.split(deep, apart + 1):
        slot = int(np.searchsorted(fix_time, time[rows[0]]))
        low = fix_time[slot - 1] if slot else -np.inf
        high = fix_time[slot] if slot < fix_time.size else np.inf
        if spans:
            low = max(low, spans[-1][1])
        begin = _crossing(time, depth, int(rows[0]), -1, low)
        end = _crossing(time, depth, int(rows[-1]), +1, high)
        if end - begin >= SHORTEST_DIVE:
            spans.append((begin, end))
    return np.array(spans).reshape(-1, 2)


def _surfaced(time: Array, depth: Array, deep: Array) -> Array:
    """Between which deep samples the glider stayed above 1 m for more than four minutes, fix or no fix."""
    shallow = np.flatnonzero(depth < SHALLOW)
    first = np.searchsorted(shallow, deep[:-1])
    last = np.searchsorted(shallow, deep[1:]) - 1
    some = (last >= first) & (shallow.size > 0)
    if shallow.size == 0:
        return np.zeros(deep.size - 1, bool)
    stay = time[shallow[np.clip(last, 0, None)]] - time[shallow[np.clip(first, 0, shallow.size - 1)]]
    return some & (stay > 240.0)


def _crossing(time: Array, depth: Array, row: int, way: int, limit: float) -> float:
    """Time at which depth passes 1 m, walking from a deep row forward or backward, not past a fix."""
    here = row
    while 0 <= here + way < time.size and (limit - time[here + way]) * way > 0.0:
        there = here + way
        if depth[there] <= SHALLOW:
            share = (depth[here] - SHALLOW) / max(depth[here] - depth[there], 1e-6)
            moment = time[here] + share * (time[there] - time[here])
            # Over a long hole the glider went at its usual rate, then lay at the surface.
            usual = time[here] + way * (depth[here] - SHALLOW) / TYPICAL_RATE
            hurry = abs(time[there] - time[here]) > 120.0
            return float(min(moment, usual) if way > 0 else max(moment, usual)) if hurry else float(moment)
        here = there
    guess = time[here] + way * max(depth[here] - SHALLOW, 0.0) / TYPICAL_RATE
    return float(min(guess, limit) if way > 0 else max(guess, limit))


def until(recording: Recording, moment: float) -> Recording:
    """What had been recorded by a moment, s: what a forecast made then may look at."""
    rows = recording.time <= moment
    channels = {name: values[rows] for name, values in recording.channels.items()}
    channels = {name: values for name, values in channels.items() if np.isfinite(values).any()}
    starts = recording.segment_start[recording.segment_start <= moment]
    return replace(recording, time=recording.time[rows], channels=channels, segment_start=starts)


def between(recording: Recording, low: float, high: float) -> Recording:
    """The rows from ``low`` to ``high`` s, as views: what is asked of one segment need not look at all the others."""
    rows = slice(*np.searchsorted(recording.time, (low, high)))
    return replace(recording, time=recording.time[rows], channels={k: v[rows] for k, v in recording.channels.items()})


def surfacings(recording: Recording) -> list[Surfacing]:
    """Stays at the surface between dives, with their GPS fixes; before the first dive and after the last too."""
    spans = underwater(recording)
    time, latitude, longitude = fixes(recording)
    starts = [np.nan, *spans[:, 1]]
    ends = [*spans[:, 0], np.nan]
    stays = []
    for start, end in zip(starts, ends, strict=True):
        low = -np.inf if np.isnan(start) else start - 1.0
        high = np.inf if np.isnan(end) else end + 1.0
        mine = (time >= low) & (time <= high)
        stays.append(Surfacing(float(start), float(end), time[mine], latitude[mine], longitude[mine]))
    return stays


def legs(recording: Recording) -> list[Leg]:
    """Ways down and up under water, surface to turning point to turning point to surface, in order."""
    time, depth = finite(recording, "depth")
    pitch_time, pitch = finite(recording, "pitch")
    found = []
    for begin, end in underwater(recording):
        inside = np.flatnonzero((time > begin) & (time < end))
        moments = np.concatenate([[begin], time[inside], [end]])
        depths = np.concatenate([[0.0], depth[inside], [0.0]])
        corners = _corners(depths, float(np.clip(0.15 * depths.max(), 2.0, 10.0)))
        for i, j in zip(corners[:-1], corners[1:], strict=True):
            mine = pitch[(pitch_time >= moments[i]) & (pitch_time <= moments[j])]
            # The middle of the leg: at its ends the vehicle is turning.
            mean = float(np.median(mine)) if mine.size else np.nan
            down = DESCENT if depths[j] > depths[i] else ASCENT
            found.append(Leg(float(moments[i]), float(moments[j]), float(depths[i]), float(depths[j]), down, mean))
    return found


def _corners(depth: Array, threshold: float) -> list[int]:
    """Indices of the turning points of a zigzag that reverses by more than a threshold, with both ends."""
    corners, extreme, down = [0], 0, True
    for i in range(1, depth.size):
        further = depth[i] >= depth[extreme] if down else depth[i] <= depth[extreme]
        if further:
            extreme = i
        elif abs(depth[i] - depth[extreme]) > threshold:
            corners.append(extreme)
            extreme, down = i, not down
    if corners[-1] != extreme and extreme != depth.size - 1:
        corners.append(extreme)
    if corners[-1] != depth.size - 1:
        corners.append(depth.size - 1)
    return corners


def inflections(recording: Recording) -> list[Inflection]:
    """Turning points under water, dive to climb and climb to dive."""
    found = []
    listed = legs(recording)
    for one, two in zip(listed[:-1], listed[1:], strict=True):
        if one.end_time == two.start_time and one.phase != two.phase:
            kind = "dive_to_climb" if one.phase == DESCENT else "climb_to_dive"
            found.append(Inflection(one.end_time, one.end_depth, kind))
    return found


def phase(recording: Recording) -> Array:
    """Phase of each row (row,) int8, with the flags of OG1: 0 unknown, 1 ascent, 2 descent, 3 surface."""
    time = recording.time
    flags = np.zeros(time.size, np.int8)
    known, _ = finite(recording, "depth")
    moments = np.concatenate([known, fixes(recording)[0]])
    if moments.size == 0:
        return flags
    flags[(time >= moments.min() - LONGEST_HOLE) & (time <= moments.max() + LONGEST_HOLE)] = SURFACE
    for leg in legs(recording):
        flags[(time >= leg.start_time) & (time <= leg.end_time)] = leg.phase
    for begin, end in gaps(recording):
        flags[(time > begin) & (time < end)] = 0
    return flags


def gaps(recording: Recording, longest: float = LONGEST_HOLE) -> Array:
    """Intervals (gap, 2) longer than ``longest`` s without any depth or fix: lost files, or the glider switched off."""
    moments = np.unique(np.concatenate([finite(recording, "depth")[0], fixes(recording)[0]]))
    wide = np.flatnonzero(np.diff(moments) > longest)
    return np.stack([moments[wide], moments[wide + 1]], axis=1) if wide.size else np.empty((0, 2))


def sampling(recording: Recording, within: float = 30.0) -> dict[str, float]:
    """Share of the time in each phase in which the CTD was sampled at least every ``within`` seconds."""
    flags = phase(recording)
    rows = np.flatnonzero(flags > 0)
    time, _ = finite(recording, "temperature")
    if time.size < 2 or rows.size == 0:
        return {}
    place = np.clip(np.searchsorted(time, recording.time[rows]), 1, time.size - 1)
    near = np.minimum(np.abs(recording.time[rows] - time[place]), np.abs(recording.time[rows] - time[place - 1]))
    names = {"ascent": ASCENT, "descent": DESCENT, "surface": SURFACE}
    known, _ = finite(recording, "depth")
    clock = np.isin(recording.time[rows], known)
    shares = {}
    for name, flag in names.items():
        mine = (flags[rows] == flag) & clock
        if mine.any():
            shares[name] = float(np.mean(near[mine] <= within))
    return shares
