"""Local metres, wrapped longitudes, and how pilots write places and times.

NumPy only. A product never averages or contours in degrees: it goes to metres east and north of an origin near the
data, and back. Longitudes are unwrapped around the origin, so that a cloud across the antimeridian stays whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from glider_jax.records import Array

_SEMI_MAJOR = 6378137.0
_ECCENTRICITY_SQUARED = 6.69437999014e-3


def wrap_longitude(longitude: Array | float) -> Array:
    """Longitude brought into [-180, 180), in degrees and in float64."""
    return np.mod(np.asarray(longitude, np.float64) + 180.0, 360.0) - 180.0


def unwrap_longitude(longitude: Array | float, reference: float) -> Array:
    """Longitude brought within 180 degrees of ``reference``, in degrees and in float64."""
    return reference + wrap_longitude(np.asarray(longitude, np.float64) - reference)


@dataclass(frozen=True)
class LocalFrame:
    """Metres east and north of an origin on the WGS84 ellipsoid; good to 1e-3 within 200 km of it."""

    latitude: float
    longitude: float

    @property
    def metres_per_degree(self) -> tuple[float, float]:
        """Length of one degree of longitude and of latitude at the origin, m."""
        phi = math.radians(self.latitude)
        shrink = 1.0 - _ECCENTRICITY_SQUARED * math.sin(phi) ** 2
        normal = _SEMI_MAJOR / math.sqrt(shrink)
        meridional = normal * (1.0 - _ECCENTRICITY_SQUARED) / shrink
        return math.radians(1.0) * normal * math.cos(phi), math.radians(1.0) * meridional

    def to_metres(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """East and north of the origin, m, of places in degrees; any longitude convention."""
        per_lon, per_lat = self.metres_per_degree
        east = wrap_longitude(np.asarray(longitude, np.float64) - self.longitude) * per_lon
        return east, (np.asarray(latitude, np.float64) - self.latitude) * per_lat

    def to_degrees(self, east: Array, north: Array) -> tuple[Array, Array]:
        """Latitude and longitude, degrees, of metres; the longitude is unwrapped around the origin."""
        per_lon, per_lat = self.metres_per_degree
        return self.latitude + np.asarray(north) / per_lat, self.longitude + np.asarray(east) / per_lon


def frame_of(latitude: Array, longitude: Array) -> LocalFrame:
    """A frame centred on the finite places given; longitudes are averaged around the first of them."""
    latitude, longitude = np.ravel(latitude), np.ravel(longitude)
    good = np.isfinite(latitude) & np.isfinite(longitude)
    if not good.any():
        return LocalFrame(0.0, 0.0)
    reference = float(longitude[good.argmax()])
    return LocalFrame(
        float(np.mean(latitude[good], dtype=np.float64)),
        float(np.mean(unwrap_longitude(longitude[good], reference))),
    )


def distance(latitude: Array, longitude: Array, other_latitude: Array, other_longitude: Array) -> Array:
    """Great-circle distance between places in degrees, m, on the sphere of mean radius 6371.0088 km."""
    phi, other = np.radians(latitude), np.radians(other_latitude)
    half_lon = np.radians(wrap_longitude(np.asarray(other_longitude) - np.asarray(longitude))) / 2.0
    haversine = np.sin((other - phi) / 2.0) ** 2 + np.cos(phi) * np.cos(other) * np.sin(half_lon) ** 2
    return 2.0 * 6371008.8 * np.arcsin(np.sqrt(np.clip(haversine, 0.0, 1.0)))


def degree_minutes(value: float, axis: str, digits: int = 3) -> str:
    """A latitude (``axis`` "lat") or longitude ("lon") as pilots write it: ``39°24.600′N``.

    Minutes are rounded before degrees are split off, so 59.9996 minutes becomes the next degree.
    """
    value = float(wrap_longitude(value)) if axis == "lon" else float(value)
    hemisphere = ("N", "S")[value < 0] if axis == "lat" else ("E", "W")[value < 0]
    scale = 10**digits
    total = round(abs(value) * 60.0 * scale)
    degrees, minutes = divmod(total, 60 * scale)
    width = (2 if axis == "lat" else 3, 3 + digits if digits else 2)
    return f"{degrees:0{width[0]}d}°{minutes / scale:0{width[1]}.{digits}f}′{hemisphere}"


def place_text(latitude: float, longitude: float) -> str:
    """A place in degrees and decimal minutes, latitude first."""
    return f"{degree_minutes(latitude, 'lat')} {degree_minutes(longitude, 'lon')}"


def iso_time(seconds: float | None) -> str | None:
    """Seconds since 1970 as ``2012-10-25T06:00:00Z``, rounded to the second; None where not finite."""
    if seconds is None or not math.isfinite(seconds):
        return None
    return datetime.fromtimestamp(round(seconds), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
