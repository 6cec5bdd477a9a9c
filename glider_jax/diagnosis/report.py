"""What a pilot reads: a self-contained page, figures before and after, the fitted terms as a vehicle file.

Imports Matplotlib when called. A newcomer would get wrong: the vehicle file keeps every number of the base model and
adds the accepted terms only, so ``ensemble`` and ``next`` fly what was named and nothing that was not.
"""

from __future__ import annotations

import io
import json
import math
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from glider_jax.diagnosis import locate
from glider_jax.diagnosis.page import page
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.term import declared

if TYPE_CHECKING:
    from glider_jax.diagnosis.run import Finding


def write(out: Path, found: Finding, content: dict[str, Any], *, report: bool = True) -> None:
    """Write ``diagnosis.json``, ``vehicle.toml`` and, if asked, ``report.html`` with figures."""
    out.mkdir(parents=True, exist_ok=True)
    _put(out / "vehicle.toml", vehicle_toml(found, content).encode())
    if report:
        pictures = figures(found, content)
        for name, data in pictures.items():
            _put(out / f"{name}.png", data)
        _put(out / "report.html", page(content, pictures).encode())
    _put(out / "diagnosis.json", (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def _put(path: Path, data: bytes) -> None:
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    os.replace(part, path)


def vehicle_toml(found: Finding, content: dict[str, Any]) -> str:
    """The base vehicle with the accepted terms, as ``read_vehicle`` reads it."""
    start = datetime.fromtimestamp(float(found.recording.time[0]), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = [
        "# Base model as given, and the effects that its recording asks for.",
        f"# Growth and periodic flows count time from {start}, the first row of the recording.",
    ]
    vehicle = found.vehicle
    text = _source_text(vehicle)
    kept = [line for line in text.splitlines() if not line.strip().startswith("#")]
    lines += kept if kept else ["[vehicle]", f'name = "{vehicle.name}"']
    terms: dict[str, dict[str, tuple[float, float, str]]] = {}
    for effect in content["effects"]:
        for one in effect["parameters"]:
            id, _, name = one["name"].rpartition(".")
            id = id or effect["id"]
            terms.setdefault(id, {})[name] = (one["value"], one["sd"], one["unit"])
        for name, value in effect["shapes"].items():
            info = declared(TERMS_BY_ID[effect["id"]])[name]
            terms.setdefault(effect["id"], {})[name] = (value, 0.0, info.unit)
    for id, values in terms.items():
        if f'[terms."{id}"]' in text:
            continue
        lines += ["", f'[terms."{id}"]']
        for name, (value, sd, unit) in values.items():
            lines.append(
                f'{name} = {{ value = {value:.8g}, sigma = {sd:.4g}, unit = "{unit}", '
                f'source = "diagnosis of {_plain(found.recording.name)}" }}'
            )
    return "\n".join(lines) + "\n"


def _source_text(vehicle: Any) -> str:
    for path in reversed(list(vehicle.source.files)):
        if Path(path).is_file():
            return Path(path).read_text(encoding="utf-8")
    return ""


def _plain(text: str) -> str:
    return "".join(c for c in text if c.isalnum() or c in " -_.")


def figures(found: Finding, content: dict[str, Any]) -> dict[str, bytes]:
    """PNG pictures: residuals before and after over time and covariate, the map of places, what is left."""
    from matplotlib.figure import Figure

    pictures: dict[str, bytes] = {}
    names = _interesting(found, content)
    if names:
        figure = Figure(figsize=(9.0, 2.3 * len(names)), layout="constrained")
        axes = figure.subplots(len(names), 2, squeeze=False, width_ratios=(3, 2))
        for row, name in zip(axes, names, strict=True):
            _before_after(row, found, name)
        pictures["residuals"] = _png(figure)
    if found.before:
        pictures["places"] = _map(found)
    if found.remainders:
        figure = Figure(figsize=(9.0, 2.6 * len(found.remainders)), layout="constrained")
        for axis, one in zip(
            figure.subplots(len(found.remainders), 1, squeeze=False)[:, 0], found.remainders, strict=True
        ):
            axis.axhline(0.0, color="0.7", lw=0.8)
            axis.fill_between(
                one.axis, one.curve - 1.64 * one.sd, one.curve + 1.64 * one.sd, color="#d95f02", alpha=0.25
            )
            axis.plot(one.axis, one.curve, color="#d95f02")
            axis.ticklabel_format(axis="x", useOffset=False)
            axis.set_xlabel(f"{one.place.covariate.replace('_', ' ')} ({one.axis_unit})")
            axis.set_ylabel(f"{one.place.stream} ({one.unit})")
        pictures["unexplained"] = _png(figure)
    return pictures


def _interesting(found: Finding, content: dict[str, Any]) -> list[str]:
    wanted: list[str] = []
    for effect in content["effects"]:
        ranked = sorted(
            effect["streams"], key=lambda n: np.var(found.whitened[n][1]) / max(np.var(found.whitened[n][0]), 1e-30)
        )
        wanted += ranked[:2]
    wanted += [one["place"]["stream"] for one in content["unexplained"]]
    wanted += [n for n in ("vertical speed", "displacement east", "displacement north") if n in found.whitened]
    return list(dict.fromkeys(wanted))[:6]


def _before_after(row: Any, found: Finding, name: str) -> None:
    stream = found.gathered.stream(name)
    before, after = (stream.shown_per_unit * r for r in found.whitened[name])
    days = stream.time / 86400.0
    direction = stream.covariates.get("direction")
    key = next((k for k in ("depth", "heading", "temperature", "tide") if k in stream.covariates), "time")
    unit, factor = locate.SHOWN[key]
    x = factor * stream.covariates[key] if key != "time" else days
    for values, colour, label in ((before, "#7570b3", "before"), (after, "#1b9e77", "after")):
        for axis, at in ((row[0], days), (row[1], x)):
            axis.plot(
                at, values, ".", ms=2 if stream.n > 300 else 5, color=colour, alpha=0.18 if stream.n > 300 else 0.8
            )
        for way in (None,) if direction is None else (-1.0, 1.0):
            mine = np.ones(stream.n, bool) if way is None else direction == way
            style = "-" if way in (None, 1.0) else "--"
            tag = label + ("" if way is None else " (climbs)" if way > 0 else " (dives)")
            for axis, at in ((row[0], days), (row[1], x)):
                centre, mean = _running(at[mine], values[mine])
                axis.plot(centre, mean, style, color=colour, lw=1.6, label=tag if axis is row[0] else None)
    for axis in row:
        axis.axhline(0.0, color="0.6", lw=0.7)
        limit = float(np.percentile(np.abs(np.concatenate([before, after])), 98.5)) * 1.3 + 1e-9
        axis.set_ylim(-limit, limit)
    row[0].set_ylabel(f"{name}\n({stream.shown})", fontsize=8)
    row[0].set_xlabel("days", fontsize=8)
    row[1].set_xlabel(f"{key} ({unit})", fontsize=8)
    row[0].legend(fontsize=6, ncols=2, loc="upper right")


def _running(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(x)
    parts = [p for p in np.array_split(order, min(14, max(order.size // 3, 1))) if p.size]
    return np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])


def _map(found: Finding) -> bytes:
    from matplotlib.figure import Figure

    streams = list(dict.fromkeys(p.stream for p in found.before))
    keys = list(dict.fromkeys(p.covariate for p in found.before))
    figure = Figure(figsize=(10.0, 0.8 + 0.32 * max(len(streams), 1)), layout="constrained")
    for axis, listed, title in zip(
        figure.subplots(1, 2), (found.before, found.after), ("before", "after"), strict=True
    ):
        grid = np.full((len(streams), len(keys)), np.nan)
        for place in listed:
            if place.stream in streams and place.covariate in keys:
                i, j = streams.index(place.stream), keys.index(place.covariate)
                value = -math.log10(max(place.p, 1e-6))
                grid[i, j] = value if np.isnan(grid[i, j]) else max(grid[i, j], value)
        axis.imshow(grid, cmap="magma_r", vmin=0.0, vmax=6.0, aspect="auto")
        axis.set_xticks(range(len(keys)), [k.replace("_", " ") for k in keys], rotation=60, fontsize=7, ha="right")
        axis.set_yticks(range(len(streams)), streams if title == "before" else [""] * len(streams), fontsize=7)
        axis.set_title(f"{title}: -log10 of chance", fontsize=8)
    return _png(figure)


def _png(figure: Any) -> bytes:
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    return data.getvalue()
