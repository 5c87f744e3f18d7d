"""Hypotheses: poses from pairs of frames, and their votes."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.proposal.hypotheses import is_in_sight, most_voted, pair_keypoints
from tests.matchers.curvescan.scenes import MOTION, features, pair, pillar_scan
from tests.reference import curvescan as slow


def test_a_pair_of_frames_is_the_pose_that_joins_them():
    ref, cur = pair()
    poses = pair_keypoints(ref.landmarks.keypoints, cur.landmarks.keypoints, ref.image, cur.image, 0.4, 4000)
    expected = []
    for c in cur.landmarks.keypoints:
        for r in ref.landmarks.keypoints:
            if r[4] != c[4] or abs(r[3] - c[3]) > 0.4:
                continue
            pose = cs.se2.compose(r[:3], cs.se2.inverse(c[:3]))
            back = cs.se2.inverse(pose)
            if is_in_sight(*pose[:2], ref.image, 0.1) and is_in_sight(*back[:2], cur.image, 0.1):
                expected.append(pose)
    np.testing.assert_allclose(poses, expected, atol=1e-12)
    error = cs.se2.between(MOTION, poses)
    near = (np.hypot(error[:, 0], error[:, 1]) < 0.2) & (np.abs(error[:, 2]) < 0.1)
    assert near.sum() >= 3


def test_a_sensor_does_not_stand_behind_a_wall():
    image = features(pillar_scan(sigma=0.0)).image
    assert is_in_sight(0.0, 0.0, image, 0.1)
    assert is_in_sight(2.9, 0.1, image, 0.1)
    assert not is_in_sight(3.3, 0.1, image, 0.1)
    assert is_in_sight(-5.0, 0.0, image, 0.1)  # out of the field of view: nobody knows


def test_no_more_pairs_than_asked_for():
    ref, cur = pair()
    assert len(pair_keypoints(ref.landmarks.keypoints, cur.landmarks.keypoints, ref.image, cur.image, 0.4, 5)) == 5
    assert len(pair_keypoints(ref.landmarks.keypoints[:0], cur.landmarks.keypoints, ref.image, cur.image, 0.4, 5)) == 0


@pytest.mark.parametrize("seed", range(5))
def test_the_most_voted_come_first(seed):
    rng = np.random.default_rng(seed)
    poses = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (60, 3))
    poses[10:25] = MOTION + 0.02 * rng.standard_normal((15, 3))
    kept = most_voted(poses, 0.3, 0.15, 30)
    assert kept.shape == (30, 3)
    # exact but for clashes of the hash table, which only ever add votes: allow a few
    votes = slow.votes(poses, 0.3, 0.15)
    found = [votes[np.flatnonzero((poses == pose).all(axis=1))[0]] for pose in kept]
    assert found[:15] == sorted(votes, reverse=True)[:15]
    assert np.mean(np.diff(found) > 0) < 0.1


def test_few_poses_are_all_kept():
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    assert sorted(most_voted(poses, 0.3, 0.15, 96).tolist()) == poses.tolist()
    assert most_voted(poses[:0], 0.3, 0.15, 96).shape == (0, 3)
