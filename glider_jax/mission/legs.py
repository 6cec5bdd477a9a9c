"""How long a dive or climb takes and how far it carries the glider forward, as functions of depth.

Two kinds with one interface. ``ConstantLegs`` has one vertical and one forward speed, the shoebox and the sampled
distributions; ``TabulatedLegs`` holds the integrals of the steady glide through a stratified water column, made anew
for each member whenever its physics has changed. Both are cumulative from the surface, so that a leg between two
depths is a difference and any number of yos is a multiple.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from glider_jax.environment.fields import fenced


class Cumulative(NamedTuple):
    """Seconds and metres forward of a dive from the surface to a depth, and of a climb from there to the surface."""

    dive_time: Any
    dive_distance: Any
    climb_time: Any
    climb_distance: Any


class ConstantLegs(eqx.Module):
    """Straight legs: ``forward`` m s-1 through the water, ``down`` and ``up`` m s-1 vertical, all positive."""

    forward: Any
    down: Any
    up: Any

    def cumulative(self, depth) -> Cumulative:
        """Times and distances between the surface and ``depth`` (m)."""
        down, up = depth / self.down, depth / self.up
        return Cumulative(down, down * self.forward, up, up * self.forward)

    def depth_after(self, depth, duration):
        """Depth (m) reached by diving on from ``depth`` for ``duration`` s."""
        return depth + self.down * jnp.maximum(duration, 0.0)

    def valid(self):
        """Whether the glider moves at all."""
        return (self.down > 0.005) & (self.up > 0.005)


class TabulatedLegs(eqx.Module):
    """Legs through stratified water, linear within layers ``step`` m thick.

    ``rows`` (layers, 8): :class:`Cumulative` at the top of each layer and its growth through it, so that one gather
    finds both. ``inverse`` (nodes, 2): depth after every ``time_step`` s of diving from the surface, and its growth.
    """

    rows: Any
    inverse: Any
    step: Any
    time_step: Any
    flies: Any
    run: Any

    def cumulative(self, depth) -> Cumulative:
        """Times and distances between the surface and ``depth`` (m), linear between levels."""
        place = depth / self.step
        layer = jnp.clip(jnp.floor(place), 0.0, self.rows.shape[-2] - 1.0)
        part = jnp.clip(place - layer, 0.0, 1.0)

        def lookup():
            row = self.rows[layer.astype(jnp.int32)]
            return tuple(row[k] + part * row[4 + k] for k in range(4))

        return Cumulative(*fenced(self.run, lookup))

    def depth_after(self, depth, duration):
        """Depth (m) reached by diving on from ``depth`` for ``duration`` s."""
        until = self.cumulative(depth).dive_time + jnp.maximum(duration, 0.0)
        place = until / self.time_step
        node = jnp.clip(jnp.floor(place), 0.0, self.inverse.shape[-2] - 1.0)
        part = jnp.clip(place - node, 0.0, 1.0)

        def lookup():
            row = self.inverse[node.astype(jnp.int32)]
            return row[0] + part * row[1]

        return fenced(self.run, lookup)

    def valid(self):
        """Whether the glider glides at every level."""
        return self.flies


def tabulate(slowness_down, forward_down, slowness_up, forward_up, step, flies, run) -> TabulatedLegs:
    """Integrate slowness (s m-1) and forward speed (m s-1) given at layer middles, shape (layers,), into legs."""
    rows = jnp.stack([slowness_down, slowness_down * forward_down, slowness_up, slowness_up * forward_up], axis=-1)
    growth = rows * step
    tops = jnp.cumsum(growth, axis=0) - growth
    # The inverse of the dive's time, on as many even steps of time as there are layers.
    layers = slowness_down.shape[0]
    depths = jnp.arange(layers + 1, dtype=growth.dtype) * step
    times = jnp.append(tops[:, 0], tops[-1, 0] + growth[-1, 0])
    time_step = times[-1] / layers
    nodes = jnp.interp(jnp.arange(layers + 1, dtype=growth.dtype) * time_step, times, depths)
    inverse = jnp.stack([nodes[:-1], nodes[1:] - nodes[:-1]], axis=-1)
    return TabulatedLegs(jnp.concatenate([tops, growth], axis=-1), inverse, step, time_step, flies, run)
