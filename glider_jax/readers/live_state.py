"""The newest evidence about a glider from dialogs, state files and recordings, each datum with its age.

Standard library and NumPy only. The words of the last surfacing (mission, reason, prompt) come from the dialogs alone;
positions come from whichever source saw the glider last. Data later than ``now`` are never used, so a replay of an
old mission sees what its pilot saw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.dialog_merge import SAME_FIX
from glider_jax.readers.dialog_records import (
    UNKNOWN,
    AbortHistory,
    Datum,
    NextWaypoint,
    Position,
    Surfacing,
    WaterVelocity,
)
from glider_jax.readers.dialogs import DialogLog, joined_logs
from glider_jax.readers.geodesy import range_and_bearing
from glider_jax.readers.glider_state import GliderState
from glider_jax.records import Array


class NoFix(DataError):
    """No source holds a position fix of the glider."""


class StaleFix(DataError):
    """The newest fix is older than allowed; ``age`` in s, infinite where its time is not known."""

    def __init__(self, message: str, age: float) -> None:
        super().__init__(message)
        self.age = age


@dataclass(frozen=True)
class RecordedFixes:
    """Fixes of a recording as plain arrays: time s, latitude and longitude degrees, any order, NaN ignored."""

    time: Array
    latitude: Array
    longitude: Array
    name: str = "recording"


_Aged = TypeVar("_Aged", Position, Datum, WaterVelocity | None, Position | None)

Evidence = DialogLog | GliderState | RecordedFixes


@dataclass(frozen=True)
class LiveState:
    """What is known of a glider at ``now``, and how old it is.

    Attributes
    ----------
    now : s; ages of everything here are at this time.
    vehicle : empty where no source names it.
    gps : newest fix, ``gps_source`` where from; ``fixes`` all distinct ones, ascending.
    dead_reckoned : newest dead-reckoned position.
    surfacing : newest surfacing of the dialogs, as printed then (its ages are at its own time); or None.
    state : ``in mission``, ``not in mission`` or ``unknown``, from that surfacing; ``resumed`` if it dived again.
    sensors : newest reading of each sensor of all surfacings; ``defaults`` values never set since the glider started.
    waypoint : newest; range and true bearing from the newest position.
    water_velocity : newest ``m_water_v``, along the glider's axes; ``water_complete`` as said with it.
    last_heard : newest clock printed, report or fix, s; NaN where nothing is dated.
    notes : sentences on what was left out or is doubtful.
    """

    now: float
    vehicle: str
    gps: Position | None
    gps_source: str
    fixes: tuple[Position, ...]
    dead_reckoned: Position | None
    surfacing: Surfacing | None
    state: str
    resumed: bool
    sensors: dict[str, Datum]
    defaults: dict[str, Datum]
    waypoint: NextWaypoint | None
    water_velocity: WaterVelocity | None
    water_complete: bool | None
    aborts: AbortHistory | None
    last_heard: float
    notes: tuple[str, ...]

    @property
    def in_mission(self) -> bool:
        """Whether the newest evidence shows a running mission."""
        return self.surfacing is not None and self.surfacing.in_mission

    @property
    def capacity(self) -> Datum | None:
        """Battery capacity entered by the user, C."""
        name = "f_coulomb_battery_capacity"
        return self.sensors.get(name) or self.defaults.get(name)

    def fix(self, oldest: float | None = None) -> Position:
        """The newest fix.

        Parameters
        ----------
        oldest : s; refuse a fix that is older, or whose age is not known. None takes any fix.

        Raises
        ------
        NoFix : there is none.
        StaleFix : it is older than ``oldest``.
        """
        who = self.vehicle or "glider"
        if self.gps is None:
            raise NoFix(
                f"{who}: expected a GPS fix in the dialog, state file or recording, found none. Wait for a "
                "complete surface dialog, or give the position by hand."
            )
        age = self.gps.age if math.isfinite(self.gps.time) else math.inf
        if oldest is not None and age > oldest:
            said = f"{age / 60.0:.0f} minutes" if math.isfinite(age) else "unknown, its clock line is lost"
            raise StaleFix(
                f"{who}: expected a fix of the last {oldest / 60.0:.0f} minutes, found one whose age is {said}. "
                "Give a newer dialog, or allow older fixes.",
                age,
            )
        return self.gps


def latest_state(
    sources: Iterable[Evidence], *, now: float | None = None, vehicle: str | None = None
) -> LiveState:
    """Merge sources into the newest evidence for each datum.

    Parameters
    ----------
    sources : dialog logs, dockserver states and fixes of recordings, in any order.
    now : s since 1970; nothing later is used. None takes the newest time in the sources. A live caller whose clock
        may be behind the glider's should not give an earlier time than the newest of the sources.
    vehicle : use only surfacings of this glider; needed where the dialogs name several.

    Raises
    ------
    DataError : the dialogs name several gliders and ``vehicle`` is not given.
    """
    sources = list(sources)
    logs = [s for s in sources if isinstance(s, DialogLog)]
    states = [s for s in sources if isinstance(s, GliderState)]
    recorded = [s for s in sources if isinstance(s, RecordedFixes)]
    name = _vehicle(logs, states, vehicle)
    notes: list[str] = []
    if now is not None:
        count = sum(d.dated and d.time > now for log in logs for d in log.dumps)
        if count:
            notes.append(f"{count} printouts of the dialog are later than the given time and were not used")
        logs, states = [log.until(now) for log in logs], [s.until(now) for s in states]
    surfacings = list(joined_logs(logs, vehicle=name or None).surfacings)
    fixes = _fixes(surfacings, states, recorded, now)
    heard = [s.time for s in surfacings] + [s.time for s in states] + [f.time for f, _ in fixes]
    last = max((t for t in heard if math.isfinite(t)), default=math.nan)
    at = last if now is None else now
    gps, origin = fixes[-1] if fixes else (None, "")
    newest = surfacings[-1] if surfacings else None
    sensors = {n: d for s in surfacings for n, d in s.sensors.items()}
    dead = [s.dead_reckoned for s in surfacings] + [r.dead_reckoned for s in states for r in s.reports]
    notes += newest.notes if newest is not None else ()
    here = gps or _newest(dead)
    wet = next((s for s in reversed(surfacings) if s.water_velocity is not None), None)
    return LiveState(
        now=at,
        vehicle=name,
        gps=_aged(gps, at),
        gps_source=origin,
        fixes=tuple(_aged(f, at) for f, _ in fixes),
        dead_reckoned=_aged(_newest(dead), at),
        surfacing=newest,
        state=newest.state if newest is not None else UNKNOWN,
        resumed=newest is not None and newest.resumed,
        sensors={n: _aged(d, at) for n, d in sorted(sensors.items())},
        defaults={n: d for s in surfacings for n, d in s.defaults.items() if n not in sensors},
        waypoint=_waypoint(surfacings, states, here),
        water_velocity=_aged(wet.water_velocity, at) if wet is not None else None,
        water_complete=wet.water_complete if wet is not None else None,
        aborts=_abort(surfacings, states),
        last_heard=last,
        notes=tuple(dict.fromkeys(notes)),
    )


def _vehicle(logs: list[DialogLog], states: list[GliderState], asked: str | None) -> str:
    if asked is not None:
        return asked
    names = dict.fromkeys(n for log in logs for n in log.vehicles) | dict.fromkeys(
        s.vehicle for s in states if s.vehicle
    )
    if len(names) > 1:
        raise DataError(
            f"dialogs: expected one glider, found {', '.join(sorted(names)[:10])}. Say which one is meant (vehicle)."
        )
    return next(iter(names), "")


def _fixes(
    surfacings: list[Surfacing], states: list[GliderState], recorded: list[RecordedFixes], now: float | None
) -> list[tuple[Position, str]]:
    """Distinct fixes with their source, ascending; an undated one only where there is no other."""
    found = [(f, "dialog") for s in surfacings for f in s.fixes]
    found += [(f, "dockserver state") for s in states for f in s.fixes]
    for one in recorded:
        columns = np.broadcast_arrays(
            *(np.ravel(np.asarray(c, float)) for c in (one.time, one.latitude, one.longitude))
        )
        good = np.isfinite(columns).all(axis=0)
        found += [
            (Position(la, lo, 0.0, t), one.name)
            for t, la, lo in zip(*(c[good].tolist() for c in columns), strict=True)
        ]
    found = sorted((f for f in found if now is None or f[0].time <= now), key=lambda f: f[0].time)
    kept: list[tuple[Position, str]] = []
    for fix in found:
        if not kept or fix[0].time - kept[-1][0].time > SAME_FIX:
            kept.append(fix)
    undated = [(s.gps, "dialog without a clock") for s in surfacings if s.gps is not None and not s.fixes]
    return kept or [(f, w) for f, w in undated if f is not None][-1:]


def _newest(places: list[Position | None]) -> Position | None:
    known = [p for p in places if p is not None]
    return max(known, key=lambda p: p.time if math.isfinite(p.time) else -math.inf, default=None)


def _aged(datum: _Aged, at: float) -> _Aged:
    """The datum with its age at ``at``; the printed age stays where its time is not known."""
    if datum is None or not math.isfinite(datum.time) or not math.isfinite(at):
        return datum
    return replace(datum, age=max(0.0, at - datum.time))


def _waypoint(
    surfacings: list[Surfacing], states: list[GliderState], here: Position | None
) -> NextWaypoint | None:
    """The waypoint heard last, with the way to it from the newest position."""
    heard = [(s.time, s.waypoint) for s in surfacings if s.waypoint]
    heard += [(s.time - s.waypoint.age, s.waypoint) for s in states if s.waypoint]
    if not heard:
        return None
    point = max(heard, key=lambda h: h[0] if math.isfinite(h[0]) else -math.inf)[1]
    if here is None or point is None:
        return point
    way = range_and_bearing(here.latitude, here.longitude, point.latitude, point.longitude)
    return replace(point, range=way[0], bearing=way[1])


def _abort(surfacings: list[Surfacing], states: list[GliderState]) -> AbortHistory | None:
    heard = [(s.time, s.aborts) for s in surfacings if s.aborts] + [
        (s.time, s.last_abort) for s in states if s.last_abort
    ]
    return max(heard, key=lambda h: h[0] if math.isfinite(h[0]) else -math.inf, default=(0.0, None))[1]
