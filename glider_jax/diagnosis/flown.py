"""The ensemble before and after: the same mission flown with the base model and with what the diagnosis named.

Imports the mission layer and the scores. A newcomer would get wrong: growth and tides of the fitted terms count time
from the recording's first row, so the ensemble starts there; and the members are judged where and when the glider
really surfaced.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from glider_jax.config import Mission, Quantity, Vehicle
from glider_jax.environment import seawater
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.term import declared
from glider_jax.products.scores import crps, energy_score
from glider_jax.readers.dead_reckoning import finite, metres
from glider_jax.readers.dives import surfacings
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Recording, Source, WaterProfile

#: Members flown for each of the two, and the longest flight in s.
MEMBERS, LONGEST = 100, 4.0 * 86400.0
DAY = 86400.0


def compare(
    recording: Recording,
    before: Vehicle,
    after: Vehicle,
    mission: Mission | None,
    currents: CurrentGrid | None,
    bathymetry: BathymetryGrid | None,
    *,
    members: int = MEMBERS,
    seed: int = 0,
) -> dict[str, Any] | None:
    """Scores of two vehicles over one recording; None without a mission, fixes, or a surfacing to meet.

    Returns
    -------
    ``members``, ``surfacings``, ``hours``, ``recorded_charge_ah_per_day`` and for ``before`` and ``after``
    ``position_error_m`` (median miss of the mean member), ``energy_score_m`` (mean), ``charge_ah_per_day`` (median
    member) and ``charge_crps_ah_per_day``; what was not recorded is None.
    """
    truth = _surfaced(recording)
    if mission is None or not mission.waypoints or truth is None:
        return None
    begin, start, times, places = truth
    duration = min(float(times[-1] - begin) + 600.0, LONGEST)
    keep = times - begin <= duration
    times, places = times[keep], places[keep]
    if times.size == 0:
        return None
    recorded = charge_per_day(recording, begin, begin + duration)
    found: dict[str, Any] = {
        "members": members, "surfacings": int(times.size), "hours": duration / 3600.0,
        "recorded_charge_ah_per_day": recorded,
    }  # fmt: skip
    water = profile(recording)
    for name, vehicle in (("before", before), ("after", after)):
        track = _fly(mission, vehicle, currents, bathymetry, water, begin, start, duration, members, seed)
        found[name] = score(track, begin, times, places, recorded)
    return found


def fitted(vehicle: Vehicle, effects: list[dict[str, Any]]) -> Vehicle:
    """The vehicle with the named effects as terms, as the vehicle file of a diagnosis has them."""
    terms = {id: dict(values) for id, values in vehicle.terms.items()}
    for effect in effects:
        for one in effect["parameters"]:
            id, _, name = one["name"].rpartition(".")
            known = Quantity(one["value"], one["sd"], one["unit"], "diagnosis")
            terms.setdefault(id or effect["id"], {}).setdefault(name, known)
        for name, value in effect["shapes"].items():
            unit = declared(TERMS_BY_ID[effect["id"]])[name].unit
            terms.setdefault(effect["id"], {}).setdefault(name, Quantity(value, 0.0, unit, "diagnosis"))
    return replace(vehicle, terms=terms)


def _fly(mission, vehicle, currents, bathymetry, water, begin, start, duration, members, seed):
    from glider_jax.mission.forecast import forecast, prepare

    run = prepare(
        mission, vehicle, currents=currents, bathymetry=bathymetry, water=water, speed="flight", duration=duration,
        interval=600.0, seed=seed, start=begin, start_position=start,
    )  # fmt: skip
    return forecast(members, run)


def score(track: Any, begin: float, times: Array, places: Array, recorded: float | None) -> dict[str, float | None]:
    """How far the members of a track are from where and when the glider surfaced, and its charge per day."""
    misses, scores = [], []
    for moment, place in zip(times, places, strict=True):
        spot = np.array([np.interp(moment - begin, track.time - track.time[0], row) for row in track.latitude])
        east = np.array([np.interp(moment - begin, track.time - track.time[0], row) for row in track.longitude])
        x, y = metres(spot, east, (float(place[0]), float(place[1])))
        points = np.stack([x, y], axis=1)
        misses.append(float(np.hypot(*points.mean(axis=0))))
        scores.append(energy_score(points, np.zeros(2)))
    days = float(track.time[-1] - track.time[0]) / DAY
    charge = np.asarray(track.charge_used[:, -1], float) / 3600.0 / max(days, 1e-9)
    return {
        "position_error_m": float(np.median(misses)), "energy_score_m": float(np.mean(scores)),
        "charge_ah_per_day": float(np.median(charge)),
        "charge_crps_ah_per_day": None if recorded is None else crps(charge, recorded),
    }  # fmt: skip


def _surfaced(recording: Recording) -> tuple[float, tuple[float, float], Array, Array] | None:
    """First row and first fix, and times and places of the first fix of every later surfacing."""
    stays = [stay for stay in surfacings(recording) if stay.time.size]
    if len(stays) < 2:
        return None
    start = float(stays[0].latitude[0]), float(stays[0].longitude[0])
    later = [(stay.time[0], stay.latitude[0], stay.longitude[0]) for stay in stays[1:]]
    table = np.array(later, float)
    return float(recording.time[0]), start, table[:, 0], table[:, 1:]


def charge_per_day(recording: Recording, begin: float, end: float) -> float | None:
    """Ampere-hours a day that the counter counted between two times, or that the current sums to."""
    time, charge = finite(recording, "charge_used")
    mine = (time >= begin) & (time <= end)
    if mine.sum() > 10 and np.all(np.diff(charge[mine]) > -36.0):
        return float(np.ptp(charge[mine]) / 3600.0 / (np.ptp(time[mine]) / DAY))
    time, current = finite(recording, "current")
    mine = (time >= begin) & (time <= end)
    if mine.sum() < 100:
        return None
    step = np.diff(time[mine])
    good = step < 60.0
    return float(np.sum((current[mine][1:] * step)[good]) / 3600.0 / (step[good].sum() / DAY))


def profile(recording: Recording) -> WaterProfile | None:
    """Temperature and salinity by depth as the glider's own sensors met them; None without a CTD."""
    if "temperature" not in recording or "conductivity" not in recording:
        return None
    time, depth = finite(recording, "depth")
    good = np.isfinite(recording["temperature"]) & (recording["conductivity"] > 0.5)
    if good.sum() < 100 or depth.size < 100:
        return None
    at = np.maximum(np.interp(recording.time[good], time, depth), 0.0)
    celsius = recording["temperature"][good] - seawater.ZERO_CELSIUS
    pressure = seawater.pressure_dbar_from_depth(at, np.radians(_latitude(recording)))
    salt = np.asarray(seawater.practical_salinity(recording["conductivity"][good], celsius, pressure))
    sane = (salt > 1.0) & (salt < 43.0)
    salt = np.asarray(seawater.absolute_salinity(salt[sane]))
    theta = np.asarray(seawater.conservative_temperature(salt, celsius[sane], pressure[sane]))
    at = at[sane]
    edges = np.linspace(0.0, float(at.max()), max(3, min(40, int(at.max() / 5.0))) + 1)
    slot = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, edges.size - 2)
    rows = [k for k in range(edges.size - 1) if (slot == k).sum() >= 5]
    if len(rows) < 2:
        return None
    middle = np.array([0.5 * (edges[k] + edges[k + 1]) for k in rows])
    means = [np.array([np.median(values[slot == k]) for k in rows]) for values in (theta, salt)]
    return WaterProfile(middle, means[0], means[1], Source(f"CTD of {recording.name}"))


def _latitude(recording: Recording) -> float:
    for name in ("gps_latitude", "latitude"):
        _, values = finite(recording, name)
        if values.size:
            return float(np.median(values))
    return 45.0
