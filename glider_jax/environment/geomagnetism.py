"""Which way a compass points: magnetic declination from the reference field of 2020 to degree 8.

NumPy only. For gliders whose records do not hold the magnetic variation. Good to half a degree away from the magnetic
poles, between about 2010 and 2030; anomalies of the crust are not in it. Declination is positive east; a Slocum's
variation is its negative.

References
----------
Alken and others (2021), International Geomagnetic Reference Field: the thirteenth generation, Earth Planets Space 73,
49: coefficients of 2020 and their change per year, degrees 1 to 8 of 13.
"""

from __future__ import annotations

import numpy as np

DEGREE = 8
_EPOCH = 2020.0
#: km, of the field's expansion; squares of the axes of the WGS84 ellipsoid, km2.
_RADIUS, _EQUATOR, _POLE = 6371.2, 6378.137**2, 6356.752**2
#: nT, Schmidt semi-normalised: g of order 0, then g and h of orders 1, 2, ... for each degree.
_FIELD = (
    -29404.8, -1450.9, 4652.5,
    -2499.6, 2982.0, -2991.6, 1677.0, -734.6,
    1363.2, -2381.2, -82.1, 1236.2, 241.9, 525.7, -543.4,
    903.0, 809.5, 281.9, 86.3, -158.4, -309.4, 199.7, 48.0, -349.7,
    -234.3, 363.2, 47.7, 187.8, 208.3, -140.7, -121.2, -151.2, 32.3, 13.5, 98.9,
    66.0, 65.5, -19.1, 72.9, 25.1, -121.5, 52.8, -36.2, -64.5, 13.5, 8.9, -64.7, 68.1,
    80.6, -76.7, -51.5, -8.2, -16.9, 56.5, 2.2, 15.8, 23.5, 6.4, -2.2, -7.2, -27.2, 9.8, -1.8,
    23.7, 9.7, 8.4, -17.6, -15.3, -0.5, 12.8, -21.1, -11.7, 15.3, 14.9, 13.7, 3.6, -16.5, -6.9, -0.3, 2.8,
)  # fmt: skip
#: nT per year, in the same order.
_CHANGE = (
    5.7, 7.4, -25.9,
    -11.0, -7.0, -30.2, -2.1, -22.4,
    2.2, -5.9, 6.0, 3.1, -1.1, -12.0, 0.5,
    -1.2, -1.6, -0.1, -5.9, 6.5, 5.2, 3.6, -5.1, -5.0,
    -0.3, 0.5, 0.0, -0.6, 2.5, 0.2, -0.6, 1.3, 3.0, 0.9, 0.3,
    -0.5, -0.3, 0.0, 0.4, -1.6, 1.3, -1.3, -1.4, 0.8, 0.0, 0.0, 0.9, 1.0,
    -0.1, -0.2, 0.6, 0.0, 0.6, 0.7, -0.8, 0.1, -0.2, -0.5, -1.1, -0.8, 0.1, 0.8, 0.3,
    0.0, 0.1, -0.2, -0.1, 0.6, 0.4, -0.2, -0.1, 0.5, 0.4, -0.3, 0.3, -0.4, -0.1, 0.5, 0.4, 0.0,
)  # fmt: skip


def declination(latitude: float, longitude: float, time: float) -> float:
    """Angle in rad from true to magnetic north, east positive, at sea level.

    Parameters
    ----------
    latitude, longitude : degrees.  time : UTC s since 1970.

    Examples
    --------
    >>> bool(abs(np.degrees(declination(40.3, -73.8, 1.4931e9)) + 12.7) < 0.6)  # off New Jersey, 2017
    True
    """
    east, north, _ = field(latitude, longitude, 1970.0 + time / (365.2425 * 86400.0))
    return float(np.arctan2(east, north))


def field(latitude: float, longitude: float, year: float) -> tuple[float, float, float]:
    """East, north and downward parts of the field at sea level, nT; latitude is geodetic, degrees.

    Notes
    -----
    The potential is a sum over degrees n and orders m of (a/r)^(n+1) (g cos m phi + h sin m phi) P(cos theta); the
    field is its negative gradient, turned from the geocentric to the geodetic vertical.
    """
    numbers = np.array(_FIELD) + (year - _EPOCH) * np.array(_CHANGE)
    phi, lat = np.radians(longitude), np.radians(np.clip(latitude, -89.999, 89.999))
    sine, cosine = np.sin(lat), np.cos(lat)
    normal = np.sqrt(_EQUATOR * cosine**2 + _POLE * sine**2)
    across, up = _EQUATOR * cosine / normal, _POLE * sine / normal
    r = float(np.hypot(across, up))
    theta = np.arctan2(across, up)
    p, slope = _legendre(theta)
    south = east = outward = 0.0
    k = 0
    for n in range(1, DEGREE + 1):
        ratio = (_RADIUS / r) ** (n + 2)
        for m in range(n + 1):
            g, h = numbers[k], (numbers[k + 1] if m else 0.0)
            k += 2 if m else 1
            wave = g * np.cos(m * phi) + h * np.sin(m * phi)
            outward += ratio * (n + 1) * wave * p[n, m]
            south -= ratio * wave * slope[n, m]
            east += ratio * m * (g * np.sin(m * phi) - h * np.cos(m * phi)) * p[n, m] / np.sin(theta)
    tilt = theta - (0.5 * np.pi - lat)
    north = -south * np.cos(tilt) - outward * np.sin(tilt)
    down = -outward * np.cos(tilt) + south * np.sin(tilt)
    return float(east), float(north), float(down)


def _legendre(theta: float):
    """Schmidt semi-normalised functions of cos theta by degree and order, and their derivatives in theta."""
    c, s = np.cos(theta), np.sin(theta)
    p, slope = np.zeros((DEGREE + 1, DEGREE + 1)), np.zeros((DEGREE + 1, DEGREE + 1))
    p[0, 0] = 1.0
    for n in range(1, DEGREE + 1):
        for m in range(n + 1):
            if m == n:
                factor = np.sqrt(1.0 - 0.5 / n) if n > 1 else 1.0
                p[n, n] = factor * s * p[n - 1, n - 1]
                slope[n, n] = factor * (s * slope[n - 1, n - 1] + c * p[n - 1, n - 1])
                continue
            root = np.sqrt(n * n - m * m)
            older = np.sqrt((n - 1.0) ** 2 - m * m) if m < n - 1 else 0.0
            before = (p[n - 2, m], slope[n - 2, m]) if n > 1 else (0.0, 0.0)
            p[n, m] = ((2 * n - 1) * c * p[n - 1, m] - older * before[0]) / root
            slope[n, m] = ((2 * n - 1) * (c * slope[n - 1, m] - s * p[n - 1, m]) - older * before[1]) / root
    return p, slope
