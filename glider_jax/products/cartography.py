"""Parts of a map drawn with matplotlib: limits, depth contours, currents, rings, scale bar, degree-minute axes.

Longitudes are unwrapped around a reference, so a map may lie across the antimeridian. Colours are from the palette of
Okabe and Ito or from ``cividis`` and ``viridis``, which people with any colour vision can tell apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import matplotlib.patheffects as effects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import FuncFormatter, MultipleLocator

from glider_jax.products.coordinates import degree_minutes, unwrap_longitude
from glider_jax.records import Array, BathymetryGrid, CurrentGrid

ORANGE, SKY, GREEN, YELLOW = "#E69F00", "#56B4E9", "#009E73", "#F0E442"
BLUE, VERMILLION, PURPLE, BLACK = "#0072B2", "#D55E00", "#CC79A7", "#000000"
LAND, SHORE = "#E4DCCB", "#6B6250"
HALO = [effects.withStroke(linewidth=2.5, foreground="white")]
_SEA = LinearSegmentedColormap.from_list("sea", ["#F4F9FC", "#E3EEF5", "#CCDEEB", "#B2CBDF"])
_DEPTHS = np.array(
    [5, 10, 20, 30, 40, 50, 75, 100, 150, 200, 300, 500, 750, 1000, 1500, 2000, 3000, 4000, 5000, 6000]
)
_TICK_MINUTES = (0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200)
_BAR_KM = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True)
class Limits:
    """Edges of a map in degrees, longitudes unwrapped."""

    south: float
    west: float
    north: float
    east: float

    @property
    def middle(self) -> float:
        """Latitude halfway up the map."""
        return 0.5 * (self.south + self.north)

    @property
    def stretch(self) -> float:
        """Aspect of a degree of latitude to one of longitude."""
        return 1.0 / max(math.cos(math.radians(self.middle)), 0.02)


def limits_around(
    latitude: Array, longitude: Array, *, ratio: float, margin: float = 0.07, least_km: float = 1.0
) -> Limits:
    """Limits around places, widened to the shape of the axes.

    Parameters
    ----------
    latitude, longitude : places to show, degrees; NaN left out.
    ratio : width of the axes over its height.
    margin : share of the extent added on each side.
    least_km : least height and width of the map, km.
    """
    good = np.isfinite(latitude) & np.isfinite(longitude)
    south, north = float(np.min(latitude[good])), float(np.max(latitude[good]))
    west, east = float(np.min(longitude[good])), float(np.max(longitude[good]))
    shrink = max(math.cos(math.radians(0.5 * (south + north))), 0.02)
    height = max((north - south) * (1 + 2 * margin), least_km / 111.2)
    width = max((east - west) * (1 + 2 * margin) * shrink, least_km / 111.2)
    height, width = max(height, width / ratio), max(width, height * ratio)
    lat, lon = 0.5 * (south + north), 0.5 * (west + east)
    return Limits(lat - height / 2, lon - width / 2 / shrink, lat + height / 2, lon + width / 2 / shrink)


def crop(latitude: Array, longitude: Array, limits: Limits, most: int) -> tuple[Array, Array, Array]:
    """Rows and columns of a grid that cover the map, at most about ``most`` each, and the unwrapped longitudes."""
    unwrapped = unwrap_longitude(longitude, 0.5 * (limits.west + limits.east))
    order = np.argsort(unwrapped, kind="stable")
    rows = _covering(latitude, limits.south, limits.north, most)
    columns = _covering(unwrapped[order], limits.west, limits.east, most)
    return rows, order[columns], unwrapped[order[columns]]


def _covering(axis: Array, low: float, high: float, most: int) -> Array:
    first = max(int(np.searchsorted(axis, low)) - 1, 0)
    last = min(int(np.searchsorted(axis, high)) + 1, len(axis))
    return np.arange(first, last, max(1, (last - first) // most))


def prepare(axes: Axes, limits: Limits) -> None:
    """Set limits, aspect and degree-minute axes."""
    axes.set_xlim(limits.west, limits.east)
    axes.set_ylim(limits.south, limits.north)
    axes.set_aspect(limits.stretch, adjustable="box")
    for axis, which, span, count in (
        (axes.xaxis, "lon", limits.east - limits.west, 5),
        (axes.yaxis, "lat", limits.north - limits.south, 6),
    ):
        wanted = span * 60.0 / count
        minutes = next((m for m in _TICK_MINUTES if m >= wanted), _TICK_MINUTES[-1])
        digits = 1 if minutes < 1 else 0
        axis.set_major_locator(MultipleLocator(minutes / 60.0))
        axis.set_major_formatter(FuncFormatter(lambda v, _, w=which, d=digits: degree_minutes(v, w, d)))
    axes.tick_params(labelsize=8, direction="out", length=3)
    axes.grid(True, color="#5A6B78", alpha=0.18, linewidth=0.5)
    axes.set_facecolor("#F4F9FC")
    axes.set_axisbelow(True)


def draw_bathymetry(axes: Axes, grid: BathymetryGrid, limits: Limits, *, labels: bool = True) -> None:
    """Depth as pale fills with labelled contours in metres, land filled, the shore as a line."""
    rows, columns, longitude = crop(grid.latitude, grid.longitude, limits, 260)
    if rows.size < 2 or columns.size < 2:
        return
    depth = np.ma.masked_invalid(grid.depth[np.ix_(rows, columns)])
    latitude = grid.latitude[rows]
    deepest = float(depth.max()) if depth.count() else 0.0
    levels = depth_levels(float(np.ma.median(depth[depth > 0])) if (depth > 0).any() else 0.0, deepest)
    if levels.size:
        fills = np.concatenate([[0.0], levels, [max(deepest, levels[-1]) * 1.01 + 1.0]])
        shades = [_SEA(k) for k in np.linspace(0.0, min(1.0, 0.2 * (fills.size - 2)), fills.size - 1)]
        axes.contourf(longitude, latitude, depth, levels=fills, colors=shades, zorder=0.5)
        lines = axes.contour(
            longitude, latitude, depth, levels=levels, colors="#4F7396", linewidths=0.6, alpha=0.8, zorder=0.6
        )
        if labels:
            axes.clabel(lines, fmt="%g m", fontsize=7, colors="#2F5575", inline_spacing=2)
    if depth.count() and float(depth.min()) < 0.0:
        axes.contourf(longitude, latitude, depth, levels=[-1e5, 0.0], colors=[LAND], zorder=0.7)
        axes.contour(longitude, latitude, depth, levels=[0.0], colors=SHORE, linewidths=0.9, zorder=0.8)


def depth_levels(middle: float, deepest: float) -> Array:
    """Up to nine round depths, denser where most of the map lies."""
    inside = _DEPTHS[_DEPTHS < deepest].astype(float)
    while inside.size > 9:
        # The level nearest to its neighbours in proportion goes first, far from the middle depth before near it.
        gaps = np.diff(np.log(inside))
        cost = (gaps[:-1] + gaps[1:]) / (1.0 + np.abs(np.log(inside[1:-1] / max(middle, 1.0))))
        inside = np.delete(inside, 1 + int(np.argmin(cost)))
    return inside


def draw_currents(axes: Axes, grid: CurrentGrid, limits: Limits, start: float, end: float) -> float | None:
    """Arrows of the mean current between two times; returns the speed of the arrow in the key, m s-1."""
    rows, columns, longitude = crop(grid.latitude, grid.longitude, limits, 10_000)
    if rows.size < 1 or columns.size < 1:
        return None
    frames = np.arange(grid.time.size)
    if not grid.constant_in_time:
        frames = np.flatnonzero((grid.time >= start - 1800.0) & (grid.time <= end + 1800.0))
    if not frames.size:
        return None
    # At most 48 frames: a mean for arrows needs no more, and a year of hourly frames would take seconds.
    frames = frames[:: max(1, frames.size // 48)]
    # About twenty arrows across: each shows its own cell.
    step_r, step_c = (max(1, math.ceil(k.size / 20)) for k in (rows, columns))
    rows, columns, longitude = (
        rows[step_r // 2 :: step_r],
        columns[step_c // 2 :: step_c],
        longitude[step_c // 2 :: step_c],
    )
    part = np.ix_(frames, [0], rows, columns)
    east, north = np.asarray(grid.east[part])[:, 0], np.asarray(grid.north[part])[:, 0]
    known = np.isfinite(east) & np.isfinite(north)
    count = np.maximum(known.sum(axis=0), 1)
    east, north = (np.where(known, x, 0.0).sum(axis=0) / count for x in (east, north))
    shown = known.any(axis=0)
    if not shown.any():
        return None
    lon, lat = np.meshgrid(longitude, grid.latitude[rows])
    speed = np.hypot(east, north)[shown]
    key = _round_down(max(float(np.quantile(speed, 0.95)), 0.01))
    arrows = axes.quiver(
        lon[shown], lat[shown], east[shown], north[shown], color="#3C4A55", alpha=0.65, width=0.0017, pivot="mid",
        scale=key * 24.0, headwidth=4, headlength=5, zorder=2,
    )  # fmt: skip
    axes.quiverkey(
        arrows, 0.90, 1.018, key, f"{key:g} m/s", labelpos="W", coordinates="axes", fontproperties={"size": 8}
    )
    return key


def _round_down(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    return next(k for k in (5.0, 2.0, 1.0) if k * power <= value * 1.0001) * power


def draw_rings(axes: Axes, geometry: dict, reference: float, **style) -> None:
    """Outlines and holes of a GeoJSON MultiPolygon, with a pale edge that keeps them apart from what lies under."""
    halo = [effects.withStroke(linewidth=style.get("linewidth", 1.0) + 1.6, foreground="white", alpha=0.75)]
    for polygon in geometry["coordinates"]:
        for ring in polygon:
            points = np.asarray(ring)
            axes.plot(unwrap_longitude(points[:, 0], reference), points[:, 1], path_effects=halo, **style)


def draw_scale_bar(axes: Axes, limits: Limits) -> None:
    """A bar of a round number of kilometres in the lower left corner."""
    per_degree = 111.32 * math.cos(math.radians(limits.middle))
    width_km = (limits.east - limits.west) * per_degree
    length = max((k for k in _BAR_KM if k <= 0.25 * width_km), default=_BAR_KM[0])
    share = length / width_km
    x, y = 0.04, 0.035
    style = {"transform": axes.transAxes, "solid_capstyle": "butt", "zorder": 9}
    axes.plot([x, x + share], [y, y], color="white", linewidth=6, **style)
    axes.plot([x, x + share], [y, y], color="black", linewidth=3, **style)
    axes.plot([x + share / 2, x + share], [y, y], color="white", linewidth=1.6, **style)
    axes.text(
        x + share / 2, y + 0.014, f"{length:g} km", transform=axes.transAxes, ha="center", va="bottom", fontsize=8,
        path_effects=HALO, zorder=9,
    )  # fmt: skip
