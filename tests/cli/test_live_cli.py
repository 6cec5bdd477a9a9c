"""``next``, ``hindcast`` and ``scores`` through the entry point: results, exit codes, one sentence per bad input."""

from __future__ import annotations

import json

import pytest

from glider_jax.products.live_inputs import watch
from glider_jax.products.live_missions import _nmea
from tests.inference.test_live import TWO
from tests.readers.glider_layouts import simulate, write_native

FEW = ["--n", "100", "--hours", "12"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_native(tmp_path_factory.mktemp("cli") / "unit.nc", simulate(dives=4, yos=6))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "unit7.log"
    path.write_text(TWO)
    return path


def test_next_from_a_recording_is_frozen_and_scored(run, recording, tmp_path):
    code, out, err = run("next", "--recording", recording, "--now", "data", *FEW, "--json")
    assert code == 0, err
    result = json.loads(out)
    one = result["next"]
    assert one["time"]["p05"] < one["time"]["median"] < one["time"]["p95"]
    assert [r["probability"] for r in one["regions"]] == [0.5, 0.9]
    assert one["regions"][0]["area_km2"] < one["regions"][1]["area_km2"]
    assert sum(r["probability"] for r in one["reasons"]) == pytest.approx(1.0, abs=1e-3)
    assert result["inputs"]["segments"] == 4 and result["inputs"]["files"]
    assert result["outlook"]["ah_per_day"]["total"]["median"] > 0
    frozen = list((tmp_path / "next" / "frozen").glob("*.json"))
    assert (
        len(frozen) == 1
        and json.loads((tmp_path / "next" / "next.json").read_text())["next"]["time"] == one["time"]
    )
    code, out, err = run("scores", "next", "--recording", recording)
    assert code == 0, err
    assert "has not come" in out


def test_an_earlier_forecast_is_scored_by_the_next(run, recording):
    early = "2017-07-14T05:30:00Z"
    assert run("next", "--recording", recording, "--now", early, *FEW)[0] == 0
    code, out, err = run("next", "--recording", recording, "--now", "data", *FEW)
    assert code == 0, err
    assert "last forecast (2017-07-14T" in out and "′N" in out and "battery:" in out
    code, out, _ = run("scores", "next", "--recording", recording, "--json")
    table = json.loads(out)["table"]
    assert code == 0 and table["scored"] == 1 and table["waiting"] == 1


def test_next_from_a_dialog(run, log):
    code, out, err = run("next", "--dialog", log, "--now", "data", *FEW)
    assert code == 0, err
    assert out.startswith("unit7: fix 2026-03-28T08:59:40Z at 40°02.000′N 073°00.000′W")
    assert "reference field" in err and "energies of" in err and "ages: " in err
    assert "as before (no comms for a while)" in out


def test_a_stale_fix_has_its_own_exit_code(run, log):
    code, out, err = run("next", "--dialog", log, *FEW)
    assert code == 3 and out == ""
    assert "unit7: expected a fix of the last" in err and "--now data" in err
    assert run("next", "--dialog", log, "--now", "2026-03-28T10:30Z", "--stale-h", "1", *FEW)[0] == 3
    assert run("next", "--dialog", log, "--now", "2026-03-28T09:30Z", "--stale-h", "1", *FEW)[0] == 0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("nothing of a dialog\n", "expected a GPS fix to forecast from, found none"),
        (TWO + "\nGliderDos A 3 >\n", "expected a running mission"),
        (TWO + TWO.replace("unit7", "other9"), "expected dialogs of one glider, found unit7, other9"),
    ],
)
def test_dialogs_that_cannot_be_forecast_from(run, tmp_path, content, words):
    path = tmp_path / "bad.log"
    path.write_text(content)
    code, _, err = run("next", "--dialog", path, "--now", "data", *FEW)
    assert code == 1 and words in err and "Traceback" not in err


def test_other_bad_input(run, log, tmp_path, recording):
    for words, said in (
        (["next"], "expected a dialog or a recording, found neither"),
        (
            ["next", "--dialog", tmp_path / "no.log", "--now", "data"],
            "no.log: expected a dialog log or state file",
        ),
        (["next", "--dialog", log, "--now", "yesterday"], "--now: expected a UTC time"),
        (["next", "--dialog", log, "--now", "data", "--n", "3"], "--members: expected at least 50"),
        (["next", "--dialog", log, "--now", "data", "--hours", "0.2"], "--hours: expected 1 to 1440"),
        (["next", "--dialog", log, "--now", "data", "--format", "kml"], "Did you mean 'kmz'?"),
        (
            ["next", "--dialog", log, "--now", "data", "--mission", tmp_path / "no"],
            "expected a mission file or folder",
        ),
        (["scores", "nowhere", "--recording", recording], "expected a folder with frozen forecasts"),
    ):
        code, _, err = run(*words)
        assert code == 1 and said in err, err
    assert run("next", "--recording", tmp_path / "no.nc")[0] == 1


def write_mission(folder, *, surface="9", seconds=10800, waypoint="-7300.000 4020.000", name="shelf.mi"):
    folder.mkdir()
    (folder / name).write_text(
        "behavior: abend\n b_arg: overdepth(m) 200\nbehavior: surface\n"
        f" b_arg: start_when(enum) {surface}\n b_arg: when_secs(sec) {seconds}\nbehavior: goto_list\n"
        " b_arg: args_from_file(enum) 10\nbehavior: yo\n b_arg: d_target_depth(m) 40\n b_arg: c_target_depth(m) 3\n"
    )
    if waypoint:
        (folder / "goto_l10.ma").write_text(
            "behavior_name=goto_list\n<start:b_arg>\n b_arg: num_legs_to_run(nodim) -1\n"
            f" b_arg: num_waypoints(nodim) 1\n<end:b_arg>\n<start:waypoints>\n{waypoint}\n<end:waypoints>\n"
        )
    return folder


def test_mission_files_bring_their_rules(run, log, tmp_path):
    path = tmp_path / "timed.log"
    path.write_text(TWO.replace("start_when = 12.0", "start_when = 9.0"))
    folder = write_mission(tmp_path / "m")
    code, out, err = run("next", "--dialog", path, "--now", "data", "--mission", folder, *FEW, "--json")
    assert code == 0, err
    result = json.loads(out)
    assert result["next"]["reasons"][0]["reason"] == "every"
    assert result["inputs"]["mission"] == "shelf" and "check the files" not in err


def test_mission_files_that_contradict_the_dialog_are_named(run, log, tmp_path):
    far = write_mission(tmp_path / "far", waypoint="-7200.000 4120.000", name="other.mi")
    code, _, err = run("next", "--dialog", log, "--now", "data", "--mission", far / "other.mi", *FEW)
    assert code == 0
    assert "the glider flies to 40°20.000′N 073°00.000′W" in err and "km from it" in err
    assert "start_when 12" in err and "no such rule" in err
    assert "the glider says it flies 'shelf.mi'" in err


def test_a_missing_list_of_waypoints_is_filled_from_the_dialog(run, log, tmp_path):
    folder = write_mission(tmp_path / "bare", waypoint=None)
    (folder / "second.mi").write_text("behavior: yo\n")
    code, out, err = run("next", "--dialog", log, "--now", "data", "--mission", folder, *FEW, "--json")
    assert code == 0, err
    assert "goto_l10.ma is not there" in err
    place = json.loads(out)["waypoints"][0]["place"]
    assert (place["latitude"], place["longitude"]) == pytest.approx((40.0 + 20.0 / 60.0, -73.0), abs=1e-4)
    assert (
        _nmea(-73.0 - 40.271 / 60.0) == "-7340.27100"
        and _nmea(-0.5) == "-030.00000"
        and _nmea(7.0) == "700.00000"
    )


def test_hindcast_prints_tables_and_writes_them(run, recording, tmp_path):
    code, out, err = run("hindcast", recording, "--n", "100", "--out", tmp_path / "h")
    assert code == 0, err
    assert out.startswith("recording\tcases") and "worst cases" in out and "pooled\t3" in out
    content = json.loads((tmp_path / "h" / "hindcast.json").read_text())
    assert len(content["cases"]) == 3 and (tmp_path / "h" / "reliability.png").stat().st_size > 5000


def test_watching_acts_once_per_change_that_has_settled(tmp_path):
    path = tmp_path / "a.log"
    path.write_text("1")
    calls, sizes = [], iter(["12", "123", None, None, None])

    def sleep(_):
        text = next(sizes)
        if text:
            path.write_text(text)

    assert watch([tmp_path], 1.0, lambda: calls.append(path.read_text()), rounds=5, sleep=sleep) == 2
    assert calls == ["1", "123"]


def test_real_dialog_and_mission_files(run, real):
    log = real("live", "composed", "inmission_surfacing_COMPOSED.txt")
    folder = real("live", "missions", "SWFSC_glider-lab")
    code, out, err = run("next", "--dialog", log, "--mission", folder, "--now", "data", *FEW)
    assert code == 0, err
    assert out.startswith("zz900: fix 2026-03-28T20:39:33Z") and "43.1 % left" in out
    assert "goto_l10.ma is not there" in err


@pytest.mark.parametrize("name", ["maria2022", "rosie2019"])
def test_real_telemetry_as_if_live(run, real, name):
    folder = real("recordings", name, "orig")
    code, out, err = run(
        "next", "--recording", folder, "--cache", real("recordings", name, "cac"), "--now", "data", *FEW
    )
    assert code == 0, err
    assert "next first fix:" in out and "Ah/day (charge counter)" in out and "repaired: " in err
