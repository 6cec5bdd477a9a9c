"""Distance and bearing between two places on the WGS84 ellipsoid.

Standard library only, for the readers that must start at once.
"""

from __future__ import annotations

import math

_A, _F = 6378137.0, 1.0 / 298.257223563
_B = _A * (1.0 - _F)


def range_and_bearing(
    latitude: float, longitude: float, to_latitude: float, to_longitude: float
) -> tuple[float, float]:
    """Distance in m and initial bearing in rad, clockwise from true north in [0, 2 pi), between places in degrees.

    Between nearly opposite ends of the Earth, where the iteration need not converge, the error may reach 0.5 %.

    References
    ----------
    Vincenty (1975), Survey Review 23 (176), 88-93, inverse formula.
    """
    difference = math.radians((to_longitude - longitude + 180.0) % 360.0 - 180.0)
    first = math.atan((1.0 - _F) * math.tan(math.radians(latitude)))
    second = math.atan((1.0 - _F) * math.tan(math.radians(to_latitude)))
    s1, c1, s2, c2 = math.sin(first), math.cos(first), math.sin(second), math.cos(second)
    turn = difference
    for _ in range(50):
        east, north = c2 * math.sin(turn), c1 * s2 - s1 * c2 * math.cos(turn)
        sine, cosine = math.hypot(east, north), s1 * s2 + c1 * c2 * math.cos(turn)
        if sine < 1e-15:
            return (0.0 if cosine > 0.0 else math.pi * _B), 0.0
        sigma = math.atan2(sine, cosine)
        sin_alpha = c1 * c2 * math.sin(turn) / sine
        cos2_alpha = max(0.0, 1.0 - sin_alpha**2)
        middle = cosine - 2.0 * s1 * s2 / cos2_alpha if cos2_alpha > 1e-12 else 0.0
        c = _F / 16.0 * cos2_alpha * (4.0 + _F * (4.0 - 3.0 * cos2_alpha))
        bend = sigma + c * sine * (middle + c * cosine * (2.0 * middle**2 - 1.0))
        before, turn = turn, difference + (1.0 - c) * _F * sin_alpha * bend
        if abs(turn - before) < 1e-12:
            break
    u2 = cos2_alpha * (_A**2 - _B**2) / _B**2
    big_a = 1.0 + u2 / 16384.0 * (4096.0 + u2 * (-768.0 + u2 * (320.0 - 175.0 * u2)))
    big_b = u2 / 1024.0 * (256.0 + u2 * (-128.0 + u2 * (74.0 - 47.0 * u2)))
    inner = cosine * (2.0 * middle**2 - 1.0) - big_b / 6.0 * middle * (4.0 * sine**2 - 3.0) * (
        4.0 * middle**2 - 3.0
    )
    length = _B * big_a * (sigma - big_b * sine * (middle + big_b / 4.0 * inner))
    return length, math.atan2(east, north) % (2.0 * math.pi)
