"""Attempts: a match held against what was expected, and which of two is believed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from curvescan.deskew import Deskewer
from curvescan.matchers import MatchResult, Outcome
from curvescan.odometry import MotionConfig
from curvescan.odometry.measurement import CERTAIN
from curvescan.odometry.measurement import gate as gate_within
from curvescan.odometry.motion_model import Prediction
from curvescan.se2.uncertain import UncertainPose

EXPECTED = UncertainPose(np.array([0.1, 0.0, 0.05]), np.diag([0.02**2, 0.02**2, 0.02**2]))
CONFIG = MotionConfig()


def gate(result, expected, config, seconds=0.5, **given):
    """Return a match held against what was expected so long after the last one."""
    prediction = Prediction(expected, expected, False, Deskewer(), None, config, seconds)
    return gate_within(result, expected, prediction, config, **given)


def matched(pose=(0.1, 0.0, 0.05), **kwargs):
    result = MatchResult(
        method="curvescan",
        outcome=Outcome.MATCHED,
        pose=np.array(pose),
        covariance=np.diag([1e-6, 1e-6, 1e-7]),
        n_matched=200,
        trace=None,
        labels_reference=np.empty(0, dtype=np.uint8),
        labels_current=np.empty(0, dtype=np.uint8),
        score=0.7,
    )
    return replace(result, **kwargs)


ALONG_X = {"degenerate_direction": np.array([1.0, 0.0, 0.0]), "covariance": np.diag([1.0, 1e-6, 1e-7])}


def test_a_match_in_a_room_decides_alone():
    gated = gate(matched((0.13, 0.01, 0.06)), EXPECTED, CONFIG)
    np.testing.assert_allclose(gated.pose_keyframe_scan.pose, [0.13, 0.01, 0.06], atol=1e-4)
    assert gated.is_plausible
    assert gated.is_confident(0.4)


def test_along_a_corridor_the_expectation_decides():
    gated = gate(matched((0.9, 0.01, 0.05), **ALONG_X), EXPECTED, CONFIG)
    np.testing.assert_allclose(gated.pose_keyframe_scan.pose, [0.1, 0.01, 0.05], atol=1e-3)
    assert gated.is_plausible  # how far along it went means nothing
    assert not gated.is_confident(0.4)
    assert gated.pose_keyframe_scan.covariance[0, 0] == pytest.approx(0.02**2, rel=1e-3)


def test_a_match_far_from_what_was_expected_is_not_plausible_and_is_not_bent():
    gated = gate(matched((0.6, 0.0, 0.6)), EXPECTED, CONFIG)
    assert not gated.is_plausible
    np.testing.assert_allclose(gated.pose_keyframe_scan.pose, [0.6, 0.0, 0.6], atol=1e-4)
    assert gated.is_accepted


@pytest.mark.parametrize(
    ("x", "turn", "seconds", "is_accepted"),
    [
        (0.6, 0.6, 0.2, True),
        (1.3, 0.0, 0.2, False),
        (1.3, 0.0, 0.5, True),
        (0.1, 1.9, 0.2, False),
        (0.1, 1.9, 0.5, True),
    ],
)
def test_a_match_that_a_sensor_hardly_reaches_in_the_time_is_not_accepted(x, turn, seconds, is_accepted):
    """One metre a second and two radians, besides what was expected: with odds of 3.5 against the surest match."""
    gated = gate(matched((x, 0.0, turn), confidence=1.0), EXPECTED, CONFIG, seconds=seconds)
    assert not gated.is_plausible
    assert gated.log_odds < CERTAIN
    assert gated.is_accepted is is_accepted


def test_half_the_squared_distance_speaks_against_a_leap():
    sigma = math.hypot(0.2 + 0.1, 0.02)  # a fifth of a second at one metre a second, the motion itself, the expectation
    gated = gate(matched((0.7, 0.0, 0.05), confidence=0.9), EXPECTED, CONFIG, seconds=0.2)
    assert gated.leap == pytest.approx((0.6 / sigma) ** 2, rel=1e-3)
    assert gated.log_odds == pytest.approx(math.log(9.0) - 0.5 * gated.leap, rel=1e-6)


@pytest.mark.parametrize(
    ("pose", "confidence", "is_opened"),
    [
        ((-0.5, 0.01, 0.06), 0.85, True),
        ((-0.5, 0.01, 0.06), 0.99, False),  # a sensor does stop at once
        ((0.4, 0.01, 0.06), 0.85, False),
        ((0.1, 0.01, 0.65), 0.85, False),  # and it turns at once
        ((0.1, 0.01, 0.65), 0.4, False),  # a doubtful match, too
        ((0.1, 0.0, 0.65), 0.4, False),
        ((-1.0, 0.01, 0.06), 0.999, True),
    ],
)
def test_a_doubtful_match_of_a_sudden_shift_counts_for_nothing_along_it(pose, confidence, is_opened):
    gated = gate(matched(pose, confidence=confidence), EXPECTED, CONFIG)
    assert not gated.is_plausible
    assert gated.is_accepted
    assert gated.is_opened is is_opened
    assert gated.is_fully_observed is not is_opened
    expected = (EXPECTED.pose[0], *pose[1:]) if is_opened else pose
    np.testing.assert_allclose(gated.pose_keyframe_scan.pose, expected, atol=0.012)
    along, across = np.sqrt(np.diag(gated.pose_keyframe_scan.covariance)[:2])
    assert across < 0.002
    assert along == pytest.approx(0.02 if is_opened else 0.001, rel=0.1)
    result = gated.result
    way = np.array([1.0, 0.0, 0.0]) if result.degenerate_direction is None else result.degenerate_direction
    assert bool(way @ result.covariance @ way > 1.0) is is_opened
    assert bool(way @ result.information @ way < 0.01) is is_opened  # the match leaves it open
    assert result.information[2, 2] == pytest.approx(1e7)


WHEELS = UncertainPose(np.array([0.13, 0.0, 0.0]), np.diag([0.01**2, 0.01**2, 0.005**2]))


@pytest.mark.parametrize(
    ("x", "confidence", "repeated", "is_opened"),
    [
        (0.01, 0.84, 0.1, True),  # people keep pace: the match says that the sensor stands
        (0.01, 0.97, 0.1, False),  # the wheels spin
        (0.01, 0.84, 0.0, False),  # the wheels turn at once, against the last motion as well: they may have leaped
        (0.075, 0.84, 0.1, False),  # wheels slip by so much now and then
    ],
)
def test_where_wheels_go_on_as_the_sensor_did_a_doubtful_match_counts_for_nothing_along_the_way(
    x, confidence, repeated, is_opened
):
    last = UncertainPose(np.array([repeated, 0.0, 0.0]), np.diag([0.02**2, 0.02**2, 0.02**2]))
    prediction = Prediction(WHEELS, last, True, Deskewer(), np.zeros(3), CONFIG, seconds=0.1)
    gated = gate_within(matched((x, 0.0, 0.0), confidence=confidence), WHEELS, prediction, CONFIG)
    assert gated.is_opened is is_opened
    assert bool(gated.pose_keyframe_scan.pose[0] > 0.12) is is_opened


@pytest.mark.parametrize(("x", "is_opened"), [(0.8, False), (-0.6, True)])
def test_scans_that_are_missing_may_have_led_on(x, is_opened):
    """A sensor that went on for eight scans is eight times as far; not back."""
    expected = UncertainPose(np.array([0.1, 0.0, 0.0]), EXPECTED.covariance)
    prediction = Prediction(expected, expected, False, Deskewer(), None, CONFIG, seconds=0.1, stretch=8)
    turned = UncertainPose(np.array([0.0, 0.1, math.pi / 2]), EXPECTED.covariance)  # as seen from another reference
    for seen, pose in ((expected, (x, 0.0, 0.0)), (turned, (0.0, x, math.pi / 2))):
        assert gate_within(matched(pose, confidence=0.85), seen, prediction, CONFIG).is_opened is is_opened


def test_after_a_long_time_no_shift_is_too_sudden():
    assert not gate(matched((-1.0, 0.01, 0.06), confidence=0.85), EXPECTED, CONFIG, seconds=3.0).is_opened


def test_a_failed_match_leaves_the_expectation():
    failed = matched(outcome=Outcome.AMBIGUOUS, pose=np.full(3, np.nan))
    gated = gate(failed, EXPECTED, CONFIG)
    assert gated.pose_keyframe_scan is EXPECTED
    assert not gated.is_accepted


def test_without_fusion_the_match_is_taken_as_it_is():
    result = matched((0.9, 0.0, 0.5), **ALONG_X)
    gated = gate(result, EXPECTED, MotionConfig(is_fused=False))
    np.testing.assert_array_equal(gated.pose_keyframe_scan.pose, result.pose)
    np.testing.assert_array_equal(gated.pose_keyframe_scan.covariance, result.covariance)


def test_the_reference_in_use_is_left_only_for_a_better_match():
    good, vague = gate(matched(), EXPECTED, CONFIG), gate(matched(**ALONG_X), EXPECTED, CONFIG)
    leap = gate(matched((0.6, 0.0, 0.6)), EXPECTED, CONFIG)
    low = gate(matched(score=0.3), EXPECTED, CONFIG)
    failed = gate(matched(outcome=Outcome.AMBIGUOUS), EXPECTED, CONFIG)
    ranks = [failed, leap, vague, low, good]
    for k, worse in enumerate(ranks):
        assert not worse.is_better_than(worse, 0.4)
        for better in ranks[k + 1 :]:
            assert better.is_better_than(worse, 0.4)
            assert not worse.is_better_than(better, 0.4)
    # above the least score more of it is no reason to change
    assert not gate(matched(score=0.9), EXPECTED, CONFIG).is_better_than(good, 0.4)


def test_a_matcher_without_scores_is_taken_at_its_word():
    gated = gate(matched(score=math.nan), EXPECTED, CONFIG)
    assert gated.is_confident(0.4)
    assert gate(matched((1.2, 0.0, 0.0), score=math.nan), EXPECTED, CONFIG).is_accepted


def test_a_second_match_of_a_sweep_must_not_be_in_doubt_where_the_first_is_not():
    first = gate(matched(score=0.41), EXPECTED, CONFIG)
    assert gate(matched((0.11, 0.0, 0.05), score=0.39), EXPECTED, CONFIG).standing >= first.standing
    far = gate(matched((-0.09, 0.0, 0.05), score=0.6), EXPECTED, CONFIG)
    failed = gate(matched(outcome=Outcome.UNSUPPORTED), EXPECTED, CONFIG)
    weak = gate(matched(**ALONG_X), EXPECTED, CONFIG)
    for doubtful in (far, failed, weak):
        assert not doubtful.standing >= first.standing
        assert first.standing >= doubtful.standing


@pytest.mark.parametrize(
    ("squared_distance", "is_plausible"), [(15.0, True), (19.0, True), (21.0, False), (30.0, False)]
)
def test_the_gate_is_as_wide_as_its_chi_square(squared_distance, is_plausible):
    """Of three degrees of freedom one in 6,000 lies beyond 20."""
    sigma = math.sqrt(0.02**2 + 1e-6)
    result = matched((0.1 + sigma * math.sqrt(squared_distance), 0.0, 0.05))
    assert gate(result, EXPECTED, CONFIG).is_plausible == is_plausible


def test_what_a_rejected_match_leaves_open_is_known_no_better_than_after_a_failure():
    gated = gate(matched((0.1, 0.5, 0.05), **ALONG_X), EXPECTED, CONFIG)
    assert not gated.is_plausible
    along = math.sqrt(gated.pose_keyframe_scan.covariance[0, 0])
    assert along == pytest.approx(CONFIG.recovery_sigma_m, rel=0.05)


def test_what_speaks_against_a_match_is_each_enough():
    def confident(pose=(0.1, 0.0, 0.05), **kwargs):
        return gate(matched(pose, **kwargs), EXPECTED, CONFIG).is_confident(0.4)

    assert confident()
    assert confident(score=0.4)
    assert not confident(score=0.39)
    assert not confident((0.6, 0.0, 0.6))
    assert not confident(**ALONG_X)
    failed = gate(matched(outcome=Outcome.AMBIGUOUS), EXPECTED, CONFIG)
    assert not failed.is_fully_observed  # though no direction is named


@pytest.mark.parametrize("score", [0.05, 0.2, 0.9])
def test_a_match_that_lies_where_expected_is_accepted_whatever_it_explains(score):
    """What is doubtful is questioned by the scans after it."""
    assert gate(matched(score=score, confidence=0.51), EXPECTED, CONFIG).is_accepted


def test_what_the_scans_say_without_a_guess_counts_where_it_is_expected():
    result = matched((0.1, 0.0, 0.05), **ALONG_X)
    seen = UncertainPose(np.array([0.14, 0.0, 0.05]), np.diag([0.001**2, 1e-6, 1e-7]))
    gated = gate(result, EXPECTED, CONFIG, measured=seen)
    assert gated.measured is seen
    assert gated.pose_keyframe_scan.pose[0] == pytest.approx(0.14, abs=1e-3)
    far = UncertainPose(np.array([0.9, 0.0, 0.05]), seen.covariance)
    gated = gate(result, EXPECTED, CONFIG, measured=far)
    assert gated.pose_keyframe_scan.pose[0] == pytest.approx(0.1, abs=1e-3)


def test_of_two_matches_where_nobody_expected_them_the_higher_score_counts():
    low, high = (gate(matched((2.0, 0.0, 0.6), score=s), EXPECTED, CONFIG) for s in (0.6, 0.9))
    assert high.is_better_than(low, 0.4)
    assert not low.is_better_than(high, 0.4)
