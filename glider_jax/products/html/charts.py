"""Charts as SVG markup: they need no script, print sharp, and take their colours from the page's light or dark style.

Coordinates of a chart are plain numbers or days since 1970 (UTC); ``Chart`` turns them into places in the picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np

from glider_jax.products.html.page import Safe, safe
from glider_jax.records import Array

_WIDTH, _HEIGHT = 520.0, 290.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 12.0, 14.0, 42.0
_HOURS = (1, 2, 3, 6, 12, 24, 48, 72, 120, 168, 240, 336, 720, 1440, 2160)


class Chart:
    """A chart under construction.

    Parameters
    ----------
    x, y : lowest and highest value of the axes.
    x_label, y_label : names with units.
    time : whether x is days since 1970.  log : whether both axes are logarithmic.
    height : of the picture in its own units; the width is 520.
    left : room for the labels of the y axis.
    """

    def __init__(
        self, x: tuple[float, float], y: tuple[float, float], x_label: str, y_label: str, *, time: bool = False,
        log: bool = False, height: float = _HEIGHT, left: float = _LEFT,
    ) -> None:  # fmt: skip
        self._x, self._y, self._log = _apart(x, log), _apart(y, log), log
        self._left, self._height = left, height
        self._wide, self._high = _WIDTH - left - _RIGHT, height - _TOP - _BOTTOM
        self._labels = (x_label, y_label)
        self._time = time
        self._parts: list[str] = []
        self._front: list[str] = []

    def px(self, value: float) -> float:
        """Horizontal place of a value."""
        return self._left + self._share(value, self._x) * self._wide

    def py(self, value: float) -> float:
        """Vertical place of a value."""
        return _TOP + (1.0 - self._share(value, self._y)) * self._high

    def _share(self, value: float, span: tuple[float, float]) -> float:
        low, high = span
        if self._log:
            value, low, high = math.log10(max(value, low * 1e-3)), math.log10(low), math.log10(high)
        return (value - low) / (high - low)

    def _points(self, x: Array, y: Array) -> str:
        return " ".join(f"{self.px(float(a)):.1f},{self.py(float(b)):.1f}" for a, b in zip(x, y, strict=True))

    def band(self, x: Array, low: Array, high: Array, kind: str) -> None:
        """An area between two lines."""
        points = f"{self._points(x, low)} {self._points(x[::-1], np.asarray(high)[::-1])}"
        self._parts.append(f'<polygon class="{kind}" points="{points}"/>')

    def line(self, x: Array, y: Array, kind: str = "line") -> None:
        """A line."""
        self._parts.append(f'<polyline class="{kind}" points="{self._points(np.asarray(x), np.asarray(y))}"/>')

    def level(self, y: float, kind: str, text: str = "") -> None:
        """A horizontal line with words at its left end."""
        place = self.py(y)
        right = self._left + self._wide
        self._front.append(f'<path class="{kind}" d="M{self._left:.1f} {place:.1f}H{right:.1f}"/>')
        if text:
            self._front.append(
                f'<text class="{kind}-text" x="{self._left + 5:.1f}" y="{place - 4:.1f}">{safe(text)}</text>'
            )

    def dot(self, x: float, y: float, kind: str, told: str = "", *, size: float = 4.5, shape: str = "o") -> None:
        """A mark whose words appear under the pointer."""
        a, b = self.px(x), self.py(y)
        title = f"<title>{safe(told)}</title>" if told else ""
        self._front.append(f'<path class="{kind}" d="{_mark(a, b, size, shape)}">{title}</path>')

    def whisker(self, x: float, low: float, high: float) -> None:
        """A vertical bar of uncertainty."""
        self._front.append(f'<path class="bar-error" d="M{self.px(x):.1f} {self.py(low):.1f}V{self.py(high):.1f}"/>')

    def text(self, x: float, y: float, words: str, kind: str = "tick") -> None:
        """Words at a place."""
        a, b = self.px(x) + 6.0, self.py(y) + 4.0
        self._front.append(f'<text class="{kind}" x="{a:.1f}" y="{b:.1f}">{safe(words)}</text>')

    def figure(self, title: str, caption: str = "", *, cursor: bool = False) -> Safe:
        """The chart as a figure; ``title`` is what a screen reader says."""
        low, high = self._left, self._left + self._wide
        foot = _TOP + self._high
        parts = []
        for value in ticks(*self._y, log=self._log, wanted=5):
            y = self.py(value)
            parts.append(f'<path class="grid" d="M{low:.1f} {y:.1f}H{high:.1f}"/>')
            parts.append(
                f'<text class="tick" text-anchor="end" x="{low - 6:.1f}" y="{y + 4:.1f}">{number(value)}</text>'
            )
        marks = day_ticks(*self._x) if self._time else [(v, number(v)) for v in ticks(*self._x, log=self._log)]
        for value, words in marks:
            x = self.px(value)
            parts.append(f'<path class="grid" d="M{x:.1f} {_TOP}V{foot:.1f}"/>')
            anchor = "middle" if low + 20 < x < high - 20 else ("start" if x <= low + 20 else "end")
            parts.append(f'<text class="tick" text-anchor="{anchor}" x="{x:.1f}" y="{foot + 15:.1f}">{words}</text>')
        parts += self._parts
        parts.append(f'<path class="axis" d="M{low:.1f} {_TOP}V{foot:.1f}H{high:.1f}" fill="none"/>')
        parts += self._front
        if cursor:
            parts.append(f'<line class="cursor no-print" x1="{low:.1f}" x2="{low:.1f}" y1="{_TOP}" y2="{foot:.1f}"/>')
        x_label, y_label = (safe(text) for text in self._labels)
        parts.append(f'<text text-anchor="middle" x="{(low + high) / 2:.1f}" y="{foot + 34:.1f}">{x_label}</text>')
        parts.append(
            f'<text text-anchor="middle" transform="translate(13 {_TOP + self._high / 2:.1f}) rotate(-90)">'
            f"{y_label}</text>"
        )
        told = f"<figcaption>{safe(caption)}</figcaption>" if caption else ""
        return Safe(
            f'<figure><svg class="chart" role="img" aria-label="{safe(title)}" '
            f'viewBox="0 0 {_WIDTH:g} {self._height:g}" data-left="{low:g}" data-wide="{self._wide:g}">'
            f"{''.join(parts)}</svg>{told}</figure>"
        )


def bars(names: Sequence[str], values: Array, errors: Array | None, label: str, title: str, caption: str = "") -> Safe:
    """Horizontal bars around zero with standard errors, the first at the top."""
    values = np.asarray(values, float)
    spread = np.zeros_like(values) if errors is None else np.abs(np.asarray(errors, float))
    low, high = min(0.0, float((values - spread).min())), max(0.0, float((values + spread).max()))
    low, high = _apart((low, high), False)
    row, left, right, top = 24.0, 236.0, 14.0, 8.0
    wide, height = _WIDTH - left - right, top + row * len(values) + 40.0

    def px(value: float) -> float:
        return left + (value - low) / (high - low) * wide

    foot = top + row * len(values)
    parts = []
    for value in ticks(low, high, wanted=4):
        parts.append(f'<path class="grid" d="M{px(value):.1f} {top}V{foot:.1f}"/>')
        parts.append(
            f'<text class="tick" text-anchor="middle" x="{px(value):.1f}" y="{foot + 15:.1f}">{number(value)}</text>'
        )
    for k, (name, value, error) in enumerate(zip(names, values, spread, strict=True)):
        y = top + row * k
        a, b = sorted((px(0.0), px(float(value))))
        kind = "c4" if value > 0 else "c0"
        parts.append(
            f'<rect class="{kind}" x="{a:.1f}" y="{y + 4:.1f}" width="{max(b - a, 0.5):.1f}" height="{row - 9:.1f}">'
            f"<title>{safe(f'{name}: {value:+.3g} +- {error:.2g}')}</title></rect>"
        )
        if errors is not None:
            parts.append(
                f'<path class="bar-error" d="M{px(value - error):.1f} {y + row / 2:.1f}H{px(value + error):.1f}"/>'
            )
        shown = name if len(name) <= 40 else name[:39] + "…"
        parts.append(
            f'<text class="tick" text-anchor="end" x="{left - 8:.1f}" y="{y + row / 2 + 4:.1f}">{safe(shown)}</text>'
        )
    parts.append(f'<path class="axis" d="M{px(0.0):.1f} {top}V{foot:.1f}" fill="none"/>')
    parts.append(f'<text text-anchor="middle" x="{left + wide / 2:.1f}" y="{foot + 33:.1f}">{safe(label)}</text>')
    told = f"<figcaption>{safe(caption)}</figcaption>" if caption else ""
    return Safe(
        f'<figure><svg class="chart" role="img" aria-label="{safe(title)}" viewBox="0 0 {_WIDTH:g} {height:g}">'
        f"{''.join(parts)}</svg>{told}</figure>"
    )


def ticks(low: float, high: float, *, log: bool = False, wanted: int = 6) -> list[float]:
    """Round numbers between two values."""
    if log:
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        steps = (1.0,) if last - first > 3 else ((1.0, 3.0) if last - first > 1 else (1.0, 2.0, 5.0))
        found = [s * 10.0**k for k in range(first, last + 1) for s in steps]
        return [v for v in found if low * 0.999 <= v <= high * 1.001]
    rough = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough)
    return [step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def day_ticks(low: float, high: float, wanted: int = 6) -> list[tuple[float, str]]:
    """Times between two days since 1970 and their words: the date at midnight, else the hour."""
    step = next((h for h in _HOURS if h >= (high - low) * 24.0 / wanted), _HOURS[-1])
    first = math.ceil(low * 24.0 / step - 1e-9)
    found = []
    for k in range(first, math.floor(high * 24.0 / step + 1e-9) + 1):
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(hours=k * step)
        words = f"{moment.day} {moment:%b}" if moment.hour == 0 else f"{moment:%H}Z"
        found.append((k * step / 24.0, words))
    return found


def number(value: float) -> str:
    """A tick in few characters."""
    return "0" if abs(value) < 1e-12 else f"{value:,.10g}"


def _apart(span: tuple[float, float], log: bool) -> tuple[float, float]:
    """Two ends of an axis that differ."""
    low, high = float(span[0]), float(span[1])
    if log:
        low = max(low, 1e-9)
        return (low, high) if high > low * 1.01 else (low / 2.0, low * 2.0)
    return (low, high) if high - low > 1e-9 * max(abs(low), abs(high), 1e-9) else (low - 0.5, low + 0.5)


def _mark(x: float, y: float, size: float, shape: str) -> str:
    """A closed path: circle, square, triangle, diamond or star."""
    if shape == "o":
        return f"M{x - size:.1f} {y:.1f}a{size} {size} 0 1 0 {2 * size} 0a{size} {size} 0 1 0 {-2 * size} 0z"
    corners = {"s": (4, 45.0), "^": (3, 90.0), "D": (4, 0.0), "v": (3, 270.0), "*": (5, 90.0)}[shape]
    count, turn = corners
    reach = [1.25] if shape != "*" else [1.9, 0.8]
    total = count * len(reach)
    points = []
    for k in range(total):
        angle = math.radians(turn + 360.0 * k / total)
        radius = size * reach[k % len(reach)]
        points.append(f"{x + radius * math.cos(angle):.1f} {y - radius * math.sin(angle):.1f}")
    return "M" + "L".join(points) + "z"
