"""How products of gridded currents lay out their files: which variables and axes they hold.

NumPy and netCDF4 only; :mod:`~glider_jax.readers.current_values` reads the numbers. A newcomer would get wrong: the
names of variables and dimensions are hints only, standard names and units decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import DataError, did_you_mean
from glider_jax.readers import grids
from glider_jax.records import Array

ORDER = ("time", "depth", "latitude", "longitude")
STANDARD_NAMES = (
    "eastward_sea_water_velocity",
    "surface_eastward_sea_water_velocity",
    "sea_water_x_velocity",
    "surface_sea_water_x_velocity",
    "eastward_sea_water_velocity_assuming_no_tide",
    "surface_geostrophic_eastward_sea_water_velocity",
)
PAIRS = {
    "uo": "vo",
    "water_u": "water_v",
    "u": "v",
    "u_eastward": "v_northward",
    "eastward_eulerian_current_velocity": "northward_eulerian_current_velocity",
    "ewct": "nsct",
    "utotal": "vtotal",
    "ucur": "vcur",
    "u_velocity": "v_velocity",
    "uvel": "vvel",
    "ssu": "ssv",
    "ugos": "vgos",
    "eastward_geostrophic_current_velocity": "northward_geostrophic_current_velocity",
    "vozocrtx": "vomecrty",
}
PRODUCTS = (
    # name shown, variables (lower case) that only this product holds together
    ("MARACOOS HF radar totals", {"u_err", "v_err", "uv_covariance"}),
    ("HFRNet RTV", {"dopx", "dopy"}),
    ("European HF radar totals", {"ewct", "nsct"}),
    ("Copernicus Marine", {"uo", "vo"}),
    ("HYCOM", {"water_u", "water_v"}),
    ("GlobCurrent", {"eastward_eulerian_current_velocity"}),
)
RADARS = ("MARACOOS HF radar totals", "HFRNet RTV", "European HF radar totals")
MODELS = ("Copernicus Marine", "HYCOM")
ROMS_DIMENSIONS = {"s_rho", "sc_r", "xi_rho", "eta_rho", "xi_u", "eta_u", "xrho", "erho", "xu", "eu"}


@dataclass
class Layout:
    """Where everything is in one file; axes are cut to the box and ascend."""

    path: Path
    product: str
    east: str
    north: str
    dims: tuple[str, ...]
    roles: dict[str, str]
    time: Array
    depth: Array
    latitude: Array
    longitude: Array
    timeless: bool = False
    pick: dict[str, Array] = field(default_factory=dict)
    weights: grids.CurvilinearWeights | None = None
    notes: list[str] = field(default_factory=list)


def is_roms(dataset: netCDF4.Dataset) -> bool:
    """Whether a file is on a native ROMS grid."""
    return bool({name.lower() for name in dataset.dimensions} & ROMS_DIMENSIONS)


def survey(path: Path, names: Mapping[str, str], box: tuple[float, float, float, float] | None) -> Layout:
    """Find velocities and coordinates in one file, and cut its axes to the box.

    Raises
    ------
    DataError : something is absent or laid out in a way that is not understood.
    CoverageError : the box lies outside of the grid.
    """
    where = path.name
    with grids.open_netcdf(path) as dataset:
        east, north, notes = _velocities(dataset, names, where)
        variable = dataset.variables[east]
        if dataset.variables[north].dimensions != variable.dimensions:
            raise DataError(
                f"{where}: variable '{north}': expected the dimensions of '{east}' {variable.dimensions}, "
                f"found {dataset.variables[north].dimensions}. Correct the file."
            )
        coordinates = _coordinates(dataset, variable, names, where)
        roles = _roles(dataset, variable, coordinates, where)
        held = {name.lower() for name in dataset.variables}
        product = next((label for label, mark in PRODUCTS if mark <= held), "gridded currents (CF)")
        time, timeless = _time(dataset, coordinates.get("time"), where, notes)
        depth, depth_order = _depth(dataset, coordinates.get("depth"), where, notes)
        layout = Layout(path, product, east, north, variable.dimensions, roles, time, depth, np.empty(0), np.empty(0))
        layout.timeless, layout.notes, layout.pick["depth"] = timeless, notes, depth_order
        lat = grids.read_coordinate(dataset, coordinates["latitude"], where)
        lon = grids.read_coordinate(dataset, coordinates["longitude"], where)
        lat, lon = _collapse(lat, lon)
        if lat.ndim == 2:
            _curvilinear(layout, dataset, lat, lon, box)
        else:
            _regular(layout, lat, lon, box, coordinates)
    return layout


def _velocities(dataset: netCDF4.Dataset, names: Mapping[str, str], where: str) -> tuple[str, str, list[str]]:
    """Names of the eastward and northward velocity variables, and notes on a choice made."""
    if "east" in names or "north" in names:
        if not ("east" in names and "north" in names):
            raise DataError(f"{where}: names: expected both 'east' and 'north', found only one. Give both.")
        chosen = [grids.require(dataset, names[key], where, f"{key}ward velocity") for key in ("east", "north")]
        return chosen[0], chosen[1], []
    fields = {n: v for n, v in dataset.variables.items() if v.ndim >= 2 and np.dtype(v.dtype).kind in "fiu"}
    lower = {name.lower(): name for name in fields}
    for standard in STANDARD_NAMES:
        found = [n for n, v in fields.items() if grids.text_attribute(v, "standard_name") == standard]
        other = standard.replace("eastward", "northward").replace("_x_", "_y_")
        partners = [n for n, v in fields.items() if grids.text_attribute(v, "standard_name") == other]
        known = [n for n in found if PAIRS.get(n.lower()) in {p.lower() for p in partners}]
        if known:
            first = min(known, key=lambda n: list(PAIRS).index(n.lower()))
            rest = [n for n in found if n != first]
            notes = [f"{where}: '{first}' was taken, {rest} ignored."] if rest else []
            return first, lower[PAIRS[first.lower()]], notes
        if len(found) == len(partners) == 1:
            return found[0], partners[0], []
        if found and partners:
            raise DataError(
                f"{where}: expected one variable with standard_name '{standard}', found {', '.join(found)}. "
                "Choose with names={'east': ..., 'north': ...}."
            )
    for first, second in PAIRS.items():
        if first in lower and second in lower:
            return lower[first], lower[second], []
    near = did_you_mean(next(iter(lower), ""), PAIRS)
    half = [n for n in (*PAIRS, *PAIRS.values()) if n in lower]
    if half:
        raise DataError(
            f"{where}: expected both components of the current, found only '{lower[half[0]]}' "
            f"among {', '.join(fields)}. Fetch both, or name them with names={{'east': ..., 'north': ...}}."
        )
    raise DataError(
        f"{where}: expected eastward and northward currents (for example uo and vo, u and v, water_u and water_v), "
        f"found the variables {', '.join(dataset.variables) or 'none'}.{near} "
        "Name them with names={'east': ..., 'north': ...}, or give another file."
    )


def _coordinates(
    dataset: netCDF4.Dataset, variable: netCDF4.Variable, names: Mapping[str, str], where: str
) -> dict[str, str]:
    """Names of the coordinate variables by kind; latitude and longitude are always there."""
    listed = str(grids.attribute(variable, "coordinates", "")).split()
    fits = [n for n, v in dataset.variables.items() if v.ndim and set(v.dimensions) <= set(variable.dimensions)]
    scalars = [n for n, v in dataset.variables.items() if v.ndim == 0]
    among = list(dict.fromkeys([*variable.dimensions, *listed, *(n for n in fits if n != variable.name), *scalars]))
    found: dict[str, str] = {}
    for kind in ORDER:
        name = grids.find_coordinate(dataset, kind, among=among, names=names, where=where)
        if name is not None:
            found[kind] = name
    for kind in ("latitude", "longitude"):
        if kind not in found:
            raise DataError(
                f"{where}: expected a {kind} coordinate for '{variable.name}' {variable.dimensions}, found none "
                f"among {', '.join(among) or 'no variables'}. Name it with names={{'{kind}': ...}}."
            )
    return found


def _roles(
    dataset: netCDF4.Dataset, variable: netCDF4.Variable, coordinates: Mapping[str, str], where: str
) -> dict[str, str]:
    """What each dimension of the velocity is; raises where the order is not (time, depth, lat, lon)."""
    roles: dict[str, str] = {}
    for kind, name in coordinates.items():
        dims = dataset.variables[name].dimensions
        if kind in ("latitude", "longitude") and len(dims) == 2:
            roles |= dict(zip(dims, ("latitude", "longitude"), strict=True))
        elif len(dims) == 1:
            roles[dims[0]] = kind
        elif len(dims) > 1:
            raise DataError(
                f"{where}: coordinate '{name}': expected one dimension, found {dims}. "
                "Interpolate the product to fixed depths and times, or name another coordinate."
            )
    for dim in variable.dimensions:
        size = dataset.dimensions[dim].size
        if dim not in roles and size > 1:
            raise DataError(
                f"{where}: variable '{variable.name}': expected dimensions (time, depth, lat, lon), found "
                f"{_show(variable.dimensions)}; '{dim}' of length {size} is none of them. "
                "Select one entry of it, or name its coordinate in names."
            )
    found = [roles[dim] for dim in variable.dimensions if dim in roles]
    if found != [kind for kind in ORDER if kind in found] or found[-2:] != ["latitude", "longitude"]:
        raise DataError(
            f"{where}: variable '{variable.name}': expected dimensions (time, depth, lat, lon), found "
            f"{_show(variable.dimensions)}. Transpose it, or name the dimensions in names."
        )
    return roles


def _show(dims: tuple[str, ...]) -> str:
    """Dimensions for messages."""
    return f"({', '.join(dims)})"


def _time(dataset: netCDF4.Dataset, name: str | None, where: str, notes: list[str]) -> tuple[Array, bool]:
    """Times of the frames in the order of the file, seconds since 1970, and whether there is no time at all."""
    if name is None:
        notes.append(f"{where}: no time coordinate: the currents are used at any time.")
        return np.zeros(1), True
    variable = dataset.variables[name]
    label = f"{where}: variable '{name}'"
    declared = [grids.attribute(variable, key) for key in ("_FillValue", "missing_value")]
    fill = [value for value in declared if value is not None and not isinstance(value, str)]
    units, calendar = (grids.attribute(variable, key) for key in ("units", "calendar"))
    raw = np.atleast_1d(grids.read_coordinate(dataset, name, where))
    if np.dtype(variable.dtype) == np.float32:
        raw = raw.astype(np.float32)
    seconds, more = grids.decode_time(raw, units, calendar, where=label, fill=fill[0] if fill else None)
    notes += more
    return seconds, False


def _depth(dataset: netCDF4.Dataset, name: str | None, where: str, notes: list[str]) -> tuple[Array, Array]:
    """Depths in m, ascending and positive down, and the order that makes them so."""
    if name is None:
        return np.zeros(1), np.array([0])
    variable = dataset.variables[name]
    label = f"{where}: variable '{name}'"
    values = np.atleast_1d(grids.read_coordinate(dataset, name, where))
    values = values * grids.length_factor(_length_units(variable), label)
    positive = grids.text_attribute(variable, "positive")
    if positive == "up" or (values.min() < 0 and values.max() <= 0):
        if positive != "up":
            notes.append(f"{label}: negative depths were taken as below the surface.")
        values = -values
    order, values = grids.ascending(values, label)
    return values + 0.0, order


def _length_units(variable: netCDF4.Variable) -> object:
    """Units of a depth axis; a singleton without meaning (units '1') is taken as metres."""
    units = grids.attribute(variable, "units")
    return None if variable.size == 1 and str(units).strip() in ("1", "level", "") else units


def _collapse(lat: Array, lon: Array) -> tuple[Array, Array]:
    """Two-dimensional coordinates that vary along one dimension each, as one-dimensional axes."""
    if lat.ndim == lon.ndim == 2 and min(lat.shape) > 1:
        if np.ptp(lat, axis=1).max() < 1e-6 and np.ptp(np.unwrap(lon, axis=0, period=360.0), axis=0).max() < 1e-6:
            return lat[:, 0], lon[0]
    return (np.atleast_1d(lat), np.atleast_1d(lon))


def _regular(layout: Layout, lat: Array, lon: Array, box: object, coordinates: Mapping[str, str]) -> None:
    """Fill in ascending axes cut to the box, and the indices that pick them."""
    where = layout.path.name
    if np.abs(lat).max() > 90.0:
        raise DataError(
            f"{where}: variable '{coordinates['latitude']}': expected latitudes in degrees, found "
            f"{lat.min():g} to {lat.max():g}. Correct the file, or name another coordinate."
        )
    order_lat, lat = grids.ascending(lat, f"{where}: variable '{coordinates['latitude']}'")
    west = None if box is None else grids.check_box(box)[2]  # type: ignore[arg-type]
    order_lon, lon = grids.longitude_axis(lon, f"{where}: variable '{coordinates['longitude']}'", west)
    rows, columns = grids.cut(lat, lon, box, where)  # type: ignore[arg-type]
    layout.latitude, layout.longitude = lat[rows], lon[columns]
    layout.pick |= {"latitude": order_lat[rows], "longitude": order_lon[columns]}


def _curvilinear(layout: Layout, dataset: netCDF4.Dataset, lat: Array, lon: Array, box: object) -> None:
    """Fill in regular axes over a bent grid, and the weights that lead there."""
    where, variable = layout.path.name, dataset.variables[layout.east]
    if "_x_" in grids.text_attribute(variable, "standard_name"):
        raise DataError(
            f"{where}: variable '{layout.east}': expected eastward velocity on a curvilinear grid, found "
            f"'{grids.text_attribute(variable, 'standard_name')}', which follows the grid's own axes. "
            "Rotate the components to east and north first."
        )
    lat = np.where(np.abs(lat) <= 90.0, lat, np.nan)
    lon = np.where(np.abs(lon) <= 720.0, lon, np.nan)
    new_lon, new_lat = grids.regular_axes(lon, lat)
    rows, columns = grids.cut(new_lat, new_lon, box, where)  # type: ignore[arg-type]
    layout.latitude, layout.longitude = new_lat[rows], new_lon[columns]
    layout.weights = grids.CurvilinearWeights(lon, lat, np.ones(lat.shape, bool), new_lon[columns], new_lat[rows])
    layout.pick |= {"latitude": np.arange(lat.shape[0]), "longitude": np.arange(lat.shape[1])}
    layout.notes.append(
        f"{where}: interpolated from a curvilinear {lat.shape[0]} x {lat.shape[1]} grid to "
        f"{layout.latitude.size} x {layout.longitude.size} cells; the components were taken as east and north."
    )
