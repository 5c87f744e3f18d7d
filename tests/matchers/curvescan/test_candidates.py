"""Candidates of a match: the images of the best under the symmetries of the walls are among them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from tests.matchers.curvescan.test_prior import PITCH, corridor_scan

MOTION = np.array([0.2, 0.1, 0.4])


def hall_scan(pose, width, depth, seed):
    """A full circle within an empty rectangle about the origin."""
    angles = np.radians(np.arange(-179.5, 180.5, 1.0))
    directions = np.stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])], axis=1)
    walls = (np.sign(directions) * 0.5 * np.array([width, depth]) - pose[:2]) / directions
    noise = np.random.default_rng(seed).normal(0.0, 0.005, angles.size)
    return cs.LaserScan(walls.min(axis=1) + noise, angle_min=angles[0], angle_increment=math.radians(1.0), range_max=20)


def images(start, turns):
    """The true motion with the end seen from a start that is turned about the centre, as often as the room allows."""
    end = cs.se2.compose(start, MOTION)
    return [cs.se2.between(start, cs.se2.compose(np.array([0.0, 0.0, turn]), end)) for turn in turns]


def holds(result, pose):
    """Return whether a pose is among the candidates."""
    offs = [cs.se2.between(pose, one.pose) for one in result.candidates]
    return any(math.hypot(x, y) < 0.05 and abs(turn) < 0.03 for x, y, turn in offs)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("width", "depth", "n"), [(6.0, 4.0, 2), (3.0, 2.0, 2), (5.0, 5.0, 4)])
def test_the_turned_poses_of_an_empty_room_are_candidates(width, depth, n, seed):
    rng = np.random.default_rng(seed)
    start = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-math.pi, math.pi)])
    end = cs.se2.compose(start, MOTION)
    result = cs.match(hall_scan(start, width, depth, seed), hall_scan(end, width, depth, seed + 50))
    for image in images(start, 2.0 * math.pi / n * np.arange(n)):
        assert holds(result, image)
    assert result.outcome is cs.Outcome.AMBIGUOUS
    assert len(result.candidates) <= 8
    odds = [one.log_odds for one in result.candidates]
    assert odds == sorted(odds, reverse=True)


def test_one_thing_on_in_a_row_of_equal_ones_is_a_candidate_to_either_side():
    result = cs.match(corridor_scan(0.3, 1), corridor_scan(0.6, 2))
    for k in (-1.0, 0.0, 1.0):
        assert holds(result, np.array([0.3 + k * PITCH, 0.0, 0.0]))
