"""Scans, runs and maps as files: the table of log formats behind write_log, that of exports of a run, PLY and PCD.

What a format loses of a scan stands with its writer, which returns what it did lose, a sentence each.
"""

import os
import pkgutil
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, TypeAlias

import numpy as np

from curvescan.configs import look_up
from curvescan.errors import InvalidArgumentError, OutputError
from curvescan.io.arrays.memory import as_log
from curvescan.io.files.lines import as_path
from curvescan.io.files.output import check_is_other, output_file, output_folder
from curvescan.io.log import Log, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Points, PoseEdge


class LogWriter(Protocol):
    """Writes a log in one format; the function a row of the table names."""

    def __call__(self, path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
        """Write all scans and the odometry of a log, one scan in memory at a time. Raises OutputError."""


@dataclass(frozen=True, kw_only=True)
class OutputFormat:
    """One row of the table of formats."""

    suffixes: tuple[str, ...]  # endings that ask for the format; ``""`` is a name without one
    writer: str  # ``"module:function"`` of a LogWriter
    is_folder: bool = False  # whether the result is a folder
    is_text: bool = False  # whether the further ending ``.gz`` selects gzip


WRITERS: dict[str, OutputFormat] = {
    "carmen": OutputFormat(
        suffixes=(".clf", ".log", ".carmen"), writer="curvescan.io.carmen.log:write_carmen", is_text=True
    ),
    "csv": OutputFormat(suffixes=(".csv",), writer="curvescan.io.arrays.csv_file:write_csv_scans", is_text=True),
    "npz": OutputFormat(suffixes=(".npz",), writer="curvescan.io.arrays.npz:write_npz"),
    "ros1": OutputFormat(suffixes=(".bag",), writer="curvescan.io.ros.writing.bags:write_ros1"),
    "ros2": OutputFormat(suffixes=("",), writer="curvescan.io.ros.writing.bags:write_sqlite3", is_folder=True),
    "mcap": OutputFormat(suffixes=(".mcap",), writer="curvescan.io.ros.writing.bags:write_mcap"),
}
"""Name of each format that is written."""


def write_log(
    path: str | os.PathLike[str],
    log: Log | Iterable[LaserScan],
    *,
    format: str | None = None,  # noqa: A002 - what it is
    source: str | os.PathLike[str] | None = None,
    on_scan: Callable[[], object] | None = None,
) -> tuple[str, ...]:
    """Write the scans and the odometry of a log in another format, and return what was lost.

    The file appears whole when all is written, and replaces an old one in one step. Memory does not grow with the log,
    but for a few bytes a scan.

    Parameters
    ----------
    path : str or path-like
        The file; for ``"ros2"`` a folder that does not exist.
    log : Log or iterable of LaserScan
        Any log, or scans.
    format : str or None
        Name of a row of WRITERS; None to go by the ending of `path`.
    source : str, path-like or None
        Where the log is read from: it is not overwritten.
    on_scan : callable or None
        Called after each scan, for a progress bar say.

    Returns
    -------
    tuple of str
        What the format could not keep, a sentence each.

    Raises
    ------
    InvalidArgumentError
        When the format is unknown, or the ending does not determine it.
    OutputError
        When it cannot be written there, `path` is the source, or a scan cannot be said in the format.
    """
    target, log = as_path(path, "the file to write"), as_log(log)
    row = _choose(target, format)
    if source is not None:
        check_is_other(target, Path(source))
    if row.is_folder and target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise OutputError(f"{target} exists, and a ROS 2 bag is a folder of its own: remove it or choose another name")
    write: LogWriter = pkgutil.resolve_name(row.writer)
    with output_folder(target) if row.is_folder else output_file(target) as new:
        try:
            return (*write(new, log, on_scan or (lambda: None)), *_mount_lost(log))
        except sqlite3.Error as error:
            raise OutputError(f"cannot write {target}: {error}") from error


def _mount_lost(log: Log) -> tuple[str, ...]:
    """Return that no format says where the laser sits on the robot, where the log knows it."""
    robot, laser = log.robot_odometry() if isinstance(log, ScanAccess) else None, log.odometry
    if robot is None or laser is None or np.array_equal(robot.poses, laser.poses, equal_nan=True):
        return ()
    return ("where the laser sits on the robot: the odometry is written as poses of the laser",)


def _choose(path: Path, name: str | None) -> OutputFormat:
    is_packed = path.suffix == ".gz"
    suffix = (path.with_suffix("") if is_packed else path).suffix.lower()
    named = None if name is None else look_up(WRITERS, name, "format")
    row = named or next((row for row in WRITERS.values() if suffix in row.suffixes), None)
    if row is None:
        endings = ", ".join(s for row in WRITERS.values() for s in row.suffixes if s)
        raise InvalidArgumentError(
            f"no format is known by the ending {suffix!r} of {path.name}: give one of {endings}, none for the folder "
            f"of a ROS 2 bag, or a format ({', '.join(WRITERS)})"
        )
    if is_packed and not row.is_text:
        raise InvalidArgumentError(f"only text is written gzip-compressed, got {path.name}: leave the ending .gz out")
    return row


class RunData(NamedTuple):
    """What a run has to be written."""

    trajectory: Trajectory  # A pose a scan
    edges: Sequence[PoseEdge]  # the matches behind it
    scans: Iterable[LaserScan]  # what it ran over, to be read anew


class Export(NamedTuple):
    """One row of the table."""

    filename: str  # in the folder of the run
    writer: str  # ``"module:function"``
    takes: tuple[str, ...]  # fields of RunData that the writer takes, behind the path


EXPORTS: dict[str, Export] = {
    "kitti": Export("trajectory.kitti", "curvescan.io.trajectories.layouts:write_kitti", ("trajectory",)),
    "g2o": Export("graph.g2o", "curvescan.io.trajectories.relations:write_g2o", ("trajectory", "edges")),
    "mcap": Export("run.mcap", "curvescan.io.ros.writing.bags:write_odometry_mcap", ("trajectory", "scans")),
}
"""Name of each export."""

ExportName: TypeAlias = Literal["kitti", "g2o", "mcap"]
"""Names of the table of exports, written out for editors and so that --help loads none of their writers."""


def takes_edges(names: Iterable[str]) -> bool:
    """Return whether any of these exports is written from the matches, which have to be gathered for it."""
    return any("edges" in EXPORTS[name].takes for name in names)


def check_exports(names: Iterable[str]) -> None:
    """Raise InvalidArgumentError when a name is none of EXPORTS."""
    for name in names:
        look_up(EXPORTS, name, "export")


def write_exports(folder: Path, names: Iterable[str], data: RunData) -> tuple[str, ...]:
    """Write exports of a run into an existing folder, and return the names of the files."""
    names = tuple(names)
    check_exports(names)
    rows = [EXPORTS[name] for name in names]
    for row in rows:
        write: Callable[..., None] = pkgutil.resolve_name(row.writer)
        write(folder / row.filename, *(getattr(data, field) for field in row.takes))
    return tuple(row.filename for row in rows)


_PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n"
    "property float x\nproperty float y\nproperty float z\nend_header\n"
)
_PCD = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
)


def write_ply(path: str | os.PathLike[str], points: Points) -> None:
    """Write (n, 2) points, metres, as PLY. Raises OutputError."""
    _write(path, _PLY, points)


def write_pcd(path: str | os.PathLike[str], points: Points) -> None:
    """Write (n, 2) points, metres, as PCD. Raises OutputError."""
    _write(path, _PCD, points)


def _write(path: str | os.PathLike[str], header: str, points: Points) -> None:
    rows = np.zeros((len(points), 3), dtype="<f4")
    rows[:, :2] = points
    with output_file(path) as new:
        new.write_bytes(header.format(n=len(rows)).encode("ascii") + rows.tobytes())
