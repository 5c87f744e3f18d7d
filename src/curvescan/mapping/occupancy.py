"""Occupancy maps: for each cell of a square grid, the log-odds that something stands there.

Moravec and Elfes, "High resolution maps from wide angle sonar", ICRA 1985; Thrun, Burgard and Fox, "Probabilistic
Robotics", 2005, chapter 9: cells are independent, and each scan adds the log-odds of its inverse sensor model. Hornung
et al., "OctoMap", Autonomous Robots 2013: a scan changes a cell once, hits go before misses, and the sum is
clamped, so that the map follows a changing place.
"""

import math
import mmap
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from curvescan import se2
from curvescan.configs import as_config, counted
from curvescan.errors import InvalidArgumentError, MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.traversal import mark_scan
from curvescan.scan import LaserScan
from curvescan.types import Bools, Floats, Points

MAX_BYTES = 1 << 30  # most memory that a map's cells may take; while the grid grows, the old ones stand beside the new

_CELL_BYTES = 5
_FIRST_MARGIN = 64
_TILE = 256  # cells along a side of what is looked at at once
_MARKS = range(2, 256)  # of the scan that changed a cell last, in turn; 0: none has, 1: one of an earlier turn


@dataclass(frozen=True, eq=False, kw_only=True)
class OccupancyGrid:
    """A map of cells.

    Attributes
    ----------
    log_odds : (n_rows, n_columns) float32
        Of occupancy; 0 where nothing is known. Row j, column i is the cell whose lower left corner lies at
        ``origin + resolution * [i, j]``: row 0 is the one of the smallest y.
    origin : (2,) float64
        Lower left corner of the grid, metres, frame of the poses; a multiple of the resolution.
    config : OccupancyConfig
        What it was made with.
    """

    log_odds: NDArray[np.float32]
    origin: Floats
    config: OccupancyConfig

    def __repr__(self) -> str:
        n_rows, n_columns = self.log_odds.shape
        n_occupied, n_free = np.count_nonzero(self.is_occupied), np.count_nonzero(self.is_free)
        return (
            f"OccupancyGrid({n_columns} x {n_rows} cells of {self.resolution:g} m: {n_occupied:,} occupied, "
            f"{n_free:,} free)"
        )

    @property
    def resolution(self) -> float:
        """Side of a cell, metres."""
        return self.config.resolution

    @property
    def probability(self) -> NDArray[np.float32]:
        """(n_rows, n_columns) probability that a cell is occupied; 0.5 where nothing is known."""
        odds: NDArray[np.float32] = np.exp(self.log_odds)
        return odds / (np.float32(1.0) + odds)

    @property
    def is_occupied(self) -> Bools:
        """(n_rows, n_columns) whether something stands in a cell."""
        return self.log_odds > log_odds_of(self.config.occupied_from)

    @property
    def is_free(self) -> Bools:
        """(n_rows, n_columns) whether a cell was seen to be empty; neither free nor occupied is unknown."""
        return self.log_odds < log_odds_of(self.config.free_to)

    @property
    def occupied_centres(self) -> Points:
        """(k, 2) centres of the occupied cells, metres, frame of the poses."""
        rows, columns = np.nonzero(self.is_occupied)
        return self.origin + self.resolution * (np.column_stack([columns, rows]) + 0.5)

    def blocks(self, n_most: int) -> "Blocks":
        """Return a map of at least one cell in so many rows and columns of blocks, at most, for a picture."""
        n_rows, n_columns = self.log_odds.shape
        n = -(-max(n_rows, n_columns) // max(n_most, 1))
        columns = np.arange(0, n_columns, n)
        ranks = np.empty((-(-n_rows // n), columns.size), dtype=np.uint8)
        for k in range(len(ranks)):  # a strip at a time: the map is large
            strip = replace(self, log_odds=self.log_odds[k * n : (k + 1) * n])
            ranks[k] = np.maximum.reduceat(np.maximum(strip.is_free, 2 * strip.is_occupied).max(axis=0), columns)
        return Blocks(ranks, self.origin + np.outer((0.0, n * self.resolution), ranks.shape[::-1]))


class Blocks(NamedTuple):
    """An occupancy map in blocks of cells."""

    ranks: NDArray[np.uint8]  # (n_rows, n_columns): 0 unknown, 1 free, 2 occupied, as its darkest cell
    corners: Points  # (2, 2): left and bottom, right and top, metres


def distances_from(occupied: Bools, resolution: float, most: float) -> NDArray[np.float32]:
    """Return (n_rows, n_columns) how far cells are from the nearest occupied one, metres, `most` at most.

    A tile at a time, as maps are large and mostly empty.
    """
    from scipy.ndimage import distance_transform_edt  # loads for a good part of a second

    beside, found = math.ceil(most / resolution), np.full(occupied.shape, most, dtype=np.float32)
    for row, column in product(*(range(0, n, _TILE) for n in occupied.shape)):
        top, left = max(row - beside, 0), max(column - beside, 0)
        around = occupied[top : row + _TILE + beside, left : column + _TILE + beside]
        if around.any():
            cells, tile = distance_transform_edt(~around)[row - top :, column - left :], found[row:, column:]
            np.minimum(resolution * cells[:_TILE, :_TILE], most, out=tile[:_TILE, :_TILE])
    return found


class OccupancyBuilder:
    """Builds an occupancy map scan by scan; the grid grows with what is seen.

    Parameters
    ----------
    config : OccupancyConfig, mapping or None
        How to make the map, or a mapping of the fields that differ from the defaults.
    """

    def __init__(self, config: OccupancyConfig | Mapping[str, Any] | None = None) -> None:
        self.config = as_config(config, OccupancyConfig())
        c = self.config
        self._steps = np.array([log_odds_of(p) for p in (c.hit, c.miss, c.lowest, c.highest)])
        # corner of the grid, and of the box that scans have reached, in cells from the frame's origin
        self._corner = self._first = self._beyond = np.zeros(2, dtype=np.int64)
        self._log_odds = np.zeros((0, 0), dtype=np.float32)
        self._marks = np.zeros((0, 0), dtype=np.uint8)
        self._n_scans = 0

    def __repr__(self) -> str:
        return f"OccupancyBuilder({counted(self._n_scans, 'scan')} in cells of {self.config.resolution:g} m)"

    def add(self, scan: LaserScan, pose: ArrayLike, ignored: ArrayLike | None = None) -> None:
        """Enter a scan.

        A valid reading marks a hit where it ends and clears the cells before it. A beam without a return (+inf) clears
        the cells up to range_max, which says nothing beyond 10 km. Other readings change nothing.

        Parameters
        ----------
        scan : LaserScan
            Any scan.
        pose : (3,) array_like
            [x, y, theta] of the sensor in the frame of the map; a scan whose pose is not finite is left out.
        ignored : (n_beams,) array_like of bool or None
            Readings that are no hits, on people say; they clear what lies before them all the same.

        Raises
        ------
        MapTooLargeError
            When the map would need more than MAX_BYTES; the map is left as it was.
        InvalidArgumentError
            When `pose` is not three numbers, or `ignored` has not one value a beam.
        """
        if not isinstance(scan, LaserScan):
            raise InvalidArgumentError(f"scan must be a LaserScan, got {type(scan).__name__}")
        is_hit = scan.valid
        if ignored is not None:
            is_ignored = np.asarray(ignored, dtype=np.bool_)
            if is_ignored.shape != scan.ranges.shape:
                raise InvalidArgumentError(
                    f"ignored must have one value a beam ({len(scan)}), got shape {is_ignored.shape}"
                )
            is_hit = is_hit & ~is_ignored
        try:
            x, y, theta = map(float, np.asarray(pose, dtype=np.float64).tolist())
        except (TypeError, ValueError):
            raise InvalidArgumentError(f"pose must be three numbers [x, y, theta], got {pose!r:.80}") from None
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(theta)):
            return
        sees_free = self.config.clear_no_return and scan.range_max == scan.valid_range[1]
        is_fully_observed = (scan.ranges == math.inf) & sees_free
        used = np.flatnonzero(scan.valid | is_fully_observed)
        reach = np.where(scan.valid, scan.ranges, scan.range_max)[used]
        resolution = self.config.resolution
        # a place beyond all numbers is refused below for its size
        with np.errstate(over="ignore", invalid="ignore"):
            start = np.array([x, y]) / resolution
            turned = scan.directions[used] @ se2.rotation(theta).T
            ends = start + (reach / resolution)[:, np.newaxis] * turned
        low, high = ends.min(axis=0, initial=np.inf), ends.max(axis=0, initial=-np.inf)
        self._cover(np.floor(np.minimum(low, start)), np.floor(np.maximum(high, start)) + 1.0)
        mark = _MARKS[self._n_scans % len(_MARKS)]
        if mark == _MARKS.start:
            np.minimum(self._marks, 1, out=self._marks)
        self._n_scans += 1
        places = start - self._corner, ends - self._corner
        mark_scan(self._log_odds, self._marks, mark, *places, is_hit[used], is_fully_observed[used], self._steps)

    def make_room(self, points: Points) -> None:
        """Make room about (n, 2) points at once, metres: while a grid grows, the old cells stand beside the new."""
        if len(points):
            cells, beside = np.floor(points / self.config.resolution), 3 * _FIRST_MARGIN
            self._cover(cells.min(axis=0) - beside, cells.max(axis=0) + beside)

    def grid(self, *, is_last: bool = False) -> OccupancyGrid:
        """Return the map so far, cut to the cells that were seen; without a copy where no scan comes after."""
        marks, log_odds = self._part(self._marks), self._part(self._log_odds)
        rows, columns = np.flatnonzero(marks.any(axis=1)), np.flatnonzero(marks.any(axis=0))
        if not rows.size:
            rows = columns = np.array([0, -1])
        seen = log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        origin = self.config.resolution * (self._first + np.array([columns[0], rows[0]]))
        return OccupancyGrid(log_odds=seen if is_last else seen.copy(), origin=origin, config=self.config)

    def _part(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Return the part of the grid that scans have reached."""
        (left, bottom), (right, top) = self._first - self._corner, self._beyond - self._corner
        return cells[bottom:top, left:right]

    def _cover(self, first: Floats, beyond: Floats) -> None:
        """Make the grid hold a box of cells, (2,) each, counted from the frame's origin, and take it for reached."""
        corner, end = self._corner.astype(np.float64), self._corner + np.array(self._log_odds.shape[::-1], dtype=float)
        if self._log_odds.size:
            first, beyond = np.minimum(first, self._first), np.maximum(beyond, self._beyond)
        else:
            corner = end = first
        low, high = first - 1.0, beyond + 1.0  # places are rounded once more
        if not ((low >= corner) & (high <= end)).all():
            self._grow(low, high, corner, end)
        self._first, self._beyond = first.astype(np.int64), beyond.astype(np.int64)

    def _grow(self, low: Floats, high: Floats, corner: Floats, end: Floats) -> None:
        check_map_size(high - low, self.config.resolution)
        # room to grow by an eighth wherever it had to grow, so that few scans pay for it
        margin = np.maximum(_FIRST_MARGIN, (high - low) // 8 if self._log_odds.size else 0.0)
        roomy_low, roomy_high = np.where(low < corner, low - margin, corner), np.where(high > end, high + margin, end)
        if _n_bytes(roomy_high - roomy_low) <= MAX_BYTES:
            low, high = roomy_low, roomy_high
        old = self._part(self._log_odds), self._part(self._marks)
        self._corner = low.astype(np.int64)
        shape = tuple((high - low).astype(np.int64)[::-1].tolist())
        self._log_odds, self._marks = _zeros(shape, np.float32), _zeros(shape, np.uint8)
        self._part(self._log_odds)[:], self._part(self._marks)[:] = old


def _zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return zeros in small pages: NumPy's are of 2 MB, and take memory where one of their cells is written."""
    is_private: dict[str, int] = {} if sys.platform == "win32" else {"flags": mmap.MAP_PRIVATE}
    cells = mmap.mmap(-1, math.prod(shape) * np.dtype(dtype).itemsize, **is_private)
    return np.frombuffer(cells, dtype).reshape(shape)


def check_map_size(n_cells: Floats, resolution: float) -> None:
    """Raise MapTooLargeError where so many columns and rows are more than a map may take."""
    if not _n_bytes(n_cells) <= MAX_BYTES:  # also where it is no number
        width, height = n_cells * resolution
        raise MapTooLargeError(
            f"an occupancy map may take {MAX_BYTES >> 30} GiB, and {width:,.0f} m by {height:,.0f} m in cells of "
            f"{resolution:g} m take more: choose larger cells (the resolution of OccupancyConfig) or a smaller "
            "range_max; if the place is not that large, the trajectory has gone astray"
        )


def _n_bytes(n_cells: Floats) -> float:
    return float(n_cells[0]) * float(n_cells[1]) * _CELL_BYTES


def log_odds_of(probability: float) -> float:
    """Return the log-odds of a probability."""
    return math.log(probability / (1.0 - probability))
