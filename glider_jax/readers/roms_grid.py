"""The grid of a ROMS run: the block around a box, masks, angle, vertical coordinate, and the way to regular axes.

NumPy only. A newcomer would get wrong: nothing says in which file the land mask or the vertical coordinate is, the
stored angle may be in degrees, and a mask that was packed decodes to 0.99999.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.grids import CurvilinearWeights, check_box, regular_axes
from glider_jax.readers.roms_files import RomsFile, RomsFiles
from glider_jax.readers.roms_vertical import VerticalCoordinate, s_levels, stretching_curve
from glider_jax.records import Array

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class HorizontalGrid:
    """The part of a model's horizontal grid that covers a box; all arrays (ny, nx) at rho points.

    ``rows`` and ``columns`` are the slices of the full grid of shape ``full``. ``lon``, ``lat`` degrees, ``h`` m
    positive down (NaN where no file has it), ``sea`` True at sea, ``angle`` rad from east to the xi axis,
    counter-clockwise. ``sea_u`` (ny, nx + 1) and ``sea_v`` (ny + 1, nx) are True on the faces through which
    water flows; faces outside the model are False.
    """

    full: tuple[int, int]
    rows: slice
    columns: slice
    lon: Array
    lat: Array
    h: Array
    sea: Array
    angle: Array
    sea_u: Array
    sea_v: Array


def read_horizontal(
    files: RomsFiles, full: tuple[int, int], box: Box | None, vector: bool = True, need_mask: bool = True
) -> HorizontalGrid:
    """Collect the horizontal grid from whichever files hold it.

    Parameters
    ----------
    files : opened files.
    full : (eta_rho, xi_rho), the shape of the whole grid.
    box : (south, north, west, east) in degrees, or None for everything.
    vector : velocities will be rotated, so a missing angle is worked out and noted.
    need_mask : raise where no file holds ``mask_rho``; else everything counts as sea.

    Raises
    ------
    DataError : positions or the land mask are missing; the message says where they usually are.
    CoverageError : the grid has no point in the box.
    """
    lon, lat = _positions(files, full)
    rows, columns = _window(lon, lat, box, files.names)
    cut = (rows, columns)
    file = files.holding("h", full)
    h = file.values("h", (..., *cut)).reshape(lon[cut].shape) if file else np.full(lon[cut].shape, np.nan)
    sea = _mask(files, "mask_rho", full)
    if sea is None and need_mask:
        raise DataError(
            f"{files.names}: expected variable 'mask_rho' of shape {full}, found none. Land currents in ROMS files "
            "are invented, so the mask is needed: it is in the model's grid file; give that as grid."
        )
    sea = np.ones(full, bool) if sea is None else sea
    # A face is open where its own mask says so, or where both neighbours are at sea.
    open_u, open_v = np.zeros((full[0], full[1] + 1), bool), np.zeros((full[0] + 1, full[1]), bool)
    mask_u = _mask(files, "mask_u", (full[0], full[1] - 1))
    mask_v = _mask(files, "mask_v", (full[0] - 1, full[1]))
    open_u[:, 1:-1] = sea[:, 1:] & sea[:, :-1] if mask_u is None else mask_u
    open_v[1:-1] = sea[1:] & sea[:-1] if mask_v is None else mask_v
    return HorizontalGrid(
        full=full,
        rows=rows,
        columns=columns,
        lon=lon[cut],
        lat=lat[cut],
        h=h,
        sea=sea[cut],
        angle=_angle(files, full, lon, lat)[cut] if vector else np.zeros(lon[cut].shape),
        sea_u=open_u[rows, columns.start : columns.stop + 1],
        sea_v=open_v[rows.start : rows.stop + 1, columns],
    )


def _mask(files: RomsFiles, name: str, shape: tuple[int, int]) -> Array | None:
    """A mask as booleans; packed masks decode to 0.99999, so compare with one half."""
    file = files.holding(name, shape)
    return None if file is None else file.values(name).reshape(-1, *shape)[0] > 0.5


def _positions(files: RomsFiles, full: tuple[int, int]) -> tuple[Array, Array]:
    """Longitudes and latitudes of all rho points; longitudes continuous, in -180..180 where that is possible."""
    pair = []
    for name, length, axis in (("lon_rho", full[1], 0), ("lat_rho", full[0], 1)):
        file = files.holding(name, full)
        if file is not None:
            pair.append(file.values(name).reshape(-1, *full)[0])
            continue
        file = files.holding(name, (length,))
        if file is None or len(file.shape(name)) != 1:
            raise DataError(
                f"{files.names}: expected variable '{name}' of shape {full}, found "
                f"{'another shape' if files.holding(name) else 'none'}. It is in the model's grid file; give that "
                "as grid."
            )
        pair.append(np.broadcast_to(np.expand_dims(file.values(name), axis), full).copy())
    lon, lat = pair
    wrapped = (lon + 180.0) % 360.0 - 180.0
    crosses = np.nanmax(wrapped) - np.nanmin(wrapped) > np.nanmax(lon % 360.0) - np.nanmin(lon % 360.0)
    return (lon % 360.0 if crosses else wrapped), lat


def _window(lon: Array, lat: Array, box: Box | None, where: str) -> tuple[slice, slice]:
    """Slices of the smallest block of points around the box, with one cell of margin."""
    if box is None:
        return slice(0, lon.shape[0]), slice(0, lon.shape[1])
    south, north, west, east = check_box(box)
    margin_lat, margin_lon = (max(np.nanmax(np.abs(part)) for part in steps) for steps in _steps(lat, lon))
    shift = np.round((0.5 * (west + east) - lon) / 360.0) * 360.0
    inside = (lat >= south - margin_lat) & (lat <= north + margin_lat)
    inside &= (lon + shift >= west - margin_lon) & (lon + shift <= east + margin_lon)
    if not inside.any():
        raise CoverageError(
            f"{where}: expected points in {south:g}..{north:g} N, {west:g}..{east:g} E, found the grid at "
            f"{np.nanmin(lat):.2f}..{np.nanmax(lat):.2f} N, {np.nanmin(lon):.2f}..{np.nanmax(lon):.2f} E. "
            "Choose another file or area."
        )
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _steps(*parts: Array) -> list[list[Array]]:
    """Differences of each field along both of its axes; a single row or column has step 0."""
    return [[np.diff(part, axis=axis) if part.shape[axis] > 1 else np.zeros(1) for axis in (0, 1)] for part in parts]


def angle_from_positions(lon: Array, lat: Array) -> Array:
    """Angle (rad, counter-clockwise) from east to the direction of growing xi, from positions in degrees."""
    if lon.shape[1] < 2:
        return np.zeros(lon.shape)
    return np.arctan2(np.gradient(lat, axis=1), np.gradient(lon, axis=1) * np.cos(np.radians(lat)))


def _angle(files: RomsFiles, full: tuple[int, int], lon: Array, lat: Array) -> Array:
    """The stored angle in rad, checked against the positions, or the angle worked out from them."""
    expected = angle_from_positions(lon, lat)
    file = files.holding("angle", full)
    if file is None:
        files.note("angle is in no file: worked out from lon_rho and lat_rho.")
        return expected
    angle = file.values("angle").reshape(-1, *full)[0]

    def apart(other: Array) -> float:
        return float(np.nanmedian(np.abs((other - expected + np.pi) % (2 * np.pi) - np.pi)))

    if apart(angle) > 0.05 and apart(np.radians(angle)) <= 0.05:
        files.note(f"{file.name}: angle taken as degrees, which is what the positions say.")
        return np.radians(angle)
    if apart(angle) > 0.05:
        files.note(
            f"{file.name}: stored angle differs from the direction of the grid by "
            f"{np.degrees(apart(angle)):.0f} degrees (median); the stored one is used."
        )
    return angle


def read_vertical(files: RomsFiles, file: RomsFile, n: int) -> VerticalCoordinate:
    """Collect the vertical coordinate of a field with ``n`` levels from whichever files hold it.

    Stored curves are preferred; else they are worked out from theta_s, theta_b and Vstretching at the stored s.

    Raises
    ------
    DataError : naming everything that is missing and where it usually is.
    """
    stretching = files.scalar("Vstretching")
    theta_s, theta_b = files.scalar("theta_s"), files.scalar("theta_b")
    known = None not in (stretching, theta_s, theta_b)
    kind = 4 if stretching is None else int(stretching)
    s = _first(_levels_of(f, n) for f in [file, *files.all])
    c = _stored_curve(files, n, s)
    if s is None and (c is not None or known):
        s = s_levels(n, kind)
        files.note(f"s_rho is in no file: {n} levels worked out for Vstretching {kind}.")
    if c is None and known and s is not None:
        c = stretching_curve(kind, theta_s, theta_b, s)
        files.note("Cs_r is in no file: worked out from theta_s, theta_b and Vstretching.")
    transform = _transform(files)
    critical = files.scalar("hc")
    if critical is None and transform == 2:
        critical = files.scalar("Tcline")
    missing = [] if c is not None else ["Cs_r (or theta_s, theta_b and Vstretching)"]
    missing += [] if s is not None else ["s_rho"]
    missing += [] if critical is not None else ["hc"]
    missing += [] if transform is not None else ["Vtransform"]
    if missing:
        raise DataError(
            f"{files.names}: expected the vertical coordinate of {n} levels, found no {', no '.join(missing)}. "
            "Servers that cut files drop them: they are in the model's own history, initial or parameter file; "
            "give that file as grid, or add it to the list."
        )
    s_w = _first(_values_of(f, ("s_w", "sc_w"), n + 1) for f in files.all)
    s_w = s_levels(n, kind, True) if s_w is None else s_w
    c_w = _first(_values_of(f, ("Cs_w",), n + 1) for f in files.all)
    if c_w is None and known:
        c_w = stretching_curve(kind, theta_s, theta_b, s_w)
    return VerticalCoordinate(transform, critical, s, c, *((s_w, c_w) if c_w is not None else ()))


def _first(found: Iterable[Array | None]) -> Array | None:
    return next((item for item in found if item is not None), None)


def _values_of(file: RomsFile, names: Sequence[str], n: int | None = None) -> Array | None:
    """The first of several 1-d variables of a file, of length ``n`` if given."""
    for name in names:
        shape = file.shape(name)
        if shape is not None and len(shape) == 1 and (n is None or shape[0] == n):
            return file.values(name)
    return None


def _levels_of(file: RomsFile, n: int) -> Array | None:
    found = _values_of(file, ("s_rho", "sc_r"), n)
    return found if found is not None and -1 <= found.min() and found.max() <= 0 else None


def _stored_curve(files: RomsFiles, n: int, s: Array | None) -> Array | None:
    """Stored Cs_r of n levels, or those of a fuller file at the same s where a server left levels out."""
    for file in files.all:
        c = _values_of(file, ("Cs_r",))
        if c is None:
            continue
        if c.size == n:
            return c
        fuller = _levels_of(file, c.size)
        if s is not None and fuller is not None:
            at = np.abs(fuller[:, None] - s[None]).argmin(axis=0)
            if np.abs(fuller[at] - s).max() < 1e-6:
                files.note(f"{file.name}: Cs_r of {c.size} levels used at the {n} levels of the currents.")
                return c[at]
    return None


def _transform(files: RomsFiles) -> int | None:
    """Vtransform, from its variable or from the standard name that s_rho carries."""
    stored = files.scalar("Vtransform")
    if stored is not None:
        return int(stored)
    for file in files.all:
        for name in ("s_rho", "sc_r"):
            standard = getattr(file.data.variables.get(name), "standard_name", "")
            for ending, transform in (("_g1", 1), ("_g2", 2)):
                if standard == f"ocean_s_coordinate{ending}":
                    files.note(f"{file.name}: Vtransform {transform} taken from the standard name of {name}.")
                    return transform
    return None


class RegularTarget:
    """Regular longitude-latitude axes for a block of the model grid, and the interpolation to them.

    A grid that is regular already keeps its own points; a curvilinear one is interpolated to axes at its own
    spacing. ``longitude`` and ``latitude`` ascend; ``sea`` (latitude, longitude) is True at sea; ``inside`` where
    the model has a value or land; ``note`` says what was done.
    """

    def __init__(self, grid: HorizontalGrid, box: Box | None):
        lon, lat = grid.lon, grid.lat
        if box is not None:
            lon = lon + np.round((0.5 * (box[2] + box[3]) - np.nanmean(lon)) / 360.0) * 360.0
        self._weights = None
        if _is_regular(lon, lat):
            flip = slice(None, None, 1 if lat[-1, 0] > lat[0, 0] else -1)
            self._order = (..., flip, slice(None))
            self.longitude, self.latitude = lon[0].copy(), lat[flip, 0].copy()
            self.sea, self.inside = grid.sea[flip], np.ones(grid.sea.shape, bool)
            self.note = "the model grid is regular in longitude and latitude: its own points are kept."
            return
        self.longitude, self.latitude = regular_axes(lon, lat)
        if box is not None:
            self.latitude = _crop(self.latitude, box[0], box[1])
            self.longitude = _crop(self.longitude, box[2], box[3])
        self._weights = CurvilinearWeights(lon, lat, grid.sea, self.longitude, self.latitude)
        self.sea, self.inside = self._weights.valid, self._weights.inside
        self.note = (
            f"interpolated from the curvilinear model grid to {self.latitude.size} x {self.longitude.size} regular "
            "points at its own spacing."
        )

    def apply(self, values: Array) -> Array:
        """Values (..., ny, nx) of the model block on the regular axes; NaN on land and outside the model."""
        if self._weights is not None:
            return self._weights.apply(values)
        values = np.asarray(values)[self._order]
        return np.where(self.sea, values, np.nan)


def _is_regular(lon: Array, lat: Array) -> bool:
    """Whether longitudes depend on the column and latitudes on the row alone, to a thousandth of a cell."""
    if min(lon.shape) < 2 or not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        return False
    along, up = np.diff(lon[0]), np.diff(lat[:, 0])
    straight = np.ptp(lon, axis=0).max() < 1e-3 * np.abs(along).min()
    straight &= np.ptp(lat, axis=1).max() < 1e-3 * np.abs(up).min()
    return bool(straight and (along > 0).all() and ((up > 0).all() or (up < 0).all()))


def _crop(axis: Array, low: float, high: float) -> Array:
    """The part of an axis that covers low..high, with one point beyond on each side where there is one."""
    first = max(int(np.searchsorted(axis, low)) - 1, 0)
    last = min(int(np.searchsorted(axis, high, side="right")) + 1, axis.size)
    return axis[first:last]
