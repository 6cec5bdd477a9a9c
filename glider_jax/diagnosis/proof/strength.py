"""How strong a concealed effect is: its signature over the noise that a recording has, calibrations projected out.

Imports NumPy and the proof's own modules. The signal-to-noise ratio of an effect is the norm of its whitened change
of four kinds of observation along a mission flown without it: vertical speed by half yo and fifth of it, displacement
by segment, drift while surfaced, and energy, voltage and gauges. What the stated sigmas of the vehicle file can
absorb does not count. Noise is that of the truth's own red processes, estimated from a mission without effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glider_jax.diagnosis.proof.ocean import DAY, EARTH_ROTATION, HOUR, K1, M2, S2, TABLE_STEP, Ocean
from glider_jax.diagnosis.proof.sensors import electricity, power_of
from glider_jax.diagnosis.proof.truth import GRAVITY, Flown, Vehicle

Array = NDArray[np.float64]

PARTS = 5  # a half yo is cut into fifths
#: m; no vehicle file says how deep the gauge of a floating glider is to better than this.
AFLOAT = 0.1
#: V; nor what the open-circuit voltage of this very pack is.
OPEN_CIRCUIT = 0.05
SETTLED = 60.0  # s after an inflection that are left out

# Sigma-carrying constants and the unit in which their signatures are differenced.
CALIBRATED = ("mass", "parasite_drag", "hotel", "pump_intercept", "pump_slope", "retract", "brake", "surface")


@dataclass(frozen=True)
class World:
    """A mission flown without effects, cut into nodes at which effects are looked at."""

    ocean: Ocean
    vehicle: Vehicle
    flown: Flown
    sigma: Mapping[str, float]
    nodes: dict[str, Array]
    half: NDArray[np.int64]  # half yo of each node
    segment: NDArray[np.int64]  # segment of each node
    whiteners: dict[str, Array]
    plain: dict[str, Array]


def prepare(ocean: Ocean, vehicle: Vehicle, flown: Flown, sigma: Mapping[str, float]) -> World:
    """Cut a mission into nodes and estimate the noise of each kind of observation."""
    phase = flown["phase"]
    change = np.concatenate([[0], np.flatnonzero(np.diff(phase) != 0) + 1])
    half_of = np.zeros(phase.size, dtype=int)
    half_of[change[1:]] = 1
    half_of = np.cumsum(half_of)
    since = np.arange(phase.size) - change[half_of]
    length = np.diff(np.append(change, phase.size))[half_of]
    use = (phase != 0) & (since > SETTLED) & (length > SETTLED + 60)
    part = np.minimum(((since - SETTLED) / np.maximum(length - SETTLED, 1) * PARTS).astype(int), PARTS - 1)
    code = half_of * PARTS + part
    codes, index = np.unique(code[use], return_inverse=True)
    count = np.bincount(index).astype(float)

    def mean(values: Array) -> Array:
        return np.bincount(index, values[use]) / count

    names = ("depth", "rise", "speed", "pitch", "ballast", "phase", "temperature", "east", "north", "bottom")
    nodes = {name: mean(flown[name]) for name in names}
    heading = flown["indicated_heading"]
    nodes["heading"] = np.arctan2(mean(np.sin(heading)), mean(np.cos(heading)))
    nodes["time"] = mean(np.arange(phase.size, dtype=float))
    nodes["seconds"] = count
    nodes["water_rise"] = mean(ocean.vertical[: phase.size])
    rho = np.empty(codes.size)
    for block in np.unique((nodes["time"] / 600).astype(int)):
        inside = (nodes["time"] / 600).astype(int) == block
        table, _ = ocean.table(block * 600.0)
        rho[inside] = np.interp(nodes["depth"][inside], np.arange(table.size) * TABLE_STEP, table)
    nodes["density"] = rho
    surfaced = np.flatnonzero((phase[1:] == 0) & (phase[:-1] != 0))
    segment = np.searchsorted(surfaced, nodes["time"])
    flow = [ocean.flow(x, y, t) for x, y, t in zip(nodes["east"], nodes["north"], nodes["time"], strict=True)]
    nodes["flow_east"], nodes["flow_north"] = np.array(flow).T
    world = World(ocean, vehicle, flown, sigma, nodes, codes // PARTS, segment, {}, {})
    world.plain.update(observe(world, {}))
    world.whiteners.update(_whiteners(world))
    world.whiteners["calibrated"] = _calibrated(world)
    return world


def _calibrated(world: World) -> Array:
    """Orthonormal basis of what the calibrations can absorb within their sigmas, prior rows at the end."""
    plain = world.plain
    columns = []
    for name in CALIBRATED:
        moved = replace(world.vehicle, **{name: getattr(world.vehicle, name) + world.sigma[name]})
        other = observe(replace(world, vehicle=moved), {})
        columns.append(_whiten(world, {k: other[k] - plain[k] for k in plain}))
    still = {k: np.zeros_like(v) for k, v in plain.items()}
    columns.append(_whiten(world, still | {"volts": np.full_like(plain["volts"], OPEN_CIRCUIT)}))
    # With a unit prior on each calibration in sigmas: r' (I + C C')^-1 r is what remains of a signature.
    c = np.stack(columns, axis=1)
    return np.linalg.qr(np.vstack([c, np.eye(c.shape[1])]))[0]


def _whiteners(world: World) -> dict[str, Array]:
    """Inverse Cholesky factors of the noise of the streams that are correlated in time."""
    plain = world.plain
    times = plain["hotel_time"]
    gap = np.abs(times[:, None] - times[None, :])
    hotel = (0.012 * world.vehicle.hotel) ** 2 * np.exp(-gap / 2400.0) + np.eye(times.size) * (
        0.02 * world.vehicle.hotel
    ) ** 2
    when = plain["segment_time"]
    lag = np.abs(when[:, None] - when[None, :])
    drift = 0.0095**2 * np.exp(-lag / (8 * HOUR)) + np.eye(when.size) * 0.007**2
    hours = plain["voltage_time"]
    wander = np.abs(hours[:, None] - hours[None, :])
    volts = 0.004**2 * np.exp(-wander / HOUR) + np.eye(hours.size) * 0.001**2
    return {
        k: np.linalg.inv(np.linalg.cholesky(c))
        for k, c in (("hotel", hotel), ("drift", drift), ("volts", volts))
    }


def steady(push: Array, pitch: Array, rho: Array, drag: Array, induced: float, lift: Array, area: float):
    """Steady rise and horizontal speed, m s-1, of a net buoyancy N at a pitch rad."""
    tilt = np.maximum(np.abs(pitch), 0.05)
    attack = np.full_like(tilt, 0.03)
    for _ in range(10):
        attack = np.clip(
            (drag + induced * attack**2) / (lift * np.tan(np.minimum(tilt + attack, 1.4))), 0.0, 0.3
        )
    path = tilt + attack
    whole = drag + induced * attack**2
    along = np.sqrt(2.0 * np.abs(push) * np.sin(path) / (rho * area * whole))
    return np.sign(push) * along * np.sin(path), along * np.cos(path)


def observe(world: World, effects: Mapping[str, float]) -> dict[str, Array]:
    """What a recording would show of a mission whose indicated controls are those of the world."""
    e, n, v = effects.get, world.nodes, world.vehicle
    z, t, phase, temperature = n["depth"], n["time"], n["phase"], n["temperature"]
    indicated = n["pitch"]
    pitch = indicated * (1.0 + e("flight.pitch_gain.gain", 0.0)) + e("flight.pitch_offset.offset", 0.0)
    mass = v.mass + e("flight.ballast_offset.mass", 0.0) + e("flight.mass_growth.rate", 0.0) * t
    late = -(t - e("flight.water_ingress.onset", 0.0)) / 7200.0
    mass = mass + e("flight.water_ingress.mass", 0.0) / (1.0 + np.exp(np.clip(late, -50, 50)))
    pascal = 10079.5 * z
    hull = 1.0 - e("flight.hull_compressibility.compressibility", 0.0) * pascal
    hull = hull + e("flight.thermal_expansion.expansion", 0.0) * (temperature - 15.0)
    volume = (
        v.volume * hull
        + n["ballast"] * (1.0 + e("flight.oil_gain.gain", 0.0))
        + e("flight.oil_offset.volume", 0.0)
    )
    salinity = e("flight.salinity_bias.bias", 0.0) + e("sensor.salinity_drift.rate", 0.0) * t
    push = GRAVITY * (n["density"] * (1.0 + 0.00076 * salinity) * volume - mass)
    day = t / DAY
    drag = v.parasite_drag * (1.0 + e("flight.drag_bias.share", 0.0) + e("flight.drag_growth.rate", 0.0) * t)
    window = (day >= e("out.drag_step.begin", 0.0)) & (day < e("out.drag_step.end", 9.0))
    drag = drag * (1.0 + e("out.drag_step.share", 0.0) * window)
    drag = drag * (1.0 + e("flight.drag_asymmetry.share", 0.0) * phase)
    drag = drag * (1.0 + e("out.drag_by_temperature.slope", 0.0) * (temperature - 15.0))
    lift = v.lift_slope * (1.0 - e("flight.lift_loss.loss", 0.0))
    induced = v.induced_drag * (1.0 + e("flight.induced_drag_bias.share", 0.0))
    rise, speed = steady(push, pitch, n["density"], drag, induced, np.full_like(z, lift), v.wing_area)
    rise = (rise + _vertical(e, n)) * (1.0 + e("sensor.pressure_gain.gain", 0.0))
    out = {"rise": rise}
    _displacement(world, e, speed, out)
    _energy(world, effects, out)
    gauge = e("sensor.pressure_offset.offset", 0.0)
    out["gauge"] = np.array([gauge]) / np.hypot(0.011, AFLOAT)
    out["chart"] = np.array([e("seafloor.bathymetry_bias.bias", 0.0)]) / 0.4
    return out


def _vertical(e, n: dict[str, Array]) -> Array:
    """Vertical water velocity of the effects at the nodes, m s-1 up."""
    t, z = n["time"], n["depth"]
    rise = np.full_like(z, e("flight.mean_upwelling.velocity", 0.0))
    turn = 2 * np.pi * t / e("flight.vertical_water_velocity.period", 21600.0)
    rise = rise + e("flight.vertical_water_velocity.cosine", 0.0) * np.cos(turn)
    rise = rise + e("flight.vertical_water_velocity.sine", 0.0) * np.sin(turn)
    tide = e("flight.internal_tide.cosine", 0.0) * np.cos(M2 * t) + e(
        "flight.internal_tide.sine", 0.0
    ) * np.sin(M2 * t)
    rise = rise + tide * np.sin(np.pi * z / n["bottom"])
    inside = (z > 12.0) & (z < 42.0)
    rise = rise + e("out.layer_motion.velocity", 0.0) * np.sin(np.pi * (z - 12.0) / 30.0) * inside
    since = (t / DAY - e("out.front_motion.begin", 1.0)) / 0.06
    return rise + e("out.front_motion.velocity", 0.0) * (1.0 - since**2) * np.exp(-0.5 * since**2)


def _displacement(world: World, e, speed: Array, out: dict[str, Array]) -> None:
    """Mean velocity over the ground by segment and drift by surfacing, m s-1."""
    n = world.nodes
    t, h = n["time"], n["heading"]
    error = e("navigation.compass_deviation.sine", 0.0) * np.sin(h)
    error = error + e("navigation.compass_deviation.cosine", 0.0) * np.cos(h)
    error = error + e("navigation.soft_iron.sine", 0.0) * np.sin(2 * h)
    error = error + e("navigation.soft_iron.cosine", 0.0) * np.cos(2 * h)
    error = error + e("navigation.magnetic_declination.angle", 0.0)
    error = error + e("out.heading_three.amplitude", 0.0) * np.sin(3 * h)
    flow = []
    for axis in ("east", "north"):
        value = np.full_like(t, e(f"navigation.mean_current.{axis}", 0.0))
        for name, rate in (("tidal_current", M2), ("tide_s2", S2), ("tide_k1", K1)):
            value = value + e(f"navigation.{name}.{axis}_cosine", 0.0) * np.cos(rate * t)
            value = value + e(f"navigation.{name}.{axis}_sine", 0.0) * np.sin(rate * t)
        flow.append(value)
    turn = -2 * EARTH_ROTATION * np.sin(np.radians(world.ocean.region.latitude)) * t
    a, b = e("navigation.inertial_oscillation.cosine", 0.0), e("navigation.inertial_oscillation.sine", 0.0)
    flow[0] = flow[0] + a * np.cos(turn) - b * np.sin(turn)
    flow[1] = flow[1] + a * np.sin(turn) + b * np.cos(turn)
    common = [f.copy() for f in flow]
    deep = 1.0 - np.exp(-n["depth"] / e("navigation.current_shear.scale", 20.0))
    loss = e("navigation.current_shear.loss", 0.0)
    flow[0] = flow[0] + deep * (e("navigation.current_shear.east", 0.0) - loss * n["flow_east"])
    flow[1] = flow[1] + deep * (e("navigation.current_shear.north", 0.0) - loss * n["flow_north"])
    seconds = np.bincount(world.segment, n["seconds"])
    good = seconds > 1800.0

    def mean(values: Array) -> Array:
        return (np.bincount(world.segment, values * n["seconds"]) / np.maximum(seconds, 1.0))[good]

    out["segment_time"] = mean(t)
    out["ground_east"] = mean(speed * np.sin(h + error) + flow[0])
    out["ground_north"] = mean(speed * np.cos(h + error) + flow[1])
    for axis, value in zip(("east", "north"), common, strict=True):
        out[f"drift_{axis}"] = mean(value) + e(f"navigation.surface_windage.{axis}", 0.0)


def _energy(world: World, effects: Mapping[str, float], out: dict[str, Array]) -> None:
    """Hotel power by half yo, charge by stroke, surface power and voltage by hour, voltage drop by stroke."""
    e, flown = effects.get, world.flown
    watts = power_of(flown, world.vehicle, effects)
    current, voltage = electricity(flown, watts, world.vehicle, effects)
    seen = current * (1.0 + e("sensor.current_gain.gain", 0.0)) + e("sensor.current_offset.offset", 0.0)
    shown = seen * 14.5
    total = np.concatenate([[0.0], np.cumsum(shown)])
    start = np.array([s.start for s in flown.strokes])
    stop = np.minimum(np.array([s.start + s.seconds for s in flown.strokes]), watts.size - 1)
    quiet = np.append(start[1:], watts.size - 1)
    ok = (quiet - stop) > 120
    out["hotel"] = ((total[quiet] - total[stop + 10]) / np.maximum(quiet - stop - 10, 1))[ok]
    out["hotel_time"] = 0.5 * (stop + quiet)[ok]
    surfaced = np.where(flown["phase"] == 0, 1.0, 0.0)
    out["surface"] = np.array([np.sum(shown * surfaced) / np.sum(surfaced)]) / 0.02
    joules = total[stop + 1] - total[start]
    outward = np.array([s.direction > 0 for s in flown.strokes])
    floor = 0.03 * np.where(outward, world.vehicle.pump_intercept + 0.5 * joules, world.vehicle.retract) + 4.0
    out["stroke"] = joules / floor
    hours = (np.arange(watts.size) / HOUR).astype(int)
    count = np.bincount(hours)
    out["volts"] = np.bincount(hours, voltage) / count
    out["voltage_time"] = (np.arange(count.size) + 0.5) * HOUR
    out["sag"] = (voltage[np.maximum(start - 5, 0)] - voltage[(start + stop) // 2]) / 0.016
    out["counter"] = np.array([total[-1] * e("sensor.coulomb_gain.gain", 0.0) / max(total[-1], 1.0)]) / 0.001


def _whiten(world: World, change: dict[str, Array]) -> Array:
    """One vector of a change in units of its noise."""
    rise = change["rise"]
    count = np.bincount(world.half)
    centre = np.bincount(world.half, rise) / np.maximum(count, 1)
    parts = [centre[count > 0] / 0.0032, (rise - centre[world.half]) / 0.0035]
    parts.append(world.whiteners["hotel"] @ change["hotel"])
    for axis in ("east", "north"):
        parts.append(world.whiteners["drift"] @ change[f"ground_{axis}"])
        # The drift while surfaced shares the product's error with the segments: what it adds is the difference.
        parts.append((change[f"drift_{axis}"] - change[f"ground_{axis}"]) / 0.016)
    parts.append(world.whiteners["volts"] @ change["volts"])
    parts += [change[k] for k in ("stroke", "surface", "sag", "gauge", "chart", "counter")]
    return np.concatenate(parts)


def signature(world: World, effects: Mapping[str, float]) -> Array:
    """Whitened change of the observations by effects, what calibration sigmas absorb projected out."""
    plain = world.plain
    seen = observe(world, effects)
    vector = _whiten(world, {k: seen[k] - plain[k] for k in plain})
    q = world.whiteners["calibrated"]
    padded = np.concatenate([vector, np.zeros(q.shape[1])])
    return padded - q @ (q.T @ padded)


def signal_to_noise(world: World, effects: Mapping[str, float]) -> float:
    """Norm of the signature of effects; about 6 is needed to name one with confidence."""
    return float(np.linalg.norm(signature(world, effects)))
