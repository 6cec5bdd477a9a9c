"""Fits: recovery, coverage, outliers, identifiability, and the fragment that the forecaster reads."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from scipy import stats

from glider_jax.board import fits
from glider_jax.board.analysis import analyse_board, events_csv, join_records
from glider_jax.board.calibration import nominal
from glider_jax.board.capture import Capture, Options
from glider_jax.board.decoder import decode_bytes
from glider_jax.board.emulator import PtyLine
from glider_jax.board.events import AT_SURFACE, CLIMB_TO_DIVE, DIVE_TO_CLIMB, Event
from glider_jax.board.fragment import model_dict, vehicle_toml, write_atomically
from glider_jax.board.record import collect
from glider_jax.board.robust import robust_fit, t_quantile
from glider_jax.board.simulate import Plan, simulate
from glider_jax.board.steady import Level
from glider_jax.errors import FitError
from glider_jax.readers.vehicles import read_vehicle
from tests.board.test_capture import captured, start


def stroke(depth, energy, direction=DIVE_TO_CLIMB, volume=460e-6, sd=5.0, time=0.0):
    return Event("pump", direction, time, 20.0, depth, volume, 2.0, energy / 14, energy, sd, 14.0)


def strokes(rng, depths, a=110.0, b=6.0, scatter=8.0, volume=460e-6):
    volumes = np.broadcast_to(volume, np.shape(depths))
    return [
        stroke(z, (a + b * z) * v / 460e-6 + rng.normal(0, scatter), volume=v, time=600.0 * i)
        for i, (z, v) in enumerate(zip(depths, volumes, strict=True))
    ]


LEVELS = [Level("submerged", "", 2.0, 0.1, 1.9, 1.4, 9000.0), Level("surface", "", 4.5, 0.2, 4.4, 3.0, 900.0)]


@pytest.mark.parametrize("dof", [1, 2, 5, 30, 400])
def test_student_t_equals_scipys(dof):
    for p in (0.6, 0.9, 0.975, 0.999):
        assert t_quantile(p, dof) == pytest.approx(stats.t.ppf(p, dof), rel=1e-7)
    assert t_quantile(0.975, 1e9) == pytest.approx(1.959964, rel=1e-6)


def test_without_outliers_it_is_near_least_squares():
    rng = np.random.default_rng(0)
    z = rng.uniform(10, 90, 60)
    y = 110 + 6 * z + rng.normal(0, 10, 60)
    fit = robust_fit(np.stack([np.ones(60), z], axis=1), y, np.full(60, 10.0))
    slope, intercept = np.polyfit(z, y, 1)
    assert fit.theta == pytest.approx([intercept, slope], rel=0.03)
    assert fit.sigma()[1] == pytest.approx(10 / (z.std() * 60**0.5), rel=0.3)


@pytest.mark.parametrize(("count", "bad"), [(4, 0), (6, 0), (15, 0), (40, 0), (40, 4)])
def test_intervals_cover_as_stated(count, bad):
    rng = np.random.default_rng(count + bad)
    inside, trials = np.zeros(2), 150
    for _ in range(trials):
        z = rng.uniform(10, 90, count)
        y = 110 + 6 * z + rng.normal(0, np.hypot(10, 8), count)
        y[:bad] += 400
        fit = robust_fit(np.stack([np.ones(count), z], axis=1), y, np.full(count, 10.0))
        inside += np.abs(fit.theta - [110, 6]) <= t_quantile(0.975, fit.dof) * fit.sigma()
    # Four standard errors of a binomial of 150 below 95 %.
    assert (inside / trials > 0.88).all()


def test_scatter_beyond_the_known_error_is_found():
    rng = np.random.default_rng(3)
    y = rng.normal(100, 20, 400)
    fit = robust_fit(np.ones((400, 1)), y, np.full(400, 5.0))
    assert fit.scatter == pytest.approx((20**2 - 5**2) ** 0.5, rel=0.12)
    quiet = robust_fit(np.ones((400, 1)), rng.normal(100, 5, 400), np.full(400, 20.0))
    assert quiet.scatter == 0 and quiet.sigma()[0] == pytest.approx(1.0, rel=0.2)


def test_held_out_error_is_leave_one_out():
    rng = np.random.default_rng(1)
    z = rng.uniform(0, 50, 12)
    design = np.stack([np.ones(12), z], axis=1)
    y = design @ [100, 5] + rng.normal(0, 1, 12)
    sd = np.full(12, 50.0)
    held = robust_fit(design, y, sd).held_out()
    for i in range(12):
        keep = np.arange(12) != i
        other = robust_fit(design[keep], y[keep], sd[keep])
        assert held[i] == pytest.approx(y[i] - design[i] @ other.theta, rel=2e-2, abs=1e-2)


def test_line_is_recovered():
    events = strokes(np.random.default_rng(0), np.linspace(10, 90, 40))
    pump = fits.fit_pump(events, "line")
    error = np.abs(pump.theta - [110, 6])
    assert (error < 3 * np.sqrt(np.diag(pump.covariance))).all() and pump.identifiable
    assert pump.covariance[0, 1] < 0
    assert pump.predict(50.0) == pytest.approx(410, abs=6)
    assert pump.interval(50.0) < pump.interval(90.0) < pump.interval(90.0, single=True)


def test_the_form_with_the_smaller_held_out_error_is_taken():
    rng = np.random.default_rng(2)
    depths = rng.uniform(10, 90, 60)
    by_volume = strokes(rng, depths, volume=rng.uniform(200e-6, 500e-6, 60), scatter=4.0)
    model = fits.fit_energy(by_volume, LEVELS, "x")
    assert model.pump.form == "volume" and model.other.form == "line"
    assert model.pump.held_out < 0.3 * model.other.held_out
    share = model.pump.reference_volume / 460e-6
    assert model.pump.theta / share == pytest.approx([110, 6], rel=0.1)
    fixed = [
        stroke(z, 110 + 6 * z + rng.normal(0, 4), volume=v, time=i)
        for i, (z, v) in enumerate(zip(depths, rng.uniform(200e-6, 500e-6, 60), strict=True))
    ]
    assert fits.fit_energy(fixed, LEVELS, "x").pump.form == "line"


def test_outliers_do_not_move_the_fit():
    rng = np.random.default_rng(4)
    events = strokes(rng, rng.uniform(10, 90, 40))
    spoiled = events[:36] + [stroke(e.depth, e.energy + 900) for e in events[36:]]
    pump = fits.fit_pump(spoiled, "line")
    assert pump.outliers == 4
    assert np.abs(pump.theta - fits.fit_pump(events, "line").theta)[1] < 0.3


def test_one_depth_only_is_said_and_tied_to_physics():
    rng = np.random.default_rng(5)
    model = fits.fit_energy(strokes(rng, np.full(20, 750.0) + rng.normal(0, 0.2, 20)), LEVELS, "deep")
    assert any("not identifiable" in w for w in model.warnings)
    slope = model.estimates[fits.SLOPE]
    assert slope.value == pytest.approx(2 * 1025 * 9.81 * 460e-6, rel=0.4) and slope.sigma > 0.3 * slope.value
    # At the depth that was seen the model is as good as ever.
    assert model.pump.predict(750.0) == pytest.approx(110 + 6 * 750, rel=0.01)
    assert model.pump.interval(750.0) < 30.0


def test_strokes_at_the_surface_make_a_deep_slope_identifiable():
    rng = np.random.default_rng(6)
    deep = strokes(rng, np.full(8, 750.0) + rng.normal(0, 0.2, 8))
    top = [stroke(0.3, 110.0 * 0.7 + rng.normal(0, 4), AT_SURFACE, 0.7 * 460e-6) for _ in range(8)]
    model = fits.fit_energy(deep + top, LEVELS, "deep")
    assert model.pump.identifiable and model.pump.form == "volume"
    assert model.pump.theta == pytest.approx([110, 6], rel=0.1)
    assert any("two depths cannot test" in w for w in model.warnings)


def test_slow_change_that_the_model_lacks_is_said():
    rng = np.random.default_rng(7)
    events = strokes(rng, rng.uniform(10, 90, 60), scatter=2.0)
    ageing = [Event(**{**e.__dict__, "energy": e.energy + 1.5 * i}) for i, e in enumerate(events)]
    assert any("correlated" in w for w in fits.fit_energy(ageing, LEVELS, "x").warnings)
    assert not fits.fit_energy(events, LEVELS, "x").warnings[1:]


def test_too_few_strokes():
    with pytest.raises(FitError, match="at least 3 complete strokes"):
        fits.fit_energy([stroke(10.0, 100.0)] * 2, LEVELS, "x")
    lost = [Event(**{**stroke(10.0 + i, 100.0).__dict__, "complete": False}) for i in range(9)]
    with pytest.raises(FitError, match="found 0"):
        fits.fit_energy(lost, LEVELS, "x")


def test_shared_errors_do_not_average_out():
    rng = np.random.default_rng(8)
    climbs = [stroke(1.0, 150 + rng.normal(0, 5), CLIMB_TO_DIVE, -460e-6) for _ in range(200)]
    model = fits.fit_energy(
        [*strokes(rng, rng.uniform(10, 90, 200)), *climbs], LEVELS, "x", fits.Gains(common=0.02)
    )
    climb = model.estimates[fits.CLIMB]
    assert climb.random < 1.0 and climb.sigma == pytest.approx(3.0, rel=0.1)
    i, j = model.names.index(fits.INTERCEPT), model.names.index(fits.CLIMB)
    assert model.covariance[i, j] == pytest.approx(
        0.02**2 * model.estimates[fits.INTERCEPT].value * climb.value
    )
    assert np.linalg.eigvalsh(model.covariance).min() > 0
    assert np.sqrt(np.diag(model.covariance)) == pytest.approx(
        [model.estimates[n].sigma for n in model.names]
    )


def board_fit(seed, through=None, depths=(8, 95, 24)):
    """Fly a plan drawn from the seed, send it as frames, decode, find events, fit; the model and the
    truth."""
    rng = np.random.default_rng(1000 + seed)
    plan = Plan(
        depths=tuple(rng.uniform(*depths)),
        intercept=rng.uniform(60, 250),
        slope=rng.uniform(4, 9),
        climb=rng.uniform(60, 190),
        brake=rng.uniform(20, 70),
        hotel=rng.uniform(1, 5),
        surface=rng.uniform(1, 4),
    )
    stated = nominal().with_zero("main", 512.0, 0.15)
    flight = simulate(plan, seed, stated)
    data = flight.encode() if through is None else through(flight.encode())
    batch, report = decode_bytes(data)
    record = collect([batch], "simulated", report.as_dict())
    return analyse_board(record, flight.glider, stated).model, flight.truth


def covered(model, truth):
    """Whether all quantities lie within their simultaneous 95 % intervals, and the joint region holds the truth.

    The covariance itself is estimated, from about twenty strokes: the squared distance follows F, not chi-squared.
    """
    half = model.intervals(0.95)
    each = all(abs(model.estimates[n].value - truth[n]) <= half[n] for n in model.names)
    number = len(model.names)
    least = min(model.pump.dof, *(model.estimates[n].dof for n in (fits.CLIMB, fits.BRAKE)))
    return each, model.distance(truth) <= number * stats.f.ppf(0.95, number, least)


def test_the_model_that_flew_is_returned():
    results = [covered(*board_fit(seed)) for seed in range(4)]
    assert sum(each for each, _ in results) >= 3 and sum(joint for _, joint in results) >= 3


def test_the_model_that_flew_is_returned_through_the_port(tmp_path):
    def through(data):
        _, thread, _ = start(PtyLine(tmp_path / "tty"), data, 4e5, patient=True)
        capture = Capture(Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=60.0))
        threading.Thread(
            target=lambda: (thread.join(), time.sleep(0.5), capture.stop.set()), daemon=True
        ).start()
        capture.run()
        return captured(tmp_path / "log")

    model, truth = board_fit(2, through, (6, 20, 8))
    each, joint = covered(model, truth)
    assert each and joint


@pytest.mark.slow
def test_the_model_that_flew_is_returned_in_ninety_of_a_hundred():
    results = [covered(*board_fit(seed)) for seed in range(100)]
    assert sum(each for each, _ in results) >= 90
    assert sum(joint for _, joint in results) >= 90


class TestFragment:
    @pytest.fixture
    def model(self):
        rng = np.random.default_rng(9)
        climbs = [stroke(1.0, 150 + rng.normal(0, 5), CLIMB_TO_DIVE, -460e-6) for _ in range(20)]
        return fits.fit_energy([*strokes(rng, rng.uniform(10, 90, 30)), *climbs], LEVELS, 'log "a"')

    def test_the_vehicle_reader_takes_it_as_it_is(self, model, tmp_path):
        path = tmp_path / "vehicle.toml"
        write_atomically(path, vehicle_toml(model, {"a.nc": "00ff"}, "comet"))
        vehicle = read_vehicle(path)
        assert vehicle.name == "comet"
        for name, estimate in model.estimates.items():
            assert vehicle.quantities[name].value == pytest.approx(estimate.value, rel=1e-6)
            assert vehicle.quantities[name].sigma == pytest.approx(estimate.sigma, rel=1e-6)
            assert "fit to" in vehicle.quantities[name].source
        assert vehicle.value("energy.pump_dive_to_climb.reference_volume") == pytest.approx(460e-6, rel=1e-6)
        (block,) = vehicle.covariances
        assert block.names == model.names
        np.testing.assert_allclose(np.array(block.matrix), model.covariance, rtol=1e-6, atol=1e-9)
        assert "sha256 00ff" in path.read_text()

    def test_json_is_plain(self, model):
        import json

        data = json.loads(json.dumps(model_dict(model)))
        assert data["quantities"][fits.HOTEL]["value"] == 2.0
        assert data["pump"]["form"] == "line" and data["pump_other_form"]["form"] == "volume"
        rows = data["pump"]["intervals"]
        assert rows[0]["depth_m"] == pytest.approx(data["pump"]["depths_m"][0]) and len(rows) == 5
        assert all(row["half_interval_of_stroke_j"] > row["half_interval_of_mean_j"] > 0 for row in rows)

    def test_events_csv(self):
        text = events_csv([stroke(10.0, 100.0)])
        assert text.splitlines()[0].startswith("kind,direction,time") and ",100.0," in text

    def test_plot(self, model, tmp_path):
        from glider_jax.board.plots import plot_energy

        path = plot_energy(tmp_path / "e.png", model, [])
        assert path.stat().st_size > 10_000


def test_two_recordings_of_the_same_time_are_refused():
    glider = simulate(Plan(depths=(20.0,)), 0).glider
    with pytest.raises(FitError, match="begins before"):
        join_records([glider, glider])
