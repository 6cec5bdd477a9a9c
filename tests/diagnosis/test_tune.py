"""Shapes of accepted effects are moved to where they fit best, and amplitudes are no better known than these."""

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis.candidates import Candidate, Variant
from glider_jax.diagnosis.screen import Pick
from glider_jax.diagnosis.tune import estimates, tune, widened
from glider_jax.inference.fit import Column, Linear

ID = "flight.vertical_water_velocity"
TIME = np.arange(0.0, 3.0 * 86400.0, 300.0)
PERIOD, TRUE, SIGMA = 5.0 * 3600.0, np.array([0.004, -0.002]), 0.004


class White:
    """Independent noise of a known size."""

    n = TIME.size

    def whiten(self, columns):
        return columns / SIGMA, 0.0


def waves(period):
    phase = 2.0 * np.pi * TIME / period
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


class Search:
    """A wave of unknown period in noise, accepted at a period beside its own."""

    active = [0, 1]

    def __init__(self, measured, period):
        self.measured = measured
        self.problem = SimpleNamespace(
            names=("vertical speed",), values=np.zeros(2), shapes={}, noises=[White()],
            replay=SimpleNamespace(predict=self.predict),
        )  # fmt: skip
        variant = Variant((0, 1), 0.0, {f"{ID}.period": period})
        self.picks = [Pick(Candidate(ID, (variant,), 0.0), variant, 50.0)]
        self.relinearise()

    def predict(self, values, shapes):
        return {"vertical speed": waves(shapes[f"{ID}.period"]) @ values}

    def relinearise(self, learn_noise=True):
        self.problem.shapes = dict(self.picks[0].variant.shapes)
        columns = 0.01 * waves(self.problem.shapes[f"{ID}.period"])
        labels = (Column(0, f"{ID}.cosine", ID), Column(1, f"{ID}.sine", ID))
        nothing = np.zeros(TIME.size, int)
        self.linear = Linear(
            self.measured / SIGMA, columns / SIGMA, labels, nothing, nothing, self.measured, columns
        )  # fmt: skip
        self.problem.values = 0.01 * self.linear.solve(self.active)[0]


def drawn(rng):
    return waves(PERIOD) @ TRUE + SIGMA * rng.standard_normal(TIME.size)


def test_a_period_is_moved_from_the_grid_to_where_it_fits():
    search = Search(drawn(np.random.default_rng(3)), 1.02 * PERIOD)
    before = search.problem.values
    tune(search)
    assert abs(search.problem.shapes[f"{ID}.period"] / PERIOD - 1.0) < 0.004
    assert np.abs(search.problem.values - TRUE).max() < 0.3 * np.abs(before - TRUE).max()


def test_intervals_hold_the_truth_as_often_as_they_say_only_with_the_period_unknown():
    rng = np.random.default_rng(5)
    inside = np.zeros((2, 2))
    runs = 120
    for _ in range(runs):
        search = Search(drawn(rng), 1.01 * PERIOD)
        tune(search)
        mean, plain = search.linear.solve(search.active)
        for k, covariance in enumerate((plain, widened(search, plain))):
            inside[k] += np.abs(0.01 * mean - TRUE) < 1.645 * 0.01 * np.sqrt(np.diag(covariance))
    plain, whole = inside / runs
    assert (whole > 0.82).all() and (whole < 0.97).all()
    assert plain.min() < 0.82


def test_without_shapes_nothing_is_touched():
    search = Search(drawn(np.random.default_rng(3)), PERIOD)
    search.problem.shapes = {}
    kept, covariance = search.problem.values.copy(), np.eye(2)
    tune(search)
    assert np.array_equal(search.problem.values, kept)
    assert widened(search, covariance) is covariance


def test_values_are_those_at_rest_where_the_linear_problem_points_elsewhere():
    """And the way to where it points widens the interval; within a standard deviation the linear problem is right."""
    search = Search(drawn(np.random.default_rng(3)), PERIOD)
    centres, scales = (lambda: np.zeros(2)), (lambda: np.full(2, 0.01))
    search.problem.centres, search.problem.scales = centres, scales
    mean, near = estimates(search)
    assert mean == pytest.approx(search.linear.solve(search.active)[0])
    search.problem.values = 0.01 * mean + np.array([0.0, 0.01 * 5.0])
    rested, far = estimates(search)
    assert 0.01 * rested == pytest.approx(search.problem.values)
    assert np.diag(far) - np.diag(near) == pytest.approx([0.0, 25.0], abs=0.01)
