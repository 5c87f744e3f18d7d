"""inspect_log: the figures of a log and the sentences on what is wrong with it."""

from __future__ import annotations

import itertools
import json
import math
import tracemalloc
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan.diagnostics.inspect import LogReport, inspect_log, summarise_time
from curvescan.diagnostics.issues import find_issues, report_as_plain
from curvescan.diagnostics.statistics import LogStatistics
from curvescan.errors import InvalidArgumentError
from curvescan.io import Log, ReadError, read_log
from curvescan.io.log import ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats
from tests.carmen_files import flaser, write


class FakeLog(ScanAccess):
    """A log of scans in memory, as a simulation is one."""

    def __init__(
        self,
        scans: Sequence[LaserScan],
        *,
        odometry: Trajectory | None = None,
        read_errors: tuple[ReadError, ...] = (),
        notes: tuple[str, ...] = (),
    ) -> None:
        self.name, self.format = "made up", "fake"
        self.scans, self.odometry, self.read_errors, self.notes = (scans, odometry, read_errors, notes)
        self.tag_counts: Mapping[str, int] = {}

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[LaserScan]:
        return iter(self.scans)


def scan(ranges: Sequence[float] | Floats, stamp: float = 0.0, *, range_max: float = 10.0) -> LaserScan:
    return LaserScan(
        np.asarray(ranges),
        angle_min=-1.0,
        angle_increment=0.01,
        range_min=0.1,
        range_max=range_max,
        stamp=stamp,
        time_increment=1e-6,
    )


def at(*stamps: float) -> FakeLog:
    """Return a sound log with the given stamps."""
    odometry = Trajectory(stamps=np.array(stamps), poses=np.ones((len(stamps), 3)))
    scans = [scan([1.0 + i, 2.0, 3.0], stamp) for i, stamp in enumerate(stamps)]
    return FakeLog(scans, odometry=odometry)


def sentences(report: LogReport, topic: str) -> list[str]:
    return [issue.sentence for issue in find_issues(report) if issue.topic == topic]


def test_sound_log_has_no_findings() -> None:
    log = at(0.0, 0.1, 0.2, 0.3)
    assert isinstance(log, Log)
    report = inspect_log(log)
    assert find_issues(report) == ()
    assert report.is_usable
    assert (report.name, report.format, report.n_scans) == ("made up", "fake", 4)


def test_beams_and_limits() -> None:
    report = inspect_log(FakeLog([scan([1.0] * 101), scan([2.0] * 101), scan([1.0] * 5, range_max=30)]))
    assert report.beam_counts == {5: 1, 101: 2}
    assert report.fov_deg == pytest.approx(math.degrees(1.0))
    assert report.first_beam_deg == pytest.approx(math.degrees(-1.0))
    assert report.angle_step_deg == pytest.approx(math.degrees(0.01))
    assert (report.range_min, report.range_max) == (0.1, 30.0)
    assert sentences(report, "scans") == [
        "the number of beams changes: 5 (1 scan), 101 (2 scans): each scan is taken with its own"
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_full_circle(sign: int) -> None:
    step = sign * math.radians(1.0)
    report = inspect_log(FakeLog([LaserScan(np.ones(360), angle_min=0.0, angle_increment=step)]))
    assert report.fov_deg == 360.0
    assert report.angle_step_deg == pytest.approx(sign * 1.0)


def test_even_time_steps() -> None:
    time = inspect_log(at(10.0, 10.5, 11.0, 11.5)).time
    assert (time.duration, time.mean_rate, time.n_steps) == (1.5, 2.0, 3)
    assert (time.step_min, time.step_median, time.step_max) == (0.5, 0.5, 0.5)
    assert (time.n_equal, time.n_back, time.n_leaps) == (0, 0, 0)


def test_time_that_goes_back_stands_still_and_leaps() -> None:
    report = inspect_log(at(0.0, 1.0, 2.0, 1.5, 1.5, 2.5, 3.5, 23.5, 24.5))
    assert (report.time.n_back, report.time.largest_back) == (1, 0.5)
    assert report.time.n_equal == 1
    assert (report.time.n_leaps, report.time.largest_leap) == (1, 20.0)
    assert sentences(report, "time") == [
        "1 of 8 time steps go back, by up to 0.5 s: scans are taken in file order, stamps are kept as they are",
        "1 of 8 time steps are zero: no speed can be computed from them",
        "1 time step of more than ten times the usual 1 s, the longest of 20 s: "
        "the robot may have moved far between the two scans",
    ]
    assert report.is_usable


def test_uneven_time_steps() -> None:
    (sentence,) = sentences(inspect_log(at(0.0, 0.1, 0.2, 0.6, 0.7)), "time")
    assert sentence.startswith("time steps are uneven, 0.1 to 0.4 s around a median of 0.1 s")


@pytest.mark.parametrize(
    ("usual", "longest", "n_leaps"), [(0.05, 0.9, 0), (0.05, 1.1, 1), (2.0, 15.0, 0), (2.0, 21.0, 1)]
)
def test_leap_is_long_by_itself_and_beside_the_others(usual: float, longest: float, n_leaps: int) -> None:
    steps = np.array([usual, usual, longest, usual])
    assert summarise_time(np.cumsum(steps)).n_leaps == n_leaps


def test_sweeps_that_are_missing_are_counted() -> None:
    steps = np.full(60, 0.1)
    steps[[10, 30]] = 0.2, 0.4
    stamps = np.cumsum(steps)
    report = inspect_log(at(*stamps))
    assert report.time.n_missing == 1 + 3
    assert sentences(report, "time") == [
        "about 4 of 64 sweeps are missing: a step usually takes 0.1 s, the longest 0.4 s: "
        "the robot moved further between the scans beside them"
    ]
    # a clock as uneven as that of a robot that records when it likes tells nothing
    uneven = np.cumsum(np.random.default_rng(4).uniform(0.05, 0.3, 60))
    assert summarise_time(uneven).n_missing == 0


def test_jitter_leaves_leaps_out() -> None:
    steps = np.array([0.1, 0.12, 0.08, 30.0, 0.1])
    time = summarise_time(np.append(0.0, np.cumsum(steps)))
    assert time.jitter == pytest.approx(np.std(steps[steps < 1.0]))


def test_times_of_the_beams() -> None:
    def log(time_increment: float) -> FakeLog:
        log = at(0.0, 0.1, 0.2)
        log.scans = [replace(s, time_increment=time_increment) for s in log.scans]
        return log

    assert sentences(inspect_log(log(0.0)), "time") == [
        "the beams have no times of their own (time_increment): a sweep is taken for a moment, and the motion "
        "during it cannot be undone"
    ]
    sound = inspect_log(log(0.04))
    assert sound.sweep_seconds == pytest.approx(0.08)
    assert not sentences(sound, "time")
    (sentence,) = sentences(inspect_log(log(0.2)), "time")
    assert sentence.startswith("by the times of its beams a sweep takes 0.4 s, and the next one")


def test_equal_stamps_are_one_finding() -> None:
    report = inspect_log(at(5.0, 5.0, 5.0))
    assert sentences(report, "time") == [
        "all stamps are equal: scans are taken in file order, rate and speeds are unknown"
    ]
    assert math.isnan(report.time.mean_rate)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=30))
def test_steps_are_forward_back_or_zero(stamps: list[float]) -> None:
    time = summarise_time(np.array(stamps))
    pairs = list(itertools.pairwise(stamps))
    assert time.n_steps == len(pairs)
    assert time.n_back == sum(b < a for a, b in pairs)
    assert time.n_equal == sum(b == a for a, b in pairs)
    assert time.duration == max(stamps) - min(stamps)
    assert time.largest_back == max(0.0, *(a - b for a, b in pairs), 0.0)


def test_codes_for_no_reading_are_listed_by_share() -> None:
    ranges = [1.0, 2.0, np.nan, np.nan, np.nan, np.inf, 81.91, 81.91, 0.0, -0.0]
    report = inspect_log(FakeLog([scan(ranges), scan(ranges)]))
    assert report.valid_share == 0.2
    shares = {str(code.value): code.share for code in report.codes}
    assert shares == {"nan": 0.3, "81.91": 0.2, "0.0": 0.2, "inf": 0.1}
    assert report.codes[0].share == 0.3
    assert report.largest_reading == 2.0
    assert sentences(report, "readings")[0].startswith("only 20.0% of the readings are valid")


def test_rare_values_out_of_range_are_no_codes() -> None:
    ranges = np.ones((20, 100))
    ranges[0, :2] = [11.0, 12.0]  # 0.05 % each
    assert inspect_log(FakeLog([scan(row) for row in ranges])).codes == ()


def test_blank_scans() -> None:
    report = inspect_log(FakeLog([scan([0.0, 11.0]), scan([1.0, 2.0]), scan([1.0, 3.0])]))
    assert report.n_blank_scans == 1
    assert "1 of 3 scans have no valid reading: they cannot be matched" in sentences(report, "readings")
    assert report.is_usable


def test_log_without_any_valid_reading_is_not_usable() -> None:
    report = inspect_log(FakeLog([scan([0.0, 5000.0]), scan([np.nan, 4000.0])]))
    assert not report.is_usable
    assert math.isnan(report.largest_reading)
    (sentence,) = sentences(report, "readings")
    assert sentence.startswith("no scan has a reading within 0.1 to 10 m")


@pytest.mark.parametrize("n", [0, 1])
def test_log_of_too_few_scans_is_not_usable(n: int) -> None:
    report = inspect_log(FakeLog([scan([1.0, 2.0])] * n))
    assert not report.is_usable
    assert sentences(report, "scans") == [f"the log holds {n} scan{'s' if n == 0 else ''}: a motion needs two"]
    assert math.isnan(report.time.duration)


def test_scan_without_beams_is_blank() -> None:
    report = inspect_log(FakeLog([scan([]), scan([])]))
    assert (report.n_blank_scans, report.n_repeated_scans) == (2, 0)
    assert math.isnan(report.valid_share)


def test_repeated_scans() -> None:
    sweep = [1.0, np.nan, 3.0]
    blank = [scan([np.nan] * 3)] * 2
    report = inspect_log(FakeLog([scan(sweep), scan(sweep), scan([1.0, np.nan, 2.0]), *blank, scan(sweep)]))
    assert (report.n_blank_scans, report.n_repeated_scans) == (2, 1)
    assert sentences(report, "scans")[0].startswith("1 of 6 scans repeat exactly")


# ---- a code for no reading that nobody declared


def noisy_room(n_scans: int, seed: int) -> Floats:
    """Return sweeps of a standing sensor in a room, rounded to 1 cm as a SICK rounds."""
    rng = np.random.default_rng(seed)
    walls = 4.0 + 3.0 * np.sin(np.linspace(0.0, 9.0, 180))
    return np.round(walls + 0.02 * rng.standard_normal((n_scans, 180)), 2)


@pytest.mark.parametrize("code", [9.5, 9.99])
def test_undeclared_code_is_found_and_a_limit_proposed(code: float) -> None:
    ranges = noisy_room(100, seed=1)
    ranges[:, 30:40] = code
    ranges[7, 100] = code + 0.005  # another, rare value above it does not hide it
    report = inspect_log(FakeLog([scan(row) for row in ranges]))
    assert report.suspect is not None
    assert report.suspect.value == code
    assert report.suspect.share == pytest.approx(10 / 180, abs=1e-4)
    (sentence,) = sentences(report, "readings")
    assert f"are exactly {code:g} m" in sentence
    proposed = float(sentence.rsplit("=", 1)[1])
    assert 0.9 * code < proposed < code


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_standing_sensor_is_not_taken_for_a_code(noise: float) -> None:
    rows = noisy_room(300, seed=2) if noise else np.repeat(noisy_room(1, seed=2), 300, axis=0)
    assert inspect_log(FakeLog([scan(row) for row in rows])).suspect is None


def test_few_readings_are_not_taken_for_a_code() -> None:
    assert inspect_log(FakeLog([scan([1.0, 2.0, 9.0])] * 3)).suspect is None


@given(st.lists(st.lists(st.integers(1, 40), min_size=1, max_size=30), max_size=10))
def test_largest_values_are_counted_exactly(rows: list[list[int]]) -> None:
    statistics = LogStatistics()
    counts: Counter[float] = Counter()
    previous: list[int] | None = None
    for row in rows:
        statistics.add(scan(row, range_max=50.0))
        if row != previous:  # a repeated scan is no further evidence
            counts.update(map(float, row))
        previous = row
    assert statistics.top == {value: counts[value] for value in sorted(counts)[-16:]}


# ---- findings, mount, JSON


def test_a_finding_says_what_follows_and_what_to_try() -> None:
    ranges = noisy_room(100, seed=1)
    ranges[:, 30:40] = 9.5
    (found,) = (f for f in find_issues(inspect_log(FakeLog([scan(r) for r in ranges]))) if f.remedy)
    assert (found.topic, found.kind, found.argument) == ("readings", "undeclared_code", "range_max=9.4")
    assert found.sentence == f"{found.what}: {found.consequence}; try {found.argument}"


def test_mount_is_told_from_both_odometries() -> None:
    class Mounted(FakeLog):
        def robot_odometry(self) -> Trajectory | None:
            poses = np.array([[np.nan] * 3, [1.0, 2.0, math.pi / 2]])
            return Trajectory(stamps=np.arange(2.0), poses=poses)

        def hangs_upside_down(self) -> bool:
            return True

    laser = np.array([[0.0, 0.0, 0.0], [1.0, 2.5, 0.0]])
    log = Mounted([scan([1.0, 2.0]), scan([2.0, 1.0], 1.0)], odometry=Trajectory(stamps=np.arange(2.0), poses=laser))
    report = inspect_log(log)
    assert report.mount == pytest.approx((0.5, 0.0, -math.pi / 2), abs=1e-12)
    assert report.is_upside_down
    plain = inspect_log(FakeLog(log.scans, odometry=log.odometry))
    assert (plain.mount, plain.is_upside_down) == (None, False)


def test_a_report_is_strict_json_with_the_same_keys_for_every_log() -> None:
    codes = scan([1.0, math.nan, math.inf, -math.inf, 81.91] * 10)
    empty, full = (inspect_log(FakeLog(scans)) for scans in ([], [codes, codes]))
    one, two = (
        json.loads(json.dumps(report_as_plain(report, find_issues(report)), allow_nan=False))
        for report in (empty, full)
    )
    assert one.keys() == two.keys() == {"usable", "issues", "report"}
    assert one["report"].keys() == two["report"].keys() == {f.name for f in fields(LogReport)}
    assert one["report"]["time"].keys() == two["report"]["time"].keys()
    assert (one["usable"], two["usable"]) == (False, True)
    assert one["report"]["fov_deg"] is None
    assert {c["value"] for c in two["report"]["codes"]} == {"nan", "inf", "-inf", 81.91}
    assert [f["kind"] for f in one["issues"]] == ["too_few_scans", "no_odometry"]
    assert set(one["issues"][0]) == {"topic", "kind", "what", "consequence", "remedy", "mending"}


# ---- odometry, faults, notes


def test_odometry_is_measured() -> None:
    poses = np.array([[0, 0, 3.0], [3, 4, -3.0], [np.nan] * 3, [3, 4, -3.5]])
    stamps = np.arange(4.0)
    log = FakeLog([scan([1.0 + t, 2.0], t) for t in stamps], odometry=Trajectory(stamps=stamps, poses=poses))
    odometry = inspect_log(log).odometry
    assert odometry is not None
    assert odometry.path_length == 5.0
    # from 3 to -3 rad the short way round
    assert odometry.turned_deg == pytest.approx(math.degrees(2 * math.pi - 6.0 + 0.5))
    assert odometry.n_missing == 1
    assert sentences(inspect_log(log), "odometry") == [
        "1 of 4 scans have no odometry pose: odometry cannot help to match them"
    ]


def test_missing_odometry_is_said() -> None:
    report = inspect_log(FakeLog([scan([1.0, 2.0])]))
    assert report.odometry is None
    assert sentences(report, "odometry") == ["the log has no odometry: motion is estimated from the scans alone"]


def test_faults_and_notes_are_findings() -> None:
    log = at(0.0, 0.1)
    log.read_errors = (ReadError(rule="FLASER line cut short", count=3, first="line 17"),)
    log.notes = ("4 RLASER lines are not read",)
    assert sentences(inspect_log(log), "file") == [
        "FLASER line cut short: 3 times, first in line 17; the rest of the log is read",
        "4 RLASER lines are not read",
    ]


def test_broken_file_end_to_end(tmp_path: Path) -> None:
    path = write(tmp_path / "a.log", flaser(stamp=1), "FLASER 3 1", "NEFF 2", flaser(stamp=0.5))
    report = inspect_log(read_log(path))
    assert (report.n_scans, report.n_repeated_scans) == (2, 1)
    assert report.tag_counts == {"FLASER": 3, "NEFF": 1}
    assert {issue.topic for issue in find_issues(report)} == {"file", "scans", "time"}


# ---- laws


@given(st.lists(st.lists(st.floats(width=32), max_size=8).map(lambda values: scan(values)), max_size=8))
def test_any_scans_are_reported(scans: list[LaserScan]) -> None:
    report = inspect_log(FakeLog(scans))
    assert report.n_scans == len(scans) == sum(report.beam_counts.values())
    valid = np.concatenate([np.empty(0), *(s.ranges[s.valid] for s in scans)])
    if valid.size:
        assert report.largest_reading == valid.max()
    assert all(issue.sentence for issue in find_issues(report))


@pytest.mark.slow
def test_memory_does_not_grow_with_the_readings() -> None:
    class Stream(FakeLog):
        def __iter__(self) -> Iterator[LaserScan]:
            rng = np.random.default_rng(3)
            for i in range(len(self.scans)):
                yield scan(rng.uniform(0.0, 20.0, 180), float(i))

    def peak(n_scans: int) -> int:
        log = Stream([scan([1.0])] * n_scans)
        tracemalloc.start()
        inspect_log(log)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak(10)
    # 1,800 scans more: 8 bytes a stamp, copies of it for the median, what Python keeps for itself; against 2.6 MB
    # of ranges
    assert peak(2000) < peak(200) + 650_000


# ---- real logs


def test_intel(real_data: Path) -> None:
    report = inspect_log(read_log(real_data / "intel-lab/intel.clf.gz"))
    assert report.n_scans == 13_631
    assert report.beam_counts == {180: 13_631}
    assert report.time.n_back == 631
    assert [code.value for code in report.codes] == [81.83]
    assert report.largest_reading == 26.37
    assert report.suspect is None
    assert report.odometry is not None
    assert report.odometry.path_length == pytest.approx(508.0, abs=1.0)
    assert sentences(report, "time")[0] == (
        "631 of 13,630 time steps go back, by up to 0.897 s: scans are taken in file order, stamps are kept as they are"
    )
    assert report.is_usable


@pytest.mark.parametrize(
    ("name", "code"), [("intel-lab/intel-corrected.log.gz", 81.83), ("malaga-sena-loop/malaga-sena-loop.clf.gz", 81.87)]
)
def test_code_of_a_real_log_is_found_when_the_limit_is_lifted(real_data: Path, name: str, code: float) -> None:
    lifted = inspect_log(read_log(real_data / name, range_max=100.0))
    assert lifted.suspect is not None
    assert lifted.suspect.value == code
    (issue,) = (issue for issue in find_issues(lifted) if issue.topic == "readings")
    assert issue.remedy is not None
    assert issue.remedy.argument == "range_max"
    repaired = inspect_log(read_log(real_data / name, range_max=float(issue.remedy.value)))
    assert repaired.suspect is None
    assert repaired.valid_share == inspect_log(read_log(real_data / name)).valid_share


def test_belgioioso_has_no_usable_time(real_data: Path) -> None:
    report = inspect_log(read_log(real_data / "keyframed-corrected/belgioioso-corrected.log.gz"))
    assert sentences(report, "time")[0] == (
        "all stamps are equal: scans are taken in file order, rate and speeds are unknown"
    )
    assert report.is_usable


def test_mumble_runs_clockwise_and_keeps_old_values(real_data: Path) -> None:
    path = real_data / "mumble-rplidar-a1/kitchen_1"
    report = inspect_log(read_log(path))
    assert 0.25 < report.stale_share < 0.4
    options = {f.kind: f.argument for f in find_issues(report) if f.topic == "beams"}
    assert options == {"stale_beams": "drop_stale=True", "turns_against": "clockwise=True", "gyro_in_degrees": ""}
    repaired = inspect_log(read_log(path, clockwise=True))
    assert repaired.sense is not None
    assert repaired.sense.is_along


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "turtlebot4-rplidar/macfirst_floor_take_2",
        "malaga-sena-loop/malaga-sena-loop.clf.gz",
        "leg-tracker-people/general_tracking_moving_1.bag.gz",
    ],
)
def test_sound_logs_turn_with_their_wheels(real_data: Path, name: str) -> None:
    report = inspect_log(read_log(real_data / name))
    assert report.sense is not None
    assert report.sense.is_along
    assert report.mount is not None
    kinds = {f.kind for f in find_issues(report) if f.topic == "beams"}
    # the driver of the TurtleBot lists its beams in the reverse of the order in which they were swept
    assert kinds <= ({"beams_reversed"} if name.startswith("turtlebot4") else set())


@pytest.mark.slow
def test_a_sensor_that_stands_has_no_robot_in_sight(real_data: Path) -> None:
    for name in ("demo_stationary_simple_environment", "positive_1"):
        report = inspect_log(read_log(real_data / f"leg-tracker-people/{name}.bag.gz"))
        assert not [f for f in find_issues(report) if f.topic == "beams"]


def test_scans_and_the_path_of_a_log_are_inspected_as_a_log_is(tmp_path: Path) -> None:
    path = write(tmp_path / "a.clf", flaser([1.0, 2.0]), flaser([1.0, 2.5]))
    log = read_log(path)
    assert str(inspect_log(path)) == str(inspect_log(str(path))) == str(inspect_log(log))
    assert inspect_log([*log]).n_scans == 2
    with pytest.raises(InvalidArgumentError, match="a log must be a Log, an iterable of LaserScan"):
        inspect_log([1, 2])  # type: ignore[list-item]
