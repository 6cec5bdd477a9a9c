"""A mission's program in Slocum's terms: what behaviours can express, and what a person has to put in place.

Slocum compares distances, times and the charge with limits, but only to come up or to give up: no behaviour changes
depths, pitch or waypoints when a condition is met, and none knows the energy drawn, the water's depth as a threshold
or the current. Such rules become a folder with the argument files that a pilot, or a script of the dock server, puts
in place at a surfacing. Standard library only; nothing here sends files anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from glider_jax.config import Aborts, Mission, ProgramRule, SurfaceRule
from glider_jax.readers.mission_programs import rule_text


@dataclass
class Expressed:
    """A program as far as Slocum can say it: ``mission`` without a program, with rules and limits in its place.

    ``farther`` m are surfacings at more than a distance from the waypoint, with the sentence that explains each;
    ``said`` and ``left`` one sentence per rule; ``by_hand`` maps a folder to the mission whose argument files a person
    exchanges, and to the kinds of files.
    """

    mission: Mission
    said: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    farther: list[float] = field(default_factory=list)
    by_hand: dict[str, tuple[Mission, tuple[str, ...], str]] = field(default_factory=dict)


def express(mission: Mission) -> Expressed:
    """Sort the rules of a program into what Slocum's behaviours say and what they cannot."""
    out = Expressed(replace(mission, program=()))
    for number, rule in enumerate(mission.program, 1):
        words = f"program {rule_text(rule, number)}"
        reason = _by_behaviour(rule, out, words)
        if reason:
            out.left.append(f"{words}: {reason}{_exchange(mission, rule, number, out)}")
    return out


def _by_behaviour(rule: ProgramRule, out: Expressed, words: str) -> str:
    """Write a rule as a behaviour into ``out``, or say why there is none."""
    if set(rule.actions) - {"surface_now", "end_mission"}:
        changed = ", ".join(a for a in rule.actions if a not in ("surface_now", "end_mission"))
        return f"no behaviour sets {changed} when a condition is met"
    if len(rule.when) > 1:
        return "a behaviour has one condition, not several together"
    kind, value = rule.when[0].kind, rule.when[0].value
    start = out.mission.start
    if kind == "elapsed_above" and not rule.end_mission:
        if start is None:
            return "behaviours count from the last surfacing, or by the clock, and the mission's start is not given"
        kind, value = "time_after", start + value
    if rule.end_mission:
        return _as_limit(kind, value, out, words)
    again = "" if rule.once is False else "; it acts at every approach, not once"
    if kind == "waypoint_closer_than":
        out.mission = _with_rule(out.mission, SurfaceRule("waypoint_distance", distance=value))
        out.said.append(f"{words}: surface, start_when 7 at {value:g} m{again}")
    elif kind == "waypoint_farther_than":
        out.farther.append(value)
        out.said.append(f"{words}: surface, start_when 15 beyond {value:g} m; it acts as long as that holds, not once")
    elif kind == "time_after":
        out.mission = _with_rule(out.mission, SurfaceRule("utc", time=value))
        out.said.append(f"{words}: surface, start_when 13 at {_clock(value)}")
    else:
        return f"no behaviour comes up on {kind.replace('_', ' ')}"
    return ""


def _as_limit(kind: str, value: float, out: Expressed, words: str) -> str:
    """Write an end of the mission as a limit of abend, or as a surfacing that quits."""
    aborts, start = out.mission.aborts, out.mission.start
    if kind == "time_after":
        if start is None:
            out.mission = _with_rule(out.mission, SurfaceRule("utc", time=value, ends_mission=True))
            out.said.append(f"{words}: surface, start_when 13 at {_clock(value)}, end_action 0")
            return ""
        kind, value = "elapsed_above", value - start
    if kind == "state_of_charge_below":
        limit = max(value, aborts.remaining_charge or 0.0)
        out.mission = _with_limits(out.mission, remaining_charge=limit)
        out.said.append(
            f"{words}: abend, remaining_charge_min {100 * limit:g} %; the glider reckons with the capacity it was told"
        )
    elif kind == "elapsed_above":
        limit = min(value, aborts.overtime or value)
        out.mission = _with_limits(out.mission, overtime=limit)
        out.said.append(f"{words}: abend, overtime {limit:g} s")
    elif kind == "waypoint_farther_than":
        limit = min(value, aborts.maximum_waypoint_distance or value)
        out.mission = _with_limits(out.mission, maximum_waypoint_distance=limit)
        out.said.append(f"{words}: abend, max_wpt_distance {limit:g} m")
    elif kind == "waypoint_closer_than":
        out.mission = _with_rule(out.mission, SurfaceRule("waypoint_distance", distance=value, ends_mission=True))
        out.said.append(f"{words}: surface, start_when 7 at {value:g} m, end_action 0")
    else:
        return f"no behaviour ends a mission on {kind.replace('_', ' ')}"
    return ""


def _with_rule(mission: Mission, rule: SurfaceRule) -> Mission:
    return replace(mission, surface=(*mission.surface, rule))


def _with_limits(mission: Mission, **limits: float) -> Mission:
    aborts: Aborts = replace(mission.aborts, **limits)
    return replace(mission, aborts=aborts)


def _exchange(mission: Mission, rule: ProgramRule, number: int, out: Expressed) -> str:
    """The files that a person puts in place when the rule fires, and a sentence that names them."""
    changed, files = replace(mission, program=()), []
    if rule.goto == "home" and mission.start_position is None:
        return "; home is not known either, the mission gives no start_position"
    if rule.goto is not None:
        files.append("goto_list")
        if rule.goto == "next":
            return "; a pilot can set initial_wpt -1 in its goto_list, the waypoint after the last achieved"
        if isinstance(rule.goto, int):
            changed = replace(changed, first_waypoint=rule.goto - 1)
        else:
            place = mission.start_position if rule.goto == "home" else rule.goto
            changed = replace(changed, waypoints=(place,), first_waypoint=0, legs=-2)
    yo, pitch = changed.yo, rule.pitch
    fields = {"dive_to": rule.dive_to, "climb_to": rule.climb_to, "dive_altitude": rule.altitude}
    fields |= {"dive_pitch": pitch, "climb_pitch": pitch}
    given = {name: value for name, value in fields.items() if value is not None}
    if given:
        files.append("yo")
        changed = replace(changed, yo=replace(yo, **given))
    if rule.surface_every is not None:
        files.append("surface")
        rules = [replace(r, seconds=rule.surface_every) if r.kind in ("every", "after") else r for r in changed.surface]
        changed = replace(changed, surface=tuple(rules))
    if not files:
        return "; a pilot can do it at a surfacing"
    folder = f"rule{number}"
    out.by_hand[folder] = (changed, tuple(files), rule_text(rule, number))
    back = "" if rule.once else ", and the first ones back when it no longer holds"
    return f"; a pilot or a script puts the files of {folder} in place at a surfacing when its condition is met{back}"


def _clock(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%MZ}"
