"""Motor events in board samples: each motor has its own channel, 31 samples a second; NumPy only.

The zero of a channel is taken from the seconds before and after each event, while its motor rests, so that
the drift of
the sensor drops out. Current at the battery times the voltage that the glider recorded, interpolated, is
the power.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration
from glider_jax.board.events import Event, GliderRecord, _runs, direction_of, interpolate, pair_inflections
from glider_jax.board.record import BoardRecord
from glider_jax.board.steady import Level, mean_of_blocks, phases
from glider_jax.errors import DataError

_MARGIN = 0.3
_REST = 3.0
_PIECE = 1 << 18
VOLTAGE_SD = 0.05


@dataclass(frozen=True)
class Motor:
    """How a motor is recognised: its channels, the current that counts as running (A), and times in s.

    Runs closer than ``join`` are one event, shorter than ``least`` are spikes of noise.
    """

    kind: str
    channels: tuple[str, ...]
    threshold: float
    join: float
    least: float


MOTORS = (
    Motor("pump", ("pump_a", "pump_b"), 0.15, 1.0, 1.0),
    Motor("brake", ("brake",), 0.06, 0.3, 0.1),
    Motor("pitch", ("pitch",), 0.05, 0.5, 0.1),
    Motor("fin", ("fin",), 0.05, 0.5, 0.1),
)


def _running(record: BoardRecord, motor: Motor, calibration: Calibration) -> NDArray[np.bool_]:
    """(sample,) whether a motor runs, from means of four samples against the usual level of the channel."""
    out = np.zeros(len(record.tick), dtype=bool)
    kernel = np.full(4, 0.25)
    for begin in range(0, len(record.tick), _PIECE):
        end = min(begin + _PIECE, len(record.tick))
        low, high = max(begin - 8, 0), min(end + 8, len(record.tick))
        total = np.zeros(high - low)
        for name in motor.channels:
            counts = record.counts[low:high, record.column(name)].astype(np.float64)
            total += (counts - np.median(counts)) * calibration[name].amperes_per_count
        smooth = np.convolve(total, kernel, mode="same") if total.size >= 4 else total
        out[begin:end] = (np.abs(smooth) > motor.threshold)[begin - low : begin - low + end - begin]
    return out


def _joined(record: BoardRecord, mask: NDArray[np.bool_], motor: Motor) -> NDArray[np.int64]:
    runs = _runs(mask)
    if len(runs) == 0:
        return runs
    tick, epoch = record.tick, record.epoch
    between = (tick[runs[1:, 0]] - tick[runs[:-1, 1] - 1]) * record.period
    apart = (between > motor.join) | (epoch[runs[1:, 0]] != epoch[runs[:-1, 0]])
    cut = np.flatnonzero(apart)
    starts = runs[np.concatenate([[0], cut + 1]), 0]
    ends = runs[np.concatenate([cut, [len(runs) - 1]]), 1]
    length = (tick[ends - 1] - tick[starts] + 1) * record.period
    return np.stack([starts, ends], axis=1)[length >= motor.least]


def events_from_board(
    record: BoardRecord,
    glider: GliderRecord | None,
    calibration: Calibration,
    voltage: float | None = None,
    motors: tuple[Motor, ...] = MOTORS,
) -> list[Event]:
    """Brake, pump and servo events with their energies.

    Parameters
    ----------
    record : samples with UTC, or with ticks from the same zero as ``glider``'s time.
    glider : depth, voltage and pumped volume; None if there is none.
    calibration : of the board.
    voltage : V, used where the glider recorded none.

    Raises
    ------
    DataError : a channel is missing or saturated, or no voltage is known.
    """
    if glider is None and voltage is None:
        raise DataError(
            f"{record.name}: expected the battery voltage, found none. Give the glider's recording or --voltage."
        )
    events: list[Event] = []
    for motor in motors:
        for name in motor.channels:
            record.require_usable(name)
        mask = _running(record, motor, calibration)
        for start, end in _joined(record, mask, motor):
            event = _measure(record, glider, calibration, voltage, motor, mask, int(start), int(end))
            if event is not None:
                events.append(event)
    return pair_inflections(events)


def _measure(
    record: BoardRecord,
    glider: GliderRecord | None,
    calibration: Calibration,
    voltage: float | None,
    motor: Motor,
    mask: NDArray[np.bool_],
    start: int,
    end: int,
) -> Event | None:
    """Integrate one event above its own zero."""
    period = record.period
    margin, rest = int(_MARGIN / period), int(_REST / period)
    low, high = max(start - margin, 0), min(end + margin, len(record.tick))
    around = np.r_[max(low - rest, 0) : low, high : min(high + rest, len(record.tick))]
    around = around[~mask[around] & (record.epoch[around] == record.epoch[start])]
    near = np.abs(record.tick[around] - record.tick[start]) * period < (end - start) * period + 4 * _REST
    around = around[near]
    if around.size < 8:
        return None
    inside = slice(low, high)
    current = np.zeros(high - low)
    variance = 0.0
    for name in motor.channels:
        channel, column = calibration[name], record.column(name)
        counts = record.counts[inside, column].astype(np.float64)
        resting = record.counts[around, column].astype(np.float64)
        noise = max(float(resting.std()), 12**-0.5)
        current += (counts - resting.mean()) * channel.amperes_per_count
        scale = channel.amperes_per_count * noise * period
        variance += scale**2 * counts.size * (1.0 + counts.size / around.size)
    ticks = record.tick[inside]
    charge = float(current.sum() * period)
    utc = record.utc(inside)
    if glider is not None:
        volts = interpolate(utc, glider.time, glider.voltage, 900.0)
        volts = np.where(np.isfinite(volts), volts, np.nan if voltage is None else voltage)
    else:
        volts = np.full(utc.size, voltage, dtype=np.float64)
    energy = float((current * volts).sum() * period)
    mean_voltage = float(volts.mean())
    sd = float(np.hypot(variance**0.5 * mean_voltage, abs(charge) * VOLTAGE_SD))
    depth = volume = float("nan")
    sinking = True
    begin_utc, end_utc = float(utc[margin] if utc.size > margin else utc[0]), float(utc[-1])
    if glider is not None:
        depths = interpolate(np.array([begin_utc - 30.0, begin_utc]), glider.time, glider.depth, 60.0)
        depth, sinking = float(depths[1]), bool(depths[1] > depths[0])
        if glider.volume is not None and motor.kind == "pump":
            moved = interpolate(np.array([begin_utc - 8.0, end_utc + 8.0]), glider.time, glider.volume, 60.0)
            volume = float(moved[1] - moved[0])
    return Event(
        kind=motor.kind,
        direction=direction_of(volume, depth, sinking) if motor.kind == "pump" else "",
        time=begin_utc,
        duration=float((record.tick[end - 1] - record.tick[start] + 1) * period),
        depth=depth,
        volume=volume,
        peak=float(current[np.argmax(np.abs(current))]),
        charge=charge,
        energy=energy,
        energy_sd=sd,
        voltage=mean_voltage,
        complete=bool(ticks[-1] - ticks[0] + 1 == ticks.size),
    )


def board_levels(
    record: BoardRecord, glider: GliderRecord, calibration: Calibration, second: float = 1.0
) -> tuple[list[Level], float]:
    """Steady load by phase from the main channel while no motor runs.

    Returns
    -------
    Levels, and the 1-sigma in W that the zero of the main sensor adds to all of them: on a 20 A sensor it
    is as large as
    the load itself unless its zero was measured on the bench.
    """
    record.require_usable("main")
    size = max(int(second / record.period), 1)
    busy = np.zeros(len(record.tick), dtype=bool)
    for motor in MOTORS:
        busy |= _running(record, motor, calibration)
    whole = len(record.tick) // size * size
    quiet = ~busy[:whole].reshape(-1, size).any(axis=1)
    # A second on either side belongs to the motor's start and stop.
    quiet &= np.roll(quiet, 1) & np.roll(quiet, -1)
    column = record.column("main")
    counts = np.empty(whole // size)
    for begin in range(0, whole, size * 4096):
        end = min(begin + size * 4096, whole)
        counts[begin // size : end // size] = record.counts[begin:end, column].reshape(-1, size).mean(axis=1)
    channel = calibration["main"]
    current = (counts - channel.zero) * channel.amperes_per_count
    time = record.utc(np.arange(0, whole, size)) + 0.5 * size * record.period
    volts = interpolate(time, glider.time, glider.voltage, 900.0)
    depth = interpolate(time, glider.time, glider.depth, 60.0)
    smooth = GliderRecord(time, depth, volts)
    phase = phases(smooth.time, smooth.depth)
    power = current * volts
    usable = quiet & np.isfinite(power)
    out = []
    for name, rows in [
        ("submerged", usable & ((phase == "dive") | (phase == "climb"))),
        *((p, usable & (phase == p)) for p in ("dive", "climb", "surface")),
    ]:
        if rows.sum() * second < 60.0:
            continue
        weight = np.ones(int(rows.sum()))
        mean, sd = mean_of_blocks(time[rows], power[rows], weight, np.zeros(weight.size, dtype=np.int64))
        median, floor = float(np.median(power[rows])), float(np.percentile(power[rows], 5))
        out.append(Level(name, "", mean, sd, median, floor, float(rows.sum() * second)))
    drift = 10.0 * channel.drift_sd
    zero = float(np.hypot(channel.zero_sd, drift) * channel.amperes_per_count * np.nanmean(volts))
    return out, zero
