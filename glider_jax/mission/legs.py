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
    """Legs through stratified water: ``tables`` (4, levels) of :class:`Cumulative` at depths ``step`` m apart."""

    tables: Any
    step: Any
    flies: Any

    def cumulative(self, depth) -> Cumulative:
        """Times and distances between the surface and ``depth`` (m), linear between levels.

        A sum of hat functions, because a gather per member costs more than these few multiplications.
        """
        levels = self.tables.shape[-1]
        place = jnp.clip(depth / self.step, 0.0, levels - 1.0)
        hats = jnp.maximum(1.0 - jnp.abs(place - jnp.arange(levels, dtype=self.tables.dtype)), 0.0)
        values = (self.tables * hats).sum(axis=-1)
        return Cumulative(values[0], values[1], values[2], values[3])

    def depth_after(self, depth, duration):
        """Depth (m) reached by diving on from ``depth`` for ``duration`` s."""
        until = self.cumulative(depth).dive_time + jnp.maximum(duration, 0.0)
        low, high = self.tables[0, :-1], self.tables[0, 1:]
        return (jnp.clip((until - low) / (high - low), 0.0, 1.0) * self.step).sum(axis=-1)

    def valid(self):
        """Whether the glider glides at every level."""
        return self.flies


def tabulate(slowness_down, forward_down, slowness_up, forward_up, step, flies) -> TabulatedLegs:
    """Integrate slowness (s m-1) and forward speed (m s-1) given at layer middles, shape (layers,), into legs."""
    rows = jnp.stack([slowness_down, slowness_down * forward_down, slowness_up, slowness_up * forward_up])
    total = jnp.cumsum(rows, axis=-1) * step
    return TabulatedLegs(jnp.concatenate([jnp.zeros_like(total[:, :1]), total], axis=-1), step, flies)
