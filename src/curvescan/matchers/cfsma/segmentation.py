"""CF-SMA1, first half: a sweep cut into segments by an adaptive breakpoint detector (section 2.1, eq. 2).

The detector is Borges and Aldon's, "Line extraction in 2D range images for mobile robotics", Journal of
Intelligent and Robotic Systems 40 (2004): the farther the reading and the wider the step, the larger the
gap that one surface may show.
"""

import math
from dataclasses import dataclass

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import SegmentationConfig
from curvescan.scan import Readings
from curvescan.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Segments:
    """Segments of one sweep, as slices of its readings in sweep order."""

    # (m,): index into the sweep's Readings; sweep order, begun at a breakpoint where the sweep is a full circle, so
    # that no segment is cut by the seam
    order: Ints
    # starts, stops: (s,): Segment k holds the readings order[starts[k]:stops[k]]; at least `min_readings` each.
    # Readings in no segment are isolated groups.
    starts: Ints
    stops: Ints

    def __len__(self) -> int:
        return int(self.starts.size)


def segment(readings: Readings, config: SegmentationConfig) -> Segments:
    """Return the segments of a sweep (eq. 2).

    Departure: a run of up to `max_gap` missing readings does not end a segment by itself; the paper does not say what
    a missing reading does. dphi is then the true angle between its two valid neighbours. One lost return no longer
    splits a wall into two functions.

    Departure: sweeps of a full circle join at the seam. The paper's sensor sees half a circle.
    """
    breaks = _breakpoints(
        readings.ranges,
        readings.angles,
        readings.points,
        readings.is_closed,
        (config.max_gap + 1.5) * readings.angle_step,
        config.incidence_limit,
        3.0 * config.range_sigma,
    )
    order, breaks = _from_first_break(breaks)
    starts = np.flatnonzero(breaks)
    stops = np.append(starts[1:], breaks.size) if starts.size else starts
    keep = stops - starts >= config.min_readings
    return Segments(order=order, starts=starts[keep], stops=stops[keep])


def _from_first_break(breaks: Bools) -> tuple[Ints, Bools]:
    order = np.arange(breaks.size)
    first = int(np.argmax(breaks)) if breaks.size else 0
    if first > 0:
        order, breaks = np.roll(order, -first), np.roll(breaks, -first)
    elif breaks.size and not breaks[0]:
        # a closed surface all around, a round room say: one segment, opened where the sweep starts
        breaks = breaks.copy()
        breaks[0] = True
    return order, breaks


@kernel
def _breakpoints(
    ranges: Floats,
    angles: Floats,
    points: Floats,
    is_closed: bool,
    widest_step: float,
    incidence_limit: float,
    noise_margin: float,
) -> Bools:
    """Return (m,) True where reading l does not continue the segment of reading l - 1 (eq. 2).

    Reading 0 follows the last one on a closed sweep and starts a segment on an open one.
    """
    n = ranges.size
    breaks = np.ones(n, dtype=np.bool_)
    for i in range(0 if is_closed else 1, n):
        before = i - 1 if i > 0 else n - 1
        step = angles[i] - angles[before]
        if i == 0:
            step += 2.0 * math.pi
        # a full circle of n + 1 beams measures its seam twice: a step of 0 or slightly less
        step = max(step, 0.0)
        if step > widest_step or step >= incidence_limit:
            continue
        gap = math.hypot(points[i, 0] - points[before, 0], points[i, 1] - points[before, 1])
        limit = ranges[before] * math.sin(step) / math.sin(incidence_limit - step) + noise_margin
        breaks[i] = gap > limit
    return breaks
