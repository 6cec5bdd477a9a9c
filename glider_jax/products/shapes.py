"""Polygons as RFC 7946 wants them: longitude first, outlines counter-clockwise, cut at the antimeridian."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from glider_jax.products.coordinates import unwrap_longitude, wrap_longitude
from glider_jax.products.regions import Region
from glider_jax.records import Array, Track

DIGITS = 6


def ring_area(ring: Array) -> float:
    """Signed area of a closed ring in its own units; positive when it runs counter-clockwise."""
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))


def oriented(ring: Array, *, counter_clockwise: bool) -> Array:
    """The ring, turned round if it runs the other way."""
    return ring if (ring_area(ring) > 0) == counter_clockwise else ring[::-1]


def cut(ring: Array, longitude: float, *, keep_west: bool) -> Array:
    """The part of a closed ring on one side of a meridian; empty where there is none.

    Sutherland and Hodgman's method: parts that fall apart stay joined along the meridian.
    """
    sign = 1.0 if keep_west else -1.0
    kept: list[tuple[float, float]] = []
    for (x0, y0), (x1, y1) in zip(ring[:-1], ring[1:], strict=True):
        a, b = sign * (longitude - x0), sign * (longitude - x1)
        if a >= 0.0:
            kept.append((x0, y0))
        if (a > 0.0 > b) or (a < 0.0 < b):
            kept.append((longitude, y0 + a / (a - b) * (y1 - y0)))
    if len(kept) < 3:
        return np.zeros((0, 2))
    return np.array([*kept, kept[0]])


def multipolygon(polygons: tuple[tuple[Array, ...], ...]) -> dict[str, Any]:
    """A GeoJSON MultiPolygon from polygons of rings whose longitudes are unwrapped."""
    coordinates = []
    for rings in polygons:
        low, high = rings[0][:, 0].min(), rings[0][:, 0].max()
        # Whole turns are taken out first, then the meridian of 180 degrees, if any, lies at +180.
        turn = 360.0 * np.floor((low + 180.0) / 360.0)
        shifted = [ring - [turn, 0.0] for ring in rings]
        parts = [shifted]
        if high - turn > 180.0:
            west = [cut(ring, 180.0, keep_west=True) for ring in shifted]
            east = [cut(ring, 180.0, keep_west=False) - [360.0, 0.0] for ring in shifted]
            parts = [west, east]
        for part in parts:
            if len(part[0]) >= 4:
                coordinates.append(
                    [_points(oriented(r, counter_clockwise=k == 0)) for k, r in enumerate(part) if len(r) >= 4]
                )
    return {"type": "MultiPolygon", "coordinates": coordinates}


def lines(longitude: Array, latitude: Array) -> dict[str, Any]:
    """A GeoJSON line, cut where it crosses the antimeridian."""
    longitude = wrap_longitude(longitude)
    pieces: list[list[list[float]]] = [[[float(longitude[0]), float(latitude[0])]]]
    for k in range(1, len(longitude)):
        x0, x1, y0, y1 = longitude[k - 1], longitude[k], latitude[k - 1], latitude[k]
        if abs(x1 - x0) > 180.0:
            edge = 180.0 if x0 > 0 else -180.0
            far = x1 + 2.0 * edge
            y = y0 + (edge - x0) / (far - x0) * (y1 - y0) if far != x0 else y0
            pieces[-1].append([edge, float(y)])
            pieces.append([[-edge, float(y)]])
        pieces[-1].append([float(x1), float(y1)])
    rounded = [[[round(x, DIGITS), round(y, DIGITS)] for x, y in piece] for piece in pieces if len(piece) > 1]
    if len(rounded) == 1:
        return {"type": "LineString", "coordinates": rounded[0]}
    return {"type": "MultiLineString", "coordinates": rounded}


def box_shape(box: Mapping[str, float]) -> dict[str, Any]:
    """A box as a GeoJSON MultiPolygon; one whose west lies beyond its east crosses the antimeridian."""
    west, south, north = box["west"], box["south"], box["north"]
    east = box["east"] + 360.0 if box["east"] < west else box["east"]
    ring = np.array([[west, south], [east, south], [east, north], [west, north], [west, south]])
    return multipolygon(((ring,),))


def median_line(track: Track) -> dict[str, Any]:
    """Median place of the members at each output time, ended members at their last one, as a GeoJSON line."""
    longitude = unwrap_longitude(track.longitude, float(track.longitude[0, 0]))
    return lines(np.median(longitude, axis=0), np.median(track.latitude, axis=0))


def region_entry(region: Region) -> dict[str, Any]:
    """A region as the summary gives it."""
    return {
        "probability": region.probability,
        "area_km2": round(region.area / 1e6, 4),
        "method": region.method,
        "geometry": multipolygon(region.polygons),
    }


def _points(ring: Array) -> list[list[float]]:
    return [[round(float(x), DIGITS), round(float(y), DIGITS)] for x, y in ring]
