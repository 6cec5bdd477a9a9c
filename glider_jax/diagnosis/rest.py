"""Where the fit of a set of effects comes to rest, and what it is worth there.

Imports the inference. A newcomer would get wrong: until an effect far from linear is accepted, calibrations stand for
it; a fit that goes on from where they strayed may rest in a valley beside the deepest, in which wrong effects then look
missing. It is begun at the vehicle file's own numbers too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from glider_jax.inference.fit import Linear, Problem, converged, inadequacy, nearest
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.screen import Pick

#: nats that calibrations of the flight may cost by their priors before a fit is begun afresh: as much as a name.
STRAYED = 4.3


def rested(problem: Problem, linear: Linear, fixed: Sequence[int], picks: Sequence[Pick]) -> tuple[float, Array]:
    """Evidence of some effects beside ``fixed`` columns where their fit comes to rest, nats, and all values there."""
    labels = linear.labels
    chosen = [*fixed, *(i for pick in picks for i in pick.variant.columns)]
    own = sorted({labels[i].unknown for i in chosen if labels[i].unknown >= 0})
    shapes = {k: v for pick in picks for k, v in pick.variant.shapes.items()}
    beside = inadequacy(problem.gathered) if "vertical speed" in problem.names else {}
    start, widths = problem.values.copy(), np.ones(len(own))
    for pick in picks:
        for unknown, value in pick.variant.start.items():
            start[unknown] = value
        mine = {labels[i].unknown for i in pick.variant.columns}
        widths[[n for n, unknown in enumerate(own) if unknown in mine]] = pick.variant.width
    found = converged(problem, own, beside, start, shapes, widths)
    for pick in picks:
        if pick.variant.start and strayed(problem, found[1]) > STRAYED:
            others = {labels[i].unknown for one in picks if one is not pick for i in one.variant.columns}
            start = _afresh(problem, pick, sorted(others), shapes)
            again = converged(problem, own, beside, start, shapes, widths)
            found = max(found, again, key=lambda one: one[0])
    return found


def _afresh(problem: Problem, pick: Pick, others: Sequence[int], shapes: dict[str, float]) -> Array:
    """The vehicle file's own numbers, the ``others`` unknowns as they are, and what of an effect fits best beside."""
    start = problem.centres()
    start[others] = problem.values[others]
    for unknown in pick.variant.start:
        one = problem.replay.unknowns[unknown]
        low, high = (one.centre + one.scale * edge for edge in pick.variant.cell)
        start = nearest(problem, unknown, (max(low, one.lower), min(high, one.upper)), start, shapes)
    return start


def calibrations_of_flight(problem: Problem) -> list[int]:
    """Unknowns that the vehicle file states and the flight rests on."""
    return [i for i, u in enumerate(problem.replay.unknowns) if u.kind == "calibration" and "flight" in u.groups]


def strayed(problem: Problem, values: Array) -> float:
    """What calibrations of the flight cost by their priors at some values, nats."""
    own = calibrations_of_flight(problem)
    strays = ((values - problem.centres()) / problem.scales())[own]
    return 0.5 * float(strays @ strays)
