"""What the flow around the glider does beyond the base model: drag and lift.

Imports :mod:`glider_jax.physics.term` only. Drag and lift act alike on dives and climbs. Shares refer to the base
model's coefficients, which the sample carries.
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
)

_MERCKELBACH = "Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1"


class DragGrowth(AbstractTerm):
    """Parasite drag grows steadily."""

    rate: Scalar = parameter(
        Normal(0.0, 0.05 / 86400.0),
        support=NEVER_NEGATIVE,
        unit="s-1",
        text="share of the parasite drag gained in time at sea",
        source="0.7 % a day on comet in a North Sea summer; weed and barnacles faster: judgement",
        shown="1/day",
        shown_per_si=PER_DAY,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.drag_growth",
        title="Growing drag",
        channels=(Channel.DRAG_COEFFICIENT,),
        equation=r"\Delta C_D = C_{D0}\,k\,t",
        reads=("parasite_drag", "elapsed"),
        valid="weeks",
        reference="Anderlini et al. 2021; Schultz et al. 2015, biofouling",
        plain="Growth on the hull makes the glider slower every day for the same push, up and down alike.",
        confusable_with=("flight.pitch_drift",),
        decided_by="fin effort, current estimates that lean along the heading, or a photo at recovery",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient."""
        return sample.parasite_drag * self.rate * sample.elapsed


class DragBias(AbstractTerm):
    """Parasite drag is not the calibrated one."""

    share: Scalar = parameter(
        Normal(0.0, 0.25),
        support=(-0.7, 3.0),
        unit="1",
        text="parasite drag beyond the base model, as a share of it",
        source="calibrated 0.15 to 0.21; sensors outside the hull add 20 to 50 %",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.drag_bias",
        title="Parasite drag",
        channels=(Channel.DRAG_COEFFICIENT,),
        equation=r"\Delta C_D = C_{D0}\,k",
        reads=("parasite_drag",),
        valid="0.1 to 0.6 m/s",
        reference=_MERCKELBACH,
        plain="The glider drags more or less than calibrated: all glides are slower or faster, always.",
        confusable_with=(
            "flight.pitch_gain",
            "flight.oil_gain",
            "sensor.pressure_gain",
            "flight.induced_drag_bias",
        ),
        decided_by="a measured speed through the water, dives at two pitch angles, the pump on the bench",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient."""
        return sample.parasite_drag * self.share


class InducedDragBias(AbstractTerm):
    """Drag at an angle of attack is not the calibrated one."""

    share: Scalar = parameter(
        Normal(0.0, 0.25),
        support=(-0.9, 4.0),
        unit="1",
        text="induced drag beyond the base model, as a share of it",
        source="3 to 11.5 per squared radian across published models",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.induced_drag_bias",
        title="Induced drag",
        channels=(Channel.INDUCED_DRAG,),
        equation=r"\Delta C_{D1} = C_{D1}\,k",
        reads=("induced_drag",),
        valid="angle of attack below 0.17 rad",
        reference=_MERCKELBACH,
        plain="Shallow glides are slower than the model says, steep ones right.",
        confusable_with=("flight.drag_bias",),
        decided_by="dives at several pitch angles",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient per squared radian."""
        return sample.induced_drag * self.share


class LiftLoss(AbstractTerm):
    """The wings lift less than calibrated."""

    loss: Scalar = parameter(
        Normal(0.0, 0.2),
        support=(-0.6, 0.9),
        looks=(0.3, 0.4),
        unit="1",
        text="lift slope lost, as a share of the base model's",
        source="judgement: hull part 2.4 to 3.8 across calibrations",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.lift_loss",
        title="Loss of lift",
        channels=(Channel.LIFT_SLOPE,),
        equation=r"\Delta a = -a\,k",
        reads=("lift_slope",),
        valid="angle of attack below 0.17 rad",
        reference=_MERCKELBACH,
        plain="The wings lift less: the glider sinks and climbs as before but gets less far.",
        confusable_with=("navigation.speed_bias", "navigation.attack_neglected"),
        decided_by="a measured speed through the water, or legs on several headings",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Lift coefficient per radian."""
        return -sample.lift_slope * self.loss


class WingLoss(AbstractTerm):
    """A wing breaks off: lift and a little weight are gone."""

    loss: Scalar = parameter(
        Normal(0.0, 0.25),
        support=(0.0, 0.9),
        unit="1",
        text="lift slope lost, as a share of the base model's",
        source="half of the wings' part, about a quarter of all lift",
        shown="%",
        shown_per_si=1e2,
    )
    mass: Scalar = parameter(
        Normal(0.0, 0.05),
        support=NEVER_NEGATIVE,
        unit="kg",
        text="weight in water of what was lost",
        source="judgement",
        shown="g",
        shown_per_si=1e3,
    )
    onset: Scalar = parameter(
        LogNormal(2.0 * 86400.0, 2.0),
        unit="s",
        text="when it happened, after the deployment began",
        source="judgement",
        role="shape",
        shown="day",
        shown_per_si=1.0 / PER_DAY,
    )
    duration: Scalar = constant(600.0, unit="s", text="time scale of the step", source="numerical, short")
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.wing_loss",
        title="Loss of a wing",
        channels=(Channel.LIFT_SLOPE, Channel.NET_BUOYANCY),
        equation=r"\Delta a = -a\,k\,H(t-t_1),\quad F = g\,m\,H(t-t_1)",
        reads=("lift_slope", "elapsed", "gravity"),
        valid="weeks",
        reference="Anderlini et al. 2021, wing loss: positive buoyancy and roll towards the lost wing",
        plain="Since some time the glider is lighter, rolls and gets less far: a wing may be gone.",
        confusable_with=("flight.water_ingress", "flight.lift_loss"),
        decided_by="the roll",
    )

    def __call__(self, sample: Sample) -> tuple[Scalar, Scalar]:
        """Lift coefficient per radian, and force in N."""
        after = jax.nn.sigmoid((sample.elapsed - self.onset) / self.duration)
        return -sample.lift_slope * self.loss * after, sample.gravity * self.mass * after


class DragAsymmetry(AbstractTerm):
    """Climbs and dives drag differently."""

    share: Scalar = parameter(
        Normal(0.0, 0.15),
        support=(-0.9, 0.9),
        unit="1",
        text="share of the parasite drag gained on climbs and lost on dives",
        source="judgement: 10 to 20 % with sensors on top of the hull",
        shown="%",
        shown_per_si=1e2,
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.drag_asymmetry",
        title="Drag of climbs and dives",
        channels=(Channel.DRAG_COEFFICIENT,),
        equation=r"\Delta C_D = C_{D0}\,k\,d",
        reads=("parasite_drag", "direction"),
        valid="any",
        reference="sensors on the upper hull; size: judgement",
        plain="Climbs are slower and dives faster than the model, or the other way round, through drag.",
        confusable_with=("flight.ballast_offset", "flight.oil_offset", "flight.pitch_offset"),
        decided_by="dives with other pumped volumes and pitches",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Drag coefficient."""
        return sample.parasite_drag * self.share * sample.direction


class ReynoldsDrag(AbstractTerm):
    """Slow glides drag more than fast ones."""

    exponent: Scalar = parameter(
        Normal(0.0, 0.1),
        support=(0.0, 1.0),
        unit="1",
        text="power of speed by which the drag coefficient falls",
        source="0.2 of a turbulent plate, 0.25 of Seaglider, 0 of Slocum hulls",
    )
    reference_speed: Scalar = constant(
        0.35, unit="m s-1", text="speed of the calibration", source="usual glide"
    )
    slowest_speed: Scalar = constant(
        0.05, unit="m s-1", text="speed below which it grows no more", source="keeps a stopped glider finite"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.reynolds_drag",
        title="Reynolds-number drag",
        channels=(Channel.LOG_DRAG,),
        equation=r"\ln f = -\tfrac{n}{2}\ln\frac{U^2+U_s^2}{U_r^2}",
        reads=("speed_through_water",),
        valid="0.1 to 0.6 m/s",
        reference="Eriksen et al. 2001, doi:10.1109/48.972073: drag grows as a power of dynamic pressure",
        plain="The slower the glider, the larger its drag coefficient.",
        confusable_with=("flight.drag_bias", "flight.oil_gain"),
        decided_by="dives at two or more pumped volumes",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor on the drag."""
        squared = sample.speed_through_water**2 + self.slowest_speed**2
        return -0.5 * self.exponent * jnp.log(squared / self.reference_speed**2)


class RollDrag(AbstractTerm):
    """A rolled glider drags more."""

    coefficient: Scalar = parameter(
        Normal(0.0, 1.0),
        support=NEVER_NEGATIVE,
        unit="rad-2",
        text="share of drag gained per squared roll",
        source="judgement: 3 % at 10 degrees",
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.roll_drag",
        title="Drag of roll",
        channels=(Channel.LOG_DRAG,),
        equation=r"\ln f = k\,\phi^2",
        reads=("roll",),
        valid="roll below 0.4 rad",
        reference="static roll 4 to 10 degrees on comet; size: judgement",
        plain="A glider that hangs to one side is slower.",
        confusable_with=("flight.drag_bias",),
        decided_by="roll that changes during the mission",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor on the drag."""
        return self.coefficient * sample.roll**2


class TurnDrag(AbstractTerm):
    """A turning glider slips sideways and drags more."""

    time: Scalar = parameter(
        Normal(0.0, 5.0),
        support=NEVER_NEGATIVE,
        unit="s rad-1",
        text="side-slip drag: share of drag gained per rate of turn",
        source="judgement: turns cost 2 to 5 %",
    )
    softness: Scalar = constant(
        0.002, unit="rad s-1", text="rate below which the law is rounded off", source="numerical"
    )
    info: ClassVar[TermInfo] = TermInfo(
        id="flight.turn_drag",
        title="Drag of turns",
        channels=(Channel.LOG_DRAG,),
        equation=r"\ln f = k(\sqrt{r^2+r_s^2}-r_s)",
        reads=("turn_rate",),
        valid="below 0.1 rad/s",
        reference="side-slip in turns; size: judgement",
        plain="The glider slows down while it turns.",
        confusable_with=("flight.roll_drag",),
        decided_by="waypoint turns against straight legs",
    )

    def __call__(self, sample: Sample) -> Scalar:
        """Logarithm of a factor on the drag."""
        return self.time * (jnp.sqrt(sample.turn_rate**2 + self.softness**2) - self.softness)


TERMS: tuple[type[AbstractTerm], ...] = (
    DragGrowth,
    DragBias,
    InducedDragBias,
    LiftLoss,
    WingLoss,
    DragAsymmetry,
    ReynoldsDrag,
    RollDrag,
    TurnDrag,
)
