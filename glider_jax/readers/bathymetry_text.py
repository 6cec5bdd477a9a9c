"""Bathymetry in text (XYZ columns, ESRI ASCII), in Matlab files and inside zip files.

NumPy only. A newcomer would get wrong: XYZ text has no header that tells the sign (survey centres deliver
elevation under the word depth), rows may be missing, and six printed decimals make an even grid look uneven.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from glider_jax.errors import DataError, did_you_mean
from glider_jax.readers.bathymetry_grids import (
    LATITUDE_NAMES,
    LONGITUDE_NAMES,
    Box,
    Raw,
    check_degrees,
    check_size,
    covered,
    curvilinear_raw,
    open_netcdf,
    read_netcdf,
    select_columns,
    select_rows,
)
from glider_jax.readers.matlab_numbers import matlab_arrays
from glider_jax.records import Array

#: First bytes of files that are something else, and what to do with them.
FOREIGN = (
    (b"II*\x00", "a GeoTIFF", "Convert it: gdal_translate -of netCDF in.tif out.nc."),
    (b"MM\x00*", "a GeoTIFF", "Convert it: gdal_translate -of netCDF in.tif out.nc."),
    (b"RDX", "a saved R session", "Write the grid from R as longitude,latitude,elevation text."),
    (b"BZh", "a bzip2 file", "Uncompress it first; an .rda file must be written from R as text."),
    (b"\xfd7zXZ", "an xz file", "Uncompress it first; an .rda file must be written from R as text."),
    (b"\x1f\x8b", "a gzip file", "Uncompress it first; an .rda file must be written from R as text."),
    (b"GRIB", "a GRIB file", "Convert it to NetCDF."),
    (b"%PDF", "a PDF", "Give the data file."),
    (b"<", "a web page or XML", "Get the data file itself."),
)
ESRI_KEYS = ("ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize", "nodata_value")
TABLE_SUFFIXES = (".xyz", ".asc", ".txt", ".csv", ".dat", ".nc", ".grd", ".mat")
SAME = 2e-5  # degrees; positions closer than this are one column, as six printed decimals make them
HEADER_LINES = 10  # names and units stand in no more lines than this
SPARSE = 0.25  # share of the cells of a grid that must be filled for points to count as a grid


def kind_of(head: bytes, path: Path) -> str:
    """Kind of file from its first bytes: ``netcdf``, ``matlab``, ``zip``, ``esri`` or ``xyz``."""
    if head.startswith((b"CDF\x01", b"CDF\x02", b"CDF\x05")):
        return "netcdf"
    if head.startswith(b"MATLAB 7.3"):
        raise DataError(f"{path.name}: expected a Matlab file up to version 7, found version 7.3. Save it with '-v7'.")
    if head.startswith(b"\x89HDF"):
        return "netcdf"
    if head.startswith(b"MATLAB"):
        return "matlab"
    if head.startswith(b"PK\x03\x04"):
        return "zip"
    for start, what, advice in FOREIGN:
        if head.startswith(start):
            raise DataError(f"{path.name}: expected NetCDF, XYZ text or an ESRI grid, found {what}. {advice}")
    if not head.strip():
        raise DataError(f"{path.name}: expected bathymetry, found an empty file. Get it again.")
    if b"\x00" in head:
        raise DataError(f"{path.name}: expected NetCDF, XYZ text or an ESRI grid, found unknown binary data.")
    first = head.lstrip(b"\xef\xbb\xbf").split()
    return "esri" if first and first[0].lower() in (b"ncols", b"nrows") else "xyz"


def read(kind: str, path: Path, box: Box | None, names: Mapping[str, str]) -> Raw:
    """Read a file of one of the kinds above, values as stored."""
    if kind == "zip":
        return _read_zip(path, box, names)
    if kind == "matlab":
        return _read_matlab(path.read_bytes(), path.name, box, names)
    return _read_text(kind, path.read_bytes(), path.name, box)


def _read_text(kind: str, raw: bytes, where: str, box: Box | None) -> Raw:
    text = raw.decode("latin-1").lstrip("\ufeffï»¿")
    return _read_esri(text, where, box) if kind == "esri" else _read_xyz(text, where, box)


def _read_zip(path: Path, box: Box | None, names: Mapping[str, str]) -> Raw:
    """Read the one data file inside a zip."""
    try:
        with zipfile.ZipFile(path) as archive:
            inside = [m for m in archive.infolist() if Path(m.filename).suffix.lower() in TABLE_SUFFIXES]
            tables = [m for m in inside if "readme" not in m.filename.lower()]
            # A delivery holds one grid beside short notes and headers.
            tables = [m for m in tables if m.file_size >= 0.2 * max(t.file_size for t in tables)]
            if len(tables) != 1:
                raise DataError(
                    f"{path.name}: expected one data file in the zip, found "
                    f"{', '.join(m.filename for m in tables) or 'none'}. Unpack it and give one of them."
                )
            content = archive.read(tables[0])
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError) as problem:
        raise DataError(
            f"{path.name}: expected a readable zip, found a damaged one ({problem}). Get it again."
        ) from problem
    where = f"{path.name}: {tables[0].filename}"
    kind = kind_of(content[:512], Path(tables[0].filename))
    if kind == "zip":
        raise DataError(f"{where}: expected a data file, found a zip in the zip. Unpack it.")
    if kind == "netcdf":
        with open_netcdf(where, content) as file:
            return read_netcdf(file, where, box, names)
    if kind == "matlab":
        return _read_matlab(content, where, box, names)
    return _read_text(kind, content, where, box)


def _read_matlab(content: bytes, where: str, box: Box | None, names: Mapping[str, str]) -> Raw:
    """Read longitudes, latitudes and depths, as vectors or as matrices, from a Matlab file."""
    arrays = {k: v.astype(float) for k, v in matlab_arrays(content, where).items() if v.size > 1 and v.ndim == 2}

    def find(which: str, usual: tuple[str, ...], part: str) -> str:
        if which in names:
            if names[which] in arrays:
                return names[which]
            near = did_you_mean(names[which], arrays)
            raise DataError(f"{where}: expected the array '{names[which]}', found {', '.join(arrays)}.{near}")
        match = [k for k in arrays if k.lower() in usual] or [k for k in arrays if part in k.lower()]
        if len(match) != 1:
            raise DataError(
                f"{where}: expected one {which} array, found {', '.join(match) or 'none'} among "
                f"{', '.join(arrays) or 'no arrays'}. Name it with names={{'{which}': ...}}."
            )
        return match[0]

    lat, lon = find("latitude", LATITUDE_NAMES, "lat"), find("longitude", LONGITUDE_NAMES, "lon")
    rest = [k for k in arrays if k not in (lat, lon) and min(arrays[k].shape) > 1]
    if "depth" in names:
        name = find("depth", (), "")
    elif len(rest) == 1:
        name = rest[0]
    else:
        raise DataError(
            f"{where}: expected one matrix of depths, found {', '.join(rest) or 'none'}. "
            "Name it with names={'depth': ...}."
        )
    values, latitude, longitude = arrays[name], arrays[lat], arrays[lon]
    if min(latitude.shape) == 1 and min(longitude.shape) == 1:
        longitude, latitude = np.meshgrid(longitude.ravel(), latitude.ravel())
        values = values if values.shape == latitude.shape else values.T
    raw = curvilinear_raw(latitude, longitude, values, box, f"{where}: '{name}'")
    raw.name, raw.hint = name, name.lower()
    # A matrix named after a variable and a region ("h_USeast") hints at what stands before the underscore.
    raw.hint = raw.hint.split("_")[0] if "_" in raw.hint else raw.hint
    return raw


def _read_esri(text: str, where: str, box: Box | None) -> Raw:
    """Read an ESRI ASCII grid; rows run from north to south, corners are of cells unless they say centre."""
    lines = text.splitlines()
    header: dict[str, float] = {}
    for line in lines:
        parts = line.split()
        if len(parts) != 2 or parts[0].lower() not in (*ESRI_KEYS, "dx", "dy"):
            break
        try:
            header[parts[0].lower()] = float(parts[1])
        except ValueError as problem:
            raise DataError(
                f"{where}: expected a number after '{parts[0]}', found '{parts[1]}'. Correct the header."
            ) from problem
    missing = [k for k in ("ncols", "nrows") if k not in header]
    step = (header.get("dx", header.get("cellsize")), header.get("dy", header.get("cellsize")))
    corner = [header.get(f"{a}llcenter", header.get(f"{a}llcorner")) for a in "xy"]
    if missing or None in step or None in corner:
        raise DataError(
            f"{where}: expected a header with ncols, nrows, xllcorner, yllcorner and cellsize, found "
            f"{', '.join(header)}. Complete it."
        )
    shift = [0.0 if f"{a}llcenter" in header else 0.5 for a in "xy"]
    nx, ny = int(header["ncols"]), int(header["nrows"])
    check_size(where, (ny, nx))
    flat = _numbers(" ".join(lines[len(header) :]), where)
    if flat.size != nx * ny:
        raise DataError(f"{where}: expected {nx} x {ny} values, found {flat.size}. The file may be cut off.")
    values = np.where(flat == header.get("nodata_value", -9999.0), np.nan, flat).reshape(ny, nx)
    longitude = corner[0] + step[0] * (np.arange(nx) + shift[0])
    latitude = corner[1] + step[1] * (np.arange(ny)[::-1] + shift[1])
    check_degrees(latitude, longitude, where)
    (rows, lat), (columns, lon) = select_rows(latitude, box), select_columns(longitude, box)
    covered(rows, columns, latitude, longitude, box, where)
    return Raw(lat, lon, values[np.ix_(rows, columns)])


def _numbers(text: str, where: str) -> Array:
    try:
        return np.array(text.split(), float)
    except ValueError as problem:
        raise DataError(f"{where}: expected numbers, found something else ({problem}).") from problem


def _read_xyz(text: str, where: str, box: Box | None) -> Raw:
    """Read columns of longitude, latitude and depth or elevation, with or without a header, and grid them."""
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] not in "#;%>"]
    first = next((i for i, line in enumerate(lines[:HEADER_LINES]) if _is_row(line)), None)
    if first is None:
        raise DataError(
            f"{where}: expected rows of longitude, latitude and depth, found '{lines[0][:60] if lines else ''}'. "
            "Give columns of numbers separated by comma or blanks."
        )
    header = [w.strip('" ').lower() for w in _words(lines[0])] if first else []
    delimiter = next((d for d in ",;" if d in lines[first]), None)
    try:
        table = np.loadtxt(lines[first:], delimiter=delimiter, usecols=(0, 1, 2), ndmin=2)
    except (ValueError, IndexError) as problem:
        raise DataError(
            f"{where}: expected rows of longitude, latitude and depth, found something else ({problem}). "
            "Give columns of numbers separated by comma or blanks."
        ) from problem
    if table.shape[0] < 4:
        raise DataError(f"{where}: expected rows of longitude, latitude and depth, found {table.shape[0]} rows.")
    raw = Raw(np.zeros(0), np.zeros(0), np.zeros(0))
    lon, lat, raw.name = _columns(table, header, raw)
    raw.hint = raw.name
    good = np.isfinite(lon) & np.isfinite(lat)
    check_degrees(lat[good], lon[good], where)
    return _grid_points(lon[good], lat[good], table[good, 2], raw, where, box)


def _words(line: str) -> list[str]:
    return [w for w in re.split(r"[,;\s]+", line.strip()) if w]


def _is_row(line: str) -> bool:
    """Whether a line starts with three numbers."""
    try:
        return len([float(w) for w in _words(line)[:3]]) == 3
    except ValueError:
        return False


def _columns(table: Array, header: list[str], raw: Raw) -> tuple[Array, Array, str]:
    """Longitudes, latitudes and the third column's name, from the header, from the ranges, or by custom."""
    places = [
        next((i for i, w in enumerate(header[:2]) if w.startswith(tuple(usual))), None)
        for usual in (("lon", "x"), ("lat", "y"))
    ]
    name = header[2].split("(")[0].split("[")[0].strip() if len(header) > 2 else ""
    if None not in places:
        return table[:, places[0]], table[:, places[1]], name
    size = np.nanmax(np.abs(table[:, :2]), axis=0)
    if size[1] > 90.0 >= size[0]:
        raw.notes.append("The first column was taken as latitude, the second as longitude, by their ranges.")
        return table[:, 1], table[:, 0], name
    if size[0] <= 90.0:
        raw.notes.append("The first column was taken as longitude, the second as latitude, as is usual.")
    return table[:, 0], table[:, 1], name


def _axis(values: Array) -> tuple[Array, Array]:
    """Even axis through coordinates printed with few digits, and the place of each of them on it."""
    unique = np.unique(values)
    unique = unique[np.concatenate([[True], np.diff(unique) > SAME])]
    if unique.size < 2:
        return unique, np.zeros(values.size, int)
    step = float(np.median(np.diff(unique)))
    count = (unique[-1] - unique[0]) / step
    # The median of printed steps is rounded; the whole length divided by the number of steps is not.
    step = (unique[-1] - unique[0]) / max(round(count), 1)
    place = np.rint((values - unique[0]) / step).astype(int)
    axis = unique[0] + step * np.arange(place.max() + 1)
    if np.abs(axis[place] - values).max() > 0.05 * step + SAME:
        place = np.clip(np.searchsorted(unique, values - SAME), 0, unique.size - 1)
        return unique, place
    return axis, place


def _grid_points(lon: Array, lat: Array, values: Array, raw: Raw, where: str, box: Box | None) -> Raw:
    """Put points on the grid they came from; cells without a point stay NaN."""
    (latitude, row), (longitude, column) = _axis(lat), _axis(lon)
    if latitude.size < 2 or longitude.size < 2 or values.size < SPARSE * latitude.size * longitude.size:
        raise DataError(
            f"{where}: expected points on a grid, found {values.size} points at {longitude.size} longitudes and "
            f"{latitude.size} latitudes. Grid scattered soundings with seafloor_tracks.grid_seafloor."
        )
    check_size(where, (latitude.size, longitude.size))
    grid = np.full((latitude.size, longitude.size), np.nan)
    grid[row, column] = values
    filled = np.unique(row * longitude.size + column).size
    if filled < values.size:
        raw.notes.append(f"{values.size - filled} points lie on another point; the last one counts.")
    if filled < grid.size:
        raw.notes.append(f"{grid.size - filled} of {grid.size} cells have no point and are NaN.")
    (rows, lat_axis), (columns, lon_axis) = select_rows(latitude, box), select_columns(longitude, box)
    covered(rows, columns, latitude, longitude, box, where)
    raw.latitude, raw.longitude, raw.values = lat_axis, lon_axis, grid[np.ix_(rows, columns)]
    return raw
