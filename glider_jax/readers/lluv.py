"""CODAR SeaSonde tables in LLUV text: maps of total currents (.tuv) to a regular grid.

NumPy only. A newcomer would get wrong: a radial file has columns VELU and VELV too, but they are the projection of
the current on the line to the radar, never the current; and the totals' quality control is left to the reader.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from glider_jax.errors import CoverageError, DataError, did_you_mean
from glider_jax.readers.grids import cut
from glider_jax.records import Array, CurrentGrid, Source

NEEDED = ("LOND", "LATD", "VELU", "VELV")
WORST_GDOP = 10.0  # geometric dilution of precision above which radar networks discard a total
FASTEST = 1.0  # m s-1, where a file names no CurrentVelocityLimit
KM_PER_DEGREE = 111.195
OTHER_KINDS = {
    "rdls": "a map of radials, which are projections on the line to the radar and no currents",
    "elps": "a map of elliptical vectors, which are projections and no currents",
    "wave": "a record of waves",
    "wavl": "a record of waves",
}


@dataclass
class Totals:
    """One map of totals: where, when and how fast, m s-1, with what was dropped."""

    path: Path
    time: float
    lon: Array
    lat: Array
    east: Array
    north: Array
    east_sd: Array
    north_sd: Array
    spacing: float | None
    notes: list[str] = field(default_factory=list)


def looks_like_lluv(path: Path) -> bool:
    """Whether a file begins like LLUV text."""
    with open(path, "rb") as stream:
        head = stream.read(64).lstrip()
    return head.startswith((b"%CTF", b"%FileType"))


def read_totals(path: str | Path) -> Totals:
    """Read one map of total currents, with vectors dropped that its own flags and limits call bad.

    Vectors are dropped where VFLG is not 0, where GDOP exceeds 10, and where the speed exceeds the file's
    ``%CurrentVelocityLimit`` (1 m/s if it names none).

    Raises
    ------
    DataError : the file is not a map of totals, or its table is not what its header says.
    """
    path = Path(path)
    where = path.name
    header, rows = _first_table(path)
    _check_kind(header, where)
    columns = header.get("TableColumnTypes", "").split()
    absent = [name for name in NEEDED if name not in columns]
    if absent:
        raise DataError(
            f"{where}: %TableColumnTypes: expected {', '.join(NEEDED)}, found {' '.join(columns) or 'none'}."
            f"{did_you_mean(absent[0], columns)} The file holds no map of totals."
        )
    table = _numbers(rows, len(columns), where)
    notes: list[str] = []
    declared = re.match(r"\s*(\d+)", header.get("TableRows", ""))
    if declared and int(declared[1]) != len(table):
        notes.append(f"{where}: %TableRows says {declared[1]}, the table has {len(table)} rows.")
    column = {name: table[:, index] for index, name in enumerate(columns)}
    lon, lat = column["LOND"], column["LATD"]
    east, north = column["VELU"] * 0.01, column["VELV"] * 0.01
    limit = _first_number(header.get("CurrentVelocityLimit"))
    limit = FASTEST if limit is None else limit * 0.01
    keep = np.isfinite(east) & np.isfinite(north) & (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0)
    keep = _keep(keep, column.get("VFLG", np.zeros(len(table))) == 0, f"{where}: {{}} vectors flagged in VFLG", notes)
    gdop = column.get("GDOP", np.zeros(len(table)))
    keep = _keep(keep, ~(gdop > WORST_GDOP), f"{where}: {{}} vectors with GDOP over {WORST_GDOP:g}", notes)
    speed = np.hypot(east, north)
    keep = _keep(keep, speed <= limit, f"{where}: {{}} vectors faster than {limit:g} m/s", notes)
    sds = [np.abs(column.get(name, np.full(len(table), np.nan))) * 0.01 for name in ("UQAL", "VQAL")]
    sds = [np.where(sd < 9.0, sd, np.nan) for sd in sds]  # 999 cm/s stands for no estimate
    spacing = _first_number(header.get("GridSpacing"))
    return Totals(
        path, _stamp(header, where), lon[keep], lat[keep], east[keep], north[keep], sds[0][keep], sds[1][keep],
        spacing, notes,
    )  # fmt: skip


def _keep(keep: Array, good: Array, sentence: str, notes: list[str]) -> Array:
    """Combine two masks and note how many rows the second one drops."""
    lost = int((keep & ~good).sum())
    if lost:
        notes.append(sentence.format(lost) + " were dropped.")
    return keep & good


def _first_table(path: Path) -> tuple[dict[str, str], list[str]]:
    """Header and rows of the first table; later tables are diagnostics."""
    header: dict[str, str] = {}
    rows: list[str] = []
    inside = ended = False
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as problem:
        raise DataError(f"{path}: expected an LLUV file, found {problem.strerror}. Check the path.") from problem
    for line in lines:
        if line.startswith("%%"):
            continue
        if line.startswith("%"):
            key, _, value = line[1:].partition(":")
            if key == "TableEnd":
                ended = True
                break
            inside = inside or key == "TableStart"
            header.setdefault(key.strip(), value.strip())
        elif inside and line.strip():
            rows.append(line)
    if not inside:
        raise DataError(f"{path.name}: expected a table after %TableStart, found none. The file holds no map.")
    if not ended:
        raise DataError(f"{path.name}: expected %TableEnd, found the end of the file. Fetch the file again.")
    return header, rows


def _check_kind(header: dict[str, str], where: str) -> None:
    """Raise a DataError where the file is not a map of totals."""
    words = header.get("FileType", "").split()
    kind = " ".join(words[:2]).lower()
    for code, meaning in OTHER_KINDS.items():
        if code in kind or (code.startswith("wav") and "wv" in kind):
            raise DataError(
                f"{where}: expected a map of total currents (LLUV tots), found {meaning}. "
                "Combine the radials of two or more radars to totals first, or name a .tuv file."
            )
    if "tots" not in kind:
        raise DataError(
            f"{where}: %FileType: expected 'LLUV tots', found '{header.get('FileType', 'none')}'. Name a .tuv file."
        )


def _numbers(rows: list[str], width: int, where: str) -> Array:
    """Rows of text as numbers (n, width)."""
    table = np.empty((len(rows), width))
    for index, row in enumerate(rows):
        words = row.split()
        try:
            table[index] = [float(word) for word in words[:width]]
        except ValueError as problem:
            raise DataError(
                f"{where}: row {index + 1} of the table: expected {width} numbers, found '{row.strip()[:60]}' "
                f"({problem}). Fetch the file again."
            ) from problem
    return table


def _first_number(text: str | None) -> float | None:
    """The number a header value begins with, or None."""
    found = re.match(r"\s*([-+]?\d+(?:\.\d*)?)", text or "")
    return float(found[1]) if found else None


def _stamp(header: dict[str, str], where: str) -> float:
    """Middle of the time the map covers, seconds since 1970."""
    text = header.get("TimeStamp", "")
    try:
        stamp = datetime(*(int(float(word)) for word in text.split()[:6]), tzinfo=UTC).timestamp()
    except (ValueError, TypeError) as problem:
        raise DataError(
            f"{where}: %TimeStamp: expected YYYY MM DD HH MM SS, found '{text or 'none'}'. Correct the header."
        ) from problem
    zone = re.match(r'\s*"[^"]*"\s*([-+]?\d+(?:\.\d*)?)', header.get("TimeZone", ""))
    stamp -= float(zone[1]) * 3600.0 if zone else 0.0
    if header.get("TimeMarks", "").lower().startswith("start"):
        stamp += (_first_number(header.get("TimeCoverage")) or 0.0) * 30.0
    return stamp


def totals_grid(
    maps: Sequence[Totals], box: tuple[float, float, float, float] | None, digests: dict[str, str]
) -> CurrentGrid:
    """Put maps of totals on one regular grid, in time order, cut to the box.

    Raises
    ------
    DataError : the positions are not those of a grid.
    CoverageError : no vector is left, or the box lies outside of the map.
    """
    notes = [note for one in maps for note in one.notes]
    if sum(one.lon.size for one in maps) == 0:
        raise CoverageError(
            f"{maps[0].path.name}: expected currents, found no vector left after quality control "
            f"({'; '.join(notes) or 'the table is empty'}). Name another hour."
        )
    all_lon, all_lat = (np.concatenate([getattr(one, name) for one in maps]) for name in ("lon", "lat"))
    all_lon = _one_turn(all_lon)
    spacing = next((one.spacing for one in maps if one.spacing), None)
    middle = float(np.cos(np.radians(all_lat.mean())))
    lat = _axis(all_lat, spacing and spacing / KM_PER_DEGREE)
    lon = _axis(all_lon, spacing and spacing / KM_PER_DEGREE / middle)
    moved = max(_misfit(all_lat, lat) * KM_PER_DEGREE, _misfit(all_lon, lon) * KM_PER_DEGREE * middle)
    if spacing is not None and moved > 0.75 * spacing:
        raise DataError(
            f"{maps[0].path.name}: expected vectors on a grid of {spacing:g} km, found them up to {moved:.1f} km off. "
            "Grid the map first."
        )
    if spacing is not None and moved > 0.05 * spacing:
        notes.append(f"{maps[0].path.name}: vectors were moved by up to {moved:.1f} km to the nearest grid cell.")
    rows, columns = cut(lat, lon, box, maps[0].path.name)
    times = np.array([one.time for one in maps])
    shape = (times.size, 1, lat.size, lon.size)
    fields = {name: np.full(shape, np.nan) for name in ("east", "north", "east_sd", "north_sd")}
    start = 0
    for k, one in enumerate(maps):
        j = np.abs(lat - one.lat[:, None]).argmin(axis=1)
        i = np.abs(lon - all_lon[start : start + one.lon.size, None]).argmin(axis=1)
        start += one.lon.size
        for name, values in fields.items():
            values[k, 0, j, i] = getattr(one, name)
    order = np.argsort(times, kind="stable")
    fields = {name: values[order][:, :, rows, columns] for name, values in fields.items()}
    known = np.isfinite(fields["east_sd"]).any()
    notes.append("times are the middle of what each map covers.")
    return CurrentGrid(
        time=times[order],
        depth=np.zeros(1),
        latitude=lat[rows],
        longitude=lon[columns],
        east=fields["east"],
        north=fields["north"],
        east_sd=fields["east_sd"] if known else None,
        north_sd=fields["north_sd"] if known else None,
        source=Source("CODAR totals (LLUV)", digests, tuple(notes)),
    )


def _one_turn(lon: Array) -> Array:
    """Longitudes without a jump, the westernmost in [-180, 180)."""
    centre = np.degrees(np.angle(np.exp(1j * np.radians(lon)).mean()))
    lon = centre + (lon - centre + 180.0) % 360.0 - 180.0
    return lon - 360.0 * np.floor((lon.min() + 180.0) / 360.0)


def _axis(values: Array, expected: float | None) -> Array:
    """Ascending axis of uniform step through the distinct values."""
    distinct = np.unique(np.round(values, 5))
    if distinct.size == 1:
        return distinct
    steps = np.diff(distinct)
    # Where every row has its own longitudes only the header's spacing makes sense.
    step = float(np.median(steps[steps > 0.5 * steps.max()]))
    if expected is not None:
        near = steps[(steps > 0.7 * expected) & (steps < 1.4 * expected)]
        step = float(np.median(near)) if near.size >= 0.5 * steps.size else expected
    count = int(round((distinct[-1] - distinct[0]) / step)) + 1
    if count > 20_000:
        raise DataError(f"expected positions on a grid, found a step of {step:g} degrees. Check %GridSpacing.")
    return np.linspace(distinct[0], distinct[0] + step * (count - 1), count) if count > 1 else distinct[:1]


def _misfit(values: Array, axis: Array) -> float:
    """Largest distance of a value from its nearest axis point."""
    right = np.clip(np.searchsorted(axis, values), 1, max(axis.size - 1, 1))
    if axis.size == 1:
        return float(np.abs(values - axis[0]).max())
    return float(np.minimum(np.abs(values - axis[right - 1]), np.abs(values - axis[right])).max())
