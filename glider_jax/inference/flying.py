"""The compiled flight of a live scenario: the mission engine with every member's own start, water and first dive.

The engine steers, dives and drifts as in every forecast; added are the course of the current that a member was dealt
(a term of its model) and the state it starts from. The shapes depend on the mission's rules alone, so that hindcasts
compile once.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.mission import programs
from glider_jax.mission.ensemble import fly, initial_state
from glider_jax.mission.forecast import bring_home, draw_run
from glider_jax.mission.plan import Plan
from glider_jax.mission.step import next_due
from glider_jax.physics.model import FlightModel
from glider_jax.physics.term import AbstractTerm, Channel, Sample, TermInfo
from glider_jax.records import Track


class FeltCurrent(AbstractTerm):
    """The course of the current that one member flies through, linear between nodes; at the surface, shear on top."""

    east: Any
    north: Any
    shear_east: Any
    shear_north: Any
    step: Any
    info: ClassVar[TermInfo] = TermInfo(
        id="environment.felt_current",
        title="Current felt by the glider",
        channels=(
            Channel.CURRENT_EAST,
            Channel.CURRENT_NORTH,
            Channel.SURFACE_DRIFT_EAST,
            Channel.SURFACE_DRIFT_NORTH,
        ),
        equation=r"u(t)=\sum_k u_k\,\Lambda(t/\Delta-k)",
        reads=("time",),
        valid="one situation",
        reference="glider_jax.inference.currents",
        plain="The current the glider felt goes on as such currents do.",
    )

    def __call__(self, sample: Sample) -> tuple[Any, ...]:
        """East and north of the depth average, and of the surface beyond it, m/s."""
        place = jnp.clip(sample.time / self.step, 0.0, self.east.shape[0] - 1.001)
        low = jnp.floor(place).astype(jnp.int32)
        part = place - low.astype(place.dtype)
        return tuple(
            row[low] + part * (row[low + 1] - row[low])
            for row in (self.east, self.north, self.shear_east, self.shear_north)
        )


class FirstHeading(AbstractTerm):
    """What one member's direction is off by in its first dive, on top of what it is off by in all of them."""

    offset: Any
    until: Any
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.first_heading",
        title="Direction of the first dive",
        channels=(Channel.HEADING,),
        equation=r"\Delta\psi=\psi_1\,[t<T_1]",
        reads=("time",),
        valid="one situation",
        reference="glider_jax.inference.behaviour",
        plain="The next dive may point elsewhere; after it the glider knows where it is and aims anew.",
    )

    def __call__(self, sample: Sample) -> Any:
        """Heading, rad clockwise."""
        return jnp.where(sample.time < self.until, self.offset, jnp.zeros_like(self.offset))


class Start(NamedTuple):
    """Where and how each member begins; metres of the frame, m/s, s; ``duration`` NaN leaves the rules to decide."""

    east: Any
    north: Any
    speed: Any
    duration: Any
    by_waypoint: Any


def due_for(plan: Plan, speed, duration):
    """When the surfacing clock must run out for a dive to last ``duration`` s, at constant vertical speeds.

    A glider told to come up while it dives turns at once; one that climbs goes on to the surface. The time under
    water therefore grows with the clock, with rests, and has an inverse.
    """
    down, up = speed * plan.dive_tangent, speed * plan.climb_tangent
    deep, high = plan.dive_to, plan.climb_to
    first = deep / down + deep / up
    cycle = (deep - high) / down + (deep - high) / up
    number = jnp.ceil(jnp.maximum(duration - first, 0.0) / cycle)
    begins = jnp.where(number > 0, deep / down + (deep - high) / up + (number - 1.0) * cycle, 0.0)
    above = jnp.where(number > 0, high, 0.0)
    return begins + jnp.maximum(duration - begins - above / up, 1.0) / (1.0 + down / up)


def _begin(plan, shape, env, member, start: Start, aimed, waited):
    state = initial_state(plan, shape, env, member, start.east, start.north, 0.0, 0.0)
    zero = jnp.zeros_like(start.east)
    due, reason = next_due(plan, shape, zero, zero - waited, zero)
    told = jnp.isfinite(start.duration)
    own = due_for(plan, start.speed, jnp.where(told, start.duration, 3600.0))
    waypoint = jnp.int32(len(shape.reasons) - 3)
    return state._replace(
        dac_east=aimed[0] + zero,
        dac_north=aimed[1] + zero,
        segment_speed=start.speed,
        due=jnp.where(told, own, due),
        reason=jnp.where(told, jnp.where(start.by_waypoint, waypoint, jnp.int32(0)), reason),
    )


def _fly_from(shape, members, plan, env, start, aimed, waited):
    state = jax.vmap(lambda m, s: _begin(plan, shape, env, m, s, aimed, waited))(members, start)
    return fly(members, plan, shape, env, None, state)


def _with_terms(model: FlightModel, scenario, dtype) -> FlightModel:
    """Each member's model with its own current and first direction; ``model`` has a leading dimension of members."""
    n = scenario.duration.size
    step = np.full(n, scenario.times[1] - scenario.times[0], dtype)
    rows = [scenario.currents[:, 0], scenario.currents[:, 1], scenario.shear[:, 0], scenario.shear[:, 1]]
    water = FeltCurrent(*(np.ascontiguousarray(row, dtype) for row in rows), step)
    first = np.where(np.isfinite(scenario.duration), scenario.duration, scenario.usual) - 5.0
    turned = FirstHeading((scenario.heading - scenario.later).astype(dtype), first.astype(dtype))
    gates = np.concatenate([np.asarray(model.gates), np.ones((n, 2), dtype)], axis=1)
    return FlightModel(model.body, (*model.terms, water, turned), gates)


def fly_scenario(scenario) -> Track:
    """Fly the members of a scenario and bring them home as a ``Track``; the first surfacing is the next one."""
    run = scenario.run
    n = scenario.duration.size
    dtype = np.dtype(run.plan.interval.dtype)
    members, available = draw_run(run, 0, n)
    members = members._replace(
        model=_with_terms(members.model, scenario, dtype),
        heading=scenario.later.astype(dtype),
        turn=(np.cos(scenario.later).astype(dtype), np.sin(scenario.later).astype(dtype)),
    )
    numbers = (scenario.east, scenario.north, scenario.speed, scenario.duration)
    start = Start(*(np.asarray(v, dtype) for v in numbers), scenario.by_waypoint)
    aimed = np.array([scenario.aimed.real, scenario.aimed.imag], dtype)
    known = scenario.situation
    waited = known.time + known.departure - known.surfaced if np.isfinite(known.surfaced) else 0.0
    state, outputs = programs.call(
        "fly from", _fly_from, run.shape, tuple(jax.devices()[:1]),
        members, run.plan, run.environment, start, aimed, dtype.type(waited),
    )  # fmt: skip
    return bring_home(run, members, available, state, outputs)
