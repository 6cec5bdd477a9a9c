"""Effects that a strayed calibration stands for: when they are looked at again, and what is accepted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis.candidates import Candidate, Variant, widened
from glider_jax.diagnosis.run import _Settled
from glider_jax.diagnosis.screen import ACCEPT, Pick, Search

SIGMA = 0.75


class Bent(Search):
    """A search over one effect and one calibration, whose evidence at rest and under its own noise is given."""

    def __init__(self, strays: float, early: float, rested: float, asked: float):
        unknown = lambda kind, groups: SimpleNamespace(kind=kind, groups=frozenset(groups))  # noqa: E731
        unknowns = (
            unknown("calibration", {"flight"}), unknown("candidate", {"flight"}), unknown("candidate", {"power"}),
        )  # fmt: skip
        self.problem = SimpleNamespace(
            replay=SimpleNamespace(unknowns=unknowns), values=np.array([7.5 + SIGMA * strays, 0.0, 0.0]), shapes={},
            centres=lambda: np.array([7.5, 0.0, 0.0]), scales=lambda: np.array([SIGMA, 0.4, 1.0]),
        )  # fmt: skip
        labels = [SimpleNamespace(unknown=i) for i in range(3)]
        self.linear = SimpleNamespace(labels=labels, score=lambda active: 0.0)
        self.candidates = [
            Candidate("flight.drag_bias", widened((Variant((1,), 0.0),)), 0.0),
            Candidate("energy.hotel_bias", widened((Variant((2,), 0.0),)), 0.0),
        ]
        self.fixed, self.base, self.picks, self.path = [0], 0.0, [], []
        self.early = {"flight.drag_bias": early, "energy.hotel_bias": 99.0}
        self.rested, self.own, self.begun = rested, asked, []

    def pick(self, candidate, active, base):
        return Pick(candidate, candidate.variants[0], 0.0)

    def _converged(self, picks):
        """The effect is found from the vehicle file's own numbers alone; where the calibration strayed it is not."""
        self.begun.append(float(self.problem.values[0]))
        there = 0.2 if picks and abs(self.problem.values[0] - 7.5) < 0.1 else 0.0
        return (self.rested if there else 0.0), np.array([7.5, there, 0.0])

    def _asked(self):
        return self.own if self.picks else 0.0

    def relinearise(self, harden=0, learn_noise=True):
        self.linear = SimpleNamespace(labels=self.linear.labels, score=lambda active: 1.0)


def test_what_a_calibration_stood_for_is_accepted_at_its_own_rest():
    """The fit goes on from where the effect rests, with its evidence there, not where the calibration had strayed."""
    search = Bent(strays=-3.8, early=14.0, rested=9.0, asked=9.0)
    assert search._unbend([0])
    assert [pick.candidate.id for pick in search.picks] == ["flight.drag_bias"]
    assert search.picks[0].evidence == pytest.approx(9.0 - np.log(3.0))
    assert search.problem.values == pytest.approx([7.5, 0.2, 0.0])
    assert search.path == ["accepted flight.drag_bias at rest (7.9 nats)"]


def test_calibrations_near_the_vehicle_file_ask_for_nothing():
    """Less than a name would cost is no stray: nothing is fitted."""
    near = 0.99 * np.sqrt(2.0 * ACCEPT)
    for strays in (near, -near):
        search = Bent(strays=strays, early=14.0, rested=9.0, asked=9.0)
        assert not search._unbend([0]) and not search.begun


@pytest.mark.parametrize(("early", "rested", "asked"), ((4.0, 9.0, 9.0), (14.0, 4.0, 9.0), (14.0, 9.0, 4.0)))
def test_an_effect_has_to_be_worth_a_name_everywhere(early, rested, asked):
    """At the vehicle file's numbers, at rest, and against the noise its absence asks for; else all is as it was."""
    search = Bent(strays=3.8, early=early, rested=rested, asked=asked)
    before, values = search.linear, search.problem.values.copy()
    assert not search._unbend([0])
    assert not search.picks and search.linear is before
    assert search.problem.values == pytest.approx(values)


def test_what_was_refused_is_not_looked_at_again():
    """A refusal is told once, and costs nothing the next time."""
    search = Bent(strays=3.8, early=14.0, rested=9.0, asked=4.0)
    assert not search._unbend([0])
    assert search.path == ["refused flight.drag_bias at rest: larger noise explains as much (2.9 nats)"]
    search.begun.clear()
    assert not search._unbend([0]) and not search.begun and len(search.path) == 1


class Going(Bent):
    """A search of two effects in the flight whose gains are given, and which never swaps."""

    def __init__(self, gains):
        super().__init__(strays=0.0, early=0.0, rested=0.0, asked=0.0)
        self.candidates = [
            Candidate(id, widened((Variant((1 + n,), 0.0),)), 0.0) for n, id in enumerate(gains)
        ]
        self.gains, self.progress = gains, lambda text: None
        self.linear.precision = np.ones(3)

    def _gain(self, candidate, active, base):
        return self.gains[candidate.id], candidate.variants[0]

    def _worth(self, k):
        return 99.0

    def alternatives(self, k):
        return [(id, -99.0) for id in self.gains if id != self.picks[k].candidate.id]

    def _swap(self, k, id):
        raise AssertionError(id)

    def refine(self):
        """Nothing to refine."""

    def relinearise(self, harden=0, learn_noise=True):
        """Nothing moves."""


def test_what_was_taken_back_is_not_accepted_again():
    """Its place is taken by the next best name, whatever either was worth, and that is not swapped for it."""
    search = Going({"flight.lift_loss": 90.0, "flight.drag_bias": 40.0})
    search.path = ["took back flight.lift_loss: held-out dives fit worse with it"]
    search.go_on()
    assert [pick.candidate.id for pick in search.picks] == ["flight.drag_bias"]


class Afar(Going):
    """The same, one of which was looked at away from zero, with evidence where fits come to rest."""

    def __init__(self, rested):
        super().__init__({"flight.drag_bias": 40.0, "flight.lift_loss": 30.0})
        self.far, self.fits = rested, []
        one = self.candidates[1]
        self.candidates[1] = Candidate(one.id, tuple(replace(v, shift=0) for v in one.variants), 0.0)

    def _rest(self, picks):
        self.fits.append([pick.candidate.id for pick in picks])
        return self.far.get(picks[-1].candidate.id, 0.0)


def test_an_effect_far_from_linear_is_judged_where_it_comes_to_rest():
    """The linear problem tells little of it: it goes before the best one where its fit is better, and only there."""
    for first in ("flight.lift_loss", "flight.drag_bias"):
        search = Afar({first: 50.0})
        assert search._move()
        assert [pick.candidate.id for pick in search.picks] == [first]
        assert ["flight.lift_loss"] in search.fits


def test_effects_near_linear_cost_no_fit():
    """Nor does one that was looked at from afar and is not worth a name."""
    search = Afar({})
    search.gains["flight.lift_loss"] = 4.0
    assert search._move() and not search.fits


def accepted(id, rested):
    """The same with one of the two accepted, both of them worth a name before that."""
    search = Afar(rested)
    search.early = {"flight.drag_bias": 21.0, "flight.lift_loss": 18.0}
    search.firsts = {}
    search.problem.replay.unknowns[2].groups = frozenset({"flight"})
    candidate = next(c for c in search.candidates if c.id == id)
    search.picks = [Pick(candidate, candidate.variants[0], 20.0)]
    return search


@pytest.mark.parametrize("named", ("flight.lift_loss", "flight.drag_bias"))
def test_what_cannot_be_told_apart_at_rest_is_stated(named):
    """Where either is far from linear, whatever the linear problem says of them, and no further behind than that."""
    other = {"flight.lift_loss": "flight.drag_bias", "flight.drag_bias": "flight.lift_loss"}[named]
    search = accepted(named, {named: 50.0, other: 48.0})
    assert search.rivals(0) == [(other, pytest.approx(2.0))]
    assert accepted(named, {named: 50.0, other: 46.0}).rivals(0) == []


def test_of_effects_near_linear_the_linear_problem_tells():
    """No fit is made for them, nor for one that was never worth a name."""
    search = accepted("flight.lift_loss", {"flight.drag_bias": 50.0})
    search.early["flight.drag_bias"] = 4.0
    assert search.rivals(0) == [("flight.drag_bias", -99.0)] and not search.fits
    search = accepted("flight.drag_bias", {"flight.lift_loss": 50.0})
    search.candidates[1] = Candidate("flight.lift_loss", widened((Variant((2,), 0.0),)), 0.0)
    assert search.rivals(0) == [("flight.lift_loss", -99.0)] and not search.fits


def test_what_is_beyond_doubt_is_not_fitted_again():
    """Near weak lift each fit of a rival would take its time."""
    search = accepted("flight.lift_loss", {"flight.lift_loss": 50.0, "flight.drag_bias": 50.4})
    search._worth = lambda k: 101.0
    assert search.at_rest(0) == [] and not search.fits


def test_the_one_ahead_at_rest_is_named():
    """By however little; one that held-out dives spoke against is not."""
    search = accepted("flight.lift_loss", {"flight.lift_loss": 50.0, "flight.drag_bias": 50.4})
    search.path = ["took back flight.drag_bias: held-out dives fit worse with it"]
    assert not _Settled._prefer(search)
    search.path = []
    assert _Settled._prefer(search)
    assert [pick.candidate.id for pick in search.picks] == ["flight.drag_bias"]
    assert search.path == ["preferred flight.drag_bias to flight.lift_loss (0.4 nats)"]
    assert not _Settled._prefer(search)


def test_evidence_of_a_lone_effect_far_from_linear_is_not_extrapolated():
    """It is what it was before anything was accepted, or what its fit is worth at rest; near linear as it stands."""
    search = accepted("flight.lift_loss", {"flight.lift_loss": 50.0})
    search._worth = lambda k: 1e6
    search.firsts = {"flight.lift_loss": 199.0}
    assert search.losses() == [199.0] and not search.fits
    search.firsts = {"flight.lift_loss": 20.0}
    search._rest = lambda picks: 50.0 if picks else 10.0
    assert search.losses() == [pytest.approx(40.0)]
    search = accepted("flight.drag_bias", {})
    search._worth = lambda k: 120.0
    assert search.losses() == [120.0] and not search.fits
