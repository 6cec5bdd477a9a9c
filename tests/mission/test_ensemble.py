"""Ensembles: seeds, chunks, statistics, outcomes and compilation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.config import Aborts, SurfaceRule
from glider_jax.environment.synthetic import synthetic_bathymetry, synthetic_currents
from glider_jax.errors import ConfigError, CoverageError, Outcome
from glider_jax.mission import ensemble, programs
from glider_jax.mission.forecast import forecast, prepare
from glider_jax.mission.speeds import choose_speeds
from tests.mission.conftest import make_mission
from tests.mission.test_closed_forms import AREA, STRAIGHT, fly, quiet

NODES = (np.array([0.2, 0.3, 0.4]), np.array([0.0, 0.5, 1.0]))


def _run(vehicle, **options):
    defaults = dict(currents=synthetic_currents("tide", error=0.05, **AREA), duration=86400.0, speeds=NODES, start=0.0)
    return prepare(make_mission(), vehicle, **(defaults | options))


def test_same_seed_same_members_whatever_the_chunk(vehicle):
    run = _run(vehicle, seed=5)
    whole, pieces, part = forecast(24, run), forecast(24, run, chunk=8), forecast(8, run, first=10)
    for name in ("latitude", "longitude", "energy", "surfacing_time", "usable_energy"):
        assert np.array_equal(getattr(whole, name), getattr(pieces, name), equal_nan=True), name
    assert np.array_equal(whole.latitude[10:18], part.latitude)
    other = forecast(24, _run(vehicle, seed=6))
    assert not np.array_equal(whole.latitude[:, -1], other.latitude[:, -1])


def test_no_spread_flies_one_mission(vehicle):
    track = forecast(3, _run(vehicle, spread=0.0, speeds=(np.array([0.3, 0.3]), np.array([0.0, 1.0])), currents=None))
    # The current's own error stays; without currents' error the members are one.
    assert np.ptp(track.energy[:, -1].sum(-1)) / track.energy[0, -1].sum() < 0.05


def test_float32_and_float64_agree(vehicle):
    import jax
    import jax.numpy as jnp

    low = forecast(8, _run(vehicle))
    with jax.enable_x64(True):
        high = forecast(8, _run(vehicle, dtype=jnp.float64))
    metres = 111e3 * np.abs(low.latitude - high.latitude)
    # The random words agree, the numbers made of them to 24 bits.
    assert np.median(metres) < 5.0
    assert np.median(np.abs(low.energy - high.energy)) / np.median(high.energy[:, -1]) < 1e-3


def test_segment_speeds_follow_the_distribution(vehicle):
    run, track = fly(vehicle, mission=make_mission(waypoints=((41.5, -74.0),)), n=400, days=1.0)
    assert np.allclose(track.distance_through_water[:, -1], track.distance_through_water[0, -1])
    run = prepare(
        make_mission(waypoints=((41.5, -74.0),)), quiet(vehicle), duration=86400.0, speeds=NODES, start=0.0, spread=0.0
    )
    track = forecast(1500, run)
    begin = np.concatenate([np.zeros((1500, 1)), track.dive_time[:, :5] - track.time[0]], 1)
    under = track.surfacing_time[:, :6] - track.time[0] - begin
    # Distance over the ground of the first segment, still water, no heading error: its speed.
    north = run.frame.to_metres(track.surfacing_latitude[:, 0], track.surfacing_longitude[:, 0])[1]
    speed = north / under[:, 0]
    assert abs(speed.mean() - 0.3) < 4 * 0.0577 / math.sqrt(1500)
    assert speed.std() == pytest.approx(0.0577, rel=0.1)
    assert 0.199 < speed.min() and speed.max() < 0.401


def test_current_error_makes_the_cloud_spread_as_a_random_flight(vehicle):
    quantities = dict(vehicle.quantities)
    sd, memory = 0.08, 86400.0
    for name, value in (("current_error", sd), ("current_error_time", memory), ("current_error_length", 1e9)):
        name = f"perturbation.{name}"
        quantities[name] = replace(quantities[name], value=value)
    for name in ("heading", "speed", "initial_position", "surface_stay"):
        name = f"perturbation.{name}"
        quantities[name] = replace(quantities[name], value=0.0)
    loud = replace(vehicle, quantities=quantities)
    mission = make_mission(**STRAIGHT)
    n, t = 4000, 2 * 86400.0
    run = prepare(
        mission, loud, duration=t, speed="shoebox", speeds=(np.array([0.3, 0.3]), np.array([0.0, 1.0])), start=0.0
    )
    track = forecast(n, run)
    east, _ = run.frame.to_metres(track.latitude[:, -1], track.longitude[:, -1])
    sx, _ = run.frame.stretch(0.5 * run.frame.to_metres(track.latitude[:1, -1], -74.0)[1])
    variance = 2 * sd**2 * memory**2 * (t / memory - 1 + math.exp(-t / memory))
    assert np.std(east / sx) == pytest.approx(math.sqrt(variance), rel=4 / math.sqrt(2 * n) + 0.01)


def test_outcomes_say_what_ended_a_member(vehicle):
    small = AREA | {"width": 20e3, "height": 20e3}
    _, track = fly(vehicle, synthetic_currents("uniform", **small), n=2)
    assert set(track.outcome) == {Outcome.LEFT_CURRENTS_AREA}
    assert np.all(np.isfinite(track.latitude)) and not track.active[:, -1].any()
    # The last position is where the data ended, 10 km away.
    assert track.outcome_latitude[0] == pytest.approx(39.09, abs=0.01)
    _, track = fly(vehicle, synthetic_currents("tide", **(AREA | {"duration": 43200.0})), n=2)
    assert set(track.outcome) == {Outcome.LEFT_CURRENTS_TIME}
    assert track.outcome_time[0] - track.time[0] == pytest.approx(43200.0, abs=1600.0)
    floor = synthetic_bathymetry("flat", depth=60.0, latitude=39.0, longitude=-74.0, width=20e3, height=20e3)
    _, track = fly(vehicle, bathymetry=floor)
    assert track.outcome[0] == Outcome.LEFT_BATHYMETRY
    shore = synthetic_bathymetry(
        "sloping", depth=30.0, slope=-2e-3, bearing_deg=0.0, latitude=39.0, longitude=-74.0, width=300e3, height=300e3
    )
    _, track = fly(vehicle, bathymetry=shore)
    assert track.outcome[0] == Outcome.AGROUND
    assert track.outcome_latitude[0] == pytest.approx(39.0 + 13.75e3 / 111e3, abs=0.015)


def test_battery_ends_a_mission(vehicle):
    capacity = replace(vehicle.battery.capacity, value=7200.0, sigma=100.0)
    tiny = replace(vehicle, battery=replace(vehicle.battery, capacity=capacity))
    _, track = fly(tiny, n=3, days=2.0, spread=1.0)
    assert set(track.outcome) <= {Outcome.BATTERY_EMPTY, Outcome.BATTERY_ABORT}
    mission = make_mission(**STRAIGHT, aborts=Aborts(remaining_charge=0.3))
    _, track = fly(tiny, n=3, days=2.0, spread=1.0, mission=mission)
    assert set(track.outcome) == {Outcome.BATTERY_ABORT}
    assert np.allclose(track.state_of_charge[:, -1], 0.3, atol=0.04)


def test_one_bad_member_does_not_spoil_the_others(vehicle):
    run, track = fly(vehicle, n=6, spread=1.0)
    from glider_jax.mission import forecast as module

    members, _ = module.draw_run(run, 0, 6)
    members.speed[2] = np.nan
    state, _ = ensemble.run_members(members, run.plan, run.shape, run.environment, run.column, 0.0, 0.0)
    assert np.asarray(state.outcome).tolist()[2] != Outcome.FLYING
    assert set(np.delete(np.asarray(state.outcome), 2)) == {Outcome.FLYING}


def test_new_numbers_do_not_compile_again(vehicle):
    first = make_mission(surface_stay=500.0)
    fly(vehicle, mission=first, n=4)
    before = set(programs._known)
    deeper = replace(first, yo=replace(first.yo, dive_to=80.0), waypoint_radius=900.0, surface_stay=700.0)
    fly(vehicle, mission=deeper, n=4, speed=0.25)
    assert set(programs._known) == before


def test_counted_yos_bring_the_glider_up(vehicle):
    rules = (SurfaceRule("inflections", count=6), SurfaceRule("mission_done", ends_mission=True))
    run, track = fly(vehicle, mission=make_mission(surface=rules, waypoints=((41.5, -74.0),)))
    per_segment = np.diff(np.concatenate([[0.0], np.interp(track.surfacing_time[0], track.time, track.inflections[0])]))
    assert np.allclose(per_segment[:4], 6.0, atol=0.6)
    assert {track.reasons[r] for r in track.surfacing_reason[0] if r >= 0} == {"yo_count"}


def test_surfacing_by_count_on_the_last_leg_is_not_arriving(vehicle):
    rules = (SurfaceRule("inflections", count=6), SurfaceRule("mission_done", ends_mission=True))
    mission = make_mission(surface=rules, waypoints=((39.3, -74.0),), surface_stay=60.0)
    run, track = fly(vehicle, mission=mission, days=2.0)
    assert track.outcome[0] == Outcome.ARRIVED
    # 33 km at 0.3 m/s and some surfacings take more than a day; a count of three yos is up after half an hour.
    assert track.waypoint_time[0, 0] - track.time[0] > 1.1 * 86400.0
    assert track.latitude[0, -1] == pytest.approx(39.3, abs=0.01)


def test_flight_model_flies_as_fast_as_its_forces_say(vehicle):
    run = prepare(make_mission(**STRAIGHT), quiet(vehicle), speed="flight", duration=86400.0, spread=0.0, start=0.0)
    track = forecast(1, run)
    from glider_jax.physics.term import Sample

    down, up = (
        run.model.steady_glide(
            Sample.of("float32", density=run.column.density[8], sea_pressure=run.column.sea_pressure[8],
                      temperature=run.column.temperature[8],
                      pitch=sign * run.mission.yo.dive_pitch, direction=sign,
                      buoyancy_volume=sign * vehicle.value("flight.pump_volume"))
        )
        for sign in (-1.0, 1.0)
    )  # fmt: skip
    assert all(bool(g.valid) for g in (down, up))
    slowness = [1 / abs(float(g.depth_rate)) for g in (down, up)]
    forward = sum(float(g.horizontal_speed) * s for g, s in zip((down, up), slowness, strict=True)) / sum(slowness)
    assert track.distance_through_water[0, -1] / 86400.0 == pytest.approx(forward, rel=0.02)


def test_inputs_that_cannot_fly_are_refused(vehicle):
    with pytest.raises(ConfigError, match="at least 1 member"):
        forecast(0, _run(vehicle))
    with pytest.raises(CoverageError, match="inside the currents"):
        _run(vehicle, start_position=(30.0, -74.0))
    with pytest.raises(CoverageError, match="times of the currents"):
        _run(vehicle, start=9e9)
    land = synthetic_bathymetry("flat", depth=-3.0, latitude=39.0, longitude=-74.0)
    with pytest.raises(CoverageError, match="found land"):
        _run(vehicle, bathymetry=land)
    with pytest.raises(ConfigError, match="--speed"):
        choose_speeds(make_mission(), vehicle, "shoebocks", has_currents=True)
