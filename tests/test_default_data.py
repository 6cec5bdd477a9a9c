"""The bundled default ocean: it can be made again, and it looks like the shelf it stands for."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
import xarray as xr

import glider_jax_data
from glider_jax.errors import DataError
from glider_jax.readers.bathymetry import read_bathymetry
from glider_jax.readers.currents import read_currents
from glider_jax_data import make_default

METRES = 111_200.0


@pytest.fixture(scope="module")
def floor():
    with xr.open_dataset(glider_jax_data.path(make_default.BATHYMETRY)) as data:
        return data.load()


@pytest.fixture(scope="module")
def sea():
    with xr.open_dataset(glider_jax_data.path(make_default.CURRENTS)) as data:
        return data.load()


def _leg(floor, count=50):
    share = np.linspace(0.0, 1.0, count)
    (a, b), (c, d) = make_default.MISSION[:2]
    place = {"lat": ("p", a + share * (c - a)), "lon": ("p", b + share * (d - b))}
    return floor.depth.interp({k: xr.DataArray(v[1], dims=v[0]) for k, v in place.items()}).values


def test_the_files_can_be_made_again(tmp_path, floor, sea):
    for made, kept in zip(make_default.make(tmp_path), (floor, sea), strict=True):
        with xr.open_dataset(made) as again:
            assert set(again.variables) == set(kept.variables)
            for name in kept.data_vars:
                step = kept[name].encoding.get("scale_factor", 0.0)
                same = np.isnan(again[name].values) == np.isnan(kept[name].values)
                assert same.all()
                assert np.nanmax(np.abs(again[name].values - kept[name].values)) <= 1.01 * step


def test_the_manifest_names_every_file_with_its_checksum(tmp_path):
    record = glider_jax_data.manifest()
    for name, entry in record["files"].items():
        assert hashlib.sha256(glider_jax_data.path(name).read_bytes()).hexdigest() == entry["sha256"]
        assert entry["licence"] and entry["source"]
    target = tmp_path / "MANIFEST.json"
    target.write_text(json.dumps({"files": {"other.json": {"source": "somebody"}}}))
    for name in (make_default.BATHYMETRY, make_default.CURRENTS):
        (tmp_path / name).write_bytes(b"x")
    make_default.update_manifest(tmp_path)
    assert json.loads(target.read_text())["files"]["other.json"] == {"source": "somebody"}


def test_the_currents_stay_small():
    assert glider_jax_data.path(make_default.CURRENTS).stat().st_size < 2.5e6


def test_an_unknown_file_is_named_with_the_nearest():
    with pytest.raises(DataError, match="Did you mean 'new_jersey_currents.nc'"):
        glider_jax_data.path("new_jersey_curents.nc")
    with pytest.raises(DataError):
        glider_jax_data.path("../pyproject.toml")


def test_the_seafloor_falls_from_the_inlet_to_the_shelf_edge(floor):
    leg = _leg(floor)
    assert 10.0 <= leg[0] <= 20.0
    assert 90.0 <= leg[-1] <= 110.0
    assert np.polyfit(np.arange(leg.size), leg, 1)[0] > 0
    assert leg.min() > 10.0


def test_known_depths_of_the_new_jersey_shelf(floor):
    depth = floor.depth.interp(lat=39.4, lon=[-74.0, -73.5, -73.0, -72.5, -72.0]).values
    np.testing.assert_allclose(depth, [23.0, 45.0, 62.0, 125.0, 804.0], rtol=0.12)
    assert floor.depth.sel(lat=39.4, lon=-74.8, method="nearest") < 0.0


def test_the_mission_and_forty_kilometres_around_it_are_inside(floor, sea):
    points = np.array(make_default.MISSION)
    for data in (floor, sea):
        margin = 40_000.0 / METRES
        assert data.lat.min() <= points[:, 0].min() - margin
        assert data.lat.max() >= points[:, 0].max() + margin
        assert data.lon.min() <= points[:, 1].min() - margin / np.cos(np.radians(39.0))
        assert data.lon.max() >= points[:, 1].max() + margin / np.cos(np.radians(39.0))
    middle = np.radians(points[:, 0].mean())
    path = np.hypot(np.diff(points[:, 0]), np.diff(points[:, 1]) * np.cos(middle)) * METRES
    assert 230e3 <= path.sum() <= 235e3


def test_the_currents_cover_three_weeks_hourly(sea):
    assert sea.time.values[0] == np.datetime64("2009-09-05T00:00")
    assert sea.time.values[-1] == np.datetime64("2009-09-26T00:00")
    assert np.all(np.diff(sea.time.values) == np.timedelta64(1, "h"))


def test_the_mean_flow_runs_down_the_shelf(sea):
    east = sea.eastward_sea_water_velocity.sel(lat=39.2, lon=-73.5, method="nearest").values
    north = sea.northward_sea_water_velocity.sel(lat=39.2, lon=-73.5, method="nearest").values
    assert 0.05 < np.hypot(east.mean(), north.mean()) < 0.12
    assert 180.0 < np.degrees(np.arctan2(east.mean(), north.mean())) % 360.0 < 240.0


def _rotary(sea, degrees_per_hour):
    """Size of the clockwise and anticlockwise parts of the flow in mid-shelf at one frequency."""
    east = sea.eastward_sea_water_velocity.sel(lat=39.2, lon=-73.4, method="nearest").values
    north = sea.northward_sea_water_velocity.sel(lat=39.2, lon=-73.4, method="nearest").values
    hour = np.arange(east.size)
    flow = (east + 1j * north) - np.mean(east + 1j * north)
    angle = np.radians(degrees_per_hour * hour)
    return abs(np.mean(flow * np.exp(1j * angle))), abs(np.mean(flow * np.exp(-1j * angle)))


def test_the_tide_is_semidiurnal_and_turns_clockwise(sea):
    clockwise, anticlockwise = _rotary(sea, 28.984)
    assert 0.05 < clockwise + anticlockwise < 0.13
    assert clockwise > 3.0 * anticlockwise


def test_inertial_motion_turns_clockwise(sea):
    clockwise, anticlockwise = _rotary(sea, 18.9)
    assert clockwise > 4.0 * anticlockwise


def test_two_storms_push_south_west(sea):
    east = sea.eastward_sea_water_velocity.sel(lat=39.3, lon=-73.7, method="nearest")
    north = sea.northward_sea_water_velocity.sel(lat=39.3, lon=-73.7, method="nearest")
    along = -(east * np.sin(np.radians(35.0)) + north * np.cos(np.radians(35.0)))
    daily = along.rolling(time=25, center=True).mean().dropna("time")
    calm = float(daily.median())
    for hour, _, speed in make_default.STORMS:
        peak = float(daily.isel(time=slice(int(hour) - 24, int(hour) + 1)).max())
        assert 0.4 * speed < peak - calm < 1.2 * speed


def test_errors_are_one_sigma_speeds(sea):
    error = sea.eastward_sea_water_velocity_error
    assert error.attrs["units"] == "m s-1"
    assert 0.02 < float(error.min()) and float(error.max()) < 0.1
    assert (np.isnan(error) == np.isnan(sea.eastward_sea_water_velocity)).all()


def test_the_flow_has_no_divergence_on_the_scale_of_the_eddies():
    """A stream function makes them: central differences of a fine grid must cancel away from the coast."""
    x, y = np.meshgrid(np.arange(0.0, 4.0, 0.5), np.arange(0.0, 4.0, 0.5))
    flow = make_default.eddies(np.array([[[100.0]]]), x, y, np.full(x.shape, 1e6))[0]
    divergence = np.gradient(flow.real, 0.5, axis=1) + np.gradient(flow.imag, 0.5, axis=0)
    turning = np.gradient(flow.imag, 0.5, axis=1) - np.gradient(flow.real, 0.5, axis=0)
    assert np.abs(divergence[1:-1, 1:-1]).max() < 0.02 * np.abs(turning[1:-1, 1:-1]).max()


def test_the_readers_take_both_files():
    currents = read_currents(glider_jax_data.path(make_default.CURRENTS))
    assert currents.east.shape == (make_default.HOURS, 1, 45, 49) and currents.time[0] == make_default.START_SECONDS
    assert currents.east_sd is not None and 0.02 < np.nanmin(currents.east_sd) < 0.04
    seafloor = read_bathymetry(glider_jax_data.path(make_default.BATHYMETRY))
    assert seafloor.depth.max() > 2000.0 and seafloor.depth.min() == -30.0 and seafloor.source.notes == ()
