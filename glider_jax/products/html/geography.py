"""What lies under the tracks, as the page's script takes it: depths, coast, currents through time, members' density.

Lines are lists of whole numbers in 1e-5 degrees: longitude and latitude of the first point, then steps. Longitudes are
unwrapped around a reference, so a map may lie across the antimeridian.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import contourpy
import numpy as np
from matplotlib import colormaps

from glider_jax.products import cartography as chart
from glider_jax.products.coordinates import unwrap_longitude
from glider_jax.products.regions import simplify, thin
from glider_jax.records import Array, BathymetryGrid, CurrentGrid

_CELLS, _COLUMNS = 170, 120
_ARROWS = 20
_SHADES = 48


def encode(longitude: Array, latitude: Array) -> list[int]:
    """A line as steps in 1e-5 degrees (about a metre)."""
    points = np.round(np.stack([longitude, latitude], axis=1) * 1e5).astype(np.int64)
    steps = np.diff(points, axis=0, prepend=0)
    # A step of nothing says nothing; the first point stays whatever it is.
    kept = steps.any(axis=1)
    kept[0] = True
    return steps[kept].ravel().tolist()


def wider(limits: chart.Limits, share: float) -> chart.Limits:
    """Limits with room to move the map around in."""
    high, wide = share * (limits.north - limits.south), share * (limits.east - limits.west)
    return chart.Limits(
        max(limits.south - high, -85.0), limits.west - wide, min(limits.north + high, 85.0), limits.east + wide
    )


def rings(geometry: Mapping[str, Any], reference: float) -> list[list[list[int]]]:
    """Polygons of a GeoJSON MultiPolygon; the first ring of each is the outline."""
    found = []
    for polygon in geometry["coordinates"]:
        parts = [np.asarray(ring, float) for ring in polygon]
        found.append([encode(unwrap_longitude(ring[:, 0], reference), ring[:, 1]) for ring in parts])
    return found


def bathymetry_layers(grid: BathymetryGrid, limits: chart.Limits) -> dict[str, Any]:
    """Depth bands, labelled contours, land and shore for the script; empty where the grid does not reach.

    Bands lie on one another: each holds everything deeper than its level, so a place shows the deepest.
    """
    rows, columns, longitude = chart.crop(grid.latitude, grid.longitude, limits, _CELLS)
    if rows.size < 2 or columns.size < 2:
        return {}
    latitude = np.asarray(grid.latitude)[rows]
    depth = np.ma.masked_invalid(np.asarray(grid.depth)[np.ix_(rows, columns)])
    if not depth.count():
        return {}
    generator = contourpy.contour_generator(
        longitude, latitude, depth, name="serial", fill_type=contourpy.FillType.OuterOffset,
        line_type=contourpy.LineType.Separate,
    )  # fmt: skip
    tolerance = 0.12 * float(np.median(np.diff(latitude)))
    deepest, sea = float(depth.max()), depth[depth > 0]
    levels = chart.depth_levels(float(np.ma.median(sea)), deepest) if sea.count() else np.empty(0)
    layers: dict[str, Any] = {"bands": [_filled(generator, 0.0, 1e6, tolerance)], "contours": []}
    for level in levels:
        lines = [_thinned(line, tolerance) for line in generator.lines(float(level)) if len(line) > 3]
        if not lines:
            continue
        layers["bands"].append(_filled(generator, float(level), 1e6, tolerance))
        longest = max(lines, key=len)
        middle = longest[len(longest) // 2]
        layers["contours"].append(
            {
                "depth": f"{level:g}",
                "lines": [encode(line[:, 0], line[:, 1]) for line in lines],
                "labels": [[round(float(middle[1]), 5), round(float(middle[0]), 5)]],
            }
        )
    if float(depth.min()) < 0.0:
        layers["land"] = _filled(generator, -1e6, 0.0, tolerance)
        layers["shore"] = [
            encode(line[:, 0], line[:, 1])
            for line in (_thinned(line, tolerance) for line in generator.lines(0.0))
            if len(line) > 1
        ]
    return layers


def _filled(generator, low: float, high: float, tolerance: float) -> list[list[list[int]]]:
    found = []
    for points, offsets in zip(*generator.filled(low, high), strict=True):
        parts = [points[a:b] for a, b in zip(offsets[:-1], offsets[1:], strict=True)]
        parts = [simplify(ring, tolerance) for ring in parts if len(ring) > 4]
        if parts:
            found.append([encode(ring[:, 0], ring[:, 1]) for ring in parts])
    return found


def _thinned(line: Array, tolerance: float) -> Array:
    """A line with fewer points, its ends kept; see ``regions.simplify``."""
    closed = len(line) > 3 and np.array_equal(line[0], line[-1])
    return simplify(line, tolerance) if closed else thin(line, (0, len(line) - 1), tolerance)


def current_layer(grid: CurrentGrid, limits: chart.Limits, times: Sequence[float]) -> dict[str, Any] | None:
    """Arrows of the uppermost current at each time, interpolated in time, in cm/s; None where the grid has none.

    A frame outside the times of the product is None: what is not known is not drawn.
    """
    rows, columns, longitude = chart.crop(grid.latitude, grid.longitude, limits, 10_000)
    if not rows.size or not columns.size:
        return None
    step = max(1, math.ceil(rows.size / _ARROWS)), max(1, math.ceil(columns.size / _ARROWS))
    rows, columns = rows[step[0] // 2 :: step[0]], columns[step[1] // 2 :: step[1]]
    longitude = longitude[step[1] // 2 :: step[1]]
    lon, lat = np.meshgrid(longitude, np.asarray(grid.latitude)[rows])

    def at(index: int) -> Array:
        part = np.ix_([index], [0], rows, columns)
        return np.stack([np.asarray(field[part])[0, 0] for field in (grid.east, grid.north)])

    frames: list[Array | None] = []
    for moment in times:
        if grid.constant_in_time or grid.time.size == 1:
            frames.append(at(0))
        elif not grid.time[0] - 1800.0 <= moment <= grid.time[-1] + 1800.0:
            frames.append(None)
        else:
            after = int(np.clip(np.searchsorted(grid.time, moment), 1, grid.time.size - 1))
            gap = float(grid.time[after] - grid.time[after - 1])
            share = min(max((moment - float(grid.time[after - 1])) / gap, 0.0), 1.0)
            # A nought times an unknown value must not spoil a frame that is there.
            frames.append(at(after - 1) if share == 0.0 else (1.0 - share) * at(after - 1) + share * at(after))
    shown = [frame for frame in frames if frame is not None]
    if not shown:
        return None
    speeds = np.concatenate([np.hypot(*frame).ravel() for frame in shown])
    speeds = speeds[np.isfinite(speeds)]
    if not speeds.size:
        return None
    known = np.isfinite(np.stack(shown)).all(axis=1).any(axis=0)
    typical = max(float(np.quantile(speeds, 0.95)), 0.01)
    spacing = float(np.median(np.diff(lat[:, 0]))) if rows.size > 1 else 0.05
    return {
        "places": np.round(np.stack([lon[known], lat[known]], axis=1) * 1e4).astype(int).ravel().tolist(),
        "frames": [None if frame is None else _centimetres(frame[:, known]) for frame in frames],
        # Degrees of latitude per cm/s: a strong current's arrow nearly reaches its neighbour.
        "scale": 0.8 * spacing / (100.0 * typical),
        "typical_cm_s": round(100.0 * typical, 1),
        "constant": bool(grid.constant_in_time),
    }


def _centimetres(pair: Array) -> list[int | None]:
    values = np.round(100.0 * pair.T).ravel()
    return [int(v) if math.isfinite(v) else None for v in values]


def mercator(latitude: Array) -> Array:
    """Northing of the map's projection, radians of longitude at the equator."""
    return np.arcsinh(np.tan(np.radians(np.clip(latitude, -85.0, 85.0))))


def density_layer(
    clouds: Iterable[tuple[Array, Array]], limits: chart.Limits, reference: float, columns: int = _COLUMNS
) -> dict[str, Any]:
    """Members per cell, one frame per cloud of (latitude, longitude); rows are even in the map's projection.

    A frame lists steps between filled cells and their counts, cells counted eastward from the south-west corner.
    """
    south, north = (float(mercator(np.array(v))) for v in (limits.south, limits.north))
    west, east = math.radians(limits.west), math.radians(limits.east)
    rows = max(1, min(400, round(columns * (north - south) / (east - west))))
    frames, most = [], 1
    for latitude, longitude in clouds:
        good = np.isfinite(latitude) & np.isfinite(longitude)
        i = np.floor((mercator(latitude[good]) - south) * rows / (north - south))
        j = np.floor((np.radians(unwrap_longitude(longitude[good], reference)) - west) * columns / (east - west))
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        counts = np.bincount((i[inside] * columns + j[inside]).astype(np.intp), minlength=rows * columns)
        filled = np.flatnonzero(counts)
        most = max(most, int(counts.max(initial=0)))
        pairs = np.stack([np.diff(filled, prepend=0), counts[filled]], axis=1)
        frames.append(pairs.ravel().tolist())
    shades = colormaps["viridis"](np.linspace(0.0, 1.0, _SHADES))[:, :3]
    return {
        "rows": rows, "columns": columns, "most": most, "frames": frames,
        "bounds": [[limits.south, limits.west], [limits.north, limits.east]],
        "ramp": np.round(255 * shades).astype(int).tolist(),
    }  # fmt: skip
