"""ROMS currents and seafloor: closed-form levels, synthetic staggered grids, and every real file."""

from __future__ import annotations

import math

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.roms import masked_mean, read_roms_bathymetry, read_roms_currents
from glider_jax.readers.roms_vertical import (
    VerticalCoordinate,
    choose_levels,
    depth_mean,
    s_levels,
    stretching_curve,
    to_depths,
)
from tests.readers.roms_layouts import World

NJ = (38.5, 41.0, -75.0, -71.0)
SANDY = ("environment", "roms_coawst_sandy")
DOPPIO = ("environment", "roms_doppio", "ROMS3D_00_doppio_his_4322_subset.nc")


def curve(kind: int, ts: float, tb: float, s: float) -> float:
    """The published stretching functions once more, for one number at a time."""
    if kind == 1:
        first = math.sinh(ts * s) / math.sinh(ts)
        second = 0.5 * (math.tanh(ts * (s + 0.5)) / math.tanh(0.5 * ts) - 1)
        return first + tb * (second - first)
    if kind == 3:
        g, lc = 3.0, math.log(math.cosh(3.0))
        bottom = math.log(math.cosh(g * (s + 1) ** tb)) / lc - 1
        surface = -math.log(math.cosh(g * (-s) ** ts)) / lc
        weight = 1 / (1 + math.exp(2 * g * (s + 0.5)))
        return surface + weight * (bottom - surface)
    surface = -(math.sinh(ts * s / 2) ** 2) / math.sinh(ts / 2) ** 2  # 1 - cosh 2x = -2 sinh^2 x
    if kind == 2:
        bottom = math.sinh(tb * (s + 1)) / math.sinh(tb) - 1
        weight = 1 - s * s  # (s + 1)(2 - (s + 1)) once more
        return bottom + weight * (surface - bottom)
    return math.expm1(tb * surface) / -math.expm1(-tb)


@pytest.mark.parametrize("kind", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("theta", [(5.0, 0.4), (7.0, 2.0), (1.5, 0.9)])
def test_stretching_curves_match_their_formulas(kind, theta):
    """Each curve equals an independent writing of its formula, is monotone and runs from -1 to 0."""
    s = s_levels(20, kind, interfaces=True)
    c = stretching_curve(kind, *theta, s)
    np.testing.assert_allclose(c, [curve(kind, *theta, float(x)) for x in s], rtol=1e-12, atol=1e-13)
    assert c[0] == pytest.approx(-1, abs=1e-12) and c[-1] == pytest.approx(0, abs=1e-12)
    assert theta[1] > 1 or (np.diff(c) > 0).all()  # the older curves need theta_b up to 1


def test_quadratic_levels_of_souza():
    """Vstretching 5: the first interface is -1, the last 0, and one layer middle is worked out by hand."""
    w, r = s_levels(10, 5, interfaces=True), s_levels(10, 5)
    assert w[0] == -1.0 and w[-1] == pytest.approx(0.0, abs=1e-15)
    assert (np.diff(w) > 0).all() and (w[:-1] < r).all() and (r < w[1:]).all()
    # k = 9.5, N = 10: -(90.25 - 190 + 9.5 + 90) / 90 - 0.01 (90.25 - 95) / (-9)
    assert r[-1] == pytest.approx(0.25 / 90 - 0.01 * 4.75 / 9, abs=1e-15)
    np.testing.assert_allclose(s_levels(4), [-0.875, -0.625, -0.375, -0.125])


def test_unknown_stretching_and_transform_are_refused():
    """A code that does not exist is an error, never a default."""
    with pytest.raises(DataError, match="Vstretching: expected 1 to 5, found 6"):
        stretching_curve(6, 5.0, 0.4, np.array([-0.5]))
    with pytest.raises(DataError, match="Vtransform: expected 1 or 2, found 3"):
        VerticalCoordinate(3, 10.0, np.array([-0.5]), np.array([-0.5]))


def test_depths_of_one_column_by_hand():
    """Both transforms at s = -0.5, C = -0.2, hc = 10, h = 90, zeta = 1."""
    s, c = np.array([-0.5]), np.array([-0.2])
    first = VerticalCoordinate(1, 10.0, s, c).heights(np.array(90.0), 1.0)
    resting = 10 * (-0.3) + 90 * (-0.2)
    assert first.item() == pytest.approx(resting + 1 * (1 + resting / 90), rel=1e-14)
    second = VerticalCoordinate(2, 10.0, s, c).heights(np.array(90.0), 1.0)
    assert second.item() == pytest.approx(1 + 91 * (10 * -0.5 + 90 * -0.2) / 100, rel=1e-14)
    assert VerticalCoordinate(2, 10.0, s, c).depths(np.array(90.0), 1.0).item() == pytest.approx(91 * 0.23)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.integers(1, 5),
    transform=st.integers(1, 2),
    h=st.floats(20.0, 5000.0),
    zeta=st.floats(-3.0, 3.0),
    n=st.integers(8, 40),  # with fewer levels the quadratic s of Vstretching 5 itself passes 0
)
def test_layers_fill_the_water_column(kind, transform, h, zeta, n):
    """Layers are positive, add up to the column, and hold their middles, for every dialect."""
    s, w = s_levels(n, kind), s_levels(n, kind, interfaces=True)
    curves = [stretching_curve(kind, 4.0, 0.5, part) for part in (s, w)]
    vertical = VerticalCoordinate(transform, 15.0, s, curves[0], w, curves[1])
    thick = vertical.thickness(np.array([h]), zeta)
    assert (thick > 0).all()
    assert thick.sum() == pytest.approx(h + zeta, rel=1e-12)
    faces, middles = vertical.depths(np.array([h]), zeta, interfaces=True), vertical.depths(np.array([h]), zeta)
    assert (faces[1:] < middles).all() and (middles < faces[:-1]).all()
    assert faces[0, 0] == pytest.approx(h + zeta) and faces[-1, 0] == pytest.approx(0, abs=1e-9)


def test_a_column_that_falls_dry_keeps_a_little_water():
    """A free surface below the seafloor must not turn the levels upside down."""
    vertical = World().vertical
    depths = vertical.depths(np.array([5.0]), -5.1)
    assert (np.diff(depths[:, 0]) < 0).all() and 0 < depths[0, 0] <= 0.1


def test_values_at_fixed_depths():
    """Linear between levels, constant above the first and below the last."""
    depths = np.array([90.0, 50.0, 10.0])[:, None]
    values = np.array([9.0, 5.0, 1.0])[:, None]
    found = to_depths(values, depths, np.array([0.0, 10.0, 30.0, 90.0, 200.0]))[:, 0]
    np.testing.assert_allclose(found, [1.0, 1.0, 3.0, 9.0, 9.0])
    np.testing.assert_allclose(to_depths(values[:1], depths[:1], np.array([0.0, 500.0])), 9.0)


def test_levels_reach_the_deepest_water():
    """The standard set ends with the first level below the water; a given set is checked."""
    assert choose_levels(90.0).tolist()[-3:] == [50.0, 75.0, 100.0]
    assert choose_levels(100.0)[-1] == 100.0
    assert choose_levels(50.0, [20, 0]).tolist() == [0.0, 20.0]
    for wrong in ([], [-1.0, 5.0], [0.0, math.nan], [5.0, 5.0]):
        with pytest.raises(DataError, match="levels: expected different depths"):
            choose_levels(50.0, wrong)


def test_masked_mean_of_faces():
    """Open faces are averaged, closed ones left out; none open is no flow; open without value is unknown."""
    faces = np.array([[2.0, 4.0, 77.0, 77.0, np.nan]])
    is_open = np.array([[True, True, False, False, True]])
    np.testing.assert_array_equal(masked_mean(faces, is_open, -1), [[3.0, 4.0, 0.0, np.nan]])
    np.testing.assert_array_equal(masked_mean(faces.T, is_open.T, -2), [[3.0], [4.0], [0.0], [np.nan]])


@pytest.mark.parametrize("odd_names", [False, True])
@pytest.mark.parametrize(("transform", "stretching"), [(1, 1), (2, 2), (2, 3), (2, 4), (2, 5)])
def test_solid_body_rotation_on_a_turned_grid(tmp_path, odd_names, transform, stretching):
    """A rotating, depth-dependent flow comes back at every point and depth, whatever the dialect."""
    world = World(transform=transform, stretching=stretching)
    found = read_roms_currents(world.write(tmp_path / "his.nc", odd_names=odd_names))
    assert found.east.shape == (2, found.depth.size, found.latitude.size, found.longitude.size)
    assert found.depth_resolved and found.depth[0] == 0 and found.depth[-1] == 100
    lon, lat = np.meshgrid(found.longitude, found.latitude)
    x, y = world.metres(lon, lat)
    deepest, shallowest = world.vertical.depths(np.array([world.depth])).ravel()[[0, -1]]
    edge = np.ones_like(found.sea)
    edge[1:-1, 1:-1] = False
    # One-sided means at the rim of the model are not exact: keep what lies well inside.
    reach = 0.8 * (min((world.nx - 1) * world.step[0], (world.ny - 1) * world.step[1]) / 2)
    inner = found.sea & (np.hypot(x, y) < reach)
    assert inner.sum() > 200
    for frame in range(2):
        for level, depth in enumerate(found.depth):
            east, north = world.current(x, y, np.clip(depth, shallowest, deepest), frame)
            np.testing.assert_allclose(found.east[frame, level][inner], east[inner], atol=2e-7)
            np.testing.assert_allclose(found.north[frame, level][inner], north[inner], atol=2e-7)
    assert np.isnan(found.east[:, :, ~found.sea]).all()
    assert found.time.tolist() == [1351382400.0, 1351468800.0]
    assert any("Modified Julian Date" in note for note in found.source.notes)


def test_land_values_never_reach_the_sea(tmp_path):
    """Invented currents on land stay out, next to the coast the masked mean keeps the size of the flow."""
    world = World(land=(slice(8, 14), slice(10, 20)), angle=0.0)
    found = read_roms_currents(world.write(tmp_path / "his.nc"))
    np.testing.assert_array_equal(found.sea, world.sea)  # a grid along the axes keeps its own points
    assert np.isnan(found.east[0, 0][~world.sea]).all()
    x, y = world.positions()
    east, north = world.current(x, y, 0.0)
    assert np.isfinite(found.east[:, :, world.sea]).all()
    # One closed face shifts the mean by half a cell, and the topmost level lies a little below the surface.
    half_cell = world.omega * 0.5 * max(world.step)
    assert np.abs(found.east[0, 0] - east)[world.sea].max() < 1.05 * half_cell
    assert np.abs(found.north[0, 0] - north)[world.sea].max() < 1.05 * half_cell
    assert np.nanmax(np.hypot(found.east, found.north)) < 1.0


def test_a_bay_one_cell_wide_has_no_flow_across(tmp_path):
    """A sea point between two land points has zero flow in that direction, not an invented one."""
    world = World(angle=0.0, land=(slice(5, 6), slice(None)))
    world.land = (slice(5, 8, 2), slice(None))  # rows 5 and 7 are land, row 6 is the channel
    found = read_roms_currents(world.write(tmp_path / "his.nc"))
    assert (found.north[:, :, 6] == 0).all() and (found.east[:, 0, 6] != 0).any()


def test_the_grid_may_be_in_another_file(tmp_path):
    """Fields alone fail with what is missing; any file of the list may supply it."""
    world = World(skip={"s_rho"})
    fields = world.write(tmp_path / "clm.nc", whole=False, odd_names=True)
    grid = world.write_grid(tmp_path / "grid.nc")
    parameters = World().write_parameters(tmp_path / "parameters.nc")
    with pytest.raises(DataError, match="clm.nc: expected variable 'lon_rho'.*give that as grid"):
        read_roms_currents(fields)
    with pytest.raises(DataError) as problem:
        read_roms_currents(fields, grid=grid)
    for name in ("Cs_r", "s_rho", "hc", "Vtransform", "initial or parameter file"):
        assert name in str(problem.value)
    both = read_roms_currents([fields, parameters], grid=grid)
    whole = read_roms_currents(World().write(tmp_path / "his.nc"))
    np.testing.assert_array_equal(both.east, whole.east)
    assert set(both.source.files) == {str(path) for path in (fields, parameters, grid)}


@pytest.mark.parametrize("absent", ["mask_rho", "h", "lon_rho"])
def test_each_missing_part_is_named(tmp_path, absent):
    """The message names the variable and where it usually is."""
    with pytest.raises(DataError, match=f"'{absent}'.*grid"):
        read_roms_currents(World(skip={absent}).write(tmp_path / "his.nc"))


def test_curves_are_worked_out_where_only_the_parameters_are_stored(tmp_path):
    """Cs_r from theta_s, theta_b and Vstretching equals the stored one; masks of faces follow from mask_rho."""
    whole = read_roms_currents(World(land=(slice(3, 6), slice(2, 9))).write(tmp_path / "whole.nc"))
    lean = World(land=(slice(3, 6), slice(2, 9)), skip={"Cs_r", "Cs_w", "mask_u", "mask_v"})
    found = read_roms_currents(lean.write(tmp_path / "lean.nc"))
    np.testing.assert_allclose(found.east, whole.east, atol=1e-7)
    assert any("Cs_r" in note for note in found.source.notes)


def test_missing_angle_is_worked_out_and_degrees_are_recognised(tmp_path):
    """Without angle the positions tell it; an angle in degrees is seen to be one."""
    whole = read_roms_currents(World().write(tmp_path / "whole.nc"))
    absent = read_roms_currents(World(skip={"angle"}).write(tmp_path / "absent.nc"))
    assert any("angle is in no file" in note for note in absent.source.notes)
    # Near the equator a degree of longitude shrinks by 2e-4 over the grid, which turns the direction as much.
    np.testing.assert_allclose(absent.east, whole.east, atol=3e-4 * np.nanmax(np.abs(whole.east)))
    path = World().write(tmp_path / "degrees.nc")
    with netCDF4.Dataset(path, "a") as data:
        data["angle"][:] = 36.0
    degrees = read_roms_currents(path)
    assert any("taken as degrees" in note for note in degrees.source.notes)
    np.testing.assert_allclose(degrees.east, whole.east, atol=1e-7)
    with netCDF4.Dataset(path, "a") as data:
        data["angle"][:] = 1.4
    assert any("stored angle differs" in note for note in read_roms_currents(path).source.notes)


def test_velocities_already_east_and_north_are_not_turned(tmp_path):
    """u_eastward and v_northward win over u and v and keep their direction."""
    path = World().write(tmp_path / "his.nc")
    with netCDF4.Dataset(path, "a") as data:
        for name, value in (("u_eastward", 0.3), ("v_northward", -0.1)):
            data.createVariable(name, "f4", ("ocean_time", "s_rho", "eta_rho", "xi_rho"))[:] = value
    found = read_roms_currents(path)
    np.testing.assert_allclose(found.east[:, :, found.sea], 0.3, rtol=1e-6)
    np.testing.assert_allclose(found.north[:, :, found.sea], -0.1, rtol=1e-6)


def test_depth_mean_only(tmp_path):
    """A file with ubar and vbar alone gives one level and says so; no vertical coordinate is needed."""
    world = World()
    path = tmp_path / "bar.nc"
    with netCDF4.Dataset(path, "w") as data:
        world._put_grid(data, "eta_rho", "xi_rho")
        data.createDimension("ocean_time", 1)
        time = data.createVariable("ocean_time", "f8", ("ocean_time",))
        time.units, time[:] = "seconds since 2006-01-01", [86400.0]
        for name, dims, shift in (
            ("ubar", ("mask_u_y", "mask_u_x"), (0.5, 0.0)),
            ("vbar", ("mask_v_y", "mask_v_x"), (0.0, 0.5)),
        ):
            shape = tuple(data.dimensions[dim].size for dim in dims)
            east, north = world.current(*world.positions(*shift, shape), 0.0)
            turned = east * np.cos(world.angle) + north * np.sin(world.angle)
            if name == "vbar":
                turned = -east * np.sin(world.angle) + north * np.cos(world.angle)
            data.createVariable(name, "f8", ("ocean_time", *dims))[0] = turned
    found = read_roms_currents(path)
    assert found.depth.tolist() == [0.0] and not found.depth_resolved
    assert any("averaged over depth" in note for note in found.source.notes)
    x, y = world.metres(*np.meshgrid(found.longitude, found.latitude))
    inner = found.sea & (np.hypot(x, y) < 40e3)
    np.testing.assert_allclose(found.east[0, 0][inner], world.current(x, y, 0.0)[0][inner], atol=2e-7)
    assert found.time.tolist() == [1136160000.0]


def test_free_surface_stretches_the_levels_and_odd_ones_are_told(tmp_path):
    """Depths count from the moving surface; a surface of 5 m is reported."""
    found = read_roms_currents(World(zeta=5.0, angle=0.0).write(tmp_path / "his.nc"), levels=[50.0])
    x, y = World(angle=0.0).positions()
    east, _ = World().current(x, y, 50.0)
    np.testing.assert_allclose(found.east[0, 0][2:-2, 2:-2], east[2:-2, 2:-2], atol=1e-7)
    assert any("exceed 3 m" in note for note in found.source.notes)
    absent = read_roms_currents(World(skip={"zeta"}).write(tmp_path / "absent.nc"))
    assert any("no free surface" in note for note in absent.source.notes)


def test_box_and_period_cut_before_reading(tmp_path):
    """A box gives the same numbers as the whole grid at the same points; a period keeps one time beyond."""
    world = World(angle=0.0, times=tuple(56228.0 + np.arange(6)))
    path = world.write(tmp_path / "his.nc")
    whole = read_roms_currents(path)
    box = (0.9, 1.1, -72.2, -71.8)
    part = read_roms_currents(path, box=box, period=("2012-10-29T06:00", "2012-10-30T06:00"))
    rows = np.searchsorted(whole.latitude, part.latitude)
    columns = np.searchsorted(whole.longitude, part.longitude)
    assert part.latitude.size < 12 and part.latitude[0] <= 0.9 and part.latitude[-1] >= 1.1
    assert part.longitude[0] <= -72.2 and part.longitude[-1] >= -71.8
    np.testing.assert_array_equal(part.time, whole.time[1:4])
    np.testing.assert_array_equal(part.east, whole.east[1:4][:, :, rows[:, None], columns])
    east_of_greenwich = read_roms_currents(path, box=(0.9, 1.1, 287.8, 288.2))
    np.testing.assert_allclose(east_of_greenwich.longitude, part.longitude + 360.0)
    with pytest.raises(CoverageError, match="Choose another file or area"):
        read_roms_currents(path, box=(10.0, 12.0, -72.2, -71.8))
    with pytest.raises(CoverageError, match="found 2012-10-28T00:00:00Z to 2012-11-02T00:00:00Z"):
        read_roms_currents(path, period=("2013-01-01", "2013-01-02"))


def test_several_files_are_joined_and_repeated_times_dropped(tmp_path):
    """Times of all files in order, each once."""
    first = World(times=(56228.0, 56229.0)).write(tmp_path / "b.nc")
    second = World(times=(56227.0, 56228.0)).write(tmp_path / "a.nc")
    found = read_roms_currents([first, second])
    np.testing.assert_array_equal(np.diff(found.time), 86400.0)
    assert found.time.size == 3 and any("1 times are in more than one file" in n for n in found.source.notes)
    other = World(ny=20).write(tmp_path / "other.nc")
    with pytest.raises(DataError, match="all velocities on one grid.*different shapes"):
        read_roms_currents([first, other])


def test_bad_files_are_explained(tmp_path):
    """Absent, foreign, empty and wrongly cut files each give one sentence."""
    with pytest.raises(DataError, match="nowhere.nc"):
        read_roms_currents(tmp_path / "nowhere.nc")
    text = tmp_path / "text.nc"
    text.write_text("hello")
    with pytest.raises(DataError, match="text.nc"):
        read_roms_currents(text)
    with pytest.raises(DataError, match="at least one path"):
        read_roms_currents([])
    grid = World().write_grid(tmp_path / "grid.nc")
    with pytest.raises(DataError, match="velocity pairs u_eastward and v_northward"):
        read_roms_currents(grid)
    path = World().write(tmp_path / "units.nc", units="fortnights")
    with pytest.raises(DataError, match="units.nc.*fortnights"):
        read_roms_currents(path)
    with pytest.raises(DataError, match="Modified Julian|time unit"):
        read_roms_currents(World(times=(0.0, 1.0)).write(tmp_path / "zero.nc"))
    cut = tmp_path / "cut.nc"
    with netCDF4.Dataset(cut, "w") as data:
        for name, size in (("t", 1), ("s", 3), ("y", 5), ("x", 6), ("z", 9)):
            data.createDimension(name, size)
        data.createVariable("u", "f4", ("t", "s", "y", "x"))[:] = 0
        data.createVariable("v", "f4", ("t", "s", "y", "z"))[:] = 0
    with pytest.raises(DataError, match="ny, nx - 1"):
        read_roms_currents(cut)


def test_seafloor(tmp_path):
    """h becomes depth, land -1, outside a turned grid nothing."""
    world = World(depth=40.0, land=(slice(0, 4), slice(0, 10)))
    found = read_roms_bathymetry(world.write_grid(tmp_path / "grid.nc"))
    assert set(np.unique(found.depth[np.isfinite(found.depth)]).round(9)) == {-1.0, 40.0}
    assert np.isnan(found.depth[0, 0])
    straight = World(depth=40.0, land=(slice(0, 4), slice(0, 10)), angle=0.0)
    grid = straight.write_grid(tmp_path / "straight.nc")
    np.testing.assert_array_equal(read_roms_bathymetry(grid).depth, np.where(straight.sea, 40.0, -1.0))
    part = read_roms_bathymetry(grid, box=(0.9, 1.1, -72.2, -71.8))
    assert part.depth.shape[0] < 12
    unmasked = World(skip={"mask_rho", "mask_u", "mask_v"}).write_grid(tmp_path / "unmasked.nc")
    assert any("mask_rho is not in the file" in n for n in read_roms_bathymetry(unmasked).source.notes)
    with pytest.raises(DataError, match="'h'"):
        read_roms_bathymetry(World(skip={"h"}).write_grid(tmp_path / "flat.nc"))


@pytest.mark.parametrize("name", ["Sandy_ini.nc", "Sandy_ini_child2.nc"])
def test_stored_curves_are_reproduced(real, name):
    """Cs_r and Cs_w worked out from the stored parameters equal the stored ones."""
    with netCDF4.Dataset(real(*SANDY, name)) as data:
        kind, ts, tb = (float(data[key][:].ravel()[0]) for key in ("Vstretching", "theta_s", "theta_b"))
        for curve_name, faces in (("Cs_r", False), ("Cs_w", True)):
            s = s_levels(16, int(kind), faces)
            assert np.abs(stretching_curve(int(kind), ts, tb, s) - data[curve_name][:]).max() < 1e-12


def test_depth_mean_of_u_is_ubar(real):
    """The layer thicknesses weigh u to the stored depth mean, to 0.42 cm/s rms over the New Jersey grid."""
    with (
        netCDF4.Dataset(real(*SANDY, "Sandy_ini_child2.nc")) as ini,
        netCDF4.Dataset(real(*SANDY, "Sandy_roms_grid_child2.nc")) as grid,
    ):
        coordinate = VerticalCoordinate(2, 50.0, *(ini[n][:].filled() for n in ("sc_r", "Cs_r", "sc_w", "Cs_w")))
        h, zeta = grid["h"][:].filled(), ini["zeta"][0].filled()
        sea = grid["mask_u"][:].filled() > 0.5
        thick = coordinate.thickness(0.5 * (h[:, 1:] + h[:, :-1]), 0.5 * (zeta[:, 1:] + zeta[:, :-1]))
        u, ubar = ini["u"][0].filled(), ini["ubar"][0].filled()
        error = (depth_mean(u, thick) - ubar)[sea]
        plain = (u.mean(axis=0) - ubar)[sea]
    assert np.sqrt((error**2).mean()) < 0.0042
    assert np.sqrt((plain**2).mean()) > 2 * np.sqrt((error**2).mean())  # the weights matter


def test_new_jersey_initial_file(real):
    """The child grid keeps its own points; land is NaN, the sea is full, speeds are those of the raw file."""
    path, grid = real(*SANDY, "Sandy_ini_child2.nc"), real(*SANDY, "Sandy_roms_grid_child2.nc")
    with pytest.raises(DataError, match="lon_rho"):
        read_roms_currents(path)
    found = read_roms_currents(path, grid=grid, box=NJ)
    assert found.time.tolist() == [1351425600.0]  # 2012-10-28 12:00
    with netCDF4.Dataset(path) as ini, netCDF4.Dataset(grid) as data:
        lon, lat = data["lon_rho"][:].filled(), data["lat_rho"][:].filled()
        j, i = np.abs(lat[:, 0] - 39.4).argmin(), np.abs(lon[0] + 73.7).argmin()
        u = ini["u"][0, -1, j, i - 1 : i + 1].mean()
        v = ini["v"][0, -1, j - 1 : j + 1, i].mean()
    row, column = np.abs(found.latitude - lat[j, 0]).argmin(), np.abs(found.longitude - lon[0, i]).argmin()
    assert found.east[0, 0, row, column] == pytest.approx(u, abs=1e-6)
    assert found.north[0, 0, row, column] == pytest.approx(v, abs=1e-6)
    assert np.isfinite(found.east[:, :, found.sea]).all() and np.isnan(found.east[:, :, ~found.sea]).all()
    assert found.sea.mean() == pytest.approx(0.767, abs=0.01)
    with pytest.raises(DataError, match="another shape"):
        read_roms_currents(path, grid=real(*SANDY, "Sandy_roms_grid.nc"))


def test_daily_climatology_of_five_files(real):
    """Five files without any parameter, taken from the initial file; the odd free surface is reported."""
    names = ["coawst_clm_20121028.nc", "coawst_clm_20121029.nc", "coawst_clm_20121030.nc"]
    names += ["coawst_clm_20121031.nc", "coawst_clm_20121101.nc"]
    paths = [real(*SANDY, name) for name in names]
    grid = real(*SANDY, "Sandy_roms_grid.nc")
    with pytest.raises(DataError, match="Cs_r.*hc.*Vtransform"):
        read_roms_currents(paths, grid=grid)
    found = read_roms_currents([*paths, real(*SANDY, "Sandy_ini.nc")], grid=grid)
    assert found.time.size == 6 and found.east.shape[2:] == (65, 87)
    assert np.isfinite(found.east[:, :, found.sea]).all()
    assert found.depth[-1] >= 5591
    assert any("-5.1 to 3.6 m" in note for note in found.source.notes)
    assert np.nanmax(np.hypot(found.east, found.north)) < 3.0


def test_doppio_needs_its_parameters_and_is_turned(real, tmp_path):
    """The server's subset names what it lacks; with all 40 levels in a second file, every second one is used."""
    path = real(*DOPPIO)
    with pytest.raises(DataError) as problem:
        read_roms_currents(path)
    assert "Cs_r (or theta_s, theta_b and Vstretching), no hc" in str(problem.value)
    assert "s_rho" not in str(problem.value) and "Vtransform" not in str(problem.value)
    full = World(n=40, theta=(7.0, 2.0), hc=250.0)
    stored = read_roms_currents(path, grid=full.write_parameters(tmp_path / "stored.nc"))
    assert any("Cs_r of 40 levels used at the 20 levels" in note for note in stored.source.notes)
    lean = World(n=40, theta=(7.0, 2.0), hc=250.0, skip={"Cs_r", "Cs_w", "s_rho", "s_w"})
    worked = read_roms_currents(path, grid=lean.write_parameters(tmp_path / "lean.nc"))
    np.testing.assert_allclose(worked.east, stored.east, atol=1e-6)
    assert stored.time.size == 25 and stored.time[0] == 1509494400.0
    assert any("angle is in no file" in note for note in stored.source.notes)
    assert stored.sea.mean() > 0.3 and np.isfinite(stored.east[:, 0, stored.sea]).all()
    with netCDF4.Dataset(path) as data:
        j, i = 8, 15
        lon, lat = data["lon_rho"][:].filled(np.nan), data["lat_rho"][:].filled(np.nan)
        u = data["u"][0, -1, j, i - 1 : i + 1].mean()
        v = data["v"][0, -1, j - 1 : j + 1, i].mean()
        across = (lon[j, i + 1] - lon[j, i - 1]) * np.cos(np.radians(lat[j, i])), lat[j, i + 1] - lat[j, i - 1]
    cosine, sine = np.array(across) / np.hypot(*across)
    assert 35 < np.degrees(np.arctan2(sine, cosine)) < 38
    row, column = np.abs(stored.latitude - lat[j, i]).argmin(), np.abs(stored.longitude - lon[j, i]).argmin()
    near = (slice(row - 1, row + 2), slice(column - 1, column + 2))
    east, north = (np.nanmean(part[0, 0][near]) for part in (stored.east, stored.north))
    assert np.hypot(east - (u * cosine - v * sine), north - (u * sine + v * cosine)) < 0.2 * np.hypot(u, v)


@pytest.mark.parametrize(
    ("parts", "deepest"),
    [
        ((*SANDY, "Sandy_roms_grid.nc"), 5591.3),
        ((*SANDY, "Sandy_roms_grid_child2.nc"), 3364.4),
        (DOPPIO, 245.0),
    ],
)
def test_real_seafloor(real, parts, deepest):
    """Depth is positive down, land -1, and a kept grid keeps its deepest point."""
    found = read_roms_bathymetry(real(*parts))
    assert np.nanmax(found.depth) == pytest.approx(deepest, rel=0.05 if parts is DOPPIO else 1e-4)
    assert np.nanmin(found.depth) == -1.0


@pytest.mark.parametrize("middle", [288.0, 180.0])
def test_longitudes_are_continuous_whatever_the_file_counts(tmp_path, middle):
    """0..360 becomes -180..180, except where that would tear the grid at the antimeridian."""
    world = World(longitude=middle, angle=0.0)
    path = world.write(tmp_path / "his.nc")
    if middle == 180.0:
        with netCDF4.Dataset(path, "a") as data:
            lon = data["lon_rho"][:].filled()
            data["lon_rho"][:] = np.where(lon > 180, lon - 360.0, lon)
    found = read_roms_currents(path)
    assert (np.diff(found.longitude) > 0).all() and np.ptp(found.longitude) < 3.0
    assert found.longitude.mean() == pytest.approx(-72.0 if middle == 288.0 else 180.0, abs=1e-6)
