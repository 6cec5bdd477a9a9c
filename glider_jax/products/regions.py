"""Where the glider will be with 50 or 90 % probability: highest-density regions of a cloud of positions.

The cloud is binned on a grid aligned with its principal axes (metres), smoothed with a Gaussian whose width is chosen
by leave-one-out likelihood, and cut at the density that leaves the wanted share of members inside. Each member's own
contribution is left out when that level is sought, so that regions hold the promised share of *new* positions, not only
of those that drew them. Few members or a cloud without width give the ellipse of a normal distribution instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import contourpy
import numpy as np

from glider_jax.products.coordinates import LocalFrame, frame_of
from glider_jax.records import Array

FEW = 50
_CELLS = 160
_BANDWIDTHS = (1.0, 0.6, 0.36)
_SMALLEST_SPREAD = 1.0
#: Cells with room for the kernel on every side, so that smoothing by the spectrum does not come around.
_PADDED = 240


@dataclass(frozen=True)
class Region:
    """A region that holds ``probability`` of the positions.

    ``polygons`` are lists of rings; the first ring of each is the outline, the others are holes. A ring is an array
    (point, 2) of longitude and latitude in degrees, closed, longitudes unwrapped. ``area`` m2. ``method`` is
    ``density`` or ``normal``.
    """

    probability: float
    area: float
    polygons: tuple[tuple[Array, ...], ...]
    method: str


@dataclass(frozen=True)
class Axes:
    """Principal axes of a cloud in the plane: metres = centre + coordinates @ basis, coordinates of unit variance."""

    centre: Array
    basis: Array

    def whiten(self, metres: Array) -> Array:
        """Metres (k, 2) as coordinates (k, 2)."""
        return (metres - self.centre) @ np.linalg.inv(self.basis)

    def unwhiten(self, coordinates: Array) -> Array:
        """Coordinates (k, 2) as metres (k, 2)."""
        return coordinates @ self.basis + self.centre

    @property
    def cell_area(self) -> float:
        """Square metres per unit of coordinate area."""
        return abs(float(np.linalg.det(self.basis)))


def principal_axes(metres: Array) -> Axes:
    """Axes from the mean and covariance of positions (k, 2) m; spreads below 1 m count as 1 m."""
    centre = metres.mean(axis=0)
    covariance = np.atleast_2d(np.cov(metres.T)) if len(metres) > 1 else np.zeros((2, 2))
    variances, vectors = np.linalg.eigh(covariance)
    spread = np.sqrt(np.maximum(variances, _SMALLEST_SPREAD**2))
    return Axes(centre, spread[:, None] * vectors.T)


@dataclass
class CloudHistogram:
    """Counts of positions on a square grid over principal axes; grows by blocks at constant memory.

    ``low`` and ``step`` (2,) describe cell centres ``low + step * index``; ``outside`` counts positions off the grid.
    """

    axes: Axes
    low: Array
    step: Array
    counts: Array
    outside: float = 0.0

    @classmethod
    def over(cls, metres: Array, *, margin: float = 0.2, trim: float = 0.001) -> CloudHistogram:
        """A grid over a first block of positions, between its extreme quantiles widened by ``margin``."""
        axes = principal_axes(metres)
        scaled = axes.whiten(metres)
        k = int(trim * len(metres))
        ordered = np.partition(scaled, (k, len(metres) - 1 - k), axis=0) if k else np.sort(scaled, axis=0)
        low, high = ordered[k], ordered[len(metres) - 1 - k]
        pad = margin * (high - low) + 3.0 * _bandwidth(len(metres))
        step = (high - low + 2.0 * pad) / (_CELLS - 1)
        return cls(axes, low - pad, step, np.zeros((_CELLS, _CELLS)))

    @property
    def total(self) -> float:
        """Number of positions seen."""
        return float(self.counts.sum()) + self.outside

    def add(self, metres: Array) -> None:
        """Count positions (k, 2) m, each shared between the four nearest cells."""
        place = (self.axes.whiten(metres) - self.low) / self.step
        cell = np.floor(place)
        inside = ((cell >= 0) & (cell < _CELLS - 1)).all(axis=1)
        self.outside += float((~inside).sum())
        part = place[inside] - cell[inside]
        corner = cell[inside].astype(np.intp) @ np.array([_CELLS, 1])
        flat = np.zeros(self.counts.size)
        for i in (0, 1):
            for j in (0, 1):
                weight = np.abs(1 - i - part[:, 0]) * np.abs(1 - j - part[:, 1])
                flat += np.bincount(corner + i * _CELLS + j, weight, minlength=flat.size)
        self.counts += flat.reshape(self.counts.shape)

    def density(self) -> tuple[Array, Array]:
        """Smoothed density per coordinate area, and the same without each position's own share.

        The width of the kernel is narrowed in up to three steps for as long as the leave-one-out likelihood grows.
        """
        best, chosen = -np.inf, None
        # Single precision halves the time, and 1e-7 of a density moves no contour.
        spectrum = np.fft.rfft2(self.counts.astype(np.float32), (_PADDED, _PADDED))
        seen, others = self.counts > 0, max(self.total - 1.0, 1.0)
        weights = self.counts[seen]
        for factor in _BANDWIDTHS:
            width = factor * _bandwidth(self.total)
            if width < 0.6 * self.step.max() and chosen is not None:
                break
            kernels = [_kernel(width, step) for step in self.step]
            rows, columns = (np.fft.rfft(kernel).real for kernel in kernels)
            # The kernel is symmetric: its spectrum is real, and that of negative frequencies mirrors the other half.
            rows = np.concatenate([rows, rows[-2:0:-1]])
            spread = spectrum * (rows[:, None] * columns[None, :])
            smooth = np.maximum(np.fft.irfft2(spread, (_PADDED, _PADDED))[:_CELLS, :_CELLS], 0.0)
            own = kernels[0][0] * kernels[1][0]
            left_out = np.maximum(smooth[seen] - own, 0.0)
            # A lone position must not veto a width, so the likelihood has a floor.
            score = float(np.dot(weights, np.log(left_out + 1e-4 * own)))
            if score <= best:
                # The likelihood has one maximum: once it falls, narrower kernels are worse still.
                break
            best, chosen = score, (smooth / self.total, np.maximum(smooth - own, 0.0) / others)
        return chosen


def _bandwidth(n: float) -> float:
    """Scott's rule for two dimensions and unit variance."""
    return max(float(n), 2.0) ** (-1.0 / 6.0)


def _kernel(width: float, step: float) -> Array:
    """Weights that smooth cell counts into a density along one axis, around cell 0 of a circle of padded cells."""
    apart = np.minimum(np.arange(_PADDED), _PADDED - np.arange(_PADDED))
    weights = np.exp(-0.5 * (apart * step / width) ** 2) / (width * math.sqrt(2.0 * math.pi))
    return weights.astype(np.float32)


def regions(
    latitude: Array, longitude: Array, probabilities: tuple[float, ...] = (0.5, 0.9)
) -> tuple[Region, ...]:
    """Highest-density regions of positions in degrees; NaN positions are left out.

    Parameters
    ----------
    latitude, longitude : (n,) degrees.
    probabilities : shares of new positions the regions shall hold, below 0.99.

    Returns
    -------
    One region per probability, or none where fewer than three positions are known.
    """
    latitude, longitude = np.ravel(latitude), np.ravel(longitude)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if good.sum() < 3:
        return ()
    frame = frame_of(latitude[good], longitude[good])
    metres = np.stack(frame.to_metres(latitude[good], longitude[good]), axis=1)
    return regions_of_metres(metres, frame, probabilities)


def regions_of_metres(
    metres: Array, frame: LocalFrame, probabilities: tuple[float, ...] = (0.5, 0.9)
) -> tuple[Region, ...]:
    """The same for finite positions (n, 2) in metres of a frame."""
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(metres.T)))
    if len(metres) < FEW or spread.min() < _SMALLEST_SPREAD:
        return tuple(normal_region(metres, frame, p) for p in probabilities)
    histogram = CloudHistogram.over(metres, margin=0.02)
    histogram.add(metres)
    return histogram_regions(histogram, frame, probabilities)


def histogram_regions(
    histogram: CloudHistogram, frame: LocalFrame, probabilities: tuple[float, ...] = (0.5, 0.9)
) -> tuple[Region, ...]:
    """Regions from counted positions, for clouds too large to hold."""
    smooth, left_out = histogram.density()
    seen = histogram.counts > 0
    order = np.argsort(left_out[seen])[::-1]
    values = left_out[seen][order]
    share = np.cumsum(histogram.counts[seen][order]) / histogram.total
    contours = contourpy.contour_generator(
        z=smooth,
        name="serial",
        fill_type=contourpy.FillType.OuterOffset,
        line_type=contourpy.LineType.Separate,
    )
    found = []
    for p in probabilities:
        level = float(np.interp(p, share, values))
        points, offsets = contours.filled(level, np.inf)
        polygons, area = [], 0.0
        for ring_points, ring_offsets in zip(points, offsets, strict=True):
            rings = [
                # contourpy gives (column, row); columns run along the second axis.
                histogram.low + histogram.step * ring_points[a:b, ::-1]
                for a, b in zip(ring_offsets[:-1], ring_offsets[1:], strict=True)
            ]
            sizes = [abs(_signed_area(ring)) for ring in rings]
            area += (2.0 * sizes[0] - sum(sizes)) * histogram.axes.cell_area
            kept = [ring for ring, size in zip(rings, sizes, strict=True) if size > histogram.step.prod()]
            if kept:
                tolerance = 0.15 * float(histogram.step.min())
                polygons.append(
                    tuple(_to_degrees(histogram.axes.unwhiten(simplify(r, tolerance)), frame) for r in kept)
                )
        found.append(Region(p, area, tuple(polygons), "density"))
    return tuple(found)


def normal_region(metres: Array, frame: LocalFrame, probability: float) -> Region:
    """Ellipse that holds the next position of a normal cloud, the unknown mean and covariance allowed for.

    For n positions the squared radius in coordinates is that of the predictive distribution,
    2 (n² - 1) / (n (n - 2)) times the quantile of F(2, n - 2), which is (n - 2) / 2 ((1 - p)^(-2 / (n - 2)) - 1).
    """
    n = len(metres)
    axes = principal_axes(metres)
    quantile = 0.5 * (n - 2.0) * ((1.0 - probability) ** (-2.0 / (n - 2.0)) - 1.0)
    factor = 2.0 * (n * n - 1.0) / (n * (n - 2.0)) * quantile
    angle = np.linspace(0.0, 2.0 * math.pi, 73)
    ring = axes.unwhiten(math.sqrt(factor) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    area = math.pi * factor * axes.cell_area
    return Region(probability, area, ((_to_degrees(ring, frame),),), "normal")


def _to_degrees(metres: Array, frame: LocalFrame) -> Array:
    latitude, longitude = frame.to_degrees(metres[:, 0], metres[:, 1])
    return np.stack([longitude, latitude], axis=1)


def _signed_area(ring: Array) -> float:
    """Area of a closed ring, positive when it runs counter-clockwise."""
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))


def simplify(ring: Array, tolerance: float) -> Array:
    """A closed ring with fewer points, none of those left out farther than ``tolerance`` from the new line.

    Douglas and Peucker's method, split at the first point and the one farthest from it.
    """
    far = int(np.argmax(((ring - ring[0]) ** 2).sum(axis=1)))
    return thin(ring, (0, far, len(ring) - 1), tolerance)


def thin(ring: Array, anchors: tuple[int, ...], tolerance: float) -> Array:
    """The same for a line, open or closed, between points that stay: ``anchors``, ascending, both ends among them."""
    keep = np.zeros(len(ring), bool)
    keep[list(anchors)] = True
    stack = list(zip(anchors[:-1], anchors[1:], strict=True))
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        along = ring[last] - ring[first]
        offset = ring[first + 1 : last] - ring[first]
        length = math.hypot(*along)
        if length > 0.0:
            gap = np.abs(along[0] * offset[:, 1] - along[1] * offset[:, 0]) / length
        else:
            gap = np.hypot(offset[:, 0], offset[:, 1])
        worst = int(np.argmax(gap))
        if gap[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            stack += [(first, middle), (middle, last)]
    return ring[keep]


def inside(region: Region, latitude: Array, longitude: Array) -> Array:
    """Whether places in degrees lie in a region, holes excepted."""
    points = np.stack([np.ravel(longitude), np.ravel(latitude)], axis=1)
    count = np.zeros(len(points), int)
    for rings in region.polygons:
        for ring in rings:
            count += crossings(ring, points)
    return (count % 2 == 1).reshape(np.shape(latitude))


def crossings(ring: Array, points: Array) -> Array:
    """Number of edges of a closed ring (k, 2) crossed by a ray from each point (m, 2) in the first direction."""
    x, y = points[:, 0], points[:, 1]
    count = np.zeros(len(points), np.int64)
    for (x0, y0), (x1, y1) in zip(ring[:-1], ring[1:], strict=True):
        if y0 == y1:
            continue
        straddles = (y0 > y) != (y1 > y)
        count += straddles & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return count
