"""Cycles: the distance by which two closures contradict each other is that of composing uncertain poses one by one."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose, compose, inverse
from curvescan.slam.loops.cycles import Chain, cycle_distances
from curvescan.types import Cov, Pose

_SPREAD = np.diag([1e-4, 1e-4, 1.6e-5])


def _by_graph(a: int, b: int, poses: Pose, motions: Cov) -> UncertainPose:
    if a == b:
        return UncertainPose(np.zeros(3), np.zeros((3, 3)))
    pose = se2.between(poses[a], poses[b])
    n_edges = 1.0 + float(np.hypot(pose[0], pose[1])) / 0.5
    way = UncertainPose(np.zeros(3), np.zeros((3, 3)))
    for k in range(min(a, b) + 1, max(a, b) + 1):
        way = compose(way, UncertainPose(se2.between(poses[k - 1], poses[k]), motions[k]))
    if a > b:
        way = inverse(way)
    return UncertainPose(pose, way.covariance + n_edges * _SPREAD)


def _twin(ends: np.ndarray, measured: Pose, covariances: Cov, poses: Pose, motions: Cov) -> np.ndarray:
    n = len(ends)
    found = np.zeros((n, n))
    for a in range(n):
        for b in range(a):
            one, other = (UncertainPose(measured[k], covariances[k]) for k in (a, b))
            to_i = _by_graph(ends[b, 0], ends[a, 0], poses, motions)
            to_j = _by_graph(ends[a, 1], ends[b, 1], poses, motions)
            around = compose(compose(to_i, one), to_j)
            # the constant motion that leads from one to the other, as it moves the whole plane
            x, y, turn = se2.log(se2.compose(other.pose, se2.inverse(around.pose)))
            off = np.array([x - around.pose[1] * turn, y + around.pose[0] * turn, turn])
            found[a, b] = found[b, a] = off @ np.linalg.solve(around.covariance + other.covariance, off)
    return found


def test_it_is_that_of_composing_and_fusing_the_poses_of_the_cycle() -> None:
    rng = np.random.default_rng(4)
    n, n_poses = 12, 20
    poses = rng.uniform(-3.0, 3.0, (n_poses, 3))
    ends = np.sort(rng.integers(0, n_poses, (n, 2)), axis=1)
    ends[3], ends[5, 0] = ends[4], ends[6, 0]  # same keyframes: no way between
    measured = se2.between(poses[ends[:, 0]], poses[ends[:, 1]])
    measured += 0.1 * rng.standard_normal(measured.shape)
    roots = 0.1 * rng.standard_normal((n, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-4 * np.eye(3)
    roots = 0.02 * rng.standard_normal((n_poses, 3, 3))
    motions = roots @ roots.transpose(0, 2, 1)
    gathered = Chain.of(poses, motions).gathered
    for known, counted in ((np.inf, motions), (0.0, 0.0 * motions)):
        given, rows = (ends, (measured, covariances), Chain(poses, gathered)), np.arange(n)
        found = cycle_distances(*given, (rows, rows), _SPREAD, 0.5, known)
        twin = _twin(ends, measured, covariances, poses, counted)
        np.testing.assert_allclose(found, twin, rtol=1e-6, atol=1e-12)
        # what is not asked is not known
        some = cycle_distances(*given, (rows[:3], rows[2:5]), _SPREAD, 0.5, known)
        is_asked = np.zeros((n, n), dtype=bool)
        is_asked[:3, 2:5] = is_asked[2:5, :3] = True
        np.testing.assert_array_equal(some, np.where(is_asked, found, np.nan))


def test_true_closures_agree_and_one_that_is_a_metre_off_with_none() -> None:
    poses = np.column_stack((np.arange(8) * 0.5, np.zeros(8), np.zeros(8)))
    ends = np.array([[0, 4], [1, 5], [2, 6], [3, 7]])
    measured = se2.between(poses[ends[:, 0]], poses[ends[:, 1]])
    measured[2, 0] += 1.0
    covariances = np.tile(1e-4 * np.eye(3), (4, 1, 1))
    chain, rows = Chain(poses, np.zeros((8, 3, 3))), np.arange(4)
    found = cycle_distances(ends, (measured, covariances), chain, (rows, rows), _SPREAD, 0.5, 0.25)
    agrees = found < 16.0
    assert agrees[np.ix_([0, 1, 3], [0, 1, 3])].all()
    assert not agrees[2, [0, 1, 3]].any()
