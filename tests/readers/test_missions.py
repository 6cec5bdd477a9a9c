"""TOML missions: the bundled one, the flat form, every field there and back, and every refusal."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import glider_jax_data
from glider_jax.config import SURFACE_KINDS, Aborts, Mission, SampleRule, SurfaceRule, Yo, check_mission
from glider_jax.errors import ConfigError, DataError
from glider_jax.readers.missions import mission_toml, read_mission, write_mission_toml

FLAT = """
[mission]
start = 1252900000.0
waypoints = [[39.3, -73.6], [39.15, -73.05], [39.4, -72.95]]   # the first is the start
waypoint_radius = 800.0
dive_to = 100.0
climb_to = 3.0
altitude = 6.0
pitch = 26.0
surface_every = 10800.0
surface_stay = 720.0
"""


def write(tmp_path, text, name="mission.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def kilometres(a, b):
    """Great-circle distance on a sphere of mean radius."""
    la, lo, lb, lp = (math.radians(x) for x in (a[0], a[1], b[0], b[1]))
    h = math.sin((lb - la) / 2) ** 2 + math.cos(la) * math.cos(lb) * math.sin((lp - lo) / 2) ** 2
    return 2.0 * 6371.0 * math.asin(math.sqrt(h))


def test_default_mission_is_the_published_one():
    mission = read_mission()
    assert mission.start == 1252152000.0  # 2009-09-05T12:00:00Z
    path = [mission.start_position, *mission.waypoints]
    length = sum(kilometres(a, b) for a, b in zip(path, path[1:], strict=False))
    assert length == pytest.approx(232.0, abs=5.0)
    assert math.degrees(mission.yo.dive_pitch) == pytest.approx(26.0)
    assert (mission.yo.dive_to, mission.yo.climb_to, mission.yo.dive_altitude) == (100.0, 3.0, 5.0)
    assert mission.legs == -2 and mission.surface[0].seconds == 10800.0
    assert 600.0 <= mission.surface_stay <= 720.0


def test_default_mission_agrees_with_the_manifest():
    said = glider_jax_data.manifest().get("default_mission")
    if said is None:
        pytest.skip("the manifest does not name the default mission")
    mission = read_mission()
    assert [list(p) for p in (mission.start_position, *mission.waypoints)] == said["waypoints_latitude_longitude"]


def test_flat_form(tmp_path):
    mission = read_mission(write(tmp_path, FLAT))
    assert mission.name == "mission"
    assert mission.start_position == (39.3, -73.6)
    assert mission.waypoints == ((39.15, -73.05), (39.4, -72.95))
    assert mission.waypoint_radius == 800.0 and mission.surface_stay == 720.0
    assert mission.yo.dive_pitch == mission.yo.climb_pitch == pytest.approx(0.45378560551852565)
    assert mission.yo.dive_altitude == 6.0
    timed, done = mission.surface
    # The clock runs from each dive, and the climb that is due then goes to the surface.
    assert (timed.kind, timed.seconds, timed.when_yo_ends) == ("after", 10800.0, True)
    assert (done.kind, done.ends_mission) == ("mission_done", True)
    assert mission.unsupported == () and mission.notes == ()


@pytest.mark.parametrize("case", range(1, 9))
def test_files_of_the_concealed_effect_format_are_read_as_they_are(real, case):
    folder = real().parent / "blind-practice" / f"practice{case}"
    if not folder.exists():
        pytest.skip("the practice cases are not here")
    mission = read_mission(folder / "mission.toml")
    assert len(mission.waypoints) == 3 and mission.start == 1252900000.0
    assert read_mission(folder / "mission.toml", start=5.0).start == 5.0


def test_own_form_with_sections_and_units(tmp_path):
    text = """
[mission]
start = "2009-09-05T08:00:00-04:00"
start_position = [39.4, -74.1]
waypoints = [[39.0, -73.0]]
waypoint_radius_km = 1.5
surface_stay_min = 12
first_waypoint = -1
legs = 3
current_correction = false
[yo]
dive_to = 90
climb_to = 5
dive_pitch = 24
climb_pitch = { value = 0.5, unit = "rad" }
altitude = -1
dive_volume = 200
climb_volume_m3 = 2.2e-4
half_cycles = 6
[[surface]]
kind = "no_comms"
seconds = { value = 6, unit = "h" }
climb_pitch = 25
[[surface]]
kind = "utc"
time = 2009-09-06T00:00:00Z
seconds_h = 12
[[sample]]
sensor_type = 1
state_to_sample = 5
interval = 4
[aborts]
overdepth = 120
remaining_charge = { value = 15, unit = "%" }
stalled_for_min = 15
"""
    mission = read_mission(write(tmp_path, text))
    assert mission.start == 1252152000.0
    assert mission.start_position == (39.4, -74.1) and mission.waypoints == ((39.0, -73.0),)
    assert (mission.waypoint_radius, mission.surface_stay, mission.legs) == (1500.0, 720.0, 3)
    assert mission.first_waypoint is None and mission.current_correction is False
    yo = mission.yo
    assert (yo.dive_pitch, yo.climb_pitch) == (pytest.approx(math.radians(24.0)), 0.5)
    assert yo.dive_altitude is None and yo.half_cycles == 6
    assert (yo.dive_volume, yo.climb_volume) == (pytest.approx(200e-6), 2.2e-4)
    assert [r.kind for r in mission.surface] == ["no_comms", "utc"]
    assert mission.surface[0].seconds == 21600.0
    assert mission.surface[0].climb_pitch == pytest.approx(math.radians(25.0))
    assert (mission.surface[1].time, mission.surface[1].seconds) == (1252195200.0, 43200.0)
    assert mission.samples[0] == SampleRule(1, frozenset({"dive", "climb"}), 4.0)
    assert mission.aborts == Aborts(overdepth=120.0, remaining_charge=0.15, stalled_for=900.0)


BASE = "[mission]\nwaypoints = [[39.3, -73.6], [39.1, -73.0]]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BASE + "[yo]\ndive_too = 1\ndive_to = 9\n", r"toml: \[yo\] unknown key 'dive_too'. Did you mean 'dive_to'\?"),
        (BASE + "dive_to = 100\nsurface_evry = 3\n", "Did you mean 'surface_every'"),
        (BASE, "expected the depth of a dive"),
        (BASE + "dive_to = 3\nclimb_to = 100\n", "deeper than climb_to"),
        (BASE + "dive_to = 3\nclimb_to = 3\n", "deeper than climb_to"),
        (BASE + "dive_to = 100\npitch = 2\n", "5 to 60 degrees"),
        (BASE + "dive_to = 100\npitch = 75\n", "5 to 60 degrees"),
        (BASE + "dive_to = 100\nwaypoint_radius = -1\n", "more than 0 m"),
        (BASE + "dive_to = 100\nlegs = 0\n", "legs: expected"),
        (BASE + "dive_to = 100\nfirst_waypoint = 4\n", "first_waypoint: expected 0 to 0"),
        (BASE + "dive_to = 100\nsurface_every = 0\n", "more than 0 s"),
        (BASE + "dive_to = 100\nsurface_stay = -5\n", "surface_stay"),
        (BASE + "dive_to = 100\nstart = 'soon'\n", "a time such as"),
        (BASE + "dive_to = 100\nstart = 1e300\n", "seconds since 1970"),
        (BASE + "dive_to = 100\n[yo]\nclimb_to = 3\n", "Move it to"),
        (BASE + "dive_to = 100\npitch = 26\ndive_pitch = 20\nclimb_pitch = 20\n", "say the same"),
        (BASE + "dive_to = 100\nstart_position = [39, -73]\nfirst_waypoint_is_start = true\n", "contradict"),
        (BASE + "dive_to = 100\n[[surface]]\nkind = 'evry'\nseconds = 5\n", "Did you mean 'every'"),
        (BASE + "dive_to = 100\n[[surface]]\nkind = 'every'\n", "needs seconds"),
        (BASE + "dive_to = 100\n[[surface]]\nkind = 'utc'\n", "needs a time"),
        (BASE + "dive_to = 100\n[[surface]]\nkind = 'inflections'\n", "needs a count"),
        (BASE + "dive_to = 100\n[[surface]]\nkind = 'waypoint_distance'\n", "needs a distance"),
        (BASE + "dive_to = 100\n[aborts]\noverdepth = 2\n", "aborts before the yo"),
        (BASE + "dive_to = 100\n[aborts]\nundervolts = -2\n", "at least 0"),
        (BASE + "dive_to = 100\n[[sample]]\nsensor_type = 1\nstates = ['down']\n", "dive, hover, climb, surface"),
        ("[mission]\nwaypoints = [[39.3, -73.6]]\ndive_to = 100\n", "at least one waypoint"),
        ("[mission]\nwaypoints = []\nstart_position = [39, -73]\ndive_to = 100\n", "at least one waypoint"),
        ("[mission]\nwaypoints = [[-73.6, 39.3], [99, -73]]\ndive_to = 100\n", "waypoint 2.*swapped"),
        ("[mission]\nwaypoints = [[39.3, -473.6], [39, -73]]\ndive_to = 100\n", "longitude"),
        ("[mission]\nwaypoints = [39.3, -73.6]\ndive_to = 100\n", r"expected \[latitude, longitude\]"),
        ("[mission]\ndive_to = 100\n", "Add waypoints"),
        ("waypoints = [[39.3, -73.6]]\n", r"table \[mission\]"),
        ("[mission\n", "not valid TOML"),
    ],
)  # fmt: skip
def test_bad_missions_are_refused_in_one_sentence(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message) as caught:
        read_mission(write(tmp_path, text))
    assert "mission.toml" in str(caught.value)


def test_unknown_files(tmp_path):
    with pytest.raises(DataError, match="found nothing there"):
        read_mission(tmp_path / "absent.mi.gz")
    with pytest.raises(DataError, match="Check the path"):
        read_mission(tmp_path / "absent.toml")
    with pytest.raises(DataError, match="'.txt'"):
        read_mission(write(tmp_path, "x", "mission.txt"))
    with pytest.raises(ConfigError, match="seconds since 1970"):
        read_mission(start=math.nan)


def test_a_folder_with_the_usual_name(tmp_path):
    write(tmp_path, FLAT)
    assert read_mission(tmp_path).waypoint_radius == 800.0


def test_what_is_assumed_is_noted(tmp_path):
    mission = read_mission(write(tmp_path, BASE + "dive_to = 100\n"))
    assert any("surface_every" in note for note in mission.notes)
    assert any("surface_stay" in note for note in mission.notes)
    assert mission.start is None


POSITION = st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
POSITIVE = st.floats(1e-3, 1e7)
PITCH = st.floats(math.radians(5.0), math.radians(60.0))
STATES = ["dive", "hover", "climb", "surface"]
TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)


@st.composite
def rules(draw):
    kind = draw(st.sampled_from(SURFACE_KINDS))
    return SurfaceRule(
        kind=kind,
        seconds=draw(POSITIVE),
        time=draw(st.floats(0.0, 4e9)) if kind == "utc" else draw(st.none() | st.floats(0.0, 4e9)),
        count=draw(st.integers(1, 99)),
        distance=draw(POSITIVE),
        when_yo_ends=draw(st.booleans()),
        ends_mission=draw(st.booleans()),
        climb_pitch=draw(st.none() | PITCH),
        name=draw(TEXT),
    )


@st.composite
def missions(draw):
    climb = draw(st.floats(0.0, 500.0))
    low = draw(st.floats(-10.0, 100.0))
    n = draw(st.integers(1, 4))
    optional = st.none() | POSITIVE
    return Mission(
        name=draw(TEXT) or "m",
        waypoints=tuple(draw(POSITION) for _ in range(n)),
        yo=Yo(
            dive_to=climb + draw(st.floats(0.5, 1000.0)),
            climb_to=climb,
            dive_pitch=draw(PITCH),
            climb_pitch=draw(PITCH),
            dive_altitude=draw(optional),
            climb_altitude=draw(optional),
            dive_volume=draw(st.none() | st.floats(1e-6, 1e-3)),
            climb_volume=draw(st.none() | st.floats(1e-6, 1e-3)),
            half_cycles=draw(st.none() | st.integers(1, 1000)),
            overshoot=draw(optional),
        ),
        surface=tuple(draw(st.lists(rules(), min_size=1, max_size=3))),
        start=draw(st.none() | st.floats(0.0, 4e9)),
        start_position=draw(st.none() | POSITION),
        waypoint_radius=draw(POSITIVE),
        legs=draw(st.sampled_from([-2, -1, 1, 7])),
        first_waypoint=draw(st.none() | st.integers(0, n - 1)),
        surface_stay=draw(st.floats(0.0, 6e5)),
        samples=tuple(
            SampleRule(t, frozenset(draw(st.sets(st.sampled_from(STATES)))), i, low, low + i)
            for t, i in draw(st.lists(st.tuples(st.integers(0, 99), st.floats(0.0, 1e4)), max_size=2))
        ),
        aborts=Aborts(
            overdepth=draw(st.none() | st.floats(2000.0, 1e4)),
            undervolts=draw(optional),
            remaining_charge=draw(st.none() | st.floats(0.0, 1.0)),
            same_depth_for=draw(optional),
        ),
        current_correction=draw(st.booleans()),
        unsupported=tuple(draw(st.lists(TEXT, max_size=2))),
        notes=tuple(draw(st.lists(TEXT, max_size=2))),
    )  # fmt: skip


@settings(max_examples=120, deadline=None)
@given(missions())
def test_toml_there_and_back(tmp_path_factory, mission):
    check_mission(mission)
    path = write_mission_toml(mission, tmp_path_factory.mktemp("m") / "m.toml")
    back = read_mission(path)
    assert replace(back, source=mission.source) == mission


def test_written_file_appears_whole_or_not_at_all(tmp_path):
    mission = read_mission()
    with pytest.raises(DataError, match="cannot be written"):
        write_mission_toml(mission, tmp_path / "absent" / "m.toml")
    assert list(tmp_path.iterdir()) == []
    write_mission_toml(mission, tmp_path / "m.toml")
    assert [p.name for p in tmp_path.iterdir()] == ["m.toml"]
    assert "start_position = [39.45, -74.15]" in mission_toml(mission)


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.binary(max_size=150), st.text(max_size=150).map(lambda t: t.encode("utf-8", "replace"))))
def test_any_bytes_are_read_or_refused(tmp_path_factory, raw):
    path = tmp_path_factory.mktemp("f") / "f.toml"
    path.write_bytes(raw)
    with pytest.raises((ConfigError, DataError)):
        read_mission(path)


@pytest.mark.parametrize("value", ["[]", "{}", '"x"', "-1", "inf", "[[1]]", "[{}]", "2020-01-01", "12:00:00", "true"])
@pytest.mark.parametrize(
    "key",
    ["start", "waypoints", "name", "start_position", "dive_to", "pitch", "surface_every", "legs", "notes", "altitude"],
)
def test_values_of_the_wrong_kind_never_crash(tmp_path, key, value):
    base = {"waypoints": "[[39.3, -73.6], [39.1, -73.0]]", "dive_to": "100"}
    base[key] = value
    path = write(tmp_path, "[mission]\n" + "".join(f"{k} = {v}\n" for k, v in base.items()))
    try:
        read_mission(path)
    except (ConfigError, DataError) as error:
        assert "mission.toml" in str(error)


def _matches(value, schema, root):
    """The part of JSON Schema that the bundled schemas use."""
    if "$ref" in schema:
        return _matches(value, root["$defs"][schema["$ref"].rsplit("/", 1)[1]], root)
    if "anyOf" in schema and not any(_matches(value, s, root) for s in schema["anyOf"]):
        return False
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}
    if "type" in schema:
        kind = schema["type"]
        if not isinstance(value, kinds[kind]) or (kind in ("number", "integer") and isinstance(value, bool)):
            return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, int | float) and value < schema.get("minimum", -math.inf):
        return False
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            return False
        return all(_matches(item, schema.get("items", {}), root) for item in value)
    if isinstance(value, dict):
        known = schema.get("properties", {})
        extra = schema.get("additionalProperties", True)
        if not set(schema.get("required", ())) <= set(value):
            return False
        for key, item in value.items():
            if key in known:
                if not _matches(item, known[key], root):
                    return False
            elif extra is False or (isinstance(extra, dict) and not _matches(item, extra, root)):
                return False
    return True


def _plain(value):
    """TOML data as JSON would hold them."""
    return json.loads(json.dumps(value, default=lambda v: v.isoformat()))


@pytest.mark.parametrize("kind", ["mission", "vehicle"])
def test_bundled_files_match_the_schemas_for_editors(kind):
    import tomllib

    root = Path(glider_jax_data.path(f"schemas/{kind}.schema.json"))
    schema = json.loads(root.read_text(encoding="utf-8"))
    files = [n for n in glider_jax_data.names() if n.startswith(f"{kind}s/") and n.endswith(".toml")]
    assert files
    for name in files:
        data = _plain(tomllib.loads(glider_jax_data.path(name).read_text(encoding="utf-8")))
        assert _matches(data, schema, schema), name
        data[kind]["unheard_of"] = 1
        assert not _matches(data, schema, schema)
    if kind == "mission":
        text = mission_toml(read_mission())
        assert _matches(_plain(tomllib.loads(text)), schema, schema)
        assert _matches(_plain(tomllib.loads(FLAT)), schema, schema)


def test_schemas_follow_the_code():
    import runpy

    made = runpy.run_path(str(Path(glider_jax_data.__file__).with_name("make_schemas.py")))
    for kind in ("mission", "vehicle"):
        written = json.loads(glider_jax_data.path(f"schemas/{kind}.schema.json").read_text(encoding="utf-8"))
        assert made["schemas"]()[kind] == written
