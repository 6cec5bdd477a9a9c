"""From what instruments and models store to the variables of TEOS-10: salinities, temperatures, depth and pressure.

NumPy only, plus ``gsw`` where it is installed. Units are those of oceanography: dbar, degC, g kg-1, S m-1, metres.
A newcomer would get wrong: a thermometer gives in-situ temperature, most models give potential temperature, and both
differ from conservative temperature; practical salinity has no unit and is not absolute salinity.

References
----------
Fofonoff and Millard (1983), UNESCO Technical Papers in Marine Science 44: practical salinity and depth.
IOC, SCOR and IAPSO (2010), TEOS-10 manual, IOC Manuals and Guides 56: reference salinity (section 2.4),
potential enthalpy and conservative temperature (section 3.3); polynomials of the TEOS-10 toolbox.
"""

from __future__ import annotations

import numpy as np

from glider_jax.records import Array

REFERENCE_RATIO = 35.16504 / 35.0  # g kg-1 per unit of practical salinity
HEAT_CAPACITY = 3991.86795711963  # J kg-1 K-1, the constant of conservative temperature
CONDUCTIVITY_35_15_0 = 4.2914  # S m-1 at practical salinity 35, 15 degC (IPTS-68), 0 dbar


def practical_salinity(conductivity: Array, temperature: Array, pressure: Array) -> Array:
    """Practical salinity (PSS-78) from conductivity; NaN outside 2 to 42, where the scale is not defined.

    Parameters
    ----------
    conductivity : S m-1.
    temperature : in-situ temperature, degC (ITS-90).
    pressure : sea pressure, dbar.
    """
    t = 1.00024 * np.asarray(temperature, float)
    p = np.asarray(pressure, float)
    ratio = np.asarray(conductivity, float) / CONDUCTIVITY_35_15_0
    at_35 = np.polynomial.polynomial.polyval(t, (0.6766097, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9))
    squeeze = p * (2.070e-5 + p * (-6.370e-10 + p * 3.989e-15))
    squeeze = 1 + squeeze / (1 + t * (3.426e-2 + 4.464e-4 * t) + ratio * (4.215e-1 - 3.107e-3 * t))
    root = np.sqrt(np.maximum(ratio / (squeeze * at_35), 0.0))
    main = np.polynomial.polynomial.polyval(root, (0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081))
    warm = np.polynomial.polynomial.polyval(root, (0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144))
    salinity = main + (t - 15) / (1 + 0.0162 * (t - 15)) * warm
    return np.where((salinity >= 2) & (salinity <= 42), salinity, np.nan)


def depth_from_pressure(pressure: Array, latitude: Array | float) -> Array:
    """Depth (m, positive down) of a sea pressure (dbar), for an ocean at 0 degC and salinity 35."""
    p = np.asarray(pressure, float)
    x = np.sin(np.radians(latitude)) ** 2
    gravity = 9.780318 * (1 + (5.2788e-3 + 2.36e-5 * x) * x) + 1.092e-6 * p
    return (((-1.82e-15 * p + 2.279e-10) * p - 2.2512e-5) * p + 9.72659) * p / gravity


def pressure_from_depth(depth: Array, latitude: Array | float) -> Array:
    """Sea pressure (dbar) at a depth (m, positive down); the inverse of :func:`depth_from_pressure`."""
    depth = np.asarray(depth, float)
    p = 1.01 * depth
    for _ in range(4):
        p = p + (depth - depth_from_pressure(p, latitude)) * 1.01
    return p


def absolute_salinity(practical: Array, pressure: Array, longitude: float, latitude: float) -> tuple[Array, str]:
    """Absolute salinity (g kg-1), and a sentence that says how.

    With ``gsw`` the anomaly of the place is used; without it reference salinity, which is too low by up to
    0.005 g kg-1 in the upper Atlantic, 0.03 g kg-1 in the deep North Pacific and 0.09 g kg-1 in the Baltic.
    """
    practical = np.asarray(practical, float)
    try:
        import gsw
    except ImportError:
        return practical * REFERENCE_RATIO, "absolute salinity is reference salinity (gsw is not installed)."
    if np.isfinite(longitude) and np.isfinite(latitude):
        found = gsw.SA_from_SP(practical, pressure, longitude, latitude)
        return np.where(np.isfinite(found), found, practical * REFERENCE_RATIO), "absolute salinity from gsw."
    return practical * REFERENCE_RATIO, "absolute salinity is reference salinity (the place is not known)."


def potential_temperature(salinity: Array, temperature: Array, pressure: Array) -> Array:
    """Potential temperature (degC, to the surface) from in-situ temperature (degC).

    The first estimate of the TEOS-10 toolbox, without its iteration. Between salinities 30 and 38 and -2 to 35 degC
    it is within 3 mK of the exact value down to 200 dbar, 9 mK to 1,000 dbar and 14 mK to 2,000 dbar.

    Parameters
    ----------
    salinity : absolute salinity, g kg-1.
    temperature : degC.
    pressure : dbar.
    """
    t, p = np.asarray(temperature, float), np.asarray(pressure, float)
    s = np.asarray(salinity, float) / REFERENCE_RATIO
    slope = 8.65483913395442e-6 - s * 1.41636299744881e-6 - p * 7.38286467135737e-9
    slope = slope + t * (-8.38241357039698e-6 + s * 2.83933368585534e-8)
    slope = slope + t * (t * 1.77803965218656e-8 + p * 1.71155619208233e-10)
    return t + p * slope


def conservative_temperature(salinity: Array, potential: Array) -> Array:
    """Conservative temperature (degC): potential enthalpy over the constant heat capacity.

    Parameters
    ----------
    salinity : absolute salinity, g kg-1.
    potential : potential temperature, degC.
    """
    squared = 0.0248826675584615 * np.asarray(salinity, float)
    x, y = np.sqrt(np.maximum(squared, 0.0)), np.asarray(potential, float) * 0.025

    def poly(variable: Array, *coefficients: float) -> Array:
        return np.polynomial.polynomial.polyval(variable, coefficients)

    fresh = poly(
        y, 61.01362420681071, 168776.46138048015, -2735.2785605119625, 2574.2164453821433, -1536.6644434977543,
        545.7340497931629, -50.91091728474331, -18.30489878927802,
    )  # fmt: skip
    linear = poly(
        y, 268.5520265845071, -12019.028203559312, 3734.858026725145, -2046.7671145057618, 465.28655623826234,
        -0.6370820302376359, -10.650848542359153,
    )  # fmt: skip
    cubic = poly(y, 937.2099110620707, 588.1802812170108, 248.39476522971285, -3.871557904936333, -2.6268019854268356)
    quartic = y * poly(
        y, 936.3206544460336, -942.7827304544439, 369.4389437509002, -33.83664947895248, -9.987880382780322
    )
    quartic = quartic + poly(x, -1687.914374187449, 246.9598888781377, 123.59576582457964, -48.5891069025409)
    return (fresh + squared * (linear + x * (cubic + x * quartic))) / HEAT_CAPACITY
