"""What a user knows of a laser better than its log: a record, and the view of a log that applies it."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log, LogView, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan, mirrored, swept_backwards, without_readings
from curvescan.types import Pose, three_numbers


@dataclass(frozen=True, kw_only=True)
class SensorSetup:
    """How a laser is set up, where its log does not say so or is wrong; see :func:`curvescan.read_log`."""

    ignore_beams: tuple[int, int] = (0, 0)
    laser_pose: tuple[float, float, float] | None = None
    upside_down: bool | None = None
    clockwise: bool = False
    drop_stale: bool = False
    backwards: bool = False

    def __post_init__(self) -> None:
        beams = self.ignore_beams
        is_pair = isinstance(beams, Sequence) and len(beams) == 2
        if not is_pair or not all(isinstance(n, int) and n >= 0 for n in beams):
            raise InvalidArgumentError(
                f"ignore_beams must be two whole numbers >= 0, of beams at the sweep's beginning and end, got {beams}"
            )
        if self.laser_pose is not None:
            as_mount(self.laser_pose)


def as_mount(laser_pose: ArrayLike) -> Pose:
    """Return the pose of a laser on its robot, (3,). Raises InvalidArgumentError."""
    return three_numbers(laser_pose, "laser_pose must be three finite numbers x, y, theta (metres, metres, radians)")


def apply_setup(log: Log, setup: SensorSetup) -> Log:
    """Return a log whose scans and odometry are as the setup has them: the log itself where nothing changes."""
    hangs = setup.upside_down
    if hangs is None:
        hangs = isinstance(log, ScanAccess) and log.hangs_upside_down()
    is_mirrored = hangs != setup.clockwise
    if not (
        is_mirrored or any(setup.ignore_beams) or setup.laser_pose is not None or setup.drop_stale or setup.backwards
    ):
        return log
    return _LogSetUp(log, setup, is_mirrored=is_mirrored)


def setup_of(log: Log) -> SensorSetup:
    """Return the setup that a log, or the log below a view of it, was given by its user."""
    while isinstance(log, LogView):
        if isinstance(log, _LogSetUp):
            return log.setup
        log = log.below
    return SensorSetup()


class _LogSetUp(LogView):
    """A log with the user's sensor set-up applied."""

    def __init__(self, log: Log, setup: SensorSetup, *, is_mirrored: bool) -> None:
        super().__init__(log)
        self.setup = setup
        self._is_mirrored = is_mirrored

    @property
    def odometry(self) -> Trajectory | None:
        if self.setup.laser_pose is None:
            return self._log.odometry
        if (robot := self.robot_odometry()) is None:
            return None
        poses = se2.compose(robot.poses, np.array(self.setup.laser_pose))
        return Trajectory(stamps=robot.stamps, poses=poses)

    def robot_odometry(self) -> Trajectory | None:
        """Return what the log says of the robot; with a pose of the laser given, its odometry is the robot's."""
        robot = super().robot_odometry()
        return robot if robot is not None or self.setup.laser_pose is None else self._log.odometry

    def hangs_upside_down(self) -> bool:
        """Return what the user says, else the log; the scans have been mirrored for it."""
        if self.setup.upside_down is not None:
            return self.setup.upside_down
        return super().hangs_upside_down()

    @property
    def notes(self) -> tuple[str, ...]:
        turned = "turns against what the log says" if self.setup.clockwise else "hangs upside down"
        first, last = self.setup.ignore_beams
        said = {
            f"the scans are mirrored: the laser {turned}": self._is_mirrored,
            "readings that repeat those of the sweep before are dropped": self.setup.drop_stale,
            "the beams of each scan are turned round: they were swept in that order": self.setup.backwards,
            f"the first {first:,} and the last {last:,} beams of each scan are ignored": first or last,
        }
        notes = [note for note, holds in said.items() if holds]
        if self.setup.laser_pose is not None:
            x, y, theta = self.setup.laser_pose
            notes.append(
                f"the laser's mount is taken as given: x {x:.3f} m, y {y:.3f} m, yaw {math.degrees(theta):.1f} deg"
            )
        return (*self._log.notes, *notes)

    def __iter__(self) -> Iterator[LaserScan]:
        scans = fresh(self._log) if self.setup.drop_stale else self._log
        return map(self._seen, scans)

    def _scan_at(self, i: int) -> LaserScan:
        scan = self._log[i]
        if self.setup.drop_stale and i > 0:
            *_, scan = fresh((self._log[i - 1], scan))
        return self._seen(scan)

    def _seen(self, scan: LaserScan) -> LaserScan:
        first, last = self.setup.ignore_beams
        if first or last:
            ranges = scan.ranges.copy()
            ranges[:first] = np.nan
            ranges[max(len(ranges) - last, 0) :] = np.nan
            scan = replace(scan, ranges=ranges)
        scan = mirrored(scan) if self._is_mirrored else scan
        return swept_backwards(scan) if self.setup.backwards else scan


def fresh(scans: Iterable[LaserScan]) -> Iterator[LaserScan]:
    """Yield scans without the readings that repeat the same beam's of the scan before to the last digit."""
    before = np.empty(0)
    for scan in scans:
        same, before = before, scan.ranges
        yield without_readings(scan, scan.valid & (scan.ranges == same)) if len(same) == len(scan) else scan
