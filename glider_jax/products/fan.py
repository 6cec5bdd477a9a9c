"""The battery as one picture: charge left with its spread and the reserve, and the energy drawn by component.

Drawn with the Agg canvas alone, without pyplot, because importing that costs half a second. Times are UTC.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from glider_jax.products import cartography as chart
from glider_jax.products.figure_style import Style, hatch, save_figure, style_of
from glider_jax.products.summary import summarise
from glider_jax.products.wording import drawn
from glider_jax.records import Array, Track

_SIZE = (11.5, 7.4)
_LEFT, _WIDTH = 0.075, 0.60
_COLUMN = 0.705
# The palette of Okabe and Ito; neighbours in a stack differ in lightness as well as in hue.
_COLOURS = (chart.BLUE, chart.ORANGE, chart.GREEN, chart.YELLOW, chart.VERMILLION, chart.SKY, chart.PURPLE)
_OTHER = "#9A9A9A"
_MOST_COMPONENTS = 7
_SMALL = 0.01


def plot_battery(
    track: Track,
    path: str | Path,
    *,
    summary: Mapping[str, Any] | None = None,
    reserve: float | None = None,
    title: str | None = None,
    style: str = "screen",
    dpi: int | None = None,
) -> Path:
    """Draw the battery chart of a forecast as PNG.

    Parameters
    ----------
    track : the ensemble, or a sample of it where ``summary`` speaks for all.
    path : final name.
    summary : from ``summarise``; made from the track if None.
    reserve : share of the usable charge (0 to 1) drawn as the reserve; that of the summary if None.
    title : heading; mission and vehicle of the settings if None.
    style, dpi : see ``products.figure_style``; the style's resolution if None.
    """
    look = style_of(style)
    if summary is None:
        summary = summarise(track, reserve=reserve)
    battery = summary["battery"]
    level = battery["reserve_percent"] if reserve is None else 100.0 * reserve
    days = (float(track.time[0]) + 3600.0 * np.asarray(battery["fan"]["hours"], float)) / 86400.0
    figure = Figure(figsize=_SIZE, facecolor="white")
    FigureCanvasAgg(figure)
    left = _LEFT if look.words else 0.1
    above = figure.add_axes((left, 0.445, _WIDTH, 0.435))
    below = figure.add_axes((left, 0.105, _WIDTH, 0.30), sharex=above)
    _draw_fan(above, days, battery, level)
    _draw_energy(below, figure, days, battery["energy_wh"], look)
    _date_axis(above, below, days)
    if look.words:
        _write_words(figure, summary, level, title)
    return save_figure(figure, path, look, dpi=dpi, metadata=_metadata(summary))


def _draw_fan(axes: Axes, days: Array, battery: Mapping[str, Any], level: float) -> None:
    """Charge left: median, and the bands of half and of nine tenths of the members."""
    fan = {key: np.asarray(battery["fan"][key], float) for key in ("p05", "p25", "median", "p75", "p95")}
    axes.fill_between(days, fan["p05"], fan["p95"], color=chart.SKY, alpha=0.35, linewidth=0)
    axes.fill_between(days, fan["p25"], fan["p75"], color=chart.SKY, alpha=0.8, linewidth=0)
    axes.plot(days, fan["median"], color=chart.BLUE, linewidth=2.0)
    axes.axhspan(0.0, level, color=chart.VERMILLION, alpha=0.08, linewidth=0)
    axes.axhline(level, color=chart.VERMILLION, linewidth=1.5, linestyle=(0, (6, 2)))
    axes.annotate(
        f"reserve {level:g} %", (0.008, level), xycoords=("axes fraction", "data"), xytext=(0, 3),
        textcoords="offset points", color="#A04000", fontsize=9, fontweight="bold", path_effects=chart.HALO,
    )  # fmt: skip
    for entry in battery["levels"]:
        _draw_level(axes, days, entry)
    axes.set_ylim(0.0, 102.0)
    axes.set_ylabel("usable charge left (%)", fontsize=10)
    axes.legend(
        handles=[
            Line2D([], [], color=chart.BLUE, linewidth=2.0, label="median"),
            Patch(color=chart.SKY, alpha=0.9, linewidth=0, label="25 to 75 % of members"),
            Patch(color=chart.SKY, alpha=0.4, linewidth=0, label="5 to 95 % of members"),
        ],
        loc="lower left", bbox_to_anchor=(0.0, max(level, 4.0) / 102.0 + 0.06), fontsize=8.5, framealpha=0.9,
    )  # fmt: skip


def _draw_level(axes: Axes, days: Array, entry: Mapping[str, Any]) -> None:
    """When a level is reached within the forecast: a bar over nine tenths of the members, a dot at the median."""
    hours = entry["within_forecast"]["hours"]
    if hours["p05"] is None:
        return
    level = entry["charge_left_percent"]
    low = days[0] + hours["p05"] / 24.0
    # Where fewer members than 95 % reach it, the bar runs out of the picture.
    high = days[-1] if hours["p95"] is None else days[0] + hours["p95"] / 24.0
    axes.plot([low, high], [level, level], color="black", linewidth=2.2, solid_capstyle="butt", zorder=4)
    if hours["median"] is not None:
        axes.plot(days[0] + hours["median"] / 24.0, level, "o", color="black", markersize=6, zorder=5)
    axes.annotate(f"{level:g} %", (low, level), xytext=(-4, 0), textcoords="offset points", ha="right", va="center",
                  fontsize=8, path_effects=chart.HALO)  # fmt: skip


def grouped(energy: Mapping[str, list[float]]) -> list[tuple[str, Array]]:
    """Components by falling energy at the end; those beyond the seventh or below 1 % are joined as "other"."""
    series = {name: np.asarray(values, float) for name, values in energy.items()}
    order = sorted(series, key=lambda name: -series[name][-1])
    total = sum(values[-1] for values in series.values())
    large = [name for name in order if series[name][-1] >= _SMALL * total and series[name][-1] > 0.0]
    kept = large[:_MOST_COMPONENTS] if len(large) > _MOST_COMPONENTS else large
    small = [name for name in order if name not in kept and np.any(series[name] > 0.0)]
    found = [(name, series[name]) for name in kept]
    if len(small) == 1 and len(kept) < _MOST_COMPONENTS:
        found.append((small[0], series[small[0]]))
    elif small:
        found.append((f"other ({len(small)})", sum(series[name] for name in small)))
    return found


def _draw_energy(
    axes: Axes, figure: Figure, days: Array, energy: Mapping[str, list[float]], look: Style
) -> None:
    """Mean energy drawn since the start, stacked by component, largest at the bottom."""
    parts = grouped(energy)
    axes.set_ylabel("energy drawn (Wh)", fontsize=10)
    if not parts:
        axes.text(0.5, 0.5, "no energy was drawn", ha="center", va="center", transform=axes.transAxes)
        return
    colours = [_OTHER if name.startswith("other (") else _COLOURS[k] for k, (name, _) in enumerate(parts)]
    drawn_parts = axes.stackplot(
        days, *(values for _, values in parts), colors=colours, edgecolor="white", linewidth=0.6
    )
    for k, part in enumerate(drawn_parts):
        part.set_hatch(hatch(look, k))
    total = sum(values[-1] for _, values in parts)
    axes.set_ylim(0.0, max(1.05 * float(max(sum(v for _, v in parts))), 1e-9))
    corner = _COLUMN - 0.008 if look.words else 0.71
    handles = [
        Patch(
            facecolor=colour, edgecolor="white", linewidth=0, hatch=hatch(look, k),
            label=drawn(f"{name}: {values[-1]:.3g} Wh ({values[-1] / total:.0%})"),
        )
        for k, (colour, (name, values)) in enumerate(zip(colours, parts, strict=True))
    ]
    figure.legend(
        handles=handles[::-1], loc="upper left", bbox_to_anchor=(corner, 0.407), fontsize=9,
        frameon=False, title=f"Drawn by the end: {total:.4g} Wh", title_fontproperties={"weight": "bold", "size": 9.5},
        alignment="left",
    )  # fmt: skip


def _date_axis(above: Axes, below: Axes, days: Array) -> None:
    end = days[-1] if days[-1] > days[0] else days[0] + 1.0 / 24.0
    above.set_xlim(days[0], end)
    locator = AutoDateLocator(minticks=4, maxticks=9)
    below.xaxis.set_major_locator(locator)
    below.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz="UTC"))
    below.set_xlabel("time (UTC)", fontsize=10)
    for axes in (above, below):
        axes.tick_params(labelsize=9)
        axes.grid(True, color="#5A6B78", alpha=0.2, linewidth=0.5)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    above.tick_params(labelbottom=False)


def _write_words(figure: Figure, summary: Mapping[str, Any], level: float, title: str | None) -> None:
    """Heading, the dates of the levels, the rates, and what the picture was made from."""
    battery, risks, rates = summary["battery"], summary["risks"], summary["rates"]
    figure.text(_LEFT, 0.945, drawn(title or _title(summary)), fontsize=15, fontweight="bold", va="bottom")
    figure.text(_LEFT, 0.910, _span(summary["forecast"]), fontsize=10.5, va="bottom", color="#333333")
    left = battery["charge_left_percent"]
    above = risks["above_reserve_at_end"]
    lines = [("Charge left at the end", True)]
    lines.append((f"{left['median']:.1f} %   (90 %: {left['p05']:.1f} to {left['p95']:.1f} %)", False))
    if above is not None and level == battery["reserve_percent"]:
        lines.append((f"above the reserve: {above:.1%} of members", False))
    lines.append(("", False))
    for entry in battery["levels"]:
        name, *dates = level_lines(entry)
        lines += [(name, True), *((text, False) for text in dates)]
    lines.append(("", False))
    wh, ah = rates["wh_per_day"]["total"], rates["ah_per_day"]["total"]
    if wh["median"] is not None:
        lines.append(("Mean draw per day", True))
        lines.append((f"{wh['median']:.3g} Wh   (90 %: {wh['p05']:.3g} to {wh['p95']:.3g})", False))
        lines.append((f"{ah['median']:.3g} Ah   (90 %: {ah['p05']:.3g} to {ah['p95']:.3g})", False))
    y = 0.88
    for text, bold in lines:
        figure.text(_COLUMN, y, text, fontsize=9.2, va="top", fontweight="bold" if bold else "normal")
        y -= 0.0225 if text else 0.012
    made = summary["provenance"]
    caption = (
        f"glider_jax {made['version']} · seed {made['seed']} · made {made['created']} · "
        "a member that ended keeps its last charge · dates beyond the forecast: its mean draw goes on"
    )
    figure.text(_LEFT, 0.012, drawn(caption), fontsize=7.5, color="#555555", va="bottom")


def level_lines(entry: Mapping[str, Any]) -> list[str]:
    """A charge level and when it is reached: within the forecast where the median is, else at the mean draw."""
    name = f"{entry['charge_left_percent']:g} % left" + (" (reserve)" if entry["is_reserve"] else "")
    if entry["probability"] > 0.0:
        name += f": {entry['probability']:.1%} of members"
    within, beyond = entry["within_forecast"]["time"], entry["extrapolated"]["time"]
    if within["median"]:
        return [
            name,
            _moment(within["median"], "%d %b %Y %H:%MZ"),
            f"90 %: {_moment(within['p05'])} to {_moment(within['p95'] or beyond['p95'])}",
        ]
    if beyond["median"]:
        dates = (_moment(beyond[key], "%d %b %Y") for key in ("p05", "p95"))
        return [name, f"{_moment(beyond['median'], '%d %b %Y')} (extrapolated)", "90 %: " + " to ".join(dates)]
    return [name, "date not known: nothing was drawn"]


def _moment(time: str | None, form: str = "%d %b %H:%MZ") -> str:
    return datetime.fromisoformat(time).strftime(form) if time else "not known"


def _title(summary: Mapping[str, Any]) -> str:
    settings = summary["provenance"]["settings"]
    names = [str(settings[key]) for key in ("mission", "vehicle") if settings.get(key)]
    return "Battery: " + ", ".join(names) if names else "Battery forecast"


def _span(forecast: Mapping[str, Any]) -> str:
    """How long, from when, how many members, and whether that is all."""
    hours = forecast["horizon_h"]
    span = f"{hours:g} h" if hours < 96 else f"{hours / 24:.4g} days"
    partial = "" if forecast["complete"] else " · PARTIAL, the run was interrupted"
    return f"{span} from {forecast['start'][:16].replace('T', ' ')}Z · {forecast['members']:,} members{partial}"


def _metadata(summary: Mapping[str, Any]) -> dict[str, str]:
    made = summary["provenance"]
    return {
        "Software": f"glider_jax {made['version']}",
        "Title": "Glider battery forecast",
        "Description": f"seed {made['seed']}, {summary['forecast']['members']} members, {made['created']}",
    }
