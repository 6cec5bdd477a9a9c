"""Fits of effects far from linear: begun afresh where calibrations that stood for the effect would hold them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis import rest
from glider_jax.diagnosis.candidates import Candidate, Variant
from glider_jax.diagnosis.screen import Pick
from glider_jax.inference.fit import Column, Problem
from glider_jax.inference.unknowns import Unknown

N, SD = 60, 0.01
TRUE_LOSS = 0.46
FLIGHT = frozenset({"flight"})


class White:
    """Independent noise on one stream."""

    names, n, open = ("curve",), N, 0.0

    def leave_open(self, sds):
        """Nothing is."""

    def whiten(self, columns, sizes=None):
        """In units of its size."""
        return columns / SD, N * float(np.log(SD))


class Aliased:
    """A third of the rows comes back with the loss, drag can stand for it in another: valleys 0.16 apart."""

    unknowns = (
        Unknown("drag", "drag", "calibration", 0.15, 0.01, FLIGHT),
        Unknown("loss", "loss", "candidate", 0.0, 0.4, FLIGHT, -0.6, 0.9),
        Unknown("other", "other", "candidate", 0.0, 1.0, frozenset({"power"})),
    )

    def foresee(self, values, shapes=None):
        """Predictions, nothing open."""
        drag, loss, other = values
        along = 3.0 * ((drag - 0.15) / 0.01 + 30.0 * loss)
        return {"curve": np.choose(np.arange(N) % 3, [along, np.sin(40.0 * loss), other])}, {}

    def slopes(self, values, shapes, own):
        """With derivatives per prior sd."""
        parts = ([3.0, 0.0, 0.0], [36.0, 16.0 * np.cos(40.0 * values[1]), 0.0], [0.0, 0.0, 1.0])
        columns = [np.choose(np.arange(N) % 3, part) for part in parts]
        return *self.foresee(values)[:1], {"curve": np.stack([columns[k] for k in own], axis=1)}, {}


@pytest.fixture
def problem():
    """Data of the true loss and of drag as the vehicle file says; the fit had let drag stray."""
    replay = Aliased()
    stream = SimpleNamespace(name="curve", n=N, value=replay.foresee(np.array([0.15, TRUE_LOSS, 0.2]))[0]["curve"])
    gathered = SimpleNamespace(streams=[stream], stream=lambda name: stream)
    return Problem(gathered, replay, [White()], np.array([0.20, 0.0, 0.2]), {}, {})


LINEAR = SimpleNamespace(labels=tuple(Column(k, u.name, u.term) for k, u in enumerate(Aliased.unknowns)))


def picked(k, **more):
    """One unknown as an accepted effect."""
    variant = Variant((k,), 0.0, **more)
    return Pick(Candidate(Aliased.unknowns[k].term, (variant,), 0.0), variant, 0.0)


def test_a_fit_that_calibrations_hold_is_begun_afresh(problem):
    """It comes to rest in the true valley, with the other effect, and is worth more there; values stay as they were."""
    before = problem.values.copy()
    near = [picked(1), picked(2)]
    far = [picked(1, start={1: 0.3}, cell=(0.5, np.inf)), picked(2)]
    held, there = rest.rested(problem, LINEAR, [0], near)
    assert rest.strayed(problem, there) > rest.STRAYED
    assert abs(there[1] - TRUE_LOSS) > 0.1
    score, values = rest.rested(problem, LINEAR, [0], far)
    assert values == pytest.approx([0.15, TRUE_LOSS, 0.2], abs=2e-3)
    assert score > held + 1.0 and problem.values == pytest.approx(before)


def test_a_fit_is_begun_as_often_as_calibrations_stray(problem, monkeypatch):
    """Where they are near the vehicle file's numbers, where the fit begins or rests, it is not begun again there."""
    fits, drag = [], [0.16]
    monkeypatch.setattr(rest, "converged", lambda *a: fits.append(a[3].copy()) or (0.0, np.array([drag[0], 0.3, 0.0])))
    afar, near = [picked(1, start={1: 0.3}, cell=(0.5, np.inf))], [picked(1)]
    rest.rested(problem, LINEAR, [0], afar)  # drag has strayed: from the file's number alone
    assert len(fits) == 1 and fits[0] == pytest.approx([0.15, TRUE_LOSS, 0.0], abs=0.02)
    drag[0] = 0.25  # and comes to stray from there: from where it was too
    rest.rested(problem, LINEAR, [0], afar)
    assert len(fits) == 3 and fits[2] == pytest.approx([0.20, 0.3, 0.2])
    rest.rested(problem, LINEAR, [0], near)
    assert len(fits) == 4 and fits[3] == pytest.approx([0.20, 0.0, 0.2])
    problem.values[0] = 0.15
    rest.rested(problem, LINEAR, [0], afar)
    assert len(fits) == 6 and fits[4] == pytest.approx([0.15, 0.3, 0.2]) and fits[5][0] == 0.15
    drag[0] = 0.16
    rest.rested(problem, LINEAR, [0], afar)
    assert len(fits) == 7


def test_only_calibrations_of_the_flight_stray(problem):
    """Half the square of their distance, prior sds."""
    assert rest.calibrations_of_flight(problem) == [0]
    assert rest.strayed(problem, np.array([0.18, 0.9, 5.0])) == pytest.approx(4.5)
