"""Cycles: two loop closures and the ways of the graph between their ends, which must close within their covariances.

Mangelson et al. 2018, eq. 3. Scalars all the way: a hundred pairs are tried for each closure that waits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Cov, Floats, Ints, Pose


class Chain(NamedTuple):
    """Keyframes, and the chain of motions that leads along them."""

    poses: Pose  # (n, 3): of the keyframes
    gathered: Cov  # (n, 3, 3): covariance that the motions have gathered by each; see :func:`gathered_covariances`

    @classmethod
    def of(cls, poses: Pose, motions: Cov) -> Chain:
        """Return a chain by its (n, 3) poses and (n, 3, 3) covariance of the motion to each."""
        return cls(poses.copy(), gathered_covariances(poses, motions))

    def extended(self, poses: Pose, motions: Cov) -> Chain:
        """Return a chain with more poses and motions; the first of them are those of its end."""
        gathered = self.gathered[-1] + gathered_covariances(poses, motions)[1:]
        return Chain(np.concatenate((self.poses, poses[1:])), np.concatenate((self.gathered, gathered)))


@kernel
def cycle_distances(
    ends: Ints, measured: Pose, covariances: Cov, poses: Pose, gathered: Cov, spread: Floats, step: float, known: float
) -> Floats:
    """Return (n, n) squared Mahalanobis distance by which the cycle through each two closures does not close.

    ends (n, 2), measured (n, 3), covariances (n, 3, 3): of the closures; poses (k, 3), gathered (k, 3, 3): of all
    keyframes, see :class:`Chain`; spread (3,): variances of an edge, of which each `step` metres between two keyframes
    take one; known: standard deviation up to which the motions of a way count, metres. One known no better is taken to
    err as edges usually do: the next room would agree with it as well.
    """
    n = len(ends)
    found = np.zeros((n, n))
    for a in range(n):
        for b in range(a):
            found[a, b] = found[b, a] = _cycle_distance(
                ends[a], measured[a], covariances[a], ends[b], measured[b], covariances[b],
                poses, gathered, spread, step, known,
            )  # fmt: skip
    return found


@kernel
def _between(a: Pose, b: Pose) -> tuple[float, float, float]:
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return c * dx + s * dy, -s * dx + c * dy, wrap_angle(b[2] - a[2])


@kernel
def _n_edges(x: float, y: float, step: float, is_same: bool) -> float:
    return 0.0 if is_same else 1.0 + math.sqrt(x * x + y * y) / step


@kernel
def _by_chain(
    gathered: Cov, a: int, b: int, x: float, y: float, heading: float, known: float
) -> tuple[float, float, float, float, float, float]:
    """Return the covariance (xx, xy, yy, xt, yt, tt) of the motions from a to b, seen by a frame of a heading."""
    late, early = gathered[max(a, b)], gathered[min(a, b)]
    xt, yt, tt = late[0, 2] - early[0, 2], late[1, 2] - early[1, 2], late[2, 2] - early[2, 2]
    h0, h1 = xt - y * tt, yt + x * tt
    xx = late[0, 0] - early[0, 0] - y * (xt + h0)
    xy = late[0, 1] - early[0, 1] + x * xt - y * h1
    yy = late[1, 1] - early[1, 1] + x * (yt + h1)
    if max(xx, yy) > known * known:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    c, s = math.cos(heading), math.sin(heading)
    return (
        c * c * xx + 2.0 * c * s * xy + s * s * yy,
        c * s * (yy - xx) + (c * c - s * s) * xy,
        s * s * xx - 2.0 * c * s * xy + c * c * yy,
        c * h0 + s * h1,
        c * h1 - s * h0,
        tt,
    )


@kernel
def _cycle_distance(
    ends_1: Ints, pose_1: Pose, cov_1: Cov, ends_2: Ints, pose_2: Pose, cov_2: Cov,
    poses: Pose, gathered: Cov, spread: Floats, step: float, known: float,
) -> float:  # fmt: skip
    """Return how far i2 -> i1 -> j1 -> j2 is from the second closure: squared Mahalanobis distance."""
    xi, yi, ti = _between(poses[ends_2[0]], poses[ends_1[0]])
    xj, yj, tj = _between(poses[ends_1[1]], poses[ends_2[1]])
    n_i = _n_edges(xi, yi, step, ends_1[0] == ends_2[0])
    n_j = _n_edges(xj, yj, step, ends_1[1] == ends_2[1])
    ci, si = math.cos(ti), math.sin(ti)
    c1, s1 = math.cos(pose_1[2]), math.sin(pose_1[2])
    # the way at j seen from i1, the way behind i1 seen from i2
    xr, yr = c1 * xj - s1 * yj, s1 * xj + c1 * yj
    x1, y1 = pose_1[0] + xr, pose_1[1] + yr
    dx, dy = ci * x1 - si * y1, si * x1 + ci * y1
    ex, ey = pose_2[0] - xi - dx, pose_2[1] - yi - dy
    et = wrap_angle(pose_2[2] - ti - pose_1[2] - tj)
    # the closure's own covariance, moved to the end of the way at j
    h0 = cov_1[0, 2] - yr * cov_1[2, 2]
    h1 = cov_1[1, 2] + xr * cov_1[2, 2]
    a00 = cov_1[0, 0] - yr * (cov_1[0, 2] + h0)
    a01 = cov_1[0, 1] + xr * cov_1[0, 2] - yr * h1
    a11 = cov_1[1, 1] + xr * (cov_1[1, 2] + h1)
    # turned into the frame of i2, with that of the ways and of the second closure
    wi, wj = n_i * spread[2], n_j * spread[2]
    # what the motions of both ways gathered moves keyframe j2, seen from i2
    start, end = poses[ends_2[0]], poses[ends_2[1]]
    c, s = math.cos(start[2]), math.sin(start[2])
    x2, y2 = start[0] + c * (xi + dx) - s * (yi + dy), start[1] + s * (xi + dx) + c * (yi + dy)
    gi = _by_chain(gathered, ends_2[0], ends_1[0], x2, y2, start[2], known)
    seen_by_j = end[2] - tj - pose_1[2] - ti
    gj = _by_chain(gathered, ends_1[1], ends_2[1], end[0], end[1], seen_by_j, known)
    b00 = ci * (ci * a00 - si * a01) - si * (ci * a01 - si * a11)
    b01 = si * (ci * a00 - si * a01) + ci * (ci * a01 - si * a11)
    b11 = si * (si * a00 + ci * a01) + ci * (si * a01 + ci * a11)
    isotropic = n_i * spread[0] + n_j * spread[0]
    m00 = b00 + isotropic + wi * dy * dy + cov_2[0, 0] + gi[0] + gj[0]
    m01 = b01 - wi * dx * dy + cov_2[0, 1] + gi[1] + gj[1]
    m11 = b11 + isotropic + wi * dx * dx + cov_2[1, 1] + gi[2] + gj[2]
    m02 = ci * h0 - si * h1 - wi * dy + cov_2[0, 2] + gi[3] + gj[3]
    m12 = si * h0 + ci * h1 + wi * dx + cov_2[1, 2] + gi[4] + gj[4]
    m22 = cov_1[2, 2] + wi + wj + cov_2[2, 2] + gi[5] + gj[5]
    # m = L D L^T from below: the rotation first
    l0, l1 = m02 / m22, m12 / m22
    p00, p01, p11 = m00 - l0 * m02, m01 - l0 * m12, m11 - l1 * m12
    ux, uy = ex - l0 * et, ey - l1 * et
    determinant = p00 * p11 - p01 * p01
    distance: float = et * et / m22 + (p11 * ux * ux - 2.0 * p01 * ux * uy + p00 * uy * uy) / determinant
    return distance


def gathered_covariances(poses: Pose, motions: Cov) -> Cov:
    """Return the (n, 3, 3) covariance that a chain of motions gathers by each pose, moving the whole plane.

    The difference of two is that of the way between: what it makes of the origin, in the frame of the poses.
    """
    moved = np.zeros((len(poses), 3, 3))
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    moved[1:, 0, 0], moved[1:, 0, 1], moved[1:, 0, 2] = c, -s, poses[1:, 1]
    moved[1:, 1, 0], moved[1:, 1, 1], moved[1:, 1, 2] = s, c, -poses[1:, 0]
    moved[1:, 2, 2] = 1.0
    found: Cov = np.cumsum(moved @ motions @ moved.transpose(0, 2, 1).copy(), axis=0)
    return found
