"""What every reader of gridded NetCDF files shares: opening, coordinates, packed values and cutting to a box.

NumPy, netCDF4 and scipy only. A newcomer would get wrong: coordinates are read raw, because products declare fill
values (0) that are legal coordinates; and valid_min and valid_max of packed data speak of the packed numbers.
Units are in :mod:`~glider_jax.readers.units`, time axes in :mod:`~glider_jax.readers.calendars`, curvilinear grids
in :mod:`~glider_jax.readers.curvilinear`; their functions can be imported from here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import CoverageError, DataError, did_you_mean
from glider_jax.readers.calendars import decode_time as decode_time
from glider_jax.readers.calendars import epoch_seconds as epoch_seconds
from glider_jax.readers.calendars import iso as iso
from glider_jax.readers.classic_netcdf import check_whole
from glider_jax.readers.curvilinear import CurvilinearWeights as CurvilinearWeights
from glider_jax.readers.curvilinear import regrid_curvilinear as regrid_curvilinear
from glider_jax.readers.curvilinear import regular_axes as regular_axes
from glider_jax.readers.units import length_factor as length_factor
from glider_jax.readers.units import speed_factor as speed_factor
from glider_jax.records import Array

LATITUDE = ("lat", "latitude", "nav_lat", "y", "lats", "ylat", "nlat", "latitude_t", "xt_lat")
LONGITUDE = ("lon", "longitude", "nav_lon", "x", "lons", "xlon", "nlon", "long", "longitude_t")
DEPTH = (
    "depth",
    "z",
    "lev",
    "level",
    "deptht",
    "depthu",
    "depthv",
    "depth_t",
    "st_ocean",
    "zlev",
    "elevation",
    "deph",
)
TIME_NAMES = ("time", "ocean_time", "time_counter", "t", "mt", "date", "datetime")
DEGREES_NORTH = ("degrees_north", "degree_north", "degree_n", "degrees_n", "degreen", "degreesn")
DEGREES_EAST = ("degrees_east", "degree_east", "degree_e", "degrees_e", "degreee", "degreese")


@contextmanager
def open_netcdf(path: str | Path) -> Iterator[netCDF4.Dataset]:
    """Open a NetCDF file without any automatic masking or scaling; close it afterwards.

    Raises
    ------
    DataError : the file is absent, is a folder, is not NetCDF, or breaks off while it is read.
    """
    path = Path(path)
    if not path.exists():
        near = did_you_mean(path.name, [p.name for p in path.parent.glob("*")] if path.parent.is_dir() else [])
        raise DataError(f"{path}: expected a NetCDF file, found nothing there.{near} Check the path.")
    if path.is_dir():
        raise DataError(f"{path}: expected a NetCDF file, found a folder. Name a file in it.")
    # A classic file that was cut off reads as zeros, and a damaged header can crash the library.
    check_whole(path)
    try:
        dataset = netCDF4.Dataset(path)
    except (OSError, RuntimeError, UnicodeDecodeError) as problem:
        raise DataError(f"{path}: expected a NetCDF file, found {_looks_like(path)}. {_remedy(path)}") from problem
    try:
        dataset.set_auto_maskandscale(False)
        yield dataset
    except (OSError, RuntimeError, IndexError, UnicodeDecodeError) as problem:
        raise DataError(
            f"{path}: expected to read every value, found the file broken ({problem}). Fetch the file again."
        ) from problem
    finally:
        dataset.close()


def _looks_like(path: Path) -> str:
    """What a file that is not NetCDF seems to be."""
    with open(path, "rb") as stream:
        head = stream.read(512)
    if not head:
        return "an empty file"
    if head.startswith((b"CDF", b"\x89HDF")):
        return "a NetCDF file that is cut short or damaged"
    if head.startswith(b"MATLAB"):
        return "a MATLAB file"
    if head.startswith((b"GRIB",)):
        return "a GRIB file"
    if head.startswith((b"\x1f\x8b", b"PK", b"BZh")):
        return "a compressed file"
    if head.lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        return "a web page (perhaps a server's error message)"
    if b"\x00" not in head:
        return "a text file"
    return "binary data of another kind"


def _remedy(path: Path) -> str:
    """What to do about a file that is not NetCDF."""
    kind = _looks_like(path)
    if "compressed" in kind:
        return "Unpack it first."
    if "cut short" in kind or "web page" in kind or "empty" in kind:
        return "Fetch the file again."
    return "Convert it to NetCDF, or name another file."


def attribute(variable: netCDF4.Variable, name: str, default: object = None) -> object:
    """An attribute of a variable, or the default."""
    return variable.getncattr(name) if name in variable.ncattrs() else default


def text_attribute(variable: netCDF4.Variable, name: str) -> str:
    """An attribute as stripped lower-case text, empty if absent."""
    return str(attribute(variable, name, "")).strip().lower()


def find_coordinate(
    dataset: netCDF4.Dataset,
    kind: str,
    *,
    among: Sequence[str] | None = None,
    names: Mapping[str, str] | None = None,
    where: str = "",
) -> str | None:
    """Name of the coordinate variable of a kind, or None.

    Parameters
    ----------
    kind : ``time``, ``depth``, ``latitude`` or ``longitude``.
    among : names tried, usually the dimensions of the data and their ``coordinates`` attribute; all if None.
    names : the user's own names, which win.
    where : file, for messages.

    Raises
    ------
    DataError : the user's name is not in the file.
    """
    if names and kind in names:
        return require(dataset, names[kind], where, kind)
    tried = [n for n in (dataset.variables if among is None else among) if n in dataset.variables]
    for rule in (_by_standard_name, _by_axis, _by_units, _by_name):
        for name in tried:
            if rule(kind, name, dataset.variables[name]):
                return name
    return None


def require(dataset: netCDF4.Dataset, name: str, where: str, meaning: str) -> str:
    """Return the name if the file has such a variable, or raise a DataError with the nearest name."""
    if name not in dataset.variables:
        raise DataError(
            f"{where}: expected a variable '{name}' ({meaning}), found {', '.join(dataset.variables) or 'none'}."
            f"{did_you_mean(name, dataset.variables)} Give its name in names."
        )
    return name


def _by_standard_name(kind: str, name: str, variable: netCDF4.Variable) -> bool:
    """CF standard name."""
    return text_attribute(variable, "standard_name") == kind and np.dtype(variable.dtype).kind in "fiu"


def _by_axis(kind: str, name: str, variable: netCDF4.Variable) -> bool:
    """CF axis, for one-dimensional coordinates."""
    letter = {"time": "t", "depth": "z", "latitude": "y", "longitude": "x"}[kind]
    if text_attribute(variable, "axis") != letter or variable.ndim > 1:
        return False
    # An axis in metres of a projection is no latitude, and a sigma level is no depth.
    units = text_attribute(variable, "units").replace(" ", "")
    if kind in ("latitude", "longitude"):
        return units.startswith("degree") or not units
    return True


def _by_units(kind: str, name: str, variable: netCDF4.Variable) -> bool:
    """Units that only one kind has."""
    units = text_attribute(variable, "units")
    if kind == "time":
        return name.lower() in TIME_NAMES and " since " in f" {units} "
    if kind == "latitude":
        return units.replace(" ", "_") in DEGREES_NORTH
    if kind == "longitude":
        return units.replace(" ", "_") in DEGREES_EAST
    return False


def _by_name(kind: str, name: str, variable: netCDF4.Variable) -> bool:
    """Names in use."""
    known = {"time": TIME_NAMES, "depth": DEPTH, "latitude": LATITUDE, "longitude": LONGITUDE}[kind]
    return name.lower() in known


def fill_values(variable: netCDF4.Variable) -> list[float]:
    """Declared fill and missing values of a variable, as stored; the library's default fill where none is declared."""
    declared = [
        float(item)
        for key in ("_FillValue", "missing_value", "FillValue_")
        if key in variable.ncattrs()
        for item in np.atleast_1d(variable.getncattr(key))
        if not isinstance(item, str)
    ]
    kind = np.dtype(variable.dtype)
    # One-byte data has no default fill: every value is legal.
    if "_FillValue" not in variable.ncattrs() and kind.itemsize > 1:
        default = netCDF4.default_fillvals.get(kind.str[1:])
        declared += [] if default is None else [float(default)]
    return declared


def unpack(variable: netCDF4.Variable, raw: Array) -> tuple[Array, int]:
    """Turn raw values into numbers: fill values and values outside the valid range become NaN, then scale and offset.

    Returns
    -------
    float64 values, and how many were dropped because they lay outside valid_min and valid_max.
    """
    raw = np.asarray(raw)
    kind = raw.dtype
    if text_attribute(variable, "_Unsigned") == "true" and kind.kind == "i":
        raw = raw.view(np.dtype(f"u{kind.itemsize}"))
    values = raw.astype(float)
    gone = ~np.isfinite(values)
    for fill in fill_values(variable):
        # Compare in the stored precision: -999.9 as float64 differs from the float32 in the file.
        gone |= values == float(np.asarray(fill).astype(raw.dtype)) if np.isfinite(fill) and _fits(fill, raw) else False
    scale, offset = _packing(variable)
    low, high = _valid_range(variable, kind, scale, offset)
    outside = ~gone & ((values < low) | (values > high))
    with np.errstate(all="ignore"):
        values = np.where(gone | outside, np.nan, values) * scale + offset
    return values, int(outside.sum())


def _packing(variable: netCDF4.Variable) -> tuple[float, float]:
    """Scale factor and offset of a variable, 1 and 0 where it has none."""
    found = []
    for name, default in (("scale_factor", 1.0), ("add_offset", 0.0)):
        value = attribute(variable, name, default)
        try:
            found.append(float(np.asarray(value).reshape(-1)[0]))
        except (ValueError, TypeError, IndexError) as problem:
            raise DataError(
                f"variable '{variable.name}': attribute {name}: expected a number, found {value!r}. Correct the file."
            ) from problem
    return found[0], found[1]


def _fits(value: float, raw: Array) -> bool:
    """Whether a value can be stored in the type of the raw data."""
    if raw.dtype.kind == "f":
        return abs(value) <= float(np.finfo(raw.dtype).max)
    info = np.iinfo(raw.dtype)
    return info.min <= value <= info.max


def _valid_range(variable: netCDF4.Variable, kind: np.dtype, scale: float, offset: float) -> tuple[float, float]:
    """Valid range in packed numbers; a range in floats on integer data speaks of the unpacked numbers."""
    pair = attribute(variable, "valid_range")
    both = np.atleast_1d(pair) if pair is not None and not isinstance(pair, str) else ()
    low = both[0] if len(both) == 2 else attribute(variable, "valid_min")
    high = both[1] if len(both) == 2 else attribute(variable, "valid_max")
    limits = []
    for limit, default in ((low, -np.inf), (high, np.inf)):
        if limit is None or np.asarray(limit).dtype.kind not in "fiu" or np.size(limit) != 1 or np.isnan(limit):
            limits.append(default)
            continue
        number = float(np.asarray(limit).reshape(()))
        if kind.kind in "iu" and np.asarray(limit).dtype.kind == "f" and (scale, offset) != (1.0, 0.0):
            number = (number - offset) / scale
        limits.append(number)
    return min(limits), max(limits)


def read_coordinate(dataset: netCDF4.Dataset, name: str, where: str) -> Array:
    """Read a coordinate raw: scaled, but without fill values, which may be legal coordinates."""
    variable = dataset.variables[name]
    raw = np.asarray(variable[...])
    if raw.dtype.kind not in "fiu":
        raise DataError(f"{where}: coordinate '{name}': expected numbers, found {raw.dtype}. Name another variable.")
    scale, offset = _packing(variable)
    with np.errstate(all="ignore"):
        return raw.astype(float) * scale + offset


def ascending(values: Array, where: str) -> tuple[Array, Array]:
    """Order that makes a one-dimensional axis ascend, and the axis in that order.

    Raises
    ------
    DataError : a value is not finite, or the axis neither ascends nor descends.
    """
    values = np.atleast_1d(np.asarray(values, float))
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise DataError(
            f"{where}: expected a finite coordinate at every index, found {values[bad[0]]} at index {bad[0]}. "
            "Correct the file."
        )
    step = np.diff(values)
    if np.all(step > 0):
        return np.arange(values.size), values
    if np.all(step < 0):
        return np.arange(values.size)[::-1], values[::-1]
    first = int(np.flatnonzero(step * np.sign(step[0] or 1.0) <= 0)[0]) + 1
    raise DataError(
        f"{where}: expected values that ascend or descend, found {values[first]:g} after {values[first - 1]:g} "
        f"at index {first}. Sort the axis."
    )


def longitude_axis(lon: Array, where: str, west: float | None = None) -> tuple[Array, Array]:
    """Order and values of one ascending longitude axis, whatever convention the file uses.

    The axis starts in [-180, 180) and passes 180 where a regional grid crosses the antimeridian. A global axis
    starts at ``west``, or at -180.

    Parameters
    ----------
    lon : (n,) degrees, -180..180, 0..360 or beyond, in the order of the file.
    west : western edge of the box wanted, degrees.

    Returns
    -------
    Indices into ``lon`` (repeated meridians dropped) and the longitudes in that order.
    """
    lon = np.atleast_1d(np.asarray(lon, float))
    if not np.isfinite(lon).all() or np.abs(lon).max() > 720.0:
        raise DataError(f"{where}: expected longitudes in degrees, found {lon.min():g} to {lon.max():g}. Correct it.")
    if lon.size == 1:
        return np.array([0]), (lon + 180.0) % 360.0 - 180.0
    circle = np.mod(lon, 360.0)
    order = np.argsort(circle, kind="stable")
    gaps = np.diff(np.append(circle[order], circle[order[0]] + 360.0))
    widest = int(np.argmax(gaps))
    typical = float(np.median(gaps[gaps > 1e-9])) if (gaps > 1e-9).any() else 360.0
    if gaps[widest] > 1.5 * typical:
        start = float(circle[order[(widest + 1) % lon.size]])  # regional: begin after the gap
    else:
        start = -180.0 if west is None else west - 1.01 * typical  # around the globe
    start = (start + 180.0) % 360.0 - 180.0
    # The small shift keeps a first meridian that rounding puts just west of the start.
    axis = lon - 360.0 * np.floor((lon - start + 1e-7) / 360.0)
    order = np.argsort(axis, kind="stable")
    axis = axis[order]
    keep = np.append(True, np.diff(axis) > 1e-6 * typical)
    return order[keep], axis[keep]


def span(axis: Array, low: float, high: float, margin: int = 1) -> slice:
    """Indices of an ascending axis between two values, plus ``margin`` cells on either side."""
    first = int(np.searchsorted(axis, low, side="left"))
    last = int(np.searchsorted(axis, high, side="right"))
    return slice(max(first - margin, 0), min(last + margin, axis.size))


def cut(
    latitude: Array, longitude: Array, box: tuple[float, float, float, float] | None, where: str
) -> tuple[slice, slice]:
    """Slices of two ascending axes that hold a box and one cell around it.

    Parameters
    ----------
    box : (lat0, lat1, lon0, lon1), degrees, as in :func:`check_box`. None keeps everything.

    Raises
    ------
    CoverageError : the box lies outside of the grid.
    """
    if box is None:
        return slice(0, latitude.size), slice(0, longitude.size)
    south, north, west, east = check_box(box)
    # Bring the box to the turn of the circle in which the grid lies.
    turns = [west + 360.0 * k for k in (-2, -1, 0, 1, 2)]
    overlap = [min(w + east - west, longitude[-1]) - max(w, longitude[0]) for w in turns]
    best = turns[int(np.argmax(overlap))]
    pad_lat = np.median(np.diff(latitude)) if latitude.size > 1 else 0.0
    pad_lon = np.median(np.diff(longitude)) if longitude.size > 1 else 0.0
    if max(overlap) < -pad_lon or north < latitude[0] - pad_lat or south > latitude[-1] + pad_lat:
        raise CoverageError(
            f"{where}: expected currents in {_range(south, north, 'N')}, {_range(west, east, 'E')}, found "
            f"{_range(latitude[0], latitude[-1], 'N')}, {_range(longitude[0], longitude[-1], 'E')}. "
            "Fetch a file for this area, or correct the area."
        )
    return span(latitude, south, north), span(longitude, best, best + east - west)


def check_box(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """A box (lat0, lat1, lon0, lon1) with its edges in order.

    Where lon0 > lon1 the narrower reading is meant: swapped edges, or a box across the antimeridian.
    """
    south, north, west, east = (float(edge) for edge in box)
    if not np.isfinite([south, north, west, east]).all() or max(abs(south), abs(north)) > 90.0:
        raise DataError(f"box: expected (lat0, lat1, lon0, lon1) in degrees, found {tuple(box)}. Correct it.")
    if south > north:
        south, north = north, south
    if east < west:
        # Either the edges are swapped, or the box crosses the antimeridian: the narrower reading is meant.
        east, west = (west, east) if west - east <= 180.0 else (east + 360.0, west)
    return south, north, west, min(east, west + 360.0)


def _range(low: float, high: float, letter: str) -> str:
    """A range of degrees for messages."""
    return f"{low:.3f} to {high:.3f} {letter}"
