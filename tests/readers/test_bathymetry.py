"""Bathymetry readers: every layout met in the field, the sign of the depth, and files that are something else."""

from __future__ import annotations

import io
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from scipy.io import savemat

from glider_jax.errors import CoverageError, DataError, GliderJaxError
from glider_jax.readers.bathymetry import merge_bathymetry, read_bathymetry
from glider_jax.records import BathymetryGrid, Source
from tests.readers.bathymetry_layouts import LAT, LON, UP, at, rows, write

# -- layouts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "layout",
    [
        {"name": "Band1", "kind": "i2", "fill": -32767},
        {"name": "z", "kind": "i4", "fill": -2147483648, "lat_name": "y", "lon_name": "x",
         "lat_units": "degrees", "lon_units": "degrees", "units": ""},
        {"name": "z", "attributes": {"positive": "up", "standard_name": "height"}, "units": "meters"},
        {"name": "elevation", "kind": "i2", "attributes": {"scale_factor": 1.0, "add_offset": 0.0},
         "file_format": "NETCDF3_CLASSIC"},
        {"name": "topo", "attributes": {"standard_name": "altitude"}, "lat_name": "latitude",
         "lon_name": "longitude"},
        {"name": "z", "dims": ("lon", "lat")},
        {"name": "seabed", "attributes": {"long_name": "Topography"}},
    ],
)  # fmt: skip
def test_elevation_becomes_depth(tmp_path, layout):
    grid = read_bathymetry(write(tmp_path / "a.nc", **layout))
    np.testing.assert_allclose(grid.depth, -UP)
    np.testing.assert_allclose(grid.latitude, LAT)
    np.testing.assert_allclose(grid.longitude, LON)
    assert len(next(iter(grid.source.files.values()))) == 64


@pytest.mark.parametrize(
    "layout",
    [
        {"name": "bathymetry", "lat_name": "latc", "lon_name": "lonc"},
        {"name": "depth", "attributes": {"positive": "down"}},
        {"name": "whatever", "attributes": {"standard_name": "sea_floor_depth_below_geoid"}},
        {"name": "h", "lat_name": "latitude", "lon_name": "longitude"},
    ],
)
def test_depth_positive_down_stays(tmp_path, layout):
    np.testing.assert_allclose(read_bathymetry(write(tmp_path / "a.nc", -UP, **layout)).depth, -UP)


def test_descending_latitude_and_longitudes_to_360(tmp_path):
    path = write(tmp_path / "a.nc", UP[::-1], lat=LAT[::-1], lon=LON + 360.0)
    grid = read_bathymetry(path)
    np.testing.assert_allclose(grid.depth, -UP)
    np.testing.assert_allclose(grid.longitude, LON)
    boxed = read_bathymetry(path, box=(39.1, 39.9, 286.1, 286.9))
    assert boxed.longitude[0] == pytest.approx(286.0) and at(boxed, 39.5, 286.5) == 50.0


def test_global_grid_is_cut_at_the_antimeridian_and_its_double_column_taken_once(tmp_path):
    lon = np.arange(0.0, 361.0, 30.0)
    values = -np.tile(100.0 + (lon % 360.0), (4, 1))
    path = write(tmp_path / "a.nc", values, lon=lon)
    grid = read_bathymetry(path)
    assert grid.longitude[0] == -180.0 and grid.longitude.size == 12
    np.testing.assert_allclose(grid.depth[0], 100.0 + grid.longitude % 360.0)
    seam = read_bathymetry(path, box=(39.2, 40.2, 150.0, 210.0))
    np.testing.assert_allclose(seam.longitude, [120.0, 150.0, 180.0, 210.0, 240.0])
    greenwich = read_bathymetry(path, box=(39.2, 40.2, -31.0, 31.0))
    np.testing.assert_allclose(greenwich.longitude, [-60.0, -30.0, 0.0, 30.0, 60.0])
    np.testing.assert_allclose(greenwich.depth[0], [400.0, 430.0, 100.0, 130.0, 160.0])


def test_only_the_box_is_read_with_a_cell_of_margin(tmp_path):
    grid = read_bathymetry(write(tmp_path / "a.nc"), box=(39.6, 39.9, -73.4, -73.1))
    np.testing.assert_allclose(grid.latitude, [39.5, 40.0])
    np.testing.assert_allclose(grid.longitude, [-73.5, -73.0])
    part = read_bathymetry(write(tmp_path / "a.nc"), box=(38.0, 39.4, -74.5, -73.6))
    assert any("less than the area" in note for note in part.source.notes)


def test_fills_packing_and_valid_range(tmp_path):
    packed = np.where(UP > 0, -999, np.round((UP + 100.0) / 0.5)).astype("i2")
    path = write(tmp_path / "a.nc", packed, kind="i2", fill=-999,
                 attributes={"scale_factor": 0.5, "add_offset": -100.0, "missing_value": np.int16(-998)})  # fmt: skip
    grid = read_bathymetry(path)
    np.testing.assert_allclose(grid.depth, np.where(UP > 0, np.nan, -UP))
    assert any("2 of 12 values are missing" in note for note in grid.source.notes)
    values = np.where(UP > 0, -10.0, -UP)
    ranged = write(tmp_path / "b.nc", values, name="bathymetry", attributes={"valid_range": [-5.0, 4000.0]})
    np.testing.assert_allclose(read_bathymetry(ranged).depth, np.where(UP > 0, np.nan, -UP))
    undeclared = write(tmp_path / "c.nc", np.where(UP > 0, 99999.0, UP))
    grid = read_bathymetry(undeclared)
    assert np.isnan(grid.depth).sum() == 2 and any("2 values beyond" in note for note in grid.source.notes)


def test_units_other_than_metres(tmp_path):
    path = write(tmp_path / "a.nc", UP / 1000.0, units="km")
    np.testing.assert_allclose(read_bathymetry(path).depth, -UP, rtol=1e-6)
    np.testing.assert_allclose(read_bathymetry(path, names={"units": "m"}).depth, -UP / 1000.0, rtol=1e-6)
    with pytest.raises(DataError, match="dbar"):
        read_bathymetry(write(tmp_path / "b.nc", units="dbar"))


def test_the_old_gmt_layout(tmp_path):
    with netCDF4.Dataset(tmp_path / "a.grd", "w", format="NETCDF3_CLASSIC") as file:
        file.createDimension("side", 2)
        file.createDimension("xysize", UP.size)
        for name, values in (("x_range", LON[[0, -1]]), ("y_range", LAT[[0, -1]])):
            file.createVariable(name, "f8", ("side",))[:] = values
        file.createVariable("dimension", "i4", ("side",))[:] = (LON.size, LAT.size)
        z = file.createVariable("z", "f4", ("xysize",))
        z.node_offset = np.int32(0)
        z[:] = UP[::-1].ravel()
    grid = read_bathymetry(tmp_path / "a.grd")
    np.testing.assert_allclose(grid.depth, -UP)
    np.testing.assert_allclose(grid.longitude, LON)
    assert at(read_bathymetry(tmp_path / "a.grd", box=(39.4, 39.6, -73.6, -73.4)), 39.5, -73.0) == 300.0


def test_a_curvilinear_grid_comes_out_on_regular_axes(tmp_path):
    j, i = np.meshgrid(np.arange(12.0), np.arange(15.0), indexing="ij")
    lat, lon = 39.0 + 0.1 * (j * 0.9 + i * 0.3), -74.0 + 0.12 * (i * 0.9 - j * 0.3)
    with netCDF4.Dataset(tmp_path / "a.nc", "w") as file:
        file.createDimension("y", 12)
        file.createDimension("x", 15)
        for name, values, unit in (("lat", lat, "degrees_north"), ("lon", lon, "degrees_east")):
            variable = file.createVariable(name, "f8", ("y", "x"))
            variable.units = unit
            variable[:] = values
        depth = file.createVariable("depth", "f4", ("y", "x"))
        depth.positive = "down"
        depth[:] = 50.0 + 10.0 * (lat - 39.0) + 20.0 * (lon + 74.0)
    grid = read_bathymetry(tmp_path / "a.nc")
    expected = 50.0 + 10.0 * (grid.latitude[:, None] - 39.0) + 20.0 * (grid.longitude + 74.0)
    known = np.isfinite(grid.depth)
    assert known.mean() > 0.4
    np.testing.assert_allclose(grid.depth[known], expected[known], atol=0.05)


# -- which way is up ---------------------------------------------------------------------------------------------


def test_a_depth_that_is_mostly_negative_is_elevation_and_said_so(tmp_path):
    grid = read_bathymetry(write(tmp_path / "a.nc", name="depth"))
    np.testing.assert_allclose(grid.depth, -UP)
    assert any("mostly negative" in note for note in grid.source.notes)


def test_a_depth_that_is_half_land_is_not_guessed(tmp_path):
    values = np.array([[30.0, -20.0, -25.0], [10.0, -8.0, -30.0], [15.0, -9.0, -20.0], [-5.0, -3.0, -1.0]])
    path = write(tmp_path / "a.nc", values, name="depth")
    with pytest.raises(DataError, match="names="):
        read_bathymetry(path)
    np.testing.assert_allclose(read_bathymetry(path, names={"positive": "up"}).depth, -values)
    np.testing.assert_allclose(read_bathymetry(path, names={"positive": "down"}).depth, values)


def test_an_unknown_name_with_both_signs_is_not_guessed(tmp_path):
    path = write(tmp_path / "a.nc", name="field", units="")
    with pytest.raises(DataError, match="'field'.*up or down"):
        read_bathymetry(path)
    np.testing.assert_allclose(read_bathymetry(path, names={"positive": "up"}).depth, -UP)


def test_values_of_one_sign_are_water(tmp_path):
    deep = np.abs(UP) + 1.0
    assert read_bathymetry(write(tmp_path / "a.nc", deep)).depth.min() > 0
    assert read_bathymetry(write(tmp_path / "b.nc", -deep, name="depth")).depth.min() > 0
    assert read_bathymetry(write(tmp_path / "c.nc", -deep, name="field")).depth.min() > 0
    with pytest.raises(DataError, match="land"):
        read_bathymetry(write(tmp_path / "d.nc", deep, name="elevation"))
    with pytest.raises(DataError, match="land"):
        read_bathymetry(write(tmp_path / "e.nc", -deep, attributes={"positive": "down"}))


def test_attributes_win_over_the_name(tmp_path):
    path = write(tmp_path / "a.nc", -UP, name="elevation", attributes={"positive": "down"})
    np.testing.assert_allclose(read_bathymetry(path).depth, -UP)


# -- joining -----------------------------------------------------------------------------------------------------


def _plane(lat, lon, offset=0.0):
    depth = 10.0 + 5.0 * (lat[:, None] - 38.0) + 3.0 * (lon + 75.0) + offset
    return BathymetryGrid(lat, lon, depth, Source("made", {f"{lat[0]}": "x"}, ("from one volume",)))


def test_merging_closes_the_seam_of_two_volumes():
    lon = np.arange(-75.0, -74.0, 0.05)
    south = _plane(np.arange(39.0, 39.99, 0.05), lon)
    north = _plane(np.arange(40.0, 40.5, 0.05), lon + 0.02)
    merged = merge_bathymetry([south, north])
    assert merged.latitude[0] == pytest.approx(39.0) and merged.latitude[-1] >= 40.4
    inner = merged.depth[:, 1:-1]
    assert np.isfinite(inner).all()
    expected = 10.0 + 5.0 * (merged.latitude[:, None] - 38.0) + 3.0 * (merged.longitude + 75.0)
    # Beside the seam the nearest row of one volume is held for less than a step: 0.05 degree x 5 m.
    assert np.abs(inner - expected[:, 1:-1]).max() <= 0.26
    assert len(merged.source.files) == 2


def test_merging_prefers_the_first_and_leaves_real_gaps():
    lat, lon = np.arange(39.0, 40.01, 0.1), np.arange(-75.0, -74.0, 0.1)
    first = _plane(lat, lon, 100.0)
    merged = merge_bathymetry([first, _plane(lat, lon)])
    np.testing.assert_allclose(merged.depth, first.depth)
    apart = merge_bathymetry([first, _plane(lat + 3.0, lon)])
    assert np.isnan(apart.depth[np.abs(apart.latitude - 41.5).argmin()]).all()
    with pytest.raises(DataError, match="at least one"):
        merge_bathymetry([])


# -- bad input ---------------------------------------------------------------------------------------------------


def test_missing_file_offers_the_nearest(tmp_path):
    write(tmp_path / "gebco_2014.nc")
    with pytest.raises(DataError, match="Did you mean 'gebco_2014.nc'"):
        read_bathymetry(tmp_path / "gebco_2015.nc")
    with pytest.raises(DataError, match="found none there"):
        read_bathymetry(tmp_path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"II*\x00" + b"\x00" * 200, "GeoTIFF"),
        (b"RDX2\nX\n" + b"\x00" * 20, "R session"),
        (b"\x1f\x8b\x08" + b"\x00" * 20, "gzip.*rda"),
        (b"BZh91AY" + b"\x00" * 20, "bzip2.*rda"),
        (b"", "empty"),
        (b"\x00\x01\x02\x03", "unknown binary"),
        (b"<html>Not found</html>", "web page"),
        (b"The quick brown fox\njumps over\n", "The quick brown fox"),
        (b"1 2 3\n4 five 6\n7 8 9\n1 1 1\n", "columns of numbers"),
        (b"1 2 3\n", "found 1 rows"),
        (b"CDF\x01" + b"\x07" * 50, "damaged"),
        (b"\x89HDF\r\n\x1a\n" + b"\x07" * 50, "damaged"),
        (b"PK\x03\x04" + b"\x07" * 50, "damaged"),
        (b"MATLAB 5.0 MAT-file" + b"\x07" * 200, "damaged"),
        (b"500000 4300000 -20\n500100 4300000 -21\n500000 4300100 -20\n500100 4300100 -20\n", "degrees"),
        (b"ncols 3\nnrows 4\ncellsize abc\n", "abc"),
    ],
)
def test_files_that_are_something_else(tmp_path, content, words):
    path = tmp_path / "file.dat"
    path.write_bytes(content)
    with pytest.raises(DataError, match=f"(?s){words}"):
        read_bathymetry(path)


def test_scattered_points_are_not_a_grid(tmp_path):
    draw = np.random.default_rng(1)
    path = tmp_path / "a.xyz"
    path.write_text("\n".join(f"{x:.5f} {y:.5f} -20" for x, y in draw.uniform(30, 31, (200, 2))))
    with pytest.raises(DataError, match="grid_seafloor"):
        read_bathymetry(path)


def test_nan_everywhere_and_box_elsewhere(tmp_path):
    with pytest.raises(DataError, match="no finite value"):
        read_bathymetry(write(tmp_path / "a.nc", np.full(UP.shape, np.nan)))
    path = write(tmp_path / "b.nc")
    with pytest.raises(CoverageError, match="39.00 to 40.50 N"):
        read_bathymetry(path, box=(50.0, 51.0, -73.0, -72.0))
    with pytest.raises(DataError, match="box"):
        read_bathymetry(path, box=(41.0, 40.0, -73.0, -72.0))


def test_wrong_names_are_explained(tmp_path):
    path = write(tmp_path / "a.nc", name="elevation")
    with pytest.raises(DataError, match="Did you mean 'elevation'"):
        read_bathymetry(path, names={"depth": "elevaton"})
    with pytest.raises(DataError, match="Did you mean 'latitude'"):
        read_bathymetry(path, names={"latitud": "lat"})
    with pytest.raises(DataError, match="'sideways'"):
        read_bathymetry(path, names={"positive": "sideways"})
    with pytest.raises(DataError, match="latitude variable 'lt'"):
        read_bathymetry(path, names={"latitude": "lt"})


def test_several_candidates_are_listed(tmp_path):
    path = write(tmp_path / "a.nc", name="first")
    with netCDF4.Dataset(path, "a") as file:
        file.createVariable("second", "f4", ("lat", "lon"))[:] = UP
    with pytest.raises(DataError, match="first, second"):
        read_bathymetry(path)


@pytest.mark.parametrize("file_format", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4"])
def test_a_file_that_was_cut_off_never_reads_as_zeros(tmp_path, file_format):
    whole = write(tmp_path / "a.nc", file_format=file_format).read_bytes()
    np.testing.assert_allclose(read_bathymetry(tmp_path / "a.nc").depth, -UP)
    for cut in (1, 5, 17, 40, 100, len(whole) // 2, len(whole) - 10):
        path = tmp_path / "cut.nc"
        path.write_bytes(whole[:-cut])
        with pytest.raises(DataError, match="cut.nc"):
            read_bathymetry(path)


@pytest.mark.parametrize("seed", range(6))
def test_damaged_files_never_give_anything_but_our_own_error(tmp_path, seed):
    """Cut every layout, corrupt those we decode ourselves; the reader may succeed or explain, nothing else."""
    draw = np.random.default_rng(seed)
    buffer = io.BytesIO()
    savemat(buffer, {"lon": LON, "lat": LAT, "h": np.abs(UP)}, do_compression=bool(seed % 2))
    classic = write(tmp_path / "c.nc", file_format="NETCDF3_CLASSIC").read_bytes()
    modern = write(tmp_path / "m.nc").read_bytes()
    # Corrupt metadata can crash the NetCDF library itself, so those files are only cut off.
    for whole, corrupt in ((classic, 0), (modern, 0), (buffer.getvalue(), 3), (rows(",").encode(), 3)):
        for _ in range(25):
            data = bytearray(whole[: int(draw.integers(5, len(whole) + 1))])
            for place in draw.integers(4, len(data), corrupt):
                data[place] = int(draw.integers(256))
            path = tmp_path / "x.dat"
            path.write_bytes(bytes(data))
            try:
                grid = read_bathymetry(path)
            except GliderJaxError:
                continue
            assert whole not in (classic, modern) or len(data) == len(whole)
            assert grid.depth.shape == (grid.latitude.size, grid.longitude.size)


# -- real files --------------------------------------------------------------------------------------------------

NEW_JERSEY = ((-74.0, 23.0), (-73.5, 45.0), (-73.0, 62.0), (-72.5, 125.0), (-72.0, 804.0))


@pytest.mark.parametrize(
    ("name", "slack"), [("derived_nj_eastcoast_4min.nc", 0.0), ("derived_nj_marmap_gridextract.xyz", 0.1)]
)
def test_real_new_jersey(real, name, slack):
    """Two grids of the same shelf: the first gave the depths, the second was made from other soundings."""
    grid = read_bathymetry(real("environment", "bathymetry", name), box=(38.5, 40.5, -75.0, -71.5))
    for lon, depth in NEW_JERSEY:
        assert grid.longitude[np.abs(grid.longitude - lon).argmin()] == pytest.approx(lon, abs=0.034)
        assert at(grid, 39.4, lon) == pytest.approx(depth, rel=slack, abs=0.01)


def test_real_new_jersey_exact(real):
    grid = read_bathymetry(real("environment", "bathymetry", "derived_nj_eastcoast_4min.nc"))
    assert [at(grid, 39.4, lon) for lon, _ in NEW_JERSEY] == [depth for _, depth in NEW_JERSEY]
    assert at(grid, 39.4, -75.4) < 0.0


@pytest.mark.parametrize(
    ("name", "shape", "extremes", "corner"),
    [
        ("etopo1_bedrock_gridextract.nc", (241, 661), (-136.0, 3791.0), (70.0, -151.0, -18.0)),
        ("etopo1_ice_g_gmt4_malta.nc", (13, 9), (3557.0, 3730.0), (36.0, 15.866667, 3616.0)),
        ("etopo2022_30s_subset.nc", (240, 120), (-31.698, 63.1367), (51.004167, 2.004167, 1.0)),
        ("gebco_2014_subset.nc", (240, 301), (169.0, 2320.0), (58.004167, -11.504167, 1917.0)),
        ("usgsCeSrtm30v6_erddap.nc", (1009, 1717), (-1469.0, 5282.0), (48.3, -69.0, 21.0)),
        ("glidersim_germanbight_getm.nc", (258, 203), (0.0112355, 51.36418), (53.22388, 6.00777, np.nan)),
    ],
)
def test_real_formats(real, name, shape, extremes, corner):
    grid = read_bathymetry(real("environment", "bathymetry", name))
    assert grid.depth.shape == shape
    np.testing.assert_allclose((np.nanmin(grid.depth), np.nanmax(grid.depth)), extremes, rtol=1e-4)
    np.testing.assert_allclose(at(grid, *corner[:2]), corner[2], rtol=1e-6)
    assert (np.diff(grid.latitude) > 0).all() and (np.diff(grid.longitude) > 0).all()


def test_real_georges_bank_by_its_box(real):
    path = real("environment", "bathymetry", "usgsCeSrtm30v6_erddap.nc")
    grid = read_bathymetry(path, box=(41.0, 42.0, -68.0, -67.0))
    assert 1.0 <= np.ptp(grid.latitude) < 1.05 and grid.depth.shape[0] < 130
    assert 10.0 < at(grid, 41.5, -67.5) < 60.0


def test_real_roms_and_matlab(real):
    grid = read_bathymetry(real("environment", "roms_coawst_sandy", "Sandy_roms_grid_child2.nc"))
    assert grid.longitude[0] < 0.0
    assert at(grid, 39.4, -73.0) == pytest.approx(62.0, abs=10.0)
    east = read_bathymetry(real("environment", "roms_coawst_sandy", "USeast_bathy.mat"), box=(38.5, 40.5, -75.0, -71.5))
    assert at(east, 39.4, -73.0) == pytest.approx(62.0, abs=15.0) and at(east, 39.4, -72.0) > 500.0


def test_real_files_of_another_kind(real):
    for name in ("README.md",):
        with pytest.raises(DataError, match="rows of longitude"):
            read_bathymetry(real("environment", "bathymetry", name))
    with pytest.raises(DataError, match="latitude variable"):
        read_bathymetry(real("environment", "roms_coawst_sandy", "tide_forc_Sandy.nc"))


def test_the_default_seafloor_is_read(tmp_path):
    import glider_jax_data

    path = Path(glider_jax_data.path("new_jersey_bathymetry.nc"))
    grid = read_bathymetry(path, box=(38.9, 39.6, -74.3, -72.8))
    assert 10.0 < at(grid, 39.45, -74.15) < 20.0 and 90.0 < at(grid, 39.02, -72.92) < 110.0
    assert grid.source.notes == ()
