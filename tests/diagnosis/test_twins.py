"""Twins: what fits as well as a name, whatever its size, and what does not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis.twins import twins

NAMES = ("flight.mass", "flight.ballast_offset.mass", "flight.salinity_bias.bias", "flight.oil_offset.volume")


def searched(columns):
    """A search that named a ballast error beside a calibrated mass; whitened columns by unknown."""
    unknowns = tuple(SimpleNamespace(name=name, term=name.rsplit(".", 1)[0], scale=0.1) for name in NAMES)
    labels = tuple(SimpleNamespace(unknown=i) for i in range(len(NAMES)))
    linear = SimpleNamespace(gram=columns.T @ columns, labels=labels, precision=np.ones(len(NAMES)))

    def one(id, column):
        return SimpleNamespace(id=id, variants=(SimpleNamespace(columns=(column,)),))

    listed = [one("flight.ballast_offset", 1), one("flight.salinity_bias", 2), one("flight.oil_offset", 3)]
    pick = SimpleNamespace(candidate=listed[0], variant=listed[0].variants[0])
    return SimpleNamespace(
        picks=[pick], linear=linear, active=[0, 1], candidates=listed, problem=SimpleNamespace(
            replay=SimpleNamespace(unknowns=unknowns)
        ),
    )  # fmt: skip


def test_what_moves_the_data_alike_is_a_twin_with_the_size_it_needs():
    """A salinity that acts like half the ballast needs twice its amplitude; a column of its own is no twin."""
    rng = np.random.default_rng(5)
    mass, ballast, other = rng.normal(size=(3, 200))
    found = twins(searched(np.stack([mass, ballast, 0.5 * ballast, other], axis=1)), np.array([0.3, 1.5]), 0)
    assert [one.id for one in found] == ["flight.salinity_bias"]
    assert found[0].behind == pytest.approx(0.0, abs=1e-6)
    assert found[0].value == pytest.approx(0.3, rel=1e-6)
    assert found[0].times == pytest.approx(0.3 / 0.05, rel=1e-6)


def test_what_differs_by_more_than_the_noise_is_no_twin():
    """A rival at an angle is a twin of a faint effect and none of a strong one; one the data cannot see is none."""
    rng = np.random.default_rng(6)
    mass, ballast, other = rng.normal(size=(3, 400))
    search = searched(np.stack([mass, ballast, ballast + 0.3 * other, np.zeros(400)], axis=1))
    assert [one.id for one in twins(search, np.array([0.0, 0.2]), 0)] == ["flight.salinity_bias"]
    assert twins(search, np.array([0.0, 2.0]), 0) == []


def test_what_a_calibration_takes_up_does_not_count():
    """Columns alike but for what the calibrated mass explains are twins."""
    rng = np.random.default_rng(7)
    mass, ballast = rng.normal(size=(2, 400)) * np.array([[50.0], [1.0]])
    search = searched(np.stack([mass, ballast, ballast + 0.2 * mass, np.zeros(400)], axis=1))
    assert [one.id for one in twins(search, np.array([0.0, 2.0]), 0)] == ["flight.salinity_bias"]
