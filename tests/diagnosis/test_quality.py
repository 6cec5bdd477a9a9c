"""Settings that changed, counters that were reset, corrupt casts; and currents along a track."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.diagnosis.locate import Place, discoveries, onset, sentence
from glider_jax.diagnosis.quality import regime_changes
from glider_jax.inference.products import along_track, depth_along_track
from glider_jax.inference.streams import Stream
from glider_jax.records import BathymetryGrid, CurrentGrid, Recording, Source


def recording(**channels):
    """A recording of ten hours with some channels."""
    n = 3600
    time = 1.3e9 + 10.0 * np.arange(n)
    return Recording("made", time, {k: np.asarray(v, float) for k, v in channels.items()}, Source("test"), time[:1])


def test_a_changed_command_is_said():
    """A pump command that falls in mid-mission is named with both volumes."""
    volume = np.where(np.arange(3600) % 60 < 30, 230e-6, -230e-6) * np.where(np.arange(3600) < 1800, 1.0, 0.8)
    said = regime_changes(recording(commanded_pumped_volume=volume))
    assert any("from 230 to 184 cm3" in line for line in said)


def test_resets_thrusters_and_stuck_sensors_are_said():
    """Each has its sentence; a recording without any of them has none."""
    charge = np.linspace(0.0, 3000.0, 3600)
    charge[2000:] -= 1500.0
    said = regime_changes(
        recording(charge_used=charge, thruster_power=np.where(np.arange(3600) > 3000, 3.0, 0.0), heading=np.ones(3600))
    )
    assert any("was reset" in s for s in said) and any("thruster" in s for s in said)
    assert any("'heading' never changes" in s for s in said)
    assert regime_changes(recording(charge_used=np.linspace(0.0, 3000.0, 3600))) == []


def test_currents_along_a_track():
    """Between two frames linear, zero and unknown outside, corners without a value left out."""
    latitude, longitude, time = np.array([10.0, 11.0]), np.array([20.0, 21.0]), np.array([0.0, 100.0])
    east = np.zeros((2, 1, 2, 2))
    east[1, 0] = [[1.0, 3.0], [1.0, 3.0]]
    grid = CurrentGrid(time, np.zeros(1), latitude, longitude, east, -east, Source("test"))
    at = (np.array([50.0, 50.0]), np.array([10.5, 40.0]), np.array([20.5, 20.5]), np.zeros(2))
    u, v, known = along_track(grid, *at)
    assert u[0] == pytest.approx(1.0) and v[0] == pytest.approx(-1.0) and known.tolist() == [True, False] and u[1] == 0
    east[:, 0, 1, 1] = np.nan
    u, _, known = along_track(grid, np.array([100.0]), np.array([10.5]), np.array([20.5]), np.zeros(1))
    assert known[0] and u[0] == pytest.approx((1.0 + 3.0 + 1.0) / 3.0)
    chart = BathymetryGrid(latitude, longitude, np.array([[10.0, 20.0], [30.0, 40.0]]), Source("test"))
    assert depth_along_track(chart, np.array([10.5]), np.array([20.5]))[0] == pytest.approx(25.0)
    assert np.isnan(depth_along_track(chart, np.array([50.0]), np.array([20.5]))[0])


def test_hourly_frames_keep_a_half_daily_tide():
    """A straight line between them would lose two per cent; a frame that lacks costs only its own hours."""
    time, turn = 3600.0 * np.arange(48), 1.405189e-4
    space = np.ones((1, 1, 2, 2))
    tide = CurrentGrid(
        time, np.zeros(1), np.array([10.0, 11.0]), np.array([20.0, 21.0]),
        np.cos(turn * time)[:, None, None, None] * space, np.sin(turn * time)[:, None, None, None] * space,
        Source("test"),
    )  # fmt: skip
    at = np.linspace(7200.0, 44 * 3600.0, 3000)
    place = (np.full(3000, 10.5), np.full(3000, 20.5), np.zeros(3000))
    east, north, known = along_track(tide, at, *place)
    assert known.all()
    assert np.mean(east * np.cos(turn * at) + north * np.sin(turn * at)) == pytest.approx(1.0, abs=0.002)
    tide.east[20] = np.nan
    gappy, _, _ = along_track(tide, at, *place)
    far = np.abs(at - time[20]) > 7200.0
    np.testing.assert_array_equal(gappy[far], east[far])
    assert np.abs(gappy - np.cos(turn * at)).max() < 0.5


def test_false_discoveries_are_controlled():
    """Of many places by chance alone hardly any is called significant; strong ones among them are."""
    rng = np.random.default_rng(0)

    def place(p):
        return Place("vertical speed", "depth", p, 3.0, 10.0, 20.0, "m", "climbs", 1.1, "cm/s", 0.1)

    chance = discoveries([place(float(p)) for p in rng.uniform(size=200)])
    assert sum(p.significant for p in chance) <= 2
    mixed = discoveries([place(1e-6)] * 3 + [place(float(p)) for p in rng.uniform(0.2, 1.0, size=100)])
    assert [p.significant for p in mixed[:3]] == [True] * 3
    said = "The glider climbs 1.1 cm/s slower than the model, most where depth is 10 to 20 m."
    assert sentence(place(0.001)) == said


def test_an_onset_is_dated():
    """A step in the middle of a residual is found where it is."""
    time = np.linspace(0.0, 4.0 * 86400.0, 400)
    one = np.ones(400)
    stream = Stream("x", "1", "1", 1.0, one, time, np.arange(400), np.arange(400) // 20, one, one)
    day, z = onset(stream, np.where(time > 3.0 * 86400.0, 1.0, 0.0) + 0.3 * np.random.default_rng(1).normal(size=400))
    assert day == pytest.approx(3.0, abs=0.05) and z > 5.0
