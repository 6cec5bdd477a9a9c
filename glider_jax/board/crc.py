"""Two CRC-16s over the same bytes, computed for many frames at once; NumPy only.

One CRC-16 lets through one damaged frame in 65,536, which a month of noise meets many times. Two with coprime
generators act as one 32-bit CRC with their product as generator. Both are linear, so the check of a
fixed-length
frame is the exclusive-or of one table entry per byte (or byte pair), which NumPy does for a million frames
at a time.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

POLYNOMIAL_A = 0x1021  # CRC-16/IBM-3740 (CCITT), initial value 0xFFFF
POLYNOMIAL_B = 0x8BB7  # generator of CRC-16/T10-DIF, here with initial value 0xFFFF
_START = 0xFFFF


def _byte_table(polynomial: int) -> list[int]:
    """Table of the 256 single-byte remainders of a CRC-16, most significant bit first."""
    table = []
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = ((value << 1) ^ polynomial) & 0xFFFF if value & 0x8000 else (value << 1) & 0xFFFF
        table.append(value)
    return table


_TABLE_A = _byte_table(POLYNOMIAL_A)
_TABLE_B = _byte_table(POLYNOMIAL_B)


def _plain(data: bytes, table: list[int], start: int) -> int:
    value = start
    for byte in data:
        value = ((value << 8) & 0xFFFF) ^ table[(value >> 8) ^ byte]
    return value


def crc_pair(data: bytes) -> int:
    """Both checks of one message, byte by byte: the reference that the fast path is tested against.

    Parameters
    ----------
    data : the bytes covered by the checks.

    Returns
    -------
    CRC A in the low 16 bits, CRC B in the high 16 bits.
    """
    return _plain(data, _TABLE_A, _START) | (_plain(data, _TABLE_B, _START) << 16)


def _advance(values: NDArray[np.uint32], table: NDArray[np.uint32]) -> NDArray[np.uint32]:
    return ((values << np.uint32(8)) & np.uint32(0xFFFF)) ^ table[values >> np.uint32(8)]


class _PairTables:
    """Contribution of a little-endian byte pair by its distance from the end of the message, made when
    first needed.

    One table serves messages of all lengths; there are 130 of 256 KiB at most.
    """

    def __init__(self) -> None:
        self._first = np.array(_TABLE_A, dtype=np.uint32), np.array(_TABLE_B, dtype=np.uint32)
        self._state = self._first
        self._tables: list[NDArray[np.uint32]] = []

    def _next(self) -> NDArray[np.uint32]:
        a, b = self._state
        self._state = _advance(a, self._first[0]), _advance(b, self._first[1])
        return a | (b << np.uint32(16))

    def __getitem__(self, distance: int) -> NDArray[np.uint32]:
        while len(self._tables) <= distance:
            high, low = self._next(), self._next()
            # The low byte of a little-endian pair comes first on the wire, so it is further from the end.
            self._tables.append((high[:, None] ^ low[None, :]).reshape(-1))
        return self._tables[distance]


_PAIRS = _PairTables()


@functools.cache
def _start_value(length: int) -> int:
    return crc_pair(bytes(length))


def crc_many(pairs: NDArray[np.uint16]) -> NDArray[np.uint32]:
    """Both checks of many messages of one even length.

    Parameters
    ----------
    pairs : (message, length // 2) the messages as little-endian byte pairs.

    Returns
    -------
    (message,) as :func:`crc_pair` returns them.
    """
    length = 2 * pairs.shape[1]
    out = np.full(pairs.shape[0], _start_value(length), dtype=np.uint32)
    last = pairs.shape[1] - 1
    for column in range(pairs.shape[1]):
        out ^= _PAIRS[last - column][pairs[:, column]]
    return out
