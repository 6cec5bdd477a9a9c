"""Where the glider points, how far it gets, and how it drifts while surfaced.

Imports :mod:`glider_jax.physics.term` only. Heading effects are angles added to the indicated heading to get the
true one, clockwise from north. Speed effects are logarithms of a factor on the horizontal speed.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from glider_jax.physics.term import (
    DEGREE,
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

_SOP = "OceanGliders depth-averaged current procedures: 1 degree calibrated, about 5 not"
_DRIFT = (Channel.SURFACE_DRIFT_EAST, Channel.SURFACE_DRIFT_NORTH)


def _angle(sd: float, text: str, source: str) -> Scalar:
    return parameter(
        Normal(0.0, sd), unit="rad", text=text, source=source, shown="deg", shown_per_si=DEGREE
    )  # fmt: skip


class CompassDeviation(AbstractTerm):
    """Hard iron: the compass error goes once around with the heading."""

    sine: Scalar = _angle(0.09, "sine amplitude of the error", _SOP)
    cosine: Scalar = _angle(0.09, "cosine amplitude of the error", _SOP)
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.compass_deviation",
        title="Compass deviation",
        channels=(Channel.HEADING,),
        equation=r"\delta\psi = A\sin\psi+B\cos\psi",
        reads=("heading",),
        valid="errors below 0.3 rad",
        reference="Hench and Rosman 2010: a one-cycle model cut the error of dead reckoning from 5 % to below 1 %",
        plain="The compass is off by an angle that depends on the course.",
        confusable_with=(
            "navigation.soft_iron",
            "navigation.magnetic_declination",
            "navigation.mean_current",
        ),
        decided_by="legs on four or more headings",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.sine * jnp.sin(sample.heading) + self.cosine * jnp.cos(sample.heading)


class SoftIron(AbstractTerm):
    """Soft iron: the compass error goes twice around with the heading."""

    sine: Scalar = _angle(0.03, "sine amplitude of the error", _SOP + "; two-cycle part: judgement")
    cosine: Scalar = _angle(0.03, "cosine amplitude of the error", _SOP + "; two-cycle part: judgement")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.soft_iron",
        title="Two-cycle compass deviation",
        channels=(Channel.HEADING,),
        equation=r"\delta\psi = C\sin2\psi+D\cos2\psi",
        reads=("heading",),
        valid="errors below 0.3 rad",
        reference="theory of compass deviation, quadrantal part",
        plain="The compass is off by an angle that swings twice through a full circle of courses.",
        confusable_with=("navigation.compass_deviation",),
        decided_by="legs on eight headings",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.sine * jnp.sin(2.0 * sample.heading) + self.cosine * jnp.cos(2.0 * sample.heading)


class MagneticDeclination(AbstractTerm):
    """One angle between the indicated and the true heading."""

    angle: Scalar = _angle(0.12, "true minus indicated heading", "4 degrees in the Baltic, 12 off New Jersey")
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.magnetic_declination",
        title="Declination",
        channels=(Channel.HEADING,),
        equation=r"\delta\psi = D",
        reads=(),
        valid="one region",
        reference="magnetic declination left out or stale",
        plain="All courses are turned by the same angle, as if the declination were wrong.",
        confusable_with=("navigation.compass_deviation",),
        decided_by="the declination the glider used; a constant compass error is the same",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.angle


class CompassPitch(AbstractTerm):
    """The compass reads differently on dives and climbs."""

    angle: Scalar = _angle(
        0.03, "true minus indicated heading on climbs, minus that on dives, halved", "judgement"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.compass_pitch",
        title="Compass on dives and climbs",
        channels=(Channel.HEADING,),
        equation=r"\delta\psi = k\,d",
        reads=("direction",),
        valid="any",
        reference="pitch-dependent compass errors; size: judgement",
        plain="The compass reads one way nose-up and another nose-down.",
        confusable_with=("navigation.current_shear",),
        decided_by="yos that spend unequal times up and down",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.angle * sample.direction


class CompassDepth(AbstractTerm):
    """The compass drifts with depth."""

    slope: Scalar = parameter(
        Normal(0.0, 3e-4), unit="rad m-1", text="true minus indicated heading per metre of depth",
        source="judgement; a fault of 50 degrees was seen on a SeaExplorer", shown="deg/100 m",
        shown_per_si=1e2 * DEGREE,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.compass_depth",
        title="Compass under pressure",
        channels=(Channel.HEADING,),
        equation=r"\delta\psi = k\,z",
        reads=("depth",),
        valid="the depth range of the vehicle",
        reference="depth-dependent compass faults of gliders; size: judgement",
        plain="The compass turns away as the glider goes down.",
        confusable_with=("navigation.magnetic_declination", "navigation.current_shear"),
        decided_by="deep against shallow segments on the same course",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Angle, rad."""
        return self.slope * sample.depth


class SpeedBias(AbstractTerm):
    """The glider gets further, or less far, than the model says."""

    share: Scalar = parameter(
        Normal(0.0, 0.03), unit="1", text="logarithm of true over modelled horizontal speed",
        support=(-0.4, 0.4),
        source="about 3 %, 1 cm/s, before the 2019 calibration", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.speed_bias",
        title="Horizontal speed",
        channels=(Channel.LOG_SPEED,),
        equation=r"\ln f = b",
        reads=(),
        valid="below 0.3",
        reference="Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1",
        plain="The glider gets further or less far than its vertical speed and pitch tell.",
        confusable_with=("flight.lift_loss", "navigation.attack_neglected", "flight.drag_growth"),
        decided_by="reciprocal legs, or a measured speed through the water",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return self.share


class AttackNeglected(AbstractTerm):
    """Part of the angle of attack is left out when speed is worked out from depth rate and pitch."""

    share: Scalar = parameter(
        Normal(0.0, 0.5),
        unit="1",
        text="share by which speed moves to that along the pitch; -1 undoes a reckoning that left the angle out",
        source="firmware leaves all of it out",
    )
    steepness: Scalar = constant(
        0.05, unit="rad", text="angle below which the law is rounded off", source="numerical"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.attack_neglected",
        title="Angle of attack in dead reckoning",
        channels=(Channel.LOG_SPEED,),
        equation=r"\ln f = \tfrac{k}{2}\ln\frac{\tan^2\gamma+\theta_s^2}{\tan^2\theta+\theta_s^2}",
        reads=("pitch", "glide_angle"),
        valid="pitch above 0.1 rad",
        reference="Slocum firmware: u_angle_of_attack is 0 unless it is computed; 10.7 % at 26 degrees",
        plain="Speed was worked out from the pitch alone, though the glider flies more steeply than it points.",
        confusable_with=("navigation.speed_bias", "flight.lift_loss"),
        decided_by="reciprocal legs, or several pitch angles",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        soft = self.steepness**2
        path, pitch = jnp.tan(sample.glide_angle) ** 2 + soft, jnp.tan(sample.pitch) ** 2 + soft
        return 0.5 * self.share * jnp.log(path / pitch)


class Coasting(AbstractTerm):
    """After an inflection the glider is slower than in steady flight."""

    share: Scalar = parameter(
        Normal(0.0, 0.3),
        unit="1",
        text="share of the speed missing at the inflection",
        source="judgement",
        support=(0.0, 1.0),
    )
    decay: Scalar = parameter(
        LogNormal(15.0, 2.0), unit="s", text="time in which it comes back", source="firmware coasts for 7.5 s",
        role="shape",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.coasting",
        title="Coasting through inflections",
        channels=(Channel.LOG_SPEED,),
        equation=r"\ln f = -k\,e^{-t_i/\tau}",
        reads=("time_since_inflection",),
        valid="yos of more than a minute",
        reference="Slocum firmware u_coast_time; 1 to 3 % in shallow yos",
        plain="Every turn costs a little way, which adds up in shallow yos.",
        confusable_with=("navigation.speed_bias", "flight.added_mass"),
        decided_by="deep against shallow yos",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor."""
        return -self.share * jnp.exp(-sample.time_since_inflection / self.decay)


class SurfaceWindage(AbstractTerm):
    """While surfaced the glider drifts through the water at a steady velocity."""

    east: Scalar = parameter(
        Normal(0.0, 0.15), unit="m s-1", text="drift through the water, east", source="1 to 3 % of 10 m/s of wind",
        shown="cm/s", shown_per_si=1e2,
    )  # fmt: skip
    north: Scalar = parameter(
        Normal(0.0, 0.15), unit="m s-1", text="drift through the water, north", source="1 to 3 % of 10 m/s of wind",
        shown="cm/s", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.surface_windage",
        title="Drift at the surface",
        channels=_DRIFT,
        equation=r"\Delta\mathbf{u} = \mathbf{u}_w",
        reads=(),
        valid="steady wind",
        reference="leeway of small floating bodies",
        plain="Wind and waves pushed the glider while it lay at the surface.",
        confusable_with=("navigation.leeway", "navigation.mean_current"),
        decided_by="several fixes during one surfacing, and winds",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return self.east, self.north


class Leeway(AbstractTerm):
    """While surfaced the glider drifts with a share of the wind."""

    share: Scalar = parameter(
        Normal(0.0, 0.02), unit="1", text="drift over wind speed", source="1 to 3 % of the wind",
        support=NEVER_NEGATIVE,
        shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="navigation.leeway",
        title="Leeway",
        channels=_DRIFT,
        equation=r"\Delta\mathbf{u} = c\,\mathbf{W}",
        reads=("wind_east", "wind_north"),
        valid="wind below 20 m/s",
        reference="leeway of small floating bodies",
        plain="At the surface the glider drifted downwind in proportion to the wind.",
        confusable_with=("navigation.surface_windage", "navigation.stokes_drift"),
        decided_by="wind that turns during the mission",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Velocity, m s-1, east and north."""
        return self.share * sample.wind_east, self.share * sample.wind_north


TERMS: tuple[type[AbstractTerm], ...] = (
    CompassDeviation,
    SoftIron,
    MagneticDeclination,
    CompassPitch,
    CompassDepth,
    SpeedBias,
    AttackNeglected,
    Coasting,
    SurfaceWindage,
    Leeway,
)
