"""None of the above: what structure remains once the accepted effects are in, how large, where, and of what shape.

Imports NumPy and the inference. A newcomer would get wrong: the shape is fitted beside the accepted effects, not after
them, so it holds only what they cannot explain; the noise law is asked again with and without it, since noise that was
sized without a shape has swallowed it; and it has no name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from glider_jax.diagnosis.locate import SHOWN, Place, covariates, places
from glider_jax.inference.fit import Linear, Problem, inadequacy, rows_of
from glider_jax.inference.noise import DENSE, Noise, fit_noise
from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Array, Recording

#: Chance at which remaining structure is reported, over all streams and covariates together.
CHANCE = 0.01
#: Share of a stream's variance, and size against its usual scatter, below which structure is not worth a word.
LEAST_SHARE, LEAST_SIZE = 0.03, 0.5
#: Streams of which a shift within the scatter of one number is nothing that a pilot would act on.
ROUGH = frozenset({"turn depth", "water depth", "surface stay", "charge counter", "depth at the surface"})
#: nats: that a shape without a name must earn on held-out dives, and in evidence where no flips were asked.
LEAST_GAIN, LEAST_EVIDENCE = 6.0, 12.0
#: Covariates whose shape is looked at whatever flips of dives say: they cannot see what comes once.
LOOKED = {
    "vertical speed": ("dive", "depth", "temperature"),
    "displacement east": ("heading",),
    "displacement north": ("heading",),
    "hotel power, dives": ("hour", "dive"),
    "hotel power, climbs": ("hour", "dive"),
    "pump out energy": ("depth", "dive"),
}
NODES = 12
#: s; what comes once is looked at this finely in time, on at least ``NODES`` and at most ``MOST_NODES`` nodes.
FINEST, MOST_NODES = 9000.0, 40
SIZES = np.array([0.1, 0.3, 1.0, 3.0])
#: Chance of what a glide model may be wrong by, beyond which it is no longer called that.
IMPLAUSIBLE = 1e-4
#: Least share and number of strokes that were set aside, for a word about them.
ODD_SHARE, ODD_STROKES = 0.06, 8
#: s, samples and m: a pitch that does not change for so long while the glider goes so far stands still.
STILL_SECONDS, STILL_SAMPLES, STILL_WAY = 300.0, 30, 20.0


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
    evidence: float


@dataclass(frozen=True)
class _Basis:
    """A smooth curve as columns over the rows of one noise law: what they weigh, and where the curve is drawn."""

    columns: Array
    nodes: Array
    factor: Array
    use: slice


def remainders(problem: Problem, linear: Linear, active: list[int]) -> tuple[list[Remainder], list[Place]]:
    """Test what is left for structure and fit its shape; also every place looked at."""
    mean, _ = linear.solve(active)
    left = linear.residual - linear.columns[:, active] @ mean
    raw = linear.raw - linear.raw_columns[:, active] @ mean
    found = places(problem, linear, left, raw)
    tests = max(len({place.stream for place in found}), 1)
    kept: dict[str, Remainder] = {}
    seen = set()
    for place in found:
        # The finest chance that flips can show is 1/5000; a bin far out in units of its dives' scatter says more.
        chance = min(place.p * tests, 1.0) if place.covariate == "dive" else place.p
        telling = (place.share > LEAST_SHARE or abs(place.z) > 8.0) and chance < CHANCE
        looked = place.covariate in LOOKED.get(place.stream, ()) and (place.stream, place.covariate) not in seen
        if not (telling or looked) or place.stream in kept:
            continue
        seen.add((place.stream, place.covariate))
        remainder = _shape(problem, linear, active, place)
        if remainder is None or remainder.gain < LEAST_GAIN or remainder.rms < least(problem, place.stream):
            continue
        if telling or remainder.evidence > LEAST_EVIDENCE:
            kept[place.stream] = remainder
    for one in (_inadequate(problem, linear, active, mean), _odd_strokes(problem)):
        if one is not None:
            kept.setdefault(one.place.stream, one)
    return list(kept.values()), found


def least(problem: Problem, name: str) -> float:
    """Smallest rms worth a word, in shown units: a share of what the stream scatters by with nothing left out."""
    noise, _ = _noise_rows(problem, name)
    law = "white" if len(noise.names) == 1 else "drift" if name.startswith("surface") else "displacement"
    usual = next(q.median for q in noise.laws if q.name == law)
    share = 1.0 if name in ROUGH else LEAST_SIZE
    return share * usual * problem.gathered.stream(name).shown_per_unit


def _basis(problem: Problem, place: Place, noise: Noise, rows: slice) -> _Basis | None:
    """Hats with a smooth prior over the covariate, on dives and climbs each where a stream has both."""
    stream = problem.gathered.stream(place.stream)
    if place.covariate == "heading" and place.stream.startswith("displacement"):
        return _turned(problem, noise, place)
    x = stream.time if place.covariate == "dive" else covariates(stream, problem.gathered.origin)[place.covariate]
    count = NODES
    if place.covariate == "dive":
        count = int(np.clip(np.ptp(x) / FINEST, NODES, min(MOST_NODES, max(stream.n // 4, NODES))))
    nodes = np.unique(np.quantile(x, np.linspace(0.0, 1.0, count)))
    if nodes.size < 3:
        return None
    hats = np.stack([np.interp(x, nodes, np.eye(nodes.size)[k]) for k in range(nodes.size)], axis=1)
    width = 1.5 * float(np.median(np.diff(nodes)))
    smooth = np.exp(-0.5 * (np.subtract.outer(nodes, nodes) / width) ** 2) + 1e-6 * np.eye(nodes.size)
    factor = np.linalg.cholesky(smooth)
    columns = hats @ factor
    direction = stream.covariates.get("direction")
    use = slice(0, nodes.size)
    if direction is not None:
        columns = np.concatenate([columns * (direction < 0)[:, None], columns * (direction > 0)[:, None]], axis=1)
        use = use if place.phase != "climbs" else slice(nodes.size, 2 * nodes.size)
    full = np.zeros((noise.n, columns.shape[1]))
    full[rows] = columns
    return _Basis(full, nodes, factor, use)


def _turned(problem: Problem, noise: Noise, place: Place) -> _Basis | None:
    """A velocity across and along the heading that depends on it, up to four cycles around, east and north together."""
    east = problem.gathered.stream("displacement east")
    heading = east.covariates["heading"]
    if not np.isfinite(heading).all():
        return None
    cycles = [np.ones_like(heading)]
    weigh = [1.0]
    for k in (1, 2, 3, 4):
        cycles += [np.sin(k * heading), np.cos(k * heading)]
        weigh += [1.0, 1.0]
    curves = np.stack(cycles, axis=1) * np.array(weigh) / 3.0
    full = np.zeros((noise.n, 2 * curves.shape[1]))
    place_of = {name: _noise_rows(problem, name)[1] for name in ("displacement east", "displacement north")}
    sine, cosine = np.sin(heading)[:, None], np.cos(heading)[:, None]
    full[place_of["displacement east"]] = np.concatenate([curves * cosine, curves * sine], axis=1)
    full[place_of["displacement north"]] = np.concatenate([-curves * sine, curves * cosine], axis=1)
    around = np.linspace(0.0, 2.0 * np.pi, NODES, endpoint=False)
    drawn = [np.ones_like(around)]
    for k in (1, 2, 3, 4):
        drawn += [np.sin(k * around), np.cos(k * around)]
    return _Basis(full, around, np.stack(drawn, axis=1) / 3.0, slice(0, curves.shape[1]))


def _shape(problem: Problem, linear: Linear, active: list[int], place: Place) -> Remainder | None:
    """A smooth curve over the covariate, prior sd found by evidence, fitted beside the active columns."""
    stream = problem.gathered.stream(place.stream)
    noise, inside = _noise_rows(problem, place.stream)
    basis = _basis(problem, place, noise, inside)
    if basis is None:
        return None
    number = next(k for k, one in enumerate(problem.noises) if one is noise)
    rows = rows_of(problem)[number]
    own = rows.start + np.arange(inside.start, inside.stop)
    mean, _ = linear.solve(active)
    spread = float(np.std(linear.raw[own] - linear.raw_columns[own][:, active] @ mean))
    kept = noise.sizes.copy()
    evidence, best = _asked(problem, linear, active, noise, rows, basis, spread)
    # Under the noise that the shape leaves, which may be smaller than without it.
    white, _ = noise.whiten(np.column_stack([linear.raw[rows], linear.raw_columns[rows][:, active], basis.columns]))
    noise.sizes = kept
    residual, j0 = linear.residual.copy(), linear.columns[:, active].copy()
    residual[rows], j0[rows] = white[:, 0], white[:, 1 : 1 + len(active)]
    everything = np.zeros((residual.size, basis.columns.shape[1]))
    everything[rows] = white[:, 1 + len(active) :]
    j = np.concatenate([j0, best * everything], axis=1)
    covariance = np.linalg.inv(j.T @ j + np.eye(j.shape[1]))
    z = covariance @ (j.T @ residual)
    part = slice(len(active), j.shape[1])
    gain = _held_out(replace(linear, residual=residual), j, len(active), place.covariate == "dive")
    fitted = (best * basis.columns @ z[part])[inside]
    curve = best * basis.factor @ z[part][basis.use]
    sd = best * np.sqrt(np.diag(basis.factor @ covariance[part, part][basis.use, basis.use] @ basis.factor.T))
    unit, scale = ("d", 1.0 / 86400.0) if place.covariate == "dive" else SHOWN.get(place.covariate, ("", 1.0))
    k = stream.shown_per_unit
    return Remainder(
        place, float(k * np.sqrt(np.mean(fitted**2))), stream.shown, basis.nodes * scale, k * curve, k * sd, unit,
        gain, evidence,
    )  # fmt: skip


def _asked(problem, linear, active, noise, rows, basis, spread) -> tuple[float, float]:
    """Evidence for a shape, and its prior sd; leaves a short stream's noise as the shape asks for."""
    if noise.n > 2 * DENSE:
        white = np.zeros((linear.residual.size, basis.columns.shape[1]))
        white[rows], _ = noise.whiten(basis.columns)
        j0 = linear.columns[:, active]
        scores = [_score(np.concatenate([j0, size * white], axis=1), linear.residual) for size in spread * SIZES]
        best = int(np.argmax(scores))
        return scores[best] - _score(j0, linear.residual), float(spread * SIZES[best])
    residual, j0 = linear.raw[rows], linear.raw_columns[rows][:, active]
    start = noise.sizes.copy()
    without = fit_noise(noise, residual, j0, rounds=80)
    best, evidence, sizes = float(spread), -np.inf, start
    for size in spread * SIZES[1:]:
        noise.sizes = start.copy()
        reached = fit_noise(noise, residual, np.concatenate([j0, size * basis.columns], axis=1), rounds=80)
        if reached - without > evidence:
            evidence, best, sizes = reached - without, float(size), noise.sizes
    noise.sizes = sizes
    return evidence, best


def _score(j: Array, residual: Array) -> float:
    lower = np.linalg.cholesky(j.T @ j + np.eye(j.shape[1]))
    y = np.linalg.solve(lower, j.T @ residual)
    return float(0.5 * y @ y - np.log(np.diag(lower)).sum())


def _inadequate(problem: Problem, linear: Linear, active: list[int], mean: Array) -> Remainder | None:
    """What a glide model may be wrong by, where it came out far larger than any glide model is."""
    fixed = [n for n, i in enumerate(active) if linear.labels[i].term == "inadequacy"]
    if not fixed:
        return None
    z = mean[fixed]
    if chi2.sf(float(z @ z), z.size) > IMPLAUSIBLE:
        return None
    stream = problem.gathered.stream("vertical speed")
    field = inadequacy(problem.gathered)["vertical speed"] @ z
    rms = float(stream.shown_per_unit * np.sqrt(np.mean(field**2)))
    if rms < least(problem, stream.name):
        return None
    order = [n for n in range(len(active)) if n not in fixed] + fixed
    gain = _held_out(linear, linear.columns[:, [active[n] for n in order]], len(order) - len(fixed))
    if gain < LEAST_GAIN:
        return None
    depth, direction = stream.covariates["depth"], stream.covariates["direction"]
    nodes = np.unique(np.quantile(depth, np.linspace(0.0, 1.0, NODES + 1)))
    slot = np.clip(np.searchsorted(nodes, depth, side="right") - 1, 0, nodes.size - 2)
    way = max((-1.0, 1.0), key=lambda d: float(np.sum(field[direction == d] ** 2)))
    inside = [(slot == k) & (direction == way) for k in range(nodes.size - 1)]
    curve = np.array([field[mine].mean() if mine.any() else 0.0 for mine in inside])
    worst = int(np.argmax(np.abs(curve)))
    k = stream.shown_per_unit
    place = Place(
        stream.name, "depth", float(chi2.sf(float(z @ z), z.size)), float(np.sqrt(z @ z)), float(nodes[worst]),
        float(nodes[worst + 1]), "m", "dives" if way < 0 else "climbs", float(k * curve[worst]), stream.shown,
        float(np.sum(field**2) / max(np.sum((stream.value - stream.value.mean()) ** 2), 1e-30)),
    )  # fmt: skip
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    return Remainder(place, rms, stream.shown, middle, k * curve, np.full(middle.size, 0.015), "m", gain, gain)


def _odd_strokes(problem: Problem) -> Remainder | None:
    """Pump strokes that cost far more or less than their like, where they are no rare accident."""
    stream = problem.gathered.stream("pump out energy")
    odd = np.asarray(problem.gathered.odd_strokes, float).reshape(-1, 2)
    if stream is None or len(odd) < max(ODD_STROKES, ODD_SHARE * (stream.n + len(odd))):
        return None
    time, size = odd.T
    place = Place(
        stream.name, "stroke", 0.0, float(len(odd)), float(time.min() / 86400.0), float(time.max() / 86400.0), "d", "",
        float(np.median(size)), stream.shown, len(odd) / (stream.n + len(odd)),
    )  # fmt: skip
    usual = stream.value.std() * stream.shown_per_unit
    nats = 0.5 * float(np.sum((size / usual) ** 2)) - len(odd) * np.log(10.0)
    rms, flat = float(np.sqrt(np.mean(size**2))), np.zeros(size.size)
    return Remainder(place, rms, stream.shown, time / 86400.0, size, flat, "d", nats, nats)


def stuck(problem: Problem, recording: Recording) -> Remainder | None:
    """A pitch sensor that stands still while the glider glides on: what rests on it then is void."""
    stream = problem.gathered.stream("vertical speed")
    moments, pitch = finite(recording, "pitch")
    if stream is None or pitch.size < 10 * STILL_SAMPLES:
        return None
    edges = np.flatnonzero(np.diff(pitch, prepend=np.nan, append=np.nan) != 0.0)
    rows = problem.gathered.rows
    found = []
    for first, last in zip(edges[:-1], edges[1:] - 1, strict=True):
        lasted = moments[last] - moments[first]
        if last - first < STILL_SAMPLES or lasted < STILL_SECONDS:
            continue
        inside = (rows.time >= moments[first]) & (rows.time <= moments[last]) & (rows.leg >= 0)
        if inside.sum() > 5 and np.ptp(rows.depth[inside]) > STILL_WAY:
            found.append(((moments[first] - problem.gathered.origin) / 86400.0, lasted))
    if not found:
        return None
    day, lasted = np.array(found).T
    share = float(lasted.sum() / max(recording.time[-1] - recording.time[0], 1.0))
    place = Place(
        stream.name, "stuck", 0.0, float(day.size), float(day.min()), float(day.max()), "d", "",
        float(lasted.sum() / 60.0), "min", share,
    )  # fmt: skip
    flat = np.zeros(day.size)
    return Remainder(place, float(lasted.mean() / 60.0), "min", day, lasted / 60.0, flat, "d", 0.0, 0.0)


def _noise_rows(problem: Problem, name: str) -> tuple[Noise, slice]:
    """The noise law of a stream, and the stream's rows within it."""
    for noise in problem.noises:
        start = 0
        for one in noise.names:
            n = problem.gathered.stream(one).n
            if one == name:
                return noise, slice(start, start + n)
            start += n
    raise KeyError(name)


def _held_out(linear: Linear, columns: Array, count: int, apart: bool = False) -> float:
    """Nats gained on left-out dives by the columns beyond the first ``count``.

    ``apart`` leaves out every sixth dive, not six blocks: what comes once can be foretold from its neighbours only.
    """
    total = 0.0
    blocks = np.unique(linear.block)
    parts = min(6, blocks.size)
    for part in [blocks[k::parts] for k in range(parts)] if apart else np.array_split(blocks, parts):
        test = np.isin(linear.block, part)
        for use, sign in ((columns[:, :count], 1.0), (columns, -1.0)):
            j = use[~test]
            z = np.linalg.solve(j.T @ j + np.eye(j.shape[1]), j.T @ linear.residual[~test])
            total += 0.5 * sign * float(np.sum((linear.residual[test] - use[test] @ z) ** 2))
    return total
