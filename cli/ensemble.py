"""``glider-forecast ensemble``: the main job."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

_INPUTS, _PHYSICS, _SCALE, _OUTPUT = "Inputs", "Physics and uncertainty", "Large ensembles", "Output"


def ensemble(
    n: Annotated[int, typer.Option("--n", "-n", help="Number of members.", rich_help_panel=_PHYSICS)] = 5000,
    mission: Annotated[
        list[Path] | None,
        typer.Option(
            help="Mission: TOML file, Slocum .mi file, or its folder; several are a fleet. Default: bundled one.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle: TOML file or the name of a bundled one.", rich_help_panel=_INPUTS)
    ] = None,
    currents: Annotated[
        list[str] | None,
        typer.Option(
            help="Currents: files of one product, a folder, 'none', or artificial, as uniform:east=0.1,north=0.05.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    bathymetry: Annotated[
        Path | None,
        typer.Option(
            help="Bathymetry file, 'none', or artificial, as sloping:depth=60,slope=0.001.", rich_help_panel=_INPUTS
        ),
    ] = None,
    seafloor_from: Annotated[
        list[Path] | None,
        typer.Option(help="Recordings whose measured water depths are the seafloor.", rich_help_panel=_INPUTS),
    ] = None,
    hydrography: Annotated[
        list[Path] | None,
        typer.Option(
            help="Temperature and salinity, for --speed flight; a ROMS file may be followed by its own grid file.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    tides: Annotated[
        Path | None, typer.Option(help="ROMS tide forcing added to the currents.", rich_help_panel=_INPUTS)
    ] = None,
    grid: Annotated[
        Path | None, typer.Option(help="Grid file of a native ROMS product.", rich_help_panel=_INPUTS)
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Start, UTC, ISO 8601; default: the mission's.", rich_help_panel=_INPUTS)
    ] = None,
    start_position: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Start, decimal degrees: LAT LON.", rich_help_panel=_INPUTS),
    ] = None,
    decimal_degrees: Annotated[
        bool, typer.Option(help="Waypoints of .ma files are decimal degrees.", rich_help_panel=_INPUTS)
    ] = False,
    days: Annotated[
        float | None,
        typer.Option(help="Days to forecast; default 15, or to the end of the currents.", rich_help_panel=_PHYSICS),
    ] = None,
    speed: Annotated[
        str, typer.Option(help="Speed model: shoebox, distribution or flight.", rich_help_panel=_PHYSICS)
    ] = "distribution",
    speed_kind: Annotated[
        str,
        typer.Option(help="Distribution: over_ground, through_water or auto.", rich_help_panel=_PHYSICS),
    ] = "auto",
    speeds: Annotated[
        Path | None, typer.Option(help="Speed file made by 'speeds fit'.", rich_help_panel=_PHYSICS)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random draws.", rich_help_panel=_PHYSICS)] = 0,
    spread: Annotated[
        float,
        typer.Option(min=0.0, help="Factor on every perturbation; 0 flies one mission.", rich_help_panel=_PHYSICS),
    ] = 1.0,
    reserve: Annotated[
        float | None,
        typer.Option(min=0.0, max=1.0, help="Share of the charge a pilot wants left.", rich_help_panel=_PHYSICS),
    ] = None,
    polygons: Annotated[
        Path | None, typer.Option(help="GeoJSON areas whose entry is of interest.", rich_help_panel=_PHYSICS)
    ] = None,
    precision: Annotated[str, typer.Option(help="float32 or float64.", rich_help_panel=_PHYSICS)] = "float32",
    processes: Annotated[
        int, typer.Option(help="Processes that fly together; all on this machine unless told.", rich_help_panel=_SCALE)
    ] = 1,
    coordinator: Annotated[
        str | None, typer.Option(help="HOST:PORT where the processes meet, the first one's.", rich_help_panel=_SCALE)
    ] = None,
    process_id: Annotated[
        int | None, typer.Option(help="Which process this is, from 0; SLURM's by itself.", rich_help_panel=_SCALE)
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted forecast in --out.", rich_help_panel=_SCALE)
    ] = False,
    interval_h: Annotated[
        float | None, typer.Option(help="Hours between outputs; default about 120 outputs.", rich_help_panel=_OUTPUT)
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the products.", rich_help_panel=_OUTPUT)] = Path("forecast"),
    formats: Annotated[
        str,
        typer.Option(
            "--format", help="Products: nc,json,geojson,kmz,map,battery,html, or 'all' but html.",
            rich_help_panel=_OUTPUT,
        ),
    ] = "all",
    html: Annotated[
        bool,
        typer.Option("--html", help="Write report.html too: map and report in one file.", rich_help_panel=_OUTPUT),
    ] = False,
    style: Annotated[
        str, typer.Option(help="Look of the figures: screen, print or paper.", rich_help_panel=_OUTPUT)
    ] = "screen",
    json_: Annotated[
        bool, typer.Option("--json", help="Print the summary as JSON on standard output.", rich_help_panel=_OUTPUT)
    ] = False,
) -> None:
    """Forecast surfacing positions and battery depletion with an ensemble of missions.

    Examples:

    glider-forecast ensemble --n 5000 --out forecast

    glider-forecast ensemble --mission mission.toml --currents hfr.nc --bathymetry etopo.nc --html
    """
    from glider_jax_cli.processes import Processes
    from glider_jax_cli.session import cache_folder, compiled_cache, progress_bar

    compiled_cache()
    import json
    from datetime import UTC, datetime

    from glider_jax.errors import ConfigError, did_you_mean
    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.figure_style import style_of
    from glider_jax.products.job import Options, run_ensemble

    style_of(style)
    outputs = Options().outputs
    known = outputs | {"html"}
    if formats != "all":
        outputs = frozenset(word.strip() for word in formats.split(",") if word.strip())
        for word in sorted(outputs - known):
            raise ConfigError(
                f"--format: expected words of {', '.join(sorted(known))}, found '{word}'.{did_you_mean(word, known)}"
            )
    if html:
        outputs |= {"html"}
    begin = None
    if start is not None:
        try:
            moment = datetime.fromisoformat(start)
        except ValueError as error:
            raise ConfigError(
                f"--start: expected a time such as 2009-09-05T12:00:00Z, found '{start}'. Give ISO 8601, UTC."
            ) from error
        begin = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    options = Options(
        n=n, mission=mission[0] if mission else None, vehicle=_vehicle(vehicle),
        currents=tuple(Path(p) for p in currents or ()),
        bathymetry=bathymetry, seafloor_from=tuple(seafloor_from or ()),
        hydrography=tuple(hydrography or ()), tides=tides, grid=grid, speed=speed,
        speed_kind=speed_kind, speeds=speeds, seed=seed, days=days, start=begin, start_position=start_position,
        interval=None if interval_h is None else interval_h * 3600.0, polygons=polygons, reserve=reserve,
        spread=spread, precision=precision, decimal_degrees=decimal_degrees, outputs=outputs, style=style,
        cache=cache_folder() / "fields",
    )  # fmt: skip
    if mission and len(mission) > 1:
        if processes > 1 or resume:
            raise ConfigError("--mission: expected one for --processes and --resume, found several. Leave these out.")
        _fleet(options, mission, out, json_)
        return
    with (
        termination_raises(),
        Processes(processes, coordinator, process_id) as group,
        progress_bar("members", n) as progress,
    ):
        result = run_ensemble(options, out, progress, resume=resume, leads=group.leads, join=group.join)
    if not group.leads:
        return
    if json_:
        print(json.dumps(result.summary, allow_nan=False))
    else:
        from rich.console import Console

        from glider_jax.products.tables import print_summary

        print_summary(result.summary, Console())
    for kind, path in result.files.items():
        print(f"{kind}: {path}", file=sys.stderr)


def _fleet(options, missions: list[Path], out: Path, as_json: bool) -> None:
    """Forecast several missions and print them one after the other."""
    import json

    from rich.console import Console

    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.fleet import overview, run_fleet
    from glider_jax.products.tables import print_summary
    from glider_jax_cli.session import progress_bar

    with termination_raises(), progress_bar("members", options.n * len(missions)) as progress:
        results = run_fleet(options, missions, out, progress)
    if as_json:
        print(json.dumps(overview(results), allow_nan=False))
        return
    for name, result in results.items():
        print(f"== {name} ==")
        print_summary(result.summary, Console())
    print(f"fleet: {out / 'fleet.json'}", file=sys.stderr)


def _vehicle(name: str | None):
    """A bundled vehicle by its name, else a path."""
    from glider_jax.readers.vehicles import presets

    return name if name is None or name in presets() else Path(name)
