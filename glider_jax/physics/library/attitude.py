"""Attitude, inertia and thrust beyond the base model.

Imports :mod:`glider_jax.physics.term` only. ``PITCH`` is added to the measured pitch to get the true one, nose up: a
constant angle makes climbs steeper and dives flatter, a scale acts alike on both.
"""

from __future__ import annotations

from typing import ClassVar

from glider_jax.physics.term import (
    DEGREE,
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

_MERCKELBACH = "Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1"


class PitchOffset(AbstractTerm):
    """The pitch sensor is mounted at an angle."""

    offset: Scalar = parameter(
        Normal(0.0, 0.02),
        support=(-0.3, 0.3),
        unit="rad",
        text="true minus measured pitch",
        source="0.2 degrees on comet 2016; 1 degree typical: judgement",
        shown="deg",
        shown_per_si=DEGREE,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.pitch_offset",
        title="Pitch zero",
        channels=(Channel.PITCH,),
        equation=r"\Delta\theta = o",
        reads=(),
        valid="below 0.1 rad",
        reference=_MERCKELBACH,
        plain="The glider is nose-up or nose-down of what it measures: one way is steeper than the other.",
        confusable_with=("flight.mean_upwelling", "flight.ballast_offset"),
        decided_by="a measured speed, or dives at several pitch angles",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.offset


class PitchGain(AbstractTerm):
    """The pitch sensor reads too much or too little, in proportion."""

    gain: Scalar = parameter(
        Normal(0.0, 0.07),
        support=(-0.5, 1.0),
        unit="1",
        text="true over measured pitch, minus one",
        source="-0.14 on comet 2016, -0.17 on another deployment",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.pitch_gain",
        title="Pitch scale",
        channels=(Channel.PITCH,),
        equation=r"\Delta\theta = g\,\theta",
        reads=("pitch",),
        valid="below 0.7 rad",
        reference=_MERCKELBACH,
        plain="All glides are flatter or steeper than the glider measures.",
        confusable_with=("flight.drag_bias", "flight.oil_gain", "sensor.pressure_gain"),
        decided_by="a measured speed through the water, or dives at two pitch angles",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.gain * sample.pitch


class PitchDrift(AbstractTerm):
    """The pitch scale drifts."""

    rate: Scalar = parameter(
        Normal(0.0, 0.005 / 86400.0),
        unit="s-1",
        text="true over measured pitch gained in time",
        source="judgement",
        shown="1/day",
        shown_per_si=PER_DAY,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.pitch_drift",
        title="Drift of the pitch scale",
        channels=(Channel.PITCH,),
        equation=r"\Delta\theta = k\,t\,\theta",
        reads=("pitch", "elapsed"),
        valid="weeks",
        reference="Rudnick et al. 2018, doi:10.1175/JTECH-D-17-0200.1: drag or pitch drift; size: judgement",
        plain="The measured pitch drifts away from the true one, so glides slow down or speed up over days.",
        confusable_with=("flight.drag_growth",),
        decided_by="a measured speed, or the battery position against the pitch",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.rate * sample.elapsed * sample.pitch


class PitchPressure(AbstractTerm):
    """The pitch sensor's zero moves with pressure."""

    slope: Scalar = parameter(
        Normal(0.0, 1e-9),
        unit="rad Pa-1",
        text="true minus measured pitch per pascal",
        source="judgement: 0.6 degrees at 1000 dbar",
        shown="deg/1000 dbar",
        shown_per_si=DEGREE * 1e7,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.pitch_pressure",
        title="Pitch under pressure",
        channels=(Channel.PITCH,),
        equation=r"\Delta\theta = k\,P",
        reads=("sea_pressure",),
        valid="the depth range of the vehicle",
        reference="pressure coefficient of the pitch statics of glider trim models; size: judgement",
        plain="The hull bends a little under pressure and the measured pitch with it.",
        confusable_with=("flight.hull_compressibility",),
        decided_by="deep and shallow dives with a measured speed",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.slope * sample.sea_pressure


class AddedMass(AbstractTerm):
    """The glider takes longer, or less long, to gather speed."""

    time: Scalar = parameter(
        Normal(0.0, 5.0),
        unit="s",
        text="response time beyond the base model's",
        source="added masses 0.2 and 0.92 to 0.98 of the mass; 12 s in all",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.added_mass",
        title="Inertia",
        channels=(Channel.RESPONSE_TIME,),
        equation=r"\Delta\tau = \tau_1",
        reads=(),
        valid="after inflections",
        reference=_MERCKELBACH,
        plain="After a turn the glider needs longer than thought to gather speed.",
        confusable_with=("navigation.coasting",),
        decided_by="pressure at one second",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Time, s."""
        return self.time


class Thruster(AbstractTerm):
    """A thruster pushes along the path."""

    coefficient: Scalar = parameter(
        Normal(0.0, 0.3),
        unit="N W-2/3",
        text="thrust per power to two thirds",
        source="judgement: actuator disc of 0.15 m",
    )
    idle: Scalar = constant(
        0.05, unit="W", text="power below which the law is rounded off", source="numerical, far below 1 W"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.thruster",
        title="Thruster",
        channels=(Channel.THRUST,),
        equation=r"T = k[(P^2+P_i^2)^{1/3}-P_i^{2/3}]",
        reads=("thruster_power",),
        valid="1 to 9 W",
        reference="momentum theory of a propeller",
        plain="A thruster pushed the glider along.",
        decided_by="the thruster's own record",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        squared = self.idle * self.idle
        power = (sample.thruster_power * sample.thruster_power + squared) ** (1.0 / 3.0)
        return self.coefficient * (power - squared ** (1.0 / 3.0))


TERMS: tuple[type[AbstractTerm], ...] = (
    PitchOffset,
    PitchGain,
    PitchDrift,
    PitchPressure,
    AddedMass,
    Thruster,
)
