"""Currents that were read and filled before, kept in the cache folder: filling gaps is the slowest part of a start.

A kept grid is taken only if the files are the same (name, size, time of change), the same area and time were asked
for, and the code that reads and fills is the same. Plain NumPy archives; one that cannot be read is made anew.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

import glider_jax
from glider_jax.records import CurrentGrid, Source

KEPT = 12
LARGEST = 256e6  # bytes
_ARRAYS = ("time", "depth", "latitude", "longitude", "east", "north", "sea", "east_sd", "north_sd")
_PLAIN = ("filled", "fill_method", "constant_in_time")


def kept_currents(
    folder: Path | None, paths: Sequence[Path], asked: tuple, make: Callable[[], CurrentGrid]
) -> CurrentGrid:
    """What ``make`` reads, from the folder if it lies there already.

    Parameters
    ----------
    folder : None keeps nothing.  paths : files or folders that are read.  asked : what else decides the outcome.
    """
    name = None if folder is None else _name(paths, asked)
    if name is None:
        return make()
    path = folder / f"{name}.npz"
    found = _read(path)
    if found is None:
        found = make()
        _write(path, found)
    return found


def _name(paths: Sequence[Path], asked: tuple) -> str | None:
    """A digest of files, question and code; None where a file cannot be looked at."""
    files = []
    try:
        for path in map(Path, paths):
            for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
                stat = file.stat()
                files.append((str(file.resolve()), stat.st_size, stat.st_mtime_ns))
    except OSError:
        return None
    return hashlib.sha256(repr((files, asked, _code())).encode()).hexdigest()[:40]


@cache
def _code() -> str:
    digest = hashlib.sha256()
    root = Path(glider_jax.__file__).parent
    for path in sorted([*root.glob("*.py"), *(root / "readers").glob("*.py"), *(root / "environment").glob("*.py")]):
        digest.update(path.read_bytes())
    versions = [version(name) for name in ("numpy", "scipy", "netCDF4", "xarray")]
    return f"{digest.hexdigest()} {versions}"


def _read(path: Path) -> CurrentGrid | None:
    try:
        with np.load(path, allow_pickle=False) as archive:
            told = json.loads(str(archive["told"]))
            arrays = {name: archive[name] for name in _ARRAYS if name in archive}
            source = Source(told["product"], told["files"], tuple(told["notes"]))
            return CurrentGrid(source=source, **arrays, **{name: told[name] for name in _PLAIN})
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None


def _write(path: Path, grid: CurrentGrid) -> None:
    """Keep a grid, and drop the oldest beyond the number kept; a full disk costs only the time."""
    arrays = {name: getattr(grid, name) for name in _ARRAYS if getattr(grid, name) is not None}
    known = {"source", *_ARRAYS, *_PLAIN}
    if sum(a.nbytes for a in arrays.values()) > LARGEST or {f.name for f in fields(grid)} != known:
        return
    source = grid.source
    told = {"product": source.product, "files": dict(source.files), "notes": list(source.notes)}
    told |= {name: getattr(grid, name) for name in _PLAIN}
    temporary = path.with_name(f"{path.stem}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "wb") as stream:
            np.savez(stream, told=json.dumps(told), **arrays)
        temporary.replace(path)
        for old in sorted(path.parent.glob("*.npz"), key=lambda p: p.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        temporary.unlink(missing_ok=True)
