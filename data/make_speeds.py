"""Make ``data/speeds/paper2010.json``: speed distributions with the totals that were published for 25 and 26 degrees.

The published facts are the number of dive segments, their distance and their time. The shape was only drawn, so it
is assumed here. A segment's speed over the ground is the length of a vector sum: the glider's own speed through the
water, normal about ``v`` with a spread of a tenth, plus a current with two independent normal components of
standard deviation ``c`` whose direction has nothing to do with the heading.

Two numbers fix ``v`` and ``c`` of the 26 degree distribution. Segments were ended by the clock, so total distance
over total time is the mean speed of a draw that lasts a fixed time: E[V] = 32,527 km / 3.48 years = 0.296 m/s. The
published simulator flies a path that is fixed in space (yos between given depths at a given angle, to given
waypoints), so a draw there lasts a fixed distance, time adds as distance over speed, and its mean speed is the
harmonic one, 1 / E[1/V] = 0.233 m/s, from 11.5 days against 7.9 of a constant speed and from 380 s more on three
yos of 283 m. A single drawn speed for those three yos would have met the ratio of the long mission only by
chance, so it drew anew at least at every yo. The 25 degree distribution takes the same shape, scaled to its own mean.

Speeds below ``SLOWEST`` are cut off, since a segment that slow is a stalled one. The parameters are solved for the
table as it is used, linear in probability between its nodes, so that both means hold exactly for the draws.

Run ``python data/make_speeds.py`` to write the file again; it needs NumPy and SciPy alone.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

YEAR = 365.25 * 86400.0
#: pitch in degrees: (segments, metres, seconds) as published.
TOTALS = {25.0: (2539, 6.263e6, 293.0 * 86400.0), 26.0: (16411, 3.2527e7, 3.48 * YEAR)}
#: Mean speed of the published simulator with the 26 degree distribution, m/s: 283 m in 380 s more than at 0.34 m/s.
HARMONIC_26 = 0.233
#: Share by which a glider's own speed varies between segments (ballast, growth, trim): judgement.
OWN_SPREAD = 0.10
SLOWEST, FASTEST = 0.03, 0.9
#: Closer together at both ends, where the quantiles bend most.
PROBABILITIES = (1.0 - np.cos(np.linspace(0.0, np.pi, 65))) / 2.0
REFERENCE = (
    "H. Woithe et al. (2010), Slocum glider energy measurement and simulation infrastructure, OCEANS 2010: "
    "totals of dive segments off New Jersey, 2003 to 2009"
)


def over_ground_quantiles(own: float, current: float) -> np.ndarray:
    """Quantiles, m/s, at ``PROBABILITIES`` of the length of own speed plus an isotropic normal current."""
    speed = np.linspace(SLOWEST, FASTEST, 4001)
    angle = np.linspace(-np.pi, np.pi, 721)[:-1]
    along = np.hypot(OWN_SPREAD * own, current)
    east = (speed[:, None] * np.cos(angle) - own) / along
    north = speed[:, None] * np.sin(angle) / current
    density = speed * np.exp(-0.5 * (east**2 + north**2)).mean(axis=1)
    return _inverse(speed, density)


def through_water_quantiles(own: float) -> np.ndarray:
    """Quantiles, m/s, at ``PROBABILITIES`` of the glider's own speed, cut four standard deviations out."""
    speed = own * (1.0 + OWN_SPREAD * np.linspace(-4.0, 4.0, 4001))
    return _inverse(speed, np.exp(-0.5 * ((speed / own - 1.0) / OWN_SPREAD) ** 2))


def _inverse(speed: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Invert the cumulative distribution of a tabulated density, which need not be normalised."""
    steps = 0.5 * (density[1:] + density[:-1]) * np.diff(speed)
    cumulative = np.concatenate([[0.0], np.cumsum(steps)])
    return np.interp(PROBABILITIES, cumulative / cumulative[-1], speed)


def mean_per_time(speeds: np.ndarray) -> float:
    """Mean of draws that each last the same time, m/s: E[V] of a table that is linear in probability."""
    return float(np.sum(np.diff(PROBABILITIES) * 0.5 * (speeds[1:] + speeds[:-1])))


def mean_per_distance(speeds: np.ndarray) -> float:
    """Mean of draws that each last the same distance, m/s: 1 / E[1/V] of a table that is linear in probability."""
    slowness = np.log(speeds[1:] / speeds[:-1]) / np.diff(speeds)
    return float(1.0 / np.sum(np.diff(PROBABILITIES) * slowness))


def solve(mean: float, harmonic: float) -> tuple[float, float]:
    """Own speed and standard deviation of a current component, m/s, for which both means hold."""

    def own_for(ratio: float) -> float:
        def gap(own: float) -> float:
            return mean_per_time(over_ground_quantiles(own, ratio * own)) - mean

        return brentq(gap, 0.3 * mean, 1.5 * mean, xtol=1e-10)

    def miss(ratio: float) -> float:
        own = own_for(ratio)
        return mean_per_distance(over_ground_quantiles(own, ratio * own)) - harmonic

    ratio = brentq(miss, 0.1, 1.5, xtol=1e-9)
    own = own_for(ratio)
    return own, ratio * own


def entries() -> list[dict]:
    """Both kinds for both pitches, as the file holds them."""
    mean_26 = TOTALS[26.0][1] / TOTALS[26.0][2]
    own_26, current_26 = solve(mean_26, HARMONIC_26)
    table_26 = over_ground_quantiles(own_26, current_26)
    found = []
    for pitch, (segments, distance, duration) in sorted(TOTALS.items()):
        scale = (distance / duration) / mean_26
        own, current = scale * own_26, scale * current_26
        for kind, speeds in (
            ("over_ground", scale * table_26),
            ("through_water", through_water_quantiles(own)),
        ):
            found.append(
                {
                    "pitch_deg": pitch,
                    "kind": kind,
                    "speeds": [round(float(v), 7) for v in speeds],
                    "probabilities": [round(float(p), 9) for p in PROBABILITIES],
                    "segments": segments,
                    "distance_m": distance,
                    "duration_s": duration,
                    "mean_per_time": round(mean_per_time(speeds), 5),
                    "mean_per_distance": round(mean_per_distance(speeds), 5),
                    "source": REFERENCE,
                    "assumption": _assumption(kind, own, current),
                }
            )
    return found


def _assumption(kind: str, own: float, current: float) -> str:
    if kind == "through_water":
        return (
            f"The over-ground distribution with the currents taken out: own speed normal about {own:.3f} m/s with a "
            f"standard deviation of {OWN_SPREAD * own:.3f} m/s (a tenth: judgement), cut at four standard deviations. "
            "The totals are those of the over-ground segments it was derived from."
        )
    return (
        f"Shape assumed: length of own speed (normal, {own:.3f} m/s, spread a tenth) plus a current with two "
        f"independent normal components of {current:.3f} m/s. Draws that last the same time have the published total "
        "distance over total time as their mean; draws that last the same distance have the harmonic mean, which "
        "for 26 degrees is that of the published simulator, 0.233 m/s. 25 degrees takes the shape of 26 degrees. "
        f"Speeds below {SLOWEST:g} m/s at 26 degrees are cut off. The currents of six years are in the spread: do not "
        "add currents on top of it."
    )


def main() -> None:
    """Write the file beside this script."""
    path = Path(__file__).resolve().parent / "speeds" / "paper2010.json"
    content = {"format": "glider_jax speed distribution", "version": 1, "distributions": entries()}
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
