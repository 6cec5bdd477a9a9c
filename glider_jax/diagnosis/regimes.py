"""Missions that differ: a recording with a long hole is several, each diagnosed by itself and then compared.

Imports NumPy and the readers. A newcomer would get wrong: what differs between two missions is what somebody changed
on deck or in a file, and a growth fitted across the hole would name it wrongly. The last mission is the one that the
next forecast continues.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from glider_jax.readers.dives import between, legs
from glider_jax.records import Array, Recording

if TYPE_CHECKING:
    from glider_jax.diagnosis.run import Finding

#: s; a longer hole parts two missions. Half yos that a part must have to be diagnosed. Standard deviations that count.
HOLE, FEWEST, SURE = 43200.0, 8, 3.0


def split(recording: Recording) -> list[Recording]:
    """The missions of a recording, in order; parts that never dived are left out, one mission comes back as it is."""
    wide = np.flatnonzero(np.diff(recording.time) > HOLE)
    if wide.size == 0:
        return [recording]
    edges = [-math.inf, *(0.5 * (recording.time[wide] + recording.time[wide + 1])), math.inf]
    found = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        part = between(recording, low, high)
        channels = {name: v for name, v in part.channels.items() if np.isfinite(v).any()}
        starts = part.segment_start[(part.segment_start >= low) & (part.segment_start < high)]
        part = replace(part, channels=channels, segment_start=starts)
        if "depth" in part and len(legs(part)) >= FEWEST:
            found.append(part)
    return found or [recording]


def levels(found: Finding) -> dict[str, tuple[float, float, str, str]]:
    """What can be compared between missions: value, sd, unit and text by name.

    Loads are means as measured, with their scatter between blocks; flight numbers are those of the fit.
    """
    told: dict[str, tuple[float, float, str, str]] = {}
    for name in ("hotel power, dives", "hotel power, climbs", "surface power", "pump out energy", "pump in energy"):
        stream = found.gathered.stream(name)
        if stream is not None:
            value, sd = _mean(stream.value, stream.block)
            told[name] = (value, sd, stream.shown, name)
    search, mean = found.search, found.mean
    replay = search.problem.replay
    own = [search.linear.labels[column].unknown for column in search.active]
    place = {k: n for n, k in enumerate(own)}
    values, sds, _ = replay.stated(own, mean, found.covariance)
    for n, unknown in enumerate(replay.unknowns):
        if n not in place or unknown.name not in ("flight.mass", "flight.parasite_drag"):
            continue
        share = _bias(found, place) if unknown.name == "flight.parasite_drag" else 0.0
        value, sd = values[place[n]] * (1.0 + share), sds[place[n]]
        unit = "kg" if unknown.name == "flight.mass" else ""
        text = "mass" if unit else "drag coefficient, turns included"
        told[unknown.name] = (float(value), float(max(sd, 0.01 * abs(value) if not unit else 0.005)), unit, text)
    return told


def _bias(found: Finding, place: dict[int, int]) -> float:
    """Share of drag beyond the calibrated one, by a bias and by turning as much as the glider did on average."""
    rows = found.gathered.inputs.rows
    wet = np.asarray(rows["direction"]) != 0.0
    turning = float(np.mean(np.abs(np.asarray(rows["turn_rate"])[wet]))) if wet.any() else 0.0
    share = 0.0
    for n, unknown in enumerate(found.search.problem.replay.unknowns):
        weight = {"flight.drag_bias.share": 1.0, "flight.turn_drag.time": turning}.get(unknown.name)
        if weight is not None and n in place:
            share += weight * float(unknown.centre + unknown.scale * found.mean[place[n]])
    return share


def _mean(values: Array, block: Array) -> tuple[float, float]:
    means = np.array([values[block == b].mean() for b in np.unique(block)])
    sd = float(means.std(ddof=1) / np.sqrt(means.size)) if means.size > 1 else float(values.std())
    return float(np.mean(values)), max(sd, 1e-9)


def compare(first: dict[str, Any], second: dict[str, Any]) -> list[dict[str, Any]]:
    """Levels of :func:`levels` that surely differ between two missions, the surest first."""
    found = []
    for name in first:
        if name not in second:
            continue
        (a, sa, unit, text), (b, sb, _, _) = first[name], second[name]
        z = (b - a) / math.hypot(sa, sb)
        if abs(z) > SURE:
            found.append({
                "name": name, "text": text, "unit": unit, "before": a, "after": b, "sd_before": sa, "sd_after": sb,
                "z": z,
            })  # fmt: skip
    return sorted(found, key=lambda one: -abs(one["z"]))


def join(contents: list[dict[str, Any]], compared: list[dict[str, Any]]) -> dict[str, Any]:
    """The diagnosis of the last mission, with what the missions before it were and what changed between them.

    Parameters
    ----------
    contents : diagnosis of each mission, in order. compared : levels of each mission.
    """
    whole = dict(contents[-1])
    regimes, sentences = [], []
    for number, (content, told) in enumerate(zip(contents, compared, strict=True), start=1):
        changes = compare(compared[number - 2], told) if number > 1 else []
        recording = content["recording"]
        regimes.append({
            "number": number, "start": recording["start"], "days": recording["days"], "legs": recording["legs"],
            "verdict": content["verdict"], "summary": content["summary"], "changes": changes,
            "effects": [effect["id"] for effect in content["effects"]],
            "titles": [effect["title"] for effect in content["effects"]],
            "levels": {name: {"value": v[0], "sd": v[1], "unit": v[2]} for name, v in told.items()},
        })  # fmt: skip
        if changes:
            listed = "; ".join(_change(one) for one in changes[:4])
            sentences.append(f"Between mission {number - 1} and {number}: {listed}.")
    gap = (contents[-1]["recording"]["start"] - contents[-2]["recording"]["start"]) / 86400.0
    said = f"{len(contents)} missions in one recording, the last begun {gap:.1f} days after the one before: each was "
    said += "diagnosed by itself, because what differs between them may be a setting rather than physics."
    if sentences:
        said += " " + " ".join(sentences)
    whole["regimes"] = regimes
    whole["warnings"] = [said, *whole["warnings"]]
    earlier = " ".join(f"Mission {r['number']}: {r['summary']}" for r in regimes[:-1])
    whole["summary"] = f"{earlier} Mission {len(regimes)}, which the next forecast continues: {whole['summary']}"
    return whole


def _change(one: dict[str, Any]) -> str:
    unit = f" {one['unit']}" if one["unit"] else ""
    return f"{one['text']} from {one['before']:.3g} to {one['after']:.3g}{unit}"
