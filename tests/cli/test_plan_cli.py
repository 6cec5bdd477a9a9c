"""The plan command on a small mission: page, figures and a wrong choice."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from glider_jax.errors import ConfigError
from glider_jax_cli.plan import plan

APP = typer.Typer()
APP.command()(plan)


@pytest.fixture(autouse=True)
def _no_cache(monkeypatch):
    # The cache chooses the number of devices, which a session of tests has long fixed.
    monkeypatch.setattr("glider_jax_cli.session.compiled_cache", lambda: None)


def test_it_writes_page_numbers_and_figures(tmp_path):
    words = ["--days", "0.5", "--loop", "--n", "4", "--vary", "battery=alkaline,rechargeable", "--no-tornado"]
    result = CliRunner().invoke(APP, [*words, "--out", str(tmp_path), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    assert len(json.loads(result.stdout)["settings"]) == 2
    assert "**rechargeable**" in (tmp_path / "plan.md").read_text(encoding="utf-8")
    assert (tmp_path / "pareto.png").stat().st_size > 5000


def test_a_wrong_choice_is_explained(tmp_path):
    with pytest.raises(ConfigError, match="Did you mean 'dive_to'"):
        CliRunner().invoke(APP, ["--vary", "diveto=20", "--out", str(tmp_path)], catch_exceptions=False)
