"""What is known of a glider at a surfacing, from its recordings and its surface dialogs: one :class:`Situation`.

NumPy only. The newest fix wins, whichever source it comes from; every datum keeps its age, and what had to be assumed
is said. Surfacings of a dialog log become segments of their own: two fixes, the current the glider worked out, and
what is left between them as its way through the water.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from glider_jax.environment.geomagnetism import declination
from glider_jax.errors import DataError
from glider_jax.inference.behaviour import Behaviour, learn, says_it_aims, waypoint_at, waypoint_log
from glider_jax.inference.currents import Observations, drifted, felt, observations, observe
from glider_jax.readers.dead_reckoning import Variation, magnetic_variation, metres, to_true
from glider_jax.readers.dialog_records import Surfacing
from glider_jax.readers.dives import between, fixes, legs, underwater, until
from glider_jax.readers.glider_state import GliderState
from glider_jax.readers.live_state import NoFix
from glider_jax.readers.segments import Segment, dive_segments
from glider_jax.records import Array, Recording

_WINDOW = 12 * 86400.0
#: rad; what anomalies of the crust and the years leave the reference field uncertain by.
_FIELD_SD = math.radians(1.5)


@dataclass(frozen=True)
class Situation:
    """What is known of a glider at the surface.

    Attributes
    ----------
    time, latitude, longitude : of the last fix, UTC s and degrees.
    departure, departure_sd : s from that fix to the dive to come.
    surfaced : UTC s at which it came up, NaN where unknown.
    waypoint : latitude and longitude flown to, None where unknown.
    known_current : m/s east + i north, what the glider itself reckons with; NaN where it has none.
    seen : currents felt so far.  behaviour : how it has been flying.
    charge_used, capacity, relative_charge : C since the counter was zeroed, C of the pack, share left; NaN where
        unknown.
    name : of the glider.  ages : s before ``time``'s evidence, by what it is.
    assumed : sentences on what was assumed.  files : digests of the inputs.  segments,
        surfacings : those it rests on.  variation : how its axes were made true.
    """

    time: float
    latitude: float
    longitude: float
    departure: float
    departure_sd: float
    surfaced: float
    waypoint: tuple[float, float] | None
    known_current: complex
    seen: Observations
    behaviour: Behaviour
    charge_used: float = math.nan
    capacity: float = math.nan
    relative_charge: float = math.nan
    name: str = "glider"
    ages: dict[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    files: dict[str, str] = field(default_factory=dict)
    segments: tuple[Segment, ...] = ()
    variation: Variation | None = None
    surfacings: tuple[Surfacing, ...] = ()


def situation_of(
    recording: Recording | None = None,
    surfacings: Sequence[Surfacing] = (),
    *,
    moment: float | None = None,
    variation: float | None = None,
    files: dict[str, str] | None = None,
) -> Situation:
    """The situation at the newest fix up to a moment; nothing later is looked at.

    Parameters
    ----------
    recording : of any kind, or None.  surfacings : of one glider's dialog, oldest first, already cut at the moment.
    moment : UTC s, None for the newest evidence.  variation : rad, magnetic = true + variation.
    files : digests of the dialog's files.

    Raises
    ------
    NoFix : there is no fix up to the moment.
    DataError : the newest dialog says that no mission runs.
    """
    heard = [s for s in surfacings if np.isfinite(s.time)]
    known = None if recording is None else _cut(recording, moment)
    time, latitude, longitude = fixes(known) if known is not None else (np.empty(0),) * 3
    if time.size == 0 and not any(s.fixes for s in heard):
        name = recording.name if recording is not None else "dialog"
        raise NoFix(
            f"{name}: expected a GPS fix to forecast from, found none. Give files that hold the last surfacing, "
            "or wait for the next dialog."
        )
    place = _newest(time, latitude, longitude, heard)
    now = place[0]
    newest = heard[-1] if heard and heard[-1].time >= now - 60.0 else None
    if newest is not None and newest.state == "not in mission":
        raise DataError(
            f"{newest.vehicle or 'dialog'}: expected a running mission, found '{newest.evidence}' in the newest "
            "dialog. No dive is forecast: start a mission, or give the dialog of one."
        )
    turn, told = _variation(known, heard, variation, place)
    segments = dive_segments(known, variation=turn.value) if known is not None and time.size else []
    ways = legs(known) if segments else []
    since = segments[-1].end_time if segments else -math.inf
    segments += [one for one in dialog_segments(heard, turn) if one.start_time >= since - 60.0]
    log = _waypoints(known, heard, now)
    behaviour = learn(segments, ways, log, _aims(known, heard), now)
    seen = observe(segments)
    drift, surfaced = _at_surface(known, (time, latitude, longitude), newest, now)
    if np.isfinite(drift):
        seen = observations([*_rows(seen), drifted(now - 300.0, drift.real, drift.imag)])
    current, felt_age = _known_current(segments, newest, turn, now)
    if newest is not None and np.isfinite(current) and not segments:
        # One dialog alone: what the glider felt, over a dive of the usual length before it came up.
        span = float(np.exp(behaviour.duration.centre))
        came = newest.first_time
        seen = observations([*_rows(seen), felt(came - span, came, current.real, current.imag)])
    departure, departure_sd = _departure(behaviour, newest, now, surfaced)
    point = waypoint_at(log, now + 600.0)
    assumed = [*behaviour.assumed, *told]
    if point is None and not any("no waypoint" in text for text in assumed):
        assumed.append("no waypoint known: the last direction through the water is held")
    ages = {"fix": _age(newest, now), "current": felt_age}
    if point is not None:
        row = int(np.searchsorted(log[0], now + 600.0, side="right")) - 1
        ages["waypoint"] = max(now - float(log[0][row]), 0.0)
    charge, capacity, relative = _charge(known, newest)
    return Situation(
        time=now, latitude=place[1], longitude=place[2], departure=departure, departure_sd=departure_sd,
        surfaced=surfaced, waypoint=point, known_current=current, seen=seen, behaviour=behaviour, charge_used=charge,
        capacity=capacity, relative_charge=relative, name=_name(recording, heard), ages=ages,
        assumed=tuple(dict.fromkeys(assumed)),
        files=(dict(recording.source.files) if recording is not None else {}) | dict(files or {}),
        segments=tuple(segments), variation=turn, surfacings=tuple(heard),
    )  # fmt: skip


def _cut(recording: Recording, moment: float | None) -> Recording:
    known = recording if moment is None else until(recording, moment)
    return between(known, known.time[-1] - _WINDOW, known.time[-1]) if known.time.size else known


def _name(recording: Recording | None, heard: list[Surfacing]) -> str:
    named = [s.vehicle for s in heard if s.vehicle]
    return named[-1] if named else (recording.name if recording is not None else "glider")


def _newest(time, latitude, longitude, heard) -> tuple[float, float, float]:
    """The newest fix of all: time, latitude, longitude."""
    found = [(float(time[-1]), float(latitude[-1]), float(longitude[-1]))] if time.size else []
    found += [(f.time, f.latitude, f.longitude) for s in heard for f in s.fixes[-1:] if np.isfinite(f.time)]
    return max(found)


def _variation(known, heard, given, place) -> tuple[Variation, list[str]]:
    """The magnetic variation: given, recorded, printed, estimated, else of the reference field; and what to say."""
    if given is not None:
        return Variation(float(given), 0.0, "given"), []
    found = magnetic_variation(known) if known is not None and known.time.size else None
    if found is not None and found.how in ("true", "recorded"):
        return found, []
    printed = [s.magnetic_variation.value for s in heard if s.magnetic_variation is not None]
    if printed:
        return Variation(float(printed[-1]), math.radians(1.0), "recorded"), []
    if found is not None and found.how == "estimated" and found.sigma < _FIELD_SD:
        return found, [
            f"magnetic variation {math.degrees(found.value):+.1f} degrees west, from its dead reckoning"
        ]
    value = -declination(place[1], place[2], place[0])
    text = f"magnetic variation {math.degrees(value):+.1f} degrees west, of the reference field at the fix"
    return Variation(value, _FIELD_SD, "reference field"), [f"{text}; --variation-deg sets another"]


def surfacings_of_state(state: GliderState, until: float = math.inf) -> list[Surfacing]:
    """Surfacings of a dockserver's state file: stays with fixes, no more than twenty minutes between them."""
    fixes = [f for f in state.fixes if f.time <= until]
    starts = [k for k, f in enumerate(fixes) if k == 0 or f.time - fixes[k - 1].time > 1200.0]
    nan = math.nan
    found = []
    for a, b in zip(starts, [*starts[1:], len(fixes)], strict=True):
        stay = tuple(fixes[a:b])
        found.append(
            Surfacing(
                vehicle=state.vehicle,
                mission="",
                mission_number="",
                time=stay[-1].time,
                first_time=stay[0].time,
                mission_time=nan,
                reason="",
                behavior="",
                start_when=nan,
                state="unknown",
                evidence="",
                resumed=False,
                gps=stay[-1],
                dead_reckoned=None,
                too_far=None,
                invalid=None,
                fixes=stay,
                sensors={},
                defaults={},
                waypoint=state.waypoint if b == len(fixes) and until == math.inf else None,
                water_velocity=None,
                initial_water_velocity=None,
                final_water_velocity=None,
                water_complete=None,
                time_until_diving=nan,
                aborts=None,
                devices=None,
                errors=(),
                abort_code=None,
                lab_mode=False,
                dumps=1,
            )  # fmt: skip
        )
    return found


def dialog_segments(heard: Sequence[Surfacing], turn: Variation) -> list[Segment]:
    """Segments between surfacings of a dialog log that have fixes: what was flown is what the current leaves over."""
    found = []
    nan = math.nan
    with_fix = [s for s in heard if s.fixes]
    for one, two in zip(with_fix[:-1], with_fix[1:], strict=True):
        start, end = one.fixes[-1], two.fixes[0]
        leaves = one.time + (one.time_until_diving if 0.0 <= one.time_until_diving < 1800.0 else 60.0)
        comes = min(two.first_time, end.time) - 60.0
        if comes - leaves < 120.0 or comes - leaves > 2 * 86400.0:
            continue
        east, north = (
            float(v) for v in metres(end.latitude, end.longitude, (start.latitude, start.longitude))
        )
        felt_there = _true(two.water_velocity, turn)
        charge = nan
        if one.charge_used is not None and two.charge_used is not None:
            charge = two.charge_used.value - one.charge_used.value
        drift = _drift_of(one)
        found.append(
            Segment(
                start_time=start.time,
                start_latitude=start.latitude,
                start_longitude=start.longitude,
                dive_time=leaves,
                surface_time=comes,
                end_time=end.time,
                end_latitude=end.latitude,
                end_longitude=end.longitude,
                maximum_depth=nan,
                inflections=0,
                dive_pitch=nan,
                climb_pitch=nan,
                east=east,
                north=north,
                water_east=nan,
                water_north=nan,
                dead_reckoning="none",
                heading=nan,
                path_length=nan,
                glider_current_east=felt_there.real,
                glider_current_north=felt_there.imag,
                glider_current_from="dialog",
                current_east=nan,
                current_north=nan,
                drift_east=drift.real,
                drift_north=drift.imag,
                charge_used=charge if charge >= 0.0 else nan,
                longest_hole=nan,
                gap=False,
                dives=1,
                variation=turn,
            )  # fmt: skip
        )
    return found


def _true(velocity, turn: Variation) -> complex:
    """A printed water velocity as east + i north; NaN where none was printed or it was never worked out."""
    if velocity is None or not (np.isfinite(velocity.x) and np.isfinite(velocity.y)) or velocity.age > 1e30:
        return complex(math.nan, math.nan)
    east, north = to_true(velocity.x, velocity.y, turn.value)
    return complex(float(east), float(north))


def _drift_of(one: Surfacing) -> complex:
    rows = np.array([(f.time, f.latitude, f.longitude) for f in one.fixes], float).reshape(-1, 3)
    return surface_drift(rows[:, 0], rows[:, 1], rows[:, 2], -math.inf)


def _waypoints(known, heard, now):
    """Waypoints of recording and dialogs in one log, ascending in time."""
    rows = list(zip(*waypoint_log(known), strict=True)) if known is not None else []
    rows += [(s.time, s.waypoint.latitude, s.waypoint.longitude) for s in heard if s.waypoint is not None]
    rows = sorted(row for row in rows if row[0] <= now + 600.0)
    return tuple(np.array([row[k] for row in rows], float) for k in range(3))


def _aims(known, heard) -> bool | None:
    name = "u_use_current_correction"
    printed = [s.sensors[name].value > 0.0 for s in heard if name in s.sensors]
    if printed:
        return printed[-1]
    return says_it_aims(known) if known is not None else None


def _at_surface(known, fix, newest, now) -> tuple[complex, float]:
    """Surface drift of this stay, and when the glider came up (NaN where unknown)."""
    surfaced = math.nan
    drift = complex(math.nan, math.nan)
    if known is not None and fix[0].size and fix[0][-1] >= now - 60.0:
        spans = underwater(known)
        over = spans[spans[:, 1] <= now + 1.0]
        surfaced = float(over[-1, 1]) if over.size else math.nan
        drift = surface_drift(*fix, max(surfaced, now - 1800.0) if over.size else now - 1800.0)
    if newest is not None:
        surfaced = (
            surfaced
            if np.isfinite(surfaced)
            else min([newest.first_time, *(f.time for f in newest.fixes[:1])])
        )
        drift = drift if np.isfinite(drift) else _drift_of(newest)
    return drift, surfaced


def _known_current(segments, newest, turn, now) -> tuple[complex, float]:
    """What the glider itself reckons with, and the age of it: the middle of the dive it was felt in."""
    if newest is not None and newest.water_velocity is not None:
        current = _true(newest.water_velocity, turn)
        if np.isfinite(current):
            return current, max(now - newest.water_velocity.time, 0.0)
    if segments:
        last = segments[-1]
        current = complex(last.glider_current_east, last.glider_current_north)
        return current, now - 0.5 * (last.dive_time + last.surface_time)
    return complex(math.nan, math.nan), math.nan


def _departure(behaviour: Behaviour, newest, now: float, surfaced: float) -> tuple[float, float]:
    """Seconds from the fix to the dive, and their spread."""
    if newest is None:
        return behaviour.departure, 0.3 * behaviour.departure
    since = newest.time - now
    if newest.resumed:
        return max(since, 0.0) + 30.0, 20.0
    if np.isfinite(newest.time_until_diving):
        return max(since + newest.time_until_diving, 30.0), 120.0
    left = behaviour.stay - (now - surfaced) if np.isfinite(surfaced) else behaviour.stay
    left = max(left, since + 60.0, 60.0)
    return left, 0.4 * left


def _age(newest, now: float) -> float:
    return max(newest.time - now, 0.0) if newest is not None else 0.0


def _charge(known, newest) -> tuple[float, float, float]:
    """Charge used, capacity (C) and share of charge left, the newest of each."""
    printed = (
        (newest.charge_used, newest.capacity, newest.relative_charge) if newest is not None else (None,) * 3
    )
    names = ("charge_used", "battery_capacity", "relative_charge")
    return tuple(
        float(datum.value) if datum is not None else (_last(known, name) if known is not None else math.nan)
        for datum, name in zip(printed, names, strict=True)
    )


def _rows(seen: Observations):
    return zip(seen.begin, seen.end, seen.east, seen.north, seen.sd, seen.surface, strict=True)


def _last(recording: Recording, name: str) -> float:
    if name not in recording:
        return math.nan
    good = recording[name][np.isfinite(recording[name])]
    return float(good[-1]) if good.size else math.nan


def surface_drift(time: Array, latitude: Array, longitude: Array, since: float) -> complex:
    """Drift in m/s, east + i north, of the fixes since a moment: medians over pairs; NaN with too few."""
    mine = time >= since
    moments = time[mine]
    if moments.size < 3 or moments[-1] - moments[0] < 120.0:
        return complex(math.nan, math.nan)
    # Pairs of very many fixes say nothing new.
    pick = np.unique(np.linspace(0, moments.size - 1, 60).astype(int))
    east, north = metres(
        latitude[mine], longitude[mine], (float(latitude[mine][0]), float(longitude[mine][0]))
    )
    moments, east, north = moments[pick], east[pick], north[pick]
    i, j = np.triu_indices(moments.size, 1)
    wide = moments[j] - moments[i] > 60.0
    i, j = i[wide], j[wide]
    if i.size == 0:
        return complex(math.nan, math.nan)
    lapse = moments[j] - moments[i]
    drift = complex(np.median((east[j] - east[i]) / lapse), np.median((north[j] - north[i]) / lapse))
    return drift if abs(drift) < 2.5 else complex(math.nan, math.nan)
