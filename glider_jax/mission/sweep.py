"""Many runs flown together: runs that compile alike are stacked and flown by one compiled program.

Settings of a sweep change numbers, so their plans, members and water columns are stacked along a new leading axis and
``vmap`` flies them at once: a few dozen members use a processor badly, thousands well. Stacks are limited by what
their outputs take, so that a sweep of any size streams through the same memory. Each run's result is the one it has
when flown alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from glider_jax.errors import ConfigError
from glider_jax.mission import programs
from glider_jax.mission.ensemble import Output, fly, initial_state
from glider_jax.mission.forecast import Run, bring_home, draw_run, forecast
from glider_jax.mission.state import Log, Sums
from glider_jax.records import Track

#: Output numbers of one stack; at four bytes each, and twice over while they are brought home.
NUMBERS = 20_000_000


def signature(run: Run) -> tuple[Any, ...]:
    """Equal for runs that can be stacked: one environment, one compiled program, draws of one size; hashable."""
    leaves, structure = jax.tree.flatten((run.model, run.plan, run.column))
    shapes = tuple(np.shape(leaf) for leaf in leaves)
    return id(run.environment), run.shape, *_numbers(run), run.duration, run.interval, structure, shapes


def most_stacked(run: Run, n: int, numbers: int = NUMBERS) -> int:
    """How many runs like this one, of ``n`` members each, are flown together; at least one."""
    logs = 4 * len(Log._fields)
    per_time = len(Output._fields) - 5 + len(Sums._fields) + logs
    outputs = run.shape.intervals * run.shape.blocks
    return max(1, numbers // max(per_time * outputs * n, 1))


def fly_stacked(runs: Sequence[Run], n: int) -> Iterator[Track]:
    """Fly runs of one :func:`signature`, ``n`` members each, and yield their tracks in order.

    Raises
    ------
    ConfigError : ``n`` is smaller than 1, or the runs are not alike.
    """
    if n < 1:
        raise ConfigError(f"--n: expected at least 1 member, found {n}.")
    if not runs:
        return
    if len({signature(run) for run in runs}) > 1:
        raise ConfigError("sweep: expected runs of one shape and environment, found others. Fly them one by one.")
    most = most_stacked(runs[0], n)
    if most == 1 or len(runs) == 1:
        for run in runs:
            yield forecast(n, run)
        return
    # Stacks of one size share the compiled program.
    size = -(-len(runs) // -(-len(runs) // most))
    devices = jax.local_devices()
    use = devices if size >= len(devices) else devices[:1]
    size += -size % len(use)
    for begin in range(0, len(runs), size):
        part = runs[begin : begin + size]
        padded = [*part, *([part[-1]] * (size - len(part)))]
        drawn = [draw_run(run, 0, n) for run in part]
        members = _stack([drawn[min(k, len(part) - 1)][0] for k in range(size)])
        static = (runs[0].shape, Mesh(np.array(use), ("runs",)))
        state, outputs = programs.call(
            "sweep", _fly_runs, static, tuple(use), members, _stack([run.plan for run in padded]),
            _stack([run.column for run in padded]), _stack([_origin(run) for run in padded]), runs[0].environment,
            *_numbers(runs[0]),
        )  # fmt: skip
        state, outputs = jax.tree.map(np.asarray, (state, outputs))
        for k, run in enumerate(part):
            own, out = jax.tree.map(lambda a, k=k: a[k], (state, outputs))
            yield bring_home(run, drawn[k][0], drawn[k][1], own, out)


def _numbers(run: Run) -> tuple[Any, Any]:
    """Spread and standard deviation of the first fix, in the run's dtype."""
    dtype = np.dtype(run.plan.dive_to.dtype)
    return dtype.type(run.spread), dtype.type(run.vehicle.value("perturbation.initial_position"))


def _origin(run: Run):
    """Where a run starts, in the run's dtype."""
    return np.asarray(run.origin, run.plan.dive_to.dtype)


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *trees)


def _fly_runs(static, members, plans, columns, origins, env, spread, sd):
    """Start and fly stacked runs, split between the devices of the mesh; traced."""
    shape, mesh = static

    def one(members, plan, column, origin, env, spread, sd):
        start = jax.vmap(lambda m: initial_state(plan, shape, env, m, *origin, spread, sd))(members)
        return fly(members, plan, shape, env, column, start)

    rows, everywhere = PartitionSpec("runs"), PartitionSpec()
    sharded = jax.shard_map(
        jax.vmap(one, in_axes=(0, 0, 0, 0, None, None, None)),
        mesh=mesh,
        in_specs=(rows, rows, rows, rows, everywhere, everywhere, everywhere),
        out_specs=rows,
        check_vma=False,
    )
    return sharded(members, plans, columns, origins, env, spread, sd)
