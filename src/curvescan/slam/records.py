"""Records: where each scan lies in the frame of a keyframe, from which the trajectory is made anew at any time."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.se2.uncertain import UncertainPose, identity
from curvescan.slam.loops.belief import composed_covariances
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Cov, Floats, Ints, Pose

_FLOOR = 1e-4
"""Variance that each metre of the way adds, square metres and square radians: where matches measure all of the motion
its length decides."""

_SCAN = np.dtype([("stamp", float), ("stretch", int), ("relative", float, 3), ("covariance", float, (3, 3))])
_STRETCH = np.dtype([("first", int), ("last", int), ("way", float, 3), ("covariance", float, (3, 3))])


class Records:
    """One row a scan: stamp, stretch, pose and covariance in the frame of the keyframe that the stretch begins with.

    A stretch is the way from a keyframe to the next; a scan lies between both, and is moved by its share of what the
    graph moved the one against the other: that of the variance in this direction which the odometry had gathered by
    then. Along a bare corridor that is where it saw nothing of the motion.
    """

    def __init__(self) -> None:
        self._scans = Rows(dtype=_SCAN)
        # keyframes that a stretch begins and ends with, the last -1 while it is open, and the one seen from the other
        self._stretches = Rows(dtype=_STRETCH)

    def begin(self, keyframe: int, way: UncertainPose | None) -> None:
        """Begin a stretch at a keyframe; `way` is its pose by the odometry in the frame before, if any."""
        if len(self._stretches) and way is not None:
            before = self._stretches.array[-1]
            before["last"], before["way"], before["covariance"] = keyframe, way.pose, way.cov
        self._stretches.append((keyframe, -1, *identity()))

    def add(self, stamp: float, seen: UncertainPose) -> None:
        """Add a scan by its pose in the frame of the keyframe that the stretch began with."""
        self._scans.append((stamp, len(self._stretches) - 1, seen.pose, seen.cov))

    def keyframe_scans(self) -> Ints:
        """Return (k, 2) number and scan of each keyframe of this session, also of those that went."""
        first_scan = np.searchsorted(self._scans.array["stretch"], np.arange(len(self._stretches)))
        return np.column_stack([self._stretches.array["first"], first_scan])

    def trajectory(self, poses: Pose, covariances: Cov) -> Trajectory:
        """Return all poses so far, by those of the keyframes, (n, 3), and their covariances, (n, 3, 3)."""
        scans = self._scans.array
        relative, own = scans["relative"], scans["covariance"]
        stretches = self._stretches.array[scans["stretch"]]
        first = stretches["first"]
        found = se2.compose(poses[first], relative)
        in_map = composed_covariances(poses[first], covariances[first], UncertainPose(relative, own))
        # where the keyframe at the end of the stretch has each scan
        way, total = stretches["way"], stretches["covariance"]
        off = se2.compose(poses[stretches["last"]], se2.between(way, relative)) - found
        off[:, 2] = se2.wrap(off[:, 2])
        done = _length(relative)
        whole = np.maximum(done + _length(se2.between(relative, way)), 1e-9)
        # of the offset seen from the first keyframe of the stretch
        turn = -(found[:, 2] - relative[:, 2])
        c, s = np.cos(turn), np.sin(turn)
        x, y = c * off[:, 0] - s * off[:, 1], s * off[:, 0] + c * off[:, 1]
        share = _gathered(own, x, y, done) / _gathered(total, x, y, whole)
        share_turn = (own[:, 2, 2] + _FLOOR * done) / (total[:, 2, 2] + _FLOOR * whole)
        shares = np.clip(np.column_stack((share, share, share_turn)), 0.0, 1.0)
        found += np.where(stretches["last"] >= 0, 1.0, 0.0)[:, np.newaxis] * shares * off
        found[:, 2] = se2.wrap(found[:, 2])
        return Trajectory(stamps=scans["stamp"].copy(), poses=found, covariances=in_map)


def _gathered(cov: Cov, x: Floats, y: Floats, length: Floats) -> Floats:
    """Return (n,) variance in the direction (x, y), and what the length of the way adds to it."""
    squared = np.maximum(x * x + y * y, 1e-18)
    along = x * x * cov[:, 0, 0] + 2.0 * x * y * cov[:, 0, 1] + y * y * cov[:, 1, 1]
    gathered: Floats = along / squared + _FLOOR * length
    return gathered


def _length(poses: Pose) -> Floats:
    length: Floats = np.hypot(poses[:, 0], poses[:, 1]) + 0.5 * np.abs(poses[:, 2])
    return length
