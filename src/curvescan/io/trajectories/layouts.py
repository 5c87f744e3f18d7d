"""Trajectories as text and back: TUM, KITTI and CSV.

TUM (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", 2012): ``stamp x y z qx qy qz qw`` a line.
KITTI: the first three rows of each pose's matrix. Numbers have as many digits as it takes to read the same float64
again: in CSV everything comes back to the bit; in the others the angle comes back within 1e-15 rad.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TextIO, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.lines import as_path, is_packed, printable, read_head
from curvescan.io.files.output import output_file
from curvescan.types import Cov, Floats, Pose

if TYPE_CHECKING:
    from curvescan.io.trajectories.trajectory import Trajectory

TrajectoryFormat: TypeAlias = Literal["tum", "csv", "kitti"]  # formats in which a trajectory is written and read

CSV_HEADER = (
    "stamp", "x", "y", "theta",
    "cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt",
    "outcome",
)  # fmt: skip

_ENDINGS: dict[str, TrajectoryFormat] = {".tum": "tum", ".txt": "tum", ".csv": "csv", ".kitti": "kitti"}
_POSE_NAMES = ("x", "y", "theta")
_UPPER = np.triu_indices(3)
_HEAD_BYTES = 1 << 12
_MAX_TILT = math.radians(5.0)
_LEAST_UPRIGHT = 0.996  # its cosine


class PoseRows(NamedTuple):
    """The fields of a Trajectory, as a file holds them."""

    stamps: Floats
    poses: Pose
    covariances: Cov | None = None


def checked(trajectory: Trajectory) -> Trajectory:
    """Return a trajectory, or raise InvalidArgumentError where it is none."""
    if not isinstance(getattr(trajectory, "poses", None), np.ndarray):
        got = f"got {type(trajectory).__name__}: give run.trajectory, or what read_tum returns"
        raise InvalidArgumentError(f"trajectory must be a Trajectory, {got}")
    return trajectory


class _Layout(NamedTuple):
    """Lines of numbers: how many, what a line is in words, and its reader: (stamp, x, y, theta), NaN without stamp."""

    n_fields: int
    line: str
    rule: str
    parse: Callable[[list[float], str], tuple[float, float, float, float]]


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write a trajectory as TUM text, one line a pose, in its own order.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        A pose of NaN is written as ``nan`` in all its fields.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    half = 0.5 * checked(trajectory).poses[:, 2]
    zero = np.zeros_like(half)
    _write(path, trajectory.stamps, trajectory.poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half))


def write_kitti(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write the poses of a trajectory, one line each; the stamps are not in it.

    The plane of motion is x, y; z is up and 0 (KITTI's own cameras look along z: no axis is turned here). Numbers have
    as many digits as it takes to read the same float64 again.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        A pose of NaN is written as ``nan`` in the elements that depend on it.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    x, y, theta = checked(trajectory).poses.T
    cos, sin, zero = np.cos(theta), np.sin(theta), np.zeros_like(x)
    _write(path, cos, -sin, zero, x, sin, cos, zero, y, zero, zero, zero + 1.0, zero)


def _write(path: str | os.PathLike[str], *columns: Floats) -> None:
    with writing_text(path) as file:
        file.writelines(" ".join(map(repr, row)) + "\n" for row in np.column_stack(columns).tolist())


def write_csv(path: str | os.PathLike[str], trajectory: Trajectory, outcomes: Sequence[str]) -> None:
    """Write a trajectory with covariances and outcomes as CSV, one line a pose, in its own order.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists. The columns are CSV_HEADER.
    trajectory : Trajectory
        Of each covariance the upper triangle is written; the fields stay empty when there are none.
    outcomes : sequence of str
        Short name of what became of each scan, one a pose.

    Raises
    ------
    InvalidArgumentError
        When there is not one outcome a pose.
    OutputError
        When the file cannot be written.
    """
    n, covariances = len(checked(trajectory).stamps), trajectory.covariances
    if len(outcomes) != n:
        raise InvalidArgumentError(f"outcomes must have one name a pose ({n}), got {len(outcomes)}")
    upper = [[""] * 6] * n if covariances is None else covariances[:, _UPPER[0], _UPPER[1]].tolist()
    with writing_text(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CSV_HEADER)
        for stamp, pose, cov, outcome in zip(
            trajectory.stamps.tolist(), trajectory.poses.tolist(), upper, outcomes, strict=True
        ):
            writer.writerow([stamp, *pose, *cov, outcome])


def write_poses(
    path: str | os.PathLike[str],
    trajectory: Trajectory,
    *,
    format: TrajectoryFormat | None = None,  # noqa: A002 - what it is
) -> None:
    """Write poses; see :meth:`curvescan.Trajectory.write`."""
    file = as_path(path, "a trajectory")
    kind = format or _ENDINGS.get(file.suffix.lower())
    if kind is None:
        raise InvalidArgumentError(
            f"no format of trajectories has the ending {file.suffix.lower()!r} of {file.name}: end the name with "
            f"{', '.join(_ENDINGS)}, or give format="
        )
    if kind not in _WRITERS:
        raise InvalidArgumentError(f"format must be one of {', '.join(_WRITERS)}, got {kind!r}")
    _WRITERS[kind](path, trajectory)


_WRITERS: dict[str, Callable[[str | os.PathLike[str], Trajectory], None]] = {
    "tum": write_tum,
    "csv": lambda path, trajectory: write_csv(path, trajectory, [""] * len(trajectory.stamps)),
    "kitti": write_kitti,
}


def _parse_tum(row: list[float], where: str) -> tuple[float, float, float, float]:
    stamp, x, y, _, qx, qy, qz, qw = row
    across, along = math.hypot(qx, qy), math.hypot(qz, qw)
    if across == 0.0 and along == 0.0:
        raise LogFormatError(f"{where}: a quaternion must not be zero")
    # angle between the z axes of sensor and world; NaN, a missing pose, is no tilt
    tilt = 2.0 * math.atan2(across, along)
    if tilt > _MAX_TILT:
        raise LogFormatError(
            f"{where}: a planar pose turns about z alone, and this one tilts by "
            f"{math.degrees(tilt):.1f} deg: project the trajectory onto the plane first"
        )
    return stamp, x, y, float(se2.wrap(2.0 * math.atan2(qz, qw)))


def _parse_kitti(row: list[float], where: str) -> tuple[float, float, float, float]:
    if row[10] < _LEAST_UPRIGHT:  # False for NaN, a missing pose
        raise LogFormatError(
            f"{where}: a planar pose turns about z alone, and this one tilts: KITTI's cameras look along z; "
            "turn the poses so that z is up"
        )
    return math.nan, row[3], row[7], math.atan2(row[4], row[0])


TUM = _Layout(8, "a TUM line has 8 fields (stamp x y z qx qy qz qw)", "is stamp x y z qx qy qz qw", _parse_tum)
KITTI = _Layout(12, "a KITTI line has 12 numbers (3x4)", "is a matrix of 3x4 numbers", _parse_kitti)


def rows_of(path: str | os.PathLike[str], layout: _Layout) -> PoseRows:
    """Return the poses of a file of this layout; where it has no stamps they are 0, 1, 2, ..."""
    rows: list[tuple[float, float, float, float]] = []
    with _reading_text(path) as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if not fields or fields[0].startswith("#"):
                continue
            where = f"{path}, line {number}"
            if len(fields) != layout.n_fields:
                raise LogFormatError(f"{where}: {layout.line}, got {len(fields)}")
            rows.append(layout.parse(_numbers(fields, where), where))
    if not rows:
        raise LogFormatError(f"{path} holds no pose: {layout.line.partition(' has')[0]} {layout.rule}")
    table = np.array(rows)
    if layout is KITTI:
        table[:, 0] = np.arange(len(table))
    return PoseRows(table[:, 0], table[:, 1:])


def csv_rows(path: str | os.PathLike[str]) -> tuple[PoseRows, tuple[str, ...]]:
    """Return poses and outcomes that write_csv wrote; see :func:`curvescan.read_csv`."""
    numbers: list[list[float]] = []
    outcomes: list[str] = []
    is_any_cov = False
    with _reading_text(path) as file:
        lines = csv.reader(file)
        if tuple(next(lines, ())) != CSV_HEADER:
            raise LogFormatError(f"{path} is not a trajectory: its first line must be {','.join(CSV_HEADER)!r}")
        for row in lines:
            where = f"{path}, line {lines.line_num}"
            _check_length(row, CSV_HEADER, where)
            has_cov = any(row[4:10])
            is_any_cov |= has_cov
            numbers.append(_numbers(row[:10] if has_cov else [*row[:4], *["nan"] * 6], where))
            outcomes.append(row[10])
    table = np.array(numbers).reshape(-1, 10)
    covariances = None
    if is_any_cov:
        covariances = np.empty((len(table), 3, 3))
        covariances[:, _UPPER[0], _UPPER[1]] = covariances[:, _UPPER[1], _UPPER[0]] = table[:, 4:]
    return PoseRows(table[:, 0], table[:, 1:4], covariances), tuple(outcomes)


def _column_rows(path: Path) -> PoseRows:
    """Return the poses of any CSV whose first line, blanks and comments left out, names the columns."""
    names: list[str] = []
    rows: list[list[float]] = []
    with _reading_text(path) as file:
        # lines keep their numbers: a comment becomes a blank row
        lines = csv.reader("" if line.lstrip().startswith("#") else line for line in file)
        for row in lines:
            if not any(field.strip() for field in row):
                continue
            if not names:
                names = [name.strip().lower() for name in row]
                stamp = next((name for name in ("stamp", "timestamp") if name in names), None)
                if stamp is None or not {*_POSE_NAMES} <= {*names}:
                    raise LogFormatError(
                        f"{path}: poses in CSV need the columns stamp (or timestamp), x, y and theta, got "
                        f"{', '.join(names)[:60]!r}"
                    )
                columns = [names.index(name) for name in (stamp, *_POSE_NAMES)]
                continue
            where = f"{path}, line {lines.line_num}"
            _check_length(row, names, where)
            rows.append(_numbers([row[k] for k in columns], where))
    table = np.array(rows).reshape(-1, 4)
    return PoseRows(table[:, 0], np.column_stack([table[:, 1:3], se2.wrap(table[:, 3])]))


def _check_length(row: list[str], header: Sequence[str], where: str) -> None:
    if len(row) != len(header):
        raise LogFormatError(f"{where}: a row has {len(header)} fields, as the header has, got {len(row)}")


def read_rows(path: str | os.PathLike[str]) -> PoseRows:
    """Return the poses in a file; see :meth:`curvescan.Trajectory.read`."""
    file = results_file(path)
    if file.is_dir():
        raise LogFileError(f"{path} is a folder without a trajectory.csv: give the results of a run, or a file")
    if not file.exists():
        raise LogFileError(f"trajectory {path} does not exist: check the path")
    if is_packed(file):
        raise LogFormatError(f"{file} is compressed with gzip and not a log: unpack it first")
    first = first_line(read_head(file, _HEAD_BYTES))
    if _n_numbers(first) == KITTI.n_fields:
        return rows_of(file, KITTI)
    is_tum = _n_numbers(first) > 3
    if first and not is_tum and "," not in first:
        raise LogFormatError(
            f"{file} holds no poses that can be read: give TUM text, CSV with columns stamp, x, y, theta, "
            "or a log, whose poses are read_log(path).odometry"
        )
    if not is_tum:
        rows = csv_rows(file)[0] if is_our_csv(first) else _column_rows(file)
        if not len(rows.stamps):
            raise LogFormatError(f"{file} is empty: a trajectory must hold at least one pose")
        return rows
    fields = first.split()
    length = math.hypot(*map(float, fields[4:8]))
    if len(fields) == 8 and abs(length - 1.0) > 0.01:  # relations have as many numbers
        raise LogFormatError(
            f"{file}: the quaternion of a TUM line (stamp x y z qx qy qz qw) has length 1, that of the first line has "
            f"{length:.3g}: if the file holds relations, read it with read_relations"
        )
    return rows_of(file, TUM)


def results_file(path: str | os.PathLike[str]) -> Path:
    """Return the trajectory in a folder of results; any other path as it is."""
    file = as_path(path, "a trajectory")
    return file / "trajectory.csv" if (file / "trajectory.csv").exists() else file


def is_our_csv(first: str) -> bool:
    """Return whether a first line is the header of the CSV that this package writes."""
    return first.split(",") == list(CSV_HEADER)


def first_line(head: bytes) -> str:
    """Return the first line that is neither blank nor a comment; "" without any."""
    lines = (line.strip() for line in head.splitlines())
    return next((line for line in lines if line and not line.startswith(b"#")), b"").decode("utf-8", errors="replace")


def _n_numbers(line: str) -> int:
    """Return how many numbers a line is; 0 where it holds anything else."""
    try:
        return len([float(field) for field in line.split()])
    except ValueError:
        return 0


def _numbers(fields: Iterable[str], where: str) -> list[float]:
    try:
        return [float(field) for field in fields]
    except ValueError as error:
        raise LogFormatError(f"{where}: a field is not a number ({printable(str(error), 120)})") from None


@contextmanager
def writing_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file that replaces `path` in one step when the block ends; raise OutputError where it cannot."""
    with output_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        yield file


@contextmanager
def _reading_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file to read; raise LogFileError or LogFormatError where it cannot be read."""
    text = as_path(path, "a trajectory")
    try:
        with text.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            yield file
    except (LogFileError, LogFormatError):
        raise
    except FileNotFoundError as error:
        raise LogFileError(f"trajectory {path} does not exist: check the path") from error
    except csv.Error as error:
        raise LogFormatError(f"{path} is not a CSV file: {error}") from error
    except (OSError, ValueError) as error:
        raise LogFileError(f"cannot read {path}: {error}") from error
