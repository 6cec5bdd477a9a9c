"""Channels at different rates and logs around triggers: every sample reaches the events, at its own rate."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.board import motors, revision2
from glider_jax.board.calibration import nominal
from glider_jax.board.decoder import decode_bytes, decode_pieces
from glider_jax.board.detect import find_running, rest_level
from glider_jax.board.record import NOT_SAMPLED, collect, open_record, write_record
from glider_jax.board.simulate import Plan, simulate
from glider_jax.errors import DataError

PLAN = Plan(depths=(15.0, 40.0, 25.0))


@pytest.fixture(scope="module")
def flight():
    return simulate(PLAN, 7)


@pytest.fixture(scope="module")
def whole(flight):
    batch, report = decode_bytes(flight.encode())
    record = collect([batch], "all", report.as_dict())
    return motors.events_from_board(record, flight.glider, flight.board)


@pytest.fixture(scope="module")
def strong():
    """Strokes that pass a trigger of five counts."""
    return simulate(Plan(depths=(15.0, 40.0, 25.0), climb=170.0, intercept=200.0), 8)


def around(flight, **setup):
    zero = tuple(int(round(flight.board[name].zero)) for name in revision2.CHANNELS)
    return log(flight, zero=zero, threshold=(5,) * 8, **setup)


def log(flight, **setup):
    return revision2.sample(revision2.Setup(**setup), flight.counts, 1, flight.utc_ms)[0]


def record_of(data, name="log"):
    batch, report = decode_bytes(data)
    return collect([batch], name, report.as_dict())


def pumps(events):
    return [e for e in events if e.kind == "pump"]


MIXED = (4, 0, 0, 1, 1, 2, 3, 8)


def test_every_sample_of_every_channel_is_in_the_record(flight):
    record = record_of(log(flight, dividers=MIXED))
    assert record.mixed and record.channels == ("main", "pump_a", "pump_b", "brake", "pitch", "fin")
    for name, divider in zip(revision2.CHANNELS, MIXED, strict=True):
        if not divider:
            assert name not in record.channels
            continue
        own = record.only(name)
        assert own.stride == divider and own.spacing == pytest.approx(0.032 * divider)
        assert own.tick.tolist() == list(range(0, len(flight.counts), divider))
        sent = flight.counts[::divider, revision2.CHANNELS.index(name)]
        np.testing.assert_array_equal(own.counts[:, 0], sent)
        assert record.report["samples_by_channel"][name] == sent.size
    both = record.only("main", "brake")
    assert both.stride == 4 and not (both.counts == NOT_SAMPLED).any()


@pytest.mark.parametrize("piece", [997, 20_000])
def test_the_record_on_disk_equals_the_one_in_memory(flight, tmp_path, piece):
    data = log(flight, dividers=MIXED)
    pieces = (data[i : i + piece] for i in range(0, len(data), piece))
    stored, _ = write_record(pieces, tmp_path, "log")
    memory = record_of(data)
    assert stored.channels == memory.channels and stored.mixed and stored.stride == memory.stride
    for name in ("tick", "epoch", "counts", "flags"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(memory, name))
    assert open_record(tmp_path).report["samples_by_channel"] == memory.report["samples_by_channel"]


def test_channels_that_come_later_widen_the_record_on_disk(flight, tmp_path):
    early = revision2.sample(revision2.Setup(dividers=(0, 0, 0, 1, 0, 0, 0, 0)), flight.counts[:3000], 1)[0]
    late = revision2.sample(revision2.Setup(dividers=(1, 0, 0, 1, 0, 0, 0, 0)), flight.counts[:2000], 2)[0]
    stored, _ = write_record(iter([early, late]), tmp_path, "log")
    memory = record_of(early + late)
    assert stored.channels == ("main", "pump_a") and len(stored.tick) == 5000
    np.testing.assert_array_equal(stored.counts, memory.counts)
    np.testing.assert_array_equal(stored.only("main").counts[:, 0], flight.counts[:2000, 0])
    np.testing.assert_array_equal(stored.only("pump_a").counts[:3000, 0], flight.counts[:3000, 3])


@pytest.mark.parametrize(
    "dividers", [MIXED, (2, 0, 0, 2, 2, 2, 2, 2), (8, 0, 0, 3, 2, 2, 8, 8), (1, 0, 0, 8, 8, 4, 1, 1)]
)
def test_events_keep_their_number_and_their_energy_at_any_rate(flight, whole, dividers):
    record = record_of(log(flight, dividers=dividers))
    events = motors.events_from_board(record, flight.glider, flight.board)
    kinds = ("brake_unlock", "pump", "brake_lock")
    assert [e.kind for e in events if e.kind in kinds] == [e.kind for e in whole if e.kind in kinds]
    for got, true in zip(pumps(events), pumps(whole), strict=True):
        assert got.complete and got.direction == true.direction
        # A sample each d ticks knows the ends of a stroke to d/sqrt(12) ticks each.
        ends = max(dividers[3:5]) * 0.032 / 6**0.5 * true.peak * true.voltage
        assert abs(got.energy - true.energy) < 4.0 * np.hypot(got.energy_sd, ends)
        # A slow channel may miss the inrush, never exceed it.
        assert 0.6 * true.peak < got.peak < 1.1 * true.peak
        assert got.duration == pytest.approx(true.duration, abs=0.1 + 0.064 * max(dividers[3:5]))
    mean, truth = (np.mean([e.energy for e in group]) for group in (pumps(events), pumps(whole)))
    assert mean == pytest.approx(truth, rel=0.01)


def test_a_log_around_triggers_gives_the_same_strokes(strong):
    batch, report = decode_bytes(strong.encode())
    whole = motors.events_from_board(collect([batch], "all", report.as_dict()), strong.glider, strong.board)
    data = around(strong, trigger_channels=("pump_a", "pump_b", "brake"), dividers=(4, 0, 0, 1, 1, 1, 1, 1))
    record = record_of(data)
    assert len(record.tick) < 0.4 * len(strong.counts)
    events = motors.events_from_board(record, strong.glider, strong.board)
    kinds = ("brake_unlock", "pump", "brake_lock")
    assert [e.kind for e in events if e.kind in kinds] == [e.kind for e in whole if e.kind in kinds]
    for got, true in zip(pumps(events), pumps(whole), strict=True):
        assert got.complete and got.energy == pytest.approx(true.energy, abs=4.0 * true.energy_sd)


def test_rest_is_what_precedes_a_trigger_and_not_the_usual_level(strong):
    record = record_of(around(strong, trigger_channels=("pump_a",), post_roll=5))
    on = record.counts[:, record.column("pump_a")]
    assert np.median(on) > strong.board["pump_a"].zero + 5
    _, levels = rest_level(record, "pump_a", 0.0)
    assert np.abs(levels - strong.board["pump_a"].zero).max() < 0.6


def test_strokes_between_triggers_without_rest_are_kept_and_called_incomplete(strong):
    data = around(strong, trigger_channels=("pump_a", "pump_b"), pre_roll=0, post_roll=3)
    found = pumps(motors.events_from_board(record_of(data), strong.glider, strong.board))
    assert len(found) == 6 and not any(e.complete for e in found)
    truth = [strong.truth["energy.pump_climb_to_dive"]] * 3
    back = [e.energy for e in found if e.direction == "climb_to_dive"]
    assert back == pytest.approx(truth, rel=0.1)


def test_lost_frames_make_only_the_channels_they_carried_incomplete(flight, whole):
    data = log(flight, dividers=MIXED)
    batch, report = decode_bytes(data)
    target = pumps(whole)[0]
    at = int((target.time - PLAN.start) / 0.032) + 200
    parts = []
    for part in batch.samples:
        keep = (part.tick < at) | (part.tick > at + 40)
        parts.append(
            type(part)(
                part.channels, *(getattr(part, n)[keep] for n in ("tick", "epoch", "counts", "flags", "end"))
            )
        )
    holed = type(batch)(tuple(parts), clock=batch.clock, setups=batch.setups)
    events = motors.events_from_board(
        collect([holed], "holed", report.as_dict()), flight.glider, flight.board
    )
    assert [e.complete for e in pumps(events)] == [False] + [True] * 5


def test_two_lengths_of_a_tick_in_one_log_are_refused(flight):
    first = revision2.sample(revision2.Setup(), flight.counts[:100], 1)[0]
    second = revision2.sample(revision2.Setup(tick_us=16_000), flight.counts[:100], 2)[0]
    with pytest.raises(DataError, match="16 ms, 32 ms"):
        record_of(first + second)


def test_a_log_without_its_setup_says_that_the_tick_is_assumed(flight):
    data = log(flight)
    setup_size = 68
    assert record_of(data[setup_size:]).report["period_assumed"]
    assert not record_of(data).report["period_assumed"]
    assert not record_of(flight.encode()).report["period_assumed"]


def test_pieces_and_pauses_do_not_change_what_is_found(flight, monkeypatch):
    from glider_jax.board import detect

    record = record_of(flight.encode())
    motor = motors.MOTORS[0]
    one = find_running(record, motor.channels, flight.board, motor.smooth, motor.join, motor.least)
    monkeypatch.setattr(detect, "_PIECE", 4096)
    many = find_running(record, motor.channels, flight.board, motor.smooth, motor.join, motor.least)
    assert len(one) == len(many) == 6
    assert np.abs(one.first - many.first).max() <= 2 and np.abs(one.last - many.last).max() <= 2


def test_streaming_a_mixed_log_gives_all_batches(flight):
    from glider_jax.board.decoder import Decoder

    data = log(flight, dividers=MIXED)
    decoder = Decoder()
    batches = list(decode_pieces((data[i : i + 5000] for i in range(0, len(data), 5000)), decoder))
    assert sum(len(p.tick) for b in batches for p in b.samples) == decoder.report.samples
    np.testing.assert_array_equal(
        collect(batches, "x", decoder.report.as_dict()).counts, record_of(data).counts
    )


def noisy(noise, hours, seed, drift=0.0, spikes=0.0):
    """A board on which nothing runs, but noise of so many counts, a wandering zero and single wild samples."""
    from glider_jax.board.frames import CHANNELS_8, encode_revision_1

    rng = np.random.default_rng(seed)
    ticks = int(hours * 112_500)
    time = np.arange(ticks) * 0.032
    wander = drift * np.sin(2 * np.pi * time / 2400.0 + rng.uniform(0, 6.28, (8, 1))).T
    counts = 512.3 + wander + rng.normal(0.0, noise, (ticks, 8))
    wild = rng.random((ticks, 8)) < spikes
    counts[wild] += rng.choice([-60.0, 60.0], wild.sum())
    assert len(CHANNELS_8) == 8
    return record_of(encode_revision_1(np.clip(np.rint(counts), 1, 1022).astype(np.uint16)))


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.75, 3.0, 10.0])
def test_noise_raises_no_alarm_at_any_level(noise):
    record = noisy(noise, 0.5, 3, drift=0.6, spikes=1e-3)
    for motor in motors.MOTORS:
        assert len(motors.running(record, motor, nominal())) == 0


def weak(noise, amperes, seed, seconds=20.0, count=12):
    """Strokes of a total current on the pump's two channels, one a minute, in a noise of so many counts."""
    rng = np.random.default_rng(seed)
    ticks = count * 1875
    counts = 512.0 + rng.normal(0.0, noise, (ticks, 8))
    begins = np.arange(count) * 1875 + 600
    for begin in begins:
        counts[begin : begin + int(seconds / 0.032), 3:5] += (
            0.5 * amperes / nominal()["pump_a"].amperes_per_count
        )
    from glider_jax.board.frames import encode_revision_1

    return record_of(encode_revision_1(np.rint(counts).astype(np.uint16))), begins


@pytest.mark.parametrize(
    ("noise", "amperes"), [(0.2, 0.14), (0.75, 0.14), (1.5, 0.14), (3.0, 0.3), (10.0, 1.0)]
)
def test_weak_strokes_are_found_as_far_as_the_noise_allows(noise, amperes):
    record, begins = weak(noise, amperes, 5)
    found = motors.running(record, motors.MOTORS[0], nominal())
    assert len(found) == 12
    assert np.abs(found.first - begins).max() <= 16 and np.abs(found.last - begins - 624).max() <= 16
    events = motors.events_from_board(record, None, nominal(), 14.0)
    energy = np.array([e.energy for e in events if e.kind == "pump"])
    sd = np.array([e.energy_sd for e in events if e.kind == "pump"])
    assert energy.mean() == pytest.approx(amperes * 20.0 * 14.0, abs=4.0 * sd.mean() / 12**0.5)
    assert all(e.kind == "pump" for e in events)


def test_the_threshold_follows_the_noise():
    values = [
        float(motors.running(weak(noise, 1.0, 1)[0], motors.MOTORS[0], nominal()).threshold[0])
        for noise in (0.3, 2.0, 8.0)
    ]
    scale = nominal()["pump_a"].amperes_per_count
    # Two channels, sixteen samples: six sigma of their mean.
    expected = [6.0 * 2**0.5 * np.hypot(noise, 12**-0.5) / 4.0 * scale for noise in (2.0, 8.0)]
    assert values[0] == pytest.approx(1.5 * 2**0.5 * scale)
    assert values[1:] == pytest.approx(expected, rel=0.12)
