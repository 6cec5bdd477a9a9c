"""The numbers of gridded currents in m s-1, with each product's own errors and quality control applied.

NumPy and netCDF4 only; :mod:`~glider_jax.readers.current_layouts` says where they are. A newcomer would get wrong:
``u_err`` of the optimally interpolated radar totals is a share of the signal's variance, not a velocity.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import netCDF4
import numpy as np

from glider_jax.readers import grids
from glider_jax.readers.current_layouts import ORDER, Layout
from glider_jax.records import Array

SIGNAL_VARIANCE = 420e-4  # m2 s-2, of the MARACOOS optimal interpolation where a file names none
WORST_ERROR = 0.6  # u_err above which the product's own comment calls a vector questionable
DOP_ERROR = 0.08  # m s-1 per unit of dilution of precision: sqrt(66 cm2 s-2), the radials' error at MARACOOS
FASTEST = 10.0  # m s-1; no current is faster, an undeclared fill value is
BAD_FLAGS = ("fail", "suspect", "bad", "missing", "probably_bad", "potentially")


@dataclass
class Frames:
    """Values of one file, (time, depth, latitude, longitude), m s-1, with the notes on what was dropped."""

    east: Array
    north: Array
    east_sd: Array | None
    north_sd: Array | None
    notes: list[str]


def load(layout: Layout, frames: Array, names: Mapping[str, str]) -> Frames:
    """Read the frames (indices into ``layout.time``) of one file, in m s-1, with its quality control applied."""
    where, notes = layout.path.name, []
    with grids.open_netcdf(layout.path) as dataset:
        values = {}
        for name in (layout.east, layout.north):
            variable = dataset.variables[name]
            label = f"{where}: variable '{name}'"
            factor = grids.speed_factor(grids.attribute(variable, "units", names.get("units")), label)
            field_, outside = grids.unpack(variable, _raw(layout, variable, frames))
            values[name] = field_ * factor
            if outside:
                notes.append(f"{label}: {outside} values outside of the file's valid range were dropped.")
        east, north = values[layout.east], values[layout.north]
        half = int((np.isfinite(east) != np.isfinite(north)).sum())
        if half:
            notes.append(f"{where}: {half} cells hold only one component of the current.")
        fast = (np.abs(east) > FASTEST) | (np.abs(north) > FASTEST)
        _drop(east, north, fast, f"{where}: {{}} cells faster than {FASTEST:g} m/s were dropped.", notes)
        _flags(layout, dataset, frames, east, north, notes)
        sds = _errors(layout, dataset, frames, east, north, notes)
    if layout.weights is not None:
        apply = layout.weights.apply
        east, north = apply(east), apply(north)
        sds = None if sds is None else (apply(sds[0]), apply(sds[1]))
    return Frames(east, north, sds[0] if sds else None, sds[1] if sds else None, notes)


def _drop(east: Array, north: Array, mask: Array, sentence: str, notes: list[str]) -> None:
    """Set cells to NaN where they hold a value and the mask is True, and note how many."""
    mask = mask & (np.isfinite(east) | np.isfinite(north))
    if mask.any():
        east[mask] = north[mask] = np.nan
        notes.append(sentence.format(int(mask.sum())))


def _raw(layout: Layout, variable: netCDF4.Variable, frames: Array) -> Array:
    """Raw values of a variable at the frames and cells wanted, as (time, depth, latitude, longitude)."""
    pick = {"time": frames, **layout.pick}
    starts, inner, shape = [], [], []
    for dim in variable.dimensions:
        role = layout.roles.get(dim)
        index = pick[role] if role in pick else np.array([0])
        # Read the smallest block that holds the indices, then pick in memory: far quicker than index arrays.
        low, high = int(index.min()), int(index.max()) + 1
        starts.append(slice(low, high))
        inner.append(index - low)
        if role is not None:
            shape.append((ORDER.index(role), index.size))
    block = np.asarray(variable[tuple(starts)])[np.ix_(*inner)]
    sizes = dict(shape)
    return block.reshape([sizes.get(position, 1) for position in range(4)])


def _flags(layout: Layout, dataset: netCDF4.Dataset, frames: Array, east: Array, north: Array, notes: list) -> None:
    """Drop cells that the product's own quality flags call bad."""
    for name in ("qc_primary_flag", "qc_operator_flag", "QCflag"):
        variable = dataset.variables.get(name)
        if variable is None or variable.dimensions != layout.dims:
            continue
        codes = np.atleast_1d(grids.attribute(variable, "flag_values", [1, 2, 3, 4, 9]))
        words = str(grids.attribute(variable, "flag_meanings", "pass not_evaluated suspect fail missing")).split()
        bad = [int(c) for c, w in zip(codes, words, strict=False) if w.lower().startswith(BAD_FLAGS)]
        mask = np.isin(_raw(layout, variable, frames), bad)
        _drop(
            east,
            north,
            mask,
            f"{layout.path.name}: {{}} cells were dropped: '{name}' is one of {bad}.",
            notes,
        )


def _errors(
    layout: Layout, dataset: netCDF4.Dataset, frames: Array, east: Array, north: Array, notes: list[str]
) -> tuple[Array, Array] | None:
    """1-sigma errors of both components in m s-1 from what the product gives, or None."""
    where, held = layout.path.name, {name.lower(): name for name in dataset.variables}

    def read(name: str) -> Array:
        variable = dataset.variables[held[name]]
        return grids.unpack(variable, _raw(layout, variable, frames))[0]

    shares = ("u_err", "v_err")
    plain = ("", "1", "none", "dimensionless")
    if all(n in held and grids.text_attribute(dataset.variables[held[n]], "units") in plain for n in shares):
        ratios = [read("u_err"), read("v_err")]
        worst = np.fmax(*ratios) > WORST_ERROR
        _drop(east, north, worst, f"{where}: {{}} cells were dropped: u_err or v_err over {WORST_ERROR}.", notes)
        variance = _signal_variance(dataset)
        notes.append(f"{where}: errors are sqrt(u_err x {variance * 1e4:.0f} cm2/s2).")
        sds = [np.sqrt(np.maximum(ratio, 0.0) * variance) for ratio in ratios]
    elif {"dopx", "dopy"} <= held.keys():
        notes.append(f"{where}: errors are the dilution of precision x {DOP_ERROR} m/s.")
        sds = [np.abs(read("dopx")) * DOP_ERROR, np.abs(read("dopy")) * DOP_ERROR]
    else:
        for ending in ("_error", "_err", "_sd", "_std", None):
            pair = (
                ("ewcs", "nscs")
                if ending is None
                else tuple(f"{n.lower()}{ending}" for n in (layout.east, layout.north))
            )
            if all(name in held and dataset.variables[held[name]].dimensions == layout.dims for name in pair):
                break
        else:
            return None
        factors = [
            grids.speed_factor(grids.attribute(dataset.variables[held[n]], "units"), f"{where}: variable '{held[n]}'")
            for n in pair
        ]
        notes.append(f"{where}: errors are {held[pair[0]]} and {held[pair[1]]}.")
        sds = [np.abs(read(name)) * factor for name, factor in zip(pair, factors, strict=True)]
    return np.where(np.isfinite(east), sds[0], np.nan), np.where(np.isfinite(north), sds[1], np.nan)


def _signal_variance(dataset: netCDF4.Dataset) -> float:
    """Signal variance of the optimal interpolation, m2 s-2, from the processing parameters where the file has them."""
    variable = dataset.variables.get("processing_parameters")
    if variable is None:
        return SIGNAL_VARIANCE
    for name in variable.ncattrs():
        if name.endswith("_description") and "signal variance" in str(variable.getncattr(name)).lower():
            value = grids.attribute(variable, name.removesuffix("_description"))
            if value is not None and float(value) > 0:  # type: ignore[arg-type]
                return float(value) * 1e-4  # type: ignore[arg-type]
    item = re.search(r"(\d+)\)\s*signal variance", str(grids.attribute(variable, "comment", "")).lower())
    if item and variable.ndim and variable.shape[-1] >= int(item[1]):
        value = float(np.asarray(variable[...]).reshape(-1, variable.shape[-1])[0, int(item[1]) - 1])
        if np.isfinite(value) and value > 0:
            return value * 1e-4
    return SIGNAL_VARIANCE
