"""The syntax of Slocum ``.mi`` and ``.ma`` files, and positions in degrees and minutes; no meaning is given to them.

Standard library only. Traps: waypoints stand longitude first, as DDDMM.mmmm with the sign before the degrees; ``#``
starts a comment anywhere; names come in any case, bytes may be Latin-1, values may be ``??`` or missing.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

from glider_jax.errors import ConfigError, DataError

LARGEST = 2_000_000
_ARG = re.compile(r"^b_arg\s*:\s*([A-Za-z]\w*)\s*(?:\(([^)]*)\))?\s*(\S+)?", re.IGNORECASE)
_SENSOR = re.compile(r"^sensor\s*:\s*([A-Za-z]\w*)\s*(?:\(([^)]*)\))?\s*(\S+)?", re.IGNORECASE)
_BEHAVIOR = re.compile(r"^behavior\s*:\s*([A-Za-z]\w*)", re.IGNORECASE)
_NAME = re.compile(r"^behavior_name\s*[=:]\s*([A-Za-z]\w*)", re.IGNORECASE)
_TAG = re.compile(r"^<\s*(start|end)\s*:\s*(\w+)\s*>", re.IGNORECASE)
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_PAIR = re.compile(rf"^({_NUMBER})[\s,;]+({_NUMBER})(?=[\s,;]|$)")
_TIME_UNITS = {"min": 60.0, "mins": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hrs": 3600.0, "hours": 3600.0}
_AUTOEXEC = re.compile(r"^(installed|name|use|put|loadmission|load)\b", re.IGNORECASE)


@dataclass(frozen=True)
class Argument:
    """One ``b_arg`` or ``sensor`` line: its unit and its value as written."""

    unit: str
    text: str
    where: str

    @property
    def number(self) -> float | None:
        """The value, or None where it is not a finite number (``??``, nothing)."""
        try:
            value = float(self.text)
        except ValueError:
            return None
        return value if math.isfinite(value) else None


@dataclass
class Behavior:
    """One behaviour: its arguments by lower-case name, and waypoint lines as (where, text)."""

    name: str
    where: str
    arguments: dict[str, Argument] = field(default_factory=dict)
    waypoints: list[tuple[str, str]] = field(default_factory=list)

    def number(self, name: str, default: float) -> float:
        """An argument as a number; times given in minutes or hours become seconds."""
        argument = self.arguments.get(name)
        value = None if argument is None else argument.number
        if argument is None or value is None:
            return default
        return value * _TIME_UNITS.get(argument.unit.strip().lower(), 1.0)

    def code(self, name: str, default: int) -> int:
        """An argument as a whole number."""
        return int(self.number(name, default))


@dataclass
class Script:
    """A ``.mi`` or ``.ma`` file: sensor settings, behaviours in their order, and lines that were not understood."""

    file: str
    sensors: dict[str, Argument] = field(default_factory=dict)
    behaviors: list[Behavior] = field(default_factory=list)
    strange: list[str] = field(default_factory=list)


def read_text(path: Path) -> str:
    """The text of a mission file, UTF-8 or Latin-1, with any line ends."""
    try:
        with open(path, "rb") as stream:
            raw = stream.read(LARGEST + 1)
    except OSError as error:
        raise DataError(
            f"{path}: expected a readable mission file, found: {error.strerror or error}. Check the path."
        ) from error
    if len(raw) > LARGEST:
        raise DataError(f"{path}: expected a mission file of at most {LARGEST} bytes, found more. Check the path.")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_script(text: str, file: str) -> Script:
    """Parse a ``.mi`` or ``.ma`` file; what is not understood is kept in ``strange``."""
    script = Script(file)
    current: Behavior | None = None
    block = ""
    for number, raw in enumerate(text.split("\n"), 1):
        line = raw.split("#", 1)[0].replace("\x00", " ").strip()
        where = f"{file}: line {number}"
        if not line:
            continue
        if tag := _TAG.match(line):
            block = tag[2].lower() if tag[1].lower() == "start" else ""
        elif found := _BEHAVIOR.match(line) or _NAME.match(line):
            current = Behavior(found[1].lower(), where)
            script.behaviors.append(current)
        elif found := _SENSOR.match(line):
            script.sensors[found[1].lower()] = Argument(found[2] or "", found[3] or "", where)
        elif found := _ARG.match(line):
            if current is None:
                script.strange.append(f"{where}: '{line[:40]}' belongs to no behaviour")
            else:
                current.arguments[found[1].lower()] = Argument(found[2] or "", found[3] or "", where)
        elif block == "waypoints" and current is not None:
            current.waypoints.append((where, line))
        elif not _AUTOEXEC.match(line):
            script.strange.append(f"{where}: '{line[:40]}' not understood")
    return script


def from_degrees_minutes(text: str) -> float:
    """Decimal degrees of a DDDMM.mmmm number as written; the sign is taken from the text, so that -0012.5 is south.

    Raises
    ------
    ValueError : it is not a number, or has more than 60 minutes.
    """
    value = float(text)
    size = abs(value)
    degrees = math.floor(size / 100.0)
    minutes = size - 100.0 * degrees
    if not minutes <= 60.0:
        raise ValueError(f"{minutes:g} minutes")
    sign = -1.0 if text.strip().startswith("-") else 1.0
    return sign * (degrees + minutes / 60.0)


def to_degrees_minutes(degrees: float, width: int, places: int = 4) -> str:
    """A position as DDDMM.mmmm, ``width`` digits before the point, never with 60 minutes."""
    scale = 10**places
    units = round(abs(degrees) * 60.0 * scale)
    whole, rest = divmod(units, 60 * scale)
    sign = "-" if degrees < 0.0 and units else ""
    number = f"{whole * 100 + rest // scale:0{width}d}"
    return f"{sign}{number}.{rest % scale:0{places}d}"


def parse_waypoint(text: str, where: str, decimal_degrees: bool) -> tuple[float, float]:
    """Latitude and longitude in degrees of a waypoint line, which stands longitude first.

    Raises
    ------
    ConfigError : it is not a pair of numbers, is out of range, or could as well be decimal degrees.
    """
    pair = _PAIR.match(text)
    if pair is None:
        raise ConfigError(f"{where}: expected 'longitude latitude' as DDDMM.mmmm, found '{text[:40]}'. Correct it.")
    lon_text, lat_text = pair[1], pair[2]
    if decimal_degrees:
        lon, lat = float(lon_text), float(lat_text)
    else:
        if _looks_decimal(lon_text, 180.0, 4) and _looks_decimal(lat_text, 90.0, 3):
            raise ConfigError(
                f"{where}: expected 'longitude latitude' as DDDMM.mmmm, found '{lon_text} {lat_text}', which looks "
                "like decimal degrees. If it is, ask for decimal degrees; if it is near 0 N 0 E, pad it as 00045.678."
            )
        try:
            lon, lat = from_degrees_minutes(lon_text), from_degrees_minutes(lat_text)
        except ValueError as error:
            raise ConfigError(
                f"{where}: expected 'longitude latitude' as DDDMM.mmmm, found {error} in '{lon_text} {lat_text}'. "
                "Minutes end at 60; correct it, or ask for decimal degrees."
            ) from error
    if abs(lat) > 90.0 or abs(lon) > 360.0:
        raise ConfigError(
            f"{where}: expected longitude first, then a latitude of at most 90 degrees, found {lon:g} and {lat:g}. "
            "Are they swapped?"
        )
    return lat, lon


def _looks_decimal(text: str, limit: float, digits: int) -> bool:
    """Whether a number below ``limit`` has more than two decimals and is not padded to ``digits`` as minutes are."""
    whole, _, decimals = text.strip().lstrip("+-").partition(".")
    return abs(float(text)) < limit and len(decimals) > 2 and len(whole) < digits
