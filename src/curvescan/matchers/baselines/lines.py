"""Straight lines in a scan, by split-and-merge, and which of them a point belongs to.

Splitting is the iterative end point fit (Ramer 1972; Duda and Hart 1973): a stretch is cut where it lies farthest
from the chord of its ends. Merging joins neighbouring stretches that one line fits as well (Pavlidis and
Horowitz 1974; compared with others for laser scans by Nguyen et al., "A comparison of line extraction algorithms
using 2D laser rangefinder for indoor mobile robotics", IROS 2005). Each line is a total least squares fit.
"""

import math
from dataclasses import dataclass

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.baselines.config import LinesConfig
from curvescan.matchers.baselines.points import ScanPoints, fit_line
from curvescan.types import Floats, Ints, Points


@dataclass(frozen=True, eq=False)
class Lines:
    """Line segments of one scan."""

    centres: Points  # (s, 2): mean of each line's readings, sensor frame, metres
    directions: Points  # (s, 2): unit vector along each line, counter-clockwise as the sensor sees it
    extents: Floats  # (s, 2): where the line begins and ends, from its centre along its direction, metres
    # (s,): its readings: order[starts[k]:stops[k]] of the sweep
    starts: Ints
    stops: Ints

    def __len__(self) -> int:
        return int(self.starts.size)

    @property
    def normals(self) -> Points:
        """(s, 2) unit normals, towards the sensor's side by a quarter turn to the left of the direction."""
        return np.stack([-self.directions[:, 1], self.directions[:, 0]], axis=1)

    def readings(self, points: ScanPoints, line_idx: Ints) -> Ints:
        """Return the readings, of the sweep the lines were found in, that lie on some of them."""
        if line_idx.size == 0:
            return line_idx
        return np.concatenate([points.order[self.starts[k] : self.stops[k]] for k in line_idx])


def extract_lines(points: ScanPoints, config: LinesConfig) -> Lines:
    """Return the line segments of a sweep."""
    ordered = points.points[points.order]
    starts, stops = _split_and_merge(ordered, points.starts, points.stops, config.max_error)
    centres, directions, extents = _fit_all(ordered, starts, stops)
    keep = (stops - starts >= config.min_readings) & (np.ptp(extents, axis=1) >= config.min_length)
    return Lines(*(column[keep] for column in (centres, directions, extents, starts, stops)))


def nearest_lines(points: Points, lines: Lines, max_distance: float) -> tuple[Ints, Floats]:
    """Return (n,) the line nearest to each (n, 2) point, -1 for none near, and the squared distance to it, or inf."""
    return _nearest_lines(points, lines.centres, lines.directions, lines.extents, max_distance)


@kernel
def _worst(points: Points, start: int, stop: int) -> float:
    """Return the greatest normal distance of readings from their total least squares line."""
    cx, cy, ux, uy = fit_line(points, start, stop)
    worst = 0.0
    for k in range(start, stop):
        worst = max(worst, abs(ux * (points[k, 1] - cy) - uy * (points[k, 0] - cx)))
    return worst


@kernel
def _split_and_merge(points: Points, starts: Ints, stops: Ints, max_error: float) -> tuple[Ints, Ints]:
    """Split each surface with a stack of open stretches, merge each finished one with the one before it."""
    n = points.shape[0]
    found = np.empty((n, 2), dtype=np.int64)
    pending = np.empty(n + 1, dtype=np.int64)  # ends (inclusive) of stretches still to look at, last first
    n_found = 0
    for s in range(starts.size):
        first_of_surface = n_found
        begin = starts[s]
        pending[0] = stops[s] - 1
        n_pending = 1
        while n_pending > 0:
            end = pending[n_pending - 1]
            chord_x, chord_y = points[end, 0] - points[begin, 0], points[end, 1] - points[begin, 1]
            length = math.hypot(chord_x, chord_y)
            worst, at = 0.0, begin
            for k in range(begin + 1, end):
                dx, dy = points[k, 0] - points[begin, 0], points[k, 1] - points[begin, 1]
                distance = abs(chord_x * dy - chord_y * dx) / length if length > 0.0 else math.hypot(dx, dy)
                if distance > worst:
                    worst, at = distance, k
            if worst > max_error:
                pending[n_pending] = at
                n_pending += 1
                continue
            n_pending -= 1
            # the reading where it was split ends this stretch; the next begins after it
            start, stop = begin, end + 1
            begin = end + 1
            has_before = n_found > first_of_surface
            if has_before and _worst(points, found[n_found - 1, 0], stop) <= max_error:
                start = found[n_found - 1, 0]
                n_found -= 1
            found[n_found, 0], found[n_found, 1] = start, stop
            n_found += 1
    return found[:n_found, 0].copy(), found[:n_found, 1].copy()


@kernel
def _fit_all(points: Points, starts: Ints, stops: Ints) -> tuple[Points, Points, Floats]:
    """Return centre, direction and extent of each stretch."""
    n = starts.size
    centres, directions, extents = np.empty((n, 2)), np.empty((n, 2)), np.zeros((n, 2))
    for s in range(n):
        cx, cy, ux, uy = fit_line(points, starts[s], stops[s])
        centres[s, 0], centres[s, 1], directions[s, 0], directions[s, 1] = cx, cy, ux, uy
        for k in range(starts[s], stops[s]):
            along = ux * (points[k, 0] - cx) + uy * (points[k, 1] - cy)
            extents[s, 0] = min(extents[s, 0], along)
            extents[s, 1] = max(extents[s, 1], along)
    return centres, directions, extents


@kernel
def _nearest_lines(
    points: Points, centres: Points, directions: Points, extents: Floats, max_distance: float
) -> tuple[Ints, Floats]:
    """Compare each point with each line: a scan has a few tens of them."""
    n = points.shape[0]
    nearest = np.full(n, -1, dtype=np.int64)
    squared = np.full(n, np.inf)
    for i in range(n):
        best = max_distance * max_distance
        for s in range(centres.shape[0]):
            dx, dy = points[i, 0] - centres[s, 0], points[i, 1] - centres[s, 1]
            along = directions[s, 0] * dx + directions[s, 1] * dy
            across = directions[s, 0] * dy - directions[s, 1] * dx
            beyond = max(along - extents[s, 1], extents[s, 0] - along, 0.0)
            distance = across * across + beyond * beyond
            if distance <= best and distance < squared[i]:
                best = distance
                nearest[i] = s
                squared[i] = distance
    return nearest, squared
