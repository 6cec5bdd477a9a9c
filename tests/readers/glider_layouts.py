"""A small simulated glider whose track, current and compass are known, in the layouts of real recordings.

It saws between 2 and 40 m at 26 degrees with 0.15 m/s of vertical speed and no angle of attack, drifts at the surface
for ten minutes with fixes, and computes its own current as the firmware does: final value logged after the drift.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import netCDF4
import numpy as np

RADIUS = 6_371_000.0
START = 1_500_000_000.0
PITCH = np.radians(26.0)
RATE = 0.15
STEP = 4.0
UNITS = {
    "m_present_time": "timestamp",
    "m_lat": "lat",
    "m_lon": "lon",
    "m_gps_lat": "lat",
    "m_gps_lon": "lon",
    "m_depth": "m",
    "m_pressure": "bar",
    "m_pitch": "rad",
    "m_heading": "rad",
    "m_gps_mag_var": "rad",
    "m_final_water_vx": "m/s",
    "m_final_water_vy": "m/s",
    "m_coulomb_amphr_total": "amp-hrs",
    "m_de_oil_vol": "cc",
    "m_ballast_pumped": "cc",
    "m_battery": "volts",
    "m_vacuum": "inHg",
    "m_lithium_battery_relative_charge": "%",
    "sci_water_temp": "degc",
    "sci_water_cond": "s/m",
    "sci_water_pressure": "bar",
}


@dataclass
class Simulated:
    """The truth and what was recorded of it."""

    current: tuple[float, float]
    drift: tuple[float, float]
    variation: float
    heading: float
    time: np.ndarray
    sensors: dict[str, np.ndarray]
    science_time: np.ndarray
    science: dict[str, np.ndarray]
    dives: list[tuple[float, float]] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)


def to_nmea(degrees):
    """Decimal degrees as DDDMM.mmmm, sign kept."""
    size = np.abs(degrees)
    whole = np.floor(size)
    return np.copysign(100.0 * whole + 60.0 * (size - whole), degrees)


def simulate(
    dives=3, current=(0.12, -0.05), drift=(0.2, 0.1), variation=0.25, heading=1.0, at=(40.0, -73.0), yos=4
) -> Simulated:
    """Fly ``dives`` segments of ``yos`` yos; ``heading`` rad is true, the compass reads it plus ``variation``."""
    rows: list[dict[str, float]] = []
    spans, starts = [], []
    t, x, y, charge = START, 0.0, 0.0, 10.0
    known = (np.nan, np.nan)

    def place(east, north):
        lat = at[0] + np.degrees(north / RADIUS)
        return lat, at[1] + np.degrees(east / RADIUS / np.cos(np.radians(0.5 * (lat + at[0]))))

    def row(depth, **more):
        lat, lon = place(x, y)
        rows.append(
            {"m_present_time": t, "m_depth": depth, "m_pressure": depth / 9.95, "m_coulomb_amphr_total": charge}
            | {"m_heading": (heading + variation) % (2 * np.pi), "m_battery": 15.0}
            | more
        )
        return lat, lon

    def surface(first):
        nonlocal t, x, y, charge
        starts.append(t)
        for k in range(150):
            lat, lon = place(x, y)
            more = {"m_lat": lat, "m_lon": lon, "m_pitch": 0.1}
            if k >= 15 or first:
                more |= {"m_gps_lat": lat, "m_gps_lon": lon, "m_gps_mag_var": variation, "m_gps_status": 0.0}
            if k == 140 and not first:
                # The local frame's y axis points to magnetic north: turn the true vector clockwise by the variation.
                # A ten-thousandth more each time: equal values mean that nothing was computed anew.
                turned = complex(*known) * (1.0 + 1e-4 * len(starts)) * np.exp(-1j * variation)
                more |= {"m_final_water_vx": turned.real, "m_final_water_vy": turned.imag}
            row(0.0, **more)
            t += STEP
            x, y, charge = x + STEP * drift[0], y + STEP * drift[1], charge + 1e-4

    speed = RATE / np.tan(PITCH)
    for n in range(dives):
        surface(n == 0)
        begin = t
        corners = [0.0] + [40.0, 2.0] * yos
        corners[-1] = 0.0
        own_x, own_y = x, y
        for top, bottom in zip(corners[:-1], corners[1:], strict=True):
            steps = int(round(abs(bottom - top) / RATE / STEP))
            for k in range(steps):
                depth = top + (bottom - top) * k / steps
                down = bottom > top
                lat, lon = place(own_x, own_y)
                row(
                    depth,
                    m_lat=lat,
                    m_lon=lon,
                    m_pitch=-PITCH if down else PITCH,
                    m_de_oil_vol=-200.0 if down else 200.0,
                )
                rate = abs(bottom - top) / steps
                through = rate / np.tan(PITCH)
                own_x, own_y = own_x + through * np.sin(heading), own_y + through * np.cos(heading)
                x += through * np.sin(heading) + STEP * current[0]
                y += through * np.cos(heading) + STEP * current[1]
                t, charge = t + STEP, charge + 1e-4
        spans.append((begin, t))
        known = current
    surface(False)
    assert speed > 0.0
    names = sorted({name for r in rows for name in r} - {"m_present_time"})
    time = np.array([r["m_present_time"] for r in rows])
    sensors = {name: np.array([r.get(name, np.nan) for r in rows]) for name in names}
    sensors["m_ballast_pumped"] = np.where(np.arange(time.size) < 2, 0.0, np.nan)
    depth = sensors["m_depth"]
    science_time = time[::2] + 0.7
    under = np.interp(science_time, time, depth)
    science = {
        "sci_water_temp": 20.0 - 0.1 * under,
        "sci_water_cond": np.full(under.size, 4.0),
        "sci_water_pressure": under / 9.95,
    }
    return Simulated(current, drift, variation, heading, time, sensors, science_time, science, spans, starts)


def write_native(path, sim, *, nmea=False, units=None, attributes=None, extra=None):
    """Write a simulated recording as netCDF of native sensors, one row per cycle."""
    given = UNITS | (units or {})
    with netCDF4.Dataset(path, "w") as data:
        for name, value in (attributes or {}).items():
            data.setncattr(name, value)
        for dim, clock, columns in (("time", sim.time, sim.sensors), ("sci_time", sim.science_time, sim.science)):
            data.createDimension(dim, clock.size)
            var = data.createVariable(dim, "f8", (dim,))
            var.units = "seconds since 1970-01-01T00:00:00Z"
            var[:] = clock
            for name, values in (columns | (extra or {} if dim == "time" else {})).items():
                if nmea and name.endswith(("_lat", "_lon")):
                    values = to_nmea(values)
                var = data.createVariable(name, "f8", (dim,), fill_value=np.nan)
                var.units = given.get(name, "nodim")
                var[:] = values
    return path
