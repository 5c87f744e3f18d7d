"""The prior: what is known of a pose before the scans are compared, as log odds beside the prior of knowing nothing.

One prior in twenty is wrong, as wheels slip and robots are carried. Then the scans may have nothing in common or lie
anywhere within the wide prior about the same place. So a narrow prior gains where it is right, and costs nothing
elsewhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import SAME, SURE_SIGMAS
from curvescan.matchers.result import WIDE_PRIOR, WIDE_SIGMA
from curvescan.types import Cov, Floats, Pose, UncertainPose

_WRONG = 0.05  # share of priors that are wrong
_WIDE_PRECISION = tuple(sigma**-2 for sigma in WIDE_SIGMA)
_MATCHED = np.diag(np.square(0.5 * SAME * np.array([1.0, 1.0, 0.5])))  # covariance of a matched pose: metres, radians
_MAX_CHI2 = SURE_SIGMAS * SURE_SIGMAS  # of the wide prior: farther off is no less likely
TOLD = 2.0  # log odds from which on the prior itself says where the pose is


class Prior(NamedTuple):
    """Where the current scan is expected in the reference, and how surely."""

    pose: Pose
    precision: Cov  # (3, 3) inverse covariance of what a matched pose differs from `pose` by
    gain: float  # odds that it is right and not wrong, at its best; 0 for the wide prior

    @classmethod
    def of(cls, known: UncertainPose) -> Prior:
        """Return a prior ready to be asked."""
        precision, determinant = inverse(known.cov)
        narrower = math.prod(WIDE_SIGMA) / math.sqrt(determinant)
        return cls(known.pose, precision, 1.0 / (_WRONG + 1.0 / (narrower - 1.0)) if narrower > 1.0 else 0.0)

    def nearest_along(self, pose: Pose, direction: Pose, reach: float) -> Pose:
        """Return the pose that is expected most of those that lie up to `reach` along a direction from a pose."""
        x, y, turn = (pose - self.pose).tolist()
        off = np.array([x, y, math.remainder(turn, 2.0 * math.pi)])
        along = self.precision @ direction
        steps = min(max(-float(along @ off) / float(along @ direction), -reach), reach)
        nearest: Pose = pose + steps * direction
        return nearest

    @property
    def is_told(self) -> bool:
        """Whether the prior says where the pose is, and not only where it may be."""
        return math.log1p(self.gain) > TOLD


def inverse(cov: Cov) -> tuple[Cov, float]:
    """Return the inverse of a covariance, of a matched pose added, and the determinant of the sum; by cofactors."""
    (a, b, c), (d, e, f), (g, h, i) = (cov + _MATCHED).tolist()
    first = e * i - f * h, f * g - d * i, d * h - e * g
    second, third = (h * c - i * b, i * a - g * c, g * b - h * a), (b * f - c * e, c * d - a * f, a * e - b * d)
    determinant: float = a * first[0] + b * first[1] + c * first[2]
    return np.array([*zip(first, second, third, strict=True)]) / determinant, determinant


@kernel
def log_odds(poses: Floats, prior: Prior) -> tuple[Floats, Floats]:
    """Return (k,) log odds of (k, 3) poses beside the best of the wide prior: by a prior, and if it is wrong."""
    found, found_wide = np.empty(poses.shape[0]), np.empty(poses.shape[0])
    expected, precision, off = prior.pose, prior.precision, np.empty(3)
    for k in range(poses.shape[0]):
        off[0], off[1] = poses[k, 0] - expected[0], poses[k, 1] - expected[1]
        turn = poses[k, 2] - expected[2]
        off[2] = turn - 2.0 * math.pi * np.rint(turn / (2.0 * math.pi))
        chi2, wide = 0.0, 0.0
        for i in range(3):
            wide += _WIDE_PRECISION[i] * off[i] * off[i]
            for j in range(3):
                chi2 += off[i] * precision[i, j] * off[j]
        found_wide[k] = -0.5 * min(wide, _MAX_CHI2)
        found[k] = math.log(prior.gain * math.exp(-0.5 * chi2) + math.exp(found_wide[k]))
    return found, found_wide


@inlined
def tells(prior: Prior, poses: Floats) -> bool:
    """Return whether the prior itself says that the scan is at the first of some poses."""
    return bool(poses.shape[0] > 0 and log_odds(poses[:1], prior)[0][0] > TOLD)


WIDE = Prior.of(WIDE_PRIOR)
"""Of knowing nothing."""
