"""Figures and result folders: what is in them, not how they look."""

from __future__ import annotations

import csv
import hashlib
import json
import math

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

import curvescan as cs
from curvescan.configs import as_plain
from curvescan.evaluation.reference import reference_errors
from curvescan.io import Trajectory, read_csv, read_poses, read_tum
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupied_cells import occupied_cells
from curvescan.mapping.run_maps import RunMaps
from curvescan.matchers import MATCHERS
from curvescan.matchers.cfsma.config import CfSmaConfig, LandmarksConfig
from curvescan.plots.colours import FAILED, GREY
from curvescan.plots.evaluation import draw_reference_errors
from curvescan.plots.map import as_place, draw_cells, draw_graph, draw_map, drawing, drawing_places
from curvescan.plots.match import save_match
from curvescan.simulation import simulate
from tests.runs.test_run import FILES
from tests.scenes import room_scan

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def log():
    return simulate("room", n_scans=6, seed=3)


def save(folder, log, **kwargs):
    return cs.run(log, out=folder, method="cfsma", **kwargs)


def test_a_run_is_written_whole(tmp_path, log):
    run = save(tmp_path, log, command=["curvescan", "odometry"], truth=log.truth.poses)
    assert sorted(p.name for p in tmp_path.iterdir()) == list(FILES)
    assert (tmp_path / "map.png").read_bytes().startswith(PNG)
    assert (tmp_path / "occupancy.png").read_bytes().startswith(PNG)
    assert (tmp_path / "map.pgm").read_bytes().startswith(b"P5\n")
    assert "image: map.pgm\n" in (tmp_path / "map.yaml").read_text()
    trajectory, outcomes = read_csv(tmp_path / "trajectory.csv")
    np.testing.assert_array_equal(trajectory.poses, run.trajectory.poses)
    np.testing.assert_array_equal(trajectory.covariances, run.trajectory.covariances)
    assert outcomes[0] == "started"
    tum = read_tum(tmp_path / "trajectory.tum")
    np.testing.assert_array_equal(tum.stamps, run.trajectory.stamps)
    with (tmp_path / "trajectory.csv").open() as file:
        assert len(list(csv.reader(file))) == 7


def test_run_json_holds_what_a_repeat_needs(tmp_path, log):
    source = tmp_path / "source.log"
    source.write_bytes(b"scans")
    run = save(tmp_path, log, command=["curvescan", "odometry", "source.log"], source=source)
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["curvescan"] == cs.__version__
    assert record["command"] == ["curvescan", "odometry", "source.log"]
    assert record["input"]["bytes"] == 5
    assert record["input"]["sha256"] == hashlib.sha256(b"scans").hexdigest()
    assert record["config"]["cfsma"]["landmarks"]["n_neighbours"] == 30
    assert sum(record["outcomes"].values()) == record["scans"] == 6
    assert sum(f["count"] for f in record["failures"].values()) == sum(run.record.failures.values())
    assert record["is_partial"] is False
    assert record["occupancy"]["resolution"] == 0.05
    assert record["left_out"] == []


def test_a_run_without_a_map_says_so_and_keeps_the_rest(tmp_path, log):
    (remark,) = save(tmp_path, log, occupancy=OccupancyConfig(resolution=1e-5)).left_out
    assert remark.startswith("no occupancy map: an occupancy map may take 1 GiB")
    assert not (tmp_path / "map.yaml").exists()
    assert not (tmp_path / "occupancy.png").exists()
    assert len((tmp_path / "trajectory.tum").read_text().splitlines()) == 6
    assert json.loads((tmp_path / "run.json").read_text())["left_out"] == [remark]


def test_a_partial_run_says_so(tmp_path, log):
    class Interrupting:
        n = 0

        def begin(self, stage, n_steps):
            pass

        def advance(self):
            self.n += 1
            if self.n == 2:
                raise KeyboardInterrupt

    save(tmp_path, log, display=Interrupting())
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["is_partial"] is True
    assert record["scans"] == 2
    assert len((tmp_path / "trajectory.tum").read_text().splitlines()) == 2


def test_cells_hold_each_point_once_whatever_the_number_of_scans():
    scans = [room_scan()] * 3
    once = occupied_cells(scans[:1], np.zeros((1, 3)), cell=0.1)
    often = occupied_cells(scans, np.zeros((3, 3)), cell=0.1)
    np.testing.assert_array_equal(once, often)
    assert len(np.unique(often, axis=0)) == len(often)
    points = scans[0].points
    nearest = np.abs(points[:, None] - often[None]).max(axis=2).min(axis=1)
    assert nearest.max() <= 0.05 + 1e-9


def test_cells_leave_out_scans_without_a_pose():
    poses = np.array([[0.0, 0.0, 0.0], [math.nan] * 3])
    cells = occupied_cells([room_scan(), room_scan((1.0, 0.0, 0.0))], poses)
    np.testing.assert_array_equal(cells, occupied_cells([room_scan()], poses[:1]))
    with pytest.raises(cs.InvalidArgumentError, match="cell must be > 0 m, got 0"):
        occupied_cells([], poses, cell=0.0)


@pytest.mark.parametrize("min_similarity", [0.2, 1.0])
def test_a_match_is_drawn_whether_or_not_it_found_a_pose(tmp_path, min_similarity):
    config = CfSmaConfig(landmarks=LandmarksConfig(min_similarity=min_similarity))
    scan = room_scan(sigma=0.01)
    result = cs.match(scan, scan, method="cfsma", config=config)
    assert result.ok is (min_similarity < 1.0)
    save_match(tmp_path, result, scans=(scan, scan), names=("one", "two"), cfsma=config)
    for name in ("segments.png", "curvature.png", "matched.png"):
        assert (tmp_path / name).read_bytes().startswith(PNG)
    record = json.loads((tmp_path / "match.json").read_text())
    assert record["outcome"] == result.outcome.name.lower()
    assert sum(record["readings_current"].values()) == 361
    if result.ok:
        np.testing.assert_array_equal(record["pose"], result.pose)
        np.testing.assert_array_equal(record["covariance"], result.covariance)
    else:
        assert record["pose"] is None


@pytest.mark.parametrize("method", sorted(set(MATCHERS) - {"cfsma"}))
def test_a_match_of_any_method_is_drawn(tmp_path, method):
    scan = room_scan(sigma=0.01)
    result = cs.match(scan, scan, method=method)
    save_match(tmp_path, result, scans=(scan, scan), names=("one", "two"), cfsma=CfSmaConfig())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["curvature.png", "match.json", "matched.png", "segments.png"]
    assert (tmp_path / "matched.png").read_bytes().startswith(PNG)
    assert json.loads((tmp_path / "match.json").read_text())["method"] == method


def test_configurations_become_plain_values():
    plain = as_plain(CfSmaConfig())
    assert json.loads(json.dumps(plain)) == plain
    assert as_plain((cs.Outcome.MATCHED, {"a": 1})) == ["matched", {"a": 1}]


@pytest.mark.parametrize("name", ["a$b$x_{", "bad\udcff", "esc\x1b[31m", "\u30b9\u30ad\u30e3\u30f3"])
def test_the_name_of_a_log_is_no_formula_and_no_warning(tmp_path, name):
    with drawing(tmp_path / "a.png", 2.0, 2.0) as figure:
        as_place(figure.subplots(), f"{name}: 3 scans")
    assert (tmp_path / "a.png").stat().st_size > 1000


@pytest.fixture
def drawn(monkeypatch):
    """Collect title, legend and axes of each figure that is saved, by the name of its file."""
    figures = {}

    def save(figure, path, **_):
        labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        figures[path.name] = ([axes.get_title() for axes in figure.axes], labels, figure.axes)

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", save)
    return figures


def test_the_map_of_a_localization_names_what_it_shows(tmp_path, log, drawn):
    slam_map = cs.run(log, engine="slam").map
    for name, scans in (("found", log), ("lost", [cs.LaserScan([1.0] * 8, angle_min=0.0, angle_increment=0.1)] * 2)):
        drawn.clear()
        record = cs.localize(scans, map=slam_map).record
        maps = RunMaps(standing=slam_map.occupancy().occupied_centres, moved=np.empty((0, 2)))
        draw_map(tmp_path / "map.png", record, maps, title="log")
        [title], labels, _ = drawn["map.png"]
        if name == "found":
            assert (title, labels) == ("log", ["saved map", "path in the saved map", "start", "end"])
        else:
            assert (title, labels) == ("log: not found in the map", ["saved map"])


def test_cells_are_drawn_as_large_as_they_are(tmp_path, drawn):
    for metres in (1.0, 4.0, 16.0):
        points = np.array([[0.0, 0.0], [metres, metres]])
        with drawing_places(tmp_path / "a.png", points) as [axes]:
            as_place(axes)
            draw_cells(axes, points, GREY, "cells")
        [axes] = drawn["a.png"][2]
        size = axes.get_window_extent().width / axes.figure.dpi * 72.0 * 0.05 / np.ptp(axes.get_xlim())
        # so that cells side by side touch, though marks snap to pixels of half a point
        assert size <= axes.lines[0].get_markersize() <= 1.2 * size + 0.6


def test_the_graph_names_its_keyframes_and_its_cells(tmp_path, log, drawn):
    slam_map = cs.run(log, engine="slam").map
    draw_graph(tmp_path / "graph.png", slam_map, np.ones((1, 2)), np.empty((0, 2)), title="graph")
    labels = drawn["graph.png"][1]
    assert {"map from scan matching", f"keyframes ({len(slam_map)})"} <= set(labels)


def test_curvature_is_that_of_cfsma_whatever_the_method(tmp_path, drawn):
    scan = room_scan(sigma=0.01)
    save_match(tmp_path, cs.match(scan, scan), scans=(scan, scan), names=("one", "two"), cfsma=CfSmaConfig())
    assert drawn["curvature.png"][0] == ["one: CF-SMA", "two: CF-SMA"]


def test_the_median_of_errors_has_a_unit(tmp_path, drawn):
    log = simulate("room", n_scans=30, seed=3)
    run = cs.run(log)
    cs.write_tum(tmp_path / "truth.tum", Trajectory(stamps=run.trajectory.stamps, poses=log.truth.poses))
    errors = reference_errors(run.trajectory, read_poses(tmp_path / "truth.tum"))
    draw_reference_errors(tmp_path / "errors.png", errors)
    titles = drawn["errors.png"][0]
    assert [title.rsplit(" ", 1)[1] for title in titles if "median" in title] == ["m", "deg"]


def test_the_graph_marks_where_matches_contradict_the_map(tmp_path, log):
    slam_map = cs.run(log, engine="slam").map
    colour, counts = to_rgb(FAILED), []
    for k, refused in enumerate((np.empty((0, 2)), np.array([[0.5, 0.5]]))):
        draw_graph(tmp_path / f"{k}.png", slam_map, np.zeros((1, 2)), refused, title="graph")
        counts.append(int((np.abs(imread(tmp_path / f"{k}.png")[..., :3] - colour).max(axis=-1) < 0.02).sum()))
    assert counts[0] == 0
    assert counts[1] > 50
