"""Fill the gaps of gridded currents from the values around them, and say how much was filled and how well.

NumPy and scipy only, no JAX. The default is a membrane through the known values of all frames at once: it minimises
the squared differences between neighbours in space and in time, each weighted by how alike neighbours are in this very
record, plus a weak pull towards the frame's mean flow. Outages that time bridges far better than space are first
filled linearly in time. A newcomer would get wrong: an isolated gap is known better from its neighbours in space, an
hour's outage better from the hours around it; no fixed order of the two serves both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import cg

from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.records import Array, CurrentGrid

METHODS = {
    "membrane": "a membrane in space and time",
    "staged": "linear in time, then a membrane in space",
}
MAX_DISTANCE = 30e3  # m; where the measured error of a filled value has grown to the spread of the currents
MAX_HOURS = 6.0
GROWTH = 0.7  # error variance per cell of distance, in units of the mean squared difference of neighbours; measured
CEILING = 2.0  # error variance of a filled value at most, in units of the variance about the mean flow; measured
SCREEN = 4.0  # distance, in units of max_distance, over which a value far from data returns to the mean flow
METRES_PER_DEGREE = 111195.0


def fill_gaps(
    grid: CurrentGrid,
    *,
    method: str = "membrane",
    max_distance: float = MAX_DISTANCE,
    max_hours: float = MAX_HOURS,
    default_sd: float | None = None,
) -> CurrentGrid:
    """Fill gaps within reach of known values; what lies beyond stays NaN.

    Measured values are never changed. East and north are filled one by one. Below the deepest value of a column
    that value persists, and gaps between levels are interpolated in depth. Land of a model (``grid.sea`` False)
    stays NaN; where the product does not know land, every cell within reach is filled.

    Parameters
    ----------
    grid : currents with gaps.
    method : ``membrane``: linear in time where that promises less than half the error variance of space, else
        neighbours in space and time at once; ``staged``: always linear in time first, over gaps of up to
        ``max_hours``, then a membrane in each frame.
    max_distance : m, how far from known values a gap is filled, at least two cells.
    max_hours : h, how far in time, at least one frame. Both count together: half the reach in space and half
        in time is within.
    default_sd : m s-1, 1-sigma of known values where the product states none; None then leaves the errors unstated.

    Returns
    -------
    The grid with gaps filled, ``filled`` the share of its values that were filled (what persists downward not
    counted), ``fill_method`` how, and notes.
    Where errors are stated, a filled value has the variance of its nearest known value plus 0.7 times the mean
    squared difference between neighbouring cells for every cell of distance, up to twice the variance about the mean.

    Raises
    ------
    ConfigError : the method is unknown, or a reach is not positive.
    """
    if method not in METHODS:
        raise ConfigError(f"method: expected {' or '.join(METHODS)}, found '{method}'.{did_you_mean(method, METHODS)}")
    if not (max_distance > 0 and max_hours > 0):
        raise ConfigError(
            f"max_distance, max_hours: expected positive, found {max_distance:g} m and {max_hours:g} h. Give both."
        )
    east, north = np.array(grid.east, float), np.array(grid.north, float)
    sds = _known_errors(grid, default_sd)
    before = np.isfinite(east) & np.isfinite(north)
    _persist_downward(grid, (east, north), sds)
    below = np.isfinite(east) & np.isfinite(north) & ~before
    for window in _runs(grid, max_hours):
        for level in range(grid.depth.size):
            reach = _Reach.of(grid, window, max_distance, max_hours)
            parts = [values[window, level] for values in (east, north)]
            errors = [None if sd is None else sd[window, level] for sd in sds]
            _fill_level(parts, errors, grid.sea, reach, method)
    known = np.isfinite(east) & np.isfinite(north)
    return _report(grid, (east, north), sds, before, known, below, method, max_distance, max_hours)


@dataclass(frozen=True)
class _Reach:
    """How far a run of frames may be filled, in steps of its own grid; ``clock`` its times in usual intervals."""

    cells: tuple[float, float]
    frames: float
    clock: Array

    @staticmethod
    def of(grid: CurrentGrid, window: slice, max_distance: float, max_hours: float) -> _Reach:
        """Reach in cells along latitude and longitude, and in frames."""
        lat, lon, time = grid.latitude, grid.longitude, grid.time[window]
        north = METRES_PER_DEGREE * (np.median(np.diff(lat)) if lat.size > 1 else 1.0)
        scale = max(np.cos(np.radians(np.mean(lat))), 0.01)
        east = METRES_PER_DEGREE * scale * (np.median(np.diff(lon)) if lon.size > 1 else 1.0)
        usual = float(np.median(np.diff(time))) if time.size > 1 else 1.0
        frames = max_hours * 3600.0 / usual if time.size > 1 else 1.0
        cells = (max(max_distance / north, 2.0), max(max_distance / east, 2.0))
        return _Reach(cells, max(frames, 1.0), (time - time[0]) / usual)


def _known_errors(grid: CurrentGrid, default_sd: float | None) -> list[Array | None]:
    """Copies of the product's errors, the default where it states none, or None."""
    found: list[Array | None] = []
    for sd, values in ((grid.east_sd, grid.east), (grid.north_sd, grid.north)):
        if sd is not None:
            found.append(np.array(sd, float))
        elif default_sd is not None:
            found.append(np.where(np.isfinite(values), float(default_sd), np.nan))
        else:
            found.append(None)
    return found


def _runs(grid: CurrentGrid, max_hours: float) -> Iterator[slice]:
    """Stretches of time without a hole that is too wide to look across."""
    steps = np.diff(grid.time)
    widest = max(max_hours * 3600.0, 1.5 * float(np.median(steps))) if steps.size else 0.0
    edges = [0, *(np.flatnonzero(steps > widest) + 1).tolist(), grid.time.size]
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        yield slice(first, last)


def _persist_downward(grid: CurrentGrid, fields: tuple[Array, Array], sds: list[Array | None]) -> None:
    """Interpolate gaps between levels and repeat the deepest value below it, in place.

    The error of what is filled is that of the level above.
    """
    if grid.depth.size < 2:
        return
    for values, sd in zip(fields, sds, strict=True):
        known = np.isfinite(values)
        if known.all() or not known.any():
            continue
        level = np.arange(grid.depth.size)[:, None, None]
        above = np.maximum.accumulate(np.where(known, level, -1), axis=1)
        under = np.minimum.accumulate(np.where(known, level, grid.depth.size)[:, ::-1], axis=1)[:, ::-1]
        todo = ~known & (above >= 0)
        frame, k, j, i = np.nonzero(todo)
        top, low = above[todo], under[todo]
        inside = low < grid.depth.size
        low = np.where(inside, low, top)
        span = np.where(inside, grid.depth[low] - grid.depth[top], 1.0)
        share = np.where(inside, (grid.depth[k] - grid.depth[top]) / span, 0.0)
        values[todo] = (1 - share) * values[frame, top, j, i] + share * values[frame, low, j, i]
        if sd is not None:
            sd[todo] = sd[frame, top, j, i]


def _fill_level(parts: list[Array], errors: list[Array | None], sea: Array | None, reach: _Reach, method: str) -> None:
    """Fill east and north (frame, latitude, longitude) of one level in place, with their errors."""
    water = np.ones(parts[0].shape[1:], bool) if sea is None else np.asarray(sea, bool)
    if not any((np.isfinite(part).any() and (~np.isfinite(part) & water).any()) for part in parts):
        return
    unlike = _unlikeness(parts, reach)
    for part, sd in zip(parts, errors, strict=True):
        gap = ~np.isfinite(part) & water
        if not gap.any() or gap[:, water].all():
            continue
        known = np.isfinite(part)
        target = gap & (_distance(known, (1 / reach.frames, 1 / reach.cells[0], 1 / reach.cells[1])) <= 1.0)
        if not target.any():
            continue
        mean = _mean_flow(part)
        spread = float(np.var((part - mean)[known]))
        _linear_in_time(part, target, reach, unlike, spread, always=method == "staged")
        links = (0.0 if method == "staged" else 1.0 / unlike[0], 1.0 / unlike[1], 1.0 / unlike[2])
        screen = SCREEN * float(np.mean(reach.cells))
        _relax(part, target & ~np.isfinite(part), mean, links, screen, reach.clock)
        if sd is not None:
            # In the metric of the neighbours' differences a cell is 1 and a frame as much as it differs more.
            far, nearest = distance_transform_edt(~known, sampling=unlike, return_indices=True)
            growth = np.minimum(GROWTH * unlike.base * far, CEILING * spread)
            near = np.where(np.isfinite(sd), sd, np.nan)[tuple(nearest)]
            typical = float(np.sqrt(np.nanmean(sd**2))) if np.isfinite(sd).any() else 0.0
            near = np.where(np.isfinite(near), near, typical)
            sd[target] = np.sqrt(near**2 + growth)[target]


class _Unlikeness(tuple):
    """Mean squared differences of neighbours along (time, latitude, longitude), in units of ``base``, m2 s-2."""

    base: float = 0.0


def _unlikeness(parts: list[Array], reach: _Reach) -> _Unlikeness:
    """How much neighbours differ along each axis; where there are none to compare, by the reaches."""
    squares = []
    for axis in range(3):
        steps = [np.diff(part, axis=axis) ** 2 for part in parts]
        count = sum(int(np.isfinite(step).sum()) for step in steps)
        total = sum(float(np.nansum(step)) for step in steps)
        squares.append(total / count if count >= 10 else np.nan)
    space = [square for square in squares[1:] if np.isfinite(square)]
    base = float(np.mean(space)) if space else float("nan")
    if not base > 0:
        ratio = (reach.cells[0] / reach.frames, 1.0, reach.cells[0] / reach.cells[1])
        found = _Unlikeness(ratio)
        found.base = float(np.nanmean(squares)) if np.isfinite(squares).any() else 0.0
        return found
    filler = (np.mean(reach.cells) / reach.frames, 1.0, 1.0)
    # Bounded, so that a steady or a noisy record cannot cut an axis off.
    ratios = [square / base if np.isfinite(square) else other for square, other in zip(squares, filler, strict=True)]
    found = _Unlikeness(float(np.clip(ratio, 0.05, 50.0)) for ratio in ratios)
    found.base = base
    return found


def _distance(known: Array, sampling: tuple[float, float, float]) -> Array:
    """Distance of every cell from the nearest known one in scaled steps."""
    return distance_transform_edt(~known, sampling=sampling)


def _mean_flow(part: Array) -> Array:
    """Mean of the known values of each frame (frame, 1, 1), interpolated to frames without any."""
    count = np.isfinite(part).sum(axis=(1, 2))
    mean = np.nansum(part, axis=(1, 2)) / np.maximum(count, 1)
    some = np.flatnonzero(count)
    return np.interp(np.arange(count.size), some, mean[some])[:, None, None]


def _linear_in_time(
    part: Array, target: Array, reach: _Reach, unlike: _Unlikeness, spread: float, *, always: bool
) -> None:
    """Fill targets between two known frames within reach linearly, in place, where time is the better guide.

    Between two frames the error variance expected is that of a bridge, a (n - a) / n frames' worth, and from space
    that of the nearest known cell of the frame.
    """
    known = np.isfinite(part)
    count = part.shape[0]
    index = np.arange(count)[:, None, None]
    before = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, index, count)[::-1], axis=0)[::-1]
    frame, j, i = np.nonzero(target & (before >= 0) & (after < count))
    first, last = before[frame, j, i], after[frame, j, i]
    clock = reach.clock
    width, since = clock[last] - clock[first], clock[frame] - clock[first]
    use = width <= reach.frames * (1.0 if always else 2.0)
    if not always:
        bridge = unlike.base * unlike[0] * since * (width - since) / np.maximum(width, 1e-9)
        # Frames are put so far apart that the distance is to the nearest cell of the same frame.
        far = distance_transform_edt(~known, sampling=(1e6, 1.0, 1.0))[frame, j, i]
        use &= (2.0 * bridge < GROWTH * unlike.base * far) & (bridge < 0.5 * spread)
    frame, j, i, first, last, share = (a[use] for a in (frame, j, i, first, last, since / np.maximum(width, 1e-9)))
    part[frame, j, i] = (1 - share) * part[first, j, i] + share * part[last, j, i]


def _relax(
    part: Array, target: Array, mean: Array, links: tuple[float, float, float], screen: float, clock: Array
) -> None:
    """Solve the screened membrane on the targets, in place.

    At every target: sum over neighbours of link * (u_neighbour - u) = (u - mean) / screen**2. Cells that are
    neither known nor targets do not take part. A link in time weakens with the interval.
    """
    todo = np.flatnonzero(target)
    if todo.size == 0:
        return
    taking = (target | np.isfinite(part)).ravel()
    offset = np.where(np.isfinite(part), part - mean, 0.0).ravel()
    number = np.full(part.size, -1)
    number[todo] = np.arange(todo.size)
    cells = np.arange(part.size).reshape(part.shape)
    diagonal = np.full(todo.size, 1.0 / screen**2)
    right = np.zeros(todo.size)
    rows, columns, values = [], [], []
    for axis, link in enumerate(links):
        if link == 0.0 or part.shape[axis] < 2:
            continue
        low = np.take(cells, np.arange(part.shape[axis] - 1), axis=axis).ravel()
        high = np.take(cells, np.arange(1, part.shape[axis]), axis=axis).ravel()
        strength = np.full(low.size, link)
        if axis == 0:
            strength = np.repeat(link / np.maximum(np.diff(clock), 1e-3), cells[0].size)
        for one, other in ((low, high), (high, low)):
            use = (number[one] >= 0) & taking[other]
            row, neighbour, weight = number[one[use]], other[use], strength[use]
            diagonal += np.bincount(row, weights=weight, minlength=todo.size)
            given = number[neighbour] < 0
            right += np.bincount(row[given], weights=(weight * offset[neighbour])[given], minlength=todo.size)
            rows.append(row[~given])
            columns.append(number[neighbour[~given]])
            values.append(-weight[~given])
    shape = (todo.size, todo.size)
    matrix = diags_array(diagonal, format="csr")
    if rows:
        entries = (np.concatenate(rows), np.concatenate(columns))
        matrix = matrix + coo_array((np.concatenate(values), entries), shape=shape).tocsr()
    solution, _ = cg(matrix, right, rtol=1e-4, maxiter=500, M=diags_array(1.0 / diagonal, format="csr"))
    part.ravel()[todo] = solution + np.broadcast_to(mean, part.shape).ravel()[todo]


def _report(
    grid: CurrentGrid,
    fields: tuple[Array, Array],
    sds: list[Array | None],
    before: Array,
    known: Array,
    below: Array,
    method: str,
    max_distance: float,
    max_hours: float,
) -> CurrentGrid:
    """The filled grid with its share and notes."""
    gained = int((known & ~before & ~below).sum())
    total = int((known & ~below).sum())
    share = gained / total if total else 0.0
    how = f"{METHODS[method]}, within {max_distance / 1e3:g} km and {max_hours:g} h of a known value"
    notes = []
    if gained:
        notes.append(f"gaps: {share:.1%} of the currents were filled: {how}.")
    if below.any():
        notes.append(f"gaps: {below.mean():.1%} of the grid is below known levels and repeats the value above.")
    rest = int((~known).sum())
    if grid.sea is not None:
        rest = int((~known & np.asarray(grid.sea, bool)).sum())
    if rest:
        what = "land or too far from known values" if grid.sea is None else "too far from known values"
        notes.append(f"gaps: {rest / known.size:.1%} of the grid stays without a current: {what}.")
    return replace(
        grid,
        east=fields[0],
        north=fields[1],
        east_sd=sds[0],
        north_sd=sds[1],
        filled=share,
        fill_method=how if gained else "none",
        source=replace(grid.source, notes=grid.source.notes + tuple(notes)),
    )
