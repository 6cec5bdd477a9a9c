"""Currents from every layout we know: the same flow out of each, traps and gaps kept honest, clear refusals."""

from __future__ import annotations

from datetime import UTC, datetime

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.currents import read_currents
from tests import layouts

WRITERS = {
    "maracoos_v1_hourly": (layouts.maracoos_v1_hourly, 1e-6, "MARACOOS"),
    "maracoos_v1_aggregated": (layouts.maracoos_v1_aggregated, 1e-6, "MARACOOS"),
    "hfrnet_rtv": (layouts.hfrnet_rtv, 0.0051, "HFRNet"),
    "cmems": (layouts.cmems, 4e-4, "Copernicus"),
    "hycom": (layouts.hycom, 6e-4, "HYCOM"),
    "globcurrent": (layouts.globcurrent, 6e-4, "GlobCurrent"),
    "european_hfr": (layouts.european_hfr, 6e-4, "European"),
}


def agrees(grid, tolerance):
    """Largest difference from the known flow where the grid has a value stays below the tolerance."""
    east, north = layouts.truth(grid.time, grid.depth, grid.latitude, grid.longitude)
    known = np.isfinite(grid.east)
    assert known.any()
    assert np.abs(grid.east - east)[known].max() < tolerance
    assert np.abs(grid.north - north)[known].max() < tolerance
    return known


@pytest.mark.parametrize("name", WRITERS)
def test_every_layout_gives_the_same_flow(tmp_path, name):
    write, tolerance, product = WRITERS[name]
    grid = read_currents(write(tmp_path / "file.nc"), fill=False)
    agrees(grid, tolerance)
    assert grid.source.product.startswith(product)
    assert np.all(np.diff(grid.latitude) > 0) and np.all(np.diff(grid.longitude) > 0)
    assert abs(grid.time[0] - layouts.T0) < 1.0
    assert grid.longitude[0] == pytest.approx(-74.5, abs=1e-4)
    assert len(grid.source.files) == 1 and len(next(iter(grid.source.files.values()))) == 64


def test_second_vintage_is_scaled_once_and_its_flags_are_applied(tmp_path):
    grid = read_currents(layouts.maracoos_v2(tmp_path / "v2.nc"), fill=False)
    known = agrees(grid, 1e-6)
    assert not known[:, :, 3].any(), "row 3 is flagged as failed"
    assert not known[:, :, 5].any(), "row 5 has an error share of 0.9"
    assert known[:, :, 6].all()
    assert any("9 cells were dropped: 'qc_primary_flag'" in note for note in grid.source.notes)
    assert any("9 cells were dropped: u_err or v_err over 0.6" in note for note in grid.source.notes)


def test_error_shares_become_velocities(tmp_path):
    for write in (layouts.maracoos_v1_hourly, layouts.maracoos_v1_aggregated, layouts.maracoos_v2):
        grid = read_currents(write(tmp_path / f"{write.__name__}.nc"), fill=False)
        assert np.nanmax(grid.east_sd) == pytest.approx(np.sqrt(0.25 * 400e-4))
        assert np.array_equal(np.isfinite(grid.east_sd), np.isfinite(grid.east))
    rtv = read_currents(layouts.hfrnet_rtv(tmp_path / "rtv.nc"), fill=False)
    assert np.nanmax(rtv.north_sd) == pytest.approx(2.0 * np.nanmax(rtv.east_sd))
    hfr = read_currents(layouts.european_hfr(tmp_path / "hfr.nc"), fill=False)
    assert np.nanmax(hfr.north_sd) == pytest.approx(0.04)
    assert not np.isfinite(hfr.east[:, :, 6, 8]).any()
    globe = read_currents(layouts.globcurrent(tmp_path / "glob.nc"), fill=False)
    assert np.nanmax(globe.east_sd) == pytest.approx(0.07)
    assert read_currents(layouts.cmems(tmp_path / "cmems.nc"), fill=False).east_sd is None


def test_hour_zero_is_not_lost_to_a_fill_value_of_zero(tmp_path):
    grid = read_currents(layouts.maracoos_v1_aggregated(tmp_path / "a.nc"), fill=False)
    assert grid.time[0] == layouts.T0 and grid.depth[0] == 0.0
    assert any("fill value" in note for note in grid.source.notes)


def test_hourly_files_are_joined_in_time_order(tmp_path):
    for hour in (2, 0, 1):
        layouts.maracoos_v1_hourly(tmp_path / f"RU_{9 - hour}.nc", hour)
    grid = read_currents(tmp_path, fill=False)
    assert np.array_equal(grid.time, layouts.T0 + 3600.0 * np.arange(3))
    agrees(grid, 1e-6)


def test_vintages_in_cm_and_m_are_consistent_side_by_side(tmp_path):
    files = [layouts.maracoos_v1_hourly(tmp_path / "v1.nc", 5), layouts.maracoos_v2(tmp_path / "v2.nc", 6)]
    grid = read_currents(files[::-1], fill=False)
    assert grid.time.size == 2
    agrees(grid, 1e-6)


def test_frames_given_twice_keep_the_fullest(tmp_path):
    files = [layouts.maracoos_v1_hourly(tmp_path / "v1.nc", 6), layouts.maracoos_v2(tmp_path / "v2.nc", 6)]
    for order in (files, files[::-1]):
        grid = read_currents(order, fill=False)
        assert grid.time.size == 1
        assert np.isfinite(grid.east[0, 0, 3, 3]), "the frame without failed rows is the fuller one"
        assert any("1 frames at a time given twice" in note for note in grid.source.notes)


def test_missing_hours_are_said(tmp_path):
    files = [layouts.maracoos_v1_hourly(tmp_path / f"{hour}.nc", hour) for hour in (0, 1, 2, 5, 6)]
    grid = read_currents(files, fill=False)
    assert any("2 frames are missing; the longest gap is 3.0 h" in note for note in grid.source.notes)


def test_box_is_cut_with_one_cell_of_margin_in_any_longitude_convention(tmp_path):
    path = layouts.hycom(tmp_path / "h.nc")
    lat, lon = layouts.LAT, layouts.LON
    box = (lat[2] + 0.01, lat[4] - 0.01, lon[3] + 0.01, lon[6] - 0.01)
    for turn in (0.0, 360.0):
        grid = read_currents(path, box=(box[0], box[1], box[2] + turn, box[3] + turn), fill=False)
        assert grid.latitude == pytest.approx(lat[2:5])
        assert grid.longitude == pytest.approx(lon[3:7])
        agrees(grid, 6e-4)


def test_global_longitudes_are_one_axis_around_the_box(tmp_path):
    lon = np.arange(0.0, 360.0, 5.0)
    path = layouts.hycom(tmp_path / "globe.nc", lon=lon)
    grid = read_currents(path, box=(38.5, 38.7, -12.0, 12.0), fill=False)
    assert grid.longitude == pytest.approx([-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0])
    agrees(grid, 6e-4)
    across = read_currents(path, box=(38.5, 38.7, 170.0, -170.0), fill=False)
    assert across.longitude == pytest.approx([165.0, 170.0, 175.0, 180.0, 185.0, 190.0, 195.0])
    agrees(across, 6e-4)
    everything = read_currents(path, fill=False)
    assert everything.longitude[0] == -180.0 and everything.longitude.size == lon.size


def test_period_keeps_one_frame_on_either_side(tmp_path):
    path = layouts.maracoos_v1_aggregated(tmp_path / "a.nc", hours=12)
    start = datetime(2019, 1, 1, 3, 10, tzinfo=UTC)
    grid = read_currents(path, period=(start, "2019-01-01T05:00:00Z"), fill=False)
    assert (grid.time - layouts.T0) / 3600.0 == pytest.approx([3, 4, 5, 6])
    agrees(grid, 1e-6)


def test_what_is_covered_only_in_part_is_said(tmp_path):
    path = layouts.maracoos_v1_aggregated(tmp_path / "a.nc")
    grid = read_currents(path, box=(38.6, 39.5, -74.4, -74.2), period=("2019-01-01T02:00", "2019-01-02"), fill=False)
    assert any("cover only 38.554 to 38.824 N" in note for note in grid.source.notes)
    assert any("cover only 2019-01-01T01:00:00Z to 2019-01-01T05:00:00Z" in note for note in grid.source.notes)
    inside = read_currents(path, box=(38.6, 38.7, 285.6, 285.8), period=("2019-01-01T02:00", "2019-01-01T03:00"))
    assert not any("cover only" in note for note in inside.source.notes)


def test_errors_in_velocity_units_are_not_taken_for_shares(tmp_path):
    path = layouts.maracoos_v1_hourly(tmp_path / "a.nc")
    _edit(path, lambda data: [data[name].setncattr("units", "cm/s") for name in ("u_err", "v_err")])
    grid = read_currents(path, fill=False)
    assert np.nanmax(grid.east_sd) == pytest.approx(0.0025)


def test_land_is_told_from_gaps_that_come_and_go(tmp_path):
    model = read_currents(layouts.hycom(tmp_path / "m.nc"), fill=False)
    assert model.sea is not None and (~model.sea).sum() == 4
    radar = layouts.globcurrent(tmp_path / "g.nc")

    def spoil(data):
        data["eastward_eulerian_current_velocity"][0, 1:4, 1] = -32768
        for name in ("eastward", "northward"):
            data.renameVariable(f"{name}_eulerian_current_velocity_error", name)

    assert read_currents(_edit(radar, spoil), fill=False).sea is None


def test_levels_ascend_downward_and_stay_empty_below_the_bottom(tmp_path):
    path = layouts.cmems(tmp_path / "c.nc")
    grid = read_currents(path, fill=False)
    assert grid.depth == pytest.approx(layouts.DEPTHS) and grid.depth_resolved
    assert np.isnan(grid.east[:, 3, :4]).all() and np.isfinite(grid.east[:, 3, 4:]).all()
    assert not grid.sea[:2, :2].any() and grid.sea[2:].all()
    with netCDF4.Dataset(path, "a") as data:
        data["depth"][:] = -layouts.DEPTHS
        data["depth"].positive = "up"
    assert read_currents(path, fill=False).depth == pytest.approx(layouts.DEPTHS)
    with netCDF4.Dataset(path, "a") as data:
        data.set_auto_maskandscale(False)
        data["depth"][:] = -layouts.DEPTHS[::-1]
        for name in ("uo", "vo"):
            data[name][:] = data[name][:][:, ::-1]
    turned = read_currents(path, fill=False)
    assert turned.depth == pytest.approx(layouts.DEPTHS)
    assert np.array_equal(turned.east, grid.east, equal_nan=True)


def test_filling_reaches_the_gaps_and_reports(tmp_path):
    path = layouts.cmems(tmp_path / "c.nc")
    grid = read_currents(path)
    assert np.isfinite(grid.east[:, :, grid.sea]).all()
    assert grid.filled == 0.0, "what persists below the bottom is no filled gap"
    assert np.array_equal(grid.east[:, 3, 2, 3], grid.east[:, 2, 2, 3]), "the deepest value persists"
    radar = read_currents(layouts.maracoos_v1_aggregated(tmp_path / "m.nc"))
    assert radar.sea is None and np.isfinite(radar.east).all() and 0.0 < radar.filled < 0.1


def test_user_names_and_units(tmp_path):
    path = tmp_path / "odd.nc"
    with netCDF4.Dataset(layouts.hycom(tmp_path / "h.nc")) as old, netCDF4.Dataset(path, "w") as new:
        old.set_auto_maskandscale(False)
        for dim in old.dimensions.values():
            new.createDimension(dim.name, dim.size)
        for name, variable in old.variables.items():
            alias = {"water_u": "aa", "water_v": "bb"}.get(name, name)
            copy = new.createVariable(alias, variable.dtype, variable.dimensions)
            copy.set_auto_maskandscale(False)
            drop = ("_FillValue", "standard_name") if alias in ("aa", "bb") else ("_FillValue",)
            drop += ("units",) if alias in ("aa", "bb") else ()
            copy.setncatts({k: variable.getncattr(k) for k in variable.ncattrs() if k not in drop})
            copy[:] = variable[:]
    with pytest.raises(DataError, match="expected eastward and northward currents"):
        read_currents(path)
    names = {"east": "aa", "north": "bb"}
    with pytest.raises(DataError, match="units attribute"):
        read_currents(path, names=names)
    agrees(read_currents(path, names={**names, "units": "m s-1"}, fill=False), 6e-4)
    with pytest.raises(DataError, match=r"'aaa'.*Did you mean 'aa'"):
        read_currents(path, names={"east": "aaa", "north": "bb"})
    with pytest.raises(DataError, match="Did you mean 'east'"):
        read_currents(path, names={"eaast": "aa"})


def _edit(path, change):
    with netCDF4.Dataset(path, "a") as data:
        data.set_auto_maskandscale(False)
        change(data)
    return path


def test_refusals_say_what_to_do(tmp_path):
    path = layouts.hycom(tmp_path / "h.nc")
    _edit(path, lambda data: data["water_v"].setncattr("units", "degC"))
    with pytest.raises(DataError, match="'water_v': expected a unit of speed .* found 'degC'"):
        read_currents(path)
    with pytest.raises(DataError, match=r"nothing there\. Did you mean 'h.nc'"):
        read_currents(tmp_path / "hh.nc")
    (tmp_path / "text.nc").write_text("hello")
    with pytest.raises(DataError, match="found a text file"):
        read_currents(tmp_path / "text.nc")
    (tmp_path / "cut.nc").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(DataError, match="cut short or damaged"):
        read_currents(tmp_path / "cut.nc")
    (tmp_path / "page.nc").write_text("<!DOCTYPE html><p>Error 404")
    with pytest.raises(DataError, match="web page"):
        read_currents(tmp_path / "page.nc")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DataError, match="found none"):
        read_currents(tmp_path / "folder")
    with pytest.raises(DataError, match="at least one file"):
        read_currents([])


def test_a_classic_file_cut_off_is_refused_instead_of_read_as_still_water(tmp_path):
    path = tmp_path / "classic.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        layouts._time(data, [0.0], "hours since 2019-01-01")
        layouts._coordinates(data, layouts.LAT, layouts.LON)
        for name in ("uo", "vo"):
            layouts._field(data, name, "f4", ("time", "lat", "lon"), 0.1, -9.0, units="m/s")
    assert read_currents(path, fill=False).east == pytest.approx(0.1)
    (tmp_path / "cut.nc").write_bytes(path.read_bytes()[:-300])
    with pytest.raises(DataError, match="cut off"):
        read_currents(tmp_path / "cut.nc")
    (tmp_path / "damaged.nc").write_bytes(path.read_bytes()[:40] + b"\xff" * 40 + path.read_bytes()[80:])
    with pytest.raises(DataError, match="damaged|cut off"):
        read_currents(tmp_path / "damaged.nc")


def test_refuses_a_wrong_order_of_dimensions(tmp_path):
    path = tmp_path / "order.nc"
    with netCDF4.Dataset(path, "w") as data:
        layouts._time(data, [0.0], "hours since 2019-01-01")
        layouts._coordinates(data, layouts.LAT, layouts.LON)
        for name in ("uo", "vo"):
            layouts._field(data, name, "f4", ("time", "lon", "lat"), 0.1, -9.0, units="m/s")
    with pytest.raises(
        DataError, match=r"'uo': expected dimensions \(time, depth, lat, lon\), found \(time, lon, lat\)"
    ):
        read_currents(path)


def test_refuses_what_the_file_does_not_cover(tmp_path):
    path = layouts.maracoos_v1_aggregated(tmp_path / "a.nc")
    with pytest.raises(CoverageError, match="50.000 to 51.000 N.*38.500 to 38.824 N"):
        read_currents(path, box=(50, 51, -74, -73))
    with pytest.raises(CoverageError, match="-60.000 to -59.000 E.*-74.500 to -74.035 E"):
        read_currents(path, box=(38.5, 38.6, -60, -59))
    with pytest.raises(CoverageError, match="2020-01-01T00:00:00Z.*2019-01-01T00:00:00Z to 2019-01-01T05:00:00Z"):
        read_currents(path, period=("2020-01-01", "2020-01-02"))
    _edit(path, lambda data: data["u"].__setitem__(slice(None), -999.0))
    _edit(path, lambda data: data["v"].__setitem__(slice(None), -999.0))
    with pytest.raises(CoverageError, match="only land and gaps"):
        read_currents(path)


def test_refuses_files_on_different_grids(tmp_path):
    files = [layouts.cmems(tmp_path / "a.nc"), layouts.cmems(tmp_path / "b.nc", lat=layouts.LAT + 0.02)]
    with pytest.raises(DataError, match=r"b.nc: latitude: expected the 7 values"):
        read_currents(files)


def test_undeclared_fill_values_and_single_components_are_noticed(tmp_path):
    path = layouts.globcurrent(tmp_path / "g.nc")

    def spoil(data):
        data["eastward_eulerian_current_velocity"][0, 1, 1] = -30000
        data["northward_eulerian_current_velocity"][0, 2, 2] = -32768

    grid = read_currents(_edit(path, spoil), fill=False)
    assert any("1 cells faster than 10 m/s" in note for note in grid.source.notes)
    assert any("1 cells hold only one component" in note for note in grid.source.notes)
    assert np.isfinite(grid.east).sum() == grid.east.size - 1
    assert np.isfinite(read_currents(path).north).all()


def test_curvilinear_coordinates_are_regridded(tmp_path):
    path = tmp_path / "bent.nc"
    y, x = np.mgrid[0:20, 0:24]
    lat = 38.0 + 0.05 * y + 0.02 * x
    lon = -75.0 + 0.06 * x - 0.02 * y
    east = 0.2 + 0.1 * (lat - 38.0)
    north = -0.1 + 0.1 * (lon + 75.0)
    with netCDF4.Dataset(path, "w") as data:
        layouts._time(data, [0.0], "hours since 2019-01-01")
        data.createDimension("y", 20)
        data.createDimension("x", 24)
        for name, values, units in (("nav_lat", lat, "degrees_north"), ("nav_lon", lon, "degrees_east")):
            data.createVariable(name, "f8", ("y", "x")).units = units
            data[name][:] = values
        for name, side, values in (("u", "eastward", east), ("v", "northward", north)):
            standard = f"{side}_sea_water_velocity"
            layouts._field(data, name, "f8", ("time", "y", "x"), values[None], -9e9, units="m/s",
                           coordinates="nav_lat nav_lon", standard_name=standard)  # fmt: skip
    grid = read_currents(path, fill=False)
    known = np.isfinite(grid.east[0, 0])
    assert 0.5 < known.mean() < 1.0
    assert np.abs(grid.east[0, 0] - (0.2 + 0.1 * (grid.latitude[:, None] - 38.0)))[known].max() < 1e-9
    assert np.abs(grid.north[0, 0] - (-0.1 + 0.1 * (grid.longitude[None] + 75.0)))[known].max() < 1e-9
    _edit(path, lambda data: data["u"].setncattr("standard_name", "sea_water_x_velocity"))
    _edit(path, lambda data: data["v"].setncattr("standard_name", "sea_water_y_velocity"))
    with pytest.raises(DataError, match="Rotate the components"):
        read_currents(path)


def test_a_file_without_time_holds_at_any_time(tmp_path):
    path = tmp_path / "mean.nc"
    with netCDF4.Dataset(path, "w") as data:
        layouts._coordinates(data, layouts.LAT, layouts.LON)
        for name in ("uo", "vo"):
            layouts._field(data, name, "f4", ("lat", "lon"), 0.1, -9.0, units="cm/s")
    grid = read_currents(path, period=(0.0, 1.0))
    assert grid.constant_in_time and grid.east.shape == (1, 1, 7, 9)
    assert grid.east == pytest.approx(0.001, abs=1e-7)


def test_products_of_different_kinds_are_not_mixed(tmp_path):
    files = [layouts.maracoos_v1_hourly(tmp_path / "a.nc"), layouts.lluv_totals(tmp_path / "b.tuv")]
    with pytest.raises(DataError, match="b.tuv: expected a NetCDF file on a fixed grid like a.nc, found CODAR text"):
        read_currents(files)


# Real files, each against a raw read that shares no code with the reader.


def _raw(path, name):
    """Values as stored, in float64."""
    with netCDF4.Dataset(path) as data:
        data.set_auto_maskandscale(False)
        return np.asarray(data[name][:], float)


def _same_as_raw(grid, path, factor, keep=None):
    """Every stored value that is neither -999 nor NaN is in the grid, times the factor, and nothing else."""
    for field, name in ((grid.east, "u"), (grid.north, "v")):
        raw = _raw(path, name).reshape(field.shape)
        good = (raw != -999.0) & np.isfinite(raw)
        if keep is not None:
            good &= keep
        assert np.array_equal(np.isfinite(field), good)
        assert np.allclose(field[good], raw[good] * factor, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    "name", ["20180301T000000Z-20180301T120000Z_aggregated.nc", "20190101T000000Z-20190101T230000Z_aggregated.nc",
             "derived_nj_20190101_24h.nc"]
)  # fmt: skip
def test_real_totals_of_the_first_vintage(real, name):
    path = real("environment", "maracoos_hfr", name)
    grid = read_currents(path, fill=False)
    _same_as_raw(grid, path, 0.01)
    day = datetime(2018, 3, 1, tzinfo=UTC) if "2018" in name else datetime(2019, 1, 1, tzinfo=UTC)
    assert grid.time == pytest.approx(day.timestamp() + 3600.0 * np.arange(grid.time.size), abs=1e-3)
    share = _raw(path, "u_err")
    assert np.nanmax(np.abs(grid.east_sd**2 - share * 420e-4)) < 1e-9


def test_real_hourly_files_equal_the_aggregated_one(real):
    folder = real("environment", "maracoos_hfr", "hourly_20190101")
    one = read_currents(
        real("environment", "maracoos_hfr", "20190101T000000Z-20190101T230000Z_aggregated.nc"), fill=False
    )
    grid = read_currents(folder, fill=False)
    assert grid.time == pytest.approx(one.time[: grid.time.size])
    assert np.array_equal(grid.east, one.east[: grid.time.size], equal_nan=True)
    for index, path in enumerate(sorted(folder.glob("*.nc"))):
        raw = _raw(path, "v")[0]
        assert np.array_equal(np.isfinite(grid.north[index]), raw != -999.0)


def test_real_totals_of_the_second_vintage(real):
    path = real("environment", "maracoos_hfr", "hfr_rtv_midatl_6km_oi_maracoos_2022_02_21_1200.nc")
    grid = read_currents(path, fill=False)
    flag = _raw(path, "qc_primary_flag")
    assert grid.time[0] == datetime(2022, 2, 21, 12, tzinfo=UTC).timestamp()
    _same_as_raw(grid, path, 0.01, keep=flag == 1)
    assert any("2123 cells were dropped: 'qc_primary_flag'" in note for note in grid.source.notes)
    assert 0.5 < np.nanmax(np.hypot(grid.east, grid.north)) < 2.0


def test_real_vintages_side_by_side(real):
    names = ("derived_nj_20190101_24h.nc", "hfr_rtv_midatl_6km_oi_maracoos_2022_02_21_1200.nc")
    grid = read_currents([real("environment", "maracoos_hfr", n) for n in names], box=(39, 40, -74, -72), fill=False)
    speed = np.sqrt(np.nanmean(grid.east**2 + grid.north**2, axis=(1, 2, 3)))
    assert grid.time.size == 25 and np.all((speed > 0.05) & (speed < 0.5))


def test_real_files_without_currents_are_refused(real):
    for parts, message in (
        (("wind_waves", "derived_ndbc_44025_2017.nc"), "expected eastward and northward currents"),
        (("maracoos_hfr", "tuv_oi_MARA_2019_01_01_1200.mat"), "found a MATLAB file"),
        (("maracoos_hfr", "MARACOOS_6kmMask.txt"), "found a text file"),
        (("maracoos_hfr", "maracoos_codar_sites_2018.txt"), "found a text file"),
        (("maracoos_hfr", "maracoos_grid_6km_extended.txt"), "found a text file"),
    ):
        with pytest.raises(DataError, match=message):
            read_currents(real("environment", *parts))


def test_real_roms_files_are_handed_on(real):
    folder = real("environment", "roms_coawst_sandy")
    files = sorted(folder.glob("coawst_clm_*.nc"))
    # The climatology holds neither mask nor vertical coordinate: they come from the grid and the initial file.
    given = [*files[:2], folder / "Sandy_ini.nc"]
    grid = read_currents(given, grid=folder / "Sandy_roms_grid.nc", box=(38.5, 40, -74, -72), fill=False)
    assert grid.depth_resolved and grid.time.size >= 2
    assert np.nanmax(np.abs(grid.east)) < 3.0
    with pytest.raises(DataError):
        read_currents(folder / "tide_forc_Sandy.nc")


def test_practice_currents_with_independent_gaps(real):
    path = real().parent / "blind-practice" / "practice1" / "currents.nc"
    if not path.exists():
        pytest.skip("no practice case here")
    grid = read_currents(path, fill=False)
    _same_as_raw(type("Squeezed", (), {"east": grid.east[:, 0], "north": grid.north[:, 0]}), path, 0.01)
    filled = read_currents(path)
    assert np.isfinite(filled.east).all() and np.isfinite(filled.north).all()
    assert 0.02 < filled.filled < 0.2
