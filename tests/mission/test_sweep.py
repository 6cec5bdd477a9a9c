"""Runs flown together: each gives what it gives alone, in any number of stacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.environment.synthetic import synthetic_bathymetry
from glider_jax.errors import ConfigError
from glider_jax.mission import sweep
from glider_jax.mission.forecast import forecast, prepare
from tests.mission.conftest import make_mission

FIELDS = ("latitude", "longitude", "energy", "state_of_charge", "distance_over_ground", "inflections", "outcome")


@pytest.fixture(scope="module")
def runs(vehicle):
    floor = synthetic_bathymetry(
        "sloping", latitude=39.0, longitude=-74.0, depth=40.0, slope=0.002, width=200e3, height=200e3
    )
    made = []
    for depth, period in ((30.0, 7200.0), (50.0, 10800.0), (80.0, 7200.0), (80.0, 14400.0), (100.0, 7200.0)):
        mission = make_mission()
        rules = (replace(mission.surface[0], seconds=period), mission.surface[1])
        mission = replace(mission, yo=replace(mission.yo, dive_to=depth), surface=rules)
        run = prepare(
            mission, vehicle, bathymetry=floor, speed="shoebox", speeds=(np.array([0.3, 0.3]), np.array([0.0, 1.0])),
            duration=0.5 * 86400.0, interval=3600.0, start=0.0, seed=len(made),
        )  # fmt: skip
        made.append(run)
    return [replace(run, environment=made[0].environment) for run in made]


def test_each_run_is_what_it_is_alone(runs, monkeypatch):
    # Three stacks of two, the last one filled up.
    monkeypatch.setattr(sweep, "most_stacked", lambda run, n: 2)
    together = list(sweep.fly_stacked(runs, 6))
    assert len(together) == len(runs)
    for run, track in zip(runs, together, strict=True):
        alone = forecast(6, run)
        for name in FIELDS:
            np.testing.assert_allclose(getattr(track, name), getattr(alone, name), rtol=1e-5, atol=1e-6, err_msg=name)
        up = min(track.surfacing_time.shape[1], alone.surfacing_time.shape[1])
        np.testing.assert_allclose(track.surfacing_time[:, :up], alone.surfacing_time[:, :up], atol=1.0)
    # Other numbers, other missions.
    assert np.ptp([track.inflections[:, -1].mean() for track in together]) > 10.0


def test_stacks_are_as_large_as_memory_is_allowed_for(runs):
    one = sweep.most_stacked(runs[0], 100)
    assert one > 1 and sweep.most_stacked(runs[0], 100, sweep.NUMBERS // 10) == pytest.approx(one / 10, abs=1)
    assert sweep.most_stacked(runs[0], 10**9) == 1
    assert list(sweep.fly_stacked([], 5)) == []


def test_runs_that_compile_otherwise_are_refused(runs, vehicle):
    other = prepare(make_mission(legs=-1), vehicle, speed="shoebox", duration=43200.0, interval=3600.0, start=0.0)
    assert sweep.signature(runs[0]) != sweep.signature(other)
    with pytest.raises(ConfigError, match="one shape and environment"):
        list(sweep.fly_stacked([runs[0], other], 4))
    with pytest.raises(ConfigError, match="at least 1 member"):
        list(sweep.fly_stacked(runs, 0))
