"""From what is known at a surfacing to an ensemble of the next dives: the situation, its assembly, and the flight.

A :class:`~glider_jax.inference.evidence.Situation` is evidence alone (last fix, waypoint, currents felt, behaviour).
:func:`assemble` turns it into a mission, a prepared run and the draws of every member, and
:func:`fly` flies them with the engine of ``glider_jax.mission``. Every member has its own course of the current, its
own time under water, speed and heading. JAX is imported by this module only where it flies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from glider_jax.config import Mission, Quantity, SurfaceRule, Vehicle, Yo
from glider_jax.inference.behaviour import HOUR, Behaviour, aim
from glider_jax.inference.currents import Estimate, estimate_currents
from glider_jax.inference.evidence import Situation
from glider_jax.readers.dead_reckoning import metres
from glider_jax.records import Array, Track

WAYPOINTS = 4
NODES = 65
_FAR = 60e3
_RADIUS = 100.0
#: Share of the missions that come up at a waypoint after which nobody knows what follows.
_COMES_UP = 0.5
_FIX_SD = 8.0
#: m; so close to a waypoint a glider has usually turned to the next.
_CLOSE = 300.0


@dataclass(frozen=True)
class Scenario:
    """A situation made ready to fly: the run, and per member (n,) what distinguishes it.

    ``duration`` s under water in the first dive, NaN where the mission's own rules decide; ``by_waypoint`` whether
    that is the time to the waypoint. ``currents``, ``shear`` (n, 2, nodes) m/s at ``times``; ``east``, ``north`` m of
    the dive from the frame's origin; ``heading`` rad clockwise by which the first dive points off, ``later`` all that
    follow; ``usual`` s of a dive where rules decide; ``lag`` s to the first fix.
    """

    run: Any
    situation: Situation
    estimate: Estimate
    times: Array
    duration: Array
    by_waypoint: Array
    speed: Array
    heading: Array
    later: Array
    usual: float
    aimed: complex
    currents: Array
    shear: Array
    east: Array
    north: Array
    lag: float
    ruled: bool


@dataclass(frozen=True)
class Flown:
    """An ensemble and what becomes of its first surfacing: first fix after it, (n,) UTC s and degrees, NaN if none."""

    track: Track
    fix_time: Array
    fix_latitude: Array
    fix_longitude: Array
    scenario: Scenario


def assemble(
    situation: Situation,
    vehicle: Vehicle,
    *,
    n: int,
    seed: int = 0,
    horizon: float | None = None,
    interval: float | None = None,
    mission: Mission | None = None,
    product=None,
    bathymetry=None,
    ruled: bool = True,
) -> Scenario:
    """Draw every member of a forecast and prepare its run.

    Parameters
    ----------
    vehicle : for energies; speeds come from the situation.
    n, seed : members and the seed of all draws.
    horizon : s to forecast; None: as long as the next surfacing takes, in a fixed number of outputs.
    mission : as flown, if known; its waypoints and yos are then used, and with ``ruled`` its surfacing rules.
    product : None or a function of UTC s (m,) giving (2, m) m/s of a current product where the glider will be.
    """
    from glider_jax.mission.forecast import prepare

    rng = np.random.default_rng([seed, 20_241])
    known = situation.behaviour
    duration, astray = known.durations(n, rng)
    speed = known.speeds(n, rng)
    if horizon is None:
        horizon = float(np.quantile(duration, 0.985)) * 1.15 + 0.5 * HOUR
        interval = horizon / 24.0
    start = situation.time + situation.departure
    times = start + np.linspace(0.0, horizon + 1.0, NODES)
    estimate = estimate_currents(situation.seen, situation.latitude, times, product=product)
    currents, shear = estimate.sample(n, rng)
    wait = np.maximum(situation.departure + situation.departure_sd * rng.standard_normal(n), 0.0)
    drift = currents[:, :, 0] + shear[:, :, 0]
    shift = drift * situation.departure + _FIX_SD * rng.standard_normal((n, 2))
    central = float(np.exp(known.speed.centre))
    flown = _mission(situation, mission, central, duration)
    quiet = _quiet(vehicle, central)
    run = prepare(
        flown, quiet, speed="distribution", speeds=_nodes(known), duration=horizon, interval=interval,
        bathymetry=bathymetry, seed=seed, start=start, start_position=(situation.latitude, situation.longitude),
    )  # fmt: skip
    to = _towards(situation, run)
    current = situation.known_current if np.isfinite(situation.known_current) else 0.0j
    told = {"held": known.held_heading}
    if situation.waypoint is not None or mission is not None:
        told |= {"waypoint": aim(to, 0.0j, central), "aimed": aim(to, current, central)}
    engine = (
        told["aimed" if flown.current_correction else "waypoint"] if len(told) > 1 else known.held_heading
    )
    heading = _angle(known.headings(n, rng, told, mission.current_correction if mission else None) - engine)
    # A direction that is only held goes on being wrong; with a goal every surfacing sets it right.
    later = heading if len(told) == 1 else _steady(known) * rng.standard_normal(n)
    by_waypoint = np.zeros(n, bool)
    ruled = mission is not None and ruled
    if ruled:
        duration = np.where(astray, duration, np.nan)
    elif (
        mission is None
        and situation.waypoint is not None
        and _successor(situation, situation.waypoint) is None
    ):
        arrival = _arrival(to, currents.mean(2), speed, flown.waypoint_radius)
        by_waypoint = (rng.random(n) < _COMES_UP) & (arrival < duration)
        duration = np.where(by_waypoint, arrival + 0.5 * known.dive_to / known.up, duration)
    duration = duration + (wait - situation.departure)
    return Scenario(
        run=run, situation=situation, estimate=estimate, times=times, duration=np.maximum(duration, 90.0),
        by_waypoint=by_waypoint, speed=speed, heading=heading, later=later,
        usual=math.exp(known.duration.centre), aimed=current if flown.current_correction else 0.0j,
        currents=currents, shear=shear, east=shift[:, 0], north=shift[:, 1], lag=known.lag, ruled=ruled,
    )  # fmt: skip


def _steady(known: Behaviour) -> float:
    """Spread of the direction in rad while the glider steers as it is believed to."""
    best = max((one for one in known.steering if one.name != "held"), key=lambda one: one.belief)
    return best.law.sd


def _angle(value):
    return (value + math.pi) % (2.0 * math.pi) - math.pi


def _towards(situation: Situation, run) -> complex:
    """East + i north, m, to the waypoint that the run flies to first."""
    east, north = metres(*run.order[0], (situation.latitude, situation.longitude))
    return complex(east, north)


def _arrival(to: complex, current: Array, speed: Array, radius: float) -> Array:
    """Seconds after which each member is within the radius of the waypoint, along a straight way."""
    along = to / max(abs(to), 1.0)
    good = speed + current[:, 0] * along.real + current[:, 1] * along.imag
    return max(abs(to) - radius, 0.0) / np.maximum(good, 0.03)


def _successor(situation: Situation, point: tuple[float, float]) -> tuple[float, float] | None:
    return situation.behaviour.successors.get((round(point[0], 4), round(point[1], 4)))


def chain(situation: Situation) -> tuple[tuple[float, float], ...]:
    """The waypoint flown to and those that follow it, always the same number: what followed before follows again.

    After the last one known the glider turns back to where it is now. Without any it holds its direction.
    """
    here = (situation.latitude, situation.longitude)
    if situation.waypoint is None:
        angle = situation.behaviour.held_heading
        scale = math.degrees(_FAR / 6_371_000.0)
        far = (
            here[0] + scale * math.cos(angle),
            here[1] + scale * math.sin(angle) / max(math.cos(math.radians(here[0])), 0.05),
        )
        return (far,) * WAYPOINTS
    points = [situation.waypoint]
    while len(points) < WAYPOINTS:
        following = _successor(situation, points[-1])
        points.append(
            following if following is not None else (here if points[-1] != here else situation.waypoint)
        )
    return tuple(points)


def _mission(situation: Situation, given: Mission | None, speed: float, duration: Array) -> Mission:
    """The mission to fly: the given one at the glider's own rates, or one that imitates its habits."""
    known = situation.behaviour
    limits = (math.radians(5.1), math.radians(59.9))
    pitches = [float(np.clip(math.atan2(rate, speed), *limits)) for rate in (known.down, known.up)]
    if given is not None:
        yo = given.yo
        if known.segments:
            yo = replace(yo, dive_pitch=pitches[0], climb_pitch=pitches[1])
        return replace(given, yo=yo, surface_stay=known.stay, first_waypoint=target(given, situation))
    yo = Yo(known.dive_to, known.climb_to, pitches[0], pitches[1], dive_altitude=None, overshoot=0.0)
    # The rule counts from the dive; on average half a climb follows it.
    seconds = max(float(np.median(duration)) - 0.5 * known.dive_to / known.up, 120.0)
    return Mission(
        name=situation.name, waypoints=chain(situation), yo=yo, surface=(SurfaceRule("after", seconds=seconds),),
        waypoint_radius=_RADIUS, legs=-1, first_waypoint=0, surface_stay=known.stay,
        current_correction=known.aims_off,
    )  # fmt: skip


def target(mission: Mission, situation: Situation) -> int | None:
    """Index of the mission's waypoint that the glider flies to.

    The one nearest to what the glider says; where it says nothing, the one it last moved toward, or the next if it
    came up close to it; where that was days ago or never, None leaves the mission's own choice.
    """
    points = mission.waypoints
    if situation.waypoint is not None:
        return int(np.argmin([_gap(point, situation.waypoint) for point in points]))
    last = situation.segments[-1] if situation.segments else None
    if last is None or situation.time - last.end_time > 86400.0:
        return mission.first_waypoint
    start = (last.start_latitude, last.start_longitude)
    held = situation.behaviour.held_heading
    off = []
    for point in points:
        east, north = (float(v) for v in metres(*point, start))
        off.append(abs(_angle(math.atan2(east, north) - held)))
    best = int(np.argmin(off))
    near = _gap(points[best], (situation.latitude, situation.longitude)) < mission.waypoint_radius + _CLOSE
    return (best + 1) % len(points) if near else best


def _gap(one: tuple[float, float], other: tuple[float, float]) -> float:
    east, north = metres(*one, other)
    return math.hypot(float(east), float(north))


def _quiet(vehicle: Vehicle, speed: float) -> Vehicle:
    """The vehicle without the perturbations that a live forecast draws itself."""
    known = dict(vehicle.quantities)
    for name in ("heading", "speed", "current_error", "initial_position"):
        old = known[f"perturbation.{name}"]
        known[f"perturbation.{name}"] = Quantity(0.0, 0.0, old.unit, "drawn from the glider's own history")
    old = known["perturbation.surface_stay"]
    known["perturbation.surface_stay"] = Quantity(0.2, 0.0, old.unit, "judgement")
    return replace(vehicle, quantities=known)


def _nodes(known: Behaviour) -> tuple[Array, Array]:
    """Speeds of later dives: a normal law in the logarithm, as nodes and cumulative probabilities."""
    share = np.linspace(0.0, 1.0, 41)
    z = np.sqrt(2.0) * np.array([_inverse_erf(2.0 * min(max(p, 0.002), 0.998) - 1.0) for p in share])
    return np.exp(known.speed.centre + known.speed.sd * z), share


def _inverse_erf(x: float) -> float:
    """Inverse error function, good to 2e-3 (Winitzki 2008)."""
    part = math.log(max(1.0 - x * x, 1e-300))
    first = 2.0 / (math.pi * 0.147) + 0.5 * part
    return math.copysign(math.sqrt(math.sqrt(first * first - part / 0.147) - first), x)


def fly(scenario: Scenario) -> Flown:
    """Fly the members of a scenario."""
    from glider_jax.inference.flying import fly_scenario

    track = fly_scenario(scenario)
    when = track.surfacing_time[:, 0]
    place = np.nan_to_num((when - scenario.times[0]) / (scenario.times[1] - scenario.times[0]))
    low = np.clip(place.astype(int), 0, NODES - 2)
    part = np.clip(place - low, 0.0, 1.0)[:, None]
    rows = np.arange(when.size)
    water = scenario.currents + scenario.shear
    drift = water[rows, :, low] * (1.0 - part) + water[rows, :, low + 1] * part
    scale = math.degrees(1.0 / 6_371_000.0)
    latitude = track.surfacing_latitude[:, 0] + scale * drift[:, 1] * scenario.lag
    cosine = max(math.cos(math.radians(scenario.situation.latitude)), 0.02)
    longitude = track.surfacing_longitude[:, 0] + scale * drift[:, 0] * scenario.lag / cosine
    return Flown(track, when + scenario.lag, latitude, longitude, scenario)
