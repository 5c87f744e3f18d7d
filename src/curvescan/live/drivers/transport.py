"""Transport: the bytes of a laser, from a serial port, a network or a recording; silence and absence are errors.

The drivers' packages read from an object with ``read``, ``write`` and ``close``, and wait for ever on a port that has
fallen silent. This one says so: every fault of the line ends in a :class:`curvescan.SourceError` with one sentence.
"""

import contextlib
import os
import time
from pathlib import Path
from typing import Any

from curvescan.errors import MissingPackageError, SourceError

PIP_COMMAND = "pip install 'curvescan[lidar]'"

SILENCE = 2.0  # a port from which nothing comes for so long is silent, seconds
NONSENSE = 5.0  # a port whose bytes make no turn for so long sends something else, seconds

_POLL = 0.1
_URL_WAIT = 0.005
RECORDING = "recording://"


class EndOfSource(Exception):  # noqa: N818 - an end, not an error
    """The recording has ended, or the transport was closed by another thread."""


class Transport:
    """Bytes of a laser."""

    def __init__(self, port: str, baud: int) -> None:
        self.port, self.baud = port, baud
        self.is_recording = port.startswith(RECORDING)
        # when the last bytes came, by time.monotonic(), seconds; None in a recording, which has no times
        self.arrival: float | None = None
        self._line = _opened(port, baud)
        self._is_closed = False
        self._is_url = "://" in port
        self._n_bytes, self._seconds_read = 0, 0.0

    def read(self, size: int = 1) -> bytes:
        """Return between 1 and `size` bytes, as soon as there are any. Raises SourceError, EndOfSource."""
        # only the time spent waiting here counts: the caller may have been busy
        started = time.monotonic()
        while not (data := self._some(size)):
            if time.monotonic() - started > SILENCE:
                raise SourceError(
                    f"nothing has come from {self.port} for {SILENCE:g} s: is the laser powered, and does it turn?"
                )
        if self.is_recording:
            return data
        self.arrival = time.monotonic()
        self._n_bytes += len(data)
        self._seconds_read += self.arrival - started
        if self._seconds_read > NONSENSE:
            raise SourceError(
                f"{self._n_bytes:,} bytes came from {self.port} in {NONSENSE:g} s and no turn of this laser is among "
                f"them: is it this model, and is {self.baud} its baud rate?"
            )
        return data

    def turn_done(self) -> None:
        """Note that the bytes so far made a turn."""
        self._seconds_read, self._n_bytes = 0.0, 0

    def write(self, data: bytes) -> int:
        """Send bytes to the laser; a recording takes them in and does nothing."""
        if self.is_recording:
            return len(data)
        try:
            return int(self._line.write(data) or 0)
        except OSError as error:
            raise self._gone(error) from error

    def set_dtr(self, level: bool) -> None:
        """Set the line that switches the motor of some lasers, where the port has one."""
        if not self.is_recording and not self._is_url:
            with contextlib.suppress(OSError):  # a pseudo terminal has no such line
                self._line.dtr = level

    def reset_input(self) -> None:
        """Drop what came and was not read."""
        if not self.is_recording:
            self._line.reset_input_buffer()

    def close(self) -> None:
        """Close the port; a read in another thread ends."""
        self._is_closed = True
        self._line.close()

    def _some(self, size: int) -> bytes:
        if self._is_closed:
            raise EndOfSource
        try:
            if self.is_recording:
                data: bytes = self._line.read(size)
                if not data:
                    raise EndOfSource
                return data
            if self._is_url:  # pyserial does not tell how much a URL holds
                return bytes(self._line.read(size))
            return bytes(self._line.read(max(1, min(size, self._line.in_waiting))))
        except (OSError, TypeError, AttributeError, ValueError) as error:
            # pyserial fails in many ways when its port is closed under it
            if self._is_closed:
                raise EndOfSource from error
            raise self._gone(error) from error

    def _gone(self, error: Exception) -> SourceError:
        return SourceError(f"the laser at {self.port} is gone: {error}")


def _opened(port: str, baud: int) -> Any:
    if port.startswith(RECORDING):
        try:
            return Path(port.removeprefix(RECORDING)).open("rb")
        except OSError as error:
            raise SourceError(f"cannot read the recording: {error}") from error
    try:
        import serial
    except ImportError as error:
        raise MissingPackageError(f"a laser's port needs pyserial: {PIP_COMMAND}") from error
    try:
        if "://" in port:
            return serial.serial_for_url(port, baudrate=baud, timeout=_URL_WAIT)
        return serial.Serial(port, baud, timeout=_POLL, exclusive=os.name == "posix" or None)
    except (OSError, ValueError) as error:
        raise SourceError(
            f"cannot open {port}: {error} (is it plugged in, is it this port, may this user use it, has another "
            "program opened it?)"
        ) from error
