"""RplidarSource: Slamtec's RPLIDARs by the package rplidar-roboticia (MIT), on a transport that notices silence."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Self

from curvescan.errors import MissingPackageError, SourceError
from curvescan.live.drivers.transport import PIP_COMMAND, EndOfSource, Transport
from curvescan.live.drivers.turns import TurnClock, scan_of_turn, to_unix
from curvescan.scan import LaserScan

BAUD = 115200
LIMITS = (0.15, 12.0)
_N_BUFFERED = 4096


class RplidarSource:
    """An RPLIDAR A1, A2 or A3 on a serial port. ignore_beams (int, int)."""

    is_live = True

    def __init__(
        self, port: str, *, baud: int = BAUD, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)
    ) -> None:
        try:
            import rplidar
        except ImportError as error:
            raise MissingPackageError(f"the driver rplidar is the package rplidar-roboticia: {PIP_COMMAND}") from error
        self._package: Any = rplidar
        self.port = port
        self._baud, self._is_mirrored, self._ignore_beams = baud, is_mirrored, ignore_beams
        self._transport: Transport | None = None
        self._laser: Any = None

    @property
    def name(self) -> str:
        """Model and port."""
        return f"RPLIDAR at {self.port}"

    def __enter__(self) -> Self:
        self._transport = Transport(self.port, self._baud)
        line = _Line(self._transport)

        class OnLine(self._package.RPLidar):  # type: ignore[name-defined,misc]
            """The package's driver, on our line instead of a port it opens itself."""

            def connect(self) -> None:
                self._serial = line

            def _read_response(self, dsize: int) -> bytes:
                # the package asks again and again how much is there, and would do so for ever
                return line.read(dsize)

        self._laser = OnLine(self.port, self._baud)
        try:
            self._laser.stop()  # it may still be scanning for whoever used it before
        except SourceError:
            self._transport.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._transport is not None:
            self._transport.close()

    def scans(self) -> Iterator[LaserScan]:
        """Yield a scan a turn, from the second turn on: the first is cut."""
        try:
            yield from self._turns()
        except (EndOfSource, SourceError) as end:
            if isinstance(end, SourceError):
                raise
        except Exception as error:  # what the package does not expect of its bytes
            raise SourceError(f"the {self.name} sends what its driver cannot read: {error}") from error

    def _turns(self) -> Iterator[LaserScan]:
        if self._transport is None:
            raise SourceError(f"the {self.name} is not open: use it in a `with`")
        clock = TurnClock()
        angles: list[float] = []
        ranges: list[float] = []
        strengths: list[float] = []
        n_turns = 0
        for is_new, quality, angle_deg, distance_mm in self._laser.iter_measures(max_buf_meas=False):
            if is_new:
                begin, end = clock.turn(self._transport.arrival)
                self._transport.turn_done()
                if n_turns > 1:
                    scan = scan_of_turn(
                        angles,
                        ranges,
                        strengths,
                        begin=to_unix(begin),
                        end=to_unix(end),
                        is_clockwise=not self._is_mirrored,
                        range_min=LIMITS[0],
                        range_max=LIMITS[1],
                        ignore_beams=self._ignore_beams,
                    )
                    if scan is not None:
                        yield scan
                n_turns += 1
                angles, ranges, strengths = [], [], []
            angles.append(math.radians(angle_deg))
            ranges.append(1e-3 * distance_mm)
            strengths.append(float(quality))


class _Line:
    """A transport with the few names of pyserial that the package calls."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._held = bytearray()

    def inWaiting(self) -> int:  # noqa: N802 - pyserial's name
        """Return how many bytes are held; never waits, as the package asks before it has sent a command."""
        return len(self._held)

    def read(self, size: int) -> bytes:
        """Return exactly `size` bytes."""
        while len(self._held) < size:
            self._held += self._transport.read(_N_BUFFERED)
        data = bytes(self._held[:size])
        del self._held[:size]
        return data

    def write(self, data: bytes) -> int:
        """Send bytes."""
        return self._transport.write(data)

    def flushInput(self) -> None:  # noqa: N802 - pyserial's name
        """Drop what is held and what has come."""
        self._held.clear()
        self._transport.reset_input()

    def setDTR(self, level: bool) -> None:  # noqa: N802 - pyserial's name
        """Switch the motor of an A1."""
        self._transport.set_dtr(level)

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()
