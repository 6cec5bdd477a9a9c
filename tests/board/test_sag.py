"""Voltage at the board's samples: the resistance is found, and a short pulse is paid at the voltage it had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.board import motors
from glider_jax.board.calibration import nominal
from glider_jax.board.decoder import decode_bytes
from glider_jax.board.record import collect
from glider_jax.board.revision2 import Setup, sample
from glider_jax.board.sag import battery_voltage
from glider_jax.board.simulate import Plan, simulate

PLAN = Plan(depths=(15.0, 40.0, 60.0, 30.0), resistance=0.3, voltage_gain_sd=0.0, brake_scatter=0.0)


@pytest.fixture(scope="module")
def flown():
    flight = simulate(PLAN, 2)
    batch, report = decode_bytes(flight.encode())
    return flight, collect([batch], "sim", report.as_dict())


@pytest.mark.parametrize("calibration", ["true", "nominal"])
def test_the_resistance_is_found_whatever_the_zero(flown, calibration):
    flight, record = flown
    chosen = flight.board if calibration == "true" else nominal()
    gain = chosen["main"].amperes_per_count / flight.board["main"].amperes_per_count
    assert battery_voltage(record, flight.glider, chosen).resistance == pytest.approx(0.3 / gain, rel=0.02)


def test_voltage_falls_within_a_pulse_between_two_rows(flown):
    flight, record = flown
    event = next(
        e for e in motors.events_from_board(record, flight.glider, flight.board) if e.kind == "brake_unlock"
    )
    first = int(round((event.time - PLAN.start) / 0.032))
    rows = slice(first, first + 10)
    true = PLAN.voltage - PLAN.resistance * flight.currents["main"][rows]
    found = battery_voltage(record, flight.glider, flight.board).at(record, 0, rows)
    assert found == pytest.approx(true, abs=0.08)
    plain = battery_voltage(
        record, replace(flight.glider, voltage=np.full(flight.glider.time.size, 14.8)), flight.board
    )
    assert plain.resistance == 0.0 and np.abs(plain.at(record, 0, rows) - true).max() > 0.5


def test_the_brake_is_paid_at_its_own_voltage(flown):
    flight, record = flown
    events = motors.events_from_board(record, flight.glider, flight.board)
    halves = [e.energy for e in events if e.kind.startswith("brake")]
    assert len(halves) == 16
    assert np.mean(halves) == pytest.approx(0.5 * PLAN.brake, rel=0.006)


def test_a_filtered_voltage_corrects_less_and_never_the_wrong_way(flown):
    flight, record = flown
    slow = np.copy(flight.glider.voltage)
    for row in range(1, slow.size):
        slow[row] = 0.8 * slow[row - 1] + 0.2 * flight.glider.voltage[row]
    found = battery_voltage(record, replace(flight.glider, voltage=slow), flight.board).resistance
    assert 0.0 <= found < 0.3


def test_without_the_main_channel_the_recorded_voltage_stands(flown):
    flight, _ = flown
    setup = Setup(dividers=(0, 0, 0, 1, 1, 1, 1, 1))
    batch, report = decode_bytes(sample(setup, flight.counts, 1, flight.utc_ms)[0])
    record = collect([batch], "bare", report.as_dict())
    assert battery_voltage(record, flight.glider, flight.board).resistance == 0.0
    assert sum(e.kind == "pump" for e in motors.events_from_board(record, flight.glider, flight.board)) == 8


def test_a_slow_main_channel_still_gives_the_sag(flown):
    flight, _ = flown
    setup = Setup(dividers=(4, 0, 0, 1, 1, 1, 1, 1))
    batch, report = decode_bytes(sample(setup, flight.counts, 1, flight.utc_ms)[0])
    record = collect([batch], "mixed", report.as_dict())
    assert battery_voltage(record, flight.glider, flight.board).resistance == pytest.approx(0.3, rel=0.06)
    halves = [
        e.energy for e in motors.events_from_board(record, flight.glider, flight.board) if "brake" in e.kind
    ]
    assert np.mean(halves) == pytest.approx(0.5 * PLAN.brake, rel=0.015)
