"""Sums per channel, energies, units of optional terms, draws and presets."""

from __future__ import annotations

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from glider_jax.config import CovarianceBlock, Quantity
from glider_jax.errors import ConfigError
from glider_jax.physics.flight import steady_glide
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.model import (
    build_model,
    cast,
    draw,
    parameter_infos,
    parameters,
    sigmas,
    with_candidates,
    with_gates,
    with_parameters,
)
from glider_jax.physics.perturb import factor
from glider_jax.physics.presets import PRESETS, apply
from glider_jax.physics.term import Channel, Sample
from tests.physics.worlds import quantity, vehicle

INTERCEPT, SLOPE = "energy.pump_dive_to_climb.intercept", "energy.pump_dive_to_climb.slope"
BLOCK = CovarianceBlock((INTERCEPT, SLOPE), ((25.0, -0.5), (-0.5, 0.0225)), "test")


def model(**kwargs):
    """A model of the plain vehicle in double precision."""
    return build_model(vehicle(**kwargs), dtype=jnp.float64)


def sample(**fields):
    """A sample in double precision."""
    return Sample.of(jnp.float64, **fields)


def test_stroke_energies():
    """Line in depth to climb, constant to dive, brake at both, scaled by the volume moved."""
    deep = sample(inflection_depth=100.0, stroke_volume=460e-6)
    pump, brake = model().stroke_energy(deep)
    assert (float(pump), float(brake)) == (pytest.approx(110.0 + 6.0 * 100.0), 45.0)
    half, brake = model().stroke_energy(deep._replace(stroke_volume=jnp.asarray(230e-6)))
    assert (float(half), float(brake)) == (pytest.approx(0.5 * 710.0), 45.0)
    retract, brake = model().retract_energy(deep)
    assert (float(retract), float(brake)) == (pytest.approx(85.0), 45.0)


def test_extra_energies_add_and_multiply():
    """Curvature adds to the line, cold multiplies both strokes, pressure adds to the brake."""
    terms = {
        "energy.pump_pressure_nonlinearity": {"curvature": quantity(0.01)},
        "energy.cold_friction": {"slope": quantity(0.02)},
        "energy.brake_pressure": {"slope": quantity(0.3)},
    }
    cold = sample(inflection_depth=100.0, stroke_volume=460e-6, temperature=278.15)
    changed = model(terms=terms)
    assert float(changed.stroke_energy(cold).pump) == pytest.approx((710.0 + 100.0) * 1.2)
    assert float(changed.retract_energy(cold).pump) == pytest.approx(85.0 * 1.2)
    assert float(changed.stroke_energy(cold).brake) == pytest.approx(45.0 + 30.0)


def test_powers():
    """Hotel all the time, surface on top, dive-only on dives, and one surfacing's own energy."""
    terms = {
        "energy.dive_only_load": {"power": quantity(0.5)},
        "energy.surface_load": {"power": quantity(0.7)},
        "energy.air_pump": {"energy": quantity(200.0)},
        "energy.hotel_growth": {"rate": Quantity(0.12, 0.0, "W/day", "test")},
    }
    changed = model(terms=terms)
    for direction, power in ((-1.0, 1.1 + 0.5), (0.0, 1.1), (1.0, 1.1)):
        assert float(changed.hotel_power(sample(direction=direction))) == pytest.approx(power)
    assert float(changed.hotel_power(sample(elapsed=86400.0))) == pytest.approx(1.1 + 0.12)
    assert float(changed.surface_power(sample())) == pytest.approx(3.2)
    assert float(changed.surfacing_energy(sample())) == pytest.approx(200.0)
    assert float(model().surfacing_energy(sample())) == 0.0


def test_has_is_known_before_tracing():
    """A channel that nothing feeds is skipped at trace time."""
    assert model().has(Channel.NET_BUOYANCY) and not model().has(Channel.HEADING)
    assert with_candidates(model(), (TERMS_BY_ID["navigation.soft_iron"],)).has(Channel.HEADING)
    assert isinstance(eqx.filter_eval_shape(model).has(Channel.THRUST), bool)


def test_vectors_feed_two_channels():
    """East goes east and north goes north, times the gate."""
    current = {"navigation.mean_current": {"east": quantity(0.1), "north": quantity(-0.2)}}
    flowing = model(terms=current)
    flowing = with_gates(flowing, flowing.gates.at[-1].set(0.5))
    assert float(flowing.total(Channel.CURRENT_EAST, sample())) == pytest.approx(0.05)
    assert float(flowing.total(Channel.CURRENT_NORTH, sample())) == pytest.approx(-0.1)


def test_true_heading():
    """Declination turns the indicated heading clockwise when positive."""
    turned = model(terms={"navigation.magnetic_declination": {"angle": Quantity(10.0, 0.0, "deg", "test")}})
    assert float(turned.true_heading(sample(heading=1.0))) == pytest.approx(1.0 + math.radians(10.0))


def test_response_time():
    """Base lag plus added mass."""
    slow = model(terms={"flight.added_mass": {"time": quantity(4.0)}})
    assert float(slow.response_time(sample())) == pytest.approx(14.0)


def test_shares_refer_to_the_vehicle_not_the_sample():
    """Constants of the vehicle win over what a caller left in the sample."""
    doubled = model(terms={"flight.drag_bias": {"share": quantity(1.0)}}, flight__parasite_drag=quantity(0.2))
    assert float(doubled.total(Channel.DRAG_COEFFICIENT, sample(parasite_drag=9.0))) == pytest.approx(0.4)


def test_units_of_optional_terms():
    """A parameter may be given in its SI unit, its shown unit, or bare; others are refused by name."""
    per_day = model(terms={"flight.mass_growth": {"rate": Quantity(0.0864, 0.0, "kg/day", "")}})
    assert float(parameters(per_day)["flight.mass_growth.rate"]) == pytest.approx(1e-6)
    with pytest.raises(ConfigError, match="expected unit 'kg s-1' or 'kg/day', found 'lb'"):
        model(terms={"flight.mass_growth": {"rate": Quantity(1.0, 0.0, "lb", "")}})
    with pytest.raises(ConfigError, match="Did you mean 'rate'"):
        model(terms={"flight.mass_growth": {"rat": quantity(1.0)}})
    with pytest.raises(ConfigError, match="Did you mean 'flight.mass_growth'"):
        model(terms={"flight.mass_grwth": {"rate": quantity(1.0)}})


def test_parameters_can_be_read_and_set():
    """Public names lead to the same number and back."""
    values = parameters(model())
    assert float(values["flight.mass"]) == 60.0
    assert "body.stall_angle" not in values and "body.stall_angle" in parameter_infos(model())
    changed = with_parameters(model(), {"flight.mass": 61.0, "flight.pump_rate": 3e-5})
    assert float(parameters(changed)["flight.mass"]) == 61.0 and float(changed.body.pump_rate) == 3e-5
    assert float(parameters(changed)["flight.volume"]) == float(values["flight.volume"])
    with pytest.raises(ConfigError, match="Did you mean 'flight.mass'"):
        with_parameters(model(), {"flight.mas": 1.0})


def drawn(v, n=4000, spread=1.0, dtype=jnp.float64):
    """Parameters of n members."""
    base = build_model(v, dtype=dtype)
    keys = jax.random.split(jax.random.key(7), n)
    return {
        k: np.asarray(x)
        for k, x in parameters(eqx.filter_vmap(lambda k: draw(base, v, k, spread))(keys)).items()
    }


def test_draws_have_the_stated_mean_and_spread():
    """Mean within 4 standard errors, sd within 5 %, certain ones all equal."""
    v = vehicle(flight__thermal_expansion=quantity(-1e-5, 2e-5), energy__hotel=quantity(1.1, 0.5))
    found = drawn(v)
    for name, sigma in sigmas(build_model(v, dtype=jnp.float64), v).items():
        mean = v.quantities[name].value
        assert found[name].mean() == pytest.approx(mean, abs=4.0 * sigma / math.sqrt(4000)), name
        assert found[name].std() == pytest.approx(sigma, rel=0.06), name
    assert np.ptp(found["flight.volume"]) == 0.0 == np.ptp(found["flight.wing_area"])
    assert (
        found["energy.hotel"].min() > 0.0
        and found["flight.thermal_expansion"].min() < 0.0 < found["flight.thermal_expansion"].max()
    )
    assert abs(np.corrcoef(found["flight.mass"], found["energy.hotel"])[0, 1]) < 0.06


def test_joint_draws_follow_the_covariance_block():
    """Intercept and slope of the pump line are drawn together."""
    found = drawn(vehicle(covariances=(BLOCK,)))
    pair = np.stack([found[INTERCEPT], found[SLOPE]])
    np.testing.assert_allclose(pair.mean(axis=1), (110.0, 6.0), rtol=3e-3)
    np.testing.assert_allclose(np.cov(pair), BLOCK.matrix, rtol=0.12)
    wide = CovarianceBlock((SLOPE,), ((100.0,),))
    assert drawn(vehicle(covariances=(wide,)))[SLOPE].min() == pytest.approx(0.06)


def test_a_drag_fitted_to_vertical_speed_is_drawn_with_its_lift():
    """Weak lift is drawn with less drag: at the pitch of a fit all members sink alike, else they do not."""
    given = {"flight__parasite_drag": quantity(0.17, 0.0), "flight__lift_slope": quantity(6.0, 1.0, "rad-1")}
    spread = {}
    for pitch in (0.0, 0.45):
        found = drawn(vehicle(**given, flight__drag_fitted_at_pitch=quantity(pitch, 0.0, "rad")), 500)
        glide = steady_glide(
            net_buoyancy=jnp.full(500, 2.3), pitch=jnp.full(500, 0.45), density=1025.0, area=0.1,
            parasite=found["flight.parasite_drag"], induced=found["flight.induced_drag"],
            lift=found["flight.lift_slope"], stall_angle=jnp.inf,
        )  # fmt: skip
        spread[pitch] = float(np.std(np.asarray(glide.depth_rate)))
    assert spread[0.0] > 2e-3 and spread[0.45] < 1e-5


def test_a_new_parameter_shifts_no_other_draw():
    """Every name has its own stream, whatever else is uncertain and in which order."""
    plain = drawn(vehicle(), 8)
    more = drawn(
        vehicle(
            terms={"flight.ballast_offset": {"mass": quantity(0.0, 0.05)}},
            flight__response_time=quantity(9, 1),
        ),
        8,
    )
    for name in ("flight.mass", "energy.hotel", SLOPE):
        np.testing.assert_array_equal(plain[name], more[name])
    assert np.std(more["flight.ballast_offset.mass"]) > 0.01


def test_spread_scales_the_uncertainty():
    """Spread 0 gives the vehicle itself."""
    for name, x in drawn(vehicle(covariances=(BLOCK,)), 3, spread=0.0).items():
        assert np.ptp(x) == 0.0 and x[0] == pytest.approx(float(parameters(model())[name]))
    assert drawn(vehicle(), 3, dtype=jnp.float32)["flight.mass"].dtype == np.float32


def test_bad_covariances_are_explained():
    """Unknown names, wrong shapes and impossible matrices."""
    with pytest.raises(ConfigError, match="covariance: unknown 'flight.masss'. Did you mean 'flight.mass'"):
        bad = vehicle(covariances=(CovarianceBlock(("flight.masss",), ((1.0,),)),))
        draw(model(), bad, jax.random.key(0))
    with pytest.raises(ConfigError, match="2 x 2"):
        factor(CovarianceBlock(("a", "b"), ((1.0,),)))
    with pytest.raises(ConfigError, match="symmetric"):
        factor(CovarianceBlock(("a", "b"), ((1.0, 0.5), (0.2, 1.0))))
    with pytest.raises(ConfigError, match="semi-definite"):
        factor(CovarianceBlock(("a", "b"), ((1.0, 2.0), (2.0, 1.0))))


def test_cholesky_factor_reproduces_the_matrix():
    """Also with scales apart by 1e8 and with a variance of zero."""
    matrix = ((1e4, 1e-3, 0.0), (1e-3, 1e-9, 0.0), (0.0, 0.0, 0.0))
    lower = factor(CovarianceBlock(("a", "b", "c"), matrix))
    np.testing.assert_allclose(lower @ lower.T, matrix, rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(lower, np.tril(lower), atol=1e-15)


def test_cast_keeps_values():
    """The same model in the other precision."""
    single = cast(model(), jnp.float32)
    assert single.gates.dtype == jnp.float32
    assert float(parameters(single)["flight.parasite_drag"]) == pytest.approx(0.15, rel=1e-7)


def test_second_call_does_not_compile():
    """New numbers, same program."""
    traces = []

    @eqx.filter_jit
    def run(m, s):
        traces.append(1)
        return m.steady_glide(s).depth_rate

    run(model(), sample(pitch=0.4, buoyancy_volume=2e-4))
    run(with_parameters(model(), {"flight.mass": 60.02}), sample(pitch=0.3, buoyancy_volume=1e-4))
    assert len(traces) == 1


@pytest.mark.parametrize("name", PRESETS)
def test_presets_fly(name):
    """Every preset has units and sources, and glides at a plausible speed."""
    preset = PRESETS[name]()
    infos = parameter_infos(model())
    assert all(q.source and q.unit == infos[n].unit for n, q in preset.items())
    v = apply(vehicle(), name)
    if "flight.volume" in preset:
        v.quantities["flight.mass"] = quantity(preset["flight.volume"].value * 1025.0)
    glide = build_model(v, dtype=jnp.float64).steady_glide(sample(pitch=0.45, buoyancy_volume=230e-6))
    assert bool(glide.valid) and 0.25 < float(glide.horizontal_speed) < 0.55
    with pytest.raises(ConfigError, match="Did you mean 'comet_2019'"):
        apply(vehicle(), "comet_209")
