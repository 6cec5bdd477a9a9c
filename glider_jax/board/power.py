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
    "measurement_board_8": Load(
        "measurement_board_8", "deployed board, 8 channels", 0.76, None, f"{_PAPER}, Table II"
    ),
    "measurement_board_6": Load(
        "measurement_board_6", "development board, 6 channels", 0.58, None, f"{_PAPER}, Table II"
    ),
}
COMPUTERS = {
    "science_computer_stock": Load(
        "science_computer_stock",
        "stock software 6.38, 3.68 MHz, no board log",
        0.19,
        2.0,
        f"{_PAPER}, Table I",
    ),
    "science_computer_deployed": Load(
        "science_computer_deployed", "deployed software 6.38, 14.72 MHz", 0.71, 2.0, f"{_PAPER}, Table I"
    ),
    "science_computer_development_3mhz": Load(
        "science_computer_development_3mhz",
        "development software 6.38, 3.68 MHz",
        0.35,
        4.0,
        f"{_PAPER}, Table I and section II",
    ),
    "science_computer_development_7mhz": Load(
        "science_computer_development_7mhz",
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


def instrument_power(
    board: str = "measurement_board_8", computer: str = "science_computer_deployed"
) -> float:
    """Extra power of carrying the instrument, W: the board, and the computer above its stock software."""
    extra = _find(COMPUTERS, computer, "science computer").power - COMPUTERS["science_computer_stock"].power
    return _find(BOARDS, board, "board").power + extra


def ctd_interval(computer: str) -> float:
    """Shortest CTD sampling interval that a science computer keeps up with while it logs the board, s."""
    interval = _find(COMPUTERS, computer, "science computer").ctd_interval
    return float("nan") if interval is None else interval


def instrument_devices(
    board: str = "measurement_board_8", computer: str = "science_computer_deployed"
) -> tuple[Device, ...]:
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


def device_toml(board: str = "measurement_board_8", computer: str = "science_computer_deployed") -> str:
    """The line that selects the same entries of the device catalogue in a vehicle file, before its first
    table."""
    names = ", ".join(f'"{device.name}"' for device in instrument_devices(board, computer))
    return f"devices = [{names}]\n"
