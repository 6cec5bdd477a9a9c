"""``diagnose`` on the command line: what is passed on, what is printed, and a bar only where a terminal watches."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import glider_jax_data
from glider_jax.diagnosis import run as module
from glider_jax_cli.diagnose import STAGES, stages
from glider_jax_cli.main import app
from tests.diagnosis.test_page import content, effect

BUNDLED = str(glider_jax_data.path("gliderflight/comet2016.nc"))


@pytest.fixture
def called(monkeypatch):
    """Keep what the command passes on, and answer with a small diagnosis."""
    seen = {}

    def diagnose(**given):
        seen.update(given)
        return content(
            effect(),
            summary="Left out: pitch scale.",
            flow={"later": [{"predicted": 4, "fitted": 7, "before_m": 780.0, "after_m": 90.0}]},
            ensemble={
                "members": 100, "surfacings": 23, "hours": 81.0, "recorded_charge_ah_per_day": 3.54,
                "before": {"position_error_m": 2579.0, "charge_ah_per_day": 3.18},
                "after": {"position_error_m": 2318.0, "charge_ah_per_day": 3.52},
            },
            forecast_misses={"sentence": "12 forecast surfacings missed."},
        )  # fmt: skip

    monkeypatch.setattr(module, "diagnose", diagnose)
    return seen


def test_options_reach_the_diagnosis_and_results_are_printed(called, tmp_path):
    """Streams, hindcast, members and wholeness are passed on; flow, ensemble and misses are told."""
    cases = tmp_path / "hindcast.json"
    cases.write_text(json.dumps({"cases": [{"recording": "r"}]}), encoding="utf-8")
    words = ["diagnose", BUNDLED, "--stream", "vertical_speed", "--hindcast", str(cases), "--fly", "7", "--whole"]
    told = CliRunner().invoke(app, [*words, "--out", str(tmp_path)])
    assert told.exit_code == 0, told.output
    assert called["streams"] == ["vertical_speed"] and called["fly"] == 7 and called["whole"]
    assert called["misses"] == [{"recording": "r"}] and called["recording"].name == "comet2016"
    for words in ("flight.pitch_gain", "780 m without, 90 m", "2579 m before, 2318 m after", "recorded 3.54"):
        assert words in told.output
    assert "12 forecast surfacings missed." in told.output


def test_a_wrong_hindcast_file_stops_with_one_sentence(called, tmp_path):
    """The file of another command."""
    wrong = tmp_path / "hindcast.json"
    wrong.write_text("{}", encoding="utf-8")
    told = CliRunner().invoke(app, ["diagnose", BUNDLED, "--hindcast", str(wrong), "--out", str(tmp_path)])
    assert told.exit_code == 1 and "hindcast" in str(told.exception)


def test_the_bar_is_for_terminals_only(monkeypatch):
    """Nothing without a terminal or when quiet; with one, every stage moves it forward."""
    with stages(True) as tell:
        assert tell is None
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with stages(False) as tell:
        assert tell is None
    with stages(True) as tell:
        for word, _ in STAGES:
            tell(word)
    assert [share for _, share in STAGES] == sorted(share for _, share in STAGES)
