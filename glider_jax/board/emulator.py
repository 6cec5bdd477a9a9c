"""Play a board log over a pseudo-terminal or TCP at the line rate, with faults; standard library and NumPy.

The board has no flow control: time goes on while the cable is out, and what it sends then is lost. The
emulator keeps an
exact account of which bytes of the log were delivered, so that a test can ask whether a capture lost any
of them.
"""

from __future__ import annotations

import array
import fcntl
import os
import socket
import termios
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from glider_jax.board.faults import KINDS, Fault, at_wrong_baud, damage
from glider_jax.board.frames import BAUD
from glider_jax.errors import CaptureError

_SLICE = 0.02
_MARK = 7
_CALM = 0.25


class PtyLine:
    """A pseudo-terminal whose user end is reached by a stable link, like a USB adapter under /dev.

    Parameters
    ----------
    link : path of the symbolic link to create; removed while unplugged.
    baud : the board's rate. A reader set to another rate receives what a real one would.
    """

    def __init__(self, link: str | Path, baud: int = BAUD) -> None:
        self.link = Path(link)
        self.baud = baud
        self._master = -1
        self._slave = -1

    def plug(self) -> None:
        """Create the terminal and the link."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        settings = termios.tcgetattr(self._slave)
        # A serial program sets its own timing; this value shows whether one has opened the port.
        settings[6][termios.VMIN] = _MARK
        code = next((code for code, rate in _SPEEDS.items() if rate == self.baud), None)
        if code is not None:
            settings[4] = settings[5] = code
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        os.set_blocking(self._master, False)
        temporary = self.link.with_name(self.link.name + ".new")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(os.ttyname(self._slave))
        temporary.replace(self.link)

    def ready(self) -> bool:
        """Whether a program has opened the port and set it up."""
        return termios.tcgetattr(self._slave)[6][termios.VMIN] != _MARK

    def send(self, data: bytes) -> int:
        """Write without waiting; returns how many bytes the line took."""
        speed = _SPEEDS.get(termios.tcgetattr(self._slave)[5], self.baud)
        if speed != self.baud:
            data_out = at_wrong_baud(data, self.baud, speed)
            self._write(data_out)
            return len(data)
        return self._write(data)

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def drained(self) -> bool:
        """Whether the reader has taken everything sent."""
        waiting = array.array("i", [0])
        fcntl.ioctl(self._slave, termios.FIONREAD, waiting)
        return waiting[0] == 0

    def unplug(self) -> None:
        """Pull the cable: the reader sees a hang-up and the link is gone."""
        self.link.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1


_SPEEDS = {
    getattr(termios, f"B{rate}"): rate
    for rate in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400)
    if hasattr(termios, f"B{rate}")
}


class TcpLine:
    """One client at a time on a TCP port of this machine; read it as ``socket://127.0.0.1:PORT``."""

    def __init__(self, port: int = 0, host: str = "127.0.0.1") -> None:
        self.host, self.port = host, port
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None

    def plug(self) -> None:
        """Listen; the first call chooses the port where none was given."""
        server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind((self.host, self.port))
        except OSError as error:
            server.close()
            raise CaptureError(
                f"{self.host}:{self.port}: expected a free TCP port, found: {error.strerror}. Choose another."
            ) from None
        server.listen(1)
        server.setblocking(False)
        self.port = server.getsockname()[1]
        self._server = server

    def ready(self) -> bool:
        """Whether a client is connected."""
        if self._client is None and self._server is not None:
            try:
                self._client, _ = self._server.accept()
            except BlockingIOError:
                return False
            self._client.setblocking(False)
        return self._client is not None

    def send(self, data: bytes) -> int:
        """Write without waiting; returns how many bytes the line took."""
        if not self.ready() or self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._client.close()
            self._client = None
            return 0

    def drained(self) -> bool:
        """TCP delivers what it took; nothing to wait for."""
        return True

    def unplug(self) -> None:
        """Close the connection and stop listening."""
        for end in (self._client, self._server):
            if end is not None:
                end.close()
        self._client = self._server = None


@dataclass
class Emulator:
    """Play bytes over a line at a steady rate.

    Attributes
    ----------
    line : where to send.
    data : the log to play.
    bytes_per_second : rate; the whole line's by default.
    faults : ascending by byte.
    seed : of the random content of faults.
    wait : whether to hold the board's clock until a reader has opened the port the first time.
    patient : whether to wait for a slow reader, as no real line does; for playing faster than the line.
    delivered : (start, stop) ranges of ``data`` that the reader's side took unharmed.
    """

    line: PtyLine | TcpLine
    data: bytes
    bytes_per_second: float = BAUD / 10
    faults: list[Fault] = field(default_factory=list)
    seed: int = 0
    wait: bool = True
    patient: bool = False
    delivered: list[tuple[int, int]] = field(default_factory=list)
    outages: int = 0

    def run(
        self, stop: threading.Event | None = None, on_second: Callable[[int], None] | None = None
    ) -> None:
        """Play everything, then unplug; returns early when ``stop`` is set."""
        stop = stop or threading.Event()
        rng = np.random.default_rng(self.seed)
        faults = sorted(self.faults, key=lambda fault: fault.at)
        self.line.plug()
        if self.wait:
            self._await_reader(stop, 1e9)
        begin = time.monotonic()
        position = 0
        told = begin
        while position < len(self.data) and not stop.is_set():
            due = min(int((time.monotonic() - begin) * self.bytes_per_second), len(self.data))
            if faults and faults[0].at < due:
                fault = faults.pop(0)
                while position < fault.at:
                    position = self._deliver(position, fault.at)
                position = self._fault(fault, position, begin, rng, stop)
                continue
            if due > position:
                position = self._deliver(position, due)
            if on_second and time.monotonic() - told >= 1.0:
                told = time.monotonic()
                on_second(position)
            stop.wait(_SLICE)
        self._drain(stop)
        self.line.unplug()

    def _deliver(self, start: int, stop: int) -> int:
        """Send a range and return where in the log the board is then."""
        taken = self.line.send(self.data[start:stop])
        if taken:
            if self.delivered and self.delivered[-1][1] == start:
                self.delivered[-1] = (self.delivered[-1][0], start + taken)
            else:
                self.delivered.append((start, start + taken))
        return start + taken if self.patient else stop

    def _fault(
        self, fault: Fault, position: int, begin: float, rng: np.random.Generator, stop: threading.Event
    ) -> int:
        """Act out one fault and return where in the log the board is afterwards."""
        if fault.kind == "unplug":
            self._drain(stop)
            self.line.unplug()
            self.outages += 1
            stop.wait(fault.length)
            self.line.plug()
            self._await_reader(stop, 30.0)
            return min(int((time.monotonic() - begin) * self.bytes_per_second), len(self.data))
        if fault.kind not in KINDS:
            raise ValueError(f"unknown fault: {fault.kind!r}")
        end = min(position + 22, len(self.data))
        self.line.send(damage(self.data[position:end], fault.kind, rng))
        return end

    def _drain(self, stop: threading.Event) -> None:
        limit = time.monotonic() + 5.0
        quiet = time.monotonic()
        # Bytes on their way through the kernel are not counted as waiting; only a lasting calm means that
        # all are read.
        while time.monotonic() - quiet < _CALM and time.monotonic() < limit and not stop.is_set():
            if not self.line.drained():
                quiet = time.monotonic()
            time.sleep(0.01)

    def _await_reader(self, stop: threading.Event, seconds: float) -> None:
        limit = time.monotonic() + seconds
        while not self.line.ready() and time.monotonic() < limit and not stop.is_set():
            stop.wait(0.02)
        # Opening a serial port discards what arrived before; let that happen first.
        stop.wait(0.15)

    def start(self) -> tuple[threading.Thread, threading.Event]:
        """Run in a thread; returns it and the event that stops it."""
        stop = threading.Event()
        thread = threading.Thread(target=self.run, args=(stop,), daemon=True)
        thread.start()
        return thread, stop
