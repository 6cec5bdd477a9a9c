"""The published simulations flown again: six rows of section V, the comparison of three yos, and what was assumed.

Calibrated are the steady load and the fixed cost of a yo, from the two published baselines and the published slope of
the pump's line; everything else is flown. The published simulator drew a speed for every yo: here a mission that comes
up after each yo, without staying, makes the engine do the same, and all rows fly it.

References
----------
Woithe and others (2010), sections IV.B and V, Table III.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from glider_jax.config import CovarianceBlock, Mission, SurfaceRule, Vehicle, Yo
from glider_jax.errors import Outcome
from glider_jax.mission.forecast import Run, forecast, prepare
from glider_jax.mission.speeds import choose_speeds
from glider_jax.readers.missions import read_mission
from glider_jax.readers.vehicles import read_vehicle
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Track
from glider_jax_data import path as bundled_path

DAY = 86400.0
#: J m-1, the middle of the published pump line and the standard deviation of 7 to 8 J/m evenly.
SLOPE, SLOPE_SD = 7.7, 0.29
_STARTS = 5
_INTERVAL = 7200.0
#: Rounding of the published days (0.1 d) in the difference of two, as a share of 3.6 d.
_ROUNDING = 0.0113
_NO_DRAWS = ("heading", "speed", "surface_stay", "initial_position")


@dataclass(frozen=True)
class PaperRow:
    """One published simulation: ``model`` is ``shoebox`` or ``distribution``; ``minutes`` None where not told."""

    name: str
    model: str
    seafloor: bool
    currents: bool
    days: float
    kilojoules: float
    minutes: float | None


PAPER = (
    PaperRow("SimShoebox baseline", "shoebox", False, False, 7.9, 707.0, 20.0 / 60.0),
    PaperRow("SimDist baseline", "distribution", False, False, 11.5, 785.0, 1.4),
    PaperRow("SimShoebox seafloor", "shoebox", True, False, 7.9, 892.0, None),
    PaperRow("SimDist seafloor", "distribution", True, False, 11.5, 984.0, 5.7),
    PaperRow("SimShoebox seafloor, CODAR", "shoebox", True, True, 8.88, 986.0, 5.0),
    PaperRow("SimDist seafloor, CODAR", "distribution", True, True, 14.89, 1235.0, 12.0),
)
_BASELINES = PAPER[0], PAPER[1]


@dataclass(frozen=True)
class Calibration:
    """The energy constants: ``hotel`` W, ``slope`` J/m, ``fixed`` J per yo, from ``yos`` that turned at ``depth`` m.

    ``kilojoules`` of all inflections on the published baseline. ``vehicle`` carries them with their uncertainty.
    """

    hotel: float
    slope: float
    fixed: float
    yos: float
    depth: float
    kilojoules: float
    vehicle: Vehicle


@dataclass(frozen=True)
class Row:
    """One simulation of ours beside the published one; spreads are (5 %, median, 95 %) over members that arrived.

    ``seconds`` of flying all ``members`` once compiled, ``first_seconds`` with compilation. ``arrived`` is a share.
    ``by_start`` median days of each start, one where the weather plays no part.
    """

    paper: PaperRow
    speed_kind: str
    days: tuple[float, float, float]
    kilojoules: tuple[float, float, float]
    inflections: float
    parts: dict[str, float]
    through_water_km: float
    members: int
    arrived: float
    seconds: float
    first_seconds: float
    by_start: tuple[float, ...]
    track: Track

    @property
    def days_difference(self) -> float:
        """Ours over the published, less one."""
        return self.days[1] / self.paper.days - 1.0

    @property
    def energy_difference(self) -> float:
        """Ours over the published, less one."""
        return self.kilojoules[1] / self.paper.kilojoules - 1.0


def paper_mission(mission: Mission | None = None) -> Mission:
    """The bundled mission as the published simulator flew it: no time at the surface, a new speed for every yo."""
    mission = read_mission(bundled_path("missions/new_jersey.toml")) if mission is None else mission
    rules = (
        SurfaceRule("every", seconds=1.0, when_yo_ends=True, name="after each yo"),
        SurfaceRule("mission_done", ends_mission=True),
    )
    # A small radius: the published days times the speeds give 232 km, the whole way between the waypoints.
    return replace(mission, surface=rules, surface_stay=0.0, waypoint_radius=100.0)


def still_vehicle(vehicle: Vehicle | None = None) -> Vehicle:
    """The published glider without errors of heading, speed and position, and with a pack that never ends a mission."""
    vehicle = read_vehicle("slocum_g1_shallow") if vehicle is None else vehicle
    quantities = dict(vehicle.quantities)
    for name in quantities:
        value = 0.0 if name in {f"perturbation.{word}" for word in _NO_DRAWS} else quantities[name].value
        quantities[name] = replace(quantities[name], value=value, sigma=0.0)
    battery = replace(vehicle.battery, capacity=replace(vehicle.battery.capacity, value=1e9, sigma=0.0))
    return replace(vehicle, quantities=quantities, battery=battery, covariances=())


def prepare_row(
    mission: Mission, vehicle: Vehicle, model: str, *, kind: str = "over_ground", days: float = 20.0,
    bathymetry: BathymetryGrid | None = None, currents: CurrentGrid | None = None, start: float | None = None,
    spread: float = 1.0, seed: int = 0, interval: float = _INTERVAL,
) -> Run:  # fmt: skip
    """A run of the published kind: currents are what they are, their own errors left out."""
    nodes, _ = choose_speeds(mission, vehicle, model, kind=kind, has_currents=False)
    exact = None if currents is None else replace(currents, east_sd=None, north_sd=None)
    return prepare(
        mission, vehicle, currents=exact, bathymetry=bathymetry, speed=model, speeds=nodes, duration=days * DAY,
        interval=interval, seed=seed, spread=spread, start=start, current_error=0.0,
    )  # fmt: skip


def calibrate(mission: Mission, vehicle: Vehicle) -> Calibration:
    """Steady load from the two baselines' difference, the fixed cost of a yo from what the slope leaves over."""
    fast, slow = _BASELINES
    hotel = (slow.kilojoules - fast.kilojoules) * 1e3 / ((slow.days - fast.days) * DAY)
    total = fast.kilojoules * 1e3 - hotel * fast.days * DAY
    track = forecast(1, prepare_row(mission, vehicle, "shoebox", spread=0.0))
    drawn = dict(zip(track.components, track.energy[0, -1].astype(float), strict=True))
    climb, brake = vehicle.value("energy.pump_climb_to_dive"), vehicle.value("energy.brake")
    old_line = vehicle.value("energy.pump_dive_to_climb.intercept"), vehicle.value("energy.pump_dive_to_climb.slope")
    yos = drawn["brake"] / (2.0 * brake)
    depth = (drawn["pump out"] / yos - old_line[0]) / old_line[1]
    fixed = total / yos - SLOPE * depth
    changed = {
        "energy.hotel": hotel,
        "energy.pump_dive_to_climb.slope": SLOPE,
        "energy.pump_dive_to_climb.intercept": fixed - climb - 2.0 * brake,
    }
    quantities = dict(vehicle.quantities)
    quantities |= {name: replace(quantities[name], value=value) for name, value in changed.items()}
    # A larger load or slope leaves less for the fixed cost: the baseline's energy stays what was published.
    hotel_sd = _ROUNDING * hotel
    root = np.array([[hotel_sd, 0.0], [0.0, SLOPE_SD], [-hotel_sd * fast.days * DAY / yos, -SLOPE_SD * depth]])
    matrix = tuple(tuple(float(x) for x in line) for line in root @ root.T)
    block = CovarianceBlock(tuple(changed), matrix, "two published baselines and 7 to 8 J/m")
    return Calibration(
        hotel, SLOPE, fixed, yos, depth, total / 1e3,
        replace(vehicle, quantities=quantities, covariances=(block,)),
    )  # fmt: skip


def fly_row(
    row: PaperRow, mission: Mission, vehicle: Vehicle, *, n: int, seed: int = 0, kind: str = "over_ground",
    bathymetry: BathymetryGrid | None = None, currents: CurrentGrid | None = None,
) -> Row:  # fmt: skip
    """Fly one row with ``n`` members; with currents the starts are spread over the first days of the product.

    The published currents are not ours: the spread over starts shows what the weather of a fortnight does.
    """
    starts: list[float | None] = [None]
    days = 25.0
    if row.currents and currents is not None and not currents.constant_in_time:
        first = mission.start if mission.start is not None else float(currents.time[0])
        first = max(first, float(currents.time[0]))
        days = 1.1 * row.days
        spare = max((float(currents.time[-1]) - first) / DAY - days - 0.1, 0.0)
        starts = [first + k * DAY for k in np.linspace(0.0, min(spare, 4.0), _STARTS)]
    runs = [
        prepare_row(
            mission, vehicle, row.model, kind=kind, days=days, start=start, seed=seed + k,
            bathymetry=bathymetry if row.seafloor else None, currents=currents if row.currents else None,
        )
        for k, start in enumerate(starts)
    ]  # fmt: skip
    members = max(1, n // len(runs))
    clock = time.perf_counter()
    forecast(members, runs[0])
    first_seconds = time.perf_counter() - clock
    clock = time.perf_counter()
    tracks = [forecast(members, run) for run in runs]
    seconds = time.perf_counter() - clock
    arrived = np.concatenate([t.outcome == int(Outcome.ARRIVED) for t in tracks])
    days_flown = np.concatenate([(t.outcome_time - t.time[0]) / DAY for t in tracks])
    energy = np.concatenate([t.energy[:, -1] for t in tracks]).astype(float)
    # Those still flying count as later and dearer than all others.
    days_flown = np.where(arrived, days_flown, np.inf)
    total = np.where(arrived, energy.sum(-1), np.inf)
    some = arrived if arrived.any() else ~arrived
    inflections = np.concatenate([t.inflections[:, -1] for t in tracks])
    way = np.concatenate([t.distance_through_water[:, -1] for t in tracks])
    return Row(
        paper=row, speed_kind=kind if row.model == "distribution" else "one speed",
        days=spread_of(days_flown), kilojoules=spread_of(total / 1e3), inflections=float(inflections[some].mean()),
        parts={c: float(energy[some, k].mean() / 1e3) for k, c in enumerate(tracks[0].components)},
        through_water_km=float(way[some].mean() / 1e3), members=arrived.size, arrived=float(arrived.mean()),
        seconds=seconds, first_seconds=first_seconds, track=tracks[0],
        by_start=tuple(spread_of(part)[1] for part in np.split(days_flown, len(runs))),
    )  # fmt: skip


def spread_of(values: Array) -> tuple[float, float, float]:
    """5 %, median and 95 % of values that may be infinite."""
    ordered = np.sort(np.asarray(values, float))
    at = [ordered[min(int(q * ordered.size), ordered.size - 1)] for q in (0.05, 0.5, 0.95)]
    return float(at[0]), float(at[1]), float(at[2])


def six_rows(
    *, n: int, seed: int, bathymetry: BathymetryGrid, currents: CurrentGrid, mission: Mission | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[Calibration, list[Row], list[Row]]:  # fmt: skip
    """Calibrate, then fly the six published rows and the two that show what counting currents twice does.

    Returns
    -------
    The calibration, the six rows, and SimDist with speeds through the water, over the seafloor without and with
    currents.
    """
    mission = paper_mission(mission)
    calibration = calibrate(mission, still_vehicle())
    rows = []
    for row in PAPER:
        rows.append(
            fly_row(row, mission, calibration.vehicle, n=n, seed=seed, bathymetry=bathymetry, currents=currents)
        )
        if progress is not None:
            progress(len(rows))
    water = []
    for row in (PAPER[3], PAPER[5]):
        water.append(
            fly_row(
                row, mission, calibration.vehicle, n=n, seed=seed, kind="through_water",
                bathymetry=bathymetry, currents=currents,
            )
        )  # fmt: skip
        if progress is not None:
            progress(len(rows) + len(water))
    return calibration, rows, water


def effective_current(fast: float, slow: float, speed: float) -> float:
    """Steady current along the track (m s-1) that makes a way out and back take ``slow`` instead of ``fast`` days."""
    return speed * math.sqrt(max(1.0 - fast / slow, 0.0))


@dataclass(frozen=True)
class ThreeYos:
    """The published comparison of three yos between 2 and 25 m; durations in s, of the yos alone.

    ``time`` (o,) s and ``depth`` (members, o) m of SimShoebox (first row) and SimDist. ``overshoot`` m below 25 m.
    """

    shoebox: float
    distribution: Array
    later: float
    later_sd: float
    overshoot: float
    time: Array
    depth: Array
    seconds: tuple[float, float]


def three_yos(*, n: int = 1000, seed: int = 0) -> ThreeYos:
    """Fly three yos between 2 and 25 m at the shoebox speed and at speeds drawn from the distribution."""
    base = paper_mission()
    yo = Yo(25.0, 2.0, base.yo.dive_pitch, base.yo.climb_pitch, dive_altitude=None, half_cycles=6)
    rules = (SurfaceRule("every", seconds=DAY), SurfaceRule("mission_done", ends_mission=True))
    mission = replace(base, yo=yo, surface=rules, surface_stay=DAY)
    vehicle = still_vehicle()
    found = {}
    for model, members in (("shoebox", 1), ("distribution", n)):
        run = prepare_row(mission, vehicle, model, days=0.25, spread=float(members > 1), seed=seed, interval=10.0)
        forecast(members, run)
        clock = time.perf_counter()
        track = forecast(members, run)
        found[model] = (track, _yo_seconds(track, yo), time.perf_counter() - clock)
    shoebox, drawn = found["shoebox"], found["distribution"]
    later = drawn[1] - shoebox[1][0]
    good = np.isfinite(later)
    return ThreeYos(
        shoebox=float(shoebox[1][0]), distribution=drawn[1], later=float(later[good].mean()),
        later_sd=float(later[good].std(ddof=1) / math.sqrt(good.sum())) if good.sum() > 1 else math.nan,
        overshoot=float(shoebox[0].depth[0].max() - yo.dive_to), time=shoebox[0].time - shoebox[0].time[0],
        depth=np.concatenate([shoebox[0].depth, drawn[0].depth[:40]]), seconds=(shoebox[2], drawn[2]),
    )  # fmt: skip


def _yo_seconds(track: Track, yo: Yo) -> Array:
    """Seconds from 2 m going down to 2 m coming up: the way from and to the surface taken off."""
    up = track.surfacing_time[:, 0] - track.time[0]
    row = np.argmax(track.time[None, :] - track.time[0] >= up[:, None], axis=1)
    speed = track.distance_through_water[np.arange(track.n), row] / up
    return up - yo.climb_to / (speed * math.tan(yo.dive_pitch)) - yo.climb_to / (speed * math.tan(yo.climb_pitch))
