"""Native Slocum binaries (sbd, tbd, mbd, nbd, dbd, ebd and their compressed forms), decoded by ``dbdreader``.

``dbdreader`` is an optional extra (``glider-jax[dbd]``) and imported only when a binary is read. It trusts
its input: a truncated file gives a row of noise, a truncated header never ends, and sensor lists are written
into the cache folder. So every file is first checked and cut to its intact cycles here, and decoded from a
temporary folder.

A binary is an ASCII header, a list of sensors (in the file, or in a cache file named after its checksum), one
known cycle of 17 bytes, then cycles: two bits per sensor that say whether it was updated, the updated values,
and ``d``."""

from __future__ import annotations

import locale
import re
import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.repairs import Table, Tally
from glider_jax.records import Array

_KINDS = {"dbd": 3, "dcd": 3, "mbd": 2, "mcd": 2, "sbd": 1, "scd": 1}
_KINDS |= {"ebd": 3, "ecd": 3, "nbd": 2, "ncd": 2, "tbd": 1, "tcd": 1}
_SCIENCE = ("ebd", "ecd", "nbd", "ncd", "tbd", "tcd")
BINARY_SUFFIXES = tuple(f".{kind}" for kind in _KINDS)
#: Sensors without a name of ours that a look into dead reckoning needs; kept under their native names.
NATIVE = (
    "m_dr_time m_dr_fix_time m_dr_postfix_time m_x_lmc m_y_lmc m_vx_lmc m_vy_lmc x_dr_state m_depth_state "
    "x_prior_seg_water_vx x_prior_seg_water_vy m_dist_to_wpt m_vmg_to_wpt m_hdg_error m_pitch_energy "
    "m_is_battpos_moving m_inflection_depth m_leakdetect_voltage m_iridium_signal_strength m_tot_horz_dist "
    "c_thruster_on u_max_water_speed"
).split()
_KNOWN_CYCLE = 17


class _Damaged(Exception):
    """A file that cannot be used, with the reason."""


@dataclass
class _File:
    """One binary after its header was understood."""

    path: Path
    header: dict[str, str]
    body: bytes
    start: int
    sensors: list[tuple[str, int, str]]
    crc: str
    listing: str
    complete: bool = True


def read_binary(paths: list[Path], cache: Path | None, wanted: tuple[str, ...], tally: Tally) -> list[Table]:
    """Decode binaries into one table per file; of several resolutions of a segment the fullest readable one
    is kept.

    Parameters
    ----------
    paths : files with a suffix of :data:`BINARY_SUFFIXES`, in any case.
    cache : folder of sensor lists, or None to look beside the files.
    wanted : sensors to decode besides :data:`NATIVE`.
    tally : gets each damaged file, missing cache file and lower-resolution copy by name.

    Raises
    ------
    DataError : ``dbdreader`` is not installed, the cache folder does not exist, or nothing could be decoded.
    """
    dbdreader = _dbdreader(paths[0])
    if cache is not None and not cache.is_dir():
        raise DataError(f"{cache}: expected a folder of sensor lists (.cac), found no folder. Correct --cache.")
    tables: dict[tuple[str, bool], tuple[int, Table]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for path in paths:
            rank, science = _KINDS[path.suffix[1:].lower()], path.suffix[1:].lower() in _SCIENCE
            try:
                file = _open(path, cache)
                table = _decode(dbdreader, file, Path(folder), wanted, science, tally)
            except _Damaged as problem:
                kind, _, detail = str(problem).partition("|")
                tally.add(kind, 1, f"{path.name}: {detail}", join=True)
                continue
            key = (file.header.get("full_filename", path.stem).lower(), science)
            if key in tables:
                tally.add("lower-resolution copies of a segment left out", 1, path.name)
            if key not in tables or rank > tables[key][0]:
                tables[key] = (rank, table)
    if not tables:
        reasons = "; ".join(f"{kind}: {example}" for kind, example in tally.examples.items())
        hint = " Give the folder with the cache files with --cache." if "cache" in reasons else ""
        raise DataError(f"{paths[0]}: expected Slocum binaries, found none that can be read ({reasons}).{hint}")
    return [table for _, table in tables.values()]


def _dbdreader(path: Path) -> ModuleType:
    """The optional decoder, imported without the change it makes to the locale."""
    before = locale.setlocale(locale.LC_ALL)
    try:
        import dbdreader
    except ImportError as problem:
        raise DataError(
            f"{path}: expected the package dbdreader for Slocum binaries, found none. "
            "Install it with: pip install 'glider-jax[dbd]'."
        ) from problem
    finally:
        locale.setlocale(locale.LC_ALL, before)
    return dbdreader


def _open(path: Path, cache: Path | None) -> _File:
    """Read, decompress and understand one file, cut to its intact cycles."""
    body, whole = path.read_bytes(), True
    if path.suffix[2:3].lower() == "c":
        body, whole = _inflate(body)
    header, at = _header(body)
    crc = header["sensor_list_crc"].lower()
    if header.get("sensor_list_factored", "0") == "1":
        text = _cache_text(path, crc, cache)
        sensors, start = _sensors(text), at
    else:
        lines = body[at:].split(b"\n", int(header["total_num_sensors"]))
        if len(lines) <= int(header["total_num_sensors"]):
            raise _Damaged("damaged files left out|the list of sensors is cut short")
        listing = b"\n".join(lines[:-1]) + b"\n"
        text, start = "", at + len(listing)
        sensors = _sensors(listing.decode("latin-1"))
    count, states = int(header["sensors_per_cycle"]), int(header["state_bytes_per_cycle"])
    if len(sensors) != count or states != (count + 3) // 4:
        detail = f"{len(sensors)} sensors listed, {count} in {states} state bytes expected"
        raise _Damaged(f"damaged files left out|{detail}")
    if len(body) < start + _KNOWN_CYCLE:
        raise _Damaged("damaged files left out|nothing follows the header")
    return _File(path, header, body, start, sensors, crc, text, whole)


def _inflate(raw: bytes) -> tuple[bytes, bool]:
    """Decompress length-prefixed LZ4 blocks up to the first that fails; the flag says whether all were
    good."""
    import lz4.block

    out, at = [], 0
    while at + 2 <= len(raw):
        size = int.from_bytes(raw[at : at + 2], "big")
        block = raw[at + 2 : at + 2 + size]
        if size == 0 or len(block) < size:
            return b"".join(out), False
        try:
            out.append(lz4.block.decompress(block, uncompressed_size=32768))
        except lz4.block.LZ4BlockError:
            return b"".join(out), False
        at += 2 + size
    return b"".join(out), at == len(raw)


def _header(body: bytes) -> tuple[dict[str, str], int]:
    """The ASCII tags and where they end."""
    header: dict[str, str] = {}
    at = 0
    needed = (
        "num_ascii_tags",
        "sensor_list_crc",
        "sensors_per_cycle",
        "state_bytes_per_cycle",
        "total_num_sensors",
    )
    if not body.startswith(b"dbd_label:"):
        raise _Damaged("damaged files left out|the header of a Slocum binary is not there")
    while "num_ascii_tags" not in header or len(header) < int(header["num_ascii_tags"]):
        end = body.find(b"\n", at)
        key, colon, value = body[at : max(end, at)].decode("latin-1").partition(":")
        if end < 0 or not colon or len(header) > 60:
            raise _Damaged("damaged files left out|the header is cut short")
        header[key.strip()] = value.strip()
        at = end + 1
        if key.strip() == "num_ascii_tags" and not re.fullmatch(r"[0-9]{1,3}", value.strip()):
            raise _Damaged("damaged files left out|the header is garbled")
    numbers = (name for name in needed if name != "sensor_list_crc")
    whole = all(re.fullmatch(r"[0-9]{1,6}", header.get(name, "")) for name in numbers)
    if not whole or not re.fullmatch(r"[0-9A-Fa-f]{1,8}", header.get("sensor_list_crc", "")):
        raise _Damaged("damaged files left out|the header is garbled")
    return header, at


def _cache_text(path: Path, crc: str, cache: Path | None) -> str:
    """The sensor list of a checksum from the cache folder, plain or compressed."""
    here = path.parent
    folders = [cache] if cache is not None else []
    folders += [
        here,
        *(base / sub for base in (here, here.parent) for sub in ("cac", "cache", "state/cache")),
    ]
    for folder in folders:
        if not folder.is_dir():
            continue
        for found in folder.iterdir():
            if found.stem.lower() == crc and found.suffix.lower() == ".cac":
                return found.read_text(encoding="latin-1")
        for found in folder.iterdir():
            if found.stem.lower() == crc and found.suffix.lower() == ".ccc":
                text, whole = _inflate(found.read_bytes())
                if whole:
                    return text.decode("latin-1")
    looked = cache.name if cache is not None else "the folders beside it"
    raise _Damaged(f"files left out for want of a cache file|needs {crc}.cac, not in {looked}")


def _sensors(text: str) -> list[tuple[str, int, str]]:
    """Name, size in bytes and unit of the sensors that a file holds, in order."""
    found = []
    for line in text.splitlines():
        words = line.split()
        if len(words) >= 7 and words[0] == "s:" and words[3] != "-1" and words[4] in ("1", "2", "4", "8"):
            found.append((words[5], int(words[4]), words[6]))
    return found


def _intact(file: _File) -> tuple[list[tuple[int, int]], int, int]:
    """Byte ranges of intact cycles, how many cycles they hold, and how many bytes between or after them are
    lost.

    A cycle counts if the byte after it is ``d`` for another cycle, ``X`` for the end, or the file ends there.
    After a break, reading goes on where the next four cycles in a row are intact."""
    states = int(file.header["state_bytes_per_cycle"])
    sizes = np.zeros(states * 4, int)
    sizes[: len(file.sensors)] = [size for _, size, _ in file.sensors]
    fields = (np.arange(256)[:, None] >> np.array([6, 4, 2, 0])) & 3
    table = ((fields == 2)[None] * sizes.reshape(states, 1, 4)).sum(axis=2)
    raw = np.frombuffer(file.body, np.uint8)
    column = np.arange(states)

    def following(at: int) -> int | None:
        """Where the cycle at ``at`` ends, or None if it is not intact."""
        if at + states > raw.size:
            return None
        end = at + states + int(table[column, raw[at : at + states]].sum())
        return end if end == raw.size or (end < raw.size and raw[end] in (0x64, 0x58)) else None

    def chain(at: int, length: int) -> bool:
        for _ in range(length):
            end = following(at)
            if end is None:
                return False
            if end == raw.size or raw[end] == 0x58:
                return True
            at = end + 1
        return True

    spans, cycles, lost = [], 0, 0
    begin = at = file.start + _KNOWN_CYCLE
    while at < raw.size:
        end = following(at)
        if end is not None:
            cycles += 1
            at = end + 1
            if end >= raw.size or raw[end] == 0x58:
                spans.append((begin, end))
                return spans, cycles, lost
            continue
        spans.append((begin, at - 1))
        marks = np.flatnonzero(raw[at:] == 0x64) + at + 1
        begin = next((int(m) for m in marks if chain(int(m), 4)), raw.size)
        lost += begin - at
        at = begin
    if begin < raw.size:
        spans.append((begin, min(at, raw.size)))
    return spans, cycles, lost


def _decode(
    dbdreader: ModuleType, file: _File, folder: Path, wanted: tuple[str, ...], science: bool, tally: Tally
) -> Table:
    """Decode the intact part of a file from a copy of it."""
    spans, cycles, lost = _intact(file)
    if lost or not file.complete:
        detail = f"{file.path.name}: {cycles} intact cycles kept, {lost} bytes lost"
        tally.add("files cut short or garbled, intact part kept", 1, detail, join=True)
    copy = folder / ("x.ebd" if science else "x.dbd")
    parts = [file.body[: file.start + _KNOWN_CYCLE], *(file.body[a:b] + b"d" for a, b in spans if b > a)]
    copy.write_bytes(b"".join(parts)[:-1] + b"X")
    if file.listing:
        (folder / f"{file.crc}.cac").write_text(file.listing, encoding="latin-1")
    names = {name for name, _, _ in file.sensors}
    clock = "sci_m_present_time" if science else "m_present_time"
    if clock not in names:
        raise _Damaged(f"damaged files left out|no {clock} among its sensors")
    asked = [n for n in dict.fromkeys((*wanted, *NATIVE)) if n in names]
    time, columns = _values(dbdreader, copy, folder, clock, asked)
    units = {name: unit for name, _, unit in file.sensors if name in columns}
    starts = time[np.isfinite(time) & (time > 1.0)][:1]
    return Table(
        label=file.path.name,
        stream="science" if science else "flight",
        time=time,
        columns=columns,
        units=units,
        segments=(file.header.get("full_filename", file.path.stem),),
        starts=tuple(float(t) for t in starts),
        missions=(file.header["mission_name"],) if "mission_name" in file.header else (),
        facts={"product": "Slocum binaries", "position_units": "NMEA"},
    )


def _values(dbdreader: Any, copy: Path, folder: Path, clock: str, asked: list[str]) -> tuple[Array, dict[str, Array]]:
    """Times and raw values of the asked sensors, NaN where a cycle did not update them."""
    failures = (dbdreader.DbdError, ValueError, KeyError, IndexError, struct.error, OSError)
    try:
        decoder = dbdreader.DBD(str(copy), cacheDir=str(folder))
        pairs = decoder.get(clock, *asked, return_nans=True, decimalLatLon=False, discardBadLatLon=False)
        decoder.close()
    except failures as problem:
        raise _Damaged(f"damaged files left out|{problem}") from problem
    if not asked:
        pairs = [pairs]
    columns = {name: np.asarray(values, float) for name, (_, values) in zip(asked, pairs[1:], strict=True)}
    return np.asarray(pairs[0][1], float), columns
