"""The cells of a square grid in which readings ended: the map as points, light enough to be drawn."""

from collections.abc import Iterable
from copy import copy

import numpy as np

from curvescan import se2
from curvescan.errors import require
from curvescan.scan import LaserScan
from curvescan.types import Ints, Points, Pose

_BATCH = 200_000  # points gathered before they are merged into cells, so that memory follows the area and not the log

_HALF = 2**31


def occupied_cells(scans: Iterable[LaserScan], poses: Pose, cell: float = 0.05) -> Points:
    """Return (k, 2) centres of all cells in which a reading ended; a scan without a pose (n, 3) is left out."""
    cells = OccupiedCells(cell)
    for scan, pose in zip(map(copy, scans), poses, strict=False):  # the points of a copy go with it
        if not np.isnan(pose).any():
            cells.add(se2.transform(pose, scan.points[scan.valid]))
    return cells.centres()


class OccupiedCells:
    """Cells of a square grid that points fell into, column and row in one integer; memory follows the area."""

    def __init__(self, cell: float) -> None:
        require(cell > 0.0, "cell must be > 0 m", cell)
        self._cell = cell
        self._cells: Ints = np.empty(0, dtype=np.int64)
        self._waiting: list[Points] = []
        self._n_waiting = 0

    def add(self, points: Points) -> None:
        """Take in (n, 2) points, metres."""
        self._waiting.append(points)
        self._n_waiting += len(points)
        if self._n_waiting > _BATCH:
            self._merge()

    def centres(self) -> Points:
        """Return the (k, 2) centres of the cells, metres, without repeats, sorted by x and y."""
        self._merge()
        cells, to_centre = np.column_stack(np.divmod(self._cells, 2 * _HALF)), np.array([0.5, 0.5 - _HALF])
        return np.asarray((cells + to_centre) * self._cell)

    def _merge(self) -> None:
        if not self._waiting:
            return
        cells = np.floor(np.concatenate(self._waiting) / self._cell).clip(-_HALF, _HALF - 1).astype(np.int64)
        numbers = cells[:, 0] * (2 * _HALF) + (cells[:, 1] + _HALF)
        numbers = np.sort(np.concatenate((self._cells, numbers)))
        self._cells = numbers[np.diff(numbers, prepend=numbers[:1] - 1) != 0]  # np.unique takes 18 times as long
        self._waiting, self._n_waiting = [], 0
