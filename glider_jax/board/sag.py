"""Battery voltage at the board's samples: the glider's record between its rows, and the sag under load; NumPy only.

A glider samples its voltage each few seconds, a brake pulls its current for one. Board and record together tell the
apparent resistance of the battery, and with it the voltage at every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration
from glider_jax.board.counter import board_charges
from glider_jax.board.events import GliderRecord, interpolate
from glider_jax.board.record import BoardRecord
from glider_jax.board.robust import robust_fit

_HALF_WINDOW = 0.2
_REACH = 15
_LEAST_ROWS = 50
_LEAST_SIGNIFICANCE = 5.0
_LARGEST = 2.0
_LONGEST = 900.0


@dataclass(frozen=True)
class Voltage:
    """Voltage of the battery at any time.

    ``time`` s and ``unloaded`` V, (row,), what the battery would give without load; ``resistance`` ohm, apparent, 0
    where the record does not tell; ``main`` the board's rows of the main channel; ``fixed`` V where nothing was
    recorded.
    """

    time: NDArray[np.float64]
    unloaded: NDArray[np.float64]
    resistance: float
    main: BoardRecord | None
    zero: float
    amperes_per_count: float
    fixed: float | None

    def at(self, record: BoardRecord, epoch: int, rows: slice) -> NDArray[np.float64]:
        """Voltage at some rows of a channel, V; NaN far from anything recorded."""
        utc = record.utc(rows)
        if self.time.size == 0:
            volts = np.full(utc.size, np.nan)
        else:
            volts = interpolate(utc, self.time, self.unloaded, _LONGEST)
        if self.resistance > 0.0 and self.main is not None and utc.size:
            ticks = record.tick[rows]
            near = self.main.rows_between(
                epoch, int(ticks[0]) - self.main.stride, int(ticks[-1]) + self.main.stride
            )
            counts = self.main.counts[near, self.main.column("main")].astype(np.float64)
            if counts.size:
                current = (
                    np.interp(ticks, self.main.tick[near], counts) - self.zero
                ) * self.amperes_per_count
                volts = volts - self.resistance * current
        return np.where(np.isfinite(volts), volts, np.nan if self.fixed is None else self.fixed)


def battery_voltage(
    record: BoardRecord, glider: GliderRecord | None, calibration: Calibration, fixed: float | None = None
) -> Voltage:
    """Find the apparent resistance from the glider's voltage and the board's main current at the same moments.

    A slow or filtered voltage shows less sag than there is, and the correction is then smaller than the truth. The zero
    of the main sensor drops out.

    Parameters
    ----------
    glider : the same flight; None where only ``fixed`` V is known.
    """
    empty = np.empty(0)
    if glider is None:
        return Voltage(empty, empty, 0.0, None, 0.0, 0.0, fixed)
    time, volts = glider.time, glider.voltage
    plain = Voltage(time, volts, 0.0, None, 0.0, 0.0, fixed)
    if "main" not in record.channels or time.size < _LEAST_ROWS:
        return plain
    if float(np.diff(time).min()) <= 2.0 * _HALF_WINDOW:
        return plain
    edges = np.stack([time - _HALF_WINDOW, time + _HALF_WINDOW], axis=1).reshape(-1)
    charge, covered = board_charges(record, edges, calibration)
    current = charge[::2] / (2.0 * _HALF_WINDOW)
    known = covered[::2] & np.isfinite(volts)
    if np.count_nonzero(known) < _LEAST_ROWS:
        return plain
    sag, load = _above_usual(volts[known]), _above_usual(current[known])
    if float(load.std()) <= 0.0:
        return plain
    fit = robust_fit(load[:, None], sag, np.full(sag.size, 1e-3))
    resistance, sd = -float(fit.theta[0]), float(fit.sigma()[0])
    if not _LEAST_SIGNIFICANCE * sd < resistance < _LARGEST:
        return plain
    main, channel = record.only("main"), calibration["main"]
    return Voltage(
        time[known],
        volts[known] + resistance * current[known],
        resistance,
        main,
        channel.zero,
        channel.amperes_per_count,
        fixed,
    )


def _above_usual(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values above the running median of the rows around them: slow changes of charge and load drop out."""
    padded = np.pad(values, _REACH, mode="edge")
    return values - np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _REACH + 1), axis=1)
