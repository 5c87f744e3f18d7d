"""Records: where each scan lies in the frame of a keyframe, from which the trajectory is made anew at any time."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.loops.marginals import composed_covariances
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Cov, Floats, Ints, Pose

_SCAN = np.dtype([("stamp", float), ("stretch", int), ("relative", float, 3), ("covariance", float, (3, 3))])
_STRETCH = np.dtype([("first", int), ("last", int), ("way", float, 3), ("scan", int)])


class Records:
    """One row a scan: stamp, stretch, pose and covariance in the frame of the keyframe that the stretch begins with.

    A stretch is the way from a keyframe to the next; a scan lies between both, and is moved by its share of what the
    graph moved the one against the other: that of the way which the sensor had gone by then.
    """

    def __init__(self) -> None:
        self._scans = Rows(dtype=_SCAN)
        # keyframes that a stretch begins and ends with, the last -1 while it is open, and the one seen from the other;
        # scan of the first
        self._stretches = Rows(dtype=_STRETCH)

    def begin(self, keyframe: int, way: Pose | None, n_lost: int = 0) -> None:
        """Begin a stretch at a keyframe; `way` is its pose by the odometry in the frame before, if any.

        Where a track was lost, the last `n_lost` scans are of the new one, and nothing ties the others to it.
        """
        rows = self._scans.array[len(self._scans) - n_lost :]
        if n_lost and way is not None:
            rows["stretch"], rows["relative"] = len(self._stretches), se2.between(way, rows["relative"])
        elif way is not None:
            before = self._stretches.array[-1]
            before["last"], before["way"] = keyframe, way
        self._stretches.append((keyframe, -1, np.zeros(3), len(self._scans)))

    def add(self, stamp: float, seen: UncertainPose) -> None:
        """Add a scan by its pose in the frame of the keyframe that the stretch began with."""
        self._scans.append((stamp, len(self._stretches) - 1, seen.pose, seen.covariance))

    def keyframe_scans(self) -> Ints:
        """Return (k, 2) number and scan of each keyframe of this session, also of those that went."""
        return np.column_stack([self._stretches.array["first"], self._stretches.array["scan"]])

    def trajectory(self, poses: Pose, covariances: Cov) -> Trajectory:
        """Return all poses so far, by those of the keyframes, (n, 3), and their covariances, (n, 3, 3)."""
        scans = self._scans.array
        relative, stretches = scans["relative"], self._stretches.array[scans["stretch"]]
        first = stretches["first"]
        found = se2.compose(poses[first], relative)
        in_map = composed_covariances(poses[first], covariances[first], UncertainPose(relative, scans["covariance"]))
        # where the keyframe at the end of the stretch has each scan
        back = se2.between(stretches["way"], relative)
        off = se2.compose(poses[stretches["last"]], back) - found
        off[:, 2] = se2.wrap(off[:, 2])
        done = _length(relative)
        share = np.where(stretches["last"] >= 0, done / np.maximum(done + _length(back), 1e-9), 0.0)
        found += share[:, np.newaxis] * off
        found[:, 2] = se2.wrap(found[:, 2])
        return Trajectory(stamps=scans["stamp"].copy(), poses=found, covariances=in_map)


def _length(poses: Pose) -> Floats:
    return np.asarray(np.hypot(poses[:, 0], poses[:, 1]) + 0.5 * np.abs(poses[:, 2]))
