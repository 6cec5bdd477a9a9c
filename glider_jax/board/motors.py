"""Motor events in board samples: each motor has its own channel, 31 samples a second; NumPy only.

The zero of a channel is taken from the seconds before and after each event, while its motor rests, so that the drift of
the sensor drops out. Current at the battery times the voltage that the glider recorded, with its sag, is the power.
Channels may be sampled at different rates; each is integrated at its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration, undithered
from glider_jax.board.detect import Running, find_running, merge_runs, rest_level
from glider_jax.board.events import Event, GliderRecord, direction_of, interpolate, pair_inflections
from glider_jax.board.record import BoardRecord
from glider_jax.board.sag import Voltage, battery_voltage
from glider_jax.board.steady import Level, mean_of_blocks, phases, state_names
from glider_jax.errors import DataError

_MARGIN = 0.3
_REST = 3.0
_LEAST_REST = 8
VOLTAGE_SD = 0.05


@dataclass(frozen=True)
class Motor:
    """How a motor is recognised: its channels, and times in s.

    The current is averaged over ``smooth`` to tell it from noise; runs closer than ``join`` are one event, shorter ones
    than ``least`` are spikes.
    """

    kind: str
    channels: tuple[str, ...]
    smooth: float
    join: float
    least: float


MOTORS = (
    Motor("pump", ("pump_a", "pump_b"), 0.5, 1.0, 1.0),
    Motor("brake", ("brake",), 0.13, 0.3, 0.1),
    Motor("pitch", ("pitch",), 0.13, 0.5, 0.1),
    Motor("fin", ("fin",), 0.13, 0.5, 0.1),
)


def running(record: BoardRecord, motor: Motor, calibration: Calibration) -> Running:
    """When a motor ran.

    Raises
    ------
    DataError : a channel is missing or saturated.
    """
    for name in motor.channels:
        record.require_usable(name)
    alone = [record.only(name) for name in motor.channels]
    together = record.only(*motor.channels)
    if all(part.stride == together.stride for part in alone):
        return find_running(together, motor.channels, calibration, motor.smooth, motor.join, motor.least)
    parts = [
        find_running(part, (name,), calibration, motor.smooth, motor.join, motor.least)
        for part, name in zip(alone, motor.channels, strict=True)
    ]
    return merge_runs(parts, record.period, motor.join)


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
    supply = battery_voltage(record, glider, calibration, voltage)
    events: list[Event] = []
    for motor in motors:
        found = running(record, motor, calibration)
        parts = [_Part.of(record, name, calibration, found) for name in motor.channels]
        for epoch, first, last in zip(found.epoch, found.first, found.last, strict=True):
            events.append(_measure(parts, glider, supply, motor, int(epoch), int(first), int(last)))
    return pair_inflections(events)


@dataclass(frozen=True)
class _Part:
    """One channel of a motor at its own rate: its rows, which of them lie in a run, its scale and its level at rest."""

    record: BoardRecord
    column: int
    busy: NDArray[np.bool_]
    amperes_per_count: float
    noise: float
    knots: tuple[NDArray[np.float64], NDArray[np.float64]]

    @staticmethod
    def of(record: BoardRecord, name: str, calibration: Calibration, found: Running) -> _Part:
        own, channel = record.only(name), calibration[name]
        counts = channel.noise / channel.amperes_per_count
        knots = rest_level(own, name, channel.zero)
        return _Part(
            own, own.column(name), found.covers(own, _MARGIN), channel.amperes_per_count, counts, knots
        )

    def rest(self, epoch: int, first: int, last: int) -> tuple[float, float, int]:
        """Zero near a run, scatter of one sample about it and how many there were, in counts."""
        reach = int(_REST / self.record.period)
        window = self.record.rows_between(epoch, first - reach, last + reach)
        rows = np.arange(window.start, window.stop)[~self.busy[window]]
        if rows.size >= _LEAST_REST:
            values = self.record.counts[rows, self.column].astype(np.float64)
            return float(values.mean()), max(float(values.std()), 12**-0.5), rows.size
        # Too little rest beside the run: the level of the minutes around it stands in.
        middle = 0.5 * (window.start + window.stop)
        return float(np.interp(middle, *self.knots)), self.noise, _LEAST_REST


def _measure(
    parts: list[_Part],
    glider: GliderRecord | None,
    supply: Voltage,
    motor: Motor,
    epoch: int,
    first: int,
    last: int,
) -> Event:
    """Integrate one run above its own zero."""
    record = parts[0].record
    margin = int(_MARGIN / record.period)
    low, high = first - margin, last + margin
    charge = energy = variance = 0.0
    volts_seen, complete = [], True
    for part in parts:
        own = part.record
        rows = own.rows_between(epoch, low, high)
        ticks = own.tick[rows]
        if ticks.size == 0:
            complete = False
            continue
        zero, noise, count = part.rest(epoch, low, high)
        current = (own.counts[rows, part.column] - zero) * part.amperes_per_count
        volts = supply.at(own, epoch, rows)
        charge += float(current.sum() * own.spacing)
        energy += float((current * volts).sum() * own.spacing)
        scale = part.amperes_per_count * noise * own.spacing
        variance += scale**2 * ticks.size * (1.0 + ticks.size / count)
        # A current or zero too steady to dither the converter is known to a part of a count, however long it lasts.
        variance += 2.0 * (part.amperes_per_count * undithered(noise) * ticks.size * own.spacing) ** 2
        volts_seen.append(float(volts.mean()))
        # Whole if a sample at rest stands on either side and none is missing between.
        steps = np.diff(ticks)
        complete &= bool(ticks[0] < first and ticks[-1] > last and (steps.max(initial=0) <= own.stride))
    mean_voltage = float(np.mean(volts_seen)) if volts_seen else float("nan")
    sd = float(np.hypot(variance**0.5 * mean_voltage, abs(charge) * VOLTAGE_SD))
    begin_utc, end_utc = (float(u) for u in record.clock_at(epoch, [first, last]))
    depth = volume = float("nan")
    sinking = True
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
        duration=float((last - first) * record.period + record.spacing),
        depth=depth,
        volume=volume,
        peak=_peak(parts, epoch, low, high),
        charge=charge,
        energy=energy,
        energy_sd=sd,
        voltage=mean_voltage,
        complete=complete,
    )


def _peak(parts: list[_Part], epoch: int, first: int, last: int) -> float:
    """Largest current of all channels together, A, at the ticks at which all of them were sampled."""
    total: dict[int, float] = {}
    for number, part in enumerate(parts):
        rows = part.record.rows_between(epoch, first, last)
        zero = part.rest(epoch, first, last)[0]
        current = (part.record.counts[rows, part.column] - zero) * part.amperes_per_count
        ticks = part.record.tick[rows]
        if number == 0:
            total = dict(zip(ticks.tolist(), current.tolist(), strict=True))
        else:
            other = dict(zip(ticks.tolist(), current.tolist(), strict=True))
            total = {tick: value + other[tick] for tick, value in total.items() if tick in other}
    return max(total.values(), key=abs) if total else float("nan")


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
    runs = [running(record, motor, calibration) for motor in MOTORS]
    main = record.only("main")
    busy = np.zeros(len(main.tick), dtype=bool)
    for found in runs:
        busy |= found.covers(main, _MARGIN)
    size = max(int(second / main.spacing), 1)
    whole = len(main.tick) // size * size
    quiet = ~busy[:whole].reshape(-1, size).any(axis=1)
    # A second on either side belongs to the motor's start and stop.
    quiet &= np.roll(quiet, 1) & np.roll(quiet, -1)
    first = np.arange(0, whole, size)
    quiet &= main.tick[first + size - 1] - main.tick[first] == (size - 1) * main.stride
    column = main.column("main")
    counts = np.empty(whole // size)
    for begin in range(0, whole, size * 4096):
        end = min(begin + size * 4096, whole)
        counts[begin // size : end // size] = main.counts[begin:end, column].reshape(-1, size).mean(axis=1)
    channel = calibration["main"]
    current = (counts - channel.zero) * channel.amperes_per_count
    time = main.utc(first) + 0.5 * size * main.spacing
    volts = interpolate(time, glider.time, glider.voltage, 900.0)
    depth = interpolate(time, glider.time, glider.depth, 60.0)
    smooth = GliderRecord(time, depth, volts)
    phase = phases(smooth.time, smooth.depth)
    power = current * volts
    usable = quiet & np.isfinite(power)
    states = state_names(glider, time)
    out = []
    for name, rows in [
        ("submerged", usable & ((phase == "dive") | (phase == "climb"))),
        *((p, usable & (phase == p)) for p in ("dive", "climb", "surface")),
    ]:
        wanted = [("", rows)]
        if name != "submerged":
            wanted += [(state, rows & (states == state)) for state in sorted(set(states[rows]) - {""})]
        for state, some in wanted:
            if some.sum() * second < 60.0:
                continue
            weight = np.ones(int(some.sum()))
            mean, sd = mean_of_blocks(time[some], power[some], weight, np.zeros(weight.size, dtype=np.int64))
            median, floor = float(np.median(power[some])), float(np.percentile(power[some], 5))
            out.append(Level(name, state, mean, sd, median, floor, float(some.sum() * second)))
    drift = 10.0 * channel.drift_sd
    zero = float(np.hypot(channel.zero_sd, drift) * channel.amperes_per_count * np.nanmean(volts))
    return out, zero
