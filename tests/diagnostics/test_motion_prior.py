"""What a log tells of the motion: wheels first, a gyroscope else, used where they agree with the scans."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.motion_prior import choose_prior
from curvescan.diagnostics.preparation import mend
from curvescan.io.trajectories.trajectory import Trajectory
from tests.diagnostics.test_inspect import FakeLog
from tests.scenes import room_scan

TURNS = np.cumsum([0.0] + [0.03 + 0.12 * (k % 3) for k in range(29)])


class GyroOnly(FakeLog):
    """A log of a room seen on the turn, with a gyroscope and no wheels."""

    def __init__(self, scale=1.0, n_known=30):
        super().__init__([room_scan((0.3, 0.2, t), stamp=0.1 * k) for k, t in enumerate(TURNS)])
        self._turned = scale * np.where(np.arange(30) < n_known, TURNS, math.nan)

    def turned_by_gyro(self):
        return self._turned


def prior_of(log, wanted=None, *, as_is=False):
    mended = mend(log, as_is=as_is)
    return choose_prior(mended.log, sense=mended.report.sense, wanted=wanted)


def drive(scale=1.0, turn=1.0, n=80, fov=math.pi):
    """Return a log of a robot that drives round a room, with wheels that err by these factors."""
    k = np.arange(n)
    poses = np.column_stack([1.2 * np.cos(0.06 * k), 0.8 * np.sin(0.06 * k), 0.06 * k])
    scans = [room_scan(pose, sigma=0.005, seed=i, stamp=0.1 * i, fov=fov) for i, pose in enumerate(poses)]
    return with_wheels(scans, poses, scale, turn)


def drive_between_walls(turn=1.0, n=120, reach=3.5):
    """Return a log of a robot that winds along between two walls without an end, seen a few metres far."""
    headings = 0.3 * np.sin(0.25 * np.arange(n))
    poses = np.column_stack([*np.cumsum(0.1 * np.vstack([np.cos(headings), np.sin(headings)]), axis=1), headings])
    angles = np.radians(np.arange(-180.0, 180.0))
    layout = {"angle_min": -math.pi, "angle_increment": math.radians(1.0), "range_max": reach}
    rng, scans = np.random.default_rng(0), []
    for k, (_, y, heading) in enumerate(poses):
        across = np.sin(angles + heading + 1e-9)
        ranges = (np.sign(across) - y) / across + 0.005 * rng.standard_normal(angles.size)
        seen = np.where(ranges < reach, ranges, np.inf)
        scans.append(cs.LaserScan(seen, stamp=0.1 * k, **layout))
    return with_wheels(scans, poses, 1.0, turn)


def with_wheels(scans, poses, scale, turn):
    """Return a log with wheels that err by these factors."""
    wheels = [np.zeros(3)]
    for step in cs.se2.between(poses[:-1], poses[1:]) * [scale, scale, turn]:
        wheels.append(cs.se2.compose(wheels[-1], step))
    return FakeLog(scans, odometry=Trajectory(stamps=0.1 * np.arange(len(poses)), poses=np.array(wheels)))


def test_wheels_that_agree_are_used_as_they_are():
    log = drive()
    prior = prior_of(log)
    assert prior.poses is log.odometry.poses
    assert prior.sentence.startswith("used: the wheel odometry of the log, which agrees with the scans in")
    assert prior_of(log, False).poses is None


def test_wheels_are_compared_where_a_room_looks_alike_after_half_a_turn():
    """No match without a guess is sure in a bare rectangle seen all round, but a short motion is no half turn."""
    log = drive(fov=math.radians(359.0))
    assert all(found.confidence < 0.9 for found in (cs.match(log[k], log[k + 6]) for k in range(0, 70, 10)))
    assert prior_of(log).poses is log.odometry.poses
    assert prior_of(drive(3.0, fov=math.radians(359.0))).poses is None


@pytest.mark.parametrize(("turn", "is_used"), [(1.0, True), (3.0, False)])
def test_wheels_are_compared_with_what_scans_show_where_they_show_no_motion_whole(turn, is_used):
    log = drive_between_walls(turn)
    prior = prior_of(log)
    assert (prior.poses is not None) == is_used, prior.sentence
    assert "the wheel odometry of the log, which agrees with what the scans show of" in prior.sentence


@pytest.mark.parametrize(("scale", "turn"), [(3.0, 1.0), (0.1, 1.0), (1.0, 2.5)])
def test_wheels_that_disagree_are_left_out_and_used_when_insisted_on(scale, turn):
    log = drive(scale, turn)
    prior = prior_of(log)
    assert prior.poses is None
    assert prior.sentence.startswith("left out: the wheel odometry of the log, which")
    assert prior_of(log, True).poses is not None


def test_poses_that_never_drift_are_a_reference():
    log = drive(n=1100)  # 66 m round and round
    prior = prior_of(log)
    assert prior.poses is None
    assert "a reference and no motion prior, they never drift" in prior.sentence
    with pytest.raises(cs.InvalidArgumentError, match=r"they never drift: .*leave odometry_prior=True out"):
        prior_of(log, True)
    assert "agrees with the scans" in prior_of(drive(1.01, 1.01, n=1100)).sentence


@pytest.mark.parametrize("scale", [1.0, 180.0 / math.pi])
def test_a_gyroscope_tells_the_turn_in_radians_whatever_its_unit(scale):
    prior = prior_of(GyroOnly(scale)).poses
    assert prior.shape == (30, 3)
    assert np.isnan(prior[:, :2]).all()
    np.testing.assert_allclose(prior[:, 2], TURNS)


def test_a_gyroscope_in_degrees_is_left_out_as_it_is():
    assert prior_of(GyroOnly(180.0 / math.pi), as_is=True).poses is None


def test_a_gyroscope_that_turns_the_other_way_is_told_with_the_remedy():
    with pytest.raises(cs.InvalidArgumentError, match=r"turns against its scans in .* clockwise=True"):
        prior_of(GyroOnly(-1.0), True, as_is=True)
    # beyond doubt: the scans are mirrored, and then it agrees
    assert prior_of(GyroOnly(-1.0)).poses is not None


def test_where_the_gyroscope_is_silent_the_prior_is():
    assert np.isnan(prior_of(GyroOnly(n_known=20), True).poses[20:, 2]).all()


def test_a_log_with_neither_says_so():
    log = cs.log_from_arrays([(0.0, [1.0, 2.0])], angle_min=0.0, angle_increment=0.1)
    assert prior_of(log).sentence == ""
    with pytest.raises(cs.InvalidArgumentError, match="neither wheel odometry nor a gyroscope"):
        prior_of(log, True)
