"""``glider-forecast terms``: every physics term, its equation, unknowns and source."""

from __future__ import annotations

import json
from typing import Annotated

import typer


def terms(
    id: Annotated[str | None, typer.Argument(help="Show one term, or all whose id begins so.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
    base: Annotated[bool, typer.Option("--base", help="Include the terms of the base model.")] = False,
) -> None:
    """List the physics the forecast can fly and the diagnosis can name."""
    from glider_jax.errors import ConfigError, did_you_mean
    from glider_jax.physics.catalogue import catalogue

    rows = catalogue(include_base=base or (id or "").startswith("base"))
    if id is not None:
        known = [row["id"] for row in rows]
        rows = [row for row in rows if row["id"] == id] or [row for row in rows if row["id"].startswith(id)]
        if not rows:
            raise ConfigError(
                f"terms: unknown term '{id}'.{did_you_mean(id, known)} Leave it out to list all."
            )
    if as_json:
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
    elif id is None:
        width = max(len(row["id"]) for row in rows)
        for row in rows:
            typer.echo(f"{row['id']:{width}}  {row['plain']}")
        typer.echo(f"{len(rows)} terms. More of one: glider-forecast terms ID", err=True)
    else:
        for row in rows:
            typer.echo(_describe(row))


def _describe(row: dict) -> str:
    """A term in a few lines of text."""
    lines = [f"{row['id']} ({row['title']})", f"  {row['plain']}", f"  equation: {row['equation']}"]
    for channel in row["channels"]:
        lines.append(f"  adds to: {channel['name']}, {channel['meaning']} [{channel['unit']}]")
    for p in row["parameters"]:
        prior = p["prior"]
        spread = f"{prior['centre']:.6g}" + (f" +- {prior['sd']:.3g}" if prior["sd"] else "")
        unit = "" if p["shown"] == "1" else f" {p['shown']}"
        lines.append(f"  {p['name']} = {spread}{unit}: {p['text']} ({p['role']}; {p['source']})")
    lines.append(f"  valid: {row['valid']}")
    lines.append(f"  source: {row['reference']}")
    if row["confusable_with"]:
        lines.append(f"  easily confused with: {', '.join(row['confusable_with'])}")
    if row["decided_by"]:
        lines.append(f"  decided by: {row['decided_by']}")
    return "\n".join(lines) + "\n"
