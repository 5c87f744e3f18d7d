"""GrowingMap: how a keyframe is tied to the one before it."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.keyframes import Keyframes
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
