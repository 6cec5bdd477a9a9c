"""Periods, onsets and depth scales of accepted effects: where they fit best, and what not knowing them costs.

Imports NumPy and the inference. A newcomer would get wrong: a search looks at shapes on a grid, which is fine enough to
name an effect and too coarse for its phase; and an amplitude is not known better than the shape that it rests on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from glider_jax.inference.fit import robust_covariance, rows_of
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.term import declared
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.screen import Search

#: Logarithm by which a shape is moved for its slope; steps, the longest of them in prior sds, and the shortest worth
#: taking in sds of what the data leave open.
NUDGE, STEPS, LONGEST, SHORTEST = 1e-3, 4, 0.5, 0.2


def tune(search: Search) -> None:
    """Move the shapes of accepted effects to where they fit best; a step that fits worse is taken back."""
    for _ in range(STEPS):
        slopes, places, factors = _bends(search)
        if slopes.shape[1] == 0:
            return
        linear, active = search.linear, search.active
        columns = np.concatenate([linear.columns[:, active], slopes], axis=1)
        known = np.append(linear.precision[active], np.ones(places.size))
        aimed = np.append(np.zeros(len(active)), -places)
        covariance = np.linalg.inv(columns.T @ columns + np.diag(known))
        found = covariance @ (columns.T @ linear.residual + known * aimed)
        step = np.clip(found[len(active) :], -LONGEST, LONGEST)
        if (np.abs(step) < SHORTEST * np.sqrt(np.diag(covariance)[len(active) :])).all():
            return
        before, picks, at = _fit(search, places), search.picks, (search.problem.values, search.problem.shapes)
        moved = {n: v * float(np.exp(s * f)) for (n, v), s, f in zip(at[1].items(), step, factors, strict=True)}
        search.picks = [
            replace(p, variant=replace(p.variant, shapes={n: moved[n] for n in p.variant.shapes})) for p in picks
        ]
        search.relinearise(learn_noise=False)
        if _fit(search, places + step) < before:
            search.picks, (search.problem.values, search.problem.shapes) = picks, at
            search.relinearise(learn_noise=False)
            return


def estimates(search: Search) -> tuple[Array, Array]:
    """Values of the active columns in prior units, and their covariance with what shapes and whole dives add.

    A fit that rests although the linear problem points elsewhere lies in a valley that bends: the values are those at
    which it rests, and the way to where it points is counted as not known.
    """
    linear, active = search.linear, search.active
    mean, known = linear.solve(active)
    covariance = widened(search, robust_covariance(linear, active, mean, known))
    here = (search.problem.values - search.problem.centres()) / search.problem.scales()
    own = [linear.labels[i].unknown for i in active]
    away = np.array([m - here[k] if k >= 0 else 0.0 for m, k in zip(mean, own, strict=True)])
    if (np.abs(away) > np.sqrt(np.diag(known))).any():
        return mean - away, covariance + np.outer(away, away)
    return mean, covariance


def widened(search: Search, covariance: Array) -> Array:
    """Posterior covariance of the active columns with what their shapes, known no better than the data tell, add."""
    slopes, places, _ = _bends(search)
    if slopes.shape[1] == 0:
        return covariance
    linear, active = search.linear, search.active
    columns = np.concatenate([linear.columns[:, active], slopes], axis=1)
    known = np.append(linear.precision[active], np.ones(places.size))
    whole = np.linalg.inv(columns.T @ columns + np.diag(known))[: len(active), : len(active)]
    return covariance + whole - linear.solve(active)[1]


def _fit(search: Search, places: Array) -> float:
    """Evidence of the accepted set, and of its shapes' places under their priors."""
    left = search.linear.residual
    return search.linear.score(search.active) - 0.5 * float(left @ left + places @ places)


def _bends(search: Search) -> tuple[Array, Array, Array]:
    """Whitened slopes (n, k) by each shape of the accepted effects, per prior sd of its logarithm; where each shape
    stands in its prior, sds from the median; and the logarithm of a prior sd."""
    problem = search.problem
    slopes, places, factors = [], [], []
    for name, value in problem.shapes.items():
        id, own = name.rsplit(".", 1)
        prior = declared(TERMS_BY_ID[id])[own].prior
        factor = float(np.log(prior.factor))
        either = [
            problem.replay.predict(problem.values, {**problem.shapes, name: value * float(np.exp(way * NUDGE))})
            for way in (1.0, -1.0)
        ]
        slopes.append(
            np.concatenate([np.nan_to_num(either[0][n] - either[1][n]) for n in problem.names]) * factor / (2.0 * NUDGE)
        )
        places.append(float(np.log(value / prior.median)) / factor)
        factors.append(factor)
    raw = np.stack(slopes, axis=1) if slopes else np.zeros((search.linear.residual.size, 0))
    white = np.empty_like(raw)
    for noise, rows in zip(problem.noises, rows_of(problem), strict=True):
        white[rows] = noise.whiten(raw[rows])[0] if slopes else raw[rows]
    return white, np.array(places), np.array(factors)
