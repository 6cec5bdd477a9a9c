"""Motion of a glider between steady glides: speed and angle of attack, driven by forces of recorded controls.

Imports JAX and the physics' glide. A steady glide is reached in some ten seconds with all the lift there is; near the
flattest path that weak wings can hold, slowness makes the angle of attack larger, that the drag, and that the slowness,
and a turn is felt for minutes. A newcomer would get wrong: inertia along the hull is given, as an unknown response time
says; the path is found once without derivatives, and they follow in a linear pass beside it.

References
----------
Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1: equations of motion with added mass along and across the hull.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.inference.controls import Rows
from glider_jax.physics.flight import LARGEST_ATTACK, Glide, steady_glide

#: Added mass over mass, along and across the hull.
AXIAL, NORMAL = 0.20, 0.92
#: Parts of a step, of about two seconds each in the usual recording.
PARTS = 4
#: m s-1; what stands still has no angle of attack.
_SLOWEST = 0.02
#: m s-1: how well rows of some seconds tell the velocity out of a turn, what errors of recorded controls add with each
#: row, and the most that a glider can be off.
TURNING, JOLT, MOST = 0.1, 1.5e-3, 0.2
#: Variance that pushes on every row pile up to in a usual glide, in that of one: the noise of the stream holds it.
USUAL = 5.0
#: How many times its size a push on every row may pile up to, beyond which nothing is learned from where the path went.
GROWN = 10.0
#: Settled rows below which a recording says nothing of its usual glide, and m s-1, what is then expected of it.
FEWEST, USUAL_SPEED = 30, 0.3


class Forces(NamedTuple):
    """What acts on the glider in every row; arrays (row,), SI, as in :func:`glider_jax.physics.flight.steady_glide`.

    ``along`` and ``across`` are the inertia in kg, added mass included, along the hull and across it.
    """

    net_buoyancy: Any
    pitch: Any
    density: Any
    area: Any
    parasite: Any
    induced: Any
    lift: Any
    thrust: Any
    along: Any
    across: Any


_PITCH = Forces._fields.index("pitch")


def steady_of(acting: Forces) -> Glide:
    """The steady glide under some forces. A recorded glide did not stall, and a fit near weak lift needs a slope."""
    return steady_glide(
        net_buoyancy=acting.net_buoyancy, pitch=acting.pitch, density=acting.density, area=acting.area,
        parasite=acting.parasite, induced=acting.induced, lift=acting.lift, thrust=acting.thrust, stall_angle=jnp.inf,
    )  # fmt: skip


def wandered(acting: Forces, stray: Any) -> tuple[Any, Any]:
    """What pitch that strays adds to a steady glide's speed and angle of attack; derivatives are by the stray alone."""

    def at(angle: Any) -> tuple[Any, Any]:
        glide = jax.vmap(steady_of)(still._replace(pitch=still.pitch + angle))
        return glide.speed_through_water, glide.angle_of_attack

    still = jax.lax.stop_gradient(acting)
    known = jax.lax.stop_gradient(stray)
    there, slope = jax.jvp(at, (known,), (jnp.ones_like(known),))
    return tuple(
        jax.lax.stop_gradient(x - y) + jax.lax.stop_gradient(dx) * (stray - known)
        for x, y, dx in zip(there, at(jnp.zeros_like(known)), slope, strict=True)
    )


def faster(speed: Any, settled: Any) -> Any:
    """Speeds over their mean in settled glides, within a factor of two."""
    speed = jax.lax.stop_gradient(speed)
    mean = jnp.sum(jnp.where(settled, speed, 0.0)) / jnp.maximum(jnp.sum(settled), 1)
    return jnp.clip(speed / jnp.maximum(mean, 1e-3), 0.5, 2.0)


def respond(steady: Any, step: Any, tau: Any) -> tuple[Any, ...]:
    """Mean over each step of a first-order response to steady values (n, k), each with its time; k arrays (n,)."""
    before = jnp.concatenate([steady[:1], steady[:-1]])
    drive = 0.5 * (before + steady)
    tau = jnp.maximum(tau, 0.5)
    step = step[:, None]
    decay = jnp.exp(-step / tau)
    held = jnp.where(step > 0.0, tau * (1.0 - decay) / jnp.where(step > 0.0, step, 1.0), 1.0)

    def advance(state: Any, row: Any) -> tuple[Any, Any]:
        target, fall, share = row
        mean = target + (state - target) * share
        return target + (state - target) * fall, mean

    _, mean = jax.lax.scan(advance, steady[0], (drive, decay, held), unroll=8)
    return tuple(mean.T)


def response_of(rows: Rows, known: Mapping[str, float]) -> float:
    """Time in s in which the speed along the path answers: (1 + k) m U over twice the drag, as recorded.

    ``known`` are the base model's numbers by public name, here and in :func:`usual_drag`.
    """
    if np.count_nonzero(rows.settled) < FEWEST:
        return float(known["flight.response_time"])
    mass, area = float(known["flight.mass"]), float(known["flight.wing_area"])
    density = float(np.median(rows.density[rows.settled]))
    return float(np.clip((1.0 + AXIAL) * mass / (density * area * usual_drag(rows, known)), 4.0, 30.0))


def usual_drag(rows: Rows, known: Mapping[str, float]) -> float:
    """Drag coefficient times speed along the path, m s-1, of the base model at the depth rates and pitch recorded."""
    rate = np.abs(np.gradient(rows.depth, rows.time))[rows.settled]
    parasite, induced, lift = (float(known[f"flight.{n}"]) for n in ("parasite_drag", "induced_drag", "lift_slope"))
    if rate.size < FEWEST:
        return parasite * USUAL_SPEED
    pitch = float(np.median(np.abs(rows.pitch[rows.settled])))
    attack = 0.03
    for _ in range(8):
        attack = min((parasite + induced * attack * attack) / (lift * np.tan(pitch + attack)), 0.3)
    speed = float(np.median(rate)) / np.sin(pitch + attack)
    return float((parasite + induced * attack * attack) * max(speed, 0.05))


def motion(forces: Forces, steady: Glide, step: Any, follows: Any, stray: Any) -> tuple[Any, ...]:
    """Speed along the path, as a mean over the step before each row, and angle of attack at each row; what pitch that
    strays adds to both; and how well either turn or start lets the velocity be known.

    The answer to a stray pitch is that of the motion, which near weak lift comes late and half as large again.
    Its derivatives are by the stray alone, so that errors of pitch teach nothing. Out of a turn a glider with weak lift
    may hang at a large angle of attack for minutes, and how long is decided by what no row tells; while pushes pile up
    to more than ``GROWN``, derivatives are those of the steady glide.

    Parameters
    ----------
    forces : of every row. steady : the steady glide of each. step : (row,) s since the row before.
    follows : (row,) bool; elsewhere the glide is the steady one, and the next row starts there.
    stray : (row,) rad, pitch beyond that of the forces.

    Returns
    -------
    (row,) m s-1, (row,) rad with the sign of an angle of attack, (row,) m s-1 and rad of the answer, and (row,) m s-1,
    standard deviation of the velocity, without derivatives.
    """
    still, angle = steady.speed_through_water, steady.angle_of_attack
    start = jnp.stack([still * jnp.cos(angle), still * jnp.sin(angle)], axis=1)
    acting = jnp.stack([jnp.broadcast_to(f, step.shape) for f in forces], axis=1)
    path = _path(acting, start, step, follows)
    reached, mean = path[:, :2], path[:, 2:]
    moving = follows & (reached[:, 0] > _SLOWEST)
    u, v = jnp.where(moving, reached[:, 0], 1.0), jnp.where(moving, reached[:, 1], 0.0)
    attack = jnp.where(moving, jnp.clip(jnp.arctan2(v, u), -LARGEST_ATTACK, LARGEST_ATTACK), angle)
    quicker, steeper = wandered(forces, stray)
    known = jax.lax.stop_gradient((acting, start, path))
    answer = _answer(*known, step, follows, stray)
    flown = jax.lax.stop_gradient(path + answer)
    open_ = _open(known[0].at[:, _PITCH].add(jax.lax.stop_gradient(stray)), known[1], flown, step, follows)
    there = known[2][:, :2] + answer[:, :2]
    turned = jnp.arctan2(there[:, 1], jnp.maximum(there[:, 0], _SLOWEST)) - jax.lax.stop_gradient(attack)
    quicker = jnp.where(follows, answer[:, 2], quicker)
    return jnp.where(follows, mean[:, 0], still), attack, quicker, jnp.where(moving, turned, steeper), open_


@jax.custom_jvp
def _answer(acting: Any, start: Any, path: Any, step: Any, follows: Any, stray: Any) -> Any:
    """What a stray pitch adds to velocity in the hull's axes and to the mean speed, (row, 3)."""
    return _path(acting.at[:, _PITCH].add(stray), start, step, follows) - path


@_answer.defjvp
def _(given: Any, tangents: Any) -> tuple[Any, Any]:
    """Derivatives by the stray alone, with those of the path beside it, which its own derivatives need anyway."""
    acting, start, path, step, follows, _ = given
    more = tangents[-1]
    by_state, by_before, by_now = _slopes(acting, start, path, step)
    before = jnp.concatenate([more[:1], more[:-1]])
    push = by_now[:, :, _PITCH] * more[:, None] + by_before[:, :, _PITCH] * before[:, None]
    told = follows & (_spread(by_state[:, :2], acting, follows)[1] < GROWN)
    return _answer(*given), _beside(by_state, push, jnp.zeros_like(start), told)


@jax.custom_jvp
def _path(acting: Any, start: Any, step: Any, follows: Any) -> Any:
    """Velocity in the hull's axes at every row, ``start`` where nothing is followed, and mean speed; (row, 3)."""

    def along(velocity: Any, row: Any) -> tuple[Any, Any]:
        before, now, there, seconds, going = row
        state = _advance(velocity, before, now, seconds, parts_at_once=PARTS)
        state = jnp.where(going, state, jnp.append(there, 0.0))
        return state[:2], state

    before = jnp.concatenate([acting[:1], acting[:-1]])
    return jax.lax.scan(along, start[0], (before, acting, start, step, follows))[1]


@_path.defjvp
def _(given: Any, tangents: Any) -> tuple[Any, Any]:
    """Beside the path: y' = A y + b, with A and what the forces do of all rows found at once, for all derivatives."""
    acting, start, step, follows = given
    path = _path(*given)
    by_state, by_before, by_now = _slopes(acting, start, path, step)
    push = tangents[0]
    pushed = jnp.einsum("nij,nj->ni", by_now, push)
    pushed = pushed + jnp.einsum("nij,nj->ni", by_before, jnp.concatenate([push[:1], push[:-1]]))
    told = follows & (_spread(by_state[:, :2], acting, follows)[1] < GROWN)
    return path, _beside(by_state, pushed, tangents[1], told)


def _open(acting: Any, start: Any, path: Any, step: Any, follows: Any) -> Any:
    """Standard deviation (row,) of the velocity, m s-1, after turns and starts that are known to ``TURNING``."""
    last = jnp.concatenate([start[:1], path[:-1, :2]])
    before = jnp.concatenate([acting[:1], acting[:-1]])
    by_state = jax.vmap(jax.jacfwd(lambda *row: _advance(*row)[:2]))(last, before, acting, step)
    left, _ = _spread(by_state, acting, follows)
    # A steady glide that nothing drives is as well known as it ever was.
    return jnp.where(follows, jnp.sqrt(jnp.maximum(left**2 - USUAL * JOLT**2, 0.0)), 0.0)


def _spread(by_state: Any, acting: Any, follows: Any) -> tuple[Any, Any]:
    """What is left of errors of the velocity, m s-1 (row,), and how many times its size a push on every row piles up
    to.

    Where the path begins it is known as well as out of a turn, which is where the net buoyancy changes sign.
    ``by_state`` (row, 2, 2) is what a step makes of velocities.
    """
    way = jnp.sign(acting[:, 0])
    turned = way != jnp.concatenate([way[:1], way[:-1]])
    fresh = jnp.where(turned, TURNING**2, 0.0) + JOLT**2
    one = jnp.eye(2)

    def on(carried: Any, row: Any) -> tuple[Any, Any]:
        a, more, going = row
        left, piled = (a @ x @ a.T for x in carried)
        left = jnp.where(going, left + more * one, TURNING**2 * one)
        left = left * jnp.minimum(1.0, MOST**2 / jnp.trace(left))
        piled = jnp.where(going, piled, 0.0) + one
        piled = piled * jnp.minimum(1.0, 1e6 / jnp.trace(piled))
        return (left, piled), (jnp.sqrt(jnp.trace(left)), jnp.sqrt(jnp.trace(piled)))

    return jax.lax.scan(on, (TURNING**2 * one, one), (by_state, fresh, follows), unroll=4)[1]


def _slopes(acting: Any, start: Any, path: Any, step: Any) -> tuple[Any, Any, Any]:
    """Derivatives of every row's step by the velocity it starts from and by the forces before and at the row."""
    last = jnp.concatenate([start[:1], path[:-1, :2]])
    before = jnp.concatenate([acting[:1], acting[:-1]])
    return jax.vmap(jax.jacrev(_advance, (0, 1, 2)))(last, before, acting, step)


def _beside(by_state: Any, pushed: Any, begun: Any, follows: Any) -> Any:
    """What goes on beside the path: what the step makes of the row before, and what is pushed; (row, 3).

    ``begun`` (row, 2) is what there is where nothing is followed.
    """
    a = jnp.where(follows[:, None, None], by_state[:, :2], 0.0)
    b = jnp.where(follows[:, None], pushed[:, :2], begun)

    def beside(state: Any, row: Any) -> tuple[Any, Any]:
        state = row[0] @ state + row[1]
        return state, state

    _, reached = jax.lax.scan(beside, jnp.zeros_like(b[0]), (a, b), unroll=8)
    left = jnp.concatenate([begun[:1], reached[:-1]])
    mean = pushed[:, 2:] + jnp.einsum("nij,nj->ni", by_state[:, 2:], left)
    return jnp.concatenate([reached, mean], axis=1)


def _advance(velocity: Any, before: Any, now: Any, step: Any, parts_at_once: int = 1) -> Any:
    """Velocity in the hull's axes (2,) a step on, and the mean speed over it, under forces that change linearly."""
    h = step / PARTS
    turned = (now[1] - before[1]) / PARTS
    spin = jnp.cos(turned), jnp.sin(turned)

    def part(carried: Any, k: Any) -> tuple[Any, None]:
        u, v, mean = carried
        u, v = spin[0] * u + spin[1] * v, spin[0] * v - spin[1] * u
        first = jnp.sqrt(u * u + v * v + 1e-6)
        u, v = _part(u, v, Forces(*(before + (now - before) * ((k + 0.5) / PARTS))), h)
        return (u, v, mean + 0.5 * (first + jnp.sqrt(u * u + v * v + 1e-6)) / PARTS), None

    carried = (velocity[0], velocity[1], jnp.zeros(()))
    return jnp.stack(jax.lax.scan(part, carried, jnp.arange(PARTS), unroll=parts_at_once)[0])


def _part(u: Any, v: Any, forces: Forces, h: Any) -> tuple[Any, Any]:
    """A linearly implicit step of the velocity along the hull and across it, which leaves a steady glide as it is."""
    speed = jnp.sqrt(u * u + v * v + 1e-6)
    attack = jnp.clip(jnp.arctan2(v, jnp.maximum(u, _SLOWEST)), -LARGEST_ATTACK, LARGEST_ATTACK)
    q = 0.5 * forces.density * forces.area
    drag = forces.parasite + forces.induced * attack * attack
    lift = forces.lift * attack
    pull = forces.thrust / speed
    back, across = drag * u - lift * v, drag * v + lift * u
    x = forces.net_buoyancy * jnp.sin(forces.pitch) - q * speed * back + pull * u
    y = forces.net_buoyancy * jnp.cos(forces.pitch) - q * speed * across + pull * v
    # How these change with u and v, of which the angle of attack is the quotient.
    more = 2.0 * forces.induced * attack
    by_back, by_across = more * u - forces.lift * v, more * v + forces.lift * u
    along_u, along_v = u / speed, v / speed
    thrust = pull / (speed * speed)
    x_u = -q * (along_u * back + speed * drag - by_back * along_v) + thrust * v * v
    x_v = -q * (along_v * back - speed * lift + by_back * along_u) - thrust * u * v
    y_u = -q * (along_u * across + speed * lift - by_across * along_v) - thrust * u * v
    y_v = -q * (along_v * across + speed * drag + by_across * along_u) + thrust * u * u
    hx, hy = h / forces.along, h / forces.across
    a, d = 1.0 - hx * jnp.minimum(x_u, 0.0), 1.0 - hy * jnp.minimum(y_v, 0.0)
    b, c = hx * x_v, hy * y_u
    # Where slowness feeds on itself faster than the step can tell, it may not turn the step round.
    under = jnp.maximum(a * d - b * c, 0.5 * a * d)
    u = jnp.maximum(u + (d * hx * x + b * hy * y) / under, _SLOWEST)
    steepest = np.tan(LARGEST_ATTACK) * u
    return u, jnp.clip(v + (a * hy * y + c * hx * x) / under, -steepest, steepest)
