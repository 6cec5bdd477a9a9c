"""Scores against closed forms and brute force; intervals against published values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from glider_jax.errors import DataError
from glider_jax.products import scores


def test_crps_of_a_normal_law():
    """Closed form: s (z (2 F(z) - 1) + 2 f(z) - 1 / sqrt(pi))."""
    members = 3.0 + 2.0 * norm.ppf((np.arange(4000) + 0.5) / 4000)
    for truth in (3.0, 6.0, -4.0):
        z = (truth - 3.0) / 2.0
        exact = 2.0 * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / math.sqrt(math.pi))
        assert scores.crps(members, truth) == pytest.approx(exact, abs=3e-3)


def test_crps_is_fair_and_takes_one_member_as_an_error():
    rng = np.random.default_rng(0)
    few = [scores.crps(rng.standard_normal(4), 0.5) for _ in range(4000)]
    many = scores.crps(rng.standard_normal(200_000), 0.5)
    assert np.mean(few) == pytest.approx(many, abs=0.02)
    assert scores.crps(np.array([2.0, np.nan]), 5.0) == 3.0
    assert math.isnan(scores.crps(np.array([np.nan]), 5.0)) and math.isnan(scores.crps(np.ones(3), math.nan))


def test_energy_score_against_all_pairs():
    rng = np.random.default_rng(1)
    cloud, truth = rng.standard_normal((300, 2)) * [2.0, 0.5], np.array([1.0, -1.0])
    apart = np.hypot(*(cloud[:, None] - cloud[None]).transpose(2, 0, 1)).sum() / (300 * 299)
    exact = np.hypot(*(cloud - truth).T).mean() - 0.5 * apart
    assert scores.energy_score(cloud, truth) == pytest.approx(exact, rel=0.03)
    assert scores.energy_score(cloud[:1], cloud[0]) == 0.0
    line = np.stack([cloud[:, 0], np.zeros(300)], axis=1)
    assert scores.energy_score(line, np.array([1.0, 0.0])) == pytest.approx(
        scores.crps(cloud[:, 0], 1.0), rel=0.05
    )


def test_scores_prefer_the_truth():
    """Proper: the law that the truth comes from scores better on the mean than a shifted, wider or narrower one."""
    rng = np.random.default_rng(2)
    truth = rng.standard_normal((400, 2))
    laws = {"right": (0.0, 1.0), "shifted": (0.7, 1.0), "wide": (0.0, 2.0), "narrow": (0.0, 0.4)}
    base = rng.standard_normal((400, 2))
    found = {k: np.mean([scores.energy_score(m + s * base, t) for t in truth]) for k, (m, s) in laws.items()}
    assert min(found, key=found.get) == "right"


def test_shares_and_intervals():
    assert scores.wilson(0, 10)[0] == 0.0 and scores.wilson(0, 10)[1] == pytest.approx(0.2775, abs=1e-3)
    assert scores.wilson(50, 59) == pytest.approx((0.7343, 0.9178), abs=2e-3)
    with pytest.raises(DataError, match="hits of 0 to 3"):
        scores.wilson(4, 3)
    found = scores.coverage([True, None, False, True])
    assert (found["hits"], found["cases"]) == (2, 3) and found["share"] == pytest.approx(2 / 3)
    below = scores.probability_below(np.array([1.0, 2.0, 2.0, 3.0]), 2.0)
    assert below == 0.5 and scores.within(np.arange(100.0), 97.0, 0.9) is False
    assert (
        scores.within(np.arange(100.0), 50.0, 0.5) is True
        and scores.within(np.array([np.nan]), 1.0, 0.5) is None
    )
    rows = scores.reliability((np.arange(1000) + 0.5) / 1000)
    assert [r["share"] for r in rows] == pytest.approx([0.1, 0.25, 0.5, 0.75, 0.9], abs=2e-3)


def test_skill_has_the_right_sign():
    better = scores.skill(np.array([1.0, 1.0, 2.0]), np.array([2.0, 2.0, 4.0]))
    assert better["skill"] == pytest.approx(0.5) and better["cases"] == 3
    assert scores.skill(np.array([3.0, np.nan]), np.array([2.0, 1.0]))["skill"] == pytest.approx(-0.5)
    table = scores.error_table(np.arange(1.0, 102.0))
    assert table["median"] == 51.0 and table["p90"] == pytest.approx(91.0)
    assert table["median_interval"][0] < 51.0 < table["median_interval"][1]
