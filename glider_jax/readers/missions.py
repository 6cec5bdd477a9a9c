"""Mission files -> :class:`glider_jax.config.Mission`: dispatch, and the TOML form with its writer.

TOML missions give positions as [latitude, longitude] in decimal degrees, pitches in degrees, all else in SI. Traps:
without ``start_position`` the first waypoint is where the glider lies and the rest are flown; ``surface_every``
counts from each dive, as ``[[surface]] kind = "after"`` does, and the climb that is due then goes to the surface.
``[[program]]`` rules are read by ``readers.mission_programs``.
Slocum missions go to ``readers.slocum_missions``.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

from glider_jax.config import Aborts, Mission, SampleRule, SurfaceRule, Yo, check_mission
from glider_jax.errors import ConfigError, DataError
from glider_jax.readers.mission_programs import program_lines, read_program
from glider_jax.readers.mission_values import bool_text, pair_text, parse_time, position_of, quote
from glider_jax.readers.slocum_missions import read_slocum_mission
from glider_jax.readers.toml_checks import Table, load_toml
from glider_jax.records import Source
from glider_jax_data import path as bundled_path

DEFAULT_MISSION = "missions/new_jersey.toml"
DEFAULT_PITCH = 26.0
DEFAULT_SURFACE_EVERY = 10800.0
_STATE_BITS = {"dive": 1, "hover": 2, "climb": 4, "surface": 8}
_YO_KEYS = (
    "dive_to", "climb_to", "altitude", "climb_altitude", "pitch", "dive_pitch", "climb_pitch", "dive_volume",
    "climb_volume", "half_cycles", "overshoot",
)  # fmt: skip


def read_mission(
    path: str | Path | None = None, *, start: float | None = None, decimal_degrees: bool = False
) -> Mission:
    """Read a mission: a TOML file, a Slocum ``.mi`` file, or a folder that holds one; the bundled one for None.

    Parameters
    ----------
    path : file or folder. A folder may keep its ``.ma`` files beside the ``.mi`` or in ``mafiles``.
    start : UTC seconds since 1970; replaces what the file says.
    decimal_degrees : waypoints of ``.ma`` files are decimal degrees instead of degrees and minutes.

    Returns
    -------
    Mission, SI units and radians; what it names and the simulator leaves out is in ``unsupported``.

    Raises
    ------
    DataError : a file cannot be read.
    ConfigError : it is unknown, contradictory or out of range.
    """
    found = Path(bundled_path(DEFAULT_MISSION) if path is None else path)
    if found.is_dir():
        tomls = sorted(found.glob("*.toml"))
        if not list(found.glob("*.mi")) and [t.name for t in tomls] == ["mission.toml"]:
            found = tomls[0]
    suffix = found.suffix.lower()
    if suffix == ".toml":
        mission = read_toml_mission(found)
    elif found.is_dir() or suffix == ".mi":
        mission = read_slocum_mission(found, decimal_degrees=decimal_degrees)
    elif not found.exists():
        raise DataError(f"{found}: expected a mission file or folder, found nothing there. Check the path.")
    else:
        raise DataError(
            f"{found}: expected a mission as .toml, .mi or a folder with a .mi file, found '{found.suffix}'. "
            "For .ma files give the .mi that names them."
        )
    if start is not None:
        if not math.isfinite(start):
            raise ConfigError(f"start: expected seconds since 1970, found {start}. Correct it.")
        mission = replace(mission, start=float(start))
    return mission


def read_toml_mission(path: str | Path) -> Mission:
    """Read a mission in our TOML form; see the module's text for its traps."""
    path = Path(path)
    top = load_toml(path)
    main = top.table("mission")
    if main is None:
        raise ConfigError(f"{path.name}: expected a table [mission], found none. Add it.")
    yo_table, aborts_table = top.table("yo"), top.table("aborts")
    notes: list[str] = []
    start = parse_time(main, "start")
    start_position, waypoints = _route(main)
    yo = _yo(main, yo_table)
    rules = listed = tuple(_rule(table) for table in top.tables("surface"))
    every = main.quantity("surface_every", "s")
    if every is not None:
        if not every.value > 0.0:
            raise main.wrong("surface_every", "more than 0 s")
        rules = (SurfaceRule("after", seconds=every.value, when_yo_ends=True, name="surface_every"), *rules)
    if not rules:
        rules = (SurfaceRule("after", seconds=DEFAULT_SURFACE_EVERY, when_yo_ends=True, name="surface_every"),)
        notes.append(f"surface_every: {DEFAULT_SURFACE_EVERY:g} s assumed, the file names no rule to surface")
    if every is not None or not listed:
        rules = (*rules, SurfaceRule("mission_done", ends_mission=True, name="mission_done"))
    radius, stay = main.quantity("waypoint_radius", "m"), main.quantity("surface_stay", "s")
    if radius is None:
        notes.append(f"waypoint_radius: {Mission.waypoint_radius:g} m assumed")
    if stay is None:
        notes.append(f"surface_stay: {Mission.surface_stay:g} s assumed")
    first = main.integer("first_waypoint", 0, -1)
    mission = Mission(
        name=main.text("name", path.stem) or path.stem,
        waypoints=waypoints,
        yo=yo,
        surface=rules,
        start=start,
        start_position=start_position,
        waypoint_radius=Mission.waypoint_radius if radius is None else radius.value,
        legs=_whole(main.integer("legs", -2)),
        first_waypoint=None if first == -1 else first,
        surface_stay=Mission.surface_stay if stay is None else stay.value,
        samples=tuple(_sample(table) for table in top.tables("sample")),
        aborts=Aborts() if aborts_table is None else _aborts(aborts_table),
        current_correction=main.boolean("current_correction", True),
        unsupported=main.texts("unsupported") or (),
        notes=(*(main.texts("notes") or ()), *notes),
        source=Source("mission TOML", {str(path): Source.digest(path)}),
        program=read_program(top),
    )
    for table in (main, yo_table, aborts_table, top):
        if table is not None:
            table.close()
    check_mission(mission, path.name)
    return mission


def _whole(value: int | None) -> int:
    return 0 if value is None else value


def _route(main: Table) -> tuple[tuple[float, float] | None, tuple[tuple[float, float], ...]]:
    raw = main.raw("waypoints")
    if not isinstance(raw, list):
        raise main.wrong("waypoints", "a list of [latitude, longitude]", "Add waypoints = [[39.3, -73.6], ...].")
    points = tuple(position_of(item, main, "waypoints", f"waypoint {i}") for i, item in enumerate(raw, 1))
    first_is_start = main.boolean("first_waypoint_is_start", "start_position" not in main)
    given = main.raw("start_position")
    if given is not None:
        if first_is_start:
            raise ConfigError(
                f"{main.where()}: start_position and first_waypoint_is_start contradict each other. Keep one of them."
            )
        return position_of(given, main, "start_position", "start"), points
    if not first_is_start:
        return None, points
    if len(points) < 2:
        raise ConfigError(
            f"{main.where('waypoints')}: expected the start and at least one waypoint to fly to, found "
            f"{len(points)}. Add a waypoint, or give start_position."
        )
    return points[0], points[1:]


def _yo(main: Table, section: Table | None) -> Yo:
    """The yo from [yo], or from the same keys in [mission] where there is no [yo]."""
    table = main if section is None else section
    for key in main.data if section is not None else ():
        if any(key == name or key.startswith(f"{name}_") for name in _YO_KEYS):
            raise ConfigError(f"{main.where(key)}: stands in [mission] although there is a [yo]. Move it to [yo].")

    def number(key: str, unit: str, bare: str | None = None) -> float | None:
        given = table.quantity(key, unit, bare)
        return None if given is None else given.value

    dive_to, climb_to = number("dive_to", "m"), number("climb_to", "m")
    if dive_to is None:
        raise ConfigError(f"{table.where('dive_to')}: expected the depth of a dive in m, found none. Add dive_to.")
    pitch = number("pitch", "rad", "deg")
    dive_pitch, climb_pitch = number("dive_pitch", "rad", "deg"), number("climb_pitch", "rad", "deg")
    if pitch is not None and dive_pitch is not None and climb_pitch is not None:
        raise ConfigError(f"{table.where('pitch')}: dive_pitch and climb_pitch say the same. Keep 'pitch' or both.")
    both = math.radians(DEFAULT_PITCH) if pitch is None else pitch
    altitude, climb_altitude = number("altitude", "m"), number("climb_altitude", "m")
    return Yo(
        dive_to=dive_to,
        climb_to=3.0 if climb_to is None else climb_to,
        dive_pitch=abs(both if dive_pitch is None else dive_pitch),
        climb_pitch=abs(both if climb_pitch is None else climb_pitch),
        dive_altitude=5.0 if altitude is None else (None if altitude < 0.0 else altitude),
        climb_altitude=None if climb_altitude is None or climb_altitude < 0.0 else climb_altitude,
        dive_volume=number("dive_volume", "m3", "cc"),
        climb_volume=number("climb_volume", "m3", "cc"),
        half_cycles=table.integer("half_cycles", None, 1),
        overshoot=number("overshoot", "m"),
    )


def _rule(table: Table) -> SurfaceRule:
    seconds, distance = table.quantity("seconds", "s"), table.quantity("distance", "m")
    pitch = table.quantity("climb_pitch", "rad", "deg")
    rule = SurfaceRule(
        kind=table.text("kind") or "",
        seconds=0.0 if seconds is None else seconds.value,
        time=parse_time(table, "time"),
        count=_whole(table.integer("count", 0)),
        distance=0.0 if distance is None else distance.value,
        when_yo_ends=table.boolean("when_yo_ends", False),
        ends_mission=table.boolean("ends_mission", False),
        climb_pitch=None if pitch is None else abs(pitch.value),
        name=table.text("name", "") or "",
    )
    table.close()
    return rule


def _sample(table: Table) -> SampleRule:
    states = table.texts("states")
    if states is None:
        bits = _whole(table.integer("state_to_sample", 7, 0, 15))
        states = tuple(name for name, bit in _STATE_BITS.items() if bits & bit)
    if not set(states) <= set(_STATE_BITS):
        raise table.wrong("states", f"a list out of {', '.join(_STATE_BITS)}")
    interval = table.quantity("interval", "s")
    low, high = table.number("minimum_depth", -5.0), table.number("maximum_depth", 2000.0)
    rule = SampleRule(
        sensor_type=_whole(table.integer("sensor_type", 0, 0)),
        states=frozenset(states),
        interval=0.0 if interval is None else interval.value,
        minimum_depth=-5.0 if low is None else low,
        maximum_depth=2000.0 if high is None else high,
        every_nth_yo=_whole(table.integer("every_nth_yo", 1)),
    )
    table.close()
    return rule


def _aborts(table: Table) -> Aborts:
    units = {"overdepth": "m", "maximum_waypoint_distance": "m", "undervolts": "V", "remaining_charge": "1"}
    values = {}
    for item in fields(Aborts):
        given = table.quantity(item.name, units.get(item.name, "s"))
        if given is not None and given.value < 0.0:
            raise table.wrong(item.name, "at least 0", "Leave it out to disable it.")
        values[item.name] = None if given is None else given.value
    return Aborts(**values)


def mission_toml(mission: Mission) -> str:
    """A mission in our TOML form, which :func:`read_mission` reads back to the same numbers.

    Angles are written in radians with their unit, so that no digit is lost.
    """
    yo = mission.yo
    lines = ["[mission]", f"name = {quote(mission.name)}"]
    if mission.start is not None:
        lines.append(f"start = {float(mission.start)!r}")
    if mission.start_position is not None:
        lines.append(f"start_position = {pair_text(mission.start_position)}")
    else:
        lines.append("first_waypoint_is_start = false")
    lines.append(f"waypoints = [{', '.join(pair_text(p) for p in mission.waypoints)}]")
    lines.append(f"waypoint_radius = {float(mission.waypoint_radius)!r}")
    lines.append(f"legs = {mission.legs}")
    lines.append(f"first_waypoint = {-1 if mission.first_waypoint is None else mission.first_waypoint}")
    lines.append(f"surface_stay = {float(mission.surface_stay)!r}")
    lines.append(f"current_correction = {bool_text(mission.current_correction)}")
    for key in ("unsupported", "notes"):
        texts = getattr(mission, key)
        if texts:
            lines.append(f"{key} = [{', '.join(quote(t) for t in texts)}]")
    lines += ["", "[yo]", f"dive_to = {float(yo.dive_to)!r}", f"climb_to = {float(yo.climb_to)!r}"]
    lines += [f"dive_pitch_rad = {float(yo.dive_pitch)!r}", f"climb_pitch_rad = {float(yo.climb_pitch)!r}"]
    lines.append(f"altitude = {-1.0 if yo.dive_altitude is None else float(yo.dive_altitude)!r}")
    optional = {
        "climb_altitude": yo.climb_altitude, "dive_volume_m3": yo.dive_volume, "climb_volume_m3": yo.climb_volume,
        "overshoot": yo.overshoot,
    }  # fmt: skip
    lines += [f"{key} = {float(value)!r}" for key, value in optional.items() if value is not None]
    if yo.half_cycles is not None:
        lines.append(f"half_cycles = {yo.half_cycles}")
    for rule in mission.surface:
        lines += ["", "[[surface]]", f"kind = {quote(rule.kind)}"]
        lines += [f"{k} = {float(getattr(rule, k))!r}" for k in ("seconds", "distance") if getattr(rule, k)]
        lines += [f"time = {float(rule.time)!r}"] if rule.time is not None else []
        lines += [f"count = {rule.count}"] if rule.count else []
        lines += [f"{k} = true" for k in ("when_yo_ends", "ends_mission") if getattr(rule, k)]
        lines += [f"climb_pitch_rad = {float(rule.climb_pitch)!r}"] if rule.climb_pitch is not None else []
        lines += [f"name = {quote(rule.name)}"] if rule.name else []
    for sample in mission.samples:
        states = ", ".join(quote(s) for s in sorted(sample.states))
        lines += ["", "[[sample]]", f"sensor_type = {sample.sensor_type}", f"states = [{states}]"]
        lines += [
            f"interval = {float(sample.interval)!r}",
            f"minimum_depth = {float(sample.minimum_depth)!r}",
        ]
        lines += [f"maximum_depth = {float(sample.maximum_depth)!r}", f"every_nth_yo = {sample.every_nth_yo}"]
    said = {f.name: getattr(mission.aborts, f.name) for f in fields(Aborts)}
    if any(value is not None for value in said.values()):
        lines += ["", "[aborts]"]
        lines += [f"{key} = {float(value)!r}" for key, value in said.items() if value is not None]
    lines += program_lines(mission.program)
    return "\n".join(lines) + "\n"


def write_mission_toml(mission: Mission, path: str | Path) -> Path:
    """Write a mission as TOML and return its path; the file appears under its name only when complete."""
    path = Path(path)
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(mission_toml(mission), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be written: {error.strerror or error}. Check the folder.") from error
    return path
