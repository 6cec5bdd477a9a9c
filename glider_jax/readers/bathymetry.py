"""Water depth from files: which way is up, what is missing, and several grids joined.

The layouts live in ``bathymetry_grids`` (NetCDF) and ``bathymetry_text`` (text, zip, Matlab). A newcomer would get
wrong: half of the products store elevation (negative at sea) and half store depth, some under the other's name.
Attributes decide, then the name, then the values; what the values decided is noted, what cannot be decided is
refused. Only the part of a file inside ``box`` is read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from glider_jax.errors import DataError, did_you_mean
from glider_jax.readers import bathymetry_text
from glider_jax.readers.bathymetry_grids import (
    DOWN_NAMES,
    PLAIN_NAMES,
    UP_NAMES,
    Box,
    Raw,
    check_size,
    is_roms,
    open_netcdf,
    read_netcdf,
)
from glider_jax.readers.units import length_factor
from glider_jax.records import Array, BathymetryGrid, Source

KEYS = ("depth", "latitude", "longitude", "positive", "units")
DEEPEST = 12_000.0  # m; beyond the deepest trench and the highest mountain, so a fill that was not declared


def read_bathymetry(
    path: str | Path, *, box: Box | None = None, names: Mapping[str, str] | None = None
) -> BathymetryGrid:
    """Read the water depth on a regular longitude-latitude grid.

    Parameters
    ----------
    path : NetCDF (ETOPO, GEBCO, SRTM30+ and other ERDDAP grids, Coastal Relief, model bathymetry, ROMS grids), XYZ
        text with comma or blank between columns, ESRI ASCII grid, Matlab file, or a zip of one of these.
    box : (south, north, west, east) in degrees; one more cell is read on every side. None reads everything.
    names : where the file does not tell or tells wrongly: ``depth``, ``latitude``, ``longitude`` name variables,
        ``positive`` is ``up`` or ``down``, ``units`` the unit of the values.

    Returns
    -------
    Grid with ascending axes and ``depth`` (latitude, longitude) in m, positive down, negative on land, NaN where the
    file has a gap. ``source.notes`` says what was assumed or repaired.

    Raises
    ------
    DataError : the file cannot be read, has no such variable, or does not tell which way is up.
    CoverageError : the file does not reach into ``box``.
    """
    path, names = Path(path), dict(names or {})
    _check_names(names, path.name)
    if box is not None:
        south, north, west, east = box
        if not (np.isfinite(box).all() and south < north and west < east):
            raise DataError(f"box: expected (south, north, west, east) in degrees, found {tuple(box)}.")
    if not path.is_file():
        near = did_you_mean(path.name, (p.name for p in path.parent.glob("*"))) if path.parent.is_dir() else ""
        raise DataError(f"{path}: expected a bathymetry file, found none there.{near} Check the path.")
    with open(path, "rb") as stream:
        head = stream.read(512)
    kind = bathymetry_text.kind_of(head, path)
    if kind == "netcdf":
        with open_netcdf(path.name, path) as file:
            if is_roms(file) and "depth" not in names:
                from glider_jax.readers.roms import read_roms_bathymetry

                return _near_greenwich(read_roms_bathymetry(path, box=box), box)
            raw = read_netcdf(file, path.name, box, names)
    else:
        raw = bathymetry_text.read(kind, path, box, names)
    return _finish(raw, kind, path, box, names)


def merge_bathymetry(grids: Sequence[BathymetryGrid]) -> BathymetryGrid:
    """Join grids that touch or overlap, for example two volumes with a seam at 40 N.

    The result has the finest step of all and covers all of them; where several know the depth the first wins. A
    seam is closed up to one step of the grid beside it; farther outside all grids the depth is NaN.

    Raises
    ------
    DataError : there is nothing to join, or the grids are so far apart that the result would be too large.
    """
    if not grids:
        raise DataError("merge_bathymetry: expected at least one grid, found none.")
    axes = []
    for part in ("latitude", "longitude"):
        step = min(float(np.median(np.diff(getattr(g, part)))) for g in grids)
        low = min(float(getattr(g, part)[0]) for g in grids)
        high = max(float(getattr(g, part)[-1]) for g in grids)
        axes.append(low + step * np.arange(int(round((high - low) / step)) + 1))
    latitude, longitude = axes
    check_size("merge_bathymetry", (latitude.size, longitude.size))
    depth = np.full((latitude.size, longitude.size), np.nan)
    with_sd = all(g.sd is not None for g in grids)
    sd = np.full(depth.shape, np.nan) if with_sd else None
    for grid in grids:
        part = _resample(grid.depth, grid, latitude, longitude)
        missing = np.isnan(depth)
        depth = np.where(missing, part, depth)
        if sd is not None and grid.sd is not None:
            sd = np.where(missing, _resample(grid.sd, grid, latitude, longitude), sd)
    files = {name: digest for g in grids for name, digest in g.source.files.items()}
    notes = tuple(note for g in grids for note in g.source.notes) + (
        f"{len(grids)} grids joined; where they overlap the first one counts.",
    )
    return BathymetryGrid(latitude, longitude, depth, Source("merged bathymetry", files, notes), sd)


def _positive(raw: Raw, values: Array, where: str, names: Mapping[str, str]) -> str:
    """Which way the values grow, ``up`` or ``down``: from the user, attributes, the name, and last the values."""
    above, below = float(np.nanmax(values)), -float(np.nanmin(values))
    told = names.get("positive") or raw.declared
    if told:
        if not names.get("positive") and max(above, below) > 0 and (above if told == "down" else below) <= 0:
            raise DataError(
                f"{where}: expected water, found only land, {-below:g} to {above:g} m with the attributes' 'positive "
                f"{told}'. If the attributes are wrong give names={{'positive': '{_other(told)}'}}."
            )
        return told
    guess = "up" if raw.hint in UP_NAMES else "down" if raw.hint in DOWN_NAMES else ""
    both = above > 0 and below > 0
    if both and not guess and raw.hint not in ("", *PLAIN_NAMES):
        raise DataError(
            f"{where}: expected a hint whether values grow up or down, found neither attributes nor a known name and "
            f"values from {-below:g} to {above:g} m. Give names={{'positive': 'up'}} or 'down'."
        )
    if both:
        down_share = float(np.mean(values[np.isfinite(values)] > 0))
        if guess != "down" or down_share >= 0.5 or above > 3.0 * below:
            return guess or "up"
        if below > 3.0 * above:
            raw.notes.append(
                f"'{raw.name}' runs from {-below:g} to {above:g} m and is mostly negative: read as elevation."
            )
            return "up"
        raise DataError(
            f"{where}: expected depth positive down, found mostly negative values from {-below:g} to {above:g} m. "
            "Give names={'positive': 'up'} if negative is below the sea, or 'down' if this is mostly land."
        )
    wet = "up" if below > 0 else "down"
    if guess == "up" and wet == "down":
        raise DataError(
            f"{where}: expected water below zero, found only {-below:g} to {above:g} m. This is land, or depth: then "
            "give names={'positive': 'down'}."
        )
    if guess == "down" and wet == "up":
        raw.notes.append(f"'{raw.name}' is negative everywhere: read as elevation.")
    elif not guess and wet == "down":
        raw.notes.append(f"'{raw.name or 'z'}' is positive everywhere: read as depth.")
    return wet


def _other(way: str) -> str:
    return "up" if way == "down" else "down"


def _check_names(names: Mapping[str, str], where: str) -> None:
    for key in names:
        if key not in KEYS:
            raise DataError(f"{where}: names: expected {', '.join(KEYS)}, found '{key}'.{did_you_mean(key, KEYS)}")
    if names.get("positive", "up") not in ("up", "down"):
        raise DataError(f"{where}: names['positive']: expected 'up' or 'down', found '{names['positive']}'.")


def _finish(raw: Raw, kind: str, path: Path, box: Box | None, names: Mapping[str, str]) -> BathymetryGrid:
    where = f"{path.name}: variable '{raw.name}'" if raw.name else path.name
    values = raw.values * length_factor(names.get("units") or raw.units, where)
    strange = np.abs(values) > DEEPEST
    if strange.any():
        values = np.where(strange, np.nan, values)
        raw.notes.append(f"{int(strange.sum())} values beyond {DEEPEST:.0f} m were taken as missing.")
    if not np.isfinite(values).any():
        raise DataError(
            f"{where}: expected depths, found no finite value in the area asked for. "
            "Check the fill values, or ask for another area."
        )
    missing = int(np.isnan(values).sum())
    if missing:
        raw.notes.append(f"{missing} of {values.size} values are missing: land that was masked, or not surveyed.")
    for axis in (raw.latitude, raw.longitude):
        if not (np.diff(axis) > 0).all():
            raise DataError(f"{where}: expected each latitude and longitude once, found some twice. Regrid the file.")
    depth = -values if _positive(raw, values, where, names) == "up" else values
    if min(depth.shape) < 2:
        raise DataError(f"{where}: expected at least 2 x 2 values, found {depth.shape[0]} x {depth.shape[1]}.")
    if box is not None:
        reach = (raw.latitude[0], raw.latitude[-1], raw.longitude[0], raw.longitude[-1])
        if any((reach[0] > box[0], reach[1] < box[1], reach[2] > box[2], reach[3] < box[3])):
            raw.notes.append(
                f"The file covers {reach[0]:.2f} to {reach[1]:.2f} N, {reach[2]:.2f} to {reach[3]:.2f} E, "
                "which is less than the area asked for."
            )
    source = Source(f"bathymetry, {kind} file", {str(path): Source.digest(path)}, tuple(raw.notes))
    return BathymetryGrid(raw.latitude, raw.longitude, depth, source)


def _near_greenwich(grid: BathymetryGrid, box: Box | None) -> BathymetryGrid:
    """Bring longitudes into the convention of the box, or to start between -180 and 180."""
    west = -180.0 if box is None else box[2] - 180.0
    shift = 360.0 * np.floor((grid.longitude[0] - west) / 360.0)
    return replace(grid, longitude=grid.longitude - shift)


def _resample(values: Array, grid: BathymetryGrid, latitude: Array, longitude: Array) -> Array:
    """Bilinear values at new axes, held constant up to one step outside, NaN beyond."""
    parts = []
    for new, old in ((latitude, grid.latitude), (longitude, grid.longitude)):
        step = float(np.median(np.diff(old)))
        place = np.interp(new, old, np.arange(old.size, dtype=float))
        low = np.minimum(place.astype(int), old.size - 2)
        parts.append((low, place - low, (new > old[0] - step) & (new < old[-1] + step)))
    (j, fy, in_y), (i, fx, in_x) = parts
    out = np.zeros((latitude.size, longitude.size))
    for dj, wy in ((0, 1.0 - fy), (1, fy)):
        for di, wx in ((0, 1.0 - fx), (1, fx)):
            weight = wy[:, None] * wx
            # A corner without weight must not spread its NaN.
            out += np.where(weight > 1e-9, weight * values[np.ix_(j + dj, i + di)], 0.0)
    return np.where(in_y[:, None] & in_x, out, np.nan)
