"""The state file of a dockserver (``gliderState.xml``): positions at each surfacing, next waypoint, last abort.

Standard library and records only. The file is read as text, not as XML: a half-downloaded file then still gives
every complete report, and no entity of it can do harm. Positions are degrees and minutes, latitude first; times are
UTC. One fix stands in many reports with times that differ by a second: reports of one fix are one.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from glider_jax.errors import DataError
from glider_jax.readers.dialog_grammar import clean, number, place, printable, written_moment
from glider_jax.readers.dialog_merge import SAME_FIX
from glider_jax.readers.dialog_records import AbortHistory, NextWaypoint, Position
from glider_jax.readers.geodesy import range_and_bearing
from glider_jax.records import Repair, Source

LARGEST_FILE = 64 * 1024 * 1024

_KINDS = {"valid": "gps", "invalid": "invalid", "too_far": "too_far", "dr": "dead_reckoned"}
_NUMBER = r"\s{0,20}+([-+]?\d{1,10}+(?:\.\d{0,12}+)?)\s{0,20}+"
_SURFACED = re.compile(r"<surface_date_time>([^<]{0,64}+)<", re.ASCII)
_LOCATION = re.compile(
    r"<(valid|invalid|too_far|dr)_location>\s{0,20}+<lat>([^<]{0,64}+)</lat>\s{0,20}+<lon>([^<]{0,64}+)</lon>"
    r"\s{0,20}+<time>([^<]{0,64}+)</time>",
    re.ASCII,
)
_PARAMETER = re.compile(r"<name>([^<]{0,128}+)</name>\s{0,20}+<value>([^<]{0,128}+)</value>", re.ASCII)
_PAIR = re.compile(rf"\s{{0,20}}+\({_NUMBER},{_NUMBER}\)", re.ASCII)
_LENGTH = re.compile(rf"{_NUMBER}(km|m)\b", re.ASCII)
_ANGLE = re.compile(rf"{_NUMBER}deg", re.ASCII)
_ABORT = re.compile(r"<lastAbort\s([^<>]{0,1000}+)>", re.ASCII)
_ATTRIBUTE = re.compile(r"\b(cause|dateTime|mission|reset|segment)=\"([^\"]{0,200}+)\"", re.ASCII)
_ONLY_NUMBER = re.compile(_NUMBER, re.ASCII)
_VEHICLE = re.compile(r"<(?:gliderName|vehicleName)>\s{0,20}+([A-Za-z0-9_.\-]{1,48}+)\s{0,20}+</", re.ASCII)


@dataclass(frozen=True)
class StateReport:
    """One surfacing as the dockserver saw it: positions known then, and when it was first and last reported.

    Positions carry the age at ``surface_time``; None where unavailable.
    """

    first_surface_time: float
    surface_time: float
    gps: Position | None
    dead_reckoned: Position | None
    invalid: Position | None
    too_far: Position | None
    count: int = 1


@dataclass(frozen=True)
class GliderState:
    """What a dockserver remembers of a glider.

    Attributes
    ----------
    vehicle : empty where the file does not say.
    history : every readable report, ascending in time.
    reports : one per distinct fix (or per dead-reckoned position before the first fix), ascending in time.
    fixes : distinct GPS fixes, ascending in time; ages are at ``time``, the newest report.
    waypoint : next waypoint with range and true bearing from the newest position. The file keeps the waypoint of an
        old dialog: its ``age`` at ``time`` is that of the newest position that fits the printed range, else NaN.
    last_abort : None where there was none.
    """

    vehicle: str
    history: tuple[StateReport, ...]
    waypoint: NextWaypoint | None
    last_abort: AbortHistory | None
    repairs: tuple[Repair, ...]
    source: Source

    @property
    def reports(self) -> tuple[StateReport, ...]:
        """Reports of distinct fixes."""
        return _distinct(self.history)

    @property
    def fixes(self) -> tuple[Position, ...]:
        """Distinct GPS fixes."""
        return _fixes(self.history, self.time)

    @property
    def surface_times(self) -> tuple[float, ...]:
        """Every time at which the glider reported, ascending."""
        return tuple(r.surface_time for r in self.history)

    @property
    def time(self) -> float:
        """Newest report, s; NaN where there is none."""
        return self.history[-1].surface_time if self.history else math.nan

    def until(self, moment: float) -> GliderState:
        """The state as far as it was known at ``moment``; the waypoint and abort only if no report came later."""
        kept = tuple(r for r in self.history if r.surface_time <= moment)
        if len(kept) == len(self.history):
            return self
        return replace(self, history=kept, waypoint=None, last_abort=None)


def read_glider_state(source: bytes | os.PathLike[str], *, vehicle: str = "") -> GliderState:
    """Read a dockserver's state file.

    Parameters
    ----------
    source : a path (``pathlib.Path``), or the bytes of the file; a file that breaks off gives its complete reports.
    vehicle : name of the glider, which the file itself need not hold.

    Raises
    ------
    DataError : the file cannot be read, or is no state file.
    """
    raw, label, origin = _content(source)
    text, _ = clean(raw)
    if "<gliderState" not in text and "<writeTrack" not in text:
        raise DataError(
            f"{label}: expected a dockserver state with <gliderState>, found none. Give gliderState.xml, "
            "or read a dialog log with read_dialog."
        )
    counts: Counter[str] = Counter()
    parts = text.split("<report>")[1:]
    reports = [r for part in parts if (r := _report(part, counts)) is not None]
    if "</gliderState>" not in text:
        counts["half a file"] += 1
    reports.sort(key=lambda r: r.surface_time)
    history = tuple(reports)
    counts["repeated report"] = len(history) - len(_distinct(history))
    places = [r.gps or r.dead_reckoned for r in history]
    here = next((p for p in reversed(places) if p is not None), None)
    named = _VEHICLE.search(text)
    return GliderState(
        vehicle=vehicle or (printable(named[1]) if named else ""),
        history=history,
        waypoint=_waypoint(text, here, history),
        last_abort=_last_abort(text),
        repairs=tuple(Repair(kind, n) for kind, n in counts.items() if n),
        source=origin,
    )


def _content(source: bytes | os.PathLike[str]) -> tuple[str, str, Source]:
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source).decode("latin-1"), "state", Source("dockserver state")
    path = Path(source)
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"{path}: expected a dockserver state below 64 MiB, found more. Check the file.")
        raw, digest = path.read_bytes(), Source.digest(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: expected a dockserver state, found {error}. Check the path.") from error
    return raw.decode("latin-1"), str(path), Source("dockserver state", {str(path): digest})


def _report(part: str, counts: Counter[str]) -> StateReport | None:
    """One report; None where it breaks off or has no readable time."""
    body, closed, _ = part.partition("</report>")
    surfaced = _SURFACED.search(body)
    when = written_moment(surfaced[1]) if surfaced else None
    if not closed or when is None:
        counts["broken report"] += 1
        return None
    places: dict[str, Position] = {}
    for kind, lat, lon, at in _LOCATION.findall(body):
        first, second, time = _ONLY_NUMBER.fullmatch(lat), _ONLY_NUMBER.fullmatch(lon), written_moment(at)
        if "unavailable" in (lat.strip(), lon.strip(), at.strip()):
            continue
        where = place(first[1], second[1]) if first and second else None
        if where is None or time is None:
            counts["impossible value"] += 1
            continue
        places[_KINDS[kind]] = Position(*where, max(0.0, when - time), time)
    return StateReport(when, when, *(places.get(k) for k in ("gps", "dead_reckoned", "invalid", "too_far")))


def _distinct(reports: Sequence[StateReport]) -> tuple[StateReport, ...]:
    """Neighbouring reports of one fix joined; the newest positions stand."""
    kept: list[StateReport] = []
    for report in reports:
        before = kept[-1] if kept else None
        if before is not None and _same(before, report):
            kept[-1] = replace(report, first_surface_time=before.first_surface_time, count=before.count + 1)
        else:
            kept.append(report)
    return tuple(kept)


def _same(one: StateReport, other: StateReport) -> bool:
    if one.gps is not None and other.gps is not None:
        return abs(one.gps.time - other.gps.time) <= SAME_FIX
    if one.gps is not None or other.gps is not None:
        return False
    if one.dead_reckoned is None or other.dead_reckoned is None:
        return one.dead_reckoned is other.dead_reckoned
    return abs(one.dead_reckoned.time - other.dead_reckoned.time) <= SAME_FIX


def _fixes(reports: Sequence[StateReport], now: float) -> tuple[Position, ...]:
    out: list[Position] = []
    for fix in sorted((r.gps for r in reports if r.gps is not None), key=lambda p: p.time):
        if not out or fix.time - out[-1].time > SAME_FIX:
            out.append(replace(fix, age=max(0.0, now - fix.time)))
    return tuple(out)


def _waypoint(text: str, here: Position | None, reports: Sequence[StateReport]) -> NextWaypoint | None:
    said = {name.strip().lower(): value for name, value in _PARAMETER.findall(text)}
    pair = _PAIR.match(said.get("next waypoint coordinates", ""))
    where = place(pair[1], pair[2]) if pair else None
    if where is None:
        return None
    length = _LENGTH.match(said.get("next waypoint range", ""))
    angle = _ANGLE.match(said.get("next waypoint bearing", ""))
    printed = number(length[1]) * (1000.0 if length[2] == "km" else 1.0) if length else math.nan
    way = (math.nan, math.nan) if here is None else range_and_bearing(here.latitude, here.longitude, *where)
    bearing = math.radians(number(angle[1])) if angle else math.nan
    return NextWaypoint(*where, *way, printed, bearing, _waypoint_age(where, printed, reports))


def _waypoint_age(where: tuple[float, float], printed: float, reports: Sequence[StateReport]) -> float:
    """Age at the newest report of the report from whose position the printed range was measured."""
    slack = max(5.0, 0.005 * printed)
    for report in reversed(reports):
        for spot in (report.gps, report.dead_reckoned):
            if spot is None:
                continue
            if abs(range_and_bearing(spot.latitude, spot.longitude, *where)[0] - printed) <= slack:
                return reports[-1].surface_time - report.surface_time
    return math.nan


def _last_abort(text: str) -> AbortHistory | None:
    found = _ABORT.search(text)
    words = dict(_ATTRIBUTE.findall(found[1])) if found else {}
    time = written_moment(words.get("dateTime", ""))
    if not words.get("cause", "").strip() and (time is None or time <= 0.0):
        return None
    return AbortHistory(
        cause=printable(words.get("cause", "")),
        time=math.nan if time is None or time <= 0.0 else time,
        segment=printable(words.get("segment", "")),
        mission=printable(words.get("mission", "")),
    )
