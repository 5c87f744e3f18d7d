"""SpinningSource: a laser on a serial line that spins; its readings are cut into turns and stamped as they come."""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple, Self

from curvescan.configs import shipped_table
from curvescan.errors import SourceError
from curvescan.live.drivers.transport import EndOfSource, Transport, TurnClock, scan_of_turn, to_unix
from curvescan.scan import LaserScan


class Measure(NamedTuple):
    """A reading as a driver's package gives it."""

    is_new: bool  # whether a turn begins with it
    point: tuple[float, float, float]  # direction, radians, range, metres, and strength
    rate_hz: float = 0.0  # turns a second; 0: not known


class SpinningSource:
    """What the lasers that spin have in common; a :class:`curvescan.live.ScanSource`."""

    is_live = True
    n_cut = 1
    """Turns at the beginning that are not whole."""

    def __init__(self, name: str, port: str, baud: int, *, is_clockwise: bool, ignore_beams: tuple[int, int]) -> None:
        self.name, self.port = f"{name} at {port}", port
        self._baud = baud
        table = shipped_table(__package__, "lasers.toml")  # limits of a valid reading, by the beginning of a name
        limits = next((table[key] for key in table if name.startswith(key)), table["OTHERS"])
        self._scan_of = partial(scan_of_turn, is_clockwise=is_clockwise, limits=limits, ignore_beams=ignore_beams)
        self._transport: Transport | None = None

    def start(self, transport: Transport) -> None:
        """Start the laser at the other end."""
        raise NotImplementedError

    def measures(self) -> Iterator[Measure]:
        """Yield one reading after another."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self._transport = Transport(self.port, self._baud)
        try:
            self.start(self._transport)
        except SourceError:
            self._transport.close()
            raise
        except Exception as error:
            self._transport.close()
            raise SourceError(f"cannot start the {self.name}: {error}") from error
        return self

    def __exit__(self, *error: object) -> None:
        if self._transport is not None:
            self._transport.close()

    def scans(self) -> Iterator[LaserScan]:
        """Yield a scan a turn, from the first whole one on."""
        try:
            yield from self._turns()
        except EndOfSource:
            return
        except SourceError:
            raise
        except Exception as error:  # what the package does not expect of its bytes
            raise SourceError(f"the {self.name} sends what its driver cannot read: {error}") from error

    def _turns(self) -> Iterator[LaserScan]:
        transport, clock = self._transport, TurnClock()
        if transport is None:
            raise SourceError(f"the {self.name} is not open: use it in a `with`")
        points: list[tuple[float, float, float]] = []
        n_turns = 0
        for is_new, point, rate_hz in self.measures():
            if is_new:
                begin, end = clock.turn(transport.arrival, rate_hz)
                transport.turn_done()
                if transport.arrival is not None:
                    begin, end = to_unix(begin), to_unix(end)
                if n_turns >= self.n_cut:
                    scan = self._scan_of(points, begin, end)
                    if scan is not None:
                        yield scan
                points, n_turns = [], n_turns + 1
            points.append(point)
