"""The command that shows what a dialog holds."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from glider_jax.errors import DataError
from glider_jax_cli.dialog import dialog
from tests.readers.dialog_layouts import MOMENT, printout, state_file


@pytest.fixture
def run():
    app = typer.Typer()
    app.command()(dialog)
    return lambda *words: CliRunner().invoke(app, [str(w) for w in words])


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "kelp7_network.log"
    path.write_text(printout().replace("=100.5 ", "=1#0.5 "))
    return path


def test_a_person_reads_positions_ages_and_repairs(run, log):
    result = run(log)
    assert result.exit_code == 0, result.output
    assert "54°12.345′N 10°23.456′W (54.20575, -10.39093), 30 s old, 2027-05-04T12:29:30Z" in result.stdout
    assert (
        "state: in mission" in result.stdout
        and "no comms for a while [surface_3, start_when 12]" in result.stdout
    )
    assert "printed 8765 m at 245°" in result.stdout and "° T" in result.stdout
    assert "14.75 V (6 s old)" in result.stdout and "80.2 % left" in result.stdout
    assert "garbled line: 1" in result.stderr and "garbled" not in result.stdout


def test_json_holds_everything_without_nan(run, log):
    result = run(log, "--json", "--now", "2027-05-04T12:40:00Z")
    content = json.loads(result.stdout)
    assert (
        content["latest"]["gps"]["age"] == 630.0 and content["latest"]["gps"]["utc"] == "2027-05-04T12:29:30Z"
    )
    assert content["latest"]["sensors"]["m_battery"]["value"] == 14.75
    assert len(content["surfacings"]) == 1 and list(content["files"]) == [str(log)]
    assert content["repairs"][0]["kind"] == "garbled line"
    assert content["latest"]["defaults"]["f_coulomb_battery_capacity"]["age"] is None


def test_state_file_is_known_by_content(run, tmp_path):
    path = tmp_path / "anything.txt"
    path.write_text(state_file([(MOMENT, MOMENT - 20.0, " 5412.000", "-1020.000")]))
    result = run(path)
    assert result.exit_code == 0 and "GPS fix (dockserver state): 54°12.000′N" in result.stdout


def test_all_lists_each_surfacing(run, tmp_path):
    path = tmp_path / "a.log"
    path.write_text(printout() + printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", inflections=126))
    lines = [x for x in run(path, "--all").stdout.splitlines() if "\t" in x and "printouts" in x]
    assert [x.split("\t")[2][-2:] for x in lines] == ["41", "42"]


def test_nothing_in_the_log_is_no_crash(run, tmp_path):
    path = tmp_path / "empty.log"
    path.write_bytes(b"\xff\x00 nothing")
    result = run(path)
    assert result.exit_code == 0 and "GPS fix: none" in result.stdout


def test_wrong_path_and_time(run, log, tmp_path):
    with pytest.raises(DataError, match="Check the path"):
        raise run(tmp_path / "none.log").exception
    assert run(log, "--now", "yesterday").exit_code == 2


def test_escape_sequences_of_the_glider_do_not_reach_the_terminal(run, tmp_path):
    path = tmp_path / "a.log"
    path.write_text(printout().replace("no comms", "\x1b]0;owned\x07no comms"))
    assert "\x1b" not in run(path, "--all").output


def test_starts_without_jax():
    code = (
        "import sys, glider_jax_cli.dialog, glider_jax.readers.live_state;"
        "print([m for m in ('jax', 'scipy', 'xarray', 'netCDF4', 'matplotlib') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
