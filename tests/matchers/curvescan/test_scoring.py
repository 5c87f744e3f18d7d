"""Verification: the score of a pose, and the choice of the best."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.config import VerificationConfig
from curvescan.matchers.curvescan.range_image import reading_at
from curvescan.matchers.curvescan.scoring import best_beside, select, support, verify
from tests.matchers.curvescan.scenes import MOTION, pair
from tests.reference import consensus as slow


@pytest.mark.parametrize("seed", range(6))
def test_the_score_is_that_of_the_slow_twin(seed):
    ref, cur = pair(seed)
    pose = MOTION + 0.1 * np.random.default_rng(seed).standard_normal(3)
    back = cs.se2.inverse(pose)
    there = slow.support(
        cur.view.probes, ref.view, lambda p: reading_at(*p, ref.view), pose, 0.05, 0.01
    )
    here = slow.support(
        ref.view.probes, cur.view, lambda p: reading_at(*p, cur.view), back, 0.05, 0.01
    )
    c, s = math.cos(pose[2]), math.sin(pose[2])
    n = len(cur.view.probes)
    one = support(cur.view.probes, 0, n, ref.view, pose[0], pose[1], c, s, 0.05, 0.01)
    assert abs(one - there) < 1e-9
    both = verify(pose, ref.view, cur.view, 0.05, 0.01, 64, -1.0)
    assert abs(both - (there + here) / (2 * n)) < 1e-9


def test_the_truth_scores_best_and_a_scan_agrees_with_itself():
    ref, cur = pair()
    right = verify(MOTION, ref.view, cur.view, 0.04, 0.005, 64, -1.0)
    assert right > 0.8
    for off in ([0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3], [0, 0, math.pi]):
        assert verify(MOTION + off, ref.view, cur.view, 0.04, 0.005, 64, -1.0) < 0.6 * right
    assert verify(np.zeros(3), ref.whole, ref.whole, 0.04, 0.005, 4096, -1.0) > 0.95


def test_a_hopeless_pose_is_given_up_early():
    ref, cur = pair()
    wrong = np.array([1.0, 1.0, 2.0])
    first = [view._replace(probes=view.probes[:6]) for view in (ref.view, cur.view)]
    early, late, right, whole = (
        verify(pose, ref.view, cur.view, 0.04, 0.005, n_first, least)
        for pose in (wrong, MOTION)
        for n_first, least in ((6, 0.8), (64, -1.0))
    )
    assert early == verify(wrong, *first, 0.04, 0.005, 64, -1.0)
    assert early != late
    assert late < 0.8
    assert right == pytest.approx(whole, abs=1e-12)


def test_the_best_poses_are_chosen_best_first_and_differ():
    ref, cur = pair()
    rng = np.random.default_rng(0)
    poses = np.vstack(
        [rng.uniform([-1, -1, -3], [1, 1, 3], (40, 3)), MOTION + 0.01 * rng.normal(size=(10, 3))]
    )
    best, scores = select(poses, ref.view, cur.view, 0.04, 0.005, 4, 64, 0.3)
    assert (np.diff(scores) <= 0).all()
    error = cs.se2.between(MOTION, best[0])
    assert np.hypot(*error[:2]) < 0.05
    for i in range(len(best)):
        assert abs(verify(best[i], ref.view, cur.view, 0.04, 0.005, 64, -1.0) - scores[i]) < 1e-12
        for k in range(i):
            apart = cs.se2.between(best[i], best[k])
            assert np.hypot(*apart[:2]) >= 0.3 or abs(apart[2]) >= 0.15


def test_nothing_is_chosen_from_nothing():
    ref, cur = pair()
    best, scores = select(np.empty((0, 3)), ref.view, cur.view, 0.04, 0.005, 4, 64, 0.3)
    assert best.shape == (0, 3)
    assert scores.shape == (0,)


def test_beside_the_truth_the_score_falls():
    ref, cur = pair()
    args = (ref.view, cur.view, 0.03, 0.004)
    here = best_beside(MOTION, np.array([1.0, 0.0, 0.0]), np.zeros(1), *args)
    assert here == verify(MOTION, *args, 4096, -1.0)
    assert best_beside(MOTION, np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.4]), *args) < 0.7 * here


@pytest.mark.parametrize(
    "wrong",
    [{"n_probes": 2}, {"n_kept": 0}, {"n_wide": 1}, {"fine": (0.0, 0.1)}, {"min_score": 2.0}],
)
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(cs.InvalidArgumentError, match=next(iter(wrong))):
        VerificationConfig(**wrong)
