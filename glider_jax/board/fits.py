"""Energy models from events: robust, weighted least squares with full covariance; NumPy only.

Pump strokes from dive to climb follow ``E = a + b z`` or ``E = dV (a + b z)``; the form with the smaller
held-out error is
taken and both are reported. Errors shared by all events (gain of the sensor, voltage) are added to the
covariance after
the fit, since no number of events averages them out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.events import AT_SURFACE, CLIMB_TO_DIVE, DIVE_TO_CLIMB, Event
from glider_jax.board.robust import LineFit, normal_quantile, robust_fit, t_quantile
from glider_jax.board.steady import Level
from glider_jax.errors import FitError

INTERCEPT = "energy.pump_dive_to_climb.intercept"
SLOPE = "energy.pump_dive_to_climb.slope"
CLIMB = "energy.pump_climb_to_dive"
BRAKE = "energy.brake"
HOTEL = "energy.hotel"
SURFACE = "energy.surface"
UNITS = {INTERCEPT: "J", SLOPE: "J m-1", CLIMB: "J", BRAKE: "J", HOTEL: "W", SURFACE: "W"}
# Ideal work per metre is rho g dV; pumps take about twice that (judgement, 40 %).
_IDEAL, _EFFICIENCY, _EFFICIENCY_SD = 1025.0 * 9.81, 0.5, 0.4


@dataclass(frozen=True)
class Gains:
    """Errors shared by all events of a kind, relative 1-sigma, and the zero error of the steady load, W.

    ``common`` is shared by everything (voltage, a coulomb counter's factor); the others belong to one
    sensor each.
    """

    common: float = 0.02
    pump: float = 0.0
    brake: float = 0.0
    main: float = 0.0
    main_zero: float = 0.0
    source: str = "judgement: coulomb counter 2 %, voltage 0.5 %"


def board_gains(main_zero: float, bench: float | None = None) -> Gains:
    """Shared errors of a board: data-sheet gain 1.5 % per sensor, halved in variance where two share the
    pump.

    Parameters
    ----------
    main_zero : W, from ``motors.board_levels``.
    bench : relative 1-sigma of the gains after a bench calibration, if one was made.
    """
    gain = 0.015 if bench is None else bench
    text = (
        "Hall sensor data sheets, 1.5 % gain"
        if bench is None
        else f"bench calibration, {100 * bench:.2g} % gain"
    )
    return Gains(0.003, gain / 2.0**0.5, gain, gain, main_zero, f"{text}; voltage 0.3 % (judgement)")


@dataclass(frozen=True)
class PumpFit:
    """One form of the dive-to-climb energy.

    ``form`` is ``line`` or ``volume``; ``theta`` J and J m-1 at ``reference_volume`` (m3), ``covariance``
    (2, 2) of the
    random part; ``held_out`` rms error of predicting single strokes from the others, J; ``depths`` (least,
    largest) m.
    """

    form: str
    theta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    reference_volume: float
    held_out: float
    scatter: float
    dof: float
    count: int
    outliers: int
    depths: tuple[float, float]
    chi2: float
    autocorrelation: float
    trend: float
    identifiable: bool
    fit: LineFit
    used: tuple[Event, ...]

    def predict(self, depth: NDArray[np.float64], volume: float | None = None) -> NDArray[np.float64]:
        """Mean energy of a stroke at each depth, J; of ``volume`` m3, else of the reference volume."""
        share = 1.0 if volume is None or self.reference_volume <= 0 else volume / self.reference_volume
        return share * (self.theta[0] + self.theta[1] * np.asarray(depth, dtype=np.float64))

    def interval(
        self, depth: NDArray[np.float64], level: float = 0.95, single: bool = False
    ) -> NDArray[np.float64]:
        """Half width of the interval for the mean energy, or for a ``single`` stroke, J, before shared
        errors."""
        z = np.asarray(depth, dtype=np.float64)
        design = np.stack([np.ones_like(z), z], axis=-1)
        variance = np.einsum("...i,ij,...j->...", design, self.covariance, design)
        if single:
            variance = variance + self.scatter**2
        return t_quantile(0.5 + level / 2, self.dof) * np.sqrt(variance)


@dataclass(frozen=True)
class Estimate:
    """A quantity with its random and shared 1-sigma, the scatter of single events and how many there were."""

    value: float
    random: float
    shared: float
    dof: float
    count: int
    scatter: float = 0.0
    source: str = ""

    @property
    def sigma(self) -> float:
        """Total 1-sigma."""
        return float(np.hypot(self.random, self.shared))

    def interval(self, level: float = 0.95) -> float:
        """Half width of the interval at ``level``: Student's t for the random part, normal for the shared
        one."""
        p = 0.5 + level / 2
        return float(np.hypot(t_quantile(p, self.dof) * self.random, normal_quantile(p) * self.shared))


@dataclass(frozen=True)
class EnergyModel:
    """All that the forecaster takes from the measurements.

    ``covariance`` (quantity, quantity) in the order of ``names``, random and shared parts together.
    """

    name: str
    estimates: dict[str, Estimate]
    names: tuple[str, ...]
    covariance: NDArray[np.float64]
    pump: PumpFit | None
    other: PumpFit | None
    levels: tuple[Level, ...] = ()
    warnings: tuple[str, ...] = ()
    gains: Gains = field(default_factory=Gains)
    brake_included: bool = False

    def intervals(self, level: float = 0.95, simultaneous: bool = True) -> dict[str, float]:
        """Half width of the interval of each quantity.

        Parameters
        ----------
        level : coverage of each, or with ``simultaneous`` of all together (Bonferroni).
        """
        share = (1.0 - level) / len(self.names) if simultaneous else 1.0 - level
        return {name: self.estimates[name].interval(1.0 - share) for name in self.names}

    def distance(self, truth: dict[str, float]) -> float:
        """Squared Mahalanobis distance of a true model from this one, over the quantities that both name."""
        rows = [i for i, name in enumerate(self.names) if name in truth]
        error = np.array([self.estimates[self.names[i]].value - truth[self.names[i]] for i in rows])
        return float(error @ np.linalg.solve(self.covariance[np.ix_(rows, rows)], error))


def _arrays(events: Sequence[Event]) -> tuple[NDArray[np.float64], ...]:
    table = np.array([(e.depth, e.volume, e.energy, e.energy_sd, e.time) for e in events], dtype=np.float64)
    table = table.reshape(-1, 5)
    return tuple(table.T)


def _held_out(fit: LineFit, rows: slice) -> float:
    """Root mean square of leave-one-out errors; one beyond four robust scales counts as four."""
    error = np.abs(fit.held_out()[rows])
    limit = 4.0 * 1.4826 * float(np.median(error)) if error.size else 0.0
    return float(np.sqrt(np.mean(np.minimum(error, max(limit, 1e-9)) ** 2)))


def fit_pump(events: Sequence[Event], form: str, extra: Sequence[Event] = ()) -> PumpFit:
    """Fit one form to dive-to-climb strokes.

    Parameters
    ----------
    events : strokes with a depth; for ``volume`` also with a volume.
    form : ``line`` or ``volume``.
    extra : strokes at the surface, used by ``volume`` only.

    Raises
    ------
    FitError : fewer than three usable strokes.
    """
    kept = [e for e in events if e.complete and np.isfinite([e.depth, e.energy, e.energy_sd]).all()]
    more: list[Event] = []
    if form == "volume":
        kept = [e for e in kept if np.isfinite(e.volume) and e.volume > 0]
        more = [e for e in extra if e.complete and np.isfinite([e.depth, e.energy, e.volume]).all()]
    if len(kept) < 3:
        raise FitError(
            f"pump energy: expected at least 3 complete strokes from dive to climb, found {len(kept)}. "
            "Use a longer recording."
        )
    used = [*kept, *more]
    depth, volume, energy, sd, time = _arrays(used)
    sd = np.maximum(sd, 1e-3 * np.abs(energy) + 1e-6)
    known = np.isfinite(volume[: len(kept)])
    reference = float(volume[: len(kept)][known].mean()) if known.any() else 0.0
    design = np.stack([np.ones_like(depth), depth], axis=1)
    if form == "volume":
        design = design * (volume / reference)[:, None]
    fit = robust_fit(design, energy, sd)
    own = slice(0, len(kept))
    order = np.argsort(time[own])
    residual = (fit.residual[own] * (fit.weight[own] > 0))[order]
    power = float((residual**2).sum())
    autocorrelation = float((residual[1:] * residual[:-1]).sum() / power) if power > 0 else 0.0
    days = (time[own] - time[own].mean())[order] / 86_400.0
    trend = float((days * residual).sum() / max(float((days**2).sum()), 1e-12))
    spread = float(np.ptp(depth))
    slope, slope_sd = fit.theta[1], fit.sigma()[1]
    identifiable = bool(spread > 2.0 and t_quantile(0.975, fit.dof) * slope_sd < abs(slope))
    return PumpFit(
        form=form,
        theta=fit.theta,
        covariance=fit.covariance,
        reference_volume=reference,
        held_out=_held_out(fit, own),
        scatter=fit.scatter,
        dof=fit.dof,
        count=len(used),
        outliers=int(np.count_nonzero(fit.weight < 0.1)),
        depths=(float(depth.min()), float(depth.max())),
        chi2=fit.chi2 / fit.dof,
        autocorrelation=autocorrelation,
        trend=trend,
        identifiable=identifiable,
        fit=fit,
        used=tuple(used),
    )


def fit_mean(events: Sequence[Event], what: str) -> tuple[Estimate, LineFit]:
    """Robust mean of the energies of events."""
    kept = [e for e in events if e.complete and np.isfinite([e.energy, e.energy_sd]).all()]
    if len(kept) < 3:
        raise FitError(
            f"{what}: expected at least 3 complete events, found {len(kept)}. Use a longer recording."
        )
    _, _, energy, sd, _ = _arrays(kept)
    fit = robust_fit(np.ones((energy.size, 1)), energy, np.maximum(sd, 1e-6))
    estimate = Estimate(
        float(fit.theta[0]),
        float(fit.sigma()[0]),
        0.0,
        fit.dof,
        energy.size,
        fit.scatter,
        f"{energy.size} {what}",
    )
    return estimate, fit


def _with_prior(pump: PumpFit) -> PumpFit:
    """Tie a slope that the depths cannot tell to the ideal work of the volume moved."""
    ideal = _IDEAL * (pump.reference_volume or 460e-6) / _EFFICIENCY
    weight = np.linalg.pinv(pump.covariance)
    prior = np.diag([0.0, (_EFFICIENCY_SD * ideal) ** -2.0])
    covariance = np.linalg.inv(weight + prior)
    theta = covariance @ (weight @ pump.theta + prior @ np.array([0.0, ideal]))
    return PumpFit(**{**pump.__dict__, "theta": theta, "covariance": covariance})


def brake_per_inflection(events: Sequence[Event]) -> list[Event]:
    """Join unlocking and locking of each inflection; one of the two alone is left out."""
    by_group: dict[int, list[Event]] = {}
    for event in events:
        if event.kind in ("brake_unlock", "brake_lock") and event.group >= 0:
            by_group.setdefault(event.group, []).append(event)
    out = []
    for parts in by_group.values():
        if {part.kind for part in parts} != {"brake_unlock", "brake_lock"}:
            continue
        first = min(parts, key=lambda part: part.time)
        out.append(
            Event(
                **{
                    **first.__dict__,
                    "energy": sum(part.energy for part in parts),
                    "charge": sum(part.charge for part in parts),
                    "energy_sd": float(np.sqrt(sum(part.energy_sd**2 for part in parts))),
                    "complete": all(part.complete for part in parts),
                }
            )
        )
    return out


def fit_energy(
    events: Sequence[Event],
    levels: Sequence[Level],
    name: str,
    gains: Gains | None = None,
    brake_separate: bool = False,
) -> EnergyModel:
    """Fit all that the events and the steady load can tell.

    Parameters
    ----------
    events : of one vehicle, from one or several recordings.
    levels : steady load, from ``steady.steady_levels`` or the board's main channel.
    name : of the recordings, for provenance.
    gains : shared errors.
    brake_separate : whether the events tell the brake from the pump; without it the pump's energies
        contain the brake
        and the brake's own is 0.

    Raises
    ------
    FitError : too few strokes.
    """
    gains = gains or Gains()
    warnings: list[str] = []
    pumps = [e for e in events if e.kind == "pump"]
    turning = [e for e in pumps if e.direction == DIVE_TO_CLIMB]
    surface = [e for e in pumps if e.direction == AT_SURFACE]
    pump, other = _choose(turning, surface, warnings)
    found: dict[str, Estimate] = {}
    relative: dict[str, float] = {}

    def enter(key: str, estimate: Estimate, own: float, zero: float = 0.0) -> None:
        shared = float(np.hypot(np.hypot(own, gains.common) * abs(estimate.value), zero))
        found[key] = Estimate(**{**estimate.__dict__, "shared": shared})
        relative[key] = own

    text = (
        f"{pump.count} pump strokes between {pump.depths[0]:.0f} and {pump.depths[1]:.0f} m, form {pump.form}"
    )
    for index, key in enumerate((INTERCEPT, SLOPE)):
        sigma = float(pump.covariance[index, index] ** 0.5)
        enter(
            key,
            Estimate(float(pump.theta[index]), sigma, 0.0, pump.dof, pump.count, pump.scatter, text),
            gains.pump,
        )
    climbs = [e for e in pumps if e.direction == CLIMB_TO_DIVE]
    if len(climbs) >= 3:
        enter(CLIMB, fit_mean(climbs, "strokes from climb to dive")[0], gains.pump)
    else:
        warnings.append(f"climb to dive: {len(climbs)} strokes are too few for a mean; the default stays.")
    if brake_separate:
        joined = brake_per_inflection(events)
        if len(joined) >= 3:
            enter(BRAKE, fit_mean(joined, "inflections with both brake events")[0], gains.brake)
        else:
            warnings.append(
                f"brake: {len(joined)} complete inflections are too few for a mean; the default stays."
            )
    else:
        found[BRAKE] = Estimate(0.0, 0.0, 0.0, 1e9, 0, 0.0, "included in the pump's energies")
        relative[BRAKE] = 0.0
    by_phase = {level.phase: level for level in levels if not level.state}
    hotel = by_phase.get("submerged")
    if hotel is not None:
        text = f"mean of {hotel.seconds / 3600:.1f} h submerged and quiet, floor {hotel.floor:.2f} W"
        estimate = Estimate(hotel.mean, hotel.mean_sd, 0.0, 30.0, int(hotel.seconds / 300), 0.0, text)
        enter(HOTEL, estimate, gains.main, gains.main_zero)
        top = by_phase.get("surface")
        if top is not None:
            text = f"surface {top.mean:.2f} W less hotel, {top.seconds / 3600:.1f} h"
            sd = float(np.hypot(top.mean_sd, hotel.mean_sd))
            extra = Estimate(top.mean - hotel.mean, sd, 0.0, 10.0, int(top.seconds / 300), 0.0, text)
            # The zero of the sensor drops out of the difference.
            enter(SURFACE, extra, gains.main)
    names = tuple(key for key in found if found[key].sigma > 0)
    covariance = _covariance(names, found, relative, pump, gains)
    return EnergyModel(
        name, found, names, covariance, pump, other, tuple(levels), tuple(warnings), gains, not brake_separate
    )


def _choose(
    turning: list[Event], surface: list[Event], warnings: list[str]
) -> tuple[PumpFit, PumpFit | None]:
    line = fit_pump(turning, "line")
    volume = None
    if sum(bool(np.isfinite(e.volume) and e.volume > 0) for e in turning) >= 3:
        volume = fit_pump(turning, "volume", surface)
    best, other = line, volume
    if volume is not None and (volume.held_out < 0.99 * line.held_out or not line.identifiable):
        best, other = volume, line
    low, high = line.depths
    if not line.identifiable:
        sentence = f"all inflections from dive to climb lie between {low:.1f} and {high:.1f} m: "
        if best.identifiable:
            warnings.append(
                f"{sentence}their slope alone is not identifiable; with {len(surface)} strokes at the surface it is, "
                "but only if energy is proportional to the volume moved, which two depths cannot test."
            )
        else:
            warnings.append(
                f"{sentence}the slope is not identifiable. It is tied to twice the ideal work of the volume moved "
                f"within {100 * _EFFICIENCY_SD:.0f} %; do not use the model at other depths without a wider recording."
            )
            best = _with_prior(best)
    if abs(line.autocorrelation) > 2.5 / len(turning) ** 0.5:
        warnings.append(
            f"residuals of neighbouring strokes are correlated ({line.autocorrelation:+.2f}): something that changes "
            "slowly is not in the model, and the sigmas are too small."
        )
    return best, other


def _covariance(
    names: tuple[str, ...],
    found: dict[str, Estimate],
    relative: dict[str, float],
    pump: PumpFit,
    gains: Gains,
) -> NDArray[np.float64]:
    """Random covariance plus the shared errors: common gain, the gain of each sensor, the zero of the main
    one."""
    size = len(names)
    value = np.array([found[n].value for n in names])
    covariance = np.diag([found[n].random ** 2 for n in names])
    if INTERCEPT in names and SLOPE in names:
        i, j = names.index(INTERCEPT), names.index(SLOPE)
        covariance[i, j] = covariance[j, i] = pump.covariance[0, 1]
    if HOTEL in names and SURFACE in names:
        i, j = names.index(HOTEL), names.index(SURFACE)
        covariance[i, j] = covariance[j, i] = -(found[HOTEL].random ** 2)
    covariance += gains.common**2 * np.outer(value, value)
    for sensor in ((INTERCEPT, SLOPE, CLIMB), (BRAKE,), (HOTEL, SURFACE)):
        part = np.array([relative[n] * v if n in sensor else 0.0 for n, v in zip(names, value, strict=True)])
        covariance += np.outer(part, part)
    if HOTEL in names:
        covariance[names.index(HOTEL), names.index(HOTEL)] += gains.main_zero**2
    return covariance.reshape(size, size)
