"""CF-SMA1, second half: the adaptive curvature function of each segment (section 2.1, eqs. 3-5).

From each reading one walks forward while the arc stays as long as its chord, within a tolerance: far on a
wall, to the corner at a corner. The direction of that chord, and how it turns from a reading to the next, is
the curvature function: a peak is a corner and its height the angle, a flat stretch an arc, zero a line.
"""

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import CurvatureConfig
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats, Ints, Points


def curvature_functions(points: Points, starts: Ints, stops: Ints, config: CurvatureConfig) -> tuple[Floats, Ints]:
    """Return the curvature index eta of every reading and how far its walk reached (eqs. 3-5).

    Both are invariant to rotation and translation of the sensor.

    Departure: eq. 4 prints atan(dx / dy); atan2(dy, dx) of the same chord is taken, so that the quadrant is right and
    theta turns counter-clockwise. Only differences of theta enter, so the constant offset between the two conventions
    is of no effect; without the quadrant, corners would show as steps of pi.

    Departure: a walk that the end of the segment cuts short has not used up its tolerance, and the last chords of a
    segment are as short as one step, where noise turns them by tens of degrees. eta is 0 from the first such reading
    on. It removes false peaks at the end of every segment and with them half of the wrong pairs: on simulated offices
    the share of matches within 0.1 m and 2 degrees rose from 58 to 68 %.

    points (m, 2); starts, stops (s,); eta (m,); reach (m,).
    """
    return _curvature(points, starts, stops, config.arc_tolerance)


@kernel
def _curvature(points: Points, starts: Ints, stops: Ints, tolerance: float) -> tuple[Floats, Ints]:
    """Walk each segment once: eqs. 3, 4 and 5.

    The end of the walk never moves back when its start moves on (a part of a polyline wastes no more than
    the whole), so both ends only advance and the cost is linear in the readings.
    """
    n = points.shape[0]
    eta = np.zeros(n)
    reach = np.zeros(n, dtype=np.int64)
    for s in range(starts.size):
        last = stops[s] - 1
        end = starts[s]
        arc = 0.0
        theta_before = 0.0
        for i in range(starts[s], last):
            if end < i + 1:
                end = i + 1
                arc = math.hypot(points[end, 0] - points[i, 0], points[end, 1] - points[i, 1])
            while end < last:
                step = math.hypot(points[end + 1, 0] - points[end, 0], points[end + 1, 1] - points[end, 1])
                chord = math.hypot(points[end + 1, 0] - points[i, 0], points[end + 1, 1] - points[i, 1])
                if arc + step - chord >= tolerance:
                    break
                arc += step
                end += 1
            reach[i] = end - i
            theta = math.atan2(points[end, 1] - points[i, 1], points[end, 0] - points[i, 0])
            if i > starts[s]:
                eta[i - 1] = wrap_angle(theta - theta_before)
            if end == last:
                reach[i:last] = last - np.arange(i, last)
                break
            theta_before = theta
            arc -= math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
    return eta, reach
