"""Make the default ocean: a New Jersey shelf with its seafloor and three weeks of surface currents.

Everything is built from formulas and from facts rounded from the literature; no data set is read, copied or
fitted. Each number is followed by where it comes from, ``judgement`` where nobody published it. Run
``python -m glider_jax_data.make_default --out DIR`` to write the two files again; the result does not depend
on the clock, nor on the machine beyond rounding to the packing step. Longitudes are degrees east, depths
positive down.

Published basis (short names used below)
    Moody 1980: Moody and Butman, USGS Open-File Report 80-1137; the tide co-oscillates on this shelf.
    HFtide 2020: tidal velocities from HF radar, Journal of Oceanography, doi:10.1007/s10872-020-00545-7.
    Roarty 2016: eight years of HF radar surface currents of the Mid-Atlantic Bight, Ocean Sciences Meeting.
    Shearman 2005: near-inertial currents of the New England shelf, J. Geophys. Res. 110, C02012.
    Wong 1999: wind-driven inner-shelf currents off Atlantic City, Cont. Shelf Res. 19, 757.
    charts: public nautical charts, coastline and isobaths read to about 0.05 degree.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

import netCDF4
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]

BATHYMETRY = "new_jersey_bathymetry.nc"
CURRENTS = "new_jersey_currents.nc"

SOUTH, NORTH, WEST, EAST = 38.0, 40.4, -75.0, -71.6  # the mission with 100 km around it; judgement
STEP = 1.0 / 60.0  # 1 arc-minute, the resolution of the seafloor the 2010 simulator used
KILOMETRES_PER_DEGREE = 111.2  # mean length of a degree of latitude
MIDDLE = 39.2  # latitude whose cosine scales longitude in the local plane; judgement

# Coastline from Delmarva by Cape May, Long Beach Island and Sandy Hook to Montauk, rounded; charts.
# Delaware Bay and the back bays count as land: no shelf glider flies there.
COAST = (
    (37.60, -75.65), (37.90, -75.35), (38.33, -75.08), (38.80, -75.08), (38.93, -74.92), (39.10, -74.70),
    (39.35, -74.42), (39.50, -74.28), (39.75, -74.10), (40.10, -74.02), (40.48, -73.99), (40.58, -73.80),
    (40.63, -73.20), (40.85, -72.40), (41.07, -71.85),
)  # fmt: skip

# Shelf break, about 120 m, from off Delaware Bay past the head of Hudson Canyon; charts.
BREAK = (
    (37.40, -74.55), (37.90, -74.08), (38.30, -73.62), (38.70, -73.12), (39.00, -72.85), (39.25, -72.60),
    (39.45, -72.45), (39.65, -72.20), (39.85, -71.85), (40.00, -71.30), (40.05, -70.80),
)  # fmt: skip

# Depth on the shelf against the share of the way from coast to break. 10 m at 2 km, 20 to 25 m at 25 to
# 30 km, 45 m half way, 60 to 65 m at three quarters and 120 m at the break: charts.
SHELF_SHARE = (0.0, 0.017, 0.10, 0.22, 0.50, 0.78, 0.92, 1.0)
SHELF_DEPTH = (0.0, 10.0, 16.0, 24.0, 45.0, 66.0, 91.0, 120.0)
# Depth on the slope against kilometres seaward of the break: 800 m after 30 km, 2,000 m after 65 km; charts.
SLOPE_KM = (0.0, 3.0, 10.0, 30.0, 45.0, 65.0, 100.0, 200.0)
SLOPE_DEPTH = (120.0, 170.0, 330.0, 800.0, 1400.0, 2000.0, 2500.0, 2750.0)
LAND_RISE = 0.5  # m of height per km inland, a coastal plain; judgement
LAND_TOP = 30.0  # m, the plain's height; judgement

# Hudson shelf valley and canyon, axis from off Sandy Hook to the slope; charts.
VALLEY = (
    (40.40, -73.83),
    (40.10, -73.55),
    (39.80, -72.95),
    (39.60, -72.50),
    (39.30, -72.10),
    (38.95, -71.60),
)
VALLEY_RELIEF = 14.0  # m below the shelf beside it, of 5 to 40 m along the axis; charts
VALLEY_WIDTH = 6.0  # km, e-folding half width of a valley 5 to 15 km wide; charts
CANYON_RELIEF = 300.0  # m below the slope beside it; charts say several hundred metres
CANYON_WIDTH = 4.0  # km; charts

# Sand ridges: heights of 1 to 10 m, spacing of a few km, crests turned some 20 to 30 degrees from the coast
# (general description of the inner shelf ridge fields). Two waves beat into patches.
RIDGES = ((1.3, 6.0, 60.0, 0.7), (0.9, 4.4, 48.0, 2.1))  # m, km, bearing of the crests degT, phase; judgement
RIDGE_INNER, RIDGE_OUTER = 10.0, 45.0  # m, depths between which ridges stand; judgement

START = "2009-09-05T00:00:00Z"  # the month of the shelf mission of the 2010 paper
START_SECONDS = 1252108800.0  # the same, s since 1970-01-01
HOURS = 21 * 24 + 1  # 15 days of mission and six days for slow members
GRID_KM = 6.0  # spacing of the regional radar totals
DOWN_SHELF = 215.0  # degT, along the coast towards south-west; the axis is 35 degT in Wong 1999

MEAN_INNER, MEAN_OUTER = 0.045, 0.085  # m/s: 3 to 6 inshore and 6 to 9 cm/s seaward of 50 m, Roarty 2016
MEAN_OFFSHORE = 0.015  # m/s, offshore part of the mean; its presence is in Roarty 2016, its size judgement

# Tide: angular speed deg/h, amplitude relative to M2, Greenwich phase relative to M2 deg.
# Speeds are astronomical; S2 and N2 near 0.2, K1 and O1 near 0.2 to 0.3 of the M2 current are judgement.
TIDES = {
    "M2": (28.9841042, 1.00, 0.0), "S2": (30.0, 0.20, 25.0), "N2": (28.4397295, 0.22, -20.0),
    "K1": (15.0410686, 0.28, -80.0), "O1": (13.9430356, 0.20, -75.0),
}  # fmt: skip
M2_INNER, M2_OUTER = 0.05, 0.11  # m/s semi-major axis; maximum about 0.10 over the middle shelf, HFtide 2020
M2_PHASE = 265.0  # deg; onshore flow leads high water (355 at Atlantic City) by 90 degrees, Moody 1980
TIDE_RATIO = 0.6  # minor over major axis, turning clockwise; judgement
TIDE_AXIS = 305.0  # degT of the major axis, straight onshore; Moody 1980

# Storms: hour of the peak, half duration h, m/s at the peak; 0.2 to 0.35 m/s for one to two days, judgement.
STORMS = ((128.0, 22.0, 0.32), (281.0, 17.0, 0.24))
STORM_BEARING = 225.0  # degT; the surface flows to the right of a north-easterly wind, judgement
# Inertial bursts: hour of onset, m/s offshore, e-folding days, phase. Peaks above 0.30 seen, Shearman 2005.
BURSTS = ((40.0, 0.10, 2.5, 0.4), (140.0, 0.20, 3.5, 1.9), (290.0, 0.17, 3.0, 4.2), (420.0, 0.12, 2.0, 2.8))
BURST_RISE = 8.0  # h over which a burst builds up; judgement
BURST_LENGTH = 260.0  # km, wavelength; decorrelation over about 100 km, Shearman 2005
EARTH = 7.2921159e-5  # rad/s, rotation of the Earth

EDDY_SPEED = 0.035  # m/s rms; judgement
EDDY_LENGTHS = (35.0, 110.0)  # km, shortest and longest wave; judgement
EDDY_DAYS = (4.0, 12.0)  # days, shortest and longest period; judgement
EDDY_MODES = 40  # judgement
SEED = 2009

ERROR_INNER, ERROR_RANGE = 0.03, 0.05  # m/s, 1-sigma mid-shelf and its growth far offshore; judgement
PACK = 0.002  # m/s, packing step, a tenth of the radar's own resolution

# Waypoints of the default mission (latitude, longitude): off Little Egg Inlet, the shelf edge, and back.
MISSION = ((39.45, -74.15), (39.02, -72.92), (39.45, -74.15))
MISSION_START = "2009-09-05T12:00:00Z"


def plane(latitude: Array, longitude: Array) -> tuple[Array, Array]:
    """Kilometres east and north of 39.2 N, 73 W in a local plane, good to 1 % here."""
    scale = KILOMETRES_PER_DEGREE * np.cos(np.radians(MIDDLE))
    return (np.asarray(longitude) + 73.0) * scale, (np.asarray(latitude) - MIDDLE) * KILOMETRES_PER_DEGREE


def distance(line: tuple[tuple[float, float], ...], x: Array, y: Array) -> tuple[Array, Array]:
    """Distance (km) to a polyline of (latitude, longitude); share of its length where it is nearest."""
    px, py = plane(*np.array(line).T)
    length = np.hypot(np.diff(px), np.diff(py))
    before = np.concatenate([[0.0], np.cumsum(length)])
    nearest, along = np.full(np.shape(x), np.inf), np.zeros(np.shape(x))
    for i, size in enumerate(length):
        dx, dy = (px[i + 1] - px[i]) / size, (py[i + 1] - py[i]) / size
        t = np.clip((x - px[i]) * dx + (y - py[i]) * dy, 0.0, size)
        d = np.hypot(x - px[i] - t * dx, y - py[i] - t * dy)
        closer = d < nearest
        nearest, along = np.where(closer, d, nearest), np.where(closer, (before[i] + t) / before[-1], along)
    return nearest, along


def inside(line: tuple[tuple[float, float], ...], x: Array, y: Array) -> Array:
    """Whether points lie north-west of a polyline closed far inland (crossing number)."""
    px, py = plane(*np.array((*line, (60.0, line[-1][1]), (60.0, -90.0), (line[0][0], -90.0))).T)
    within = np.zeros(np.shape(x), bool)
    for x0, y0, x1, y1 in zip(px, py, np.roll(px, -1), np.roll(py, -1), strict=True):
        if y0 != y1:
            crosses = (y0 > y) != (y1 > y)
            within ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return within


def cross_shelf(latitude: Array, longitude: Array) -> tuple[Array, Array, Array]:
    """Signed km seaward of coast and of shelf break; share of the way between them (1 at the break)."""
    x, y = plane(latitude, longitude)
    coast, edge = distance(COAST, x, y)[0], distance(BREAK, x, y)[0]
    coast = np.where(inside(COAST, x, y), -coast, coast)
    edge = np.where(inside(BREAK, x, y), -edge, edge)
    return coast, edge, np.where(edge < 0, coast / np.maximum(coast - edge, 1e-6), 1.0)


def seafloor(latitude: Array, longitude: Array) -> Array:
    """Water depth (m, positive down, negative on land) at points of one shape."""
    x, y = plane(latitude, longitude)
    coast, edge, share = cross_shelf(latitude, longitude)
    shelf = PchipInterpolator(SHELF_SHARE, SHELF_DEPTH)(np.clip(share, 0.0, 1.0))
    depth = np.where(edge > 0, PchipInterpolator(SLOPE_KM, SLOPE_DEPTH)(np.clip(edge, 0.0, 200.0)), shelf)

    off_axis, along = distance(VALLEY, x, y)
    open_water = np.clip((depth - 15.0) / 15.0, 0.0, 1.0)  # the valley starts beyond 15 to 30 m; charts
    depth = depth + open_water * VALLEY_RELIEF * np.sin(np.pi * np.clip(along * 1.6, 0.0, 1.0)) ** 0.5 * np.exp(
        -((off_axis / VALLEY_WIDTH) ** 2)
    )
    on_slope = 1.0 / (1.0 + np.exp(-edge / 5.0))
    depth = depth + on_slope * CANYON_RELIEF * np.exp(-((off_axis / CANYON_WIDTH) ** 2))

    field = np.clip((depth - RIDGE_INNER) / 8.0, 0.0, 1.0) * np.clip((RIDGE_OUTER - depth) / 15.0, 0.0, 1.0)
    for height, wavelength, bearing, phase in RIDGES:
        across = x * np.cos(np.radians(bearing)) - y * np.sin(np.radians(bearing))
        depth = depth + field * height * np.sin(2 * np.pi * across / wavelength + phase)
    return np.where(coast > 0, np.maximum(depth, 0.5), -np.minimum(1.0 - LAND_RISE * coast, LAND_TOP))


def astronomy(name: str) -> float:
    """Equilibrium argument (deg) at the start, from mean longitudes (Meeus); nodal factors are left out."""
    days = (START_SECONDS - 946728000.0) / 86400.0
    moon, sun, perigee = (
        218.3165 + 13.17639648 * days,
        280.4665 + 0.98564736 * days,
        83.3532 + 0.11140353 * days,
    )
    return {
        "M2": 2 * (sun - moon), "S2": 0.0, "N2": 2 * sun - 3 * moon + perigee,
        "K1": sun + 90.0, "O1": sun - 2 * moon + 270.0,
    }[name]  # fmt: skip


def turn(bearing: float) -> complex:
    """Unit vector east + i north towards a bearing in degrees true."""
    return np.exp(1j * np.radians(90.0 - bearing))


def tide(hour: Array, share: Array) -> Array:
    """Tidal current, east + i north, m/s: clockwise ellipses that grow from the coast to the middle shelf."""
    major = M2_INNER + (M2_OUTER - M2_INNER) * np.clip(share / 0.6, 0.0, 1.0)
    flow = np.zeros(np.broadcast_shapes(hour.shape, share.shape), complex)
    for name, (speed, ratio, lag) in TIDES.items():
        angle = np.radians(speed * hour + astronomy(name) - M2_PHASE - lag)
        flow += ratio * major * (np.cos(angle) - 1j * TIDE_RATIO * np.sin(angle))
    return flow * turn(TIDE_AXIS)


def inertial(hour: Array, latitude: Array, x: Array, y: Array, coast: Array) -> Array:
    """Inertial bursts after wind events, east + i north, m/s, clockwise at the local inertial frequency."""
    rate = 2.0 * EARTH * np.sin(np.radians(latitude)) * 3600.0
    offshore = 1.0 - np.exp(-np.maximum(coast, 0.0) / 35.0)  # weaker towards the coast, Shearman 2005
    flow = np.zeros(np.broadcast_shapes(hour.shape, x.shape), complex)
    for onset, speed, decay, phase in BURSTS:
        since = np.maximum(hour - onset, 0.0)
        size = speed * (1.0 - np.exp(-since / BURST_RISE)) * np.exp(-since / (24.0 * decay))
        flow += size * offshore * np.exp(1j * (phase - rate * since + 2 * np.pi * (0.8 * x + 0.6 * y) / BURST_LENGTH))
    return flow


def storms(hour: Array, share: Array) -> Array:
    """Wind-driven surface flow of the storms, east + i north, m/s; strongest over the inner half shelf."""
    shape = 0.6 + 0.4 * np.exp(-(((share - 0.35) / 0.4) ** 2))  # judgement
    flow = np.zeros(np.broadcast_shapes(hour.shape, share.shape), complex)
    for peak, half, speed in STORMS:
        flow += speed * shape * np.cos(0.5 * np.pi * np.clip((hour - peak) / half, -1.0, 1.0)) ** 2
    return flow * turn(STORM_BEARING)


def eddies(hour: Array, x: Array, y: Array, coast: Array) -> Array:
    """Mesoscale variability from a random stream function that vanishes at the coast, east + i north, m/s."""
    draw = np.random.default_rng(SEED)
    taper = 1.0 - np.exp(-np.maximum(coast, 0.0) / 20.0)  # judgement
    flow = np.zeros(np.broadcast_shapes(hour.shape, x.shape), complex)
    for _ in range(EDDY_MODES):
        wave = 2 * np.pi / np.exp(draw.uniform(*np.log(EDDY_LENGTHS)))
        towards, phase = draw.uniform(0.0, 2 * np.pi, 2)
        rate = 2 * np.pi / (24.0 * draw.uniform(*EDDY_DAYS))
        # u = -d psi / dy and v = d psi / dx make the flow free of divergence away from the taper.
        rotated = 1j * np.exp(1j * towards)
        flow += rotated * np.cos(wave * (x * np.cos(towards) + y * np.sin(towards)) - rate * hour + phase)
    return flow * taper * EDDY_SPEED * np.sqrt(2.0 / EDDY_MODES)


def currents() -> tuple[Array, Array, Array, Array, Array]:
    """Hours (t,), latitude (j,), longitude (i,), flow east + i north (t, j, i) m/s or NaN, 1-sigma (j, i)."""
    dlat = GRID_KM / KILOMETRES_PER_DEGREE
    dlon = dlat / np.cos(np.radians(MIDDLE))
    latitude = SOUTH + dlat * np.arange(int((NORTH - SOUTH) / dlat) + 1)
    longitude = WEST + dlon * np.arange(int((EAST - WEST) / dlon) + 1)
    lon, lat = np.meshgrid(longitude, latitude)
    x, y = plane(lat, lon)
    coast, edge, share = cross_shelf(lat, lon)
    hours = np.arange(HOURS, dtype=float)
    hour = hours[:, None, None]
    mean = (MEAN_INNER + (MEAN_OUTER - MEAN_INNER) * np.clip(share, 0.0, 1.0)) * turn(DOWN_SHELF)
    mean = mean + MEAN_OFFSHORE * np.clip(coast / 20.0, 0.0, 1.0) * turn(DOWN_SHELF - 90.0)
    flow = mean + tide(hour, share) + inertial(hour, lat, x, y, coast) + storms(hour, share) + eddies(hour, x, y, coast)
    flow = np.where(coast > 0.0, flow, np.nan + 1j * np.nan)
    return hours, latitude, longitude, flow, ERROR_INNER + ERROR_RANGE * np.clip(coast / 200.0, 0.0, 1.0) ** 2


def _axes(file: netCDF4.Dataset, latitude: Array, longitude: Array) -> None:
    """Coordinate variables shared by both files."""
    for name, values, unit, axis in (
        ("lat", latitude, "degrees_north", "Y"),
        ("lon", longitude, "degrees_east", "X"),
    ):
        file.createDimension(name, values.size)
        variable = file.createVariable(name, "f8", (name,))
        variable.setncatts(
            {"standard_name": {"lat": "latitude", "lon": "longitude"}[name], "units": unit, "axis": axis}
        )
        variable[:] = np.round(values, 7)


def _describe(file: netCDF4.Dataset, title: str) -> None:
    """Global attributes; no creation date, so that the same script gives the same file."""
    file.setncatts({
        "Conventions": "CF-1.10", "title": title, "institution": "glider_jax",
        "source": "synthetic: built by formulas in make_default.py from published facts, not observed",
        "license": "CC0-1.0",
        "comment": "An ocean that looks like the New Jersey shelf. Not for navigation.",
    })  # fmt: skip


def write_bathymetry(path: Path) -> None:
    """Write the seafloor as ``depth(lat, lon)``, positive down, packed to 0.1 m."""
    latitude = SOUTH + STEP * np.arange(round((NORTH - SOUTH) / STEP) + 1)
    longitude = WEST + STEP * np.arange(round((EAST - WEST) / STEP) + 1)
    lon, lat = np.meshgrid(longitude, latitude)
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        _axes(file, latitude, longitude)
        depth = file.createVariable("depth", "i2", ("lat", "lon"), zlib=True, complevel=9, fill_value=-32768)
        depth.setncatts({
            "standard_name": "sea_floor_depth_below_geoid", "long_name": "water depth, negative on land",
            "units": "m", "positive": "down", "scale_factor": 0.1, "add_offset": 0.0,
        })  # fmt: skip
        depth[:] = seafloor(lat, lon)
        _describe(file, "Seafloor of the default mission")


def write_currents(path: Path) -> None:
    """Write the surface currents with their 1-sigma errors, packed to 2 mm/s, NaN on land."""
    hours, latitude, longitude, flow, error = currents()
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        file.createDimension("time", hours.size)
        time = file.createVariable("time", "i4", ("time",))
        time.setncatts({
            "standard_name": "time", "units": "hours since 2009-09-05 00:00:00", "calendar": "standard",
            "axis": "T",
        })  # fmt: skip
        time[:] = hours.astype(int)
        _axes(file, latitude, longitude)
        sea = np.isfinite(flow[0].real)
        land = np.broadcast_to(~sea, flow.shape)
        spread = np.broadcast_to(error, flow.shape)
        for direction, values in (("eastward", flow.real), ("northward", flow.imag)):
            for suffix, data, text in (
                ("", values, "current at the surface"),
                ("_error", spread, "1-sigma error"),
            ):
                name = f"{direction}_sea_water_velocity{suffix}"
                modifier = " standard_error" if suffix else ""
                variable = file.createVariable(
                    name, "i2", ("time", "lat", "lon"), zlib=True, complevel=9, fill_value=-32768,
                    chunksizes=(hours.size // 8 + 1, latitude.size, longitude.size),
                )  # fmt: skip
                variable.setncatts({
                    "standard_name": f"surface_{direction}_sea_water_velocity{modifier}",
                    "long_name": f"{direction} {text}", "units": "m s-1",
                    "scale_factor": PACK, "add_offset": 0.0,
                })  # fmt: skip
                if not suffix:
                    variable.ancillary_variables = f"{name}_error"
                variable[:] = np.ma.array(np.where(land, 0.0, data), mask=land)
        _describe(file, "Surface currents of the default mission")


def update_manifest(folder: Path) -> None:
    """Write both checksums and the default mission into ``MANIFEST.json``; other entries stay."""
    target = folder / "MANIFEST.json"
    record = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    files = record.setdefault("files", {})
    for name in (BATHYMETRY, CURRENTS):
        files[name] = {
            "source": "generated by make_default.py from published facts, see the script's comments",
            "licence": "CC0-1.0",
            "sha256": hashlib.sha256((folder / name).read_bytes()).hexdigest(),
        }
    record["default_mission"] = {
        "text": "off Little Egg Inlet to the shelf edge and back",
        "waypoints_latitude_longitude": [list(point) for point in MISSION],
        "start": MISSION_START,
    }
    target.write_text(json.dumps(record, indent=2, sort_keys=True) + "\n", encoding="utf-8")


def make(folder: Path) -> tuple[Path, Path]:
    """Write both files into a folder; returns the paths of the seafloor and the currents."""
    write_bathymetry(folder / BATHYMETRY)
    write_currents(folder / CURRENTS)
    return folder / BATHYMETRY, folder / CURRENTS


def main() -> None:
    """Command line: write the files, and the manifest with them."""
    parser = argparse.ArgumentParser(description="Write the default ocean.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    make(folder)
    update_manifest(folder)


if __name__ == "__main__":
    main()
