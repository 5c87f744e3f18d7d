"""The floor, as a tilted laser sees it: readings on one line of the sensor frame, beyond which it never sees.

The line moves and turns with the sensor: along a bare corridor it says surely that the robot stands. A wall that a
robot follows is such a line too, but where the robot turns, the wall does not turn with it.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvescan import se2
from curvescan.diagnostics.rotation_direction import turn_between
from curvescan.diagnostics.top_of_range import nearest_line, runs_of
from curvescan.matchers import match
from curvescan.scan import LaserScan, without_readings
from curvescan.types import Bools, Floats

_STEP, _FINE_STEP = np.radians((5.0, 0.5))  # directions of the line that are tried, and around the best of them
_N_BESIDE, _N_LINES = 4, 4  # directions on either side among which a line is the clearest; lines that are looked at
_OBLIQUE = math.cos(math.radians(60.0))  # how far off the nearest point of the line beams may look
_RATIO = 1.02  # of distances from bin to bin
_WIDTHS = (2, 4, 8, 12)  # of the band of its readings, bins: lasers are noisy, and robots pitch
_LEAST_WIDTH = 0.1  # of the band, metres
_TIMES = 2.5  # how much denser the band is than what lies before it
_MIN_SHARE = 0.002  # least share of all readings in the band: fewer hold no odometry
_BEYOND = 0.05  # readings beyond the line for one in the band, at most
_MIN_ARC = 8  # neighbouring readings that tell how the line runs
_SECONDS = (0.15, 0.6)  # between scans that are compared
_TURNS = np.radians((4.0, 20.0))  # that tell: after more, another wall is where one was
_MIN_TURNS, _N_TURNS = 10, 30  # turns that tell, at least and at most
_KEPT = 0.7  # least share of them with which the line turns


class Floor(NamedTuple):
    """Readings of the floor: on a line of the sensor frame."""

    distance: float  # of the line, metres
    direction: float  # from the sensor to the nearest point of it, radians
    depth: float  # how much nearer than the line its readings lie, share of the distance
    share: float  # of all readings

    def reached(self, scan: LaserScan) -> Bools:
        """Return (n,) which readings of a scan lie on the line or beyond."""
        along = np.where(scan.valid, scan.ranges, 0.0) * np.cos(scan.angles - self.direction)
        found: Bools = along > (1.0 - self.depth) * self.distance
        return found

    def without(self, scan: LaserScan) -> LaserScan:
        """Return a scan in which they are no readings."""
        return without_readings(scan, self.reached(scan))


def find_lines(counts: NDArray[np.int32], width: float, angles: Floats) -> list[Floor]:
    """Return lines beyond which a sensor hardly sees, those that stand out most first.

    counts (m, n): readings by bins of the range, `width` metres wide, and by beam; angles (n,): of the beams.
    """
    rows, beams = np.nonzero(counts)
    seen = (np.log((rows + 0.5) * width), angles[beams], counts[rows, beams].astype(np.float64))
    around = [_densest(*seen, direction) for direction in np.arange(-math.pi, math.pi, _STEP).tolist()]
    found = []
    for k, (times, floor) in enumerate(around):
        beside = [around[(k + step) % len(around)][0] for step in range(-_N_BESIDE, _N_BESIDE + 1)]
        if floor is not None and times == max(beside):
            finer = floor.direction + np.arange(-_STEP, _STEP, _FINE_STEP)
            found.append(max((_densest(*seen, direction) for direction in finer.tolist()), key=lambda one: one[0]))
    return [floor for _, floor in sorted(found, key=lambda one: -one[0])[:_N_LINES] if floor is not None]


def _densest(ranges: Floats, angles: Floats, n: Floats, direction: float) -> tuple[float, Floor | None]:
    """Return how far the line that stands out most across a direction does, and that line; 0 and None without.

    ranges (m,): logarithms; angles (m,); n (m,): readings there.
    """
    cosines = np.cos(angles - direction)
    ahead = cosines > _OBLIQUE
    bins = ((ranges[ahead] + np.log(cosines[ahead])) / math.log(_RATIO)).astype(np.int64)
    first = int(bins.min(initial=0))
    up_to = np.concatenate(([0.0], np.cumsum(np.bincount(bins - first, n[ahead]))))
    total, best, found = float(n.sum()), 0.0, None
    for width in _WIDTHS:
        low = np.arange(width, len(up_to) - width)
        inside, before = up_to[low + width] - up_to[low], up_to[low] - up_to[low - width]
        distances, depth = _RATIO ** (first + low + width), 1.0 - _RATIO**-width
        times = inside / (before + 0.5 * _MIN_SHARE * total)  # few before are chance
        is_line = (inside > _TIMES * before) & (inside > _MIN_SHARE * total) & (depth * distances > _LEAST_WIDTH)
        is_line &= up_to[-1] - up_to[low + width] < _BEYOND * inside
        k = int(np.argmax(np.where(is_line, times, 0.0))) if len(low) else 0
        if is_line[k : k + 1].any() and times[k] > best:
            best, found = float(times[k]), Floor(float(distances[k]), direction, depth, float(inside[k]) / total)
    return best, found


def moves_along(scans: Iterable[LaserScan], floor: Floor) -> bool:
    """Return whether a line stays where it is in the sensor frame while the sensor turns: a wall would turn."""
    earlier, before = None, math.nan  # the scan that later ones are compared with, and the direction of the line in it
    n_turns = n_kept = 0
    for scan in scans:
        if n_turns == _N_TURNS:
            break
        seconds = math.inf if earlier is None else scan.stamp - earlier.stamp
        if 0.0 < seconds < _SECONDS[0]:
            continue
        after, turn = _direction(scan, floor), math.nan
        if earlier is not None and math.isfinite(before + after):
            views = floor.without(earlier), floor.without(scan)
            # what seems to turn may be a wall that comes nearer
            turn = abs(float(match(*views).pose[2])) if abs(turn_between(*views)) >= _TURNS[0] else 0.0
            if _TURNS[0] <= turn <= _TURNS[1]:
                n_turns += 1
                n_kept += bool(abs(se2.wrap(after - before)) < 0.5 * turn)
        if not (turn < _TURNS[0] and 0.0 < seconds < _SECONDS[1]):
            earlier, before = scan, after
    return n_turns >= _MIN_TURNS and n_kept >= _KEPT * n_turns


def _direction(scan: LaserScan, floor: Floor) -> float:
    """Return the direction of the line by the longest arc of a scan on it; NaN without."""
    reached = floor.reached(scan)
    ends = runs_of(reached).tolist() if np.count_nonzero(reached) >= _MIN_ARC else []
    a, b = max(ends, key=lambda run: run[1] - run[0], default=(0, 0))
    if b - a < _MIN_ARC:
        return math.nan
    x, y = nearest_line(scan.angles[a:b], scan.ranges[a:b])
    return math.atan2(y, x)
