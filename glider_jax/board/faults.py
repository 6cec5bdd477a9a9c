"""Damage to a byte stream, for tests and for the emulator; NumPy only.

Every kind of trouble that a serial line and a card make: flipped bits, bursts, lost and doubled bytes,
truncation, noise
between frames, and a receiver set to the wrong baud rate. All draws come from the generator that is passed
in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.frames import SYNC

KINDS = ("flip", "burst", "replace", "drop", "double", "truncate", "noise", "fake_header", "splice")


@dataclass(frozen=True)
class Fault:
    """One fault of a played stream: at which byte, what, and how long (bytes; seconds for ``unplug``)."""

    at: int
    kind: str
    length: float = 1.0


def damage(data: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """Damage a piece of a stream once.

    Parameters
    ----------
    data : a frame or several, at least two bytes.
    kind : one of ``KINDS``.
    """
    raw = bytearray(data)
    size = len(raw)
    at = int(rng.integers(size))
    if kind == "flip":
        for bit in rng.integers(8 * size, size=int(rng.integers(1, 9))):
            raw[bit // 8] ^= 1 << (bit % 8)
    elif kind == "burst":
        length = int(rng.integers(2, 12))
        raw[at : at + length] = rng.bytes(len(raw[at : at + length]))
    elif kind == "replace":
        raw[at] = int(rng.integers(256))
    elif kind == "drop":
        del raw[at : at + int(rng.integers(1, 4))]
    elif kind == "double":
        piece = raw[at : at + int(rng.integers(1, 4))]
        raw[at:at] = piece
    elif kind == "truncate":
        del raw[max(1, at) :]
    elif kind == "noise":
        raw[at:at] = rng.bytes(int(rng.integers(1, 40)))
    elif kind == "fake_header":
        # Start a second copy of the frame's own header inside its payload, the hardest case to tell apart.
        raw[at:at] = bytes(SYNC) + data[2:8]
    elif kind == "splice":
        # The head of the frame goes on with the tail of itself from elsewhere, as after a missed interrupt.
        start = int(rng.integers(size))
        raw = bytearray(data[:at] + data[start:])
    else:
        raise ValueError(f"unknown kind of damage: {kind!r}")
    return bytes(raw)


def at_wrong_baud(data: bytes, sent: float, received: float) -> bytes:
    """What a receiver at another baud rate makes of an 8N1 line that is never idle.

    Parameters
    ----------
    data : bytes sent back to back.
    sent, received : baud rates of the two ends.
    """
    bytes_in = np.frombuffer(data, dtype=np.uint8)
    line = np.ones((bytes_in.size, 10), dtype=np.uint8)
    line[:, 0] = 0
    line[:, 1:9] = np.unpackbits(bytes_in[:, None], axis=1, bitorder="little")
    levels: NDArray[np.uint8] = np.concatenate([line.reshape(-1), np.ones(20, dtype=np.uint8)])
    step = sent / received
    out = bytearray()
    falls = np.flatnonzero((levels[:-1] == 1) & (levels[1:] == 0)) + 1
    falls = np.concatenate([[0], falls]) if levels[0] == 0 else falls
    position, index = 0.0, 0
    while True:
        index = int(np.searchsorted(falls, position, side="left"))
        if index >= falls.size:
            return bytes(out)
        start = float(falls[index])
        middles = (start + step * (np.arange(1, 9) + 0.5)).astype(np.int64)
        if middles[-1] >= levels.size:
            return bytes(out)
        out.append(int(np.packbits(levels[middles], bitorder="little")[0]))
        position = start + 9.5 * step


def random_faults(
    size: int, rate: float, rng: np.random.Generator, kinds: tuple[str, ...] = KINDS
) -> list[Fault]:
    """Faults spread evenly over a stream of ``size`` bytes, ``rate`` per byte on average, ascending."""
    count = int(rng.poisson(size * rate))
    places = np.sort(rng.integers(0, max(size, 1), size=count))
    return [Fault(int(at), str(rng.choice(kinds))) for at in places]
