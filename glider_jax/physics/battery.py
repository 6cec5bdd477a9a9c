"""The battery pack: what charge may be counted on, and the voltage and current under a load.

Imports JAX, Equinox and the configuration records. State of charge is the share left of the usable charge; power and
current drawn from the pack are positive.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from glider_jax.config import Battery, Quantity
from glider_jax.physics.perturb import log_normal, standard_normal
from glider_jax.physics.term import Scalar, positive_part, safe_sqrt


class Pack(eqx.Module):
    """A battery pack.

    Attributes
    ----------
    capacity, energy : rated charge C and energy J.
    usable_fraction : share of them that a plan may count on.
    internal_resistance : ohm. temperature_derating : share of capacity lost per kelvin below
        ``reference_temperature`` K.
    charge_points, voltage_points : (points,) state of charge, ascending, and open-circuit voltage V.
    undervolts : V at which a mission must end. reserve_fraction : share of the usable charge kept back.
    """

    capacity: Array
    energy: Array
    usable_fraction: Array
    internal_resistance: Array
    temperature_derating: Array
    reference_temperature: Array
    charge_points: Array
    voltage_points: Array
    undervolts: Array
    reserve_fraction: Array

    def usable_share(self, temperature: Scalar) -> Scalar:
        """Share of the rated capacity that can be drawn at a temperature in K; never negative."""
        colder = positive_part(self.reference_temperature - temperature)
        return positive_part(self.usable_fraction * (1.0 - self.temperature_derating * colder))

    def usable_charge(self, temperature: Scalar) -> Scalar:
        """Charge that can be drawn at a temperature in K, C."""
        return self.capacity * self.usable_share(temperature)

    def usable_energy(self, temperature: Scalar) -> Scalar:
        """Energy that can be drawn at a temperature in K, J."""
        return self.energy * self.usable_share(temperature)

    def open_circuit_voltage(self, state_of_charge: Scalar) -> Scalar:
        """Voltage without load, V, linear between the points of the curve and constant beyond them."""
        return jnp.interp(state_of_charge, self.charge_points, self.voltage_points)

    def terminal(
        self, power: Scalar, state_of_charge: Scalar, extra_voltage: Scalar | float = 0.0
    ) -> tuple[Scalar, Scalar]:
        """Terminal voltage V and current A while a constant power is drawn.

        Parameters
        ----------
        power : W. state_of_charge : 0 to 1.
        extra_voltage : V added to the open-circuit voltage.

        Notes
        -----
        ``V = (V0 + sqrt(V0**2 - 4 R P)) / 2`` and ``I = P / V``; a load beyond what the pack can deliver gets the
        voltage of its largest power, ``V0 / 2``.
        """
        open_circuit = self.open_circuit_voltage(state_of_charge) + extra_voltage
        root = safe_sqrt(open_circuit * open_circuit - 4.0 * self.internal_resistance * power)
        voltage = 0.5 * (open_circuit + root)
        return voltage, power / voltage


def build_pack(battery: Battery, *, dtype: Any) -> Pack:
    """Make the pack of a vehicle's battery record, every number in one dtype."""
    charge, voltage = zip(*battery.voltage_curve, strict=True)

    def leaf(value: Any) -> Array:
        return jnp.asarray(value, dtype)

    return Pack(
        capacity=leaf(battery.capacity.value),
        energy=leaf(battery.energy.value),
        usable_fraction=leaf(battery.usable_fraction.value),
        internal_resistance=leaf(battery.internal_resistance.value),
        temperature_derating=leaf(battery.temperature_derating.value),
        reference_temperature=leaf(288.15),
        charge_points=leaf(charge),
        voltage_points=leaf(voltage),
        undervolts=leaf(battery.undervolts),
        reserve_fraction=leaf(battery.reserve_fraction),
    )


def draw_usable_charge(
    battery: Battery, temperature: float, normal: Callable[[str], np.ndarray], spread: float = 1.0
) -> np.ndarray:
    """Charge that each member may draw, C, on the host, from the record's sigmas.

    All draws are log-normal with the stated mean and sigma; the usable fraction is kept at or below 1.

    Parameters
    ----------
    temperature : K, of the pack.
    normal : gives standard normal numbers, one per member, of a name.  spread : factor on all sigmas.
    """

    def value(quantity: Quantity, name: str) -> np.ndarray:
        mean = np.asarray(quantity.value, float)
        return log_normal(mean, spread * quantity.sigma, normal(f"battery.{name}"), np)

    usable = np.minimum(value(battery.usable_fraction, "usable_fraction"), 1.0)
    derating = value(battery.temperature_derating, "temperature_derating")
    cold = 1.0 - derating * max(288.15 - temperature, 0.0)
    return value(battery.capacity, "capacity") * np.maximum(usable * cold, 0.0)


def draw_pack(pack: Pack, battery: Battery, key: Array, spread: float = 1.0) -> Pack:
    """Draw one member's pack from the record's sigmas; vmap over keys for an ensemble.

    Capacity and energy share one factor, the cell's; all draws are log-normal with the stated mean and sigma, and
    the usable fraction is kept at or below 1.
    """
    dtype = pack.capacity.dtype

    def value(mean: Array, sigma: float, name: str) -> Array:
        return log_normal(mean, spread * sigma, standard_normal(key, name, dtype)) if sigma > 0.0 else mean

    relative = battery.capacity.sigma / battery.capacity.value if battery.capacity.value > 0.0 else 0.0
    size = value(jnp.ones((), dtype), relative, "battery.capacity")
    usable = value(pack.usable_fraction, battery.usable_fraction.sigma, "battery.usable_fraction")
    resistance = battery.internal_resistance.sigma
    derating = battery.temperature_derating.sigma
    return eqx.tree_at(
        lambda p: (p.capacity, p.energy, p.usable_fraction, p.internal_resistance, p.temperature_derating),
        pack,
        (
            pack.capacity * size,
            pack.energy * size,
            jnp.minimum(usable, 1.0),
            value(pack.internal_resistance, resistance, "battery.internal_resistance"),
            value(pack.temperature_derating, derating, "battery.temperature_derating"),
        ),
    )
