"""The bundled recording of 2016: an independent fit finds the pitch scale that its author had to correct.

Glider comet, Baltic Sea; published correction: pitch = 0.86 m_pitch - 0.004 rad, C_D0 near 0.15.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import glider_jax_data
from glider_jax.diagnosis.proof.strength import steady
from glider_jax.diagnosis.proof.truth import GRAVITY
from glider_jax.readers.recordings import read_recording

VOLUME, AREA, LIFT, INDUCED, COMPRESSIBILITY = 70.0 / 1004.0, 0.1, 7.53, 10.5, 5e-10
SD_RISE, SD_SPEED = 0.009, 0.012
CORRUPT = 34  # a half dive whose profiler series ends in zeros


@pytest.fixture(scope="module")
def samples():
    r = read_recording(glider_jax_data.path("gliderflight/comet2016.nc"))
    time, depth = r.time, r["depth"]
    rise = np.full(time.size, np.nan)
    low, high = np.searchsorted(time, time - 8), np.searchsorted(time, time + 8, "right")
    for k in range(time.size):
        t, z = time[low[k] : high[k]] - time[k], depth[low[k] : high[k]]
        if t.size > 6:
            rise[k] = -np.sum((t - t.mean()) * z) / np.sum((t - t.mean()) ** 2)
    sign = np.sign(np.convolve(np.gradient(depth, time), np.ones(31) / 31, "same"))
    edges = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1, [time.size]])
    half, count = np.full(time.size, -1), 0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        if np.ptp(depth[a:b]) > 15:
            half[a:b] = count
            count += 1
    assert count == 36
    use = (half >= 0) & (r["pressure"] > 1e5) & (r["pressure"] < 3.5e5) & np.isfinite(rise)
    use &= np.abs(np.abs(r["pumped_volume"]) - 231e-6) < 5e-6
    index = np.flatnonzero(use)[::4]
    names = ("pressure", "pitch", "pumped_volume", "water_density", "measured_speed")
    return {n: r[n][index] for n in names} | {"rise": rise[index], "half": half[index]}


def model(p, s, use, pitch):
    mass, drag, gain = p[0], p[1], p[2] if len(p) > 2 else 0.0
    rho = s["water_density"][use]
    volume = VOLUME * (1.0 - COMPRESSIBILITY * s["pressure"][use]) + s["pumped_volume"][use]
    theta = pitch[use] * (1.0 + gain)
    push = GRAVITY * (rho * volume - mass)
    rise, along = steady(push, theta, rho, np.full(rho.size, drag), INDUCED, LIFT, AREA)
    return rise, np.hypot(rise, along)


def fit(s, use, parameters, speed=True, pitch=None):
    pitch = s["pitch"] if pitch is None else pitch
    seen = s["measured_speed"][use]

    def residual(p):
        rise, through = model(p, s, use, pitch)
        parts = [(rise - s["rise"][use]) / SD_RISE]
        if speed:
            parts.append(((through - seen) / SD_SPEED)[np.isfinite(seen)])
        return np.concatenate(parts)

    start = [s["water_density"].mean() * VOLUME, 0.15, 0.0][:parameters]
    return least_squares(residual, start, x_scale=[0.02, 0.02, 0.05][:parameters]).x


def rms(s, use, p, pitch=None):
    rise, through = model(p, s, use, s["pitch"] if pitch is None else pitch)
    off = through - s["measured_speed"][use]
    return np.sqrt(np.mean((rise - s["rise"][use]) ** 2)), np.sqrt(np.nanmean(off**2)), np.nanmean(off)


def test_vertical_speed_alone_hides_the_pitch_scale_in_the_drag(samples):
    train = samples["half"] < 18
    test = (samples["half"] >= 18) & (samples["half"] != CORRUPT)
    p = fit(samples, train, 2, speed=False)
    assert p[1] == pytest.approx(0.234, abs=0.004)
    rise, speed, bias = rms(samples, test, p)
    assert rise < 0.009 and bias == pytest.approx(-0.040, abs=0.004)


def test_measured_speed_tells_pitch_scale_from_drag(samples):
    train = samples["half"] < 18
    test = (samples["half"] >= 18) & (samples["half"] != CORRUPT)
    without, found = fit(samples, train, 2), fit(samples, train, 3)
    assert found[2] == pytest.approx(-0.126, abs=0.005)
    assert found[1] == pytest.approx(0.157, abs=0.004)
    before, after = rms(samples, test, without), rms(samples, test, found)
    assert after[0] < 0.6 * before[0] and after[1] < 0.7 * before[1]
    published = samples["pitch"] * 0.86 - 0.004
    best = rms(samples, test, fit(samples, train, 2, pitch=published), published)
    assert after[1] == pytest.approx(best[1], abs=0.0005)


def test_the_other_half_finds_the_same_without_its_corrupt_dive(samples):
    late = (samples["half"] >= 18) & (samples["half"] != CORRUPT)
    assert fit(samples, late, 3)[2] == pytest.approx(-0.126, abs=0.005)
    spoilt = fit(samples, samples["half"] >= 18, 3)[2]
    assert abs(spoilt + 0.126) > 0.01
    good = samples["half"] != CORRUPT
    corrected = fit(samples, good, 3, pitch=samples["pitch"] * 0.86 - 0.004)[2]
    assert abs(corrected) < 0.02
