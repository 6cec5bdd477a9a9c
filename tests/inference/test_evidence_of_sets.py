"""Evidence of sets of columns: narrower priors, what physics allows, and effects looked at away from zero."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from glider_jax.inference.fit import Column, Linear


def problem(seed=0, n=60, k=3, truth=(0.0, 0.0, 0.0), lower=None, upper=None):
    """White residuals of a few columns."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(n, k)) * np.array([0.6, 0.3, 0.2])[:k]
    residual = columns @ np.array(truth[:k]) + rng.normal(size=n)
    labels = tuple(Column(i, f"c{i}", f"t{i}") for i in range(k))
    none = np.zeros(n, int)
    return Linear(residual, columns, labels, none, none, residual, columns, lower, upper)


def exact(linear, column, low, high, sd):
    """Logarithm of the evidence of one column under a normal prior cut to an interval, by quadrature."""
    r, j = linear.residual, linear.columns[:, column]
    share = norm.cdf(high / sd) - norm.cdf(low / sd)

    def density(z):
        return np.exp(0.5 * (r @ r) - 0.5 * np.sum((r - j * z) ** 2)) * norm.pdf(z, 0.0, sd) / share

    return float(np.log(quad(density, max(low, -12.0), min(high, 12.0), limit=200)[0]))


@pytest.mark.parametrize("truth", (-2.0, -0.3, 0.0, 0.4, 2.0))
def test_a_limit_by_physics_is_a_prior_cut_there(truth):
    """The evidence of a number that cannot be negative is that of the half of its prior, whatever the data say."""
    linear = problem(3, truth=(truth, 0.0, 0.0), lower=np.array([0.0, -np.inf, -np.inf]))
    assert linear.score([0]) == pytest.approx(exact(linear, 0, 0.0, np.inf, 1.0), abs=1e-6)
    free = problem(3, truth=(truth, 0.0, 0.0))
    assert free.score([0]) == pytest.approx(exact(free, 0, -np.inf, np.inf, 1.0), abs=1e-6)


def test_what_physics_forbids_is_no_candidate():
    """A clear effect of the wrong sign earns nothing, one of the right sign what it earned, and the gain of a bit."""
    lower = np.array([0.0, -np.inf, -np.inf])
    wrong, right = (problem(5, truth=(t, 0.0, 0.0), lower=lower) for t in (-2.5, 2.5))
    assert wrong.score([0]) < -2.0
    free = problem(5, truth=(2.5, 0.0, 0.0))
    assert right.score([0]) == pytest.approx(free.score([0]) + np.log(2.0), abs=1e-6)


@pytest.mark.parametrize("sd", (1.0, 0.25, 0.0625))
def test_a_narrower_prior(sd):
    """A stated precision is a prior of that width."""
    linear = problem(7, truth=(0.4, 0.0, 0.0))
    assert linear.score([0], np.array([sd**-2])) == pytest.approx(exact(linear, 0, -np.inf, np.inf, sd), abs=1e-6)
    linear.precision[0] = sd**-2
    mean, covariance = linear.solve([0])
    j = linear.columns[:, 0]
    assert covariance[0, 0] == pytest.approx(1.0 / (j @ j + sd**-2))
    assert mean[0] == pytest.approx(covariance[0, 0] * (j @ linear.residual))


def test_a_shift_is_taken_off_the_residual():
    """A column that is taken off as it is scores as a problem without it, up to the change of the sum of squares."""
    linear = problem(9, truth=(0.5, 0.0, 1.0))
    left = linear.residual - linear.columns[:, 2]
    other = Linear(left, linear.columns, linear.labels, linear.block, linear.stream, left, linear.columns)
    change = 0.5 * (linear.residual @ linear.residual - left @ left)
    assert linear.score([0, 1], shift=2) == pytest.approx(other.score([0, 1]) + change, abs=1e-9)
    assert linear.judged([0, 1], shift=2)[1] == pytest.approx(other.solve([0, 1])[0])
