"""The battery that every term must pass; none may opt out."""

from __future__ import annotations

import dataclasses
import inspect

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from glider_jax.physics.library import CONFUSION_CLASSES, LIBRARY, TERMS_BY_ID, confusion_class
from glider_jax.physics.library.base import BASE
from glider_jax.physics.model import build_model, with_candidates
from glider_jax.physics.term import (
    SAMPLE_UNITS,
    AbstractTerm,
    Channel,
    Sample,
    declared,
    make,
    outputs,
    typical,
)
from tests.physics.worlds import BASE_UNITS, dimensions, random_fields, rescale, vehicle

SEEDS = tuple(range(24))
EVERY = BASE + LIBRARY
every_term = pytest.mark.parametrize("kind", EVERY, ids=[kind.info.id for kind in EVERY])
library_term = pytest.mark.parametrize("kind", LIBRARY, ids=[kind.info.id for kind in LIBRARY])

BLIND_IDS = """
flight.hull_compressibility flight.thermal_expansion flight.drag_growth flight.ballast_offset flight.mass_growth
flight.vertical_water_velocity flight.pitch_offset flight.lift_loss navigation.mean_current navigation.current_shear
navigation.tidal_current navigation.inertial_oscillation navigation.surface_windage navigation.compass_deviation
navigation.magnetic_declination energy.pump_pressure_nonlinearity energy.dive_only_load energy.hotel_growth
energy.surface_load energy.brake_pressure energy.internal_resistance energy.cold_friction sensor.current_offset
sensor.current_gain sensor.pressure_offset
""".split()


def stack(dtype):
    """Samples as one sample of arrays: random ones, the default, and one where every field but the depth is zero."""
    rows = [random_fields(seed) for seed in SEEDS]
    rows.append(Sample()._asdict())
    rows.append({name: 50.0 * (name == "bottom_depth") for name in Sample._fields})
    return Sample(**{name: jnp.asarray([row[name] for row in rows], dtype) for name in Sample._fields})


def strong(kind, dtype=None):
    """A term with amplitudes that differ, so that no sine hides behind a cosine."""
    dtype = dtype or jnp.float64
    term = typical(kind, dtype)
    names = list(declared(kind))
    scaled = [getattr(term, name) * (1.0 + 0.17 * i) for i, name in enumerate(names)]
    return make(kind, dtype, **dict(zip(names, scaled, strict=True)))


def values(term, samples):
    """Outputs over all samples, shape (channel, sample)."""
    return jnp.stack(jax.vmap(lambda sample: jnp.stack(outputs(term, sample)))(samples), axis=-1)


def test_ids_are_unique_and_enough():
    """One term per id, at least 45 of them, and all of the agreed ids."""
    assert len(TERMS_BY_ID) == len(LIBRARY) >= 45
    assert len({kind.info.id for kind in EVERY}) == len(EVERY)
    assert set(BLIND_IDS) <= set(TERMS_BY_ID)
    assert len(BLIND_IDS) == 25


def test_confusion_classes_name_known_terms():
    """Every id of a class or a warning exists, and no term is confused with itself."""
    for members in CONFUSION_CLASSES.values():
        assert set(members) <= set(TERMS_BY_ID)
        assert len(members) > 1
    for kind in LIBRARY:
        assert set(kind.info.confusable_with) <= set(TERMS_BY_ID)
        assert kind.info.id not in kind.info.confusable_with
    assert confusion_class("flight.ballast_offset") == ("ballast", "vertical offset")
    assert confusion_class("flight.turn_drag") == ()


@every_term
def test_metadata_is_complete(kind):
    """A pilot and an oceanographer find what they need, and the class is final."""
    info = kind.info
    assert issubclass(kind, AbstractTerm)
    assert kind.__bases__ == (AbstractTerm,)
    assert kind.__doc__ and inspect.getdoc(kind.__call__)
    for text in (info.title, info.equation, info.valid, info.reference, info.plain):
        assert len(text) > 2
    assert info.plain.endswith(".")
    assert info.channels and all(isinstance(channel, Channel) for channel in info.channels)
    assert set(info.reads) <= set(Sample._fields)
    assert len(set(info.reads)) == len(info.reads)
    parameters = declared(kind)
    assert set(parameters) == {field.name for field in dataclasses.fields(kind)}
    assert any(p.role == "amplitude" for p in parameters.values())
    for p in parameters.values():
        dimensions(p.unit)
        assert p.text and p.source and p.shown_per_si > 0.0
        assert p.role in ("amplitude", "shape", "constant")
        assert (p.prior.sd > 0.0) == (p.role != "constant")
        if kind in LIBRARY and p.role == "amplitude":
            assert p.prior.centre == 0.0, "an effect that is left out is zero"
        if kind in LIBRARY and p.role == "shape":
            assert p.prior.centre > 0.0
    if kind in LIBRARY:
        assert info.decided_by


@library_term
def test_left_out_effect_is_zero(kind):
    """A library term with its default amplitudes changes nothing."""
    assert np.all(np.asarray(values(make(kind, jnp.float64), stack(jnp.float64))) == 0.0)


def rescaled(kind):
    """Outputs as they are, and as they should and do become when all base units change."""
    factors = dict(zip(BASE_UNITS, (1.7, 0.6, 1.31, 1.13, 0.83), strict=True))
    term, samples = strong(kind), stack(jnp.float64)
    other = make(
        kind,
        jnp.float64,
        **{n: getattr(term, n) * rescale(p.unit, factors) for n, p in declared(kind).items()},
    )
    moved = Sample(
        *(x * rescale(SAMPLE_UNITS[n], factors) for n, x in zip(Sample._fields, samples, strict=True))
    )
    scales = np.array([rescale(channel.unit, factors) for channel in kind.info.channels])
    return np.asarray(values(term, samples)) * scales[:, None], np.asarray(values(other, moved))


@every_term
def test_dimensions(kind):
    """Rescale metre, kilogram, second, kelvin and ampere: the number rescales as its channel's unit says."""
    expected, found = rescaled(kind)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_dimensions_catch_a_wrong_power():
    """A squared depth in place of a depth does not pass."""

    class Wrong(LIBRARY[0]):
        def __call__(self, sample):
            return -sample.gravity * sample.density * sample.hull_volume * self.compressibility * sample.depth

    expected, found = rescaled(Wrong)
    assert not np.allclose(found, expected, rtol=1e-3)


@every_term
def test_reads_and_derivatives(kind):
    """Finite with finite derivatives everywhere; the derivative is non-zero for exactly the fields it says it reads."""
    samples = stack(jnp.float64)

    def of_both(term):
        assert np.all(np.isfinite(values(term, samples)))
        jacobian = jax.jacrev(lambda pair: jnp.stack(outputs(*pair)))
        slopes = jax.jit(jax.vmap(lambda s: jacobian((term, s))))(samples)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))
        return slopes[1]

    of_both(make(kind, jnp.float64))
    found = {
        n for n, g in zip(Sample._fields, of_both(strong(kind)), strict=True) if np.any(np.asarray(g) != 0.0)
    }
    assert found == set(kind.info.reads)


@every_term
def test_jit_and_vmap_change_nothing(kind):
    """jit = no jit and vmap = loop, to rounding."""
    term, samples = strong(kind), stack(jnp.float64)
    batched = np.asarray(values(term, samples))
    jitted = np.asarray(eqx.filter_jit(values)(term, samples))
    looped = np.stack(
        [np.stack(outputs(term, Sample.of(jnp.float64, **random_fields(seed)))) for seed in SEEDS[:6]],
        axis=-1,
    )
    scale = np.abs(batched).max()
    np.testing.assert_allclose(jitted, batched, rtol=1e-12, atol=1e-13 * scale)
    np.testing.assert_allclose(looped, batched[:, :6], rtol=1e-12, atol=1e-13 * scale)


@every_term
def test_single_precision_is_close(kind):
    """float32 in, float32 out, close to float64."""
    double = np.asarray(values(strong(kind), stack(jnp.float64)))
    single = values(strong(kind, jnp.float32), stack(jnp.float32))
    assert single.dtype == jnp.float32
    # The phase of M2 after 15 days is 180 rad, which float32 holds to 1e-5.
    np.testing.assert_allclose(single, double, rtol=2e-4, atol=1e-4 * np.abs(double).max())


@library_term
def test_gate_zero_leaves_the_model_as_it_was(kind):
    """A candidate behind gate 0 changes no number and no derivative, and its own derivative is finite."""
    base = build_model(vehicle(), dtype=jnp.float64)
    gated = with_candidates(base, (kind,))
    sample = Sample.of(jnp.float64, **random_fields(3))
    for channel in kind.info.channels:
        np.testing.assert_array_equal(base.total(channel, sample), gated.total(channel, sample))
        slope = jax.jacfwd(lambda g, c=channel: dataclasses.replace(gated, gates=g).total(c, sample))(
            gated.gates
        )
        assert np.all(np.isfinite(slope))
        np.testing.assert_allclose(
            slope[-1],
            outputs(typical(kind, jnp.float64), base.complete(sample))[kind.info.channels.index(channel)],
        )
