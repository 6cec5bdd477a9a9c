"""Longitude and latitude to local metres and back, on the WGS84 ellipsoid.

Positions inside the compiled step are ``east`` and ``north`` offsets in metres from an origin, because float32 holds
a longitude of 150 degrees only to 1.7 m. Both are linear in longitude and latitude (so a regular grid stays regular);
the price is that one metre travelled at another latitude is not one metre of ``east``. ``Frame.stretch`` gives the
two factors, and every velocity passes through them. Newcomers forget this when they subtract positions.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

_SEMI_MAJOR = 6378137.0
_ECCENTRICITY2 = 6.69437999014e-3
_DEGREE = np.pi / 180.0
_ORDER = 4


def _radii(latitude):
    """Radii of curvature, m: along the meridian, and across it times the cosine of latitude."""
    sine = np.sin(latitude * _DEGREE)
    root = np.sqrt(1.0 - _ECCENTRICITY2 * sine**2)
    meridian = _SEMI_MAJOR * (1.0 - _ECCENTRICITY2) / root**3
    parallel = _SEMI_MAJOR / root * np.cos(latitude * _DEGREE)
    return meridian, parallel


class Frame(eqx.Module):
    """A local frame: where its origin lies and how metres on the ground become metres of the frame.

    Parameters
    ----------
    latitude, longitude : origin, degrees.
    south, north : latitudes between which the stretch polynomials are fitted, degrees; outside, they are
        extrapolated and soon wrong, so give the whole area a mission may reach.
    """

    latitude: float = eqx.field(static=False)
    longitude: float = eqx.field(static=False)
    metres_per_degree: Any
    half_height: Any
    east_stretch: Any
    north_stretch: Any

    def __init__(self, latitude: float, longitude: float, south: float | None = None, north: float | None = None):
        south = latitude - 3.0 if south is None else min(south, latitude - 0.1)
        north = latitude + 3.0 if north is None else max(north, latitude + 0.1)
        meridian, parallel = _radii(latitude)
        self.latitude = float(latitude)
        self.longitude = float(longitude)
        self.metres_per_degree = np.array([parallel * _DEGREE, meridian * _DEGREE])
        nodes = 0.5 * (south + north) + 0.5 * (north - south) * np.cos(np.pi * (np.arange(24) + 0.5) / 24)
        half = max(abs(north - latitude), abs(south - latitude)) * self.metres_per_degree[1]
        y = (nodes - latitude) * self.metres_per_degree[1] / half
        there = _radii(nodes)
        self.half_height = np.float64(half)
        self.north_stretch = np.polynomial.polynomial.polyfit(y, meridian / there[0], _ORDER)
        self.east_stretch = np.polynomial.polynomial.polyfit(y, parallel / there[1], _ORDER)

    def cast(self, dtype) -> Frame:
        """The same frame with its arrays in ``dtype``, for use inside the compiled step."""
        fields = ("metres_per_degree", "half_height", "east_stretch", "north_stretch", "latitude", "longitude")
        values = tuple(jnp.asarray(np.asarray(getattr(self, name), dtype)) for name in fields)
        return eqx.tree_at(lambda f: tuple(getattr(f, name) for name in fields), self, values)

    def to_metres(self, latitude, longitude):
        """Frame coordinates ``(east, north)`` in m of degrees; NumPy in, NumPy out. Longitudes may wrap."""
        wrapped = (np.asarray(longitude, float) - self.longitude + 180.0) % 360.0 - 180.0
        east = wrapped * self.metres_per_degree[0]
        return east, (np.asarray(latitude, float) - self.latitude) * self.metres_per_degree[1]

    def to_degrees(self, east, north):
        """``(latitude, longitude)`` in degrees of frame coordinates in m; longitude within -180..180."""
        latitude = self.latitude + np.asarray(north, float) / self.metres_per_degree[1]
        longitude = self.longitude + np.asarray(east, float) / self.metres_per_degree[0]
        # Much faster than a remainder.
        return latitude, longitude - 360.0 * np.floor((longitude + 180.0) / 360.0)

    def stretch(self, north):
        """Metres of frame per metre on the ground, ``(east, north)``, at a frame coordinate ``north`` (m)."""
        y = north / self.half_height
        sx = self.east_stretch[_ORDER]
        sy = self.north_stretch[_ORDER]
        for power in range(_ORDER - 1, -1, -1):
            sx = sx * y + self.east_stretch[power]
            sy = sy * y + self.north_stretch[power]
        return sx, sy
