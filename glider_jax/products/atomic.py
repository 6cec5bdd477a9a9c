"""Files appear under their final name whole or not at all.

Every writer of this package goes through :func:`atomic_path`. A forecast that is interrupted leaves either nothing
or, where a part is of use, a file whose name says ``.partial`` (see ``products.netcdf``).
"""

from __future__ import annotations

import os
import secrets
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from glider_jax.errors import DataError


class Terminated(SystemExit):
    """Raised in the main thread when the process is asked to stop, so that open files are closed properly."""


def check_folder(final: Path) -> None:
    """Make the folder of a product, or say in one sentence why it cannot be had."""
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(
            f"{final}: expected a folder '{final.parent}' that can be written to, found: {error.strerror}. "
            "Choose another --out."
        ) from error
    if final.is_dir():
        raise DataError(f"{final}: expected the name of a file, found a folder. Choose another --out.")


@contextmanager
def atomic_path(final: str | Path) -> Iterator[Path]:
    """Give the name of a temporary sibling that becomes ``final`` when the block ends well.

    The sibling has the same suffix, is synchronised to disk and then renamed over ``final``. If the block is left by
    an exception of any kind, an interrupt from the keyboard included, the sibling is removed and ``final`` stays as
    it was.

    Parameters
    ----------
    final : the name that the file shall have; its folder is made if need be.

    Raises
    ------
    DataError : the folder cannot be made or written to, or ``final`` is a folder.
    """
    final = Path(final)
    check_folder(final)
    temporary = final.with_name(f".{final.stem}-{os.getpid()}-{secrets.token_hex(4)}{final.suffix}")
    try:
        yield temporary
        with open(temporary, "rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, final)
    except OSError as error:
        raise DataError(
            f"{final}: expected a file that can be written, found: {error.strerror or error}. "
            "Free some space or choose another --out."
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(final: str | Path, text: str) -> Path:
    """Write UTF-8 text under ``final``, whole or not at all."""
    with atomic_path(final) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(final)


@contextmanager
def termination_raises() -> Iterator[None]:
    """Turn the signal SIGTERM into :class:`Terminated` (exit code 143) while the block runs.

    Outside the main thread, where Python delivers no signals, it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Terminated(128 + number)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
