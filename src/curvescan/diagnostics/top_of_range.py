"""Readings that are no geometry: codes for *no reading* that a log does not declare, a rim, the robot itself.

Some drivers report a number where nothing came back, and not always the same one (51.05 to 51.16 m in one log). As
readings they become arcs in the map, and hold the odometry back, as they move and turn with the sensor. A real surface
is seen at many distances as the sensor moves; a code stays where it is and comes from beams all around.
"""

from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvescan.io.log import Log
from curvescan.scan import LaserScan, without_readings
from curvescan.types import Bools, Floats, Ints

BIN = 0.05  # width of the bins in which readings are counted, metres
_N_BINS = 2048  # readings beyond the last bin, 102 m, are not counted: no common 2D laser reaches farther
_BAND = 0.01  # share of the largest reading that is its band: a code is rounded, not noisy
_BELOW = 0.10  # share of the largest reading down to which the band is compared with what lies below it
_MIN_SHARE = 0.002  # least share of all readings in the band: fewer leave no arcs in a map
_MIN_BEAMS = 0.5
"""Least share of the beams that have been in the band: the far end of a room is seen by fewer, from one place."""
_STRAYS = 0.0005  # share of the largest readings that may lie above the band: single wrong ones
_WIDTHS, _LOOSE_WIDTHS = (1, 2, 5, 10), (1, 2, 5, 10, 20)  # of a ring, bins: of any readings, of those of no surface
_TIMES = (
    4  # how much denser a ring is than what lies beside it; in 17 real logs without codes no band is twice as dense
)
_ONE_IN, _MIN_SCANS = 50, 20  # a ring has one reading in so many at least, in so many scans: fewer moved no drive
_N_ARC, _N_PROBED = (5, 20), 2_000  # neighbouring readings that tell an arc from a line; scans that are asked
_N_SURFACE, _LOOSE_IN = 4, 3  # neighbouring readings of a surface; readings of a ring, of which one is of no surface


class Ring(NamedTuple):
    """Readings that stay at one range in all directions: from low to high, metres; share of all readings."""

    low: float
    high: float
    share: float
    is_loose: bool  # whether only readings of no surface belong to it

    def without(self, scan: LaserScan) -> LaserScan:
        """Return a scan in which they are no readings."""
        inside = scan.valid & (scan.ranges >= self.low) & (scan.ranges <= self.high)
        if self.is_loose and inside.any():
            inside &= _is_loose(scan)
        return without_readings(scan, inside)


class TopOfRange:
    """Counts readings by distance and beam, in memory that does not grow with the log."""

    def __init__(self) -> None:
        self.counts, self._loose = np.zeros((2, _N_BINS, 0), dtype=np.int32)  # (m, n): by range and by beam
        self._n_scans = 0

    def add(self, scan: LaserScan) -> None:
        """Count the valid readings of one scan."""
        self._n_scans += 1
        n_more = len(scan) - self.counts.shape[1]
        if n_more > 0:
            self.counts, self._loose = (np.pad(c, ((0, 0), (0, n_more))) for c in (self.counts, self._loose))
        beams = np.flatnonzero(scan.valid & (scan.ranges < BIN * _N_BINS))
        bins = (scan.ranges[beams] / BIN).astype(np.int64)
        self.counts[bins, beams] += 1
        self._loose[bins, beams] += _is_loose(scan)[beams]

    def code_band(self) -> tuple[float, float, float] | None:
        """Return the band at the top of the range that looks like codes for no reading; None without."""
        counts = self.counts.sum(axis=1, dtype=np.int64)
        total = int(counts.sum())
        if not total:
            return None
        above = np.cumsum(counts[::-1])[::-1]
        top = int(np.flatnonzero(above > _STRAYS * total)[-1])
        band = slice(max(int((1.0 - _BAND) * top) - 1, 0), top + 1)
        below = slice(int((1.0 - _BELOW) * top), band.start)
        n_band, n_below = int(counts[band].sum()), int(counts[below].sum())
        n_beams = self.counts.shape[1]
        seen_by = int(np.count_nonzero(self.counts[band].any(axis=0)))
        if n_band < _MIN_SHARE * total or n_band <= n_below or seen_by < _MIN_BEAMS * n_beams:
            return None
        filled: Floats = np.flatnonzero(counts[band]).astype(np.float64) + band.start
        return float(filled[0]) * BIN, float(filled[-1] + 1.0) * BIN, n_band / total

    def ring(self) -> Ring | None:
        """Return the readings that stay at one range in all directions; None without."""
        total = int(self.counts.sum())
        for counts, widths in ((self.counts, _WIDTHS), (self._loose, _LOOSE_WIDTHS)):
            low, n = _densest(counts, widths, total)
            n_inside = int(counts[low : low + n].sum())
            # a wall's readings may be loose by noise: of a code, so are most
            if n and self._n_scans >= _MIN_SCANS and _LOOSE_IN * n_inside >= int(self.counts[low : low + n].sum()):
                # what is rounded lies on the edge of a bin
                return Ring((low - 0.5) * BIN, (low + n + 0.5) * BIN, n_inside / total, counts is self._loose)
        return None


def runs_of(mask: Bools) -> Ints:
    """Return (k, 2) where each run of True in (n,) begins, and where it has ended."""
    return np.flatnonzero(np.diff(np.pad(mask.astype(np.int8), 1))).reshape(-1, 2)


def nearest_line(angles: Floats, ranges: Floats) -> tuple[float, float]:
    """Return x and y of the line nearest to readings, 1 / range = x cos(angle) + y sin(angle)."""
    x, y = np.linalg.lstsq(np.column_stack((np.cos(angles), np.sin(angles))), 1.0 / ranges)[0].tolist()
    return x, y


def is_of_walls(log: Log, band: tuple[float, float]) -> bool:
    """Return whether most readings of a band of ranges lie on straight lines rather than on circles about the sensor.

    A robot that turns on the spot sees a wall at one distance with all of its beams. A code is no wall: to arcs of its
    readings a circle fits better than a line, and single ones are no arc.
    """
    n_inside = n_straight = 0
    for scan in islice(log, 0, None, max(len(log) // _N_PROBED, 1)):
        inside = scan.valid & (scan.ranges >= band[0]) & (scan.ranges <= band[1])
        n_inside += int(np.count_nonzero(inside))
        ends = runs_of(inside)
        for a, b in ends[ends[:, 1] - ends[:, 0] >= _N_ARC[0]].tolist():
            for arc in np.array_split(np.arange(a, b), -((a - b) // _N_ARC[1])):
                angles, ranges, n = scan.angles[arc], scan.ranges[arc], len(arc)
                x, y = nearest_line(angles, ranges)
                by_line = 1.0 / (x * np.cos(angles) + y * np.sin(angles))
                of_line, of_circle = np.sum((ranges - by_line) ** 2), np.sum((ranges - ranges.mean()) ** 2)
                n_straight += n if of_line / (n - 2) < of_circle / (n - 1) else 0
    return 2 * n_straight > n_inside


def _densest(counts: NDArray[np.int32], widths: tuple[int, ...], total: int) -> tuple[int, int]:
    """Return first bin and width of the band that stands out most from what lies beside it; a width of 0 without."""
    cumulated = np.vstack([np.zeros_like(counts[:1]), np.cumsum(counts, axis=0, dtype=np.int64)])
    sums, best, found = cumulated.sum(axis=1), float(_TIMES), (0, 0)
    n_seeing = int(np.count_nonzero(cumulated[-1]))
    for n in widths:
        side = max(n // 2, 2)
        low = np.arange(side, len(counts) - n - side)
        inside = sums[low + n] - sums[low]
        beside = np.maximum(sums[low] - sums[low - side], sums[low + n + side] - sums[low + n]) / side
        times = inside / n / np.maximum(beside, 1.0 / side)
        for k in np.flatnonzero((inside * _ONE_IN >= total) & (5 * inside <= 2 * total) & (times >= best)):
            of_beams = cumulated[low[k] + n] - cumulated[low[k]]
            # a beam that sees nothing else looks at what stands where the sensor stands
            tells = (2 * n_seeing * of_beams >= inside[k]) & (10 * of_beams <= 9 * cumulated[-1])
            if times[k] >= best and 2 * np.count_nonzero(tells) >= n_seeing:
                best, found = float(times[k]), (int(low[k]), n)
    return found


def _is_loose(scan: LaserScan) -> Bools:
    """Return (n,) whether a reading is of no surface: one of fewer than four side by side at no steep slope."""
    ranges = np.where(scan.valid, scan.ranges, np.inf)
    nearer = np.minimum(ranges[1:], ranges[:-1])
    with np.errstate(invalid="ignore"):
        joins = np.abs(ranges[1:] - ranges[:-1]) <= BIN + nearer * abs(scan.angle_increment)
    pieces = np.concatenate([[0], np.cumsum(~joins)])
    loose: Bools = np.bincount(pieces)[pieces] < _N_SURFACE
    return loose
