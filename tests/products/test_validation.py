"""The published rows: calibration closes the books, signs and sizes follow, and the page says what was missed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glider_jax.environment.synthetic import synthetic_bathymetry, synthetic_currents
from glider_jax.mission.forecast import forecast
from glider_jax.products import validation as v
from glider_jax.products.validation_energy import Split, simulated_split, split_lines, split_text
from glider_jax.products.validation_flown import FlownDive, compare_flown, flown_lines, reckoned_current
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


def made_dive(**changes) -> FlownDive:
    """A flown dive of known energies."""
    made = FlownDive(
        1, 0.0, 3e3, {name: 1e3 for name in ("last", "none", "felt", "estimated")}, 60.0, (0.0, 120.0), 40.0, 41.0,
        (38.0, 33), (30e3, 36e3, 40e3), 27e3, 26e3, True, ("a note",),
        simulated=Split(11e3, 25e3, 10000.0), measured=Split(10e3, 16e3, 9600.0),
        fitted_energy=(24e3, 26.5e3, 29e3),
    )  # fmt: skip
    return replace(made, **changes)


def test_the_excess_of_energy_is_parted():
    dives = [made_dive(), made_dive(number=2, fitted_energy=(math.nan,) * 3)]
    text = split_text(dives)
    # 36 for 26 kJ; of 2 x 10 kJ 2 x 1 are the motors', 2 x (16/9.6) x 0.4 the longer time, the rest the load.
    assert "1.38 times what was drawn" in text
    assert "Of 20.0 kJ too much over 2 dives, 2.0 kJ are the motors', 1.3 kJ the longer time, and 16.7 kJ" in text
    assert "give 1.02 times what was drawn (1 of 2 dives" in text
    lines = split_lines(dives)
    assert "11.0 / 10.0 | 2.50 / 1.67 | 2.78 / 2.67 | 26.5 (24.0-29.0) / 26.0" in lines[2]
    assert "too little flown" in lines[3]
    assert "| - | - | - |" in split_lines([made_dive(measured=None)])[2]


def test_the_page_says_where_a_flown_dives_energy_went(rows, yos):
    calibration, ours, water = rows
    page = validation_page(calibration, ours, water, yos, [made_dive()])
    assert "the file's is a mean over days with other sensors switched on" in page and "- a note" in page
    numbers = validation_numbers(calibration, ours, water, yos, [made_dive()])
    flown = json.loads(json.dumps(numbers, allow_nan=False))["flown"][0]
    assert flown["measured"]["steady"] == 16e3


def test_components_are_parted_at_each_members_end(rows):
    track = rows[1][2].track
    ends = np.full(track.n, track.time.size - 1)
    split = simulated_split(track, ends)
    total = np.median(track.energy[:, -1].sum(-1))
    hotel = np.median(track.energy[:, -1, track.components.index("hotel")])
    assert split.steady == pytest.approx(hotel, rel=1e-6)
    assert split.motors + split.steady == pytest.approx(total, rel=0.02)
    assert split.watts == pytest.approx(hotel / (track.time[-1] - track.time[0]), rel=1e-6)


@pytest.mark.validation
def test_loads_of_the_hours_before_predict_the_energy_of_a_dive(real):
    folder = real("recordings", "comet2019")
    dives = compare_flown(folder / "comet2019.nc", folder / "missions/nsb3/missions/nsb3.mi", n=100)
    # The first dive of the day has nothing before it; the second has the first.
    assert math.isnan(dives[0].fitted_energy[1])
    low, middle, high = dives[1].fitted_energy
    assert middle == pytest.approx(dives[1].true_energy, rel=0.06) and low < dives[1].true_energy < high
    # The motors hold; the steady load of the vehicle's file is that of other days.
    assert dives[1].simulated.motors == pytest.approx(dives[1].measured.motors, rel=0.1)
    assert dives[1].simulated.watts > 1.4 * dives[1].measured.watts


@pytest.mark.validation
def test_the_flown_mission_beats_the_peer(real):
    folder = real("recordings", "comet2019")
    dives = compare_flown(folder / "comet2019.nc", folder / "missions/nsb3/missions/nsb3.mi", n=200)
    assert dives[0].miss["last"] < 6100.0 and dives[0].miss["none"] < 2700.0 and dives[0].miss["felt"] < 700.0
    assert abs(dives[0].late) < 17 * 60.0
    assert len(flown_lines(dives)) == 5


def test_the_notebook_was_run_and_is_small():
    path = Path(__file__).parents[2] / "notebooks" / "validation.ipynb"
    text = path.read_text(encoding="utf-8")
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert len(text) < 500_000 and all(cell["execution_count"] for cell in cells)
    kinds = [output["output_type"] for cell in cells for output in cell["outputs"]]
    assert "error" not in kinds and kinds.count("display_data") >= 5
    # Every row is in it, with the numbers of the page.
    assert all(row.name in text for row in v.PAPER)
