"""What is learned from segments: durations, speeds, steering, waypoints; the signs of aiming off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.inference.behaviour import aim, learn, successors, waypoint_at, waypoint_log
from glider_jax.readers.dead_reckoning import EARTH_RADIUS, Variation
from glider_jax.readers.segments import Segment
from glider_jax.records import Recording, Source

HOUR = 3600.0
NONE = (np.empty(0),) * 3


def segment(
    begin, *, duration=2.0 * HOUR, water=(0.0, 2000.0), current=(0.0, 0.0), at=(40.0, -73.0), **changes
):
    """A plain segment that begins at a fix and ends at one a minute after surfacing."""
    nan = np.nan
    base = Segment(
        start_time=begin, start_latitude=at[0], start_longitude=at[1], dive_time=begin,
        surface_time=begin + duration, end_time=begin + duration + 60.0, end_latitude=at[0], end_longitude=at[1],
        maximum_depth=100.0, inflections=9, dive_pitch=-0.45, climb_pitch=0.45,
        east=water[0] + current[0] * duration, north=water[1] + current[1] * duration, water_east=water[0],
        water_north=water[1], dead_reckoning="own", heading=0.0, path_length=float(np.hypot(*water)) / 0.98,
        glider_current_east=current[0], glider_current_north=current[1], glider_current_from="final",
        current_east=current[0], current_north=current[1], drift_east=nan, drift_north=nan, charge_used=600.0,
        longest_hole=4.0, gap=False, dives=1, variation=Variation(0.0, 0.0, "given"),
    )  # fmt: skip
    return replace(base, **changes)


def log_of(*rows):
    return tuple(np.array([r[k] for r in rows], float) for k in range(3))


def test_aiming_off_leans_against_the_current():
    """Waypoint due north, water to the east: the glider points west of north, by arcsin(0.1 / 0.3)."""
    angle = aim(1000j, 0.1 + 0.0j, 0.3)
    assert angle == pytest.approx(2 * np.pi - np.arcsin(1 / 3))
    assert aim(1000j, 0.0 + 0.1j, 0.3) == pytest.approx(0.0, abs=1e-12)
    assert aim(1000 + 0j, 0j, 0.3) == pytest.approx(np.pi / 2)


def test_steady_dives_go_on():
    segments = [segment(2.5 * HOUR * k) for k in range(8)]
    known = learn(segments, [], NONE)
    times, astray = known.durations(4000, np.random.default_rng(0))
    assert np.median(times) == pytest.approx(2.0 * HOUR, rel=0.02)
    low, high = np.quantile(times[~astray], [0.05, 0.95]) / HOUR
    assert 1.75 < low < 1.95 < 2.05 < high < 2.3
    assert 0.02 < astray.mean() < 0.1
    speeds = known.speeds(4000, np.random.default_rng(0))
    assert np.median(speeds) == pytest.approx(2000.0 / (2 * HOUR), rel=0.02)
    assert known.charge_rate == pytest.approx(600.0 / (2 * HOUR + 60.0), rel=1e-6)
    assert known.stay == pytest.approx(0.5 * HOUR)


def test_changing_dives_are_believed_less():
    steady = [segment(2.5 * HOUR * k) for k in range(8)]
    wild = [
        segment(2.5 * HOUR * k, duration=d * HOUR)
        for k, d in enumerate((0.5, 2.0, 0.7, 2.2, 1.0, 0.4, 2.0, 0.7))
    ]
    assert learn(wild, [], NONE).duration.astray > 3 * learn(steady, [], NONE).duration.astray


def test_after_a_trial_dive_anything_may_come():
    known = learn([segment(0.0, duration=600.0, water=(0.0, 150.0))], [], NONE)
    times, astray = known.durations(4000, np.random.default_rng(1))
    assert astray.mean() > 0.4
    assert np.quantile(times, 0.95) > HOUR and np.median(times) < 0.4 * HOUR


def test_steering_is_told_from_what_was_flown():
    """Three ways of steering, each flown in turn: the belief goes to the one that was."""
    goal, start = (40.5, -73.0), (40.0, -73.0)
    log = log_of((-1.0, *goal))
    current = (0.12, 0.0)
    speed, span = 2000.0 / (2 * HOUR), 2 * HOUR

    def flown(angles):
        return [
            segment(
                2.5 * HOUR * k,
                water=(speed * span * np.sin(a), speed * span * np.cos(a)),
                current=current,
                at=start,
            )
            for k, a in enumerate(angles)
        ]

    aimed = learn(flown([aim(1000j, complex(*current), speed)] * 6), [], log)
    straight = learn(flown([0.0] * 6), [], log)
    held = learn(flown([1.2] * 6), [], log)
    for known, name in ((aimed, "aimed"), (straight, "waypoint"), (held, "held")):
        belief = {s.name: s.belief for s in known.steering}
        assert max(belief, key=belief.get) == name and sum(belief.values()) == pytest.approx(1.0)
    assert aimed.aims_off and not straight.aims_off
    told = {"waypoint": 0.0, "aimed": -0.4, "held": 1.2}
    drawn = held.headings(2000, np.random.default_rng(0), told)
    assert np.median(drawn) == pytest.approx(1.2, abs=0.1)


def test_a_direction_of_long_ago_is_forgotten():
    segments = [segment(2.5 * HOUR * k) for k in range(4)]
    now = segments[-1].end_time
    fresh, old = (learn(segments, [], NONE, now=now + age) for age in (600.0, 12 * 86400.0))
    share = [next(s.law.astray for s in k.steering if s.name == "held") for k in (fresh, old)]
    assert share[0] < 0.35 and share[1] > 0.99
    assert any("no waypoint" in text for text in fresh.assumed)


def test_waypoints_follow_each_other_and_zero_is_none():
    time = np.arange(6.0)
    latitude = np.array([0.0, 40.0, 40.0, 40.2, np.nan, 40.0])
    longitude = np.array([0.0, -73.0, -73.0, -73.1, np.nan, -73.0])
    one = Recording(
        "x",
        time,
        {"waypoint_latitude": latitude, "waypoint_longitude": longitude},
        Source("test"),
        np.empty(0),
    )
    log = waypoint_log(one)
    assert log[0].tolist() == [1.0, 2.0, 3.0, 5.0]
    assert waypoint_at(log, 0.5) is None and waypoint_at(log, 4.0) == (40.2, -73.1)
    assert successors(log) == {(40.0, -73.0): (40.2, -73.1), (40.2, -73.1): (40.0, -73.0)}


def test_without_dead_reckoning_the_current_is_taken_from_the_ground():
    missing = dict(water_east=np.nan, water_north=np.nan, path_length=np.nan, dead_reckoning="none")
    one = segment(0.0, current=(0.1, 0.0), **missing)
    known = learn([one], [], NONE)
    assert np.exp(known.speed.centre) == pytest.approx(2000.0 / (2 * HOUR), rel=1e-6)
    assert known.held_heading == pytest.approx(0.0, abs=1e-6)
    assert EARTH_RADIUS > 6e6
