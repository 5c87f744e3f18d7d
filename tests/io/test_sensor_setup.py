"""How a laser is set up: beams to ignore, mounts of any yaw and way up, sensors that turn against their log."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.cli.main import run
from curvescan.engines import run_engine
from curvescan.io import Log, SensorSetup, apply_setup, read_csv, read_log
from curvescan.scan import mirrored, swept_backwards
from tests.bags import SECOND, odometry, scan, transform, write_bag
from tests.carmen_files import flaser, odom, write
from tests.matchers.curvescan.scenes import pillar_scan
from tests.scenes import room_ranges

LEFT_BEHIND = np.array([-0.3, 0.2])  # of the laser, on the robot
STEP = np.array([0.05, 0.01, 0.06])


def turned(yaw, flip):
    """Quaternion of a laser whose x axis points to `yaw`, its z axis up or, where it is flipped, down."""
    half = yaw / 2
    if flip:  # half a turn about its own x axis after the yaw
        return {"x": math.cos(half), "y": math.sin(half), "z": 0.0, "w": 0.0}
    return {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}


def robot_poses(n=6):
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(se2.compose(poses[-1], STEP))
    return poses


def robot_bag(path, kind, yaw, *, flip=False, told=True, n_beams=720):
    """A robot with a full-circle laser mounted somehow, its wheel odometry exact; scans as the laser gives them."""
    mount = np.array([*LEFT_BEHIND, yaw])
    angles = -math.pi + 2 * math.pi / n_beams * np.arange(n_beams)
    rng = np.random.default_rng(3)
    entries = []
    for k, pose in enumerate(robot_poses()):
        seen_from_above = se2.compose(pose, mount)
        ranges = room_ranges(seen_from_above, -angles if flip else angles)
        stamp = (k + 1) * SECOND
        entries += [
            scan(
                stamp,
                ranges + 0.003 * rng.standard_normal(n_beams),
                angle_min=-math.pi,
                angle_increment=2 * math.pi / n_beams,
                range_max=20.0,
            ),
            odometry(stamp, pose),
        ]
    if told:
        x, y, _ = mount
        rotation = turned(yaw, flip)
        entries.append(transform(1, "base_link", "laser", (x, y, 0), rotation=rotation))
    return write_bag(path, kind, entries)


def agreement(log):
    """Largest difference between the laser's motion by its wheels and by its scans: metres, radians."""
    wheels = log.odometry.poses
    found = run_engine(log).trajectory.poses
    apart = se2.between(found, se2.between(wheels[0], wheels))
    return np.hypot(*apart[:, :2].T).max(), np.abs(apart[:, 2]).max()


@pytest.mark.parametrize("yaw_deg", [0.0, 50.0, 90.0, 180.0, -135.0])
@pytest.mark.parametrize("flip", [False, True])
def test_wheels_and_scans_agree_whatever_the_mount(tmp_path, yaw_deg, flip):
    log = read_log(robot_bag(tmp_path / "bag", "mcap", math.radians(yaw_deg), flip=flip))
    shift, turn = agreement(log)
    # 720 readings of 3 mm a match, and five matches
    assert shift < 0.005
    assert turn < 0.003
    assert any("mirrored" in note for note in log.notes) is flip
    assert (next(iter(log)).angle_increment < 0) is flip


def test_a_mount_that_the_log_does_not_tell_is_taken_from_the_user(tmp_path):
    bag = robot_bag(tmp_path / "bag", "ros1", math.radians(90.0), flip=True, told=False)
    told = {"laser_pose": (*LEFT_BEHIND, math.radians(90.0)), "upside_down": True}
    assert agreement(read_log(bag))[1] > 0.1  # the scans turn the other way
    assert agreement(read_log(bag, upside_down=True))[0] > 0.02  # the wheels move another point
    shift, turn = agreement(read_log(bag, **told))
    assert shift < 0.005
    assert turn < 0.003


def test_what_the_user_says_of_the_mount_stands_in_place_of_the_log(tmp_path):
    bag = robot_bag(tmp_path / "bag", "sqlite3", 0.4, flip=True)
    pose = (1.0, 2.0, -0.5)
    log = read_log(bag, laser_pose=pose)
    np.testing.assert_allclose(log.odometry.poses[0], pose, atol=1e-12)
    assert any("taken as given: x 1.000 m, y 2.000 m, yaw -28.6 deg" in note for note in log.notes)
    assert next(iter(read_log(bag, upside_down=False))).angle_increment > 0
    # two mirrors are none
    assert next(iter(read_log(bag, clockwise=True))).angle_increment > 0


@pytest.mark.parametrize(("pitch_deg", "leans"), [(0.0, None), (20.0, 20), (160.0, 20), (2.0, None)])
def test_a_laser_that_leans_is_told(tmp_path, pitch_deg, leans):
    half = math.radians(pitch_deg) / 2
    rotation = {"x": 0.0, "y": math.sin(half), "z": 0.0, "w": math.cos(half)}
    mount = transform(1, "base_link", "laser", rotation=rotation, topic="/tf_static")
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), mount]))
    said = [note for note in log.notes if "leans" in note]
    assert said == ([] if leans is None else [said[0]])
    assert leans is None or f"leans by {leans} deg: its scans are taken as level" in said[0]
    assert any("upside down" in note for note in log.notes) is (pitch_deg > 90)


def test_frames_of_any_name_tell_which_way_is_up(tmp_path):
    flip = transform(1, "body", "plate", rotation=turned(0.3, True))
    mount = transform(1, "plate", "laser", rotation=turned(1.0, True))
    for entries, is_mirrored in (([flip], False), ([mount], True), ([flip, mount], False)):
        path = tmp_path / f"bag{len(entries)}{is_mirrored}"
        first = next(iter(read_log(write_bag(path, "mcap", [scan(SECOND), *entries]))))
        assert (first.angle_increment < 0) is is_mirrored


def test_a_carmen_log_tells_the_robot_from_its_laser(tmp_path):
    path = write(tmp_path / "a.log", flaser(stamp=1), flaser(stamp=2))
    assert read_log(path).odometry.poses[0].tolist() == [1.5, -2.0, 0.25]
    given = read_log(path, laser_pose=(1.0, 0.0, 0.0)).odometry.poses[0]
    theta = se2.wrap(9.0)
    np.testing.assert_allclose(given, [9 + math.cos(9), 9 + math.sin(9), theta], atol=1e-12)
    # robot poses all zero are filler: the only poses there are stand for the robot's
    zeros = [line.replace(" 9 9 9 ", " 0 0 0 ") for line in (flaser(stamp=1), flaser(stamp=2))]
    filled = read_log(write(tmp_path / "b.log", *zeros), laser_pose=(0.0, 0.0, 0.5))
    np.testing.assert_allclose(filled.odometry.poses[0], [1.5, -2.0, 0.75])
    raw = write(tmp_path / "c.log", odom(1, 2, 0.5), "RAWLASER1 0 -1 1 .5 9 0 0 3 1 1 1 0 5 h 5")
    np.testing.assert_allclose(read_log(raw, laser_pose=(0.0, 0.0, 0.5)).odometry.poses, [[1.0, 2.0, 1.0]])


def test_ignored_beams_have_no_reading_and_keep_their_place(tmp_path):
    path = write(tmp_path / "a.log", flaser([1.0, 2.0, 3.0, 4.0, 5.0]), flaser([1.0, 2.0]))
    plain, log = read_log(path), read_log(path, ignore_beams=(1, 2))
    assert len(log) == 2
    assert isinstance(log, Log)
    for before, after in zip(plain, log, strict=True):
        np.testing.assert_array_equal(before.angles, after.angles)
        assert (before.stamp, before.range_max) == (after.stamp, after.range_max)
    first, second = log
    np.testing.assert_array_equal(first.ranges, [math.nan, 2.0, 3.0, math.nan, math.nan])
    assert not second.valid.any()
    assert any("first 1 and the last 2 beams" in note for note in log.notes)
    # in the sweep's own order, also where it is mirrored
    both = next(iter(read_log(path, ignore_beams=(1, 2), clockwise=True)))
    np.testing.assert_array_equal(both.ranges, first.ranges)
    np.testing.assert_allclose(both.angles, -first.angles)


def test_nothing_to_set_up_leaves_the_reader(tmp_path):
    log = read_log(write(tmp_path / "a.log", flaser()))
    assert apply_setup(log, SensorSetup()) is log
    assert apply_setup(log, SensorSetup(upside_down=False)) is log


def test_a_simulated_log_may_be_set_up_too():
    source = cs.simulate("office", n_scans=3, seed=1)
    log = apply_setup(source, SensorSetup(laser_pose=(0.5, 0.0, 0.0), clockwise=True))
    expected = se2.compose(source.odometry.poses, np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(log.odometry.poses, expected)
    np.testing.assert_allclose(next(iter(log)).angles, -source[0].angles)


@pytest.mark.parametrize(
    ("setup", "message"),
    [
        ({"ignore_beams": (-1, 0)}, r"two whole numbers >= 0.*got \(-1, 0\)"),
        ({"ignore_beams": (1,)}, "two whole numbers"),
        ({"ignore_beams": (0.5, 1)}, "two whole numbers"),
        ({"laser_pose": (0.0, math.nan, 0.0)}, "three finite numbers"),
        ({"laser_pose": (0.0, 0.0)}, "three finite numbers"),
        ({"ignore_beams": 5}, "two whole numbers >= 0.*got 5"),
        ({"laser_pose": 5}, "three finite numbers.*got 5"),
        ({"laser_pose": ("a", 0.0, 0.0)}, "three finite numbers"),
        ({"laser_pose": ("1", 0.0, 0.0)}, "three finite numbers"),
    ],
)
def test_wrong_set_ups_are_named(setup, message):
    with pytest.raises(cs.InvalidArgumentError, match=message):
        SensorSetup(**setup)


def test_mirrored_twice_is_the_scan():
    for one in (
        pillar_scan(intensities=np.arange(361.0), time_increment=1e-4, scan_time=0.1),
        cs.LaserScan([1.0, 2.0, 3.0], angles=[0.1, 0.2, 0.5], stamp=4.0),
    ):
        twice = mirrored(mirrored(one))
        assert (twice.angle_min, twice.angle_increment) == (one.angle_min, one.angle_increment)
        np.testing.assert_array_equal(twice.points, one.points)
        assert (twice.stamp, twice.time_increment) == (one.stamp, one.time_increment)
        flat = one.points * [1.0, -1.0]
        np.testing.assert_allclose(mirrored(one).points, flat, atol=1e-12)


def test_beams_turned_round_are_where_they_were(tmp_path):
    path = write(tmp_path / "a.log", flaser([1.0, 2.0, 3.0]))
    plain, turned_round = next(iter(read_log(path))), next(iter(read_log(path, backwards=True)))
    np.testing.assert_allclose(turned_round.points, plain.points[::-1], atol=1e-12)
    np.testing.assert_array_equal(turned_round.ranges, [3.0, 2.0, 1.0])
    told = cs.LaserScan([1.0, 2.0, 3.0], angles=[0.1, 0.2, 0.5], intensities=[7.0, 8.0, 9.0])
    back = swept_backwards(told)
    np.testing.assert_array_equal(back.angles, [0.5, 0.2, 0.1])
    np.testing.assert_array_equal(back.intensities, [9.0, 8.0, 7.0])
    np.testing.assert_array_equal(swept_backwards(back).points, told.points)
    # first in the log's order, last as swept
    first = next(iter(read_log(path, backwards=True, ignore_beams=(1, 0))))
    assert first.valid.tolist() == [True, True, False]


def test_readings_that_were_not_seen_again_are_dropped(tmp_path):
    rows = [[1.0, 2.0, 3.0], [1.0, 2.5, 3.0], [1.5, 2.5, 3.0, 4.0], [1.5, 81.91, 3.5, 4.0]]
    path = write(tmp_path / "a.log", *[flaser(row, stamp=k) for k, row in enumerate(rows)])
    found = [scan.valid.tolist() for scan in read_log(path, drop_stale=True)]
    assert found == [[True] * 3, [False, True, False], [True] * 4, [False, False, True, False]]
    log = read_log(path, drop_stale=True)
    assert next(scan.ranges.tolist() for scan in log) == rows[0]  # and again from the start
    assert "repeat those of the sweep before" in " ".join(log.notes)


@pytest.mark.slow
def test_commands_take_a_set_up(tmp_path, capsys):
    bag = robot_bag(tmp_path / "bag", "mcap", 0.0, flip=True, told=False)
    flags = ["--upside-down", "--backwards", "--ignore-beams", "3", "4", "--laser-pose", "0.1", "0", "90"]
    assert run(["info", str(bag), *flags]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "the laser hangs upside down" in printed
    assert "yaw 90.0 deg" in printed
    out = tmp_path / "out"
    assert run(["odometry", str(bag), "--out", str(out), *flags]) == 0
    assert read_csv(out / "trajectory.csv")[0].poses[1, 2] == pytest.approx(STEP[2], abs=0.003)
    # an empty rectangle looks the same after half a turn
    assert run(["match", str(bag), "0", "1", "--out", str(tmp_path / "match"), *flags]) == 3
    assert (tmp_path / "match" / "matched.png").exists()
    assert run(["info", str(bag), "--upside-down", "--upright"]) == 1
    assert "exclude each other" in capsys.readouterr().err


# ---- the laws of the scan model, through the odometry


def circle(pose, n_beams, start, way, seed, increment_deg=1.0):
    rng = np.random.default_rng(seed)
    angles = start + way * math.radians(increment_deg) * np.arange(n_beams)
    ranges = room_ranges(pose, angles) + 0.003 * rng.standard_normal(n_beams)
    return cs.LaserScan(ranges, angle_min=start, angle_increment=way * math.radians(increment_deg), range_max=20.0)


@pytest.mark.parametrize("n_beams", [359, 360, 361])
@pytest.mark.parametrize("way", [1, -1])
def test_circles_of_a_beam_more_or_less_give_the_motion(n_beams, way):
    poses = robot_poses()
    scans = [circle(p, n_beams, -2.0 - 0.3 * k, way, k) for k, p in enumerate(poses)]
    found = run_engine(scans).trajectory.poses
    np.testing.assert_allclose(found, poses, atol=0.008)


def test_beams_may_change_from_scan_to_scan():
    poses = robot_poses(8)
    layouts = [(360, -3.1, 1, 1.0), (180, -1.6, 1, 1.0), (721, 0.0, -1, 0.5), (300, 2.6, -1, 1.0)]
    scans = [circle(p, *layouts[k % 4][:3], k, layouts[k % 4][3]) for k, p in enumerate(poses)]
    run_ = run_engine(scans)
    assert not run_.is_failed.any()
    np.testing.assert_allclose(run_.trajectory.poses, poses, atol=0.012)
