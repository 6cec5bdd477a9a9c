"""``glider-forecast plan``: choices weighed before a mission flies."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

_INPUTS, _CHOICE, _SIZE = "Inputs", "What is weighed", "Size and output"


def plan(
    mission: Annotated[
        Path | None,
        typer.Argument(help="Mission: TOML file, Slocum .mi file, or its folder. Default: bundled New Jersey mission."),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="A choice and its values, preferred first, as pitch=20,26,32; once per choice. Known: pitch, "
            "dive_to, climb_to, altitude, volume_cc, surface_every_h, surface_stay_min, ctd_every_s, start_h, "
            "battery, instrument, order (given, reversed, or numbers such as 2-1-3).",
            rich_help_panel=_CHOICE,
        ),
    ] = None,
    goal: Annotated[
        str, typer.Option(help="Best in: km, profiles, contacts, days or energy.", rich_help_panel=_CHOICE)
    ] = "km",
    confidence: Annotated[
        float, typer.Option(help="Least probability of success of what is recommended.", rich_help_panel=_CHOICE)
    ] = 0.9,
    reserve: Annotated[
        float | None,
        typer.Option(min=0.0, max=1.0, help="Share of the charge to be left.", rich_help_panel=_CHOICE),
    ] = None,
    by_days: Annotated[
        float | None, typer.Option(min=0.0, help="Arrive within so many days.", rich_help_panel=_CHOICE)
    ] = None,
    days: Annotated[float, typer.Option(help="Days to fly at most.", rich_help_panel=_CHOICE)] = 30.0,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop", help="Fly the waypoints over and over until the days are over.", rich_help_panel=_CHOICE
        ),
    ] = False,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle: TOML file or the name of a bundled one.", rich_help_panel=_INPUTS)
    ] = None,
    devices: Annotated[
        str | None,
        typer.Option(
            help="Devices to add, by names of the catalogue, or 'none'. Default: the usual ones and a CTD where the "
            "vehicle names none.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    currents: Annotated[
        list[str] | None,
        typer.Option(help="Currents: files, or artificial. Default: unknown ones.", rich_help_panel=_INPUTS),
    ] = None,
    bathymetry: Annotated[Path | None, typer.Option(help="Bathymetry file or 'none'.", rich_help_panel=_INPUTS)] = None,
    hydrography: Annotated[
        list[Path] | None, typer.Option(help="Temperature and salinity.", rich_help_panel=_INPUTS)
    ] = None,
    start: Annotated[str | None, typer.Option(help="Start, UTC, ISO 8601.", rich_help_panel=_INPUTS)] = None,
    start_position: Annotated[
        tuple[float, float] | None, typer.Option(help="Start, decimal degrees: LAT LON.", rich_help_panel=_INPUTS)
    ] = None,
    decimal_degrees: Annotated[
        bool, typer.Option(help="Waypoints of .ma files are decimal degrees.", rich_help_panel=_INPUTS)
    ] = False,
    speed: Annotated[
        str, typer.Option(help="Speed model: flight answers to pitch and volume.", rich_help_panel=_INPUTS)
    ] = "flight",
    n: Annotated[int, typer.Option("--n", "-n", min=2, help="Members per setting.", rich_help_panel=_SIZE)] = 100,
    seed: Annotated[int, typer.Option(help="Seed of all random draws.", rich_help_panel=_SIZE)] = 0,
    tornado: Annotated[bool, typer.Option(help="Find what the answer hangs on.", rich_help_panel=_SIZE)] = True,
    out: Annotated[Path, typer.Option(help="Folder of page, numbers and figures.", rich_help_panel=_SIZE)] = Path(
        "plan"
    ),
    html: Annotated[
        bool, typer.Option("--html", help="Write plan.html too: the report in one file.", rich_help_panel=_SIZE)
    ] = False,
    style: Annotated[
        str, typer.Option(help="Look of the figures: screen, print or paper.", rich_help_panel=_SIZE)
    ] = "screen",
    json_: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON.", rich_help_panel=_SIZE)] = False,
) -> None:
    """Weigh mission duration, speed, sensing and energy: fly every combination of choices and recommend one.

    Examples:

    glider-forecast plan --loop --vary pitch=18,22,26 --vary battery=alkaline,lithium_primary_3s

    glider-forecast plan mission.toml --vary dive_to=30,60,100 --goal days --html
    """
    from glider_jax_cli.session import compiled_cache, progress_bar

    compiled_cache()
    import json
    from datetime import UTC, datetime

    from glider_jax.errors import ConfigError
    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.figure_style import style_of
    from glider_jax.products.job import Options
    from glider_jax.products.planning_report import PlanOptions, count_settings, run_plan

    style_of(style)
    begin = None
    if start is not None:
        try:
            moment = datetime.fromisoformat(start)
        except ValueError as error:
            raise ConfigError(f"--start: expected a time such as 2009-09-05T12:00:00Z, found '{start}'.") from error
        begin = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    inputs = Options(
        n=n, mission=mission, vehicle=_vehicle(vehicle), currents=tuple(Path(p) for p in currents or ("none",)),
        bathymetry=bathymetry, hydrography=tuple(hydrography or ()), speed=speed, seed=seed, days=days, start=begin,
        start_position=start_position, reserve=reserve, decimal_degrees=decimal_degrees,
    )  # fmt: skip
    added = None
    if devices is not None:
        added = () if devices == "none" else tuple(word.strip() for word in devices.split(",") if word.strip())
    options = PlanOptions(
        inputs=inputs, vary=tuple(vary or ()), devices=added, loop=loop, by_days=by_days, goal=goal,
        confidence=confidence, tornado=tornado, html=html, style=style,
    )  # fmt: skip
    with termination_raises(), progress_bar("settings", count_settings(options.vary)) as progress:
        result = run_plan(options, out, progress)
    print(json.dumps(result.numbers, allow_nan=False) if json_ else result.page)
    for kind, path in result.files.items():
        print(f"{kind}: {path}", file=sys.stderr)


def _vehicle(name: str | None):
    """A bundled vehicle by its name, else a path."""
    from glider_jax.readers.vehicles import presets

    return name if name is None or name in presets() else Path(name)
