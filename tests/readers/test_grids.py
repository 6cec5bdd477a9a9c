"""Shared helpers for gridded files: units, time axes, packing, axes, boxes, and curvilinear weights."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers import grids
from glider_jax.readers.calendars import decode_time, epoch_seconds, iso


@pytest.mark.parametrize(
    ("units", "factor"),
    [("m/s", 1.0), ("m s-1", 1.0), ("m.s-1", 1.0), ("m s^-1", 1.0), ("m s**-1", 1.0), ("meter second-1", 1.0),
     ("meters/second", 1.0), ("metre per second", 1.0), ("cm/s", 0.01), ("cm s-1", 0.01), ("cm/sec", 0.01),
     ("centimeter second-1", 0.01), ("mm/s", 1e-3), ("km/h", 1 / 3.6), ("knots", 1852 / 3600), ("kt", 1852 / 3600),
     (" M/S ", 1.0), ("m s{-1}", 1.0), ("(m/s)", 1.0)],
)  # fmt: skip
def test_speed_units(units, factor):
    assert grids.speed_factor(units, "f") == pytest.approx(factor)


@pytest.mark.parametrize("units", ["degC", "m", "1", "s/m", "m s-2", "m2 s-1", "cm", "", None, "m/fortnight"])
def test_unknown_speed_units_are_refused(units):
    with pytest.raises(DataError, match="expected a"):
        grids.speed_factor(units, "f")


def test_depth_units():
    assert grids.length_factor("meters", "f") == 1.0 and grids.length_factor(None, "f") == 1.0
    assert grids.length_factor("km", "f") == 1000.0
    with pytest.raises(DataError, match="dbar"):
        grids.length_factor("dbar", "f")


EPOCH = 1546300800.0  # 2019-01-01T00:00:00Z


@pytest.mark.parametrize(
    ("raw", "units", "calendar"),
    [(0, "hours since 2019-01-01 00:00:00", "proleptic_gregorian"), (4748, "days since 2006-01-01", "gregorian"),
     (EPOCH, "seconds since 1970-01-01", None), (604848, "hours since 1950-01-01", "standard"),
     (58484, "days", None), (58484, "days since 1858-11-17 00:00:00", None), (20190101, "day as %Y%m%d.%f", None),
     (737426, "days since 0000-01-00 00:00:00", None), (737425, "days since 0000-01-01", None),
     (61368, "hours since 2012-01-01 00:00:00.000 UTC", None), (737059, "days since 0001-01-01", "proleptic_gregorian"),
     (737061, "days since 0001-01-01", "standard"), (2958, "minutes since 2018-12-29T22:42:00Z", None),
     (166560, "hours since 2000-01-01 00:00:00", "gregorian"), (0, "hours since 2018-12-31 19:00:00 -5:00", None)],
)  # fmt: skip
def test_ways_to_write_the_same_moment(raw, units, calendar):
    seconds, _ = decode_time(np.array([raw]), units, calendar, where="f")
    assert iso(seconds[0]) == "2019-01-01T00:00:00Z"


def test_model_calendars_keep_the_dates_by_name():
    seconds, notes = decode_time(np.array([0.0, 58, 59, 60]), "days since 2020-01-01", "noleap", where="f")
    assert [iso(s)[:10] for s in seconds] == ["2020-01-01", "2020-02-28", "2020-03-01", "2020-03-02"]
    assert "noleap" in notes[0]
    seconds, notes = decode_time(np.array([58.0, 59, 60]), "days since 2019-01-01", "360_day", where="f")
    assert np.isnan(seconds[:2]).tolist() == [True, True] and iso(seconds[2])[:10] == "2019-03-01"
    assert "2 dates that do not exist" in notes[0]


def test_fill_values_of_time():
    seconds, notes = decode_time(np.array([0, 1]), "hours since 2019-01-01", where="f", fill=0)
    assert seconds[0] == EPOCH and "fill value" in notes[0]
    seconds, notes = decode_time(np.array([0.0, -999.0, np.nan]), "hours since 2019-01-01", where="f", fill=-999.0)
    assert np.isfinite(seconds).tolist() == [True, False, False] and "2 of 3" in notes[0]


def test_single_precision_times_are_noticed():
    raw = np.array([4748.04], np.float32)
    _, notes = decode_time(raw, "days since 2006-01-01", where="f")
    assert "single precision" in notes[0]


@pytest.mark.parametrize("units", ["", "fortnights since 2019-01-01", "hours", "since 2019", "days since yesterday"])
def test_unknown_times_are_refused(units):
    with pytest.raises(DataError, match="expected"):
        decode_time(np.array([5.0]), units, where="f.nc: variable 'time'")
    with pytest.raises(DataError, match="calendar"):
        decode_time(np.array([5.0]), "days since 2019-01-01", "lunar", where="f")


def test_moments():
    assert epoch_seconds("2019-01-01") == epoch_seconds(np.datetime64("2019-01-01")) == EPOCH
    assert epoch_seconds("2019-01-01T05:00:00+05:00") == EPOCH and epoch_seconds(5) == 5.0


@settings(max_examples=60, deadline=None)
@given(
    start=st.floats(-360, 360), count=st.integers(2, 60), step=st.floats(0.01, 2.0), west=st.sampled_from([-180.0, 0.0])
)
def test_any_regional_longitudes_become_one_ascending_axis(start, count, step, west):
    plain = start + step * np.arange(count)
    stored = west + np.mod(plain - west, 360.0)
    order, axis = grids.longitude_axis(stored, "f")
    assert order.size == count and np.all(np.diff(axis) > 0)
    assert -180.0 - 1e-6 <= axis[0] < 180.0
    assert np.allclose(np.diff(axis), step, atol=1e-6)
    assert np.allclose(np.mod(axis - stored[order] + 180.0, 360.0), 180.0, atol=1e-9)


def test_global_longitudes():
    order, axis = grids.longitude_axis(np.append(np.arange(0, 360, 10.0), 360.0), "f")
    assert axis.size == 36 and axis[0] == -180.0 and axis[-1] == 170.0
    _, axis = grids.longitude_axis(74.16 + 0.08 * np.arange(4500), "f", west=-75.0)
    assert -75.2 < axis[0] < -75.0 and axis.size == 4500 and np.allclose(np.diff(axis), 0.08)
    with pytest.raises(DataError):
        grids.longitude_axis(np.array([0.0, np.nan]), "f")


def test_axes_must_be_monotonic():
    order, values = grids.ascending(np.array([3.0, 2.0, 1.0]), "f")
    assert order.tolist() == [2, 1, 0] and values.tolist() == [1, 2, 3]
    with pytest.raises(DataError, match="found 1 after 2 at index 2"):
        grids.ascending(np.array([1.0, 2.0, 1.0]), "f")
    with pytest.raises(DataError, match="at index 1"):
        grids.ascending(np.array([1.0, np.nan]), "f")


@settings(max_examples=60, deadline=None)
@given(low=st.floats(-1, 9), width=st.floats(0, 5))
def test_a_cut_holds_the_box_and_one_cell_around(low, width):
    axis = np.arange(10.0)
    kept = axis[grids.span(axis, low, low + width)]
    inside = axis[(axis >= low) & (axis <= low + width)]
    assert set(inside) <= set(kept) and len(kept) <= len(inside) + 2
    assert kept.min() <= max(low, 0.0) and kept.max() >= min(low + width, 9.0)


def test_boxes():
    lat, lon = np.arange(30.0, 41.0), np.arange(-80.0, -69.0)
    rows, columns = grids.cut(lat, lon, (33.5, 34.5, 285.5, 286.5), "f")
    assert lat[rows].tolist() == [33, 34, 35] and lon[columns].tolist() == [-75, -74, -73]
    assert grids.check_box((41, 38, -71, -75)) == (38, 41, -75, -71)
    assert grids.check_box((0, 1, 170, -170)) == (0, 1, 170, 190)
    with pytest.raises(CoverageError, match="30.000 to 40.000 N"):
        grids.cut(lat, lon, (45, 46, -75, -74), "f")
    with pytest.raises(DataError, match="box"):
        grids.check_box((100, 101, 0, 1))


def _packed(path, kind, stored, fill=None, **attributes):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("n", len(stored))
        variable = data.createVariable("a", kind, ("n",), fill_value=fill)
        variable.set_auto_maskandscale(False)
        variable.setncatts(attributes)
        variable[:] = np.asarray(stored)
    with grids.open_netcdf(path) as data:
        return grids.unpack(data["a"], data["a"][:])


def test_valid_range_speaks_of_packed_numbers(tmp_path):
    # Packed floats, limits of the packed data: 150 cm/s stay, 310 go.
    values, out = _packed(tmp_path / "a.nc", "f4", [-999, 150, 310], -999.0, scale_factor=0.01,
                          valid_min=np.float32(-300), valid_max=np.float32(300))  # fmt: skip
    assert np.isnan(values[[0, 2]]).all() and values[1] == pytest.approx(1.5) and out == 1
    # Integers with limits in floats: the limits are in real units.
    values, out = _packed(tmp_path / "b.nc", "i2", [150, 310], -999, scale_factor=0.01, valid_max=2.0)
    assert values[0] == pytest.approx(1.5) and np.isnan(values[1]) and out == 1
    values, _ = _packed(tmp_path / "c.nc", "i2", [150, 310], -999, scale_factor=0.01, add_offset=1.0,
                        valid_range=np.array([0, 200], "i2"))  # fmt: skip
    assert values[0] == pytest.approx(2.5) and np.isnan(values[1])


def test_fill_values_of_any_kind(tmp_path):
    values, _ = _packed(tmp_path / "a.nc", "f4", [1e20, -999.9, 2.0], 1e20, missing_value=-999.9)
    assert np.isnan(values[:2]).all() and values[2] == 2.0
    values, _ = _packed(tmp_path / "b.nc", "f4", [9.96921e36, 2.0])
    assert np.isnan(values[0]) and values[1] == 2.0
    values, _ = _packed(tmp_path / "c.nc", "i1", [-127, 2])
    assert values.tolist() == [-127, 2], "bytes have no default fill value"
    values, _ = _packed(tmp_path / "d.nc", "i2", [-2, 2], -1, _Unsigned="true", scale_factor=1.0)
    assert values.tolist() == [65534, 2]


@settings(max_examples=40, deadline=None)
@given(
    angle=st.floats(-np.pi, np.pi), shear=st.floats(-0.4, 0.4), centre=st.sampled_from([-74.0, 0.0, 179.9, 285.0]),
    a=st.floats(-1, 1), b=st.floats(-1, 1),
)  # fmt: skip
def test_linear_fields_pass_unchanged_through_bent_grids(angle, shear, centre, a, b):
    y, x = np.mgrid[-6:7, -8:9] * 0.1
    dx, dy = x + shear * y, y + 0.1 * x**2
    lon = centre + dx * np.cos(angle) - dy * np.sin(angle)
    lat = 40.0 + dx * np.sin(angle) + dy * np.cos(angle)
    new_lon, new_lat = grids.regular_axes(lon, lat)
    turn = np.round((new_lon.mean() - lon.mean()) / 360.0) * 360.0
    stored = np.mod(lon + 180.0, 360.0) - 180.0
    weights = grids.CurvilinearWeights(stored, lat, np.ones(lat.shape, bool), new_lon, new_lat)
    found = weights.apply(a * (lon - centre) + b * (lat - 40.0))
    expected = a * (new_lon[None] - turn - centre) + b * (new_lat[:, None] - 40.0)
    assert weights.inside.mean() > 0.2 and np.array_equal(np.isfinite(found), weights.inside)
    assert np.nanmax(np.abs(found - expected)) < 1e-6


def test_no_value_is_invented_on_land_or_outside():
    y, x = np.mgrid[0:10, 0:10] * 1.0
    sea = x < 5
    weights = grids.CurvilinearWeights(x, y, sea, np.array([-1.0, 2.5, 4.4, 4.6, 8.0]), np.array([4.5]))
    values = np.where(sea, x, 1e9)
    found = weights.apply(np.stack([values, 2 * values]))
    assert weights.valid.tolist() == [[False, True, True, False, False]]
    assert weights.inside.tolist() == [[False, True, True, True, True]]
    assert found[:, 0, 1].tolist() == [2.5, 5.0]
    assert found[0, 0, 2] == pytest.approx(4.0), "land has no weight"
    hole = np.where(y == 4, np.nan, x)
    assert weights.apply(hole)[0, 1] == pytest.approx(2.5), "a missing node is left out"
    with pytest.raises(ValueError, match="trailing dimensions"):
        weights.apply(np.zeros((3, 3)))
    same = grids.regrid_curvilinear(x, y, values, np.array([2.5]), np.array([4.5]), sea)
    assert same.tolist() == [[2.5]]


def test_a_concave_edge_is_not_bridged():
    # A grid bent to a half ring: the middle lies inside its convex hull but in no cell.
    theta, radius = np.meshgrid(np.linspace(0, np.pi, 40), np.linspace(1.0, 1.5, 6))
    lon, lat = radius * np.cos(theta), radius * np.sin(theta)
    weights = grids.CurvilinearWeights(lon, lat, np.ones(lon.shape, bool), np.array([0.0, 1.2]), np.array([0.4, 1.2]))
    assert weights.inside.tolist() == [[False, True], [True, False]]
