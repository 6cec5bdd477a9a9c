"""How the pages write times, shares, areas and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path


def area(km2: float) -> str:
    """An area in km² with two digits that count."""
    return f"{km2:.2g} km²" if km2 < 10 else f"{km2:,.0f} km²"


def elapsed(hours: float) -> str:
    """Time since the start: hours to two days, then days."""
    return f"+{hours:g} h" if hours <= 48 else f"+{hours / 24:.4g} days"


def seconds(text: str) -> float:
    """UTC seconds of an ISO time."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def stamp(text: str | None) -> str:
    """``2012-10-25T03:00:00Z`` as ``25 Oct 2012 03:00Z``."""
    if not text:
        return "-"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return Path(text).name
    return f"{moment.day} {moment:%b %Y %H:%M}Z"


def between(time: Mapping[str, str | None], first: str = "p05", last: str = "p95") -> str:
    """Two times without the year; the day is said once where both have the same."""
    if not time.get(first):
        return "-"
    if not time.get(last):
        return f"{_short(time[first])} to after the end"
    a, b = _short(time[first]), _short(time[last])
    return f"{a} to {b.split(' ')[-1]}" if a.rsplit(" ", 1)[0] == b.rsplit(" ", 1)[0] else f"{a} to {b}"


def _short(text: str) -> str:
    moment = datetime.fromisoformat(text)
    return f"{moment.day} {moment:%b %H:%M}Z"


def day(text: str | None) -> str:
    """The date of an ISO time."""
    return "-" if not text else text[:10]


def percent(share: float) -> str:
    """A share in percent; never 0 or 100 % where some are on the other side."""
    if 0.0 < share < 0.001:
        return "<0.1 %"
    if 0.999 < share < 1.0:
        return ">99.9 %"
    return f"{100 * share:.1f} %" if 0.0 < share < 1.0 else f"{100 * share:.0f} %"


def number(value: float | None, digits: int) -> str:
    """A number with so many digits, or a dash."""
    return "-" if value is None else f"{value:,.{digits}f}"
