"""The ensemble: members drawn, flown under one compiled scan, and brought back to the host as a ``Track``.

Scan over output times, loop over mission steps within each until every member has passed it, vmap over members,
``shard_map`` over host devices, chunks on the host for memory. A member depends on the seed and its own number
only, so the result does not depend on chunks or devices.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, PartitionSpec

from glider_jax.config import Vehicle
from glider_jax.errors import ConfigError, Outcome
from glider_jax.mission import programs
from glider_jax.mission.legs import TabulatedLegs, tabulate
from glider_jax.mission.plan import Plan, Shape
from glider_jax.mission.program import start_program, with_program, with_tables
from glider_jax.mission.randoms import START_STREAM, normals, words
from glider_jax.mission.state import Environment, Log, Member, State, Sums
from glider_jax.mission.step import next_due, sample_speed, step
from glider_jax.physics.model import draw_batch
from glider_jax.physics.perturb import log_normal, purpose
from glider_jax.physics.term import Sample


class Column(NamedTuple):
    """The water column the flight tables are made for: values at layer middles, SI."""

    depth: Any
    sea_pressure: Any
    temperature: Any
    density: Any
    step: Any


class Output(NamedTuple):
    """What is kept of every member at an output time; frame metres, s, J."""

    east: Any
    north: Any
    depth: Any
    phase: Any
    active: Any
    current_east: Any
    current_north: Any
    sums: Sums
    surfaced: Log
    surfaced_before: Log
    left: Log
    left_before: Log


def host_normals(seed: int, first: int, count: int):
    """A function of a name: (count,) standard normal numbers of the members numbered from ``first``.

    Philox counts by member under a key of seed and name, so a member's numbers depend on nothing else.
    """

    def normal(name: str) -> np.ndarray:
        """By Box and Muller: NumPy alone has all it takes."""
        first_word, second_word = (word >> np.uint64(11) for word in _raw(seed, first, count, name))
        radius = np.sqrt(-2.0 * np.log((first_word.astype(float) + 0.5) * 2.0**-53))
        return radius * np.cos(2.0 * np.pi * 2.0**-53 * second_word.astype(float))

    return normal


def _raw(seed, first, count, name):
    """Two 64-bit words for each member: one counter of four words is one member's."""
    stream = np.random.Philox(key=np.array([seed % 2**64, purpose(name)], np.uint64))
    stream.advance(first)
    words = stream.random_raw(4 * count).reshape(count, 4)
    return words[:, 0], words[:, 1]


def draw_members(model, vehicle: Vehicle, devices, spread: float, seed: int, first: int, count: int, dtype) -> Member:
    """Draw every member's physics and errors from the vehicle's uncertainties, on the host; limits are set later.

    ``devices`` has ``power`` (groups, 3), ``joules_per_surfacing`` and ``joules_per_inflection`` (groups,).
    ``spread`` scales every perturbation; 0 gives identical members.
    """
    normal = host_normals(seed, first, count)

    def factor(name):
        return log_normal(np.ones(()), spread * vehicle.value(name), normal(name), np).astype(dtype)

    def same(value, kind=dtype):
        return np.full(count, value, kind)

    heading = spread * vehicle.value("perturbation.heading") * normal("perturbation.heading")
    word = _raw(seed, first, count, "steps")[0]
    return Member(
        key=((word >> np.uint64(32)).astype(np.uint32), (word & np.uint64(0xFFFFFFFF)).astype(np.uint32)),
        model=draw_batch(model, vehicle, normal, count, spread),
        heading=heading.astype(dtype),
        turn=(np.cos(heading).astype(dtype), np.sin(heading).astype(dtype)),
        stay=factor("perturbation.surface_stay"),
        speed=factor("perturbation.speed"),
        power=tuple(same(watts) for watts in np.sum(np.asarray(devices.power, float), axis=0)),
        per_surfacing=same(np.sum(np.asarray(devices.joules_per_surfacing, float))),
        per_inflection=same(np.sum(np.asarray(devices.joules_per_inflection, float))),
        energy_limit=same(np.inf),
        limit_code=same(int(Outcome.BATTERY_EMPTY), np.int32),
    )


def initial_state(plan: Plan, shape: Shape, env: Environment, member: Member, east, north, spread: float, sd: float):
    """A mission about to dive at the start of the forecast; the first position carries the fix's error."""
    dtype = plan.dive_to.dtype
    zero = jnp.zeros((), dtype)
    off = [spread * sd * number for number in normals(*words(member.key, jnp.int32(0), START_STREAM), dtype)]
    sx, sy = env.frame.stretch(north)
    x, y = east + off[0] * sx, north + off[1] * sy
    here, _, _ = env.bathymetry.depth(x, y)
    turn = jnp.clip(jnp.where(jnp.isnan(here), plan.dive_to, here - plan.altitude), plan.minimum_yo, plan.dive_to)
    due, reason = next_due(plan, shape, zero, zero, zero)
    errors = normals(*words(member.key, jnp.int32(1), START_STREAM), dtype)
    sums = Sums(*(zero for _ in Sums._fields))
    nan = jnp.asarray(jnp.nan, dtype)
    none = Log(nan, nan, nan, jnp.int32(-1))
    speed = sample_speed(plan, member.key, jnp.int32(0)) if shape.speed == "constant" else zero
    return State(
        time=zero, east=x, north=y, dr_east=x, dr_north=y, dac_east=zero, dac_north=zero, depth=zero,
        turn=turn, at_surface=jnp.asarray(False), due=due, reason=reason, dive_clock=zero,
        leg=jnp.int32(0), done=jnp.asarray(False), segment_speed=speed, segment_yos=zero,
        error_east=errors[0], error_north=errors[1], current_east=zero, current_north=zero, sums=sums, delta=sums,
        last_time=jnp.ones_like(zero), last_east=zero, last_north=zero, last_turn=zero, last_top=zero,
        last_dive=jnp.ones_like(zero), last_climb=jnp.ones_like(zero), last_up=jnp.asarray(True), contacts=zero,
        outcome=jnp.int32(int(Outcome.FLYING)), end_time=nan, steps=jnp.int32(0),
        arrivals=(nan,) * shape.waypoints, surfaced=none, surfaced_before=none, left=none, left_before=none,
        program=start_program(shape, dtype),
    )  # fmt: skip


def flight_legs(member: Member, plan: Plan, column: Column, elapsed, run=True) -> TabulatedLegs:
    """Legs of a member's steady glide through the water column, with its physics as it is at ``elapsed`` s.

    ``run`` is true, and best unknown to the compiler; see :func:`~glider_jax.environment.fields.fenced`.
    """

    def glide(direction, pitch, volume, depth, pressure, temperature, density):
        sample = Sample.of(
            depth.dtype,
            time=elapsed, elapsed=elapsed, depth=depth, sea_pressure=pressure, temperature=temperature,
            density=density, pitch=direction * pitch, direction=direction, buoyancy_volume=volume,
        )  # fmt: skip
        g = member.model.steady_glide(sample)
        vertical = direction * -g.depth_rate
        good = g.valid & (vertical > 0.01)
        return jnp.where(good, vertical, 0.01), jnp.where(good, g.horizontal_speed * member.speed, 0.0), good

    levels = jax.vmap(glide, in_axes=(None, None, None, 0, 0, 0, 0))
    water = (column.depth, column.sea_pressure, column.temperature, column.density)
    down, ahead_down, good_down = levels(-1.0, plan.dive_pitch, plan.dive_volume, *water)
    up, ahead_up, good_up = levels(1.0, plan.climb_pitch, plan.climb_volume, *water)
    needed = column.depth <= plan.dive_to
    flies = jnp.all((good_down & good_up) | ~needed)
    return tabulate(1.0 / down, ahead_down, 1.0 / up, ahead_up, column.step, flies, run)


def _output(state: State, interval, base) -> Output:
    """The state at an output time that lies within the step just made, by linear interpolation."""
    back = jnp.maximum(state.time - interval, 0.0)
    share = jnp.clip(back / state.last_time, 0.0, 1.0)
    # Depth follows the saw-tooth backwards from the end of the step.
    rest = jnp.where(back < state.last_climb, back, jnp.mod(back, state.last_dive + state.last_climb))
    rising = rest < state.last_climb
    climbed = state.last_top + (state.last_turn - state.last_top) * rest / jnp.maximum(state.last_climb, 1.0)
    dived = (rest - state.last_climb) / jnp.maximum(state.last_dive, 1.0)
    fallen = state.last_turn - (state.last_turn - state.last_top) * dived
    depth = jnp.where(state.last_up, 0.0, jnp.maximum(jnp.where(rising, climbed, fallen), 0.0))
    flying = (state.outcome == int(Outcome.FLYING)) | (state.end_time > base + interval)
    phase = jnp.where(state.last_up | ~flying, 3, jnp.where(rising, 1, 2)).astype(jnp.int8)
    return Output(
        east=state.east - share * state.last_east,
        north=state.north - share * state.last_north,
        depth=jnp.where(flying, depth, 0.0),
        phase=phase,
        active=flying,
        current_east=state.current_east,
        current_north=state.current_north,
        sums=jax.tree.map(lambda total, last: total - share * last, state.sums, state.delta),
        surfaced=state.surfaced,
        surfaced_before=state.surfaced_before,
        left=state.left,
        left_before=state.left_before,
    )


def fly(members: Member, plan: Plan, shape: Shape, env: Environment, column: Column | None, state: State):
    """Fly all members through all output times; traced.

    Returns
    -------
    The final state and the outputs with leading dimensions (output time, member).
    """
    interval = plan.interval
    dtype = interval.dtype
    advance, make_legs = with_program(step, shape), with_tables(flight_legs, shape)

    def block(state, b):
        start = (b * shape.intervals).astype(dtype) * interval
        legs = None
        if shape.speed == "flight":
            legs = jax.vmap(lambda m: make_legs(m, plan, column, start, env.bathymetry.run))(members)

        def until(state, k):
            index = b * shape.intervals + k
            base = index.astype(dtype) * interval
            clock = env.currents.clock(jnp.zeros((), dtype), interval, index)
            one = jax.vmap(lambda m, g, go, s: advance(m, plan, shape, env, g, clock, base, go, s))

            def pending(state):
                # The last block may hold more intervals than the forecast: nothing flies in those.
                wanted = index < plan.intervals
                return (state.outcome == int(Outcome.FLYING)) & (state.time < interval) & wanted

            state = jax.lax.while_loop(
                lambda s: jnp.any(pending(s)), lambda s: one(members, legs, pending(s), s), state
            )
            out = _output(state, interval, base)
            return state._replace(time=state.time - interval, due=state.due - interval), out

        return jax.lax.scan(until, state, jnp.arange(shape.intervals, dtype=jnp.int32))

    state, outputs = jax.lax.scan(block, state, jnp.arange(shape.blocks, dtype=jnp.int32))
    return state, jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), outputs)


def _fly_all(static, members, plan, env, column, east, north, spread, sd):
    """Start and fly all members, split between the devices of the mesh; traced."""
    shape, mesh = static

    def run(members, plan, env, column, east, north, spread, sd):
        start = jax.vmap(lambda m: initial_state(plan, shape, env, m, east, north, spread, sd))(members)
        return fly(members, plan, shape, env, column, start)

    if mesh is None:
        return run(members, plan, env, column, east, north, spread, sd)
    rows, everywhere = PartitionSpec("members"), PartitionSpec()
    sharded = jax.shard_map(
        run,
        mesh=mesh,
        in_specs=(rows, *(everywhere for _ in range(7))),
        out_specs=(rows, PartitionSpec(None, "members")),
        check_vma=False,
    )
    return sharded(members, plan, env, column, east, north, spread, sd)


def run_members(members, plan, shape, env, column, east, north, *, spread=1.0, fix_sd=10.0, devices=None):
    """Run a batch of members on the given devices (by default all, those of other processes of the run too).

    The size is padded to fit. With several processes every one must call it, with the same arguments.
    """
    devices = jax.devices() if devices is None else devices
    count = members.heading.shape[0]
    if count < 1:
        raise ConfigError(f"ensemble: expected at least 1 member, found {count}.")
    several = jax.process_count() > 1
    use = devices if several or count >= 2 * len(devices) else devices[:1]
    pad = -count % len(use)
    if pad:
        members = jax.tree.map(lambda a: np.concatenate([a, np.resize(a, (pad, *a.shape[1:]))]), members)
    mesh = Mesh(np.array(use), ("members",)) if len(use) > 1 else None
    number = partial(np.asarray, dtype=plan.dive_to.dtype)
    given = (members, plan, env, column, number(east), number(north), number(spread), number(fix_sd))
    if several:
        # What lies on the devices of one process only is not known to the others; host arrays are the same in all.
        given = jax.tree.map(np.asarray, given)
    state, outputs = programs.call("fly", _fly_all, (shape, mesh), tuple(use), *given)
    if several:
        # Every process then holds what all of them have flown.
        state, outputs = multihost_utils.process_allgather((state, outputs), tiled=True)
    if pad:
        state = jax.tree.map(lambda a: a[:count], state)
        outputs = jax.tree.map(lambda a: a[:, :count], outputs)
    return state, outputs

