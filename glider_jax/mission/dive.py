"""The underwater half of a mission step, before anything moves: how many yos, how deep, how far, which way.

Events are met exactly: the seafloor, the surfacing clock and a waypoint cut a leg where they occur. The glider steers
by where it believes it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from glider_jax.mission.legs import ConstantLegs
from glider_jax.mission.plan import Plan, Shape
from glider_jax.mission.state import Environment, State
from glider_jax.physics.term import Channel, Sample

_FAR = 1e9
_FEW = 12


def sample_of(plan, member, base, state, **fields):
    """A physics sample at this moment, in the run's dtype, completed with the vehicle's constants."""
    dtype = plan.dive_to.dtype
    time = base + state.time
    common = dict(
        time=time,
        elapsed=time,
        temperature=plan.temperature,
        battery_temperature=plan.temperature,
        latitude=plan.latitude,
        gravity=plan.gravity,
        sea_pressure=fields.get("depth", 0.0) * (plan.gravity * plan.density),
        density=plan.density,
        time_since_surfacing=jnp.maximum(time - state.dive_clock, 0.0),
        stroke_volume=plan.climb_volume - plan.dive_volume,
        inflections=state.sums.inflections,
    )
    return Sample.of(dtype, **(common | fields))


def waypoint(plan, leg):
    """East and north (frame metres) of the waypoint with a number."""
    points = plan.waypoints
    if points.shape[0] > _FEW:
        return points[leg, 0], points[leg, 1]
    # A few choices are faster than a look-up, which is made one member at a time.
    east, north = points[0, 0], points[0, 1]
    for k in range(1, points.shape[0]):
        east, north = jnp.where(leg == k, points[k, 0], east), jnp.where(leg == k, points[k, 1], north)
    return east, north


def _steer(plan, east, north, speed, dac_east, dac_north):
    """Unit vector to hold through the water and the speed made good toward a point (east, north) m away."""
    distance = jnp.sqrt(east * east + north * north)
    safe = jnp.maximum(distance, 1e-3)
    de, dn = east / safe, north / safe
    along = plan.correction * (dac_east * de + dac_north * dn)
    across = plan.correction * (dac_north * de - dac_east * dn)
    sine = jnp.clip(-across / speed, -0.95, 0.95)
    cosine = jnp.sqrt(1.0 - sine * sine)
    return de * cosine - dn * sine, dn * cosine + de * sine, cosine * speed + along, distance


def _turned(member, plan, base, state, he, hn):
    """The true direction of travel for a believed one: compass and other heading errors are added, clockwise."""
    c, s = member.turn
    if member.model.has(Channel.HEADING):
        angle = member.heading + member.model.total(
            Channel.HEADING, sample_of(plan, member, base, state, heading=jnp.arctan2(he, hn))
        )
        c, s = jnp.cos(angle), jnp.sin(angle)
    return he * c + hn * s, hn * c - he * s


def _until_slot(plan, time):
    """Seconds to the slot that a step should end with: half a slot to one and a half; slots divide the interval."""
    slots = jnp.round(plan.interval / plan.bundle)
    slot = jnp.where(slots > 0, plan.interval / jnp.maximum(slots, 1.0), plan.bundle)
    return slot * (jnp.floor(time / slot + 0.5) + 1.0) - time


class Dive(NamedTuple):
    """The underwater half of a step, before it moves anything."""

    duration: Any
    dive_time: Any
    climb_time: Any
    forward: Any
    believed: Any
    turn: Any
    top: Any
    yos: Any
    surfaces: Any
    reason: Any
    he: Any
    hn: Any
    te: Any
    tn: Any
    reached: Any
    reach_time: Any
    contact: Any
    aground: Any
    no_bottom: Any
    flies: Any
    sx: Any
    sy: Any


def plan_dive(member, plan: Plan, shape: Shape, env: Environment, legs, base, state: State, sx, sy) -> Dive:
    """Work out how many yos fit, where they turn, whether one is cut short, and where the glider points."""
    down0 = legs.cumulative(jnp.maximum(state.turn, state.depth + plan.minimum_yo))
    zp = jnp.maximum(state.turn, state.depth + plan.minimum_yo)
    w_down = zp / down0.dive_time
    w_up = zp / down0.climb_time
    top = jnp.maximum(plan.climb_to - w_up * plan.overshoot_time, 0.3 * plan.climb_to)
    start, ceiling = legs.cumulative(state.depth), legs.cumulative(top)
    first = down0.dive_time - start.dive_time
    cycle = (down0.dive_time - ceiling.dive_time) + (down0.climb_time - ceiling.climb_time)
    mean_speed = (down0.dive_distance + down0.climb_distance - ceiling.dive_distance - ceiling.climb_distance) / cycle
    believed_ratio = _believed(plan, legs, zp, top, cycle) / mean_speed

    # Where the glider believes the waypoint is, and how soon it would get there.
    next_east, next_north = waypoint(plan, state.leg)
    to_east = (next_east - state.dr_east) / sx
    to_north = (next_north - state.dr_north) / sy
    he1, hn1, good1, distance = _steer(
        plan, to_east, to_north, mean_speed * believed_ratio, state.dac_east, state.dac_north
    )
    arrival = jnp.where(good1 > 1e-3, jnp.maximum(distance - plan.radius, 0.0) / jnp.maximum(good1, 1e-3), _FAR)
    last_leg = jnp.asarray(False) if shape.loop else state.leg >= shape.waypoints - 1
    stops = last_leg | jnp.asarray(shape.waypoint_surfaces)

    remaining, reason = state.due - state.time, state.reason
    count = len(shape.reasons)
    comes_up = stops & (arrival < remaining)
    remaining = jnp.where(comes_up, arrival, remaining)
    reason = jnp.where(comes_up, jnp.where(last_leg, count - 1, count - 3), reason)
    yo_left = plan.yo_limit - state.segment_yos
    # As many as end nearest to the next slot of time, so that members reach an output time in as many steps.
    fit = jnp.floor((remaining - first - cycle) / cycle)
    yos = jnp.clip(jnp.minimum(jnp.round(_until_slot(plan, state.time) / cycle), fit), 1.0, 64.0)
    if shape.bounded_yos:
        yos = jnp.clip(yos, 1.0, jnp.maximum(yo_left, 1.0))

    te1, tn1 = _turned(member, plan, base, state, he1, hn1)
    # The seafloor at the mean place of the turns, corrected along its slope for the time a deeper turn takes.
    ratio = 1.0 / w_down + 0.5 * (yos - 1.0) * (1.0 / w_down + 1.0 / w_up)
    # A turn is commanded before it is made: the seafloor that counts lies where the overshoot begins.
    tau = first + 0.5 * (yos - 1.0) * cycle - plan.overshoot_time
    ve = (mean_speed * te1 + state.current_east) * sx
    vn = (mean_speed * tn1 + state.current_north) * sy
    depth, deepening = env.bathymetry.ahead(state.east + ve * tau, state.north + vn * tau, ve, vn)
    if member.model.has(Channel.WATER_DEPTH):
        here = sample_of(plan, member, base, state, bottom_depth=depth)
        depth = depth + member.model.total(Channel.WATER_DEPTH, here)
    slope = jnp.clip(deepening * ratio, -0.5, 0.5)
    clearance = depth - plan.altitude
    over = w_down * plan.overshoot_time
    wanted = jnp.minimum((clearance + slope * (over - zp)) / (1.0 - slope), plan.dive_to)
    turn = wanted + over
    if member.model.has(Channel.TURN_DEPTH):
        turn = turn + member.model.total(
            Channel.TURN_DEPTH, sample_of(plan, member, base, state, depth=wanted, depth_rate=w_down, direction=-1.0)
        )
    floor = jnp.maximum(state.depth, top) + plan.minimum_yo
    turn = jnp.maximum(turn, floor)
    limit = depth - 0.5
    contact = turn > limit
    turn = jnp.minimum(turn, limit)
    aground = (depth < plan.minimum_depth) | (turn < top + 0.5)

    reach = legs.depth_after(state.depth, remaining) + over
    # Written out: a reduction over so few numbers costs more than the rest of the step.
    breaks = jnp.asarray(True)
    for k in range(count):
        breaks = jnp.where(reason == k, plan.interrupts[k] > 0.5, breaks)
    cut = (yos < 1.5) & (reach < turn) & breaks
    turn = jnp.where(cut, jnp.maximum(reach, state.depth + 0.5 * plan.minimum_yo), turn)
    turn = jnp.where(aground | jnp.isnan(turn), floor, turn)

    low = legs.cumulative(turn)
    first_time = low.dive_time - start.dive_time
    up_time = low.climb_time - ceiling.climb_time
    one_time = (low.dive_time - ceiling.dive_time) + up_time
    # A rule that waits for the yo brings up only the first climb that begins after its time.
    surfaces = (yos < 1.5) & (remaining <= first_time + jnp.where(breaks, up_time, 0.0))
    if shape.bounded_yos:
        finished = yos >= yo_left - 0.25
        reason = jnp.where(finished & ~surfaces, count - 2, reason)
        # The last yo of a counted segment runs on to the surface, whatever number is bundled before it.
        surfaces = surfaces | finished
    rise = jnp.where(surfaces, ceiling.climb_time, 0.0)
    climb_time = yos * up_time + rise
    dive_time = first_time + (yos - 1.0) * (one_time - up_time)
    duration = dive_time + climb_time
    forward = (
        (low.dive_distance - start.dive_distance)
        + (yos - 1.0) * (low.dive_distance - ceiling.dive_distance)
        + yos * (low.climb_distance - ceiling.climb_distance)
        + jnp.where(surfaces, ceiling.climb_distance, 0.0)
    )
    believed = forward * believed_ratio

    # A waypoint reached on the way splits the step between two headings.
    reached = arrival < duration
    share = jnp.where(reached & ~comes_up, arrival / duration, 1.0)
    following = jnp.where(state.leg + 1 >= shape.waypoints, 0, state.leg + 1)
    from_east = state.dr_east + (believed / duration * he1 + plan.correction * state.dac_east) * arrival * sx
    from_north = state.dr_north + (believed / duration * hn1 + plan.correction * state.dac_north) * arrival * sy
    after_east, after_north = waypoint(plan, following)
    he2, hn2, _, _ = _steer(
        plan,
        (after_east - from_east) / sx,
        (after_north - from_north) / sy,
        mean_speed * believed_ratio,
        state.dac_east,
        state.dac_north,
    )
    he = share * he1 + (1.0 - share) * he2
    hn = share * hn1 + (1.0 - share) * hn2
    te2, tn2 = _turned(member, plan, base, state, he2, hn2)
    return Dive(
        duration=duration,
        dive_time=dive_time,
        climb_time=climb_time,
        forward=forward,
        believed=believed,
        turn=turn,
        top=jnp.where(surfaces, 0.0, top),
        yos=yos,
        surfaces=surfaces,
        reason=reason,
        he=he,
        hn=hn,
        te=share * te1 + (1.0 - share) * te2,
        tn=share * tn1 + (1.0 - share) * tn2,
        reached=reached,
        reach_time=jnp.where(comes_up, duration, arrival),
        contact=contact,
        aground=aground,
        no_bottom=jnp.isnan(depth),
        flies=legs.valid(),
        sx=sx,
        sy=sy,
    )


def _believed(plan, legs, deep, shallow, cycle):
    """The forward speed the vehicle's own dead reckoning assumes: depth rate over the tangent of the pitch."""
    if isinstance(legs, ConstantLegs):
        return legs.forward
    path = deep - shallow
    return (path / plan.dive_tangent + path / plan.climb_tangent) / cycle
