"""The floor that a tilted laser sees is found and left out; walls that a robot follows are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.floor import find_lines, moves_along
from curvescan.diagnostics.inspect import inspect_log
from curvescan.diagnostics.preparation import mend
from curvescan.diagnostics.top_of_range import BIN, TopOfRange
from curvescan.evaluation.trajectory_errors import ate
from curvescan.io.arrays.memory import as_log
from curvescan.simulation import World

WIDTH = 2.4
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
SQUARE = np.hstack((CORNERS, np.roll(CORNERS, -1, axis=0)))
RING = World(walls=np.vstack((8.0 * SQUARE, (8.0 - WIDTH) * SQUARE)))
"""A bare corridor around a block: its walls are all that a robot sees."""


def lap(radius=0.6):
    """Return (n, 3) poses once around the ring, 8 cm or 3 degrees apart, counter-clockwise."""
    side, straight = 8.0 - 0.5 * WIDTH, np.arange(-8.0 + 0.5 * WIDTH + radius, 8.0 - 0.5 * WIDTH - radius, 0.08)
    turn = np.radians(np.arange(0.0, 90.0, 3.0))
    legs = []
    for corner in range(4):
        along = np.column_stack((straight, np.full(len(straight), -side), np.zeros(len(straight))))
        bend = np.column_stack((side - radius + radius * np.sin(turn), radius - side - radius * np.cos(turn), turn))
        leg, angle = np.concatenate((along, bend)), 0.5 * np.pi * corner
        c, s = np.cos(angle), np.sin(angle)
        legs.append(np.column_stack((c * leg[:, 0] - s * leg[:, 1], s * leg[:, 0] + c * leg[:, 1], leg[:, 2] + angle)))
    return np.concatenate(legs)


def driven():
    return cs.simulate(RING, sensor="sick-lms200", seed=1, poses=lap(), odometry_noise=None)


def tilted(log, distance, direction=0.0, pitch=0.0):
    """Return a log by a laser that sees the floor; pitch: how the distance varies from scan to scan, share of it."""
    rng, scans = np.random.default_rng(2), []
    for scan in log:
        ahead = np.cos(scan.angles - direction)
        floor = distance * (1.0 + pitch * rng.standard_normal()) / np.maximum(ahead, 1e-9)
        floor += 0.01 * rng.standard_normal(len(scan))
        is_floor = (floor < np.where(scan.valid, scan.ranges, np.inf)) & (floor < scan.range_max)
        scans.append(replace(scan, ranges=np.where(is_floor, floor, scan.ranges)))
    return as_log(scans)


@pytest.mark.parametrize(("distance", "direction", "pitch"), [(5.0, 0.0, 0.0), (3.0, 0.3, 0.0), (5.0, 0.0, 0.03)])
def test_the_floor_is_left_out_and_said(distance, direction, pitch):
    spoilt = tilted(driven(), distance, direction, pitch)
    mended, floor = mend(spoilt, is_order_needed=False), inspect_log(spoilt).floor
    assert floor.distance * (1.0 - 0.5 * floor.depth) == pytest.approx(distance, rel=0.05)
    assert floor.direction == pytest.approx(direction, abs=0.1)
    assert [issue.kind for issue in mended.done] == ["floor"]
    assert f"{distance:.0f}." in mended.done[0].what or f"{distance - 1:.0f}.9" in mended.done[0].what
    assert mended.remarks[0].startswith("ignored: readings of the floor and beyond")
    ahead = max(np.max(s.ranges * np.cos(s.angles - direction), where=s.valid, initial=0.0) for s in mended.log)
    assert 0.75 * distance < ahead < 0.99 * distance


def test_a_tilted_laser_drives_a_bare_corridor_as_far_as_a_level_one():
    log = driven()
    truth = log.truth.poses

    def off(scans):
        odometry = cs.Odometry()
        poses = np.array([odometry.add(scan).pose for scan in scans])
        return float(ate(poses, truth).max())

    spoilt = tilted(log, 4.0)
    assert off(spoilt) > 3.0
    assert off(mend(spoilt, is_order_needed=False).log) < 1.0


def test_a_wall_that_a_robot_follows_is_no_floor():
    """On the right it is always 1.2 m away, and no beam sees beyond it."""
    log, top = driven(), TopOfRange()
    for scan in log:
        top.add(scan)
    wall = find_lines(top.counts, BIN, log[0].angles)[0]
    assert abs(wall.distance * np.cos(wall.direction + 0.5 * np.pi) - 0.5 * WIDTH) < 0.2
    assert not moves_along(log, wall)
    assert inspect_log(log).floor is None


@pytest.mark.parametrize(
    ("world", "sensor"), [("office", "sick-lms200"), ("building", "hokuyo-270"), ("office", "spinning-360")]
)
def test_rooms_have_no_such_line(world, sensor):
    assert inspect_log(cs.simulate(world, sensor=sensor, n_scans=300, seed=3)).floor is None


def test_a_log_without_readings_has_no_floor():
    assert find_lines(np.zeros((2048, 0), dtype=np.int32), BIN, np.empty(0)) == []
    assert find_lines(np.zeros((2048, 9), dtype=np.int32), BIN, np.linspace(-1.0, 1.0, 9)) == []
    blank = cs.LaserScan(np.full(9, np.nan), angle_min=-1.0, angle_increment=0.25, range_max=10.0)
    assert inspect_log([blank, blank]).floor is None
