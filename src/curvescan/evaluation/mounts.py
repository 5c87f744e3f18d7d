"""Mounts of lasers found from motions: two sensors on one body move differently, and the difference is the mount.

Sensor b sits at X in the frame of sensor a. While a moves by A and b by B, A X = X B: hand-eye calibration, here in the
plane (Censi, Franchi, Marchionni and Oriolo, "Simultaneous calibration of odometry and sensor parameters for mobile
robots", IEEE Transactions on Robotics 29, 2013, treat wheels and a laser so). A turn fixes the place of b on the body,
a way fixes its direction: a drive needs both.
"""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import approx_fprime, least_squares

from curvescan import se2
from curvescan.diagnostics.issues import Issue
from curvescan.diagnostics.preparation import mend
from curvescan.errors import InvalidArgumentError
from curvescan.io import read_log
from curvescan.io.log import Log, ScanAccess
from curvescan.io.ros.odometry import poses_at
from curvescan.io.ros.transforms import laser_mounts
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry import Odometry
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Floats, Pose

WAY, TURN = 0.3, 0.3  # a piece of the drive ends after so much way, metres, or turn, radians

WRONG_M, WRONG_RAD = 0.03, 0.02
"""A given mount that differs from the found one by more, metres or radians, doubles walls."""

_CHANCE = 16.3
"""Squared Mahalanobis distance that a right mount exceeds once in a thousand times: chi-square, three dimensions."""

_LEAST_PIECES = 8
_LEAST_TURN = 0.5
"""Sum of the turns of all pieces, radians, without which the place of a laser on the body is not known."""
_LEAST_WAY = 0.5
"""Sum of the ways, metres, without which its heading is not."""


def find_mount(motions_a: ArrayLike, motions_b: ArrayLike) -> UncertainPose:
    """Return the pose of sensor b in the frame of sensor a from motions of both over the same times."""
    a, b = np.asarray(motions_a, dtype=np.float64), np.asarray(motions_b, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise InvalidArgumentError(f"motions must be two arrays of shape (n, 3), got {a.shape} and {b.shape}")
    known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    a, b = a[known], b[known]
    turned, driven = float(np.abs(a[:, 2]).sum()), float(np.hypot(*a[:, :2].T).sum())
    if len(a) < _LEAST_PIECES or turned < _LEAST_TURN or not driven > _LEAST_WAY:
        raise InvalidArgumentError(
            f"a mount needs {_LEAST_PIECES} motions with {_LEAST_TURN} rad of turns and {_LEAST_WAY} m of way in sum, "
            f"got {len(a)} with {turned:.2f} rad and {driven:.2f} m: drive farther, and round bends"
        )
    begin = _linear_mount(a, b)
    # the misclosure of an outlier: three deviations of the linear solution's, at least 1 mm
    scale = max(3.0 * float(np.median(np.abs(_misclosure(begin, a, b)))) / _MEDIAN_OF_NORMAL, 1e-3)
    found = least_squares(_misclosure, begin, args=(a, b), loss="soft_l1", f_scale=scale)
    # a robust fit's covariance: residual variance of the pieces that the loss trusts, by the information at the optimum
    rest = _misclosure(found.x, a, b)
    variance = (np.median(np.abs(rest)) / _MEDIAN_OF_NORMAL) ** 2 * rest.size / (rest.size - 3)
    rows = approx_fprime(found.x, _misclosure, 1.5e-8, a, b)
    covariance = variance * np.linalg.inv(rows.T @ rows)
    return UncertainPose(np.array([*found.x[:2], se2.wrap(found.x[2])]), covariance)


def find_mounts(logs: Mapping[str, Log], *, base: str | Trajectory) -> dict[str, UncertainPose]:
    """Return the mounts of the lasers of one robot, each from its own odometry.

    Parameters
    ----------
    logs : mapping of str to Log
        A log a laser, stamps of one clock.
    base : str or Trajectory
        What the mounts are seen from: one of the lasers, or poses of the robot's base by its wheels, with stamps.

    Returns
    -------
    dict of str to UncertainPose
        The pose of each other laser in the frame of `base`.

    Raises
    ------
    InvalidArgumentError
        When `base` is not the name of a log, or when the drive is too short or too straight to find a mount.
    """
    if isinstance(base, str) and base not in logs:
        raise InvalidArgumentError(f"base must be one of {', '.join(logs)}, or wheels as a Trajectory, got {base!r}")
    tracks = {name: _track_of(log) for name, log in logs.items()}
    seen_from = tracks[base] if isinstance(base, str) else base
    return {
        name: find_mount(*common_motions(seen_from, track)) for name, track in tracks.items() if track is not seen_from
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class MountCheck:
    """The mount of one laser as found from the scans of a bag, beside the one that the bag's transforms give."""

    # the laser, and what it is seen from: the topic of another laser, or ``"the wheels"``
    topic: str
    base: str
    found: UncertainPose  # by :func:`find_mount`
    given: Pose | None  # (3,): by the transforms; None where they do not lead there

    @property
    def is_wrong(self) -> bool:
        """Whether the given mount contradicts the scans: by more than its bounds, and by more than chance allows."""
        if self.given is None:
            return False
        error = self.found.pose - self.given
        error[2] = se2.wrap(error[2])
        is_far = float(np.hypot(*error[:2])) > WRONG_M or abs(error[2]) > WRONG_RAD
        return is_far and float(error @ np.linalg.solve(self.found.covariance, error)) > _CHANCE

    def issue(self) -> Issue:
        """Return what `curvescan info` says of a wrong mount."""
        assert self.given is not None
        x, y, yaw = np.abs(self.found.pose - self.given)
        return Issue(
            topic="file",
            kind="wrong_mount",
            what=f"the transforms put {self.topic} elsewhere, seen from {self.base}, than the scans do, "
            f"by {math.hypot(x, y):.3f} m and {abs(math.degrees(se2.wrap(yaw))):.1f} deg",
            consequence="walls are doubled where both lasers see them; curvescan calibrate LOG --mounts gives the "
            "mount to put into the transforms",
        )


def check_mounts(path: str | os.PathLike[str], *, uses_wheels: bool = True) -> list[MountCheck]:
    """Return the mounts of a bag's lasers, on the base or else on the first laser, beside those of its transforms.

    What is wrong with a log beyond doubt is mended, as in a run. Raises InvalidArgumentError where one sensor is all.
    """
    given = laser_mounts(Path(path))
    logs = {topic: read_log(path, topic=topic) for topic in given}
    first, laser = next(iter(logs.items()))
    wheels = laser.robot_odometry() if uses_wheels and isinstance(laser, ScanAccess) else None
    if wheels is None and len(logs) < 2:
        lone = "no wheels: a mount is found from two sensors on one robot"
        wheels_too = "curvescan calibrate LOG --mounts compares it with the wheels, where there are some"
        raise InvalidArgumentError(f"{path} holds one laser and {lone}" if uses_wheels else f"one laser: {wheels_too}")
    found = find_mounts({topic: mend(log).log for topic, log in logs.items()}, base=first if wheels is None else wheels)
    seen_from = given[first] if wheels is None else np.zeros(3)
    base, checks = "the wheels" if wheels is not None else first, []
    for topic, mount in found.items():
        there = given[topic]
        pose = None if seen_from is None or there is None else se2.between(seen_from, there)
        checks.append(MountCheck(topic=topic, base=base, found=mount, given=pose))
    return checks


def _track_of(log: Log) -> Trajectory:
    """Return the odometry of a laser of a rig, its sweeps as they are."""
    table = np.array([(step.stamp, *step.pose) for step in map(Odometry().add, log)]).reshape(-1, 4)
    return Trajectory(stamps=table[:, 0], poses=table[:, 1:])


def common_motions(a: Trajectory, b: Trajectory) -> tuple[Pose, Pose]:
    """Return (n, 3) motions of two sensors over the same pieces of a drive, at the stamps of the first."""
    poses_a, poses_b = poses_at(a.stamps, a.to_array()), poses_at(a.stamps, b.to_array())
    both = np.isfinite(poses_a).all(axis=1) & np.isfinite(poses_b).all(axis=1)
    poses_a, poses_b = poses_a[both], poses_b[both]
    ends = [0]
    for k in range(1, len(poses_a)):
        x, y, theta = se2.between(poses_a[ends[-1]], poses_a[k])
        if np.hypot(x, y) >= WAY or abs(theta) >= TURN:
            ends.append(k)
    return se2.between(poses_a[ends[:-1]], poses_a[ends[1:]]), se2.between(poses_b[ends[:-1]], poses_b[ends[1:]])


_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal variable


def _misclosure(mount: Floats, a: Pose, b: Pose) -> Floats:
    """Return (2n,) how far A X and X B put sensor b apart, metres."""
    there = se2.compose(a, mount[np.newaxis])
    again = se2.compose(mount[np.newaxis], b)
    apart: Floats = (there - again)[:, :2].ravel()
    return apart


def _linear_mount(a: Pose, b: Pose) -> Floats:
    """Return the mount that linear least squares gives for its place, and the cosine and sine of its direction."""
    n = len(a)
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    rows = np.zeros((n, 2, 4))
    rows[:, 0] = np.stack([c - 1.0, -s, -b[:, 0], b[:, 1]], axis=-1)
    rows[:, 1] = np.stack([s, c - 1.0, -b[:, 1], -b[:, 0]], axis=-1)
    solution = np.linalg.lstsq(rows.reshape(-1, 4), -a[:, :2].ravel(), rcond=None)[0]
    return np.array([solution[0], solution[1], np.arctan2(solution[3], solution[2])])
