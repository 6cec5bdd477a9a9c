"""Text from files made fit to be shown: no control characters, no formulas. Standard library only."""

from __future__ import annotations

LONGEST = 400


def one_line(text: object, most: int = LONGEST) -> str:
    """Text on one line, without characters that terminals or XML take for commands, cut to ``most`` characters."""
    clean = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    return clean if len(clean) <= most else clean[: most - 1] + "…"


def drawn(text: object) -> str:
    """The same for matplotlib, in which no dollar sign starts a formula."""
    return one_line(text).replace("$", r"\$")
