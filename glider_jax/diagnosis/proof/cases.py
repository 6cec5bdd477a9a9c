"""Cases of the proof: four seas with their gliders, every concealable effect, and how a case is drawn and written.

Imports NumPy and the proof's own modules. An effect is drawn with a direction and a shape, then scaled until its
signal-to-noise ratio (see :mod:`glider_jax.diagnosis.proof.strength`) is the wanted one. Parameters have the names
and units of the library's terms; all are SI.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from glider_jax.diagnosis.proof import sensors
from glider_jax.diagnosis.proof.ocean import DAY, Ocean, Region
from glider_jax.diagnosis.proof.strength import CALIBRATED, World, prepare, signal_to_noise, signature
from glider_jax.diagnosis.proof.truth import Plan, Vehicle, fly
from glider_jax.errors import ConfigError, did_you_mean

DURATION = 3.5 * DAY
Draw = Callable[[np.random.Generator, Region], dict[str, float]]

REGIONS = (
    Region("west_florida", 27.35, -83.75, 1439812800.0, ((0, 0), (-28, 9), (-20, -24), (9, -12)), 78.0, 0.55, 265.0,
           2.5, 29.3, 20.5, 35.4, 36.3, 34.0, 9.0, (0.04, -0.07), 0.075, (0.03, 0.05)),
    Region("celtic_sea", 50.45, -7.9, 1530187200.0, ((0, 0), (24, 14), (31, -19), (4, -22)), 108.0, 0.12, 230.0,
           3.0, 16.8, 10.1, 35.05, 35.35, 31.0, 6.0, (0.02, 0.02), 0.045, (0.26, 0.21)),
    Region("oregon", 44.55, -124.85, 1370736000.0, ((0, 0), (-21, 4), (-26, 29), (-3, 23)), 168.0, 2.4, 275.0,
           6.0, 13.4, 7.7, 31.9, 33.8, 22.0, 11.0, (0.01, -0.11), 0.07, (0.04, 0.05)),
    Region("gippsland", -38.75, 148.6, 1612310400.0, ((0, 0), (19, -17), (38, 3), (14, 12)), 74.0, 0.25, 150.0,
           3.0, 20.6, 14.2, 35.3, 35.5, 38.0, 12.0, (0.09, 0.05), 0.06, (0.07, 0.04)),
)  # fmt: skip

VEHICLES = (
    Vehicle(54.10, 54.10 / 1024.1, 0.172, 11.2, 7.1, 222e-6, 17.5e-6,
            1.62, 128.0, 5.2, 96.0, 38.0, 2.9, 8.3e6, 15.3, 11.2),
    Vehicle(52.65, 52.65 / 1026.6, 0.148, 10.1, 7.8, 235e-6, 22.0e-6,
            0.94, 96.0, 6.6, 78.0, 52.0, 2.2, 5.9e6, 14.8, 10.9),
    Vehicle(53.30, 53.30 / 1025.7, 0.189, 10.5, 7.4, 228e-6, 14.0e-6,
            2.25, 142.0, 5.7, 105.0, 44.0, 3.3, 9.0e6, 15.6, 11.4),
    Vehicle(51.72, 51.72 / 1025.6, 0.135, 9.6, 6.9, 216e-6, 19.0e-6,
            1.28, 117.0, 6.1, 88.0, 60.0, 2.0, 6.6e6, 15.1, 11.0),
)  # fmt: skip

PLANS = (
    (800.0, 85.0, 4.0, 6.0, 26.0, 10800.0, 840.0),
    (600.0, 96.0, 5.0, 8.0, 24.0, 9000.0, 660.0),
    (1000.0, 170.0, 3.0, 9.0, 27.0, 14400.0, 900.0),
    (700.0, 92.0, 3.5, 7.0, 25.0, 12600.0, 720.0),
)  # radius, dive_to, climb_to, altitude m, pitch degrees, surface_every, surface_stay s

SIGMA = {
    "mass": 0.003, "parasite_drag": 0.004, "hotel": 0.015, "pump_intercept": 5.0, "pump_slope": 0.15, "retract": 4.0,
    "brake": 2.0, "surface": 0.05,
}  # fmt: skip


def _one(*, sign: float = 0.0, **sizes: float) -> Draw:
    """One parameter of a given typical size; ``sign`` +1 keeps it positive, 0 draws it."""
    ((name, size),) = sizes.items()

    def draw(rng: np.random.Generator, region: Region) -> dict[str, float]:
        return {name: size * (sign or rng.choice([-1.0, 1.0]))}

    return draw


def _turned(first: str, second: str, size: float) -> Draw:
    """Two parameters of a vector or a phase, turned at random."""

    def draw(rng: np.random.Generator, region: Region) -> dict[str, float]:
        angle = rng.uniform(0, 2 * math.pi)
        return {first: size * math.cos(angle), second: size * math.sin(angle)}

    return draw


def _ellipse(size: float) -> Draw:
    def draw(rng: np.random.Generator, region: Region) -> dict[str, float]:
        out = {}
        for axis, share in (("east", rng.uniform(0.5, 1.0)), ("north", rng.uniform(0.5, 1.0))):
            phase = rng.uniform(0, 2 * math.pi)
            out[f"{axis}_cosine"], out[f"{axis}_sine"] = (
                size * share * math.cos(phase),
                size * share * math.sin(phase),
            )
        return out

    return draw


def _waves(rng: np.random.Generator, region: Region) -> dict[str, float]:
    phase = rng.uniform(0, 2 * math.pi)
    size = 0.006
    return {
        "cosine": size * math.cos(phase),
        "sine": size * math.sin(phase),
        "period": rng.uniform(2.5, 14.0) * 3600.0,
    }


def _shear(rng: np.random.Generator, region: Region) -> dict[str, float]:
    angle = rng.uniform(0, 2 * math.pi)
    return {"loss": rng.uniform(0.2, 0.6), "east": 0.06 * math.cos(angle), "north": 0.06 * math.sin(angle),
            "scale": rng.uniform(10.0, 25.0)}  # fmt: skip


def _late(name: str, size: float) -> Draw:
    def draw(rng: np.random.Generator, region: Region) -> dict[str, float]:
        return {name: size, "onset": rng.uniform(0.8, 2.6) * DAY}

    return draw


def _gauge(rng: np.random.Generator, region: Region) -> dict[str, float]:
    return {"offset": 0.3 * rng.choice([-1.0, 1.0]), "both_gauges": float(rng.random() < 0.5)}


def _window(rng: np.random.Generator, region: Region) -> dict[str, float]:
    begin = rng.uniform(0.7, 2.0)
    return {"share": 0.15, "begin": begin, "end": begin + rng.uniform(0.5, 1.2)}


PUBLISHED: dict[str, Draw] = {
    "flight.hull_compressibility": _one(sign=1.0, compressibility=4e-10),
    "flight.thermal_expansion": _one(sign=1.0, expansion=5e-5),
    "flight.drag_growth": _one(sign=1.0, rate=0.08 / DAY),
    "flight.ballast_offset": _one(mass=0.03),
    "flight.mass_growth": _one(sign=1.0, rate=0.01 / DAY),
    "flight.vertical_water_velocity": _waves,
    "flight.pitch_offset": _one(offset=0.02),
    "flight.lift_loss": _one(sign=1.0, loss=0.2),
    "navigation.mean_current": _turned("east", "north", 0.1),
    "navigation.current_shear": _shear,
    "navigation.tidal_current": _ellipse(0.08),
    "navigation.inertial_oscillation": _turned("cosine", "sine", 0.08),
    "navigation.surface_windage": _turned("east", "north", 0.12),
    "navigation.compass_deviation": _turned("sine", "cosine", 0.12),
    "navigation.magnetic_declination": _one(angle=0.1),
    "energy.pump_pressure_nonlinearity": _one(sign=1.0, curvature=0.02),
    "energy.dive_only_load": _one(sign=1.0, power=0.3),
    "energy.hotel_growth": _one(sign=1.0, rate=0.1 / DAY),
    "energy.surface_load": _one(sign=1.0, power=0.8),
    "energy.brake_pressure": _one(sign=1.0, slope=0.5),
    "energy.internal_resistance": _one(sign=1.0, resistance=0.1),
    "energy.cold_friction": _one(sign=1.0, slope=0.02),
    "sensor.current_offset": _one(offset=0.01),
    "sensor.current_gain": _one(gain=0.04),
    "sensor.pressure_offset": _gauge,
}

FURTHER: dict[str, Draw] = {
    "flight.drag_bias": _one(share=0.2),
    "flight.induced_drag_bias": _one(share=0.25),
    "flight.pitch_gain": _one(gain=0.06),
    "flight.oil_gain": _one(gain=0.05),
    "flight.drag_asymmetry": _one(share=0.12),
    "flight.salinity_bias": _one(bias=0.3),
    "flight.water_ingress": _late("mass", 0.05),
    "flight.internal_tide": _turned("cosine", "sine", 0.008),
    "flight.mean_upwelling": _one(velocity=0.004),
    "navigation.soft_iron": _turned("sine", "cosine", 0.08),
    "navigation.tide_k1": _ellipse(0.06),
    "energy.climb_only_load": _one(sign=1.0, power=0.3),
    "energy.hotel_bias": _one(power=0.15),
    "energy.pump_fixed_cost": _one(energy=40.0),
    "energy.pump_slope": _one(slope=1.0),
    "energy.retract_pressure": _one(slope=0.5),
    "energy.pump_wear": _one(sign=1.0, rate=2e-4),
    "energy.brake_wear": _one(sign=1.0, rate=0.03),
    "energy.cold_resistance": _one(sign=1.0, slope=0.02),
    "energy.voltage_offset": _one(offset=0.1),
    "energy.capacity_loss": _one(sign=1.0, share=0.1),
    "energy.iridium_call": _one(sign=1.0, power=1.5),
    "sensor.coulomb_gain": _one(gain=0.02),
    "sensor.pressure_gain": _one(gain=0.02),
    "seafloor.bathymetry_bias": _one(bias=6.0),
}

OUTSIDE: dict[str, Draw] = {
    "out.drag_step": _window,
    "out.drag_by_temperature": _one(slope=0.02),
    "out.heading_three": _one(amplitude=0.12),
    "out.hotel_by_night": _one(sign=1.0, power=0.2),
    "out.layer_motion": _one(velocity=0.008),
    "out.front_motion": lambda rng, region: {
        "velocity": 0.02 * rng.choice([-1.0, 1.0]),
        "begin": rng.uniform(0.6, 2.8),
    },
    "out.frozen_pitch": _one(sign=1.0, share=0.08),
    "out.pump_retries": _one(sign=1.0, share=0.15),
}

SMALLEST, LARGEST = (
    0.1,
    3.0,
)  # of an effect's typical size: less is nothing a pilot would miss, more is absurd
UNSCALED = {"period", "scale", "onset", "begin", "end", "both_gauges", "decay"}
FIXED = {"out.frozen_pitch", "out.pump_retries"}  # a fault of sensor or pump: as strong as drawn
UNSEEN = {0: ("energy.cold_friction",)}  # what a region cannot show: its water is never colder than 15 degC
CONFUSABLE = (
    ("flight.ballast_offset", "flight.pitch_offset"),
    ("flight.hull_compressibility", "flight.thermal_expansion"),
    ("flight.drag_growth", "flight.lift_loss"),
    ("navigation.tidal_current", "navigation.inertial_oscillation"),
    ("navigation.compass_deviation", "navigation.magnetic_declination"),
    ("navigation.mean_current", "navigation.current_shear"),
    ("energy.pump_pressure_nonlinearity", "energy.cold_friction"),
    ("energy.brake_pressure", "energy.pump_pressure_nonlinearity"),
    ("energy.hotel_growth", "sensor.current_offset"),
    ("energy.dive_only_load", "sensor.current_gain"),
    ("flight.mass_growth", "flight.hull_compressibility"),
)


def recipes() -> dict[str, Draw]:
    """Every effect that can be concealed, by id."""
    return PUBLISHED | FURTHER | OUTSIDE


@dataclass(frozen=True)
class Spec:
    """What a case is asked to be: set, effects and their wanted signal-to-noise ratios, place and seed."""

    name: str
    kind: str  # null, single, pair, out
    effects: tuple[tuple[str, float], ...]
    region: int
    seed: int


def plan_of(index: int) -> Plan:
    """The mission of a region."""
    radius, dive_to, climb_to, altitude, pitch, every, stay = PLANS[index]
    points = tuple((1e3 * x, 1e3 * y) for x, y in REGIONS[index].waypoints)
    return Plan(points, radius, dive_to, climb_to, altitude, math.radians(pitch), every, stay)


@lru_cache(maxsize=len(REGIONS))
def world_of(index: int) -> World:
    """A mission of the region flown without effects, for the sizes of effects; always the same."""
    rng = np.random.default_rng(7100 + index)
    ocean = Ocean(REGIONS[index], rng, DURATION)
    flown = fly(ocean, VEHICLES[index], plan_of(index), {}, rng)
    return prepare(ocean, VEHICLES[index], flown, SIGMA)


def draw_effect(
    id: str,
    wanted: float,
    region: int,
    rng: np.random.Generator,
    limits: tuple[float, float] = (1e-6, LARGEST),
) -> tuple[dict[str, float], float]:
    """Draw an effect of a wanted signal-to-noise ratio: parameters by ``id.parameter`` and the ratio reached.

    The ratio is missed where it would take less or more than ``limits`` times the effect's typical size.

    Raises
    ------
    ConfigError : the id is not one that the truth can fly, or the region's mission cannot show it.
    """
    known = recipes()
    if id not in known:
        raise ConfigError(f"prove: unknown effect '{id}'.{did_you_mean(id, known)}")
    drawn = known[id](rng, REGIONS[region])
    full = {f"{id}.{name}": value for name, value in drawn.items()}
    if id in FIXED:
        return full, float("nan")
    world = world_of(region)
    reached = signal_to_noise(world, full)
    if reached < 1e-6:
        raise ConfigError(f"prove: '{id}' leaves no trace in {REGIONS[region].name}. Choose another region.")
    scale, (least, most) = 1.0, limits
    for _ in range(12):
        # Most effects are close to linear, and two steps settle them; what is not is closed in on.
        aim = scale * wanted / reached
        if (least, most) == limits:
            scale = float(np.clip(aim, *limits))
        else:
            scale = float(aim) if least < aim < most else math.sqrt(least * most)
        full = {f"{id}.{name}": value if name in UNSCALED else value * scale for name, value in drawn.items()}
        reached = signal_to_noise(world, full)
        if abs(reached / wanted - 1.0) < 0.01 or (scale == limits[1] and reached < wanted):
            break
        if scale == limits[0] and reached > wanted:
            break
        least, most = (least, scale) if reached > wanted else (scale, most)
    return full, reached


def draw_truth(spec: Spec) -> dict:
    """Draw everything that a case conceals: constants within their sigmas, effects, and faint other effects.

    Faint effects have ratios of 0.05 to 0.3 each: no real vehicle is free of them, none can be named.
    """
    rng = np.random.default_rng([spec.seed, 11])
    nominal = VEHICLES[spec.region]
    shift = {k: float(np.clip(rng.standard_normal(), -2.0, 2.0)) * SIGMA[k] for k in CALIBRATED}
    true = replace(nominal, **{k: getattr(nominal, k) + d for k, d in shift.items()})
    effects: dict[str, float] = {}
    strengths: dict[str, float | None] = {}
    for id, wanted in spec.effects:
        drawn, reached = draw_effect(id, wanted, spec.region, rng, (SMALLEST, LARGEST))
        effects |= drawn
        strengths[id] = reached if math.isfinite(reached) else None
    unique = _unique(spec.region, effects) if len(strengths) > 1 else strengths
    faint: dict[str, float] = {}
    named = {id for id, _ in spec.effects}
    for id in rng.choice(
        [k for k in PUBLISHED if k not in named and k not in UNSEEN.get(spec.region, ())], 8, replace=False
    ):
        drawn, _ = draw_effect(str(id), float(rng.uniform(0.05, 0.3)), spec.region, rng)
        faint |= drawn
    # Without a product the whole flow is a current that nobody gave; half of the cases of that effect are so.
    product = named != {"navigation.mean_current"} or bool(rng.random() < 0.5)
    return {
        "name": spec.name, "kind": spec.kind, "region": REGIONS[spec.region].name, "seed": spec.seed,
        "effects": effects, "strengths": strengths, "unique": unique, "faint": faint, "product": product,
        "constants": {k: getattr(true, k) for k in CALIBRATED},
    }  # fmt: skip


def _unique(region: int, effects: Mapping[str, float]) -> dict[str, float]:
    """Signal-to-noise ratio of each of several effects that the others cannot stand in for."""
    world = world_of(region)
    each = {
        id: signature(world, {f"{id}.{name}": value for name, value in parameters.items()})
        for id, parameters in grouped(effects).items()
    }
    out = {}
    for id, vector in each.items():
        others = np.stack([v for other, v in each.items() if other != id], axis=1)
        fitted = others @ np.linalg.lstsq(others, vector, rcond=None)[0]
        out[id] = float(np.linalg.norm(vector - fitted))
    return out


def grouped(flat: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Parameters by effect id and name."""
    out: dict[str, dict[str, float]] = {}
    for key, value in flat.items():
        id, name = key.rsplit(".", 1)
        out.setdefault(id, {})[name] = value
    return out


def write_case(folder: Path, spec: Spec, truth: Mapping) -> None:
    """Fly a case and write what a pilot would have: recording, vehicle, mission, bathymetry and currents."""
    folder.mkdir(parents=True, exist_ok=True)
    region = spec.region
    rng = np.random.default_rng([spec.seed, 23])
    place = REGIONS[region]
    if not truth["product"]:  # the flow that nobody gave is the concealed one, and half the eddies
        place = replace(place, mean_flow=(0.0, 0.0), tide=(0.0, 0.0), eddies=0.5 * place.eddies)
    ocean = Ocean(place, rng, DURATION)
    true = replace(VEHICLES[region], **truth["constants"])
    plan = plan_of(region)
    effects = {**truth["faint"], **truth["effects"]}
    flown = fly(ocean, true, plan, effects, rng)
    columns = sensors.record(flown, ocean, true, effects, rng)
    sensors.write_recording(folder / "recording.nc", columns, ocean.region.start)
    sensors.write_vehicle(folder / "vehicle.toml", VEHICLES[region], SIGMA)
    sensors.write_mission(folder / "mission.toml", plan, ocean)
    sensors.write_bathymetry(folder / "bathymetry.nc", ocean, rng)
    if truth["product"]:
        sensors.write_currents(folder / "currents.nc", ocean, rng)


def dump(truth: Mapping) -> str:
    """The truth as canonical JSON: what is sealed by its hash."""
    return json.dumps(truth, sort_keys=True, separators=(",", ":"))
