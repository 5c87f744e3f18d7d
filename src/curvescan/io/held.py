"""A log that is read once and held in memory where it is small enough: a run goes over its scans six times."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy

from curvescan.io.log import Log, LogView
from curvescan.scan import LaserScan

MAX_HELD_BYTES = 128 << 20
"""Most memory that the scans of a held log take; 45,000 scans of 361 beams. A larger log is read anew each time."""

_SCAN_BYTES = 1200  # what a scan takes besides its arrays


class HeldLog(LogView):
    """A log whose first complete iteration keeps its scans, so that further ones read nothing.

    The scans are the same, and what an iteration computes of them is not kept: memory is that of the readings.
    """

    def __init__(self, log: Log, max_bytes: int = MAX_HELD_BYTES) -> None:
        super().__init__(log)
        self._max_bytes = max_bytes
        self._scans: list[LaserScan] | None = None
        self._is_too_large = False

    @property
    def is_held(self) -> bool:
        """Whether the scans are in memory."""
        return self._scans is not None

    def __iter__(self) -> Iterator[LaserScan]:
        if self._scans is not None:
            return map(copy, self._scans)
        return iter(self._log) if self._is_too_large else self._read()

    def _read(self) -> Iterator[LaserScan]:
        scans: list[LaserScan] = []
        left, angles = self._max_bytes, None
        for scan in self._log:
            if left >= 0:
                # scans of one layout share their directions
                left -= _n_bytes(scan, has_own_angles=scan.angles is not angles)
                angles = scan.angles
                scans.append(copy(scan))
                if left < 0:
                    scans.clear()
            yield scan
        if left >= 0:
            self._scans = scans
        self._is_too_large = left < 0

    def _scan_at(self, i: int) -> LaserScan:
        return self._log[i] if self._scans is None else copy(self._scans[i])


def _n_bytes(scan: LaserScan, *, has_own_angles: bool) -> int:
    n_rows = 1 + (scan.intensities is not None) + 3 * has_own_angles  # angles and unit vectors
    return _SCAN_BYTES + n_rows * scan.ranges.nbytes
