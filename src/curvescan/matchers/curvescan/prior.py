"""The prior: what is known of a pose before the scans are compared, as log odds beside the prior of knowing nothing.

One prior in twenty is wrong, as wheels slip and robots are carried. Then the scans may have nothing in common or lie
anywhere within the wide prior about the same place. So a narrow prior gains where it is right, and costs nothing
elsewhere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import SAME, SURE_SIGMAS
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.matchers.result import WIDE_PRIOR, WIDE_SIGMA
from curvescan.se2.uncertain import inverse3
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
        cov = known.covariance + _MATCHED
        precision = inverse3(cov)
        (a, b, _), (_, c, _), _ = cov.tolist()
        determinant = (a * c - b * b) / float(precision[2, 2])  # of cov, as by cofactors
        narrower = math.prod(WIDE_SIGMA) / math.sqrt(determinant)
        return cls(known.pose, precision, 1.0 / (_WRONG + 1.0 / (narrower - 1.0)) if narrower > 1.0 else 0.0)

    def nearest_along(self, pose: Pose, direction: Pose, reach: float) -> Pose:
        """Return the pose that is expected most of those that lie up to `reach` along a direction from a pose."""
        off = np.array(difference(pose, self.pose))
        along = self.precision @ direction
        steps = min(max(-float(along @ off) / float(along @ direction), -reach), reach)
        return np.asarray(pose + steps * direction)

    @property
    def is_told(self) -> bool:
        """Whether the prior says where the pose is, and not only where it may be."""
        return math.log1p(self.gain) > TOLD


@kernel
def log_odds(poses: Floats, prior: Prior) -> tuple[Floats, Floats]:
    """Return (k,) log odds of (k, 3) poses beside the best of the wide prior: by a prior, and if it is wrong."""
    found, found_wide = np.empty(poses.shape[0]), np.empty(poses.shape[0])
    for k in range(poses.shape[0]):
        off = difference(poses[k], prior.pose)
        chi2, wide = 0.0, 0.0
        for i in range(3):
            wide += _WIDE_PRECISION[i] * off[i] * off[i]
            for j in range(3):
                chi2 += off[i] * prior.precision[i, j] * off[j]
        found_wide[k] = -0.5 * min(wide, _MAX_CHI2)
        found[k] = math.log(prior.gain * math.exp(-0.5 * chi2) + math.exp(found_wide[k]))
    return found, found_wide


WIDE = Prior.of(WIDE_PRIOR)
"""Of knowing nothing."""
