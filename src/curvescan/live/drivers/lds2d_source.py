"""Lds2dSource: the lasers of the package lds2d (Apache-2.0): LDROBOT, YDLIDAR, RPLIDAR, 3irobotix, Neato and others.

lds2d parses packets into points. It gives no times, its turns begin anywhere, and one of its turn splitters never
splits what counts backwards; so turns are cut here from the packets, and stamped when their last point has come.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from types import MappingProxyType, TracebackType
from typing import Any, Self

from curvescan.errors import InvalidArgumentError, MissingPackageError, SourceError
from curvescan.live.drivers.transport import PIP_COMMAND, EndOfSource, Transport
from curvescan.live.drivers.turns import TurnClock, scan_of_turn, to_unix
from curvescan.scan import LaserScan

COUNTER_CLOCKWISE = frozenset({"HLS-LFCD2", "HLS_LFCD2", "LDS-01"})
"""Models whose angles count counter-clockwise, seen from above; lds2d gives those of all others clockwise."""

LIMITS = MappingProxyType(
    {
        "LDROBOT": (0.02, 12.0),
        "YDLIDAR": (0.1, 12.0),
        "RPLIDAR": (0.15, 12.0),
        "NEATO": (0.15, 6.0),
        "XIAOMI": (0.15, 6.0),
        "3IROBOTIX": (0.15, 8.0),
        "CAMSENSE": (0.1, 8.0),
        "HLS": (0.12, 3.5),
    }
)
"""Limits of a valid reading by the makers' data sheets, metres."""

_STARTS_BY_COMMAND = ("RPLIDAR", "HLS", "LDROBOT-LD14P", "LD14P")
_SHORTEST = 0.6
"""A turn must have this share of the points of the one before; less is a turn of which packets were lost."""


class Lds2dSource:
    """A laser that lds2d reads. baud: Bits a second; None for the model's; ignore_beams (int, int)."""

    is_live = True

    def __init__(
        self,
        model: str,
        port: str,
        *,
        baud: int | None = None,
        is_mirrored: bool = False,
        ignore_beams: tuple[int, int] = (0, 0),
    ) -> None:
        try:
            from lds2d import drivers  # noqa: F401 - fills the table of models
            from lds2d.core import available_models, driver_for
        except ImportError as error:
            raise MissingPackageError(f"the driver lds2d is a package: {PIP_COMMAND}") from error
        self._driver_class: Any = driver_for(model)
        if self._driver_class is None:
            near = difflib.get_close_matches(model.upper(), available_models(), n=1, cutoff=0.3)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise InvalidArgumentError(f"lds2d knows no model {model!r}{hint}")
        self.model, self.port = model.upper(), port
        self._baud = baud or int(self._driver_class.DEFAULT_BAUD)
        self._is_clockwise = (self.model not in COUNTER_CLOCKWISE) != is_mirrored
        self._limits = next((v for k, v in LIMITS.items() if self.model.startswith(k)), (0.05, 12.0))
        self._ignore_beams = ignore_beams
        self._transport: Transport | None = None
        self._laser: Any = None

    @property
    def name(self) -> str:
        """Model and port."""
        return f"{self.model} at {self.port}"

    def __enter__(self) -> Self:
        self._transport = Transport(self.port, self._baud)
        try:
            self._laser = self._driver_class(self._transport)
            if self.model.startswith(_STARTS_BY_COMMAND):
                self._laser.start()
        except SourceError:
            self._transport.close()
            raise
        except Exception as error:
            self._transport.close()
            raise SourceError(f"cannot start the {self.name}: {error}") from error
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
        transport, clock = self._transport, TurnClock()
        if transport is None:
            raise SourceError(f"the {self.name} is not open: use it in a `with`")
        points: list[Any] = []
        is_first, before = True, math.nan
        for rate_hz, packet in self._laser._packets():
            for point in packet:
                if abs(point.angle_deg - before) > 180.0:
                    begin, end = clock.turn(transport.arrival, rate_hz)
                    transport.turn_done()
                    if not is_first:
                        scan = self._scan(points, begin, end)
                        if scan is not None:
                            yield scan
                    points, is_first = [], False
                before = point.angle_deg
                points.append(point)

    def _scan(self, points: list[Any], begin: float, end: float) -> LaserScan | None:
        is_timed = self._transport is not None and self._transport.arrival is not None
        return scan_of_turn(
            [math.radians(p.angle_deg) for p in points],
            [1e-3 * p.dist_mm for p in points],
            [float(p.quality) for p in points],
            begin=to_unix(begin) if is_timed else begin,
            end=to_unix(end) if is_timed else end,
            is_clockwise=self._is_clockwise,
            range_min=self._limits[0],
            range_max=self._limits[1],
            ignore_beams=self._ignore_beams,
        )
