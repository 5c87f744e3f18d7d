"""Relations: the file, the measure, and the published figures that stand beside."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import curvescan as cs
from curvescan.evaluation.relations import BENCHMARKS, find_benchmark, relation_errors
from curvescan.io import Relations, read_poses, read_relations
from curvescan.io.trajectories.trajectory import Trajectory

LINE = "100.5 99.0 0.1 -0.2 0 0 0 3.5\n"


def test_relations_are_read(tmp_path):
    path = tmp_path / "x.relations"
    path.write_text(f"# a comment\n\n{LINE}1 2 3 4 5 0.01 -0.01 6\n")
    relations = read_relations(path)
    assert relations.first_stamps.tolist() == [100.5, 1.0]
    assert relations.second_stamps.tolist() == [99.0, 2.0]
    np.testing.assert_allclose(relations.poses, [[0.1, -0.2, 3.5 - 2 * np.pi], [3.0, 4.0, 6.0 - 2 * np.pi]])
    assert relations.gaps.tolist() == [1.5, 1.0]
    packed = tmp_path / "x.gz"
    packed.write_bytes(gzip.compress(b"\xef\xbb\xbf" + path.read_bytes()))
    np.testing.assert_array_equal(read_relations(packed).poses, relations.poses)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no relation"),
        ("# nothing\n", "holds no relation"),
        (f"{LINE}1 2 3\n", "line 2: a relation has 8 fields .*, got 3"),
        ("1 2 3 4 5 6 7 x\n", "line 1: a field of a relation is not a finite number"),
        ("1 2 3 4 5 0 0 nan\n", "not a finite number"),
        ("1 2 3 4 0 0.5 0 1\n", r"tilts by 28\.6 deg"),
    ],
)
def test_broken_relations_are_told(tmp_path, text, message):
    path = tmp_path / "x.relations"
    path.write_text(text)
    with pytest.raises(cs.LogFormatError, match=message):
        read_relations(path)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(cs.LogFileError, match=r"relations file .* does not exist"):
        read_relations(tmp_path / "x")


def test_relations_must_fit():
    with pytest.raises(cs.InvalidArgumentError, match="shape"):
        Relations(first_stamps=np.zeros(2), second_stamps=np.zeros(2), poses=np.zeros((1, 3)))


def robot_drive(laser_pose):
    """Poses of a robot's laser, and true relations of the robot, some backwards in time, one far."""
    rng = np.random.default_rng(0)
    robot = np.cumsum(rng.normal(0.0, 0.3, (40, 3)), axis=0)
    robot[:, 2] = cs.se2.wrap(robot[:, 2])
    stamps = np.arange(40.0)
    i = np.array([0, 5, 9, 3, 2])
    j = np.array([3, 9, 8, 3, 39])
    relations = Relations(first_stamps=stamps[i], second_stamps=stamps[j], poses=cs.se2.between(robot[i], robot[j]))
    return Trajectory(stamps=stamps, poses=cs.se2.compose(robot, laser_pose)), relations


def test_a_true_trajectory_has_no_errors_with_the_right_mount_alone():
    mount = (0.3, -0.1, 0.7)
    trajectory, relations = robot_drive(mount)
    errors = relation_errors(trajectory, relations, mount)
    assert errors.translation.max() < 1e-12
    assert errors.rotation.max() < 1e-12
    assert errors.is_near.tolist() == [True, True, True, True, False]
    assert relation_errors(trajectory, relations).translation.max() > 0.1
    # a mount turns the robot's frame, not its turns
    assert relation_errors(trajectory, relations).rotation.max() < 1e-12


def test_errors_are_those_put_in():
    trajectory, relations = robot_drive((0.0, 0.0, 0.0))
    off = np.array([[0.03, 0.04, 0.2], [0, 0, 0], [0, 0, -0.1], [0, 0, 0], [6, 8, 0]])
    wrong = Relations(
        first_stamps=relations.first_stamps,
        second_stamps=relations.second_stamps,
        poses=cs.se2.compose(relations.poses, off),
    )
    errors = relation_errors(trajectory, wrong)
    np.testing.assert_allclose(errors.translation, [0.05, 0, 0, 0, 10], atol=1e-12)
    np.testing.assert_allclose(errors.rotation, [0.2, 0, 0.1, 0, 0], atol=1e-12)
    (near, turn), (far, _), (everything, _) = map(errors.spreads, ("near", "far", "all"))
    assert (near.n, far.n, everything.n) == (4, 1, 5)
    assert (near.mean, near.max, far.max) == pytest.approx((0.0125, 0.05, 10.0))
    assert turn.median == pytest.approx(0.05)
    length = np.hypot(*np.diff(trajectory.poses[:, :2], axis=0).T)
    np.testing.assert_allclose(errors.between[:2], [length[:3].sum(), length[5:9].sum()])


def test_relations_without_scans_are_counted():
    trajectory, relations = robot_drive((0.0, 0.0, 0.0))
    poses = trajectory.poses.copy()
    poses[8] = np.nan  # a scan whose pose is not known
    cut = Trajectory(stamps=trajectory.stamps[:20], poses=poses[:20])
    errors = relation_errors(cut, relations)
    assert (errors.n_given, len(errors), errors.n_missing) == (5, 3, 2)
    far = Trajectory(stamps=trajectory.stamps + 0.5, poses=trajectory.poses)
    with pytest.raises(cs.InvalidArgumentError, match=r"none of the 5 relations .* from 0\.5"):
        relation_errors(far, relations)


def test_the_file_or_a_name_tells_the_benchmark():
    assert find_benchmark(None, "intel.relations") is BENCHMARKS["intel"]
    assert find_benchmark(None, "MIT_Killian.relations") is BENCHMARKS["mit-killian-court"]
    assert find_benchmark("aces", "intel.relations") is BENCHMARKS["aces"]
    assert find_benchmark(None, "office.relations") is None
    with pytest.raises(cs.InvalidArgumentError, match="unknown benchmark 'here': known are aces"):
        find_benchmark("here")


def test_the_graph_poses_of_intel_fit_its_relations(real_data):
    folder = real_data / "intel-lab"
    if not (folder / "intel.relations").exists():
        pytest.skip(f"{folder} holds no relations")
    relations = read_relations(folder / "intel.relations")
    assert len(relations) == 2984
    graph = read_poses(folder / "intel.graph_poses.csv").trajectory
    errors = relation_errors(graph, relations)
    translation, rotation = errors.spreads("all")
    # two references made by different hands: they agree to some centimetres, loops included
    assert len(errors) > 100
    assert translation.mean < 0.06
    assert np.degrees(rotation.mean) < 1.5
    wheels = read_poses(folder / "intel.clf.gz")
    assert wheels.is_of_sensor
    errors = relation_errors(wheels.trajectory, relations)
    assert errors.n_missing == 0
    assert np.count_nonzero(errors.is_near) == 1732
    assert errors.spreads("near")[0].mean < 0.03
    assert errors.spreads("far")[0].mean > 5.0  # wheels lose their way
