"""Fits that start far from where they rest: a step that goes too far is taken back along itself."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.inference.fit import Problem, converged
from glider_jax.inference.unknowns import Unknown

ROWS = np.linspace(0.2, 3.0, 80)


class White:
    """Independent unit noise on one stream."""

    names, n = ("curve",), ROWS.size

    def whiten(self, columns):
        """As they are."""
        return columns / 0.01, 0.0


class Bending:
    """A stream that answers to one unknown as an arc tangent: a full step from its flat part flies far past."""

    unknowns = (Unknown("x", "x", "calibration", 0.0, 4.0, frozenset({"flight"})),)

    def predict(self, values, shapes=None):
        """The curve, and nothing that is finite beyond an edge."""
        x = values[0]
        return {"curve": np.full(ROWS.size, np.nan) if abs(x) > 30.0 else np.arctan(ROWS * (x - 1.0))}

    def slopes(self, values, shapes, own):
        """The curve and its derivative, per unit of the unknown's scale."""
        u = ROWS * (values[0] - 1.0)
        return self.predict(values), {"curve": (4.0 * ROWS / (1.0 + u * u))[:, None]}


def problem(truth):
    """Data of the curve at a true value, without noise."""
    replay = Bending()
    stream = SimpleNamespace(name="curve", value=replay.predict(np.array([truth]))["curve"], n=ROWS.size)
    gathered = SimpleNamespace(streams=[stream], stream=lambda name: stream)
    return Problem(gathered, replay, [White()], np.zeros(1), {}, {})


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
