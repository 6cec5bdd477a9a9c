"""Factors from the unit strings of data files to SI, and the clear refusal of the ones nobody knows.

Standard library only. A newcomer would get wrong: the same product gives cm/s in one vintage and m/s in the next,
so the string in the file decides, never the name of the product.
"""

from __future__ import annotations

import re

from glider_jax.errors import DataError, did_you_mean

LENGTH = {"m": 1.0, "metre": 1.0, "meter": 1.0, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01}
LENGTH |= {"mm": 1e-3, "millimetre": 1e-3, "millimeter": 1e-3, "km": 1e3, "kilometre": 1e3, "kilometer": 1e3}
LENGTH |= {"dm": 0.1, "nmi": 1852.0, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "fathom": 1.8288}
TIME = {"s": 1.0, "sec": 1.0, "second": 1.0, "min": 60.0, "minute": 60.0, "h": 3600.0, "hr": 3600.0}
TIME |= {"hour": 3600.0, "d": 86400.0, "day": 86400.0}
TIME |= {"ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "us": 1e-6, "microsecond": 1e-6, "ns": 1e-9}
TIME |= {"nanosecond": 1e-9, "week": 604800.0}
SPEED = {"kn": 1852.0 / 3600.0, "kt": 1852.0 / 3600.0, "knot": 1852.0 / 3600.0}
SPEED |= {"mps": 1.0, "cmps": 0.01, "kph": 1e3 / 3600.0}


def _lookup(word: str, table: dict[str, float]) -> float | None:
    """Factor of a unit word, which may be a plural."""
    if word in table:
        return table[word]
    return table.get(word[:-1]) if word.endswith("s") else None


def speed_factor(units: object, where: str) -> float:
    """Factor that turns a speed in ``units`` into m s-1.

    Parameters
    ----------
    units : the attribute as read from the file, for example ``cm/s``, ``m s-1``, ``meter second-1``, ``knots``.
    where : start of the error message: file and variable.

    Raises
    ------
    DataError : the string is absent or is not a speed that is known.
    """
    text = str(units).strip() if units is not None else ""
    if not text:
        raise DataError(
            f"{where}: expected a units attribute such as 'm s-1' or 'cm/s', found none. "
            "Add it to the file, or give names={'units': 'm s-1'} if you know it."
        )
    clean = re.sub(r"[()\[\]{}$]", "", text.lower()).replace("**", "").replace("^", "")
    known = _lookup(clean, SPEED)
    if known is not None:
        return known
    parts = re.fullmatch(r"([a-z]+)\s*(?:/|per\b)\s*([a-z]+)", clean) or re.fullmatch(
        r"([a-z]+)[\s.*]+([a-z]+)\s*\{?-1\}?", clean
    )
    length = _lookup(parts[1], LENGTH) if parts else None
    period = _lookup(parts[2], TIME) if parts else None
    if length is None or period is None:
        known_units = ("m/s", "cm/s", "mm/s", "km/h", "m s-1", "cm s-1", "meter second-1", "knots")
        raise DataError(
            f"{where}: expected a unit of speed (for example m s-1 or cm/s), found '{text}'."
            f"{did_you_mean(text, known_units)} Correct the units attribute, or name the right variable."
        )
    return length / period


def length_factor(units: object, where: str) -> float:
    """Factor that turns a length in ``units`` into m; metres are assumed where the file gives no unit.

    Raises
    ------
    DataError : the string is not a length that is known, for example a pressure or a model level.
    """
    text = str(units).strip() if units is not None else ""
    if not text:
        return 1.0
    factor = _lookup(text.lower(), LENGTH)
    if factor is None:
        raise DataError(
            f"{where}: expected depths in metres, found the unit '{text}'. "
            "Interpolate the product to depth levels, or correct the units attribute."
        )
    return factor
