"""Where the mismatch lives: stream, covariate and phase, against the null that whole dives change sign at random.

Imports NumPy, SciPy and the inference. A newcomer would get wrong: samples of one dive are no independent witnesses, so
dives are flipped as a whole; and what changes from dive to dive is looked at apart, against the noise law, because
flipping dives cannot see it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from glider_jax.inference.fit import Linear, Problem
from glider_jax.inference.noise import CourseNoise
from glider_jax.inference.streams import Stream
from glider_jax.records import Array

FLIPS, BINS = 4999, 8
#: Dive sums may scatter by this factor more than the noise law says before it counts.
#: Neighbouring dives share a red current error, so more is allowed where it counts.
SLACK, RED_SLACK = 1.6, 3.0
SHOWN = {
    "depth": ("m", 1.0), "temperature": ("K", 1.0), "density": ("kg m-3", 1.0), "heading": ("deg", 57.29578),
    "since_turn": ("s", 1.0), "since_surfacing": ("min", 1.0 / 60.0), "warming": ("K/min", 60.0),
    "pitch": ("deg", 57.29578), "hour": ("h UTC", 1.0), "tide": ("of the M2 cycle", 1.0), "time": ("d", 1.0 / 86400.0),
    "current": ("A", 1.0), "rate": ("m/s", 1.0), "roll": ("deg", 57.29578),
}  # fmt: skip


@dataclass(frozen=True)
class Place:
    """How strongly a stream's residual depends on a covariate.

    ``p`` by dive flips (or by the noise law for ``dive``), ``z`` of the worst bin, ``low`` and ``high`` its edges in
    shown units, ``phase`` ``dives``, ``climbs``, empty, or how a shape has both (see ``shapes.Shape``), ``size`` the
    mean residual in the bin in shown units, and ``share`` of the stream's residual variance that bin means explain.
    """

    stream: str
    covariate: str
    p: float
    z: float
    low: float
    high: float
    unit: str
    phase: str
    size: float
    size_unit: str
    share: float
    significant: bool = False


def covariates(stream: Stream, origin: float) -> dict[str, Array]:
    """What a stream's residual is looked at against; hour of day and dive are added."""
    found = {k: v for k, v in stream.covariates.items() if k != "direction" and np.ptp(v) > 0.0}
    found["hour"] = ((stream.time + origin) / 3600.0) % 24.0
    found["throughout"] = np.zeros(stream.n) + 0.5
    return found


def places(problem: Problem, linear: Linear, left: Array, raw: Array, seed: int = 11) -> list[Place]:
    """Every stream against every covariate.

    Parameters
    ----------
    left : (n,) whitened residual of the model looked at. raw : (n,) the same before whitening.
    """
    rng = np.random.default_rng(seed)
    found = []
    for number, name in enumerate(problem.names):
        rows = np.flatnonzero(linear.stream == number)
        stream = problem.gathered.stream(name)
        blocks, code = np.unique(stream.block, return_inverse=True)
        if rows.size < 12 or blocks.size < 6:
            continue
        signs = rng.choice([-1.0, 1.0], (FLIPS, blocks.size))
        q, unwhite = left[rows], raw[rows]
        noise = next(n for n in problem.noises if name in n.names)
        slack = SLACK
        if isinstance(noise, CourseNoise):
            # Whitening mixes displacements and drifts; each is looked at by itself, against its law's own scatter.
            sd = np.sqrt(np.diag(noise.covariance(noise.sizes)))
            q, slack = unwhite / (sd[noise.at_surface] if "drift" in name else sd[~noise.at_surface]), RED_SLACK
        direction = stream.covariates.get("direction")
        whole = float(np.sum(q * q))
        for key, x in covariates(stream, problem.gathered.origin).items():
            if key == "time":
                continue
            found += _flipped(stream, key, x, direction, q, unwhite, code, signs, whole)
        found += _by_dive(stream, direction, q, unwhite, blocks, code, slack)
    return sorted(found, key=lambda place: (place.p, -abs(place.z)))


def _flipped(stream, key, x, direction, q, unwhite, code, signs, whole) -> list[Place]:
    few = q.size < 12 * BINS
    edges = (
        np.array([0.0, 1.0])
        if key == "throughout"
        else np.unique(np.quantile(x, np.linspace(0.0, 1.0, (3 if few else BINS) + 1)))
    )
    if edges.size < 2:
        return []
    slot = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, edges.size - 2)
    bins = edges.size - 1
    phases = ("",) if direction is None else ("dives", "climbs")
    if direction is not None:
        slot = slot + bins * (direction > 0.0)
    count = np.bincount(slot, minlength=bins * len(phases)).astype(float)
    sums = np.zeros((signs.shape[1], count.size))
    np.add.at(sums, (code, slot), q)
    good = (count >= (5 if few else 8)) & ((np.abs(sums) > 0.0).sum(axis=0) >= 5)
    if not good.any():
        return []
    # Sums over their own scatter between dives: what a few dives do alone does not count here.
    scale = np.sqrt((sums * sums).sum(axis=0) + 1e-12)
    z = np.where(good, sums.sum(axis=0) / scale, 0.0)
    null = np.abs(signs @ (sums / scale) * good).max(axis=1)
    worst = int(np.argmax(np.abs(z)))
    p = float((1 + (null >= abs(z[worst]) - 1e-9).sum()) / (1 + null.size))
    mean = np.where(count > 0, np.bincount(slot, q, count.size) / np.maximum(count, 1), 0.0)
    share = float((count * mean**2)[good].sum() / max(whole, 1e-12)) - float(good.sum()) / max(q.size, 1)
    unit, factor = SHOWN.get(key, ("", 1.0))
    k = worst % bins
    size = float(unwhite[slot == worst].mean() * stream.shown_per_unit)
    return [
        Place(
            stream.name,
            key,
            p,
            float(z[worst]),
            float(edges[k] * factor),
            float(edges[k + 1] * factor),
            unit,
            phases[worst // bins],
            size,
            stream.shown,
            max(share, 0.0),
        )  # fmt: skip
    ]


def _by_dive(stream, direction, q, unwhite, blocks, code, slack) -> list[Place]:
    """Whether whole dives scatter more than the noise law says; names the worst."""
    found = []
    phases = (("", np.ones(q.size, bool)),)
    if direction is not None:
        phases = (("dives", direction < 0.0), ("climbs", direction > 0.0))
    for label, mine in phases:
        count = np.bincount(code[mine], minlength=blocks.size).astype(float)
        sums = np.bincount(code[mine], q[mine], blocks.size)
        good = count >= 2 if direction is not None else count >= 1
        if good.sum() < 6:
            continue
        z = np.where(good, sums / np.sqrt(np.maximum(count, 1.0)), 0.0)
        # One odd dive is a matter of heavy tails; a structure shows in several.
        trimmed = np.sort(z[good] ** 2)[:-1]
        p = float(chi2.sf(trimmed.sum() / slack, trimmed.size))
        worst = int(np.argmax(np.abs(z)))
        moments = stream.time[(code == worst) & mine] / 86400.0
        size = float(unwhite[(code == worst) & mine].mean() * stream.shown_per_unit)
        share = float((z**2)[good].sum() - good.sum()) / max(float(np.sum(q[mine] ** 2)), 1e-12)
        found.append(
            Place(
                stream.name,
                "dive",
                p,
                float(z[worst]),
                float(moments.min()),
                float(moments.max()),
                "d",
                label,
                size,
                stream.shown,
                max(share, 0.0),
            )  # fmt: skip
        )
    return found


def discoveries(found: list[Place], q: float = 0.05) -> list[Place]:
    """Mark what survives control of the false-discovery rate (Benjamini and Hochberg 1995)."""
    from dataclasses import replace

    order = np.argsort([place.p for place in found])
    limit = -1
    for rank, index in enumerate(order, start=1):
        if found[index].p <= q * rank / len(found):
            limit = rank
    kept = {int(i) for i in order[: max(limit, 0)]}
    return [replace(place, significant=i in kept) for i, place in enumerate(found)]


def _shared(size: str, more: bool, stream: str) -> str:
    """What several measurements say alike."""
    for name, ways in (("east", ("east", "west")), ("north", ("north", "south"))):
        if stream.endswith(name):
            return f"at depth and at the surface the water moves {size} more to the {ways[not more]} than the model"
    return f"{stream.partition(',')[0]} is {size} {'above' if more else 'below'} the model on dives and climbs alike"


#: What shapes say that are neither of dives nor of climbs; positive vertical speed is down.
_WAYS: dict[str, Callable[[str, bool, str], str]] = {
    "alike": lambda size, more, _: f"on dives and climbs alike the glider is carried {size} {'down' if more else 'up'}",
    "opposite": lambda size, more, _: (
        f"the glider dives and climbs {size} {'slower' if more else 'faster'} than the model"
    ),
    "across": lambda size, more, _: (
        f"the glider is set {size} to the {'right' if more else 'left'} of its heading"
    ),
    "along": lambda size, more, _: (
        f"the glider gets {size} {'ahead of' if more else 'behind'} the model along its heading"
    ),
    "shared": _shared,
}


def _what(place: Place) -> str:
    """What the glider or a measurement does beside the model, in words."""
    size, more = f"{abs(place.size):.2g} {place.size_unit}", place.size > 0.0
    if place.phase in _WAYS:
        return _WAYS[place.phase](size, more, place.stream)
    if place.stream == "vertical speed" and place.phase:
        # Positive is downward: a climb with a positive residual is slower.
        verb, faster = ("sinks", more) if place.phase == "dives" else ("climbs", not more)
        return f"the glider {verb} {size} {'faster' if faster else 'slower'} than the model"
    for name, ways in (("east", ("east", "west")), ("north", ("north", "south"))):
        if place.stream == f"displacement {name}":
            return f"the glider gets {size} further {ways[not more]} than the model"
        if place.stream == f"surface drift {name}":
            return f"at the surface it drifts {size} more to the {ways[not more]}"
    phase = f"on {place.phase}, " if place.phase else ""
    return f"{phase}{place.stream} is {size} {'above' if more else 'below'} the model"


def sentence(place: Place) -> str:
    """One plain sentence about a place."""
    if place.covariate == "stuck":
        return (
            f"The pitch stands still for {place.size:.0f} min in all, {place.z:.0f} times between day {place.low:.1f} "
            f"and {place.high:.1f}, while the glider moves on: what rests on it then is void."
        )
    if place.covariate == "throughout":
        where = "all the time"
    elif place.covariate == "stroke":
        where = f"in {place.z:.0f} strokes, {100.0 * place.share:.0f} % of all"
    elif place.covariate == "dive":
        span = place.high - place.low
        unit, times, digits = ("day", 1.0, 1) if span > 0.3 else ("day", 1.0, 2) if span > 0.05 else ("hour", 24.0, 1)
        where = f"most between {unit} {times * place.low:.{digits}f} and {times * place.high:.{digits}f}"
    else:
        name = place.covariate.replace("_", " ")
        zero, unit = (273.15, "degrees C") if place.unit == "K" else (0.0, place.unit)
        digits = 6 if place.covariate == "density" else 4
        where = f"most where {name} is {place.low - zero:.{digits}g} to {place.high - zero:.{digits}g} {unit}".rstrip()
    text = f"{_what(place)}, {where}."
    return text[0].upper() + text[1:]


def onset(stream: Stream, left: Array) -> tuple[float, float]:
    """Day at which the mean of a whitened residual changes most, and the z of that change, by cumulative sums."""
    order = np.argsort(stream.time)
    q = left[order] - left.mean()
    n = q.size
    if n < 20:
        return float("nan"), 0.0
    k = np.arange(1, n)
    curve = np.abs(np.cumsum(q)[:-1]) / np.sqrt(k * (n - k) / n)
    inside = slice(n // 20, n - 1 - n // 20)
    best = int(np.argmax(curve[inside])) + n // 20
    return float(stream.time[order][best] / 86400.0), float(curve[best])
