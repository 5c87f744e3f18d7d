"""How much the graph speaks for a pose: its density there, against a wrong match, which may lie anywhere nearby."""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan.types import Cov, Pose

_ANYWHERE_M = 10.0
"""Standard deviation of where matches of other places lie, metres. Their headings are those of the walls, and tell
nothing."""

SLIP: Cov = np.diag(np.square([10.0, 10.0, 0.3]))
"""(3, 3) covariance of what a way may have slipped and bent without the odometry noticing."""

_SLIP_ODDS = -9.0
"""Log odds of such a slip on the way between two keyframes."""


def difference(one: Pose, other: Pose) -> Pose:
    """Return the second pose minus the first, angles wrapped."""
    off = other - one
    off[2] = se2.wrap(off[2])
    return off


def expectation_of(off: Pose, cov: Cov) -> float:
    """Return the log odds of a pose that differs from where the graph expects it, as it is or after a slip.

    Nothing is gained along a direction that is not measured, as `cov` is wide there.

    off (3,); cov (3, 3): of the graph and the match together.
    """
    return max(_log_odds(off, cov), _SLIP_ODDS + _log_odds(off, cov + SLIP))


def _log_odds(off: Pose, cov: Cov) -> float:
    gained = float(np.linalg.slogdet(np.eye(2) + _ANYWHERE_M**2 * np.linalg.inv(cov[:2, :2]))[1])
    distance = float(off @ np.linalg.solve(cov, off))
    return 0.5 * (gained - distance) if math.isfinite(distance) else -math.inf
