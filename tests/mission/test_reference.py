"""The fast step against an independent integrator with small steps, on the bundled ocean."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from glider_jax.mission.forecast import draw_run, fly_chunks, prepare
from glider_jax.mission.plan import overshoot_time
from glider_jax.mission.speeds import choose_speeds
from glider_jax.mission.step import sample_speed
from glider_jax.products.job import Options, read_inputs
from glider_jax.readers.missions import read_mission
from glider_jax_data import path as bundled
from tests.mission import reference


def _compare(n, days, step, correction):
    inputs = read_inputs(Options(n=n, days=days))
    mission = replace(read_mission(bundled("missions/new_jersey.toml")), current_correction=correction)
    currents = replace(inputs.currents, east_sd=None, north_sd=None)
    quantities = dict(inputs.vehicle.quantities)
    for name in ("perturbation.current_error", "perturbation.initial_position"):
        quantities[name] = replace(quantities[name], value=0.0)
    vehicle = replace(inputs.vehicle, quantities=quantities)
    nodes, _ = choose_speeds(mission, vehicle, "distribution", has_currents=True)
    run = prepare(
        mission, vehicle, currents=currents, bathymetry=inputs.bathymetry, speeds=nodes, duration=days * 86400.0, seed=3
    )
    track = next(iter(fly_chunks(n, run)))
    words = tuple(map(jnp.asarray, draw_run(run, 0, n)[0].key))
    segments = int(days * 8) + 4
    draw = jax.vmap(lambda w: jax.vmap(lambda s: sample_speed(run.plan, w, s))(jnp.arange(segments, dtype=jnp.int32)))
    p = track.parameters
    speeds = np.asarray(draw(words), float) * p["speed_factor"][:, None]

    def value(name):
        return np.asarray(p.get(name, vehicle.value(name)), float) * np.ones(n)

    grid = [
        reference.Grid(np.asarray(v, float)[:, 0], currents.latitude, currents.longitude, currents.time)
        for v in (np.nan_to_num(currents.east), np.nan_to_num(currents.north))
    ]
    b = inputs.bathymetry
    table, drawn = reference.fly(
        n=n, start=mission.start_position, t0=mission.start, duration=days * 86400.0, waypoints=mission.waypoints,
        radius=mission.waypoint_radius, period=10800.0, correction=float(correction), speeds=speeds, step=step,
        yo={"dive_to": 100.0, "climb_to": 3.0, "altitude": 5.0, "tangent": np.tan(mission.yo.dive_pitch)},
        overshoot=overshoot_time(vehicle, mission), stay=mission.surface_stay * p["surface_stay_factor"].astype(float),
        heading=p["heading_error"].astype(float), east=grid[0], north=grid[1],
        outputs=track.time, floor=reference.Grid(np.asarray(b.depth, float)[None], b.latitude, b.longitude),
        energy={
            "intercept": value("energy.pump_dive_to_climb.intercept"),
            "slope": value("energy.pump_dive_to_climb.slope"),
            "climb_to_dive": value("energy.pump_climb_to_dive"),
            "brake": value("energy.brake"),
            "hotel": value("energy.hotel"),
        },
    )  # fmt: skip
    return track, table, drawn


def _errors(track, table):
    """Distances (m) and differences in time (s) of the surfacings both made."""
    s = min(track.surfacing_time.shape[1], table.shape[2])
    time, lat, lon, _ = table[:, :, :s]
    dlat = np.radians(track.surfacing_latitude[:, :s] - lat) * reference.radii(lat)[0]
    dlon = np.radians(track.surfacing_longitude[:, :s] - lon) * reference.radii(lat)[1]
    distance = np.hypot(dlat, dlon)
    known = np.isfinite(distance)
    return distance, track.surfacing_time[:, :s] - time, known


def _energy_errors(track, drawn, first_day):
    """Relative differences of the energy drawn by each output time after the first days."""
    mine = track.energy.sum(-1, dtype=float)
    late = track.time > track.time[0] + first_day * 86400.0
    known = np.isfinite(drawn) & track.active & late
    return mine[known] / drawn[known] - 1.0


@pytest.mark.parametrize("correction", [True, False])
def test_two_days_agree_with_small_steps(correction):
    track, table, drawn = _compare(24, 2.0, 20.0, correction)
    distance, late, known = _errors(track, table)
    assert known.sum() > 24 * 14
    assert np.percentile(distance[known], 99) < 50.0
    assert np.percentile(np.abs(_energy_errors(track, drawn, 1.0)), 99) < 3e-3
    # A yo half way through when the clock runs out turns a small phase difference into up to a minute or two.
    assert np.percentile(np.abs(late[known]), 99) < 180.0


@pytest.mark.validation
def test_fifteen_days_agree_with_five_second_steps(capsys):
    track, table, drawn = _compare(200, 15.0, 5.0, True)
    distance, late, known = _errors(track, table)
    worst = np.where(known, distance, 0).max(axis=1)
    # Early on, one stroke more or less by an output time is a per mille by itself.
    share = _energy_errors(track, drawn, first_day=3.0)
    with capsys.disabled():
        print(
            f"\nposition: median {np.median(distance[known]):.1f} m, p99 {np.percentile(distance[known], 99):.1f} m; "
            f"never over 50 m: {100 * np.mean(worst < 50):.1f} % of members; "
            f"energy p99 {np.percentile(np.abs(share), [50, 99])}"
        )
    assert np.percentile(distance[known], 99) < 50.0
    assert np.percentile(np.abs(share), 99) < 1e-3
    # Quantiles of the ensemble differ by far less than the sampling error of 200 members.
    for k in (20, 60, 100):
        pairs = (track.surfacing_longitude[:, k], table[2, :, k]), (track.surfacing_time[:, k], table[0, :, k])
        for mine, theirs in pairs:
            both = np.isfinite(mine) & np.isfinite(theirs)
            off = np.quantile(mine[both], (0.05, 0.5, 0.95)) - np.quantile(theirs[both], (0.05, 0.5, 0.95))
            assert np.all(np.abs(off) < 0.5 * np.std(theirs[both]) / np.sqrt(both.sum()))
