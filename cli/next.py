"""``glider-forecast next``: when and where the glider surfaces next, and how long its battery lasts."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

STALE = 3
_INPUTS, _SETTINGS, _OUTPUT = "Inputs", "Settings", "Output"


def next_surfacing(
    dialog: Annotated[
        list[Path] | None,
        typer.Option(help="Surface dialog log or gliderState.xml; may be repeated.", rich_help_panel=_INPUTS),
    ] = None,
    recording: Annotated[
        list[Path] | None,
        typer.Option(
            help="Recording: files or folder (sbd, tbd, netCDF); may be repeated.", rich_help_panel=_INPUTS
        ),
    ] = None,
    cache: Annotated[
        Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).", rich_help_panel=_INPUTS)
    ] = None,
    mission: Annotated[
        Path | None, typer.Option(help="Mission: folder, .mi or TOML file.", rich_help_panel=_INPUTS)
    ] = None,
    decimal_degrees: Annotated[
        bool, typer.Option(help="Waypoints of .ma files are decimal degrees.", rich_help_panel=_INPUTS)
    ] = False,
    vehicle: Annotated[
        str | None,
        typer.Option(help="Vehicle: TOML file or the name of a bundled one.", rich_help_panel=_INPUTS),
    ] = None,
    glider: Annotated[
        str | None,
        typer.Option(help="Name of the glider, where dialogs hold several.", rich_help_panel=_INPUTS),
    ] = None,
    currents: Annotated[
        list[Path] | None, typer.Option(help="Current product to blend in.", rich_help_panel=_INPUTS)
    ] = None,
    bathymetry: Annotated[Path | None, typer.Option(help="Bathymetry file.", rich_help_panel=_INPUTS)] = None,
    variation_deg: Annotated[
        float | None,
        typer.Option(
            help="Magnetic variation, west positive; else recorded or worked out.", rich_help_panel=_INPUTS
        ),
    ] = None,
    charge_used_ah: Annotated[
        float | None,
        typer.Option(min=0.0, help="Charge used since the pack was new.", rich_help_panel=_INPUTS),
    ] = None,
    capacity_ah: Annotated[
        float | None, typer.Option(min=1.0, help="Capacity of the pack.", rich_help_panel=_INPUTS)
    ] = None,
    now: Annotated[
        str | None,
        typer.Option(
            help="Time of the forecast, UTC, or 'data' for the newest evidence.", rich_help_panel=_SETTINGS
        ),
    ] = None,
    stale_h: Annotated[
        float | None,
        typer.Option(min=0.0, help="Refuse fixes older than this (exit code 3).", rich_help_panel=_SETTINGS),
    ] = None,
    n: Annotated[int, typer.Option("--n", "-n", help="Number of members.", rich_help_panel=_SETTINGS)] = 2000,
    hours: Annotated[float, typer.Option(help="Hours to forecast.", rich_help_panel=_SETTINGS)] = 48.0,
    seed: Annotated[int, typer.Option(help="Seed of all random draws.", rich_help_panel=_SETTINGS)] = 0,
    reserve: Annotated[
        float | None,
        typer.Option(min=0.0, max=1.0, help="Share of the charge to be left.", rich_help_panel=_SETTINGS),
    ] = None,
    way_home_h: Annotated[
        float, typer.Option(min=0.0, help="Hours from deciding to recovering.", rich_help_panel=_SETTINGS)
    ] = 0.0,
    watch: Annotated[
        float | None,
        typer.Option(
            min=1.0, help="Look for changed inputs every so many seconds.", rich_help_panel=_SETTINGS
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder of products and frozen forecasts.", rich_help_panel=_OUTPUT)
    ] = Path("next"),
    formats: Annotated[
        str, typer.Option("--format", help="Besides JSON: nc,geojson,kmz,html.", rich_help_panel=_OUTPUT)
    ] = "",
    html: Annotated[
        bool,
        typer.Option("--html", help="Write next.html too: map and report in one file.", rich_help_panel=_OUTPUT),
    ] = False,
    json_: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON.", rich_help_panel=_OUTPUT)
    ] = False,
) -> None:
    """Forecast the next surfacing from what was heard last.

    Examples:

    glider-forecast next --dialog unit.log --mission missions --recording from-glider

    glider-forecast next --recording from-glider --now data --bathymetry etopo.nc --html
    """
    from glider_jax_cli.session import compiled_cache

    compiled_cache()
    import math

    from glider_jax.errors import ConfigError, GliderJaxError, did_you_mean
    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.live_inputs import Options
    from glider_jax.products.live_inputs import watch as watch_files
    from glider_jax.products.next_surfacing import run_next
    from glider_jax.readers.live_state import StaleFix
    from glider_jax.readers.vehicles import presets

    known = ("nc", "geojson", "kmz", "html")
    outputs = frozenset(word.strip() for word in formats.split(",") if word.strip())
    for word in sorted(outputs - set(known)):
        raise ConfigError(
            f"--format: expected words of {', '.join(known)}, found '{word}'.{did_you_mean(word, known)}"
        )
    if html:
        outputs |= {"html"}
    options = Options(
        dialogs=tuple(dialog or ()), recordings=tuple(recording or ()), cache=cache, mission=mission,
        decimal_degrees=decimal_degrees, vehicle=vehicle if vehicle is None or vehicle in presets() else Path(vehicle),
        glider=glider, currents=tuple(currents or ()), bathymetry=bathymetry,
        variation=None if variation_deg is None else math.radians(variation_deg), now=_moment(now),
        stale=None if stale_h is None else stale_h * 3600.0, members=n, hours=hours, seed=seed,
        charge_used=None if charge_used_ah is None else charge_used_ah * 3600.0,
        capacity=None if capacity_ah is None else capacity_ah * 3600.0, reserve=reserve, way_home=way_home_h * 3600.0,
        outputs=outputs,
    )  # fmt: skip

    def once() -> None:
        result = run_next(options, out)
        for text in result["warnings"]:
            print(f"warning: {text}", file=sys.stderr)
        if json_:
            import json

            print(json.dumps(result, allow_nan=False), flush=True)
        else:
            show(result)
        for kind, path in result["files"].items():
            print(f"{kind}: {path}", file=sys.stderr)

    def guarded() -> None:
        try:
            once()
        except GliderJaxError as error:
            print(f"error: {error}", file=sys.stderr)

    try:
        with termination_raises():
            if watch is None:
                once()
            else:
                watch_files([*options.dialogs, *options.recordings], watch, guarded)
    except StaleFix as error:
        print(f"error: {error}", file=sys.stderr)
        raise typer.Exit(STALE) from error
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _moment(text: str | None) -> float | None:
    from datetime import UTC, datetime

    from glider_jax.errors import ConfigError

    if text is None:
        return None
    if text == "data":
        return float("nan")
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError as error:
        raise ConfigError(
            f"--now: expected a UTC time such as 2026-03-28T20:45Z or 'data', found '{text}'."
        ) from error
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def show(result: dict[str, Any]) -> None:
    """Print what a pilot needs first, in plain lines."""
    one, outlook, inputs = result["next"], result["outlook"], result["inputs"]
    hours, times = one["hours_from_now"], one["time"]
    print(f"{inputs['glider']}: fix {one['fix']['time']} at {one['fix']['text']}, dives {one['dives']}")
    print(f"next first fix: {times['median']} (in {hours['median']:.2f} h)")
    print(f"  50 %: {times['p25']} to {times['p75']}    90 %: {times['p05']} to {times['p95']}")
    print(f"  at {one['place']['text']} ({one['place']['latitude']:.5f}, {one['place']['longitude']:.5f})")
    print(
        f"  {one['distance_km']:.2f} km ({one['distance_nm']:.2f} nm) toward {one['bearing_true_deg']:.0f} T"
    )
    for region in one["regions"]:
        print(f"  {100 * region['probability']:.0f} % region: {region['area_km2']:.2f} km2")
    print("  because: " + ", ".join(f"{r['reason']} {100 * r['probability']:.0f} %" for r in one["reasons"]))
    current = one["current"]
    print(
        f"current: {current['east']:+.3f} east {current['north']:+.3f} north +- {current['sd']:.3f} m/s",
        end="",
    )
    print(
        f" from {current['observations']} dives; speed through the water {one['speed_through_water']:.3f} m/s"
    )
    for place in result["positions"]:
        if place["place"] is not None:
            print(f"at {place['hours']:.0f} h: {place['place']['text']}")
    for point in result["waypoints"][:1]:
        when = point["time"]["median"]
        chance = 100 * point["probability"]
        print(
            f"waypoint {point['place']['text']}: reached with {chance:.0f} %"
            + (f", median {when}" if when else "")
        )
    rate = outlook["ah_per_day"]
    if rate["total"]["median"] is not None:
        print(f"battery: {rate['total']['median']:.2f} Ah/day ({rate['from']}), ", end="")
        left = outlook["charge_left_percent"]
        print("charge left not known" if left is None else f"{left:.1f} % left, {outlook['status']}")
    for level in outlook["levels"]:
        dates = level["time"]
        print(
            f"  {level['charge_left_percent']:.0f} % on {dates['median']} (90 %: {dates['p05']} to {dates['p95']})"
        )
    if outlook["last_safe_recovery"]:
        print(f"  last safe recovery: {outlook['last_safe_recovery']['time']}")
    if result["scored"]:
        past = result["scored"]
        print(
            f"last forecast ({past['issued']}): {past['error_km']:.2f} km off, inside 90 %: {past['inside90']}"
        )
    ages = ", ".join(f"{name} {age:.2f} h" for name, age in inputs["ages_h"].items() if age is not None)
    print(f"ages: {ages}", file=sys.stderr)
    for text in [*inputs["assumed"], *outlook["notes"]]:
        print(f"assumed: {text}", file=sys.stderr)
    for text in inputs["repairs"]:
        print(f"repaired: {text}", file=sys.stderr)
