"""Noise that is honest: what residuals look like when the physics is right.

All sizes are found by marginal likelihood while the physics is integrated out. A *series* has white noise, one random
offset per group and a slow red process. *Navigation* has a red current error that displacements average and drifts
feel, a surface part of it, and white noise of either. *Quiet power* of dives and climbs shares its slow wander. A
newcomer would get wrong: taking samples as independent makes almost any effect look certain; 55 of 60 missions without
one then raise an alarm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from glider_jax.inference.streams import Stream
from glider_jax.records import Array

#: Degrees of freedom of the heavy tails; a residual of z weighs as one whose variance is (5 + z^2) / 6 times larger.
TAILS = 5.0
#: Streams up to this long are whitened by a dense factor, longer ones by a filter.
DENSE = 400


class Law(NamedTuple):
    """A size to be found: start, and the log-normal belief about it (median, factor)."""

    name: str
    median: float
    factor: float


@dataclass
class SeriesNoise:
    """White + one offset per group + slow Ornstein-Uhlenbeck process, for one stream in order of time."""

    stream: Stream
    sizes: Array = field(default_factory=lambda: np.zeros(4))
    inflation: Array | None = None
    open: Array | float = 0.0
    kept: Array | float = 0.0

    def __post_init__(self) -> None:
        s = self.stream
        self.order = np.lexsort((s.time,))
        spread = max(_robust_sd(s.value - np.median(s.value)), 1e-9)
        floor = _FLOOR.get(s.name, 1e-3 * spread)
        self.laws = (
            Law("white", _WHITE.get(s.name, 0.3 * spread), 3.0),
            Law("offset", _WHITE.get(s.name, 0.3 * spread), 4.0),
            Law("slow", *_SLOW.get(s.name, (_WHITE.get(s.name, 0.3 * spread), 4.0))),
            Law("time", *_SLOWNESS.get(s.name, (4.0 * 3600.0, 3.0))),
        )
        self.floor = self.least = floor
        self.sizes = np.log([law.median for law in self.laws])
        if self.inflation is None:
            self.inflation = np.ones(s.n)
        time = s.time[self.order]
        group = s.group[self.order]
        self.lapse = np.maximum(np.diff(time, prepend=time[0]), 0.0)
        self.fresh = np.diff(group, prepend=group[0] - 1) != 0
        self.names = (s.name,)
        self.lags: Array | None = None
        self.n = s.n

    def whiten(self, columns: Array, sizes: Array | None = None) -> tuple[Array, float]:
        """Independent unit-variance residuals, (n, k), and half the logarithm of the covariance's determinant."""
        sizes = self.sizes if sizes is None else sizes
        white, offset, slow, tau = np.exp(sizes)
        variance = (white**2 / self.stream.weight + self.floor**2) * self.inflation + self.open**2
        order = self.order
        if self.n <= DENSE:
            return self._dense(columns, variance, offset, slow, tau)
        width, long = columns.shape[1], -(-self.n // 2048) * 2048
        padded = np.zeros((long, -(-width // 128) * 128))
        padded[: self.n, :width] = columns[order]
        more = (0, long - self.n)
        found, logs = _innovations(
            jnp.asarray(padded), np.pad(self.lapse, more), np.pad(self.fresh, more),
            np.pad(variance[order], more, constant_values=1.0), offset**2, slow**2, tau,
        )  # fmt: skip
        out = np.empty_like(columns)
        out[order] = np.asarray(found)[: self.n, :width]
        return out, 0.5 * float(np.asarray(logs)[: self.n].sum())

    def _dense(self, columns: Array, variance: Array, offset: float, slow: float, tau: float) -> tuple[Array, float]:
        time, group = self.stream.time, self.stream.group
        if self.lags is None:
            self.lags = np.abs(np.subtract.outer(time, time))
            self.alike = np.equal.outer(group, group).astype(float)
        covariance = slow**2 * np.exp(-self.lags / tau) + offset**2 * self.alike + np.diag(variance)
        order = self.order
        lower = np.linalg.cholesky(covariance[np.ix_(order, order)])
        out = np.empty_like(columns)
        out[order] = solve_triangular(lower, columns[order], lower=True, check_finite=False)
        return out, float(np.log(np.diag(lower)).sum())

    def belief(self, sizes: Array) -> float:
        """Logarithm of the belief about the sizes."""
        return -0.5 * sum(
            ((x - np.log(q.median)) / np.log(q.factor)) ** 2 for x, q in zip(sizes, self.laws, strict=True)
        )

    def leave_open(self, sds: Mapping[str, Array], keep: bool = False) -> None:
        """Take over what predictions are open by, (n,) per stream, in its unit; at least as much as was kept before."""
        self.open = np.maximum(self.kept, sds.get(self.names[0], 0.0))
        self.kept = self.open if keep else self.kept

    def harden(self, whitened: Array) -> None:
        """Give large residuals the weight that heavy tails leave them."""
        z = np.abs(whitened)
        self.inflation = self.inflation * np.where(z > 2.5, (TAILS + z * z) / (TAILS + 1.0), 1.0)


#: What streams without any left-out physics scatter by; medians of the beliefs, SI.
_WHITE = {
    "vertical speed": 0.002, "pump out energy": 5.0, "pump in energy": 5.0, "hotel power, dives": 0.02,
    "hotel power, climbs": 0.02, "surface power": 0.05, "battery voltage": 0.01, "turn depth": 0.5, "water depth": 1.0,
    "depth at the surface": 0.05, "surface stay": 30.0, "charge counter": 0.002, "speed through water": 0.01,
}  # fmt: skip
#: s and factor; the water heaves within minutes, instruments and loads wander within hours.
_SLOWNESS = {"vertical speed": (900.0, 4.0)}
#: An acoustic profiler states 0.3 % and 0.3 cm/s: what it is wrong by for hours is little beside its scatter.
_SLOW = {"speed through water": (0.003, 2.0)}
#: Below this no instrument of a glider is exact; added to the white part.
_FLOOR = {
    "vertical speed": 3e-4, "pump out energy": 1.0, "pump in energy": 1.0, "hotel power, dives": 0.002,
    "hotel power, climbs": 0.002, "surface power": 0.004, "battery voltage": 0.002, "turn depth": 0.05,
    "water depth": 0.1, "depth at the surface": 0.01, "surface stay": 3.0, "charge counter": 0.002,
    "speed through water": 1e-3,
}  # fmt: skip


@jax.jit
def _innovations(columns, lapse, fresh, variance, offset, slow, tau):
    """Kalman filter for a slow process and a group offset; gains are common to all columns."""
    fade = jnp.exp(-lapse / tau)

    def step(state, row):
        mean, p = state
        data, a, new, r = row
        keep = jnp.where(new, 0.0, 1.0)
        s, g = a * mean[0], keep * mean[1]
        pss = a * a * p[0] + slow * (1.0 - a * a)
        psg = a * keep * p[1]
        pgg = jnp.where(new, offset, p[2])
        total = pss + 2.0 * psg + pgg + r
        miss = data - s - g
        ks, kg = (pss + psg) / total, (psg + pgg) / total
        p = jnp.stack([pss - ks * (pss + psg), psg - ks * (psg + pgg), pgg - kg * (psg + pgg)])
        root = jnp.sqrt(total)
        return (jnp.stack([s + ks * miss, g + kg * miss]), p), (miss / root, jnp.log(total))

    start = (jnp.zeros((2, columns.shape[1])), jnp.stack([slow, 0.0 * slow, offset]))
    _, (found, logs) = jax.lax.scan(step, start, (columns, fade, fresh, variance), unroll=4)
    return found, logs


@dataclass
class CourseNoise:
    """Red current error felt by displacements (their mean) and drifts (then and there), a surface part, and white."""

    displacement: tuple[Stream, Stream] | None
    drift: tuple[Stream, Stream] | None
    product: bool
    sizes: Array = field(default_factory=lambda: np.zeros(6))
    inflation: Array | None = None
    open: Array | float = 0.0
    kept: Array | float = 0.0

    def __post_init__(self) -> None:
        pairs = [p for p in (self.displacement, self.drift) if p is not None]
        self.names = tuple(s.name for p in pairs for s in p)
        counts = [p[0].n for p in pairs]
        self.n = 2 * sum(counts)
        known = 0.03 if self.product else 0.10
        self.laws = (
            Law("current error", known, 2.5),
            Law("time", 8.0 * 3600.0, 2.5),
            Law("surface error", 0.5 * known, 3.0),
            Law("displacement", 0.006, 2.0),
            Law("drift", 0.008, 2.0),
            Law("surface time", 4.0 * 3600.0, 3.0),
        )
        self.sizes = np.log([law.median for law in self.laws])
        # Six moments stand for the mean over a dive segment.
        nodes = (np.arange(6) + 0.5) / 6.0 - 0.5
        moments, owner = [], []
        place = 0
        for pair, parts in ((self.displacement, nodes), (self.drift, np.zeros(1))):
            if pair is None:
                continue
            for t, span in zip(pair[0].time, pair[0].span, strict=True):
                moments += list(t + span * parts)
                owner += [place] * parts.size
                place += 1
        self.lags = np.abs(np.subtract.outer(moments, moments))
        self.mean = np.zeros((place, len(moments)))
        self.mean[owner, np.arange(len(moments))] = 1.0
        self.mean /= self.mean.sum(axis=1, keepdims=True)
        self.at_surface = np.arange(place) >= (self.displacement[0].n if self.displacement else 0)
        self.weight = np.concatenate([p[0].weight for p in pairs])
        self.one, self.least = place, 1e-3
        if self.inflation is None:
            self.inflation = np.ones(place)
        # Rows arrive as displacement east, north, drift east, north; components are whitened one by one.
        first, east, north = 0, [], []
        for pair in pairs:
            k = pair[0].n
            east += list(range(first, first + k))
            north += list(range(first + k, first + 2 * k))
            first += 2 * k
        self.rows = (np.array(east), np.array(north))

    def covariance(self, sizes: Array) -> Array:
        """Covariance of one component, (displacements + drifts) squared."""
        error, tau, surface, displaced, drifted, brief = np.exp(sizes)
        whole = self.mean @ np.exp(-self.lags / tau) @ self.mean.T
        above = self.mean @ np.exp(-self.lags / brief) @ self.mean.T
        up = self.at_surface.astype(float)
        white = np.where(self.at_surface, drifted**2 / self.weight, displaced**2)
        return error**2 * whole + surface**2 * above * np.outer(up, up) + np.diag(white * self.inflation + self.open**2)

    def whiten(self, columns: Array, sizes: Array | None = None) -> tuple[Array, float]:
        """As for a series, with east and north independent and alike."""
        lower = np.linalg.cholesky(self.covariance(self.sizes if sizes is None else sizes))
        out = np.empty_like(columns)
        for rows in self.rows:
            out[rows] = solve_triangular(lower, columns[rows], lower=True)
        return out, 2.0 * float(np.log(np.diag(lower)).sum())

    belief = SeriesNoise.belief

    def leave_open(self, sds: Mapping[str, Array], keep: bool = False) -> None:
        """As for a series; a drift at the surface knows no turn."""
        if self.displacement is not None and self.displacement[0].name in sds:
            way = np.pad(sds[self.displacement[0].name], (0, int(self.at_surface.sum())))
            self.open = np.maximum(self.kept, way)
            self.kept = self.open if keep else self.kept

    def harden(self, whitened: Array) -> None:
        """Give moments whose whitened residual is large the weight that heavy tails leave them."""
        z = np.maximum(*(np.abs(whitened[rows]) for rows in self.rows))
        self.inflation = self.inflation * np.where(z > 3.0, (TAILS + z * z) / (TAILS + 1.0), 1.0)


@dataclass
class LoadNoise:
    """Quiet power of dives and climbs: what wanders in the hotel load wanders in both, a little in either alone.

    Rows are dives first, then climbs. A newcomer would get wrong: with laws of their own, a slow load of the dives
    alone explains a steady one.
    """

    dives: Stream
    climbs: Stream
    sizes: Array = field(default_factory=lambda: np.zeros(6))
    inflation: Array | None = None
    open: float = 0.0

    def __post_init__(self) -> None:
        both = (self.dives, self.climbs)
        self.names = tuple(s.name for s in both)
        self.n = sum(s.n for s in both)
        whites = [_WHITE.get(s.name, 0.02) for s in both]
        usual = float(np.mean(whites))
        self.laws = (
            Law("white", whites[0], 3.0),
            Law("white on climbs", whites[1], 3.0),
            Law("offset", usual, 4.0),
            Law("slow", usual, 4.0),
            Law("time", 4.0 * 3600.0, 3.0),
            Law("slow of one phase", 0.15 * usual, 3.0),
        )
        self.sizes = np.log([law.median for law in self.laws])
        self.floor = np.concatenate([np.full(s.n, _FLOOR.get(s.name, 0.002)) for s in both])
        self.least = float(self.floor.min())
        if self.inflation is None:
            self.inflation = np.ones(self.n)
        time, group, weight = (np.concatenate([getattr(s, name) for s in both]) for name in ("time", "group", "weight"))
        self.weight, self.climbing = weight, np.arange(self.n) >= self.dives.n
        self.lags = np.abs(np.subtract.outer(time, time))
        self.alike = np.equal.outer(group, group).astype(float)
        self.same = np.equal.outer(self.climbing, self.climbing).astype(float)

    def whiten(self, columns: Array, sizes: Array | None = None) -> tuple[Array, float]:
        """As for a series, dives and climbs together."""
        down, up, offset, slow, tau, own = np.exp(self.sizes if sizes is None else sizes)
        white = np.where(self.climbing, up, down) ** 2 / self.weight + self.floor**2
        fade = np.exp(-self.lags / tau)
        covariance = (slow**2 + own**2 * self.same) * fade + offset**2 * self.alike
        lower = np.linalg.cholesky(covariance + np.diag(white * self.inflation))
        out = solve_triangular(lower, columns, lower=True, check_finite=False)
        return out, float(np.log(np.diag(lower)).sum())

    belief = SeriesNoise.belief
    harden = SeriesNoise.harden

    def leave_open(self, sds: Mapping[str, Array], keep: bool = False) -> None:
        """A load knows no turn."""


Noise = SeriesNoise | CourseNoise | LoadNoise


def marginal(noise: Noise, sizes: Array, residual: Array, columns: Array) -> float:
    """Logarithm of the evidence of one noise law, its belief included, with unit-normal unknowns integrated out."""
    white, half = noise.whiten(np.column_stack([residual, columns]), sizes)
    r, j = white[:, 0], white[:, 1:]
    normal = j.T @ j + np.eye(j.shape[1])
    pull = j.T @ r
    factor = cho_factor(normal, lower=True)
    fitted = pull @ cho_solve(factor, pull)
    log_size = np.log(np.diag(factor[0])).sum()
    return float(-0.5 * (r @ r - fitted) - log_size - half + noise.belief(sizes))


def fit_noise(noise: Noise, residual: Array, columns: Array, rounds: int = 160) -> float:
    """Find the sizes of a noise law by marginal likelihood; returns the logarithm of the evidence reached.

    Parameters
    ----------
    residual : (n,) observed minus predicted, in the law's order of streams.
    columns : (n, k) derivatives by the unknowns that are integrated out, per prior sd of each.
    """
    columns = _condense(columns, noise.least)

    def cost(sizes: Array) -> float:
        if np.abs(sizes - centre).max() > 9.0:
            return 1e12
        try:
            return -marginal(noise, sizes, residual, columns)
        except np.linalg.LinAlgError:
            return 1e12

    centre = np.log([law.median for law in noise.laws])
    # Where the sizes of a long stream were found before, they have not gone far.
    near = noise.n > 2 * DENSE and not np.allclose(noise.sizes, centre)
    simplex = _simplex(noise.sizes, 0.25 if near else 0.7)
    found = minimize(
        cost, noise.sizes, method="Nelder-Mead",
        options={"maxfev": rounds // 2 if near else rounds, "xatol": 0.02, "fatol": 0.05, "initial_simplex": simplex},
    )  # fmt: skip
    noise.sizes = found.x
    return -float(found.fun)


def _simplex(start: Array, reach: float) -> Array:
    return np.vstack([start, start + reach * np.eye(start.size)])


def _condense(columns: Array, least: float) -> Array:
    """Fewer columns of nearly the same span and prior: directions that noise of size ``least`` lets be seen."""
    columns = columns[:, np.abs(columns).max(axis=0) > 0.0] if columns.size else columns
    if columns.shape[1] < 3:
        return columns
    normal = columns.T @ columns
    values, vectors = np.linalg.eigh(normal)
    keep = values > max(1e-9 * values.max(), 0.01 * least**2)
    return columns @ vectors[:, keep]


def _robust_sd(values: Array) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values))))
