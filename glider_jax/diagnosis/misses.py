"""Forecasts that missed, and whether what the diagnosis named explains them.

Imports NumPy and the readers. A newcomer would get wrong: a forecast of one surfacing already knows the last currents
and speeds, so its miss is not the residual of the base model; what can be compared is whether both fall short on the
same segments, and how much of that is gone with the named effects.
"""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from glider_jax.diagnosis.flow import UNKNOWN, course_of, left_over
from glider_jax.errors import DataError
from glider_jax.readers.dead_reckoning import metres
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.run import Finding

#: s; a forecast surfacing and a segment that end this close to each other are the same.
NEAR = 300.0


def read_cases(path: Path) -> list[dict[str, Any]]:
    """The cases of a ``hindcast.json``.

    Raises
    ------
    DataError : the file is not there, or holds no cases.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return list(content["cases"])
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise DataError(
            f"{path}: expected the hindcast.json of 'glider-forecast hindcast --out', found no cases in it "
            f"({type(problem).__name__}). Give that file."
        ) from problem


def explain(cases: list[dict[str, Any]], found: Finding, content: dict[str, Any]) -> dict[str, Any] | None:
    """Misses of forecasts beside the residuals of the same segments, before and after; None without a common one.

    Returns
    -------
    Means in metres: ``along`` the course (negative: it surfaced short), ``across`` (positive: to the right), the same
    of the residuals ``before`` and ``after``, ``short`` the share of forecasts that it fell short of, ``sentence``.
    """
    east, north = (found.gathered.stream(f"displacement {way}") for way in ("east", "north"))
    if east is None or north is None or "displacement east" not in found.whitened:
        return None
    left = [np.stack([found.whitened[f"displacement {way}"][k] for way in ("east", "north")], axis=1) for k in (0, 1)]
    course = course_of(found)
    if course is not None and any(effect["title"] == UNKNOWN for effect in content["effects"]):
        left[1] = left_over(course)
    ends = found.gathered.origin + east.time + 0.5 * east.span
    table = []
    for case in cases:
        if case.get("recording") != found.recording.name or case.get("forecast_latitude") is None:
            continue
        surfaced = datetime.fromisoformat(str(case["surfaced"]).replace("Z", "+00:00")).timestamp()
        near = int(np.argmin(np.abs(ends - surfaced)))
        if abs(ends[near] - surfaced) > NEAR:
            continue
        x, y = metres(
            np.array([case["latitude"]]), np.array([case["longitude"]]),
            (case["forecast_latitude"], case["forecast_longitude"]),
        )  # fmt: skip
        course = np.array([east.value[near], north.value[near]])
        course = course / max(float(np.hypot(*course)), 1e-9)
        residual = [misses[near] * east.span[near] for misses in left]
        row = [_turned(v, course) for v in (np.array([x[0], y[0]]), *residual)]
        table.append([*row[0], *row[1], *row[2], float(case.get("time_error") or 0.0)])
    if len(table) < 3:
        return None
    return _summary(np.array(table))


def _turned(vector: Array, course: Array) -> tuple[float, float]:
    """Along a course, and to its right."""
    return float(vector @ course), float(vector[0] * course[1] - vector[1] * course[0])


def _summary(table: Array) -> dict[str, Any]:
    names = ("along_m", "across_m", "before_along_m", "before_across_m", "after_along_m", "after_across_m")
    means = {name: float(np.mean(table[:, k])) for k, name in enumerate(names)}
    share = float(np.mean(table[:, 0] < 0.0))
    size = {
        "before_rms_m": float(np.sqrt(np.mean(table[:, 2] ** 2 + table[:, 3] ** 2))),
        "after_rms_m": float(np.sqrt(np.mean(table[:, 4] ** 2 + table[:, 5] ** 2))),
        "miss_rms_m": float(np.sqrt(np.mean(table[:, 0] ** 2 + table[:, 1] ** 2))),
    }
    before, after = means["before_along_m"], means["after_along_m"]
    way = "short" if means["along_m"] < 0.0 else "too far"
    count, short = len(table), int((table[:, 0] < 0.0).sum())
    sentence = (
        f"{count} forecast surfacings missed by {size['miss_rms_m']:.0f} m rms; {short} of them came short, and on "
        f"average the glider came {abs(means['along_m']):.0f} m {way}. On the same segments the base model misses by "
        f"{size['before_rms_m']:.0f} m rms ({before:+.0f} m along the course), with what was named by "
        f"{size['after_rms_m']:.0f} m ({after:+.0f} m)."
    )
    late = float(np.mean(table[:, 6])) / 60.0
    return {"cases": len(table), **means, **size, "short": share, "forecast_late_min": late, "sentence": sentence}
