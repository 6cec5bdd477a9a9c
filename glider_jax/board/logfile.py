"""Files that survive a crash: a log that grows, is flushed, and appears under its final name only when
complete.

While a file grows it is called ``NAME.part``; every byte is handed to the operating system at once, so
that killing this
process loses none, and is forced to the disk once a second, so that a power cut loses at most that.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from glider_jax.errors import CaptureError


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _told(place: Path) -> Iterator[None]:
    """Say where and why a file cannot be written: a full disk must not be taken for a lost port."""
    try:
        yield
    except OSError as error:
        raise CaptureError(
            f"{place}: expected to write here, found: {error.strerror}. What was written before is intact; make room, "
            "or choose another folder with --out."
        ) from None


def utc_name(utc: float) -> str:
    """A time as it is used in file names: ``20240131T235959Z``."""
    return time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(utc))


class Journal:
    """One JSON object per line for everything that happened to a capture; each line is on disk when
    ``note`` returns."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with _told(path):
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def note(self, event: str, **details: Any) -> None:
        """Append an event with the present UTC."""
        line = json.dumps({"utc": round(time.time(), 3), "event": event, **details}, default=str) + "\n"
        with _told(self._path):
            os.write(self._descriptor, line.encode())
            os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def read_journal(folder: str | Path) -> list[dict[str, Any]]:
    """Events of a capture folder, oldest first; a line cut short by a crash is left out."""
    path = Path(folder) / "capture.jsonl"
    out = []
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                out.append(json.loads(line))
            except json.JSONDecodeError:
                continue
    return out


@dataclass
class Folder:
    """A capture folder held by one process; the lock goes away with the process, however it ends."""

    path: Path

    def __post_init__(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self.path / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise CaptureError(
                f"{self.path}: expected a folder to write to, found: {error.strerror}. Choose another with --out."
            ) from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise CaptureError(
                f"{self.path}: another capture is writing here. Stop it, or choose another folder with --out."
            ) from None

    def recover(self) -> list[str]:
        """Give files that a killed capture left behind their final names; returns the names."""
        names = []
        for part in sorted(self.path.glob("*.part")):
            final = part.with_suffix("")
            part.rename(final)
            names.append(final.name)
        if names:
            _sync_folder(self.path)
        return names

    def close(self) -> None:
        """Release the lock."""
        os.close(self._lock)


class RotatingLog:
    """Append bytes to a series of log files, each with a small table of arrival times beside it.

    The table ``NAME.times`` has one line per second: byte offset, UTC in ns, monotonic clock in ns, by
    which samples can
    be placed in time when the board itself knows no UTC.
    """

    def __init__(self, folder: Path, prefix: str = "board", sync_s: float = 1.0) -> None:
        self._folder, self._prefix, self._sync_s = folder, prefix, sync_s
        self._log = self._times = -1
        self._name = ""
        self._number = 0
        self._synced = self._stamped = 0.0
        self.size = 0
        self.opened = 0.0

    def write(self, data: bytes) -> None:
        """Append; opens a file if none is open.

        Raises
        ------
        CaptureError : the disk is full or gone.
        """
        if not data:
            return
        with _told(self._folder):
            fresh = self._log < 0
            if fresh:
                self._open(time.time())
            monotonic = time.monotonic()
            if monotonic - self._stamped >= 1.0:
                line = f"{self.size} {time.time_ns()} {time.monotonic_ns()}\n"
                os.write(self._times, line.encode())
                self._stamped = monotonic
            view = memoryview(data)
            while view:
                written = os.write(self._log, view)
                self.size += written
                view = view[written:]
            if monotonic - self._synced >= self._sync_s:
                os.fsync(self._log)
                self._synced = monotonic
            if fresh:
                _sync_folder(self._folder)

    def rotate(self, tail: bytes = b"") -> str | None:
        """Complete the present file; returns its name, or None if none was open.

        Parameters
        ----------
        tail : the last bytes written, which belong in the next file. They are in one of the two at any time, for a
            moment in both.
        """
        if self._log < 0:
            return None
        log, times, name, size = self._log, self._times, self._name, self.size
        self._log = self._times = -1
        self.size = 0
        self.write(tail)
        with _told(self._folder):
            if tail:
                os.ftruncate(log, size - len(tail))
            for descriptor in (log, times):
                os.fsync(descriptor)
                os.close(descriptor)
            for suffix in (".bin", ".times"):
                (self._folder / f"{name}{suffix}.part").rename(self._folder / f"{name}{suffix}")
            _sync_folder(self._folder)
        return f"{name}.bin"

    def _open(self, now: float) -> None:
        stamp = utc_name(now)
        while True:
            self._number += 1
            self._name = f"{self._prefix}-{stamp}-{self._number:04d}"
            paths = [
                self._folder / f"{self._name}{s}" for s in (".bin", ".times", ".bin.part", ".times.part")
            ]
            if not any(path.exists() for path in paths):
                break
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
        self._log = os.open(self._folder / f"{self._name}.bin.part", flags, 0o644)
        self._times = os.open(self._folder / f"{self._name}.times.part", flags, 0o644)
        self.size, self._stamped, self.opened = 0, 0.0, now
