"""KML and KMZ for the viewers pilots have open; all text is escaped, and nothing refers to the network."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from html import escape as escape_html
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from glider_jax.products.atomic import atomic_path
from glider_jax.products.coordinates import iso_time, place_text
from glider_jax.products.shapes import box_shape, median_line
from glider_jax.products.wording import one_line
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
    parts.append(f"<name>{escape(one_line(name))}</name>")
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


def _mark(name: str, lines: Sequence[str], geometry: str, *, style: str = "", span: str = "") -> str:
    """A placemark; viewers take its description for HTML, so its lines are escaped for that first."""
    description = "<br/>".join(escape_html(one_line(line)) for line in lines)
    link = f"<styleUrl>#{style}</styleUrl>" if style else ""
    return (
        f"<Placemark><name>{escape(one_line(name))}</name><description>{escape(description)}</description>{span}{link}"
        f"{geometry}</Placemark>"
    )


def _point(place) -> str:
    return f"<Point><coordinates>{place['longitude']:.6f},{place['latitude']:.6f},0</coordinates></Point>"


def _span(begin: str | None, end: str | None) -> str:
    if not begin or not end:
        return ""
    return f"<TimeSpan><begin>{escape(begin)}</begin><end>{escape(end)}</end></TimeSpan>"


def _area(geometry) -> str:
    """A GeoJSON MultiPolygon as KML."""
    parts = []
    for rings in geometry["coordinates"]:
        edges = []
        for k, ring in enumerate(rings):
            tag = "outerBoundaryIs" if k == 0 else "innerBoundaryIs"
            edges.append(f"<{tag}><LinearRing>{_coordinates(ring)}</LinearRing></{tag}>")
        parts.append(f"<Polygon><tessellate>1</tessellate>{''.join(edges)}</Polygon>")
    return f"<MultiGeometry>{''.join(parts)}</MultiGeometry>"


def _line(geometry) -> str:
    """A GeoJSON line, whole or in pieces, as KML."""
    whole = geometry["type"] == "LineString"
    pieces = [geometry["coordinates"]] if whole else geometry["coordinates"]
    parts = [f"<LineString><tessellate>1</tessellate>{_coordinates(piece)}</LineString>" for piece in pieces]
    return parts[0] if len(parts) == 1 else f"<MultiGeometry>{''.join(parts)}</MultiGeometry>"


def _coordinates(points) -> str:
    return f"<coordinates>{' '.join(f'{x:.6f},{y:.6f},0' for x, y in points)}</coordinates>"


def _words(place, *lines: str) -> list[str]:
    return [place["text"], f"{place['latitude']:.5f}, {place['longitude']:.5f}", *lines]


def _dates(time) -> str:
    """Median and 90 % interval of an event."""
    return f"{time['median']} (90 %: {time['p05']} to {time['p95']})" if time["median"] else "not reached"


def _regions(entry, title, span) -> Iterator[str]:
    for region in entry["regions"]:
        percent = round(100 * region["probability"])
        style = "region50" if percent <= 50 else "region90"
        lines = [f"{percent} % region, {region['area_km2']:.2f} km²"]
        yield _mark(f"{title}: {percent} %", lines, _area(region["geometry"]), style=style, span=span)


def _surfacings(summary) -> Iterator[str]:
    for entry in summary["surfacings"]:
        time = entry["time"]
        if entry["place"] is None:
            continue
        span = _span(time["p05"], time["p95"])
        title = f"Surfacing {entry['number']}"
        words = _words(
            entry["place"], _dates(time), f"probability {100 * entry['probability']:.0f} %",
            *(f"{item['reason']}: {100 * item['probability']:.0f} %" for item in entry["reasons"]),
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
        words = _words(entry["place"], f"reached by {100 * entry['probability']:.0f} %", _dates(entry["time"]))
        yield _mark(f"Waypoint {entry['number']}", words, _point(entry["place"]))


def _boxes(summary) -> Iterator[str]:
    for entry in summary["boxes"]:
        box = entry["ninety"]
        if box is None:
            continue
        title = f"{entry['from_h']:g} to {entry['to_h']:g} h"
        yield _mark(title, [f"until {entry['until']}"], _area(box_shape(box)), style="box")


def _track(track: Track) -> Iterator[str]:
    line = median_line(track)
    points = line["coordinates"] if line["type"] == "LineString" else sum(line["coordinates"], [])
    begin, end = iso_time(float(track.time[0])), iso_time(float(track.time[-1]))
    ends = [place_text(latitude, longitude) for longitude, latitude in (points[0], points[-1])]
    yield _mark("Median of the members", [" to ".join(ends)], _line(line), style="track", span=_span(begin, end))
