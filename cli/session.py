"""What commands that fly share: the compilation cache, the number of host devices, and the progress bar."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def cache_folder() -> Path:
    """Where compiled programs are kept: ``GLIDER_JAX_CACHE``, else the user's cache folder."""
    base = os.environ.get("GLIDER_JAX_CACHE") or os.environ.get("XDG_CACHE_HOME")
    if base is None:
        base = str(Path.home() / ".cache")
    return Path(base) / "glider_jax"


#: Compile every loop as one function, whatever its size: XLA otherwise calls a kernel for every array of the step,
#: which takes twice the time of a flight.
_ONE_LOOP = "xla_cpu_small_while_loop_byte_threshold"


def compiled_cache(*, flying: bool = True) -> None:
    """Let JAX keep compiled programs between runs and use every core as a device of its own.

    Must come before the first use of JAX. An XLA device count set by the user stands, and so do other options of XLA.

    Parameters
    ----------
    flying : compile loops whole, which suits the mission step; a loop over matrices is better without.
    """
    import jax

    given = os.environ.get("XLA_FLAGS", "")
    if flying and "xla_backend_extra_options" not in given:
        os.environ["XLA_FLAGS"] = f"{given} --xla_backend_extra_options={_ONE_LOOP}={10**15}".strip()

    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    except OSError as error:
        print(f"note: compiled programs are not kept ({error.strerror})", file=sys.stderr)
    if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
        # Where the process has used JAX before, its devices stay: results do not depend on their number.
        with suppress(RuntimeError):
            own = os.environ.get("GLIDER_JAX_DEVICES")
            jax.config.update("jax_num_cpu_devices", int(own) if own else max(1, len(os.sched_getaffinity(0))))


@contextmanager
def progress_bar(what: str, total: int) -> Iterator[Callable[[int], None] | None]:
    """A bar on standard error while a terminal watches, else nothing."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)
