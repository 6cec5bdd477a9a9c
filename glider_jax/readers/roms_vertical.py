"""The terrain-following vertical coordinate of ROMS: stretching curves, level depths, values at fixed depths.

NumPy only. A newcomer would get wrong: level 0 is at the bottom, ``s`` runs from -1 (bottom) to 0 (surface),
``h`` is positive down while ``z`` is positive up, and a file cut by a server may hold only some of the levels,
so ``s`` must be read and not worked out from the number of levels.

References
----------
Song and Haidvogel (1994), J. Comput. Phys. 115, 228-244 (stretching 1).
Shchepetkin and McWilliams (2005), Ocean Modelling 9, 347-404 (transform 2, stretching 2 and 4).
ROMS documentation, "Vertical S-coordinate" (stretching 3 by R. Geyer, 5 by A. Souza).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.errors import DataError
from glider_jax.records import Array

THINNEST = 0.1  # m, least water column kept where the free surface falls below the model's seafloor

_LEVELS = """0 2 5 10 15 20 30 40 50 75 100 125 150 200 250 300 400 500 600 700 800 900 1000 1250 1500 1750 2000
2500 3000 3500 4000 4500 5000 6000 7000 8000 9000 10000 11000"""
STANDARD_LEVELS = np.array(_LEVELS.split(), dtype=float)  # m


def s_levels(n: int, stretching: int = 4, interfaces: bool = False) -> Array:
    """The undisturbed coordinate s of a complete set of levels, bottom first.

    Parameters
    ----------
    n : number of layers.
    stretching : ``Vstretching``; 5 spaces s quadratically, the others uniformly.
    interfaces : give the n + 1 layer interfaces (w points) instead of the n layer middles (rho points).
    """
    k = np.arange(n + 1, dtype=float) if interfaces else np.arange(1, n + 1) - 0.5
    if stretching != 5 or n < 2:
        return (k - n) / n
    s = -(k**2 - 2 * k * n + k + n**2 - n) / (n**2 - n) - 0.01 * (k**2 - k * n) / (1 - n)
    if interfaces:
        s[0] = -1.0
    return s


def stretching_curve(stretching: int, theta_s: float, theta_b: float, s: Array) -> Array:
    """The stretching curve C(s), from -1 at the bottom to 0 at the surface.

    Parameters
    ----------
    stretching : ``Vstretching``, 1 to 5.
    theta_s, theta_b : surface and bottom control parameters.
    s : coordinate, any shape, -1 to 0.

    Raises
    ------
    DataError : ``stretching`` is none of 1 to 5.
    """
    s = np.asarray(s, float)
    if stretching == 1:
        return _song_haidvogel(theta_s, theta_b, s)
    if stretching == 2:
        return _shchepetkin_2005(theta_s, theta_b, s)
    if stretching == 3:
        return _geyer(theta_s, theta_b, s)
    if stretching in (4, 5):
        return _shchepetkin_2010(theta_s, theta_b, s)
    raise DataError(f"Vstretching: expected 1 to 5, found {stretching}. Give a file that holds Cs_r instead.")


def _song_haidvogel(theta_s: float, theta_b: float, s: Array) -> Array:
    """Song and Haidvogel (1994); uniform levels for theta_s = 0."""
    if theta_s == 0:
        return s.copy()
    bottom = np.tanh(theta_s * (s + 0.5)) / (2 * np.tanh(0.5 * theta_s)) - 0.5
    return (1 - theta_b) * np.sinh(theta_s * s) / np.sinh(theta_s) + theta_b * bottom


def _surface_refined(theta_s: float, s: Array) -> Array:
    """Surface refinement shared by stretchings 2 and 4."""
    return (1 - np.cosh(theta_s * s)) / (np.cosh(theta_s) - 1) if theta_s > 0 else -(s**2)


def _shchepetkin_2005(theta_s: float, theta_b: float, s: Array) -> Array:
    """Shchepetkin (2005), with both exponents of its weight 1; uniform levels for theta_s = 0."""
    if theta_s == 0:
        return s.copy()
    surface = _surface_refined(theta_s, s)
    if theta_b == 0:
        return surface
    bottom = np.sinh(theta_b * (s + 1)) / np.sinh(theta_b) - 1
    weight = (s + 1) * (1 + (1 - (s + 1)))
    return weight * surface + (1 - weight) * bottom


def _geyer(theta_s: float, theta_b: float, s: Array) -> Array:
    """R. Geyer's function for high bottom resolution in shallow water; its scale factor is 3."""
    scale = np.log(np.cosh(3.0))
    bottom = np.log(np.cosh(3.0 * (s + 1) ** theta_b)) / scale - 1
    surface = -np.log(np.cosh(3.0 * np.abs(s) ** theta_s)) / scale
    weight = 0.5 * (1 - np.tanh(3.0 * (s + 0.5)))
    return weight * bottom + (1 - weight) * surface


def _shchepetkin_2010(theta_s: float, theta_b: float, s: Array) -> Array:
    """Shchepetkin (2010), a double stretching."""
    surface = _surface_refined(theta_s, s)
    if theta_b == 0:
        return surface
    return (np.exp(theta_b * surface) - 1) / (1 - np.exp(-theta_b))


@dataclass(frozen=True)
class VerticalCoordinate:
    """One terrain-following coordinate: where its levels lie for any water depth and free surface.

    ``transform`` is ``Vtransform`` (1 or 2), ``critical_depth`` is ``hc`` (m); ``s`` and ``c`` (n,) belong to
    the layer middles, ``s_interface`` and ``c_interface`` (n + 1,) to the interfaces, None where not known.
    """

    transform: int
    critical_depth: float
    s: Array
    c: Array
    s_interface: Array | None = None
    c_interface: Array | None = None

    def __post_init__(self) -> None:
        if self.transform not in (1, 2):
            raise DataError(f"Vtransform: expected 1 or 2, found {self.transform}. Correct the file.")

    def _fraction(self, h: Array, s: Array, c: Array) -> Array:
        """Height over the water column, -1 at the bottom and 0 at the surface, shape (level, ...)."""
        shape = (-1,) + (1,) * np.ndim(h)
        s, c, hc = s.reshape(shape), c.reshape(shape), self.critical_depth
        if self.transform == 1:
            h = np.maximum(h, THINNEST)
            return (hc * (s - c) + h * c) / h
        return (hc * s + h * c) / (hc + h)

    def heights(self, h: Array, zeta: Array | float = 0.0, interfaces: bool = False) -> Array:
        """Heights z (level, ...) in m, positive up from mean sea level, bottom level first.

        Parameters
        ----------
        h : (...) m, water depth at rest, positive down.
        zeta : (...) m, free surface, positive up.
        interfaces : layer interfaces instead of layer middles.
        """
        h = np.asarray(h, float)
        return zeta + (h + zeta) * self._fraction(h, *self._pair(interfaces))

    def depths(self, h: Array, zeta: Array | float = 0.0, interfaces: bool = False) -> Array:
        """Depths (level, ...) in m below the moving surface, positive down, bottom level first.

        This is what a pressure sensor feels. Where the surface falls to the seafloor or below it a column of
        0.1 m is kept.
        """
        h = np.asarray(h, float)
        column = np.maximum(h + zeta, THINNEST)
        return -column * self._fraction(h, *self._pair(interfaces))

    def thickness(self, h: Array, zeta: Array | float = 0.0) -> Array:
        """Layer thicknesses (level, ...) in m, bottom layer first; they add up to h + zeta."""
        return np.diff(self.heights(h, zeta, interfaces=True), axis=0)

    def _pair(self, interfaces: bool) -> tuple[Array, Array]:
        if not interfaces:
            return self.s, self.c
        if self.s_interface is None or self.c_interface is None:
            raise DataError(
                "vertical grid: expected s_w and Cs_w for layer interfaces, found neither. "
                "Give a file that holds them, or theta_s, theta_b and Vstretching."
            )
        return self.s_interface, self.c_interface


def depth_mean(values: Array, thickness: Array) -> Array:
    """Mean over depth of ``values`` (level, ...) weighted with layer ``thickness`` (level, ...)."""
    return (values * thickness).sum(axis=0) / thickness.sum(axis=0)


class DepthWeights:
    """Linear interpolation in depth from terrain-following levels to fixed depths; build once, apply to each field.

    Above the highest level its value is used, below the deepest level the deepest value, also below the seafloor,
    so that interpolation between columns on a slope finds a number.

    Parameters
    ----------
    depths : (level, ...) m below the surface, bottom level first.
    levels : (l,) m, depths wanted.
    """

    def __init__(self, depths: Array, levels: Array):
        down = depths[::-1].reshape(depths.shape[0], -1)  # surface first, so that depth ascends
        self._n = down.shape[0]
        self._shape = (len(levels), *depths.shape[1:])
        self._column = np.arange(down.shape[1])
        self._lower = np.zeros((len(levels), down.shape[1]), int)
        self._share = np.zeros(self._lower.shape)
        for index, level in enumerate(levels if self._n > 1 else ()):
            lower = np.clip((down <= level).sum(axis=0), 1, self._n - 1)
            upper, below = down[lower - 1, self._column], down[lower, self._column]
            self._lower[index] = lower
            self._share[index] = np.clip((level - upper) / (below - upper), 0.0, 1.0)

    def apply(self, values: Array) -> Array:
        """Values (level, ...), bottom level first, at the fixed depths (l, ...)."""
        value = values[::-1].reshape(self._n, -1)
        first = value[np.maximum(self._lower - 1, 0), self._column]
        return (first + self._share * (value[self._lower, self._column] - first)).reshape(self._shape)


def to_depths(values: Array, depths: Array, levels: Array) -> Array:
    """One field at fixed depths, see :class:`DepthWeights`."""
    return DepthWeights(depths, levels).apply(values)


def choose_levels(deepest: float, levels: Array | None = None) -> Array:
    """The depths to interpolate to: the given ones, checked, or the standard ones down to the deepest water.

    Parameters
    ----------
    deepest : m, greatest water depth in the area.
    levels : m, positive down; None for the standard set, up to the first at or below ``deepest``.

    Raises
    ------
    DataError : a given level is negative or not a number, or levels repeat.
    """
    if levels is None:
        last = int(np.searchsorted(STANDARD_LEVELS, deepest))
        return STANDARD_LEVELS[: min(last + 1, STANDARD_LEVELS.size)].copy()
    wanted = np.sort(np.asarray(levels, float).ravel())
    if wanted.size == 0 or not np.isfinite(wanted).all() or wanted[0] < 0 or (np.diff(wanted) == 0).any():
        raise DataError(
            f"levels: expected different depths in metres, positive down, found {list(np.ravel(levels))}. "
            "Leave them out for the standard levels."
        )
    return wanted
