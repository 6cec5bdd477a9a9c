"""``glider-forecast recording``: what a glider recording holds, what was mended in it, and its dive segments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from glider_jax.readers.segments import Segment
    from glider_jax.records import Recording


def recording(
    paths: Annotated[list[Path], typer.Argument(help="Files or folders of one glider's recording.")],
    cache: Annotated[Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).")] = None,
    variation_deg: Annotated[
        float | None, typer.Option(help="Magnetic variation, west positive; else recorded or estimated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Show what a recording holds: files, times, channels, repairs, dive segments."""
    import json
    import math

    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.segments import dive_segments, gaps, legs, sampling

    one = read_recording(paths, cache=cache)
    segments = dive_segments(one, variation=None if variation_deg is None else math.radians(variation_deg))
    content = describe(one) | {
        "segments": [_segment(s) for s in segments],
        "legs": len(legs(one)),
        "gaps": [[_iso(a), _iso(b)] for a, b in gaps(one)],
        "ctd_sampled": {name: round(share, 3) for name, share in sampling(one).items()},
    }
    if segments:
        turn = segments[0].variation
        content["magnetic_variation_deg"] = round(math.degrees(turn.value), 2)
        content["magnetic_variation_from"] = turn.how
    if as_json:
        typer.echo(json.dumps(content, allow_nan=False))
    else:
        _show(content)


def describe(one: Recording) -> dict[str, Any]:
    """Files, times, channels, repairs and notes of a recording, ready for JSON."""
    import numpy as np

    from glider_jax.readers.recordings import CHANNELS

    channels = {}
    for name, values in sorted(one.channels.items()):
        good = values[np.isfinite(values)]
        unit = CHANNELS[name].unit if name in CHANNELS else "native"
        channels[name] = {"unit": unit, "values": int(good.size), "min": float(good.min()), "max": float(good.max())}
    return {
        "name": one.name,
        "product": one.source.product,
        "files": one.source.files,
        "first": _iso(one.time[0]),
        "last": _iso(one.time[-1]),
        "rows": int(one.time.size),
        "missions": list(one.attributes.get("missions", ())),
        "heading_reference": one.attributes.get("heading_reference"),
        "position_format": one.attributes.get("position_format"),
        "channels": channels,
        "missing": list(one.missing),
        "repairs": [{"kind": r.kind, "count": r.count, "detail": r.detail} for r in one.repairs],
        "notes": list(one.source.notes),
    }


def _iso(seconds: float) -> str:
    from datetime import UTC, datetime

    return datetime.fromtimestamp(float(seconds), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _number(value: float, digits: int) -> float | None:
    import math

    return round(value, digits) if math.isfinite(value) else None


def _segment(one: Segment) -> dict[str, Any]:
    """A segment in the units pilots read."""
    import math

    return {
        "dive": _iso(one.dive_time),
        "surface": _iso(one.surface_time),
        "hours": _number(one.duration / 3600.0, 3),
        "depth_m": _number(one.maximum_depth, 1),
        "inflections": one.inflections,
        "dive_pitch_deg": _number(math.degrees(one.dive_pitch), 1),
        "climb_pitch_deg": _number(math.degrees(one.climb_pitch), 1),
        "ground_km": _number(one.distance / 1e3, 3),
        "water_km": _number(one.distance_through_water / 1e3, 3),
        "dead_reckoning": one.dead_reckoning,
        "current_east_m_s": _number(one.current_east, 3),
        "current_north_m_s": _number(one.current_north, 3),
        "glider_current_east_m_s": _number(one.glider_current_east, 3),
        "glider_current_north_m_s": _number(one.glider_current_north, 3),
        "glider_current_from": one.glider_current_from,
        "charge_ah": _number(one.charge_used / 3600.0, 4),
        "start": [round(one.start_latitude, 6), round(one.start_longitude, 6)],
        "end": [round(one.end_latitude, 6), round(one.end_longitude, 6)],
        "gap": one.gap,
        "dives": one.dives,
    }


def _show(content: dict[str, Any]) -> None:
    """Print for a person: drawn tables on a terminal, tab-separated lines elsewhere."""
    typer.echo(f"{content['name']}: {content['product']}, {len(content['files'])} files")
    typer.echo(f"{content['first']} to {content['last']}, {content['rows']} rows, {len(content['channels'])} channels")
    if content["missions"]:
        typer.echo(f"missions: {', '.join(content['missions'])}")
    if "magnetic_variation_deg" in content:
        typer.echo(
            f"heading: {content['heading_reference']}, variation {content['magnetic_variation_deg']:+.1f} degrees "
            f"west ({content['magnetic_variation_from']}); positions: {content['position_format']}"
        )
    if content["missing"]:
        typer.echo(f"not recorded: {', '.join(content['missing'])}")
    for note in content["notes"]:
        typer.echo(note, err=True)
    heads = ("repair", "count", "example")
    _table("Repairs", heads, [(r["kind"], str(r["count"]), r["detail"]) for r in content["repairs"]])
    rows = [
        (n, c["unit"], str(c["values"]), f"{c['min']:.6g}", f"{c['max']:.6g}") for n, c in content["channels"].items()
    ]
    _table("Channels", ("channel", "unit", "values", "min", "max"), rows)
    names = (
        "dive hours depth_m inflections dive_pitch_deg climb_pitch_deg ground_km water_km current_east_m_s "
        "current_north_m_s glider_current_east_m_s glider_current_north_m_s charge_ah"
    ).split()
    _table("Dive segments", tuple(names), [tuple(_cell(s[n]) for n in names) for s in content["segments"]])
    for begin, end in content["gaps"]:
        typer.echo(f"gap in the recording: {begin} to {end}")
    for name, share in content["ctd_sampled"].items():
        typer.echo(f"CTD sampled in {100 * share:.0f} % of the time of phase {name}")


def _cell(value: Any) -> str:
    return "-" if value is None else str(value)


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    import sys

    if not sys.stdout.isatty():
        typer.echo(f"{title}: {len(rows)}")
        if rows:
            typer.echo("\t".join(heads))
        for row in rows:
            typer.echo("\t".join(row))
        return
    from rich.console import Console
    from rich.table import Table

    drawn = Table(title=title)
    for head in heads:
        drawn.add_column(head.replace("_", " "), overflow="fold")
    for row in rows:
        drawn.add_row(*row)
    Console().print(drawn)
