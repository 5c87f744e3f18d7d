"""Bending: a map that folds the odometry is told from one that puts a slip right."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.slam.loops.bending import bending, greatest_turn, suspects
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.slam.pose_graph.optimization import Edges
from curvescan.types import Ints, Pose


def _straight(n: int, step: float) -> Pose:
    return np.column_stack((step * np.arange(n), np.zeros(n), np.zeros(n)))


def _steps(poses: Pose) -> tuple[Edges, Ints]:
    """Return the motion model's edges of a way, 0.3 m and 0.3 rad wide."""
    n = len(poses)
    ends = np.column_stack((np.arange(n - 1), np.arange(1, n)))
    measured = se2.between(poses[:-1], poses[1:])
    covariances = np.tile(0.09 * np.eye(3), (n - 1, 1, 1))
    return Edges.of(ends, measured, covariances), np.full(n - 1, EdgeKind.MOTION)


def test_a_way_as_the_odometry_has_it_is_not_bent() -> None:
    way = _straight(200, 0.5)
    assert bending(way, _steps(way)[0]) == 0.0


def test_one_slip_that_a_closure_puts_right_counts_for_nothing() -> None:
    way = _straight(200, 0.5)
    edges, _ = _steps(way)
    way[100:, 0] += 3.0
    assert bending(way, edges) < 1e-9


def test_a_way_folded_to_nothing_is_bent_by_its_mean_squared_distance() -> None:
    edges, _ = _steps(_straight(201, 0.5))
    folded = _straight(201, 0.0)
    # of 200 steps of 0.5 m, 0.3 m wide, the two worst are left out
    np.testing.assert_allclose(bending(folded, edges), 198 / 200 * 0.25 / 0.09)


def test_a_fold_at_one_step_shows_in_its_turn_and_not_in_the_mean() -> None:
    way = _straight(200, 0.5)
    edges, kinds = _steps(way)
    kinds[:] = EdgeKind.MATCH
    folded = way.copy()
    folded[100:, 0] = way[100, 0] - (way[100:, 0] - way[100, 0])
    folded[100:, 2] = np.pi
    assert bending(folded, edges) < 1e-9
    np.testing.assert_allclose(greatest_turn(folded, edges, kinds), np.pi)
    assert greatest_turn(way, edges, kinds) == 0.0


def test_a_step_that_no_match_measured_may_turn() -> None:
    way = _straight(200, 0.5)
    edges, kinds = _steps(way)
    way[100:, 2] += 1.0
    assert greatest_turn(way, edges, kinds) == 0.0


def _closure(i: int, j: int, outcome: ClosureOutcome) -> Closure:
    return Closure(
        scan=j, i=i, j=j, pose=np.zeros(3), covariance=np.eye(3), score=0.5, distance=1.0,
        outcome=outcome,
    )  # fmt: skip


def test_what_was_believed_from_the_first_agreement_on_is_suspected() -> None:
    closures = [
        _closure(0, 10, ClosureOutcome.ACCEPTED),
        _closure(0, 20, ClosureOutcome.AGREED),
        _closure(20, 22, ClosureOutcome.ACCEPTED),
        _closure(1, 23, ClosureOutcome.NO_MATCH),
        _closure(2, 24, ClosureOutcome.ACCEPTED),
    ]
    assert suspects(closures, 3, all_of_them=False) == {1, 4}
    assert suspects(closures, 3, all_of_them=True) == {0, 1, 4}
