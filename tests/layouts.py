"""Tiny copies of the layouts of real current products, written by code with one known flow inside.

Every writer takes a path and returns it. The flow is :func:`truth`, so that any reader of any layout can be asked for
the same numbers; gaps sit where :func:`gap` says. Names, dimensions, units, packing and traps are the products' own.
"""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np

T0 = 1546300800.0  # 2019-01-01T00:00:00Z
LAT = 38.5 + 0.05394 * np.arange(7)
LON = -74.5 + 0.05808 * np.arange(9)
DEPTHS = np.array([0.0, 10.0, 25.0, 60.0])
HOUR = 3600.0


def truth(time, depth, lat, lon):
    """Known flow in m/s, arrays (time, depth, lat, lon); differs along every axis and between the components."""
    time, depth, lat, lon = np.ix_(*(np.atleast_1d(np.asarray(a, float)) for a in (time, depth, lat, lon)))
    lon = (lon + 180.0) % 360.0 - 180.0
    phase = 2 * np.pi * (time - T0) / (12.42 * HOUR)
    decay = np.exp(-depth / 50.0)
    east = decay * (0.20 + 0.10 * np.cos(phase) + 0.05 * (lat - 38.5)) + 0 * lon
    north = decay * (-0.12 + 0.08 * np.sin(phase) + 0.07 * (lon + 74.5)) + 0 * lat
    return east, north


def gap(shape):
    """Cells without a value, (time, depth, lat, lon): a corner always, one cell in the first frame only."""
    missing = np.zeros(shape, bool)
    missing[:, :, :2, :2] = True
    missing[0, :, 4, 5] = True
    return missing


def _coordinates(data, lat, lon, depth=None, *, names=("lat", "lon", "z"), kind="f4", fill=None, positive="down"):
    """Write the space coordinates with CF attributes."""
    entries = [(names[0], lat, "latitude", "degrees_north", "Y"), (names[1], lon, "longitude", "degrees_east", "X")]
    if depth is not None:
        entries.append((names[2], depth, "depth", "m", "Z"))
    for name, values, standard, units, axis in entries:
        data.createDimension(name, len(values))
        options = {} if fill is None else {"fill_value": fill}
        variable = data.createVariable(name, kind, (name,), **options)
        variable.setncatts({"standard_name": standard, "units": units, "axis": axis})
        if axis == "Z":
            variable.positive = positive
        variable.set_auto_maskandscale(False)
        variable[:] = values


def _time(data, raw, units, *, name="time", kind="f8", calendar="gregorian", fill=None):
    """Write the time coordinate; ``raw`` is what is stored."""
    data.createDimension(name, None)
    options = {} if fill is None else {"fill_value": fill}
    variable = data.createVariable(name, kind, (name,), **options)
    variable.setncatts({"standard_name": "time", "units": units})
    if calendar is not None:
        variable.calendar = calendar
    variable.set_auto_maskandscale(False)
    variable[:] = raw


def _field(data, name, kind, dims, stored, fill, **attributes):
    """Write a variable exactly as stored."""
    variable = data.createVariable(name, kind, dims, fill_value=fill)
    variable.setncatts(attributes)
    variable.set_auto_maskandscale(False)
    variable[:] = stored


def _maracoos(path: Path, raw_time, units, seconds, *, kind, calendar, time_fill, coordinate_fill, aggregated):
    """First vintage of the MARACOOS 6 km totals: cm/s as they are, errors as shares of the signal's variance."""
    east, north = (100.0 * part for part in truth(seconds, 0.0, LAT, LON))
    missing = gap(east.shape)
    with netCDF4.Dataset(path, "w") as data:
        _time(data, raw_time, units, kind=kind, calendar=calendar, fill=time_fill)
        _coordinates(data, LAT, LON, [0.0], fill=coordinate_fill)
        dims = ("time", "z", "lat", "lon")
        limits = {"valid_min": np.float32(-300.0), "valid_max": np.float32(300.0)}
        for name, part, side in (("u", east, "eastward"), ("v", north, "northward")):
            standard = f"surface_{side}_sea_water_velocity"
            stored = np.where(missing, -999.0, part)
            _field(data, name, "f4", dims, stored, -999.0, units="cm/s", standard_name=standard, **limits)
            share = np.where(missing, -999.0, 0.25)
            _field(data, f"{name}_err", "f4", dims, share, -999.0, units="1", valid_min=np.float32(0.0))
        _field(data, "uv_covariance", "f4", dims, np.where(missing, -999.0, 0.0), -999.0, units="1")
        data.createDimension("parameters", 8)
        comment = (
            "1) Maximum Total Speed Threshold (cm s-1)\n7) Signal variance of the surface current fields (cm2 s-2)\n"
        )
        parameters = np.array([300.0, 2, 3, 0.0208, 10, 10, 400.0, 66])
        where = ("time", "parameters") if aggregated else ("parameters",)
        _field(data, "processing_parameters", "f8", where, np.broadcast_to(parameters, (len(seconds), 8))
               if aggregated else parameters, -999.0, comment=comment)  # fmt: skip
    return path


def maracoos_v1_hourly(path: Path, hour: int = 0) -> Path:
    """One hour, time in days since 2006; signal variance 400 cm2/s2 in an array of parameters."""
    seconds = np.array([T0 + hour * HOUR])
    days = (seconds - 1136073600.0) / 86400.0
    return _maracoos(path, days, "days since 2006-01-01", seconds, kind="f8", calendar="gregorian", time_fill=None,
                     coordinate_fill=None, aggregated=False)  # fmt: skip


def maracoos_v1_aggregated(path: Path, hours: int = 6) -> Path:
    """Several hours; time, latitude, longitude and z declare 0 as fill value, and the first time and z are 0."""
    seconds = T0 + HOUR * np.arange(hours)
    return _maracoos(path, np.arange(hours), "hours since 2019-01-01 00:00:00", seconds, kind="i8",
                     calendar="proleptic_gregorian", time_fill=0, coordinate_fill=0.0, aggregated=True)  # fmt: skip


def maracoos_v2(path: Path, hour: int = 6) -> Path:
    """Second vintage: cm/s packed with scale 0.01, valid range in packed numbers, quality flags not applied.

    Row 3 carries qc_primary_flag 4, row 5 an u_err of 0.9 without a flag.
    """
    seconds = np.array([T0 + hour * HOUR])
    east, north = (100.0 * part for part in truth(seconds, 0.0, LAT, LON))
    missing = gap(east.shape)
    dims = ("time", "z", "lat", "lon")
    with netCDF4.Dataset(path, "w") as data:
        _time(data, seconds, "seconds since 1970-01-01")
        _coordinates(data, LAT, LON, [0.0], fill=999.0)
        packing = {"scale_factor": 0.01, "valid_min": np.float32(-300.0), "valid_max": np.float32(300.0)}
        share = np.full(east.shape, 0.25)
        share[:, :, 5] = 0.9
        for name, part, side in (("u", east, "eastward"), ("v", north, "northward")):
            standard = f"surface_{side}_sea_water_velocity"
            stored = np.where(missing, -999.0, part)
            _field(data, name, "f4", dims, stored, -999.0, units="m/s", standard_name=standard, **packing)
            _field(data, f"{name}_err", "f4", dims, np.where(missing, -999.0, share), -999.0, units="1")
        _field(data, "uv_covariance", "f4", dims, np.where(missing, -999.0, 0.0), -999.0, units="1")
        flag = np.where(missing, 25, 1)
        flag[:, :, 3] = 4
        _field(data, "qc_primary_flag", "i1", dims, flag, 25, flag_values=np.array([1, 2, 3, 4, 9], "i1"),
               flag_meanings="pass not_evaluated suspect fail missing_data",
               standard_name="surface_eastward_sea_water_velocity status_flag")  # fmt: skip
        scalar = data.createVariable("processing_parameters", "i1")
        scalar.setncatts({"parameter6": np.int16(400), "parameter6_description": "Signal variance (cm2 s-2)"})
    return path


def hfrnet_rtv(path: Path, hours: int = 3) -> Path:
    """National radar network: (time, lat, lon) in m/s packed to 16 bits, dilution of precision, a forecast-run axis."""
    seconds = T0 + HOUR * np.arange(hours)
    east, north = (part[:, 0] for part in truth(seconds, 0.0, LAT, LON))
    missing = gap((hours, 1, LAT.size, LON.size))[:, 0]
    dims = ("time", "lat", "lon")
    with netCDF4.Dataset(path, "w") as data:
        _time(data, (seconds - 1325376000.0) / HOUR, "hours since 2012-01-01 00:00:00.000 UTC", kind="i4")
        _coordinates(data, LAT, LON)
        run = data.createVariable("time_run", "f8", ("time",))
        run.setncatts({"standard_name": "forecast_reference_time", "units": "hours since 2012-01-01T00:00:00Z"})
        run[:] = (seconds - 1325376000.0) / HOUR
        for name, part, side in (("u", east, "eastward"), ("v", north, "northward")):
            stored = np.where(missing, -32768, np.round(part * 100.0))
            standard = f"surface_{side}_sea_water_velocity"
            _field(data, name, "i2", dims, stored, -32768, units="m s-1", standard_name=standard, scale_factor=0.01)
        for name, value in (("DOPx", 0.5), ("DOPy", 1.0)):
            stored = np.where(missing, -32768, round(value * 100))
            _field(data, name, "i2", dims, stored, -32768, units="1", scale_factor=0.01)
    return path


def _bottom(depth, shape):
    """Land in a corner and water that is 30 m deep in the southern rows."""
    missing = np.zeros(shape, bool)
    missing[:, :, :2, :2] = True
    missing[:, np.asarray(depth) > 30.0, :4] = True
    return missing


def cmems(path: Path, frames: int = 4, lat=LAT, lon=LON) -> Path:
    """Copernicus Marine physics: uo and vo packed to 16 bits, 6-hourly, depth down."""
    seconds = T0 + 6 * HOUR * np.arange(frames)
    east, north = truth(seconds, DEPTHS, lat, lon)
    missing = _bottom(DEPTHS, east.shape)
    dims = ("time", "depth", "latitude", "longitude")
    scale = 0.0006103701889514923
    with netCDF4.Dataset(path, "w") as data:
        _time(data, (seconds + 631152000.0) / HOUR, "hours since 1950-01-01", kind="f4")
        _coordinates(data, lat, lon, DEPTHS, names=("latitude", "longitude", "depth"))
        for name, part, side in (("uo", east, "eastward"), ("vo", north, "northward")):
            stored = np.where(missing, -32767, np.round(part / scale))
            standard = f"{side}_sea_water_velocity"
            _field(data, name, "i2", dims, stored, -32767, units="m s-1", standard_name=standard, scale_factor=scale,
                   add_offset=0.0, valid_min=np.int16(-8000), valid_max=np.int16(8000))  # fmt: skip
    return path


def hycom(path: Path, frames: int = 3, lon=None) -> Path:
    """HYCOM: water_u and water_v as millimetres in 16 bits, longitudes 0..360, hours since 2000, a tau variable."""
    seconds = T0 + 3 * HOUR * np.arange(frames)
    lon = np.mod(LON, 360.0) if lon is None else lon
    east, north = truth(seconds, DEPTHS, LAT, lon)
    missing = _bottom(DEPTHS, east.shape)
    with netCDF4.Dataset(path, "w") as data:
        _time(data, (seconds - 946684800.0) / HOUR, "hours since 2000-01-01 00:00:00")
        _coordinates(data, LAT, lon, DEPTHS, names=("lat", "lon", "depth"), kind="f8")
        tau = data.createVariable("tau", "f8", ("time",))
        tau.setncatts({"units": "hours since analysis", "long_name": "Tau"})
        tau[:] = 0.0
        for name, part, side in (("water_u", east, "eastward"), ("water_v", north, "northward")):
            stored = np.where(missing, -30000, np.round(part * 1000.0))
            _field(data, name, "i2", ("time", "depth", "lat", "lon"), stored, -30000, units="m/s",
                   standard_name=f"{side}_sea_water_velocity", scale_factor=np.float32(0.001),
                   add_offset=np.float32(0.0), missing_value=np.int16(-30000))  # fmt: skip
    return path


def globcurrent(path: Path, frames: int = 2) -> Path:
    """GlobCurrent: daily total current without standard names that say which, latitude descending, stated errors."""
    seconds = T0 + 24 * HOUR * np.arange(frames)
    lat = LAT[::-1]
    east, north = (part[:, 0] for part in truth(seconds, 0.0, lat, LON))
    dims = ("time", "lat", "lon")
    with netCDF4.Dataset(path, "w") as data:
        _time(data, (seconds + 631152000.0) / 86400.0, "days since 1950-01-01 00:00:00Z")
        _coordinates(data, lat, LON)
        for side, part in (("eastward", east), ("northward", north)):
            name = f"{side}_eulerian_current_velocity"
            stored = np.round(part * 1000.0)
            _field(data, name, "i2", dims, stored, -32768, units="m s-1", scale_factor=0.001)
            _field(data, f"{name}_error", "i2", dims, np.full(part.shape, 70), -32768, units="m s-1",
                   scale_factor=0.001)  # fmt: skip
            geostrophic = f"{side}_geostrophic_current_velocity"
            _field(data, geostrophic, "i2", dims, stored // 2, -32768, units="m s-1", scale_factor=0.001)
    return path


def european_hfr(path: Path, frames: int = 3) -> Path:
    """European radar totals: EWCT and NSCT with their own errors, QCflag, days since 1950, upper-case axes."""
    seconds = T0 + HOUR * np.arange(frames)
    east, north = truth(seconds, 0.0, LAT, LON)
    missing = gap(east.shape)
    dims = ("TIME", "DEPH", "LATITUDE", "LONGITUDE")
    with netCDF4.Dataset(path, "w") as data:
        _time(data, (seconds + 631152000.0) / 86400.0, "days since 1950-01-01T00:00:00Z", name="TIME")
        _coordinates(data, LAT, LON, [0.0], names=("LATITUDE", "LONGITUDE", "DEPH"))
        for name, part, side in (("EWCT", east, "eastward"), ("NSCT", north, "northward")):
            stored = np.where(missing, -32767, np.round(part * 1000.0))
            _field(data, name, "i2", dims, stored, -32767, units="m s-1", standard_name=f"{side}_sea_water_velocity",
                   scale_factor=0.001)  # fmt: skip
        for name in ("EWCS", "NSCS"):
            _field(data, name, "i2", dims, np.where(missing, -32767, 40), -32767, units="m s-1", scale_factor=0.001)
        flag = np.where(missing, -127, 1)
        flag[:, :, 6, 8] = 4
        _field(data, "QCflag", "i1", dims, flag, -127, flag_values=np.arange(10, dtype="i1"),
               flag_meanings="unknown good_data probably_good_data potentially_correctable_bad_data bad_data "
                             "value_changed not_used not_used interpolated_value missing_value")  # fmt: skip
    return path


LLUV_TOTALS = """%CTF: 1.00
%FileType: LLUV tots "CurrentMap"
%Site: TEST ""
%TimeStamp: 2019 01 01  {hour:02d} 00 00
%TimeZone: "UTC" +0.000 0 "UTC"
%TimeCoverage: 75.000 Minutes
%GridSpacing: 3.000 km
%CurrentVelocityLimit: 100.0 cm/s
%TableType: LLUV TOT4
%TableColumns: 9
%TableColumnTypes: LOND LATD VELU VELV VFLG VELO UQAL VQAL GDOP
%TableRows: {rows}
%TableStart:
%%   Longitude   Latitude    U comp   V comp  VectorFlag   Velocity  Std_U   Std_V     GDOP
{table}
%TableEnd:
%TableType: MRGS src3
%TableColumnTypes: SNDX SITE OLAT OLON
%TableStart: 2
%      1   "AAAA"     42.3190500    3.3158500
%TableEnd: 2
%End:
"""


def lluv_totals(path: Path, hour: int = 0) -> Path:
    """CODAR totals on a 3 km grid: only cells with a vector are listed; three rows carry a bad flag, GDOP and speed."""
    lat = np.round(38.5 + 0.0269796 * np.arange(7), 7)
    lon = np.round(-74.5 + 0.0345 * np.arange(9), 7)
    east, north = (part[0, 0] * 100.0 for part in truth(T0 + hour * HOUR, 0.0, lat, lon))
    rows = []
    for j, i in np.ndindex(lat.size, lon.size):
        if j < 2 and i < 2:
            continue
        flag, gdop, factor = 0, 1.2, 1.0
        if (j, i) == (3, 3):
            flag = 128
        if (j, i) == (3, 4):
            gdop = 25.0
        if (j, i) == (3, 5):
            factor = 20.0
        u, v = east[j, i] * factor, north[j, i] * factor
        rows.append(f"{lon[i]:14.7f} {lat[j]:12.7f} {u:9.3f} {v:9.3f} {flag:5d} {np.hypot(u, v):9.3f}"
                    f" {3.0:8.3f} {4.0:8.3f} {gdop:8.3f}")  # fmt: skip
    path.write_text(LLUV_TOTALS.format(hour=hour, rows=len(rows), table="\n".join(rows)))
    return path
