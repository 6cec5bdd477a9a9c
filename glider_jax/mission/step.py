"""One mission step: a bundle of yos, or a stay at the surface, with analytic legs.

A pure function of (member, plan, environment, state); callers vmap it over members and put it under the scan over
output times. Events are met exactly: the seafloor, the surfacing clock and a waypoint cut a leg where they occur.
Conventions a newcomer would get wrong: ``time`` counts from the start of the present output interval (so that float32
keeps its precision over months), ``dr_*`` is where the glider believes it is, and it steers by that.

References
----------
Woithe and others (2010), section IV: speed, seafloor and current models of the mission simulator.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from glider_jax.environment.fields import fenced
from glider_jax.errors import Outcome
from glider_jax.mission.dive import Dive, plan_dive, sample_of
from glider_jax.mission.legs import ConstantLegs
from glider_jax.mission.plan import Plan, Shape
from glider_jax.mission.randoms import NOISE_STREAM, SPEED_STREAM, normals, uniform, words
from glider_jax.mission.state import Environment, Log, Member, State, Sums
from glider_jax.physics.term import Channel

_FAR = 1e9
#: Of an outcome's code.
_BITS = 8


def sample_speed(plan: Plan, key, segment):
    """Forward speed (m s-1) of one dive segment, a draw that depends on the member and the segment's number only."""
    place = uniform(words(key, segment, SPEED_STREAM)[0], plan.speeds.dtype) * (plan.speeds.shape[0] - 1)
    cell = jnp.clip(place.astype(jnp.int32), 0, plan.speeds.shape[0] - 2)
    low, high = plan.speeds[cell], plan.speeds[cell + 1]
    return low + (place - cell.astype(place.dtype)) * (high - low)


def step(member: Member, plan: Plan, shape: Shape, env: Environment, legs, clock, base, go, state: State) -> State:
    """Advance one member by one bundle of yos or one stay at the surface.

    Parameters
    ----------
    member, plan, shape, env : what is fixed during the run.
    legs : this member's legs when it flies by tables; None for constant speeds, which come with the state.
    clock : frame number of the currents at the start of the interval.
    base : s since t0 at the start of the interval.
    go : False returns the state as it is, for a member that has ended or is ahead of the others.
    state : where the mission stands.

    Returns
    -------
    The next state. Outside the fields, aground or not finite, nothing moves and ``outcome`` says why.
    """
    run = env.bathymetry.run
    if shape.speed == "constant":
        forward = state.segment_speed * member.speed
        legs = ConstantLegs(forward, forward * plan.dive_tangent, forward * plan.climb_tangent)
    sx, sy = env.frame.stretch(state.north)
    # Each stage is fenced: unfenced, XLA would repeat it in every one of the state's kernels.
    dive = fenced(run, lambda: plan_dive(member, plan, shape, env, legs, base, state, sx, sy))
    move = fenced(run, lambda: _move(member, plan, env, clock, base, state, dive, sx, sy))
    delta = fenced(run, lambda: _energies(member, plan, base, state, dive, move))
    sums = jax.tree.map(jnp.add, state.sums, delta)
    ok, outcome, end = _verdict(member, plan, shape, base, go, state, dive, move, sums, run)
    moved = _advance(member, plan, shape, base, state, dive, move, sums, delta)
    moved = jax.tree.map(lambda new, old: jnp.where(ok, new, old), moved, state)
    return moved._replace(outcome=outcome, end_time=end)


class _Move(NamedTuple):
    """Where a step leads, and the water it met: ``sd`` of the product and whether it is past the product's end."""

    duration: Any
    forward: Any
    east: Any
    north: Any
    current_east: Any
    current_north: Any
    error_east: Any
    error_north: Any
    over_ground: Any
    dry: Any
    late: Any


def _move(member, plan: Plan, env: Environment, clock, base, state: State, dive: Dive, sx, sy) -> _Move:
    """Carry the glider through the water and with it, by the midpoint rule."""
    dtype = plan.dive_to.dtype
    up = state.at_surface
    stay = plan.surface_stay * member.stay
    if member.model.has(Channel.SURFACE_INTERVAL):
        stay = stay + member.model.total(
            Channel.SURFACE_INTERVAL, sample_of(plan, member, base, state, surface_duration=stay)
        )
    duration = jnp.where(up, stay, dive.duration)
    forward = jnp.where(up, 0.0, dive.forward)
    # The current half way, at a place predicted with the current last felt.
    half = 0.5 * duration
    middle_east = state.east + (0.5 * forward * dive.te + state.current_east * half) * sx
    middle_north = state.north + (0.5 * forward * dive.tn + state.current_north * half) * sy
    upper = jnp.where(up, 0.0, jnp.minimum(state.depth, dive.top))
    lower = jnp.where(up, 0.5, dive.turn)
    water = env.currents.mean(clock, state.time + half, middle_east, middle_north, upper, lower)
    # One complex number leaves one kernel; two real ones would each repeat all rounds of the generator.

    def draw():
        return jax.lax.complex(*normals(*words(member.key, state.steps, NOISE_STREAM), dtype))

    pair = fenced(env.bathymetry.run, draw)
    noise = jnp.real(pair), jnp.imag(pair)
    path = jnp.sqrt(water[0] ** 2 + water[1] ** 2) * duration + forward
    memory = jnp.exp(-duration / plan.error_time - path / plan.error_length)
    kick = jnp.sqrt(jnp.maximum(1.0 - memory * memory, 0.0))
    error_east = memory * state.error_east + kick * noise[0]
    error_north = memory * state.error_north + kick * noise[1]
    ce = water[0] + 0.5 * water[2] * (state.error_east + error_east)
    cn = water[1] + 0.5 * water[2] * (state.error_north + error_north)
    ce, cn = _extra_currents(member, plan, base, state, up, duration, lower, water, ce, cn)
    de, dn = forward * dive.te + ce * duration, forward * dive.tn + cn * duration
    return _Move(
        duration=duration,
        forward=forward,
        east=state.east + de * sx,
        north=state.north + dn * sy,
        current_east=ce,
        current_north=cn,
        error_east=error_east,
        error_north=error_north,
        over_ground=jnp.sqrt(de * de + dn * dn),
        dry=jnp.isnan(water[0]),
        late=~env.currents.covers(clock, state.time),
    )


def _verdict(member, plan, shape, base, go, state: State, dive: Dive, move: _Move, sums: Sums, run):
    """Whether the step counts, the outcome after it, and the absolute time at which the member ended."""

    def judge():
        """What keeps the member from moving, FLYING if nothing does, and what it has become where it moves."""
        up = state.at_surface
        spent = total_energy(member, sums)
        surfaces, done = dive.surfaces & ~up, state.done | _finishes(shape, state, dive)
        outcome = jnp.where(surfaces & done, int(Outcome.ARRIVED), int(Outcome.FLYING))
        late = (base + state.time + move.duration > plan.overtime) & (outcome == int(Outcome.FLYING))
        outcome = jnp.where(late, int(Outcome.ABORTED), outcome)
        outcome = jnp.where(spent > member.energy_limit, member.limit_code, outcome)
        # A sum is finite where all its parts are.
        finite = jnp.isfinite(move.east + move.north + move.duration + spent)
        stuck = jnp.where(~finite, int(Outcome.INVALID), int(Outcome.FLYING))
        stuck = jnp.where(move.dry, int(Outcome.LEFT_CURRENTS_AREA), stuck)
        stuck = jnp.where(move.late, int(Outcome.LEFT_CURRENTS_TIME), stuck)
        stuck = jnp.where(~up & dive.aground, int(Outcome.AGROUND), stuck)
        stuck = jnp.where(~up & dive.no_bottom, int(Outcome.LEFT_BATHYMETRY), stuck)
        stuck = jnp.where(~up & ~dive.flies, int(Outcome.STALLED), stuck)
        # One number leaves the kernel; two would each repeat it.
        return (stuck << _BITS) + outcome

    both = fenced(run, judge)

    def after():
        stuck, outcome = both >> _BITS, both & ((1 << _BITS) - 1)
        fails = stuck != int(Outcome.FLYING)
        end = base + state.time + jnp.where(fails, 0.0, move.duration)
        outcome = jnp.where(fails, stuck, outcome)
        return go & ~fails, jnp.where(go, outcome, state.outcome), jnp.where(go, end, state.end_time)

    return fenced(run, after)


def _finishes(shape, state, dive):
    """Whether the step reaches the last waypoint of a list that does not start again."""
    if shape.loop:
        return jnp.zeros_like(dive.reached)
    return dive.reached & ~state.at_surface & (state.leg >= shape.waypoints - 1)


def _advance(member, plan, shape, base, state: State, dive: Dive, move: _Move, sums, delta) -> State:
    """The state after a step that counts."""
    up = state.at_surface
    sx_east, sy_north = move.east - state.east, move.north - state.north
    absolute = base + state.time
    time = state.time + move.duration
    end = base + time
    # The glider's belief: at the surface a fix replaces it, under water it adds what it thinks it flew.
    under = jnp.maximum(absolute - state.dive_clock, 60.0)
    fresh_east = plan.correction * state.dac_east + (state.east - state.dr_east) / dive.sx / under
    fresh_north = plan.correction * state.dac_north + (state.north - state.dr_north) / dive.sy / under
    told_east = dive.believed * dive.he + plan.correction * state.dac_east * move.duration
    told_north = dive.believed * dive.hn + plan.correction * state.dac_north * move.duration
    due, reason = next_due(plan, shape, base, state.time, time)
    surfaces, reached = dive.surfaces & ~up, dive.reached & ~up
    last = 0 if shape.loop else shape.waypoints - 1
    following = jnp.where(state.leg + 1 >= shape.waypoints, last, state.leg + 1)
    arrived = base + state.time + dive.reach_time
    arrivals = tuple(
        jnp.where(reached & (state.leg == k) & jnp.isnan(old), arrived, old) for k, old in enumerate(state.arrivals)
    )
    speed = state.segment_speed
    if shape.speed == "constant":
        speed = jnp.where(up, sample_speed(plan, member.key, state.sums.surfacings.astype(jnp.int32)), speed)
    here = Log(end, move.east, move.north, dive.reason)

    def entry(flag, new, old):
        return jax.tree.map(lambda a, b: jnp.where(flag, a, b), new, old)

    return State(
        time=time,
        east=move.east,
        north=move.north,
        dr_east=jnp.where(up, move.east, state.dr_east + told_east * dive.sx),
        dr_north=jnp.where(up, move.north, state.dr_north + told_north * dive.sy),
        dac_east=jnp.where(up, fresh_east, state.dac_east),
        dac_north=jnp.where(up, fresh_north, state.dac_north),
        depth=jnp.where(up, 0.0, dive.top),
        turn=jnp.where(up | surfaces, state.turn, dive.turn),
        at_surface=surfaces,
        due=jnp.where(up, due, state.due),
        reason=jnp.where(up, reason, state.reason),
        dive_clock=jnp.where(up, end, state.dive_clock),
        leg=jnp.where(reached, following, state.leg),
        done=state.done | _finishes(shape, state, dive),
        segment_speed=speed,
        segment_yos=jnp.where(up, 0.0, state.segment_yos + dive.yos),
        error_east=move.error_east,
        error_north=move.error_north,
        current_east=move.current_east,
        current_north=move.current_north,
        sums=sums,
        delta=delta,
        last_time=move.duration,
        last_east=sx_east,
        last_north=sy_north,
        last_turn=jnp.where(up, 0.0, dive.turn),
        last_top=dive.top,
        last_dive=dive.dive_time / dive.yos,
        last_climb=dive.climb_time / dive.yos,
        last_up=up,
        contacts=state.contacts + jnp.where(dive.contact & ~up, dive.yos, 0.0),
        outcome=state.outcome,
        end_time=state.end_time,
        steps=state.steps + 1,
        arrivals=arrivals,
        surfaced=entry(surfaces, here, state.surfaced),
        surfaced_before=entry(surfaces, state.surfaced, state.surfaced_before),
        left=entry(up, here, state.left),
        left_before=entry(up, state.left, state.left_before),
    )


def _extra_currents(member, plan, base, state, up, duration, lower, water, ce, cn):
    """Add the currents and drifts that terms of the library bring, where the model has any."""
    model = member.model
    moving = [c for c in (Channel.CURRENT_EAST, Channel.CURRENT_NORTH) if model.has(c)]
    drifting = [c for c in (Channel.SURFACE_DRIFT_EAST, Channel.SURFACE_DRIFT_NORTH) if model.has(c)]
    if not moving and not drifting:
        return ce, cn
    middle = sample_of(
        plan,
        member,
        base,
        state._replace(time=state.time + 0.5 * duration),
        depth=0.5 * lower,
        east=state.east,
        north=state.north,
        surface_current_east=water[0],
        surface_current_north=water[1],
        surface_duration=jnp.where(up, duration, 0.0),
        direction=jnp.where(up, 0.0, -1.0),
    )
    zero = jnp.zeros_like(ce)
    extra = {c: model.total(c, middle) for c in moving + drifting}
    ce = ce + extra.get(Channel.CURRENT_EAST, zero)
    cn = cn + extra.get(Channel.CURRENT_NORTH, zero)
    ce = ce + jnp.where(up, extra.get(Channel.SURFACE_DRIFT_EAST, zero), 0.0)
    return ce, cn + jnp.where(up, extra.get(Channel.SURFACE_DRIFT_NORTH, zero), 0.0)


def _energies(member, plan, base, state, dive: Dive, move) -> Sums:
    """What a step draws, by component; devices are counted by time and event and priced by ``total_energy``."""
    model, up, duration = member.model, state.at_surface, move.duration
    zero = jnp.zeros_like(duration)
    half = state._replace(time=state.time + 0.5 * duration)
    deep = sample_of(plan, member, base, half, depth=dive.turn, inflection_depth=dive.turn, direction=1.0)
    # The first dive of a segment starts at the surface; all others at the ceiling of the yo.
    upper = jnp.where(up, 0.0, state.depth)
    high = sample_of(plan, member, base, half, depth=upper, inflection_depth=upper, direction=-1.0)
    pump, brake_deep = model.stroke_energy(deep)
    retract, brake_high = model.retract_energy(high)
    hotel_down = model.hotel_power(sample_of(plan, member, base, half, depth=0.5 * dive.turn, direction=-1.0))
    hotel_up = model.hotel_power(sample_of(plan, member, base, half, depth=0.5 * dive.turn, direction=1.0))
    resting = sample_of(plan, member, base, half, direction=0.0, surface_duration=duration)
    surface = (model.hotel_power(resting) + model.surface_power(resting)) * duration
    if model.has(Channel.SURFACING_ENERGY):
        surface = surface + model.surfacing_energy(resting)
    yos = jnp.where(up, 0.0, dive.yos)
    down, climb = jnp.where(up, 0.0, dive.dive_time), jnp.where(up, 0.0, dive.climb_time)
    return Sums(
        pump=yos * pump,
        retract=yos * retract,
        brake=yos * (brake_deep + brake_high),
        hotel=jnp.where(up, surface, hotel_down * down + hotel_up * climb),
        dive_time=down,
        climb_time=climb,
        surface_time=jnp.where(up, duration, 0.0),
        inflections=2.0 * yos,
        surfacings=jnp.where(dive.surfaces & ~up, 1.0, zero),
        through_water=move.forward,
        over_ground=move.over_ground,
    )


def total_energy(member: Member, sums: Sums):
    """J drawn since the start: motors and hotel as summed, devices by their times and counts."""
    devices = (
        member.power[0] * sums.dive_time
        + member.power[1] * sums.climb_time
        + member.power[2] * sums.surface_time
        + member.per_surfacing * sums.surfacings
        + member.per_inflection * sums.inflections
    )
    return sums.pump + sums.retract + sums.brake + sums.hotel + devices


def next_due(plan, shape, base, surfaced, leaves):
    """When the surfacing clock next runs out (s of this interval) and which rule of the mission it is."""
    best, reason = jnp.full_like(leaves, _FAR), jnp.zeros_like(leaves, jnp.int32)
    for k, kind in enumerate(shape.rules):
        seconds = plan.rule_seconds[k]
        if kind == "every":
            due = surfaced + seconds
            # A surfacing that outlasts its own period starts the next one at once, not in the past.
            due = jnp.maximum(due, leaves + 60.0)
        elif kind == "utc":
            ahead = plan.rule_time[k] - (base + leaves)
            period = jnp.maximum(seconds, 1.0)
            late = jnp.where(seconds > 0, jnp.ceil(jnp.maximum(-ahead, 0.0) / period) * period, _FAR)
            due = leaves + jnp.where(ahead > 0, ahead, ahead + late)
        else:
            due = leaves + seconds
        reason = jnp.where(due < best, k, reason)
        best = jnp.minimum(best, due)
    return best, reason
