"""The records that travel between rooms: what they are called, written and read as."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import curvescan as cs
from curvescan.io.trajectories.layouts import CSV_HEADER

NAMES = ("t.tum", "t.csv", "t.kitti")


def some_trajectory(n=7, *, covariances=True):
    rng = np.random.default_rng(3)
    poses = rng.uniform(-3.0, 3.0, (n, 3))
    roots = rng.normal(size=(n, 3, 3))
    return cs.Trajectory(
        stamps=1_600_000_000.125 + np.cumsum(rng.uniform(0.01, 0.2, n)),
        poses=poses,
        covariances=roots @ roots.transpose(0, 2, 1) if covariances else None,
    )


@pytest.mark.parametrize(
    ("name", "has_stamps", "has_covariances", "tolerance"),
    [
        ("t.tum", True, False, 1e-15),
        ("t.txt", True, False, 1e-15),
        ("t.csv", True, True, 0.0),
        ("t.kitti", False, False, 1e-15),
    ],
)
def test_a_trajectory_comes_back_from_its_file(tmp_path, name, has_stamps, has_covariances, tolerance):
    given = some_trajectory()
    given.write(tmp_path / name)
    found = cs.Trajectory.read(tmp_path / name)
    np.testing.assert_allclose(found.poses, given.poses, rtol=0.0, atol=tolerance)
    stamps = given.stamps if has_stamps else np.arange(len(given))
    np.testing.assert_array_equal(found.stamps, stamps)
    if has_covariances:
        np.testing.assert_array_equal(found.covariances, given.covariances)
    else:
        assert found.covariances is None


def test_the_format_may_be_named_and_must_be_known(tmp_path):
    given = some_trajectory(covariances=False)
    given.write(tmp_path / "poses", format="kitti")
    assert len((tmp_path / "poses").read_text().splitlines()[0].split()) == 12
    with pytest.raises(cs.InvalidArgumentError, match=r"ending '.dat'.*give format="):
        given.write(tmp_path / "poses.dat")
    with pytest.raises(cs.InvalidArgumentError, match="one of tum, csv, kitti, got 'tumm'"):
        given.write(tmp_path / "poses", format="tumm")


def test_a_kitti_file_out_of_the_plane_is_refused(tmp_path):
    path = tmp_path / "camera.kitti"
    path.write_text("1 0 0 0 0 0 -1 0 0 1 0 0\n")
    with pytest.raises(cs.LogFormatError, match="line 1: a planar pose"):
        cs.Trajectory.read(path)
    path.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0\n")
    with pytest.raises(cs.LogFormatError, match="line 2: a KITTI line has 12 numbers"):
        cs.Trajectory.read(path)


def test_a_missing_trajectory_is_told(tmp_path):
    with pytest.raises(cs.LogFileError, match="does not exist"):
        cs.Trajectory.read(tmp_path / "nowhere.tum")


def test_a_trajectory_as_arrays():
    t = some_trajectory()
    np.testing.assert_array_equal(t.to_array(), np.column_stack([t.stamps, t.poses]))
    point = np.array([0.3, -0.2])
    for pose, matrix in zip(t, t.to_matrices(), strict=True):
        np.testing.assert_allclose(
            (matrix @ [*point, 1.0])[:2], cs.se2.transform(pose, point[np.newaxis])[0], atol=1e-14
        )


def test_a_slice_of_a_trajectory_is_one():
    t = some_trajectory()
    part = t[2:6:2]
    np.testing.assert_array_equal(part.stamps, t.stamps[2:6:2])
    np.testing.assert_array_equal(part.poses, t.poses[2:6:2])
    np.testing.assert_array_equal(part.covariances, t.covariances[2:6:2])
    np.testing.assert_array_equal(t[-1], t.poses[-1])


def test_the_poses_in_a_log_are_its_odometry(tmp_path):
    log = tmp_path / "robot.log"
    log.write_text("".join(f"FLASER 2 1 1 {k} 0 0 {k} 0 0 {k} host 0\n" for k in range(1, 4)))
    with pytest.raises(cs.LogFormatError, match=r"read_log\(path\)\.odometry"):
        cs.Trajectory.read(log)
    assert len(cs.read_log(log).odometry) == len(cs.read_poses(log).trajectory) == 3


def test_the_results_of_a_run_stand_for_their_trajectory(tmp_path):
    given = some_trajectory()
    given.write(tmp_path / "trajectory.csv")
    np.testing.assert_array_equal(cs.Trajectory.read(tmp_path).poses, given.poses)
    (tmp_path / "trajectory.csv").unlink()
    with pytest.raises(cs.LogFileError, match=r"a folder without a trajectory\.csv"):
        cs.Trajectory.read(tmp_path)


@pytest.mark.parametrize("text", ["", "\n\n", ",".join(CSV_HEADER) + "\n", "stamp,x,y,theta\n"])
def test_an_empty_file_is_no_trajectory(tmp_path, text):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(cs.LogFormatError, match="is empty"):
        cs.Trajectory.read(tmp_path / "t.csv")


@pytest.mark.parametrize("name", NAMES)
def test_a_byte_order_mark_is_no_part_of_a_trajectory(tmp_path, name):
    given = cs.Trajectory(stamps=np.arange(2.0), poses=np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]]))
    given.write(tmp_path / name)
    before = cs.Trajectory.read(tmp_path / name)
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + (tmp_path / name).read_bytes())
    assert cs.Trajectory.read(tmp_path / name) == before
    assert cs.io.read_poses(tmp_path / name).is_of_sensor == (name == "t.csv")


@pytest.mark.parametrize("name", NAMES)
def test_a_trajectory_that_is_packed_is_told(tmp_path, name):
    cs.Trajectory(stamps=np.arange(2.0), poses=np.zeros((2, 3))).write(tmp_path / name)
    (tmp_path / "packed").write_bytes(gzip.compress((tmp_path / name).read_bytes()))
    with pytest.raises(cs.LogFormatError, match="compressed with gzip and not a log: unpack it first"):
        cs.Trajectory.read(tmp_path / "packed")


def test_trajectories_are_compared_by_their_numbers():
    one = cs.Trajectory(stamps=[0.0, 1.0], poses=[[0.0, 0.0, 0.0], [np.nan] * 3], covariances=np.ones((2, 3, 3)))
    same = cs.Trajectory(stamps=one.stamps.copy(), poses=one.poses.copy(), covariances=np.ones((2, 3, 3)))
    assert one == same
    assert one != cs.Trajectory(stamps=one.stamps, poses=one.poses)
    assert one != cs.Trajectory(stamps=one.stamps, poses=one.poses + 1e-12, covariances=one.covariances)
    assert one[:1] != one
    assert one != 3
