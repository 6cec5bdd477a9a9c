"""Tidal currents: ellipses from ROMS tide forcing, the current at a time, and the tide added to a slow field.

NumPy and scipy only. A newcomer would get wrong: the phases of a forcing file count from its own reference time and
already hold the nodal factors and astronomic arguments of the date it was made for, so nothing of the sort is added
here; and the angle of an ellipse is from east, not from the grid's axes.

Notes
-----
The current that ROMS takes from such a file at time t, with omega = 2 pi / period, theta = omega (t - reference),
semi-major axis Cmax, semi-minor axis Cmin (positive: the current turns counter-clockwise), inclination Cangle from
east, counter-clockwise, and Cphase::

    east  = Cmax cos(Cangle) cos(theta - Cphase) - Cmin sin(Cangle) sin(theta - Cphase)
    north = Cmax sin(Cangle) cos(theta - Cphase) + Cmin cos(Cangle) sin(theta - Cphase)

It is the mean over depth. The reference is ``zero_phase_date``, in older files the ``base_date`` attribute, and in
files with neither the model's TIDE_START, which only its input script knows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.grids import (
    CurvilinearWeights,
    attribute,
    decode_time,
    epoch_seconds,
    iso,
    speed_factor,
    text_attribute,
)
from glider_jax.readers.roms_files import RomsFiles
from glider_jax.readers.roms_grid import Box, RegularTarget, read_horizontal
from glider_jax.records import Array, CurrentGrid, Source, TidalGrid

HOUR = 3600.0
PERIODS_H = {
    "M2": 12.4206012, "S2": 12.0, "N2": 12.65834751, "K2": 11.96723606, "K1": 23.93447213, "O1": 25.81933871,
    "P1": 24.06588766, "Q1": 26.868350, "M4": 6.210300601, "MS4": 6.103339275, "MN4": 6.269173724,
    "M6": 4.140200401, "S1": 24.0, "2N2": 12.90537297, "MU2": 12.8717576, "NU2": 12.62600509,
    "L2": 12.19162085, "T2": 12.01644934, "J1": 23.09848146, "OO1": 22.30608083, "M3": 8.280400802,
    "M8": 3.105150301, "MF": 327.8599387, "MM": 661.3111655, "MSF": 354.3670666, "SSA": 4383.076325,
    "SA": 8766.15265,
}  # fmt: skip
SAME_PERIOD = 3e-4  # relative; periods written with two decimals differ from the true ones by up to 2.3e-4
ELLIPSE = ("tide_Cmax", "tide_Cmin", "tide_Cangle", "tide_Cphase")


def from_ellipse(major: Array, minor: Array, inclination: Array, phase: Array) -> tuple[Array, Array]:
    """Complex east and north amplitudes of a tidal ellipse, for ``Re(amplitude * exp(-1j * theta))``.

    Parameters
    ----------
    major, minor : semi-axes, m s-1; ``minor`` is positive where the current turns counter-clockwise.
    inclination : rad from east to the major axis, counter-clockwise.
    phase : rad, theta at which the current runs along the major axis.
    """
    turn = np.exp(1j * np.asarray(phase))
    east = turn * (major * np.cos(inclination) - 1j * minor * np.sin(inclination))
    north = turn * (major * np.sin(inclination) + 1j * minor * np.cos(inclination))
    return east, north


def to_ellipse(east: Array, north: Array) -> tuple[Array, Array, Array, Array]:
    """Semi-major axis, signed semi-minor axis, inclination and phase of complex amplitudes.

    The inverse of :func:`from_ellipse`, with inclination in [0, pi) and phase in [0, 2 pi); ``minor`` is positive
    for counter-clockwise turning.
    """
    counter = 0.5 * (np.conj(east) + 1j * np.conj(north))  # turns with +theta
    clock = 0.5 * (east + 1j * north)  # turns with -theta
    major, minor = np.abs(counter) + np.abs(clock), np.abs(counter) - np.abs(clock)
    inclination = 0.5 * (np.angle(counter) + np.angle(clock))
    phase = 0.5 * (np.angle(clock) - np.angle(counter))
    turns = np.floor((inclination + 1e-12) / np.pi)  # rounding below 0 must not become pi
    inclination = np.maximum(inclination - np.pi * turns, 0.0)
    return major, minor, inclination, np.mod(phase - np.pi * turns, 2 * np.pi)


def read_tides(
    path: str | Path,
    *,
    grid: str | Path | None = None,
    box: Box | None = None,
    reference_time: object = None,
) -> TidalGrid:
    """Read tidal currents from a ROMS tide forcing file.

    Parameters
    ----------
    path : file with tide_period, tide_Cmax, tide_Cmin, tide_Cangle and tide_Cphase.
    grid : the model's grid file, for positions and the land mask where the tide file lacks them.
    box : (lat0, lat1, lon0, lon1), degrees; None for everything.
    reference_time : time of zero phase (seconds since 1970, datetime or ISO string) where the file names none.

    Returns
    -------
    Complex amplitudes on a regular grid, NaN on land and where the file holds no tide at all.

    Raises
    ------
    DataError : ellipses, positions or the reference time are missing.
    CoverageError : the file does not reach into the box.
    """
    with RomsFiles.open(path, grid) as files:
        file = files.fields[0]
        missing = [name for name in ("tide_period", *ELLIPSE) if file.shape(name) is None]
        if missing:
            only = " It holds elevations only." if file.shape("tide_Eamp") and len(missing) >= 4 else ""
            raise DataError(
                f"{file.name}: expected variables tide_period, {', '.join(ELLIPSE)}, found no {', no '.join(missing)}."
                f"{only} Name a ROMS tide forcing file with currents."
            )
        full = file.shape("tide_Cmax")[-2:]
        reference = _reference_time(files, reference_time)
        names, omega, kept = _constituents(files)
        block = read_horizontal(files, full, box, vector=False, need_mask=False)
        major, minor, inclination, phase = (
            file.values(name, (..., block.rows, block.columns))[kept] for name in ELLIPSE
        )
        units = text_attribute(file.data.variables["tide_Cmax"], "units")
        factor = speed_factor(units, f"{file.name}: variable 'tide_Cmax'") if units else 1.0
        amplitude = np.abs(np.nan_to_num(major)).max(axis=(1, 2))
        for name in np.array(names)[amplitude == 0]:
            files.note(f"{name} is zero everywhere and was dropped.")
        used = amplitude > 0
        if not used.any():
            raise DataError(f"{file.name}: expected tidal currents, found zero or nothing everywhere in the area.")
        east, north = from_ellipse(
            factor * major[used], factor * minor[used], np.radians(inclination[used]), np.radians(phase[used])
        )
        holds = np.isfinite(east + north).all(axis=0) & (np.abs(major[used]).max(axis=0) > 0)
        empty = int((block.sea & ~holds).sum())
        if files.holding("mask_rho", full) is None:
            files.note("mask_rho is in no file: points without any tide are taken as land.")
        elif empty:
            files.note(f"{empty} of {int(block.sea.sum())} points at sea hold no tide.")
        block = replace(block, sea=block.sea & holds)
        target = RegularTarget(block, box)
        files.note(target.note)
        files.note(
            f"phases count from {iso(reference)}; nodal factors are those of the file and fade within a year or two."
        )
        return TidalGrid(
            names=tuple(np.array(names)[used].tolist()),
            omega=omega[used],
            reference_time=reference,
            latitude=target.latitude,
            longitude=target.longitude,
            east=_apply(target.apply, east),
            north=_apply(target.apply, north),
            source=files.source("ROMS tide forcing"),
        )


def _apply(interpolate: Callable[[Array], Array], values: Array) -> Array:
    """Interpolate the real and imaginary parts of complex values."""
    return interpolate(values.real) + 1j * interpolate(values.imag)


def _reference_time(files: RomsFiles, given: object) -> float:
    """Time of zero phase: as given, else ``zero_phase_date``, else the ``base_date`` attribute."""
    if given is not None:
        return epoch_seconds(given)
    for file in files.all:
        variable = file.data.variables.get("zero_phase_date")
        if variable is not None:
            where = f"{file.name}: variable 'zero_phase_date'"
            units = attribute(variable, "units", "days as %Y%m%d.%f")
            seconds, _ = decode_time(np.ravel(variable[...]), units, where=where)
            return float(seconds[0])
        if "base_date" in file.data.ncattrs():
            units = str(file.data.getncattr("base_date"))
            seconds, _ = decode_time(np.zeros(1), units, where=f"{file.name}: attribute 'base_date'")
            return float(seconds[0])
    raise DataError(
        f"{files.names}: expected the time of zero phase as variable 'zero_phase_date' or attribute 'base_date', "
        "found neither. Give it as reference_time; the model's input script has it as TIDE_START."
    )


def _constituents(files: RomsFiles) -> tuple[list[str], Array, Array]:
    """Names and angular speeds (rad s-1) of the constituents, and the indices of those with a period."""
    file = files.fields[0]
    hours = file.values("tide_period").ravel()
    if text_attribute(file.data.variables["tide_period"], "units").lower().startswith("s"):
        hours = hours / HOUR
    kept = np.flatnonzero(np.isfinite(hours) & (hours > 0))
    if kept.size < hours.size:
        files.note(f"{hours.size - kept.size} constituents without a period were dropped.")
    names, periods = [], []
    for hour in hours[kept]:
        name, period = min(PERIODS_H.items(), key=lambda item: abs(item[1] / hour - 1))
        if abs(period / hour - 1) > SAME_PERIOD:
            name, period = f"T{hour:.4f}h", hour
        elif abs(period / hour - 1) > 1e-6:
            files.note(f"{name}: period {hour:g} h taken as {period:g} h, so that phases hold for long.")
        names.append(name)
        periods.append(period)
    return names, 2 * np.pi / (np.array(periods) * HOUR), kept


def tidal_currents(tides: TidalGrid, time: Array | float) -> tuple[Array, Array]:
    """Tidal current east and north at one time or several.

    Parameters
    ----------
    tides : the constituents.
    time : () or (t,) seconds since 1970.

    Returns
    -------
    Two arrays (latitude, longitude) or (t, latitude, longitude), m s-1, NaN on land.
    """
    turn = np.exp(-1j * np.multiply.outer(np.asarray(time, float) - tides.reference_time, tides.omega))
    return tuple(np.tensordot(turn, part, axes=(-1, 0)).real for part in (tides.east, tides.north))


def tidal_grid(tides: TidalGrid, time: Array) -> CurrentGrid:
    """The tide alone as a current field at the given times (t,), seconds since 1970; the same at every depth."""
    time = np.atleast_1d(np.asarray(time, float))
    east, north = tidal_currents(tides, time)
    return CurrentGrid(
        time=time,
        depth=np.zeros(1),
        latitude=tides.latitude,
        longitude=tides.longitude,
        east=east[:, None].astype(np.float32),
        north=north[:, None].astype(np.float32),
        source=replace(tides.source, product="tide"),
        sea=np.isfinite(tides.east).all(axis=0),
    )


def add_tides(currents: CurrentGrid, tides: TidalGrid, *, time: Array | None = None, step: float = HOUR) -> CurrentGrid:
    """Add the tide to currents without one, such as a daily climatology.

    Parameters
    ----------
    currents : the slow currents; between their times they are interpolated linearly.
    tides : constituents on any grid that overlaps; at sea points just outside the nearest tide is used.
    time : (t,) times wanted, seconds since 1970, ascending; None for evenly spaced ones from first to last time of
        ``currents``, or their own times where these are closer. Must be given for a single frame.
    step : s, largest spacing of the frames, 3600 by default so that a semi-diurnal tide is resolved.

    Returns
    -------
    Currents with the tide at every depth, on the grid of ``currents``.

    Raises
    ------
    CoverageError : the tide reaches no sea point of ``currents``, or ``time`` leaves its period.
    DataError : ``currents`` is a single frame and ``time`` is not given.
    """
    notes: list[str] = []
    wanted = _frames(currents, time, step, notes)
    sea = currents.sea if currents.sea is not None else np.isfinite(currents.east).any(axis=(0, 1))
    matched = _match(tides, currents, sea, notes)
    tide_east, tide_north = tidal_currents(matched, wanted)
    source = Source(
        f"{currents.source.product} with tide",
        {**currents.source.files, **tides.source.files},
        (*currents.source.notes, *tides.source.notes, *notes),
    )
    return replace(
        currents,
        time=wanted,
        east=_in_time(currents, currents.east, wanted, tide_east),
        north=_in_time(currents, currents.north, wanted, tide_north),
        east_sd=None if currents.east_sd is None else _in_time(currents, currents.east_sd, wanted),
        north_sd=None if currents.north_sd is None else _in_time(currents, currents.north_sd, wanted),
        source=source,
        constant_in_time=False,
    )


def _frames(currents: CurrentGrid, time: Array | None, step: float, notes: list[str]) -> Array:
    """Times of the sum; one frame of currents serves at any time, but its tide must not stand still."""
    first, last = currents.time[0], currents.time[-1]
    single = currents.constant_in_time or currents.time.size == 1
    if time is not None:
        wanted = np.atleast_1d(np.asarray(time, float))
        if not single and (wanted[0] < first or wanted[-1] > last):
            raise CoverageError(
                f"currents: expected times between {iso(wanted[0])} and {iso(wanted[-1])}, found {iso(first)} to "
                f"{iso(last)}. Read more files or ask for a shorter period."
            )
        if single:
            notes.append("one frame of currents was used at every time; the tide was added to it.")
        return wanted
    if single:
        raise DataError(
            "tides: expected currents at several times, or the times wanted, found one frame. "
            "Give the times, or more files of currents."
        )
    if np.median(np.diff(currents.time)) <= 1.01 * step:
        notes.append("the currents are as frequent as the tide's frames: check that they hold no tide already.")
        return currents.time
    count = int(np.ceil((last - first) / step - 1e-9))
    notes.append(f"tide added; currents interpolated in time to frames {(last - first) / count:.0f} s apart.")
    return np.linspace(first, last, count + 1)


def _in_time(currents: CurrentGrid, values: Array, wanted: Array, tide: Array | float = 0.0) -> Array:
    """Values (time, depth, lat, lon) at other times, linear in time, plus the tide (t, lat, lon)."""
    if currents.time.size == 1:
        index, share = np.zeros(wanted.size, int), np.zeros(wanted.size)
    else:
        index = np.clip(np.searchsorted(currents.time, wanted, side="right") - 1, 0, currents.time.size - 2)
        share = (wanted - currents.time[index]) / np.diff(currents.time)[index]
    after = np.minimum(index + 1, currents.time.size - 1)
    out = np.empty((wanted.size, *values.shape[1:]), values.dtype)
    tide = np.broadcast_to(tide, (wanted.size, *values.shape[2:]))
    for frame in range(wanted.size):
        # At a stored time the neighbour must not matter, not even where it is missing.
        out[frame] = values[index[frame] if share[frame] < 1 else after[frame]]
        if 0 < share[frame] < 1:
            out[frame] += share[frame] * (values[after[frame]] - values[index[frame]])
        out[frame] += tide[frame]
    return out


def _match(tides: TidalGrid, currents: CurrentGrid, sea: Array, notes: list[str]) -> TidalGrid:
    """The constituents on the grid of the currents; nearest value just outside, zero farther away."""
    lon, lat = np.meshgrid(tides.longitude, tides.latitude)
    known = np.isfinite(tides.east).all(axis=0) & np.isfinite(tides.north).all(axis=0)
    weights = CurvilinearWeights(lon, lat, known, currents.longitude, currents.latitude)
    east, north = _apply(weights.apply, tides.east), _apply(weights.apply, tides.north)
    lost = sea & ~np.isfinite(east + north).all(axis=0)
    middle = np.median(currents.longitude)
    scale = np.cos(np.radians(np.mean(currents.latitude)))
    offset = (lon[known] - middle + 180.0) % 360.0 - 180.0
    target = np.argwhere(lost)
    far = 0
    if target.size and known.any():
        step = max(np.diff(tides.longitude).max() * scale, np.diff(tides.latitude).max())
        here = np.stack([(currents.longitude[target[:, 1]] - middle) * scale, currents.latitude[target[:, 0]]], axis=1)
        distance, near = cKDTree(np.stack([offset * scale, lat[known]], axis=1)).query(here)
        close = distance <= 2.0 * step
        far = int((~close).sum())
        for part, original in ((east, tides.east), (north, tides.north)):
            part[:, target[:, 0], target[:, 1]] = np.where(close, original[:, known][:, near], 0.0)
    else:
        far = len(target)
    if far == int(sea.sum()):
        raise CoverageError(
            "tides: expected a grid that overlaps the currents, found none in common. Choose another tide file."
        )
    if far:
        notes.append(f"{far} of {int(sea.sum())} sea points lie beyond the tides and got none.")
    if len(target) > far:
        notes.append(f"{len(target) - far} of {int(sea.sum())} sea points got the tide of the nearest point with one.")
    return replace(tides, latitude=currents.latitude, longitude=currents.longitude, east=east, north=north)
