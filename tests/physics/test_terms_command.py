"""The command that lists the library."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from glider_jax.errors import ConfigError
from glider_jax.physics.library import LIBRARY
from glider_jax_cli.terms import terms


@pytest.fixture
def run():
    """Run the command in an application of its own."""
    app = typer.Typer()
    app.command()(terms)
    return lambda *words: CliRunner().invoke(app, list(words))


def test_lists_every_term(run):
    """One line per term."""
    found = run()
    assert found.exit_code == 0
    assert all(kind.info.id in found.stdout for kind in LIBRARY)
    assert len(found.stdout.splitlines()) == len(LIBRARY)


def test_json_has_equation_parameters_priors_and_source(run):
    """Machine-readable, in shown and SI units."""
    rows = {row["id"]: row for row in json.loads(run("--json").stdout)}
    assert len(rows) == len(LIBRARY)
    growth = rows["flight.mass_growth"]
    rate = growth["parameters"][0]
    assert (rate["unit"], rate["shown"]) == ("kg s-1", "kg/day")
    assert rate["prior"]["sd"] == pytest.approx(0.02)
    assert growth["equation"] and growth["reference"] and growth["channels"][0]["unit"] == "N"
    assert "base.hull" in {row["id"] for row in json.loads(run("--json", "--base").stdout)}


def test_one_term_in_full(run):
    """Equation, unknowns and what decides."""
    text = run("flight.drag_growth").stdout
    assert "C_{D0}" in text and "1/day" in text and "decided by" in text and "flight.pitch_drift" in text
    assert run("navigation").stdout.count("equation:") == sum(
        k.info.id.startswith("navigation") for k in LIBRARY
    )
    assert "base.hull" in run("base").stdout


def test_unknown_term_offers_the_nearest(run):
    """A misspelt id is explained."""
    found = run("flight.drag_grwth")
    assert isinstance(found.exception, ConfigError)
    assert "Did you mean 'flight.drag_growth'" in str(found.exception)
