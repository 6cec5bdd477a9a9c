"""``glider-forecast diagnose``: what physics a base model left out of a recording, and how well it fits with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def diagnose(
    recording: Annotated[
        list[Path],
        typer.Argument(help="Files of one glider's recording, or a folder with recording.nc and its companions."),
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
    as_json: Annotated[bool, typer.Option("--json", help="Print diagnosis.json.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Locate the mismatch between model and recording, name what was left out, model it, show the fit improve."""
    import json
    import sys

    from glider_jax.diagnosis.run import diagnose as run

    given = _given(recording, vehicle, mission, currents, bathymetry, cache)
    tell = None if quiet or not sys.stderr.isatty() else _progress()
    content = run(out=out, progress=tell, **given)
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


def _progress():
    import time

    began = time.perf_counter()

    def tell(text: str) -> None:
        typer.echo(f"[{time.perf_counter() - began:5.1f} s] {text}", err=True)

    return tell


def _show(content: dict[str, Any], out: Path) -> None:
    typer.echo(content["summary"])
    for effect in content["effects"]:
        typer.echo(f"  {effect['id']}: {effect['plain']}")
        for one in effect["parameters"]:
            shown = one["shown"]
            low, high = shown["interval_90"]
            typer.echo(f"    {one['text']}: {shown['value']:.4g} {shown['unit']} (90 %: {low:.4g} to {high:.4g})")
        held = effect["held_out"]
        typer.echo(f"    evidence {effect['evidence']:.1f} nats, held-out gain {held['gain']:.1f} nats")
        for other in effect["alternatives"]:
            typer.echo(f"    as well explained by: {other['title'].lower()} ({other['id']})")
        if effect["alternatives"] and effect["class"]["decided_by"]:
            typer.echo(f"    would decide: {effect['class']['decided_by']}")
    for line in (*content["missing"], *content["notes"]):
        typer.echo(f"note: {line}", err=True)
    typer.echo(f"{out / 'report.html'} ({content['seconds']:.0f} s)")
