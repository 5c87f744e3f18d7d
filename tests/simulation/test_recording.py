"""simulate(): a log with its truth: the Log protocol, seeds, masks, what people change and what not."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log
from curvescan.scan import LaserScan
from curvescan.simulation import SENSORS, Drive, OdometryNoise, build_world, simulate
from curvescan.simulation.sensing.raycast import cast_rays

N = 12
CLEAN = replace(SENSORS["sick-lms200"], sigma_range=0.0, dropout=0.0)


@pytest.fixture(scope="module")
def crowded():
    return simulate("office", n_scans=N, n_people=6, seed=3)


@pytest.fixture(scope="module")
def deserted():
    return simulate("office", n_scans=N, seed=3)


def test_a_simulation_is_a_log(crowded):
    assert isinstance(crowded, Log)
    assert (crowded.name, crowded.format, crowded.read_errors) == ("office (seed 3)", "simulated log", ())
    assert len(crowded) == len(list(crowded)) == len(list(crowded)) == N
    assert all(isinstance(scan, LaserScan) for scan in crowded)
    assert [scan.stamp for scan in crowded] == crowded.truth.stamps.tolist()
    assert np.array_equal(crowded.odometry.stamps, crowded.truth.stamps)
    np.testing.assert_array_equal(crowded[-1].ranges, crowded.ranges[N - 1])
    with pytest.raises(IndexError):
        crowded[N]


def test_scans_carry_the_sensor(crowded):
    scan, sensor = crowded[0], crowded.sensor
    assert len(scan) == sensor.n_beams
    assert (scan.angle_min, scan.angle_increment) == (sensor.angle_min, sensor.angle_increment)
    assert (scan.range_min, scan.range_max) == (sensor.range_min, sensor.range_max)


def test_the_same_seed_gives_the_same_bits(crowded):
    again = simulate("office", n_scans=N, n_people=6, seed=3)
    for name in ("ranges", "exact_ranges", "is_person", "people"):
        assert np.array_equal(getattr(again, name), getattr(crowded, name), equal_nan=True)
    assert np.array_equal(again.truth.poses, crowded.truth.poses)
    assert np.array_equal(again.odometry.poses, crowded.odometry.poses)
    other = simulate("office", n_scans=N, n_people=6, seed=4)
    assert not np.array_equal(other.ranges, crowded.ranges, equal_nan=True)


def test_a_shorter_log_is_the_start_of_a_longer_one(crowded):
    few = simulate("office", n_scans=5, n_people=6, seed=3)
    for name in ("ranges", "exact_ranges", "is_person", "people"):
        assert np.array_equal(getattr(few, name), getattr(crowded, name)[:5], equal_nan=True)
    assert np.array_equal(few.truth.poses, crowded.truth.poses[:5])
    assert np.array_equal(few.odometry.poses, crowded.odometry.poses[:5])


def test_people_change_nothing_but_what_they_hide(crowded, deserted):
    assert np.array_equal(crowded.truth.poses, deserted.truth.poses)
    assert np.array_equal(crowded.odometry.poses, deserted.odometry.poses)
    assert np.all(crowded.exact_ranges <= deserted.exact_ranges)
    is_hidden = crowded.exact_ranges < deserted.exact_ranges
    assert is_hidden.any()
    assert np.array_equal(crowded.ranges[~is_hidden], deserted.ranges[~is_hidden], equal_nan=True)
    assert not deserted.is_person.any()


def test_the_mask_marks_the_readings_of_people(crowded, deserted):
    is_hidden = crowded.exact_ranges < deserted.exact_ranges
    is_valid = np.array([scan.valid for scan in crowded])
    assert np.array_equal(crowded.is_person, is_hidden & is_valid)


def test_the_truth_explains_the_scans(deserted):
    for scan, pose in zip(deserted, deserted.truth.poses, strict=True):
        x = pose[0] + scan.ranges * np.cos(pose[2] + scan.angles)
        y = pose[1] + scan.ranges * np.sin(pose[2] + scan.angles)
        hits = np.column_stack([x, y])[scan.valid]
        # six sigma of range noise: a reading ends within it of a surface
        assert outside_by(deserted.world, hits).max() < 6.0 * deserted.sensor.sigma_range


def outside_by(world, points):
    """Distance to the nearest surface, from outside and from inside of solids."""
    edges = replace(world, walls=world.segments, boxes=np.empty((0, 5)))
    return edges.distance(points)


def test_noise_is_that_of_the_sensor(deserted):
    error = (deserted.ranges - deserted.exact_ranges)[np.isfinite(deserted.ranges)]
    sigma = deserted.sensor.sigma_range
    assert abs(error.std() / sigma - 1.0) < 5.0 / np.sqrt(2.0 * error.size)
    assert abs(error.mean()) < 5.0 * sigma / np.sqrt(error.size)


def test_given_poses_and_a_given_world():
    poses = np.array([[0.0, 0.0, 0.0], [0.5, 0.1, 3.0]])
    world = build_world("room")
    log = simulate(world, sensor=CLEAN, poses=poses)
    assert log.world is world
    assert np.array_equal(log.truth.poses, poses)
    assert log[0].ranges[180] == pytest.approx(4.0, abs=1e-12)
    assert len(simulate(world, sensor=CLEAN, poses=poses, n_scans=1)) == 1


def test_without_a_count_it_is_one_lap():
    world = build_world("l-hall")
    route = replace(world, route=[[1.5, 1.5], [3.0, 1.5]])
    log = simulate(route, sensor=replace(CLEAN, n_beams=5))
    assert np.hypot(*(log.truth.poses[-1, :2] - log.truth.poses[0, :2])) < 0.5
    assert 2.5 < np.hypot(*np.diff(log.truth.poses[:, :2], axis=0).T).sum() < 4.0
    assert len(simulate(world, sensor=replace(CLEAN, n_beams=1))) == 200


def test_odometry_may_be_left_out_or_perfect():
    assert simulate("room", n_scans=2, odometry_noise=None).odometry is None
    assert simulate("room", n_scans=2, drive=Drive(path="home")).odometry is not None
    noise = OdometryNoise(turn_from_drive=10.0)
    loud, quiet = simulate("room", n_scans=9, odometry_noise=noise), simulate("room", n_scans=9)
    assert np.array_equal(loud.ranges, quiet.ranges, equal_nan=True)


def test_results_cannot_be_overwritten(crowded):
    with pytest.raises(ValueError, match="read-only"):
        crowded.ranges[0, 0] = 1.0


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"world": "bilding"}, "did you mean 'building'"),
        ({"sensor": "hokuyo"}, "did you mean 'hokuyo-270'"),
        ({"n_scans": 0}, "n_scans must be >= 1, got 0"),
        ({"n_people": -1}, "n_people must be >= 0, got -1"),
        ({"seed": -5}, "seed must be an integer >= 0, got -5"),
        ({"seed": 1.5}, "seed must be an integer >= 0, got 1.5"),
        ({"poses": np.zeros((2, 2))}, r"poses must be finite, of shape \(n, 3\)"),
        ({"poses": np.zeros((2, 3)), "n_scans": 3}, "only 2 poses are given"),
    ],
)
def test_bad_arguments_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        simulate(**{"world": "room", "n_scans": 2, **bad})


def test_numba_is_not_loaded_before_a_ray_is_cast():
    code = (
        "import sys, curvescan.simulation as s; s.build_world('building'); s.simulate_pairs(n_pairs=2);"
        "sys.exit('numba' in sys.modules or 'matplotlib' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_each_beam_of_a_slow_sweep_is_cast_from_its_own_place():
    slow = replace(CLEAN, time_increment=CLEAN.period / CLEAN.n_beams)
    world = build_world("office", 3)
    log = simulate(world, sensor=slow, n_scans=40, seed=3)
    at_once = simulate(world, sensor=CLEAN, n_scans=40, seed=3)
    np.testing.assert_array_equal(log.truth.poses, at_once.truth.poses)
    scan, poses = log[20], log.truth.poses
    assert (scan.time_increment, scan.scan_time) == (slow.time_increment, slow.period)
    np.testing.assert_array_equal(scan.ranges[0], at_once[20].ranges[0])
    assert np.abs(log.ranges - at_once.ranges)[np.isfinite(log.ranges)].max() > 0.05
    motion = se2.log(se2.between(poses[20], poses[21]))
    for beam in (1, 100, 250, 360):
        pose = se2.compose(poses[20], se2.exp(motion * beam / CLEAN.n_beams))
        alone, _ = cast_rays(world, pose, angle_min=scan.angles[beam], angle_increment=1.0, n_beams=1, range_max=8.0)
        assert log.exact_ranges[20, beam] == pytest.approx(alone[0], abs=1e-9)


def test_a_slow_sweep_of_one_pose_stands_still():
    slow = replace(CLEAN, time_increment=1e-4)
    one = [[3.0, 3.0, 0.5]]
    swept = simulate("office", sensor=slow, poses=one, seed=2, n_people=2)
    still = simulate("office", sensor=CLEAN, poses=one, seed=2, n_people=2)
    np.testing.assert_allclose(swept.exact_ranges, still.exact_ranges, atol=1e-9)
    np.testing.assert_array_equal(swept.is_person, still.is_person)
