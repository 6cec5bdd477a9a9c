"""Sea water against the reference implementation of TEOS-10, in NumPy and JAX."""

from __future__ import annotations

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.environment import seawater

gsw = pytest.importorskip("gsw")


@pytest.fixture(autouse=True)
def double():
    """Double precision."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("strict"):
        yield


@pytest.fixture(scope="module")
def water():
    """Salinity, temperature and pressure over the whole ocean."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.0, 42.0, 20000), rng.uniform(-2.0, 35.0, 20000), rng.uniform(0.0, 6000.0, 20000)


def test_density_against_the_reference(water):
    """The 75-term polynomial to rounding, in NumPy and in JAX."""
    reference = gsw.rho(*water)
    assert np.abs(seawater.density(*water) - reference).max() < 1e-11
    traced = jax.jit(seawater.density)(*map(jnp.asarray, water))
    assert traced.dtype == jnp.float64
    assert np.abs(np.asarray(traced) - reference).max() < 1e-11


def test_density_check_value():
    """The check values of the TEOS-10 manual for the density of the 75-term expression."""
    salinity = np.array([34.7118, 34.8915, 35.0256, 34.8472, 34.7366, 34.7324])
    temperature = np.array([28.8099, 28.4392, 22.7862, 10.2262, 6.8272, 4.3236])
    pressure = np.array([10.0, 50.0, 125.0, 250.0, 600.0, 1000.0])
    expected = [1021.839935738108, 1022.262457966867, 1024.427195413316, 1027.790152759127, 1029.837779000189,
                1032.002453224572]  # fmt: skip
    np.testing.assert_allclose(seawater.density(salinity, temperature, pressure), expected, rtol=1e-12)


def test_density_derivatives():
    """Thermal expansion and haline contraction by differentiation."""
    point = [jnp.asarray(x) for x in (35.0, 10.0, 500.0)]
    slope = jax.grad(seawater.density, argnums=(0, 1))(*point)
    rho = float(seawater.density(*point))
    assert float(slope[0]) / rho == pytest.approx(gsw.beta(35.0, 10.0, 500.0), rel=1e-10)
    assert -float(slope[1]) / rho == pytest.approx(gsw.alpha(35.0, 10.0, 500.0), rel=1e-10)


def test_single_precision_density(water):
    """float32 stays float32 and within 1 g m-3."""
    singles = [jnp.asarray(x, jnp.float32) for x in water]
    found = seawater.density(*singles)
    assert found.dtype == jnp.float32
    assert np.abs(np.asarray(found, float) - gsw.rho(*water)).max() < 1e-3


def test_pressure_and_depth_against_the_reference():
    """Both ways, to rounding, from 80 S to 80 N and to 1500 m."""
    rng = np.random.default_rng(2)
    degrees, depth = rng.uniform(-80, 80, 5000), rng.uniform(0, 1500, 5000)
    pressure = seawater.pressure_dbar_from_depth(depth, np.radians(degrees))
    assert np.abs(pressure - gsw.p_from_z(-depth, degrees)).max() < 1e-6
    assert np.abs(seawater.depth_from_pressure_dbar(pressure, np.radians(degrees)) - depth).max() < 1e-9
    np.testing.assert_allclose(
        seawater.gravity(np.radians(degrees)), gsw.grav(degrees, 0.0 * degrees), rtol=1e-14
    )


def test_pascals_and_decibars():
    """SI names give pascals; 1 dbar is 1e4 Pa."""
    assert seawater.pressure_from_depth(100.0, 0.7) == pytest.approx(1.008e6, rel=2e-3)
    assert seawater.depth_from_pressure(seawater.pressure_from_depth(321.0, 0.7), 0.7) == pytest.approx(321.0)


@settings(max_examples=60, deadline=None)
@given(depth=st.floats(0.0, 6000.0), latitude=st.floats(-1.5, 1.5))
def test_depth_round_trip(depth, latitude):
    """Depth to pressure and back."""
    back = seawater.depth_from_pressure_dbar(seawater.pressure_dbar_from_depth(depth, latitude), latitude)
    assert back == pytest.approx(depth, abs=1e-6)


@pytest.fixture(scope="module")
def casts():
    """Conductivity, temperature and pressure of sea water of 2 to 42."""
    rng = np.random.default_rng(3)
    conductivity, celsius, dbar = (
        rng.uniform(0.3, 6.5, 9000),
        rng.uniform(-1, 34, 9000),
        rng.uniform(0, 1500, 9000),
    )
    salinity = gsw.SP_from_C(10.0 * conductivity, celsius, dbar)
    keep = (salinity > 2.0) & (salinity < 40.0) & (celsius > -0.06 * salinity)
    return conductivity[keep], celsius[keep], dbar[keep], salinity[keep]


def test_practical_salinity(casts):
    """The scale of 1978 to rounding."""
    assert np.abs(seawater.practical_salinity(*casts[:3]) - casts[3]).max() < 1e-11
    assert seawater.practical_salinity(4.2914, 15.0 / 1.00024, 0.0) == pytest.approx(35.0, abs=2e-7)


def test_temperatures(casts):
    """Conservative temperature within 2 mK, and its inverse to a microkelvin."""
    _, celsius, dbar, practical = casts
    salinity = seawater.absolute_salinity(practical)
    conservative = seawater.conservative_temperature(salinity, celsius, dbar)
    assert np.abs(conservative - gsw.CT_from_t(salinity, celsius, dbar)).max() < 2.1e-3
    assert np.abs(seawater.temperature_from_conservative(salinity, conservative, dbar) - celsius).max() < 1e-6


def test_density_of_a_ctd(casts):
    """From raw channels to density within 2 g m-3 of the exact Gibbs function."""
    conductivity, celsius, dbar, practical = casts
    exact = gsw.rho_t_exact(practical * 35.16504 / 35.0, celsius, dbar)
    assert np.abs(seawater.density_from_ctd(conductivity, celsius, dbar) - exact).max() < 2e-3


def test_readers_may_use_it_without_jax():
    """Importing and using the module leaves JAX out."""
    code = (
        "import sys; from glider_jax.environment import seawater as s; s.density(35.0, 10.0, 0.0); "
        "s.pressure_from_depth(10.0, 0.7); sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
