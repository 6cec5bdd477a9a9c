"""What the hull and its weight do beyond the base model: volume, mass and the oil that is moved.

Imports :mod:`glider_jax.physics.term` only. All feed ``NET_BUOYANCY``, N, positive up: an effect of one sign makes
climbs faster and dives slower. Growth counts from the start of the deployment (``elapsed``).
"""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp

from glider_jax.physics.term import (
    NEVER_NEGATIVE,
    PER_DAY,
    AbstractTerm,
    Channel,
    LogNormal,
    Normal,
    Sample,
    Scalar,
    TermInfo,
    constant,
    parameter,
    reference_temperature,
)

_BUOYANCY = (Channel.NET_BUOYANCY,)


class HullCompressibility(AbstractTerm):
    """The hull shrinks under pressure."""

    compressibility: Scalar = parameter(
        Normal(0.0, 5e-10),
        support=(0.0, 2e-9),
        unit="Pa-1",
        text="share of the hull volume lost per pascal beyond the base model",
        source="5e-10 default of the Slocum flight model; 2.1e-10 to 6e-10 across vehicles, no hull near 2e-9",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.hull_compressibility",
        title="Hull compressibility",
        channels=_BUOYANCY,
        equation=r"F = -g\rho V\epsilon P",
        reads=("gravity", "density", "hull_volume", "sea_pressure"),
        valid="the depth range of the vehicle",
        reference="Merckelbach et al. 2010, doi:10.1175/2009JTECHO710.1, buoyancy",
        plain="The hull is squeezed at depth, so the glider gets heavier the deeper it is.",
        confusable_with=("flight.bladder_air", "flight.ballast_offset", "flight.thermal_expansion"),
        decided_by="deep and shallow dives in one mission, and water whose temperature does not follow the depth",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        lost = self.compressibility * sample.sea_pressure
        return -sample.gravity * sample.density * sample.hull_volume * lost


class ThermalExpansion(AbstractTerm):
    """The hull grows with temperature."""

    expansion: Scalar = parameter(
        Normal(0.0, 5e-5),
        support=(0.0, 2e-4),
        unit="K-1",
        text="share of the hull volume gained per kelvin beyond the base model",
        source="Seaglider 7.05e-5, Deepglider 6.2e-5, aluminium 7e-5, hard plastics up to 2e-4",
    )
    reference_temperature: Scalar = reference_temperature()
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.thermal_expansion",
        title="Thermal expansion of the hull",
        channels=_BUOYANCY,
        equation=r"F = g\rho V\alpha_T(T-T_0)",
        reads=("gravity", "density", "hull_volume", "temperature"),
        valid="271 to 308 K, hull at the temperature of the water",
        reference="Merckelbach et al. 2010; Eriksen et al. 2001, doi:10.1109/48.972073",
        plain="The hull shrinks in cold water, so the glider gets heavier below the thermocline.",
        confusable_with=("flight.hull_compressibility", "flight.oil_temperature", "flight.density_contrast"),
        decided_by="dives through differently layered water, or a season with another temperature profile",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        gained = self.expansion * (sample.temperature - self.reference_temperature)
        return sample.gravity * sample.density * sample.hull_volume * gained


class BallastOffset(AbstractTerm):
    """The glider is heavier than its ballast sheet says."""

    mass: Scalar = parameter(
        Normal(0.0, 0.05),
        unit="kg",
        text="mass beyond the ballast sheet",
        source="first dives 50 to 150 g; 45 g to be added on the glider comet",
        shown="g",
        shown_per_si=1e3,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.ballast_offset",
        title="Ballast error",
        channels=_BUOYANCY,
        equation=r"F = -g\,\delta m",
        reads=("gravity",),
        valid="any",
        reference="Graver 2005, trim offset from steady glides",
        plain="The glider was ballasted too heavy or too light: it is fast one way and slow the other, always.",
        confusable_with=(
            "flight.oil_offset",
            "flight.salinity_bias",
            "flight.mean_upwelling",
            "flight.pitch_offset",
        ),
        decided_by="dives with other pumped volumes and pitches, the ballast sheet, or another water mass",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return -sample.gravity * self.mass


class MassGrowth(AbstractTerm):
    """The glider gains mass steadily."""

    rate: Scalar = parameter(
        Normal(0.0, 0.02 / 86400.0),
        support=NEVER_NEGATIVE,
        unit="kg s-1",
        text="mass gained in time at sea",
        source="judgement: 10 to 500 g of fouling or water over a mission",
        shown="kg/day",
        shown_per_si=PER_DAY,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.mass_growth",
        title="Growing mass",
        channels=_BUOYANCY,
        equation=r"F = -g\,\dot m\,t",
        reads=("gravity", "elapsed"),
        valid="weeks",
        reference="buoyancy drift corrections of operational Seaglider processing",
        plain="The glider gets heavier from day to day: fouling with shells, or water coming in.",
        confusable_with=("flight.water_ingress", "flight.oil_loss", "sensor.salinity_drift"),
        decided_by="vacuum and leak sensors, and whether drag grows at the same time",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return -sample.gravity * self.rate * sample.elapsed


class WaterIngress(AbstractTerm):
    """Water comes in at one time and stays."""

    mass: Scalar = parameter(
        Normal(0.0, 0.05),
        support=NEVER_NEGATIVE,
        unit="kg",
        text="mass of water that came in",
        source="judgement: 10 to 500 g",
        shown="g",
        shown_per_si=1e3,
    )
    onset: Scalar = parameter(
        LogNormal(2.0 * 86400.0, 2.0),
        unit="s",
        text="when half of it was in, after the deployment began",
        source="judgement",
        role="shape",
        shown="day",
        shown_per_si=1.0 / PER_DAY,
    )
    duration: Scalar = constant(7200.0, unit="s", text="time scale of the inflow", source="judgement")
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.water_ingress",
        title="Water ingress",
        channels=_BUOYANCY,
        equation=r"F = -g\,m\,[1+e^{-(t-t_1)/\tau}]^{-1}",
        reads=("gravity", "elapsed"),
        valid="weeks",
        reference="leak alarms of operating gliders; form: judgement",
        plain="At some time water came into the hull, and the glider has been heavier since.",
        confusable_with=("flight.mass_growth", "flight.oil_loss", "flight.wing_loss"),
        decided_by="leak voltage and vacuum",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return -sample.gravity * self.mass * jax.nn.sigmoid((sample.elapsed - self.onset) / self.duration)


class OilLoss(AbstractTerm):
    """The buoyancy system loses volume steadily."""

    rate: Scalar = parameter(
        Normal(0.0, 5e-6 / 86400.0),
        support=NEVER_NEGATIVE,
        unit="m3 s-1",
        text="volume lost in time",
        source="judgement: a few cubic centimetres a day",
        shown="cm3/day",
        shown_per_si=1e6 * PER_DAY,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.oil_loss",
        title="Loss of oil",
        channels=_BUOYANCY,
        equation=r"F = -g\rho\,\dot V\,t",
        reads=("gravity", "density", "elapsed"),
        valid="weeks",
        reference="judgement",
        plain="The pump moves less volume out than it reports, a little more so every day.",
        confusable_with=("flight.mass_growth", "flight.water_ingress"),
        decided_by="vacuum, oil pressure and the pump's end stops",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return -sample.gravity * sample.density * self.rate * sample.elapsed


class OilGain(AbstractTerm):
    """The pumped volume is larger or smaller than reported, in proportion."""

    gain: Scalar = parameter(
        Normal(0.0, 0.035),
        support=(-0.5, 1.0),
        unit="1",
        text="true over reported pumped volume, minus one",
        source="judgement: 2 to 5 % of the volume sensor",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.oil_gain",
        title="Pumped volume scale",
        channels=_BUOYANCY,
        equation=r"F = g\rho\,k\,\Delta V",
        reads=("gravity", "density", "buoyancy_volume"),
        valid="any",
        reference="calibration of the pump's potentiometer; size: judgement",
        plain="The pump moves more or less oil than its sensor says, so all glides are faster or slower.",
        confusable_with=("flight.drag_bias", "flight.pitch_gain", "sensor.pressure_gain"),
        decided_by="a full stroke on the bench, dives with three pumped volumes, or a measured speed",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return sample.gravity * sample.density * self.gain * sample.buoyancy_volume


class OilOffset(AbstractTerm):
    """The zero of the pumped volume is off."""

    volume: Scalar = parameter(
        Normal(0.0, 12e-6),
        unit="m3",
        text="true pumped volume where zero is reported",
        source="judgement: 5 to 20 cm3",
        shown="cm3",
        shown_per_si=1e6,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.oil_offset",
        title="Pumped volume zero",
        channels=_BUOYANCY,
        equation=r"F = g\rho\,V_o",
        reads=("gravity", "density"),
        valid="any",
        reference="calibration of the pump's potentiometer; size: judgement",
        plain="The pump's neutral setting is not where the glider thinks it is.",
        confusable_with=("flight.ballast_offset", "flight.salinity_bias", "flight.mean_upwelling"),
        decided_by="the pump's end stops and the ballast sheet",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return sample.gravity * sample.density * self.volume


class OilTemperature(AbstractTerm):
    """The volume sensor drifts with temperature."""

    slope: Scalar = parameter(
        Normal(0.0, 0.3e-6),
        unit="m3 K-1",
        text="true minus reported pumped volume per kelvin",
        source="judgement: 0.1 to 0.5 cm3 per kelvin",
        shown="cm3/K",
        shown_per_si=1e6,
    )
    reference_temperature: Scalar = reference_temperature()
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.oil_temperature",
        title="Temperature of the volume sensor",
        channels=_BUOYANCY,
        equation=r"F = g\rho\,k_T(T-T_0)",
        reads=("gravity", "density", "battery_temperature"),
        valid="271 to 308 K",
        reference="calibration of the pump's potentiometer; size: judgement",
        plain="The pump's sensor reads differently in a cold hull.",
        confusable_with=("flight.thermal_expansion",),
        decided_by="the hull's own temperature, which lags the water's",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        warmer = sample.battery_temperature - self.reference_temperature
        return sample.gravity * sample.density * self.slope * warmer


class BladderAir(AbstractTerm):
    """Air trapped after a surfacing, squeezed at depth and soon dissolved."""

    volume: Scalar = parameter(
        Normal(0.0, 15e-6),
        support=NEVER_NEGATIVE,
        unit="m3",
        text="air under the fairing at the surface",
        source="judgement: 5 to 30 cm3",
        shown="cm3",
        shown_per_si=1e6,
    )
    decay: Scalar = parameter(
        LogNormal(1800.0, 2.0), unit="s", text="time in which it goes", source="judgement", role="shape"
    )
    atmosphere: Scalar = constant(101325.0, unit="Pa", text="air pressure at the surface", source="standard")
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.bladder_air",
        title="Trapped air",
        channels=_BUOYANCY,
        equation=r"F = g\rho\,V_a\frac{P_0}{P_0+P}e^{-t_d/\tau}",
        reads=("gravity", "density", "sea_pressure", "time_since_surfacing"),
        valid="first dives after a surfacing",
        reference="gas settling time in the Slocum firmware; form: Boyle's law",
        plain="Air trapped at the surface keeps the glider light for the first tens of metres of a dive.",
        confusable_with=("flight.hull_compressibility",),
        decided_by="the first dive after a surfacing against later ones",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        squeezed = self.volume * self.atmosphere / (self.atmosphere + sample.sea_pressure)
        return sample.gravity * sample.density * squeezed * jnp.exp(-sample.time_since_surfacing / self.decay)


class SalinityBias(AbstractTerm):
    """The measured salinity, and so the density, is off."""

    bias: Scalar = parameter(
        Normal(0.0, 0.05),
        unit="1",
        text="true minus measured practical salinity",
        source="0.01 drift to 0.1 of a fouled cell",
    )
    contraction: Scalar = constant(
        7.6e-4,
        unit="1",
        text="share of density gained per unit of salinity",
        source="TEOS-10, cool shelf water",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.salinity_bias",
        title="Salinity calibration",
        channels=_BUOYANCY,
        equation=r"F = g\rho V\beta\,\delta S",
        reads=("gravity", "density", "hull_volume"),
        valid="any",
        reference="haline contraction of TEOS-10; size: judgement",
        plain="The conductivity cell is off, so the water is denser or lighter than the model thinks.",
        confusable_with=("flight.ballast_offset", "flight.oil_offset"),
        decided_by="temperature and salinity against the deep water mass, or a second CTD",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        denser = self.contraction * self.bias
        return sample.gravity * sample.density * sample.hull_volume * denser


class DensityContrast(AbstractTerm):
    """The water is layered more, or less, than the model's profile says."""

    share: Scalar = parameter(
        Normal(0.0, 0.2),
        support=(-1.0, 2.0),
        unit="1",
        text="density anomaly left out, as a share of the profile's",
        source="judgement",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.density_contrast",
        title="Stratification",
        channels=_BUOYANCY,
        equation=r"F = g V k(\rho-\rho_r)",
        reads=("gravity", "hull_volume", "density", "reference_density"),
        valid="forecasts that fly in a stated profile",
        reference="buoyancy in stratified water; size: judgement",
        plain="The layering of the water differs from the profile used, so thrust is lost climbing into light water.",
        confusable_with=("flight.thermal_expansion", "flight.hull_compressibility"),
        decided_by="the glider's own CTD instead of a stated profile",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Force, N."""
        return sample.gravity * sample.hull_volume * self.share * (sample.density - sample.reference_density)


TERMS: tuple[type[AbstractTerm], ...] = (
    HullCompressibility,
    ThermalExpansion,
    BallastOffset,
    MassGrowth,
    WaterIngress,
    OilLoss,
    OilGain,
    OilOffset,
    OilTemperature,
    BladderAir,
    SalinityBias,
    DensityContrast,
)
