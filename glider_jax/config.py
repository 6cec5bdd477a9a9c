"""What the user says of a vehicle and a mission, as frozen, checked records.

Standard library and NumPy only. The TOML and Slocum readers that fill these records live in ``readers``; this module
holds the records and the checks that need no file. SI units and radians throughout; sentences for the user say
degrees where pilots do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.records import Source

#: Every kind of :class:`SurfaceRule`.
SURFACE_KINDS = (
    "every", "after", "no_comms", "waypoint", "utc", "mission_done", "yo_done", "inflections", "waypoint_distance",
    "science",
)  # fmt: skip

#: Conditions of a mission program: what is compared, its SI unit, and +1 where more meets it, -1 less, 0 the same.
PROGRAM_CONDITIONS: dict[str, tuple[str, str, int]] = {
    "state_of_charge_below": ("state_of_charge", "1", -1),
    "state_of_charge_above": ("state_of_charge", "1", 1),
    "energy_used_above": ("energy_used", "J", 1),
    "energy_used_below": ("energy_used", "J", -1),
    "elapsed_above": ("elapsed", "s", 1),
    "elapsed_below": ("elapsed", "s", -1),
    "time_after": ("time", "s", 1),
    "time_before": ("time", "s", -1),
    "bottom_shallower_than": ("bottom", "m", -1),
    "bottom_deeper_than": ("bottom", "m", 1),
    "current_faster_than": ("current", "m s-1", 1),
    "current_slower_than": ("current", "m s-1", -1),
    "waypoint_closer_than": ("waypoint_distance", "m", -1),
    "waypoint_farther_than": ("waypoint_distance", "m", 1),
    "flying_to_waypoint": ("flying_to_waypoint", "1", 0),
}
#: What a rule of a mission program may change, as fields of :class:`ProgramRule`.
PROGRAM_ACTIONS = (
    "goto", "dive_to", "climb_to", "altitude", "pitch", "surface_every", "surface_now", "end_mission",
)  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """A number with its 1-sigma uncertainty, unit and source (``judgement`` where nobody measured it)."""

    value: float
    sigma: float = 0.0
    unit: str = "1"
    source: str = ""


@dataclass(frozen=True)
class Device:
    """A consumer of power and the rule that says when it runs.

    Parameters
    ----------
    name, group : what it is, and the energy component it is reported under (``science``, ``steering``, ``navigation``,
        ``communication``, ``instrument``, ``propulsion``, ``hotel``).
    power : W while it runs.
    states : the mission states in which it runs: ``dive``, ``climb``, ``hover``, ``surface``.
    duty : share of the time in those states during which it runs, 0 to 1.
    seconds_per_surfacing : if given, it runs this long at every surfacing instead of by ``states``.
    joules_per_inflection : energy of one action at every inflection, J (pitch motor, altimeter burst).
    sensor_types : Slocum ``sensor_type`` numbers whose ``sample`` behaviour replaces ``states`` and ``duty``.
    minimum_depth, maximum_depth : m, runs only between them.
    """

    name: str
    group: str
    power: Quantity
    states: frozenset[str] = frozenset({"dive", "climb", "surface"})
    duty: float = 1.0
    seconds_per_surfacing: float | None = None
    joules_per_inflection: float = 0.0
    sensor_types: tuple[int, ...] = ()
    minimum_depth: float = 0.0
    maximum_depth: float = float("inf")


@dataclass(frozen=True)
class Battery:
    """A pack: its charge and energy, how its voltage falls, and when a mission must end.

    ``voltage_curve`` are (state of charge 0..1, open-circuit V) points, ascending in state of charge.
    ``capacity`` C and ``energy`` J are the rated values, ``usable_fraction`` the share a plan may count on.
    ``internal_resistance`` ohm. ``temperature_derating`` is the share of capacity lost per kelvin below 288.15 K.
    """

    name: str
    chemistry: str
    capacity: Quantity
    energy: Quantity
    voltage_curve: tuple[tuple[float, float], ...]
    usable_fraction: Quantity = Quantity(0.9, 0.03, "1", "judgement")
    internal_resistance: Quantity = Quantity(0.0, 0.0, "ohm", "judgement")
    temperature_derating: Quantity = Quantity(0.0, 0.0, "K-1", "judgement")
    undervolts: float = 10.0
    reserve_fraction: float = 0.15


@dataclass(frozen=True)
class CovarianceBlock:
    """Joint uncertainty of several vehicle quantities: dotted names and their covariance in the quantities' units."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    source: str = ""


@dataclass(frozen=True)
class Vehicle:
    """One glider as the forecaster flies it.

    ``quantities`` maps dotted names to numbers; every name is listed with unit and default source in
    ``readers.vehicles.QUANTITIES``. ``flight.*``: mass kg, volume m3, wing_area m2, parasite_drag, induced_drag
    rad-2, lift_slope rad-1, pump_volume m3 (commanded plus and minus), pump_rate m3 s-1, hull_compressibility Pa-1,
    thermal_expansion K-1. ``energy.*``: hotel W, pump_dive_to_climb.intercept J, pump_dive_to_climb.slope J m-1,
    pump_dive_to_climb.reference_volume m3 (volume moved from dive to climb for which the line holds),
    pump_climb_to_dive J, brake J, surface W. ``perturbation.*``: spread of what is not the vehicle's: heading rad,
    current_error m s-1, current_error_time s, current_error_length m, initial_position m, speed and surface_stay as
    shares. ``terms`` holds optional physics by id, each a map
    of parameter to Quantity. ``speeds`` names the bundled or given speed distributions by pitch.
    """

    name: str
    quantities: dict[str, Quantity]
    devices: tuple[Device, ...]
    battery: Battery
    covariances: tuple[CovarianceBlock, ...] = ()
    terms: dict[str, dict[str, Quantity]] = field(default_factory=dict)
    speeds: dict[str, Any] = field(default_factory=dict)
    source: Source = Source("default")
    assumed: tuple[str, ...] = ()

    def value(self, name: str) -> float:
        """The value of a quantity by its dotted name."""
        return self.quantities[name].value


@dataclass(frozen=True)
class Yo:
    """Between what depths and how the glider saws; pitches are magnitudes in rad, volumes m3 from neutral.

    ``dive_altitude`` m above the seafloor at which a dive turns, None where the altimeter is not used.
    ``half_cycles`` limits the number of half yos per segment, None for no limit. ``overshoot`` None lets the
    simulator work out how far an inflection runs past its depth from the vertical speed.
    """

    dive_to: float
    climb_to: float
    dive_pitch: float
    climb_pitch: float
    dive_altitude: float | None = 5.0
    climb_altitude: float | None = None
    dive_volume: float | None = None
    climb_volume: float | None = None
    half_cycles: int | None = None
    overshoot: float | None = None


@dataclass(frozen=True)
class SurfaceRule:
    """When the glider comes up.

    ``kind``: ``every`` (seconds from the start of the previous surfacing), ``after`` (seconds from its end),
    ``no_comms`` (seconds since the last contact), ``waypoint`` (a waypoint was reached), ``utc`` (at ``time``,
    repeated each ``seconds`` if positive), ``mission_done`` (no waypoint left), ``yo_done``, ``inflections``
    (after ``count``), ``waypoint_distance`` (closer than ``distance``), ``science``.
    ``when_yo_ends`` lets the yo finish instead of interrupting it: a dive goes on to its depth, and the first climb
    that begins once the rule holds goes on to the surface. ``ends_mission`` for the last surfacing.
    ``climb_pitch`` rad of the ascent, None for the yo's own.
    """

    kind: str
    seconds: float = 0.0
    time: float | None = None
    count: int = 0
    distance: float = 0.0
    when_yo_ends: bool = False
    ends_mission: bool = False
    climb_pitch: float | None = None
    name: str = ""


@dataclass(frozen=True)
class SampleRule:
    """Which science sensors run in which states, and how often (``interval`` s, 0 for as fast as possible)."""

    sensor_type: int
    states: frozenset[str]
    interval: float = 0.0
    minimum_depth: float = -5.0
    maximum_depth: float = 2000.0
    every_nth_yo: int = 1


@dataclass(frozen=True)
class Aborts:
    """Limits at which the vehicle gives up its mission; None where the mission does not set one."""

    overdepth: float | None = None
    overtime: float | None = None
    undervolts: float | None = None
    same_depth_for: float | None = None
    stalled_for: float | None = None
    no_comms_for: float | None = None
    maximum_waypoint_distance: float | None = None
    remaining_charge: float | None = None


@dataclass(frozen=True)
class Condition:
    """One comparison: ``kind`` of :data:`PROGRAM_CONDITIONS` and the SI ``value`` compared with, waypoints from 1."""

    kind: str
    value: float


@dataclass(frozen=True)
class ProgramRule:
    """One rule of a mission program: ``when`` all conditions hold, the rest is done; None and False change nothing.

    Conditions are looked at where a glider can: at the end of a yo (of a bundle of short ones) and at the surface.
    ``goto`` a place (latitude, longitude) or ``home``, the start: the mission ends there; or a waypoint of the list by
    number from 1, or ``next``: the list goes on from it. ``dive_to``, ``climb_to``, ``altitude`` m and ``pitch`` rad
    replace the yo's, ``surface_every`` s the period of rules ``every`` and ``after`` from the next dive on.
    ``surface_now`` comes up, ``end_mission`` comes up for good. ``once`` stays in force when it has acted; else it
    holds only while its conditions do, and what was before returns.
    """

    when: tuple[Condition, ...]
    name: str = ""
    goto: tuple[float, float] | str | int | None = None
    dive_to: float | None = None
    climb_to: float | None = None
    altitude: float | None = None
    pitch: float | None = None
    surface_every: float | None = None
    surface_now: bool = False
    end_mission: bool = False
    once: bool = True

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of what the rule changes."""
        given = {name: getattr(self, name) for name in PROGRAM_ACTIONS}
        return tuple(name for name, value in given.items() if value is not None and value is not False)


@dataclass(frozen=True)
class Mission:
    """A mission as flown.

    ``start`` UTC seconds since 1970, None where the mission does not say. ``waypoints`` are (latitude, longitude) in
    degrees in the order flown; ``start_position`` is where the glider lies at ``start``. ``legs`` -1 loops over the
    list for ever, -2 flies it once, N flies N legs. ``first_waypoint`` is the index flown to first; None takes the
    closest. ``surface_stay`` s at the surface per call. ``current_correction`` aims off for the glider's own estimate
    of the current. ``unsupported`` lists what the files name and the simulator leaves out; it is printed.
    ``program`` are rules on what the mission meets, the first that sets something wins.
    """

    name: str
    waypoints: tuple[tuple[float, float], ...]
    yo: Yo
    surface: tuple[SurfaceRule, ...]
    start: float | None = None
    start_position: tuple[float, float] | None = None
    waypoint_radius: float = 500.0
    legs: int = -2
    first_waypoint: int | None = 0
    surface_stay: float = 900.0
    samples: tuple[SampleRule, ...] = ()
    aborts: Aborts = Aborts()
    current_correction: bool = True
    unsupported: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    source: Source = Source("default")
    program: tuple[ProgramRule, ...] = ()


def check_vehicle(vehicle: Vehicle, where: str = "vehicle") -> None:
    """Refuse a vehicle whose numbers contradict each other.

    Raises
    ------
    ConfigError : a covariance is not symmetric or not positive semi-definite, or names an unknown quantity; mass and
        volume do not float; the voltage curve does not ascend in state of charge.
    """
    for block in vehicle.covariances:
        label = f"{where}: covariance of {', '.join(block.names)}"
        for name in block.names:
            if name not in vehicle.quantities:
                raise ConfigError(f"{label}: unknown quantity '{name}'.{did_you_mean(name, vehicle.quantities)}")
        matrix = np.asarray(block.matrix, dtype=float)
        n = len(block.names)
        if matrix.shape != (n, n):
            raise ConfigError(f"{label}: expected {n} rows of {n} numbers, found shape {matrix.shape}. Correct it.")
        diagonal = np.diag(matrix)
        if (diagonal < 0.0).any():
            raise ConfigError(f"{label}: expected variances of at least 0, found {diagonal.min():g}. Correct it.")
        # Scaled to correlations, so that units of very different size are judged alike.
        scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        scaled = matrix / np.outer(scale, scale)
        if not np.allclose(scaled, scaled.T, rtol=0.0, atol=1e-9):
            raise ConfigError(f"{label}: expected a symmetric matrix, found one that is not. Correct it.")
        smallest = float(np.linalg.eigvalsh(scaled).min())
        if smallest < -1e-9:
            raise ConfigError(
                f"{label}: expected a positive semi-definite matrix, found an eigenvalue of {smallest:.3g} after "
                "scaling to correlations. A correlation beyond 1 is the usual reason."
            )
    density = vehicle.value("flight.mass") / vehicle.value("flight.volume")
    if not 900.0 <= density <= 1100.0:
        raise ConfigError(
            f"{where}: mass {vehicle.value('flight.mass'):g} kg over volume {vehicle.value('flight.volume'):g} m3: "
            f"expected the density of water, 900 to 1100 kg m-3, found {density:.1f}. Check both and their units."
        )
    curve = vehicle.battery.voltage_curve
    if len(curve) < 2 or any(b[0] <= a[0] for a, b in zip(curve, curve[1:], strict=False)):
        raise ConfigError(f"{where}: battery: expected a voltage curve that ascends in state of charge. Correct it.")


def check_mission(mission: Mission, where: str = "mission") -> None:
    """Refuse a mission that contradicts itself or cannot be flown.

    Raises
    ------
    ConfigError : depths, pitches, positions, radius, times or rules are out of range or contradictory.
    """
    yo = mission.yo
    if not yo.climb_to < yo.dive_to:
        raise ConfigError(
            f"{where}: expected dive_to deeper than climb_to, found dive_to {yo.dive_to:g} m and climb_to "
            f"{yo.climb_to:g} m. Correct one of them."
        )
    if yo.climb_to < 0.0 or yo.dive_to > 7000.0:
        raise ConfigError(f"{where}: expected depths of 0 to 7000 m, found {yo.climb_to:g} to {yo.dive_to:g} m.")
    pitches = {"dive pitch": yo.dive_pitch, "climb pitch": yo.climb_pitch}
    pitches |= {f"climb pitch of surface rule {i}": r.climb_pitch for i, r in enumerate(mission.surface, 1)}
    for name, pitch in pitches.items():
        if pitch is not None and not 4.999 <= np.degrees(pitch) <= 60.001:
            raise ConfigError(
                f"{where}: {name}: expected a magnitude of 5 to 60 degrees, found {np.degrees(pitch):.1f}. Correct it."
            )
    for name in ("dive_altitude", "dive_volume", "climb_volume", "overshoot"):
        value = getattr(yo, name)
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise ConfigError(f"{where}: {name}: expected at least 0, found {value:g}. Correct it.")
    if yo.half_cycles is not None and yo.half_cycles < 1:
        raise ConfigError(f"{where}: half_cycles: expected at least 1, found {yo.half_cycles}. Leave it out for ever.")
    if not mission.waypoints:
        raise ConfigError(f"{where}: expected at least one waypoint to fly to, found none. Add waypoints.")
    points = [(f"waypoint {i}", p) for i, p in enumerate(mission.waypoints, 1)]
    if mission.start_position is not None:
        points.append(("start_position", mission.start_position))
    for name, (latitude, longitude) in points:
        if not abs(latitude) <= 90.0:
            raise ConfigError(
                f"{where}: {name}: expected a latitude of -90 to 90 degrees, found {latitude:g}. "
                "Positions are latitude first, in decimal degrees."
            )
        if not abs(longitude) <= 360.0:
            raise ConfigError(f"{where}: {name}: expected a longitude of -360 to 360 degrees, found {longitude:g}.")
    if not mission.waypoint_radius > 0.0:
        raise ConfigError(f"{where}: waypoint_radius: expected more than 0 m, found {mission.waypoint_radius:g}.")
    if mission.legs == 0 or mission.legs < -2:
        raise ConfigError(f"{where}: legs: expected -2 (once), -1 (for ever) or a count from 1, found {mission.legs}.")
    first = mission.first_waypoint
    if first is not None and not 0 <= first < len(mission.waypoints):
        raise ConfigError(
            f"{where}: first_waypoint: expected 0 to {len(mission.waypoints) - 1}, found {first}. Correct it."
        )
    if not 0.0 <= mission.surface_stay <= 7 * 86400.0:
        raise ConfigError(f"{where}: surface_stay: expected 0 s to 7 days, found {mission.surface_stay:g} s.")
    if not mission.surface:
        raise ConfigError(f"{where}: expected a rule that brings the glider up, found none. Add [[surface]].")
    for i, rule in enumerate(mission.surface, 1):
        _check_rule(rule, f"{where}: surface rule {i}")
    for i, sample in enumerate(mission.samples, 1):
        if sample.minimum_depth > sample.maximum_depth:
            raise ConfigError(
                f"{where}: sample rule {i}: expected minimum_depth at most maximum_depth, found "
                f"{sample.minimum_depth:g} m and {sample.maximum_depth:g} m. Correct one of them."
            )
    over = mission.aborts.overdepth
    if over is not None and over <= yo.climb_to:
        raise ConfigError(f"{where}: overdepth of {over:g} m aborts before the yo begins at {yo.climb_to:g} m.")
    for i, program in enumerate(mission.program, 1):
        _check_conditions(program, mission, f"{where}: program rule {i}")
        _check_actions(program, mission, f"{where}: program rule {i}")
        _check_priority(program, mission.program[: i - 1], f"{where}: program rule {i}")


def _check_rule(rule: SurfaceRule, where: str) -> None:
    if rule.kind not in SURFACE_KINDS:
        raise ConfigError(f"{where}: unknown kind '{rule.kind}'.{did_you_mean(rule.kind, SURFACE_KINDS)}")
    if rule.kind in ("every", "after", "no_comms") and not rule.seconds > 0.0:
        raise ConfigError(f"{where}: kind '{rule.kind}' needs seconds above 0, found {rule.seconds:g}. Add it.")
    if rule.kind == "inflections" and rule.count < 1:
        raise ConfigError(f"{where}: kind 'inflections' needs a count from 1, found {rule.count}. Add it.")
    if rule.kind == "waypoint_distance" and not rule.distance > 0.0:
        raise ConfigError(f"{where}: kind 'waypoint_distance' needs a distance above 0 m, found {rule.distance:g}.")
    if rule.kind == "utc" and rule.time is None:
        raise ConfigError(f"{where}: kind 'utc' needs a time, found none. Add it.")
    if rule.seconds < 0.0 or rule.distance < 0.0 or rule.count < 0:
        raise ConfigError(f"{where}: expected seconds, distance and count of at least 0, found less. Correct it.")


def _check_conditions(rule: ProgramRule, mission: Mission, where: str) -> None:
    """Refuse conditions that are unknown, out of range, or never met together."""
    if not rule.when:
        raise ConfigError(f"{where}: expected at least one condition, found none. Add when = {{ ... }}.")
    limits: dict[str, list[float]] = {}
    for condition in rule.when:
        kind, value = condition.kind, condition.value
        if kind not in PROGRAM_CONDITIONS:
            raise ConfigError(f"{where}: unknown condition '{kind}'.{did_you_mean(kind, PROGRAM_CONDITIONS)}")
        quantity, _, side = PROGRAM_CONDITIONS[kind]
        if quantity == "state_of_charge" and not 0.0 < value < 1.0:
            raise ConfigError(f"{where}: {kind}: expected a share above 0 and below 1, found {value:g}. Correct it.")
        if quantity == "flying_to_waypoint" and value not in range(1, len(mission.waypoints) + 1):
            raise ConfigError(f"{where}: {kind}: expected 1 to {len(mission.waypoints)}, found {value:g}. Correct it.")
        if not np.isfinite(value) or value < 0.0:
            raise ConfigError(f"{where}: {kind}: expected a number of at least 0, found {value:g}. Correct it.")
        low, high = limits.setdefault(quantity, [-np.inf, np.inf])
        limits[quantity] = [max(low, value) if side >= 0 else low, min(high, value) if side <= 0 else high]
        low, high = limits[quantity]
        if low > high or (low == high and side != 0):
            raise ConfigError(
                f"{where}: {quantity.replace('_', ' ')}: expected conditions that can be met together, found more than "
                f"{low:g} and less than {high:g}. Correct one of them."
            )
    floor = mission.aborts.remaining_charge
    below = limits.get("state_of_charge", [0.0, 1.0])[1]
    if floor is not None and below <= floor:
        raise ConfigError(
            f"{where}: charge below {below:g}: never met, the mission aborts at {floor:g}. Correct either."
        )


def _check_actions(rule: ProgramRule, mission: Mission, where: str) -> None:
    """Refuse actions that are impossible or contradict the mission or each other."""
    if not rule.actions:
        raise ConfigError(
            f"{where}: expected something to do, found nothing. Known in 'then': {', '.join(PROGRAM_ACTIONS)}."
        )
    goto, count = rule.goto, len(mission.waypoints)
    if isinstance(goto, str) and goto not in ("home", "next"):
        raise ConfigError(
            f"{where}: goto: expected [latitude, longitude], 'home', 'next' or the number of a waypoint, found "
            f"'{goto}'.{did_you_mean(goto, ('home', 'next'))}"
        )
    if isinstance(goto, int) and not 1 <= goto <= count:
        raise ConfigError(f"{where}: goto: expected a waypoint from 1 to {count}, found {goto}. Correct it.")
    if isinstance(goto, tuple) and not (abs(goto[0]) <= 90.0 and abs(goto[1]) <= 360.0):
        raise ConfigError(f"{where}: goto: expected [latitude, longitude] in degrees, found {list(goto)}. Correct it.")
    others = set(rule.actions) - {"end_mission", "surface_now"}
    if rule.end_mission and others:
        raise ConfigError(f"{where}: end_mission leaves nothing to {', '.join(sorted(others))}. Keep one of them.")
    if rule.end_mission and not rule.once:
        raise ConfigError(f"{where}: end_mission with once = false: an end cannot be taken back. Leave 'once' out.")
    for name in ("dive_to", "climb_to", "altitude"):
        value = getattr(rule, name)
        if value is not None and not (np.isfinite(value) and 0.0 <= value <= 7000.0):
            raise ConfigError(f"{where}: {name}: expected 0 to 7000 m, found {value:g}. Correct it.")
    deep = mission.yo.dive_to if rule.dive_to is None else rule.dive_to
    high = mission.yo.climb_to if rule.climb_to is None else rule.climb_to
    if not high < deep:
        raise ConfigError(
            f"{where}: expected dive_to deeper than climb_to, found {deep:g} m and {high:g} m. Correct one of them."
        )
    over = mission.aborts.overdepth
    if over is not None and deep > over:
        raise ConfigError(f"{where}: dive_to of {deep:g} m lies below the overdepth of {over:g} m. Correct either.")
    if rule.pitch is not None and not 4.999 <= np.degrees(rule.pitch) <= 60.001:
        raise ConfigError(f"{where}: pitch: expected 5 to 60 degrees, found {np.degrees(rule.pitch):.1f}. Correct it.")
    every = rule.surface_every
    if every is not None and not every > 0.0:
        raise ConfigError(f"{where}: surface_every: expected more than 0 s, found {every:g}. Correct it.")
    if every is not None and not any(r.kind in ("every", "after") for r in mission.surface):
        raise ConfigError(f"{where}: surface_every: expected a surface rule 'every' or 'after', found none. Add one.")


def _check_priority(rule: ProgramRule, before: tuple[ProgramRule, ...], where: str) -> None:
    """Refuse a rule of which an earlier one takes everything away: the first that sets something wins."""
    for number, other in enumerate(before, 1):
        same = set(other.when) == set(rule.when) and (other.once or not rule.once)
        both = [name for name in rule.actions if name in other.actions and name not in ("surface_now", "end_mission")]
        if same and both:
            raise ConfigError(
                f"{where}: rule {number} has the same conditions and sets {both[0]} already, so this one never does. "
                "Join them, or change a condition."
            )
