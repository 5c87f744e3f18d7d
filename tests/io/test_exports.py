"""KITTI rows, pose graphs and MCAP of a run, read again by others' readers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from curvescan import se2
from curvescan.cli.main import run
from curvescan.engines import run_engine
from curvescan.errors import InvalidArgumentError, OutputError
from curvescan.io import log_from_arrays, read_log, write_log, write_tum
from curvescan.io.ros.writing.bags import write_odometry_mcap
from curvescan.io.trajectories.layouts import write_kitti
from curvescan.io.trajectories.relations import information_of, write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.io.writing import EXPORTS, ExportName, RunData, takes_edges, write_exports
from curvescan.odometry import Odometry, Step, StepOutcome
from curvescan.runs import run as runner
from curvescan.runs.graph_files import GUESS_SIGMAS, edges_of
from curvescan.simulation import simulate
from curvescan.types import PoseEdge
from tests.logs import assert_same_scan, rich_log
from tests.scenes import room_scan


def random_cov(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(3, 3)) * [0.1, 0.02, 0.01]
    return root @ root.T + 1e-8 * np.eye(3)


def trajectory(n: int = 8, *, gap: int | None = None) -> Trajectory:
    rng = np.random.default_rng(3)
    poses = rng.uniform(-3, 3, (n, 3))
    covs = np.array([random_cov(rng) for _ in range(n)])
    if gap is not None:
        poses[gap] = np.nan
    return Trajectory(stamps=100.0 + 0.1 * np.arange(n), poses=poses, covariances=covs)


def edges_along(poses: np.ndarray) -> list[PoseEdge]:
    rng = np.random.default_rng(4)
    pairs = [(i, i + 1) for i in range(len(poses) - 1)]
    return [PoseEdge(i=i, j=j, pose=se2.between(poses[i], poses[j]), covariance=random_cov(rng)) for i, j in pairs]


# ---- KITTI, and TUM, by evo


def test_kitti_rows_are_the_matrices(tmp_path: Path) -> None:
    path = trajectory(gap=2)
    write_kitti(tmp_path / "a", path)
    rows = np.loadtxt(tmp_path / "a")
    assert rows.shape == (8, 12)
    matrices = rows.reshape(-1, 3, 4)
    np.testing.assert_array_equal(matrices[:, :2, 3], path.poses[:, :2])
    np.testing.assert_allclose(np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]), path.poses[:, 2])
    np.testing.assert_array_equal(matrices[:, 2], np.tile([0.0, 0.0, 1.0, 0.0], (8, 1)))


@pytest.mark.filterwarnings("default")  # of evo's own packages
def test_evo_reads_tum_and_kitti_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))  # where evo makes a folder of its own on import
    file_interface = pytest.importorskip(
        "evo.tools.file_interface", reason="evo is not installed: pip install curvescan[evo]"
    )
    path = trajectory()
    write_tum(tmp_path / "a.tum", path)
    write_kitti(tmp_path / "a.kitti", path)
    tum = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "a.kitti")
    np.testing.assert_array_equal(tum.timestamps, path.stamps)
    cos, sin = np.cos(path.poses[:, 2]), np.sin(path.poses[:, 2])
    for k, (a, b) in enumerate(zip(tum.poses_se3, kitti.poses_se3, strict=True)):
        expected = np.eye(4)
        expected[:2, :2] = [[cos[k], -sin[k]], [sin[k], cos[k]]]
        expected[:2, 3] = path.poses[k, :2]
        np.testing.assert_allclose(a, expected, atol=1e-12)
        np.testing.assert_allclose(b, expected, atol=1e-12)


# ---- g2o


def read_g2o(path: Path) -> tuple[dict[int, list[float]], list[tuple[int, int, Any, Any]], list[int]]:
    """Return vertices, edges with full information matrices, and fixed vertices; by g2o's own description."""
    vertices, edges, fixed = {}, [], []
    for line in path.read_text().splitlines():
        tag, *fields = line.split()
        if tag == "VERTEX_SE2":
            vertices[int(fields[0])] = [float(f) for f in fields[1:]]
            assert len(fields) == 4
        elif tag == "EDGE_SE2":
            assert len(fields) == 11
            numbers = np.array([float(f) for f in fields[2:]])
            q11, q12, q13, q22, q23, q33 = numbers[3:]
            matrix = np.array([[q11, q12, q13], [q12, q22, q23], [q13, q23, q33]])
            edges.append((int(fields[0]), int(fields[1]), numbers[:3], matrix))
        else:
            assert tag == "FIX"
            fixed += [int(f) for f in fields]
    return vertices, edges, fixed


def test_a_pose_graph(tmp_path: Path) -> None:
    path = trajectory()
    edges = edges_along(path.poses)
    write_g2o(tmp_path / "a.g2o", path, edges)
    vertices, read, fixed = read_g2o(tmp_path / "a.g2o")
    assert fixed == [0]
    assert (tmp_path / "a.g2o").read_text().splitlines()[-1] == "FIX 0"
    np.testing.assert_array_equal([vertices[k] for k in range(8)], path.poses)
    for edge, (i, j, pose, information) in zip(edges, read, strict=True):
        assert (i, j) == (edge.i, edge.j)
        np.testing.assert_array_equal(pose, edge.pose)
        np.testing.assert_allclose(information, information.T)
        assert (np.linalg.eigvalsh(information) > 0).all()


def test_gtsam_reads_a_pose_graph(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed: pip install gtsam")
    path = trajectory()
    closure = PoseEdge(i=0, j=7, pose=path.poses[7] - path.poses[0], covariance=np.diag([1e-4, 4e-4, 1e-6]))
    edges = [*edges_along(path.poses), closure]
    write_g2o(tmp_path / "a.g2o", path, edges)
    graph, values = gtsam.readG2o(str(tmp_path / "a.g2o"), False)
    assert (graph.size(), values.size()) == (len(edges), len(path.poses))
    for k, pose in enumerate(path.poses):
        found = values.atPose2(k)
        np.testing.assert_allclose([found.x(), found.y(), found.theta()], pose, atol=1e-12)
    for k, edge in enumerate(edges):
        factor = graph.at(k)
        assert tuple(factor.keys()) == (edge.i, edge.j)
        measured = factor.measured()
        np.testing.assert_allclose([measured.x(), measured.y(), measured.theta()], edge.pose, atol=1e-12)
        np.testing.assert_allclose(factor.noiseModel().information(), information_of(edge), rtol=1e-9, atol=1e-6)


def test_a_step_is_one_edge() -> None:
    steps = steps_of_a_run()
    edges = edges_of(steps)
    assert [(edge.i, edge.j) for edge in edges] == [(step.reference, step.index) for step in steps[1:]]
    for edge in edges:  # which refuses a covariance that is not positive definite
        assert np.isfinite(information_of(edge)).all()


def test_a_match_that_was_refused_is_no_edge() -> None:
    *_, before, step = steps_of_a_run()[:6]
    guessed = edges_of([before, replace(step, outcome=StepOutcome.PREDICTED, reference=0)])[-1]
    assert (guessed.i, guessed.j) == (before.index, step.index)
    np.testing.assert_allclose(guessed.pose, se2.between(before.pose_odom, step.pose_odom))
    np.testing.assert_allclose(np.sqrt(np.diag(guessed.covariance)), GUESS_SIGMAS)


def steps_of_a_run() -> list[Step]:
    """Return the steps of a drive that comes back to where it began."""
    scans = list(simulate("office", n_scans=60, seed=4))
    odometry = Odometry()
    return [odometry.add(scan) for scan in (*scans, *reversed(scans))]


def test_the_information_is_of_g2os_error(tmp_path: Path) -> None:
    # g2o's error is delta = measurement^-1 * (x_i^-1 x_j): draw poses by our covariance, and look at how delta is
    # spread
    pose, rng = np.array([0.4, -0.2, 1.1]), np.random.default_rng(5)
    cov = random_cov(rng) * 1e-4  # small, where first order holds
    edge = PoseEdge(i=0, j=1, pose=pose, covariance=cov)
    write_g2o(tmp_path / "a", Trajectory(stamps=np.zeros(2), poses=np.zeros((2, 3))), [edge])
    ((_, _, _, information),) = read_g2o(tmp_path / "a")[1]
    samples = pose + rng.multivariate_normal(np.zeros(3), cov, 20_000)
    spread = np.cov(se2.between(pose, samples).T)
    root = np.linalg.cholesky(information)
    # 20,000 samples tell a variance to 1 %
    np.testing.assert_allclose(root.T @ spread @ root, np.eye(3), atol=0.04)


def test_poses_that_are_not_known_are_no_vertices(tmp_path: Path) -> None:
    path = trajectory(gap=0)
    edges = edges_along(path.poses)
    write_g2o(tmp_path / "a", path, edges[1:])
    vertices, _, fixed = read_g2o(tmp_path / "a")
    assert sorted(vertices) == list(range(1, 8))
    assert fixed == [1]
    with pytest.raises(InvalidArgumentError, match="must join known poses, got 0 to 1 of 8"):
        write_g2o(tmp_path / "b", path, edges)
    assert not (tmp_path / "b").exists()


def test_covariances_must_be_positive_definite(tmp_path: Path) -> None:
    edge = PoseEdge(i=0, j=1, pose=np.zeros(3), covariance=np.diag([1.0, 0.0, 1.0]))
    with pytest.raises(InvalidArgumentError, match="positive definite"):
        write_g2o(tmp_path / "a", trajectory(), [edge])


def test_a_graph_of_a_run_joins_all_scans(tmp_path: Path) -> None:
    scans = [room_scan((0.05 * k, 0.0, 0.02 * k), seed=k) for k in range(5)]
    blind = log_from_arrays([(0.0, np.full(181, np.nan))], angle_min=-1.5, angle_increment=0.0174)
    scans.insert(3, blind[0])
    steps: list[Step] = []
    result = run_engine(scans, Odometry(), on_step=steps.append)
    write_g2o(tmp_path / "a", result.trajectory, edges_of(steps))
    vertices, edges, _ = read_g2o(tmp_path / "a")
    # after the blind scan what was in use before it matches: the keyframe
    assert [(i, j) for i, j, _, _ in edges if j == 4] == [(0, 4)]
    assert [j for _, j, _, _ in edges] == [1, 2, 3, 4, 5]
    for i, j, pose, _ in edges:
        # poses follow these very matches, and a little the motion that was expected
        found = se2.between(np.array(vertices[i]), np.array(vertices[j]))
        np.testing.assert_allclose(found, pose, atol=2e-3)


# ---- MCAP


def test_an_mcap_of_a_run(tmp_path: Path) -> None:
    path, log = trajectory(12, gap=5), rich_log()
    assert path.covariances is not None
    write_odometry_mcap(tmp_path / "run.mcap", path, log)
    with AnyReader([tmp_path / "run.mcap"], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        found: dict[str, list[Any]] = {}
        for connection, _, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            found.setdefault(f"{connection.topic} {connection.msgtype}", []).append(message)
    assert {name: len(messages) for name, messages in found.items()} == {
        "/odom nav_msgs/msg/Odometry": 11,
        "/tf tf2_msgs/msg/TFMessage": 11,
        "/scan sensor_msgs/msg/LaserScan": 12,
    }
    known = [k for k in range(12) if k != 5]
    for k, odometry, tf in zip(known, *list(found.values())[1::-1], strict=True):
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "laser")
        position, q = odometry.pose.pose.position, odometry.pose.pose.orientation
        pose = [position.x, position.y, 2 * np.arctan2(q.z, q.w)]
        np.testing.assert_allclose(pose, path.poses[k])
        # row-major 6x6 of x, y, z, roll, pitch, yaw
        places = [0, 1, 5, 6, 7, 11, 30, 31, 35]
        np.testing.assert_array_equal(odometry.pose.covariance[places], path.covariances[k].ravel())
        assert not np.delete(odometry.pose.covariance, places).any()
        (transform,) = tf.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "laser")
        assert transform.header.stamp == odometry.header.stamp
        assert transform.transform.translation.x == position.x
        assert transform.transform.rotation == q


def test_our_reader_takes_the_mcap_for_a_log(tmp_path: Path) -> None:
    log = rich_log(n=8)
    path = trajectory()
    write_odometry_mcap(tmp_path / "run.mcap", path, log)
    back = read_log(tmp_path / "run.mcap")
    for before, after in zip(log, back, strict=True):
        assert_same_scan(before, after)
    assert back.odometry is not None
    np.testing.assert_allclose(back.odometry.poses, path.poses, atol=1e-14)


def test_scans_that_no_message_can_say_are_left_out(tmp_path: Path) -> None:
    log = rich_log(n=8, uneven=True)
    write_odometry_mcap(tmp_path / "run.mcap", trajectory(), log)
    n_even = sum(scan.has_uniform_angles for scan in log)
    assert n_even < 8
    assert len(read_log(tmp_path / "run.mcap")) == n_even


# ---- the table, and the command


def test_tables_name_the_same_files() -> None:
    assert tuple(EXPORTS) == get_args(ExportName)


@pytest.mark.parametrize("name", EXPORTS)
def test_each_row_writes_its_file(tmp_path: Path, name: str) -> None:
    path = trajectory()
    data = RunData(trajectory=path, edges=edges_along(path.poses), scans=rich_log(n=8))
    write_exports(tmp_path, [name], data)
    assert [file.name for file in tmp_path.iterdir()] == [EXPORTS[name].filename]
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        write_exports(tmp_path / "file", [name], data)


def test_an_unknown_name(tmp_path: Path) -> None:
    data = RunData(trajectory=trajectory(), edges=(), scans=())
    with pytest.raises(InvalidArgumentError, match="unknown export 'ply': known are kitti, g2o, mcap"):
        write_exports(tmp_path, ["ply"], data)


def write_room_log(path: Path) -> None:
    """Write a log of four scans of a sensor that moves on by 5 cm each time."""
    scans = [room_scan((0.05 * k, 0.0, 0.0), seed=k) for k in range(4)]
    log = log_from_arrays(
        [(0.1 * k, scan.ranges) for k, scan in enumerate(scans)],
        angle_min=scans[0].angle_min,
        angle_increment=scans[0].angle_increment,
    )
    write_log(path, log)


def test_the_command_writes_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_room_log(tmp_path / "log.csv")
    out = tmp_path / "out"
    command = ["odometry", str(tmp_path / "log.csv"), "--out", str(out), "--export", "kitti", "g2o", "mcap"]
    assert run(command) == 0
    assert "trajectory.kitti, graph.g2o, run.mcap" in capsys.readouterr().out
    assert len((out / "trajectory.kitti").read_text().splitlines()) == 4
    assert len(read_g2o(out / "graph.g2o")[1]) == 3
    assert len(read_log(out / "run.mcap")) == 4


def test_the_graph_is_gathered_for_those_that_take_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [name for name in EXPORTS if takes_edges([name])] == ["g2o"]
    write_room_log(tmp_path / "log.csv")
    gathered: list[int] = []
    monkeypatch.setattr(runner, "edges_of", lambda steps: gathered.append(len(steps)) or [])
    command = ["odometry", str(tmp_path / "log.csv"), "--out", str(tmp_path / "out"), "--export"]
    assert run([*command, "kitti"]) == 0
    assert gathered == []
    assert run([*command, "kitti", "g2o"]) == 0
    assert gathered == [4]


def test_a_file_that_cannot_be_made_costs_no_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scan = room_scan((0.0, 0.0, 0.0))
    beams = {"angle_min": scan.angle_min, "angle_increment": scan.angle_increment}
    # milliseconds taken for seconds: no message can hold them
    log = log_from_arrays([(1.7e12 + k, scan.ranges) for k in range(2)], **beams)
    write_log(tmp_path / "log.csv", log)
    out = tmp_path / "out"
    assert run(["odometry", str(tmp_path / "log.csv"), "--out", str(out), "--export", "mcap"]) == 1
    assert "cannot write the stamp 1700000000000.0 s" in capsys.readouterr().err
    names = {path.name for path in out.iterdir()}
    assert {"map.png", "run.json", "trajectory.csv", "trajectory.tum"} <= names
    assert "run.mcap" not in names
