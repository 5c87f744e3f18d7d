"""Contest and evidence: what stands alone, what ties, what is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.matchers.curvescan.assessment.assessment import assess_pose, degenerate_directions
from curvescan.matchers.curvescan.assessment.evidence import BEYOND, SMALL, extent
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.candidates import look_closer, refine_candidates, with_places_along
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.disambiguation import covariance_of_ties, is_in_box, move_to_guess, unseen_odds
from curvescan.matchers.curvescan.features.features import extract_features
from curvescan.matchers.curvescan.features.surfels import N_COLUMNS, X, Y
from curvescan.matchers.curvescan.prior import WIDE, Prior
from curvescan.matchers.curvescan.proposal.search import Candidates, Problem, effort_of
from curvescan.matchers.result import prior_of
from curvescan.simulation import SENSORS, World, simulate
from deceptive import deceptive_pairs
from tests.matchers.curvescan.scenes import MOTION, features, hall_scan, pair, weigh

CONFIG = CurvescanConfig()


def test_finalists_are_refined_and_the_far_off_left_out():
    ref, cur = pair()
    found = Candidates(
        poses=np.array([MOTION + 0.02, MOTION + np.array([0.9, 0.9, 1.0])]), scores=np.array([0.8, 0.2]), n_tried=2
    )
    problem = Problem(ref, cur, WIDE, CONFIG, effort_of(CONFIG))
    poses = refine_candidates(problem, found)[0].poses
    assert len(poses) == 1
    assert np.abs(poses[0] - MOTION).max() < 0.005
    empty = Candidates(poses=np.empty((0, 3)), scores=np.empty(0), n_tried=0)
    assert len(refine_candidates(problem, empty)[0].poses) == 0


def test_a_room_leaves_nothing_open_and_a_corridor_its_length():
    ref, cur = pair()
    assessment = assess_pose(ref, cur, MOTION, CONFIG)
    assert not assessment.is_weakly_observable(CONFIG)
    assert not any(degenerate_directions(ref, cur, MOTION, assessment, CONFIG))
    assert assessment.n_inliers > 250

    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    assert assessment.is_weakly_observable(CONFIG)
    is_degenerate = degenerate_directions(ref, cur, np.zeros(3), assessment, CONFIG)
    assert is_degenerate == (True, False, False)
    _, cov = assessment.matrices(is_degenerate, CONFIG)
    assert cov[0, 0] > 0.8
    assert cov[1, 1] < 0.01


def test_a_fine_slide_stays_on_the_corridor():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    problem = Problem(ref, cur, WIDE, CONFIG, effort_of(CONFIG))
    along = with_places_along(problem, np.zeros((1, 3)), np.array([1.0, 0.0, 0.0]))
    found, assessment = look_closer(problem, along)
    poses = found.poses
    assert len(poses) == len(found.scores) > 1
    assert np.ptp(poses[:, 0]) > 0.15
    assert np.abs(poses[:, 1]).max() < 0.02
    assert np.abs(poses[:, 2]).max() < 0.02
    known = assess_pose(ref, cur, poses[0], CONFIG)
    np.testing.assert_array_equal(assessment.codes_ref, known.codes_ref)
    np.testing.assert_allclose(assessment.information, known.information)


def test_along_a_corridor_a_pose_slides_to_where_the_guess_has_it():
    log = cs.simulate("bare-corridor", n_scans=12, seed=3)
    first, last = (cs.prepare(log[k]) for k in (0, 11))
    true = cs.se2.between(log.truth.poses[0], log.truth.poses[11])
    for off in (-0.5, 0.0, 0.4):
        result = cs.match(first, last, guess=true + np.array([off, 0.0, 0.0]))
        assert result.ok
        assert result.degenerate_direction is not None
        # along the corridor where the guess is, across it and in direction where the walls are
        assert abs(result.pose[0] - true[0] - off) < 0.1
        assert abs(result.pose[1] - true[1]) < 0.005
        assert abs(result.pose[2] - true[2]) < 0.002


@pytest.mark.parametrize(("guessed", "is_followed"), [(1.0, True), (1.8, True), (3.0, False), (4.0, False)])
def test_a_guess_is_followed_while_the_scans_have_most_in_common(guessed, is_followed):
    """Along an endless corridor the share of the score falls from 0.82 at 1 m by 0.12 a metre; 0.7 must be left."""
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.0, seed=2))
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    guess = np.array([guessed, 0.0, 0.0])
    problem = Problem(ref, cur, Prior.of(prior_of(None, guess)), CONFIG, effort_of(CONFIG))
    pose, found = move_to_guess(problem, np.zeros(3), assessment)
    assert pose[0] == pytest.approx(guessed if is_followed else 0.0, abs=0.1)
    assert (found is assessment) is not is_followed


def test_ties_widen_the_covariance_until_it_holds_them():
    pose = np.array([0.0, 0.0, 3.1])
    tie = np.array([0.8, 0.02, -3.1])  # 0.083 rad on, across the seam
    moment = covariance_of_ties(pose, np.array([pose, tie]))
    min_difference = np.array([0.8, 0.02, 2 * np.pi - 6.2])
    np.testing.assert_allclose(moment, np.outer(min_difference, min_difference) / 2, atol=1e-12)
    certain = np.diag([1e-6, 1e-6, 1e-7])
    assert min_difference @ np.linalg.solve(certain + moment, min_difference) < 2.0
    np.testing.assert_array_equal(covariance_of_ties(pose, pose[np.newaxis]), np.zeros((3, 3)))


def test_where_people_agree_by_chance_the_right_place_along_a_corridor_is_found():
    """People in other places agree half a metre along the corridor: without a search along it 26 of 40 are right."""
    pairs = list(deceptive_pairs("crowded corridor", n_pairs=40, seed=9101))
    found = [(cs.match(pair.reference, pair.current), pair.pose) for pair in pairs]
    off = [(one, np.abs(one.pose - true)) for one, true in found if one.ok]
    right = [one for one, (x, y, turn) in off if np.hypot(x, y) < 0.1 and turn < 0.05]
    assert len(right) >= 29
    assert all(one in right or one.degenerate_direction is not None for one, _ in off)  # the others name the direction


def test_a_few_readings_through_a_door_fix_the_place_along_a_corridor():
    """Two jambs and a piece of a wall, of 361 readings: next to no score, and a centimetre."""
    walls = [[-20, 1, 20, 1], [-20, -1, 2, -1], [2, -1, 2, -1.1], [3.2, -1.1, 3.2, -1], [3.2, -1, 20, -1]]
    room = [[3.8, -1.1, 3.8, -4], [1, -4, 3.8, -4]]
    world = World(name="corridor with a door", walls=np.array([*walls, *room], dtype=float))
    poses = np.array([[0.4, 0.0, 0.0], [0.56, 0.0, 0.0]])
    slow = cs.UncertainPose(np.array([0.05, 0.0, 0.0]), np.diag([0.1, 0.1, 0.05]) ** 2)
    found = []
    for seed in range(8):
        scans = simulate(world, sensor=SENSORS["sick-lms200"], seed=seed, n_people=0, poses=poses, odometry_noise=None)
        found.append(cs.match(*scans, prior=slow))
    known = [one for one in found if one.degenerate_direction is None]
    assert len(known) >= 4
    assert all(abs(one.pose[0] - 0.16) < 0.01 for one in known)


def box_scan(pose, size):
    """Return a scan of half a circle from inside a square box about the origin, without noise but a millimetre."""
    angles = np.radians(np.arange(-90.0, 90.5, 0.5))
    directions = np.stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])], axis=1)
    walls = (np.sign(directions) * 0.5 * size - pose[:2]) / directions
    ranges = walls.min(axis=1) + np.random.default_rng(3).normal(0.0, 0.001, angles.size)
    return cs.LaserScan(ranges, angle_min=angles[0], angle_increment=np.radians(0.5), range_min=0.02, range_max=8.0)


def in_box(size, motion, guess=None, **evidence):
    """Return whether a pair in a square box, matched at the true pose, is taken for one in a bare box."""
    start = np.array([-0.1 * size, 0.05 * size, 0.4])
    end = cs.se2.compose(start, np.array(motion))
    ref, cur = (extract_features(box_scan(pose, size), CONFIG) for pose in (start, end))
    prior = WIDE if guess is None else Prior.of(prior_of(None, guess))
    poses = np.array([motion], dtype=np.float64)
    scored = weigh(ref, cur, prior, poses, [0.8])
    columns = {"beyond": BEYOND, "small": SMALL}
    for name, value in evidence.items():
        scored = replace(scored, evidence=scored.evidence.copy())
        scored.evidence[0, columns[name]] = value
    return is_in_box(ref, cur, scored, assess_pose(ref, cur, poses[0], CONFIG))


TURN = (0.1, -0.1, 0.5)


def test_a_small_bare_box_is_one_and_a_room_is_none():
    assert in_box(1.5, TURN)
    assert not in_box(4.0, TURN)


def test_standing_still_a_guess_or_anything_else_there_speaks_for_the_pose():
    assert not in_box(1.5, (0.05, 0.05, 0.15))
    assert not in_box(1.5, TURN, guess=TURN)
    assert in_box(1.5, TURN, guess=(0.5, 0.5, 0.5))  # a guess elsewhere says nothing for it
    assert not in_box(1.5, TURN, beyond=0.21)
    assert in_box(1.5, TURN, beyond=0.19)
    assert not in_box(1.5, TURN, small=0.21)  # people hide the rest
    assert in_box(1.5, TURN, small=0.19)


@pytest.mark.parametrize("n", [1, 3, 48, 49, 500])
def test_an_extent_is_that_of_the_readings_that_agree(n):
    surfels = np.zeros((n + 1, N_COLUMNS))
    surfels[:n, X], surfels[:n, Y] = np.linspace(0.0, 3.0, n), np.linspace(0.0, 4.0, n)
    surfels[n, X] = 50.0
    codes = np.full(n + 1, INLIER, dtype=np.uint8)
    codes[n] = 0
    # of many readings every tenth or so is taken
    assert extent(surfels, codes) == pytest.approx(5.0 if n > 1 else 0.0, rel=0.03)
    assert extent(surfels, np.zeros(n + 1, dtype=np.uint8)) == 0.0


def test_an_elevator_is_ambiguous_and_with_a_guess_matched():
    start, motion = np.array([-0.15, 0.1, 0.4]), np.array(TURN)
    ref, cur = box_scan(start, 1.5), box_scan(cs.se2.compose(start, motion), 1.5)
    assert cs.match(ref, cur).outcome is cs.Outcome.AMBIGUOUS
    guessed = cs.match(ref, cur, guess=motion + 0.02)
    assert guessed.ok
    np.testing.assert_allclose(guessed.pose, motion, atol=0.01)


def doubt_of(result):
    """The odds of what the scans of a match cannot show, by the rule and by its confidence."""
    assessed = result.trace.assessed
    accept, _ = assessed.support.probabilities(assessed.ties)
    odds = unseen_odds(assessed, assessed.assessment)
    assert result.confidence == pytest.approx(1.0 / (1.0 / accept + odds))
    return odds


@pytest.mark.parametrize("place", ["bare-corridor", "office"])
def test_a_corridor_may_be_turned_by_half_unless_a_prior_has_it(place):
    log = cs.simulate(place, n_scans=4, seed=3)
    true = cs.se2.between(log.truth.poses[0], log.truth.poses[3])
    alone, told = cs.match(log[0], log[3]), cs.match(log[0], log[3], guess=true)
    assert doubt_of(told) == 0.0
    assert doubt_of(alone) == (pytest.approx(1 / 9) if place == "bare-corridor" else 0.0)
    assert told.confidence > 0.9
    assert (alone.confidence > 0.9) == (place == "office")


@pytest.mark.parametrize("world", ["turned away, doors", "turned away, building", "small room", "doors, half turn"])
def test_what_half_a_turn_may_explain_is_not_sure(world):
    """The share of pairs that are sure and wrong may be one in a hundred."""
    for one in deceptive_pairs(world, n_pairs=25, seed=7):
        result = cs.match(one.reference, one.current)
        is_right = one.pose is not None and np.abs(se2.between(one.pose, result.pose)).max() < 0.1
        assert is_right or not result.confidence > 0.9


@pytest.mark.parametrize("world", ["company", "pillars, 180 deg"])
def test_what_may_keep_pace_is_not_sure(world):
    doubts = []
    for one in deceptive_pairs(world, n_pairs=12, seed=7):
        result = cs.match(one.reference, one.current, guess=one.pose + np.array([0.05, 0.0, 0.0]))
        if result.ok and result.degenerate_direction is None:
            assert result.confidence < 0.9
            doubts.append(doubt_of(result))
    assert doubts
    assert min(doubts) == pytest.approx(1 / 9)
