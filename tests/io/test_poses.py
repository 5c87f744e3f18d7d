"""Poses from whatever file holds them."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import curvescan as cs
from curvescan.io import read_poses, write_csv, write_tum
from curvescan.io.trajectories.trajectory import Trajectory

TRAJECTORY = Trajectory(
    stamps=np.array([1.5, 1.25, 2.0]), poses=np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5], [3.0, -4.0, -2.0]])
)
ROWS = "1.5,0,0,0\n1.25,1,2,0.5\n2.0,3,-4,-2\n"


@pytest.mark.parametrize("header", ["stamp,x,y,theta", "timestamp, x, y, theta", "Stamp,X,Y,Theta"])
def test_csv_and_tum_are_told_by_content(tmp_path, header):
    written = {
        "csv": tmp_path / "a.tum",  # names never decide
        "tum": tmp_path / "b.csv",
        "ours": tmp_path / "c.txt",
    }
    written["csv"].write_text(f"# of a robot\n{header}\n# in the middle\n{ROWS}")
    write_tum(written["tum"], TRAJECTORY)
    write_csv(written["ours"], TRAJECTORY, ["matched"] * 3)
    for name, path in written.items():
        found = read_poses(path)
        np.testing.assert_array_equal(found.trajectory.stamps, TRAJECTORY.stamps)
        np.testing.assert_allclose(found.trajectory.poses, TRAJECTORY.poses, atol=1e-12)
        assert found.is_of_sensor == (name == "ours")


@pytest.mark.parametrize("call", [read_poses, cs.read_tum, cs.read_csv, Trajectory.read, TRAJECTORY.write])
def test_a_path_that_is_none_is_told(call):
    for given in (None, 5):
        with pytest.raises(cs.InvalidArgumentError, match="a trajectory must be given as a path, got"):
            call(given)


def test_a_folder_stands_for_its_trajectory(tmp_path):
    write_csv(tmp_path / "trajectory.csv", TRAJECTORY, ["matched"] * 3)
    assert len(read_poses(tmp_path).trajectory) == 3
    with pytest.raises(cs.LogFileError, match="folder"):
        read_poses(tmp_path.parent)


def test_a_log_stands_for_its_poses(tmp_path):
    path = tmp_path / "corrected.log.gz"
    lines = [f"FLASER 2 1 1 {k} 0 0.1 {k - 1} 0 0.1 {10 + k} host 0\n" for k in range(3)]
    path.write_bytes(gzip.compress("".join(lines).encode()))
    found = read_poses(path)
    assert found.is_of_sensor
    np.testing.assert_allclose(found.trajectory.poses, [[0, 0, 0.1], [1, 0, 0.1], [2, 0, 0.1]])
    path.write_text("".join(f"FLASER 2 1 1 0 0 0 0 0 0 {k} host 0\n" for k in range(3)))
    with pytest.raises(cs.LogFormatError, match="a log without poses: run `curvescan odometry`"):
        read_poses(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("stamp,x,y,theta\n", "is empty"),
        ("stamp,x,y\n1,2,3\n", "need the columns stamp"),
        ("stamp,x,y,theta\n1,2,3\n", "line 2: a row has 4 fields, as the header has, got 3"),
        ("# x\nstamp,x,y,theta\n1,2,3,east\n", "line 3: a field is not a number"),
        ("a story\n", "holds no poses that can be read"),
        ("1 2 3 4 0 0 0\n", "a TUM line has 8 fields"),
        ("100.5 99.0 0.1 -0.2 0 0 0 -1.5\n", "read it with read_relations"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, text, message):
    path = tmp_path / "poses"
    path.write_text(text)
    with pytest.raises(cs.LogFormatError, match=message):
        read_poses(path)


def test_missing_and_packed_files_are_told(tmp_path):
    with pytest.raises(cs.LogFileError, match=r"trajectory .* does not exist"):
        read_poses(tmp_path / "none")
    packed = tmp_path / "t.csv.gz"
    packed.write_bytes(gzip.compress(f"stamp,x,y,theta\n{ROWS}".encode()))
    with pytest.raises(cs.LogFormatError, match="unpack it first"):
        read_poses(packed)
