"""Independent looks at real recordings: what the diagnosis must find, from raw channels and a steady glide alone.

NumPy and SciPy; no physics term and no inference is imported. A newcomer would get wrong: means over two missions
compare what somebody switched, not what a device draws; differences of successive cycles do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from glider_jax.diagnosis.proof.strength import steady
from glider_jax.environment import seawater
from glider_jax.readers.dead_reckoning import finite
from glider_jax.readers.dives import DESCENT, legs
from glider_jax.records import Array, Recording

GRAVITY = 9.8144
AREA, LIFT, INDUCED, COMPRESSIBILITY = 0.1, 7.53, 10.5, 5e-10
#: m s-1; scatter of vertical speed over 16 s, and of an acoustic profiler's speed.
SD_RISE, SD_SPEED = 0.009, 0.012


@dataclass(frozen=True)
class Measured:
    """An independent number: value, standard error, unit."""

    value: float
    error: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:.3g} +- {self.error:.2g} {self.unit}".strip()


def samples(recording: Recording, low: float, high: float, after: float = 60.0) -> dict[str, Array]:
    """Settled samples between two depths, m, ``after`` s past each turn: pitch, density, volume, rise, leg, speed."""
    time, depth = finite(recording, "depth")
    ways = legs(recording)
    rise = -_slope(time, depth, 8.0)
    number = np.full(time.size, -1)
    for k, way in enumerate(ways):
        number[(time > way.start_time + after) & (time < way.end_time - 10.0)] = k
    at = {n: _at(recording, n, time) for n in ("pitch", "pumped_volume")}
    pressure = np.asarray(seawater.pressure_from_depth(np.maximum(depth, 0.0), np.radians(54.0)))
    density = _density(recording, time, depth)
    use = (number >= 0) & (depth > low) & (depth < high) & np.isfinite(density) & np.isfinite(at["pitch"])
    use &= np.sign(at["pitch"]) == np.sign(rise)
    use &= np.abs(np.abs(at["pumped_volume"]) - np.nanmax(np.abs(at["pumped_volume"]))) < 12e-6
    index = np.flatnonzero(use)[::4]
    speed = np.full(time.size, np.nan)
    if "measured_speed" in recording:
        speed = recording["measured_speed"][np.searchsorted(recording.time, time)]
    return {
        "pitch": at["pitch"][index], "volume": at["pumped_volume"][index], "density": density[index],
        "pressure": pressure[index], "rise": rise[index], "leg": number[index], "speed": speed[index],
    }  # fmt: skip


def flight(s: dict[str, Array], p: Array, volume: float, gain: float = 0.0) -> tuple[Array, Array]:
    """Rise and speed along the path of a steady glide; ``p`` mass kg and drag coefficient."""
    whole = volume * (1.0 - COMPRESSIBILITY * s["pressure"]) + s["volume"]
    push = GRAVITY * (s["density"] * whole - p[0])
    drag = np.full(whole.size, p[1])
    rise, along = steady(push, s["pitch"] * (1.0 + gain), s["density"], drag, INDUCED, LIFT, AREA)
    return rise, np.hypot(rise, along)


def drag_of(s: dict[str, Array], volume: float, mass: float) -> Measured:
    """Drag coefficient from vertical speed, mass free beside it; error by leaving out one half yo after the other."""

    def fit(use: Array) -> float:
        part = {k: v[use] for k, v in s.items()}
        found = least_squares(
            lambda p: (flight(part, p, volume)[0] - part["rise"]) / SD_RISE, [mass, 0.2], x_scale=[0.02, 0.02]
        )
        return float(found.x[1])

    own = np.unique(s["leg"])
    parts = [fit(~np.isin(s["leg"], group)) for group in np.array_split(own, min(10, own.size))]
    n = len(parts)
    return Measured(
        fit(np.ones(s["leg"].size, bool)), float(np.sqrt((n - 1) / n * np.sum((parts - np.mean(parts)) ** 2))), ""
    )


def pitch_scale(recording: Recording, volume: float, corrupt: int) -> dict[str, Measured]:
    """Pitch gain and drag coefficient of a recording with a measured speed; held-out rms over the second half."""
    s = samples(recording, 10.0, 35.0)
    good = s["leg"] != corrupt
    train, test = good & (s["leg"] < 18), good & (s["leg"] >= 18)
    mass = float(np.mean(s["density"])) * volume

    def fit(use: Array, free: int, speed: bool = True) -> Array:
        part = {k: v[use] for k, v in s.items()}

        def left(p: Array) -> Array:
            rise, along = flight(part, p, volume, p[2] if free > 2 else 0.0)
            found = [(rise - part["rise"]) / SD_RISE]
            if speed:
                found.append(((along - part["speed"]) / SD_SPEED)[np.isfinite(part["speed"])])
            return np.concatenate(found)

        return least_squares(left, [mass, 0.15, 0.0][:free], x_scale=[0.02, 0.02, 0.05][:free])

    found = fit(good, 3)
    spread = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)) * 10.0)
    part = {k: v[test] for k, v in s.items()}
    told = {
        "gain": Measured(float(found.x[2]), float(spread[2]), ""),
        "drag": Measured(float(found.x[1]), float(spread[1]), ""),
        "drag by vertical speed alone": Measured(float(fit(good, 2, speed=False).x[1]), 0.0, ""),
    }
    for name, fitted, gain in (("before", fit(train, 2), 0.0), ("after", fit(train, 3), None)):
        rise, along = flight(part, fitted.x, volume, fitted.x[2] if gain is None else gain)
        told[f"rise rms {name}"] = Measured(float(100.0 * np.sqrt(np.mean((rise - part["rise"]) ** 2))), 0.0, "cm/s")
        told[f"speed rms {name}"] = Measured(
            float(100.0 * np.sqrt(np.nanmean((along - part["speed"]) ** 2))), 0.0, "cm/s"
        )
    return told


def loads(recording: Recording) -> dict[str, Measured]:
    """Mean power on dives and on climbs, W, while pump and pitch motor stand still; error between half yos."""
    time, current = finite(recording, "current")
    quiet = _quiet(recording, time)
    voltage = float(np.median(finite(recording, "battery_voltage")[1]))
    means: dict[int, list[float]] = {}
    for way in legs(recording):
        mine = quiet & (time > way.start_time + 40.0) & (time < way.end_time - 20.0)
        if mine.sum() >= 10:
            means.setdefault(way.phase, []).append(float(current[mine].mean()) * voltage)
    return {
        "dives" if phase == DESCENT else "climbs": Measured(
            float(np.mean(v)), float(np.std(v, ddof=1) / np.sqrt(len(v))), "W"
        )
        for phase, v in means.items()
    }


def pump_slope(recording: Recording) -> tuple[Measured, int]:
    """J per metre by which a stroke out costs more the deeper it is, and the number of strokes; bootstrap error."""
    time, current = finite(recording, "current")
    moving = finite(recording, "pump_moving")
    running = np.interp(time, *moving) > 0.0
    step = np.clip(np.diff(time, append=time[-1]), 0.0, 30.0)
    voltage = np.interp(time, *finite(recording, "battery_voltage"))
    points = []
    for one, two in zip(legs(recording)[:-1], legs(recording)[1:], strict=True):
        if one.phase != DESCENT or one.end_time != two.start_time:
            continue
        near = np.abs(time - one.end_time) < 60.0
        stroke = near & running
        rest = (np.abs(time - one.end_time) < 150.0) & ~running & _quiet(recording, time)
        if stroke.sum() < 3 or rest.sum() < 5:
            continue
        idle = float(np.median(current[rest]))
        points.append((one.end_depth, float(np.sum((current - idle)[stroke] * voltage[stroke] * step[stroke]))))
    table = np.array(points)
    sane = np.abs(table[:, 1] - np.median(table[:, 1])) < 4.0 * 1.4826 * np.median(
        np.abs(table[:, 1] - np.median(table[:, 1]))
    )
    table = table[sane]
    rng = np.random.default_rng(3)
    slopes = [np.polyfit(*table[rng.integers(0, len(table), len(table))].T, 1)[0] for _ in range(500)]
    return Measured(float(np.polyfit(*table.T, 1)[0]), float(np.std(slopes)), "J/m"), len(table)


def fin_current(recording: Recording) -> dict[str, Measured]:
    """mA that cycles with a moving fin seem to draw: by means, by pairs of successive cycles, and a cycle off."""
    time, current = finite(recording, "current")
    fin = _at(recording, "fin", time)
    quiet = _quiet(recording, time)
    inside = np.zeros(time.size, bool)
    for way in legs(recording):
        inside |= (time > way.start_time + 40.0) & (time < way.end_time - 20.0)
    moved = np.abs(np.diff(fin, prepend=fin[0])) > 0.005
    use = quiet & inside & np.isfinite(fin)
    found: dict[str, Measured] = {}
    few = min(int((use & moved).sum()), int((use & ~moved).sum()))
    if few < 30:
        return found
    plain = 1e3 * (current[use & moved].mean() - current[use & ~moved].mean())
    found["means"] = Measured(float(plain), float(1e3 * current[use].std() / np.sqrt(few)), "mA")
    for name, shift in (("paired", 0), ("placebo, one cycle later", 1), ("placebo, one cycle earlier", -1)):
        flag = np.roll(moved, shift)
        pair = use[1:] & use[:-1] & (flag[1:] != flag[:-1]) & (np.diff(time) < 10.0)
        difference = 1e3 * np.where(flag[1:], 1.0, -1.0)[pair] * np.diff(current)[pair]
        if difference.size >= 30:
            error = difference.std() / np.sqrt(difference.size)
            found[name] = Measured(float(difference.mean()), float(error), "mA")
    return found


def _quiet(recording: Recording, time: Array) -> Array:
    """Cycles in which neither buoyancy pump nor pitch motor ran, nor in the one before."""
    busy = np.zeros(time.size, bool)
    for name in ("pump_moving", "m_is_battpos_moving"):
        moments, flag = finite(recording, name)
        if moments.size:
            place = np.clip(np.searchsorted(moments, time), 0, moments.size - 1)
            busy |= (flag[place] > 0.0) | (flag[np.maximum(place - 1, 0)] > 0.0)
    return ~busy


def _at(recording: Recording, name: str, time: Array) -> Array:
    moments, values = finite(recording, name)
    if moments.size < 2:
        return np.full(time.size, np.nan)
    return np.interp(time, moments, values)


def _density(recording: Recording, time: Array, depth: Array) -> Array:
    if "water_density" in recording:
        return _at(recording, "water_density", time)
    celsius, cell = _at(recording, "temperature", time) - 273.15, _at(recording, "conductivity", time)
    pressure = seawater.pressure_dbar_from_depth(np.maximum(depth, 0.0), np.radians(54.0))
    salt = seawater.absolute_salinity(np.asarray(seawater.practical_salinity(cell, celsius, pressure)))
    theta = seawater.conservative_temperature(salt, celsius, pressure)
    density = np.asarray(seawater.density(salt, theta, pressure))
    return np.where(cell > 0.5, density, np.nan)


def _slope(time: Array, values: Array, reach: float) -> Array:
    low, high = np.searchsorted(time, time - reach), np.searchsorted(time, time + reach, "right")
    found = np.zeros(time.size)
    for k in range(time.size):
        t, z = time[low[k] : high[k]] - time[k], values[low[k] : high[k]]
        if t.size > 2:
            found[k] = np.sum((t - t.mean()) * z) / np.sum((t - t.mean()) ** 2)
    return found
