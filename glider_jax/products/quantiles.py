"""Percentiles of many quantities at once, exact for few members and in bounded memory for millions.

NumPy only. A missing value (NaN) means "did not happen": it counts as a member, and as later or larger than anything
that did happen when a percentile of *all* members is asked for.
"""

from __future__ import annotations

import numpy as np

from glider_jax.records import Array

_BINS = 2048


class Quantiles:
    """Percentiles of ``k`` quantities over members that arrive in blocks.

    Up to ``limit`` members all values are kept and percentiles are exact. Beyond it they are counted in 2,048 bins
    per quantity whose range doubles when a value falls outside, so a percentile is good to the range over a thousand.

    Parameters
    ----------
    k : number of quantities.
    limit : number of members up to which values are kept.
    """

    def __init__(self, k: int, limit: int = 50_000) -> None:
        self.k = k
        self.limit = limit
        self.members = 0
        self.finite = np.zeros(k, np.int64)
        self.total = np.zeros(k)
        self.lowest = np.full(k, np.inf)
        self.highest = np.full(k, -np.inf)
        self._blocks: list[Array] = []
        self._sorted: Array | None = None
        self._counts: Array | None = None
        self._low = np.zeros(k)
        self._width = np.ones(k)

    def add(self, values: Array) -> None:
        """Count the values (n,) or (n, k) of a block of members."""
        values = np.asarray(values)
        values = values.reshape(len(values), self.k).astype(float, copy=False)
        if not len(values):
            return
        good = np.isfinite(values)
        everything = bool(good.all())
        self.members += len(values)
        self.finite += len(values) if everything else good.sum(axis=0)
        self.total += values.sum(axis=0) if everything else np.where(good, values, 0.0).sum(axis=0)
        low = values.min(axis=0) if everything else np.where(good, values, np.inf).min(axis=0)
        high = values.max(axis=0) if everything else np.where(good, values, -np.inf).max(axis=0)
        self.lowest, self.highest = np.minimum(self.lowest, low), np.maximum(self.highest, high)
        self._sorted = None
        if self._counts is not None:
            self._bin(values, good)
            return
        self._blocks.append(values if everything else np.where(good, values, np.nan))
        if self.members > self.limit:
            self._start_bins()

    def mean(self) -> Array:
        """Mean of what happened, (k,); NaN where nothing did."""
        return np.where(self.finite > 0, self.total / np.maximum(self.finite, 1), np.nan)

    def share(self) -> Array:
        """Share of members for which it happened, (k,)."""
        return self.finite / max(self.members, 1)

    def at(self, levels: tuple[float, ...], *, of_all: bool = False) -> Array:
        """Percentiles at ``levels`` (0 to 1), shape (level, k).

        With ``of_all`` members for which it did not happen count as beyond every value; a percentile that falls among
        them is NaN. Otherwise they are left out.
        """
        if not self.members:
            return np.full((len(levels), self.k), np.nan)
        return self._exact(levels, of_all) if self._counts is None else self._binned(levels, of_all)

    def _exact(self, levels: tuple[float, ...], of_all: bool) -> Array:
        if self._sorted is None:
            # NaN sorts last, which is where members for which nothing happened belong.
            self._sorted = np.sort(np.concatenate(self._blocks).T, axis=1)
            self._blocks = [self._sorted.T]
        last = (np.full(self.k, self.members) if of_all else self.finite) - 1.0
        rows = np.arange(self.k)
        found = np.empty((len(levels), self.k))
        for i, level in enumerate(levels):
            place = np.maximum(level * last, 0.0)
            below = np.floor(place).astype(int)
            above = np.minimum(below + 1, np.maximum(last.astype(int), 0))
            part = place - below
            a, b = self._sorted[rows, below], self._sorted[rows, above]
            found[i] = np.where(part > 0.0, a + part * (b - a), a)
        return found

    def _binned(self, levels: tuple[float, ...], of_all: bool) -> Array:
        found = np.full((len(levels), self.k), np.nan)
        for j in range(self.k):
            if not self.finite[j]:
                continue
            edges = self._low[j] + self._width[j] * np.arange(_BINS + 1)
            cumulative = np.concatenate([[0.0], np.cumsum(self._counts[j])])
            wanted = np.asarray(levels) * (self.members if of_all else self.finite[j])
            values = np.interp(wanted, cumulative, edges)
            values = np.clip(values, self.lowest[j], self.highest[j])
            found[:, j] = np.where(wanted <= cumulative[-1], values, np.nan)
        return found

    def _start_bins(self) -> None:
        """Turn the values kept so far into counts."""
        span = np.where(self.finite > 0, self.highest - self.lowest, 1.0)
        span = np.maximum(span, 1e-9 * np.maximum(np.abs(np.where(self.finite > 0, self.highest, 1.0)), 1.0))
        self._low = np.where(self.finite > 0, self.lowest, 0.0) - 0.1 * span
        self._width = 1.2 * span / _BINS
        self._counts = np.zeros((self.k, _BINS), np.int64)
        for block in self._blocks:
            self._bin(block, np.isfinite(block))
        self._blocks = []

    def _bin(self, values: Array, good: Array) -> None:
        low = np.where(good, values, np.inf).min(axis=0)
        high = np.where(good, values, -np.inf).max(axis=0)
        for j in np.flatnonzero((low < self._low) | (high >= self._low + _BINS * self._width)):
            if good[:, j].any():
                self._widen(j, low[j], high[j])
        with np.errstate(invalid="ignore"):
            place = np.floor((values - self._low) / self._width)
        place = np.where(good, place, 0.0).astype(np.intp) + np.arange(self.k) * _BINS
        flat = np.bincount(place[good], minlength=self.k * _BINS)
        self._counts += flat.reshape(self.k, _BINS)

    def _widen(self, j: int, low: float, high: float) -> None:
        """Double the range of quantity ``j`` to the side that needs it until ``low`` and ``high`` fit."""
        while low < self._low[j] or high >= self._low[j] + _BINS * self._width[j]:
            merged = self._counts[j].reshape(-1, 2).sum(axis=1)
            to_left = low < self._low[j]
            self._counts[j] = 0
            if to_left:
                self._low[j] -= _BINS * self._width[j]
                self._counts[j, _BINS // 2 :] = merged
            else:
                self._counts[j, : _BINS // 2] = merged
            self._width[j] *= 2.0
