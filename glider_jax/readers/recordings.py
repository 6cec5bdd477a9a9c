"""Glider recordings of any kind we know, as one :class:`~glider_jax.records.Recording` with its repairs
counted.

Kinds: native Slocum binaries (through the optional extra ``dbd``) and their ASCII form, netCDF of native
sensors, pyglider time series, OG1.0, IOOS NGDAC profiles. Slocum sensor names appear in this module and in
the file readers it calls, nowhere else. Conventions a newcomer would get wrong: ``heading`` is kept as
recorded, magnetic on a Slocum (``attributes["heading_reference"]``); ``water_vx`` and its kin are in the
glider's local frame, whose y axis points to magnetic north; flight and science computers have clocks of their
own, so a row seldom holds both.

Sensors without a name of ours stay in ``channels`` under their native names as raw float64.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider_jax.errors import DataError, did_you_mean
from glider_jax.readers import repairs as mend
from glider_jax.readers.glider_netcdf import read_netcdf
from glider_jax.readers.repairs import Table, Tally
from glider_jax.readers.slocum_ascii import read_ascii
from glider_jax.readers.slocum_binary import BINARY_SUFFIXES, read_binary
from glider_jax.records import Array, Recording, Source


class Channel(NamedTuple):
    """One quantity: SI unit, native Slocum sensors in order of preference, their unit, and the plausible
    range.

    ``low`` and ``high`` are in the SI unit; values outside become NaN and are counted.
    """

    unit: str
    native: tuple[str, ...]
    native_unit: str
    low: float
    high: float
    text: str


#: file unit (lower case) -> (SI unit, factor, offset).
UNITS: dict[str, tuple[str, float, float]] = {
    "m": ("m", 1.0, 0.0),
    "meters": ("m", 1.0, 0.0),
    "metres": ("m", 1.0, 0.0),
    "in": ("m", 0.0254, 0.0),
    "km": ("m", 1e3, 0.0),
    "bar": ("Pa", 1e5, 0.0),
    "dbar": ("Pa", 1e4, 0.0),
    "decibar": ("Pa", 1e4, 0.0),
    "pa": ("Pa", 1.0, 0.0),
    "inhg": ("Pa", 3386.389, 0.0),
    "cc": ("m3", 1e-6, 0.0),
    "cm3": ("m3", 1e-6, 0.0),
    "m3": ("m3", 1.0, 0.0),
    "rad": ("rad", 1.0, 0.0),
    "radian": ("rad", 1.0, 0.0),
    "radians": ("rad", 1.0, 0.0),
    "degree": ("rad", np.pi / 180.0, 0.0),
    "degrees": ("rad", np.pi / 180.0, 0.0),
    "deg": ("rad", np.pi / 180.0, 0.0),
    "angular_degree": ("rad", np.pi / 180.0, 0.0),
    "lat": ("deg", 1.0, 0.0),
    "lon": ("deg", 1.0, 0.0),
    "m/s": ("m s-1", 1.0, 0.0),
    "m s-1": ("m s-1", 1.0, 0.0),
    "m.s-1": ("m s-1", 1.0, 0.0),
    "meters/second": ("m s-1", 1.0, 0.0),
    "cm/s": ("m s-1", 0.01, 0.0),
    "cm s-1": ("m s-1", 0.01, 0.0),
    "v": ("V", 1.0, 0.0),
    "volt": ("V", 1.0, 0.0),
    "volts": ("V", 1.0, 0.0),
    "amp": ("A", 1.0, 0.0),
    "amps": ("A", 1.0, 0.0),
    "a": ("A", 1.0, 0.0),
    "amp-hrs": ("C", 3600.0, 0.0),
    "amp-hr": ("C", 3600.0, 0.0),
    "a h": ("C", 3600.0, 0.0),
    "ah": ("C", 3600.0, 0.0),
    "watt": ("W", 1.0, 0.0),
    "watts": ("W", 1.0, 0.0),
    "joules": ("J", 1.0, 0.0),
    "%": ("1", 0.01, 0.0),
    "percent": ("1", 0.01, 0.0),
    "c": ("K", 1.0, 273.15),
    "degc": ("K", 1.0, 273.15),
    "deg_c": ("K", 1.0, 273.15),
    "celsius": ("K", 1.0, 273.15),
    "degree_celsius": ("K", 1.0, 273.15),
    "degrees_celsius": ("K", 1.0, 273.15),
    "k": ("K", 1.0, 0.0),
    "s/m": ("S m-1", 1.0, 0.0),
    "s m-1": ("S m-1", 1.0, 0.0),
    "s.m-1": ("S m-1", 1.0, 0.0),
    "ms/cm": ("S m-1", 0.1, 0.0),
    "ms cm-1": ("S m-1", 0.1, 0.0),
    "kg m-3": ("kg m-3", 1.0, 0.0),
    "kg/m3": ("kg m-3", 1.0, 0.0),
    "kg/m^3": ("kg m-3", 1.0, 0.0),
    "timestamp": ("s", 1.0, 0.0),
    "s": ("s", 1.0, 0.0),
    "sec": ("s", 1.0, 0.0),
    "days": ("s", 86400.0, 0.0),
    "nodim": ("1", 1.0, 0.0),
    "enum": ("1", 1.0, 0.0),
    "bool": ("1", 1.0, 0.0),
    "1": ("1", 1.0, 0.0),
}

_PI = float(np.pi) + 1e-3
_WATER = (-3.0, 3.0)


def _channel(unit: str, native: str, native_unit: str, low: float, high: float, text: str) -> Channel:
    return Channel(unit, tuple(native.split()), native_unit, low, high, text)


def _flag(native: str, text: str) -> Channel:
    return Channel("1", tuple(native.split()), "bool", -1.0, 1.0, text)


#: Our name -> what it is. See :class:`Channel`.
CHANNELS: dict[str, Channel] = {
    "latitude": _channel("deg", "m_lat", "lat", -90, 90, "dead-reckoned latitude"),
    "longitude": _channel("deg", "m_lon", "lon", -180, 360, "dead-reckoned longitude"),
    "gps_latitude": _channel("deg", "m_gps_lat", "lat", -90, 90, "latitude of a GPS fix"),
    "gps_longitude": _channel("deg", "m_gps_lon", "lon", -180, 360, "longitude of a GPS fix"),
    "waypoint_latitude": _channel("deg", "c_wpt_lat", "lat", -90, 90, "latitude of the waypoint flown to"),
    "waypoint_longitude": _channel("deg", "c_wpt_lon", "lon", -180, 360, "longitude of the waypoint flown to"),
    "last_waypoint_latitude": _channel("deg", "x_last_wpt_lat", "lat", -90, 90, "latitude of the last waypoint"),
    "last_waypoint_longitude": _channel("deg", "x_last_wpt_lon", "lon", -180, 360, "its longitude"),
    "depth": _channel("m", "m_depth", "m", -20, 6500, "depth, positive down"),
    "pressure": _channel("Pa", "m_pressure m_water_pressure", "bar", -2e5, 6.6e7, "vehicle's sea pressure"),
    "depth_rate": _channel("m s-1", "m_depth_rate", "m/s", -5, 5, "rate of depth, positive down"),
    "altitude": _channel("m", "m_altitude", "m", 0.01, 1000, "height above the bottom, altimeter, filtered"),
    "raw_altitude": _channel("m", "m_raw_altitude", "m", 0.01, 1000, "height above the bottom, altimeter, raw"),
    "water_depth": _channel("m", "m_water_depth", "m", 0.01, 11000, "depth plus altitude"),
    "pitch": _channel("rad", "m_pitch", "rad", -1.6, 1.6, "pitch, nose up"),
    "commanded_pitch": _channel("rad", "c_pitch", "rad", -1.6, 1.6, "commanded pitch, nose up"),
    "roll": _channel("rad", "m_roll", "rad", -_PI, _PI, "roll, starboard down"),
    "heading": _channel("rad", "m_heading", "rad", -_PI, 2 * _PI, "heading as recorded, clockwise"),
    "commanded_heading": _channel("rad", "c_heading", "rad", -_PI, 2 * _PI, "heading steered for"),
    "fin": _channel("rad", "m_fin", "rad", -_PI, _PI, "rudder angle"),
    "commanded_fin": _channel("rad", "c_fin", "rad", -_PI, _PI, "commanded rudder angle"),
    "battery_position": _channel("m", "m_battpos", "in", -0.2, 0.2, "pitch battery, forward"),
    "commanded_battery_position": _channel("m", "c_battpos", "in", -30, 30, "commanded pitch battery"),
    "speed_through_water": _channel("m s-1", "m_speed", "m/s", -5, 5, "firmware's horizontal speed"),
    "measured_speed": _channel(
        "m s-1", "measured_speed_through_water", "m/s", 0, 3, "along the path, by an instrument, not by the firmware"
    ),
    "average_speed": _channel("m s-1", "m_avg_speed", "m/s", -5, 5, "firmware's running mean of speed"),
    "angle_of_attack": _channel("rad", "u_angle_of_attack", "rad", -0.6, 0.6, "firmware's, added to pitch"),
    "pumped_volume": _channel("m3", "m_de_oil_vol m_ballast_pumped", "cc", -3e-3, 3e-3, "pump, from neutral"),
    "commanded_pumped_volume": _channel("m3", "c_de_oil_vol c_ballast_pumped", "cc", -3e-3, 3e-3, "its command"),
    "pump_moving": _flag("m_is_de_pump_moving m_is_ballast_pump_moving", "the buoyancy pump runs"),
    "pump_energy": _channel("J", "m_ballast_pumped_energy", "joules", 0, 1e6, "firmware's energy per stroke"),
    "battery_voltage": _channel("V", "m_battery m_battery_inst", "volts", 5, 60, "battery, filtered"),
    "battery_voltage_instant": _channel("V", "m_battery_inst", "volts", 5, 60, "battery, instantaneous"),
    "current": _channel("A", "m_coulomb_current", "amp", -10, 100, "current drawn"),
    "charge_used": _channel(
        "C", "m_coulomb_amphr_total m_coulomb_amphr", "amp-hrs", -1e5, 1e8, "charge drawn since last zeroed"
    ),
    "battery_capacity": _channel("C", "f_coulomb_battery_capacity", "amp-hrs", 1, 1e8, "as the pilot entered it"),
    "relative_charge": _channel("1", "m_lithium_battery_relative_charge", "%", -1, 1.5, "share of charge left"),
    "vacuum": _channel("Pa", "m_vacuum", "inHg", -1e4, 1.2e5, "below outside pressure"),
    "vehicle_temperature": _channel("K", "m_veh_temp", "c", 253, 343, "inside the hull"),
    "water_vx": _channel("m s-1", "m_water_vx", "m/s", *_WATER, "water velocity in use, local x axis"),
    "water_vy": _channel("m s-1", "m_water_vy", "m/s", *_WATER, "along the local y axis: magnetic north"),
    "initial_water_vx": _channel("m s-1", "m_initial_water_vx", "m/s", *_WATER, "estimate at the first fix"),
    "initial_water_vy": _channel("m s-1", "m_initial_water_vy", "m/s", *_WATER, "estimate at the first fix"),
    "final_water_vx": _channel("m s-1", "m_final_water_vx", "m/s", *_WATER, "estimate after surface drift"),
    "final_water_vy": _channel("m s-1", "m_final_water_vy", "m/s", *_WATER, "estimate after surface drift"),
    "surface_water_vx": _channel("m s-1", "m_surf_water_vx", "m/s", *_WATER, "surface drift, local x axis"),
    "surface_water_vy": _channel("m s-1", "m_surf_water_vy", "m/s", *_WATER, "surface drift, local y axis"),
    "depth_averaged_current_east": _channel("m s-1", "", "m/s", *_WATER, "as a product gives it, true east"),
    "depth_averaged_current_north": _channel("m s-1", "", "m/s", *_WATER, "as a product gives it, true north"),
    "magnetic_variation": _channel("rad", "m_gps_mag_var", "rad", -_PI, _PI, "magnetic = true + this; west +"),
    "current_correction": _channel("1", "u_use_current_correction", "nodim", 0, 5, "0 off, 1 steers for it"),
    "temperature": _channel("K", "sci_water_temp m_water_temp", "degc", 268, 320, "in-situ temperature"),
    "conductivity": _channel("S m-1", "sci_water_cond m_water_cond", "s/m", -0.1, 9, "conductivity"),
    "water_density": _channel("kg m-3", "", "kg m-3", 950, 1100, "in-situ density, where a file gives it itself"),
    "ctd_pressure": _channel("Pa", "sci_water_pressure", "bar", -2e5, 6.6e7, "CTD's sea pressure"),
    "ctd_time": _channel("s", "sci_ctd41cp_timestamp sci_rbrctd_timestamp", "timestamp", 0, 4.2e9, "of the CTD"),
    "inflections": _channel("1", "m_tot_num_inflections", "nodim", 0, 1e9, "count over the vehicle's life"),
    "inflecting": _flag("x_inflecting", "in the middle of an inflection"),
    "at_surface": _flag("m_appear_to_be_at_surface x_surfaced", "the vehicle believes it is at the surface"),
    "gps_status": _channel("1", "m_gps_status", "enum", 0, 255, "0 is a good fix"),
    "gps_full_status": _channel("1", "m_gps_full_status", "enum", 0, 255, "0 is a good fix"),
    "gps_uncertainty": _channel("1", "m_gps_uncertainty", "nodim", 0, 1e4, "dilution of precision"),
    "gps_satellites": _channel("1", "m_gps_num_satellites", "nodim", 0, 100, "satellites in use"),
    "gps_on": _flag("m_gps_on", "GPS powered"),
    "iridium_on": _flag("m_iridium_on", "Iridium powered"),
    "iridium_connected": _flag("m_iridium_connected", "Iridium call up"),
    "argos_on": _flag("m_argos_on", "Argos powered"),
    "air_pump": _flag("m_air_pump", "air pump runs"),
    "science_on": _flag("m_science_on", "science computer powered"),
    "thruster_current": _channel("A", "m_thruster_current", "amp", -1, 100, "thruster"),
    "thruster_power": _channel("W", "m_thruster_power", "watts", -1, 1000, "thruster"),
    "phase": _channel("1", "", "enum", 0, 7, "OG1 flags of the producer: 1 ascent, 2 descent, 3 surface"),
}
POSITIONS = (
    ("latitude", "longitude"),
    ("gps_latitude", "gps_longitude"),
    ("waypoint_latitude", "waypoint_longitude"),
    ("last_waypoint_latitude", "last_waypoint_longitude"),
)
VELOCITIES = (
    ("water_vx", "water_vy"),
    ("initial_water_vx", "initial_water_vy"),
    ("final_water_vx", "final_water_vy"),
    ("surface_water_vx", "surface_water_vy"),
)
#: Without these a forecast or a fit has to assume something: reported as missing when absent.
WANTED = (
    "gps_latitude gps_longitude depth pitch heading pumped_volume charge_used battery_voltage current "
    "magnetic_variation water_vx temperature conductivity"
).split()
SUFFIXES = (".nc", ".dat", ".dba", ".asc", *BINARY_SUFFIXES)


def read_recording(
    paths: Path | str | Sequence[Path | str], *, cache: Path | str | None = None, name: str | None = None
) -> Recording:
    """Read one glider's recording from files or folders of any known kind.

    Parameters
    ----------
    paths : files, or folders whose recordings of known suffix are all read (not the folders inside).
    cache : folder of Slocum sensor lists (``.cac``, ``.ccc``); without it the folder of each file, its
        sisters called ``cac`` or ``cache`` and the same one level up are searched.
    name : of the recording; the folder's or first file's otherwise.

    Returns
    -------
    Strictly ascending times, channels under our names in SI (:data:`CHANNELS`) plus native ones, every repair
    counted. Damaged or undecodable files are named in ``repairs`` and the rest is kept.

    Raises
    ------
    DataError : nothing is there, a file is of no known kind, or no row can be used.
    """
    given = [Path(paths)] if isinstance(paths, str | Path) else [Path(p) for p in paths]
    files, skipped = expand(given)
    tally = Tally()
    notes = list(skipped)
    tables: list[Table] = []
    binaries = [f for f in files if f.suffix.lower() in BINARY_SUFFIXES]
    for path in files:
        if path.suffix.lower() == ".nc":
            tables += read_netcdf(path, CHANNELS)
        elif path not in binaries:
            tables += read_ascii(path, tally)
    if binaries:
        tables += read_binary(binaries, Path(cache) if cache is not None else None, wanted_sensors(), tally)
    where = str(given[0]) if len(given) == 1 else f"{given[0]} and {len(given) - 1} more"
    tables = [mend.mend_clock(t, tally) for t in tables]
    tables = sorted((t for t in tables if t.time.size), key=lambda t: (t.stream == "science", t.time[0]))
    if not tables:
        raise DataError(f"{where}: expected rows with times, found none.{_why(tally)} Give other files.")
    _one_glider(tables, where)
    return _assemble(tables, tally, notes, name or _name(given[0]), files)


def wanted_sensors() -> tuple[str, ...]:
    """Native sensors that have a name of ours."""
    return tuple(n for c in CHANNELS.values() for n in c.native)


def expand(given: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """The recording files among paths and folders, in natural order, and a note on what a folder holds
    besides.

    Raises
    ------
    DataError : a path does not exist, has an unknown suffix, or a folder holds no recording.
    """
    files: list[Path] = []
    notes = []
    for path in given:
        if path.is_dir():
            inside = sorted((p for p in path.iterdir() if p.is_file()), key=natural_order)
            found = [p for p in inside if p.suffix.lower() in SUFFIXES]
            if not found:
                raise DataError(
                    f"{path}: expected a folder with recordings ({', '.join(SUFFIXES)}), found none. "
                    "Give the folder that holds the files themselves."
                )
            if len(found) < len(inside):
                notes.append(f"{path.name}: {len(inside) - len(found)} files of other kinds were not read.")
            files += found
        elif not path.exists():
            near = did_you_mean(path.name, [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else [])
            raise DataError(f"{path}: expected a recording, found no such file.{near} Check the path.")
        elif path.suffix.lower() not in SUFFIXES:
            raise DataError(
                f"{path}: expected a recording ({', '.join(SUFFIXES)}), found the suffix '{path.suffix}'. "
                "Give Slocum binaries, their ASCII form, or netCDF."
            )
        else:
            files.append(path)
    return files, notes


def natural_order(path: Path) -> list[tuple[int, int, str]]:
    """Sort key under which segment 2 comes before segment 10."""
    parts = re.findall(r"\d+|\D+", path.name.lower())
    return [(0, int(p), "") if p.isdigit() else (1, 0, p) for p in parts]


def _one_glider(tables: list[Table], where: str) -> None:
    """Refuse files of several gliders, which their full names (glider-year-day-mission-segment) give away."""
    names = (re.match(r"(.+?)-\d{4}-\d{1,3}-\d+-\d+", s) for t in tables for s in t.segments)
    gliders = sorted({found[1].lower() for found in names if found})
    if len(gliders) > 1:
        raise DataError(
            f"{where}: expected the files of one glider, found those of {', '.join(gliders)}. Give one at a time."
        )


def _name(path: Path) -> str:
    stem = path.stem if path.is_file() else path.name
    return path.resolve().parent.name if stem in ("orig", "recording", "") else stem


def _why(tally: Tally) -> str:
    reasons = "; ".join(f"{kind}: {tally.examples.get(kind, '')}" for kind in tally.counts)
    return f" ({reasons})" if reasons else ""


def _assemble(tables: list[Table], tally: Tally, notes: list[str], name: str, files: list[Path]) -> Recording:
    """Convert, merge and mend repaired tables into a recording."""
    nmea, sentence = _position_format(tables)
    if sentence:
        notes.append(sentence + ".")
    columns = _to_channels(tables, nmea, tally)
    time, channels = mend.merge(tables, columns, tally)
    for key, spec in CHANNELS.items():
        if key in channels:
            values = mend.blank_sentinels(channels[key], key, tally)
            outside = (values < spec.low) | (values > spec.high)
            kind = f"values outside {spec.low:g} to {spec.high:g} {spec.unit}: {key}"
            channels[key] = mend.blank(values, outside, kind, "", tally)
    mend.blank_default_science(channels, tally)
    for first, second in VELOCITIES:
        mend.mend_pair(channels, first, second, "water velocities of exactly zero (no estimate)", tally)
    for first, second in POSITIONS:
        if first != "gps_latitude":
            mend.mend_pair(channels, first, second, f"positions at 0 N 0 E: {first}", tally)
        if second in channels:
            channels[second] = (channels[second] + 180.0) % 360.0 - 180.0
    mend.mend_fixes(time, channels, tally)
    channels = {key: values for key, values in channels.items() if np.isfinite(values).any()}
    flight = [t for t in tables if t.stream != "science"] or tables
    starts = np.unique([s for t in flight for s in (t.starts or (float(t.time[0]),))])
    facts = {key: value for t in reversed(tables) for key, value in t.facts.items()}
    attributes = {
        **facts,
        "heading_reference": facts.get("heading_reference", "magnetic"),
        "position_format": "NMEA" if nmea else "decimal degrees",
        "segments": tuple(s for t in flight for s in (t.segments or (t.label,))),
        "missions": tuple(dict.fromkeys(m for t in tables for m in t.missions)),
        "channel_sources": {key: sensor for key, sensor in _chosen(tables).items() if key in channels},
    }
    notes += dict.fromkeys(note for t in tables for note in t.notes)
    digests = {str(f): Source.digest(f) for f in files}
    missing = tuple(w for w in WANTED if w not in channels)
    products = sorted({t.facts.get("product", "native Slocum sensors") for t in tables})
    source = Source(", ".join(products), digests, tuple(notes))
    return Recording(name, time, channels, source, starts, tally.repairs(), missing, attributes)


def _position_format(tables: list[Table]) -> tuple[bool, str]:
    """Whether the native positions of all tables are NMEA; one decision for the whole recording."""
    latitudes, longitudes, said = [np.empty(0)], [np.empty(0)], ""
    for table in tables:
        for first, second in POSITIONS:
            latitudes += [table.columns[n] for n in CHANNELS[first].native if n in table.columns]
            longitudes += [table.columns[n] for n in CHANNELS[second].native if n in table.columns]
        said += " " + table.facts.get("source", "") + " " + table.facts.get("position_units", "")
    lat, lon = np.concatenate(latitudes), np.concatenate(longitudes)
    return mend.is_nmea(lat[lat != 0.0], lon[lon != 0.0], said)


def _chosen(tables: list[Table]) -> dict[str, str]:
    """For each channel the native sensor that feeds it: the first that varies, else the first that is
    there."""
    spread: dict[str, tuple[float, float]] = {}
    for table in tables:
        for sensor, values in table.columns.items():
            good = values[np.isfinite(values)]
            if good.size:
                low, high = spread.get(sensor, (np.inf, -np.inf))
                spread[sensor] = (min(low, float(good.min())), max(high, float(good.max())))
    chosen = {}
    for key, spec in CHANNELS.items():
        there = [n for n in (key, *spec.native) if n in spread]
        moving = [n for n in there if spread[n][1] > spread[n][0]]
        if there:
            chosen[key] = (moving or there)[0]
    return chosen


def _to_channels(tables: list[Table], nmea: bool, tally: Tally) -> dict[str, list[Array]]:
    """Convert every table's columns to our names and SI units; the rest stays raw under its own name."""
    feeds: dict[str, list[str]] = {}
    for key, sensor in _chosen(tables).items():
        feeds.setdefault(sensor, []).append(key)
    out: dict[str, list[Array]] = {}
    for place, table in enumerate(tables):
        for sensor, values in table.columns.items():
            for key in feeds.get(sensor, [sensor]):
                spec = CHANNELS.get(key)
                column = values if spec is None else _convert(table, sensor, spec, values, nmea, tally)
                out.setdefault(key, [np.empty(0)] * len(tables))[place] = column
    return out


def _convert(table: Table, sensor: str, spec: Channel, values: Array, nmea: bool, tally: Tally) -> Array:
    """Values in the channel's SI unit, from the unit the file gives or the sensor's native one."""
    values = mend.blank_sentinels(values, sensor, tally)
    said = table.units.get(sensor, "")
    word = said.strip().lower()
    unit, scale, offset = UNITS[spec.native_unit.lower() if word in ("1", "nodim") or word not in UNITS else word]
    if spec.unit == "deg":
        if nmea and sensor in spec.native:
            degrees = mend.nmea_to_degrees(values)
            bad = int((np.isfinite(values) & ~np.isfinite(degrees)).sum())
            tally.add("positions with minutes above 60", bad, sensor)
            return degrees
        return values
    if unit != spec.unit:
        raise DataError(
            f"{table.label}: variable '{sensor}': expected a unit of {spec.unit}, found '{said}'. "
            "Correct the units attribute."
        )
    if spec.unit == "rad" and scale != 1.0 and sensor in ("heading", "pitch", "roll"):
        size = np.abs(values[np.isfinite(values)])
        if size.size > 20 and size.max() <= 2.0 * np.pi + 0.01:
            tally.add("angles given as degrees that are radians", int(size.size), f"{table.label}: {sensor}")
            return values
    return values * scale + offset
