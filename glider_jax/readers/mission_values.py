"""Values of mission files in TOML: times, positions and texts, read with checks and written back. Standard library."""

from __future__ import annotations

from datetime import UTC, date, datetime
from typing import Any

from glider_jax.errors import ConfigError
from glider_jax.readers.toml_checks import Table, number_list


def parse_time(table: Table, key: str) -> float | None:
    """UTC seconds since 1970 from a number, an ISO-8601 text or a TOML date; a time without zone is UTC."""
    value = table.raw(key)
    if value is None:
        return None
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value.strip())
        except ValueError as error:
            raise table.wrong(key, "a time such as 2009-09-05T12:00:00Z") from error
    if isinstance(value, date) and not isinstance(value, datetime):
        value = datetime(value.year, value.month, value.day)
    if isinstance(value, datetime):
        try:
            seconds = (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
        except (OverflowError, ValueError) as error:
            raise table.wrong(key, "a time after 1970") from error
    else:
        number = table.number(key, unit="seconds since 1970")
        assert number is not None
        seconds = number
    if not -1e10 < seconds < 1e11:
        raise table.wrong(key, "seconds since 1970, or a time such as 2009-09-05T12:00:00Z")
    return seconds


def position_of(value: Any, table: Table, key: str, label: str) -> tuple[float, float]:
    """(latitude, longitude) in degrees from a list of two numbers; a swapped pair is told."""
    pair = number_list(value)
    if pair is None or len(pair) != 2:
        raise ConfigError(
            f"{table.where(key)}: {label}: expected [latitude, longitude] in decimal degrees, found {value!r}. "
            "Correct it."
        )
    if abs(pair[0]) > 90.0 and abs(pair[1]) <= 90.0:
        raise ConfigError(
            f"{table.where(key)}: {label}: expected a latitude of -90 to 90 degrees first, found {pair[0]:g}. "
            "Latitude and longitude look swapped."
        )
    return pair[0], pair[1]


def pair_text(position: tuple[float, float]) -> str:
    """A position as TOML, to the last digit."""
    return f"[{float(position[0])!r}, {float(position[1])!r}]"


def bool_text(value: bool) -> str:
    """A switch as TOML."""
    return "true" if value else "false"


def quote(text: str) -> str:
    """A TOML basic string: backslash, quote and control characters escaped."""
    out = []
    for ch in text:
        if ch in '"\\':
            out.append("\\" + ch)
        elif ord(ch) < 0x20 or ord(ch) == 0x7F:
            out.append(f"\\u{ord(ch):04x}")
        else:
            out.append(ch)
    return '"' + "".join(out) + '"'
