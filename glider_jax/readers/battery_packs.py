"""Battery packs by name: rated charge and energy, how the voltage falls, what share may be counted on.

Standard library only. State of charge runs with charge: 1 for full, 0 when the rated charge is drawn. The share a
plan may count on is the recommended capacity over the rated one.
"""

from __future__ import annotations

from glider_jax.config import Battery, Quantity

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
