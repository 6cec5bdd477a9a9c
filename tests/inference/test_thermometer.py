"""The lag of a thermometer behind its conductivity cell, in water whose layers heave between dive and climb."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.environment import seawater
from glider_jax.inference.controls import thermometer_lag
from glider_jax.readers.dives import ASCENT, DESCENT, Leg


def cast(lag, *, heave=2.0, layered=True, dives=12, seed=0):
    """Times, temperatures degC, conductivities, depths and legs of yos between 5 and 95 m at 0.2 m/s, 4 s rows."""
    rng = np.random.default_rng(seed)
    half = 450.0
    time = np.arange(0.0, 2 * dives * half, 4.0)
    phase = (time // half).astype(int)
    since = time - half * phase
    depth = np.where(phase % 2 == 0, 5.0 + 0.2 * since, 95.0 - 0.2 * since)
    moved = heave * rng.normal(size=2 * dives)

    def water(t):
        k = np.clip((t // half).astype(int), 0, 2 * dives - 1)
        s = t - half * k
        z = np.where(k % 2 == 0, 5.0 + 0.2 * s, 95.0 - 0.2 * s) - moved[k]
        step = np.tanh((z - 40.0) / 8.0) if layered else 0.0 * z
        return 12.0 - 4.0 * step, 33.0 + 0.8 * step

    warm, salt = water(time)
    latitude = np.radians(45.0)
    pressure = seawater.pressure_dbar_from_depth(depth, latitude)
    trials = np.linspace(2.0, 6.0, 400)
    cell = np.empty_like(warm)
    for k in range(warm.size):
        cell[k] = np.interp(salt[k], np.asarray(seawater.practical_salinity(trials, warm[k], pressure[k])), trials)
    shown = np.interp(time - lag, time, warm) + 0.001 * rng.normal(size=time.size)
    legs = [
        Leg(half * k, half * (k + 1), *((5.0, 95.0, DESCENT, -0.45) if k % 2 == 0 else (95.0, 5.0, ASCENT, 0.45)))
        for k in range(2 * dives)
    ]
    return time, shown, cell, time, depth, legs, latitude


@pytest.mark.parametrize("lag", (0.5, 1.5))
def test_a_lag_is_found_though_layers_heave(lag):
    """Layers that heave by 2 m between a dive and its climb hide no lag of half a second."""
    assert thermometer_lag(*cast(lag)) == pytest.approx(lag, abs=0.08)


def test_no_lag_is_claimed_where_there_is_none():
    """Neither in layered water without a lag, nor in mixed water with one, which nothing there tells."""
    assert abs(thermometer_lag(*cast(0.0))) < 0.08
    assert thermometer_lag(*cast(1.0, layered=False)) == 0.0
