"""Currents and seafloor from native ROMS files: staggered, rotated, terrain-following, and without a land value.

netCDF4 and NumPy only. A newcomer would get wrong: u and v lie on different faces of a cell and follow the grid's
own axes, land holds invented currents instead of gaps, and the numbers needed for the depth of a level are often in
another file. The depths given back are below the model's moving surface, which is what a pressure sensor feels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.grids import epoch_seconds, iso, speed_factor, text_attribute
from glider_jax.readers.roms_files import RomsFile, RomsFiles
from glider_jax.readers.roms_grid import Box, HorizontalGrid, RegularTarget, read_horizontal, read_vertical
from glider_jax.readers.roms_vertical import THINNEST, DepthWeights, choose_levels
from glider_jax.records import Array, BathymetryGrid, CurrentGrid

PLAUSIBLE_ZETA = 3.0  # m, a larger free surface is reported
LAND_DEPTH = -1.0  # m, given to land, whose height ROMS does not hold


@dataclass(frozen=True)
class Dialect:
    """A pair of velocity variables: names, whether they are east and north at rho points, and their depth."""

    u: str
    v: str
    geographic: bool
    kind: str


DIALECTS = (
    Dialect("u_eastward", "v_northward", True, "levels"),
    Dialect("u", "v", False, "levels"),
    Dialect("u_sur_eastward", "v_sur_northward", True, "surface"),
    Dialect("u_sur", "v_sur", False, "surface"),
    Dialect("ubar_eastward", "vbar_northward", True, "mean"),
    Dialect("ubar", "vbar", False, "mean"),
)


@dataclass(frozen=True)
class Frame:
    """One time of one file."""

    time: float
    file: RomsFile
    index: int


def read_roms_currents(
    paths: str | Path | Sequence[str | Path],
    *,
    grid: str | Path | None = None,
    box: Box | None = None,
    period: tuple[object, object] | None = None,
    levels: Sequence[float] | None = None,
) -> CurrentGrid:
    """Read currents from native ROMS history, average, climatology or initial files.

    Parameters
    ----------
    paths : one file or several of the same run; each must hold velocities or something the others lack.
    grid : the model's grid or parameter file, asked first for positions, masks, angle and vertical coordinate.
    box : (lat0, lat1, lon0, lon1), degrees; only this part is read. None for the whole grid.
    period : (t0, t1), seconds since 1970, datetimes or ISO strings; one time beyond either end is kept.
    levels : depths wanted, m; None for standard depths down to the deepest water in the box.

    Returns
    -------
    Currents on a regular grid, m s-1, positive east and north, NaN on land. Below the seafloor the deepest value
    is repeated, so that interpolation over a slope finds a number; the notes tell the share.

    Raises
    ------
    DataError : velocities, mask, positions or the vertical coordinate are in none of the files.
    CoverageError : the files do not reach into the box or the period.
    """
    with RomsFiles.open(paths, grid) as files:
        dialect, holders = _velocities(files)
        full, geographic, at_rho = _layout(files, holders, dialect)
        frames = _frames(files, holders, dialect, period)
        block = read_horizontal(files, full, box, vector=not geographic)
        first = holders[0]
        ndim = len(first.shape(dialect.u))
        vertical = None
        depth = np.zeros(1)
        if dialect.kind == "levels" and ndim == 4:
            vertical = read_vertical(files, first, first.shape(dialect.u)[1])
            _require_depth(files, block)
            depth = choose_levels(float(np.nanmax(np.where(block.sea, block.h, 0.0))), levels)
        else:
            what = "averaged over depth" if dialect.kind == "mean" else "at the surface"
            files.note(f"only {dialect.u} and {dialect.v} are there: the current {what} is used at every depth.")
        target = RegularTarget(block, box)
        files.note(target.note)
        shape = (len(frames), depth.size, target.latitude.size, target.longitude.size)
        east, north = np.empty(shape, np.float32), np.empty(shape, np.float32)
        surface = _FreeSurface(files, block)
        for number, frame in enumerate(frames):
            pair = _at_rho(frame, dialect, block, at_rho, geographic)
            if vertical is not None:
                zeta = surface(frame, dialect.u)
                weights = DepthWeights(vertical.depths(block.h[block.sea], zeta[block.sea]), depth)
                pair = tuple(_at_sea(block.sea, weights.apply(part[:, block.sea])) for part in pair)
            east[number], north[number] = (target.apply(part) for part in pair)
        surface.report()
        if vertical is not None:
            _note_below_bottom(files, block, depth)
        return CurrentGrid(
            time=np.array([frame.time for frame in frames]),
            depth=depth,
            latitude=target.latitude,
            longitude=target.longitude,
            east=east,
            north=north,
            source=files.source("ROMS"),
            sea=target.sea,
        )


def read_roms_bathymetry(path: str | Path, box: Box | None = None) -> BathymetryGrid:
    """Read the seafloor of a ROMS grid, history or initial file on a regular grid.

    Parameters
    ----------
    path : file with ``h``, ``lon_rho``, ``lat_rho`` and, so that land is known, ``mask_rho``.
    box : (lat0, lat1, lon0, lon1), degrees, or None for everything.

    Returns
    -------
    Depth in m, positive down; -1 on land, whose height the model does not hold; NaN outside a bent grid.
    """
    with RomsFiles.open(path) as files:
        holder = files.holding("h")
        if holder is None or len(holder.shape("h")) < 2:
            raise DataError(
                f"{files.names}: expected variable 'h' (depth at rho points), found none. Give the model's grid file."
            )
        full = holder.shape("h")[-2:]
        block = read_horizontal(files, full, box, vector=False, need_mask=False)
        if files.holding("mask_rho", full) is None:
            files.note("mask_rho is not in the file: land cannot be told from shallow water.")
        target = RegularTarget(block, box)
        depth = target.apply(block.h)
        files.note(target.note)
        land = target.inside & ~target.sea
        depth[land] = LAND_DEPTH
        files.note(
            f"land is given {LAND_DEPTH:g} m; depths are the model's own: smoothed and at least "
            f"{np.nanmin(np.where(block.sea, block.h, np.nan)):.3g} m."
        )
        return BathymetryGrid(target.latitude, target.longitude, depth, files.source("ROMS"))


def _velocities(files: RomsFiles) -> tuple[Dialect, list[RomsFile]]:
    """The velocity variables to use and the files that hold them."""
    for dialect in DIALECTS:
        holders = [f for f in files.fields if f.shape(dialect.u) is not None and f.shape(dialect.v) is not None]
        if holders:
            return dialect, holders
    wanted = ", ".join(f"{dialect.u} and {dialect.v}" for dialect in DIALECTS)
    raise DataError(
        f"{files.names}: expected one of the velocity pairs {wanted}, found none. Name a history, average, "
        "climatology or initial file."
    )


def _layout(files: RomsFiles, holders: list[RomsFile], dialect: Dialect) -> tuple[tuple[int, int], bool, bool]:
    """Shape of the rho grid, whether velocities are east and north already, and whether they lie at rho points.

    Dimension names differ from file to file, so only the shapes of u and v are looked at.
    """
    shapes = {file.name: (file.shape(dialect.u), file.shape(dialect.v)) for file in holders}
    spatial = {name: (u[1:], v[1:]) for name, (u, v) in shapes.items()}
    if len(set(spatial.values())) > 1:
        listed = "; ".join(f"{name} {u[-2:]}" for name, (u, _) in spatial.items())
        raise DataError(
            f"{files.names}: expected all velocities on one grid, found '{dialect.u}' of different shapes: {listed}. "
            "Give the files of one grid at a time."
        )
    u, v = next(iter(shapes.values()))
    where = f"{holders[0].name}: variables '{dialect.u}' {u} and '{dialect.v}' {v}"
    if len(u) != len(v) or len(u) not in (3, 4):
        raise DataError(f"{where}: expected (time, s_rho, eta, xi) or (time, eta, xi). Reorder the dimensions.")
    if u[-2:] == v[-2:]:
        full = u[-2:]
        standard = text_attribute(holders[0].data.variables[dialect.u], "standard_name")
        geographic = dialect.geographic or "eastward" in standard
        if not geographic:
            files.note(f"{where} lie at rho points: taken as components along the grid's axes.")
        return full, geographic, True
    full = (u[-2], v[-1])
    if (full[0] - 1, full[1] - 1) != (v[-2], u[-1]):
        raise DataError(
            f"{where}: expected u of shape (.., ny, nx - 1) and v of shape (.., ny - 1, nx). "
            "Cut the file again so that both cover the same cells."
        )
    return full, dialect.geographic, False


def _frames(
    files: RomsFiles, holders: list[RomsFile], dialect: Dialect, period: tuple[object, object] | None
) -> list[Frame]:
    """All times of all files in order, cut to the period and one time beyond either end."""
    frames = [
        Frame(float(time), file, index)
        for file in holders
        for index, time in enumerate(files.times(file, dialect.u))
        if np.isfinite(time)
    ]
    if not frames:
        raise DataError(f"{files.names}: expected at least one time of '{dialect.u}', found none.")
    frames.sort(key=lambda frame: frame.time)
    kept = [frames[0]]
    for frame in frames[1:]:
        if frame.time - kept[-1].time > 0.5:
            kept.append(frame)
    if len(kept) < len(frames):
        files.note(f"{len(frames) - len(kept)} times are in more than one file; the first listed is used.")
    if period is None:
        return kept
    start, end = sorted(epoch_seconds(moment) for moment in period)
    times = np.array([frame.time for frame in kept])
    if end < times[0] or start > times[-1]:
        raise CoverageError(
            f"{files.names}: expected currents between {iso(start)} and {iso(end)}, found {iso(times[0])} to "
            f"{iso(times[-1])}. Choose other files or another period."
        )
    low = max(int(np.searchsorted(times, start, side="right")) - 1, 0)
    high = min(int(np.searchsorted(times, end, side="left")) + 1, times.size)
    return kept[low:high]


def _require_depth(files: RomsFiles, block: HorizontalGrid) -> None:
    """The water depth must be known wherever there is water."""
    missing = int((block.sea & ~np.isfinite(block.h)).sum())
    if missing:
        raise DataError(
            f"{files.names}: expected the water depth 'h' at every point of the sea, found none at {missing} of "
            f"{int(block.sea.sum())}. It is in the model's grid file; give that as grid."
        )


def _at_rho(
    frame: Frame, dialect: Dialect, block: HorizontalGrid, at_rho: bool, geographic: bool
) -> tuple[Array, Array]:
    """Velocity east and north at the rho points of the block, shape (level, ny, nx), or (1, ny, nx)."""
    rows, columns = block.rows, block.columns
    parts = []
    for name in (dialect.u, dialect.v):
        units = text_attribute(frame.file.data.variables[name], "units")
        factor = speed_factor(units, f"{frame.file.name}: variable '{name}'") if units else 1.0
        if at_rho:
            values = frame.file.values(name, (frame.index, ..., rows, columns))
        elif name == dialect.u:
            faces = _faces(frame, name, rows, columns, -1, block.full[1])
            values = masked_mean(faces, block.sea_u, -1)
        else:
            faces = _faces(frame, name, rows, columns, -2, block.full[0])
            values = masked_mean(faces, block.sea_v, -2)
        values = factor * values
        parts.append(values[None] if values.ndim == 2 else values)
    u, v = parts
    if geographic:
        return u, v
    cosine, sine = np.cos(block.angle), np.sin(block.angle)
    return u * cosine - v * sine, u * sine + v * cosine


def _faces(frame: Frame, name: str, rows: slice, columns: slice, axis: int, size: int) -> Array:
    """Values on all faces around the block along one axis; faces outside the model are NaN."""
    along = columns if axis == -1 else rows
    inner = slice(max(along.start - 1, 0), min(along.stop, size - 1))
    key = (frame.index, ..., rows, inner) if axis == -1 else (frame.index, ..., inner, columns)
    values = frame.file.values(name, key)
    pad = [(0, 0)] * values.ndim
    pad[axis] = (int(along.start == 0), int(along.stop == size))
    return np.pad(values, pad, constant_values=np.nan)


def _at_sea(sea: Array, values: Array) -> Array:
    """Values (level, point at sea) spread over the block (level, ny, nx), NaN on land."""
    out = np.full((values.shape[0], *sea.shape), np.nan)
    out[:, sea] = values
    return out


def masked_mean(faces: Array, is_open: Array, axis: int) -> Array:
    """Mean of the two faces of each cell, leaving out closed ones.

    A cell with both faces closed has no flow in that direction: 0. A cell whose open faces hold no value has none.

    Parameters
    ----------
    faces : (..., ny, nx + 1) for axis -1, (..., ny + 1, nx) for axis -2.
    is_open : the same trailing shape, True where water flows through.
    """
    known = is_open & np.isfinite(faces)
    values = np.where(known, faces, 0.0)

    def pair_sum(part: Array) -> Array:
        moved = np.moveaxis(part, axis, -1)
        return np.moveaxis(moved[..., :-1] + moved[..., 1:], -1, axis)

    count = pair_sum(known.astype(float))
    mean = pair_sum(values) / np.maximum(count, 1.0)
    return np.where((count == 0) & (pair_sum(is_open.astype(float)) > 0), np.nan, mean)


class _FreeSurface:
    """Reads the free surface of a frame and remembers how plausible it was."""

    def __init__(self, files: RomsFiles, block: HorizontalGrid):
        self.files, self.block = files, block
        self.low, self.high, self.large, self.dry, self.total = np.inf, -np.inf, 0, 0, 0

    def __call__(self, frame: Frame, name: str) -> Array:
        """Free surface (ny, nx) m, positive up; 0 where the file has none."""
        block, file = self.block, frame.file
        shape = file.shape("zeta")
        if shape is None or shape[-2:] != block.full or shape[0] != file.shape(name)[0] or len(shape) != 3:
            self.files.note(f"{file.name}: no free surface 'zeta' for these times; taken as 0.")
            return np.zeros(block.h.shape)
        zeta = np.nan_to_num(file.values("zeta", (frame.index, block.rows, block.columns)), nan=0.0)
        sea = zeta[block.sea]
        if sea.size:
            self.low, self.high = min(self.low, float(sea.min())), max(self.high, float(sea.max()))
            self.large += int((np.abs(sea) > PLAUSIBLE_ZETA).sum())
            self.dry += int((sea + block.h[block.sea] < THINNEST).sum())
            self.total += sea.size
        return zeta

    def report(self) -> None:
        """Note what was odd."""
        if self.large:
            self.files.note(
                f"free surface zeta spans {self.low:.1f} to {self.high:.1f} m; {self.large} of {self.total} values at "
                f"sea exceed {PLAUSIBLE_ZETA:g} m: doubtful, they only stretch the depths of the levels there."
            )
        if self.dry:
            self.files.note(f"{self.dry} of {self.total} columns fell dry; {THINNEST:g} m of water is assumed.")


def _note_below_bottom(files: RomsFiles, block: HorizontalGrid, depth: Array) -> None:
    """Tell which share of the values lies below the seafloor and was repeated from above."""
    h = block.h[block.sea]
    if h.size:
        share = float((depth[:, None] > h).mean())
        files.note(f"{100 * share:.0f} % of the values at sea lie below the seafloor and repeat the deepest one.")
