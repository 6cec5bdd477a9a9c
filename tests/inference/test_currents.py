"""Currents from the glider's own history: closed forms, a tide that must be found, honest spread, shear, products."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.inference import currents
from glider_jax.inference.behaviour import learn
from glider_jax.inference.currents import (
    SEMIDIURNAL,
    drifted,
    estimate_currents,
    felt,
    inertial_frequency,
    observations,
    observe,
)
from tests.inference.test_behaviour import segment

HOUR = 3600.0


def tide(time, amplitude=0.3, phase=0.4, mean=0.05):
    """A rotary semidiurnal tide on a mean current, (2, n)."""
    return np.stack(
        [
            mean + amplitude * np.cos(SEMIDIURNAL * time + phase),
            0.6 * amplitude * np.sin(SEMIDIURNAL * time + phase),
        ]
    )


def tide_average(begin, end, amplitude=0.3, phase=0.4, mean=0.05):
    """The exact mean of :func:`tide` over an interval: the middle's value times sin(x)/x."""
    half = 0.5 * SEMIDIURNAL * (end - begin)
    middle = tide(np.array([0.5 * (begin + end)]), amplitude, phase, 0.0)[:, 0]
    return middle * np.sin(half) / half + np.array([mean, 0.0])


def dives(hours, every=3.0, length=2.5, average=tide_average):
    rows = []
    for begin in np.arange(0.0, hours, every) * HOUR:
        east, north = average(begin, begin + length * HOUR)
        rows.append(felt(begin, begin + length * HOUR, east, north))
    return rows


def test_averages_over_a_dive_carry_the_sinc_factor():
    averages = currents._Averages.of(observations([felt(0.0, 5.0 * HOUR, 0.0, 0.0)]))
    mean = averages.average(tide)[:, 0]
    np.testing.assert_allclose(mean, tide_average(0.0, 5.0 * HOUR), atol=1e-6)
    assert abs(mean[0] - tide(np.array([2.5 * HOUR]))[0, 0]) > 0.005


def test_a_tide_is_predicted_with_its_phase():
    seen = observations(dives(72.0))
    time = 72.0 * HOUR + np.arange(0.0, 12.0, 0.5) * HOUR
    estimate = estimate_currents(seen, 45.0, time)
    miss = np.hypot(*(estimate.mean - tide(time)))
    last = np.hypot(*(np.array(tide_average(69.0 * HOUR, 71.5 * HOUR))[:, None] - tide(time)))
    assert np.sqrt(np.mean(miss**2)) < 0.03
    assert np.sqrt(np.mean(last**2)) > 0.2
    assert estimate.strengths["semidiurnal"] > 1.5 * estimate.strengths["rest"]


def test_without_history_the_spread_is_the_prior():
    estimate = estimate_currents(observations([]), 45.0, np.array([0.0, 1e6]))
    variance = (
        currents._MEAN_SD**2
        + np.mean(np.square(currents._SEMIDIURNAL_SD))
        + np.mean(np.square(currents._DAILY_SD))
        + np.mean(np.square(currents._REST_SD))
    )
    np.testing.assert_allclose(estimate.mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(estimate.sd**2, variance, rtol=1e-9)
    assert estimate.observations == 0 and np.isnan(estimate.last)


def test_what_is_known_fades_with_lead():
    seen = observations([felt(-2.0 * HOUR, 0.0, 0.2, -0.1)])
    time = np.array([0.1, 6.0, 24.0, 24.0 * 60]) * HOUR
    estimate = estimate_currents(seen, 30.0, time)
    assert estimate.sd[0] < 0.1 < estimate.sd[1] < estimate.sd[3]
    assert 0.1 < estimate.mean[0, 0] <= 0.2 and -0.1 <= estimate.mean[1, 0] < -0.05
    assert abs(estimate.mean[0, 3]) < 0.5 * estimate.mean[0, 0]


def test_intervals_hold_what_they_promise():
    """Truths drawn from the model's own parts, over many worlds: 90 % of them lie within 90 % intervals."""
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(120):
        sd = (
            rng.choice(currents._SEMIDIURNAL_SD),
            rng.choice(currents._DAILY_SD),
            rng.choice(currents._REST_SD),
        )
        begin = np.arange(8) * 3.0 * HOUR
        fine = np.concatenate(
            [(begin[:, None] + np.linspace(0, 2.4 * HOUR, 7)).ravel(), [8 * 3.0 * HOUR + 3 * HOUR]]
        )
        lag = np.abs(np.subtract.outer(fine, fine))
        covariance = (
            currents._MEAN_SD**2
            + sd[0] ** 2 * np.cos(SEMIDIURNAL * lag) * np.exp(-lag / currents._TIDAL_MEMORY)
            + sd[1] ** 2 * np.cos(inertial_frequency(40.0) * lag) * np.exp(-lag / currents._INERTIAL_MEMORY)
            + sd[2] ** 2 * np.exp(-lag / (15.0 * HOUR))
        )
        root = np.linalg.cholesky(covariance + 1e-10 * np.eye(fine.size))
        values = root @ rng.standard_normal((fine.size, 2))
        mean = values[:-1].reshape(8, 7, 2).mean(axis=1) + 0.015 * rng.standard_normal((8, 2))
        seen = observations([felt(b, b + 2.4 * HOUR, *m) for b, m in zip(begin, mean, strict=True)])
        estimate = estimate_currents(seen, 40.0, fine[-1:])
        drawn, _ = estimate.sample(400, rng)
        low, high = np.quantile(drawn[:, :, 0], [0.05, 0.95], axis=0)
        inside += list((values[-1] > low) & (values[-1] < high))
    assert 0.84 < np.mean(inside) < 0.96


def test_samples_have_the_stated_mean_and_spread():
    estimate = estimate_currents(observations(dives(24.0)), 45.0, 24.0 * HOUR + np.arange(3) * HOUR)
    drawn, shear = estimate.sample(20_000, np.random.default_rng(1))
    np.testing.assert_allclose(
        drawn.mean(axis=0), estimate.mean, atol=4 * estimate.sd.max() / np.sqrt(20_000)
    )
    np.testing.assert_allclose(drawn.std(axis=0).mean(axis=0), estimate.sd, rtol=0.08)
    assert shear.shape == (20_000, 2, 3)


def test_a_lasting_shear_lets_drifts_tell_the_current():
    """Drifts run 0.2 m/s faster than the depth average; a new drift moves the estimate by what is not shear."""
    rows = []
    for k in range(10):
        begin = 3.0 * k * HOUR
        rows += [felt(begin, begin + 2.5 * HOUR, 0.05, 0.0), drifted(begin - 300.0, 0.25, 0.0)]
    now = 30.0 * HOUR
    base = estimate_currents(observations(rows), 45.0, np.array([now]))
    faster = estimate_currents(observations([*rows, drifted(now - 300.0, 0.45, 0.0)]), 45.0, np.array([now]))
    assert abs(base.mean[0, 0] - 0.05) < 0.02
    assert abs(base.surface_mean[0, 0] - 0.2) < 0.08
    assert base.mean[0, 0] < faster.mean[0, 0] < 0.25


def test_a_good_product_is_believed_and_a_bad_one_is_not():
    seen = observations(dives(30.0))
    time = 30.0 * HOUR + np.arange(12) * HOUR
    alone = estimate_currents(seen, 45.0, time)
    good = estimate_currents(seen, 45.0, time, product=tide)
    bad = estimate_currents(seen, 45.0, time, product=lambda t: -2.0 * tide(t))
    assert good.product_weight > 0.9 and bad.product_weight < 0.05
    miss = [np.hypot(*(e.mean - tide(time))).mean() for e in (good, alone, bad)]
    assert miss[0] < 0.01 < miss[1] and miss[2] < 1.5 * miss[1] + 0.01


def test_without_any_current_the_ground_is_what_goes_on():
    """Fixes alone: the way over the ground persists as way through the water, the current adds what may change."""
    nothing = dict(
        water_east=np.nan, water_north=np.nan, current_east=np.nan, current_north=np.nan,
        glider_current_east=np.nan, glider_current_north=np.nan, dead_reckoning="none", path_length=np.nan,
    )  # fmt: skip
    segments = [segment(2.5 * HOUR * k, water=(1000.0, 500.0), **nothing) for k in range(5)]
    seen = observe(segments)
    assert seen.size == 5 and not seen.east.any() and np.all(seen.sd == currents._UNKNOWN_SD)
    estimate = estimate_currents(seen, 40.0, np.array([13.0 * HOUR]))
    assert abs(estimate.mean).max() < 0.01 and 0.02 < estimate.sd[0] < 0.15
    known = learn(segments, [], (np.empty(0),) * 3)
    assert np.exp(known.speed.centre) == pytest.approx(np.hypot(1000.0, 500.0) / (2 * HOUR), rel=1e-6)
    assert known.held_heading == pytest.approx(np.arctan2(1000.0, 500.0))


def test_own_averages_are_preferred_to_the_gliders():
    one = segment(0.0, current=(0.1, 0.0), glider_current_east=0.3, drift_east=0.2, drift_north=0.0)
    seen = observe([one])
    assert seen.east.tolist() == [0.1, 0.2] and seen.surface.tolist() == [False, True]
    other = segment(0.0, current_east=np.nan, glider_current_east=0.3, gap=True)
    assert observe([other]).east[0] == 0.3 and observe([other]).sd[0] == pytest.approx(2.0 * seen.sd[0])


def test_observations_must_be_measured():
    with pytest.raises(DataError, match="expected finite observations"):
        observations([felt(0.0, HOUR, np.nan, 0.0)])
    with pytest.raises(DataError, match="ends after their beginnings"):
        observations([(10.0, 5.0, 0.1, 0.1, 0.02, False)])
