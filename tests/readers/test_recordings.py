"""Recordings of every kind: units, position formats, repairs, products, errors, and the real sets."""

from __future__ import annotations

import tarfile

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import DataError
from glider_jax.readers.recordings import CHANNELS, UNITS, read_recording
from glider_jax.readers.repairs import Table, Tally, is_nmea, mend_clock, mend_fixes, merge, nmea_to_degrees
from tests.readers.glider_layouts import START, simulate, to_nmea, write_native

SETS = {
    # rows, first and last time, segments in the file, channels that must be there
    "comet2019": (36124, 1565364272.0, 1566416548.0, 4, ("pumped_volume", "current", "magnetic_variation")),
    "osu684_2025": (80366, 1738627536.0, 1739070033.0, 16, ("pumped_volume", "battery_voltage", "angle_of_attack")),
    "ru28_2017": (51362, 1493039284.0, 1493091378.0, 24, ("charge_used", "heading", "final_water_vx")),
    "maria2022": (25073, 1655231363.0, 1655402833.0, 69, ("pumped_volume", "charge_used")),
    "rosie2019": (5594, 1561011654.0, 1561053528.0, 10, ("pumped_volume", "charge_used")),
}


@pytest.fixture
def sim():
    return simulate(dives=1, yos=1)


def repairs(recording):
    return {r.kind: r.count for r in recording.repairs}


def test_native_sensors_become_named_channels_in_si(tmp_path, sim):
    n = sim.time.size
    sim.sensors["m_vacuum"] = np.full(n, 8.0)
    sim.sensors["m_lithium_battery_relative_charge"] = np.full(n, 75.0)
    sim.sensors["m_battpos"] = np.full(n, 0.5)
    got = read_recording(write_native(tmp_path / "x.nc", sim, units={"m_battpos": "in"}))
    flight = np.isin(got.time, sim.time)
    np.testing.assert_allclose(got["depth"][flight], sim.sensors["m_depth"])
    np.testing.assert_allclose(got["pressure"][flight], 1e5 * sim.sensors["m_pressure"])
    np.testing.assert_allclose(got["charge_used"][flight], 3600.0 * sim.sensors["m_coulomb_amphr_total"])
    assert np.nanmax(got["pumped_volume"]) == pytest.approx(200e-6)
    assert got["vacuum"][flight][0] == pytest.approx(27091.1)
    assert got["relative_charge"][flight][0] == pytest.approx(0.75)
    assert got["battery_position"][flight][0] == pytest.approx(0.0127)
    science = np.isfinite(got["temperature"])
    np.testing.assert_allclose(got["temperature"][science], sim.science["sci_water_temp"] + 273.15)
    np.testing.assert_allclose(got["ctd_pressure"][science], 1e5 * sim.science["sci_water_pressure"])
    assert not np.any(science & flight)
    assert np.all(np.diff(got.time) > 0.0)
    # The pump that never moved is not taken for the pump, but kept under its own name.
    assert got.attributes["channel_sources"]["pumped_volume"] == "m_de_oil_vol"
    assert "m_ballast_pumped" in got


def test_the_unit_in_the_file_decides(tmp_path, sim):
    sim.sensors["m_pressure"] *= 10.0
    got = read_recording(write_native(tmp_path / "x.nc", sim, units={"m_pressure": "dbar"}))
    flight = np.isin(got.time, sim.time)
    np.testing.assert_allclose(got["pressure"][flight], 1e4 * sim.sensors["m_pressure"])


def test_a_unit_of_another_kind_is_refused(tmp_path, sim):
    with pytest.raises(DataError, match=r"variable 'm_pressure': expected a unit of Pa, found 'm'"):
        read_recording(write_native(tmp_path / "x.nc", sim, units={"m_pressure": "m"}))


def test_nmea_and_decimal_degrees_give_the_same_positions(tmp_path, sim):
    decimal = read_recording(write_native(tmp_path / "a.nc", sim))
    nmea = read_recording(write_native(tmp_path / "b.nc", sim, nmea=True))
    assert nmea.attributes["position_format"] == "NMEA"
    assert decimal.attributes["position_format"] == "decimal degrees"
    for name in ("latitude", "longitude", "gps_latitude", "gps_longitude"):
        np.testing.assert_allclose(nmea[name], decimal[name], atol=1e-10)
    assert np.nanmax(nmea["gps_longitude"]) < -72.0


def test_positions_near_the_origin_follow_what_the_file_says(tmp_path):
    sim = simulate(dives=1, yos=1, at=(0.5, -0.4))
    silent = read_recording(write_native(tmp_path / "a.nc", sim))
    assert any("within 1.8 degrees" in note for note in silent.source.notes)
    said = read_recording(write_native(tmp_path / "b.nc", sim, nmea=True, attributes={"source": "positions in NMEA"}))
    assert said.attributes["position_format"] == "NMEA"
    np.testing.assert_allclose(said["gps_longitude"], silent["gps_longitude"], atol=1e-10)
    assert np.nanmax(said["gps_longitude"]) < 0.0


@given(st.floats(-180.0, 180.0))
def test_nmea_round_trip(degrees):
    assert nmea_to_degrees(np.array([to_nmea(degrees)]))[0] == pytest.approx(degrees, abs=1e-9)


@pytest.mark.parametrize("value, degrees", [(-30.0, -0.5), (-7040.271, -70.67118333), (1260.0, 13.0)])
def test_nmea_values(value, degrees):
    assert nmea_to_degrees(np.array([value]))[0] == pytest.approx(degrees)


def test_impossible_minutes_are_not_a_position():
    assert np.isnan(nmea_to_degrees(np.array([4561.0]))[0])
    assert is_nmea(np.array([4138.8]), np.array([15.0]), "")[0]


def table(time, **columns):
    time = np.asarray(time, float)
    return Table("x", "flight", time, {k: np.asarray(v, float) for k, v in columns.items()})


def test_one_wild_future_time_costs_one_row():
    tally = Tally()
    time = START + np.array([0.0, 4, 8, 9e5, 12, 16, 20])
    got = mend_clock(table(time), tally)
    np.testing.assert_array_equal(got.time - START, [0, 4, 8, 12, 16, 20])
    assert tally.counts["rows dropped at a clock step"] == 1
    assert tally.counts["clock steps backwards"] == 1


def test_a_clock_set_back_costs_the_smaller_side():
    tally = Tally()
    got = mend_clock(table(START + np.r_[0.0, 100, 104, 108, np.arange(50, 90, 4)]), tally)
    np.testing.assert_array_equal(got.time - START, np.r_[0, np.arange(50, 90, 4)])
    assert tally.counts["rows dropped at a clock step"] == 3


def test_rows_without_time_go_and_are_counted():
    tally = Tally()
    got = mend_clock(table([0.0, np.nan, -5.0, 1e308, START, START + 4]), tally)
    assert got.time.size == 2
    assert tally.counts == {"default records with timestamp 0": 1, "rows without a usable time": 3}


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 400), min_size=1, max_size=60))
def test_mended_clocks_ascend_and_rows_stay_with_their_time(steps):
    time = START + np.array(steps, float)
    tally = Tally()
    got = mend_clock(table(time, v=time), tally)
    assert np.all(np.diff(got.time) >= 0.0) and got.time.size >= 1
    np.testing.assert_array_equal(got.time, got.columns["v"])
    assert time.size - got.time.size == tally.counts.get("rows dropped at a clock step", 0)


def test_repeated_times_are_merged_and_the_first_value_wins():
    tally = Tally()
    a, b = table([1.0, 1, 2]), table([2.0, 3])
    time, channels = merge([a, b], {"v": [np.array([np.nan, 5, 6]), np.array([7.0, 8])]}, tally)
    np.testing.assert_array_equal(time, [1, 2, 3])
    np.testing.assert_array_equal(channels["v"], [5, 6, 8])
    assert tally.counts == {"rows with a repeated time merged": 1, "rows found in more than one file merged": 1}


def fixes(lat, lon, *, status=None, depth=None, step=10.0):
    lat = np.asarray(lat, float)
    time = START + step * np.arange(lat.size)
    channels = {"gps_latitude": lat, "gps_longitude": np.asarray(lon, float)}
    if status is not None:
        channels["gps_status"] = np.asarray(status, float)
    if depth is not None:
        channels["depth"] = np.asarray(depth, float)
    tally = Tally()
    mend_fixes(time, channels, tally)
    assert np.array_equal(np.isnan(channels["gps_latitude"]), np.isnan(channels["gps_longitude"]))
    return np.flatnonzero(np.isnan(channels["gps_latitude"])).tolist(), tally.counts


def test_null_half_and_flagged_fixes_go():
    gone, counts = fixes([0.0, 40, 40, 40, 40], [0.0, np.nan, -73, -73, -73], status=[0, 0, 0, 3, 0])
    assert gone == [0, 1, 3]
    assert counts == {"fixes at 0 N 0 E or with one coordinate": 2, "fixes with a bad status": 1}


def test_a_fix_reported_at_depth_is_an_old_one():
    gone, counts = fixes([40.0] * 4, [-73.0] * 4, depth=[0, 4, 30, 60])
    assert gone == [2, 3] and counts == {"fixes held under water": 2}


def test_a_spike_among_fixes_goes():
    gone, counts = fixes([40, 40.0001, 41, 40.0002, 40.0003], [-73.0] * 5)
    assert gone == [2] and counts == {"fixes that jump": 1}


def test_the_old_position_reported_at_power_up_goes_and_a_real_move_stays():
    gone, _ = fixes([40.02, 40, 40.0001, 40.0002, 40.0003], [-73.0] * 5)
    assert gone == [0]
    # Ten kilometres apart but hours apart too: a dive lay between.
    gone, _ = fixes([40.0, 40.0, 40.0, 40.1, 40.1, 40.1], [-73.0] * 6, step=7200.0)
    assert gone == []


def test_never_set_values_and_null_estimates_become_unknown(tmp_path, sim):
    n = sim.time.size
    extra = {
        "c_wpt_lat": np.zeros(n),
        "c_wpt_lon": np.zeros(n),
        "m_water_vx": np.zeros(n),
        "m_water_vy": np.zeros(n),
        "m_altitude": np.full(n, -1.0),
        "m_dr_time": np.full(n, 7.0),
    }
    extra["c_wpt_lat"][-1], extra["c_wpt_lon"][-1] = 41.0, -72.0
    extra["m_water_vx"][-1], extra["m_altitude"][-1] = 0.1, 12.0
    sim.sensors["m_gps_lat"][3] = 69696969.0
    sim.sensors["m_battery"][4] = 1e308
    sim.sensors["m_heading"][5] = np.inf
    got = read_recording(write_native(tmp_path / "x.nc", sim, extra=extra))
    counts = repairs(got)
    assert counts["never-set values (69696969)"] == 1
    assert counts["never-set values (1e308)"] == 1
    assert counts["infinite values"] == 1
    assert counts["water velocities of exactly zero (no estimate)"] == n - 1
    assert counts["values outside 0.01 to 1000 m: altitude"] == n - 1
    assert counts["positions at 0 N 0 E: waypoint_latitude"] == n - 1
    assert np.isfinite(got["waypoint_latitude"]).sum() == 1
    assert np.nanmax(got["m_dr_time"]) == 7.0  # no name of ours: kept raw


def test_default_science_records_become_unknown(tmp_path, sim):
    for name in sim.science:
        sim.science[name][:3] = 0.0
    got = read_recording(write_native(tmp_path / "x.nc", sim))
    assert repairs(got)["default science records (all zero or timestamp 0)"] == 3
    assert np.nanmin(got["conductivity"]) == 4.0


def test_missing_channels_are_named(tmp_path, sim):
    del sim.sensors["m_pitch"]
    assert "pitch" in read_recording(write_native(tmp_path / "x.nc", sim)).missing


def product(path, dim, columns, *, attributes=None, scalars=None, dims=None):
    """A netCDF product with (values, unit) columns along one dimension."""
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension(dim, len(next(iter(columns.values()))[0]))
        for name, size in (dims or {}).items():
            data.createDimension(name, size)
        for name, value in (attributes or {}).items():
            data.setncattr(name, value)
        for name, (values, unit, *more) in columns.items():
            var = data.createVariable(name, "f8", (dim,) if len(more) < 2 else (more[1],), fill_value=-999.0)
            var.units = unit
            for key, value in (more[0] if more else {}).items():
                var.setncattr(key, value)
            var[:] = values
        for name, (value, unit) in (scalars or {}).items():
            var = data.createVariable(name, "f8", ())
            var.units = unit
            var[...] = value
    return path


SINCE = "seconds since 1970-01-01T00:00:00Z"


def test_pyglider_time_series(tmp_path):
    time = START + 10.0 * np.arange(40)
    heading = np.linspace(0.1, 6.0, 40)
    path = product(
        tmp_path / "dfo-maria997.nc",
        "time",
        {
            "time": (time, SINCE),
            "latitude": (np.full(40, 48.6), "degrees_north"),
            "longitude": (np.full(40, -123.5), "degrees_east"),
            "depth": (np.abs(np.linspace(-30, 30, 40)), "m"),
            "heading": (heading, "degrees", {"source": "m_heading"}),
            "pitch": (np.full(40, -26.0), "degrees"),
            "pressure": (np.full(40, 12.0), "dbar"),
            "temperature": (np.full(40, 9.5), "Celsius"),
            "conductivity": (np.full(40, 3.4), "S m-1"),
            "profile_index": (np.ones(40), "1"),
            "waypoint_latitude": (np.full(40, 48.7), "degree_north"),
            "waypoint_longitude": (np.full(40, -123.4), "degree_east"),
            "water_velocity_eastward": (np.full(40, 0.1), "m s-1", {"source": "m_final_water_vx"}),
        },
    )
    got = read_recording(path)
    assert got.source.product == "pyglider"
    # The unit says degrees, the numbers are the compass's radians.
    np.testing.assert_allclose(got["heading"], heading)
    assert repairs(got)["angles given as degrees that are radians"] == 40
    assert got["pitch"][0] == pytest.approx(np.radians(-26.0))
    assert got["ctd_pressure"][0] == 1.2e5 and got["temperature"][0] == pytest.approx(282.65)
    assert got["waypoint_longitude"][0] == -123.4
    assert "final_water_vx" in got and "depth_averaged_current_east" not in got  # still in the glider's frame
    assert got.attributes["heading_reference"] == "magnetic"
    assert any("magnetic" in note for note in got.source.notes)


def test_og1_with_its_own_axis_of_fixes(tmp_path):
    time = START + 10.0 * np.arange(20)
    path = product(
        tmp_path / "sea045.nc",
        "N_MEASUREMENTS",
        {
            "TIME": (time, SINCE),
            "LATITUDE": (np.full(20, 60.0), "degrees_north"),
            "LONGITUDE": (np.full(20, 5.0), "degrees_east"),
            "DEPTH": (np.linspace(0, 100, 20), "m"),
            "HEADING": (np.full(20, 90.0), "degree", {"comment": "relative to true north"}),
            "PHASE": (np.full(20, 2.0), "1"),
            "TEMP": (np.full(20, 8.0), "degC"),
            "TEMP_QC": (np.r_[4.0, np.ones(19)], "1"),
            "CNDC": (np.full(20, 35.0), "mS/cm"),
            "TIME_GPS": (START + np.array([-5.0, 500.0]), SINCE, {}, "N_GPS"),
            "LATITUDE_GPS": (np.array([60.0, 60.01]), "degrees_north", {}, "N_GPS"),
            "LONGITUDE_GPS": (np.array([5.0, 5.02]), "degrees_east", {}, "N_GPS"),
        },
        dims={"N_GPS": 2},
        attributes={"Conventions": "CF-1.10, ACDD-1.3, OG-1.0"},
    )
    got = read_recording(path)
    assert got.source.product == "OG1.0"
    fix = np.isfinite(got["gps_latitude"])
    np.testing.assert_allclose(got.time[fix] - START, [-5.0, 500.0])
    np.testing.assert_allclose(got["gps_longitude"][fix], [5.0, 5.02])
    assert np.nanmax(got["heading"]) == pytest.approx(np.pi / 2)
    assert got.attributes["heading_reference"] == "true"
    assert np.isfinite(got["temperature"]).sum() == 19  # one flagged bad
    assert np.nanmax(got["conductivity"]) == pytest.approx(3.5)
    assert np.nanmax(got["phase"]) == 2.0


def test_ngdac_profiles_are_joined_with_their_currents(tmp_path):
    for k in range(2):
        time = START + 1000.0 * k + 10.0 * np.arange(10)
        product(
            tmp_path / f"ru28_{k}.nc",
            "time",
            {
                "time": (time, SINCE),
                "lat": (np.full(10, 40.0), "degrees_north"),
                "lon": (np.r_[-73.0, np.full(9, -999.0)], "degrees_east"),
                "depth": (np.linspace(1, 20, 10), "m"),
                "pressure": (np.linspace(1, 20, 10), "dbar"),
                "temperature": (np.full(10, 15.0), "Celsius"),
                "temperature_qc": (np.ones(10), "1"),
            },
            scalars={
                "profile_id": (k, "1"),
                "profile_lat": (40.0, "degrees_north"),
                "time_uv": (START + 1000.0 * k + 50.0, SINCE),
                "u": (0.1 + k, "m s-1"),
                "v": (-0.2, "m s-1"),
            },
        )
    got = read_recording(tmp_path)
    assert got.source.product == "IOOS NGDAC profile"
    assert got.time.size == 20
    known = np.isfinite(got["depth_averaged_current_east"])
    np.testing.assert_allclose(got["depth_averaged_current_east"][known], [0.1, 1.1])
    np.testing.assert_allclose(got.time[known] - START, [50.0, 1050.0])
    assert np.isfinite(got["longitude"]).sum() == 2


DBA = """dbd_label: DBD_ASC(dinkum_binary_data_ascii)file
encoding_ver: 2
num_ascii_tags: 14
all_sensors: 0
filename: ru28-2017-113-3-2-sf
the8x3_filename: 02220002
filename_extension: dbd
filename_label: ru28-2017-113-3-2-dbd(02220002)
mission_name: 30_NW.MI
fileopen_time: Mon_Apr_24_15:33:50_2017
sensors_per_cycle: 5
num_label_lines: 3
num_segments: 1
segment_filename_0: ru28-2017-113-3-2
m_present_time m_depth m_gps_lat m_gps_lon sci_m_present_time sci_water_temp
timestamp m lat lon timestamp degc
8 4 8 8 8 4
1493048009.9 1.5 4018.5 -7351.3 NaN NaN
NaN NaN NaN NaN 1493048010.5 8.25
1493048014.9 2.5 garbage
1493048018.9 3.5 x NaN NaN NaN
1493048022.9 4.5 NaN NaN NaN NaN
"""


def test_ascii_rows_and_garbage(tmp_path):
    path = tmp_path / "ru28_2017_113_3_2_dbd.dat"
    path.write_text(DBA)
    got = read_recording(path)
    np.testing.assert_allclose(got.time - 1493048000.0, [9.9, 10.5, 22.9])
    assert got["gps_latitude"][0] == pytest.approx(40.0 + 18.5 / 60.0)
    assert got["gps_longitude"][0] == pytest.approx(-73.0 - 51.3 / 60.0)
    assert got["temperature"][1] == pytest.approx(281.4)
    assert repairs(got)["garbage rows"] == 2
    assert got.attributes["missions"] == ("30_NW.MI",)


@pytest.mark.parametrize("text", ["", "dbd_label: x\n", "hello\nworld\n", "dbd_label: x\nnum_ascii_tags: 900\n"])
def test_ascii_without_its_header_is_refused(tmp_path, text):
    path = tmp_path / "x.dat"
    path.write_text(text)
    with pytest.raises(DataError, match="begins with 'dbd_label:'"):
        read_recording(path)


def test_a_missing_file_offers_the_nearest_name(tmp_path, sim):
    write_native(tmp_path / "comet2019.nc", sim)
    with pytest.raises(DataError, match=r"comet2018.nc: expected a recording, .* Did you mean 'comet2019.nc'"):
        read_recording(tmp_path / "comet2018.nc")


def test_unusable_paths_are_explained(tmp_path):
    (tmp_path / "x.csv").write_text("a,b")
    with pytest.raises(DataError, match="found the suffix '.csv'"):
        read_recording(tmp_path / "x.csv")
    with pytest.raises(DataError, match="expected a folder with recordings"):
        read_recording(tmp_path)
    (tmp_path / "x.nc").write_text("not netCDF")
    with pytest.raises(DataError, match="does not open"):
        read_recording(tmp_path / "x.nc")


def test_netcdf_without_a_clock_or_known_names_is_refused(tmp_path):
    path = product(tmp_path / "a.nc", "x", {"m_depth": ([1.0], "m")})
    with pytest.raises(DataError, match="expected a time axis"):
        read_recording(path)
    path = product(tmp_path / "b.nc", "time", {"time": ([START], SINCE)})
    with pytest.raises(DataError, match="expected variables such as latitude"):
        read_recording(path)
    path = product(tmp_path / "c.nc", "time", {"wind": ([1.0], "m s-1")})
    with pytest.raises(DataError, match="expected a recording with a variable 'time'"):
        read_recording(path)


def test_nothing_but_garbage_times_is_refused(tmp_path, sim):
    sim.time[:], sim.science_time[:] = -1.0, -1.0
    with pytest.raises(DataError, match="expected rows with times, found none"):
        read_recording(write_native(tmp_path / "x.nc", sim))


def test_every_channel_has_a_unit_that_is_known():
    for name, spec in CHANNELS.items():
        unit = UNITS[spec.native_unit.lower()][0]
        assert unit == spec.unit, name
        assert spec.low < spec.high and spec.text


@pytest.mark.parametrize("name", SETS)
def test_real_sets_load_with_their_repairs_counted(real, name):
    rows, first, last, segments, channels = SETS[name]
    got = read_recording(real("recordings", name, f"{name}.nc"))
    assert got.time.size == rows
    assert got.time[0] == pytest.approx(first, abs=1.0) and got.time[-1] == pytest.approx(last, abs=1.0)
    assert got.segment_start.size == segments
    assert np.all(np.diff(got.time) > 0.0)
    assert set(channels) <= set(got.channels)
    assert all(r.count > 0 for r in got.repairs) and got.repairs
    for key, values in got.channels.items():
        assert values.shape == got.time.shape and np.isfinite(values).any() and not np.isinf(values).any(), key
        if key in CHANNELS:
            assert np.nanmin(values) >= CHANNELS[key].low and np.nanmax(values) <= CHANNELS[key].high
    assert all(len(digest) == 64 for digest in got.source.files.values())


def test_real_ascii_agrees_with_its_netcdf(real, tmp_path):
    with tarfile.open(real("recordings", "ru28_2017", "orig", "ru28_dba.tar.gz")) as archive:
        archive.extractall(tmp_path, filter="data")
    folder = next(p for p in tmp_path.iterdir() if p.is_dir())
    text, nc = read_recording(folder), read_recording(real("recordings", "ru28_2017", "ru28_2017.nc"))
    assert nc.attributes["position_format"] == "decimal degrees" and text.attributes["position_format"] == "NMEA"
    np.testing.assert_allclose(text.time, nc.time, atol=1e-3)
    for key in ("depth", "pitch", "heading", "gps_latitude", "gps_longitude", "charge_used", "final_water_vx"):
        np.testing.assert_allclose(text[key], nc[key], rtol=1e-5, atol=1e-6)


def test_practice_recording_is_read_as_nmea(real):
    case = real().parent / "blind-practice" / "practice1" / "recording.nc"
    if not case.exists():
        pytest.skip("the practice case is not here")
    got = read_recording(case)
    assert got.attributes["position_format"] == "NMEA"
    assert 39.0 < np.nanmin(got["gps_latitude"]) < np.nanmax(got["gps_latitude"]) < 39.5
    assert -74.0 < np.nanmin(got["gps_longitude"]) < np.nanmax(got["gps_longitude"]) < -73.0
    assert np.isfinite(got["waypoint_latitude"]).all()
