"""What draws power steadily beyond the base model: hotel, surface, communication, servos and leaks.

Imports :mod:`glider_jax.physics.term` only. ``direction`` selects the phase by polynomials that are exact at -1, 0
and +1: ``d(d-1)/2`` is 1 on dives alone.
"""

from __future__ import annotations

from typing import ClassVar

import jax

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
)

_HOTEL = (Channel.HOTEL_POWER,)


class DiveOnlyLoad(AbstractTerm):
    """Something draws power on dives alone."""

    power: Scalar = parameter(
        Normal(0.0, 0.5),
        support=NEVER_NEGATIVE,
        unit="W",
        text="power drawn on dives",
        source="0.1 A at 14 V between phases on comet",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.dive_only_load",
        title="Load on dives",
        channels=_HOTEL,
        equation=r"\Delta P = P_d\,[d=-1]",
        reads=("direction",),
        valid="any",
        reference="sensors sampled on dives alone",
        plain="Something is switched on while diving and off while climbing.",
        confusable_with=("energy.hotel_bias", "energy.altimeter_load"),
        decided_by="the sampling settings of the mission",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power * 0.5 * sample.direction * (sample.direction - 1.0)


class ClimbOnlyLoad(AbstractTerm):
    """Something draws power on climbs alone."""

    power: Scalar = parameter(
        Normal(0.0, 0.5),
        unit="W",
        text="power drawn on climbs",
        source="as for dives: judgement",
        support=NEVER_NEGATIVE,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.climb_only_load",
        title="Load on climbs",
        channels=_HOTEL,
        equation=r"\Delta P = P_c\,[d=+1]",
        reads=("direction",),
        valid="any",
        reference="sensors sampled on climbs alone",
        plain="Something is switched on while climbing and off while diving.",
        confusable_with=("energy.hotel_bias",),
        decided_by="the sampling settings of the mission",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power * 0.5 * sample.direction * (sample.direction + 1.0)


class HotelBias(AbstractTerm):
    """The steady load is not the calibrated one."""

    power: Scalar = parameter(
        Normal(0.0, 0.4),
        unit="W",
        text="power beyond the base model, all the time",
        source="1.4 to 4.9 W on comet",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.hotel_bias",
        title="Hotel load",
        channels=_HOTEL,
        equation=r"\Delta P = P_1",
        reads=(),
        valid="any",
        reference="current in quiet phases",
        plain="Something draws a steady load that nobody listed.",
        confusable_with=(
            "sensor.current_offset",
            "sensor.coulomb_gain",
            "energy.fin_activity",
            "energy.leak_drain",
        ),
        decided_by="the board's current with everything off; other loads recorded apart",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power


class HotelGrowth(AbstractTerm):
    """The steady load creeps up."""

    rate: Scalar = parameter(
        Normal(0.0, 0.1 / 86400.0), unit="W s-1", text="power gained in time",
        support=NEVER_NEGATIVE,
        source="creeping drains of 0.05 to 0.3 W", shown="W/day", shown_per_si=PER_DAY,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.hotel_growth",
        title="Growing hotel load",
        channels=_HOTEL,
        equation=r"\Delta P = k\,t",
        reads=("elapsed",),
        valid="weeks",
        reference="judgement",
        plain="The steady load grows from day to day: a leak current, or a device that degrades.",
        confusable_with=("energy.leak_drain", "energy.fin_activity"),
        decided_by="the voltage: a resistive leak follows its square",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.rate * sample.elapsed


class LeakDrain(AbstractTerm):
    """A resistive leak that widens with time."""

    rate: Scalar = parameter(
        Normal(0.0, 0.0005 / 86400.0), unit="S s-1", text="leak conductance gained in time",
        support=NEVER_NEGATIVE,
        source="0.1 W a day at 14 V: judgement", shown="mS/day", shown_per_si=1e3 * PER_DAY,
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.leak_drain",
        title="Leak current",
        channels=_HOTEL,
        equation=r"\Delta P = k\,t\,V^2",
        reads=("elapsed", "voltage"),
        valid="weeks",
        reference="Ohm's law; size: judgement",
        plain="Salt water or a bad connector drains the battery a little more every day.",
        confusable_with=("energy.hotel_growth",),
        decided_by="the voltage over a long mission",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.rate * sample.elapsed * sample.voltage**2


class FinActivity(AbstractTerm):
    """The rudder's servo draws power when it works."""

    energy: Scalar = parameter(
        Normal(0.0, 5.0), unit="J rad-1", text="energy per angle moved",
        support=NEVER_NEGATIVE,
        source="not resolvable on comet, below 0.15 W",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.fin_activity",
        title="Fin servo",
        channels=_HOTEL,
        equation=r"\Delta P = k\,|\dot\delta|",
        reads=("fin_rate",),
        valid="mean over minutes",
        reference="paired differences of current on comet",
        plain="Steering hard, in waves or with growth on the hull, costs power.",
        confusable_with=("energy.hotel_bias", "energy.hotel_growth"),
        decided_by="paired differences of the current with the fin moving and still",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.energy * sample.fin_rate


class AltimeterLoad(AbstractTerm):
    """The altimeter draws power on dives near the seafloor."""

    power: Scalar = parameter(
        Normal(0.0, 0.7),
        unit="W",
        text="power while it pings",
        source="0.04 to 0.1 A on comet, with doubt",
        support=NEVER_NEGATIVE,
    )
    reach: Scalar = parameter(
        LogNormal(50.0, 1.5),
        unit="m",
        text="height below which it pings",
        source="range 2 to 100 m",
        role="shape",
    )
    width: Scalar = constant(3.0, unit="m", text="height over which it sets in", source="numerical")
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.altimeter_load",
        title="Altimeter",
        channels=_HOTEL,
        equation=r"\Delta P = P_a\,[d=-1]\,[1+e^{(h-h_a)/l}]^{-1}",
        reads=("direction", "height_above_bottom"),
        valid="shelf water",
        reference="reduced-usage mode of the Slocum altimeter",
        plain="Near the seafloor the altimeter is on and draws power.",
        confusable_with=("energy.dive_only_load",),
        decided_by="the altimeter's status",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        near = jax.nn.sigmoid((self.reach - sample.height_above_bottom) / self.width)
        return self.power * near * 0.5 * sample.direction * (sample.direction - 1.0)


class SurfaceLoad(AbstractTerm):
    """Something draws more while surfaced."""

    power: Scalar = parameter(
        Normal(0.0, 1.0), unit="W", text="power beyond the base model while surfaced",
        source="0.1 to 0.3 A between surface states on comet",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.surface_load",
        title="Surface load",
        channels=(Channel.SURFACE_POWER,),
        equation=r"\Delta P = P_s",
        reads=(),
        valid="at the surface",
        reference="current in surface phases",
        plain="Being at the surface costs more power than calibrated.",
        confusable_with=("energy.iridium_call", "energy.air_pump"),
        decided_by="surfacings of different length, and call records",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Power, W."""
        return self.power


class IridiumCall(AbstractTerm):
    """The satellite telephone draws more once its call begins."""

    power: Scalar = parameter(
        Normal(0.0, 2.0), unit="W", text="power on call beyond the base model",
        source="5.6 to 8.3 W on call against 3.2 W idle on comet",
    )  # fmt: skip
    registration: Scalar = parameter(
        LogNormal(180.0, 1.7),
        unit="s",
        text="time at the surface before the call",
        source="judgement",
        role="shape",
    )
    softness: Scalar = constant(30.0, unit="s", text="time over which calls begin", source="numerical")
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.iridium_call",
        title="Iridium calls",
        channels=(Channel.SURFACING_ENERGY,),
        equation=r"\Delta E = P_i\,l\ln[1+e^{(t_s-t_r)/l}]",
        reads=("surface_duration",),
        valid="surfacings of 3 to 40 minutes",
        reference="currents of comet while registering and on call",
        plain="Long calls home cost more than calibrated.",
        confusable_with=("energy.surface_load", "energy.air_pump"),
        decided_by="call records, or surfacings of different length",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        late = (sample.surface_duration - self.registration) / self.softness
        return self.power * self.softness * jax.nn.softplus(late)


class AirPump(AbstractTerm):
    """Filling the air bladder costs energy once per surfacing."""

    energy: Scalar = parameter(
        Normal(0.0, 200.0), unit="J", text="energy per surfacing beyond the base model",
        source="about 0.2 kJ per surfacing on comet",
    )  # fmt: skip
    info: ClassVar[TermInfo] = TermInfo(
        id="energy.air_pump",
        title="Air pump",
        channels=(Channel.SURFACING_ENERGY,),
        equation=r"\Delta E = E_a",
        reads=(),
        valid="any surfacing",
        reference="150 to 200 s of air pump per surfacing on comet",
        plain="Each surfacing has a fixed price: the air pump that lifts the antenna.",
        confusable_with=("energy.iridium_call", "energy.surface_load"),
        decided_by="surfacings of different length",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Energy, J."""
        return self.energy


TERMS: tuple[type[AbstractTerm], ...] = (
    DiveOnlyLoad,
    ClimbOnlyLoad,
    HotelBias,
    HotelGrowth,
    LeakDrain,
    FinActivity,
    AltimeterLoad,
    SurfaceLoad,
    IridiumCall,
    AirPump,
)
