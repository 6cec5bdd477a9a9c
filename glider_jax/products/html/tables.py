"""Parts of a forecast's page: what is read first, tables, inputs and assumptions.

Numbers come from the summary; nothing is worked out again here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from glider_jax.products.coordinates import iso_time
from glider_jax.products.fan import level_lines
from glider_jax.products.html.formats import area, between, number, percent, seconds, stamp
from glider_jax.products.html.page import Safe, bullets, cards, paragraph, table
from glider_jax.products.rule_times import program_lines
from glider_jax.records import BathymetryGrid, CurrentGrid


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
    return f"{long} from {stamp(forecast['start'])} · {forecast['members']:,} members · times are UTC{partial}"


def headline(summary: Mapping[str, Any]) -> Safe:
    """Boxes: next surfacing, where, battery, mission and risk."""
    live, entries = summary.get("next"), summary["surfacings"]
    first = live or (entries[0] if entries else None)
    boxes: list[tuple[object, object, object]] = []
    if first is not None and first["place"]:
        time, place = first["time"], first["place"]
        boxes.append(("next surfacing", stamp(time["median"]), f"90 %: {between(time)}"))
        boxes.append(("where", place["text"], f"{place['latitude']:.5f}, {place['longitude']:.5f}"))
        sizes = {round(100 * r["probability"]): area(r["area_km2"]) for r in first["regions"]}
        if sizes:
            boxes.append(("how sure, area", f"50 %: {sizes.get(50, '-')}", f"90 %: {sizes.get(90, '-')}"))
    else:
        boxes.append(("next surfacing", "none", "within the forecast"))
    boxes.append(_battery_box(summary))
    risks = summary["risks"]
    if summary["waypoints"] and risks["arrives"] > 0.0:
        kept = f"above the reserve {percent(risks['arrives_above_reserve'])}"
        boxes.append(("completes the mission", percent(risks["arrives"]), kept))
    elif summary["waypoints"]:
        way = summary["waypoints"][0]
        boxes.append((f"reaches waypoint {way['number']}", percent(way["probability"]), stamp(way["time"]["median"])))
    touched = f"touches the seafloor {percent(risks['bottom_contact'])}"
    boxes.append(("runs aground", percent(risks["grounding"]), touched))
    return cards(boxes)


def _battery_box(summary: Mapping[str, Any]) -> tuple[str, str, str]:
    """Charge left, and the date of the reserve: the live outlook's where there is one."""
    outlook = summary.get("outlook")
    if outlook and outlook["days_left"] is not None:
        safe_by = outlook["last_safe_recovery"]["time"]
        left = f"{outlook['charge_left_percent']:.0f} % left, {outlook['days_left']:.1f} days"
        return "battery, to the reserve", left, f"decide to recover by {stamp(safe_by)}"
    battery = summary["battery"]
    left = battery["charge_left_percent"]
    name, when, *_ = next(level_lines(entry) for entry in battery["levels"] if entry["is_reserve"])
    value = f"{number(left['median'], 0)} % left at the end"
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
        why = ", ".join(f"{r['reason'].replace('_', ' ')} {percent(r['probability'])}" for r in entry["reasons"][:3])
        rows.append(
            (
                entry["number"], stamp(time["median"]), between(time), place["text"],
                f"{place['latitude']:.5f}, {place['longitude']:.5f}", sizes.get(50, "-"), sizes.get(90, "-"),
                percent(entry["probability"]), why or "-",
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
    why = ", ".join(f"{r['reason']} {percent(r['probability'])}" for r in live["reasons"])
    rows = [
        ("last fix", f"{stamp(fix['time'])}, {fix['text']}"),
        ("next first fix", f"{stamp(time['median'])}, in {live['hours_from_now']['median']:.2f} h"),
        ("50 % | 90 %", f"{between(time, 'p25', 'p75')} | {between(time)}"),
        ("place", f"{live['place']['text']} ({live['place']['latitude']:.5f}, {live['place']['longitude']:.5f})"),
        ("from the fix", f"{live['distance_km']:.2f} km ({live['distance_nm']:.2f} nm) toward "
         f"{live['bearing_true_deg']:.0f}° T"),
        *((f"{100 * r['probability']:.0f} % region", area(r["area_km2"])) for r in live["regions"]),
        ("because", why),
        ("probability", f"{percent(live['probability_within_forecast'])} within the forecast, "
         f"{percent(live['probability_up_by_now'])} would be up by now"),
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
            percent(w["probability"]), stamp(w["time"]["median"]), between(w["time"]),
            ", ".join(f"{b['hours']:g} h {percent(b['probability'])}" for b in w["by"][-3:]),
            number(w["closest_km"]["median"], 1),
        )
        for w in summary["waypoints"]
    ]  # fmt: skip
    head = ("", "degrees and minutes", "decimal degrees", "reached", "arrival, median", "90 % interval",
            "reached by", "closest km")  # fmt: skip
    return table(head, rows, caption="Times are of the members that arrive.", right=(3, 7), tight=True)


def areas(summary: Mapping[str, Any]) -> Safe:
    """Probability of entering each area asked for."""
    rows = [
        (a["name"], percent(a["probability"]), stamp(a["time"]["median"]), between(a["time"])) for a in summary["areas"]
    ]
    return table(("area", "entered", "first entry, median", "90 % interval"), rows, right=(1,))


def outcomes(summary: Mapping[str, Any]) -> Safe:
    """How many members ended how, and where the first of them."""
    rows = []
    for entry in summary["outcomes"]:
        first = entry["first"]
        where = f"after {first['hours']:.1f} h" if first else "-"
        if first and first["place"]:
            where += f" at {first['place']['text']}"
        rows.append((entry["sentence"], f"{entry['count']:,}", percent(entry["share"]), where))
    return table(("outcome", "members", "share", "first"), rows, right=(1, 2))


def inputs(summary: Mapping[str, Any], currents: CurrentGrid | None, floor: BathymetryGrid | None) -> Safe:
    """What was used, how old it was at the start, and whether it covers the forecast."""
    begin, end = (seconds(summary["forecast"][key]) for key in ("start", "end"))
    rows: list[tuple[object, object, object]] = []
    if currents is not None and currents.constant_in_time:
        rows.append(("currents", currents.source.product, "constant in time"))
    elif currents is not None:
        first, last = float(currents.time[0]), float(currents.time[-1])
        said = f"{stamp(iso_time(first))} to {stamp(iso_time(last))}: {_cover(first, last, begin, end)}"
        rows.append(("currents", currents.source.product, said))
    if currents is not None and currents.filled > 0:
        filled = f"{100 * currents.filled:.0f} % of the values were filled ({currents.fill_method})"
        rows.append(("gaps of the currents", currents.source.product, filled))
    if floor is not None:
        rows.append(("seafloor", floor.source.product, "does not age"))
    made, begins = (stamp(text) for text in (summary["provenance"]["created"], summary["forecast"]["start"]))
    rows.append(("forecast made", made, f"begins {begins}"))
    live = summary.get("inputs")
    if live:
        for key, age in live["ages_h"].items():
            rows.append((key.replace("_", " "), "not known" if age is None else f"{age:.2f} h old", "at the forecast"))
        heard = f"{live['surfacings_heard']} surfacings, {live['segments']} dives"
        rows.append(("heard", heard, f"now is {stamp(live['now'])}"))
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


def program(summary: Mapping[str, Any]) -> Safe | str:
    """When the rules of the mission's program came into force; nothing for a mission without one."""
    return bullets(program_lines(summary)) or ""


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
    when = f"{stamp(time['median'])}\n90 %: {between(time)}" if time["median"] else "no member arrives"
    return f"waypoint {entry['number']}: reached by {percent(entry['probability'])}\n{when}\n{entry['place']['text']}"


def told_surfacing(entry: Mapping[str, Any]) -> str:
    """A surfacing's words under the pointer."""
    time = entry["time"]
    sizes = ", ".join(f"{100 * r['probability']:.0f} % {area(r['area_km2'])}" for r in entry["regions"])
    when = f"{stamp(time['median'])}\n90 %: {between(time)}"
    return f"surfacing {entry['number']}: {when}\n{entry['place']['text']}\n{sizes}"
