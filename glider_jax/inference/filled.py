"""Inputs of the replay filled up to common lengths, so that compiled programs serve many recordings.

NumPy only. A newcomer would get wrong: what fills must be finite and count for nothing, so the last row is repeated
with no time, no window and no share.
"""

from __future__ import annotations

import numpy as np

from glider_jax.inference.streams import Inputs
from glider_jax.records import Array

#: Shortest lengths of rows, of windows and of everything else; nothing stays nothing.
LEAST_ROWS, LEAST_WINDOWS, LEAST = 8192, 8192, 2048


def ladder(n: int, least: int = LEAST) -> int:
    """The next common length, at least ``least``: an eighth of a power of two is the finest step."""
    if n == 0:
        return 0
    power = 1 << max(int(np.ceil(np.log2(n))), 0)
    if power <= least:
        return least
    return next(size for size in (power * k // 8 for k in (5, 6, 7, 8)) if size >= n)


def fill(inputs: Inputs) -> Inputs:
    """All arrays at common lengths."""
    rows = inputs.step.size
    long = ladder(rows, LEAST_ROWS)

    def edge(values: Array, size: int | None = None) -> Array:
        n = values.shape[0]
        more = (ladder(n) if size is None else size) - n
        return np.pad(values, (0, more), mode="edge") if more > 0 else values

    def constant(values: Array, other: float) -> Array:
        return np.pad(values, (0, long - rows), constant_values=other)

    def fields(named: dict[str, Array]) -> dict[str, Array]:
        return {name: edge(np.asarray(values)) for name, values in named.items()}

    return inputs._replace(
        rows={name: edge(np.asarray(values), long) for name, values in inputs.rows.items()},
        step=constant(inputs.step, 0.0),
        direction=constant(inputs.direction, 0.0),
        follows=constant(inputs.follows, False),
        wander=constant(inputs.wander, 0.0),
        wander_rate=constant(inputs.wander_rate, 0.0),
        window=constant(inputs.window, -1),
        window_weight=constant(inputs.window_weight, 0.0),
        course=constant(inputs.course, -1),
        course_share=constant(inputs.course_share, 0.0),
        drift=constant(inputs.drift, -1),
        drift_share=constant(inputs.drift_share, 0.0),
        product_east=constant(inputs.product_east, 0.0),
        product_north=constant(inputs.product_north, 0.0),
        **{name: fields(getattr(inputs, name)) for name in ("events", "loads", "pulses", "turns", "floors")},
        **{
            name: edge(getattr(inputs, name))
            for name in ("event_out", "event_seconds", "load_surface", "depths", "stays", "ratios", "speeds")
        },
    )  # fmt: skip
