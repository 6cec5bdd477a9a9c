"""Temperature and salinity against depth, from model fields or from what a glider measured, as one profile.

NumPy only. A newcomer would get wrong: models store potential temperature and practical salinity, a
glider in-situ temperature and conductivity; a :class:`~glider_jax.records.WaterProfile` holds conservative
temperature and absolute salinity, and :mod:`~glider_jax.readers.teos` turns one into the other.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers import teos
from glider_jax.readers.grids import epoch_seconds
from glider_jax.readers.hydrography_fields import MeanProfile, is_inside, kind_of, level_means, roms_means
from glider_jax.readers.roms_grid import Box
from glider_jax.records import Array, Recording, Source, WaterProfile

Period = tuple[object, object]

PLAUSIBLE = ((-2.5, 40.0), (2.0, 42.0))  # degC and practical salinity; values outside are left out
EDGES = np.concatenate([np.arange(0, 50, 2), np.arange(50, 200, 5), np.arange(200, 500, 10), np.arange(500, 6001, 25)])
FEWEST = 3  # samples that make a depth interval of a recording


def read_water_profile(
    paths: str | Path | Sequence[str | Path],
    *,
    box: Box | None = None,
    period: Period | None = None,
    grid: str | Path | None = None,
) -> WaterProfile:
    """Read one mean profile of temperature and salinity.

    Parameters
    ----------
    paths : native ROMS files, CF files on fixed depths (temperature and salinity may be in different ones), or a
        glider's recording in any format that ``read_recording`` knows.
    box : (lat0, lat1, lon0, lon1), degrees; None for everywhere.
    period : (t0, t1), seconds since 1970, datetimes or ISO strings; None for all times.
    grid : the grid or parameter file of a ROMS run.

    Returns
    -------
    Depth (m), conservative temperature (degC) and absolute salinity (g kg-1): means over place and time of a model,
    medians in intervals of depth of a recording, which spikes do not move.

    Raises
    ------
    DataError : temperature or salinity is missing, or no value is left.
    CoverageError : there is nothing in the box or the period.
    """
    listed = [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]
    if not listed:
        raise DataError("profile: expected at least one path, found none. Name a file.")
    times = None if period is None else tuple(sorted(epoch_seconds(moment) for moment in period))
    kinds = {kind_of(path) for path in listed} | ({"roms"} if grid is not None else set())
    if "roms" in kinds:
        return _to_profile(*roms_means(listed, grid, box, times), [])
    if kinds == {"levels"}:
        return _to_profile(*level_means(listed, box, times), [])
    from glider_jax.readers.recordings import read_recording

    return profile_from_recording(read_recording(listed), box=box, period=period)


def _to_profile(mean: MeanProfile, source: Source, notes: list[str]) -> WaterProfile:
    """Means as stored, turned into the variables of TEOS-10; levels without both are left out."""
    good = np.isfinite(mean.temperature) & np.isfinite(mean.salinity)
    for values, (low, high) in zip((mean.temperature, mean.salinity), PLAUSIBLE, strict=True):
        good &= (values >= low) & (values <= high)
    if not good.any():
        raise DataError(
            f"{', '.join(Path(name).name for name in source.files)}: expected temperatures of {PLAUSIBLE[0][0]:g} to "
            f"{PLAUSIBLE[0][1]:g} degC and salinities of {PLAUSIBLE[1][0]:g} to {PLAUSIBLE[1][1]:g}, found none. "
            "Check the units, the box and the period."
        )
    depth, temperature, salinity = mean.depth[good], mean.temperature[good], mean.salinity[good]
    latitude = mean.latitude if np.isfinite(mean.latitude) else 45.0
    pressure = teos.pressure_from_depth(depth, latitude)
    if mean.salinity_kind == "practical":
        salinity, how = teos.absolute_salinity(salinity, pressure, mean.longitude, mean.latitude)
        notes.append(how)
    if mean.temperature_kind == "in situ":
        temperature = teos.potential_temperature(salinity, temperature, pressure)
    if mean.temperature_kind != "conservative":
        temperature = teos.conservative_temperature(salinity, temperature)
    notes.append(f"temperature was taken as {mean.temperature_kind}, salinity as {mean.salinity_kind}.")
    return WaterProfile(depth, temperature, salinity, Source(source.product, source.files, (*source.notes, *notes)))


def profile_from_recording(
    recording: Recording, *, box: Box | None = None, period: Period | None = None
) -> WaterProfile:
    """Median profile of what a glider's CTD measured.

    Parameters
    ----------
    recording : with ``temperature`` (K), ``conductivity`` (S m-1) or a ``salinity``, and ``ctd_pressure`` (Pa),
        ``pressure`` (Pa) or ``depth`` (m).
    box, period : rows to use; positions are interpolated in time.

    Raises
    ------
    DataError : a channel is missing, or fewer than three good samples share any interval of depth.
    """
    name = recording.name
    notes: list[str] = []
    if "temperature" not in recording:
        raise DataError(f"{name}: expected channel 'temperature', found none. Name the science files as well.")
    temperature = recording["temperature"] - 273.15
    rows = np.isfinite(temperature) & (np.abs(temperature) > 1e-9)  # 0 degC exactly is a sensor that is off
    latitude, longitude = (_along(recording, key) for key in ("latitude", "longitude"))
    if box is not None:
        rows &= is_inside(latitude, longitude, box)
    if period is not None:
        start, end = sorted(epoch_seconds(moment) for moment in period)
        rows &= (recording.time >= start) & (recording.time <= end)
    if not rows.any():
        raise CoverageError(f"{name}: expected temperatures in the box and period, found none. Widen them.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # no position at all is told below
        middle = (float(np.nanmean(latitude[rows])), float(np.nanmean(longitude[rows])))
    if not np.isfinite(middle).all():
        notes.append("no position: depth was worked out for 45 N.")
    here = middle[0] if np.isfinite(middle[0]) else 45.0
    depth, pressure = _depth_of(recording, here)
    temperature, depth, pressure = temperature[rows], depth[rows], pressure[rows]
    salinity = _salinity_of(recording, rows, temperature, pressure)
    good = np.isfinite(depth) & np.isfinite(salinity) & (depth >= 0)
    for values, (low, high) in zip((temperature, salinity), PLAUSIBLE, strict=True):
        good &= (values >= low) & (values <= high)
    left = int((~good).sum())
    if left:
        notes.append(f"{left} of {good.size} samples without depth or with implausible values were left out.")
    bins = np.digitize(depth[good], EDGES) - 1
    used = [number for number in np.unique(bins) if (bins == number).sum() >= FEWEST]
    if not used:
        raise DataError(
            f"{name}: expected at least {FEWEST} good samples of temperature, salinity and depth within some 2 m of "
            f"depth, found {int(good.sum())} in all. Name more files, or widen the box and the period."
        )
    columns = (depth[good], temperature[good], salinity[good])
    medians = [np.array([np.median(column[bins == number]) for number in used]) for column in columns]
    mean = MeanProfile(*medians, "in situ", "practical", *middle)
    return _to_profile(mean, Source("glider profile", recording.source.files), notes)


def _along(recording: Recording, key: str) -> Array:
    """Position interpolated to every row, from dead reckoning or from fixes; NaN where there is none."""
    for name in (key, f"gps_{key}"):
        if name in recording:
            known = np.isfinite(recording[name])
            if known.any():
                return np.interp(recording.time, recording.time[known], recording[name][known])
    return np.full(recording.time.size, np.nan)


def _depth_of(recording: Recording, latitude: float) -> tuple[Array, Array]:
    """Depth (m) and sea pressure (dbar) at every row; the CTD's own pressure sensor comes first."""
    for name in ("ctd_pressure", "pressure"):
        if name in recording and np.isfinite(recording[name]).any():
            pressure = recording[name] * 1e-4
            if name == "pressure":
                known = np.isfinite(pressure)
                pressure = np.interp(recording.time, recording.time[known], pressure[known])
            return teos.depth_from_pressure(pressure, latitude), pressure
    if "depth" in recording and np.isfinite(recording["depth"]).any():
        known = np.isfinite(recording["depth"])
        depth = np.interp(recording.time, recording.time[known], recording["depth"][known])
        return depth, teos.pressure_from_depth(depth, latitude)
    raise DataError(
        f"{recording.name}: expected one of the channels ctd_pressure, pressure, depth, found none. "
        "Name the files that hold them."
    )


def _salinity_of(recording: Recording, rows: Array, temperature: Array, pressure: Array) -> Array:
    """Practical salinity of the chosen rows, from conductivity or as recorded."""
    if "conductivity" in recording and np.isfinite(recording["conductivity"][rows]).any():
        return teos.practical_salinity(recording["conductivity"][rows], temperature, pressure)
    for name in ("salinity", "practical_salinity", "PSAL"):
        if name in recording and np.isfinite(recording[name][rows]).any():
            return recording[name][rows]
    raise DataError(
        f"{recording.name}: expected channel 'conductivity' or 'salinity' beside the temperature, found neither. "
        "Name the science files as well."
    )
