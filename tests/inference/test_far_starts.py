"""Fits that start far from where they rest: a step that goes too far is taken back along itself, or made stiffer."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.inference.fit import Problem, converged, nearest
from glider_jax.inference.unknowns import Unknown

ROWS = np.linspace(0.2, 3.0, 80)


class White:
    """Independent noise on one stream, and what its rows are open by."""

    names, n, open = ("curve",), ROWS.size, 0.0

    def leave_open(self, sds):
        """Take it over."""
        self.open = sds.get("curve", 0.0)

    def whiten(self, columns):
        """As they are."""
        sd = np.sqrt(0.01**2 + self.open**2) * np.ones(ROWS.size)
        return columns / sd[:, None], float(np.log(sd).sum())


class Bending:
    """A stream that answers to one unknown as an arc tangent: a full step from its flat part flies far past."""

    unknowns = (Unknown("x", "x", "calibration", 0.0, 4.0, frozenset({"flight"})),)

    def foresee(self, values, shapes=None):
        """The curve, of which nothing is open, and nothing that is finite beyond an edge."""
        x = values[0]
        return {"curve": np.full(ROWS.size, np.nan) if abs(x) > 30.0 else np.arctan(ROWS * (x - 1.0))}, {}

    def slopes(self, values, shapes, own):
        """The curve and its derivative, per unit of the unknown's scale."""
        u = ROWS * (values[0] - 1.0)
        found, loose = self.foresee(values)
        return found, {"curve": (4.0 * ROWS / (1.0 + u * u))[:, None]}, loose


class Valley:
    """Two unknowns in a valley that bends: how far along it is seen far worse than how far beside it."""

    unknowns = tuple(Unknown(x, x, "calibration", 0.0, 4.0, frozenset({"flight"})) for x in "xy")

    def foresee(self, values, shapes=None):
        """Half of the rows tell the way along, the others the way beside."""
        x, y = values
        return {"curve": np.where(np.arange(ROWS.size) % 2, 0.3 * x, 2.0 * (y - x * x))}, {}

    def slopes(self, values, shapes, own):
        """With derivatives by both."""
        odd = np.arange(ROWS.size) % 2
        by_x, by_y = np.where(odd, 0.3, -4.0 * values[0]), np.where(odd, 0.0, 2.0)
        found, loose = self.foresee(values)
        return found, {"curve": 4.0 * np.stack([by_x, by_y], axis=1)}, loose


class Opening(Bending):
    """Rows that say something else below zero, where they are open by as much."""

    def foresee(self, values, shapes=None):
        """The curve, and by how much it is open."""
        found, _ = super().foresee(values)
        return found, {"curve": np.full(ROWS.size, 5.0 if values[0] < 0.0 else 0.0)}


def problem(truth, replay=None):
    """Data of the curve at true values, without noise."""
    replay, truth = replay or Bending(), np.atleast_1d(truth)
    stream = SimpleNamespace(name="curve", value=replay.foresee(truth)[0]["curve"], n=ROWS.size)
    gathered = SimpleNamespace(streams=[stream], stream=lambda name: stream)
    return Problem(gathered, replay, [White()], np.zeros(truth.size), {}, {})


@pytest.mark.parametrize("start", [1.0, 3.0, 4.0, 6.0, 12.0])
def test_a_fit_rests_where_the_data_are_from_any_start(start):
    """Where Gauss and Newton alone would swing further out with every step, or leave what can be predicted."""
    score, values = converged(problem(1.3), [0], {}, np.array([start]), {})
    assert values[0] == pytest.approx(1.3, abs=2e-3)
    near, _ = converged(problem(1.3), [0], {}, np.array([1.3]), {})
    assert score == pytest.approx(near, abs=0.6)


def test_a_start_that_cannot_be_predicted_gives_no_evidence():
    """It stays where it is and says so, rather than fail."""
    score, values = converged(problem(1.3), [0], {}, np.array([40.0]), {})
    assert score == -np.inf and values[0] == 40.0


def test_a_valley_that_bends_is_followed_to_its_end():
    """No part of a full step leads down there, a stiff one does."""
    score, values = converged(problem([1.5, 2.25], Valley()), [0, 1], {}, np.array([0.5, 0.25]), {})
    assert values == pytest.approx([1.5, 2.25], abs=0.05)
    there, _ = converged(problem([1.5, 2.25], Valley()), [0, 1], {}, np.array([1.5, 2.25]), {})
    assert score == pytest.approx(there, abs=1.0)


def test_rows_that_are_open_explain_no_better():
    """Rows that anything explains cost their determinant, so that no fit gains by leaving them open."""
    one = problem(1.3, Opening())
    near, values = converged(one, [0], {}, np.array([1.3]), {})
    assert values[0] == pytest.approx(1.3, abs=2e-3)
    far, values = converged(one, [0], {}, np.array([-6.0]), {})
    assert values[0] == pytest.approx(1.3, abs=2e-3) or far < near - 50.0
    assert isinstance(one.noises[0].open, float) and one.noises[0].open == 0.0


class Waves(Bending):
    """A stream that comes back with the unknown, and drifts with it: valleys beside the deepest, three units apart."""

    def foresee(self, values, shapes=None):
        """What comes back, and what drifts."""
        x = values[0]
        return {"curve": np.where(np.arange(ROWS.size) % 2, np.sin(2.0 * x), 0.5 * x)}, {"curve": np.zeros(ROWS.size)}


@pytest.mark.parametrize("truth", (-2.4, 0.3, 3.7))
def test_the_deepest_of_many_valleys_is_found(truth):
    """To what the finer steps tell, between the ends, and the noise is left as it was."""
    one = problem(truth, Waves())
    one.noises[0].open = 0.5
    assert nearest(one, 0, (-4.0, 4.0), np.zeros(1), {})[0] == pytest.approx(truth, abs=8.0 / 132.0)
    assert nearest(one, 0, (truth + 0.2, 9.0), np.zeros(1), {})[0] > truth
    assert one.noises[0].open == 0.5


def test_what_cannot_be_predicted_is_not_the_nearest():
    """It counts as infinitely far."""
    assert nearest(problem(1.3), 0, (1.0, 40.0), np.zeros(1), {})[0] < 4.3
