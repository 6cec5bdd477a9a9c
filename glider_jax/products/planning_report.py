"""A sweep as one job: fly every setting, choose, find what the choice hangs on, and put it on one page."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.config import Vehicle
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.products.atomic import write_text
from glider_jax.products.hindcast import plain_numbers
from glider_jax.products.job import Options, read_inputs
from glider_jax.products.planning import NUMBERS, Case, Setting, parse_choices, settings_of, sweep
from glider_jax.products.planning_choice import (
    GOALS,
    Recommendation,
    Sensitivity,
    goal_of,
    pareto,
    recommend,
    sensitivities,
    why_not,
)
from glider_jax.products.provenance import plain
from glider_jax.readers.device_catalogue import DEVICES

#: Steering, navigation and communication that a glider at sea has, and its stock science computer.
USUAL = ("science_computer_stock", "pitch_servo", "fin_servo", "altimeter", "gps", "iridium", "air_pump")
_SETTINGS_IN_PAGE = 24


@dataclass(frozen=True)
class PlanOptions:
    """What to weigh: the inputs of a forecast, the choices as ``name=value,value``, and what counts as success."""

    inputs: Options
    vary: tuple[str, ...]
    devices: tuple[str, ...] | None = None
    loop: bool = False
    by_days: float | None = None
    goal: str = "km"
    confidence: float = 0.9
    tornado: bool = True
    html: bool = False
    style: str = "screen"


@dataclass(frozen=True)
class PlanResult:
    """The page in Markdown, its numbers, and where everything lies."""

    page: str
    numbers: dict[str, Any]
    files: dict[str, Path] = field(default_factory=dict)
    settings: tuple[Setting, ...] = ()


def make_case(options: PlanOptions) -> Case:
    """Read what the sweep starts from.

    Raises
    ------
    GliderJaxError : a file is missing or wrong, or a device is unknown.
    """
    inputs = read_inputs(options.inputs)
    vehicle = with_devices(inputs.vehicle, options.devices)
    return Case(
        mission=inputs.mission, vehicle=vehicle, currents=inputs.currents, bathymetry=inputs.bathymetry,
        water=inputs.water, days=inputs.days, loop=options.loop, by_days=options.by_days,
        reserve=options.inputs.reserve, speed=options.inputs.speed, speed_kind=options.inputs.speed_kind,
        start=inputs.start, start_position=options.inputs.start_position, n=options.inputs.n,
        seed=options.inputs.seed, spread=options.inputs.spread,
    )  # fmt: skip


def with_devices(vehicle: Vehicle, names: Sequence[str] | None) -> Vehicle:
    """The vehicle with devices of the catalogue; None gives one that names none the usual ones and a CTD."""
    if names is None:
        names = () if vehicle.devices else (*USUAL, "ctd")
    have = {device.name for device in vehicle.devices}
    for name in names:
        if name not in DEVICES:
            known = ", ".join(DEVICES)
            raise ConfigError(f"--devices: expected names of {known}, found '{name}'.{did_you_mean(name, DEVICES)}")
    added = tuple(DEVICES[name] for name in dict.fromkeys(names) if name not in have)
    return replace(vehicle, devices=(*vehicle.devices, *added))


def run_plan(options: PlanOptions, out: Path | None, progress: Callable[[int], None] | None = None) -> PlanResult:
    """Weigh every combination and write ``plan.md``, ``plan.json``, ``pareto.png`` and ``tornado-*.png``."""
    goal_of(options.goal)
    if not 0.0 < options.confidence <= 1.0:
        raise ConfigError(f"--confidence: expected more than 0 and at most 1, found {options.confidence:g}.")
    choices = parse_choices(options.vary)
    case = make_case(options)
    settings = sweep(case, choices, progress)
    by = "battery" if len(choices.get("battery", ())) > 1 else None
    chosen = recommend(settings, goal=options.goal, confidence=options.confidence, seed=case.seed, by=by)
    hangs: dict[str, list[Sensitivity]] = {}
    if options.tornado:
        for one in chosen:
            hangs[one.group] = sensitivities(case, (one.setting or one.best).choices, goal=options.goal)
    page = plan_page(case, choices, settings, chosen, hangs, options)
    numbers = plan_numbers(case, settings, chosen, hangs, options)
    files: dict[str, Path] = {}
    if out is not None:
        files["page"] = write_text(out / "plan.md", page)
        files["json"] = write_text(out / "plan.json", json.dumps(numbers, indent=1, allow_nan=False) + "\n")
        from glider_jax.products.planning_figures import plot_pareto, plot_tornado

        files["pareto"] = plot_pareto(settings, chosen, out / "pareto.png", options.style)
        for one in chosen:
            if hangs.get(one.group):
                name = f"tornado-{one.group}" if one.group else "tornado"
                title = f"What the answer hangs on: {words(one.setting or one.best)}"
                files[name] = plot_tornado(hangs[one.group], options.goal, out / f"{name}.png", title, options.style)
        if options.html:
            files["html"] = _write_html(case, settings, chosen, hangs, options, out / "plan.html")
    return PlanResult(page, numbers, files, tuple(settings))


def _write_html(case: Case, settings, chosen, hangs, options: PlanOptions, path: Path) -> Path:
    from glider_jax.products.html.planning import write_plan

    told = {
        "subtitle": f"{len(settings)} settings, {case.n} members each, the same seeds for all · success is "
        f"{_goal_words(case)}",
        "answers": [" ".join(_answer(one, case, options)).replace("**", "") for one in chosen],
        "assumed": [line.removeprefix("- ") for line in _assumed(case)],
        "names": words,
        "made": {"seed": case.seed, "settings": plain(options.inputs) | {"vary": list(options.vary)}},
    }
    return write_plan(case, settings, chosen, hangs, told, path, goal=options.goal)


def count_settings(vary: Sequence[str]) -> int:
    """How many combinations a sweep has."""
    return sum(1 for _ in settings_of(parse_choices(vary)))


def words(setting: Setting) -> str:
    """A setting's choices in words."""
    parts = []
    for name, value in setting.choices.items():
        unit = NUMBERS.get(name, "").split(" ")[0]
        text = f"{value:g} {unit}".strip() if isinstance(value, float) else str(value)
        # Names that carry their unit leave it to the value.
        label = name.removesuffix(f"_{unit}").replace("_", " ")
        parts.append(f"{label} {text}")
    return ", ".join(parts) if parts else "as given"


def _goal_words(case: Case) -> str:
    if case.loop:
        return f"to fly for {case.days:g} days and end above the reserve"
    late = f" within {case.by_days:g} days" if case.by_days is not None else f" within the {case.days:g} days flown"
    return f"to arrive{late} and above the reserve"


def plan_page(case: Case, choices, settings, chosen, hangs, options: PlanOptions) -> str:
    """The page: the answer, what it costs, the trade-offs, what it hangs on, and what is assumed."""
    reserve = case.vehicle.battery.reserve_fraction if case.reserve is None else case.reserve
    lines = [
        f"# How to fly {case.mission.name}",
        "",
        f"Success is {_goal_words(case)} ({100 * reserve:.0f} % of the charge); of the settings that succeed with a "
        f"probability of at least {100 * options.confidence:.0f} %, the one with the best {GOALS[options.goal][2]} is "
        f"recommended. {len(settings)} settings, {case.n} members each, the same seeds for all.",
        "",
        "## Answer",
        "",
    ]
    for one in chosen:
        lines += [*_answer(one, case, options), "", *_program(one.setting or one.best)]
    lines += ["## Trade-offs", "", *_table(settings, chosen), ""]
    refused = [s for s in settings if s.refused]
    if refused:
        lines += ["Not flown:", "", *(f"- {words(s)}: {s.refused}" for s in refused[:20]), ""]
    for group, found in hangs.items():
        name = f": {group}" if group else ""
        lines += [f"## What it hangs on{name}", "", *_hangs(found, options.goal), ""]
    lines += ["## Assumed", "", *_assumed(case)]
    return "\n".join(lines) + "\n"


def _spread(values, digits: int = 0) -> str:
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _answer(one: Recommendation, case: Case, options: PlanOptions) -> list[str]:
    head = f"**{one.group or case.mission.name}**: "
    if one.setting is None:
        best = one.best
        return [
            f"{head}no setting succeeds with {100 * options.confidence:.0f} %. The likeliest ({words(best)}) succeeds "
            f"in {100 * best.probability:.0f} %: {why_not(best, case)}"
        ]
    s = one.setting
    text = (
        f"{head}{words(s)}. Succeeds in {100 * s.probability:.0f} % of members; {_spread(s.days, 1)} days, "
        f"{_spread(s.km)} km, {_spread(s.profiles)} profiles, {_spread(s.wh)} Wh, "
        f"{_spread(100 * s.left)} % of the charge left. Median with 5 to 95 %."
    )
    sure = f"Chosen again in {100 * one.sure:.0f} % of resampled ensembles"
    if one.runner is not None:
        sure += (
            f"; next is {words(one.runner)}, {one.margin[0]:+.1f} +- {one.margin[1]:.1f} "
            f"{GOALS[options.goal][2]} apart "
            "with the same seeds"
        )
    return [text, "", sure + "."]


def _program(setting: Setting) -> list[str]:
    """How often the rules of the mission's program fire in a setting; nothing without a program."""
    lines = []
    for rule, share, day in setting.fired:
        when = f", median day {day:.1f}" if np.isfinite(day) else ""
        lines.append(f"- {rule} fires in {100 * share:.0f} % of members{when}")
    return [*lines, ""] if lines else []


def _table(settings: Sequence[Setting], chosen: Sequence[Recommendation]) -> list[str]:
    flown = [s for s in settings if not s.refused]
    front = {id(s) for s in pareto(flown)}
    stars = {id(one.setting) for one in chosen if one.setting is not None}
    names = list(flown[0].choices)
    lines = [
        f"| {' | '.join(n.replace('_', ' ') for n in names)} | P(success) % | P(finish) % | days | km | "
        f"profiles | Wh | "
        "Wh/day | charge left % | surfacings | |",
        "|---" * (len(names) + 10) + "|",
    ]
    # One page: what is recommended and what nothing beats come first, all else as far as there is room.
    rank = {id(s): (id(s) not in stars, id(s) not in front) for s in flown}
    shown = {id(s) for s in sorted(flown, key=lambda s: rank[id(s)])[:_SETTINGS_IN_PAGE]}
    for s in (s for s in flown if id(s) in shown):
        values = " | ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in s.choices.values())
        mark = "recommended" if id(s) in stars else ("front" if id(s) in front else "")
        median = [float(np.median(getattr(s, name))) for name in ("days", "km", "profiles", "wh")]
        start = f"| {values} | " if values else "| "
        lines.append(
            f"{start}{100 * s.probability:.0f} | {100 * s.finished.mean():.0f} | {median[0]:.1f} | {median[1]:.0f} | "
            f"{median[2]:.0f} | {median[3]:.0f} | {np.median(s.rate('wh')):.1f} | {100 * np.median(s.left):.0f} | "
            f"{np.median(s.contacts):.0f} | {mark} |"
        )
    if len(flown) > _SETTINGS_IN_PAGE:
        lines += ["", f"{len(flown) - _SETTINGS_IN_PAGE} more settings are in plan.json."]
    lines += [
        "",
        "Medians. front: no other setting is better in km, profiles, energy and probability at once.",
    ]
    return lines


def _hangs(found: Sequence[Sensitivity], goal: str) -> list[str]:
    lines = [f"| parameter | step | change of Wh | change of {GOALS[goal][2]} |", "|---|---|---|---|"]
    for s in list(found)[:10]:
        lines.append(
            f"| {s.name} | {s.step} | {s.energy[0]:+.1f} +- {s.energy[1]:.1f} | {s.goal[0]:+.2f} +- {s.goal[1]:.2f} |"
        )
    return lines


def _assumed(case: Case) -> list[str]:
    devices = ", ".join(d.name.replace("_", " ") for d in case.vehicle.devices) or "none"
    currents = "as given" if case.currents is not None else "unknown: drawn anew for every member"
    return [
        f"- vehicle {case.vehicle.name}, speed model {case.speed}, devices: {devices}",
        f"- currents {currents}; seafloor {'as given' if case.bathymetry is not None else 'never reached'}",
        *(["- no hydrography: uniform water of the vehicle's trim"] if case.water is None else []),
        *(f"- not simulated: {text}" for text in case.mission.unsupported),
        f"- waypoints {'flown over and over' if case.loop else 'flown once'}; a member whose pack is empty ends there",
        "- differences between settings are between the same members; the spreads contain what is unknown to all",
    ]


def plan_numbers(case: Case, settings, chosen, hangs, options: PlanOptions) -> dict[str, Any]:
    """All numbers of the page, ready for JSON."""

    def spread(values):
        return dict(zip(("p05", "median", "p95"), np.quantile(values, (0.05, 0.5, 0.95)), strict=True))

    def entry(s: Setting) -> dict[str, Any]:
        if s.refused:
            return {"choices": s.choices, "refused": s.refused}
        names = ("days", "km", "profiles", "wh", "left", "contacts")
        return {
            "choices": s.choices, "probability": s.probability, "finished": float(s.finished.mean()),
            **{name: spread(getattr(s, name)) for name in names},
            "wh_per_day": spread(s.rate("wh")), "km_per_day": spread(s.rate("km")), "story": s.story,
            "program": [{"rule": rule, "share": share, "median_day": day} for rule, share, day in s.fired],
        }  # fmt: skip

    def answer(one: Recommendation) -> dict[str, Any]:
        return {
            "group": one.group, "setting": None if one.setting is None else one.setting.choices,
            "likeliest": one.best.choices, "probability": (one.setting or one.best).probability, "sure": one.sure,
            "runner": None if one.runner is None else one.runner.choices, "margin": list(one.margin),
            "why_not": None if one.setting is not None else why_not(one.best, case),
        }  # fmt: skip

    front = [s.choices for s in pareto(settings)]
    numbers = {
        "schema": "glider_jax.plan/1", "mission": case.mission.name, "vehicle": case.vehicle.name, "days": case.days,
        "members": case.n, "seed": case.seed, "goal": options.goal, "confidence": options.confidence,
        "settings": [entry(s) for s in settings], "pareto": front, "recommended": [answer(one) for one in chosen],
        "sensitivities": {
            group or "all": [
                {"name": s.name, "step": s.step, "wh": list(s.energy), "goal": list(s.goal)} for s in found
            ]
            for group, found in hangs.items()
        },
    }  # fmt: skip
    return plain_numbers(numbers)
