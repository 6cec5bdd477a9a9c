"""Energy of real gliders: comet in 40 m and a deep glider in 750 m."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.board import fits
from glider_jax.board.analysis import analyse_recordings
from glider_jax.board.events import AT_SURFACE, CLIMB_TO_DIVE, DIVE_TO_CLIMB
from glider_jax.readers.recordings import read_recording


@pytest.fixture(scope="module")
def comet(real):
    return analyse_recordings([read_recording([real("recordings", "comet2019", "comet2019.nc")])])


@pytest.fixture(scope="module")
def deep(real):
    return analyse_recordings([read_recording([real("recordings", "osu684_2025", "osu684_2025.nc")])])


def of(analysis, direction):
    return [e for e in analysis.events if e.direction == direction]


def test_comet_has_58_strokes_each_way(comet):
    out = of(comet, DIVE_TO_CLIMB)
    assert len(out) == len(of(comet, CLIMB_TO_DIVE)) == 58
    assert 29.0 < min(e.depth for e in out) and max(e.depth for e in out) < 42.0
    assert np.mean([e.volume for e in out]) == pytest.approx(460e-6, rel=0.01)


def test_comet_pump_energy(comet):
    # 210 J + 5.65 J/dbar, as published for these strokes, is 420 J at their mean pressure of 37 dbar.
    pump = comet.model.pump
    middle = np.mean([e.depth for e in of(comet, DIVE_TO_CLIMB)])
    assert pump.predict(middle) == pytest.approx(420.0, abs=15.0)
    assert pump.interval(middle) < 10.0
    assert pump.identifiable and pump.theta[1] == pytest.approx(9.28, abs=0.1)
    # The ideal work of 460 cc is 4.6 J per metre; a pump cannot do better.
    assert pump.theta[1] > 4.6
    assert comet.model.estimates[fits.CLIMB].value == pytest.approx(180.0, abs=15.0)


def pooled_definition(record, volume_sign):
    """The definition behind the published line: energy, mean depth and file of each stroke.

    Counter from the cycle before the flag to two after it, less the median current of all quiet cycles of both flights.
    """
    from glider_jax.board.events import _stroke_runs

    runs = _stroke_runs(record)
    quiet = np.ones(record.time.size, dtype=bool)
    for begin, end in runs:
        quiet[max(begin - 1, 0) : end + 4] = False
    hotel = np.median(record.current[quiet & (record.depth > 3.0)])
    rows = []
    for begin, end in runs:
        first, last = begin - 1, end + 1
        if volume_sign * (record.volume[last] - record.volume[first]) < 2e-4:
            continue
        charge = record.charge[last] - record.charge[first] - hotel * (record.time[last] - record.time[first])
        depth = record.depth[begin : end + 1].mean()
        rows.append((charge * record.voltage[begin : end + 2].mean(), depth, record.segment[begin]))
    return np.array(rows).T


def straight_line(depth, energy):
    """Least squares with the 1-sigma of both numbers and the error of leaving one out."""
    design = np.stack([np.ones_like(depth), depth], axis=1)
    normal = np.linalg.inv(design.T @ design)
    theta = normal @ design.T @ energy
    residual = energy - design @ theta
    sigma = np.sqrt(np.diag(normal) * (residual @ residual) / (depth.size - 2))
    leverage = np.einsum("ij,jk,ik->i", design, normal, design)
    return theta, sigma, np.sqrt(np.mean((residual / (1.0 - leverage)) ** 2))


def test_comet_gives_the_published_line_by_the_published_definition(comet):
    energy, depth, _ = pooled_definition(comet.glider, 1.0)
    theta, sigma, held_out = straight_line(1.007 * depth, energy)
    assert energy.size == 58
    assert theta == pytest.approx([210.0, 5.65], abs=5.0) and theta[1] == pytest.approx(5.65, abs=0.15)
    assert sigma[0] == pytest.approx(46.0, abs=2.0) and sigma[1] == pytest.approx(1.25, abs=0.05)
    back, _, _ = pooled_definition(comet.glider, -1.0)
    assert back.mean() == pytest.approx(187.0, abs=2.0) and back.std(ddof=1) == pytest.approx(47.0, abs=1.0)
    # Ours predicts single strokes better, and scatters half as much from climb to dive.
    own = np.array([e.energy for e in of(comet, DIVE_TO_CLIMB)])
    at = np.array([e.depth for e in of(comet, DIVE_TO_CLIMB)])
    assert straight_line(at, own)[2] < 0.75 * held_out
    assert np.std([e.energy for e in of(comet, CLIMB_TO_DIVE)]) < 0.6 * back.std()


def test_comet_two_flights_agree_by_our_definition_and_not_by_the_pooled_one(comet):
    energy, depth, segment = pooled_definition(comet.glider, 1.0)
    strokes = of(comet, DIVE_TO_CLIMB)
    first = segment == segment.min()
    for values, places, low, high in (
        (energy, depth, 15.0, 40.0),
        (np.array([e.energy for e in strokes]), np.array([e.depth for e in strokes]), -10.0, 10.0),
    ):
        design = np.stack([np.ones(58), places, first], axis=1)
        offset = np.linalg.lstsq(design, values, rcond=None)[0][2]
        assert low < offset < high


def test_comet_steady_load(comet):
    levels = {level.phase: level for level in comet.model.levels if not level.state}
    assert levels["submerged"].floor == pytest.approx(1.4, abs=0.15)
    assert levels["submerged"].mean == pytest.approx(2.6, abs=0.8)
    assert levels["surface"].mean > levels["submerged"].mean


def test_comet_current_agrees_with_the_counter(comet):
    assert abs(comet.counter[0]) < 0.004


def test_deep_glider(deep):
    out, top = of(deep, DIVE_TO_CLIMB), of(deep, AT_SURFACE)
    assert len(out) == len(top) == 8
    assert all(750.0 < e.depth < 751.0 for e in out) and all(e.depth < 3.0 for e in top)
    energy = np.array([e.energy for e in out])
    # 5.8 A at 14.2 V for 104 s; firmware's pressure times volume would be 3.6 kJ.
    assert energy.mean() == pytest.approx(8400.0, rel=0.02) and energy.std() < 0.02 * energy.mean()
    assert deep.model.pump.form == "volume"
    assert any("two depths cannot test" in w for w in deep.model.warnings)
    assert abs(deep.counter[0]) < 0.004


def test_deep_glider_sensors_off_on_the_dive(deep):
    levels = {level.phase: level for level in deep.model.levels if not level.state}
    assert levels["climb"].mean > 2 * levels["dive"].mean
