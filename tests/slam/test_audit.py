"""Matches that contradict a finished map count where those of five keyframes agree, or those of ten fail."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from curvescan import se2
from curvescan.slam.config import SlamConfig
from curvescan.slam.loop_search import LoopSearch
from curvescan.slam.loops.agreement import MOST_LOG_ODDS
from curvescan.slam.loops.audit import Contradiction, contradictions, groups_against
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.loops.cycles import Chain
from curvescan.slam.loops.overlap import N_SECTORS

CONFIG = SlamConfig()
POSES = np.column_stack((np.arange(40) * 0.5, np.zeros(40), np.zeros(40)))


def _refused(i: int, j: int, off: list[float], confidence: float = 0.99) -> Closure:
    pose = se2.compose(se2.between(POSES[i], POSES[j]), np.array(off))
    return Closure(
        scan=j, i=i, j=j, pose=pose, covariance=1e-4 * np.eye(3), score=0.7, distance=100.0,
        outcome=ClosureOutcome.UNEXPECTED, confidence=confidence,
    )  # fmt: skip


def _said(tried: list[Closure]) -> list[Contradiction]:
    return contradictions(groups_against(tried, POSES, CONFIG), POSES, 100 + np.arange(40))


def test_matches_of_five_keyframes_that_agree_contradict_the_map() -> None:
    group = [_refused(2 + k, 30 + k, [1.0, 0.5, 0.0]) for k in range(5)]
    (found,) = _said(group)
    assert found.pairs.tolist() == [[102 + k, 130 + k] for k in range(5)]
    np.testing.assert_allclose(found.place, [16.0, 0.0])
    np.testing.assert_allclose(found.off, [1.0, 0.5, 0.0], atol=1e-12)


def test_what_disagrees_or_fits_the_map_contradicts_nothing() -> None:
    disagreeing = [_refused(2 + k, 30 + k, [1.0 + k, 0.0, 0.0]) for k in range(5)]
    assert groups_against([_refused(2 + k, 30 + k, [0.01, 0.0, 0.0]) for k in range(5)], POSES, CONFIG) == []
    assert [len(group) for group in groups_against(disagreeing, POSES, CONFIG)] == [1] * 5
    assert _said(disagreeing) == []


def test_no_set_is_likely_that_puts_a_place_farther_away_than_ways_slip() -> None:
    (group,) = groups_against([_refused(2 + k, 30 + k, [60.0, 0.5, 0.0]) for k in range(5)], POSES, CONFIG)
    assert max(closure.expectation for closure in group) < -MOST_LOG_ODDS


def test_one_keyframe_alone_contradicts_nothing() -> None:
    group = [_refused(2 + k, 30, [1.0, 0.5, 0.0]) for k in range(6)]
    assert len(groups_against(group, POSES, CONFIG)) == 1
    assert _said(group) == []


def test_matches_of_far_stretches_are_no_set() -> None:
    apart = [_refused(1, 12, [1.0, 0.5, 0.0]), _refused(2, 34, [1.0, 0.5, 0.0])]
    assert [len(group) for group in groups_against(apart, POSES, CONFIG)] == [1, 1]


def test_a_map_that_is_off_by_less_than_half_a_metre_is_not_bent() -> None:
    near = [_refused(2 + k, 30 + k, [0.3, 0.2, 0.0]) for k in range(5)]
    assert len(groups_against(near, POSES, CONFIG)) == 1
    assert _said(near) == []


NO = [0.0, 0.0, 0.0]


def _search(
    poses: np.ndarray, closures: list[Closure], n_known: int = 0, fragments: list[int] | None = None
) -> LoopSearch:
    """Return the search of a map that follows the last of its closures; each keyframe sees 5 m all around."""
    ends = np.array([(c.i, c.j) for c in closures[len(closures) - n_known :]]).reshape(-1, 2)
    are_followed = np.ones(n_known, dtype=bool)
    graph = SimpleNamespace(poses=poses, ends=ends, is_closure=are_followed, is_followed=are_followed)
    chain = Chain.of(poses, np.broadcast_to(1e-4 * np.eye(3), (40, 3, 3)))
    profiles = SimpleNamespace(array=np.full((40, 2, N_SECTORS), 5.0))
    keyframes = SimpleNamespace(numbers=np.arange(40), profiles=profiles)
    growing = SimpleNamespace(graph=graph, keyframes=keyframes, chain=lambda: chain, fragments=fragments or [0] * 40)
    search = LoopSearch(growing, CONFIG)  # type: ignore[arg-type]
    search.closures = closures
    return search


TWICE = np.vstack((POSES[:20], POSES[:20]))
"""A robot comes by the same places again."""


def _doubled(fails: list[bool], fragments: list[int] | None = None) -> list[Closure]:
    """Return what fails on TWICE, by which of the later keyframes do."""
    tried = [replace(_refused(k, 20 + k, NO), pose=np.zeros(3), distance=1.0) for k in range(len(fails))]
    nowhere = {"pose": np.full(3, np.nan), "distance": np.nan, "outcome": ClosureOutcome.NO_MATCH}
    return _search(TWICE, [replace(c, **nowhere) if fails[c.i] else c for c in tried], fragments=fragments).doubled()


def test_unsure_matches_that_agree_contradict_a_map_where_it_shows_places_twice() -> None:
    off = [replace(_refused(k, 20 + k, NO, 0.7), pose=np.array([2.0, 0.5, 0.0])) for k in range(12)]
    ((group, lead),) = _search(TWICE, off).audit()
    assert [(c.i, c.j) for c in group] == [(k, 20 + k) for k in range(12)]
    assert _search(TWICE, off[:9]).audit() == []
    ((_, sure),) = _search(TWICE, [replace(c, confidence=0.99) for c in off]).audit()
    assert sure > lead


def test_a_map_that_shows_places_twice_is_contradicted_by_matches_that_fail_in_a_row() -> None:
    """A tear that no match sees: what lies on each other are different places."""
    failed = _doubled([False] * 5 + [True] * 12)
    assert [(c.i, c.j) for c in failed] == [(k, 20 + k) for k in range(5, 17)]
    (found,) = contradictions([failed], POSES, np.arange(40))
    assert len(found.pairs) == 12
    assert np.isnan(found.off).all()


def test_single_matches_fail_on_a_map_that_is_right() -> None:
    """People, doors and furniture hide what the map shows."""
    assert _doubled([True, False] * 9) == []
    assert _doubled([True] * 9) == []


def test_parts_of_a_map_that_nothing_joins_do_not_show_places_twice() -> None:
    assert len(_doubled([True] * 12)) == 12
    assert _doubled([True] * 12, [0] * 20 + [1] * 20) == []


def _lead(known: list[Closure]) -> float:
    """Return the lead of matches that put the way back of POSES a metre on, over closures that the map follows."""
    back = np.vstack((POSES[:20], POSES[19::-1]))
    refused = [replace(_refused(2 + k, 37 - k, NO), pose=np.array([1.0, 0.0, 0.0])) for k in range(5)]
    ((group, lead),) = _search(back, [*refused, *known], len(known)).audit()
    assert len(group) == 5
    return lead


def test_views_from_afar_do_not_defend_a_map() -> None:
    """They are found where the graph has them, whether it is right or not."""
    near = [replace(_refused(3 + k, 35 - k, NO), pose=np.array([0.5, 0.0, 0.0]), expectation=6.0) for k in range(2)]
    far = [replace(_refused(3 + k, 28 - k, NO), pose=np.array([4.0, 0.0, 0.0]), expectation=6.0) for k in range(2)]
    assert _lead(far) == _lead([])
    assert _lead(near) < _lead([]) - 8.0
