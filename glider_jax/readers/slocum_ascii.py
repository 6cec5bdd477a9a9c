"""Slocum recordings that were converted to ASCII: ``.dba``, ``.dat``, ``.asc`` with a ``DBD_ASC`` header.

NumPy only. Positions are NMEA degrees and minutes, as in the binaries they come from. Flight and science rows
are interleaved; a row's time is the flight computer's where it has one, else the science computer's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.repairs import Table, Tally
from glider_jax.records import Array


def read_ascii(path: Path, tally: Tally) -> list[Table]:
    """Read one ASCII file; rows that do not parse are left out and counted.

    Raises
    ------
    DataError : the header is not that of a converted Slocum file, or no time column is there.
    """
    lines = path.read_text(encoding="latin-1").splitlines()
    header = _header(path, lines)
    top = int(header["num_ascii_tags"])
    labels = int(header.get("num_label_lines", "3"))
    names, units = lines[top].split(), lines[top + 1].split()
    rows = [line for line in lines[top + labels :] if line.strip()]
    values, bad = _numbers(rows, len(names))
    tally.add("garbage rows", bad, path.name)
    columns = dict(zip(names, values.T.copy(), strict=True))
    flight, science = columns.get("m_present_time"), columns.get("sci_m_present_time")
    if flight is None and science is None:
        raise DataError(
            f"{path}: expected the column m_present_time or sci_m_present_time, found {len(names)} columns "
            "without either. Convert the file again with its time."
        )
    if flight is None:
        time, stream = science, "science"
    else:
        time, stream = flight, "flight"
        if science is not None:
            time = np.where(np.isfinite(flight), flight, science)
    columns.pop("m_present_time", None)
    return [
        Table(
            label=path.name,
            stream=stream,
            time=time,
            columns=columns,
            units=dict(zip(names, units, strict=False)),
            segments=(header.get("filename", path.stem),),
            missions=(header["mission_name"],) if "mission_name" in header else (),
            facts={"product": "Slocum ASCII", "position_units": "NMEA"},
        )
    ]


def _header(path: Path, lines: list[str]) -> dict[str, str]:
    """The key: value tags above the table."""
    found = lines[0][:60] if lines else "an empty file"
    header: dict[str, str] = {}
    for line in lines[:60]:
        key, colon, value = line.partition(":")
        if not colon:
            break
        header[key.strip()] = value.strip()
    tags = header.get("num_ascii_tags", "")
    if "dbd_label" not in header or not tags.isdigit() or int(tags) + 3 > len(lines):
        raise DataError(
            f"{path}: expected a converted Slocum file that begins with 'dbd_label:' and its tags, found '{found}'. "
            "Give the output of dbd2asc, or the binary itself."
        )
    return header


def _numbers(rows: list[str], width: int) -> tuple[Array, int]:
    """Values (row, column), and how many rows did not hold ``width`` numbers."""
    good = []
    for row in rows:
        words = row.split()
        if len(words) != width:
            continue
        try:
            good.append(np.array(words, dtype=float))
        except ValueError:
            continue
    return (np.array(good) if good else np.empty((0, width))), len(rows) - len(good)
