"""``glider-forecast hindcast``: every surfacing of a recording forecast as if live, and scored."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer


def hindcast(
    paths: Annotated[list[Path], typer.Argument(help="Recordings: each a file or a folder of one glider.")],
    cache: Annotated[Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).")] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle: TOML file or the name of a bundled one.")
    ] = None,
    mission: Annotated[Path | None, typer.Option(help="Mission that was flown, if known.")] = None,
    variation_deg: Annotated[
        float | None, typer.Option(help="Magnetic variation, west positive; else recorded or worked out.")
    ] = None,
    n: Annotated[int, typer.Option("--n", "-n", help="Members per forecast.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of all random draws.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for hindcast.json and reliability.png.")] = None,
    html: Annotated[
        bool, typer.Option("--html", help="Write hindcast.html too (needs --out): map and report in one file.")
    ] = False,
    bathymetry: Annotated[Path | None, typer.Option(help="Bathymetry to draw on the map of --html.")] = None,
    style: Annotated[str, typer.Option(help="Look of the figures: screen, print or paper.")] = "screen",
    diagnose: Annotated[
        Path | None,
        typer.Option(help="Folder: diagnose each recording, and say whether what was left out explains the misses."),
    ] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Score forecasts of every surfacing from what was known then, against persistence and dead reckoning.

    Examples:

    glider-forecast hindcast osu684.nc ru28.nc --out hindcast

    glider-forecast hindcast from-glider --cache cache --bathymetry etopo.nc --html --out hindcast
    """
    from glider_jax_cli.session import compiled_cache, progress_bar

    compiled_cache()
    import json
    import math

    from glider_jax.errors import ConfigError
    from glider_jax.products.atomic import termination_raises, write_text
    from glider_jax.products.figure_style import style_of
    from glider_jax.products.hindcast import cases_of, plain_numbers, rows, summarise
    from glider_jax.products.hindcast import hindcast as run
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import presets, read_vehicle

    style_of(style)
    if html and out is None:
        raise ConfigError("--html: expected a folder for the page, found none. Give --out.")
    known = read_vehicle(vehicle if vehicle is None or vehicle in presets() else Path(vehicle))
    turn = None if variation_deg is None else math.radians(variation_deg)
    flown = None
    if mission is not None:
        from glider_jax.readers.missions import read_mission

        flown = read_mission(mission)
    every, tables, digests = [], {}, {}
    with termination_raises():
        for path in paths:
            one = read_recording(path, cache=cache)
            for repair in one.repairs:
                print(
                    f"{one.name}: repaired: {repair.count} x {repair.kind}: {repair.detail}", file=sys.stderr
                )
            with progress_bar(one.name, len(cases_of(one, variation=turn))) as progress:
                cases = run(
                    one, known, members=n, seed=seed, variation=turn, mission=flown, progress=progress
                )
            if not cases:
                print(
                    f"{one.name}: fewer than two dives with fixes around them: nothing to score",
                    file=sys.stderr,
                )
                continue
            tables[one.name] = summarise(cases)
            digests |= {Path(name).name: digest for name, digest in one.source.files.items()}
            every += cases
            if diagnose is not None:
                _diagnosed(one, known, flown, rows(cases), diagnose / one.name)
    pooled = summarise(every)
    content = plain_numbers(
        {"recordings": tables, "pooled": pooled, "cases": rows(every), "seed": seed, "members": n}
    )
    if out is not None:
        from glider_jax.products.reliability import plot_reliability

        path = write_text(out / "hindcast.json", json.dumps(content, allow_nan=False, indent=1) + "\n")
        print(f"json: {path}", file=sys.stderr)
        print(f"plot: {plot_reliability(every, out / 'reliability.png', style)}", file=sys.stderr)
    if html:
        from glider_jax.products.html.hindcast import write_hindcast
        from glider_jax.readers.bathymetry import read_bathymetry

        floor = None if bathymetry is None else read_bathymetry(bathymetry)
        settings = {"inputs": digests, "n": n, "seed": seed, "vehicle": known.name}
        page = write_hindcast(every, content, out / "hindcast.html", bathymetry=floor, settings=settings)
        print(f"html: {page}", file=sys.stderr)
    if json_:
        print(json.dumps(content, allow_nan=False))
    else:
        show(content)


def _diagnosed(recording: Any, vehicle: Any, mission: Any, cases: list[dict[str, Any]], out: Path) -> None:
    """Diagnose a recording, with the misses of its forecasts beside what was named; one line on standard error."""
    from glider_jax.diagnosis.run import diagnose as run
    from glider_jax.errors import DataError

    try:
        found = run(recording=recording, vehicle=vehicle, mission=mission, misses=cases, out=out)
    except DataError as problem:
        print(f"{recording.name}: not diagnosed: {problem}", file=sys.stderr)
        return
    missed = found.get("forecast_misses")
    said = f" {missed['sentence']}" if missed else ""
    print(f"{recording.name}: {found['summary']}{said}", file=sys.stderr)
    print(f"diagnosis: {out / 'report.html'} ({found['seconds']:.0f} s)", file=sys.stderr)


def show(content: dict[str, Any]) -> None:
    """Print tables: one line per recording, pooled, then every case and the worst."""
    heads = "recording cases forecast_km persistence_km dead_reckoning_km in50 in90 time_min skill".split()
    print("\t".join(heads))
    for name, table in [*content["recordings"].items(), ("pooled", content["pooled"])]:
        place, inside = table["position_km"], table["coverage"]
        cells = [name, str(table["cases"])]
        cells += [_pair(place[kind]) for kind in ("forecast", "persistence", "dead_reckoning")]
        cells += [
            _share(inside["region50"]),
            _share(inside["region90"]),
            _pair(table["time_min"]["forecast"], 1),
        ]
        cells.append("-" if place["skill"]["skill"] is None else f"{place['skill']['skill']:.2f}")
        print("\t".join(cells))
    print(
        "errors are median / 90 %; in50, in90: share of first fixes inside the 50 and 90 % regions [95 % interval]"
    )
    print("\ncase\tissued\terror_km\tpersistence_km\tinside90\ttime_min\tcause")
    for case in content["cases"]:
        cells = (
            f"{case['recording']} {case['number']}", case["issued"], f"{case['error'] / 1e3:.2f}",
            f"{case['persistence'] / 1e3:.2f}", "yes" if case["inside90"] else "no",
            f"{case['time_error'] / 60:+.1f}", case["cause"],
        )  # fmt: skip
        print("\t".join(cells))
    print("\nworst cases")
    for worst in content["pooled"]["worst"]:
        parts = ", ".join(f"{name} {value:.2f} km" for name, value in worst["parts_km"].items())
        print(
            f"{worst['recording']} {worst['number']}: {worst['error_km']:.2f} km, {worst['cause']} ({parts})"
        )


def _pair(table: dict[str, Any], digits: int = 2) -> str:
    if table["median"] is None:
        return "-"
    return f"{table['median']:.{digits}f} / {table['p90']:.{digits}f}"


def _share(table: dict[str, Any]) -> str:
    low, high = table["interval"]
    return (
        "-" if table["share"] is None else f"{100 * table['share']:.0f} % [{100 * low:.0f}-{100 * high:.0f}]"
    )
