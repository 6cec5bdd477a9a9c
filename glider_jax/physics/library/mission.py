"""Where half yos turn and how long surfacings last, beyond the base model: seafloor, altimeter, overshoot, calls.

Imports :mod:`glider_jax.physics.term` only. ``TURN_DEPTH`` is positive down: a dive turns deeper, a climb turns
earlier. ``WATER_DEPTH`` is added to the chart's.
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
    constant,
    parameter,
)

_TURN = (Channel.TURN_DEPTH,)


class BathymetryBias(AbstractTerm):
    """The seafloor lies deeper or shallower than charted."""

    bias: Scalar = parameter(
        Normal(0.0, 8.0),
        unit="m",
        text="true minus charted water depth",
        source="judgement: 5 to 20 m on shelves",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="seafloor.bathymetry_bias",
        title="Charted depth",
        channels=(Channel.WATER_DEPTH,),
        equation=r"\Delta H = b",
        reads=(),
        valid="one region",
        reference="coarse bathymetry over a shelf; size: judgement",
        plain="The seafloor is deeper or shallower than the chart.",
        confusable_with=("mission.turn_offset", "sensor.altimeter_gain", "sensor.pressure_offset"),
        decided_by="depth plus altitude at the turns",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return self.bias


class WaterLevel(AbstractTerm):
    """The tide raises and lowers the water."""

    cosine: Scalar = parameter(Normal(0.0, 1.0), unit="m", text="cosine amplitude", source="tide 1 to 3 m")
    sine: Scalar = parameter(Normal(0.0, 1.0), unit="m", text="sine amplitude", source="tide 1 to 3 m")
    frequency: Scalar = constant(1.405189e-4, unit="rad s-1", text="frequency of M2", source="astronomy")
    info: ClassVar[TermInfo] = TermInfo(
        id="seafloor.water_level",
        title="Tidal water level",
        channels=(Channel.WATER_DEPTH,),
        equation=r"\Delta H = a\cos\omega t+b\sin\omega t",
        reads=("time",),
        valid="shelf water",
        reference="tidal harmonics",
        plain="The tide made the water deeper and shallower.",
        confusable_with=("seafloor.bathymetry_bias",),
        decided_by="turns at the same place at different hours",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        phase = self.frequency * sample.time
        return self.cosine * jnp.cos(phase) + self.sine * jnp.sin(phase)


class Overshoot(AbstractTerm):
    """A half yo runs past its depth by a time at its vertical speed."""

    time: Scalar = parameter(
        Normal(0.0, 10.0), unit="s", text="time past the commanded turn",
        support=NEVER_NEGATIVE,
        source="2 to 4 m shallow, 5 to 15 m deep at 0.15 to 0.2 m/s",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="mission.overshoot",
        title="Overshoot",
        channels=_TURN,
        equation=r"\Delta z = \tau\,\dot z",
        reads=("depth_rate",),
        valid="any",
        reference="inflection time guess of 12 s in the firmware",
        plain="The glider runs further past its turning depth, the faster it sinks or climbs.",
        confusable_with=("mission.turn_offset",),
        decided_by="turns at two vertical speeds",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return self.time * sample.depth_rate


class TurnOffset(AbstractTerm):
    """Dives turn deeper, and climbs shallower, by a fixed depth."""

    depth: Scalar = parameter(
        Normal(0.0, 2.0), unit="m", text="depth past the commanded turn, either way", source="judgement"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="mission.turn_offset",
        title="Yo limits",
        channels=_TURN,
        equation=r"\Delta z = -h\,d",
        reads=("direction",),
        valid="any",
        reference="commanded against flown limits",
        plain="Yos are taller or flatter than commanded, whatever the speed.",
        confusable_with=("mission.overshoot", "seafloor.bathymetry_bias"),
        decided_by="turns at two vertical speeds",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return -self.depth * sample.direction


class AltimeterGain(AbstractTerm):
    """The altimeter reads heights in the wrong scale, so dives turn too early or too late."""

    gain: Scalar = parameter(
        Normal(0.0, 0.03), unit="1", text="indicated over true height, minus one",
        source="3 % for sound speeds of 1440 to 1540 m/s", shown="%", shown_per_si=1e2,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="sensor.altimeter_gain",
        title="Scale of the altimeter",
        channels=_TURN,
        equation=r"\Delta z = g\,h\,[d=-1]",
        reads=("height_above_bottom", "direction"),
        valid="turns on altitude",
        reference="fixed sound speed of 1500 m/s in the firmware",
        plain="The altimeter is a little off, so turns above the seafloor are too low or too high.",
        confusable_with=("seafloor.bathymetry_bias",),
        decided_by="the speed of sound from the CTD",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Depth, m."""
        return self.gain * sample.height_above_bottom * 0.5 * sample.direction * (sample.direction - 1.0)


class SurfaceInterval(AbstractTerm):
    """Surfacings last longer, or less long, than planned."""

    time: Scalar = parameter(
        Normal(0.0, 300.0), unit="s", text="time beyond the plan", source="8 to 30 minutes flown",
        shown="min", shown_per_si=1.0 / 60.0,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="mission.surface_interval",
        title="Time at the surface",
        channels=(Channel.SURFACE_INTERVAL,),
        equation=r"\Delta t = t_1",
        reads=(),
        valid="any",
        reference="calls and file transfers at 0.1 KB/s nominal",
        plain="The glider stays up longer than planned, to call and to send files.",
        confusable_with=("energy.surface_load", "navigation.surface_windage"),
        decided_by="the times at which depth left and reached zero",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Time, s."""
        return self.time


TERMS: tuple[type[AbstractTerm], ...] = (
    BathymetryBias,
    WaterLevel,
    Overshoot,
    TurnOffset,
    AltimeterGain,
    SurfaceInterval,
)
