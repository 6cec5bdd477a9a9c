"""Time axes of NetCDF files as seconds since 1970-01-01T00:00:00Z.

NumPy and cftime only. A newcomer would get wrong: time must be read raw, because aggregated files declare 0 as fill
value and the first hour is 0; and some files say "days" without since when.
"""

from __future__ import annotations

import re
import warnings
from datetime import UTC, datetime

import cftime
import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.units import TIME
from glider_jax.records import Array

REAL_CALENDARS = ("standard", "gregorian", "proleptic_gregorian", "none", "")
MODEL_CALENDARS = ("noleap", "365_day", "all_leap", "366_day", "360_day")
MODIFIED_JULIAN = (40000.0, 88069.0)  # 1968 to 2100: what "days" without a reference can only mean
MJD_EPOCH = -40587 * 86400.0  # 1858-11-17T00:00Z
MATLAB_EPOCH = 719529  # datenum of 1970-01-01


def iso(seconds: float) -> str:
    """Seconds since 1970 as an ISO 8601 string to the second."""
    if not np.isfinite(seconds):
        return "unknown"
    return datetime.fromtimestamp(round(float(seconds)), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def epoch_seconds(moment: object) -> float:
    """Seconds since 1970 of a number (taken as such), a datetime, a ``datetime64`` or an ISO 8601 string."""
    if isinstance(moment, np.datetime64):
        return float(moment.astype("datetime64[us]").astype(np.int64)) * 1e-6
    if isinstance(moment, str):
        moment = datetime.fromisoformat(moment.replace("Z", "+00:00"))
    if isinstance(moment, datetime):
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return float(moment)  # type: ignore[arg-type]


def decode_time(
    raw: Array, units: object, calendar: object = None, *, where: str, fill: object = None
) -> tuple[Array, tuple[str, ...]]:
    """Turn a raw time axis into seconds since 1970, NaN where no time is given, with notes on what was assumed.

    Parameters
    ----------
    raw : (n,) values as stored, without mask or scale.
    units : for example ``hours since 2019-01-01 00:00:00``; also ``days`` alone (Modified Julian Date),
        ``day as %Y%m%d.%f`` and MATLAB's ``days since 0000-01-00``.
    calendar : CF calendar name, or None for the standard one.
    where : start of messages: file and variable.
    fill : declared fill value. A fill value of 0 is taken for the legal time that it is.

    Raises
    ------
    DataError : the unit or calendar is unknown, or a number stands for no date.
    """
    notes: list[str] = []
    stored = np.asarray(raw)
    values = stored.astype(float)
    gone = ~np.isfinite(values) | (np.abs(values) > 9.9e36)
    if fill is not None and np.all(np.isfinite(np.asarray(fill, float))):
        hit = np.isin(values, np.asarray(fill, float))
        if hit.any() and np.all(np.asarray(fill, float) == 0):
            notes.append(f"{where}: kept the time 0 although the file declares 0 as its fill value.")
        else:
            gone |= hit
    text = str(units).strip() if units is not None else ""
    name = str(calendar).strip().lower() if calendar is not None else ""
    good = ~gone
    seconds = np.full(values.shape, np.nan)
    if good.any():
        seconds[good], more = _decode(values[good], text, name, where)
        notes += more
    if gone.any():
        notes.append(f"{where}: {int(gone.sum())} of {gone.size} times are missing.")
    if stored.dtype == np.float32 and good.any():
        coarse = float(np.max(np.spacing(np.abs(stored[good])))) * _step(text)
        if coarse > 1.0:
            notes.append(f"{where}: stored in single precision, times are good to {coarse:.0f} s only.")
    return np.round(seconds, 3), tuple(notes)


def _step(units: str) -> float:
    """Seconds per unit of a time unit string."""
    word = units.lower().split()[0] if units else ""
    return TIME.get(word, TIME.get(word.rstrip("s"), 1.0))


def _decode(values: Array, units: str, calendar: str, where: str) -> tuple[Array, list[str]]:
    """Decode finite raw times."""
    lower = units.lower()
    if re.search(r"%y%m%d", lower):
        return np.array([_packed_date(value, where) for value in values]), []
    parts = re.fullmatch(r"\s*([a-z]+)\s+since\s+(.+)", lower)
    if parts is None:
        inside = bool(np.all((values > MODIFIED_JULIAN[0]) & (values < MODIFIED_JULIAN[1])))
        if lower.rstrip("s") in ("day", "d", "modified julian day") and inside:
            note = f"{where}: '{units}' names no reference date; taken as Modified Julian Date."
            return values * 86400.0 + MJD_EPOCH, [note]
        raise DataError(
            f"{where}: expected a time unit such as 'hours since 2019-01-01', found '{units}'. "
            "Correct the units attribute of the time variable."
        )
    factor = TIME.get(parts[1], TIME.get(parts[1].removesuffix("s")))
    if factor is None:
        raise DataError(
            f"{where}: expected seconds, minutes, hours or days since a date, found '{units}'. "
            "Correct the units attribute of the time variable."
        )
    zero = re.match(r"0{1,4}-0?([01])-0?([01])(?:\D|$)", parts[2])
    if zero:
        first = MATLAB_EPOCH if (zero[1], zero[2]) != ("1", "1") else MATLAB_EPOCH - 1
        return values * factor - first * 86400.0, [f"{where}: '{units}' taken as MATLAB day numbers."]
    if calendar in REAL_CALENDARS:
        return _real(values, units, "standard" if calendar in ("none", "") else calendar, where), []
    if calendar in MODEL_CALENDARS:
        return _model(values, units, calendar, where)
    raise DataError(
        f"{where}: expected a calendar of {', '.join(REAL_CALENDARS[:3] + MODEL_CALENDARS)}, "
        f"found '{calendar}'. Correct the calendar attribute."
    )


def _dates(values: Array, units: str, calendar: str, where: str) -> Array:
    """Date objects of raw times, with a clear error where there are none."""
    # A zone like -6:00, which the CF conventions show, would be ignored without its leading zero.
    units = re.sub(r"(\d:\d\d(?::\d\d(?:\.\d+)?)?)\s*([+-])(\d(?::\d\d)?)$", r"\1 \g<2>0\3", units.strip())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", cftime.CFWarning)
            return np.atleast_1d(cftime.num2date(values, units, calendar=calendar))
    except (ValueError, TypeError, OverflowError, cftime.CFWarning) as problem:
        raise DataError(
            f"{where}: expected times that are dates, found '{units}', calendar '{calendar}', with values "
            f"{values.min():g} to {values.max():g} ({problem}). Correct the time variable."
        ) from problem


def _real(values: Array, units: str, calendar: str, where: str) -> Array:
    """Seconds since 1970 of raw times in a calendar that people use."""
    dates = _dates(values, units, calendar, where)
    return np.asarray(cftime.date2num(dates, "seconds since 1970-01-01", calendar=calendar), float)


def _model(values: Array, units: str, calendar: str, where: str) -> tuple[Array, list[str]]:
    """Seconds since 1970 of the dates that a model calendar names; NaN for dates that never were."""
    seconds = np.full(values.shape, np.nan)
    for index, date in enumerate(_dates(values, units, calendar, where)):
        try:
            day = datetime(date.year, date.month, date.day, date.hour, date.minute, date.second, tzinfo=UTC)
        except ValueError:
            continue
        seconds[index] = day.timestamp() + date.microsecond * 1e-6
    lost = int(np.isnan(seconds).sum())
    note = f"{where}: calendar '{calendar}': dates were taken over by name, 29 February may be absent"
    return seconds, [note + (f"; {lost} dates that do not exist were dropped." if lost else ".")]


def _packed_date(value: float, where: str) -> float:
    """Seconds since 1970 of a number like 20121028.5."""
    whole = int(value)
    try:
        day = datetime(whole // 10000, whole // 100 % 100, whole % 100, tzinfo=UTC)
    except ValueError as problem:
        raise DataError(
            f"{where}: expected dates as YYYYMMDD, found {value:g} ({problem}). Correct the time variable."
        ) from problem
    return day.timestamp() + (value - whole) * 86400.0
