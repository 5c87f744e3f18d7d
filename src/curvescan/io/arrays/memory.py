"""Logs of scans that are in memory already: from a driver, a simulator, another library's reader."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import check_names
from curvescan.errors import InvalidArgumentError, require
from curvescan.io.files.lines import ReadError
from curvescan.io.log import Log, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan


@dataclass(frozen=True, kw_only=True, repr=False)
class MemoryLog(ScanAccess):
    """Scans in memory, and the pose of the sensor by its wheels at each; a Log. No file could be broken."""

    scans: tuple[LaserScan, ...]  # in the order they were recorded
    odometry: Trajectory | None = None  # wheel odometry: pose of the sensor at each scan
    # name, format: for titles and messages
    name: str = "arrays"
    format: str = "scans in memory"
    read_errors: tuple[ReadError, ...] = ()
    tag_counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[LaserScan]:
        return iter(self.scans)

    def _scan_at(self, i: int) -> LaserScan:
        return self.scans[i]


def as_log(scans: Log | Iterable[LaserScan]) -> Log:
    """Return a log, or scans as one, with the odometry they have. Raises InvalidArgumentError where they are none."""
    # in this order: to tell a Log, Python 3.11 gets each of its properties, and a bag reads all its scans for them
    if isinstance(scans, ScanAccess | Log):
        return scans
    found = tuple(scans) if isinstance(scans, Iterable) else (scans,)
    wrong = next((scan for scan in found if not isinstance(scan, LaserScan)), None)
    if wrong is not None or not isinstance(scans, Iterable):
        raise InvalidArgumentError(
            f"a log must be a Log, an iterable of LaserScan or the path of a file, got {type(scans).__name__}"
            + f" with a {type(wrong).__name__}" * isinstance(scans, Iterable)
        )
    if all(scan.odometry is None for scan in found):
        return MemoryLog(scans=found, name="scans")
    poses = [np.full(3, np.nan) if scan.odometry is None else scan.odometry for scan in found]
    # a run looks whether they agree with the scans before it uses them
    found = tuple(replace(scan, odometry=None) for scan in found)
    return MemoryLog(scans=found, odometry=_trajectory(found, poses), name="scans")


class ScanLayout(TypedDict, total=False):
    """What the scans of one sensor share; see :class:`curvescan.LaserScan`."""

    angle_min: float
    angle_increment: float
    angles: ArrayLike
    range_min: float
    range_max: float
    time_increment: float
    scan_time: float


def log_from_arrays(
    readings: Iterable[tuple[float, ArrayLike]],
    *,
    odometry: ArrayLike | None = None,
    name: str = "arrays",
    **layout: Unpack[ScanLayout],
) -> MemoryLog:
    """Return a log of stamped ranges of one sensor, for all that takes a log.

    ``log_from_arrays(zip(stamps, ranges), angle_min=-1.57, angle_increment=0.0087)``

    Parameters
    ----------
    readings : iterable of (float, (n,) array_like)
        Stamp in seconds, and ranges in metres; gone through once and kept. n may change, but with `angles`.
    odometry : (n_scans, 3) array_like or None
        Pose of the sensor at each scan by the wheels, [x, y, theta]; a row of NaN where there is none.
    name : str
        For titles and messages.
    **layout
        What all scans share, as :class:`curvescan.LaserScan` takes it: `angle_min` and `angle_increment`, or `angles`;
        `range_min`, `range_max`, `time_increment`, `scan_time`.

    Raises
    ------
    InvalidArgumentError
        When a pair is none, a scan breaks the rules of LaserScan, or `odometry` has another length.
    """
    check_names(layout, ScanLayout.__annotations__, "layout")
    scans: list[LaserScan] = []
    for i, reading in enumerate(readings):
        try:
            stamp, ranges = reading
            scan = LaserScan(ranges, stamp=stamp, **layout)  # type: ignore[arg-type]
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"scan {i}: {error}") from None
        except (TypeError, ValueError):
            raise InvalidArgumentError(
                f"readings must be pairs of a stamp and ranges, got {reading!r:.60} as number {i}: zip(stamps, ranges) "
                "makes them"
            ) from None
        scans.append(scan)
    return MemoryLog(scans=tuple(scans), odometry=_trajectory(scans, odometry), name=name)


def _trajectory(scans: Sequence[LaserScan], odometry: ArrayLike | None) -> Trajectory | None:
    if odometry is None:
        return None
    rule = f"odometry must be of shape ({len(scans)}, 3), a pose a scan"
    try:
        poses = np.array(odometry, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{rule}: {error}") from None
    require(poses.shape == (len(scans), 3), rule, poses.shape)
    require(not np.isinf(poses).any(), "odometry must be finite or NaN where it is unknown", math.inf)
    poses[:, 2] = se2.wrap(poses[:, 2])
    return Trajectory(stamps=np.array([scan.stamp for scan in scans]), poses=poses)
