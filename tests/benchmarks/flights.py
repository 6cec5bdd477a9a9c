"""Runs that the benchmarks fly: the bundled default, the same without errors of the currents, and the full physics.

The one place that reaches into the engine to time drawing and flying apart from what comes before and after.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np


def engine() -> None:
    """Every core as a device and kept programs, as the command line has it; before the first use of JAX."""
    from glider_jax_cli.session import compiled_cache

    compiled_cache()


def default_run(n: int, days: float, **changes: Any):
    """Inputs and prepared run of the bundled default; ``changes`` are further options."""
    from glider_jax.products.job import Options, prepare_run, read_inputs

    options = Options(n=n, days=days, **changes)
    inputs = read_inputs(options)
    return inputs, prepare_run(options, inputs)


def calm_run(n: int, days: float):
    """The default without errors of currents and first fix: two integrations of it differ by their steps alone."""
    from glider_jax.products.job import Options, prepare_run, read_inputs

    options = Options(n=n, days=days)
    inputs = read_inputs(options)
    quantities = dict(inputs.vehicle.quantities)
    for name in ("perturbation.current_error", "perturbation.initial_position"):
        quantities[name] = replace(quantities[name], value=0.0)
    inputs = replace(
        inputs,
        currents=replace(inputs.currents, east_sd=None, north_sd=None),
        vehicle=replace(inputs.vehicle, quantities=quantities),
    )
    return prepare_run(options, inputs)


def full_run(n: int, days: float):
    """The flight model in stratified water, currents with depth, and every device of the catalogue.

    The bundled surface currents weaken to a third at 100 m; the water has a summer thermocline at 20 m.
    """
    from glider_jax.products.job import Options, prepare_run, read_inputs
    from glider_jax.readers.device_catalogue import DEVICES
    from glider_jax.records import Source, WaterProfile

    options = Options(n=n, days=days, speed="flight")
    inputs = read_inputs(options)
    depth = np.array([0.0, 10.0, 25.0, 50.0, 100.0])
    weaker = np.interp(depth, [0.0, 10.0, 100.0], [1.0, 1.0, 0.35])[None, :, None, None]
    surface = inputs.currents
    currents = replace(surface, depth=depth, east=surface.east[:, :1] * weaker, north=surface.north[:, :1] * weaker,
                       east_sd=None, north_sd=None)  # fmt: skip
    level = np.arange(0.0, 121.0, 2.0)
    step = 1.0 / (1.0 + np.exp((level - 20.0) / 4.0))
    water = WaterProfile(level, 10.0 + 12.0 * step, 33.2 - 1.2 * step, Source("benchmark"))
    devices = DEVICES.values() if isinstance(DEVICES, dict) else DEVICES
    inputs = replace(
        inputs, currents=currents, water=water, vehicle=replace(inputs.vehicle, devices=tuple(devices))
    )
    return prepare_run(options, inputs)


def draw(run, n: int):
    """Members of a run on the host, and the energy that each one's pack holds."""
    from glider_jax.mission.forecast import draw_run

    return draw_run(run, 0, n)


def fly(run, members):
    """Final states and outputs on the devices, finished."""
    import jax

    from glider_jax.mission.ensemble import run_members

    flown = run_members(
        members, run.plan, run.shape, run.environment, run.column, *run.origin,
        spread=run.spread, fix_sd=run.vehicle.value("perturbation.initial_position"),
    )  # fmt: skip
    jax.block_until_ready(flown)
    return flown


def home(run, members, available, flown):
    """The ``Track`` of a flight."""
    from glider_jax.mission.forecast import bring_home

    return bring_home(run, members, available, *flown)
