"""What a doubtful or a degenerate match measures, and what it does not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import Candidate
from curvescan.matchers.registry import find_matcher
from curvescan.matchers.result import prior_of
from curvescan.odometry import MotionConfig
from curvescan.odometry.measurement import as_measurement, decided_by_expectation, unguided_measurement
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation import SENSORS

MATCHER = find_matcher("curvescan")


def features(world, seed=0, **drive):
    return [MATCHER.prepare(scan) for scan in cs.simulate(world, seed=seed, **drive)]


def expected(pose, sigma):
    return UncertainPose(np.asarray(pose, dtype=float), np.diag(np.square(sigma)))


@pytest.fixture(scope="module")
def doubtful():
    """Scans of a floor 1.3 m apart that the matcher gives no pose of without help, and the true one."""
    coarse = replace(SENSORS["sick-lms200"], n_beams=180, angle_increment=math.pi / 180)
    found = []
    log = cs.simulate("office-floor", sensor=coarse, n_scans=217, n_people=6, seed=31)
    prepared = [MATCHER.prepare(log[k]) for k in range(0, 217, 12)]
    poses = log.truth.poses[::12]
    for k in range(len(prepared) - 1):
        result = MATCHER.match(prepared[k], prepared[k + 1], None)
        if not result.ok and result.score >= MotionConfig().expected_score:
            found.append((result, cs.se2.between(poses[k], poses[k + 1])))
    assert len(found) >= 2
    return found


def test_a_doubtful_match_counts_where_it_is_expected_and_only_there(doubtful):
    n_decided = 0
    for result, truth in doubtful:
        decided = decided_by_expectation(result, expected(truth, (0.05, 0.05, 0.05)), MotionConfig())
        n_decided += decided.ok
        if decided.ok:
            off = cs.se2.between(truth, decided.pose)
            sigma = np.sqrt(np.diag(decided.covariance))
            assert np.all(np.abs(off) < 5.0 * sigma + 0.02)
            elsewhere = expected(truth + np.array([2.0, 1.0, 1.0]), (0.05, 0.05, 0.05))
            again = decided_by_expectation(result, elsewhere, MotionConfig())
            assert again is result
    assert n_decided >= 0.5 * len(doubtful)


def test_nothing_but_the_result_is_read(doubtful):
    """What the matcher did on the way may be anything."""
    for result, truth in doubtful:
        near = expected(truth, (0.05, 0.05, 0.05))
        with_trace = decided_by_expectation(result, near, MotionConfig())
        without = decided_by_expectation(replace(result, trace=None), near, MotionConfig())
        np.testing.assert_array_equal(with_trace.pose, without.pose, strict=True)
        np.testing.assert_array_equal(with_trace.covariance, without.covariance, strict=True)
        assert with_trace.outcome is without.outcome


def test_a_score_that_chance_reaches_does_not_count(doubtful):
    strict = MotionConfig(expected_score=1.0)
    for result, truth in doubtful:
        assert decided_by_expectation(result, expected(truth, (1.0, 1.0, 1.0)), strict) is result


@pytest.mark.parametrize(
    ("log_odds", "near", "is_elsewhere"), [(5.0, 1.6, False), (5.0, 1.4, True), (3.0, -0.1, True), (3.0, 0.1, False)]
)
def test_of_a_doubtful_match_a_pose_elsewhere_must_be_far_likelier(log_odds, near, is_elsewhere):
    """What moves along with the sensor, or against it, explains the scans elsewhere."""

    def candidate(x, odds, n_matched):
        covariance = np.diag([1e-4, 1e-4, 1e-6])
        return Candidate(
            pose=np.array([x, 0.0, 0.0]),
            log_odds=odds,
            information=np.linalg.inv(covariance),
            covariance=covariance,
            n_matched=n_matched,
        )

    candidates = candidate(-0.5, log_odds, 200), candidate(0.1, near, 100)
    result = cs.MatchResult(
        method="curvescan",
        outcome=cs.Outcome.AMBIGUOUS,
        pose=np.full(3, np.nan),
        covariance=np.full((3, 3), np.nan),
        n_matched=0,
        trace=None,
        labels_reference=np.empty(0, dtype=np.uint8),
        labels_current=np.empty(0, dtype=np.uint8),
        score=0.8,
        confidence=0.9,
        candidates=candidates,
    )
    decided = decided_by_expectation(result, expected((0.12, 0.0, 0.0), (0.02, 0.02, 0.02)), MotionConfig())
    if is_elsewhere:
        assert decided is result
    else:
        assert decided.pose[0] == 0.1
        assert decided.score == pytest.approx(0.4)
        assert 0.4 < decided.confidence < 1.0 / (1.0 + math.exp(-near))
    assert (
        decided_by_expectation(result, expected((-0.5, 0.0, 0.0), (0.02, 0.02, 0.02)), MotionConfig()).pose[0] == -0.5
    )
    sure = replace(result, outcome=cs.Outcome.MATCHED, pose=candidates[0].pose)
    assert decided_by_expectation(sure, expected((0.12, 0.0, 0.0), (0.02, 0.02, 0.02)), MotionConfig()) is sure


@pytest.mark.slow
def test_scans_that_share_nothing_stay_unmatched():
    """Places of different offices, expected where the sensor stood: none of 200 counts."""
    views = [features("office", seed, n_scans=41)[::10] for seed in range(60, 70)]
    n_tried = 0
    for i, here in enumerate(views):
        for there in (view for j, view in enumerate(views) if j != i):
            for one, other in zip(here, there, strict=False):
                result = MATCHER.match(one, other, prior_of(None, np.zeros(3)))
                if result.ok:
                    continue
                n_tried += 1
                near = expected(np.zeros(3), (0.1, 0.1, 0.1))
                assert not decided_by_expectation(result, near, MotionConfig()).ok
    assert n_tried >= 200


def test_along_a_bare_corridor_nothing_is_measured():
    poses = np.array([[0.4 * k, 0.0, 0.0] for k in range(2)])
    one, other = features("bare-corridor", poses=poses)
    result = MATCHER.match(one, other, None)
    assert result.degenerate_direction is not None
    assert unguided_measurement(result) is None
    assert as_measurement(result).covariance[0, 0] > 50.0**2


def test_along_a_corridor_with_recesses_the_scans_say_where_without_a_guess():
    """Nearly flat, but with one best place: measured to a decimetre or better, and right."""
    n_measured = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x = rng.uniform(-6.0, 6.0)
        poses = np.array([[x, 0.0, 0.0], [x + rng.uniform(0.4, 1.0), 0.0, 0.05]])
        one, other = features("corridor", seed, poses=poses)
        result = MATCHER.match(one, other, None)
        measured = unguided_measurement(result)
        if measured is None:
            continue
        n_measured += 1
        off = measured.pose - cs.se2.between(*poses)
        assert math.sqrt(measured.covariance[0, 0]) < 0.25
        assert abs(off[0]) < 5.0 * math.sqrt(measured.covariance[0, 0])
    assert n_measured >= 5
