"""Dead reckoning where the buoyancy is not known: the buoyancy that the recorded depth rate and pitch ask for.

NumPy only. A newcomer would get wrong: this is no measurement of buoyancy. It makes the replay glide through the water
exactly as fast as depth and pitch say, so that fixes can be compared with it; the vertical speed is used up by that
and is no evidence any more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from glider_jax.config import Vehicle
from glider_jax.environment import seawater
from glider_jax.inference.controls import Rows
from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Array, Recording

#: s; over which the slope of depth is taken. rad; flatter glides are not inverted, nor are paths at larger attack.
SLOPE, FLATTEST, LARGEST_ATTACK = 60.0, 0.15, 0.2
#: Share of the time under water with a thruster running above which buoyancy is not what drives the glider.
THRUSTED = 0.1
REFERENCE_TEMPERATURE = 288.15


def why_unknown(recording: Recording) -> str:
    """Why the buoyancy of a recording is not known; empty where it is."""
    if finite(recording, "pumped_volume")[0].size < 30:
        return "the pumped volume was not recorded"
    _, power = finite(recording, "thruster_power")
    if (power > 0.5).sum() > 5 and np.mean(power > 0.5) > THRUSTED:
        return "a thruster pushed the glider"
    return ""


def held(vehicle: Vehicle, recording: Recording) -> Vehicle:
    """The vehicle with flight numbers taken as exact where the buoyancy is not known.

    Depth rate and pitch then fix the speed; drag that was free could take for itself what the water did.
    """
    if not why_unknown(recording):
        return vehicle
    exact = {
        name: replace(quantity, sigma=0.0) if name.startswith("flight.") else quantity
        for name, quantity in vehicle.quantities.items()
    }
    return replace(vehicle, quantities=exact)


def from_depth_rate(rows: Rows, vehicle: Vehicle, latitude: float) -> Rows:
    """Rows whose pumped volume makes the vehicle's steady glide sink and rise as it was recorded; none is settled.

    Parameters
    ----------
    vehicle : whose drag and lift turn pitch into an angle of attack; its mass and volume cancel.
    latitude : rad.
    """
    rise = -slope(rows.time, rows.depth)
    steady = (rows.direction != 0.0) & (np.abs(rows.pitch) > FLATTEST) & (np.sign(rows.pitch) == np.sign(rise))

    def number(name: str) -> float:
        return vehicle.quantities[name].value if name in vehicle.quantities else 0.0

    force = glide_force(
        np.abs(rise), np.maximum(np.abs(rows.pitch), FLATTEST), rows.density, number("flight.wing_area"),
        number("flight.parasite_drag"), number("flight.induced_drag"), number("flight.lift_slope"),
    )  # fmt: skip
    pressure = np.asarray(seawater.pressure_from_depth(np.maximum(rows.depth, 0.0), latitude))
    shrunk = number("flight.thermal_expansion") * (rows.temperature - REFERENCE_TEMPERATURE)
    shrunk = shrunk - number("flight.hull_compressibility") * pressure
    neutral = number("flight.mass") / rows.density - number("flight.volume") * (1.0 + shrunk)
    push = np.where(steady, np.sign(rise) * force, 0.0) / (float(seawater.gravity(latitude)) * rows.density)
    return replace(
        rows, volume=neutral + push, thruster=np.zeros_like(rows.thruster), settled=np.zeros(rows.time.size, bool)
    )


def glide_force(
    rise: Array, pitch: Array, density: Array, area: float, parasite: float, induced: float, lift: float
) -> Array:
    """Net buoyancy in N behind a steady glide of a vertical speed and pitch; magnitudes.

    Merckelbach et al. (2010): lift balances drag across the path, buoyancy the drag along it.
    """
    attack = np.zeros_like(pitch)
    for _ in range(12):
        attack = (parasite + induced * attack**2) / (lift * np.tan(pitch + attack))
        attack = np.minimum(attack, LARGEST_ATTACK)
    path = pitch + attack
    speed = rise / np.sin(path)
    return 0.5 * density * area * (parasite + induced * attack**2) * speed**2 / np.sin(path)


def slope(time: Array, values: Array) -> Array:
    """Least-squares slope within ``SLOPE`` s around every sample."""
    low = np.searchsorted(time, time - 0.5 * SLOPE)
    high = np.searchsorted(time, time + 0.5 * SLOPE, side="right")
    t = time - time[0]
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (np.ones_like(t), t, values, t * values, t * t)]
    n, st, sz, stz, stt = (s[high] - s[low] for s in sums)
    under = n * stt - st * st
    return np.where((n > 2) & (under > 1e-6), (n * stz - st * sz) / np.where(under > 1e-6, under, 1.0), 0.0)
