"""Strokes of the pump: what is odd about one, and what is a hole of the record."""

from __future__ import annotations

import numpy as np

from glider_jax.inference.windows import Stroke, Window, sort_strokes


def strokes(odd=(), holes=(), count=40):
    """Strokes that cost 110 J and 6 J/m, some 40 % more, some with a row lost."""
    rng = np.random.default_rng(3)
    found = []
    for k in range(count):
        depth = 20.0 + 2.0 * (k % 20)
        energy = (110.0 + 6.0 * depth) * (1.4 if k in odd else 1.0) + rng.normal(0.0, 3.0)
        window = Window(energy, 30.0, 14.0, 1.0, 900.0 * k, 4)
        found.append(Stroke(window, True, depth, 460e-6, k, 283.0, k not in holes))
    return found


def test_dear_strokes_are_odd_and_holes_are_not():
    """A stroke that costs far more is set aside and told; one with a row lost is set aside and not told."""
    found = sort_strokes(strokes(odd=(3, 9, 15, 30), holes=(9, 30, 31)))
    assert sorted(s.leg for s, _ in found.odd) == [3, 15]
    alike = {s.leg for s in found.alike}
    assert not alike & {3, 9, 15, 30} and 31 in alike
    assert all(excess > 50.0 for _, excess in found.odd)
