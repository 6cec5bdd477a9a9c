"""Is a NetCDF file whole? The classic formats do not say so themselves: a file that was cut off reads as zeros.

Standard library only. Layout: the NetCDF classic format specification (CDF-1, CDF-2 and CDF-5).
"""

from __future__ import annotations

import struct
from pathlib import Path

from glider_jax.errors import DataError

#: Bytes of one value by type number.
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
DIMENSION, VARIABLE, ATTRIBUTE = 10, 11, 12
LARGEST_HEADER = 1 << 24


class _Header:
    """Numbers and names of a header, one after the other."""

    def __init__(self, content: bytes):
        self.content, self.place, self.version = content, 4, content[3]

    def word(self, size: int = 4) -> int:
        """The next unsigned big-endian number."""
        (number,) = struct.unpack_from(">Q" if size == 8 else ">I", self.content, self.place)
        self.place += size
        return number

    def count(self) -> int:
        """The next length, which is longer in CDF-5."""
        return self.word(8 if self.version == 5 else 4)

    def skip(self, size: int) -> None:
        """Pass over bytes that are padded to four."""
        self.place += -(-size // 4) * 4
        if size < 0 or self.place > len(self.content):
            raise struct.error("beyond the end")

    def list_of(self, tag: int) -> int:
        """Length of the next list, which must be of the given kind or absent."""
        found, length = self.word(), self.count()
        if found not in (0, tag):
            raise struct.error("not a list")
        return length

    def attributes(self) -> None:
        """Pass over a list of attributes."""
        for _ in range(self.list_of(ATTRIBUTE)):
            self.skip(self.count())
            size = SIZES.get(self.word(), 0)
            self.skip(size * self.count())


def needed_size(content: bytes) -> int:
    """Bytes that a classic file must have, from its header.

    Raises
    ------
    struct.error : the header itself is cut off or damaged.
    """
    header = _Header(content)
    records = header.count()
    lengths = []
    for _ in range(header.list_of(DIMENSION)):
        header.skip(header.count())
        lengths.append(header.count())
    header.attributes()
    fixed, record = [], []
    for _ in range(header.list_of(VARIABLE)):
        header.skip(header.count())
        dims = [header.count() for _ in range(header.count())]
        header.attributes()
        kind = header.word()
        header.count()
        begin = header.word(4 if header.version == 1 else 8)
        if kind not in SIZES or any(d >= len(lengths) for d in dims):
            raise struct.error("a variable of unknown kind or dimension")
        grows = bool(dims) and lengths[dims[0]] == 0
        size = SIZES[kind]
        for d in dims[1:] if grows else dims:
            size *= lengths[d]
        (record if grows else fixed).append((begin, size))
    ends = [begin + size for begin, size in fixed]
    # A single record variable is packed, several are padded to four bytes each.
    step = record[0][1] if len(record) == 1 else sum(-(-size // 4) * 4 for _, size in record)
    if records and records < (1 << 32) - 1:
        ends += [begin + (records - 1) * step + size for begin, size in record]
    return max(ends, default=header.place)


def check_whole(path: str | Path) -> None:
    """Raise DataError if a classic NetCDF file is shorter than its header says; other files pass unseen."""
    path = Path(path)
    with open(path, "rb") as stream:
        content = stream.read(LARGEST_HEADER)
    check_whole_bytes(content, path.stat().st_size, path.name)


def check_whole_bytes(content: bytes, size: int, where: str) -> None:
    """As :func:`check_whole`, for the first bytes of a file of a given size."""
    if content[:4] not in (b"CDF\x01", b"CDF\x02", b"CDF\x05"):
        return
    try:
        needed = needed_size(content)
    except struct.error as problem:
        raise DataError(
            f"{where}: expected a whole NetCDF file, found a damaged header ({problem}). Get the file again."
        ) from problem
    if size < needed:
        raise DataError(
            f"{where}: expected {needed:,} bytes, found {size:,}: the file was cut off and would read as zeros. "
            "Get it again."
        )
