"""Dive segments of a simulated glider whose truth is known, and of the real recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.readers.dead_reckoning import (
    adds_water,
    magnetic_variation,
    metres,
    steady_angle_of_attack,
    to_true,
    true_heading,
)
from glider_jax.readers.recordings import read_recording
from glider_jax.readers.segments import (
    dive_segments,
    fixes,
    gaps,
    inflections,
    legs,
    phase,
    sampling,
    surfacings,
    until,
)
from tests.readers.glider_layouts import PITCH, RATE, simulate, write_native


@pytest.fixture(scope="module")
def sim():
    return simulate()


@pytest.fixture(scope="module")
def recording(sim, tmp_path_factory):
    return read_recording(write_native(tmp_path_factory.mktemp("sim") / "sim.nc", sim, nmea=True))


@pytest.fixture(scope="module")
def segments(recording):
    return dive_segments(recording, angle_of_attack=0.0)


def drop(recording, *names):
    return replace(recording, channels={k: v for k, v in recording.channels.items() if k not in names})


def test_segments_run_from_the_last_fix_to_the_first(sim, segments):
    assert len(segments) == len(sim.dives)
    for one, (begin, end) in zip(segments, sim.dives, strict=True):
        assert one.dive_time == pytest.approx(begin, abs=10.0)
        assert one.surface_time == pytest.approx(end, abs=10.0)
        assert one.start_time == pytest.approx(begin - 4.0)
        assert one.end_time == pytest.approx(end + 60.0)
        assert one.start_time <= one.dive_time < one.surface_time <= one.end_time
        assert one.maximum_depth == pytest.approx(40.0, abs=1.0)
        assert one.dives == 1 and not one.gap and one.longest_hole < 10.0


def test_displacements_are_those_flown(sim, segments):
    for one, (begin, end) in zip(segments, sim.dives, strict=True):
        speed = RATE / np.tan(PITCH)
        through = speed * (end - begin) * np.array([np.sin(sim.heading), np.cos(sim.heading)])
        np.testing.assert_allclose([one.water_east, one.water_north], through, rtol=0.01)
        drifted = 64.0 * np.array(sim.drift)
        ground = through + (end - begin) * np.array(sim.current) + drifted
        np.testing.assert_allclose([one.east, one.north], ground, rtol=0.01, atol=3.0)
        assert one.path_length == pytest.approx(np.hypot(*through), rel=0.01)
        assert one.heading == pytest.approx(sim.heading, abs=0.01)
        assert one.dead_reckoning == "own"


def test_own_current_is_the_true_one_and_not_the_surface_drift(sim, segments):
    for one in segments:
        np.testing.assert_allclose([one.current_east, one.current_north], sim.current, atol=0.003)
    for one in segments[1:]:
        np.testing.assert_allclose([one.drift_east, one.drift_north], sim.drift, atol=1e-3)


def test_without_drift_the_unknown_part_drifts_with_the_current(tmp_path):
    sim = simulate(dives=1, drift=(0.12, -0.05))
    got = read_recording(write_native(tmp_path / "x.nc", sim))
    keep = np.flatnonzero(np.isfinite(got["gps_latitude"]))
    thinned = {name: got[name].copy() for name in ("gps_latitude", "gps_longitude")}
    begin, end = sim.dives[0]
    before, after = keep[got.time[keep] < begin][-1], keep[got.time[keep] > end][0]
    for name in thinned:
        values = np.full(got.time.size, np.nan)
        values[[before, after]] = got[name][[before, after]]
        thinned[name] = values
    one = dive_segments(replace(got, channels=got.channels | thinned), angle_of_attack=0.0)[0]
    assert np.isnan(one.drift_east)
    np.testing.assert_allclose([one.current_east, one.current_north], sim.current, atol=0.003)


def test_the_gliders_own_current_is_taken_from_the_next_segment_and_turned_to_true(sim, segments):
    for one in segments:
        assert one.glider_current_from == "final"
        np.testing.assert_allclose([one.glider_current_east, one.glider_current_north], sim.current, rtol=5e-4)


def test_a_repeated_estimate_was_not_computed_anew(sim, recording):
    rows = np.flatnonzero(np.isfinite(recording["final_water_vx"]))
    assert rows.size == 3
    moved = dict(recording.channels)
    for name in ("final_water_vx", "final_water_vy"):
        moved[name] = recording[name].copy()
        moved[name][rows[1]] = moved[name][rows[0]]
    found = dive_segments(replace(recording, channels=moved))
    assert np.isfinite(found[0].glider_current_east)
    assert np.isnan(found[1].glider_current_east) and found[1].glider_current_from == ""


def test_charge_is_counted_between_the_fixes(segments):
    for one in segments:
        rows = (one.end_time - one.start_time) / 4.0
        assert one.charge_used == pytest.approx(3600.0 * 1e-4 * rows, rel=0.01)


def test_variation_recorded_given_estimated_true_or_assumed(sim, recording):
    assert magnetic_variation(recording)[::2] == pytest.approx((sim.variation, "recorded"))
    assert magnetic_variation(recording, 0.1).how == "given"
    silent = drop(recording, "magnetic_variation")
    found = magnetic_variation(silent)
    assert found.how == "estimated"
    assert found.value == pytest.approx(sim.variation, abs=0.005) and found.sigma >= np.radians(1.0)
    blind = magnetic_variation(drop(recording, "magnetic_variation", "latitude"))
    assert blind.how == "assumed" and blind.value == 0.0 and blind.sigma > 0.2
    true = replace(recording, attributes=recording.attributes | {"heading_reference": "true"})
    assert magnetic_variation(true)[::2] == (0.0, "true")


def test_magnetic_is_true_plus_variation(sim, recording):
    turn = magnetic_variation(recording)
    at = np.array([np.mean(sim.dives[0])])
    assert true_heading(recording, at, turn)[0] == pytest.approx(sim.heading)
    # Variation west positive: the local y axis, magnetic north, then points west of true north.
    east, north = to_true(0.0, 1.0, 0.2)
    assert east == pytest.approx(-np.sin(0.2)) and north == pytest.approx(np.cos(0.2))


def test_variation_is_estimated_the_same_when_the_firmware_adds_its_water_velocity(sim, recording):
    silent = drop(recording, "magnetic_variation")
    lat, lon = silent["latitude"].copy(), silent["longitude"].copy()
    water = (0.15, 0.1)
    east, north = to_true(*water, sim.variation)
    for begin, end in sim.dives:
        rows = (silent.time >= begin) & (silent.time < end)
        since = silent.time[rows] - begin
        lat[rows] += np.degrees(north * since / 6_371_000.0)
        lon[rows] += np.degrees(east * since / 6_371_000.0 / np.cos(np.radians(40.0)))
    n = silent.time.size
    more = {"latitude": lat, "longitude": lon, "water_vx": np.full(n, water[0]), "water_vy": np.full(n, water[1])}
    with_water = replace(silent, channels=silent.channels | more)
    assert not adds_water(silent) and adds_water(with_water)
    assert magnetic_variation(with_water).value == pytest.approx(sim.variation, abs=0.01)
    # Without pitch the firmware's positions stand in, and the velocity it added is taken off again.
    for one in dive_segments(drop(with_water, "pitch"), variation=sim.variation):
        assert one.dead_reckoning == "recorded"
        np.testing.assert_allclose([one.current_east, one.current_north], sim.current, atol=0.01)


def test_a_steeper_path_is_a_shorter_way(recording, segments):
    with_attack = dive_segments(recording, angle_of_attack=np.radians(2.5))[0]
    ratio = with_attack.distance_through_water / segments[0].distance_through_water
    assert ratio == pytest.approx(np.tan(PITCH) / np.tan(PITCH + np.radians(2.5)), rel=2e-3)
    usual = dive_segments(recording)[0]
    expected = np.tan(PITCH) / np.tan(PITCH + steady_angle_of_attack(PITCH))
    assert usual.distance_through_water / segments[0].distance_through_water == pytest.approx(expected, rel=2e-3)


def test_the_firmwares_angle_of_attack_is_used_where_recorded(recording, segments):
    attack = np.sign(recording["pitch"]) * np.radians(3.0)
    told = replace(recording, channels=recording.channels | {"angle_of_attack": attack})
    ratio = dive_segments(told)[0].distance_through_water / segments[0].distance_through_water
    assert ratio == pytest.approx(np.tan(PITCH) / np.tan(PITCH + np.radians(3.0)), rel=2e-3)


def test_legs_inflections_and_phases(sim, recording):
    found = legs(recording)
    assert len(found) == 8 * len(sim.dives)
    assert [leg.phase for leg in found[:8]] == [2, 1] * 4
    assert all(leg.pitch == pytest.approx(-PITCH if leg.phase == 2 else PITCH) for leg in found)
    turns = inflections(recording)
    assert len(turns) == 7 * len(sim.dives)
    assert all(t.depth == pytest.approx(40.0 if t.kind == "dive_to_climb" else 2.0, abs=1.0) for t in turns)
    assert dive_segments(recording)[0].inflections == 7
    flags = phase(recording)
    under = np.zeros(recording.time.size, bool)
    for begin, end in sim.dives:
        under |= (recording.time > begin + 12.0) & (recording.time < end - 12.0)
    assert set(np.unique(flags[under])) == {1, 2}
    rows = under & np.isfinite(recording["pitch"])
    agree = (flags[rows] == 2) == (recording["pitch"][rows] < 0.0)
    assert agree.mean() > 0.99
    surface = np.isfinite(recording["gps_latitude"])
    assert np.all(flags[surface] == 3)


def test_surfacings_hold_their_fixes(sim, recording):
    stays = surfacings(recording)
    assert len(stays) == len(sim.dives) + 1
    assert np.isnan(stays[0].start) and np.isnan(stays[-1].end)
    assert sum(s.time.size for s in stays) == fixes(recording)[0].size
    assert stays[1].end - stays[1].start == pytest.approx(600.0, abs=20.0)


def test_gaps_are_found_and_their_segments_flagged(sim, recording):
    begin, end = sim.dives[1]
    rows = (recording.time > begin + 200.0) & (recording.time < begin + 1500.0)
    kept = replace(recording, time=recording.time[~rows], channels={k: v[~rows] for k, v in recording.channels.items()})
    found = gaps(kept)
    assert found.shape == (1, 2) and found[0, 1] - found[0, 0] == pytest.approx(1300.0, abs=10.0)
    assert [s.gap for s in dive_segments(kept)] == [False, True, False]
    assert gaps(recording).shape == (0, 2)


def test_a_surfacing_without_a_fix_joins_two_dives(sim, recording):
    begin, end = sim.dives[0][1], sim.dives[1][0]
    rows = (recording.time > begin) & (recording.time < end)
    blanked = {name: np.where(rows, np.nan, recording[name]) for name in ("gps_latitude", "gps_longitude")}
    found = dive_segments(replace(recording, channels=recording.channels | blanked), angle_of_attack=0.0)
    assert [s.dives for s in found] == [2, 1]
    assert found[0].duration == pytest.approx(sim.dives[1][1] - sim.dives[0][0], abs=20.0)


def test_sampling_follows_the_ctd(sim, recording):
    assert sampling(recording) == pytest.approx({"ascent": 1.0, "descent": 1.0, "surface": 1.0}, abs=0.02)
    up = np.where((phase(recording) == 1), np.nan, recording["temperature"])
    found = sampling(replace(recording, channels=recording.channels | {"temperature": up}))
    assert found["ascent"] < 0.3 < 0.9 < found["descent"]


def test_later_rows_change_nothing_before_them(sim, recording):
    moment = sim.dives[1][1] + 590.0
    early = dive_segments(until(recording, moment), angle_of_attack=0.0)
    spoiled = {k: np.where(recording.time > moment, v + 1.0, v) for k, v in recording.channels.items()}
    again = dive_segments(until(replace(recording, channels=spoiled), moment), angle_of_attack=0.0)
    assert repr(early) == repr(again) and len(early) == 2


def test_without_fixes_positions_at_the_surface_stand_in(sim, recording):
    blind = drop(recording, "gps_latitude", "gps_longitude")
    found = dive_segments(blind, angle_of_attack=0.0)
    assert len(found) == len(sim.dives)
    np.testing.assert_allclose([found[0].current_east, found[0].current_north], sim.current, atol=0.02)


def test_a_recording_without_dives_has_no_segments(recording):
    flat = replace(recording, channels=recording.channels | {"depth": np.zeros(recording.time.size)})
    assert dive_segments(flat) == [] and legs(flat) == [] and inflections(flat) == []
    assert dive_segments(drop(recording, "depth")) == []


def test_metres_cross_the_antimeridian():
    east, north = metres(np.array([0.0]), np.array([-179.9]), (0.0, 179.9))
    assert east[0] == pytest.approx(0.2 * 111_194.9, rel=1e-4) and north[0] == 0.0


REAL = {
    # segments, median and worst difference of own current from the glider's, m/s
    "comet2019": (3, 0.015, 0.02),
    "osu684_2025": (8, 0.003, 0.004),
    "ru28_2017": (13, 0.004, 0.012),
    "maria2022": (34, 0.03, 0.15),
    "rosie2019": (6, 0.03, 0.05),
}


@pytest.mark.parametrize("name", REAL)
def test_real_segments_agree_with_the_gliders_own_currents(real, name):
    count, median, worst = REAL[name]
    found = dive_segments(read_recording(real("recordings", name, f"{name}.nc")))
    assert len(found) == count
    assert all(s.start_time <= s.dive_time < s.surface_time <= s.end_time and not s.gap for s in found)
    own = np.array([(s.current_east, s.current_north) for s in found])
    theirs = np.array([(s.glider_current_east, s.glider_current_north) for s in found])
    miss = np.hypot(*(own - theirs).T)
    assert np.isfinite(miss).sum() >= min(count, 27)
    assert np.nanmedian(miss) < median and np.nanmax(miss) < worst


@pytest.mark.parametrize("name, west_deg, within", [("ru28_2017", 12.6, 1.0), ("maria2022", -16.1, 1.0)])
def test_real_variation_is_estimated_where_it_was_not_recorded(real, name, west_deg, within):
    found = magnetic_variation(read_recording(real("recordings", name, f"{name}.nc")))
    assert found.how == "estimated"
    assert np.degrees(found.value) == pytest.approx(west_deg, abs=within)


def test_real_binaries_give_the_segments_of_their_netcdf(real):
    nc = dive_segments(read_recording(real("recordings", "rosie2019", "rosie2019.nc")))
    pytest.importorskip("dbdreader")
    raw = dive_segments(read_recording(real("recordings", "rosie2019", "orig")))
    assert len(nc) == len(raw)
    for a, b in zip(nc, raw, strict=True):
        assert a.dive_time == pytest.approx(b.dive_time, abs=0.1)
        assert a.east == pytest.approx(b.east, abs=0.2) and a.current_north == pytest.approx(b.current_north, abs=1e-3)


def test_real_inflections_match_the_vehicles_own_count(real):
    got = read_recording(real("recordings", "comet2019", "comet2019.nc"))
    counter = got["inflections"]
    for one in dive_segments(got):
        rows = np.isfinite(counter) & (got.time > one.start_time) & (got.time < one.end_time)
        # The vehicle also counts the turn at which it begins to surface or sink.
        assert abs((counter[rows].max() - counter[rows].min()) - one.inflections) <= 3
