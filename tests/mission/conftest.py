"""Missions and oceans for the engine's tests; the fast step runs in float32 as it does for users."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.config import Aborts, Mission, SurfaceRule, Yo
from glider_jax.readers.vehicles import read_vehicle


def make_mission(**changes) -> Mission:
    """A mission out to sea and back over a plain grid near 39 N 74 W."""
    base = Mission(
        name="test",
        waypoints=((39.0, -73.6), (39.0, -74.0)),
        yo=Yo(50.0, 3.0, math.radians(26.0), math.radians(26.0), dive_altitude=5.0),
        surface=(SurfaceRule("every", seconds=10800.0), SurfaceRule("mission_done", ends_mission=True)),
        start=0.0,
        start_position=(39.0, -74.0),
        waypoint_radius=500.0,
        surface_stay=600.0,
        aborts=Aborts(),
        current_correction=False,
    )
    return replace(base, **changes)


@pytest.fixture(scope="session")
def vehicle():
    """The bundled shallow glider."""
    return read_vehicle(None)


@pytest.fixture(scope="session")
def constant_speed():
    """Nodes and probabilities of one speed, m/s."""
    return lambda speed: (np.array([speed, speed]), np.array([0.0, 1.0]))
