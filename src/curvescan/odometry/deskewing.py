"""Sweeps: scans as they are matched, with the motion during each sweep taken out as well as it is known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.deskew import WORTH_AGAIN, deskew, n_periods, predicted_velocity, sweep_shift, usual_period
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats, Pose

_N_STAMPS = 12

_HYSTERESIS = 0.02  # the period is taken anew when it changes by a larger share: stamps that jitter change nothing

_LONGEST = 1e15  # seconds: 30 million years, which can be counted in periods
_DIGITS = 3
"""Significant digits of the period: what is less than the hysteresis must not enter when it is taken anew either."""


class Deskewer(NamedTuple):
    """The clock of a stream of scans, and the velocity that a motion between two of them means; a new one each scan."""

    stamps: tuple[float, ...] = ()  # the last few stamps, seconds
    period: float = 0.0  # usual time between two scans, seconds; 0 where stamps do not tell
    elapsed: float = 0.0  # time from the scan before to the last one by their stamps, seconds
    seconds: float = 0.0  # the same as a whole number of periods, 0 of a pause
    n_steps: int = 1  # how many periods it took, 1 at the least; logs written in bursts begin with any step

    def ticked(self, stamp: float, scan_time: float = 0.0) -> Deskewer:
        """Return the deskewer at the time of the next scan."""
        stamps = (*self.stamps, stamp)[-_N_STAMPS:]
        elapsed = min(max(stamp - self.stamps[-1], -_LONGEST), _LONGEST) if self.stamps else 0.0
        period = usual_period(stamps, scan_time)
        if abs(period - self.period) <= _HYSTERESIS * self.period:
            period = self.period
        else:
            period = float(f"{period:.{_DIGITS}g}")
        n = n_periods(stamps, period) if period > 0.0 else 0
        n_steps = max(round(elapsed / period), 1) if len(stamps) == _N_STAMPS and period > 0.0 else 1
        return Deskewer(stamps=stamps, period=period, elapsed=elapsed, seconds=n * period, n_steps=n_steps)

    def velocity(self, motion: Pose) -> Floats:
        """Return the velocity, [vx, vy, omega], of a sensor that made a motion since the last scan."""
        return predicted_velocity(motion, self.seconds)

    def deskewed(self, scan: LaserScan, motion: Pose) -> LaserScan:
        """Return the scan, deskewed as if the sensor made a motion since the last."""
        return deskew(scan, self.velocity(motion)) if scan.time_increment != 0.0 else scan

    def is_worth_again(self, scan: LaserScan, expected: Pose, found: Pose) -> bool:
        """Return whether a motion that was found puts readings elsewhere than the expected one did."""
        error = self.velocity(se2.between(expected, found))
        return sweep_shift(scan, error) > WORTH_AGAIN


def deskewed_along(scans: Iterable[LaserScan], trajectory: Trajectory) -> Iterator[LaserScan]:
    """Yield scans deskewed with the motion of a trajectory, for maps."""
    deskewer, before = Deskewer(), None
    for scan, pose in zip(scans, trajectory.poses, strict=False):
        deskewer = deskewer.ticked(scan.stamp, scan.scan_time)
        yield deskewer.deskewed(scan, np.zeros(3) if before is None else se2.between(before, pose))
        before = pose
