"""Search: which poses come into question."""

from __future__ import annotations

import numpy as np

import curvescan as cs
from curvescan.matchers.curvescan.config import (
    CurvescanConfig,
    HypothesesConfig,
    ScoringConfig,
)
from curvescan.matchers.curvescan.search import follow_guess, search
from tests.matchers.curvescan.scenes import MOTION, features, pair
from tests.matchers.curvescan.test_rotation_hypotheses import hall_scan

CONFIG = CurvescanConfig()


def off(pose):
    error = cs.se2.between(MOTION, pose)
    return max(np.hypot(*error[:2]), abs(error[2]))


def test_the_best_candidate_is_near_the_truth():
    for seed in range(5):
        ref, cur = pair(seed)
        found = search(ref, cur, None, CONFIG)
        assert off(found.poses[0]) < 0.01
        assert (np.diff(found.scores) <= 0).all()
        assert len(found.poses) == len(found.scores)


def test_a_lattice_finds_what_nothing_else_proposes():
    ref, cur = pair(motion=np.array([0.55, -0.45, 0.0]))
    blind = CurvescanConfig(
        hypotheses=HypothesesConfig(max_tried=1, n_rotations=1, along_reach=0.01),
        scoring=ScoringConfig(doubtful_score=1.0),
    )
    found = search(ref, cur, None, blind)
    assert found.n_tried > 200
    assert np.abs(found.poses[0] - [0.55, -0.45, 0.0]).max() < 0.02


def test_no_lattice_is_tried_where_the_best_pose_lies_where_the_guess_has_it():
    motion = np.array([0.55, -0.45, 0.0])
    ref, cur = pair(motion=motion)
    # nothing is ever certain, and nothing but the guess and the lattice proposes the place
    doubting = CurvescanConfig(
        hypotheses=HypothesesConfig(max_tried=1, n_rotations=1, along_reach=0.01),
        scoring=ScoringConfig(few_tried=10_000, certain_score=1.0),
    )
    right, wrong = np.add(motion, [0.03, 0.0, 0.01]), np.add(motion, [2.0, 0.0, 0.0])
    assert search(ref, cur, right, doubting).n_tried < 10
    found = search(ref, cur, wrong, doubting)
    assert found.n_tried > 200
    assert np.abs(found.poses[0] - motion).max() < 0.02


def test_a_guess_is_followed_only_where_it_is_right():
    ref, cur = pair()
    trusted = follow_guess(ref, cur, MOTION + 0.03, CONFIG)
    assert trusted is not None
    assert off(trusted.poses[0]) < 0.01
    assert follow_guess(ref, cur, MOTION + np.array([0.8, 0.5, 1.0]), CONFIG) is None


def test_a_guess_in_a_corridor_is_not_trusted():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    assert follow_guess(ref, cur, np.zeros(3), CONFIG) is None
