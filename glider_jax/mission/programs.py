"""Compiled programs that outlive the process: traced and compiled once per machine, then read from the cache folder.

JAX's own cache spares the compiler but not the tracing, which is most of a warm start. A program is kept under a name
made of everything that decides what it is: the source of this package, the versions of what it stands on, the
processor, the devices, and the shapes and types of its arguments. A file that cannot be read is compiled anew.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache
from jax.experimental.serialize_executable import deserialize_and_load, serialize

_LAYERS = ("environment", "inference", "mission", "physics")
#: How many programs are kept; each is about a megabyte.
KEPT = 40
#: What reading a damaged or foreign file can raise; pickle promises no list.
_UNREADABLE = (
    OSError, EOFError, LookupError, ValueError, TypeError, AttributeError, ImportError, RuntimeError, MemoryError,
    pickle.UnpicklingError,
)  # fmt: skip
_known: dict[str, tuple[Any, Any]] = {}


def call(name: str, function: Callable, static: Any, devices: tuple, *arguments):
    """``function(static, *arguments)`` by a compiled program, kept on disk where JAX's compilation cache is set.

    Parameters
    ----------
    name : of the program.  static : hashable, whose text decides what is compiled.
    devices : the devices it runs on.
    arguments : pytrees of arrays.

    Returns
    -------
    What the function returns, arrays on the devices.
    """
    leaves, tree = jax.tree.flatten(arguments)
    leaves = [leaf if isinstance(leaf, jax.Array) else np.asarray(leaf) for leaf in leaves]
    shapes = tuple((leaf.shape, str(leaf.dtype), bool(getattr(leaf, "weak_type", False))) for leaf in leaves)
    key = _name(name, static, devices, shapes, str(tree))
    if key not in _known:
        found = _load(key, len(leaves), devices)
        if found is not None:
            try:
                # Waited for: what fails on the device says so only when it is asked for.
                result = jax.block_until_ready(found[0](*leaves))
            except RuntimeError:
                # What was read does not run here, whatever the reason: it is made anew.
                found = None
            else:
                _known[key] = found
                return jax.tree.unflatten(jax.tree.structure(found[1]), result)
        _known[key] = _compile(key, function, static, tree, leaves)
    compiled, outside = _known[key]
    return jax.tree.unflatten(jax.tree.structure(outside), compiled(*leaves))


def _compile(key: str, function: Callable, static: Any, tree, leaves):
    """Trace and compile, and keep the program if a folder is set."""
    outside: list[Any] = []

    def flat(*values):
        result = function(static, *jax.tree.unflatten(tree, values))
        found, structure = jax.tree.flatten(result)
        outside.append(jax.tree.unflatten(structure, list(range(len(found)))))
        return found

    wide = {"xla_cpu_prefer_vector_width": "512"} if jax.default_backend() == "cpu" else {}
    lowered = jax.jit(flat).lower(*leaves)
    # A program that JAX's own cache gave back cannot be written again whole, so it is not asked.
    cached = jax.config.jax_enable_compilation_cache
    _use_cache_of_jax(cached and _folder() is None)
    try:
        compiled = lowered.compile(compiler_options=wide)
    finally:
        _use_cache_of_jax(cached)
    _save(key, compiled, outside[-1])
    return compiled, outside[-1]


def _use_cache_of_jax(wanted: bool) -> None:
    """Switch JAX's compilation cache; it remembers what it was at the first compilation until it is reset."""
    jax.config.update("jax_enable_compilation_cache", wanted)
    compilation_cache.reset_cache()


def _folder() -> Path | None:
    folder = jax.config.jax_compilation_cache_dir
    # A program of several processes cannot be read back by one.
    return Path(folder) / "programs" if folder and jax.process_count() == 1 else None


def _save(key: str, compiled, outside) -> None:
    """Write a program atomically and drop the oldest beyond the number kept; a full disk costs only the time."""
    folder = _folder()
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = folder / f"{key}.{os.getpid()}"
        temporary.write_bytes(pickle.dumps((serialize(compiled)[0], outside)))
        temporary.replace(folder / f"{key}.program")
        for old in sorted(folder.glob("*.program"), key=lambda p: p.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)
    except (OSError, ValueError, pickle.PicklingError):
        return


def _load(key: str, count: int, devices: tuple):
    """A kept program and the shape of what it returns, or None."""
    folder = _folder()
    if folder is None:
        return None
    try:
        payload, outside = pickle.loads((folder / f"{key}.program").read_bytes())
        inside = jax.tree.structure((tuple(range(count)), {}))
        found = jax.tree.structure(list(jax.tree.leaves(outside)))
        return deserialize_and_load(payload, inside, found, execution_devices=list(devices)), outside
    except _UNREADABLE:
        return None


def _name(*parts) -> str:
    text = "\n".join(map(str, (surroundings(), *parts)))
    return hashlib.sha256(text.encode()).hexdigest()[:40]


@cache
def surroundings() -> str:
    """Source, versions, processor and switches that a compiled program depends on."""
    digest = hashlib.sha256()
    root = Path(__file__).parent.parent
    for path in sorted([*root.glob("*.py"), *(p for layer in _LAYERS for p in (root / layer).rglob("*.py"))]):
        digest.update(path.read_bytes())
    versions = {name: version(name) for name in ("jax", "jaxlib", "numpy", "equinox")}
    cpu = Path("/proc/cpuinfo")
    model = ""
    if cpu.exists():
        lines = cpu.read_text(errors="replace").splitlines()
        model = str(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
    switches = (jax.config.jax_enable_x64, os.environ.get("XLA_FLAGS", ""))
    return repr((digest.hexdigest(), versions, platform.platform(), model, switches))
