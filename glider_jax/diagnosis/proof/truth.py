"""A glider flown second by second: added mass, pump and pitch servo, its own reckoning and its own decisions.

Imports NumPy and the oceans of the proof. The equations of motion are integrated in body axes with added mass,
half a second at a time; nothing is shared with the steady glide that the inference solves. Angles rad, pitch nose
up, headings clockwise from true north, depth down, power W. An effect is a number under ``id.parameter``; what is
not named is zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glider_jax.diagnosis.proof.ocean import DAY, EARTH_ROTATION, K1, M2, S2, TABLE_STEP, Ocean, red_noise

Array = NDArray[np.float64]

GRAVITY = 9.807
HALF = 0.5  # s, step of the equations of motion
AXIAL, NORMAL = 0.20, 0.92  # added mass over mass, along and across the hull
SURFACED = 0.3  # m, gauge depth of a floating glider
STEEPEST = 0.6  # rad, angle of attack beyond which lift and drag grow no more


@dataclass(frozen=True)
class Vehicle:
    """A vehicle's constants; SI, volumes m3, times s. One instance holds the truth, another what its file says."""

    mass: float
    volume: float
    parasite_drag: float
    induced_drag: float
    lift_slope: float
    pump_volume: float
    pump_rate: float
    hotel: float
    pump_intercept: float
    pump_slope: float
    retract: float
    brake: float
    surface: float
    capacity: float
    full: float
    empty: float
    wing_area: float = 0.1


@dataclass(frozen=True)
class Plan:
    """A mission as the pilot wrote it; angles rad, depths m, times s, waypoints m east and north of the first."""

    waypoints: tuple[tuple[float, float], ...]
    radius: float
    dive_to: float
    climb_to: float
    altitude: float
    pitch: float
    surface_every: float
    surface_stay: float


@dataclass(frozen=True)
class Stroke:
    """One movement of the pump: second it began, direction (+1 out), depth m, temperature degC, seconds it took."""

    start: int
    direction: int
    depth: float
    temperature: float
    seconds: int


@dataclass
class Flown:
    """What happened, one value a second: names as in the equations; ``phase`` -1 dive, +1 climb, 0 surfaced."""

    plan: Plan
    vehicle: Vehicle
    columns: dict[str, Array] = field(default_factory=dict)
    strokes: list[Stroke] = field(default_factory=list)

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]


_COLUMNS = (
    "depth", "speed", "rise", "pitch", "indicated_pitch", "indicated_heading", "ballast", "phase", "pumping",
    "temperature", "east", "north", "reckoned_east", "reckoned_north", "bottom", "waypoint",
)  # fmt: skip


def fly(
    ocean: Ocean, vehicle: Vehicle, plan: Plan, effects: Mapping[str, float], rng: np.random.Generator
) -> Flown:
    """Fly a mission from the surface at its first waypoint for the ocean's duration.

    Parameters
    ----------
    vehicle : the true constants.
    effects : true effects by ``id.parameter``; see :mod:`glider_jax.diagnosis.proof.cases` for all of them.
    rng : draws the control errors of pitch and heading.
    """
    n = int(ocean.duration)
    e = effects.get
    log = np.zeros((n, len(_COLUMNS)))
    rows: list[tuple] = []
    strokes: list[Stroke] = []
    vertical = ocean.vertical.tolist()
    wander = _slow(rng, n, 0.03, 70.0)
    nod = _slow(rng, n, 0.014, 40.0)

    sin, cos, atan2, sqrt, tan, exp, pi = (
        math.sin,
        math.cos,
        math.atan2,
        math.sqrt,
        math.tan,
        math.exp,
        math.pi,
    )
    v = vehicle
    eps, expansion = (
        e("flight.hull_compressibility.compressibility", 0.0),
        e("flight.thermal_expansion.expansion", 0.0),
    )
    oil_gain, oil_offset = 1.0 + e("flight.oil_gain.gain", 0.0), e("flight.oil_offset.volume", 0.0)
    air, air_decay = e("flight.bladder_air.volume", 0.0), e("flight.bladder_air.decay", 1800.0)
    p_offset, p_gain = e("flight.pitch_offset.offset", 0.0), e("flight.pitch_gain.gain", 0.0)
    asymmetry, cold_drag = e("flight.drag_asymmetry.share", 0.0), e("out.drag_by_temperature.slope", 0.0)
    h_sin, h_cos = e("navigation.compass_deviation.sine", 0.0), e("navigation.compass_deviation.cosine", 0.0)
    s_sin, s_cos = e("navigation.soft_iron.sine", 0.0), e("navigation.soft_iron.cosine", 0.0)
    declination, three = (
        e("navigation.magnetic_declination.angle", 0.0),
        e("out.heading_three.amplitude", 0.0),
    )
    shear = _Shear(e)
    wind_e, wind_n = e("navigation.surface_windage.east", 0.0), e("navigation.surface_windage.north", 0.0)
    z_offset = e("sensor.pressure_offset.offset", 0.0)
    z_gain = 1.0 + e("sensor.pressure_gain.gain", 0.0)
    tide_w = e("flight.internal_tide.cosine", 0.0), e("flight.internal_tide.sine", 0.0)
    layer = e("out.layer_motion.velocity", 0.0)
    lift = v.lift_slope * (1.0 - e("flight.lift_loss.loss", 0.0))
    chart_bias = e("seafloor.bathymetry_bias.bias", 0.0)
    half_area = 0.5 * v.wing_area
    induced = v.induced_drag * (1.0 + e("flight.induced_drag_bias.share", 0.0))

    east, north = plan.waypoints[0]
    reck_e, reck_n = east, north
    z, u, w, pitch, ballast = SURFACED, 0.0, 0.0, -plan.pitch * 0.3, v.pump_volume
    phase, target, since, left_at, bias = 0, 1, 0, -1, 0.0
    stroke_until, reck_speed, z_filtered, z_last = -1, 0.0, z, z
    heading = 0.0
    mx, mn = v.mass * (1.0 + AXIAL), v.mass * (1.0 + NORMAL)
    for k in range(n):
        if k % 10 == 0:
            if k % 600 == 0:
                rho_of, t_of = (a.tolist() for a in ocean.table(float(k)))
            if k % 30 == 0:
                flow_e, flow_n = ocean.flow(east, north, float(k))
                floor = float(ocean.bottom(np.array(east), np.array(north))) + chart_bias
            mass, drag, w_extra, cur_e, cur_n = _slow_effects(e, v, k, ocean)
        # ---- the mission: yo, surfacing, waypoints, steering by the vehicle's own reckoning
        z_seen = z * z_gain + z_offset
        z_filtered += 0.35 * (z_seen - z_filtered)
        if phase == 0:
            if k - since >= plan.surface_stay:
                phase, since, left_at, bias = -1, k, k, rng.normal(0.0, 0.011)
                stroke_until = _stroke(strokes, k, -1, 0.0, t_of[0], v, ballast)
        elif k % 4 == 0 and k - since > 12:
            if phase < 0 and (z_filtered >= plan.dive_to or (floor - z <= plan.altitude and k - since > 40)):
                phase, since, bias = 1, k, rng.normal(0.0, 0.011)
                stroke_until = _stroke(strokes, k, 1, z, t_of[int(z / TABLE_STEP)], v, ballast)
            elif phase > 0 and z_filtered <= plan.climb_to and k - left_at < plan.surface_every:
                phase, since, bias = -1, k, rng.normal(0.0, 0.011)
                stroke_until = _stroke(strokes, k, -1, z, t_of[int(z / TABLE_STEP)], v, ballast)
        if phase > 0 and z <= SURFACED:
            phase, since, z, u, w = 0, k, SURFACED, 0.0, 0.0
        goal_e, goal_n = plan.waypoints[target]
        if k % 4 == 0:
            to_e, to_n = goal_e - reck_e, goal_n - reck_n
            if to_e * to_e + to_n * to_n < plan.radius * plan.radius:
                target = (target + 1) % len(plan.waypoints)
            heading = atan2(to_e, to_n) + wander[k]
            rate = (z_filtered - z_last) / 4.0
            z_last = z_filtered
        # ---- actuators
        goal = v.pump_volume if phase > 0 or phase == 0 else -v.pump_volume
        room = goal - ballast
        rate_now = v.pump_rate * (1.0 - 0.0008 * z)
        pumping = k < stroke_until or abs(room) > rate_now
        ballast = goal if abs(room) <= rate_now else ballast + (rate_now if room > 0.0 else -rate_now)
        wanted = (plan.pitch + bias + nod[k]) if phase >= 0 else -(plan.pitch + bias) + nod[k]
        indicated = (pitch - p_offset) / (1.0 + p_gain)
        pitch += (wanted - indicated) / 9.0
        true_heading = heading + h_sin * sin(heading) + h_cos * cos(heading) + declination
        if s_sin or s_cos or three:
            true_heading += s_sin * sin(2 * heading) + s_cos * cos(2 * heading) + three * sin(3 * heading)
        # ---- motion
        i = int(z / TABLE_STEP)
        share = z / TABLE_STEP - i
        rho = rho_of[i] + (rho_of[i + 1] - rho_of[i]) * share
        temperature = t_of[i] + (t_of[i + 1] - t_of[i]) * share
        if phase == 0:
            speed = rise = 0.0
            east += flow_e + cur_e + wind_e
            north += flow_n + cur_n + wind_n
            if k - since > 45:
                reck_e, reck_n = east, north
        else:
            pascal = 10079.5 * z
            volume = (
                v.volume * (1.0 - eps * pascal + expansion * (temperature - 15.0))
                + ballast * oil_gain
                + oil_offset
            )
            if air:
                volume += air / (1.0 + pascal / 101325.0) * exp(-(k - left_at) / air_decay)
            push = GRAVITY * (rho * volume - mass)
            cd0 = drag * (1.0 + asymmetry * phase + cold_drag * (temperature - 15.0))
            s, c = sin(pitch), cos(pitch)
            for _ in (0, 1):
                along, across = u * c + w * s, w * c - u * s
                through = sqrt(along * along + across * across) + 1e-4
                attack = atan2(-across, abs(along) + 1e-3)
                attack = min(max(attack, -STEEPEST), STEEPEST)
                q = half_area * rho * through
                cd = cd0 + induced * attack * attack
                along = (along + HALF * (push * s - q * lift * attack * across) / mx) / (
                    1.0 + HALF * q * cd / mx
                )
                slope = lift * attack * along / (-across) if abs(across) > 1e-4 else lift
                slope = slope if slope > 0.0 else 0.0
                across = (across + HALF * push * c / mn) / (1.0 + HALF * q * (cd + slope) / mn)
                u, w = along * c - across * s, along * s + across * c
            drift = vertical[k] + w_extra
            if tide_w[0] or tide_w[1]:
                drift += (tide_w[0] * cos(M2 * k) + tide_w[1] * sin(M2 * k)) * sin(pi * z / floor)
            if layer and 12.0 < z < 42.0:
                drift += layer * sin(pi * (z - 12.0) / 30.0)
            z -= w + drift * min(z / 4.0, 1.0)
            z = 0.05 if z < 0.05 else (floor - 0.5 if z > floor - 0.5 else z)
            speed, rise = u, w
            fade_e, fade_n = shear(z, flow_e, flow_n)
            east += u * sin(true_heading) + flow_e + cur_e + fade_e
            north += u * cos(true_heading) + flow_n + cur_n + fade_n
            # the vehicle reckons without angle of attack, and keeps its last speed near level flight
            if abs(indicated) > 0.19:
                reck_speed = abs(rate) / abs(tan(indicated))
            reck_e += reck_speed * sin(heading)
            reck_n += reck_speed * cos(heading)
        rows.append((z, speed, rise, pitch, indicated, heading, ballast, phase, pumping, temperature, east, north,
                     reck_e, reck_n, floor, target))  # fmt: skip
        if len(rows) == 20000:
            log[k + 1 - len(rows) : k + 1] = rows
            rows.clear()
    if rows:
        log[n - len(rows) :] = rows
    flown = Flown(plan, vehicle, {name: log[:, i] for i, name in enumerate(_COLUMNS)}, strokes)
    flown.columns["indicated_heading"] = np.mod(flown["indicated_heading"], 2 * np.pi)
    return flown


def _slow(rng: np.random.Generator, count: int, sd: float, scale: float) -> list[float]:
    """Red noise per second, made every 10 s and joined by lines."""
    coarse = red_noise(rng, count // 10 + 2, 10.0, sd, scale)
    return np.interp(np.arange(count), np.arange(coarse.size) * 10.0, coarse).tolist()


def _stroke(
    strokes: list, k: int, direction: int, depth: float, temperature: float, v: Vehicle, now: float
) -> int:
    """Note a movement of the pump and return the second at which it will end."""
    way = abs(direction * v.pump_volume - now)
    seconds = max(int(math.ceil(way / (v.pump_rate * (1.0 - 0.0008 * depth)))), 1)
    strokes.append(Stroke(k, direction, depth, temperature, seconds))
    return k + seconds


class _Shear:
    """Extra flow at depth: the surface flow fades and a deep flow of its own takes over."""

    def __init__(self, e) -> None:
        self.loss = e("navigation.current_shear.loss", 0.0)
        self.east, self.north = (
            e("navigation.current_shear.east", 0.0),
            e("navigation.current_shear.north", 0.0),
        )
        self.scale = e("navigation.current_shear.scale", 20.0)
        self.active = bool(self.loss or self.east or self.north)

    def __call__(self, z: float, flow_e: float, flow_n: float) -> tuple[float, float]:
        if not self.active:
            return 0.0, 0.0
        deep = 1.0 - math.exp(-z / self.scale)
        return deep * (self.east - self.loss * flow_e), deep * (self.north - self.loss * flow_n)


def _slow_effects(e, v: Vehicle, k: int, ocean: Ocean) -> tuple[float, float, float, float, float]:
    """Mass, parasite drag, vertical velocity and unresolved current at second ``k``: what changes over minutes."""
    day = k / DAY
    mass = v.mass + e("flight.ballast_offset.mass", 0.0) + e("flight.mass_growth.rate", 0.0) * k
    ingress = e("flight.water_ingress.mass", 0.0)
    if ingress:
        mass += ingress / (
            1.0 + math.exp(min(max(-(k - e("flight.water_ingress.onset", 0.0)) / 7200.0, -50.0), 50.0))
        )
    drag = v.parasite_drag * (1.0 + e("flight.drag_bias.share", 0.0) + e("flight.drag_growth.rate", 0.0) * k)
    step = e("out.drag_step.share", 0.0)
    if step and e("out.drag_step.begin", 0.0) <= day < e("out.drag_step.end", 9.0):
        drag *= 1.0 + step
    rise = e("flight.mean_upwelling.velocity", 0.0)
    period = e("flight.vertical_water_velocity.period", 0.0)
    if period:
        turn = 2 * math.pi * k / period
        rise += e("flight.vertical_water_velocity.cosine", 0.0) * math.cos(turn)
        rise += e("flight.vertical_water_velocity.sine", 0.0) * math.sin(turn)
    front = e("out.front_motion.velocity", 0.0)
    if front:
        since = (day - e("out.front_motion.begin", 1.0)) / 0.06
        rise += front * (1.0 - since * since) * math.exp(-0.5 * since * since)
    cur = [e("navigation.mean_current.east", 0.0), e("navigation.mean_current.north", 0.0)]
    for name, rate in (("tidal_current", M2), ("tide_s2", S2), ("tide_k1", K1)):
        cos, sin = math.cos(rate * k), math.sin(rate * k)
        for c, axis in enumerate(("east", "north")):
            cur[c] += (
                e(f"navigation.{name}.{axis}_cosine", 0.0) * cos
                + e(f"navigation.{name}.{axis}_sine", 0.0) * sin
            )
    a, b = e("navigation.inertial_oscillation.cosine", 0.0), e("navigation.inertial_oscillation.sine", 0.0)
    if a or b:
        turn = -2 * EARTH_ROTATION * math.sin(math.radians(ocean.region.latitude)) * k
        cur[0] += a * math.cos(turn) - b * math.sin(turn)
        cur[1] += a * math.sin(turn) + b * math.cos(turn)
    return mass, drag, rise, cur[0], cur[1]
