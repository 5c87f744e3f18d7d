"""How fast logs are read, format by format: simulated scans, written by our own writers and read again."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvescan.io import WRITERS, read_log, write_log
from curvescan.io.arrays.coreslam import ANGLE_INCREMENT, ANGLE_MIN, N_BEAMS, RANGE_MAX, RANGE_MIN, SCAN_TIME
from curvescan.io.log import Log
from curvescan.runs.document import ResultTable
from curvescan.simulation import Sensor, simulate

URG_04LX = Sensor(
    name="urg-04lx",
    n_beams=N_BEAMS,
    angle_min=ANGLE_MIN,
    angle_increment=ANGLE_INCREMENT,
    range_min=RANGE_MIN,
    range_max=RANGE_MAX,
    sigma_range=0.01,
    dropout=0.02,
    period=SCAN_TIME,
)
"""The laser of the CoreSLAM log: its layout has no other."""

_SUFFIXES = {name: next((s for s in row.suffixes if s), "") for name, row in WRITERS.items()}


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingSpeed:
    """How fast a log of one format is read."""

    format: str  # its name in words
    # size of the log
    n_scans: int
    n_beams: int
    bytes_per_scan: float  # on disk
    open_seconds: float  # until read_log returns and the number of scans is known; text is read through once for that
    read_seconds: float  # one iteration over all scans

    @property
    def scans_per_second(self) -> float:
        """Scans that an iteration yields a second."""
        return self.n_scans / self.read_seconds


def measure_reading(
    *, n_scans: int = 500, repeats: int = 3, seed: int = 0, on_format: Callable[[], object] = lambda: None
) -> tuple[ReadingSpeed, ...]:
    """Return the speed of every format that is read, in a temporary folder that goes afterwards; one thread."""
    log = simulate("office", sensor=URG_04LX, n_scans=n_scans, seed=seed)
    speeds = []
    with tempfile.TemporaryDirectory(prefix="curvescan-") as folder:
        paths = [Path(folder) / f"{name}{_SUFFIXES[name]}" for name in WRITERS]
        for name, path in zip(WRITERS, paths, strict=True):
            write_log(path, log, format=name)
        paths.append(Path(folder) / "coreslam.dat")
        _write_coreslam(paths[-1], log)
        for path in paths:
            speeds.append(_measure(path, repeats))
            on_format()
    return tuple(speeds)


N_FORMATS = len(WRITERS) + 1  # formats that measure_reading measures


def _measure(path: Path, repeats: int) -> ReadingSpeed:
    files = [file for file in path.rglob("*") if file.is_file()] or [path]
    open_seconds = read_seconds = math.inf
    for _ in range(repeats):
        started = time.perf_counter()
        log = read_log(path)
        n_scans = len(log)
        opened = time.perf_counter()
        n_beams = sum(len(scan) for scan in log) // n_scans
        ended = time.perf_counter()
        open_seconds = min(open_seconds, opened - started)
        read_seconds = min(read_seconds, ended - opened)
    return ReadingSpeed(
        format=log.format,
        n_scans=n_scans,
        n_beams=n_beams,
        bytes_per_scan=sum(file.stat().st_size for file in files) / n_scans,
        open_seconds=open_seconds,
        read_seconds=read_seconds,
    )


def _write_coreslam(path: Path, log: Log) -> None:
    """Write scans of the URG-04LX in the layout of a CoreSLAM log, with wheels that stand still."""
    with path.open("w", encoding="ascii") as file:
        for scan in log:
            millimetres = np.where(scan.valid, np.rint(1e3 * scan.ranges), 0.0).astype(np.int64)
            numbers = " ".join(map(str, millimetres.tolist()))
            file.write(f"{round(1e6 * scan.stamp)} {'0 ' * 23}{numbers} 0\n")


def reading_table(speeds: Sequence[ReadingSpeed]) -> ResultTable:
    """Return the table of the times that reading takes, one row a format."""
    sizes = {(speed.n_scans, speed.n_beams) for speed in speeds}
    n_scans, n_beams = max(sizes)
    return ResultTable.of(
        f"Reading a log of {n_scans:,} scans of {n_beams:,} beams, one thread",
        speeds,
        [
            ("format", lambda one: one.format),
            ("scans a second", lambda one: f"{one.scans_per_second:,.0f}"),
            ("opening and counting", lambda one: f"{1e3 * one.open_seconds:,.0f} ms"),
            ("bytes a scan", lambda one: f"{one.bytes_per_scan:,.0f}"),
        ],
    )
