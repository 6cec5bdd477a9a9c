"""What a mission leaves in its files: bookkeeping of power, sensors and their faults, formats."""

from __future__ import annotations

import tomllib

import netCDF4
import numpy as np
import pytest

from glider_jax.diagnosis.proof import sensors
from glider_jax.diagnosis.proof.cases import REGIONS, SIGMA, VEHICLES, plan_of
from glider_jax.diagnosis.proof.ocean import DAY, HOUR, Ocean
from glider_jax.diagnosis.proof.truth import fly
from glider_jax.readers.bathymetry import read_bathymetry
from glider_jax.readers.currents import read_currents
from glider_jax.readers.missions import read_mission
from glider_jax.readers.recordings import read_recording
from glider_jax.readers.vehicles import read_vehicle

V = VEHICLES[1]


@pytest.fixture(scope="module")
def sea():
    ocean = Ocean(REGIONS[1], np.random.default_rng(8), 0.5 * DAY)
    return ocean, fly(ocean, V, plan_of(1), {}, np.random.default_rng(8))


def rows(sea, effects=None, seed=9):
    ocean, flown = sea
    return sensors.record(flown, ocean, V, effects or {}, np.random.default_rng(seed))


def test_power_adds_up(sea):
    _, flown = sea
    watts = sensors.power_of(flown, V, {})
    n = watts.size
    complete = [s for s in flown.strokes if s.start + s.seconds < n]
    assert len(complete) == len(flown.strokes)
    pump = sum(V.pump_intercept + V.pump_slope * s.depth if s.direction > 0 else V.retract for s in complete)
    expected = V.hotel * n + V.surface * np.sum(flown["phase"] == 0) + pump + V.brake * len(complete)
    assert watts.sum() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("effect", "share"),
    [
        ({"energy.dive_only_load.power": 0.4}, lambda f, n: 0.4 * np.sum(f["phase"] < 0)),
        ({"energy.hotel_growth.rate": 1e-6}, lambda f, n: 1e-6 * n * (n - 1) / 2),
        ({"energy.surface_load.power": 0.7}, lambda f, n: 0.7 * np.sum(f["phase"] == 0)),
        ({"energy.brake_pressure.slope": 0.5}, lambda f, n: sum(0.5 * s.depth for s in f.strokes)),
        (
            {"energy.pump_pressure_nonlinearity.curvature": 0.02},
            lambda f, n: sum(0.02 * s.depth**2 for s in f.strokes if s.direction > 0),
        ),
        (
            {"energy.cold_friction.slope": 0.03},
            lambda f, n: sum(
                0.03 * max(15 - s.temperature, 0)
                * (V.pump_intercept + V.pump_slope * s.depth if s.direction > 0 else V.retract)
                for s in f.strokes
            ),
        ),
    ],
)  # fmt: skip
def test_energy_effects_have_their_size(sea, effect, share):
    _, flown = sea
    gained = sensors.power_of(flown, V, effect).sum() - sensors.power_of(flown, V, {}).sum()
    assert gained == pytest.approx(share(flown, flown["phase"].size), rel=1e-6)


def test_voltage_and_current_carry_the_power(sea):
    _, flown = sea
    watts = sensors.power_of(flown, V, {})
    effect = {"energy.internal_resistance.resistance": 0.4}
    current, voltage = sensors.electricity(flown, watts, V, effect)
    free_current, free_voltage = sensors.electricity(flown, watts, V, {})
    assert voltage * current == pytest.approx(watts)
    assert free_voltage - voltage == pytest.approx(0.4 * current, abs=2e-3)
    assert free_voltage[0] == pytest.approx(V.full, abs=1e-3)
    charge = 1.0 - watts.sum() / V.capacity
    assert free_voltage[-1] == pytest.approx(V.empty + (V.full - V.empty) * charge, abs=1e-6)
    assert free_current == pytest.approx(watts / free_voltage)


def test_recorded_current_and_charge_follow_the_sensor(sea):
    plain, off = rows(sea), rows(sea, {"sensor.current_offset.offset": 0.02})
    same = np.isfinite(plain["m_coulomb_current"]) & np.isfinite(off["m_coulomb_current"])
    assert (off["m_coulomb_current"] - plain["m_coulomb_current"])[same] == pytest.approx(0.02)
    gained = np.diff(off["m_coulomb_amphr_total"][[0, -1]]) - np.diff(plain["m_coulomb_amphr_total"][[0, -1]])
    assert gained[0] == pytest.approx(0.02 * 0.5 * 24, rel=0.01)
    more = rows(sea, {"sensor.current_gain.gain": 0.1})
    assert np.nanmean(more["m_coulomb_current"]) == pytest.approx(
        1.1 * np.nanmean(plain["m_coulomb_current"]), rel=2e-3
    )
    counted = rows(sea, {"sensor.coulomb_gain.gain": 0.1})
    assert np.nanmean(counted["m_coulomb_current"]) == pytest.approx(np.nanmean(plain["m_coulomb_current"]))
    assert np.ptp(counted["m_coulomb_amphr_total"]) == pytest.approx(
        1.1 * np.ptp(plain["m_coulomb_amphr_total"]), rel=1e-3
    )


def test_pressure_offset_touches_the_gauges_it_should(sea):
    plain = rows(sea)
    for both in (0.0, 1.0):
        off = rows(sea, {"sensor.pressure_offset.offset": 0.6, "sensor.pressure_offset.both_gauges": both})
        assert np.nanmean(off["m_depth"] - plain["m_depth"]) == pytest.approx(0.6, abs=0.01)
        science = np.nanmean(off["sci_water_pressure"] - plain["sci_water_pressure"])
        assert science == pytest.approx(0.0605 * both, abs=0.002)


def test_salinity_effects_are_seen_by_the_ctd_alone(sea):
    plain, off = rows(sea), rows(sea, {"flight.salinity_bias.bias": 0.5})
    assert np.nanmean(off["sci_water_cond"] - plain["sci_water_cond"]) < -0.04
    assert np.nanmax(np.abs(off["m_depth"] - plain["m_depth"])) < 1e-9


def test_a_recording_has_the_faults_of_real_ones(sea):
    columns = rows(sea)
    step = np.diff(columns["time"])
    assert (step == 0).sum() >= 2 and (step > 30).sum() >= 1
    assert np.median(step) == pytest.approx(8.0, abs=0.05)
    assert 0.002 < np.isnan(columns["m_pitch"]).mean() < 0.03
    fixes = np.isfinite(columns["m_gps_lat"])
    assert fixes.any() and not fixes[columns["x_surfaced"] == 0].any()
    assert np.isnan(columns["sci_water_temp"][columns["x_surfaced"] > 0]).all()


def test_positions_are_degrees_and_minutes(sea):
    assert sensors._nmea(np.array([-73.5, 39.25])) == pytest.approx([-7330.0, 3915.0])
    ocean, flown = sea
    columns = rows(sea)
    good = np.flatnonzero(np.isfinite(columns["m_gps_lat"]))[:40]
    value = columns["m_gps_lat"][good]
    degrees = np.trunc(value / 100.0) + np.remainder(value, 100.0) / 60.0
    second = np.rint(columns["time"][good] - ocean.region.start).astype(int)
    north = (degrees - ocean.region.latitude) * ocean.metres_north
    assert np.median(np.abs(north - flown["north"][second])) < 15.0


def test_frozen_sensors_hold_their_value():
    values = np.random.default_rng(0).normal(size=4000)
    frozen = sensors._frozen(values, 0.1, np.random.default_rng(1))
    assert 0.05 < np.mean(np.diff(frozen) == 0.0) < 0.12
    assert np.array_equal(sensors._frozen(values, 0.0, np.random.default_rng(1)), values)


def test_files_are_what_the_readers_take(sea, tmp_path):
    ocean, _ = sea
    columns = rows(sea)
    rng = np.random.default_rng(3)
    sensors.write_recording(tmp_path / "recording.nc", columns, ocean.region.start)
    sensors.write_bathymetry(tmp_path / "bathymetry.nc", ocean, rng)
    sensors.write_currents(tmp_path / "currents.nc", ocean, rng)
    sensors.write_vehicle(tmp_path / "vehicle.toml", V, SIGMA)
    sensors.write_mission(tmp_path / "mission.toml", plan_of(1), ocean)
    recording = read_recording(tmp_path / "recording.nc")
    assert recording["gps_latitude"][np.isfinite(recording["gps_latitude"])][0] == pytest.approx(
        REGIONS[1].latitude, abs=1e-3
    )
    assert np.nanmax(recording["pressure"]) == pytest.approx(np.nanmax(columns["m_pressure"]) * 1e5, rel=1e-5)
    vehicle = read_vehicle(tmp_path / "vehicle.toml")
    assert vehicle.value("flight.mass") == pytest.approx(V.mass)
    mission = read_mission(tmp_path / "mission.toml")
    assert mission.start == pytest.approx(REGIONS[1].start) and mission.yo.dive_to == plan_of(1).dive_to
    floor = read_bathymetry(tmp_path / "bathymetry.nc")
    i = (
        np.abs(floor.latitude - ocean.region.latitude).argmin(),
        np.abs(floor.longitude - ocean.region.longitude).argmin(),
    )
    assert floor.depth[i] == pytest.approx(float(ocean.bottom(np.array(0.0), np.array(0.0))), abs=6.0)
    currents = read_currents(tmp_path / "currents.nc")
    k = np.abs(currents.time - ocean.region.start - 6 * HOUR).argmin()
    u, _ = ocean.resolved(np.array(0.0), np.array(0.0), np.array(currents.time[k] - ocean.region.start))
    middle = currents.east[k, 0, 11:14, 11:14]
    assert np.nanmean(middle) == pytest.approx(float(u), abs=0.05)
    with open(tmp_path / "vehicle.toml", "rb") as file:
        assert set(tomllib.load(file)) == {"vehicle", "energy"}
    with netCDF4.Dataset(tmp_path / "recording.nc") as file:
        assert file["m_pressure"].units == "bar" and file["m_present_time"].dtype == np.float64
