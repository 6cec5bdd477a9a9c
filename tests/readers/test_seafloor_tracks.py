"""A seafloor from glider soundings: planted floors come back, errors stay within their claimed size."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.readers.seafloor_tracks import (
    METRES,
    grid_seafloor,
    interpolate,
    screen_soundings,
    seafloor_from_recordings,
)
from glider_jax.records import BathymetryGrid, Recording, Source

CENTRE = (39.2, -73.5)
EAST = METRES * np.cos(np.radians(CENTRE[0]))


def place(x, y):
    """Latitude and longitude of metres east and north of the centre."""
    return CENTRE[0] + np.asarray(y) / METRES, CENTRE[1] + np.asarray(x) / EAST


def zigzag(count=600, size=20e3):
    """A track that fills a square in six legs."""
    s = np.linspace(0.0, 6.0, count)
    leg = np.minimum(s.astype(int), 5)
    x = size * np.abs((s - leg) - (leg % 2)) - size / 2
    return x, size * s / 6.0 - size / 2


def floor(x, y):
    return 60.0 + 1.5e-3 * x + 4.0 * np.sin(x / 3e3) * np.cos(y / 4e3)


def at(grid, x, y, part="depth"):
    lat, lon = place(x, y)
    whole = BathymetryGrid(grid.latitude, grid.longitude, getattr(grid, part), grid.source)
    return interpolate(whole, lat, lon)


def test_a_planted_random_floor_comes_back_within_its_claimed_error():
    """Floors drawn from the covariance that is assumed: the scores must have unit size, not only be small."""
    x, y = zigzag(300)
    points = np.random.default_rng(5).uniform(-9e3, 9e3, (150, 2))
    where = np.concatenate([np.stack([x, y], axis=1), points])
    apart = np.linalg.norm(where[:, None] - where[None], axis=-1)
    root = np.linalg.cholesky(5.0**2 * np.exp(-apart / 4e3) + 1e-9 * np.eye(len(where)))
    scores, lengths = [], []
    for seed in range(6):
        draw = np.random.default_rng(seed)
        truth = 60.0 + root @ draw.normal(size=len(where))
        depth = truth[: x.size] + draw.normal(0.0, 0.7, x.size)
        grid = grid_seafloor([(*place(x, y), depth)], spacing=400.0, margin=500.0)
        sd = at(grid, *points.T, "sd")
        scores.append((at(grid, *points.T) - truth[x.size :]) / sd)
        lengths.append(float(grid.source.notes[-1].split()[2]))
        assert sd.max() < 6.5
    scores = np.concatenate(scores)
    assert np.sqrt(np.mean(scores**2)) == pytest.approx(1.0, abs=0.15)
    assert 0.6 < np.mean(np.abs(scores) < 1.0) < 0.76 and 0.92 < np.mean(np.abs(scores) < 2.0) < 0.98
    assert 2e3 < np.median(lengths) < 8e3


def test_uncertainty_grows_from_the_track_to_the_spread_of_the_floor():
    x = np.linspace(-10e3, 10e3, 300)
    depth = floor(x, 0 * x)
    grid = grid_seafloor([(*place(x, 0 * x), depth)], spacing=500.0, correlation_length=3e3, margin=30e3)
    away = at(grid, np.zeros(6), np.array([0.0, 1e3, 3e3, 6e3, 12e3, 28e3]), "sd")
    assert (np.diff(away) > 0).all() and away[0] < 0.6 * away[2]
    assert away[-1] == pytest.approx(np.nanmax(grid.sd), rel=0.02)
    far = at(grid, np.array([0.0]), np.array([28e3]))[0]
    assert far == pytest.approx(depth.mean(), abs=2.0 * away[-1])


def test_background_is_returned_to_and_corrected():
    axis_lat, axis_lon = place(np.linspace(-40e3, 40e3, 41), np.linspace(-40e3, 40e3, 41))
    background = BathymetryGrid(axis_lat, axis_lon, np.full((41, 41), 50.0), Source("flat"))
    x = np.linspace(-10e3, 10e3, 200)
    grid = grid_seafloor(
        [(*place(x, 0 * x), np.full(x.size, 53.0))],
        spacing=500.0, correlation_length=2e3, background=background, margin=20e3,
    )  # fmt: skip
    assert at(grid, 0.0, 0.0) == pytest.approx(53.0, abs=0.3)
    assert at(grid, 0.0, 18e3) == pytest.approx(50.0, abs=0.05)
    with pytest.raises(DataError, match="background"):
        elsewhere = BathymetryGrid(axis_lat + 5.0, axis_lon, background.depth, background.source)
        grid_seafloor([(*place(x, 0 * x), x * 0 + 53.0)], spacing=500.0, background=elsewhere)


def test_false_bottoms_are_left_out_and_counted():
    x, y = zigzag()
    depth = floor(x, y)
    wrong = np.array([50, 51, 200, 201, 400])
    depth[wrong] = [20.0, 21.0, 95.0, 20.0, 30.0]
    grid = grid_seafloor([(*place(x, y), depth)], spacing=500.0)
    assert "595 soundings gridded, 5 false bottoms" in grid.source.notes[0]
    keep = screen_soundings(np.stack([x, y], axis=1), floor(x, y))
    assert keep.all()


def test_several_tracks_and_the_antimeridian():
    x = np.linspace(-5e3, 5e3, 80)
    lat, lon = 10.0 + 0 * x, 180.0 + x / (METRES * np.cos(np.radians(10.0)))
    east = lon > 180.0
    halves = [
        (lat[~east], lon[~east], 40.0 + 0 * x[~east]),
        (lat[east], lon[east] - 360.0, 40.0 + 0 * x[east]),
    ]
    grid = grid_seafloor(halves, spacing=500.0, correlation_length=1e3)
    assert grid.longitude[0] < 180.0 < grid.longitude[-1] and np.ptp(grid.longitude) < 0.2
    np.testing.assert_allclose(grid.depth, 40.0, atol=1e-6)


def recording(**channels):
    time = np.arange(200.0) * 60.0
    x = np.linspace(-5e3, 5e3, 200)
    lat, lon = place(x, 0 * x)
    lat[1::2] = np.nan
    given = {"latitude": lat, "longitude": lon, **channels}
    return Recording(
        "unit", time, {k: v for k, v in given.items() if v is not None}, Source("made", {"a": "b"}), time[:1]
    )


def test_recordings_with_water_depth_or_with_altitude():
    truth = floor(np.linspace(-5e3, 5e3, 200), 0.0)
    sparse = np.where(np.arange(200) % 3 == 1, truth, np.nan)
    direct = seafloor_from_recordings([recording(water_depth=sparse)])
    depth = 20.0 + 10.0 * np.sin(np.arange(200.0))
    altitude = np.where(np.arange(200) % 3 == 1, truth - depth, -1.0)
    added = seafloor_from_recordings([recording(depth=depth, altitude=altitude)])
    assert at(direct, 1e3, 0.0) == pytest.approx(floor(1e3, 0.0), abs=0.5)
    np.testing.assert_allclose(added.depth, direct.depth, atol=1e-9)
    assert direct.source.files == {"a": "b"} and "unit: 67 soundings." in direct.source.notes


def test_recordings_without_soundings_say_what_they_lack():
    with pytest.raises(DataError, match="neither water_depth nor depth and altitude"):
        seafloor_from_recordings([recording()])
    with pytest.raises(DataError, match="no latitude"):
        seafloor_from_recordings([recording(latitude=None)])
    with pytest.raises(DataError, match="no sounding"):
        seafloor_from_recordings([recording(water_depth=np.full(200, -1.0))])
    with pytest.raises(DataError, match="no recording"):
        seafloor_from_recordings([])
    both = seafloor_from_recordings([recording(), recording(water_depth=np.full(200, 30.0))])
    assert any("Left out unit" in note for note in both.source.notes)


def test_bad_arguments():
    x, y = zigzag(50)
    track = (*place(x, y), floor(x, y))
    for words, kwargs in (
        ("spacing", {"spacing": 0.0}),
        ("correlation_length", {"spacing": 500.0, "correlation_length": -1.0}),
        ("3 cells", {"spacing": 1e6}),
        ("wider spacing", {"spacing": 5.0, "margin": 20e3}),
    ):
        with pytest.raises(DataError, match=words):
            grid_seafloor([track], **kwargs)
    with pytest.raises(DataError, match="one length"):
        grid_seafloor([(x, y, x[:3])], spacing=500.0)
    with pytest.raises(DataError, match="3 soundings"):
        grid_seafloor([(x, y, x * np.nan)], spacing=500.0)


@pytest.mark.parametrize(
    ("name", "spacing", "margin", "largest_rms"),
    [("comet2019", 500.0, 20e3, 1.5), ("ru28_2017", 250.0, 5e3, 1.3)],
)
def test_real_soundings_that_were_held_out_lie_within_the_claimed_error(real, name, spacing, margin, largest_rms):
    """Leave out an eighth of the track at a time: better than its mean depth, and honest about how much."""
    with netCDF4.Dataset(real("recordings", name, f"{name}.nc")) as file:
        get = {v: np.ma.filled(file[v][:].astype(float), np.nan) for v in ("time", "m_lat", "m_lon", "m_water_depth")}
    known = np.isfinite(get["m_lat"]) & np.isfinite(get["m_lon"])
    lat, lon = (np.interp(get["time"], get["time"][known], get[v][known]) for v in ("m_lat", "m_lon"))
    sounded = get["m_water_depth"] > 0
    lat, lon, depth = lat[sounded], lon[sounded], get["m_water_depth"][sounded]
    place_m = np.stack([(lon - lon[0]) * METRES * np.cos(np.radians(lat[0])), (lat - lat[0]) * METRES], axis=1)
    sound = screen_soundings(place_m, depth)
    assert sound.mean() > 0.99
    error, score, plain = [], [], []
    for block in np.array_split(np.arange(depth.size), 8):
        used = np.ones(depth.size, bool)
        used[block] = False
        grid = grid_seafloor([(lat[used], lon[used], depth[used])], spacing=spacing, margin=margin)
        block = block[sound[block]]
        noise = float(grid.source.notes[-1].rsplit("sounding ")[1].split(" m")[0])
        sd = interpolate(BathymetryGrid(grid.latitude, grid.longitude, grid.sd, grid.source), lat[block], lon[block])
        error.append(depth[block] - interpolate(grid, lat[block], lon[block]))
        score.append(error[-1] / np.hypot(sd, noise))
        plain.append(depth[block] - depth[used].mean())
    error, score, plain = (np.concatenate(part) for part in (error, score, plain))
    assert np.isfinite(error).all()
    assert np.sqrt(np.mean(error**2)) < min(largest_rms, 0.85 * np.sqrt(np.mean(plain**2)))
    assert 0.5 < np.sqrt(np.mean(score**2)) < 1.5
    assert np.mean(np.abs(score) < 2.0) > 0.85
