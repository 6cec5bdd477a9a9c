"""Gridded currents from NetCDF or CODAR text to one :class:`~glider_jax.records.CurrentGrid`.

NumPy and netCDF4 only. The format is recognised from the content. A newcomer would get wrong: hourly files of one
product come in different units and with overlapping hours, and both are settled here, once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from glider_jax.errors import CoverageError, DataError, did_you_mean
from glider_jax.readers import grids, lluv
from glider_jax.readers.current_layouts import MODELS, RADARS, Layout, is_roms, survey
from glider_jax.readers.current_values import Frames, load
from glider_jax.records import Array, CurrentGrid, Source

NAMES = ("east", "north", "time", "depth", "latitude", "longitude", "units")
ENDINGS = (".nc", ".nc4", ".cdf", ".ncd", ".grd", ".tuv")
LLUV_ENDINGS = (".tuv", ".ruv", ".euv", ".wls")
SAME_TIME = 1.0  # s; frames closer than this are the same frame

Box = tuple[float, float, float, float]


def read_currents(
    paths: str | Path | Sequence[str | Path],
    *,
    box: Box | None = None,
    period: tuple[object, object] | None = None,
    fill: bool = True,
    names: Mapping[str, str] | None = None,
    grid: str | Path | None = None,
) -> CurrentGrid:
    """Read currents from one or several files of one product, or of vintages of it on the same grid.

    Parameters
    ----------
    paths : files, or one folder of which all NetCDF files and CODAR totals are read.
    box : (lat0, lat1, lon0, lon1) in degrees; the grid is cut to it and one cell around it.
    period : first and last time wanted, seconds since 1970 or dates; cut to it and one frame around it.
    fill : whether gaps are filled by :func:`~glider_jax.environment.gaps.fill_gaps`.
    names : the file's own names of ``east``, ``north``, ``time``, ``depth``, ``latitude``, ``longitude`` where they
        are not recognised, and ``units`` of the velocities where the file gives none.
    grid : file with the grid of a native ROMS product, where the product itself does not hold it.

    Returns
    -------
    Currents (time, depth, latitude, longitude) in m s-1, positive east and north, NaN where nothing is known;
    ``source.notes`` says everything that was dropped, converted or assumed.

    Raises
    ------
    DataError : a file cannot be read or is not understood.
    CoverageError : the files do not cover the box or the period, or hold no value there.
    """
    files = _files(paths)
    names = _names(names)
    if box is not None:
        box = grids.check_box(box)
    times = None if period is None else (grids.epoch_seconds(period[0]), grids.epoch_seconds(period[1]))
    if times is not None and not times[0] <= times[1]:
        raise DataError(
            f"period: expected a start before the end, found {grids.iso(times[0])} to {grids.iso(times[1])}."
        )
    kinds = {path: _kind(path) for path in files}
    if len(set(kinds.values())) > 1:
        other = next(path for path in files if kinds[path] != kinds[files[0]])
        raise DataError(
            f"{other.name}: expected {kinds[files[0]]} like {files[0].name}, found {kinds[other]}. "
            "Read the products one by one."
        )
    kind = kinds[files[0]]
    if kind == "a native ROMS file":
        from glider_jax.readers.roms import read_roms_currents

        found = read_roms_currents(files, grid=None if grid is None else Path(grid), box=box, period=times)
    elif kind == "CODAR text":
        found = _read_lluv(files, box, times)
    else:
        found = _read_grids(files, box, times, names)
    _check_values(found, files, box)
    short = _shortfalls(found, box, times)
    found = replace(found, source=replace(found.source, notes=found.source.notes + tuple(short)))
    if fill:
        from glider_jax.environment.gaps import fill_gaps

        found = fill_gaps(found)
    return found


def _files(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files meant, each once, in a stable order."""
    if isinstance(paths, (str, Path)):
        path = Path(paths)
        if not path.is_dir():
            return [path]
        found = sorted(p for p in path.iterdir() if p.is_file() and p.suffix.lower() in ENDINGS)
        if not found:
            raise DataError(f"{path}: expected files ending in {', '.join(ENDINGS)}, found none. Name the files.")
        return found
    found = [file for item in paths for file in _files(item)]
    if not found:
        raise DataError("paths: expected at least one file of currents, found none. Name a file.")
    return list(dict.fromkeys(found))


def _names(names: Mapping[str, str] | None) -> Mapping[str, str]:
    """Check the keys of the user's names."""
    for key in names or {}:
        if key not in NAMES:
            raise DataError(f"names: expected {', '.join(NAMES)}, found '{key}'.{did_you_mean(key, NAMES)}")
    return names or {}


def _kind(path: Path) -> str:
    """What sort of file this is, from its content."""
    if path.is_file() and (path.suffix.lower() in LLUV_ENDINGS or lluv.looks_like_lluv(path)):
        return "CODAR text"
    with grids.open_netcdf(path) as dataset:
        return "a native ROMS file" if is_roms(dataset) else "a NetCDF file on a fixed grid"


def _digests(files: Sequence[Path]) -> dict[str, str]:
    """SHA-256 of each file."""
    return {str(path): Source.digest(path) for path in files}


def _read_lluv(files: Sequence[Path], box: Box | None, period: tuple[float, float] | None) -> CurrentGrid:
    """Read CODAR totals."""
    maps = [lluv.read_totals(path) for path in files]
    chosen = _choose(np.array([one.time for one in maps]), period, files)
    maps = [maps[index] for index in chosen]
    found = lluv.totals_grid(maps, box, _digests([one.path for one in maps]))
    notes: list[str] = []
    keep = _distinct(found.time, np.isfinite(found.east).sum(axis=(1, 2, 3)), notes)
    return replace(
        found,
        time=found.time[keep],
        **{name: _take(getattr(found, name), keep) for name in ("east", "north", "east_sd", "north_sd")},
        source=replace(found.source, notes=found.source.notes + (*notes, *_gaps_in_time(found.time[keep]))),
    )


def _take(values: Array | None, index: Array) -> Array | None:
    """Entries of an array that may be None."""
    return None if values is None else values[index]


def _read_grids(
    files: Sequence[Path], box: Box | None, period: tuple[float, float] | None, names: Mapping[str, str]
) -> CurrentGrid:
    """Read NetCDF files on a fixed grid and join them in time."""
    layouts = [survey(path, names, box) for path in files]
    first = layouts[0]
    if len(layouts) > 1 and any(layout.timeless for layout in layouts):
        bad = next(layout for layout in layouts if layout.timeless)
        raise DataError(f"{bad.path.name}: expected a time to order the files by, found none. Read it alone.")
    for layout in layouts[1:]:
        _same_grid(first, layout)
    owner = np.concatenate([np.full(layout.time.size, k) for k, layout in enumerate(layouts)])
    index = np.concatenate([np.arange(layout.time.size) for layout in layouts])
    time = np.concatenate([layout.time for layout in layouts])
    chosen = np.flatnonzero(np.isfinite(time)) if first.timeless else _choose(time, period, files)
    parts: list[Frames] = []
    order: list[Array] = []
    used: list[Layout] = []
    for k, layout in enumerate(layouts):
        mine = chosen[owner[chosen] == k]
        if mine.size:
            parts.append(load(layout, index[mine], names))
            order.append(time[mine])
            used.append(layout)
    notes = [note for layout, part in zip(used, parts, strict=True) for note in (*layout.notes, *part.notes)]
    notes = _condense(notes, [layout.path.name for layout in used])
    if len(used) < len(files):
        notes.append(f"{len(files) - len(used)} of {len(files)} files hold nothing in the period.")
    stamps = np.concatenate(order)
    ranks = np.argsort(stamps, kind="stable")
    fields = {name: _join([getattr(part, name) for part in parts]) for name in ("east", "north", "east_sd", "north_sd")}
    fields = {name: _take(values, ranks) for name, values in fields.items()}
    keep = _distinct(stamps[ranks], np.isfinite(fields["east"]).sum(axis=(1, 2, 3)), notes)
    fields = {name: _take(values, keep) for name, values in fields.items()}
    stamps = stamps[ranks][keep]
    notes += [] if first.timeless else _gaps_in_time(stamps)
    if any((layout.product != first.product) for layout in used):
        notes.append(f"products joined: {', '.join(sorted({layout.product for layout in used}))}.")
    return CurrentGrid(
        time=stamps,
        depth=first.depth,
        latitude=first.latitude,
        longitude=first.longitude,
        **fields,
        source=Source(first.product, _digests([layout.path for layout in used]), tuple(notes)),
        sea=_sea(first, fields["east"], measured=fields["east_sd"] is not None or first.product in RADARS),
        constant_in_time=first.timeless,
    )


def _same_grid(first: Layout, other: Layout) -> None:
    """Raise a DataError where two files do not share a grid."""
    for name in ("latitude", "longitude", "depth"):
        a, b = getattr(first, name), getattr(other, name)
        step = float(np.abs(np.diff(a)).min()) if a.size > 1 else 1.0
        if a.size != b.size or np.abs(a - b).max() > 0.05 * step:
            raise DataError(
                f"{other.path.name}: {name}: expected the {a.size} values {a[0]:g} to {a[-1]:g} of "
                f"{first.path.name}, found {b.size} values {b[0]:g} to {b[-1]:g}. "
                "Bring the files to one grid, or read them one by one."
            )


def _choose(time: Array, period: tuple[float, float] | None, files: Sequence[Path]) -> Array:
    """Indices of the frames in the period and one frame around it, in time order."""
    known = np.flatnonzero(np.isfinite(time))
    where = files[0].name if len(files) == 1 else f"{files[0].name} and {len(files) - 1} more"
    if known.size == 0:
        raise DataError(f"{where}: expected frames with a time, found none. Correct the time variable.")
    order = known[np.argsort(time[known], kind="stable")]
    if period is None:
        return order
    ranked = time[order]
    if period[1] < ranked[0] - SAME_TIME or period[0] > ranked[-1] + SAME_TIME:
        raise CoverageError(
            f"{where}: expected currents from {grids.iso(period[0])} to {grids.iso(period[1])}, found "
            f"{grids.iso(ranked[0])} to {grids.iso(ranked[-1])}. Fetch files for this time, or correct the start."
        )
    before = ranked[ranked < period[0]]
    after = ranked[ranked > period[1]]
    low = before[-1] if before.size else ranked[0]
    high = after[0] if after.size else ranked[-1]
    return order[(ranked >= low - SAME_TIME) & (ranked <= high + SAME_TIME)]


def _distinct(time: Array, known: Array, notes: list[str]) -> Array:
    """Indices of distinct times, in order; of frames at the same time the fullest is kept, the last if equal."""
    group = np.cumsum(np.append(0, np.diff(time) > SAME_TIME))
    order = np.lexsort((np.arange(time.size), known, group))
    keep = order[np.append(np.diff(group[order]) > 0, True)]
    if keep.size < time.size:
        notes.append(f"{time.size - keep.size} frames at a time given twice were dropped, the fullest kept.")
    return np.sort(keep)


def _join(parts: Sequence[Array | None]) -> Array | None:
    """Join in time; None where no file has it, NaN for the files that have not."""
    if all(part is None for part in parts):
        return None
    shape = next(part.shape for part in parts if part is not None)
    if any(part is None for part in parts):
        parts = [np.full((1, *shape[1:]), np.nan) if part is None else part for part in parts]
    return np.concatenate(parts)


def _condense(notes: Sequence[str], files: Sequence[str]) -> list[str]:
    """Say a note that every file of several repeats only once."""
    if len(files) < 3:
        return list(dict.fromkeys(notes))
    groups: dict[str, list[str]] = {}
    for note in notes:
        name, _, rest = note.partition(": ")
        groups.setdefault(rest if name in files else note, []).append(note)
    return [g[0] if len(g) == 1 else f"{len(g)} files: {rest}" for rest, g in groups.items()]


def _gaps_in_time(time: Array) -> list[str]:
    """A note on missing frames."""
    if time.size < 3:
        return []
    steps = np.diff(time)
    usual = float(np.median(steps))
    wide = steps > 1.5 * usual
    if not wide.any():
        return []
    missing = int(np.round(steps[wide] / usual - 1).sum())
    return [f"{missing} frames are missing; the longest gap is {steps.max() / 3600.0:.1f} h."]


def _sea(layout: Layout, east: Array, measured: bool) -> Array | None:
    """Where the water is: cells with values at any time; None for measurements, whose gaps are not land.

    A product is taken for a measurement where it states errors, or where over 2 % of its cells come and go; a single
    frame tells only where the product is known to be a model.
    """
    known = np.isfinite(east)
    ever = known.any(axis=0)
    model = layout.product in MODELS or layout.depth.size > 1
    wavering = (ever & ~known.all(axis=0)).sum() > 0.02 * max(int(ever.sum()), 1)
    if measured or (wavering and not model) or (known.shape[0] == 1 and not model):
        return None
    return known.any(axis=(0, 1))


def _shortfalls(found: CurrentGrid, box: Box | None, period: tuple[float, float] | None) -> list[str]:
    """Notes on the parts of the box and the period that the files do not cover."""
    notes = []
    if box is not None:
        south, north = found.latitude[[0, -1]]
        middle = 0.5 * (box[2] + box[3])
        turn = 360.0 * round((middle - found.longitude.mean()) / 360.0)
        west, east = found.longitude[[0, -1]] + turn
        if south > box[0] + 1e-6 or north < box[1] - 1e-6 or west > box[2] + 1e-6 or east < box[3] - 1e-6:
            notes.append(
                f"the currents cover only {south:.3f} to {north:.3f} N, {west:.3f} to {east:.3f} E of the area."
            )
    if period is not None and not found.constant_in_time:
        first, last = found.time[[0, -1]]
        if first > period[0] + SAME_TIME or last < period[1] - SAME_TIME:
            notes.append(f"the currents cover only {grids.iso(first)} to {grids.iso(last)} of the time.")
    return notes


def _check_values(found: CurrentGrid, files: Sequence[Path], box: Box | None) -> None:
    """Raise a CoverageError where no value is left."""
    if not np.isfinite(found.east).any():
        place = "anywhere" if box is None else f"in {box[0]:g} to {box[1]:g} N, {box[2]:g} to {box[3]:g} E"
        notes = "; ".join(found.source.notes)
        raise CoverageError(
            f"{files[0].name}: expected a current {place}, found only land and gaps{f' ({notes})' if notes else ''}. "
            "Ask for another area, or fetch another file."
        )
