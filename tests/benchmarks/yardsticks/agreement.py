"""How far a yardstick's result lies from the forecaster's, by what a user sees: positions and energy."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.yardsticks.arrays import Flown


def differences(run, track, flown: Flown) -> dict[str, float]:
    """Distances between positions and relative differences of energy at every output both were flying at.

    Where a yardstick draws the same numbers in the same steps the two agree to centimetres. Where the steps differ,
    so do the draws of the currents' error, and members agree as an ensemble alone: see ``mean_apart``.

    Returns
    -------
    ``position_median``, ``position_p99`` m; ``energy_median``, ``energy_p99`` relative; ``mean_apart`` m between
    the ensembles' mean positions at the end, ``spread`` the ratio of their standard deviations; ``outcomes`` share of
    members with the same outcome.
    """
    latitude, longitude = run.frame.to_degrees(flown.row("east").T, flown.row("north").T)
    count = min(latitude.shape[1], track.latitude.shape[1] - 1)
    here = slice(1, count + 1)
    both = track.active[:, here] & (flown.row("active").T[:, :count] > 0.5)
    metres = run.frame.metres_per_degree
    east = (longitude[:, :count] - track.longitude[:, here]) * metres[0]
    north = (latitude[:, :count] - track.latitude[:, here]) * metres[1]
    apart = np.hypot(east, north)[both]
    mine = track.energy[:, here].sum(-1, dtype=float)
    theirs = sum(flown.row(name).T[:, :count].astype(float) for name in ("pump", "retract", "brake", "hotel"))
    later = both & (track.time[here] > track.time[0] + 0.2 * (track.time[-1] - track.time[0]))
    energy = np.abs(theirs[later] / mine[later] - 1.0)
    ends = np.stack([track.longitude[:, count] * metres[0], track.latitude[:, count] * metres[1]])
    others = np.stack([longitude[:, count - 1] * metres[0], latitude[:, count - 1] * metres[1]])
    return {
        "position_median": float(np.median(apart)),
        "position_p99": float(np.percentile(apart, 99)),
        "energy_median": float(np.median(energy)),
        "energy_p99": float(np.percentile(energy, 99)),
        "mean_apart": float(np.hypot(*(ends.mean(axis=1) - others.mean(axis=1)))),
        "spread": float(np.sqrt(others.var(axis=1).sum() / ends.var(axis=1).sum())),
        "outcomes": float(np.mean(track.outcome == flown.final[0].astype(int))),
    }
