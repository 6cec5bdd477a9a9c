"""Mission programs in TOML: units, there and back, refusals; and in Slocum files: what behaviours say, and do not."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import glider_jax_data
from glider_jax.config import (
    PROGRAM_ACTIONS,
    PROGRAM_CONDITIONS,
    Aborts,
    Condition,
    Mission,
    ProgramRule,
    SurfaceRule,
    Yo,
    check_mission,
)
from glider_jax.errors import ConfigError
from glider_jax.readers.mission_programs import rule_text
from glider_jax.readers.missions import mission_toml, read_mission, write_mission_toml
from glider_jax.readers.slocum_files import parse_script
from glider_jax.readers.slocum_writer import write_slocum_mission
from tests.readers.test_missions import _matches, _plain

HEAD = """
[mission]
start = 2009-09-05T12:00:00Z
start_position = [39.45, -74.15]
waypoints = [[39.02, -72.92], [39.3, -73.6]]
dive_to = 100.0
surface_every = 10800.0
"""
RULES = """
[[program]]
name = "battery below 30 %: head home"
when = { state_of_charge_below_percent = 30 }
then = { goto = "home", surface_every_h = 6 }

[[program]]
when = { bottom_shallower_than_m = 30, elapsed_above_d = 2 }
then = { dive_to_m = 20, altitude = 8.0, pitch = 30 }
once = false

[[program]]
when = { energy_used_above_kj = 500, time_after = 2009-09-12T00:00:00Z, flying_to_waypoint = 2 }
then = { goto = [39.0, -73.0], surface_now = true }
"""


def read(tmp_path, rules, head=HEAD):
    path = tmp_path / "mission.toml"
    path.write_text(head + rules, encoding="utf-8")
    return read_mission(path)


def rule(kind, value, **actions):
    """A rule with one condition."""
    return ProgramRule((Condition(kind, float(value)),), **actions)


def base(**changes) -> Mission:
    """A mission that Slocum files can say."""
    mission = Mission(
        "demo",
        waypoints=((39.0, -72.9), (39.3, -73.6)),
        yo=Yo(100.0, 3.0, math.radians(26), math.radians(26)),
        surface=(SurfaceRule("every", seconds=10800.0), SurfaceRule("mission_done", ends_mission=True)),
        start=1252152000.0 + 4 * 365.25 * 86400.0,
        start_position=(39.45, -74.15),
        surface_stay=600.0,
    )
    return replace(mission, **changes)


def test_units_become_si_and_words_are_kept(tmp_path):
    first, second, third = read(tmp_path, RULES).program
    assert first.when == (Condition("state_of_charge_below", 0.3),)
    assert first.goto == "home" and first.surface_every == 6 * 3600.0 and first.once
    assert {c.kind: c.value for c in second.when} == {"bottom_shallower_than": 30.0, "elapsed_above": 2 * 86400.0}
    assert (second.dive_to, second.altitude, second.once) == (20.0, 8.0, False)
    assert second.pitch == pytest.approx(math.radians(30.0))
    assert {c.kind: c.value for c in third.when} == {
        "energy_used_above": 500e3, "time_after": 1252713600.0, "flying_to_waypoint": 2.0
    }  # fmt: skip
    assert third.goto == (39.0, -73.0) and third.actions == ("goto", "surface_now")
    assert rule_text(first, 1) == "rule 1 'battery below 30 %: head home'"
    assert rule_text(second, 2) == (
        "rule 2 'elapsed above 2 days and bottom shallower than 30 m: dive to 20 m, altitude 8 m, pitch 30 degrees'"
    )


def test_the_rules_of_the_documentation_are_read(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "mission-programs.md").read_text(encoding="utf-8")
    block = text.split("```toml\n")[1].split("```")[0]
    program = read(tmp_path, block).program
    assert [rule.once for rule in program] == [True, False, True]
    assert program[2].actions == ("goto",) and len(program[2].when) == 2
    # Every condition and action has its line.
    for name in (*PROGRAM_CONDITIONS, *PROGRAM_ACTIONS):
        assert f"`{name}" in text, name


def test_the_schema_for_editors_knows_programs(tmp_path):
    schema = json.loads(glider_jax_data.path("schemas/mission.schema.json").read_text(encoding="utf-8"))
    assert _matches(_plain(tomllib.loads(HEAD + RULES)), schema, schema)
    assert _matches(_plain(tomllib.loads(mission_toml(read(tmp_path, RULES)))), schema, schema)
    wrong = HEAD + '[[program]]\nwhen = { charge_below = 0.3 }\nthen = { goto = "home" }\n'
    assert not _matches(_plain(tomllib.loads(wrong)), schema, schema)


@st.composite
def programs(draw):
    kind = draw(st.sampled_from(sorted(PROGRAM_CONDITIONS)))
    value = draw(st.floats(0.2, 0.9)) if kind.startswith("state") else draw(st.floats(1.0, 1e6))
    value = float(draw(st.integers(1, 2))) if kind == "flying_to_waypoint" else value
    number = st.none() | st.floats(0.0, 90.0)
    made = ProgramRule(
        when=(Condition(kind, value),),
        name=draw(st.text(st.characters(exclude_categories=("Cs",)), max_size=8)),
        goto=draw(
            st.sampled_from(["home", "next", 1, 2]) | st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
        ),
        dive_to=draw(st.none() | st.floats(50.0, 900.0)),
        climb_to=draw(st.none() | st.floats(0.0, 40.0)),
        altitude=draw(number),
        pitch=draw(st.none() | st.floats(math.radians(5.0), math.radians(60.0))),
        surface_every=draw(st.none() | st.floats(60.0, 1e6)),
        surface_now=draw(st.booleans()),
        once=draw(st.booleans()),
    )
    if draw(st.booleans()):
        made = rule("elapsed_above", value + 1.0, end_mission=True)
    return made


@settings(max_examples=80, deadline=None)
@given(programs())
def test_there_and_back(tmp_path_factory, program):
    mission = base(program=(program,))
    check_mission(mission)
    back = read_mission(write_mission_toml(mission, tmp_path_factory.mktemp("m") / "m.toml"))
    assert back.program == mission.program


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("when = { state_of_charge_bellow = 0.3 }\nthen = { goto = 'home' }", "Did you mean 'state_of_charge_below'"),
        ("when = { energy_used_above_kJ = 3 }\nthen = { goto = 'home' }", "Did you mean 'energy_used_above_kj'"),
        ("when = { state_of_charge_below = 30 }\nthen = { goto = 'home' }", "share above 0 and below 1, found 30"),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = 'hom' }", "Did you mean 'home'"),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = 3 }", "waypoint from 1 to 2, found 3"),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = [-74.0, 139.0] }", None),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = [139.0, -74.0] }", "swapped"),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = true }", "number of a waypoint"),
        ("when = { elapsed_above_d = 2 }\nthen = { dive_too = 20 }", "Did you mean 'dive_to'"),
        ("when = { elapsed_above_d = 2 }\nthen = { dive_to = 2 }", "deeper than climb_to, found 2 m and 3 m"),
        ("when = { elapsed_above_d = 2 }\nthen = { pitch = 70 }", "5 to 60 degrees, found 70"),
        ("when = { elapsed_above_d = 2 }\nthen = { }", "found nothing"),
        ("when = { }\nthen = { surface_now = true }", "at least one condition"),
        ("then = { surface_now = true }", "expected a table 'when'"),
        ("when = { elapsed_above_d = 2 }", "expected a table 'then'"),
        ("when = { flying_to_waypoint = 3 }\nthen = { goto = 'next' }", "1 to 2, found 3"),
        (
            "when = { bottom_shallower_than = 20, bottom_deeper_than = 50 }\nthen = { dive_to = 20 }",
            "more than 50 and less than 20",
        ),
        ("when = { elapsed_above = -1 }\nthen = { dive_to = 20 }", "at least 0, found -1"),
        ("when = { elapsed_above_d = 2 }\nthen = { end_mission = true, goto = 'home' }", "leaves nothing to goto"),
        ("when = { elapsed_above_d = 2 }\nthen = { end_mission = true }\nonce = false", "cannot be taken back"),
        ("when = { elapsed_above_d = 2 }\nthen = { surface_every = 0 }", "more than 0 s, found 0"),
        ("when = { elapsed_above_d = 2 }\nthen = { goto = 'home' }\nonse = true", "Did you mean 'once'"),
    ],
)
def test_wrong_rules_are_explained(tmp_path, text, said):
    if said is None:
        assert read(tmp_path, f"[[program]]\n{text}\n").program[0].goto == (-74.0, 139.0)
        return
    with pytest.raises(ConfigError, match=said):
        read(tmp_path, f"[[program]]\n{text}\n")


def test_rules_that_cannot_act_are_refused():
    with pytest.raises(ConfigError, match="never met, the mission aborts at 0.2"):
        check_mission(base(aborts=Aborts(remaining_charge=0.2), program=(rule("state_of_charge_below", 0.15, goto=1),)))
    same = (rule("elapsed_above", 60.0, dive_to=30.0), rule("elapsed_above", 60.0, dive_to=40.0, pitch=0.4))
    with pytest.raises(ConfigError, match="rule 2: rule 1 has the same conditions and sets dive_to already"):
        check_mission(base(program=same))
    with pytest.raises(ConfigError, match="below the overdepth of 120 m"):
        check_mission(base(aborts=Aborts(overdepth=120.0), program=(rule("elapsed_above", 60.0, dive_to=200.0),)))
    done = (SurfaceRule("mission_done", ends_mission=True),)
    with pytest.raises(ConfigError, match="expected a surface rule 'every' or 'after'"):
        check_mission(base(surface=done, program=(rule("elapsed_above", 60.0, surface_every=3600.0),)))


def test_what_behaviours_express_reads_back_as_such(tmp_path):
    noon = base().start + 86400.0
    noon -= noon % 60.0
    mission = base(
        program=(
            rule("waypoint_closer_than", 800.0, surface_now=True, once=False),
            rule("time_after", noon, surface_now=True),
            rule("state_of_charge_below", 0.25, end_mission=True),
            rule("elapsed_above", 12 * 86400.0, end_mission=True),
            rule("waypoint_farther_than", 60e3, end_mission=True),
            rule("waypoint_farther_than", 9e3, surface_now=True, once=False),
        )
    )
    export = write_slocum_mission(mission, tmp_path)
    assert len(export.expressed) == 6 and not any("program" in text for text in export.left_out)
    back = read_mission(tmp_path)
    assert [r for r in back.surface if r.kind == "waypoint_distance"][0].distance == 800.0
    assert [r for r in back.surface if r.kind == "utc"][0].time == noon
    assert back.aborts.remaining_charge == pytest.approx(0.25)
    assert back.aborts.overtime == 12 * 86400.0 and back.aborts.maximum_waypoint_distance == 60e3
    # The firmware knows surfacing beyond a distance, our simulator of Slocum files does not: it says so.
    assert any("start_when 15" in text for text in back.unsupported)
    script = parse_script((tmp_path / "mafiles" / "surfac14.ma").read_text(), "surfac14.ma")
    assert script.behaviors[0].number("when_wpt_dist", 0.0) == 9e3
    assert back.yo == mission.yo and back.waypoints[0] == pytest.approx(mission.waypoints[0], abs=1e-6)


def test_a_stricter_limit_of_the_mission_stays(tmp_path):
    mission = base(
        aborts=Aborts(overtime=5 * 86400.0),
        program=(rule("elapsed_above", 12 * 86400.0, end_mission=True),),
    )
    write_slocum_mission(mission, tmp_path)
    assert read_mission(tmp_path).aborts.overtime == 5 * 86400.0


def test_what_no_behaviour_expresses_becomes_files_to_exchange(tmp_path):
    mission = base(
        program=(
            rule("state_of_charge_below", 0.3, goto="home", surface_every=21600.0),
            rule("bottom_shallower_than", 30.0, dive_to=20.0, pitch=0.4, once=False),
            rule("current_faster_than", 0.5, surface_now=True),
            rule("flying_to_waypoint", 1, goto="next"),
        )
    )
    export = write_slocum_mission(mission, tmp_path)
    told = [text for text in export.left_out if text.startswith("program rule")]
    assert len(told) == 4 and not export.expressed
    assert "no behaviour sets goto, surface_every" in told[0] and "the files of rule1" in told[0]
    assert "the first ones back when it no longer holds" in told[1]
    assert "no behaviour comes up on current faster than" in told[2]
    assert "initial_wpt -1" in told[3]
    names = sorted(path.relative_to(tmp_path).as_posix() for path in export.files if "rule" in path.as_posix())
    assert names == ["rule1/goto_l10.ma", "rule1/surfac10.ma", "rule1/surfac11.ma", "rule2/yo10.ma"]
    before = read_mission(tmp_path)
    assert before.waypoints[0] == pytest.approx((39.0, -72.9), abs=1e-6) and before.yo == mission.yo
    # In place of the first ones, they are the mission that the rule makes of it.
    for folder in ("rule1", "rule2"):
        for path in (tmp_path / folder).iterdir():
            shutil.copy(path, tmp_path / "mafiles" / path.name)
    after = read_mission(tmp_path)
    assert len(after.waypoints) == 1 and after.waypoints[0] == pytest.approx((39.45, -74.15), abs=1e-6)
    assert after.surface[0].seconds == 21600.0
    assert after.yo == replace(mission.yo, dive_to=20.0, dive_pitch=0.4, climb_pitch=0.4)


def test_home_without_a_start_is_said(tmp_path):
    mission = base(start_position=None, start=None, program=(rule("elapsed_above", 60.0, goto="home"),))
    export = write_slocum_mission(mission, tmp_path)
    assert any("home is not known either" in text for text in export.left_out)
    other = base(start=None, program=(rule("elapsed_above", 60.0, surface_now=True),))
    assert any("start is not given" in text for text in write_slocum_mission(other, tmp_path / "b").left_out)
