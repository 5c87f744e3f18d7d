"""MapPublisher: draws the map in a thread of its own and publishes it, so that no pose waits for a picture."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from curvescan.live.sinks import MapSink
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.slam import SlamMap


class MapPublisher(MapSink):
    """A sink that hands a new map to `publish` at most every `period` seconds.

    Parameters
    ----------
    publish : callable
        Called in this sink's thread.
    period : float
        Seconds.
    is_revisable : bool
        Whether past poses may be revised (SLAM).
    saved_map : SlamMap or None
        The map that is localized in: what this one begins with.
    """

    def __init__(
        self,
        publish: Callable[[OccupancyGrid], None],
        *,
        period: float,
        is_revisable: bool,
        saved_map: SlamMap | None = None,
    ) -> None:
        self._publish, self._period = publish, period
        self._lock = threading.Lock()
        self._next, self._published = 0.0, -1
        super().__init__("map publisher", is_revisable=is_revisable, saved_map=saved_map)
        if saved_map is not None:
            self._publish_map()

    def grid(self) -> OccupancyGrid:
        """Return the map as it is; from any thread."""
        with self._lock:
            return self._map.grid()

    def _take(self, tracked: object) -> None:
        with self._lock:
            self._map.add(tracked)
        if time.monotonic() >= self._next and self._map.version != self._published:
            self._publish_map()

    def _finish(self) -> None:
        with self._lock:
            super()._finish()

    def _publish_map(self) -> None:
        grid = self.grid()
        if grid.log_odds.size:
            self._publish(grid)
        self._published = self._map.version
        self._next = time.monotonic() + self._period
