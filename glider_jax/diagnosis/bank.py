"""What flexible shapes are worth: evidence beside what was accepted, chance, and what they foretell of left-out dives.

Imports NumPy and the inference. A newcomer would get wrong: evidence is averaged over sizes and places, so that it can
be set against that of a named effect; noise that was sized without a shape has swallowed it, so the law is asked again;
and the chance is that of the best of all shapes of the stream, when half yos change sign at random.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from glider_jax.diagnosis.shapes import AROUND, BURST, Shape, bank, burst
from glider_jax.inference.fit import Linear, Problem, rows_of
from glider_jax.inference.noise import DENSE, Noise, fit_noise
from glider_jax.records import Array

#: Sizes that are averaged over, in units of what the stream usually scatters by.
SIZES = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0])
FLIPS = 999
#: nats from which a short bump in the vertical speed is taken for a burst of waves beside what comes back.
WAVED = 6.0
#: Parts that are left out in turn: blocks of dives, or every so manyth half yo of what comes once.
PARTS = 6


@dataclass(frozen=True)
class Look:
    """What a shape is worth beside a set of columns.

    ``number`` of the shape in its bank; ``evidence`` in nats, averaged over sizes and alternatives; ``alone`` that of
    the best ``size`` and, of bumps, of the ``best`` one; ``noise`` the sizes of laws where they were asked anew.
    """

    number: int
    shape: Shape
    evidence: float
    alone: float
    size: float
    best: int
    noise: tuple[tuple[int, Array], ...] = ()


@dataclass(frozen=True)
class Fitted:
    """A shape fitted beside a set of columns: coefficients of its curve with covariance, SI, and nats on left-out
    dives; ``rows`` its values over the rows of its first stream."""

    mean: Array
    covariance: Array
    rows: Array
    gain: float


def law_of(problem: Problem, name: str) -> Noise:
    """The noise law of a stream."""
    return next(noise for noise in problem.noises if name in noise.names)


def usual(problem: Problem, name: str) -> float:
    """What a stream's single numbers scatter by with nothing left out, SI."""
    named = {q.name: float(q.median) for q in law_of(problem, name).laws}
    return named["drift" if name.startswith("surface drift") else "displacement" if "drift" in named else "white"]


class Bank:
    """Whitened shapes, ready to be judged beside any set of columns."""

    def __init__(self, problem: Problem, linear: Linear):
        self.problem, self.linear = problem, linear
        self.shapes = bank(problem)
        self.laws = list(zip(problem.noises, rows_of(problem), strict=True))
        self.white, self.rows = self._whitened(range(len(self.shapes)), {})
        self.cross = [linear.columns[r].T @ w for r, w in zip(self.rows, self.white, strict=True)]
        self.inner = [w.T @ w for w in self.white]
        self.scale = [usual(problem, s.stream) for s in self.shapes]

    def _whitened(self, chosen, sizes: dict[int, Array]) -> tuple[list[Array], list[Array]]:
        """Columns of some shapes over the rows of the laws they touch, whitened, and those rows."""
        pieces: dict[int, list[Array]] = {k: [] for k in chosen}
        places: dict[int, list[Array]] = {k: [] for k in chosen}
        for number, (noise, rows) in enumerate(self.laws):
            mine = [k for k in pieces if set(self.shapes[k].parts) & set(noise.names)]
            if not mine:
                continue
            together = np.concatenate([self._columns(noise, self.shapes[k]) for k in mine], axis=1)
            whole = noise.whiten(together, sizes.get(number))[0]
            start = 0
            for k in mine:
                pieces[k].append(whole[:, start : start + self.shapes[k].width])
                places[k].append(np.arange(rows.start, rows.stop))
                start += self.shapes[k].width
        return [np.concatenate(p) for p in pieces.values()], [np.concatenate(p) for p in places.values()]

    def _columns(self, noise: Noise, shape: Shape) -> Array:
        """A shape over the rows of one law."""
        n = self.problem.gathered.stream
        return np.concatenate(
            [shape.parts[name] if name in shape.parts else np.zeros((n(name).n, shape.width)) for name in noise.names]
        )

    def _touched(self, shape: Shape) -> list[int]:
        return [k for k, (noise, _) in enumerate(self.laws) if set(noise.names) & set(shape.parts)]

    def beside(self, active: list[int]) -> list[Look]:
        """Every shape beside some columns, in the order of ``shapes``."""
        linear = self.linear
        mean, inverse = linear.solve(active)
        left = linear.residual - linear.columns[:, active] @ mean
        looks = []
        for k, shape in enumerate(self.shapes):
            across = self.cross[k][active]
            weight = self.inner[k] - across.T @ inverse @ across
            pull = self.white[k].T @ left[self.rows[k]]
            gain, alone, size, best = worth(pull, weight, self.scale[k] * SIZES, shape.bumps)
            looks.append(Look(k, shape, float(gain), float(alone), float(size), int(best)))
        return looks

    def asked(self, look: Look, active: list[int], without: dict[int, Array]) -> Look:
        """A look where each short law's noise is what the shape, and its absence, ask for; ``without`` keeps these.

        Laws of long streams stay as they are: half yos and minutes, which they are made of, hide no shape. But what
        comes once in the vertical speed must be more than a burst of internal waves.
        """
        look = self.beside_waves(look, active)
        touched = self._touched(look.shape)
        if look.evidence < 0.0 or any(self.laws[k][0].n > 2 * DENSE for k in touched):
            return look
        prior = self.linear.precision[active] ** -0.5
        for k in touched:
            if k not in without:
                without[k] = self._noise(k, self._known(k, active, prior))
        bare = self._reached(active, prior, {k: without[k] for k in touched}, look, 0.0)
        reached, found = -np.inf, (look.size, ())
        for size in look.size * np.array([1.0, 2.0]):
            sizes = {
                k: self._noise(k, np.concatenate([self._known(k, active, prior), size * self._own(k, look)], axis=1))
                for k in touched
            }
            now = self._reached(active, prior, sizes, look, size)
            if now > reached:
                reached, found = now, (float(size), tuple(sizes.items()))
        evidence = reached - bare + look.evidence - look.alone
        return Look(look.number, look.shape, evidence, reached - bare, found[0], look.best, found[1])

    def beside_waves(self, look: Look, active: list[int]) -> Look:
        """A look at the vertical speed, judged beside bursts of internal waves that it may be taken for.

        A short bump stands beside a burst at its own time. What comes back, with the heading or the hour, stands beside
        all bursts there seem to be: a heading that is steered for some hours of the record is those hours by another
        name. Waves can take evidence away, not lend it.
        """
        shape = look.shape
        if shape.stream != "vertical speed":
            return look
        if shape.bumps and shape.at[1] - shape.at[0] <= BURST:
            moments = [(float(shape.at[look.best]), float(shape.at[1] - shape.at[0]))]
        else:
            moments = self._bursts(active) if shape.covariate in AROUND else []
        if not moments:
            return look
        number = self._touched(shape)[0]
        noise, rows = self.laws[number]
        stream = self.problem.gathered.stream(shape.stream)
        waves = np.concatenate([burst(stream.time, *moment) for moment in moments], axis=1)
        own = look.size * self._own(number, look)
        white = noise.whiten(np.concatenate([waves, own], axis=1))[0]
        mean, inverse = self.linear.solve(active)
        known = self.linear.columns[rows][:, active]
        across = known.T @ white
        weight = white.T @ white - across.T @ inverse @ across
        pull = white.T @ (self.linear.residual[rows] - known @ mean)
        scores = []
        for count in (waves.shape[1], white.shape[1]):
            lower = np.linalg.cholesky(weight[:count, :count] + np.eye(count))
            y = np.linalg.solve(lower, pull[:count])
            scores.append(0.5 * float(y @ y) - float(np.log(np.diag(lower)).sum()))
        alone = min(scores[1] - scores[0], look.alone)
        return replace(look, evidence=alone + look.evidence - look.alone, alone=alone)

    def _bursts(self, active: list[int]) -> list[tuple[float, float]]:
        """Moments and half widths, s, at which short bumps in the vertical speed are worth ``WAVED`` nats."""
        seen = [
            look for look in self.beside(active)
            if look.shape.bumps and look.shape.stream == "vertical speed" and look.alone > WAVED
            and look.shape.at[1] - look.shape.at[0] <= BURST
        ]  # fmt: skip
        found: list[tuple[float, float]] = []
        for look in sorted(seen, key=lambda one: -one.alone):
            moment, width = float(look.shape.at[look.best]), float(look.shape.at[1] - look.shape.at[0])
            if all(abs(moment - other) > width + reach for other, reach in found):
                found.append((moment, width))
        return found

    def _known(self, law: int, active: list[int], prior: Array) -> Array:
        return self.linear.raw_columns[self.laws[law][1]][:, active] * prior

    def _own(self, law: int, look: Look) -> Array:
        """The raw columns of a look over the rows of one law: of bumps the best alone."""
        columns = self._columns(self.laws[law][0], look.shape)
        return columns[:, look.best : look.best + 1] if look.shape.bumps else columns

    def _noise(self, law: int, columns: Array) -> Array:
        """Sizes of a law with some columns integrated out; the law itself is left as it was."""
        noise, rows = self.laws[law]
        kept = noise.sizes
        noise.sizes = kept.copy()
        fit_noise(noise, self.linear.raw[rows], columns, rounds=80)
        found, noise.sizes = noise.sizes, kept
        return found

    def _joined(self, active, prior, sizes: dict[int, Array], look: Look, size: float) -> tuple[Array, Array, float]:
        """Residual and columns, those of the shape last, under some laws' sizes; and what the laws themselves add."""
        columns, residual, total = self.linear.columns[:, active] * prior, self.linear.residual.copy(), 0.0
        shape = np.zeros((residual.size, 1 if look.shape.bumps else look.shape.width))
        for k in self._touched(look.shape):
            noise, rows = self.laws[k]
            asked = np.column_stack([self.linear.raw[rows], self._known(k, active, prior), size * self._own(k, look)])
            white, half = noise.whiten(asked, sizes.get(k))
            residual[rows], columns[rows] = white[:, 0], white[:, 1 : 1 + len(active)]
            shape[rows] = white[:, 1 + len(active) :]
            total += noise.belief(noise.sizes if sizes.get(k) is None else sizes[k]) - half
        return residual, np.concatenate([columns, shape], axis=1), total

    def _reached(self, active, prior, sizes: dict[int, Array], look: Look, size: float) -> float:
        """Evidence of some columns and a shape, up to what does not change."""
        residual, j, total = self._joined(active, prior, sizes, look, size)
        lower = np.linalg.cholesky(j.T @ j + np.eye(j.shape[1]))
        y = np.linalg.solve(lower, j.T @ residual)
        return float(total + 0.5 * (y @ y - residual @ residual) - np.log(np.diag(lower)).sum())

    def fitted(self, look: Look, active: list[int]) -> Fitted:
        """A shape fitted beside some columns under the noise that it asks for."""
        prior = self.linear.precision[active] ** -0.5
        residual, j, _ = self._joined(active, prior, dict(look.noise), look, look.size)
        covariance = np.linalg.inv(j.T @ j + np.eye(j.shape[1]))
        part = slice(len(active), j.shape[1])
        z = (covariance @ (j.T @ residual))[part]
        own = look.shape.parts[look.shape.stream]
        own = own[:, look.best : look.best + 1] if look.shape.bumps else own
        gain = left_out(residual, j, len(active), self._parts(look))
        return Fitted(look.size * z, look.size**2 * covariance[part, part], own @ (look.size * z), gain)

    def _parts(self, look: Look) -> list[Array]:
        """Rows that are left out in turn: what comes once can be foretold from its neighbours only."""
        key = self.groups() if look.shape.covariate == "dive" else self.linear.block
        values = np.unique(key)
        count = min(PARTS, values.size)
        once = look.shape.covariate == "dive"
        parts = [values[k::count] for k in range(count)] if once else np.array_split(values, count)
        return [np.isin(key, part) for part in parts]

    def groups(self) -> Array:
        """What shares an offset, of every row: half yos within the blocks of dives, alike in all streams."""
        streams = [self.problem.gathered.stream(name) for name in self.problem.names]
        time = np.concatenate([s.time for s in streams])
        ways = self.problem.gathered.ways
        starts = np.array([way.start_time for way in ways]) - self.problem.gathered.origin
        return np.searchsorted(starts, time + 1.0)

    def chance(self, look: Look, active: list[int], seed: int = 11) -> float:
        """How often the best shape of a stream is as good as this one where half yos change sign at random."""
        chosen = [k for k, s in enumerate(self.shapes) if set(s.parts) == set(look.shape.parts)]
        sizes = dict(look.noise)
        prior = self.linear.precision[active] ** -0.5
        residual, j, _ = self._joined(active, prior, sizes, look, 0.0)
        known = j[:, : len(active)]
        inverse = np.linalg.inv(known.T @ known + np.eye(len(active)))
        left = residual - known @ (inverse @ (known.T @ residual))
        _, group = np.unique(self.groups(), return_inverse=True)
        rng = np.random.default_rng(seed)
        signs = np.concatenate([np.ones((1, group.max() + 1)), rng.choice([-1.0, 1.0], (FLIPS, group.max() + 1))])
        summed = np.zeros((group.max() + 1, len(active)))
        np.add.at(summed, group, known * left[:, None])
        turned = signs @ summed @ inverse
        best = np.full(FLIPS + 1, -np.inf)
        white, rows = self._whitened(chosen, sizes) if sizes else (None, None)
        for n, k in enumerate(chosen):
            w, r = (white[n], rows[n]) if sizes else (self.white[k], self.rows[k])
            across = known[r].T @ w
            pulled = np.zeros((group.max() + 1, w.shape[1]))
            np.add.at(pulled, group[r], w * left[r, None])
            pull = signs @ pulled - turned @ across
            gain = worth(pull, w.T @ w - across.T @ inverse @ across, self.scale[k] * SIZES, self.shapes[k].bumps)[0]
            best = np.maximum(best, gain)
        return float((1 + np.sum(best[1:] >= best[0])) / (1 + FLIPS))


def left_out(residual: Array, columns: Array, count: int, parts: list[Array]) -> float:
    """Nats gained on rows that are left out in turn by the columns beyond the first ``count``; unit priors."""
    total = 0.0
    for test in parts:
        for use, sign in ((columns[:, :count], 1.0), (columns, -1.0)):
            j = use[~test]
            z = np.linalg.solve(j.T @ j + np.eye(j.shape[1]), j.T @ residual[~test])
            total += 0.5 * sign * float(np.sum((residual[test] - use[test] @ z) ** 2))
    return total


def worth(pull: Array, weight: Array, sizes: Array, bumps: bool) -> tuple[Array, Array, Array, Array]:
    """Evidence of a shape averaged over sizes and alternatives, that of the best of them, and which size and one it is.

    Parameters
    ----------
    pull : (..., k) what the data say. weight : (k, k) what they say it with.
    """
    if bumps:
        own = np.maximum(np.diag(weight), 0.0)[:, None] * sizes**2
        scores = 0.5 * (pull[..., :, None] * sizes) ** 2 / (1.0 + own) - 0.5 * np.log1p(own)
        flat = scores.reshape(*scores.shape[:-2], -1)
    else:
        values, vectors = np.linalg.eigh(weight)
        values = np.maximum(values, 0.0)
        turned = (pull @ vectors) ** 2
        flat = np.stack(
            [0.5 * (turned * (s * s / (1.0 + s * s * values))).sum(axis=-1) - 0.5 * np.log1p(s * s * values).sum()
             for s in sizes], axis=-1,
        )  # fmt: skip
    best = flat.argmax(axis=-1)
    gain = np.logaddexp.reduce(flat, axis=-1) - np.log(flat.shape[-1])
    return gain, flat.max(axis=-1), sizes[best % sizes.size], best // sizes.size
