"""The flight model: a set of terms with gates, summed per channel, and what the sums mean together.

Imports the physics layer and the configuration records. Base terms and optional terms of the vehicle file have gate
1; a candidate of the diagnosis has gate 0. What each sum does:

* flight channels give the steady glide; ``PITCH`` is added to the measured pitch first;
* water felt = environment + ``CURRENT_*``; while surfaced ``SURFACE_DRIFT_*`` is added to it;
* a stroke costs its channel's sum x volume moved over the full stroke x exp(``LOG_PUMP_ENERGY``);
* recorded current = true current x exp(``CURRENT_GAIN``) + ``CURRENT_OFFSET``; recorded charge is its integral x
  exp(``CHARGE_GAIN``); recorded depth = true depth + ``PRESSURE_OFFSET``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from glider_jax.config import Quantity, Vehicle
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.physics.flight import Glide, drag_as_fitted, steady_glide
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.library.base import BASE, Body, Hull, InducedDrag, Lift, ParasiteDrag
from glider_jax.physics.perturb import draw_parameters, standard_normal
from glider_jax.physics.term import (
    AbstractTerm,
    Channel,
    ParameterInfo,
    Sample,
    Scalar,
    declared,
    make,
    outputs,
    typical,
)

_GLIDE_STATE = frozenset({"speed_through_water", "angle_of_attack", "glide_angle"})
_GLIDE_CHANNELS = frozenset(
    {Channel.DRAG_COEFFICIENT, Channel.INDUCED_DRAG, Channel.LIFT_SLOPE, Channel.LOG_DRAG, Channel.LOG_LIFT}
    | {Channel.THRUST, Channel.NET_BUOYANCY, Channel.PITCH, Channel.LOG_SPEED}
)
_SPEED_ROUNDS = 4


class Stroke(NamedTuple):
    """Energy of one inflection, J: the pump's and the brake's."""

    pump: Scalar
    brake: Scalar


class FlightModel(eqx.Module):
    """Terms with gates, and the constants of the vehicle's body.

    ``gates`` has shape (terms,): the factor on each term's numbers.
    """

    body: Body
    terms: tuple[AbstractTerm, ...]
    gates: Array

    def has(self, channel: Channel) -> bool:
        """Whether any term feeds a channel; known before tracing."""
        return any(channel in term.info.channels for term in self.terms)

    def total(self, channel: Channel, sample: Sample) -> Scalar:
        """Sum of gate x term in a channel, in the channel's unit; 0 where no term feeds it."""
        return self._sum(channel, self.complete(sample))

    def complete(self, sample: Sample) -> Sample:
        """The sample with the fields that are constants of the vehicle filled in."""
        hull, drag = self._base(Hull), self._base(ParasiteDrag)
        induced, lift = self._base(InducedDrag), self._base(Lift)
        return sample._replace(
            mass=hull.mass,
            hull_volume=hull.volume,
            wing_area=self.body.wing_area,
            parasite_drag=drag.coefficient,
            induced_drag=induced.coefficient,
            lift_slope=lift.slope,
        )

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the terms, in the order of the gates."""
        return tuple(term.info.id for term in self.terms)

    def steady_glide(self, sample: Sample) -> Glide:
        """Steady glide under the sample's pitch, pumped volume and water.

        Terms that read the speed or the angle of attack are met by a few fixed rounds; without any, one round is
        exact.
        """
        sample = self.complete(sample)
        glide = self._glide(sample)
        if self._glide_depends_on_speed():
            for _ in range(_SPEED_ROUNDS):
                sample = sample._replace(
                    speed_through_water=glide.speed_through_water,
                    angle_of_attack=glide.angle_of_attack,
                    glide_angle=glide.glide_angle,
                )
                glide = self._glide(sample)
        return glide

    def glide_reads(self, *fields: str) -> bool:
        """Whether the steady glide depends on any of the named fields of a sample; known before tracing."""
        felt = _GLIDE_CHANNELS | {Channel.VERTICAL_WATER_VELOCITY}
        return any(set(fields).intersection(t.info.reads) and felt.intersection(t.info.channels) for t in self.terms)

    def response_time(self, sample: Sample) -> Scalar:
        """Time constant with which the speed follows its steady value, s."""
        return self.total(Channel.RESPONSE_TIME, sample)

    def true_heading(self, sample: Sample) -> Scalar:
        """Heading the glider really has, rad from true north."""
        return sample.heading + self.total(Channel.HEADING, sample)

    def stroke_energy(self, sample: Sample) -> Stroke:
        """Energy of a dive-to-climb inflection at ``inflection_depth`` that moves ``stroke_volume``."""
        return self._stroke(Channel.PUMP_ENERGY, sample)

    def retract_energy(self, sample: Sample) -> Stroke:
        """Energy of a climb-to-dive inflection at ``inflection_depth`` that moves ``stroke_volume``."""
        return self._stroke(Channel.RETRACT_ENERGY, sample)

    def hotel_power(self, sample: Sample) -> Scalar:
        """Power drawn in every phase, W; ``direction`` says which phase it is."""
        return self.total(Channel.HOTEL_POWER, sample)

    def surface_power(self, sample: Sample) -> Scalar:
        """Power drawn on top of the hotel load while surfaced, W."""
        return self.total(Channel.SURFACE_POWER, sample)

    def surfacing_energy(self, sample: Sample) -> Scalar:
        """Energy of one surfacing beyond its powers, J."""
        return self.total(Channel.SURFACING_ENERGY, sample)

    def _base(self, kind: type) -> Any:
        return next(term for term in self.terms if isinstance(term, kind))

    def _sum(self, channel: Channel, sample: Sample) -> Scalar:
        total = jnp.zeros((), self.gates.dtype)
        for index, term in enumerate(self.terms):
            if channel in term.info.channels:
                value = outputs(term, sample)[term.info.channels.index(channel)]
                total = total + self.gates[index] * value
        return total

    def _glide_depends_on_speed(self) -> bool:
        return any(
            _GLIDE_STATE.intersection(term.info.reads) and _GLIDE_CHANNELS.intersection(term.info.channels)
            for term in self.terms
        )

    def _factor(self, channel: Channel, sample: Sample) -> Scalar | float:
        return jnp.exp(self._sum(channel, sample)) if self.has(channel) else 1.0

    def _glide(self, sample: Sample) -> Glide:
        drag = self._factor(Channel.LOG_DRAG, sample)
        return steady_glide(
            net_buoyancy=self._sum(Channel.NET_BUOYANCY, sample),
            pitch=sample.pitch + self._sum(Channel.PITCH, sample),
            density=jnp.asarray(sample.density, self.gates.dtype),
            area=sample.wing_area,
            parasite=self._sum(Channel.DRAG_COEFFICIENT, sample) * drag,
            induced=self._sum(Channel.INDUCED_DRAG, sample) * drag,
            lift=self._sum(Channel.LIFT_SLOPE, sample) * self._factor(Channel.LOG_LIFT, sample),
            stall_angle=self.body.stall_angle,
            thrust=self._sum(Channel.THRUST, sample) if self.has(Channel.THRUST) else None,
            water_up=self._sum(Channel.VERTICAL_WATER_VELOCITY, sample),
            speed_factor=self._factor(Channel.LOG_SPEED, sample),
        )

    def _stroke(self, channel: Channel, sample: Sample) -> Stroke:
        sample = self.complete(sample)
        share = sample.stroke_volume / self.body.full_stroke * self._factor(Channel.LOG_PUMP_ENERGY, sample)
        return Stroke(self._sum(channel, sample) * share, self._sum(Channel.BRAKE_ENERGY, sample))


def build_model(vehicle: Vehicle, *, dtype: Any) -> FlightModel:
    """Make the flight model of a vehicle: the base terms with its numbers, and its optional terms, all with gate 1.

    Parameters
    ----------
    vehicle : as read from a vehicle file; base quantities that it does not name take the base term's default.
    dtype : of every number in the model; samples given to it must have the same.

    Raises
    ------
    ConfigError : a term or parameter of ``vehicle.terms`` is unknown, or its unit is not the declared one.
    """
    known = TERMS_BY_ID

    def base(kind: type) -> Any:
        named = {name: info.quantity for name, info in declared(kind).items()}
        values = {name: vehicle.quantities[q].value for name, q in named.items() if q in vehicle.quantities}
        return make(kind, dtype, **values)

    terms = [base(kind) for kind in BASE]
    for id, quantities in vehicle.terms.items():
        if id not in known:
            raise ConfigError(
                f"{vehicle.name}: unknown term '{id}'.{did_you_mean(id, known)} "
                "List all with: glider-forecast terms."
            )
        values = {name: _si(known[id], name, q, vehicle.name) for name, q in quantities.items()}
        terms.append(make(known[id], dtype, **{name: value for name, (value, _) in values.items()}))
    return FlightModel(base(Body), tuple(terms), jnp.ones((len(terms),), dtype))


def _si(kind: type[AbstractTerm], name: str, quantity: Quantity, where: str) -> tuple[float, float]:
    """Value and sigma of a quantity of the vehicle file in the parameter's SI unit."""
    known = declared(kind)
    if name not in known:
        raise ConfigError(
            f"{where}: term '{kind.info.id}': unknown parameter '{name}'.{did_you_mean(name, known)} "
            f"It has {', '.join(known)}."
        )
    info = known[name]
    if quantity.unit in ("", "1", info.unit):
        factor = 1.0
    elif quantity.unit == info.shown:
        factor = 1.0 / info.shown_per_si
    else:
        raise ConfigError(
            f"{where}: term '{kind.info.id}', parameter '{name}': expected unit '{info.unit}' or '{info.shown}', "
            f"found '{quantity.unit}'. Convert the value."
        )
    return quantity.value * factor, quantity.sigma * factor


def with_candidates(
    model: FlightModel, kinds: Iterable[type[AbstractTerm]], gate: float = 0.0
) -> FlightModel:
    """Add terms of typical strength with one gate; gate 0 leaves every forecast as it was."""
    dtype = model.gates.dtype
    added = tuple(typical(kind, dtype) for kind in kinds)
    gates = jnp.concatenate([model.gates, jnp.full((len(added),), gate, dtype)])
    return FlightModel(model.body, model.terms + added, gates)


def with_gates(model: FlightModel, gates: Array) -> FlightModel:
    """The same terms under other gates, shape (terms,)."""
    return FlightModel(model.body, model.terms, gates)


def _slots(model: FlightModel) -> Iterator[tuple[str, int, str, ParameterInfo]]:
    """Every parameter: its public name, which term it belongs to (-1 for the body), its field and declaration."""
    for index, owner in enumerate((model.body, *model.terms), start=-1):
        for field, info in declared(owner).items():
            name = info.quantity or (f"{owner.info.id}.{field}" if index >= 0 else f"body.{field}")
            yield name, index, field, info


def parameter_infos(model: FlightModel) -> dict[str, ParameterInfo]:
    """What is declared of every parameter, by public name: the vehicle file's for base terms, else ``id.field``."""
    return {name: info for name, _, _, info in _slots(model)}


def parameters(model: FlightModel) -> dict[str, Array]:
    """Value of every parameter that is not a constant, by public name, SI units."""
    owners = (model.body, *model.terms)
    return {n: getattr(owners[i + 1], f) for n, i, f, info in _slots(model) if info.role != "constant"}


def with_parameters(model: FlightModel, values: Mapping[str, Array]) -> FlightModel:
    """The model with some parameters, by public name, set to other values.

    Raises
    ------
    ConfigError : a name is not a parameter of the model.
    """
    places = {name: (index, field) for name, index, field, _ in _slots(model)}
    for name in values:
        if name not in places:
            raise ConfigError(f"model: unknown parameter '{name}'.{did_you_mean(name, places)}")

    def pick(m: FlightModel) -> list[Array]:
        owners = (m.body, *m.terms)
        return [getattr(owners[places[name][0] + 1], places[name][1]) for name in values]

    if not values:
        return model
    host = isinstance(model.gates, np.ndarray)
    convert = np.asarray if host else jnp.asarray
    return eqx.tree_at(pick, model, [convert(v, model.gates.dtype) for v in values.values()])


def sigmas(model: FlightModel, vehicle: Vehicle) -> dict[str, float]:
    """1-sigma uncertainty of every uncertain parameter by public name, SI units, from the vehicle file."""
    found = {}
    for name, index, field, _ in _slots(model):
        if name in vehicle.quantities:
            found[name] = vehicle.quantities[name].sigma
        elif index >= 0:
            kind = type(model.terms[index])
            quantity = vehicle.terms.get(kind.info.id, {}).get(field)
            found[name] = 0.0 if quantity is None else _si(kind, field, quantity, vehicle.name)[1]
    return {name: sigma for name, sigma in found.items() if sigma > 0.0}


def draw(model: FlightModel, vehicle: Vehicle, key: Array, spread: float = 1.0) -> FlightModel:
    """Draw one member's model from the vehicle's uncertainties; vmap over keys for an ensemble.

    Every parameter has its own stream, folded in from a number made of its name, so adding one never shifts the
    others. A positive parameter is drawn log-normal with the stated mean and sigma; a signed one normal. Parameters
    in a covariance block are drawn jointly normal, and a positive one among them is kept above a hundredth of its
    mean. A parameter with sigma 0 keeps its value.

    Parameters
    ----------
    vehicle : where sigmas and covariance blocks are taken from.
    key : one member's key. spread : factor on all uncertainties.

    Raises
    ------
    ConfigError : a covariance block names an unknown quantity, or is not positive semi-definite.
    """
    dtype = model.gates.dtype
    return with_parameters(model, _drawn(model, vehicle, lambda name: standard_normal(key, name, dtype), spread, jnp))


def draw_batch(
    model: FlightModel, vehicle: Vehicle, normal: Callable[[str], np.ndarray], count: int, spread: float = 1.0
) -> FlightModel:
    """Draw many members on the host, by the laws of :func:`draw`; every leaf gets a leading dimension of ``count``.

    Parameters
    ----------
    normal : gives (count,) standard normal numbers of a parameter's name.
    """
    dtype = np.dtype(model.gates.dtype)
    values = {n: v.astype(dtype) for n, v in _drawn(model, vehicle, normal, spread, np).items()}
    model = jax.tree.map(lambda leaf: np.broadcast_to(np.asarray(leaf), (count, *np.shape(leaf))), model)
    return with_parameters(model, values)


def _drawn(model, vehicle, normal, spread, xp):
    infos = parameter_infos(model)
    known = set(infos) | set(vehicle.quantities)
    for block in vehicle.covariances:
        for name in block.names:
            if name not in known:
                raise ConfigError(f"{vehicle.name}: covariance: unknown '{name}'.{did_you_mean(name, known)}")
    means = parameters(model)
    drawn = draw_parameters(
        means=means if xp is jnp else {name: np.asarray(value, float) for name, value in means.items()},
        sigmas=sigmas(model, vehicle),
        positive=frozenset(name for name, info in infos.items() if info.positive),
        blocks=vehicle.covariances,
        normal=normal,
        spread=spread,
        xp=xp,
    )
    pitch = fitted_pitch(vehicle)
    if pitch > 0.0 and set(FITTED[1:]) & set(drawn):
        given = tuple(xp.asarray(means[name]) for name in FITTED)
        lift, induced = (drawn.get(name, means[name]) for name in FITTED[1:])
        share = drag_as_fitted(lift, induced, given=given, pitch=xp.asarray(pitch), xp=xp) / given[0]
        drawn[FITTED[0]] = drawn.get(FITTED[0], given[0]) * share
    return drawn


#: The drag that is fitted to vertical speed, and what is assumed for it.
FITTED = ("flight.parasite_drag", "flight.lift_slope", "flight.induced_drag")


def fitted_pitch(vehicle: Vehicle) -> float:
    """Pitch in rad of the glides that the vehicle's drag was fitted to, 0 where it was found another way."""
    known = vehicle.quantities.get("flight.drag_fitted_at_pitch")
    return 0.0 if known is None else known.value


def cast(model: FlightModel, dtype: Any) -> FlightModel:
    """The same model in another precision."""

    def convert(leaf: Any) -> Any:
        floating = eqx.is_array(leaf) and np.issubdtype(leaf.dtype, np.floating)
        return leaf.astype(dtype) if floating else leaf

    return jax.tree.map(convert, model)
