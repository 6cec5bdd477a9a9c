"""Record a board from a serial port or TCP socket for weeks, and lose nothing that was received.

Bytes are written to the log before anything else is done with them; decoding happens on a copy, for the
display.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.board.calibration import Calibration, nominal
from glider_jax.board.decoder import Batch, Decoder, Report
from glider_jax.board.frames import BAUD
from glider_jax.board.logfile import Folder, Journal, RotatingLog
from glider_jax.board.port import Port, open_port
from glider_jax.errors import CaptureError, DataError

_LAST_READS = 0.5


@dataclass(frozen=True)
class Options:
    """How to capture.

    Attributes
    ----------
    port : device such as ``/dev/ttyUSB0`` or ``COM3``, or ``socket://HOST:PORT``.
    folder : where the logs go.
    baud : line rate.
    revision : 1 or 2, None to recognise it.
    rotate_bytes, rotate_s : complete a file when it is this large or old; both at a frame boundary.
    identify_s : if bytes come for this long and none of them form a frame, stop with an error; 0 never.
    retry_s : pause between attempts to reopen a port that went away.
    duration_s : stop after this long; None runs until interrupted.
    sync_s : force the log to disk this often.
    """

    port: str
    folder: Path
    baud: int = BAUD
    revision: int | None = None
    rotate_bytes: int = 64 << 20
    rotate_s: float = 86_400.0
    identify_s: float = 5.0
    retry_s: float = 0.5
    duration_s: float | None = None
    sync_s: float = 1.0


@dataclass
class Status:
    """What the display shows, once a second.

    ``currents`` A are means over the last second by channel, ``bytes_per_second`` and
    ``frames_per_second`` are rates over
    it; ``connected`` tells whether the port is open now.
    """

    elapsed: float = 0.0
    connected: bool = False
    received: int = 0
    bytes_per_second: float = 0.0
    frames_per_second: float = 0.0
    outages: int = 0
    clock_steps: int = 0
    report: Report = field(default_factory=Report)
    currents: dict[str, float] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)
    message: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "elapsed_s": round(self.elapsed, 3),
            "bytes_received": self.received,
            "outages": self.outages,
            "host_clock_steps": self.clock_steps,
            "files": list(self.files),
            **self.report.as_dict(),
        }


class Capture:
    """One capture from start to end; :meth:`run` returns the final status.

    Parameters
    ----------
    options : how to capture.
    calibration : for the currents of the display.
    on_status : called about once a second.
    """

    def __init__(
        self,
        options: Options,
        calibration: Calibration | None = None,
        on_status: Callable[[Status], None] | None = None,
    ) -> None:
        self.options = options
        self.calibration = calibration or nominal()
        self.on_status = on_status
        self.stop = threading.Event()
        self.status = Status()
        self._decoder = Decoder(options.revision, options.port)
        self._second: list[Batch] = []
        self._begin = 0.0

    def run(self) -> Status:
        """Capture until interrupted, stopped or timed out.

        Raises
        ------
        CaptureError : the port cannot be opened at the start, the folder is in use, or the disk is full.
        DataError : what arrives is not from a board; the bytes are kept all the same.
        """
        options = self.options
        folder = Folder(options.folder)
        handlers = self._take_signals()
        journal = Journal(options.folder / "capture.jsonl")
        log = RotatingLog(options.folder, sync_s=options.sync_s)
        port = None
        try:
            for name in folder.recover():
                journal.note("recovered", file=name)
            port = open_port(options.port, options.baud)
            journal.note("opened", port=options.port, baud=options.baud)
            self.status.connected = True
            self._loop(port, log, journal)
        finally:
            try:
                self._finish(log, journal)
            finally:
                journal.close()
                folder.close()
                for number, handler in handlers.items():
                    signal.signal(number, handler)
        return self.status

    def _finish(self, log: RotatingLog, journal: Journal) -> None:
        name = log.rotate()
        if name:
            self.status.files.append(name)
        self._second.append(self._decoder.feed(b"", final=True))
        self.status.report = self._decoder.report
        journal.note("stopped", **self.status.as_dict())

    def _take_signals(self) -> dict[int, Any]:
        """Let SIGINT and SIGTERM end the capture in order; only the main thread may ask for them."""
        if threading.current_thread() is not threading.main_thread():
            return {}
        return {
            number: signal.signal(number, lambda *_: self.stop.set())
            for number in (signal.SIGINT, signal.SIGTERM)
        }

    def _loop(self, port: Port | None, log: RotatingLog, journal: Journal) -> None:
        options, status = self.options, self.status
        begin = told = self._begin = time.monotonic()
        offset = time.time() - begin
        last_bytes = last_frames = 0
        first_byte: float | None = None
        while not self.stop.is_set():
            now = time.monotonic()
            status.elapsed = now - begin
            if options.duration_s is not None and status.elapsed >= options.duration_s:
                break
            port = self._receive(port, log, journal)
            if status.received and first_byte is None:
                first_byte = now
            judged = (
                options.identify_s > 0 and first_byte is not None and now - first_byte > options.identify_s
            )
            if judged and self._decoder.report.frames == 0:
                self._explain()
            shift = time.time() - time.monotonic() - offset
            if abs(shift) > 0.5:
                status.clock_steps += 1
                offset += shift
                journal.note("host clock step", seconds=round(shift, 3))
            if now - told >= 1.0:
                report = self._decoder.report
                status.bytes_per_second = (status.received - last_bytes) / (now - told)
                status.frames_per_second = (report.frames - last_frames) / (now - told)
                last_bytes, last_frames, told = status.received, report.frames, now
                status.report = report
                status.currents = self._means()
                if self.on_status:
                    self.on_status(status)
        if port is not None:
            self._read_rest(port, log, journal)
            port.close()

    def _read_rest(self, port: Port, log: RotatingLog, journal: Journal) -> None:
        """Keep what waits in the system when the capture is asked to stop."""
        try:
            while data := port.read(0.0):
                self._keep(data, log, journal)
                if time.monotonic() - self._begin - self.status.elapsed > _LAST_READS:
                    break
        except OSError as error:
            journal.note("lost port", reason=str(error), bytes=self.status.received)

    def _explain(self) -> None:
        try:
            self._decoder.check()
        except DataError as error:
            raise DataError(
                f"{error} The port was read at {self.options.baud} baud; the bytes are kept in {self.options.folder}."
            ) from None

    def _receive(self, port: Port | None, log: RotatingLog, journal: Journal) -> Port | None:
        """Read once; on a hang-up close and try to reopen. Returns the port, None while it is away."""
        options, status = self.options, self.status
        if port is None:
            if self.stop.wait(options.retry_s):
                return None
            try:
                port = open_port(options.port, options.baud)
            except CaptureError as error:
                status.message = str(error)
                return None
            status.connected, status.message = True, ""
            journal.note("reopened", port=options.port)
        try:
            data = port.read()
            if data:
                self._keep(data, log, journal)
        except OSError as error:
            status.outages += 1
            status.connected = False
            journal.note("lost port", reason=str(error), bytes=status.received)
            try:
                port.close()
            except OSError as again:
                journal.note("close failed", reason=str(again))
            return None
        return port

    def _keep(self, data: bytes, log: RotatingLog, journal: Journal) -> None:
        """Write, then decode; a file that is due to end does so at a frame boundary."""
        options, status = self.options, self.status
        log.write(data)
        status.received += len(data)
        self._second.append(self._decoder.feed(data))
        due = log.size >= options.rotate_bytes or time.time() - log.opened >= options.rotate_s
        tail = self._decoder.pending
        if due and tail <= len(data):
            name = log.rotate(data[len(data) - tail :])
            status.files.append(str(name))
            journal.note("completed", file=name)

    def _means(self) -> dict[str, float]:
        """Mean current of each channel since the last call, A."""
        counts: dict[str, list[np.ndarray]] = {}
        for batch in self._second:
            for part in batch.samples:
                for column, name in enumerate(part.channels):
                    counts.setdefault(name, []).append(part.counts[:, column])
        self._second.clear()
        return {
            name: float(self.calibration.amperes(name, np.concatenate(parts)).value.mean())
            for name, parts in counts.items()
            if sum(map(len, parts))
        }
