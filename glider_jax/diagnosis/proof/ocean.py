"""Oceans for concealed cases: stratification, currents with their products, vertical motion and seafloor.

Imports NumPy and sea-water density. Positions are metres east and north of the first waypoint, times seconds since
the mission began, velocities east, north and **up**. What the product gives and what the water does differ by noise
and by motion that no product resolves, so that a mission without any left-out physics still has red residuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.environment.seawater import density, practical_salinity, temperature_from_conservative

Array = NDArray[np.float64]

M2 = 1.405189e-4
S2 = 1.454441e-4
K1 = 7.2921159e-5
EARTH_ROTATION = 7.2921159e-5
SALINITY_RATIO = 35.16504 / 35.0
HOUR = 3600.0
DAY = 86400.0
TABLE_STEP = 0.5  # m between the depths of a density table
_AXIS = 6378137.0
_FLATNESS = 1.0 / 298.257223563


def metres_per_degree(latitude: float) -> tuple[float, float]:
    """Metres per degree of latitude and of longitude on the WGS 84 ellipsoid; ``latitude`` in degrees."""
    e2 = _FLATNESS * (2.0 - _FLATNESS)
    s = math.sin(math.radians(latitude))
    w = math.sqrt(1.0 - e2 * s * s)
    meridian = _AXIS * (1.0 - e2) / w**3
    return math.radians(meridian), math.radians(_AXIS / w * math.cos(math.radians(latitude)))


def red_noise(rng: np.random.Generator, count: int, step: float, sd: float, scale: float) -> Array:
    """Ornstein-Uhlenbeck samples every ``step`` s, standard deviation ``sd``, e-folding time ``scale`` s."""
    keep = math.exp(-step / scale)
    kick = rng.standard_normal(count) * sd * math.sqrt(1.0 - keep * keep)
    out = np.empty(count)
    value = sd * rng.standard_normal()
    for i, k in enumerate(kick.tolist()):
        value = keep * value + k
        out[i] = value
    return out


@dataclass(frozen=True)
class Region:
    """Climate of a place: everything that a season and a shelf decide. Temperatures degC, salinities practical."""

    name: str
    latitude: float
    longitude: float
    start: float
    waypoints: tuple[tuple[float, float], ...]  # km east and north of the first
    depth: float
    slope: float  # m deeper per km offshore
    offshore: float  # direction in which it deepens, degrees clockwise from north
    roughness: float  # m
    surface_temperature: float
    deep_temperature: float
    surface_salinity: float
    deep_salinity: float
    thermocline: float
    thickness: float
    mean_flow: tuple[float, float]
    eddies: float  # standard deviation of the slow currents, m s-1
    tide: tuple[float, float]  # M2 amplitudes that the product knows, m s-1


class Ocean:
    """One realisation of a region for a mission of ``duration`` seconds."""

    def __init__(self, region: Region, rng: np.random.Generator, duration: float, *, quiet: bool = False):
        self.region = region
        self.duration = duration
        self.metres_north, self.metres_east = metres_per_degree(region.latitude)
        self.hours = int(duration / HOUR) + 14
        self._currents(rng)
        self._stratification(rng)
        self.vertical = self._vertical(rng, int(duration) + 1) * (0.0 if quiet else 1.0)
        bumps = 7
        self._bump = rng.uniform(0, 2 * np.pi, (2, bumps))
        self._bump_k = 2 * np.pi / rng.uniform(3e3, 25e3, bumps)
        self._bump_a = region.roughness * rng.standard_normal(bumps) / math.sqrt(bumps)

    def _currents(self, rng: np.random.Generator) -> None:
        modes = 5
        steps = self.hours + 1
        self.start_hour = -6  # the product begins before the mission
        self.amplitude = np.stack(
            [
                [red_noise(rng, steps, HOUR, self.region.eddies / math.sqrt(modes), rng.uniform(14, 50) * HOUR)
                 for _ in range(modes)]
                for _ in range(2)
            ]
        )  # fmt: skip
        length = rng.uniform(35e3, 150e3, modes)
        angle = rng.uniform(0, 2 * np.pi, modes)
        self.wave = np.stack([np.cos(angle), np.sin(angle)]) * 2 * np.pi / length
        self.phase = rng.uniform(0, 2 * np.pi, (2, modes))
        self.tide_phase = rng.uniform(0, 2 * np.pi, 2)
        steps = int(self.duration / 600) + 3
        # What no product resolves: a slow part and eddies of an hour or two.
        self.unresolved = np.stack(
            [red_noise(rng, steps, 600, 0.004, 12 * HOUR) + red_noise(rng, steps, 600, 0.008, 1.5 * HOUR)
             for _ in range(2)]
        )  # fmt: skip

    def resolved(self, east: Array, north: Array, time: Array) -> tuple[Array, Array]:
        """Velocity that a perfect surface product would give, m s-1 east and north; arrays that broadcast."""
        east, north, time = np.broadcast_arrays(
            np.asarray(east, float), np.asarray(north, float), np.asarray(time, float)
        )
        position = time / HOUR - self.start_hour
        low = np.clip(position.astype(int), 0, self.amplitude.shape[-1] - 2)
        share = np.clip(position - low, 0.0, 1.0)
        out = []
        for c in range(2):
            total = np.full(east.shape, self.region.mean_flow[c])
            for j in range(self.wave.shape[1]):
                a = self.amplitude[c, j]
                shape = 0.6 + 0.8 * np.cos(
                    self.wave[0, j] * east + self.wave[1, j] * north + self.phase[c, j]
                )
                total = total + (a[low] * (1.0 - share) + a[low + 1] * share) * shape
            total = total + self.region.tide[c] * np.cos(M2 * time + self.tide_phase[c])
            out.append(total)
        return out[0], out[1]

    def flow(self, east: float, north: float, time: float) -> tuple[float, float]:
        """Velocity of the upper water with what no product resolves, m s-1."""
        u, v = self.resolved(np.array(east), np.array(north), np.array(time))
        position = max(time, 0.0) / 600.0
        i = min(int(position), self.unresolved.shape[1] - 2)
        s = position - i
        extra = self.unresolved[:, i] * (1.0 - s) + self.unresolved[:, i + 1] * s
        return float(u) + float(extra[0]), float(v) + float(extra[1])

    def _stratification(self, rng: np.random.Generator) -> None:
        r = self.region
        self.shift = red_noise(rng, int(self.duration / 600) + 3, 600, 1.2, 9 * HOUR)
        self._thermocline = r.thermocline * rng.uniform(0.85, 1.15)
        self._thickness = r.thickness * rng.uniform(0.8, 1.25)
        self._warmth = rng.normal(0.0, 0.6)

    def profile(self, depth: Array, time: float) -> tuple[Array, Array]:
        """Conservative temperature degC and practical salinity at ``depth`` m."""
        r = self.region
        i = min(int(max(time, 0.0) / 600), self.shift.size - 1)
        centre = self._thermocline + self.shift[i]
        step = 0.5 * (1.0 + np.tanh((depth - centre) / self._thickness))
        day = 0.35 * math.sin(2 * math.pi * time / DAY - 1.0) * np.exp(-np.maximum(depth, 0.0) / 4.0)
        slope = -0.004 * np.maximum(depth - centre, 0.0)
        warm = r.surface_temperature + self._warmth
        temperature = warm + (r.deep_temperature - warm) * step + slope + day
        salinity = r.surface_salinity + (r.deep_salinity - r.surface_salinity) * step
        return np.maximum(temperature, 1.0), salinity

    def table(self, time: float, deepest: float = 420.0) -> tuple[Array, Array]:
        """In-situ density kg m-3 and temperature degC every ``TABLE_STEP`` m from the surface."""
        depth = np.arange(0.0, deepest, TABLE_STEP)
        temperature, salinity = self.profile(depth, time)
        return np.asarray(density(salinity * SALINITY_RATIO, temperature, pressure_of(depth))), temperature

    def _vertical(self, rng: np.random.Generator, count: int) -> Array:
        """Vertical water velocity per second, m s-1 up: red noise and bursts of internal waves."""
        coarse = red_noise(rng, count // 20 + 2, 20.0, 0.0030, 300.0)
        w = np.interp(np.arange(count), np.arange(coarse.size) * 20.0, coarse)
        second = np.arange(count, dtype=float)
        for _ in range(rng.poisson(self.duration / DAY * 2.0)):
            centre, width = rng.uniform(0, count), rng.uniform(1200, 4000)
            period, size = rng.uniform(420, 1100), rng.uniform(0.004, 0.014)
            envelope = np.exp(-0.5 * ((second - centre) / width) ** 2)
            w += size * envelope * np.sin(2 * np.pi * second / period + rng.uniform(0, 2 * np.pi))
        return w

    def bottom(self, east: Array, north: Array) -> Array:
        """Water depth, m; never less than 12."""
        r = self.region
        a = math.radians(r.offshore)
        offshore = (np.asarray(east) * math.sin(a) + np.asarray(north) * math.cos(a)) / 1e3
        base = r.depth + r.slope * offshore
        rough = 0.0
        for j in range(self._bump_k.size):
            k, d = self._bump_k[j], self._bump[1, j]
            rough = rough + self._bump_a[j] * np.cos(
                k * (np.asarray(east) * np.cos(d) + np.asarray(north) * np.sin(d)) + self._bump[0, j]
            )
        return np.maximum(base + rough, 12.0)


def pressure_of(depth: Array) -> Array:
    """Sea pressure in dbar at ``depth`` m: 1.0080 dbar per metre near the surface, growing slowly."""
    return 1.00795 * depth + 2.4e-6 * depth * depth


def conductivity(salinity: Array, temperature: Array, pressure_dbar: Array) -> Array:
    """Conductivity S m-1 of a practical salinity: the inverse of PSS-78 by secant steps."""
    low = np.full(np.shape(salinity), 2.5)
    high = np.full(np.shape(salinity), 5.0)
    f_low = practical_salinity(low, temperature, pressure_dbar) - salinity
    f_high = practical_salinity(high, temperature, pressure_dbar) - salinity
    for _ in range(12):
        slope = f_high - f_low
        step = np.where(
            np.abs(slope) > 1e-14, f_high * (high - low) / np.where(slope == 0.0, 1.0, slope), 0.0
        )
        low, f_low = high, f_high
        high = np.clip(high - step, 0.5, 9.0)
        f_high = practical_salinity(high, temperature, pressure_dbar) - salinity
    return high


def in_situ_temperature(salinity: Array, conservative: Array, pressure_dbar: Array) -> Array:
    """In-situ temperature degC of a conservative temperature degC."""
    return np.asarray(temperature_from_conservative(salinity * SALINITY_RATIO, conservative, pressure_dbar))
