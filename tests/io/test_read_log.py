"""read_log: formats told apart by content, and one clear sentence for each file that is no log."""

from __future__ import annotations

import bz2
import gzip
import io
import os
import pkgutil
import sqlite3
import subprocess
import sys
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from curvescan.errors import CurvescanError, InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io import Log, read_log
from curvescan.io.files.lines import BROKEN_GZIP, GZIP_MAGIC, read_head
from curvescan.io.reading import FORMATS, LogFormat, find_format
from tests.bags import scan, storage, write_bag
from tests.carmen_files import configured, flaser, odom, write

TEXT = "\n".join(flaser([1.0 + 0.37 * i] * 180, stamp=i) for i in range(300)).encode()
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"

BAGS = {"ROS 1 bag": "ros1", "ROS 2 bag (sqlite3)": "sqlite3", "ROS 2 bag (MCAP)": "mcap"}


def sample_of(name: str, folder: Path) -> bytes:
    """Return a sound file with one scan of the format whose row has this name."""
    if name in BAGS:
        return storage(write_bag(folder / "source", BAGS[name], [scan()])).read_bytes()
    if name == "NPZ of scans":
        buffer = io.BytesIO()
        np.savez(buffer, stamps=[1.0], ranges=[[1.0, 2.0]], angle_min=0.0, angle_increment=0.1)
        return buffer.getvalue()
    return {
        "CARMEN log": flaser().encode(),
        "CSV of scans": b"stamp,angle_min,angle_increment,ranges\n1.0,-1.0,0.5,1.0,2.0\n",
        "CoreSLAM log": b" ".join([b"5"] * 707) + b"\n",
    }[name]


@pytest.mark.parametrize("row", FORMATS, ids=lambda row: row.name)
def test_each_row_sniffs_its_sample_and_gives_a_log(row: LogFormat, tmp_path: Path) -> None:
    sample = sample_of(row.name, tmp_path)
    path = tmp_path / "sample"
    path.write_bytes(sample)
    assert row.sniff(sample)
    assert not row.sniff(b"")
    assert not row.sniff(PNG)
    log = pkgutil.resolve_name(row.reader)(path, range_max=7.5, topic=None)
    assert isinstance(log, Log)
    assert log.format == row.name
    assert len(list(log)) == len(log) == 1
    assert {scan.range_max for scan in log} == {7.5}
    assert find_format(sample, path) is row


def test_reader_is_imported_only_when_a_file_of_its_format_is_met() -> None:
    code = "import curvescan.io, sys; assert not {'curvescan.io.carmen.log', 'rosbags'} & {*sys.modules}"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ["a.clf", "a.gz", "a.bag", "a"])
@pytest.mark.parametrize("is_packed", [False, True])
def test_the_name_of_the_file_never_decides(tmp_path: Path, name: str, is_packed: bool) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(TEXT) if is_packed else TEXT)
    log = read_log(path)
    assert [scan.stamp for scan in log] == list(range(300))
    assert log.read_errors == ()


@pytest.mark.parametrize(
    "first",
    [
        "# CARMEN Logfile",
        "PARAM robot_use_laser on nohost 0",
        "SYNC",
        odom(1, 2, 3),
        configured(),
        configured(tag="RAWLASER1"),
        "# any other comment",
        "   ",
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_carmen_is_known_by_any_of_its_lines(tmp_path: Path, first: str, end: str) -> None:
    assert len(read_log(str(write(tmp_path / "a", first, flaser(), end=end)))) >= 1


def test_carmen_behind_a_long_preamble(tmp_path: Path) -> None:
    lines = [f"PARAM some_parameter_{i} {i} nohost 0" for i in range(5000)]
    assert len(read_log(write(tmp_path / "a", *lines, flaser()))) == 1


@pytest.mark.parametrize("range_max", [5.0, float("inf")])
def test_range_max_reaches_the_scans(tmp_path: Path, range_max: float) -> None:
    path = write(tmp_path / "a", flaser())
    assert {scan.range_max for scan in read_log(path, range_max=range_max)} == {range_max}


@pytest.mark.parametrize("range_max", [0.0, -1.0, float("nan"), float("-inf")])
def test_range_max_must_be_positive(tmp_path: Path, range_max: float) -> None:
    path = write(tmp_path / "a", flaser())
    with pytest.raises(InvalidArgumentError, match="range_max must be a positive number"):
        read_log(path, range_max=range_max)
    with pytest.raises(InvalidArgumentError, match="range_max must be a number, got 'a'"):
        read_log(path, range_max="a")  # type: ignore[arg-type]


# ---- files that cannot be opened


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(LogFileError, match=r"none\.log does not exist: check the path"):
        read_log(tmp_path / "none.log")


def test_path_below_a_file(tmp_path: Path) -> None:
    path = write(tmp_path / "a", flaser())
    with pytest.raises(LogFileError, match="Not a directory"):
        read_log(path / "b")


def test_path_that_cannot_exist() -> None:
    with pytest.raises(LogFileError, match="cannot open"):
        read_log("a\0b")


def test_folder(tmp_path: Path) -> None:
    write(tmp_path / "a.clf", flaser())
    with pytest.raises(LogFileError, match=r"is a folder without one: give the path of a log"):
        read_log(tmp_path)
    with pytest.raises(LogFileError, match=r"a log must be a file, and .* is a folder"):
        read_head(tmp_path, 1)


def test_carmen_has_no_topics(tmp_path: Path) -> None:
    path = write(tmp_path / "a", flaser())
    with pytest.raises(InvalidArgumentError, match=r"CARMEN log, which has no topics.*leave it out"):
        read_log(path, topic="/scan")


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a", flaser())

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    # the tests may run as root, whom no access right stops
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(LogFileError, match=r"no permission to read .*check its access rights"):
        read_log(path)


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="no /proc on this system")
def test_file_that_opens_and_cannot_be_read() -> None:
    # nothing is mapped at address 0, so the first read fails
    with pytest.raises(LogFileError, match="cannot read /proc/self/mem"):
        read_log("/proc/self/mem")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(LogFileError, match="must be a regular file"):
        read_log(tmp_path / "pipe")


# ---- files that are no log


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty: a log must hold at least one scan"),
        (b" \n\n ", "is empty"),
        (PNG, "is a PNG picture"),
        (b"#ROSBAG V2.0\n\x45\x00", "is a ROS 1 bag that cannot be read"),
        (b"\x89MCAP0\r\n\x01", r"is a ROS 2 bag \(MCAP\) that cannot be read"),
        (bz2.compress(TEXT), "is compressed with bzip2.*unpack it first"),
        (b"\x00\x01\x02\x03" * 50, "binary data of an unknown format; read are: .*CARMEN log"),
        (b"\nstamp,x,y\n1,2,3\n", r"text of an unknown format \(it begins 'stamp,x,y'\)"),
        (b"FLASERS 3 1 2 3", "text of an unknown format"),
    ],
)
@pytest.mark.parametrize("is_packed", [False, True])
def test_other_content_is_named(tmp_path: Path, content: bytes, sentence: str, is_packed: bool) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(gzip.compress(content) if is_packed else content)
    with pytest.raises(LogFormatError, match=sentence):
        read_log(path)


def test_gzip_within_gzip(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(gzip.compress(gzip.compress(TEXT)))
    with pytest.raises(LogFormatError, match=r"compressed twice with gzip.*unpack it first"):
        read_log(path)


def test_database_that_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    connection = sqlite3.connect(path)
    connection.execute("create table topics (id integer)")
    connection.close()
    with pytest.raises(
        LogFormatError, match=r"SQLite database without the tables messages and topics .*: it holds topics$"
    ):
        read_log(path)


def test_carmen_without_a_scan(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"CARMEN log without a scan.* holds ODOM"):
        read_log(write(tmp_path / "a", odom(1, 2, 3)))


# ---- damaged compression


def test_truncated_gzip_delivers_what_stands_before_the_cut(tmp_path: Path) -> None:
    packed = gzip.compress(TEXT)
    path = tmp_path / "a.log.gz"
    n_before = 0
    for share in (0.25, 0.5, 0.9):
        path.write_bytes(packed[: int(share * len(packed))])
        log = read_log(path)
        stamps = [scan.stamp for scan in log]
        assert stamps == list(range(len(stamps)))
        assert len(log) == len(stamps)
        assert n_before < len(stamps) < 300
        n_before = len(stamps)
        assert BROKEN_GZIP in {read_error.rule for read_error in log.read_errors}


def test_truncated_gzip_loses_no_whole_line(tmp_path: Path) -> None:
    packed = gzip.compress(TEXT)
    n_bytes = len(packed) // 2
    # what zlib itself makes of the first half
    text = zlib.decompressobj(wbits=31).decompress(packed[:n_bytes])
    path = tmp_path / "a.log.gz"
    path.write_bytes(packed[:n_bytes])
    log = read_log(path)
    assert len(log) == text.count(b"\n")
    broken = next(read_error for read_error in log.read_errors if read_error.rule == BROKEN_GZIP)
    assert (broken.count, broken.first) == (1, f"line {len(log) + 1}")


@pytest.mark.parametrize(("text", "n_scans"), [(TEXT, 300), (flaser().encode(), 1)])
def test_gzip_without_its_check_sum_delivers_all(tmp_path: Path, text: bytes, n_scans: int) -> None:
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(text)[:-8])
    log = read_log(path)
    assert len(log) == n_scans
    assert [read_error.rule for read_error in log.read_errors] == [BROKEN_GZIP]


def test_gzip_with_junk_behind_it_delivers_all(tmp_path: Path) -> None:
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(TEXT) + b"junk")
    log = read_log(path)
    assert len(log) == 300
    assert [read_error.rule for read_error in log.read_errors] == [BROKEN_GZIP]


@pytest.mark.parametrize(
    "content",
    [GZIP_MAGIC, gzip.compress(TEXT, mtime=0)[:12], GZIP_MAGIC + b"junk" * 9],
    ids=["magic only", "cut in the header", "junk"],
)
def test_gzip_of_which_nothing_can_be_read(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.log.gz"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match="starts like a gzip file but cannot be unpacked"):
        read_log(path)


def test_file_that_unpacks_to_very_much_takes_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "bomb.gz"
    path.write_bytes(gzip.compress(flaser().encode() + b"\n" + b" " * 50_000_000))
    tracemalloc.start()
    log = read_log(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(log) == 1
    assert peak < 8 << 20  # of 50 MB


# ---- laws

words = [b"FLASER ", b"4 ", b"1.5 ", b"nan ", b"\n", b"\r\n", b"PARAM ", b"\x00", b"\xff", b"# "]
sound = [flaser().encode() + b"\n", configured().encode() + b"\n"]
table = [
    b"stamp,angle_min,angle_increment,x,ranges\n",
    b"1,0,0.1,,5,6\n",
    b"angles,0,1,3\n",
    b"intensities,7,8\n",
    b"1,,,,2,3\n",
    b",",
    b"-",
    b"1",
]
tables = st.lists(st.sampled_from(table), max_size=20).map(lambda rows: table[0] + b"".join(rows))
fragments = st.sampled_from([*words, *sound, GZIP_MAGIC])
contents = st.one_of(
    st.binary(max_size=300),
    st.lists(fragments, max_size=40).map(b"".join),
    tables,
    st.binary(max_size=60).map(lambda junk: GZIP_MAGIC + junk),
    st.tuples(st.lists(fragments, max_size=20).map(b"".join), st.integers(0, 40)).map(
        lambda pair: gzip.compress(pair[0])[: -pair[1] or None]
    ),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300, deadline=None)
@given(content=contents)
def test_arbitrary_bytes_give_a_log_or_an_error_of_ours(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a"
    path.write_bytes(content)
    try:
        log = read_log(path)
    except CurvescanError:
        return
    assert len(list(log)) == len(log) > 0


def test_real_carmen_log(real_data: Path) -> None:
    assert len(read_log(real_data / "intel-lab/intel.clf.gz")) == 13_631


def test_an_address_is_no_file():
    with pytest.raises(
        LogFileError, match=r"s3://bucket/a\.bag is an address, and a log is read from a file: download it first"
    ):
        read_log("s3://bucket/a.bag")


def test_text_of_another_format_names_the_page_that_helps(tmp_path):
    (tmp_path / "diary.txt").write_text("Dear diary\n")
    with pytest.raises(LogFormatError, match=r"docs/howto/format\.md shows how to read any other in eight lines"):
        read_log(tmp_path / "diary.txt")
