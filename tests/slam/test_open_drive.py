"""What open directions hide: the difference of the usual drive and what the odometry says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.odometry.step import Step, StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.open_drive import OpenDrive
from tests.scenes import room_scan

MATCH = cs.match(room_scan((0.0, 0.0, 0.0)), room_scan((0.1, 0.0, 0.0)))
CLOSED = replace(MATCH, degenerate_direction=None)
OPEN = replace(MATCH, pose=np.zeros(3), degenerate_direction=np.array([1.0, 0.0, 0.0]))
WIDE = UncertainPose(np.array([0.3, 0.0, 0.0]), np.diag([400.0, 1e-6, 1e-6]))


def _step(x: float, match: cs.MatchResult | None, turn: float = 0.0, **more) -> Step:
    zero = np.zeros((3, 3))
    return Step(
        index=1, stamp=0.0, pose=np.zeros(3), covariance=zero, pose_odom=np.zeros(3), covariance_odom=zero,
        motion=np.array([x, 0.0, turn]), motion_covariance=zero, match=match, reference=0,
        **{"outcome": StepOutcome.MATCHED, **more},
    )  # fmt: skip


@pytest.fixture
def drive() -> OpenDrive:
    """A drive of 0.1 m a scan."""
    drive = OpenDrive()
    for _ in range(200):
        drive = drive.added(_step(0.1, CLOSED))
    return drive.begun()


def test_where_all_is_measured_the_odometry_is_believed(drive):
    drive = drive.added(_step(0.1, CLOSED))
    assert drive.known(WIDE) is WIDE


def test_a_standstill_in_a_bare_corridor_hides_the_usual_drive(drive):
    for _ in range(5):
        drive = drive.added(_step(0.0, OPEN))
    sigma = np.sqrt(np.diag(drive.known(WIDE).cov))
    np.testing.assert_allclose(sigma, [0.5, 0.001, 0.001], rtol=1e-3)


def test_a_drive_as_usual_hides_nothing(drive):
    for _ in range(5):
        drive = drive.added(_step(0.1, OPEN))
    assert drive.known(WIDE).cov[0, 0] < 1e-5


def test_wheels_tell_the_way(drive):
    for _ in range(5):
        drive = drive.added(_step(0.0, OPEN, is_driven=True))
    assert drive.known(WIDE).cov[0, 0] < 1e-5


def test_without_a_match_the_odometry_says_how_vague_it_is_and_the_usual_drive_is_hidden(drive):
    for _ in range(4):
        drive = drive.added(_step(0.0, None, outcome=StepOutcome.HELD))
    vague = UncertainPose(np.zeros(3), np.diag(np.square([0.3, 0.3, 0.2])))
    sigma = np.sqrt(np.diag(drive.known(vague).cov))
    np.testing.assert_allclose(sigma, [0.5, 0.3, 0.2], rtol=1e-6)


def test_turns_that_no_match_measures_go_on(drive):
    for _ in range(5):
        drive = drive.added(_step(0.0, replace(OPEN, degenerate_direction=np.array([0.01, 0.0, 0.25]))))
    sigma = np.sqrt(np.diag(drive.known(WIDE).cov))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(WIDE.cov)) * [1.0, 1.0, np.sqrt(5.0)])


def test_before_anything_is_usual_the_odometry_says_how_little_is_known():
    drive = OpenDrive()
    drive = drive.added(_step(0.0, OPEN))
    assert drive.known(WIDE) is WIDE


def test_the_direction_turns_with_the_sensor(drive):
    drive = drive.added(_step(0.1, CLOSED, turn=np.pi / 2))
    drive = drive.added(_step(0.0, OPEN))
    np.testing.assert_allclose(drive.hidden, [0.0, 0.1], atol=1e-3)
