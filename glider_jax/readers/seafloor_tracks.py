"""A seafloor measured by gliders: water depths along tracks, gridded with their uncertainty.

NumPy and scipy. A newcomer would get wrong: soundings of one dive stand a few metres apart and share the errors of
tide, altimeter and position, so hundreds of them know little more than one; and away from the tracks nothing is
known, so the uncertainty must grow to that of the seafloor itself, not stay at the spread of the soundings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from glider_jax.errors import DataError
from glider_jax.records import Array, BathymetryGrid, Recording, Source

METRES = 111_195.0  # per degree of latitude, a sphere of the Earth's mean radius
TIDE_AND_ALTIMETER = 0.5  # m, 1-sigma floor of one sounding against mean sea level; judgement
NEIGHBOURS = 24  # soundings that decide one grid point
SCREEN_NEIGHBOURS = 15
SCREEN_SIGMAS, SCREEN_FLOOR, SCREEN_SLOPE = 6.0, 2.0, 0.05  # robust sigmas; m; share of the depth; judgement
MOST_FOR_FIT = 300  # soundings from which the correlation length is estimated
LARGEST = 4_000_000  # grid points

Sounding = tuple[Array, Array, Array]


@dataclass(frozen=True)
class _Prior:
    """What the seafloor does between soundings: mean and sd (m), correlation length (m), noise of a sounding (m)."""

    mean: float
    mean_sd: float
    sd: float
    length: float
    noise: float


def grid_seafloor(
    tracks: Sequence[Sounding], *, spacing: float, correlation_length: float | None = None,
    background: BathymetryGrid | None = None, margin: float | None = None, source: Source | None = None,
) -> BathymetryGrid:  # fmt: skip
    """Grid water depths measured along tracks by objective mapping.

    Parameters
    ----------
    tracks : (latitude, longitude, water depth) arrays of one or several gliders; degrees and m, positive down, NaN
        where there was no sounding.
    spacing : m between grid points, and the size of the cells in which soundings are averaged first.
    correlation_length : m over which the seafloor decorrelates by e; None estimates it by maximum likelihood.
    background : a coarser seafloor to fall back to; without one the estimate falls back to the tracks' mean depth.
    margin : m around the tracks; None takes three correlation lengths, at most 20 km.
    source : what the tracks came from.

    Returns
    -------
    Grid with ``depth`` and its 1-sigma ``sd`` (m): close to the noise of a sounding on the tracks, growing to the
    spread of the seafloor away from them. ``source.notes`` counts the false bottoms that were left out.

    Raises
    ------
    DataError : there are too few soundings, or the grid would be too large.

    Notes
    -----
    Simple kriging with covariance ``sd**2 exp(-d / length)`` from the nearest cells with soundings; see Bretherton,
    Davis and Fandry (1976), Deep-Sea Research 23, for the method.
    """
    if not spacing > 0.0:
        raise DataError(f"grid_seafloor: spacing: expected metres above zero, found {spacing:g}.")
    if correlation_length is not None and not correlation_length > 0.0:
        raise DataError(f"grid_seafloor: correlation_length: expected metres above zero, found {correlation_length:g}.")
    lat, lon, depth = _soundings(tracks)
    centre = (0.5 * (lat.min() + lat.max()), 0.5 * (lon.min() + lon.max()))
    east_degree = METRES * float(np.cos(np.radians(centre[0])))
    place = np.stack([(lon - centre[1]) * east_degree, (lat - centre[0]) * METRES], axis=1)
    good = screen_soundings(place, depth)
    notes = [f"{good.sum()} soundings gridded, {np.sum(~good)} false bottoms left out."]
    cells, mean_depth, spread = _average(place[good], depth[good], spacing)
    if len(mean_depth) < 3:
        raise DataError(
            f"grid_seafloor: expected soundings in at least 3 cells of {spacing:g} m, found {len(mean_depth)}. "
            "Use a finer spacing or a longer track."
        )
    known = np.zeros(len(mean_depth))
    if background is not None:
        known = interpolate(background, centre[0] + cells[:, 1] / METRES, centre[1] + cells[:, 0] / east_degree)
        outside = np.isnan(known)
        if outside.all():
            raise DataError(
                "grid_seafloor: expected a background below the tracks, found none there. Give one that covers them."
            )
        cells, mean_depth, spread, known = (part[~outside] for part in (cells, mean_depth, spread, known))
        if outside.any():
            notes.append(f"{outside.sum()} cells outside the background were left out.")
    prior = _fit_prior(cells, mean_depth - known, correlation_length, spacing, background is None)
    notes.append(
        f"Correlation length {prior.length:.0f} m, seafloor spread {prior.sd:.2f} m, "
        f"noise of a sounding {prior.noise:.2f} m."
    )
    reach = min(3.0 * prior.length, 20e3) if margin is None else margin
    x, y = (np.arange(cells[:, k].min() - reach, cells[:, k].max() + reach + spacing, spacing) for k in (0, 1))
    if x.size * y.size > LARGEST:
        raise DataError(
            f"grid_seafloor: expected at most {LARGEST:,} points, found {y.size} x {x.size}. Use a wider spacing."
        )
    latitude, longitude = centre[0] + y / METRES, centre[1] + x / east_degree
    target = np.stack([part.ravel() for part in np.meshgrid(x, y)], axis=1)
    estimate, sd = map_soundings(cells, mean_depth - known, spread, target, prior)
    estimate, sd = estimate.reshape(y.size, x.size), sd.reshape(y.size, x.size)
    if background is not None:
        at_lat, at_lon = np.meshgrid(latitude, longitude, indexing="ij")
        estimate = estimate + interpolate(background, at_lat, at_lon)
        sd = np.where(np.isnan(estimate), np.nan, sd)
    given = source or Source("tracks")
    made = Source("seafloor measured by gliders", dict(given.files), (*given.notes, *notes))
    return BathymetryGrid(latitude, longitude, estimate, made, sd)


def seafloor_from_recordings(
    recordings: Sequence[Recording], *, spacing: float = 500.0, correlation_length: float | None = None,
    background: BathymetryGrid | None = None,
) -> BathymetryGrid:  # fmt: skip
    """Grid the water depths that gliders recorded; see :func:`grid_seafloor`.

    Each recording needs ``latitude``, ``longitude`` and either ``water_depth`` or ``depth`` and ``altitude``.

    Raises
    ------
    DataError : no recording has soundings; the message says which channels were absent.
    """
    tracks, files, notes, lacking = [], {}, [], []
    for recording in recordings:
        found = _track(recording)
        if isinstance(found, str):
            lacking.append(f"{recording.name}: {found}")
            continue
        tracks.append(found)
        files.update(recording.source.files)
        notes.append(f"{recording.name}: {np.isfinite(found[2]).sum()} soundings.")
    if not tracks:
        raise DataError(
            "seafloor_from_recordings: expected a recording with soundings, found none "
            f"({'; '.join(lacking) or 'no recording'})."
            " The altimeter may have been off, or the water too deep for it."
        )
    notes += [f"Left out {sentence}." for sentence in lacking]
    source = Source("recordings", files, tuple(notes))
    return grid_seafloor(
        tracks, spacing=spacing, correlation_length=correlation_length, background=background, source=source
    )


def _track(recording: Recording) -> Sounding | str:
    """Positions and water depths of one recording, or what it lacks."""
    absent = [name for name in ("latitude", "longitude") if name not in recording]
    if absent:
        return f"no {' and no '.join(absent)}"
    if "water_depth" in recording:
        depth = np.array(recording["water_depth"], float)
    elif "depth" in recording and "altitude" in recording:
        depth = np.array(recording["altitude"], float)
        valid = np.isfinite(depth) & (depth > 0.0)
        below = np.isfinite(recording["depth"])
        if not (valid.any() and below.any()):
            return "no altitude"
        depth[~valid] = np.nan
        depth = depth + np.interp(recording.time, recording.time[below], recording["depth"][below])
    else:
        return "neither water_depth nor depth and altitude"
    depth[~(depth > 0.0)] = np.nan
    if not np.isfinite(depth).any():
        return "no sounding"
    positions = []
    for name in ("latitude", "longitude"):
        known = np.isfinite(recording[name])
        if known.sum() < 2:
            return f"no {name}"
        # Soundings and positions come in different cycles.
        positions.append(
            np.interp(recording.time, recording.time[known], recording[name][known], left=np.nan, right=np.nan)
        )
    return positions[0], positions[1], depth


def screen_soundings(place: Array, depth: Array) -> Array:
    """Which soundings agree with their surroundings; an altimeter also answers to fish, the surface and noise.

    Parameters
    ----------
    place : (n, 2) m. depth : (n,) m.

    Returns
    -------
    Mask (n,): within six robust standard deviations, 2 m plus 5 % of the depth at least, of the median of the
    nearest 15 soundings. Repeated until nothing more falls out.
    """
    good = np.ones(depth.size, bool)
    for _ in range(10):
        kept = np.flatnonzero(good)
        if kept.size < 5:
            break
        count = min(SCREEN_NEIGHBOURS, kept.size)
        _, near = cKDTree(place[kept]).query(place[kept], k=count)
        around = depth[kept][near]
        middle = np.median(around, axis=1)
        scatter = 1.4826 * np.median(np.abs(around - middle[:, None]), axis=1)
        limit = np.maximum(SCREEN_SIGMAS * scatter, SCREEN_FLOOR + SCREEN_SLOPE * middle)
        bad = np.abs(depth[kept] - middle) > limit
        if not bad.any():
            break
        good[kept[bad]] = False
    return good


def interpolate(grid: BathymetryGrid, latitude: Array, longitude: Array) -> Array:
    """Bilinear depth of a grid at points, NaN outside it; longitudes in either convention."""
    longitude = grid.longitude[0] + (np.asarray(longitude) - grid.longitude[0]) % 360.0
    parts = []
    for value, axis in ((latitude, grid.latitude), (longitude, grid.longitude)):
        at = np.interp(value, axis, np.arange(axis.size, dtype=float), left=np.nan, right=np.nan)
        inside = np.isfinite(at)
        low = np.clip(np.where(inside, at, 0.0).astype(int), 0, axis.size - 2)
        parts.append((low, np.where(inside, at - low, np.nan)))
    (j, fy), (i, fx) = parts
    d = grid.depth
    south = d[j, i] * (1.0 - fx) + d[j, i + 1] * fx
    north = d[j + 1, i] * (1.0 - fx) + d[j + 1, i + 1] * fx
    return south * (1.0 - fy) + north * fy


def map_soundings(cells: Array, values: Array, spread: Array, target: Array, prior: _Prior) -> tuple[Array, Array]:
    """Estimate and 1-sigma error (m,) at ``target`` (m, 2) from ``values`` (n,) at ``cells`` (n, 2); all metres."""
    tree = cKDTree(cells)
    count = min(NEIGHBOURS, len(values))
    estimate, sd = np.empty(len(target)), np.empty(len(target))
    variance = prior.sd**2
    for start in range(0, len(target), 4096):
        points = target[start : start + 4096]
        distance, near = tree.query(points, k=count)
        distance, near = distance.reshape(-1, count), near.reshape(-1, count)
        places = cells[near]
        apart = np.linalg.norm(places[:, :, None, :] - places[:, None, :, :], axis=-1)
        matrix = variance * np.exp(-apart / prior.length)
        matrix[:, np.arange(count), np.arange(count)] += prior.noise**2 + spread[near] ** 2
        towards = variance * np.exp(-distance / prior.length)
        weight = np.linalg.solve(matrix, towards[..., None])[..., 0]
        estimate[start : start + 4096] = prior.mean + np.sum(weight * (values[near] - prior.mean), axis=1)
        left = variance - np.sum(weight * towards, axis=1)
        from_mean = (1.0 - weight.sum(axis=1)) * prior.mean_sd
        sd[start : start + 4096] = np.sqrt(np.maximum(left, 0.0) + from_mean**2)
    return estimate, sd


def _soundings(tracks: Sequence[Sounding]) -> Sounding:
    """All finite soundings, longitudes next to each other."""
    parts = []
    for number, track in enumerate(tracks):
        lat, lon, depth = (np.asarray(part, float).ravel() for part in track)
        if not lat.size == lon.size == depth.size:
            raise DataError(
                f"grid_seafloor: track {number}: expected three arrays of one length, found {lat.size}, {lon.size} "
                f"and {depth.size}."
            )
        fine = np.isfinite(lat) & np.isfinite(lon) & (depth > 0.0) & (np.abs(lat) <= 90.0)
        parts.append((lat[fine], lon[fine], depth[fine]))
    lat, lon, depth = (np.concatenate([np.empty(0), *(part[k] for part in parts)]) for k in range(3))
    if lat.size < 3:
        raise DataError(
            f"grid_seafloor: expected at least 3 soundings, found {lat.size}. The altimeter may have been off."
        )
    return lat, lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0, depth


def _average(place: Array, depth: Array, spacing: float) -> Sounding:
    """Mean place (c, 2) and depth (c,) of each cell that holds soundings, and the standard error of the mean (c,)."""
    corner = np.floor((place - place.min(axis=0)) / spacing).astype(np.int64)
    _, cell = np.unique(corner, axis=0, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    mean = np.bincount(cell, depth) / count
    where = np.stack([np.bincount(cell, place[:, k]) / count for k in (0, 1)], axis=1)
    variance = np.bincount(cell, (depth - mean[cell]) ** 2) / np.maximum(count - 1, 1)
    return where, mean, np.sqrt(variance / count)


def _fit_prior(cells: Array, values: Array, length: float | None, spacing: float, free_mean: bool) -> _Prior:
    """Correlation length, spread and noise by maximum likelihood on a grid of the first and the ratio of the others."""
    step = max(1, -(-len(values) // MOST_FOR_FIT))
    places, z = cells[::step], values[::step]
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    extent = max(float(apart.max()), 2.0 * spacing)
    lengths = [length] if length is not None else np.geomspace(spacing, 2.0 * extent, 12)
    best, found = np.inf, _Prior(0.0, 0.0, TIDE_AND_ALTIMETER, spacing, TIDE_AND_ALTIMETER)
    for reach in lengths:
        shape = np.exp(-apart / reach)
        for share in np.geomspace(1e-4, 1.0, 9):
            factor = cho_factor(shape + share * np.eye(len(z)), lower=True)
            ones = cho_solve(factor, np.ones(len(z)))
            mean = float(ones @ z / ones.sum()) if free_mean else 0.0
            variance = float((z - mean) @ cho_solve(factor, z - mean)) / max(len(z) - free_mean, 1)
            # A perfectly flat floor still has the noise of its soundings.
            variance = max(variance, 1e-6)
            cost = len(z) * np.log(variance) + 2.0 * np.log(np.diag(factor[0])).sum() + free_mean * np.log(ones.sum())
            if cost < best:
                best = cost
                noise = max(np.sqrt(share * variance), TIDE_AND_ALTIMETER)
                mean_sd = float(np.sqrt(variance / ones.sum())) if free_mean else 0.0
                found = _Prior(mean, mean_sd, float(np.sqrt(variance)), float(reach), float(noise))
    return found
