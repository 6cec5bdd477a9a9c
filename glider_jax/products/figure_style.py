"""Styles of the static figures: for the screen, for printed reports, and for papers.

``screen`` is what a pilot opens. ``print`` has the resolution of a printer and hatches, so that a grey copy still
tells the parts of a stack apart. ``paper`` has text large enough for two columns of a journal (180 mm), no heading
and no words beside the axes (they belong in the caption), and a PDF beside the PNG. Colours are the same everywhere:
the palette of Okabe and Ito and viridis, which any colour vision tells apart and whose lightness is monotone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.products.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Inches; room for the key of arrows, which counts for no extent.
_MARGIN = 0.3
HATCHES = ("", "////", "....", "\\\\\\\\", "xx", "----", "oo", "++")


@dataclass(frozen=True)
class Style:
    """How a figure is finished: dots per inch, factors on text and lines, words and hatches or not, a PDF or not."""

    name: str
    dpi: int
    text: float = 1.0
    line: float = 1.0
    words: bool = True
    hatched: bool = False
    vector: bool = False


STYLES = {
    "screen": Style("screen", 120),
    "print": Style("print", 300, line=1.15, hatched=True),
    "paper": Style("paper", 300, text=1.45, line=1.35, words=False, hatched=True, vector=True),
}


def style_of(name: str | Style) -> Style:
    """The style of a name.

    Raises
    ------
    ConfigError : no style is called so.
    """
    if isinstance(name, Style):
        return name
    if name not in STYLES:
        known = ", ".join(STYLES)
        raise ConfigError(f"--style: expected one of {known}, found '{name}'.{did_you_mean(name, STYLES)}")
    return STYLES[name]


def hatch(style: Style, k: int) -> str | None:
    """The hatching of the k-th part of a stack, or None."""
    return HATCHES[k % len(HATCHES)] if style.hatched else None


def save_figure(
    figure: Figure, path: str | Path, style: str | Style = "screen", *, dpi: int | None = None,
    metadata: Mapping[str, str | None] | None = None,
) -> Path:  # fmt: skip
    """Finish a figure in a style and write it as PNG, and as PDF beside it where the style wants one.

    Parameters
    ----------
    dpi : instead of the style's.
    metadata : of the PNG file.
    """
    # Here, because the commands check a style's name also where nothing is drawn.
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    style = style_of(style)
    if style.text != 1.0:
        for text in figure.findobj(Text):
            text.set_fontsize(text.get_fontsize() * style.text)
    if style.line != 1.0:
        for line in figure.findobj(Line2D):
            line.set_linewidth(line.get_linewidth() * style.line)
    # Without words the room for them is cut off.
    box = None if style.words else "tight"
    with atomic_path(path) as temporary:
        told = dict(metadata or {"Software": None})
        figure.savefig(
            temporary, format="png", dpi=dpi or style.dpi, bbox_inches=box, pad_inches=_MARGIN, metadata=told
        )
    if style.vector:
        with atomic_path(Path(path).with_suffix(".pdf")) as temporary:
            told = {"CreationDate": None}
            figure.savefig(temporary, format="pdf", bbox_inches=box, pad_inches=_MARGIN, metadata=told)
    return Path(path)
