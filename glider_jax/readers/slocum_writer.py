"""A mission -> Slocum ``.mi`` and ``.ma`` files, to a local folder only; what Slocum cannot say is listed.

Standard library only. The files are a draft for a pilot: nothing here sends them anywhere, and none are overwritten
unless asked. Angles are written in rad, volumes in cc, positions longitude first as DDDMM.mmmm.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from glider_jax.config import Aborts, Mission, SampleRule, SurfaceRule, check_mission
from glider_jax.errors import DataError
from glider_jax.readers.slocum_files import to_degrees_minutes
from glider_jax.readers.slocum_missions import FULL_PUMP_CC
from glider_jax.readers.slocum_programs import Expressed, express
from glider_jax.readers.slocum_surface import TYPICAL_CALL, TYPICAL_FIX

#: first number of the argument files, of which 90 of a kind have room
FIRST_FILE = 10
MOST_WAYPOINTS = 8
_POSTFIX = 60.0
_CODES = {
    "yo_done": 2, "mission_done": 3, "after": 6, "waypoint_distance": 7, "waypoint": 8, "every": 9, "science": 11,
    "no_comms": 12, "utc": 13, "inflections": 16,
}  # fmt: skip
_STATE_BITS = {"dive": 1, "hover": 2, "climb": 4, "surface": 8}


@dataclass(frozen=True)
class SlocumExport:
    """What was written, and one sentence for everything of the mission that the files do not say.

    ``expressed`` has one for every rule of the mission's program that a behaviour stands for.
    """

    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    expressed: tuple[str, ...] = ()


def write_slocum_mission(mission: Mission, directory: str | Path, *, overwrite: bool = False) -> SlocumExport:
    """Write ``missions/<name>.mi`` and its ``mafiles`` below a local folder.

    Parameters
    ----------
    mission : a mission that passes its checks.
    directory : folder, made if it is not there.
    overwrite : replace files that are there.

    Raises
    ------
    ConfigError : the mission contradicts itself.
    DataError : a file is there already, or cannot be written.
    """
    check_mission(mission)
    left: list[str] = []
    program = express(mission)
    left += program.left
    texts = _texts(program.mission, left, program.farther) | _by_hand(program)
    root = Path(directory)
    paths = {root / name: text for name, text in texts.items()}
    there = [path for path in paths if path.exists()]
    if there and not overwrite:
        raise DataError(f"{there[0]}: expected no such file yet, found one. Choose another folder, or overwrite.")
    try:
        for path, text in paths.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_name(path.name + ".part")
            part.write_text(text, encoding="ascii", newline="\n")
            part.replace(path)
    except OSError as error:
        raise DataError(f"{root}: cannot be written: {error.strerror or error}. Check the folder.") from error
    return SlocumExport(tuple(paths), tuple(left), tuple(program.said))


def _by_hand(program: Expressed) -> dict[str, str]:
    """The argument files that a person exchanges when a rule of the program fires, by their path."""
    files = {}
    for folder, (mission, kinds, words) in program.by_hand.items():
        stems = tuple(kind[:6] for kind in kinds)
        for name, text in _texts(mission, [], []).items():
            file = name.rsplit("/", 1)[-1]
            if file.startswith(stems):
                files[f"{folder}/{file}"] = text.replace("# made by glider_jax", f"# {_ascii(words)}", 1)
    return files


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()


def _texts(mission: Mission, left: list[str], farther: list[float]) -> dict[str, str]:
    """Relative path -> content of every file; ``farther`` m are distances from the waypoint beyond which to come up."""
    name = re.sub(r"[^A-Za-z0-9_]", "", mission.name)[:8] or "mission"
    if name != mission.name:
        left.append(f"name: '{mission.name}' shortened to '{name}', the glider takes eight letters")
    for key, value in (("start", mission.start), ("start_position", mission.start_position)):
        if value is not None:
            left.append(f"{key}: Slocum files do not say it")
    files = {}
    mi = [f"# {name}.mi, made by glider_jax. A draft: check it before it flies.", ""]
    mi += [f"sensor: u_use_current_correction(nodim) {1 if mission.current_correction else 0}", ""]
    mi += [*_abend(mission.aborts), ""]
    for number, rule in enumerate(mission.surface, FIRST_FILE):
        mi += ["behavior: surface", _arg("args_from_file", "enum", number), _arg("start_when", "enum", _code(rule)), ""]
        files[f"mafiles/surfac{number:02d}.ma"] = _ma("surface", _surface(rule, mission, left))
    for number, distance in enumerate(farther, FIRST_FILE + len(mission.surface)):
        mi += ["behavior: surface", _arg("args_from_file", "enum", number), _arg("start_when", "enum", 15), ""]
        lines = _surface(SurfaceRule("waypoint_distance", distance=distance, name="farther"), mission, left)
        files[f"mafiles/surfac{number:02d}.ma"] = _ma("surface", lines)
    mi += ["behavior: goto_list", _arg("args_from_file", "enum", FIRST_FILE), ""]
    files[f"mafiles/goto_l{FIRST_FILE}.ma"] = _ma("goto_list", _goto(mission, left), _waypoints(mission))
    mi += ["behavior: yo", _arg("args_from_file", "enum", FIRST_FILE), ""]
    files[f"mafiles/yo{FIRST_FILE}.ma"] = _ma("yo", _yo(mission, left))
    for number, sample in enumerate(mission.samples, FIRST_FILE):
        mi += ["behavior: sample", _arg("args_from_file", "enum", number), ""]
        files[f"mafiles/sample{number:02d}.ma"] = _ma("sample", _sample(sample))
    mi += ["behavior: prepare_to_dive", _arg("start_when", "enum", 0), _arg("wait_time", "s", 720), ""]
    mi += ["behavior: sensors_in", ""]
    return {f"missions/{name}.mi": "\n".join(mi), **files}


def _arg(name: str, unit: str, value: float | int) -> str:
    return f"    b_arg: {name}({unit}) {value!r}"


def _ma(behavior: str, arguments: list[str], waypoints: list[str] | None = None) -> str:
    lines = [f"behavior_name={behavior}", "# made by glider_jax", "<start:b_arg>", *arguments, "<end:b_arg>"]
    if waypoints is not None:
        lines += ["<start:waypoints>", *waypoints, "<end:waypoints>"]
    return "\n".join(lines) + "\n"


def _abend(aborts: Aborts) -> list[str]:
    def limit(value: float | None, off: float = -1.0, factor: float = 1.0) -> float:
        return off if value is None else value * factor

    return [
        "behavior: abend",
        _arg("overdepth", "m", limit(aborts.overdepth, 10000.0)),
        _arg("overtime", "s", limit(aborts.overtime)),
        _arg("undervolts", "volts", limit(aborts.undervolts)),
        _arg("samedepth_for", "s", limit(aborts.same_depth_for)),
        _arg("stalled_for", "s", limit(aborts.stalled_for)),
        _arg("no_comms_tickle_for", "s", limit(aborts.no_comms_for)),
        _arg("max_wpt_distance", "m", limit(aborts.maximum_waypoint_distance)),
        _arg("remaining_charge_min", "%", limit(aborts.remaining_charge, 0.0, 100.0)),
    ]


def _code(rule: SurfaceRule) -> int:
    return 10 if rule.kind == "every" and rule.when_yo_ends else _CODES[rule.kind]


def _surface(rule: SurfaceRule, mission: Mission, left: list[str]) -> list[str]:
    label = f"surface rule '{rule.name or rule.kind}'"
    if rule.when_yo_ends and rule.kind not in ("every", "yo_done"):
        left.append(f"{label}: that the yo ends first; the glider breaks a dive off")
    if rule.kind == "yo_done" and mission.yo.half_cycles is None:
        left.append(f"{label}: the yo has no end, so it comes up when the waypoints are through")
    lines = []
    if rule.kind in ("every", "after", "no_comms", "utc"):
        seconds = rule.seconds
        if rule.kind != "utc" and seconds < 120.0:
            left.append(f"{label}: {seconds:g} s raised to 120 s, the firmware's least")
            seconds = 120.0
        lines.append(_arg("when_secs", "s", seconds))
    if rule.kind == "utc" and rule.time is not None:
        when = datetime.fromtimestamp(rule.time, UTC)
        if not 2010 <= when.year <= 2099:
            left.append(f"{label}: a time in {when.year} has no timestamp, the rule never acts")
        if rule.time % 60.0:
            left.append(f"{label}: seconds of its time, the glider knows minutes")
        lines.append(f"    b_arg: when_utc_timestamp(dtime) {when:%y%m%d%H%M}")
    if rule.kind == "inflections":
        lines.append(_arg("when_num_inflections", "nodim", rule.count))
    if rule.kind == "waypoint_distance":
        lines.append(_arg("when_wpt_dist", "m", rule.distance))
    least = TYPICAL_FIX + _POSTFIX + TYPICAL_CALL
    wait = mission.surface_stay - least
    if not 0.0 <= wait <= 900.0:
        note = f"surface_stay: {mission.surface_stay:g} s, the glider can wait for {least:g} to {least + 900.0:g} s"
        left += [] if note in left else [note]
    pitch = mission.yo.climb_pitch if rule.climb_pitch is None else rule.climb_pitch
    return [
        *lines,
        _arg("end_action", "enum", 0 if rule.ends_mission else 1),
        _arg("gps_wait_time", "s", 300.0),
        _arg("gps_postfix_wait_time", "s", _POSTFIX),
        _arg("keystroke_wait_time", "s", min(max(wait, 0.0), 900.0)),
        _arg("c_use_bpump", "enum", 2),
        _arg("c_bpump_value", "X", FULL_PUMP_CC),
        _arg("c_use_pitch", "enum", 3),
        _arg("c_pitch_value", "X", pitch),
    ]


def _goto(mission: Mission, left: list[str]) -> list[str]:
    if len(mission.waypoints) > MOST_WAYPOINTS:
        left.append(f"waypoints: {len(mission.waypoints)} are written, many gliders take {MOST_WAYPOINTS}")
    radius = mission.waypoint_radius
    if radius < 10.0:
        left.append(f"waypoint_radius: {radius:g} m raised to 10 m, the firmware's least")
        radius = 10.0
    return [
        _arg("start_when", "enum", 0),
        _arg("list_stop_when", "enum", 7),
        _arg("list_when_wpt_dist", "m", radius),
        _arg("initial_wpt", "enum", -2 if mission.first_waypoint is None else mission.first_waypoint),
        _arg("num_waypoints", "nodim", len(mission.waypoints)),
        _arg("num_legs_to_run", "nodim", mission.legs),
    ]


def _waypoints(mission: Mission) -> list[str]:
    return [f"{to_degrees_minutes(lon, 5)} {to_degrees_minutes(lat, 4)}" for lat, lon in mission.waypoints]


def _yo(mission: Mission, left: list[str]) -> list[str]:
    yo = mission.yo
    if yo.overshoot is not None:
        left.append(f"overshoot: {yo.overshoot:g} m, the glider finds its own")

    def leg(side: str, sign: float, depth: float, altitude: float | None, volume: float | None, pitch: float):
        cc = FULL_PUMP_CC if volume is None else min(volume * 1e6, FULL_PUMP_CC)
        return [
            _arg(f"{side}_target_depth", "m", depth),
            _arg(f"{side}_target_altitude", "m", -1.0 if altitude is None else altitude),
            _arg(f"{side}_use_bpump", "enum", 2),
            _arg(f"{side}_bpump_value", "X", sign * cc),
            _arg(f"{side}_use_pitch", "enum", 3),
            _arg(f"{side}_pitch_value", "X", sign * pitch),
        ]

    return [
        _arg("start_when", "enum", 2),
        _arg("num_half_cycles_to_do", "nodim", -1 if yo.half_cycles is None else yo.half_cycles),
        _arg("end_action", "enum", 2),
        *leg("d", -1.0, yo.dive_to, yo.dive_altitude, yo.dive_volume, yo.dive_pitch),
        *leg("c", 1.0, yo.climb_to, yo.climb_altitude, yo.climb_volume, yo.climb_pitch),
    ]


def _sample(sample: SampleRule) -> list[str]:
    bits = sum(_STATE_BITS[state] for state in sample.states)
    return [
        _arg("sensor_type", "enum", sample.sensor_type),
        _arg("state_to_sample", "enum", bits),
        _arg("intersample_time", "s", sample.interval if sample.states else -1.0),
        _arg("nth_yo_to_sample", "nodim", sample.every_nth_yo),
        _arg("min_depth", "m", sample.minimum_depth),
        _arg("max_depth", "m", sample.maximum_depth),
    ]
