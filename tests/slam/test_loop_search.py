"""A closure that waits says where others should match, if it is right."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.matchers import find_matcher
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loop_search import LoopSearch, matched
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from tests.slam.graphs import step_of

N_LAP = 16
WAITS = Closure(
    scan=18, i=2, j=2 + N_LAP, pose=np.zeros(3), covariance=1e-4 * np.eye(3), score=0.7, distance=400.0,
    outcome=ClosureOutcome.WAITING, confidence=0.9,
)  # fmt: skip


def driven(off: float) -> GrowingMap:
    """A drive of which the first 21 keyframes are 16 and five of them again, where the graph has them metres off."""
    log = cs.simulate("office", n_scans=6 * N_LAP, seed=4)
    scans, poses = list(log)[::6], log.truth.poses[::6]
    growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    growing.start(scans[0], 0)
    order = [*range(N_LAP), *range(5)]
    for before, k in pairwise(order):
        motion = se2.between(poses[before], poses[k]) + np.array([off * (k < before), 0.0, 0.0])
        growing.append(scans[k], step_of(k), UncertainPose(motion, np.diag([0.01, 0.01, 0.001])))
    return growing


@pytest.fixture(scope="module")
def drifted() -> GrowingMap:
    """The end lies 30 m off."""
    return driven(30.0)


@pytest.mark.parametrize(
    ("waiting", "is_followed"),
    [
        (WAITS, True),
        (replace(WAITS, outcome=ClosureOutcome.AGREED), False),
        (replace(WAITS, pose=np.array([60.0, 0.0, 0.0])), False),  # sees nothing of it
    ],
)
def test_beside_a_closure_that_waits_others_are_tried(drifted, waiting, is_followed):
    k = drifted.graph.n_poses - 1
    search = LoopSearch(drifted)
    search._pool = [waiting]
    search.enqueue(k)
    tried = [c for c in search._queue if c.i < N_LAP - 4]
    assert bool(tried) is is_followed
    assert all(abs(c.i - (k - N_LAP)) <= 3 for c in tried)
    assert len({(c.i, c.j) for c in tried}) == len(tried)  # none twice


@pytest.mark.parametrize("off", [0.0, 30.0])
def test_nothing_is_tried_where_the_graph_looks_anyway(off):
    growing = driven(off)
    search = LoopSearch(growing)
    assert bool(search._beside(WAITS, growing.graph.n_poses - 1)) is (off > 0.0)


def test_others_are_matched_where_the_one_that_waits_says_and_gain_nothing_by_it(drifted):
    search, poses, k = LoopSearch(drifted), drifted.graph.poses, drifted.graph.n_poses - 1
    found = search._beside(WAITS, k)
    here = se2.compose(poses[WAITS.i], se2.between(poses[WAITS.j], poses[k]))
    assert found
    for one in found:
        np.testing.assert_allclose(one.asked, se2.between(poses[one.i], here), atol=1e-9)
    asked = matched(drifted.keyframes, poses, drifted.config, 0, found)
    alone = matched(drifted.keyframes, poses, drifted.config, 0, [one._replace(asked=None) for one in found])
    for by_pose, free in zip(asked, alone, strict=True):
        assert by_pose.confidence == pytest.approx(free.confidence, abs=0.02)
        np.testing.assert_allclose(by_pose.pose, free.pose, atol=0.01)
