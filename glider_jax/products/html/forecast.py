"""The page of a forecast: map with a time slider, next surfacings, waypoints, battery, inputs, assumptions, provenance.

Every number is the summary's. Only the frames between the summary's instants are worked out here, from the same
members with the same functions, where all members are at hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.products.clouds import Cloud
from glider_jax.products.coordinates import LocalFrame, iso_time, place_text, unwrap_longitude, wrap_longitude
from glider_jax.products.html import power, tables
from glider_jax.products.html.formats import area, elapsed
from glider_jax.products.html.geography import bathymetry_layers, current_layer, density_layer, encode, rings, wider
from glider_jax.products.html.page import Safe, page, safe, section, settings_block, warnings, write_page
from glider_jax.products.maps import map_limits
from glider_jax.products.measures import Positions
from glider_jax.products.shapes import region_entry
from glider_jax.records import BathymetryGrid, CurrentGrid, Track

_FRAMES = 60
_STEPS_H = (0.25, 0.5, 1, 2, 3, 4, 6, 8, 12, 24, 48, 72, 120, 240, 480)
_RATIO = 1.6


@dataclass(frozen=True)
class Fields:
    """What lies under the tracks; either may be absent."""

    bathymetry: BathymetryGrid | None = None
    currents: CurrentGrid | None = None


def write_report(
    track: Track, summary: Mapping[str, Any], path: str | Path, *, fields: Fields = Fields(), title: str | None = None
) -> Path:
    """Write the page of an ensemble forecast.

    Parameters
    ----------
    track : the ensemble, or a sample of it where ``summary`` speaks for all.
    summary : from ``summarise``; that of a live forecast (with ``next``) gives the live page.
    fields : bathymetry and currents to draw.
    title : heading; mission and vehicle of the settings if None.
    """
    return write_page(path, report(track, summary, fields, title=title))


def report(track: Track, summary: Mapping[str, Any], fields: Fields = Fields(), *, title: str | None = None) -> str:
    """The page as text; see :func:`write_report`."""
    frames, clouds = _frames(track, summary)
    drawn = map_data(track, summary, fields, frames, clouds)
    live = summary.get("next")
    warned = list(summary.get("warnings") or [])
    if not summary["forecast"]["complete"]:
        warned.insert(0, "Partial: the run was interrupted; only the members flown so far are here.")
    lead = [warnings(warned), tables.headline(summary)]
    sections = [
        section("map-part", "Map", map_block(frames, drawn)),
        section("surfacings", "Next surfacings", tables.next_fix(live) if live else "", tables.surfacings(summary)),
        section("waypoints", "Waypoints and areas", tables.waypoints(summary), tables.areas(summary)),
        section("program", "The mission's program", tables.program(summary)),
        section("battery", "Battery", power.battery(summary)),
        section("energy", "Energy by component", power.energy(summary)),
        section("outcomes", "How members end", tables.outcomes(summary)),
        section("inputs", "Inputs and their ages", tables.inputs(summary, fields.currents, fields.bathymetry)),
        section("assumptions", "Assumed, ignored and repaired", tables.assumptions(summary, track.n)),
        section("provenance", "Provenance", settings_block(summary["provenance"])),
    ]
    return page(
        title or tables.title(summary), tables.span(summary), sections, lead=lead, data={"map": drawn, "frames": frames}
    )


def map_block(
    frames: Sequence[Mapping[str, Any]],
    drawn: Mapping[str, Any],
    what: str = "Time of the map",
    places: str = "places and median path",
) -> Safe:
    """The map's place in the page, the slider below it and the choice of layers."""
    last = len(frames) - 1
    layers = [("sea", "depth", "")] if drawn.get("bands") else []
    if drawn.get("currents"):
        layers.append(("arrows", f"currents (long arrow {drawn['currents']['typical_cm_s']:g} cm/s)", "arrow"))
    if drawn.get("density"):
        layers.append(("density", "members: few", ""))
    layers.append(("regions", "50 % (solid) and 90 % (dashed) region", "r50"))
    layers.append(("places", places, "path"))
    if drawn.get("surfacings"):
        layers.append(("surfacings", "next surfacings", ""))
    boxes = "".join(
        f'<label><input type="checkbox" data-layer="{name}" checked>{_swatch(kind)}{safe(text)}'
        f"{' <span id=ramp></span> many' if name == 'density' else ''}</label>"
        for name, text, kind in layers
    )
    near = '<button id="near" type="button">Next surfacing</button> ' if drawn.get("near") else ""
    return Safe(
        '<div id="map" role="region" aria-label="Map; arrow keys move it, plus and minus change its scale"></div>'
        '<noscript><p class="warn">The map needs JavaScript; everything below does not.</p></noscript>'
        '<div class="mapbar"><div class="slider no-print">'
        '<button id="back" type="button" aria-label="Earlier">◀</button>'
        f'<input id="time" type="range" min="0" max="{last}" step="1" value="{_first(frames)}" '
        f'aria-label="{safe(what)}">'
        '<button id="on" type="button" aria-label="Later">▶</button>'
        '<button id="play" type="button" class="hide-narrow">Play</button></div>'
        '<p><span id="when"></span></p><p id="told" aria-live="polite"></p>'
        f'<fieldset class="layers" aria-label="Layers of the map">{boxes}</fieldset>'
        f'<p class="no-print">{near}<button id="whole" type="button">Whole map</button></p></div>'
    )


def _first(frames: Sequence[Mapping[str, Any]]) -> int:
    """The step shown at first: one third of the way, where regions are wide enough to see."""
    shown = (k for k, frame in enumerate(frames) if frame.get("regions") and frame["share"] >= 0.3)
    return next(shown, len(frames) - 1)


def _swatch(kind: str) -> str:
    if not kind:
        return ""
    path = "M1 6H20M15 2l5 4-5 4" if kind == "arrow" else "M1 2H21V10H1z" if kind == "r50" else "M1 6H21"
    fill = ' fill-opacity=".2"' if kind == "r50" else ""
    line = f'<path class="legend-{kind}" stroke-width="2"{fill} d="{path}"/>'
    return f'<svg width="22" height="12" aria-hidden="true">{line}</svg>'


def instants(summary: Mapping[str, Any]) -> list[float]:
    """Hours of the slider's steps: a regular series and the instants of the summary, the start first."""
    horizon = float(summary["forecast"]["horizon_h"])
    step = next((s for s in _STEPS_H if horizon / s <= _FRAMES), _STEPS_H[-1])
    regular = {round(step * k, 3) for k in range(int(horizon / step + 1e-9) + 1)}
    return sorted(regular | {float(entry["hours"]) for entry in summary["positions"]} | {0.0})


def _frames(track: Track, summary: Mapping[str, Any]) -> tuple[list[dict[str, Any]], list[tuple]]:
    """What the slider shows at each step, and the cloud of members there."""
    start = summary["forecast"]["start_place"]
    reference = float(start["longitude"])
    places = Positions(track, reference)
    frame = LocalFrame(float(start["latitude"]), reference)
    known = {float(entry["hours"]): entry for entry in summary["positions"]}
    # A sample of the members would give other regions than the summary: then only its own instants are shown.
    whole = track.n == summary["forecast"]["members"]
    horizon = float(summary["forecast"]["horizon_h"])
    fan = summary["battery"]["fan"]
    frames, clouds = [], []
    for hours in instants(summary):
        if not whole and hours not in known and hours > 0.0:
            continue
        latitude, longitude = places.at(hours * 3600.0)
        entry = known.get(hours) or _entry(latitude, longitude, frame, track, hours)
        charge = {key: float(np.interp(hours, fan["hours"], fan[key])) for key in ("p05", "median", "p95")}
        frames.append(_frame(entry, hours, horizon, reference, charge))
        clouds.append((latitude, longitude))
    return frames, clouds


def _entry(latitude, longitude, frame: LocalFrame, track: Track, hours: float) -> dict[str, Any]:
    """The same as an entry of the summary's positions, at another instant."""
    cloud = Cloud(frame)
    cloud.add(latitude, longitude)
    middle = cloud.median()
    place = None
    if middle is not None:
        lat, lon = middle[0], float(wrap_longitude(middle[1]))
        place = {"latitude": round(lat, 6), "longitude": round(lon, 6), "text": place_text(lat, lon)}
    return {
        "hours": hours, "time": iso_time(float(track.time[0]) + hours * 3600.0),
        "share_active": cloud.count / max(track.n, 1), "place": place,
        "regions": [region_entry(r) for r in cloud.regions()] if hours > 0.0 else [],
    }  # fmt: skip


def _frame(entry: Mapping[str, Any], hours: float, horizon: float, reference: float, charge) -> dict[str, Any]:
    moment = datetime.fromisoformat(entry["time"])
    place, share = entry["place"], float(entry["share_active"])
    words = []
    if place:
        words.append(f"{place['text']} ({place['latitude']:.4f}, {place['longitude']:.4f})")
    sizes = [f"{100 * r['probability']:.0f} % region {area(r['area_km2'])}" for r in entry["regions"]]
    words.append(", ".join(sizes) if sizes else "")
    if share < 0.9995:
        words.append(f"{100 * share:.1f} % of members under way")
    words.append(f"charge left {charge['median']:.1f} % (90 %: {charge['p05']:.1f} to {charge['p95']:.1f} %)")
    return {
        "when": f"{moment:%a} {moment.day} {moment:%b %Y %H:%M}Z · {elapsed(hours)}",
        "hours": hours,
        "share": round(hours / horizon, 5) if horizon else 0.0,
        "told": " · ".join(word for word in words if word),
        "place": _at(place, reference) if place else None,
        "regions": [rings(region["geometry"], reference) for region in entry["regions"]],
    }


def _at(place: Mapping[str, Any], reference: float) -> list[float]:
    return [place["latitude"], round(float(unwrap_longitude(place["longitude"], reference)), 6)]


def map_data(track: Track, summary: Mapping[str, Any], fields: Fields, frames, clouds) -> dict[str, Any]:
    """Everything the script draws, ready for JSON."""
    start = summary["forecast"]["start_place"]
    reference = float(start["longitude"])
    longitude = unwrap_longitude(track.longitude, reference)
    limits = map_limits(track, longitude, summary, reference, ratio=_RATIO)
    around = wider(limits, 0.35)
    begin = float(track.time[0])
    drawn: dict[str, Any] = {"bounds": [[limits.south, limits.west], [limits.north, limits.east]]}
    if fields.bathymetry is not None:
        drawn |= bathymetry_layers(fields.bathymetry, around)
    if fields.currents is not None:
        times = [begin + 3600.0 * frame["hours"] for frame in frames]
        drawn["currents"] = current_layer(fields.currents, around, times)
    drawn["density"] = density_layer(clouds, limits, reference)
    path = np.array([frame["place"] for frame in frames if frame["place"]])
    if len(path) > 1:
        drawn["path"] = encode(path[:, 1], path[:, 0])
    drawn["pins"] = [
        {"place": _at(start, reference), "kind": "start", "label": "S", "size": 20, "level": 300,
         "told": f"start {summary['forecast']['start'][:16]}Z\n{start['text']}"},
        *(
            {"place": _at(w["place"], reference), "kind": "way", "label": str(w["number"]),
             "told": tables.told_waypoint(w)}
            for w in summary["waypoints"]
        ),
    ]  # fmt: skip
    drawn["surfacings"] = [
        {"place": _at(s["place"], reference), "label": str(s["number"]), "told": tables.told_surfacing(s),
         "regions": [rings(region["geometry"], reference) for region in s["regions"]]}
        for s in _surfacings(summary) if s["place"]
    ]  # fmt: skip
    drawn["near"] = _near(drawn["surfacings"], drawn["pins"][0]["place"])
    return drawn


def _surfacings(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The next surfacings; the first is the live forecast's own where there is one."""
    entries, live = list(summary["surfacings"]), summary.get("next")
    if live is None:
        return entries
    first = {"number": 1, "place": live["place"], "time": live["time"], "regions": live["regions"],
             "probability": live["probability_within_forecast"]}  # fmt: skip
    return [first, *entries[1:]]


def _near(entries: Sequence[Mapping[str, Any]], start: list[float]) -> list[list[float]] | None:
    """Corners around the start and the next surfacing."""
    if not entries:
        return None
    points = np.array([start, entries[0]["place"], *(e["place"] for e in entries[1:2])])
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.25 * np.maximum(high - low, 0.01)
    return [(low - pad).round(5).tolist(), (high + pad).round(5).tolist()]
