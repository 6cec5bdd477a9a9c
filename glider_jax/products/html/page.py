"""One self-contained page: text made safe, tables, cards, and the script and style sheet put inside.

Nothing in a page is fetched: a content security policy forbids it and lets only the scripts run whose digests it
names, so that text from files could not run even if it were not escaped. Standard library only.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from glider_jax import __version__
from glider_jax.products.atomic import write_text
from glider_jax.products.wording import one_line
from glider_jax_data import folder

#: What a page is put together from.
ASSETS = ("leaflet/leaflet.js", "leaflet/leaflet.css", "leaflet/LICENSE", "report.css", "report.js")
_LONGEST = 4000


class Safe(str):
    """Markup that is already escaped; every other text is escaped when it is put on a page."""


@cache
def asset(name: str) -> str:
    """The text of a script, style sheet or licence that comes with the package."""
    return folder().joinpath("web", name).read_text(encoding="utf-8")


def safe(value: object) -> Safe:
    """Text without control characters and with everything that markup takes for a command escaped."""
    return value if isinstance(value, Safe) else Safe(html.escape(one_line(value, _LONGEST), quote=True))


def paragraph(text: object, kind: str = "") -> Safe:
    """A paragraph, of a class if one is named."""
    return Safe(f'<p class="{kind}">{safe(text)}</p>' if kind else f"<p>{safe(text)}</p>")


def bullets(items: Iterable[object]) -> Safe:
    """A list of notes; nothing where there are none."""
    found = "".join(f"<li>{safe(item)}</li>" for item in items)
    return Safe(f'<ul class="notes">{found}</ul>' if found else "")


def table(
    head: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    caption: str = "",
    right: Iterable[int] = (),
    frames: Sequence[int] | None = None,
    tight: bool = False,
) -> Safe:
    """A table that scrolls sideways on a narrow screen.

    Parameters
    ----------
    head : column headings.  rows : cells, the first of each the row's heading.
    right : columns set to the right, for numbers.
    frames : for each row the frame of the slider that belongs to it.
    tight : whether cells stay on one line.
    """
    sides = set(right)

    def cell(k: int, text: object, tag: str) -> str:
        scope = ' scope="row"' if tag == "th" else ""
        side = ' class="r"' if k in sides else ""
        return f"<{tag}{scope}{side}>{safe(text)}</{tag}>"

    heading = "".join(
        f'<th scope="col"{" class=r" if k in sides else ""}>{safe(text)}</th>' for k, text in enumerate(head)
    )
    body = []
    for number, row in enumerate(rows):
        mark = f' data-frame="{frames[number]}"' if frames is not None else ""
        body.append(f"<tr{mark}>" + "".join(cell(k, t, "td" if k else "th") for k, t in enumerate(row)) + "</tr>")
    if not body:
        return Safe("")
    title = f"<caption>{safe(caption)}</caption>" if caption else ""
    kind = " class=tight" if tight else ""
    return Safe(
        f'<div class="wide"><table{kind}>{title}<thead><tr>{heading}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def cards(items: Iterable[tuple[object, object, object]]) -> Safe:
    """Boxes of what is read first: what it is, its value, and how sure or where."""
    found = "".join(
        f'<div class="card"><span class="what">{safe(what)}</span><b>{safe(value)}</b>'
        f'<span class="more">{safe(more)}</span></div>'
        for what, value, more in items
    )
    return Safe(f'<div class="cards">{found}</div>')


def warnings(items: Sequence[object]) -> Safe:
    """What a reader must know before believing the rest."""
    return Safe(f'<div class="warn" role="note">{bullets(items)}</div>') if items else Safe("")


def section(name: str, title: str, *parts: object) -> tuple[str, str, Safe]:
    """A part of the page: its anchor, its title and what it holds; left out where that is empty."""
    return name, title, Safe("".join(safe(part) for part in parts))


def unfold(title: str, text: str) -> Safe:
    """Long text behind a line that opens it."""
    # Settings keep their line ends, so control characters go one line at a time.
    lines = "\n".join(html.escape(one_line_kept(line)) for line in text.splitlines())
    return Safe(f"<details><summary>{safe(title)}</summary><pre>{lines}</pre></details>")


def one_line_kept(line: str) -> str:
    """A line with its indentation, without control characters."""
    return "".join(c for c in line if c.isprintable())


def picture(path: Path, title: str) -> Safe:
    """A PNG file put inside the page."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return Safe(
        f'<figure><img class="figure" alt="{safe(title)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{safe(title)}</figcaption></figure>"
    )


def settings_block(made: Mapping[str, Any]) -> Safe:
    """Who made it, from what, with which physics, and every setting."""
    version, seed = made.get("version") or __version__, made.get("seed")
    rows = [
        ("software", f"glider_jax {version}"),
        ("made", made.get("created") or "-"),
        ("seed", "-" if seed is None else seed),
        ("physics", ", ".join(map(str, made.get("terms") or [])) or "-"),
    ]
    inputs = [(Path(str(name)).name, Safe(f"<code>{safe(digest)}</code>")) for name, digest in _inputs(made)]
    return Safe(
        table(("what", ""), rows)
        + table(("input file", "SHA-256"), inputs)
        + unfold("All settings", json.dumps(made.get("settings") or {}, indent=1, sort_keys=True, ensure_ascii=False))
    )


def _inputs(made: Mapping[str, Any]) -> list[tuple[str, str]]:
    inputs = made.get("inputs") or {}
    return list(inputs.items()) if isinstance(inputs, Mapping) else [(str(name), "-") for name in inputs]


def page(
    title: str,
    subtitle: str,
    sections: Sequence[tuple[str, str, Safe]],
    *,
    lead: Sequence[Safe] = (),
    data: Mapping[str, Any] | None = None,
) -> str:
    """The whole page.

    Parameters
    ----------
    title, subtitle : heading, and when and what in one line; escaped here.
    sections : from :func:`section`; empty ones are left out.
    lead : what stands above the sections.
    data : ``map`` and ``frames`` for the script, ready for JSON.
    """
    sections = [entry for entry in sections if entry[2]]
    with_map = bool(data and data.get("map"))
    scripts = [asset("leaflet/leaflet.js")] if with_map else []
    scripts.append(asset("report.js"))
    styles = [_without_files(asset("leaflet/leaflet.css"))] if with_map else []
    styles.append(asset("report.css"))
    digests = " ".join(f"'sha256-{_digest(text)}'" for text in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {digests}; "
        "base-uri 'none'; form-action 'none'"
    )
    # A closing tag inside the data would end it early.
    told = json.dumps(data or {}, allow_nan=False, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    links = "".join(f'<a href="#{name}">{safe(text)}</a>' for name, text, _ in sections)
    body = "".join(f'<section id="{name}"><h2>{safe(text)}</h2>{part}</section>' for name, text, part in sections)
    licence = f"<!-- Leaflet: {asset('leaflet/LICENSE').replace('--', '- -')} -->" if with_map else ""
    thanks = " The map is drawn by Leaflet (BSD-2-Clause)." if with_map else ""
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en" data-theme="light"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<link rel="icon" href="data:,">',
            f"<title>{safe(title)}</title>",
            *(f"<style>{text}</style>" for text in styles),
            licence,
            "</head><body>",
            f'<header><div class="top"><h1>{safe(title)}</h1>'
            '<button id="theme" class="no-print" type="button" aria-label="Light or dark">Dark</button></div>'
            f'<p class="soft num">{safe(subtitle)}</p>{"".join(lead)}<nav aria-label="Parts">{links}</nav></header>',
            f"<main>{body}</main>",
            f"<footer><p>Made by glider_jax {safe(__version__)}. This file is whole: it needs no network.{thanks}</p>"
            "</footer>",
            f'<script type="application/json" id="data">{told}</script>',
            *(f"<script>{text}</script>" for text in scripts),
            "</body></html>",
            "",
        ]
    )


def write_page(path: str | Path, text: str) -> Path:
    """Write the page, whole or not at all."""
    return write_text(path, text)


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _without_files(style: str) -> str:
    """A style sheet whose pictures, which a single file cannot have, are left out."""
    return re.sub(r"(background-image|behavior):\s*url\([^)]*\)\s*;?", "", style)
