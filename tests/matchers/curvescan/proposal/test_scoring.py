"""Verification: the score of a pose, and the choice of the best."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.association import FORWARD, motion_of, project
from curvescan.matchers.curvescan.config import ScoringConfig
from curvescan.matchers.curvescan.features.range_image import place_in, reading_at, reading_beside
from curvescan.matchers.curvescan.proposal import scoring
from curvescan.matchers.curvescan.proposal.scoring import agreement_lost, score_samples, select
from tests.matchers.curvescan.scenes import MOTION, features, pair, pillar_scan
from tests.reference import curvescan as slow


def score_pose(pose, ref, cur, *limits):
    placed = np.empty((3, len(ref.samples))), np.empty((3, len(cur.samples)))
    return scoring.score_pose(pose, ref, cur, *limits, placed)


@pytest.mark.parametrize("seed", range(6))
def test_the_score_is_that_of_the_slow_twin(seed):
    ref, cur = pair(seed)
    pose = MOTION + 0.1 * np.random.default_rng(seed).standard_normal(3)
    back = cs.se2.inverse(pose)
    there = slow_score(cur, ref, pose)
    here = slow_score(ref, cur, back)
    n = len(cur.image.samples)
    motion = motion_of(pose, FORWARD)
    placed = project(cur.image.samples, motion, ref.image)
    one = score_samples(cur.image.samples, placed, 0, n, ref.image, motion, 0.05, 0.01)
    assert abs(one - there) < 1e-9
    both = score_pose(pose, ref.image, cur.image, 0.05, 0.01, 64, -1.0)
    assert abs(both - (there + here) / (2 * n)) < 1e-9


def slow_score(one, other, pose):
    image = other.image

    def beside(point):
        return reading_beside(
            place_in(*point, image.azimuth_min, image.slots_a_radian), image, reading_at(*point, image)
        )

    return slow.score_samples(one.image.samples, image, lambda p: reading_at(*p, image), beside, pose, 0.05, 0.01)


def test_the_truth_scores_best_and_a_scan_agrees_with_itself():
    ref, cur = pair()
    right = score_pose(MOTION, ref.image, cur.image, 0.04, 0.005, 64, -1.0)
    assert right > 0.8
    for off in ([0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3], [0, 0, math.pi]):
        assert score_pose(MOTION + off, ref.image, cur.image, 0.04, 0.005, 64, -1.0) < 0.6 * right
    assert score_pose(np.zeros(3), ref.full_image, ref.full_image, 0.04, 0.005, 4096, -1.0) > 0.95


def test_a_hopeless_pose_is_given_up_early():
    ref, cur = pair()
    wrong = np.array([1.0, 1.0, 2.0])
    first = [image._replace(samples=image.samples[:6]) for image in (ref.image, cur.image)]
    early, late, right, full_image = (
        score_pose(pose, ref.image, cur.image, 0.04, 0.005, n_first, least)
        for pose in (wrong, MOTION)
        for n_first, least in ((6, 0.8), (64, -1.0))
    )
    assert early == score_pose(wrong, *first, 0.04, 0.005, 64, -1.0)
    assert early != late
    assert late < 0.8
    assert right == pytest.approx(full_image, abs=1e-12)


def test_the_best_poses_are_chosen_best_first_and_differ():
    ref, cur = pair()
    rng = np.random.default_rng(0)
    poses = np.vstack([rng.uniform([-1, -1, -3], [1, 1, 3], (40, 3)), MOTION + 0.01 * rng.normal(size=(10, 3))])
    best, scores = select(poses, ref.image, cur.image, 0.04, 0.005, 4, 64, 0.3)
    assert (np.diff(scores) <= 0).all()
    error = cs.se2.between(MOTION, best[0])
    assert np.hypot(*error[:2]) < 0.05
    for i in range(len(best)):
        assert abs(score_pose(best[i], ref.image, cur.image, 0.04, 0.005, 64, -1.0) - scores[i]) < 1e-12
        for k in range(i):
            min_difference = cs.se2.between(best[i], best[k])
            assert np.hypot(*min_difference[:2]) >= 0.3 or abs(min_difference[2]) >= 0.15


def test_nothing_is_chosen_from_nothing():
    ref, cur = pair()
    best, scores = select(np.empty((0, 3)), ref.image, cur.image, 0.04, 0.005, 4, 64, 0.3)
    assert best.shape == (0, 3)
    assert scores.shape == (0,)


def test_beside_the_truth_agreement_is_lost_and_along_a_bare_corridor_none():
    ref, cur = pair()
    args = (ref.image, cur.image, 0.03, 0.004)
    assert agreement_lost(MOTION, np.array([0.4, 0.0, 0.0]), *args) > 0.2
    assert agreement_lost(MOTION, np.zeros(3), *args) == 0.0
    angles = np.radians(np.arange(-90.0, 91.0))
    with np.errstate(divide="ignore"):
        walls = cs.LaserScan(1.0 / np.abs(np.sin(angles)), angles=angles, range_max=8.0)
    bare = features(walls).image
    along = np.array([1.0, 0.0, 0.0])
    # a wall ends where the sensor sees no farther: its end says nothing
    assert abs(agreement_lost(np.zeros(3), along, bare, bare, 0.03, 0.004)) < 0.03
    door = np.where((angles > 0.4) & (angles < 0.7), 1.3, 1.0)
    with np.errstate(divide="ignore"):
        recessed = features(replace(walls, ranges=door * walls.ranges)).image
    assert agreement_lost(np.zeros(3), along, recessed, recessed, 0.03, 0.004) > 0.05


@pytest.mark.parametrize("wrong", [{"n_samples": 2}, {"min_inliers": 0}, {"margin": -0.1}, {"min_confidence": 2.0}])
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(cs.InvalidArgumentError, match=next(iter(wrong))):
        ScoringConfig(**wrong)


def test_poses_across_the_seam_of_angles_are_one():
    ref = features(pillar_scan(seed=0))
    true = MOTION + np.array([0.0, 0.0, np.pi])
    cur = features(pillar_scan(true, seed=1, fov=2.0 * np.pi * 360 / 361))
    near = true - np.array([0.0, 0.0, 2.0 * np.pi - 0.01])

    def n_kept(*poses):
        return len(select(np.array(poses), ref.image, cur.image, 0.08, 0.03, 4, 64, 0.3)[0])

    assert n_kept(true, near) == n_kept(near, true) == 1
    assert n_kept(true, true + np.array([0.5, 0.0, 0.0])) == 2
    assert n_kept(true, true + np.array([0.0, 0.0, 0.2])) == 2
