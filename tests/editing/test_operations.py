"""Maps turned, cropped, rubbed out, compared and merged."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from curvescan import InvalidArgumentError, LaserScan, OccupancyConfig, OccupancyGrid, load_map, se2, simulate
from curvescan.cli.main import run
from curvescan.editing import merging, operations
from curvescan.editing.edits import Edit, edited
from curvescan.editing.merging import merged
from curvescan.io.writing import write_pcd, write_ply
from curvescan.mapping import grid_editing
from curvescan.mapping.grid_editing import wall_angle
from curvescan.mapping.map_server import read_map, write_map
from curvescan.simulation import build_world
from curvescan.slam.pose_graph.graph import EdgeKind
from tests.editing.ring import N, ring


def in_a_hall():
    """The ring, its keyframes in a hall of 20 m by 16 m, which turns with the map."""
    slam_map, truth = ring()
    angles = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    scans = []
    for x, y, theta in truth:
        c, s = np.cos(angles + theta), np.sin(angles + theta)
        across = np.where(c > 0.0, 14.0 - x, x + 6.0) / np.maximum(np.abs(c), 1e-9)
        along = np.where(s > 0.0, 12.0 - y, y + 4.0) / np.maximum(np.abs(s), 1e-9)
        ranges = np.minimum(across, along)
        scans.append(LaserScan(ranges, angle_min=-np.pi, angle_increment=np.pi / 180, range_max=40.0))
    return replace(slam_map, scans=tuple(scans), poses=truth)


@pytest.mark.parametrize("angle", [0.3, -0.7, 0.0])
def test_walls_are_leveled_whatever_the_turn(angle):
    turned = operations.turned(in_a_hall(), angle)
    # the walls are exact: what is left is the width of a bin
    assert abs(wall_angle(operations.map_points(turned)) - angle) < 0.002
    assert abs(wall_angle(operations.map_points(operations.leveled(turned)))) < 0.002
    back = operations.turned(turned, -angle)
    np.testing.assert_allclose(se2.between(in_a_hall().poses, back.poses), 0.0, atol=1e-12)


def test_a_map_that_is_changed_keeps_how_its_occupancy_is_made():
    config = OccupancyConfig(resolution=0.2, highest=0.9)
    hall = in_a_hall()
    hall = replace(hall, grid=hall.occupancy(config))
    box = (-1.0, -1.0, 4.0, 4.0)
    for changed in (
        operations.turned(hall, 0.3),
        operations.cropped(hall, box),
        operations.rubbed_out(hall, box),
        edited(hall, [Edit(do="pin", i=3, j=3)]),
    ):
        assert changed.occupancy().config == config
    assert operations.resampled(hall, 0.1).occupancy().config == replace(config, resolution=0.1)


def test_a_map_without_walls_cannot_be_leveled():
    with pytest.raises(InvalidArgumentError, match="no walls"):
        operations.leveled(operations.rubbed_out(in_a_hall(), (-50.0, -50.0, 50.0, 50.0)))


def test_what_lies_outside_a_crop_is_gone_and_so_are_its_edges():
    hall = in_a_hall()
    part = operations.cropped(hall, (-1.0, -1.0, 4.0, 4.0))
    inside = (hall.poses[:, 0] <= 4.0) & (hall.poses[:, 1] <= 4.0)
    assert 0 < len(part) == inside.sum() < N
    assert part.ends.max() < len(part)
    points = operations.map_points(part)
    assert (np.abs(points - 1.5) <= 2.5).all()
    with pytest.raises(InvalidArgumentError, match="no keyframe lies within"):
        operations.cropped(hall, (100.0, 100.0, 101.0, 101.0))
    with pytest.raises(InvalidArgumentError, match="X0 < X1"):
        operations.cropped(hall, (1.0, 0.0, 0.0, 1.0))


def test_what_is_rubbed_out_is_gone_and_the_rest_stays():
    hall = in_a_hall()
    points = operations.map_points(hall)
    wall = (13.5, -5.0, 14.5, 13.0)
    left = operations.map_points(operations.rubbed_out(hall, wall))
    assert len(left) == (points[:, 0] < 13.5).sum() < len(points)


def test_cells_have_the_size_that_was_asked_for():
    assert operations.resampled(in_a_hall(), 0.2).grid.resolution == 0.2


def grid_of(occupied, n=200):
    log_odds = np.full((n, n), -1.0, dtype=np.float32)
    for row, column, size in occupied:
        log_odds[row : row + size, column : column + size] = 2.0
    return OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), config=OccupancyConfig())


def test_changes_are_what_was_moved_and_nothing_else():
    rng = np.random.default_rng(0)
    places = [(20 * i + 6, 20 * j + 6, int(rng.integers(3, 9))) for i in range(10) for j in range(10)]
    gone, new = {3, 50, 77}, {10, 42}
    before = grid_of([p for k, p in enumerate(places) if k not in new])
    shifted = [(r + 1, c - 1, s) for k, (r, c, s) in enumerate(places) if k not in gone]  # maps differ by a cell
    found = operations.changes(before, grid_of(shifted))
    for kind, numbers in (("gone", gone), ("appeared", new)):
        centres = {
            (round(20 * (c.box[1] + c.box[3])) / 40, round(20 * (c.box[0] + c.box[2])) / 40)
            for c in found
            if c.kind == kind
        }
        assert len(centres) == len(numbers)
        for k in numbers:
            row, column, size = places[k]
            assert min(abs(y - 0.05 * (row + size / 2)) + abs(x - 0.05 * (column + size / 2)) for y, x in centres) < 0.2
    assert operations.changes(before, before) == []
    finer = grid_editing.resampled(grid_of(shifted), 0.025)  # in cells of another size what changed is the same
    assert {c.kind for c in operations.changes(before, finer)} == {"gone", "appeared"}
    assert operations.changes(before, grid_editing.resampled(before, 0.025)) == []


def test_points_are_written_as_others_read_them(tmp_path):
    points = np.array([[1.0, 2.0], [-3.5, 0.25]])
    for write, end in ((write_ply, b"end_header\n"), (write_pcd, b"DATA binary\n")):
        write(tmp_path / "points", points)
        header, _, body = (tmp_path / "points").read_bytes().partition(end)
        assert b"2" in header
        np.testing.assert_array_equal(np.frombuffer(body, "<f4").reshape(2, 3), [[1, 2, 0], [-3.5, 0.25, 0]])


def test_the_command_does_it_all_into_one_folder(tmp_path, capsys):
    in_a_hall().save(tmp_path / "hall.csmap")
    out = tmp_path / "out"
    flags = ["--level", "--turn", "30", "--points", "ply", "pcd", "--export", "kitti", "g2o", "mcap"]
    assert run(["map", str(tmp_path / "hall.csmap"), "--out", str(out), *flags, "--rub-out", "0", "0", "1", "1"]) == 0
    names = {path.name for path in out.iterdir()}
    assert {
        "map.csmap",
        "map.pgm",
        "map.yaml",
        "points.ply",
        "points.pcd",
        "trajectory.kitti",
        "graph.g2o",
        "run.mcap",
    } <= names
    assert len(load_map(out / "map.csmap")) == N
    compared = ["--compare", str(out / "map.csmap"), "--out", str(tmp_path / "compared")]
    assert run(["map", str(out / "map.csmap"), *compared]) == 0
    assert (tmp_path / "compared" / "changes.csv").read_text().splitlines() == [
        "kind,x_min,y_min,x_max,y_max,square_metres"
    ]
    assert (tmp_path / "compared" / "changes.png").exists()


def from_log(log, rows):
    """A map of some scans where the simulation had them, in the frame of its first."""
    slam_map, _ = ring()
    rows = np.asarray(rows)
    poses = se2.between(log.truth.poses[rows[0]], log.truth.poses[rows])
    n = len(rows)
    ends = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    return replace(
        slam_map, scans=tuple(log[k] for k in rows.tolist()), poses=poses, covariances=slam_map.covariances[:n],
        indices=np.arange(n), sessions=np.zeros(n, dtype=np.int64), ends=ends,
        measured=se2.between(poses[:-1], poses[1:]), edge_covariances=slam_map.edge_covariances[: n - 1],
        kinds=slam_map.kinds[: n - 1], weights=np.ones(n - 1),
    )  # fmt: skip


@pytest.mark.slow
def test_maps_of_one_building_are_joined_where_they_belong_and_of_two_are_refused():
    log = simulate("office-floor", sensor="spinning-360", n_scans=260)
    one, other = from_log(log, range(0, 240, 10)), from_log(log, range(125, 260, 9))
    both = merged(one, operations.turned(other, 1.0))
    truth = se2.between(log.truth.poses[0], log.truth.poses[np.r_[0:240:10, 125:260:9]])
    # the scans' own noise: closures of a centimetre or two
    np.testing.assert_allclose(both.poses[:, :2], truth[:, :2], atol=0.05)
    assert both.n_sessions == 2
    elsewhere = simulate("office-floor", sensor="spinning-360", n_scans=240, seed=5)
    with pytest.raises(InvalidArgumentError, match="nothing joins the two maps"):
        merged(one, from_log(elsewhere, range(0, 240, 10)))


def test_maps_that_bend_are_joined_by_far_matches_once_near_ones_have_joined_them(monkeypatch):
    straight, truth = ring()
    one = replace(straight, poses=truth)
    # the other one drifts by 0.23 degrees a keyframe: a metre at its end
    steps = se2.between(truth[:-1], truth[1:]) + np.array([0.0, 0.0, 0.004])
    poses = [truth[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    along = straight.kinds == int(EdgeKind.MATCH)
    other = replace(
        one, poses=np.array(poses), measured=steps, ends=one.ends[along], kinds=one.kinds[along],
        edge_covariances=10.0 * one.edge_covariances[along], weights=one.weights[along],
    )  # fmt: skip
    pairs = np.array([(k, k) for k in (*range(15), *range(15, N, 8))])
    sigma = np.tile(1e-5 * np.eye(3), (len(pairs), 1, 1))
    monkeypatch.setattr(merging, "_matches", lambda *_: (pairs, np.zeros((len(pairs), 3)), sigma, np.ones(len(pairs))))
    far = np.hypot(*(other.poses - truth)[:, :2].T)
    assert far.max() > 1.0
    both = merging.merged(one, other)
    np.testing.assert_allclose(both.poses[N:, :2], both.poses[:N, :2], atol=0.1)
    before, after = merging.in_one_frame(one, other)
    np.testing.assert_array_equal(np.concatenate([before.poses, after.poses]), both.poses)
    assert len(before.ends) == len(one.ends)


def two_halves_of_a_floor():
    """Plain maps of two parts of one floor, as long beams show them; the second in a frame of its own."""
    world = build_world("office-floor", 3)
    low, high = world.boxes[:, :2].min(axis=0) - 1.0, world.boxes[:, :2].max(axis=0) + 1.0
    cell = 0.05
    xs, ys = (np.arange(a, b, cell) for a, b in zip(low, high, strict=True))
    away = np.array([world.distance(np.column_stack((xs, np.full(len(xs), y)))) for y in ys])
    log_odds = np.where(np.abs(away) < 0.5 * cell, 3.0, -2.0).astype(np.float32)
    whole = OccupancyGrid(log_odds=log_odds, origin=np.array([xs[0], ys[0]]), config=OccupancyConfig())
    x = np.linspace(low[0], high[0], 5)
    left = grid_editing.cropped(whole, (x[0], low[1], x[3], high[1]))
    right = grid_editing.cropped(whole, (x[1], low[1], x[4], high[1]))
    return whole, left, grid_editing.moved(right, (3.0, -20.0, 1.0))


def test_a_place_is_another_from_twice_as_far_on_as_maps_bend():
    """Six matches agree; four others lay the map 0.7 m on, where some agree with both, or 1.1 m on."""
    at = np.array([0.0] * 6 + [0.7] * 4)
    places = np.stack([at, np.zeros(10), np.zeros(10)], axis=1)
    assert merging._agreed(places, np.arange(10), np.ones(10)).tolist() == [True] * 6 + [False] * 4
    with pytest.raises(InvalidArgumentError, match=r"6 keyframes match .* 4 on another place"):
        merging._agreed(places * [1.1 / 0.7, 1.0, 1.0], np.arange(10), np.ones(10))
    with pytest.raises(InvalidArgumentError, match=r"0 keyframes match .* 0 on another place"):
        merging._agreed(places[:0], np.arange(0), np.ones(0))


@pytest.mark.slow
def test_plain_maps_are_merged_by_command_and_refused_where_nothing_joins_them(tmp_path, capsys):
    whole, left, right = two_halves_of_a_floor()
    for name, grid in (("left", left), ("right", right)):
        write_map(tmp_path, grid, name)
    flags = [str(tmp_path / "left.yaml"), "--merge", str(tmp_path / "right.yaml"), "--out", str(tmp_path / "out")]
    assert run(["map", *flags]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"map.pgm", "map.yaml"}
    both = read_map(tmp_path / "out" / "map.yaml")
    off = cKDTree(whole.occupied_centres).query(both.occupied_centres)[0]
    assert np.quantile(off, 0.95) < 0.1  # two cells
    missed = cKDTree(both.occupied_centres).query(whole.occupied_centres)[0]
    assert np.quantile(missed, 0.95) < 0.1
    in_a_hall().save(tmp_path / "hall.csmap")
    assert run(["map", str(tmp_path / "left.yaml"), "--merge", str(tmp_path / "hall.csmap")]) == 1
    assert "nothing joins the two maps" in capsys.readouterr().err


def test_the_command_changes_a_plain_map(tmp_path, capsys):
    grid = in_a_hall().occupancy()
    write_map(tmp_path, grid, "hall")
    for k, file in enumerate(("hall.yaml", "hall.pgm")):
        out = tmp_path / f"out{k}"
        flags = ["--turn", "20", "--level", "--crop", "-3", "-3", "20", "20", "--rub-out", "13", "-5", "14.5", "5"]
        flags += ["--resolution", "0.1", "--points", "ply", "pcd", "--compare", str(tmp_path / "hall.yaml")]
        assert run(["map", str(tmp_path / file), *flags, "--out", str(out)]) == 0
        names = {path.name for path in out.iterdir()}
        assert names == {"map.pgm", "map.yaml", "points.ply", "points.pcd", "changes.csv", "changes.png"}
        found = read_map(out / "map.yaml")
        assert found.resolution == 0.1
        # a turn of 20 deg and back; the wall at x = 14 m is gone up to y = 5 m, and free
        centres = found.occupied_centres
        assert not (centres[:, 1] < 4.8).any()
        assert centres[centres[:, 1] > 5.3, 0].max() > 13.8
        lines = (out / "changes.csv").read_text().splitlines()
        assert any(line.startswith("appeared,1") for line in lines)  # in the later map the wall stands
    assert "cells of 0.1 m" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (["--export", "kitti", "g2o"], "has none, got --export kitti g2o: give the map.csmap"),
        (["--crop", "90", "90", "91", "91"], "no cell lies within"),
        (["--resolution", "0"], "resolution must be a positive number of metres, got 0"),
        (["--resolution", "1e-6"], "choose larger cells"),
        (["--merge", "none.yaml"], "cannot be read: none.yaml"),
    ],
)
def test_what_cannot_be_done_to_a_plain_map_is_told(tmp_path, capsys, flags, sentence):
    write_map(tmp_path, in_a_hall().occupancy(), "hall")
    out = tmp_path / "out"
    assert run(["map", str(tmp_path / "hall.yaml"), *flags, "--out", str(out)]) == 1
    assert sentence in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
