"""What the site does to pages as it is built: equations become MathML, which needs no script and no network."""

from __future__ import annotations

import re

from latex2mathml.converter import convert

_BLOCK = re.compile(r"^\$\$(.+?)\$\$$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Called by mkdocs with the text of every page."""
    return _BLOCK.sub(lambda found: convert(found.group(1), display="block"), markdown)
