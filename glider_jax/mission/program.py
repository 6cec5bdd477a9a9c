"""Mission programs in the compiled step: rules looked at before each step, and what they change in plan and state.

The kinds of conditions and actions are static (``Shape.program``), their numbers traced (``Plan.program``). A mission
without a program compiles to what it did before. Rules are looked at where a glider can: at the end of a yo (of a
bundle of short yos) and at the surface. Conventions a newcomer would get wrong: the charge left is compared through
the energy drawn, as a share of the energy at which the member's mission ends; distances to a waypoint are what the
glider believes, the current is its own estimate of the last dive; both mean the waypoint of the list, also while a
rule leads elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from glider_jax.config import PROGRAM_CONDITIONS
from glider_jax.mission.legs import TabulatedLegs
from glider_jax.mission.rules import CHARGE, REASON
from glider_jax.mission.state import Environment, Member, State
from glider_jax.mission.step import total_energy

#: Fields of the plan that rules change, the waypoints aside.
_FIELDS = (
    "dive_to", "climb_to", "altitude", "rule_seconds", "dive_pitch", "climb_pitch", "dive_tangent", "climb_tangent",
    "overtime",
)  # fmt: skip


class ProgramState(NamedTuple):
    """Where a member's program stands, one entry per rule: ``active``, ``first`` absolute s (NaN before), ``count``.

    ``leg`` of the mission's own list, ``away`` while a rule leads elsewhere.
    """

    active: tuple[Any, ...]
    first: tuple[Any, ...]
    count: tuple[Any, ...]
    leg: Any
    away: Any


def start_program(shape, dtype):
    """The program before anything was looked at; empty without rules."""
    if not shape.program:
        return ()
    number = len(shape.program)
    no, nan, none = jnp.asarray(False), jnp.asarray(jnp.nan, dtype), jnp.int32(0)
    return ProgramState((no,) * number, (nan,) * number, (none,) * number, none, no)


def programmed(plan, shape, member: Member, env: Environment, base, state: State):
    """Look at every rule and let those in force change the plan and the state of one member.

    Parameters
    ----------
    plan, shape : of the run.  base : s since t0 at the start of the interval.  state : before a step.

    Returns
    -------
    The member's plan, its state and its program's.
    """
    was: ProgramState = state.program
    now = base + state.time
    own = jnp.where(was.away, was.leg, state.leg)
    quantities = _quantities(plan, shape, member, env, base, state, own)
    active, rising, first, count = [], [], [], []
    for k, (kind, rule) in enumerate(zip(shape.program, plan.program, strict=True)):
        holds = jnp.asarray(True)
        for name, threshold in zip(kind.when, rule.thresholds, strict=True):
            holds = holds & _compare(name, quantities[PROGRAM_CONDITIONS[name][0]], threshold)
        begins = holds & ~was.active[k]
        active.append(was.active[k] | holds if kind.once else holds)
        rising.append(begins)
        first.append(jnp.where(begins & jnp.isnan(was.first[k]), now, was.first[k]))
        count.append(was.count[k] + begins.astype(jnp.int32))
    changed = _change_plan(plan, shape, active, state)
    away, target = jnp.asarray(False), plan.waypoints[0]
    comes_up = jnp.asarray(False)
    # The first rule that sets something wins, so the last is written first.
    for kind, rule, on, begins in reversed(list(zip(shape.program, plan.program, active, rising, strict=True))):
        if kind.goto == "place":
            away, target = away | on, jnp.where(on, rule.values["goto"], target)
        elif kind.goto == "waypoint":
            own = jnp.where(begins, rule.values["goto"], own)
        elif kind.goto == "next":
            last = 0 if shape.loop else shape.waypoints - 1
            own = jnp.where(begins, jnp.where(own + 1 >= shape.waypoints, last, own + 1), own)
        if "surface_now" in kind.actions:
            comes_up = comes_up | begins
        if "end_mission" in kind.actions:
            comes_up = comes_up | on
    # Led elsewhere, the glider has one waypoint, its last: reaching it ends the mission.
    changed = eqx.tree_at(lambda p: p.waypoints, changed, jnp.where(away, target, plan.waypoints))
    leg = jnp.where(away, shape.waypoints - 1, own)
    due = jnp.where(comes_up, jnp.minimum(state.due, state.time), state.due)
    why = shape.reasons.index(REASON)
    reason = jnp.where(comes_up & (due < state.due), why, state.reason)
    program = ProgramState(tuple(active), tuple(first), tuple(count), own, away)
    return changed, state._replace(leg=leg, due=due, reason=reason, program=program)


def _quantities(plan, shape, member, env, base, state, own) -> dict[str, Any]:
    """What the program's conditions compare, as far as any of them asks for it."""
    asked = {PROGRAM_CONDITIONS[name][0] for kind in shape.program for name in kind.when}
    found: dict[str, Any] = {}
    if asked & {CHARGE, "energy_used"}:
        spent = total_energy(member, state.sums)
        found |= {CHARGE: spent / member.energy_limit, "energy_used": spent}
    found |= {"elapsed": base + state.time, "time": base + state.time}
    if "bottom" in asked:
        found["bottom"] = env.bathymetry.depth(state.east, state.north)[0]
    found["current"] = jnp.sqrt(state.dac_east**2 + state.dac_north**2)
    if "waypoint_distance" in asked:
        sx, sy = env.frame.stretch(state.north)
        east = (plan.waypoints[own, 0] - state.dr_east) / sx
        north = (plan.waypoints[own, 1] - state.dr_north) / sy
        found["waypoint_distance"] = jnp.sqrt(east * east + north * north)
    found["flying_to_waypoint"] = own.astype(plan.dive_to.dtype)
    return found


def _compare(name: str, value, threshold):
    """Whether a condition holds; NaN, as outside the bathymetry, never does."""
    quantity, _, side = PROGRAM_CONDITIONS[name]
    if quantity == CHARGE:
        # Less charge is more energy drawn.
        side = -side
    if side == 0:
        return jnp.abs(value - threshold) < 0.5
    return value > threshold if side > 0 else value < threshold


def _change_plan(plan, shape, active, state):
    """The plan with the numbers of the rules in force; the first rule that sets one wins."""
    fields = {name: getattr(plan, name) for name in _FIELDS}
    changed = dict(fields)
    for kind, rule, on in reversed(list(zip(shape.program, plan.program, active, strict=True))):
        for name in ("dive_to", "climb_to", "altitude"):
            if name in kind.actions:
                changed[name] = jnp.where(on, rule.values[name], changed[name])
        if "pitch" in kind.actions:
            angle = rule.values["pitch"]
            for leg in ("dive", "climb"):
                changed[f"{leg}_pitch"] = jnp.where(on, angle, changed[f"{leg}_pitch"])
                changed[f"{leg}_tangent"] = jnp.where(on, jnp.tan(angle), changed[f"{leg}_tangent"])
        if "surface_every" in kind.actions:
            changed["rule_seconds"] = jnp.where(on, rule.values["surface_every"], changed["rule_seconds"])
        if "end_mission" in kind.actions:
            # Out of time at once: the next surfacing is the last, or the present stay.
            changed["overtime"] = jnp.where(on, -1.0, changed["overtime"])
    names = [name for name in fields if changed[name] is not fields[name]]
    if not names:
        return plan
    return eqx.tree_at(lambda p: [getattr(p, n) for n in names], plan, [changed[n] for n in names])


def with_program(step: Callable, shape) -> Callable:
    """The step, with the program looked at before it; the step itself where the mission has none."""
    if not shape.program:
        return step

    def advance(member, plan, shape, env, legs, clock, base, go, state):
        own_plan, before = programmed(plan, shape, member, env, base, state)
        program = before.program
        chosen = _choose_legs(legs, shape, program.active) if shape.speed == "flight" else legs
        # The step knows nothing of programs.
        after = step(member, own_plan, shape, env, chosen, clock, base, go, before._replace(program=()))
        # A place that is no waypoint of the mission leaves no arrival there.
        arrivals = tuple(
            jnp.where(program.away, old, new) for old, new in zip(state.arrivals, after.arrivals, strict=True)
        )
        if shape.loop:
            # A list that starts again never ends: the place reached does, at the next surfacing.
            there = program.away & (after.leg != before.leg)
            after = after._replace(done=after.done | there, due=jnp.where(there, after.time, after.due))
        own = jnp.where(program.away, program.leg, after.leg)
        after = after._replace(arrivals=arrivals, program=program._replace(leg=own))
        # A member that does not move has not looked either.
        return after._replace(
            **{
                name: jax.tree.map(lambda new, old: jnp.where(go, new, old), getattr(after, name), getattr(state, name))
                for name in ("leg", "due", "reason", "done", "arrivals", "program")
            }
        )

    return advance


def with_tables(flight_legs: Callable, shape) -> Callable:
    """The maker of flight tables, with more for every pitch of the program; itself where none changes the pitch."""
    if not shape.program:
        return flight_legs
    pitched = [k for k, kind in enumerate(shape.program) if "pitch" in kind.actions]

    def make(member, plan, column, elapsed, run=True):
        depths = [plan.dive_to, *(r.values["dive_to"] for r in plan.program if "dive_to" in r.values)]
        deepest = jnp.max(jnp.stack(depths))
        plan = eqx.tree_at(lambda p: p.dive_to, plan, deepest)
        tables = [flight_legs(member, plan, column, elapsed, run)]
        for k in pitched:
            angle = plan.program[k].values["pitch"]
            pitched_plan = eqx.tree_at(lambda p: [p.dive_pitch, p.climb_pitch], plan, [angle] * 2)
            tables.append(flight_legs(member, pitched_plan, column, elapsed, run))
        return tuple(tables)

    return make


def _choose_legs(legs, shape, active) -> TabulatedLegs:
    """The tables of the pitch in force."""
    pitched = [k for k, kind in enumerate(shape.program) if "pitch" in kind.actions]
    chosen = legs[0]
    for k, table in reversed(list(zip(pitched, legs[1:], strict=True))):
        chosen = jax.tree.map(partial(jnp.where, active[k]), table, chosen)
    return chosen
