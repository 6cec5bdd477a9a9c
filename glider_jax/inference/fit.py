"""Linear-Gaussian inference on whitened residuals: evidence of any set of effects, their values and uncertainties.

Imports NumPy and the replay. All unknowns are standard normal before the data, calibrations and nuisances are always
free, so an effect that a calibration's sigma explains earns nothing. A newcomer would get wrong: evidence is of a set,
and the linear problem is made anew at the fitted values (Gauss-Newton) before a fitted value is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr

from glider_jax.inference.noise import CourseNoise, LoadNoise, Noise, SeriesNoise, fit_noise
from glider_jax.inference.replay import Replay
from glider_jax.inference.streams import Gathered
from glider_jax.records import Array

#: m s-1; how far from the truth a steady glide model may be at a depth, on dives and climbs each, and in layers where
#: the temperature changes as fast as it does on average. Published vertical water velocities claim 4 to 5 mm/s.
INADEQUACY, IN_LAYERS = 3e-4, 5e-4
NODES = 4
#: Shares of a step that went too far, and how stiff the way is made against directions that are known badly, which a
#: valley that bends asks for.
SHARES, STIFF = (1.0, 0.5, 0.25, 0.1), (0.1, 1.0, 10.0, 100.0)
#: Steps in which an amplitude is tried from end to end, and how often, each time more finely.
ABREAST, FINER = 12, 2
#: Windows of quiet power up to which dives and climbs are whitened together.
MOST_LOADS = 600
#: s; periods of the heaving water that are integrated out of the noise beside the library.
TIDES = (89428.0, 44714.0, 21600.0, 14400.0)


@dataclass(frozen=True)
class Column:
    """One direction in the space of predictions: the unknown it belongs to (-1 beside the replay), term, variant."""

    unknown: int
    name: str
    term: str
    variant: int = 0


@dataclass
class Linear:
    """The problem linearised at values of the unknowns, whitened; rows in the order of the noise laws' streams.

    ``residual`` (n,) is what the unknowns at their centres leave; ``columns`` (n, k); ``gram`` and ``pull`` their
    products. ``block`` (n,) the dive of each row, ``stream`` (n,) its stream's index, ``raw`` and
    ``raw_columns`` are residual and columns before whitening. ``precision`` (k,) is that of each coefficient before the
    data, 1 unless a search states it narrower; ``lower`` and ``upper`` (k,) what physics allows, in prior units.
    """

    residual: Array
    columns: Array
    labels: tuple[Column, ...]
    block: Array
    stream: Array
    raw: Array
    raw_columns: Array
    lower: Array | None = None
    upper: Array | None = None
    gram: Array = field(init=False)
    pull: Array = field(init=False)
    precision: Array = field(init=False)

    def __post_init__(self) -> None:
        self.gram = self.columns.T @ self.columns
        self.pull = self.columns.T @ self.residual
        count = self.columns.shape[1]
        self.precision = np.ones(count)
        self.lower = np.full(count, -np.inf) if self.lower is None else self.lower
        self.upper = np.full(count, np.inf) if self.upper is None else self.upper

    def score(self, active: list[int], precision: Array | None = None, shift: int = -1) -> float:
        """Logarithm of the evidence of a set of columns, up to what all sets share; see :meth:`judged`."""
        return self.judged(active, precision, shift)[0]

    def judged(
        self, active: list[int], precision: Array | None = None, shift: int = -1
    ) -> tuple[float, Array, float]:
        """Evidence of a set of columns within what physics allows, the posterior mean without that limit, and the
        part of the evidence that the limit makes.

        Parameters
        ----------
        precision : of each coefficient before the data, where it is not the problem's own.
        shift : a column that is taken off the residual as it is: an effect looked at away from where it is zero.
        """
        known = self.precision[active] if precision is None else precision
        pull, constant = self.pull[active], 0.0
        if shift >= 0:
            pull = pull - self.gram[active, shift]
            constant = float(self.pull[shift] - 0.5 * self.gram[shift, shift])
        factor = np.linalg.cholesky(self.gram[np.ix_(active, active)] + np.diag(known))
        y = solve_triangular(factor, pull, lower=True, check_finite=False)
        mean = solve_triangular(factor, y, lower=True, trans=1, check_finite=False)
        score = constant + 0.5 * y @ y - np.log(np.diag(factor)).sum() + 0.5 * np.log(known).sum()
        share = allowed(factor, mean, known, self.lower[active], self.upper[active])
        return float(score + share), mean, share

    def solve(self, active: list[int]) -> tuple[Array, Array]:
        """Posterior mean and covariance of a set of columns, prior units."""
        covariance = np.linalg.inv(self.gram[np.ix_(active, active)] + np.diag(self.precision[active]))
        return covariance @ self.pull[active], covariance


def allowed(factor: Array, mean: Array, precision: Array, lower: Array, upper: Array) -> float:
    """What a limit by physics adds to the evidence: share of the posterior inside over that of the prior, logarithm.

    Each coefficient is taken by itself; ``factor`` is the Cholesky factor of the posterior's precision.
    """
    bound = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    if bound.size == 0:
        return 0.0
    unit = np.zeros((mean.size, bound.size))
    unit[bound, np.arange(bound.size)] = 1.0
    sd = np.sqrt((solve_triangular(factor, unit, lower=True, check_finite=False) ** 2).sum(axis=0))
    before = 1.0 / np.sqrt(precision[bound])
    low, high = lower[bound], upper[bound]
    return float((_between(low, high, mean[bound], sd) - _between(low, high, 0.0, before)).sum())


def _between(low: Array, high: Array, mean: Array | float, sd: Array) -> Array:
    """Logarithm of the share of a normal law between two limits."""
    a, b = (low - mean) / sd, (high - mean) / sd
    flip = a > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    above, below = log_ndtr(b), log_ndtr(a)
    return above + np.log1p(-np.exp(np.minimum(below - above, -1e-12)))


@dataclass
class Problem:
    """Everything needed to linearise: data, replay, noise, and where we stand.

    ``values`` are the unknowns' values in their units, ``shapes`` shape parameters that differ from their centres.
    """

    gathered: Gathered
    replay: Replay
    noises: list[Noise]
    values: Array
    shapes: dict[str, float]
    keep: dict[str, Array]

    @property
    def names(self) -> tuple[str, ...]:
        """Streams in the order of rows."""
        return tuple(name for noise in self.noises for name in noise.names)

    def scales(self) -> Array:
        """Prior sd of every unknown."""
        return np.array([u.scale for u in self.replay.unknowns])

    def centres(self) -> Array:
        """Prior mean of every unknown."""
        return np.array([u.centre for u in self.replay.unknowns])


def make_problem(gathered: Gathered, replay: Replay) -> Problem:
    """Choose the noise laws for the streams there are, and start at the vehicle's own numbers."""
    streams = {s.name: s for s in gathered.streams}

    def pair(kind: str):
        names = (f"{kind} east", f"{kind} north")
        return (streams[names[0]], streams[names[1]]) if names[0] in streams else None

    noises: list[Noise] = []
    moved, drift = pair("displacement"), pair("surface drift")
    if moved is not None or drift is not None:
        noises.append(CourseNoise(moved, drift, gathered.product))
    loads = tuple(streams[n] for n in ("hotel power, dives", "hotel power, climbs") if n in streams)
    if len(loads) == 2 and sum(s.n for s in loads) <= MOST_LOADS:
        noises.append(LoadNoise(*loads))
    taken = {name for noise in noises for name in noise.names}
    noises += [SeriesNoise(s) for s in gathered.streams if s.name not in taken]
    values = np.array([u.centre for u in replay.unknowns])
    return Problem(gathered, replay, noises, values, {}, {})


def inadequacy(gathered: Gathered) -> dict[str, Array]:
    """Columns of what a glide model may be wrong by: hats in depth, hats in temperature
    where it changes fast, and what goes with the rate of warming, on dives and on climbs each."""
    stream = gathered.stream("vertical speed")
    if stream is None or stream.n < 50:
        return {}
    direction = stream.covariates["direction"]
    warming = stream.covariates["warming"]
    rapid = np.clip(warming / max(float(np.sqrt(np.mean(warming**2))), 1e-9), -3.0, 3.0)
    columns = []
    for way in (-1.0, 1.0):
        mine = direction == way
        for name, size in (("depth", INADEQUACY), ("temperature", IN_LAYERS * np.abs(rapid))):
            x = stream.covariates[name]
            nodes = np.quantile(x, np.linspace(0.02, 0.98, NODES))
            nodes = np.maximum.accumulate(nodes + 1e-3 * np.arange(NODES))
            for k in range(NODES):
                columns.append(size * np.interp(x, nodes, np.eye(NODES)[k]) * mine)
        columns.append(IN_LAYERS * rapid * mine)
    return {stream.name: np.stack(columns, axis=1)}


def heaving(gathered: Gathered, periods: tuple[float, ...], scale: float) -> Array:
    """Columns (n, 2 per period) of vertical speed under heaving water of some periods; positive rate is down."""
    stream = gathered.stream("vertical speed")
    if stream is None:
        return np.empty((0, 0))
    phase = 2.0 * np.pi * stream.time[:, None] / np.asarray(periods)
    both = np.stack([np.cos(phase), np.sin(phase)], axis=2)
    return -scale * both.reshape(stream.n, -1)


def stack(problem: Problem, per_stream: dict[str, Array], width: int) -> Array:
    """Rows of all streams in order; streams that are not named get zeros."""
    blocks = []
    for name in problem.names:
        n = problem.gathered.stream(name).n
        blocks.append(per_stream[name] if name in per_stream else np.zeros((n, width)))
    return np.concatenate(blocks) if blocks else np.zeros((0, width))


def rows_of(problem: Problem) -> list[slice]:
    """Rows of each noise law."""
    found, start = [], 0
    for noise in problem.noises:
        found.append(slice(start, start + noise.n))
        start += noise.n
    return found


def linearise(
    problem: Problem,
    extra: Callable[[dict[str, Array]], list[tuple[list[Column], dict[str, Array]]]],
    *,
    learn_noise: bool = True,
    harden: int = 0,
    integrate: Array | None = None,
    independent: bool = False,
) -> Linear:
    """Linearise at the problem's values, find the noise, whiten.

    Parameters
    ----------
    extra : makes further columns beside the unknowns' own, with their labels, per stream, of the unknowns' own.
    learn_noise : find the sizes of the noise laws anew, with the library integrated out.
    harden : rounds of reweighting by heavy tails.
    integrate : (n, k) columns integrated out of the noise beside the unknowns' own.
    independent : take every number as independent, for comparison only.
    """
    predicted, own, loose = problem.replay.jacobian(problem.values, problem.shapes)
    for noise in problem.noises:
        # What was open once stays so: sets of effects are compared on rows of which all can speak.
        noise.leave_open(loose, keep=True)
    streams = {s.name: s for s in problem.gathered.streams}
    ahead = (problem.values - problem.centres()) / problem.scales()
    raw = np.concatenate([streams[n].value - predicted[n] for n in problem.names])
    columns = np.nan_to_num(np.concatenate([own[n] for n in problem.names]))
    residual = raw + columns @ ahead
    labels = [Column(i, u.name, u.term) for i, u in enumerate(problem.replay.unknowns)]
    whole = [columns]
    for names, per_stream in extra(own):
        labels += names
        whole.append(stack(problem, per_stream, len(names)))
    everything = np.concatenate(whole, axis=1)
    basis = columns if integrate is None else np.concatenate([columns, integrate], axis=1)
    fixed = [i for i, c in enumerate(labels) if c.term == "inadequacy"]
    basis = np.concatenate([basis, everything[:, fixed]], axis=1)
    white = np.empty_like(everything)
    clean = np.empty_like(residual)
    for noise, rows in zip(problem.noises, rows_of(problem), strict=True):
        if independent:
            _independent(noise)
        elif learn_noise:
            fit_noise(noise, residual[rows], basis[rows])
        for round_ in range(harden + 1):
            out, _ = noise.whiten(np.column_stack([residual[rows], everything[rows]]))
            if round_ < harden:
                j, r = noise.whiten(basis[rows])[0], out[:, 0]
                best = np.linalg.solve(j.T @ j + np.eye(j.shape[1]), j.T @ r)
                noise.harden(r - j @ best)
        clean[rows], white[rows] = out[:, 0], out[:, 1:]
    block = np.concatenate([streams[n].block for n in problem.names])
    which = np.concatenate([np.full(streams[n].n, i) for i, n in enumerate(problem.names)])
    lower, upper = limits(problem, labels)
    return Linear(clean, white, tuple(labels), block, which, residual, everything, lower, upper)


def limits(problem: Problem, labels: Sequence[Column]) -> tuple[Array, Array]:
    """What physics allows of each column's coefficient, in prior units."""
    unknowns = problem.replay.unknowns
    pairs = [
        (-np.inf, np.inf)
        if c.unknown < 0 or unknowns[c.unknown].kind != "candidate"
        else tuple((v - unknowns[c.unknown].centre) / unknowns[c.unknown].scale
                   for v in (unknowns[c.unknown].lower, unknowns[c.unknown].upper))
        for c in labels
    ]  # fmt: skip
    lower, upper = np.array(pairs, float).reshape(-1, 2).T
    return lower, upper


def converged(
    problem: Problem,
    own: list[int],
    beside: dict[str, Array],
    start: Array,
    shapes: dict[str, float],
    widths: Array | None = None,
    rounds: int = 16,
) -> tuple[float, Array]:
    """Evidence of a set of unknowns where their fit comes to rest, under the noise as it is, and the values there.

    Sets can be compared with each other however far from linear their effects are: each is judged at its own best, with
    what turns leave open there.

    Parameters
    ----------
    own : unknowns that are free; all others stay at their centres.
    beside : further columns per stream, always free.
    start : (unknowns,) values to begin at.
    shapes : shape parameters that differ from their centres.
    widths : (own,) prior sd of each free unknown in units of its scale, 1 where not given.
    """
    centres, scales = problem.centres(), problem.scales()
    streams = {s.name: s for s in problem.gathered.streams}
    more = stack(problem, beside, next(iter(beside.values())).shape[1]) if beside else None
    width = np.ones(len(own)) if widths is None else widths
    count = len(own) + (0 if more is None else more.shape[1])
    precision = np.ones(count)
    precision[: len(own)] = width**-2.0
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    for n, k in enumerate(own):
        one = problem.replay.unknowns[k]
        if one.kind == "candidate":
            lower[n], upper[n] = (one.lower - one.centre) / one.scale, (one.upper - one.centre) / one.scale
    values = centres.copy()
    values[own] = start[own]

    def whitened(raw: Array, loose: dict[str, Array]) -> tuple[Array, Array | None, float]:
        """Residuals and columns, the further columns, and half the logarithm of the determinant of the noise."""
        for noise in problem.noises:
            noise.leave_open(loose)
        both = raw if more is None else np.column_stack([raw, more])
        parts = [noise.whiten(both[rows]) for noise, rows in zip(problem.noises, rows_of(problem), strict=True)]
        white, half = np.concatenate([part for part, _ in parts]), sum(half for _, half in parts)
        return white[:, : raw.shape[1]], None if more is None else white[:, raw.shape[1] :], half

    def misfit(left: Array, side: Array | None, here: Array) -> float:
        """Half the sum of squares that is left beside the further columns, and of the prior."""
        if side is not None:
            left = left - side @ np.linalg.solve(side.T @ side + np.eye(side.shape[1]), side.T @ left)
        return 0.5 * float(left @ left + here @ (here * precision[: len(own)]))

    def placed(z: Array) -> Array:
        found = centres.copy()
        for k, step in zip(own, z, strict=True):
            one = problem.replay.unknowns[k]
            found[k] = np.clip(one.centre + one.scale * step, one.lower, one.upper)
        return found

    def cost_of(values: Array) -> float:
        predicted, loose = problem.replay.foresee(values, shapes)
        raw = np.concatenate([streams[n].value - predicted[n] for n in problem.names])
        if not np.isfinite(raw).all():
            return np.inf
        white, side, half = whitened(raw[:, None], loose)
        return misfit(white[:, 0], side, ((values - centres) / scales)[own]) + half

    def furthest() -> Array | None:
        """Where the last step, a part of it or a stiffer one leads down furthest; None where nothing does."""
        inner, outer = normal[: len(own), : len(own)], normal[: len(own), len(own) :]
        inner = inner - outer @ np.linalg.solve(normal[len(own) :, len(own) :], outer.T)
        changes = [share * step for share in SHARES]
        changes += [np.linalg.solve(inner + stiff * np.diag(np.diag(inner)), inner @ step) for stiff in STIFF]
        begun = ((rested - centres) / scales)[own]
        costs = {cost_of(found): found for found in (placed(begun + change) for change in changes)}
        return costs[min(costs)] if min(costs) < lowest else None

    normal, careful = np.eye(count), False
    before = [noise.open for noise in problem.noises]
    best, lowest, rested, step = -np.inf, np.inf, values.copy(), np.zeros(len(own))
    for _ in range(rounds):
        predicted, slopes, loose = problem.replay.slopes(values, shapes, own)
        raw = np.concatenate([streams[n].value - predicted[n] for n in problem.names])
        columns = np.nan_to_num(np.concatenate([slopes[n] for n in problem.names]))
        here = ((values - centres) / scales)[own]
        cost = np.inf
        if np.isfinite(raw).all():
            white, side, half = whitened(np.column_stack([raw + columns @ here, columns]), loose)
            r, j = white[:, 0], white[:, 1:]
            cost = misfit(r - j @ here, side, here) + half
        if not cost < lowest + 0.5:
            # The step went too far; from here on each is tried out first: whole, in part and stiffer.
            careful, values = True, furthest()
            if values is None:
                break
            continue
        settled = lowest - cost < 0.5
        lowest, rested = cost, values.copy()
        j = j if side is None else np.concatenate([j, side], axis=1)
        normal = j.T @ j + np.diag(precision)
        factor = np.linalg.cholesky(normal)
        y = solve_triangular(factor, j.T @ r, lower=True, check_finite=False)
        whole = solve_triangular(factor, y, lower=True, trans=1, check_finite=False)
        # What a step would gain that does not lead down is no evidence.
        best = -cost - np.log(np.diag(factor)).sum() + 0.5 * np.log(precision).sum()
        best = float(best + allowed(factor, whole, precision, lower, upper))
        if settled:
            break
        step = whole[: len(own)] - here
        values = furthest() if careful else placed(whole[: len(own)])
        if values is None:
            break
    for noise, open_ in zip(problem.noises, before, strict=True):
        noise.open = open_
    return best, rested


def nearest(
    problem: Problem, unknown: int, between: tuple[float, float], values: Array, shapes: dict[str, float]
) -> Array:
    """Values with one unknown where it fits best ``between`` two of its own and all others are as given: tried from end
    to end, then more finely about the best.

    Predictions far from linear have valleys beside the deepest, and no step leads from one into another.
    """
    streams = {s.name: s for s in problem.gathered.streams}
    low, high = between
    before = [noise.open for noise in problem.noises]

    def cost(amount: float) -> float:
        there = values.copy()
        there[unknown] = amount
        predicted, loose = problem.replay.foresee(there, shapes)
        total = 0.0
        for noise in problem.noises:
            noise.leave_open(loose)
            left = np.concatenate([streams[n].value - predicted[n] for n in noise.names])
            white, half = noise.whiten(left[:, None])
            total += 0.5 * float(np.sum(white**2)) + half
        return total if np.isfinite(total) else np.inf

    tried: dict[float, float] = {}
    best = low
    for _ in range(FINER):
        step = (high - low) / ABREAST
        tried |= {x: cost(x) for x in np.linspace(low, high, ABREAST + 1) if x not in tried}
        best = min(tried, key=tried.__getitem__)
        low, high = max(low, best - step), min(high, best + step)
    for noise, open_ in zip(problem.noises, before, strict=True):
        noise.open = open_
    found = values.copy()
    found[unknown] = best
    return found


def _independent(noise: Noise) -> None:
    """Put all scatter into the white part."""
    if isinstance(noise, SeriesNoise):
        noise.sizes = np.log([np.exp(noise.sizes[0]), 1e-9, 1e-9, 3600.0])
    elif isinstance(noise, LoadNoise):
        noise.sizes = np.log([*np.exp(noise.sizes[:2]), 1e-9, 1e-9, 3600.0, 1e-9])
    else:
        noise.sizes = np.log([1e-9, 3600.0, 1e-9, np.exp(noise.sizes[3]), np.exp(noise.sizes[4]), 3600.0])


def robust_covariance(linear: Linear, active: list[int], mean: Array, covariance: Array) -> Array:
    """Posterior covariance widened by what the scores of whole dives scatter more than the noise law says."""
    left = linear.residual - linear.columns[:, active] @ mean
    scores = linear.columns[:, active] * left[:, None]
    blocks = np.unique(linear.block)
    summed = np.stack([scores[linear.block == b].sum(axis=0) for b in blocks])
    n = max(blocks.size - 1, 1)
    middle = summed.T @ summed * (blocks.size / n) + np.diag(linear.precision[active])
    sandwich = covariance @ middle @ covariance
    scale = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(covariance), 1.0))
    return covariance * np.outer(scale, scale)
