"""Errors of a trajectory against reference poses: truth, or what a SLAM system made of the same log."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.relations import Association, associate, span_of
from curvescan.evaluation.trajectory_errors import (
    RelativeErrors,
    Spread,
    TrajectoryErrors,
    align,
    ate,
    rpe,
    trajectory_errors,
)
from curvescan.io.reading import PoseFile
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class ReferenceErrors:
    """Errors of the poses that have a reference, in the order of the trajectory."""

    # known poses of the trajectory and of the reference
    n_poses: int
    n_reference: int
    association: Association  # which belongs to which
    stamps: Floats  # (n,): of the trajectory, seconds
    poses: Pose  # (n, 3): the trajectory, moved onto the reference by the best alignment
    from_first: Pose  # (n, 3): the trajectory, moved so that the first poses are equal
    reference: Pose  # (n, 3): reference poses of the sensor
    # (n,): absolute trajectory error after the two alignments, metres
    ate_best: Floats
    ate_first: Floats
    # relative pose errors from one pair to the next, and over each metre of the reference's path
    rpe_frame: RelativeErrors
    rpe_metre: RelativeErrors
    totals: TrajectoryErrors  # error at the end, path, turns, drift
    # whether a pose of the laser on the robot was given, and the reference holds poses of the laser already
    is_mount_unused: bool = False

    def __repr__(self) -> str:
        best = Spread.of(self.ate_best)
        return f"ReferenceErrors({best.n:,} poses over {self.totals.path_length:.1f} m, ATE {best.rmse:.4f} m rms)"


def reference_errors(
    trajectory: Trajectory, reference: PoseFile, laser_pose: ArrayLike = (0.0, 0.0, 0.0), *, tolerance: float = 0.01
) -> ReferenceErrors:
    """Return the errors of a sensor's trajectory against reference poses. laser_pose (3,)."""
    own, other = _known(trajectory), _known(reference.trajectory)
    pairs = associate(own.stamps, other.stamps, tolerance=tolerance)
    if len(pairs) < 2:
        raise InvalidArgumentError(
            f"errors need two poses with a reference within {tolerance:g} s, got {len(pairs)}: the trajectory's stamps "
            f"run {span_of(own.stamps)}, the reference's {span_of(other.stamps)}"
        )
    poses, goal = own.poses[pairs.first], other.poses[pairs.second]
    if not reference.is_of_sensor:
        goal = se2.compose(goal, laser_pose)
    return ReferenceErrors(
        n_poses=len(own),
        n_reference=len(other),
        association=pairs,
        stamps=own.stamps[pairs.first],
        poses=align(poses, goal, "best"),
        from_first=align(poses, goal, "first"),
        reference=goal,
        ate_best=ate(poses, goal, "best"),
        ate_first=ate(poses, goal, "first"),
        rpe_frame=rpe(poses, goal),
        rpe_metre=rpe(poses, goal, delta=1.0, unit="metres"),
        totals=trajectory_errors(poses, goal),
        is_mount_unused=reference.is_of_sensor and bool(np.any(laser_pose)),
    )


def _known(trajectory: Trajectory) -> Trajectory:
    known = ~np.isnan(trajectory.poses).any(axis=1)
    if not known.any():
        raise InvalidArgumentError("a trajectory needs a pose that is known, got NaN alone")
    return Trajectory(stamps=trajectory.stamps[known], poses=trajectory.poses[known])
