"""Tidal ellipses, the current at a time, and the tide added to slow currents."""

from __future__ import annotations

from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.roms import read_roms_currents
from glider_jax.readers.tides import add_tides, from_ellipse, read_tides, tidal_currents, tidal_grid, to_ellipse
from glider_jax.records import CurrentGrid, Source, TidalGrid
from tests.readers.roms_layouts import World

SANDY = ("environment", "roms_coawst_sandy")
M2_HOURS = 12.4206012
START = 1351382400.0  # 2012-10-28T00:00Z


def write_tides(path, world, *, periods=(M2_HOURS, 23.93447213), reference=20121028.0, drop=(), values=None):
    """A forcing file in the layout of the real one: ellipses by period, no positions."""
    ellipse = {"tide_Cmax": 0.3, "tide_Cmin": -0.1, "tide_Cangle": 30.0, "tide_Cphase": 70.0} | (values or {})
    with netCDF4.Dataset(path, "w") as data:
        for name, size in (("tide_period", len(periods)), ("erho", world.ny), ("xrho", world.nx)):
            data.createDimension(name, size)
        period = data.createVariable("tide_period", "f8", ("tide_period",))
        period.units, period[:] = "hours", periods
        for name, value in ellipse.items():
            if name not in drop:
                variable = data.createVariable(name, "f8", ("tide_period", "erho", "xrho"))
                variable.units = "meter second-1" if name in ("tide_Cmax", "tide_Cmin") else "degrees"
                variable[:] = value if np.ndim(value) == 0 else np.asarray(value)[:, None, None]
        if reference is not None:
            zero = data.createVariable("zero_phase_date", "f8", ())
            zero.units, zero[...] = "days as %Y%m%d.%f", reference
    return path


@pytest.fixture
def files(tmp_path):
    """A tide file and its grid, turned by 36 degrees, which must not turn the ellipses."""
    world = World()
    return write_tides(tmp_path / "tide.nc", world), world.write_grid(tmp_path / "grid.nc")


@settings(max_examples=60, deadline=None)
@given(
    major=st.floats(0.01, 2.0),
    ratio=st.floats(-0.95, 0.95),
    inclination=st.floats(0.0, 3.14),
    phase=st.floats(0.0, 6.28),
    theta=st.floats(0.0, 6.28),
)
def test_ellipse_is_the_current_that_roms_takes_from_it(major, ratio, inclination, phase, theta):
    """The complex amplitudes give the forcing formula at any time, and the ellipse comes back."""
    minor = ratio * major
    east, north = from_ellipse(major, minor, inclination, phase)
    cosine, sine = np.cos(theta - phase), np.sin(theta - phase)
    u = major * np.cos(inclination) * cosine - minor * np.sin(inclination) * sine
    v = major * np.sin(inclination) * cosine + minor * np.cos(inclination) * sine
    turn = np.exp(-1j * theta)
    assert (east * turn).real == pytest.approx(u, abs=1e-12)
    assert (north * turn).real == pytest.approx(v, abs=1e-12)
    back = to_ellipse(east, north)
    assert back[0] == pytest.approx(major) and back[1] == pytest.approx(minor, abs=1e-12)
    assert 0 <= back[2] < np.pi and 0 <= back[3] <= 2 * np.pi
    again = from_ellipse(*back)
    np.testing.assert_allclose(again, (east, north), atol=1e-12)


def test_positive_minor_axis_turns_counter_clockwise():
    """A quarter period after running east the current runs north."""
    east, north = from_ellipse(0.3, 0.1, 0.0, 0.0)
    quarter = np.exp(-0.5j * np.pi)
    assert (east.real, north.real) == pytest.approx((0.3, 0.0))
    assert ((east * quarter).real, (north * quarter).real) == pytest.approx((0.0, 0.1))


def test_read_forcing_file(files):
    """Names by period, reference date, amplitudes on a regular grid, NaN outside the turned grid."""
    tides = read_tides(files[0], grid=files[1])
    assert tides.names == ("M2", "K1") and tides.reference_time == START
    np.testing.assert_allclose(tides.omega, 2 * np.pi / (3600 * np.array([M2_HOURS, 23.93447213])))
    known = np.isfinite(tides.east[0])
    assert 0.4 < known.mean() < 1 and np.isnan(tides.east[0, 0, 0])
    major, minor, inclination, phase = to_ellipse(tides.east[0][known], tides.north[0][known])
    np.testing.assert_allclose(major, 0.3)
    np.testing.assert_allclose(minor, -0.1)
    np.testing.assert_allclose(np.degrees(inclination), 30.0)
    np.testing.assert_allclose(np.degrees(phase), 70.0)
    with pytest.raises(DataError, match="lon_rho.*give that as grid"):
        read_tides(files[0])


def test_current_at_a_time(files):
    """At zero phase plus 70 degrees of M2 the current of M2 runs along 30 degrees from east."""
    tides = read_tides(files[0], grid=files[1])
    alone = replace(tides, names=("M2",), omega=tides.omega[:1], east=tides.east[:1], north=tides.north[:1])
    crest = START + M2_HOURS * 3600 * 70 / 360
    east, north = tidal_currents(alone, crest)
    assert east.shape == tides.east.shape[1:]
    assert np.nanmax(np.abs(east - 0.3 * np.cos(np.radians(30)))) < 1e-9
    assert np.nanmax(np.abs(north - 0.3 * np.sin(np.radians(30)))) < 1e-9
    later, _ = tidal_currents(alone, crest + np.array([0.0, 0.5, 1.0]) * M2_HOURS * 3600)
    np.testing.assert_allclose(later[1], -later[0])
    np.testing.assert_allclose(later[2], later[0], atol=1e-9)
    field = tidal_grid(tides, START + 3600.0 * np.arange(4))
    assert field.east.shape == (4, 1, *tides.east.shape[1:]) and not field.depth_resolved
    np.testing.assert_allclose(field.north[2, 0], tidal_currents(tides, START + 7200.0)[1], rtol=1e-6)
    np.testing.assert_array_equal(field.sea, np.isfinite(tides.east[0]))


def test_constituents_that_say_nothing_are_dropped(tmp_path):
    """No period, or zero everywhere: dropped and told; unknown periods keep a name of their own."""
    world = World()
    grid = world.write_grid(tmp_path / "grid.nc")
    periods = (0.0, 12.42, 12.0, 17.5)
    path = write_tides(tmp_path / "t.nc", world, periods=periods, values={"tide_Cmax": (0.2, 0.3, 0.0, 0.1)})
    tides = read_tides(path, grid=grid)
    assert tides.names == ("M2", "T17.5000h")
    assert tides.omega[0] == pytest.approx(2 * np.pi / (M2_HOURS * 3600), rel=1e-12)
    notes = " ".join(tides.source.notes)
    assert "1 constituents without a period" in notes and "S2 is zero everywhere" in notes
    assert "M2: period 12.42 h taken as 12.4206 h" in notes
    still = write_tides(tmp_path / "still.nc", world, values={"tide_Cmax": 0.0, "tide_Cmin": 0.0})
    with pytest.raises(DataError, match="found zero or nothing everywhere"):
        read_tides(still, grid=grid)


def test_reference_time_from_each_place(tmp_path):
    """zero_phase_date, base_date, the argument, or a clear refusal."""
    world = World()
    grid = world.write_grid(tmp_path / "grid.nc")
    path = write_tides(tmp_path / "t.nc", world, reference=None)
    with pytest.raises(DataError, match="zero_phase_date.*TIDE_START"):
        read_tides(path, grid=grid)
    assert read_tides(path, grid=grid, reference_time="2006-01-01").reference_time == 1136073600.0
    with netCDF4.Dataset(path, "a") as data:
        data.base_date = "days since 2006-01-01 12:00:00"
    assert read_tides(path, grid=grid).reference_time == 1136073600.0 + 43200
    half = write_tides(tmp_path / "half.nc", world, reference=20121028.5)
    assert read_tides(half, grid=grid).reference_time == START + 43200


def test_sea_without_any_tide_is_unknown_and_not_still(tmp_path):
    """Points where every ellipse is zero lie outside the tidal model: NaN and counted; land follows the mask."""
    world = World(angle=0.0, land=(slice(0, 2), slice(None)))
    path = write_tides(tmp_path / "t.nc", world)
    with netCDF4.Dataset(path, "a") as data:
        data["tide_Cmax"][:, 5, 3:7] = 0.0
        data["tide_Cmin"][:, 5, 3:7] = 0.0
    tides = read_tides(path, grid=world.write_grid(tmp_path / "grid.nc"))
    assert np.isnan(tides.east[:, 5, 3:7]).all() and np.isnan(tides.east[:, :2]).all()
    assert np.isfinite(tides.east).mean() == pytest.approx((22 * 30 - 4) / (24 * 30))
    assert any("4 of 660 points at sea hold no tide" in note for note in tides.source.notes)


def test_bad_tide_files_are_explained(tmp_path):
    """Missing ellipses and areas elsewhere."""
    world = World()
    grid = world.write_grid(tmp_path / "grid.nc")
    path = write_tides(tmp_path / "t.nc", world, drop=("tide_Cmin", "tide_Cphase"))
    with pytest.raises(DataError, match="found no tide_Cmin, no tide_Cphase"):
        read_tides(path, grid=grid)
    whole = write_tides(tmp_path / "w.nc", world)
    with pytest.raises(CoverageError, match="Choose another file or area"):
        read_tides(whole, grid=grid, box=(40.0, 41.0, -75.0, -71.0))


def still_water(longitude, latitude, times, value=0.2):
    """Slow currents, the same everywhere, growing from 0 to ``value`` over the period."""
    east = np.linspace(0.0, value, len(times))[:, None, None, None] * np.ones((1, 2, latitude.size, longitude.size))
    return CurrentGrid(
        np.asarray(times), np.array([0.0, 50.0]), latitude, longitude, east, -east, Source("test", notes=("slow",))
    )


def plane_tide(longitude, latitude):
    """M2 whose amplitude grows linearly with longitude and latitude."""
    lon, lat = np.meshgrid(longitude, latitude)
    east = (0.1 + 0.01 * lon + 0.02 * lat) * np.exp(0.7j)
    omega = np.array([2 * np.pi / (M2_HOURS * 3600)])
    return TidalGrid(("M2",), omega, START, latitude, longitude, east[None], 1j * east[None], Source("tide"))


def test_tide_is_added_hourly_between_daily_frames():
    """Daily frames become hourly, linear in time, plus the tide interpolated to the grid of the currents."""
    tides = plane_tide(np.arange(-3.0, 4.0), np.arange(-3.0, 4.0))
    lon, lat = np.array([-1.3, 0.2, 1.9]), np.array([-0.5, 0.75])
    days = START + 86400.0 * np.arange(3)
    found = add_tides(still_water(lon, lat, days), tides)
    assert found.time.size == 49 and np.allclose(np.diff(found.time), 3600.0) and found.time[-1] == days[-1]
    exact, _ = tidal_currents(plane_tide(lon, lat), found.time)
    slow = 0.2 * np.arange(49) / 48
    np.testing.assert_allclose(found.east, (slow[:, None, None] + exact)[:, None] * np.ones((1, 2, 1, 1)), atol=1e-12)
    assert found.source.product == "test with tide" and found.source.notes[0] == "slow"
    chosen = add_tides(still_water(lon, lat, days), tides, time=days[0] + np.array([5400.0]))
    np.testing.assert_allclose(
        chosen.north[0, 1], -0.2 * 1.5 / 48 + tidal_currents(plane_tide(lon, lat), chosen.time)[1][0]
    )


def test_frequent_and_constant_currents():
    """Hourly currents keep their times with a warning note; a constant field needs times."""
    tides = plane_tide(np.arange(-3.0, 4.0), np.arange(-3.0, 4.0))
    lon, lat = np.array([-1.0, 1.0]), np.array([0.0, 1.0])
    hourly = still_water(lon, lat, START + 3600.0 * np.arange(5))
    found = add_tides(hourly, tides)
    np.testing.assert_array_equal(found.time, hourly.time)
    assert any("check that they hold no tide" in note for note in found.source.notes)
    single = still_water(lon, lat, [START])
    constant = replace(single, constant_in_time=True)
    for one in (single, constant):
        with pytest.raises(DataError, match="found one frame. Give the times"):
            add_tides(one, tides)
    assert add_tides(single, tides, time=START + np.array([0.0, 9e5])).time.size == 2
    uneven = add_tides(still_water(lon, lat, START + np.array([0.0, 86400.0, 90100.0])), tides)
    assert np.ptp(np.diff(uneven.time)) < 1e-6 and np.diff(uneven.time)[0] <= 3600.0
    spread = add_tides(constant, tides, time=START + 86400.0 * np.arange(30))
    assert spread.time.size == 30 and not spread.constant_in_time
    with pytest.raises(CoverageError, match="Read more files"):
        add_tides(hourly, tides, time=START + np.array([0.0, 1e6]))


def test_gaps_and_shores_of_the_tide():
    """Land of the currents stays NaN; sea next to the tide's edge gets the nearest tide, far away none."""
    tides = plane_tide(np.arange(-3.0, 4.0), np.arange(-3.0, 4.0))
    lon, lat = np.array([2.0, 3.5, 9.0]), np.array([0.0, 1.0])
    slow = still_water(lon, lat, START + 86400.0 * np.arange(2))
    sea = np.array([[True, True, True], [False, True, True]])
    east = np.where(sea, slow.east, np.nan)
    found = add_tides(replace(slow, sea=sea, east=east, north=-east), tides)
    assert np.isnan(found.east[:, :, 1, 0]).all() and np.isfinite(found.east[:, :, sea]).all()
    tide = found.east[0, 0] - east[0, 0]
    nearest = tidal_currents(plane_tide(np.array([3.0]), lat), START)[0]
    assert tide[0, 1] == pytest.approx(nearest[0, 0]) and tide[0, 2] == 0.0
    notes = " ".join(found.source.notes)
    assert (
        "2 of 5 sea points lie beyond the tides" in notes and "2 of 5 sea points got the tide of the nearest" in notes
    )
    with pytest.raises(CoverageError, match="none in common"):
        add_tides(still_water(np.array([50.0, 51.0]), lat, START + 86400.0 * np.arange(2)), tides)


def test_real_forcing_off_new_jersey(real):
    """At 39.4 N 73.7 W: M2 0.13 m/s along its major axis, turning clockwise; the smaller ones as published."""
    path, grid = real(*SANDY, "tide_forc_Sandy.nc"), real(*SANDY, "Sandy_roms_grid.nc")
    tides = read_tides(path, grid=grid)
    assert tides.names == ("K1", "O1", "Q1", "M2", "S2", "N2", "K2", "M4", "M6")
    assert tides.reference_time == START
    j, i = np.abs(tides.latitude - 39.4).argmin(), np.abs(tides.longitude + 73.7).argmin()
    axes = {n: to_ellipse(tides.east[k, j, i], tides.north[k, j, i])[:2] for k, n in enumerate(tides.names)}
    assert axes["M2"][0] == pytest.approx(0.13, abs=0.005) and axes["M2"][1] == pytest.approx(-0.069, abs=0.005)
    for name, major in (("S2", 0.027), ("N2", 0.029), ("O1", 0.015), ("K1", 0.009)):
        assert axes[name][0] == pytest.approx(major, abs=0.001) and axes[name][1] < 0
    east, north = tidal_currents(tides, START + 600.0 * np.arange(75))
    turning = np.diff(np.unwrap(np.arctan2(north[:, j, i], east[:, j, i])))
    assert turning.sum() < -5.0
    with netCDF4.Dataset(grid) as data:
        land = data["mask_rho"][:].filled() < 0.5
    assert np.isnan(tides.east[:, land]).all()
    box = read_tides(path, grid=grid, box=(38.5, 41.0, -75.0, -71.0))
    row, column = np.abs(box.latitude - 39.4).argmin(), np.abs(box.longitude + 73.7).argmin()
    assert box.east.shape[1:] < (20, 30)
    assert abs(box.east[3, row, column] - tides.east[3, j, i]) < 1e-12


def test_real_climatology_with_its_tide(real):
    """Daily fields of the storm become hourly with the tide, everywhere at sea."""
    grid = real(*SANDY, "Sandy_roms_grid.nc")
    names = ("coawst_clm_20121028.nc", "coawst_clm_20121029.nc", "Sandy_ini.nc")
    box = (38.5, 41.0, -75.0, -71.0)
    slow = read_roms_currents([real(*SANDY, n) for n in names], grid=grid, box=box)
    tides = read_tides(real(*SANDY, "tide_forc_Sandy.nc"), grid=grid, box=box)
    found = add_tides(slow, tides)
    assert found.time.size == 25 and np.isfinite(found.east[:, :, found.sea]).all()
    np.testing.assert_allclose(
        (found.east[0] - slow.east[0])[:, found.sea][0], (found.east[0] - slow.east[0])[:, found.sea][-1], atol=1e-6
    )
