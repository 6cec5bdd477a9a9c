"""The validate command: writes its page, and says what a lone option lacks."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from glider_jax.errors import ConfigError
from glider_jax_cli.validate import validate

APP = typer.Typer()
APP.command()(validate)


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch):
    # The cache chooses the number of devices, which a session of tests has long fixed.
    monkeypatch.setattr("glider_jax_cli.session.compiled_cache", lambda: None)


@pytest.mark.slow
def test_it_writes_page_numbers_and_figures(tmp_path):
    result = CliRunner().invoke(APP, ["--n", "5", "--out", str(tmp_path), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    numbers = json.loads(result.stdout)
    assert len(numbers["rows"]) == 6
    page = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert "SimDist seafloor, CODAR" in page
    for name in ("figure-03-fin-wiggle", "figure-08-pump-energy", "figure-11-maps", "table-rows"):
        assert (tmp_path / f"{name}.png").stat().st_size > 5000


def test_a_recording_without_its_mission_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="--flown: expected --flown-mission"):
        CliRunner().invoke(APP, ["--flown", str(tmp_path / "x.nc")], catch_exceptions=False)
