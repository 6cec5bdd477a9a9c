"""A small independent simulator for tests: steady glides by substitution, no shared code with the replay."""

from __future__ import annotations

import math

import numpy as np

from glider_jax.config import Battery, Quantity, Vehicle
from glider_jax.environment import seawater
from glider_jax.records import Recording, Source

TURN = 0.8  # m that a turn runs past the depth at which it is told to begin
STEP, MASS, AREA, CD0, CD1, LIFT = 8.0, 52.0, 0.1, 0.15, 10.5, 7.5
LATITUDE, LONGITUDE = 39.0, -73.0
METRE = 180.0 / math.pi / 6_371_000.0


_DEPTHS = np.linspace(0.0, 100.0, 21)
_DENSITIES = seawater.density(35.0, 10.0, seawater.pressure_dbar_from_depth(_DEPTHS, math.radians(LATITUDE)))


def vehicle() -> Vehicle:
    """The base model's numbers with their sigmas, volume chosen to float at 30 m."""
    q = {
        "flight.mass": Quantity(MASS, 0.003, "kg"),
        "flight.volume": Quantity(hull(), 0.0, "m3"),
        "flight.wing_area": Quantity(AREA, 0.0, "m2"),
        "flight.parasite_drag": Quantity(CD0, 0.004),
        "flight.induced_drag": Quantity(CD1, 0.0, "rad-2"),
        "flight.lift_slope": Quantity(LIFT, 0.0, "rad-1"),
        "flight.pump_volume": Quantity(230e-6, 0.0, "m3"),
        "energy.hotel": Quantity(1.1, 0.015, "W"),
        "energy.pump_dive_to_climb.intercept": Quantity(110.0, 5.0, "J"),
        "energy.pump_dive_to_climb.slope": Quantity(6.0, 0.15, "J m-1"),
        "energy.pump_dive_to_climb.reference_volume": Quantity(460e-6, 0.0, "m3"),
        "energy.pump_climb_to_dive": Quantity(85.0, 4.0, "J"),
        "energy.brake": Quantity(45.0, 2.0, "J"),
        "energy.surface": Quantity(2.5, 0.05, "W"),
    }
    battery = Battery(
        "test", "alkaline", Quantity(6e5), Quantity(7.5e6), ((0.0, 11.0), (1.0, 15.0)), Quantity(1.0), Quantity(0.0)
    )
    return Vehicle("test glider", q, (), battery)


def hull() -> float:
    """Volume that floats at 30 m, m3."""
    return MASS / float(water(30.0))


def water(depth):
    """Density of the test's water, kg m-3."""
    return np.interp(depth, _DEPTHS, _DENSITIES)


def glide(force: float, pitch: float, drag: float, lift: float) -> tuple[float, float]:
    """Vertical (down) and horizontal speed of a steady glide, by repeated substitution."""
    if force * pitch <= 0.0:
        return 0.0, 0.0
    size, a = abs(pitch), 0.0
    for _ in range(12):
        a = min((drag + CD1 * a * a) / (lift * math.tan(size + a)), 0.3)
    path = size + a
    speed = math.sqrt(2.0 * abs(force) * math.sin(path) / (1025.0 * AREA * (drag + CD1 * a * a)))
    return -math.copysign(speed * math.sin(path), pitch), speed * math.cos(path)


def fly(
    days: float = 1.5,
    *,
    drag_rate: float = 0.0,
    dive_load: float = 0.0,
    mass: float = 0.0,
    compressibility: float = 0.0,
    current: tuple[float, float] = (0.0, 0.0),
    deviation: float = 0.0,
    noise: float = 1.0,
    seed: int = 3,
) -> Recording:
    """Fly yos between 3 and 60 m with a surfacing every three hours, and record them with noise."""
    rng = np.random.default_rng(seed)
    n = int(days * 86400.0 / STEP)
    time = 1.25e9 + STEP * np.arange(n)
    keys = "depth pitch heading pumped_volume current battery_voltage charge_used pump_moving".split()
    data = {key: np.full(n, np.nan) for key in keys}
    fix = np.full((n, 2), np.nan)
    z, w, u, volume, phase = 0.3, 0.0, 0.0, 230e-6, "up"
    pitch, east, north, charge, until, dived, turned = math.radians(26.0), 0.0, 0.0, 0.0, 600.0, 0.0, 60.0
    for k in range(n):
        t = k * STEP
        before = volume
        if phase == "up" and t >= until:
            phase, dived = "dive", t
        elif phase == "dive" and z >= 60.0:
            phase, turned = "climb", z + TURN
        elif phase == "climb" and z <= 3.0 and t - dived < 10800.0:
            phase = "dive"
        elif phase == "climb" and z <= 0.4:
            phase, until = "up", t + 720.0
        wish = -230e-6 if phase == "dive" else 230e-6
        volume += float(np.clip(wish - volume, -12e-6 * STEP, 12e-6 * STEP))
        goal = -math.radians(26.0) if phase == "dive" else math.radians(26.0)
        pitch += (goal - pitch) * (1.0 - math.exp(-STEP / 10.0))
        rho = float(water(z))
        squeezed = hull() * (1.0 - compressibility * 1e4 * 1.01 * z)
        force = 9.80 * (rho * (squeezed + volume) - MASS - mass)
        drag = CD0 * (1.0 + drag_rate * t / 86400.0)
        down, along = glide(force, pitch, drag, LIFT) if phase != "up" else (0.0, 0.0)
        share = 1.0 - math.exp(-STEP / 10.0)
        w, u = (w + (down - w) * share, u + (along - u) * share) if phase != "up" else (0.0, 0.0)
        z = 0.3 if phase == "up" else max(z + w * STEP, 0.3)
        heading = math.radians((0.0, 90.0, 200.0, 290.0)[int(t // 21600.0) % 4])
        true = heading + deviation * math.sin(heading)
        east += STEP * (u * math.sin(true) + current[0])
        north += STEP * (u * math.cos(true) + current[1])
        moved = abs(volume - before)
        energy = STEP * (1.1 + (2.5 if phase == "up" else 0.0) + (dive_load if phase == "dive" else 0.0))
        if moved > 0.0 and phase in ("dive", "climb"):
            stroke = 110.0 + 6.0 * turned if phase == "climb" else 85.0
            energy += (stroke + 45.0) * moved / 460e-6
        volts = 15.0 - 4.0 * 15.0 * charge / 7.5e6
        charge += energy / volts
        data["depth"][k] = z + 0.02 * noise * rng.normal()
        data["pitch"][k] = pitch + 0.004 * noise * rng.normal()
        data["heading"][k] = heading
        data["pumped_volume"][k] = volume
        data["current"][k] = energy / volts / STEP * (1.0 + 0.01 * noise * rng.normal())
        data["battery_voltage"][k] = volts + 0.01 * noise * rng.normal()
        data["charge_used"][k] = charge
        data["pump_moving"][k] = float(moved > 0.0)
        if phase == "up" and t - (until - 720.0) > 40.0:
            fix[k] = north + 4.0 * noise * rng.normal(), east + 4.0 * noise * rng.normal()
    channels = {key: values for key, values in data.items() if np.isfinite(values).any()}
    channels["gps_latitude"] = LATITUDE + fix[:, 0] * METRE
    channels["gps_longitude"] = LONGITUDE + fix[:, 1] * METRE / math.cos(math.radians(LATITUDE))
    return Recording("made", time, channels, Source("test"), time[:1], attributes={"heading_reference": "true"})
