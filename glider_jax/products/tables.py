"""The summary as tables: what a pilot reads first comes first. Plain text where no terminal watches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from glider_jax.products.rule_times import program_lines
from glider_jax.products.wording import one_line


def print_summary(summary: Mapping[str, Any], console: Console) -> None:
    """Print a forecast's summary.

    Parameters
    ----------
    summary : from ``summarise``.
    console : where to; colours and frames only if it is a terminal.
    """
    if not console.is_terminal:
        # A pipe has no width: nothing is cut for it.
        console = Console(file=console.file, width=160, color_system=None)
    forecast = summary["forecast"]
    whole = "" if forecast["complete"] else "  PARTIAL: the run was interrupted"
    console.print(
        f"Forecast of {forecast['members']:,} members, {forecast['horizon_h'] / 24:.2f} days from "
        f"{_short(forecast['start'])}, seed {forecast['seed']}{whole}",
        style="bold",
    )
    for table in (_surfacings(summary), _waypoints(summary), _rates(summary), _battery(summary), _outcomes(summary)):
        if table.row_count:
            console.print(table)
    _risks(summary, console)
    for line in program_lines(summary):
        console.print(_plain(line), highlight=False, soft_wrap=not console.is_terminal)
    if summary["notes"]:
        console.print("Notes", style="bold")
        for note in summary["notes"]:
            console.print(f"- {_plain(note)}", soft_wrap=not console.is_terminal, highlight=False)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k == 0 else "right", no_wrap=True)
    return table


def _surfacings(summary) -> Table:
    table = _table("Next surfacings", "", "median, UTC", "90 % interval", "place", "50 | 90 % km²")
    for entry in summary["surfacings"]:
        time, place = entry["time"], entry["place"]
        if time["median"] is None or place is None:
            continue
        areas = {round(100 * r["probability"]): f"{r['area_km2']:.2f}" for r in entry["regions"]}
        table.add_row(
            str(entry["number"]), _short(time["median"]), _interval(time), place["text"],
            f"{areas.get(50, '-')} | {areas.get(90, '-')}",
        )  # fmt: skip
        reason = entry["reasons"][0] if entry["reasons"] else None
        why = f"{reason['reason'].replace('_', ' ')} {100 * reason['probability']:.0f} %" if reason else ""
        sure = f"prob. {100 * entry['probability']:.0f} %"
        table.add_row("", sure, _plain(why), f"{place['latitude']:.5f} {place['longitude']:.5f}", "", style="dim")
    return table


def _waypoints(summary) -> Table:
    table = _table("Waypoints", "", "reached", "arrival, UTC", "90 % interval", "closest km")
    for entry in summary["waypoints"]:
        time, close = entry["time"], entry["closest_km"]
        table.add_row(
            str(entry["number"]), f"{100 * entry['probability']:.0f} %", _short(time["median"]), _interval(time),
            _number(close["median"], 1),
        )  # fmt: skip
    return table


def _rates(summary) -> Table:
    rates = summary["rates"]
    wh, ah = rates["wh_per_day"], rates["ah_per_day"]
    table = _table("Per day", "", "median", "5 %", "95 %", "median Ah")

    def add(name, values, digits, charge=None) -> None:
        numbers = (_number(values[key], digits) for key in ("median", "p05", "p95"))
        table.add_row(name, *numbers, "" if charge is None else _number(charge["median"], 2))

    add("km over ground", rates["km_per_day"]["over_ground"], 1)
    add("km through water", rates["km_per_day"]["through_water"], 1)
    add("Ah", ah["total"], 2)
    add("Wh", wh["total"], 1, ah["total"])
    for name, values in wh["by_component"].items():
        if values["mean"]:
            add(f"  Wh {_plain(name)}", values, 1, ah["by_component"][name])
    return table


def _battery(summary) -> Table:
    battery = summary["battery"]
    left = battery["charge_left_percent"]
    spread = f"{_number(left['p05'], 1)} to {_number(left['p95'], 1)}"
    title = f"Battery: {_number(left['median'], 1)} % left at the end (90 %: {spread})"
    table = _table(title, "left", "within", "median date", "90 % interval")
    for entry in battery["levels"]:
        certain = entry["probability"] >= 0.5
        time = (entry["within_forecast"] if certain else entry["extrapolated"])["time"]
        how = "" if certain else " extrapolated"
        table.add_row(
            f"{entry['charge_left_percent']:g} %{' (reserve)' if entry['is_reserve'] else ''}",
            f"{100 * entry['probability']:.0f} %",
            f"{_day(time['median'])}{how}",
            f"{_day(time['p05'])} to {_day(time['p95'])}" if time["median"] else "-",
        )
    return table


def _outcomes(summary) -> Table:
    table = _table("Members", "outcome", "members", "share", "first")
    for entry in summary["outcomes"]:
        first = entry["first"]
        where = f"after {first['hours']:.1f} h" if first else ""
        table.add_row(entry["sentence"], f"{entry['count']:,}", f"{100 * entry['share']:.1f} %", where)
    return table


def _risks(summary, console: Console) -> None:
    risks = summary["risks"]
    names = {
        "above_reserve_at_end": "ends above reserve", "arrives": "completes the mission",
        "arrives_above_reserve": "completes it above reserve", "grounding": "runs aground",
        "bottom_contact": "touches the seafloor", "leaves_the_inputs": "leaves the inputs' area or time",
    }  # fmt: skip
    words = [f"{text} {100 * risks[key]:.1f} %" for key, text in names.items() if risks.get(key) is not None]
    console.print("Probabilities: " + ", ".join(words), highlight=False, soft_wrap=not console.is_terminal)
    for area in summary["areas"]:
        console.print(
            f"Enters {_plain(area['name'])}: {100 * area['probability']:.1f} %{_entry(area)}", highlight=False
        )


def _plain(text: object) -> str:
    """Text from files, with nothing in it that a terminal or rich takes for a command."""
    return escape(one_line(text, 2000))


def _entry(area: Mapping[str, Any]) -> str:
    """When an area is entered, as far as it is."""
    time = area.get("time")
    return f", first at {_short(time['median'])} (90 %: {_interval(time)})" if time and time["median"] else ""


def _short(time: str | None) -> str:
    return "-" if not time else f"{time[:10]} {time[11:16]}Z"


def _interval(time: Mapping[str, str | None]) -> str:
    """Two times without the year; without the date too where both have the same."""
    first, last = time["p05"], time["p95"]
    if not first or not last:
        return "-"
    if first[:10] == last[:10]:
        return f"{first[11:16]} to {last[11:16]}"
    return f"{first[5:10]} {first[11:16]} to {last[5:10]} {last[11:16]}"


def _day(time: str | None) -> str:
    return "-" if not time else time[:10]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
