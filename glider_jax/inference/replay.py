"""Drive the forecaster's own physics terms with recorded controls: what would have been observed.

Imports JAX and the physics. One smooth pure function of the parameters, without a switch: pitch, pumped volume,
heading, water and surfacing times come from the recording. A newcomer would get wrong: depth is an input as well as an
observation, the density and pressure at the *recorded* depth drive the model and its *rate* is compared; and unknowns
are counted in units of their prior standard deviation, so that every column of a Jacobian is comparable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.config import Vehicle
from glider_jax.inference.streams import Gathered, Inputs, Sizes
from glider_jax.physics.battery import Pack, build_pack
from glider_jax.physics.flight import Glide, steady_glide
from glider_jax.physics.library import LIBRARY
from glider_jax.physics.model import (
    FlightModel,
    build_model,
    parameter_infos,
    parameters,
    sigmas,
    with_candidates,
    with_parameters,
)
from glider_jax.physics.term import Channel, Sample, declared
from glider_jax.records import Array

#: Streams by what predicts them, in order.
MOTION = (
    "vertical speed",
    "displacement east",
    "displacement north",
    "surface drift east",
    "surface drift north",
    "speed through water",
)
POWER = (
    "pump out energy",
    "pump in energy",
    "hotel power, dives",
    "hotel power, climbs",
    "surface power",
    "battery voltage",
    "turn depth",
    "water depth",
    "depth at the surface",
    "surface stay",
    "charge counter",
)

_FLIGHT = frozenset({
    Channel.NET_BUOYANCY, Channel.DRAG_COEFFICIENT, Channel.INDUCED_DRAG, Channel.LIFT_SLOPE, Channel.LOG_DRAG,
    Channel.LOG_LIFT, Channel.THRUST, Channel.PITCH, Channel.RESPONSE_TIME, Channel.VERTICAL_WATER_VELOCITY,
})  # fmt: skip
_COURSE = frozenset({
    Channel.CURRENT_EAST, Channel.CURRENT_NORTH, Channel.SURFACE_DRIFT_EAST, Channel.SURFACE_DRIFT_NORTH,
    Channel.HEADING,
})  # fmt: skip


@dataclass(frozen=True)
class Nuisance:
    """A number beside the physics that is never known exactly and always projected out; ``sd`` in ``unit``."""

    name: str
    sd: float
    unit: str
    group: str
    text: str


NUISANCES: tuple[Nuisance, ...] = (
    Nuisance("inflection way", 0.06, "1", "flight", "way made good while turning, share beyond the model's"),
    Nuisance("gauge at the surface", 0.1, "m", "power", "depth of the pressure gauge while surfaced, about 0.3 m"),
    Nuisance("turn", 3.0, "m", "power", "how far a dive runs past the depth at which it was told to turn"),
    Nuisance("stay", 150.0, "s", "power", "time at the surface beyond the plan"),
    Nuisance("open circuit", 0.05, "V", "power", "open-circuit voltage against the pack's curve"),
    Nuisance("charge", 0.05, "1", "power", "fall of the voltage against the pack's curve, share"),
    Nuisance("chart", 8.0, "m", "power", "water depth against the chart"),
)
GAUGE_DEPTH = 0.3


@dataclass(frozen=True)
class Unknown:
    """One coordinate of the inference: value = centre + scale x z with z standard normal before the data.

    ``kind`` is ``candidate`` (an amplitude of a term of the library), ``calibration`` (a number of the vehicle file
    with a sigma) or ``nuisance``. ``groups`` say which predictions it moves: ``flight``, ``course``, ``power``.
    """

    name: str
    term: str
    kind: str
    centre: float
    scale: float
    groups: frozenset[str]
    lower: float = -np.inf
    upper: float = np.inf


class Replay(eqx.Module):
    """The full model, inputs and unknowns; call :meth:`predict` and :meth:`jacobian` under 64-bit precision."""

    model: FlightModel
    pack: Pack
    inputs: Inputs
    sizes: Sizes = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    unknowns: tuple[Unknown, ...] = eqx.field(static=True)
    streams: tuple[str, ...] = eqx.field(static=True)

    def predict(self, values: Array, shapes: dict[str, Any] | None = None) -> dict[str, Array]:
        """Every stream, for the values of all unknowns (in their units) and of shape parameters."""
        found = _predict(self, jnp.asarray(values), self._whole(shapes))
        return {name: np.asarray(found[name]) for name in self.streams}

    def jacobian(
        self, values: Array, shapes: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Predictions, and their derivatives by all unknowns, (n, unknowns) per unit of each unknown's scale."""
        found, columns = _jacobian(self, jnp.asarray(values), self._whole(shapes))
        pick = {name: np.asarray(found[name]) for name in self.streams}
        return pick, {name: np.asarray(columns[name]) for name in self.streams}

    def _whole(self, shapes: dict[str, Any] | None) -> dict[str, Any]:
        """All shape parameters as arrays, so that other values never trace anew."""
        now = parameters(self.model)
        return {name: jnp.asarray((shapes or {}).get(name, now[name]), jnp.float64) for name in self.shape_names}

    @property
    def shape_names(self) -> tuple[str, ...]:
        """Shape parameters of the candidates, by public name."""
        return tuple(n for n, info in parameter_infos(self.model).items() if info.role == "shape")


def build_replay(gathered: Gathered, vehicle: Vehicle, prior_width: float = 2.0) -> Replay:
    """Make the replay of a gathered recording: the vehicle's model with every term of the library at zero strength.

    Parameters
    ----------
    prior_width : prior sd of a candidate's amplitude in units of its typical size.
    """
    base = build_model(vehicle, dtype=np.float64)
    candidates = [kind for kind in LIBRARY if kind.info.id not in base.ids]
    model = with_candidates(base, candidates, gate=1.0)
    zeros, unknowns = {}, []
    for kind in candidates:
        for name, info in declared(kind).items():
            public = f"{kind.info.id}.{name}"
            if info.role == "shape":
                zeros[public] = info.prior.centre
            if info.role != "amplitude":
                continue
            zeros[public] = 0.0
            lower, upper = getattr(info.prior, "lower", -np.inf), getattr(info.prior, "upper", np.inf)
            unknowns.append(
                Unknown(
                    public,
                    kind.info.id,
                    "candidate",
                    0.0,
                    prior_width * info.prior.sd,
                    _groups(kind.info.channels),
                    lower,
                    upper,
                )  # fmt: skip
            )
    model = with_parameters(model, zeros)
    infos = parameter_infos(base)
    known = sigmas(base, vehicle)
    # No vehicle file states how well the response time is known; its declaration does.
    known.setdefault("flight.response_time", infos["flight.response_time"].prior.sd)
    owners = {f"{t.info.id}": t for t in base.terms}
    for name, sigma in known.items():
        if name not in infos or name == "flight.pump_rate":
            continue
        channels = _channels_of(name, owners)
        unknowns.append(Unknown(name, name, "calibration", float(_value(base, name)), sigma, _groups(channels)))
    there = {s.name for s in gathered.streams}
    wanted = {
        "inflection way": "displacement east", "gauge at the surface": "depth at the surface", "turn": "turn depth",
        "stay": "surface stay", "open circuit": "battery voltage", "charge": "battery voltage", "chart": "water depth",
    }  # fmt: skip
    for one in NUISANCES:
        if wanted[one.name] in there:
            # A general curve of a kind of pack is not this pack's; two points were given for this very one.
            loose = 8.0 if wanted[one.name] == "battery voltage" and len(vehicle.battery.voltage_curve) > 2 else 1.0
            unknowns.append(Unknown(one.name, one.name, "nuisance", 0.0, loose * one.sd, frozenset({one.group})))
    return Replay(
        model=model,
        pack=build_pack(vehicle.battery, dtype=np.float64),
        inputs=jax.tree.map(jnp.asarray, gathered.inputs),
        sizes=gathered.sizes,
        names=tuple(u.name for u in unknowns if u.kind != "nuisance"),
        unknowns=tuple(unknowns),
        streams=tuple(s.name for s in gathered.streams),
    )


def _groups(channels) -> frozenset[str]:
    found = set()
    for channel in channels:
        if channel in _FLIGHT:
            found.add("flight")
        elif channel in _COURSE or channel is Channel.LOG_SPEED:
            found.add("flight" if channel is Channel.LOG_SPEED else "course")
        elif channel is Channel.PRESSURE_OFFSET:
            found |= {"flight", "power"}
        else:
            found.add("power")
    return frozenset(found)


def _channels_of(name: str, owners: dict[str, Any]):
    for term in owners.values():
        if name in {info.quantity for info in declared(term).values()} or name.startswith(term.info.id + "."):
            return term.info.channels
    return (Channel.NET_BUOYANCY,)


def _value(model: FlightModel, name: str) -> float:
    return float(parameters(model)[name])


def _sample(fields: dict[str, Any]) -> Sample:
    size = next(iter(fields.values())).shape
    filled = {name: jnp.broadcast_to(jnp.asarray(value, jnp.float64), size) for name, value in fields.items()}
    rest = Sample()
    return Sample(*(filled.get(n, jnp.full(size, jnp.asarray(getattr(rest, n), jnp.float64))) for n in Sample._fields))


def _set(replay: Replay, values: Any, shapes: dict[str, Any]) -> tuple[FlightModel, dict[str, Any]]:
    named = {u.name: values[i] for i, u in enumerate(replay.unknowns)}
    extra = {n.name: named.pop(n.name, jnp.zeros(())) for n in NUISANCES}
    return with_parameters(replay.model, {**named, **shapes}), extra


def _total(model: FlightModel, channel: Channel, sample: Sample) -> Any:
    return jax.vmap(lambda s: model.total(channel, s))(sample)


def _glide(model: FlightModel, sample: Sample) -> Glide:
    """Steady glide in two rounds: terms that read the speed get that of the first, held constant.

    The model's own rounds to a fixed point would cost each derivative five glides; what is lost is of second order.
    """
    sample = model.complete(sample)

    def once(row: Sample) -> Glide:
        drag = jnp.exp(model.total(Channel.LOG_DRAG, row))
        return steady_glide(
            net_buoyancy=model.total(Channel.NET_BUOYANCY, row),
            pitch=row.pitch + model.total(Channel.PITCH, row),
            density=row.density,
            area=row.wing_area,
            parasite=model.total(Channel.DRAG_COEFFICIENT, row) * drag,
            induced=model.total(Channel.INDUCED_DRAG, row) * drag,
            lift=model.total(Channel.LIFT_SLOPE, row) * jnp.exp(model.total(Channel.LOG_LIFT, row)),
            stall_angle=model.body.stall_angle,
            thrust=model.total(Channel.THRUST, row) if model.has(Channel.THRUST) else None,
            water_up=model.total(Channel.VERTICAL_WATER_VELOCITY, row),
            speed_factor=jnp.exp(model.total(Channel.LOG_SPEED, row)),
        )

    first = jax.lax.stop_gradient(once(sample))
    return once(
        sample._replace(
            speed_through_water=first.speed_through_water,
            angle_of_attack=first.angle_of_attack,
            glide_angle=first.glide_angle,
        )
    )


def _motion(replay: Replay, values: Any, shapes: dict[str, Any]) -> dict[str, Any]:
    """Vertical speed, displacements, drifts and speed through water."""
    model, extra = _set(replay, values, shapes)
    inputs, sizes = replay.inputs, replay.sizes
    sample = _sample(inputs.rows)
    wet = inputs.direction != 0.0
    glide = jax.vmap(lambda row: _glide(model, row))(sample)
    tau = _total(model, Channel.RESPONSE_TIME, sample)
    steady = jnp.stack([jnp.where(wet, glide.depth_rate, 0.0), jnp.where(wet, glide.horizontal_speed, 0.0)], axis=1)
    rate, forward = _respond(steady, inputs.step, tau)
    found = {}

    def recorded(s: Sample) -> Any:
        return jax.grad(lambda z: model.total(Channel.PRESSURE_OFFSET, s._replace(depth=z)))(s.depth)

    if sizes.window:
        gauge = 1.0 + jax.vmap(recorded)(sample)
        slot = jnp.where(inputs.window >= 0, inputs.window, sizes.window)
        summed = jax.ops.segment_sum(inputs.window_weight * rate * gauge, slot, sizes.window + 1)
        found["vertical speed"] = summed[:-1]
    if inputs.speeds.size:
        found["speed through water"] = glide.speed_through_water[inputs.speeds]
    if sizes.course or sizes.drift:
        settled = inputs.window >= 0
        forward = forward * jnp.where(wet & ~settled, 1.0 + extra["inflection way"], 1.0)
        heading = sample.heading + _total(model, Channel.HEADING, sample)
        up = (~wet).astype(jnp.float64)
        parts = (
            ("east", jnp.sin(heading), inputs.product_east, Channel.CURRENT_EAST, Channel.SURFACE_DRIFT_EAST),
            ("north", jnp.cos(heading), inputs.product_north, Channel.CURRENT_NORTH, Channel.SURFACE_DRIFT_NORTH),
        )
        for name, way, product, water, drifting in parts:
            flow = product + _total(model, water, sample) + up * _total(model, drifting, sample)
            if sizes.course:
                slot = jnp.where(inputs.course >= 0, inputs.course, sizes.course)
                moved = inputs.course_share * (forward * way + flow)
                found[f"displacement {name}"] = jax.ops.segment_sum(moved, slot, sizes.course + 1)[:-1]
            if sizes.drift:
                slot = jnp.where(inputs.drift >= 0, inputs.drift, sizes.drift)
                found[f"surface drift {name}"] = jax.ops.segment_sum(inputs.drift_share * flow, slot, sizes.drift + 1)[
                    :-1
                ]
    return found


def _respond(steady: Any, step: Any, tau: Any) -> tuple[Any, Any]:
    """Mean over each step of a first-order response to the steady values, which change linearly within a step."""
    before = jnp.concatenate([steady[:1], steady[:-1]])
    drive = 0.5 * (before + steady)
    tau = jnp.maximum(tau, 0.5)
    decay = jnp.exp(-step / tau)
    held = jnp.where(step > 0.0, tau * (1.0 - decay) / jnp.where(step > 0.0, step, 1.0), 1.0)

    def advance(state: Any, row: Any) -> tuple[Any, Any]:
        target, fall, share = row
        mean = target + (state - target) * share
        return target + (state - target) * fall, mean

    _, mean = jax.lax.scan(advance, steady[0], (drive, decay, held), unroll=8)
    return mean[:, 0], mean[:, 1]


def _power(replay: Replay, values: Any, shapes: dict[str, Any]) -> dict[str, Any]:
    """Energy, power, voltage, turning depths and what else the instruments say."""
    model, extra = _set(replay, values, shapes)
    inputs = replay.inputs
    found: dict[str, Any] = {}

    def shown(sample: Sample, power: Any) -> Any:
        """Recorded power: current through gain and offset of its sensor, times voltage."""
        gain = jnp.exp(_total(model, Channel.CURRENT_GAIN, sample))
        return power * gain + _total(model, Channel.CURRENT_OFFSET, sample) * sample.voltage

    if inputs.event_out.size:
        sample = _sample(inputs.events)
        out = jax.vmap(model.stroke_energy)(sample)
        back = jax.vmap(model.retract_energy)(sample)
        energy = jnp.where(inputs.event_out, out.pump + out.brake, back.pump + back.brake)
        dive = 0.5 * (
            _total(model, Channel.HOTEL_POWER, sample._replace(direction=jnp.full_like(sample.depth, -1.0)))
            + _total(model, Channel.HOTEL_POWER, sample._replace(direction=jnp.full_like(sample.depth, 1.0)))
        )
        seconds = inputs.event_seconds
        total = shown(sample, (energy + dive * seconds) / seconds) * seconds
        count = replay.sizes.out
        found["pump out energy"], found["pump in energy"] = total[:count], total[count:]
    if inputs.load_surface.size:
        sample = _sample(inputs.loads)
        hotel = _total(model, Channel.HOTEL_POWER, sample)
        stay = jnp.maximum(sample.surface_duration, 60.0)
        once = _total(model, Channel.SURFACING_ENERGY, sample) / stay
        up = jnp.where(inputs.load_surface, _total(model, Channel.SURFACE_POWER, sample) + once, 0.0)
        total = shown(sample, hotel + up)
        first, second = replay.sizes.dives, replay.sizes.dives + replay.sizes.climbs
        found["hotel power, dives"], found["hotel power, climbs"] = total[:first], total[first:second]
        found["surface power"] = total[second:]
    if inputs.pulses:
        sample = _sample(inputs.pulses)
        pack = replay.pack
        full = pack.voltage_points[-1]
        share = 1.0 - (1.0 - sample.state_of_charge) * jnp.exp(-_total(model, Channel.LOG_CAPACITY, sample))
        curve = jax.vmap(pack.open_circuit_voltage)(share)
        curve = curve + extra["charge"] * (curve - full) + extra["open circuit"]
        found["battery voltage"] = (
            curve - pack.internal_resistance * sample.current + _total(model, Channel.VOLTAGE, sample)
        )
    if inputs.turns:
        sample = _sample(inputs.turns)
        found["turn depth"] = _total(model, Channel.TURN_DEPTH, sample) + extra["turn"]
    if inputs.floors:
        sample = _sample(inputs.floors)
        offset = _total(model, Channel.PRESSURE_OFFSET, sample)
        found["water depth"] = _total(model, Channel.WATER_DEPTH, sample) + offset + extra["chart"]
    if inputs.depths.size:
        sample = _sample({"depth": inputs.depths})
        offset = _total(model, Channel.PRESSURE_OFFSET, sample)
        found["depth at the surface"] = GAUGE_DEPTH + extra["gauge at the surface"] + offset
    if inputs.stays.size:
        sample = _sample({"depth": inputs.stays})
        found["surface stay"] = _total(model, Channel.SURFACE_INTERVAL, sample) + extra["stay"]
    if inputs.ratios.size:
        sample = _sample({"depth": inputs.ratios})
        found["charge counter"] = _total(model, Channel.CHARGE_GAIN, sample)
    return {name: value for name, value in found.items() if value.size}


@eqx.filter_jit
def _predict(replay: Replay, values: Any, shapes: dict[str, Any]) -> dict[str, Any]:
    return {**_motion(replay, values, shapes), **_power(replay, values, shapes)}


_BATCH = 16


@eqx.filter_jit
def _jacobian(replay: Replay, values: Any, shapes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Predictions and forward derivatives; each part is traced once, whatever the number of unknowns."""
    found: dict[str, Any] = {}
    columns: dict[str, Any] = {}
    for groups, part in ((frozenset({"flight", "course"}), _motion), (frozenset({"power"}), _power)):
        mine = np.asarray([i for i, u in enumerate(replay.unknowns) if groups & u.groups], int)
        scale = np.asarray([replay.unknowns[i].scale for i in mine])
        value, push = jax.linearize(lambda x, at=mine, f=part: f(replay, values.at[at].set(x), shapes), values[mine])
        found |= value
        for name, block in jax.lax.map(push, jnp.asarray(np.diag(scale)), batch_size=_BATCH).items():
            whole = jnp.zeros((block.shape[1], len(replay.unknowns)))
            columns[name] = whole.at[:, mine].set(block.T)
    return found, columns
