"""ATE, RPE and association as their definitions say: homogeneous matrices, an SVD, loops."""

from __future__ import annotations

import math

import numpy as np


def matrix(pose):
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def umeyama(source, target):
    """Rigid motion with the least squared distances: Umeyama 1991, eqs. 38 to 42, without scale."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a / len(a))
    s = np.diag([1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    r = u @ s @ vt
    return r, target.mean(axis=0) - r @ source.mean(axis=0)


def ate(poses, reference, alignment):
    own = [matrix(p) for p in poses]
    goal = [matrix(p) for p in reference]
    if alignment == "best":
        r, t = umeyama(np.array(poses)[:, :2], np.array(reference)[:, :2])
        move = np.eye(3)
        move[:2, :2], move[:2, 2] = r, t
    else:
        move = goal[0] @ np.linalg.inv(own[0])
    return np.array([np.linalg.norm((move @ p)[:2, 2] - q[:2, 2]) for p, q in zip(own, goal, strict=True)])


def rpe(poses, reference, pairs):
    """Translation and rotation of (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), Sturm et al. 2012, eq. 1."""
    errors = []
    for i, j in pairs:
        q = np.linalg.inv(matrix(reference[i])) @ matrix(reference[j])
        p = np.linalg.inv(matrix(poses[i])) @ matrix(poses[j])
        e = np.linalg.inv(q) @ p
        errors.append((np.linalg.norm(e[:2, 2]), abs(math.atan2(e[1, 0], e[0, 0]))))
    return np.array(errors).reshape(-1, 2)


def associate(first, second, tolerance):
    """All pairs within the tolerance, equal ones first, then the nearest; each stamp once; in the order of `first`."""
    candidates = sorted(
        (abs(a - b), i, j) for i, a in enumerate(first) for j, b in enumerate(second) if abs(a - b) <= tolerance
    )
    pairs, used_first, used_second = [], set(), set()
    for _, i, j in candidates:
        if i not in used_first and j not in used_second:
            pairs.append((i, j))
            used_first.add(i)
            used_second.add(j)
    return sorted(pairs)
