"""A flown mission simulated from its own files and compared with the recording: where, when, how deep, how much energy.

The published work left this comparison to the future. Each dive after the first is flown from what was known when it
began, three times with what one may believe of the current (what the glider last reckoned with, none, and the one
it then felt), and once with the current's course estimated from what was felt before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.environment.synthetic import synthetic_bathymetry
from glider_jax.products.coordinates import LocalFrame
from glider_jax.products.hindcast import cases_of
from glider_jax.products.validation import spread_of
from glider_jax.products.validation_energy import Split, fitted_vehicle, measured_split, simulated_split
from glider_jax.readers.dives import inflections, until
from glider_jax.readers.missions import read_mission
from glider_jax.readers.recordings import read_recording
from glider_jax.readers.segments import Segment
from glider_jax.readers.vehicles import read_vehicle
from glider_jax.records import Array, BathymetryGrid, Recording, Track

#: What the nearest peer reached on the first of these dives: km off by the current believed, minutes late.
PEER_KM = {"last": 6.1, "none": 2.7, "felt": 0.7}
PEER_MINUTES = 17.0
CURRENTS = ("last", "none", "felt", "estimated")
_RECENT = 6 * 3600.0
_HORIZON = 9.0 * 3600.0


@dataclass(frozen=True)
class FlownDive:
    """One dive simulated and flown; distances m, times s, energies J.

    ``miss`` by belief of the current: from the ensemble's middle to the first fix. ``late`` median simulated less true
    time of surfacing. ``turns`` and ``true_turns`` median depths of dive-to-climb turns, ``counts`` inflections
    simulated and flown. ``energy`` 5 %, median and 95 % until surfacing by the vehicle's loads, ``rate_energy`` by the
    charge the glider drew per hour before, ``true_energy`` from charge times voltage.
    ``inside`` whether the first fix lies in the 90 % region of the estimated current. ``simulated`` and ``measured``
    part the energy into motors and steady load; ``fitted_energy`` is 5 %, median and 95 % by loads fitted to the
    vehicle's last day before the dive, NaN where it had flown too little.
    """

    number: int
    start: float
    displacement: float
    miss: dict[str, float]
    late: float
    late_spread: tuple[float, float]
    turns: float
    true_turns: float
    counts: tuple[float, int]
    energy: tuple[float, float, float]
    rate_energy: float
    true_energy: float
    inside: bool
    notes: tuple[str, ...]
    simulated: Split | None = None
    measured: Split | None = None
    fitted_energy: tuple[float, float, float] = (math.nan, math.nan, math.nan)


def compare_flown(
    recording: Path | Recording,
    mission: Path | Mission,
    vehicle: Vehicle | None = None,
    *,
    n: int = 500,
    seed: int = 0,
) -> list[FlownDive]:
    """Simulate every dive after the first from the mission flown, and compare it with what happened.

    Parameters
    ----------
    recording, mission : as read, or where they lie.  vehicle : for energies; the bundled comet's if None.
    n : members per dive.  seed : of all draws.
    """
    flight = read_recording(recording) if isinstance(recording, Path) else recording
    plan = read_mission(mission) if isinstance(mission, Path) else mission
    vehicle = read_vehicle("slocum_g1_comet") if vehicle is None else vehicle
    pairs = cases_of(flight)
    return [_dive(flight, plan, vehicle, k, *pair, n=n, seed=seed + k) for k, pair in enumerate(pairs, start=1)]


def _dive(flight, plan: Mission, vehicle, number: int, before: Segment, truth: Segment, *, n: int, seed: int):
    from glider_jax.inference.evidence import situation_of
    from glider_jax.inference.live import assemble, fly
    from glider_jax.products.regions import inside, regions_of_metres

    notes = []
    situation = situation_of(replace(until(flight, truth.start_time), name=flight.name))
    if not situation.time - situation.surfaced < _RECENT:
        situation = replace(situation, surfaced=situation.time - plan.surface_stay)
        notes.append(f"surfacing before the dive not recorded: {plan.surface_stay:.0f} s at the surface assumed")
    reckoned = reckoned_current(flight, truth.start_time)
    if np.isfinite(reckoned):
        # Magnetic east and north turned to true: clockwise by the variation.
        turn = truth.variation.value if situation.variation is None else situation.variation.value
        situation = replace(situation, known_current=reckoned * complex(math.cos(turn), -math.sin(turn)))
    floor = measured_floor(flight, truth)
    if floor is not None:
        notes.append("seafloor: flat, at the depth that the glider's own altimeter found")
    scenario = assemble(
        situation, vehicle, n=n, seed=seed, mission=plan, bathymetry=floor, horizon=_HORIZON, interval=60.0
    )
    believed = {"last": situation.known_current, "none": 0j, "felt": complex(truth.current_east, truth.current_north)}
    frame = LocalFrame(truth.start_latitude, truth.start_longitude)
    goal = np.array(frame.to_metres(truth.end_latitude, truth.end_longitude))
    miss, flown = {}, None
    for name in CURRENTS:
        flown = fly(scenario if name == "estimated" else _with_current(scenario, believed[name]))
        cloud = np.stack(frame.to_metres(flown.fix_latitude, flown.fix_longitude), axis=1)
        cloud = cloud[np.isfinite(cloud).all(axis=1)]
        miss[name] = float(np.hypot(*(np.median(cloud, axis=0) - goal))) if len(cloud) else math.nan
    track = flown.track
    region = regions_of_metres(cloud, frame, (0.9,))[0]
    up = track.surfacing_time[:, 0]
    late = np.where(np.isfinite(up), up, np.inf) - truth.surface_time
    energy = track.energy.sum(-1)[np.arange(track.n), _row(track)]
    turns = [i.depth for i in inflections(flight) if truth.dive_time < i.time < truth.surface_time and _deep(i)]
    during = (flight.time >= truth.dive_time) & (flight.time <= truth.surface_time)
    volts = float(np.nanmean(flight["battery_voltage"][during]))
    drawn = truth.charge_used * volts
    own = fitted_vehicle(flight, truth.dive_time, vehicle)
    by_fit = (math.nan, math.nan, math.nan)
    if own is not None:
        again = fly(
            assemble(situation, own, n=n, seed=seed, mission=plan, bathymetry=floor, horizon=_HORIZON, interval=60.0)
        ).track
        by_fit = _spread(again.energy.sum(-1)[np.arange(again.n), _row(again)])
    return FlownDive(
        number=number, start=truth.start_time, displacement=math.hypot(truth.east, truth.north), miss=miss,
        late=spread_of(late)[1], late_spread=spread_of(late)[::2],
        turns=_mean_turn(track), true_turns=float(np.median(turns)),
        counts=(float(np.median(track.inflections[np.arange(track.n), _row(track)])), truth.inflections),
        energy=_spread(energy),
        rate_energy=situation.behaviour.charge_rate * float(np.nanmedian(flown.fix_time) - situation.time) * volts,
        true_energy=drawn, simulated=simulated_split(track, _row(track)),
        measured=measured_split(flight, truth.dive_time, truth.surface_time, drawn), fitted_energy=by_fit,
        inside=bool(inside(region, np.array([truth.end_latitude]), np.array([truth.end_longitude]))[0]),
        notes=tuple(notes),
    )  # fmt: skip


def _spread(values: Array) -> tuple[float, float, float]:
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return float(low), float(middle), float(high)


def _deep(inflection) -> bool:
    return inflection.kind == "dive_to_climb"


def _with_current(scenario, current: complex):
    """The same members in one steady current, m/s east + i north."""
    value = np.array([current.real, current.imag])[None, :, None]
    steady = np.broadcast_to(value, scenario.currents.shape).copy()
    return replace(scenario, currents=steady, shear=np.zeros_like(scenario.shear))


def reckoned_current(flight: Recording, moment: float) -> complex:
    """Current (m/s, magnetic east + i north) that the glider reckoned with when it dived; NaN without any that day."""
    parts = []
    for name in ("water_vx", "water_vy"):
        if name not in flight:
            return complex(math.nan, math.nan)
        known = np.isfinite(flight[name]) & (flight.time <= moment) & (flight.time > moment - 86400.0)
        parts.append(float(flight[name][known][-1]) if known.any() else math.nan)
    return complex(*parts)


def measured_floor(flight: Recording, truth: Segment) -> BathymetryGrid | None:
    """A flat seafloor at the depth the altimeter found in a dive; its deepest tenth, since fish echo above it."""
    if "water_depth" not in flight:
        return None
    during = (flight.time > truth.dive_time) & (flight.time < truth.surface_time) & np.isfinite(flight["water_depth"])
    if during.sum() < 5:
        return None
    depth = float(np.quantile(flight["water_depth"][during], 0.9))
    place = {"latitude": truth.start_latitude, "longitude": truth.start_longitude}
    return synthetic_bathymetry("flat", depth=depth, width=200e3, height=200e3, **place)


def _row(track: Track) -> Array:
    """(n,) first output at or after each member's first surfacing."""
    up = track.surfacing_time[:, 0]
    row = np.argmax(track.time[None, :] >= np.where(np.isfinite(up), up, track.time[-1])[:, None] - 1e-6, axis=1)
    return row


def _mean_turn(track: Track) -> float:
    """Depth of the turns, m: the deepest that each member was seen at, its median."""
    return float(np.median(track.depth.max(axis=1)))


def flown_lines(dives: Sequence[FlownDive]) -> list[str]:
    """The comparison as lines of a table in Markdown."""
    lines = [
        "| dive | moved km | last current km | no current km | current felt km | estimated km | in 90 % | min late | "
        "turns m, ours / flown | inflections | kJ, ours (5-95 %) / by its own rate / drawn |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        f"| peer, dive 1 | 3.45 | {PEER_KM['last']} | {PEER_KM['none']} | {PEER_KM['felt']} | - | - | "
        f"{PEER_MINUTES:.0f} | - | - | no energy |",
    ]
    for d in dives:
        miss = " | ".join(f"{d.miss[name] / 1e3:.1f}" for name in CURRENTS)
        energy = f"{d.energy[1] / 1e3:.1f} ({d.energy[0] / 1e3:.1f}-{d.energy[2] / 1e3:.1f})"
        lines.append(
            f"| {d.number} | {d.displacement / 1e3:.2f} | {miss} | {'yes' if d.inside else 'no'} | "
            f"{d.late / 60:+.1f} | {d.turns:.1f} / {d.true_turns:.1f} | {d.counts[0]:.0f} / {d.counts[1]} | "
            f"{energy} / {d.rate_energy / 1e3:.1f} / {d.true_energy / 1e3:.1f} |"
        )
    return lines
