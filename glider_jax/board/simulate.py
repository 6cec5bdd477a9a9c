"""A mission as the board and the glider would record it, from an energy model that is known; NumPy only.

For tests, for the emulator and for planning what a recording can tell: yos between given depths, at each
inflection the
brake unlocks, the pump moves, the brake locks; servos twitch; the main sensor sees the sum.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration, nominal
from glider_jax.board.events import GliderRecord
from glider_jax.board.frames import CHANNELS_6, CHANNELS_8, FULL_SCALE, TICK, encode_revision_1
from glider_jax.errors import ConfigError


@dataclass(frozen=True)
class Plan:
    """What is flown and what it costs.

    ``intercept`` J, ``slope`` J m-1, ``climb`` J, ``brake`` J per inflection (both actions), ``hotel`` W,
    ``surface`` W on top
    of it; ``scatter`` J of single strokes and ``brake_scatter`` J. ``depths`` (yo,) m at which dives turn.
    ``volume`` m3 per
    stroke, ``speed`` vertical m s-1, ``voltage`` open-circuit V at the start, ``sag`` V per day,
    ``resistance`` ohm.
    ``voltage_gain_sd`` and ``counter_gain_sd`` relative errors of the voltage and current that the glider records,
    drawn once; ``counter_step`` C of its charge counter, ``current_noise`` A of single recorded currents.
    """

    depths: tuple[float, ...] = tuple(np.linspace(12.0, 95.0, 24))
    intercept: float = 110.0
    slope: float = 6.0
    climb: float = 85.0
    brake: float = 45.0
    hotel: float = 1.6
    surface: float = 2.5
    scatter: float = 10.0
    brake_scatter: float = 3.0
    volume: float = 460e-6
    speed: float = 0.25
    voltage: float = 14.8
    sag: float = 0.05
    resistance: float = 0.2
    surface_time: float = 180.0
    start: float = 1_265_000_000.0
    channels: int = 8
    cycle: float = 4.5
    voltage_gain_sd: float = 0.003
    counter_gain_sd: float = 0.02
    counter_step: float = 4.29
    current_noise: float = 0.003


@dataclass(frozen=True)
class Flight:
    """A simulated flight: ``counts`` (tick, channel), ``utc_ms`` (tick,), the glider's own record and what
    is true.

    ``truth`` maps the fitted quantities' names to the values flown; ``board`` is the calibration that made
    the counts,
    with its true gains and zeros.
    """

    channels: tuple[str, ...]
    counts: NDArray[np.uint16]
    utc_ms: NDArray[np.int64]
    glider: GliderRecord
    truth: dict[str, float]
    board: Calibration
    currents: dict[str, NDArray[np.float32]] = field(default_factory=dict)

    def encode(self, boot: int = 1) -> bytes:
        """The flight as a revision 1 stream."""
        return encode_revision_1(self.counts, boot=boot, utc_ms=self.utc_ms)


def true_board(calibration: Calibration, rng: np.random.Generator) -> Calibration:
    """Draw a board: gains and zeros within the stated uncertainty of a calibration."""
    channels = {
        name: replace(
            channel,
            zero=channel.zero + rng.normal(0.0, channel.zero_sd),
            gain_factor=channel.gain_factor * (1.0 + rng.normal(0.0, channel.gain_sd)),
        )
        for name, channel in calibration.channels.items()
    }
    return replace(calibration, channels=channels, source="simulated")


def _pulse(total: float, ticks: int, rush: float) -> NDArray[np.float64]:
    """Charge per tick of a motor that starts with an inrush, then runs steadily; sums to ``total``."""
    shape = 1.0 + rush * np.exp(-np.arange(ticks) / 6.0)
    shape[-3:] *= np.array([0.9, 0.6, 0.3]) if ticks > 6 else 1.0
    return total * shape / shape.sum()


def simulate(plan: Plan, seed: int = 0, stated: Calibration | None = None) -> Flight:
    """Fly a plan.

    Parameters
    ----------
    plan : what is flown.
    seed : of all draws.
    stated : what the user will believe of the board; the true board is drawn within its uncertainty.
    """
    if min(plan.depths) < 4.0:
        raise ConfigError(f"plan: depths: expected turns at 4 m or deeper, found {min(plan.depths):g} m.")
    rng = np.random.default_rng(seed)
    names = CHANNELS_8 if plan.channels == 8 else CHANNELS_6
    stated = stated or nominal(names)
    board = true_board(stated, rng)
    top, stroke, brake_time, wait = 2.0, 20.0, 0.9, 0.4
    turn = 2 * brake_time + 2 * wait + stroke
    # Depth against time at corners: surface, then down and up for each yo, with the turn spent at its depth.
    corner_time, corner_depth, turns = [0.0, plan.surface_time], [0.0, 0.0], []
    for depth in plan.depths:
        for target, down in ((depth, True), (top, False)):
            corner_time.append(corner_time[-1] + max(abs(target - corner_depth[-1]) / plan.speed, 1.0))
            corner_depth.append(target)
            turns.append((corner_time[-1], target, down))
            corner_time.append(corner_time[-1] + turn)
            corner_depth.append(target + (0.4 if down else -0.2))
    corner_time += [
        corner_time[-1] + top / plan.speed,
        corner_time[-1] + top / plan.speed + plan.surface_time,
    ]
    corner_depth += [0.0, 0.0]
    ticks = int(corner_time[-1] / TICK)
    time = np.arange(ticks) * TICK
    depth = np.interp(time, corner_time, corner_depth)
    open_circuit = plan.voltage - plan.sag * time / 86_400.0
    steady = plan.hotel + np.where(depth < 1.5, plan.surface, 0.0)
    # The current at which the sagging voltage gives the power.
    load = 2.0 * steady / (open_circuit + np.sqrt(open_circuit**2 - 4.0 * plan.resistance * steady))
    motors = {name: np.zeros(ticks, dtype=np.float32) for name in ("pump", "brake", "pitch", "fin")}
    volume = np.zeros(ticks, dtype=np.float32)
    position = 0.5 * plan.volume
    volume += position
    volts = open_circuit - plan.resistance * load
    for when, at, down in turns:
        first = int(when / TICK)
        brake_ticks, pump_ticks = int(brake_time / TICK), int(stroke / TICK)
        pump_first = first + brake_ticks + int(wait / TICK)
        lock_first = pump_first + pump_ticks + int(wait / TICK)
        mean = plan.intercept + plan.slope * at if down else plan.climb
        share = plan.scatter / 10.0 if not down else plan.scatter
        energy = max(mean + rng.normal(0.0, share), 0.05 * mean)
        cost = max(plan.brake + rng.normal(0.0, plan.brake_scatter), 1.0)
        for place, begin, count, joules, rush in (
            ("brake", first, brake_ticks, 0.5 * cost, 1.0),
            ("pump", pump_first, pump_ticks, energy, 0.6),
            ("brake", lock_first, brake_ticks, 0.5 * cost, 1.0),
        ):
            part = slice(begin, begin + count)
            current = _pulse(1.0, count, rush) / TICK
            # Scale so that current times the sagging voltage integrates to the energy.
            scale = joules / float((current * open_circuit[part]).sum() * TICK)
            for _ in range(4):
                sagged = open_circuit[part] - plan.resistance * (load[part] + scale * current)
                scale = joules / float((current * sagged).sum() * TICK)
            motors[place][part] += (scale * current).astype(np.float32)
            volts[part] = open_circuit[part] - plan.resistance * (load[part] + scale * current)
        change = plan.volume if down else -plan.volume
        change = change if (down and position < 0) or (not down and position > 0) else 0.0
        if down and position > 0:
            # The first dive needs no stroke before it in this plan: the pump starts drawn in.
            volume[:pump_first] = -0.5 * plan.volume
            position, change = -0.5 * plan.volume, plan.volume
        ramp = position + change * np.clip((np.arange(pump_first, ticks) - pump_first) / pump_ticks, 0.0, 1.0)
        volume[pump_first:] = ramp
        position += change
        _servo(motors["pitch"], lock_first + int(3.0 / TICK), 40, 0.35 if down else -0.35)
    for when in np.arange(60.0, time[-1] - 60.0, 47.0):
        _servo(motors["fin"], int(when / TICK), int(rng.integers(10, 30)), float(rng.choice([-0.25, 0.25])))
    main = load + sum(np.abs(current) for current in motors.values())
    split = 0.5 + rng.normal(0.0, 0.01)
    currents = {
        "main": main,
        "external": np.zeros(ticks),
        "emergency": np.zeros(ticks),
        "pump_a": split * motors["pump"],
        "pump_b": (1 - split) * motors["pump"],
        "brake": motors["brake"],
        "pitch": motors["pitch"],
        "fin": motors["fin"],
    }
    counts = np.empty((ticks, len(names)), dtype=np.uint16)
    for column, name in enumerate(names):
        channel = board[name]
        per_count = channel.amperes_per_count
        noise = channel.sensor.noise * 1024.0 / 5.0
        wander = 0.2 * np.sin(2 * np.pi * time / 43_200.0 + rng.uniform(0, 6.28))
        reading = channel.zero + wander + currents[name] / per_count + rng.normal(0.0, noise, ticks)
        counts[:, column] = np.clip(np.rint(reading), 0, FULL_SCALE).astype(np.uint16)
    rows = np.arange(0, ticks, int(plan.cycle / TICK))
    utc = plan.start + time
    averaged = np.add.reduceat(main, rows) / np.diff(np.append(rows, ticks))
    glider = GliderRecord(
        time=utc[rows],
        depth=depth[rows] + rng.normal(0.0, 0.03, rows.size),
        voltage=volts[rows] * (1.0 + rng.normal(0.0, plan.voltage_gain_sd))
        + rng.normal(0.0, 0.01, rows.size),
        current=np.concatenate([averaged[:1], averaged[:-1]]),
        volume=volume[rows].astype(np.float64),
        moving=np.abs(motors["pump"])[rows] > 0.02,
        name="simulated",
    )
    counted = glider.current * (1.0 + rng.normal(0.0, plan.counter_gain_sd))
    charge = np.cumsum(counted * np.diff(glider.time, prepend=glider.time[0]))
    recorded = counted + rng.normal(0.0, plan.current_noise, counted.size)
    glider = replace(
        glider, current=recorded, charge=np.floor(charge / plan.counter_step) * plan.counter_step
    )
    truth = {
        "energy.pump_dive_to_climb.intercept": plan.intercept,
        "energy.pump_dive_to_climb.slope": plan.slope,
        "energy.pump_climb_to_dive": plan.climb,
        "energy.brake": plan.brake,
        "energy.hotel": plan.hotel,
        "energy.surface": plan.surface,
    }
    utc_ms = np.rint(utc * 1000.0).astype(np.int64)
    kept = {name: np.asarray(currents[name], dtype=np.float32) for name in names}
    return Flight(names, counts, utc_ms, glider, truth, board, kept)


def _servo(current: NDArray[np.float32], start: int, count: int, amperes: float) -> None:
    """A servo burst, if it lies within the flight."""
    if 0 < start and start + count < current.size:
        current[start : start + count] += amperes
