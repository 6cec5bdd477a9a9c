"""A diagnosis from end to end on a small independent simulation: named, sized, confirmed, written, flown."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from glider_jax.diagnosis.run import diagnose
from glider_jax.errors import DataError
from glider_jax.physics.model import build_model
from glider_jax.readers.vehicles import read_vehicle
from tests.diagnosis.worlds import fly, vehicle


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A flight with growing drag, a load on dives and a current, and its diagnosis."""
    out = tmp_path_factory.mktemp("diagnosis")
    recording = fly(1.5, drag_rate=0.2, dive_load=0.3, current=(0.1, -0.06))
    return recording, diagnose(None, out, recording=recording, vehicle=vehicle()), out


def test_what_was_left_out_is_named(diagnosed):
    """All three are named and nothing else."""
    _, found, _ = diagnosed
    assert sorted(e["id"] for e in found["effects"]) == [
        "energy.dive_only_load",
        "flight.drag_growth",
        "navigation.mean_current",
    ]
    assert found["verdict"] == "explained"
    assert all(e["held_out"]["confirmed"] for e in found["effects"])


def test_sizes_lie_in_their_intervals(diagnosed):
    """The planted sizes lie in the stated intervals, and the intervals are narrow."""
    _, found, _ = diagnosed
    sizes = {(e["id"], p["name"]): p for e in found["effects"] for p in e["parameters"]}
    for key, truth, width in (
        (("flight.drag_growth", "rate"), 0.2 / 86400.0, 0.2),
        (("energy.dive_only_load", "power"), 0.3, 0.1),
        (("navigation.mean_current", "east"), 0.1, 0.5),
        (("navigation.mean_current", "north"), -0.06, 0.8),
    ):
        low, high = sizes[key]["interval_90"]
        slack = 0.35 * (high - low)
        assert low - slack < truth < high + slack, key
        assert high - low < width * abs(truth) * 2.0, key


def test_held_out_dives_fit_better(diagnosed):
    """Scores improve on left-out dives, and surfacings are met."""
    _, found, _ = diagnosed
    speed = found["held_out"]["streams"]["vertical speed"]
    assert speed["after"]["rms"] < 0.7 * speed["before"]["rms"]
    assert speed["after"]["log_score"] > speed["before"]["log_score"] + 50.0
    miss = found["held_out"]["figures"]["surfacing_error_m"]
    assert miss["after"] < 0.2 * miss["before"]


def test_written_files_hold_what_was_found(diagnosed):
    """JSON is finite and the same, the page needs nothing else, the vehicle file is read and flown."""
    _, found, out = diagnosed
    again = json.loads((out / "diagnosis.json").read_text())
    assert again["effects"] == json.loads(json.dumps(found["effects"], allow_nan=False))
    page = (out / "report.html").read_text()
    assert "http" not in page.replace("http-equiv", "") and page.count("data:image/png") >= 2
    words = re.sub(r"base64,[^']*", "", page)
    assert "Growing drag" in words and "NaN" not in words and "nan" not in words.split()
    text = (out / "vehicle.toml").read_text()
    assert '[terms."flight.drag_growth"]' in text
    read = read_vehicle(out / "vehicle.toml")
    model = build_model(read, dtype=np.float32)
    assert "flight.drag_growth" in model.ids and "navigation.mean_current" in model.ids


def test_what_was_not_found_has_a_smallest_size(diagnosed):
    """Every other effect says how large it would have had to be, and currents without wind cannot be tested."""
    _, found, _ = diagnosed
    others = {e["id"]: e for e in found["not_found"]}
    # A replay flies in the density that was measured, so a stated profile cannot be at fault.
    assert others["flight.density_contrast"]["verdict"] == "not_testable"
    assert others["navigation.leeway"]["verdict"] == "not_testable"
    ballast = others["flight.ballast_offset"]
    assert ballast["verdict"] == "not_supported" and 0.0 < ballast["minimum_detectable"][0]["minimum"] < 0.2


def test_a_barred_effect_is_not_named(diagnosed):
    """Without the true effect something else or nothing is named, never the barred one."""
    recording, _, _ = diagnosed
    found = diagnose(recording=recording, vehicle=vehicle(), exclude=["flight.drag_growth"])
    assert "flight.drag_growth" not in [e["id"] for e in found["effects"]]


def test_wrong_requests_are_explained():
    """An unknown effect gets the nearest name; nothing to read is said."""
    with pytest.raises(DataError, match="Did you mean 'flight.drag_growth'"):
        diagnose(recording=None, vehicle=None, only=["flight.drag_groth"])
    with pytest.raises(DataError, match="expected a recording and a vehicle"):
        diagnose()
