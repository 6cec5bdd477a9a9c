"""Every known term that a base model may leave out; ``LIBRARY`` is the explicit list."""

from __future__ import annotations

from glider_jax.physics.term import AbstractTerm

LIBRARY: tuple[type[AbstractTerm], ...] = ()
