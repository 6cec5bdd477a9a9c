"""Mean temperature and salinity by depth from model fields: native ROMS files, or CF files on fixed depths.

netCDF4 and NumPy only. A newcomer would get wrong: a mean at a depth may only count the places that are that deep,
and the standard name tells which temperature and salinity a file holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.current_layouts import is_roms
from glider_jax.readers.grids import (
    attribute,
    check_box,
    decode_time,
    find_coordinate,
    length_factor,
    open_netcdf,
    read_coordinate,
    text_attribute,
    unpack,
)
from glider_jax.readers.roms_files import RomsFile, RomsFiles
from glider_jax.readers.roms_grid import Box, read_horizontal, read_vertical
from glider_jax.readers.roms_vertical import DepthWeights, choose_levels
from glider_jax.records import Array, Source

TEMPERATURES = {
    "sea_water_conservative_temperature": "conservative",
    "sea_water_potential_temperature": "potential",
    "sea_water_temperature": "in situ",
}
SALINITIES = {
    "sea_water_absolute_salinity": "absolute",
    "sea_water_preformed_salinity": "absolute",
    "sea_water_reference_salinity": "absolute",
    "sea_water_practical_salinity": "practical",
    "sea_water_salinity": "practical",
}
TEMPERATURE_NAMES = {"thetao": "potential", "votemper": "potential", "water_temp": "in situ", "temperature": "in situ"}
TEMPERATURE_NAMES |= {"t_an": "in situ", "temp": "potential", "theta": "potential", "t": "in situ"}
SALINITY_NAMES = {"so": "practical", "vosaline": "practical", "salinity": "practical", "s_an": "practical"}
SALINITY_NAMES |= {"salt": "practical", "s": "practical"}


@dataclass
class MeanProfile:
    """Means by level of temperature and salinity as stored, where they were taken, and of what kind they are."""

    depth: Array
    temperature: Array
    salinity: Array
    temperature_kind: str
    salinity_kind: str
    latitude: float
    longitude: float


def kind_of(path: Path) -> str:
    """Whether a file is native ROMS, holds fields on fixed depths, or is a glider's."""
    if path.suffix.lower() not in (".nc", ".nc4", ".cdf", ".ncd"):
        return "recording"
    with open_netcdf(path) as data:
        if is_roms(data):
            return "roms"
        found = _find(data, TEMPERATURES, TEMPERATURE_NAMES) or _find(data, SALINITIES, SALINITY_NAMES)
        return "levels" if found and data.variables[found[0]].ndim >= 3 else "recording"


def _find(data: netCDF4.Dataset, standard: dict[str, str], names: dict[str, str]) -> tuple[str, str] | None:
    """Name and kind of the first variable known by its standard name, else by its own."""
    for wanted, kind in standard.items():
        for name, variable in data.variables.items():
            if text_attribute(variable, "standard_name") == wanted:
                return name, kind
    for wanted, kind in names.items():
        for name in data.variables:
            if name.lower() == wanted:
                return name, kind
    return None


def _mean(total: Array, count: Array) -> Array:
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def roms_means(
    paths: list[Path], grid: str | Path | None, box: Box | None, period: tuple[float, float] | None
) -> tuple[MeanProfile, Source]:
    """Mean of temp and salt over the sea points of the box and the times, by standard depth."""
    with RomsFiles.open(paths, grid) as files:
        holders = [f for f in files.fields if f.shape("temp") is not None and f.shape("salt") is not None]
        if not holders:
            lacking = [n for n in ("temp", "salt") if not any(f.shape(n) is not None for f in files.fields)]
            raise DataError(
                f"{files.names}: expected variables 'temp' and 'salt' in one file, found no "
                f"{' and no '.join(lacking) or 'file with both'}. Name a history, average or initial file."
            )
        shape = holders[0].shape("temp")
        full = shape[-2:]
        block = read_horizontal(files, full, box, vector=False)
        vertical = read_vertical(files, holders[0], shape[1])
        sea = block.sea & np.isfinite(block.h)
        if not sea.any():
            raise CoverageError(f"{files.names}: expected sea with a known depth in the box, found none.")
        levels = choose_levels(float(block.h[sea].max()))
        h = block.h[sea]
        weights = DepthWeights(vertical.depths(h), levels)
        below = levels[:, None] > h
        total, count = np.zeros((2, levels.size)), np.zeros((2, levels.size))
        for file, index in _roms_frames(files, holders, period):
            for number, name in enumerate(("temp", "salt")):
                values = file.values(name, (index, ..., block.rows, block.columns))[:, sea]
                values = np.where(below, np.nan, weights.apply(values))
                total[number] += np.nansum(values, axis=1)
                count[number] += np.isfinite(values).sum(axis=1)
        files.note("means over the sea points that reach each depth; the free surface was taken as 0.")
        mean = MeanProfile(
            levels,
            *_mean(total, count),
            "potential",
            "practical",
            float(block.lat[sea].mean()),
            float(block.lon[sea].mean()),
        )
        return mean, files.source("ROMS hydrography")


def _roms_frames(
    files: RomsFiles, holders: list[RomsFile], period: tuple[float, float] | None
) -> list[tuple[RomsFile, int]]:
    """Files and indices of the times in the period."""
    every = [(file, i, t) for file in holders for i, t in enumerate(files.times(file, "temp"))]
    kept = [(file, i) for file, i, t in every if period is None or period[0] <= t <= period[1]]
    if not kept:
        raise CoverageError(f"{files.names}: expected temperature in the period, found none of {len(every)} times.")
    return kept


def level_means(paths: list[Path], box: Box | None, period: tuple[float, float] | None) -> tuple[MeanProfile, Source]:
    """Mean over place and time of fields on fixed depths."""
    found: dict[str, list[tuple[Array, Array, Array, float, float]]] = {"temperature": [], "salinity": []}
    kinds: dict[str, str] = {}
    for path in paths:
        with open_netcdf(path) as data:
            for role, standard, names in (
                ("temperature", TEMPERATURES, TEMPERATURE_NAMES),
                ("salinity", SALINITIES, SALINITY_NAMES),
            ):
                hit = _find(data, standard, names)
                if hit is not None:
                    kinds.setdefault(role, hit[1])
                    found[role].append(_level_sums(data, hit[0], box, period, path.name))
    for role, parts in found.items():
        if not parts:
            raise DataError(
                f"{', '.join(path.name for path in paths)}: expected a {role} known by standard name or name, found "
                "none. Add the file that holds it."
            )
    depth = found["temperature"][0][0]
    means = []
    for role, parts in found.items():
        for levels, *_ in parts:
            if levels.shape != depth.shape or not np.allclose(levels, depth):
                raise DataError(f"{role}: expected the same depths in all files, found others. Give one product only.")
        means.append(_mean(sum(part[1] for part in parts), sum(part[2] for part in parts)))
    latitude, longitude = found["temperature"][0][3:]
    mean = MeanProfile(depth, *means, kinds["temperature"], kinds["salinity"], latitude, longitude)
    source = Source("CF hydrography", {str(path): Source.digest(path) for path in paths})
    return mean, source


def _level_sums(
    data: netCDF4.Dataset, name: str, box: Box | None, period: tuple[float, float] | None, where: str
) -> tuple[Array, Array, Array, float, float]:
    """Depths, sums and counts by depth of one variable, and the middle of the area used."""
    variable = data.variables[name]
    fits = [n for n, v in data.variables.items() if v.ndim and set(v.dimensions) <= set(variable.dimensions)]
    among = [*variable.dimensions, *str(attribute(variable, "coordinates", "")).split(), *fits]
    names = {kind: find_coordinate(data, kind, among=among) for kind in ("time", "depth", "latitude", "longitude")}
    for kind in ("depth", "latitude", "longitude"):
        if names[kind] is None:
            raise DataError(f"{where}: variable '{name}': expected a {kind} coordinate, found none. Name one with CF.")
    axis = variable.dimensions.index(data.variables[names["depth"]].dimensions[0])
    depth_variable = data.variables[names["depth"]]
    depth = read_coordinate(data, names["depth"], where) * length_factor(
        attribute(depth_variable, "units"), f"{where}: variable '{names['depth']}'"
    )
    depth = -depth if text_attribute(depth_variable, "positive") == "up" or (depth <= 0).all() else depth
    latitude, longitude = (read_coordinate(data, names[kind], where) for kind in ("latitude", "longitude"))
    dims = tuple(dict.fromkeys(d for k in ("latitude", "longitude") for d in data.variables[names[k]].dimensions))
    if latitude.ndim == 1:
        latitude, longitude = np.meshgrid(latitude, longitude, indexing="ij")
    inside = is_inside(latitude, longitude, box)
    if not inside.any():
        raise CoverageError(f"{where}: expected points in the box, found none. Choose another file or area.")
    total, count = np.zeros(depth.size), np.zeros(depth.size)
    for index in _time_indices(data, variable, names["time"], period, where):
        key = tuple(index.get(dim, slice(None)) for dim in variable.dimensions)
        left = [dim for dim in variable.dimensions if dim not in index]
        values, _ = unpack(variable, np.asarray(variable[key]))
        order = [left.index(variable.dimensions[axis]), *(left.index(dim) for dim in dims)]
        rest = [i for i in range(values.ndim) if i not in order]
        values = values.transpose(*order, *rest).reshape(depth.size, *inside.shape)[:, inside]
        if text_attribute(variable, "units") in ("k", "kelvin", "degrees_kelvin"):
            values = values - 273.15
        total += np.nansum(values, axis=1)
        count += np.isfinite(values).sum(axis=1)
    sort = np.argsort(depth)
    return (
        depth[sort],
        total[sort],
        count[sort],
        float(latitude[inside].mean()),
        float(((longitude[inside] + 180.0) % 360.0 - 180.0).mean()),
    )


def is_inside(latitude: Array, longitude: Array, box: Box | None) -> Array:
    """True for positions in the box, whatever the convention of longitudes."""
    if box is None:
        return np.isfinite(latitude) & np.isfinite(longitude)
    south, north, west, east = check_box(box)
    turned = west + (longitude - west) % 360.0
    return (latitude >= south) & (latitude <= north) & (turned <= east)


def _time_indices(
    data: netCDF4.Dataset,
    variable: netCDF4.Variable,
    name: str | None,
    period: tuple[float, float] | None,
    where: str,
) -> list[dict[str, int]]:
    """The dimension of time and each index to read along it; one empty entry where the field has no time."""
    if name is None or data.variables[name].ndim != 1 or data.variables[name].dimensions[0] not in variable.dimensions:
        return [{}]
    time = data.variables[name]
    seconds, _ = decode_time(
        np.asarray(time[...]), attribute(time, "units"), attribute(time, "calendar"), where=f"{where}: '{name}'"
    )
    kept = np.arange(seconds.size)
    if period is not None:
        kept = np.flatnonzero((seconds >= period[0]) & (seconds <= period[1]))
    if kept.size == 0:
        raise CoverageError(f"{where}: expected times in the period, found none of {seconds.size}. Widen the period.")
    return [{time.dimensions[0]: int(i)} for i in kept]
