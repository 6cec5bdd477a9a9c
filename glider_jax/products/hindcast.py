"""Every surfacing of a recording forecast as if live, from what was known then, and scored against what came.

A case is one dive segment after the first: the forecast is made at the last fix before the dive from
``until(recording, then)`` and scored at the first fix after it. Baselines: persistence (the last segment's
displacement again, so its velocity for its duration) and dead reckoning (the segment's true time and way through the
water with the last segment's current, which no live forecast can know).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.errors import DataError
from glider_jax.inference.evidence import situation_of
from glider_jax.inference.live import Flown, assemble, fly
from glider_jax.products import scores
from glider_jax.products.coordinates import LocalFrame, iso_time
from glider_jax.products.regions import Region, inside, regions_of_metres
from glider_jax.readers.dives import until
from glider_jax.readers.segments import Segment, dive_segments
from glider_jax.records import Recording

HOUR = 3600.0
FORECAST_MEMBERS = 1000
LATE = 6 * HOUR


@dataclass(frozen=True)
class Case:
    """One surfacing forecast and what came; times UTC s, distances m, charges C; NaN where unknown.

    ``error`` from the forecast's middle to the first fix; ``persistence`` and ``dead_reckoning`` of the baselines.
    ``depth_inside`` is the probability of the smallest region that holds the truth. ``causes`` splits the error, m.
    """

    recording: str
    number: int
    issued: float
    surfaced: float
    latitude: float
    longitude: float
    forecast_latitude: float
    forecast_longitude: float
    error: float
    persistence: float
    dead_reckoning: float
    moved: float
    energy_score: float
    inside50: bool | None
    inside90: bool | None
    area90: float
    time_error: float
    time_crps: float
    time_below: float
    time_persistence: float
    charge: float
    charge_forecast: float
    charge_crps: float
    charge_below: float
    charge_persistence: float
    members_up: float
    history: int
    gap: bool
    causes: dict[str, float] = field(default_factory=dict)
    #: The regions of 50 and 90 %, for maps; not part of the tables.
    regions: tuple[Region, ...] = field(default=(), repr=False, compare=False)

    @property
    def cause(self) -> str:
        """The largest part of the error, in words."""
        if not self.causes:
            return "not known"
        return max(self.causes, key=lambda name: self.causes[name])


def cases_of(recording: Recording, *, variation: float | None = None) -> list[tuple[Segment, Segment]]:
    """Pairs of a segment and the one before it: what can be forecast and scored."""
    segments = dive_segments(recording, variation=variation)
    return list(zip(segments[:-1], segments[1:], strict=True))


def hindcast(
    recording: Recording,
    vehicle: Vehicle,
    *,
    members: int = FORECAST_MEMBERS,
    seed: int = 0,
    variation: float | None = None,
    mission: Mission | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Case]:
    """Forecast and score every surfacing after the first dive of a recording.

    Parameters
    ----------
    vehicle : for what a dive costs beyond the counter's rate; speeds and times come from the recording.
    members : per forecast.  seed : of all draws; each case adds its own number.
    variation : rad, magnetic = true + variation, for recordings without it.
    progress : called with the number of cases done.
    """
    return list(_run(recording, vehicle, members, seed, variation, mission, progress))


def _run(recording, vehicle, members, seed, variation, mission, progress) -> Iterator[Case]:
    for number, (before, truth) in enumerate(cases_of(recording, variation=variation), start=1):
        flown = issue(
            recording, truth.start_time, vehicle, members=members, seed=seed + number, variation=variation,
            mission=mission,
        )  # fmt: skip
        yield score(flown, recording.name, number, before, truth)
        if progress is not None:
            progress(number)


def issue(
    recording: Recording,
    moment: float,
    vehicle: Vehicle,
    *,
    members: int,
    seed: int,
    variation=None,
    mission=None,
) -> Flown:
    """The forecast that would have been made at a moment: the recording is cut there before anything else."""
    known = until(recording, moment)
    situation = situation_of(replace(known, name=recording.name), variation=variation)
    return fly(assemble(situation, vehicle, n=members, seed=seed, mission=mission))


def score(flown: Flown, name: str, number: int, before: Segment, truth: Segment) -> Case:
    """Compare one forecast with the segment that came; ``before`` is the one it followed."""
    known = flown.scenario.situation
    frame = LocalFrame(known.latitude, known.longitude)
    east, north = frame.to_metres(flown.fix_latitude, flown.fix_longitude)
    cloud = np.stack([east, north], axis=1)
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if len(cloud) < 3:
        raise DataError(
            f"{name}: surfacing {number}: expected members that surface, found {len(cloud)}. Report this."
        )
    goal = np.array(frame.to_metres(truth.end_latitude, truth.end_longitude))
    middle = np.median(cloud, axis=0)
    fifty, ninety = regions_of_metres(cloud, frame, (0.5, 0.9))
    place = (np.array([truth.end_latitude]), np.array([truth.end_longitude]))
    moved = complex(truth.east, truth.north)
    charge, rate = truth.charge_used, known.behaviour.charge_rate
    spread = known.behaviour.charge_rate_sd / rate if rate > 0.0 else math.nan
    normal = np.random.default_rng([number, 7]).standard_normal(flown.fix_time.size)
    drawn = rate * np.exp(spread * normal) * (flown.fix_time - known.time)
    at = frame.to_degrees(*middle)
    return Case(
        recording=name, number=number, issued=known.time, surfaced=truth.end_time, latitude=truth.end_latitude,
        longitude=truth.end_longitude, forecast_latitude=float(at[0]), forecast_longitude=float(at[1]),
        error=float(np.hypot(*(middle - goal))), persistence=abs(moved - complex(before.east, before.north)),
        dead_reckoning=_dead_reckoned(before, truth), moved=abs(moved), energy_score=scores.energy_score(cloud, goal),
        inside50=bool(inside(fifty, *place)[0]), inside90=bool(inside(ninety, *place)[0]), area90=ninety.area,
        time_error=float(np.nanmedian(flown.fix_time) - truth.end_time),
        time_crps=scores.crps(flown.fix_time - known.time, truth.end_time - known.time),
        time_below=scores.probability_below(flown.fix_time, truth.end_time),
        time_persistence=abs((before.end_time - before.start_time) - (truth.end_time - truth.start_time)),
        charge=charge, charge_forecast=float(np.nanmedian(drawn)) if rate > 0.0 else math.nan,
        charge_crps=scores.crps(drawn, charge), charge_below=scores.probability_below(drawn, charge),
        charge_persistence=abs(before.charge_used - charge),
        members_up=float(np.isfinite(flown.fix_time).mean()), history=known.behaviour.segments, gap=truth.gap,
        causes=_causes(flown, truth), regions=(fifty, ninety),
    )  # fmt: skip


def _dead_reckoned(before: Segment, truth: Segment) -> float:
    """Error of true time and way through the water with the last segment's current, m."""
    water = complex(truth.water_east, truth.water_north)
    current = complex(before.glider_current_east, before.glider_current_north)
    if not np.isfinite(current):
        current = complex(before.current_east, before.current_north)
    return abs(complex(truth.east, truth.north) - water - current * (truth.end_time - truth.start_time))


def _causes(flown: Flown, truth: Segment) -> dict[str, float]:
    """Parts of the error in m: how long it dived, how fast and where it pointed, and what the water did."""
    scenario = flown.scenario
    water = complex(truth.water_east, truth.water_north)
    current = complex(truth.current_east, truth.current_north)
    if not (np.isfinite(water) and np.isfinite(current)):
        return {}
    span = float(np.nanmedian(flown.fix_time - flown.scenario.times[0]))
    late = span - (truth.end_time - truth.dive_time)
    mean = complex(*scenario.estimate.mean.mean(axis=1))
    own = abs(complex(truth.east, truth.north)) / max(truth.end_time - truth.start_time, 1.0)
    track = flown.track
    moved = np.nanmedian(track.surfacing_latitude[:, 0]), np.nanmedian(track.surfacing_longitude[:, 0])
    frame = LocalFrame(scenario.situation.latitude, scenario.situation.longitude)
    told = complex(*(float(v) for v in frame.to_metres(*moved))) - mean * span
    share = truth.duration / max(span, 1.0)
    return {
        "time under water": abs(late) * own,
        "way through the water": abs(told * share - water),
        "current": abs(mean - current) * truth.duration,
    }


def summarise(cases: list[Case]) -> dict[str, Any]:
    """Tables of one or several recordings' cases: errors, baselines, scores, coverage, calibration, worst cases."""
    if not cases:
        raise DataError(
            "hindcast: expected at least two dives with fixes around them, found fewer. Give more data."
        )

    def column(name: str):
        return np.array([getattr(c, name) for c in cases], float)

    error, persistence = column("error"), column("persistence")
    reckoned = column("dead_reckoning")
    worst = sorted(cases, key=lambda c: -c.error)[:5]
    return {
        "cases": len(cases),
        "recordings": sorted({c.recording for c in cases}),
        "position_km": {
            "forecast": _km(scores.error_table(error)),
            "persistence": _km(scores.error_table(persistence)),
            "dead_reckoning": {
                **_km(scores.error_table(reckoned)),
                "cases": int(np.isfinite(reckoned).sum()),
            },
            "energy_score": float(np.nanmean(column("energy_score")) / 1e3),
            "skill": scores.skill(column("energy_score"), persistence),
        },
        "coverage": {
            "region50": scores.coverage([c.inside50 for c in cases]),
            "region90": scores.coverage([c.inside90 for c in cases]),
            "time50": scores.coverage([_central(c.time_below, 0.5) for c in cases]),
            "time90": scores.coverage([_central(c.time_below, 0.9) for c in cases]),
            "charge90": scores.coverage([_central(c.charge_below, 0.9) for c in cases]),
        },
        "time_min": {
            "forecast": _scaled(scores.error_table(np.abs(column("time_error"))), 60.0),
            "persistence": _scaled(scores.error_table(column("time_persistence")), 60.0),
            "crps": float(np.nanmean(column("time_crps")) / 60.0),
        },
        "charge_ah": {
            "forecast": _scaled(
                scores.error_table(np.abs(column("charge_forecast") - column("charge"))), 3600.0
            ),
            "persistence": _scaled(scores.error_table(column("charge_persistence")), 3600.0),
            "cases": int(np.isfinite(column("charge")).sum()),
        },
        "reliability": {"time": scores.reliability(column("time_below"))},
        "worst": [
            {
                "recording": c.recording,
                "number": c.number,
                "issued": iso_time(c.issued),
                "error_km": c.error / 1e3,
                "inside90": c.inside90,
                "cause": c.cause,
                "parts_km": {name: value / 1e3 for name, value in c.causes.items()},
            }
            for c in worst
        ],
    }


def _central(below: float, probability: float) -> bool | None:
    return None if math.isnan(below) else abs(below - 0.5) <= 0.5 * probability


def _km(table: dict[str, Any]) -> dict[str, Any]:
    return _scaled(table, 1e3)


def _scaled(table: dict[str, Any], unit: float) -> dict[str, Any]:
    return {k: [x / unit for x in v] if isinstance(v, list) else v / unit for k, v in table.items()}


def rows(cases: list[Case]) -> list[dict[str, Any]]:
    """Cases as plain mappings, times in ISO, NaN as None."""
    table = []
    for case in cases:
        row = asdict(replace(case, regions=())) | {
            "cause": case.cause,
            "issued": iso_time(case.issued),
            "surfaced": iso_time(case.surfaced),
        }
        del row["regions"]
        table.append(plain_numbers(row))
    return table


def plain_numbers(value: Any) -> Any:
    """The same structure with NumPy numbers as Python's and what is not finite as None, ready for JSON."""
    if isinstance(value, dict):
        return {str(k): plain_numbers(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain_numbers(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
