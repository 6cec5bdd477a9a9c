"""Forecasts frozen to disk when they are made, and scored when the glider comes up.

A frozen forecast holds what is needed to judge it later and to repeat it: when it was made, the members' first fixes,
the digests of its inputs, the seed and the version. Names of files are made of letters and digits only, whatever the
glider calls itself; nothing in a file chooses a path.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax import __version__
from glider_jax.errors import DataError
from glider_jax.inference.live import Flown
from glider_jax.products import scores
from glider_jax.products.atomic import write_text
from glider_jax.products.coordinates import LocalFrame, distance, iso_time
from glider_jax.products.regions import inside, regions_of_metres
from glider_jax.readers.segments import Segment

SCHEMA = "glider_jax.frozen/1"
FOLDER = "frozen"
#: s; a dive that began longer after the forecast's fix is not the one that was forecast.
_BELONGS = 3 * 3600.0
_KEPT = 1000


def safe_name(text: str) -> str:
    """Letters, digits and dashes of a name, at most 40, never empty.

    Examples
    --------
    >>> safe_name("../unit 7<b>")
    'unit-7-b'
    """
    words = re.findall(r"[A-Za-z0-9_]+", text)
    return "-".join(words)[:40] or "glider"


def freeze(flown: Flown, out: Path, *, seed: int, settings: dict[str, Any]) -> Path:
    """Write one forecast under ``out/frozen`` and return its path; the same forecast again replaces it.

    Parameters
    ----------
    settings : what else is needed to repeat it, ready for JSON.
    """
    known = flown.scenario.situation
    last = known.segments[-1] if known.segments else None
    rows = np.stack([flown.fix_time - known.time, flown.fix_latitude, flown.fix_longitude], axis=1)
    whole = len(rows)
    rows = rows[np.isfinite(rows).all(axis=1)]
    content = {
        "schema": SCHEMA,
        "version": __version__,
        "glider": known.name,
        "fix": {"time": known.time, "latitude": known.latitude, "longitude": known.longitude},
        "departure_s": known.departure,
        "seed": seed,
        "members": whole,
        "surfaced": len(rows),
        "inputs": {str(name).replace("\\", "/").rsplit("/", 1)[-1]: v for name, v in known.files.items()},
        "settings": settings,
        "persistence": None
        if last is None
        else {"east": last.east, "north": last.north, "seconds": last.end_time - last.start_time},
        "first_fixes": [
            [round(float(t), 1), round(float(a), 6), round(float(b), 6)] for t, a, b in rows[:_KEPT]
        ],
    }
    stamp = iso_time(known.time).replace(":", "").replace("-", "")
    path = out / FOLDER / f"{safe_name(known.name)}-{stamp}.json"
    return write_text(path, json.dumps(content, allow_nan=False, indent=1) + "\n")


def load(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """All frozen forecasts of a folder (or of its ``frozen``), oldest first, and a sentence for each unusable file.

    Raises
    ------
    DataError : the folder does not exist.
    """
    if not folder.is_dir():
        raise DataError(
            f"{folder}: expected a folder with frozen forecasts, found none. Give the --out of 'next'."
        )
    inner = folder / FOLDER
    files = sorted((inner if inner.is_dir() else folder).glob("*.json"))
    found, told = [], []
    for path in files:
        try:
            content = json.loads(path.read_text())
            _check(content)
        except (OSError, ValueError, KeyError, TypeError) as error:
            told.append(f"{path.name}: not a frozen forecast ({error}); left out")
            continue
        found.append(content | {"file": path.name})
    return sorted(found, key=lambda c: c["fix"]["time"]), told


def _check(content: dict[str, Any]) -> None:
    if content["schema"] != SCHEMA:
        raise ValueError(f"expected schema {SCHEMA}, found {content['schema']}")
    rows = np.asarray(content["first_fixes"], float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise ValueError("expected rows of seconds, latitude and longitude")
    for name in ("time", "latitude", "longitude"):
        float(content["fix"][name])


def truth_of(frozen: dict[str, Any], segments: Iterable[Segment]) -> Segment | None:
    """The dive that was forecast, once its surfacing is known; None before."""
    issued = frozen["fix"]["time"]
    for one in segments:
        if one.dive_time >= issued - 120.0 and one.end_time > issued + 120.0:
            return one if one.start_time - issued < _BELONGS else None
    return None


def score(frozen: dict[str, Any], truth: Segment) -> dict[str, Any]:
    """Compare a frozen forecast with the surfacing that came; distances km, times minutes."""
    fix = frozen["fix"]
    rows = np.asarray(frozen["first_fixes"], float)
    frame = LocalFrame(fix["latitude"], fix["longitude"])
    cloud = np.stack(frame.to_metres(rows[:, 1], rows[:, 2]), axis=1)
    goal = np.array(frame.to_metres(truth.end_latitude, truth.end_longitude))
    middle = np.median(cloud, axis=0)
    fifty, ninety = regions_of_metres(cloud, frame, (0.5, 0.9))
    place = (np.array([truth.end_latitude]), np.array([truth.end_longitude]))
    seconds = truth.end_time - fix["time"]
    result = {
        "file": frozen.get("file", ""),
        "glider": frozen["glider"],
        "issued": iso_time(fix["time"]),
        "surfaced": iso_time(truth.end_time),
        "error_km": float(np.hypot(*(middle - goal))) / 1e3,
        "inside50": bool(inside(fifty, *place)[0]),
        "inside90": bool(inside(ninety, *place)[0]),
        "energy_score_km": scores.energy_score(cloud, goal) / 1e3,
        "time_error_min": float(np.median(rows[:, 0]) - seconds) / 60.0,
        "time_inside90": scores.within(rows[:, 0], seconds, 0.9),
        "time_crps_min": scores.crps(rows[:, 0], seconds) / 60.0,
        "persistence_km": None,
        "waiting": False,
    }
    past = frozen.get("persistence")
    if past is not None:
        lat, lon = frame.to_degrees(past["east"], past["north"])
        result["persistence_km"] = float(distance(lat, lon, truth.end_latitude, truth.end_longitude)) / 1e3
    return result


def score_all(frozen: Sequence[dict[str, Any]], segments: Sequence[Segment]) -> list[dict[str, Any]]:
    """Scores of all forecasts, oldest first; those whose surfacing is not known yet are marked ``waiting``."""
    rows = []
    for one in frozen:
        truth = truth_of(one, segments)
        if truth is None:
            rows.append(
                {"file": one.get("file", ""), "glider": one["glider"], "issued": iso_time(one["fix"]["time"])}
                | {"waiting": True}
            )
        else:
            rows.append(score(one, truth))
    return rows


def table(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Errors, coverage and skill over scored forecasts."""
    done = [r for r in rows if not r["waiting"]]
    error = np.array([r["error_km"] for r in done], float)
    baseline = np.array(
        [math.nan if r["persistence_km"] is None else r["persistence_km"] for r in done], float
    )
    return {
        "scored": len(done),
        "waiting": len(rows) - len(done),
        "error_km": scores.error_table(error),
        "persistence_km": scores.error_table(baseline),
        "region50": scores.coverage([r["inside50"] for r in done]),
        "region90": scores.coverage([r["inside90"] for r in done]),
        "time90": scores.coverage([r["time_inside90"] for r in done]),
        "skill": scores.skill(np.array([r["energy_score_km"] for r in done], float), baseline),
    }
