"""What every source of scans offers, whether a file or a simulated world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from curvescan.errors import InvalidArgumentError
from curvescan.scan import LaserScan
from curvescan.types import Floats, Pose, Trajectory


@dataclass(frozen=True, kw_only=True)
class ReadError:
    """One kind of error met while reading a log: counted, reported, not fatal.

    Attributes
    ----------
    rule : str
        What was broken, as a phrase: ``"FLASER line cut short"``.
    count : int
        How often.
    first : str
        Where it was met first: ``"line 17"``.
    """

    rule: str
    count: int
    first: str


@runtime_checkable
class Log(Protocol):
    """A finite sequence of scans in the order they were recorded, which can be read again and again."""

    @property
    def name(self) -> str:
        """Name for titles and messages: the file's name or the world's."""
        ...

    @property
    def format(self) -> str:
        """Format in words: ``"CARMEN log"``."""
        ...

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry: pose of the *sensor* at each scan in the odometry's own frame; None without."""
        ...

    @property
    def read_errors(self) -> tuple[ReadError, ...]:
        """Faults of the whole log, most frequent first; empty for a sound one."""
        ...

    @property
    def tag_counts(self) -> Mapping[str, int]:
        """How many messages of each kind the source holds, read or not; empty where all are scans."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the reader, a sentence each: what it left out or assumed; empty where nothing."""
        ...

    def __len__(self) -> int:
        """Return the number of scans."""
        ...

    def __iter__(self) -> Iterator[LaserScan]:
        """Yield the scans in file order, one in memory at a time."""
        ...


@runtime_checkable
class GyroLog(Protocol):
    """A log that also holds a gyroscope."""

    def turned_by_gyro(self) -> Floats | None:
        """Return (n_scans,) the angle about z that the gyroscope has turned by at each scan, NaN where not covered.

        Radians if its driver keeps to REP-103. None without a gyroscope.
        """
        ...


def pick_scans(log: Log, numbers: Sequence[int]) -> list[LaserScan]:
    """Return the scans of these numbers, in the order given; one pass over the log.

    Parameters
    ----------
    log : Log
        Any log.
    numbers : sequence of int
        Scans are numbered from 0.

    Raises
    ------
    InvalidArgumentError
        When a number is negative or beyond the last scan.
    """
    for number in numbers:
        if not 0 <= number < len(log):
            raise InvalidArgumentError(
                f"there is no scan {number}: {log.name} has {len(log):,} scans, "
                f"numbered 0 to {len(log) - 1}"
            )
    found: dict[int, LaserScan] = {}
    for number, scan in enumerate(log):
        if number in numbers:
            found[number] = scan
        if len(found) == len(set(numbers)):
            break
    return [found[number] for number in numbers]


def scans_with_poses(log: Log) -> Iterator[tuple[LaserScan, Pose | None]]:
    """Yield each scan with its row of the odometry; None where there is none."""
    odometry = log.odometry
    for i, scan in enumerate(log):
        pose = None if odometry is None or i >= len(odometry) else odometry.poses[i]
        yield scan, None if pose is None or not all(abs(v) < float("inf") for v in pose) else pose
