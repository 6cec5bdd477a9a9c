"""What gridded products say along a glider's track: the current given to the pilot, the charted water depth.

NumPy only. A newcomer would get wrong: outside a product's area or time there is no current, which is not a current
of zero; the shares are returned so that the caller can say so.
"""

from __future__ import annotations

import numpy as np

from glider_jax.records import Array, BathymetryGrid, CurrentGrid


def along_track(
    grid: CurrentGrid, time: Array, latitude: Array, longitude: Array, depth: Array
) -> tuple[Array, Array, Array]:
    """Current east and north in m s-1 at moments along a track, and where the product knew it.

    Parameters
    ----------
    time : s since 1970. latitude, longitude : degrees. depth : m, used only by a product with several levels.

    Returns
    -------
    east, north : 0 where unknown. known : bool.

    Notes
    -----
    Linear in space among the corners that have a value, cubic in time: between hourly frames a straight line loses two
    per cent of a half-daily tide, which would pass for a product that is too weak. Straight where a frame lacks.
    """
    places = [_place(grid.latitude, latitude), _place(grid.longitude, _near(longitude, grid.longitude))]
    level = _place(grid.depth, np.clip(depth, grid.depth[0], grid.depth[-1]), constant=grid.depth.size == 1)
    low, share, inside = _place(grid.time, time, constant=grid.constant_in_time or grid.time.size == 1)
    inside = np.logical_and.reduce([inside, level[2], *(axis[2] for axis in places)])
    last = grid.time.size - 1
    frames = [_in_space(grid, np.clip(low + offset, 0, last), (level, *places)) for offset in (-1, 0, 1, 2)]
    (before, had_before), (one, has_one), (two, has_two), (after, had_after) = frames
    one, two = np.where(has_one, one, two), np.where(has_two, two, one)
    evenly = np.ones(time.size, bool)
    if last > 1:
        step = np.diff(grid.time)
        around = step[np.clip(low[:, None] + np.array([-1, 0, 1]), 0, last - 1)]
        evenly = np.ptp(around, axis=1) < 0.02 * around[:, 1]
    curved = evenly & has_one & has_two
    before = np.where(curved & had_before & (low > 0), before, 2.0 * one - two)
    after = np.where(curved & had_after & (low + 2 <= last), after, 2.0 * two - one)
    # The cubic of Catmull and Rom: through both frames, with the slope that their neighbours give.
    s = share
    bend = (one - before) - (two - one), (after - two) - (two - one)
    found = one + s * (two - one) - 0.5 * s * (1.0 - s) * ((1.0 - s) * -bend[0] + s * bend[1])
    known = inside & (has_one | has_two)
    return np.where(known, found[0], 0.0), np.where(known, found[1], 0.0), known


def _in_space(grid: CurrentGrid, frame: Array, axes) -> tuple[Array, Array]:
    """Current (2, n) of one frame for each moment, linear among the corners that have a value, and whether any has."""
    total = np.zeros((3, frame.size))
    sizes = (grid.depth.size, grid.latitude.size, grid.longitude.size)
    for corner in range(8):
        weight, index = np.ones(frame.size), [frame]
        for bit, ((low, share, _), size) in enumerate(zip(axes, sizes, strict=True)):
            upper = corner >> bit & 1
            weight = weight * (share if upper else 1.0 - share)
            index.append(np.minimum(low + upper, size - 1))
        east, north = grid.east[tuple(index)], grid.north[tuple(index)]
        weight = np.where(np.isfinite(east) & np.isfinite(north), weight, 0.0)
        total += weight * np.stack([np.nan_to_num(east), np.nan_to_num(north), np.ones(frame.size)])
    known = total[2] > 1e-6
    return total[:2] / np.where(known, total[2], 1.0), known


def depth_along_track(grid: BathymetryGrid, latitude: Array, longitude: Array) -> Array:
    """Charted water depth in m at positions in degrees; NaN outside the chart."""
    rows = _place(grid.latitude, latitude)
    columns = _place(grid.longitude, _near(longitude, grid.longitude))
    found = np.zeros(latitude.size)
    for corner in range(4):
        up, right = corner & 1, corner >> 1
        weight = (rows[1] if up else 1.0 - rows[1]) * (columns[1] if right else 1.0 - columns[1])
        i = np.minimum(rows[0] + up, grid.latitude.size - 1)
        j = np.minimum(columns[0] + right, grid.longitude.size - 1)
        found = found + weight * grid.depth[i, j]
    return np.where(rows[2] & columns[2], found, np.nan)


def _near(longitude: Array, axis: Array) -> Array:
    """Longitudes turned by whole circles to lie near an axis."""
    return longitude + 360.0 * np.round((axis.mean() - longitude) / 360.0)


def _place(axis: Array, at: Array, constant: bool = False) -> tuple[Array, Array, Array]:
    """Lower index, share towards the next, and whether inside (half a step beyond the ends counts)."""
    if constant or axis.size == 1:
        zeros = np.zeros(at.size)
        return zeros.astype(int), zeros, np.ones(at.size, bool)
    step = float(np.median(np.diff(axis)))
    low = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
    share = (at - axis[low]) / (axis[low + 1] - axis[low])
    inside = (at >= axis[0] - 0.5 * step) & (at <= axis[-1] + 0.5 * step)
    return low, np.clip(share, 0.0, 1.0), inside
