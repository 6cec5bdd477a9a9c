"""Bathymetry as text, in zip files and in Matlab files."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat

from glider_jax.errors import DataError
from glider_jax.readers.bathymetry import read_bathymetry
from glider_jax.readers.matlab_numbers import matlab_arrays
from tests.readers.bathymetry_layouts import LAT, LON, UP, at, rows, write


@pytest.mark.parametrize("separator", [",", " ", "   ", "\t", ", ", ";"])
def test_xyz_with_any_separator(tmp_path, separator):
    path = tmp_path / "a.xyz"
    path.write_text(rows(separator))
    grid = read_bathymetry(path)
    np.testing.assert_allclose(grid.depth, -UP)
    np.testing.assert_allclose(grid.latitude, LAT)


def test_xyz_headers_orders_and_units(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("latitude,longitude,topo\n" + "degrees_north,degrees_east,m\n" + rows(",", "yxz"))
    np.testing.assert_allclose(read_bathymetry(path).depth, -UP)
    path.write_text(rows(",", header="lon,lat,depth (m)", up=-UP))
    np.testing.assert_allclose(read_bathymetry(path).depth, -UP)


def test_xyz_latitude_first_is_told_by_its_range(tmp_path):
    path = tmp_path / "a.xyz"
    text = "\n".join(f"{39 + j} {-150 + i} {-100 - i - 10 * j}" for j in range(3) for i in range(4))
    path.write_text(text)
    grid = read_bathymetry(path)
    assert grid.longitude[0] == -150.0 and at(grid, 41.0, -147.0) == 123.0


def test_xyz_gaps_are_nan_even_where_a_whole_row_is_missing(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text(rows(",", skip={(1, 1)}))
    grid = read_bathymetry(path)
    assert np.isnan(at(grid, 39.5, -73.5)) and np.isnan(grid.depth).sum() == 1
    assert any("1 of 12 cells" in note for note in grid.source.notes)
    lines = [f"{-74 + 0.1 * i:.4f} {39 + 0.1 * j:.4f} -50" for j in range(9) if j != 4 for i in range(9)]
    path.write_text("\n".join(lines))
    grid = read_bathymetry(path)
    assert grid.depth.shape == (9, 9) and np.isnan(grid.depth[4]).all() and np.isfinite(grid.depth[5]).all()


def test_xyz_axis_of_rounded_thirds_is_even(tmp_path):
    path = tmp_path / "a.xyz"
    lon, lat = -75.0 + np.arange(200) / 15.0, 38.0 + np.arange(5) / 15.0
    path.write_text("\n".join(f"{x:.6f} {y:.6f} -20" for y in lat for x in lon))
    grid = read_bathymetry(path)
    assert grid.depth.shape == (5, 200) and np.isfinite(grid.depth).all()
    np.testing.assert_allclose(np.diff(grid.longitude), 1 / 15.0, atol=1e-7)


@given(
    nlat=st.integers(2, 7), nlon=st.integers(2, 7), step=st.sampled_from([1 / 60, 1 / 240, 1 / 15, 0.25]),
    south=st.floats(-60, 60), west=st.floats(-170, 160), seed=st.integers(0, 1000),
)  # fmt: skip
@settings(max_examples=40, deadline=None)
def test_xyz_round_trip(tmp_path_factory, nlat, nlon, step, south, west, seed):
    lat, lon = south + step * np.arange(nlat), west + step * np.arange(nlon)
    up = -np.random.default_rng(seed).uniform(1.0, 900.0, (nlat, nlon)).round(1)
    path = tmp_path_factory.mktemp("xyz") / "a.xyz"
    path.write_text("\n".join(f"{lon[i]:.6f} {lat[j]:.6f} {up[j, i]:.1f}" for j in range(nlat) for i in range(nlon)))
    grid = read_bathymetry(path, names={"positive": "up"})
    np.testing.assert_allclose(grid.depth, -up, atol=1e-9)
    np.testing.assert_allclose(grid.latitude, lat, atol=2e-6)


def test_zip_with_a_readme(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("crm/readme.txt", "Depth in metres, as delivered.")
        archive.writestr("crm/pr.xyz", rows("  "))
    np.testing.assert_allclose(read_bathymetry(tmp_path / "a.zip").depth, -UP)
    inner = write(tmp_path / "in.nc")
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("grid.nc", inner.read_bytes())
    np.testing.assert_allclose(read_bathymetry(tmp_path / "b.zip").depth, -UP)
    with zipfile.ZipFile(tmp_path / "c.zip", "w") as archive:
        archive.writestr("one.xyz", rows(","))
        archive.writestr("two.xyz", rows(","))
    with pytest.raises(DataError, match="one.xyz, two.xyz"):
        read_bathymetry(tmp_path / "c.zip")


def test_esri_grid_corner_and_centre(tmp_path):
    body = "\n".join(" ".join(f"{v:g}" for v in row) for row in np.where(UP == 25.0, -9999.0, UP)[::-1])
    head = "ncols 3\nnrows 4\n{}\n{}\ncellsize 0.5\nNODATA_value -9999\n"
    expected = np.where(UP == 25.0, np.nan, -UP)
    path = tmp_path / "a.asc"
    path.write_text(head.format("xllcenter -74.0", "yllcenter 39.0") + body)
    np.testing.assert_allclose(read_bathymetry(path).longitude, LON)
    np.testing.assert_allclose(read_bathymetry(path).depth, expected)
    path.write_text(head.format("xllcorner -74.25", "yllcorner 38.75") + body)
    np.testing.assert_allclose(read_bathymetry(path).latitude, LAT)
    path.write_text(head.format("xllcorner -74.25", "yllcorner 38.75") + body[: len(body) // 2])
    with pytest.raises(DataError, match="3 x 4 values"):
        read_bathymetry(path)
    path.write_text(head.format("xllcorner 500000", "yllcorner 4300000") + body)
    with pytest.raises(DataError, match="degrees"):
        read_bathymetry(path)


def test_matlab_numbers_agree_with_scipy(real):
    path = real("environment", "roms_coawst_sandy", "USeast_bathy.mat")
    ours, theirs = matlab_arrays(path.read_bytes(), path.name), loadmat(path)
    for name in ("h_lon", "h_lat", "h_USeast"):
        np.testing.assert_array_equal(ours[name], theirs[name])


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_numbers_of_every_kind(tmp_path, compressed):
    given = {k: np.arange(6).reshape(2, 3).astype(k) for k in ("i1", "u2", "i4", "f4", "f8", "u8")}
    given |= {
        "one": np.array([[3.5]]),
        "text": "words",
        "cell": np.array([1, "a"], object),
        "c": np.array([1j]),
    }
    savemat(tmp_path / "a.mat", given, do_compression=compressed)
    found = matlab_arrays((tmp_path / "a.mat").read_bytes(), "a.mat")
    assert set(found) == {"i1", "u2", "i4", "f4", "f8", "u8", "one"}
    for name, values in found.items():
        assert values.dtype == np.asarray(given[name]).dtype
        np.testing.assert_array_equal(values, given[name])


def test_matlab_mesh_with_elevation_called_depth(tmp_path):
    lon, lat = np.meshgrid(LON, LAT)
    savemat(tmp_path / "a.mat", {"loni": lon, "lati": lat, "depthi": UP.astype("i2")})
    grid = read_bathymetry(tmp_path / "a.mat")
    np.testing.assert_allclose(grid.depth, -UP)
    assert any("mostly negative" in note for note in grid.source.notes)
    savemat(tmp_path / "b.mat", {"lon": LON, "lat": LAT, "h": np.abs(UP).T})
    np.testing.assert_allclose(read_bathymetry(tmp_path / "b.mat").depth, np.abs(UP))
    savemat(tmp_path / "c.mat", {"lon": LON, "lat": LAT, "one": UP, "two": UP})
    with pytest.raises(DataError, match="one, two"):
        read_bathymetry(tmp_path / "c.mat")
    assert read_bathymetry(tmp_path / "c.mat", names={"depth": "two", "positive": "up"}).depth.shape == UP.shape
