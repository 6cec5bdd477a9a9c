"""Whether the installation is whole: packages, devices, the cache of compiled programs, extras, bundled files.

Each check says what it found and, where something is wrong, what to do. JAX is loaded only by the check of devices.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from glider_jax import __version__
from glider_jax.errors import GliderJaxError
from glider_jax.records import Source

DISTRIBUTION = "glider-jax"
#: Extra, module, and what it is for.
EXTRAS = (
    ("dbd", "dbdreader", "Slocum binary files (sbd, dbd and the like)"),
    ("browser", "selenium", "tests of the pages in a browser"),
    ("test", "pytest", "the tests"),
)
_LEAST_FREE = 500e6
_OLDEST = (3, 11)


@dataclass(frozen=True)
class Check:
    """One thing looked at: ``ok`` is None for what is only told. ``todo`` says how to mend what is wrong."""

    name: str
    ok: bool | None
    found: str
    todo: str = ""


def check_installation(cache: Path, requires: list[str] | None = None) -> Iterator[Check]:
    """Look at everything, one after the other.

    Parameters
    ----------
    cache : folder of compiled programs.
    requires : requirements as the installed package states them; read from it if None.
    """
    yield check_python()
    yield from check_packages(requires)
    yield from check_devices()
    yield check_cache(cache)
    yield from check_extras()
    yield from check_bundled()
    yield check_output()


def check_python() -> Check:
    """The interpreter's version."""
    version = sys.version_info[:3]
    text = f"{'.'.join(map(str, version))} at {sys.executable}"
    return Check("python", version >= _OLDEST, text, "Install Python 3.11 or later and make a new environment.")


def check_packages(requires: list[str] | None = None) -> Iterator[Check]:
    """The package itself and what it needs."""
    try:
        installed = metadata.version(DISTRIBUTION)
        requires = metadata.requires(DISTRIBUTION) or [] if requires is None else requires
    except metadata.PackageNotFoundError:
        yield Check("glider_jax", False, f"{__version__}, not installed as a package", "Install it with: pip install .")
        return
    same = installed == __version__
    yield Check("glider_jax", same, f"{installed}" if same else f"{installed} installed, {__version__} running",
                "Install it again with: pip install --force-reinstall .")  # fmt: skip
    for line in requires:
        if "extra ==" in line:
            continue
        name, least = requirement(line)
        try:
            found = metadata.version(name)
        except metadata.PackageNotFoundError:
            yield Check(name, False, "not installed", f'Install it with: pip install "{name}"')
            continue
        good = not least or numbers(found) >= numbers(least)
        yield Check(name, good, found, f'Expected {least} or later: pip install --upgrade "{name}>={least}"')


def requirement(line: str) -> tuple[str, str]:
    """Name and least version of a requirement such as ``numpy>=2.0``.

    Examples
    --------
    >>> requirement("numpy>=2.0")
    ('numpy', '2.0')
    """
    name = re.match(r"[A-Za-z0-9_.-]+", line).group(0)
    least = re.search(r">=\s*([0-9][0-9.]*)", line)
    return name, least.group(1) if least else ""


def numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version, for comparing."""
    return tuple(int(part) for part in re.findall(r"\d+", version.split("+")[0])[:3])


def check_devices() -> Iterator[Check]:
    """Whether JAX starts, on which devices, and whether it computes rightly."""
    begin = time.perf_counter()
    try:
        import jax
        import jax.numpy as jnp

        devices = jax.devices()
        value = float(jax.jit(lambda x: jnp.sum(x * x))(jnp.arange(4.0)))
    except (ImportError, RuntimeError, OSError, AttributeError) as error:
        todo = "Set JAX_PLATFORMS=cpu, or install it again with: pip install --force-reinstall jax jaxlib."
        yield Check("jax", False, f"does not start: {_short(error)}", todo)
        return
    kinds = sorted({f"{d.platform} ({d.device_kind})" for d in devices})
    yield Check("devices", True, f"{len(devices)} x {', '.join(kinds)}; {len(os.sched_getaffinity(0))} CPU cores")
    todo = "The device computes wrongly: set JAX_PLATFORMS=cpu and report this."
    took = time.perf_counter() - begin
    yield Check("arithmetic", value == 14.0, f"0+1+4+9 is {value:g}, first program after {took:.1f} s", todo)


def check_cache(folder: Path) -> Check:
    """Whether compiled programs can be kept, and how many are."""
    name = "compilation cache"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe-{os.getpid()}"
        probe.write_bytes(b"x")
        probe.unlink()
        sizes = [entry.stat().st_size for entry in folder.rglob("*") if entry.is_file()]
        free = shutil.disk_usage(folder).free
    except OSError as error:
        todo = "Every run compiles anew. Make the folder writable, or set GLIDER_JAX_CACHE to one that is."
        return Check(name, False, f"{folder}: {error.strerror or error}", todo)
    found = f"{folder}: {len(sizes)} files, {sum(sizes) / 1e6:.1f} MB, {free / 1e9:.1f} GB free"
    return Check(name, free >= _LEAST_FREE, found, "Free some disk space, or set GLIDER_JAX_CACHE to another disk.")


def check_extras() -> Iterator[Check]:
    """Optional packages: those that are here load, those that are not are told with what they are for."""
    for extra, module, purpose in EXTRAS:
        install = f'pip install "{DISTRIBUTION}[{extra}]"'
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] == module:
                yield Check(f"extra {extra}", None, f"not installed; for {purpose}: {install}")
                continue
            yield Check(f"extra {extra}", False, f"{module} needs {error.name}", f"Install it with: {install}")
        except (ImportError, OSError) as error:
            todo = f"Install it again with: {install} --force-reinstall"
            yield Check(f"extra {extra}", False, f"{module} does not load: {_short(error)}", todo)
        else:
            yield Check(f"extra {extra}", True, f"{module} loads; for {purpose}")


def check_bundled(find: Callable[[str], Path] | None = None) -> Iterator[Check]:
    """Whether the bundled files are what they were when the package was made."""
    import glider_jax_data

    find = find or glider_jax_data.path
    todo = "The installation is damaged: install the package again."
    try:
        listed = glider_jax_data.manifest()["files"]
    except (GliderJaxError, OSError, ValueError, KeyError) as error:
        yield Check("bundled data", False, _short(error), todo)
        return
    wrong = []
    for name, entry in sorted(listed.items()):
        try:
            if Source.digest(find(name)) != entry["sha256"]:
                wrong.append(f"{name} was changed")
        except (GliderJaxError, OSError):
            wrong.append(f"{name} is missing")
    found = "; ".join(wrong) or f"{len(listed)} files as released"
    yield Check("bundled data", not wrong, found, todo)
    yield check_presets(todo)


def check_presets(todo: str) -> Check:
    """Whether the bundled vehicles and mission can be read and the parts of pages are there."""
    from glider_jax.products.html.page import ASSETS, asset
    from glider_jax.readers.missions import read_mission
    from glider_jax.readers.vehicles import presets, read_vehicle
    from glider_jax_data import path

    try:
        names = [read_vehicle(name).name for name in presets()]
        read_mission(path("missions/new_jersey.toml"))
        parts = [asset(name) for name in ASSETS]
    except (GliderJaxError, OSError) as error:
        return Check("presets", False, _short(error), todo)
    return Check("presets", True, f"{len(names)} vehicles, 1 mission, {len(parts)} parts of pages")


def check_output() -> Check:
    """Whether the terminal can show the signs that places are written with."""
    encoding = sys.stdout.encoding or "ascii"
    try:
        "°′km²".encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return Check("output", False, f"encoding {encoding} has no degree sign", "Set PYTHONIOENCODING=utf-8.")
    return Check("output", True, f"encoding {encoding}")


def _short(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 200 else text[:199] + "…"
