"""Scans from CSV, as somebody's own driver may write them."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io import read_log, write_log
from curvescan.io.arrays.memory import as_log
from curvescan.scan import LaserScan

HEADER = "stamp,angle_min,angle_increment,range_min,range_max,ranges"
ROW = "12.5,-1.0,0.5,0.1,8.0,1.0,2.5,nan,inf"


def write(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def test_a_row_is_a_scan(tmp_path: Path) -> None:
    (scan,) = read_log(write(tmp_path / "a", "# my driver", "", HEADER, ROW))
    np.testing.assert_array_equal(scan.ranges, [1.0, 2.5, np.nan, np.inf])
    assert (scan.stamp, scan.angle_min, scan.angle_increment) == (12.5, -1.0, 0.5)
    assert (scan.range_min, scan.range_max) == (0.1, 8.0)
    assert (scan.time_increment, scan.scan_time, scan.intensities) == (0.0, 0.0, None)


def test_beams_may_change_and_columns_stand_in_any_order(tmp_path: Path) -> None:
    header = "scan_time,stamp,time_increment,angle_increment,angle_min,ranges"
    rows = ["0.1,1,0.001,-0.5,0.5,1,2", "0.1,2,0.001,-0.5,0.5,1,2,3", "0.1,3,0.001,-0.5,0.5"]
    log = read_log(write(tmp_path / "a", header, *rows))
    assert [len(scan) for scan in log] == [2, 3, 0]
    first = next(iter(log))
    assert (first.angle_increment, first.time_increment, first.scan_time) == (-0.5, 0.001, 0.1)
    assert (first.range_min, first.range_max) == (0.0, np.inf)


def test_lines_of_angles_hold_until_the_next(tmp_path: Path) -> None:
    lines = ["stamp,ranges", "angles,0,0.1,0.3", "1,5,6,7", "2,5,6,7", "angles,0,0.2", "3,5,6"]
    log = read_log(write(tmp_path / "a", *lines))
    assert [scan.angles.tolist() for scan in log] == [[0, 0.1, 0.3], [0, 0.1, 0.3], [0, 0.2]]


def test_even_beams_go_before_a_line_of_angles(tmp_path: Path) -> None:
    lines = [HEADER, "angles,0,0.1,0.3", "1,,,0,8,5,6,7", "2,-1,0.5,0,8,5,6,7"]
    log = read_log(write(tmp_path / "a", *lines))
    assert [scan.angles.tolist() for scan in log] == [[0, 0.1, 0.3], [-1.0, -0.5, 0.0]]


def test_a_scan_without_beams_is_written_and_read(tmp_path: Path) -> None:
    none = LaserScan([], angle_min=0.0, angle_increment=0.1, intensities=[])
    some = LaserScan([1.0, 2.0], angle_min=0.0, angle_increment=0.1, intensities=[3.0, 4.0], stamp=1.0)
    write_log(tmp_path / "a.csv", as_log([some, none, some]))
    log = read_log(tmp_path / "a.csv")
    assert [len(scan) for scan in log] == [2, 0, 2]
    assert log.read_errors == ()


def test_a_line_of_intensities_is_the_next_scans(tmp_path: Path) -> None:
    log = read_log(write(tmp_path / "a", HEADER, "intensities,9,8,7,6", ROW, ROW))
    first, second = log
    assert first.intensities is not None
    assert first.intensities.tolist() == [9, 8, 7, 6]
    assert second.intensities is None


def test_empty_fields_are_no_reading(tmp_path: Path) -> None:
    (scan,) = read_log(write(tmp_path / "a", HEADER, "1,-1.0,0.5,,, 1.5,,2"))
    np.testing.assert_array_equal(scan.ranges, [1.5, np.nan, 2.0])
    assert (scan.range_min, scan.range_max) == (0.0, np.inf)


def test_odometry(tmp_path: Path) -> None:
    header = "stamp,angle_min,angle_increment,x,y,theta,ranges"
    rows = ["1,0,0.1,1,2,7,5", "2,0,0.1,,,,5"]
    odometry = read_log(write(tmp_path / "a", header, *rows)).odometry
    assert odometry is not None
    np.testing.assert_allclose(odometry.poses[0], [1, 2, 7 - 2 * np.pi])
    assert np.isnan(odometry.poses[1]).all()
    assert read_log(write(tmp_path / "b", header, rows[1])).odometry is None


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["unix", "dos"])
@pytest.mark.parametrize("is_packed", [False, True], ids=["plain", "gzip"])
def test_spreadsheets_and_gzip(tmp_path: Path, mark: bytes, end: str, is_packed: bool) -> None:
    text = mark + end.join(['"stamp","angle_min", angle_increment ,ranges', "1,0,0.1,5,6", ""]).encode()
    (tmp_path / "a.txt").write_bytes(gzip.compress(text, mtime=0) if is_packed else text)
    (scan,) = read_log(tmp_path / "a.txt")
    assert scan.ranges.tolist() == [5, 6]


@pytest.mark.parametrize(
    ("line", "rule"),
    [
        ("1,-1.0,0.5", "line cut short: fewer fields than the header names"),
        ("1,-1.0,0.5,0,8,1,x", "line with a field that is not a number"),
        ("nan,-1.0,0.5,0,8,1", "stamp must be finite, got nan"),
        (",-1.0,0.5,0,8,1", "stamp must be finite, got nan"),
        ("1,-1.0,0.5,9,8,1", "range limits must satisfy 0 <= range_min < range_max"),
        ("1,-1.0,0.0,0,8,1", "angle_increment must not be 0"),
        ("1,inf,0.1,0,8,1", "angle_min must be finite, got inf"),
        ("1,-90,0.5,0,8,1", "angles must be radians: 1 beams from angle_min=-90"),
        ("1,,,0,8,1", "scan without directions: no angle_min and angle_increment, and no sound"),
        ("angles,0,x", "line with a field that is not a number"),
    ],
)
def test_a_broken_line_is_skipped_and_counted(tmp_path: Path, line: str, rule: str) -> None:
    log = read_log(write(tmp_path / "a", HEADER, ROW, line, ROW))
    assert len(list(log)) == len(log) == 2
    (read_error,) = log.read_errors
    assert read_error.rule.startswith(rule)
    assert (read_error.count, read_error.first) == (1, "line 3")


def test_lines_that_break_a_rule_with_other_numbers_are_counted_as_one(tmp_path: Path) -> None:
    lines = [f"1,{-90 - 0.1 * k},0.5,0,8,1" for k in range(20)]
    (read_error,) = read_log(write(tmp_path / "a", HEADER, ROW, *lines)).read_errors
    assert read_error.rule.startswith("angles must be radians: 1 beams from angle_min=-90 in")
    assert (read_error.count, read_error.first) == (20, "line 3")


def test_angles_and_intensities_have_one_value_a_range(tmp_path: Path) -> None:
    lines = ["stamp,ranges", "angles,0,0.1", "1,5,6,7", "intensities,1", "2,5,6", "3,5,6"]
    log = read_log(write(tmp_path / "a", *lines))
    assert [scan.stamp for scan in log] == [3.0]
    assert {read_error.rule for read_error in log.read_errors} == {
        "line of angles that has not one value a range",
        "line of intensities that has not one value a range",
    }


def test_a_broken_line_of_angles_leaves_none(tmp_path: Path) -> None:
    lines = ["stamp,ranges", "angles,0,0.1", "1,5,6", "angles,0,x", "2,5,6"]
    assert len(read_log(write(tmp_path / "a", *lines))) == 1


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ("stamp,angle_min", "the last of them 'ranges': it holds stamp, angle_min"),
        ("stamp,angel_min,ranges", "'angel_min' is none of stamp, angle_min"),
        ("stamp,stamp,ranges", "'stamp' is there twice"),
        (HEADER, "is a CSV of scans without a scan"),
    ],
)
def test_what_is_wrong_with_the_file_is_told(tmp_path: Path, header: str, sentence: str) -> None:
    with pytest.raises(LogFormatError, match=sentence):
        read_log(write(tmp_path / "a", header))


def test_all_lines_broken(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"cut short.*\(2 times, first in line 2\)"):
        read_log(write(tmp_path / "a", HEADER, "1", "2"))


def test_no_topics_and_another_limit(tmp_path: Path) -> None:
    path = write(tmp_path / "a", HEADER, ROW)
    with pytest.raises(InvalidArgumentError, match="CSV of scans, which has no topics"):
        read_log(path, topic="/scan")
    assert [scan.range_max for scan in read_log(path, range_max=3.0)] == [3.0]
