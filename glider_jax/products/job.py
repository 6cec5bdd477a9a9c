"""The main job: read every input, fly the ensemble, write every product. The command line only parses and prints.

Start-up is where a small forecast spends its time: what was read and filled, and what was compiled, is kept.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.errors import ConfigError
from glider_jax.products.atomic import write_text
from glider_jax.products.kept_fields import kept_currents
from glider_jax.readers.missions import read_mission
from glider_jax.readers.vehicles import read_vehicle
from glider_jax.records import BathymetryGrid, CurrentGrid, Track, WaterProfile
from glider_jax_data import path as bundled_path

DAY = 86400.0
DEFAULT_DAYS = 15.0
STREAM_ABOVE = 50_000


@dataclass(frozen=True)
class Options:
    """What a user asks of a forecast; None takes the bundled default or the mission's own.

    ``currents`` are files of one product, the word ``none``, or an artificial flow such as ``uniform:east=0.1``;
    ``bathymetry`` likewise (``sloping:depth=60,slope=0.001``). ``seafloor_from`` are recordings whose measured water
    depths are gridded, over ``bathymetry`` if both are given. ``days``, ``start`` (UTC seconds), ``start_position``
    (latitude, longitude). ``polygons`` is a GeoJSON file. ``outputs`` names the products to write, ``html`` (off by
    default) among them; ``style`` is that of the figures, see ``products.figure_style``.
    ``cache`` is a folder where currents that were read and filled are kept; None keeps none.
    """

    n: int = 5000
    mission: Path | None = None
    vehicle: Path | None = None
    currents: tuple[Path, ...] = ()
    bathymetry: Path | None = None
    seafloor_from: tuple[Path, ...] = ()
    hydrography: tuple[Path, ...] = ()
    tides: Path | None = None
    grid: Path | None = None
    speed: str = "distribution"
    speed_kind: str = "auto"
    speeds: Path | None = None
    seed: int = 0
    days: float | None = None
    start: float | None = None
    start_position: tuple[float, float] | None = None
    interval: float | None = None
    polygons: Path | None = None
    reserve: float | None = None
    spread: float = 1.0
    precision: str = "float32"
    decimal_degrees: bool = False
    outputs: frozenset[str] = frozenset({"nc", "json", "geojson", "kmz", "map", "battery"})
    style: str = "screen"
    cache: Path | None = None


@dataclass(frozen=True)
class Inputs:
    """Everything read from files, and what was assumed on the way."""

    mission: Mission
    vehicle: Vehicle
    currents: CurrentGrid | None
    bathymetry: BathymetryGrid | None
    water: WaterProfile | None
    start: float | None
    days: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Result:
    """A finished job: the summary, where each product lies, and a track to draw from (all members, or a sample)."""

    summary: dict[str, Any]
    files: dict[str, Path] = field(default_factory=dict)
    track: Track | None = None


def reach_box(mission: Mission, position: tuple[float, float], days: float) -> tuple[float, float, float, float]:
    """(south, north, west, east) degrees that the mission can reach: its waypoints and a margin for drift."""
    points = np.array([position, *mission.waypoints], float)
    # Drift of 0.15 m/s for the whole time, at most 250 km, plus half a degree.
    margin = 0.5 + min(0.15 * days * DAY, 250e3) / 111e3
    wide = margin / max(math.cos(math.radians(float(np.abs(points[:, 0]).max()))), 0.1)
    longitude = position[1] + (points[:, 1] - position[1] + 180.0) % 360.0 - 180.0
    return (
        float(max(points[:, 0].min() - margin, -90.0)),
        float(min(points[:, 0].max() + margin, 90.0)),
        float(longitude.min() - wide),
        float(longitude.max() + wide),
    )


@dataclass(frozen=True)
class Survey:
    """What is known before any field is read: mission, vehicle, and which area and time they need.

    ``free`` where the start may follow the currents; ``bundled`` where the mission is the bundled one.
    """

    mission: Mission
    vehicle: Vehicle
    position: tuple[float, float] | None
    start: float | None
    days: float
    box: tuple[float, float, float, float]
    period: tuple[float, float] | None
    free: bool
    bundled: bool


Fields = tuple[CurrentGrid | None, BathymetryGrid | None, WaterProfile | None]


def survey(options: Options) -> Survey:
    """Read mission and vehicle.

    Raises
    ------
    GliderJaxError : a file is missing, unreadable or wrong; the message says which and why.
    """
    if options.n < 1:
        raise ConfigError(f"--n: expected at least 1 member, found {options.n}.")
    if options.days is not None and not 0 < options.days <= 3650:
        raise ConfigError(f"--days: expected more than 0 and at most 3650, found {options.days:g}.")
    bundled = options.mission is None
    mission = (
        read_mission(bundled_path("missions/new_jersey.toml"))
        if bundled
        else read_mission(options.mission, decimal_degrees=options.decimal_degrees)
    )
    vehicle = read_vehicle(options.vehicle)
    position = options.start_position or mission.start_position
    if position is None and mission.waypoints:
        raise ConfigError(
            f"{mission.name}: expected a start position, found none in the mission. Give --start-position LAT LON."
        )
    days = options.days if options.days is not None else DEFAULT_DAYS
    start = options.start if options.start is not None else mission.start
    # Fields of other years may be tried with the bundled mission: its own start then means nothing.
    free = options.start is None and (bundled or mission.start is None) and bool(options.currents)
    period = None if start is None or free else (start, start + days * DAY)
    return Survey(mission, vehicle, position, start, days, reach_box(mission, position, days), period, free, bundled)


def read_fields(options: Options, bundled: bool, box, period) -> Fields:
    """Read currents, bathymetry and hydrography of an area and time, the bundled ones where the user gave none."""
    # One after the other: the netCDF library must not be used from two threads.
    return (
        _read_currents(options, bundled, box, period),
        _read_bathymetry(options, bundled, box),
        _read_water(options, box),
    )


def inputs_of(options: Options, known: Survey, fields: Fields) -> Inputs:
    """Mission, vehicle and fields together, with the start and the length that the currents allow."""
    grid, start, days = fields[0], known.start, known.days
    notes: list[str] = []
    if grid is not None and not grid.constant_in_time:
        if known.free and not (start is not None and grid.time[0] <= start <= grid.time[-1]):
            start = float(grid.time[0])
            notes.append(f"start set to the first time of the currents, {np.datetime64(int(start), 's')}Z")
        left = (float(grid.time[-1]) - start) / DAY if start is not None else days
        if options.days is None and 0 < left < days:
            days = left
            notes.append(f"the currents end after {left:.2f} days: the forecast ends there (--days asks for more)")
    return Inputs(known.mission, known.vehicle, *fields, start=start, days=days, notes=tuple(notes))


def read_inputs(options: Options) -> Inputs:
    """Read mission, vehicle and fields, the bundled ones where the user gave none.

    Raises
    ------
    GliderJaxError : a file is missing, unreadable or wrong; the message says which and why.
    """
    known = survey(options)
    return inputs_of(options, known, read_fields(options, known.bundled, known.box, known.period))


def _artificial(word: str, kinds, known) -> tuple[str, dict[str, float]] | None:
    """Kind and parameters of an artificial field written as ``kind:name=number,name=number``; None for a path."""
    kind, _, rest = word.partition(":")
    if kind not in kinds or Path(word).exists():
        return None
    given = dict(known)
    for item in filter(None, rest.split(",")):
        name, _, value = item.partition("=")
        try:
            given[name.strip()] = float(value)
        except ValueError as error:
            raise ConfigError(
                f"{word}: expected name=number after '{kind}:', found '{item}'. Example: uniform:east=0.1,north=0.05."
            ) from error
    return kind, given


def _area(box, period) -> dict[str, float]:
    """Centre, size and times of an artificial field that covers the box."""
    south, north, west, east = box
    middle = 0.5 * (south + north)
    area = {
        "latitude": middle,
        "longitude": 0.5 * (west + east),
        "height": (north - south) * 111e3,
        "width": (east - west) * 111e3 * math.cos(math.radians(middle)),
    }
    return area if period is None else area | {"start": period[0], "duration": period[1] - period[0] + DAY}


def _read_currents(options: Options, bundled: bool, box, period) -> CurrentGrid | None:
    from glider_jax.environment.synthetic import CURRENTS, synthetic_currents

    words = [str(p) for p in options.currents]
    made = _artificial(words[0], CURRENTS, _area(box, period)) if len(words) == 1 else None
    if words == ["none"]:
        grid = None
    elif made is not None:
        grid = synthetic_currents(made[0], **made[1])
    elif words or bundled:
        paths = list(options.currents) if words else [Path(bundled_path("new_jersey_currents.nc"))]
        own = options.grid if words else None

        def read() -> CurrentGrid:
            # Not needed, and slow to load, where the currents are kept.
            from glider_jax.readers.currents import read_currents

            return read_currents(paths, box=box, period=period, grid=own)

        asked = (box, period, own is not None)
        grid = kept_currents(options.cache, [*paths, *([own] if own is not None else [])], asked, read)
    else:
        grid = None
    return grid if options.tides is None else _with_tides(options, grid, box, period)


def _with_tides(options: Options, grid: CurrentGrid | None, box, period) -> CurrentGrid:
    from glider_jax.readers.tides import add_tides, read_tides, tidal_grid

    tides = read_tides(options.tides, grid=options.grid, box=box)
    if grid is not None and not grid.constant_in_time and grid.time.size > 1:
        return add_tides(grid, tides)
    if period is None:
        raise ConfigError("--tides: expected a start time or a series of currents, found neither. Give --start.")
    hours = np.arange(period[0], period[1] + 3600.0, 3600.0)
    return tidal_grid(tides, hours) if grid is None else add_tides(grid, tides, time=hours)


def _read_bathymetry(options: Options, bundled: bool, box) -> BathymetryGrid | None:
    from glider_jax.environment.synthetic import BATHYMETRY, synthetic_bathymetry
    from glider_jax.readers.bathymetry import read_bathymetry

    word = "" if options.bathymetry is None else str(options.bathymetry)
    made = _artificial(word, BATHYMETRY, _area(box, None))
    if word == "none":
        grid = None
    elif made is not None:
        grid = synthetic_bathymetry(made[0], **made[1])
    elif word:
        grid = read_bathymetry(options.bathymetry, box=box)
    else:
        grid = read_bathymetry(bundled_path("new_jersey_bathymetry.nc"), box=box) if bundled else None
    if options.seafloor_from:
        from glider_jax.readers.recordings import read_recording
        from glider_jax.readers.seafloor_tracks import seafloor_from_recordings

        grid = seafloor_from_recordings([read_recording(p) for p in options.seafloor_from], background=grid)
    return grid


def _read_water(options: Options, box) -> WaterProfile | None:
    if not options.hydrography:
        return None
    from glider_jax.readers.hydrography import read_water_profile

    # A second file is taken to be the hydrography's own grid, which may differ from that of the currents.
    own = len(options.hydrography) > 1
    return read_water_profile(list(options.hydrography), box=box, grid=None if own else options.grid)


def prepare_run(options: Options, inputs: Inputs, **fleet):
    """Tabulate the inputs: the :class:`~glider_jax.mission.forecast.Run` from which members are flown.

    ``fleet`` holds the frame and the run beside of :func:`~glider_jax.mission.forecast.prepare`.
    """
    import jax.numpy as jnp

    from glider_jax.mission.forecast import prepare
    from glider_jax.mission.speeds import choose_speeds, current_error

    if options.precision not in ("float32", "float64"):
        raise ConfigError(f"--precision: expected float32 or float64, found '{options.precision}'.")
    if options.precision == "float64":
        import jax

        jax.config.update("jax_enable_x64", True)
    nodes, told = choose_speeds(
        inputs.mission, inputs.vehicle, options.speed, kind=options.speed_kind,
        has_currents=inputs.currents is not None, file=options.speeds,
    )  # fmt: skip
    error, why = current_error(inputs.vehicle, options.speed, options.speed_kind, inputs.currents is not None)
    told += [why] if why else []
    run = prepare(
        inputs.mission, inputs.vehicle, currents=inputs.currents, bathymetry=inputs.bathymetry, water=inputs.water,
        speed=options.speed, speeds=nodes, duration=inputs.days * DAY, interval=options.interval, seed=options.seed,
        spread=options.spread, start=inputs.start, start_position=options.start_position,
        current_error=error, dtype=jnp.dtype(options.precision), **fleet,
    )  # fmt: skip
    notes = [*inputs.notes, *run.notes, *told, *_source_notes(inputs)]
    notes += [f"assumed for the vehicle: {text}" for text in inputs.vehicle.assumed]
    notes += [f"not simulated: {text}" for text in inputs.mission.unsupported]
    reserve = options.reserve if options.reserve is not None else inputs.vehicle.battery.reserve_fraction
    settings = run.settings | {
        "n": options.n, "speed_kind": options.speed_kind, "reserve_fraction": reserve,
        "terms": list(run.model.ids), "unsupported": list(inputs.mission.unsupported),
    }  # fmt: skip
    return replace(run, notes=tuple(dict.fromkeys(notes)), settings=settings)


def _source_notes(inputs: Inputs) -> list[str]:
    notes = []
    for label, record in (
        ("currents", inputs.currents), ("bathymetry", inputs.bathymetry), ("hydrography", inputs.water),
    ):  # fmt: skip
        if record is not None and record.source is not None:
            notes += [f"{label}: {text}" for text in record.source.notes]
    grid = inputs.currents
    if grid is not None and grid.filled > 0:
        notes.append(f"currents: {100 * grid.filled:.0f} % of the values were filled ({grid.fill_method})")
    return notes


def run_ensemble(
    options: Options,
    out: Path | None,
    progress: Callable[[int], None] | None = None,
    *,
    resume: bool = False,
    leads: bool = True,
    join: Callable[[], None] | None = None,
) -> Result:
    """Forecast and write the products.

    Parameters
    ----------
    out : folder of the products; None writes nothing.
    progress : called with the number of members flown so far.
    resume : take up the checkpoint that an interrupted run left in ``out``; the result is the same to the bit.
    leads : False in all but the first of several processes, which fly their share and write nothing.
    join : called when the inputs are read and nothing is on a device yet, to meet the other processes.

    Returns
    -------
    The summary and the files written. Above ``STREAM_ABOVE`` members each chunk is written and summarised before the
    next is flown, and the track returned is the first chunk alone.

    Raises
    ------
    DataError : there is nothing to resume, or it belongs to another forecast.
    """
    from glider_jax.products.running import fly_products

    inputs = read_inputs(options)
    polygons = read_polygons(options.polygons)
    if join is not None:
        join()
    run = prepare_run(options, inputs)
    whole, result, files = fly_products(run, options, out if leads else None, polygons, progress, resume=resume)
    if not leads:
        return Result({})
    if out is not None:
        files |= write_products(whole, result, inputs, out, options.outputs, options.style)
    return Result(result, files, whole)


def read_polygons(path: Path | None):
    """Areas of interest from a GeoJSON file, none without one."""
    if path is None:
        return ()
    from glider_jax.products import geojson

    return geojson.read_polygons(path)


def write_products(
    track: Track, summary: dict[str, Any], inputs: Inputs, out: Path, outputs, style: str = "screen"
) -> dict[str, Path]:
    """Write every product but the netCDF file and return their paths by kind; ``style`` is that of the figures."""
    files = {}
    if "json" in outputs:
        files["json"] = write_text(out / "summary.json", json.dumps(summary, indent=1, allow_nan=False) + "\n")
    if "geojson" in outputs:
        from glider_jax.products.geojson import write_geojson

        files["geojson"] = write_geojson(track, summary, out / "forecast.geojson")
    if "kmz" in outputs:
        from glider_jax.products.kml import write_kml

        files["kmz"] = write_kml(track, summary, out / "forecast.kmz")
    if "map" in outputs:
        from glider_jax.products.maps import plot_map

        files["map"] = plot_map(
            track, out / "map.png", bathymetry=inputs.bathymetry, currents=inputs.currents, summary=summary, style=style
        )
    if "battery" in outputs:
        from glider_jax.products.fan import plot_battery

        files["battery"] = plot_battery(track, out / "battery.png", summary=summary, style=style)
    if "html" in outputs:
        from glider_jax.products.html.forecast import Fields, write_report

        fields = Fields(inputs.bathymetry, inputs.currents)
        files["html"] = write_report(track, summary, out / "report.html", fields=fields)
    return files

