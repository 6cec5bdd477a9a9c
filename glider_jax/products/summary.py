"""The forecast in the words and numbers pilots use, as one mapping that JSON can hold.

Schema ``glider_jax.forecast/1``. Times are ISO UTC with ``Z`` beside ``hours`` since the start; places are decimal
degrees beside degrees and decimal minutes; nothing is NaN, what is not known is None. Spreads are mappings with
``p05 p25 median p75 p95``: the 50 % interval is p25 to p75, the 90 % interval p05 to p95.

forecast : start, end, horizon_h, members, seed, version, complete.
outcomes : per outcome that occurred: code, name, sentence, count, share, first (time, hours, place).
surfacings : the next ones, at most four: number, probability (share of members that surface so often within the
    forecast; all else in the entry is conditional on it), time, hours, place, regions, reasons.
positions : at 6, 12, 24, 48 h and daily after: share_active, place, regions (members still under way only).
boxes : per hour to 48 h, then per day: from_h, to_h, share_active, all (limits of all members under way during the
    time), ninety (limits that leave out 2.5 % of members on each side at its end, so at least 90 % lie within).
waypoints : place, probability, time and hours of arrival (members that arrive), by (probability by given hours),
    closest_km.
rates : km_per_day over_ground and through_water, wh_per_day and ah_per_day total and by_component, ah_first for the
    first 24 and 72 h. Each member's mean over its own duration. Ah are shared among components as energy is.
battery : charge_left_percent at the end; levels: per level the probability that it is reached within the forecast,
    dates within it, and dates extrapolated at each member's mean draw; reserve with the probability of ending above
    it; fan: percentiles of charge left at every output time; energy_wh: mean by component at every output time.
risks : probabilities of grounding, of bottom contact, of arriving, of arriving above the reserve.
areas : per polygon given: name, probability of entering, first entry.
program : per rule of the mission's program: number, rule in words, probability of coming into force, when it first
    does, and count, how often on average over all members.
notes, provenance.

A region is probability, area_km2, method and a GeoJSON geometry.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider_jax.errors import Outcome
from glider_jax.products import measures
from glider_jax.products.clouds import Cloud
from glider_jax.products.coordinates import LocalFrame, frame_of, iso_time, place_text, wrap_longitude
from glider_jax.products.measures import NamedPolygon
from glider_jax.products.provenance import outcome_sentence, plain, provenance
from glider_jax.products.quantiles import Quantiles
from glider_jax.products.rule_times import RuleTimes
from glider_jax.products.shapes import region_entry
from glider_jax.records import Array, Track

SCHEMA = "glider_jax.forecast/1"
LEVELS = (0.20, 0.15, 0.10)
SPREAD = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
_SURFACINGS = 4


def summarise(
    track: Track, *, polygons: Sequence[NamedPolygon] = (), reserve: float | None = None
) -> dict[str, Any]:
    """Summarise one ensemble; see the module for the schema.

    Parameters
    ----------
    track : the ensemble.
    polygons : areas whose probability of being entered is wanted.
    reserve : share of the usable charge (0 to 1) that a pilot wants left; the setting ``reserve_fraction``, else
        0.15, if None.
    """
    accumulator = SummaryAccumulator(polygons=polygons, reserve=reserve)
    accumulator.add(track)
    return accumulator.result()


class SummaryAccumulator:
    """Builds the same summary from blocks of members.

    Up to ``limit`` members the result is exact. Beyond it positions and quantities are kept as counts on grids, in
    memory that does not grow with the number of members.

    Parameters
    ----------
    polygons, reserve : as for :func:`summarise`.
    limit : number of members up to which values are kept whole.
    """

    def __init__(
        self, *, polygons: Sequence[NamedPolygon] = (), reserve: float | None = None, limit: int = 50_000
    ) -> None:
        self.polygons = tuple(polygons)
        self.limit = limit
        self.members = 0
        self.complete = True
        self._reserve = reserve
        self._first: Track | None = None

    def add(self, block: Track) -> None:
        """Take in the members of a block; blocks share times, components, reasons and waypoints."""
        if self._first is None:
            self._start(block)
        self.members += block.n
        self.complete &= block.complete
        if not block.n:
            return
        positions = measures.Positions(block, self._frame.longitude)
        self._add_outcomes(block)
        self._add_surfacings(block)
        self._add_positions(positions)
        self._add_waypoints(block, positions)
        self._add_energy(block)
        for k, polygon in enumerate(self.polygons):
            self._entries[k].add(measures.entry_times(positions, polygon))
        self._rules.add(block)

    def result(self) -> dict[str, Any]:
        """The summary of everything added so far."""
        track = self._first
        made = provenance(track.settings)
        return {
            "schema": SCHEMA,
            "forecast": {
                "start": iso_time(float(track.time[0])),
                "end": iso_time(float(track.time[-1])),
                "start_place": self._place(*self._begin),
                "horizon_h": _round((track.time[-1] - track.time[0]) / 3600.0, 3),
                "members": self.members,
                "seed": made["seed"],
                "version": made["version"],
                "complete": self.complete,
                "exact": self.members <= self.limit,
            },
            "outcomes": self._outcome_entries(),
            "surfacings": self._surfacing_entries(),
            "positions": self._position_entries(),
            "boxes": self._box_entries(),
            "waypoints": self._waypoint_entries(),
            "rates": self._rate_entries(),
            "battery": self._battery_entry(),
            "risks": self._risk_entries(),
            "areas": self._area_entries(),
            "program": self._rules.entries(self._dates),
            "notes": list(track.notes),
            "provenance": made,
        }

    # What is kept

    def _start(self, block: Track) -> None:
        """Choose instants, frame and accumulators from the first block."""
        horizon = float(block.time[-1] - block.time[0])
        self._first = block
        self._frame: LocalFrame = frame_of(block.latitude[:, 0], block.longitude[:, 0])
        self._begin = (self._frame.latitude, self._frame.longitude)
        if self._reserve is None:
            self._reserve = float(block.settings.get("reserve_fraction") or 0.15)
        self._levels = np.array(sorted({*LEVELS, self._reserve}, reverse=True))
        self._instants = _instants(horizon)
        self._intervals = _intervals(horizon)
        self._by = sorted({t for t in (12, 24, 48, 72, 120, 168, 240, 360) if t * 3600.0 < horizon}) + [
            _round(horizon / 3600.0, 3)
        ]
        waypoints, components = len(block.waypoints), len(block.components)
        self._counts: dict[int, int] = {}
        self._firsts: dict[int, tuple[float, float, float]] = {}
        times = min(_SURFACINGS, block.surfacing_time.shape[1])
        self._surfaced = Quantiles(times, self.limit)
        self._reasons = np.zeros((times, len(block.reasons)), np.int64)
        self._surfacing_clouds = [Cloud(self._frame, self.limit) for _ in range(times)]
        self._clouds = [Cloud(self._frame, self.limit) for _ in self._instants]
        self._limits = np.array([[np.inf, np.inf, -np.inf, -np.inf]] * len(self._intervals)).reshape(-1, 4)
        self._ends = Quantiles(2 * len(self._intervals), self.limit)
        self._arrivals = Quantiles(waypoints, self.limit)
        self._by_counts = np.zeros((len(self._by), waypoints), np.int64)
        self._closest = Quantiles(waypoints, self.limit)
        self._rates = Quantiles(3 + 2 * components + 1, self.limit)
        self._windows = [h for h in (24, 72) if h * 3600.0 <= horizon]
        self._windowed = Quantiles(len(self._windows), self.limit)
        self._charge = Quantiles(block.time.size, self.limit)
        self._energy = np.zeros((block.time.size, components))
        self._crossed = Quantiles(len(self._levels), self.limit)
        self._extrapolated = Quantiles(len(self._levels), self.limit)
        self._decided = self._above = self._arrived_above = self._touched = 0
        self._entries = [Quantiles(1, self.limit) for _ in self.polygons]
        self._rules = RuleTimes(block.program, self.limit)

    def _add_outcomes(self, block: Track) -> None:
        outcome = np.asarray(block.outcome, int)
        for code in np.unique(outcome):
            members = np.flatnonzero(outcome == code)
            self._counts[int(code)] = self._counts.get(int(code), 0) + members.size
            times = np.asarray(block.outcome_time, float)[members]
            if np.isfinite(times).any():
                k = members[np.nanargmin(times)]
                first = (
                    float(block.outcome_time[k]),
                    float(block.outcome_latitude[k]),
                    float(block.outcome_longitude[k]),
                )
                known = self._firsts.get(int(code))
                self._firsts[int(code)] = first if known is None else min(known, first)

    def _add_surfacings(self, block: Track) -> None:
        for k, cloud in enumerate(self._surfacing_clouds):
            cloud.add(block.surfacing_latitude[:, k], block.surfacing_longitude[:, k])
            codes = np.asarray(block.surfacing_reason[:, k], int)
            known = codes[(codes >= 0) & (codes < len(block.reasons))]
            self._reasons[k] += np.bincount(known, minlength=len(block.reasons))
        times = np.asarray(block.surfacing_time[:, : len(self._surfacing_clouds)], float)
        self._surfaced.add(times - block.time[0])

    def _add_positions(self, positions: measures.Positions) -> None:
        for cloud, instant in zip(self._clouds, self._instants, strict=True):
            cloud.add(*positions.at(instant))
        ends = np.empty((positions.track.n, 2 * len(self._intervals)))
        for k, (start, end) in enumerate(self._intervals):
            south, west, north, east = positions.extremes(start, end)
            if math.isfinite(south):
                low, high = self._limits[k, :2], self._limits[k, 2:]
                self._limits[k] = [
                    min(low[0], south),
                    min(low[1], west),
                    max(high[0], north),
                    max(high[1], east),
                ]
            ends[:, 2 * k], ends[:, 2 * k + 1] = positions.at(end)
        self._ends.add(ends)

    def _add_waypoints(self, block: Track, positions: measures.Positions) -> None:
        arrival = np.asarray(block.waypoint_time, float) - block.time[0]
        self._arrivals.add(arrival)
        with np.errstate(invalid="ignore"):
            self._by_counts += np.array([(arrival <= t * 3600.0).sum(axis=0) for t in self._by])
        closest = [measures.closest_approach(positions, tuple(w)) for w in np.asarray(block.waypoints, float)]
        self._closest.add(np.stack(closest, axis=1) if closest else np.zeros((block.n, 0)))

    def _add_energy(self, block: Track) -> None:
        rates = measures.daily_rates(block)
        total = rates["energy"].sum(axis=1)
        share = rates["energy"] / np.where(total > 0.0, total, 1.0)[:, None]
        columns = (rates["over_ground"], rates["through_water"], rates["charge"], total)
        self._rates.add(np.column_stack([*columns, rates["energy"], share * rates["charge"][:, None]]))
        windows = [measures.first_day_charge(block, h * 3600.0) for h in self._windows]
        self._windowed.add(np.stack(windows, axis=1) if windows else np.zeros((block.n, 0)))
        self._charge.add(block.state_of_charge)
        self._energy += np.asarray(block.energy).sum(axis=0, dtype=float)
        crossed = measures.crossing_times(block, self._levels)
        self._crossed.add(crossed)
        self._extrapolated.add(measures.extrapolated_crossings(block, self._levels, crossed))
        outcome = np.asarray(block.outcome, int)
        decided = ~np.isin(outcome, [int(code) for code in measures.CUT_SHORT])
        above = np.asarray(block.state_of_charge[:, -1]) >= self._reserve
        self._decided += int(decided.sum())
        self._above += int((decided & above).sum())
        self._arrived_above += int(((outcome == Outcome.ARRIVED) & above).sum())
        self._touched += int((np.asarray(block.bottom_contacts) > 0).sum())

    # What is said

    def _dates(self, quantiles: Quantiles, column: int, *, of_all: bool = False) -> dict[str, Any]:
        """Percentiles of seconds since the start as hours and as dates."""
        seconds = quantiles.at(tuple(SPREAD.values()), of_all=of_all)[:, column]
        start = float(self._first.time[0])
        return {
            "hours": {key: _round(s / 3600.0, 3) for key, s in zip(SPREAD, seconds, strict=True)},
            "time": {key: iso_time(start + s) for key, s in zip(SPREAD, seconds, strict=True)},
        }

    def _place(self, latitude: float, longitude: float) -> dict[str, Any]:
        return {
            "latitude": _round(latitude, 6),
            "longitude": _round(float(wrap_longitude(longitude)), 6),
            "text": place_text(latitude, longitude),
        }

    def _share(self, count: float) -> float:
        return _round(count / max(self.members, 1), 6)

    def _outcome_entries(self) -> list[dict[str, Any]]:
        entries = []
        for code, count in sorted(self._counts.items(), key=lambda item: -item[1]):
            first = self._firsts.get(code)
            entry = {
                "code": code,
                "name": Outcome(code).name if code in Outcome._value2member_map_ else "UNKNOWN",
                "sentence": outcome_sentence(code),
                "count": count,
                "share": self._share(count),
                "first": None,
            }
            if first is not None:
                hours = _round((first[0] - float(self._first.time[0])) / 3600.0, 3)
                place = self._place(*first[1:]) if math.isfinite(first[1]) else None
                entry["first"] = {"time": iso_time(first[0]), "hours": hours, "place": place}
            entries.append(entry)
        return entries

    def _cloud_entry(self, cloud: Cloud) -> dict[str, Any]:
        middle = cloud.median()
        return {
            "place": None if middle is None else self._place(*middle),
            "regions": [region_entry(region) for region in cloud.regions()],
        }

    def _surfacing_entries(self) -> list[dict[str, Any]]:
        entries = []
        for k, cloud in enumerate(self._surfacing_clouds):
            happened = int(self._surfaced.finite[k])
            if not happened:
                break
            entries.append(
                {
                    "number": k + 1,
                    "probability": self._share(happened),
                    **self._dates(self._surfaced, k),
                    **self._cloud_entry(cloud),
                    "reasons": [
                        {
                            "reason": self._first.reasons[j],
                            "probability": _round(self._reasons[k, j] / happened, 6),
                        }
                        for j in np.argsort(-self._reasons[k], kind="stable")
                        if self._reasons[k, j]
                    ],
                }
            )
        return entries

    def _position_entries(self) -> list[dict[str, Any]]:
        start = float(self._first.time[0])
        return [
            {
                "hours": _round(instant / 3600.0, 3),
                "time": iso_time(start + instant),
                "share_active": self._share(cloud.count),
                **self._cloud_entry(cloud),
            }
            for instant, cloud in zip(self._instants, self._clouds, strict=True)
        ]

    def _box_entries(self) -> list[dict[str, Any]]:
        start = float(self._first.time[0])
        inner = self._ends.at((0.025, 0.975))
        entries = []
        for k, (begin, end) in enumerate(self._intervals):
            active = int(self._ends.finite[2 * k])
            low, high = inner[:, 2 * k : 2 * k + 2]
            entries.append(
                {
                    "from_h": _round(begin / 3600.0, 3),
                    "to_h": _round(end / 3600.0, 3),
                    "until": iso_time(start + end),
                    "share_active": self._share(active),
                    "all": _box(*self._limits[k]),
                    "ninety": _box(*low, *high) if active else None,
                }
            )
        return entries

    def _waypoint_entries(self) -> list[dict[str, Any]]:
        closest = self._closest.at(tuple(SPREAD.values()))
        return [
            {
                "number": k + 1,
                "place": self._place(float(latitude), float(longitude)),
                "probability": self._share(int(self._arrivals.finite[k])),
                **self._dates(self._arrivals, k),
                "by": [
                    {"hours": hours, "probability": self._share(int(self._by_counts[i, k]))}
                    for i, hours in enumerate(self._by)
                ],
                "closest_km": _spread(closest[:, k] / 1000.0, 3),
            }
            for k, (latitude, longitude) in enumerate(np.asarray(self._first.waypoints, float))
        ]

    def _rate_entries(self) -> dict[str, Any]:
        names = self._first.components
        levels = self._rates.at(tuple(SPREAD.values()))
        mean = self._rates.mean()
        c = len(names)

        def entry(column: int, unit: float) -> dict[str, Any]:
            return {"mean": _round(mean[column] / unit, 4)} | _spread(levels[:, column] / unit, 4)

        window = self._windowed.at(tuple(SPREAD.values()))
        return {
            "share_counted": self._share(int(self._rates.finite[0])),
            "km_per_day": {"over_ground": entry(0, 1e3), "through_water": entry(1, 1e3)},
            "ah_per_day": {
                "total": entry(2, 3600.0),
                "by_component": {name: entry(4 + c + k, 3600.0) for k, name in enumerate(names)},
            },
            "wh_per_day": {
                "total": entry(3, 3600.0),
                "by_component": {name: entry(4 + k, 3600.0) for k, name in enumerate(names)},
            },
            "ah_first": [
                {"hours": hours, **_spread(window[:, k] / 3600.0, 4)} for k, hours in enumerate(self._windows)
            ],
        }

    def _battery_entry(self) -> dict[str, Any]:
        fan = self._charge.at(tuple(SPREAD.values())) * 100.0
        hours = (self._first.time - self._first.time[0]) / 3600.0
        mean = self._energy / max(self.members, 1) / 3600.0
        levels = [
            {
                "charge_left_percent": _round(level * 100.0, 3),
                "is_reserve": bool(level == self._reserve),
                "probability": self._share(int(self._crossed.finite[k])),
                "within_forecast": self._dates(self._crossed, k, of_all=True),
                "extrapolated": self._dates(self._extrapolated, k, of_all=True),
            }
            for k, level in enumerate(self._levels)
        ]
        return {
            "charge_left_percent": _spread(fan[:, -1], 3),
            "reserve_percent": _round(self._reserve * 100.0, 3),
            "levels": levels,
            "extrapolation": "each member's mean draw over the forecast goes on",
            "fan": {
                "hours": [_round(h, 3) for h in hours],
                **{key: [_round(v, 3) for v in row] for key, row in zip(SPREAD, fan, strict=True)},
            },
            "energy_wh": {
                name: [_round(v, 3) for v in mean[:, k]] for k, name in enumerate(self._first.components)
            },
        }

    def _risk_entries(self) -> dict[str, Any]:
        decided = self._decided
        return {
            "share_decided": self._share(decided),
            "above_reserve_at_end": _round(self._above / decided, 6) if decided else None,
            "arrives": self._share(self._counts.get(Outcome.ARRIVED, 0)),
            "arrives_above_reserve": self._share(self._arrived_above),
            "grounding": self._share(self._counts.get(Outcome.AGROUND, 0)),
            "bottom_contact": self._share(self._touched),
            "leaves_the_inputs": self._share(self.members - decided),
        }

    def _area_entries(self) -> list[dict[str, Any]]:
        return [
            {
                "name": polygon.name,
                "probability": self._share(int(entries.finite[0])),
                **self._dates(entries, 0),
            }
            for polygon, entries in zip(self.polygons, self._entries, strict=True)
        ]


def _instants(horizon: float) -> list[float]:
    """Seconds at which positions and their regions are given."""
    hours = [6.0, 12.0, 24.0, 48.0, *np.arange(72.0, 24.0 * 400, 24.0)]
    chosen = [h * 3600.0 for h in hours if h * 3600.0 <= horizon]
    # Sixty days daily would be sixty regions; keep every k-th day beyond the first two.
    late = [t for t in chosen if t > 172800.0]
    every = max(1, math.ceil(len(late) / 16))
    kept = [t for t in chosen if t <= 172800.0] + late[every - 1 :: every]
    return kept if kept and kept[-1] == horizon else [*kept, horizon]


def _intervals(horizon: float) -> list[tuple[float, float]]:
    """Intervals of the boxes, s: hours to 48 h, then days; the last one ends with the forecast."""
    edges = [3600.0 * h for h in range(49) if 3600.0 * h < horizon]
    edges += [86400.0 * d for d in range(3, 400) if 86400.0 * d < horizon]
    edges.append(horizon)
    return [(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]


def _round(value: Any, digits: int) -> float | None:
    value = float(value)
    return round(value, digits) if math.isfinite(value) else None


def _spread(values: Array, digits: int) -> dict[str, float | None]:
    return {key: _round(value, digits) for key, value in zip(SPREAD, values, strict=True)}


def _box(south: float, west: float, north: float, east: float) -> dict[str, Any] | None:
    """Limits in degrees; ``west`` is greater than ``east`` where the box crosses the antimeridian."""
    if not math.isfinite(south):
        return None
    west, east = (float(wrap_longitude(x)) for x in (west, east))
    return plain(
        {
            key: _round(v, 5)
            for key, v in zip("south west north east".split(), (south, west, north, east), strict=True)
        }
    )
