"""Scans from the arrays of an .npz file, and back, with nothing lost; the arrays stand in docs/formats.md.

A log is read once, one scan in memory at a time. Ranges that are all exact in float32, as those of ROS are, are stored
so, in half the space.
"""

from __future__ import annotations

import itertools
import math
import tempfile
import zipfile
from array import array
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import LogFormatError
from curvescan.io.arrays.columns import DEFAULTS, Record, StreamLog, is_on_grid, make_pose, make_scan
from curvescan.io.arrays.npz_file import NpzFile
from curvescan.io.files.lines import BrokenRecordError, ReadErrorCounter, printable
from curvescan.io.log import NO_POSE, Log
from curvescan.scan import LaserScan
from curvescan.types import Floats

FORMAT = "NPZ of scans"
_MIN_SCAN_LIMIT = 1 << 20
_BYTES_A_SCAN = 8
"""A scan without beams has at least its stamp; packed bytes that are all the same can claim any number of them."""
_MAX_BEAMS = 1 << 21
_DAMAGED = "file damaged from here on: what stands before is read"


def open_npz(path: Path, *, range_max: float | None = None, topic: str | None = None) -> StreamLog:
    """Return the scans of an .npz file, which has no topics, read from it a block of rows at a time."""
    scans = _Scans(NpzFile(path), range_max)
    return StreamLog(path, kind=FORMAT, topic=topic, read=scans.records, read_one=scans.one, unit="scan")


def _check_arrays(file: NpzFile) -> tuple[int, int]:
    """Return the numbers of scans and of beams, having compared all shapes."""
    shapes = {name: header.shape for name, header in file.headers.items()}
    if "csmap_version" in shapes:
        raise LogFormatError(
            f"{file.path} is a saved map, not a log: localize a log in it (`curvescan localize LOG --map`), "
            "continue it (`curvescan slam LOG --map`), or change it (`curvescan map`)"
        )
    for name in ("stamps", "ranges"):
        if name not in shapes:
            raise LogFormatError(
                f"{file.path} needs an array {name!r} to be scans, and holds {printable(', '.join(shapes), 200)}"
            )
    if "angles" not in shapes and not {"angle_min", "angle_increment"} <= shapes.keys():
        raise LogFormatError(
            f"{file.path} needs arrays 'angle_min' and 'angle_increment', or 'angles', and holds "
            f"{printable(', '.join(shapes), 200)}"
        )
    if len(shapes["ranges"]) != 2:
        raise LogFormatError(f"{file.path}: 'ranges' must be of shape (scans, beams), got {shapes['ranges']}")
    n, m = shapes["ranges"]
    if n > max(_MIN_SCAN_LIMIT, file.n_given // _BYTES_A_SCAN) or m > _MAX_BEAMS:
        raise LogFormatError(
            f"{file.path}: {n:,} scans of {m:,} beams are too many for a file of its size: if it is sound, save it "
            "with numpy.savez"
        )
    allowed: dict[str, tuple[tuple[int, ...], ...]] = {
        "stamps": ((n,),),
        "counts": ((n,),),
        "angles": ((m,), (n, m)),
        "intensities": ((n, m),),
        "odometry": ((n, 3),),
        **dict.fromkeys(DEFAULTS, ((), (n,))),
    }
    for name, forms in allowed.items():
        if name in shapes and shapes[name] not in forms:
            rule = " or ".join(map(str, forms))
            raise LogFormatError(
                f"{file.path}: {name!r} must be of shape {rule} beside ranges of {(n, m)}, got {shapes[name]}"
            )
    return n, m


class _Scans:
    """The scans of a file; the columns of numbers are read once, and the rows of readings when they are asked for."""

    def __init__(self, file: NpzFile, range_max: float | None) -> None:
        self._file = file
        self._n, m = _check_arrays(file)
        columns = {name: file.read(name) if name in file.headers else value for name, value in DEFAULTS.items()}
        if range_max is not None:
            columns["range_max"] = range_max
        columns["stamp"] = file.read("stamps")
        self._columns = {name: np.broadcast_to(column, self._n) for name, column in columns.items()}
        self._counts = file.read("counts") if "counts" in file.headers else np.full(self._n, float(m))

    def one(self, place: tuple[int, ...]) -> LaserScan:
        """Return a scan by the number of its row."""
        (i,) = place
        return self._scan(i, self._file.row("ranges", i), self._row("angles", i), self._row("intensities", i))

    def records(self, read_errors: ReadErrorCounter) -> Iterator[Record]:
        """Yield all scans, one in memory at a time."""
        odometry = self._file.read("odometry") if "odometry" in self._file.headers else None
        ranges = itertools.chain.from_iterable(self._file.blocks("ranges"))
        rows = zip(ranges, self._rows("angles"), self._rows("intensities"), strict=True)
        for i in itertools.count():
            try:
                row = next(rows, None)
            except LogFormatError:
                read_errors.add(_DAMAGED, i + 1)
                return
            if row is None:
                return
            try:
                scan = self._scan(i, *row)
            except BrokenRecordError as error:
                read_errors.add(str(error), i + 1)
                continue
            yield Record(scan, NO_POSE if odometry is None else make_pose(*odometry[i].tolist()), (i,))

    def _row(self, name: str, i: int) -> Floats | None:
        if name not in self._file.headers:
            return None
        return self._file.read(name) if len(self._file.headers[name].shape) == 1 else self._file.row(name, i)

    def _rows(self, name: str) -> Iterator[Floats | None]:
        if name not in self._file.headers:
            return itertools.repeat(None, self._n)
        if len(self._file.headers[name].shape) == 1:
            return itertools.repeat(self._file.read(name), self._n)
        return itertools.chain.from_iterable(self._file.blocks(name))

    def _scan(self, i: int, ranges: Floats, angles: Floats | None, intensities: Floats | None) -> LaserScan:
        if not 0.0 <= self._counts[i] <= ranges.size:
            raise BrokenRecordError("count of beams beyond the row of ranges")
        n = int(self._counts[i])
        if intensities is not None:
            intensities = None if np.isnan(intensities[:n]).all() else intensities[:n]
        is_own = angles is not None and n > 0 and not math.isnan(angles[0])
        value = {name: column[i].item() for name, column in self._columns.items()}
        return make_scan(value, ranges[:n], angles[:n] if angles is not None and is_own else None, intensities)


_YEAR_ZERO = (1980, 1, 1, 0, 0, 0)  # date of all members: the same log gives the same bytes


def write_npz(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as .npz, uncompressed; a LogWriter that loses nothing.

    The rows wait in temporary files beside it: how long they are, and of what type, is known when all are there.
    """
    stamps, counts, scalars = array("d"), array("q"), array("d")
    is_short = True
    with ExitStack() as files:
        ranges, angles, intensities = (
            _Rows(files.enter_context(tempfile.TemporaryFile(dir=path.parent)), counts) for _ in range(3)
        )
        for scan in log:
            stamps.append(scan.stamp)
            counts.append(len(scan))
            scalars.extend(getattr(scan, name) for name in DEFAULTS)
            with np.errstate(over="ignore", under="ignore"):
                short = scan.ranges.astype(np.float32).astype(np.float64)
            is_short = is_short and np.array_equal(short, scan.ranges, equal_nan=True)
            ranges.add(scan.ranges)
            angles.add(None if is_on_grid(scan) else scan.angles)
            intensities.add(scan.intensities)
            on_scan()
        n, m = len(stamps), max(counts, default=0)
        arrays: dict[str, NDArray[np.generic]] = {"stamps": np.array(stamps)}
        arrays["counts"] = np.array(counts, dtype=np.int64)
        arrays |= dict(zip(DEFAULTS, np.array(scalars).reshape(n, len(DEFAULTS)).T, strict=True))
        if log.odometry is not None:
            arrays["odometry"] = poses = np.full((n, 3), np.nan)
            known = log.odometry.poses[:n]
            poses[: len(known)] = known
        with zipfile.ZipFile(path, "x", allowZip64=True) as archive:
            for name, array_of in arrays.items():
                _write_rows(archive, name, array_of.shape, array_of.dtype.str, iter([array_of]))
            _write_rows(archive, "ranges", (n, m), "<f4" if is_short else "<f8", ranges.padded(m))
            for name, rows in (("angles", angles), ("intensities", intensities)):
                if any(rows.is_there):
                    _write_rows(archive, name, (n, m), "<f8", rows.padded(m))
    return ()


class _Rows:
    """Rows of numbers in a temporary file, some of them missing; counts: how long each is."""

    def __init__(self, file: IO[bytes], counts: array[int]) -> None:
        self._file, self._counts, self.is_there = file, counts, array("b")

    def add(self, values: Floats | None) -> None:
        self.is_there.append(values is not None)
        if values is not None:
            self._file.write(values.tobytes())

    def padded(self, m: int) -> Iterator[Floats]:
        """Yield all rows, (m,) each, with NaN where there is nothing."""
        self._file.seek(0)
        for is_there, count in zip(self.is_there, self._counts, strict=True):
            row = np.full(m, np.nan)
            if is_there:
                row[:count] = np.frombuffer(self._file.read(8 * count))
            yield row


def _write_rows(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], kind: str, rows: Iterator[NDArray[np.generic]]
) -> None:
    info = zipfile.ZipInfo(f"{name}.npy", date_time=_YEAR_ZERO)
    with archive.open(info, "w", force_zip64=True) as member:
        header = {"descr": kind, "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(member, header)
        for row in rows:
            member.write(np.ascontiguousarray(row, dtype=kind).tobytes())
