"""HokuyoSource: Hokuyo's UST and UTM scanners with Ethernet by the package hokuyolx (MIT)."""

import math
import time
from collections.abc import Iterator
from typing import Any, Self

import numpy as np

from curvescan.errors import InvalidArgumentError, SourceError
from curvescan.live.drivers.transport import SILENCE, TurnClock, package_of, to_unix
from curvescan.scan import LaserScan

DEFAULT_PORT = 10940
_NO_READING = 65533  # distances from here on are codes of errors, not millimetres (SCIP 2.2)
_END = b"\n\n"  # of a reply


class HokuyoSource:
    """A Hokuyo on the network. ignore_beams (int, int)."""

    is_live = True

    def __init__(self, port: str, *, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)) -> None:
        self._package = package_of("hokuyolx", "the driver hokuyo is the package hokuyolx")
        host, _, number = port.partition(":")
        if not host or (number and not number.isdecimal()):
            raise InvalidArgumentError(f"a Hokuyo's port is HOST:PORT, got {port!r}")
        self._address = (host, int(number or DEFAULT_PORT))
        self.name = f"Hokuyo at {host}:{self._address[1]}"
        self._is_mirrored, self._ignore_beams = is_mirrored, ignore_beams
        self._laser: Any = None
        self._is_closed = False

    def __enter__(self) -> Self:
        try:
            # its clock is not queried: that takes a second, and we stamp what arrives
            self._laser = self._package.HokuyoLX.__new__(self._package.HokuyoLX)
            self._laser.__init__(addr=self._address, tsync=False, convert_time=False, timeout=SILENCE)
            self._laser._sock = _Socket(self._laser._sock)
        except Exception as error:
            self._laser.close()
            raise SourceError(f"cannot open the {self.name}: {error}") from error
        return self

    def __exit__(self, *error: object) -> None:
        self._is_closed = True
        if self._laser is not None:
            self._laser.close()

    def scans(self) -> Iterator[LaserScan]:
        """Yield a scan a sweep."""
        laser, clock = self._laser, TurnClock()
        if laser is None:
            raise SourceError(f"the {self.name} is not open: use it in a `with`")
        first, last = self._ignore_beams
        step = (-2.0 if self._is_mirrored else 2.0) * math.pi / laser.ares
        try:
            for distances, _, _ in laser.iter_dist():
                # the beams of a sweep take their share of the turn, and the data comes when the sweep is done
                arrival = time.monotonic()
                _, end = clock.turn(arrival, float(laser.scan_freq))
                time_increment = 1.0 / (laser.scan_freq * laser.ares)
                ranges = 1e-3 * np.asarray(distances, dtype=np.float64)
                ranges[np.asarray(distances) >= _NO_READING] = np.nan
                ranges[:first] = np.nan
                ranges[max(len(ranges) - last, 0) :] = np.nan
                yield LaserScan(
                    ranges,
                    angle_min=(laser.amin - laser.aforw) * step,
                    angle_increment=step,
                    range_min=1e-3 * laser.dmin,
                    range_max=1e-3 * laser.dmax,
                    stamp=to_unix(end) - time_increment * len(ranges),
                    time_increment=time_increment,
                    scan_time=1.0 / laser.scan_freq,
                )
        except Exception as error:
            if self._is_closed:
                return
            raise SourceError(f"the {self.name} is gone or sends what its driver cannot read: {error}") from error


class _Socket:
    """A socket that raises when the other side closed it, and hands out one reply at a time of those that came."""

    def __init__(self, opened: Any) -> None:
        self._opened = opened
        self._held = bytearray()

    def recv(self, size: int) -> bytes:
        """Return some bytes, none beyond the end of a reply."""
        is_new = not self._held
        # the end of a reply may lie across two pieces
        while not self._held or (is_new and self._held.endswith(b"\n") and not self._held.endswith(_END)):
            data: bytes = self._opened.recv(size)
            if not data:
                raise ConnectionError("the connection was closed")
            self._held += data
        end = self._held.find(_END)
        taken = bytes(self._held if end < 0 else self._held[: end + len(_END)])
        del self._held[: len(taken)]
        return taken

    def send(self, data: bytes) -> int:
        """Send bytes."""
        return int(self._opened.send(data))

    def close(self) -> None:
        """Close it."""
        self._opened.close()
