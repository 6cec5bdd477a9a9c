"""Parts of a forecast's page: what is read first, tables, charts of the battery, inputs and assumptions.

Numbers come from the summary; nothing is worked out again here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.products.coordinates import iso_time
from glider_jax.products.fan import grouped, level_lines
from glider_jax.products.html.charts import Chart
from glider_jax.products.html.page import Safe, bullets, cards, paragraph, safe, table
from glider_jax.records import BathymetryGrid, CurrentGrid

DAY = 86400.0


def title(summary: Mapping[str, Any]) -> str:
    """Mission and vehicle as the settings name them, or the glider of a live forecast."""
    settings = summary["provenance"]["settings"]
    live = (summary.get("inputs") or {}).get("glider")
    names = [str(settings[key]) for key in ("mission", "vehicle") if settings.get(key)]
    if live:
        names = [str(live), *names]
    return "Forecast: " + ", ".join(dict.fromkeys(names)) if names else "Glider forecast"


def span(summary: Mapping[str, Any]) -> str:
    """How long, from when, how many members."""
    forecast = summary["forecast"]
    hours = forecast["horizon_h"]
    long = f"{hours:g} h" if hours < 96 else f"{hours / 24:.4g} days"
    partial = "" if forecast["complete"] else " · PARTIAL, the run was interrupted"
    return f"{long} from {_stamp(forecast['start'])} · {forecast['members']:,} members · times are UTC{partial}"


def headline(summary: Mapping[str, Any]) -> Safe:
    """Boxes: next surfacing, where, battery, mission and risk."""
    live, entries = summary.get("next"), summary["surfacings"]
    first = live or (entries[0] if entries else None)
    boxes: list[tuple[object, object, object]] = []
    if first is not None and first["place"]:
        time, place = first["time"], first["place"]
        boxes.append(("next surfacing", _stamp(time["median"]), f"90 %: {_between(time)}"))
        boxes.append(("where", place["text"], f"{place['latitude']:.5f}, {place['longitude']:.5f}"))
        sizes = {round(100 * r["probability"]): area(r["area_km2"]) for r in first["regions"]}
        if sizes:
            boxes.append(("how sure, area", f"50 %: {sizes.get(50, '-')}", f"90 %: {sizes.get(90, '-')}"))
    else:
        boxes.append(("next surfacing", "none", "within the forecast"))
    boxes.append(_battery_box(summary))
    risks = summary["risks"]
    if summary["waypoints"] and risks["arrives"] > 0.0:
        kept = f"above the reserve {_percent(risks['arrives_above_reserve'])}"
        boxes.append(("completes the mission", _percent(risks["arrives"]), kept))
    elif summary["waypoints"]:
        way = summary["waypoints"][0]
        boxes.append((f"reaches waypoint {way['number']}", _percent(way["probability"]), _stamp(way["time"]["median"])))
    touched = f"touches the seafloor {_percent(risks['bottom_contact'])}"
    boxes.append(("runs aground", _percent(risks["grounding"]), touched))
    return cards(boxes)


def _battery_box(summary: Mapping[str, Any]) -> tuple[str, str, str]:
    """Charge left, and the date of the reserve: the live outlook's where there is one."""
    outlook = summary.get("outlook")
    if outlook and outlook["days_left"] is not None:
        safe_by = outlook["last_safe_recovery"]["time"]
        left = f"{outlook['charge_left_percent']:.0f} % left, {outlook['days_left']:.1f} days"
        return "battery, to the reserve", left, f"decide to recover by {_stamp(safe_by)}"
    battery = summary["battery"]
    left = battery["charge_left_percent"]
    name, when, *_ = next(level_lines(entry) for entry in battery["levels"] if entry["is_reserve"])
    value = f"{_number(left['median'], 0)} % left at the end"
    return "battery", value, f"{name.split(':')[0]}: {when}"


def surfacings(summary: Mapping[str, Any]) -> Safe:
    """The next surfacings with times, places in both notations, regions and reasons."""
    rows = []
    # The first is told by the live forecast, which knows that it has not come yet.
    for entry in summary["surfacings"][1 if summary.get("next") else 0 :]:
        place, time = entry["place"], entry["time"]
        if place is None or time["median"] is None:
            continue
        sizes = {round(100 * r["probability"]): area(r["area_km2"]) for r in entry["regions"]}
        why = ", ".join(f"{r['reason'].replace('_', ' ')} {_percent(r['probability'])}" for r in entry["reasons"][:3])
        rows.append(
            (
                entry["number"], _stamp(time["median"]), _between(time), place["text"],
                f"{place['latitude']:.5f}, {place['longitude']:.5f}", sizes.get(50, "-"), sizes.get(90, "-"),
                _percent(entry["probability"]), why or "-",
            )
        )  # fmt: skip
    if not rows:
        return Safe("") if summary.get("next") else paragraph("No surfacing falls within the forecast.")
    head = ("", "median", "90 % interval", "degrees and minutes", "decimal degrees", "50 % region", "90 % region",
            "probability", "reason")  # fmt: skip
    return table(head, rows, caption="Medians of the members; the probability is that it happens within the forecast.",
                 tight=True)  # fmt: skip


def next_fix(live: Mapping[str, Any]) -> Safe:
    """The live forecast of the next first fix: from which fix, when, how far, and why."""
    fix, time = live["fix"], live["time"]
    east, north = live["current"]["east"], live["current"]["north"]
    flow, toward = 100.0 * math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0
    why = ", ".join(f"{r['reason']} {_percent(r['probability'])}" for r in live["reasons"])
    rows = [
        ("last fix", f"{_stamp(fix['time'])}, {fix['text']}"),
        ("next first fix", f"{_stamp(time['median'])}, in {live['hours_from_now']['median']:.2f} h"),
        ("50 % | 90 %", f"{_between(time, 'p25', 'p75')} | {_between(time)}"),
        ("place", f"{live['place']['text']} ({live['place']['latitude']:.5f}, {live['place']['longitude']:.5f})"),
        ("from the fix", f"{live['distance_km']:.2f} km ({live['distance_nm']:.2f} nm) toward "
         f"{live['bearing_true_deg']:.0f}° T"),
        *((f"{100 * r['probability']:.0f} % region", area(r["area_km2"])) for r in live["regions"]),
        ("because", why),
        ("probability", f"{_percent(live['probability_within_forecast'])} within the forecast, "
         f"{_percent(live['probability_up_by_now'])} would be up by now"),
        ("current", f"{flow:.0f} cm/s toward {toward:.0f}° T, ± {100 * live['current']['sd']:.0f} cm/s, "
         f"from {live['current']['observations']} dives"),
        ("speed through the water", f"{100 * live['speed_through_water']:.0f} cm/s"),
    ]  # fmt: skip
    return Safe("<h3>Next first fix</h3>" + table(("", ""), rows) + "<h3>Those after it</h3>")


def waypoints(summary: Mapping[str, Any]) -> Safe:
    """Waypoints with arrival and probability."""
    rows = [
        (
            w["number"], w["place"]["text"], f"{w['place']['latitude']:.5f}, {w['place']['longitude']:.5f}",
            _percent(w["probability"]), _stamp(w["time"]["median"]), _between(w["time"]),
            ", ".join(f"{b['hours']:g} h {_percent(b['probability'])}" for b in w["by"][-3:]),
            _number(w["closest_km"]["median"], 1),
        )
        for w in summary["waypoints"]
    ]  # fmt: skip
    head = ("", "degrees and minutes", "decimal degrees", "reached", "arrival, median", "90 % interval",
            "reached by", "closest km")  # fmt: skip
    return table(head, rows, caption="Times are of the members that arrive.", right=(3, 7), tight=True)


def areas(summary: Mapping[str, Any]) -> Safe:
    """Probability of entering each area asked for."""
    rows = [
        (a["name"], _percent(a["probability"]), _stamp(a["time"]["median"]), _between(a["time"]))
        for a in summary["areas"]
    ]
    return table(("area", "entered", "first entry, median", "90 % interval"), rows, right=(1,))


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
            _percent(level["probability"]),
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
        interval = f"{_number(values['p05'], digits)} to {_number(values['p95'], digits)}"
        rows.append((name, _number(values["median"], digits), interval))
    return table(("", "median", "90 % interval"), rows, right=(1,))


def _outlook(summary: Mapping[str, Any]) -> Safe:
    outlook = summary.get("outlook")
    if not outlook:
        return Safe("")
    draw = outlook["ah_per_day"]
    rows = [("draw", f"{_number(draw['total']['median'], 2)} Ah per day ({draw['from']})")]
    if outlook["charge_left_percent"] is not None:
        rows.append(("now", f"{outlook['charge_left_percent']:.1f} % of {outlook['capacity_ah']:.0f} Ah"))
    rows += [
        (f"{level['charge_left_percent']:g} %", f"{_day(level['time']['median'])} "
         f"(90 %: {_day(level['time']['p05'])} to {_day(level['time']['p95'])})")
        for level in outlook["levels"]
    ]  # fmt: skip
    if outlook["last_safe_recovery"]:
        rows.append(("last safe recovery", _stamp(outlook["last_safe_recovery"]["time"])))
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
                f"{100 * values[-1] / total[-1]:.0f} %", "-" if charge is None else _number(charge["median"], 3),
            )
        )  # fmt: skip
    whole = _number(summary["rates"]["ah_per_day"]["total"]["median"], 3)
    rows.append(("total", f"{total[-1]:,.1f}", "100 %", whole))
    drawn = chart.figure("Mean energy drawn by component", "Largest at the bottom, as in the table.", cursor=True)
    listed = table(("component", "Wh by the end", "share", "Ah per day"), rows, right=(1, 2, 3))
    return Safe(f'<div class="pair">{drawn}<div>{listed}</div></div>')


def outcomes(summary: Mapping[str, Any]) -> Safe:
    """How many members ended how, and where the first of them."""
    rows = []
    for entry in summary["outcomes"]:
        first = entry["first"]
        where = f"after {first['hours']:.1f} h" if first else "-"
        if first and first["place"]:
            where += f" at {first['place']['text']}"
        rows.append((entry["sentence"], f"{entry['count']:,}", _percent(entry["share"]), where))
    return table(("outcome", "members", "share", "first"), rows, right=(1, 2))


def inputs(summary: Mapping[str, Any], currents: CurrentGrid | None, floor: BathymetryGrid | None) -> Safe:
    """What was used, how old it was at the start, and whether it covers the forecast."""
    begin, end = (_seconds(summary["forecast"][key]) for key in ("start", "end"))
    rows: list[tuple[object, object, object]] = []
    if currents is not None and currents.constant_in_time:
        rows.append(("currents", currents.source.product, "constant in time"))
    elif currents is not None:
        first, last = float(currents.time[0]), float(currents.time[-1])
        said = f"{_stamp(iso_time(first))} to {_stamp(iso_time(last))}: {_cover(first, last, begin, end)}"
        rows.append(("currents", currents.source.product, said))
    if currents is not None and currents.filled > 0:
        filled = f"{100 * currents.filled:.0f} % of the values were filled ({currents.fill_method})"
        rows.append(("gaps of the currents", currents.source.product, filled))
    if floor is not None:
        rows.append(("seafloor", floor.source.product, "does not age"))
    made, begins = (_stamp(text) for text in (summary["provenance"]["created"], summary["forecast"]["start"]))
    rows.append(("forecast made", made, f"begins {begins}"))
    live = summary.get("inputs")
    if live:
        for key, age in live["ages_h"].items():
            rows.append((key.replace("_", " "), "not known" if age is None else f"{age:.2f} h old", "at the forecast"))
        heard = f"{live['surfacings_heard']} surfacings, {live['segments']} dives"
        rows.append(("heard", heard, f"now is {_stamp(live['now'])}"))
    return table(("input", "what", "age and coverage"), rows)


def _cover(first: float, last: float, begin: float, end: float) -> str:
    """Whether times cover the forecast, and by how much they fail to."""
    if first > end or last < begin:
        return "does not overlap the forecast"
    words = []
    if first > begin + 1.0:
        words.append(f"begins {(first - begin) / 3600.0:.1f} h after the start")
    if last < end - 1.0:
        words.append(f"ends {(end - last) / 3600.0:.1f} h before the end")
    return ", ".join(words) or "covers the forecast"


def assumptions(summary: Mapping[str, Any], drawn: int) -> Safe:
    """The notes of the run, what a live forecast assumed, missed and repaired, and how many members are drawn."""
    live = summary.get("inputs") or {}
    found = [*summary["notes"], *live.get("assumed", ())]
    found += [f"missing channel: {name}" for name in live.get("missing", ())]
    found += [f"repaired: {text}" for text in live.get("repairs", ())]
    if drawn < summary["forecast"]["members"]:
        found.append(f"the map shows the density of {drawn:,} members; all numbers and regions are of all members")
    return bullets(dict.fromkeys(found)) or paragraph("Nothing beyond the settings.")


def told_waypoint(entry: Mapping[str, Any]) -> str:
    """A waypoint's words under the pointer."""
    time = entry["time"]
    when = f"{_stamp(time['median'])}\n90 %: {_between(time)}" if time["median"] else "no member arrives"
    return f"waypoint {entry['number']}: reached by {_percent(entry['probability'])}\n{when}\n{entry['place']['text']}"


def told_surfacing(entry: Mapping[str, Any]) -> str:
    """A surfacing's words under the pointer."""
    time = entry["time"]
    sizes = ", ".join(f"{100 * r['probability']:.0f} % {area(r['area_km2'])}" for r in entry["regions"])
    when = f"{_stamp(time['median'])}\n90 %: {_between(time)}"
    return f"surfacing {entry['number']}: {when}\n{entry['place']['text']}\n{sizes}"


def area(km2: float) -> str:
    """An area in km² with two digits that count."""
    return f"{km2:.2g} km²" if km2 < 10 else f"{km2:,.0f} km²"


def elapsed(hours: float) -> str:
    """Time since the start: hours to two days, then days."""
    return f"+{hours:g} h" if hours <= 48 else f"+{hours / 24:.4g} days"


def _days(summary: Mapping[str, Any], hours) -> np.ndarray:
    return (_seconds(summary["forecast"]["start"]) + 3600.0 * np.asarray(hours, float)) / DAY


def _seconds(text: str) -> float:
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _stamp(text: str | None) -> str:
    """``2012-10-25T03:00:00Z`` as ``25 Oct 2012 03:00Z``."""
    if not text:
        return "-"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return Path(text).name
    return f"{moment.day} {moment:%b %Y %H:%M}Z"


def _between(time: Mapping[str, str | None], first: str = "p05", last: str = "p95") -> str:
    """Two times without the year; the day is said once where both have the same."""
    if not time.get(first):
        return "-"
    if not time.get(last):
        return f"{_short(time[first])} to after the end"
    a, b = _short(time[first]), _short(time[last])
    return f"{a} to {b.split(' ')[-1]}" if a.rsplit(" ", 1)[0] == b.rsplit(" ", 1)[0] else f"{a} to {b}"


def _short(text: str) -> str:
    moment = datetime.fromisoformat(text)
    return f"{moment.day} {moment:%b %H:%M}Z"


def _day(text: str | None) -> str:
    return "-" if not text else text[:10]


def _percent(share: float) -> str:
    """A share in percent; never 0 or 100 % where some are on the other side."""
    if 0.0 < share < 0.001:
        return "<0.1 %"
    if 0.999 < share < 1.0:
        return ">99.9 %"
    return f"{100 * share:.1f} %" if 0.0 < share < 1.0 else f"{100 * share:.0f} %"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"
