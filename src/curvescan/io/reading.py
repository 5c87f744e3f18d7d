"""read_log: any log, opened by its content and set up as its user says."""

from __future__ import annotations

import os

from curvescan.errors import InvalidArgumentError, LogFileError
from curvescan.io.files.lines import read_head
from curvescan.io.files.paths import as_path
from curvescan.io.formats import HEAD_BYTES, find_format
from curvescan.io.log import Log
from curvescan.io.ros.bags.bag_files import storage_files
from curvescan.io.sensor_setup import SensorSetup, apply_setup


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
    if range_max is not None and not range_max > 0.0:  # also refuses NaN
        raise InvalidArgumentError(f"range_max must be a positive number of metres, got {range_max}")
    file = as_path(path, "a log")
    if "://" in os.fspath(path):
        raise LogFileError(
            f"{os.fspath(path)} is an address, and a log is read from a file: download it first; `curvescan batch` "
            "reads logs in buckets as they are"
        )
    first = storage_files(file)[0] if file.is_dir() else file
    row = find_format(read_head(first, HEAD_BYTES), first)
    return apply_setup(row.load()(file, range_max=range_max, topic=topic), setup)
