"""The table of formats in which scans are written, and write_log, which chooses a row and writes.

A format is one row: a name, the endings of a file's name that ask for it, and the writer as ``"module:function"``,
imported when it is used. What each format loses of a scan stands with its writer; the writer returns what it did lose,
a sentence each.
"""

from __future__ import annotations

import importlib
import os
import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

from curvescan.errors import CurvescanError, InvalidArgumentError, OutputError
from curvescan.io.arrays.memory import as_log
from curvescan.io.files.output import output_file, output_folder
from curvescan.io.files.paths import as_path
from curvescan.io.log import Log
from curvescan.scan import LaserScan


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

    def load(self) -> LogWriter:
        """Return the writer, importing its module."""
        module, _, name = self.writer.partition(":")
        return cast(LogWriter, getattr(importlib.import_module(module), name))


WRITERS: dict[str, OutputFormat] = {
    "carmen": OutputFormat(
        suffixes=(".clf", ".log", ".carmen"), writer="curvescan.io.carmen.writer:write_carmen", is_text=True
    ),
    "csv": OutputFormat(suffixes=(".csv",), writer="curvescan.io.arrays.csv_file:write_csv_scans", is_text=True),
    "npz": OutputFormat(suffixes=(".npz",), writer="curvescan.io.arrays.npz_writer:write_npz"),
    "ros1": OutputFormat(suffixes=(".bag",), writer="curvescan.io.ros.writing.log_writer:write_ros1"),
    "ros2": OutputFormat(suffixes=("",), writer="curvescan.io.ros.writing.log_writer:write_sqlite3", is_folder=True),
    "mcap": OutputFormat(suffixes=(".mcap",), writer="curvescan.io.ros.writing.log_writer:write_mcap"),
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
        _check_is_other(target, Path(source))
    if row.is_folder and target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise OutputError(f"{target} exists, and a ROS 2 bag is a folder of its own: remove it or choose another name")
    write = row.load()
    with output_folder(target) if row.is_folder else output_file(target) as new:
        try:
            return write(new, log, on_scan or _nothing)
        except CurvescanError:
            raise
        except (OSError, sqlite3.Error) as error:
            reason = getattr(error, "strerror", None) or error
            raise OutputError(f"cannot write {target}: {reason}") from error


def _choose(path: Path, name: str | None) -> OutputFormat:
    if name is not None and name not in WRITERS:
        raise InvalidArgumentError(f"format must be one of {', '.join(WRITERS)}, got {name!r}")
    is_packed = path.suffix == ".gz"
    suffix = (path.with_suffix("") if is_packed else path).suffix.lower()
    row = WRITERS[name] if name else None
    if row is None:
        row = next((row for row in WRITERS.values() if suffix in row.suffixes), None)
    if row is None:
        endings = ", ".join(s for row in WRITERS.values() for s in row.suffixes if s)
        raise InvalidArgumentError(
            f"no format is known by the ending {suffix!r} of {path.name}: give one of {endings}, none for the folder "
            f"of a ROS 2 bag, or a format ({', '.join(WRITERS)})"
        )
    if is_packed and not row.is_text:
        raise InvalidArgumentError(f"only text is written gzip-compressed, got {path.name}: leave the ending .gz out")
    return row


def _check_is_other(target: Path, source: Path) -> None:
    real, origin = Path(os.path.realpath(target)), Path(os.path.realpath(source))
    is_same = target.exists() and source.exists() and target.samefile(source)
    if is_same or real == origin or origin in real.parents or real in origin.parents:
        raise OutputError(
            f"{target} is the log itself, or shares its folder with it: choose another name"
            if is_same or real == origin
            else f"{target} lies within the log {source}, or around it: choose another name"
        )


def _nothing() -> None: ...
