"""The table of exports: files that an odometry run can be written as, beside its TUM and CSV.

A row is a file's name and the writer as ``"module:function"``, imported when it is used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from curvescan.configs import nearest
from curvescan.errors import InvalidArgumentError
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import PoseEdge


@dataclass(frozen=True, kw_only=True)
class RunData:
    """What a run has to be written."""

    trajectory: Trajectory  # A pose a scan
    edges: Sequence[PoseEdge]  # the matches behind it
    scans: Iterable[LaserScan]  # what it ran over, to be read anew


@dataclass(frozen=True, kw_only=True)
class ExportFormat:
    """One row of the table."""

    filename: str  # in the folder of the run
    writer: str  # ``"module:function"``
    takes: tuple[str, ...]  # fields of RunData that the writer takes, behind the path

    def write(self, folder: Path, data: RunData) -> None:
        """Write the file into a folder, importing the writer's module."""
        module, _, name = self.writer.partition(":")
        function: Callable[..., None] = getattr(importlib.import_module(module), name)
        function(folder / self.filename, *(getattr(data, field) for field in self.takes))


EXPORTS: dict[str, ExportFormat] = {
    "kitti": ExportFormat(
        filename="trajectory.kitti", writer="curvescan.io.trajectories.layouts:write_kitti", takes=("trajectory",)
    ),
    "g2o": ExportFormat(
        filename="graph.g2o", writer="curvescan.io.trajectories.g2o:write_g2o", takes=("trajectory", "edges")
    ),
    "mcap": ExportFormat(
        filename="run.mcap",
        writer="curvescan.io.ros.writing.log_writer:write_odometry_mcap",
        takes=("trajectory", "scans"),
    ),
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
        if name not in EXPORTS:
            raise InvalidArgumentError(
                f"exports must be of {', '.join(EXPORTS)}, got {name!r}: {nearest(name, EXPORTS)}".rstrip(": ")
            )


def write_exports(folder: Path, names: Iterable[str], data: RunData) -> tuple[str, ...]:
    """Write exports of a run into an existing folder, and return the names of the files."""
    names = tuple(names)
    check_exports(names)
    rows = [EXPORTS[name] for name in names]
    for row in rows:
        row.write(folder, data)
    return tuple(row.filename for row in rows)
