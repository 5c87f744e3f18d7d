"""Cycles: two loop closures and the ways of the graph between their ends, which must close within their covariances.

Mangelson et al. 2018, eq. 3.
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan._jit import kernel
from curvescan.se2.uncertain import UncertainPose, add_sandwich, affine, composed, inverse3, wrap_angle
from curvescan.slam.pose_graph.posterior import affines, carried
from curvescan.types import Cov, Floats, Ints, Pose


class Chain(NamedTuple):
    """Keyframes, and the chain of motions that leads along them."""

    poses: Pose  # (n, 3): of the keyframes
    # (n, 3, 3): covariance that the motions have gathered by each, moving the whole plane: the difference of two is
    # that of the way between: what it makes of the origin, in the frame of the poses
    gathered: Cov

    @classmethod
    def of(cls, poses: Pose, motions: ArrayLike) -> Chain:
        """Return a chain by its (n, 3) poses and (n, 3, 3) covariance of the motion to each."""
        gathered = np.zeros((len(poses), 3, 3))
        moved = affines(poses[:-1, 2], poses[1:, 1], -poses[1:, 0])
        gathered[1:] = np.cumsum(carried(np.asarray(motions)[1:], moved), axis=0)
        return cls(poses.copy(), gathered)

    def extended(self, motions: list[UncertainPose]) -> Chain:
        """Return a chain with more motions at its end."""
        poses = accumulate((motion.pose for motion in motions), se2.compose, initial=self.poses[-1])
        more = Chain.of(np.array([*poses]), [motions[0].covariance, *(motion.covariance for motion in motions)])
        gathered = np.concatenate((self.gathered, self.gathered[-1] + more.gathered[1:]))
        return Chain(np.concatenate((self.poses, more.poses[1:])), gathered)


@kernel
def difference(one: Pose, other: Pose) -> Pose:
    """Return by how much the second pose is off: what lies behind a turn is off along one line, however far it goes."""
    turn = wrap_angle(other[2] - one[2])
    c, s, half = math.cos(turn), math.sin(turn), 0.5 * turn
    x, y = other[0] - c * one[0] + s * one[1], other[1] - s * one[0] - c * one[1]
    along = half / math.tan(half) if half != 0.0 else 1.0
    return np.array([along * x + half * y - one[1] * turn, along * y - half * x + one[0] * turn, turn])


@kernel
def cycle_distances(
    ends: Ints, edges: tuple[Pose, Cov], chain: Chain, pairs: tuple[Ints, Ints], spread: Cov, step: float, known: float
) -> Floats:
    """Return (n, n) squared Mahalanobis distance by which the cycle through two closures does not close.

    ends (n, 2), edges: measured (n, 3) and covariances (n, 3, 3) of the closures; pairs: each of some with each of
    others, NaN elsewhere; spread (3, 3): covariance of an edge, of which each `step` metres between two keyframes take
    one; known: standard deviation up to which the motions of a way count, metres. One known no better is taken to err
    as edges usually do: the next room would agree with it as well.
    """
    measured, covariances = edges
    found = np.full((len(ends), len(ends)), np.nan)
    for one in pairs[0]:
        for other in pairs[1]:
            a, b = max(one, other), min(one, other)
            if not math.isnan(found[a, b]):
                continue
            to, way = _way(chain, ends[b, 0], ends[a, 0], spread, step, known)
            to, way = composed(to, way, measured[a], covariances[a])
            back, rest = _way(chain, ends[a, 1], ends[b, 1], spread, step, known)
            closed, cov = composed(to, way, back, rest)
            off = difference(closed, measured[b])
            found[a, b] = found[b, a] = off @ inverse3(cov + covariances[b]) @ off
    return found


@kernel
def _way(chain: Chain, a: int, b: int, spread: Cov, step: float, known: float) -> tuple[Pose, Cov]:
    """Return keyframe b seen from keyframe a, with the covariance of the motions between."""
    poses, gathered = chain
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
    n_edges = 1.0 + math.sqrt(dx * dx + dy * dy) / step
    return pose, cov + n_edges * spread
