"""Printouts of the surface dialog merged into surfacings.

Standard library and records only. A glider prints its state every minute while it waits, and a server repeats old
text after a reconnect: so equal clocks are one printout, and one surfacing is all printouts between two dives. The
last printout wins for each datum; a position fix is settled by a vote of all printouts that show the same fix.
"""

from __future__ import annotations

import bisect
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

from glider_jax.readers.dialog_grammar import printable, to_si, written_moment
from glider_jax.readers.dialog_records import (
    NOT_IN_MISSION,
    UNKNOWN,
    AbortHistory,
    Datum,
    Dump,
    NextWaypoint,
    Position,
    Surfacing,
    WaterVelocity,
)
from glider_jax.readers.geodesy import range_and_bearing
from glider_jax.records import Repair

#: s; nothing dives and is back with a fix and a call within this.
SHORTEST_DIVE = 240.0
#: s; without mission numbers, printouts further apart belong to different surfacings.
LONGEST_SILENCE = 1800.0
#: s; mission starts (clock less mission time) that differ by more belong to different missions.
SAME_START = 120.0
#: A log that names more gliders is noise; what repeats in it is not sought.
MOST_GLIDERS = 16
#: After so many copies of one printout, another brings nothing new.
MOST_COPIES = 32
#: s; positions measured this close to each other are one fix: ages are rounded and the clock is whole seconds.
SAME_FIX = 2.0
#: m; a fix this far from the median of all other positions of its surfacing cannot be right.
FARTHEST_FIX = 50_000.0


def surfacings_of(dumps: Sequence[Dump]) -> tuple[tuple[Surfacing, ...], tuple[Repair, ...]]:
    """Surfacings of printouts in the order of the log, ascending in time, and the repairs made on the way."""
    counts: Counter[str] = Counter()
    groups: list[list[Dump]] = []
    gliders: dict[str, list[Dump]] = {}
    for dump in dumps:
        gliders.setdefault(dump.vehicle, []).append(dump)
    for mine in gliders.values():
        dated = sorted((d for d in mine if d.dated), key=lambda d: (d.time, d.order))
        groups += _with_undated(_split(dated), [d for d in mine if not d.dated], counts)
    found = [_merged(group, counts) for group in groups]
    found.sort(key=lambda s: (not math.isnan(s.time), s.time if math.isfinite(s.time) else 0.0))
    details = {
        "undated printout": "clock line missing or garbled; used only where no dated printout helps",
        "conflicting fix": "printouts disagree on one fix; the majority was taken",
        "impossible fix": "more than 50 km from the other positions of its surfacing",
    }
    return tuple(found), tuple(Repair(kind, n, details[kind]) for kind, n in counts.items() if n)


def without_copies(dumps: Sequence[Dump]) -> tuple[list[Dump], int]:
    """Printouts with those of the same glider and clock joined into one, and how many copies were found."""
    kept: list[Dump] = []
    places: dict[tuple[float, float], list[int]] = {}
    copies = 0
    for dump in dumps:
        if not dump.dated:
            kept.append(dump)
            continue
        near = places.setdefault(
            (dump.time, -1.0 if math.isnan(dump.mission_time) else dump.mission_time), []
        )
        place = next((p for p in near if similar(kept[p].vehicle, dump.vehicle)), None)
        if place is not None:
            if kept[place].copies < MOST_COPIES:
                kept[place] = _joined(kept[place], dump)
            copies += 1
        else:
            if len(near) < MOST_GLIDERS:
                near.append(len(kept))
            kept.append(dump)
    return kept, copies


def similar(name: str, other: str) -> bool:
    """Whether two names may be one: equal but for one garbled character, or one of them not heard."""
    if not name or not other:
        return True
    return len(name) == len(other) and sum(a != b for a, b in zip(name, other, strict=True)) <= 1


def mended_clocks(dumps: list[Dump]) -> tuple[list[Dump], int]:
    """Printouts whose clock contradicts both neighbours while the mission time agrees, with the clock mended."""
    out, count = list(dumps), 0
    for i in range(1, len(out) - 1):
        before, here, after = out[i - 1 : i + 2]
        starts = [d.time - d.mission_time for d in (before, here, after)]
        if not all(map(math.isfinite, starts)) or abs(starts[0] - starts[2]) > SAME_START:
            continue
        ordered = before.mission_time <= here.mission_time <= after.mission_time
        if ordered and abs(starts[1] - starts[0]) > SAME_START and not before.time <= here.time <= after.time:
            out[i] = replace(here, time=starts[0] + here.mission_time)
            count += 1
    return out, count


def _joined(first: Dump, second: Dump) -> Dump:
    """Two copies of one printout: each datum from the copy with fewer garbled lines, gaps filled from the other."""
    good, poor = (second, first) if second.garbled < first.garbled else (first, second)
    # A copy that breaks off stops before the prompt that ended the mission: the prompt stands.
    last = max(first, second, key=lambda d: (d.state == NOT_IN_MISSION, d.state != UNKNOWN))
    return replace(
        good,
        order=first.order,
        vehicle=good.vehicle or poor.vehicle,
        mission=good.mission or poor.mission,
        mission_number=good.mission_number or poor.mission_number,
        file_number=good.file_number or poor.file_number,
        reason=good.reason or poor.reason,
        behavior=good.behavior or poor.behavior,
        start_when=_either(good.start_when, poor.start_when),
        positions={**poor.positions, **good.positions},
        sensors={**poor.sensors, **good.sensors},
        defaults={**poor.defaults, **good.defaults},
        reports=tuple(dict.fromkeys(first.reports + second.reports)),
        waypoint=good.waypoint or poor.waypoint,
        aborts={**poor.aborts, **good.aborts},
        devices=good.devices or poor.devices,
        errors=tuple(dict.fromkeys(first.errors + second.errors)),
        water_complete=poor.water_complete if good.water_complete is None else good.water_complete,
        time_until_diving=_either(good.time_until_diving, poor.time_until_diving),
        state=last.state,
        evidence=last.evidence,
        abort_code=last.abort_code,
        resumed=first.resumed or second.resumed,
        lab_mode=first.lab_mode or second.lab_mode,
        garbled=good.garbled,
        copies=first.copies + second.copies,
    )


def _either(value: float, other: float) -> float:
    return other if math.isnan(value) else value


def _split(dated: list[Dump]) -> list[list[Dump]]:
    groups: list[list[Dump]] = []
    for dump in dated:
        if groups and not _dived(groups[-1][-1], dump):
            groups[-1].append(dump)
        else:
            groups.append([dump])
    return groups


def _dived(before: Dump, after: Dump) -> bool:
    """Whether the glider dived, or began another mission, between two printouts."""
    gap = after.time - before.time
    shift = (after.time - after.mission_time) - (before.time - before.mission_time)
    if abs(shift) > SAME_START:
        return True
    if gap < SHORTEST_DIVE:
        return False
    turns = [
        d.sensors["m_tot_num_inflections"][0] for d in (before, after) if "m_tot_num_inflections" in d.sensors
    ]
    if len(turns) == 2 and turns[0] != turns[1]:
        return True
    if before.mission_number and after.mission_number:
        return before.mission_number != after.mission_number
    return before.resumed or gap > LONGEST_SILENCE


def _with_undated(groups: list[list[Dump]], undated: list[Dump], counts: Counter[str]) -> list[list[Dump]]:
    """Undated printouts put where they were printed: in the surfacing just before them, or else just after."""
    counts["undated printout"] += len(undated)
    orders = sorted((d.order, i) for i, group in enumerate(groups) for d in group)
    numbers = [{d.mission_number for d in group} - {""} for group in groups]
    groups, guests = list(groups), dict[int, list[Dump]]()
    for dump in undated:
        at = bisect.bisect(orders, (dump.order, -1))
        near = [orders[k][1] for k in (at - 1, at) if 0 <= k < len(orders)]
        home = next((g for g in near if _may_join(numbers[g], dump)), None)
        if home is None:
            if not groups or groups[-1][0].dated or not _may_join(numbers[-1], dump):
                groups.append([dump])
                numbers.append({dump.mission_number} - {""})
                continue
            home = len(groups) - 1
        guests.setdefault(home, []).append(dump)
    return [_seated(group, guests.get(i, [])) for i, group in enumerate(groups)]


def _may_join(numbers: set[str], dump: Dump) -> bool:
    return not numbers or not dump.mission_number or dump.mission_number in numbers


def _seated(group: list[Dump], guests: list[Dump]) -> list[Dump]:
    """A group with each undated guest behind the last of its printouts that was printed before the guest."""
    if not guests:
        return group
    # Smallest order from each place on: it never falls, so the last smaller one is found by bisection.
    least = list(accumulate((d.order for d in reversed(group)), min))[::-1]
    seats = sorted((bisect.bisect_left(least, g.order) - 1, i) for i, g in enumerate(guests))
    out: list[Dump] = []
    k = 0
    for place in range(-1, len(group)):
        out += [group[place]] if place >= 0 else []
        while k < len(seats) and seats[k][0] == place:
            out.append(guests[seats[k][1]])
            k += 1
    return out


def _merged(group: list[Dump], counts: Counter[str]) -> Surfacing:
    """One surfacing of its printouts, oldest first. Words go by this order; numbers of a dated printout go first."""
    dated = [d for d in group if d.dated]
    ranked = [d for d in group if not d.dated] + dated
    now = dated[-1].time if dated else math.nan
    notes: list[str] = []
    fixes = _fixes(ranked, now, counts, notes)
    places = {kind: _place(ranked, kind, now) for kind in ("dead_reckoned", "too_far", "invalid")}
    sensors = _sensors(ranked, now)
    here = fixes[-1] if fixes else places["dead_reckoned"]
    stated = [d for d in group if d.state != UNKNOWN]
    resumed = [i for i, d in enumerate(group) if d.resumed]
    return Surfacing(
        vehicle=group[-1].vehicle,
        mission=_vote([d.mission for d in group]),
        mission_number=_vote([d.mission_number for d in group]),
        time=now,
        first_time=dated[0].time if dated else math.nan,
        mission_time=_last([d.mission_time for d in ranked]),
        reason=_vote([d.reason for d in group]),
        behavior=_vote([d.behavior for d in group]),
        start_when=_last([d.start_when for d in group]),
        state=stated[-1].state if stated else UNKNOWN,
        evidence=stated[-1].evidence if stated else "",
        resumed=bool(resumed) and resumed[-1] == len(group) - 1,
        gps=fixes[-1] if fixes else None,
        fixes=tuple(f for f in fixes if math.isfinite(f.time)),
        sensors=sensors,
        defaults={
            name: Datum(*to_si(value, unit), math.inf, math.nan, value, unit)
            for d in group
            for name, (value, unit) in d.defaults.items()
            if name not in sensors and math.isfinite(to_si(value, unit)[0])
        },
        waypoint=_waypoint(ranked, sensors, here),
        water_velocity=_velocity(sensors, "m_water_v"),
        initial_water_velocity=_velocity(sensors, "m_initial_water_v"),
        final_water_velocity=_velocity(sensors, "m_final_water_v"),
        water_complete=next(
            (d.water_complete for d in reversed(group) if d.water_complete is not None), None
        ),
        time_until_diving=dated[-1].time_until_diving
        if dated
        else _last([d.time_until_diving for d in group]),
        aborts=_aborts(group),
        devices=next((d.devices for d in reversed(group) if d.devices), None),
        errors=tuple(dict.fromkeys(e for d in group for e in d.errors)),
        abort_code=stated[-1].abort_code if stated else None,
        lab_mode=any(d.lab_mode for d in group),
        dumps=len(group),
        notes=tuple(notes),
        **places,
    )


def _vote(words: list[str]) -> str:
    """The word printed most often, the last of equals; empty where none was."""
    heard = [w for w in reversed(words) if w]
    return Counter(heard).most_common(1)[0][0] if heard else ""


def _last(values: list[float]) -> float:
    return next((v for v in reversed(values) if math.isfinite(v)), math.nan)


def _age(now: float, time: float, printed: float) -> float:
    """Age at ``now``, or the printed age where no clock was read."""
    return max(0.0, now - time) if math.isfinite(time) and math.isfinite(now) else max(0.0, printed)


def _place(group: list[Dump], kind: str, now: float) -> Position | None:
    for dump in reversed(group):
        if kind in dump.positions:
            latitude, longitude, age = dump.positions[kind]
            time = dump.time - age
            return Position(latitude, longitude, _age(now, time, age), time)
    return None


def _fixes(group: list[Dump], now: float, counts: Counter[str], notes: list[str]) -> list[Position]:
    """Distinct fixes, ascending in time; those of undated printouts come first."""
    printed = [(d.time - d.positions["gps"][2], *d.positions["gps"]) for d in group if "gps" in d.positions]
    undated = [Position(la, lo, max(0.0, age), math.nan) for time, la, lo, age in printed if math.isnan(time)]
    dated = sorted(p for p in printed if math.isfinite(p[0]))
    clusters: list[list[tuple[float, float, float, float]]] = []
    for one in dated:
        if clusters and one[0] - clusters[-1][0][0] <= SAME_FIX:
            clusters[-1].append(one)
        else:
            clusters.append([one])
    fixes: list[Position] = []
    for same in clusters:
        (latitude, longitude), votes = Counter((p[1], p[2]) for p in same).most_common(1)[0]
        counts["conflicting fix"] += len(same) - votes
        first = min((p for p in same if p[1:3] == (latitude, longitude)), key=lambda p: p[3])
        fixes.append(Position(latitude, longitude, _age(now, first[0], first[3]), first[0]))
    return undated + _plausible(fixes, group, counts, notes)


def _plausible(
    fixes: list[Position], group: list[Dump], counts: Counter[str], notes: list[str]
) -> list[Position]:
    """Fixes without those far from the median of all other positions; the doubt is noted where two differ."""
    others = [d.positions["dead_reckoned"][:2] for d in group if "dead_reckoned" in d.positions]
    every = [(f.latitude, f.longitude) for f in fixes] + others
    if not fixes or len(every) < 2:
        return fixes
    latitude = sorted(p[0] for p in every)[(len(every) - 1) // 2]
    longitude = sorted(p[1] for p in every)[(len(every) - 1) // 2]
    near = [
        f for f in fixes if range_and_bearing(latitude, longitude, f.latitude, f.longitude)[0] <= FARTHEST_FIX
    ]
    if len(every) > 2 and near:
        counts["impossible fix"] += len(fixes) - len(near)
        return near
    if range_and_bearing(*every[0], *every[-1])[0] > FARTHEST_FIX:
        notes.append(
            "the GPS fix and the dead-reckoned position are more than 50 km apart; one of them is garbled"
        )
    return fixes


def _sensors(group: list[Dump], now: float) -> dict[str, Datum]:
    out: dict[str, Datum] = {}
    for dump in group:
        for name, (printed, unit, age) in dump.sensors.items():
            _put(out, name, printed, unit, dump.time - age, age, now)
        for later, name, printed, unit in dump.reports:
            _put(out, name, printed, unit, dump.time + later, 0.0, now)
    return dict(sorted(out.items()))


def _put(
    out: dict[str, Datum], name: str, printed: float, unit: str, time: float, age: float, now: float
) -> None:
    value, si = to_si(printed, unit)
    if math.isfinite(value):
        out[name] = Datum(value, si, _age(now, time, age), time, printed, unit)


def _velocity(sensors: dict[str, Datum], stem: str) -> WaterVelocity | None:
    x, y = sensors.get(f"{stem}x"), sensors.get(f"{stem}y")
    if x is None or y is None:
        return None
    return WaterVelocity(x.value, y.value, max(x.age, y.age), min(x.time, y.time))


def _waypoint(group: list[Dump], sensors: dict[str, Datum], here: Position | None) -> NextWaypoint | None:
    """The waypoint of the newest waypoint line, else of the commanded waypoint sensors."""
    line = next((d.waypoint for d in reversed(group) if d.waypoint), None)
    lat, lon = sensors.get("c_wpt_lat"), sensors.get("c_wpt_lon")
    if line:
        latitude, longitude, printed_range, bearing, age = line
    elif lat is not None and lon is not None and (lat.value, lon.value) != (0.0, 0.0):
        latitude, longitude, age = lat.value, lon.value, max(lat.age, lon.age)
        printed_range = bearing = math.nan
    else:
        return None
    way = (math.nan, math.nan)
    if here is not None:
        way = range_and_bearing(here.latitude, here.longitude, latitude, longitude)
    return NextWaypoint(latitude, longitude, *way, printed_range, bearing, age)


def _aborts(group: list[Dump]) -> AbortHistory | None:
    words: dict[str, str] = {}
    for dump in group:
        words.update(dump.aborts)
    if not words:
        return None
    total = words.get("total since reset", "").strip()
    time = written_moment(words.get("last abort time", ""))
    return AbortHistory(
        total=int(total) if total.isdecimal() and len(total) < 10 else None,
        cause=printable(words.get("last abort cause", "")),
        details=printable(words.get("last abort details", "")),
        time=math.nan if time is None else time,
        segment=printable(words.get("last abort segment", "")),
        mission=printable(words.get("last abort mission", "")),
    )
