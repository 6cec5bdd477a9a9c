"""Artificial oceans against their formulas, and the errors a settings file can cause."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.environment.synthetic import BATHYMETRY, CURRENTS, synthetic_bathymetry, synthetic_currents
from glider_jax.errors import ConfigError

# Lengths of a degree at 39.2 N: 111,033 m along the meridian, 86,372 m along the parallel (WGS84 tables).
MERIDIAN, PARALLEL = 111_018.0, 86_365.0


def metres(grid):
    """x and y of a grid's points from rough table values, good to one part in a thousand."""
    x = (grid.longitude + 73.5) * PARALLEL
    y = (grid.latitude - 39.2) * MERIDIAN
    return np.meshgrid(x, y)


@pytest.mark.parametrize("kind", CURRENTS)
def test_every_current_is_a_whole_record(kind):
    grid = synthetic_currents(kind, width=50e3, height=80e3, duration=86400.0, error=0.04)
    shape = (grid.time.size, grid.depth.size, grid.latitude.size, grid.longitude.size)
    assert grid.east.shape == grid.north.shape == grid.east_sd.shape == shape
    assert np.isfinite(grid.east).all() and np.isfinite(grid.north).all() and grid.sea.all()
    for axis in (grid.latitude, grid.longitude):
        assert (np.diff(axis) > 0).all()
    assert np.ptp(grid.latitude) * MERIDIAN == pytest.approx(80e3, rel=2e-3)
    assert np.ptp(grid.longitude) * PARALLEL == pytest.approx(50e3, rel=2e-3)
    assert grid.constant_in_time == (grid.time.size == 1)
    assert grid.time[0] == 1252108800.0
    assert kind in grid.source.product


@pytest.mark.parametrize("kind", BATHYMETRY)
def test_every_seafloor_is_a_whole_record(kind):
    grid = synthetic_bathymetry(kind, width=50e3, height=80e3)
    assert grid.depth.shape == (grid.latitude.size, grid.longitude.size)
    assert np.isfinite(grid.depth).all() and grid.depth.max() > 0


def test_uniform():
    grid = synthetic_currents("uniform", east=0.1, north=-0.2)
    assert (grid.east == 0.1).all() and (grid.north == -0.2).all()


def test_shear_grows_northward():
    grid = synthetic_currents("shear", rate=2e-6, east=0.05)
    np.testing.assert_allclose(grid.east[0, 0], 0.05 + 2e-6 * metres(grid)[1], atol=1e-3)
    assert grid.east[0, 0, -1, 0] > grid.east[0, 0, 0, 0]


def test_gyre_turns_anticlockwise_about_the_centre():
    grid = synthetic_currents("gyre", rate=1e-6)
    x, y = metres(grid)
    np.testing.assert_allclose(grid.east[0, 0], -1e-6 * y, atol=1e-3)
    np.testing.assert_allclose(grid.north[0, 0], 1e-6 * x, atol=1e-3)
    assert grid.north[0, 0, 4, -1] > 0.19 and grid.north[0, 0, 4, 0] < -0.19


def test_shelf_jet_has_its_speed_bearing_and_width():
    grid = synthetic_currents("shelf_jet", speed=0.4, bearing_deg=225.0, half_width=20e3)
    x, y = metres(grid)
    size = np.hypot(grid.east[0, 0], grid.north[0, 0])
    assert size.max() == pytest.approx(0.4, rel=2e-3)
    np.testing.assert_allclose(grid.east[0, 0], grid.north[0, 0], atol=1e-12)
    assert (grid.east <= 0).all()
    np.testing.assert_allclose(size, 0.4 * np.exp(-((x - y) ** 2 / 2) / 20e3**2), atol=3e-3)
    moved = synthetic_currents("shelf_jet", speed=0.4, bearing_deg=0.0, offset=30e3)
    peak = moved.longitude[moved.north[0, 0, 0].argmax()]
    assert (peak + 73.5) * PARALLEL == pytest.approx(-30e3, abs=2e3)


def test_tide_turns_clockwise_with_its_axes_and_phase():
    grid = synthetic_currents("tide", major=0.12, minor=-0.05, inclination_deg=30.0, phase_deg=90.0, period=43200.0)
    flow = (grid.east + 1j * grid.north)[:, 0, 0, 0] * np.exp(-1j * np.radians(30.0))
    hours = (grid.time - grid.time[0]) / 3600.0
    np.testing.assert_allclose(flow.real, 0.12 * np.sin(2 * np.pi * hours / 12.0), atol=1e-12)
    np.testing.assert_allclose(flow.imag, 0.05 * np.cos(2 * np.pi * hours / 12.0), atol=1e-12)
    turning = np.angle(flow[1:] * np.conj(flow[:-1]))
    assert (turning < 0).all()


@pytest.mark.parametrize(("latitude", "sense"), [(39.0, -1.0), (-39.0, 1.0)])
def test_inertial_period_and_decay(latitude, sense):
    grid = synthetic_currents("inertial", latitude=latitude, speed=0.2, decay=172800.0, onset=7200.0)
    flow = (grid.east + 1j * grid.north)[:, 0, 0, 0]
    since = grid.time - grid.time[0] - 7200.0
    assert (flow[since < 0] == 0).all()
    on = since >= 0
    # 12 h / sin(latitude) pendulum half-days: 19.0 h at 39 degrees.
    angle = np.unwrap(np.angle(flow[on]))
    period = 2 * np.pi / abs(np.polyfit(since[on], angle, 1)[0]) / 3600.0
    assert period == pytest.approx(19.02, abs=0.02)
    assert np.sign(np.diff(angle)[0]) == sense
    np.testing.assert_allclose(np.abs(flow[on]), 0.2 * np.exp(-since[on] / 172800.0), rtol=1e-9)


def test_depth_shear_is_linear():
    grid = synthetic_currents("depth_shear", depth=80.0, surface_east=0.3, bottom_east=-0.1, bottom_north=0.2, levels=5)
    np.testing.assert_allclose(grid.depth, [0, 20, 40, 60, 80])
    np.testing.assert_allclose(grid.east[0, :, 3, 3], [0.3, 0.2, 0.1, 0.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(grid.north[0, :, 3, 3], [0.0, 0.05, 0.1, 0.15, 0.2], atol=1e-12)
    assert grid.depth_resolved


def test_seafloors():
    assert (synthetic_bathymetry("flat", depth=75.0).depth == 75.0).all()
    plane = synthetic_bathymetry("sloping", depth=60.0, slope=1e-3, bearing_deg=90.0)
    np.testing.assert_allclose(plane.depth, 60.0 + 1e-3 * metres(plane)[0], atol=0.3)
    assert plane.depth.min() < 0
    assert synthetic_bathymetry("sloping", depth=60.0, least=10.0).depth.min() == 10.0
    cut = synthetic_bathymetry("canyon", depth=100.0, slope=0.0, bearing_deg=180.0, relief=250.0, half_width=5e3)
    x, _ = metres(cut)
    np.testing.assert_allclose(cut.depth, 100.0 + 250.0 * np.exp(-((x / 5e3) ** 2)), atol=0.5)
    edge = synthetic_bathymetry("shelf", bearing_deg=90.0)
    x, _ = metres(edge)
    row = edge.depth[edge.depth.shape[0] // 2]
    assert row[0] < 0 and np.interp(0.0, x[0], row) == pytest.approx(62.5, abs=0.5)
    assert np.interp(70e3, x[0], row) == pytest.approx(120.0 + 0.03 * 10e3, abs=10.0)


@given(east=st.floats(-1, 1), north=st.floats(-1, 1), rate=st.floats(-5e-6, 5e-6), spacing=st.floats(5e3, 1e5))
@settings(max_examples=25, deadline=None)
def test_linear_fields_do_not_depend_on_the_spacing(east, north, rate, spacing):
    fine = synthetic_currents("gyre", rate=rate, east=east, north=north, width=2e5, height=1e5, spacing=spacing)
    coarse = synthetic_currents("gyre", rate=rate, east=east, north=north, width=2e5, height=1e5)
    for name in ("east", "north"):
        a, b = getattr(fine, name)[0, 0], getattr(coarse, name)[0, 0]
        np.testing.assert_allclose(a[[0, 0, -1, -1], [0, -1, 0, -1]], b[[0, 0, -1, -1], [0, -1, 0, -1]], atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "parameters", "words"),
    [
        ("gire", {}, "Did you mean 'gyre'"),
        ("uniform", {"est": 0.1}, "Did you mean 'east'"),
        ("uniform", {"east": "fast"}, "east.*finite number.*'fast'"),
        ("uniform", {"east": float("nan")}, "finite"),
        ("uniform", {"east": True}, "finite"),
        ("tide", {"period": 0.0}, "period.*above zero"),
        ("shear", {"width": -1.0}, "width.*above zero"),
        ("gyre", {"latitude": 95.0}, "85 S"),
        ("gyre", {"start": "yesterday"}, "start.*yesterday"),
        ("shelf_jet", {"spacing": 10.0}, "wider spacing"),
        ("depth_shear", {"levels": 1}, "levels"),
    ],
)
def test_settings_errors(kind, parameters, words):
    with pytest.raises(ConfigError, match=words):
        synthetic_currents(kind, **parameters)


def test_seafloor_settings_errors():
    with pytest.raises(ConfigError, match="Did you mean 'sloping'"):
        synthetic_bathymetry("slopin")
    with pytest.raises(ConfigError, match="Did you mean 'depth'"):
        synthetic_bathymetry("flat", dept=20.0)


def test_start_may_be_a_number_or_a_date():
    assert synthetic_currents("uniform", start=1000.0).time[0] == 1000.0
    assert synthetic_currents("uniform", start="1970-01-02").time[0] == 86400.0
    assert synthetic_currents("uniform", start=datetime(1970, 1, 2, tzinfo=UTC)).time[0] == 86400.0
    assert synthetic_currents("uniform", start="1970-01-02T01:00:00+01:00").time[0] == 86400.0
