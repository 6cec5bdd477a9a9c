"""Effects concealed in real recordings: the sensors' values changed as the effect would have changed them.

Imports NumPy and netCDF4. Only effects that act on what was recorded, not on how the glider flew, can be put in
exactly. A recording keeps its own noise, faults and natural effects; what a diagnosis names of the recording as it
is, is known too, and does not count as found.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import netCDF4
import numpy as np
from numpy.typing import NDArray

from glider_jax.diagnosis.proof.ocean import metres_per_degree
from glider_jax.errors import ConfigError, DataError

Array = NDArray[np.float64]
Columns = dict[str, Array]

DAY = 86400.0
#: File below the folder of real recordings, and the vehicle file that describes its glider best.
RECORDINGS = {
    "comet2019": ("comet2019/comet2019.nc", "vehicles/slocum_g1_comet.toml"),
    "osu684_2025": ("osu684_2025/osu684_2025.nc", "vehicles/slocum_g3.toml"),
}

#: Sizes to put in, by ``id.parameter``: large enough that a pilot would want to know.
SIZES: dict[str, dict[str, float]] = {
    "flight.pitch_gain": {"gain": -0.12},
    "flight.pitch_offset": {"offset": 0.05},
    "navigation.magnetic_declination": {"angle": 0.25},
    "navigation.mean_current": {"east": 0.15, "north": -0.1},
    "energy.dive_only_load": {"power": 1.0},
    "energy.surface_load": {"power": 2.0},
    "energy.internal_resistance": {"resistance": 0.4},
    "sensor.current_gain": {"gain": 0.1},
    "sensor.current_offset": {"offset": 0.05},
}
_NEEDS = {
    "flight": ("m_pitch",),
    "navigation.magnetic_declination": ("m_heading",),
    "navigation.mean_current": ("m_gps_lat", "m_gps_lon"),
    "energy.internal_resistance": ("m_coulomb_current", "m_battery"),
    "energy": ("m_coulomb_current", "m_coulomb_amphr_total", "m_battery", "m_pitch"),
    "sensor": ("m_coulomb_current", "m_coulomb_amphr_total"),
}


def available(real: Path) -> list[tuple[str, str]]:
    """Recording and effect of every case that the folder's recordings allow.

    Raises
    ------
    ConfigError : no known recording lies in the folder.
    """
    found = [name for name, (file, _) in RECORDINGS.items() if (real / file).exists()]
    if not found:
        files = ", ".join(file for file, _ in RECORDINGS.values())
        raise ConfigError(f"{real}: expected one of the recordings {files}, found none. Give another folder.")
    return [(name, id) for name in found for id in SIZES]


def truth_of(recording: str, id: str, factor: float, name: str) -> dict:
    """The truth of a spiked case, in the layout of the simulated ones."""
    effects = {f"{id}.{p}": value * factor for p, value in SIZES[id].items()}
    return {
        "name": name, "kind": "real", "region": recording, "seed": 0, "effects": effects, "strengths": {id: None},
        "faint": {}, "product": True, "constants": {},
    }  # fmt: skip


def write_spiked(folder: Path, real: Path, truth: Mapping, *, plain: bool = False) -> None:
    """Copy a real recording into a case with the effects of a truth put in, beside its vehicle file.

    ``plain`` copies it as it is. The copy lies in the case's folder only, which a run removes when it is done.
    """
    from glider_jax_data import path as bundled

    file, vehicle = RECORDINGS[truth["region"]]
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(bundled(vehicle), folder / "vehicle.toml")
    target = folder / "recording.nc"
    shutil.copyfile(real / file, target)
    target.chmod(0o644)
    if plain:
        return
    with netCDF4.Dataset(target, "a") as data:
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


def _surface_load(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return _add_current(c, value / _voltage(c) * (_filled(c["m_depth"]) < 1.0))


def _current_gain(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    total = c["m_coulomb_amphr_total"]
    return {
        "m_coulomb_current": c["m_coulomb_current"] * (1.0 + value),
        "m_coulomb_amphr_total": total + value * (total - np.nanmin(total)),
    }


def _current_offset(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    return _add_current(c, np.full(c["time"].size, value))


def _resistance(c: Mapping[str, Array], parameter: str, value: float) -> Columns:
    sag = value * _filled(c["m_coulomb_current"])
    return {name: c[name] - sag for name in ("m_battery", "m_battery_inst") if name in c}


_ACTIONS: dict[str, Callable[[Mapping[str, Array], str, float], Columns]] = {
    "flight.pitch_gain": _pitch_gain,
    "flight.pitch_offset": _pitch_offset,
    "navigation.magnetic_declination": _declination,
    "navigation.mean_current": _mean_current,
    "energy.dive_only_load": _dive_load,
    "energy.surface_load": _surface_load,
    "energy.internal_resistance": _resistance,
    "sensor.current_gain": _current_gain,
    "sensor.current_offset": _current_offset,
}
