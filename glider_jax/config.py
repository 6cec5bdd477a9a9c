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
    "every",
    "after",
    "no_comms",
    "waypoint",
    "utc",
    "mission_done",
    "yo_done",
    "inflections",
    "waypoint_distance",
    "science",
)


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
class Mission:
    """A mission as flown.

    ``start`` UTC seconds since 1970, None where the mission does not say. ``waypoints`` are (latitude, longitude) in
    degrees in the order flown; ``start_position`` is where the glider lies at ``start``. ``legs`` -1 loops over the
    list for ever, -2 flies it once, N flies N legs. ``first_waypoint`` is the index flown to first; None takes the
    closest. ``surface_stay`` s at the surface per call. ``current_correction`` aims off for the glider's own estimate
    of the current. ``unsupported`` lists what the files name and the simulator leaves out; it is printed.
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
