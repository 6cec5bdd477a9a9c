"""Flexible shapes that nobody named: curves over every covariate, and bumps in time, of every stream.

NumPy only. A newcomer would get wrong: a shape is a family of curves with a prior, not a curve; on dives and climbs it
is alike (moving water, buoyancy) or opposite (drag, lift), which tells more than either phase by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.diagnosis.locate import covariates
from glider_jax.inference.fit import Problem
from glider_jax.inference.streams import Stream
from glider_jax.records import Array

#: Nodes of a curve, coarse and fine; half widths in s of bumps in time, and numbers that a bump has to cover.
COARSE, FINE = 4, 12
WIDTHS = (2700.0, 5400.0, 10800.0, 21600.0, 43200.0)
COVERED = 2.0
#: s and m/s; periods of internal waves that come in bursts, and how fast they move the water. A wave in step with the
#: yos carries dives and climbs oppositely for an hour or two, as drag would.
WAVES, HEAVE = (480.0, 5400.0), 0.005
#: s; bursts are no longer than this, half width.
BURST = 10800.0
#: Cycles of a curve that comes back: of the hour, the heading and the tide.
CYCLES = 4
#: s; the tide that everything is looked at over.
TIDE = 44714.0
AROUND = {"hour": 24.0, "tide": 1.0, "heading": 2.0 * np.pi}
#: Covariates that others stand for, or that the replay leaves open.
LEFT_OUT = frozenset({"time", "pitch", "warming", "since_surfacing"})
#: Streams of which a shift within the scatter of one number is nothing that a pilot would act on.
ROUGH = frozenset({"turn depth", "water depth", "surface stay", "charge counter", "depth at the surface"})
#: Streams that one cause moves alike.
TOGETHER = (
    ("hotel power, dives", "hotel power, climbs"), ("hotel power, dives", "hotel power, climbs", "surface power"),
    ("displacement east", "surface drift east"), ("displacement north", "surface drift north"),
)  # fmt: skip


@dataclass(frozen=True)
class Shape:
    """A family of curves over one covariate: columns of each stream that it moves, unit variance beforehand.

    ``stream`` is where it is told of. ``how``: ``alike`` or ``opposite`` on dives and climbs, ``dives``, ``climbs``,
    ``across`` or ``along`` the heading, ``shared`` by several streams, or empty. Of ``bumps`` one column is there, of
    others all are together. ``curve`` (nodes, k) draws them over ``at``.
    """

    stream: str
    covariate: str
    how: str
    parts: dict[str, Array]
    at: Array
    curve: Array
    bumps: bool = False

    @property
    def width(self) -> int:
        """How many columns."""
        return self.curve.shape[1]


def bank(problem: Problem) -> list[Shape]:
    """All shapes of all streams: each by itself, and what loads, and the flow above and below, have in common."""
    found = []
    streams = {s.name: s for s in problem.gathered.streams if s.name not in ROUGH}
    for stream in streams.values():
        direction = stream.covariates.get("direction")
        ways: list[tuple[str, Array]] = [("", np.ones(stream.n))]
        if direction is not None:
            ways = [("alike", np.ones(stream.n)), ("opposite", direction)]
            ways += [("dives", (direction < 0.0).astype(float)), ("climbs", (direction > 0.0).astype(float))]
        for key, x in _axes(stream, problem.gathered.origin).items():
            for at, curve, columns in _curves(key, x):
                for how, sign in ways:
                    found.append(Shape(stream.name, key, how, {stream.name: columns * sign[:, None]}, at, curve))
        if stream.n < 12:
            continue
        for width in WIDTHS:
            at, columns = _bumps(stream.time, width)
            for how, sign in ways[:2]:
                if at.size > 2:
                    parts = {stream.name: columns * sign[:, None]}
                    found.append(Shape(stream.name, "dive", how, parts, at, np.eye(at.size), True))
    for together in TOGETHER:
        there = [streams[name] for name in together if name in streams]
        if len(there) > 1:
            found += _shared(there, problem.gathered.origin)
    return found + _headed(problem)


def _shared(there: list[Stream], origin: float) -> list[Shape]:
    """What several streams have in common: curves over time, the hour and the tide, and one number."""
    found = []
    time = np.concatenate([s.time for s in there])
    cuts = np.cumsum([s.n for s in there])[:-1]
    for key, x in (
        ("throughout", time), ("dive", time), ("hour", ((time + origin) / 3600.0) % 24.0), ("tide", (time / TIDE) % 1.0)
    ):  # fmt: skip
        for at, curve, columns in _curves(key, x):
            parts = {s.name: c for s, c in zip(there, np.split(columns, cuts), strict=True)}
            found.append(Shape(there[0].name, key, "shared", parts, at, curve))
    for width in WIDTHS[1:]:
        at, columns = _bumps(time, width)
        if at.size > 2:
            parts = {s.name: c for s, c in zip(there, np.split(columns, cuts), strict=True)}
            found.append(Shape(there[0].name, "dive", "shared", parts, at, np.eye(at.size), True))
    return found


def _headed(problem: Problem) -> list[Shape]:
    """A velocity across or along the heading that depends on it, row by row of the record."""
    east = problem.gathered.stream("displacement east")
    inputs = problem.gathered.inputs
    if east is None:
        return []
    heading = np.asarray(inputs.rows["heading"])
    course, share = np.asarray(inputs.course), np.asarray(inputs.course_share)
    mine = (course >= 0) & (np.asarray(inputs.direction) != 0.0)
    h, slot, weight = heading[mine], course[mine], share[mine]
    at = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    found = []
    for key, curve, columns in (
        ("throughout", np.ones((1, 1)), np.ones((h.size, 1))),
        ("heading", _harmonics(at / (2.0 * np.pi)), _harmonics(h / (2.0 * np.pi))),
    ):
        for how, ways in (("across", (np.cos(h), -np.sin(h))), ("along", (np.sin(h), np.cos(h)))):
            parts = {}
            for name, way in zip(("displacement east", "displacement north"), ways, strict=True):
                summed = np.zeros((east.n, columns.shape[1]))
                np.add.at(summed, slot, columns * (weight * way)[:, None])
                parts[name] = summed
            found.append(Shape(east.name, key, how, parts, at if key == "heading" else np.zeros(1), curve))
    return found


def _axes(stream: Stream, origin: float) -> dict[str, Array]:
    """Covariates that vary, with time as ``dive``, the hour and the tide's phase."""
    found = {k: v for k, v in covariates(stream, origin).items() if k not in LEFT_OUT}
    found["dive"] = stream.time
    found["tide"] = (stream.time / TIDE) % 1.0
    return {k: v for k, v in found.items() if np.isfinite(v).all()}


def _curves(key: str, x: Array) -> list[tuple[Array, Array, Array]]:
    """Where each family of curves is drawn, the curves there, and the curves at ``x``; unit variance beforehand."""
    if key == "throughout":
        return [(np.zeros(1), np.ones((1, 1)), np.ones((x.size, 1)))]
    if key in AROUND:
        at = np.linspace(0.0, AROUND[key], 24, endpoint=False)
        return [(at, _harmonics(at / AROUND[key]), _harmonics(x / AROUND[key]))]
    found = []
    for count in (COARSE, FINE):
        if np.unique(x).size < 2 * count:
            continue
        nodes = np.unique(np.quantile(x, np.linspace(0.0, 1.0, count)))
        if nodes.size < 3:
            continue
        width = 1.5 * float(np.median(np.diff(nodes)))
        smooth = np.exp(-0.5 * (np.subtract.outer(nodes, nodes) / width) ** 2) + 1e-6 * np.eye(nodes.size)
        factor = np.linalg.cholesky(smooth)
        hats = np.stack([np.interp(x, nodes, np.eye(nodes.size)[k]) for k in range(nodes.size)], axis=1)
        found.append((nodes, factor, hats @ factor))
    return found


def _harmonics(share: Array) -> Array:
    """Sines and cosines around a cycle, the finer the smaller, together of unit variance."""
    k = np.arange(1, CYCLES + 1)
    phase = 2.0 * np.pi * share[:, None] * k
    weight = 1.0 / k
    both = np.concatenate([np.sin(phase) * weight, np.cos(phase) * weight], axis=1)
    return both / np.sqrt(np.sum(weight**2))


def _bumps(time: Array, width: float) -> tuple[Array, Array]:
    """Moments every half width from end to end, and a bell around each."""
    at = np.arange(time.min(), time.max() + 1.0, width)
    columns = np.exp(-0.5 * ((time[:, None] - at) / width) ** 2)
    good = columns.sum(axis=0) > COVERED
    return at[good], columns[:, good]


def burst(time: Array, middle: float, width: float) -> Array:
    """Columns (n, k) of vertical speed under a burst of internal waves of any period around a moment, m/s."""
    slow, fast = 1.0 / WAVES[1], 1.0 / WAVES[0]
    rates = np.arange(slow, fast, 0.5 / (np.pi * width))
    bell = np.exp(-0.5 * ((time - middle) / (1.5 * width)) ** 2)
    phase = 2.0 * np.pi * (time - middle)[:, None] * rates
    return HEAVE * bell[:, None] * np.concatenate([np.sin(phase), np.cos(phase)], axis=1)
