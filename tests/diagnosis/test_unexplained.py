"""Structure without a name: pump strokes that are set aside, a pitch that stands still, and what is too small."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from glider_jax.diagnosis import unexplained
from glider_jax.diagnosis.locate import sentence
from glider_jax.inference.fit import make_problem
from glider_jax.inference.replay import build_replay
from glider_jax.inference.streams import gather
from glider_jax.inference.windows import Stroke, Window, sort_strokes
from tests.diagnosis.worlds import fly, vehicle


def strokes(energies):
    """Strokes at growing depths whose energies are a line in depth plus what is given."""
    rng = np.random.default_rng(2)
    depths = rng.uniform(20.0, 60.0, len(energies))
    return [
        Stroke(Window(110.0 + 6.0 * z + e + rng.normal(0, 4), 30.0, 14.0, 1.0, 900.0 * k, 4), True, z, 460e-6, k, 283.0)
        for k, (z, e) in enumerate(zip(depths, energies, strict=True))
    ]


def test_strokes_that_cost_twice_are_told_apart():
    """One in ten costs 300 J more: all of them are set aside with their excess, and no other."""
    extra = np.where(np.arange(60) % 10 == 3, 300.0, 0.0)
    found = sort_strokes(strokes(extra))
    assert [s.leg for s, _ in found.odd] == list(np.flatnonzero(extra))
    assert np.allclose([e for _, e in found.odd], 300.0, atol=30.0)
    assert len(found.alike) == 54


def test_ordinary_strokes_are_all_alike():
    """Without an excess nothing is set aside."""
    assert sort_strokes(strokes(np.zeros(60))).odd == []


@pytest.fixture(scope="module")
def quiet():
    """A quiet flight and the problem made of it."""
    recording = fly(0.6)
    with jax.enable_x64(True):
        gathered = gather(recording, vehicle())
        return recording, make_problem(gathered, build_replay(gathered, vehicle()))


def test_a_pitch_that_stands_still_is_said(quiet):
    """Two windows of twenty minutes without a change are found with their length; a live sensor is not."""
    recording, problem = quiet
    assert unexplained.stuck(problem, recording) is None
    pitch = recording.channels["pitch"]
    live = pitch.copy()
    try:
        for begin in (900, 3000):
            pitch[begin : begin + 150] = pitch[begin]
        found = unexplained.stuck(problem, recording)
    finally:
        pitch[:] = live
    assert found.place.z == 2 and found.place.size == pytest.approx(2 * 149 * 8 / 60.0, rel=0.05)
    assert sentence(found.place).startswith("The pitch stands still for 40 min in all, 2 times")


def test_a_shift_within_one_numbers_scatter_is_not_worth_a_word(quiet):
    """Turning depths count from half a metre on, vertical speed from six tenths of a millimetre a second."""
    _, problem = quiet
    assert unexplained.least(problem, "vertical speed") == pytest.approx(0.06)
    if problem.gathered.stream("turn depth") is not None:
        assert unexplained.least(problem, "turn depth") >= 0.5
