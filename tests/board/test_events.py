"""Events and steady load: planted strokes come back with their energy, sign and direction."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.board import motors
from glider_jax.board.calibration import nominal
from glider_jax.board.checks import bench_check, wiggle_test
from glider_jax.board.clock import fit_clock
from glider_jax.board.decoder import decode_bytes
from glider_jax.board.events import (
    AT_SURFACE,
    CLIMB_TO_DIVE,
    DIVE_TO_CLIMB,
    GliderRecord,
    counter_ratio,
    direction_of,
    events_from_glider,
    glider_record,
    interpolate,
)
from glider_jax.board.frames import CHANNELS_8
from glider_jax.board.record import BoardRecord, collect
from glider_jax.board.simulate import Plan, simulate
from glider_jax.board.steady import phases, steady_levels
from glider_jax.errors import ConfigError, DataError
from glider_jax.records import Recording, Source


def planted(counter=True, flag=True, hotel=(0.30, 0.10)):
    """Yos of 40 m sampled each 4 s: 2 A for 20 s at depth, 1 A for 20 s at the top, other loads by phase."""
    time = np.arange(0.0, 3200.0, 4.0) + 1e9
    cycle = (time - time[0]) % 400.0
    depth = np.where(cycle < 200.0, cycle / 5.0, 80.0 - cycle / 5.0)
    current = np.where(cycle < 200.0, hotel[0], hotel[1])
    out, back = (cycle > 200.0) & (cycle <= 220.0), (cycle > 0.0) & (cycle <= 20.0) & (time > time[0] + 100.0)
    current = current + 2.0 * out + 1.0 * back
    volume = 230e-6 * np.interp(cycle, [0.0, 20.0, 200.0, 220.0, 400.0], [1, -1, -1, 1, 1])
    moving = (cycle >= 200.0) & (cycle < 216.0) | back & (cycle < 16.0)
    charge = np.floor(np.cumsum(current * 4.0) / 4.3) * 4.3
    return GliderRecord(
        time,
        depth,
        np.full(time.size, 14.0),
        current,
        charge if counter else None,
        volume,
        moving if flag else None,
        name="planted",
    )


@pytest.mark.parametrize("counter", [True, False])
@pytest.mark.parametrize("flag", [True, False])
def test_strokes_carry_the_energy_planted(counter, flag):
    events = events_from_glider(planted(counter, flag))
    out = [e for e in events if e.direction == DIVE_TO_CLIMB]
    back = [e for e in events if e.direction == CLIMB_TO_DIVE]
    assert len(out) == 8 and len(back) == 7
    # The other loads change by 0.2 A at the turn; half of that over the window is what the rule cannot know.
    for group, truth in ((out, 2.0 * 20.0 * 14.0), (back, 1.0 * 20.0 * 14.0)):
        energy = np.array([e.energy for e in group])
        assert abs(energy.mean() - truth) < 50.0
        assert (np.abs(energy - truth) < 3.0 * np.array([e.energy_sd for e in group])).all()
    assert all(e.volume > 0 for e in out) and all(e.volume < 0 for e in back)
    assert out[0].depth == pytest.approx(40.0, abs=1.0) and out[0].peak == pytest.approx(1.9, abs=0.15)


def test_with_the_same_load_before_and_after_the_energy_is_exact():
    events = events_from_glider(planted(counter=False, hotel=(0.2, 0.2)))
    for e in events:
        assert e.energy == pytest.approx((2.0 if e.volume > 0 else 1.0) * 20.0 * 14.0, abs=1e-6)


def test_the_load_of_everything_else_is_taken_off():
    low = events_from_glider(planted(hotel=(0.1, 0.1)))
    high = events_from_glider(planted(hotel=(0.9, 0.9)))
    for a, b in zip(low, high, strict=True):
        assert a.energy == pytest.approx(b.energy, abs=40.0)


def test_direction():
    assert direction_of(1e-4, 40.0, True) == DIVE_TO_CLIMB
    assert direction_of(1e-4, 0.5, True) == AT_SURFACE
    assert direction_of(-1e-4, 0.5, True) == CLIMB_TO_DIVE
    assert direction_of(np.nan, 30.0, True) == DIVE_TO_CLIMB
    assert direction_of(np.nan, 3.0, False) == CLIMB_TO_DIVE


def test_counter_ratio_finds_a_gain_error():
    record = planted()
    ratio, sd = counter_ratio(record)
    assert abs(ratio) < 0.01
    wrong = GliderRecord(**{**record.__dict__, "current": 1.05 * record.current})
    assert counter_ratio(wrong)[0] == pytest.approx(ratio + 0.05, abs=0.003)
    assert sd > 0


def test_steady_levels_by_phase():
    levels = {level.phase: level for level in steady_levels(planted()) if not level.state}
    assert levels["dive"].mean == pytest.approx(0.3 * 14, abs=0.05)
    assert levels["climb"].mean == pytest.approx(0.1 * 14, abs=0.05)
    assert levels["submerged"].floor == pytest.approx(0.1 * 14, abs=0.05)


def test_steady_levels_by_state_of_the_devices():
    record = planted(hotel=(0.1, 0.1))
    on = (record.time - record.time[0]) % 800.0 < 400.0
    lit = GliderRecord(
        **{
            **record.__dict__,
            "current": record.current + 0.2 * on,
            "states": {"science_on": on.astype(float)},
        }
    )
    levels = {(level.phase, level.state): level.mean for level in steady_levels(lit)}
    assert levels["dive", "science_on"] == pytest.approx(0.3 * 14, abs=0.05)


def test_phases():
    time = np.arange(0.0, 400.0, 4.0)
    depth = np.concatenate([np.zeros(20), np.linspace(0, 40, 40), np.linspace(40, 0, 40)])
    found = phases(time, depth)
    assert found[5] == "surface" and found[40] == "dive" and found[80] == "climb"


def test_interpolation_stops_far_from_data():
    values = interpolate(
        np.array([5.0, 50.0, 500.0]), np.array([0.0, 10.0, 1000.0]), np.array([0.0, 1.0, 2.0]), 60.0
    )
    np.testing.assert_allclose(values[:1], [0.5])
    assert np.isfinite(values[1]) and np.isnan(values[2])


def test_recording_without_current_is_explained():
    time = np.arange(10.0)
    recording = Recording("ru", time, {"depth": time}, Source("x"), time[:1])
    with pytest.raises(DataError, match="m_coulomb_current"):
        glider_record(recording)


def test_recording_without_pump_is_explained():
    record = planted()
    bare = GliderRecord(**{**record.__dict__, "volume": None, "moving": None})
    with pytest.raises(DataError, match="m_de_oil_vol"):
        events_from_glider(bare)


@pytest.fixture(scope="module")
def flown():
    plan = Plan(depths=(15.0, 40.0, 70.0, 30.0))
    flight = simulate(plan, 3)
    batch, report = decode_bytes(flight.encode())
    record = collect([batch], "sim", report.as_dict())
    return plan, flight, record, motors.events_from_board(record, flight.glider, flight.board)


class TestBoard:
    def test_every_action_is_found_in_order(self, flown):
        _, _, _, events = flown
        for group in range(8):
            kinds = [e.kind for e in events if e.group == group]
            assert kinds == ["brake_unlock", "pump", "brake_lock"]
        assert [e.direction for e in events if e.kind == "pump"] == [DIVE_TO_CLIMB, CLIMB_TO_DIVE] * 4

    def test_energies_with_the_true_board_are_right_to_its_noise(self, flown):
        plan, flight, record, events = flown
        for event in events:
            if event.kind != "pump":
                continue
            rows = slice(
                int((event.time - plan.start) / 0.032) - 40, int((event.time - plan.start) / 0.032) + 720
            )
            currents = flight.currents["pump_a"][rows] + flight.currents["pump_b"][rows]
            truth = float((currents * 0.032).sum()) * event.voltage
            assert abs(event.energy - truth) < 4.0 * event.energy_sd + 0.005 * truth

    def test_energy_grows_with_depth(self, flown):
        _, _, _, events = flown
        out = sorted(
            (e for e in events if e.direction == DIVE_TO_CLIMB and e.kind == "pump"), key=lambda e: e.depth
        )
        assert [round(e.depth) for e in out] == [15, 30, 40, 70]
        assert (np.diff([e.energy for e in out]) > 0).all()
        assert all(e.volume == pytest.approx(460e-6, rel=1e-3) for e in out)

    def test_servo_bursts_of_both_signs(self, flown):
        _, _, _, events = flown
        pitch = [e for e in events if e.kind == "pitch"]
        assert len(pitch) == 8
        assert {np.sign(e.charge) for e in pitch} == {-1.0, 1.0}

    def test_lost_samples_make_an_event_incomplete(self, flown):
        _, flight, record, events = flown
        pump = next(e for e in events if e.kind == "pump")
        middle = int((pump.time - flight.utc_ms[0] / 1000.0 + 8.0) / 0.032)
        keep = np.ones(len(record.tick), dtype=bool)
        keep[middle : middle + 20] = False
        holed = BoardRecord(
            record.channels,
            record.tick[keep],
            record.epoch[keep],
            record.counts[keep],
            record.flags[keep],
            record.clock,
            "holed",
        )
        again = motors.events_from_board(holed, flight.glider, flight.board)
        first = next(e for e in again if e.kind == "pump")
        assert not first.complete and sum(not e.complete for e in again) == 1

    def test_six_channels(self):
        flight = simulate(Plan(depths=(20.0, 30.0), channels=6), 1)
        batch, report = decode_bytes(flight.encode())
        events = motors.events_from_board(
            collect([batch], "six", report.as_dict()), flight.glider, flight.board
        )
        assert sum(e.kind == "pump" for e in events) == 4

    def test_no_voltage_is_an_error(self, flown):
        with pytest.raises(DataError, match="--voltage"):
            motors.events_from_board(flown[2], None, flown[1].board)

    def test_saturated_channel_is_an_error(self, flown):
        _, flight, record, _ = flown
        counts = record.counts.copy()
        counts[:, 5] = 1023
        stuck = BoardRecord(
            record.channels, record.tick, record.epoch, counts, record.flags, record.clock, "stuck"
        )
        with pytest.raises(DataError, match="brake.*saturated"):
            motors.events_from_board(stuck, flight.glider, flight.board)

    def test_plan_too_shallow(self):
        with pytest.raises(ConfigError, match="4 m or deeper"):
            simulate(Plan(depths=(1.0,)))


def bench_record(amperes, seconds=6.0, channel="pump_a", gain=1.0, seed=0, drift=0.0):
    """Thirty seconds on the bench: a step on one channel after ten seconds."""
    rng = np.random.default_rng(seed)
    ticks = 940
    time = np.arange(ticks) * 0.032
    board = nominal()
    counts = np.empty((ticks, 8))
    for column, name in enumerate(CHANNELS_8):
        part = board[name]
        current = (
            np.where((time >= 10.0) & (time < 10.0 + seconds), amperes * gain, 0.0)
            if name == channel
            else 0.0
        )
        current = current + np.where(time > 20.0, drift, 0.0)
        counts[:, column] = (
            512 + current / part.amperes_per_count + rng.normal(0, part.sensor.noise * 204.8, ticks)
        )
    counts = np.rint(counts).astype(np.uint16)
    tick = np.arange(ticks)
    return BoardRecord(
        CHANNELS_8, tick, np.zeros(ticks, dtype=np.int32), counts, np.zeros(ticks, dtype=np.uint8),
        fit_clock(np.empty((0, 3), dtype=np.int64), 1), "bench",
    )  # fmt: skip


class TestBench:
    def test_one_ampere_for_six_seconds_passes(self):
        for channel in ("main", "pump_a", "brake"):
            result = bench_check(bench_record(1.0, channel=channel), channel, nominal())
            assert result.passed, result.reasons
            assert result.mean == pytest.approx(1.0, abs=0.02)
            assert result.duration == pytest.approx(6.0, abs=0.05)

    def test_budget_is_what_gain_allows(self):
        result = bench_check(bench_record(1.0), "pump_a", nominal())
        assert result.budget == pytest.approx(0.03, rel=0.05)

    @pytest.mark.parametrize(
        ("record", "text"),
        [
            (bench_record(1.0, gain=1.06), "budget"),
            (bench_record(-1.0), "budget"),
            (bench_record(1.0, seconds=4.0), "lasted"),
            (bench_record(1.0, drift=0.2), "zero moved"),
        ],
    )
    def test_failures_say_why(self, record, text):
        result = bench_check(record, "pump_a", nominal())
        assert not result.passed and any(text in reason for reason in result.reasons)

    def test_no_step(self):
        with pytest.raises(DataError, match="found none above half"):
            bench_check(bench_record(1.0, channel="fin"), "pump_a", nominal())

    def test_unknown_channel(self):
        with pytest.raises(DataError, match="Did you mean 'brake'"):
            bench_check(bench_record(1.0), "brakes", nominal())

    def test_wiggle(self):
        record = bench_record(0.0)
        counts = record.counts.astype(float)
        for begin, sign in ((200, 1), (300, -1), (400, 1), (500, -1)):
            counts[begin : begin + 40, 7] += sign * 0.4 / nominal()["fin"].amperes_per_count
        moved = BoardRecord(**{**record.__dict__, "counts": np.rint(counts).astype(np.uint16)})
        result = wiggle_test(moved, "fin", nominal())
        assert result.passed and (result.positive, result.negative) == (2, 2)
        assert result.highest == pytest.approx(0.4, abs=0.05) and result.lowest == pytest.approx(
            -0.4, abs=0.05
        )
        still = wiggle_test(record, "fin", nominal())
        assert not still.passed and "0 positive movements" in still.reasons[0]
