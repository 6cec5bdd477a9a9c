"""A mission and a vehicle as the numbers the compiled step needs: ``Plan`` (traced) and ``Shape`` (static).

Everything that changes what is computed (which rules exist, how many waypoints and output times) is in ``Shape``, a
hashable key of the compilation; every number is in ``Plan``, so that a new depth, speed or start does not compile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.environment.fields import on_device
from glider_jax.environment.frame import Frame
from glider_jax.environment.seawater import gravity
from glider_jax.errors import ConfigError
from glider_jax.mission.rules import REASON, make_program

TIMED = ("every", "after", "no_comms", "utc")
_LONG = 1e9
MAX_LEGS = 64
SPEED_NODES = 1025
#: s; as many yos as come closest to this are flown as one step. Chosen against the small-step reference.
BUNDLE = 1000.0


@dataclass(frozen=True)
class Shape:
    """What fixes the compiled program.

    ``speed``: ``constant`` or ``flight``. ``rules``: kinds of the timed surfacing rules, in order of the mission.
    ``reasons``: what a surfacing can be caused by; the timed rules first, then ``waypoint``, ``yo_count`` and
    ``mission_done``. ``loop`` whether the waypoint list starts again, ``waypoint_surfaces`` whether reaching one
    brings the glider up, ``bounded_yos`` whether a number of yos does. ``program``: kinds of the mission's rules.
    """

    speed: str
    rules: tuple[str, ...]
    reasons: tuple[str, ...]
    waypoints: int
    loop: bool
    waypoint_surfaces: bool
    bounded_yos: bool
    intervals: int
    blocks: int
    levels: int
    product_error: bool
    dtype: str
    program: tuple = ()


class Plan(eqx.Module):
    """Numbers of the mission, SI, in the dtype of the run; see :class:`~glider_jax.config.Mission` for meanings."""

    waypoints: Any
    radius: Any
    dive_to: Any
    climb_to: Any
    altitude: Any
    dive_tangent: Any
    climb_tangent: Any
    dive_volume: Any
    climb_volume: Any
    dive_pitch: Any
    climb_pitch: Any
    overshoot_time: Any
    surface_stay: Any
    rule_seconds: Any
    rule_time: Any
    interrupts: Any
    yo_limit: Any
    overtime: Any
    correction: Any
    interval: Any
    intervals: Any
    bundle: Any
    minimum_yo: Any
    minimum_depth: Any
    error_time: Any
    error_length: Any
    speeds: Any
    temperature: Any
    density: Any
    latitude: Any
    gravity: Any
    program: Any = ()


def legs_of(mission: Mission) -> tuple[list[tuple[float, float]], bool]:
    """The waypoints in the order flown and whether the list starts again at its end."""
    points = list(mission.waypoints)
    if not points:
        raise ConfigError(
            f"{mission.name}: expected at least one waypoint, found none. Add one to the mission's list."
        )
    first = mission.first_waypoint
    if first is None:
        first = 0
        if mission.start_position is not None:
            lat0, lon0 = mission.start_position
            cosine = math.cos(math.radians(lat0))
            first = int(np.argmin([math.hypot(a - lat0, ((b - lon0 + 180) % 360 - 180) * cosine) for a, b in points]))
    order = points[first:] + points[:first]
    if mission.legs == -1:
        return order, True
    if mission.legs == -2:
        return points[first:] if first else points, False
    count = min(mission.legs, MAX_LEGS)
    return [order[k % len(order)] for k in range(count)], False


def not_simulated(mission: Mission) -> list[str]:
    """Rules of the mission that the step does not follow, as words for the user."""
    found = [f"surface when {rule.kind}" for rule in mission.surface if rule.kind in ("science", "waypoint_distance")]
    for name in ("overdepth", "same_depth_for", "stalled_for", "no_comms_for", "maximum_waypoint_distance"):
        if getattr(mission.aborts, name) is not None:
            found.append(f"abort at {name.replace('_', ' ')} {getattr(mission.aborts, name):g}")
    if mission.yo.climb_altitude is not None:
        found.append(f"climb to an altitude of {mission.yo.climb_altitude:g} m")
    return found


def overshoot_time(vehicle: Vehicle, mission: Mission) -> float:
    """Seconds for which the glider keeps its vertical speed after an inflection is commanded.

    Half the pump's stroke at its rate (the net buoyancy passes zero there), plus the control cycle of 4 s. A full
    stroke moves the dive's and the climb's volume.
    """
    rate = vehicle.value("flight.pump_rate")
    volume = vehicle.value("flight.pump_volume")
    down = mission.yo.dive_volume if mission.yo.dive_volume is not None else volume
    up = mission.yo.climb_volume if mission.yo.climb_volume is not None else volume
    return 4.0 + 0.5 * (abs(down) + abs(up)) / rate


def make_plan(
    mission: Mission,
    vehicle: Vehicle,
    frame: Frame,
    *,
    t0: float,
    duration: float,
    speed: str,
    speeds: tuple[np.ndarray, np.ndarray] | None,
    interval: float,
    levels: int = 24,
    block: float = 86400.0,
    product_error: bool = False,
    temperature: float = 288.15,
    density: float = 1025.0,
    home: tuple[float, float] | None = None,
    dtype=jnp.float32,
) -> tuple[Plan, Shape]:
    """Make the traced and the static half of a plan.

    Parameters
    ----------
    t0 : UTC seconds of the start.  duration : s to forecast.  interval : s between outputs.
    speed : ``shoebox``, ``distribution`` or ``flight``.
    speeds : nodes (m s-1) of the forward speed and their cumulative probabilities; None for ``flight``.
    levels : layers of the flight tables.  block : s after which the flight tables are made anew, infinity for never.
    product_error : whether the current product states its own error.
    temperature, density : K and kg m-3, means of the water flown through.
    home : (latitude, longitude) of the start, to which a program may lead back; the frame's origin if None.
    """
    order, loop = legs_of(mission)
    timed = [rule for rule in mission.surface if rule.kind in TIMED]
    counts = [rule.count for rule in mission.surface if rule.kind == "inflections" and rule.count > 0]
    if mission.yo.half_cycles:
        counts.append(mission.yo.half_cycles)
    at_waypoint = any(rule.kind == "waypoint" for rule in mission.surface)
    asked = (REASON,) if mission.program else ()
    reasons = tuple(rule.kind for rule in timed) + asked + ("waypoint", "yo_count", "mission_done")
    intervals = max(1, math.ceil(duration / interval - 1e-9))
    per_block = max(1, int(min(block, duration + interval) // interval)) if speed == "flight" else intervals
    per_block = min(per_block, intervals)
    blocks = math.ceil(intervals / per_block)
    east, north = frame.to_metres(*np.array(order, float).T)
    yo = mission.yo
    lead = yo.overshoot
    volume = vehicle.value("flight.pump_volume")
    down = min(abs(yo.dive_volume), volume) if yo.dive_volume is not None else volume
    up = min(abs(yo.climb_volume), volume) if yo.climb_volume is not None else volume

    def number(value):
        return on_device(value, dtype)

    kinds, program = make_program(mission, vehicle.battery, frame, order, t0, timed, dtype, home)
    nodes, probabilities = (np.array([0.3, 0.3]), np.array([0.0, 1.0])) if speeds is None else speeds
    plan = Plan(
        waypoints=number(np.stack([east, north], -1)),
        radius=number(mission.waypoint_radius),
        dive_to=number(yo.dive_to),
        climb_to=number(yo.climb_to),
        altitude=number(yo.dive_altitude if yo.dive_altitude is not None else 0.0),
        dive_tangent=number(math.tan(yo.dive_pitch)),
        climb_tangent=number(math.tan(yo.climb_pitch)),
        dive_volume=number(-down),
        climb_volume=number(up),
        dive_pitch=number(yo.dive_pitch),
        climb_pitch=number(yo.climb_pitch),
        overshoot_time=number(overshoot_time(vehicle, mission) if lead is None else 0.0),
        surface_stay=number(mission.surface_stay),
        rule_seconds=number([rule.seconds for rule in timed] or [_LONG]),
        rule_time=number([(rule.time - t0) if rule.time is not None else 0.0 for rule in timed] or [0.0]),
        interrupts=number([0.0 if rule.when_yo_ends else 1.0 for rule in timed] + [1.0] * (3 + len(asked))),
        yo_limit=number(max(1.0, min(counts) / 2.0) if counts else _LONG),
        overtime=number(mission.aborts.overtime if mission.aborts.overtime else _LONG),
        correction=number(1.0 if mission.current_correction else 0.0),
        interval=number(interval),
        intervals=jnp.asarray(intervals, jnp.int32),
        bundle=number(BUNDLE),
        minimum_yo=number(2.0),
        minimum_depth=number(2.5),
        error_time=number(vehicle.value("perturbation.current_error_time")),
        error_length=number(vehicle.value("perturbation.current_error_length")),
        temperature=number(temperature),
        density=number(density),
        latitude=number(math.radians(frame.latitude)),
        gravity=number(gravity(math.radians(frame.latitude))),
        speeds=number(np.interp(np.linspace(0.0, 1.0, SPEED_NODES), probabilities, nodes)),
        program=program,
    )
    shape = Shape(
        speed="flight" if speed == "flight" else "constant",
        rules=tuple(rule.kind for rule in timed),
        reasons=reasons,
        waypoints=len(order),
        loop=loop,
        waypoint_surfaces=at_waypoint,
        bounded_yos=bool(counts),
        intervals=per_block,
        blocks=blocks,
        levels=levels,
        product_error=product_error,
        dtype=jnp.dtype(dtype).name,
        program=kinds,
    )
    return plan, shape
