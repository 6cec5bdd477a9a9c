"""The commands that look at recordings: ``speeds fit`` and ``recording``."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from glider_jax.errors import DataError
from glider_jax.mission.speeds_fit import read_speeds
from glider_jax_cli.recording import recording
from glider_jax_cli.speeds import app as speeds_app
from tests.readers.glider_layouts import simulate, write_native


@pytest.fixture
def app():
    top = typer.Typer()
    top.command()(recording)
    top.add_typer(speeds_app, name="speeds")
    return top


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_native(tmp_path_factory.mktemp("rec") / "sim.nc", simulate(dives=2), nmea=True)


def test_speeds_fit_writes_a_file_that_reads(app, path, tmp_path):
    result = CliRunner().invoke(app, ["speeds", "fit", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    written = read_speeds(tmp_path / "out" / "speeds.json")
    assert [(d.kind, d.segments) for d in written] == [("over_ground", 2), ("through_water", 2)]
    assert "over ground\t2" in result.stdout and "\x1b" not in result.stdout


def test_speeds_fit_as_json(app, path, tmp_path):
    result = CliRunner().invoke(app, ["speeds", "fit", str(path), "--out", str(tmp_path), "--json"])
    content = json.loads(result.stdout)
    assert content["format"] == "glider_jax speed distribution"
    assert content["distributions"][0]["pitch_deg"] == 26.0 and content["excluded"] == {}


def test_speeds_fit_leaves_no_file_behind_when_nothing_can_be_fitted(app, path, tmp_path):
    command = ["speeds", "fit", str(path), "--out", str(tmp_path / "out"), "--shortest-s", "90000"]
    result = CliRunner().invoke(app, command)
    assert isinstance(result.exception, DataError) and "shorter than 90000 s" in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_recording_shows_repairs_channels_and_segments(app, path):
    result = CliRunner().invoke(app, ["recording", str(path)])
    assert result.exit_code == 0, result.output
    assert "positions: NMEA" in result.stdout
    assert "variation +14.3 degrees west (recorded)" in result.stdout
    assert "Dive segments: 2" in result.stdout and "Repairs:" in result.stdout
    assert "not recorded: current, water_vx" in result.stdout


def test_recording_as_json_has_only_finite_numbers(app, path):
    result = CliRunner().invoke(app, ["recording", str(path), "--json", "--variation-deg", "10"])
    content = json.loads(result.stdout)
    assert content["magnetic_variation_deg"] == 10.0 and content["magnetic_variation_from"] == "given"
    assert len(content["segments"]) == 2 and content["legs"] == 16
    assert content["channels"]["depth"]["unit"] == "m" and content["channels"]["depth"]["max"] > 39.0
    assert content["segments"][0]["dead_reckoning"] == "own"


def test_recording_explains_a_missing_file(app, tmp_path):
    result = CliRunner().invoke(app, ["recording", str(tmp_path / "x.nc")])
    assert isinstance(result.exception, DataError) and "found no such file" in str(result.exception)


def test_the_commands_start_without_heavy_imports():
    code = (
        "import sys, glider_jax_cli.speeds, glider_jax_cli.recording\n"
        "print([m for m in ('jax', 'netCDF4', 'xarray', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_real_damaged_set_is_shown_with_its_files_named(app, real):
    pytest.importorskip("dbdreader")
    result = CliRunner().invoke(app, ["recording", str(real("recordings", "osu684_2025", "orig"))])
    assert result.exit_code == 0
    assert "01330013.ecd" in result.stdout and "Dive segments: 8" in result.stdout
