"""From a curvilinear model grid to a regular longitude-latitude grid, with weights worked out once.

NumPy and scipy only. A newcomer would get wrong: the interpolation follows the model's own cells (inverse
bilinear in each quadrilateral), not a triangulation of the cloud of nodes, so that nothing is invented across
the concave outer edge of a bent grid or across land.
"""

from __future__ import annotations

import numpy as np

from glider_jax.records import Array

MINIMUM_SEA = 0.5  # a target is sea if at least half of its weight comes from nodes at sea
EDGE = 1e-6  # tolerance in cell coordinates, so that targets on a cell edge belong to a cell


class CurvilinearWeights:
    """Weights from nodes of a curvilinear grid to the points of a regular grid; build once, apply often.

    Parameters
    ----------
    lon2d, lat2d : (ny, nx) degrees, positions of the nodes; NaN for nodes that do not exist.
    sea2d : (ny, nx) True where the node is water.
    lon, lat : (nlon,), (nlat,) degrees, the regular axes wanted; longitudes may be in either convention.

    Attributes
    ----------
    inside : (nlat, nlon) True where the target lies in a cell of the model grid.
    valid : (nlat, nlon) True where the target lies in a cell and at least half of its weight is at sea.
    """

    def __init__(self, lon2d: Array, lat2d: Array, sea2d: Array, lon: Array, lat: Array):
        # Loaded where it is used: most grids are regular, and this takes a tenth of a second.
        from scipy.sparse import csr_matrix

        lon2d, lat2d = np.asarray(lon2d, float), np.asarray(lat2d, float)
        self._source = lon2d.shape
        self._target = (np.size(lat), np.size(lon))
        grid_lat, grid_lon = (part.ravel() for part in np.meshgrid(lat, lon, indexing="ij"))
        corners, weights, inside = _locate(lon2d, lat2d, grid_lon, grid_lat)
        weights = np.where(np.asarray(sea2d, bool).ravel()[corners], weights, 0.0)
        total = weights.sum(axis=1)
        valid = inside & (total >= MINIMUM_SEA)
        weights = np.where(valid[:, None], weights / np.where(total > 0, total, 1.0)[:, None], 0.0)
        rows = np.repeat(np.arange(grid_lon.size), 4)
        shape = (grid_lon.size, lon2d.size)
        self._matrix = csr_matrix((weights.ravel(), (rows, corners.ravel())), shape=shape)
        self._matrix.eliminate_zeros()
        self.inside = inside.reshape(self._target)
        self.valid = valid.reshape(self._target)

    def apply(self, values: Array) -> Array:
        """Interpolate ``values`` (..., ny, nx) to (..., nlat, nlon); NaN outside the grid and on land.

        A node that is NaN at sea is left out and the weights of the others are scaled up, as long as they
        carry at least half of the weight.
        """
        values = np.asarray(values, float)
        if values.shape[-2:] != self._source:
            raise ValueError(f"expected trailing dimensions {self._source}, found {values.shape[-2:]}")
        flat = values.reshape(-1, values.shape[-2] * values.shape[-1])
        known = np.isfinite(flat)
        out = (self._matrix @ np.where(known, flat, 0.0).T).T
        share = (self._matrix @ known.astype(float).T).T
        good = self.valid.ravel() & (share >= MINIMUM_SEA)
        out = np.where(good, out / np.where(good, share, 1.0), np.nan)
        return out.reshape(*values.shape[:-2], *self._target)


def regrid_curvilinear(
    lon2d: Array, lat2d: Array, values: Array, lon: Array, lat: Array, valid: Array | None = None
) -> Array:
    """Interpolate one field from a curvilinear grid; see :class:`CurvilinearWeights` for many.

    Parameters
    ----------
    lon2d, lat2d : (ny, nx) degrees.
    values : (..., ny, nx), NaN where nothing is known.
    lon, lat : regular axes, degrees.
    valid : (ny, nx) True at sea; all True if None.
    """
    sea = np.ones(np.shape(lon2d), bool) if valid is None else valid
    return CurvilinearWeights(lon2d, lat2d, sea, lon, lat).apply(values)


def regular_axes(lon2d: Array, lat2d: Array) -> tuple[Array, Array]:
    """Ascending longitude and latitude axes that cover a curvilinear grid at about its own spacing.

    Returns
    -------
    Longitudes (nlon,) and latitudes (nlat,), degrees. The step in both directions is the median distance
    between neighbouring nodes along the model's axes, expressed in degrees at the middle latitude.
    """
    lon2d, lat2d = np.asarray(lon2d, float), np.asarray(lat2d, float)
    middle = _middle_longitude(lon2d)
    lon2d = middle + _wrap(lon2d - middle)
    scale = np.cos(np.radians(np.nanmean(lat2d)))
    steps = [
        np.hypot(np.diff(lon2d, axis=axis) * scale, np.diff(lat2d, axis=axis)).ravel()
        for axis in (0, 1)
        if lon2d.shape[axis] > 1
    ]
    step = float(np.nanmedian(np.concatenate(steps)))
    low, high = np.nanmin(lat2d), np.nanmax(lat2d)
    west, east = np.nanmin(lon2d), np.nanmax(lon2d)
    lat = np.linspace(low, high, max(2, int(round((high - low) / step)) + 1))
    lon = np.linspace(west, east, max(2, int(round((east - west) * scale / step)) + 1))
    return lon, lat


def _middle_longitude(lon: Array) -> float:
    """Circular mean of longitudes, degrees."""
    angle = np.radians(lon[np.isfinite(lon)])
    return float(np.degrees(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean())))


def _wrap(degrees: Array) -> Array:
    """Angle differences brought into [-180, 180)."""
    return (degrees + 180.0) % 360.0 - 180.0


def _unit(lon: Array, lat: Array) -> Array:
    """Unit vectors (n, 3) of positions in degrees."""
    lam, phi = np.radians(lon), np.radians(lat)
    return np.stack([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)], axis=-1)


def _locate(lon2d: Array, lat2d: Array, lon: Array, lat: Array) -> tuple[Array, Array, Array]:
    """Find the cell of every target: flat indices of its 4 corners, their weights, and whether found."""
    ny, nx = lon2d.shape
    n = lon.size
    corners = np.zeros((n, 4), int)
    weights = np.zeros((n, 4))
    found = np.zeros(n, bool)
    exists = np.isfinite(lon2d) & np.isfinite(lat2d)
    if ny < 2 or nx < 2 or not exists.any():
        return corners, weights, found
    nodes = np.flatnonzero(exists.ravel())
    from scipy.spatial import cKDTree

    tree = cKDTree(_unit(lon2d.ravel()[nodes], lat2d.ravel()[nodes]))
    near = nodes[tree.query(_unit(lon, lat))[1]]
    row, col = np.divmod(near, nx)
    # The cells touching the nearest node first; strongly skewed cells may need one ring more.
    ring = [(j, i) for j in range(-2, 2) for i in range(-2, 2)]
    ring.sort(key=lambda cell: (cell[0] + 0.5) ** 2 + (cell[1] + 0.5) ** 2)
    for j, i in ring:
        todo = np.flatnonzero(~found)
        if todo.size == 0:
            break
        j0, i0 = row[todo] + j, col[todo] + i
        fits = (j0 >= 0) & (j0 < ny - 1) & (i0 >= 0) & (i0 < nx - 1)
        todo, j0, i0 = todo[fits], j0[fits], i0[fits]
        quad = np.stack([j0 * nx + i0, j0 * nx + i0 + 1, (j0 + 1) * nx + i0, (j0 + 1) * nx + i0 + 1], axis=1)
        x = _wrap(lon2d.ravel()[quad] - lon[todo, None])
        y = lat2d.ravel()[quad] - lat[todo, None]
        s, t, hit = _inverse_bilinear(x, y)
        corners[todo[hit]] = quad[hit]
        s, t = s[hit], t[hit]
        weights[todo[hit]] = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t], axis=1)
        found[todo[hit]] = True
    return corners, weights, found


def _inverse_bilinear(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Cell coordinates s, t in [0, 1] at which the bilinear map of the corners (n, 4) passes through (0, 0).

    Newton's iteration from the middle of the cell; for a convex cell it converges in a few steps.
    """
    s = np.full(x.shape[0], 0.5)
    t = s.copy()
    good = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    x, y = np.where(good[:, None], x, 0.0), np.where(good[:, None], y, 0.0)
    ax, bx, cx, dx = x[:, 0], x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 2] - x[:, 1] + x[:, 0]
    ay, by, cy, dy = y[:, 0], y[:, 1] - y[:, 0], y[:, 2] - y[:, 0], y[:, 3] - y[:, 2] - y[:, 1] + y[:, 0]
    for _ in range(8):
        fx, fy = ax + bx * s + cx * t + dx * s * t, ay + by * s + cy * t + dy * s * t
        xs, xt, ys, yt = bx + dx * t, cx + dx * s, by + dy * t, cy + dy * s
        det = xs * yt - xt * ys
        good &= det != 0
        det = np.where(det == 0, 1.0, det)
        s = np.clip(s - (fx * yt - fy * xt) / det, -2.0, 3.0)
        t = np.clip(t - (fy * xs - fx * ys) / det, -2.0, 3.0)
    inside = good & (s >= -EDGE) & (s <= 1 + EDGE) & (t >= -EDGE) & (t <= 1 + EDGE)
    miss = np.hypot(ax + bx * s + cx * t + dx * s * t, ay + by * s + cy * t + dy * s * t)
    span = np.hypot(bx, by) + np.hypot(cx, cy)
    return np.clip(s, 0, 1), np.clip(t, 0, 1), inside & (miss <= 1e-6 * span)
