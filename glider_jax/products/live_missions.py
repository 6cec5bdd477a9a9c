"""Mission files of a live mission: read as far as they are there, and weighed against what the glider says.

The glider is believed. A missing list of waypoints is filled from its dialog; contradictions become warnings.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from glider_jax.config import Mission
from glider_jax.errors import DataError
from glider_jax.inference.evidence import Situation
from glider_jax.products.coordinates import place_text
from glider_jax.readers.dead_reckoning import metres

HOUR = 3600.0
#: Slocum ``start_when`` codes and the rules of a mission that can cause them.
_CODES = {
    2: "yo_done", 3: "mission_done", 6: "after", 7: "waypoint", 8: "waypoint", 9: "every", 11: "science",
    12: "no_comms", 13: "utc", 16: "inflections",
}  # fmt: skip
_FAR_WAYPOINT = 500.0


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
