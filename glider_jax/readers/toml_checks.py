"""Typed access to TOML files: every value is checked, every unknown key is reported with the nearest known one.

Standard library only. A bare number carries the unit that the format documents for its key; an explicit ``unit`` is
converted. Angles, hours and cubic centimetres exist only here: what leaves this module is SI and radians.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glider_jax.errors import ConfigError, DataError, did_you_mean

_ALIASES = {
    "kg": "kg", "g": "g",
    "m3": "m3", "m^3": "m3", "cc": "cc", "cm3": "cc", "ml": "cc", "l": "litre", "litre": "litre",
    "m3 s-1": "m3 s-1", "m3/s": "m3 s-1", "cc/s": "cc s-1", "cc s-1": "cc s-1", "cc/sec": "cc s-1",
    "m": "m", "km": "km", "cm": "cm", "nm": "nmi", "nmi": "nmi",
    "m2": "m2", "m^2": "m2",
    "s": "s", "sec": "s", "min": "min", "h": "h", "hour": "h", "hours": "h", "d": "d", "day": "d", "days": "d",
    "w": "W", "mw": "mW", "j": "J", "kj": "kJ", "mj": "MJ", "wh": "Wh", "kwh": "kWh",
    "c": "C", "ah": "Ah", "amp-hrs": "Ah", "v": "V", "volts": "V", "a": "A", "ohm": "ohm", "ohms": "ohm",
    "rad": "rad", "deg": "deg", "degree": "deg", "degrees": "deg",
    "m s-1": "m s-1", "m/s": "m s-1", "cm/s": "cm s-1", "cm s-1": "cm s-1",
    "rad-1": "rad-1", "1/rad": "rad-1", "rad-2": "rad-2", "1/rad2": "rad-2", "1/rad^2": "rad-2",
    "pa-1": "Pa-1", "1/pa": "Pa-1", "dbar-1": "dbar-1", "1/dbar": "dbar-1",
    "k-1": "K-1", "1/k": "K-1", "k^-1": "K-1", "j m-1": "J m-1", "j/m": "J m-1",
    "1": "1", "": "1", "-": "1", "%": "%", "percent": "%",
}  # fmt: skip

#: canonical unit -> (SI unit it converts to, factor)
UNITS: dict[str, tuple[str, float]] = {
    "kg": ("kg", 1.0), "g": ("kg", 1e-3),
    "m3": ("m3", 1.0), "cc": ("m3", 1e-6), "litre": ("m3", 1e-3),
    "m3 s-1": ("m3 s-1", 1.0), "cc s-1": ("m3 s-1", 1e-6),
    "m": ("m", 1.0), "km": ("m", 1e3), "cm": ("m", 1e-2), "nmi": ("m", 1852.0), "m2": ("m2", 1.0),
    "s": ("s", 1.0), "min": ("s", 60.0), "h": ("s", 3600.0), "d": ("s", 86400.0),
    "W": ("W", 1.0), "mW": ("W", 1e-3),
    "J": ("J", 1.0), "kJ": ("J", 1e3), "MJ": ("J", 1e6), "Wh": ("J", 3600.0), "kWh": ("J", 3.6e6),
    "C": ("C", 1.0), "Ah": ("C", 3600.0), "V": ("V", 1.0), "A": ("A", 1.0), "ohm": ("ohm", 1.0),
    "rad": ("rad", 1.0), "deg": ("rad", math.pi / 180.0),
    "m s-1": ("m s-1", 1.0), "cm s-1": ("m s-1", 1e-2),
    "rad-1": ("rad-1", 1.0), "rad-2": ("rad-2", 1.0),
    "Pa-1": ("Pa-1", 1.0), "dbar-1": ("Pa-1", 1e-4), "K-1": ("K-1", 1.0), "J m-1": ("J m-1", 1.0),
    "1": ("1", 1.0), "%": ("1", 1e-2),
}  # fmt: skip

#: endings of keys that name a unit: ``pump_volume_cc``, ``heading_deg``, ``battery_capacity_wh``
SUFFIXES = {
    "_cc": "cc", "_m3": "m3", "_cc_per_s": "cc s-1", "_g": "g", "_kg": "kg",
    "_deg": "deg", "_rad": "rad", "_s": "s", "_min": "min", "_h": "h", "_d": "d",
    "_m": "m", "_km": "km", "_cm_per_s": "cm s-1", "_w": "W", "_mw": "mW", "_j": "J", "_kj": "kJ", "_mj": "MJ",
    "_wh": "Wh", "_ah": "Ah", "_v": "V", "_ohm": "ohm", "_percent": "%", "_per_dbar": "dbar-1",
}  # fmt: skip


@dataclass(frozen=True)
class Given:
    """A number as a file gives it, in SI: ``sigma`` and ``source`` are None where the file does not say."""

    value: float
    sigma: float | None
    unit: str
    source: str | None


def si_factor(unit: str, want: str, where: str) -> float:
    """Return the factor that turns a number in ``unit`` into the SI unit ``want``; refuse another dimension."""
    canonical = _ALIASES.get(unit.strip().lower())
    if canonical is None:
        raise ConfigError(
            f"{where}: unknown unit '{unit}', expected {want} or a unit of the same kind.{did_you_mean(unit, UNITS)}"
        )
    si, factor = UNITS[canonical]
    if si != want:
        raise ConfigError(f"{where}: expected a unit that converts to {want}, found '{unit}'. Correct the unit.")
    return factor


def load_toml(path: str | Path) -> Table:
    """Read a TOML file into a checked table.

    Raises
    ------
    DataError : the file cannot be read.
    ConfigError : it is not TOML; the message carries the line.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"{path}: expected a readable TOML file, found: {error.strerror or error}. Check the path."
        ) from error
    return parse_toml(raw, path.name)


def parse_toml(raw: bytes, file: str) -> Table:
    """Parse the bytes of a TOML file that messages will call ``file``."""
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{file}: expected text in UTF-8, found byte {raw[error.start]:#04x} at position {error.start}. "
            "Save the file as UTF-8."
        ) from error
    try:
        return Table(tomllib.loads(text.replace("\r\n", "\n")), file)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"{file}: not valid TOML: {error}. Correct the syntax there.") from error


class Table:
    """One table of a TOML file, which remembers the keys that were asked for.

    ``path`` is the section as the user wrote it, such as ``[energy]``. Call :meth:`close` when all has been read:
    keys nobody asked for are errors.
    """

    def __init__(self, data: dict[str, Any], file: str, path: str = ""):
        self.data = data
        self.file = file
        self.path = path
        self.known: dict[str, None] = {}

    def where(self, key: str = "") -> str:
        """``file: [section] 'key'`` for messages."""
        parts = [self.path] if self.path else []
        if key:
            parts.append(f"'{key}'")
        return f"{self.file}: " + " ".join(parts) if parts else self.file

    def wrong(self, key: str, expected: str, advice: str = "Correct the value.") -> ConfigError:
        """An error that shows what was expected of a key and what is there."""
        return ConfigError(f"{self.where(key)}: expected {expected}, found {_show(self.data.get(key))}. {advice}")

    def __contains__(self, key: str) -> bool:
        self.known[key] = None
        return key in self.data

    def raw(self, key: str) -> Any:
        """The value as TOML gives it, None where it is absent."""
        self.known[key] = None
        return self.data.get(key)

    def text(self, key: str, default: str | None = None) -> str | None:
        """A string."""
        value = self.raw(key)
        if value is None:
            return default
        if not isinstance(value, str):
            raise self.wrong(key, "text in quotes")
        return value

    def boolean(self, key: str, default: bool) -> bool:
        """``true`` or ``false``; 0 and 1 are accepted."""
        value = self.raw(key)
        if value is None:
            return default
        if isinstance(value, bool) or value in (0, 1):
            return bool(value)
        raise self.wrong(key, "true or false")

    def integer(
        self, key: str, default: int | None = None, low: int | None = None, high: int | None = None
    ) -> int | None:
        """A whole number between ``low`` and ``high``."""
        value = self.raw(key)
        if value is None:
            return default
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.wrong(key, "a whole number")
        if (low is not None and value < low) or (high is not None and value > high):
            raise self.wrong(key, f"a whole number {_between(low, high)}")
        return value

    def number(
        self,
        key: str,
        default: float | None = None,
        low: float | None = None,
        high: float | None = None,
        unit: str = "",
    ) -> float | None:
        """A finite number between ``low`` and ``high``, in the unit that the key documents."""
        value = self.raw(key)
        if value is None:
            return default
        number = _finite(value)
        if number is None:
            raise self.wrong(key, f"a finite number{' in ' + unit if unit else ''}")
        if (low is not None and number < low) or (high is not None and number > high):
            raise self.wrong(key, f"a number {_between(low, high)}{' ' + unit if unit else ''}")
        return number

    def quantity(self, key: str, want: str, bare: str | None = None) -> Given | None:
        """A number with its unit, bare or as ``{value, sigma, unit, source}``; None where it is absent.

        Parameters
        ----------
        key : name without unit; ``key_cc``, ``key_deg`` and the like are found too, and ``key_sigma``.
        want : SI unit of the result.
        bare : unit of a number that states none; ``want`` if not given.
        """
        found = [(key, bare or want)] if key in self else []
        for suffix, unit in SUFFIXES.items():
            if UNITS[unit][0] == want and key + suffix in self:
                found.append((key + suffix, unit))
        sigma_key = f"{key}_sigma"
        sibling = self.number(sigma_key, low=0.0)
        if not found:
            if sibling is not None:
                raise ConfigError(f"{self.where(sigma_key)}: expected '{key}' beside it, found none. Add '{key}'.")
            return None
        if len(found) > 1:
            names = " and ".join(f"'{name}'" for name, _ in found)
            raise ConfigError(f"{self.where()}: {names} say the same thing twice. Keep one of them.")
        name, unit = found[0]
        value = self.data[name]
        if not isinstance(value, dict):
            factor = si_factor(unit, want, self.where(name))
            number = self.number(name)
            assert number is not None
            return Given(number * factor, None if sibling is None else sibling * factor, want, None)
        inner = Table(value, self.file, f"{self.path} {name}".strip())
        number = inner.number("value")
        if number is None:
            raise ConfigError(f"{self.where(name)}: expected {{ value = ... }}, found no 'value'. Add it.")
        sigma = inner.number("sigma", low=0.0)
        factor = si_factor(inner.text("unit", unit) or unit, want, inner.where())
        source = inner.text("source")
        inner.close()
        if sigma is not None and sibling is not None:
            raise ConfigError(f"{self.where(name)}: 'sigma' and '{sigma_key}' say the same thing twice. Keep one.")
        sigma = sibling if sigma is None else sigma
        return Given(number * factor, None if sigma is None else sigma * factor, want, source)

    def table(self, key: str) -> Table | None:
        """A sub-table, or None."""
        value = self.raw(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.wrong(key, f"a table [{key}]")
        path = f"[{key}]" if not self.path else f"{self.path} {key}"
        return Table(value, self.file, path)

    def tables(self, key: str) -> list[Table]:
        """An array of tables, numbered from 1 in messages."""
        value = self.raw(key)
        if value is None:
            return []
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.wrong(key, f"a list of tables [[{key}]]")
        return [Table(item, self.file, f"[[{key}]] {i}") for i, item in enumerate(value, 1)]

    def numbers(self, key: str, length: int | None = None) -> tuple[float, ...] | None:
        """A list of finite numbers."""
        value = self.raw(key)
        if value is None:
            return None
        result = number_list(value)
        if result is None or (length is not None and len(result) != length):
            raise self.wrong(key, f"a list of {length if length is not None else 'finite'} numbers")
        return result

    def texts(self, key: str) -> tuple[str, ...] | None:
        """A list of strings."""
        value = self.raw(key)
        if value is None:
            return None
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.wrong(key, "a list of texts")
        return tuple(value)

    def close(self) -> None:
        """Refuse every key that was not asked for."""
        for key in self.data:
            if key not in self.known:
                hint = did_you_mean(key, self.known)
                if not hint:
                    hint = f" Known here: {', '.join(k for k in self.known if not _is_suffixed(k, self.known))}."
                label = f"{self.path} " if self.path else ""
                raise ConfigError(f"{self.file}: {label}unknown key '{key}'.{hint}")


def number_list(value: Any) -> tuple[float, ...] | None:
    """The finite numbers of a TOML list, or None if it is anything else."""
    if not isinstance(value, list):
        return None
    numbers = [_finite(item) for item in value]
    if any(number is None for number in numbers):
        return None
    return tuple(number for number in numbers if number is not None)


def _finite(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _is_suffixed(key: str, known: dict[str, None]) -> bool:
    return any(key.endswith(end) and key.removesuffix(end) in known for end in (*SUFFIXES, "_sigma"))


def _between(low: float | None, high: float | None) -> str:
    if low is None:
        return f"up to {high:g}"
    if high is None:
        return f"of at least {low:g}"
    return f"between {low:g} and {high:g}"


def _show(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."
