"""``glider-forecast diagnose``: what physics a base model left out of a recording, and how well it fits with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer


def diagnose(
    recording: Annotated[
        list[Path],
        typer.Argument(
            help="Files of one glider's recording, or a folder with recording.nc and its companions."
        ),
    ],
    vehicle: Annotated[
        Path | None, typer.Option(help="Vehicle file of the base model (TOML); else the bundled one.")
    ] = None,
    mission: Annotated[Path | None, typer.Option(help="Mission flown: TOML, .mi, or a folder.")] = None,
    currents: Annotated[
        list[Path] | None, typer.Option(help="Current product that the forecast used; may be repeated.")
    ] = None,
    bathymetry: Annotated[Path | None, typer.Option(help="Water depth.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the report and its files.")] = Path("diagnosis"),
    cache: Annotated[Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).")] = None,
    stream: Annotated[
        list[str] | None,
        typer.Option(help="Look at this measurement alone, as vertical_speed; may be repeated."),
    ] = None,
    hindcast: Annotated[
        Path | None, typer.Option(help="hindcast.json of the same recording: explain its misses.")
    ] = None,
    fly: Annotated[
        int,
        typer.Option(min=0, help="Members that fly the mission with and without what was named; 0: none."),
    ] = 100,
    whole: Annotated[
        bool, typer.Option("--whole", help="Take a recording with a long hole as one mission.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print diagnosis.json.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Locate the mismatch between model and recording, name what was left out, model it, show the fit improve."""
    import json

    from glider_jax_cli.session import compiled_cache

    compiled_cache(flying=False)
    from glider_jax.diagnosis.run import diagnose as run

    given = _given(recording, vehicle, mission, currents, bathymetry, cache)
    if hindcast is not None:
        from glider_jax.diagnosis.misses import read_cases

        given["misses"] = read_cases(hindcast)
    with stages(not quiet) as tell:
        content = run(out=out, progress=tell, streams=stream, fly=fly, whole=whole, **given)
    if as_json:
        typer.echo(json.dumps(content, allow_nan=False))
    else:
        _show(content, out)


def _given(recording, vehicle, mission, currents, bathymetry, cache) -> dict[str, Any]:
    """Records named on the command line; a folder with ``recording.nc`` brings its companions."""
    from glider_jax.readers.bathymetry import read_bathymetry
    from glider_jax.readers.currents import read_currents
    from glider_jax.readers.missions import read_mission
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import read_vehicle

    given: dict[str, Any] = {}
    if len(recording) == 1 and (recording[0] / "recording.nc").exists():
        given["folder"] = recording[0]
    else:
        given["recording"] = read_recording(recording, cache=cache)
        if vehicle is None:
            given["vehicle"] = read_vehicle(None)
    if vehicle is not None:
        given["vehicle"] = read_vehicle(str(vehicle) if not vehicle.exists() else vehicle)
    if mission is not None:
        given["mission"] = read_mission(mission)
    if currents:
        given["currents"] = read_currents(currents if len(currents) > 1 else currents[0])
    if bathymetry is not None:
        given["bathymetry"] = read_bathymetry(bathymetry)
    return given


#: What a diagnosis says it is doing, and the share of its time that is over by then.
STAGES = (
    ("reading", 0.0), ("measurements", 0.05), ("derivatives", 0.1), ("accepted", 0.4), ("held-out", 0.65),
    ("what is left", 0.75), ("ensemble", 0.85),
)  # fmt: skip


@contextmanager
def stages(wanted: bool) -> Iterator[Callable[[str], None] | None]:
    """A bar on standard error that says what is being done, while a terminal watches; else nothing."""
    import sys

    if not wanted or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("diagnosis"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def tell(text: str) -> None:
            share = next((share for word, share in reversed(STAGES) if word in text), None)
            bar.update(task, description=text[:70], completed=share)

        yield tell


def _show(content: dict[str, Any], out: Path) -> None:
    for line in content["warnings"]:
        typer.echo(f"note: {line}", err=True)
    typer.echo(content["summary"])
    for effect in content["effects"]:
        typer.echo(f"  {effect['id']}: {effect['plain']}")
        for one in (
            effect["parameters"][:2] if effect["id"] == "navigation.mean_current" else effect["parameters"]
        ):
            shown = one["shown"]
            low, high = shown["interval_90"]
            typer.echo(
                f"    {one['text']}: {shown['value']:.4g} {shown['unit']} (90 %: {low:.4g} to {high:.4g})"
            )
        held = effect["held_out"]["gain"]
        gained = "" if held is None else f", held-out gain {held:.1f} nats"
        typer.echo(f"    evidence {effect['evidence']:.1f} nats{gained}")
        for other in effect["alternatives"]:
            typer.echo(f"    as well explained by: {other['title'].lower()} ({other['id']})")
        if effect["alternatives"] and effect["class"]["decided_by"]:
            typer.echo(f"    would decide: {effect['class']['decided_by']}")
    for row in (content.get("flow") or {}).get("later", []):
        typer.echo(
            f"  flow: {row['predicted']} later segments from the first {row['fitted']}: median miss "
            f"{row['before_m']:.0f} m without, {row['after_m']:.0f} m with it"
        )
    flown = content.get("ensemble")
    if flown:
        before, after = flown["before"], flown["after"]
        typer.echo(
            f"  ensemble of {flown['members']}, {flown['surfacings']} surfacings in {flown['hours']:.0f} h: misses by "
            f"{before['position_error_m']:.0f} m before, {after['position_error_m']:.0f} m after; "
            f"{before['charge_ah_per_day']:.2f} and {after['charge_ah_per_day']:.2f} Ah a day"
            + (
                f", recorded {flown['recorded_charge_ah_per_day']:.2f}"
                if flown["recorded_charge_ah_per_day"] is not None
                else ""
            )
        )
    missed = content.get("forecast_misses")
    if missed:
        typer.echo(f"  {missed['sentence']}")
    for line in (*content["missing"], *content["notes"]):
        typer.echo(f"note: {line}", err=True)
    typer.echo(f"{out / 'report.html'} ({content['seconds']:.0f} s)")
