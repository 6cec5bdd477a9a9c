"""Rows of a recording as the physics reads them: phase, settled glides, smoothed controls, water, time marks.

NumPy only. A newcomer would get wrong: noise in a recorded control is no physics, so pitch and pumped volume are
averaged along each settled glide; the slope of depth is never filtered, the model's response is put in instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.environment import seawater
from glider_jax.errors import DataError
from glider_jax.readers.dead_reckoning import Variation, finite, holes
from glider_jax.readers.dives import DESCENT, Leg
from glider_jax.records import Array, Recording

#: s; longer holes in a control are not bridged.
HOLE = 90.0
#: s; how long after the pump stopped a glide counts as settled, and over how long controls are averaged.
SETTLE, SMOOTHING = 30.0, 80.0
#: s; how long after a turn: at least the first, and up to the second where that is no more than a share of a half yo. A
#: glider with little lift carries small errors of its controls in a turn along for minutes.
AFTER_TURN, AT_MOST, SPARED = 60.0, 120.0, 0.25
#: s; how long after leaving the surface, from rest and with air about.
AFTER_SURFACE = 120.0
#: m and rad; shallower or flatter samples are not steady glides.
SHALLOWEST, FLATTEST = 4.0, 0.17
MOST_ROWS = 45_000
#: Least range of temperature, or of depth, that a dive and its climb share for a lag of the thermometer to be sought in
#: it, and standard errors by which pairs of them must agree better with the lag.
LEAST_KELVIN, LEAST_METRES, SURE = 0.5, 4.0, 4.0


@dataclass(frozen=True)
class Rows:
    """Rows with a depth, thinned; all arrays (row,), SI.

    ``leg`` is the index of the leg or -1, ``direction`` +1 climb, -1 dive, 0 surface. ``settled`` marks steady
    glides, ``controlled`` where pitch and pumped volume were recorded. ``since_turn`` s since the leg began,
    ``since_surfacing`` s since the glider left the surface.
    """

    time: Array
    depth: Array
    pitch: Array
    heading: Array
    roll: Array
    volume: Array
    temperature: Array
    density: Array
    battery_temperature: Array
    thruster: Array
    fin_rate: Array
    leg: Array
    direction: Array
    settled: Array
    since_turn: Array
    since_surfacing: Array
    turns: Array
    sampled: Array
    controlled: Array
    lag: float


def at(recording: Recording, name: str, time: Array, hole: float = HOLE) -> Array:
    """A channel linear in time at any moments; NaN in holes and where it was never recorded."""
    moments, values = finite(recording, name)
    if moments.size < 2:
        return np.full(time.size, np.nan)
    found = np.interp(time, moments, values)
    return np.where(holes(moments, time) <= hole, found, np.nan)


def rows_of(recording: Recording, ways: list[Leg], turn: Variation, latitude: float) -> Rows:
    """Prepare the rows of a recording.

    Raises
    ------
    DataError : depth or pitch were not recorded, or the glider never dived.
    """
    for name in ("depth", "pitch"):
        if finite(recording, name)[0].size < 30:
            raise DataError(
                f"{recording.name}: channel '{name}': expected at least 30 values, found "
                f"{finite(recording, name)[0].size}. A diagnosis replays depth and pitch; give a recording with both."
            )
    if not ways:
        raise DataError(
            f"{recording.name}: expected dives deeper than 5 m, found none. A diagnosis needs a glider that dived."
        )
    time, depth = finite(recording, "depth")
    keep = np.ones(time.size, bool)
    keep[1:] = np.diff(time) > 0.5
    stride = int(np.ceil(keep.sum() / MOST_ROWS))
    chosen = np.flatnonzero(keep)[::stride]
    time, depth = time[chosen], depth[chosen]
    leg = _leg_of(time, ways)
    phases = np.array([-1.0 if way.phase == DESCENT else 1.0 for way in ways])
    starts = np.array([way.start_time for way in ways])
    inside = leg >= 0
    direction = np.where(inside, phases[leg], 0.0)
    since_turn = np.where(inside, time - starts[leg], 0.0)
    new_dive = np.append(True, starts[1:] > np.array([way.end_time for way in ways])[:-1] + 1.0)
    block = 2 * np.cumsum(new_dive)[leg] + (direction > 0.0)
    dive_start = starts[np.maximum.accumulate(np.where(new_dive, np.arange(len(ways)), 0))]
    volume = at(recording, "pumped_volume", time)
    pitch = at(recording, "pitch", time)
    pumping = _pumping(recording, time, volume)
    settled = inside & ~pumping & (depth > SHALLOWEST) & (np.abs(pitch) > FLATTEST)
    settled &= np.sign(pitch) == direction
    settled &= _since_last(time, pumping | ~inside) > SETTLE
    ends = np.array([way.end_time for way in ways])
    settled &= since_turn > float(np.clip(SPARED * np.median(ends - starts), AFTER_TURN, AT_MOST))
    settled &= np.where(inside, ends[leg] - time, 0.0) > 10.0
    since_surfacing = np.where(inside, time - dive_start[leg], 0.0)
    settled &= since_surfacing > AFTER_SURFACE
    salinity_known, temperature, density, lag = _water(recording, time, depth, ways, latitude)
    heading = _heading(recording, time, turn)
    # Across a longer hole a control is no evidence, but what glides into the hole comes out of it.
    bridged = {name: np.nan_to_num(at(recording, name, time, np.inf)) for name in ("pitch", "pumped_volume")}
    fill = lambda name, other: np.nan_to_num(at(recording, name, time, 600.0), nan=other)  # noqa: E731
    battery = at(recording, "vehicle_temperature", time, 3600.0)
    return Rows(
        time=time,
        depth=depth,
        pitch=calm(time, bridged["pitch"], settled, leg, block),
        heading=heading,
        roll=fill("roll", 0.0),
        volume=calm(time, bridged["pumped_volume"], settled, leg, block),
        temperature=temperature,
        density=density,
        battery_temperature=np.where(np.isfinite(battery), battery, _lagged(time, temperature, 2400.0)),
        thruster=np.maximum(fill("thruster_power", 0.0), 0.0),
        fin_rate=_fin_rate(recording, time),
        leg=leg,
        direction=direction,
        settled=settled & salinity_known & np.isfinite(pitch) & (np.isfinite(volume)),
        since_turn=since_turn,
        since_surfacing=since_surfacing,
        turns=np.where(inside, leg, np.maximum.accumulate(leg)).astype(float),
        sampled=np.isfinite(pitch) & np.isfinite(heading),
        controlled=np.isfinite(pitch) & np.isfinite(volume),
        lag=lag,
    )


def _leg_of(time: Array, ways: list[Leg]) -> Array:
    starts = np.array([way.start_time for way in ways])
    ends = np.array([way.end_time for way in ways])
    place = np.searchsorted(starts, time, side="right") - 1
    return np.where((place >= 0) & (time <= ends[np.maximum(place, 0)]), place, -1)


def _pumping(recording: Recording, time: Array, volume: Array) -> Array:
    """Where the buoyancy pump runs: as flagged, or where the volume moves by over 2 % of its range a second."""
    moments, flag = finite(recording, "pump_moving")
    if moments.size > 0.5 * time.size and flag.max() > 0:
        place = np.clip(np.searchsorted(moments, time), 0, moments.size - 1)
        return (flag[place] > 0.5) | (flag[np.maximum(place - 1, 0)] > 0.5)
    reach = np.nanmax(volume) - np.nanmin(volume) if np.isfinite(volume).any() else 0.0
    rate = np.abs(np.gradient(np.nan_to_num(volume), time))
    return rate > max(0.005 * reach, 1e-9)


def _since_last(time: Array, event: Array) -> Array:
    """Seconds since an event was last true; infinite before the first."""
    last = np.maximum.accumulate(np.where(event, np.arange(time.size), -1))
    return np.where(last >= 0, time - time[np.maximum(last, 0)], np.inf)


def calm(time: Array, values: Array, settled: Array, leg: Array, block: Array) -> Array:
    """A control freed of its sensor's noise within settled glides; other rows as they are.

    What is left of the noise in a regressor would pass for weak drag at large angles and the like. Means of blocks are
    kept, deviations of a leg and of a minute from them are shrunk to the share of their variance that is not noise.
    """
    out = values.copy()
    rows = np.flatnonzero(settled)
    if rows.size < 20:
        return out
    t, v, own = time[rows], values[rows], leg[rows]
    near = np.diff(own) == 0
    steps = np.diff(v)[near]
    noise = 0.5 * min(float(np.mean(steps**2)), float((1.4826 * np.median(np.abs(steps))) ** 2)) if steps.size else 0.0
    first = np.searchsorted(own, own, side="left")
    last = np.searchsorted(own, own, side="right")
    size = (last - first).astype(float)
    total = np.concatenate([[0.0], np.cumsum(v)])
    whole = (total[last] - total[first]) / size
    spread = float(np.var(v - whole))
    reach = SMOOTHING if spread < 4.0 * noise else 0.3 * SMOOTHING
    low = np.maximum(np.searchsorted(t, t - 0.5 * reach), first)
    high = np.minimum(np.searchsorted(t, t + 0.5 * reach, side="right"), last)
    count = (high - low).astype(float)
    local = (total[high] - total[low]) / count
    _, code = np.unique(block[rows], return_inverse=True)
    level = (np.bincount(code, v) / np.bincount(code))[code]
    out[rows] = (
        level
        + _shrink(whole - level, noise / size) * (whole - level)
        + _shrink(local - whole, noise * (1.0 / count - 1.0 / size)) * (local - whole)
    )
    return out


def _shrink(deviation: Array, noise: Array) -> Array:
    """Share of each deviation that is signal, given the variance that noise alone would give it."""
    signal = max(float(np.mean(deviation**2) - np.mean(noise)), 0.0)
    return signal / np.maximum(signal + noise, 1e-30)


def _heading(recording: Recording, time: Array, turn: Variation) -> Array:
    moments, heading = finite(recording, "heading")
    if moments.size < 2:
        return np.full(time.size, np.nan)
    angle = np.interp(time, moments, np.unwrap(heading))
    return np.where(holes(moments, time) <= 300.0, (angle - turn.value) % (2.0 * np.pi), np.nan)


def _water(
    recording: Recording, time: Array, depth: Array, ways: list[Leg], latitude: float
) -> tuple[Array, Array, Array, float]:
    """Where the CTD was sampled, temperature K, density kg m-3, lag s; else a recorded density, or constants."""
    names = ("temperature", "conductivity")
    if not all(name in recording for name in names):
        temperature = np.nan_to_num(at(recording, "temperature", time, 600.0), nan=283.15)
        own = at(recording, "water_density", time, HOLE)
        if np.isfinite(own).sum() >= 30:
            return np.isfinite(own), temperature, np.where(np.isfinite(own), own, np.nanmedian(own)), 0.0
        pressure = seawater.pressure_dbar_from_depth(np.maximum(depth, 0.0), latitude)
        return np.ones(time.size, bool), temperature, np.asarray(seawater.density(35.0, 10.0, pressure)), 0.0
    good = np.isfinite(recording["temperature"]) & np.isfinite(recording["conductivity"])
    good &= recording["conductivity"] > 0.5
    moments = recording.time[good]
    celsius, cell = recording["temperature"][good] - seawater.ZERO_CELSIUS, recording["conductivity"][good]
    if moments.size < 30:
        raise DataError(
            f"{recording.name}: channel 'conductivity': expected values above 0.5 S m-1, found {moments.size}. "
            "Check the unit (S m-1); without a CTD leave the channel out."
        )
    lag = thermometer_lag(moments, celsius, cell, time, depth, ways, latitude)
    celsius = np.interp(moments + lag, moments, celsius)
    here = seawater.pressure_dbar_from_depth(np.interp(moments, time, np.maximum(depth, 0.0)), latitude)
    salinity = np.asarray(seawater.practical_salinity(cell, celsius, here))
    sane = np.isfinite(salinity) & (salinity > 1.0) & (salinity < 43.0)
    moments, celsius, salinity = moments[sane], celsius[sane], salinity[sane]
    if moments.size < 2:
        raise DataError(
            f"{recording.name}: channel 'conductivity': expected values that give a salinity of 1 to 43, found none. "
            "Check the unit (S m-1); without a CTD leave the channel out."
        )
    warm, salt = np.interp(time, moments, celsius), np.interp(time, moments, salinity)
    absolute = seawater.absolute_salinity(salt)
    pressure = seawater.pressure_dbar_from_depth(np.maximum(depth, 0.0), latitude)
    theta = seawater.conservative_temperature(absolute, warm, pressure)
    near = holes(moments, time) <= HOLE
    return near, warm + seawater.ZERO_CELSIUS, np.asarray(seawater.density(absolute, theta, pressure)), lag


def thermometer_lag(
    moments: Array, celsius: Array, cell: Array, time: Array, depth: Array, ways: list[Leg], latitude: float
) -> float:
    """Seconds by which the thermometer lags the conductivity cell: those that make dives and climbs agree in salinity.

    A second of lag in a sharp thermocline is 0.2 of salinity, 10 g of buoyancy of opposite sign on dives and climbs.
    They are compared in water of the same temperature, since layers heave between a dive and its climb; only where the
    temperature hardly changes are they compared at the same depth.
    """
    pairs = []
    for one, two in zip(ways[:-1], ways[1:], strict=True):
        if one.phase == DESCENT and one.end_time == two.start_time:
            down = np.flatnonzero((moments > one.start_time + 30.0) & (moments < one.end_time - 15.0))
            up = np.flatnonzero((moments > two.start_time + 45.0) & (moments < two.end_time - 10.0))
            if down.size >= 6 and up.size >= 6:
                pairs.append((down, up))
    pairs = pairs[:: max(1, len(pairs) // 60)]
    at_depth = np.interp(moments, time, np.maximum(depth, 0.0))
    warm = [pair for pair in pairs if _shared(celsius, *pair) > LEAST_KELVIN]
    deep = [pair for pair in pairs if _shared(at_depth, *pair) > LEAST_METRES]
    pairs = warm if len(warm) >= 4 else deep
    if len(pairs) < 4:
        return 0.0
    pressure = seawater.pressure_dbar_from_depth(at_depth, latitude)
    used = np.unique(np.concatenate([part for pair in pairs for part in pair]))

    def disagreement(lag: float) -> Array:
        shifted = np.interp(moments[used] + lag, moments, celsius)
        salinity = np.asarray(seawater.practical_salinity(cell[used], shifted, pressure[used]))
        along = shifted if pairs is warm else at_depth[used]
        found = []
        for down, up in pairs:
            i, j = np.searchsorted(used, down), np.searchsorted(used, up)
            low, high = max(along[i].min(), along[j].min()), min(along[i].max(), along[j].max())
            levels = np.linspace(low, high, 26)[1:-1]
            p, q = i[np.argsort(along[i])], j[np.argsort(along[j])]
            miss = np.interp(levels, along[p], salinity[p]) - np.interp(levels, along[q], salinity[q])
            found.append(float(np.mean(miss**2)))
        return np.array(found)

    trials = np.arange(-1.0, 4.01, 0.25)
    each = np.array([disagreement(float(lag)) for lag in trials])
    found = each.mean(axis=1)
    best = int(np.argmin(found))
    if not np.isfinite(found).all() or best in (0, trials.size - 1):
        return 0.0
    # Where the water is not layered nothing tells the lag, and nothing depends on it: all pairs have to ask for it.
    better = each[4] - each[best]
    if better.mean() < SURE * better.std(ddof=1) / np.sqrt(better.size) or found[best] > 0.9 * found[4]:
        return 0.0
    a, b, c = found[best - 1 : best + 2]
    return float(trials[best] + 0.125 * (a - c) / max(a - 2.0 * b + c, 1e-30))


def _shared(along: Array, down: Array, up: Array) -> float:
    """Range of a series that a dive and its climb have in common."""
    return float(min(along[down].max(), along[up].max()) - max(along[down].min(), along[up].min()))


def _lagged(time: Array, values: Array, tau: float) -> Array:
    """First-order lag of a series: what the inside of a hull feels of the water."""
    coarse = np.arange(time[0], time[-1] + 60.0, 60.0)
    mean = np.interp(coarse, time, values)
    out, share = np.empty_like(mean), 1.0 - np.exp(-60.0 / tau)
    state = mean[: max(1, int(tau / 60.0))].mean()
    for i, value in enumerate(mean):
        state += share * (value - state)
        out[i] = state
    return np.interp(time, coarse, out)


def _fin_rate(recording: Recording, time: Array) -> Array:
    """Mean absolute rate of the rudder over five minutes, rad s-1; zero where it was not recorded."""
    moments, fin = finite(recording, "fin")
    if moments.size < 30:
        return np.zeros(time.size)
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(fin)))])
    low, high = np.interp(time - 150.0, moments, travel), np.interp(time + 150.0, moments, travel)
    return (high - low) / 300.0
