"""Where the fit of a set of effects comes to rest, and what it is worth there.

Imports the inference. A newcomer would get wrong: until an effect far from linear is accepted, calibrations stand for
it; a fit that goes on from where they strayed may rest in a valley beside the deepest, in which wrong effects then look
missing. It is begun at the vehicle file's own numbers then.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from glider_jax.inference.fit import Linear, Problem, converged, inadequacy, nearest
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.screen import Pick

#: nats that calibrations of the flight may cost by their priors beyond which a fit is begun afresh: as much as a name.
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
    begun = [lambda: start]
    begun += [lambda one=pick: _afresh(problem, linear, picks, one) for pick in picks if pick.variant.start]
    if strayed(problem, problem.values) > STRAYED:
        begun.reverse()
    found = (-np.inf, start)
    for begin in begun:
        found = max(found, converged(problem, own, beside, begin(), shapes, widths), key=lambda one: one[0])
        if strayed(problem, found[1]) <= STRAYED:
            break
    return found


def _afresh(problem: Problem, linear: Linear, picks: Sequence[Pick], afar: Pick) -> Array:
    """The vehicle file's own numbers, other effects as they are, and what of the one from afar fits best beside."""
    start = problem.centres()
    others = sorted({linear.labels[i].unknown for one in picks if one is not afar for i in one.variant.columns})
    start[others] = problem.values[others]
    shapes = {k: v for pick in picks for k, v in pick.variant.shapes.items()}
    for unknown in afar.variant.start:
        one = problem.replay.unknowns[unknown]
        low, high = (one.centre + one.scale * edge for edge in afar.variant.cell)
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
