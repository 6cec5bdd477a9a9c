"""How a glider has been flying, learned from its last segments: for how long, how fast, where to, how deep.

NumPy only. A pilot knows the mission; a recording shows only what came of it. What is steady goes on with the spread
it has shown, and every habit may break: each law is a mixture of "as before" (Student's t, its scale learned from a
prior) and "otherwise" (broad, its share learned from how often habits broke). Recent segments count more.

The priors are judgement about gliders in general, stated here, and not fitted to any recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from glider_jax.readers.dead_reckoning import finite, metres
from glider_jax.readers.dives import ASCENT, DESCENT
from glider_jax.records import Array, Recording

HOUR = 3600.0
#: Share that an older segment counts less than the next.
_FORGET = 0.85
#: Prior spread of log durations, log speeds and headings (rad) from one segment to the next, and its weight.
_DURATION_SD, _SPEED_SD, _HEADING_SD, _WEIGHT = 0.07, 0.06, np.radians(8.0), 3.0
#: A duration that differs by more than a third is another habit; so is a heading off by more than 40 degrees.
_BREAK, _ASTRAY = 0.3, np.radians(40.0)
#: Prior counts of broken and kept habits; dives shorter than this are trials, after which anything may come.
_BROKEN, _KEPT = 0.5, 5.5
_TRIAL = 0.5 * HOUR
#: Durations under a new habit: log-normal about the mean of the last and this one, s, with this spread.
_USUAL_DURATION, _NEW_DURATION_SD = 2.5 * HOUR, 0.8
#: m/s and share; a glider of which nothing is known, and how straight its way through the water is.
_USUAL_SPEED, _USUAL_SPEED_SD, _STRAIGHT = 0.27, 0.25, 0.95
_USUAL_RATE, _USUAL_DEPTH, _USUAL_STAY, _USUAL_LAG = 0.15, 100.0, 900.0, 60.0
#: Share of a heading error that is there in the next segment too.
_PERSISTENCE = 0.6
#: Log odds, beforehand, that a glider with a waypoint holds its last direction instead of steering for it.
_HELD_ODDS = -1.5
#: How much less a way of steering is believed in that mission files rule out.
_FILES_ERR = 0.15
#: s; habits of so long ago have half a chance of still holding.
_DIRECTION_FADES, _HABIT_FADES = 0.7 * 86400.0, 4.0 * 86400.0
_LATEST = 40


class Law(NamedTuple):
    """A number to come: ``centre``, ``sd`` and degrees of freedom as before; ``astray`` the share of other habits."""

    centre: float
    sd: float
    freedom: float
    astray: float

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """``n`` values of the steady part."""
        return self.centre + self.sd * rng.standard_t(self.freedom, n)


@dataclass(frozen=True)
class Behaviour:
    """What a glider does between two surfacings, with its spread.

    Attributes
    ----------
    duration : law of the logarithm of s under water.
    speed : law of the logarithm of m/s made good through the water.
    steering : how it chooses its direction, and how well it keeps it.
    held_heading : rad true, the direction it last moved through the water; flown where no waypoint is known.
    dive_to, climb_to : m.  down, up : m/s vertical speeds.  stay : s at the surface.
    lag : s from surfacing to the first fix.  departure : s from the last fix to the dive.
    successors : waypoint (rounded to 1e-4 degree) to the one that followed it.
    charge_rate : A under water, with ``charge_rate_sd``; NaN where no counter was recorded.
    segments : number of segments this rests on.
    assumed : sentences for what had to be assumed.
    """

    duration: Law
    speed: Law
    steering: tuple[Steering, ...]
    held_heading: float
    dive_to: float
    climb_to: float
    down: float
    up: float
    stay: float
    lag: float
    departure: float
    successors: dict[tuple[float, float], tuple[float, float]]
    charge_rate: float
    charge_rate_sd: float
    segments: int
    assumed: tuple[str, ...] = ()

    def durations(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """``n`` times under water in s, and which of them follow another habit."""
        steady = np.exp(np.clip(self.duration.sample(n, rng), np.log(60.0), np.log(10 * 86400.0)))
        last = self.duration.centre
        centre = 0.5 * (last + np.log(_USUAL_DURATION))
        other = np.exp(centre + _NEW_DURATION_SD * rng.standard_normal(n))
        astray = rng.random(n) < self.duration.astray
        return np.where(astray, np.clip(other, 120.0, 4 * 86400.0), steady), astray

    def speeds(self, n: int, rng: np.random.Generator) -> Array:
        """``n`` speeds made good through the water, m/s."""
        return np.exp(np.clip(self.speed.sample(n, rng), np.log(0.03), np.log(1.5)))

    @property
    def aims_off(self) -> bool:
        """Whether it rather steers against the current it knows of than straight for its waypoint."""
        belief = {one.name: one.belief for one in self.steering}
        return belief["aimed"] > belief["waypoint"]

    def headings(
        self, n: int, rng: np.random.Generator, told: dict[str, float], aims: bool | None = None
    ) -> Array:
        """``n`` directions in rad, clockwise from north; ``told`` gives what each way of steering would choose.

        ``aims`` is what mission files say about steering against the current, None where there are none.
        """
        shares = np.array([one.belief if one.name in told else 0.0 for one in self.steering])
        if aims is not None:
            unlikely = "waypoint" if aims else "aimed"
            shares *= [_FILES_ERR if one.name == unlikely else 1.0 for one in self.steering]
        picked = rng.choice(len(shares), size=n, p=shares / shares.sum())
        drawn = np.empty(n)
        for k, one in enumerate(self.steering):
            mine = picked == k
            if mine.any():
                steady = told[one.name] + one.law.sample(n, rng)
                astray = rng.random(n) < one.law.astray
                drawn[mine] = np.where(astray, rng.uniform(-np.pi, np.pi, n), steady)[mine]
        return drawn


class Steering(NamedTuple):
    """One way of choosing a direction: ``waypoint`` for it, ``aimed`` against the current too, ``held`` as before.

    ``belief`` sums to 1 over the three; ``law`` is that of the deviation in rad, clockwise.
    """

    name: str
    belief: float
    law: Law


class Way(NamedTuple):
    """One segment as navigation: when, for how long, through the water (complex m), over which length (m)."""

    begin: float
    duration: float
    water: complex
    length: float


def ways(segments) -> list[Way]:
    """The ways through the water of segments; dead reckoned, else ground less the glider's own current.

    Where no current is known either the way over the ground is taken, and the current counts as what will change.
    """
    found = []
    for one in segments:
        water = complex(one.water_east, one.water_north)
        if not np.isfinite(water):
            current = complex(one.glider_current_east, one.glider_current_north)
            water = complex(one.east, one.north) - (current * one.duration if np.isfinite(current) else 0.0)
        length = one.path_length if np.isfinite(one.path_length) else abs(water)
        found.append(Way(one.dive_time, one.duration, water, max(length, abs(water))))
    return found


def says_it_aims(recording: Recording) -> bool | None:
    """Whether the recorded setting is to steer against the current; None where it was not recorded."""
    _, setting = finite(recording, "current_correction")
    return bool(setting[-1] > 0.0) if setting.size else None


def waypoint_log(recording: Recording) -> tuple[Array, Array, Array]:
    """Times, latitudes and longitudes of the waypoints flown to; a waypoint never set (0, 0) is left out."""
    if "waypoint_latitude" not in recording or "waypoint_longitude" not in recording:
        return np.empty(0), np.empty(0), np.empty(0)
    latitude, longitude = recording["waypoint_latitude"], recording["waypoint_longitude"]
    good = np.isfinite(latitude) & np.isfinite(longitude) & ~((latitude == 0.0) & (longitude == 0.0))
    return recording.time[good], latitude[good], longitude[good]


def waypoint_at(log: tuple[Array, Array, Array], moment: float) -> tuple[float, float] | None:
    """The waypoint flown to at a moment, None before the first is known."""
    row = int(np.searchsorted(log[0], moment, side="right")) - 1
    return None if row < 0 else (float(log[1][row]), float(log[2][row]))


def _key(point: tuple[float, float]) -> tuple[float, float]:
    return round(point[0], 4), round(point[1], 4)


def successors(log: tuple[Array, Array, Array]) -> dict[tuple[float, float], tuple[float, float]]:
    """Which waypoint followed which, as last seen."""
    found: dict[tuple[float, float], tuple[float, float]] = {}
    points = list(zip(log[1].tolist(), log[2].tolist(), strict=True))
    for here, there in zip(points[:-1], points[1:], strict=True):
        if _key(here) != _key(there):
            found[_key(here)] = there
    return found


def aim(point: complex, current: complex, speed: float) -> float:
    """Heading in rad, clockwise from north, that makes good the direction of ``point`` (east + i north m)."""
    along = point / max(abs(point), 1e-9)
    across = (current * np.conj(along)).imag
    offset = float(np.arcsin(np.clip(across / max(speed, 0.05), -0.95, 0.95)))
    return float((np.pi / 2.0 - np.angle(along) + offset) % (2.0 * np.pi))


def _turn(angle: float) -> float:
    """An angle brought into -pi to pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _learn(
    values: list[float], prior_sd: float, centre: float, broken: float, kept: float, limit: float, freedom=0.0
):
    """A law from deviations, oldest first: those beyond ``limit`` count as astray, the others widen the spread."""
    total, weight, bad, good = _WEIGHT * prior_sd**2, _WEIGHT, broken, kept
    for age, value in enumerate(reversed(values)):
        share = _FORGET**age
        if abs(value) > limit:
            bad += share
        else:
            good += share
            total += share * value**2
            weight += share
    return Law(centre, float(np.sqrt(total / weight)), max(weight + freedom, 3.0), bad / (bad + good))


def _duration_law(all_ways: list[Way], assumed: list[str]) -> Law:
    if not all_ways:
        assumed.append(f"no dive seen before: about {_USUAL_DURATION / HOUR:g} h under water assumed")
        return Law(float(np.log(_USUAL_DURATION)), _NEW_DURATION_SD, 5.0, 0.1)
    logs = np.log([max(w.duration, 60.0) for w in all_ways])
    steps = np.diff(logs)
    breaks = np.flatnonzero(np.abs(steps) > _BREAK)
    run = logs[breaks[-1] + 1 :] if breaks.size else logs
    trial = np.exp(logs[-1]) < _TRIAL
    broken, kept = (2.0, 2.0) if trial and run.size < 4 else (_BROKEN, _KEPT)
    misses, since = [], 0
    for k, step in enumerate(steps):
        misses.append(
            float(logs[k + 1] - np.median(logs[since : k + 1][-5:])) if abs(step) <= _BREAK else float(step)
        )
        since = k + 1 if abs(step) > _BREAK else since
    return _learn(misses, _DURATION_SD, float(np.median(run[-5:])), broken, kept, _BREAK)


def _speed_law(all_ways: list[Way], assumed: list[str]) -> Law:
    """Law of the log speed made good through the water."""
    good = [w for w in all_ways if w.duration > 240.0 and w.length > 0.0 and np.isfinite(w.water)]
    if not good:
        assumed.append(f"no dead reckoning: {_USUAL_SPEED:g} m/s through the water assumed")
        return Law(float(np.log(_USUAL_SPEED)), _USUAL_SPEED_SD, 5.0, 0.0)
    ratios = [abs(w.water) / w.length for w in good]
    straight = [r for r in ratios[-8:] if r > 0.75]
    usual = float(np.median(straight)) if straight else _STRAIGHT
    # A way that doubles back says how fast the glider went, not how far it got.
    speeds = [
        np.log((abs(w.water) if r > 0.75 else usual * w.length) / w.duration)
        for w, r in zip(good, ratios, strict=True)
    ]
    level, misses = speeds[0], []
    for value in speeds[1:]:
        misses.append(float(value - level))
        level += 0.6 * (value - level)
    return _learn(misses, _SPEED_SD, float(level), 0.0, 1.0, 1.0)


def _bearing(way: complex) -> float:
    """Direction of east + i north, rad clockwise from north."""
    return float((np.pi / 2.0 - np.angle(way)) % (2.0 * np.pi))


def _steering(all_ways, starts, log, currents, known: bool | None) -> tuple[Steering, ...]:
    """The three ways of choosing a direction, how much each is believed, and how well it was kept.

    ``starts`` are positions where the segments began, ``currents`` what the glider knew then, ``known`` whether it
    says that it steers against the current.
    """
    misses: dict[str, list[float]] = {"waypoint": [], "aimed": [], "held": []}
    evidence = {"waypoint": 0.0, "aimed": 0.0, "held": _HELD_ODDS}
    if known is not None:
        evidence["waypoint" if known else "aimed"] = -4.0
    last = None
    for way, start, current in zip(all_ways, starts, currents, strict=True):
        if not np.isfinite(way.water) or abs(way.water) < 0.5 * way.length or way.duration < 240.0:
            continue
        went, before = _bearing(way.water), last
        last = went
        point = waypoint_at(log, way.begin)
        told = {} if before is None else {"held": before}
        if point is not None:
            to = complex(*(float(v) for v in metres(point[0], point[1], start)))
            if abs(to) < 1.2 * abs(way.water):
                continue
            speed = abs(way.water) / way.duration
            told["waypoint"] = aim(to, 0.0, speed)
            if np.isfinite(current):
                told["aimed"] = aim(to, current, speed)
        off = {name: _turn(went - angle) for name, angle in told.items()}
        for name, value in off.items():
            misses[name].append(value)
        if len(off) == 3:
            # The first minutes of a dive go into turning: short dives say less.
            share = min(1.0, way.duration / HOUR)
            for name, value in off.items():
                evidence[name] = _FORGET * evidence[name] - 0.5 * share * min(
                    (value / np.radians(15.0)) ** 2, 6.0
                )
    best = max(evidence.values())
    odds = {name: float(np.exp(max(value - best, -8.0))) for name, value in evidence.items()}
    return tuple(
        Steering(name, odds[name] / sum(odds.values()), _miss_law(misses[name], name == "held"))
        for name in misses
    )


def _miss_law(misses: list[float], held: bool) -> Law:
    """Law of the deviations from one way of choosing a direction; part of the last one persists."""
    sd, broken, kept = (2.0 * _HEADING_SD, 1.0, 4.0) if held else (_HEADING_SD, _BROKEN, _KEPT)
    if not misses:
        return Law(0.0, 1.5 * sd, 5.0, broken / (broken + kept))
    share = 0.0 if held else _PERSISTENCE
    steps = [misses[0], *(_turn(b - share * a) for a, b in zip(misses[:-1], misses[1:], strict=True))]
    last = misses[-1] if abs(misses[-1]) <= _ASTRAY else 0.0
    return _learn(steps, sd, share * last, broken, kept, _ASTRAY)


def _profile(legs, segments) -> tuple[float, float, float, float]:
    """Depth of the turns below and above, and vertical speeds down and up, of the latest legs."""
    if not segments:
        return _USUAL_DEPTH, 3.0, _USUAL_RATE, _USUAL_RATE
    since = segments[-3:][0].dive_time - 1.0
    mine = [leg for leg in legs if leg.start_time >= since and leg.end_time > leg.start_time]
    rates = []
    for phase in (DESCENT, ASCENT):
        ones = [leg for leg in mine if leg.phase == phase]
        height = sum(abs(leg.end_depth - leg.start_depth) for leg in ones)
        span = sum(leg.end_time - leg.start_time for leg in ones)
        rates.append(float(np.clip(height / span, 0.03, 0.6)) if span > 0.0 else _USUAL_RATE)
    bottoms = [leg.end_depth for leg in mine if leg.phase == DESCENT]
    tops = [leg.end_depth for leg in mine if leg.phase == ASCENT and leg.end_depth > 0.5]
    deep = float(np.median(bottoms)) if bottoms else segments[-1].maximum_depth
    deep = deep if np.isfinite(deep) and deep > 3.0 else _USUAL_DEPTH
    high = float(np.median(tops)) if tops else min(3.0, 0.3 * deep)
    return deep, float(np.clip(high, 0.5, 0.7 * deep)), rates[0], rates[1]


def _charge(segments) -> tuple[float, float]:
    """Mean current drawn between fixes, A, and its spread from segment to segment."""
    pairs = [(s.charge_used, s.end_time - s.start_time) for s in segments[-10:] if np.isfinite(s.charge_used)]
    pairs = [(q, t) for q, t in pairs if t > 300.0 and q > 0.0]
    if not pairs:
        return float("nan"), float("nan")
    rates = np.log([q / t for q, t in pairs])
    level, misses = rates[0], []
    for value in rates[1:]:
        misses.append(value - level)
        level += 0.6 * (value - level)
    spread = np.sqrt((_WEIGHT * 0.1**2 + np.sum(np.square(misses))) / (_WEIGHT + len(misses)))
    return float(np.exp(level)), float(np.exp(level) * spread)


def _fade(law: Law, age: float, half: float) -> Law:
    """A law of a habit last seen ``age`` s ago: the chance that it still holds halves every ``half`` s."""
    return law._replace(astray=1.0 - (1.0 - law.astray) * 0.5 ** (max(age, 0.0) / half))


def learn(
    segments, legs, log: tuple[Array, Array, Array], aims: bool | None = None, now: float | None = None
):
    """Learn a glider's behaviour from all that is known of it; the caller leaves out what came after the present.

    Parameters
    ----------
    segments, legs : oldest first; both may be empty.
    log : of :func:`waypoint_log`.  aims : whether the glider says that it steers against the current, if it does.
    now : UTC s of the forecast; habits seen long before it are doubted.
    """
    segments = list(segments)[-_LATEST:]
    assumed: list[str] = []
    all_ways = ways(segments)
    duration = _duration_law(all_ways, assumed)
    speed = _speed_law(all_ways, assumed)
    felt = [complex(s.glider_current_east, s.glider_current_north) for s in segments]
    before = [complex(np.nan, np.nan), *felt[:-1]][: len(felt)]
    starts = [(s.start_latitude, s.start_longitude) for s in segments]
    steering = _steering(all_ways, starts, log, before, aims)
    moved = [w.water for w in all_ways if np.isfinite(w.water) and abs(w.water) > 0.0]
    held = _bearing(moved[-1]) if moved else 0.0
    age = now - segments[-1].surface_time - _USUAL_STAY if now is not None and segments else 0.0
    steering = tuple(
        s._replace(law=_fade(s.law, age, _DIRECTION_FADES)) if s.name == "held" else s for s in steering
    )
    duration = _fade(duration, age, _HABIT_FADES)
    if log[0].size == 0:
        assumed.append("no waypoint recorded: the last direction through the water is held")
    deep, high, down, up = _profile(legs, segments)
    if not segments:
        assumed.append(f"no dive seen before: yos to {deep:g} m at {down:g} m/s assumed")
    stays = [b.dive_time - a.surface_time for a, b in zip(segments[:-1], segments[1:], strict=True)]
    stays = [s for s in stays if 60.0 < s < 3 * HOUR][-5:]
    lags = [s.end_time - s.surface_time for s in segments[-8:] if s.end_time - s.surface_time < 1800.0]
    waits = [s.dive_time - s.start_time for s in segments[-8:] if s.dive_time - s.start_time < 1800.0]
    rate, rate_sd = _charge(segments)
    return Behaviour(
        duration=duration, speed=speed, steering=steering, held_heading=held, dive_to=deep,
        climb_to=high, down=down, up=up, stay=float(np.median(stays)) if stays else _USUAL_STAY,
        lag=float(np.median(lags)) if lags else _USUAL_LAG, departure=float(np.median(waits)) if waits else 0.0,
        successors=successors(log), charge_rate=rate, charge_rate_sd=rate_sd, segments=len(segments),
        assumed=tuple(assumed),
    )  # fmt: skip
