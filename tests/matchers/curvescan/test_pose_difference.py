"""How two poses differ."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import curvescan as cs
from curvescan.matchers.curvescan.pose_difference import difference, distance, is_along

poses = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(poses, poses)
def test_the_difference_takes_the_short_way_round(a, b):
    x, y, theta = difference(a, b)
    np.testing.assert_allclose([x, y], (a - b)[:2])
    assert abs(cs.se2.wrap(theta - (a - b)[2])) < 1e-12 or abs(abs(theta) - math.pi) < 1e-9
    assert distance(a, b) == max(math.hypot(x, y), 2 * abs(theta))


@given(poses, st.floats(-2, 2))
def test_a_slide_passes_what_lies_on_its_line(pose, way):
    direction = np.array([0.6, -0.8, 0.0])
    assert is_along(direction, pose, pose + way * direction, 0.1)
    assert not is_along(direction, pose, pose + way * direction + [0.16, 0.12, 0.0], 0.1)
    assert not is_along(direction, pose, pose + way * direction + [0.0, 0.0, 0.2], 0.1)


@pytest.mark.parametrize("turn", [-2.5, -0.4, 0.1, 1.0, 3.0])
def test_a_turn_passes_what_lies_on_its_arc(turn):
    centre = np.array([1.0, 2.0])
    pose = np.array([0.3, -0.2, 0.5])
    arm = pose[:2] - centre
    direction = np.array([-arm[1], arm[0], 1.0])  # what the turn does to the sensor at first
    rotated = centre + cs.se2.rotation(turn) @ arm
    other = np.array([*rotated, cs.se2.wrap(pose[2] + turn)])
    assert is_along(direction, pose, other, 0.01)
    assert is_along(-0.2 * direction, pose, other, 0.01)
    assert not is_along(direction, pose, other + np.array([0.0, 0.5, 0.0]), 0.1)
