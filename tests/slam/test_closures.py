"""Closures: what a match must be like to be believed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import MatchResult
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.loops.closures import Closure, ClosureOutcome, judged, vaguely


@pytest.fixture(scope="module")
def result() -> MatchResult:
    scans = cs.simulate("office", seed=1, n_scans=3, odometry_noise=None)
    found = cs.match(scans[0], scans[2])
    assert found.ok
    assert found.degenerate_direction is None
    return dataclasses.replace(found, confidence=0.95)


def _outcome(result: MatchResult, sigma_along: float = 0.02) -> ClosureOutcome:
    config = SlamConfig()
    cov = np.diag(np.square([sigma_along, 0.02, 0.01]))
    expected = vaguely(UncertainPose(result.pose, cov), config)
    return judged(result, expected, config, scan=9, i=0, j=20).outcome


def test_a_match_where_the_graph_expects_it_is_believed(result: MatchResult) -> None:
    assert _outcome(result) is ClosureOutcome.ACCEPTED


def test_where_the_graph_is_vague_it_waits(result: MatchResult) -> None:
    assert _outcome(result, 1.0) is ClosureOutcome.WAITING


def test_a_match_that_is_likely_wrong_is_not_believed(result: MatchResult) -> None:
    doubtful = dataclasses.replace(result, confidence=0.3)
    assert _outcome(doubtful) is ClosureOutcome.LOW_CONFIDENCE


def test_a_matcher_without_a_confidence_is_judged_by_its_score(result: MatchResult) -> None:
    silent = dataclasses.replace(result, confidence=float("nan"), score=0.9)
    assert _outcome(silent) is ClosureOutcome.ACCEPTED
    poor = dataclasses.replace(silent, score=0.1)
    assert _outcome(poor) is ClosureOutcome.LOW_CONFIDENCE


def test_a_degenerate_match_counts_across_where_the_graph_knows_the_rest(result: MatchResult) -> None:
    along_x = dataclasses.replace(result, degenerate_direction=np.array([1.0, 0.0, 0.0]))
    assert _outcome(along_x) is ClosureOutcome.ACCEPTED
    assert _outcome(along_x, 1.0) is ClosureOutcome.DEGENERATE


def _judged_off(result: MatchResult, off_m: float, sigma_m: float = 0.3, *, j: int = 20) -> Closure:
    """Judge a match that lies off along x where the graph knows it to `sigma_m`."""
    config = SlamConfig()
    cov = np.diag(np.square([sigma_m, sigma_m, 0.02]))
    expected = vaguely(UncertainPose(result.pose - [off_m, 0.0, 0.0], cov), config)
    return judged(result, expected, config, scan=9, i=0, j=j)


def _off(result: MatchResult, off_m: float, sigma_m: float = 0.3, *, j: int = 20) -> ClosureOutcome:
    return _judged_off(result, off_m, sigma_m, j=j).outcome


def test_the_farther_off_the_more_must_agree(result: MatchResult) -> None:
    assert not _judged_off(result, 1.8, sigma_m=1.0).is_doubtful
    assert _judged_off(result, 2.5, sigma_m=1.0).is_doubtful
    assert _off(result, 2.5, sigma_m=1.0) is ClosureOutcome.WAITING
    assert _off(result, 3.5, sigma_m=1.0) is ClosureOutcome.UNEXPECTED


def test_a_match_that_contradicts_the_graph_waits_only_where_it_is_near(result: MatchResult) -> None:
    assert _off(result, 0.8) is ClosureOutcome.WAITING
    assert _off(result, 1.4) is ClosureOutcome.WAITING
    # however sure the graph is: it may have a wrong turn
    assert _off(result, 0.5, sigma_m=0.01) is ClosureOutcome.WAITING
    assert _judged_off(result, 0.5, sigma_m=0.01).is_doubtful
    # the next room may look the same
    assert _off(result, 3.7) is ClosureOutcome.UNEXPECTED
    assert _off(result, 1.6, sigma_m=0.01) is ClosureOutcome.UNEXPECTED


@pytest.mark.parametrize(("turn", "outcome"), [(0.3, ClosureOutcome.WAITING), (2.4, ClosureOutcome.UNEXPECTED)])
def test_a_match_that_turns_the_way_contradicts_the_graph_wherever_it_lies(
    result: MatchResult, turn: float, outcome: ClosureOutcome
) -> None:
    """A corridor seen from its other end."""
    config = SlamConfig()
    cov = np.diag(np.square([0.3, 0.3, 0.02]))
    expected = vaguely(UncertainPose(result.pose - [0.0, 0.0, turn], cov), config)
    assert judged(result, expected, config, scan=9, i=0, j=20).outcome is outcome


def test_what_the_graph_cannot_exclude_waits_however_far_it_is(result: MatchResult) -> None:
    assert _off(result, 3.7, sigma_m=2.0) is ClosureOutcome.WAITING


def test_neighbours_are_not_tied_where_nothing_tells_how_they_lie(result: MatchResult) -> None:
    assert _off(result, 0.0, j=2) is ClosureOutcome.UNTESTABLE
    assert _off(result, 0.0, sigma_m=0.02, j=2) is ClosureOutcome.ACCEPTED
    # nor those a few rooms of a corridor apart: all its rooms may look alike
    assert _off(result, 0.0, sigma_m=3.0, j=10) is ClosureOutcome.UNTESTABLE
    assert _off(result, 0.0, sigma_m=3.0, j=11) is ClosureOutcome.WAITING
    # where a sensor was lost between them only matches tell
    assert _off(result, 0.0, sigma_m=500.0, j=9) is ClosureOutcome.WAITING


def test_a_loop_closure_links_keyframes_far_apart_along_the_path(result: MatchResult) -> None:
    config = SlamConfig()
    expected = vaguely(UncertainPose(result.pose, np.diag([4e-4, 4e-4, 1e-4])), config)
    for j, is_loop in ((9, False), (10, False), (11, True), (500, True)):
        assert judged(result, expected, config, scan=j, i=0, j=j).is_loop is is_loop
