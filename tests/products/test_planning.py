"""Weighing missions: choices are checked, differences have the right sign, and an impossible mission gets an answer."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.config import Condition, Mission, ProgramRule, SurfaceRule, Yo
from glider_jax.environment.synthetic import synthetic_bathymetry, synthetic_currents
from glider_jax.errors import ConfigError
from glider_jax.products.job import Options
from glider_jax.products.planning import (
    Case,
    Setting,
    apply_choices,
    common_interval,
    fly_setting,
    parse_choices,
    settings_of,
    sweep,
)
from glider_jax.products.planning_choice import goal_of, pareto, recommend, sensitivities, why_not
from glider_jax.products.planning_report import PlanOptions, plan_numbers, plan_page, with_devices, words
from glider_jax.readers.vehicles import read_vehicle

START = 1252152000.0
PLACE = {"latitude": 39.0, "longitude": -73.0, "width": 300e3, "height": 300e3}


@pytest.fixture(scope="module")
def case():
    mission = Mission(
        "toy",
        waypoints=((39.0, -72.8), (39.0, -73.0)),
        yo=Yo(60.0, 3.0, math.radians(26), math.radians(26)),
        surface=(SurfaceRule("every", seconds=6 * 3600.0), SurfaceRule("mission_done", ends_mission=True)),
        start=START,
        start_position=(39.0, -73.0),
    )
    vehicle = with_devices(read_vehicle("slocum_g1_shallow"), None)
    floor = synthetic_bathymetry("flat", depth=200.0, **PLACE)
    return Case(mission, vehicle, bathymetry=floor, days=1.0, loop=True, n=6, seed=2)


@pytest.fixture(scope="module")
def flown(case):
    choices = parse_choices(["pitch=20,30", "dive_to=2,60", "battery=alkaline,lithium_primary_3s"])
    return sweep(case, choices)


@pytest.fixture(scope="module")
def tide():
    """Currents of five days that turn."""
    return synthetic_currents("tide", major=0.2, minor=0.1, start=START - 3600.0, duration=5 * 86400.0, **PLACE)


def made(values, success, **choices):
    """A setting whose goal is given, for rules of choice without flying."""
    value = np.asarray(values, float)
    return Setting(
        choices=choices, days=np.full(value.size, 10.0), km=value, profiles=value, wh=100.0 - value,
        left=np.full(value.size, 0.5), contacts=np.ones(value.size), finished=np.ones(value.size, bool),
        success=np.asarray(success, bool), outcome=np.ones(value.size, int),
        story={"closest_km": 1.0, "speed": 0.3, "current_along": 0.0, "battery_out": 0.0, "battery_days": math.nan},
    )  # fmt: skip


def test_choices_are_read_and_combined():
    choices = parse_choices(["pitch=20, 26,26", "battery=alkaline"])
    assert choices == {"pitch": (20.0, 26.0), "battery": ("alkaline",)}
    assert [c["pitch"] for c in settings_of(choices)] == [20.0, 26.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pich=20", "Did you mean 'pitch'"),
        ("pitch=", "expected values"),
        ("pitch=steep", "expected numbers"),
        ("pitch=nan", "finite"),
        ("battery=alkalin", "Did you mean 'alkaline'"),
    ],
)
def test_wrong_choices_are_explained(text, said):
    with pytest.raises(ConfigError, match=said):
        parse_choices([text])


def test_waypoints_may_be_flown_in_any_order(case):
    three = replace(case, mission=replace(case.mission, waypoints=((39.0, -72.8), (39.1, -72.9), (39.0, -73.0))))
    assert parse_choices(["order=given,3-1-2"]) == {"order": ("given", "3-1-2")}
    points = three.mission.waypoints
    flown = apply_choices(three, {"order": "3-1-2"}).mission.waypoints
    assert flown == (points[2], points[0], points[1])
    for wrong in ("1-2", "1-2-2", "1-2-4"):
        with pytest.raises(ConfigError, match="each of the waypoints 1 to 3 once"):
            apply_choices(three, {"order": wrong})
    with pytest.raises(ConfigError, match="expected one of given, reversed"):
        parse_choices(["order=1,2"])


def test_a_choice_given_twice_is_refused():
    with pytest.raises(ConfigError, match="found it twice"):
        parse_choices(["pitch=20", "pitch=26"])


def test_choices_change_what_they_name(case):
    made_case = apply_choices(
        case,
        {
            "pitch": 30.0, "climb_to": 5.0, "altitude": 8.0, "volume_cc": 200.0, "surface_every_h": 2.0,
            "surface_stay_min": 20.0, "ctd_every_s": 16.0, "start_h": 6.0, "instrument": "deployed",
            "order": "reversed",
        },
    )  # fmt: skip
    mission = made_case.mission
    assert mission.yo.dive_pitch == pytest.approx(math.radians(30))
    assert mission.yo.climb_volume == pytest.approx(200e-6)
    assert mission.surface[0].seconds == 7200.0 and mission.surface[1].kind == "mission_done"
    assert mission.surface_stay == 1200.0
    assert made_case.start == START + 6 * 3600.0
    assert mission.waypoints == case.mission.waypoints[::-1]
    assert mission.legs == -1
    names = {d.name for d in made_case.vehicle.devices}
    assert {"measurement_board_8", "science_computer_deployed"} <= names and "science_computer_stock" not in names
    assert [r.interval for r in mission.samples if r.sensor_type == 1] == [16.0]


def test_choices_with_nothing_to_act_on_are_refused(case):
    bare = replace(case, vehicle=replace(case.vehicle, devices=()))
    with pytest.raises(ConfigError, match="--devices ctd"):
        apply_choices(bare, {"ctd_every_s": 4.0})
    with pytest.raises(ConfigError, match="at most the pump's 230"):
        apply_choices(case, {"volume_cc": 400.0})
    with pytest.raises(ConfigError, match="Did you mean 'gps'"):
        with_devices(case.vehicle, ("gpss",))


def test_a_contradiction_is_an_answer_beside_the_others(flown):
    refused = [s for s in flown if s.refused]
    assert len(refused) == 4
    assert all("dive_to" in s.refused and s.choices["dive_to"] == 2.0 for s in refused)


def test_only_contradictions_are_an_error(case):
    with pytest.raises(ConfigError, match="deeper than climb_to"):
        sweep(case, parse_choices(["dive_to=1,2"]))


def test_steeper_costs_more_and_lithium_lasts_longer(flown):
    by = {(s.choices["pitch"], s.choices["battery"]): s for s in flown if not s.refused}
    shallow, steep = by[20.0, "alkaline"], by[30.0, "alkaline"]
    assert (steep.wh > shallow.wh).all()
    assert (steep.profiles > shallow.profiles).all()
    lithium = by[20.0, "lithium_primary_3s"]
    # The same members in the same water: only the pack differs.
    np.testing.assert_allclose(lithium.km, shallow.km)
    np.testing.assert_allclose(lithium.wh, shallow.wh)
    assert (lithium.left > shallow.left).all()


def test_settings_flown_together_are_those_flown_alone(case, tide):
    base = replace(case, loop=False, currents=tide)
    choices = parse_choices(["start_h=0,6,400", "pitch=20,30", "order=given,reversed"])
    seen = []
    together = sweep(base, choices, seen.append)
    # Starts after the currents are refused one by one; every setting is counted.
    assert [bool(s.refused) for s in together] == [s.choices["start_h"] == 400.0 for s in together]
    assert seen[-1] == len(together) == 12
    interval = common_interval([apply_choices(base, s.choices) for s in together])
    other = together[6]
    alone = fly_setting(apply_choices(base, other.choices), other.choices, interval)
    for name in ("days", "km", "profiles", "wh", "left"):
        np.testing.assert_allclose(getattr(other, name), getattr(alone, name), rtol=2e-3, err_msg=name)
    assert other.story["current_along"] == pytest.approx(alone.story["current_along"], abs=1e-3)
    assert abs(together[0].km - together[4].km).max() > 0.1


def test_a_plan_says_how_often_the_rules_of_a_program_fire(case, flown):
    late = ProgramRule((Condition("elapsed_above", 0.5 * 86400.0),), "half a day: shallow", dive_to=20.0)
    never = ProgramRule((Condition("energy_used_above", 1e9),), goto="home")
    flying = replace(case, mission=replace(case.mission, program=(late, never)))
    ruled = sweep(flying, parse_choices(["dive_to=40,60"]))
    for setting in ruled:
        (words, share, day), (_, none, unknown) = setting.fired
        assert words == "rule 1 'half a day: shallow'" and share == 1.0 and day == pytest.approx(0.5, abs=0.02)
        assert none == 0.0 and math.isnan(unknown)
    # Shallower dives for the second half: more turns than without the rule, even at a steeper pitch.
    steep = next(s for s in flown if not s.refused and s.choices["pitch"] == 30.0)
    assert (ruled[1].profiles > 1.3 * steep.profiles).all()
    page = plan_page(flying, {}, ruled, recommend(ruled, confidence=0.5), {}, PlanOptions(Options(), ()))
    assert "- rule 1 'half a day: shallow' fires in 100 % of members, median day 0.5" in page
    numbers = plan_numbers(flying, ruled, [], {}, PlanOptions(Options(), ()))
    assert json.loads(json.dumps(numbers, allow_nan=False))["settings"][0]["program"][1]["median_day"] is None


def test_the_instrument_costs_what_was_published(case):
    none = fly_setting(apply_choices(case, {"instrument": "none"}), {})
    deployed = fly_setting(apply_choices(case, {"instrument": "deployed"}), {})
    # 0.76 W board and 0.71 W computer, all day.
    assert deployed.wh - none.wh == pytest.approx((0.76 + 0.71) * 24.0, rel=0.01)


def test_an_unreachable_waypoint_is_answered_with_numbers(case, tide):
    steady = replace(tide, east=np.full_like(tide.east, -0.6), north=np.zeros_like(tide.north))
    against = replace(case, loop=False, currents=steady)
    setting = fly_setting(against, {})
    assert setting.probability == 0.0
    text = why_not(setting, against)
    assert "still under way" in text and "+0.60 m/s against it" in text
    # It starts 17.3 km from the first waypoint and is at its last, the start, when it begins.
    chosen = recommend([setting], by=None)[0]
    assert chosen.setting is None and math.isnan(chosen.sure)


def test_a_pack_emptied_on_the_first_day_is_answered_with_the_time(case):
    battery = case.vehicle.battery
    # The uncertainty stated for a whole pack is several times as much.
    small = replace(battery, capacity=replace(battery.capacity, value=2.5 * 3600.0, sigma=360.0))
    weak = replace(case, vehicle=replace(case.vehicle, battery=small))
    setting = fly_setting(apply_choices(weak, {}), {})
    assert setting.probability == 0.0
    assert 0.2 < setting.story["battery_days"] < 1.0
    assert f"after a median of {setting.story['battery_days']:.1f} of 1 days" in why_not(setting, weak)


def test_sensitivities_are_those_of_the_closed_form(case):
    lean = replace(case.vehicle, devices=case.vehicle.devices[:2])
    quiet = {name: replace(q, sigma=q.sigma if name == "energy.hotel" else 0.0) for name, q in lean.quantities.items()}
    found = sensitivities(replace(case, vehicle=replace(lean, quantities=quiet)), {})
    by = {s.name: s for s in found}
    # 0.05 W for a day.
    assert by["hotel"].energy[0] == pytest.approx(0.05 * 24.0, rel=0.02)
    assert by["hotel"].goal[0] == pytest.approx(0.0, abs=1e-6)
    assert by["pitch"].energy[0] > 0.0 and by["dive to"].energy[0] < 0.0
    assert abs(found[0].energy[0]) >= abs(found[-1].energy[0])


def test_the_best_of_those_sure_enough_is_recommended():
    sure = made([10, 11, 12, 13], [1, 1, 1, 1], pitch=20.0)
    far = made([20, 21, 22, 23], [1, 0, 0, 1], pitch=32.0)
    near = made([9, 10, 11, 12], [1, 1, 1, 1], pitch=15.0)
    answer = recommend([far, near, sure], confidence=0.9)[0]
    assert answer.setting is sure and answer.runner is near
    assert answer.margin == (pytest.approx(1.0), pytest.approx(0.0))
    assert recommend([far, near, sure], confidence=0.5)[0].setting is far
    assert recommend([far, near, sure], goal="energy", confidence=0.9)[0].setting is sure


def test_a_program_that_ends_the_flight_early_is_the_reason(case):
    early = replace(made([5, 5], [0, 1]), outcome=np.array([1, 0]), days=np.array([0.4, 1.0]))
    text = why_not(early, case)
    assert "50 % end earlier at a place that a rule of the program leads to, after a median of 0.4 days" in text


def test_each_pack_gets_its_own_answer():
    alkaline = made([10, 10], [0, 0], battery="alkaline")
    lithium = made([10, 10], [1, 1], battery="lithium_primary_3s")
    answers = recommend([alkaline, lithium], by="battery")
    assert [a.group for a in answers] == ["alkaline", "lithium_primary_3s"]
    assert answers[0].setting is None and answers[1].setting is lithium


def test_unknown_goal():
    with pytest.raises(ConfigError, match="Did you mean 'profiles'"):
        goal_of("profile")


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 9), st.booleans()), min_size=1, max_size=8))
def test_nothing_on_the_front_is_beaten_and_all_else_is(values):
    every = [made([v, v], [ok, ok], pitch=float(k)) for k, (v, ok) in enumerate(values)]
    front = pareto(every)
    assert front
    key = {id(s): (np.median(s.km), s.probability) for s in every}
    best = {key[id(s)] for s in front}
    for s in every:
        beaten = any(a >= key[id(s)][0] and b >= key[id(s)][1] and (a, b) != key[id(s)] for a, b in best)
        assert beaten != any(s is f for f in front)


def test_the_page_answers_and_names_what_was_not_flown(case, flown):
    chosen = recommend(flown, confidence=0.5, by="battery")
    options = PlanOptions(Options(), ())
    page = plan_page(case, {}, flown, chosen, {}, options)
    assert "**lithium_primary_3s**: pitch" in page
    assert "Not flown" in page
    numbers = plan_numbers(case, flown, chosen, {}, options)
    assert len(json.loads(json.dumps(numbers, allow_nan=False))["settings"]) == len(flown)


def test_words_name_units_once():
    setting = made([1], [1], surface_every_h=6.0, pitch=20.0, battery="alkaline")
    assert words(setting) == "surface every 6 h, pitch 20 degrees, battery alkaline"
