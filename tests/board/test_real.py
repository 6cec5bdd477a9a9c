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
    assert pump.identifiable and 6.0 < pump.theta[1] < 12.0
    # The ideal work of 460 cc is 4.6 J per metre; a pump cannot do better.
    assert pump.theta[1] > 4.6
    assert comet.model.estimates[fits.CLIMB].value == pytest.approx(180.0, abs=15.0)


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
