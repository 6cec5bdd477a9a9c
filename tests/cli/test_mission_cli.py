"""The mission commands: a program is checked, exported with what it cannot say, and reported where it fires."""

from __future__ import annotations

import json
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from typer.testing import CliRunner

from glider_jax.errors import ConfigError
from glider_jax.products.job import Options, run_ensemble
from glider_jax.products.rule_times import program_lines
from glider_jax.readers.missions import read_mission
from glider_jax_cli.mission import app

MISSION = """
[mission]
name = "toy"
start = 2009-09-05T12:00:00Z
start_position = [39.0, -73.0]
waypoints = [[39.5, -73.0]]
dive_to = 60.0
surface_every_h = 3

[[program]]
name = "after six hours: home"
when = { elapsed_above_h = 6 }
then = { goto = "home" }

[[program]]
when = { state_of_charge_below_percent = 20 }
then = { end_mission = true }
"""


@pytest.fixture
def mission(tmp_path):
    path = tmp_path / "toy.toml"
    path.write_text(MISSION, encoding="utf-8")
    return path


def test_export_says_what_it_wrote_and_what_not(tmp_path, mission):
    result = CliRunner().invoke(app, ["export", str(mission), "--out", str(tmp_path / "s")], catch_exceptions=False)
    assert result.exit_code == 0
    assert "expressed: program rule 2" in result.stdout and "remaining_charge_min 20 %" in result.stdout
    assert "not expressed: program rule 1 'after six hours: home': no behaviour sets goto" in result.stdout
    assert read_mission(tmp_path / "s").aborts.remaining_charge == pytest.approx(0.2)
    again = ["export", str(mission), "--out", str(tmp_path / "t"), "--json"]
    entry = json.loads(CliRunner().invoke(app, again, catch_exceptions=False).stdout)
    assert len(entry["expressed"]) == 1 and all(Path(name).exists() for name in entry["files"])


def test_show_prints_a_mission_that_reads_back(tmp_path, mission):
    text = CliRunner().invoke(app, ["show", str(mission)], catch_exceptions=False).stdout
    other = tmp_path / "other.toml"
    other.write_text(text, encoding="utf-8")
    assert read_mission(other).program == read_mission(mission).program


def test_a_wrong_rule_is_explained(tmp_path, mission):
    mission.write_text(MISSION.replace("elapsed_above_h", "elapsed_abov_h"), encoding="utf-8")
    with pytest.raises(ConfigError, match="Did you mean 'elapsed_above_h'"):
        CliRunner().invoke(app, ["export", str(mission), "--out", str(tmp_path / "s")], catch_exceptions=False)


def test_a_forecast_reports_when_rules_fire(tmp_path, mission):
    options = Options(n=6, mission=mission, days=1.0, outputs=frozenset({"nc", "json"}))
    result = run_ensemble(options, tmp_path / "out")
    first, second = result.summary["program"]
    assert first["probability"] == 1.0 and 6.0 <= first["hours"]["median"] < 6.5
    assert second["probability"] == 0.0 and second["hours"]["median"] is None and second["count"] == 0.0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["program"][0]["rule"] == first["rule"]
    assert program_lines(result.summary) == [
        "rule 1 'after six hours: home' fired in 100 % of members, median day 0.3 (0.3-0.3)",
        "rule 2 'state of charge below 20 %: end mission' fired in 0 % of members",
    ]
    with netCDF4.Dataset(result.files["nc"]) as dataset:
        hours = (dataset["program_time"][:, 0] - dataset["forecast_reference_time"][...]) / 3600.0
        assert np.all((hours >= 6.0) & (hours < 6.5)) and dataset["program_time"][:, 1].mask.all()
        assert dataset["program_count"][:].tolist() == [[1, 0]] * 6
        assert "after six hours: home" in dataset["program_time"].rules
