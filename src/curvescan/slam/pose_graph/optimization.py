"""Least squares over a pose graph: Gauss-Newton on the sparse normal equations.

Grisetti, Kümmerle, Stachniss and Burgard, "A tutorial on graph-based SLAM", 2010. The error of an edge is taken where
the matcher's covariance lives, in the frame of its first pose: e = [R_i^T (t_j - t_i) - t_ij; theta_j - theta_i -
theta_ij].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.slam.pose_graph.sparse import BlockPattern, block_pattern, factorize
from curvescan.types import Bools, Cov, Floats, Ints, Pose


class Edges(NamedTuple):
    """The edges of a problem."""

    ends: Ints  # (m, 2): poses i and j of each
    measured: Pose  # (m, 3): measured pose of j in the frame of i
    information: Cov  # (m, 3, 3): inverse covariance of the measured pose

    @classmethod
    def of(cls, ends: Ints, measured: Pose, covariances: Cov) -> Edges:
        """Return edges from covariances, each positive definite."""
        return cls(ends, measured, np.linalg.inv(covariances).astype(np.float64))

    def chosen(self, rows: Ints) -> Edges:
        """Return some of the edges."""
        return Edges(self.ends[rows], self.measured[rows], self.information[rows])


@dataclass(frozen=True, eq=False, kw_only=True)
class Optimum:
    """Where least squares ended."""

    poses: Pose  # (n, 3): the poses
    n_iterations: int  # factorizations it took
    cost: float  # weighted sum of the edges' squared Mahalanobis distances


def optimize(
    poses: Pose,
    edges: Edges,
    weights: Floats,
    anchors: Ints,
    *,
    max_iterations: int = 20,
    tolerance: float = 1e-5,
    pattern: BlockPattern | None = None,
) -> Optimum:
    """Return the poses that the edges agree on best.

    poses (n, 3); weights (m,); anchors (k,).
    """
    poses = np.ascontiguousarray(poses, dtype=np.float64).copy()
    pattern = pattern or block_pattern(len(poses), edges.ends, 3)
    cost, n_done = math.inf, 0
    for _ in range(max_iterations):
        data, gradient, cost = normal_equations(poses, edges, weights, anchors, pattern)
        step = factorize(pattern, data).solve(-gradient).reshape(-1, 3)
        n_done += 1
        poses += step
        if not np.abs(step).max(initial=0.0) > tolerance:
            break
    poses[:, 2] = np.remainder(poses[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return Optimum(poses=poses, n_iterations=n_done, cost=cost)


def normal_equations(
    poses: Pose, edges: Edges, weights: Floats, anchors: Ints, pattern: BlockPattern
) -> tuple[Floats, Floats, float]:
    """Return the entries of the information matrix at the poses, the gradient (3n,), and the cost."""
    data = np.zeros(pattern.n_entries)
    gradient = np.zeros(3 * len(poses))
    is_held = np.zeros(len(poses), dtype=np.bool_)
    is_held[anchors] = True
    cost = _accumulate(
        poses, is_held, *edges, weights, pattern.diagonal, pattern.upper, pattern.lower,
        pattern.first, pattern.stride, data, gradient,
    )  # fmt: skip
    for k in anchors.tolist():
        first, stride = pattern.first[pattern.diagonal[k]], pattern.stride[pattern.diagonal[k]]
        data[first + np.arange(3) * (stride + 1)] = 1.0  # its row and column are empty
    return data, gradient, cost


def squared_distances(poses: Pose, edges: Edges) -> Floats:
    """Return (m,) squared Mahalanobis distances of the edges at the poses."""
    return _distances(np.ascontiguousarray(poses), *edges)


@kernel
def _residual(pose_i: Pose, pose_j: Pose, measured: Pose) -> tuple[float, float, float]:
    c, s = math.cos(pose_i[2]), math.sin(pose_i[2])
    dx, dy = pose_j[0] - pose_i[0], pose_j[1] - pose_i[1]
    angle = pose_j[2] - pose_i[2] - measured[2]
    angle -= 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return c * dx + s * dy - measured[0], -s * dx + c * dy - measured[1], angle


@kernel
def _distances(poses: Pose, ends: Ints, measured: Pose, information: Cov) -> Floats:
    distances = np.empty(len(ends))
    for e in range(len(ends)):
        x, y, t = _residual(poses[ends[e, 0]], poses[ends[e, 1]], measured[e])
        w = information[e]
        distances[e] = (
            x * (w[0, 0] * x + 2.0 * w[0, 1] * y + 2.0 * w[0, 2] * t)
            + y * (w[1, 1] * y + 2.0 * w[1, 2] * t)
            + w[2, 2] * t * t
        )
    return distances


@kernel
def _set_jacobians(theta: float, error: Floats, measured: Pose, jac_i: Floats, jac_j: Floats) -> None:
    """Set the elements that vary of A = de/dx_i and B = de/dx_j."""
    c, s = math.cos(theta), math.sin(theta)
    jac_i[0, 0], jac_i[0, 1], jac_i[0, 2] = -c, -s, error[1] + measured[1]
    jac_i[1, 0], jac_i[1, 1], jac_i[1, 2] = s, -c, -error[0] - measured[0]
    jac_j[0, 0], jac_j[0, 1] = c, s
    jac_j[1, 0], jac_j[1, 1] = -s, c


@kernel
def _set_weighted(
    weight: float,
    information: Floats,
    error: Floats,
    jac_i: Floats,
    jac_j: Floats,
    pull: Floats,
    half_i: Floats,
    half_j: Floats,
) -> float:
    """Set W e, W A and W B, and return e^T W e."""
    cost = 0.0
    for r in range(3):
        pull[r] = 0.0
        for k in range(3):
            pull[r] += weight * information[r, k] * error[k]
        cost += error[r] * pull[r]
        for k in range(3):
            half_i[r, k] = half_j[r, k] = 0.0
            for q in range(3):
                half_i[r, k] += weight * information[r, q] * jac_i[q, k]
                half_j[r, k] += weight * information[r, q] * jac_j[q, k]
    return cost


@kernel
def _accumulate(
    poses: Pose,
    is_held: Bools,
    ends: Ints,
    measured: Pose,
    information: Cov,
    weights: Floats,
    diagonal: Ints,
    upper: Ints,
    lower: Ints,
    first: Ints,
    stride: Ints,
    data: Floats,
    gradient: Floats,
) -> float:
    """Add J^T W J to the matrix and J^T W e to the gradient, and return the cost.

    With A = de/dx_i and B = de/dx_j: blocks (i, i), (j, j), (i, j) and (j, i); poses that are held have none.
    """
    jac_i, jac_j = np.zeros((3, 3)), np.zeros((3, 3))
    half_i, half_j = np.empty((3, 3)), np.empty((3, 3))
    error, pull = np.empty(3), np.empty(3)
    jac_i[2, 2], jac_j[2, 2] = -1.0, 1.0
    cost = 0.0
    for e in range(len(ends)):
        i, j, weight = ends[e, 0], ends[e, 1], weights[e]
        if weight == 0.0:
            continue
        error[0], error[1], error[2] = _residual(poses[i], poses[j], measured[e])
        _set_jacobians(poses[i, 2], error, measured[e], jac_i, jac_j)
        cost += _set_weighted(weight, information[e], error, jac_i, jac_j, pull, half_i, half_j)
        ii, jj, ij, ji = diagonal[i], diagonal[j], upper[e], lower[e]
        has_i, has_j = not is_held[i], not is_held[j]
        for r in range(3):
            for q in range(3):
                if has_i:
                    gradient[3 * i + r] += jac_i[q, r] * pull[q]
                if has_j:
                    gradient[3 * j + r] += jac_j[q, r] * pull[q]
            for k in range(3):
                to_ii = to_jj = to_ij = 0.0
                for q in range(3):
                    to_ii += jac_i[q, r] * half_i[q, k]
                    to_jj += jac_j[q, r] * half_j[q, k]
                    to_ij += jac_i[q, r] * half_j[q, k]
                if has_i and k >= r:  # symmetric to the last bit
                    data[first[ii] + k * stride[ii] + r] += to_ii
                    if k > r:
                        data[first[ii] + r * stride[ii] + k] += to_ii
                if has_j and k >= r:
                    data[first[jj] + k * stride[jj] + r] += to_jj
                    if k > r:
                        data[first[jj] + r * stride[jj] + k] += to_jj
                if has_i and has_j:
                    data[first[ij] + k * stride[ij] + r] += to_ij
                    data[first[ji] + r * stride[ji] + k] += to_ij
    return cost
