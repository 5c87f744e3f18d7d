"""Overlap: what keyframes see of each other, and what each of a row sees first."""

from __future__ import annotations

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.slam.loops.overlap import foretold_overlap, new_shares, range_profile


def test_what_a_keyframe_sees_is_new_but_for_what_those_before_it_see() -> None:
    made = cs.simulate("office", sensor="spinning-360", seed=3, n_scans=30, odometry_noise=None)
    seen = np.array([range_profile(made[k]) for k in (0, 29, 29, 0)])
    poses = made.truth.poses[[0, 29, 29, 0]]
    poses[3, 0] += 100.0
    shares = new_shares(seen, poses)
    assert shares[0] == shares[3] == 1.0
    assert 0.0 < shares[1] < 1.0
    assert shares[2] == 0.0
    back = se2.between(poses[0], poses[1])[np.newaxis]
    assert foretold_overlap(seen[:1], np.array([0]), back, seen[1])[0] <= 1.0 - shares[1]
