"""Open directions run along the walls, however roughly a match has them."""

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import find_matcher
from curvescan.slam.keyframes import Keyframes, along_walls

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
    assert found[2] == 0.05
    assert abs(np.arctan2(found[1], found[0]) - ANGLE) < 0.001


def test_a_direction_stays_as_it_is_where_there_are_no_walls():
    cloud = np.random.default_rng(3).uniform(-5.0, 5.0, (5000, 2))
    np.testing.assert_array_equal(along_walls(cloud, np.array([1.0, 0.0, 0.0])), [1.0, 0.0, 0.0])


def test_in_a_round_room_no_keyframes_match():
    poses = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.1]])
    keyframes = Keyframes(find_matcher("curvescan"))
    for k, scan in enumerate(cs.simulate("round-room", poses=poses, odometry_noise=None)):
        keyframes.add(scan, k)
    one, other = keyframes.prepared(0), keyframes.prepared(1)
    assert one.matcher.match(one.features, other.features, None).ok
    found = keyframes.match(0, other, None)
    assert not found.ok
    assert np.isnan(found.pose).all()
