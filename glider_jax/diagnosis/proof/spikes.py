"""Effects concealed in real recordings: the sensors' values changed as the effect would have changed them.

Imports NumPy, xarray and netCDF4. Only effects that act on what was recorded, not on how the glider flew, can be put
in exactly. A recording keeps its own noise, faults and natural effects; what a diagnosis names of the recording as it
is, is known too, is not put in and does not count as found. Nobody knows a real recording's noise: how strong an effect
is, is told against the smallest size that the diagnosis of the untouched recording says it would surely have seen.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from glider_jax.diagnosis.proof.metrics import candidates
from glider_jax.diagnosis.proof.ocean import metres_per_degree
from glider_jax.errors import ConfigError, DataError

Array = NDArray[np.float64]
Columns = dict[str, Array]

#: s; a longer hole in a recording parts two missions. Signal-to-noise ratio of the smallest size surely seen.
HOLE, SURE = 43200.0, 6.0
#: Times its size in ``SIZES`` that an effect may have at most; a larger one no pilot would need a tool to find.
LARGEST = 3.0
#: bar of sea water in a metre of depth, 1025 kg m-3.
BAR_PER_METRE = 0.1005


class Real(NamedTuple):
    """A mission of a real recording: file below the folder, which of its missions, and the vehicle nearest to it."""

    file: str
    mission: int
    vehicle: str


RECORDINGS = {
    "comet2019_first": Real("comet2019/comet2019.nc", 0, "vehicles/slocum_g1_comet.toml"),
    "comet2019_second": Real("comet2019/comet2019.nc", 1, "vehicles/slocum_g1_comet.toml"),
    "osu684_2025": Real("osu684_2025/osu684_2025.nc", 1, "vehicles/slocum_g3.toml"),
    "ru28_2017": Real("ru28_2017/ru28_2017.nc", 0, "vehicles/slocum_g1_shallow.toml"),
    "maria2022": Real("maria2022/maria2022.nc", 0, "vehicles/slocum_g3.toml"),
    "rosie2019": Real("rosie2019/rosie2019.nc", 0, "vehicles/slocum_g3.toml"),
}

#: Sizes to put in, by ``id.parameter``: large enough that a pilot would want to know.
SIZES: dict[str, dict[str, float]] = {
    "flight.pitch_gain": {"gain": 0.12},
    "flight.pitch_offset": {"offset": 0.05},
    "flight.oil_gain": {"gain": 0.1},
    "navigation.magnetic_declination": {"angle": 0.25},
    "navigation.mean_current": {"east": 0.15, "north": -0.1},
    "energy.dive_only_load": {"power": 1.0},
    "energy.climb_only_load": {"power": 1.0},
    "energy.surface_load": {"power": 2.0},
    "energy.internal_resistance": {"resistance": 0.4},
    "sensor.current_gain": {"gain": 0.1},
    "sensor.current_offset": {"offset": 0.05},
    "sensor.coulomb_gain": {"gain": 0.05},
    "sensor.pressure_offset": {"offset": 0.7},
}
_NEEDS = {
    "flight.oil_gain": ("m_ballast_pumped",),
    "flight": ("m_pitch",),
    "navigation.magnetic_declination": ("m_heading",),
    "navigation.mean_current": ("m_gps_lat", "m_gps_lon"),
    "energy.internal_resistance": ("m_coulomb_current", "m_battery"),
    "energy": ("m_coulomb_current", "m_coulomb_amphr_total", "m_battery", "m_pitch"),
    "sensor.pressure_offset": ("m_depth",),
    "sensor.coulomb_gain": ("m_coulomb_amphr_total",),
    "sensor": ("m_coulomb_current", "m_coulomb_amphr_total"),
}


def available(real: Path) -> list[str]:
    """Names of the missions that the folder's recordings hold.

    Raises
    ------
    ConfigError : no known recording lies in the folder.
    """
    found = [name for name, one in RECORDINGS.items() if (real / one.file).exists()]
    if not found:
        files = ", ".join(sorted({one.file for one in RECORDINGS.values()}))
        raise ConfigError(f"{real}: expected one of the recordings {files}, found none. Give another folder.")
    return found


def stands_for(diagnosis: Mapping) -> set[str]:
    """Everything that the names of a diagnosis may stand for: themselves, their classes and alternatives."""
    return set().union(*(candidates(effect) for effect in diagnosis.get("effects", [])))


def ratio(id: str, natural: Mapping, times: float = 1.0) -> float | None:
    """Signal-to-noise ratio of an effect at some times its size; None where it could not be put in or told.

    Parameters
    ----------
    natural : diagnosis of the untouched recording; what it names already cannot be told from what is put in.
    """
    if id in stands_for(natural):
        return None
    entry = next((one for one in natural["not_found"] if one["id"] == id), None)
    least = {p["name"]: p["minimum"] for p in entry["minimum_detectable"]} if entry else {}
    parts = [SURE * times * size / least[name] for name, size in SIZES[id].items() if least.get(name)]
    return float(np.linalg.norm(parts)) if parts else None


def truth_of(recording: str, id: str, times: float, name: str, strength: float | None = None) -> dict[str, Any]:
    """The truth of a spiked case, in the layout of the simulated ones: an effect at some times its size."""
    effects = {f"{id}.{p}": value * times for p, value in SIZES[id].items()}
    return {
        "name": name, "kind": "real", "region": recording, "seed": 0, "effects": effects, "strengths": {id: strength},
        "faint": {}, "product": True, "constants": {},
    }  # fmt: skip


def write_plain(folder: Path, real: Path, recording: str) -> None:
    """Write a mission of a real recording as a case without anything put in, beside its vehicle file.

    The copy lies in the case's folder only, which a run removes when it is done.
    """
    from glider_jax_data import path as bundled

    one = RECORDINGS[recording]
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(bundled(one.vehicle), folder / "vehicle.toml")
    with xr.open_dataset(real / one.file, decode_times=False, mask_and_scale=False) as data:
        time = data["time"].values
        holes = np.flatnonzero(np.diff(time) > HOLE)
        edges = [-np.inf, *(0.5 * (time[holes] + time[holes + 1])), np.inf]
        low, high = edges[one.mission], edges[one.mission + 1]
        for axis in ("time", "sci_time"):
            if axis in data.dims:
                data = data.isel({axis: (data[axis].values > low) & (data[axis].values < high)})
        data.to_netcdf(folder / "recording.nc")


def write_spiked(folder: Path, real: Path, truth: Mapping) -> None:
    """Write a mission of a real recording as a case with the effects of a truth put in."""
    write_plain(folder, real, truth["region"])
    with netCDF4.Dataset(folder / "recording.nc", "a") as data:
        columns = {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in data.variables.items()
            if variable.dimensions == ("time",) and variable.dtype.kind in "fi"
        }
        for name, values in spiked(columns, truth["effects"]).items():
            data[name][:] = np.where(np.isnan(values), data[name][:], values)


def spiked(columns: Mapping[str, Array], effects: Mapping[str, float]) -> Columns:
    """The columns that effects change, with the effects in; native names and units, positions in decimal degrees.

    Raises
    ------
    DataError : the recording lacks a sensor that an effect acts on.
    """
    out: Columns = {}
    merged = dict(columns)
    for key, value in effects.items():
        id, parameter = key.rsplit(".", 1)
        for need in _NEEDS.get(id, _NEEDS.get(id.split(".")[0], ())):
            if need not in columns:
                raise DataError(
                    f"recording: expected the sensor '{need}' for '{id}', found none. Leave it out."
                )
        changed = _ACTIONS[id](merged, parameter, value)
        merged |= changed
        out |= changed
    return out


def _pitch_gain(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return {"m_pitch": c["m_pitch"] / (1.0 + value)}


def _pitch_offset(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return {"m_pitch": c["m_pitch"] - value}


def _oil_gain(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return {name: c[name] / (1.0 + value) for name in ("m_ballast_pumped", "m_de_oil_vol") if name in c}


def _pressure_offset(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    """The vehicle's own gauge, and what it makes of it; the CTD has another."""
    metres = {name: c[name] + value for name in ("m_depth", "m_water_depth") if name in c}
    bars = {name: c[name] + BAR_PER_METRE * value for name in ("m_pressure", "m_water_pressure") if name in c}
    return metres | bars


def _declination(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return {"m_heading": np.mod(c["m_heading"] - value, 2 * np.pi)}


def _mean_current(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    """Fixes are carried along; reckoned positions begin anew at every surfacing and are moved by its first fix."""
    axis = "lon" if parameter == "east" else "lat"
    north, east = metres_per_degree(float(np.nanmean(c["m_gps_lat"])))
    degrees = value / (east if axis == "lon" else north)
    time = c["time"] - c["time"][0]
    fixes = np.isfinite(c[f"m_gps_{axis}"])
    moved = {f"m_gps_{axis}": c[f"m_gps_{axis}"] + degrees * time}
    reckoned = f"m_{axis}"
    if reckoned in c and fixes.any():
        when = time[fixes]
        last = np.clip(np.searchsorted(when, time, "right") - 1, 0, when.size - 1)
        moved[reckoned] = c[reckoned] + degrees * when[last]
    return moved


def _add_current(c: Mapping[str, Array], extra: Array) -> Columns:
    """Add amperes to the current and their integral to the charge."""
    step = np.diff(c["time"], prepend=c["time"][0])
    step = np.where(step > 600.0, 0.0, step)  # between files nothing is known
    return {
        "m_coulomb_current": c["m_coulomb_current"] + extra,
        "m_coulomb_amphr_total": c["m_coulomb_amphr_total"] + np.cumsum(extra * step) / 3600.0,
    }


def _voltage(c: Mapping[str, Array]) -> Array:
    known = np.isfinite(c["m_battery"])
    return np.interp(c["time"], c["time"][known], c["m_battery"][known])


def _filled(values: Array) -> Array:
    known = np.isfinite(values)
    return np.interp(np.arange(values.size), np.flatnonzero(known), values[known])


def _dive_load(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    diving = (_filled(c["m_pitch"]) < -0.15) & (_filled(c["m_depth"]) > 2.0)
    return _add_current(c, value / _voltage(c) * diving)


def _climb_load(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    climbing = (_filled(c["m_pitch"]) > 0.15) & (_filled(c["m_depth"]) > 2.0)
    return _add_current(c, value / _voltage(c) * climbing)


def _surface_load(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return _add_current(c, value / _voltage(c) * (_filled(c["m_depth"]) < 1.0))


def _current_gain(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    total = c["m_coulomb_amphr_total"]
    return {
        "m_coulomb_current": c["m_coulomb_current"] * (1.0 + value),
        "m_coulomb_amphr_total": total + value * (total - np.nanmin(total)),
    }


def _coulomb_gain(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    total = c["m_coulomb_amphr_total"]
    return {"m_coulomb_amphr_total": total + value * (total - np.nanmin(total))}


def _current_offset(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return _add_current(c, np.full(c["time"].size, value))


def _resistance(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    sag = value * _filled(c["m_coulomb_current"])
    return {name: c[name] - sag for name in ("m_battery", "m_battery_inst") if name in c}


_ACTIONS: dict[str, Callable[[Mapping[str, Array], str, float], Columns]] = {
    "flight.pitch_gain": _pitch_gain,
    "flight.pitch_offset": _pitch_offset,
    "flight.oil_gain": _oil_gain,
    "navigation.magnetic_declination": _declination,
    "navigation.mean_current": _mean_current,
    "energy.dive_only_load": _dive_load,
    "energy.climb_only_load": _climb_load,
    "energy.surface_load": _surface_load,
    "energy.internal_resistance": _resistance,
    "sensor.current_gain": _current_gain,
    "sensor.current_offset": _current_offset,
    "sensor.coulomb_gain": _coulomb_gain,
    "sensor.pressure_offset": _pressure_offset,
}
