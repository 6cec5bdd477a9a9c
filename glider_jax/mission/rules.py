"""A mission's program as the compiled step needs it: kinds (static) and numbers (traced) of its rules.

Made once on the host; ``mission.program`` follows them. Thresholds of the charge become energies here, since energy is
what the step counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from glider_jax.config import PROGRAM_CONDITIONS, Battery, Mission, ProgramRule
from glider_jax.environment.frame import Frame
from glider_jax.errors import ConfigError
from glider_jax.mission.battery import discharge_table, energy_limits
from glider_jax.readers.mission_programs import rule_text

#: The reason of a surfacing that a rule asked for.
REASON = "program"
CHARGE = "state_of_charge"


class RuleKind(NamedTuple):
    """What is static of a rule: kinds of its conditions, names of its actions, ``goto`` as a kind, and ``once``."""

    when: tuple[str, ...]
    actions: tuple[str, ...]
    goto: str
    once: bool


class RuleNumbers(NamedTuple):
    """What is traced of a rule: a threshold per condition, and a number per action by name (goto: east, north, leg)."""

    thresholds: tuple[Any, ...]
    values: dict[str, Any]


def make_program(
    mission: Mission,
    battery: Battery,
    frame: Frame,
    order: tuple[tuple[float, float], ...],
    t0: float,
    timed: list,
    dtype,
    home: tuple[float, float] | None = None,
):
    """The static and the traced half of a mission's program; two empty tuples where it has none.

    Parameters
    ----------
    order : waypoints as flown.  t0 : UTC seconds of the start.  timed : the surface rules with a clock, in order.
    home : (latitude, longitude) where the flight starts; the frame's origin if None.

    Raises
    ------
    ConfigError : a rule names a waypoint that is not flown.
    """
    kinds, numbers = [], []
    for index, rule in enumerate(mission.program, 1):
        kind = _goto_kind(rule)
        kinds.append(RuleKind(tuple(c.kind for c in rule.when), rule.actions, kind, rule.once))
        thresholds = []
        for condition in rule.when:
            quantity = PROGRAM_CONDITIONS[condition.kind][0]
            value = condition.value
            if quantity == CHARGE:
                value = _spent_share(value, battery, mission)
            elif quantity == "time":
                value -= t0
            elif quantity == "flying_to_waypoint":
                value = _leg_of(mission, order, int(value), f"{mission.name}: program rule {index}")
            thresholds.append(jnp.asarray(value, dtype))
        values: dict[str, Any] = {}
        for name in ("dive_to", "climb_to", "altitude", "pitch"):
            if name in rule.actions:
                values[name] = jnp.asarray(getattr(rule, name), dtype)
        if "surface_every" in rule.actions:
            periodic = [r.seconds if r.kind not in ("every", "after") else rule.surface_every for r in timed]
            values["surface_every"] = jnp.asarray(periodic, dtype)
        if kind == "place":
            place = home if rule.goto == "home" else rule.goto
            east, north = (0.0, 0.0) if place is None else frame.to_metres(*np.array(place, float))
            values["goto"] = jnp.asarray([east, north], dtype)
        elif kind == "waypoint":
            leg = _leg_of(mission, order, int(rule.goto), f"{mission.name}: program rule {index}")
            values["goto"] = jnp.asarray(leg, jnp.int32)
        numbers.append(RuleNumbers(tuple(thresholds), values))
    return tuple(kinds), tuple(numbers)


def _goto_kind(rule: ProgramRule) -> str:
    if rule.goto is None:
        return ""
    if isinstance(rule.goto, tuple) or rule.goto == "home":
        return "place"
    return "next" if rule.goto == "next" else "waypoint"


def _leg_of(mission: Mission, order, number: int, where: str) -> int:
    """Index among the legs flown of a waypoint by its number in the mission's list; its first time if flown often."""
    point = tuple(mission.waypoints[number - 1])
    legs = [k for k, flown in enumerate(order) if tuple(flown) == point]
    if not legs:
        raise ConfigError(
            f"{where}: expected a waypoint that is flown, found number {number}, which the mission leaves out. "
            "Change first_waypoint or legs, or name another."
        )
    return legs[0]


def _spent_share(charge: float, battery: Battery, mission: Mission) -> float:
    """Energy drawn when this share of the charge is left, over the energy at which the mission ends.

    Both are shares of what a member's pack holds, which is drawn; their ratio is the same for all members.
    """
    soc, share, _ = discharge_table(battery)
    limit = float(energy_limits(battery, mission, np.ones(1))[0][0])
    return float(np.interp(1.0 - charge, 1.0 - soc, share)) / limit


def deepest(mission: Mission) -> Mission:
    """The mission with its yo as deep as any rule makes it, for tables that must reach there."""
    depths = [rule.dive_to for rule in mission.program if rule.dive_to is not None]
    if not depths:
        return mission
    return replace(mission, yo=replace(mission.yo, dive_to=max(mission.yo.dive_to, *depths)))


def program_words(mission: Mission) -> list[str]:
    """Every rule in one line."""
    return [rule_text(rule, number) for number, rule in enumerate(mission.program, 1)]


def program_notes(mission: Mission, seafloor: bool) -> list[str]:
    """What of the program cannot act as the user may expect."""
    notes = []
    for rule, words in zip(mission.program, program_words(mission), strict=True):
        asked = {PROGRAM_CONDITIONS[condition.kind][0] for condition in rule.when}
        if "bottom" in asked and not seafloor:
            notes.append(f"{words}: no bathymetry given, so the seafloor is always deeper")
        if "current" in asked:
            notes.append(f"{words}: the current is the glider's own estimate, none before the first surfacing")
    if any(rule.dive_to is not None or rule.climb_to is not None for rule in mission.program):
        notes.append("program: devices that run between depths keep the duty of the mission's own yo")
    return notes


def program_results(mission: Mission, program: Any, t0: float) -> dict[str, Any]:
    """When each rule came into force, as fields of a ``Track``: times UTC s of shape (member, rule)."""
    if not mission.program:
        return {}
    return {
        "program": tuple(program_words(mission)),
        "program_time": t0 + np.stack([np.asarray(first, float) for first in program.first], -1),
        "program_count": np.stack([np.asarray(count, np.int32) for count in program.count], -1),
    }
