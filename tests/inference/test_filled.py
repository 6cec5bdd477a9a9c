"""Common lengths: what fills inputs up changes nothing, and recordings of different lengths share one program."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from glider_jax.inference.filled import LEAST, ladder
from glider_jax.inference.fit import converged, make_problem
from glider_jax.inference.replay import build_replay
from glider_jax.inference.settling import respond, response_of
from glider_jax.inference.streams import gather
from glider_jax.physics.model import build_model, parameters
from tests.diagnosis.worlds import fly, vehicle


@pytest.fixture(scope="module")
def two():
    """Flights of different lengths, gathered, with their replays."""
    with jax.enable_x64(True):
        found = [gather(fly(days, noise=0.05), vehicle()) for days in (0.6, 0.7)]
        return [(one, build_replay(one, vehicle())) for one in found]


def test_lengths_go_in_steps():
    """Nothing stays nothing, little becomes the least, and never more than a quarter is added to much."""
    assert ladder(0) == 0 and ladder(1) == LEAST and ladder(LEAST) == LEAST
    for n in (2049, 5000, 10_241, 37_780, 65_536):
        assert n <= ladder(n) <= 1.25 * n + 1


def test_recordings_of_different_lengths_share_a_program(two):
    """Shapes and all that is static agree, so the second recording compiles nothing."""
    trees = [jax.tree_util.tree_flatten(one.program) for _, one in two]
    assert trees[0][1] == trees[1][1]
    assert [leaf.shape for leaf in trees[0][0]] == [leaf.shape for leaf in trees[1][0]]


def test_what_fills_up_counts_for_nothing(two, monkeypatch):
    """Predictions do not depend on how far the inputs were filled up."""
    gathered, one = two[0]
    values = np.array([u.centre for u in one.unknowns])
    with jax.enable_x64(True):
        short = one.predict(values)
        monkeypatch.setattr("glider_jax.inference.filled.LEAST_ROWS", 16_384)
        long = build_replay(gathered, vehicle()).predict(values)
    for name, value in short.items():
        assert value.shape == (gathered.stream(name).n,)
        assert np.allclose(value, long[name], rtol=1e-9, atol=1e-12), name


def test_derivatives_by_few_unknowns_are_those_by_all(two):
    """Asking for some columns gives the same numbers as asking for all."""
    _, one = two[0]
    values = np.array([u.centre for u in one.unknowns])
    own = [2, 17, len(one.unknowns) - 1]
    with jax.enable_x64(True):
        all_, few = one.jacobian(values)[1], one.slopes(values, None, own)[1]
    for name, columns in few.items():
        assert np.allclose(columns, all_[name][:, own], atol=1e-15), name


def test_speed_lags_along_the_path():
    """A path that turns at once turns the vertical speed at once; a force that steps is answered in the time given."""
    with jax.enable_x64(True):
        step = np.full(40, 8.0)
        steady = np.where(np.arange(40)[:, None] < 20, 0.3, 0.4) * np.ones((40, 2))
        slow, fast = respond(steady, step, np.stack([np.full(40, 16.0), np.full(40, 1.0)], axis=1))
    assert float(slow[-1]) == pytest.approx(0.4, abs=1e-4) and float(fast[22]) == pytest.approx(0.4, abs=1e-3)
    # One step after the change the slow one has gone about half a step's share of the way.
    assert 0.3 < float(slow[21]) < 0.36 < float(slow[24]) < 0.4


def test_response_time_follows_from_mass_drag_and_speed(two):
    """About 1.2 m U over twice the drag of the test's glider; heavier answers later."""
    gathered, _ = two[0]
    with jax.enable_x64(True):
        found = response_of(gathered.rows, parameters(build_model(vehicle(), dtype=np.float64)))
    assert 8.0 < found < 14.0


def test_wander_is_left_open(two):
    """The nuisance moves the vertical speed where pitch wanders, and nothing else."""
    gathered, one = two[0]
    names = [u.name for u in one.unknowns]
    values = np.array([u.centre for u in one.unknowns])
    with jax.enable_x64(True):
        columns = one.jacobian(values)[1]
    mine = columns["vertical speed"][:, names.index("pitch wander")]
    assert np.abs(mine).max() > 0.01 * np.abs(gathered.inputs.wander).max() > 0.0
    assert np.abs(columns["displacement east"][:, names.index("pitch wander")]).max() < 3e-3
    assert abs(mine.mean()) < 0.3 * mine.std() + 1e-5
    assert np.abs(gathered.inputs.wander).max() < 0.1


def test_evidence_at_rest_is_higher_with_what_is_there(two):
    """A planted mass is worth many nats where its fit rests, an absent one costs some."""
    with jax.enable_x64(True):
        gathered = gather(fly(0.6, mass=0.05), vehicle())
        problem = make_problem(gathered, build_replay(gathered, vehicle()))
        names = [u.name for u in problem.replay.unknowns]
        free = [i for i, u in enumerate(problem.replay.unknowns) if u.kind != "candidate"]
        scores = {
            extra: converged(problem, free + ([names.index(extra)] if extra else []), {}, problem.values, {})
            for extra in ("", "flight.ballast_offset.mass", "energy.hotel_growth.rate")
        }
    mass = scores["flight.ballast_offset.mass"]
    assert mass[0] > scores[""][0] + 20.0
    assert mass[1][names.index("flight.ballast_offset.mass")] == pytest.approx(0.05, abs=0.015)
    assert scores["energy.hotel_growth.rate"][0] < scores[""][0] + 3.0
