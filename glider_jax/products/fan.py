"""The battery chart: how much charge is probably left, when, and what drew it. Everything drawn is in the summary."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib.dates as mdates
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from glider_jax.products.atomic import atomic_path
from glider_jax.products.cartography import BLUE, GREEN, HALO, ORANGE, PURPLE, SKY, VERMILLION, YELLOW
from glider_jax.products.summary import summarise
from glider_jax.records import Track

_COLOURS = (BLUE, SKY, ORANGE, GREEN, PURPLE, YELLOW, VERMILLION, "#999999", "#44AA99", "#882255")
_HATCHES = ("", "//", "..", "\\\\", "xx", "--", "oo", "++", "**", "||")
_SMALLEST_SHARE = 0.002


def plot_battery(
    track: Track,
    path: str | Path,
    *,
    summary: Mapping[str, Any] | None = None,
    reserve: float | None = None,
    title: str | None = None,
    dpi: int = 120,
) -> Path:
    """Draw the battery chart of a forecast as PNG.

    Parameters
    ----------
    track : the ensemble; used where ``summary`` is None.
    path : final name.
    reserve : share of the charge (0 to 1) to mark, the summary's if None.
    title : heading; made from the settings if None.
    """
    summary = summarise(track, reserve=reserve) if summary is None else summary
    battery, settings = summary["battery"], summary["provenance"]["settings"]
    start = datetime.fromisoformat(summary["forecast"]["start"])
    begin = mdates.date2num(start.astimezone(UTC).replace(tzinfo=None))
    days = begin + np.array(battery["fan"]["hours"], float) / 24.0
    figure = Figure(figsize=(11.5, 7.4), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    upper = figure.add_axes((0.075, 0.47, 0.90, 0.40))
    lower = figure.add_axes((0.075, 0.115, 0.90, 0.28), sharex=upper)
    _draw_fan(upper, days, battery, begin)
    _draw_energy(lower, days, battery["energy_wh"])
    locator = mdates.AutoDateLocator(minticks=4, maxticks=10)
    lower.xaxis.set_major_locator(locator)
    lower.xaxis.set_major_formatter(mdates.ConciseDateFormatter(locator))
    lower.set_xlabel("time, UTC")
    upper.tick_params(labelbottom=False)
    upper.set_xlim(days[0], days[-1])
    for axes in (upper, lower):
        axes.grid(alpha=0.25)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    name = title or f"Battery: {settings.get('mission', 'mission')}, {settings.get('vehicle', 'vehicle')}"
    figure.text(0.075, 0.945, name, fontsize=15, weight="bold")
    figure.text(0.075, 0.905, _subtitle(summary), fontsize=10.5, color="#333333")
    figure.text(0.075, 0.025, _footer(summary), fontsize=8, color="#555555")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
    return Path(path)


def _draw_fan(axes, days, battery, begin):
    """Percentiles of the charge left, the reserve, and when the levels are reached."""
    fan = {key: np.array(battery["fan"][key], float) for key in ("p05", "p25", "median", "p75", "p95")}
    axes.fill_between(days, fan["p05"], fan["p95"], color=SKY, alpha=0.35, lw=0, label="90 % of members")
    axes.fill_between(days, fan["p25"], fan["p75"], color=BLUE, alpha=0.45, lw=0, label="50 % of members")
    axes.plot(days, fan["median"], color="black", lw=1.8, label="median")
    reserve = battery["reserve_percent"]
    axes.axhline(reserve, color=VERMILLION, lw=1.6, ls="--", label=f"reserve {reserve:g} %")
    low = min(float(np.nanmin(fan["p05"])), reserve)
    axes.set_ylim(max(0.0, low - 6.0) if low > 8 else 0.0, 101.0)
    for entry in battery["levels"]:
        median = entry["within_forecast"]["hours"]["median"]
        level = entry["charge_left_percent"]
        if median is None or entry["probability"] < 0.5:
            continue
        when = begin + median / 24.0
        axes.plot([when], [level], "o", color="black", ms=5, zorder=5)
        text = axes.annotate(
            f"{level:g} %: {mdates.num2date(when).strftime('%d %b %H:%MZ')}", (when, level), xytext=(8, 6),
            textcoords="offset points", fontsize=9,
        )  # fmt: skip
        text.set_path_effects(HALO)
    axes.set_ylabel("charge left, % of usable")
    axes.legend(loc="lower left", fontsize=9, frameon=True, framealpha=0.9)


def _draw_energy(axes, days, energy):
    """Mean energy drawn by component, stacked; components too small to see are added up."""
    series = {name: np.array(values, float) for name, values in energy.items()}
    total = sum(v[-1] for v in series.values()) or 1.0
    shown = {n: v for n, v in series.items() if v[-1] >= _SMALLEST_SHARE * total}
    rest = [v for n, v in series.items() if n not in shown]
    if rest and sum(v[-1] for v in rest) > 0:
        shown["other"] = np.sum(rest, axis=0)
    stacks = axes.stackplot(
        days, *shown.values(), colors=_COLOURS[: len(shown)], labels=[f"{n}, {v[-1]:.0f} Wh" for n, v in shown.items()]
    )
    for area, hatch in zip(stacks, _HATCHES, strict=False):
        area.set_hatch(hatch)
        area.set_edgecolor("white")
        area.set_linewidth(0.4)
    axes.set_ylabel("energy drawn, Wh (mean)")
    axes.set_ylim(0.0, None)
    axes.legend(loc="upper left", fontsize=9, ncols=2, framealpha=0.9)


def _subtitle(summary):
    forecast, risks = summary["forecast"], summary["risks"]
    rate = summary["rates"]["wh_per_day"]["total"]
    words = [f"{forecast['horizon_h'] / 24.0:.1f} days from {forecast['start'][:16].replace('T', ' ')}Z"]
    words.append(f"{forecast['members']:,} members")
    if rate["median"] is not None:
        words.append(f"{rate['median']:.0f} Wh per day (90 %: {rate['p05']:.0f} to {rate['p95']:.0f})")
    if risks["above_reserve_at_end"] is not None:
        words.append(f"ends above reserve: {100 * risks['above_reserve_at_end']:.0f} %")
    return " · ".join(words)


def _footer(summary):
    made = summary["provenance"]
    members = "members that ended keep their last value"
    return f"glider_jax {made['version']} · seed {made['seed']} · made {made['created']} · {members}"
