"""The ensemble before and after: terms carried over, members judged where the glider surfaced."""

from __future__ import annotations

from types import SimpleNamespace

import gsw
import numpy as np
import pytest

from glider_jax.diagnosis.flown import charge_per_day, fitted, profile, score
from glider_jax.physics.model import build_model, parameters
from tests.diagnosis.worlds import fly, vehicle


def test_named_effects_fly_as_terms():
    """Parameters of an effect and of its parts become terms, shapes too, and the model has them."""
    effects = [
        {"id": "navigation.mean_current", "shapes": {}, "parameters": [
            {"name": "east", "value": 0.1, "sd": 0.01, "unit": "m s-1"},
            {"name": "navigation.tidal_current.east_cosine", "value": 0.05, "sd": 0.01, "unit": "m s-1"}]},
        {"id": "flight.bladder_air", "shapes": {"decay": 900.0}, "parameters": [
            {"name": "volume", "value": 2e-5, "sd": 1e-6, "unit": "m3"}]},
    ]  # fmt: skip
    found = fitted(vehicle(), effects)
    assert found.terms["navigation.tidal_current"]["east_cosine"].value == 0.05
    numbers = parameters(build_model(found, dtype=np.float32))
    assert float(numbers["navigation.mean_current.east"]) == pytest.approx(0.1, rel=1e-6)
    assert float(numbers["flight.bladder_air.decay"]) == pytest.approx(900.0)
    assert vehicle().terms == {}


def test_members_are_judged_at_the_time_and_place_of_each_surfacing():
    """Two members 100 m west and 300 m east of the truth: the mean misses by 100 m; charge is per day."""
    degree = 180.0 / np.pi / 6_371_000.0 / np.cos(np.radians(39.0))
    time = np.array([0.0, 43200.0, 86400.0])
    longitude = -73.0 + degree * np.array([[0.0, -100.0, 0.0], [0.0, 300.0, 0.0]])
    track = SimpleNamespace(
        time=time, latitude=np.full((2, 3), 39.0), longitude=longitude,
        charge_used=np.array([[0.0, 3600.0, 7200.0], [0.0, 3600.0, 14400.0]]),
    )  # fmt: skip
    told = score(track, 5e8, np.array([5e8 + 43200.0]), np.array([[39.0, -73.0]]), 2.5)
    assert told["position_error_m"] == pytest.approx(100.0, rel=0.01)
    assert told["energy_score_m"] == pytest.approx(200.0 - 0.5 * 400.0, abs=3.0)
    assert told["charge_ah_per_day"] == pytest.approx(3.0)
    assert told["charge_crps_ah_per_day"] is not None


def test_charge_and_water_are_the_recordings_own():
    """The counter's ampere-hours a day, and a profile within what the CTD saw."""
    recording = fly(0.5)
    per_day = charge_per_day(recording, recording.time[0], recording.time[-1])
    mean = float(np.nanmean(recording["current"])) * 24.0
    assert per_day == pytest.approx(mean, rel=0.1)
    assert profile(recording) is None
    depth = np.nan_to_num(recording["depth"])
    recording.channels["temperature"] = np.full(recording.time.size, 283.15)
    recording.channels["conductivity"] = 0.1 * gsw.C_from_SP(35.0, 10.0, gsw.p_from_z(-depth, 39.0))
    water = profile(recording)
    assert np.all(np.diff(water.depth) > 0.0) and water.depth.max() < depth.max()
    assert np.all(np.abs(water.absolute_salinity - 35.165) < 0.01)
    assert np.all(np.abs(water.conservative_temperature - 9.99) < 0.05)
