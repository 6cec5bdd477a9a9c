"""Noise laws: whitening, agreement of filter and dense factor, and what taking samples as independent does."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from glider_jax.inference import noise as laws
from glider_jax.inference.controls import calm
from glider_jax.inference.streams import Stream


def stream(n=360, seed=0, white=0.002, offset=0.003, slow=0.003, tau=2e4):
    """A series with group offsets and a slow process, six numbers to a leg."""
    rng = np.random.default_rng(seed)
    time = 40.0 * np.arange(n) + 100.0 * (np.arange(n) // 6)
    group = np.arange(n) // 6
    red = np.zeros(n)
    for k in range(1, n):
        fade = np.exp(-(time[k] - time[k - 1]) / tau)
        red[k] = fade * red[k - 1] + slow * np.sqrt(1 - fade**2) * rng.normal()
    value = white * rng.normal(size=n) + offset * rng.normal(size=group.max() + 1)[group] + red
    one = np.ones(n)
    return Stream("vertical speed", "m s-1", "cm/s", 100.0, value, time, group, group // 10, one, 40.0 * one)


def test_filter_and_dense_factor_agree(monkeypatch):
    """Both ways of whitening give the same numbers."""
    law = laws.SeriesNoise(stream(120))
    columns = np.random.default_rng(1).normal(size=(120, 5))
    dense, half = law.whiten(columns)
    monkeypatch.setattr(laws, "DENSE", 10)
    with jax.enable_x64(True):
        filtered, other = law.whiten(columns)
    assert np.allclose(dense, filtered, atol=1e-6) and half == pytest.approx(other, abs=1e-6)


def test_sizes_are_found():
    """Whitened residuals of a simulated series are unit white noise."""
    one = stream(360, seed=4)
    law = laws.SeriesNoise(one)
    laws.fit_noise(law, one.value, np.zeros((one.n, 0)), rounds=200)
    white, _ = law.whiten(one.value[:, None])
    assert 0.85 < white.std() < 1.15
    assert abs(np.corrcoef(white[1:, 0], white[:-1, 0])[0, 1]) < 0.15
    assert 1e-3 < np.exp(law.sizes[0]) < 4e-3


def test_independent_samples_raise_false_alarms():
    """A column that has nothing to do with the data looks certain when legs are ignored, and not otherwise."""
    alarms = {"independent": 0, "fitted": 0}
    count = 16
    for seed in range(count):
        one = stream(240, seed=100 + seed, white=0.0015, offset=0.004, slow=0.004)
        column = 0.004 * np.cos(2 * np.pi * one.time / 16000.0 + seed)
        law = laws.SeriesNoise(one)
        laws.fit_noise(law, one.value, column[:, None], rounds=80)
        for how in alarms:
            if how == "independent":
                white, _ = law.whiten(np.column_stack([one.value, column]), np.log([one.value.std(), 1e-9, 1e-9, 1e4]))
            else:
                white, _ = law.whiten(np.column_stack([one.value, column]))
            r, j = white.T
            evidence = 0.5 * (j @ r) ** 2 / (1 + j @ j) - 0.5 * np.log(1 + j @ j)
            alarms[how] += evidence > 4.3
    assert alarms["independent"] >= 6
    assert alarms["fitted"] <= 1


def test_noise_in_a_control_is_taken_out_and_signal_kept():
    """White noise about a constant is removed; a real swing from leg to leg is not."""
    rng = np.random.default_rng(2)
    leg = np.arange(2000) // 20
    time = 8.0 * np.arange(2000)
    settled = np.ones(2000, bool)
    block = leg // 20
    noise = 0.006 * rng.normal(size=2000)
    assert calm(time, 0.45 + noise, settled, leg, block).std() < 0.001
    swing = 0.05 * rng.normal(size=100)[leg]
    out = calm(time, 0.45 + swing + noise, settled, leg, block)
    assert np.std(out - 0.45 - swing) < 0.003
    assert np.polyfit(swing, out, 1)[0] == pytest.approx(1.0, abs=0.02)


def test_red_currents_are_shared_by_drift_and_displacement():
    """A constant error of the product is one number to the law, not one per segment."""
    n = 20
    time = 10800.0 * np.arange(n)
    one = np.ones(n)

    def make(name, span):
        return Stream(name, "m s-1", "cm/s", 100.0, 0 * one, time, np.arange(n), np.arange(n), one, span * one)

    moved = (make("displacement east", 1e4), make("displacement north", 1e4))
    drift = (make("surface drift east", 600.0), make("surface drift north", 600.0))
    law = laws.CourseNoise(moved, drift, True)
    steady = np.concatenate([one, 0 * one, one, 0 * one])[:, None] * 0.03
    flips = steady * np.tile((-1.0) ** np.arange(n), 4)[:, None]
    assert (law.whiten(steady)[0] ** 2).sum() < 0.1 * (law.whiten(flips)[0] ** 2).sum()


def quiet(way, n=90, seed=0, common=None, own=0.0, white=0.006, extra=0.0):
    """Quiet power of one phase over three days: a wander that both share, one of its own, white noise and a load."""
    rng = np.random.default_rng([seed, way + 2])
    time = np.sort(rng.uniform(0.0, 3.0 * 86400.0, n))
    shared = 0.0 if common is None else np.interp(time, *common)
    alone = own * np.interp(time, np.linspace(0.0, 3.0 * 86400.0, 20), rng.normal(size=20))
    value = shared + alone + white * rng.normal(size=n) + extra
    one, block = np.ones(n), (time // 10000.0).astype(int)
    return Stream(
        f"hotel power, {'dives' if way < 0 else 'climbs'}", "W", "W", 1.0, value, time, block, block, one, 100.0 * one
    )


def worth(law, column, residual):
    """Nats that a column of unit prior earns, with the sizes of the noise found for either."""
    kept, reached = law.sizes.copy(), []
    for columns in (np.zeros((law.n, 0)), column[:, None]):
        law.sizes = kept.copy()
        reached.append(laws.fit_noise(law, residual, columns, rounds=200))
    law.sizes = kept
    return reached[1] - reached[0]


def test_a_steady_load_on_dives_is_no_wander_of_dives_alone():
    """Loads of dives and climbs wander together, so a small steady difference between them is seen."""
    times = np.linspace(0.0, 3.0 * 86400.0, 30)
    apart, together = [], []
    for seed in range(4):
        common = (times, 0.02 * np.random.default_rng(50 + seed).normal(size=30))
        dives, climbs = quiet(-1, seed=seed, common=common, extra=0.016), quiet(1, seed=seed, common=common)
        single = laws.SeriesNoise(dives)
        apart.append(worth(single, np.full(dives.n, 0.1), dives.value))
        both = laws.LoadNoise(dives, climbs)
        column = np.concatenate([np.full(dives.n, 0.1), np.zeros(climbs.n)])
        together.append(worth(both, column, np.concatenate([dives.value, climbs.value])))
    assert min(together) > 6.0
    assert np.mean(apart) < 2.0


def test_loads_are_whitened_together():
    """Whitening agrees with the stated covariance, with a wander of one phase in that phase alone."""
    dives, climbs = quiet(-1, 20), quiet(1, 15)
    law = laws.LoadNoise(dives, climbs)
    law.sizes = np.log([0.01, 0.02, 0.005, 0.03, 2e4, 0.01])
    unit, half = law.whiten(np.eye(law.n))
    covariance = np.linalg.inv(unit.T @ unit)
    assert half == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1])
    lag = abs(dives.time[0] - dives.time[5])
    same = 0.005**2 * (dives.group[0] == dives.group[5])
    assert covariance[0, 5] == pytest.approx((0.03**2 + 0.01**2) * np.exp(-lag / 2e4) + same)
    lag = abs(dives.time[0] - climbs.time[5])
    same = 0.005**2 * (dives.group[0] == climbs.group[5])
    assert covariance[0, 25] == pytest.approx(0.03**2 * np.exp(-lag / 2e4) + same)
    assert covariance[25, 25] > covariance[0, 0]


def test_rows_that_are_open_say_nothing():
    """A row whose prediction is open by far more than the noise has no weight, and costs its determinant."""
    law = laws.SeriesNoise(stream(120))
    columns = np.random.default_rng(1).normal(size=(120, 3))
    closed, half = law.whiten(columns)
    sds = np.zeros(120)
    sds[60] = 0.5
    law.leave_open({"vertical speed": sds})
    found, more = law.whiten(columns)
    order = np.abs(found[law.order]).max(axis=1) / np.abs(columns[law.order]).max(axis=1)
    assert order[np.flatnonzero(law.order == 60)[0]] < 2.5
    assert np.delete(order, np.flatnonzero(law.order == 60)).min() > 2.5
    assert more - half > np.log(0.5 / 0.01)
    law.leave_open({})
    assert law.whiten(columns)[0] == pytest.approx(closed)


def test_displacements_are_left_open_and_drifts_are_not():
    """What turns leave open of the way is beside the noise of displacements; a drift at the surface knows no turn."""
    pair = tuple(replace(stream(20), name=f"displacement {way}") for way in ("east", "north"))
    drift = tuple(replace(stream(12), name=f"surface drift {way}") for way in ("east", "north"))
    law = laws.CourseNoise(pair, drift, True)
    before = np.diag(law.covariance(law.sizes))
    law.leave_open({"displacement east": np.full(20, 0.3), "displacement north": np.full(20, 0.3)})
    after = np.diag(law.covariance(law.sizes))
    assert after[:20] - before[:20] == pytest.approx(0.09)
    assert after[20:] == pytest.approx(before[20:])
