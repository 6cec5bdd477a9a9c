"""Slocum mission files as flown (``.mi`` and their ``.ma``) -> :class:`glider_jax.config.Mission`.

Values of a ``.ma`` file replace those of the ``.mi``, which replace ``autoexec.mi``, which replaces the defaults.
Everything the files name and the simulator leaves out is in ``Mission.unsupported``; what has no effect on path or
energy, and what was assumed, is in ``Mission.notes``. Mission files say neither when nor where a mission starts.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from glider_jax.config import Aborts, Mission, SampleRule, Yo, check_mission
from glider_jax.errors import ConfigError, DataError
from glider_jax.readers.slocum_files import Behavior, Script, parse_script, parse_waypoint, read_text
from glider_jax.readers.slocum_surface import surface_rules
from glider_jax.records import Source

ASSUMED_PITCH = math.radians(26.0)
#: volumes at or beyond this many cc mean all that the pump has
FULL_PUMP_CC = 1000.0
_STATE_BITS = {1: "dive", 2: "hover", 4: "climb", 8: "surface"}
_YO_USED = {
    "start_when", "num_half_cycles_to_do", "end_action", "d_target_depth", "d_target_altitude", "d_use_bpump",
    "d_bpump_value", "d_use_pitch", "d_pitch_value", "c_target_depth", "c_target_altitude", "c_use_bpump",
    "c_bpump_value", "c_use_pitch", "c_pitch_value", "args_from_file",
}  # fmt: skip
_GOTO_USED = {
    "start_when", "num_waypoints", "num_legs_to_run", "initial_wpt", "list_stop_when", "list_when_wpt_dist",
    "args_from_file", "end_action",
}  # fmt: skip
_SAMPLE_USED = {
    "args_from_file", "sensor_type", "state_to_sample", "intersample_time", "intersample_depth", "min_depth",
    "max_depth", "nth_yo_to_sample", "sample_time_after_state_change", "start_when",
}  # fmt: skip
_ABEND = {
    # record field: (argument, firmware's default, factor, value from which it means never)
    "overdepth": ("overdepth", 10000.0, 1.0, 10000.0),
    "overtime": ("overtime", -1.0, 1.0, math.inf),
    "undervolts": ("undervolts", 10.0, 1.0, math.inf),
    "same_depth_for": ("samedepth_for", 1800.0, 1.0, math.inf),
    "stalled_for": ("stalled_for", 1800.0, 1.0, math.inf),
    "no_comms_for": ("no_comms_tickle_for", 259200.0, 1.0, math.inf),
    "maximum_waypoint_distance": ("max_wpt_distance", -1.0, 1.0, math.inf),
    "remaining_charge": ("remaining_charge_min", 10.0, 0.01, math.inf),
}
#: behaviours that cannot be flown without their argument file
_NEEDED = {"yo", "goto_list", "surface", "abend"}
#: behaviours that change neither path nor energy as simulated
_SKIPPED = {"prepare_to_dive", "nop_cmds", "send_file", "sensors_in"}
#: sensor settings about telemetry, logging and warnings
_TELEMETRY = ("xmit_control", "num_fields", "file_compression", "oddities", "_warning_", "send_all", "iridium_phone")


class _Reading:
    """Where the files of one mission lie, and what reading them brought to light."""

    def __init__(self, mi: Path):
        self.mi = mi
        self.files: dict[str, str] = {}
        self.unsupported: list[str] = []
        self.notes: list[str] = []

    def script(self, path: Path) -> Script:
        """Parse a file, noting its digest and every line that is not understood."""
        script = parse_script(read_text(path), path.name)
        self.files[str(path)] = Source.digest(path)
        self.unsupported += script.strange
        return script

    def find(self, names: tuple[str, ...]) -> Path | None:
        """A file by any of these names, in any case, beside the .mi file or in a folder mafiles."""
        here = self.mi.parent
        wanted = {name.lower() for name in names}
        for folder in (here, here / "mafiles", here.parent / "mafiles", here.parent):
            if folder.is_dir():
                for path in sorted(folder.iterdir()):
                    if path.name.lower() in wanted and path.is_file():
                        return path
        return None

    def leftovers(self, behavior: Behavior, used: set[str]) -> None:
        """List the arguments of a behaviour that the simulator does not use."""
        rest = sorted(name for name in behavior.arguments if name not in used)
        if rest:
            self.unsupported.append(f"{behavior.name} ({behavior.where}): {', '.join(rest)}")


def read_slocum_mission(path: str | Path, *, decimal_degrees: bool = False) -> Mission:
    """Read the mission of a ``.mi`` file, or of a folder that holds one, with its ``.ma`` files.

    Parameters
    ----------
    path : ``.mi`` file or folder; a folder may keep it in ``missions`` and the ``.ma`` files in ``mafiles``.
    decimal_degrees : waypoints are decimal degrees instead of degrees and minutes.

    Raises
    ------
    DataError : a file is absent or cannot be read.
    ConfigError : no yo, no waypoint, or values that are out of range, ambiguous or contradictory.
    """
    mi = _mission_file(Path(path))
    reading = _Reading(mi)
    sensors = {}
    autoexec = reading.find(("autoexec.mi",))
    if autoexec is not None and autoexec != mi and autoexec.parent == mi.parent:
        sensors |= reading.script(autoexec).sensors
    script = reading.script(mi)
    sensors |= script.sensors
    groups: dict[str, list[Behavior]] = {}
    for behavior in script.behaviors:
        behavior = _with_file(behavior, reading)
        groups.setdefault(behavior.name, []).append(behavior)
    yo = _yo(_single("yo", groups, reading, _instead(groups)), reading)
    yo = _working_depth(yo, sensors, reading)
    route = _route(_single("goto_list", groups, reading, _instead(groups)), reading, decimal_degrees)
    surface, stay = surface_rules(groups.pop("surface", []), yo, reading.unsupported, reading.notes)
    samples = tuple(_sample(b, reading) for b in groups.pop("sample", []) if b.arguments)
    aborts = _aborts(groups.pop("abend", []), reading)
    for name, behaviors in groups.items():
        for behavior in behaviors:
            given = f": {', '.join(behavior.arguments)}" if behavior.arguments else ""
            line = f"behavior {name} ({behavior.where}){given}"
            if name in _SKIPPED:
                reading.notes.append(f"left out, without effect on path and energy: {line}")
            else:
                reading.unsupported.append(line)
    correction = sensors.pop("u_use_current_correction", None)
    if correction is None or correction.number is None:
        reading.notes.append("u_use_current_correction: not given, current correction assumed on")
    quiet = sorted(name for name in sensors if any(part in name for part in _TELEMETRY))
    others = sorted(set(sensors) - set(quiet))
    if quiet:
        reading.notes.append(f"left out, without effect on path and energy: sensor settings: {', '.join(quiet)}")
    if others:
        reading.unsupported.append(f"sensor settings: {', '.join(others)}")
    reading.notes.append("start: mission files give neither time nor place; the launch or the first fix must")
    mission = Mission(
        name=mi.stem,
        yo=yo,
        surface=surface,
        surface_stay=stay,
        samples=samples,
        aborts=aborts,
        current_correction=correction is None or correction.number is None or correction.number > 0.0,
        unsupported=tuple(reading.unsupported),
        notes=tuple(reading.notes),
        source=Source("Slocum mission", reading.files),
        **route,
    )
    check_mission(mission, mi.name)
    return mission


def _mission_file(path: Path) -> Path:
    """The one .mi file that is meant, autoexec.mi aside."""
    if not path.is_dir():
        if not path.exists():
            raise DataError(f"{path}: expected a .mi file or a folder, found nothing there. Check the path.")
        return path
    for folder in (path, path / "missions"):
        found = []
        if folder.is_dir():
            found = sorted(p for p in folder.iterdir() if p.suffix.lower() == ".mi" and p.stem.lower() != "autoexec")
        if len(found) == 1:
            return found[0]
        if found:
            raise ConfigError(
                f"{folder}: expected one .mi file, found {', '.join(p.name for p in found)}. Name the one to fly."
            )
    raise DataError(f"{path}: expected a .mi file there or in its folder 'missions', found none. Check the path.")


def _with_file(behavior: Behavior, reading: _Reading) -> Behavior:
    """A behaviour with the arguments of its .ma file, which replace those of the .mi."""
    number = behavior.arguments.get("args_from_file")
    value = None if number is None else number.number
    if value is None or not 0.0 <= value <= 99.0:
        return behavior
    stem = behavior.name[:6]
    names = (f"{stem}{int(value):02d}.ma", f"{stem}{int(value)}.ma")
    path = reading.find(names)
    if path is None:
        if behavior.name not in _NEEDED:
            kept = ", its devices keep their rule" if behavior.name == "sample" else ""
            reading.unsupported.append(f"{behavior.name} ({behavior.where}): {names[0]} is not there{kept}")
            return replace(behavior, arguments={})
        raise DataError(
            f"{behavior.where}: behavior {behavior.name} expects {names[0]}, found none beside {reading.mi.name} nor "
            "in a folder 'mafiles'. Add the file."
        )
    script = reading.script(path)
    inner = [b for b in script.behaviors if b.name == behavior.name]
    if not inner:
        said = ", ".join(b.name for b in script.behaviors) or "none"
        raise ConfigError(
            f"{path.name}: expected behavior_name={behavior.name}, found {said}. Correct the file or its number."
        )
    if script.sensors:
        reading.unsupported.append(f"{path.name}: sensor settings: {', '.join(sorted(script.sensors))}")
    merged = replace(behavior, where=path.name, arguments={**behavior.arguments}, waypoints=[])
    for part in inner:
        merged.arguments |= part.arguments
        merged.waypoints += part.waypoints
    for name, argument in list(merged.arguments.items()):
        if argument.number is None:
            reading.notes.append(f"{argument.where}: {name} is '{argument.text or 'nothing'}', its default is used")
    return merged


def _instead(groups: dict[str, list[Behavior]]) -> str:
    others = [name for name in ("set_heading", "drift_at_depth", "dive_to", "climb_to") if name in groups]
    return f" It has {', '.join(others)} instead, which is not simulated." if others else ""


def _single(name: str, groups: dict[str, list[Behavior]], reading: _Reading, hint: str = "") -> Behavior:
    """The first behaviour of its kind, which has the highest priority; others are listed."""
    behaviors = groups.pop(name, [])
    if not behaviors:
        raise ConfigError(f"{reading.mi.name}: expected a behavior {name}, found none.{hint} Give a mission with one.")
    for other in behaviors[1:]:
        reading.unsupported.append(f"behavior {name} ({other.where}): only the first of several is flown")
    return behaviors[0]


def _yo(behavior: Behavior, reading: _Reading) -> Yo:
    notes, where = reading.notes, behavior.where
    reading.leftovers(behavior, _YO_USED)
    cycles = behavior.code("num_half_cycles_to_do", -1)
    volumes = {side: _volume(behavior, side, reading) for side in "dc"}
    pitches = {side: _pitch(behavior, side, notes) for side in "dc"}
    altitudes = {"d": behavior.number("d_target_altitude", 5.0), "c": behavior.number("c_target_altitude", -1.0)}
    if behavior.code("start_when", 2) not in (0, 2, 4):
        reading.unsupported.append(f"yo ({where}): start_when {behavior.code('start_when', 2)}")
    return Yo(
        dive_to=behavior.number("d_target_depth", 12.0),
        climb_to=behavior.number("c_target_depth", 3.0),
        dive_pitch=pitches["d"],
        climb_pitch=pitches["c"],
        dive_altitude=altitudes["d"] if altitudes["d"] >= 0.0 else None,
        climb_altitude=altitudes["c"] if altitudes["c"] >= 0.0 else None,
        dive_volume=volumes["d"],
        climb_volume=volumes["c"],
        half_cycles=cycles if cycles > 0 else None,
    )


def _pitch(behavior: Behavior, side: str, notes: list[str]) -> float:
    """Magnitude of the pitch of one leg; a battery position says nothing of the angle."""
    use, where = behavior.code(f"{side}_use_pitch", 3), behavior.where
    leg = "dive" if side == "d" else "climb"
    if use not in (2, 3):
        notes.append(f"{where}: {side}_use_pitch {use} commands no angle, 26 degrees assumed for the {leg}")
        return ASSUMED_PITCH
    value = behavior.number(f"{side}_pitch_value", -ASSUMED_PITCH if side == "d" else ASSUMED_PITCH)
    if value != 0.0 and (value > 0.0) == (side == "d"):
        notes.append(f"{where}: {side}_pitch_value {value:g} has the wrong sign, its magnitude is flown on the {leg}")
    return abs(value)


def _volume(behavior: Behavior, side: str, reading: _Reading) -> float | None:
    """Magnitude of the pumped volume of one leg, m3; None for all that the pump has."""
    use, where = behavior.code(f"{side}_use_bpump", 2), behavior.where
    default = -260.0 if side == "d" else 260.0
    if use == 0:
        # Autoballast divides one total between both legs; half each is what it starts from.
        total = abs(behavior.number("d_bpump_value", 1000.0))
        if side == "d":
            reading.unsupported.append(f"yo ({where}): autoballast, flown as plus and minus {total / 2:g} cc")
        return total / 2.0 * 1e-6
    if use != 2:
        reading.unsupported.append(f"yo ({where}): {side}_use_bpump {use}, flown as an absolute volume")
    given = f"{side}_bpump_value" in behavior.arguments
    value = behavior.number(f"{side}_bpump_value", default)
    if given and value != 0.0 and (value > 0.0) == (side == "d"):
        reading.notes.append(f"{where}: {side}_bpump_value {value:g} has the wrong sign, its magnitude is flown")
    if abs(value) >= FULL_PUMP_CC:
        return None
    return abs(value) * 1e-6


def _working_depth(yo: Yo, sensors: dict, reading: _Reading) -> Yo:
    limit = sensors.pop("f_max_working_depth", None)
    depth = None if limit is None else limit.number
    if depth is None or not yo.climb_to < depth < yo.dive_to:
        return yo
    reading.notes.append(f"d_target_depth {yo.dive_to:g} m clipped to f_max_working_depth {depth:g} m")
    return replace(yo, dive_to=depth)


def _route(behavior: Behavior, reading: _Reading, decimal_degrees: bool) -> dict:
    """Waypoints, legs, radius and first waypoint of the goto_list, as fields of a mission."""
    notes, where = reading.notes, behavior.where
    inline = {n for n in behavior.arguments if n.startswith(("wpt_units_", "wpt_x_", "wpt_y_"))}
    reading.leftovers(behavior, _GOTO_USED | inline)
    lines = behavior.waypoints or _inline_waypoints(behavior, inline)
    points = []
    for place, text in lines:
        points.append(parse_waypoint(text, place, decimal_degrees))
    if not points:
        raise ConfigError(f"{where}: expected at least one waypoint 'longitude latitude', found none. Add one.")
    said = behavior.number("num_waypoints", len(points))
    if said != len(points):
        notes.append(f"{where}: num_waypoints says {said:g}, the list holds {len(points)}")
    legs = behavior.code("num_legs_to_run", -1)
    first = behavior.code("initial_wpt", -2)
    if first == -1:
        notes.append(f"{where}: initial_wpt -1, the one after the last achieved, is not known: the first is taken")
    stop = behavior.code("list_stop_when", 7)
    radius = behavior.number("list_when_wpt_dist", 10.0)
    if stop != 7:
        reading.unsupported.append(f"goto_list ({where}): list_stop_when {stop}, waypoints are reached by distance")
    if 0.0 <= radius < 10.0:
        notes.append(f"{where}: list_when_wpt_dist {radius:g} m raised to 10 m, the firmware's least")
        radius = 10.0
    return {
        "waypoints": tuple(points),
        "legs": legs,
        "first_waypoint": None if first == -2 else max(first, 0),
        "waypoint_radius": radius,
    }


def _inline_waypoints(behavior: Behavior, inline: set[str]) -> list[tuple[str, str]]:
    """Waypoints given as wpt_x_0, wpt_y_0 in the .mi; only those in latitude and longitude have a place on the map."""
    lines = []
    for index in range(len(inline)):
        x, y = behavior.arguments.get(f"wpt_x_{index}"), behavior.arguments.get(f"wpt_y_{index}")
        if x is None or y is None:
            break
        units = behavior.code(f"wpt_units_{index}", 0)
        if units != 2:
            raise ConfigError(
                f"{x.where}: expected wpt_units_{index} 2 (latitude and longitude), found {units}. "
                "Local and UTM metres have no known place; give positions."
            )
        lines.append((x.where, f"{x.text} {y.text}"))
    return lines


def _sample(behavior: Behavior, reading: _Reading) -> SampleRule:
    reading.leftovers(behavior, _SAMPLE_USED)
    interval = behavior.number("intersample_time", 2.0)
    if behavior.number("intersample_depth", -1.0) > 0.0:
        reading.unsupported.append(f"sample ({behavior.where}): intersample_depth, sampled by time instead")
    bits = behavior.code("state_to_sample", 1)
    # A negative interval switches the sensor off: a rule without states.
    states = frozenset(name for bit, name in _STATE_BITS.items() if bits & bit and interval >= 0.0)
    return SampleRule(
        sensor_type=behavior.code("sensor_type", 0),
        states=states,
        interval=max(interval, 0.0),
        minimum_depth=behavior.number("min_depth", -5.0),
        maximum_depth=behavior.number("max_depth", 2000.0),
        every_nth_yo=behavior.code("nth_yo_to_sample", 1),
    )


def _aborts(behaviors: list[Behavior], reading: _Reading) -> Aborts:
    if not behaviors:
        reading.notes.append("abend: the mission names no limits, none are applied")
        return Aborts()
    for behavior in behaviors:
        frequencies = {name for name in behavior.arguments if name.endswith("_sample_time")}
        reading.leftovers(behavior, {argument for argument, *_ in _ABEND.values()} | frequencies)
    values: dict[str, float | None] = {}
    for name, (argument, default, factor, never) in _ABEND.items():
        value = default
        for behavior in behaviors:
            value = behavior.number(argument, value)
        off = value < 0.0 or value >= never or (name == "remaining_charge" and value == 0.0)
        values[name] = None if off else value * factor
    return Aborts(**values)
