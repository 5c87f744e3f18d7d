"""Keyframes: where one stands, and what is retained of the variance of the match that placed it."""

from __future__ import annotations

import numpy as np

from curvescan.odometry.observation import Keyframe, Localization
from curvescan.se2.uncertain import UncertainPose, compose, identity

STEP = UncertainPose(np.array([1.0, 0.0, 0.1]), np.diag([1e-4, 1e-4, 1e-6]))
FIRST = Keyframe(scan=None, index=0, pose_map_keyframe=identity())


def test_from_an_earlier_keyframe_a_place_errs_by_the_way_since():
    here = Localization(keyframe=FIRST, pose_keyframe_scan=STEP)
    for k in range(1, 4):
        last, here = here, Localization(keyframe=here.as_keyframe(None, k, 1.0), pose_keyframe_scan=STEP)
    found = here.relative_to(last.keyframe)
    way = compose(STEP, STEP)
    np.testing.assert_allclose(found.pose, way.pose, atol=1e-12)
    np.testing.assert_allclose(found.covariance, way.covariance, rtol=1e-9)
    assert here.relative_to(here.keyframe) is STEP


def test_a_share_of_a_measured_variance_stays():
    for is_measured, share in ((True, 0.25), (False, 1.0)):
        here = Localization(keyframe=FIRST, pose_keyframe_scan=STEP, is_measured=is_measured)
        np.testing.assert_allclose(
            here.as_keyframe(None, 1, 0.25).pose_map_keyframe.covariance, share * STEP.covariance
        )
