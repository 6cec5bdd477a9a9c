"""``glider-forecast validate``: the published simulations flown again, the figures, and a flown mission compared."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

_INPUTS, _SIZE, _OUTPUT = "Inputs", "Size", "Output"


def validate(
    n: Annotated[int, typer.Option("--n", "-n", min=5, help="Members per row.", rich_help_panel=_SIZE)] = 200,
    seed: Annotated[int, typer.Option(help="Seed of all random draws.", rich_help_panel=_SIZE)] = 0,
    currents: Annotated[
        list[Path] | None,
        typer.Option(
            help="Currents of the published mission's days, if you have them. Default: bundled.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    bathymetry: Annotated[
        Path | None, typer.Option(help="Bathymetry file. Default: bundled.", rich_help_panel=_INPUTS)
    ] = None,
    flown: Annotated[
        Path | None,
        typer.Option(
            help="Recording of a flown mission, for simulate-versus-measure; needs --flown-mission.",
            rich_help_panel=_INPUTS,
        ),
    ] = None,
    flown_mission: Annotated[
        Path | None, typer.Option(help="The .mi file of that mission.", rich_help_panel=_INPUTS)
    ] = None,
    flown_vehicle: Annotated[
        str, typer.Option(help="Vehicle of that mission: TOML file or bundled name.", rich_help_panel=_INPUTS)
    ] = "slocum_g1_comet",
    figures: Annotated[bool, typer.Option(help="Draw the figures.", rich_help_panel=_OUTPUT)] = True,
    out: Annotated[Path, typer.Option(help="Folder of page, numbers and figures.", rich_help_panel=_OUTPUT)] = Path(
        "validation"
    ),
    html: Annotated[
        bool, typer.Option("--html", help="Write validation.html too: the report in one file.", rich_help_panel=_OUTPUT)
    ] = False,
    style: Annotated[
        str, typer.Option(help="Look of the figures: screen, print or paper.", rich_help_panel=_OUTPUT)
    ] = "screen",
    json_: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON.", rich_help_panel=_OUTPUT)] = False,
) -> None:
    """Fly the published simulations again and print paper, ours, difference and what is assumed.

    Examples:

    glider-forecast validate --out validation

    glider-forecast validate --n 50 --html --out validation
    """
    from glider_jax_cli.session import compiled_cache, progress_bar

    compiled_cache()
    import json

    from glider_jax.errors import ConfigError
    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.figure_style import style_of
    from glider_jax.products.validation_report import Options, run_validation

    style_of(style)
    if (flown is None) != (flown_mission is None):
        given, wanted = ("--flown", "--flown-mission") if flown else ("--flown-mission", "--flown")
        raise ConfigError(
            f"{given}: expected {wanted} beside it, found none. Give both, the recording and its .mi file."
        )
    options = Options(
        n=n, seed=seed, currents=tuple(currents or ()), bathymetry=bathymetry, flown=flown,
        flown_mission=flown_mission, flown_vehicle=flown_vehicle, figures=figures, html=html, style=style,
    )  # fmt: skip
    with termination_raises(), progress_bar("simulations", 8) as progress:
        result = run_validation(options, out, progress)
    print(json.dumps(result.numbers, allow_nan=False) if json_ else result.page)
    for kind, path in result.files.items():
        print(f"{kind}: {path}", file=sys.stderr)
