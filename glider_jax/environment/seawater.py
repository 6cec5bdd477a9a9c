"""Sea water after TEOS-10: density, pressure at depth, gravity, and what a CTD's numbers mean.

Imports NumPy only; every function works on NumPy arrays and, given JAX arrays, is traced, differentiated and keeps
their precision. This is the one module that uses dbar, g kg-1 and degC: pressures here are sea pressure, without
the atmosphere's. Latitudes are in **radians**.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ZERO_CELSIUS = 273.15
PASCAL_PER_DBAR = 1e4
_SALINITY_RATIO = 35.16504 / 35.0
_SALINITY_SCALE = 1.0 / (40.0 * _SALINITY_RATIO)
_SALINITY_SHIFT = 24.0
_CELSIUS_SCALE = 1.0 / 40.0
_PRESSURE_SCALE = 1e-4

# Specific volume, m3 kg-1: key (power of temperature, power of pressure), values by rising power of the salinity root.
_VOLUME = {
    (0, 0): (1.0769995862e-03, -3.1038981976e-04, 6.6928067038e-04, -8.5047933937e-04, 5.8086069943e-04,
             -2.1092370507e-04, 3.1932457305e-05),
    (1, 0): (-1.5649734675e-05, 3.5009599764e-05, -4.3592678561e-05, 3.4532461828e-05, -1.1959409788e-05,
             1.3864594581e-06),
    (2, 0): (2.7762106484e-05, -3.7435842344e-05, 3.5907822760e-05, -1.8698584187e-05, 3.8595339244e-06),
    (3, 0): (-1.6521159259e-05, 2.4141479483e-05, -1.4353633048e-05, 2.2863324556e-06),
    (4, 0): (6.9111322702e-06, -8.7595873154e-06, 4.3703680598e-06),
    (5, 0): (-8.0539615540e-07, -3.3052758900e-07),
    (6, 0): (2.0543094268e-07,),
    (0, 1): (-1.6784136540e-05, 2.4262468747e-05, -3.4792460974e-05, 3.7470777305e-05, -1.7322218612e-05,
             3.0927427253e-06),
    (1, 1): (1.8505765429e-05, -9.5677088156e-06, 1.1100834765e-05, -9.8447117844e-06, 2.5909225260e-06),
    (2, 1): (-1.1716606853e-05, -2.3678308361e-07, 2.9283346295e-06, -4.8826139200e-07),
    (3, 1): (7.9279656173e-06, -3.4558773655e-06, 3.1655306078e-07),
    (4, 1): (-3.4102187482e-06, 1.2956717783e-06),
    (5, 1): (5.0736766814e-07,),
    (0, 2): (3.0623833435e-06, -5.8484432984e-07, -4.8122251597e-06, 4.9263106998e-06, -1.7811974727e-06),
    (1, 2): (-1.1736386731e-06, -5.5699154557e-06, 5.4620748834e-06, -1.3544185627e-06),
    (2, 2): (2.1305028740e-06, 3.9137387080e-07, -6.5731104067e-07),
    (3, 2): (-4.6132540037e-07, 7.7618888092e-09),
    (4, 2): (-6.3352916514e-08,),
    (0, 3): (-3.8088938393e-07, 3.6310188515e-07, 1.6746303780e-08),
    (1, 3): (-3.6527006553e-07, -2.7295696237e-07),
    (2, 3): (2.8695905159e-07,),
    (0, 4): (8.8302421514e-08, -1.1147125423e-07),
    (1, 4): (3.1454099902e-07,),
    (0, 5): (4.2369007180e-09,),
}  # fmt: skip
_VOLUME_AT_PRESSURE = (
    0.0, -4.4015007269e-05, 6.9232335784e-06, -7.5004675975e-07, 1.7009109288e-08, -1.6884162004e-08,
    1.9613503930e-09,
)  # fmt: skip

# Conservative minus in-situ temperature, K: own fit to TEOS-10, key and values as above with other scales.
_WARMING = {
    (0, 0): (1.427335e-02, -2.507901e-03, 1.404761e-01, -3.850360e-02, -1.135792e-01),
    (1, 0): (1.138491e00, -8.749819e-02, -1.212905e00, 1.419190e-01),
    (2, 0): (-1.410778e-01, 9.768561e-02, 5.661408e-02),
    (3, 0): (3.407341e-02, -2.884198e-02),
    (0, 1): (4.639854e-02, -1.252286e-02, -8.142169e-02, 1.333996e-02),
    (1, 1): (-2.386111e-01, 3.557486e-02, 2.483226e-02),
    (2, 1): (4.767387e-02, -1.106898e-02),
    (3, 1): (-8.555957e-03,),
    (0, 2): (-1.236011e-02, 6.082047e-04, 2.614994e-03),
    (1, 2): (8.462262e-03, -1.876285e-03),
    (2, 2): (-9.627459e-04,),
}

# Practical Salinity Scale 1978 (UNESCO 1983), on the temperature scale of 1968.
_PSS_A = (0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081)
_PSS_B = (0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144)
_PSS_C = (0.6766097, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9)
_PSS_E = (0.0, 2.070e-5, -6.370e-10, 3.989e-15)
_PSS_K = 0.0162
_STANDARD_CONDUCTIVITY = 4.2914
_TO_SCALE_OF_1968 = 1.00024

# Gravity grows downwards by this share per metre, TEOS-10 manual, equation D.3.
_GRAVITY_GROWTH = 2.26e-7
_STANDARD_SALINITY = 35.16504


def _horner(coefficients: tuple, x: Any) -> Any:
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value


def _polynomial(table: dict, s: Any, t: Any, p: Any) -> Any:
    """Sum of table[(j, k)](s) t**j p**k by Horner's rule in all three."""
    by_pressure = []
    for k in range(max(key[1] for key in table) + 1):
        row = tuple(_horner(table[key], s) for key in sorted(table) if key[1] == k)
        by_pressure.append(_horner(row, t))
    return _horner(tuple(by_pressure), p)


def _sine_squared(latitude: Any) -> Any:
    namespace = latitude.__array_namespace__() if hasattr(latitude, "__array_namespace__") else np
    return namespace.sin(latitude) ** 2


def density(absolute_salinity: Any, conservative_temperature: Any, pressure_dbar: Any) -> Any:
    """In-situ density of sea water.

    Parameters
    ----------
    absolute_salinity : S_A, g kg-1, 0 to 42.
    conservative_temperature : Theta, degC, -6 to 40.
    pressure_dbar : p, sea pressure, dbar, 0 to 8000.

    Returns
    -------
    rho, kg m-3.

    Notes
    -----
    The reciprocal of the 75-term polynomial for specific volume.

    References
    ----------
    Roquet, Madec, McDougall and Barker 2015, Ocean Modelling 90, 29-43, doi:10.1016/j.ocemod.2015.04.002; TEOS-10
    manual, table K.1.
    """
    s = (_SALINITY_SCALE * (absolute_salinity + _SALINITY_SHIFT)) ** 0.5
    t = conservative_temperature * _CELSIUS_SCALE
    p = pressure_dbar * _PRESSURE_SCALE
    return 1.0 / (_polynomial(_VOLUME, s, t, p) + _horner(_VOLUME_AT_PRESSURE, p))


def pressure_dbar_from_depth(depth: Any, latitude: Any) -> Any:
    """Sea pressure, dbar, at a depth in m (positive down) and a latitude in radians.

    The inverse of :func:`depth_from_pressure_dbar`, by three Newton steps.
    """
    work = gravity(latitude) * depth * (1.0 + 0.5 * _GRAVITY_GROWTH * depth)
    pressure = work * (_PRESSURE_SCALE / _STANDARD_VOLUME[0])
    for _ in range(3):
        excess = _standard_enthalpy(pressure) - work
        pressure = pressure - excess / (
            PASCAL_PER_DBAR * _horner(_STANDARD_VOLUME, pressure * _PRESSURE_SCALE)
        )
    return pressure


def pressure_from_depth(depth: Any, latitude: Any) -> Any:
    """Sea pressure, **Pa**, at a depth in m (positive down) and a latitude in radians."""
    return pressure_dbar_from_depth(depth, latitude) * PASCAL_PER_DBAR


def depth_from_pressure_dbar(pressure_dbar: Any, latitude: Any) -> Any:
    """Depth, m, positive down, at a sea pressure in dbar and a latitude in radians.

    Holds for water of 35.16504 g kg-1 and 0 degC, as TEOS-10's own function does: the work of lifting it through
    gravity that grows downwards equals its enthalpy.

    References
    ----------
    TEOS-10 manual, section 3.32.
    """
    work = _standard_enthalpy(pressure_dbar) / gravity(latitude)
    return 2.0 * work / (1.0 + (1.0 + 2.0 * _GRAVITY_GROWTH * work) ** 0.5)


def depth_from_pressure(pressure: Any, latitude: Any) -> Any:
    """Depth, m, positive down, at a sea pressure in **Pa** and a latitude in radians."""
    return depth_from_pressure_dbar(pressure / PASCAL_PER_DBAR, latitude)


def _standard_volume() -> tuple[float, ...]:
    """Specific volume of standard sea water at 0 degC: coefficients by rising power of scaled pressure."""
    root = (_SALINITY_SCALE * (_STANDARD_SALINITY + _SALINITY_SHIFT)) ** 0.5
    anomaly = [_horner(_VOLUME[(0, k)], root) for k in range(6)] + [0.0]
    return tuple(a + b for a, b in zip(anomaly, _VOLUME_AT_PRESSURE, strict=True))


_STANDARD_VOLUME = _standard_volume()
_STANDARD_ENTHALPY = tuple(value / (power + 1) for power, value in enumerate(_STANDARD_VOLUME))


def _standard_enthalpy(pressure_dbar: Any) -> Any:
    """Enthalpy of standard sea water at 0 degC above that at the surface, J kg-1."""
    return PASCAL_PER_DBAR * pressure_dbar * _horner(_STANDARD_ENTHALPY, pressure_dbar * _PRESSURE_SCALE)


def gravity(latitude: Any) -> Any:
    """Gravity at the sea surface, m s-2, at a latitude in radians.

    References
    ----------
    TEOS-10 manual, equation D.3.
    """
    squared = _sine_squared(latitude)
    return 9.780327 * (1.0 + (5.2792e-3 + 2.32e-5 * squared) * squared)


def conservative_temperature(absolute_salinity: Any, temperature_celsius: Any, pressure_dbar: Any) -> Any:
    """Conservative temperature, degC, of water at an in-situ temperature in degC.

    Notes
    -----
    A 30-term polynomial for their difference, fitted to TEOS-10 for 0 to 42 g kg-1, freezing to 35 degC and 0 to
    1500 dbar; the largest error there is 2 mK, which is 0.0006 kg m-3 of density.
    """
    return temperature_celsius + _warming(absolute_salinity, temperature_celsius, pressure_dbar)


def temperature_from_conservative(absolute_salinity: Any, conservative: Any, pressure_dbar: Any) -> Any:
    """In-situ temperature, degC: the inverse of :func:`conservative_temperature`, by five fixed-point rounds."""
    temperature = conservative
    for _ in range(5):
        temperature = conservative - _warming(absolute_salinity, temperature, pressure_dbar)
    return temperature


def _warming(absolute_salinity: Any, temperature_celsius: Any, pressure_dbar: Any) -> Any:
    s = (absolute_salinity * (1.0 / 35.0)) ** 0.5
    return _polynomial(_WARMING, s, temperature_celsius * (1.0 / 20.0), pressure_dbar * (1.0 / 1000.0))


def absolute_salinity(practical_salinity: Any) -> Any:
    """Absolute salinity, g kg-1, of sea water of standard composition.

    The regional anomaly (below 0.03 g kg-1 outside the North Pacific and closed seas) is left out.
    """
    return practical_salinity * _SALINITY_RATIO


def practical_salinity(conductivity: Any, temperature_celsius: Any, pressure_dbar: Any) -> Any:
    """Practical salinity of a CTD's conductivity.

    Parameters
    ----------
    conductivity : S m-1. temperature_celsius : in situ, degC (ITS-90). pressure_dbar : dbar.

    Returns
    -------
    S_P, 1; meant for 2 to 42. NaN where the conductivity is negative.

    References
    ----------
    UNESCO 1983, Technical Papers in Marine Science 44, Practical Salinity Scale 1978.
    """
    t68 = temperature_celsius * _TO_SCALE_OF_1968
    ratio = conductivity / _STANDARD_CONDUCTIVITY
    bend = 1.0 + (3.426e-2 + 4.464e-4 * t68) * t68 + (4.215e-1 - 3.107e-3 * t68) * ratio
    pressure = 1.0 + _horner(_PSS_E, pressure_dbar) / bend
    root = (ratio / (pressure * _horner(_PSS_C, t68))) ** 0.5
    warmer = (t68 - 15.0) / (1.0 + _PSS_K * (t68 - 15.0))
    return _horner(_PSS_A, root) + warmer * _horner(_PSS_B, root)


def density_from_ctd(conductivity: Any, temperature_celsius: Any, pressure_dbar: Any) -> Any:
    """In-situ density, kg m-3, of a CTD's conductivity (S m-1), temperature (degC) and sea pressure (dbar)."""
    salinity = absolute_salinity(practical_salinity(conductivity, temperature_celsius, pressure_dbar))
    return density(
        salinity, conservative_temperature(salinity, temperature_celsius, pressure_dbar), pressure_dbar
    )
