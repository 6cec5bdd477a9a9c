"""Place the board's ticks in UTC; NumPy only.

A board counts ticks and now and then says what UTC is. Its oscillator is steady to some parts in 10,000
but the UTC it is
told may jump, so a line is fitted through the stamps and a jump is reported, not followed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.frames import TICK
from glider_jax.errors import DataError

STEP = 0.5


@dataclass(frozen=True)
class ClockStep:
    """UTC jumped by ``seconds`` against the ticks at ``tick`` of ``epoch``."""

    epoch: int
    tick: int
    seconds: float


@dataclass(frozen=True)
class Clock:
    """Line from ticks to UTC for each epoch: ``start`` s since 1970 at tick 0 and ``period`` s per tick;
    NaN unknown."""

    start: NDArray[np.float64]
    period: NDArray[np.float64]
    steps: tuple[ClockStep, ...] = ()

    def utc(self, epoch: NDArray[np.integer], tick: NDArray[np.integer]) -> NDArray[np.float64]:
        """UTC of samples, s since 1970."""
        return self.start[epoch] + self.period[epoch] * tick

    def require_steady(self, name: str) -> None:
        """Raise if UTC jumped: which of the two clocks to believe is the user's choice."""
        if self.steps:
            first = self.steps[0]
            raise DataError(
                f"{name}: expected a steady clock, found {len(self.steps)} steps; the first is "
                f"{first.seconds:+.1f} s at tick {first.tick} of start {first.epoch}. "
                "Ticks stay right; use --clock-steps keep to place all samples by the line before the first step."
            )


def fit_clock(stamps: NDArray[np.int64], epochs: int, tick: float = TICK) -> Clock:
    """Fit the clock of each epoch.

    Parameters
    ----------
    stamps : (stamp, 3) epoch, tick, UTC in ms since 1970.
    epochs : how often the board started.
    tick : nominal length of a tick, s.
    """
    start, period = np.full(epochs, np.nan), np.full(epochs, tick)
    steps: list[ClockStep] = []
    for epoch in range(epochs):
        mine = stamps[stamps[:, 0] == epoch]
        if mine.size == 0:
            continue
        ticks, utc = mine[:, 1].astype(float), mine[:, 2] * 1e-3
        jump = np.diff(utc) - np.diff(ticks) * tick
        # An oscillator may be off by 0.1 % between two stamps far apart; that is no step.
        bad = np.flatnonzero(np.abs(jump) > STEP + 1e-3 * np.diff(ticks) * tick)
        steps += [ClockStep(epoch, int(ticks[i + 1]), float(jump[i])) for i in bad]
        end = bad[0] + 1 if bad.size else len(utc)
        ticks, utc = ticks[:end], utc[:end]
        if len(ticks) >= 8 and np.ptp(ticks) * tick > 600.0:
            middle = ticks.mean()
            slope = ((ticks - middle) * (utc - utc.mean())).sum() / ((ticks - middle) ** 2).sum()
            if abs(slope / tick - 1.0) < 2e-3:
                period[epoch] = slope
        start[epoch] = np.median(utc - period[epoch] * ticks)
    return Clock(start, period, tuple(steps))


def read_arrivals(folder: Path) -> NDArray[np.int64]:
    """Arrival times that a capture kept beside its logs: (arrival, 2) byte of the joined logs, UTC in ns
    since 1970."""
    joined, rows = 0, []
    logs = (p for p in folder.iterdir() if ".bin" in p.suffixes) if folder.is_dir() else ()
    for log in sorted(logs):
        times = log.with_name(log.name.replace(".bin", ".times"))
        if times.is_file():
            for line in times.read_text(encoding="ascii").splitlines():
                parts = line.split()
                if len(parts) == 3:
                    rows.append((joined + int(parts[0]), int(parts[1])))
        joined += log.stat().st_size
    return np.array(rows, dtype=np.int64).reshape(-1, 2)


def stamps_from_arrival(
    arrivals: NDArray[np.int64], ends: NDArray[np.int64], epoch: NDArray[np.int32], tick: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Stamps from the host's arrival times, for a board that knows no UTC; late by the delay of the line.

    Parameters
    ----------
    arrivals : from :func:`read_arrivals`.
    ends : (frame,) byte after each frame in the joined logs. epoch, tick : (frame,) of the same frames.

    Returns
    -------
    (stamp, 3) as :func:`fit_clock` takes them.
    """
    if ends.size == 0 or arrivals.size == 0:
        return np.empty((0, 3), dtype=np.int64)
    # A frame that ended just before byte n had arrived when byte n did; further away nothing is known.
    at = np.searchsorted(ends, arrivals[:, 0], side="right") - 1
    known = (at >= 0) & (arrivals[:, 0] - ends[np.maximum(at, 0)] <= 32)
    at = at[known]
    return np.stack([epoch[at].astype(np.int64), tick[at], arrivals[known, 1] // 1_000_000], axis=1)
