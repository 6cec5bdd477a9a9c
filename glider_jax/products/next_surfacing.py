"""The live job: read what a pilot has at a surfacing, forecast the next one, freeze it, score the last one.

The command line parses and prints; everything else happens here. JAX is loaded only when members fly.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
import time as clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.errors import ConfigError, DataError
from glider_jax.inference.evidence import Situation, situation_of, surfacings_of_state
from glider_jax.products.coordinates import LocalFrame, distance, iso_time, place_text
from glider_jax.readers.dead_reckoning import finite, metres
from glider_jax.readers.live_state import StaleFix
from glider_jax.records import Array, CurrentGrid, Recording, Track

HOUR, DAY, MILE = 3600.0, 86400.0, 1852.0
DEFAULT_HOURS = 48.0
SPREAD = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
#: Slocum ``start_when`` codes and the rules of a mission that can cause them.
_CODES = {
    2: "yo_done", 3: "mission_done", 6: "after", 7: "waypoint", 8: "waypoint", 9: "every", 11: "science",
    12: "no_comms", 13: "utc", 16: "inflections",
}  # fmt: skip
_FAR_WAYPOINT = 500.0


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


def mission_files(
    path: Path, situation: Situation, *, decimal_degrees: bool = False
) -> tuple[Mission, list[str]]:
    """Read the mission that the glider flies from a file or folder, and say what had to be filled in.

    In a folder with several the one named in the dialog is taken. Where the list of waypoints is missing, the
    waypoint that the glider names is flown to.
    """
    from glider_jax.readers.missions import read_mission

    path = _named_mission(path, situation)
    try:
        return read_mission(path, decimal_degrees=decimal_degrees), []
    except DataError:
        number = _list_number(path) if situation.waypoint is not None else None
        if number is None:
            raise
    # The list that is missing is written into a copy, so that everything else is read as it stands.
    with tempfile.TemporaryDirectory() as folder:
        places = (path.parent.parent / "mafiles", path.parent / "mafiles", path.parent)
        for one in (file for place in places for file in _inside(place)):
            if one.is_file() and one.suffix.lower() in (".mi", ".ma"):
                (Path(folder) / one.name.lower()).write_bytes(one.read_bytes())
        latitude, longitude = situation.waypoint
        lines = ["behavior_name=goto_list", "<start:b_arg>", "b_arg: num_waypoints(nodim) 1", "<end:b_arg>"]
        lines += ["<start:waypoints>", f"{_nmea(longitude)} {_nmea(latitude)}", "<end:waypoints>"]
        (Path(folder) / f"goto_l{number:02d}.ma").write_text("\n".join(lines) + "\n")
        mission = read_mission(Path(folder) / path.name.lower(), decimal_degrees=False)
    files = {Path(name).name: digest for name, digest in mission.source.files.items()}
    files.pop(f"goto_l{number:02d}.ma", None)
    text = f"{path.name}: goto_l{number:02d}.ma is not there: the waypoint that the glider names is flown to"
    return replace(mission, name=path.stem, source=replace(mission.source, files=files)), [text]


def _inside(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _named_mission(path: Path, situation: Situation) -> Path:
    """The file of a folder that bears the mission's name; the folder itself where none does."""
    wanted = {s.mission.lower() for s in situation.surfacings[-1:] if s.mission}
    for folder in (path, path / "missions"):
        for one in _inside(folder) if path.is_dir() else []:
            if one.suffix.lower() == ".mi" and one.name.lower() in wanted:
                return one
    return path


def _list_number(path: Path) -> int | None:
    """Number of the file that a mission's list of waypoints is taken from, None where it names none."""
    if path.suffix.lower() != ".mi" or not path.is_file():
        return None
    text = re.sub(r"#[^\n]*", "", path.read_text("latin-1"))
    block = re.search(r"behavior:\s*goto_list\b(.*?)(?=behavior:|\Z)", text, re.S | re.I)
    number = re.search(r"args_from_file\([^)]*\)\s+\+?(\d{1,2})\b", block.group(1)) if block else None
    return int(number.group(1)) if number else None


def _nmea(degrees: float) -> str:
    """Degrees and minutes as mission files hold them: DDDMM.mmmmm, signed."""
    tenths = round(abs(degrees) * 60.0 * 1e5)
    whole, minutes = divmod(tenths, 60 * 100_000)
    return f"{'-' if degrees < 0 else ''}{whole:d}{minutes / 1e5:08.5f}"


def reconcile(mission: Mission, situation: Situation) -> tuple[Mission, list[str]]:
    """The mission as far as the glider itself does not contradict it, and a warning for each contradiction.

    The glider is believed: its waypoint is flown first, and where its dives last otherwise than the mission's clock
    says, they go on as they were.
    """
    told: list[str] = []
    if situation.waypoint is not None:
        far = [math.hypot(*(float(v) for v in metres(*p, situation.waypoint))) for p in mission.waypoints]
        if min(far) > _FAR_WAYPOINT:
            told.append(
                f"{mission.name}: the glider flies to {place_text(*situation.waypoint)}, the nearest waypoint of the "
                f"mission files lies {min(far) / 1e3:.1f} km from it: the glider is believed; check the files"
            )
            mission = replace(mission, waypoints=(situation.waypoint, *mission.waypoints), first_waypoint=0)
    kinds = {rule.kind for rule in mission.surface} | {"mission_done"}
    for one in situation.surfacings[-3:]:
        kind = _CODES.get(int(one.start_when)) if math.isfinite(one.start_when) else None
        if kind is not None and kind not in kinds:
            told.append(
                f"{mission.name}: the glider came up for '{one.reason.strip()}' (start_when {one.start_when:g}), the "
                f"mission files have no such rule, only {', '.join(sorted(kinds))}: check the files"
            )
            break
    named = [s.mission for s in situation.surfacings if s.mission]
    if named and Path(named[-1]).stem.lower() != mission.name.lower():
        told.append(f"{mission.name}: the glider says it flies '{named[-1]}': check the files")
    period = [rule.seconds for rule in mission.surface if rule.kind in ("every", "after", "no_comms")]
    known = situation.behaviour
    usual = math.exp(known.duration.centre)
    if period and known.segments >= 3 and not 0.6 < usual / min(period) < 1.6:
        told.append(
            f"{mission.name}: the mission files bring the glider up after {min(period) / HOUR:.2f} h, its last dives "
            f"took {usual / HOUR:.2f} h: the dives are believed"
        )
    if known.segments and known.dive_to < 0.8 * mission.yo.dive_to:
        told.append(
            f"{mission.name}: dives go to {mission.yo.dive_to:g} m, the glider turned at {known.dive_to:.0f} m"
        )
        mission = replace(
            mission, yo=replace(mission.yo, dive_to=max(known.dive_to, mission.yo.climb_to + 3.0))
        )
    return mission, told


def believes_dives(told: Iterable[str]) -> bool:
    """Whether the mission's clock was found to be contradicted by the dives."""
    return any(text.endswith("the dives are believed") for text in told)


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


def run_next(options: Options, out: Path | None) -> dict[str, Any]:
    """Forecast the next surfacing and what follows; write and freeze it under ``out`` unless that is None.

    Returns
    -------
    The summary of every forecast (``products.summary``) with ``next``, ``inputs``, ``outlook``, ``warnings``,
    ``scored`` and ``files`` besides.
    """
    if options.members < 50:
        raise ConfigError(
            f"--members: expected at least 50, found {options.members}. A region needs members."
        )
    if not 1.0 <= options.hours <= 24.0 * 60:
        raise ConfigError(f"--hours: expected 1 to 1440, found {options.hours:g}.")
    evidence = gather(options)
    from glider_jax.inference.live import assemble, fly
    from glider_jax.products import frozen
    from glider_jax.products.summary import summarise
    from glider_jax.readers.vehicles import read_vehicle

    vehicle = read_vehicle(options.vehicle)
    situation = _with_charge(evidence.situation, options)
    grid = _currents(options, situation)
    floor = _bathymetry(options, situation)
    ruled = evidence.mission is not None and not believes_dives(evidence.warnings)
    horizon = options.hours * HOUR
    flown = fly(
        assemble(
            situation, vehicle, n=options.members, seed=options.seed, horizon=horizon,
            interval=min(900.0, horizon / 96.0) if horizon <= 4 * DAY else horizon / 384.0, mission=evidence.mission,
            product=None if grid is None else course(grid, situation, situation.behaviour.dive_to),
            bathymetry=floor, ruled=ruled,
        )
    )  # fmt: skip
    settings = flown.track.settings | {"n": options.members}
    if options.reserve is not None:
        settings["reserve_fraction"] = options.reserve
    flown = replace(flown, track=replace(flown.track, settings=settings))
    battery = _outlook(evidence.recording, flown, vehicle, options)
    flown = replace(flown, track=charged(flown.track, battery))
    result = summarise(flown.track, reserve=options.reserve)
    warnings = list(evidence.warnings)
    if grid is not None:
        warnings += _uncovered(grid, situation, horizon)
    result["next"] = next_entry(flown, evidence.now, warnings)
    result["outlook"] = battery
    result["inputs"] = _inputs(situation, vehicle, evidence, options)
    result["warnings"] = warnings
    result["scored"] = None
    result["files"] = {}
    if out is not None:
        past, _ = frozen.load(out) if out.is_dir() else ([], [])
        done = [row for row in frozen.score_all(past, situation.segments) if not row["waiting"]]
        result["scored"] = done[-1] if done else None
        path = frozen.freeze(flown, out, seed=options.seed, settings={"hours": options.hours, "ruled": ruled})
        result["files"]["frozen"] = str(path)
        result["files"] |= {
            kind: str(p) for kind, p in _write(flown.track, result, out, options.outputs).items()
        }
    return result


def _with_charge(situation: Situation, options: Options) -> Situation:
    changes: dict[str, Any] = {}
    if options.charge_used is not None:
        changes |= {"charge_used": options.charge_used, "relative_charge": math.nan}
    if options.capacity is not None:
        changes |= {"capacity": options.capacity, "relative_charge": math.nan}
    return replace(situation, **changes)


def _box(situation: Situation, hours: float) -> tuple[float, float, float, float]:
    margin = 0.3 + 0.6 * hours * HOUR / 111e3
    wide = margin / max(math.cos(math.radians(situation.latitude)), 0.1)
    latitude, longitude = situation.latitude, situation.longitude
    return latitude - margin, latitude + margin, longitude - wide, longitude + wide


def _currents(options: Options, situation: Situation) -> CurrentGrid | None:
    if not options.currents:
        return None
    from glider_jax.readers.currents import read_currents

    begin = min([situation.time - DAY, *(s.dive_time for s in situation.segments[-20:])])
    period = (begin, situation.time + options.hours * HOUR)
    return read_currents(list(options.currents), box=_box(situation, options.hours), period=period)


def _bathymetry(options: Options, situation: Situation):
    if options.bathymetry is None:
        return None
    from glider_jax.readers.bathymetry import read_bathymetry

    return read_bathymetry(options.bathymetry, box=_box(situation, options.hours))


def next_entry(flown, now: float, warnings: list[str]) -> dict[str, Any]:
    """Time, place, regions and reasons of the next first fix, given that it has not come by ``now``."""
    from glider_jax.products.regions import regions_of_metres
    from glider_jax.products.shapes import region_entry

    known, track = flown.scenario.situation, flown.track
    up = np.isfinite(flown.fix_time) & np.isfinite(flown.fix_latitude)
    share = float(up.mean())
    if up.sum() < 10:
        raise DataError(
            f"{known.name}: expected members that surface within the forecast, found {int(up.sum())} of {up.size}. "
            "Ask for more --hours."
        )
    later = up & (flown.fix_time > now)
    overdue = 1.0 - later.sum() / up.sum()
    if later.sum() >= max(30, 0.03 * up.sum()):
        up = later
    else:
        warnings.append(f"overdue: {100 * overdue:.0f} % of the members are up by {iso_time(now)}")
    times = np.quantile(flown.fix_time[up], list(SPREAD.values()))
    frame = LocalFrame(known.latitude, known.longitude)
    cloud = np.stack(frame.to_metres(flown.fix_latitude[up], flown.fix_longitude[up]), axis=1)
    middle = np.median(cloud, axis=0)
    place = tuple(float(v) for v in frame.to_degrees(*middle))
    codes = track.surfacing_reason[up, 0].astype(int)
    estimate = flown.scenario.estimate
    first = min(int(np.searchsorted(estimate.time, times[2])) + 1, estimate.time.size)
    current = estimate.mean[:, :first].mean(axis=1)
    return {
        "fix": {"time": iso_time(known.time), **_place(known.latitude, known.longitude)},
        "dives": iso_time(known.time + known.departure),
        "time": {k: iso_time(float(t)) for k, t in zip(SPREAD, times, strict=True)},
        "hours_from_now": {k: round((float(t) - now) / HOUR, 3) for k, t in zip(SPREAD, times, strict=True)},
        "place": _place(*place),
        "distance_km": round(float(np.hypot(*middle)) / 1e3, 3),
        "distance_nm": round(float(np.hypot(*middle)) / MILE, 3),
        "bearing_true_deg": round(math.degrees(math.atan2(middle[0], middle[1])) % 360.0, 1),
        "regions": [region_entry(r) for r in regions_of_metres(cloud, frame, (0.5, 0.9))],
        "probability_within_forecast": round(share, 4),
        "probability_up_by_now": round(float(overdue), 4),
        "reasons": [
            {"reason": _reason(flown, k), "probability": round(float((codes == k).mean()), 4)}
            for k in sorted(set(codes[codes >= 0].tolist()), key=lambda k: -(codes == k).sum())
        ],
        "current": {
            "east": round(float(current[0]), 4),
            "north": round(float(current[1]), 4),
            "sd": round(float(estimate.sd[:first].mean()), 4),
            "observations": estimate.observations,
            "product_weight": round(estimate.product_weight, 3),
            "parts_sd": {k: round(v, 4) for k, v in estimate.strengths.items()},
        },
        "speed_through_water": round(math.exp(known.behaviour.speed.centre), 4),
    }


def _reason(flown, code: int) -> str:
    """A reason as the mission names it; without a mission, that it comes up as it did before."""
    name = flown.track.reasons[code]
    if flown.scenario.ruled or name == "waypoint":
        return name
    heard = [s.reason.strip() for s in flown.scenario.situation.surfacings if s.reason.strip()]
    return f"as before ({heard[-1]})" if heard else "as before"


def _place(latitude: float, longitude: float) -> dict[str, Any]:
    return {
        "latitude": round(latitude, 6), "longitude": round(longitude, 6), "text": place_text(latitude, longitude)
    }  # fmt: skip


def _outlook(recording: Recording | None, flown, vehicle: Vehicle, options: Options) -> dict[str, Any]:
    from glider_jax.products.outlook import outlook

    track, known = flown.track, flown.scenario.situation
    span = max(float(track.time[-1] - track.time[0]), 1.0)
    drawn = np.asarray(track.charge_used[:, -1], float)
    energy = np.asarray(track.energy[:, -1], float)
    share = energy / np.maximum(energy.sum(axis=1), 1e-9)[:, None]
    mean = (share * drawn[:, None]).mean(axis=0) / span
    counter = finite(recording, "charge_used") if recording is not None else (np.empty(0), np.empty(0))
    heard = [s for s in known.surfacings if s.charge_used is not None]
    time = np.concatenate([counter[0], [s.charge_used.time for s in heard]])
    charge = np.concatenate([counter[1], [s.charge_used.value for s in heard]])
    order = np.argsort(time, kind="stable")
    mine = time[order] <= known.time + HOUR
    return outlook(
        now=known.time, battery=vehicle.battery, simulated=drawn / span,
        components=dict(zip(track.components, mean.tolist(), strict=True)),
        counter=(time[order][mine], charge[order][mine]), charge_used=known.charge_used, capacity=known.capacity,
        relative_charge=known.relative_charge, reserve=options.reserve, way_home=options.way_home, seed=options.seed,
    )  # fmt: skip


def charged(track: Track, battery: dict[str, Any]) -> Track:
    """The track with the pack as it is: draws scaled to the counter, the share left as the glider has it.

    Where the share left is not known the pack counts as full, and the track's notes say so.
    """
    factor = battery["ah_per_day"]["scaled_by"] or 1.0
    used = np.asarray(track.charge_used) * factor
    track = replace(track, charge_used=used, energy=np.asarray(track.energy) * factor)
    left = battery["charge_left_percent"]
    if left is None or not battery["capacity_ah"]:
        return replace(
            track, notes=(*track.notes, "charge left not known: the forecast begins with a full pack")
        )
    share = left / 100.0 - used / (3600.0 * battery["capacity_ah"])
    return replace(track, state_of_charge=np.clip(share, 0.0, 1.0))


def _uncovered(grid: CurrentGrid, situation: Situation, horizon: float) -> list[str]:
    """A warning where the product does not reach along the forecast's way."""
    times = situation.time + np.linspace(0.0, horizon, 49)
    missing = ~np.isfinite(course(grid, situation, situation.behaviour.dive_to)(times)).all(axis=0)
    if not missing.any():
        return []
    share = 100.0 * missing.mean()
    return [
        f"the current product does not cover {share:.0f} % of the forecast's way: still water is taken there"
    ]


def _inputs(situation: Situation, vehicle: Vehicle, evidence: Evidence, options: Options) -> dict[str, Any]:
    recording = evidence.recording
    assumed = list(situation.assumed)
    if options.vehicle is None:
        assumed.append(f"vehicle not given: energies of '{vehicle.name}' assumed")
    assumed += [f"vehicle: {text}" for text in vehicle.assumed]
    return {
        "glider": situation.name,
        "now": iso_time(evidence.now),
        "ages_h": {k: None if math.isnan(v) else round(v / HOUR, 3) for k, v in situation.ages.items()}
        | {"fix_to_now": round((evidence.now - situation.time) / HOUR, 3)},
        "segments": len(situation.segments),
        "surfacings_heard": len(situation.surfacings),
        "files": {str(name).replace("\\", "/").rsplit("/", 1)[-1]: v for name, v in situation.files.items()},
        "mission": None if evidence.mission is None else evidence.mission.name,
        "missing": [] if recording is None else list(recording.missing),
        "repairs": []
        if recording is None
        else [f"{r.count} x {r.kind}: {r.detail}" for r in recording.repairs],
        "assumed": assumed,
    }


def _write(track, result: dict[str, Any], out: Path, outputs: frozenset[str]) -> dict[str, Path]:
    """Products of the forecast beside the summary; the summary is always written."""
    from glider_jax.products.atomic import write_text

    files = {"json": write_text(out / "next.json", json.dumps(result, allow_nan=False, indent=1) + "\n")}
    if "nc" in outputs:
        from glider_jax.products.netcdf import NetcdfWriter

        writer = NetcdfWriter(out / "next.nc", members=track.n)
        writer.append(track)
        files["nc"] = writer.close(complete=True)
    if "geojson" in outputs:
        from glider_jax.products.geojson import write_geojson

        files["geojson"] = write_geojson(track, result, out / "next.geojson")
    if "kmz" in outputs:
        from glider_jax.products.kml import write_kml

        files["kmz"] = write_kml(track, result, out / "next.kmz")
    return files


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
