"""The live job's parts: a product along the way, the pack as it is, ages, what mission files contradict."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.config import SurfaceRule
from glider_jax.inference.currents import estimate_currents
from glider_jax.inference.evidence import situation_of
from glider_jax.products.live_inputs import check_age, course, uncovered
from glider_jax.products.live_missions import believes_dives, reconcile
from glider_jax.products.next_surfacing import charged
from glider_jax.readers.live_state import StaleFix
from glider_jax.readers.recordings import read_recording
from glider_jax.records import CurrentGrid, Source
from tests.mission.conftest import make_mission
from tests.products.tracks import gaussian_track
from tests.readers.glider_layouts import START, simulate, write_native


@pytest.fixture(scope="module")
def situation(tmp_path_factory):
    path = write_native(tmp_path_factory.mktemp("next") / "unit.nc", simulate(dives=5, yos=6))
    return situation_of(read_recording(path))


def product(*, east=lambda t, z, y, x: 0.1 + 0 * x, hours=60, box=(39.0, 41.0, -74.0, -72.0)):
    """A grid with values of a function of hours since the start, depth, latitude and longitude."""
    time = START + 3600.0 * np.arange(-2, hours)
    depth, latitude, longitude = (
        np.array([0.0, 20.0, 40.0, 400.0]),
        np.linspace(*box[:2], 21),
        np.linspace(*box[2:], 21),
    )
    t, z, y, x = np.meshgrid((time - START) / 3600.0, depth, latitude, longitude, indexing="ij")
    values = east(t, z, y, x)
    return CurrentGrid(time, depth, latitude, longitude, values, -0.5 * values, Source("made"))


def test_a_product_is_looked_up_where_and_when_the_glider_is(situation):
    """A field linear in time, depth and place: interpolation is exact, and the depth mean is over the dive."""
    grid = product(east=lambda t, z, y, x: 0.01 * t + 0.001 * z + 0.05 * (y - 40.0) + 0.02 * (x + 73.0))
    times = situation.time - np.array([0.0, 1800.0])
    at = course(grid, situation, 40.0)(times)
    first = situation.segments[0]
    track = sorted({(s.start_time, s.start_latitude, s.start_longitude) for s in situation.segments})
    track = np.array([*track, (situation.time, situation.latitude, situation.longitude)])
    latitude, longitude = (np.interp(times, track[:, 0], track[:, k]) for k in (1, 2))
    wanted = 0.01 * (times - START) / 3600.0 + 0.02 + 0.05 * (latitude - 40.0) + 0.02 * (longitude + 73.0)
    np.testing.assert_allclose(at[0], wanted, atol=1e-9)
    np.testing.assert_allclose(at[1], -0.5 * wanted, atol=1e-9)
    assert first.start_latitude != situation.latitude
    assert np.isnan(course(grid, situation, 40.0)(np.array([START - 9e5]))).all()


def test_a_product_that_fits_is_blended_in(situation):
    grid = product(east=lambda t, z, y, x: 0.12 + 0.0 * x)
    field = replace(grid, north=np.full_like(grid.north, -0.05))
    times = situation.time + np.arange(0.0, 24.0, 3.0) * 3600.0
    alone = estimate_currents(situation.seen, 40.0, times)
    blended = estimate_currents(situation.seen, 40.0, times, product=course(field, situation, 40.0))
    assert blended.product_weight > 0.6
    assert blended.sd[-1] < alone.sd[-1]
    assert abs(blended.mean[0, -1] - 0.12) < 0.04
    assert uncovered(field, situation, 12 * 3600.0) == []
    (text,) = uncovered(product(hours=8), situation, 48 * 3600.0)
    assert "does not cover" in text


def test_the_pack_is_as_the_glider_has_it():
    track = gaussian_track()
    battery = {"ah_per_day": {"scaled_by": 1.5}, "charge_left_percent": 43.0, "capacity_ah": 300.0}
    found = charged(track, battery)
    np.testing.assert_allclose(found.charge_used, 1.5 * track.charge_used)
    np.testing.assert_allclose(
        found.state_of_charge, 0.43 - 1.5 * track.charge_used / (3600.0 * 300.0), atol=1e-6
    )
    full = charged(track, battery | {"charge_left_percent": None})
    assert any("full pack" in text for text in full.notes)


def test_age_limits(situation):
    check_age(situation, situation.time + 5.9 * 3600.0, None)
    with pytest.raises(StaleFix, match="expected a fix of the last 6.0 h") as caught:
        check_age(situation, situation.time + 6.2 * 3600.0, None)
    assert caught.value.age == pytest.approx(6.2 * 3600.0)
    with pytest.raises(StaleFix, match="last 1.0 h"):
        check_age(situation, situation.time + 3700.0, 3600.0)


def test_the_glider_is_believed_where_mission_files_contradict_it(situation):
    at = (situation.latitude + 0.1, situation.longitude)
    known = replace(situation, waypoint=at)
    fits = make_mission(waypoints=(at, (39.5, -73.0)), surface=(SurfaceRule("every", seconds=3000.0),))
    mission, told = reconcile(fits, known)
    assert mission == fits and told == []
    far = make_mission(waypoints=((38.0, -73.0),), surface=(SurfaceRule("every", seconds=36000.0),))
    mission, told = reconcile(far, known)
    assert mission.waypoints[0] == at and mission.first_waypoint == 0
    assert "km from it" in told[0] and believes_dives(told)
    deep = make_mission(waypoints=(at,), surface=(SurfaceRule("every", seconds=3000.0),))
    mission, told = reconcile(replace(deep, yo=replace(deep.yo, dive_to=200.0)), known)
    assert "the glider turned at 40 m" in told[0] and mission.yo.dive_to == pytest.approx(40.0, abs=1.0)
    assert math.exp(known.behaviour.duration.centre) == pytest.approx(3000.0, rel=0.2)
