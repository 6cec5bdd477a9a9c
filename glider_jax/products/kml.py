"""KML and KMZ for the viewers pilots have open; all text is escaped, and nothing refers to the network."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from glider_jax.products.atomic import atomic_path
from glider_jax.products.coordinates import iso_time, place_text, wrap_longitude
from glider_jax.records import Track

# Colours are written alpha, blue, green, red.
_STYLES = {
    "region50": ("ff0055d5", "660055d5", 2.5),
    "region90": ("ff009fe6", "33009fe6", 1.5),
    "track": ("ff000000", "00000000", 2.0),
    "box": ("ffb27200", "00000000", 1.0),
}
_ZIP_DATE = (2000, 1, 1, 0, 0, 0)


def write_kml(track: Track, summary: Mapping[str, Any], path: str | Path) -> Path:
    """Write the forecast as ``.kml``, or zipped as ``.kmz``, by the suffix of ``path``."""
    path = Path(path)
    text = kml_text(track, summary)
    with atomic_path(path) as temporary:
        if path.suffix.lower() == ".kmz":
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
                # A fixed date makes the same forecast the same file.
                archive.writestr(zipfile.ZipInfo("doc.kml", _ZIP_DATE), text, zipfile.ZIP_DEFLATED)
            temporary.write_bytes(buffer.getvalue())
        else:
            temporary.write_text(text, encoding="utf-8")
    return path


def kml_text(track: Track, summary: Mapping[str, Any]) -> str:
    """The document: folders of surfacings, positions, waypoints, boxes and the median track."""
    settings = summary["provenance"]["settings"]
    name = f"Forecast {settings.get('mission', '')} {summary['forecast']['start'][:16]}Z"
    parts = ['<?xml version="1.0" encoding="UTF-8"?>', '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>']
    parts.append(f"<name>{escape(name)}</name>")
    for style, (line, fill, width) in _STYLES.items():
        parts.append(
            f'<Style id="{style}"><LineStyle><color>{line}</color><width>{width}</width></LineStyle>'
            f"<PolyStyle><color>{fill}</color></PolyStyle></Style>"
        )
    folders = {
        "Next surfacings": _surfacings(summary),
        "Positions": _positions(summary),
        "Waypoints": _waypoints(summary),
        "Boxes (90 %)": _boxes(summary),
        "Median track": _track(track),
    }
    for title, marks in folders.items():
        parts += [f"<Folder><name>{escape(title)}</name>", *marks, "</Folder>"]
    parts.append("</Document></kml>")
    return "\n".join(parts) + "\n"


def _mark(name: str, description: str, geometry: str, *, style: str = "", span: str = "") -> str:
    link = f"<styleUrl>#{style}</styleUrl>" if style else ""
    return (
        f"<Placemark><name>{escape(name)}</name><description>{escape(description)}</description>{span}{link}"
        f"{geometry}</Placemark>"
    )


def _point(place) -> str:
    return f"<Point><coordinates>{place['longitude']:.6f},{place['latitude']:.6f},0</coordinates></Point>"


def _span(begin: str | None, end: str | None) -> str:
    if not begin or not end:
        return ""
    return f"<TimeSpan><begin>{escape(begin)}</begin><end>{escape(end)}</end></TimeSpan>"


def _geometry(geometry) -> str:
    """A GeoJSON multipolygon as KML."""
    polygons = geometry["coordinates"] if geometry["type"] == "MultiPolygon" else [geometry["coordinates"]]
    parts = []
    for rings in polygons:
        edges = []
        for k, ring in enumerate(rings):
            tag = "outerBoundaryIs" if k == 0 else "innerBoundaryIs"
            points = " ".join(f"{x:.6f},{y:.6f},0" for x, y in ring)
            edges.append(f"<{tag}><LinearRing><coordinates>{points}</coordinates></LinearRing></{tag}>")
        parts.append(f"<Polygon><tessellate>1</tessellate>{''.join(edges)}</Polygon>")
    return f"<MultiGeometry>{''.join(parts)}</MultiGeometry>"


def _words(place, *lines: str) -> str:
    return "\n".join([place["text"], f"{place['latitude']:.5f}, {place['longitude']:.5f}", *lines])


def _regions(entry, title, span) -> Iterator[str]:
    for region in entry["regions"]:
        percent = round(100 * region["probability"])
        style = "region50" if percent <= 50 else "region90"
        text = f"{percent} % region, {region['area_km2']:.2f} km2"
        yield _mark(f"{title}: {percent} %", text, _geometry(region["geometry"]), style=style, span=span)


def _surfacings(summary) -> Iterator[str]:
    for entry in summary["surfacings"]:
        time = entry["time"]
        if entry["place"] is None:
            continue
        span = _span(time["p05"], time["p95"])
        title = f"Surfacing {entry['number']}"
        words = _words(
            entry["place"], f"{time['median']} (90 %: {time['p05']} to {time['p95']})",
            f"probability {100 * entry['probability']:.0f} %",
        )  # fmt: skip
        yield _mark(title, words, _point(entry["place"]), span=span)
        yield from _regions(entry, title, span)


def _positions(summary) -> Iterator[str]:
    for entry in summary["positions"]:
        if entry["place"] is None:
            continue
        title = f"After {entry['hours']:g} h"
        words = _words(entry["place"], entry["time"], f"{100 * entry['share_active']:.0f} % of members under way")
        yield _mark(title, words, _point(entry["place"]), span=_span(entry["time"], entry["time"]))
        yield from _regions(entry, title, _span(entry["time"], entry["time"]))


def _waypoints(summary) -> Iterator[str]:
    for entry in summary["waypoints"]:
        words = _words(
            entry["place"], f"reached by {100 * entry['probability']:.0f} %", f"median {entry['time']['median']}"
        )
        yield _mark(f"Waypoint {entry['number']}", words, _point(entry["place"]))


def _boxes(summary) -> Iterator[str]:
    for entry in summary["boxes"]:
        box = entry["ninety"]
        if box is None:
            continue
        corners = [("west", "south"), ("east", "south"), ("east", "north"), ("west", "north"), ("west", "south")]
        ring = [[box[x], box[y]] for x, y in corners]
        yield _mark(
            f"{entry['from_h']:g} to {entry['to_h']:g} h", f"until {entry['until']}",
            _geometry({"type": "MultiPolygon", "coordinates": [[ring]]}), style="box",
        )  # fmt: skip


def _track(track: Track) -> Iterator[str]:
    longitude = track.longitude[:1, :1] + wrap_longitude(track.longitude - track.longitude[:1, :1])
    middle = wrap_longitude(np.median(longitude, axis=0))
    latitude = np.median(track.latitude, axis=0)
    points = " ".join(f"{x:.6f},{y:.6f},0" for x, y in zip(middle, latitude, strict=True))
    line = f"<LineString><tessellate>1</tessellate><coordinates>{points}</coordinates></LineString>"
    begin, end = iso_time(float(track.time[0])), iso_time(float(track.time[-1]))
    words = f"{place_text(latitude[0], middle[0])} to {place_text(latitude[-1], middle[-1])}"
    yield _mark("Median of the members", words, line, style="track", span=_span(begin, end))
