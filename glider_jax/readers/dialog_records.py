"""What was heard from a glider at the surface, as frozen records.

Standard library only. SI units; time as seconds since 1970-01-01T00:00:00Z, NaN where unknown; ages in seconds at
``Surfacing.time``, the newest clock the glider printed in that surfacing. Water velocities are along the glider's own
axes, whose y points to magnetic north: they are not east and north until turned by the magnetic variation.
Names, reasons and errors are the glider's words in printable ASCII: never use them as a path, escape them in markup.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

#: Whether a mission is running: what the newest evidence of a surfacing says.
IN_MISSION, NOT_IN_MISSION, UNKNOWN = "in mission", "not in mission", "unknown"


@dataclass(frozen=True)
class Datum:
    """One sensor as printed: ``value`` in SI (``unit``), measured at ``time``; ``printed`` is what the glider wrote."""

    value: float
    unit: str
    age: float
    time: float
    printed: float
    printed_unit: str


@dataclass(frozen=True)
class Position:
    """A place in degrees, the time it was measured at, and its age."""

    latitude: float
    longitude: float
    age: float
    time: float


@dataclass(frozen=True)
class NextWaypoint:
    """Where the glider is steering to.

    ``printed_range`` m and ``printed_bearing`` rad are the glider's (the bearing may be from true or from magnetic
    north); ``range`` m and ``bearing`` rad from true north are computed from the newest position to the waypoint.
    ``age`` is the glider's own age of the waypoint, to the minute.
    """

    latitude: float
    longitude: float
    range: float = math.nan
    bearing: float = math.nan
    printed_range: float = math.nan
    printed_bearing: float = math.nan
    age: float = math.nan


@dataclass(frozen=True)
class WaterVelocity:
    """A water velocity of the glider, m s-1 along its own axes (``y`` towards magnetic north), and its age."""

    x: float
    y: float
    age: float
    time: float


@dataclass(frozen=True)
class AbortHistory:
    """Aborts since the last reset; words are empty and the time NaN where the glider printed none."""

    total: int | None = None
    cause: str = ""
    details: str = ""
    time: float = math.nan
    segment: str = ""
    mission: str = ""


@dataclass(frozen=True)
class DeviceCounts:
    """Errors, warnings and oddities of all devices: in total, in this mission, in this segment."""

    errors: tuple[int, int, int]
    warnings: tuple[int, int, int]
    oddities: tuple[int, int, int]


@dataclass(frozen=True)
class Dump:
    """One printout of the surface dialog, ages as printed; several make a surfacing.

    ``positions`` maps ``gps``, ``dead_reckoned``, ``too_far`` and ``invalid`` to latitude, longitude and age.
    ``sensors`` maps names to value, unit and age as printed; ``defaults`` those never set since the glider started.
    ``reports`` are later single readings: seconds after ``time``, name, value, unit. ``order`` counts through the log.
    """

    order: int
    vehicle: str = ""
    mission: str = ""
    mission_number: str = ""
    file_number: str = ""
    reason: str = ""
    behavior: str = ""
    start_when: float = math.nan
    time: float = math.nan
    mission_time: float = math.nan
    positions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    sensors: dict[str, tuple[float, str, float]] = field(default_factory=dict)
    defaults: dict[str, tuple[float, str]] = field(default_factory=dict)
    reports: tuple[tuple[float, str, float, str], ...] = ()
    waypoint: tuple[float, float, float, float, float] | None = None
    aborts: dict[str, str] = field(default_factory=dict)
    devices: DeviceCounts | None = None
    errors: tuple[str, ...] = ()
    water_complete: bool | None = None
    time_until_diving: float = math.nan
    state: str = UNKNOWN
    evidence: str = ""
    abort_code: int | None = None
    resumed: bool = False
    lab_mode: bool = False
    garbled: int = 0
    copies: int = 1

    @property
    def dated(self) -> bool:
        """Whether the glider's clock was read."""
        return math.isfinite(self.time)


@dataclass(frozen=True)
class Surfacing:
    """All that one stay at the surface told, the best and newest of its dumps for each datum.

    Attributes
    ----------
    vehicle, mission, mission_number : as the glider names them; empty where not heard.
    time, first_time : newest and oldest clock printed; NaN where no dump was dated. ``mission_time`` s into the
        mission at ``time``.
    reason, behavior, start_when : why it surfaced; the code is that of the ``start_when`` argument, NaN where unknown.
    state : ``in mission``, ``not in mission`` or ``unknown``, and ``evidence`` the words it follows from.
    resumed : True once the glider said that it dives again.
    gps, dead_reckoned, too_far, invalid : positions, each with its age; None where never set or not printed.
    fixes : every distinct GPS fix of this stay, ascending in time.
    sensors : name -> reading; ``defaults`` those that the glider printed as never set since it started.
    waypoint : None where it has none.
    water_velocity : ``m_water_vx`` and ``vy``; ``initial_water_velocity`` and ``final_water_velocity`` where listed.
        ``water_complete`` is True once the glider said that its calculation is complete.
    time_until_diving : s after ``time``; NaN where not printed.
    abort_code : of the prompt, where not in a mission.
    dumps : how many printouts were merged; ``notes`` say what is doubtful.
    """

    vehicle: str
    mission: str
    mission_number: str
    time: float
    first_time: float
    mission_time: float
    reason: str
    behavior: str
    start_when: float
    state: str
    evidence: str
    resumed: bool
    gps: Position | None
    dead_reckoned: Position | None
    too_far: Position | None
    invalid: Position | None
    fixes: tuple[Position, ...]
    sensors: dict[str, Datum]
    defaults: dict[str, Datum]
    waypoint: NextWaypoint | None
    water_velocity: WaterVelocity | None
    initial_water_velocity: WaterVelocity | None
    final_water_velocity: WaterVelocity | None
    water_complete: bool | None
    time_until_diving: float
    aborts: AbortHistory | None
    devices: DeviceCounts | None
    errors: tuple[str, ...]
    abort_code: int | None
    lab_mode: bool
    dumps: int
    notes: tuple[str, ...] = ()

    @property
    def in_mission(self) -> bool:
        """Whether the newest evidence shows a running mission; only then may a dive be forecast."""
        return self.state == IN_MISSION

    @property
    def battery_voltage(self) -> Datum | None:
        """Battery voltage, V."""
        return self.sensors.get("m_battery")

    @property
    def charge_used(self) -> Datum | None:
        """Charge drawn since the counter was set to zero, C."""
        return self.sensors.get("m_coulomb_amphr_total")

    @property
    def charge_since_start(self) -> Datum | None:
        """Charge drawn since the glider was switched on, C."""
        return self.sensors.get("m_coulomb_amphr")

    @property
    def relative_charge(self) -> Datum | None:
        """Share of the entered capacity that is left, 0 to 1."""
        return self.sensors.get("m_lithium_battery_relative_charge")

    @property
    def capacity(self) -> Datum | None:
        """Battery capacity entered by the user, C; a setting counts even if it is as old as the glider."""
        name = "f_coulomb_battery_capacity"
        return self.sensors.get(name) or self.defaults.get(name)

    @property
    def magnetic_variation(self) -> Datum | None:
        """Magnetic variation, rad, west positive."""
        return self.sensors.get("m_gps_mag_var")

    @property
    def last_waypoint(self) -> Position | None:
        """The waypoint reached last, where the glider lists it."""
        lat, lon = self.sensors.get("x_last_wpt_lat"), self.sensors.get("x_last_wpt_lon")
        if lat is None or lon is None or (lat.value == 0.0 and lon.value == 0.0):
            return None
        return Position(lat.value, lon.value, lat.age, lat.time)
