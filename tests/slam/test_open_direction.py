"""Open directions run along the walls, however roughly a match has them, and doors tell the place along them."""

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation import World
from curvescan.slam.open_direction import along_walls, placed

ANGLE = 0.3


def corridor(rng, noise=0.01):
    """Return (n, 2) readings of two walls with recessed doors, and of an end wall, in a frame turned by ANGLE."""
    x = rng.uniform(-8.0, 8.0, 300)
    depth = np.where((x > 2.0) & (x < 3.0), 0.2, 0.0)
    y = np.where(rng.random(300) < 0.5, -1.0 - depth, 1.1 + depth) + noise * rng.normal(size=300)
    end = np.column_stack((np.full(20, 8.0), np.linspace(-1.0, 1.1, 20)))
    points = np.concatenate((np.column_stack((x, y)), end))
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    return points @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("tilt", [-0.02, -0.004, 0.01])
def test_a_direction_turns_along_the_walls(tilt):
    points = corridor(np.random.default_rng(1))
    found = along_walls(points, np.array([np.cos(ANGLE + tilt), np.sin(ANGLE + tilt), 0.05]))
    assert np.hypot(found[0], found[1]) == pytest.approx(1.0)
    assert found[2] == 0.0
    assert abs(np.arctan2(found[1], found[0]) - ANGLE) < 0.001


def test_what_crosses_a_corridor_does_not_turn_its_direction() -> None:
    x = np.linspace(-1.0, 8.0, 200)
    jamb = np.column_stack((np.full(12, 7.5), np.linspace(-1.0, -0.7, 12)))
    points = np.concatenate((np.column_stack((x, np.full(200, -1.0))), jamb))
    assert abs(along_walls(points, np.array([1.0, 0.0, 0.0]))[1]) < 0.0005


def test_a_direction_stays_as_it_is_where_there_are_no_walls():
    cloud = np.random.default_rng(3).uniform(-5.0, 5.0, (5000, 2))
    np.testing.assert_array_equal(along_walls(cloud, np.array([1.0, 0.0, 0.0])), [1.0, 0.0, 0.0])


def views(doors: list[float], poses: list[list[float]], people: Sequence[float] = ()) -> list[cs.LaserScan]:
    """Return what half a circle sees from poses in a corridor along x.

    doors: Where its walls stand back by 0.2 m; people: Where somebody stands between them, for each pose.
    """
    steps = [[-30.0, 0.0]] + [[x + dx, y] for x in doors for dx, y in ((0.0, 0.0), (0.0, 0.2), (0.9, 0.2), (0.9, 0.0))]
    line = np.array([*steps, [30.0, 0.0]])
    left, right = line + np.array([0.0, 1.0]), line * np.array([1.0, -1.0]) - np.array([0.7, 1.2])
    walls = np.vstack([np.hstack((one[:-1], one[1:])) for one in (left, right)])
    seen = []
    for pose, x in zip_longest(poses, people):
        world = World(walls=walls, circles=np.empty((0, 3)) if x is None else np.array([[x, -0.1, 0.2]]))
        seen += cs.simulate(world, sensor="sick-lms200", poses=np.array([pose]), odometry_noise=None)
    return seen


FACING = [[0.0, 0.0, 0.0], [5.0, 0.1, np.pi]]


ALONG = np.array([1.0, 0.0, 0.0])


def guessed(short: float) -> UncertainPose:
    """Return a match of two views that face each other, along the corridor where a guess has it."""
    return UncertainPose(se2.between(*np.array(FACING)) - short * ALONG, np.diag([1e4, 1e-4, 1e-5]))


@pytest.mark.parametrize("short", [-0.4, 0.0, 0.3])
def test_views_that_face_each_other_see_through_each_other_where_doors_are_elsewhere(short):
    found = placed(guessed(short), ALONG, *views([-4.0, 1.6, 3.5, 7.0], FACING))
    assert found is not None
    off = se2.between(se2.between(*np.array(FACING)), found.pose)
    np.testing.assert_allclose(off, 0.0, atol=0.06)
    assert 0.09 < np.sqrt(found.covariance[0, 0]) < 0.5
    np.linalg.cholesky(found.covariance)


@pytest.mark.parametrize("gone", [-0.6, -0.4, 0.4])
@pytest.mark.parametrize(("doors", "is_told"), [([3.5], False), ([-4.0, 1.6, 3.5, 7.0], True)])
def test_where_somebody_has_walked_tells_no_place(doors, is_told, gone):
    onward = np.array([[0.0, 0.0, 0.0], [0.6, 0.05, 0.0]])
    match = UncertainPose(se2.between(*onward), np.diag([1e4, 1e-4, 1e-5]))
    found = placed(match, ALONG, *views(doors, onward.tolist(), [1.8, 1.8 + gone]))
    assert found is not None or not is_told
    assert found is None or abs(found.pose[0] - 0.6) < 0.1


def test_bare_walls_tell_no_place():
    assert placed(guessed(0.0), ALONG, *views([], FACING)) is None


def test_how_the_beams_are_counted_tells_nothing():
    scans = views([-4.0, 1.6, 3.5, 7.0], FACING)
    backwards = [
        cs.LaserScan(one.ranges[::-1], angles=one.angles[::-1] + 2.0 * np.pi, range_max=one.range_max) for one in scans
    ]
    one, other = placed(guessed(0.3), ALONG, *scans), placed(guessed(0.3), ALONG, *backwards)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.pose, other.pose, atol=1e-12)
    np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-12)
