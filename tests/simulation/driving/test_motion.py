"""Drives: smooth, clear of things, within the limits; wheel odometry: noise as its model says."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.simulation import Drive, OdometryNoise, World, build_world, wheel_odometry
from curvescan.simulation.buildings.rooms import room
from curvescan.simulation.driving.motion import Grid, drive_home, drive_route

PERIOD = 0.2
NONE = OdometryNoise(turn_from_turn=0.0, turn_from_drive=0.0, drive_from_drive=0.0, drive_from_turn=0.0)


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", ["office", "building", "clutter", "corridor", "round-room"])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_drive_is_smooth_and_clear_of_everything(name, seed):
    world, drive = build_world(name, seed), Drive()
    poses = drive_route(world, drive, PERIOD, rng(seed), 150)
    assert poses.shape == (150, 3)
    steps = se2.between(poses[:-1], poses[1:])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() <= drive.speed * PERIOD + 1e-9
    assert np.abs(steps[:, 2]).max() <= drive.turn_rate * PERIOD + 1e-9
    changes = np.diff(np.hypot(steps[:, 0], steps[:, 1])) / PERIOD
    assert np.abs(changes).max() <= drive.acceleration * PERIOD + 1e-2  # a chord is not an arc
    # planned with 0.4 m to spare; a grid cell and rounded corners cost some
    assert world.is_free(poses[:, :2], 0.25).all()
    assert np.hypot(steps[:, 0], steps[:, 1]).sum() > 0.3 * drive.speed * PERIOD * 150


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_a_lap_of_a_building_is_clear_of_everything_and_closes(seed):
    world = build_world("building", seed)
    poses = drive_route(world, Drive(speed=0.9), PERIOD, rng())
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert 55.0 < steps.sum() < 90.0
    assert world.is_free(poses[:, :2], 0.25).all()
    assert np.hypot(*(poses[-1, :2] - poses[0, :2])) < 0.5
    assert np.array_equal(drive_route(world, Drive(speed=0.9), PERIOD, rng(), 50), poses[:50])


def test_the_way_home():
    world = build_world("clutter", 1)
    poses = drive_home(world, Drive(), PERIOD, rng(2), 250)
    offsets = np.hypot(*(poses[:, :2] - poses[0, :2]).T)
    assert poses.shape == (250, 3)
    assert offsets[-1] < 0.2  # half a grid cell each at start and end, and the stopping distance
    assert 0.4 < offsets.max() < 1.5
    assert np.array_equal(poses[-1], poses[-2])  # it stands still
    assert world.is_free(poses[:, :2], 0.25).all()
    assert len(drive_home(world, Drive(), PERIOD, rng(2), 3)) == 3


def test_without_a_route_places_are_random_and_few_poses_begin_many():
    poses = drive_route(room(), Drive(), PERIOD, rng(4), 120)
    assert np.array_equal(drive_route(room(), Drive(), PERIOD, rng(4), 40), poses[:40])
    assert not np.array_equal(drive_route(room(), Drive(), PERIOD, rng(5), 40), poses[:40])


def test_what_cannot_be_driven_is_refused():
    with pytest.raises(InvalidArgumentError, match="no route"):
        drive_route(room(), Drive(), PERIOD, rng())
    with pytest.raises(InvalidArgumentError, match="no free place"):
        drive_route(room(0.5, 0.5), Drive(), PERIOD, rng(), 5)
    with pytest.raises(InvalidArgumentError, match="nowhere to go"):
        drive_route(room(1.0, 1.0), Drive(), PERIOD, rng(), 5)
    blocked = room(8.0, 6.0) + World(walls=[[0, -3, 0, 3]], route=[[-2, 0], [2, 0]])
    with pytest.raises(InvalidArgumentError, match="no way along the route"):
        drive_route(blocked, Drive(), PERIOD, rng(), 5)
    with pytest.raises(InvalidArgumentError, match="speed must be > 0, got 0"):
        Drive(speed=0.0)
    with pytest.raises(InvalidArgumentError, match="turn_from_turn must be >= 0, got -1"):
        OdometryNoise(turn_from_turn=-1.0)


def test_a_planned_walk_is_short_and_clear():
    world = build_world("l-hall")
    grid = Grid(world)
    walk = grid.plan([9.0, 1.5], [1.5, 9.0], 0.4)
    assert world.is_free(walk, 0.4 - 1e-9).all()
    length = np.hypot(*np.diff(walk, axis=0).T).sum()
    assert np.hypot(7.5, 7.5) < length < 15.0  # between the straight line and the square way
    blocked = Grid(world + World(walls=[[0, 3.2, 3, 3.2]]))
    assert blocked.plan([9.0, 1.5], [1.5, 9.0], 0.4) is None
    assert blocked.reachable([9.0, 1.5], 0.4)[:, 1].max() < 3.0


def test_odometry_without_noise_is_the_truth():
    poses = drive_route(room(), Drive(), PERIOD, rng(), 80)
    odometry = wheel_odometry(poses, NONE, rng())
    assert np.array_equal(odometry[0], np.zeros(3))
    np.testing.assert_allclose(se2.between(odometry, se2.between(poses[0], poses)), 0.0, rtol=0, atol=1e-12)
    backward = np.array([[0, 0, 0], [-0.1, 0.01, 0.2], [-0.1, 0.01, 0.4]], dtype=float)
    np.testing.assert_allclose(wheel_odometry(backward, NONE, rng()), backward, atol=1e-15)
    assert wheel_odometry(poses[:1], NONE, rng()).shape == (1, 3)


def test_odometry_noise_has_the_variances_of_its_model():
    noise = OdometryNoise()
    n, drive = 4000, 0.15
    straight = np.array([[0.0, 0.0, 0.0], [drive, 0.0, 0.0]])
    ends = np.array([wheel_odometry(straight, noise, rng(i))[1] for i in range(n)])
    # two turns, each with alpha 2 of the drive; five standard errors of a deviation
    limit = 5.0 / np.sqrt(2.0 * n)
    sigma_turn = np.sqrt(2.0 * noise.turn_from_drive) * drive
    sigma_drive = np.sqrt(noise.drive_from_drive) * drive
    assert abs(ends[:, 2].std() / sigma_turn - 1.0) < limit
    assert abs(np.hypot(ends[:, 0], ends[:, 1]).std() / sigma_drive - 1.0) < limit
    turn = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3]])
    ends = np.array([wheel_odometry(turn, noise, rng(i))[1] for i in range(n)])
    assert abs(ends[:, 2].std() / (np.sqrt(noise.turn_from_turn) * 0.3) - 1.0) < limit
    assert abs(ends[:, 2].mean() - 0.3) < 5.0 * ends[:, 2].std() / np.sqrt(n)


def test_an_unknown_path_is_refused():
    with pytest.raises(InvalidArgumentError, match="path must be 'route' or 'home', got 'nowhere'"):
        Drive(path="nowhere")
