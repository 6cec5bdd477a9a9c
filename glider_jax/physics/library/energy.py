"""What the pump, the brake and the battery do beyond the base model.

Imports :mod:`glider_jax.physics.term` only. Stroke energies are for a full stroke; the model scales them with the
volume moved. Power and energy are positive when drawn from the battery.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from glider_jax.physics.term import (
    NEVER_NEGATIVE,
    AbstractTerm,
    Channel,
    Normal,
    Sample,
    Scalar,
    TermInfo,
    parameter,
    positive_part,
    reference_temperature,
)

_LEAST_FACTOR = 0.1


class PumpPressureNonlinearity(AbstractTerm):
    """The pump loses efficiency with depth, so its energy bends upwards."""

    curvature: Scalar = parameter(
        Normal(0.0, 0.02), unit="J m-2", text="energy of a full stroke per squared depth",
        source="10 to 20 % more at depth: judgement",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.pump_pressure_nonlinearity",
        title="Pump efficiency under pressure",
        channels=(Channel.PUMP_ENERGY,),
        equation=r"\Delta E = k\,z^2",
        reads=("inflection_depth",),
        valid="the depth range of the vehicle",
        reference="pump efficiency that falls with pressure; size: judgement",
        plain="Pumping at depth costs more than a straight line says.",
        confusable_with=("energy.pump_slope",),
        decided_by="inflections at three depths or more, far apart",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.curvature * sample.inflection_depth**2


class PumpFixedCost(AbstractTerm):
    """Every dive-to-climb stroke costs a fixed amount more."""

    energy: Scalar = parameter(
        Normal(0.0, 40.0),
        unit="J",
        text="energy beyond the base line",
        source="46 J uncertainty on comet 2019",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.pump_fixed_cost",
        title="Fixed cost of a stroke",
        channels=(Channel.PUMP_ENERGY,),
        equation=r"\Delta E = E_1",
        reads=(),
        valid="full strokes",
        reference="comet 2019, line fitted to 58 strokes",
        plain="Each stroke at depth costs a little more, however deep.",
        confusable_with=("energy.pump_slope", "flight.oil_gain", "energy.pitch_motor"),
        decided_by="inflections at three depths or more",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.energy


class PumpSlope(AbstractTerm):
    """The pump's energy grows faster with depth than calibrated."""

    slope: Scalar = parameter(
        Normal(0.0, 1.25), unit="J m-1", text="energy per metre beyond the base line",
        source="1.25 J uncertainty on comet 2019",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.pump_slope",
        title="Pump energy against depth",
        channels=(Channel.PUMP_ENERGY,),
        equation=r"\Delta E = k\,z",
        reads=("inflection_depth",),
        valid="the depth range of the vehicle",
        reference="comet 2019, line fitted to 58 strokes",
        plain="The pump works less efficiently against pressure than calibrated.",
        confusable_with=(
            "energy.pump_pressure_nonlinearity",
            "energy.pump_fixed_cost",
            "energy.brake_pressure",
        ),
        decided_by="inflections at three depths or more, far apart",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.slope * sample.inflection_depth


class PumpWear(AbstractTerm):
    """The pump needs more energy with every stroke it has made."""

    rate: Scalar = parameter(
        Normal(0.0, 1e-4), unit="1", text="logarithm of the energy factor gained per inflection",
        support=NEVER_NEGATIVE,
        source="judgement: 10 % in a thousand",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.pump_wear",
        title="Wear of the pump",
        channels=(Channel.LOG_PUMP_ENERGY,),
        equation=r"\ln f = k\,n",
        reads=("inflections",),
        valid="thousands of inflections",
        reference="pump stress counter of the firmware; size: judgement",
        plain="The pump draws a little more with every stroke: wear, or seals that tighten.",
        confusable_with=("energy.cold_friction",),
        decided_by="strokes at equal depth and temperature, early and late",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return self.rate * sample.inflections


class ColdFriction(AbstractTerm):
    """Cold oil makes the pump work harder."""

    slope: Scalar = parameter(
        Normal(0.0, 0.02), unit="K-1", text="share of pump energy gained per kelvin below 15 degC",
        support=NEVER_NEGATIVE,
        source="viscosity, 1 to 3 % per kelvin", shown="%/K", shown_per_si=1e2,
    )  # fmt: skip
    reference_temperature: Scalar = reference_temperature()
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.cold_friction",
        title="Cold friction",
        channels=(Channel.LOG_PUMP_ENERGY,),
        equation=r"\ln f = \ln[1+k\max(T_0-T,0)]",
        reads=("temperature",),
        valid="271 to 308 K; the factor stays above 0.1",
        reference="viscosity of oil; form: judgement",
        plain="In cold water the pump draws more.",
        confusable_with=("energy.pump_slope", "energy.pump_pressure_nonlinearity", "energy.pump_wear"),
        decided_by="strokes at equal depth in water of different temperature",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        factor = 1.0 + self.slope * positive_part(self.reference_temperature - sample.temperature)
        return jnp.log(jnp.maximum(factor, _LEAST_FACTOR))


class RetractPressure(AbstractTerm):
    """Water pushes the piston in, so drawing it in at depth costs less."""

    slope: Scalar = parameter(
        Normal(0.0, 10.0), unit="J m-1", text="energy of a full stroke gained per metre of depth",
        source="-42 J/dbar in 2019, none in 2016, over 2 dbar: judgement",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.retract_pressure",
        title="Climb-to-dive stroke against depth",
        channels=(Channel.RETRACT_ENERGY,),
        equation=r"\Delta E = k\,z",
        reads=("inflection_depth",),
        valid="upper turns above 30 m",
        reference="comet, strokes near the surface",
        plain="Drawing oil in costs less the deeper it happens.",
        confusable_with=("energy.brake_pressure",),
        decided_by="upper turns at several depths",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.slope * sample.inflection_depth


class BrakePressure(AbstractTerm):
    """The brake works harder against pressure."""

    slope: Scalar = parameter(
        Normal(0.0, 0.4),
        unit="J m-1",
        text="brake energy gained per metre of depth",
        source="judgement",
        support=NEVER_NEGATIVE,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.brake_pressure",
        title="Brake against depth",
        channels=(Channel.BRAKE_ENERGY,),
        equation=r"\Delta E = k\,z",
        reads=("inflection_depth",),
        valid="the depth range of the vehicle",
        reference="judgement",
        plain="Releasing the pump's brake costs more under pressure.",
        confusable_with=("energy.pump_slope", "energy.retract_pressure"),
        decided_by="brake events recorded apart from the pump's",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.slope * sample.inflection_depth


class BrakeWear(AbstractTerm):
    """The brake needs more energy with every inflection."""

    rate: Scalar = parameter(
        Normal(0.0, 0.02),
        unit="J",
        text="brake energy gained per inflection",
        source="judgement",
        support=NEVER_NEGATIVE,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.brake_wear",
        title="Wear of the brake",
        channels=(Channel.BRAKE_ENERGY,),
        equation=r"\Delta E = k\,n",
        reads=("inflections",),
        valid="thousands of inflections",
        reference="judgement",
        plain="The brake draws more the more often it was used.",
        confusable_with=("energy.pump_wear",),
        decided_by="brake events recorded apart from the pump's",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.rate * sample.inflections


class PitchMotor(AbstractTerm):
    """Moving the battery for pitch costs energy at every inflection."""

    energy: Scalar = parameter(
        Normal(0.0, 20.0), unit="J", text="energy of an inflection beside pump and brake",
        support=NEVER_NEGATIVE,
        source="judgement: tens of joules a move",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.pitch_motor",
        title="Pitch motor",
        channels=(Channel.BRAKE_ENERGY,),
        equation=r"\Delta E = E_p",
        reads=(),
        valid="any depth",
        reference="judgement",
        plain="Every turn costs something more, at depth and at the top alike.",
        confusable_with=("energy.pump_fixed_cost",),
        decided_by="motor events in a fast current record",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.energy


class InternalResistance(AbstractTerm):
    """The battery's voltage sags under load."""

    resistance: Scalar = parameter(
        Normal(0.0, 0.3), unit="ohm", text="resistance beyond the base model",
        source="apparent 0.22 and 0.50 ohm on comet",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.internal_resistance",
        title="Internal resistance",
        channels=(Channel.VOLTAGE,),
        equation=r"\Delta V = -R\,I",
        reads=("current",),
        valid="currents below 5 A",
        reference="sag of the measured battery voltage",
        plain="The battery voltage drops whenever the pump runs.",
        confusable_with=("energy.cold_resistance", "energy.ageing_resistance"),
        decided_by="pulses at several temperatures and states of charge",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Voltage, V."""
        return -self.resistance * sample.current


class ColdResistance(AbstractTerm):
    """Cold cells have more resistance."""

    slope: Scalar = parameter(
        Normal(0.0, 0.02),
        support=NEVER_NEGATIVE,
        unit="ohm K-1",
        text="resistance gained per kelvin below 15 degC",
        source="judgement",
    )
    reference_temperature: Scalar = reference_temperature()
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.cold_resistance",
        title="Resistance of cold cells",
        channels=(Channel.VOLTAGE,),
        equation=r"\Delta V = -k\,(T_0-T)\,I",
        reads=("current", "battery_temperature"),
        valid="271 to 308 K",
        reference="judgement",
        plain="In cold water the battery voltage sags more under load.",
        confusable_with=("energy.internal_resistance",),
        decided_by="pulses at several temperatures",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Voltage, V."""
        return -self.slope * (self.reference_temperature - sample.battery_temperature) * sample.current


class AgeingResistance(AbstractTerm):
    """An emptier battery has more resistance."""

    resistance: Scalar = parameter(
        Normal(0.0, 0.3),
        unit="ohm",
        text="resistance gained from full to empty",
        source="judgement",
        support=NEVER_NEGATIVE,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.ageing_resistance",
        title="Resistance of an empty battery",
        channels=(Channel.VOLTAGE,),
        equation=r"\Delta V = -R\,(1-s)\,I",
        reads=("current", "state_of_charge"),
        valid="currents below 5 A",
        reference="judgement",
        plain="The emptier the battery, the more its voltage sags.",
        confusable_with=("energy.internal_resistance",),
        decided_by="pulses early and late",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Voltage, V."""
        return -self.resistance * (1.0 - sample.state_of_charge) * sample.current


class VoltageOffset(AbstractTerm):
    """The open-circuit voltage is not on the pack's curve."""

    offset: Scalar = parameter(
        Normal(0.0, 0.2), unit="V", text="voltage beyond the curve", source="judgement: cells and wiring"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.voltage_offset",
        title="Open-circuit voltage",
        channels=(Channel.VOLTAGE,),
        equation=r"\Delta V = V_1",
        reads=(),
        valid="any",
        reference="judgement",
        plain="The battery's voltage lies above or below what its charge tells.",
        confusable_with=("energy.capacity_loss",),
        decided_by="a full discharge",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Voltage, V."""
        return self.offset


class CapacityLoss(AbstractTerm):
    """The pack holds less than its label says."""

    share: Scalar = parameter(
        Normal(0.0, 0.1), unit="1", text="logarithm of nominal over true capacity",
        support=(-0.3, 2.0),
        source="3 % a year in storage, 10 to 30 % in all", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.capacity_loss",
        title="Capacity",
        channels=(Channel.LOG_CAPACITY,),
        equation=r"\ln f = -k",
        reads=(),
        valid="below 0.5",
        reference="derating of primary packs in glider operations",
        plain="The battery holds less charge than it should.",
        confusable_with=("energy.cold_capacity", "energy.voltage_offset", "sensor.coulomb_gain"),
        decided_by="the voltage late in the mission",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return -self.share


class ColdCapacity(AbstractTerm):
    """Cold cells give less charge."""

    slope: Scalar = parameter(
        Normal(0.0, 0.007), unit="K-1", text="share of capacity lost per kelvin below 15 degC",
        support=NEVER_NEGATIVE,
        source="about 10 % temperature margin", shown="%/K", shown_per_si=1e2,
    )  # fmt: skip
    reference_temperature: Scalar = reference_temperature()
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.cold_capacity",
        title="Capacity of cold cells",
        channels=(Channel.LOG_CAPACITY,),
        equation=r"\ln f = -k\,(T_0-T)",
        reads=("battery_temperature",),
        valid="271 to 308 K",
        reference="temperature margin in glider operations",
        plain="In cold water the battery gives less.",
        confusable_with=("energy.capacity_loss",),
        decided_by="the voltage late in the mission, in other water",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return -self.slope * (self.reference_temperature - sample.battery_temperature)


TERMS: tuple[type[AbstractTerm], ...] = (
    PumpPressureNonlinearity,
    PumpFixedCost,
    PumpSlope,
    PumpWear,
    ColdFriction,
    RetractPressure,
    BrakePressure,
    BrakeWear,
    PitchMotor,
    InternalResistance,
    ColdResistance,
    AgeingResistance,
    VoltageOffset,
    CapacityLoss,
    ColdCapacity,
)
