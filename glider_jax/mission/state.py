"""What the mission step carries: the environment's tables, a member, its sums, its logs and its state.

Plain data with shapes of one member; callers vmap. Positions are frame metres, times seconds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx

from glider_jax.environment.fields import Bathymetry, CurrentField
from glider_jax.environment.frame import Frame


class Environment(eqx.Module):
    """What surrounds the glider, tabulated in one frame."""

    frame: Frame
    currents: CurrentField
    bathymetry: Bathymetry


class Member(NamedTuple):
    """What distinguishes one member: its drawn physics and errors; constant during a run.

    ``key`` two uint32 words of its own random stream; ``heading`` rad, true minus believed, and ``turn`` its cosine
    and sine; ``stay`` factor on the time at the surface; ``speed`` factor on the speed
    through the water; ``power`` W of the devices while diving, climbing and at the surface; ``per_surfacing`` and
    ``per_inflection`` J of the devices; ``energy_limit`` J at which the mission ends with outcome ``limit_code``.
    """

    key: Any
    model: Any
    heading: Any
    turn: tuple[Any, Any]
    stay: Any
    speed: Any
    power: tuple[Any, Any, Any]
    per_surfacing: Any
    per_inflection: Any
    energy_limit: Any
    limit_code: Any


class Sums(NamedTuple):
    """What adds up during a mission: energies J, times s, counts, distances m."""

    pump: Any
    retract: Any
    brake: Any
    hotel: Any
    dive_time: Any
    climb_time: Any
    surface_time: Any
    inflections: Any
    surfacings: Any
    through_water: Any
    over_ground: Any


class Log(NamedTuple):
    """One surfacing, or one departure from the surface: absolute time s, position in frame metres, rule index."""

    time: Any
    east: Any
    north: Any
    reason: Any


class State(NamedTuple):
    """A mission at the end of a step; positions in frame metres, times in s of the present interval unless absolute.

    ``depth`` where the next leg starts; ``turn`` the last turning depth, which predicts the next; ``due`` when the
    surfacing clock runs out and ``reason`` which rule set it; ``dive_time`` absolute, when it left the surface;
    ``arrivals`` (one per waypoint, NaN before) and the logs' times are absolute. ``surfaced`` and ``left`` are the
    last surfacing and departure, ``*_before`` the ones before. ``last_*`` describe the step just made. ``program`` is
    where the mission's program stands, empty without one.
    """

    time: Any
    east: Any
    north: Any
    dr_east: Any
    dr_north: Any
    dac_east: Any
    dac_north: Any
    depth: Any
    turn: Any
    at_surface: Any
    due: Any
    reason: Any
    dive_clock: Any
    leg: Any
    done: Any
    segment_speed: Any
    segment_yos: Any
    error_east: Any
    error_north: Any
    current_east: Any
    current_north: Any
    sums: Sums
    delta: Sums
    last_time: Any
    last_east: Any
    last_north: Any
    last_turn: Any
    last_top: Any
    last_dive: Any
    last_climb: Any
    last_up: Any
    contacts: Any
    outcome: Any
    end_time: Any
    steps: Any
    arrivals: tuple[Any, ...]
    surfaced: Log
    surfaced_before: Log
    left: Log
    left_before: Log
    program: Any = ()
