"""What moved: readings where an earlier scan looked through."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan import LaserScan, se2
from curvescan.mapping.dynamic import dynamic_along, dynamic_readings
from curvescan.simulation import simulate
from tests.scenes import room_ranges, room_scan

HERE = np.zeros(3)


def with_person(scan, first, last, distance):
    ranges = scan.ranges.copy()
    ranges[first:last] = distance
    return LaserScan(ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=scan.range_max)


def beams(*spans):
    mask = np.zeros(361, dtype=bool)
    for first, last in spans:
        mask[first:last] = True
    return mask


def test_what_stands_where_one_looked_through_has_moved():
    room = room_scan()
    came = with_person(room, 100, 120, 1.0)
    np.testing.assert_array_equal(dynamic_readings(came, [(room, HERE)]), beams((100, 120)))


def test_what_comes_into_view_has_not_moved():
    room = room_scan()
    left = with_person(room, 100, 120, 1.0)
    assert not dynamic_readings(room, [(left, HERE)]).any()


def test_a_person_who_moved_half_his_width_has_moved_whole():
    room = room_scan()
    before, after = with_person(room, 100, 120, 1.0), with_person(room, 110, 130, 1.0)
    np.testing.assert_array_equal(dynamic_readings(after, [(before, HERE)]), beams((110, 130)))


def test_nothing_moves_in_an_empty_room_seen_from_elsewhere():
    pose = np.array([0.3, -0.2, 0.4])
    now = room_scan(pose, sigma=0.01, seed=1)
    assert not dynamic_readings(now, [(room_scan(sigma=0.01), pose)]).any()


def test_nothing_is_known_without_earlier_scans_or_readings():
    room = room_scan()
    blank = LaserScan(np.full(361, math.nan), angle_min=room.angle_min, angle_increment=0.01)
    assert not dynamic_readings(room, []).any()
    assert not dynamic_readings(room, [(blank, HERE)]).any()
    assert not dynamic_readings(blank, [(room, HERE)]).any()


def test_an_open_field_is_free_to_the_end_of_the_range():
    angles = np.linspace(-0.5, 0.5, 101)
    field = LaserScan(np.full(101, math.inf), angle_min=-0.5, angle_increment=0.01, range_max=8.0)
    somebody = LaserScan(
        np.where(np.abs(angles) < 0.1, 3.0, math.inf), angle_min=-0.5, angle_increment=0.01, range_max=8.0
    )
    moved = dynamic_readings(somebody, [(field, HERE)])
    np.testing.assert_array_equal(moved, somebody.valid)


@pytest.mark.parametrize("start", [0.0, 1.0, -2.5])
def test_the_way_a_sensor_turns_and_where_it_starts_do_not_matter(start):
    increment = math.radians(1.0)
    angles = start + increment * np.arange(360)
    ranges = room_ranges(HERE, angles)
    came = np.where(np.abs(se2.wrap(angles)) < 0.15, 1.0, ranges)

    def scans(sign):
        return [
            LaserScan(r[::sign], angle_min=angles[::sign][0], angle_increment=sign * increment) for r in (ranges, came)
        ]

    before, after = scans(1)
    moved = dynamic_readings(after, [(before, HERE)])
    np.testing.assert_array_equal(moved, np.abs(se2.wrap(angles)) < 0.15)
    before, after = scans(-1)
    np.testing.assert_array_equal(dynamic_readings(after, [(before, HERE)])[::-1], moved)


@pytest.mark.slow
def test_walkers_are_found_in_a_building():
    log = simulate("building", n_scans=150, n_people=20, seed=3)
    found = np.array(list(dynamic_along(log, log.truth.poses, np.ones(len(log), bool))))
    right = np.count_nonzero(found & log.is_person)
    assert right / np.count_nonzero(found) > 0.95
    assert right / np.count_nonzero(log.is_person) > 0.85


def test_scans_beyond_a_failed_match_are_not_asked():
    room = room_scan()
    came = with_person(room, 100, 120, 1.0)
    poses = np.zeros((3, 3))
    told = list(dynamic_along([room, room, came], poses, np.array([False, True, True])))
    assert told[2].any()
    told = list(dynamic_along([room, room, came], poses, np.array([False, True, False])))
    assert not told[2].any()


def test_uneven_beams_tell_what_moved_too():
    keep = np.flatnonzero(np.arange(361) % 3 != 1)
    room = room_scan()
    for way in (1, -1):
        before, after = (
            LaserScan(scan.ranges[keep][::way], angles=scan.angles[keep][::way], range_max=20.0)
            for scan in (room, with_person(room, 100, 120, 1.0))
        )
        assert not before.has_uniform_angles
        np.testing.assert_array_equal(dynamic_readings(after, [(before, HERE)]), beams((100, 120))[keep][::way])


def test_a_hole_between_two_beams_was_not_looked_through():
    room = room_scan()
    keep = np.r_[0:90, 130:361]
    before = LaserScan(room.ranges[keep], angles=room.angles[keep], range_max=20.0)
    came = with_person(room, 100, 120, 1.0)
    assert not dynamic_readings(came, [(before, HERE)]).any()
