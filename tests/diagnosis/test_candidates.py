"""Candidates: widths of priors, values beside zero, and what physics allows of each number."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis.candidates import FAR, WIDTHS, Looks, Variant, widened
from glider_jax.inference.fit import Column, limits
from glider_jax.physics.library import LIBRARY, TERMS_BY_ID
from glider_jax.physics.term import declared


def test_widths_are_equally_likely_and_cost_what_looking_costs():
    """Weights of a variant's widths sum to the variant's own."""
    found = widened((Variant((3,), -0.7), Variant((4,), np.log(1.0 - np.exp(-0.7)))))
    assert sorted({one.width for one in found}) == sorted(WIDTHS)
    assert np.logaddexp.reduce([one.log_weight for one in found]) == pytest.approx(0.0)


def test_every_value_looked_at_counts_for_what_comes_out_nearest():
    """Cells of an effect looked at zero, 0.3 and 0.5 meet half way, in prior units, and each begins where it looked."""
    looks = object.__new__(Looks)
    unknown = SimpleNamespace(centre=0.0, scale=0.4)
    looks.replay = SimpleNamespace(unknowns=(unknown,))
    looks.far = [(0, 0.3, {}), (0, 0.5, {})]
    looks.shifts = {0: 21, 1: 23}
    found = looks._from_afar("flight.lift_loss", {0: [0], FAR: [20], FAR + 1: [22]})
    assert [one.columns for one in found] == [(0,), (20,), (22,)]
    assert [one.shift for one in found] == [-1, 21, 23]
    assert [one.start for one in found] == [{}, {0: 0.3}, {0: 0.5}]
    edges = [one.cell for one in found]
    assert edges[0] == (-np.inf, pytest.approx(0.375)) and edges[2] == (pytest.approx(1.0), np.inf)
    assert edges[0][1] == edges[1][0] and edges[1][1] == edges[2][0]


def test_physics_bounds_numbers_that_cannot_be_negative():
    """Hulls shrink under pressure and grow with warmth, growth grows, loads load; errors of sensors have any sign."""
    never = (
        "flight.hull_compressibility", "flight.thermal_expansion", "flight.drag_growth", "flight.mass_growth",
        "energy.dive_only_load", "energy.hotel_growth", "energy.brake_pressure", "energy.cold_friction",
    )  # fmt: skip
    either = ("flight.ballast_offset", "flight.pitch_offset", "sensor.current_offset", "flight.drag_bias")
    for id in never:
        assert [info.bounds[0] for info in declared(TERMS_BY_ID[id]).values() if info.role == "amplitude"] == [0.0]
    for id in either:
        assert all(info.bounds[0] < 0.0 for info in declared(TERMS_BY_ID[id]).values() if info.role == "amplitude")
    lift = declared(TERMS_BY_ID["flight.lift_loss"])["loss"]
    assert lift.bounds[0] > -1.0 and lift.bounds[1] < 1.0


@pytest.mark.parametrize("kind", LIBRARY, ids=lambda kind: kind.info.id)
def test_typical_strengths_are_possible(kind):
    """Zero, the prior's centre and a typical size lie within what a term declares as possible."""
    for info in declared(kind).values():
        low, high = info.bounds
        assert low < high
        if info.role == "amplitude":
            assert low <= 0.0 <= high and low <= info.prior.centre + info.prior.sd <= high
            assert all(low <= value <= high for value in info.looks)


def test_limits_are_in_prior_units():
    """A column's limits are its number's, in units of the scale; columns beside the unknowns have none."""
    unknowns = (
        SimpleNamespace(kind="candidate", centre=0.0, scale=0.4, lower=-0.6, upper=0.9),
        SimpleNamespace(kind="calibration", centre=1.0, scale=0.1, lower=0.0, upper=2.0),
    )
    problem = SimpleNamespace(replay=SimpleNamespace(unknowns=unknowns))
    lower, upper = limits(problem, [Column(0, "a", "a"), Column(1, "b", "b"), Column(-1, "c", "c")])
    assert lower == pytest.approx([-1.5, -np.inf, -np.inf]) and upper == pytest.approx([2.25, np.inf, np.inf])
