"""Random samples within plausible ranges, units as powers of base units, and a plain vehicle."""

from __future__ import annotations

import re
from collections import Counter
from fractions import Fraction

import numpy as np

from glider_jax.config import Battery, CovarianceBlock, Quantity, Vehicle
from glider_jax.physics.term import SAMPLE_UNITS, Sample

RANGES = {
    "time": (0.0, 1.3e6),
    "elapsed": (1e4, 1.3e6),
    "depth": (0.0, 200.0),
    "depth_rate": (-0.3, 0.3),
    "sea_pressure": (0.0, 2e6),
    "temperature": (275.0, 300.0),
    "density": (1015.0, 1030.0),
    "reference_density": (1020.0, 1027.0),
    "pitch": (-0.6, 0.6),
    "roll": (-0.2, 0.2),
    "turn_rate": (-0.02, 0.02),
    "direction": (-1.0, 0.0, 1.0),
    "buoyancy_volume": (-250e-6, 250e-6),
    "speed_through_water": (0.0, 0.6),
    "angle_of_attack": (-0.1, 0.1),
    "glide_angle": (-0.7, 0.7),
    "heading": (0.0, 6.28),
    "surface_current_east": (-0.5, 0.5),
    "surface_current_north": (-0.5, 0.5),
    "wind_east": (-15.0, 15.0),
    "wind_north": (-15.0, 15.0),
    "bottom_depth": (30.0, 500.0),
    "height_above_bottom": (0.0, 150.0),
    "east": (-1e5, 1e5),
    "north": (-1e5, 1e5),
    "latitude": (0.3, 1.1),
    "gravity": (9.78, 9.83),
    "stroke_volume": (100e-6, 460e-6),
    "inflection_depth": (1.0, 200.0),
    "voltage": (10.0, 16.0),
    "current": (0.05, 3.0),
    "state_of_charge": (0.1, 0.95),
    "battery_temperature": (275.0, 300.0),
    "surface_duration": (10.0, 1800.0),
    "time_since_surfacing": (0.0, 7200.0),
    "time_since_inflection": (0.0, 300.0),
    "fin_rate": (0.0, 0.02),
    "inflections": (0.0, 3000.0),
    "thruster_power": (0.0, 9.0),
    "mass": (50.0, 75.0),
    "hull_volume": (0.049, 0.073),
    "wing_area": (0.08, 0.12),
    "parasite_drag": (0.1, 0.25),
    "induced_drag": (3.0, 12.0),
    "lift_slope": (4.0, 8.0),
}


def random_fields(seed: int) -> dict[str, float]:
    """One random sample's fields; ``direction`` is one of -1, 0 and +1."""
    rng = np.random.default_rng(seed)
    fields = {}
    for name in Sample._fields:
        bounds = RANGES[name]
        fields[name] = float(rng.choice(bounds) if len(bounds) == 3 else rng.uniform(*bounds))
    return fields


BASE_UNITS = ("m", "kg", "s", "K", "A")
_DERIVED = {
    "1": {},
    "rad": {},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "S": {"kg": -1, "m": -2, "s": 3, "A": 2},
}


def dimensions(unit: str) -> dict[str, Fraction]:
    """Powers of metre, kilogram, second, kelvin and ampere in a unit such as ``kg m-3`` or ``N W-2/3``."""
    powers: Counter = Counter()
    for word in unit.split():
        symbol, power = re.fullmatch(r"([A-Za-z]+|1)(-?\d+(?:/\d+)?)?", word).groups()
        exponent = Fraction(power or 1)
        parts = {symbol: 1} if symbol in BASE_UNITS else _DERIVED[symbol]
        for base, inner in parts.items():
            powers[base] += inner * exponent
    return {base: power for base, power in powers.items() if power}


def rescale(unit: str, factors: dict[str, float]) -> float:
    """The factor by which numbers of a unit grow when its base units shrink by ``factors``."""
    return float(
        np.prod([factors[base] ** float(power) for base, power in dimensions(unit).items()] or [1.0])
    )


assert set(RANGES) == set(SAMPLE_UNITS) == set(Sample._fields)


def quantity(value: float, sigma: float = 0.0, unit: str = "1") -> Quantity:
    """A quantity of a test vehicle."""
    return Quantity(value, sigma, unit, "test")


BATTERY = Battery(
    "test pack", "alkaline", quantity(5e5, 1e4), quantity(7.5e6, 1e5), ((0.0, 11.0), (0.2, 12.0), (1.0, 15.0)),
    quantity(0.9, 0.03), quantity(0.3, 0.05), quantity(0.005, 0.001),
)  # fmt: skip


def vehicle(terms=None, covariances: tuple[CovarianceBlock, ...] = (), devices=(), **changes) -> Vehicle:
    """The 60 kg glider of the published sensitivity table; ``changes`` use ``__`` for the dot of a name."""
    quantities = {
        "flight.mass": quantity(60.0, 0.01),
        "flight.volume": quantity(60.0 / 1025.0),
        "flight.wing_area": quantity(0.1),
        "flight.pump_volume": quantity(230e-6),
        "flight.pump_rate": quantity(20e-6, 2e-6),
        "flight.parasite_drag": quantity(0.15, 0.004),
        "flight.induced_drag": quantity(10.5, 1.0),
        "flight.lift_slope": quantity(7.53, 0.5),
        "energy.hotel": quantity(1.1, 0.015),
        "energy.pump_dive_to_climb.intercept": quantity(110.0, 5.0),
        "energy.pump_dive_to_climb.slope": quantity(6.0, 0.15),
        "energy.pump_climb_to_dive": quantity(85.0, 4.0),
        "energy.brake": quantity(45.0, 2.0),
        "energy.surface": quantity(2.5, 0.05),
        "perturbation.heading": quantity(0.05),
    }
    quantities.update({name.replace("__", "."): value for name, value in changes.items()})
    return Vehicle("test", quantities, tuple(devices), BATTERY, covariances, terms or {})
