"""DistanceField: what a scan says of a pose is what a slow look at every cell says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.editing.operations import part_of
from curvescan.mapping import occupancy
from curvescan.slam import SlamMap
from curvescan.slam.localization.field import (
    ON_WALL_M,
    REACH_M,
    DistanceField,
    counts,
    field_of,
    fields_of,
    lasting_points,
)
from tests.slam.map_example import FILE, ROOM, lap, scans


@pytest.fixture(scope="module")
def field() -> DistanceField:
    return field_of(cs.load_map(FILE))


def _slow_agreement(field: DistanceField, points: np.ndarray, pose: np.ndarray) -> list[float]:
    """Return the shares by looking at a beam every millimetre."""
    n_rows, n_columns = field.distance.shape

    def cell(place: np.ndarray) -> tuple[float, bool] | None:
        column, row = np.floor((place - field.origin) / field.resolution).astype(int)
        inside = 0 <= row < n_rows and 0 <= column < n_columns
        return (float(field.distance[row, column]), bool(field.is_free[row, column])) if inside else None

    counts = np.zeros(3)
    for end in se2.transform(pose, points):
        found = cell(end)
        if found and found[0] <= ON_WALL_M:
            counts[0] += 1
        elif found and found[1] and found[0] > 2.0 * ON_WALL_M:
            counts[1] += 1
        reach = float(np.hypot(*(end - pose[:2])))
        ways = np.arange(0.0, max(reach - REACH_M, 0.0), 0.001)
        beam = pose[:2] + ways[:, np.newaxis] * (end - pose[:2]) / reach
        columns, rows = np.floor((beam - field.origin) / field.resolution).astype(int).T
        inside = (columns >= 0) & (columns < n_columns) & (rows >= 0) & (rows < n_rows)
        counts[2] += field.is_solid[rows[inside], columns[inside]].any()
    return (counts / len(points)).tolist()


def test_a_scan_agrees_with_where_it_was_taken_and_not_with_elsewhere(field: DistanceField) -> None:
    poses = lap()[[12, 70, 120]]
    for pose, scan in zip(se2.between(lap()[0], poses), scans(poses, seed=3), strict=True):
        points = scan.points[scan.valid]
        assert field.agreement(points, pose) > 0.9
        assert field.agreement(points, se2.compose(pose, [0.6, 0.5, 2.0])) < 0.5


def test_the_shares_are_those_of_a_slow_look(field: DistanceField) -> None:
    rng = np.random.default_rng(2)
    scan = scans(lap()[40:41], seed=5)[0]
    points = np.ascontiguousarray(scan.points[scan.valid][::6])
    for _ in range(8):
        pose = np.array([*rng.uniform(-3, 3, 2), rng.uniform(-3, 3)])
        found = np.array(counts(field, points, pose)) / len(points)
        slow = _slow_agreement(field, points, pose)
        assert found[:2] == pytest.approx(slow[:2], abs=1e-12)
        # steps of two thirds of a cell miss some beams that only cut a corner of a wall's cell, and see no others
        assert slow[2] - 0.08 <= found[2] <= slow[2] + 1.1 / len(points)


def test_a_sensor_can_be_where_it_is_free_and_clear_of_walls(field: DistanceField) -> None:
    places = field.places(0.3, 0.15)
    in_world = se2.transform(lap()[0], places)
    assert len(places) > 200
    inside = (in_world > [0.0, 0.0]).all(1) & (in_world < [9.0, 7.0]).all(1)
    assert inside.mean() > 0.97
    pillars = np.hypot(*(in_world[:, np.newaxis] - ROOM.circles[:, :2]).transpose(2, 0, 1))
    assert (pillars > ROOM.circles[:, 2]).all()


def _ring_map(*rings: np.ndarray) -> SlamMap:
    """Return a map of keyframes at one place, by their 360 ranges."""
    n = len(rings)
    scans = tuple(cs.LaserScan(r, angle_min=-np.pi, angle_increment=np.pi / 180.0, range_max=8.0) for r in rings)
    return SlamMap(
        scans=scans,
        poses=np.zeros((n, 3)),
        covariances=np.zeros((n, 3, 3)),
        indices=np.arange(n),
        sessions=np.zeros(n, dtype=np.int64),
        ends=np.empty((0, 2), dtype=np.int64),
        measured=np.empty((0, 3)),
        edge_covariances=np.empty((0, 3, 3)),
        kinds=np.empty(0, dtype=np.int64),
        weights=np.empty(0),
    )


def test_beams_of_which_nothing_came_back_wear_no_wall_away() -> None:
    wall, nothing = np.full(360, 3.0), np.full(360, np.inf)
    half = np.where(np.arange(360) < 180, wall, nothing)
    field = field_of(_ring_map(wall, half, half, half, nothing, nothing))
    points = _ring_map(wall).scans[0].points
    assert counts(field, points, np.zeros(3)) == (len(points), 0, 0)


def test_what_most_beams_pass_is_a_wall_and_not_solid() -> None:
    near, far = np.full(360, 2.0), np.full(360, 3.0)
    field = field_of(_ring_map(near, near, far, far, far, far))
    points = _ring_map(near, far).scans
    assert counts(field, points[0].points, np.zeros(3)) == (360, 0, 0)
    assert counts(field, points[1].points, np.zeros(3))[2] < 0.05 * 360
    # what stood there once, and a hundred looks found gone, is no wall
    field = field_of(_ring_map(near, *[far] * 100))
    assert counts(field, points[0].points, np.zeros(3))[0] < 0.05 * 360


def test_the_fields_of_a_map_as_it_grew_are_those_of_its_parts() -> None:
    stored = cs.load_map(FILE)
    numbers = [1, 3, 3, len(stored)]
    for n, grown in zip(numbers, fields_of(stored, numbers), strict=True):
        alone = field_of(part_of(stored, np.arange(n)))
        assert all(np.array_equal(one, other) for one, other in zip(grown, alone, strict=True))


def test_a_map_that_is_too_large_has_larger_cells_from_the_keyframe_on_that_makes_it_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    near = _ring_map(np.full(360, 2.0), np.full(360, 2.0))
    far = replace(near, poses=np.array([[0.0, 0.0, 0.0], [50.0, 50.0, 0.0]]))
    monkeypatch.setattr(occupancy, "MAX_BYTES", 1 << 20)  # 23 m by 23 m in cells of 5 cm
    one, both = fields_of(far, [1, 2])
    assert (one.resolution, both.resolution) == (0.05, 0.2)
    assert all(np.array_equal(*pair) for pair in zip(both, field_of(far), strict=True))


@pytest.mark.parametrize("way", [1, -1])
def test_people_in_the_open_say_nothing_of_a_building(way: int) -> None:
    ranges = np.full(181, 4.0)
    ranges[:20] = 1.0  # how far what stands at the edge of the view goes on is not known
    ranges[80:90] = 2.0  # somebody, 0.35 m wide
    ranges[110:150] = 2.5  # a cupboard of 1.8 m
    ranges[165:168] = 3.8  # a jamb, as good as in the wall
    ranges[60] = np.nan
    scan = cs.LaserScan(ranges, angle_min=-way * np.pi / 2.0, angle_increment=way * np.pi / 180.0, range_max=8.0)
    shown = np.ones(181, dtype=np.bool_)
    shown[[60, *range(80, 90)]] = False
    assert np.array_equal(lasting_points(scan), scan.points[shown])
    nothing = cs.LaserScan(np.full(181, np.nan), angle_min=-1.5, angle_increment=0.02, range_max=8.0)
    assert lasting_points(nothing).shape == (0, 2)
