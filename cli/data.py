"""``glider-forecast data``: public sources listed, and a mission's box of one fetched by name."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True)


@app.callback()
def data() -> None:
    """List and fetch public currents, seafloor and recordings."""


@app.command(name="list")
def list_(json_: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False) -> None:
    """Show the sources and what was fetched before.

    Example:

    glider-forecast data list
    """
    import json
    from dataclasses import asdict

    from glider_jax.products.fetching import cache_folder, held
    from glider_jax.products.public_sources import SOURCES

    here = held()
    if json_:
        print(json.dumps({"sources": [asdict(s) for s in SOURCES.values()], "fetched": here}, allow_nan=False))
        return
    for source in SOURCES.values():
        use = f"for {source.option}" if source.option else ""
        print(f"{source.name:14} {source.title} ({use})")
        print(f"{'':14} {source.server}, {source.dataset or 'one data set per deployment: --dataset'}")
    print(f"\nfetched before, in {cache_folder()}:" if here else "\nnothing was fetched before")
    for told in here:
        print(f"  {told['fetched']}  {told['bytes'] / 1e6:8.2f} MB  {told['path']}")


@app.command()
def fetch(
    name: Annotated[str, typer.Argument(help="Source, as 'data list' names it.")],
    box: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(help="Degrees: SOUTH NORTH WEST EAST. Default: what the mission can reach."),
    ] = None,
    mission: Annotated[
        Path | None, typer.Option(help="Mission whose box and start are taken. Default: bundled New Jersey mission.")
    ] = None,
    start: Annotated[str | None, typer.Option(help="Begin, UTC, ISO 8601. Default: the mission's.")] = None,
    days: Annotated[float, typer.Option(help="Days to fetch.")] = 15.0,
    dataset: Annotated[str, typer.Option(help="Deployment of a glider, for ioos-gliders.")] = "",
    stride: Annotated[int, typer.Option(help="Every so many points of the grid.")] = 1,
    server: Annotated[str, typer.Option(help="Address of a mirror, instead of the source's own server.")] = "",
    again: Annotated[bool, typer.Option("--again", help="Fetch even if it was fetched before.")] = False,
    out: Annotated[Path | None, typer.Option(help="Copy the file here too.")] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print path, checksum and address as JSON.")] = False,
) -> None:
    """Fetch a box of a public source, once; what was fetched before is taken from the cache.

    Examples:

    glider-forecast data fetch etopo2022 --mission mission.toml --out etopo.nc

    glider-forecast data fetch maracoos --start 2024-09-05 --days 3 --out currents.nc

    glider-forecast data fetch ioos-gliders --box 38 41 -75 -71 --start 2024-09-01 --days 30
    """
    import json

    from glider_jax.products.atomic import termination_raises
    from glider_jax.products.fetching import Wanted, copy, deployments
    from glider_jax.products.fetching import fetch as fetch_file
    from glider_jax.products.public_sources import source_of

    source = source_of(name)
    where, begin = _box_and_start(box, mission, start, days, timed=source.timed or start is not None)
    period = None if begin is None else (begin, begin + days * 86400.0)
    wanted = Wanted(source, where, period, stride, dataset, server)
    with termination_raises():
        if source.protocol == "tabledap" and not dataset:
            rows = deployments(wanted)
            if json_:
                print(json.dumps(rows))
            for row in () if json_ else rows:
                print(f"{row['dataset']}\t{row['begin'][:10]} to {row['end'][:10]}\t{row['title']}")
            print(f"{len(rows)} deployments; fetch one with --dataset", file=sys.stderr)
            return
        found = fetch_file(wanted, again=again)
        path = found.path if out is None else copy(found, out)
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    how = "from the cache" if found.cached else "fetched"
    if json_:
        print(json.dumps({"path": str(path), "sha256": found.sha256, "url": found.url, "cached": found.cached}))
    else:
        print(path)
    print(f"{how}: {path.stat().st_size / 1e6:.2f} MB, sha256 {found.sha256}", file=sys.stderr)
    print(f"credit: {source.credit}", file=sys.stderr)
    if source.option.startswith("--"):
        print(f"use: glider-forecast ensemble {source.option} {path}", file=sys.stderr)


def _box_and_start(box, mission, start, days: float, *, timed: bool):
    """The box asked for or the mission's reach, and the beginning in UTC seconds where one is needed."""
    from datetime import UTC, datetime

    from glider_jax.errors import ConfigError

    begin = None
    if start is not None:
        try:
            moment = datetime.fromisoformat(start)
        except ValueError as error:
            raise ConfigError(f"--start: expected a time such as 2024-09-05T12:00:00Z, found '{start}'.") from error
        begin = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if box is not None and (begin is not None or not timed):
        return box, begin
    from glider_jax.products.job import reach_box
    from glider_jax.readers.missions import read_mission
    from glider_jax_data import path as bundled_path

    flown = read_mission(mission or bundled_path("missions/new_jersey.toml"))
    position = flown.start_position or (flown.waypoints[0] if flown.waypoints else None)
    if box is None and position is None:
        raise ConfigError(f"{flown.name}: expected a start or waypoints, found none. Give --box SOUTH NORTH WEST EAST.")
    if timed and begin is None:
        begin = flown.start
    return box or reach_box(flown, position, days), begin
