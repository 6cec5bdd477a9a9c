"""The page of a validation: published and own numbers side by side, the figures, and what is assumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from glider_jax.products.coordinates import iso_time
from glider_jax.products.html.charts import Chart
from glider_jax.products.html.page import (
    Safe,
    cards,
    page,
    paragraph,
    picture,
    section,
    settings_block,
    table,
    write_page,
)
from glider_jax.products.provenance import creation_time

_LARGEST_PICTURE = 400_000


def write_validation(
    numbers: Mapping[str, Any], figures: Mapping[str, Path], path: str | Path, *, markdown: str,
    settings: Mapping[str, Any] | None = None,
) -> Path:  # fmt: skip
    """Write the page of a validation.

    Parameters
    ----------
    numbers : as ``validation.json`` holds them.
    figures : PNG files by name, put inside; none larger than 400 kB.
    markdown : the page in words, whose remarks are shown in full at the end.
    settings : members, seed and inputs.
    """
    rows = numbers["rows"]
    small = {name: file for name, file in figures.items() if file.stat().st_size <= _LARGEST_PICTURE}
    drawn = "".join(picture(file, name.replace("-", " ")) for name, file in small.items())
    pictures = Safe(f'<div class="pair">{drawn}</div>' if drawn else "")
    left_out = [name for name in figures if name not in small]
    if left_out:
        pictures = Safe(pictures + paragraph(f"Too large for this page: {', '.join(left_out)}."))
    made = {"seed": (settings or {}).get("seed"), "created": creation_time(settings or {}), "settings": settings or {},
            "inputs": (settings or {}).get("inputs") or {}}  # fmt: skip
    sections = [
        section("rows", "Published and own", _charts(rows), _table(rows)),
        section("water", "The same through the water", _table(numbers["through_water"])),
        section("flown", "A flown mission", _flown(numbers["flown"])),
        section("figures", "Figures", pictures),
        section("remarks", "What is assumed, in full", Safe(f"<pre>{_lines(markdown)}</pre>")),
        section("provenance", "Provenance", settings_block(made)),
    ]
    members = rows[0]["members"] if rows else 0
    subtitle = f"The simulations of Woithe and others (2010), flown again · {members} members a row"
    return write_page(path, page("Validation", subtitle, sections, lead=[_headline(rows)]))


def _lines(text: str) -> str:
    return escape("\n".join("".join(c for c in line if c.isprintable()) for line in text.splitlines()))


def _headline(rows: Sequence[Mapping[str, Any]]) -> Safe:
    boxes = []
    for key, what in (("days_difference", "days"), ("energy_difference", "energy")):
        found = [abs(row[key]) for row in rows if row[key] is not None]
        worst = max(rows, key=lambda row: abs(row[key] or 0.0)) if found else None
        if worst is not None:
            boxes.append((f"largest difference of {what}", f"{100 * worst[key]:+.1f} %", worst["name"]))
    boxes.append(("rows", str(len(rows)), "each with its spread below"))
    return cards(boxes)


def _table(rows: Sequence[Mapping[str, Any]]) -> Safe:
    cells = []
    for row in rows:
        low, middle, high = row["ours_days"]
        less, energy, more = row["ours_kilojoules"]
        cells.append(
            (
                row["name"], _number(row["days"], 2), _number(middle, 2), f"{_number(low, 2)} to {_number(high, 2)}",
                _share(row["days_difference"]), _number(row["kilojoules"], 0), _number(energy, 0),
                f"{_number(less, 0)} to {_number(more, 0)}", _share(row["energy_difference"]),
            )
        )  # fmt: skip
    half = ("ours", "5 to 95 %", "difference")
    head = ("simulation", "days, paper", *half, "kJ, paper", *half)
    return table(head, cells, right=range(1, 9), tight=True)


def _charts(rows: Sequence[Mapping[str, Any]]) -> Safe:
    """Ours against the published number, with spreads; the line is equality."""
    drawn = []
    for paper, ours, label in (("days", "ours_days", "days"), ("kilojoules", "ours_kilojoules", "kJ")):
        shown = [row for row in rows if row[paper] is not None and row[ours][1] is not None]
        if not shown:
            continue
        values = [row[paper] for row in shown] + [v for row in shown for v in row[ours] if v is not None]
        room = 0.06 * (max(values) - min(values))
        span = (min(values) - room, max(values) + room)
        chart = Chart(span, span, f"published ({label})", f"ours ({label})")
        chart.line(list(span), list(span), "faint")
        for row in shown:
            low, middle, high = row[ours]
            if low is not None and high is not None:
                chart.whisker(row[paper], low, high)
            kind, shape = ("c0", "s") if "hoebox" in row["name"] else ("c4", "o")
            told = f"{row['name']}: {row[paper]:g} and {middle:.4g} {label}"
            chart.dot(row[paper], middle, f"dot {kind}", told, shape=shape)
        caption = "Squares: shoebox; circles: distribution. On the line both agree."
        drawn.append(chart.figure(f"Own against published {label}", caption))
    return Safe(f'<div class="pair">{"".join(drawn)}</div>')


def _flown(dives: Sequence[Mapping[str, Any]]) -> Safe:
    if not dives:
        return Safe("")
    beliefs = list(dives[0]["miss"])
    rows = [
        (
            dive["number"], iso_time(dive["start"]) or "-", _number(dive["displacement"] / 1e3, 2),
            *(_number(_scaled(dive["miss"].get(name), 1e3), 2) for name in beliefs),
            _number(_scaled(dive["late"], 60.0), 1), _number(_scaled(dive["energy"][1], 1e3), 1),
            _number(_scaled(dive["true_energy"], 1e3), 1),
            "yes" if dive["inside"] else "no",
        )
        for dive in dives
    ]  # fmt: skip
    head = ("dive", "from", "way km", *(f"off km, current {name}" for name in beliefs), "late min", "kJ, ours",
            "kJ, flown", "in 90 % region")  # fmt: skip
    return table(head, rows, right=range(2, len(head)), tight=True)


def _scaled(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:+.1f} %"
