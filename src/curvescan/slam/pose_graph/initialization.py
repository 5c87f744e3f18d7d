"""Chordal initialization: poses from which Gauss-Newton converges, from the edges alone.

Martinec and Pajdla, "Robust rotation and translation estimation in multiview reconstruction", CVPR 2007; Carlone, Tron, Daniilidis and
Dellaert, "Initialization techniques for 3D SLAM", ICRA 2015. In the plane a rotation is a unit vector u = (cos, sin), an edge asks
for u_j = R(theta_ij) u_i, and without the constraint |u| = 1 that is linear least squares. With the rotations known, so are the
translations.
"""

from __future__ import annotations

import numpy as np

from curvescan.slam.pose_graph.optimization import Edges
from curvescan.slam.pose_graph.sparse import BlockPattern, block_pattern, factorize
from curvescan.types import Floats, Ints, Pose


def chordal_poses(poses: Pose, edges: Edges, weights: Floats, anchors: Ints) -> Pose:
    """Return poses near the optimum, whatever the given ones are.

    poses (n, 3); weights (m,); anchors (k,); result (n, 3).
    """
    pattern = block_pattern(len(poses), edges.ends, 2)
    angles = _rotations(poses, edges, weights, anchors, pattern)
    places = _translations(poses, angles, edges, weights, anchors, pattern)
    return np.column_stack((places, angles))


def _rotations(poses: Pose, edges: Edges, weights: Floats, anchors: Ints, pattern: BlockPattern) -> Floats:
    # variance of the angle with the translation left open
    strength = weights / np.linalg.inv(edges.information)[:, 2, 2]
    c, s = np.cos(edges.measured[:, 2]), np.sin(edges.measured[:, 2])
    turn = np.stack((np.stack((c, -s), -1), np.stack((s, c), -1)), -2)
    eye = np.broadcast_to(np.eye(2), turn.shape)
    known = np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    hold = float(1e3 * strength.max(initial=1.0))
    # e = u_j - R u_i
    data, right = _assemble(pattern, edges.ends, -turn, eye, strength[:, None, None] * eye, None)
    _hold(pattern, data, right, anchors, known, hold)
    u = factorize(pattern, data).solve(right).reshape(-1, 2)
    return np.arctan2(u[:, 1], u[:, 0])


def _translations(
    poses: Pose, angles: Floats, edges: Edges, weights: Floats, anchors: Ints, pattern: BlockPattern
) -> Floats:
    c, s = np.cos(angles[edges.ends[:, 0]]), np.sin(angles[edges.ends[:, 0]])
    turn = np.stack((np.stack((c, -s), -1), np.stack((s, c), -1)), -2)
    # information of the translation with the rotation left open, turned into the map
    marginal = np.linalg.inv(np.linalg.inv(edges.information)[:, :2, :2])
    strength = weights[:, None, None] * (turn @ marginal @ turn.transpose(0, 2, 1))
    wanted = np.einsum("mij,mj->mi", turn, edges.measured[:, :2])
    eye = np.broadcast_to(np.eye(2), turn.shape)
    hold = float(1e3 * strength.max(initial=1.0))
    # e = t_j - t_i - R_i t_ij
    data, right = _assemble(pattern, edges.ends, -eye, eye, strength, wanted)
    _hold(pattern, data, right, anchors, poses[:, :2], hold)
    return factorize(pattern, data).solve(right).reshape(-1, 2)


def _assemble(
    pattern: BlockPattern, ends: Ints, jac_i: Floats, jac_j: Floats, strength: Floats, wanted: Floats | None
) -> tuple[Floats, Floats]:
    """Return the entries of sum J^T S J and sum J^T S wanted, for residuals J_i x_i + J_j x_j - wanted."""
    data, right = np.zeros(pattern.n_entries), np.zeros((len(pattern.diagonal), 2))
    i, j = ends[:, 0], ends[:, 1]
    to_i, to_j = jac_i.transpose(0, 2, 1) @ strength, jac_j.transpose(0, 2, 1) @ strength
    for blocks, values in (
        (pattern.diagonal[i], to_i @ jac_i),
        (pattern.diagonal[j], to_j @ jac_j),
        (pattern.upper, to_i @ jac_j),
        (pattern.lower, to_j @ jac_i),
    ):
        for r in range(2):
            for c in range(2):
                place = pattern.first[blocks] + c * pattern.stride[blocks] + r
                data += np.bincount(place, values[:, r, c], minlength=len(data))
    if wanted is not None:
        np.add.at(right, i, np.einsum("mij,mj->mi", to_i, wanted))
        np.add.at(right, j, np.einsum("mij,mj->mi", to_j, wanted))
    return data, right.ravel()


def _hold(pattern: BlockPattern, data: Floats, right: Floats, anchors: Ints, known: Floats, strength: float) -> None:
    """Add to the system that the anchors are where they are known to be."""
    first = pattern.first[pattern.diagonal[anchors]]
    stride = pattern.stride[pattern.diagonal[anchors]]
    for r in range(2):
        data[first + r * stride + r] += strength
        right[2 * anchors + r] += strength * known[anchors, r]
