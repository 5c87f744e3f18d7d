"""Transport: the bytes of a laser, from a serial port, a network or a recording; silence and absence are errors.

The drivers' packages read from an object with ``read``, ``write`` and ``close``, and wait for ever on a port that has
fallen silent. This one says so: every fault of the line ends in a :class:`curvescan.SourceError` with one sentence.
"""

import contextlib
import importlib
import math
import os
import statistics
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from curvescan.errors import MissingPackageError, SourceError
from curvescan.scan import LaserScan

PIP_COMMAND = "pip install 'curvescan[lidar]'"

SILENCE = 2.0  # a port from which nothing comes for so long is silent, seconds
NONSENSE = 5.0  # a port whose bytes make no turn for so long sends something else, seconds


def package_of(module: str, sentence: str) -> Any:
    """Return the package that a driver stands on, or raise MissingPackageError with a sentence that names it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingPackageError(f"{sentence}: {PIP_COMMAND}") from error


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
    serial = package_of("serial", "a laser's port needs pyserial")
    try:
        if "://" in port:
            return serial.serial_for_url(port, baudrate=baud, timeout=_URL_WAIT)
        return serial.Serial(port, baud, timeout=_POLL, exclusive=os.name == "posix" or None)
    except (OSError, ValueError) as error:
        raise SourceError(
            f"cannot open {port}: {error} (is it plugged in, is it this port, may this user use it, has another "
            "program opened it?)"
        ) from error


_LATE = 0.5
"""A turn that ends later than expected by this share of a turn was delivered late, and keeps the time expected."""

_SLEW = 0.1  # share of a smaller delay by which the clock follows
_MAX_LATE = 10  # after so many late turns in a row it is the clock that was wrong: turns were lost


class TurnClock:
    """When each turn of a steadily spinning laser began and ended, from when its bytes came.

    Bytes come when the sensor has sent them or later, never earlier: a turn that comes late, behind others in a buffer,
    ended one period after the turn before it. A delay that stays for ten turns is a gap, and is kept.
    """

    def __init__(self) -> None:
        self._end: float | None = None
        self._periods: deque[float] = deque(maxlen=15)
        self._last_arrival: float | None = None
        self._n_late = 0

    def turn(self, arrival: float | None, rate_hz: float = 0.0) -> tuple[float, float]:
        """Return begin and end of the turn whose last bytes came at `arrival`, seconds; None: turns follow on."""
        if arrival is not None and self._last_arrival is not None and arrival > self._last_arrival:
            self._periods.append(arrival - self._last_arrival)
        self._last_arrival = arrival
        period = statistics.median(self._periods) if self._periods else 0.1
        if rate_hz > 0.0 and math.isfinite(rate_hz):
            period = 1.0 / rate_hz
        if self._end is None:
            end = 0.0 if arrival is None else arrival
            begin = end - period
        else:
            begin = self._end
            end = self._next_end(begin + period, period, arrival)
        self._end = end
        return begin, end

    def _next_end(self, expected: float, period: float, arrival: float | None) -> float:
        if arrival is None:
            return expected
        delay = arrival - expected
        if delay <= 0.0:
            self._n_late = 0
            # it was there: it cannot have ended later; nor did it take no time
            return max(arrival, expected - 0.9 * period)
        if delay < _LATE * period:
            self._n_late = 0
            return expected + _SLEW * delay
        self._n_late += 1
        if self._n_late > _MAX_LATE:
            self._n_late = 0
            return arrival
        return expected


def to_unix(monotonic: float) -> float:
    """Return a time by time.monotonic() as seconds since 1970."""
    return monotonic - time.monotonic() + time.time()


def scan_of_turn(
    points: Sequence[tuple[float, float, float]],
    begin: float,
    end: float,
    *,
    is_clockwise: bool,
    limits: tuple[float, float],
    ignore_beams: tuple[int, int] = (0, 0),
) -> LaserScan | None:
    """Return (n, 3) directions, ranges and strengths, radians and metres, as a scan; None without two directions."""
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    angles, order = np.unique(np.mod(table[:, 0], 2.0 * np.pi), return_index=True)
    n = angles.size
    used = slice(ignore_beams[0], max(n - ignore_beams[1], 0))
    angles, order = angles[used], order[used]
    if angles.size < 2:
        return None
    return LaserScan(
        table[order, 1],
        angles=-angles if is_clockwise else angles,
        range_min=limits[0],
        range_max=limits[1],
        stamp=begin + ignore_beams[0] / n * (end - begin),
        intensities=table[order, 2],
        time_increment=(end - begin) / n,
        scan_time=end - begin,
    )
