"""Slocum mission files: real ones, every quirk seen in real ones, refusals, fuzz, and there and back."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.config import Aborts, Mission, SampleRule, SurfaceRule, Yo
from glider_jax.errors import ConfigError, DataError
from glider_jax.readers.missions import read_mission
from glider_jax.readers.slocum_files import from_degrees_minutes, parse_waypoint, to_degrees_minutes
from glider_jax.readers.slocum_writer import write_slocum_mission

MI = """# demo.mi
sensor: u_use_current_correction(nodim) 0
sensor: u_alt_min_depth(m)\t8
behavior: abend
    b_arg: overdepth(m)   120
    b_arg: samedepth_for(s) 900  # comment
    b_arg: remaining_charge_min(%) 12
behavior: surface
    b_arg: args_from_file(enum) 10
    b_arg: start_when(enum) 9
behavior: surface
    b_arg: start_when(enum) 12
    b_arg: when_secs(sec) 43200
behavior: goto_list
    b_arg: args_from_file(enum) 10
    b_arg: list_when_wpt_dist(m) 77
behavior: yo
    b_arg: args_from_file(enum) 6
behavior: sample
    b_arg: args_from_file(enum) 01
behavior: set_heading
    b_arg: heading_value(X) 0.2
behavior: prepare_to_dive
    b_arg: wait_time(s) 300
"""
SURFACE = """# a comment comes first
behavior_name=Surface
<start:b_arg>
b_arg: when_secs(sec)\t10800
b_arg: c_use_pitch(enum) 3
b_arg: c_pitch_value(X)  0.430
b_arg: gps_wait_time(s) 300
b_arg: keystroke_wait_time(s)  300
b_arg: strobe_on(bool) 1
<end:b_arg>"""
GOTO = """behavior_name=Goto_list
<start:b_arg>
b_arg: list_stop_when(enum) 7
b_arg: list_when_wpt_dist(m) 500
b_arg: initial_wpt(enum) -2
b_arg: num_waypoints(nodim) 4
b_arg: num_legs_to_run(nodim) -1
<end:b_arg>
<start:waypoints>
#-7100.000 4100.000
-7040.271 4138.861   # first
-07300.0 3930.5 home
<end:waypoints>"""
YO = """behavior_name=yo
<start:b_arg>
b_arg: num_half_cycles_to_do(nodim) -1
b_arg: d_target_depth(m) +100.0
b_arg: d_target_altitude(m) 5
b_arg: d_bpump_value(X) -1000
b_arg: d_use_pitch(enum) 3
b_arg: d_pitch_value(X) -0.3491# 20 deg
b_arg: c_target_depth(m) 007
b_arg: c_bpump_value(X) 230.0
b_arg: c_use_pitch(enum) 1
b_arg: c_pitch_value(X) 0.405
<end:b_arg>
b_arg: c_target_altitude(m) -1
"""
SAMPLE = """behavior_name=sample
<start:b_arg>
b_arg: sensor_type(enum) 1
b_arg: state_to_sample(enum) 5
b_arg: intersample_time(s) 4
b_arg: nth_yo_to_sample(nodim) 2
<end:b_arg>"""


def folder(tmp_path, mi=MI, **changes):
    """A mission as operators keep it: missions/demo.mi and mafiles/*.ma."""
    files = {"surfac10.ma": SURFACE, "goto_l10.ma": GOTO, "yo06.ma": YO, "sample01.ma": SAMPLE}
    files |= {name.replace("_ma", ".ma"): text for name, text in changes.items()}
    (tmp_path / "missions").mkdir(exist_ok=True)
    (tmp_path / "mafiles").mkdir(exist_ok=True)
    (tmp_path / "missions" / "demo.mi").write_text(mi)
    for name, text in files.items():
        if text is not None:
            (tmp_path / "mafiles" / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return tmp_path


def test_a_mission_as_flown(tmp_path):
    mission = read_mission(folder(tmp_path))
    assert mission.name == "demo"
    # Longitude stands first; 70 degrees 40.271 minutes west, 41 degrees 38.861 minutes north.
    assert mission.waypoints[0] == pytest.approx((41 + 38.861 / 60, -(70 + 40.271 / 60)))
    assert mission.waypoints[1] == pytest.approx((39.508333333, -73.0))
    assert mission.waypoint_radius == 500.0  # the .ma wins over the .mi
    assert mission.first_waypoint is None and mission.legs == -1
    assert mission.current_correction is False
    yo = mission.yo
    assert (yo.dive_to, yo.climb_to, yo.dive_altitude, yo.climb_altitude) == (100.0, 7.0, 5.0, None)
    assert yo.dive_pitch == pytest.approx(0.3491)
    assert yo.climb_pitch == pytest.approx(math.radians(26.0))  # a battery position is no angle
    assert yo.dive_volume is None and yo.climb_volume == pytest.approx(230e-6)
    assert yo.half_cycles is None
    every, comms, done = mission.surface
    assert (every.kind, every.seconds, every.climb_pitch) == ("every", 10800.0, 0.43)
    assert (comms.kind, comms.seconds) == ("no_comms", 43200.0)
    assert done.kind == "mission_done" and done.ends_mission
    assert mission.surface_stay == 600.0
    assert mission.samples == (SampleRule(1, frozenset({"dive", "climb"}), 4.0, -5.0, 2000.0, 2),)
    assert mission.aborts == Aborts(
        overdepth=120.0, undervolts=10.0, same_depth_for=900.0, stalled_for=1800.0, no_comms_for=259200.0,
        remaining_charge=pytest.approx(0.12),
    )  # fmt: skip
    assert len(mission.source.files) == 5


def test_nothing_that_the_files_name_is_dropped(tmp_path):
    mission = read_mission(folder(tmp_path))
    said = "\n".join((*mission.unsupported, *mission.notes))
    for name in ("set_heading", "heading_value", "u_alt_min_depth", "prepare_to_dive", "num_waypoints says 4"):
        assert name in said, name
    assert "c_use_pitch 1 commands no angle" in said


@pytest.mark.parametrize("where", ["same", "mafiles", "beside"])
def test_argument_files_are_found_where_operators_keep_them(tmp_path, where):
    full = folder(tmp_path)
    if where == "same":
        for path in (full / "mafiles").iterdir():
            path.rename(full / "missions" / path.name.upper().replace(".MA", ".ma"))
        assert len(read_mission(full / "missions" / "demo.mi").waypoints) == 2
        assert len(read_mission(full / "missions").waypoints) == 2
    elif where == "mafiles":
        (full / "missions" / "demo.mi").rename(full / "demo.mi")
        assert len(read_mission(full).waypoints) == 2
    else:
        assert len(read_mission(full / "missions" / "demo.mi").waypoints) == 2


def test_line_ends_latin_bytes_and_missing_last_newline(tmp_path):
    raw = YO.replace("\n", "\r\n").replace("# 20 deg", "# 20 °").encode("latin-1").rstrip()
    mission = read_mission(folder(tmp_path, yo06_ma=raw))
    assert mission.yo.dive_pitch == pytest.approx(0.3491)
    assert mission.yo.climb_altitude is None


def test_wrong_signs_are_flown_by_magnitude_and_noted(tmp_path):
    text = YO.replace("-0.3491", "0.3491").replace("230.0", "-230.0")
    mission = read_mission(folder(tmp_path, yo06_ma=text))
    assert mission.yo.dive_pitch == pytest.approx(0.3491)
    assert mission.yo.climb_volume == pytest.approx(230e-6)
    assert sum("wrong sign" in note for note in mission.notes) == 2


def test_placeholders_take_the_default(tmp_path):
    mission = read_mission(folder(tmp_path, yo06_ma=YO.replace("+100.0", "??")))
    assert mission.yo.dive_to == 12.0
    assert any("'??'" in note for note in mission.notes)


def test_autoexec_settings_give_way_to_the_mission(tmp_path):
    full = folder(tmp_path)
    auto = full / "missions" / "autoexec.mi"
    auto.write_text(
        "name bob\ninstalled gps\nsensor: u_use_current_correction(nodim) 2\nsensor: F_MAX_WORKING_DEPTH(m) 51\n"
    )
    mission = read_mission(full)
    assert mission.current_correction is False
    assert mission.yo.dive_to == 51.0 and any("clipped" in note for note in mission.notes)
    (full / "missions" / "demo.mi").write_text(MI.replace("sensor: u_use_current", "#sensor: u_use_current"))
    assert read_mission(full).current_correction is True


@pytest.mark.parametrize(
    ("lines", "kind", "check"),
    [
        ("start_when(enum) 1", "mission_done", lambda r: r.ends_mission),
        ("start_when(enum) 2", "mission_done", lambda r: r.ends_mission),
        ("start_when(enum) 3", "mission_done", lambda r: r.ends_mission),
        ("start_when(enum) 6|when_secs(s) 7200", "after", lambda r: r.seconds == 7200.0),
        ("start_when(enum) 6|when_secs(min) 90", "after", lambda r: r.seconds == 5400.0),
        ("start_when(enum) 7|when_wpt_dist(m) 300", "waypoint_distance", lambda r: r.distance == 300.0),
        ("start_when(enum) 8", "waypoint", lambda r: not r.ends_mission),
        ("start_when(enum) 8|end_action(enum) 0", "waypoint", lambda r: r.ends_mission),
        ("start_when(enum) 9|when_secs(s) 30", "every", lambda r: r.seconds == 120.0),
        ("start_when(enum) 10|when_secs(s) 7200", "every", lambda r: r.when_yo_ends),
        ("start_when(enum) 11", "science", lambda r: True),
        ("start_when(enum) 13|when_utc_timestamp(dtime) 1909210130", "utc", lambda r: r.time == 1569029400.0),
        ("start_when(enum) 16|when_num_inflections(nodim) 6", "inflections", lambda r: r.count == 6),
    ],
)  # fmt: skip
def test_start_when_codes(tmp_path, lines, kind, check):
    text = "behavior_name=surface\n<start:b_arg>\n" + "\n".join(f"b_arg: {x}" for x in lines.split("|"))
    first = read_mission(folder(tmp_path, surfac10_ma=text)).surface[0]
    assert first.kind == kind and check(first), first


def test_a_yo_that_ends_brings_the_glider_up(tmp_path):
    yo = YO.replace("num_half_cycles_to_do(nodim) -1", "num_half_cycles_to_do(nodim) 4")
    mission = read_mission(folder(tmp_path, mi=MI.replace("start_when(enum) 9", "start_when(enum) 1"), yo06_ma=yo))
    assert mission.surface[0].kind == "yo_done" and mission.yo.half_cycles == 4


@pytest.mark.parametrize("code", [14, 15, 17, 18, 99])
def test_codes_without_counterpart_are_listed(tmp_path, code):
    text = SURFACE.replace("b_arg: when_secs", f"b_arg: start_when(enum) {code}\nb_arg: when_secs")
    mission = read_mission(folder(tmp_path, surfac10_ma=text))
    assert [r.kind for r in mission.surface] == ["no_comms", "mission_done"]
    assert any(f"start_when {code}" in line for line in mission.unsupported)


def test_autoballast_is_listed(tmp_path):
    text = YO.replace("b_arg: d_bpump_value(X) -1000", "b_arg: d_use_bpump(enum) 0\nb_arg: d_bpump_value(X) 800")
    mission = read_mission(folder(tmp_path, yo06_ma=text))
    assert mission.yo.dive_volume == pytest.approx(400e-6)
    assert any("autoballast" in line for line in mission.unsupported)


def test_waypoints_inside_the_mission_file(tmp_path):
    inline = "".join(
        f"    b_arg: wpt_units_{i}(enum) 2\n    b_arg: wpt_x_{i}(X) {x}\n    b_arg: wpt_y_{i}(X) {y}\n"
        for i, (x, y) in enumerate([("-7030.0", "3900.0"), ("-7100.0", "3915.0")])
    )
    mi = MI.replace("behavior: goto_list\n    b_arg: args_from_file(enum) 10\n", f"behavior: goto_list\n{inline}")
    mission = read_mission(folder(tmp_path, mi=mi))
    assert mission.waypoints == ((39.0, -70.5), (39.25, -71.0))
    with pytest.raises(ConfigError, match="no known place"):
        read_mission(folder(tmp_path, mi=mi.replace("wpt_units_1(enum) 2", "wpt_units_1(enum) 0")))


def test_missing_sample_file_leaves_its_devices_their_rule(tmp_path):
    full = folder(tmp_path)
    (full / "mafiles" / "sample01.ma").unlink()
    mission = read_mission(full)
    assert mission.samples == () and any("sample01.ma is not there" in line for line in mission.unsupported)


def test_a_sensor_switched_off_is_a_rule_without_states(tmp_path):
    mission = read_mission(
        folder(tmp_path, sample01_ma=SAMPLE.replace("intersample_time(s) 4", "intersample_time(s) -1"))
    )
    assert mission.samples[0].states == frozenset()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"goto_l10_ma": GOTO.replace("-7040.271 4138.861", "-73.123 39.456")}, ConfigError, "decimal degrees"),
        ({"goto_l10_ma": GOTO.replace("4138.861", "4178.861")}, ConfigError, "78.861 minutes"),
        ({"goto_l10_ma": GOTO.replace("-7040.271 4138.861", "3930.0 -17300.0")}, ConfigError, "swapped"),
        ({"goto_l10_ma": GOTO.replace("-7040.271 4138.861", "somewhere")}, ConfigError, "goto_l10.ma: line 11"),
        ({"goto_l10_ma": GOTO.split("<start:waypoints>")[0]}, ConfigError, "at least one waypoint"),
        ({"goto_l10_ma": GOTO.replace("initial_wpt(enum) -2", "initial_wpt(enum) 5")}, ConfigError, "first_waypoint"),
        ({"goto_l10_ma": GOTO.replace("wpt_dist(m) 500", "wpt_dist(m) -500")}, ConfigError, "waypoint_radius"),
        ({"goto_l10_ma": YO}, ConfigError, "expected behavior_name=goto_list, found yo"),
        ({"goto_l10_ma": None}, DataError, "goto_l10.ma"),
        ({"yo06_ma": YO.replace("+100.0", "2")}, ConfigError, "deeper than climb_to"),
        ({"yo06_ma": YO.replace("-0.3491", "-0.03")}, ConfigError, "5 to 60 degrees"),
        ({"mi": MI.replace("behavior: yo", "behavior: dive_to")}, ConfigError, "behavior yo.*dive_to"),
        ({"mi": MI.replace("behavior: goto_list", "behavior: nothing")}, ConfigError, "It has set_heading instead"),
        ({"mi": ""}, ConfigError, "expected a behavior yo"),
    ],
)  # fmt: skip
def test_missions_that_cannot_be_flown(tmp_path, changes, error, message):
    with pytest.raises(error, match=message):
        read_mission(folder(tmp_path, **changes))


def test_decimal_degrees_when_asked(tmp_path):
    text = GOTO.replace("-7040.271 4138.861", "-73.123 39.456").replace("-07300.0 3930.5", "-73.5 39.5")
    mission = read_mission(folder(tmp_path, goto_l10_ma=text), decimal_degrees=True)
    assert mission.waypoints == ((39.456, -73.123), (39.5, -73.5))


def test_several_or_no_mission_files(tmp_path):
    full = folder(tmp_path)
    (full / "missions" / "other.mi").write_text(MI)
    with pytest.raises(ConfigError, match="found demo.mi, other.mi"):
        read_mission(full)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DataError, match=r"expected a \.mi file"):
        read_mission(empty)
    with pytest.raises(DataError, match="found nothing there"):
        read_mission(full / "absent.mi")
    with pytest.raises(DataError, match="give the .mi"):
        read_mission(full / "mafiles" / "yo06.ma")


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("-7040.271", -(70 + 40.271 / 60)), ("-0012.500", -12.5 / 60), ("725.800", 7 + 25.8 / 60),
        ("-07300.0", -73.0), ("5359.9999", 53 + 59.9999 / 60), ("12360.000", 124.0), ("+0930.0", 9.5), ("-0.0", 0.0),
    ],
)  # fmt: skip
def test_degrees_and_minutes(text, degrees):
    assert from_degrees_minutes(text) == pytest.approx(degrees, abs=1e-12)


def test_padded_positions_near_zero_are_not_ambiguous():
    assert parse_waypoint("00045.678 0030.123", "x", False) == pytest.approx((30.123 / 60, 45.678 / 60))
    with pytest.raises(ConfigError, match="decimal degrees"):
        parse_waypoint("45.678 30.123", "x", False)


@given(st.floats(-180.0, 180.0))
def test_degrees_and_minutes_there_and_back(degrees):
    text = to_degrees_minutes(degrees, 5)
    assert float(text.lstrip("-")) % 100.0 < 60.0
    assert from_degrees_minutes(text) == pytest.approx(degrees, abs=0.00005 / 60.0 + 1e-12)


@pytest.mark.parametrize(
    ("parts", "waypoints", "stay"),
    [
        (("recordings", "comet2019", "missions", "nsb3"), 2, 600.0),
        (("recordings", "comet2019", "missions", "nsb3", "missions", "nsb3.mi"), 2, 600.0),
        (("live", "missions", "smerckel_glidersim_nsb3"), 2, 600.0),
        (("live", "missions", "smerckel_glidersim_helgo"), 3, 600.0),
    ],
)
def test_real_missions(real, parts, waypoints, stay):
    mission = read_mission(real(*parts))
    assert len(mission.waypoints) == waypoints and mission.surface_stay == stay
    for lat, lon in mission.waypoints:
        assert 54.0 < lat < 55.0 and 6.0 < lon < 8.0  # the German Bight
    assert mission.yo.dive_to == 50.0 and mission.yo.climb_to == 3.0
    assert any(rule.kind == "no_comms" and rule.seconds == 43200.0 for rule in mission.surface)


def test_real_missions_in_detail(real):
    nsb3 = read_mission(real("recordings", "comet2019", "missions", "nsb3"))
    assert nsb3.waypoints[1] == pytest.approx((54.3, 7.43))
    assert [s.sensor_type for s in nsb3.samples] == [1, 19, 39, 43]
    assert nsb3.current_correction and nsb3.waypoint_radius == 500.0
    assert nsb3.aborts.remaining_charge is None and nsb3.aborts.maximum_waypoint_distance == 300e3
    assert [r.kind for r in nsb3.surface] == ["no_comms", "mission_done", "every"]
    helgo = read_mission(real("live", "missions", "smerckel_glidersim_helgo"))
    assert helgo.yo.half_cycles == 4 and helgo.yo.dive_volume == pytest.approx(170e-6)
    assert helgo.surface[0].kind == "yo_done" and not helgo.current_correction
    with pytest.raises(DataError, match="goto_l10.ma"):
        read_mission(real("live", "missions", "SWFSC_glider-lab", "1k_n.mi"))
    with pytest.raises(ConfigError, match="1k_n.mi, od5.mi"):
        read_mission(real("live", "missions", "SWFSC_glider-lab"))


def test_a_real_mission_completed_with_waypoints(real, tmp_path):
    for path in real("live", "missions", "SWFSC_glider-lab").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "goto_l10.ma").write_text(GOTO)
    mission = read_mission(tmp_path / "1k_n.mi")
    assert mission.yo.dive_to == 6.0 and mission.yo.half_cycles == 2
    assert [r.kind for r in mission.surface] == ["yo_done", "no_comms", "no_comms", "mission_done"]
    assert [r.seconds for r in mission.surface[1:3]] == [28800.0, 50400.0]
    assert [s.sensor_type for s in mission.samples] == [1, 48, 54, 87]
    assert mission.surface_stay == 899.0 and mission.aborts.undervolts == 12.5
    assert any("autoballast" in line for line in mission.unsupported)


PIECES = st.sampled_from(
    """behavior: yo|behavior: goto_list|behavior: surface|behavior: sample|behavior_name=yo|<start:b_arg>
behavior: abend|-7040.271 4138.861|<start:waypoints>
<end:waypoints>|b_arg: args_from_file(enum) 10|sensor: x(m) 1e999|\x00|°
b_arg: d_target_depth(m) 50|b_arg: c_pitch_value(X) nan|b_arg: start_when(enum) 1e300|b_arg: x|b_arg: overdepth(m) -3
b_arg: num_legs_to_run(nodim) 1e18|b_arg: when_utc_timestamp(dtime) 9999999999|b_arg: start_when(enum) 13
b_arg: initial_wpt(enum) -99|b_arg: state_to_sample(enum) -7|b_arg: d_target_depth(m) -50|b_arg: wpt_x_0(X) -7000.0
b_arg: wpt_units_0(enum) 2|b_arg: wpt_y_0(X) 3900.0|b_arg: when_secs(h) 1e308|sensor: f_max_working_depth(m) 30
""".replace("\n", "|").split("|")
)


@settings(max_examples=250, deadline=None)
@given(st.one_of(st.binary(max_size=120), st.lists(PIECES, max_size=25).map(lambda p: "\n".join(p).encode("latin-1"))))
def test_any_bytes_are_read_or_refused(tmp_path_factory, raw):
    path = tmp_path_factory.mktemp("f") / "f.mi"
    path.write_bytes(raw)
    path.with_name("yo10.ma").write_bytes(raw)
    path.with_name("goto_l10.ma").write_bytes(raw)
    try:
        read_mission(path)
    except (ConfigError, DataError) as error:
        assert len(str(error)) > 20


PITCH = st.floats(math.radians(5.0), math.radians(60.0))


STATES = st.sets(st.sampled_from(["dive", "climb"]))


@st.composite
def expressible(draw):
    kind = draw(
        st.sampled_from(
            ["every", "after", "no_comms", "waypoint", "utc", "inflections", "waypoint_distance", "science"]
        )
    )
    timed = kind in ("every", "after", "no_comms")
    rule = SurfaceRule(
        kind,
        seconds=draw(st.floats(120.0, 1e6)) if timed else 0.0,
        time=draw(st.integers(22_000_000, 33_000_000)) * 60.0 if kind == "utc" else None,
        count=draw(st.integers(1, 50)) if kind == "inflections" else 0,
        distance=draw(st.floats(1.0, 1e5)) if kind == "waypoint_distance" else 0.0,
        when_yo_ends=draw(st.booleans()) if kind == "every" else False,
        ends_mission=draw(st.booleans()),
        climb_pitch=draw(PITCH),
    )
    climb = draw(st.floats(0.0, 50.0))
    points = draw(st.lists(st.tuples(st.floats(-89.0, 89.0), st.floats(-179.0, 179.0)), min_size=1, max_size=8))
    return Mission(
        name="demo",
        waypoints=tuple(points),
        yo=Yo(
            climb + draw(st.floats(1.0, 900.0)), climb, draw(PITCH), draw(PITCH),
            dive_altitude=draw(st.none() | st.floats(0.0, 50.0)),
            dive_volume=draw(st.none() | st.floats(1e-6, 9e-4)),
            half_cycles=draw(st.none() | st.integers(1, 99)),
        ),
        surface=(rule, SurfaceRule("mission_done", ends_mission=True, climb_pitch=0.45)),
        waypoint_radius=draw(st.floats(10.0, 5000.0)),
        legs=draw(st.sampled_from([-2, -1, 3])),
        first_waypoint=draw(st.none() | st.integers(0, len(points) - 1)),
        surface_stay=draw(st.floats(300.0, 1200.0)),
        samples=(SampleRule(draw(st.integers(0, 90)), frozenset(draw(STATES)), 2.0),),
        aborts=Aborts(overdepth=2000.0, undervolts=draw(st.none() | st.floats(9.0, 13.0)), remaining_charge=0.1),
        current_correction=draw(st.booleans()),
    )  # fmt: skip


@settings(max_examples=80, deadline=None)
@given(expressible())
def test_written_missions_read_back_the_same(tmp_path_factory, mission):
    root = tmp_path_factory.mktemp("w")
    export = write_slocum_mission(mission, root)
    assert export.left_out == () and all(path.exists() for path in export.files)
    back = read_mission(root)
    for there, here in zip(back.waypoints, mission.waypoints, strict=True):
        assert there == pytest.approx(here, abs=1e-6)
    assert back.surface_stay == pytest.approx(mission.surface_stay)
    assert [replace(r, name="") for r in back.surface] == list(mission.surface)
    if mission.yo.dive_volume is not None:
        assert back.yo.dive_volume == pytest.approx(mission.yo.dive_volume)
    assert replace(back.yo, dive_volume=None) == replace(mission.yo, dive_volume=None)
    expected = mission.samples[0]
    if not expected.states:
        expected = replace(expected, interval=0.0)
    assert back.samples == (expected,)
    for name in ("legs", "first_waypoint", "waypoint_radius", "current_correction", "name"):
        assert getattr(back, name) == getattr(mission, name), name
    assert back.aborts.undervolts == mission.aborts.undervolts and back.aborts.overdepth == 2000.0


def test_the_bundled_mission_is_exported_with_what_it_cannot_say(tmp_path):
    mission = read_mission()
    export = write_slocum_mission(mission, tmp_path)
    assert any(line.startswith("start:") for line in export.left_out)
    assert any("shortened to 'new_jers'" in line for line in export.left_out)
    back = read_mission(tmp_path)
    assert back.name == "new_jers" and back.surface[0].kind == "every"
    assert back.waypoints[0] == pytest.approx(mission.waypoints[0], abs=1e-6)
    assert "-07255.2000 3901.2000" in (tmp_path / "mafiles" / "goto_l10.ma").read_text()
    with pytest.raises(DataError, match="expected no such file yet"):
        write_slocum_mission(mission, tmp_path)
    write_slocum_mission(mission, tmp_path, overwrite=True)
