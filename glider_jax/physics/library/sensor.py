"""What the glider's own instruments get wrong: current, charge, pressure, salinity.

Imports :mod:`glider_jax.physics.term` only. Each says what is *recorded* against what is true: recorded current =
true x exp(``CURRENT_GAIN``) + ``CURRENT_OFFSET``; recorded depth = true depth + ``PRESSURE_OFFSET``.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from glider_jax.physics.term import (
    PER_DAY,
    AbstractTerm,
    Channel,
    Normal,
    Sample,
    Scalar,
    TermInfo,
    constant,
    parameter,
)

_LEAST_FACTOR = 0.1


class CurrentOffset(AbstractTerm):
    """The current sensor's zero is off."""

    offset: Scalar = parameter(
        Normal(0.0, 0.01), unit="A", text="recorded minus true current", source="judgement",
        shown="mA", shown_per_si=1e3,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.current_offset",
        title="Zero of the current sensor",
        channels=(Channel.CURRENT_OFFSET,),
        equation=r"I' = I + o",
        reads=(),
        valid="any",
        reference="bench check of the sensor; size: judgement",
        plain="The recorded current is off by the same amount all the time.",
        confusable_with=("energy.hotel_bias",),
        decided_by="a current measured independently, and the voltage as the battery empties",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Current, A."""
        return self.offset


class CurrentGain(AbstractTerm):
    """The current sensor reads too much or too little, in proportion."""

    gain: Scalar = parameter(
        Normal(0.0, 0.03), unit="1", text="recorded over true current, minus one", source="1 to 3 %",
        support=(-0.5, 1.0),
        shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.current_gain",
        title="Scale of the current sensor",
        channels=(Channel.CURRENT_GAIN,),
        equation=r"I' = (1+g)\,I",
        reads=(),
        valid="gain above -0.9",
        reference="bench check of the sensor",
        plain="All recorded currents are too large or too small by the same share.",
        confusable_with=("sensor.coulomb_gain", "energy.hotel_bias"),
        decided_by="a current measured independently",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return jnp.log(jnp.maximum(1.0 + self.gain, _LEAST_FACTOR))


class CoulombGain(AbstractTerm):
    """The charge counter disagrees with the integral of the current."""

    gain: Scalar = parameter(
        Normal(0.0, 0.02), unit="1", text="recorded charge over the integral of the recorded current, minus one",
        support=(-0.5, 1.0),
        source="1 to 3 %; 0.4 % on comet", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.coulomb_gain",
        title="Scale of the charge counter",
        channels=(Channel.CHARGE_GAIN,),
        equation=r"Q' = (1+g)\int I'\,dt",
        reads=(),
        valid="gain above -0.9",
        reference="f_coulomb_calibration_factor of the firmware",
        plain="The charge counter runs fast or slow.",
        confusable_with=("sensor.current_gain", "energy.hotel_bias", "energy.capacity_loss"),
        decided_by="the recorded current integrated over time",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return jnp.log(jnp.maximum(1.0 + self.gain, _LEAST_FACTOR))


class PressureOffset(AbstractTerm):
    """The pressure gauge's zero is off."""

    offset: Scalar = parameter(
        Normal(0.0, 0.5), unit="m", text="recorded minus true depth", source="0.5 dbar"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.pressure_offset",
        title="Zero of the pressure gauge",
        channels=(Channel.PRESSURE_OFFSET,),
        equation=r"z' = z + o",
        reads=(),
        valid="any",
        reference="pressure at the surface; size: judgement",
        plain="The recorded depth is off by the same amount all the time.",
        confusable_with=("seafloor.bathymetry_bias",),
        decided_by="the pressure while surfaced, or a second gauge",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return self.offset


class PressureGain(AbstractTerm):
    """The pressure gauge reads too much or too little, in proportion."""

    gain: Scalar = parameter(
        Normal(0.0, 0.003), unit="1", text="recorded over true depth, minus one", source="0.1 to 0.3 % of full scale",
        support=(-0.2, 0.2),
        shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.pressure_gain",
        title="Scale of the pressure gauge",
        channels=(Channel.PRESSURE_OFFSET,),
        equation=r"z' = (1+g)\,z",
        reads=("depth",),
        valid="any",
        reference="accuracy of the gauge",
        plain="Recorded depths and vertical speeds are too large or too small by the same share.",
        confusable_with=("flight.pitch_gain", "flight.drag_bias", "flight.oil_gain"),
        decided_by="two independent gauges; more than 1 % is not plausible",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return self.gain * sample.depth


class SalinityDrift(AbstractTerm):
    """The conductivity cell fouls, so the density drifts."""

    rate: Scalar = parameter(
        Normal(0.0, 0.01 / 86400.0), unit="s-1", text="true minus measured practical salinity gained in time",
        source="judgement: 0.1 of a fouled cell in days", shown="1/day", shown_per_si=PER_DAY,
    )  # fmt: skip
    contraction: Scalar = constant(
        7.6e-4,
        unit="1",
        text="share of density gained per unit of salinity",
        source="TEOS-10, cool shelf water",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.salinity_drift",
        title="Drift of the salinity",
        channels=(Channel.NET_BUOYANCY,),
        equation=r"F = g\rho V\beta\,k\,t",
        reads=("gravity", "density", "hull_volume", "elapsed"),
        valid="weeks",
        reference="haline contraction of TEOS-10; size: judgement",
        plain="The CTD drifts, so the model sees ever lighter water.",
        confusable_with=("flight.mass_growth", "flight.water_ingress", "flight.oil_loss"),
        decided_by="temperature and salinity against the deep water mass",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        denser = self.contraction * self.rate * sample.elapsed
        return sample.gravity * sample.density * sample.hull_volume * denser


TERMS: tuple[type[AbstractTerm], ...] = (
    CurrentOffset,
    CurrentGain,
    CoulombGain,
    PressureOffset,
    PressureGain,
    SalinityDrift,
)
