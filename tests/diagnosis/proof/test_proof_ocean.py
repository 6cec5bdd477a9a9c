"""Oceans of the proof: geometry, noise, currents and sea water against independent values."""

from __future__ import annotations

import gsw
import numpy as np
import pytest

from glider_jax.diagnosis.proof.cases import REGIONS
from glider_jax.diagnosis.proof.ocean import (
    DAY,
    HOUR,
    M2,
    SALINITY_RATIO,
    TABLE_STEP,
    Ocean,
    conductivity,
    in_situ_temperature,
    metres_per_degree,
    pressure_of,
    red_noise,
)


@pytest.fixture(scope="module")
def ocean():
    return Ocean(REGIONS[1], np.random.default_rng(4), 1.0 * DAY)


def test_a_degree_is_as_long_as_on_the_ellipsoid():
    north, east = metres_per_degree(45.0)  # published lengths of a degree on WGS 84
    assert north == pytest.approx(111131.7, abs=0.5)
    assert east == pytest.approx(78846.8, abs=0.5)


def test_pressure_is_that_of_a_standard_ocean():
    depth = np.array([1.0, 40.0, 100.0, 200.0])
    assert pressure_of(depth) == pytest.approx(gsw.p_from_z(-depth, 45.0), rel=5e-4)


def test_conductivity_inverts_the_salinity_scale():
    salinity, temperature, dbar = (
        np.array([8.0, 31.9, 36.3]),
        np.array([4.0, 7.7, 29.0]),
        np.array([0.0, 150.0, 60.0]),
    )
    assert conductivity(salinity, temperature, dbar) == pytest.approx(
        gsw.C_from_SP(salinity, temperature, dbar) / 10.0, rel=1e-9
    )


def test_red_noise_has_its_spread_and_memory():
    x = red_noise(np.random.default_rng(0), 60000, 60.0, 0.3, 600.0)
    assert x.std() == pytest.approx(0.3, rel=0.06)
    assert np.mean(x[10:] * x[:-10]) / x.var() == pytest.approx(np.exp(-1.0), abs=0.05)


def test_density_table_is_that_of_the_profile(ocean):
    rho, temperature = ocean.table(3000.0)
    depth = np.arange(rho.size) * TABLE_STEP
    conservative, salinity = ocean.profile(depth, 3000.0)
    exact = gsw.rho(salinity * SALINITY_RATIO, conservative, pressure_of(depth))
    assert rho == pytest.approx(exact, abs=1e-5)
    assert temperature == pytest.approx(conservative)
    assert np.all(np.diff(rho[20:]) > 0)
    in_situ = in_situ_temperature(salinity, conservative, pressure_of(depth))
    assert in_situ == pytest.approx(
        gsw.t_from_CT(salinity * SALINITY_RATIO, conservative, pressure_of(depth)), abs=2e-3
    )


def test_the_product_knows_the_tide(ocean):
    time = np.arange(0, 12 * HOUR, 600.0)
    u, v = ocean.resolved(np.zeros(time.size), np.zeros(time.size), time)
    u2, _ = ocean.resolved(np.zeros(time.size), np.zeros(time.size), time + np.pi / M2)
    amplitude = REGIONS[1].tide[0]
    # Half a period apart the tide has turned round, the slow currents have hardly changed.
    assert np.ptp(u - u2) == pytest.approx(4 * amplitude, rel=0.35)
    assert np.abs(u).max() < 1.0 and np.abs(v).max() < 1.0


def test_currents_do_not_jump_in_time_or_space(ocean):
    time = np.arange(0, 20 * HOUR, 60.0)
    u, _ = ocean.resolved(np.zeros(time.size), np.zeros(time.size), time)
    assert np.abs(np.diff(u)).max() < 0.01
    x = np.arange(-4e4, 4e4, 500.0)
    u, _ = ocean.resolved(x, np.zeros(x.size), np.array(7 * HOUR))
    assert np.abs(np.diff(u)).max() < 0.02


def test_vertical_motion_is_that_of_a_shelf(ocean):
    assert 0.002 < ocean.vertical.std() < 0.008
    assert abs(ocean.vertical.mean()) < 0.001
