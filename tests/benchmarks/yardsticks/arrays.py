"""A prepared run as flat arrays, for the yardsticks: what the forecaster reads, they read.

Only what the bundled default mission has is understood: constant speeds, one surfacing rule ``every``, waypoints flown
once, a surface current, no further physics. Anything else is refused, so that no comparison leaves physics out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Rows of a member's numbers; their order is that of MEMBER in mission.c.
MEMBER = (
    "cosine", "sine", "stay", "speed", "pump", "pump_per_metre", "retract", "brake", "hotel", "surface",
    "power_dive", "power_climb", "power_surface", "per_surfacing", "per_inflection", "limit",
)  # fmt: skip
#: Numbers of the plan; their order is that of the struct Plan in mission.c.
PLAN = (
    "radius", "dive_to", "climb_to", "altitude", "dive_tangent", "climb_tangent", "overshoot_time", "surface_stay",
    "every", "overtime", "correction", "interval", "slot", "minimum_yo", "minimum_depth", "error_time",
    "error_length", "fix_sd", "start_east", "start_north", "half_height", "stretch_east_0", "stretch_east_1",
    "stretch_east_2", "stretch_east_3", "stretch_east_4", "stretch_north_0", "stretch_north_1", "stretch_north_2",
    "stretch_north_3", "stretch_north_4", "breaks_every", "breaks_done", "breaks_waypoint",
)  # fmt: skip
#: Geometry of the grids, floats then integers; their order is that of the struct Grids in mission.c.
PLACES = ("x0", "y0", "dx", "dy", "first", "per_second", "floor_x0", "floor_y0", "floor_dx", "floor_dy")
COUNTS = ("nx", "ny", "frames", "floor_nx", "floor_ny", "nodes", "legs")
#: Rows of one record, by the names of ``ensemble.Output``.
RECORD = (
    "east", "north", "depth", "phase", "active", "current_east", "current_north",
    "pump", "retract", "brake", "hotel", "dive_time", "climb_time", "surface_time", "inflections", "surfacings",
    "through_water", "over_ground",
    *(f"{log}_{name}" for log in ("surfaced", "surfaced_before", "left", "left_before")
      for name in ("time", "east", "north", "reason")),
)  # fmt: skip
#: Rows of the final state.
FINAL = ("outcome", "steps", "contacts", "end_time", "arrival_0", "arrival_1")


@dataclass(frozen=True)
class Arrays:
    """Everything a yardstick reads: float32 unless a count; ``member`` (row, members), ``keys`` (2, members)."""

    plan: np.ndarray
    places: np.ndarray
    counts: np.ndarray
    currents: np.ndarray
    error: np.ndarray
    floor: np.ndarray
    speeds: np.ndarray
    waypoints: np.ndarray
    member: np.ndarray
    keys: np.ndarray
    codes: np.ndarray
    outputs: int


@dataclass(frozen=True)
class Flown:
    """What a yardstick returns: ``records`` (output, row of RECORD, member), ``final`` (row of FINAL, member)."""

    records: np.ndarray
    final: np.ndarray

    def row(self, name: str) -> np.ndarray:
        """One quantity at every output, (output, member)."""
        return self.records[:, RECORD.index(name)]


def arrays_of(run, members) -> Arrays:
    """Flatten a run and its drawn members.

    Raises
    ------
    ValueError : the run has physics that the yardsticks do not.
    """
    plan, shape, field, floor = run.plan, run.shape, run.environment.currents, run.environment.bathymetry
    extra = [t.info.id for t in run.model.terms if not t.info.id.startswith("base.")]
    whole = (shape.speed, shape.rules, shape.loop, shape.waypoint_surfaces, shape.bounded_yos, shape.program)
    if whole != ("constant", ("every",), False, False, False, ()) or shape.waypoints != 2 or extra:
        raise ValueError(f"the yardsticks fly the bundled default mission only, found {shape} and terms {extra}")
    if field.levels != 1 or field.steady or plan.interval.dtype != np.float32:
        raise ValueError("the yardsticks fly in a surface current that varies with time, in single precision")

    def flat(*values):
        return np.concatenate([np.asarray(v, np.float32).ravel() for v in values])

    frame = run.environment.frame
    named = {name: getattr(plan, name) for name in PLAN if hasattr(plan, name)}
    interrupts = np.asarray(plan.interrupts, np.float32)
    # As the step divides an output interval.
    slots = np.rint(np.float32(plan.interval) / np.float32(plan.bundle))
    named |= {
        "slot": plan.interval / slots if slots > 0 else plan.bundle,
        "every": plan.rule_seconds[0],
        "fix_sd": run.spread * run.vehicle.value("perturbation.initial_position"),
        "start_east": run.origin[0],
        "start_north": run.origin[1],
        "half_height": frame.half_height,
        **{f"stretch_east_{i}": frame.east_stretch[i] for i in range(5)},
        **{f"stretch_north_{i}": frame.north_stretch[i] for i in range(5)},
        "breaks_every": interrupts[0],
        "breaks_done": interrupts[shape.reasons.index("mission_done")],
        "breaks_waypoint": interrupts[shape.reasons.index("waypoint")],
    }
    model = members.model
    term = {t.info.id: t for t in model.terms}
    stroke = (plan.climb_volume - plan.dive_volume) / np.asarray(model.body.full_stroke)
    per_member = {
        "cosine": members.turn[0], "sine": members.turn[1], "stay": members.stay, "speed": members.speed,
        "pump": term["base.pump"].intercept * stroke, "pump_per_metre": term["base.pump"].slope * stroke,
        "retract": term["base.retract"].energy * stroke, "brake": term["base.brake"].energy,
        "hotel": term["base.hotel"].power, "surface": term["base.surface"].power,
        "power_dive": members.power[0], "power_climb": members.power[1], "power_surface": members.power[2],
        "per_surfacing": members.per_surfacing, "per_inflection": members.per_inflection,
        "limit": members.energy_limit,
    }  # fmt: skip
    places = flat(field.cells.origin, field.cells.inverse_step, field.first, field.inverse_interval,
                  floor.cells.origin, floor.cells.inverse_step)  # fmt: skip
    counts = [*np.asarray(field.cells.shape), field.frames, *np.asarray(floor.cells.shape), plan.speeds.size]
    return Arrays(
        plan=flat(*(named[name] for name in PLAN)),
        places=places,
        counts=np.array([*counts, shape.waypoints], np.int32),
        currents=np.ascontiguousarray(field.table, np.float32),
        error=np.ascontiguousarray(field.error, np.float32),
        floor=np.ascontiguousarray(floor.table, np.float32),
        speeds=np.ascontiguousarray(plan.speeds, np.float32),
        waypoints=np.ascontiguousarray(plan.waypoints, np.float32),
        member=np.stack([np.asarray(per_member[name], np.float32) for name in MEMBER]),
        keys=np.stack([np.asarray(k, np.uint32) for k in members.key]),
        codes=np.asarray(members.limit_code, np.int32),
        outputs=int(plan.intervals),
    )
