"""GrowingMap: how a keyframe is tied to the one before it."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.pose_graph.graph import EdgeKind


@pytest.fixture(scope="module")
def scans() -> list[cs.LaserScan]:
    return list(cs.simulate("office", seed=1, n_scans=3, odometry_noise=None))


def test_a_motion_of_which_nothing_is_known_leaves_the_matrix_its_digits(
    scans: list[cs.LaserScan],
) -> None:
    growing = GrowingMap(Keyframes("curvescan", None, 10), SlamConfig())
    growing.start(scans[0], 0, np.zeros(3), 0)
    lost = UncertainPose(np.zeros(3), np.diag([1e6, 1e6, 10.0]))
    growing.append(scans[2], 2, lost, is_measured=False)
    is_motion = growing.graph.kinds == EdgeKind.MOTION
    assert np.linalg.eigvalsh(growing.graph.covariances[is_motion][0]).max() < 1e3


def test_a_closure_moves_the_keyframes_since_the_last_optimization_as_one(
    scans: list[cs.LaserScan],
) -> None:
    """How they lie to each other is the odometry's: of one by one, those before and after a closure would come apart."""
    growing = GrowingMap(Keyframes("curvescan", None, 10), SlamConfig())
    growing.start(scans[0], 0, np.zeros(3), 0)
    for k in (1, 2, 1, 2):
        motion = UncertainPose(np.array([0.5, 0.0, 0.0]), np.diag([0.01, 0.01, 0.001]))
        growing.append(scans[k], k, motion, is_measured=True)
    before = growing.graph.poses.copy()
    chain = growing.chain().poses
    closure = Closure(
        scan=5, i=0, j=3, pose=before[3] + [0.3, 0.1, 0.0], covariance=1e-6 * np.eye(3),
        score=0.9, distance=1.0, outcome=ClosureOutcome.ACCEPTED,
    )  # fmt: skip
    growing.close(closure)
    after = growing.graph.poses
    assert np.hypot(*(after[3] - before[3])[:2]) > 0.1
    moved = se2.between(before[1:], before[1:2]) - se2.between(after[1:], after[1:2])
    assert np.abs(moved).max() < 1e-9
    # cycles are closed along the odometry in any case
    np.testing.assert_allclose(growing.chain().poses, chain, atol=1e-12)
