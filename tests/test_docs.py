"""The documentation says what the code does: pages made from it are fresh, and what is to be copied works."""

from __future__ import annotations

import re
from pathlib import Path

import jax.numpy as jnp
import pytest

from glider_jax.physics.term import AbstractTerm, Sample, make

DOCS = Path(__file__).parent.parent / "docs"


def blocks(page: str, language: str) -> list[str]:
    """The fenced blocks of a page in one language."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def test_pages_made_from_the_code_are_fresh():
    source = DOCS / "make_pages.py"
    space = {"__name__": "make_pages", "__file__": str(source)}
    exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), space)
    for name, page in space["PAGES"].items():
        assert (DOCS / name).read_text(encoding="utf-8") == page(), f"run python docs/make_pages.py: {name} is stale"


def test_the_example_of_a_new_term_works():
    (code,) = blocks("adding-a-term.md", "python")
    space: dict = {"__name__": "example"}
    exec(compile(code, "adding-a-term.md", "exec", dont_inherit=True), space)
    kinds = [value for value in space.values() if isinstance(value, type) and issubclass(value, AbstractTerm)]
    (kind,) = set(kinds) - {AbstractTerm}
    term = make(kind, jnp.float32, power=0.4, switch=277.15)
    # Half the power at the switch, all of it in the cold, none in the warm.
    for temperature, power in ((277.15, 0.2), (270.0, 0.4), (290.0, 0.0)):
        assert float(term(Sample.of(jnp.float32, temperature=temperature))) == pytest.approx(power, abs=1e-5)


def test_links_between_pages_lead_somewhere():
    for page in DOCS.glob("*.md"):
        for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if not target.startswith(("http://", "https://", "mailto:")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"
