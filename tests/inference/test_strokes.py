"""Strokes of the pump: what is odd about one, and what is a hole of the record."""

from __future__ import annotations

import numpy as np

from glider_jax.inference.windows import Stroke, Window, power_rows, sort_strokes, why_no_power
from tests.diagnosis.worlds import fly


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


def test_a_current_that_is_rarely_there_is_no_power():
    """A telemetered subset with a current every three minutes gives no sums, and says how often it would have to be."""
    recording = fly(0.5)
    assert why_no_power(recording) == "" and power_rows(recording) is not None
    rare = recording.channels["current"].copy()
    kept = np.searchsorted(recording.time, np.arange(recording.time[0], recording.time[-1], 180.0))
    rare[np.setdiff1d(np.arange(rare.size), kept)] = np.nan
    thin = type(recording)(**{**recording.__dict__, "channels": recording.channels | {"current": rare}})
    assert power_rows(thin) is None and "every 18" in why_no_power(thin)
    none = {k: v for k, v in recording.channels.items() if k != "current"}
    bare = type(recording)(**{**recording.__dict__, "channels": none})
    assert power_rows(bare) is None and why_no_power(bare) == "no battery current"
