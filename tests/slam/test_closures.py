"""Closures: what a match must be like to be believed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import MatchResult
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.loops.closures import ClosureOutcome, judged, vaguely


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
    return judged(result, expected, config, scan=9, i=0, j=9).outcome


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


def test_a_degenerate_match_counts_across_where_the_graph_knows_the_rest(
    result: MatchResult,
) -> None:
    along_x = dataclasses.replace(result, degenerate_direction=np.array([1.0, 0.0, 0.0]))
    assert _outcome(along_x) is ClosureOutcome.ACCEPTED
    assert _outcome(along_x, 1.0) is ClosureOutcome.DEGENERATE
