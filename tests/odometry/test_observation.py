"""What the laser alone says of a scan, and what another odometry may say of it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import curvescan as cs
from curvescan.deskew import Deskewer
from curvescan.engines import run_engine
from curvescan.odometry import OdometryConfig
from curvescan.odometry.measurement import Matching
from curvescan.odometry.motion_model import Prediction
from curvescan.se2.uncertain import UncertainPose, identity
from tests.odometry.test_gating import matched

TRUE = np.array([0.1, 0.0, 0.0])
SIGMA = np.diag([0.02, 0.02, 0.02]) ** 2


class NeedsGuess:
    """A matcher that finds the true pose from guesses whose direction errs by less than 0.03 rad."""

    config = cs.CurvescanConfig()

    def __init__(self, **result):
        self.result = result

    def match(self, reference, current, prior):
        found = matched(TRUE, **self.result)
        if abs(prior.pose[2]) < 0.03:
            return found
        unknown = {"pose": np.full(3, np.nan), "covariance": np.full((3, 3), np.nan)}
        return cs.MatchResult(**{**vars(found), **unknown, "outcome": cs.Outcome.AMBIGUOUS, "confidence": 0.0})


def gated(by_wheels, by_last=TRUE, is_measured=True, **result):
    prediction = Prediction(
        motion=UncertainPose(np.array(by_wheels), SIGMA / 4.0),
        repeated=UncertainPose(np.array(by_last), SIGMA),
        is_measured=is_measured,
        deskewer=Deskewer(),
        odometry_pose=None,
        config=OdometryConfig().motion,
        seconds=0.5,
    )
    matching = Matching(matcher=NeedsGuess(**result), config=OdometryConfig())
    scan = SimpleNamespace(features=None)
    return matching.match(scan, scan, identity(), prediction)


def test_wheels_that_mislead_the_matcher_do_not_lose_the_scan():
    """Wheels off by 3 degrees: from there the match is ambiguous, from the last motion it is not."""
    found = gated((0.1, 0.0, 0.06))
    assert found.result.ok
    assert found.is_plausible
    assert found.is_prior_rejected
    np.testing.assert_allclose(found.pose_keyframe_scan.pose, TRUE, atol=1e-3)


def test_wheels_help_where_the_last_motion_misleads():
    found = gated(TRUE, by_last=(0.1, 0.0, 0.06))
    assert found.result.ok
    assert not found.is_prior_rejected


def test_a_sure_match_is_the_same_with_wheels_and_without():
    alone = gated(TRUE, is_measured=False)
    helped = gated((0.14, 0.02, 0.02))
    np.testing.assert_array_equal(alone.pose_keyframe_scan.pose, helped.pose_keyframe_scan.pose, strict=True)
    assert helped.is_by_last_motion
    assert not alone.is_by_last_motion


def test_along_an_open_direction_the_wheels_decide():
    open_along_x = {"degenerate_direction": np.array([1.0, 0.0, 0.0]), "covariance": np.diag([0.25, 1e-6, 1e-7])}
    found = gated((0.14, 0.0, 0.0), **open_along_x)
    assert found.pose_keyframe_scan.pose[0] == pytest.approx(0.14, abs=2e-3)
    assert not found.is_by_last_motion


def test_wheels_move_nothing_in_an_office():
    """Slip of 30 % in turns, lag and lost updates change no bit where no match leaves a direction open."""
    log = cs.simulate("office", n_scans=40, seed=5)
    wheels = log.truth.poses.copy()
    wheels[:, 2] *= 0.7
    wheels[10:13] = wheels[10]
    alone, helped = run_engine(log), run_engine(log, odometry_poses=wheels)
    assert not alone.is_degenerate.any()
    assert helped.n_prior_rejected > 0
    np.testing.assert_array_equal(alone.trajectory.poses, helped.trajectory.poses, strict=True)
