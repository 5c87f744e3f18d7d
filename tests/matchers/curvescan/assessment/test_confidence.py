"""Confidence: what speaks for a pose and against it, and what another pose explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.confidence import (
    COEFFICIENTS,
    RIVAL_COEFFICIENTS,
    WeighedPoses,
    weigh,
)
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    BEYOND,
    EXCESS,
    LARGE,
    MISFIT,
    MISSED,
    N_EVIDENCE,
    SEEN_THROUGH,
    WEAKEST,
)
from curvescan.matchers.curvescan.assessment.support import MAX_REPETITION, support_of
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.proposal.search import Problem
from tests.matchers.curvescan.scenes import MOTION, pair

CONFIG = CurvescanConfig()
GOOD = {AGREEING: 8.0, EXCESS: 2.0, WEAKEST: 2.0, MISFIT: 0.8}


def poses(*evidences, motions=None, guessed=False):
    rows = np.zeros((len(evidences), N_EVIDENCE))
    for row, evidence in zip(rows, evidences, strict=True):
        for column, value in evidence.items():
            row[column] = value
    n = len(evidences)
    return WeighedPoses(
        poses=np.arange(3.0 * n).reshape(n, 3),
        scores=np.full(n, 0.5),
        evidence=rows,
        motions=np.full(n, 0.3) if motions is None else np.array(motions),
        is_guessed=np.full(n, guessed),
    )


@pytest.mark.parametrize(
    ("column", "better", "worse"),
    [
        (AGREEING, 9.0, 3.0),
        (EXCESS, 4.0, 0.0),
        (WEAKEST, 3.0, 0.1),
        (MISFIT, 0.8, 3.0),
        (MISSED, 0.0, 1.0),
        (SEEN_THROUGH, 0.0, 1.0),
        (LARGE, 0.0, 2.0),
    ],
)
def test_each_evidence_moves_the_confidence_the_way_it_should(column, better, worse):
    low, high = (
        support_of(poses({**GOOD, column: value}), [], False).confidence
        for value in (worse, better)
    )
    assert 0.0 < low < high < 1.0


def test_a_far_motion_and_an_open_direction_speak_against_and_a_guess_for_a_pose():
    def confidence(is_degenerate=False, **kwargs):
        return support_of(poses(GOOD, **kwargs), [], is_degenerate).confidence

    assert confidence(motions=[3.0]) < confidence() < confidence(guessed=True)
    assert confidence(motions=[0.0]) == confidence(motions=[0.9])  # a metre is nothing
    assert confidence(is_degenerate=True) < confidence()
    assert set(poses(GOOD).terms(0)) == set(COEFFICIENTS)
    assert set(poses(GOOD, GOOD).rival_terms(1)) == set(RIVAL_COEFFICIENTS)


def test_a_pose_that_explains_as_much_repeats_and_one_that_is_contradicted_does_not():
    as_good, less = dict(GOOD), {**GOOD, EXCESS: 0.0, WEAKEST: 0.1}
    seen_through = {**GOOD, SEEN_THROUGH: 1.5}
    found = poses(GOOD, as_good, less, seen_through)
    assert found.repetition(1) == pytest.approx(1.0)
    assert found.repetition(2) < MAX_REPETITION
    assert found.repetition(3) == 0.0
    support = support_of(found, [1, 2, 3], False)
    assert support.repeated() == [1]
    alone = support_of(found, [], False)
    assert support.confidence < alone.confidence
    # rows that the covariance holds speak for the first
    assert support.confidence < support.confidence_with([1]) < support.confidence_with([1, 2, 3])


def test_a_contradicted_pose_rules_out_none_that_explains_more():
    wrong = {**GOOD, SEEN_THROUGH: 1.0}
    more = {**GOOD, AGREEING: 9.0, MISFIT: 0.6, SEEN_THROUGH: 3.0}
    found = replace(poses(wrong, more), scores=np.array([0.4, 0.5]))
    assert found.repetition(1) == 1.0
    # not where it is contradicted alone, nor where less agrees, or worse, or in fewer readings
    assert poses(wrong, more).repetition(1) == 0.0
    for best, other in (
        (GOOD, more),
        (wrong, {**more, AGREEING: 7.0}),
        (wrong, {**more, MISFIT: 0.9}),
    ):
        assert replace(poses(best, other), scores=np.array([0.4, 0.5])).repetition(1) == 0.0


def test_a_bare_room_may_be_turned_where_the_motion_is_large_or_a_wall_contradicts():
    assert not poses({**GOOD, BEYOND: 0.0}).may_be_turned
    assert poses({**GOOD, BEYOND: 0.0}, motions=[1.5]).may_be_turned
    assert poses({**GOOD, BEYOND: 0.0, SEEN_THROUGH: 0.5}).may_be_turned
    assert poses({**GOOD, BEYOND: 0.0, MISSED: 0.5}).may_be_turned
    assert not poses({**GOOD, BEYOND: 1.0, SEEN_THROUGH: 0.5}, motions=[1.5]).may_be_turned
    # a guess decides
    assert not poses({**GOOD, BEYOND: 0.0, SEEN_THROUGH: 0.5}, guessed=True).may_be_turned
    # a long third wall, and something that changed
    assert not poses({**GOOD, BEYOND: 0.0, EXCESS: 4.0, SEEN_THROUGH: 0.5}).may_be_turned
    assert not poses().may_be_turned


def test_a_far_pose_counts_less_as_a_rival():
    two_walls = {**GOOD, EXCESS: 0.1}
    shares = [
        poses(two_walls, two_walls, motions=[0.3, far]).repetition(1) for far in (0.3, 2.0, 4.0)
    ]
    assert shares[0] == pytest.approx(1.0)
    assert shares[0] > shares[1] > shares[2] == 0.0
    furnished = poses(GOOD, GOOD, motions=[0.3, 2.0])
    assert furnished.repetition(1) == pytest.approx(1.0)


def test_a_room_with_pillars_is_explained_by_its_pose_alone():
    ref, cur = pair()
    turned = MOTION + np.array([0.0, 0.0, np.pi / 2])
    found = weigh(Problem(ref, cur, None, CONFIG), np.array([turned, MOTION]), np.array([0.1, 0.9]))
    np.testing.assert_array_equal(found.poses, [MOTION, turned])  # the likeliest first
    np.testing.assert_array_equal(found.scores, [0.9, 0.1])
    support = support_of(found, [1], False)
    assert support.confidence > 0.97
    assert not support.repeated()
    assert found.repetition(1) < 0.2


def test_a_guess_is_where_motion_starts():
    ref, cur = pair()
    far, near = (
        weigh(Problem(ref, cur, guess, CONFIG), MOTION[np.newaxis], np.array([0.9]))
        for guess in (MOTION + 1.0, MOTION + 0.05)
    )
    assert far.motions[0] > 2.0 > 0.3 > near.motions[0]
    assert near.is_guessed[0]
    assert not far.is_guessed[0]
    assert near.log_odds(0) > far.log_odds(0)


def test_a_result_tells_how_sure_it_is():
    log = cs.simulate("office", n_scans=4, seed=2)
    result = cs.match(log[0], log[1])
    assert result.ok
    assert 0.9 < result.confidence <= 1.0
    assert not result.is_guess_decisive
    empty = cs.LaserScan(np.full(361, np.inf), angle_min=-1.57, angle_increment=0.0087)
    assert cs.match(log[0], empty).confidence == 0.0
    assert np.isnan(cs.match(log[0], log[1], method="icp").confidence)
