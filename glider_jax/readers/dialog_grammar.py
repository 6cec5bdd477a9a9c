"""What the lines of a surface dialog look like, and how their numbers are read.

Standard library only. Every pattern starts with a literal and repeats only within bounds and without going back
(possessive), so that any text is read in linear time. Positions are printed as degrees and minutes (``DDDMM.mmm``),
always with N and E: the sign alone gives the hemisphere. The waypoint line gives latitude first. A value of 69696969
and an age of 1e+308 both mean "never set".
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from datetime import date
from typing import NamedTuple

#: Ages from here on, and values from here on, mean "never set".
NEVER = 1e300
UNSET = 69_696_969.0
#: s; no age printed by a glider that knows its clock is longer.
LONGEST_AGE = 1e9
FIRST_YEAR, LAST_YEAR = 1990, 2099

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_EPOCH_DAY = date(1970, 1, 1).toordinal()

_N = r"[-+]?(?:\d{1,20}+(?:\.\d{0,20}+)?|\.\d{1,20}+)(?:[eE][-+]?\d{1,3}+)?"
_V = rf"{_N}|-?nan|-?inf"
_S, _G, _O = r"[ \t]{1,40}+", r"\s{1,60}+", r"[ \t]{0,40}+"
_NAME = r"[A-Za-z0-9_.\-]{1,48}+"
_PLACE = rf"\s{{0,60}}+({_N}){_G}N{_G}({_N}){_G}E{_G}measured{_G}({_V}){_G}secs ago"
_MOMENT = (
    rf"(\S{{3}}){_S}([A-Za-z]{{3}}){_S}(\d{{1,2}}){_S}(\d{{1,2}}):(\d{{2}}):(\d{{2}}){_S}(\d{{4}})(?!\d)"
)
_COUNTS = rf"{_O}(\d{{1,9}}+)/{_O}(\d{{1,9}}+)/{_O}(\d{{1,9}}+)"

_PATTERNS = {
    "connection": r"Connection Event: Carrier Detect (found|lost)",
    "surface": rf"Glider{_S}({_NAME}) at surface",
    "because": (
        rf"Because:([^\[\r\n]{{0,200}}+)(?:\[behavior{_S}(\w{{1,64}}+){_S}start_when{_O}={_O}({_N})\]|(?=[\[\n]))"
    ),
    "mission": (
        rf"MissionName:{_O}(\S{{1,64}}+){_G}MissionNum:{_O}(\S{{1,64}}+)(?=\s)"
        rf"{_O}(?:\((\d{{1,8}}+\.\d{{1,8}}+)\))?"
    ),
    "log_mission": rf"Mission Name:{_O}(\S{{1,64}}+)(?=\s)",
    "log_number": rf"Mission Number:{_O}(\S{{1,64}}+)(?=\s)",
    "vehicle": rf"Vehicle Name:{_O}({_NAME})(?=\s)",
    "time": rf"Curr(?:ent)? Time:{_O}{_MOMENT}(?=\s)(?:{_O}MT:{_O}(\d{{1,12}}+)(?=\s))?",
    "dr": rf"DR{_S}(Location){_O}:{_PLACE}",
    "gps": rf"GPS{_S}(Location|TooFar|Invalid){_O}:{_PLACE}",
    "sensor": (
        rf"sensor:{_O}(\w{{1,64}}+)\(([^()\s]{{0,24}}+)\){_O}={_O}({_V})(?:{_S}[A-Za-z%/\-]{{1,12}}+)?{_G}({_V})"
        rf"{_G}secs ago"
    ),
    "waypoint": (
        rf"Waypoint:{_O}\({_O}({_N}){_O},{_O}({_N}){_O}\)(?:{_O}Range:{_O}({_N}){_O}(km|m)\b)?"
        rf"(?:,?{_O}Bearing:{_O}({_N}){_O}deg)?(?:,?{_O}Age:{_O}(\d{{1,6}}+):(\d{{1,4}}+)h:m)?"
    ),
    "abort": (
        rf"ABORT HISTORY:{_O}(total since reset|last abort (?:cause|details|time|segment|mission)){_O}:{_O}"
        r"([^\r\n]{0,200}+)(?=[\r\n])"
    ),
    "devices": rf"devices:\(t/m/s\){_O}errs:{_COUNTS}{_O}warn:{_COUNTS}{_O}odd:{_COUNTS}(?=\s)",
    "water": r"Water Velocity Calculations (NOT )?COMPLETE",
    "postfix": r"Waiting for final GPS fix",
    "resume_menu": r"Hit Control-R to RESUME",
    "resuming": r"RESUMING MISSION",
    "diving": rf"Time until diving is:{_O}(\d{{1,9}}+){_S}secs",
    "prompt": r"Glider(Dos|LAB)(?: ([AIN]) (-?\d{1,4}) ?>|: )",
    "ended": r"End of Mission(?=\s)",
    "started": r"MissionSTARTDate:",
    "lab": r"You are in LAB MODE",
    "error": r"SCI ERROR:([^\r\n]{0,200}+)",
    "reread": r"MAFILES will be re-read",
}
_COMPILED = {kind: re.compile(pattern, re.ASCII) for kind, pattern in _PATTERNS.items()}
_REPORT = re.compile(
    rf"^{_O}(\d{{1,10}}+(?:\.\d{{1,3}}+)?)(?:{_S}\d{{1,3}}+)?{_S}sensor: (\w{{1,64}}+) = ({_V}) ([^\s]{{1,24}}+){_O}$",
    re.ASCII | re.MULTILINE,
)
_LABELS = (
    "secs ago",
    "GPS Location",
    "GPS Invalid",
    "GPS TooFar",
    "DR  Location",
    "Curr Time:",
    "MissionName:",
)
_OPEN_SENSOR = re.compile(r"sensor:\w{1,64}+\([^()\s]{0,24}+\)=", re.ASCII)
#: Bytes a line gains on its way: everything that is neither printable nor a tab or a line end.
_NOISE = {c: None for c in (*range(9), 11, 12, *range(14, 32), *range(127, 160))}


_PREFIX = r"^\d{4}-\d\d-\d\d[T ][0-9:.,+Z\-]{5,24}+[ \t]{1,8}+(?:\[?[A-Z]{1,8}+\]?[ \t]{1,8}+)?sfmc\.[\w\-]{1,48}+\."
#: A monitor writes its own words between those of the glider, each with a time and the name of its channel.
_DIALOG_CHANNEL = re.compile(rf"{_PREFIX}DIALOG:?[ \t]?", re.ASCII | re.MULTILINE)
_OTHER_CHANNEL = re.compile(rf"{_PREFIX}[^\n]{{0,10000}}+", re.ASCII | re.MULTILINE)


class Token(NamedTuple):
    """One line that was understood: its kind, where it starts and ends, and the groups of its pattern."""

    start: int
    end: int
    kind: str
    groups: tuple[str | None, ...]


def clean(text: str) -> tuple[str, int]:
    """The text without control characters and prefixes of a monitor, lines ended by line feeds; how many went."""
    bare = text.translate(_NOISE)
    count = len(text) - len(bare)
    bare = bare.replace("\r", "\n")
    if "sfmc." in bare:
        bare = _OTHER_CHANNEL.sub("", _DIALOG_CHANNEL.sub("", bare))
    return bare, count


def tokens(text: str) -> list[Token]:
    """Every line of a cleaned text that was understood, in the order of the text."""
    found = [
        Token(m.start(), m.end(), kind, m.groups())
        for kind, pattern in _COMPILED.items()
        for m in pattern.finditer(text)
    ]
    if " sensor: " in text:
        found.extend(Token(m.start(), m.end(), "report", m.groups()) for m in _REPORT.finditer(text))
    found.sort()
    return found


def garbled(text: str, found: list[Token]) -> list[int]:
    """Where lines begin a datum of a dialog and do not complete it: one place per line, ascending."""
    places = sorted(_label_places(text))
    lines: list[int] = []
    token, end_of_line = 0, -1
    for place in places:
        if place <= end_of_line:
            continue
        while token < len(found) and found[token].end <= place:
            token += 1
        if token < len(found) and found[token].start <= place:
            continue
        lines.append(place)
        end_of_line = text.find("\n", place)
        end_of_line = len(text) if end_of_line < 0 else end_of_line
    return lines


def _label_places(text: str) -> Iterator[int]:
    for label in _LABELS:
        place = text.find(label)
        while place >= 0:
            yield place
            place = text.find(label, place + 1)
    yield from (m.start() for m in _OPEN_SENSOR.finditer(text))


def number(text: str | None) -> float:
    """A printed number; NaN where there is none."""
    return math.nan if text is None else float(text)


def known_age(age: float) -> bool:
    """Whether a printed age says when a datum was measured; a clock set in between may make it slightly negative."""
    return -60.0 <= age < LONGEST_AGE


def degrees(printed: float, limit: float) -> float:
    """Degrees of a printed ``DDDMM.mmm``; NaN where the minutes pass 60 or the result passes ``limit``.

    Examples
    --------
    >>> degrees(-7040.271, 180.0), degrees(4138.861, 90.0), degrees(4199.0, 90.0)
    (-70.67118333333333, 41.64768333333333, nan)
    """
    size = abs(printed)
    if not size < 100.0 * limit + 100.0:
        return math.nan
    whole = math.floor(size / 100.0)
    minutes = size - 100.0 * whole
    value = whole + minutes / 60.0
    return math.copysign(value, printed) if minutes <= 60.0005 and value <= limit else math.nan


def place(latitude: str, longitude: str) -> tuple[float, float] | None:
    """Latitude and longitude in degrees of a printed pair; None where never set, at 0 N 0 E or impossible."""
    lat, lon = degrees(float(latitude), 90.0), degrees(float(longitude), 180.0)
    if math.isnan(lat) or math.isnan(lon) or (lat == 0.0 and lon == 0.0):
        return None
    return lat, lon


def moment(groups: tuple[str | None, ...]) -> float | None:
    """Seconds since 1970 of weekday, month, day, hour, minute, second, year; None where they cannot be.

    A weekday that contradicts the date betrays a garbled digit; a garbled weekday does not spoil the date.
    """
    weekday, month, day, hour, minute, second, year = (str(g) for g in groups[:7])
    if month.lower() not in _MONTHS or not FIRST_YEAR <= int(year) <= LAST_YEAR:
        return None
    if int(hour) > 23 or int(minute) > 59 or int(second) > 59:
        return None
    try:
        there = date(int(year), _MONTHS.index(month.lower()) + 1, int(day))
    except ValueError:
        return None
    if weekday.lower() in _DAYS and _DAYS.index(weekday.lower()) != there.weekday():
        return None
    return (there.toordinal() - _EPOCH_DAY) * 86400.0 + int(hour) * 3600.0 + int(minute) * 60.0 + int(second)


_MOMENT_ONLY = re.compile(rf"\s{{0,8}}+{_MOMENT}", re.ASCII)
_ISO = re.compile(r"\s{0,8}+(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d):(\d\d)\s{0,4}+(?:Z|[+-]00:?00)?", re.ASCII)


def written_moment(text: str) -> float | None:
    """Seconds since 1970 of ``Mon Jun 13 23:39:36 2022`` or ``2022-06-13T23:39:36+0000``, both UTC; else None."""
    if found := _MOMENT_ONLY.match(text):
        return moment(found.groups())
    if not (found := _ISO.match(text)):
        return None
    year, month, day, hour, minute, second = (int(g) for g in found.groups())
    if not FIRST_YEAR <= year <= LAST_YEAR or hour > 23 or minute > 59 or second > 59:
        return None
    try:
        days = date(year, month, day).toordinal() - _EPOCH_DAY
    except ValueError:
        return None
    return days * 86400.0 + hour * 3600.0 + minute * 60.0 + second


def printable(text: str, longest: int = 200) -> str:
    """Text of the glider with everything but printable ASCII taken out, so that it can be shown anywhere as text."""
    return "".join(c for c in text if " " <= c <= "~").strip()[:longest]


#: Units as printed -> SI unit and factor. Others are kept as printed.
_FACTORS: dict[str, tuple[str, float]] = {
    "amp-hrs": ("C", 3600.0),
    "amp-hr": ("C", 3600.0),
    "volts": ("V", 1.0),
    "volt": ("V", 1.0),
    "amp": ("A", 1.0),
    "amps": ("A", 1.0),
    "ma": ("A", 1e-3),
    "watts": ("W", 1.0),
    "watt": ("W", 1.0),
    "inhg": ("Pa", 3386.389),
    "bar": ("Pa", 1e5),
    "dbar": ("Pa", 1e4),
    "psi": ("Pa", 6894.757),
    "km": ("m", 1e3),
    "cm": ("m", 1e-2),
    "in": ("m", 0.0254),
    "sec": ("s", 1.0),
    "secs": ("s", 1.0),
    "timestamp": ("s", 1.0),
    "min": ("s", 60.0),
    "minutes": ("s", 60.0),
    "hours": ("s", 3600.0),
    "hrs": ("s", 3600.0),
    "days": ("s", 86400.0),
    "cc": ("m3", 1e-6),
    "%": ("1", 0.01),
    "deg": ("rad", math.pi / 180.0),
    "c": ("degC", 1.0),
    "degc": ("degC", 1.0),
    "nodim": ("1", 1.0),
    "enum": ("1", 1.0),
    "bool": ("1", 1.0),
    "int": ("1", 1.0),
}
_AXES: dict[str, Callable[[float], float]] = {
    "lat": lambda printed: degrees(printed, 90.0),
    "lon": lambda printed: degrees(printed, 180.0),
}


def to_si(printed: float, unit: str) -> tuple[float, str]:
    """A printed sensor value in SI and the unit's name; positions in degrees; NaN where impossible.

    Examples
    --------
    >>> to_si(170.659932, "amp-hrs"), to_si(43.0, "%"), to_si(7.0, "X")
    ((614375.7552, 'C'), (0.43, '1'), (7.0, 'X'))
    """
    if unit in _AXES:
        return _AXES[unit](printed), "degrees"
    name, factor = _FACTORS.get(unit.lower(), (unit, 1.0))
    return printed * factor, name


#: SI units of the sensors that forecasts use; another unit means a garbled line.
_EXPECTED = {
    "m_battery": "V",
    "m_coulomb_amphr": "C",
    "m_coulomb_amphr_total": "C",
    "f_coulomb_battery_capacity": "C",
    "m_lithium_battery_relative_charge": "1",
    "m_tot_num_inflections": "1",
    "m_gps_mag_var": "rad",
}


def right_unit(name: str, unit: str) -> bool:
    """Whether a sensor is printed in a unit that it can have."""
    si = to_si(0.0, unit)[1]
    if name.endswith(("_lat", "_lon")):
        return si == "degrees"
    if name.endswith(("water_vx", "water_vy")):
        return si == "m/s"
    return _EXPECTED.get(name, si) == si
