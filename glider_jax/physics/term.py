"""What a physics term is: one pure function with its equation, unknowns, units and source attached.

Imports JAX and Equinox only. A newcomer would get two things wrong. Channels *add*, so a factor goes through the
logarithm channels. And a :class:`Sample` is one moment of one glider: every field is a scalar, callers vmap.
Signs: depth down, pitch nose up, vertical water velocity up, ``direction`` +1 climb, -1 dive, 0 at the surface.
"""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

Scalar: TypeAlias = Array

PER_DAY = 86400.0
DEGREE = 180.0 / math.pi
#: Supports of numbers: any, and those that cannot be negative.
ANY = (-math.inf, math.inf)
NEVER_NEGATIVE = (0.0, math.inf)


class Channel(Enum):
    """Where a term's number goes; the value is its name and unit. See :mod:`glider_jax.physics.model` for the sums."""

    NET_BUOYANCY = ("net buoyancy, buoyancy minus weight, up", "N")
    DRAG_COEFFICIENT = ("parasite drag coefficient C_D0", "1")
    INDUCED_DRAG = ("drag coefficient per squared angle of attack C_D1", "rad-2")
    LIFT_SLOPE = ("lift coefficient per angle of attack", "rad-1")
    LOG_DRAG = ("logarithm of a factor on the whole drag", "1")
    LOG_LIFT = ("logarithm of a factor on the lift", "1")
    THRUST = ("push along the path", "N")
    PITCH = ("angle added to the measured pitch to get the true one", "rad")
    RESPONSE_TIME = ("time in which the speed approaches its steady value", "s")
    VERTICAL_WATER_VELOCITY = ("vertical water velocity, up", "m s-1")
    CURRENT_EAST = ("water velocity beyond what the environment gives, east", "m s-1")
    CURRENT_NORTH = ("water velocity beyond what the environment gives, north", "m s-1")
    SURFACE_DRIFT_EAST = ("drift beyond the water's while surfaced, east", "m s-1")
    SURFACE_DRIFT_NORTH = ("drift beyond the water's while surfaced, north", "m s-1")
    HEADING = ("angle added to the indicated heading to get the true one", "rad")
    LOG_SPEED = ("logarithm of a factor on the horizontal speed through the water", "1")
    PUMP_ENERGY = ("energy of a full dive-to-climb stroke", "J")
    RETRACT_ENERGY = ("energy of a full climb-to-dive stroke", "J")
    BRAKE_ENERGY = ("energy of an inflection beside the pump: brake, pitch motor", "J")
    SURFACING_ENERGY = ("energy of a surfacing, whatever its length", "J")
    LOG_PUMP_ENERGY = ("logarithm of a factor on both strokes", "1")
    HOTEL_POWER = ("power drawn all the time", "W")
    SURFACE_POWER = ("power on top while surfaced", "W")
    VOLTAGE = ("voltage added to the open-circuit voltage", "V")
    LOG_CAPACITY = ("logarithm of a factor on the usable charge", "1")
    CURRENT_GAIN = ("logarithm of recorded over true current", "1")
    CURRENT_OFFSET = ("recorded minus true current", "A")
    CHARGE_GAIN = ("logarithm of recorded charge over the integral of the recorded current", "1")
    PRESSURE_OFFSET = ("recorded minus true depth", "m")
    TURN_DEPTH = ("depth beyond the commanded one at which a half yo turns, down", "m")
    WATER_DEPTH = ("water depth beyond the chart's, down", "m")
    SURFACE_INTERVAL = ("time at the surface beyond the planned one", "s")

    @property
    def unit(self) -> str:
        """SI unit of a term's number in this channel."""
        return self.value[1]


class Sample(NamedTuple):
    """One moment of one glider and its water, SI units and radians; callers vmap over samples.

    A caller fills what it knows and leaves the rest at defaults under which every term is finite. The fields after
    ``hull_volume`` are constants of the vehicle: :meth:`FlightModel.complete` fills them from the base terms.

    Attributes
    ----------
    time, elapsed : s since t0 of the run; s since the deployment began (growth, wear and leaks count from there).
    depth, depth_rate : m down and m s-1 down.
    sea_pressure : Pa above the atmosphere. temperature : K, in situ. density, reference_density : kg m-3.
    pitch : rad, as measured, nose up. roll : rad. turn_rate : rad s-1.
    direction : +1 climb, -1 dive, 0 surface.
    buoyancy_volume : m3 pumped, positive lighter, 0 at the neutral setting.
    speed_through_water, angle_of_attack, glide_angle : m s-1 along the path, rad, rad (sign of the pitch).
    heading : rad clockwise from true north as indicated.
    surface_current_east, surface_current_north : m s-1, the surface product's. wind_east, wind_north : m s-1.
    bottom_depth, height_above_bottom, east, north : m. latitude : rad. gravity : m s-2.
    stroke_volume : m3 moved in one pump event. inflection_depth : m.
    voltage, current, state_of_charge, battery_temperature : V, A, 1, K.
    surface_duration : s spent at the surface in this surfacing, or the last. time_since_surfacing : s since it left
        the surface, 0 while up. time_since_inflection : s since the last turn.
    fin_rate : rad s-1, mean absolute rate of the rudder. inflections : count since the deployment began.
    thruster_power : W. mass, hull_volume, wing_area, parasite_drag, induced_drag, lift_slope : of the base model.
    """

    time: Any = 0.0
    elapsed: Any = 0.0
    depth: Any = 0.0
    depth_rate: Any = 0.0
    sea_pressure: Any = 0.0
    temperature: Any = 288.15
    density: Any = 1025.0
    reference_density: Any = 1025.0
    pitch: Any = 0.0
    roll: Any = 0.0
    turn_rate: Any = 0.0
    direction: Any = 0.0
    buoyancy_volume: Any = 0.0
    speed_through_water: Any = 0.35
    angle_of_attack: Any = 0.0
    glide_angle: Any = 0.0
    heading: Any = 0.0
    surface_current_east: Any = 0.0
    surface_current_north: Any = 0.0
    wind_east: Any = 0.0
    wind_north: Any = 0.0
    bottom_depth: Any = 1000.0
    height_above_bottom: Any = 1000.0
    east: Any = 0.0
    north: Any = 0.0
    latitude: Any = 0.7
    gravity: Any = 9.81
    stroke_volume: Any = 460e-6
    inflection_depth: Any = 0.0
    voltage: Any = 14.0
    current: Any = 0.0
    state_of_charge: Any = 1.0
    battery_temperature: Any = 288.15
    surface_duration: Any = 0.0
    time_since_surfacing: Any = 0.0
    time_since_inflection: Any = 0.0
    fin_rate: Any = 0.0
    inflections: Any = 0.0
    thruster_power: Any = 0.0
    mass: Any = 60.0
    hull_volume: Any = 0.06
    wing_area: Any = 0.1
    parasite_drag: Any = 0.15
    induced_drag: Any = 10.5
    lift_slope: Any = 7.5

    @classmethod
    def of(cls, dtype: Any, **fields: Any) -> Sample:
        """A sample whose fields, given or default, are arrays of one dtype."""
        values = cls(**fields)
        return cls(*(jnp.asarray(value, dtype) for value in values))


SAMPLE_UNITS: dict[str, str] = {
    "time": "s", "elapsed": "s", "depth": "m", "depth_rate": "m s-1", "sea_pressure": "Pa", "temperature": "K",
    "density": "kg m-3", "reference_density": "kg m-3", "pitch": "rad", "roll": "rad", "turn_rate": "rad s-1",
    "direction": "1", "buoyancy_volume": "m3", "speed_through_water": "m s-1", "angle_of_attack": "rad",
    "glide_angle": "rad", "heading": "rad", "surface_current_east": "m s-1", "surface_current_north": "m s-1",
    "wind_east": "m s-1", "wind_north": "m s-1", "bottom_depth": "m", "height_above_bottom": "m", "east": "m",
    "north": "m", "latitude": "rad", "gravity": "m s-2", "stroke_volume": "m3", "inflection_depth": "m",
    "voltage": "V", "current": "A", "state_of_charge": "1", "battery_temperature": "K", "surface_duration": "s",
    "time_since_surfacing": "s", "time_since_inflection": "s", "fin_rate": "rad s-1", "inflections": "1",
    "thruster_power": "W", "mass": "kg", "hull_volume": "m3", "wing_area": "m2", "parasite_drag": "1",
    "induced_drag": "rad-2", "lift_slope": "rad-1",
}  # fmt: skip


@dataclass(frozen=True)
class Normal:
    """Prior of a signed or bounded number; ``sd`` is a typical size of the effect."""

    mean: float
    sd: float
    lower: float = -math.inf
    upper: float = math.inf

    @property
    def centre(self) -> float:
        """Value taken where nobody says otherwise."""
        return self.mean

    def draw(self, key: Array, dtype: Any) -> Scalar:
        """One value; outside the bounds it is set to the bound."""
        value = self.mean + self.sd * jax.random.normal(key, (), dtype)
        return jnp.clip(value, self.lower, self.upper)


@dataclass(frozen=True)
class LogNormal:
    """Prior of a positive number known to within a factor."""

    median: float
    factor: float

    @property
    def centre(self) -> float:
        """Value taken where nobody says otherwise."""
        return self.median

    @property
    def sd(self) -> float:
        """Standard deviation in the number's unit, for small factors."""
        return self.median * math.log(self.factor)

    def draw(self, key: Array, dtype: Any) -> Scalar:
        """One value."""
        return self.median * jnp.exp(math.log(self.factor) * jax.random.normal(key, (), dtype))


@dataclass(frozen=True)
class Fixed:
    """A number that is known: a constant of nature, a frequency, a reference level."""

    value: float

    @property
    def centre(self) -> float:
        """The value."""
        return self.value

    @property
    def sd(self) -> float:
        """Zero: nothing is unknown."""
        return 0.0

    def draw(self, key: Array, dtype: Any) -> Scalar:
        """The value, whatever the key."""
        return jnp.asarray(self.value, dtype)


Prior: TypeAlias = Normal | LogNormal | Fixed


@dataclass(frozen=True)
class ParameterInfo:
    """What is declared of one unknown of a term.

    ``role`` is ``amplitude`` (the effect vanishes where all amplitudes of a term are zero), ``shape`` (a period, a
    depth scale: without meaning until an amplitude is not zero) or ``constant``. ``shown`` is the unit in reports
    and ``shown_per_si`` the factor to it. ``quantity`` is the name in the vehicle file of a base parameter.
    ``support`` is what physics allows, lower and upper, in ``unit``: an inference finds nothing outside. ``looks`` are
    values beside zero at which an effect far from linear is looked at.
    """

    name: str
    prior: Prior
    unit: str
    text: str
    source: str
    role: str
    shown: str
    shown_per_si: float
    quantity: str = ""
    support: tuple[float, float] = ANY
    looks: tuple[float, ...] = ()

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper limit of the number: of its support and of its prior, whichever is narrower."""
        lower, upper = self.support
        if isinstance(self.prior, LogNormal):
            lower = max(lower, 0.0)
        return (
            max(lower, getattr(self.prior, "lower", -math.inf)),
            min(upper, getattr(self.prior, "upper", math.inf)),
        )

    @property
    def positive(self) -> bool:
        """Whether the number cannot be zero or negative."""
        return isinstance(self.prior, LogNormal) or getattr(self.prior, "lower", -math.inf) >= 0.0


_KEY = "glider_jax.parameter"


def parameter(
    prior: Prior,
    *,
    unit: str,
    text: str,
    source: str,
    role: str = "amplitude",
    shown: str | None = None,
    shown_per_si: float = 1.0,
    quantity: str = "",
    support: tuple[float, float] = ANY,
    looks: tuple[float, ...] = (),
) -> Any:
    """Declare an unknown of a term: a scalar leaf with its prior, SI unit, meaning and source.

    Left out when the term is made, it takes the prior's centre. A number is converted to an array; an array keeps its
    dtype, so a term computes in the precision of its parameters.
    """
    declared = dict(
        prior=prior, unit=unit, text=text, source=source, role=role, shown=shown or unit,
        shown_per_si=shown_per_si, quantity=quantity, support=support, looks=looks,
    )  # fmt: skip
    return eqx.field(default=prior.centre, converter=_as_leaf, metadata={_KEY: declared})


def constant(value: float, *, unit: str, text: str, source: str) -> Any:
    """Declare a number with a unit that is known and is neither drawn nor fitted."""
    return parameter(Fixed(value), unit=unit, text=text, source=source, role="constant")


def reference_temperature() -> Any:
    """Declare the temperature about which temperature effects are stated, 288.15 K."""
    return constant(288.15, unit="K", text="temperature without effect", source="convention, 15 degC")


def _as_leaf(value: Any) -> Any:
    return jnp.asarray(value) if isinstance(value, int | float) else value


@dataclass(frozen=True)
class TermInfo:
    """What is said of a term.

    ``id`` is its public name, ``channels`` what it feeds (two for a vector), ``equation`` LaTeX, ``reads`` the sample
    fields used, ``valid`` the range in words, ``reference`` where it comes from, ``plain`` one sentence for a pilot,
    ``confusable_with`` ids of effects that leave nearly the same trace, ``decided_by`` what would tell them apart.
    """

    id: str
    channels: tuple[Channel, ...]
    equation: str
    reads: tuple[str, ...]
    valid: str
    reference: str
    plain: str
    confusable_with: tuple[str, ...] = ()
    decided_by: str = ""
    title: str = ""


class AbstractTerm(eqx.Module):
    """One piece of physics: reads a sample, returns a number in its channel's unit, or one per channel of a vector.

    A term is pure, and finite with finite derivatives wherever its fields are finite.
    """

    info: eqx.AbstractClassVar[TermInfo]

    @abstractmethod
    def __call__(self, sample: Sample) -> Scalar | tuple[Scalar, ...]:
        """The term's number at one moment; a tuple in the order of ``info.channels`` if there are several."""


def declared(term: AbstractTerm | type[AbstractTerm]) -> dict[str, ParameterInfo]:
    """Return what a term declares of its parameters, by field name, in order."""
    return {
        field.name: ParameterInfo(field.name, **field.metadata[_KEY])
        for field in dataclasses.fields(term)
        if _KEY in field.metadata
    }


def make(kind: type[AbstractTerm], dtype: Any, **values: Any) -> AbstractTerm:
    """Make a term whose leaves are arrays of one dtype; parameters not given take their prior's centre."""
    filled = {name: values.get(name, info.prior.centre) for name, info in declared(kind).items()}
    return kind(**{name: jnp.asarray(value, dtype) for name, value in filled.items()})


def typical(kind: type[AbstractTerm], dtype: Any) -> AbstractTerm:
    """Make a term of typical strength: amplitudes one prior sd above the prior's mean."""
    amplitudes = {n: p.prior.centre + p.prior.sd for n, p in declared(kind).items() if p.role == "amplitude"}
    return make(kind, dtype, **amplitudes)


def outputs(term: AbstractTerm, sample: Sample) -> tuple[Scalar, ...]:
    """Evaluate a term and return its numbers as a tuple, one per channel."""
    value = term(sample)
    return value if isinstance(value, tuple) else (value,)


def positive_part(x: Scalar) -> Scalar:
    """``max(x, 0)`` with derivative 0 at and below 0."""
    return jnp.where(x > 0, x, jnp.zeros_like(x))


def safe_sqrt(x: Scalar) -> Scalar:
    """Square root of the positive part, with derivative 0 where x is not positive."""
    inside = x > 0
    return jnp.where(inside, jnp.sqrt(jnp.where(inside, x, jnp.ones_like(x))), jnp.zeros_like(x))
