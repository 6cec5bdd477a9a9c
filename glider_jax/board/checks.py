"""Bench tests of a board, judged against its error budget; NumPy only.

The bench check applies a known current to one sensor for some seconds. The wiggle test drives fin and
pitch servo through
their full range and wants currents of both signs that return to zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration, zero_when_off
from glider_jax.board.events import _runs
from glider_jax.board.record import BoardRecord
from glider_jax.errors import DataError


@dataclass(frozen=True)
class BenchResult:
    """Outcome of a bench check; currents A, times s from the start of the record.

    ``budget`` is 2 sigma of gain, zero, noise and quantisation for the mean; ``noise`` and ``noise_limit``
    are rms per
    sample, measured and expected. ``reasons`` says what failed.
    """

    channel: str
    applied: float
    mean: float
    budget: float
    duration: float
    expected_duration: float
    noise: float
    noise_limit: float
    window: tuple[float, float]
    time: NDArray[np.float64]
    current: NDArray[np.float64]
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return not self.reasons


@dataclass(frozen=True)
class WiggleResult:
    """Outcome of a wiggle test of one servo; ``positive`` and ``negative`` count bursts of each sign,
    peaks in A."""

    channel: str
    positive: int
    negative: int
    highest: float
    lowest: float
    zero_shift: float
    threshold: float
    time: NDArray[np.float64]
    current: NDArray[np.float64]
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return not self.reasons


def _centred(record: BoardRecord, channel: str, calibration: Calibration) -> tuple[NDArray[np.float64], ...]:
    """Time, current above the first seconds' level, and the zero used, all of one channel at its own rate."""
    column = record.column(channel)
    counts = record.counts[:, column].astype(np.float64)
    rest = min(int(2.0 / record.spacing), counts.size // 4)
    if rest < 16:
        raise DataError(
            f"{record.name}: expected at least 3 s of samples for a bench test, found {counts.size}."
        )
    zero, sd = zero_when_off(record.counts[:rest, column], channel)
    time = (record.tick - record.tick[0]) * record.period
    return time, (counts - zero) * calibration[channel].amperes_per_count, np.array([zero, sd])


def bench_check(
    record: BoardRecord,
    channel: str,
    calibration: Calibration,
    applied: float = 1.0,
    expected_duration: float = 6.0,
) -> BenchResult:
    """Judge a known current applied to one sensor.

    Parameters
    ----------
    record : begins with two seconds of no current.
    applied : A, from the reference instrument. expected_duration : s.

    Raises
    ------
    DataError : no step is in the record, or the channel is saturated.
    """
    record.require_usable(channel)
    record = record.only(channel)
    time, current, zero = _centred(record, channel, calibration)
    limits = calibration[channel]
    on = np.abs(current) > 0.5 * abs(applied)
    runs = _runs(on)
    if len(runs) == 0:
        raise DataError(
            f"{record.name}: channel {channel}: expected a step of {applied:g} A, found none above half of it "
            f"(largest {np.abs(current).max():.2f} A). Is the current on this channel?"
        )
    longest = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    begin, end = int(longest[0]), int(longest[1])
    inner = slice(begin + 2, max(end - 2, begin + 3))
    mean = float(current[inner].mean())
    count = max(inner.stop - inner.start, 1)
    noise = float(current[inner].std())
    systematic = np.hypot(limits.gain_sd * abs(applied), zero[1] * limits.amperes_per_count)
    budget = 2.0 * float(np.hypot(systematic, limits.noise / count**0.5))
    duration = float(time[end - 1] - time[begin] + record.spacing)
    reasons = []
    if abs(mean - applied) > budget:
        reasons.append(
            f"mean {mean:.4f} A is {mean - applied:+.4f} A from the applied {applied:g} A, budget {budget:.4f} A"
        )
    if abs(duration - expected_duration) > 2.0 * record.spacing + 0.02 * expected_duration:
        reasons.append(f"the step lasted {duration:.3f} s, expected {expected_duration:g} s")
    if noise > 2.0 * limits.noise:
        reasons.append(f"noise {1e3 * noise:.1f} mA rms, expected at most {2e3 * limits.noise:.1f} mA")
    after = current[end + 4 :]
    if after.size >= 16 and abs(float(np.median(after))) > max(budget, 3.0 * limits.noise):
        reasons.append(f"the zero moved by {float(np.median(after)):+.4f} A after the step")
    steps = np.diff(record.tick[begin:end]) // record.stride
    if steps.size and steps.max() > 1:
        reasons.append(f"{int(steps.sum() - steps.size)} samples are missing in the step")
    return BenchResult(
        channel,
        applied,
        mean,
        budget,
        duration,
        expected_duration,
        noise,
        limits.noise,
        (float(time[begin]), float(time[end - 1])),
        time,
        current,
        tuple(reasons),
    )


def wiggle_test(record: BoardRecord, channel: str, calibration: Calibration, bursts: int = 2) -> WiggleResult:
    """Judge a servo moved through its full range.

    Parameters
    ----------
    channel : ``fin`` or ``pitch``.
    bursts : least number of movements in each direction.
    """
    record.require_usable(channel)
    record = record.only(channel)
    time, current, _ = _centred(record, channel, calibration)
    limits = calibration[channel]
    threshold = max(0.05, 5.0 * limits.noise)
    smooth = np.convolve(current, np.full(4, 0.25), mode="same")
    positive, negative = len(_runs(smooth > threshold)), len(_runs(smooth < -threshold))
    rest = current[np.abs(smooth) < 0.5 * threshold]
    shift = float(np.median(rest)) if rest.size else float("nan")
    reasons = []
    for count, name in ((positive, "positive"), (negative, "negative")):
        if count < bursts:
            reasons.append(f"{count} {name} movements above {threshold:.2f} A, expected at least {bursts}")
    if not abs(shift) <= 3.0 * limits.noise:
        reasons.append(f"at rest the current reads {shift:+.3f} A")
    if np.abs(current).max() > limits.sensor.rated:
        reasons.append(f"peak {np.abs(current).max():.2f} A is beyond the sensor's {limits.sensor.rated:g} A")
    return WiggleResult(
        channel,
        positive,
        negative,
        float(current.max()),
        float(current.min()),
        shift,
        threshold,
        time,
        current,
        tuple(reasons),
    )
