"""Plain maps moved to other cells, leveled, cropped, rubbed out and joined."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import InvalidArgumentError, OccupancyConfig, OccupancyGrid, se2
from curvescan.errors import MapTooLargeError
from curvescan.mapping import grid_editing
from curvescan.mapping.map_server import read_map, write_map

WALL, OPEN = 3.0, -2.0


def room(width=6.0, height=4.0, cell=0.05, at=(1.0, -2.0)):
    """A room with walls of one cell all around, and a post."""
    n_rows, n_columns = round(height / cell), round(width / cell)
    log_odds = np.full((n_rows, n_columns), OPEN, dtype=np.float32)
    log_odds[[0, -1]] = log_odds[:, [0, -1]] = WALL
    log_odds[n_rows // 4, n_columns // 4] = WALL
    return OccupancyGrid(log_odds=log_odds, origin=np.array(at), config=OccupancyConfig(resolution=cell))


def distance_to_room(points):
    """How far points lie from the walls and the post of the room."""
    x, y = points.T - np.array([[1.025], [-1.975]])
    walls = np.minimum(np.minimum(np.abs(x), np.abs(x - 5.95)), np.minimum(np.abs(y), np.abs(y - 3.95)))
    return np.minimum(walls, np.hypot(x - 1.5, y - 1.0))


@pytest.mark.parametrize("cell", [0.02, 0.05, 0.13])
@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.013, -3.41, 0.0), (2.0, 1.0, 0.7), (0.0, 0.0, -2.5)])
def test_what_stands_in_a_map_stands_there_in_other_cells_and_where_it_is_moved_to(pose, cell):
    found = grid_editing.moved(room(), pose, cell)
    assert found.resolution == cell
    np.testing.assert_allclose(found.origin / cell, np.rint(found.origin / cell), atol=1e-6)
    # half a diagonal of an old cell and of a new one
    reach = 0.71 * (0.05 + cell)
    back = se2.transform(se2.inverse(np.array(pose)), found.occupied_centres)
    assert distance_to_room(back).max() < reach
    # no wall has a gap: each old cell has a new one within reach
    for old in se2.transform(np.array(pose), room().occupied_centres):
        assert np.hypot(*(found.occupied_centres - old).T).min() < reach
    area = found.is_free.sum() * cell**2
    assert abs(area - 5.9 * 3.9) < reach * 2 * (5.9 + 3.9)


def test_the_same_cells_are_the_same_map():
    once = grid_editing.moved(room())
    np.testing.assert_array_equal(once.log_odds, room().log_odds)
    np.testing.assert_allclose(once.origin, room().origin, atol=1e-12)


@pytest.mark.parametrize("cell", [0.05, 0.2])
@pytest.mark.parametrize("angle", [0.0, 0.3, -0.7, 0.78])
def test_walls_are_leveled_whatever_the_turn_and_the_cells(angle, cell):
    turned = grid_editing.turned(room(12.0, 8.0, cell), angle)
    # cells of a turned wall lie up to one and a half beside it, over 12 m
    assert abs(grid_editing.wall_angle(turned.occupied_centres, cell) - angle) < 1.5 * cell / 12.0
    leveled = grid_editing.leveled(turned)
    assert abs(grid_editing.wall_angle(leveled.occupied_centres, cell)) < 1.5 * cell / 12.0


def test_a_crop_keeps_the_cells_of_its_box_and_where_they_lie():
    part = grid_editing.cropped(room(), (0.0, -3.0, 3.0, 0.0))
    inside = room().occupied_centres
    inside = inside[(inside[:, 0] < 3.0) & (inside[:, 1] < 0.0)]
    np.testing.assert_allclose(part.occupied_centres, inside, atol=1e-9)
    with pytest.raises(InvalidArgumentError, match=r"no cell lies within .* the map's are from 1 -2 to 7 2"):
        grid_editing.cropped(room(), (100.0, 100.0, 101.0, 101.0))
    with pytest.raises(InvalidArgumentError, match="X0 < X1"):
        grid_editing.cropped(room(), (1.0, 0.0, 0.0, 1.0))


def test_what_is_rubbed_out_is_free_and_the_unknown_stays_unknown():
    grid = room()
    grid.log_odds[30, 40] = 0.0
    left = grid_editing.rubbed_out(grid, (1.5, -1.9, 4.0, 0.0))
    post = (20, 30)
    assert grid.is_occupied[post]
    assert left.is_free[post]
    assert left.log_odds[30, 40] == 0.0
    assert left.is_occupied.sum() == grid.is_occupied.sum() - 1


def test_two_maps_of_one_frame_are_one_that_shows_what_either_does():
    one, other = room(), grid_editing.moved(room(), (4.0, 0.0, 0.0))
    both = grid_editing.joined(one, other)
    np.testing.assert_allclose(both.origin, one.origin, atol=1e-9)
    assert both.log_odds.shape == (80, 200)
    # the walls of one stand where the other is free
    assert both.is_occupied[40, [0, 80, 119, 199]].all()
    assert both.is_free[40, [40, 100, 160]].all()
    coarse = grid_editing.joined(one, grid_editing.resampled(other, 0.1))
    assert coarse.resolution == 0.05


def test_a_map_too_fine_for_the_memory_is_refused():
    with pytest.raises(MapTooLargeError, match="choose larger cells"):
        grid_editing.resampled(room(), 1e-5)
    with pytest.raises(InvalidArgumentError, match="resolution must be a positive number of metres, got 0"):
        grid_editing.resampled(room(), 0.0)


def test_a_map_without_walls_cannot_be_leveled():
    with pytest.raises(InvalidArgumentError, match="no walls to level"):
        grid_editing.leveled(grid_editing.cropped(room(), (2.0, 0.0, 3.0, 1.0)))


def test_a_map_whose_picture_is_turned_lies_in_its_frame_as_its_file_says(tmp_path):
    write_map(tmp_path, room(at=(0.0, 0.0)))
    text = (tmp_path / "map.yaml").read_text().replace("origin: [0, 0, 0.0]", "origin: [1.0, -2.0, 0.4]")
    (tmp_path / "map.yaml").write_text(text)
    found = read_map(tmp_path / "map.yaml")
    turned = grid_editing.moved(room(at=(0.0, 0.0)), (1.0, -2.0, 0.4))
    np.testing.assert_array_equal(found.is_occupied, turned.is_occupied)
    np.testing.assert_allclose(found.origin, turned.origin)
