"""Dead reckoning by depth rate: the force behind a glide is that of an independent solution, and comes out signed."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.diagnosis.candidates import untestable
from glider_jax.diagnosis.proof.strength import steady
from glider_jax.inference.controls import rows_of
from glider_jax.inference.kinematics import from_depth_rate, glide_force, held, slope, why_unknown
from glider_jax.inference.replay import build_replay
from glider_jax.inference.streams import gather
from glider_jax.readers.dead_reckoning import magnetic_variation
from glider_jax.readers.dives import legs
from tests.diagnosis.worlds import LATITUDE, fly, vehicle


@settings(max_examples=40, deadline=None)
@given(st.floats(0.5, 6.0), st.floats(0.25, 0.7), st.floats(0.1, 0.3))
def test_the_force_behind_a_glide_is_found_again(force, pitch, drag):
    """An independent steady glide of a known force has the vertical speed from which the force comes back."""
    rise, _ = steady(np.array([force]), np.array([pitch]), np.array([1025.0]), np.array([drag]), 10.5, 7.5, 0.1)
    found = glide_force(np.abs(rise), np.array([pitch]), np.array([1025.0]), 0.1, drag, 10.5, 7.5)
    assert found[0] == pytest.approx(force, rel=2e-3)


def test_a_slope_is_exact_on_a_line():
    """Uneven samples of a straight line."""
    time = np.cumsum(np.random.default_rng(1).uniform(1.0, 9.0, 200))
    assert slope(time, 3.0 - 0.17 * time) == pytest.approx(-0.17, abs=1e-9)


def test_the_recorded_volume_comes_back_from_depth_and_pitch():
    """A flight of the base model has the pumped volume that its depth rate and pitch ask for, of the right sign."""
    recording = fly(0.3)
    rows = rows_of(recording, legs(recording), magnetic_variation(recording), np.radians(LATITUDE))
    found = from_depth_rate(rows, vehicle(), np.radians(LATITUDE))
    glides = rows.settled & (rows.depth > 12.0)
    assert glides.sum() > 200 and not found.settled.any()
    assert np.median(np.abs(found.volume - rows.volume)[glides]) < 12e-6
    assert np.all(np.sign(found.volume[glides]) == rows.direction[glides])


def without_volume(recording):
    """A recording without its pumped volume."""
    channels = {k: v for k, v in recording.channels.items() if k != "pumped_volume"}
    return type(recording)(**{**recording.__dict__, "channels": channels})


def test_a_known_buoyancy_is_left_alone():
    """With the pumped volume the vehicle keeps its sigmas; without it the flight numbers are exact."""
    recording = fly(0.2)
    assert why_unknown(recording) == "" and held(vehicle(), recording) == vehicle()
    bare = without_volume(recording)
    assert "pumped volume" in why_unknown(bare)
    assert held(vehicle(), bare).quantities["flight.mass"].sigma == 0.0
    assert held(vehicle(), bare).quantities["energy.hotel"].sigma > 0.0


def test_nothing_is_asked_of_a_glide_whose_buoyancy_is_unknown():
    """A buoyancy made of the depth rate holds every error of the glide: its effects are not testable, not refuted."""
    recording = fly(0.4)
    with jax.enable_x64(True):
        known, unknown = gather(recording, vehicle()), gather(without_volume(recording), vehicle())
        asked, left = (
            {u.term for u in build_replay(one, vehicle()).unknowns if u.kind == "candidate"} for one in (known, unknown)
        )
    assert known.buoyancy_known and not unknown.buoyancy_known
    assert {"flight.ballast_offset", "flight.pitch_gain", "navigation.mean_current"} <= asked
    assert not {id for id in left if id.startswith("flight.")}
    assert {"navigation.mean_current", "sensor.pressure_offset"} <= left
    assert set(untestable(known)) < set(untestable(unknown)) and asked - left <= set(untestable(unknown))
