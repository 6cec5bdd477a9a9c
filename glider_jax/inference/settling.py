"""The angle of attack on its way to the steady glide: what a turn leaves behind when the wings lift little.

Imports JAX and the physics' glide. With all its lift a glider finds its angle of attack within seconds. Near the flattest
path that its wings can hold, slowness makes the angle larger, that the drag, and that the slowness: it then takes
minutes, and a steady glide stands for none of them. A newcomer would get wrong: only the angle is taken from here; the
speed along the path answers in the response time, which is an unknown of its own. The path is found once without
derivatives, and derivatives follow in a linear pass beside it.

References
----------
Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1: equations of motion with added mass along and across the hull.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.physics.flight import LARGEST_ATTACK, Glide

#: Added mass over mass, along and across the hull.
AXIAL, NORMAL = 0.20, 0.92
SUBSTEPS = 4
#: m s-1; what stands still has no angle of attack.
_SLOWEST = 0.02
_UNROLL = 1


class Forces(NamedTuple):
    """What acts on the glider in every row; arrays (row,), SI, as in :func:`glider_jax.physics.flight.steady_glide`."""

    net_buoyancy: Any
    pitch: Any
    density: Any
    area: Any
    parasite: Any
    induced: Any
    lift: Any
    thrust: Any
    mass: Any


def left_behind(forces: Forces, steady: Glide, step: Any, follows: Any) -> Any:
    """Angle of attack that forces and inertia have reached by each row, less that of the steady glide.

    Parameters
    ----------
    forces : of every row. steady : the steady glide of each. step : (row,) s since the row before.
    follows : (row,) bool; elsewhere the glide is the steady one, and the next row starts there.

    Returns
    -------
    (row,) rad, sign of an angle of attack.
    """
    still, angle = steady.speed_through_water, steady.angle_of_attack
    start = jnp.stack([still * jnp.cos(angle), still * jnp.sin(angle)], axis=1)
    turned = jnp.diff(forces.pitch, prepend=forces.pitch[:1])
    acting = jnp.stack([*(jnp.broadcast_to(f, turned.shape) for f in forces), turned], axis=1)
    velocity = _path(acting, start, step, follows)
    moving = follows & (velocity[:, 0] > _SLOWEST)
    u, v = velocity.T
    reached = jnp.arctan2(jnp.where(moving, v, 0.0), jnp.where(moving, u, 1.0))
    return jnp.where(moving, jnp.clip(reached, -LARGEST_ATTACK, LARGEST_ATTACK) - angle, 0.0)


@jax.custom_jvp
def _path(acting: Any, start: Any, step: Any, follows: Any) -> Any:
    """Velocity in the hull's axes in every row, (row, 2) m s-1; that of ``start`` where nothing is followed."""
    return _substeps(acting, start, step, follows)[SUBSTEPS - 1 :: SUBSTEPS]


@_path.defjvp
def _(given: Any, tangents: Any) -> tuple[Any, Any]:
    """Beside the path: y' = A y + b, with A and what the forces do of all rows found at once, for all derivatives."""
    acting, start, step, follows = given
    fine = _substeps(*given)
    before = jnp.concatenate([start[:1], fine[:-1]])
    turning = jax.vmap(jax.jacrev(_advance, (0, 1)))(before, *_cut(acting, step))
    by_state, by_force = (x.reshape(-1, SUBSTEPS, *x.shape[1:]) for x in turning)
    a, c = by_state[:, 0], by_force[:, 0]
    # The hull turned before the first part of the step alone.
    idle = jnp.ones(acting.shape[1]).at[-1].set(0.0)
    for k in range(1, SUBSTEPS):
        a, c = by_state[:, k] @ a, by_state[:, k] @ c + by_force[:, k] * idle
    a = jnp.where(follows[:, None, None], a, 0.0)
    b = jnp.where(follows[:, None], jnp.einsum("nij,nj->ni", c, tangents[0]), tangents[1])

    def after(one: Any, two: Any) -> Any:
        return two[0] @ one[0], jnp.einsum("...ij,...j->...i", two[0], one[1]) + two[1]

    return fine[SUBSTEPS - 1 :: SUBSTEPS], jax.lax.associative_scan(after, (a, b))[1]


def _cut(acting: Any, step: Any) -> tuple[Any, Any]:
    """Forces and seconds of the parts of all steps; the hull turns before the first part."""
    acting = jnp.repeat(acting, SUBSTEPS, axis=0)
    first = jnp.arange(acting.shape[0]) % SUBSTEPS == 0
    return acting.at[:, -1].multiply(first), jnp.repeat(step / SUBSTEPS, SUBSTEPS)


def _substeps(acting: Any, start: Any, step: Any, follows: Any) -> Any:
    """Velocity after every part of every step."""
    there, goes_on = jnp.repeat(start, SUBSTEPS, axis=0), jnp.repeat(follows, SUBSTEPS)

    def along(velocity: Any, row: Any) -> tuple[Any, Any]:
        own, seconds, at, going = row
        velocity = jnp.where(going, _advance(velocity, own, seconds), at)
        return velocity, velocity

    return jax.lax.scan(along, start[0], (*_cut(acting, step), there, goes_on), unroll=_UNROLL)[1]


def _advance(velocity: Any, acting: Any, h: Any) -> Any:
    """Velocity in the hull's axes (2,) a time on: a linearly implicit step, which leaves a steady glide as it is.

    ``acting`` are the forces and, last, the angle by which the hull was turned up before.
    """
    forces, turned = Forces(*acting[:-1]), acting[-1]
    c, s = jnp.cos(turned), jnp.sin(turned)
    u, v = c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0]
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
    hx, hy = h / (forces.mass * (1.0 + AXIAL)), h / (forces.mass * (1.0 + NORMAL))
    a, d = 1.0 - hx * jnp.minimum(x_u, 0.0), 1.0 - hy * jnp.minimum(y_v, 0.0)
    b, c = hx * x_v, hy * y_u
    # Where slowness feeds on itself faster than the step can tell, it may not turn the step round.
    under = jnp.maximum(a * d - b * c, 0.5 * a * d)
    u = jnp.maximum(u + (d * hx * x + b * hy * y) / under, _SLOWEST)
    steepest = np.tan(LARGEST_ATTACK) * u
    return jnp.stack([u, jnp.clip(v + (a * hy * y + c * hx * x) / under, -steepest, steepest)])
