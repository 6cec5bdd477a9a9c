"""Make ``data/schemas/*.schema.json``: what a vehicle and a mission file may hold, for editors that complete and check.

The names and texts come from the code that reads the files, so that both stay the same. Run
``python data/make_schemas.py`` to write them again.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

from glider_jax.config import PROGRAM_CONDITIONS, SURFACE_KINDS, Aborts
from glider_jax.readers.battery_packs import PACKS
from glider_jax.readers.device_catalogue import DEVICES, GROUPS, STATES
from glider_jax.readers.mission_programs import ACTION_NUMBERS
from glider_jax.readers.quantities import QUANTITIES, SECTIONS
from glider_jax.readers.toml_checks import SUFFIXES, UNITS

NUMBER = {"type": "number"}
TEXT = {"type": "string"}
SWITCH = {"type": "boolean"}
POSITION = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2, "description": "[latitude, longitude]"}


def quantity(name: str, unit: str, text: str, bare: str = "") -> dict[str, Any]:
    """Entries for one number under all keys that may give it."""
    said = f"{text}, {bare or unit}" if (bare or unit) != "1" else text
    number = {"anyOf": [NUMBER, {"$ref": "#/$defs/quantity"}], "description": said}
    entries = {name: number, f"{name}_sigma": {"type": "number", "minimum": 0.0}}
    entries |= {name + end: number for end, other in SUFFIXES.items() if UNITS[other][0] == unit}
    return entries


def table(properties: dict[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    """A table that holds these keys and no others."""
    made: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False}
    if required:
        made["required"] = list(required)
    return made


def many(item: dict[str, Any]) -> dict[str, Any]:
    """A list of such items."""
    return {"type": "array", "items": item}


def choice(names: Any) -> dict[str, Any]:
    """One of these texts."""
    return {"type": "string", "enum": list(names)}


def schema(title: str, properties: dict[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    """A whole file."""
    number = table(
        {"value": NUMBER, "sigma": {"type": "number", "minimum": 0.0}, "unit": TEXT, "source": TEXT}, ("value",)
    )
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, "$defs": {"quantity": number}}
    return head | table(properties, required)


def vehicle() -> dict[str, Any]:
    """Schema of a vehicle file."""
    sections: dict[str, dict[str, Any]] = {"vehicle": {"preset": TEXT, "name": TEXT}, "energy": {}, "perturbation": {}}
    line: dict[str, Any] = {"source": TEXT}
    for name, spec in QUANTITIES.items():
        group, *rest = name.split(".")
        into = line if len(rest) == 2 else sections[SECTIONS[group]]
        into |= quantity(rest[-1], spec.unit, spec.text, spec.file_unit)
    sections["energy"]["pump_dive_to_climb"] = table(line)
    sections["energy"] |= quantity("battery_capacity", "J", "energy of the full pack")
    sections["energy"]["open_circuit_voltage"] = table({"full": NUMBER, "empty": NUMBER}, ("full", "empty"))
    battery = {"pack": choice(PACKS), "name": TEXT, "chemistry": TEXT, "undervolts": NUMBER, "reserve_fraction": NUMBER}
    for name, unit, text in (
        ("capacity", "C", "rated charge"),
        ("energy", "J", "rated energy"),
        ("usable_fraction", "1", "share of the charge a plan may count on"),
        ("internal_resistance", "ohm", "internal resistance"),
        ("temperature_derating", "K-1", "share of capacity lost per kelvin below 15 degC"),
    ):
        battery |= quantity(name, unit, text)
    battery["voltage_curve"] = many({"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2})
    device = {"name": TEXT, "group": choice(GROUPS), "states": many(choice(STATES)), "duty": NUMBER}
    device |= {"sensor_types": many({"type": "integer"}), "minimum_depth": NUMBER, "maximum_depth": NUMBER}
    device |= quantity("power", "W", "power while it runs")
    device |= quantity("seconds_per_surfacing", "s", "how long it runs at each surfacing")
    device |= quantity("joules_per_inflection", "J", "energy of its action at each inflection")
    covariance = table({"names": many(TEXT), "matrix": many(many(NUMBER)), "source": TEXT}, ("names", "matrix"))
    parameter = {"anyOf": [NUMBER, {"$ref": "#/$defs/quantity"}]}
    speeds = {"file": TEXT, "distribution": TEXT, "kind": choice(("over_ground", "through_water")), "shoebox": NUMBER}
    return schema(
        "glider_jax vehicle",
        {name: table(content) for name, content in sections.items()}
        | {
            "battery": table(battery),
            "devices": many({"anyOf": [choice(DEVICES), table(device, ("name",))]}),
            "covariance": many(covariance),
            "terms": {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": parameter}},
            "speeds": table(speeds),
        },
    )


def mission() -> dict[str, Any]:
    """Schema of a mission file."""
    yo: dict[str, Any] = {"half_cycles": {"type": "integer", "minimum": 1}}
    for name, unit, text, bare in (
        ("dive_to", "m", "depth at which a dive turns", ""),
        ("climb_to", "m", "depth at which a climb turns", ""),
        ("altitude", "m", "height above the seafloor at which a dive turns, negative for none", ""),
        ("climb_altitude", "m", "height above the seafloor at which a climb turns, negative for none", ""),
        ("pitch", "rad", "magnitude of both pitches", "degrees"),
        ("dive_pitch", "rad", "magnitude of the pitch of a dive", "degrees"),
        ("climb_pitch", "rad", "magnitude of the pitch of a climb", "degrees"),
        ("dive_volume", "m3", "pumped volume of a dive", "cc"),
        ("climb_volume", "m3", "pumped volume of a climb", "cc"),
        ("overshoot", "m", "how far a turn runs past its depth", ""),
    ):
        yo |= quantity(name, unit, text, bare)
    time = {"anyOf": [NUMBER, TEXT], "description": "seconds since 1970, or a date and time (UTC if it names no zone)"}
    main = {
        "name": TEXT,
        "start": time,
        "start_position": POSITION,
        "first_waypoint_is_start": SWITCH,
        "waypoints": many(POSITION),
        "legs": {"type": "integer", "minimum": -2, "description": "-2 the list once, -1 for ever, or a count"},
        "first_waypoint": {"type": "integer", "minimum": -1, "description": "index flown to first, -1 for the closest"},
        "current_correction": SWITCH,
        "unsupported": many(TEXT),
        "notes": many(TEXT),
    }
    main |= quantity("waypoint_radius", "m", "distance at which a waypoint counts as reached")
    main |= quantity("surface_every", "s", "time from each dive to the climb that goes to the surface")
    main |= quantity("surface_stay", "s", "time at the surface")
    rule: dict[str, Any] = {"kind": choice(SURFACE_KINDS), "time": time, "count": {"type": "integer", "minimum": 0}}
    rule |= {"when_yo_ends": SWITCH, "ends_mission": SWITCH, "name": TEXT}
    rule |= quantity("seconds", "s", "interval") | quantity("distance", "m", "distance to the waypoint")
    rule |= quantity("climb_pitch", "rad", "magnitude of the pitch of the ascent", "degrees")
    sample = {"sensor_type": {"type": "integer", "minimum": 0}, "states": many(choice(STATES))}
    sample |= {"state_to_sample": {"type": "integer", "minimum": 0}, "every_nth_yo": {"type": "integer"}}
    sample |= {"minimum_depth": NUMBER, "maximum_depth": NUMBER} | quantity("interval", "s", "time between samples")
    units = {"overdepth": "m", "maximum_waypoint_distance": "m", "undervolts": "V", "remaining_charge": "1"}
    aborts: dict[str, Any] = {}
    for item in fields(Aborts):
        aborts |= quantity(item.name, units.get(item.name, "s"), item.name.replace("_", " "))
    when: dict[str, Any] = {}
    for kind, (quantity_name, unit, _) in PROGRAM_CONDITIONS.items():
        if quantity_name == "time":
            when[kind] = time
        elif quantity_name == "flying_to_waypoint":
            when[kind] = {"type": "integer", "minimum": 1, "description": "number of the waypoint flown to"}
        else:
            when |= quantity(kind, unit, kind.replace("_", " "))
    goto = {"anyOf": [POSITION, choice(("home", "next")), {"type": "integer", "minimum": 1}]}
    then: dict[str, Any] = {"goto": goto, "surface_now": SWITCH, "end_mission": SWITCH}
    for name, (unit, bare) in ACTION_NUMBERS.items():
        then |= quantity(name, unit, f"{name.replace('_', ' ')} while the rule is in force", bare or "")
    program = {"name": TEXT, "when": table(when), "then": table(then), "once": SWITCH}
    return schema(
        "glider_jax mission",
        {
            "mission": table(main | yo, ("waypoints",)),
            "yo": table(yo),
            "surface": many(table(rule, ("kind",))),
            "sample": many(table(sample, ("sensor_type",))),
            "aborts": table(aborts),
            "program": many(table(program, ("when", "then"))),
        },
        ("mission",),
    )


def schemas() -> dict[str, dict[str, Any]]:
    """Both schemas by name."""
    return {"vehicle": vehicle(), "mission": mission()}


if __name__ == "__main__":
    folder = Path(__file__).with_name("schemas")
    folder.mkdir(exist_ok=True)
    for kind, content in schemas().items():
        (folder / f"{kind}.schema.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
