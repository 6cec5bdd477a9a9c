"""Make the pages of the documentation that come from the code: ``python docs/make_pages.py``.

``physics-terms.md`` lists every term of the library. The API pages are made when the site is built.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from glider_jax.physics.catalogue import catalogue

HERE = Path(__file__).parent


def number(value: float) -> str:
    """A number in four digits."""
    return f"{value:.4g}"


def cell(text: str) -> str:
    """Text that may stand in a cell of a table."""
    return text.replace("|", "\\|").replace("\n", " ")


def parameters(row: dict) -> list[str]:
    """A term's parameters as a table."""
    if not row["parameters"]:
        return []
    lines = ["| parameter | prior | unit | what it is | source |", "| --- | --- | --- | --- | --- |"]
    for p in row["parameters"]:
        prior, unit = p["prior"], "" if p["shown"] == "1" else p["shown"]
        spread = number(prior["centre"]) + (f" ± {number(prior['sd'])}" if prior["sd"] else "")
        role = f" ({p['role']})" if p["role"] != "amplitude" else ""
        lines.append(
            f"| `{p['name']}`{role} | {spread} | {cell(unit)} | {cell(p['text'])} | {cell(p['source'] or '')} |"
        )
    return [*lines, ""]


def part_of(row: dict) -> str:
    """The part of the library that a term belongs to."""
    return row["id"].split(".")[0]


def term(row: dict) -> list[str]:
    """One term: words, equation, what it adds to, parameters, range, source, and what it is confused with."""
    lines = [f"### `{row['id']}`", "", f"**{row['title']}.** {row['plain']}", "", f"$${row['equation']}$$", ""]
    lines += [f"Adds to {c['name'].replace('_', ' ')}: {c['meaning']} [{c['unit']}]." for c in row["channels"]]
    lines += [f"Reads {', '.join(f'`{name}`' for name in row['reads'])}." if row["reads"] else "Reads nothing."]
    lines += ["", *parameters(row), f"Valid: {row['valid']}", "", f"Source: {row['reference']}", ""]
    if row["confusable_with"]:
        lines.append(f"Easily confused with {', '.join(f'`{other}`' for other in row['confusable_with'])}.")
    if row["decided_by"]:
        lines.append(f"Decided by: {row['decided_by']}")
    return [*lines, ""]


def terms_page() -> str:
    """The page of all terms, the base model first, then by part of the library."""
    rows = catalogue(include_base=True)
    lines = [
        "# Physics terms",
        "",
        f"The {len(rows)} terms of the library, made from the code by `python docs/make_pages.py`. The same objects",
        "run in the forecast, in the fit and in the diagnosis. Priors are written centre ± standard deviation in the",
        "unit that reports show. One of them on the command line: `glider-forecast terms flight.pitch_gain`.",
        "",
    ]
    order = list(dict.fromkeys(part_of(row) for row in rows))
    rows.sort(key=lambda row: order.index(part_of(row)))
    for part, group in groupby(rows, key=part_of):
        lines += [f"## {part.capitalize()}", ""]
        for row in group:
            lines += term(row)
    return "\n".join(lines).rstrip() + "\n"


PAGES = {"physics-terms.md": terms_page}


def main() -> None:
    """Write every page."""
    for name, make in PAGES.items():
        (HERE / name).write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    main()
