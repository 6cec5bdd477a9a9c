"""How long the battery lasts: charge per day by the counter and by the simulated mission, and the dates it leads to.

NumPy only. The counter says how much, the simulation says what for: where both are known, the simulated components are
scaled to the counter. A counter that falls was set to zero: a new pack or a new epoch, and only what came after counts.
Charge in C inside, ampere-hours in what is said.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from glider_jax.config import Battery
from glider_jax.products.coordinates import iso_time
from glider_jax.records import Array

DAY = 86400.0
LEVELS = (0.20, 0.15, 0.10)
SPREAD = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
#: C; a counter that falls by more was set back.
_RESET = 180.0
#: Shares, 1-sigma: capacity of a pack (age, temperature), how the draw of the next weeks departs from this one's, and
#: a simulation of a vehicle nobody measured. Judgement.
_CAPACITY_SD, _FUTURE_SD, _UNMEASURED_SD = 0.05, 0.1, 0.3
_SHORTEST = 6 * 3600.0
_DRAWS = 4000


class Epoch(NamedTuple):
    """A time without a reset: begin and end UTC s, counter at both in C."""

    begin: float
    end: float
    first: float
    last: float


def epochs(time: Array, charge: Array) -> list[Epoch]:
    """Split a counter at its resets; ``time`` (n,) UTC s ascending, ``charge`` (n,) C, NaN left out."""
    good = np.isfinite(charge)
    time, charge = np.asarray(time, float)[good], np.asarray(charge, float)[good]
    if time.size == 0:
        return []
    cuts = np.flatnonzero(np.diff(charge) < -_RESET) + 1
    found = []
    for t, q in zip(np.split(time, cuts), np.split(charge, cuts), strict=True):
        found.append(Epoch(float(t[0]), float(t[-1]), float(q[0]), float(q[-1])))
    return found


def counter_rates(time: Array, charge: Array) -> dict[str, float]:
    """Mean draw since the last reset, A: over the last ``24 h`` and ``72 h``, and over ``all``; NaN where too short.

    A window shorter than six hours says nothing.
    """
    parts = epochs(time, charge)
    if not parts:
        return {"24 h": math.nan, "72 h": math.nan, "all": math.nan}
    last = parts[-1]
    mine = np.isfinite(charge) & (time >= last.begin)
    t, q = np.asarray(time, float)[mine], np.asarray(charge, float)[mine]

    def rate(window: float) -> float:
        begin = max(t[-1] - window, t[0])
        span = t[-1] - begin
        return float((q[-1] - np.interp(begin, t, q)) / span) if span >= _SHORTEST else math.nan

    return {"24 h": rate(DAY), "72 h": rate(3 * DAY), "all": rate(math.inf)}


def outlook(
    *,
    now: float,
    battery: Battery,
    simulated: Array,
    components: dict[str, float],
    counter: tuple[Array, Array] | None = None,
    charge_used: float = math.nan,
    capacity: float = math.nan,
    relative_charge: float = math.nan,
    reserve: float | None = None,
    way_home: float = 0.0,
    seed: int = 0,
) -> dict[str, Any]:
    """Charge per day and the dates at which 20, 15, 10 % and the reserve are reached, with intervals.

    Parameters
    ----------
    now : UTC s of the newest evidence.  battery : of the vehicle, for what nobody said.
    simulated : (n,) A, each member's mean draw.  components : their mean draw, A, by name.
    counter : times and counted charge, C, as recorded.
    charge_used, capacity : C; relative_charge : share left; NaN where unknown.
    reserve : share to be left at recovery, the battery's if None.  way_home : s from the decision to the recovery.
    """
    rng = np.random.default_rng([seed, 31])
    said: list[str] = []
    reserve = battery.reserve_fraction if reserve is None else reserve
    simulated = np.asarray(simulated, float)
    simulated = simulated[np.isfinite(simulated) & (simulated > 0.0)]
    time, charge = counter if counter is not None else (np.empty(0), np.empty(0))
    rates = counter_rates(time, charge)
    parts = epochs(time, charge)
    if len(parts) > 1:
        said.append(
            f"the charge counter was set back {len(parts) - 1} times, last at {iso_time(parts[-1].begin)}"
        )
    known = [v for v in (rates["72 h"], rates["24 h"], rates["all"]) if np.isfinite(v) and v > 0.0]
    if known:
        spread = math.hypot(_FUTURE_SD, _disagreement(known))
        draw = known[0] * np.exp(spread * rng.standard_normal(_DRAWS))
        how = "charge counter"
    elif simulated.size:
        draw = rng.choice(simulated, _DRAWS) * np.exp(_UNMEASURED_SD * rng.standard_normal(_DRAWS))
        how = "simulation"
        said.append(
            "no charge counter over six hours: the draw is the simulated vehicle's, good to about 30 %"
        )
    else:
        draw, how = np.full(_DRAWS, math.nan), "not known"
    factor = float(known[0] / simulated.mean()) if known and simulated.size else 1.0
    size, left, told = _state(battery, charge_used, capacity, relative_charge)
    said += told
    result: dict[str, Any] = {
        "ah_per_day": {
            "from": how,
            "total": _spread(draw * DAY / 3600.0, 4),
            "counter": {name: _round(value * DAY / 3600.0, 4) for name, value in rates.items()},
            "simulated": _round(simulated.mean() * DAY / 3600.0, 4) if simulated.size else None,
            "scaled_by": _round(factor, 4),
            "by_component": {k: _round(v * factor * DAY / 3600.0, 4) for k, v in components.items()},
        },
        "capacity_ah": _round(size / 3600.0, 3),
        "charge_left_percent": _round(100.0 * left, 3),
        "reserve_percent": _round(100.0 * reserve, 3),
        "levels": [],
        "last_safe_recovery": None,
        "days_left": None,
        "status": "unknown",
        "notes": said,
    }
    if not (np.isfinite(left) and np.isfinite(draw).all()):
        said.append("charge used or capacity is not known: no dates; give --charge-used-ah and --capacity-ah")
        return result
    sizes = size * np.exp(_CAPACITY_SD * rng.standard_normal(_DRAWS))
    gone = (1.0 - left) * size
    for level in sorted({*LEVELS, reserve}, reverse=True):
        seconds = np.maximum(((1.0 - level) * sizes - gone) / draw, 0.0)
        result["levels"].append(
            {
                "charge_left_percent": _round(100.0 * level, 3),
                "is_reserve": level == reserve,
                **_dates(now, seconds),
            }
        )
        if level == reserve:
            safe = float(np.quantile(seconds, 0.05)) - way_home
            result["last_safe_recovery"] = {
                "time": iso_time(now + max(safe, 0.0)),
                "days": _round(max(safe, 0.0) / DAY, 3),
                "meaning": "decide by then: 95 % of the draws still hold the reserve on arrival",
                "way_home_h": _round(way_home / 3600.0, 3),
            }
            days = float(np.median(seconds)) / DAY
            result["days_left"] = _round(days, 3)
            result["status"] = "green" if days >= 14.0 else "yellow" if days >= 7.0 else "red"
    return result


def _disagreement(values: list[float]) -> float:
    """Spread of the logarithm of the windows' rates: a draw that changes is known less well."""
    return float(np.std(np.log(values))) if len(values) > 1 else 0.0


def _state(battery: Battery, used: float, capacity: float, relative: float) -> tuple[float, float, list[str]]:
    """Capacity in C, share of charge left, and what was assumed or does not fit together."""
    said = []
    if not np.isfinite(capacity) and np.isfinite(used) and np.isfinite(relative) and 0.0 < relative < 0.99:
        capacity = used / (1.0 - relative)
        said.append(f"capacity of {capacity / 3600.0:.0f} Ah from the counter and the share left")
    if np.isfinite(capacity) and np.isfinite(used) and np.isfinite(relative):
        expected = 1.0 - used / capacity
        if abs(expected - relative) > 0.02:
            said.append(
                f"counter and capacity leave {100 * expected:.0f} %, the glider says {100 * relative:.0f} %: capacity "
                "or pack was changed; the counter and the capacity are believed"
            )
            relative = expected
    if not np.isfinite(capacity):
        capacity = battery.capacity.value
        said.append(
            f"capacity not known: {capacity / 3600.0:.0f} Ah of {battery.name} ({battery.chemistry}) assumed"
        )
    left = relative if np.isfinite(relative) else 1.0 - used / capacity
    if np.isfinite(left) and left < 0.0:
        said.append("more charge was drawn than the pack is said to hold: correct capacity or counter")
        left = 0.0
    return float(capacity), float(left), said


def _round(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None


def _spread(values: Array, digits: int) -> dict[str, float | None]:
    levels = (
        np.quantile(values, list(SPREAD.values())) if np.isfinite(values).all() else [math.nan] * len(SPREAD)
    )
    return {key: _round(v, digits) for key, v in zip(SPREAD, levels, strict=True)}


def _dates(now: float, seconds: Array) -> dict[str, Any]:
    levels = np.quantile(seconds, list(SPREAD.values()))
    return {
        "days": {key: _round(v / DAY, 3) for key, v in zip(SPREAD, levels, strict=True)},
        "time": {key: iso_time(now + float(v)) for key, v in zip(SPREAD, levels, strict=True)},
    }
