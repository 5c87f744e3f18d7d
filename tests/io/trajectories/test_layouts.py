"""Trajectories written and read back to the bit, and files that are none."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError, OutputError
from curvescan.io import read_csv, read_tum, write_csv, write_tum
from curvescan.io.trajectories.trajectory import Trajectory

any_float = st.floats(width=64)
in_tmp_path = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100, deadline=None)


@st.composite
def trajectories(draw: st.DrawFn, *, with_covariances: bool) -> Trajectory:
    n = draw(st.integers(1, 6))
    stamps = draw(arrays(np.float64, n, elements=any_float))
    poses = draw(arrays(np.float64, (n, 3), elements=any_float))
    poses[:, 2] = draw(arrays(np.float64, n, elements=st.floats(-math.pi, math.pi)))
    covariances = None
    if with_covariances:
        upper = np.triu(draw(arrays(np.float64, (n, 3, 3), elements=st.floats(-1e300, 1e300))))
        covariances = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
    return Trajectory(stamps=stamps, poses=poses, covariances=covariances)


def assert_same_bits(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_array_equal(a, b)
    known = ~np.isnan(a)
    np.testing.assert_array_equal(np.signbit(a[known]), np.signbit(b[known]))


@in_tmp_path
@given(trajectory=trajectories(with_covariances=False))
def test_tum_round_trip(tmp_path: Path, trajectory: Trajectory) -> None:
    write_tum(tmp_path / "t.tum", trajectory)
    back = read_tum(tmp_path / "t.tum")
    assert_same_bits(back.stamps, trajectory.stamps)
    assert_same_bits(back.poses[:, :2], trajectory.poses[:, :2])
    turn = back.poses[:, 2] - trajectory.poses[:, 2]
    # -pi and pi are one direction; 1e-15 is two roundings of an angle of pi
    assert np.all(np.minimum(np.abs(turn), np.abs(np.abs(turn) - 2 * np.pi)) <= 1e-15)


@in_tmp_path
@given(data=st.data(), with_covariances=st.booleans())
def test_csv_round_trip(tmp_path: Path, data: st.DataObject, with_covariances: bool) -> None:
    trajectory = data.draw(trajectories(with_covariances=with_covariances))
    n = len(trajectory)
    # a text file knows neither lone carriage returns nor NUL nor half of a surrogate pair
    name = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=8)
    outcomes = data.draw(st.lists(name, min_size=n, max_size=n))
    write_csv(tmp_path / "t.csv", trajectory, outcomes)
    back, back_outcomes = read_csv(tmp_path / "t.csv")
    assert back_outcomes == tuple(outcomes)
    assert_same_bits(back.stamps, trajectory.stamps)
    assert_same_bits(back.poses, trajectory.poses)
    if trajectory.covariances is None:
        assert back.covariances is None
    else:
        assert back.covariances is not None
        assert_same_bits(back.covariances, trajectory.covariances)


def test_tum_text_is_what_other_tools_expect(tmp_path: Path) -> None:
    trajectory = Trajectory(
        stamps=np.array([976052857.33753, 976052857.1]), poses=np.array([[0.0, 0.0, 0.0], [1.5, -2.0, math.pi / 2]])
    )
    write_tum(tmp_path / "t.tum", trajectory)
    first, second = (tmp_path / "t.tum").read_text().splitlines()
    assert first == "976052857.33753 0.0 0.0 0.0 0.0 0.0 0.0 1.0"
    # file order, although the clock goes back
    assert second.startswith("976052857.1 1.5 -2.0 0.0 0.0 0.0 0.70710678")


def test_missing_pose_is_a_line_of_nan(tmp_path: Path) -> None:
    nan = Trajectory(stamps=np.array([1.0, 2.0]), poses=np.array([[np.nan] * 3, [1.0, 2.0, 3.0]]))
    write_tum(tmp_path / "t.tum", nan)
    write_csv(tmp_path / "t.csv", nan, ["lost", "ok"])
    assert np.all(np.isnan(read_tum(tmp_path / "t.tum").poses[0]))
    assert_same_bits(read_csv(tmp_path / "t.csv")[0].poses, nan.poses)


def test_covariance_of_one_pose_may_be_missing(tmp_path: Path) -> None:
    covariances = np.stack([np.full((3, 3), np.nan), np.diag([1.0, 2.0, 3.0])])
    trajectory = Trajectory(stamps=np.zeros(2), poses=np.zeros((2, 3)), covariances=covariances)
    write_csv(tmp_path / "t.csv", trajectory, ["a", "b"])
    back, _ = read_csv(tmp_path / "t.csv")
    assert back.covariances is not None
    assert_same_bits(back.covariances, covariances)


def test_csv_text(tmp_path: Path) -> None:
    cov = np.array([[[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]]])
    trajectory = Trajectory(stamps=np.array([0.1]), poses=np.array([[1, 2, 3]]), covariances=cov)
    write_csv(tmp_path / "t.csv", trajectory, ["ok"])
    assert (tmp_path / "t.csv").read_bytes() == (
        b"stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt,outcome\n"
        b"0.1,1.0,2.0,3.0,1.0,2.0,3.0,4.0,5.0,6.0,ok\n"
    )


@pytest.mark.parametrize("n", [0, 1000])
def test_number_of_lines_is_number_of_poses(tmp_path: Path, n: int) -> None:
    trajectory = Trajectory(stamps=np.arange(float(n)), poses=np.zeros((n, 3)))
    write_tum(tmp_path / "t.tum", trajectory)
    write_csv(tmp_path / "t.csv", trajectory, ["ok"] * n)
    assert len((tmp_path / "t.tum").read_text().splitlines()) == n
    assert len(read_csv(tmp_path / "t.csv")[0]) == n


def read_text(tmp_path: Path, text: str) -> Trajectory:
    (tmp_path / "t.tum").write_text(text)
    return read_tum(tmp_path / "t.tum")


def test_tum_of_other_tools(tmp_path: Path) -> None:
    text = "# stamp tx ty tz qx qy qz qw\n\n1 2 3 0.4 0 0 2 2\n1.5\t2 3 -9 0.001 0 -1 -1\r\n"
    back = read_text(tmp_path, text)
    assert back.stamps.tolist() == [1.0, 1.5]
    # a quaternion of any length and either sign is the same turn
    np.testing.assert_allclose(back.poses, [[2, 3, math.pi / 2]] * 2, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds no pose"),
        ("# only a comment\n", "holds no pose"),
        ("1 2 3 0 0 0 0 1\n1 2 3\n", r"line 2: a TUM line has 8 fields .*, got 3"),
        ("1 2 3 0 0 0 0 1 9\n", "line 1: a TUM line has 8 fields .*, got 9"),
        ("1 2 x 0 0 0 0 1\n", "line 1: a field is not a number"),
        ("1 2 3 0 0 0 0 0\n", "line 1: a quaternion must not be zero"),
        ("1 2 3 0 0.1 0 0 1\n", r"tilts by 11\.4 deg: project"),
        ("1 2 3 0 1 0 0 0\n", r"tilts by 180\.0 deg"),
        ("\x00\x01\xff\n", "a TUM line has 8 fields"),
    ],
)
def test_broken_tum(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(LogFormatError, match=sentence):
        read_text(tmp_path, text)


HEADER = "stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt,outcome\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is not a trajectory: its first line must be 'stamp,x,y"),
        ("t,x,y\n1,2,3\n", "is not a trajectory"),
        (HEADER + "1,2,3\n", "line 2: a row has 11 fields, as the header has, got 3"),
        (HEADER + "1,2,3,4,,,,,,,ok\n1,2,y,4,,,,,,,ok\n", "line 3: a field is not a number"),
        (HEADER + "1,2,3,4,5,,,,,,ok\n", "line 2: a field is not a number"),
        (HEADER + "x" * 200_000, "is not a CSV file: field larger than field limit"),
    ],
)
def test_broken_csv(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(LogFormatError, match=sentence):
        read_csv(tmp_path / "t.csv")


@pytest.mark.parametrize("read", [read_tum, read_csv])
def test_files_that_cannot_be_read(tmp_path: Path, read: object) -> None:
    assert callable(read)
    with pytest.raises(LogFileError, match="does not exist"):
        read(tmp_path / "none")
    with pytest.raises(LogFileError, match="cannot read"):
        read(tmp_path)


@settings(parent=in_tmp_path)
@given(content=st.binary(max_size=200))
def test_arbitrary_bytes_are_a_format_error(tmp_path: Path, content: bytes) -> None:
    for start, read in ((b"", read_tum), (HEADER.encode(), read_csv)):
        (tmp_path / "t").write_bytes(start + content)
        try:
            read(tmp_path / "t")
        except LogFormatError:
            continue


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    trajectory = Trajectory(stamps=np.zeros(1), poses=np.zeros((1, 3)))
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="is a file"):
        write_tum(tmp_path / "file" / "t.tum", trajectory)
    with pytest.raises(OutputError, match="is a folder"):
        write_csv(tmp_path, trajectory, ["ok"])


def test_one_outcome_a_pose(tmp_path: Path) -> None:
    trajectory = Trajectory(stamps=np.zeros(2), poses=np.zeros((2, 3)))
    with pytest.raises(InvalidArgumentError, match=r"one name a pose \(2\), got 1"):
        write_csv(tmp_path / "t.csv", trajectory, ["ok"])
    assert not (tmp_path / "t.csv").exists()
