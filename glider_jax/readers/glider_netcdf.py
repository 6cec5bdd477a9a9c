"""Glider netCDF files: native Slocum sensors, pyglider time series, OG1.0, and IOOS NGDAC profiles.

NumPy and netCDF4 only. Conventions a newcomer would get wrong: a native file may hold NMEA positions under
the unit ``lat``; products seldom hold GPS fixes, so their positions are interpolated; a pyglider heading
comes from the compass and is magnetic; pyglider may name degrees for angles that are radians."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.calendars import decode_time
from glider_jax.readers.repairs import Table
from glider_jax.records import Array

#: Variable names of products, lower case -> our channel. Native names are matched before these.
PRODUCT_NAMES = {
    "latitude": "latitude",
    "longitude": "longitude",
    "lat": "latitude",
    "lon": "longitude",
    "latitude_gps": "gps_latitude",
    "longitude_gps": "gps_longitude",
    "gps_latitude": "gps_latitude",
    "gps_longitude": "gps_longitude",
    "waypoint_latitude": "waypoint_latitude",
    "waypoint_longitude": "waypoint_longitude",
    "depth": "depth",
    "depth_glider": "depth",
    "pressure": "ctd_pressure",
    "pres": "ctd_pressure",
    "temperature": "temperature",
    "temp": "temperature",
    "conductivity": "conductivity",
    "cndc": "conductivity",
    "pitch": "pitch",
    "roll": "roll",
    "heading": "heading",
    "altitude": "altitude",
    "water_depth": "water_depth",
    "bathymetry": "water_depth",
    "phase": "phase",
    "battery_voltage": "battery_voltage",
    "u": "depth_averaged_current_east",
    "v": "depth_averaged_current_north",
    "watercurrents_u": "depth_averaged_current_east",
    "watercurrents_v": "depth_averaged_current_north",
    "water_velocity_eastward": "depth_averaged_current_east",
    "water_velocity_northward": "depth_averaged_current_north",
}
#: Depth-averaged currents that a producer copied from the glider without turning them are in its local frame.
_LOCAL = {"m_final_water_vx": "final_water_vx", "m_final_water_vy": "final_water_vy"}
_LOCAL |= {"m_water_vx": "water_vx", "m_water_vy": "water_vy"}
_NATIVE = ("m_", "sci_", "c_", "x_", "u_", "f_", "cc_")
#: QC flags of IODE and QARTOD that say bad or missing.
_BAD_FLAGS = (4.0, 9.0)


def read_netcdf(path: Path, known: Iterable[str]) -> list[Table]:
    """Read one netCDF file of any kind above into a table per time axis.

    Parameters
    ----------
    path : the file.
    known : our channel names, which a file may also use as its own.

    Raises
    ------
    DataError : the file cannot be opened, has no time axis, or nothing in it is known.
    """
    try:
        data = netCDF4.Dataset(str(path))
    except OSError as problem:
        raise DataError(f"{path}: expected a netCDF file, found one that does not open ({problem}).") from problem
    with data:
        names = set(data.variables)
        native = {n for n in names if n.startswith(_NATIVE)}
        if {"m_present_time", "m_depth", "m_gps_lat", "m_lat", "sci_water_temp"} & native:
            return _native(path, data)
        return _product(path, data, set(known))


def _native(path: Path, data: netCDF4.Dataset) -> list[Table]:
    """Tables of a file of native sensors, one per dimension that has a clock."""
    segments, starts, missions = _segments(data)
    tables = []
    text = " ".join(str(getattr(data, name)) for name in data.ncattrs())
    facts = {"product": "netCDF of native Slocum sensors", "source": text}
    for dim in data.dimensions:
        clock = next(
            (c for c in ("time", "m_present_time", "sci_time", "sci_m_present_time") if _along(data, c, dim)),
            None,
        )
        if clock is None:
            continue
        time, notes = _time(path, data.variables[clock])
        columns = {n: _values(v) for n, v in data.variables.items() if _numeric(v, dim) and n != clock}
        columns = {n: v for n, v in columns.items() if n not in ("m_present_time", "segment", "sci_segment")}
        units = {n: str(getattr(data.variables[n], "units", "")) for n in columns}
        science = clock.startswith("sci")
        mine = ((), (), ()) if science else (segments, starts, missions)
        tables.append(Table(path.name, "science" if science else "flight", time, columns, units, *mine, facts, notes))
    if not tables:
        raise DataError(
            f"{path}: expected a time axis (time, m_present_time or sci_m_present_time), found the variables "
            f"{_listing(data)}. Convert the file again with its time."
        )
    return tables


def _segments(data: netCDF4.Dataset) -> tuple[tuple[str, ...], tuple[float, ...], tuple[str, ...]]:
    """Names, start times and missions of the glider's files, from a JSON list in the attribute
    ``segments``."""
    try:
        listed = json.loads(str(getattr(data, "segments", "")))
        rows = sorted((float(s["t0"]), str(s["file"]), str(s.get("mission", ""))) for s in listed)
    except (ValueError, KeyError, TypeError, AttributeError):
        return (), (), ()
    return (
        tuple(r[1] for r in rows),
        tuple(r[0] for r in rows),
        tuple(dict.fromkeys(r[2] for r in rows if r[2])),
    )


def _product(path: Path, data: netCDF4.Dataset, known: set[str]) -> list[Table]:
    """Tables of a processed product: its time series, its GPS fixes and its depth-averaged current."""
    kind = _kind(data)
    tables: list[Table] = []
    notes: list[str] = []
    clocks = [n for n, v in data.variables.items() if "since" in str(getattr(v, "units", "")) and v.ndim <= 1]
    main = [c for c in clocks if c.lower() in ("time", "juld")] + [c for c in clocks if c.lower() != "time"]
    if not main:
        raise DataError(
            f"{path}: expected a recording with a variable 'time' or 'TIME' in units '... since ...', found the "
            f"variables {_listing(data)}. Give a native, pyglider, OG1.0 or NGDAC file."
        )
    clock = data.variables[main[0]]
    dim = clock.dimensions[0] if clock.ndim else ""
    time, said = _time(path, clock)
    columns, units, facts = _columns(data, dim, known, notes)
    facts |= {"product": kind, "source": "decimal degrees"}
    if not columns:
        raise DataError(
            f"{path}: expected variables such as latitude, depth, pitch or temperature along '{dim}', found "
            f"{_listing(data)}. Give a native, pyglider, OG1.0 or NGDAC file."
        )
    label = path.name
    tables.append(Table(label, "product", time, columns, units, (path.stem,), (), (), facts, (*said, *notes)))
    for other in clocks:
        var = data.variables[other]
        if var.ndim == 1 and var.dimensions[0] != dim and "gps" in other.lower():
            moments, said = _time(path, var)
            fixes, units, _ = _columns(data, var.dimensions[0], known, notes)
            tables.append(Table(label, "fixes", moments, fixes, units, facts=facts, notes=said))
    scalar = next((c for c in clocks if c.lower() in ("time_uv", "profile_time_uv")), None)
    if scalar is not None:
        moments, said = _time(path, data.variables[scalar])
        found = {}
        for name in ("u", "v"):
            if name in data.variables and data.variables[name].size == moments.size:
                found[PRODUCT_NAMES[name]] = np.atleast_1d(_values(data.variables[name]))
        units = {PRODUCT_NAMES[n]: str(getattr(data.variables[n], "units", "m s-1")) for n in ("u", "v") if found}
        if found:
            tables.append(Table(label, "currents", moments, found, units, facts=facts, notes=said))
    return tables


def _kind(data: netCDF4.Dataset) -> str:
    """What made the file, for the user's eye."""
    conventions = str(getattr(data, "Conventions", ""))
    names = {n.lower() for n in data.variables}
    if "OG-1" in conventions or "n_measurements" in {d.lower() for d in data.dimensions}:
        return "OG1.0"
    if {"profile_id", "time_uv"} <= names or {"profile_id", "profile_lat"} <= names:
        return "IOOS NGDAC profile"
    if {"profile_index", "waypoint_latitude"} & names or "pyglider" in str(getattr(data, "history", "")).lower():
        return "pyglider"
    return "glider time series"


def _columns(
    data: netCDF4.Dataset, dim: str, known: set[str], notes: list[str]
) -> tuple[dict[str, Array], dict[str, str], dict[str, str]]:
    """Our channels along a dimension, with their units; what has no name of ours keeps its own."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    facts: dict[str, str] = {}
    for name, var in data.variables.items():
        if not _numeric(var, dim) or name.lower() in ("time", "juld") or name.lower().endswith("_qc"):
            continue
        key = PRODUCT_NAMES.get(name.lower(), name if name not in known else name)
        origin = str(getattr(var, "source", getattr(var, "sources", "")))
        key = _LOCAL.get(origin.split()[0], key) if key.startswith("depth_averaged") and origin else key
        values = _values(var)
        for suffix in ("_qc", "_QC"):
            flag = data.variables.get(name + suffix)
            if flag is not None and flag.shape == var.shape and flag.dtype.kind in "iuf":
                values = np.where(np.isin(_values(flag), _BAD_FLAGS), np.nan, values)
        if key in columns:
            continue
        columns[key] = values
        unit = str(getattr(var, "units", ""))
        units[key] = "" if unit.lower().startswith(("degrees_n", "degree_n", "degrees_e", "degree_e")) else unit
        if key == "heading":
            words = " ".join(str(getattr(var, a)) for a in var.ncattrs()).lower()
            true = "true" in words or "geographic" in words
            facts["heading_reference"] = "true" if true else "magnetic"
            if not true:
                notes.append("heading taken as magnetic: the file does not say, and a Slocum's compass is.")
    return columns, units, facts


def _along(data: netCDF4.Dataset, name: str, dim: str) -> bool:
    return name in data.variables and data.variables[name].dimensions == (dim,)


def _numeric(var: netCDF4.Variable, dim: str) -> bool:
    return var.dimensions == ((dim,) if dim else ()) and var.dtype != str and var.dtype.kind in "iuf"


def _values(var: netCDF4.Variable) -> Array:
    """Values as float64, NaN where masked."""
    return np.ma.filled(np.ma.asarray(var[...], dtype=float), np.nan)


def _time(path: Path, var: netCDF4.Variable) -> tuple[Array, tuple[str, ...]]:
    """Seconds since 1970; a native clock without a reference date is already that."""
    units = str(getattr(var, "units", "timestamp"))
    raw = np.atleast_1d(_values(var))
    words = units.lower().split()
    if units.lower() in ("timestamp", "s", "sec") or (words[:1] == ["seconds"] and words[2:3] and _epoch(words[2])):
        return raw, ()
    where = f"{path}: variable '{var.name}'"
    return decode_time(raw, units, getattr(var, "calendar", None), where=where)


def _epoch(word: str) -> bool:
    return word.startswith(("1970-01-01", "1970-1-1"))


def _listing(data: netCDF4.Dataset) -> str:
    names = sorted(data.variables)
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")
