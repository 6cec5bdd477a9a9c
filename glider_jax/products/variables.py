"""The variables of the forecast file, each declared once: name, dimensions, storage, attributes, values."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from glider_jax.errors import Outcome
from glider_jax.products.coordinates import wrap_longitude
from glider_jax.records import Array, Track

EPOCH = "seconds since 1970-01-01T00:00:00Z"
DEGREE_STEP = 1e-7
_PACKED_FILL = np.int32(-(2**31))
_SERIES = "time lat lon depth realization forecast_period forecast_reference_time"


@dataclass(frozen=True)
class Column:
    """One variable with a value per member.

    ``values`` takes the block and the index of its first member and gives the array to store; ``scale`` turns stored
    into physical numbers; ``repetitive`` marks series that deflate well, which are always deflated.
    """

    name: str
    dims: tuple[str, ...]
    dtype: str
    values: Callable[[Track, int], Array]
    attributes: dict[str, Any] = field(default_factory=dict)
    fill: Any = None
    scale: float = 1.0
    repetitive: bool = False


def columns(track: Track) -> tuple[Column, ...]:
    """Every per-member variable for tracks with these components, parameters and dimensions."""
    data = (*_series(track), *_events(track), *_rules(track), *_members(track))
    return (*_identity(), *_coordinates(), *(_modelled(column) for column in data))


def fixed_columns(track: Track) -> list[tuple[str, tuple[str, ...], str, Array, dict[str, Any]]]:
    """Variables without a member dimension: name, dimensions, type, values, attributes."""
    found = [
        (
            "forecast_reference_time",
            (),
            "f8",
            np.float64(track.time[0]),
            {
                "standard_name": "forecast_reference_time",
                "long_name": "start of the forecast",
                "units": EPOCH,
                "calendar": "standard",
            },
        ),
        (
            "forecast_period",
            ("obs",),
            "f8",
            track.time - track.time[0],
            {
                "standard_name": "forecast_period",
                "long_name": "time since the start of the forecast",
                "units": "s",
            },
        ),
    ]
    waypoints = track.waypoints if track.waypoints.shape[0] else np.full((1, 2), np.nan)
    for k, (stem, name) in enumerate((("latitude", "lat"), ("longitude", "lon"))):
        units = "degrees_north" if name == "lat" else "degrees_east"
        values = waypoints[:, k] if name == "lat" else wrap_longitude(waypoints[:, k])
        attributes = {"standard_name": stem, "long_name": f"{stem} of the waypoint", "units": units}
        found.append((f"waypoint_{name}", ("waypoint",), "f8", values, attributes))
    return found


def _modelled(column: Column) -> Column:
    """The same column, marked as a model result unless it is a coordinate of another variable."""
    if column.attributes.get("standard_name") in ("time", "latitude", "longitude"):
        return column
    return replace(column, attributes=column.attributes | {"coverage_content_type": "modelResult"})


def _identity() -> tuple[Column, ...]:
    def names(block: Track, first: int) -> Array:
        text = np.char.mod("member%06d", np.arange(first, first + block.n)).astype("S12")
        return text.view("S1").reshape(block.n, 12)

    def numbers(block: Track, first: int) -> Array:
        return np.arange(first, first + block.n, dtype=np.int32)

    return (
        Column("trajectory", ("name_strlen",), "S1", names,
               {"cf_role": "trajectory_id", "long_name": "name of the ensemble member"}, repetitive=True),
        Column("realization", (), "i4", numbers,
               {"standard_name": "realization", "long_name": "number of the ensemble member", "units": "1"}),
    )  # fmt: skip


def _pack(degrees: Array, axis: str) -> Array:
    """Degrees in steps of 1e-7 as int32; NaN becomes the fill value, longitudes are brought into [-180, 180)."""
    degrees = np.asarray(degrees, np.float64)
    if axis == "lon" and degrees.size and (np.nanmax(np.abs(degrees), initial=0.0) >= 180.0):
        degrees = wrap_longitude(degrees)
    packed = np.rint(degrees / DEGREE_STEP)
    np.copyto(packed, float(_PACKED_FILL), where=~np.isfinite(packed))
    return packed.astype(np.int32)


def _place(name: str, which: str, dims: tuple[str, ...], source: str, long_name: str, **extra: Any) -> Column:
    attributes = {
        "standard_name": "latitude" if which == "lat" else "longitude",
        "long_name": long_name,
        "units": "degrees_north" if which == "lat" else "degrees_east",
        "scale_factor": DEGREE_STEP,
    }
    return Column(
        name, dims, "i4", lambda block, first: _pack(getattr(block, source), which), attributes | extra,
        fill=_PACKED_FILL, scale=DEGREE_STEP,
    )  # fmt: skip


def _when(name: str, dims: tuple[str, ...], source: str, long_name: str, **extra: Any) -> Column:
    attributes = {"standard_name": "time", "long_name": long_name, "units": EPOCH, "calendar": "standard"}
    return Column(
        name, dims, "f8", lambda block, first: getattr(block, source), attributes | extra, fill=np.nan
    )  # fmt: skip


def _float(source: str, index: int | None = None) -> Callable[[Track, int], Array]:
    def values(block: Track, first: int) -> Array:
        data = getattr(block, source)
        return np.asarray(data if index is None else data[..., index], np.float32)

    return values


def _coordinates() -> tuple[Column, ...]:
    def times(block: Track, first: int) -> Array:
        return np.broadcast_to(block.time, (block.n, block.time.size))

    time = {
        "standard_name": "time",
        "long_name": "output time",
        "units": EPOCH,
        "calendar": "standard",
        "axis": "T",
    }
    depth = {
        "standard_name": "depth",
        "long_name": "depth of the glider",
        "units": "m",
        "positive": "down",
        "axis": "Z",
    }
    return (
        Column("time", ("obs",), "f8", times, time, repetitive=True),
        _place("lat", "lat", ("obs",), "latitude", "latitude of the glider", axis="Y"),
        _place("lon", "lon", ("obs",), "longitude", "longitude of the glider", axis="X"),
        Column("depth", ("obs",), "f4", _float("depth"), depth),
    )  # fmt: skip


def _flags(codes: range, meanings: list[str], dtype: Any) -> dict[str, Any]:
    return {"flag_values": np.array(list(codes), dtype), "flag_meanings": " ".join(meanings)}


def _words(text: str) -> str:
    """A flag meaning: letters, digits and underscores only."""
    return re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_") or "unnamed"


def _series(track: Track) -> tuple[Column, ...]:
    at = {"coordinates": _SERIES}
    plain = (
        ("battery_charge_used", "charge_used", "A h", "charge drawn from the battery since the start", 3600.0),
        ("battery_relative_charge", "state_of_charge", "percent", "usable charge left in the battery", 0.01),
        ("battery_voltage", "voltage", "V", "terminal voltage of the battery under steady load", 1.0),
        ("distance_through_water", "distance_through_water", "m", "distance flown through water since the start", 1.0),
        ("distance_over_ground", "distance_over_ground", "m", "distance made over ground since the start", 1.0),
    )  # fmt: skip
    found = [
        Column("phase", ("obs",), "i1", lambda b, first: np.asarray(b.phase, np.int8),
               {"long_name": "phase of the flight", **_flags(range(4), ["unknown", "ascent", "descent", "surface"],
                                                               np.int8)} | at, repetitive=True),
        Column("active", ("obs",), "i1", lambda b, first: np.asarray(b.active, np.int8),
               {"long_name": "whether the member is still under way",
                **_flags(range(2), ["ended", "under_way"], np.int8)} | at, repetitive=True),
        Column("inflections", ("obs",), "i4", lambda b, first: np.asarray(b.inflections, np.int32),
               {"long_name": "turns from dive to climb and back since the start", "units": "1"} | at),
    ]  # fmt: skip
    for axis, source in (("eastward", "current_east"), ("northward", "current_north")):
        attributes = {
            "standard_name": f"{axis}_sea_water_velocity",
            "long_name": f"{axis} water velocity last felt by the glider",
            "units": "m s-1",
        }
        name = f"{axis}_sea_water_velocity"
        found.append(Column(name, ("obs",), "f4", _float(source), attributes | at, fill=np.float32(np.nan)))
    for name, source, units, long_name, unit in plain:
        attributes = {"long_name": long_name, "units": units} | at
        found.append(Column(name, ("obs",), "f4", _scaled(source, unit), attributes))
    for k, component in enumerate(track.components):
        attributes = {"long_name": f"energy drawn for {component} since the start", "units": "J"} | at
        found.append(Column(f"energy_{_words(component)}", ("obs",), "f4", _float("energy", k), attributes))
    return tuple(found)


def _scaled(source: str, unit: float) -> Callable[[Track, int], Array]:
    return lambda block, first: np.asarray(getattr(block, source), np.float32) * np.float32(1.0 / unit)


def _events(track: Track) -> tuple[Column, ...]:
    dims = ("surfacing",)
    up = {"coordinates": "surfacing_time surfacing_lat surfacing_lon realization"}
    reasons = [_words(reason) for reason in track.reasons] or ["unnamed"]
    reason = {"long_name": "why the glider surfaced", **_flags(range(len(reasons)), reasons, np.int8)} | up
    arrival = {"coordinates": "waypoint_lat waypoint_lon realization"}

    def reason_codes(block: Track, first: int) -> Array:
        return np.asarray(block.surfacing_reason, np.int8)

    def arrivals(block: Track, first: int) -> Array:
        return block.waypoint_time if block.waypoint_time.shape[1] else np.full((block.n, 1), np.nan)

    return (
        _when("surfacing_time", dims, "surfacing_time", "time at which the glider broke the surface"),
        _place("surfacing_lat", "lat", dims, "surfacing_latitude", "latitude at which the glider broke the surface"),
        _place("surfacing_lon", "lon", dims, "surfacing_longitude", "longitude at which the glider broke the surface"),
        _when("dive_time", dims, "dive_time", "time at which the glider left the surface"),
        _place("dive_lat", "lat", dims, "dive_latitude", "latitude at which the glider left the surface"),
        _place("dive_lon", "lon", dims, "dive_longitude", "longitude at which the glider left the surface"),
        Column("surfacing_reason", dims, "i1", reason_codes, reason, fill=np.int8(-1), repetitive=True),
        Column("waypoint_arrival_time", ("waypoint",), "f8", arrivals,
               {"standard_name": "time", "long_name": "time at which the waypoint was reached", "units": EPOCH,
                "calendar": "standard"} | arrival, fill=np.nan),
    )  # fmt: skip


def _rules(track: Track) -> tuple[Column, ...]:
    """When the rules of a mission's program came into force; nothing without one."""
    if not track.program:
        return ()
    at = {"coordinates": "realization", "rules": "; ".join(track.program)}
    first = {
        "standard_name": "time",
        "long_name": "time at which the rule of the program first came into force",
        "units": EPOCH,
        "calendar": "standard",
    }
    return (
        Column("program_time", ("rule",), "f8", lambda b, start: b.program_time, first | at, fill=np.nan),
        Column("program_count", ("rule",), "i4", lambda b, start: np.asarray(b.program_count, np.int32),
               {"long_name": "how often the rule of the program came into force", "units": "1"} | at),
    )  # fmt: skip


def _members(track: Track) -> tuple[Column, ...]:
    at = {"coordinates": "realization"}
    codes = {
        "long_name": "how the forecast of the member ended",
        "flag_values": np.array([int(code) for code in Outcome], np.int32),
        "flag_meanings": " ".join(code.name.lower() for code in Outcome),
        "flag_sentences": "; ".join(f"{int(code)}: {code.sentence}" for code in Outcome),
    } | at
    found = [
        Column("outcome", (), "i4", lambda b, first: np.asarray(b.outcome, np.int32), codes),
        _when("outcome_time", (), "outcome_time", "time at which the member ended"),
        _place("outcome_lat", "lat", (), "outcome_latitude", "latitude at which the member ended"),
        _place("outcome_lon", "lon", (), "outcome_longitude", "longitude at which the member ended"),
        Column("bottom_contacts", (), "i4", lambda b, first: np.asarray(b.bottom_contacts, np.int32),
               {"long_name": "dives that the sea floor stopped", "units": "1"} | at),
        Column("usable_energy", (), "f4", _float("usable_energy"),
               {"long_name": "usable energy of the battery drawn for the member", "units": "J"} | at),
    ]  # fmt: skip
    units = track.settings.get("parameter_units") or {}
    for name in track.parameters:
        attributes = {"long_name": f"perturbed input {name}, SI units", "parameter": name} | at
        if name in units:
            attributes["units"] = str(units[name])
        found.append(Column(f"parameter_{_words(name)}", (), "f8", _parameter(name), attributes, fill=np.nan))
    return tuple(found)


def _parameter(name: str) -> Callable[[Track, int], Array]:
    return lambda block, first: np.asarray(block.parameters[name], np.float64)
