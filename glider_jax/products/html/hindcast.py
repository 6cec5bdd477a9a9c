"""The page of a hindcast: every surfacing's forecast beside what came, with a slider through the cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.products import cartography as chart
from glider_jax.products import scores
from glider_jax.products.coordinates import iso_time, place_text, unwrap_longitude
from glider_jax.products.hindcast import Case
from glider_jax.products.html.charts import Chart
from glider_jax.products.html.forecast import map_block
from glider_jax.products.html.formats import area
from glider_jax.products.html.geography import bathymetry_layers, encode, rings, wider
from glider_jax.products.html.page import Safe, cards, page, paragraph, section, settings_block, table, write_page
from glider_jax.products.provenance import creation_time
from glider_jax.products.shapes import multipolygon
from glider_jax.records import BathymetryGrid

_SHAPES = ("o", "s", "^", "D", "v")


def write_hindcast(
    cases: Sequence[Case], content: Mapping[str, Any], path: str | Path, *, bathymetry: BathymetryGrid | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Path:  # fmt: skip
    """Write the page of a hindcast.

    Parameters
    ----------
    cases : all cases, oldest first within a recording.
    content : tables as the command writes them to JSON: ``recordings``, ``pooled``, ``cases``, ``seed``, ``members``.
    settings : what else is needed to repeat it: options and digests of inputs.
    """
    pooled = content["pooled"]
    drawn, frames = _map(cases, bathymetry)
    names = ", ".join(content["recordings"])
    made = {"seed": content["seed"], "created": creation_time(settings or {}), "settings": settings or {},
            "inputs": (settings or {}).get("inputs") or {}}  # fmt: skip
    head = ("recording", "surfacings", "error km, median", "90 %", "persistence km", "90 %", "in 50 % region",
            "in 90 % region", "skill")  # fmt: skip
    rows = [_row(name, entry) for name, entry in (*content["recordings"].items(), ("all", pooled))]
    sections = [
        section("map-part", "Map", map_block(frames, drawn, "Surfacing", "way flown; blue: forecast, dark: what came")),
        section("scores", "Scores", table(head, rows, right=range(1, 9), tight=True), _told()),
        section("figures", "Coverage and errors", _figures(cases)),
        section("cases", "Every surfacing", _cases(content["cases"])),
        section("provenance", "Provenance", settings_block(made)),
    ]
    subtitle = f"{len(cases)} surfacings of {names} · {content['members']:,} members each · times are UTC"
    text = page("Hindcast", subtitle, sections, lead=[_headline(pooled)], data={"map": drawn, "frames": frames})
    return write_page(path, text)


def _headline(pooled: Mapping[str, Any]) -> Safe:
    ours, theirs = pooled["position_km"]["forecast"], pooled["position_km"]["persistence"]
    inside = pooled["coverage"]["region90"]
    skill = pooled["position_km"]["skill"]["skill"]
    late = pooled["time_min"]["forecast"]
    low, high = inside["interval"]
    return cards(
        [
            ("error at the first fix, median", f"{ours['median']:.2f} km", f"90 %: below {ours['p90']:.2f} km"),
            ("persistence, median", f"{theirs['median']:.2f} km", f"90 %: below {theirs['p90']:.2f} km"),
            ("inside the 90 % region", _percent(inside["share"]), f"95 % sure: {_percent(low)} to {_percent(high)}"),
            ("skill against persistence", "-" if skill is None else f"{skill:.2f}", "1 is perfect, 0 no better"),
            ("error of the time, median", f"{late['median']:.1f} min", f"90 %: below {late['p90']:.1f} min"),
        ]
    )


def _row(name: str, entry: Mapping[str, Any]) -> tuple:
    ours, theirs = entry["position_km"]["forecast"], entry["position_km"]["persistence"]
    skill = entry["position_km"]["skill"]["skill"]
    shares = (_percent(entry["coverage"][key]["share"]) for key in ("region50", "region90"))
    return (
        name, entry["cases"], *(_number(t[k]) for t in (ours, theirs) for k in ("median", "p90")), *shares,
        "-" if skill is None else f"{skill:.2f}",
    )  # fmt: skip


def _told() -> Safe:
    return paragraph(
        "Errors are from the middle of the forecast to the first fix that came. Persistence repeats the displacement "
        "of the dive before. Each forecast knew only what the glider had sent by its last fix.", "soft small",
    )  # fmt: skip


def _map(cases: Sequence[Case], bathymetry: BathymetryGrid | None) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The map of all cases and one frame per case: its regions, its middle, and what came."""
    reference = cases[0].longitude
    lat = np.array([v for c in cases for v in (c.latitude, c.forecast_latitude)])
    lon = unwrap_longitude(np.array([v for c in cases for v in (c.longitude, c.forecast_longitude)]), reference)
    limits = chart.limits_around(lat, lon, ratio=1.6, margin=0.12, least_km=3.0)
    drawn: dict[str, Any] = {"bounds": [[limits.south, limits.west], [limits.north, limits.east]], "pins": []}
    if bathymetry is not None:
        drawn |= bathymetry_layers(bathymetry, wider(limits, 0.5))
    first = [c for c in cases if c.recording == cases[0].recording]
    if len(first) == len(cases) and len(cases) > 1:
        drawn["path"] = encode(lon[::2], lat[::2])
    frames = []
    for k, c in enumerate(cases):
        came = [round(c.latitude, 6), round(float(unwrap_longitude(c.longitude, reference)), 6)]
        middle = [round(c.forecast_latitude, 6), round(float(unwrap_longitude(c.forecast_longitude, reference)), 6)]
        shapes = [rings(multipolygon(region.polygons), reference) for region in c.regions]
        verdict = "inside the 90 % region" if c.inside90 else "outside the 90 % region"
        moment = datetime.fromisoformat(iso_time(c.surfaced))
        frames.append(
            {
                "when": f"{c.recording} {c.number}: up {moment.day} {moment:%b %Y %H:%M}Z",
                "told": f"{c.error / 1e3:.2f} km off (persistence {c.persistence / 1e3:.2f} km), {verdict} of "
                f"{area(c.area90 / 1e6)} · {c.time_error / 60:+.1f} min · came up at {place_text(*came)}",
                "place": middle, "truth": came, "toldTruth": f"came up: {place_text(*came)}", "join": [middle, came],
                "regions": shapes, "share": (k + 0.5) / len(cases), "cells": None, "flow": None,
                "look": _look(shapes, middle, came),
            }
        )  # fmt: skip
    return drawn, frames


def _look(shapes, middle, came) -> list[list[float]]:
    """Corners of a case: its regions and both places, with room around."""
    points = [np.array([middle, came])]
    for code in (ring for part in shapes for polygon in part for ring in polygon):
        points.append(np.cumsum(np.array(code).reshape(-1, 2), axis=0)[:, ::-1] / 1e5)
    every = np.concatenate(points)
    low, high = every.min(axis=0), every.max(axis=0)
    pad = 0.35 * np.maximum(high - low, 0.005)
    return [(low - pad).round(5).tolist(), (high + pad).round(5).tolist()]


def _figures(cases: Sequence[Case]) -> Safe:
    cover = Chart((0.0, 1.0), (0.0, 1.02), "promised share", "found share")
    cover.line([0.0, 1.0], [0.0, 1.0], "faint")
    time = scores.reliability(np.array([c.time_below for c in cases], float))
    place = [
        {"probability": p, **scores.coverage(flags)}
        for p, flags in ((0.5, [c.inside50 for c in cases]), (0.9, [c.inside90 for c in cases]))
    ]
    for rows, kind, shape, name in ((time, "c1", "s", "time"), (place, "c0", "o", "place")):
        for row in rows:
            if row["share"] is None or not np.isfinite(row["share"]):
                continue
            x = row["probability"] + (0.008 if name == "place" else -0.008)
            cover.whisker(x, *row["interval"])
            told = f"{name}: promised {_percent(row['probability'])}, found {_percent(row['share'])}"
            cover.dot(x, row["share"], f"dot {kind}", told, shape=shape)
    ours = np.array([c.error for c in cases]) / 1e3
    theirs = np.array([c.persistence for c in cases]) / 1e3
    least = max(min(float(ours.min()), float(theirs.min())) * 0.8, 0.005)
    most = max(float(ours.max()), float(theirs.max()), 0.1) * 1.2
    errors = Chart(
        (least, most), (least, most), "error of persistence (km)", "error of the forecast (km)", log=True
    )  # fmt: skip
    errors.line([least, most], [least, most], "faint")
    names = sorted({c.recording for c in cases})
    for c, x, y in zip(cases, theirs, ours, strict=True):
        k = names.index(c.recording)
        told = f"{c.recording} {c.number}: forecast {y:.2f} km, persistence {x:.2f} km, {c.cause}"
        errors.dot(float(x), float(y), f"dot c{k % 7}", told, shape=_SHAPES[k % len(_SHAPES)])
    key = ", ".join(f"{name} {'circle square triangle diamond wedge'.split()[k % 5]}" for k, name in enumerate(names))
    one = cover.figure("Promised and found share", "Circles: place; squares: time. Bars: 95 % intervals.")
    two = errors.figure("Error of forecast and persistence", f"Below the line the forecast is better. Marks: {key}.")
    return Safe(f'<div class="pair">{one}{two}</div>')


def _cases(rows: Sequence[Mapping[str, Any]]) -> Safe:
    head = ("surfacing", "issued", "came up", "error km", "persistence km", "in 90 %", "time min", "largest part")
    cells = [
        (
            f"{r['recording']} {r['number']}", _clock(r["issued"]), _clock(r["surfaced"]), f"{r['error'] / 1e3:.2f}",
            _number(None if r["persistence"] is None else r["persistence"] / 1e3), "yes" if r["inside90"] else "no",
            "-" if r["time_error"] is None else f"{r['time_error'] / 60:+.1f}", r["cause"],
        )
        for r in rows
    ]  # fmt: skip
    caption = "A click on a row shows it on the map."
    return table(head, cells, caption=caption, right=(3, 4, 6), frames=range(len(cells)), tight=True)


def _clock(text: str) -> str:
    return f"{text[:10]} {text[11:16]}Z"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"
