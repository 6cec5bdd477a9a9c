"""A flow that nobody knew: told from still water, foreseen for later segments, of the right size and direction."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.diagnosis.flow import Course, evidence, later, left_over, predicted
from glider_jax.inference.noise import CourseNoise
from glider_jax.inference.streams import Stream

OMEGA = 1.405189e-4


def course(flow, count: int = 14, seed: int = 2) -> Course:
    """Segments of 1.2 h in a flow, a function of time giving m/s east and north, with 4 mm/s of noise."""
    time = 1800.0 + 4500.0 * np.arange(count)
    span = np.full(count, 4200.0)
    east, north = flow(time)
    rng = np.random.default_rng(seed)
    values = [v + rng.normal(0.0, 0.004, count) for v in (east, north)]
    streams = tuple(
        Stream(f"displacement {way}", "m s-1", "cm/s", 100.0, v, time, np.arange(count), np.arange(count),
               np.ones(count), span)
        for way, v in zip(("east", "north"), values, strict=True)
    )  # fmt: skip
    noise = CourseNoise(streams, None, False)
    one, cosine, sine = np.ones(count), np.cos(OMEGA * time), np.sin(OMEGA * time)
    zero = np.zeros(count)
    columns = [0.15 * np.concatenate(p) for p in ((one, zero), (zero, one))]
    columns += [0.1 * np.concatenate(p) for p in ((cosine, zero), (sine, zero), (zero, cosine), (zero, sine))]
    names = tuple(f"flow {k}" for k in range(6))
    return Course(
        noise, np.concatenate(values), np.stack(columns, axis=1), names, np.ones(6, bool), count, time, span,
        np.arange(count),
    )  # fmt: skip


def tide(time):
    """A current of 10 cm/s to the west and an M2 tide of 15 cm/s in the north."""
    return -0.10 + 0.0 * time, 0.15 * np.cos(OMEGA * time)


def still(time):
    """Water that does not move."""
    return 0.0 * time, 0.0 * time


def test_moving_water_is_told_from_still_water():
    """Evidence is far above the threshold with a flow, and below it without."""
    assert evidence(course(tide)) > 50.0
    assert all(evidence(course(still, seed=s)) < 0.0 for s in range(4))


def test_later_segments_are_met_better():
    """From the first half the second is foreseen; the misses without the flow are those of the flow itself."""
    rows = later(course(tide))
    assert [row["fitted"] + row["predicted"] for row in rows] == [14, 14, 14]
    assert all(row["after_m"] < 0.5 * row["before_m"] for row in rows[1:])
    whole = np.hypot(*tide(course(tide).time))[8:] * 4200.0
    assert rows[1]["before_m"] == pytest.approx(np.median(whole), rel=0.05)


def test_the_flow_has_its_sign():
    """A segment in the middle is foreseen from its neighbours to 2 cm/s, west and not east."""
    one = course(tide)
    wanted, known = one.rows(np.array([6])), one.rows(np.delete(np.arange(14), 6))
    guess, variance = predicted(one, known, wanted)
    assert guess == pytest.approx(np.array(tide(one.time[6])), abs=0.02)
    assert np.all(np.sqrt(variance) < 0.05)
    assert np.sqrt(np.mean(left_over(one) ** 2)) < 0.03
