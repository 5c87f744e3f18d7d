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


class Records:
    """One row a scan: stamp, stretch, pose and covariance in the frame of the keyframe that the stretch begins with.

    A stretch is the way from a keyframe to the next; a scan lies between both, and is moved by its share of what the
    graph moved the one against the other: that of the variance in this direction which the odometry had gathered by
    then. Along a bare corridor that is where it saw nothing of the motion.
    """

    def __init__(self) -> None:
        self._scans = Rows(dtype=_SCAN)
        self._from: list[int] = []  # keyframe a stretch begins with
        self._to: list[int] = []  # keyframe it ends with; -1 while it is open
        self._way: list[UncertainPose] = []  # the one seen from the other by the odometry

    def begin(self, keyframe: int, way: UncertainPose | None) -> None:
        """Begin a stretch at a keyframe; `way` is its pose by the odometry in the frame before, if any."""
        if self._from and way is not None:
            self._to[-1] = keyframe
            self._way[-1] = way
        self._from.append(keyframe)
        self._to.append(-1)
        self._way.append(identity())

    def add(self, stamp: float, seen: UncertainPose) -> None:
        """Add a scan by its pose in the frame of the keyframe that the stretch began with."""
        self._scans.append((stamp, len(self._from) - 1, seen.pose, seen.cov))

    def keyframe_scans(self) -> Ints:
        """Return (k, 2) number and scan of each keyframe of this session, also of those that went."""
        first = np.searchsorted(self._scans.array["stretch"], np.arange(len(self._from)))
        return np.column_stack([np.array(self._from, dtype=np.int64), first])

    def trajectory(self, poses: Pose, covariances: Cov) -> Trajectory:
        """Return all poses so far, by those of the keyframes, (n, 3), and their covariances, (n, 3, 3)."""
        scans = self._scans.array
        if not len(scans):
            return Trajectory(stamps=np.empty(0), poses=np.empty((0, 3)), covariances=np.empty((0, 3, 3)))
        stretch, relative, own = scans["stretch"], scans["relative"], scans["covariance"]
        first = np.array(self._from, dtype=np.int64)[stretch]
        found = se2.compose(poses[first], relative)
        _, in_map = composed_covariances(poses[first], covariances[first], UncertainPose(relative, own))
        found += self._corrections(stretch, relative, own, found, poses)
        found[:, 2] = se2.wrap(found[:, 2])
        return Trajectory(stamps=scans["stamp"].copy(), poses=found, covariances=in_map)

    def _corrections(self, stretch: Ints, relative: Pose, own: Cov, found: Pose, poses: Pose) -> Pose:
        """Return (n, 3) by how much each scan is moved towards where the keyframe at the end of its stretch has it."""
        last = np.array(self._to)[stretch]
        way = np.array([w.pose for w in self._way])[stretch]
        by_last = se2.compose(poses[last], se2.between(way, relative))
        off = by_last - found
        off[:, 2] = se2.wrap(off[:, 2])
        done = _length(relative)
        whole = np.maximum(done + _length(se2.between(relative, way)), 1e-9)
        # of the offset seen from the first keyframe of the stretch
        turn = -(found[:, 2] - relative[:, 2])
        c, s = np.cos(turn), np.sin(turn)
        x, y = c * off[:, 0] - s * off[:, 1], s * off[:, 0] + c * off[:, 1]
        total = np.array([w.cov for w in self._way])[stretch]
        share = _gathered(own, x, y, done) / _gathered(total, x, y, whole)
        share_turn = (own[:, 2, 2] + _FLOOR * done) / (total[:, 2, 2] + _FLOOR * whole)
        is_closed = last >= 0
        off[:, :2] *= np.where(is_closed, np.clip(share, 0.0, 1.0), 0.0)[:, np.newaxis]
        off[:, 2] *= np.where(is_closed, np.clip(share_turn, 0.0, 1.0), 0.0)
        return off


def _gathered(cov: Cov, x: Floats, y: Floats, length: Floats) -> Floats:
    """Return (n,) variance in the direction (x, y), and what the length of the way adds to it."""
    squared = np.maximum(x * x + y * y, 1e-18)
    along = x * x * cov[:, 0, 0] + 2.0 * x * y * cov[:, 0, 1] + y * y * cov[:, 1, 1]
    gathered: Floats = along / squared + _FLOOR * length
    return gathered


def _length(poses: Pose) -> Floats:
    length: Floats = np.hypot(poses[:, 0], poses[:, 1]) + 0.5 * np.abs(poses[:, 2])
    return length
