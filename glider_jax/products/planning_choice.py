"""From a sweep to an answer: which settings no other beats, which to fly and how sure that is, and why none will do."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from glider_jax.config import Quantity
from glider_jax.errors import ConfigError, Outcome, did_you_mean
from glider_jax.products.planning import Case, Setting, apply_choices, common_interval, fly_settings
from glider_jax.records import Array

#: What a pilot may want most: (attribute, 1 for more, -1 for less, words).
GOALS = {
    "km": ("km", 1.0, "km over the ground"),
    "profiles": ("profiles", 1.0, "profiles"),
    "contacts": ("contacts", 1.0, "surfacings"),
    "days": ("days", -1.0, "days until the end"),
    "energy": ("wh", -1.0, "Wh drawn"),
}
_RESAMPLES = 500
_FEWEST = 5


@dataclass(frozen=True)
class Recommendation:
    """The setting to fly of one group, None if none reaches the confidence wanted.

    ``sure`` share of resampled ensembles in which it is chosen again; ``runner`` the next and ``margin`` the paired
    mean difference of the goal to it with its standard error. ``best`` is the likeliest setting in any case.
    """

    group: str
    setting: Setting | None
    best: Setting
    sure: float
    runner: Setting | None
    margin: tuple[float, float]


@dataclass(frozen=True)
class Sensitivity:
    """How energy (Wh) and the goal change per step of one parameter: mean and standard error of paired members."""

    name: str
    step: str
    energy: tuple[float, float]
    goal: tuple[float, float]


def pareto(settings: Sequence[Setting]) -> list[Setting]:
    """Settings that no other beats in km and profiles per day, energy per day and probability of success at once."""
    flown = [s for s in settings if not s.refused]
    values = np.array(
        [
            (np.median(s.rate("km")), np.median(s.rate("profiles")), -np.median(s.rate("wh")), s.probability)
            for s in flown
        ]
    )
    kept = []
    for k, own in enumerate(values):
        better = (values >= own - 1e-9).all(axis=1) & (values > own + 1e-9).any(axis=1)
        if not better.any():
            kept.append(flown[k])
    return kept


def goal_of(name: str) -> tuple[str, float, str]:
    """A goal by its name.

    Raises
    ------
    ConfigError : unknown.
    """
    if name not in GOALS:
        raise ConfigError(f"--goal: expected one of {', '.join(GOALS)}, found '{name}'.{did_you_mean(name, GOALS)}")
    return GOALS[name]


def recommend(
    settings: Sequence[Setting],
    *,
    goal: str = "km",
    confidence: float = 0.9,
    seed: int = 0,
    by: str | None = None,
) -> list[Recommendation]:
    """The best setting among those that succeed with the confidence wanted, one for each value of the choice ``by``.

    Of settings that are equal the one named first is taken.
    """
    attribute, sign, _ = goal_of(goal)
    flown = [s for s in settings if not s.refused]
    groups: dict[str, list[Setting]] = {}
    for setting in flown:
        groups.setdefault(str(setting.choices[by]) if by else "", []).append(setting)
    found = []
    for name, members in groups.items():
        values = sign * np.array([getattr(s, attribute) for s in members])
        success = np.array([s.success for s in members], float)
        order = _ranking(values.mean(axis=1), success.mean(axis=1), confidence)
        best = members[int(np.lexsort((values.mean(axis=1), success.mean(axis=1)))[-1])]
        if not order:
            found.append(Recommendation(name, None, best, math.nan, None, (math.nan, math.nan)))
            continue
        rng = np.random.default_rng([seed, len(members)])
        again = 0
        for _ in range(_RESAMPLES):
            rows = rng.integers(0, values.shape[1], values.shape[1])
            drawn = _ranking(values[:, rows].mean(axis=1), success[:, rows].mean(axis=1), confidence)
            again += bool(drawn) and drawn[0] == order[0]
        runner, margin = None, (math.nan, math.nan)
        if len(order) > 1:
            runner = members[order[1]]
            margin = _paired(sign * (values[order[0]] - values[order[1]]))
        found.append(Recommendation(name, members[order[0]], best, again / _RESAMPLES, runner, margin))
    return found


def _ranking(value: Array, probability: Array, confidence: float) -> list[int]:
    """Indices of the settings that reach the confidence, the best first."""
    good = np.flatnonzero(probability >= confidence - 1e-12)
    return [int(k) for k in good[np.argsort(-value[good], kind="stable")]]


def _paired(difference: Array) -> tuple[float, float]:
    spread = difference.std(ddof=1) if difference.size > 1 else math.nan
    return float(difference.mean()), float(spread / math.sqrt(difference.size))


def why_not(setting: Setting, case: Case) -> str:
    """In one sentence with its numbers, why a setting does not succeed."""
    story, n = setting.story, setting.success.size
    parts = []
    if story["battery_out"] > 0.0:
        parts.append(
            f"the battery is empty in {100 * story['battery_out']:.0f} % of members, after a median of "
            f"{story['battery_days']:.1f} of {case.days:g} days at {np.median(setting.rate('wh')):.0f} Wh a day"
        )
    low = setting.finished & ~setting.success
    if low.any():
        parts.append(f"{100 * low.mean():.0f} % finish below the reserve or too late (median {_left(setting)})")
    if not case.loop:
        lost = (setting.outcome == int(Outcome.FLYING)).mean()
        if lost > 0.0:
            against = -story["current_along"]
            current = f", the current on the first leg {against:+.2f} m/s against it" if math.isfinite(against) else ""
            parts.append(
                f"{100 * lost:.0f} % are still under way after {case.days:g} days, at the nearest "
                f"{story['closest_km']:.1f} km from the last waypoint (speed {story['speed']:.2f} m/s{current})"
            )
    else:
        ended = (setting.outcome == int(Outcome.ARRIVED)).mean()
        if ended > 0.0:
            parts.append(
                f"{100 * ended:.0f} % end earlier at a place that a rule of the program leads to, after a median of "
                f"{np.median(setting.days[setting.outcome == int(Outcome.ARRIVED)]):.1f} days"
            )
    covered = {
        int(Outcome.FLYING),
        int(Outcome.ARRIVED),
        int(Outcome.BATTERY_EMPTY),
        int(Outcome.BATTERY_ABORT),
    }
    for code in sorted(set(setting.outcome.tolist()) - covered):
        share = (setting.outcome == code).mean()
        parts.append(f"{100 * share:.0f} % {Outcome(code).sentence}")
    told = "; ".join(parts) if parts else f"{int(setting.success.sum())} of {n} members succeed"
    return told + "."


def _left(setting: Setting) -> str:
    return f"{100 * np.median(setting.left):.0f} % of the charge left after {np.median(setting.days):.1f} days"


def sensitivities(
    case: Case,
    choices: Mapping[str, float | str],
    *,
    goal: str = "km",
    progress: Callable[[int], None] | None = None,
) -> list[Sensitivity]:
    """Central differences with the same seeds, in order of their effect on energy.

    Members that finish in both flights are compared, so that no difference is taken across an early end.
    Decisions move by a tenth (pitch by two degrees), what is uncertain about the vehicle by its standard deviation.
    """
    attribute, _, _ = goal_of(goal)
    made = apply_choices(case, choices)
    interval = common_interval([made]) / 2.0
    steps, cases = [], []
    for name, step, low, high in _pairs(made):
        try:
            pair = low(), high()
        except ConfigError:
            # A step out of the allowed range has no central difference.
            continue
        steps.append((name, step))
        cases += [(one, choices) for one in pair]
    flown = fly_settings(cases, interval, progress)
    found = []
    for (name, step), below, above in zip(steps, flown[::2], flown[1::2], strict=True):
        # A member that one of the two flights ends early jumps; those that end alike change smoothly.
        alike = above.finished & below.finished
        kept = alike if alike.sum() >= _FEWEST else np.ones_like(alike)
        found.append(
            Sensitivity(
                name,
                step,
                _paired(0.5 * (above.wh - below.wh)[kept]),
                _paired(0.5 * (getattr(above, attribute) - getattr(below, attribute))[kept]),
            )
        )
    return sorted(found, key=lambda s: -abs(s.energy[0]))


def _pairs(case: Case):
    """(name, step in words, case below, case above), cases made when called."""
    yo = case.mission.yo
    volume = 1e6 * (yo.climb_volume or case.vehicle.value("flight.pump_volume"))
    timed = [r.seconds for r in case.mission.surface if r.kind in ("every", "after")]
    pitch = math.degrees(yo.dive_pitch)
    decisions = [("pitch", pitch, 2.0, "2 degrees"), ("dive_to", yo.dive_to, 0.1 * yo.dive_to, "10 %")]
    # A stroke cannot grow beyond the pump's, so its middle lies a twentieth below.
    decisions.append(("volume_cc", 0.95 * volume, 0.05 * volume, "5 %"))
    if timed:
        decisions.append(("surface_every_h", timed[0] / 3600.0, 0.1 * timed[0] / 3600.0, "10 %"))
    stay = case.mission.surface_stay / 60.0
    if stay > 0.0:
        decisions.append(("surface_stay_min", stay, 0.2 * stay, "20 %"))
    for name, value, step, words in decisions:
        yield (
            name.replace("_", " "),
            "+" + words,
            lambda name=name, x=value - step: apply_choices(case, {name: x}),
            lambda name=name, x=value + step: apply_choices(case, {name: x}),
        )
    for name in sorted(case.vehicle.quantities):
        quantity = case.vehicle.quantities[name]
        if quantity.sigma > 0.0 and name.startswith(("energy.", "flight.")) and name not in _TRIMMED:
            yield (
                name.split(".", 1)[1].replace("_", " ").replace(".", ", "),
                "+1 sigma",
                lambda name=name, q=quantity: _with_quantity(case, name, q, -1.0),
                lambda name=name, q=quantity: _with_quantity(case, name, q, 1.0),
            )
    for index, device in enumerate(case.vehicle.devices):
        if device.power.sigma > 0.0:
            yield (
                device.name.replace("_", " "),
                "+1 sigma",
                lambda k=index: _with_device(case, k, -1.0),
                lambda k=index: _with_device(case, k, 1.0),
            )


#: Without hydrography the water is the vehicle's trim, so these do not act.
_TRIMMED = ("flight.mass", "flight.volume")


def _with_quantity(case: Case, name: str, quantity: Quantity, sign: float) -> Case:
    changed = replace(quantity, value=quantity.value + sign * quantity.sigma)
    return replace(case, vehicle=replace(case.vehicle, quantities=case.vehicle.quantities | {name: changed}))


def _with_device(case: Case, index: int, sign: float) -> Case:
    devices = list(case.vehicle.devices)
    power = devices[index].power
    devices[index] = replace(devices[index], power=replace(power, value=max(power.value + sign * power.sigma, 0.0)))
    return replace(case, vehicle=replace(case.vehicle, devices=tuple(devices)))
