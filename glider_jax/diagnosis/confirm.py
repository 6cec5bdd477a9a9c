"""Does it hold on dives that the fit did not see: whole blocks of dives left out, and the last fifth of the record.

Imports NumPy and the inference. A newcomer would get wrong: a left-out dive next to one that was fitted is not new,
so its neighbours are left out of the fit too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.inference.fit import Linear, Problem
from glider_jax.records import Array

FOLDS, PURGE = 8, 1
#: Nats that held-out dives gain with an effect, and share of their parts that gain, beyond which they confirm it.
ENOUGH, MOST_PARTS = 2.0, 0.6


@dataclass(frozen=True)
class Score:
    """Held-out scores of one stream: rms in shown units and mean log score, before and after; noise floor's rms."""

    stream: str
    unit: str
    n: int
    rms_before: float
    rms_after: float
    log_before: float
    log_after: float
    floor: float


@dataclass(frozen=True)
class Confirmation:
    """What held-out data say: scores per stream, gain in nats, z over folds and the share of folds that gain."""

    streams: tuple[Score, ...]
    gain: float
    z: float
    share: float
    effects: dict[str, tuple[float, float]]


def confirmed(gain: float, share: float) -> bool:
    """Whether held-out dives confirm an effect, by what they gain with it and by the share of their parts that does."""
    return bool(gain > ENOUGH and share >= MOST_PARTS)


def folds_of(linear: Linear, how: str = "blocks", seed: int = 5) -> list[tuple[Array, Array]]:
    """Pairs of rows to fit and rows to score. ``how``: ``blocks``, ``last`` fifth, or ``random`` rows."""
    blocks = np.unique(linear.block)
    if how == "random":
        slot = np.random.default_rng(seed).integers(0, FOLDS, linear.block.size)
        return [(slot != k, slot == k) for k in range(FOLDS)]
    if how == "last":
        if blocks.size < 5:
            return []
        first = blocks[int(np.floor(0.8 * blocks.size))]
        return [(linear.block < first - (PURGE if blocks.size > 10 else 0), linear.block >= first)]
    if blocks.size < 3:
        return []
    purge = PURGE if blocks.size >= 12 else 0
    found = []
    for part in np.array_split(blocks, min(FOLDS, blocks.size)):
        test = np.isin(linear.block, part)
        near = (linear.block >= part[0] - purge) & (linear.block <= part[-1] + purge)
        found.append((~near, test))
    return found


def fitted(linear: Linear, active: list[int], rows: Array) -> Array:
    """Posterior mean from some rows only."""
    j = linear.columns[rows][:, active]
    return np.linalg.solve(j.T @ j + np.diag(linear.precision[active]), j.T @ linear.residual[rows])


def confirm(
    problem: Problem, linear: Linear, fixed: list[int], effects: dict[str, list[int]], how: str = "blocks"
) -> Confirmation:
    """Score calibrations alone against calibrations and effects on rows left out of the fit."""
    active = fixed + [i for columns in effects.values() for i in columns]
    n = linear.residual.size
    before, after = np.full(n, np.nan), np.full(n, np.nan)
    raw_before, raw_after = np.full(n, np.nan), np.full(n, np.nan)
    gains, each = [], {id: [] for id in effects}
    for train, test in folds_of(linear, how):
        for columns, white, raw in ((fixed, before, raw_before), (active, after, raw_after)):
            z = fitted(linear, columns, train)
            white[test] = linear.residual[test] - linear.columns[test][:, columns] @ z
            raw[test] = linear.raw[test] - linear.raw_columns[test][:, columns] @ z
        gains.append(0.5 * float(np.sum(before[test] ** 2 - after[test] ** 2)))
        for id, mine in effects.items():
            rest = [i for i in active if i not in mine]
            z = fitted(linear, rest, train)
            without = linear.residual[test] - linear.columns[test][:, rest] @ z
            each[id].append(0.5 * float(np.sum(without**2 - after[test] ** 2)))
    if not gains:
        return Confirmation((), 0.0, 0.0, 0.0, {})
    scores = []
    for number, name in enumerate(problem.names):
        rows = (linear.stream == number) & np.isfinite(after)
        if not rows.any():
            continue
        stream = problem.gathered.stream(name)
        k = stream.shown_per_unit
        floor = float(np.sqrt(np.mean((raw_after[rows] / np.maximum(np.abs(after[rows]), 1e-9)) ** 2 * 1.0)))
        spread = np.abs(raw_after[rows]) / np.maximum(np.abs(after[rows]), 1e-6)
        floor = float(np.median(spread[np.abs(after[rows]) > 0.3])) if (np.abs(after[rows]) > 0.3).any() else floor
        constant = -0.5 * np.log(2.0 * np.pi)
        scores.append(
            Score(
                name,
                stream.shown,
                int(rows.sum()),
                k * _rms(raw_before[rows]),
                k * _rms(raw_after[rows]),
                float(np.sum(constant - 0.5 * before[rows] ** 2)),
                float(np.sum(constant - 0.5 * after[rows] ** 2)),
                k * floor,
            )  # fmt: skip
        )
    g = np.array(gains)
    spread = float(np.std(g, ddof=1)) if g.size > 1 else abs(float(g[0])) + 1.0
    summed = {
        id: (float(np.sum(v)), float(np.mean(np.array(v) > 0.0))) for id, v in each.items()
    }  # fmt: skip
    z = float(g.sum() / (spread * np.sqrt(g.size) + 1e-9))
    return Confirmation(tuple(scores), float(g.sum()), z, float(np.mean(g > 0.0)), summed)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
