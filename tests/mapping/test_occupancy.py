"""Occupancy maps: against the slow twin, by laws, and in rooms that are known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from curvescan import LaserScan, simulate
from curvescan.errors import InvalidArgumentError, MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyBuilder, distances_from
from curvescan.mapping.run_maps import build_maps
from tests.reference.occupancy import occupancy


def beam(reading, *, angle=0.0, range_max=10.0):
    return LaserScan([reading], angle_min=angle, angle_increment=1.0, range_max=range_max)


def build(scans, poses, ignored=None, config=None):
    builder = OccupancyBuilder(config)
    for scan, pose, left_out in zip(scans, poses, ignored or [None] * len(scans), strict=True):
        builder.add(scan, pose, left_out)
    return builder.grid()


def at(grid, x, y):
    """Return the log-odds of the cell at a place."""
    i, j = np.floor((np.array([x, y]) - grid.origin) / grid.resolution).astype(int)
    return float(grid.log_odds[j, i])


# ---- against the slow twin


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("clear_no_return", [True, False])
def test_against_the_slow_twin(seed, clear_no_return):
    rng = np.random.default_rng(seed)
    config = OccupancyConfig(resolution=0.2, clear_no_return=clear_no_return)
    scans, poses, ignored = [], [], []
    for _ in range(12):
        ranges = rng.uniform(0.05, 6.0, 40)
        codes = rng.choice([np.inf, np.nan, 0.0, 81.91], 40)
        ranges = np.where(rng.random(40) < 0.3, codes, ranges)
        scans.append(LaserScan(ranges, angle_min=-2.0, angle_increment=0.1, range_min=0.1, range_max=5.0))
        poses.append(rng.uniform([-8, -8, -3], [8, 8, 3]))
        ignored.append(rng.random(40) < 0.2)
    grid = build(scans, poses, ignored, config)
    expected = occupancy(scans, poses, ignored, config)
    corner = np.round(grid.origin / config.resolution).astype(int)
    table = np.zeros(grid.log_odds.shape)
    for (i, j), value in expected.items():
        table[j - corner[1], i - corner[0]] = value
    # log-odds are kept in single precision
    np.testing.assert_allclose(grid.log_odds, table, atol=1e-5)
    assert len(expected) > 300


def test_room_that_is_made_before_changes_nothing_and_need_not_be_right():
    poses = np.array([[0.0, 0.0, 0.0], [30.0, -20.0, 1.0]])
    scans, is_joined, config = [beam(2.0), beam(3.0)], np.zeros(2, dtype=bool), OccupancyConfig()
    plain = build_maps(scans, poses, is_joined, occupancy=config).grid
    for about in ([[-5.0, -25.0], [35.0, 5.0]], [[1.0, 1.0]], [[0.0, 0.0], [1e9, 0.0]]):
        grid = build_maps(scans, poses, is_joined, occupancy=config, about=np.array(about)).grid
        np.testing.assert_array_equal(grid.log_odds, plain.log_odds)
        np.testing.assert_array_equal(grid.origin, plain.origin)


AXES = [(0.0, 1, 0), (math.pi / 2, 0, 1), (math.pi, -1, 0), (-math.pi / 2, 0, -1)]


@pytest.mark.parametrize(("angle", "dx", "dy"), AXES)
def test_beams_along_the_axes(angle, dx, dy):
    grid = build([beam(1.0, angle=angle)], [(0.025, 0.025, 0.0)])
    assert grid.log_odds.shape == ((21, 1) if dy else (1, 21))
    assert at(grid, 0.025 + dx, 0.025 + dy) > 0.0
    assert np.count_nonzero(grid.log_odds < 0.0) == 20


# ---- laws


@given(
    st.lists(st.floats(0.1, 4.0), min_size=1, max_size=20),
    st.integers(-200, 200),
    st.integers(-200, 200),
    st.floats(-3.0, 3.0),
)
def test_a_shift_by_whole_cells_shifts_the_map(ranges, i, j, theta):
    # sides and places in powers of two, so that the shift is exact
    config = OccupancyConfig(resolution=0.0625)
    scan = LaserScan(ranges, angle_min=-1.0, angle_increment=0.1)
    here = build([scan], [(0.03125, 0.03125, theta)], config=config)
    there = build([scan], [(0.03125 + i / 16, 0.03125 + j / 16, theta)], config=config)
    assume(here.log_odds.shape == there.log_odds.shape)  # else a beam ends on the side of a cell
    np.testing.assert_array_equal(here.log_odds, there.log_odds)
    np.testing.assert_allclose(there.origin - here.origin, [i / 16, j / 16])


def test_a_clockwise_scan_makes_the_map_of_its_mirror_image():
    ranges = np.linspace(1.0, 4.0, 50)
    left = LaserScan(ranges, angle_min=-1.0, angle_increment=0.04)
    right = LaserScan(ranges[::-1], angle_min=-1.0 + 49 * 0.04, angle_increment=-0.04)
    poses = [(0.01, 0.02, 0.3)]
    one, two = build([left], poses), build([right], poses)
    np.testing.assert_array_equal(one.log_odds, two.log_odds)


def test_probabilities_stay_within_their_limits_and_follow_a_change():
    config = OccupancyConfig()
    builder = OccupancyBuilder(config)
    for _ in range(50):
        builder.add(beam(1.01), np.zeros(3))
    grid = builder.grid()
    assert grid.probability.max() == pytest.approx(config.highest, abs=1e-6)
    assert grid.probability.min() == pytest.approx(config.lowest, abs=1e-6)
    for _ in range(10):  # what stood at 1 m has gone, and something stands at 2 m
        builder.add(beam(2.01), np.zeros(3))
    later = builder.grid()
    assert later.is_free[0, :40].all()
    assert later.is_occupied[0, 40]


def test_one_scan_tells_free_from_occupied_from_unknown():
    grid = build([beam(1.01, angle=0.5)], [np.zeros(3)])
    assert np.count_nonzero(grid.is_occupied) == 1
    n_free = np.count_nonzero(grid.is_free)
    assert n_free > 20
    assert np.count_nonzero(grid.log_odds == 0.0) == grid.log_odds.size - 1 - n_free
    assert (grid.probability[grid.log_odds == 0.0] == 0.5).all()
    (centre,) = grid.occupied_centres
    assert np.abs(centre - 1.01 * np.array([np.cos(0.5), np.sin(0.5)])).max() <= 0.025


# ---- readings


def test_what_moved_is_no_obstacle_but_the_way_to_it_is_free():
    grid = build([beam(1.01)], [np.zeros(3)], [np.array([True])])
    assert not grid.is_occupied.any()
    assert grid.is_free.sum() == 20
    with pytest.raises(InvalidArgumentError, match=r"one value a beam \(1\), got shape \(2,\)"):
        build([beam(1.0)], [np.zeros(3)], [np.array([True, False])])


def test_no_return_clears_and_any_other_bad_reading_does_nothing():
    grid = build([beam(math.inf, range_max=2.01)], [np.zeros(3)])
    assert grid.is_free.sum() == 41
    for reading in (math.nan, 0.0, -1.0, 2.5, 81.91, -math.inf):
        assert not build([beam(reading, range_max=2.01)], [np.zeros(3)]).log_odds.size
    for limit in (1e9, 1.7e308, math.inf):  # what no laser sees is no limit
        assert not build([beam(math.inf, range_max=limit)], [np.zeros(3)]).log_odds.size
    kept = build([beam(math.inf)], [np.zeros(3)], config=OccupancyConfig(clear_no_return=False))
    assert not kept.log_odds.size


def test_a_wall_along_which_beams_pass_stays():
    # a wall along y = 1, seen from far along it: each beam passes cells in which others end
    angles = 0.05 + 0.002 * np.arange(100)
    scan = LaserScan(1.0 / np.sin(angles), angle_min=0.05, angle_increment=0.002)
    once = build([scan], [(0.0, 0.01, 0.0)])
    assert once.is_occupied.sum() > 60
    np.testing.assert_array_equal(once.is_occupied, build([scan] * 9, [(0.0, 0.01, 0.0)] * 9).is_occupied)


def test_a_scan_without_a_pose_is_left_out():
    assert not build([beam(1.0)], [(0.0, math.nan, 0.0)]).log_odds.size
    assert not build([beam(1.0)], [(math.inf, 0.0, 0.0)]).log_odds.size


# ---- size


@pytest.mark.parametrize("far", [1e6, 1e300, 1.7e308])
def test_a_map_beyond_all_memory_is_refused_and_what_was_there_stays(far):
    builder = OccupancyBuilder()
    builder.add(beam(1.01), np.zeros(3))
    before = builder.grid()
    with pytest.raises(MapTooLargeError, match=r"1 GiB.*resolution of OccupancyConfig.*smaller range_max"):
        builder.add(beam(1.0), np.array([far, far, 0.0]))
    after = builder.grid()
    np.testing.assert_array_equal(before.log_odds, after.log_odds)
    np.testing.assert_array_equal(before.origin, after.origin)


def test_a_drive_goes_on_without_a_map_that_is_too_large():
    scans = [beam(1.0), beam(1.0), beam(1.0)]
    poses = np.array([[0.0, 0.0, 0.0], [1e7, 1e7, 0.0], [2e7, 0.0, 0.0]])
    place = build_maps(scans, poses, np.ones(3, bool), occupancy=OccupancyConfig())
    assert place.grid is None
    assert place.why_no_grid.startswith("an occupancy map may take 1 GiB")
    assert len(place.standing) == 3


def test_a_drive_without_a_reading_has_no_map():
    place = build_maps([beam(0.0)], np.zeros((1, 3)), np.ones(1, bool), occupancy=OccupancyConfig())
    assert (place.grid, place.why_no_grid) == (None, "no scan has a reading to map")
    assert build_maps([beam(1.0)], np.zeros((1, 3)), np.ones(1, bool)).grid is None


# ---- rooms


def test_occupied_cells_lie_on_the_walls_and_people_are_left_out():
    log = simulate("room", n_scans=60, n_people=2, seed=5)
    poses = log.truth.poses
    place = build_maps(log, poses, np.ones(len(log), bool), occupancy=OccupancyConfig())
    grid = place.grid
    walls = place.standing
    occupied = grid.occupied_centres
    assert len(occupied) > 200
    # every obstacle is a cell in which a reading on what stands ended, and most of what moved is none
    distance = np.abs(occupied[:, None] - walls[None]).max(axis=2).min(axis=1)
    assert distance.max() <= 1e-6
    # the way of the sensor is free
    rows_columns = np.floor((poses[:, :2] - grid.origin) / grid.resolution).astype(int)
    assert grid.is_free[rows_columns[:, 1], rows_columns[:, 0]].all()


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.01, 1.0])
def test_distances_are_those_of_the_whole_map_up_to_the_most_that_is_asked_for(share):
    """Also where the nearest wall lies in the next tile."""
    occupied = np.random.default_rng(4).random((530, 300)) < share
    whole = 0.05 * distance_transform_edt(~occupied) if occupied.any() else np.full(occupied.shape, np.inf)
    np.testing.assert_allclose(distances_from(occupied, 0.05, 1.0), np.minimum(whole, 1.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("resolution", 0.0, "resolution must be a positive number of metres, got 0.0"),
        ("resolution", math.inf, "resolution must be"),
        ("hit", 0.5, "hit must lie between 0.5 and 1"),
        ("miss", 0.5, "miss must lie between 0 and 0.5"),
        ("lowest", 0.0, "lowest must lie between 0 and 0.5"),
        ("highest", 1.0, "highest must lie between 0.5 and 1"),
        ("free_to", 0.1, r"free_to must lie above lowest \(0.12\)"),
        ("occupied_from", 0.98, r"occupied_from must be .* below highest \(0.97\)"),
    ],
)
def test_a_value_out_of_range_is_told(name, value, rule):
    with pytest.raises(InvalidArgumentError, match=rule):
        dataclasses.replace(OccupancyConfig(), **{name: value})


def test_a_pose_of_two_numbers_is_told():
    with pytest.raises(InvalidArgumentError, match=r"pose must be three numbers \[x, y, theta\], got \(0, 0\)"):
        OccupancyBuilder().add(LaserScan([1.0], angle_min=0.0, angle_increment=0.1), (0, 0))
    with pytest.raises(InvalidArgumentError, match=r"pose must be three numbers \[x, y, theta\], got array"):
        OccupancyBuilder().add(LaserScan([1.0], angle_min=0.0, angle_increment=0.1), np.zeros((3, 1)))
    with pytest.raises(InvalidArgumentError, match="scan must be a LaserScan, got list"):
        OccupancyBuilder().add([1.0], (0.0, 0.0, 0.0))


def test_readings_that_are_no_hits_may_be_named_by_a_list():
    scan, grids = LaserScan([1.0, 2.0], angle_min=0.0, angle_increment=0.1), []
    for ignored in ([True, False], np.array([True, False])):
        builder = OccupancyBuilder()
        builder.add(scan, (0.0, 0.0, 0.0), ignored)
        grids.append(builder.grid().log_odds)
    np.testing.assert_array_equal(*grids)
    with pytest.raises(InvalidArgumentError, match=r"one value a beam \(2\), got shape \(1,\)"):
        OccupancyBuilder().add(scan, (0.0, 0.0, 0.0), [True])
