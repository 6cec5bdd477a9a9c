"""Shapes without a name: found where they were put, at their size; silent on noise; better than a name that is none."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis import unexplained
from glider_jax.diagnosis.bank import Bank, left_out, usual, worth
from glider_jax.diagnosis.locate import Place, sentence
from glider_jax.diagnosis.shapes import bank
from glider_jax.diagnosis.unexplained import Named, remainders
from glider_jax.inference.fit import Column, Linear
from glider_jax.inference.noise import SeriesNoise
from glider_jax.inference.streams import Stream

LEGS, EACH, SD = 60, 6, 0.002


def made(field, seed: int = 4, columns=None, heading=None):
    """Sixty half yos of six windows each of vertical speed that hold a field of depth, direction and time."""
    rng = np.random.default_rng(seed)
    leg = np.repeat(np.arange(LEGS), EACH)
    direction = np.where(leg % 2 == 0, -1.0, 1.0)
    depth = np.tile(np.linspace(5.0, 75.0, EACH), LEGS) + rng.uniform(-5.0, 5.0, leg.size)
    time = 3600.0 * leg + 500.0 * np.tile(np.arange(EACH), LEGS)
    own = field(depth, direction, time)
    value = own + SD * rng.standard_normal(leg.size) + 0.5 * SD * rng.standard_normal(LEGS)[leg]
    one = np.ones(leg.size)
    stream = Stream(
        "vertical speed", "m s-1", "cm/s", 100.0, value, time, leg, leg // 4, one, 40.0 * one,
        {"depth": depth, "direction": direction, "time": time} | ({"heading": heading(time)} if heading else {}),
    )  # fmt: skip
    noise = SeriesNoise(stream)
    noise.sizes = np.log([SD, 0.5 * SD, 1e-5, 900.0])
    ways = tuple(SimpleNamespace(start_time=3600.0 * k) for k in range(LEGS))
    gathered = SimpleNamespace(
        streams=(stream,), stream=lambda name: stream if name == stream.name else None, origin=0.0, ways=ways,
        odd_strokes=(), inputs=None,
    )  # fmt: skip
    problem = SimpleNamespace(gathered=gathered, noises=[noise], names=(stream.name,))
    raw = np.ones((leg.size, 1)) * SD if columns is None else columns(depth, direction, time)
    white = noise.whiten(np.column_stack([value, raw]))[0]
    labels = tuple(Column(k, f"known {k}", "known") for k in range(raw.shape[1]))
    which = np.zeros(leg.size, int)
    return problem, Linear(white[:, 0], white[:, 1:], labels, leg // 4, which, value, raw)


def best(problem, linear, active=(0,)):
    """The look with most evidence."""
    return max(Bank(problem, linear).beside(list(active)), key=lambda look: look.evidence)


def test_noise_alone_has_no_shape():
    """Of four records of mere noise none has a shape that is told."""
    for seed in range(4):
        found, _ = remainders(*made(lambda z, way, t: 0.0 * z, seed), [0])
        assert found == []


def test_a_day_of_drag_is_found_where_it_was():
    """Slower dives and climbs from hour 20 to 34 are told as such: opposite, in that time, of that size."""
    problem, linear = made(lambda z, way, t: 0.006 * way * ((t > 72000.0) & (t < 122400.0)))
    found, _ = remainders(problem, linear, [0])
    (one,) = found
    assert (one.place.covariate, one.place.phase) == ("dive", "opposite")
    assert one.place.low < 97200.0 / 86400.0 < one.place.high
    assert one.place.size == pytest.approx(0.6, abs=0.15) and one.gain > 10.0
    assert sentence(one.place).startswith("The glider dives and climbs 0.")
    assert "slower than the model, most between day" in sentence(one.place)


def test_a_short_time_is_told_in_hours():
    """Minutes of a record are no span of days; hours of it are."""
    place = Place("vertical speed", "dive", 0.01, 5.0, 0.012, 0.021, "d", "dive", -0.4, "cm/s", 0.2)
    assert "most between hour 0.3 and 0.5" in sentence(place)
    assert "most between day 0.01 and 0.21" in sentence(replace(place, high=0.21))


def test_internal_waves_are_no_drag():
    """A burst of waves in step with the yos carries dives and climbs oppositely for two hours: it is not told."""
    problem, linear = made(lambda z, way, t: 0.006 * way * np.exp(-0.5 * ((t - 1e5) / 5400.0) ** 2))
    look = best(problem, linear)
    assert look.shape.how == "opposite" and look.evidence > 8.0
    assert Bank(problem, linear).beside_waves(look, [0]).evidence < look.evidence - 3.0


def test_a_moving_layer_is_alike_on_dives_and_climbs():
    """Water that sinks between 30 and 50 m carries dives and climbs alike; the sign is that of sinking."""
    problem, linear = made(lambda z, way, t: 0.004 * np.exp(-0.5 * ((z - 40.0) / 8.0) ** 2))
    (one,) = remainders(problem, linear, [0])[0]
    assert (one.place.covariate, one.place.phase) == ("depth", "alike")
    assert one.place.low < 42.0 and one.place.high > 38.0
    assert "carried" in sentence(one.place) and "down" in sentence(one.place)


def test_what_is_smaller_than_a_pilot_acts_on_is_not_told():
    """A field of a tenth of a millimetre per second, however regular, is not worth a word."""
    problem, linear = made(lambda z, way, t: 1e-4 * np.sin(z / 8.0))
    assert remainders(problem, linear, [0])[0] == []


def two(z, way, t):
    """A constant, and growth with time."""
    return np.stack([SD * np.ones(z.size), SD * t / t.max()], axis=1)


def test_a_name_that_a_shape_beats_is_doubted():
    """Growth named for what came and went is doubted; growth named for growth is not."""
    for field, doubted in (
        (lambda z, way, t: 0.005 * (t > 120000.0) * (t < 170000.0), True),
        (lambda z, way, t: 0.008 * t / t.max(), False),
    ):
        problem, linear = made(field, columns=two)
        worth_of_name = linear.score([0, 1]) - linear.score([0])
        found, _ = remainders(problem, linear, [0, 1], [Named(("flight.drag_growth",), (1,), worth_of_name)])
        assert bool(found) is doubted


def test_a_shape_that_a_column_explains_earns_nothing():
    """The same trend as a known column leaves no shape over time."""
    problem, linear = made(lambda z, way, t: 0.008 * t / t.max(), columns=two)
    assert best(problem, linear, (0, 1)).evidence < 4.0 < best(problem, linear).evidence


def test_evidence_is_that_of_the_normal_law():
    """For one column: the ratio of normal densities of the data with and without it, averaged over sizes."""
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal(9), rng.standard_normal(9)
    sizes = np.array([0.5, 2.0])
    each = []
    for s in sizes:
        both = np.eye(9) + s * s * np.outer(x, x)
        each.append(0.5 * y @ (y - np.linalg.solve(both, y)) - 0.5 * np.linalg.slogdet(both)[1])
    expected = np.log(np.mean(np.exp(each)))
    for bumps in (False, True):
        gain, alone, size, which = worth(np.array([x @ y]), np.array([[x @ x]]), sizes, bumps)
        assert gain == pytest.approx(expected) and alone == pytest.approx(max(each))
        assert size == sizes[int(np.argmax(each))] and which == 0


def test_left_out_rows_gain_by_what_is_there_only():
    """A column that is in the data foretells left-out rows, one that is not does not."""
    rng = np.random.default_rng(2)
    there, not_there = rng.standard_normal((2, 120))
    residual = 1.5 * there + rng.standard_normal(120)
    parts = [np.arange(120) % 4 == k for k in range(4)]
    assert left_out(residual, there[:, None], 0, parts) > 20.0
    assert left_out(residual, not_there[:, None], 0, parts) < 1.0


def test_shapes_have_unit_variance_before_the_data():
    """Curves of every kind vary by one at where they are drawn, so that sizes compare."""
    problem, _ = made(lambda z, way, t: 0.0 * z)
    for shape in bank(problem):
        if not shape.bumps:
            assert np.allclose((shape.curve**2).sum(axis=1), 1.0, atol=2e-2)
        assert np.abs(shape.parts["vertical speed"]).max() < 1.5
    assert usual(problem, "vertical speed") == pytest.approx(SD)


def test_strokes_count_from_a_share_of_all_energy():
    """A hundred strokes that cost 7 J more are nothing beside a day at 1 W; 30 J more are worth a word."""
    time = np.linspace(0.0, 86400.0, 100)
    strokes = SimpleNamespace(name="pump in energy", value=np.full(100, 90.0), n=100, time=time)
    hotel = SimpleNamespace(name="hotel power, dives", value=np.full(40, 2.0), n=40)
    problem = SimpleNamespace(gathered=SimpleNamespace(streams=(strokes, hotel)))
    assert unexplained._cheap(problem, strokes, 7.0) and not unexplained._cheap(problem, strokes, 30.0)
    assert not unexplained._cheap(problem, hotel, 1e-6)


def test_a_heading_steered_once_is_no_compass():
    """Waves for two hours, in which another heading was steered, are not told as what comes with the heading."""
    problem, linear = made(
        lambda z, way, t: 0.008 * way * np.exp(-0.5 * ((t - 1e5) / 5400.0) ** 2),
        heading=lambda t: np.where(np.abs(t - 1e5) < 9000.0, 2.0, 4.5) + 0.05 * np.sin(t / 700.0),
    )
    bank = Bank(problem, linear)
    around = [look for look in bank.beside([0]) if look.shape.covariate == "heading"]
    look = max(around, key=lambda one: one.evidence)
    assert look.evidence > 8.0 and bank.beside_waves(look, [0]).evidence < look.evidence - 6.0
    assert all(one.place.covariate != "heading" for one in remainders(problem, linear, [0])[0])


def test_waves_lend_no_evidence():
    """Of a small bump beside waves no more is believed than of the bump by itself."""
    problem, linear = made(lambda z, way, t: 0.002 * way * np.exp(-0.5 * ((t - 1e5) / 5400.0) ** 2))
    bank = Bank(problem, linear)
    for look in bank.beside([0]):
        assert bank.beside_waves(look, [0]).evidence <= look.evidence + 1e-9
