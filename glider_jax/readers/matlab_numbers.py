"""Numeric arrays of Matlab files, version 5 to 7, read with every length checked.

NumPy and the standard library only: the usual reader can crash the whole process on a damaged file, and only plain
numbers are wanted here. Cells, structures, text and sparse or complex matrices are left out.
"""

from __future__ import annotations

import zlib

import numpy as np

from glider_jax.errors import DataError
from glider_jax.records import Array

HEADER = 128
MATRIX, COMPRESSED = 14, 15
#: Data type number of the format -> NumPy type.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
#: Array class number -> NumPy type, for the classes that hold numbers.
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
COMPLEX = 0x0800


def matlab_arrays(content: bytes, where: str) -> dict[str, Array]:
    """Real numeric arrays by name, with Matlab's shapes.

    Parameters
    ----------
    content : the whole file.
    where : start of the error message.

    Raises
    ------
    DataError : the file is cut off or damaged.
    """
    if len(content) < HEADER or content[126:128] not in (b"IM", b"MI"):
        raise DataError(
            f"{where}: expected a readable Matlab file of version 5 to 7, found a damaged or other one. "
            "Save it again with '-v7'."
        )
    order = "<" if content[126:128] == b"IM" else ">"
    found: dict[str, Array] = {}
    try:
        for kind, data in _elements(content[HEADER:], order):
            if kind == COMPRESSED:
                kind, data = next(_elements(zlib.decompress(data), order))
            if kind == MATRIX:
                found.update(_matrix(data, order))
    except (ValueError, KeyError, StopIteration, zlib.error, UnicodeDecodeError) as problem:
        raise DataError(
            f"{where}: expected a readable Matlab file, found a damaged one ({problem or 'cut off'}). Get it again."
        ) from problem
    return found


def _elements(content: bytes, order: str):
    """Yield the (type, bytes) elements of a stretch of the file."""
    place = 0
    while place + 8 <= len(content):
        first, size = (int(n) for n in np.frombuffer(content, f"{order}u4", 2, place))
        if first >> 16:  # a small element: its size shares the first word, its data the second
            kind, size, start, step = first & 0xFFFF, first >> 16, place + 4, 8
            if size > 4:
                raise ValueError(f"a small element of {size} bytes")
        else:
            kind, start = first, place + 8
            # Compressed elements are not padded to eight bytes, all others are.
            step = 8 + (size if kind == COMPRESSED else -(-size // 8) * 8)
        if start + size > len(content):
            raise ValueError(f"an element of {size} bytes with {len(content) - start} left")
        yield kind, content[start : start + size]
        place += step


def _matrix(content: bytes, order: str) -> dict[str, Array]:
    """One named array, or nothing if it does not hold real numbers."""
    parts = _elements(content, order)
    flags = int(np.frombuffer(next(parts)[1], f"{order}u4")[0])
    shape = tuple(int(n) for n in np.frombuffer(next(parts)[1], f"{order}i4"))
    name = next(parts)[1].decode("ascii").strip("\x00")
    if (flags & 0xFF) not in CLASSES or flags & COMPLEX:
        return {}
    kind, data = next(parts)
    values = np.frombuffer(data, np.dtype(TYPES[kind]).newbyteorder(order))
    if not shape or min(shape) < 0 or values.size != int(np.prod(shape, dtype=object)):
        raise ValueError(f"'{name}' of shape {shape} with {values.size} values")
    return {name: values.astype(CLASSES[flags & 0xFF]).reshape(shape, order="F")}
