"""The base model's own terms: what every forecast flies with, its numbers taken from the vehicle file.

Imports :mod:`glider_jax.physics.term` only. They are terms like all others, with gate 1; the catalogue's terms are
added to them. The coefficients follow the Slocum flight model of Merckelbach et al. (2010, 2019).
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from glider_jax.physics.term import (
    AbstractTerm,
    Channel,
    Normal,
    Sample,
    Scalar,
    TermInfo,
    constant,
    parameter,
)

MERCKELBACH_2010 = "Merckelbach, Smeed and Griffiths 2010, doi:10.1175/2009JTECHO710.1"
MERCKELBACH_2019 = "Merckelbach, Berger, Krahmann, Dengler and Carpenter 2019, doi:10.1175/JTECH-D-18-0168.1"


class Body(eqx.Module):
    """Constants of the vehicle that are no term by themselves."""

    wing_area: Scalar = parameter(
        Normal(0.1, 0.0, lower=0.0),
        unit="m2",
        text="reference area of every coefficient",
        source=MERCKELBACH_2010,
        quantity="flight.wing_area",
    )
    pump_volume: Scalar = parameter(
        Normal(230e-6, 3e-6, lower=0.0),
        unit="m3",
        text="commanded volume, plus on a climb and minus on a dive",
        source="shallow Slocum; sd judgement",
        shown="cm3",
        shown_per_si=1e6,
        quantity="flight.pump_volume",
    )
    pump_rate: Scalar = parameter(
        Normal(20.5e-6, 2e-6, lower=0.0),
        unit="m3 s-1",
        text="volume moved per second by the buoyancy pump",
        source="extended shallow pump of the glidersim settings; sd judgement",
        shown="cm3/s",
        shown_per_si=1e6,
        quantity="flight.pump_rate",
    )
    full_stroke: Scalar = parameter(
        Normal(460e-6, 0.0, lower=0.0),
        unit="m3",
        text="volume moved in the stroke for which the pump energies are stated",
        source="twice the shallow pump's setting",
        shown="cm3",
        shown_per_si=1e6,
        quantity="energy.pump_dive_to_climb.reference_volume",
    )
    stall_angle: Scalar = constant(
        0.17,
        unit="rad",
        text="largest angle of attack of an attached flow",
        source="judgement, 8 to 10 degrees",
    )


class Hull(AbstractTerm):
    """Buoyancy of hull and pumped volume minus weight."""

    mass: Scalar = parameter(
        Normal(60.0, 0.05, lower=0.0),
        unit="kg",
        text="mass of the glider",
        source="ballast sheet; sd of first dives 50 to 150 g",
        quantity="flight.mass",
    )
    volume: Scalar = parameter(
        Normal(0.0585, 5e-5, lower=0.0),
        unit="m3",
        text="hull volume at the surface, the reference temperature and the neutral pump setting",
        source="ballast sheet; sd judgement",
        shown="cm3",
        shown_per_si=1e6,
        quantity="flight.volume",
    )
    compressibility: Scalar = parameter(
        Normal(0.0, 1e-10),
        unit="Pa-1",
        text="share of the hull volume lost per pascal, as far as it is calibrated",
        source="0 leaves it out; 4e-10 to 6e-10 for a Slocum",
        quantity="flight.hull_compressibility",
    )
    expansion: Scalar = parameter(
        Normal(0.0, 1e-5),
        unit="K-1",
        text="share of the hull volume gained per kelvin, as far as it is calibrated",
        source="0 leaves it out; 5e-5 to 7e-5 for a Slocum",
        quantity="flight.thermal_expansion",
    )
    reference_temperature: Scalar = constant(
        288.15, unit="K", text="temperature at which the volume is stated", source="vehicle file convention"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.hull",
        channels=(Channel.NET_BUOYANCY,),
        equation=r"F = g\{\rho[V(1-\epsilon P+\alpha_T(T-T_0))+\Delta V]-m\}",
        reads=("gravity", "density", "sea_pressure", "temperature", "buoyancy_volume"),
        valid="the depth range of the vehicle",
        reference=MERCKELBACH_2010 + ", buoyancy and weight",
        plain="The hull and the pumped oil float, the mass sinks.",
        title="Hull buoyancy and weight",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Net upward force, N."""
        warmer = self.expansion * (sample.temperature - self.reference_temperature)
        hull = self.volume * (1.0 - self.compressibility * sample.sea_pressure + warmer)
        return sample.gravity * (sample.density * (hull + sample.buoyancy_volume) - self.mass)


class ParasiteDrag(AbstractTerm):
    """Drag coefficient at zero angle of attack."""

    coefficient: Scalar = parameter(
        Normal(0.15, 0.03, lower=0.0),
        unit="1",
        text="parasite drag coefficient C_D0",
        source=MERCKELBACH_2019 + ": 0.15 to 0.16; calibrated vehicles 0.15 to 0.21",
        quantity="flight.parasite_drag",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.parasite_drag",
        channels=(Channel.DRAG_COEFFICIENT,),
        equation=r"C_D = C_{D0}",
        reads=(),
        valid="0.1 to 0.6 m/s",
        reference=MERCKELBACH_2019,
        plain="The hull drags at any angle of attack.",
        title="Parasite drag",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient."""
        return self.coefficient


class InducedDrag(AbstractTerm):
    """Drag that grows with the squared angle of attack."""

    coefficient: Scalar = parameter(
        Normal(10.5, 2.0, lower=0.0),
        unit="rad-2",
        text="drag coefficient per squared angle of attack C_D1",
        source=MERCKELBACH_2019 + ": 10.5 after calibration; sd judgement",
        quantity="flight.induced_drag",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.induced_drag",
        channels=(Channel.INDUCED_DRAG,),
        equation=r"C_D = C_{D1}\alpha^2",
        reads=(),
        valid="angle of attack below 0.17 rad",
        reference=MERCKELBACH_2019,
        plain="Gliding at an angle to the flow drags more.",
        title="Induced drag",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient per squared radian."""
        return self.coefficient


class Lift(AbstractTerm):
    """Lift of hull and wings, linear in the angle of attack."""

    slope: Scalar = parameter(
        Normal(7.5, 1.0, lower=0.0),
        unit="rad-1",
        text="lift coefficient per angle of attack, hull and wings together",
        source=MERCKELBACH_2019 + ": 3.8 hull and 3.7 wings; sd judgement",
        quantity="flight.lift_slope",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.lift",
        channels=(Channel.LIFT_SLOPE,),
        equation=r"C_L = (a_h+a_w)\alpha",
        reads=(),
        valid="angle of attack below 0.17 rad",
        reference=MERCKELBACH_2019,
        plain="Wings and hull lift in proportion to their angle to the flow.",
        title="Lift",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Lift coefficient per radian."""
        return self.slope


class Response(AbstractTerm):
    """Time in which the speed follows a change of force."""

    time_constant: Scalar = parameter(
        Normal(10.0, 2.0, lower=0.0),
        unit="s",
        text="time in which the speed comes within 1/e of its steady value",
        source="(1+k) m U / (2 D) of a 60 kg glider, about 12 s",
        quantity="flight.response_time",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.response",
        channels=(Channel.RESPONSE_TIME,),
        equation=r"\dot U = (U_\infty - U)/\tau",
        reads=(),
        valid="steady pitch and pump after an inflection",
        reference=MERCKELBACH_2019 + ", added masses",
        plain="After an inflection the glider needs some seconds to gather speed.",
        title="Response time",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Time constant, s."""
        return self.time_constant


class Pump(AbstractTerm):
    """Energy of a full dive-to-climb stroke, a line in depth."""

    intercept: Scalar = parameter(
        Normal(210.0, 46.0),
        unit="J",
        text="energy of a full stroke at the surface",
        source="comet 2019, 58 strokes of 460 cm3",
        quantity="energy.pump_dive_to_climb.intercept",
    )
    slope: Scalar = parameter(
        Normal(5.65, 1.25, lower=0.0),
        unit="J m-1",
        text="energy of a full stroke gained per metre of depth",
        source="comet 2019, 58 strokes of 460 cm3",
        quantity="energy.pump_dive_to_climb.slope",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.pump",
        channels=(Channel.PUMP_ENERGY,),
        equation=r"E = E_0 + k z",
        reads=("inflection_depth",),
        valid="full strokes; the model scales it by the volume moved",
        reference="line fitted to measured strokes",
        plain="Pumping oil out costs more the deeper it happens.",
        title="Pump stroke at depth",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.intercept + self.slope * sample.inflection_depth


class Retract(AbstractTerm):
    """Energy of a full climb-to-dive stroke."""

    energy: Scalar = parameter(
        Normal(180.0, 30.0, lower=0.0),
        unit="J",
        text="energy of a full climb-to-dive stroke",
        source="comet 2016 and 2019, 169 and 187 J per 460 cm3",
        quantity="energy.pump_climb_to_dive",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.retract",
        channels=(Channel.RETRACT_ENERGY,),
        equation=r"E = E_{in}",
        reads=(),
        valid="full strokes near the surface; the model scales it by the volume moved",
        reference="mean of measured strokes",
        plain="Drawing the piston in costs the same each time.",
        title="Pump stroke at the top",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.energy


class Brake(AbstractTerm):
    """Brake energy at every inflection."""

    energy: Scalar = parameter(
        Normal(45.0, 10.0, lower=0.0),
        unit="J",
        text="brake energy of one inflection",
        source="judgement",
        quantity="energy.brake",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.brake",
        channels=(Channel.BRAKE_ENERGY,),
        equation=r"E = E_b",
        reads=(),
        valid="any depth",
        reference="constant per event",
        plain="The pump's brake is released and set at every inflection.",
        title="Brake",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.energy


class Hotel(AbstractTerm):
    """Steady load of the vehicle."""

    power: Scalar = parameter(
        Normal(1.4, 0.3, lower=0.0),
        unit="W",
        text="power drawn all the time",
        source="comet 2019, 1.4 W floor",
        quantity="energy.hotel",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.hotel",
        channels=(Channel.HOTEL_POWER,),
        equation=r"P = P_h",
        reads=(),
        valid="any phase",
        reference="constant load",
        plain="Computers and sensors draw a steady load.",
        title="Hotel load",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power


class SurfaceHotel(AbstractTerm):
    """Load on top of the hotel while surfaced."""

    power: Scalar = parameter(
        Normal(2.5, 0.5, lower=0.0),
        unit="W",
        text="power drawn on top while at the surface",
        source="comet: GPS, air pump and Iridium 0.1 to 0.3 A above idle; sd judgement",
        quantity="energy.surface",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="base.surface",
        channels=(Channel.SURFACE_POWER,),
        equation=r"P = P_s",
        reads=(),
        valid="at the surface",
        reference="constant load",
        plain="GPS and satellite telephone draw more while the glider is up.",
        title="Surface load",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power


BASE: tuple[type[AbstractTerm], ...] = (
    Hull,
    ParasiteDrag,
    InducedDrag,
    Lift,
    Response,
    Pump,
    Retract,
    Brake,
    Hotel,
    SurfaceHotel,
)
