"""Steady gliding: the angle of attack, speed and depth rate at which lift, drag and net buoyancy balance.

Imports JAX and :mod:`glider_jax.physics.term` only. The angle of attack has the sign of the pitch and adds to it, so
the path is steeper than the pitch, on dives as on climbs. Nothing here knows where a coefficient comes from.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from glider_jax.physics.term import Scalar, safe_sqrt

_STEEPEST = 1.5
LARGEST_ATTACK = 0.6
_NEWTON_STEPS = 4
_FITTED_STEPS = 12


class Glide(NamedTuple):
    """A steady glide.

    Attributes
    ----------
    speed_through_water : m s-1 along the path; 0 where the glide is not valid.
    angle_of_attack, glide_angle : rad, sign of the pitch; glide angle = pitch + angle of attack.
    horizontal_speed : m s-1 through the water, forward.
    depth_rate : m s-1, positive down, vertical water velocity included.
    valid : False where buoyancy and pitch disagree in sign, or the angle of attack is past the stall.
    """

    speed_through_water: Scalar
    angle_of_attack: Scalar
    glide_angle: Scalar
    horizontal_speed: Scalar
    depth_rate: Scalar
    valid: Array


def attack_angle(
    pitch: Scalar, parasite: Scalar, induced: Scalar, lift: Scalar, push: Scalar | float = 0.0
) -> Scalar:
    """Angle of attack at which lift and drag balance on a straight path.

    Solves ``C_D0 + C_D1 a**2 = C_La a (tan(pitch + a) + push / cos(pitch + a))`` for its smallest root by Newton's
    method from zero, where the residual falls towards the root. The last step is taken with the earlier ones held
    constant, which makes its derivative that of the implicit function.

    Parameters
    ----------
    pitch : rad, magnitude. parasite, induced, lift : coefficients C_D0 (1), C_D1 (rad-2), C_La (rad-1).
    push : thrust over the magnitude of the net buoyancy.

    Returns
    -------
    Angle of attack, rad, between 0 and 0.6; at the upper end there is no balance.

    References
    ----------
    Merckelbach et al. 2010, doi:10.1175/2009JTECHO710.1, the balance of lift and drag.
    """

    def newton(a: Scalar) -> Scalar:
        path = jnp.minimum(pitch + a, _STEEPEST)
        # The path is less steep than a quarter turn: its secant is positive.
        tangent = jnp.tan(path)
        secant = jnp.sqrt(1.0 + tangent * tangent)
        slope = tangent + push * secant
        bend = secant * secant + push * secant * tangent
        residual = parasite + induced * a * a - lift * a * slope
        steepness = jnp.minimum(2.0 * induced * a - lift * (slope + a * bend), -1e-3 * lift)
        return jnp.clip(a - residual / lax.stop_gradient(steepness), 0.0, LARGEST_ATTACK)

    a = jnp.zeros_like(pitch)
    for _ in range(_NEWTON_STEPS):
        a = newton(a)
    return newton(lax.stop_gradient(a))


def drag_as_fitted(
    lift: Scalar, induced: Scalar, *, given: tuple[Scalar, Scalar, Scalar], pitch: Scalar, xp: Any = jnp
) -> Scalar:
    """Parasite drag that a glide's vertical speed would have been fitted with, had other lift been assumed.

    A fit to vertical speed knows drag and lift together: with weaker lift the same glide is met by less parasite drag.
    What is kept is ``sin(path)**3 / (C_D0 + C_D1 a**2)``, the square of the vertical speed but for a factor.

    Parameters
    ----------
    lift, induced : C_La rad-1 and C_D1 rad-2 that are asked for. given : C_D0, C_La and C_D1 as they were fitted.
    pitch : rad, of the glides that were fitted, nose up. xp : ``numpy`` or ``jax.numpy``.
    """
    parasite, first_lift, first_induced = given
    a = 0.03 * xp.ones_like(pitch)
    for _ in range(_FITTED_STEPS):
        path = xp.minimum(pitch + a, _STEEPEST)
        a = xp.minimum((parasite + first_induced * a * a) / (first_lift * xp.tan(path)), LARGEST_ATTACK)
    kept = xp.sin(pitch + a) ** 2 * xp.cos(pitch + a) / (first_lift * a)
    a = a + 0.0 * lift
    for _ in range(_FITTED_STEPS):
        sine, cosine = xp.sin(pitch + a), xp.cos(pitch + a)
        steepness = xp.minimum(2.0 * sine * cosine**2 - sine**3 - kept * lift, -0.1 * kept * lift)
        a = xp.clip(a - (sine**2 * cosine - kept * lift * a) / steepness, 1e-4, LARGEST_ATTACK)
    return xp.maximum(lift * a * xp.tan(pitch + a) - induced * a * a, 0.1 * parasite)


def steady_glide(
    *,
    net_buoyancy: Scalar,
    pitch: Scalar,
    density: Scalar,
    area: Scalar,
    parasite: Scalar,
    induced: Scalar,
    lift: Scalar,
    stall_angle: Scalar,
    thrust: Scalar | None = None,
    water_up: Scalar | float = 0.0,
    speed_factor: Scalar | float = 1.0,
) -> Glide:
    """Solve the steady glide for one set of forces.

    Along the path ``0.5 rho S (C_D0 + C_D1 a**2) U**2 = |F| sin(path) + thrust``.

    Parameters
    ----------
    net_buoyancy : N, up. pitch : rad, true, nose up. density : kg m-3. area : m2.
    parasite, induced, lift : coefficients C_D0 (1), C_D1 (rad-2) and C_La (rad-1).
    stall_angle : rad, angle of attack beyond which the glide is not valid.
    thrust : N along the path, None for a glider without a thruster.
    water_up : m s-1, vertical water velocity. speed_factor : factor on the horizontal speed.

    Returns
    -------
    The glide; finite, with finite derivatives, also where it is not valid.
    """
    sign = jnp.where(pitch < 0, -jnp.ones_like(pitch), jnp.ones_like(pitch))
    drive = net_buoyancy * sign
    positive = drive > 0
    push = 0.0 if thrust is None else thrust / jnp.where(positive, drive, jnp.ones_like(drive))
    attack = attack_angle(pitch * sign, parasite, induced, lift, push)
    path = jnp.minimum(pitch * sign + attack, _STEEPEST)
    valid = positive & (attack < stall_angle)
    along = jnp.where(valid, drive, jnp.zeros_like(drive)) * jnp.sin(path)
    if thrust is not None:
        along = along + jnp.where(valid, thrust, jnp.zeros_like(thrust))
    speed = safe_sqrt(2.0 * along / (density * area * (parasite + induced * attack * attack)))
    return Glide(
        speed_through_water=speed,
        angle_of_attack=sign * attack,
        glide_angle=sign * path,
        horizontal_speed=speed * jnp.cos(path) * speed_factor,
        depth_rate=-(sign * speed * jnp.sin(path) + water_up),
        valid=valid,
    )
