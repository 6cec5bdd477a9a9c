"""The live forecast on a simulated glider: evidence, first dive, currents, no peeking, dialogs, mission files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.inference.evidence import dialog_segments, situation_of, surface_drift
from glider_jax.inference.live import assemble, chain, fly, target
from glider_jax.readers.dead_reckoning import Variation
from glider_jax.readers.dialogs import read_dialog
from glider_jax.readers.live_state import NoFix
from glider_jax.readers.recordings import read_recording
from glider_jax.readers.segments import dive_segments
from glider_jax.readers.vehicles import read_vehicle
from tests.mission.conftest import make_mission
from tests.readers.glider_layouts import simulate, write_native

N = 200


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    sim = simulate(dives=5, yos=6)
    return sim, read_recording(write_native(tmp_path_factory.mktemp("live") / "unit.nc", sim))


@pytest.fixture(scope="module")
def flown(simulated):
    """The forecast of the last dive from what was known before it, and that dive."""
    truth = dive_segments(simulated[1])[-1]
    situation = situation_of(simulated[1], moment=truth.start_time)
    return fly(assemble(situation, read_vehicle(None), n=N, seed=1)), truth


def test_the_situation_is_what_the_glider_did(simulated):
    sim, recording = simulated
    situation = situation_of(recording, moment=dive_segments(recording)[-1].start_time)
    known = situation.behaviour
    assert known.segments == 4 and situation.time <= dive_segments(recording)[-1].dive_time
    assert math.exp(known.duration.centre) == pytest.approx(sim.dives[0][1] - sim.dives[0][0], rel=0.02)
    assert known.held_heading == pytest.approx(sim.heading, abs=0.05)
    assert known.dive_to == pytest.approx(40.0, abs=1.0) and known.down == pytest.approx(0.15, rel=0.05)
    assert known.stay == pytest.approx(600.0, abs=30.0)
    assert situation.known_current == pytest.approx(complex(*sim.current), abs=0.02)
    estimate = assemble(situation, read_vehicle(None), n=N).estimate
    assert estimate.mean[:, :6].mean(axis=1) == pytest.approx(sim.current, abs=0.03)


def test_the_first_dive_lasts_as_drawn(flown):
    """The clock that brings a member up is chosen so that the time under water is the one it was dealt."""
    one, _ = flown
    up = np.isfinite(one.track.surfacing_time[:, 0])
    lasted = one.track.surfacing_time[up, 0] - one.scenario.times[0]
    assert up.mean() > 0.95
    assert np.quantile(np.abs(lasted - one.scenario.duration[up]), 0.95) < 5.0


def test_a_steady_glider_is_met_where_it_comes_up(flown):
    one, truth = flown
    scale = math.radians(1.0) * 6_371_000.0
    north = scale * (np.nanmedian(one.fix_latitude) - truth.end_latitude)
    east = scale * (np.nanmedian(one.fix_longitude) - truth.end_longitude) * math.cos(math.radians(40.0))
    assert math.hypot(north, east) < 0.12 * truth.distance + 30.0
    assert np.nanmedian(one.fix_time) == pytest.approx(truth.end_time, abs=180.0)
    low, high = np.nanquantile(one.fix_time, [0.05, 0.95])
    assert low < truth.end_time < high


def test_the_current_moves_the_members(simulated):
    """Each member is displaced by its own current times its own time: the engine feels what was sampled."""
    recording = simulated[1]
    situation = situation_of(recording)
    scenario = assemble(situation, read_vehicle(None), n=N, seed=2)
    still = replace(scenario, currents=np.zeros_like(scenario.currents), shear=np.zeros_like(scenario.shear))
    north = replace(still, currents=still.currents + np.array([0.0, 0.2])[:, None])
    a, b = (fly(s).track for s in (still, north))
    up = np.isfinite(a.surfacing_time[:, 0]) & np.isfinite(b.surfacing_time[:, 0])
    moved = (b.surfacing_latitude - a.surfacing_latitude)[up, 0] * math.radians(1.0) * 6_371_000.0
    lasted = a.surfacing_time[up, 0] - scenario.times[0]
    np.testing.assert_allclose(moved / lasted, 0.2, rtol=0.03)
    assert np.abs((b.surfacing_longitude - a.surfacing_longitude)[up, 0]).max() < 2e-4


def test_a_first_dive_astray_is_set_right_at_the_surface(simulated):
    """Every member starts off the wrong way; after its first surfacing it makes for the waypoint again."""
    situation = situation_of(simulated[1])
    goal = (situation.latitude + 0.2, situation.longitude)
    known = replace(situation, waypoint=goal)
    scenario = assemble(known, read_vehicle(None), n=N, seed=4, horizon=6 * 3600.0, interval=900.0)
    still = replace(
        scenario, currents=np.zeros_like(scenario.currents), shear=np.zeros_like(scenario.shear),
        heading=np.full(N, math.pi), later=np.zeros(N), duration=np.full(N, 3600.0),
    )  # fmt: skip
    track = fly(still).track
    north = track.latitude - situation.latitude
    hour, end = np.searchsorted(track.time - track.time[0], [3000.0, 5.9 * 3600.0])
    assert (north[:, hour] < 0).all() and (north[:, end] > north[:, hour] + 0.02).all()


def test_later_data_change_nothing(simulated):
    recording = simulated[1]
    moment = dive_segments(recording)[-1].start_time
    later = recording.time > moment
    garbled = {k: np.where(later, -v[::-1] + 3.0, v) for k, v in recording.channels.items()}
    seen = [situation_of(r, moment=moment) for r in (recording, replace(recording, channels=garbled))]
    first, second = (assemble(s, read_vehicle(None), n=N, seed=3) for s in seen)
    for name in ("duration", "speed", "heading", "currents", "shear", "east", "north"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_members_do_not_depend_on_chance_elsewhere(simulated):
    situation = situation_of(simulated[1])
    one, two = (assemble(situation, read_vehicle(None), n=N, seed=s).duration for s in (7, 7))
    other = assemble(situation, read_vehicle(None), n=N, seed=8).duration
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)


def test_waypoints_known_to_follow_are_flown(simulated):
    situation = situation_of(simulated[1])
    a, b = (40.1, -73.0), (40.2, -73.1)
    behaviour = replace(situation.behaviour, successors={a: b, b: a})
    points = chain(replace(situation, waypoint=a, behaviour=behaviour))
    assert points == (a, b, a, b)
    far = chain(replace(situation, waypoint=None))[0]
    east, north = (far[1] - situation.longitude) * math.cos(math.radians(40.0)), far[0] - situation.latitude
    assert math.atan2(east, north) == pytest.approx(situation.behaviour.held_heading, abs=0.02)


def test_the_mission_waypoint_is_the_one_headed_for(simulated):
    situation = replace(situation_of(simulated[1]), waypoint=None)
    here = (situation.latitude, situation.longitude)
    ahead = (here[0] + 0.3 * math.cos(1.0), here[1] + 0.3 * math.sin(1.0) / math.cos(math.radians(40.0)))
    mission = make_mission(waypoints=((here[0] - 0.3, here[1]), ahead))
    assert target(mission, situation) == 1
    assert target(mission, replace(situation, waypoint=mission.waypoints[0])) == 0
    reached = make_mission(waypoints=((here[0] - 0.3, here[1]), (here[0] + 0.001, here[1] + 0.001)))
    assert target(reached, situation) == 0


def test_without_a_fix_it_says_so(simulated):
    recording = simulated[1]
    bare = {k: v for k, v in recording.channels.items() if "latitude" not in k and "longitude" not in k}
    with pytest.raises(NoFix, match="expected a GPS fix"):
        situation_of(replace(recording, channels=bare))
    with pytest.raises(NoFix, match="dialog: expected a GPS fix"):
        situation_of(None, read_dialog("nothing here").surfacings)


def test_drift_at_the_surface():
    time = np.arange(0.0, 600.0, 30.0)
    scale = math.degrees(1.0 / 6_371_000.0)
    latitude = 40.0 + scale * 0.1 * time
    longitude = -73.0 - scale * 0.3 * time / math.cos(math.radians(40.0))
    latitude[7] += 0.01  # one wrong fix
    assert surface_drift(time, latitude, longitude, 0.0) == pytest.approx(complex(-0.3, 0.1), abs=0.01)
    assert np.isnan(surface_drift(time[:2], latitude[:2], longitude[:2], 0.0))


def dialog(
    clock, mission_time, fix, *, vx="0.10", vy="0.00", because="no comms for a while", when=12.0, extra=""
):
    """A surface dialog of our own making: ``fix`` is NMEA degrees and minutes."""
    return (
        f"Glider unit7 at surface.\nBecause:{because} [behavior surface_2 start_when = {when:.1f}]\n"
        f"MissionName:shelf.mi MissionNum:unit7-2026-086-1-{mission_time // 3600} "
        f"(0087.{mission_time // 3600:04d})\nVehicle Name: unit7\n"
        f"Curr Time: {clock} MT:  {mission_time}\n"
        f"GPS Location:  {fix[0]:.3f} N {fix[1]:.3f} E measured     20.0 secs ago\n"
        f"   sensor:c_wpt_lat(lat)=4020.000                  60.0 secs ago\n"
        f"   sensor:c_wpt_lon(lon)=-7300.000                 60.0 secs ago\n"
        f"   sensor:m_coulomb_amphr_total(amp-hrs)={50 + mission_time / 36000:.4f}   3.0 secs ago\n"
        f"   sensor:m_water_vx(m/s)={vx}        30.0 secs ago\n   sensor:m_water_vy(m/s)={vy}        30.0 secs ago\n"
        f"{extra}Waypoint: (4020.0000,-7300.0000) Range: 30000m, Bearing: 0deg, Age: 1:2h:m\n"
    )


TWO = dialog("Sat Mar 28 06:00:00 2026", 7200, (4000.0, -7300.0)) + "Hit Control-R to RESUME the mission\n" + dialog(
    "Sat Mar 28 09:00:00 2026", 18000, (4002.0, -7300.0)
)  # fmt: skip


def test_dialogs_alone_are_segments():
    """Two surfacings 3 h apart: north by two minutes of latitude, the current of 0.1 m/s turned by the variation."""
    log = read_dialog(TWO)
    assert len(log.surfacings) == 2
    east = dialog_segments(log.surfacings, Variation(0.0, 0.0, "given"))[0]
    assert east.north == pytest.approx(3706.0, rel=1e-2) and east.east == pytest.approx(0.0, abs=1.0)
    assert east.glider_current_east == pytest.approx(0.1) and abs(east.glider_current_north) < 1e-9
    west = dialog_segments(log.surfacings, Variation(math.radians(90.0), 0.0, "given"))[0]
    assert west.glider_current_north == pytest.approx(0.1)
    situation = situation_of(None, log.surfacings)
    assert situation.name == "unit7" and situation.waypoint == pytest.approx((40.0 + 20.0 / 60.0, -73.0))
    assert situation.charge_used == pytest.approx(3600.0 * 50.5, rel=1e-3)
    assert any("reference field" in text for text in situation.assumed)
    assert math.degrees(situation.variation.value) == pytest.approx(12.3, abs=1.5)
    assert math.exp(situation.behaviour.duration.centre) == pytest.approx(3 * 3600.0, rel=0.05)


def test_a_glider_that_is_not_in_a_mission_does_not_dive():
    with pytest.raises(DataError, match="expected a running mission"):
        situation_of(None, read_dialog(TWO + "\nGliderDos A 3 >\n").surfacings)
