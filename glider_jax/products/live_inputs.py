"""What a pilot gives to a live forecast: options, the files read, their age, a current product along the way, changes.

Heavy readers are imported where they are needed, so that a stale or empty input is refused at once.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.config import Mission
from glider_jax.errors import DataError
from glider_jax.inference.evidence import Situation, situation_of, surfacings_of_state
from glider_jax.products.coordinates import distance, iso_time
from glider_jax.products.live_missions import mission_files, reconcile
from glider_jax.readers.live_state import StaleFix
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Recording

HOUR, DAY = 3600.0, 86400.0
DEFAULT_HOURS = 48.0


@dataclass(frozen=True)
class Options:
    """What a pilot gives; None and empty take what the glider itself said.

    ``now`` UTC s, NaN for the newest evidence, None for the clock.  ``stale`` s.  ``variation`` rad.
    ``charge_used``, ``capacity`` C.  ``way_home`` s.  ``outputs`` names the products to write besides the summary.
    """

    dialogs: tuple[Path, ...] = ()
    recordings: tuple[Path, ...] = ()
    cache: Path | None = None
    mission: Path | None = None
    decimal_degrees: bool = False
    vehicle: Path | str | None = None
    glider: str | None = None
    currents: tuple[Path, ...] = ()
    bathymetry: Path | None = None
    variation: float | None = None
    now: float | None = None
    stale: float | None = None
    members: int = 2000
    hours: float = DEFAULT_HOURS
    seed: int = 0
    charge_used: float | None = None
    capacity: float | None = None
    reserve: float | None = None
    way_home: float = 0.0
    outputs: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Evidence:
    """The files read and the situation they add up to."""

    situation: Situation
    recording: Recording | None
    mission: Mission | None
    warnings: tuple[str, ...]
    now: float


def gather(options: Options) -> Evidence:
    """Read every input and weigh it up.

    Raises
    ------
    DataError : nothing was given, nothing holds a fix, or no mission runs.
    StaleFix : the newest fix is too old.
    """
    if not options.dialogs and not options.recordings:
        raise DataError(
            "next: expected a dialog or a recording, found neither. Give --dialog LOG or --recording DIR."
        )
    moment = options.now if options.now is not None and math.isfinite(options.now) else None
    recording = None
    if options.recordings:
        from glider_jax.readers.recordings import read_recording

        recording = read_recording(list(options.recordings), cache=options.cache)
    surfacings, files, warnings = _heard(options, moment)
    situation = situation_of(recording, surfacings, moment=moment, variation=options.variation, files=files)
    now = situation.time if options.now is not None and math.isnan(options.now) else options.now
    now = clock.time() if now is None else now
    check_age(situation, now, options.stale)
    mission = None
    if options.mission is not None:
        mission, said = mission_files(options.mission, situation, decimal_degrees=options.decimal_degrees)
        mission, told = reconcile(mission, situation)
        warnings += said + told
    return Evidence(situation, recording, mission, tuple(warnings), now)


def _heard(options: Options, moment: float | None):
    """Surfacings of all dialogs, oldest first, digests of the files, and what was mended in them."""
    if not options.dialogs:
        return [], {}, []
    from glider_jax.readers.dialogs import joined_logs, read_dialog
    from glider_jax.readers.glider_state import read_glider_state

    until = math.inf if moment is None else moment
    logs, surfacings, files, told = [], [], {}, []
    for path in options.dialogs:
        if _is_state(path):
            state = read_glider_state(path, vehicle=options.glider or "")
            files |= dict(state.source.files)
            surfacings += surfacings_of_state(state, until)
            told += [f"{path.name}: {r.count} x {r.kind} ({r.detail})" for r in state.repairs]
            continue
        log = read_dialog(path, vehicle=options.glider)
        files |= dict(log.source.files)
        told += [f"{path.name}: {r.count} x {r.kind} ({r.detail})" for r in log.repairs]
        logs.append(log if moment is None else log.until(moment))
    vehicles = dict.fromkeys(name for log in logs for name in log.vehicles)
    if len(vehicles) > 1:
        raise DataError(
            f"next: expected dialogs of one glider, found {', '.join(vehicles)}. Choose one with --glider."
        )
    joined = logs[0] if len(logs) == 1 else joined_logs(logs) if logs else None
    surfacings += list(joined.surfacings) if joined is not None else []
    surfacings.sort(key=lambda s: s.time if math.isfinite(s.time) else -math.inf)
    if not surfacings:
        told.append("no surfacing found in the dialog")
    return surfacings, files, told


def _is_state(path: Path) -> bool:
    """Whether a file is a dockserver's state, by what it says and not by its name."""
    try:
        with path.open("rb") as stream:
            return b"<gliderState" in stream.read(4096)
    except OSError as error:
        raise DataError(
            f"{path}: expected a dialog log or state file, found {error.strerror}. Check it."
        ) from error


def check_age(situation: Situation, now: float, limit: float | None) -> None:
    """Refuse a fix that is older than ``limit`` s, by default three dives and at least six hours.

    Raises
    ------
    StaleFix : it is older.
    """
    known = situation.behaviour
    limit = max(6 * HOUR, 3.0 * (math.exp(known.duration.centre) + known.stay)) if limit is None else limit
    age = now - situation.time
    if age > limit:
        raise StaleFix(
            f"{situation.name}: expected a fix of the last {limit / HOUR:.1f} h, found the newest at "
            f"{iso_time(situation.time)}, {age / HOUR:.1f} h before {iso_time(now)}. Give newer files, --now data to "
            "forecast as if it were then, or --stale-h.",
            age,
        )


def course(grid: CurrentGrid, situation: Situation, deepest: float) -> Callable[[Array], Array]:
    """East and north of a product, m/s, where the glider was and will be, as a function of UTC s.

    Averaged to the depth of the dives. NaN outside the product's area and time.
    """
    keep = grid.depth <= max(deepest, grid.depth[0])
    east, north = (
        np.nanmean(v[:, keep], axis=1) if keep.sum() > 1 else v[:, 0] for v in (grid.east, grid.north)
    )
    past = [(s.start_time, s.start_latitude, s.start_longitude) for s in situation.segments]
    past = sorted({*past, (situation.time, situation.latitude, situation.longitude)})
    known = situation.behaviour
    to = situation.waypoint
    if to is not None:
        far = float(distance(situation.latitude, situation.longitude, *to))
        past.append((situation.time + max(far / math.exp(known.speed.centre), 60.0), to[0], to[1]))
    track = np.array(past)

    def at(time: Array) -> Array:
        latitude, longitude = (np.interp(time, track[:, 0], track[:, k]) for k in (1, 2))
        return np.stack([_look_up(grid, field, time, latitude, longitude) for field in (east, north)])

    return at


def _look_up(grid: CurrentGrid, field: Array, time: Array, latitude: Array, longitude: Array) -> Array:
    """Linear in time and space, NaN outside; ``field`` (time, latitude, longitude)."""
    turned = grid.longitude[0] + (longitude - grid.longitude[0]) % 360.0

    def place(axis: Array, values: Array) -> tuple[Array, Array, Array]:
        if axis.size == 1:
            return np.zeros(values.size, int), np.zeros(values.size, int), np.zeros(values.size)
        low = np.clip(np.searchsorted(axis, values) - 1, 0, axis.size - 2)
        part = (values - axis[low]) / (axis[low + 1] - axis[low])
        return low, low + 1, np.where((part < -1e-9) | (part > 1.0 + 1e-9), np.nan, part)

    t0, t1, pt = place(grid.time, time)
    if grid.constant_in_time:
        pt = np.zeros(time.size)
    j0, j1, pj = place(grid.latitude, latitude)
    i0, i1, pi = place(grid.longitude, turned)

    def level(t):
        south = field[t, j0, i0] * (1 - pi) + field[t, j0, i1] * pi
        return south * (1 - pj) + (field[t, j1, i0] * (1 - pi) + field[t, j1, i1] * pi) * pj

    return level(t0) * (1 - pt) + level(t1) * pt


def _box(situation: Situation, hours: float) -> tuple[float, float, float, float]:
    margin = 0.3 + 0.6 * hours * HOUR / 111e3
    wide = margin / max(math.cos(math.radians(situation.latitude)), 0.1)
    latitude, longitude = situation.latitude, situation.longitude
    return latitude - margin, latitude + margin, longitude - wide, longitude + wide


def read_product(options: Options, situation: Situation) -> CurrentGrid | None:
    if not options.currents:
        return None
    from glider_jax.readers.currents import read_currents

    begin = min([situation.time - DAY, *(s.dive_time for s in situation.segments[-20:])])
    period = (begin, situation.time + options.hours * HOUR)
    return read_currents(list(options.currents), box=_box(situation, options.hours), period=period)


def read_floor(options: Options, situation: Situation) -> BathymetryGrid | None:
    if options.bathymetry is None:
        return None
    from glider_jax.readers.bathymetry import read_bathymetry

    return read_bathymetry(options.bathymetry, box=_box(situation, options.hours))


def uncovered(grid: CurrentGrid, situation: Situation, horizon: float) -> list[str]:
    """A warning where the product does not reach along the forecast's way."""
    times = situation.time + np.linspace(0.0, horizon, 49)
    missing = ~np.isfinite(course(grid, situation, situation.behaviour.dive_to)(times)).all(axis=0)
    if not missing.any():
        return []
    share = 100.0 * missing.mean()
    return [
        f"the current product does not cover {share:.0f} % of the forecast's way: still water is taken there"
    ]


def with_charge(situation: Situation, options: Options) -> Situation:
    changes: dict[str, Any] = {}
    if options.charge_used is not None:
        changes |= {"charge_used": options.charge_used, "relative_charge": math.nan}
    if options.capacity is not None:
        changes |= {"capacity": options.capacity, "relative_charge": math.nan}
    return replace(situation, **changes)


def signature(paths: Iterable[Path]) -> tuple:
    """Names, sizes and times of files (and of those in folders): changes when something arrives."""
    found = []
    for path in paths:
        inside = sorted(path.iterdir()) if path.is_dir() else [path]
        for one in inside:
            if one.is_file():
                state = one.stat()
                found.append((str(one), state.st_size, state.st_mtime_ns))
    return tuple(found)


def watch(
    paths: Iterable[Path],
    seconds: float,
    act: Callable[[], None],
    *,
    rounds: int | None = None,
    sleep=clock.sleep,
) -> int:
    """Call ``act`` now and whenever files change, looking every ``seconds``; returns how often it was called.

    A change is acted upon once the files have stayed the same for one look, so that a download can end.
    """
    paths = list(paths)
    acted, last, calls, looks = None, None, 0, 0
    while rounds is None or looks < rounds:
        state = signature(paths)
        if state != acted and (state == last or acted is None):
            act()
            acted, calls = state, calls + 1
        last = state
        looks += 1
        if rounds is None or looks < rounds:
            sleep(seconds)
    return calls
