"""The page of a plan: the answer, the trade-offs as charts and a table, what the answer hangs on, and the waypoints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.products import cartography as chart
from glider_jax.products.coordinates import place_text, unwrap_longitude
from glider_jax.products.html.charts import Chart, bars
from glider_jax.products.html.geography import bathymetry_layers, encode, wider
from glider_jax.products.html.page import (
    Safe,
    bullets,
    cards,
    page,
    paragraph,
    safe,
    section,
    settings_block,
    table,
    write_page,
)
from glider_jax.products.planning import Case, Setting
from glider_jax.products.planning_choice import GOALS, Recommendation, Sensitivity, pareto
from glider_jax.products.provenance import creation_time

_MOST_ROWS = 300
_SHAPES = ("o", "s", "^", "D", "v")
_STEPS = (
    (0.999, "c0", "above 99.9 %"),
    (0.9, "c5", "90 to 99.9 %"),
    (0.5, "c3", "50 to 90 %"),
    (-1.0, "c4", "below 50 %"),
)


def write_plan(
    case: Case, settings: Sequence[Setting], chosen: Sequence[Recommendation],
    hangs: Mapping[str, Sequence[Sensitivity]], words: Mapping[str, Any], path: str | Path, *, goal: str,
) -> Path:  # fmt: skip
    """Write the page of a plan.

    Parameters
    ----------
    case, settings, chosen, hangs : as flown and found by ``planning_report.run_plan``.
    words : ``subtitle``, ``answers`` (one text per recommendation), ``assumed`` (notes), ``names`` (a function that
        puts a setting in words) and ``made`` (provenance).
    goal : what the best is best in.
    """
    names = words["names"]
    drawn = _map(case)
    hanging = Safe("".join(_tornado(group, found, goal) for group, found in hangs.items() if found))
    refused = [f"{names(s)}: {s.refused}" for s in settings if s.refused]
    sections = [
        section("answer", "Answer", bullets(words["answers"])),
        section("trade-offs", "Trade-offs", _scatter(settings, chosen, names)),
        section("settings", "Every setting", _table(settings, chosen), _refused(refused)),
        section("hangs", "What the answer hangs on", hanging),
        section("map-part", "Mission", Safe('<div id="map" role="region" aria-label="Map of the mission"></div>')),
        section("assumed", "Assumed", bullets(words["assumed"])),
        section("provenance", "Provenance", settings_block({"created": creation_time({}), **words["made"]})),
    ]
    lead = [_headline(chosen, names)]
    text = page(f"How to fly {case.mission.name}", words["subtitle"], sections, lead=lead, data={"map": drawn})
    return write_page(path, text)


def _tornado(group: str, found: Sequence[Sensitivity], goal: str) -> str:
    """What a step of each parameter changes, in energy and in the goal."""
    shown = list(found)[:14]
    names = [f"{s.name} ({s.step})" for s in shown]
    drawn = []
    for pairs, label in (
        ([s.energy for s in shown], "change of energy drawn (Wh)"),
        ([s.goal for s in shown], f"change of {GOALS[goal][2]}"),
    ):
        value, error = np.array(pairs, float).T
        drawn.append(bars(names, value, error, label, f"{label} per step of each parameter"))
    head = f"<h3>{safe(group)}</h3>" if group else ""
    return f'{head}<div class="pair">{"".join(drawn)}</div>'


def _headline(chosen: Sequence[Recommendation], names) -> Safe:
    boxes = []
    for one in chosen:
        best = one.setting or one.best
        what = f"recommended{f' with {one.group}' if one.group else ''}" if one.setting else "no setting is sure enough"
        boxes.append((what, names(best), f"succeeds in {100 * best.probability:.0f} %"))
        if not best.refused:
            for label, values, unit in (
                ("days", best.days, ""), ("km", best.km, ""), ("energy", best.wh, " Wh"),
                ("charge left", 100 * best.left, " %"),
            ):  # fmt: skip
                low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
                digits = 1 if abs(middle) < 100 else 0
                name = f"{label}, {one.group}" if one.group else label
                boxes.append((name, f"{middle:,.{digits}f}{unit}", f"90 %: {low:,.{digits}f} to {high:,.{digits}f}"))
    return cards(boxes)


def _level(setting: Setting) -> tuple[str, str]:
    return next((kind, text) for least, kind, text in _STEPS if setting.probability >= least)


def _scatter(settings: Sequence[Setting], chosen: Sequence[Recommendation], names) -> Safe:
    """Km and profiles per day against energy per day, one mark a setting."""
    flown = [s for s in settings if not s.refused]
    if not flown:
        return paragraph("No setting could be flown.")
    front = {id(s) for s in pareto(flown)}
    stars = {id(r.setting) for r in chosen if r.setting is not None}
    word = next((k for k, v in flown[0].choices.items() if isinstance(v, str)), None)
    groups = list(dict.fromkeys(str(s.choices[word]) for s in flown)) if word else [""]
    x = [float(np.median(s.rate("wh"))) for s in flown]
    drawn = []
    for what, label in (("km", "km per day"), ("profiles", "profiles per day"), ("contacts", "surfacings per day")):
        y = [float(np.median(s.rate(what))) for s in flown]
        room = [0.06 * max(max(v) - min(v), 0.02 * max(max(v), 1e-6)) for v in (x, y)]
        one = Chart((min(x) - room[0], max(x) + room[0]), (min(y) - room[1], max(y) + room[1]), "Wh per day", label)
        for s, a, b in zip(flown, x, y, strict=True):
            kind, level = _level(s)
            told = f"{names(s)}: {b:.3g} {label}, {a:.3g} Wh per day, succeeds in {100 * s.probability:.0f} %"
            if id(s) in front:
                one.dot(a, b, "ring", size=8.0)
            shape = _SHAPES[groups.index(str(s.choices[word])) % len(_SHAPES)] if word else "o"
            star = id(s) in stars
            one.dot(a, b, f"dot {kind}", f"{told} ({level})", shape="*" if star else shape, size=7.0 if star else 4.5)
        drawn.append(one.figure(f"{label} against energy per day"))
    shapes = "circle square triangle diamond wedge".split()
    marks = ", ".join(f"{shapes[k % 5]} {g}" for k, g in enumerate(groups)) if word else ""
    key = "".join(
        f'<span class="key k{kind[1:]}"></span>{text} &nbsp; '
        for _, kind, text in _STEPS
        if any(_level(s)[0] == kind for s in flown)
    )
    told = "Ringed: no other setting is better in every respect. Star: recommended."
    return Safe(
        f'<div class="pair">{"".join(drawn)}</div><p class="small">Probability of success: {key}</p>'
        + paragraph(f"{told}{' Marks: ' + marks + '.' if marks else ''}", "soft small")
    )


def _table(settings: Sequence[Setting], chosen: Sequence[Recommendation]) -> Safe:
    flown = [s for s in settings if not s.refused]
    if not flown:
        return Safe("")
    front = {id(s) for s in pareto(flown)}
    stars = {id(r.setting) for r in chosen if r.setting is not None}
    ranked = sorted(flown, key=lambda s: (id(s) not in stars, id(s) not in front, -s.probability))
    choices = list(flown[0].choices)
    rows = []
    for s in ranked[:_MOST_ROWS]:
        mark = "recommended" if id(s) in stars else "front" if id(s) in front else ""
        medians = [float(np.median(getattr(s, name))) for name in ("days", "km", "profiles", "wh")]
        values = [f"{v:g}" if isinstance(v, float) else str(v) for v in s.choices.values()]
        rows.append(
            (
                mark, *values, f"{100 * s.probability:.0f}", f"{100 * s.finished.mean():.0f}", f"{medians[0]:.1f}",
                *(f"{v:,.0f}" for v in medians[1:]), f"{np.median(s.rate('wh')):.1f}", f"{100 * np.median(s.left):.0f}",
                f"{np.median(s.contacts):.0f}",
            )
        )  # fmt: skip
    head = ("", *(name.replace("_", " ") for name in choices), "P(success) %", "P(finish) %", "days", "km", "profiles",
            "Wh", "Wh per day", "charge left %", "surfacings")  # fmt: skip
    caption = "Medians of the members. Front: no other setting is better in every respect."
    if len(flown) > _MOST_ROWS:
        caption += f" {len(flown) - _MOST_ROWS} more settings are in plan.json."
    return table(head, rows, caption=caption, right=range(1, len(head)), tight=True)


def _refused(found: Sequence[str]) -> Safe:
    return Safe("<h3>Not flown</h3>" + bullets(found[:50])) if found else Safe("")


def _map(case: Case) -> dict[str, Any] | None:
    """The waypoints over the seafloor."""
    begin = case.start_position or case.mission.start_position
    points = [p for p in (begin, *case.mission.waypoints) if p is not None]
    if not points:
        return None
    places = np.array(points, float)
    reference = float(places[0, 1])
    longitude = unwrap_longitude(places[:, 1], reference)
    limits = chart.limits_around(places[:, 0], longitude, ratio=1.6, margin=0.2, least_km=5.0)
    drawn: dict[str, Any] = {"bounds": [[limits.south, limits.west], [limits.north, limits.east]]}
    if case.bathymetry is not None:
        drawn |= bathymetry_layers(case.bathymetry, wider(limits, 0.5))
    drawn["path"] = encode(longitude, places[:, 0])
    pins = []
    for k, (lat, lon) in enumerate(zip(places[:, 0], longitude, strict=True)):
        number = k if begin is not None else k + 1
        start = number == 0
        pins.append(
            {"place": [round(float(lat), 6), round(float(lon), 6)], "kind": "start" if start else "way",
             "label": "S" if start else str(number), "size": 20 if start else 24,
             "told": f"{'start' if start else f'waypoint {number}'}\n{place_text(float(lat), float(lon))}"}
        )  # fmt: skip
    drawn["pins"] = pins
    return drawn
