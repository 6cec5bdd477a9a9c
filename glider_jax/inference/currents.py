"""What the water will do, from what the glider itself has felt: depth averages of its dives and drifts at the surface.

NumPy only. One Gaussian process for each of east and north: a constant, a semidiurnal and a daily part (diurnal tide
and inertial motion) that keep their phase for days, and an Ornstein-Uhlenbeck rest. Surface drifts see the same water
plus a shear of its own memory. How strong each part is nobody knows beforehand, so all strengths of a grid are tried
and weighted by how well they explain what was seen; with one dive the answer stays wide, with many it is a tide
prediction. A depth average is the mean over its interval, not a value at its middle.

Every prior below is physics or literature, none was fitted to a recording.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from glider_jax.errors import DataError
from glider_jax.records import Array

HOUR = 3600.0
#: rad/s, M2 and K1 (astronomy).
SEMIDIURNAL, DIURNAL = 1.405189e-4, 7.292116e-5
_EARTH_TURN = 7.292116e-5
#: s; neighbouring constituents (S2 and M2) part within about a week, inertial motion dies out within days.
_TIDAL_MEMORY, _INERTIAL_MEMORY = 6.0 * 86400.0, 2.5 * 86400.0
#: m/s, 1-sigma of the mean current; shelves and slopes show 0.05 to 0.3.
_MEAN_SD = 0.12
#: m/s, 1-sigma of each part, tried in turn: open ocean, shelf, strong tides; quiet, shelf, fronts and eddies.
_SEMIDIURNAL_SD = (0.02, 0.08, 0.3)
_DAILY_SD = (0.02, 0.07)
_REST_SD = (0.03, 0.1, 0.25)
_REST_MEMORY = (6.0 * HOUR, 36.0 * HOUR)
#: m/s and s; wind drift and shear of the upper metres, 1 to 3 % of the wind.
_SHEAR_SD = (0.04, 0.12, 0.3)
_SHEAR_MEMORY = 9.0 * HOUR
#: m/s and m; a depth average is good to 1 to 2 cm/s, and to what two fixes are over its time.
_OWN_SD, _FIXES_SD = 0.015, 15.0
#: m/s; how far the current of a dive lies from the mean when nobody measured it.
_UNKNOWN_SD = 0.05
#: m/s; positions of a few minutes of drift.
_DRIFT_SD = 0.03
_NODES = 4
_LATEST = 48


@dataclass(frozen=True)
class Observations:
    """Currents the glider felt; arrays of one length.

    ``begin``, ``end`` UTC seconds (equal for a drift); ``east``, ``north``, ``sd`` m/s; ``surface`` True for drifts.
    """

    begin: Array
    end: Array
    east: Array
    north: Array
    sd: Array
    surface: Array

    @property
    def size(self) -> int:
        """Number of observations."""
        return int(self.begin.size)


class _Choice(NamedTuple):
    """One set of strengths, its weight, and the normal law of what it predicts."""

    weight: float
    mean: Array
    root: Array


@dataclass(frozen=True)
class Estimate:
    """Currents to come at the moments ``time`` (k,) UTC seconds: a mixture of normal laws.

    Attributes
    ----------
    mean : (2, k) m/s east and north of the depth average; ``sd`` (k,) its 1-sigma per component.
    surface_mean : (2, k) m/s of the water at the surface beyond the depth average; ``surface_sd`` (k,).
    strengths : weighted means of the parts' 1-sigma, m/s, by name: ``semidiurnal``, ``daily``, ``rest``, ``shear``.
    observations : number of depth averages used.  last : when the newest ended, NaN without any.
    product_weight : belief, 0 to 1, that the given product explains what was felt better than nothing does.
    """

    time: Array
    mean: Array
    sd: Array
    surface_mean: Array
    surface_sd: Array
    strengths: dict[str, float]
    observations: int
    last: float
    product_weight: float
    choices: tuple[_Choice, ...]

    def sample(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw ``n`` courses of the current and of the surface's excess, each (n, 2, k) m/s."""
        k = self.time.size
        shares = np.array([c.weight for c in self.choices])
        picked = rng.choice(len(self.choices), size=n, p=shares / shares.sum())
        normal = rng.standard_normal((n, 2, 2 * k))
        drawn = np.empty((n, 2, 2 * k))
        for j, choice in enumerate(self.choices):
            mine = picked == j
            drawn[mine] = choice.mean + normal[mine] @ choice.root.T
        return drawn[:, :, :k], drawn[:, :, k:]


def inertial_frequency(latitude: float) -> float:
    """Magnitude of the frequency of inertial motion in rad/s at a latitude in degrees."""
    return 2.0 * _EARTH_TURN * abs(np.sin(np.radians(latitude)))


def observe(segments, *, latest: int = _LATEST) -> Observations:
    """Depth averages and surface drifts of dive segments, the newest ``latest`` of them.

    A segment's own average is preferred to the glider's, because forecasts use the same dead reckoning and what is
    wrong with it cancels; where there is none the glider's is taken. Where there is neither, the way over the ground
    stands for that through the water, and the current is zero by definition, to what a change would make of it.
    """
    rows = []
    for one in list(segments)[-latest:]:
        east, north = one.current_east, one.current_north
        if not (np.isfinite(east) and np.isfinite(north)):
            east, north = one.glider_current_east, one.glider_current_north
        if not (np.isfinite(east) or np.isfinite(north) or np.isfinite(one.water_east)):
            rows.append((one.dive_time, one.surface_time, 0.0, 0.0, _UNKNOWN_SD, False))
        elif np.isfinite(east) and np.isfinite(north) and np.hypot(east, north) < 3.0:
            row = felt(one.dive_time, one.surface_time, east, north)
            rows.append((*row[:4], row[4] * (2.0 if one.gap or one.dives > 1 else 1.0), False))
        if np.isfinite(one.drift_east) and np.isfinite(one.drift_north):
            rows.append(drifted(one.dive_time - 300.0, one.drift_east, one.drift_north))
    return observations(rows)


def drifted(moment: float, east: float, north: float) -> tuple[float, float, float, float, float, bool]:
    """A row for :func:`observations`: surface drift in m/s about a moment."""
    return moment, moment, east, north, _DRIFT_SD, True


def felt(
    begin: float, end: float, east: float, north: float
) -> tuple[float, float, float, float, float, bool]:
    """A row for :func:`observations`: a depth average in m/s over a dive."""
    return begin, end, east, north, float(np.hypot(_OWN_SD, _FIXES_SD / max(end - begin, 60.0))), False


def observations(rows) -> Observations:
    """Observations from rows of (begin, end, east, north, sd, surface)."""
    table = np.array([row[:5] for row in rows], float).reshape(-1, 5)
    surface = np.array([bool(row[5]) for row in rows], bool)
    if not np.isfinite(table).all() or np.any(table[:, 1] < table[:, 0]) or np.any(table[:, 4] <= 0.0):
        raise DataError(
            "currents: expected finite observations with ends after their beginnings and positive errors, found "
            "others. Leave out what the glider did not measure."
        )
    return Observations(*table[:, :5].T, surface)


def estimate_currents(
    seen: Observations, latitude: float, time: Array, *, product=None, rest_sd: tuple[float, ...] = _REST_SD
) -> Estimate:
    """Predict currents at moments to come (or past) from what the glider felt.

    Parameters
    ----------
    seen : observations, none is allowed.  latitude : degrees, for the inertial frequency.
    time : (k,) UTC seconds at which currents are wanted.
    product : None, or a function of UTC seconds (m,) that gives (2, m) east and north m/s of a forecast product
        where the glider is. It becomes the mean about which the parts vary, as far as it explains what was felt.
    rest_sd : strengths of the rest to try, m/s.
    """
    time = np.asarray(time, float)
    obs = _Averages.of(seen)
    own, cross, target = _kernels(obs, time, inertial_frequency(latitude))
    grid = list(itertools.product(_SEMIDIURNAL_SD, _DAILY_SD, rest_sd, range(len(_REST_MEMORY)), _SHEAR_SD))
    scale = np.array([_variances(*row) for row in grid])
    values = np.stack([seen.east, seen.north]) if seen.size else np.zeros((2, 0))
    means = [(np.zeros((2, time.size)), values)]
    if product is not None:
        means.append((_finite(product(time)), values - obs.average(lambda t: _finite(product(t)))))
    covariance = np.tensordot(scale, own, 1) + np.diag(seen.sd**2)
    root = np.linalg.cholesky(covariance) if seen.size else np.zeros((len(grid), 0, 0))
    log_det = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1)
    scores = np.stack(
        [-0.5 * np.sum(np.linalg.solve(root, left.T) ** 2, (1, 2)) - 2.0 * log_det for _, left in means]
    )
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    kept = [(m, g) for m, g in zip(*np.nonzero(weights > 0.003 * weights.max()), strict=True)]
    choices = []
    for m, g in kept:
        base, left = means[m]
        across = np.tensordot(scale[g], cross, 1)
        half = np.linalg.solve(root[g], across)
        mean = (half.T @ np.linalg.solve(root[g], left.T)).T + np.concatenate([base, np.zeros_like(base)], 1)
        after = np.tensordot(scale[g], target, 1) - half.T @ half
        choices.append(_Choice(float(weights[m, g]), mean, _root(after)))
    share = np.array([c.weight for c in choices])
    share /= share.sum()
    mean = sum(w * c.mean for w, c in zip(share, choices, strict=True))
    spread = sum(
        w * (np.sum(c.root**2, 1) + np.mean((c.mean - mean) ** 2, 0))
        for w, c in zip(share, choices, strict=True)
    )
    k = time.size
    depth_averages = ~seen.surface
    total = weights.sum(0)
    strengths = {
        name: float(total @ np.array([row[j] for row in grid]))
        for name, j in (("semidiurnal", 0), ("daily", 1), ("rest", 2), ("shear", 4))
    }
    return Estimate(
        time=time, mean=mean[:, :k], sd=np.sqrt(spread[:k]), surface_mean=mean[:, k:], surface_sd=np.sqrt(spread[k:]),
        strengths=strengths, observations=int(depth_averages.sum()),
        last=float(seen.end[depth_averages].max()) if depth_averages.any() else float("nan"),
        product_weight=float(weights[1].sum()) if product is not None else 0.0, choices=tuple(choices),
    )  # fmt: skip


def _variances(semidiurnal, daily, rest, memory, shear):
    """Variance on each of the kernels of :func:`_kernels` for one set of strengths."""
    rests = [0.0] * len(_REST_MEMORY)
    rests[memory] = rest**2
    return [_MEAN_SD**2, semidiurnal**2, 0.5 * daily**2, 0.5 * daily**2, *rests, shear**2]


class _Averages(NamedTuple):
    """Observations as weighted means over moments: ``time`` (m,), ``weight`` (n, m), which are at the surface (n,)."""

    time: Array
    weight: Array
    surface: Array

    @classmethod
    def of(cls, seen: Observations) -> _Averages:
        """Gauss points over each interval; one point for a drift."""
        node, weight = np.polynomial.legendre.leggauss(_NODES)
        middle, half = 0.5 * (seen.begin + seen.end), 0.5 * (seen.end - seen.begin)
        time = (middle[:, None] + half[:, None] * node).ravel()
        return cls(time, np.kron(np.eye(seen.size), 0.5 * weight), seen.surface)

    def average(self, field) -> Array:
        """Means (2, n) of a function of time."""
        return field(self.time) @ self.weight.T


def _kernels(obs: _Averages, time: Array, inertial: float):
    """Unit kernels of all parts: among observations, from observations to targets, among targets.

    Targets are the depth average at ``time`` followed by the surface's excess there. The last kernel is the shear.
    """
    laws = [
        np.ones_like,
        lambda lag: np.cos(SEMIDIURNAL * lag) * np.exp(-lag / _TIDAL_MEMORY),
        lambda lag: np.cos(DIURNAL * lag) * np.exp(-lag / _TIDAL_MEMORY),
        lambda lag: np.cos(inertial * lag) * np.exp(-lag / _INERTIAL_MEMORY),
        *(lambda lag, memory=memory: np.exp(-lag / memory) for memory in _REST_MEMORY),
    ]
    points = [
        np.abs(np.subtract.outer(a, b)) for a, b in ((obs.time, obs.time), (obs.time, time), (time, time))
    ]
    weight = obs.weight
    nothing = np.zeros((time.size, time.size))
    own, cross, target = [], [], []
    for law in laws:
        own.append(weight @ law(points[0]) @ weight.T)
        cross.append(np.concatenate([weight @ law(points[1]), np.zeros((weight.shape[0], time.size))], 1))
        target.append(np.block([[law(points[2]), nothing], [nothing, nothing]]))
    shear = [np.exp(-lag / _SHEAR_MEMORY) for lag in points]
    top = obs.surface.astype(float)
    own.append(weight @ shear[0] @ weight.T * np.outer(top, top))
    cross.append(
        np.concatenate([np.zeros((weight.shape[0], time.size)), top[:, None] * (weight @ shear[1])], 1)
    )
    target.append(np.block([[nothing, nothing], [nothing, shear[2]]]))
    return np.array(own), np.array(cross), np.array(target)


def _root(covariance: Array) -> Array:
    """A matrix whose product with its transpose is the covariance; tiny negative eigenvalues count as zero."""
    value, vector = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vector * np.sqrt(np.maximum(value, 0.0))


def _finite(values) -> Array:
    """A product's values with holes as still water."""
    return np.nan_to_num(np.asarray(values, float), nan=0.0, posinf=0.0, neginf=0.0)
