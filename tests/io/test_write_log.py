"""Logs written and read again: by ourselves, to the bit, and by others' readers."""

from __future__ import annotations

import csv
import gzip
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from curvescan.cli.commands.info import FormatName
from curvescan.errors import InvalidArgumentError, OutputError
from curvescan.io import WRITERS, MemoryLog, log_from_arrays, read_log, write_log
from curvescan.io.log import Log, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from tests.logs import assert_same_scan, assert_same_scans, rich_log, short

NAMES = {"carmen": "a.clf", "csv": "a.csv", "npz": "a.npz", "ros1": "a.bag", "ros2": "a", "mcap": "a.mcap"}
BAGS = ("ros1", "ros2", "mcap")


def test_tables_name_the_same_formats() -> None:
    assert tuple(WRITERS) == get_args(FormatName) == tuple(NAMES)


@pytest.mark.parametrize("name", ["csv", "npz", *BAGS])
def test_scans_come_back_to_the_bit(tmp_path: Path, name: str) -> None:
    log = rich_log()
    assert write_log(tmp_path / NAMES[name], log) == ()
    back = read_log(tmp_path / NAMES[name])
    assert back.read_errors == ()
    assert_same_scans(log, back)


@pytest.mark.parametrize("name", ["csv", "npz"])
def test_float64_and_uneven_beams_come_back_to_the_bit(tmp_path: Path, name: str) -> None:
    log = rich_log(uneven=True, digits=np.float64)
    assert not all(scan.has_uniform_angles for scan in log)
    assert write_log(tmp_path / NAMES[name], log) == ()
    assert_same_scans(log, read_log(tmp_path / NAMES[name]))


finite = st.floats(allow_nan=False, allow_infinity=False)
readings = st.lists(st.floats(width=64), max_size=6)
logs = st.lists(
    st.builds(
        lambda ranges, stamp, start, step, limit: LaserScan(
            ranges, angle_min=start, angle_increment=step, range_max=limit, stamp=stamp
        ),
        readings,
        finite,
        st.floats(-7, 7),
        st.floats(1e-3, 1.0) | st.floats(-1.0, -1e-3),
        st.floats(min_value=1e-300, allow_nan=False),
    ),
    min_size=1,
    max_size=4,
)


@pytest.mark.parametrize("name", ["csv", "npz"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(scans=logs)
def test_any_float64_comes_back(tmp_path: Path, name: str, scans: list[LaserScan]) -> None:
    log = MemoryLog(scans=tuple(scans))
    write_log(tmp_path / NAMES[name], log)
    assert_same_scans(log, read_log(tmp_path / NAMES[name]))


@pytest.mark.parametrize("name", ["csv", "npz", *BAGS])
def test_odometry_comes_back(tmp_path: Path, name: str) -> None:
    log = rich_log(n=4)  # of which the first has none
    write_log(tmp_path / NAMES[name], log)
    back = read_log(tmp_path / NAMES[name]).odometry
    assert log.odometry is not None
    assert back is not None
    # through a quaternion the angle loses its last digit
    np.testing.assert_allclose(back.poses, log.odometry.poses, rtol=0, atol=1e-15 if name in BAGS else 0)


@pytest.mark.parametrize("name", NAMES)
def test_without_odometry_there_is_none(tmp_path: Path, name: str) -> None:
    log = replace(rich_log(), odometry=None)
    write_log(tmp_path / NAMES[name], log)
    assert read_log(tmp_path / NAMES[name]).odometry is None


@pytest.mark.parametrize("name", BAGS)
def test_float32_is_what_a_message_keeps(tmp_path: Path, name: str) -> None:
    log = rich_log(digits=np.float64)
    (loss,) = write_log(tmp_path / NAMES[name], log)
    assert "float32" in loss
    for before, after in zip(log, read_log(tmp_path / NAMES[name]), strict=True):
        np.testing.assert_array_equal(after.ranges, before.ranges.astype(np.float32))
        assert after.angle_increment == short(before.angle_increment)


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("stamp", [0.0, 1e-9, 12.3, 1_700_000_000.999999, 0.999999999, 2e9 + 0.1])
def test_stamps_to_the_nanosecond(tmp_path: Path, name: str, stamp: float) -> None:
    path = tmp_path / NAMES[name]
    write_log(path, log_from_arrays([(stamp, [1.0])], angle_min=0, angle_increment=0.125))
    assert [scan.stamp for scan in read_log(path)] == [stamp]


def test_stamps_that_a_bag_cannot_hold(tmp_path: Path) -> None:
    for stamp, name in ((-0.5, "ros1"), (2.0**32, "ros1"), (2.0**31, "mcap"), (-(2.0**31) - 1, "ros2")):
        log = log_from_arrays([(0.0, [1.0]), (stamp, [1.0])], angle_min=0, angle_increment=0.125)
        with pytest.raises(OutputError, match=r"cannot write the stamp .* its seconds must lie in"):
            write_log(tmp_path / NAMES[name], log)
    log = log_from_arrays([(-0.25, [1.0])], angle_min=0, angle_increment=0.125)
    write_log(tmp_path / "b.mcap", log)
    assert [scan.stamp for scan in read_log(tmp_path / "b.mcap")] == [-0.25]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.mcap"]


@pytest.mark.parametrize("name", [*BAGS, "carmen"])
def test_uneven_beams_are_refused_where_they_cannot_be_said(tmp_path: Path, name: str) -> None:
    with pytest.raises(OutputError, match=r"evenly spaced beams.*CSV and NPZ keep them"):
        write_log(tmp_path / NAMES[name], rich_log(uneven=True))
    assert not list(tmp_path.iterdir())


# ---- CARMEN


def test_carmen_keeps_points_stamps_and_poses(tmp_path: Path) -> None:
    log = rich_log(digits=np.float64)
    known = rich_log().odometry
    assert known is not None
    log = replace(log, odometry=replace(known, poses=np.nan_to_num(known.poses)))
    losses = write_log(tmp_path / "a.clf", log)
    assert {loss.split(":")[0] for loss in losses} == {
        "range_min",
        "time_increment and scan_time",
        "the direction of the sweep",
    }
    back = read_log(tmp_path / "a.clf")
    assert back.read_errors == ()
    for before, after in zip(log, back, strict=True):
        assert after.stamp == before.stamp
        turned = slice(None, None, -1 if before.angle_increment < 0 else 1)
        if len(before):
            np.testing.assert_array_equal(after.valid, before.valid[turned])
            points = before.points[turned][after.valid]
            np.testing.assert_allclose(after.points[after.valid], points, rtol=1e-12)
        else:
            assert not after.valid.any()
    assert back.odometry is not None
    assert log.odometry is not None
    np.testing.assert_array_equal(back.odometry.poses, log.odometry.poses)


def test_carmen_with_gaps_in_the_odometry(tmp_path: Path) -> None:
    log = rich_log(n=4)
    write_log(tmp_path / "a.clf", log)
    back = read_log(tmp_path / "a.clf")
    assert back.tag_counts == {"#": 1, "ODOM": 3, "RAWLASER1": 4}
    assert back.odometry is not None
    assert log.odometry is not None
    np.testing.assert_array_equal(back.odometry.poses, log.odometry.poses)


def test_carmen_where_the_odometry_ends_and_begins_anew(tmp_path: Path) -> None:
    scans = tuple(rich_log(n=7, digits=np.float64))
    poses = np.array([[1.0, 2.0, 0.5]] * 7)
    poses[[0, 2, 3, 6]] = np.nan
    odometry = Trajectory(stamps=np.array([scan.stamp for scan in scans]), poses=poses)
    write_log(tmp_path / "a.clf", MemoryLog(scans=scans, odometry=odometry))
    back = read_log(tmp_path / "a.clf")
    assert back.read_errors == ()
    assert back.odometry is not None
    np.testing.assert_array_equal(back.odometry.poses, poses)


def test_carmen_to_the_bit_where_it_says_all(tmp_path: Path) -> None:
    scan = LaserScan([1.0, np.nan, np.inf, 0.1], angle_min=-1.1, angle_increment=0.1, range_max=8.0, stamp=0.1)
    log = MemoryLog(scans=(scan, replace(scan, intensities=np.arange(4.0))))
    assert write_log(tmp_path / "a.log", log) == ()
    for before, after in zip(log, read_log(tmp_path / "a.log"), strict=True):
        assert_same_scan(before, after)


# ---- others' readers


@pytest.mark.parametrize("name", BAGS)
def test_rosbags_reads_the_bags(tmp_path: Path, name: str) -> None:
    log = rich_log()
    path = tmp_path / NAMES[name]
    write_log(path, log)
    if name == "mcap":  # its high-level reader takes folders
        path.rename(tmp_path / "folder.mcap")
        path = tmp_path / "folder.mcap"
    store = get_typestore(Stores.ROS1_NOETIC if name == "ros1" else Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        assert {c.topic: c.msgtype for c in reader.connections} == {
            "/scan": "sensor_msgs/msg/LaserScan",
            "/odom": "nav_msgs/msg/Odometry",
        }
        wanted = [c for c in reader.connections if c.topic == "/scan"]
        messages = list(reader.messages(wanted))
        assert [when for _, when, _ in messages] == sorted({when for _, when, _ in messages})
        for scan, (connection, _, data) in zip(log, messages, strict=True):
            message: Any = reader.deserialize(data, connection.msgtype)
            np.testing.assert_array_equal(message.ranges, scan.ranges.astype(np.float32))
            stamp = message.header.stamp
            assert (stamp.sec, stamp.nanosec) == divmod(round(scan.stamp * 1e6) * 1000, 10**9)
            assert message.header.frame_id == "laser"
            assert message.time_increment == scan.time_increment
            assert len(message.intensities) in (0, len(scan))


def test_numpy_reads_the_arrays(tmp_path: Path) -> None:
    log = rich_log()
    write_log(tmp_path / "a.npz", log)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert arrays["stamps"].tolist() == [scan.stamp for scan in log]
        assert arrays["ranges"].dtype == np.float32  # all that the scans have
        for row, count, scan in zip(arrays["ranges"], arrays["counts"], log, strict=True):
            np.testing.assert_array_equal(row[:count], scan.ranges)
            assert np.isnan(row[count:]).all()
        assert log.odometry is not None
        np.testing.assert_array_equal(arrays["odometry"], log.odometry.poses)


def test_csv_reads_the_rows(tmp_path: Path) -> None:
    log = replace(rich_log(), odometry=None)
    write_log(tmp_path / "a.csv", log)
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = [row for row in csv.reader(file) if not row[0].startswith("#")]
    assert rows[0][0] == "stamp"
    scans = [row for row in rows[1:] if row[0] != "intensities"]
    for row, scan in zip(scans, log, strict=True):
        assert float(row[0]) == scan.stamp
        np.testing.assert_array_equal(np.array(row[7:], dtype=float), scan.ranges)


# ---- places and names


def test_the_ending_chooses_and_format_overrides(tmp_path: Path) -> None:
    log = rich_log()
    write_log(tmp_path / "a.CSV", log)
    write_log(tmp_path / "a.dat", log, format="npz")
    write_log(tmp_path / "a.csv.gz", log)
    assert read_log(tmp_path / "a.CSV").format == "CSV of scans"
    assert read_log(tmp_path / "a.dat").format == "NPZ of scans"
    assert gzip.decompress((tmp_path / "a.csv.gz").read_bytes()) == (tmp_path / "a.CSV").read_bytes()


@pytest.mark.parametrize(
    ("name", "options", "sentence"),
    [
        ("a.xyz", {}, r"no format is known by the ending '.xyz' of a.xyz: give one of .clf"),
        ("a.csv", {"format": "pcd"}, "unknown format 'pcd': known are carmen, csv, npz, "),
        ("a.bag.gz", {}, "only text is written gzip-compressed"),
    ],
)
def test_what_is_wrong_with_the_name_is_told(tmp_path: Path, name: str, options: dict[str, str], sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        write_log(tmp_path / name, rich_log(), **options)  # type: ignore[arg-type]


def test_the_log_itself_is_not_overwritten(tmp_path: Path) -> None:
    source = tmp_path / "a.csv"
    write_log(source, rich_log())
    (tmp_path / "link.csv").symlink_to(source)
    before = source.read_bytes()
    for target in (source, tmp_path / "link.csv", tmp_path / "x" / ".." / "a.csv"):
        with pytest.raises(OutputError, match="is the log itself"):
            write_log(target, read_log(source), source=source)
    bag = tmp_path / "bag"
    write_log(bag, rich_log())
    with pytest.raises(OutputError, match="lies within the log"):
        write_log(bag / "scans.db3", read_log(bag), source=bag, format="csv")
    with pytest.raises(OutputError, match=r"lies within the log .* or around it"):
        write_log(tmp_path, read_log(source), source=source, format="ros2")
    assert source.read_bytes() == before


def test_places_that_are_taken(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    write_log(tmp_path / "folder", rich_log())  # an empty one is free
    with pytest.raises(OutputError, match="a ROS 2 bag is a folder of its own: remove it"):
        write_log(tmp_path / "folder", rich_log())
    with pytest.raises(OutputError, match="is a folder: a result needs a file"):
        write_log(tmp_path / "folder", rich_log(), format="csv")
    with pytest.raises(OutputError, match=r"cannot hold \?, # or %"):
        write_log(tmp_path / "50%" / "bag", rich_log())


class Failing(MemoryLog):
    """A log that breaks in its midst."""

    def __iter__(self) -> Iterator[LaserScan]:
        yield self.scans[0]
        raise KeyboardInterrupt


@pytest.mark.parametrize("name", NAMES)
def test_after_an_interrupt_all_is_as_before(tmp_path: Path, name: str) -> None:
    path = tmp_path / NAMES[name]
    if name != "ros2":
        path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        write_log(path, Failing(scans=rich_log().scans))
    assert [p.name for p in tmp_path.iterdir()] == ([] if name == "ros2" else [path.name])
    assert name == "ros2" or path.read_bytes() == b"old"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device on this system")
def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    open_file = Path.open

    def open_full(path: Path, *args: Any, **kwargs: Any) -> Any:
        return open_file(Path("/dev/full"), "wb") if path.name == "a.csv" else open_file(path, *args, **kwargs)

    monkeypatch.setattr(Path, "open", open_full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_log(tmp_path / "a.csv", rich_log(n=200))


class Repeated(ScanAccess):
    """A log of many scans that takes no room."""

    name, format, odometry, read_errors, notes = "many", "many", None, (), ()
    tag_counts: dict[str, int] = {}  # noqa: RUF012

    def __init__(self, n: int) -> None:
        self.n = n
        ranges = np.linspace(1.0, 2.0, 500, dtype=np.float32)
        self.scan = LaserScan(ranges, angle_min=0.0, angle_increment=0.01)

    def __len__(self) -> int:
        return self.n

    def __iter__(self) -> Iterator[LaserScan]:
        return (replace(self.scan, stamp=0.5 * i) for i in range(self.n))


@pytest.mark.parametrize("name", NAMES)
def test_memory_does_not_grow_with_the_log(tmp_path: Path, name: str) -> None:
    # its readings are 12 MB; a chunk of a bag is 1 MiB, twice while it is written. Text takes long: 3 MB, by the line
    n, limit = (800, 2 << 20) if WRITERS[name].is_text else (3000, 6 << 20)
    log: Log = Repeated(n)
    tracemalloc.start()
    write_log(tmp_path / NAMES[name], log)
    written = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    for _ in read_log(tmp_path / NAMES[name]):
        pass
    read = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert max(written, read) < limit


class ChangingLog(ScanAccess):
    """A log whose length changes from one reading to the next, as that of a file that is still written."""

    name, format, odometry, notes, read_errors, tag_counts = ("a.log", "test", None, (), (), MappingProxyType({}))

    def __init__(self, *lengths: int) -> None:
        self._lengths, self._n_readings = lengths, 0

    def __len__(self) -> int:
        return self._lengths[0]

    def __iter__(self) -> Iterator[LaserScan]:
        n = self._lengths[min(self._n_readings, len(self._lengths) - 1)]
        self._n_readings += 1
        return iter(
            LaserScan(
                np.full(5, 1.0 + k),
                angle_min=0.0,
                angle_increment=0.1,
                stamp=float(k),
                intensities=np.full(5, float(k)),
            )
            for k in range(n)
        )


def test_a_log_that_changes_while_it_is_read(tmp_path: Path) -> None:
    assert write_log(tmp_path / "a.npz", ChangingLog(4, 6, 3)) == ()
    written = list(read_log(tmp_path / "a.npz"))
    assert [scan.ranges[0] for scan in written] == [1.0 + k for k in range(4)]  # of one reading
    assert [scan.intensities[0] for scan in written] == list(range(4))
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_scans_alone_are_written(tmp_path):
    scan = LaserScan([1.0, 2.5, np.nan], angle_min=0.0, angle_increment=0.1, range_max=8.0)
    write_log(tmp_path / "x.csv", [scan])
    np.testing.assert_array_equal(read_log(tmp_path / "x.csv")[0].ranges, scan.ranges)
    with pytest.raises(InvalidArgumentError, match="a log must be a Log, an iterable of LaserScan"):
        write_log(tmp_path / "y.csv", scan)
    assert not (tmp_path / "y.csv").exists()
    with pytest.raises(InvalidArgumentError, match="the file to write must be given as a path, got list"):
        write_log([scan], tmp_path / "y.csv")
