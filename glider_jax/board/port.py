"""One serial port or TCP socket, read so that nothing which arrived is dropped; pyserial is imported on opening.

Three habits of serial libraries lose bytes and are avoided here: discarding the input on opening, collecting a read
from several calls to the system (the first part is gone if the cable is pulled before the last), and not reading what
waits when a program ends.
"""

from __future__ import annotations

import errno
import os
import select
from typing import Any

from glider_jax.errors import CaptureError, did_you_mean

LARGEST_READ = 1 << 16


class Port:
    """An open line, from :func:`open_port`.

    Parameters
    ----------
    device : an open device of pyserial.
    """

    def __init__(self, device: Any) -> None:
        self._device = device
        try:
            self._descriptor = int(device.fileno())
        except (AttributeError, OSError):
            # Protocols such as rfc2217 have none; they queue what they receive themselves.
            self._descriptor = -1

    def read(self, wait: float = 0.1) -> bytes:
        """All bytes that one call to the system gives; none if nothing comes within ``wait`` s.

        Raises
        ------
        OSError : the line hung up.
        """
        if self._descriptor < 0:
            return bytes(self._device.read(max(1, self._device.in_waiting)))
        if not select.select([self._descriptor], [], [], wait)[0]:
            return b""
        try:
            data = os.read(self._descriptor, LARGEST_READ)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError(errno.EIO, "the line hung up")
        return data

    def close(self) -> None:
        """Close the line; what has not been read is gone."""
        self._device.close()


def _serial_device(port: str, baud: int) -> Any:
    import serial

    class Keeping(serial.Serial):
        """A serial port that can be opened without discarding what has already arrived."""

        def _reset_input_buffer(self) -> None:
            """Keep it: a frame cut in two is refused by its checks, a whole one is a measurement."""

    return Keeping(port, baudrate=baud, timeout=0.1, exclusive=True)


def open_port(port: str, baud: int) -> Port:
    """Open a serial port for this process alone, or a TCP socket.

    Raises
    ------
    CaptureError : the port does not exist, is in use, may not be opened, or the address is wrong.
    """
    import serial
    from serial.tools import list_ports

    try:
        if "://" in port:
            return Port(serial.serial_for_url(port, baudrate=baud, timeout=0.1))
        return Port(_serial_device(port, baud))
    except ValueError as error:
        raise CaptureError(
            f"{port}: expected a device or socket://HOST:PORT at a usual baud rate, found: {error}."
        ) from None
    except OSError as error:
        known = [entry.device for entry in list_ports.comports()]
        listed = (
            f" Ports here: {', '.join(known)}." if known else " No serial port is present on this machine."
        )
        number = error.errno
        if number == errno.ENOENT or (number is None and "No such file" in str(error)):
            hint = did_you_mean(port, known)
            raise CaptureError(
                f"{port}: expected a serial port, found no such device.{hint}{listed} Is the adapter plugged in?"
            ) from None
        if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
            raise CaptureError(
                f"{port}: the port is busy: another program holds it. Close that program, then try again."
            ) from None
        if number == errno.EACCES:
            raise CaptureError(
                f"{port}: this user may not open the port. Add the user to the group that owns it (often dialout)."
            ) from None
        raise CaptureError(f"{port}: cannot be opened: {error}.{listed}") from None
