"""Figures of a hindcast: promised against found coverage, and errors against those of persistence."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from glider_jax.products import scores
from glider_jax.products.figure_style import save_figure, style_of
from glider_jax.products.hindcast import Case
from glider_jax.products.html.charts import ticks
from glider_jax.products.wording import drawn, one_line

_BLUE, _GREY = "#0072B2", "#8A8A8A"
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#000000")


def plot_reliability(cases: list[Case], path: Path, style: str = "screen") -> Path:
    """Draw coverage of places and times with 95 % intervals, and each case's error; return the path."""
    with matplotlib.rc_context({"font.size": 9}):
        figure = Figure(figsize=(8.0, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        time = scores.reliability(np.array([c.time_below for c in cases], float))
        place = [
            {"probability": p, **scores.coverage(flags)}
            for p, flags in ((0.5, [c.inside50 for c in cases]), (0.9, [c.inside90 for c in cases]))
        ]
        left.plot([0, 1], [0, 1], color=_GREY, linewidth=1)
        for rows, name, colour, shift in ((time, "time", _GREY, -0.008), (place, "place", _BLUE, 0.008)):
            promised = np.array([r["probability"] for r in rows])
            found = np.array([r["share"] for r in rows])
            low, high = np.array([r["interval"] for r in rows]).T
            bars = np.maximum([found - low, high - found], 0.0)
            mark = "s" if name == "time" else "o"
            left.errorbar(promised + shift, found, bars, fmt=mark, color=colour, capsize=3, label=name)
        left.set(xlabel="promised share", ylabel="found share", xlim=(0, 1), ylim=(0, 1.02))
        if style_of(style).words:
            left.set_title(f"Coverage, {len(cases)} surfacings; bars 95 %")
            right.set_title("Each surfacing; below the line is better")
        left.legend(frameon=False)
        ours = np.array([c.error for c in cases]) / 1e3
        theirs = np.array([c.persistence for c in cases]) / 1e3
        names = sorted({c.recording for c in cases})
        for k, name in enumerate(names):
            mine = np.array([c.recording == name for c in cases])
            right.plot(
                theirs[mine], ours[mine], "osd^vP*X"[k % 8], markersize=4, color=_COLOURS[k % len(_COLOURS)],
                label=drawn(one_line(name, 28)),
            )  # fmt: skip
        most = max(float(ours.max()), float(theirs.max()), 0.1) * 1.2
        least = max(min(float(ours.min()), float(theirs.min())) * 0.8, 0.005)
        right.plot([least, most], [least, most], color=_GREY, linewidth=1)
        right.set(xscale="log", yscale="log", xlim=(least, most), ylim=(least, most))
        # Round numbers in plain writing: a range of less than a decade would else have crowded labels.
        marks = ticks(least, most, log=True)
        for axis in (right.xaxis, right.yaxis):
            axis.set_major_locator(FixedLocator(marks))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        right.set(xlabel="error of persistence (km)", ylabel="error of the forecast (km)")
        right.legend(frameon=False, fontsize=7)
        return save_figure(figure, path, style, dpi=150 if style == "screen" else None)
