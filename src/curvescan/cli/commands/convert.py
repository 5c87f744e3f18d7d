"""curvescan convert: a log in one format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import tyro

from curvescan.cli.options import LogPath, Reading, ReadingFlags

FormatName: TypeAlias = Literal["carmen", "csv", "npz", "ros1", "ros2", "mcap"]
"""Names of the table of writers, written out so that --help loads none of them."""


def convert(
    log: LogPath,
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")],
    /,
    *,
    format: FormatName | None = None,  # noqa: A002 - the flag's name
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
) -> int:
    """Write the scans and the odometry of a log in another format, and tell what that format cannot keep.

    The ending of OUT chooses: .clf .log (CARMEN), .csv, .npz, .bag (ROS 1), .mcap, or none for the folder of a ROS 2
    bag (sqlite3); .csv.gz and .clf.gz are compressed.

    Parameters
    ----------
    out
        The file to write, or for ros2 the folder; an old file is replaced when all is written.
    format
        The format, in place of what the ending of OUT says.
    """
    from curvescan.cli.console import ERR, OUT, progress_bar
    from curvescan.io import write_log

    source = reading.open(log)
    with progress_bar("convert", len(source)) as advance:
        losses = write_log(out, source, format=format, source=log, on_scan=advance)
    for read_error in source.read_errors:
        ERR.print(f"not read: {read_error}")
    for loss in losses:
        ERR.print(f"not kept: {loss}")
    OUT.print(f"wrote {out}: {len(source):,} scans of {source.name}")
    return 0
