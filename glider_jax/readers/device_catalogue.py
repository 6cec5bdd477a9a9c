"""Devices that a vehicle file can pick by name, each with a sourced power and a rule for when it runs.

Powers measured on the glider comet are differences of total current times 14 V. ``judgement``
marks what nobody measured; a vehicle file overrides any of it.
"""

from __future__ import annotations

from glider_jax.config import Device, Quantity
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.readers.toml_checks import Given, Table

GROUPS = ("hotel", "science", "steering", "navigation", "communication", "instrument", "propulsion")
STATES = ("dive", "climb", "hover", "surface")

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
        "gps", "navigation", _watts(1.4, 0.5, f"{_COMET}: 0.23 A idle at the surface, floor 0.10 to 0.15 A"),
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


def read_devices(top: Table, base: tuple[Device, ...]) -> tuple[Device, ...]:
    """Devices of a vehicle file: names of the catalogue, tables, or both; ``base`` where it names none."""
    raw = top.raw("devices")
    if raw is None:
        return base
    if not isinstance(raw, list):
        raise top.wrong("devices", "a list of device names, or tables [[devices]]")
    devices: dict[str, Device] = {}
    for index, item in enumerate(raw, 1):
        if isinstance(item, str):
            device = _catalogued(item, f"{top.file}: devices {index}")
        elif isinstance(item, dict):
            device = _device(Table(item, top.file, f"[[devices]] {index}"))
        else:
            raise ConfigError(f"{top.file}: devices {index}: expected a name or a table, found {item!r}. Correct it.")
        if device.name in devices:
            raise ConfigError(f"{top.file}: devices {index}: '{device.name}' stands twice. Keep one of them.")
        devices[device.name] = device
    return tuple(devices.values())


def _catalogued(name: str, where: str) -> Device:
    if name not in DEVICES:
        hint = did_you_mean(name, DEVICES) or f" Known: {', '.join(DEVICES)}."
        raise ConfigError(f"{where}: unknown device '{name}'.{hint}")
    return DEVICES[name]


def _device(table: Table) -> Device:
    name = table.text("name")
    if not name:
        raise ConfigError(f'{table.where("name")}: expected the device\'s name, found none. Add name = "...".')
    start = DEVICES.get(name)
    power = table.quantity("power", "W")
    if power is None and start is None:
        raise ConfigError(
            f"{table.where('power')}: expected the power of '{name}', found none. "
            f"Add power = {{ value, sigma }}.{did_you_mean(name, DEVICES)}"
        )
    if power is not None and not 0.0 <= power.value <= 1000.0:
        raise table.wrong("power", "0 to 1000 W")
    default = start or Device(name, "hotel", Quantity(0.0))
    group = table.text("group", default.group) or default.group
    if group not in GROUPS:
        raise table.wrong("group", f"one of {', '.join(GROUPS)}")
    states = table.texts("states")
    if states is not None and not set(states) <= set(STATES):
        raise table.wrong("states", f"a list out of {', '.join(STATES)}")
    types = table.raw("sensor_types")
    if types is not None and (
        not isinstance(types, list) or not all(isinstance(t, int) and not isinstance(t, bool) for t in types)
    ):
        raise table.wrong("sensor_types", "a list of whole numbers")
    action = table.quantity("joules_per_inflection", "J")
    stay = table.quantity("seconds_per_surfacing", "s")
    low = table.number("minimum_depth", default.minimum_depth, unit="m")
    high = table.number("maximum_depth", None, unit="m")
    device = Device(
        name=name,
        group=group,
        power=default.power if power is None else quantity_of(power, table.file),
        states=default.states if states is None else frozenset(states),
        duty=table.number("duty", default.duty, 0.0, 1.0) or 0.0,
        seconds_per_surfacing=default.seconds_per_surfacing if stay is None else stay.value,
        joules_per_inflection=default.joules_per_inflection if action is None else action.value,
        sensor_types=default.sensor_types if types is None else tuple(types),
        minimum_depth=low or 0.0,
        maximum_depth=default.maximum_depth if high is None else high,
    )
    if device.minimum_depth > device.maximum_depth:
        raise table.wrong("minimum_depth", f"at most maximum_depth, {device.maximum_depth:g} m")
    if device.joules_per_inflection < 0.0 or (device.seconds_per_surfacing or 0.0) < 0.0:
        raise ConfigError(f"{table.where()}: expected energies and times of at least 0, found less. Correct them.")
    table.close()
    return device


def quantity_of(number: Given, file: str) -> Quantity:
    """A quantity from a number in a file; no sigma given means exact, no source given means the file."""
    return Quantity(number.value, number.sigma or 0.0, number.unit, number.source or file)
