"""What the instrument itself draws: the board by channels, the science computer by software and clock;
NumPy free.

The numbers are Tables I and II of the paper this package builds on. The February 2010 mission was cut
short partly by
this load, so it belongs in every energy model: ``instrument_devices`` gives it as entries of the device
table.
"""

from __future__ import annotations

from dataclasses import dataclass

from glider_jax.config import Device, Quantity
from glider_jax.errors import ConfigError, did_you_mean

_PAPER = "Slocum Glider Energy Measurement and Simulation Infrastructure (OCEANS 2010)"


@dataclass(frozen=True)
class Load:
    """A steady load of the instrument: its name, what it is, W, the fastest CTD interval it allows (s),
    its source."""

    name: str
    text: str
    power: float
    ctd_interval: float | None
    source: str


# The paper prints two decimals and no uncertainty; half a unit of the last digit is what rounding leaves.
ROUNDING_SIGMA = 0.005 / 3.0**0.5

BOARDS = {
    "board_8": Load("board_8", "deployed board, 8 channels", 0.76, None, f"{_PAPER}, Table II"),
    "board_6": Load("board_6", "development board, 6 channels", 0.58, None, f"{_PAPER}, Table II"),
}
COMPUTERS = {
    "stock_3680": Load(
        "stock_3680", "stock software 6.38, 3.68 MHz, no board log", 0.19, 2.0, f"{_PAPER}, Table I"
    ),
    "deployed_14720": Load(
        "deployed_14720", "deployed software 6.38, 14.72 MHz", 0.71, 2.0, f"{_PAPER}, Table I"
    ),
    "development_3680": Load(
        "development_3680",
        "development software 6.38, 3.68 MHz",
        0.35,
        4.0,
        f"{_PAPER}, Table I and section II",
    ),
    "development_7360": Load(
        "development_7360",
        "development software 6.38, 7.36 MHz",
        0.49,
        2.0,
        f"{_PAPER}, Table I; CTD interval at this clock is judgement",
    ),
}


def _find(table: dict[str, Load], name: str, what: str) -> Load:
    if name not in table:
        known = ", ".join(table)
        raise ConfigError(f"{what} '{name}': expected one of {known}.{did_you_mean(name, table)}")
    return table[name]


def instrument_power(board: str = "board_8", computer: str = "deployed_14720") -> float:
    """Extra power of carrying the instrument, W: the board, and the computer above its stock software."""
    extra = _find(COMPUTERS, computer, "science computer").power - COMPUTERS["stock_3680"].power
    return _find(BOARDS, board, "board").power + extra


def ctd_interval(computer: str) -> float:
    """Shortest CTD sampling interval that a science computer keeps up with while it logs the board, s."""
    interval = _find(COMPUTERS, computer, "science computer").ctd_interval
    return float("nan") if interval is None else interval


def instrument_devices(board: str = "board_8", computer: str = "deployed_14720") -> tuple[Device, ...]:
    """The instrument as entries of a vehicle's device table.

    Parameters
    ----------
    board : a name of ``BOARDS``.
    computer : a name of ``COMPUTERS``. Its full power is an entry, so leave the science computer out of
        ``hotel``.

    Raises
    ------
    ConfigError : an unknown name.
    """
    loads = (_find(BOARDS, board, "board"), _find(COMPUTERS, computer, "science computer"))
    return tuple(
        Device(
            name=load.name,
            group="instrument",
            power=Quantity(load.power, ROUNDING_SIGMA, "W", load.source),
            states=frozenset({"dive", "climb", "hover", "surface"}),
        )
        for load in loads
    )


def device_toml(board: str = "board_8", computer: str = "deployed_14720") -> str:
    """The same entries as ``[[device]]`` tables to paste into a vehicle file."""
    lines = []
    for device in instrument_devices(board, computer):
        lines += [
            "[[device]]",
            f'name = "{device.name}"',
            f'group = "{device.group}"',
            f"power = {{ value = {device.power.value}, sigma = {device.power.sigma:.4f}, "
            f'source = "{device.power.source}" }}',
            "states = [" + ", ".join(f'"{state}"' for state in sorted(device.states)) + "]",
            "",
        ]
    return "\n".join(lines)
