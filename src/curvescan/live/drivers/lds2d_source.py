"""Lds2dSource: the lasers of the package lds2d (Apache-2.0): LDROBOT, YDLIDAR, RPLIDAR, 3irobotix, Neato and others.

lds2d parses packets into points. It gives no times, its turns begin anywhere, and one of its turn splitters never
splits what counts backwards; so turns are cut here from the packets, and stamped when their last point has come.
"""

import difflib
import math
from collections.abc import Iterator
from typing import Any

from curvescan.errors import InvalidArgumentError
from curvescan.live.drivers.spinning import Measure, SpinningSource
from curvescan.live.drivers.transport import Transport, package_of

COUNTER_CLOCKWISE = frozenset({"HLS-LFCD2", "HLS_LFCD2", "LDS-01"})
"""Models whose angles count counter-clockwise, seen from above; lds2d gives those of all others clockwise."""

_STARTS_BY_COMMAND = ("RPLIDAR", "HLS", "LDROBOT-LD14P", "LD14P")


class Lds2dSource(SpinningSource):
    """A laser that lds2d reads."""

    def __init__(
        self, model: str, port: str, *, is_mirrored: bool = False, ignore_beams: tuple[int, int] = (0, 0)
    ) -> None:
        package_of("lds2d.drivers", "the driver lds2d is a package")  # which fills the table of models
        core = package_of("lds2d.core", "the driver lds2d is a package")
        self._driver_class = core.driver_for(model)
        if self._driver_class is None:
            near = difflib.get_close_matches(model.upper(), core.available_models(), n=1, cutoff=0.3)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise InvalidArgumentError(f"lds2d knows no model {model!r}{hint}")
        self.model = model.upper()
        self._laser: Any = None
        super().__init__(
            self.model,
            port,
            int(self._driver_class.DEFAULT_BAUD),
            is_clockwise=(self.model not in COUNTER_CLOCKWISE) != is_mirrored,
            ignore_beams=ignore_beams,
        )

    def start(self, transport: Transport) -> None:
        """Start the laser."""
        self._laser = self._driver_class(transport)
        if self.model.startswith(_STARTS_BY_COMMAND):
            self._laser.start()

    def measures(self) -> Iterator[Measure]:
        """Yield the points of its packets."""
        before = math.nan
        for rate_hz, packet in self._laser._packets():
            for point in packet:
                is_new = abs(point.angle_deg - before) > 180.0
                before = point.angle_deg
                yield Measure(is_new, (math.radians(before), 1e-3 * point.dist_mm, float(point.quality)), rate_hz)
