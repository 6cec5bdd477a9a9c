"""The replay against an independent simulator, and the signs of its derivatives."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from glider_jax.config import CovarianceBlock, Quantity
from glider_jax.errors import DataError
from glider_jax.inference.replay import build_replay
from glider_jax.inference.settling import faster
from glider_jax.inference.streams import gather
from glider_jax.inference.windows import usual_rate
from tests.diagnosis.worlds import fly, vehicle


@pytest.fixture(scope="module")
def world():
    """A quiet flight without noise, gathered, with predictions and derivatives at the vehicle's numbers."""
    with jax.enable_x64(True):
        gathered = gather(fly(0.8, noise=0.05, current=(0.08, -0.05)), vehicle())
        replay = build_replay(gathered, vehicle())
        values = np.array([u.centre for u in replay.unknowns])
        predicted, columns, _ = replay.jacobian(values)
    names = [u.name for u in replay.unknowns]
    return gathered, replay, values, predicted, columns, names


def column(world, stream, name):
    """Derivative of a stream by an unknown, per its scale."""
    _, _, _, _, columns, names = world
    return columns[stream][:, names.index(name)]


def test_an_independent_flight_is_replayed(world):
    """What another simulator flew is predicted: vertical speed to a millimetre a second, power to a milliwatt."""
    gathered, _, _, predicted, _, _ = world
    left = {s.name: s.value - predicted[s.name] for s in gathered.streams}
    assert abs(left["vertical speed"].mean()) < 5e-4 and left["vertical speed"].std() < 2e-3
    assert abs(left["displacement east"].mean() - 0.08) < 3e-3
    assert abs(left["displacement north"].mean() + 0.05) < 3e-3
    assert np.abs(left["surface drift east"] - 0.08).max() < 3e-3
    assert abs(left["hotel power, dives"].mean()) < 2e-3
    assert abs(left["surface power"].mean()) < 2e-2
    assert abs(left["pump in energy"].mean()) < 3.0 and abs(left["pump out energy"].mean()) < 6.0


def test_signs_of_flight_terms(world):
    """Mass sinks, drag slows both ways, a squeezed hull sinks at depth, upwelling lifts."""
    gathered = world[0]
    stream = gathered.stream("vertical speed")
    climb = stream.covariates["direction"] > 0
    assert (column(world, "vertical speed", "flight.ballast_offset.mass") > 0).all()
    drag = column(world, "vertical speed", "flight.drag_bias.share")
    assert (drag[climb] > 0).all() and (drag[~climb] < 0).all()
    squeezed = column(world, "vertical speed", "flight.hull_compressibility.compressibility")
    assert (squeezed > 0).all()
    deep = stream.covariates["depth"] > np.median(stream.covariates["depth"])
    assert squeezed[deep].mean() > 1.5 * squeezed[~deep].mean()
    assert np.allclose(column(world, "vertical speed", "flight.mean_upwelling.velocity"), -0.004, atol=4e-4)
    lift = column(world, "vertical speed", "flight.lift_loss.loss")
    assert np.abs(lift).max() < 0.2 * np.abs(drag).max()


def test_signs_of_other_streams(world):
    """Currents carry by their own size, loads add their own watts, a gain scales, a resistance sags."""
    assert np.allclose(column(world, "displacement east", "navigation.mean_current.east"), 0.3, atol=1e-6)
    assert np.allclose(column(world, "surface drift north", "navigation.mean_current.north"), 0.3, atol=1e-6)
    assert np.allclose(column(world, "surface drift east", "navigation.surface_windage.east"), 0.3, atol=1e-6)
    assert np.abs(column(world, "displacement east", "navigation.surface_windage.east")).max() < 0.05
    assert np.allclose(column(world, "hotel power, dives", "energy.dive_only_load.power"), 1.0)
    assert np.allclose(column(world, "hotel power, climbs", "energy.dive_only_load.power"), 0.0)
    gain = column(world, "surface power", "sensor.current_gain.gain")
    assert np.allclose(gain, 0.06 * 3.6, rtol=0.02)
    assert (column(world, "battery voltage", "energy.internal_resistance.resistance") < 0.0).all()
    pump = column(world, "pump out energy", "energy.pump_pressure_nonlinearity.curvature")
    assert np.allclose(pump, 0.04 * 61.5**2, rtol=0.05)


def test_derivatives_are_those_of_the_prediction(world):
    """One step along an unknown changes the prediction as its column says."""
    _, replay, values, predicted, columns, names = world
    k = names.index("flight.drag_growth.rate")
    moved = values.copy()
    step = 0.02
    moved[k] += step * replay.unknowns[k].scale
    with jax.enable_x64(True):
        ahead = replay.jacobian(moved)[0]
    change = (ahead["vertical speed"] - predicted["vertical speed"]) / step
    assert np.abs(change - columns["vertical speed"][:, k]).max() < 0.03 * np.abs(change).max()


def test_too_little_is_said():
    """A recording without pitch is refused with a sentence that names the channel."""
    recording = fly(0.1)
    del recording.channels["pitch"]
    with pytest.raises(DataError, match="channel 'pitch'"):
        gather(recording, vehicle())


def test_a_stroke_bears_the_load_of_the_phase_before_or_after(world):
    """With a load on dives, whose load a stroke bears is the load's half over the stroke, of opposite sign each way."""
    gathered, replay, values, _, _, names = world
    loaded = values.copy()
    loaded[names.index("energy.dive_only_load.power")] = 0.5
    place = names.index("load of a stroke")
    with jax.enable_x64(True):
        columns = replay.slopes(loaded, {}, [place])[1]
    scale = replay.unknowns[place].scale
    for name, sign in (("pump in energy", 1.0), ("pump out energy", -1.0)):
        span = gathered.stream(name).span
        assert columns[name][:, 0] == pytest.approx(sign * scale * 0.25 * span, rel=1e-6)
    assert np.abs(column(world, "pump in energy", "load of a stroke")).max() < 1e-9


def test_speeds_are_told_against_their_mean_in_settled_glides():
    """Inertia that may go with a power of the speed changes by a factor of two at most, whatever a turn does."""
    with jax.enable_x64(True):
        speed = jax.numpy.array([0.2, 0.4, 0.0, 2.0])
        settled = jax.numpy.array([True, True, False, False])
        assert np.asarray(faster(speed, settled)) == pytest.approx([2.0 / 3.0, 4.0 / 3.0, 0.5, 2.0])


def test_the_warming_that_is_regressed_on_holds_no_heave():
    """Water that heaves moves the glider through layers; the covariate is layers times the usual speed."""
    still = fly(0.8, noise=0.0)
    heave = 0.4 * np.sin(2.0 * np.pi * still.time / 210.0)
    depth = np.where(still["depth"] > 5.0, still["depth"] + heave, still["depth"])
    moved = replace(still, channels=still.channels | {"depth": depth, "temperature": 290.0 - 0.1 * depth})
    stream = gather(moved, vehicle()).stream("vertical speed")
    down = stream.covariates["direction"] < 0.0
    deep = stream.covariates["depth"] > 8.0
    for way, sign in ((down, -1.0), (~down, 1.0)):
        value, warming = stream.value[way & deep], stream.covariates["warming"][way & deep]
        assert value.std() > 0.004 and (sign * warming > 0.0).all()
        assert warming.mean() == pytest.approx(-0.1 * value.mean(), rel=0.03)
        assert abs(np.corrcoef(value, warming)[0, 1]) < 0.4 and warming.std() < 0.05 * abs(warming.mean())


def test_what_is_usual_goes_by_depth_and_direction():
    """Medians over like depths of one direction: a few wild values change nothing, and dives are not climbs."""
    depth = np.tile(np.linspace(0.0, 100.0, 60), 2)
    direction = np.repeat([-1.0, 1.0], 60)
    true = -direction * (0.2 + 0.001 * depth)
    rate = true.copy()
    rate[::7] += 0.5
    found = usual_rate(depth, direction, rate)
    assert np.abs(found - true).max() < 0.01
    assert usual_rate(depth[:5], direction[:5], true[:5]) == pytest.approx(np.full(5, np.median(true[:5])))


def test_hulls_have_limits_that_count_what_the_vehicle_file_says(world):
    """No answer precedes the push, and a hull yields beyond the vehicle file the rest of what any yields."""
    unknowns = {u.name: u for u in world[1].unknowns}
    response = unknowns["flight.response_time"]
    assert 0.0 < response.lower < 0.5 * response.centre
    given = vehicle()
    squeezed = {"flight.hull_compressibility": Quantity(5e-10, 1e-10, "Pa-1")}
    given = replace(given, quantities=given.quantities | squeezed)
    with jax.enable_x64(True):
        replay = build_replay(world[0], given)
    squeezed = next(u for u in replay.unknowns if u.name == "flight.hull_compressibility.compressibility")
    assert (squeezed.lower, squeezed.upper) == pytest.approx((-5e-10, 1.5e-9))


def test_a_glide_comes_out_of_a_hole_in_its_controls_as_it_went_in():
    """Three minutes without pitch and pumped volume leave no false start behind them: the replay goes on as it was."""
    recording = fly(0.3, noise=0.05)
    with jax.enable_x64(True):
        whole = gather(recording, vehicle())
        rows = whole.rows
        later = rows.settled & (rows.since_turn > 150.0) & (rows.depth > 20.0) & (rows.depth < 35.0)
        begin = rows.time[np.flatnonzero(later)[30]]
        lost = (recording.time >= begin) & (recording.time < begin + 120.0)
        for name in ("pitch", "pumped_volume"):
            recording.channels[name][lost] = np.nan
        holed = gather(recording, vehicle())
        assert not holed.rows.settled[(holed.rows.time > begin + 5.0) & (holed.rows.time < begin + 110.0)].any()
        replay = build_replay(holed, vehicle())
        predicted = replay.predict(np.array([u.centre for u in replay.unknowns]))
    stream = holed.stream("vertical speed")
    after = stream.time + holed.origin - begin
    left = (stream.value - predicted["vertical speed"])[(after > 100.0) & (after < 400.0)]
    assert left.size > 2 and np.abs(left).max() < 0.01


def test_a_start_from_the_surface_settles_later_than_a_turn(world):
    """Two minutes after leaving the surface, a quarter of a half yo after a turn, and not before."""
    rows = world[0].rows
    first = (rows.since_surfacing == rows.since_turn) & (rows.direction < 0.0)
    assert rows.since_turn[rows.settled & first].min() > 120.0
    assert 60.0 < rows.since_turn[rows.settled & ~first].min() < 110.0


def replayed(world, changed):
    """The replay of the same recording with another vehicle file, and the places of its unknowns."""
    replay = build_replay(world[0], changed)
    return replay, [u.name for u in replay.unknowns], np.array([u.centre for u in replay.unknowns])


DRAG, MASS, LIFT = "flight.parasite_drag", "flight.mass", "flight.lift_slope"


def test_numbers_that_are_known_jointly_move_together(world):
    """One coordinate of a covariance block carries the other number along; both are stated with their own sigmas."""
    matrix = ((0.003**2, 0.8 * 0.003 * 0.004), (0.8 * 0.003 * 0.004, 0.004**2))
    known = replace(vehicle(), covariances=(CovarianceBlock((MASS, DRAG), matrix),))
    with jax.enable_x64(True):
        joint, names, centres = replayed(world, known)
        alone, _, _ = replayed(world, vehicle())
        mass, drag = names.index(MASS), names.index(DRAG)
        moved, same = centres.copy(), centres.copy()
        moved[mass] += 0.003
        same[mass] += 0.003
        same[drag] += 0.8 * 0.004
        found, known = joint.predict(moved)["vertical speed"], alone.predict(same)["vertical speed"]
        np.testing.assert_allclose(found, known, atol=1e-12)
        slopes = joint.jacobian(centres)[1]
        change = (joint.predict(moved)["vertical speed"] - joint.predict(2.0 * centres - moved)["vertical speed"]) / 2.0
        np.testing.assert_allclose(slopes["vertical speed"][:, mass], change, atol=3e-6)
    value, sd, away = joint.stated([mass, -1, drag], np.array([1.0, 5.0, 0.0]), np.eye(3))
    assert value[[0, 2]] == pytest.approx(same[[mass, drag]])
    assert sd[[0, 2]] == pytest.approx([0.003, 0.004]) and away[[0, 2]] == pytest.approx([1.0, 0.8])


def test_a_drag_that_was_fitted_goes_with_its_lift(world):
    """Lift that is off hardly changes the vertical speed at the pitch of the fit, and less drag is stated with it."""
    quantities = vehicle().quantities | {LIFT: Quantity(vehicle().value(LIFT), 1.0, "rad-1")}
    pitch = float(np.median(np.abs(world[0].rows.pitch[world[0].rows.settled])))
    change, stated = {}, {}
    with jax.enable_x64(True):
        for fitted in (0.0, pitch):
            known = quantities | {"flight.drag_fitted_at_pitch": Quantity(fitted, 0.0, "rad")}
            replay, names, values = replayed(world, replace(vehicle(), quantities=known))
            before = replay.predict(values)["vertical speed"]
            z = np.array([-3.0, 0.0])
            values[names.index(LIFT)] -= 3.0
            change[fitted] = np.abs(replay.predict(values)["vertical speed"] - before).mean()
            stated[fitted] = replay.stated([names.index(LIFT), names.index(DRAG)], z, 1e-4 * np.eye(2))
    assert change[0.0] > 5e-3 > 10.0 * change[pitch]
    given = vehicle().value(DRAG)
    assert stated[0.0][0][1] == pytest.approx(given) and stated[pitch][0][1] < 0.97 * given
    assert stated[pitch][1][1] > stated[0.0][1][1]
