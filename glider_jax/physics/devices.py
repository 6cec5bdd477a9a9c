"""What the devices draw, summed into the few numbers that an event-stepped mission needs.

Imports NumPy, JAX and the configuration records. States are always in the order dive, climb, surface.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from glider_jax.config import Device, SampleRule

STATES = ("dive", "climb", "surface")
SAMPLE_SECONDS = 4.0
_EVERY_SENSOR = 0


class DeviceTable(eqx.Module):
    """Loads of all devices by energy component.

    Attributes
    ----------
    groups : names of the components, static.
    power : (group, 3) W, mean over the states dive, climb and surface.
    joules_per_surfacing, joules_per_inflection : (group,) J.
    """

    groups: tuple[str, ...] = eqx.field(static=True)
    power: Array
    joules_per_surfacing: Array
    joules_per_inflection: Array


def build_devices(
    devices: Iterable[Device],
    samples: Iterable[SampleRule] = (),
    *,
    dive_to: float,
    climb_to: float,
    dtype: Any,
) -> DeviceTable:
    """Sum the devices of a vehicle into one table.

    A device without ``sensor_types`` follows its own states and duty. One with them follows the mission's sample
    rules as soon as the mission has any: in each state the rule with the largest duty counts, and without a matching
    rule it stays off. A rule for sensor type 0 speaks to all of them.

    Parameters
    ----------
    devices, samples : of the vehicle and the mission.
    dive_to, climb_to : m, between which the glider saws; depth windows count by the share of that range they cover.
    dtype : of the table.

    Notes
    -----
    A sensor that samples every ``interval`` seconds is on for one 4-s cycle per sample (judgement); a window of every
    n-th yo counts as the share 1/n.
    """
    devices, rules = tuple(devices), tuple(samples)
    groups = tuple(dict.fromkeys(device.group for device in devices))
    power = np.zeros((len(groups), len(STATES)))
    surfacing, inflection = np.zeros(len(groups)), np.zeros(len(groups))
    for device in devices:
        group = groups.index(device.group)
        inflection[group] += device.joules_per_inflection
        if device.seconds_per_surfacing is not None:
            surfacing[group] += device.power.value * device.seconds_per_surfacing
            continue
        for column, state in enumerate(STATES):
            power[group, column] += device.power.value * duty(device, rules, state, dive_to, climb_to)
    return DeviceTable(
        groups, *(jnp.asarray(np.asarray(v, dtype)) for v in (power, surfacing, inflection))
    )


def duty(device: Device, rules: tuple[SampleRule, ...], state: str, dive_to: float, climb_to: float) -> float:
    """Share of the time in one state during which a device runs, 0 to 1."""
    own = (device.minimum_depth, device.maximum_depth)
    if not (device.sensor_types and rules):
        return device.duty * (state in device.states) * _window(own, state, dive_to, climb_to)
    shares = [0.0]
    for rule in rules:
        if state in rule.states and rule.sensor_type in (_EVERY_SENSOR, *device.sensor_types):
            window = (max(own[0], rule.minimum_depth), min(own[1], rule.maximum_depth))
            on = 1.0 if rule.interval <= SAMPLE_SECONDS else SAMPLE_SECONDS / rule.interval
            shares.append(on / max(rule.every_nth_yo, 1) * _window(window, state, dive_to, climb_to))
    return max(shares)


def _window(window: tuple[float, float], state: str, dive_to: float, climb_to: float) -> float:
    """Share of a state's depths inside a window; at the surface, whether the window reaches it."""
    if state == "surface":
        return float(window[0] <= 0.0 <= window[1])
    top, bottom = min(climb_to, dive_to), max(climb_to, dive_to)
    if bottom == top:
        return float(window[0] <= top <= window[1])
    return max(0.0, min(bottom, window[1]) - max(top, window[0])) / (bottom - top)
