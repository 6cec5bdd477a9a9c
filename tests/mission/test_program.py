"""Mission programs: closed forms of when a rule fires and what it does, and that idle rules change nothing.

Most tests share one program whose rules are idle but for those a test wakes, so that they share a compiled one too.
"""

from __future__ import annotations

import math
from dataclasses import replace

import jax
import numpy as np
import pytest

from glider_jax.config import Aborts, Condition, ProgramRule, SurfaceRule
from glider_jax.environment.synthetic import synthetic_bathymetry, synthetic_currents
from glider_jax.errors import ConfigError, Outcome
from glider_jax.mission.forecast import forecast, most_surfacings, prepare
from glider_jax.mission.plan import overshoot_time
from tests.mission.conftest import make_mission
from tests.mission.test_closed_forms import AREA, SPEED, TANGENT, metres, quiet

DAY, HOUR, NEVER = 86400.0, 3600.0, 1e9
OUT = ((41.5, -74.0), (39.0, -74.0))
EAST = ((39.0, -73.6), (39.0, -74.0))


def rule(kind, value, *more, **actions):
    """A rule with one condition, or several as further pairs."""
    return ProgramRule(tuple(Condition(k, float(v)) for k, v in [(kind, value), *more]), **actions)


def kit(*, energy=NEVER, charge=0.001, place=NEVER, late=NEVER, closer=0.0, up=NEVER, end=NEVER, often=NEVER,
        shallow=NEVER, deep=NEVER, window=(NEVER, NEVER)):  # fmt: skip
    """Eleven rules, idle but for those whose threshold is given."""
    return (
        rule("energy_used_above", energy, goto="home"),
        rule("state_of_charge_below", charge, goto="home"),
        rule("elapsed_above", place, goto=(39.3, -74.0)),
        rule("flying_to_waypoint", 1, ("elapsed_above", late), goto="next"),
        rule("flying_to_waypoint", 2, ("waypoint_closer_than", closer), goto=1),
        rule("elapsed_above", up, surface_now=True),
        rule("elapsed_above", end, end_mission=True),
        rule("time_after", often, surface_every=HOUR),
        rule("elapsed_above", shallow, dive_to=20.0),
        rule("elapsed_above", deep, dive_to=40.0, climb_to=5.0),
        rule("elapsed_above", window[0], ("elapsed_below", window[1]), goto=(39.3, -74.0), once=False),
    )


def fly(vehicle, program, *, waypoints=OUT, every=NEVER, days=4.0, spread=0.0, **changes):
    """Four members at one speed in still water, all alike unless spread."""
    rules = (SurfaceRule("every", seconds=every), SurfaceRule("mission_done", ends_mission=True))
    mission = make_mission(waypoints=waypoints, surface=rules, program=program, **changes)
    run = prepare(
        mission, quiet(vehicle), duration=days * DAY, interval=600.0, spread=spread, speed="shoebox", start=0.0,
        speeds=(np.array([SPEED, SPEED]), np.array([0.0, 1.0])),
    )  # fmt: skip
    return run, forecast(4, run)


def seconds(track, number):
    """First time of a rule (from 1) since the start, s, of the first member."""
    return float(track.program_time[0, number - 1] - track.time[0])


def yo_seconds(mission, vehicle):
    """Depth of a turn, duration of the first yo and of all others at the constant speed."""
    w = SPEED * TANGENT
    lead = w * overshoot_time(vehicle, mission)
    turn, top = mission.yo.dive_to + lead, max(mission.yo.climb_to - lead, 0.3 * mission.yo.climb_to)
    return turn, (2.0 * turn - top) / w, 2.0 * (turn - top) / w


def test_home_at_an_energy_turns_where_the_sum_says(vehicle):
    limit = 60e3
    run, track = fly(vehicle, kit(energy=limit))
    mission = run.mission
    turn, first, cycle = yo_seconds(mission, vehicle)
    value = vehicle.value
    stroke = (2.0 * value("flight.pump_volume")) / value("energy.pump_dive_to_climb.reference_volume")
    yo = value("energy.pump_dive_to_climb.intercept") + value("energy.pump_dive_to_climb.slope") * turn
    yo = yo * stroke + value("energy.pump_climb_to_dive") + 2.0 * value("energy.brake")
    number = np.arange(1, 400)
    time = first + (number - 1) * cycle
    energy = value("energy.hotel") * time + number * yo
    expected = time[np.argmax(energy > limit)]
    assert seconds(track, 1) == pytest.approx(expected, abs=0.02 * cycle)
    assert track.program_count[0].tolist() == [1] + [0] * 10
    # As far out as it flew until then, and home again: the radius is spared on the way back.
    north = (track.latitude[0] - 39.0) * 111.0e3
    assert north.max() == pytest.approx(SPEED * expected, rel=0.005)
    assert track.outcome[0] == Outcome.ARRIVED
    back = expected + (SPEED * expected - mission.waypoint_radius) / SPEED
    assert track.outcome_time[0] - track.time[0] == pytest.approx(back, abs=2.0 * cycle)
    # Home is none of the mission's waypoints.
    assert np.isnan(track.waypoint_time).all()


def test_the_charge_at_which_a_rule_fires_is_that_of_the_track(vehicle):
    small = replace(vehicle.battery, capacity=replace(vehicle.battery.capacity, value=8.0 * HOUR))
    aborts = Aborts(remaining_charge=0.1, undervolts=10.5)
    _, track = fly(replace(vehicle, battery=small), kit(charge=0.6), spread=1.0, aborts=aborts)
    fired = track.program_time[:, 1]
    assert np.isfinite(fired).all() and np.ptp(fired) > HOUR
    left = np.array([np.interp(t, track.time, soc) for t, soc in zip(fired, track.state_of_charge, strict=True)])
    # One yo takes about a hundredth of this pack.
    assert (left > 0.6 - 0.02).all() and (left < 0.6 + 0.003).all()


def test_late_at_a_waypoint_goes_on_to_the_next(vehicle):
    # 34 km to the first waypoint take 1.3 days at 0.3 m/s; after half a day it is given up.
    _, track = fly(vehicle, kit(late=0.5 * DAY), waypoints=EAST)
    assert 0.5 * DAY <= seconds(track, 4) < 0.5 * DAY + 1800.0
    assert np.isnan(track.waypoint_time[0, 0]) and np.isfinite(track.waypoint_time[0, 1])
    assert track.outcome[0] == Outcome.ARRIVED
    assert track.outcome_time[0] - track.time[0] == pytest.approx(DAY, abs=0.08 * DAY)


@pytest.mark.parametrize("legs", [-2, -1])
def test_a_place_ends_the_mission_also_where_the_list_starts_again(vehicle, legs):
    _, track = fly(vehicle, kit(place=0.25 * DAY), waypoints=EAST, legs=legs)
    assert track.outcome[0] == Outcome.ARRIVED
    off = np.hypot((track.outcome_latitude[0] - 39.3) * 111e3, (track.outcome_longitude[0] + 74.0) * 86e3)
    assert off < 900.0
    assert np.isnan(track.waypoint_time).all()


def test_a_way_elsewhere_ends_with_its_condition(vehicle):
    run, track = fly(vehicle, kit(window=(0.25 * DAY, 0.5 * DAY)), waypoints=EAST)
    east, north = metres(run, track)
    time = track.time - track.time[0]
    # North-west for a quarter of a day, then to the waypoint of the list that was flown to before.
    out, back = np.searchsorted(time, [0.26 * DAY, 0.49 * DAY])
    assert abs(north[0, out]) < 500.0 and north[0, back] > 5000.0
    assert np.isfinite(track.waypoint_time[0]).all() and track.outcome[0] == Outcome.ARRIVED
    way = SPEED * 0.49 * DAY + np.hypot(34.6e3 - east[0, back], north[0, back])
    assert track.waypoint_time[0, 0] - track.time[0] == pytest.approx(way / SPEED, rel=0.03)
    assert track.program_count[0].tolist() == [0] * 10 + [1]


def test_back_to_a_waypoint_by_its_number(vehicle):
    run, track = fly(vehicle, kit(closer=20e3), waypoints=EAST)
    east, _ = metres(run, track)
    assert track.program_count[0, 4] == 1
    fired = np.searchsorted(track.time, track.program_time[0, 4])
    assert east[0, fired] == pytest.approx(20e3, abs=600.0)
    # From there to the east again, then home.
    assert east[0, fired:].max() > 33e3 and track.outcome[0] == Outcome.ARRIVED


def test_it_comes_up_when_asked_and_says_why(vehicle):
    run, track = fly(vehicle, kit(up=5.0 * HOUR))
    surfaced = track.surfacing_time[0] - track.time[0]
    # At the end of the yo under way, and a few metres down again before it comes up.
    assert 5.0 * HOUR < surfaced[0] < 5.0 * HOUR + 900.0
    assert track.reasons[track.surfacing_reason[0, 0]] == "program"
    assert np.isfinite(surfaced).sum() == 1 and most_surfacings(run) >= 1


def test_it_ends_when_asked(vehicle):
    _, track = fly(vehicle, kit(end=5.0 * HOUR))
    assert track.outcome[0] == Outcome.ABORTED
    assert 5.0 * HOUR < track.outcome_time[0] - track.time[0] < 5.0 * HOUR + 900.0
    assert track.depth[0, -1] == 0.0


def test_surfacings_come_at_the_new_interval_from_the_next_dive(vehicle):
    _, track = fly(vehicle, kit(often=12.0 * HOUR), every=3.0 * HOUR)
    up = track.surfacing_time[0][np.isfinite(track.surfacing_time[0])] - track.time[0]
    gaps, begun = np.diff(up), up[:-1]
    # A dive that is due too soon to end is not begun anew: up to a yo more.
    assert np.abs(gaps[begun < 9.0 * HOUR] - 3.0 * HOUR).max() < 200.0
    assert np.abs(gaps[begun > 12.1 * HOUR] - HOUR).max() < 400.0


def test_the_first_rule_wins(vehicle):
    _, track = fly(vehicle, kit(shallow=60.0, deep=60.0))
    settled = track.time - track.time[0] > HOUR
    assert 20.0 < track.depth[0, settled].max() < 24.0
    _, track = fly(vehicle, kit(shallow=6.0 * HOUR, deep=60.0))
    middle = settled & (track.time - track.time[0] < 6.0 * HOUR)
    assert 40.0 < track.depth[0, middle].max() < 45.0
    assert track.depth[0, track.time - track.time[0] > 7.0 * HOUR].max() < 24.0


def test_rules_that_never_fire_change_no_bit(vehicle):
    idle = (
        *kit(),
        rule("bottom_shallower_than", 0.5, ("elapsed_above", 0.0), altitude=20.0, pitch=0.5, once=False),
        rule("current_faster_than", 5.0, ("flying_to_waypoint", 2), goto="next", once=False),
    )
    grid = synthetic_currents("tide", major=0.15, minor=0.05, interval=600.0, **AREA)
    plain = make_mission()
    tracks = []
    for program in ((), idle):
        run = prepare(
            replace(plain, program=program), vehicle, currents=grid, speed="shoebox", duration=2 * DAY, interval=HOUR,
            start=0.0, speeds=(np.array([0.2, 0.4]), np.array([0.0, 1.0])),
        )  # fmt: skip
        tracks.append(forecast(8, run))
    assert np.isnan(tracks[1].program_time).all() and (tracks[1].program_count == 0).all()
    for name in ("latitude", "longitude", "energy", "depth", "outcome", "waypoint_time", "distance_over_ground"):
        np.testing.assert_array_equal(getattr(tracks[0], name), getattr(tracks[1], name))
    both = min(t.surfacing_time.shape[1] for t in tracks)
    np.testing.assert_array_equal(tracks[0].surfacing_time[:, :both], tracks[1].surfacing_time[:, :both])


def test_rules_revert_or_stay_and_count_how_often(vehicle):
    # The seafloor deepens along the way; a tide turns four times in two days, felt at each surfacing.
    place = {"latitude": 39.0, "longitude": -74.0, "width": 200e3, "height": 200e3}
    floor = synthetic_bathymetry("sloping", depth=60.0, slope=0.004, bearing_deg=0.0, **place)
    grid = synthetic_currents("tide", major=0.3, minor=0.0, interval=600.0, **AREA)
    deepening = rule("bottom_shallower_than", 100.0, dive_to=20.0, once=False)
    swift = rule("current_faster_than", 0.2, altitude=8.0)
    program = (deepening, swift, replace(swift, once=False, altitude=6.0))
    rules = (SurfaceRule("every", seconds=HOUR), SurfaceRule("mission_done", ends_mission=True))
    mission = make_mission(waypoints=OUT, surface=rules, program=program)
    run = prepare(
        mission, quiet(vehicle), currents=grid, bathymetry=floor, duration=2.0 * DAY, interval=300.0, spread=0.0,
        speed="shoebox", start=0.0, speeds=(np.array([SPEED, SPEED]), np.array([0.0, 1.0])),
    )  # fmt: skip
    track = forecast(1, run)
    _, north = metres(run, track)
    depth = np.asarray(jax.jit(jax.vmap(lambda n: run.environment.bathymetry.depth(n * 0.0, n)[0]))(north[0]))
    # A dive under way ends as it began.
    settled = np.roll(depth, 4) < 98.0
    settled[:4] = False
    assert (settled & (depth < 98.0)).any() and (depth > 104.0).any()
    assert track.depth[0][settled & (depth < 98.0)].max() < 24.0
    assert track.depth[0][depth > 104.0].max() > 45.0
    assert track.program_count[0, 1] == 1 and 3 <= track.program_count[0, 2] <= 9
    assert track.program_time[0, 1] == track.program_time[0, 2]


def test_pitch_and_depth_under_the_flight_model_fly_as_such(vehicle):
    angle = math.radians(40.0)

    def pace(pitched=NEVER, deep=NEVER, **changes):
        program = (rule("elapsed_above", pitched, pitch=angle), rule("elapsed_above", deep, dive_to=150.0))
        mission = make_mission(waypoints=OUT, program=program, **changes)
        run = prepare(mission, vehicle, speed="flight", duration=0.5 * DAY, interval=700.0, spread=0.0, start=0.0)
        track = forecast(1, run)
        return np.diff(track.distance_through_water[0]), np.diff(track.inflections[0]), track.depth[0].max()

    as_given, mixed = pace(), pace(0.25 * DAY)
    steep = pace(yo=replace(make_mission().yo, dive_pitch=angle, climb_pitch=angle))
    half = mixed[0].size // 2
    for k in range(2):
        assert mixed[k][2 : half - 2].mean() == pytest.approx(as_given[k][2 : half - 2].mean(), rel=0.05)
        assert mixed[k][half + 3 :].mean() == pytest.approx(steep[k][half + 3 :].mean(), rel=0.05)
    assert steep[1].mean() / as_given[1].mean() > 1.25
    assert as_given[2] < 60.0 and pace(deep=0.2 * DAY)[2] > 140.0


def test_a_waypoint_that_is_not_flown_is_refused(vehicle):
    mission = make_mission(first_waypoint=1, program=(rule("elapsed_above", 60.0, goto=1),))
    with pytest.raises(ConfigError, match="number 1, which the mission leaves out"):
        prepare(mission, vehicle, start=0.0)


def test_rules_on_what_is_not_there_are_told(vehicle):
    mission = make_mission(program=(rule("bottom_shallower_than", 20.0, goto="home"),))
    run = prepare(mission, vehicle, start=0.0, speed="shoebox")
    assert any("no bathymetry given" in note for note in run.notes)
    assert run.settings["program"] == ["rule 1 'bottom shallower than 20 m: go to home'"]
