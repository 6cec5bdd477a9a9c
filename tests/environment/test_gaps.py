"""Gap filling: what must hold for any field, what reaches how far, and how good it is on held-out radar values."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.environment.gaps import METHODS, fill_gaps
from glider_jax.errors import ConfigError
from glider_jax.readers.currents import read_currents
from glider_jax.records import CurrentGrid, Source

STEP = 0.054
HOUR = 3600.0


def make(east, north=None, *, depth=(0.0,), sea=None, hours=1.0, sd=None):
    """A grid of about 6 km by 5 km from an array (time, depth, lat, lon)."""
    frames, _, ny, nx = east.shape
    return CurrentGrid(
        time=1.5e9 + HOUR * hours * np.arange(frames), depth=np.asarray(depth, float),
        latitude=39.0 + STEP * np.arange(ny), longitude=-74.0 + STEP * np.arange(nx), east=east,
        north=east.copy() if north is None else north, source=Source("test"), sea=sea,
        east_sd=sd, north_sd=sd,
    )  # fmt: skip


def wave(frames=6, ny=12, nx=14):
    """A smooth flow that turns with time."""
    t, _, y, x = np.ix_(np.arange(frames), [0], np.arange(ny), np.arange(nx))
    return 0.2 * np.cos(0.5 * t + 0.2 * x) + 0.01 * y


@pytest.mark.parametrize("method", METHODS)
def test_known_values_are_never_changed_and_gaps_stay_within_their_range(method):
    east = wave()
    rng = np.random.default_rng(1)
    holes = rng.random(east.shape) < 0.3
    grid = make(np.where(holes, np.nan, east))
    out = fill_gaps(grid, method=method)
    assert np.array_equal(out.east[~holes], east[~holes])
    assert np.isfinite(out.east).all()
    assert out.east.max() <= east[~holes].max() + 1e-3 and out.east.min() >= east[~holes].min() - 1e-3
    # Linear in time over one frame errs by up to 0.03 in this flow, the neighbours in space know better.
    assert np.sqrt(np.mean((out.east - east)[holes] ** 2)) < {"membrane": 0.012, "staged": 0.03}[method]
    assert out.filled == pytest.approx(holes.mean()) and METHODS[method] in out.fill_method
    assert any(f"{holes.mean():.1%}" in note for note in out.source.notes)
    assert np.isnan(grid.east).sum() == holes.sum(), "the record given stays as it was"


@settings(max_examples=25, deadline=None)
@given(
    scale=st.floats(0.01, 3.0),
    shift=st.floats(-2.0, 2.0),
    seed=st.integers(0, 99),
    method=st.sampled_from(list(METHODS)),
)
def test_filling_commutes_with_scaling_and_shifting(scale, shift, seed, method):
    east = np.where(np.random.default_rng(seed).random((3, 1, 8, 8)) < 0.3, np.nan, wave(3, 8, 8))
    one = fill_gaps(make(east), method=method)
    two = fill_gaps(make(scale * east + shift), method=method)
    assert np.allclose(two.east, scale * one.east + shift, atol=1e-3 * scale + 1e-6, equal_nan=True)
    flipped = fill_gaps(make(east[..., ::-1]), method=method)
    assert np.allclose(flipped.east[..., ::-1], one.east, atol=2e-4)


def test_a_uniform_flow_is_filled_exactly():
    east = np.full((4, 1, 9, 9), 0.3)
    east[:, :, 3:6, 3:6] = np.nan
    assert np.allclose(fill_gaps(make(east)).east, 0.3, atol=1e-12)


def test_an_outage_of_the_whole_field_is_bridged_in_time():
    east = wave(7)
    gappy = east.copy()
    gappy[3] = np.nan
    for method in METHODS:
        out = fill_gaps(make(gappy), method=method)
        assert np.abs(out.east[3] - 0.5 * (east[2] + east[4])).max() < 0.01, method


def test_reach_in_space_and_time():
    east = wave(30, 10, 30)
    gappy = east.copy()
    gappy[:, :, :, 10:] = np.nan
    out = fill_gaps(make(gappy), max_distance=30e3)
    step = 111195.0 * STEP * np.cos(np.radians(39.0 + 4.5 * STEP))
    reached = 10 + int(30e3 / step)
    assert np.isfinite(out.east[..., :reached]).all() and np.isnan(out.east[..., reached:]).all()
    assert any("stays without a current" in note for note in out.source.notes)
    gappy = east.copy()
    gappy[8:] = np.nan
    out = fill_gaps(make(gappy), max_hours=6.0)
    assert np.isfinite(out.east[:14]).all() and np.isnan(out.east[14:]).all()


def test_frames_across_a_wide_hole_in_time_do_not_help():
    east = wave(4)
    gappy = east.copy()
    gappy[2] = np.nan
    grid = make(gappy)
    grid = replace(grid, time=grid.time + np.array([0.0, 0.0, 48.0, 48.0]) * HOUR)
    out = fill_gaps(grid)
    alone = fill_gaps(replace(grid, time=grid.time[2:], east=grid.east[2:], north=grid.north[2:]))
    assert np.array_equal(out.east[2:], alone.east), "filled from its neighbour, not from two days before"


def test_land_of_a_model_stays_empty():
    sea = np.ones((8, 8), bool)
    sea[:3, :3] = False
    east = np.where(sea, wave(2, 8, 8), np.nan)
    east[0, 0, 5, 5] = np.nan
    out = fill_gaps(make(east, sea=sea))
    assert np.isnan(out.east[..., ~sea]).all() and np.isfinite(out.east[..., sea]).all()
    assert out.filled == pytest.approx(1 / (2 * sea.sum()))


def test_the_deepest_value_persists_and_inner_levels_are_interpolated():
    depth = [0.0, 10.0, 30.0, 60.0]
    east = np.broadcast_to(wave(2, 5, 5), (2, 4, 5, 5)) * np.array([1.0, 0.8, 0.5, 0.2])[None, :, None, None]
    gappy = east.copy()
    gappy[:, 3, :2] = np.nan
    gappy[:, 1, 3, 3] = np.nan
    out = fill_gaps(make(gappy, depth=depth, sea=np.ones((5, 5), bool)))
    assert np.array_equal(out.east[:, 3, :2], east[:, 2, :2])
    assert np.allclose(out.east[:, 1, 3, 3], east[:, 0, 3, 3] * (2 / 3) + east[:, 2, 3, 3] / 3)
    assert any("below known levels and repeats" in note for note in out.source.notes) and out.filled == 0.0


def test_errors_of_filled_values_grow_with_distance():
    rng = np.random.default_rng(3)
    east = wave(6, 20, 20) + 0.02 * rng.standard_normal((6, 1, 20, 20))
    gappy = east.copy()
    gappy[:, :, 5:14, 5:14] = np.nan
    sd = np.where(np.isfinite(gappy), 0.05, np.nan)
    out = fill_gaps(make(gappy, sd=sd))
    line = out.east_sd[2, 0, 9, 4:8]
    assert line[0] == 0.05 and np.all(np.diff(line) > 0)
    assert out.east_sd[2, 0, 9, 9] < np.sqrt(0.05**2 + 2.1 * np.nanvar(gappy)), "the growth has a ceiling"
    d = np.nanmean(np.diff(gappy[:, 0], axis=1) ** 2), np.nanmean(np.diff(gappy[:, 0], axis=2) ** 2)
    assert line[2] == pytest.approx(np.sqrt(0.05**2 + 0.7 * np.mean(d) * 2), rel=0.25)
    assert fill_gaps(make(gappy)).east_sd is None
    stated = fill_gaps(make(gappy), default_sd=0.05)
    assert np.allclose(stated.east_sd, out.east_sd)


def test_components_with_gaps_of_their_own():
    east, north = wave(), 0.5 * wave()
    a, b = east.copy(), north.copy()
    a[0, 0, 2, 2] = np.nan
    b[0, 0, 7, 7] = np.nan
    out = fill_gaps(make(a, b))
    assert np.isfinite(out.east).all() and np.isfinite(out.north).all()
    assert out.filled == pytest.approx(2 / a.size)


def test_nothing_to_fill_with():
    out = fill_gaps(make(np.full((2, 1, 4, 4), np.nan)))
    assert np.isnan(out.east).all() and out.filled == 0.0 and out.fill_method == "none"
    full = make(wave())
    assert np.array_equal(fill_gaps(full).east, full.east)


def test_bad_settings():
    with pytest.raises(ConfigError, match="Did you mean 'membrane'"):
        fill_gaps(make(wave()), method="membrne")
    with pytest.raises(ConfigError, match="positive"):
        fill_gaps(make(wave()), max_hours=0.0)


def _held_out(grid):
    """Masks of measured values to hide: single cells, blocks for one, six and all hours, outages, the outer edge."""
    rng = np.random.default_rng(0)
    known = np.isfinite(grid.east)
    frames, _, ny, nx = known.shape

    def blocks(size, length, number):
        mask = np.zeros_like(known)
        for first in range(0, frames, length):
            for _ in range(number):
                j, i = rng.integers(0, ny - size), rng.integers(0, nx - size)
                mask[first : first + length, :, j : j + size, i : i + size] = True
        return mask

    outage = np.zeros_like(known)
    outage[[frames // 4, frames // 4 + 1, 3 * frames // 4]] = True
    cases = {
        "single cells": rng.random(known.shape) < 0.1,
        "40 km, 1 h": blocks(7, 1, 6),
        "50 km, 6 h": blocks(9, 6, 6),
        "50 km, always": blocks(9, frames, 4),
        "outages of 2 and 1 h": outage,
    }
    return {name: mask & known for name, mask in cases.items()}


def _scores(grid, fill):
    """Root mean square error in cm/s of the values hidden, by case, and of all cases together."""
    found, squares = {}, []
    for name, mask in _held_out(grid).items():
        hidden = replace(grid, east=np.where(mask, np.nan, grid.east), north=np.where(mask, np.nan, grid.north))
        out = fill(hidden)
        error = np.concatenate([(out.east - grid.east)[mask], (out.north - grid.north)[mask]])
        assert np.isfinite(error).mean() > 0.99
        found[name] = 100 * np.sqrt(np.nanmean(error**2))
        squares.append(np.nanmean(error**2))
    return found, 100 * np.sqrt(np.mean(squares))


def _time_mean(grid):
    """Baseline: the mean of the cell over time, else of the frame."""
    parts = []
    for part in (grid.east, grid.north):
        count = np.isfinite(part).sum(axis=0)
        mean = np.nansum(part, axis=0) / np.maximum(count, 1)
        parts.append(np.where(np.isfinite(part), part, np.where(count > 0, mean, np.nanmean(part))))
    return replace(grid, east=parts[0], north=parts[1])


@pytest.mark.validation
@pytest.mark.parametrize(
    ("name", "box"),
    [("derived_nj_20190101_24h.nc", None), ("20180301T000000Z-20180301T120000Z_aggregated.nc", (36, 41, -75.5, -71))],
)
def test_methods_on_held_out_radar_currents(real, name, box):
    grid = read_currents(real("environment", "maracoos_hfr", name), box=box, fill=False)
    scores = {method: _scores(grid, lambda g, m=method: fill_gaps(g, method=m)) for method in METHODS}
    scores["time mean"] = _scores(grid, _time_mean)
    for method, (cases, overall) in scores.items():
        print(f"{name} {method:10s} all {overall:5.2f} cm/s", {case: round(rms, 2) for case, rms in cases.items()})
    assert scores["membrane"][1] < scores["staged"][1] < 0.6 * scores["time mean"][1]
    assert scores["membrane"][0]["single cells"] < 0.8 * scores["staged"][0]["single cells"]


@pytest.mark.validation
@pytest.mark.parametrize("name", ["derived_nj_20190101_24h.nc", "20180301T000000Z-20180301T120000Z_aggregated.nc"])
def test_stated_errors_match_held_out_ones(real, name):
    box = None if name.startswith("derived") else (36, 41, -75.5, -71)
    grid = replace(
        read_currents(real("environment", "maracoos_hfr", name), box=box, fill=False), east_sd=None, north_sd=None
    )
    for case, mask in _held_out(grid).items():
        hidden = replace(grid, east=np.where(mask, np.nan, grid.east), north=np.where(mask, np.nan, grid.north))
        out = fill_gaps(hidden, default_sd=1e-6)
        error = np.concatenate([(out.east - grid.east)[mask], (out.north - grid.north)[mask]])
        stated = np.concatenate([out.east_sd[mask], out.north_sd[mask]])
        ratio = np.sqrt(np.nanmean((error / stated) ** 2))
        print(f"{name} {case}: error over stated error {ratio:.2f}")
        assert 0.6 < ratio < 1.3


def test_speed_on_a_day_of_radar_currents(real):
    grid = read_currents(real("environment", "maracoos_hfr", "derived_nj_20190101_24h.nc"), fill=False)
    start = time.perf_counter()
    out = fill_gaps(grid)
    assert time.perf_counter() - start < 3.0, "a fraction of a second when the machine is idle"
    assert 0.2 < out.filled < 0.4
    assert np.nanmax(np.abs(out.east)) <= np.nanmax(np.abs(grid.east)) + 1e-6
