"""Drive the forecaster's own physics terms with recorded controls: what would have been observed.

Imports JAX and the physics. One smooth pure function of the parameters, without a switch: pitch, pumped volume,
heading, water and surfacing times come from the recording. A newcomer would get wrong: depth is an input as well as an
observation, the density and pressure at the *recorded* depth drive the model and its *rate* is compared; between
steady glides the motion is followed under forces that change from row to row, but pitch that wanders in settled glides
is kept out of it; and unknowns are counted in units of their prior standard deviation, so that every column of a
Jacobian is comparable. Arrays are filled up to common lengths and all numbers are traced, so that one compiled program
serves all recordings with the same streams.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.config import Vehicle
from glider_jax.inference.filled import LEAST_WINDOWS, fill, ladder
from glider_jax.inference.instruments import FROM_FLOOR
from glider_jax.inference.settling import (
    NORMAL,
    Forces,
    faster,
    motion,
    respond,
    response_of,
    steady_of,
    usual_drag,
)  # fmt: skip
from glider_jax.inference.streams import Gathered, Inputs, Sizes
from glider_jax.inference.unknowns import (
    GAUGE_DEPTH,
    NUISANCES,
    RESPONSE_SHARE,
    Unknown,
    channels_of,
    groups_of,
    nuisances,
    tied_by,
)
from glider_jax.physics.battery import Pack, build_pack
from glider_jax.physics.flight import Glide, drag_as_fitted
from glider_jax.physics.library import LIBRARY
from glider_jax.physics.model import (
    FITTED,
    FlightModel,
    build_model,
    fitted_pitch,
    parameter_infos,
    parameters,
    sigmas,
    with_candidates,
    with_parameters,
)
from glider_jax.physics.term import Channel, Sample, declared
from glider_jax.records import Array

#: Numbers of every stream's rows, by its name.
Rows = dict[str, Array]


class Program(eqx.Module):
    """What is compiled: model, inputs filled up to common lengths, and scales; names and lengths alone are static.

    ``tied`` (unknowns, unknowns) is what numbers carry along by the vehicle file's covariances; ``fitted`` pitch of the
    glides its drag was fitted to, and the numbers then.
    """

    model: FlightModel
    pack: Pack
    inputs: Inputs
    scales: Array
    centres: Array
    tied: Array
    fitted: Array
    drag: Array
    sizes: Sizes = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    groups: tuple[frozenset[str], ...] = eqx.field(static=True)


@dataclass(frozen=True)
class Replay:
    """The full model, inputs and unknowns; call :meth:`predict` and :meth:`jacobian` under 64-bit precision.

    ``places`` says where each stream's numbers lie in what the program returns.
    """

    program: Program
    unknowns: tuple[Unknown, ...]
    places: dict[str, tuple[str, slice]]

    @property
    def model(self) -> FlightModel:
        """The vehicle's model with every term of the library."""
        return self.program.model

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams."""
        return tuple(self.places)

    def predict(self, values: Array, shapes: dict[str, Any] | None = None) -> Rows:
        """Every stream, for the values of all unknowns (in their units) and of shape parameters."""
        return self.foresee(values, shapes)[0]

    def foresee(self, values: Array, shapes: dict[str, Any] | None = None) -> tuple[Rows, Rows]:
        """Every stream as :meth:`predict`, and the sds (n,) by which turns leave some of them open."""
        found, loose = _predict(self.program, jnp.asarray(values), self._whole(shapes))
        return self._cut(found), self._cut(loose)

    def jacobian(self, values: Array, shapes: dict[str, Any] | None = None) -> tuple[Rows, Rows, Rows]:
        """Predictions, derivatives (n, unknowns) per unit of each unknown's scale, and sds as :meth:`foresee`."""
        found, columns, loose = _jacobian(self.program, jnp.asarray(values), self._whole(shapes))
        return self._cut(found), self._cut(columns), self._cut(loose)

    def stated(self, own: Sequence[int], mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
        """Values and sds of some unknowns in their units, and values in prior sds; ``own`` (k,) may hold -1.

        ``mean`` (k,) and ``covariance`` (k, k) are of their coordinates, prior units; other unknowns are as given.
        """
        own = np.asarray(own)
        centre, scale = np.array([(u.centre, u.scale) for u in self.unknowns]).T
        whole = np.zeros(centre.size)
        whole[own[own >= 0]] = mean[own >= 0]
        with jax.enable_x64(True):
            value, push = map(np.array, _stated(self.program, jnp.asarray(centre + scale * whole)))
        value, push = value[own], push[np.ix_(own, own)] * scale[own]
        push[own < 0] = push[:, own < 0] = 0.0
        sd = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", push, covariance, push), 0.0))
        return value, sd, (value - centre[own]) / scale[own]

    def slopes(self, values: Array, shapes: dict[str, Any] | None, own: Sequence[int]) -> tuple[Rows, Rows, Rows]:
        """As :meth:`jacobian`, by some unknowns alone, (n, own): as cheap as they are few."""
        long = next((n for n in FEW if n >= len(own)), None)
        if long is None:
            found, columns, loose = self.jacobian(values, shapes)
            return found, {name: column[:, list(own)] for name, column in columns.items()}, loose
        directions = np.zeros((long, len(self.unknowns)))
        directions[np.arange(len(own)), list(own)] = np.asarray(self.program.scales)[list(own)]
        found, columns, loose = _along(self.program, jnp.asarray(values), self._whole(shapes), jnp.asarray(directions))
        columns = {name: column[:, : len(own)] for name, column in self._cut(columns).items()}
        return self._cut(found), columns, self._cut(loose)

    def _cut(self, found: dict[str, Any]) -> dict[str, Array]:
        """Streams without what filled them up."""
        return {name: np.asarray(found[part])[rows] for name, (part, rows) in self.places.items() if part in found}

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
    quantities = set(parameter_infos(base))
    for kind in candidates:
        groups = groups_of(kind.info.channels)
        for name, info in declared(kind).items():
            public = f"{kind.info.id}.{name}"
            if info.role == "shape":
                zeros[public] = info.prior.centre
            if info.role != "amplitude":
                continue
            zeros[public] = 0.0
            # A buoyancy made of the depth rate holds whatever moves the vertical speed: nothing can be asked of it.
            if groups == {"flight"} and not gathered.buoyancy_known:
                continue
            # What a term adds to a number that the vehicle file names may take it down to zero, and to its limit.
            given = _value(base, kind.info.id) if kind.info.id in quantities and info.support[0] == 0.0 else 0.0
            lower, upper = info.bounds[0] - given, info.bounds[1] - given
            wide = prior_width * info.prior.sd
            unknowns.append(Unknown(public, kind.info.id, "candidate", 0.0, wide, groups, lower, upper))
    model = with_parameters(model, zeros)
    infos = parameter_infos(base)
    known = sigmas(base, vehicle)
    centres = {name: float(_value(base, name)) for name in known if name in infos}
    if "flight.response_time" not in vehicle.quantities:
        centres["flight.response_time"] = response_of(gathered.rows, parameters(base))
        known["flight.response_time"] = RESPONSE_SHARE * centres["flight.response_time"]
    for name, sigma in known.items():
        if name not in infos or name == "flight.pump_rate":
            continue
        channels = channels_of(name, base.terms)
        least = SHORTEST * centres[name] if name == "flight.response_time" else -np.inf
        unknowns.append(Unknown(name, name, "calibration", centres[name], sigma, groups_of(channels), least))
    # A general curve of a kind of pack is not this pack's; two points were given for this very one.
    unknowns += nuisances({s.name for s in gathered.streams}, 8.0 if len(vehicle.battery.voltage_curve) > 2 else 1.0)
    unknowns, joint = tied_by(unknowns, vehicle.covariances)
    program = _program(gathered, model, vehicle, unknowns, joint, usual_drag(gathered.rows, parameters(base)))
    return Replay(program, tuple(unknowns), _places(gathered))


def _program(
    gathered: Gathered, model: FlightModel, vehicle: Vehicle, unknowns: list[Unknown], joint: Array, usual: float
) -> Program:
    filled = jax.tree.map(jnp.asarray, fill(gathered.inputs))
    scales = np.array([u.scale for u in unknowns], float)
    return Program(
        model=jax.tree.map(jnp.asarray, model),
        pack=jax.tree.map(jnp.asarray, build_pack(vehicle.battery, dtype=np.float64)),
        inputs=filled,
        scales=jnp.asarray(scales),
        centres=jnp.asarray([u.centre for u in unknowns], jnp.float64),
        tied=jnp.asarray((joint - np.eye(scales.size)) * scales[:, None] / scales),
        fitted=jnp.asarray([fitted_pitch(vehicle), *(_value(model, name) for name in FITTED)]),
        drag=jnp.asarray(usual, jnp.float64),
        sizes=Sizes(ladder(gathered.sizes.window, LEAST_WINDOWS), *(ladder(n) for n in gathered.sizes[1:])),
        names=tuple(u.name for u in unknowns),
        groups=tuple(u.groups for u in unknowns),
    )


def _places(gathered: Gathered) -> dict[str, tuple[str, slice]]:
    """Part of the program's answer and rows in it, for every stream there is."""
    sizes = gathered.sizes
    joined = {
        "pump out energy": ("strokes", 0), "pump in energy": ("strokes", sizes.out),
        "hotel power, dives": ("loads", 0), "hotel power, climbs": ("loads", sizes.dives),
        "surface power": ("loads", sizes.dives + sizes.climbs),
    }  # fmt: skip
    found = {}
    for stream in gathered.streams:
        part, first = joined.get(stream.name, (stream.name, 0))
        found[stream.name] = (part, slice(first, first + stream.n))
    return found


def _value(model: FlightModel, name: str) -> float:
    return float(parameters(model)[name])


def _sample(fields: dict[str, Any]) -> Sample:
    size = next(iter(fields.values())).shape
    filled = {name: jnp.broadcast_to(jnp.asarray(value, jnp.float64), size) for name, value in fields.items()}
    rest = Sample()
    return Sample(*(filled.get(n, jnp.full(size, jnp.asarray(getattr(rest, n), jnp.float64))) for n in Sample._fields))


def _set(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[FlightModel, dict[str, Any]]:
    values = values + program.tied @ (values - program.centres)
    named = {name: values[i] for i, name in enumerate(program.names)}
    extra = {n.name: named.pop(n.name, jnp.zeros(())) for n in NUISANCES}
    model = with_parameters(program.model, {**named, **shapes})
    return with_parameters(model, _fitted(program, parameters(model))), extra


def _fitted(program: Program, values: dict[str, Any]) -> dict[str, Any]:
    """Parasite drag that keeps the vertical speed it was fitted to, where the vehicle file says that it was."""
    pitch, *given = program.fitted
    drag, lift, induced = (values[name] for name in FITTED)
    there = drag_as_fitted(lift, induced, given=tuple(given), pitch=jnp.where(pitch > 0.0, pitch, 0.4))
    return {FITTED[0]: drag * jnp.where(pitch > 0.0, there / given[0], 1.0)}


def _total(model: FlightModel, channel: Channel, sample: Sample) -> Any:
    return jax.vmap(lambda s: model.total(channel, s))(sample)


def _acting(model: FlightModel, sample: Sample, along: Any) -> tuple[Forces, Glide]:
    """Forces of all rows and the steady glides under them; terms that read the speed get a first one's, held constant.

    The model's own rounds to a fixed point would cost each derivative five glides; what is lost is of second order.
    """
    sample = jax.vmap(model.complete)(sample)

    def forces(row: Sample) -> Forces:
        drag = jnp.exp(model.total(Channel.LOG_DRAG, row))
        return Forces(
            net_buoyancy=model.total(Channel.NET_BUOYANCY, row),
            pitch=row.pitch + model.total(Channel.PITCH, row),
            density=row.density,
            area=row.wing_area,
            parasite=model.total(Channel.DRAG_COEFFICIENT, row) * drag,
            induced=model.total(Channel.INDUCED_DRAG, row) * drag,
            lift=model.total(Channel.LIFT_SLOPE, row) * jnp.exp(model.total(Channel.LOG_LIFT, row)),
            thrust=model.total(Channel.THRUST, row),
            along=0.0,
            across=(1.0 + NORMAL) * row.mass,
        )

    first = jax.lax.stop_gradient(jax.vmap(lambda row: steady_of(forces(row)))(sample))
    acting = jax.vmap(forces)(
        sample._replace(
            speed_through_water=first.speed_through_water,
            angle_of_attack=first.angle_of_attack,
            glide_angle=first.glide_angle,
        )
    )
    return acting._replace(along=along), jax.vmap(steady_of)(acting)


def _motion(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Vertical speed, displacements, drifts and speed through water, and by how much turns leave some of them open.

    Pitch that wanders within a half yo moves the path as much as a nuisance leaves open, and the speed in a time of its
    own, so that only half yos that differ teach lift and inertia.
    """
    model, extra = _set(program, values, shapes)
    inputs, sizes = program.inputs, program.sizes
    sample = _sample(inputs.rows)
    sample = sample._replace(pitch=sample.pitch - inputs.wander)
    stray = (1.0 + extra["pitch wander"]) * inputs.wander + extra["pitch delay"] * inputs.wander_rate
    wet = inputs.direction != 0.0
    tau = jnp.maximum(_total(model, Channel.RESPONSE_TIME, sample), 0.5)
    water = _total(model, Channel.VERTICAL_WATER_VELOCITY, sample)
    # Inertia that makes the usual glide answer in the response time.
    acting, steady = _acting(model, sample, tau * sample.density * model.body.wing_area * program.drag)
    still = jnp.where(wet, steady.speed_through_water, 0.0)
    pace = faster(still, inputs.window >= 0)
    acting = acting._replace(along=acting.along * pace ** extra["lag by speed"])
    begun = steady._replace(speed_through_water=still)  # what floats is at rest
    base, attack, quicker, steeper, loose = motion(acting, begun, inputs.step, inputs.follows, stray)
    usual, angle = acting.pitch + attack, acting.pitch + attack + stray + steeper
    sinking = -jnp.sin(usual)
    down, ahead = -jnp.sin(angle), jnp.cos(angle)
    slow = tau * pace ** (extra["lag by speed"] - 1.0)
    lagged, smooth = respond(jnp.stack([still * sinking, still], axis=1), inputs.step, jnp.stack([slow, slow], axis=1))
    # Where nothing drives a motion that could be followed, the steady speed is at least no quicker than a glider.
    base = jnp.where(wet & inputs.follows, base, smooth)
    hurry = jnp.diff(jax.lax.stop_gradient(quicker), prepend=quicker[:1]) / jnp.maximum(inputs.step, 0.5)
    speed = base + jnp.where(wet, quicker - extra["wander lag"] * jnp.where(inputs.follows, hurry, 0.0), 0.0)
    rate = speed * down + extra["lag of rate"] * (lagged - base * sinking) - jnp.where(wet, water, 0.0)
    forward = speed * ahead * jnp.exp(_total(model, Channel.LOG_SPEED, sample))
    found, open_ = {}, {}

    def recorded(s: Sample) -> Any:
        return jax.grad(lambda z: model.total(Channel.PRESSURE_OFFSET, s._replace(depth=z)))(s.depth)

    if sizes.window:
        gauge = 1.0 + jax.vmap(recorded)(sample)
        slot = jnp.where(inputs.window >= 0, inputs.window, sizes.window)
        summed = jax.ops.segment_sum(inputs.window_weight * rate * gauge, slot, sizes.window + 1)
        found["vertical speed"] = summed[:-1]
        open_["vertical speed"] = jax.ops.segment_sum(inputs.window_weight * loose, slot, sizes.window + 1)[:-1]
    if inputs.speeds.size:
        found["speed through water"] = speed[inputs.speeds]
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
                apart = jnp.where(settled, inputs.course_share * loose, 0.0)
                open_[f"displacement {name}"] = jax.ops.segment_sum(apart, slot, sizes.course + 1)[:-1]
            if sizes.drift:
                slot = jnp.where(inputs.drift >= 0, inputs.drift, sizes.drift)
                found[f"surface drift {name}"] = jax.ops.segment_sum(inputs.drift_share * flow, slot, sizes.drift + 1)[
                    :-1
                ]
    return found, open_


def _power(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Energy, power, voltage, turning depths and what else the instruments say; no turn leaves them open."""
    model, extra = _set(program, values, shapes)
    inputs = program.inputs
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
        sinking, rising = (
            _total(model, Channel.HOTEL_POWER, sample._replace(direction=jnp.full_like(sample.depth, way)))
            for way in (-1.0, 1.0)
        )
        to_come = jnp.where(inputs.event_out, rising - sinking, sinking - rising)
        hotel = 0.5 * (sinking + rising + extra["load of a stroke"] * to_come)
        seconds = inputs.event_seconds
        found["strokes"] = shown(sample, (energy + hotel * seconds) / seconds) * seconds
    if inputs.load_surface.size:
        sample = _sample(inputs.loads)
        hotel = _total(model, Channel.HOTEL_POWER, sample)
        stay = jnp.maximum(sample.surface_duration, 60.0)
        once = _total(model, Channel.SURFACING_ENERGY, sample) / stay
        up = jnp.where(inputs.load_surface, _total(model, Channel.SURFACE_POWER, sample) + once, 0.0)
        found["loads"] = shown(sample, hotel + up)
    if inputs.pulses:
        sample = _sample(inputs.pulses)
        pack = program.pack
        full = pack.voltage_points[-1]
        share = 1.0 - (1.0 - sample.state_of_charge) * jnp.exp(-_total(model, Channel.LOG_CAPACITY, sample))
        curve = jax.vmap(pack.open_circuit_voltage)(share)
        curve = curve + extra["charge"] * (curve - full) + extra["open circuit"]
        found["battery voltage"] = (
            curve - pack.internal_resistance * sample.current + _total(model, Channel.VOLTAGE, sample)
        )
    if inputs.turns:
        sample = _sample(inputs.turns)
        called = sample.height_above_bottom < FROM_FLOOR
        aside = extra["turn"] + extra["turn time"] * (sample.depth_rate - TURNING)
        aside = aside + jnp.where(called, extra["turn on altitude"], 0.0)
        found["turn depth"] = _total(model, Channel.TURN_DEPTH, sample) + aside
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
    return {name: value for name, value in found.items() if value.size}, {}


@eqx.filter_jit
def _stated(program: Program, values: Any) -> tuple[Any, Any]:
    """Numbers as the physics gets them, and their derivatives (unknowns, unknowns) by the coordinates."""

    def stated(values: Any) -> Any:
        values = values + program.tied @ (values - program.centres)
        named = dict(zip(program.names, values, strict=True))
        named |= _fitted(program, {**parameters(program.model), **named})
        return jnp.stack([named[name] for name in program.names])

    return stated(values), jax.jacfwd(stated)(values)


@eqx.filter_jit
def _predict(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    return _both(program, values, shapes)


def _both(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    found, loose = _motion(program, values, shapes)
    return {**found, **_power(program, values, shapes)[0]}, loose


#: m s-1; vertical speed at which the depth past a turn is told, so that its time is told by faster and slower turns.
TURNING = 0.15
#: Share of the expected response time that a fit may not go below: nothing answers before it is pushed.
SHORTEST = 0.25
_BATCH = 16
#: Numbers of unknowns for which derivatives by some of them are compiled.
FEW = (32,)


@eqx.filter_jit
def _along(program: Program, values: Any, shapes: dict[str, Any], directions: Any) -> tuple[dict, dict, dict]:
    """Predictions, their derivatives along some directions (k, unknowns), and what turns leave open."""
    value, push, loose = jax.linearize(lambda x: _both(program, x, shapes), values, has_aux=True)
    return value, {name: block.T for name, block in jax.lax.map(push, directions, batch_size=_BATCH).items()}, loose


@eqx.filter_jit
def _jacobian(program: Program, values: Any, shapes: dict[str, Any]) -> tuple[dict, dict, dict]:
    """Predictions, forward derivatives and what turns leave open; each part is traced once for all unknowns."""
    found, columns, open_ = {}, {}, {}
    for groups, part in ((frozenset({"flight", "course"}), _motion), (frozenset({"power"}), _power)):
        mine = np.asarray([i for i, own in enumerate(program.groups) if groups & own], int)
        value, push, loose = jax.linearize(
            lambda x, at=mine, f=part: f(program, values.at[at].set(x), shapes), values[mine], has_aux=True
        )
        found, open_ = found | value, open_ | loose
        for name, block in jax.lax.map(push, jnp.diag(program.scales[mine]), batch_size=_BATCH).items():
            whole = jnp.zeros((block.shape[1], len(program.names)))
            columns[name] = whole.at[:, mine].set(block.T)
    return found, columns, open_
