"""What an inference does not know: amplitudes of the library, calibrations of the vehicle file, and nuisances.

Imports the physics' channels. A newcomer would get wrong: a nuisance is no effect that could be named; it is always
free, so that nothing is learned from what no vehicle file can state.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from glider_jax.config import CovarianceBlock
from glider_jax.physics.perturb import factor
from glider_jax.physics.term import Channel, declared
from glider_jax.records import Array

_FLIGHT = frozenset({
    Channel.NET_BUOYANCY, Channel.DRAG_COEFFICIENT, Channel.INDUCED_DRAG, Channel.LIFT_SLOPE, Channel.LOG_DRAG,
    Channel.LOG_LIFT, Channel.THRUST, Channel.PITCH, Channel.RESPONSE_TIME, Channel.VERTICAL_WATER_VELOCITY,
})  # fmt: skip
_COURSE = frozenset({
    Channel.CURRENT_EAST, Channel.CURRENT_NORTH, Channel.SURFACE_DRIFT_EAST, Channel.SURFACE_DRIFT_NORTH,
    Channel.HEADING,
})  # fmt: skip


@dataclass(frozen=True)
class Nuisance:
    """A number beside the physics that is never known exactly and always projected out; ``sd`` in ``unit``."""

    name: str
    sd: float
    unit: str
    group: str
    text: str


NUISANCES: tuple[Nuisance, ...] = (
    Nuisance("inflection way", 0.03, "1", "flight", "way made good while turning, share beyond the model's"),
    Nuisance("pitch wander", 0.3, "1", "flight", "answer to pitch that wanders within a half yo, more than all"),
    Nuisance("pitch delay", 2.0, "s", "flight", "time by which that answer comes early"),
    Nuisance("wander lag", 5.0, "s", "flight", "time by which the speed answers to it later than the motion does"),
    Nuisance("lag by speed", 0.25, "1", "flight", "power of the speed with which the inertia along the path grows"),
    Nuisance("lag of rate", 0.25, "1", "flight", "share of the lag that is in the vertical speed, not along the path"),
    Nuisance("load of a stroke", 0.7, "1", "power", "whose load it bears: 1 of the phase to come, -1 of the last"),
    Nuisance("gauge at the surface", 0.1, "m", "power", "depth of the pressure gauge while surfaced, about 0.3 m"),
    Nuisance("turn", 3.0, "m", "power", "how far a dive runs past the depth at which it was told to turn"),
    Nuisance("turn time", 6.0, "s", "power", "time for which it goes on at its vertical speed while it turns"),
    Nuisance("turn on altitude", 3.0, "m", "power", "the same of turns that the altimeter calls, beyond the others"),
    Nuisance("stay", 150.0, "s", "power", "time at the surface beyond the plan"),
    Nuisance("open circuit", 0.05, "V", "power", "open-circuit voltage against the pack's curve"),
    Nuisance("charge", 0.05, "1", "power", "fall of the voltage against the pack's curve, share"),
    Nuisance("chart", 8.0, "m", "power", "water depth against the chart"),
)
#: The stream without which a nuisance says nothing.
_SHOWN_IN = {
    "inflection way": "displacement east", "pitch wander": "vertical speed", "pitch delay": "vertical speed",
    "wander lag": "vertical speed", "lag by speed": "vertical speed", "lag of rate": "vertical speed",
    "turn": "turn depth", "turn time": "turn depth", "turn on altitude": "turn depth",
    "gauge at the surface": "depth at the surface", "stay": "surface stay", "load of a stroke": "pump in energy",
    "open circuit": "battery voltage", "charge": "battery voltage", "chart": "water depth",
}  # fmt: skip
GAUGE_DEPTH = 0.3
#: How well the response time that follows from mass, drag and speed is known, share.
RESPONSE_SHARE = 0.15


@dataclass(frozen=True)
class Unknown:
    """One coordinate of the inference: value = centre + scale x z with z standard normal before the data.

    ``kind`` is ``candidate`` (an amplitude of a term of the library), ``calibration`` (a number of the vehicle file
    with a sigma) or ``nuisance``. ``groups`` say which predictions it moves: ``flight``, ``course``, ``power``.
    """

    name: str
    term: str
    kind: str
    centre: float
    scale: float
    groups: frozenset[str]
    lower: float = -np.inf
    upper: float = np.inf


def nuisances(streams: Collection[str], voltage: float = 1.0) -> list[Unknown]:
    """Unknowns of the nuisances that some streams show; those of the voltage are ``voltage`` times as loose."""
    found = []
    for one in NUISANCES:
        stream = _SHOWN_IN[one.name]
        if stream in streams:
            scale = one.sd * (voltage if stream == "battery voltage" else 1.0)
            found.append(Unknown(one.name, one.name, "nuisance", 0.0, scale, frozenset({one.group})))
    return found


def channels_of(name: str, terms: Sequence[Any]) -> tuple[Channel, ...]:
    """Channels of the term that a public name or a named quantity of the vehicle belongs to."""
    for term in terms:
        if name in {info.quantity for info in declared(term).values()} or name.startswith(term.info.id + "."):
            return term.info.channels
    return (Channel.NET_BUOYANCY,)


def groups_of(channels) -> frozenset[str]:
    """Predictions that numbers of some channels move: ``flight``, ``course`` and ``power``."""
    found = set()
    for channel in channels:
        if channel in _FLIGHT:
            found.add("flight")
        elif channel in _COURSE or channel is Channel.LOG_SPEED:
            found.add("flight" if channel is Channel.LOG_SPEED else "course")
        elif channel is Channel.PRESSURE_OFFSET:
            found |= {"flight", "power"}
        else:
            found.add("power")
    return frozenset(found)


def tied_by(unknowns: Sequence[Unknown], blocks: Sequence[CovarianceBlock]) -> tuple[list[Unknown], Array]:
    """Unknowns of a vehicle file whose numbers are known jointly.

    A drag that was fitted to a glide goes with the lift that was assumed: were the lift another, so would the drag be.
    The unknowns stay independent coordinates; what each carries along is in the map.

    Returns
    -------
    The unknowns, with the predictions that they now move, and (unknowns, unknowns) numbers in prior sds by coordinate.
    """
    found = list(unknowns)
    place = {u.name: i for i, u in enumerate(found) if u.kind == "calibration"}
    joint = np.eye(len(found))
    for block in blocks:
        kept = [n for n, name in enumerate(block.names) if name in place]
        own = [place[block.names[n]] for n in kept]
        if len(own) < 2:
            continue
        matrix = np.asarray(block.matrix, float)[np.ix_(kept, kept)]
        part = CovarianceBlock(tuple(block.names[n] for n in kept), tuple(map(tuple, matrix.tolist())))
        root = factor(part) / np.array([found[i].scale for i in own])[:, None]
        joint[np.ix_(own, own)] = root
        for n, i in enumerate(own):
            moved = [found[k].groups for k, share in zip(own, root[:, n], strict=True) if share != 0.0]
            found[i] = replace(found[i], groups=frozenset().union(found[i].groups, *moved))
    return found, joint
