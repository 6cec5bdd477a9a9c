"""The flow that nobody knew: where no product gave the currents, what GPS against dead reckoning says of them.

Imports NumPy and the inference. A newcomer would get wrong: in a record of a day a steady current, a tide and a slow
wander cannot be told apart, but that the water moved can, and so can where it will carry the next segments. Evidence
is against still water, not against an unknown red current.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from glider_jax.diagnosis.candidates import UNKNOWN_FLOW
from glider_jax.diagnosis.schema import summary_of
from glider_jax.inference.noise import CourseNoise
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.term import declared
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.run import Finding

ID, UNKNOWN = "navigation.mean_current", "Unknown flow"
#: m s-1 and s; what wanders beside mean and tides in unknown water, and what still water may do (judgement).
WANDER, STRAY, HOURS = 0.06, 0.02, 8.0 * 3600.0
#: nats of evidence against still water that name a flow; shares of the record after which the rest is predicted.
ENOUGH = 4.3
SPLITS = (0.4, 0.6, 0.8)
FEWEST = 2


@dataclass(frozen=True)
class Course:
    """Displacements (and drifts) as one Gaussian problem; rows: displacement east, north, drift east, north.

    ``residual`` (n,) m s-1 at the vehicle's own numbers; ``columns`` (n, k) of flow and calibrations per prior sd;
    ``flow`` (k,) marks flow; ``moved`` number of displacements; ``time`` (m,) of each moment, ``span`` (moved,) s.
    """

    noise: CourseNoise
    residual: Array
    columns: Array
    names: tuple[str, ...]
    flow: Array
    moved: int
    time: Array
    span: Array
    block: Array

    def covariance(self, wander: float) -> Array:
        """Covariance (n, n) of noise and wandering water of one size."""
        sizes = np.log([wander, HOURS, wander, 0.006, 0.008, 4.0 * 3600.0])
        one = self.noise.covariance(sizes)
        n = self.residual.size
        whole = np.zeros((n, n))
        for rows in self.noise.rows:
            whole[np.ix_(rows, rows)] = one
        return whole

    def rows(self, moments: Array) -> Array:
        """Rows of some moments, both components."""
        east, north = self.noise.rows
        return np.concatenate([east[moments], north[moments]])


def course_of(found: Finding) -> Course | None:
    """The navigation part of a finding; None with a product, or with too few displacements."""
    noises = found.search.problem.noises
    noise = next((n for n in noises if isinstance(n, CourseNoise)), None)
    if found.gathered.product or noise is None or noise.displacement is None:
        return None
    if noise.displacement[0].n < FEWEST:
        return None
    linear, unknowns = found.search.linear, found.search.problem.replay.unknowns
    first = sum(n.n for n in noises[: noises.index(noise)])
    rows = slice(first, first + noise.n)
    wanted = [
        i
        for i, label in enumerate(linear.labels)
        if label.variant == 0
        and label.unknown >= 0
        and (label.term in UNKNOWN_FLOW or unknowns[label.unknown].kind != "candidate")
    ]
    moved, drift = noise.displacement[0], noise.drift
    flowing = np.array([linear.labels[i].term in UNKNOWN_FLOW for i in wanted])
    # The search looks twice as far as is typical; what is to be foreseen is typical.
    typical = np.where(flowing, 0.5, 1.0)
    # Weights that the search gave to moments look at all of them; what is to be foreseen may not.
    fresh = CourseNoise(noise.displacement, noise.drift, noise.product)
    # What a compass or a clock was found to be wrong by is no flow.
    named = [i for pick in found.search.picks if pick.candidate.id != ID for i in pick.variant.columns]
    place = {column: n for n, column in enumerate(found.search.active)}
    other = linear.raw_columns[rows][:, named] @ np.array([found.mean[place[i]] for i in named]) if named else 0.0
    return Course(
        fresh,
        linear.raw[rows] - other,
        linear.raw_columns[rows][:, wanted] * typical,
        tuple(unknowns[linear.labels[i].unknown].name for i in wanted),
        flowing,
        moved.n,
        np.concatenate([moved.time, drift[0].time if drift else np.empty(0)]),
        moved.span,
        moved.block,
    )


def log_density(residual: Array, covariance: Array) -> float:
    """Logarithm of a normal density."""
    factor = cho_factor(covariance, lower=True)
    return float(-0.5 * residual @ cho_solve(factor, residual) - np.log(np.diag(factor[0])).sum())


def evidence(course: Course) -> float:
    """Nats by which moving water explains the fixes better than still water."""
    j, still = course.columns, course.columns[:, ~course.flow]
    moving = log_density(course.residual, j @ j.T + course.covariance(WANDER))
    return moving - log_density(course.residual, still @ still.T + course.covariance(STRAY))


def predicted(course: Course, known: Array, wanted: Array) -> tuple[Array, Array]:
    """Flow and speed errors at some rows from others: mean and variance, m s-1."""
    signal = course.columns @ course.columns.T + course.covariance(WANDER)
    gain = np.linalg.solve(signal[np.ix_(known, known)], signal[np.ix_(known, wanted)]).T
    variance = np.diag(signal)[wanted] - np.einsum("ij,ij->i", gain, signal[np.ix_(wanted, known)])
    return gain @ course.residual[known], variance


def left_over(course: Course) -> Array:
    """What each segment misses by when all others tell of the flow, (moved, 2) m s-1, east and north."""
    found = np.zeros((course.moved, 2))
    for k in range(course.moved):
        wanted = course.rows(np.array([k]))
        known = course.rows(np.delete(np.arange(course.time.size), k))
        guess, _ = predicted(course, known, wanted)
        found[k] = course.residual[wanted] - guess
    return found


def later(course: Course) -> list[dict[str, Any]]:
    """Errors of later segments, from the segments before a cut: without flow, with it, and with the last one's.

    Nothing of the later segments is used, neither in sizes of noise nor in the vehicle's numbers.
    """
    ends = course.time[: course.moved] + 0.5 * course.span
    found = []
    for share in SPLITS:
        count = int(round(share * course.moved))
        if count < min(2, course.moved - 1) or course.moved - count < 1 or any(count == one["fitted"] for one in found):
            continue
        order = np.argsort(course.time[: course.moved])
        cut = ends[order[count - 1]]
        test = order[count:]
        train = np.flatnonzero(course.time <= cut)
        train = np.setdiff1d(train, test)
        known, wanted = course.rows(train), course.rows(test)
        guess, _ = predicted(course, known, wanted)
        last = course.rows(order[count - 1 : count])
        persistent = np.repeat(course.residual[last], test.size)
        span = np.tile(course.span[test], 2)
        errors = {}
        for name, value in (("before", 0.0), ("after", guess), ("persistence", persistent)):
            miss = (course.residual[wanted] - value) * span
            errors[name] = np.hypot(miss[: test.size], miss[test.size :])
        found.append({
            "fitted": int(count), "predicted": int(test.size),
            **{f"{name}_m": float(np.median(e)) for name, e in errors.items()},
            **{f"{name}_rms_m": float(np.sqrt(np.mean(e**2))) for name, e in errors.items()},
        })  # fmt: skip
    return found


def look(found: Finding) -> dict[str, Any] | None:
    """What the fixes say of the flow, as plain data; None where a product was given or fixes are too few."""
    course = course_of(found)
    if course is None:
        return None
    everything = np.arange(course.residual.size)
    east, north = course.noise.rows
    moved = np.arange(course.moved)
    free = course.columns[:, course.flow] @ course.columns[:, course.flow].T + course.covariance(WANDER)
    white = block_diag(*[np.eye(1) * 0.006**2] * everything.size)
    whole = course.columns @ course.columns.T + course.covariance(WANDER)
    gain = np.linalg.solve(whole, free - white).T
    flow = gain @ course.residual
    spread = np.sqrt(np.maximum(np.diag(free - gain @ (free - white)), 0.0))
    u, v = flow[east[moved]], flow[north[moved]]
    weight = course.span / course.span.sum()
    mean = float(weight @ u), float(weight @ v)
    columns = course.columns
    inner = np.linalg.solve(whole, columns).T
    values, covariance = inner @ course.residual, np.eye(columns.shape[1]) - inner @ columns
    parts = {
        name: (0.5 * float(values[k]), 0.5 * float(np.sqrt(max(covariance[k, k], 0.0))))
        for k, name in enumerate(course.names)
        if course.flow[k]
    }
    return {
        "evidence": evidence(course),
        "mean_east": mean[0], "mean_north": mean[1],
        "rms": float(np.sqrt(weight @ (u**2 + v**2))),
        "segments": [
            {"day": float(t / 86400.0), "hours": float(s / 3600.0), "east": float(a), "north": float(b), "sd": float(c)}
            for t, s, a, b, c in zip(course.time[moved], course.span, u, v, spread[east[moved]], strict=True)
        ],
        "later": later(course),
        "parts": parts,
    }  # fmt: skip


def name_flow(found: Finding, content: dict[str, Any]) -> None:
    """Add what is known of the flow to a diagnosis; where the search left it to the noise, name it.

    Without a product any flow was left out of the forecast, whatever share of it a red process could stand for.
    """
    told = look(found)
    if told is None:
        return
    parts = told.pop("parts")
    content["flow"] = told
    if told["evidence"] < ENOUGH or any(effect["id"] in UNKNOWN_FLOW for effect in content["effects"]):
        return
    for effect in content["effects"]:
        # What is named beside the others is no twin of theirs.
        effect["alternatives"] = [a for a in effect["alternatives"] if a["id"] not in UNKNOWN_FLOW]
        effect["certain"] = not effect["alternatives"]
    content["effects"].insert(0, _effect(found, told, parts))
    course = course_of(found)
    span = course.span[:, None]
    east, north = course.noise.rows
    still = np.stack([course.residual[east[: course.moved]], course.residual[north[: course.moved]]], axis=1)
    left = left_over(course)
    content["held_out"]["figures"]["surfacing_error_m"] = {
        when: float(np.median(np.hypot(*(miss * span).T))) for when, miss in (("before", still), ("after", left))
    }
    # The figures draw each segment with the flow that all others tell of.
    for k, name in enumerate(("displacement east", "displacement north")):
        found.whitened[name] = (still[:, k], left[:, k])
    if content["verdict"] == "nothing_missing":
        content["verdict"] = "explained"
    content["summary"] = summary_of(content["verdict"], content["effects"], content["unexplained"], content["warnings"])
    content["not_found"] = [entry for entry in content["not_found"] if entry["id"] != ID]


def _effect(found: Finding, told: dict[str, Any], parts: dict[str, tuple[float, float]]) -> dict[str, Any]:
    info = TERMS_BY_ID[ID].info
    unknowns = {u.name: u for u in found.search.problem.replay.unknowns}
    entries = []
    for name, (z, sd) in sorted(parts.items(), key=lambda item: not item[0].startswith(ID)):
        unknown = unknowns[name]
        term, _, short = name.rpartition(".")
        one = declared(TERMS_BY_ID[term])[short]
        value, width = unknown.centre + unknown.scale * z, unknown.scale * sd
        interval = [value - 1.6449 * width, value + 1.6449 * width]
        entries.append({
            "name": short if term == ID else name, "value": value, "sd": width, "interval_90": interval,
            "unit": one.unit, "text": one.text,
            "shown": {"unit": one.shown, "value": value * one.shown_per_si,
                      "interval_90": [x * one.shown_per_si for x in interval]},
        })  # fmt: skip
    gained = [row["before_rms_m"] > row["after_rms_m"] for row in told["later"]]
    share = float(np.mean(gained)) if gained else 0.0
    return {
        "id": ID, "title": UNKNOWN, "plain":
        f"Between fixes the water moved {100.0 * told['rms']:.0f} cm/s (rms), and the forecast did not know of it.",
        "class": {"label": "unknown flow", "members": list(UNKNOWN_FLOW), "twins": [], "decided_by":
                  "a current product; a longer record, to tell a steady current from tides"},
        "certain": True, "evidence": told["evidence"], "parameters": entries, "shapes": {}, "alternatives": [],
        "streams": ["displacement east", "displacement north"],
        "located": f"The fixes lie where water moving {100.0 * told['rms']:.0f} cm/s carries the glider.",
        "held_out": {"gain": None, "folds_gaining": share, "confirmed": bool(gained) and share >= 0.6},
        "tentative": bool(gained) and share < 0.5,
        "equation": info.equation, "reference": info.reference,
    }  # fmt: skip
