"""Real recordings with an effect concealed, through the diagnosis: the bundled one always, others where they are."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import glider_jax_data
from glider_jax.diagnosis.proof import real_cases, real_check
from glider_jax.errors import DataError
from glider_jax.readers.recordings import read_recording


def quiet(text: str) -> None:
    """Say nothing."""


def failing(proof):
    """Lines of a table that do not hold."""
    return [(row.what, row.tool, row.known) for row in proof.rows if row.holds is False]


@pytest.fixture(scope="module")
def comet2016(tmp_path_factory):
    """The bundled recording, diagnosed by vertical speed alone and with the measured speed."""
    out = tmp_path_factory.mktemp("comet2016")
    return real_cases.comet2016(out, quiet), out


def test_the_bundled_recording_gives_speed_and_density():
    """The file's own density and speed are channels of ours, in SI."""
    recording = read_recording(glider_jax_data.path("gliderflight/comet2016.nc"))
    assert 1004.0 < recording["water_density"].mean() < 1008.0
    speed = recording["measured_speed"]
    assert 0.25 < speed[speed == speed].mean() < 0.40


def test_the_hidden_pitch_scale_is_named_with_the_measured_speed_alone(comet2016):
    """Vertical speed names nothing and takes the scale for drag; with the speed both come out right."""
    proof, _ = comet2016
    assert not failing(proof)
    alone, both = proof.contents["alone"], proof.contents["both"]
    assert alone["effects"] == []
    gain, low, high = real_cases.value(real_cases.effect(both, "flight.pitch_gain"))
    assert -0.16 < gain < -0.10 and low < -0.127 < high
    assert real_cases.calibrated(alone, "flight.parasite_drag")[0] > 0.19
    assert real_cases.calibrated(both, "flight.parasite_drag")[0] == pytest.approx(0.155, abs=0.015)


def test_held_out_dives_fit_better_in_both_directions(comet2016):
    """Vertical speed and speed through water on dives left out of the fit."""
    streams = comet2016[0].contents["both"]["held_out"]["streams"]
    assert streams["speed through water"]["after"]["rms"] < 0.7 * streams["speed through water"]["before"]["rms"]
    assert streams["vertical speed"]["after"]["rms"] < streams["vertical speed"]["before"]["rms"]


def test_the_page_says_what_vertical_speed_cannot_tell(comet2016):
    """A pilot without a profiler reads that the pitch scale is open, and what would tell."""
    text = (comet2016[1] / "comet2016-alone" / "report.html").read_text()
    assert "cannot tell" in text and "pitch scale (a measured speed through the water" in text


def test_an_independent_fit_agrees():
    """Steady glide and least squares alone: the published scale, and drag that hides it."""
    known = real_check.pitch_scale(
        read_recording(glider_jax_data.path("gliderflight/comet2016.nc")), real_cases.VOLUME_2016, 34
    )
    assert known["gain"].value == pytest.approx(-0.127, abs=0.006)
    assert known["drag"].value == pytest.approx(0.157, abs=0.005)
    assert known["drag by vertical speed alone"].value == pytest.approx(0.233, abs=0.005)


def test_table_and_results_are_written(tmp_path, comet2016, monkeypatch):
    """Without recordings the bundled case runs alone, the others are named as left out, exit code 0."""
    from glider_jax_cli.main import app

    monkeypatch.setattr(real_cases, "comet2016", lambda out, tell: comet2016[0])
    told = CliRunner().invoke(app, ["prove", "--set", "real-proofs", "--out", str(tmp_path)])
    assert told.exit_code == 0, told.output
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["failing"] == 0 and results["left_out"]
    assert (tmp_path / "table.md").read_text().count("\n") == len(results["rows"]) + 2
    assert (tmp_path / "comet2016.png").stat().st_size > 5000


def test_a_missing_folder_is_explained(tmp_path):
    """The folder without the recordings."""
    with pytest.raises(DataError, match="Give the folder with the recordings"):
        real_cases.currents(tmp_path, tmp_path, quiet)


def test_the_fin_draws_nothing_that_pairs_confirm(real):
    """Means of both days differ by 50 mA the wrong way, pairs by 7 mA, and so do shifted pairs, with the other sign."""
    recording = read_recording(real("recordings", "comet2019", "comet2019.nc"))
    from glider_jax.diagnosis.regimes import split

    parts = split(recording)
    assert len(parts) == 2
    fin = real_check.fin_current(parts[1])
    assert real_check.fin_current(recording)["means"].value < -30.0
    assert abs(fin["paired"].value) < 10.0
    assert fin["placebo, one cycle later"].value < -2.0 and fin["placebo, one cycle earlier"].value < -2.0
    slope, count = real_check.pump_slope(recording)
    assert count == 58 and slope.value == pytest.approx(6.1, abs=1.5)


@pytest.mark.slow
def test_two_missions_loads_drag_and_pump(real, tmp_path):
    """Comet 2019: each mission by itself; loads, drag since July, the pump; no fin load."""
    folder = real("recordings", "comet2019").parent
    proof = real_cases.comet2019(folder, tmp_path, quiet)
    assert not failing(proof)


@pytest.mark.slow
def test_hidden_currents_are_found_and_later_segments_met(real, tmp_path):
    """Currents kept from the tool on three recordings."""
    folder = real("recordings", "ru28_2017").parent
    proof = real_cases.currents(folder, tmp_path, quiet)
    assert not failing(proof)
    assert sum("later" in row.what for row in proof.rows) >= 7
