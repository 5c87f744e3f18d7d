"""Errors of a trajectory against the true one: step by step, absolute (ATE) and relative (RPE), and drift.

J. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (IROS 2012), for ATE and RPE, with the
definitions of the program evo, so that figures can be compared. R. Kümmerle et al., "On measuring the accuracy of SLAM
algorithms", Autonomous Robots 27 (2009): the error of a *relative* pose does not depend on what came before, as that of
an absolute one does.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, require
from curvescan.types import Floats, Ints, Pose

Alignment: TypeAlias = Literal["best", "first"]
"""How two frames are brought together: the motion with the least squared distances, or the first poses made equal."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Figures of a set of errors, in their unit; NaN where there are none."""

    n: int  # how many
    # mean, standard deviation (of the set itself: divided by n), median, root of the mean square, largest
    mean: float
    std: float
    median: float
    rmse: float
    max: float

    @classmethod
    def of(cls, values: Floats) -> "Spread":
        """Return the figures of values of any shape, none of them NaN."""
        if values.size == 0:
            nan = float("nan")
            return cls(n=0, mean=nan, std=nan, median=nan, rmse=nan, max=nan)
        return cls(
            n=int(values.size),
            mean=float(values.mean()),
            std=float(values.std()),
            median=float(np.median(values)),
            rmse=float(np.sqrt(np.mean(values**2))),
            max=float(values.max()),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class RelativeErrors:
    """Errors of the motion between pairs of poses."""

    # (n,): indices of the poses of each pair
    start: Ints
    stop: Ints
    translation: Floats  # (n,): distance between where the motion ends and where it should, metres
    rotation: Floats  # (n,): its absolute error in angle, radians


@dataclass(frozen=True, eq=False, kw_only=True)
class TrajectoryErrors:
    """Errors of one trajectory."""

    step_translation: Floats  # (n - 1,): error of each motion from a scan to the next, metres
    step_rotation: Floats  # (n - 1,): its absolute error in angle, radians
    end_translation: float  # distance of the last pose from the true one, metres, both seen from the first pose
    end_rotation: float  # absolute error in angle of the last pose, radians
    path_length: float  # length of the true path, metres
    turned: float  # sum of all true turns, left or right, radians
    # absolute error of the sum of all turns, left minus right, radians; unlike end_rotation it may exceed pi
    turn_error: float

    @property
    def drift(self) -> float:
        """End error as a share of the path; NaN for a path of no length."""
        return self.end_translation / self.path_length if self.path_length > 0.0 else float("nan")

    @property
    def turn_drift(self) -> float:
        """Error of all turns as a share of them; NaN without turns."""
        return self.turn_error / self.turned if self.turned > 0.0 else float("nan")

    @property
    def turn_per_metre(self) -> float:
        """Error of all turns over the path, rad/m; NaN for a path of no length."""
        return self.turn_error / self.path_length if self.path_length > 0.0 else float("nan")


def trajectory_errors(poses: Pose, true_poses: Pose) -> TrajectoryErrors:
    """Return the errors of (n, 3) poses against the true ones, n >= 2, no NaN, each in a frame of its own."""
    _check(poses, true_poses, 2)
    true_motions = se2.between(true_poses[:-1], true_poses[1:])
    step = se2.between(true_motions, se2.between(poses[:-1], poses[1:]))
    end = se2.between(se2.between(true_poses[0], true_poses[-1]), se2.between(poses[0], poses[-1]))
    return TrajectoryErrors(
        step_translation=np.hypot(step[:, 0], step[:, 1]),
        step_rotation=np.abs(step[:, 2]),
        end_translation=float(np.hypot(end[0], end[1])),
        end_rotation=float(abs(end[2])),
        path_length=float(np.hypot(true_motions[:, 0], true_motions[:, 1]).sum()),
        turned=float(np.abs(true_motions[:, 2]).sum()),
        turn_error=float(abs(step[:, 2].sum())),
    )


def align(poses: Pose, reference: Pose, how: Alignment = "best") -> Pose:
    """Return (n, 3) poses moved as one body into the frame of a reference. Raises InvalidArgumentError."""
    _check(poses, reference, 1)
    if how == "first":
        moved: Pose = se2.compose(reference[0], se2.between(poses[0], poses))
        return moved
    centre, goal = poses[:, :2].mean(axis=0), reference[:, :2].mean(axis=0)
    a, b = poses[:, :2] - centre, reference[:, :2] - goal
    # the angle that turns all a best onto b: of the sum of their products as complex numbers
    theta = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    shift = goal - se2.rotation(float(theta)) @ centre
    return se2.compose(np.array([*shift, theta]), poses)


def ate(poses: Pose, reference: Pose, alignment: Alignment = "best") -> Floats:
    """Return the (n,) absolute trajectory error of (n, 3) poses: their distances from the reference once aligned."""
    moved = align(poses, reference, alignment)
    distance: Floats = np.hypot(*(moved[:, :2] - reference[:, :2]).T)
    return distance


def rpe(
    poses: Pose, reference: Pose, *, delta: float = 1.0, unit: Literal["frames", "metres"] = "frames"
) -> RelativeErrors:
    """Return relative pose errors over motions of (n, 3) poses that follow one another; InvalidArgumentError."""
    _check(poses, reference, 1)
    require(delta > 0.0, "delta must be positive", delta)
    if unit == "frames":
        require(float(delta).is_integer(), "delta must be a whole number of frames", delta)
        marks = np.arange(0, len(reference), int(delta))
    else:
        marks = _marks_along(reference, delta)
    start, stop = marks[:-1], marks[1:]
    off = se2.between(se2.between(reference[start], reference[stop]), se2.between(poses[start], poses[stop]))
    return RelativeErrors(
        start=start, stop=stop, translation=np.hypot(off[:, 0], off[:, 1]), rotation=np.abs(off[:, 2])
    )


def travelled(poses: Pose) -> Floats:
    """Return the length of the path up to each pose, metres; (n, 3) to (n,). Steps from or to NaN count nothing."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])[: len(poses)]


def _marks_along(poses: Pose, delta: float) -> Ints:
    marks, length = [0], 0.0
    for k, step in enumerate(np.hypot(*np.diff(poses[:, :2], axis=0).T), start=1):
        length += step
        if length >= delta:
            marks.append(k)
            length = 0.0
    return np.array(marks)


def _check(poses: Pose, reference: Pose, least: int) -> None:
    if poses.shape != reference.shape or poses.ndim != 2 or len(poses) < least:
        raise InvalidArgumentError(
            f"errors need two trajectories of the same shape (n, 3), n >= {least}, "
            f"got {poses.shape} and {reference.shape}"
        )
