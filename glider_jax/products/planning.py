"""Missions weighed before they fly: declared choices, every combination flown with the same seeds, and what each gives.

Settings are flown together in one compiled program, stacked as far as memory is allowed for, since a setting changes
numbers only. The same seed for all makes differences between settings far more certain than the settings themselves.
Of every setting a few numbers per member are kept, so that a sweep of any size needs little memory.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from glider_jax.board.power import instrument_devices
from glider_jax.config import Device, Mission, SampleRule, Vehicle, check_mission
from glider_jax.errors import ConfigError, CoverageError, Outcome, did_you_mean
from glider_jax.products.coordinates import LocalFrame
from glider_jax.readers.battery_packs import PACKS, pack
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Track, WaterProfile

DAY, HOUR, WH = 86400.0, 3600.0, 3600.0
#: Numbers of a setting's choices, with the unit that the user writes.
NUMBERS = {
    "pitch": "degrees",
    "dive_to": "m",
    "climb_to": "m",
    "altitude": "m",
    "volume_cc": "cc each way",
    "surface_every_h": "h",
    "surface_stay_min": "min",
    "ctd_every_s": "s",
    "start_h": "h after the mission's start",
}
#: Words that other choices may take.
WORDS: dict[str, tuple[str, ...]] = {
    "battery": PACKS,
    "instrument": ("none", "stock", "deployed", "development_7mhz", "development_3mhz"),
    "order": ("given", "reversed"),
}
_INSTRUMENTS = {
    "deployed": ("measurement_board_8", "science_computer_deployed"),
    "development_7mhz": ("measurement_board_6", "science_computer_development_7mhz"),
    "development_3mhz": ("measurement_board_6", "science_computer_development_3mhz"),
}
_FAILED = (Outcome.BATTERY_EMPTY, Outcome.BATTERY_ABORT)
_CTD = 1


@dataclass(frozen=True)
class Case:
    """What a sweep starts from: everything read, the same for all settings.

    ``days`` of the longest flight; ``loop`` flies the waypoints over and over, and success is then to last that long
    above the reserve, else to arrive above it, by ``by_days`` if given. ``reserve`` share of the usable charge.
    """

    mission: Mission
    vehicle: Vehicle
    currents: CurrentGrid | None = None
    bathymetry: BathymetryGrid | None = None
    water: WaterProfile | None = None
    days: float = 30.0
    loop: bool = False
    by_days: float | None = None
    reserve: float | None = None
    speed: str = "flight"
    speed_kind: str = "auto"
    start: float | None = None
    start_position: tuple[float, float] | None = None
    n: int = 100
    seed: int = 0
    spread: float = 1.0


@dataclass(frozen=True)
class Setting:
    """One combination and what it gives; arrays are (member,), ``refused`` says why it was not flown.

    ``days`` flown, ``km`` over the ground, ``profiles`` dives and climbs, ``wh`` drawn, ``left`` share of the charge,
    ``contacts`` surfacings, ``finished`` whether the goal was met, ``success`` whether above the reserve and in time.
    ``story`` numbers that say why a mission fails. ``fired`` per rule of the mission's program: its words, the share of
    members in which it fired, and the median day.
    """

    choices: dict[str, float | str]
    days: Array = field(default_factory=lambda: np.empty(0))
    km: Array = field(default_factory=lambda: np.empty(0))
    profiles: Array = field(default_factory=lambda: np.empty(0))
    wh: Array = field(default_factory=lambda: np.empty(0))
    left: Array = field(default_factory=lambda: np.empty(0))
    contacts: Array = field(default_factory=lambda: np.empty(0))
    finished: Array = field(default_factory=lambda: np.empty(0, bool))
    success: Array = field(default_factory=lambda: np.empty(0, bool))
    outcome: Array = field(default_factory=lambda: np.empty(0, int))
    story: dict[str, float] = field(default_factory=dict)
    refused: str = ""
    fired: tuple[tuple[str, float, float], ...] = ()

    @property
    def probability(self) -> float:
        """Share of members that succeed."""
        return float(self.success.mean()) if self.success.size else 0.0

    def rate(self, name: str) -> Array:
        """A total per day, (member,)."""
        return getattr(self, name) / np.maximum(self.days, 1e-9)


def parse_choices(given: Sequence[str]) -> dict[str, tuple[float | str, ...]]:
    """Choices from ``name=value,value`` words.

    Raises
    ------
    ConfigError : an unknown name or word, no value, or one that is not a number.
    """
    known = (*NUMBERS, *WORDS)
    choices: dict[str, tuple[float | str, ...]] = {}
    for text in given:
        name, _, rest = text.partition("=")
        name = name.strip()
        if name not in known:
            raise ConfigError(f"--vary: expected one of {', '.join(known)}, found '{name}'.{did_you_mean(name, known)}")
        if name in choices:
            raise ConfigError(f"--vary {name}: expected it once, found it twice. Put all values after one.")
        words = [word.strip() for word in rest.split(",") if word.strip()]
        if not words:
            raise ConfigError(f"--vary {name}: expected values, found none. Example: --vary pitch=20,26,32.")
        values = tuple(_value(name, word) for word in words)
        choices[name] = tuple(dict.fromkeys(values))
    return choices


def _value(name: str, word: str) -> float | str:
    if name in WORDS:
        if word not in WORDS[name] and not (name == "order" and re.fullmatch(r"\d+(-\d+)+", word)):
            raise ConfigError(
                f"--vary {name}: expected one of {', '.join(WORDS[name])}, found '{word}'."
                f"{did_you_mean(word, WORDS[name])}"
            )
        return word
    try:
        number = float(word)
    except ValueError as error:
        raise ConfigError(f"--vary {name}: expected numbers ({NUMBERS[name]}), found '{word}'. Correct it.") from error
    if not math.isfinite(number):
        raise ConfigError(f"--vary {name}: expected finite numbers ({NUMBERS[name]}), found '{word}'. Correct it.")
    return number


def apply_choices(case: Case, choices: Mapping[str, float | str]) -> Case:
    """The case with one setting's choices made.

    Raises
    ------
    ConfigError : the mission contradicts itself with these choices, or a choice has nothing to act on.
    """
    mission, vehicle, yo = case.mission, case.vehicle, case.mission.yo
    start = case.start if case.start is not None else mission.start
    for name, value in choices.items():
        if name == "pitch":
            yo = replace(yo, dive_pitch=math.radians(value), climb_pitch=math.radians(value))
        elif name in ("dive_to", "climb_to"):
            yo = replace(yo, **{name: value})
        elif name == "altitude":
            yo = replace(yo, dive_altitude=value)
        elif name == "volume_cc":
            limit = vehicle.value("flight.pump_volume") * 1e6
            if not 0.0 < value <= limit:
                raise ConfigError(f"volume_cc: expected more than 0 and at most the pump's {limit:g}, found {value:g}.")
            yo = replace(yo, dive_volume=value * 1e-6, climb_volume=value * 1e-6)
        elif name == "surface_every_h":
            mission = replace(mission, surface=_timed(mission, value * HOUR))
        elif name == "surface_stay_min":
            mission = replace(mission, surface_stay=value * 60.0)
        elif name == "ctd_every_s":
            mission = replace(mission, samples=_sampled(mission, vehicle, value))
        elif name == "start_h":
            if start is None:
                raise ConfigError("start_h: expected a start time to count from, found none. Give --start.")
            start += value * HOUR
        elif name == "battery":
            vehicle = replace(vehicle, battery=pack(str(value)))
        elif name == "instrument":
            vehicle = replace(vehicle, devices=_instruments(vehicle, str(value)))
        elif name == "order" and value != "given":
            mission = replace(mission, waypoints=_ordered(mission, str(value)), first_waypoint=0)
    mission = replace(mission, yo=yo)
    if case.loop:
        mission = replace(mission, legs=-1)
    check_mission(mission, mission.name)
    return replace(case, mission=mission, vehicle=vehicle, start=start)


def _ordered(mission: Mission, word: str):
    """The waypoints reversed, or in an order such as 2-1-3 of their numbers."""
    if word == "reversed":
        return mission.waypoints[::-1]
    numbers = [int(part) for part in word.split("-")]
    count = len(mission.waypoints)
    if sorted(numbers) != list(range(1, count + 1)):
        raise ConfigError(f"order: expected each of the waypoints 1 to {count} once, found '{word}'. Correct it.")
    return tuple(mission.waypoints[number - 1] for number in numbers)


def _timed(mission: Mission, seconds: float):
    """The mission's rules with the interval of every timed one changed."""
    changed = [replace(r, seconds=seconds) if r.kind in ("every", "after") else r for r in mission.surface]
    if not any(r.kind in ("every", "after") for r in mission.surface):
        raise ConfigError(
            f"{mission.name}: surface_every_h: expected a surface rule of kind 'every' or 'after' to change, "
            f"found none."
        )
    return tuple(changed)


def _sampled(mission: Mission, vehicle: Vehicle, seconds: float):
    if not any(_CTD in device.sensor_types for device in vehicle.devices):
        raise ConfigError(
            f"ctd_every_s: expected a CTD among the devices of {vehicle.name}, found none. Give --devices ctd."
        )
    rule = SampleRule(_CTD, frozenset({"dive", "climb"}), interval=seconds)
    others = mission.samples or tuple(
        SampleRule(kind, frozenset({"dive", "climb"}))
        for kind in sorted({k for d in vehicle.devices for k in d.sensor_types if k > _CTD})
    )
    return (*(r for r in others if r.sensor_type not in (0, _CTD)), rule)


def _instruments(vehicle: Vehicle, word: str) -> tuple[Device, ...]:
    """The vehicle's devices with its board and science computer exchanged."""
    kept = tuple(device for device in vehicle.devices if device.group != "instrument")
    if word == "none":
        return kept
    if word == "stock":
        from glider_jax.readers.device_catalogue import DEVICES

        return (*kept, DEVICES["science_computer_stock"])
    return (*kept, *instrument_devices(*_INSTRUMENTS[word]))


def settings_of(choices: Mapping[str, Sequence[float | str]]) -> Iterator[dict[str, float | str]]:
    """Every combination, the last choice varying fastest."""
    for values in itertools.product(*choices.values()):
        yield dict(zip(choices, values, strict=True))


def sweep(
    case: Case, choices: Mapping[str, Sequence[float | str]], progress: Callable[[int], None] | None = None
) -> list[Setting]:
    """Fly every combination with the same seeds.

    Combinations that contradict themselves are returned with the reason; the others fly.

    Raises
    ------
    ConfigError : no combination can be flown; the message is that of the first.
    """
    made: list[tuple[dict[str, float | str], Case | ConfigError]] = []
    for combination in settings_of(choices):
        try:
            made.append((combination, apply_choices(case, combination)))
        except ConfigError as error:
            made.append((combination, error))
    flyable = [(one, combination) for combination, one in made if isinstance(one, Case)]
    if not flyable:
        raise next(one for _, one in made if isinstance(one, ConfigError))
    refused = len(made) - len(flyable)
    counted = None if progress is None else lambda done: progress(refused + done)
    flown = iter(fly_settings(flyable, common_interval([one for one, _ in flyable]), counted))
    found = [
        next(flown) if isinstance(one, Case) else Setting(combination, refused=str(one)) for combination, one in made
    ]
    if all(s.refused for s in found):
        raise CoverageError(f"no setting could be flown: {found[0].refused}")
    return found


def common_interval(cases: Sequence[Case]) -> float:
    """One output interval for all, so that they share a compiled program, short enough to see every surfacing."""
    from glider_jax.mission.forecast import output_interval

    return min(output_interval(one.days * DAY, one.mission) for one in cases)


def prepare_case(case: Case, interval: float | None = None, beside: Any = None) -> Any:
    """The run of one case; ``beside`` is another run in the same fields, whose tables are used again."""
    from glider_jax.mission.forecast import prepare
    from glider_jax.mission.speeds import choose_speeds, current_error

    nodes, _ = choose_speeds(
        case.mission, case.vehicle, case.speed, kind=case.speed_kind, has_currents=case.currents is not None
    )
    error, _ = current_error(case.vehicle, case.speed, case.speed_kind, case.currents is not None)
    return prepare(
        case.mission, case.vehicle, currents=case.currents, bathymetry=case.bathymetry, water=case.water,
        speed=case.speed, speeds=nodes, duration=case.days * DAY, interval=interval, seed=case.seed,
        spread=case.spread, start=case.start, start_position=case.start_position, current_error=error,
        frame=None if beside is None else beside.frame, beside=beside,
    )  # fmt: skip


def fly_settings(
    settings: Sequence[tuple[Case, Mapping[str, float | str]]],
    interval: float,
    progress: Callable[[int], None] | None = None,
) -> list[Setting]:
    """Fly settings together: those that compile alike are stacked, as many at a time as memory is allowed for.

    A case outside its fields comes back refused, with the reason.
    """
    from glider_jax.mission.sweep import fly_stacked, most_stacked, signature

    found: list[Setting | None] = [None] * len(settings)
    done = 0

    def keep(number: int, setting: Setting) -> None:
        nonlocal done
        found[number] = setting
        done += 1
        if progress is not None:
            progress(done)

    def fly(numbers: list[int], runs: list[Any]) -> None:
        for number, run, track in zip(numbers, runs, fly_stacked(runs, settings[numbers[0]][0].n), strict=True):
            keep(number, summarise_setting(track, run, *settings[number]))

    for numbers in _grouped(range(len(settings)), lambda k: _fields_key(settings[k][0])):
        # One tabulated ocean for all settings that share it.
        shared, waiting = None, {}
        for number in numbers:
            case = settings[number][0]
            try:
                run = prepare_case(case, interval, shared)
            except CoverageError as error:
                keep(number, Setting(dict(settings[number][1]), refused=str(error)))
                continue
            shared = run if shared is None else shared
            key = (signature(run), case.n)
            waiting.setdefault(key, ([], []))
            for kept, item in zip(waiting[key], (number, run), strict=True):
                kept.append(item)
            if len(waiting[key][0]) >= max(most_stacked(run, case.n), 2):
                fly(*waiting.pop(key))
        for group in waiting.values():
            fly(*group)
    return [setting for setting in found if setting is not None]


def _fields_key(case: Case) -> tuple[Any, ...]:
    """What the tabulated ocean depends on: place, time and the currents' error, beside the fields themselves."""
    latitudes = sorted(point[0] for point in case.mission.waypoints)
    position = case.start_position or case.mission.start_position
    errors = case.vehicle.value("perturbation.current_error")
    return (
        id(case.currents), id(case.bathymetry), case.start if case.start is not None else case.mission.start, position,
        latitudes[0], latitudes[-1], errors, case.speed, case.speed_kind,
    )  # fmt: skip


def _grouped(items, key) -> list[list[Any]]:
    groups: dict[Any, list[Any]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def fly_setting(case: Case, choices: Mapping[str, float | str], interval: float | None = None) -> Setting:
    """Fly one setting and keep what a comparison needs."""
    from glider_jax.mission.forecast import forecast

    run = prepare_case(case, interval)
    return summarise_setting(forecast(case.n, run), run, case, choices)


def summarise_setting(track: Track, run: Any, case: Case, choices: Mapping[str, float | str]) -> Setting:
    """What a comparison needs of a flown setting: a few numbers per member."""
    reserve = case.vehicle.battery.reserve_fraction if case.reserve is None else case.reserve
    ended = np.isfinite(track.outcome_time)
    days = np.where(ended, track.outcome_time - run.t0, case.days * DAY) / DAY
    wanted = int(Outcome.FLYING if case.loop else Outcome.ARRIVED)
    finished = track.outcome == wanted
    left = track.state_of_charge[:, -1].astype(float)
    success = finished & (left >= reserve)
    if case.by_days is not None and not case.loop:
        success &= days <= case.by_days
    return Setting(
        choices=dict(choices), days=days, km=track.distance_over_ground[:, -1].astype(float) / 1e3,
        profiles=track.inflections[:, -1].astype(float), wh=track.energy[:, -1].sum(-1, dtype=float) / WH, left=left,
        contacts=np.isfinite(track.surfacing_time).sum(1).astype(float), finished=finished, success=success,
        outcome=track.outcome.astype(int), story=_story(track, case), fired=_fired(track),
    )  # fmt: skip


def _fired(track: Track) -> tuple[tuple[str, float, float], ...]:
    """Words, share of members and median day of every rule of the mission's program."""
    found = []
    for k, rule in enumerate(track.program):
        days = (track.program_time[:, k] - track.time[0]) / DAY
        known = days[np.isfinite(days)]
        found.append((rule, known.size / track.n, float(np.median(known)) if known.size else math.nan))
    return tuple(found)


def _story(track: Track, case: Case) -> dict[str, float]:
    """How near the glider came to its last waypoint, its speed, and the current along the first leg."""
    last = track.waypoints[-1]
    frame = LocalFrame(float(last[0]), float(last[1]))
    near = np.hypot(*frame.to_metres(track.latitude, track.longitude)).min(axis=1)
    goal = frame.to_metres(track.waypoints[:1, 0], track.waypoints[:1, 1])
    begin = frame.to_metres(track.latitude[:, 0], track.longitude[:, 0])
    ahead = np.array([float(np.mean(g - b)) for g, b in zip(goal, begin, strict=True)])
    ahead /= max(float(np.hypot(*ahead)), 1.0)
    along = track.current_east[:, 1:] * ahead[0] + track.current_north[:, 1:] * ahead[1]
    spent = np.where(np.isfinite(track.outcome_time), track.outcome_time - track.time[0], case.days * DAY)
    speed = track.distance_through_water[:, -1] / np.maximum(spent, 1.0)
    failed = np.isin(track.outcome, [int(o) for o in _FAILED])
    empty = np.median(spent[failed]) / DAY if failed.any() else math.nan
    known = along[np.isfinite(along)]
    return {
        "closest_km": float(np.median(near)) / 1e3,
        "speed": float(np.median(speed)),
        "current_along": float(known.mean()) if known.size else math.nan,
        "battery_out": float(failed.mean()),
        "battery_days": float(empty),
    }
