"""What in a recording is not physics: corrupt casts, settings changed in mid-mission, counters that were reset.

NumPy and the readers only. A newcomer would get wrong: a change that somebody made explains a step in the residuals
better than any effect, so it is looked for before effects are believed.
"""

from __future__ import annotations

import numpy as np

from glider_jax.inference.streams import Gathered
from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Array, Recording

#: A leg whose median misfit is this many times the usual scatter of legs is taken for corrupt.
WILD = 8.0
#: m s-1; smaller misfits of a leg are nothing that physics cannot do.
WILDEST = 0.03


def regime_changes(recording: Recording) -> list[str]:
    """Sentences on settings, modes and counters that changed during the recording."""
    said = []
    for name, text, least, factor, unit in (
        ("commanded_pumped_volume", "The commanded pump volume", 8e-6, 1e6, "cm3"),
        ("commanded_pitch", "The commanded pitch", 0.03, 57.29578, "degrees"),
    ):
        levels = _levels(*finite(recording, name), least)
        for old, new, moment in levels[:3]:
            day = (moment - recording.time[0]) / 86400.0
            said.append(f"{text} changed from {old * factor:.0f} to {new * factor:.0f} {unit} on day {day:.1f}.")
    wide = np.flatnonzero(np.diff(recording.time) > 43200.0)
    if wide.size:
        days = float(np.diff(recording.time)[wide].max()) / 86400.0
        said.append(
            f"The recording has a hole of {days:.1f} days: what differs between its parts may be a setting that "
            "somebody changed meanwhile, rather than growth or wear."
        )
    time, power = finite(recording, "thruster_power")
    if power.size and (power > 0.5).sum() > 5:
        said.append(f"A thruster ran in {100.0 * np.mean(power > 0.5):.0f} % of the record.")
    time, charge = finite(recording, "charge_used")
    if charge.size > 10:
        drops = np.flatnonzero(np.diff(charge) < -36.0)
        if drops.size:
            day = (time[drops[0]] - recording.time[0]) / 86400.0
            said.append(f"The charge counter went back {drops.size} times, first on day {day:.1f}: it was reset.")
    for name in ("pitch", "heading", "pumped_volume", "current", "battery_voltage", "temperature", "conductivity"):
        _, values = finite(recording, name)
        if values.size > 50 and np.ptp(values) == 0.0:
            said.append(f"Channel '{name}' never changes: its sensor was off or stuck, and what rests on it is void.")
    return said


def _levels(time: Array, values: Array, least: float) -> list[tuple[float, float, float]]:
    """Changes of the day-to-day level of a command, for each of its signs: old, new, when."""
    found = []
    for sign in (-1.0, 1.0):
        mine = np.sign(values) == sign
        if mine.sum() < 40:
            continue
        t, v = time[mine], values[mine]
        edges = np.linspace(t[0], t[-1] + 1.0, 13)
        means = [np.median(v[(t >= a) & (t < b)]) if ((t >= a) & (t < b)).sum() > 3 else np.nan
                 for a, b in zip(edges[:-1], edges[1:], strict=True)]  # fmt: skip
        known = [(m, edges[k]) for k, m in enumerate(means) if np.isfinite(m)]
        for (old, _), (new, when) in zip(known[:-1], known[1:], strict=True):
            if abs(new - old) > least:
                found.append((float(old), float(new), float(when)))
    return sorted(found, key=lambda change: change[2])


def corrupt_legs(gathered: Gathered, left: Array) -> list[tuple[int, float]]:
    """Legs whose vertical speed misses by far more than any other's: index of the leg and its misfit in m/s.

    Parameters
    ----------
    left : residual of vertical speed, m s-1, in the stream's order.
    """
    stream = gathered.stream("vertical speed")
    if stream is None or stream.n < 30:
        return []
    legs, code = np.unique(stream.group, return_inverse=True)
    middle = np.array([np.median(left[code == k]) for k in range(legs.size)])
    usual = 1.4826 * np.median(np.abs(middle - np.median(middle)))
    wild = np.abs(middle - np.median(middle)) > max(WILD * usual, WILDEST)
    return [(int(legs[k]), float(middle[k])) for k in np.flatnonzero(wild)]
