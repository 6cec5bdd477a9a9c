"""What the user says of a vehicle and a mission, as frozen, checked records.

Standard library and NumPy only. The TOML and Slocum readers that fill these records live in ``readers``; this module
holds the records and the checks that need no file. SI units and radians throughout; sentences for the user say
degrees where pilots do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from glider_jax.records import Source


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
    pump_climb_to_dive J, brake J, surface W. ``perturbation.*``: spread of what is not the vehicle's: heading rad,
    current_error m s-1, current_error_time s, initial_position m. ``terms`` holds optional physics by id, each a map
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
    ``when_yo_ends`` lets the yo finish instead of interrupting it. ``ends_mission`` for the last surfacing.
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
