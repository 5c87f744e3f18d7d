"""What is known of the pose before the map is looked at: an initial pose, or the last one moved by the odometry.

The pose is drawn from about the prior, or with a small probability from the whole map: a wrong initial pose, a sensor
that was carried away. A far place is thus less likely by a finite factor, which views outweigh in time.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.matchers.result import known_pose
from curvescan.se2.uncertain import UncertainPose, compose
from curvescan.slam.config import GATE
from curvescan.types import Bools, Cov, Floats, Points, Pose

INITIAL_COVARIANCE: Cov = np.diag(np.square([0.5, 0.5, math.radians(15)]))
"""Of an initial pose that comes without one, as AMCL's: 0.5 m and 15 deg."""

LOG_ODDS = 20.0
"""Log odds of one unit of agreement with the map."""

_WRONG = 0.01
"""Probability that a fix or an initial pose is wrong."""

_DOUBT = 0.1
"""Probability that a sensor was carried away unmeasured."""

_MOST = 3.0
"""The most that views on the way say of a track, in units of agreement: motions that seem sure may err too."""


class Prior(NamedTuple):
    """Where the sensor is, as far as it is known without the scan at hand."""

    here: UncertainPose
    astray: float = math.log(_WRONG)  # logarithm of the probability that it is anywhere else in the map

    @staticmethod
    def of(pose: ArrayLike, covariance: ArrayLike | None = None) -> Prior:
        """Return an initial pose that somebody gave; raises InvalidArgumentError where it is none."""
        given: Any = pose, INITIAL_COVARIANCE if covariance is None else covariance
        return Prior(here=known_pose(UncertainPose(*given), "initial_pose"))

    def moved(self, motion: UncertainPose, *, is_doubtful: bool) -> Prior:
        """Return the prior after a motion of the sensor; is_doubtful: whether no sure match measured it."""
        astray = math.exp(self.astray)
        doubted = math.log(astray + _DOUBT * (1.0 - astray)) if is_doubtful else self.astray
        return Prior(here=compose(self.here, motion), astray=doubted)

    def confirmed(self, here: UncertainPose, said: float) -> Prior:
        """Return the prior after a match where it was expected, and what the view says of that place."""
        return Prior(here=here, astray=max(self.astray - LOG_ODDS * max(said, 0.0), -LOG_ODDS * _MOST))

    def log_odds(self, poses: Pose, area: float) -> Floats:
        """Return (n,) log odds of poses (n, 3), against a sensor anywhere in a map of so many square metres."""
        off = poses - self.here.pose
        off[:, 2] = se2.wrap(off[:, 2])
        chi_square = np.einsum("ni,ij,nj->n", off, np.linalg.inv(self.here.covariance), off)
        # slips have a heavy tail: Student's t of three degrees of freedom, as a pose has
        volume = math.pi**2 * math.sqrt(27 * float(np.linalg.det(self.here.covariance))) / 4
        # as a share of the map's: a prior wider than the map says next to nothing
        share = min(volume / (2.0 * math.pi * max(area, 1.0)), 1.0)
        near = -math.log(share) - 3 * np.log1p(chi_square / 3)
        here = math.log(max(1.0 - math.exp(self.astray), 1e-9)) + near
        return np.asarray(np.logaddexp(here, self.astray))

    def is_near(self, places: Points) -> Bools:
        """Return (n,) whether places (n, 2) are about where the sensor is: they are looked at whatever others say."""
        off = places - self.here.pose[:2]
        return np.asarray(np.einsum("ni,ij,nj->n", off, np.linalg.inv(self.here.covariance[:2, :2]), off) < GATE)
