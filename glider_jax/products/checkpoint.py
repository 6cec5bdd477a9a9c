"""What an interrupted forecast needs to go on: how far it came, and everything it had gathered by then.

A checkpoint lies beside the products as ``forecast.checkpoint``, written whole or not at all after a chunk of members,
never within one. It belongs to one question: a run with other inputs, options or code does not take it up.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from glider_jax.errors import DataError
from glider_jax.products.atomic import atomic_path

NAME = "forecast.checkpoint"


class Checkpoint:
    """The checkpoint of a folder for one question, given by its text."""

    def __init__(self, folder: Path, question: str) -> None:
        self.path = folder / NAME
        self.question = hashlib.sha256(question.encode()).hexdigest()

    def save(self, **state: Any) -> None:
        """Keep a state; the one before is replaced."""
        with atomic_path(self.path) as temporary:
            temporary.write_bytes(pickle.dumps((self.question, state), protocol=pickle.HIGHEST_PROTOCOL))

    def load(self) -> dict[str, Any] | None:
        """The state kept, or None where there is none.

        Raises
        ------
        DataError : it belongs to another question, cannot be read, or is another user's.
        """
        if not self.path.exists():
            return None
        what = "Leave out --resume to start anew."
        if hasattr(os, "getuid") and self.path.stat().st_uid != os.getuid():
            raise DataError(f"{self.path}: expected a checkpoint of your own, found another user's. {what}")
        try:
            question, state = pickle.loads(self.path.read_bytes())
        except (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError, ImportError,
                pickle.UnpicklingError) as error:  # fmt: skip
            raise DataError(f"{self.path}: expected a checkpoint, found a file that cannot be read. {what}") from error
        if question != self.question:
            raise DataError(
                f"{self.path}: expected a checkpoint of this forecast, found one made with other inputs, options or "
                f"code. {what}"
            )
        return state

    def remove(self) -> None:
        """Forget it: the forecast is finished, or starts anew."""
        self.path.unlink(missing_ok=True)


@contextmanager
def undivided() -> Iterator[None]:
    """Hold back Ctrl-C and SIGTERM while the block runs; they are delivered when it ends.

    Outside the main thread, where Python delivers no signals, it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    before = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, lambda n, frame: waiting.append(n))
    try:
        yield
    finally:
        for number, handler in before.items():
            # A handler that was not set from Python comes back as None.
            with suppress(TypeError):
                signal.signal(number, handler)
    if waiting:
        signal.raise_signal(waiting[0])
