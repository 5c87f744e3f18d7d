"""Poses as the files of trajectories have them, arrays without a class of their own, and the text that they stand in."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol, TextIO

from curvescan.errors import CurvescanError, LogFileError, LogFormatError, OutputError
from curvescan.io.files.output import output_file
from curvescan.io.files.printable import printable
from curvescan.types import Cov, Floats, Pose


class PoseRows(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    stamps : (n,) float64
        Seconds.
    poses : (n, 3) float64
        [x, y, theta], metres, metres, radians.
    covariances : (n, 3, 3) float64 or None
        In the order x, y, theta; None where the file has none.
    """

    stamps: Floats
    poses: Pose
    covariances: Cov | None = None


class PosesInTime(Protocol):
    """What is written: a Trajectory, or rows."""

    @property
    def stamps(self) -> Floats:
        """Stamps, (n,), seconds."""
        ...

    @property
    def poses(self) -> Pose:
        """Poses, (n, 3): metres, metres, radians."""
        ...

    @property
    def covariances(self) -> Cov | None:
        """Covariances, (n, 3, 3); None without."""
        ...


def numbers_of(fields: Iterable[str], where: str) -> list[float]:
    """Return the numbers of a line; raise LogFormatError where a field is none."""
    try:
        return [float(field) for field in fields]
    except ValueError as error:
        raise LogFormatError(f"{where}: a field is not a number ({printable(str(error), 120)})") from None


@contextmanager
def writing_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file that replaces `path` in one step when the block ends; raise OutputError where it cannot."""
    try:
        with output_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
            yield file
    except CurvescanError:
        raise
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot write {path}: {error}") from error


@contextmanager
def reading_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file to read; raise LogFileError or LogFormatError where it cannot be read."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace", newline="") as file:
            yield file
    except (LogFileError, LogFormatError):
        raise
    except FileNotFoundError as error:
        raise LogFileError(f"trajectory {path} does not exist: check the path") from error
    except csv.Error as error:
        raise LogFormatError(f"{path} is not a CSV file: {error}") from error
    except (OSError, ValueError) as error:
        raise LogFileError(f"cannot read {path}: {error}") from error
