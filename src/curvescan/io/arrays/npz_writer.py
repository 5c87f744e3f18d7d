"""Scans to the arrays of an .npz file, as npz_reader.py describes them; nothing is lost.

The log is read once to learn its size, and once for each large array, so that one scan is in memory at a time. Ranges
that are all exact in float32, as those of ROS are, are stored so, in half the space.
"""

from __future__ import annotations

import zipfile
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import OutputError
from curvescan.io.arrays.columns import DEFAULTS, is_on_grid
from curvescan.io.log import Log
from curvescan.scan import LaserScan
from curvescan.types import Floats

_MAX_ATTEMPTS = 3

_YEAR_ZERO = (1980, 1, 1, 0, 0, 0)  # date of all members: the same log gives the same bytes


def write_npz(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as .npz, uncompressed; a LogWriter that loses nothing.

    Of a log that grows meanwhile it holds what was there at first; one that shrinks is begun anew.
    """
    for _ in range(_MAX_ATTEMPTS):
        try:
            return _write(path, log, on_scan)
        except _ShrunkError:
            path.unlink()
    raise OutputError(f"cannot write {path.name}: {log.name} changes while it is read; try again when it is whole")


class _ShrunkError(Exception):
    """A scan that was there at first is gone, or another."""


def _write(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    survey = _Survey()
    for scan in log:
        survey.add(scan)
    n, m = len(survey.stamps), max(survey.counts, default=0)
    n_seen = 0

    def rows(values: Callable[[LaserScan], Floats]) -> Iterator[Floats]:
        nonlocal n_seen
        k = 0
        for k, scan in enumerate(log, 1):
            if k > n:
                break
            if len(scan) != survey.counts[k - 1]:
                raise _ShrunkError
            yield values(scan)
        n_seen = max(n_seen, k)
        if k < n:
            raise _ShrunkError

    with zipfile.ZipFile(path, "x", allowZip64=True) as archive:
        arrays: dict[str, NDArray[np.generic]] = {"stamps": np.array(survey.stamps)}
        arrays["counts"] = np.array(survey.counts, dtype=np.int64)
        table = np.array(survey.scalars).reshape(n, len(DEFAULTS))
        arrays |= dict(zip(DEFAULTS, table.T, strict=True))
        if log.odometry is not None:
            poses = np.full((n, 3), np.nan)
            known = log.odometry.poses[:n]
            poses[: len(known)] = known
            arrays["odometry"] = poses
        for name, array_of in arrays.items():
            _write_rows(archive, name, array_of.shape, array_of.dtype.str, iter([array_of]))
        kind = "<f4" if survey.is_short else "<f8"

        def ranges(scan: LaserScan) -> Floats:
            on_scan()
            return _padded(scan.ranges, m)

        def angles(scan: LaserScan) -> Floats:
            return np.full(m, np.nan) if is_on_grid(scan) else _padded(scan.angles, m)

        _write_rows(archive, "ranges", (n, m), kind, rows(ranges))
        if not survey.is_even:
            _write_rows(archive, "angles", (n, m), "<f8", rows(angles))
        if survey.has_intensities:
            intensities = rows(lambda scan: _padded(scan.intensities, m))
            _write_rows(archive, "intensities", (n, m), "<f8", intensities)
    grew = f"{log.name} grew while it was read: its first {n:,} scans are written"
    return (grew,) if n_seen > n else ()


@dataclass
class _Survey:
    """What must be known of all scans before the first is written: 64 bytes a scan."""

    stamps: array[float] = field(default_factory=lambda: array("d"))
    counts: array[int] = field(default_factory=lambda: array("q"))
    scalars: array[float] = field(default_factory=lambda: array("d"))
    is_short: bool = True
    is_even: bool = True
    has_intensities: bool = False

    def add(self, scan: LaserScan) -> None:
        self.stamps.append(scan.stamp)
        self.counts.append(len(scan))
        self.scalars.extend(getattr(scan, name) for name in DEFAULTS)
        self.is_even = self.is_even and is_on_grid(scan)
        self.has_intensities |= scan.intensities is not None
        if self.is_short:
            with np.errstate(over="ignore", under="ignore"):
                short = scan.ranges.astype(np.float32).astype(np.float64)
            self.is_short = np.array_equal(short, scan.ranges, equal_nan=True)


def _padded(values: Floats | None, m: int) -> Floats:
    row = np.full(m, np.nan)
    if values is not None:
        row[: values.size] = values
    return row


def _write_rows(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], kind: str, rows: Iterator[NDArray[np.generic]]
) -> None:
    info = zipfile.ZipInfo(f"{name}.npy", date_time=_YEAR_ZERO)
    with archive.open(info, "w", force_zip64=True) as member:
        header = {"descr": kind, "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(member, header)
        for row in rows:
            member.write(np.ascontiguousarray(row, dtype=kind).tobytes())
