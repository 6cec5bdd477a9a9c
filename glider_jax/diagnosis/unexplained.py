"""None of the above: what structure remains once the accepted effects are in, how large, where, and of what shape.

Imports NumPy and the inference. A newcomer would get wrong: the shape is fitted beside the accepted effects, not after
them, so it holds only what they cannot explain; and it has no name.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.diagnosis.locate import SHOWN, Place, covariates, places
from glider_jax.inference.fit import Linear, Problem
from glider_jax.records import Array

#: Chance at which remaining structure is reported, over all streams and covariates together.
CHANCE = 0.01
#: Share of a stream's variance, and size against its scatter, below which remaining structure is not worth a word.
LEAST_SHARE, LEAST_SIZE = 0.03, 0.35
#: nats on held-out dives that a shape without a name must earn.
LEAST_GAIN = 6.0
NODES = 12


@dataclass(frozen=True)
class Remainder:
    """Structure without a name: place, rms in shown units, curve over the covariate, and held-out gain in nats."""

    place: Place
    rms: float
    unit: str
    axis: Array
    curve: Array
    sd: Array
    axis_unit: str
    gain: float


def remainders(problem: Problem, linear: Linear, active: list[int]) -> tuple[list[Remainder], list[Place]]:
    """Test what is left for structure and fit its shape; also every place looked at."""
    mean, _ = linear.solve(active)
    left = linear.residual - linear.columns[:, active] @ mean
    raw = linear.raw - linear.raw_columns[:, active] @ mean
    found = places(problem, linear, left, raw)
    tests = max(len({place.stream for place in found}), 1)
    kept: dict[str, Remainder] = {}
    for place in found:
        # The finest chance that flips can show is 1/5000; a bin far out in units of its dives' scatter says more.
        chance = min(place.p * tests, 1.0) if place.covariate == "dive" else place.p
        telling = place.share > LEAST_SHARE or abs(place.z) > 8.0
        if chance >= CHANCE or not telling or place.stream in kept:
            continue
        remainder = _shape(problem, linear, active, place)
        if remainder is not None and remainder.gain > LEAST_GAIN and remainder.rms > _least(problem, place.stream):
            kept[place.stream] = remainder
    return list(kept.values()), found


def _least(problem: Problem, name: str) -> float:
    """Smallest rms worth a word, in shown units: a share of what the stream scatters by with nothing left out."""
    noise, _ = _noise_rows(problem, name)
    law = "white" if len(noise.names) == 1 else "drift" if name.startswith("surface") else "displacement"
    usual = next(q.median for q in noise.laws if q.name == law)
    return LEAST_SIZE * usual * problem.gathered.stream(name).shown_per_unit


def _shape(problem: Problem, linear: Linear, active: list[int], place: Place) -> Remainder | None:
    """A smooth curve over the covariate, prior sd found by evidence, fitted beside the active columns."""
    number = problem.names.index(place.stream)
    rows = np.flatnonzero(linear.stream == number)
    stream = problem.gathered.stream(place.stream)
    x = stream.time if place.covariate == "dive" else covariates(stream, problem.gathered.origin)[place.covariate]
    direction = stream.covariates.get("direction")
    nodes = np.unique(np.quantile(x, np.linspace(0.0, 1.0, NODES)))
    if nodes.size < 3:
        return None
    hats = np.stack([np.interp(x, nodes, np.eye(nodes.size)[k]) for k in range(nodes.size)], axis=1)
    width = 1.5 * float(np.median(np.diff(nodes)))
    smooth = np.exp(-0.5 * (np.subtract.outer(nodes, nodes) / width) ** 2) + 1e-6 * np.eye(nodes.size)
    basis = hats @ np.linalg.cholesky(smooth)
    if direction is not None:
        basis = np.concatenate([basis * (direction < 0)[:, None], basis * (direction > 0)[:, None]], axis=1)
    order = _noise_rows(problem, place.stream)
    noise, inside = order
    spread = float(np.std(linear.raw[rows] - linear.raw_columns[rows][:, active] @ linear.solve(active)[0]))
    full = np.zeros((noise.n, basis.shape[1]))
    full[inside] = basis
    white, _ = noise.whiten(full)
    start = int(np.flatnonzero(np.isin(linear.stream, [problem.names.index(n) for n in noise.names]))[0])
    everything = np.zeros((linear.residual.size, basis.shape[1]))
    everything[start : start + noise.n] = white
    best, choice = -np.inf, 0.0
    j0 = linear.columns[:, active]
    for size in spread * np.array([0.1, 0.3, 1.0, 3.0]):
        j = np.concatenate([j0, size * everything], axis=1)
        gram = j.T @ j + np.eye(j.shape[1])
        lower = np.linalg.cholesky(gram)
        y = np.linalg.solve(lower, j.T @ linear.residual)
        score = 0.5 * y @ y - np.log(np.diag(lower)).sum()
        if score > best:
            best, choice, kept = score, size, (j, gram)
    j, gram = kept
    covariance = np.linalg.inv(gram)
    z = covariance @ (j.T @ linear.residual)
    part = slice(len(active), j.shape[1])
    gain = _held_out(linear, j, len(active))
    fitted = choice * basis @ z[part]
    half = basis.shape[1] // (2 if direction is not None else 1)
    use = slice(0, half) if place.phase != "climbs" else slice(half, 2 * half)
    factor = np.linalg.cholesky(smooth)
    curve = choice * factor @ z[part][use]
    sd = choice * np.sqrt(np.diag(factor @ covariance[part, part][use, use] @ factor.T))
    unit, scale = ("d", 1.0 / 86400.0) if place.covariate == "dive" else SHOWN.get(place.covariate, ("", 1.0))
    k = stream.shown_per_unit
    return Remainder(
        place, float(k * np.sqrt(np.mean(fitted**2))), stream.shown, nodes * scale, k * curve, k * sd, unit, gain
    )


def _noise_rows(problem: Problem, name: str):
    """The noise law of a stream, and the stream's rows within it."""
    for noise in problem.noises:
        start = 0
        for one in noise.names:
            n = problem.gathered.stream(one).n
            if one == name:
                return noise, slice(start, start + n)
            start += n
    raise KeyError(name)


def _held_out(linear: Linear, columns: Array, count: int) -> float:
    """Nats gained on left-out blocks of dives by the columns beyond the first ``count``."""
    total = 0.0
    blocks = np.unique(linear.block)
    for part in np.array_split(blocks, min(6, blocks.size)):
        test = np.isin(linear.block, part)
        for use, sign in ((columns[:, :count], 1.0), (columns, -1.0)):
            j = use[~test]
            z = np.linalg.solve(j.T @ j + np.eye(j.shape[1]), j.T @ linear.residual[~test])
            total += 0.5 * sign * float(np.sum((linear.residual[test] - use[test] @ z) ** 2))
    return total
