"""RplidarSource: Slamtec's RPLIDARs by the package rplidar-roboticia (MIT), on a transport that notices silence."""

import math
from collections.abc import Iterator
from typing import Any

from curvescan.live.drivers.spinning import Measure, SpinningSource
from curvescan.live.drivers.transport import Transport, package_of

BAUD = 115200
_N_BUFFERED = 4096


class RplidarSource(SpinningSource):
    """An RPLIDAR A1 or A2 on a serial port."""

    n_cut = 2

    def __init__(self, port: str, *, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)) -> None:
        self._package = package_of("rplidar", "the driver rplidar is the package rplidar-roboticia")
        self._laser: Any = None
        super().__init__("RPLIDAR", port, BAUD, is_clockwise=not is_mirrored, ignore_beams=ignore_beams)

    def start(self, transport: Transport) -> None:
        """Start the laser."""
        line = _Line(transport)

        class OnLine(self._package.RPLidar):  # type: ignore[name-defined,misc]
            """The package's driver, on our line instead of a port it opens itself."""

            def connect(self) -> None:
                self._serial = line

            def _read_response(self, dsize: int) -> bytes:
                # the package asks again and again how much is there, and would do so for ever
                return line.read(dsize)

        self._laser = OnLine(self.port, self._baud)
        self._laser.stop()  # it may still be scanning for whoever used it before

    def measures(self) -> Iterator[Measure]:
        """Yield its measures."""
        for is_new, quality, angle_deg, distance_mm in self._laser.iter_measures(max_buf_meas=False):
            yield Measure(is_new, (math.radians(angle_deg), 1e-3 * distance_mm, float(quality)))


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
