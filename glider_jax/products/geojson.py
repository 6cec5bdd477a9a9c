"""GeoJSON (RFC 7946): the forecast's regions, places and median track out, areas of interest in."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.errors import DataError
from glider_jax.products.atomic import write_text
from glider_jax.products.measures import NamedPolygon
from glider_jax.products.shapes import box_shape, median_line
from glider_jax.products.wording import one_line
from glider_jax.records import Track

_LONGEST_NAME = 120


def write_geojson(track: Track, summary: Mapping[str, Any], path: str | Path) -> Path:
    """Write waypoints, median track, regions, next surfacings and boxes as one feature collection."""
    features = [
        *_places(summary),
        *_regions(summary),
        *_boxes(summary),
        _feature(median_line(track), kind="median track", members=track.n),
    ]
    collection = {
        "type": "FeatureCollection",
        "features": features,
        "glider_jax": {"schema": summary["schema"], "forecast": summary["forecast"], "notes": summary["notes"]},
    }
    return write_text(path, json.dumps(collection, allow_nan=False) + "\n")


def _feature(geometry, **properties) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _point(place) -> dict[str, Any]:
    return {"type": "Point", "coordinates": [round(place["longitude"], 6), round(place["latitude"], 6)]}


def _places(summary):
    forecast = summary["forecast"]
    yield _feature(_point(forecast["start_place"]), kind="start", time=forecast["start"])
    for entry in summary["waypoints"]:
        yield _feature(
            _point(entry["place"]), kind="waypoint", number=entry["number"], probability=entry["probability"],
            time=entry["time"],
        )  # fmt: skip
    for entry in summary["surfacings"]:
        if entry["place"] is not None:
            yield _feature(
                _point(entry["place"]), kind="surfacing", number=entry["number"], probability=entry["probability"],
                time=entry["time"],
            )  # fmt: skip


def _regions(summary):
    for kind, entries in (("surfacing region", summary["surfacings"]), ("position region", summary["positions"])):
        for entry in entries:
            for region in entry["regions"]:
                time = entry["time"]["median"] if isinstance(entry["time"], Mapping) else entry["time"]
                yield _feature(
                    region["geometry"], kind=kind, number=entry.get("number"), time=time,
                    probability=region["probability"], area_km2=region["area_km2"],
                )  # fmt: skip


def _boxes(summary):
    for entry in summary["boxes"]:
        box = entry["ninety"]
        if box is None:
            continue
        yield _feature(
            box_shape(box), kind="box", from_h=entry["from_h"], to_h=entry["to_h"], until=entry["until"]
        )  # fmt: skip


def read_polygons(path: str | Path) -> tuple[NamedPolygon, ...]:
    """Read areas of interest from a GeoJSON file.

    Parameters
    ----------
    path : Polygon, MultiPolygon, Feature or FeatureCollection; the property ``name`` (or ``id``) names an area.

    Raises
    ------
    DataError : the file cannot be read, is no GeoJSON, or holds no polygon with valid coordinates.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise DataError(f"{path}: expected a GeoJSON file, found none that can be read ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: expected GeoJSON, found something else ({error}). Check the file.") from error
    try:
        found = tuple(_polygons(content, path, ""))
    except RecursionError as error:
        raise DataError(f"{path}: expected areas, found collections nested too deeply. Simplify the file.") from error
    if not found:
        raise DataError(f"{path}: expected at least one Polygon or MultiPolygon, found none. Draw an area.")
    return tuple(NamedPolygon(item.name or f"area {number}", item.rings) for number, item in enumerate(found, start=1))


def _polygons(node, path, name):
    if not isinstance(node, dict):
        raise DataError(f"{path}: expected a GeoJSON object, found {type(node).__name__}. Check the file.")
    kind = node.get("type")
    if kind == "FeatureCollection":
        for feature in _members(node, "features", path):
            yield from _polygons(feature, path, "")
    elif kind == "Feature":
        properties = node.get("properties") or {}
        named = properties.get("name") if isinstance(properties, dict) else None
        label = named if named is not None else node.get("id", "")
        if node.get("geometry"):
            known = isinstance(label, str | int | float)
            yield from _polygons(node["geometry"], path, one_line(label, _LONGEST_NAME) if known else "")
    elif kind == "GeometryCollection":
        for geometry in _members(node, "geometries", path):
            yield from _polygons(geometry, path, name)
    elif kind == "Polygon":
        yield NamedPolygon(name, _rings([node.get("coordinates")], path))
    elif kind == "MultiPolygon":
        yield NamedPolygon(name, _rings(node.get("coordinates"), path))
    elif kind not in ("Point", "MultiPoint", "LineString", "MultiLineString"):
        raise DataError(f"{path}: expected a GeoJSON type, found {kind!r}. Check the file.")


def _members(node, key, path):
    """The list under ``key`` of a collection."""
    found = node.get(key) or []
    if not isinstance(found, list):
        raise DataError(f"{path}: expected a list as '{key}', found {type(found).__name__}. Check the file.")
    return found


def _rings(polygons, path):
    rings = []
    try:
        for polygon in polygons:
            for ring in polygon:
                points = np.array([[float(p[0]), float(p[1])] for p in ring], float)
                good = points.ndim == 2 and len(points) >= 4 and np.isfinite(points).all()
                if not good or np.abs(points[:, 1]).max() > 90.0 or np.abs(points[:, 0]).max() > 540.0:
                    raise ValueError(f"ring {len(rings) + 1} is not closed longitude, latitude pairs in degrees")
                if not math.isclose(float(np.abs(points[0] - points[-1]).max()), 0.0, abs_tol=1e-9):
                    points = np.concatenate([points, points[:1]])
                rings.append(points)
    except (TypeError, ValueError, IndexError, KeyError, OverflowError) as error:
        raise DataError(
            f"{path}: expected rings of [longitude, latitude] in degrees, found {error}. Check the coordinates."
        ) from error
    if not rings:
        raise DataError(f"{path}: expected a polygon with a ring, found an empty one. Check the file.")
    return tuple(rings)
