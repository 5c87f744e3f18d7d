"""Which point of the reference a point of the current scan belongs to: the rules of IDC, PL-ICP and Cox.

All searches walk the reference's readings outwards from the point's own bearing and stop as soon as no farther
ray can hold anything nearer (the idea of Censi's jump tables, ICRA 2008, without the tables): exact, and short
once the scans lie close. Readings are a ring, so that full circles need no seam.
"""

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.baselines.points import ScanPoints
from curvescan.types import Bools, Floats, Ints, Points

_TWO_PI = 2.0 * math.pi
_TOUCH = 1e-9  # metres: a reading that is itself the least or greatest range of a surface is still on it


def nearest_readings(points: Points, reference: ScanPoints, max_distance: float) -> tuple[Ints, Floats]:
    """Return (n,) the reading nearest to each (n, 2) point, -1 for none, and the squared distance to it, or inf."""
    return _nearest_readings(points, reference.points, reference.angles, max_distance)


def closest_points(
    points: Points, reference: ScanPoints, window: float, max_distance: float
) -> tuple[Points, Floats, Ints]:
    """Return IDC's closest surface points to (n, 2) points, NaN for none, squared distances, where stretches begin."""
    return _surface_points(points, *_surfaces(reference), False, window, max_distance)


def matching_range_points(
    points: Points, reference: ScanPoints, window: float, max_distance: float
) -> tuple[Points, Floats, Ints]:
    """Return the points of the reference's surfaces, nearest in bearing, at each point's range: IDC's other rule."""
    return _surface_points(points, *_surfaces(reference), True, window, max_distance)


def _surfaces(reference: ScanPoints) -> tuple[Points, Floats, Floats, Bools]:
    return reference.points, reference.ranges, reference.angles, reference.is_joined


@kernel
def _first_at_or_after(angles: Floats, bearing: float) -> tuple[int, float]:
    """Return the index of the first of the ascending angles >= bearing, and the bearing it was compared as."""
    bearing -= _TWO_PI * math.floor((bearing - angles[0]) / _TWO_PI)
    low, high = 0, angles.size
    while low < high:
        middle = (low + high) // 2
        if angles[middle] < bearing:
            low = middle + 1
        else:
            high = middle
    return low, bearing


@kernel
def _index_on_the_way(m: int, start: int, step: int, way: int) -> tuple[int, float]:
    """Return the reading met at a step from `start` on, up (way 1) or down (-1), and the full turn it was met after."""
    k = start + step if way == 1 else start - 1 - step
    if k >= m:
        return k - m, _TWO_PI
    if k < 0:
        return k + m, -_TWO_PI
    return k, 0.0


@kernel
def _stretch_on_the_way(angles: Floats, start: int, step: int, way: int) -> tuple[int, int, float]:
    """Return both ends of the stretch met at a step, and the angle of the one that is met first."""
    k, turn = _index_on_the_way(angles.size, start, step, way)
    following = k + 1 if k + 1 < angles.size else 0
    if way == 1:
        return k, following, angles[k] + turn
    return k, following, angles[following] + (turn + _TWO_PI if following == 0 else turn)


@kernel
def _reach(squared: float, rho: float) -> float:
    """Return the turn beyond which every ray passes a point, at range rho, farther off than a squared distance."""
    if squared >= rho * rho:
        return math.pi
    return math.asin(math.sqrt(squared) / rho)


@kernel
def _nearest_readings(
    points: Points, ref_points: Points, ref_angles: Floats, max_distance: float
) -> tuple[Ints, Floats]:
    """Walk both ways until the next ray is farther from the point than the best reading so far."""
    n, m = points.shape[0], ref_angles.size
    nearest = np.full(n, -1, dtype=np.int64)
    squared = np.full(n, np.inf)
    for i in range(n):
        x, y = points[i, 0], points[i, 1]
        rho = math.hypot(x, y)
        start, bearing = _first_at_or_after(ref_angles, math.atan2(y, x))
        best = max_distance * max_distance
        reach = _reach(best, rho)
        for way in (1, -1):
            for step in range(m):
                k, turn = _index_on_the_way(m, start, step, way)
                if way * (ref_angles[k] + turn - bearing) > reach:
                    break
                dx, dy = ref_points[k, 0] - x, ref_points[k, 1] - y
                distance = dx * dx + dy * dy
                # a tie goes to the lower index, whichever way it was met
                if distance < best or (distance == best and (nearest[i] < 0 or k < nearest[i])):
                    best = distance
                    reach = _reach(best, rho)
                    nearest[i] = k
                    squared[i] = distance
    return nearest, squared


@kernel
def _share_along(x: float, y: float, begin: Points, end: Points, is_joined: bool) -> float:
    """Return where, 0 to 1, a stretch comes nearest to a point; at its beginning if the surface does not go on."""
    along_x, along_y = end[0] - begin[0], end[1] - begin[1]
    length2 = along_x * along_x + along_y * along_y
    if not is_joined or length2 <= 0.0:
        return 0.0
    return float(min(max(((x - begin[0]) * along_x + (y - begin[1]) * along_y) / length2, 0.0), 1.0))


@kernel
def _share_at_range(here: float, there: float, is_joined: bool) -> float:
    """Return where, 0 to 1, a stretch reaches a range, given by how far its ends lie beyond; -1 where it does not."""
    if not is_joined or (here * there > 0.0 and min(abs(here), abs(there)) > _TOUCH):
        return -1.0
    return min(max(here / (here - there), 0.0), 1.0) if here != there else 0.0


@kernel
def _surface_points(
    points: Points,
    ref_points: Points,
    ref_ranges: Floats,
    ref_angles: Floats,
    is_joined: Bools,
    by_range: bool,
    window: float,
    max_distance: float,
) -> tuple[Points, Floats, Ints]:
    """Walk both ways: to the nearest stretch, or by range to the first whose ranges enclose the point's own."""
    n, m = points.shape[0], ref_angles.size
    partners = np.full((n, 2), np.nan)
    squared = np.full(n, np.inf)
    ref_idx = np.full(n, -1, dtype=np.int64)
    for i in range(n):
        x, y = points[i, 0], points[i, 1]
        rho = math.hypot(x, y)
        start, bearing = _first_at_or_after(ref_angles, math.atan2(y, x))
        best = max_distance * max_distance
        # points at the same range lie a chord apart
        chord = 2.0 * math.asin(min(0.5 * max_distance / rho, 1.0)) if rho > 0.0 else math.pi
        reach = min(chord if by_range else _reach(best, rho), window)
        for way in (1, -1):
            # the stretch that begins before the bearing may end after it: it belongs to the way down
            for step in range(m):
                k, following, angle = _stretch_on_the_way(ref_angles, start, step, way)
                if way * (angle - bearing) > reach:
                    break
                if by_range:
                    share = _share_at_range(ref_ranges[k] - rho, ref_ranges[following] - rho, is_joined[k])
                else:
                    share = _share_along(x, y, ref_points[k], ref_points[following], is_joined[k])
                px = ref_points[k, 0] + share * (ref_points[following, 0] - ref_points[k, 0])
                py = ref_points[k, 1] + share * (ref_points[following, 1] - ref_points[k, 1])
                distance = (px - x) ** 2 + (py - y) ** 2
                is_tie = distance == best and (by_range or np.isinf(squared[i]))
                if share >= 0.0 and (distance < best or is_tie):
                    best = distance
                    partners[i, 0], partners[i, 1] = px, py
                    squared[i] = distance
                    ref_idx[i] = k
                    if not by_range:
                        reach = min(_reach(best, rho), window)
                    elif step > 0:
                        break
    return partners, squared, ref_idx
