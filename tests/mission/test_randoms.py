"""The step's own random numbers: known words, moments, independence of streams, and the turn's accuracy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from glider_jax.mission import randoms

KEY = (jnp.uint32(0x13198A2E), jnp.uint32(0x03707344))


def test_twenty_rounds_give_the_published_words(monkeypatch):
    # Known answer of Threefry-2x32 with 20 rounds for zero counter and key, from the authors' test vectors.
    monkeypatch.setattr(randoms, "_ROUNDS", 20)
    a, b = randoms.words((jnp.uint32(0), jnp.uint32(0)), jnp.int32(0), 0)
    assert (int(a), int(b)) == (0x6B200159, 0x99BA4EFE)


def test_normals_are_standard_and_independent():
    counters = jnp.arange(200_000, dtype=jnp.int32)
    draw = jax.vmap(lambda c, s: randoms.normals(*randoms.words(KEY, c, s), jnp.float32), in_axes=(0, None))
    a, b = draw(counters, randoms.NOISE_STREAM)
    c, _ = draw(counters, randoms.START_STREAM)
    for x in (a, b, c):
        x = np.asarray(x, float)
        assert abs(x.mean()) < 5 / np.sqrt(x.size)
        assert abs(x.std() - 1) < 5 / np.sqrt(2 * x.size)
        assert abs((x**4).mean() - 3) < 5 * np.sqrt(96 / x.size)
    for x, y in ((a, b), (a, c), (a[1:], a[:-1])):
        assert abs(np.mean(np.asarray(x, float) * np.asarray(y, float))) < 5 / np.sqrt(a.size)


def test_uniform_never_reaches_its_ends():
    for word in (0, 2**32 - 1):
        value = float(randoms.uniform(jnp.uint32(word), jnp.float32))
        assert 0.0 < value < 1.0


def test_turn_is_a_point_on_the_circle():
    share = jnp.linspace(0.0, 1.0, 10_001, dtype=jnp.float32)
    cosine, sine = randoms._turn(share)
    angle = 2 * np.pi * np.asarray(share, float)
    assert np.max(np.abs(np.asarray(cosine) - np.cos(angle))) < 1e-6
    assert np.max(np.abs(np.asarray(sine) - np.sin(angle))) < 1e-6
