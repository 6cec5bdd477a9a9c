"""Mission programs in TOML: ``[[program]]`` tables -> :class:`~glider_jax.config.ProgramRule`, and back.

Each rule has ``when``, conditions that must all hold, and ``then``, what is done. Numbers are SI unless their key ends
in a unit (``energy_used_above_kj``, ``elapsed_above_d``, ``dive_to_m``); pitches are degrees, times UTC. Standard
library only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

from glider_jax.config import PROGRAM_CONDITIONS, Condition, ProgramRule
from glider_jax.errors import ConfigError
from glider_jax.readers.mission_values import bool_text, pair_text, parse_time, position_of, quote
from glider_jax.readers.toml_checks import Table

#: Numbers of ``then``: SI unit, and unit of a number that names none.
ACTION_NUMBERS = {
    "dive_to": ("m", None), "climb_to": ("m", None), "altitude": ("m", None), "pitch": ("rad", "deg"),
    "surface_every": ("s", None),
}  # fmt: skip
_UNIT_WORDS = {"J": (3600.0, "Wh"), "s": (86400.0, "days"), "m": (1.0, "m"), "m s-1": (1.0, "m/s")}


def read_program(top: Table) -> tuple[ProgramRule, ...]:
    """The rules of a mission file, in their order.

    Raises
    ------
    ConfigError : an unknown key, a wrong unit, or a value of the wrong kind.
    """
    return tuple(_rule(table) for table in top.tables("program"))


def _rule(table: Table) -> ProgramRule:
    when, then = table.table("when"), table.table("then")
    for key, part in (("when", when), ("then", then)):
        if part is None:
            raise ConfigError(f"{table.where()}: expected a table '{key}', found none. Add {key} = {{ ... }}.")
    conditions = _conditions(when)
    values = {}
    for key, (unit, bare) in ACTION_NUMBERS.items():
        given = then.quantity(key, unit, bare)
        values[key] = None if given is None else given.value
    if values["pitch"] is not None:
        values["pitch"] = abs(values["pitch"])
    rule = ProgramRule(
        when=conditions,
        name=table.text("name", "") or "",
        goto=_goto(then),
        surface_now=then.boolean("surface_now", False),
        end_mission=then.boolean("end_mission", False),
        once=table.boolean("once", True),
        **values,
    )
    for part in (when, then, table):
        part.close()
    return rule


def _conditions(when: Table) -> tuple[Condition, ...]:
    found = []
    for kind, (quantity, unit, _) in PROGRAM_CONDITIONS.items():
        if quantity == "time":
            value = parse_time(when, kind)
        elif quantity == "flying_to_waypoint":
            value = when.integer(kind, None, 1)
        else:
            given = when.quantity(kind, unit)
            value = None if given is None else given.value
        if value is not None:
            found.append(Condition(kind, float(value)))
    return tuple(found)


def _goto(then: Table) -> tuple[float, float] | str | int | None:
    value = then.raw("goto")
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, list):
        return position_of(value, then, "goto", "place")
    if isinstance(value, bool) or not isinstance(value, int):
        raise then.wrong("goto", "[latitude, longitude], 'home', 'next' or the number of a waypoint")
    return value


def program_lines(program: Sequence[ProgramRule]) -> list[str]:
    """The rules as lines of TOML, which :func:`read_program` reads back to the same numbers."""
    lines = []
    for rule in program:
        when = [f"{c.kind} = {_number(c)}" for c in rule.when]
        then = [f"{name} = {_action(rule, name)}" for name in rule.actions]
        # A pitch keeps every digit in radians.
        then = [text.replace("pitch = ", "pitch_rad = ", 1) if text.startswith("pitch") else text for text in then]
        lines += ["", "[[program]]"]
        lines += [f"name = {quote(rule.name)}"] if rule.name else []
        lines += [
            f"when = {{ {', '.join(when)} }}",
            f"then = {{ {', '.join(then)} }}",
            f"once = {bool_text(rule.once)}",
        ]
    return lines


def _number(condition: Condition) -> str:
    whole = PROGRAM_CONDITIONS[condition.kind][0] == "flying_to_waypoint"
    return str(int(condition.value)) if whole else repr(float(condition.value))


def _action(rule: ProgramRule, name: str) -> str:
    value = getattr(rule, name)
    if name == "goto":
        return pair_text(value) if isinstance(value, tuple) else quote(value) if isinstance(value, str) else str(value)
    return bool_text(value) if isinstance(value, bool) else repr(float(value))


def rule_text(rule: ProgramRule, number: int) -> str:
    """A rule in one line: its name, or its conditions and actions in words."""
    if rule.name:
        return f"rule {number} '{rule.name}'"
    when = " and ".join(_condition_words(c) for c in rule.when)
    return f"rule {number} '{when}: {', '.join(_action_words(rule, name) for name in rule.actions)}'"


def _condition_words(condition: Condition) -> str:
    quantity, unit, _ = PROGRAM_CONDITIONS[condition.kind]
    words = condition.kind.replace("_", " ")
    if quantity == "state_of_charge":
        return f"{words} {100 * condition.value:g} %"
    if quantity == "time":
        return f"{words} {datetime.fromtimestamp(condition.value, UTC):%Y-%m-%dT%H:%MZ}"
    if quantity == "flying_to_waypoint":
        return f"{words} {condition.value:g}"
    factor, name = _UNIT_WORDS[unit]
    return f"{words} {condition.value / factor:g} {name}"


def _action_words(rule: ProgramRule, name: str) -> str:
    value, words = getattr(rule, name), name.replace("_", " ")
    if name == "pitch":
        return f"pitch {math.degrees(value):g} degrees"
    if name == "surface_every":
        return f"surface every {value / 3600.0:g} h"
    if name == "goto":
        return f"go to {value[0]:g} {value[1]:g}" if isinstance(value, tuple) else f"go to {value}"
    return words if isinstance(value, bool) else f"{words} {value:g} m"
