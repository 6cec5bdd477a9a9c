"""Trade-offs as pictures: what a day costs against what it brings, and what the answer hangs on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from glider_jax.products import cartography as chart
from glider_jax.products.figure_style import save_figure, style_of
from glider_jax.products.planning import Setting
from glider_jax.products.planning_choice import GOALS, Recommendation, Sensitivity, pareto
from glider_jax.products.wording import drawn

_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def plot_pareto(
    settings: Sequence[Setting], chosen: Sequence[Recommendation], path: Path, style: str = "screen"
) -> Path:
    """Km, profiles and surfacings per day against energy per day; colour is the probability of success.

    Settings that none beats are ringed, those recommended starred; the marker tells the first choice made in words.
    """
    flown = [s for s in settings if not s.refused]
    front = {id(s) for s in pareto(flown)}
    stars = {id(r.setting) for r in chosen if r.setting is not None}
    word = next((k for k, v in flown[0].choices.items() if isinstance(v, str)), None)
    names = list(dict.fromkeys(str(s.choices[word]) for s in flown)) if word else [""]
    keys = [
        Line2D([], [], marker=_MARKERS[k % len(_MARKERS)], color="#555555", linestyle="none", label=drawn(name))
        for k, name in enumerate(names)
    ]
    figure = Figure(figsize=(13.5, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3)
    points = None
    for panel, what, label in zip(
        axes,
        ("km", "profiles", "contacts"),
        ("km per day", "profiles per day", "surfacings per day"),
        strict=True,
    ):
        for k, name in enumerate(names):
            mine = [s for s in flown if not word or str(s.choices[word]) == name]
            x = [np.median(s.rate("wh")) for s in mine]
            y = [np.median(s.rate(what)) for s in mine]
            points = panel.scatter(
                x, y, c=[s.probability for s in mine], cmap="viridis", vmin=0.0, vmax=1.0, s=34, zorder=3,
                marker=_MARKERS[k % len(_MARKERS)],
            )  # fmt: skip
        for s in flown:
            at = np.median(s.rate("wh")), np.median(s.rate(what))
            if id(s) in front:
                panel.plot(*at, "o", mfc="none", mec=chart.BLACK, ms=10, mew=0.7, zorder=2)
            if id(s) in stars:
                panel.plot(*at, "*", color=chart.VERMILLION, ms=15, mec="white", mew=0.6, zorder=5)
        panel.set_xlabel("energy per day (Wh)")
        panel.set_ylabel(label)
        panel.grid(True, color="#dddddd", linewidth=0.6)
        panel.set_axisbelow(True)
    if word:
        axes[0].legend(handles=keys, fontsize=8)
    axes[1].set_title("ringed: no other setting is better in every respect; star: recommended", fontsize=9)
    figure.colorbar(points, ax=list(axes), label="probability of success", shrink=0.9)
    return save_figure(figure, path, style)


def plot_tornado(found: Sequence[Sensitivity], goal: str, path: Path, title: str = "", style: str = "screen") -> Path:
    """Change of energy and of the goal per step of each parameter, with the standard error of the paired members."""
    shown = list(found)[:14]
    figure = Figure(figsize=(11.0, 1.4 + 0.34 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2, sharey=True)
    place = np.arange(len(shown))[::-1]
    for panel, pairs, label in (
        (axes[0], [s.energy for s in shown], "change of energy drawn (Wh)"),
        (axes[1], [s.goal for s in shown], f"change of {GOALS[goal][2]}"),
    ):
        value, error = np.array(pairs, float).T
        colours = [chart.VERMILLION if v > 0 else chart.BLUE for v in value]
        panel.barh(place, value, xerr=error, color=colours, ecolor="black", height=0.65)
        panel.axvline(0.0, color="black", lw=0.8)
        panel.set_xlabel(label)
        panel.grid(True, axis="x", color="#dddddd", linewidth=0.6)
        panel.set_axisbelow(True)
    axes[0].set_yticks(place, [drawn(f"{s.name} ({s.step})") for s in shown], fontsize=8)
    if style_of(style).words:
        figure.suptitle(drawn(title or "What the answer hangs on"), fontsize=10)
    return save_figure(figure, path, style)
