"""How good forecasts were: proper scores of ensembles, coverage with intervals, skill against a baseline.

NumPy only. A score is a mean over cases; smaller is better for CRPS and energy score. Intervals tell how much a table
of few segments can say: Wilson's for shares, a bootstrap over cases for medians and percentiles.

References
----------
Gneiting and Raftery (2007), Strictly proper scoring rules, equations 20 and 22; Ferro (2014) for the fair ensemble
form; Wilson (1927) for the interval of a share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from glider_jax.errors import DataError
from glider_jax.records import Array

_PAIRS = 1000
_RESAMPLES = 2000


def crps(members: Array, truth: float) -> float:
    """Continuous ranked probability score of an ensemble (n,), in its unit; NaN members are left out.

    The fair form: its expectation does not depend on the number of members. For one member it is the error.
    """
    values = np.sort(np.asarray(members, float)[np.isfinite(members)])
    n = values.size
    if n == 0 or not math.isfinite(truth):
        return math.nan
    miss = float(np.abs(values - truth).mean())
    if n == 1:
        return miss
    # Mean distance between two members, from the sorted values.
    rank = 2.0 * np.arange(1, n + 1) - n - 1.0
    return miss - float(rank @ values) / (n * (n - 1.0))


def energy_score(members: Array, truth: Array) -> float:
    """Energy score of an ensemble of places (n, 2) against one (2,), both in metres; NaN members are left out.

    The mean distance between two members is taken over each member and one other, which is unbiased.
    """
    points = np.asarray(members, float)
    points = points[np.isfinite(points).all(axis=1)]
    truth = np.asarray(truth, float)
    if not len(points) or not np.isfinite(truth).all():
        return math.nan
    miss = float(np.hypot(*(points - truth).T).mean())
    if len(points) == 1:
        return miss
    shifts = range(1, max(2, min(len(points), 1 + math.ceil(_PAIRS * 20 / len(points)))))
    apart = np.mean([np.hypot(*(points - np.roll(points, s, axis=0)).T).mean() for s in shifts])
    return miss - 0.5 * float(apart)


def probability_below(members: Array, truth: float) -> float:
    """Share of the members below the truth (probability integral transform); even over cases if well calibrated."""
    values = np.asarray(members, float)
    values = values[np.isfinite(values)]
    if not values.size or not math.isfinite(truth):
        return math.nan
    return float(((values < truth).sum() + 0.5 * (values == truth).sum()) / values.size)


def within(members: Array, truth: float, probability: float) -> bool | None:
    """Whether the truth lies in the central interval that holds ``probability`` of the members; None if unknown."""
    below = probability_below(members, truth)
    return None if math.isnan(below) else abs(below - 0.5) <= 0.5 * probability


def wilson(hits: int, cases: int, level: float = 0.95) -> tuple[float, float]:
    """Interval of a share from ``hits`` in ``cases``.

    Examples
    --------
    >>> [round(x, 3) for x in wilson(9, 10)]
    [0.596, 0.982]
    """
    if cases == 0:
        return 0.0, 1.0
    if not 0 <= hits <= cases:
        raise DataError(f"coverage: expected hits of 0 to {cases}, found {hits}. Correct the counts.")
    z = _normal_quantile(0.5 + 0.5 * level)
    share = hits / cases
    scale = 1.0 + z * z / cases
    middle = (share + 0.5 * z * z / cases) / scale
    half = z / scale * math.sqrt(share * (1.0 - share) / cases + 0.25 * z * z / cases**2)
    low, high = middle - half, middle + half
    return (0.0 if hits == 0 else max(low, 0.0)), (1.0 if hits == cases else min(high, 1.0))


def _normal_quantile(p: float) -> float:
    """Quantile of the standard normal law by bisection of the error function."""
    low, high = -10.0, 10.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if 0.5 * math.erfc(-middle / math.sqrt(2.0)) < p:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def coverage(flags: Sequence[bool | None]) -> dict[str, float | int | list[float]]:
    """Share of cases inside, their number, and Wilson's 95 % interval; unknown cases are left out."""
    known = [bool(f) for f in flags if f is not None]
    hits = sum(known)
    low, high = wilson(hits, len(known))
    share = hits / len(known) if known else math.nan
    return {"share": share, "hits": hits, "cases": len(known), "interval": [low, high]}


def bootstrap(
    values: Array, statistic: Callable[[Array], float], *, level: float = 0.95, seed: int = 0
) -> tuple[float, float]:
    """Percentile interval of a statistic over resampled cases (n,) or (n, k), rows kept together."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return math.nan, math.nan
    rng = np.random.default_rng(seed)
    drawn = [statistic(values[rng.integers(0, len(values), len(values))]) for _ in range(_RESAMPLES)]
    tail = 0.5 - 0.5 * level
    low, high = np.quantile(drawn, [tail, 1.0 - tail])
    return float(low), float(high)


def error_table(
    errors: Array, probabilities: tuple[float, ...] = (0.5, 0.9)
) -> dict[str, float | list[float]]:
    """Quantiles of errors over cases, with bootstrap intervals; linear between order statistics."""
    values = np.asarray(errors, float)
    values = values[np.isfinite(values)]
    table: dict[str, float | list[float]] = {}
    for p in probabilities:
        name = "median" if p == 0.5 else f"p{round(100 * p)}"
        table[name] = float(np.quantile(values, p)) if values.size else math.nan
        table[f"{name}_interval"] = list(bootstrap(values, lambda v, p=p: float(np.quantile(v, p))))
    return table


def skill(scores: Array, baseline: Array) -> dict[str, float | list[float]]:
    """One less the ratio of mean score to mean baseline over the same cases, with a bootstrap interval.

    1 is perfect, 0 as good as the baseline, negative worse.
    """
    pairs = np.stack([np.asarray(scores, float), np.asarray(baseline, float)], axis=1)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]

    def one(rows: Array) -> float:
        reference = rows[:, 1].mean()
        return float(1.0 - rows[:, 0].mean() / reference) if reference > 0.0 else math.nan

    value = one(pairs) if len(pairs) else math.nan
    return {"skill": value, "interval": list(bootstrap(pairs, one)), "cases": len(pairs)}


def reliability(below: Array, probabilities: tuple[float, ...] = (0.1, 0.25, 0.5, 0.75, 0.9)) -> list[dict]:
    """For central intervals of several probabilities, the share of cases inside with Wilson's interval.

    ``below`` are probability integral transforms (n,), NaN where unknown.
    """
    known = np.asarray(below, float)
    known = known[np.isfinite(known)]
    rows = []
    for p in probabilities:
        rows.append({"probability": p, **coverage(list(np.abs(known - 0.5) <= 0.5 * p))})
    return rows
