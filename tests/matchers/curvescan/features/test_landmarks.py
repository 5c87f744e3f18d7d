"""Landmarks: stretches of wall, edges, and the axis of a scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.features.landmarks import (
    FACING_X,
    FACING_Y,
    MARK_X,
    MARK_Y,
    axis_of,
    stretches_of_wall,
)
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY, X, Y
from tests.matchers.curvescan.scenes import features, pillar_scan, turned
from tests.scenes import ROOM, room_scan


def board_scan():
    """A board 2 m ahead, from y = -0.5 to 0.5, before a wall 4 m ahead."""
    angles = -0.6 + 0.005 * np.arange(241)
    ranges = np.where(np.abs(2.0 * np.tan(angles)) < 0.5, 2.0, 4.0) / np.cos(angles)
    return cs.LaserScan(ranges, angle_min=-0.6, angle_increment=0.005)


def test_walls_lie_on_the_walls_of_a_room_and_hold_all_their_lengths():
    found = features(room_scan())
    walls, surfels = found.landmarks.walls, found.image.surfels
    lengths = np.hypot(walls[:, FACING_X], walls[:, FACING_Y])
    assert lengths.sum() == pytest.approx(surfels[:, LENGTH].sum(), rel=0.01)
    ahead = walls[:, FACING_X] < -0.9 * lengths
    assert ahead.any()
    np.testing.assert_allclose(walls[ahead, MARK_X], ROOM[2], atol=0.02)
    left = walls[:, FACING_Y] < -0.9 * lengths
    np.testing.assert_allclose(walls[left, MARK_Y], ROOM[3], atol=0.02)


def test_a_stretch_of_wall_is_the_mean_of_its_readings():
    found = features(board_scan())
    walls = found.landmarks.walls
    board = np.abs(walls[:, MARK_X] - 2.0) < 0.01
    assert board.sum() == 1  # it is 1 m wide
    surfels = found.image.surfels
    of_it = surfels[np.abs(surfels[:, X] - 2.0) < 0.01]
    expected = np.average(of_it[:, Y], weights=of_it[:, LENGTH])
    assert walls[board, MARK_Y] == pytest.approx(expected, abs=1e-9)
    assert walls[board, FACING_X] == pytest.approx(of_it[:, LENGTH] @ of_it[:, NX])
    # the wall behind is seen from -2.7 m to -1 m and on the other side: a stretch each
    assert (~board).sum() == 2


def test_a_long_wall_is_cut_and_single_readings_are_none():
    angles = -1.2 + 0.01 * np.arange(241)
    wall = features(cs.LaserScan(2.0 / np.cos(angles), angle_min=-1.2, angle_increment=0.01))
    surfels = wall.image.surfels
    length = np.ptp(surfels[:, Y])
    walls = wall.landmarks.walls
    assert length / 2.0 <= len(walls) <= length / 2.0 + 1
    alone = surfels.copy()
    alone[:, LENGTH] = 0.0
    assert len(stretches_of_wall(alone, wall.bounds)) == 0
    bent = surfels.copy()
    bent[:125, NX], bent[:125, NY] = -math.cos(0.4), math.sin(0.4)  # a corner where reading 125 is
    cut = stretches_of_wall(bent, wall.bounds)
    facing = cut[:, FACING_Y] / np.hypot(cut[:, FACING_X], cut[:, FACING_Y])
    assert (np.isclose(facing, 0.0, atol=1e-9) | np.isclose(facing, math.sin(0.4))).all()


def test_edges_are_those_of_near_surfaces_and_not_of_shadows():
    edges = features(board_scan()).landmarks.edges
    edges = edges[np.argsort(edges[:, MARK_Y])]
    np.testing.assert_allclose(edges[:, MARK_X], 2.0, atol=1e-9)
    np.testing.assert_allclose(edges[:, MARK_Y], [-0.5, 0.5], atol=0.02)
    # unit vectors across the beams, to where the wall behind is hidden from a sensor that moves there
    beams = edges[:, [MARK_X, MARK_Y]] / np.hypot(edges[:, MARK_X], edges[:, MARK_Y])[:, np.newaxis]
    facing = edges[:, [FACING_X, FACING_Y]]
    np.testing.assert_allclose(np.hypot(*facing.T), 1.0)
    np.testing.assert_allclose((beams * facing).sum(axis=1), 0.0, atol=1e-12)
    assert (np.sign(facing[:, 1]) == [-1, 1]).all()


def test_the_seam_of_a_full_circle_has_edges_as_any_other_place():
    # a board behind the sensor, across the first beam, in a round room
    angles = -math.pi + math.pi / 180 * np.arange(360)
    ranges = np.where(np.abs(np.cos(angles) + 1.0) < 0.02, 2.0, 4.0)
    full = features(cs.LaserScan(ranges, angle_min=-math.pi, angle_increment=math.pi / 180)).landmarks.edges
    assert len(full) == 2
    half = np.abs(angles) < 3.0  # an open sweep that ends on the board on both sides
    part = cs.LaserScan(ranges[half], angle_min=angles[half][0], angle_increment=math.pi / 180)
    assert len(features(part).landmarks.edges) == np.count_nonzero(np.diff(ranges[half]))


@pytest.mark.parametrize("angle", [0.5, 2.0, -3.0])
def test_landmarks_turn_with_the_sensor_frame(angle):
    scan = pillar_scan(seed=1)
    plain, moved = features(scan).landmarks, features(turned(scan, angle)).landmarks
    for one, other in ((plain.walls, moved.walls), (plain.edges, moved.edges)):
        places = cs.se2.transform([0.0, 0.0, angle], one[:, [MARK_X, MARK_Y]])
        np.testing.assert_allclose(places, other[:, [MARK_X, MARK_Y]], atol=1e-9)
        facing = cs.se2.transform([0.0, 0.0, angle], one[:, [FACING_X, FACING_Y]])
        np.testing.assert_allclose(facing, other[:, [FACING_X, FACING_Y]], atol=1e-9)
    assert math.remainder(moved.axis - plain.axis - angle, math.pi / 2) == pytest.approx(0.0, abs=1e-7)


def test_round_things_in_rows_have_the_axis_of_the_rows():
    for turn in (-0.6, 0.0, 0.4):
        axis = features(pillar_scan((0.0, 0.0, turn))).landmarks.axis
        assert abs(math.remainder(axis + turn, math.pi / 2)) < 0.05
    # readings at the fronts of pillars three metres apart, which face alike, none beside another on a wall
    samples = np.zeros((9, 11))
    samples[:, X], samples[:, Y] = np.repeat([2.0, 5.0, 8.0], 3), np.tile([-3.0, 0.0, 3.0], 3)
    samples[:, NX] = -1.0
    c, s = math.cos(0.3), math.sin(0.3)
    tilted = samples.copy()
    tilted[:, X], tilted[:, Y] = c * samples[:, X] - s * samples[:, Y], s * samples[:, X] + c * samples[:, Y]
    assert axis_of(samples) == pytest.approx(0.0, abs=1e-6)
    assert axis_of(tilted) == pytest.approx(0.3, abs=1e-6)
    samples[:, NX] = np.tile([-1.0, 1.0, 0.0], 3)  # of things that face another way none
    samples[2::3, NY] = 1.0
    assert axis_of(samples) == pytest.approx(0.0, abs=1e-6)
