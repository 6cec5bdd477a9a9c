"""Artificial oceans with answers in closed form: currents and seafloors by name, as a settings file gives them.

NumPy and records only, no JAX. A newcomer would get wrong: ``x`` and ``y`` are metres east and north of the centre,
linear in longitude and latitude with the lengths of a degree at the centre, so that linear fields stay exact between
grid points. Angles end in ``_deg``; bearings are clockwise from true north and say where water flows to.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Source

SEMI_MAJOR, ECCENTRICITY2 = 6378137.0, 6.69437999014e-3  # m and 1, WGS84
ROTATION = 7.292115e-5  # rad s-1, of the Earth against the stars
M2_PERIOD = 44714.16  # s, principal lunar tide
LARGEST = 40_000_000  # values in one field


@dataclass(frozen=True)
class Area:
    """Where and when an artificial ocean lies; every kind takes these parameters.

    Parameters
    ----------
    latitude, longitude : degrees, centre of the area and origin of ``x`` and ``y``.
    width, height : m, east-west and north-south.
    spacing : m between grid points; None takes an eighth of the width or height, enough for fields that are linear
        in ``x`` and ``y``, and 3 km for the others.
    start : first time, seconds since 1970 or an ISO date (UTC).
    duration, interval : s. Values between two times are interpolated linearly, which takes
        ``(2 pi interval / period)**2 / 8`` from the amplitude half way between them.
    error : m s-1, the product's own 1-sigma error; None for no statement.
    """

    latitude: float = 39.2
    longitude: float = -73.5
    width: float = 400e3
    height: float = 400e3
    spacing: float | None = None
    start: float | str | datetime = "2009-09-05T00:00:00Z"
    duration: float = 21 * 86400.0
    interval: float = 1800.0
    error: float | None = None

    def axes(self, linear: bool) -> tuple[Array, Array, Array, Array]:
        """Latitudes (j,), longitudes (i,), and ``x`` (i,), ``y`` (j,) of the grid in m."""
        sine2 = np.sin(np.radians(self.latitude)) ** 2
        root = np.sqrt(1.0 - ECCENTRICITY2 * sine2)
        meridian = np.radians(SEMI_MAJOR * (1.0 - ECCENTRICITY2) / root**3)
        parallel = np.radians(SEMI_MAJOR / root * np.cos(np.radians(self.latitude)))
        lines = []
        for size in (self.width, self.height):
            step = self.spacing or (size / 8.0 if linear else 3000.0)
            count = max(int(round(size / step)), 1)
            lines.append(size * (np.arange(count + 1) / count - 0.5))
        x, y = lines
        return self.latitude + y / meridian, self.longitude + x / parallel, x, y

    def times(self) -> Array:
        """Times (t,) in seconds since 1970."""
        start = _seconds(self.start)
        return start + self.interval * np.arange(int(np.ceil(self.duration / self.interval)) + 1)


def synthetic_currents(kind: str, **parameters: Any) -> CurrentGrid:
    """Currents of one kind on a regular grid.

    Parameters
    ----------
    kind : ``uniform``, ``tide``, ``inertial``, ``shear``, ``depth_shear``, ``gyre`` or ``shelf_jet``.
    parameters : those of the function of that name, and those of :class:`Area`; SI, angles in degrees.

    Raises
    ------
    ConfigError : unknown kind or parameter, or a value out of range.

    Examples
    --------
    >>> grid = synthetic_currents("uniform", east=0.1, north=-0.05)
    >>> float(grid.east[0, 0, 0, 0]), grid.constant_in_time
    (0.1, True)
    """
    area, own = _split("currents", kind, CURRENTS, parameters)
    return CURRENTS[kind](area, **own)


def synthetic_bathymetry(kind: str, **parameters: Any) -> BathymetryGrid:
    """A seafloor of one kind on a regular grid.

    Parameters
    ----------
    kind : ``flat``, ``sloping``, ``canyon`` or ``shelf``.
    parameters : those of the function of that name, and those of :class:`Area`; SI, angles in degrees.

    Raises
    ------
    ConfigError : unknown kind or parameter, or a value out of range.
    """
    area, own = _split("bathymetry", kind, BATHYMETRY, parameters)
    return BATHYMETRY[kind](area, **own)


# -- currents ----------------------------------------------------------------------------------------------------


def uniform(area: Area, *, east: float = 0.0, north: float = 0.0) -> CurrentGrid:
    """The same velocity everywhere and always; ``east`` and ``north`` in m s-1."""
    return _steady(area, "uniform", lambda x, y: (east + 0 * x, north + 0 * x))


def tide(
    area: Area, *, major: float = 0.1, minor: float = -0.06, inclination_deg: float = 0.0, phase_deg: float = 0.0,
    period: float = M2_PERIOD, mean_east: float = 0.0, mean_north: float = 0.0,
) -> CurrentGrid:  # fmt: skip
    """A tidal ellipse, the same everywhere: ``exp(i inclination) (major cos a + i minor sin a)``, ``a = w t - phase``.

    ``major`` and ``minor`` are m s-1, a negative ``minor`` turns clockwise; ``inclination_deg`` runs anticlockwise
    from east to the major axis; ``t`` counts from ``start``; ``period`` in s. The mean is added.
    """
    _positive("tide", period=period)
    angle = 2 * np.pi * (area.times() - area.times()[0]) / period - np.radians(phase_deg)
    flow = np.exp(1j * np.radians(inclination_deg)) * (major * np.cos(angle) + 1j * minor * np.sin(angle))
    return _unsteady(area, "tide", flow + mean_east + 1j * mean_north)


def inertial(
    area: Area, *, speed: float = 0.2, phase_deg: float = 0.0, onset: float = 0.0, decay: float | None = None,
    mean_east: float = 0.0, mean_north: float = 0.0,
) -> CurrentGrid:  # fmt: skip
    """Inertial motion at the Coriolis frequency of the centre, clockwise in the north.

    ``speed`` m s-1 at ``onset`` (s after ``start``, nothing before it), towards ``phase_deg`` anticlockwise from
    east, shrinking by e every ``decay`` s (None: never).
    """
    if decay is not None:
        _positive("inertial", decay=decay)
    since = area.times() - area.times()[0] - onset
    rate = 2.0 * ROTATION * np.sin(np.radians(area.latitude))
    size = np.where(since >= 0.0, speed * np.exp(-np.maximum(since, 0.0) / (decay or np.inf)), 0.0)
    flow = size * np.exp(1j * (np.radians(phase_deg) - rate * since))
    return _unsteady(area, "inertial", flow + mean_east + 1j * mean_north)


def shear(area: Area, *, rate: float = 1e-6, east: float = 0.0, north: float = 0.0) -> CurrentGrid:
    """Eastward flow that grows northward: ``u = east + rate y`` (``rate`` in s-1), ``v = north``."""
    return _steady(area, "shear", lambda x, y: (east + rate * y, north + 0 * x))


def depth_shear(
    area: Area, *, depth: float = 100.0, surface_east: float = 0.2, surface_north: float = 0.0,
    bottom_east: float = 0.0, bottom_north: float = 0.0, levels: int = 11,
) -> CurrentGrid:  # fmt: skip
    """Velocity that changes linearly from the surface to ``depth`` (m), on ``levels`` depths."""
    _positive("depth_shear", depth=depth, levels=levels - 1)
    share = np.linspace(0.0, 1.0, int(levels))[:, None, None]
    at = np.array([surface_east, surface_north]), np.array([bottom_east, bottom_north])
    east, north = (at[0][k] + (at[1][k] - at[0][k]) * share for k in (0, 1))
    return _steady(area, "depth_shear", lambda x, y: (east + 0 * x, north + 0 * x), depth * share[:, 0, 0])


def gyre(area: Area, *, rate: float = 1e-6, east: float = 0.0, north: float = 0.0) -> CurrentGrid:
    """Solid-body rotation about the centre, ``rate`` rad s-1, positive anticlockwise, plus a uniform flow."""
    return _steady(area, "gyre", lambda x, y: (east - rate * y, north + rate * x))


def shelf_jet(
    area: Area, *, speed: float = 0.3, bearing_deg: float = 215.0, half_width: float = 15e3, offset: float = 0.0,
) -> CurrentGrid:  # fmt: skip
    """A straight jet, ``speed exp(-(d / half_width)**2)`` towards ``bearing_deg``.

    ``d`` is the distance (m) from a line through the centre, moved by ``offset`` m to the left of the flow.
    """
    _positive("shelf_jet", half_width=half_width)
    to_east, to_north = np.sin(np.radians(bearing_deg)), np.cos(np.radians(bearing_deg))

    def flow(x: Array, y: Array) -> tuple[Array, Array]:
        left = y * to_east - x * to_north
        size = speed * np.exp(-(((left - offset) / half_width) ** 2))
        return size * to_east, size * to_north

    return _steady(area, "shelf_jet", flow, linear=False)


# -- seafloors ---------------------------------------------------------------------------------------------------


def flat(area: Area, *, depth: float = 100.0) -> BathymetryGrid:
    """One depth (m, positive down) everywhere."""
    return _seafloor(area, "flat", lambda x, y: depth + 0 * x, linear=True)


def sloping(
    area: Area, *, depth: float = 60.0, slope: float = 1e-3, bearing_deg: float = 125.0, least: float | None = None,
) -> BathymetryGrid:  # fmt: skip
    """A plane: ``depth`` (m) at the centre, deeper by ``slope`` m per m towards ``bearing_deg``.

    Nothing is shallower than ``least``; without it the plane comes out of the water as land.
    """
    plane = _incline(depth, slope, bearing_deg)
    if least is None:
        return _seafloor(area, "sloping", plane, linear=True)
    return _seafloor(area, "sloping", lambda x, y: np.maximum(plane(x, y), least), linear=False)


def canyon(
    area: Area, *, depth: float = 100.0, slope: float = 1e-3, bearing_deg: float = 125.0, relief: float = 200.0,
    half_width: float = 4e3, offset: float = 0.0,
) -> BathymetryGrid:  # fmt: skip
    """A plane cut by a straight canyon that runs down the slope, ``relief exp(-(d / half_width)**2)`` m deeper.

    ``d`` is the distance (m) from a line through the centre, moved by ``offset`` m to the left when going down.
    """
    _positive("canyon", half_width=half_width)
    plane = _incline(depth, slope, bearing_deg)
    angle = np.radians(bearing_deg)

    def floor(x: Array, y: Array) -> Array:
        left = y * np.sin(angle) - x * np.cos(angle)
        return plane(x, y) + relief * np.exp(-(((left - offset) / half_width) ** 2))

    return _seafloor(area, "canyon", floor, linear=False)


def shelf(
    area: Area, *, bearing_deg: float = 125.0, coast_depth: float = 5.0, break_depth: float = 120.0,
    shelf_width: float = 120e3, slope: float = 0.03, deepest: float = 2000.0,
) -> BathymetryGrid:  # fmt: skip
    """A shelf whose depth grows evenly from the coast to the break, then a slope (m per m) down to ``deepest``.

    The middle of the shelf is the centre of the area; inshore of the coast there is land.
    """
    _positive("shelf", shelf_width=shelf_width, slope=slope)
    angle = np.radians(bearing_deg)

    def floor(x: Array, y: Array) -> Array:
        off = x * np.sin(angle) + y * np.cos(angle) + 0.5 * shelf_width
        on_shelf = coast_depth + (break_depth - coast_depth) * off / shelf_width
        depth = np.where(off > shelf_width, break_depth + slope * (off - shelf_width), on_shelf)
        return np.where(off < 0.0, -5.0, np.minimum(depth, deepest))

    return _seafloor(area, "shelf", floor, linear=False)


CURRENTS: dict[str, Callable[..., CurrentGrid]] = {
    f.__name__: f for f in (uniform, tide, inertial, shear, depth_shear, gyre, shelf_jet)
}
BATHYMETRY: dict[str, Callable[..., BathymetryGrid]] = {f.__name__: f for f in (flat, sloping, canyon, shelf)}


# -- making the records ------------------------------------------------------------------------------------------


def _incline(depth: float, slope: float, bearing_deg: float) -> Callable[[Array, Array], Array]:
    angle = np.radians(bearing_deg)
    return lambda x, y: depth + slope * (x * np.sin(angle) + y * np.cos(angle))


def _mesh(area: Area, kind: str, linear: bool, frames: int = 1) -> tuple[Array, Array, Array, Array]:
    latitude, longitude, x, y = area.axes(linear)
    if frames * x.size * y.size > LARGEST:
        raise ConfigError(
            f"synthetic '{kind}': expected at most {LARGEST:,} values, found {frames} x {y.size} x {x.size}. "
            "Use a wider spacing, a longer interval or a smaller area."
        )
    return latitude, longitude, *np.meshgrid(x, y)


def _currents(area: Area, kind: str, time: Array, depth: Array, latitude: Array, longitude: Array, flow, steady: bool):
    east, north = (np.ascontiguousarray(part) for part in flow)
    sd = None if area.error is None else np.full(east.shape, float(area.error))
    sea = np.ones(east.shape[-2:], bool)
    source = Source(f"synthetic currents: {kind}")
    return CurrentGrid(
        time, depth, latitude, longitude, east, north, source,
        sea=sea, east_sd=sd, north_sd=sd, constant_in_time=steady,
    )  # fmt: skip


def _steady(area: Area, kind: str, flow, depth: Array | None = None, linear: bool = True) -> CurrentGrid:
    """Currents of one frame from a function of ``x`` and ``y`` (j, i)."""
    depth = np.zeros(1) if depth is None else depth
    latitude, longitude, x, y = _mesh(area, kind, linear, depth.size)
    shape = (1, depth.size, *x.shape)
    parts = [np.broadcast_to(part, shape[1:]).reshape(shape) for part in flow(x, y)]
    return _currents(area, kind, area.times()[:1], depth, latitude, longitude, parts, True)


def _unsteady(area: Area, kind: str, flow: Array) -> CurrentGrid:
    """Currents that are the same everywhere, from east + i north (t,)."""
    latitude, longitude, x, _ = _mesh(area, kind, True, flow.size)
    shape = (flow.size, 1, *x.shape)
    parts = [np.broadcast_to(part[:, None, None, None], shape) for part in (flow.real, flow.imag)]
    return _currents(area, kind, area.times(), np.zeros(1), latitude, longitude, parts, False)


def _seafloor(area: Area, kind: str, floor: Callable[[Array, Array], Array], linear: bool) -> BathymetryGrid:
    latitude, longitude, x, y = _mesh(area, kind, linear)
    return BathymetryGrid(latitude, longitude, floor(x, y), Source(f"synthetic bathymetry: {kind}"))


def _split(what: str, kind: str, kinds: dict[str, Any], given: dict[str, Any]) -> tuple[Area, dict[str, Any]]:
    """Check the kind and its parameters, and part them into the area's and the kind's own."""
    if kind not in kinds:
        raise ConfigError(
            f"synthetic {what}: expected one of {', '.join(kinds)}, found '{kind}'.{did_you_mean(str(kind), kinds)}"
        )
    where = f"synthetic {what} '{kind}'"
    usual = set(inspect.signature(Area).parameters)
    known = [p for p in inspect.signature(kinds[kind]).parameters if p != "area"]
    for name, value in given.items():
        if name not in usual and name not in known:
            raise ConfigError(
                f"{where}: expected {', '.join([*known, *sorted(usual)])}, found '{name}'."
                f"{did_you_mean(name, [*known, *usual])}"
            )
        number = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
        optional = value is None and name in ("spacing", "error", "decay", "least")
        if not (number or optional or (name == "start" and isinstance(value, str | datetime))):
            raise ConfigError(f"{where}: {name}: expected a finite number, found {value!r}. Correct it.")
    area = Area(**{k: v for k, v in given.items() if k in usual})
    _positive(
        f"{what} '{kind}'", width=area.width, height=area.height, interval=area.interval, duration=area.duration,
        spacing=1.0 if area.spacing is None else area.spacing,
        error=1.0 if area.error is None or area.error == 0.0 else area.error,
    )  # fmt: skip
    if abs(area.latitude) > 85.0 or abs(area.longitude) > 360.0:
        raise ConfigError(
            f"{where}: expected a centre between 85 S and 85 N, found {area.latitude:g}, {area.longitude:g}. "
            "Give latitude and longitude in degrees."
        )
    _seconds(area.start)
    return area, {k: v for k, v in given.items() if k not in usual}


def _positive(where: str, **values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise ConfigError(f"synthetic {where}: {name}: expected a number above zero, found {value:g}. Correct it.")


def _seconds(moment: float | str | datetime) -> float:
    """Seconds since 1970 of a number or a date, UTC where it names no zone."""
    if isinstance(moment, int | float):
        return float(moment)
    try:
        date = datetime.fromisoformat(moment) if isinstance(moment, str) else moment
    except ValueError as problem:
        raise ConfigError(
            f"synthetic: start: expected a date such as 2009-09-05T00:00:00Z, found '{moment}'. Correct it."
        ) from problem
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
