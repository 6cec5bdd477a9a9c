"""None of the above: what structure remains once the accepted effects are in, how large, where, and of what shape.

Imports NumPy and the inference. A newcomer would get wrong: the shape is fitted beside the accepted effects, not after
them, so it holds only what they cannot explain; and it also competes with each of them, since a name that a shape
without physics beats is a neighbour of what was left out, not its name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from glider_jax.diagnosis.bank import Bank, Look, left_out, usual
from glider_jax.diagnosis.locate import SHOWN, Place, places
from glider_jax.diagnosis.shapes import BURST, ROUGH
from glider_jax.inference.fit import Linear, Problem, inadequacy
from glider_jax.inference.streams import Stream
from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Array, Recording

#: nats: evidence from which a shape is told if chance does not give it, and from which whatever chance says.
EVIDENCE = (6.0, 12.0)
#: The same for what a glide model is wrong by without any effect: smooth in the water's layers.
LAYERED, LAYERED_EVIDENCE = frozenset({"depth", "temperature", "density", "since_turn"}), (10.0, 20.0)
#: nats that a shape must earn on left-out dives, and by which it must beat a name to put that in doubt.
LEAST_GAIN, BETTER = 3.0, 2.0
#: Whitened change, per prior sd, that counts as moving a number.
TOUCHED = 0.01
#: Chance that the best of a stream's shapes has with half yos of random sign, which is asked beside the evidence.
CHANCE = 0.05
#: nats from which a look is asked again with the noise that it leaves, and how many of a stream and covariate are.
WORTH_ASKING, MOST_ASKED = 0.5, 2
#: Share of what a number usually scatters by, below which structure is not worth a word.
LEAST_SIZE = 0.3
#: Share of the energy used, below which what strokes cost more or less is not worth a word.
LEAST_ENERGY = 0.01
#: Chance of what a glide model may be wrong by, beyond which it is no longer called that; its least size, likewise,
#: the nats it must earn on left-out dives, and the depths it is drawn at.
IMPLAUSIBLE, WRONG_SIZE, WRONG_GAIN, DRAWN = 1e-4, 0.5, 6.0, 12
#: Least share and number of strokes that were set aside, for a word about them.
ODD_SHARE, ODD_STROKES = 0.06, 8
#: s, samples and m: a pitch that does not change for so long while the glider goes so far stands still.
STILL_SECONDS, STILL_SAMPLES, STILL_WAY = 300.0, 30, 20.0


@dataclass(frozen=True)
class Remainder:
    """Structure without a name: place, rms in shown units, curve over the covariate; held-out gain and evidence, nats.

    ``instead`` are effects that were named and in whose place it does better; empty where it is beside all of them.
    A gain that is not finite was not asked for.
    """

    place: Place
    rms: float
    unit: str
    axis: Array
    curve: Array
    sd: Array
    axis_unit: str
    gain: float
    evidence: float
    instead: tuple[str, ...] = ()


@dataclass(frozen=True)
class Named:
    """Accepted effects that go together: their ids, columns, and the evidence for them beside the others in nats."""

    ids: tuple[str, ...]
    columns: tuple[int, ...]
    evidence: float


def remainders(
    problem: Problem, linear: Linear, active: list[int], named: Sequence[Named] = ()
) -> tuple[list[Remainder], list[Place]]:
    """Shapes without a name that earn more evidence than chance would give them; also every place looked at.

    Parameters
    ----------
    active : columns of calibrations, nuisances and accepted effects.
    named : accepted effects that a shape may replace. One that does better in place of them, by ``BETTER`` nats, makes
        their names doubtful.
    """
    mean, _ = linear.solve(active)
    left = linear.residual - linear.columns[:, active] @ mean
    found = places(problem, linear, left, linear.raw - linear.raw_columns[:, active] @ mean)
    whole = Bank(problem, linear)
    kept: dict[str, Remainder] = {}
    told: set[str] = set()
    for look in _telling(whole, active):
        if told & set(look.shape.parts):
            continue
        remainder = _told(problem, whole, look, active)
        if remainder is not None:
            kept[look.shape.stream] = remainder
            told |= set(look.shape.parts)
    for one in named:
        without = [i for i in active if i not in one.columns]
        moved = _moved(problem, linear, one.columns)
        rivals = (look for look in whole.beside(without) if _rivals(look) and moved & set(look.shape.parts))
        better = max(rivals, key=lambda look: look.evidence, default=None)
        if better is None or better.evidence < max(one.evidence + BETTER, _limits(better)[0]):
            continue
        better = whole.beside_waves(better, without)
        if better.evidence < max(one.evidence + BETTER, _limits(better)[0]):
            continue
        if better.shape.stream not in kept:
            remainder = _told(problem, whole, better, without, instead=one.ids)
            if remainder is not None:
                kept[better.shape.stream] = remainder
    for one in (_inadequate(problem, linear, active, mean), _odd_strokes(problem)):
        if one is not None:
            kept.setdefault(one.place.stream, one)
    return list(kept.values()), found


def _telling(whole: Bank, active: list[int]) -> list[Look]:
    """Looks that are worth telling, the best first: asked with the noise that they leave, and beyond chance."""
    found, looked, without = [], {}, {}
    for look in sorted(whole.beside(active), key=lambda one: -one.evidence):
        if look.evidence < WORTH_ASKING:
            break
        key = (look.shape.stream, look.shape.covariate)
        looked[key] = looked.get(key, 0) + 1
        if looked[key] > MOST_ASKED:
            continue
        asked = whole.asked(look, active, without)
        least, sure = _limits(asked)
        if asked.evidence > least and (asked.evidence > sure or whole.chance(asked, active) < CHANCE):
            found.append(asked)
    return sorted(found, key=lambda one: -one.evidence)


def _moved(problem: Problem, linear: Linear, columns: Sequence[int]) -> set[str]:
    """Streams that some columns move: a shape of another one has no say about them."""
    told = np.abs(linear.columns[:, list(columns)]).max(axis=1) > TOUCHED
    return {name for i, name in enumerate(problem.names) if told[linear.stream == i].any()}


def _rivals(look: Look) -> bool:
    """Whether a look may replace a name: no steady value, which may as well be that name, and no short burst."""
    return look.shape.covariate != "throughout" and not (
        look.shape.bumps and look.shape.at[1] - look.shape.at[0] <= BURST
    )


def _limits(look: Look) -> tuple[float, float]:
    """Evidence from which a look counts if chance does not give it, and from which it does in any case."""
    layered = look.shape.stream == "vertical speed" and look.shape.covariate in LAYERED
    return LAYERED_EVIDENCE if layered else EVIDENCE


def _told(
    problem: Problem, whole: Bank, look: Look, active: list[int], instead: tuple[str, ...] = ()
) -> Remainder | None:
    """A look as it is reported, with its curve; None where it is too small for a word or foretells nothing."""
    fitted = whole.fitted(look, active)
    shape, stream = look.shape, problem.gathered.stream(look.shape.stream)
    k = stream.shown_per_unit
    if shape.bumps:
        width = 2.0 * float(shape.at[1] - shape.at[0])
        at = shape.at[look.best] + width * np.linspace(-1.5, 1.5, 25)
        curves = np.exp(-0.5 * ((at - shape.at[look.best]) / (0.5 * width)) ** 2)[:, None]
    else:
        at, curves = shape.at, shape.curve
    curve = curves @ fitted.mean
    sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", curves, fitted.covariance, curves), 0.0))
    high = np.abs(curve) > 0.5 * np.abs(curve).max()
    worst = int(np.argmax(np.abs(curve)))
    first, last = worst, worst
    while first > 0 and high[first - 1] and curve[first - 1] * curve[worst] > 0.0:
        first -= 1
    while last < at.size - 1 and high[last + 1] and curve[last + 1] * curve[worst] > 0.0:
        last += 1
    telling = np.abs(fitted.rows) > 0.25 * np.abs(fitted.rows).max()
    size = float(np.sqrt(np.mean(fitted.rows[telling if shape.bumps else slice(None)] ** 2)))
    if k * size < least(problem, stream.name) or fitted.gain < LEAST_GAIN or _cheap(problem, stream, size):
        return None
    unit, factor = ("d", 1.0 / 86400.0) if shape.covariate == "dive" else SHOWN.get(shape.covariate, ("", 1.0))
    share = float(np.sum(fitted.rows**2) / max(np.sum((stream.value - stream.value.mean()) ** 2), 1e-30))
    place = Place(
        stream.name, shape.covariate, float(min(np.exp(-look.evidence), 1.0)),
        float(abs(curve[worst]) / max(sd[worst], 1e-30)), float(factor * at[first]), float(factor * at[last]), unit,
        shape.how, float(k * curve[worst]), stream.shown, min(share, 1.0),
    )  # fmt: skip
    return Remainder(
        place, float(k * size), stream.shown, at * factor, k * curve, k * sd, unit, fitted.gain, look.evidence, instead
    )  # fmt: skip


def _cheap(problem: Problem, stream: Stream, size: float) -> bool:
    """Whether a shape of stroke energy, J, is next to nothing of all the energy that was used."""
    if not stream.name.startswith("pump"):
        return False
    total = 0.0
    for one in problem.gathered.streams:
        if one.name.startswith("pump"):
            total += float(one.value.sum())
        elif one.name.startswith("hotel"):
            total += 0.5 * float(one.value.mean() * np.ptp(stream.time))
    return size * stream.n < LEAST_ENERGY * total


def least(problem: Problem, name: str) -> float:
    """Smallest rms worth a word, in shown units: a share of what the stream scatters by with nothing left out."""
    share = 1.0 if name in ROUGH else LEAST_SIZE
    return share * usual(problem, name) * problem.gathered.stream(name).shown_per_unit


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
    if rms < WRONG_SIZE * usual(problem, stream.name) * stream.shown_per_unit:
        return None
    order = [n for n in range(len(active)) if n not in fixed] + fixed
    parts = np.array_split(np.unique(linear.block), min(6, np.unique(linear.block).size))
    columns = linear.columns[:, [active[n] for n in order]] * linear.precision[[active[n] for n in order]] ** -0.5
    count = len(order) - len(fixed)
    gain = left_out(linear.residual, columns, count, [np.isin(linear.block, part) for part in parts])
    if gain < WRONG_GAIN:
        return None
    depth, direction = stream.covariates["depth"], stream.covariates["direction"]
    nodes = np.unique(np.quantile(depth, np.linspace(0.0, 1.0, DRAWN + 1)))
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
    scatter = stream.value.std() * stream.shown_per_unit
    nats = 0.5 * float(np.sum((size / scatter) ** 2)) - len(odd) * np.log(10.0)
    rms, flat = float(np.sqrt(np.mean(size**2))), np.zeros(size.size)
    return Remainder(place, rms, stream.shown, time / 86400.0, size, flat, "d", np.nan, nats)


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
    return Remainder(place, float(lasted.mean() / 60.0), "min", day, lasted / 60.0, flat, "d", np.nan, np.nan)
