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


@functools.cache
def _pair_tables(length: int) -> tuple[NDArray[np.uint32], ...]:
    """Contribution of each little-endian byte pair, by its distance from the end of a message of even
    ``length``."""
    first_a = np.array(_TABLE_A, dtype=np.uint32)
    first_b = np.array(_TABLE_B, dtype=np.uint32)

    def advance(values: NDArray[np.uint32], table: NDArray[np.uint32]) -> NDArray[np.uint32]:
        return ((values << np.uint32(8)) & np.uint32(0xFFFF)) ^ table[values >> np.uint32(8)]

    by_distance = []
    state_a, state_b = first_a, first_b
    for _ in range(length):
        by_distance.append(state_a | (state_b << np.uint32(16)))
        state_a, state_b = advance(state_a, first_a), advance(state_b, first_b)
    tables = []
    for end in range(0, length, 2):
        high, low = by_distance[end], by_distance[end + 1]
        # In a little-endian pair the low byte comes first on the wire, so it is one byte further from the
        # end.
        tables.append((high[:, None] ^ low[None, :]).reshape(-1))
    return tuple(reversed(tables))


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
    for column, table in enumerate(_pair_tables(length)):
        out ^= table[pairs[:, column]]
    return out
