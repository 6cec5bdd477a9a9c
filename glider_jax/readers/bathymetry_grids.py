"""Bathymetry in NetCDF files and on their axes: which rows and columns lie in a box, and the values as stored.

NumPy and netCDF4. A newcomer would get wrong: longitudes come as 0 to 360 or -180 to 180, global grids repeat the
column at the antimeridian, latitudes may descend, and files of 7 GB must be read by slices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import CoverageError, DataError, did_you_mean
from glider_jax.readers.classic_netcdf import check_whole, check_whole_bytes
from glider_jax.readers.curvilinear import regrid_curvilinear, regular_axes
from glider_jax.records import Array

Box = tuple[float, float, float, float]

UP_NAMES = ("elevation", "topo", "topography", "altitude", "height", "surface_altitude", "bedrock_altitude")
DOWN_NAMES = (
    "depth", "sea_floor_depth", "bathymetry", "h", "deptho", "bathy", "bath", "water_depth", "seafloor_depth",
    "model_depth", "depthi",
)  # fmt: skip
PLAIN_NAMES = ("z", "band1", "value", "data")
LATITUDE_NAMES = ("lat", "latitude", "latc", "nav_lat", "y", "lati", "yc", "lat_rho", "ygrid")
LONGITUDE_NAMES = ("lon", "longitude", "lonc", "nav_lon", "x", "loni", "xc", "lon_rho", "xgrid")
LARGEST = 60_000_000  # values; half a gigabyte in memory


@dataclass
class Raw:
    """Values as stored, on ascending axes, with what the file says about them.

    ``declared`` is ``up``, ``down`` or empty where no attribute tells; ``hint`` is the name, or the word of an
    attribute, that suggests it; ``units`` is empty where the file does not tell.
    """

    latitude: Array
    longitude: Array
    values: Array
    name: str = ""
    declared: str = ""
    hint: str = ""
    units: str = ""
    notes: list[str] = field(default_factory=list)


def open_netcdf(where: str, source: Path | bytes) -> netCDF4.Dataset:
    """Open a NetCDF file from a path or from bytes, or say in one sentence why it cannot be."""
    if isinstance(source, bytes):
        check_whole_bytes(source, len(source), where)
    else:
        check_whole(source)
    try:
        if isinstance(source, bytes):
            return netCDF4.Dataset("inside.nc", memory=source)
        return netCDF4.Dataset(source)
    except (OSError, RuntimeError) as problem:
        raise DataError(
            f"{where}: expected a readable NetCDF file, found a damaged one ({problem}). Get it again."
        ) from problem


def is_roms(file: netCDF4.Dataset) -> bool:
    """Whether the file holds a ROMS grid, which ``readers.roms`` reads."""
    return "h" in file.variables and {"lon_rho", "lat_rho"} <= set(file.variables)


def read_netcdf(file: netCDF4.Dataset, where: str, box: Box | None, names: Mapping[str, str]) -> Raw:
    """Read the part of a NetCDF grid inside a box, values as stored but for packing and fills."""
    try:
        return _read_netcdf(file, where, box, names)
    except (OSError, RuntimeError) as problem:
        raise DataError(
            f"{where}: expected readable values, found a damaged file ({problem}). Get it again."
        ) from problem


def _read_netcdf(file: netCDF4.Dataset, where: str, box: Box | None, names: Mapping[str, str]) -> Raw:
    file.set_auto_maskandscale(False)
    if {"x_range", "y_range", "dimension", "z"} <= set(file.variables):
        return _read_gmt3(file, where, box)
    lat = file.variables[_axis(file, where, "latitude", LATITUDE_NAMES, names)]
    lon = file.variables[_axis(file, where, "longitude", LONGITUDE_NAMES, names)]
    latitude, longitude = np.asarray(lat[:], float), np.asarray(lon[:], float)
    check_degrees(latitude, longitude, f"{where}: '{lat.name}' and '{lon.name}'")
    name = _variable(file, where, lat, lon, names)
    variable = file.variables[name]
    wanted = lat.dimensions if lat.ndim == 2 else (lat.dimensions[0], lon.dimensions[0])
    dims = [d for d in variable.dimensions if d in wanted]
    if lat.ndim == 2:
        key = tuple(slice(None) if d in wanted else 0 for d in variable.dimensions)
        raw = curvilinear_raw(latitude, longitude, decode(variable, variable[key]), box, where)
    else:
        (rows, south_up), (columns, eastward) = select_rows(latitude, box), select_columns(longitude, box)
        covered(rows, columns, latitude, longitude, box, where)
        check_size(where, (rows.size, columns.size))
        values = _block(variable, {wanted[0]: rows, wanted[1]: columns})
        raw = Raw(south_up, eastward, values if dims == list(wanted) else values.T)
    return _describe(raw, variable)


def _describe(raw: Raw, variable: netCDF4.Variable) -> Raw:
    """Add what the attributes of a variable say of its sign and unit."""
    text = {key: str(getattr(variable, key, "")).strip().lower() for key in ("positive", "standard_name", "long_name")}
    raw.name, raw.units = variable.name, str(getattr(variable, "units", "")).strip()
    standard = text["standard_name"]
    if text["positive"] in ("up", "down"):
        raw.declared = text["positive"]
    elif standard.startswith("sea_floor_depth"):
        raw.declared = "down"
    elif standard.startswith(("height", "altitude", "surface_altitude", "bedrock_altitude")):
        raw.declared = "up"
    known = (*UP_NAMES, *DOWN_NAMES)
    words = [w for w in known if len(w) > 3 and w in text["long_name"]]
    raw.hint = next((n for n in (variable.name.lower(), standard, *words) if n in known), variable.name.lower())
    return raw


def _axis(file: netCDF4.Dataset, where: str, which: str, usual: tuple[str, ...], names: Mapping[str, str]) -> str:
    """Name of the coordinate variable, from the user, its standard name, its unit, or its own name."""
    if which in names:
        if names[which] not in file.variables:
            raise DataError(
                f"{where}: expected the {which} variable '{names[which]}', found {', '.join(file.variables)}."
                f"{did_you_mean(names[which], file.variables)} Correct names['{which}']."
            )
        return names[which]
    unit = "degrees_north" if which == "latitude" else "degrees_east"
    found = [v for v in file.variables.values() if v.ndim in (1, 2) and v.dtype != str and v.dtype.kind in "fiu"]
    for test in (
        lambda v: str(getattr(v, "standard_name", "")).strip().lower() == which,
        lambda v: str(getattr(v, "units", "")).strip().lower().replace("degree_", "degrees_") == unit,
        lambda v: v.name.lower() in usual,
    ):
        match = sorted((v for v in found if test(v)), key=lambda v: v.ndim)
        if match:
            return match[0].name
    raise DataError(
        f"{where}: expected a {which} variable, found {', '.join(file.variables) or 'no variable'}. "
        f"Name it with names={{'{which}': ...}}."
    )


def check_degrees(latitude: Array, longitude: Array, where: str) -> None:
    """Raise if positions cannot be degrees."""
    for values, limit in ((latitude, 90.001), (longitude, 720.0)):
        size = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else np.inf
        if size > limit:
            raise DataError(
                f"{where}: expected degrees, found values up to {size:g}. "
                "Reproject a grid in metres to longitude and latitude, or name the variables in degrees."
            )


def _variable(
    file: netCDF4.Dataset, where: str, lat: netCDF4.Variable, lon: netCDF4.Variable, names: Mapping[str, str]
) -> str:
    """Name of the variable that holds the seafloor."""
    wanted = set(lat.dimensions) | set(lon.dimensions)
    fits = [
        v
        for v in file.variables.values()
        if wanted <= set(v.dimensions)
        and v.name not in (lat.name, lon.name)
        and v.dtype != str
        and v.dtype.kind in "fiu"
        and all(len(file.dimensions[d]) == 1 for d in v.dimensions if d not in wanted)
    ]
    chosen = names.get("depth")
    if chosen is not None:
        if chosen not in [v.name for v in fits]:
            raise DataError(
                f"{where}: expected a variable '{chosen}' over latitude and longitude, found "
                f"{', '.join(v.name for v in fits) or 'none'}.{did_you_mean(chosen, [v.name for v in fits])}"
            )
        return chosen
    for test in (
        lambda v: str(getattr(v, "standard_name", "")).startswith(("sea_floor_depth", "altitude", "height")),
        lambda v: v.name.lower() in (*UP_NAMES, *DOWN_NAMES),
        lambda v: v.name.lower() in PLAIN_NAMES,
        lambda v: len(fits) == 1,
    ):
        match = [v.name for v in fits if test(v)]
        if match:
            return match[0]
    raise DataError(
        f"{where}: expected one variable with depth or elevation over latitude and longitude, found "
        f"{', '.join(v.name for v in fits) or 'none'}. Name it with names={{'depth': ...}}."
    )


def _block(variable: netCDF4.Variable, wanted: Mapping[str, Array]) -> Array:
    """Read some indices along two dimensions and the first along all others, in as few slices as there are runs."""
    order = [d for d in variable.dimensions if d in wanted]
    runs = []
    for dim in order:
        ascending = np.sort(wanted[dim])
        runs.append(np.split(ascending, np.flatnonzero(np.diff(ascending) > 1) + 1))

    def piece(first: Array, second: Array) -> Array:
        span = {order[0]: slice(first[0], first[-1] + 1), order[1]: slice(second[0], second[-1] + 1)}
        return np.asarray(variable[tuple(span.get(d, 0) for d in variable.dimensions)])

    raw = np.block([[piece(first, second) for second in runs[1]] for first in runs[0]])
    places = [np.searchsorted(np.sort(wanted[d]), wanted[d]) for d in order]
    return decode(variable, raw[np.ix_(*places)])


def decode(variable: netCDF4.Variable, raw: Array) -> Array:
    """Unpack stored values to float64, with NaN for fills and values outside the valid range."""
    raw = np.asarray(raw)
    default = netCDF4.default_fillvals.get(raw.dtype.str[1:])
    fills = [getattr(variable, key) for key in ("_FillValue", "missing_value") if hasattr(variable, key)] or [default]
    bad = np.zeros(raw.shape, bool)
    for fill in fills:
        if fill is not None:
            bad |= np.isin(raw, np.asarray(fill, float))
    scale, offset = float(getattr(variable, "scale_factor", 1.0)), float(getattr(variable, "add_offset", 0.0))
    values = raw.astype(float) * scale + offset
    low, high = getattr(variable, "valid_min", -np.inf), getattr(variable, "valid_max", np.inf)
    low, high = getattr(variable, "valid_range", (low, high))
    # The range is in packed values, unless it is a real number beside packed integers.
    stored = raw if np.asarray(low).dtype.kind in "iu" or (scale, offset) == (1.0, 0.0) else values
    bad |= (stored < low) | (stored > high)
    return np.where(bad, np.nan, values)


def _read_gmt3(file: netCDF4.Dataset, where: str, box: Box | None) -> Raw:
    """The older GMT layout: corners, counts and one long vector that starts in the north-west."""
    z = file.variables["z"]
    nx, ny = (int(n) for n in file.variables["dimension"][:])
    edges = [np.asarray(file.variables[name][:], float) for name in ("x_range", "y_range")]
    shift = 0.5 if int(getattr(z, "node_offset", getattr(file, "node_offset", 0))) else 0.0
    longitude, latitude = (
        low + (high - low) * (np.arange(n) + shift) / (n - 1 + 2 * shift)
        for (low, high), n in zip(edges, (nx, ny), strict=True)
    )
    if z.shape != (nx * ny,):
        raise DataError(f"{where}: variable 'z': expected {nx * ny} values, found {z.shape}. Get the file again.")
    check_degrees(latitude, longitude, where)
    (rows, lat), (columns, lon) = select_rows(latitude[::-1], box), select_columns(longitude, box)
    covered(rows, columns, latitude, longitude, box, where)
    check_size(where, (rows.size, nx))
    first, last = int(rows.min()), int(rows.max()) + 1
    block = decode(z, z[first * nx : last * nx]).reshape(last - first, nx)
    return _describe(Raw(lat, lon, block[np.ix_(rows - first, columns)]), z)


def check_size(where: str, shape: tuple[int, int]) -> None:
    """Raise if a grid would not fit into memory."""
    if shape[0] * shape[1] > LARGEST:
        raise DataError(
            f"{where}: expected at most {LARGEST:,} values, found {shape[0]} x {shape[1]}. Give a smaller box."
        )


def select_columns(longitude: Array, box: Box | None) -> tuple[Array, Array]:
    """Which columns to read and their longitudes, ascending, in the convention of ``box`` or around Greenwich.

    A column that appears twice (both -180 and 180) is taken once.
    """
    lon = np.unwrap(np.asarray(longitude, float), period=360.0)
    step = float(np.median(np.abs(np.diff(lon)))) if lon.size > 1 else 1.0
    if box is not None:
        low, high = box[2] - 1.01 * step, box[3] + 1.01 * step
        lon = low + (lon - low) % 360.0
    elif np.ptp(lon) > 360.0 - 1.5 * step:
        low, high = -180.0, 180.0
        lon = (lon + 180.0) % 360.0 - 180.0
    else:
        low, high = -np.inf, np.inf
        lon = lon - 360.0 * np.floor((lon.min() + 180.0) / 360.0)
    order = np.argsort(lon, kind="stable")
    order = order[lon[order] <= high]
    kept = lon[order]
    single = np.concatenate([[True], np.diff(kept) > 0.1 * step]) if kept.size else np.zeros(0, bool)
    return order[single], kept[single]


def select_rows(latitude: Array, box: Box | None) -> tuple[Array, Array]:
    """Which rows to read and their latitudes, ascending."""
    lat = np.asarray(latitude, float)
    order = np.argsort(lat, kind="stable")
    if box is not None:
        step = float(np.median(np.abs(np.diff(lat)))) if lat.size > 1 else 1.0
        order = order[(lat[order] >= box[0] - 1.01 * step) & (lat[order] <= box[1] + 1.01 * step)]
    return order, lat[order]


def covered(rows: Array, columns: Array, latitude: Array, longitude: Array, box: Box | None, where: str) -> None:
    """Raise if too little of a grid lies inside the box."""
    if box is not None and (rows.size < 2 or columns.size < 2):
        raise CoverageError(
            f"{where}: expected seafloor in {box[0]:g} to {box[1]:g} N, {box[2]:g} to {box[3]:g} E, found "
            f"{np.nanmin(latitude):.2f} to {np.nanmax(latitude):.2f} N, "
            f"{np.nanmin(longitude):.2f} to {np.nanmax(longitude):.2f} E. Use another file or area."
        )


def curvilinear_raw(raw_lat: Array, raw_lon: Array, values: Array, box: Box | None, where: str) -> Raw:
    """A grid with two-dimensional positions on regular axes of about its own spacing."""
    if not (raw_lat.shape == raw_lon.shape == values.shape):
        raise DataError(
            f"{where}: expected positions of shape {values.shape}, found {raw_lat.shape} and {raw_lon.shape}."
        )
    if np.ptp(raw_lat, axis=1).max() < 1e-6 and np.ptp(raw_lon, axis=0).max() < 1e-6:
        latitude, longitude = raw_lat[:, 0], raw_lon[0]
    elif np.ptp(raw_lat, axis=0).max() < 1e-6 and np.ptp(raw_lon, axis=1).max() < 1e-6:
        latitude, longitude, values = raw_lat[0], raw_lon[:, 0], values.T
    else:
        longitude, latitude = regular_axes(raw_lon, raw_lat)
        (rows, latitude), (columns, longitude) = select_rows(latitude, box), select_columns(longitude, box)
        covered(rows, columns, raw_lat, raw_lon, box, where)
        values = regrid_curvilinear(raw_lon, raw_lat, values, longitude, latitude)
        return Raw(latitude, longitude, values, notes=["A curvilinear grid was put on regular axes."])
    (rows, lat), (columns, lon) = select_rows(latitude, box), select_columns(longitude, box)
    covered(rows, columns, latitude, longitude, box, where)
    return Raw(lat, lon, values[np.ix_(rows, columns)])
