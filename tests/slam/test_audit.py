"""A finished map follows what refuses it where that says more than it costs, and is contradicted where matches fail."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from curvescan import se2
from curvescan.scan import LaserScan
from curvescan.slam.config import SlamConfig
from curvescan.slam.loop_search import LoopSearch
from curvescan.slam.loops.agreement import MOST_LOG_ODDS
from curvescan.slam.loops.audit import cost_of, sets_against
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.loops.overlap import N_SECTORS
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.robust import optimized

CONFIG = SlamConfig()
POSES = np.column_stack((np.arange(80) * 0.5, np.zeros(80), np.zeros(80)))


def _refused(i: int, j: int, off: list[float], confidence: float = 0.99) -> Closure:
    pose = se2.compose(se2.between(POSES[i], POSES[j]), np.array(off))
    return Closure(
        scan=j, i=i, j=j, pose=pose, covariance=1e-4 * np.eye(3), score=0.7, distance=100.0,
        outcome=ClosureOutcome.UNEXPECTED, confidence=confidence,
    )  # fmt: skip


def _sizes(tried: list[Closure]) -> list[int]:
    return [len(members) for _, members in sets_against(tried, POSES, CONFIG)]


def test_what_agrees_is_one_set_and_says_most_by_different_views() -> None:
    many, few = ([_refused(2 + k, 30 + k, [1.0, 0.5, 0.0], 0.999) for k in range(n)] for n in (16, 2))
    ((said, members),) = sets_against(many, POSES, CONFIG)
    assert [(c.i, c.j) for c in members] == [(2 + k, 30 + k) for k in range(16)]
    assert said == MOST_LOG_ODDS
    assert sets_against(few, POSES, CONFIG)[0][0] < 0.5 * said


def test_what_disagrees_or_fits_the_map_is_no_set_against_it() -> None:
    assert _sizes([_refused(2 + k, 30 + k, [0.01, 0.0, 0.0]) for k in range(5)]) == []
    assert _sizes([_refused(2 + k, 30 + k, [1.0 + k, 0.0, 0.0]) for k in range(5)]) == [1] * 5


def test_matches_of_far_stretches_are_no_set() -> None:
    assert _sizes([_refused(1, 12, [1.0, 0.5, 0.0]), _refused(2, 34, [1.0, 0.5, 0.0])]) == [1, 1]


def test_stretches_that_go_on_from_each_other_are_one_set_and_each_says_its_own() -> None:
    """Two corners look alike for a stretch; a map that is bent is so all along the way."""
    alike, along = ([_refused(k, 40 + k, [1.0, 0.5, 0.0]) for k in range(n)] for n in (18, 40))
    (said_alike,), (said_along,) = ([said for said, _ in sets_against(one, POSES, CONFIG)] for one in (alike, along))
    assert said_along >= 2.0 * said_alike
    bent = [*along[:20], *(_refused(k, 40 + k, [4.0, 0.5, 0.0]) for k in range(20, 40))]
    assert _sizes(bent) == [20, 20]


def _graph(n_closed: int = 0) -> PoseGraph:
    """Return a map along POSES: a step of its middle may have slipped by half a metre; closures tie its ends."""
    graph = PoseGraph()
    for pose in POSES:
        graph.add_pose(pose)
    for k in range(79):
        sigma = 0.5 if k == 39 else 0.01
        graph.add_edge(k, k + 1, np.array([0.5, 0.0, 0.0]), sigma**2 * np.eye(3), EdgeKind.MOTION)
    for k in range(n_closed):
        graph.add_edge(k, 60 + k, se2.between(POSES[k], POSES[60 + k]), 1e-4 * np.eye(3), EdgeKind.CLOSURE)
    return graph


def _cost(members: list[Closure], graph: PoseGraph) -> float:
    return cost_of(members, graph, optimized(graph, weights=graph.weights).costs)


def test_matches_cost_what_the_ways_and_closures_that_they_break_say() -> None:
    """A slip costs as much as it is unlikely, each closure that must go half of its limit besides."""
    members = [_refused(k, 65 + k, [1.0, 0.0, 0.0]) for k in range(10)]
    free, tied = (_cost(members, _graph(n)) for n in (0, 4))
    assert free == pytest.approx(0.5 * 2.0**2, rel=0.05)
    assert free + 4 * 8.0 < tied < free + 6 * 8.0


def test_what_the_graph_follows_in_no_case_costs_without_bound() -> None:
    members = [_refused(2, 65, [1.5 + 0.5 * k, 0.5, 0.0]) for k in range(4)]
    assert _cost(members, _graph(8)) == np.inf


NO = [0.0, 0.0, 0.0]
NOWHERE = {"pose": np.full(3, np.nan), "distance": np.nan, "outcome": ClosureOutcome.NO_MATCH}
TWICE = np.vstack((POSES[:20], POSES[:20]))
"""A robot comes by the same places again."""


def _search(
    graph: PoseGraph, closures: list[Closure], fragments: list[int] | None = None, *, are_alike: bool = False
) -> LoopSearch:
    """Return the search of a map; its keyframes see 5 m all around, the first half of them pillars at 3 m before it."""
    n = graph.n_poses
    profiles = SimpleNamespace(array=np.full((n, 2, N_SECTORS), 5.0))
    keyframes = SimpleNamespace(numbers=100 + np.arange(n), profiles=profiles)
    near = [3.0 if 2 * k < n and not are_alike else 5.0 for k in range(n)]
    ranges = [np.where(np.arange(360) // 20 % 2, 5.0, r) for r in near]
    around = {"angle_min": 0.0, "angle_increment": np.pi / 180.0, "range_max": 8.0}
    rows = [SimpleNamespace(number=100 + k, scan=LaserScan(r, **around)) for k, r in enumerate(ranges)]
    growing = SimpleNamespace(config=CONFIG, graph=graph, fragments=fragments or [0] * n, close=lambda closure: None)
    growing.keyframes = type("Rows", (), {"__getitem__": lambda _, k: rows[k], **vars(keyframes)})()
    search = LoopSearch(growing)  # type: ignore[arg-type]
    search.closures = {(100 + c.i, 100 + c.j): replace(c, i=100 + c.i, j=100 + c.j) for c in closures}
    return search


@pytest.mark.parametrize("confidence", [0.99, 0.9])
def test_matches_that_say_more_than_they_cost_are_followed_however_sure_each_is(confidence) -> None:
    """Along 20 m they say more than that the way between slipped; along 4 m they do not say more than closures do."""
    long, short = ([_refused(k, 40 + k, [1.0, 0.5, 0.0], confidence) for k in range(n)] for n in (40, 8))
    search = _search(_graph(), [replace(c, expectation=-20.0) for c in long])
    assert search.audit()
    accepted = [c for c in search.closures.values() if c.is_accepted]
    assert accepted
    assert {c.expectation for c in accepted} == {-20.0}  # as it was when they were matched
    search = _search(_graph(8), short)
    assert not search.audit()
    assert len(search.closures) == 8
    assert not any(c.is_accepted for c in search.closures.values())


def test_what_fails_where_the_map_has_the_keyframes_speaks_for_a_set_too() -> None:
    """It says 12.6 and costs 16; 20.6 where nothing fits the map there."""
    graph = PoseGraph()
    for pose in TWICE:
        graph.add_pose(pose)
    for k in range(39):
        cov = (0.2 if k == 19 else 0.01) ** 2 * np.eye(3)
        graph.add_edge(k, k + 1, se2.between(TWICE[k], TWICE[k + 1]), cov, EdgeKind.MOTION)
    off = [replace(_refused(k, 20 + k, NO), pose=np.array([1.0, 0.5, 0.0])) for k in range(8)]
    fits = [replace(_refused(k + 1, 20 + k, NO), pose=np.array([-0.5, 0.0, 0.0])) for k in range(8)]
    assert not _search(graph, off + fits).audit()
    assert _search(graph, off).audit()


def test_what_is_an_edge_already_is_not_followed_again() -> None:
    long = [_refused(k, 40 + k, [1.0, 0.5, 0.0]) for k in range(40)]
    graph = _graph()
    for one in long:
        graph.add_edge(one.i, one.j, one.pose, one.covariance, EdgeKind.CLOSURE, 0.0)
    assert not _search(graph, long).audit()


def _doubled(fails: list[bool], fragments: list[int] | None = None, *, are_alike: bool = False) -> list[list[int]]:
    """Return what fails on TWICE, by which of the later keyframes do; the graph refused all when they were tried."""
    tried = [replace(_refused(k, 20 + k, NO), pose=np.zeros(3)) for k in range(len(fails))]
    graph = PoseGraph()
    for pose in TWICE:
        graph.add_pose(pose)
    search = _search(graph, [replace(c, **NOWHERE) if fails[c.i] else c for c in tried], fragments, are_alike=are_alike)
    return [pair for found in search.doubled() for pair in found.pairs.tolist()]


def test_a_map_that_shows_places_twice_is_contradicted_by_matches_that_fail_in_a_row() -> None:
    """A tear that no match sees: what lies on each other are different places."""
    assert _doubled([False] * 5 + [True] * 12) == [[100 + k, 120 + k] for k in range(5, 17)]


def test_single_matches_fail_on_a_map_that_is_right() -> None:
    """People, doors and furniture hide what the map shows."""
    assert _doubled([True, False] * 9) == []
    assert _doubled([True] * 7) == []


def test_matches_that_fail_say_nothing_where_no_scan_sees_through_what_the_other_one_sees() -> None:
    """Rooms that are alike, and round ones: many matches leave open which room it is, or how the sensor stands."""
    assert len(_doubled([True] * 12)) == 12
    assert _doubled([True] * 12, are_alike=True) == []


def test_parts_of_a_map_that_nothing_joins_do_not_show_places_twice() -> None:
    assert len(_doubled([True] * 12)) == 12
    assert _doubled([True] * 12, [0] * 20 + [1] * 20) == []
