"""Board against the glider's coulomb counter: gains, zeros and gaps that were planted come back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.board import fits
from glider_jax.board.analysis import analyse_board
from glider_jax.board.calibration import nominal
from glider_jax.board.counter import COUNTER_SD, against_counter, board_charges
from glider_jax.board.decoder import decode_bytes
from glider_jax.board.record import BoardRecord, collect
from glider_jax.board.simulate import Plan, simulate
from glider_jax.board.steady import steady_levels

PLAN = Plan(depths=(15.0, 40.0, 70.0, 30.0), voltage_gain_sd=0.0, counter_gain_sd=0.0)


@pytest.fixture(scope="module")
def flown():
    flight = simulate(PLAN, 3)
    batch, report = decode_bytes(flight.encode())
    return flight, collect([batch], "sim", report.as_dict())


def other(calibration, gain=1.0, zero=0.0):
    """A calibration whose main sensor is believed to be stronger by ``gain`` and lower by ``zero`` A."""
    main = calibration["main"]
    changed = replace(
        main, gain_factor=main.gain_factor * gain, zero=main.zero - zero / main.amperes_per_count / gain
    )
    return replace(calibration, channels={**calibration.channels, "main": changed})


def test_with_the_true_board_they_agree(flown):
    flight, record = flown
    check = against_counter(record, flight.glider, flight.board)
    assert check.source == "coulomb counter" and check.hours == pytest.approx(
        flight.counts.shape[0] * 0.032 / 3600, rel=0.01
    )
    # The simulated zero wanders by 0.2 counts, 10 mA of a mean of 230 mA.
    assert abs(check.ratio) < 0.05 and abs(check.gain) < 0.006 and abs(check.zero) < 0.011
    assert check.zero == pytest.approx(check.ratio * check.charge / (3600.0 * check.hours), abs=0.004)
    assert check.agrees and "%" in check.sentence()


@pytest.mark.parametrize(("gain", "zero"), [(1.05, 0.0), (1.0, 0.05), (0.97, -0.04)])
def test_a_planted_gain_and_zero_come_back_apart(flown, gain, zero):
    flight, record = flown
    before = against_counter(record, flight.glider, flight.board)
    check = against_counter(record, flight.glider, other(flight.board, gain, zero))
    assert check.gain - before.gain == pytest.approx(gain - 1.0, abs=0.006)
    assert check.zero - before.zero == pytest.approx(zero, abs=0.003)
    mean = check.charge / (3600.0 * check.hours)
    assert check.ratio - before.ratio == pytest.approx(gain - 1.0 + zero / mean, abs=0.005)


def test_disagreement_beyond_gain_and_zero_is_said(flown):
    flight, record = flown
    known = flight.board.with_zero("main", flight.board["main"].zero, 0.02)
    assert against_counter(record, flight.glider, other(known, 1.12)).agrees is False
    result = analyse_board(record, flight.glider, other(known, 1.12))
    assert any("more than twice" in w and "+1" in w for w in result.model.warnings)


def test_gaps_are_left_out_and_not_bridged(flown):
    flight, record = flown
    keep = np.ones(len(record.tick), dtype=bool)
    keep[9000:15000] = False
    keep[20_000:20_001] = False
    holed = BoardRecord(
        record.channels,
        record.tick[keep],
        record.epoch[keep],
        record.counts[keep],
        record.flags[keep],
        record.clock,
        "holed",
    )
    charge, covered = board_charges(holed, flight.glider.time, flight.board)
    whole, all_covered = board_charges(record, flight.glider.time, flight.board)
    np.testing.assert_allclose(charge[covered], whole[covered], rtol=0.02, atol=0.02)
    lost = all_covered.sum() - covered.sum()
    assert lost == pytest.approx(6000 * 0.032 / PLAN.cycle, abs=3)
    assert abs(against_counter(holed, flight.glider, flight.board).gain) < 0.01


def test_without_counter_or_overlap_there_is_no_comparison(flown):
    flight, record = flown
    bare = replace(flight.glider, charge=None, current=None)
    assert against_counter(record, bare, flight.board) is None
    later = replace(flight.glider, time=flight.glider.time + 1e6)
    assert against_counter(record, later, flight.board) is None
    current = against_counter(record, replace(flight.glider, charge=None), flight.board)
    assert current.source == "the glider's current" and abs(current.ratio) < 0.05


class TestSteadyLoad:
    def test_it_is_the_counters_where_the_boards_zero_is_unknown(self, flown):
        flight, record = flown
        model = analyse_board(record, flight.glider, nominal()).model
        hotel, surface = model.estimates[fits.HOTEL], model.estimates[fits.SURFACE]
        assert hotel.value == pytest.approx(PLAN.hotel, rel=0.01)
        assert hotel.sigma == pytest.approx(COUNTER_SD * PLAN.hotel, rel=0.1)
        assert surface.value == pytest.approx(PLAN.surface, rel=0.02)
        assert "coulomb counter" in model.gains.source
        assert not any("zero of the main sensor" in w for w in model.warnings)

    def test_it_is_the_boards_where_its_zero_is_known_better(self, flown):
        flight, record = flown
        known = flight.board.with_zero("main", flight.board["main"].zero, 0.02)
        known = replace(known, channels={**known.channels, "main": replace(known["main"], drift_sd=0.0)})
        model = analyse_board(record, flight.glider, known, bench=0.005).model
        assert "coulomb counter" not in model.gains.source
        assert model.estimates[fits.HOTEL].value == pytest.approx(PLAN.hotel, abs=0.15)

    def test_without_the_gliders_current_it_is_the_boards(self, flown):
        flight, record = flown
        result = analyse_board(record, replace(flight.glider, current=None, charge=None), flight.board)
        assert result.check is None and "coulomb counter" not in result.model.gains.source

    def test_pump_and_brake_do_not_change(self, flown):
        flight, record = flown
        with_counter = analyse_board(record, flight.glider, flight.board).model
        without = analyse_board(record, replace(flight.glider, current=None, charge=None), flight.board).model
        for name in (fits.INTERCEPT, fits.SLOPE, fits.CLIMB, fits.BRAKE):
            assert with_counter.estimates[name] == without.estimates[name]

    def test_servo_cycles_are_left_out_and_their_power_is_told(self, flown):
        flight, record = flown
        result = analyse_board(record, flight.glider, nominal())
        with_servos = {level.phase: level.mean for level in steady_levels(flight.glider)}
        hotel = result.model.estimates[fits.HOTEL].value
        # A burst of 0.25 A for 0.32 to 0.96 s each 47 s.
        assert 0.03 < result.servos < 0.10
        assert with_servos["submerged"] - hotel == pytest.approx(result.servos, rel=0.5)


def test_the_current_that_trails_a_change_of_phase_belongs_to_neither():
    from glider_jax.board.events import GliderRecord

    time = np.arange(0.0, 4000.0, 4.0) + 1e9
    cycle = (time - time[0]) % 1000.0
    depth = np.where(cycle < 300.0, 0.0, 20.0 - np.abs(cycle - 650.0) / 350.0 * 20.0)
    load = np.where(depth < 1.5, 0.5, 0.1)
    trailing = np.concatenate([load[:1], load[:1], load[:-2]])
    levels = {
        level.phase: level.mean
        for level in steady_levels(
            GliderRecord(time, depth, np.full(time.size, 14.0), trailing, volume=np.zeros(time.size))
        )
    }
    assert levels["submerged"] == pytest.approx(1.4, abs=1e-9)
    assert levels["surface"] == pytest.approx(7.0, abs=1e-9)


@pytest.mark.parametrize("cycles", [0, 1, 2])
def test_a_trailing_current_is_moved_back(flown, cycles):
    flight, record = flown
    glider = flight.glider
    # The simulated current already ends its cycle at the row.
    trailing = np.concatenate(
        [np.full(cycles, glider.current[0]), glider.current[: glider.current.size - cycles]]
    )
    check = against_counter(record, replace(glider, current=trailing), flight.board)
    assert check.lag == pytest.approx(cycles * PLAN.cycle, abs=0.6 * PLAN.cycle)
    assert abs(check.gain) < 0.01
