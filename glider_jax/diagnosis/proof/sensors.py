"""What a flown mission leaves in its files: power and voltage, sensors with their faults, and the pilot's inputs.

Imports NumPy, netCDF4 and the proof's ocean and truth. Native Slocum names and units: positions NMEA DDDMM.mmmm,
pressures bar, conductivity S/m, angles rad, volumes cc. A sensor that did not update is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import netCDF4
import numpy as np
from numpy.typing import NDArray

from glider_jax.diagnosis.proof.ocean import (
    DAY,
    HOUR,
    Ocean,
    conductivity,
    in_situ_temperature,
    pressure_of,
    red_noise,
)
from glider_jax.diagnosis.proof.truth import Flown, Plan, Vehicle

Array = NDArray[np.float64]

ROW = 8.0  # s between rows
_BRAKE_SECONDS = 4
_TIMES = ("m_present_time", "sci_m_present_time")
_POSITIONS = ("m_gps_lat", "m_gps_lon", "m_lat", "m_lon")
_UNITS = {
    "m_present_time": "timestamp", "m_gps_lat": "lat", "m_gps_lon": "lon", "m_lat": "lat", "m_lon": "lon",
    "m_depth": "m", "m_pressure": "bar", "m_pitch": "rad", "m_roll": "rad", "m_heading": "rad", "c_wpt_lat": "lat",
    "c_wpt_lon": "lon", "m_ballast_pumped": "cc", "c_ballast_pumped": "cc", "m_is_ballast_pump_moving": "bool",
    "m_battery": "volts", "m_coulomb_current": "amp", "m_coulomb_amphr_total": "amp-hrs", "m_water_depth": "m",
    "x_surfaced": "bool", "sci_m_present_time": "timestamp", "sci_water_temp": "degc", "sci_water_cond": "S/m",
    "sci_water_pressure": "bar",
}  # fmt: skip


def power_of(
    flown: Flown,
    vehicle: Vehicle,
    effects: Mapping[str, float],
    rng: np.random.Generator | None = None,
    local_noon: float = 43200.0,
) -> Array:
    """Power drawn each second, W, without losses inside the battery.

    ``rng`` adds what no two strokes share: 3 % of pump energy, 8 % of brake energy and steps and slow wander of the
    hotel load, as measured on real gliders.
    """
    e = effects.get
    phase = flown["phase"]
    n = phase.size
    second = np.arange(n, dtype=float)
    watts = (
        np.full(n, vehicle.hotel + e("energy.hotel_bias.power", 0.0))
        + e("energy.hotel_growth.rate", 0.0) * second
    )
    watts += e("energy.dive_only_load.power", 0.0) * (phase < 0) + e("energy.climb_only_load.power", 0.0) * (
        phase > 0
    )
    night = np.cos(2 * np.pi * (second - local_noon) / DAY) < -0.1
    watts += e("out.hotel_by_night.power", 0.0) * night
    watts += (vehicle.surface + e("energy.surface_load.power", 0.0)) * (phase == 0)
    _surfacings(watts, phase, e)
    strokes = len(flown.strokes)
    scatter = np.ones((3, strokes))
    if rng is not None:
        scatter = np.stack(
            [rng.normal(1.0, 0.03, strokes), rng.normal(1.0, 0.08, strokes), rng.random(strokes)]
        )
        coarse = red_noise(rng, n // 60 + 2, 60.0, 0.012 * vehicle.hotel, 2400.0)
        watts += np.interp(second, np.arange(coarse.size) * 60.0, coarse)
        # Sensors switch in steps: each half yo draws its own hotel load.
        change = np.concatenate([[0], np.cumsum(np.diff(phase) != 0)])
        watts += (0.02 * vehicle.hotel * rng.standard_normal(change[-1] + 1))[change]
    for i, stroke in enumerate(flown.strokes):
        z, end = stroke.depth, min(stroke.start + stroke.seconds, n)
        if stroke.direction > 0:
            joules = vehicle.pump_intercept + e("energy.pump_fixed_cost.energy", 0.0)
            joules += (vehicle.pump_slope + e("energy.pump_slope.slope", 0.0)) * z
            joules += e("energy.pump_pressure_nonlinearity.curvature", 0.0) * z * z
        else:
            joules = vehicle.retract + e("energy.retract_pressure.slope", 0.0) * z
        joules *= 1.0 + e("energy.cold_friction.slope", 0.0) * max(15.0 - stroke.temperature, 0.0)
        joules *= 1.0 + e("energy.pump_wear.rate", 0.0) * i
        joules *= scatter[0, i]
        if stroke.direction > 0 and scatter[2, i] < e("out.pump_retries.share", 0.0):
            joules *= 1.8
        watts[stroke.start : end] += joules / stroke.seconds
        brake = (
            vehicle.brake + e("energy.brake_pressure.slope", 0.0) * z + e("energy.brake_wear.rate", 0.0) * i
        )
        watts[stroke.start : stroke.start + _BRAKE_SECONDS] += brake * scatter[1, i] / _BRAKE_SECONDS
    return watts


def _surfacings(watts: Array, phase: Array, e) -> None:
    """Energy of calls and of the air bladder, in place."""
    call, air = e("energy.iridium_call.power", 0.0), e("energy.air_pump.energy", 0.0)
    if not (call or air):
        return
    up = np.flatnonzero((phase[1:] == 0) & (phase[:-1] != 0)) + 1
    for begin in up:
        after = np.flatnonzero(phase[begin:] != 0)
        end = begin + int(after[0]) if after.size else phase.size
        watts[begin + 180 : end] += call
        stop = min(begin + 150, end)
        watts[begin:stop] += air / max(stop - begin, 1)


def electricity(
    flown: Flown, watts: Array, vehicle: Vehicle, effects: Mapping[str, float]
) -> tuple[Array, Array]:
    """Current A drawn and battery voltage V each second; open-circuit voltage is linear in the state of charge."""
    e = effects.get
    capacity = vehicle.capacity * np.exp(-e("energy.capacity_loss.share", 0.0))
    leak = e("energy.leak_drain.rate", 0.0)
    drawn = watts
    for _ in range(2):  # losses feed back on the charge: twice is enough
        charge = 1.0 - np.cumsum(drawn) / capacity
        open_circuit = (
            vehicle.empty + (vehicle.full - vehicle.empty) * charge + e("energy.voltage_offset.offset", 0.0)
        )
        resistance = e("energy.internal_resistance.resistance", 0.0)
        resistance = resistance + e("energy.cold_resistance.slope", 0.0) * (15.0 - flown["temperature"])
        resistance = resistance + e("energy.ageing_resistance.resistance", 0.0) * (1.0 - charge)
        load = watts + leak * np.arange(watts.size) * open_circuit**2
        voltage = 0.5 * (open_circuit + np.sqrt(np.maximum(open_circuit**2 - 4.0 * resistance * load, 1.0)))
        current = load / voltage
        drawn = load + resistance * current**2
    return current, voltage


def _lagged(values: Array, scale: float) -> Array:
    """First-order low-pass of a series per second, time constant ``scale`` s."""
    keep = np.exp(-1.0 / scale)
    out = np.empty_like(values)
    state = float(values[0])
    for i, x in enumerate(values.tolist()):
        state = keep * state + (1.0 - keep) * x
        out[i] = state
    return out


def record(
    flown: Flown, ocean: Ocean, vehicle: Vehicle, effects: Mapping[str, float], rng: np.random.Generator
) -> dict[str, Array]:
    """The recording's columns, one value per row, UTC times; float64, NaN where a sensor did not update."""
    e = effects.get
    n = flown["depth"].size
    rows = int(n / ROW) - 1
    second = np.arange(n, dtype=float)
    at = ROW * np.arange(1, rows + 1) + np.clip(rng.normal(0.0, 0.15, rows), -0.6, 0.6)
    near = np.clip(np.rint(at).astype(int), 0, n - 1)

    def take(name: str) -> Array:
        return np.interp(at, second, flown[name])

    def pick(name: str) -> Array:
        return flown[name][near]

    start = ocean.region.start
    surfaced = pick("phase") == 0
    z_gain, z_offset = 1.0 + e("sensor.pressure_gain.gain", 0.0), e("sensor.pressure_offset.offset", 0.0)
    depth = (
        np.interp(at, second, _lagged(flown["depth"], 1.5)) * z_gain
        + z_offset
        + _drifting(rng, at, 0.03, 6 * HOUR)
    )
    pressure = np.round((pressure_of(depth) / 10.0 + rng.normal(0.0, 0.003, rows)) / 0.002) * 0.002
    watts = power_of(flown, vehicle, effects, rng)
    current, voltage = electricity(flown, watts, vehicle, effects)
    stop = np.clip(np.ceil(at).astype(int), 8, n)
    total = np.concatenate([[0.0], np.cumsum(current)])
    mean = (total[stop] - total[stop - 8]) / 8.0
    seen = mean * (1.0 + e("sensor.current_gain.gain", 0.0)) + e("sensor.current_offset.offset", 0.0)
    heading = np.mod(pick("indicated_heading") + rng.normal(0.0, 0.008, rows), 2 * np.pi)
    pitch = np.round((take("indicated_pitch") + rng.normal(0.0, 0.004, rows)) / 0.00175) * 0.00175
    # Voltage and load are not sampled at the same moment: a pump's sag is read 20 mV off.
    loose = np.where(pick("pumping") > 0, rng.normal(0.0, 0.02, rows), 0.0)
    volts = voltage[near] + _drifting(rng, at, 0.004, HOUR) + loose
    command = np.where(pick("phase") < 0, -vehicle.pump_volume, vehicle.pump_volume) * 1e6
    columns = {
        "m_present_time": start + at,
        "m_depth": pressure / 1.00795 * 10.0,
        "m_pressure": pressure,
        "m_pitch": _frozen(pitch, e("out.frozen_pitch.share", 0.0), rng),
        "m_roll": 0.02 + np.interp(at, second[::10], red_noise(rng, second[::10].size, 10.0, 0.02, 60.0)),
        "m_heading": heading,
        "m_ballast_pumped": take("ballast") * 1e6 + rng.normal(0.0, 0.8, rows),
        "c_ballast_pumped": command,
        "m_is_ballast_pump_moving": (pick("pumping") > 0).astype(float),
        "m_battery": np.round((volts + rng.normal(0.0, 0.018, rows)) / 0.005) * 0.005,
        "m_coulomb_current": seen + rng.normal(0.0, 0.0025, rows),
        "m_coulomb_amphr_total": 3.0
        + np.cumsum(seen) * ROW / HOUR * (1.0 + e("sensor.coulomb_gain.gain", 0.0)),
        "x_surfaced": surfaced.astype(float),
    }
    _positions(columns, flown, ocean, near, at, surfaced, rng)
    _science(columns, flown, ocean, effects, at, surfaced, rng)
    height = pick("bottom") - take("depth")
    heard = (pick("phase") < 0) & (height < 45.0) & (rng.random(rows) < 0.4)
    echo = take("depth") + height * (1.0 + rng.normal(0.0, 0.01, rows)) + rng.normal(0.0, 0.4, rows)
    echo = np.where(rng.random(rows) < 0.008, echo * rng.uniform(0.4, 0.9, rows), echo)
    columns["m_water_depth"] = np.where(heard, echo, np.nan)
    columns["time"] = columns["m_present_time"].copy()
    return _faults(columns, rng)


def _drifting(rng: np.random.Generator, at: Array, sd: float, scale: float) -> Array:
    """Slow wander of an instrument at the rows' times."""
    step = scale / 20.0
    coarse = red_noise(rng, int(at[-1] / step) + 2, step, sd, scale)
    return np.interp(at, np.arange(coarse.size) * step, coarse)


def _frozen(values: Array, share: float, rng: np.random.Generator) -> Array:
    """Hold a sensor at its last value in windows that cover ``share`` of the record."""
    if share <= 0.0:
        return values
    out = values.copy()
    length = 150
    for begin in rng.choice(values.size - length, max(int(share * values.size / length), 1), replace=False):
        out[begin : begin + length] = out[begin]
    return out


def _nmea(degrees: Array) -> Array:
    whole = np.trunc(degrees)
    return whole * 100.0 + (degrees - whole) * 60.0


def _positions(columns, flown: Flown, ocean: Ocean, near, at, surfaced, rng) -> None:
    """Reckoned positions, GPS fixes once a surfacing has had time for one, and the waypoint steered to."""
    r = ocean.region
    start = flown["phase"]
    up = np.concatenate([[0], np.flatnonzero((start[1:] == 0) & (start[:-1] != 0)) + 1])
    fix = np.zeros(start.size, dtype=bool)
    for begin in up:
        first = begin + int(rng.uniform(50, 150)) if begin else 10
        if rng.random() > 0.02 or begin == 0:
            fix[first : first + 3000] = True
    fix &= start == 0
    rows = near.size
    got = fix[near] & (rng.random(rows) < 0.8)
    count = flown["east"].size // 10 + 1
    wander = [
        np.interp(at, np.arange(count) * 10.0, red_noise(rng, count, 10.0, 3.5, 400.0)) for _ in range(2)
    ]
    east = flown["east"][near] + rng.normal(0.0, 2.5, rows) + wander[0]
    north = flown["north"][near] + rng.normal(0.0, 2.5, rows) + wander[1]
    if got.any() and rng.random() < 0.15:  # a wild fix, as receivers give now and then
        east[rng.choice(np.flatnonzero(got))] += rng.choice([-1.0, 1.0]) * rng.uniform(4e3, 3e4)
    reck_e, reck_n = flown["reckoned_east"][near], flown["reckoned_north"][near]
    for name, x, y in (("gps", east, north), ("", np.where(got, east, reck_e), np.where(got, north, reck_n))):
        keep = np.where(got, 1.0, np.nan) if name else 1.0
        stem = f"m_{name}_" if name else "m_"
        columns[f"{stem}lat"] = _nmea(r.latitude + y / ocean.metres_north) * keep
        columns[f"{stem}lon"] = _nmea(r.longitude + x / ocean.metres_east) * keep
    points = np.array(flown.plan.waypoints)[flown["waypoint"][near].astype(int)]
    columns["c_wpt_lat"] = _nmea(r.latitude + points[:, 1] / ocean.metres_north)
    columns["c_wpt_lon"] = _nmea(r.longitude + points[:, 0] / ocean.metres_east)


def _science(columns, flown: Flown, ocean: Ocean, effects, at, surfaced, rng) -> None:
    """CTD under water: its own gauge, a thermistor that lags by half a second, salinity that is off by an effect."""
    e = effects.get
    rows = at.size
    second = np.arange(flown["depth"].size, dtype=float)
    depth = np.interp(at, second, flown["depth"])
    temperature, salinity = np.empty(rows), np.empty(rows)
    for block in range(int(at[-1] / 600) + 1):
        inside = (at >= block * 600) & (at < (block + 1) * 600)
        temperature[inside], salinity[inside] = ocean.profile(depth[inside], block * 600.0)
    salinity = salinity - e("flight.salinity_bias.bias", 0.0) - e("sensor.salinity_drift.rate", 0.0) * at
    dbar = pressure_of(depth)
    in_situ = in_situ_temperature(salinity, temperature, dbar)
    cond = conductivity(salinity, in_situ, dbar)
    slope = np.gradient(in_situ, at)
    both = e("sensor.pressure_offset.both_gauges", 0.0)
    off = both * e("sensor.pressure_offset.offset", 0.0) + _drifting(rng, at, 0.03, 6 * HOUR)
    gauge = dbar / 10.0 + off * 0.100795 + rng.normal(0.0, 0.0015, rows)
    on = ~surfaced & (depth > 1.0) & (rng.random(rows) < 0.97)
    if rng.random() < 0.4:  # the CTD stops for a while
        begin = int(rng.uniform(0, rows - 400))
        on[begin : begin + int(rng.uniform(60, 300))] = False
    values = {
        "sci_m_present_time": ocean.region.start + at + rng.uniform(0.1, 0.9),
        "sci_water_temp": in_situ - 0.5 * slope + rng.normal(0.0, 0.0015, rows),
        "sci_water_cond": cond + rng.normal(0.0, 0.0002, rows),
        "sci_water_pressure": gauge,
    }
    for name, value in values.items():
        columns[name] = np.where(on, value, np.nan)


def _faults(columns: dict[str, Array], rng: np.random.Generator) -> dict[str, Array]:
    """Gaps, doubled rows and cycles in which a sensor did not report, as real files have them."""
    rows = columns["time"].size
    for name in ("m_pitch", "m_roll", "m_heading", "m_ballast_pumped", "m_battery", "m_coulomb_current"):
        columns[name] = np.where(rng.random(rows) < 0.01, np.nan, columns[name])
    keep = np.ones(rows, dtype=bool)
    for _ in range(rng.integers(1, 5)):
        begin = int(rng.uniform(200, rows - 200))
        keep[begin : begin + int(rng.uniform(4, 22))] = False
    index = np.flatnonzero(keep)
    doubled = rng.choice(index, rng.integers(2, 7), replace=False)
    index = np.sort(np.concatenate([index, doubled]))
    return {name: values[index] for name, values in columns.items()}


def write_recording(path: Path, columns: Mapping[str, Array], start: float) -> None:
    """Write a recording of native sensors, one row per cycle."""
    with netCDF4.Dataset(path, "w") as file:
        file.platform_type = "Slocum G1 200 m electric"
        file.source = "native sensor names and units; positions are NMEA DDDMM.mmmm"
        file.createDimension("time", columns["time"].size)
        for name, unit in _UNITS.items():
            kind = "f8" if name in _TIMES or name in _POSITIONS else "f4"
            variable = file.createVariable(name, kind, ("time",), zlib=True, complevel=4, fill_value=np.nan)
            variable.units = unit
            variable[:] = columns[name]
        time = file.createVariable("time", "f8", ("time",), fill_value=np.nan)
        time.units, time.calendar = "seconds since 1970-01-01 00:00:00", "standard"
        time[:] = columns["time"]


def write_bathymetry(path: Path, ocean: Ocean, rng: np.random.Generator, reach: float = 70e3) -> None:
    """Write the chart: elevation on a 1-arcminute grid with a smooth error of one metre or so."""
    r = ocean.region
    lat = r.latitude + np.arange(-reach, reach, 1852.0) / ocean.metres_north
    lat = np.round(lat * 60.0) / 60.0
    lon = np.round((r.longitude + np.arange(-reach, reach, 1852.0 * 0.9) / ocean.metres_east) * 60.0) / 60.0
    lat, lon = np.unique(lat), np.unique(lon)
    x = (lon - r.longitude) * ocean.metres_east
    y = (lat - r.latitude) * ocean.metres_north
    depth = ocean.bottom(x[None, :], y[:, None])
    wave = rng.uniform(0, 2 * np.pi, 2)
    depth = depth + 0.8 * np.cos(x[None, :] / 9e3 + wave[0]) * np.cos(y[:, None] / 7e3 + wave[1])
    with netCDF4.Dataset(path, "w") as file:
        for name, values in (("lat", lat), ("lon", lon)):
            file.createDimension(name, values.size)
            axis = file.createVariable(name, "f8", (name,))
            axis.units = "degrees_north" if name == "lat" else "degrees_east"
            axis[:] = values
        z = file.createVariable("z", "f4", ("lat", "lon"), zlib=True, fill_value=np.nan)
        z.units, z.positive, z.long_name = "m", "up", "elevation"
        z[:] = -depth


def write_currents(path: Path, ocean: Ocean, rng: np.random.Generator, reach: float = 70e3) -> None:
    """Write the surface product: hourly, 6 km, cm/s, white and smooth errors, with holes in space and time."""
    r = ocean.region
    x = np.arange(-reach, reach, 6e3)
    hours = np.arange(ocean.start_hour, ocean.start_hour + ocean.hours - 1)
    time = hours * HOUR
    u, v = ocean.resolved(x[None, None, :], x[None, :, None], time[:, None, None])
    fields = []
    for field in (u, v):
        smooth = [red_noise(rng, hours.size, HOUR, 0.006, 8 * HOUR) for _ in range(4)]
        error = 0.0
        for series in smooth:
            kx, ky, p = rng.uniform(-1, 1) / 12e3, rng.uniform(-1, 1) / 12e3, rng.uniform(0, 2 * np.pi)
            error = error + series[:, None, None] * np.cos(kx * x[None, None, :] + ky * x[None, :, None] + p)
        fields.append(100.0 * (field + error + rng.normal(0.0, 0.015, field.shape)))
    far = np.hypot(x[None, :], x[:, None]) / reach
    hole = rng.random(fields[0].shape) < np.clip(0.01 + 0.5 * (far - 0.85), 0.01, 0.9)
    for _ in range(rng.integers(3, 9)):  # stations that stop: a patch for some hours
        begin, i, j = rng.integers(hours.size), rng.integers(x.size), rng.integers(x.size)
        hole[begin : begin + rng.integers(2, 10), max(i - 3, 0) : i + 3, max(j - 3, 0) : j + 3] = True
    hole[rng.choice(hours.size, 2, replace=False)] = True
    with netCDF4.Dataset(path, "w") as file:
        axes = {
            "time": (r.start + time, "seconds since 1970-01-01 00:00:00"),
            "lat": (r.latitude + x / ocean.metres_north, "degrees_north"),
            "lon": (r.longitude + x / ocean.metres_east, "degrees_east"),
        }
        for name, (values, unit) in axes.items():
            file.createDimension(name, values.size)
            axis = file.createVariable(name, "f8", (name,))
            axis.units = unit
            axis[:] = values
        for name, long, values in (("u", "eastward", fields[0]), ("v", "northward", fields[1])):
            out = file.createVariable(name, "f4", ("time", "lat", "lon"), zlib=True, fill_value=-999.0)
            out.units, out.standard_name = "cm s-1", f"surface_{long}_sea_water_velocity"
            out[:] = np.where(hole, -999.0, values)


def write_vehicle(path: Path, nominal: Vehicle, sigma: Mapping[str, float]) -> None:
    """Write what the pilot knows of the vehicle: constants with the standard deviation of their calibration."""
    v = nominal

    def known(name: str, digits: int = 4) -> str:
        return f"{{ value = {getattr(v, name):.{digits}f}, sigma = {sigma[name]:g} }}"

    path.write_text(
        "# What the pilot knows of this vehicle; SI units, sigma is one standard deviation of the calibration.\n"
        '[vehicle]\nname = "concealed"\n'
        f"mass = {known('mass')}  # kg\nvolume = {v.volume:.8f}  # m3, no oil pumped, at the surface and 15 degC\n"
        f"wing_area = {v.wing_area:g}  # m2\nparasite_drag = {known('parasite_drag')}\n"
        f"induced_drag = {v.induced_drag:g}  # 1/rad2\nlift_slope = {v.lift_slope:g}  # 1/rad\n"
        f"pump_volume = {v.pump_volume * 1e6:.1f}  # cc, plus and minus\n"
        f"pump_rate = {v.pump_rate * 1e6:.1f}  # cc/s\n\n"
        f"[energy]\nhotel = {known('hotel')}  # W\n"
        f"pump_dive_to_climb = {{ intercept = {v.pump_intercept:.2f}, intercept_sigma = {sigma['pump_intercept']:g}, "
        f"slope = {v.pump_slope:.3f}, slope_sigma = {sigma['pump_slope']:g} }}  # J, J/m\n"
        f"pump_climb_to_dive = {known('retract', 2)}  # J\nbrake = {known('brake', 2)}  # J per inflection\n"
        f"surface = {known('surface')}  # W on top of hotel while surfaced\nbattery_capacity = {v.capacity:.1f}  # J\n"
        f"open_circuit_voltage = {{ full = {v.full:g}, empty = {v.empty:g} }}  # V, linear in state of charge\n",
        encoding="utf-8",
    )


def write_mission(path: Path, plan: Plan, ocean: Ocean) -> None:
    """Write the mission as the pilot ordered it."""
    r = ocean.region
    points = [
        [round(r.latitude + y / ocean.metres_north, 6), round(r.longitude + x / ocean.metres_east, 6)]
        for x, y in plan.waypoints
    ]
    path.write_text(
        f"[mission]\nstart = {r.start:.1f}  # UTC seconds since 1970\n"
        f"waypoints = {points}  # decimal degrees, [lat, lon]; the first is the start\n"
        f"waypoint_radius = {plan.radius:g}  # m\ndive_to = {plan.dive_to:g}  # m\nclimb_to = {plan.climb_to:g}  # m\n"
        f"altitude = {plan.altitude:g}  # m above the seafloor at which a dive turns\n"
        f"pitch = {np.degrees(plan.pitch):.4g}  # degrees\nsurface_every = {plan.surface_every:g}  # s\n"
        f"surface_stay = {plan.surface_stay:g}  # s\n",
        encoding="utf-8",
    )
