"""``glider-forecast mission``: look at a mission and its program, and write it as Slocum files for a pilot."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True)

_Mission = Annotated[
    Path | None,
    typer.Argument(help="Mission: TOML file, Slocum .mi file, or its folder. Default: bundled New Jersey mission."),
]
_Degrees = Annotated[bool, typer.Option(help="Waypoints of .ma files are decimal degrees.")]


@app.command()
def show(mission: _Mission = None, decimal_degrees: _Degrees = False) -> None:
    """Check a mission and print it as TOML, its program included.

    Example: glider-forecast mission show mission.toml
    """
    from glider_jax.readers.missions import mission_toml, read_mission

    found = read_mission(mission, decimal_degrees=decimal_degrees)
    print(mission_toml(found), end="")
    for text in found.notes:
        print(f"note: {text}", file=sys.stderr)
    for text in found.unsupported:
        print(f"not simulated: {text}", file=sys.stderr)


@app.command()
def export(
    mission: _Mission = None,
    out: Annotated[Path, typer.Option(help="Local folder for the .mi and .ma files.")] = Path("slocum"),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that are there.")] = False,
    decimal_degrees: _Degrees = False,
    json_: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Write a mission as .mi and .ma files to a local folder, and say what Slocum cannot express and why.

    The files are a draft for a pilot: check them before they fly. Nothing is sent anywhere.

    Example: glider-forecast mission export mission.toml --out slocum
    """
    import json

    from glider_jax.readers.missions import read_mission
    from glider_jax.readers.slocum_writer import write_slocum_mission

    found = read_mission(mission, decimal_degrees=decimal_degrees)
    done = write_slocum_mission(found, out, overwrite=overwrite)
    if json_:
        entry = {
            "files": [str(path) for path in done.files], "expressed": list(done.expressed),
            "not_expressed": list(done.left_out),
        }  # fmt: skip
        print(json.dumps(entry))
        return
    for path in done.files:
        print(path)
    for text in done.expressed:
        print(f"expressed: {text}")
    for text in done.left_out:
        print(f"not expressed: {text}")
