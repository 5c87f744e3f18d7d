"""Least squares over a pose graph: Gauss-Newton on the sparse normal equations.

Grisetti, Kümmerle, Stachniss and Burgard, "A tutorial on graph-based SLAM", 2010. The error of an edge is taken where
the matcher's covariance lives, in the frame of its first pose: e = [R_i^T (t_j - t_i) - t_ij; theta_j - theta_i -
theta_ij].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.se2.uncertain import inverse3, wrap_angle
from curvescan.slam.pose_graph.cholesky import Elimination, factorized, inverse_blocks, solved
from curvescan.types import Cov, Floats, Ints, Pose

_SHORT = 0.1
"""Metres and radians: after a step no longer than this the factorization serves again, unless the next is longer."""
_LEAST_STEP = 1e-5  # metres and radians: the last step of all


class Edges(NamedTuple):
    """The edges of a problem."""

    ends: Ints  # (m, 2): poses i and j of each
    measured: Pose  # (m, 3): measured pose of j in the frame of i
    information: Cov  # (m, 3, 3): inverse covariance of the measured pose

    @classmethod
    def of(cls, ends: Ints, measured: Pose, covariances: Cov) -> Edges:
        """Return edges from covariances, each positive definite."""
        covariances = np.ascontiguousarray(covariances)
        return cls(np.ascontiguousarray(ends), np.ascontiguousarray(measured), _inverses(covariances))

    def chosen(self, rows: Ints) -> Edges:
        """Return some of the edges."""
        return Edges(self.ends[rows], self.measured[rows], self.information[rows])


def optimize(poses: Pose, edges: Edges, weights: Floats, anchors: Ints, elimination: Elimination) -> Pose:
    """Return the (n, 3) poses that the edges agree on best; weights (m,); anchors (k,); elimination: also of others."""
    order, indptr, rows = elimination
    rank = np.argsort(order)
    edges, poses, is_held = edges._replace(ends=rank[edges.ends]), poses[order], np.isin(order, anchors)
    weighted, longest = weights[:, np.newaxis, np.newaxis] * edges.information, np.inf
    for _ in range(20):
        jacobians, gradient, _ = linearized(poses, *edges, weights)
        gradient[is_held] = 0.0
        if longest > _SHORT:
            blocks = factorized(indptr, rows, edges.ends, jacobians, weighted, is_held)
        step = solved(indptr, rows, blocks, -gradient)
        if longest <= _SHORT and not np.abs(step).max(initial=0.0) <= longest:  # where little ties parts
            blocks = factorized(indptr, rows, edges.ends, jacobians, weighted, is_held)
            step = solved(indptr, rows, blocks, -gradient)
        poses, longest = poses + step, np.abs(step).max(initial=0.0)
        if not longest > _LEAST_STEP:
            break
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses[rank]


def marginal_covariances(poses: Pose, edges: Edges, weights: Floats, anchors: Ints) -> Cov:
    """Return (n, 3, 3) covariance of each pose with the anchors, (k,), known exactly; poses (n, 3), weights (m,).

    Anchored at the pose in question, these are the covariances of all others seen from it, with no cancellation of
    large numbers: what a chain of keyframes has in common is not in them.
    """
    order, indptr, rows = Elimination.of(edges.ends, len(poses))
    rank = np.argsort(order)
    edges = edges._replace(ends=rank[edges.ends])
    jacobians, is_held = linearized(poses[order], *edges, weights)[0], np.isin(order, anchors)
    weighted = weights[:, np.newaxis, np.newaxis] * edges.information
    blocks = factorized(indptr, rows, edges.ends, jacobians, weighted, is_held)
    found: Cov = inverse_blocks(indptr, rows, blocks)[indptr[rank]]
    found[anchors] = 0.0
    return found


def squared_distances(poses: Pose, edges: Edges) -> Floats:
    """Return (m,) squared Mahalanobis distances of the edges at the poses."""
    return linearized(poses, *edges, np.ones(len(edges.ends)))[2]


@kernel
def _inverses(covariances: Cov) -> Cov:
    found = np.empty((len(covariances), 3, 3))
    for k in range(len(covariances)):
        found[k] = inverse3(covariances[k])
    return found


@kernel
def linearized(
    poses: Pose, ends: Ints, measured: Pose, information: Cov, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return (m, 2, 3, 3) derivatives J of errors by poses i and j, (n, 3) gradient J^T W e, (m,) squared distances."""
    m = len(ends)
    jacobians, gradient, distances = np.zeros((m, 2, 3, 3)), np.zeros((len(poses), 3)), np.zeros(m)
    error = np.empty(3)
    for k in range(m):
        i, j = ends[k, 0], ends[k, 1]
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
        x, y = c * dx + s * dy, c * dy - s * dx
        error[0], error[1] = x - measured[k, 0], y - measured[k, 1]
        error[2] = wrap_angle(poses[j, 2] - poses[i, 2] - measured[k, 2])
        by_i, by_j = jacobians[k, 0], jacobians[k, 1]
        by_j[0, 0], by_j[0, 1], by_j[1, 0], by_j[1, 1], by_j[2, 2] = c, s, -s, c, 1.0
        by_i[0, 0], by_i[0, 1], by_i[1, 0], by_i[1, 1], by_i[2, 2] = -c, -s, s, -c, -1.0
        by_i[0, 2], by_i[1, 2] = y, -x
        for row in range(3):
            pull = 0.0
            for q in range(3):
                pull += information[k, row, q] * error[q]
            distances[k] += error[row] * pull
            for q in range(3):
                gradient[i, q] += weights[k] * pull * by_i[row, q]
                gradient[j, q] += weights[k] * pull * by_j[row, q]
    return jacobians, gradient, distances
