"""Random numbers inside the step: Threefry-2x32 with 13 rounds, counter based, one member's stream per key.

``jax.random`` rolls its rounds into a loop on CPU, which costs half of a whole mission step. The numbers depend on
key and counter only, so the order of chunks, devices or steps of other members does not matter.

References
----------
Salmon, Moraes, Dror and Shaw (2011), Parallel random numbers: as easy as 1, 2, 3, section 4.2; 13 rounds are the
fewest that pass their statistical tests.
"""

from __future__ import annotations

import math

import jax.numpy as jnp

_ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
_PARITY = 0x1BD11BDA
_ROUNDS = 13
SPEED_STREAM = 1
NOISE_STREAM = 2
START_STREAM = 3


def words(key, counter, stream):
    """Two uint32 words for a counter (int32) of a stream (small number) under a member's key (two uint32)."""
    schedule = (key[0], key[1], key[0] ^ key[1] ^ jnp.uint32(_PARITY))
    a = counter.astype(jnp.uint32) + schedule[0]
    b = jnp.uint32(stream) + schedule[1]
    for r in range(_ROUNDS):
        turn = _ROTATIONS[r % 8]
        a = a + b
        b = (b << jnp.uint32(turn)) | (b >> jnp.uint32(32 - turn))
        b = b ^ a
        if r % 4 == 3:
            part = r // 4 + 1
            a = a + schedule[part % 3]
            b = b + schedule[(part + 1) % 3] + jnp.uint32(part)
    return a, b


def uniform(word, dtype):
    """A number in (0, 1), never 0 or 1, from the 23 leading bits of a word."""
    return ((word >> jnp.uint32(9)).astype(dtype) + 0.5) * (1.0 / 8388608.0)


def normals(a, b, dtype):
    """Two independent standard normal numbers from two words (Box and Muller)."""
    radius = jnp.sqrt(-2.0 * jnp.log(uniform(a, dtype)))
    cosine, sine = _turn(uniform(b, dtype))
    return radius * cosine, radius * sine


def _turn(share):
    """Cosine and sine of a share (0 to 1) of a full turn, within 1e-7.

    Half angles within a quarter turn need no range reduction, which is what makes the library's functions slow.
    """
    x = (share - 0.5) * jnp.pi
    y = x * x
    sine, cosine = jnp.full_like(y, _SINE[-1]), jnp.full_like(y, _COSINE[-1])
    for s, c in zip(_SINE[-2::-1], _COSINE[-2::-1], strict=True):
        sine, cosine = sine * y + s, cosine * y + c
    sine = sine * x
    return 2.0 * sine * sine - 1.0, -2.0 * sine * cosine


_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(7))
_COSINE = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(7))
