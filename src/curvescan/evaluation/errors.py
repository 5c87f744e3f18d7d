"""Errors of a trajectory against the true one, in the terms of Kümmerle et al. and of the paper.

R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009): the error of a
*relative* pose does not depend on what came before, as that of an absolute one does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.types import Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class TrajectoryErrors:
    """Errors of one trajectory.

    Attributes
    ----------
    step_translation : (n - 1,) float64
        Error of each motion from a scan to the next, metres.
    step_rotation : (n - 1,) float64
        Its absolute error in angle, radians.
    end_translation : float
        Distance of the last pose from the true one, metres, both seen from the first pose.
    end_rotation : float
        Absolute error in angle of the last pose, radians.
    path_length : float
        Length of the true path, metres.
    """

    step_translation: Floats
    step_rotation: Floats
    end_translation: float
    end_rotation: float
    path_length: float

    @property
    def drift(self) -> float:
        """End error as a share of the path; NaN for a path of no length."""
        return self.end_translation / self.path_length if self.path_length > 0.0 else float("nan")


def trajectory_errors(poses: Pose, true_poses: Pose) -> TrajectoryErrors:
    """Return the errors of poses against the true ones, scan by scan.

    Parameters
    ----------
    poses, true_poses : (n, 3) float64
        One row a scan, each trajectory in a frame of its own; n >= 2, no NaN.

    Raises
    ------
    InvalidArgumentError
        When the shapes differ or there are fewer than two poses.
    """
    if poses.shape != true_poses.shape or poses.ndim != 2 or len(poses) < 2:
        raise InvalidArgumentError(
            "errors need two trajectories of the same shape (n, 3), n >= 2, "
            f"got {poses.shape} and {true_poses.shape}"
        )
    motions = se2.between(poses[:-1], poses[1:])
    true_motions = se2.between(true_poses[:-1], true_poses[1:])
    step = se2.between(true_motions, motions)
    end = se2.between(se2.between(true_poses[0], true_poses[-1]), se2.between(poses[0], poses[-1]))
    return TrajectoryErrors(
        step_translation=np.hypot(step[:, 0], step[:, 1]),
        step_rotation=np.abs(step[:, 2]),
        end_translation=float(np.hypot(end[0], end[1])),
        end_rotation=float(abs(end[2])),
        path_length=float(np.hypot(true_motions[:, 0], true_motions[:, 1]).sum()),
    )
