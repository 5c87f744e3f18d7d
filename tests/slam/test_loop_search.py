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
from curvescan.slam.loop_search import LoopSearch
from curvescan.slam.loops.closures import Closure, ClosureOutcome

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
    growing.start(scans[0], 0, np.zeros(3))
    order = [*range(N_LAP), *range(5)]
    for before, k in pairwise(order):
        motion = se2.between(poses[before], poses[k]) + np.array([off * (k < before), 0.0, 0.0])
        growing.append(scans[k], k, UncertainPose(motion, np.diag([0.01, 0.01, 0.001])))
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
    search = LoopSearch(drifted, drifted.config)
    search._pool = [waiting]
    search.enqueue(k)
    tried = [c for c in search._queue if c.i < N_LAP - 4]
    assert bool(tried) is is_followed
    assert all(abs(c.i - (k - N_LAP)) <= 3 for c in tried)


@pytest.mark.parametrize("off", [0.0, 30.0])
def test_nothing_is_tried_twice_nor_where_the_graph_looks_anyway(off):
    growing = driven(off)
    k = growing.graph.n_poses - 1
    search = LoopSearch(growing, growing.config)
    found = search._beside(WAITS, k)
    assert bool(found) is (off > 0.0)
    search._queue += found
    assert search._beside(WAITS, k) == []
