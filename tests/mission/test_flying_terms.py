"""Physics of the library flown by the ensemble: all of it at once, and single effects with known answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.config import Quantity
from glider_jax.physics.library import LIBRARY
from glider_jax.physics.term import declared
from tests.mission.conftest import make_mission
from tests.mission.test_closed_forms import SPEED, STRAIGHT, fly, quiet


def with_terms(vehicle, **terms):
    """The vehicle with optional physics, given as id (with __ for the dot) to parameters in SI."""
    named = {
        name.replace("__", "."): {p: Quantity(v) for p, v in values.items()} for name, values in terms.items()
    }
    return replace(vehicle, terms=named)


def test_every_term_of_the_library_flies_at_once(vehicle):
    terms = {}
    for kind in LIBRARY:
        amplitudes = {n: p for n, p in declared(kind).items() if p.role == "amplitude"}
        weak = {n: Quantity(p.prior.centre + 0.1 * p.prior.sd, unit=p.unit) for n, p in amplitudes.items()}
        terms[kind.info.id] = weak
    from glider_jax.mission.forecast import forecast, prepare

    loaded = replace(quiet(vehicle), terms=terms)
    run = prepare(make_mission(), loaded, speed="flight", duration=43200.0, start=0.0, spread=0.3)
    track = forecast(6, run)
    assert np.isfinite(track.latitude).all() and np.isfinite(track.energy).all()
    assert np.all(track.distance_through_water[:, -1] > 1000.0), [int(o) for o in track.outcome]


def test_mean_current_carries_the_glider(vehicle):
    _, base = fly(vehicle)
    run, track = fly(with_terms(vehicle, navigation__mean_current={"east": 0.1, "north": 0.0}))
    east, north = run.frame.to_metres(track.latitude[0, -1], track.longitude[0, -1])
    sx, _ = run.frame.stretch(0.5 * north)
    assert east / sx == pytest.approx(0.1 * 86400.0, rel=2e-3)
    assert track.latitude[0, -1] == pytest.approx(base.latitude[0, -1], abs=1e-4)


def test_load_on_dives_costs_power_times_their_time(vehicle):
    _, base = fly(vehicle)
    _, track = fly(with_terms(vehicle, energy__dive_only_load={"power": 0.5}))
    extra = (track.energy[0, -1] - base.energy[0, -1]).sum()
    assert extra == pytest.approx(0.5 * 43200.0, rel=0.02)


def test_declination_turns_the_course_clockwise(vehicle):
    angle = 0.1
    run, track = fly(with_terms(vehicle, navigation__magnetic_declination={"angle": angle}))
    east, north = run.frame.to_metres(track.latitude[0, -1], track.longitude[0, -1])
    sx, _ = run.frame.stretch(0.5 * north)
    assert np.arctan2(east / sx, north) == pytest.approx(angle, rel=0.01)
    assert np.hypot(east / sx, north) == pytest.approx(SPEED * 86400.0, rel=1e-3)


def test_fouling_slows_a_flight_more_and_more(vehicle):
    from glider_jax.mission.forecast import forecast, prepare

    fouled = with_terms(quiet(vehicle), flight__drag_growth={"rate": 0.3 / 86400.0})
    run = prepare(make_mission(**STRAIGHT), fouled, speed="flight", duration=3 * 86400.0, start=0.0, spread=0.0)
    track = forecast(1, run)
    daily = np.diff(np.interp(np.arange(4) * 86400.0, track.time - track.time[0], track.distance_through_water[0]))
    assert daily[0] > daily[1] > daily[2]
    # Speed goes with the root of the drag; the tables are made at the start of each day.
    assert daily[2] / daily[0] == pytest.approx((1 / 1.6) ** 0.5, rel=0.05)
