"""The battery and the energy on a forecast's page: fan, dates, draws, outlook, components, as the summary has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from glider_jax.products.fan import grouped, level_lines
from glider_jax.products.html.charts import Chart
from glider_jax.products.html.formats import day, number, percent, seconds, stamp
from glider_jax.products.html.page import Safe, bullets, paragraph, safe, table

DAY = 86400.0


def battery(summary: Mapping[str, Any]) -> Safe:
    """The fan of charge left, the dates of the levels, and for a live forecast the outlook."""
    entry = summary["battery"]
    fan = entry["fan"]
    days = _days(summary, fan["hours"])
    chart = Chart((days[0], days[-1]), (0.0, 102.0), "time (UTC)", "usable charge left (%)", time=True)
    columns = {key: np.asarray(fan[key], float) for key in ("p05", "p25", "median", "p75", "p95")}
    chart.band(days, columns["p05"], columns["p95"], "b90")
    chart.band(days, columns["p25"], columns["p75"], "b50")
    chart.line(days, columns["median"])
    chart.level(entry["reserve_percent"], "limit", f"reserve {entry['reserve_percent']:g} %")
    drawn = chart.figure(
        "Usable charge left through time", "Line: median. Dark band: 25 to 75 %, light band: 5 to 95 % of members.",
        cursor=True,
    )  # fmt: skip
    rows = [
        (
            f"{level['charge_left_percent']:g} %{' (reserve)' if level['is_reserve'] else ''}",
            percent(level["probability"]),
            *_dates(level),
        )
        for level in entry["levels"]
    ]
    levels = table(
        ("charge left", "within forecast", "median", "90 % interval"), rows,
        caption=f"Beyond the forecast {entry['extrapolation']}.", right=(1,), tight=True,
    )  # fmt: skip
    # Dates of a live forecast are those of its outlook, which counts from the charge that is left.
    told = _outlook(summary) or levels
    return Safe(f'<div class="pair">{drawn}<div>{told}{_rates(summary)}</div></div>')


def _dates(level: Mapping[str, Any]) -> tuple[str, str]:
    """Median date and 90 % interval as the battery chart words them."""
    _, when, *rest = level_lines(level)
    return when, rest[0].removeprefix("90 %: ") if rest else "-"


def _rates(summary: Mapping[str, Any]) -> Safe:
    rates = summary["rates"]
    rows = []
    for name, values, digits in (
        ("Ah per day", rates["ah_per_day"]["total"], 2),
        ("Wh per day", rates["wh_per_day"]["total"], 1),
        ("km per day over ground", rates["km_per_day"]["over_ground"], 1),
        ("km per day through water", rates["km_per_day"]["through_water"], 1),
    ):
        interval = f"{number(values['p05'], digits)} to {number(values['p95'], digits)}"
        rows.append((name, number(values["median"], digits), interval))
    return table(("", "median", "90 % interval"), rows, right=(1,))


def _outlook(summary: Mapping[str, Any]) -> Safe:
    outlook = summary.get("outlook")
    if not outlook:
        return Safe("")
    draw = outlook["ah_per_day"]
    rows = [("draw", f"{number(draw['total']['median'], 2)} Ah per day ({draw['from']})")]
    if outlook["charge_left_percent"] is not None:
        rows.append(("now", f"{outlook['charge_left_percent']:.1f} % of {outlook['capacity_ah']:.0f} Ah"))
    rows += [
        (f"{level['charge_left_percent']:g} %", f"{day(level['time']['median'])} "
         f"(90 %: {day(level['time']['p05'])} to {day(level['time']['p95'])})")
        for level in outlook["levels"]
    ]  # fmt: skip
    if outlook["last_safe_recovery"]:
        rows.append(("last safe recovery", stamp(outlook["last_safe_recovery"]["time"])))
    return Safe(table(("outlook", ""), rows) + bullets(outlook["notes"]))


def energy(summary: Mapping[str, Any]) -> Safe:
    """Mean energy drawn by component through time and at the end."""
    parts = grouped(summary["battery"]["energy_wh"])
    if not parts:
        return paragraph("No energy was drawn.")
    days = _days(summary, summary["battery"]["fan"]["hours"])
    total = np.sum([values for _, values in parts], axis=0)
    chart = Chart((days[0], days[-1]), (0.0, max(1.03 * float(total.max()), 1e-9)), "time (UTC)",
                  "mean energy drawn (Wh)", time=True)  # fmt: skip
    base = np.zeros_like(total)
    rows = []
    per_day = summary["rates"]["ah_per_day"]["by_component"]
    for k, (name, values) in enumerate(parts):
        colour = 7 if name.startswith("other (") else min(k, 7)
        chart.band(days, base, base + values, f"c{colour} edge")
        base = base + values
        charge = per_day.get(name)
        rows.append(
            (
                Safe(f'<span class="key k{colour}"></span>{safe(name.replace("_", " "))}'), f"{values[-1]:,.1f}",
                f"{100 * values[-1] / total[-1]:.0f} %", "-" if charge is None else number(charge["median"], 3),
            )
        )  # fmt: skip
    whole = number(summary["rates"]["ah_per_day"]["total"]["median"], 3)
    rows.append(("total", f"{total[-1]:,.1f}", "100 %", whole))
    drawn = chart.figure("Mean energy drawn by component", "Largest at the bottom, as in the table.", cursor=True)
    listed = table(("component", "Wh by the end", "share", "Ah per day"), rows, right=(1, 2, 3))
    return Safe(f'<div class="pair">{drawn}<div>{listed}</div></div>')


def _days(summary: Mapping[str, Any], hours) -> np.ndarray:
    return (seconds(summary["forecast"]["start"]) + 3600.0 * np.asarray(hours, float)) / DAY
