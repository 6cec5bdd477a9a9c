"""What members say, against closed forms: percentiles, charge levels, approaches, areas and how places are written."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import Outcome
from glider_jax.products import measures
from glider_jax.products.coordinates import LocalFrame, degree_minutes, unwrap_longitude, wrap_longitude
from glider_jax.products.measures import NamedPolygon, Positions
from glider_jax.products.quantiles import Quantiles
from glider_jax.products.regions import normal_region, regions, simplify
from glider_jax.products.shapes import box_shape, lines, multipolygon, ring_area
from glider_jax.products.summary import summarise
from tests.products.tracks import end_members, gaussian_track


def straight(n=3, **changes):
    """Members without any spread: one path, one power."""
    return gaussian_track(n=n, spread=0.0, velocity_spread=0.0, power_spread=0.0, **changes)


def test_charge_levels_are_crossed_when_the_closed_form_says():
    track = straight(hours=72.0, usable_energy=1.0e6)
    power = 0.9 + 1.5 + 0.8 + 0.2 + 0.35
    expected = np.array([0.2, 0.15, 0.1]) * -1.0e6 / power + 1.0e6 / power
    inside = measures.crossing_times(track, np.array([0.2, 0.15, 0.1]))
    assert inside == pytest.approx(
        np.where(expected < 72 * 3600.0, expected, np.nan)[None].repeat(3, 0), nan_ok=True, rel=1e-4
    )
    later = measures.extrapolated_crossings(track, np.array([0.2, 0.15, 0.1]), inside)
    assert later == pytest.approx(expected[None].repeat(3, 0), rel=1e-4)


def test_a_member_that_ended_is_extrapolated_from_its_own_time():
    track = straight(hours=48.0, usable_energy=1.0e6)
    ended = end_members(track, [0], Outcome.AGROUND, 12 * 3600.0)
    level = np.array([0.1])
    crossed = measures.extrapolated_crossings(ended, level, measures.crossing_times(ended, level))
    assert crossed[0, 0] == pytest.approx(0.9e6 / 3.75, rel=1e-3)
    rates = measures.daily_rates(ended)
    assert rates["energy"].sum(axis=1) == pytest.approx(np.full(3, 3.75 * 86400.0), rel=1e-3)


def test_closest_approach_is_the_distance_from_the_line():
    track = straight(east=0.3, north=0.0, hours=24.0)
    positions = Positions(track, float(track.longitude[0, 0]))
    frame = LocalFrame(39.4, -74.2)
    latitude, longitude = frame.to_degrees(10_000.0, 3_000.0)
    assert measures.closest_approach(positions, (latitude, longitude)) == pytest.approx(np.full(3, 3000.0), rel=2e-3)
    # Behind the start the start itself is nearest.
    latitude, longitude = frame.to_degrees(-4_000.0, 3_000.0)
    assert measures.closest_approach(positions, (latitude, longitude)) == pytest.approx(np.full(3, 5000.0), rel=2e-3)


@pytest.mark.parametrize("longitude", [-74.2, 179.95])
def test_an_area_is_entered_when_the_line_meets_its_edge(longitude):
    track = straight(east=0.5, north=0.0, hours=24.0, longitude=longitude)
    frame = LocalFrame(39.4, longitude)
    corners = [(10_000, -500), (12_000, -500), (12_000, 500), (10_000, 500), (10_000, -500)]
    ring = np.array([[float(wrap_longitude(x)), y] for y, x in (frame.to_degrees(*c) for c in corners)])
    found = measures.entry_times(Positions(track, longitude), NamedPolygon("lane", (ring,)))
    assert found == pytest.approx(np.full(3, 20_000.0), rel=1e-4)
    hole = ring.copy()
    outside = NamedPolygon("all hole", (ring, hole))
    assert np.isnan(measures.entry_times(Positions(straight(hours=4.0, longitude=longitude), longitude), outside)).all()


def test_few_members_give_the_ellipse_that_holds_the_next_one():
    rng = np.random.default_rng(5)
    frame = LocalFrame(39.0, -73.0)
    held = []
    for _ in range(400):
        points = rng.normal(size=(8, 2)) * [300.0, 900.0]
        latitude, longitude = frame.to_degrees(*points[:7].T)
        region = regions(latitude, longitude, (0.9,))[0]
        assert region.method == "normal"
        x, y = (float(v) for v in points[7])
        ring = np.stack(frame.to_metres(region.polygons[0][0][:, 1], region.polygons[0][0][:, 0]), axis=1)
        angles = np.unwrap(np.arctan2(ring[:, 1] - y, ring[:, 0] - x))
        held.append(abs(angles[-1] - angles[0]) > np.pi)
    assert np.mean(held) == pytest.approx(0.9, abs=3.5 * np.sqrt(0.09 / 400))


def test_the_ellipse_of_many_members_is_that_of_the_normal_distribution():
    points = np.random.default_rng(6).normal(size=(100_000, 2)) * [400.0, 1000.0]
    region = normal_region(points, LocalFrame(0.0, 0.0), 0.5)
    assert region.area == pytest.approx(np.pi * 2.0 * np.log(2.0) * 400.0 * 1000.0, rel=0.01)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60), st.integers(1, 20))
@settings(max_examples=60, deadline=None)
def test_percentiles_in_blocks_are_those_of_numpy(values, size):
    values = np.array(values)
    quantiles = Quantiles(1)
    for k in range(0, len(values), size):
        quantiles.add(values[k : k + size])
    levels = (0.05, 0.25, 0.5, 0.75, 0.95)
    assert quantiles.at(levels)[:, 0] == pytest.approx(np.quantile(values, levels), rel=1e-9, abs=1e-9)
    assert quantiles.mean()[0] == pytest.approx(values.mean(), rel=1e-9, abs=1e-6)


def test_percentiles_beyond_the_limit_are_good_to_a_thousandth_of_the_range():
    rng = np.random.default_rng(7)
    values = np.concatenate([rng.normal(size=5000), rng.normal(40.0, 3.0, size=5000)])
    counted = Quantiles(1, limit=1000)
    for k in range(0, len(values), 500):
        counted.add(values[k : k + 500])
    levels = (0.05, 0.25, 0.75, 0.95)
    assert counted.at(levels)[:, 0] == pytest.approx(np.quantile(values, levels), abs=np.ptp(values) * 2e-3)


def test_what_did_not_happen_is_late_among_all_and_left_out_otherwise():
    for limit in (100, 3):
        quantiles = Quantiles(1, limit=limit)
        for value in (1.0, 2.0, 3.0, 4.0, np.nan, np.nan, np.nan, np.nan):
            quantiles.add(np.array([value]))
        assert quantiles.share()[0] == 0.5
        assert quantiles.at((0.5,))[0, 0] == pytest.approx(2.5, abs=0.6)
        assert np.isnan(quantiles.at((0.9,), of_all=True)[0, 0])


@given(st.floats(-90, 90), st.integers(1, 5))
def test_degrees_and_minutes_say_the_same_place(value, digits):
    text = degree_minutes(value, "lat", digits)
    degrees, minutes, hemisphere = re.fullmatch(r"(\d\d)°([\d.]+)′([NS])", text).groups()
    assert float(minutes) < 60.0
    back = (int(degrees) + float(minutes) / 60.0) * (1 if hemisphere == "N" else -1)
    assert back == pytest.approx(value, abs=0.5000001 * 10.0**-digits / 60.0 + 1e-12)


@given(st.floats(-720, 720), st.floats(-360, 360))
def test_longitudes_keep_their_place(longitude, reference):
    wrapped, near = float(wrap_longitude(longitude)), float(unwrap_longitude(longitude, reference))
    assert -180.0 <= wrapped < 180.0 and abs(near - reference) <= 180.0 + 1e-9
    for other in (wrapped, near):
        turns = (other - longitude) / 360.0
        assert turns == pytest.approx(round(turns), abs=1e-9)


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_metres_and_degrees_are_inverse(latitude, longitude, east, north):
    frame = LocalFrame(latitude, longitude)
    back = frame.to_metres(*frame.to_degrees(east, north))
    assert np.array(back) == pytest.approx(np.array([east, north]), abs=1e-3)


def test_shapes_across_the_antimeridian_are_cut_there():
    ring = np.array([[178.0, 0.0], [183.0, 0.0], [183.0, 2.0], [178.0, 2.0], [178.0, 0.0]])
    west, east = multipolygon(((ring,),))["coordinates"]
    areas = [ring_area(np.array(part[0])) for part in (west, east)]
    assert areas == pytest.approx([4.0, 6.0])
    assert np.max(west[0], axis=0)[0] == 180.0 and np.min(east[0], axis=0)[0] == -180.0
    box = {"south": -1.0, "north": 1.0, "west": 179.0, "east": -179.0}
    assert sum(ring_area(np.array(part[0])) for part in box_shape(box)["coordinates"]) == pytest.approx(4.0)
    line = lines(np.array([179.0, -179.0]), np.array([0.0, 2.0]))
    assert line["coordinates"] == [[[179.0, 0.0], [180.0, 1.0]], [[-180.0, 1.0], [-179.0, 2.0]]]


def test_simpler_rings_stay_within_the_tolerance():
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fewer = simplify(ring, 0.01)
    assert len(fewer) < 60 and fewer[0] == pytest.approx(fewer[-1], abs=1e-12)
    assert abs(ring_area(fewer)) == pytest.approx(np.pi, rel=0.02)


def test_boxes_hold_the_members_they_promise():
    track = gaussian_track(n=4000, hours=24.0)
    for entry in summarise(track)["boxes"][::6]:
        k = int(np.searchsorted(track.time - track.time[0], entry["to_h"] * 3600.0))
        for key, whole in (("all", 1.0), ("ninety", 0.90)):
            box = entry[key]
            inside = (track.latitude[:, k] >= box["south"] - 1e-5) & (track.latitude[:, k] <= box["north"] + 1e-5)
            inside &= (track.longitude[:, k] >= box["west"] - 1e-5) & (track.longitude[:, k] <= box["east"] + 1e-5)
            assert inside.mean() >= whole - 0.005
