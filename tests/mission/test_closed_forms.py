"""The compiled step in oceans whose answers can be written down."""

from __future__ import annotations

import math
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from glider_jax.config import SurfaceRule
from glider_jax.environment.synthetic import M2_PERIOD, ROTATION, synthetic_bathymetry, synthetic_currents
from glider_jax.errors import Outcome
from glider_jax.mission.forecast import forecast, prepare
from glider_jax.mission.plan import overshoot_time
from tests.mission.conftest import make_mission

SPEED, TANGENT = 0.3, math.tan(math.radians(26.0))
AREA = {"latitude": 39.0, "longitude": -74.0, "start": 0.0, "duration": 6 * 86400.0}
# Far enough north that the bearing stays the same, and no surfacing that would change the heading.
STRAIGHT = dict(waypoints=((41.5, -74.0),), surface=(SurfaceRule("mission_done", ends_mission=True),))


def quiet(vehicle):
    """The vehicle without a current error, so that closed forms are met by each member."""
    quantities = dict(vehicle.quantities)
    quantities["perturbation.current_error"] = replace(quantities["perturbation.current_error"], value=0.0)
    return replace(vehicle, quantities=quantities)


def fly(vehicle, currents=None, bathymetry=None, *, mission=None, n=1, days=1.0, spread=0.0, bundle=None, speed=SPEED,
        **options):
    """One deterministic flight, or an ensemble, in a given ocean."""
    mission = mission or make_mission(**STRAIGHT)
    run = prepare(
        mission, quiet(vehicle), currents=currents, bathymetry=bathymetry, duration=days * 86400.0, spread=spread,
        speeds=(np.array([speed, speed]), np.array([0.0, 1.0])), speed="shoebox", start=0.0, **options,
    )  # fmt: skip
    if bundle is not None:
        run = replace(run, plan=eqx.tree_at(lambda p: p.bundle, run.plan, run.plan.bundle * 0 + bundle))
    return run, forecast(n, run)


def metres(run, track):
    """Frame metres east and north of the start, along the ground near the start."""
    east, north = run.frame.to_metres(track.latitude, track.longitude)
    return east, north


def test_still_water_carries_the_glider_its_speed(vehicle):
    run, track = fly(vehicle)
    # North along a meridian: frame metres shrink with the meridian's radius, ground metres do not.
    assert track.distance_over_ground[0, -1] == pytest.approx(SPEED * 86400.0, rel=2e-5)
    assert track.longitude[0, -1] == pytest.approx(-74.0, abs=1e-5)
    assert track.outcome[0] == Outcome.FLYING


def test_uniform_flow_adds_to_the_track(vehicle):
    grid = synthetic_currents("uniform", east=0.2, north=-0.1, **AREA)
    run, track = fly(vehicle, grid)
    east, north = metres(run, track)
    t = track.time - track.time[0]
    sx, _ = run.frame.stretch(north[0])
    assert np.allclose(north[0], (SPEED - 0.1) * t, rtol=3e-4, atol=1.0)
    # East metres on the ground, which stretch in the frame as the glider goes north.
    assert np.allclose(np.diff(east[0]) / (0.5 * (sx[1:] + sx[:-1])), 0.2 * np.diff(t), rtol=1e-4)


def _solid_body(rate, t, velocity):
    """Position of a glider that flies with ``velocity`` (complex) through a solid-body rotation, from its centre."""
    return velocity / (1j * rate) * (np.exp(1j * rate * t) - 1.0)


def _gyre_error(vehicle, bundle):
    rate = 1.5e-5
    # A small area keeps the frame's stretch, which the closed form does not have, below a metre.
    grid = synthetic_currents("gyre", rate=rate, **(AREA | {"latitude": 0.0, "width": 200e3, "height": 200e3}))
    mission = make_mission(waypoints=((2.5, -74.0),), surface=STRAIGHT["surface"], start_position=(0.0, -74.0))
    run, track = fly(vehicle, grid, mission=mission, days=0.75, bundle=bundle, interval=300.0)
    east, north = metres(run, track)
    exact = _solid_body(rate, track.time - track.time[0], 1j * SPEED)
    return np.abs(east[0] + 1j * north[0] - exact)


def test_solid_body_rotation_and_order_of_the_step(vehicle):
    coarse, fine = (np.sqrt(np.mean(_gyre_error(vehicle, b) ** 2)) for b in (9000.0, 2250.0))
    assert fine < 6.0
    # Second order: four times the step, sixteen times the error.
    assert 10.0 < coarse / fine < 24.0


def test_linear_shear(vehicle):
    rate = 2e-6
    grid = synthetic_currents("shear", rate=rate, **(AREA | {"latitude": 0.0}))
    mission = make_mission(waypoints=((2.5, -74.0),), surface=STRAIGHT["surface"], start_position=(0.0, -74.0))
    run, track = fly(vehicle, grid, mission=mission)
    east, north = metres(run, track)
    t = track.time - track.time[0]
    assert np.allclose(north[0], SPEED * t, atol=3.0)
    assert np.allclose(east[0], 0.5 * rate * SPEED * t**2, atol=3.0)


@pytest.mark.parametrize("kind", ["tide", "inertial"])
def test_rotating_currents_move_the_glider_on_ellipses(vehicle, kind):
    if kind == "tide":
        rate, size, start = -2 * np.pi / M2_PERIOD, 0.15, 0.0
        grid = synthetic_currents("tide", major=size, minor=-size, interval=600.0, **AREA)
    else:
        rate, size, start = -2 * ROTATION * np.sin(np.radians(39.0)), 0.15, 0.0
        grid = synthetic_currents("inertial", speed=size, interval=600.0, **AREA)
    run, track = fly(vehicle, grid, days=2.0)
    _, still = fly(vehicle, days=2.0)
    east, north = metres(run, track)
    _, north0 = metres(run, still)
    t = track.time - track.time[0] - start
    exact = size / (1j * rate) * (np.exp(1j * rate * t) - 1.0)
    sx, _ = run.frame.stretch(0.5 * north[0])
    assert np.max(np.abs(east[0] / sx - exact.real)) < 15.0
    assert np.max(np.abs(north[0] - north0[0] - exact.imag)) < 15.0


def test_currents_that_vary_with_depth_carry_by_their_mean_over_the_yo(vehicle):
    grid = synthetic_currents("depth_shear", depth=100.0, surface_east=0.2, bottom_east=0.0, levels=11, **AREA)
    run, track = fly(vehicle, grid)
    east, north = metres(run, track)
    turn = 50.0 + SPEED * TANGENT * overshoot_time(vehicle, run.mission)
    top = 3.0 - SPEED * TANGENT * overshoot_time(vehicle, run.mission)
    mean = 0.2 * (1.0 - 0.5 * (max(top, 0.9) + turn) / 100.0)
    sx, _ = run.frame.stretch(0.5 * north[0, -1])
    assert east[0, -1] / sx / 86400.0 == pytest.approx(mean, rel=5e-3)


def test_sloping_bottom_sets_the_depth_of_turns_and_energy(vehicle):
    floor = synthetic_bathymetry("sloping", depth=30.0, slope=5e-4, bearing_deg=0.0, **_place())
    run, track = fly(vehicle, bathymetry=floor, days=0.5)
    # Yos per metre of path and their depth follow from the slope: dE/ds = (a + b z) tan / (2 (z - top)) per metre.
    tau = overshoot_time(vehicle, run.mission)
    over = SPEED * TANGENT * tau
    top = max(3.0 - over, 0.9)
    _, north = metres(run, track)
    end = north[0, -1]
    s = np.linspace(0.0, end, 4001)
    z = np.minimum(30.0 + 5e-4 * s - 5.0, 50.0) + over
    yos = np.trapezoid(TANGENT / (2 * (z - top)), s)
    v = vehicle.value
    cost = v("energy.pump_dive_to_climb.intercept") + v("energy.pump_dive_to_climb.slope") * z
    pump = np.trapezoid(cost * TANGENT / (2 * (z - top)), s)
    assert track.inflections[0, -1] == pytest.approx(2 * yos, rel=0.01)
    assert track.energy[0, -1, track.components.index("pump out")] == pytest.approx(pump, rel=0.01)


def _place():
    return {"latitude": 39.0, "longitude": -74.0, "width": 300e3, "height": 300e3}


def test_energy_is_the_sum_of_its_parts(vehicle):
    run, track = fly(vehicle, days=3.0, mission=make_mission(), n=4, spread=1.0)
    parts = {name: track.energy[:, -1, k].astype(float) for k, name in enumerate(track.components)}
    p = {k: v.astype(float) for k, v in track.parameters.items()}
    yos = track.inflections[:, -1] / 2
    duration = np.where(np.isnan(track.outcome_time), track.time[-1], track.outcome_time) - track.time[0]
    assert np.allclose(parts["pump in"], yos * p["energy.pump_climb_to_dive"], rtol=1e-4)
    assert np.allclose(parts["brake"], 2 * yos * p["energy.brake"], rtol=1e-4)
    assert np.allclose(parts["hotel"], p["energy.hotel"] * duration, rtol=2e-4)
    least = yos * p["energy.pump_dive_to_climb.intercept"]
    assert np.all(parts["pump out"] > least)


def test_surfaces_by_the_clock_and_drifts_with_the_surface_current(vehicle):
    grid = synthetic_currents("uniform", east=0.25, **AREA)
    mission = make_mission(waypoints=((41.5, -74.0),))
    run, track = fly(vehicle, grid, mission=mission)
    up, down = track.surfacing_time[0], track.dive_time[0]
    stays = (down - up)[np.isfinite(down)]
    assert np.allclose(stays, 600.0, atol=0.5)
    periods = np.diff(up[np.isfinite(up)])
    # Called up 3 h after the last surfacing began; the climb from the deepest point takes 50 m / w at most.
    assert np.all(periods >= 10800.0 - 1.0) and np.all(periods <= 10800.0 + 60.0 / (SPEED * TANGENT))
    x = run.frame.to_metres(track.surfacing_latitude[0], track.surfacing_longitude[0])[0]
    y = run.frame.to_metres(track.dive_latitude[0], track.dive_longitude[0])[0]
    drift = (y - x)[np.isfinite(y)] / run.frame.stretch(0.0)[0]
    assert np.allclose(drift, 0.25 * 600.0, rtol=0.03)
    assert {track.reasons[r] for r in track.surfacing_reason[0] if r >= 0} == {"every"}


def test_current_correction_holds_the_line(vehicle):
    grid = synthetic_currents("uniform", east=0.12, **AREA)
    off = []
    for correction in (False, True):
        mission = make_mission(waypoints=((39.6, -74.0),), current_correction=correction)
        run, track = fly(vehicle, grid, mission=mission, days=1.0)
        off.append(np.max(np.abs(metres(run, track)[0][0, 20:])))
    # Without it each segment drifts off and is pulled back; with it only the first one does.
    assert off[1] < 0.75 * off[0]


def test_reaches_waypoints_and_ends(vehicle):
    run, track = fly(vehicle, mission=make_mission(), days=4.0)
    assert track.outcome[0] == Outcome.ARRIVED
    leg = 0.4 * np.cos(np.radians(39.0)) * 111320.0
    # Speed made good includes the stays at the surface: 600 s in every 10,800 s and a little more.
    assert track.waypoint_time[0, 0] == pytest.approx((leg - 500.0) / SPEED * 1.06, rel=0.03)
    assert track.waypoint_time[0, 1] > track.waypoint_time[0, 0]
    assert not track.active[0, -1] and track.longitude[0, -1] == pytest.approx(-74.0, abs=0.02)
    assert track.reasons[track.surfacing_reason[0][track.surfacing_reason[0] >= 0][-1]] == "mission_done"
