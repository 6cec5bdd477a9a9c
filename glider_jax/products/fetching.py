"""Public data fetched once: into a folder of the user's cache, whole or not at all, with a checksum beside each file.

Standard library only. A file fetched before is taken from the cache without asking the network, after its checksum was
compared; a file that was changed or cut is fetched again.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http.client import HTTPException
from pathlib import Path
from typing import Any, BinaryIO
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from glider_jax import __version__
from glider_jax.errors import ConfigError, DataError
from glider_jax.products import public_sources as public
from glider_jax.products.atomic import atomic_path, write_text
from glider_jax.products.wording import one_line
from glider_jax.records import Source

LARGEST = 2_000_000_000
_MAGIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF")
_AGENT = {"User-Agent": f"glider_jax/{__version__}"}
_AGAIN = (429, 500, 502, 503, 504)
_TRIES, _PAUSE, _TIMEOUT = 3, 1.0, 60.0


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source: box (south, north, west, east) degrees, period in UTC s, every ``stride``-th point.

    ``dataset`` names a deployment, for sources of recordings. ``server`` replaces the source's own, for mirrors.
    """

    source: public.PublicSource
    box: public.Box
    period: public.Period | None = None
    stride: int = 1
    dataset: str = ""
    server: str = ""

    @property
    def base(self) -> str:
        """Address of the server."""
        return (self.server or self.source.server).rstrip("/")

    @property
    def identity(self) -> dict[str, Any]:
        """What distinguishes the file from any other."""
        return {
            "source": self.source.name, "server": self.base, "dataset": self.dataset or self.source.dataset,
            "variables": [*self.source.variables, *self.source.optional], "box": [round(v, 6) for v in self.box],
            "period": None if self.period is None else [round(v) for v in self.period], "stride": self.stride,
        }  # fmt: skip

    @property
    def file_name(self) -> str:
        """Name in the cache: the source, and a digest of what was asked."""
        digest = hashlib.sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()[:12]
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", self.dataset).strip("-")[:40]
        return f"{self.source.name}{'-' + plain if plain else ''}-{digest}.nc"


@dataclass(frozen=True)
class Fetched:
    """A file at hand: where, its SHA-256, and whether the network was asked. ``url`` is what it came from."""

    path: Path
    sha256: str
    url: str
    cached: bool
    notes: tuple[str, ...] = field(default=())


def cache_folder() -> Path:
    """Where public data are kept: ``GLIDER_JAX_CACHE``, else the user's cache folder."""
    base = os.environ.get("GLIDER_JAX_CACHE") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "glider_jax" / "public"


def check(wanted: Wanted) -> None:
    """Refuse boxes and periods that cannot be.

    Raises
    ------
    ConfigError : with the option to change.
    """
    south, north, west, east = wanted.box
    if not (-90.0 <= south < north <= 90.0 and -360.0 <= west < east <= 360.0 and east - west <= 360.0):
        raise ConfigError(
            f"--box: expected SOUTH NORTH WEST EAST in degrees, ascending, found {south:g} {north:g} {west:g} {east:g}."
        )
    if wanted.period is not None and not wanted.period[0] < wanted.period[1]:
        raise ConfigError("--days: expected more than 0. Give the days to fetch.")
    if wanted.source.timed and wanted.period is None:
        raise ConfigError(
            f"{wanted.source.name}: expected a period, found none. Give --start and --days, or --mission."
        )
    if wanted.stride < 1:
        raise ConfigError(f"--stride: expected at least 1, found {wanted.stride}.")
    if urlsplit(wanted.base).scheme not in ("http", "https"):
        raise ConfigError(f"--server: expected an address that begins with http or https, found '{wanted.base}'.")


def fetch(
    wanted: Wanted, *, folder: Path | None = None, again: bool = False, progress: Callable[[int], None] | None = None
) -> Fetched:
    """Fetch a box of a source into the cache, or find it there.

    Parameters
    ----------
    folder : of the cache; the user's if None.
    again : fetch even if it is in the cache.
    progress : called with the number of bytes so far.

    Raises
    ------
    GliderJaxError : the request is wrong, the data set does not cover it, or the server cannot be reached.
    """
    check(wanted)
    path = (folder or cache_folder()) / wanted.file_name
    notes: list[str] = []
    if not again:
        found = _held(path, notes)
        if found is not None:
            return found
    url = request_url(wanted)
    digest, size = download(url, path, progress)
    told = wanted.identity | {
        "url": url, "sha256": digest, "bytes": size, "fetched": public.iso(time.time()), "credit": wanted.source.credit,
    }  # fmt: skip
    write_text(_beside(path), json.dumps(told, indent=1, sort_keys=True) + "\n")
    return Fetched(path, digest, url, False, tuple(notes))


def request_url(wanted: Wanted) -> str:
    """The address that answers with the file; ERDDAP is asked first what its data set holds."""
    source, base = wanted.source, wanted.base
    if source.protocol == "ncss":
        return public.ncss_url(source, base, wanted.box, wanted.period, wanted.stride)
    if source.protocol == "tabledap":
        from dataclasses import replace

        named = replace(source, dataset=wanted.dataset)
        described = public.info_url(named, base)
        info = public.parse_info(read_text(described), described)
        return public.tabledap_url(named, base, wanted.dataset, info, wanted.period)
    described = public.info_url(source, base)
    info = public.parse_info(read_text(described), described)
    return public.griddap_url(source, base, info, wanted.box, wanted.period, wanted.stride)


def deployments(wanted: Wanted) -> list[dict[str, str]]:
    """Deployments of gliders that touch the box and period, newest first."""
    check(wanted)
    text = read_text(public.deployments_url(wanted.source, wanted.base, wanted.box, wanted.period), none_is_empty=True)
    return [dict(row) for row in public.parse_deployments(text)]


def held(folder: Path | None = None) -> list[dict[str, Any]]:
    """What the cache holds, newest first; files without a readable note beside them are left out."""
    found = []
    for note in sorted((folder or cache_folder()).glob("*.nc.json")):
        try:
            told = json.loads(note.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(told, dict) and note.with_suffix("").is_file():
            found.append(told | {"path": str(note.with_suffix(""))})
    return sorted(found, key=lambda told: str(told.get("fetched", "")), reverse=True)


def copy(found: Fetched, target: Path) -> Path:
    """Copy a fetched file to a name of the user's, whole or not at all."""
    with atomic_path(target) as temporary:
        shutil.copyfile(found.path, temporary)
    return target


def _beside(path: Path) -> Path:
    return path.with_name(path.name + ".json")


def _held(path: Path, notes: list[str]) -> Fetched | None:
    """The file in the cache if it is whole."""
    note = _beside(path)
    if not (path.is_file() and note.is_file()):
        return None
    try:
        told = json.loads(note.read_text(encoding="utf-8"))
        wanted, url = str(told["sha256"]), str(told["url"])
    except (OSError, ValueError, KeyError, TypeError):
        notes.append(f"{note.name}: not readable; fetched again")
        return None
    if Source.digest(path) != wanted:
        notes.append(f"{path.name}: was changed since it was fetched; fetched again")
        return None
    return Fetched(path, wanted, url, True)


def download(url: str, path: Path, progress: Callable[[int], None] | None = None) -> tuple[str, int]:
    """Write what an address answers under ``path``, whole or not at all; return SHA-256 and bytes.

    Raises
    ------
    DataError : the server cannot be reached, refuses, stops early, sends too much, or sends something else.
    """
    with _open(url) as answer, atomic_path(path) as temporary:
        announced = answer.headers.get("Content-Length")
        if announced and announced.isdigit() and int(announced) > LARGEST:
            raise DataError(f"{_host(url)}: expected at most 2 GB, found {int(announced) / 1e9:.1f} GB. Ask for less.")
        sha, size, first = hashlib.sha256(), 0, b""
        with open(temporary, "wb") as stream:
            for block in _blocks(answer, url):
                first = first or block[:300]
                size += len(block)
                if size > LARGEST:
                    raise DataError(f"{_host(url)}: expected at most 2 GB, found more. Ask for a smaller box or time.")
                sha.update(block)
                stream.write(block)
                if progress is not None:
                    progress(size)
        if not first.startswith(_MAGIC):
            raise DataError(
                f"{_host(url)}: expected a netCDF file, found: {one_line(first.decode('utf-8', 'replace'), 200)!r}. "
                "Try later, or another source."
            )
        if announced and announced.isdigit() and size != int(announced):
            raise DataError(f"{_host(url)}: expected {announced} bytes, found {size}: the answer was cut. Try again.")
    return sha.hexdigest(), size


def read_text(url: str, *, none_is_empty: bool = False) -> str:
    """What an address answers, as text of at most 20 MB; ``none_is_empty`` takes "no such rows" as no text."""
    try:
        with _open(url) as answer:
            return b"".join(_blocks(answer, url, 20_000_000)).decode("utf-8", "replace")
    except NothingThere:
        if none_is_empty:
            return ""
        raise


class NothingThere(DataError):
    """The server knows no data for what was asked."""


def _blocks(answer: BinaryIO, url: str, most: int | None = None):
    size = 0
    try:
        while block := answer.read(1 << 18):
            size += len(block)
            if most is not None and size > most:
                raise DataError(f"{_host(url)}: expected at most {most / 1e6:.0f} MB, found more. Check --server.")
            yield block
    except (OSError, HTTPException) as error:
        raise DataError(
            f"{_host(url)}: expected an answer of some length, found it cut after {size} bytes ({error}). Try again."
        ) from error


def _open(url: str):
    """The answer of a server, asked again after a moment where it was busy."""
    for tried in range(_TRIES):
        try:
            return urlopen(Request(url, headers=_AGENT), timeout=_TIMEOUT)
        except HTTPError as error:
            if error.code in _AGAIN and tried + 1 < _TRIES:
                time.sleep(_PAUSE * 2**tried)
                continue
            said = one_line(error.read(2000).decode("utf-8", "replace"), 300)
            kind = NothingThere if error.code == 404 else DataError
            raise kind(
                f"{_host(url)}: expected data, found HTTP status {error.code}: {said or error.reason}. "
                "Check box, period and data set; the server may also have renamed it."
            ) from error
        except URLError as error:
            if _offline(error.reason) or tried + 1 == _TRIES:
                raise DataError(
                    f"{_host(url)}: expected a connection, found none ({one_line(error.reason, 200)}). Connect to the "
                    "network, or use files you have; 'glider-forecast data list' shows what was fetched before."
                ) from error
            time.sleep(_PAUSE * 2**tried)
        except (TimeoutError, HTTPException) as error:
            if tried + 1 == _TRIES:
                raise DataError(f"{_host(url)}: expected an answer, found none ({error}). Try later.") from error
            time.sleep(_PAUSE * 2**tried)
    raise DataError(f"{_host(url)}: expected an answer, found none. Try later.")


def _offline(reason: object) -> bool:
    """Whether asking again is of no use: no name, no way, nobody there."""
    return isinstance(reason, socket.gaierror | ConnectionRefusedError) or "unreachable" in str(reason).lower()


def _host(url: str) -> str:
    return urlsplit(url).netloc or url
