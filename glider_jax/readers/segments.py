"""Dive segments of a recording: fix, dive, surface, fix, with displacements, currents, pitch and charge.

NumPy only. A dive segment runs from the last GPS fix before a dive to the first fix after it, as dead reckoning and
its comparison need it. Conventions a newcomer would get wrong: the glider's own current estimate for a segment is
logged at the start of the next one; the time between surfacing and the first fix is spent drifting, so the
displacement of the fixes holds surface drift too. What ``dives`` finds (legs, phases, surfacings) is offered here too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.readers.dead_reckoning import (
    SHALLOWEST_PITCH,
    Path,
    Variation,
    adds_water,
    finite,
    magnetic_variation,
    metres,
    steady_angle_of_attack,
    through_water,
    to_true,
)
from glider_jax.readers.dives import ASCENT, DESCENT, LONGEST_HOLE, Leg, between, fixes, legs, underwater
from glider_jax.readers.dives import Inflection as Inflection
from glider_jax.readers.dives import Surfacing as Surfacing
from glider_jax.readers.dives import gaps as gaps
from glider_jax.readers.dives import inflections as inflections
from glider_jax.readers.dives import phase as phase
from glider_jax.readers.dives import sampling as sampling
from glider_jax.readers.dives import surfacings as surfacings
from glider_jax.readers.dives import until as until
from glider_jax.records import Array, Recording

#: m/s; a surfaced glider does not drift faster.
FASTEST_DRIFT = 2.5


@dataclass(frozen=True)
class Segment:
    """From the last fix before a dive to the first fix after it; times s, positions degrees, SI otherwise.

    Attributes
    ----------
    start_time, start_latitude, start_longitude : last fix before the dive.
    dive_time, surface_time : when it left the surface and when it came back.
    end_time, end_latitude, end_longitude : first fix after surfacing.
    maximum_depth, inflections, dive_pitch, climb_pitch : m, count under water, mean pitches in rad.
    east, north : m between the two fixes.
    water_east, water_north : m through the water between ``dive_time`` and ``surface_time`` by dead reckoning;
        ``dead_reckoning`` says whose: ``own``, ``recorded`` or ``none``. ``heading`` rad true, its direction;
        ``path_length`` m along the way, turns included, from depths and pitches where headings are too sparse.
    glider_current_east, glider_current_north : m/s, the glider's own depth average over this segment, turned to
        true; ``glider_current_from`` says which of its values (``final``, ``in use``, ``initial``, ``product``).
    current_east, current_north : m/s, own depth average: positions where it dived and surfaced less dead reckoning.
    drift_east, drift_north : m/s, surface drift before the dive from its fixes, NaN with fewer than three.
    charge_used : C between the two fixes.
    longest_hole : s without a depth while under water; ``gap`` is True where that exceeds ten minutes.
    dives : how often it went under between the fixes; more than one means a surfacing without a fix.
    variation : how the heading was made true.
    """

    start_time: float
    start_latitude: float
    start_longitude: float
    dive_time: float
    surface_time: float
    end_time: float
    end_latitude: float
    end_longitude: float
    maximum_depth: float
    inflections: int
    dive_pitch: float
    climb_pitch: float
    east: float
    north: float
    water_east: float
    water_north: float
    dead_reckoning: str
    heading: float
    path_length: float
    glider_current_east: float
    glider_current_north: float
    glider_current_from: str
    current_east: float
    current_north: float
    drift_east: float
    drift_north: float
    charge_used: float
    longest_hole: float
    gap: bool
    dives: int
    variation: Variation

    @property
    def duration(self) -> float:
        """Seconds under water."""
        return self.surface_time - self.dive_time

    @property
    def distance(self) -> float:
        """Metres over the ground between the fixes."""
        return float(np.hypot(self.east, self.north))

    @property
    def distance_through_water(self) -> float:
        """Metres through the water by dead reckoning; NaN where there is none."""
        return float(np.hypot(self.water_east, self.water_north))


def dive_segments(
    recording: Recording, *, variation: float | None = None, angle_of_attack: float | None = None
) -> list[Segment]:
    """Dive segments of a recording, in order; dives without a fix on either side are not among them.

    Parameters
    ----------
    recording : of any kind ``read_recording`` gives.
    variation : magnetic variation in rad (magnetic = true + variation, west positive); recorded or estimated else.
    angle_of_attack : rad, magnitude, by which the path is steeper than the hull; None takes the firmware's own where
        recorded, else that of a steady glide.
    """
    spans = underwater(recording)
    time, latitude, longitude = fixes(recording)
    if time.size < 2 or spans.shape[0] == 0:
        return []
    turn = magnetic_variation(recording, variation)
    ways = legs(recording)
    added = adds_water(recording)
    after = np.searchsorted(time, spans[:, 1] - 1e-6)
    found = []
    for slot in np.unique(after):
        mine = spans[after == slot]
        if slot == 0 or slot == time.size:
            continue
        begin, end = float(mine[0, 0]), float(mine[-1, 1])
        before = int(np.searchsorted(time, begin + 1e-6)) - 1
        if before < 0:
            continue
        following, earlier = spans[spans[:, 0] > end], spans[spans[:, 1] < begin]
        around = (
            float(earlier[-1, 1]) if earlier.size else -np.inf,
            float(following[0, 0]) if following.size else np.inf,
        )
        near = between(recording, time[before] - 86400.0, time[slot] + 4 * 3600.0)
        seen = slice(*np.searchsorted(time, (time[before] - 3600.0, time[slot] + 3600.0)))
        fix = (time[seen], latitude[seen], longitude[seen])
        pair = (before - seen.start, int(slot) - seen.start)
        found.append(_segment(near, fix, pair, mine, around, ways, turn, angle_of_attack, added))
    return found


def _segment(
    recording: Recording,
    fix: tuple[Array, Array, Array],
    pair: tuple[int, int],
    spans: Array,
    around: tuple[float, float],
    ways: list[Leg],
    turn: Variation,
    attack: float | None,
    added: bool,
) -> Segment:
    """Everything about one segment: ``pair`` indexes its two fixes, the glider was at the surface ``around`` it."""
    time, latitude, longitude = fix
    (before, after), (since, until) = pair, around
    begin, end = float(spans[0, 0]), float(spans[-1, 1])
    origin = (float(latitude[before]), float(longitude[before]))
    east, north = metres(latitude, longitude, origin)
    paths = [through_water(recording, float(a), float(b), turn, attack, added) for a, b in spans]
    through = sum(p.east for p in paths) + 1j * sum(p.north for p in paths)
    earlier = (time <= begin) & (time > max(since, time[before] - 1800.0))
    later = (time >= end) & (time < min(until, time[after] + 1800.0))
    drift, after_drift = _drift(time, east, north, earlier), _drift(time, east, north, later)
    moved = complex(east[after], north[after])
    current = _current(moved, through, (time[before], begin, end, time[after]), drift, after_drift, spans)
    glider, source = _glider_current(recording, end, until, turn)
    mine = [leg for leg in ways if leg.start_time >= begin - 1.0 and leg.end_time <= end + 1.0]
    depth_time, depth = finite(recording, "depth")
    inside = (depth_time >= begin) & (depth_time <= end)
    moments = np.concatenate([[begin], depth_time[inside], [end]])
    hole = float(np.diff(moments).max())
    pitch = {flag: [leg.pitch for leg in mine if leg.phase == flag] for flag in (ASCENT, DESCENT)}
    charge_time, charge = finite(recording, "charge_used")
    covered = charge_time.size > 1 and charge_time[0] <= time[before] + 600 and charge_time[-1] >= time[after] - 600
    at = np.interp([time[before], time[after]], charge_time, charge) if covered else np.full(2, np.nan)
    used = float(at[1] - at[0])
    return Segment(
        start_time=float(time[before]),
        start_latitude=origin[0],
        start_longitude=origin[1],
        dive_time=begin,
        surface_time=end,
        end_time=float(time[after]),
        end_latitude=float(latitude[after]),
        end_longitude=float(longitude[after]),
        maximum_depth=float(depth[inside].max()) if inside.any() else np.nan,
        inflections=sum(a.end_time == b.start_time for a, b in zip(mine[:-1], mine[1:], strict=True)) if mine else 0,
        dive_pitch=_mean(pitch[DESCENT]),
        climb_pitch=_mean(pitch[ASCENT]),
        east=moved.real,
        north=moved.imag,
        water_east=through.real,
        water_north=through.imag,
        dead_reckoning=paths[0].how,
        path_length=_length(paths, mine),
        heading=float(np.arctan2(through.real, through.imag) % (2.0 * np.pi)),
        glider_current_east=glider.real,
        glider_current_north=glider.imag,
        glider_current_from=source,
        current_east=current.real,
        current_north=current.imag,
        drift_east=drift.real,
        drift_north=drift.imag,
        charge_used=used if used >= 0.0 else np.nan,
        longest_hole=hole,
        gap=hole > LONGEST_HOLE,
        dives=int(spans.shape[0]),
        variation=turn,
    )


def _length(paths: list[Path], mine: list[Leg]) -> float:
    """Length of the way through the water: dead reckoned, or from the legs' heights and pitches."""
    if all(p.how == "own" for p in paths):
        return sum(p.length for p in paths)
    usual = _mean([abs(leg.pitch) for leg in mine])
    total = 0.0
    for leg in mine:
        pitch = abs(leg.pitch) if np.isfinite(leg.pitch) and abs(leg.pitch) > SHALLOWEST_PITCH else usual
        angle = pitch + float(steady_angle_of_attack(np.array(pitch)))
        total += abs(leg.end_depth - leg.start_depth) / np.tan(angle)
    return float(total)


def _mean(values: list[float]) -> float:
    good = [v for v in values if np.isfinite(v)]
    return float(np.mean(good)) if good else np.nan


def _drift(time: Array, east: Array, north: Array, rows: Array) -> complex:
    """Surface drift, east + i north in m/s, of at least three fixes over two minutes; NaN with fewer.

    The median over pairs of fixes: one wrong fix does not turn it.
    """
    moments = time[rows]
    nothing = complex(np.nan, np.nan)
    if moments.size < 3 or moments[-1] - moments[0] < 120.0:
        return nothing
    i, j = np.triu_indices(moments.size, 1)
    wide = moments[j] - moments[i] > 60.0
    i, j = i[wide], j[wide]
    x, y = east[rows], north[rows]
    lapse = moments[j] - moments[i]
    drift = complex(np.median((x[j] - x[i]) / lapse), np.median((y[j] - y[i]) / lapse))
    return drift if abs(drift) < FASTEST_DRIFT else nothing


def _current(
    moved: complex,
    through: complex,
    times: tuple[float, float, float, float],
    before: complex,
    after: complex,
    spans: Array,
) -> complex:
    """Depth-averaged current, east + i north in m/s: what is left of the displacement over the time under water.

    Drift at the surface is taken off where fixes give it; a side without one is taken to drift with the current
    sought, which then also acts for that time.
    """
    start, begin, end, stop = times
    wet = float(np.sum(spans[:, 1] - spans[:, 0]))
    left, span = moved - through, wet
    for drift, stay in ((before, begin - start), (after, stop - end)):
        if np.isfinite(drift.real):
            left -= drift * stay
        else:
            span += stay
    return left / max(span, 1.0)


def _glider_current(recording: Recording, end: float, until: float, turn: Variation) -> tuple[complex, str]:
    """The glider's own estimate for the segment that ended at ``end``, true east + i north, and which value it is.

    Its final value is logged after the surface drift is known, in the next file, up to the moment of the next dive.
    A value equal to the one before surfacing was not computed anew.
    """
    last = min(until + 120.0, end + 7200.0)
    names = (
        ("final", "final_water_vx", "final_water_vy", True),
        ("in use", "water_vx", "water_vy", True),
        ("initial", "initial_water_vx", "initial_water_vy", True),
        ("product", "depth_averaged_current_east", "depth_averaged_current_north", False),
    )
    for source, first, second, local in names:
        if first not in recording or second not in recording:
            continue
        x, y = recording[first], recording[second]
        good = np.isfinite(x) & np.isfinite(y)
        low = end - 30.0 if local else end - 6 * 3600.0
        rows = np.flatnonzero(good & (recording.time > low) & (recording.time < last))
        old = np.flatnonzero(good & (recording.time <= low))
        if rows.size == 0:
            continue
        row = rows[-1] if local else rows[np.argmin(np.abs(recording.time[rows] - end))]
        if local and old.size and x[old[-1]] == x[row] and y[old[-1]] == y[row]:
            continue
        if not local:
            return complex(x[row], y[row]), source
        east, north = to_true(x[row], y[row], turn.value)
        return complex(east, north), source
    return complex(np.nan, np.nan), ""
