"""The water column that flight tables are made for: a hydrographic profile, or what the vehicle is trimmed to."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.environment.fields import on_device
from glider_jax.environment.seawater import (
    density,
    pressure_dbar_from_depth,
    pressure_from_depth,
    temperature_from_conservative,
)
from glider_jax.mission.ensemble import Column
from glider_jax.records import WaterProfile

_KELVIN = 273.15
SHALLOW_LEVELS, DEEP_LEVELS = 24, 48


def make_column(water: WaterProfile | None, vehicle: Vehicle, mission: Mission, latitude: float, *, dtype=jnp.float32):
    """Water properties at the middles of layers that reach a little below the deepest dive.

    Without a profile the column is uniform, with the density at which dives and climbs are driven equally at half
    depth (mass over the hull's volume there); the note says so.

    Parameters
    ----------
    latitude : degrees.

    Returns
    -------
    Column, the mean temperature (K) over the dive, and notes for the user.
    """
    deepest = mission.yo.dive_to + 15.0
    levels = SHALLOW_LEVELS if deepest <= 200.0 else DEEP_LEVELS
    step = deepest / levels
    depth = (np.arange(levels) + 0.5) * step
    phi = math.radians(latitude)
    pressure = np.asarray(pressure_from_depth(depth, phi), float)
    notes: list[str] = []
    if water is None:
        squeeze = 1.0 - vehicle.value("flight.hull_compressibility") * float(np.interp(0.5 * deepest, depth, pressure))
        trimmed = vehicle.value("flight.mass") / (vehicle.value("flight.volume") * squeeze)
        temperature = np.full(levels, 288.15)
        rho = np.full(levels, trimmed)
        notes.append(f"no hydrography given: uniform water of {trimmed:.2f} kg/m3, the vehicle's trim, assumed")
    else:
        dbar = np.asarray(pressure_dbar_from_depth(depth, phi), float)
        ct = np.interp(depth, water.depth, water.conservative_temperature)
        sa = np.interp(depth, water.depth, water.absolute_salinity)
        rho = np.asarray(density(sa, ct, dbar), float)
        temperature = np.asarray(temperature_from_conservative(sa, ct, dbar), float) + _KELVIN
        if water.depth[-1] < mission.yo.dive_to:
            notes.append(f"hydrography ends at {water.depth[-1]:.0f} m: its deepest value is used below")
    flown = depth <= mission.yo.dive_to
    mean = float(np.mean(temperature[flown])) if flown.any() else float(temperature[0])
    return Column(*(on_device(v, dtype) for v in (depth, pressure, temperature, rho, step))), mean, notes
