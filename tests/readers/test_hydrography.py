"""Temperature and salinity profiles: the conversions against published check values and gsw, and every source."""

from __future__ import annotations

import sys

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers import teos
from glider_jax.readers.hydrography import profile_from_recording, read_water_profile
from glider_jax.records import Recording, Source
from tests.readers.roms_layouts import World

SANDY = ("environment", "roms_coawst_sandy")


def test_practical_salinity_check_values():
    """UNESCO 44: ratio 1.888091 at 40 degC (IPTS-68) and 10,000 dbar is 40; the standard ratio is 35."""
    t90 = 40.0 / 1.00024
    assert teos.practical_salinity(1.888091 * 4.2914, t90, 10000.0) == pytest.approx(40.0, abs=1e-5)
    assert teos.practical_salinity(4.2914, 15.0 / 1.00024, 0.0) == pytest.approx(35.0, abs=1e-5)
    assert np.isnan(teos.practical_salinity([0.0, 0.01, 9.0], 15.0, 0.0)).all()


def test_depth_check_value():
    """UNESCO 44: 10,000 dbar at 30 degrees latitude is 9712.653 m; the inverse comes back."""
    assert teos.depth_from_pressure(10000.0, 30.0) == pytest.approx(9712.653, abs=1e-3)
    p = np.linspace(0, 6000, 50)
    np.testing.assert_allclose(teos.pressure_from_depth(teos.depth_from_pressure(p, 39.0), 39.0), p, atol=1e-6)


def test_conversions_match_gsw():
    """Salinity and conservative temperature to rounding, depth to 4 mm, potential temperature to 14 mK."""
    gsw = pytest.importorskip("gsw")
    random = np.random.default_rng(0)
    sp, t, p = random.uniform(2.01, 42, 5000), random.uniform(-2, 35, 5000), random.uniform(0, 2000, 5000)
    np.testing.assert_allclose(teos.practical_salinity(gsw.C_from_SP(sp, t, p) / 10, t, p), sp, atol=1e-9)
    sa = sp * teos.REFERENCE_RATIO
    np.testing.assert_allclose(teos.conservative_temperature(sa, t), gsw.CT_from_pt(sa, t), atol=1e-11)
    np.testing.assert_allclose(teos.depth_from_pressure(p, 40.0), -gsw.z_from_p(p, 40.0), atol=4e-3)
    sea = (sp > 30) & (sp < 38)
    error = np.abs(teos.potential_temperature(sa, t, p) - gsw.pt0_from_t(sa, t, p))[sea]
    assert error[p[sea] < 200].max() < 3e-3 and error[p[sea] < 1000].max() < 9e-3 and error.max() < 14e-3
    upper, _ = teos.absolute_salinity(np.array([33.0]), np.array([50.0]), -73.0, 39.0)
    assert upper[0] == pytest.approx(float(gsw.SA_from_SP(33.0, 50.0, -73.0, 39.0)))
    assert upper[0] == pytest.approx(33.0 * teos.REFERENCE_RATIO, abs=0.005)


def test_without_gsw_reference_salinity_is_used_and_told(monkeypatch, tmp_path):
    """The approximation is named in the notes and close on the New Jersey shelf."""
    path = World().write(tmp_path / "his.nc")
    exact = read_water_profile(path)
    monkeypatch.setitem(sys.modules, "gsw", None)
    found = read_water_profile(path)
    assert any("reference salinity (gsw is not installed)" in note for note in found.source.notes)
    np.testing.assert_allclose(found.absolute_salinity, exact.absolute_salinity, atol=0.01)


def test_roms_profile(tmp_path):
    """Linear temperature and salinity come back at each depth above the seafloor, land values stay out."""
    world = World(land=(slice(3, 9), slice(4, 12)))
    found = read_water_profile(world.write(tmp_path / "his.nc"), box=(0.8, 1.2, -72.3, -71.7))
    assert found.depth[0] == 0 and found.depth[-1] == 100
    deepest, shallowest = world.vertical.depths(np.array([world.depth])).ravel()[[0, -1]]
    depth = np.clip(found.depth, shallowest, deepest)
    salinity = (33.0 + 0.02 * depth) * teos.REFERENCE_RATIO
    np.testing.assert_allclose(found.absolute_salinity, salinity, atol=0.01)
    expected = teos.conservative_temperature(salinity, 20.0 - 0.1 * depth)
    np.testing.assert_allclose(found.conservative_temperature, expected, atol=1e-3)
    assert "temperature was taken as potential, salinity as practical." in found.source.notes
    with pytest.raises(CoverageError, match="expected temperature in the period"):
        read_water_profile(tmp_path / "his.nc", period=("2020-01-01", "2020-01-02"))


def test_roms_fields_with_a_grid_file(tmp_path):
    """Fields, grid and parameters in three files; without salt the message says so."""
    world = World()
    fields = world.write(tmp_path / "clm.nc", whole=False)
    extra = [world.write_grid(tmp_path / "grid.nc"), world.write_parameters(tmp_path / "par.nc")]
    whole = read_water_profile(world.write(tmp_path / "his.nc"))
    found = read_water_profile([fields, extra[1]], grid=extra[0])
    np.testing.assert_allclose(found.conservative_temperature, whole.conservative_temperature)
    with netCDF4.Dataset(fields, "a") as data:
        data.renameVariable("salt", "suspended_salt")
    with pytest.raises(DataError, match="found no salt"):
        read_water_profile([fields, *extra])


def write_levels(path, variables, *, units="degrees_C", up=False):
    """Fields on fixed depths in the layout of CMEMS: (time, depth, latitude, longitude), NaN below the bottom."""
    depth = np.array([0.5, 10.0, 50.0, 200.0])
    with netCDF4.Dataset(path, "w") as data:
        for name, values, unit in (
            ("time", np.array([0.0, 24.0]), "hours since 2012-10-28"),
            ("depth", -depth if up else depth, "m"),
            ("latitude", np.arange(38.0, 42.0), "degrees_north"),
            ("longitude", np.arange(284.0, 290.0), "degrees_east"),
        ):
            data.createDimension(name, values.size)
            axis = data.createVariable(name, "f8", (name,))
            axis.standard_name, axis.units, axis[:] = name, unit, values
        if up:
            data["depth"].positive = "up"
        for name, standard, surface, slope in variables:
            dims = ("time", "depth", "latitude", "longitude")
            variable = data.createVariable(name, "f8", dims, fill_value=1e20)
            variable.standard_name = standard
            variable.units = units if "temp" in standard else "1e-3"
            field = surface + slope * depth[None, :, None, None] + np.zeros((2, 1, 4, 6))
            field[:, 2:, :, 0] = 1e20  # shallow in the west
            field[:, :, 0] += 5.0  # the southern row is warmer and saltier
            field[1] += 1.0
            variable[:] = np.where(field > 1e19, 1e20, field)
    return path


@pytest.mark.parametrize("up", [False, True])
def test_fixed_depth_profile(tmp_path, up):
    """Means over place and time; temperature and salinity from two files; box in the other longitude convention."""
    warm = write_levels(tmp_path / "t.nc", [("thetao", "sea_water_potential_temperature", 18.0, -0.05)], up=up)
    salt = write_levels(tmp_path / "s.nc", [("so", "sea_water_salinity", 32.0, 0.01)], up=up)
    found = read_water_profile([warm, salt], box=(38.5, 41.5, -76.5, -70.5))
    assert found.depth.tolist() == [0.5, 10.0, 50.0, 200.0]
    salinity = (32.5 + 0.01 * found.depth) * teos.REFERENCE_RATIO  # 0.5: mean of the two times
    np.testing.assert_allclose(found.absolute_salinity, salinity, atol=0.005)
    expected = teos.conservative_temperature(found.absolute_salinity, 18.5 - 0.05 * found.depth)
    np.testing.assert_allclose(found.conservative_temperature, expected, atol=1e-9)
    first = read_water_profile([warm, salt], box=(38.5, 41.5, -76.5, -70.5), period=("2012-10-27", "2012-10-28T12:00"))
    np.testing.assert_allclose(found.absolute_salinity - first.absolute_salinity, 0.5 * teos.REFERENCE_RATIO, atol=0.01)
    with pytest.raises(DataError, match="expected a salinity"):
        read_water_profile(warm)
    with pytest.raises(CoverageError, match="points in the box"):
        read_water_profile([warm, salt], box=(50.0, 51.0, 0.0, 1.0))
    with pytest.raises(CoverageError, match="times in the period"):
        read_water_profile([warm, salt], period=(0.0, 1.0))


def test_standard_names_decide_which_temperature_it_is(tmp_path):
    """In situ, potential and conservative temperature of the same number give three profiles; kelvins are seen."""
    made = {}
    for kind in ("sea_water_temperature", "sea_water_potential_temperature", "sea_water_conservative_temperature"):
        salt = ("so", "sea_water_absolute_salinity", 35.0, 0.0)
        path = write_levels(tmp_path / f"{kind}.nc", [("temp", kind, 10.0, 0.0), salt])
        made[kind] = read_water_profile(path, box=(38.5, 41.5, -76.5, -70.5))
        assert made[kind].absolute_salinity[0] == pytest.approx(35.5)
    conservative = made["sea_water_conservative_temperature"].conservative_temperature
    np.testing.assert_allclose(conservative, 10.5)
    in_situ, potential = (made[k].conservative_temperature[-1] for k in list(made)[:2])
    assert potential == pytest.approx(teos.conservative_temperature(35.5, 10.5))
    assert 0.015 < potential - in_situ < 0.03  # adiabatic cooling over 200 m
    kelvin = write_levels(
        tmp_path / "k.nc",
        [("temp", "sea_water_conservative_temperature", 283.15, 0.0), ("so", "sea_water_absolute_salinity", 35.0, 0.0)],
        units="K",
    )
    found = read_water_profile(kelvin, box=(38.5, 41.5, -76.5, -70.5))
    np.testing.assert_allclose(found.conservative_temperature, 10.5)


def recording(**changes):
    """A glider that sinks from 0 to 60 m in water with a thermocline at 30 m; flight and science rows alternate."""
    time = 1.5e9 + np.arange(1200.0)
    science = np.arange(1200) % 2 == 0
    depth = np.linspace(0.0, 60.0, 1200)
    pressure = teos.pressure_from_depth(depth, 39.5)
    temperature = np.where(depth < 30, 20.0, 10.0)
    gsw = pytest.importorskip("gsw")
    conductivity = gsw.C_from_SP(32.0 + 0.02 * depth, temperature, pressure) / 10
    channels = {
        "temperature": np.where(science, temperature + 273.15, np.nan),
        "conductivity": np.where(science, conductivity, np.nan),
        "ctd_pressure": np.where(science, pressure * 1e4, np.nan),
        "depth": np.where(science, np.nan, depth),
        "latitude": np.where(np.arange(1200) == 5, 39.5, np.nan),
        "longitude": np.where(np.arange(1200) == 5, -73.0, np.nan),
    } | changes
    channels = {name: values for name, values in channels.items() if values is not None}
    return Recording("ru99", time, channels, Source("test", {"ru99.nc": ""}), time[:1])


def test_profile_of_a_recording():
    """Practical salinity, depth and both TEOS-10 variables from what the CTD measured."""
    gsw = pytest.importorskip("gsw")
    found = profile_from_recording(recording())
    assert found.depth[0] < 2 and found.depth[-1] > 57 and (np.diff(found.depth) > 0).all()
    pressure = gsw.p_from_z(-found.depth, 39.5)
    salinity = gsw.SA_from_SP(32.0 + 0.02 * found.depth, pressure, -73.0, 39.5)
    np.testing.assert_allclose(found.absolute_salinity, salinity, atol=2e-3)
    away = np.abs(found.depth - 30) > 2
    expected = gsw.CT_from_t(salinity, np.where(found.depth < 30, 20.0, 10.0), pressure)
    np.testing.assert_allclose(found.conservative_temperature[away], expected[away], atol=2e-3)


def test_recording_without_ctd_pressure_or_conductivity():
    """Depth of the vehicle between its own rows, salinity as recorded; spikes do not move the medians."""
    whole = profile_from_recording(recording())
    base = recording()
    salinity = np.where(np.isfinite(base["temperature"]), 32.0 + 0.001 * (base.time - base.time[0]), np.nan)
    salinity[600] = 41.0
    found = profile_from_recording(recording(ctd_pressure=None, conductivity=None, salinity=salinity))
    np.testing.assert_allclose(found.depth, whole.depth, atol=0.1)
    np.testing.assert_allclose(found.absolute_salinity, whole.absolute_salinity, atol=0.05)
    zeros = np.zeros(1200)
    with pytest.raises(CoverageError, match="found none"):
        profile_from_recording(recording(temperature=zeros + 273.15))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"temperature": None}, "'temperature'"),
        ({"conductivity": None}, "'conductivity' or 'salinity'"),
        ({"ctd_pressure": None, "depth": None}, "ctd_pressure, pressure, depth"),
        ({"conductivity": np.full(1200, 0.01)}, "at least 3 good samples"),
    ],
)
def test_incomplete_recordings_are_explained(changes, message):
    """Each missing channel is named."""
    with pytest.raises(DataError, match=message):
        profile_from_recording(recording(**changes))


def test_recording_is_cut_to_box_and_period():
    """Rows outside are not used."""
    start = 1.5e9
    upper = profile_from_recording(recording(), period=(start, start + 400))
    assert upper.depth[-1] < 21
    with pytest.raises(CoverageError, match="box and period"):
        profile_from_recording(recording(), box=(10.0, 11.0, -73.5, -72.5))
    assert profile_from_recording(recording(), box=(39.0, 40.0, 286.5, 287.5)).depth.size > 20


def test_real_roms_hydrography(real):
    """October 2012 off New Jersey: 17.8 degC at the surface, 5 degC at 800 m, salinity rising offshore."""
    found = read_water_profile(
        real(*SANDY, "Sandy_ini_child2.nc"), grid=real(*SANDY, "Sandy_roms_grid_child2.nc"), box=(38.5, 41, -75, -71)
    )
    at = dict(zip(found.depth.tolist(), found.conservative_temperature.tolist(), strict=True))
    assert at[0.0] == pytest.approx(17.8, abs=0.1) and at[800.0] == pytest.approx(5.0, abs=0.1)
    assert 32.5 < found.absolute_salinity[0] < 33.5 and found.absolute_salinity[-1] == pytest.approx(35.14, abs=0.05)
    with pytest.raises(DataError, match="found no salt"):
        read_water_profile(real("environment", "roms_doppio", "ROMS3D_00_doppio_his_4322_subset.nc"))


@pytest.mark.parametrize(
    ("name", "surface", "deepest"),
    [
        ("comet2019", (18.2, 33.4), 42.0),
        ("maria2022", (14.7, 28.4), 180.0),
        ("osu684_2025", (26.0, 34.8), 738.0),
        ("rosie2019", (13.1, 32.0), 140.0),
        ("ru28_2017", (10.3, 27.5), 22.0),
    ],
)
def test_real_recordings(real, name, surface, deepest):
    """Every recording gives a profile that an oceanographer would accept for its place."""
    found = read_water_profile(real("recordings", name, f"{name}.nc"))
    assert (found.conservative_temperature[0], found.absolute_salinity[0]) == pytest.approx(surface, abs=0.3)
    assert found.depth[-1] == pytest.approx(deepest, abs=3.0)
    assert np.isfinite(found.conservative_temperature).all() and (np.diff(found.depth) > 0).all()
