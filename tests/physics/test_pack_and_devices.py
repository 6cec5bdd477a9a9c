"""The battery pack under load, and the device table by state."""

from __future__ import annotations

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from glider_jax.config import Device, SampleRule
from glider_jax.physics.battery import build_pack, draw_pack
from glider_jax.physics.devices import build_devices, duty
from tests.physics.worlds import BATTERY, quantity

UNDER_WATER = frozenset({"dive", "climb"})


def f64(x):
    """A double."""
    return jnp.asarray(x, jnp.float64)


def pack(**changes):
    """The test pack in double precision."""
    return build_pack(dataclasses.replace(BATTERY, **changes), dtype=jnp.float64)


def test_voltage_follows_the_curve():
    """Linear between points, constant beyond."""
    for charge, voltage in (
        (0.0, 11.0),
        (0.1, 11.5),
        (0.2, 12.0),
        (0.6, 13.5),
        (1.0, 15.0),
        (-0.2, 11.0),
        (1.3, 15.0),
    ):
        assert float(pack().open_circuit_voltage(f64(charge))) == pytest.approx(voltage)
    many = jax.vmap(pack().open_circuit_voltage)(jnp.linspace(0.0, 1.0, 5))
    assert many.shape == (5,)


def test_terminal_voltage_and_current_deliver_the_power():
    """V I = P and V = V0 - R I."""
    voltage, current = pack().terminal(f64(40.0), f64(0.6), f64(-0.1))
    assert float(voltage * current) == pytest.approx(40.0)
    assert float(voltage) == pytest.approx(13.4 - 0.3 * float(current))
    voltage, current = pack(internal_resistance=quantity(0.0)).terminal(f64(1.1), f64(1.0))
    assert (float(voltage), float(current)) == (pytest.approx(15.0), pytest.approx(1.1 / 15.0))
    voltage, current = pack().terminal(f64(1e4), f64(0.6))
    assert float(voltage) == pytest.approx(6.75) and math.isfinite(float(current))


def test_usable_charge_falls_in_the_cold():
    """0.5 % per kelvin below 15 degC, nothing above, never negative."""
    for kelvin, share in ((288.15, 0.9), (300.0, 0.9), (278.15, 0.9 * 0.95), (0.0, 0.0)):
        assert float(pack().usable_charge(f64(kelvin))) == pytest.approx(5e5 * share)
        assert float(pack().usable_energy(f64(kelvin))) == pytest.approx(7.5e6 * share)


def test_drawn_packs():
    """Capacity and energy share their factor, the rest is independent, the usable share stays below 1."""
    base = pack()
    packs = eqx.filter_vmap(lambda k: draw_pack(base, BATTERY, k))(jax.random.split(jax.random.key(1), 4000))
    capacity, usable = np.asarray(packs.capacity), np.asarray(packs.usable_fraction)
    assert capacity.mean() == pytest.approx(5e5, rel=2e-3) and capacity.std() == pytest.approx(1e4, rel=0.05)
    np.testing.assert_allclose(np.asarray(packs.energy) / capacity, 15.0, rtol=1e-12)
    assert usable.max() <= 1.0 and usable.std() == pytest.approx(0.03, rel=0.06)
    assert np.asarray(packs.internal_resistance).std() == pytest.approx(0.05, rel=0.06)
    assert np.asarray(packs.temperature_derating).min() > 0.0
    same = draw_pack(base, BATTERY, jax.random.key(1), 0.0)
    np.testing.assert_allclose(same.capacity, base.capacity)


def device(name="ctd", group="science", power=0.5, **rest):
    """A device of a group."""
    return Device(name, group, quantity(power), **rest)


def table(devices, samples=(), dive_to=100.0, climb_to=0.0):
    """A device table as a dictionary by group: dive, climb, surface."""
    made = build_devices(devices, samples, dive_to=dive_to, climb_to=climb_to, dtype=jnp.float64)
    return made, dict(zip(made.groups, np.asarray(made.power).tolist(), strict=True))


def test_states_and_duty():
    """A device runs its share of the states it names; groups add up in order of first sight."""
    made, power = table(
        [
            device("ctd", "science", 0.5, states=frozenset({"dive"})),
            device("fin", "steering", 0.2, states=UNDER_WATER, duty=0.25),
            device("optics", "science", 1.0, states=frozenset({"climb", "surface"}), duty=0.5),
        ]
    )
    assert made.groups == ("science", "steering")
    assert power == {"science": [0.5, 0.5, 0.5], "steering": [0.05, 0.05, 0.0]}


def test_energy_per_event():
    """Per surfacing instead of by state, and per inflection."""
    made, power = table(
        [
            device("iridium", "communication", 5.0, seconds_per_surfacing=600.0),
            device("pitch", "steering", 0.0, joules_per_inflection=20.0),
        ]
    )
    assert power["communication"] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(made.joules_per_surfacing, [3000.0, 0.0])
    np.testing.assert_allclose(made.joules_per_inflection, [0.0, 20.0])


def test_sample_rules_replace_states():
    """With sample rules a sensor runs where a rule of its type says, or of type 0, and is off otherwise."""
    ctd = device(sensor_types=(1,), duty=0.3)
    dive = SampleRule(1, frozenset({"dive"}))
    slow = SampleRule(1, UNDER_WATER, interval=40.0)
    every = SampleRule(0, frozenset({"climb"}))
    other = SampleRule(7, UNDER_WATER)
    assert table([ctd])[1]["science"] == pytest.approx([0.15, 0.15, 0.15])
    assert table([ctd], [dive])[1]["science"] == pytest.approx([0.5, 0.0, 0.0])
    assert table([ctd], [slow])[1]["science"] == pytest.approx([0.05, 0.05, 0.0])
    assert table([ctd], [dive, slow])[1]["science"] == pytest.approx([0.5, 0.05, 0.0])
    assert table([ctd], [every])[1]["science"] == pytest.approx([0.0, 0.5, 0.0])
    assert table([ctd], [other])[1]["science"] == [0.0, 0.0, 0.0]
    assert table([device()], [other])[1]["science"] == [0.5, 0.5, 0.5]
    nth = SampleRule(1, frozenset({"dive"}), every_nth_yo=4)
    assert duty(ctd, (nth,), "dive", 100.0, 0.0) == 0.25


def test_depth_windows():
    """A window counts by the share of the yo it covers; at the surface by whether it reaches it."""
    deep = device(minimum_depth=60.0, maximum_depth=80.0)
    assert table([deep])[1]["science"] == pytest.approx([0.1, 0.1, 0.0])
    assert table([device(minimum_depth=150.0)])[1]["science"] == [0.0, 0.0, 0.0]
    rule = SampleRule(1, UNDER_WATER | {"surface"}, minimum_depth=-5.0, maximum_depth=50.0)
    assert table([device(sensor_types=(1,))], [rule], 100.0, 20.0)[1]["science"] == pytest.approx(
        [0.1875, 0.1875, 0.5]
    )
    assert duty(deep, (), "dive", 70.0, 70.0) == 1.0


def test_no_devices():
    """An empty table has no groups."""
    assert table([])[0].power.shape == (0, 3)
