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
_UNROLL = 4


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

    def along(velocity: Any, row: Any) -> tuple[Any, Any]:
        own, there, seconds, goes_on = row
        velocity = jnp.where(goes_on, _advance(velocity, own, seconds), there)
        return velocity, velocity

    return jax.lax.scan(along, start[0], (acting, start, step, follows), unroll=_UNROLL)[1]


@_path.defjvp
def _(given: Any, tangents: Any) -> tuple[Any, Any]:
    """Beside the path: y' = A y + b, with A and what the forces do of all rows found at once, for all derivatives."""
    acting, start, step, follows = given
    path = _path(*given)
    before = jnp.concatenate([start[:1], path[:-1]])
    by_state, by_force = jax.vmap(jax.jacrev(_advance, (0, 1)))(before, acting, step)
    a = jnp.where(follows[:, None, None], by_state, 0.0)
    b = jnp.where(follows[:, None], jnp.einsum("nij,nj->ni", by_force, tangents[0]), tangents[1])

    def after(one: Any, two: Any) -> Any:
        return two[0] @ one[0], jnp.einsum("...ij,...j->...i", two[0], one[1]) + two[1]

    return path, jax.lax.associative_scan(after, (a, b))[1]


def _acceleration(velocity: Any, forces: Forces) -> Any:
    """Acceleration along the hull and across it, m s-2; velocity (2,) m s-1, across positive up."""
    u, v = velocity
    speed = jnp.sqrt(u * u + v * v + 1e-6)
    attack = jnp.clip(jnp.arctan2(v, jnp.maximum(u, _SLOWEST)), -LARGEST_ATTACK, LARGEST_ATTACK)
    dynamic = 0.5 * forces.density * forces.area * speed
    drag = forces.parasite + forces.induced * attack * attack
    lift = forces.lift * attack
    pull = forces.thrust / speed
    along = forces.net_buoyancy * jnp.sin(forces.pitch) - dynamic * (drag * u - lift * v) + pull * u
    across = forces.net_buoyancy * jnp.cos(forces.pitch) - dynamic * (drag * v + lift * u) + pull * v
    return jnp.stack([along / (1.0 + AXIAL), across / (1.0 + NORMAL)]) / forces.mass


def _advance(velocity: Any, acting: Any, step: Any) -> Any:
    """Velocity in the hull's axes (2,) one row on, in linearly implicit steps, which leave a steady glide as it is.

    ``acting`` are the forces and, last, the angle by which the hull was turned up since the row before.
    """
    forces, turned = Forces(*acting[:-1]), acting[-1]
    c, s = jnp.cos(turned), jnp.sin(turned)
    y = jnp.stack([c * velocity[0] + s * velocity[1], c * velocity[1] - s * velocity[0]])
    h = step / SUBSTEPS
    for _ in range(SUBSTEPS):
        slope = jax.jacfwd(_acceleration)(y, forces)
        a, d = 1.0 - h * jnp.minimum(slope[0, 0], 0.0), 1.0 - h * jnp.minimum(slope[1, 1], 0.0)
        b, c = -h * slope[0, 1], -h * slope[1, 0]
        # Where slowness feeds on itself faster than the step can tell, it may not turn the step round.
        under = jnp.maximum(a * d - b * c, 0.5 * a * d)
        push = h * _acceleration(y, forces)
        u = jnp.maximum(y[0] + (d * push[0] - b * push[1]) / under, _SLOWEST)
        steepest = np.tan(LARGEST_ATTACK) * u
        y = jnp.stack([u, jnp.clip(y[1] + (a * push[1] - c * push[0]) / under, -steepest, steepest)])
    return y
