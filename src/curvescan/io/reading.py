"""read_log and read_poses: the table of log formats, and how a file's first bytes identify them."""

import os
import pkgutil
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from curvescan.errors import LogFileError, LogFormatError, require
from curvescan.io.arrays.coreslam import N_COLUMNS
from curvescan.io.arrays.csv_file import header_names, is_content
from curvescan.io.files.lines import as_path, read_head
from curvescan.io.log import Log
from curvescan.io.ros.bags.bag_files import BagKind, storage_files
from curvescan.io.sensor_setup import SensorSetup, apply_setup
from curvescan.io.trajectories.layouts import first_line, is_our_csv, results_file
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import as_float

HEAD_BYTES = 1 << 16  # how many unpacked bytes a sniff gets: room for the long PARAM preamble of a CARMEN log


class LogReader(Protocol):
    """Opens a log of one format; the function or class a row of the table names."""

    def __call__(self, path: Path, *, range_max: float | None, topic: str | None) -> Log:
        """Return the log, which holds a scan; range_max: in place of the log's limit; topic: of several lasers."""


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """One row of the table of formats."""

    name: str  # in words: ``"CARMEN log"``
    sniff: Callable[[bytes], bool]
    """Whether the first HEAD_BYTES of a file, unpacked, look like this format. It never raises."""
    reader: str  # ``"module:function"`` of a LogReader


_CARMEN_TAGS = re.compile(
    rb"^[ \t]*(# *CARMEN Logfile|(PARAM|SYNC|ODOM|TRUEPOS|NEFF|[FR]LASER|LASER[3-5]"
    rb"|RAWLASER[1-5]|ROBOTLASER[1-5])[ \t\r]*([ \t\r\n]|\Z))",
    re.MULTILINE,
)


def is_carmen(head: bytes) -> bool:
    """Return whether a line starts with CARMEN's header or one of its message names."""
    return _CARMEN_TAGS.search(head) is not None


def is_csv(head: bytes) -> bool:
    """Return whether the first line that is no comment names columns of scans."""
    line = next((line for line in head.splitlines() if is_content(line)), b"")
    names = header_names(line[:4096])
    return "stamp" in names and ("ranges" in names or "angle_min" in names)


def is_npz(head: bytes) -> bool:
    """Return whether it is a zip archive whose first member is an array of NumPy."""
    n_name = int.from_bytes(head[26:28], "little")
    return head.startswith(b"PK\x03\x04") and head[30 : 30 + n_name].endswith(b".npy")


def is_coreslam(head: bytes) -> bool:
    """Return whether the first line has as many columns as a CoreSLAM log, all of them numbers."""
    fields = next((line for line in head.splitlines() if line.strip()), b"").split()
    return len(fields) in N_COLUMNS and all(map(_NUMBER.fullmatch, fields))


_NUMBER = re.compile(rb"[-+]?[0-9.]+(e[-+]?[0-9]+)?")

FORMATS: tuple[LogFormat, ...] = (
    *(LogFormat(name=kind.value, sniff=kind.begins, reader="curvescan.io.ros.reader:RosbagLog") for kind in BagKind),
    LogFormat(name="NPZ of scans", sniff=is_npz, reader="curvescan.io.arrays.npz:open_npz"),
    LogFormat(name="CSV of scans", sniff=is_csv, reader="curvescan.io.arrays.csv_file:open_csv"),
    LogFormat(name="CoreSLAM log", sniff=is_coreslam, reader="curvescan.io.arrays.coreslam:open_coreslam"),
    LogFormat(name="CARMEN log", sniff=is_carmen, reader="curvescan.io.carmen.log:CarmenLog"),
)

_OWN_FORMAT = "https://github.com/curvescan/curvescan/blob/main/docs/howto/format.md"
_UNPACK = "unpack it first"
_FOREIGN: tuple[tuple[bytes, str, str], ...] = (
    (b"BZh", "compressed with bzip2", _UNPACK),
    (b"\xfd7zXZ\x00", "compressed with xz", _UNPACK),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd", _UNPACK),
    (b"\x1f\x8b", "compressed twice with gzip", _UNPACK),
    (b"PK\x03\x04", "a zip archive", _UNPACK),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", "give the log itself"),
    (b"\xff\xd8\xff", "a JPEG picture", "give the log itself"),
    (b"%PDF", "a PDF document", "give the log itself"),
)


def find_format(head: bytes, path: Path) -> LogFormat:
    """Return the row of the table that a file belongs to. Raises LogFormatError."""
    if not head.strip():
        raise LogFormatError(f"{path} is empty: a log must hold at least one scan")
    for row in FORMATS:
        if row.sniff(head):
            return row
    for magic, kind, remedy in _FOREIGN:
        if head.startswith(magic):
            raise LogFormatError(f"{path} is {kind}, not a log that can be read: {remedy}")
    known = ", ".join(row.name for row in FORMATS)
    if b"\x00" in head:
        raise LogFormatError(f"{path} holds binary data of an unknown format; read are: {known}")
    first = next(line for line in head.splitlines() if line.strip()).strip()
    shown = first[:40].decode("utf-8", errors="replace")
    raise LogFormatError(
        f"{path} is text of an unknown format (it begins {shown!r}); read are: {known}. {_OWN_FORMAT} shows "
        "how to read any other in eight lines"
    )


def read_log(
    path: str | os.PathLike[str],
    *,
    range_max: float | None = None,
    topic: str | None = None,
    ignore_beams: tuple[int, int] = (0, 0),
    laser_pose: tuple[float, float, float] | None = None,
    upside_down: bool | None = None,
    clockwise: bool = False,
    drop_stale: bool = False,
    backwards: bool = False,
) -> Log:
    """Return the log in a file, whatever its format and whether or not it is gzip-compressed.

    The scans, at least one, are read from the file by each iteration, one in memory at a time. What is broken in the
    file is in the log's ``read_errors``.

    Parameters
    ----------
    path : str or path-like
        A CARMEN log, a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), CSV or NPZ of scans or a CoreSLAM log, plain or
        gzip-compressed, or the folder of a ROS 2 bag; see docs/formats.md.
    range_max : float or None
        Upper limit of a valid reading, metres, in place of what the log says of its sensor; inf for no limit.
    topic : str or None
        Which topic of a ROS bag to read, where it holds laser scans on several.
    ignore_beams : (int, int)
        How many beams at the beginning and at the end of each sweep give no reading: they see the robot, say.
    laser_pose : (3,) float or None
        Pose x, y, theta of the laser on the robot (metres, metres, radians), which carries the wheel odometry to the
        laser, in place of what the log says.
    upside_down : bool or None
        Whether the laser hangs upside down, so that its scans are mirrored; None to use what the log says.
    clockwise : bool
        Whether the laser turns against what the log says, so that its scans are mirrored.
    drop_stale : bool
        Whether a beam that repeats its value of the sweep before to the last digit gives no reading.
    backwards : bool
        Whether the log has the beams in the reverse of the order in which they were swept, so that they are turned
        round: for some drivers of RPLIDARs, whose sweeps cannot be deskewed otherwise.

    Raises
    ------
    LogFileError
        When the file cannot be opened: missing, a folder without a bag, not readable.
    LogFormatError
        When it is of another format or holds no scan that can be read.
    InvalidArgumentError
        When `range_max` is not a positive number, `topic` does not fit what is in the log, or the laser's set-up
        breaks the rules of SensorSetup.
    """
    setup = SensorSetup(
        ignore_beams=ignore_beams,
        laser_pose=laser_pose,
        upside_down=upside_down,
        clockwise=clockwise,
        drop_stale=drop_stale,
        backwards=backwards,
    )
    return open_log(path, range_max=range_max, topic=topic, setup=setup)


def open_log(path: str | os.PathLike[str], *, range_max: float | None, topic: str | None, setup: SensorSetup) -> Log:
    """Return the log in a file; see :func:`curvescan.read_log`."""
    if range_max is not None:
        range_max = as_float(range_max, "range_max")
        require(range_max > 0.0, "range_max must be a positive number of metres", range_max)  # also refuses NaN
    file = as_path(path, "a log")
    if "://" in os.fspath(path):
        raise LogFileError(
            f"{os.fspath(path)} is an address, and a log is read from a file: download it first; `curvescan batch` "
            "reads logs in buckets as they are"
        )
    first = storage_files(file)[0] if file.is_dir() else file
    reader: LogReader = pkgutil.resolve_name(find_format(read_head(first, HEAD_BYTES), first).reader)
    return apply_setup(reader(file, range_max=range_max, topic=topic), setup)


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseFile:
    """Poses and what the file says of them."""

    trajectory: Trajectory  # in file order; a row of NaN where a log gives no pose for a scan
    is_of_sensor: bool  # whether the format fixes that these are poses of the sensor; otherwise they may be the robot's


def read_poses(path: str | os.PathLike[str]) -> PoseFile:
    """Return the poses in a file.

    Parameters
    ----------
    path : str or path-like
        TUM text, CSV, or a log of any format that ``read_log`` reads; or a folder that ``curvescan odometry`` wrote,
        whose trajectory.csv is then read.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When it holds no poses, or is of no such format.
    """
    file = results_file(path)
    head = read_head(file, HEAD_BYTES) if file.is_file() else b""
    if file.is_dir() or any(row.sniff(head) for row in FORMATS):
        log = read_log(file)
        if log.odometry is None:
            raise LogFormatError(
                f"{file} is a log without poses: run `curvescan odometry` on it and give what that writes"
            )
        return PoseFile(trajectory=log.odometry, is_of_sensor=True)
    return PoseFile(trajectory=Trajectory.read(path), is_of_sensor=is_our_csv(first_line(head)))
