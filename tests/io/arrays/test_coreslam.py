"""CoreSLAM logs: the Mines rover's laser, and its wheels."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from curvescan import se2
from curvescan.engines import run_engine
from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io import read_log

RANGES = [1500] * 682


def line(stamp: object = 2_500_000, left: object = 0, right: object = 0, ranges: object = None) -> str:
    middle = " ".join(["7"] * 20)
    numbers = " ".join(map(str, RANGES if ranges is None else ranges))
    return f"{stamp} 14710 {left} {right} {middle} {numbers} 0"


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{text}\n" for text in lines))
    return path


@pytest.mark.parametrize("is_packed", [False, True], ids=["plain", "gzip"])
def test_a_scan(tmp_path: Path, is_packed: bool) -> None:
    path = write(tmp_path / "a", line(ranges=[*range(100, 782)]))
    if is_packed:
        path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))
    log = read_log(path)
    (scan,) = log
    assert log.format == "CoreSLAM log"
    assert len(scan) == 682
    assert (scan.stamp, scan.range_max) == (2.5, 5.6)
    # from right to left, the 341st beam ahead; the rover stands in the outer ones
    assert scan.angles[340] == 0.0
    assert scan.angle_increment == pytest.approx(2 * math.pi / 1024)
    assert np.isnan(scan.ranges[[0, 69, 612, 681]]).all()
    assert scan.ranges[[70, 611]].tolist() == [0.17, 0.711]


def test_wheels_straight_on_and_turning_on_the_spot(tmp_path: Path) -> None:
    # a wheel of 77 mm goes 0.4838 m in a turn of 2,000 ticks; a turn about the axle's middle needs 330 mm * pi of each
    spin = round(math.pi / 2 * 0.165 / (2 * math.pi * 0.077) * 2000)
    lines = [line(left=5, right=9), line(left=2005, right=2009)]
    lines.append(line(left=2005 - spin, right=2009 + spin))
    odometry = read_log(write(tmp_path / "a", *lines)).odometry
    assert odometry is not None
    way = 2 * math.pi * 0.077
    np.testing.assert_allclose(odometry.poses[0], [0.145, 0, 0])
    np.testing.assert_allclose(odometry.poses[1], [0.145 + way, 0, 0])
    # the laser is ahead of the axle, and half a tick is 0.04 deg
    np.testing.assert_allclose(odometry.poses[2], [way, 0.145, math.pi / 2], atol=1e-3)


def test_another_mount_replaces_the_rovers(tmp_path: Path) -> None:
    path = write(tmp_path / "a", line(), line(left=2000, right=2000))
    odometry = read_log(path, laser_pose=(0.0, 0.5, 0.0)).odometry
    assert odometry is not None
    np.testing.assert_allclose(odometry.poses[:, :2], [[0, 0.5], [2 * math.pi * 0.077, 0.5]])


def test_wheels_on_an_arc(tmp_path: Path) -> None:
    # a full circle in steps of 10 deg, left: the rover comes home
    lines = [line(left=200 * k, right=round(200 * k * 1.5)) for k in range(2)]
    tick = 2 * math.pi * 0.077 / 2000
    turn = 100 * tick / 0.33
    odometry = read_log(write(tmp_path / "a", *lines)).odometry
    assert odometry is not None
    radius = 250 * tick / turn
    robot = se2.compose(odometry.poses[1], se2.inverse(np.array([0.145, 0, 0])))
    expected = [radius * math.sin(turn), radius * (1 - math.cos(turn)), turn]
    np.testing.assert_allclose(robot, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("broken", "rule"),
    [
        ("1 2 3", "line cut short: fewer than 706 fields"),
        (line() + " 1 2", "line too long: more than 707 fields"),
        (line(left="x"), "line with a field that is no number"),
        (line(left="9" * 400), "line with a field that is no number"),
        (line(stamp="inf"), "time stamp not finite"),
        (line(ranges=["x", *RANGES[1:]]), "line with a field that is no number"),
    ],
)
def test_a_broken_line_is_skipped_and_counted(tmp_path: Path, broken: str, rule: str) -> None:
    log = read_log(write(tmp_path / "a", line(), broken, line()))
    assert len(list(log)) == len(log) == 2
    (read_error,) = log.read_errors
    assert (read_error.rule, read_error.count, read_error.first) == (rule, 1, "line 2")


def test_other_tables_of_numbers_are_no_log(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match="text of an unknown format"):
        read_log(write(tmp_path / "a", " ".join(["1"] * 500)))
    with pytest.raises(InvalidArgumentError, match="has no topics"):
        read_log(write(tmp_path / "b", line()), topic="/scan")
    assert [s.range_max for s in read_log(tmp_path / "b", range_max=4.0)] == [4.0]


@pytest.mark.slow
def test_the_real_log_and_its_wheels_turn_the_same_way(real_data: Path) -> None:
    log = read_log(real_data / "mines-urg04/exp1.dat.gz")
    assert (len(log), log.read_errors) == (756, ())
    assert log.odometry is not None
    run = run_engine(scan for i, scan in enumerate(log) if i < 300)
    poses = run.trajectory.poses
    wheels = np.diff(np.unwrap(log.odometry.poses[:300, 2]))
    laser = np.diff(np.unwrap(poses[:, 2]))
    # the scans are older than the ticks of their lines by one line or two. Left and right changed, or a mirrored laser,
    # would give -0.9
    assert np.corrcoef(wheels[:-1], laser[1:])[0, 1] > 0.85
    ahead = se2.between(poses[:-1], poses[1:])[:, 0]
    wheels_ahead = se2.between(log.odometry.poses[:299], log.odometry.poses[1:300])[:, 0]
    assert np.corrcoef(wheels_ahead[:-1], ahead[1:])[0, 1] > 0.85
    # ticks and wheel radius: 3 % of the way
    assert np.sum(ahead) == pytest.approx(np.sum(wheels_ahead), rel=0.05)
