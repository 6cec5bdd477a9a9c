"""What a reader mends in glider recordings, each kind counted: clocks, duplicates, sentinels, fixes, position
formats.

NumPy only. Nothing is mended silently: every function adds to a :class:`Tally`, whose repairs end up in
``Recording.repairs``. A value that cannot be right becomes NaN; a row goes only where its time cannot be
used."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from glider_jax.records import Array, Repair

#: Plausible times of a recording, s since 1970: 1990-01-01 to 2100-01-01.
EARLIEST, LATEST = 631_152_000.0, 4_102_444_800.0
#: Slocum firmware's "never set" position.
UNSET_POSITION = 69_696_969.0
#: A fix that needs more than this between its neighbours is wrong: drift and glide stay below 3 m/s.
FASTEST, JUMP = 3.0, 300.0
#: m; an antenna can still be up at this depth of the sensor. A fix is old, and held, if the glider could not have
#: risen to it from its nearest depth, or sunk to that, at ``FASTEST_RISE`` m/s.
FIX_DEPTH, FASTEST_RISE = 6.0, 0.6
#: s; fixes further apart belong to different surfacings.
SURFACING = 1800.0
METRES_PER_DEGREE = 111_195.0


@dataclass
class Tally:
    """Counts repairs by kind, with the first example of each."""

    counts: dict[str, int] = field(default_factory=dict)
    examples: dict[str, str] = field(default_factory=dict)

    def add(self, kind: str, count: int, detail: str = "", *, join: bool = False) -> None:
        """Add ``count`` repairs of a kind; the first detail is its example, or all of them joined."""
        if count <= 0:
            return
        self.counts[kind] = self.counts.get(kind, 0) + int(count)
        if join and kind in self.examples:
            self.examples[kind] += f"; {detail}"
        elif detail:
            self.examples.setdefault(kind, detail)

    def repairs(self) -> tuple[Repair, ...]:
        """All kinds in the order in which they were first met."""
        return tuple(Repair(kind, n, self.examples.get(kind, "")) for kind, n in self.counts.items())


@dataclass
class Table:
    """Rows of one file and one computer, before repair.

    ``stream`` is ``flight``, ``science`` or ``product``. ``columns`` holds float64 values under the file's
    own names with ``units`` as the file gives them. ``label`` is the file's name. ``segments`` and ``starts``
    name the glider's own files behind it and say when each began, ``missions`` what they flew. ``facts``
    holds what the file says of itself, ``notes`` what the reader assumed."""

    label: str
    stream: str
    time: Array
    columns: dict[str, Array]
    units: dict[str, str] = field(default_factory=dict)
    segments: tuple[str, ...] = ()
    starts: tuple[float, ...] = ()
    missions: tuple[str, ...] = ()
    facts: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def take(self, rows: Array) -> Table:
        """The same table with some of its rows, by index or mask."""
        return replace(self, time=self.time[rows], columns={n: v[rows] for n, v in self.columns.items()})


def mend_clock(table: Table, tally: Tally) -> Table:
    """Leave out rows without a usable time, and one side of every backward clock step.

    Of the rows that a step makes overlap, the smaller group goes: one wild future time does not cost the rest
    of the file, and a clock set back by its first GPS fix costs the rows written before it. Equal times stay:
    they are merged later."""
    time = table.time
    usable = np.isfinite(time) & (time >= EARLIEST) & (time <= LATEST)
    default = np.isfinite(time) & (np.abs(time) < 1.0)
    tally.add("default records with timestamp 0", int(default.sum()), table.label)
    garbage = ~usable & ~default
    if garbage.any():
        row = int(np.flatnonzero(garbage)[0])
        tally.add("rows without a usable time", int(garbage.sum()), f"{table.label} row {row}")
    kept = np.flatnonzero(usable)
    while True:
        now = time[kept]
        back = np.flatnonzero(np.diff(now) < 0.0)
        if back.size == 0:
            break
        i = int(back[0]) + 1
        before = i - int(np.searchsorted(now[:i], now[i], side="right"))
        ahead = np.flatnonzero(now[i:] > now[i - 1])
        after = int(ahead[0]) if ahead.size else now.size - i
        detail = f"{table.label} row {int(kept[i])}: {now[i] - now[i - 1]:.1f} s"
        tally.add("clock steps backwards", 1, detail)
        tally.add("rows dropped at a clock step", min(before, after), detail)
        gone = slice(i - before, i) if before <= after else slice(i, i + after)
        kept = np.delete(kept, gone)
    return table if kept.size == time.size else table.take(kept)


def merge(tables: Iterable[Table], names: dict[str, list[Array]], tally: Tally) -> tuple[Array, dict[str, Array]]:
    """Merge repaired tables into one strictly ascending time axis.

    Parameters
    ----------
    tables : with ascending, possibly repeated times.
    names : for each output channel, one array (or an empty one) per table, aligned with the table's rows.

    Returns
    ------- Times (row,) and channels (row,), NaN where none of the tables has a value; where several have one
    for the same time, the first table and the first row win."""
    tables = list(tables)
    time = np.unique(np.concatenate([t.time for t in tables])) if tables else np.empty(0)
    places = [np.searchsorted(time, t.time) for t in tables]
    for table, place in zip(tables, places, strict=True):
        repeats = int(place.size - np.unique(place).size)
        tally.add("rows with a repeated time merged", repeats, table.label)
    streams: dict[str, list[Table]] = {}
    for table in tables:
        streams.setdefault(table.stream, []).append(table)
    for group in streams.values():
        joined = np.concatenate([np.unique(t.time) for t in group])
        shared = int(joined.size - np.unique(joined).size)
        tally.add("rows found in more than one file merged", shared, group[-1].label)
    channels = {}
    for name, columns in names.items():
        out = np.full(time.size, np.nan)
        for place, values in reversed(list(zip(places, columns, strict=True))):
            if values.size == 0:
                continue
            good = np.flatnonzero(np.isfinite(values))[::-1]
            out[place[good]] = values[good]
        if np.isfinite(out).any():
            channels[name] = out
    return time, channels


def is_nmea(latitude: Array, longitude: Array, said: str) -> tuple[bool, str]:
    """Whether positions are NMEA degrees and minutes (DDDMM.mmmm), and a sentence where that is an
    assumption.

    Values beyond 90 and 180 settle it. Where all could be either (NMEA below 1.8 degrees), what the file says
    of itself decides, then decimal degrees are assumed."""
    lat = latitude[np.isfinite(latitude) & (np.abs(latitude) <= 9060.0)]
    lon = longitude[np.isfinite(longitude) & (np.abs(longitude) <= 18060.0)]
    if lat.size == 0 and lon.size == 0:
        return False, ""
    far_lat = lat.size > 0 and np.mean(np.abs(lat) > 90.0) > 0.5
    far_lon = lon.size > 0 and np.mean(np.abs(lon) > 180.0) > 0.5
    if far_lat or far_lon:
        return True, ""
    words = said.lower()
    if "nmea" in words or "dddmm" in words:
        return True, "positions read as NMEA degrees and minutes, as the file says"
    small = np.all(np.abs(lat) < 1.8) and np.all(np.abs(lon) < 1.8)
    if small and "decimal" not in words and "degrees_" not in words:
        return False, "positions within 1.8 degrees of 0 N 0 E read as decimal degrees; the file does not say"
    return False, ""


def nmea_to_degrees(values: Array) -> Array:
    """Decimal degrees of NMEA degrees and minutes, sign kept; NaN where the minutes are above 60.

    Examples
    --------
    >>> nmea_to_degrees(np.array([-7040.271, 4138.861, 1260.0, 4599.9])).round(6).tolist()
    [-70.671183, 41.647683, 13.0, nan]
    """
    size = np.abs(values)
    degrees = np.floor(size / 100.0)
    minutes = size - 100.0 * degrees
    out = np.copysign(degrees + minutes / 60.0, values)
    return np.where(minutes <= 60.0005, out, np.nan)


def blank(values: Array, bad: Array, kind: str, detail: str, tally: Tally) -> Array:
    """Set values to NaN where ``bad``, and count them."""
    bad = bad & np.isfinite(values)
    count = int(bad.sum())
    if count == 0:
        return values
    tally.add(kind, count, detail)
    return np.where(bad, np.nan, values)


def blank_sentinels(values: Array, name: str, tally: Tally) -> Array:
    """NaN for infinities, 1e308 and 69696969, which Slocum firmware writes for "never set"."""
    infinite = np.isinf(values)
    if infinite.any():
        tally.add("infinite values", int(infinite.sum()), name)
        values = np.where(infinite, np.nan, values)
    huge = np.abs(values) >= 1e30
    values = blank(values, huge, "never-set values (1e308)", name, tally)
    unset = np.abs(values) == UNSET_POSITION
    return blank(values, unset, "never-set values (69696969)", name, tally)


def mend_pair(channels: dict[str, Array], first: str, second: str, kind: str, tally: Tally) -> None:
    """NaN where both of a pair are exactly zero (no waypoint, no estimate), or where one of them is
    missing."""
    if first not in channels or second not in channels:
        return
    a, b = channels[first], channels[second]
    bad = ((a == 0.0) & (b == 0.0)) | (np.isfinite(a) & ~np.isfinite(b))
    bad |= np.isfinite(b) & ~np.isfinite(a)
    count = int(((np.isfinite(a) | np.isfinite(b)) & bad).sum())
    if count:
        tally.add(kind, count, f"{first}, {second}")
        channels[first] = np.where(bad, np.nan, a)
        channels[second] = np.where(bad, np.nan, b)


def mend_fixes(time: Array, channels: dict[str, Array], tally: Tally) -> None:
    """Blank GPS fixes that are half, null, flagged, held under water, or too far from their neighbours."""
    if "gps_latitude" not in channels or "gps_longitude" not in channels:
        return
    mend_pair(channels, "gps_latitude", "gps_longitude", "fixes at 0 N 0 E or with one coordinate", tally)
    lat, lon = channels["gps_latitude"].copy(), channels["gps_longitude"].copy()

    def reject(rows: Array, kind: str) -> None:
        if rows.size:
            tally.add(kind, int(rows.size), f"row {int(rows[0])}")
            lat[rows] = np.nan
            lon[rows] = np.nan

    if "gps_status" in channels:
        status = channels["gps_status"]
        reject(
            np.flatnonzero(np.isfinite(lat) & np.isfinite(status) & (status != 0.0)),
            "fixes with a bad status",
        )
    if "depth" in channels:
        rows = np.flatnonzero(np.isfinite(lat))
        known = np.flatnonzero(np.isfinite(channels["depth"]))
        if rows.size and known.size:
            depth, place = channels["depth"], np.searchsorted(time[known], time[rows])
            deep = np.zeros(rows.size, bool)
            for side in (known[np.clip(place - 1, 0, known.size - 1)], known[np.clip(place, 0, known.size - 1)]):
                deep |= depth[side] - FASTEST_RISE * np.abs(time[side] - time[rows]) > FIX_DEPTH
            reject(rows[deep], "fixes held under water")
    for _ in range(3):
        rows = np.flatnonzero(np.isfinite(lat))
        jumps = rows[_jumps(time[rows], lat[rows], lon[rows])]
        if jumps.size == 0:
            break
        reject(jumps, "fixes that jump")
    channels["gps_latitude"], channels["gps_longitude"] = lat, lon


def _jumps(time: Array, lat: Array, lon: Array) -> Array:
    """True for fixes too far from their neighbours: spikes, and one or two old fixes reported at power-up.

    A break is a step that neither drift nor glide explains. A run of one or two fixes between breaks is wrong if a
    run of three or more lies on the other side of one, or if the fixes around it agree with each other.
    """
    n = time.size
    bad = np.zeros(n, bool)
    if n < 3:
        return bad

    def too_far(i: Array, j: Array) -> Array:
        east = ((lon[j] - lon[i] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(lat[i]))
        distance = METRES_PER_DEGREE * np.hypot(east, lat[j] - lat[i])
        return distance > JUMP + FASTEST * np.abs(time[j] - time[i])

    step = np.arange(n - 1)
    broken = too_far(step, step + 1)
    parted = broken | (np.diff(time) > SURFACING)
    run = np.concatenate([[0], np.cumsum(parted)])
    size = np.bincount(run)
    for k in np.flatnonzero(broken):
        left, right = run[k], run[k + 1]
        if size[left] <= 2 and size[right] >= 3:
            bad |= run == left
        elif size[right] <= 2 and size[left] >= 3:
            bad |= run == right
    middle = step[1:]
    bad[1:-1] |= broken[:-1] & broken[1:] & ~too_far(middle - 1, middle + 1)
    return bad


def blank_default_science(channels: dict[str, Array], tally: Tally) -> None:
    """Blank CTD values that a science computer wrote before its instrument had answered: all zero, or
    timestamp 0."""
    names = [n for n in ("temperature", "conductivity", "ctd_pressure") if n in channels]
    if not names:
        return
    freezing = 273.15
    zero = np.ones(channels[names[0]].size, bool)
    seen = np.zeros_like(zero)
    for name in names:
        values = channels[name]
        null = freezing if name == "temperature" else 0.0
        zero &= ~np.isfinite(values) | (values == null)
        seen |= np.isfinite(values)
    zero &= seen
    if len(names) < 2:
        zero[:] = False
    if "ctd_time" in channels:
        zero |= channels["ctd_time"] == 0.0
        channels["ctd_time"] = np.where(channels["ctd_time"] == 0.0, np.nan, channels["ctd_time"])
    count = int((zero & seen).sum())
    if count:
        tally.add("default science records (all zero or timestamp 0)", count, ", ".join(names))
        for name in names:
            channels[name] = np.where(zero, np.nan, channels[name])
