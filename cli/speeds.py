"""``glider-forecast speeds``: speed distributions from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, help="Speed distributions of dive segments.")


@app.callback()
def speeds() -> None:
    """Speed distributions of dive segments: over the ground and through the water, per degree of pitch."""


@app.command()
def fit(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings: each a file, or a folder of Slocum binaries.")],
    out: Annotated[Path, typer.Option(help="Folder for speeds.json.")] = Path("."),
    cache: Annotated[Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).")] = None,
    shortest_s: Annotated[float, typer.Option(min=0.0, help="Leave out segments under water for less.")] = 600.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the distributions as JSON.")] = False,
) -> None:
    """Fit speed distributions to the dive segments of recordings and write them to OUT/speeds.json.

    A segment runs from submerging to resurfacing. Use the file with: [speeds] file = "speeds.json" in a vehicle.
    """
    import json
    import math

    from glider_jax.mission.speeds_fit import fit_speeds, select_segments, to_json, write_speeds
    from glider_jax.readers.recordings import read_recording

    read = [read_recording(path, cache=cache) for path in recordings]
    for one in read:
        for repair in one.repairs:
            typer.echo(f"{one.name}: {repair.count} {repair.kind}", err=True)
    chosen = select_segments(read, shortest=shortest_s)
    fitted = fit_speeds(chosen)
    path = write_speeds(out / "speeds.json", fitted)
    for reason, count in chosen.excluded.items():
        typer.echo(f"left out: {count} segments, {reason}", err=True)
    if as_json:
        typer.echo(json.dumps(to_json(fitted) | {"excluded": chosen.excluded, "file": str(path)}))
        return
    rows = [
        (
            f"{math.degrees(one.pitch):.0f}",
            one.kind.replace("_", " "),
            f"{one.segments}",
            f"{one.distance / 1e3:.1f}",
            f"{one.duration / 86400.0:.2f}",
            f"{one.mean_per_time:.3f}",
            f"{one.quantile(0.05):.3f}",
            f"{one.quantile(0.5):.3f}",
            f"{one.quantile(0.95):.3f}",
        )
        for one in fitted
    ]
    heads = ("pitch deg", "kind", "segments", "km", "days", "mean m/s", "5 %", "50 %", "95 %")
    _table("Speed distributions", heads, rows)
    typer.echo(f"Written to {path}")


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Print a table: drawn on a terminal, tab-separated elsewhere."""
    import sys

    if not sys.stdout.isatty():
        typer.echo("\t".join(heads))
        for row in rows:
            typer.echo("\t".join(row))
        return
    from rich.console import Console
    from rich.table import Table

    drawn = Table(title=title)
    for head in heads:
        drawn.add_column(head, justify="right")
    for row in rows:
        drawn.add_row(*row)
    Console().print(drawn)
