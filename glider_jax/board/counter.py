"""The board's main current against the glider's own coulomb counter, and the zero that this gives; NumPy only.

The zero of a 20 A Hall sensor is worth as much as the whole steady load, so the two charges can be compared only as far
as that zero is known. The strokes of the pump make the current vary tenfold: a line through means of a minute gives the
ratio of the gains without the zero, and the zero with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration
from glider_jax.board.events import GliderRecord, counter_step
from glider_jax.board.record import BoardRecord
from glider_jax.board.robust import robust_fit

# Relative 1-sigma of the counter's factor, judgement.
COUNTER_SD = 0.02
_PIECE = 1 << 20
_BLOCK = 60.0
_LEAST_BLOCKS = 10
# Cycles.
_LONGEST_LAG = 3.0


@dataclass(frozen=True)
class CounterCheck:
    """Board against counter over the time that both cover.

    ``ratio`` is the board's charge over the counter's, less one, and ``sigma`` what gain, zero and the size of a count
    allow. ``gain`` is the same without the zero, from a line through means of a minute, with ``gain_sd`` of the line,
    after the glider's current was moved back by ``lag`` s;
    ``zero`` A is what the board reads when the glider draws nothing, with ``zero_sd``. NaN where the current varied too
    little. ``gain_limit`` is the 1-sigma of both gains together. ``charge`` C by the counter, ``hours`` compared.
    """

    ratio: float
    sigma: float
    gain: float
    gain_sd: float
    zero: float
    zero_sd: float
    gain_limit: float
    lag: float
    charge: float
    hours: float
    source: str

    @property
    def agrees(self) -> bool:
        """Whether board and counter agree within twice their uncertainty, with and without the zero."""
        gains = not np.isfinite(self.gain) or abs(self.gain) <= 2.0 * float(
            np.hypot(self.gain_limit, self.gain_sd)
        )
        return gains and abs(self.ratio) <= 2.0 * self.sigma

    def sentence(self) -> str:
        """The comparison in words."""
        percent = f"{100 * self.ratio:+.2f} +- {100 * self.sigma:.2f} %"
        text = f"board against {self.source}: {percent} over {self.hours:.1f} h"
        if np.isfinite(self.gain):
            text += (
                f"; without the zero {100 * self.gain:+.2f} +- {100 * self.gain_sd:.2f} %, "
                f"zero {1e3 * self.zero:+.1f} +- {1e3 * self.zero_sd:.1f} mA"
            )
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON; None for what is not known."""
        numbers = {
            "ratio_less_one": self.ratio,
            "sigma": self.sigma,
            "gain_less_one": self.gain,
            "gain_sigma": self.gain_sd,
            "zero_a": self.zero,
            "zero_sigma_a": self.zero_sd,
            "lag_s": self.lag,
            "charge_c": self.charge,
            "hours": self.hours,
        }
        return {key: (value if np.isfinite(value) else None) for key, value in numbers.items()} | {
            "against": self.source
        }


def board_charges(
    record: BoardRecord, time: NDArray[np.float64], calibration: Calibration
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Charge through the main sensor between neighbouring times.

    Parameters
    ----------
    time : (row,) s since 1970, ascending.

    Returns
    -------
    Charge C, (row - 1,), and which intervals the board covers without a gap.
    """
    main, channel = record.only("main"), calibration["main"]
    column = main.column("main")
    total, number = np.zeros(time.size + 1), np.zeros(time.size + 1)
    for begin in range(0, len(main.tick), _PIECE):
        rows = slice(begin, min(begin + _PIECE, len(main.tick)))
        at = np.searchsorted(time, main.utc(rows), side="right")
        counts = main.counts[rows, column].astype(np.float64)
        total += np.bincount(at, weights=counts, minlength=time.size + 1)
        number += np.bincount(at, minlength=time.size + 1)
    total, number = total[1:-1], number[1:-1]
    step = np.diff(time)
    # The ends of an interval fall between two samples.
    covered = (number > 0) & (np.abs(number * main.spacing - step) <= 1.5 * main.spacing)
    mean = (total / np.maximum(number, 1.0) - channel.zero) * channel.amperes_per_count
    return mean * step, covered


def against_counter(
    record: BoardRecord, glider: GliderRecord, calibration: Calibration
) -> CounterCheck | None:
    """Compare a board with the counter of the glider that carried it; None if the glider recorded neither charge nor
    current, or the two share less than ten minutes.

    Parameters
    ----------
    record : with the channel ``main``. glider : the same flight.
    """
    if "main" not in record.channels or glider.time.size < 3:
        return None
    if glider.charge is None and glider.current is None:
        return None
    step = np.diff(glider.time)
    charge, usable = board_charges(record, glider.time, calibration)
    usable &= step < 3.0 * np.median(step)
    flow = None
    if glider.current is not None:
        # A row carries the mean of the cycle that ends at it.
        flow = np.nan_to_num(glider.current[1:]) * step
    counted = np.diff(glider.charge) if glider.charge is not None else flow
    assert counted is not None
    usable &= np.isfinite(counted)
    seconds = float(step[usable].sum())
    if seconds < 600.0 or counted[usable].sum() <= 0:
        return None
    total = float(counted[usable].sum())
    source = "coulomb counter" if glider.charge is not None else "the glider's current"
    resolution = 0.0
    if glider.charge is not None:
        stretches = 1 + int(np.count_nonzero(np.diff(usable.astype(np.int8)) == 1))
        resolution = counter_step(glider.charge) * (stretches / 6.0) ** 0.5
    channel = calibration["main"]
    zero = np.hypot(channel.zero_sd, 10.0 * channel.drift_sd) * channel.amperes_per_count
    parts = np.array([channel.gain_sd, COUNTER_SD, zero * seconds / total, resolution / total])
    line = _line(glider.time, charge, counted if flow is None else flow, usable & np.isfinite(counted))
    return CounterCheck(
        ratio=float(charge[usable].sum()) / total - 1.0,
        sigma=float(np.sqrt((parts**2).sum())),
        gain=line[0] - 1.0,
        gain_sd=line[1],
        zero=line[2],
        zero_sd=line[3],
        lag=line[4],
        gain_limit=float(np.hypot(channel.gain_sd, COUNTER_SD)),
        charge=total,
        hours=seconds / 3600.0,
        source=source,
    )


def _line(
    time: NDArray[np.float64],
    board: NDArray[np.float64],
    glider: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> tuple[float, float, float, float, float]:
    """Slope and level of the board's current over the glider's, each with its 1-sigma, and the lag of the glider's.

    The recorded current trails by one or two cycles; the lag at which the minutes agree best is taken.
    """
    unknown = (float("nan"),) * 5
    step = np.diff(time)
    usable = usable & np.isfinite(glider)
    total = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(glider), glider, 0.0))])
    cycle = float(np.median(step))
    block = np.floor((time[:-1] - time[0]) / _BLOCK).astype(np.int64)
    best, found = np.inf, unknown
    for lag in np.arange(0.0, _LONGEST_LAG + 0.25, 0.5) * cycle:
        flow = np.diff(np.interp(time + lag, time, total))
        rows = usable & (time[1:] + lag <= time[-1])
        seconds = np.bincount(block, weights=step * rows)
        whole = seconds > 0.8 * _BLOCK
        if np.count_nonzero(whole) < _LEAST_BLOCKS:
            return unknown
        seen = np.bincount(block, weights=np.where(rows, board, 0.0))[whole] / seconds[whole]
        counted = np.bincount(block, weights=np.where(rows, flow, 0.0))[whole] / seconds[whole]
        if float(counted.std()) < 0.05 * abs(float(counted.mean())):
            return unknown
        design = np.stack([np.ones_like(counted), counted], axis=1)
        theta = np.linalg.lstsq(design, seen, rcond=None)[0]
        misfit = float(np.sqrt(np.mean((seen - design @ theta) ** 2)))
        if misfit < best:
            fit = robust_fit(design, seen, np.full(seen.size, 1e-4))
            sd = fit.sigma()
            best = misfit
            found = (float(fit.theta[1]), float(sd[1]), float(fit.theta[0]), float(sd[0]), float(lag))
    return found
