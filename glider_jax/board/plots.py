"""Figures of the measurement: currents with the depth, energy against depth, and the bench tests.

matplotlib is imported when a figure is drawn; every function writes one PNG and returns its path.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.calibration import Calibration
from glider_jax.board.events import CLIMB_TO_DIVE, Event, GliderRecord
from glider_jax.board.fits import CLIMB, EnergyModel
from glider_jax.board.record import NOT_SAMPLED, BoardRecord

if TYPE_CHECKING:
    from glider_jax.board.checks import BenchResult, WiggleResult

_BLUE, _RED, _GREY, _GREEN = "#1f5a96", "#b5341f", "#7a7a7a", "#2f7d4f"


def _figure(width: float, height: float, rows: int = 1) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 1, sharex=rows > 1, squeeze=False)[:, 0]
    for axis in axes:
        axis.grid(True, color="#dddddd", linewidth=0.6)
        axis.set_axisbelow(True)
    return figure, axes


def _save(figure: Any, path: str | Path) -> Path:
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=130, format="png", metadata={"Software": None})
    return target


def envelope(
    time: NDArray[np.float64], values: NDArray[np.float64], most: int = 4000
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Thin a long series to its extremes per bin, so that no spike vanishes from a plot."""
    if time.size <= 2 * most:
        return time, values
    size = time.size // most
    whole = time.size // size * size
    block = values[:whole].reshape(-1, size)
    rows = np.arange(block.shape[0]) * size
    least, most_of = np.where(np.isnan(block), np.inf, block), np.where(np.isnan(block), -np.inf, block)
    hole = rows + np.isnan(block).argmax(axis=1)
    index = np.concatenate(
        [rows + least.argmin(axis=1), rows + most_of.argmax(axis=1), hole[np.isnan(values[hole])]]
    )
    index = np.unique(index)
    return time[index], values[index]


PAUSE = 3600.0


def without_pauses(
    time: NDArray[np.float64], marks: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Take pauses of more than an hour out of a time axis.

    Parameters
    ----------
    time : (sample,) s, ascending. marks : (mark,) s, further times on the same axis.

    Returns
    -------
    ``marks`` on the shortened axis in s from the start, and where pauses were cut, on the same axis.
    """
    step = np.diff(time)
    long = np.flatnonzero(step > PAUSE)
    if long.size == 0:
        return marks - time[0], np.empty(0)
    gap = max(0.02 * float(step[step <= PAUSE].sum()), 1.0)
    cut = np.concatenate([[0.0], np.cumsum(step[long] - gap)])
    shifted = marks - time[0] - cut[np.searchsorted(time[long + 1], marks, side="right")]
    at = time[long] - time[0] - cut[:-1] + 0.5 * gap
    return shifted, at


def _broken(values: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values with NaN at the last sample before each pause, so that no line is drawn across it."""
    out = np.array(values, dtype=np.float64)
    out[:-1][np.diff(time) > PAUSE] = np.nan
    return out


def plot_currents(
    path: str | Path,
    time: NDArray[np.float64],
    currents: dict[str, NDArray[np.float64]],
    glider: GliderRecord | None = None,
    title: str = "",
    sampled: dict[str, NDArray[np.bool_]] | None = None,
) -> Path:
    """Current of each channel and the depth against time.

    Parameters
    ----------
    time : (row,) s since 1970. currents : channel to (row,) A.
    sampled : channel to (row,), rows at which a channel had its turn; every row by default.
    """
    rows = len(currents) + (glider is not None)
    figure, axes = _figure(9.0, 1.2 + 1.7 * rows, rows)
    time = np.asarray(time, dtype=np.float64)
    place, cuts = without_pauses(time, time)
    for axis, (name, values) in zip(axes, currents.items(), strict=False):
        rows_of = sampled[name] if sampled else slice(None)
        x, y = envelope(place[rows_of] / 3600.0, _broken(values[rows_of], time[rows_of]))
        axis.plot(x, y, color=_BLUE, linewidth=0.7)
        axis.set_ylabel(f"{name}\n(A)")
    if glider is not None:
        axis = axes[-1]
        at, _ = without_pauses(time, glider.time)
        axis.plot(at / 3600.0, _broken(glider.depth, glider.time), color=_RED, linewidth=0.9)
        axis.invert_yaxis()
        axis.set_ylabel("depth\n(m)")
    for axis in axes:
        for cut in cuts:
            axis.axvline(cut / 3600.0, color=_GREY, linewidth=1.0, linestyle=":")
    axes[-1].set_xlabel("time since start (h)" + (", pauses cut out at dotted lines" if cuts.size else ""))
    axes[-1].set_xlim(0.0, float(place[-1]) / 3600.0)
    if title:
        axes[0].set_title(title)
    return _save(figure, path)


def plot_board(
    path: str | Path,
    record: BoardRecord,
    calibration: Calibration,
    glider: GliderRecord | None = None,
    channels: tuple[str, ...] | None = None,
) -> Path:
    """Currents of a board's channels, each at its own rate, with the glider's depth.

    Parameters
    ----------
    channels : all that tell of motors and the whole by default.
    """
    names = channels or tuple(n for n in record.channels if n not in ("external", "emergency"))
    counts = {name: record.counts[:, record.column(name)] for name in names}
    currents = {name: calibration.amperes(name, values).value for name, values in counts.items()}
    sampled = {name: values != NOT_SAMPLED for name, values in counts.items()} if record.mixed else None
    return plot_currents(path, record.utc(slice(None)), currents, glider, record.name, sampled)


def plot_energy(path: str | Path, model: EnergyModel, events: Sequence[Event], level: float = 0.95) -> Path:
    """Energy of pump strokes against depth, with the fit, the interval of its mean and that of single
    strokes."""
    figure, axes = _figure(7.0, 5.0)
    axis = axes[0]
    pump = model.pump
    if pump is not None:
        depth = np.array([e.depth for e in pump.used])
        scale = np.ones(depth.size)
        if pump.form == "volume":
            scale = pump.reference_volume / np.array([e.volume for e in pump.used])
        energy = scale * np.array([e.energy for e in pump.used])
        sd = scale * np.array([e.energy_sd for e in pump.used])
        bad = pump.fit.weight < 0.1
        axis.errorbar(
            depth[~bad],
            energy[~bad],
            sd[~bad],
            fmt="o",
            markersize=4,
            color=_BLUE,
            elinewidth=0.7,
            label="dive to climb",
        )
        if bad.any():
            axis.plot(depth[bad], energy[bad], "x", color=_RED, label="outlier")
        low, high = min(0.0, pump.depths[0]), 1.05 * pump.depths[1]
        z = np.linspace(low, high, 200)
        mean = pump.predict(z)
        text = f"{pump.theta[0]:.0f} J + {pump.theta[1]:.2f} J/m · depth"
        seen = np.array(pump.depths)
        axis.plot(z, mean, color=_BLUE, linewidth=0.9, linestyle=(0, (4, 3)))
        axis.plot(
            seen,
            pump.predict(seen),
            color=_BLUE,
            linewidth=1.6,
            label=f"{text}\n(dashed: beyond the strokes)",
        )
        half, single = pump.interval(z, level), pump.interval(z, level, single=True)
        percent = f"{100 * level:.0f} %"
        axis.fill_between(
            z, mean - half, mean + half, color=_BLUE, alpha=0.25, linewidth=0, label=f"{percent}, mean"
        )
        axis.fill_between(
            z,
            mean - single,
            mean + single,
            color=_BLUE,
            alpha=0.10,
            linewidth=0,
            label=f"{percent}, single stroke",
        )
    climbs = [e for e in events if e.kind == "pump" and e.direction == CLIMB_TO_DIVE]
    if climbs:
        axis.plot(
            [e.depth for e in climbs],
            [e.energy for e in climbs],
            "s",
            markersize=3,
            color=_GREEN,
            label="climb to dive",
        )
        if CLIMB in model.estimates:
            axis.axhline(model.estimates[CLIMB].value, color=_GREEN, linewidth=0.8, linestyle="--")
    axis.set_xlabel("depth at the start of the stroke (m)")
    text = "energy above the other loads (J)"
    if pump is not None and pump.form == "volume":
        text += f", scaled to {1e6 * pump.reference_volume:.0f} cc"
    axis.set_ylabel(text)
    axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
    axis.set_title(f"Pump energy, {model.name}")
    axis.legend(fontsize=8, loc="upper left")
    return _save(figure, path)


def plot_bench(path: str | Path, result: BenchResult) -> Path:
    """Bench check: measured current, the applied one and the error budget."""
    figure, axes = _figure(7.5, 4.2)
    axis = axes[0]
    axis.plot(
        result.time, result.current, color=_BLUE, linewidth=0.8, label=f"board, channel {result.channel}"
    )
    begin, end = result.window
    axis.plot(
        [begin, begin, end, end], [0.0, result.applied, result.applied, 0.0], color=_GREY, label="applied"
    )
    axis.fill_between(
        [begin, end],
        result.applied - result.budget,
        result.applied + result.budget,
        color=_GREY,
        alpha=0.25,
        linewidth=0,
        label="error budget, 2 sigma",
    )
    axis.set_xlim(max(begin - 3.0, result.time[0]), min(end + 3.0, result.time[-1]))
    axis.set_xlabel("time (s)")
    axis.set_ylabel("current (A)")
    verdict = "pass" if result.passed else "fail"
    axis.set_title(
        f"Bench check: {result.mean:.3f} A of {result.applied:g} A for {result.duration:.2f} s, {verdict}"
    )
    axis.legend(fontsize=8)
    return _save(figure, path)


def plot_wiggle(path: str | Path, results: Sequence[WiggleResult]) -> Path:
    """Wiggle test: servo currents of both signs."""
    figure, axes = _figure(7.5, 1.0 + 2.4 * len(results), len(results))
    for axis, result in zip(axes, results, strict=True):
        x, y = envelope(result.time, result.current)
        axis.plot(x, y, color=_BLUE, linewidth=0.7)
        for sign in (-1, 1):
            axis.axhline(sign * result.threshold, color=_GREY, linewidth=0.7, linestyle=":")
        axis.set_ylabel(f"{result.channel} (A)")
        axis.set_title(f"{result.channel} servo: {'pass' if result.passed else 'fail'}", fontsize=10)
    axes[-1].set_xlabel("time (s)")
    return _save(figure, path)
