"""The published rows: calibration closes the books, signs and sizes follow, and the page says what was missed."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.environment.synthetic import synthetic_bathymetry, synthetic_currents
from glider_jax.mission.forecast import forecast
from glider_jax.products import validation as v
from glider_jax.products.validation_flown import compare_flown, flown_lines, reckoned_current
from glider_jax.products.validation_report import validation_numbers, validation_page
from glider_jax.readers.bathymetry import read_bathymetry
from glider_jax.readers.currents import read_currents
from glider_jax.records import Recording, Source
from glider_jax_data import path as bundled_path


@pytest.fixture(scope="module")
def rows():
    currents = read_currents(bundled_path("new_jersey_currents.nc"))
    bathymetry = read_bathymetry(bundled_path("new_jersey_bathymetry.nc"))
    return v.six_rows(n=15, seed=3, bathymetry=bathymetry, currents=currents)


@pytest.fixture(scope="module")
def yos():
    return v.three_yos(n=60, seed=1)


def test_calibration_gives_the_published_constants(rows):
    calibration = rows[0]
    assert calibration.hotel == pytest.approx(0.2508, abs=1e-3)
    assert calibration.kilojoules == pytest.approx(536.0, abs=0.5)
    assert 120.0 < calibration.fixed < 240.0
    # 232 km at 26 degrees between the surface and 100 m is about 570 yos less what the overshoot saves.
    assert 540.0 < calibration.yos < 580.0
    assert calibration.yos * (calibration.fixed + calibration.slope * calibration.depth) == pytest.approx(
        536e3, rel=1e-3
    )


def test_baselines_close_and_the_other_rows_follow(rows):
    ours = rows[1]
    for row in ours[:2]:
        assert row.kilojoules[1] == pytest.approx(row.paper.kilojoules, rel=0.02)
        assert row.days[1] == pytest.approx(row.paper.days, rel=0.03)
    for row in ours[2:4]:
        assert abs(row.days_difference) < 0.05
        assert abs(row.energy_difference) < 0.10
    # The baselines' difference is steady load alone, so motors cost the same.
    assert ours[0].parts["pump out"] == pytest.approx(ours[1].parts["pump out"], rel=0.02)
    assert ours[2].inflections > 2.0 * ours[0].inflections
    assert ours[5].days[1] > ours[4].days[1] > ours[2].days[1]


def test_the_slope_has_no_say_in_the_baseline(rows):
    low, _, high = rows[1][0].kilojoules
    assert high - low < 0.01 * 707.0
    low, _, high = rows[1][2].kilojoules
    assert high - low > 0.02 * 892.0


def test_currents_counted_twice_cost_days(rows):
    _, ours, water = rows
    assert ours[5].days[1] > water[1].days[1] + 0.5
    assert water[0].speed_kind == "through_water"


def test_speeds_by_equal_distance_have_the_harmonic_mean(rows):
    track = rows[1][1].track
    seconds = (track.outcome_time - track.time[0]).mean()
    assert track.distance_through_water[:, -1].mean() / seconds == pytest.approx(0.233, rel=0.02)


def test_an_adverse_current_delays_as_the_formula_says():
    base = v.paper_mission()
    # Along the meridian, so that one component is the one along the track.
    mission = replace(base, start_position=(39.0, -73.0), waypoints=((38.4, -73.0), (39.0, -73.0)))
    place = {"latitude": 38.7, "longitude": -73.0, "width": 300e3, "height": 300e3}
    grid = synthetic_currents("uniform", north=0.113, start=base.start, duration=20 * v.DAY, **place)
    floor = synthetic_bathymetry("flat", depth=300.0, **place)
    run = v.prepare_row(mission, v.still_vehicle(), "shoebox", bathymetry=floor, currents=grid, days=12.0, spread=0.0)
    track = forecast(1, run)
    took, still = float(track.outcome_time[0] - run.t0), 2.0 * 66.7e3 / 0.34
    assert took / still == pytest.approx(1.0 / (1.0 - (0.113 / 0.34) ** 2), rel=0.02)
    assert v.effective_current(still, took, 0.34) == pytest.approx(0.113, rel=0.08)


def test_three_yos(yos):
    # 25 m and the overshoot below, 2 m less the overshoot above, three times there and back.
    assert 138.0 / (0.34 * math.tan(math.radians(26))) < yos.shoebox < 1000.0
    assert 0.5 < yos.overshoot < 3.0
    assert yos.later == pytest.approx(yos.shoebox * (0.34 / 0.233 - 1.0), abs=4 * yos.later_sd)
    assert yos.depth.shape[1] == yos.time.size


def test_the_page_holds_every_row_and_its_difference(rows, yos):
    calibration, ours, water = rows
    page = validation_page(calibration, ours, water, yos, ())
    for row in ours:
        assert row.paper.name in page
        assert f"{100 * row.energy_difference:+.1f}" in page
    numbers = validation_numbers(calibration, ours, water, yos, ())
    assert json.loads(json.dumps(numbers, allow_nan=False))["rows"][5]["days"] == 14.89


def test_the_page_names_rows_that_miss(rows, yos):
    calibration, ours, water = rows
    worse = [replace(ours[0], days=(9.0, 9.0, 9.0)), *ours[1:]]
    assert "Outside: SimShoebox baseline (+13.9 % days" in validation_page(calibration, worse, water, yos, ())


def test_spread_counts_those_that_never_came_as_late():
    assert v.spread_of(np.array([1.0, 2.0, np.inf])) == (1.0, 2.0, np.inf)


def test_the_current_reckoned_with_is_the_last_before_the_dive():
    time = np.array([0.0, 10.0, 20.0, 30.0])
    channels = {"water_vx": np.array([0.1, 0.2, np.nan, 0.9]), "water_vy": np.array([0.0, -0.3, np.nan, 0.9])}
    flight = Recording("toy", time, channels, Source("toy"), np.zeros(1))
    assert reckoned_current(flight, 25.0) == complex(0.2, -0.3)
    assert not np.isfinite(reckoned_current(flight, 25.0 + 2 * 86400.0).real)


@pytest.mark.validation
def test_the_flown_mission_beats_the_peer(real):
    folder = real("recordings", "comet2019")
    dives = compare_flown(folder / "comet2019.nc", folder / "missions/nsb3/missions/nsb3.mi", n=200)
    assert dives[0].miss["last"] < 6100.0 and dives[0].miss["none"] < 2700.0 and dives[0].miss["felt"] < 700.0
    assert abs(dives[0].late) < 17 * 60.0
    assert len(flown_lines(dives)) == 5
