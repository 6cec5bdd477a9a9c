"""Small inputs that come with the package: the default ocean and everything else the default mission needs.

``path`` finds a file wherever the package is installed. The ocean files are made by ``make_default``; what
each file is, who made it and its checksum stand in ``MANIFEST.json``.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

from glider_jax.errors import DataError, did_you_mean

_SUFFIXES = (".nc", ".toml", ".json", ".mi", ".ma", ".npz", ".js", ".css")


def folder() -> Path:
    """Where the bundled files lie."""
    return Path(str(resources.files(__name__)))


def names() -> tuple[str, ...]:
    """Names of all bundled files, folders with a slash, as ``path`` takes them."""
    root = folder()
    found = (item for item in root.rglob("*") if item.suffix in _SUFFIXES)
    return tuple(sorted(item.relative_to(root).as_posix() for item in found))


def path(name: str) -> Path:
    """Path of one bundled file.

    Parameters
    ----------
    name : as listed by ``names``, for example ``new_jersey_currents.nc``.

    Raises
    ------
    DataError : no such file is bundled; the nearest name is offered.
    """
    known = names()
    if name not in known:
        raise DataError(f"bundled data: expected one of {', '.join(known)}, found '{name}'.{did_you_mean(name, known)}")
    return Path(str(resources.files(__name__))).joinpath(name)


def manifest() -> dict[str, Any]:
    """The manifest: source, licence and checksum of each file, and the default mission's waypoints."""
    return json.loads(path("MANIFEST.json").read_text(encoding="utf-8"))
