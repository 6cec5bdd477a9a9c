"""How the water moves beyond what the environment gives: vertical motion, tides, inertial motion, shear.

Imports :mod:`glider_jax.physics.term` only. A periodic flow is a cosine and a sine amplitude per component, counted
from the run's time zero, so that it is linear in its unknowns. Vertical water velocity is positive up: unlike an
effect of the glider's own, it has the same sign on dives and climbs.
"""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp

from glider_jax.physics.term import (
    NEVER_NEGATIVE,
    AbstractTerm,
    Channel,
    LogNormal,
    Normal,
    Sample,
    Scalar,
    TermInfo,
    constant,
    parameter,
)

_VECTOR = (Channel.CURRENT_EAST, Channel.CURRENT_NORTH)
_TIDE = "judgement: shelf tides 0.1 to 1 m/s; the product usually holds most of it"


def _amplitude(sd: float, text: str, source: str) -> Scalar:
    return parameter(
        Normal(0.0, sd), unit="m s-1", text=text, source=source, shown="cm/s", shown_per_si=1e2
    )  # fmt: skip


class VerticalWaterVelocity(AbstractTerm):
    """Water that heaves up and down with one period: internal waves or an internal tide."""

    cosine: Scalar = _amplitude(0.01, "cosine amplitude, up", "internal waves 0.3 to 2 cm/s")
    sine: Scalar = _amplitude(0.01, "sine amplitude, up", "internal waves 0.3 to 2 cm/s")
    period: Scalar = parameter(
        LogNormal(21600.0, 2.5), unit="s", text="period", source="judgement: hours", role="shape",
        shown="h", shown_per_si=1.0 / 3600.0,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.vertical_water_velocity",
        title="Heaving water",
        channels=(Channel.VERTICAL_WATER_VELOCITY,),
        equation=r"w = a\cos(2\pi t/T)+b\sin(2\pi t/T)",
        reads=("time",),
        valid="periods of an hour to days",
        reference="internal waves; Frajka-Williams et al. 2011, vertical velocity from gliders",
        plain="The water itself moved up and down in a rhythm, dives and climbs alike.",
        confusable_with=("flight.internal_tide", "flight.mean_upwelling"),
        decided_by="a record of several periods, or a moored profiler",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Velocity, m s-1, up."""
        phase = 2.0 * math.pi * sample.time / self.period
        return self.cosine * jnp.cos(phase) + self.sine * jnp.sin(phase)


class MeanUpwelling(AbstractTerm):
    """Steady upward or downward motion of the water."""

    velocity: Scalar = _amplitude(0.002, "mean velocity, up", "zero over many dives within 2 mm/s")
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.mean_upwelling",
        title="Mean vertical velocity",
        channels=(Channel.VERTICAL_WATER_VELOCITY,),
        equation=r"w = w_0",
        reads=(),
        valid="one region and a few days",
        reference="judgement",
        plain="The water rose or sank steadily.",
        confusable_with=("flight.pitch_offset", "flight.ballast_offset", "flight.oil_offset"),
        decided_by="a measured speed, or dives with other pitches and pumped volumes",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Velocity, m s-1, up."""
        return self.velocity


class InternalTide(AbstractTerm):
    """Internal tide of the lowest mode: largest at mid-depth, zero at surface and seafloor."""

    cosine: Scalar = _amplitude(0.01, "cosine amplitude at mid-depth, up", "baroclinic M2 0.5 to 2 cm/s")
    sine: Scalar = _amplitude(0.01, "sine amplitude at mid-depth, up", "baroclinic M2 0.5 to 2 cm/s")
    frequency: Scalar = constant(1.405189e-4, unit="rad s-1", text="frequency of M2", source="astronomy")
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.internal_tide",
        title="Internal tide",
        channels=(Channel.VERTICAL_WATER_VELOCITY,),
        equation=r"w = (a\cos\omega t+b\sin\omega t)\sin(\pi z/H)",
        reads=("time", "depth", "bottom_depth"),
        valid="stratified water over a flat bottom",
        reference="first vertical mode of a uniformly stratified ocean",
        plain="The tide inside the water lifted and lowered the glider, most at mid-depth.",
        confusable_with=("flight.vertical_water_velocity",),
        decided_by="where in the water column it is strongest",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Velocity, m s-1, up."""
        phase = self.frequency * sample.time
        mode = jnp.sin(math.pi * sample.depth / sample.bottom_depth)
        return (self.cosine * jnp.cos(phase) + self.sine * jnp.sin(phase)) * mode


class MeanCurrent(AbstractTerm):
    """A steady current that no product gave."""

    east: Scalar = _amplitude(0.15, "current, east", "depth-averaged currents 0.05 to 0.5 m/s")
    north: Scalar = _amplitude(0.15, "current, north", "depth-averaged currents 0.05 to 0.5 m/s")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.mean_current",
        title="Mean current",
        channels=_VECTOR,
        equation=r"(u, v) = (u_0, v_0)",
        reads=(),
        valid="one region and a few days",
        reference="depth-averaged current from GPS against dead reckoning",
        plain="A steady current that the forecast did not know carried the glider.",
        confusable_with=("navigation.current_shear", "navigation.surface_windage", "navigation.product_gain"),
        decided_by="legs on several headings, and the drift while surfaced",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return self.east, self.north


class CurrentShear(AbstractTerm):
    """Below the surface the flow is not what the surface product says."""

    loss: Scalar = parameter(
        Normal(0.0, 0.5), unit="1", text="share of the surface current that is gone at depth",
        support=(-1.0, 2.0),
        source="judgement: HF radar against ADCP 5 to 9 cm/s", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    east: Scalar = _amplitude(0.1, "deep flow of its own, east", "judgement")
    north: Scalar = _amplitude(0.1, "deep flow of its own, north", "judgement")
    scale: Scalar = parameter(
        LogNormal(20.0, 2.0), unit="m", text="depth over which the surface flow fades", source="judgement",
        role="shape",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.current_shear",
        title="Shear under the surface current",
        channels=_VECTOR,
        equation=r"\Delta\mathbf{u} = (1-e^{-z/h})(\mathbf{u}_d-k\,\mathbf{u}_s)",
        reads=("depth", "surface_current_east", "surface_current_north"),
        valid="a product of surface currents",
        reference="Liu et al., HF radar against ADCP on the West Florida Shelf; form: judgement",
        plain="The water below moves differently from the surface current that the forecast used.",
        confusable_with=("navigation.mean_current", "navigation.product_gain"),
        decided_by="dives to different depths, and the drift while surfaced",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        below = -jnp.expm1(-sample.depth / self.scale)
        east = self.east - self.loss * sample.surface_current_east
        north = self.north - self.loss * sample.surface_current_north
        return below * east, below * north


class ProductGain(AbstractTerm):
    """The current product is too strong or too weak, in proportion."""

    gain: Scalar = parameter(
        Normal(0.0, 0.3), unit="1", text="true over given current, minus one",
        support=(-1.0, 3.0),
        source="radar 30 % above a current meter along the shelf", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.product_gain",
        title="Scale of the current product",
        channels=_VECTOR,
        equation=r"\Delta\mathbf{u} = g\,\mathbf{u}_s",
        reads=("surface_current_east", "surface_current_north"),
        valid="any product",
        reference="Liu et al., HF radar against ADCP on the West Florida Shelf",
        plain="The currents were stronger or weaker than the product said.",
        confusable_with=("navigation.current_shear",),
        decided_by="the drift while surfaced",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return self.gain * sample.surface_current_east, self.gain * sample.surface_current_north


class TidalCurrent(AbstractTerm):
    """The lunar half-daily tide, as a cosine and a sine amplitude per component."""

    east_cosine: Scalar = _amplitude(0.1, "cosine amplitude, east", _TIDE)
    east_sine: Scalar = _amplitude(0.1, "sine amplitude, east", _TIDE)
    north_cosine: Scalar = _amplitude(0.1, "cosine amplitude, north", _TIDE)
    north_sine: Scalar = _amplitude(0.1, "sine amplitude, north", _TIDE)
    frequency: Scalar = constant(1.405189e-4, unit="rad s-1", text="frequency of M2", source="astronomy")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.tidal_current",
        title="M2 tide",
        channels=_VECTOR,
        equation=r"u = a_u\cos\omega t+b_u\sin\omega t,\quad v = a_v\cos\omega t+b_v\sin\omega t",
        reads=("time",),
        valid="three days and more",
        reference="Merckelbach 2016, Biogeosciences 13, 6637: tides within a glider's segments",
        plain="The half-daily tide carried the glider to and fro.",
        confusable_with=("navigation.tide_s2", "navigation.inertial_oscillation"),
        decided_by="two weeks of record for S2; away from 74.5 degrees latitude for inertial motion",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return _harmonic(self, sample)


class TideS2(AbstractTerm):
    """The solar half-daily tide."""

    east_cosine: Scalar = _amplitude(0.03, "cosine amplitude, east", _TIDE)
    east_sine: Scalar = _amplitude(0.03, "sine amplitude, east", _TIDE)
    north_cosine: Scalar = _amplitude(0.03, "cosine amplitude, north", _TIDE)
    north_sine: Scalar = _amplitude(0.03, "sine amplitude, north", _TIDE)
    frequency: Scalar = constant(1.4544410e-4, unit="rad s-1", text="frequency of S2", source="astronomy")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.tide_s2",
        title="S2 tide",
        channels=_VECTOR,
        equation=r"u = a_u\cos\omega t+b_u\sin\omega t,\quad v = a_v\cos\omega t+b_v\sin\omega t",
        reads=("time",),
        valid="two weeks and more beside M2",
        reference="tidal harmonics",
        plain="The solar half-daily tide carried the glider to and fro.",
        confusable_with=("navigation.tidal_current",),
        decided_by="two weeks of record",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return _harmonic(self, sample)


class TideK1(AbstractTerm):
    """The daily tide, which also stands for a sea breeze's current."""

    east_cosine: Scalar = _amplitude(0.04, "cosine amplitude, east", _TIDE)
    east_sine: Scalar = _amplitude(0.04, "sine amplitude, east", _TIDE)
    north_cosine: Scalar = _amplitude(0.04, "cosine amplitude, north", _TIDE)
    north_sine: Scalar = _amplitude(0.04, "sine amplitude, north", _TIDE)
    frequency: Scalar = constant(7.2921159e-5, unit="rad s-1", text="frequency of K1", source="astronomy")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.tide_k1",
        title="K1 tide",
        channels=_VECTOR,
        equation=r"u = a_u\cos\omega t+b_u\sin\omega t,\quad v = a_v\cos\omega t+b_v\sin\omega t",
        reads=("time",),
        valid="three days and more",
        reference="tidal harmonics",
        plain="The daily tide, or a daily wind, carried the glider to and fro.",
        confusable_with=("navigation.inertial_oscillation",),
        decided_by="latitudes away from 30 degrees",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return _harmonic(self, sample)


def _harmonic(tide: TidalCurrent | TideS2 | TideK1, sample: Sample) -> tuple[Scalar, Scalar]:
    cosine, sine = jnp.cos(tide.frequency * sample.time), jnp.sin(tide.frequency * sample.time)
    east = tide.east_cosine * cosine + tide.east_sine * sine
    return east, tide.north_cosine * cosine + tide.north_sine * sine


class InertialOscillation(AbstractTerm):
    """Water that circles at the inertial frequency, clockwise in the northern hemisphere."""

    cosine: Scalar = _amplitude(0.1, "velocity at time zero, east", "bursts of 0.05 to 0.3 m/s after wind")
    sine: Scalar = _amplitude(0.1, "velocity at time zero, north", "bursts of 0.05 to 0.3 m/s after wind")
    rotation: Scalar = constant(
        7.2921159e-5, unit="rad s-1", text="rotation of the Earth", source="astronomy"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.inertial_oscillation",
        title="Inertial oscillation",
        channels=_VECTOR,
        equation=r"u+iv = (a+ib)e^{-ift},\quad f = 2\Omega\sin\lambda",
        reads=("time", "latitude"),
        valid="days after a wind event",
        reference="inertial motion on a rotating Earth",
        plain="After a storm the water circled, and the glider with it.",
        confusable_with=("navigation.tidal_current", "navigation.tide_k1"),
        decided_by="rotation sense and period: latitudes away from 30 and 74.5 degrees",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        phase = 2.0 * self.rotation * jnp.sin(sample.latitude) * sample.time
        cosine, sine = jnp.cos(phase), jnp.sin(phase)
        return self.cosine * cosine + self.sine * sine, self.sine * cosine - self.cosine * sine


class StokesDrift(AbstractTerm):
    """Waves carry the upper metres along with the wind."""

    share: Scalar = parameter(
        Normal(0.0, 0.012), unit="1", text="surface Stokes drift over wind speed",
        support=NEVER_NEGATIVE,
        source="1 to 1.5 % of the wind", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    scale: Scalar = parameter(
        LogNormal(5.0, 2.0), unit="m", text="depth over which it fades", source="judgement: 60 m waves",
        role="shape",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.stokes_drift",
        title="Stokes drift",
        channels=_VECTOR,
        equation=r"\Delta\mathbf{u} = c\,\mathbf{W}e^{-z/h}",
        reads=("depth", "wind_east", "wind_north"),
        valid="open water",
        reference="deep-water waves; size: judgement",
        plain="Waves carried the glider downwind near the surface.",
        confusable_with=("navigation.leeway", "navigation.surface_windage"),
        decided_by="shallow yos against deep ones",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        drift = self.share * jnp.exp(-sample.depth / self.scale)
        return drift * sample.wind_east, drift * sample.wind_north


TERMS: tuple[type[AbstractTerm], ...] = (
    VerticalWaterVelocity,
    MeanUpwelling,
    InternalTide,
    MeanCurrent,
    CurrentShear,
    ProductGain,
    TidalCurrent,
    TideS2,
    TideK1,
    InertialOscillation,
    StokesDrift,
)
