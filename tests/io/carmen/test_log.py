"""The CARMEN reader, on logs of a few lines, broken ones included, and on real ones."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from curvescan.errors import CurvescanError, LogFileError, LogFormatError
from curvescan.io.carmen.lines import flaser_angle_increment
from curvescan.io.carmen.log import CarmenLog
from curvescan.io.files.lines import ReadError
from curvescan.io.reading import read_log
from tests.carmen_files import RANGES, configured, flaser, odom, write


def rules(log: CarmenLog) -> dict[str, tuple[int, str]]:
    return {read_error.rule: (read_error.count, read_error.first) for read_error in log.read_errors}


# ---- what a sound line gives


def test_flaser_gives_ranges_stamp_and_laser_pose(tmp_path: Path) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser(stamp="976052857.337530")))
    (scan,) = log
    np.testing.assert_array_equal(scan.ranges, RANGES)
    assert scan.stamp == 976052857.337530
    assert scan.angle_min == -math.pi / 2
    assert scan.intensities is None
    assert log.odometry is not None
    np.testing.assert_array_equal(log.odometry.poses, [[1.5, -2.0, 0.25]])
    np.testing.assert_array_equal(log.odometry.stamps, [976052857.337530])
    assert (log.name, log.format, len(log), log.read_errors) == ("a.log", "CARMEN log", 1, ())


@pytest.mark.parametrize(
    ("n", "step_deg", "last_deg"),
    [(180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0), (401, 0.45, 90.0)],
)
def test_flaser_beams_start_at_minus_90_deg(tmp_path: Path, n: int, step_deg: float, last_deg: float) -> None:
    (scan,) = CarmenLog(write(tmp_path / "a.log", flaser([1.0] * n)))
    # 1e-12: rounding of pi / n times n
    assert math.degrees(scan.angle_increment) == pytest.approx(step_deg, abs=1e-12)
    assert math.degrees(scan.angles[0]) == pytest.approx(-90.0, abs=1e-12)
    assert math.degrees(scan.angles[-1]) == pytest.approx(last_deg, abs=1e-12)


def test_flaser_of_one_beam_has_a_usable_increment() -> None:
    assert flaser_angle_increment(1) == math.pi


def test_robotlaser_gives_its_own_angles_limit_and_laser_pose(tmp_path: Path) -> None:
    line = configured(start=-1.25, resolution=0.75, max_range=12.5, laser=(3.0, 4.0, -0.5))
    log = CarmenLog(write(tmp_path / "a.log", line))
    (scan,) = log
    assert (scan.angle_min, scan.angle_increment, scan.range_max) == (-1.25, 0.75, 12.5)
    assert log.odometry is not None
    np.testing.assert_array_equal(log.odometry.poses, [[3.0, 4.0, -0.5]])
    assert log.notes == ()


@pytest.mark.parametrize("resolution", [0.0, -0.5, "nan", 400.0])
def test_unusable_resolution_falls_back_on_the_field_of_view(tmp_path: Path, resolution: object) -> None:
    (scan,) = CarmenLog(write(tmp_path / "a.log", configured(fov=1.5, resolution=resolution)))
    assert scan.angle_increment == 0.5  # 1.5 rad over 3 gaps


@pytest.mark.parametrize("tag", ["ROBOTLASER1", "RAWLASER1"])
def test_remissions_become_intensities(tmp_path: Path, tag: str) -> None:
    (scan,) = CarmenLog(write(tmp_path / "a.log", configured(tag=tag, remissions=(5, 6, 7, 8))))
    np.testing.assert_array_equal(scan.intensities, [5, 6, 7, 8])
    np.testing.assert_array_equal(scan.ranges, RANGES)
    assert scan.stamp == 1000.25


@pytest.mark.parametrize("beams", [{"start": 1e9}, {"resolution": 6.0, "ranges": [1.0] * 200}])
def test_a_line_of_impossible_beams_is_broken_and_does_not_end_the_log(
    tmp_path: Path, beams: dict[str, object]
) -> None:
    lines = [configured(stamp=1.0), configured(stamp=2.0, **beams), configured(stamp=3.0)]  # type: ignore[arg-type]
    log = CarmenLog(write(tmp_path / "a", *lines))
    assert [scan.stamp for scan in log] == [1.0, 3.0]
    [error] = log.read_errors
    assert "ROBOTLASER1 line: " in str(error)


def test_remissions_of_another_number_are_left_out(tmp_path: Path) -> None:
    (scan,) = CarmenLog(write(tmp_path / "a.log", configured(remissions=(5, 6))))
    assert scan.intensities is None


def test_rawlaser_takes_the_last_odom_before_it_in_file_order(tmp_path: Path) -> None:
    raw = configured(tag="RAWLASER1")
    path = write(tmp_path / "a.log", raw, odom(1, 2, 3), odom(4, 5, 0.5), raw, odom(7, 7, 7), odom(6, 6, 4))
    with path.open("a") as file:
        file.write(raw)
    odometry = CarmenLog(path).odometry
    assert odometry is not None
    assert np.all(np.isnan(odometry.poses[0]))
    np.testing.assert_array_equal(odometry.poses[1], [4, 5, 0.5])
    # 4 rad is outside (-pi, pi]; 1e-15: one rounding of 4 - 2 pi
    np.testing.assert_allclose(odometry.poses[2], [6, 6, 4 - 2 * math.pi], atol=1e-15)


def test_order_of_the_file_is_kept_when_the_clock_goes_back(tmp_path: Path) -> None:
    stamps = [5.0, 4.0, 4.0, 9.0, 0.0]
    log = CarmenLog(write(tmp_path / "a.log", *(flaser(stamp=t) for t in stamps)))
    assert [scan.stamp for scan in log] == stamps
    assert log.odometry is not None
    assert log.odometry.stamps.tolist() == stamps


def test_readings_that_are_no_numbers_of_metres_stay_in_the_scan(tmp_path: Path) -> None:
    values = ["nan", "inf", "-inf", "-1", "0", "1e999", "3"]
    log = CarmenLog(write(tmp_path / "a.log", flaser(values)))
    (scan,) = log
    np.testing.assert_array_equal(scan.ranges, [np.nan, np.inf, -np.inf, -1, 0, np.inf, 3])
    assert scan.valid.tolist() == [False] * 6 + [True]
    assert log.read_errors == ()


def test_crlf_blank_lines_indents_and_missing_last_newline(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(f"# c\r\n\r\n\t {flaser()}\r\n   \n{flaser(stamp=2)}".encode())
    log = CarmenLog(path)
    assert [scan.stamp for scan in log] == [1000.25, 2.0]
    assert log.read_errors == ()
    assert log.tag_counts == {"#": 1, "FLASER": 2}


@pytest.mark.parametrize("end", ["\n", ""])
def test_a_byte_order_mark_costs_no_scan(tmp_path: Path, end: str) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(b"\xef\xbb\xbf" + (flaser().strip() + end).encode())
    log = read_log(path)
    assert log.tag_counts == {"FLASER": 1}
    np.testing.assert_array_equal(log[0].ranges, next(iter(log)).ranges)


def test_iteration_starts_anew_each_time(tmp_path: Path) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser(stamp=1), flaser(stamp=2)))
    next(iter(log))
    assert [scan.stamp for scan in log] == [scan.stamp for scan in log] == [1.0, 2.0]


# ---- which laser


def test_rear_and_further_lasers_and_unknown_tags_are_counted_and_not_read(tmp_path: Path) -> None:
    lines = [flaser(stamp=1), flaser(tag="RLASER", stamp=2), flaser(tag="RLASER", stamp=3)]
    lines += [configured(tag="ROBOTLASER2"), "NEFF 12.5", "# text", "Gr\u00fc\u00dfe 1 2"]
    log = CarmenLog(write(tmp_path / "a.log", *lines))
    assert [scan.stamp for scan in log] == [1.0]
    assert log.tag_counts["RLASER"] == 2
    assert log.tag_counts["NEFF"] == 1
    assert "2 RLASER lines are not read: they are of the rear laser" in log.notes
    assert "1 ROBOTLASER2 lines are not read: they are of a further laser" in log.notes
    assert log.read_errors == ()


def test_a_sweep_logged_under_two_names_is_read_once(tmp_path: Path) -> None:
    pair = [configured(tag="RAWLASER1", stamp=1), configured(stamp=1)]
    log = CarmenLog(write(tmp_path / "a.log", *pair, *pair, *pair))
    assert len(log) == len(list(log)) == 3
    assert log.odometry is not None
    assert log.odometry.poses[0].tolist() == [1.5, -2.0, 0.25]
    assert log.notes[0].startswith("3 RAWLASER1 lines are not read: ROBOTLASER1")


def test_a_name_with_broken_lines_only_gives_way_to_a_sound_one(tmp_path: Path) -> None:
    log = CarmenLog(write(tmp_path / "a.log", "ROBOTLASER1 0 1", flaser(), "FLASER 3 1"))
    assert len(log) == len(list(log)) == 1
    assert sum(read_error.count for read_error in log.read_errors) == 2


# ---- the range limit


def limit_of(log: CarmenLog) -> float:
    limits = {scan.range_max for scan in log}
    assert len(limits) == 1
    return limits.pop()


@pytest.mark.parametrize(
    ("readings", "expected"),
    [((1.0, 8.2, 81.83), 80.0), ((1.0, 7.0, 8.191), 8.18), ((1.0, 7.0, "inf"), 8.18), ((1.0, "nan", -9), 8.18)],
)
def test_flaser_without_parameter_is_taken_for_a_sick(
    tmp_path: Path, readings: tuple[object, ...], expected: float
) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser((1.0, 2.0, 3.0)), flaser(readings)))
    assert limit_of(log) == expected
    assert f"{expected:g} m is taken" in log.notes[0]


@pytest.mark.parametrize(
    ("declared", "expected"), [(50, 50.0), (80.99, 80.99), (81.9, 81.82), (81.92, 81.82), (8.19, 8.182), (100, 100.0)]
)
def test_flaser_limit_follows_the_last_parameter_and_stays_below_the_codes(
    tmp_path: Path, declared: float, expected: float
) -> None:
    params = ["PARAM robot_front_laser_max 33 nohost 0", "PARAM robot_use_laser on nohost 0"]
    last = f"PARAM robot_front_laser_max {declared} nohost 0"
    log = CarmenLog(write(tmp_path / "a.log", *params, flaser(), flaser(), last))
    assert limit_of(log) == expected
    assert log.notes == (f"range_max {expected:g} m follows PARAM robot_front_laser_max",)


@pytest.mark.parametrize("value", ["", "x", "-1", "0", "nan", "inf"])
def test_unusable_parameter_is_a_fault_and_ignored(tmp_path: Path, value: str) -> None:
    log = CarmenLog(write(tmp_path / "a.log", f"PARAM robot_front_laser_max {value}", flaser()))
    assert limit_of(log) == 80.0
    assert rules(log) == {"PARAM robot_front_laser_max is not a positive number": (1, "line 1")}


@pytest.mark.parametrize(("declared", "expected"), [(81.9, 81.82), ("nan", 80.0), (0, 80.0)])
def test_robotlaser_limit(tmp_path: Path, declared: object, expected: float) -> None:
    assert limit_of(CarmenLog(write(tmp_path / "a.log", configured(max_range=declared)))) == (expected)


def test_range_max_overrides_all(tmp_path: Path) -> None:
    lines = ["PARAM robot_front_laser_max 50 nohost 0", flaser()]
    log = CarmenLog(write(tmp_path / "a.log", *lines), range_max=81.91)
    assert limit_of(log) == 81.91
    assert log.notes == ()
    assert limit_of(CarmenLog(write(tmp_path / "b.log", configured()), range_max=3.0)) == 3.0


# ---- odometry


def test_odometry_of_zeros_is_no_odometry(tmp_path: Path) -> None:
    line = flaser(laser=(0, 0, 0))
    assert CarmenLog(write(tmp_path / "a.log", line, line)).odometry is None
    # one scan at the origin is an ordinary start
    assert CarmenLog(write(tmp_path / "b.log", line)).odometry is not None


def test_odometry_of_a_parked_robot_is_kept(tmp_path: Path) -> None:
    odometry = CarmenLog(write(tmp_path / "a.log", flaser(), flaser())).odometry
    assert odometry is not None
    assert odometry.poses.tolist() == [[1.5, -2.0, 0.25]] * 2


def test_rawlaser_without_odom_has_no_odometry(tmp_path: Path) -> None:
    assert CarmenLog(write(tmp_path / "a.log", configured(tag="RAWLASER1"))).odometry is None


# ---- broken lines

CUT = "FLASER line cut short: fewer fields than its counts say"
BROKEN = [
    ("FLASER", "FLASER line cut short"),
    ("FLASER 4 1 2", CUT),
    (flaser(count=5), CUT),
    (flaser(count=3), "FLASER line too long: more fields than its counts say"),
    (flaser(count=0), "FLASER count below 1"),
    (flaser(count=-4), "FLASER count below 1"),
    (flaser(count="4.0"), "FLASER count not a whole number"),
    (flaser(count=10**9), CUT),
    (flaser(count="9" * 5000), CUT),
    (flaser([1, "x", 3]), "FLASER line with a field that is not a number"),
    (flaser([1, "1.2.3", 3]), "FLASER line with a field that is not a number"),
    (flaser(laser=(1, "nan", 2)), "FLASER pose or time stamp not finite"),
    (flaser(laser=(1, 2, "inf")), "FLASER pose or time stamp not finite"),
    (flaser(stamp="nan"), "FLASER pose or time stamp not finite"),
    (flaser(stamp="noon"), "FLASER line with a field that is not a number"),
]


@pytest.mark.parametrize(("line", "rule"), BROKEN)
def test_broken_flaser_is_skipped_and_counted(tmp_path: Path, line: str, rule: str) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser(stamp=1), line, flaser(stamp=2), line))
    assert [scan.stamp for scan in log] == [1.0, 2.0]
    assert len(log) == 2
    assert log.read_errors == (ReadError(rule=rule, count=2, first="line 2"),)
    assert log.odometry is not None
    assert len(log.odometry) == 2


BROKEN_CONFIGURED = [
    ("ROBOTLASER1 0 1 2", "ROBOTLASER1 line cut short"),
    (configured() + " 1", "ROBOTLASER1 line too long: more fields than its counts say"),
    (configured().rsplit(" ", 1)[0], "ROBOTLASER1 line cut short: fewer fields than its counts say"),
    (configured(remissions=["x"]).replace(" 1 x ", " -1 "), "ROBOTLASER1 count below 0"),
    (configured(start="nan"), "ROBOTLASER1 start angle not finite"),
    (configured(start="left"), "ROBOTLASER1 line with a field that is not a number"),
    (configured(resolution=0, fov=0), "ROBOTLASER1 line without a usable angle between beams"),
    (configured(laser=(1, 2, "nan")), "ROBOTLASER1 pose or time stamp not finite"),
]


@pytest.mark.parametrize(("line", "rule"), BROKEN_CONFIGURED)
def test_broken_robotlaser_is_skipped_and_counted(tmp_path: Path, line: str, rule: str) -> None:
    log = CarmenLog(write(tmp_path / "a.log", line, configured(stamp=1), configured(stamp=2)))
    assert [scan.stamp for scan in log] == [1.0, 2.0]
    assert rules(log) == {rule: (1, "line 1")}


@pytest.mark.parametrize(
    ("line", "rule"),
    [
        ("ODOM 1 2 3", "ODOM line cut short"),
        (odom(1, 2, "nan"), "ODOM pose or time stamp not finite"),
        (odom(1, "y", 3), "ODOM line with a field that is not a number"),
    ],
)
def test_broken_odom_leaves_the_pose_before_it(tmp_path: Path, line: str, rule: str) -> None:
    raw = configured(tag="RAWLASER1")
    log = CarmenLog(write(tmp_path / "a.log", odom(1, 2, 3), line, raw))
    assert log.odometry is not None
    assert log.odometry.poses.tolist() == [[1.0, 2.0, 3.0]]
    assert rules(log) == {rule: (1, "line 2")}


@pytest.mark.parametrize("n_cut", [1, 4, 12, 30])
def test_last_line_cut_short_by_the_end_of_the_file(tmp_path: Path, n_cut: int) -> None:
    path = write(tmp_path / "a.log", flaser(stamp=1), flaser(stamp=2))
    path.write_bytes(path.read_bytes().rstrip().rsplit(b" ", 1)[0][: -n_cut or None])
    log = CarmenLog(path)
    assert [scan.stamp for scan in log] == [1.0]
    assert rules(log) == {CUT: (1, "line 2")}


def test_bytes_that_are_no_text_do_not_stop_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    junk = bytes(range(256)).replace(b"\n", b"")
    path.write_bytes(b"\n".join([junk, flaser().encode(), b"FLASER 1 \xff\xfe 0", junk]))
    log = CarmenLog(path)
    assert len(list(log)) == len(log) == 1
    assert rules(log) == {CUT: (1, "line 3")}


def test_a_line_beyond_the_bound_is_a_fault_and_not_kept_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    with path.open("wb") as file:
        file.write(flaser(stamp=1).encode() + b"\nFLASER 9 ")
        for _ in range(40):
            file.write(b"1.25 " * 200_000)  # 1 MB
        file.write(b"\n" + flaser(stamp=2).encode() + b"\nX" + b"x" * 3_000_000)
    tracemalloc.start()
    log = CarmenLog(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [scan.stamp for scan in log] == [1.0, 2.0]
    assert rules(log) == {"line longer than 1 MiB": (2, "line 2")}
    assert peak < 8 << 20  # of 43 MB; a few copies of the bound of 1 MiB


def test_faults_stand_in_order_of_their_number(tmp_path: Path) -> None:
    log = CarmenLog(write(tmp_path / "a.log", "FLASER", *["FLASER 0"] * 3, flaser()))
    assert [read_error.count for read_error in log.read_errors] == [3, 1]
    assert [read_error.first for read_error in log.read_errors] == ["line 2", "line 1"]


def test_log_without_a_sound_scan_names_the_fault(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"count below 1 \(2 times, first in line 1\)"):
        CarmenLog(write(tmp_path / "a.log", "FLASER 0", "FLASER 0"))


def test_log_without_a_scan_names_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"needs FLASER.* and holds ODOM, RLASER$"):
        CarmenLog(write(tmp_path / "a.log", odom(1, 2, 3), flaser(tag="RLASER")))


def test_log_that_vanishes_is_an_error_of_the_iteration(tmp_path: Path) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser()))
    (tmp_path / "a.log").unlink()
    with pytest.raises(LogFileError, match="does not exist"):
        list(log)


# ---- laws

number = st.sampled_from(["1", "0", "-3", "nan", "inf", "1e400", "2.5", "x", "", "9" * 30])
field = st.one_of(number, st.sampled_from(["host", "FLASER", "ROBOTLASER1", "\t", "#"]))
tag = st.sampled_from(["FLASER", "ROBOTLASER1", "RAWLASER1", "ODOM", "PARAM", "RLASER", "#"])
noisy_line = st.tuples(tag, st.lists(field, max_size=30)).map(lambda t: " ".join([t[0], *t[1]]))
sound_line = st.sampled_from([flaser(), configured(), configured(tag="RAWLASER1"), odom(1, 2, 3)])
in_tmp_path = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)


@in_tmp_path
@given(lines=st.lists(st.one_of(sound_line, noisy_line), max_size=12), cut=st.integers(0, 60))
def test_index_and_iteration_agree_on_any_lines(tmp_path: Path, lines: list[str], cut: int) -> None:
    path = write(tmp_path / "a.log", *lines)
    path.write_bytes(path.read_bytes()[: -cut or None])
    try:
        log = CarmenLog(path)
    except CurvescanError:
        return
    scans = list(log)
    assert len(scans) == len(log) > 0
    odometry = log.odometry
    if odometry is not None:
        assert odometry.stamps.tolist() == [scan.stamp for scan in scans]


finite = st.floats(allow_nan=False, allow_infinity=False)


@in_tmp_path
@given(ranges=st.lists(st.floats(), min_size=1, max_size=20), stamp=finite, x=finite, y=finite)
def test_all_digits_come_through(tmp_path: Path, ranges: list[float], stamp: float, x: float, y: float) -> None:
    log = CarmenLog(write(tmp_path / "a.log", flaser(ranges, stamp=stamp, laser=(x, y, 1.0))))
    (scan,) = log
    np.testing.assert_array_equal(scan.ranges, ranges)
    assert scan.stamp == stamp
    assert log.odometry is not None
    assert log.odometry.poses.tolist() == [[x, y, 1.0]]


def test_unknown_tags_of_arbitrary_text_share_one_count(tmp_path: Path) -> None:
    lines = [f"WORD{i} 1 2 3" for i in range(5000)]
    log = CarmenLog(write(tmp_path / "a.log", *lines, flaser()))
    assert len(log.tag_counts) < 100
    assert sum(log.tag_counts.values()) == 5001
    assert log.tag_counts["FLASER"] == 1


def test_memory_of_an_iteration_does_not_grow_with_the_log(tmp_path: Path) -> None:
    def peak(n_scans: int) -> int:
        line = flaser([1.25] * 180)
        log = CarmenLog(write(tmp_path / f"{n_scans}.log", *[line] * n_scans))
        tracemalloc.start()
        assert sum(1 for _ in log) == n_scans
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak(50)  # first use of the reader fills caches
    # a tenth of the ranges that the longer log has more would already be 0.3 MB
    assert peak(2000) < peak(200) + 100_000


# ---- real logs


@pytest.mark.parametrize(
    ("name", "n_scans", "n_beams", "range_max"),
    [
        ("intel-lab/intel.clf.gz", 13_631, 180, 80.0),
        ("intel-lab/intel-corrected.log.gz", 910, 180, 80.0),
        ("keyframed-corrected/belgioioso-corrected.log.gz", 395, 361, 80.99),
        ("keyframed-corrected/seattle-corrected.log.gz", 241, 361, 80.0),
        ("malaga-sena-loop/malaga-sena-loop.clf.gz", 224, 361, 80.0),
        ("ual-campus-sick/ual-campus.clf.gz", 3_318, 361, 81.0),
    ],
)
def test_real_log(real_data: Path, name: str, n_scans: int, n_beams: int, range_max: float) -> None:
    log = CarmenLog(real_data / name)
    assert len(log) == n_scans
    assert log.read_errors == ()
    n_read, largest, smallest_code = 0, 0.0, math.inf
    for scan in log:
        n_read += 1
        assert len(scan) == n_beams
        assert scan.range_max == range_max
        largest = max(largest, float(np.max(scan.ranges[scan.valid], initial=0.0)))
        smallest_code = min(smallest_code, float(np.min(scan.ranges[~scan.valid], initial=np.inf)))
    assert n_read == n_scans
    assert largest < 80.0  # no code passes for a reading
    assert smallest_code > 81.82  # no reading passes for a code
    assert log.odometry is not None
    assert np.all(np.isfinite(log.odometry.poses))


def test_intel_stamps_go_back_631_times_and_keep_their_digits(real_data: Path) -> None:
    odometry = CarmenLog(real_data / "intel-lab/intel.clf.gz").odometry
    assert odometry is not None
    assert np.count_nonzero(np.diff(odometry.stamps) < 0.0) == 631
    assert odometry.stamps[0] == 976052857.337530
    steps = np.diff(odometry.poses[:, :2], axis=0)
    # the data set is known as 508 m long
    assert np.sum(np.hypot(*steps.T)) == pytest.approx(508.0, abs=1.0)
