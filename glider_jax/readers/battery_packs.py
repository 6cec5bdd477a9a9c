"""Battery packs by name: rated charge and energy, how the voltage falls, what share may be counted on.

State of charge runs with charge: 1 for full, 0 when the rated charge is drawn. The share a
plan may count on is the recommended capacity over the rated one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from glider_jax.config import Battery, Quantity
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.readers.device_catalogue import quantity_of
from glider_jax.readers.toml_checks import Table, number_list

_TABLE = "operator's manual table: rated Ah, rated Wh, recommended capacity, undervolts"
_RESISTANCE = Quantity(0.3, 0.15, "ohm", "comet: 0.22 ohm in 2016 and 0.50 ohm in 2019, apparent")
_ALKALINE = ((0.0, 10.0), (0.05, 11.0), (0.25, 12.0), (0.5, 12.9), (0.75, 13.8), (1.0, 15.0))
_THREE = ((0.0, 9.0), (0.03, 10.5), (0.1, 10.75), (1.0, 11.0))
_FOUR = ((0.0, 10.5), (0.05, 11.4), (0.14, 11.6), (0.16, 14.5), (1.0, 15.0))
_IONS = ((0.0, 11.0), (0.05, 12.5), (0.2, 13.3), (0.5, 14.0), (0.8, 15.0), (1.0, 16.4))

#: name -> chemistry, rated Ah, rated Wh, recommended Ah, undervolts, curve, derating per kelvin, text
_PACKS = {
    "alkaline": ("alkaline", 168.0, 2520.0, 120.0, 10.0, _ALKALINE, 0.008, "slopes from 15 to 10 V"),
    "lithium_primary_3s": (
        "lithium",
        780.0,
        8424.0,
        720.0,
        9.8,
        _THREE,
        0.003,
        "flat, no reserve after the drop",
    ),
    "lithium_primary_3s_extended": (
        "lithium",
        1140.0,
        12312.0,
        1050.0,
        9.8,
        _THREE,
        0.003,
        "flat, no reserve",
    ),
    "lithium_primary_4s": (
        "lithium",
        600.0,
        8600.0,
        550.0,
        12.0,
        _FOUR,
        0.003,
        "drops to 11.5 V at about 85 %",
    ),
    "lithium_primary_4s_extended": (
        "lithium",
        870.0,
        12500.0,
        800.0,
        12.0,
        _FOUR,
        0.003,
        "drops to 11.5 V at 85 %",
    ),
    "rechargeable": ("lithium-ion", 234.6, 3300.0, 215.0, 12.0, _IONS, 0.005, "slopes"),
    "rechargeable_extended": ("lithium-ion", 326.4, 4700.0, 300.0, 12.0, _IONS, 0.005, "slopes"),
}

_DEFAULT = "alkaline"

PACKS: tuple[str, ...] = tuple(_PACKS)


def pack(name: str) -> Battery:
    """Return a pack of :data:`PACKS`.

    Notes
    -----
    The curves are drawn through the published facts (alkaline slopes from 15 to 10 V; lithium 4S drops to 11.5 V at
    about 85 % of its energy and still flies; lithium 3S has nothing left after its drop) so that rated energy over
    rated charge is their mean. The alkaline rating is charge times 15 V; its curve delivers a sixth less.
    """
    chemistry, ah, wh, recommended, undervolts, curve, derating, text = _PACKS[name]
    return Battery(
        name=name,
        chemistry=chemistry,
        capacity=Quantity(ah * 3600.0, 0.03 * ah * 3600.0, "C", f"{_TABLE}; {text}; sigma judgement"),
        energy=Quantity(wh * 3600.0, 0.05 * wh * 3600.0, "J", f"{_TABLE}; sigma judgement"),
        voltage_curve=curve,
        usable_fraction=Quantity(round(recommended / ah, 4), 0.05, "1", f"{_TABLE}; sigma judgement"),
        internal_resistance=_RESISTANCE,
        temperature_derating=Quantity(
            derating,
            derating / 2.0,
            "K-1",
            "judgement: about 10 % margin for cold water (alkaline more, lithium less)",
        ),
        undervolts=undervolts,
    )


def read_battery(table: Table | None, energy: Table | None, base: Battery | None) -> tuple[Battery, list[str]]:
    """Read the pack of a vehicle file and the sentences on what it left unsaid.

    It is a named pack, the preset's, or one made of the capacity and voltages of ``[energy]``; ``[battery]`` overrides.
    """
    assumed: list[str] = []
    capacity = energy.quantity("battery_capacity", "J") if energy is not None else None
    voltages = energy.table("open_circuit_voltage") if energy is not None else None
    name = table.text("pack") if table is not None else None
    if name is not None and name not in PACKS:
        assert table is not None
        raise ConfigError(f"{table.where('pack')}: unknown pack '{name}'.{did_you_mean(name, PACKS) or _known_packs()}")
    if name is not None:
        battery = pack(name)
    elif base is not None:
        battery = base
    else:
        battery = pack(_DEFAULT)
        if capacity is None and (table is None or "capacity" not in table):
            assumed.append(f"battery: pack '{_DEFAULT}' from default")
    if voltages is not None:
        full, empty = (
            voltages.number("full", None, 1.0, 1000.0, "V"),
            voltages.number("empty", None, 1.0, 1000.0, "V"),
        )
        if full is None or empty is None or empty > full:
            raise voltages.wrong("full", "'full' at or above 'empty', both in V")
        voltages.close()
        battery = replace(battery, voltage_curve=((0.0, empty), (1.0, full)), undervolts=min(battery.undervolts, empty))
    if capacity is not None:
        assert energy is not None
        if capacity.value <= 0.0:
            raise energy.wrong("battery_capacity", "more than 0 J")
        # Charge follows from energy by the mean of the voltage curve over charge.
        mean = mean_voltage(battery.voltage_curve)
        source = capacity.source or energy.file
        sigma = 0.0 if capacity.sigma is None else capacity.sigma
        battery = replace(
            battery,
            name="given capacity" if name is None else battery.name,
            chemistry="linear" if voltages is not None and name is None else battery.chemistry,
            energy=Quantity(capacity.value, sigma, "J", source),
            capacity=Quantity(capacity.value / mean, sigma / mean, "C", source),
        )
        if name is None and base is None:
            # A capacity in joules says how much is there; nothing is known of resistance or cold.
            battery = replace(
                battery,
                internal_resistance=Quantity(0.0, 0.0, "ohm", "left out unless named"),
                temperature_derating=Quantity(0.0, 0.0, "K-1", "left out unless named"),
                usable_fraction=Quantity(1.0, 0.0, "1", "the capacity given is the usable one"),
            )
            assumed.append("battery: all of the given capacity is usable; no internal resistance, no loss in the cold")
    if table is not None:
        battery = _battery_overrides(table, battery)
    return battery, assumed


def _known_packs() -> str:
    return f" Known: {', '.join(PACKS)}."


def mean_voltage(curve: tuple[tuple[float, float], ...]) -> float:
    """Mean of a voltage curve over charge, V."""
    pairs = zip(curve, curve[1:], strict=False)
    return sum((b[0] - a[0]) * (a[1] + b[1]) / 2.0 for a, b in pairs) / (curve[-1][0] - curve[0][0])


def _battery_overrides(table: Table, battery: Battery) -> Battery:
    changes: dict[str, Any] = {}
    limits = {
        "capacity": ("C", 1.0, 1e8), "energy": ("J", 1.0, 1e10), "usable_fraction": ("1", 0.01, 1.0),
        "internal_resistance": ("ohm", 0.0, 10.0), "temperature_derating": ("K-1", 0.0, 0.1),
    }  # fmt: skip
    for key, (unit, low, high) in limits.items():
        number = table.quantity(key, unit)
        if number is not None:
            if not low <= number.value <= high:
                raise ConfigError(
                    f"{table.where(key)}: expected {low:g} to {high:g} {unit}, found {number.value:g}. Correct it."
                )
            changes[key] = quantity_of(number, table.file)
    for key, low, high in (("undervolts", 0.0, 100.0), ("reserve_fraction", 0.0, 0.99)):
        value = table.number(key, None, low, high)
        if value is not None:
            changes[key] = value
    for key in ("name", "chemistry"):
        text = table.text(key)
        if text is not None:
            changes[key] = text
    raw = table.raw("voltage_curve")
    if raw is not None:
        points = [number_list(point) for point in raw] if isinstance(raw, list) else []
        curve = [point for point in points if point is not None and len(point) == 2]
        ascending = all(a[0] < b[0] for a, b in zip(curve, curve[1:], strict=False))
        if len(curve) < 2 or len(curve) != len(points) or not ascending or curve[0][0] < 0.0 or curve[-1][0] > 1.0:
            raise table.wrong("voltage_curve", "two or more [state of charge 0..1 ascending, volts]")
        changes["voltage_curve"] = tuple((float(s), float(v)) for s, v in curve)
    battery = replace(battery, **changes)
    # One of charge and energy given alone sets the other by the mean voltage.
    mean = mean_voltage(battery.voltage_curve)
    if "capacity" in changes and "energy" not in changes:
        c = battery.capacity
        battery = replace(battery, energy=Quantity(c.value * mean, c.sigma * mean, "J", c.source))
    elif "energy" in changes and "capacity" not in changes:
        e = battery.energy
        battery = replace(battery, capacity=Quantity(e.value / mean, e.sigma / mean, "C", e.source))
    return battery
