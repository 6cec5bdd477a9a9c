"""Many missions at once: fields read once for all, one frame, and missions that compile alike flown as one run.

Each mission gets its own folder of products, those of a forecast of it alone; the fleet gets ``fleet.json`` with the
next surfacing, the rates and the battery of each.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.errors import ConfigError
from glider_jax.mission.forecast import Run, frame_about
from glider_jax.mission.sweep import fly_stacked, signature
from glider_jax.products.atomic import write_text
from glider_jax.products.job import (
    STREAM_ABOVE,
    Inputs,
    Options,
    Result,
    inputs_of,
    prepare_run,
    read_fields,
    read_polygons,
    survey,
    write_products,
)
from glider_jax.products.netcdf import write_netcdf
from glider_jax.products.summary import summarise

SCHEMA = "glider_jax.fleet/1"


def run_fleet(
    options: Options, missions: Sequence[Path], out: Path | None, progress: Callable[[int], None] | None = None
) -> dict[str, Result]:
    """Forecast several missions and write each one's products.

    Parameters
    ----------
    options : of every mission; ``options.mission`` is not used.  missions : TOML, ``.mi`` files or their folders.
    out : folder in which each mission gets a folder by its name; None writes nothing.
    progress : called with the number of members flown so far, over all missions.

    Returns
    -------
    The result of each mission by its name.

    Raises
    ------
    ConfigError : two missions have one name, or there are more members than are held whole.
    """
    if options.n > STREAM_ABOVE:
        raise ConfigError(
            f"--n: expected at most {STREAM_ABOVE} members for several missions, found {options.n}. "
            "Forecast them one by one."
        )
    polygons = read_polygons(options.polygons)
    prepared = _prepare([replace(options, mission=Path(path)) for path in missions])
    results: dict[str, Result] = {}
    done = 0
    for group in _groups(prepared):
        flown = fly_stacked([run for _, run, _ in group], options.n)
        for (name, _, inputs), track in zip(group, flown, strict=True):
            result = summarise(track, polygons=polygons, reserve=options.reserve)
            files = {}
            if out is not None:
                if "nc" in options.outputs:
                    files["nc"] = write_netcdf(track, out / name / "forecast.nc")
                files |= write_products(track, result, inputs, out / name, options.outputs, options.style)
            results[name] = Result(result, files, track)
            done += track.n
            if progress is not None:
                progress(done)
    ordered = {name: results[name] for name, *_ in prepared}
    if out is not None:
        text = json.dumps(overview(ordered), indent=1, allow_nan=False) + "\n"
        write_text(out / "fleet.json", text)
    return ordered


def _prepare(each: Sequence[Options]) -> list[tuple[str, Run, Inputs]]:
    """Read the fields once for all missions and tabulate them once for all that start together."""
    known = [survey(one) for one in each]
    names = [one.mission.name for one in known]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ConfigError(
            f"--mission: expected missions of different names, found '{min(twice)}' more than once. Rename one."
        )
    boxes = np.array([one.box for one in known])
    box = (boxes[:, 0].min(), boxes[:, 1].max(), boxes[:, 2].min(), boxes[:, 3].max())
    periods = [one.period for one in known]
    period = None if None in periods else (min(p[0] for p in periods), max(p[1] for p in periods))
    fields = read_fields(each[0], False, tuple(map(float, box)), period)
    frame = frame_about([point for one in known for point in (one.position, *one.mission.waypoints)])
    found: list[tuple[str, Run, Inputs]] = []
    for name, one, its in zip(names, each, known, strict=True):
        inputs = inputs_of(one, its, fields)
        start = inputs.start if inputs.start is not None else its.mission.start
        beside = next((run for _, run, _ in found if run.t0 == start), None)
        found.append((name, prepare_run(one, inputs, frame=frame, beside=beside), inputs))
    return found


def _groups(prepared: Sequence[tuple[str, Run, Inputs]]) -> list[list[tuple[str, Run, Inputs]]]:
    """Missions that one compiled program flies together."""
    groups: dict[tuple, list[tuple[str, Run, Inputs]]] = {}
    for entry in prepared:
        groups.setdefault(signature(entry[1]), []).append(entry)
    return list(groups.values())


def overview(results: dict[str, Result]) -> dict[str, Any]:
    """What ``fleet.json`` holds: each mission's summary in a few entries, under its name."""
    kept = ("forecast", "surfacings", "rates", "battery", "risks")
    return {
        "schema": SCHEMA,
        "missions": {name: {key: result.summary[key] for key in kept} for name, result in results.items()},
    }
