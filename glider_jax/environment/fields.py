"""Gridded records as tables that the compiled step can ask: how deep is it here, how does the water move now?

Each cell holds its bilinear coefficients as one row, so that a look-up is one row gather per time frame. What lies
outside the data is NaN: the step turns that into an outcome of the member, never into a frozen position.
Currents that vary with depth are held as their integral from the surface, so that the mean over any stretch of water
costs two look-ups and is exact for the interpolated profile.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.environment.frame import Frame
from glider_jax.errors import CoverageError
from glider_jax.records import BathymetryGrid, CurrentGrid


def fenced(run, compute):
    """Compute ``compute()`` in kernels of its own and keep its result in memory.

    XLA on CPU otherwise recomputes gathers and long expressions inside every kernel that uses their result, which
    costs ten to thirty times the time. ``run`` is true at run time but unknown to the compiler.
    """
    blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(compute))
    return jax.lax.cond(run, compute, lambda: blank)


def on_device(value, dtype):
    """A host value as a device array; converted on the host, where it costs no program."""
    return jnp.asarray(np.asarray(value, dtype))


def _uniform(axis):
    """Step of an axis if it is uniform within 2 % of a step, else None."""
    step = float((axis[-1] - axis[0]) / (axis.size - 1))
    return step if np.all(np.abs(axis - (axis[0] + step * np.arange(axis.size))) < 0.02 * step) else None


def _resample(values, axis, new, dim):
    """Linear interpolation of ``values`` along ``dim`` from ``axis`` to ``new``; NaN spreads to its neighbours."""
    place = np.clip(np.searchsorted(axis, new, side="right") - 1, 0, axis.size - 2)
    weight = (new - axis[place]) / (axis[place + 1] - axis[place])
    shape = [1] * values.ndim
    shape[dim] = -1
    weight = weight.reshape(shape).astype(values.dtype)
    return np.take(values, place, dim) * (1 - weight) + np.take(values, place + 1, dim) * weight


def regular_axes(values, latitude, longitude):
    """Put the last two dimensions of ``values`` on uniform latitude and longitude axes, if they are not already."""
    for dim, axis in ((-2, latitude), (-1, longitude)):
        if axis.size < 2:
            raise CoverageError(
                f"grid: expected at least two points along each axis, found {axis.size}. Use a larger area."
            )
        if _uniform(axis) is None:
            new = np.linspace(axis[0], axis[-1], int(np.ceil((axis[-1] - axis[0]) / np.median(np.diff(axis)))) + 1)
            values = _resample(values, axis, new, values.ndim + dim)
            if dim == -2:
                latitude = new
            else:
                longitude = new
    return values, latitude, longitude


def extend_over_coast(values, cells=2):
    """Give land points within ``cells`` of water the value of the nearest water point, so that the water next to the
    coast interpolates without land; points farther away stay NaN. Works on the last two dimensions."""
    flat = values.reshape(-1, values.shape[-2] * values.shape[-1]).copy()
    known, near, nearest = None, None, None
    for frame in flat:
        missing = np.isnan(frame)
        if known is None or not np.array_equal(missing, known):
            known = missing
            number = _nearest(missing.reshape(values.shape[-2:]), cells).ravel()
            near = np.flatnonzero(number >= 0)
            nearest = number[near]
        frame[near] = frame[nearest]
    return flat.reshape(values.shape)


def _nearest(missing, cells):
    """For each missing point the flat number of the nearest that is not, within ``cells`` along each axis, else -1.

    A distance transform would do the same, but loading one takes longer than the whole table.
    """
    rows, columns = missing.shape
    around = np.pad(missing, cells, constant_values=True)
    here = np.arange(missing.size).reshape(missing.shape)
    found = np.full(missing.shape, -1)
    reach = range(-cells, cells + 1)
    for dy, dx in sorted(((dy, dx) for dy in reach for dx in reach), key=lambda off: off[0] ** 2 + off[1] ** 2):
        there = around[cells + dy : cells + dy + rows, cells + dx : cells + dx + columns]
        take = missing & (found < 0) & ~there
        found[take] = here[take] + dy * columns + dx
    return found


def _bilinear(values):
    """Rows of (constant, x, y, xy) coefficients per cell from nodes ``(..., ny, nx)`` to ``(..., ny-1, nx-1, 4)``."""
    a, b = values[..., :-1, :-1], values[..., :-1, 1:]
    c, d = values[..., 1:, :-1], values[..., 1:, 1:]
    return np.stack([a, b - a, c - a, a - b - c + d], axis=-1)


class _Cells(eqx.Module):
    """The horizontal geometry of a table: where a frame coordinate lies in the grid."""

    origin: Any
    inverse_step: Any
    shape: Any

    @staticmethod
    def of(latitude, longitude, frame: Frame, dtype):
        x, y = frame.to_metres(latitude[[0, -1]], longitude[[0, -1]])
        if x[1] < x[0]:
            x[1] = x[0] + (longitude[-1] - longitude[0]) * frame.metres_per_degree[0]
        step = np.array([(x[1] - x[0]) / (longitude.size - 1), (y[1] - y[0]) / (latitude.size - 1)])
        shape = np.array([longitude.size - 1, latitude.size - 1], np.int32)
        return _Cells(
            on_device([x[0], y[0]], dtype), on_device(1.0 / step, dtype), on_device(shape, np.int32)
        )

    def locate(self, east, north):
        """Flat cell index, position within the cell (0..1, 0..1) and whether the point is inside."""
        fx = (east - self.origin[0]) * self.inverse_step[0]
        fy = (north - self.origin[1]) * self.inverse_step[1]
        i = jnp.clip(jnp.floor(fx).astype(jnp.int32), 0, self.shape[0] - 1)
        j = jnp.clip(jnp.floor(fy).astype(jnp.int32), 0, self.shape[1] - 1)
        fx, fy = fx - i.astype(fx.dtype), fy - j.astype(fy.dtype)
        inside = (fx >= 0) & (fx <= 1) & (fy >= 0) & (fy <= 1)
        return j * self.shape[0] + i, fx, fy, inside


class Bathymetry(eqx.Module):
    """Water depth and its slope anywhere on the grid."""

    cells: _Cells
    table: Any
    run: Any

    def depth(self, east, north):
        """Water depth (m, positive down) and its derivatives per frame metre; NaN outside the grid."""
        cell, fx, fy, inside = self.cells.locate(east, north)

        def lookup():
            row = self.table[cell]
            value = row[0] + row[1] * fx + row[2] * fy + row[3] * fx * fy
            slope_x = (row[1] + row[3] * fy) * self.cells.inverse_step[0]
            slope_y = (row[2] + row[3] * fx) * self.cells.inverse_step[1]
            return jnp.where(inside, value, jnp.nan), slope_x, slope_y

        return fenced(self.run, lookup)

    def ahead(self, east, north, velocity_east, velocity_north):
        """Water depth (m, positive down; NaN outside the grid) and its rate of change (m s-1) for who moves at a
        velocity (frame m s-1)."""
        cell, fx, fy, inside = self.cells.locate(east, north)
        along_x = velocity_east * self.cells.inverse_step[0]
        along_y = velocity_north * self.cells.inverse_step[1]

        def lookup():
            row = self.table[cell]
            value = row[0] + row[1] * fx + row[2] * fy + row[3] * fx * fy
            rate = (row[1] + row[3] * fy) * along_x + (row[2] + row[3] * fx) * along_y
            # One complex number leaves one kernel; two real ones would each gather the row.
            return jax.lax.complex(jnp.where(inside, value, jnp.nan), rate)

        both = fenced(self.run, lookup)
        return jnp.real(both), jnp.imag(both)


class CurrentField(eqx.Module):
    """Water velocity anywhere on the grid, averaged over a stretch of depth."""

    cells: _Cells
    table: Any
    error: Any
    first: Any
    inverse_interval: Any
    frames: Any
    inverse_depth_step: Any
    run: Any
    levels: int = eqx.field(static=True)
    steady: bool = eqx.field(static=True)

    def mean(self, clock, time, east, north, top, bottom):
        """Velocity averaged between two depths, and the product's 1-sigma error.

        Parameters
        ----------
        clock : (whole, part) frame number at the start of the present interval, from :meth:`clock`.
        time : s since the start of the interval.
        east, north : frame metres.  top, bottom : m, positive down; equal ones give the velocity there.

        Returns
        -------
        (east, north, sd): m s-1; NaN outside the area; the first or last frame outside the time range.
        """
        cell, fx, fy, inside = self.cells.locate(east, north)
        if self.steady:
            frame, part = jnp.int32(0), jnp.zeros_like(east)
        else:
            f = clock[1] + time * self.inverse_interval
            whole = jnp.floor(f)
            frame = clock[0] + whole.astype(jnp.int32)
            part = f - whole
            # Half a step past the last frame, the last frame holds; ``covers`` ends members that start there.
            part = jnp.where(frame >= self.frames - 1, jnp.ones_like(part), part)
            frame = jnp.clip(frame, 0, jnp.maximum(self.frames - 2, 0))
        count = self.cells.shape[0] * self.cells.shape[1]
        fxy = fx * fy

        def row(index):
            """u and v at the point from the eight coefficients of one cell, frame and level."""
            # Written out: a reduction over so short a dimension is many times slower.
            c = self.table[index]
            return c[0] + c[1] * fx + c[2] * fy + c[3] * fxy, c[4] + c[5] * fx + c[6] * fy + c[7] * fxy

        def at(frame_index):
            base = frame_index * count + cell
            if self.levels == 1:
                return row(base)
            deep = jnp.maximum(bottom, top + 0.5)
            low, high = self._integral(row, base, top), self._integral(row, base, deep)
            return tuple((b - a) / (deep - top) for a, b in zip(low, high, strict=True))

        def lookup():
            u, v = at(frame)
            if not self.steady:
                u2, v2 = at(frame + 1)
                u, v = u + part * (u2 - u), v + part * (v2 - v)
            # One complex number leaves one kernel, see above.
            flow = jax.lax.complex(jnp.where(inside, u, jnp.nan), jnp.where(inside, v, jnp.nan))
            return flow, self.error[cell]

        flow, error = fenced(self.run, lookup)
        return jnp.real(flow), jnp.imag(flow), error

    def covers(self, clock, time):
        """Whether a time (s since the start of the interval) lies between the first and the last frame."""
        if self.steady:
            return jnp.ones_like(time, bool)
        f = clock[1] + time * self.inverse_interval
        frame = clock[0] + jnp.floor(f).astype(jnp.int32)
        return (frame >= 0) & (frame < self.frames - 1)

    def _integral(self, row, base, depth):
        level = depth * self.inverse_depth_step
        k = jnp.clip(jnp.floor(level).astype(jnp.int32), 0, self.levels - 2)
        part = level - k.astype(level.dtype)
        low, high = row(base * self.levels + k), row(base * self.levels + k + 1)
        return tuple(a + part * (b - a) for a, b in zip(low, high, strict=True))

    def clock(self, start, interval, index):
        """Frame number (whole, part) at ``start + index * interval`` seconds since t0, without loss in float32.

        ``start`` and ``interval`` are host numbers or traced scalars in s; ``index`` an int32 scalar.
        """
        # interval/frame step split into whole and part keeps the product exact for thousands of intervals.
        rate = interval * self.inverse_interval
        whole = jnp.floor(rate)
        rest = rate - whole
        begin = (start - self.first) * self.inverse_interval
        f = begin - jnp.floor(begin) + rest * index.astype(rest.dtype)
        lift = jnp.floor(f)
        number = jnp.floor(begin).astype(jnp.int32) + whole.astype(jnp.int32) * index + lift.astype(jnp.int32)
        return number, f - lift


def make_bathymetry(grid: BathymetryGrid, frame: Frame, dtype=jnp.float32) -> Bathymetry:
    """Tabulate a bathymetry record in a frame. NaN stays NaN and ends the members that come there."""
    depth, latitude, longitude = regular_axes(np.asarray(grid.depth, float), grid.latitude, grid.longitude)
    rows = _bilinear(depth).reshape(-1, 4)
    return Bathymetry(_Cells.of(latitude, longitude, frame, dtype), on_device(rows, dtype), jnp.asarray(True))


def flat_bottom(depth: float, frame: Frame, dtype=jnp.float32) -> Bathymetry:
    """A seafloor of one depth everywhere within 40 degrees of the origin."""
    span = np.array([-40.0, 40.0])
    latitude = np.clip(frame.latitude + span, -89.9, 89.9)
    grid = BathymetryGrid(latitude, frame.longitude + span, np.full((2, 2), float(depth)), None)
    return make_bathymetry(grid, frame, dtype)


def make_currents(grid: CurrentGrid, frame: Frame, t0: float, *, default_sd: float, depth_step: float = 4.0,
                  dtype=jnp.float32, coast_cells: int = 2) -> CurrentField:
    """Tabulate a current record in a frame.

    Parameters
    ----------
    grid : the record; gaps should have been filled, what is left NaN counts as outside.
    t0 : UTC seconds since 1970 from which the field's times count.
    default_sd : m s-1, 1-sigma error where the product states none.
    depth_step : m, spacing of the integral's levels for currents that vary with depth; coarser where the water is
        deep, so that no more than 64 levels are held.
    coast_cells : how many cells of land next to water borrow its velocity.
    """
    east, latitude, longitude = regular_axes(np.asarray(grid.east, float), grid.latitude, grid.longitude)
    north, *_ = regular_axes(np.asarray(grid.north, float), grid.latitude, grid.longitude)
    time = np.asarray(grid.time, float)
    steady = bool(grid.constant_in_time) or time.size == 1
    if steady:
        east, north = east[:1], north[:1]
        step = 3600.0
    else:
        step = _uniform(time)
        if step is None:
            step = float(np.min(np.diff(time)))
            new = np.arange(time[0], time[-1] + 0.5 * step, step)
            new = new[new <= time[-1] + 1e-6]
            east, north = _resample(east, time, new, 0), _resample(north, time, new, 0)
            time = new
    east, north = extend_over_coast(east, coast_cells), extend_over_coast(north, coast_cells)
    depth = np.asarray(grid.depth, float)
    levels, inverse_depth = 1, 1.0
    if depth.size > 1:
        east, north, levels, inverse_depth = _integrate_depth(east, north, depth, depth_step)
    else:
        east, north = east[:, 0], north[:, 0]
    cells = np.concatenate([_bilinear(east), _bilinear(north)], axis=-1)
    if levels > 1:
        # (time, level, cell rows) to (time, cell, level): the two levels of a look-up then lie side by side.
        cells = np.moveaxis(cells.reshape(*cells.shape[:2], -1, 8), 1, 2)
    sd = _error_map(grid, default_sd, latitude.size, longitude.size)
    return CurrentField(
        cells=_Cells.of(latitude, longitude, frame, dtype),
        table=on_device(np.ascontiguousarray(cells.reshape(-1, 8)), dtype),
        error=on_device(sd.reshape(-1), dtype),
        first=on_device(time[0] - t0, dtype),
        inverse_interval=on_device(1.0 / step, dtype),
        frames=on_device(east.shape[0], np.int32),
        inverse_depth_step=on_device(inverse_depth, dtype),
        run=jnp.asarray(True),
        levels=levels,
        steady=steady,
    )


def _integrate_depth(east, north, depth, depth_step):
    """Integral from the surface on uniform levels; below the deepest value the velocity persists downward."""
    bottom = depth[-1]
    number = int(min(64, max(2, np.ceil(bottom / depth_step)))) + 1
    nodes = np.linspace(0.0, bottom, number)
    middles = 0.5 * (nodes[1:] + nodes[:-1])

    def integral(values):
        values = values.copy()
        for k in range(1, depth.size):
            gap = np.isnan(values[:, k])
            values[:, k][gap] = values[:, k - 1][gap]
        at = np.clip(middles, depth[0], depth[-1])
        layers = _resample(values, depth, at, 1) * np.diff(nodes)[None, :, None, None]
        total = np.cumsum(layers, axis=1)
        return np.concatenate([np.zeros_like(total[:, :1]) + 0.0 * total[:, :1], total], axis=1)

    return integral(east), integral(north), number, (number - 1) / bottom


def _error_map(grid, default_sd, ny, nx):
    """Time-mean 1-sigma error per cell, the default where the product has none."""
    if grid.east_sd is None or grid.north_sd is None:
        return np.full((ny - 1, nx - 1), default_sd)
    with np.errstate(invalid="ignore"):
        variance = 0.5 * (np.asarray(grid.east_sd, float) ** 2 + np.asarray(grid.north_sd, float) ** 2)
        known = np.isfinite(variance)
        count = known.sum(axis=(0, 1))
        total = np.where(known, variance, 0.0).sum(axis=(0, 1))
        mean = np.where(count > 0, total / np.maximum(count, 1), default_sd**2)
    mean, *_ = regular_axes(mean, grid.latitude, grid.longitude)
    return np.sqrt(0.25 * (mean[:-1, :-1] + mean[:-1, 1:] + mean[1:, :-1] + mean[1:, 1:]))


def still_water(frame: Frame, sd: float = 0.0, dtype=jnp.float32) -> CurrentField:
    """No current anywhere, with a stated 1-sigma error (m s-1)."""
    span = np.array([-40.0, 40.0])
    latitude = np.clip(frame.latitude + span, -89.9, 89.9)
    zero = np.zeros((1, 1, 2, 2))
    grid = CurrentGrid(
        np.zeros(1), np.zeros(1), latitude, frame.longitude + span, zero, zero, None, constant_in_time=True
    )
    return make_currents(grid, frame, 0.0, default_sd=sd, dtype=dtype)
