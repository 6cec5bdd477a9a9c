"""Station tides: arguments against an independent program, and against the phases of the ROMS forcing file."""

from __future__ import annotations

import json

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.readers.tide_stations import BASIC, COMPOUND, read_tide_station, tidal_argument, tide_height

STATIONS = ("noaa_8510560", "noaa_8531680", "noaa_8534720", "noaa_8536110", "noaa_8557380")
DAY = 86400.0
#: (V + u in degrees, f) by utide 0.4.0 at 06:00 UTC, latitude 39.4, from 2012-10-28, 2019-01-01, 2025-07-15.
UTIDE = {
    "M2": ((229.3, 1.019), (300.9, 1.018), (64.4, 0.964)),
    "S2": ((179.9, 0.999), (180.1, 0.999), (180.0, 1.002)),
    "N2": ((101.2, 1.018), (218.3, 1.014), (115.8, 0.964)),
    "K2": ((269.6, 0.867), (5.0, 0.882), (49.1, 1.311)),
    "K1": ((45.1, 0.948), (92.2, 0.958), (294.5, 1.112)),
    "O1": ((180.0, 0.922), (213.1, 0.932), (129.2, 1.180)),
    "Q1": ((51.8, 0.901), (129.8, 0.940), (181.5, 1.198)),
    "M4": ((98.6, 1.039), (241.9, 1.037), (128.9, 0.930)),
    "MK3": ((274.4, 0.966), (33.2, 0.975), (358.9, 1.072)),
    "L2": ((172.8, 1.205), (214.1, 1.108), (172.1, 1.020)),
}
TIMES = np.array([1351382400.0, 1546300800.0, 1752537600.0]) + 0.25 * DAY


def apart(a, b):
    """Angle differences in degrees, between -180 and 180."""
    return (np.asarray(a) - np.asarray(b) + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("name", UTIDE)
def test_arguments_and_nodal_factors_match_utide(name):
    """Within 1 degree and 2 %, over half a turn of the lunar node."""
    argument, factor = tidal_argument(name, TIMES)
    angles, sizes = np.array(UTIDE[name]).T
    assert np.abs(apart(np.degrees(argument), angles)).max() < 1.0
    assert np.abs(factor - sizes).max() < 0.02


@pytest.mark.parametrize(
    ("name", "hours"),
    [("M2", 12.4206012), ("K1", 23.93447213), ("S2", 12.0), ("MF", 327.8599387), ("2MK3", 8.38630297), ("SA", 8765.82)],
)
def test_speeds(name, hours):
    """An argument turns once per period, apart from the slow nodal angle."""
    start = TIMES[1]
    turns = np.diff(np.unwrap(tidal_argument(name, start + np.linspace(0, 60 * DAY, 4000))[0]).take([0, -1])) / (
        2 * np.pi
    )
    assert turns[0] == pytest.approx(60 * 24 / hours, abs=2e-3)


def write_station(path, constituents, **extra):
    """A station file in the layout of the tide database."""
    rows = [{"name": n, "amplitude": a, "phase": p} for n, a, p in constituents]
    record = {"name": "Test", "latitude": 39.0, "longitude": -74.0, "harmonic_constituents": rows} | extra
    path.write_text(json.dumps(record))
    return path


def test_height_of_one_constituent(tmp_path):
    """High water of S2 with phase 90 degrees comes three hours after midnight, whatever the node."""
    path = write_station(tmp_path / "s.json", [("S2", 0.5, 90.0), ("M1", 0.003, 0.0), ("M4", 0.0, 0.0)])
    station = read_tide_station(path)
    assert station.constituents == ("S2",) and "M1 (0.003 m)" in station.source.notes[0]
    midnight = 1546300800.0
    heights = tide_height(station, midnight + 3600.0 * np.array([0.0, 3.0, 6.0, 9.0, 12.0]))
    np.testing.assert_allclose(heights, [0.0, 0.5, 0.0, -0.5, 0.0], atol=2e-3)
    assert tide_height(station, midnight).shape == ()
    assert np.isnan(station.mean_level)


def test_bad_stations_are_explained(tmp_path):
    """Absent, foreign, incomplete and subordinate files."""
    with pytest.raises(DataError, match="Check the path"):
        read_tide_station(tmp_path / "nowhere.json")
    text = tmp_path / "text.json"
    text.write_text("hello")
    with pytest.raises(DataError, match="expected JSON"):
        read_tide_station(text)
    text.write_text('{"latitude": 1, "longitude": 2}')
    with pytest.raises(DataError, match="harmonic_constituents"):
        read_tide_station(text)
    with pytest.raises(DataError, match="Subordinate stations have none"):
        read_tide_station(write_station(tmp_path / "sub.json", []))
    with pytest.raises(DataError, match="found 'X9'"):
        tidal_argument("X9", 0.0)


def test_every_constituent_is_finite():
    """All known constituents give an argument and a positive factor over a nodal cycle."""
    time = TIMES[0] + 0.5 * 365.25 * DAY * np.arange(38)
    for name in (*BASIC, *COMPOUND):
        argument, factor = tidal_argument(name, time)
        assert np.isfinite(argument).all() and (factor > 0.2).all() and (factor < 2.5).all()


@pytest.mark.parametrize("name", STATIONS)
def test_real_stations(real, name):
    """Mean range within 5 % of the datum sheet, mean level above chart datum as published."""
    path = real("environment", "tides", f"{name}.json")
    station = read_tide_station(path)
    datums = json.loads(path.read_text())["datums"]
    assert len(station.constituents) >= 32
    assert station.mean_level == pytest.approx(datums["MSL"] - datums["MLLW"], abs=1e-9)
    # A whole year, so that springs, neaps and perigees weigh as they should.
    time = TIMES[1] + 360.0 * np.arange(365 * 240)
    height = tide_height(station, time)
    turn = np.diff(np.sign(np.diff(height)))
    high, low = height[1:-1][turn < 0], height[1:-1][turn > 0]
    assert high.mean() - low.mean() == pytest.approx(datums["MN"], rel=0.06)


def test_two_producers_agree(real):
    """NOAA and TICON constants of Atlantic City predict the same tide to 5 cm rms, the seasonal part aside."""
    stations = [real("environment", "tides", f"{n}.json") for n in ("noaa_8534720", "ticon_atlantic_city-8534720")]
    time = TIMES[1] + 3600.0 * np.arange(24 * 29)
    first, second = (tide_height(read_tide_station(path), time) for path in stations)
    assert np.std(first - second) < 0.05 < 0.1 * np.ptp(first)


def test_roms_forcing_counts_from_its_reference_with_arguments_included(real):
    """At Atlantic City the phases of the forcing file are those of the station less V + u at its reference time."""
    station = read_tide_station(real("environment", "tides", "noaa_8534720.json"))
    with (
        netCDF4.Dataset(real("environment", "roms_coawst_sandy", "Sandy_roms_grid.nc")) as grid,
        netCDF4.Dataset(real("environment", "roms_coawst_sandy", "tide_forc_Sandy.nc")) as tide,
    ):
        lon, lat = grid["lon_rho"][:], grid["lat_rho"][:]
        wet = (grid["mask_rho"][:] > 0.5) & (tide["tide_Eamp"][3] > 0)
        distance = np.where(wet, np.hypot((lon - station.longitude) * 0.77, lat - station.latitude), np.inf)
        j, i = np.unravel_index(distance.argmin(), distance.shape)
        phases, sizes = tide["tide_Ephase"][:, j, i], tide["tide_Eamp"][:, j, i]
    for row, name in ((0, "K1"), (3, "M2"), (4, "S2"), (5, "N2"), (6, "K2")):
        argument, factor = tidal_argument(name, 1351382400.0)
        at = station.constituents.index(name)
        expected = np.degrees(station.phase[at] - argument)
        assert abs(apart(float(phases[row]), float(expected))) < 10.0
        assert float(sizes[row]) == pytest.approx(float(station.amplitude[at] * factor), rel=0.2)
