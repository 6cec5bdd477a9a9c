"""Where a flown dive's energy went, ours beside the glider's: motors and steady load apart, and a fit of hours before.

A simulation may miss the drawn energy in two ways: the motors cost otherwise, or the steady load is another day's.
The recording tells them apart, since it holds every pump stroke; and the vehicle's own hours before a dive say what
its sensors draw that day. A fit to those hours is the honest prediction: nothing of the dive itself goes in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from glider_jax.board.analysis import analyse_recordings
from glider_jax.config import CovarianceBlock, Vehicle
from glider_jax.errors import DataError, FitError
from glider_jax.readers.dives import between
from glider_jax.records import Recording, Track

_RECENT = 24 * 3600.0
_MOTORS = ("pump out", "pump in", "brake")


@dataclass(frozen=True)
class Split:
    """Energy of one dive, J, with ``motors`` and ``steady`` load apart over ``seconds``."""

    motors: float
    steady: float
    seconds: float

    @property
    def watts(self) -> float:
        """The steady load, W."""
        return self.steady / self.seconds


def measured_split(flight: Recording, dive: float, surface: float, total: float) -> Split | None:
    """What the motors took of the energy ``total`` (J) drawn between two times, from the recorded strokes.

    None where the recording has no strokes to add up.
    """
    try:
        events = analyse_recordings([between(flight, dive - 600.0, surface + 600.0)]).events
    except (DataError, FitError):
        return None
    motors = sum(e.energy for e in events if e.kind == "pump" and dive <= e.time <= surface)
    return Split(float(motors), float(total - motors), surface - dive)


def simulated_split(track: Track, rows: np.ndarray) -> Split:
    """Median energies of the members until their rows: motors, and all the rest as steady load."""
    members = np.arange(track.n)
    energy = track.energy[members, rows].astype(float)
    turning = [k for k, name in enumerate(track.components) if name in _MOTORS]
    motors = energy[:, turning].sum(-1)
    seconds = float(np.median(track.time[rows] - track.time[0]))
    return Split(float(np.median(motors)), float(np.median(energy.sum(-1) - motors)), seconds)


def fitted_vehicle(flight: Recording, moment: float, vehicle: Vehicle) -> Vehicle | None:
    """The vehicle with the energies of its own last day before ``moment`` (s); None where it has flown too little.

    The steady load's uncertainty is that of its mean over independent stretches, as the fit states it.
    """
    begin = max(moment - _RECENT, float(flight.time[0]))
    try:
        model = analyse_recordings([between(flight, begin, moment)]).model
    except (DataError, FitError):
        return None
    if "energy.hotel" not in model.estimates:
        return None
    quantities = dict(vehicle.quantities)
    for name, estimate in model.estimates.items():
        # A surface load from few minutes is no better than the vehicle's.
        if name in quantities and name != "energy.surface":
            sigma = estimate.interval() / 1.96 if estimate.sigma > 0.0 else 0.0
            quantities[name] = replace(quantities[name], value=estimate.value, sigma=sigma, source=estimate.source)
    kept = [k for k, name in enumerate(model.names) if name in quantities and name != "energy.surface"]
    names = tuple(model.names[k] for k in kept)
    matrix = tuple(tuple(float(x) for x in model.covariance[k, kept]) for k in kept)
    others = tuple(block for block in vehicle.covariances if not set(block.names) & set(names))
    fitted = CovarianceBlock(names, matrix, "the vehicle's own last day")
    return replace(vehicle, quantities=quantities, covariances=(*others, fitted))


def split_lines(dives) -> list[str]:
    """Ours and the glider's energies by kind, and what a fit to the hours before predicts, as lines of Markdown."""
    lines = [
        "| dive | motors kJ, ours / measured | steady load W, ours / measured | h, ours / measured | "
        "kJ, fit of the hours before (5-95 %) / drawn |",
        "|---|---|---|---|---|",
    ]
    for dive in dives:
        ours, theirs = dive.simulated, dive.measured
        said = "- | - | -"
        if ours is not None and theirs is not None:
            said = (
                f"{ours.motors / 1e3:.1f} / {theirs.motors / 1e3:.1f} | {ours.watts:.2f} / {theirs.watts:.2f} | "
                f"{ours.seconds / 3600:.2f} / {theirs.seconds / 3600:.2f}"
            )
        low, middle, high = dive.fitted_energy
        fit = "too little flown" if math.isnan(middle) else f"{middle / 1e3:.1f} ({low / 1e3:.1f}-{high / 1e3:.1f})"
        lines.append(f"| {dive.number} | {said} | {fit} / {dive.true_energy / 1e3:.1f} |")
    return lines


def split_text(dives) -> str:
    """In words, what the difference between ours and the drawn energy is made of."""
    ratio = float(np.mean([d.energy[1] / d.true_energy for d in dives]))
    text = f"By the vehicle file's loads the dives take {ratio:.2f} times what was drawn."
    known = [d for d in dives if d.simulated is not None and d.measured is not None]
    if known:
        motors = sum(d.simulated.motors - d.measured.motors for d in known) / 1e3
        steady = sum(d.simulated.steady - d.measured.steady for d in known) / 1e3
        longer = sum(d.measured.watts * (d.simulated.seconds - d.measured.seconds) for d in known) / 1e3
        text += (
            f" Of {motors + steady:.1f} kJ too much over {len(known)} dives, {motors:.1f} kJ are the motors', "
            f"{longer:.1f} kJ the longer time, and {steady - longer:.1f} kJ the steady load: the file's is a mean over "
            "days with other sensors switched on. The pump's cost holds, and no device is counted twice."
        )
    fits = [d.fitted_energy[1] / d.true_energy for d in dives if math.isfinite(d.fitted_energy[1])]
    if fits:
        text += (
            f" Loads fitted to the vehicle's last day before a dive (`energy fit`) give {np.mean(fits):.2f} times what "
            f"was drawn ({len(fits)} of {len(dives)} dives had enough flown before): fit the day's own loads first."
        )
    return text
