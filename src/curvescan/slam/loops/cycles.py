"""Cycles: two loop closures and the ways of the graph between their ends, which must close within their covariances.

Mangelson et al. 2018, eq. 3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.se2.uncertain import UncertainPose, add_sandwich, affine, composed, inverse3, wrap_angle
from curvescan.slam.pose_graph.posterior import affines, carried
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Cov, Floats, Ints, Pose


class Chain:
    """Keyframes, and the chain of motions that leads along them, by (n, 3) poses and covariance of the motion to each.

    `poses` (n, 3): of the keyframes; `gathered` (n, 3, 3): covariance that the motions have gathered by each; see
    :func:`gathered_covariances`.
    """

    def __init__(self, poses: Pose, motions: Cov) -> None:
        self._poses, self._gathered = Rows.of(poses), Rows.of(gathered_covariances(poses, motions))

    poses = property(lambda self: self._poses.array)
    gathered = property(lambda self: self._gathered.array)

    def append(self, motion: UncertainPose) -> None:
        """Append a keyframe by its motion from the last one."""
        last = self.poses[-1]
        ends = np.array([last, se2.compose(last, motion.pose)])
        self._gathered.append(self.gathered[-1] + gathered_covariances(ends, np.array([motion.cov] * 2))[1])
        self._poses.append(ends[1])


class Cycles(NamedTuple):
    """Closures, and what the ways of the graph between their ends are known by."""

    ends: Ints  # (n, 2): of the closures
    measured: Pose  # (n, 3)
    covariances: Cov  # (n, 3, 3)
    poses: Pose  # (k, 3), of all keyframes, and
    gathered: Cov  # (k, 3, 3), as a :class:`Chain` has them
    spread: Floats  # (3,): variances of an edge, of which each `step` metres between two keyframes take one
    step: float


@kernel
def cycle_distances(cycles: Cycles, rows: Ints, columns: Ints, known: float) -> Floats:
    """Return (n, n) squared Mahalanobis distance by which the cycle through two closures does not close.

    rows, columns: of each of the ones with each of the others; NaN elsewhere. known: standard deviation up to which the
    motions of a way count, metres. One known no better is taken to err as edges usually do: the next room would agree
    with it as well.
    """
    ends, measured, covariances = cycles.ends, cycles.measured, cycles.covariances
    found = np.full((len(ends), len(ends)), np.nan)
    for one in rows:
        for other in columns:
            a, b = max(one, other), min(one, other)
            if not math.isnan(found[a, b]):
                continue
            to, way = _way(cycles, ends[b, 0], ends[a, 0], known)
            to, way = composed(to, way, measured[a], covariances[a])
            back, rest = _way(cycles, ends[a, 1], ends[b, 1], known)
            off, cov = composed(to, way, back, rest)
            for k in range(3):
                off[k] -= measured[b, k]
                for m in range(3):
                    cov[k, m] += covariances[b, k, m]
            off[2] = wrap_angle(off[2])
            weight = inverse3(cov)
            found[a, b] = 0.0
            for k in range(3):
                for m in range(3):
                    found[a, b] += off[k] * weight[k, m] * off[m]
            found[b, a] = found[a, b]
    return found


@kernel
def _way(cycles: Cycles, a: int, b: int, known: float) -> tuple[Pose, Cov]:
    """Return keyframe b seen from keyframe a, with the covariance of the motions between."""
    poses, gathered = cycles.poses, cycles.gathered
    pose, cov = np.zeros(3), np.zeros((3, 3))
    if a == b:
        return pose, cov
    x, y = poses[b, 0], poses[b, 1]
    dx, dy, c, s = x - poses[a, 0], y - poses[a, 1], math.cos(poses[a, 2]), math.sin(poses[a, 2])
    pose[0], pose[1], pose[2] = c * dx + s * dy, c * dy - s * dx, wrap_angle(poses[b, 2] - poses[a, 2])
    passed = gathered[max(a, b)] - gathered[min(a, b)]  # moving the plane about the origin
    add_sandwich(affine(c, -s, s * x - c * y, c * x + s * y), passed, cov)
    if max(cov[0, 0], cov[1, 1]) > known * known:
        cov[:] = 0.0
    n_edges = 1.0 + math.sqrt(dx * dx + dy * dy) / cycles.step
    for k in range(3):
        cov[k, k] += n_edges * cycles.spread[k]
    return pose, cov


def gathered_covariances(poses: Pose, motions: Cov) -> Cov:
    """Return the (n, 3, 3) covariance that a chain of motions gathers by each pose, moving the whole plane.

    The difference of two is that of the way between: what it makes of the origin, in the frame of the poses.
    """
    found = np.zeros((len(poses), 3, 3))
    moved = affines(poses[:-1, 2], poses[1:, 1], -poses[1:, 0])
    found[1:] = np.cumsum(carried(motions[1:], moved), axis=0)
    return found
