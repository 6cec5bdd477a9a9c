"""Devices that a vehicle file can pick by name, each with a sourced power and a rule for when it runs.

Standard library only. Powers measured on the glider comet are differences of total current times 14 V. ``judgement``
marks what nobody measured; a vehicle file overrides any of it.
"""

from __future__ import annotations

from glider_jax.config import Device, Quantity

_PAPER = "Woithe and Kremer (2010)"
_COMET = "comet recordings, 2016 and 2019"
_UNDER = frozenset({"dive", "climb", "hover"})
_ALL = frozenset({"dive", "climb", "hover", "surface"})
_SURFACE = frozenset({"surface"})


def _watts(value: float, sigma: float, source: str) -> Quantity:
    return Quantity(value, sigma, "W", source)


_DEVICES = (
    Device(
        "ctd", "science", _watts(0.5, 0.2, f"{_COMET}: +0.065 A is 0.9 W at most; literature 0.2 to 1.2 W pumped"),
        states=_UNDER, sensor_types=(0, 1),
    ),
    Device(
        "fluorometer", "science", _watts(0.6, 0.3, f"judgement; {_COMET}: sensor step of 0.065 A is 0.9 W"),
        states=_UNDER, sensor_types=(0, 19, 48),
    ),
    Device("oxygen", "science", _watts(0.15, 0.05, "judgement: optode"), states=_UNDER, sensor_types=(0, 54)),
    Device(
        "dvl", "science", _watts(2.9, 0.7, f"{_COMET}: sensor step of 0.21 A at 14 V; dives only"),
        states=frozenset({"dive"}),
    ),
    Device("adcp", "science", _watts(1.5, 0.7, "judgement"), states=_UNDER, sensor_types=(0, 64)),
    Device(
        "science_computer_stock", "instrument",
        _watts(0.19, 0.01, f"{_PAPER}, Table I: stock software at 3.68 MHz; sigma judgement"), states=_ALL,
    ),
    Device(
        "science_computer_deployed", "instrument",
        _watts(0.71, 0.02, f"{_PAPER}, Table I: deployed software at 14.72 MHz; sigma judgement"), states=_ALL,
    ),
    Device(
        "science_computer_development_3mhz", "instrument",
        _watts(0.35, 0.02, f"{_PAPER}, Table I: development software at 3.68 MHz; sigma judgement"), states=_ALL,
    ),
    Device(
        "science_computer_development_7mhz", "instrument",
        _watts(0.49, 0.02, f"{_PAPER}, Table I: development software at 7.36 MHz; sigma judgement"), states=_ALL,
    ),
    Device(
        "measurement_board_8", "instrument",
        _watts(0.76, 0.02, f"{_PAPER}, Table II: deployed, eight sensors; sigma judgement"), states=_ALL,
    ),
    Device(
        "measurement_board_6", "instrument",
        _watts(0.58, 0.02, f"{_PAPER}, Table II: development, six sensors; sigma judgement"), states=_ALL,
    ),
    Device(
        "pitch_servo", "steering", _watts(0.0, 0.0, "all its energy is per inflection"), states=frozenset(),
        joules_per_inflection=30.0,
    ),
    Device(
        "fin_servo", "steering", _watts(0.05, 0.05, f"{_COMET}: not resolvable, below 0.15 W"), states=_UNDER,
    ),
    Device(
        "altimeter", "navigation", _watts(0.4, 0.3, f"judgement; {_COMET}: at most 0.10 A while on"),
        states=frozenset({"dive"}),
    ),
    Device(
        "gps", "navigation", _watts(1.4, 0.5, f"{_COMET}: 0.23 A idle at the surface against a floor of 0.10 to 0.15 A"),
        states=_SURFACE,
    ),
    Device(
        "iridium", "communication", _watts(3.7, 1.3, f"{_COMET}: on call 0.40 to 0.59 A against 0.22 to 0.24 A"),
        states=_SURFACE, seconds_per_surfacing=300.0,
    ),
    Device(
        "argos", "communication", _watts(0.1, 0.05, "judgement: short bursts"), states=_SURFACE,
    ),
    Device(
        "air_pump", "communication", _watts(1.0, 0.3, f"{_COMET}: at most 0.1 A for 150 to 200 s"),
        states=_SURFACE, seconds_per_surfacing=175.0,
    ),
    Device(
        "acoustic_modem", "communication", _watts(0.3, 0.2, "judgement: mostly listening"), states=_UNDER,
    ),
    Device(
        "thruster", "propulsion", _watts(5.0, 2.0, "commanded powers 1 to 9 W; sigma judgement"),
        states=frozenset({"dive", "climb"}),
    ),
)  # fmt: skip

DEVICES: dict[str, Device] = {device.name: device for device in _DEVICES}
