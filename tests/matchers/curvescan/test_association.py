"""Association: the reading of the other scan that a reading falls on, both ways round, against the laws of SE(2)."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.association import (
    BACKWARD,
    FORWARD,
    associate,
    faces_away,
    is_seen_through,
    lever,
    motion_of,
    project,
    turned,
    turned_back,
)
from curvescan.matchers.curvescan.features.range_image import place_in, reading_at
from curvescan.matchers.curvescan.features.surfels import CX, CY, NX, NY, X, Y
from tests.matchers.curvescan.scenes import MOTION, pair

_ROUNDING = 1e-12  # metres


@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_a_reading_falls_on_the_reading_in_its_direction(way):
    ref, cur = pair(1)
    pose = MOTION + np.array([0.01, -0.02, 0.015])
    moved, other, towards = (cur, ref, pose) if way == FORWARD else (ref, cur, cs.se2.inverse(pose))
    surfels, motion = moved.image.surfels, motion_of(pose, way)
    placed = project(surfels, motion, other.image)
    n_found = 0
    for i in range(0, len(surfels), 3):
        x, y = cs.se2.transform(towards, surfels[i, [X, Y]])
        found = associate(placed, i, other.image)
        assert (found.x, found.y) == pytest.approx((x, y), abs=_ROUNDING)
        assert found.place == pytest.approx(
            place_in(x, y, other.image.azimuth_min, other.image.slots_a_radian), abs=1e-6
        )
        assert found.j == reading_at(found.x, found.y, other.image)
        if found.j < 0:
            assert found.across == found.along == 0.0
            continue
        n_found += 1
        line = other.image.surfels[found.j]
        off = np.array([x - line[CX], y - line[CY]])
        # the line's own axes: its normal, and that turned clockwise
        axes = np.array([line[[NX, NY]], [line[NY], -line[NX]]])
        assert (found.across, found.along) == pytest.approx(axes @ off, abs=_ROUNDING)
    assert n_found > 60


def test_a_lever_is_seen_from_the_current_sensor_along_the_axes_of_the_reference():
    ref, cur = pair(2)
    point = cur.image.surfels[10, [X, Y]]
    forward = lever(cur.image.surfels, 10, motion_of(MOTION, FORWARD))
    assert forward == pytest.approx(cs.se2.transform(MOTION, point) - MOTION[:2], abs=_ROUNDING)
    point = ref.image.surfels[10, [X, Y]]
    backward = lever(ref.image.surfels, 10, motion_of(MOTION, BACKWARD))
    assert backward == pytest.approx(point - MOTION[:2], abs=_ROUNDING)


def test_turning_back_undoes_turning():
    motion = motion_of(np.array([0.3, -0.4, 2.0]), FORWARD)
    x, y = turned(0.6, -0.8, motion)
    assert (x, y) == pytest.approx(cs.se2.transform(np.array([0.0, 0.0, 2.0]), np.array([0.6, -0.8])))
    assert turned_back(x, y, motion) == pytest.approx((0.6, -0.8))


@pytest.mark.parametrize(
    ("front", "is_through"), [(5.1, True), (5.0, False), (4.9, False), (0.0, False), (-6.0, False)]
)
def test_a_point_before_the_other_reading_is_seen_through(front, is_through):
    assert is_seen_through(3.0, -4.0, front) == is_through


@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_a_side_of_a_wall_is_seen_from_its_own_side(way):
    surfels = pair(1)[0].image.surfels[:1].copy()
    surfels[0, [X, Y, NX, NY]] = 2.0, 0.0, -1.0, 0.0  # straight ahead
    for x, y, is_behind in (
        (0.0, 0.0, False),
        (1.9, 3.0, False),
        (2.2, 3.0, False),
        (2.4, 3.0, True),
        (4.0, 0.0, True),
    ):
        pose = np.array([x, y, 2.0])  # of the other sensor; one 4 degrees behind the wall grazes it
        motion = motion_of(pose if way == BACKWARD else cs.se2.inverse(pose), way)
        assert faces_away(surfels, 0, motion) is is_behind
