"""Rig: several lasers on one robot, joined into one scan seen from the robot's base.

Industrial robots carry two safety scanners at opposite corners. Each sweep is moved to where its laser was at one
common time, by the motion of the base since, and the points of all are seen from the base: of what lies in one
direction the nearest counts, as one laser there would see it.
"""

from __future__ import annotations

import heapq
import itertools
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import counted
from curvescan.deskew import as_twist, deskew, middle_of_sweep
from curvescan.engines.engine import Engine
from curvescan.errors import InvalidArgumentError, require
from curvescan.io import read_log
from curvescan.io.arrays.memory import MemoryLog
from curvescan.io.files.lines import as_path
from curvescan.io.log import Log, LogView, ScanAccess
from curvescan.io.ros.odometry import poses_at
from curvescan.io.ros.transforms import laser_mounts
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import Step
from curvescan.scan import LaserScan, as_float
from curvescan.types import Floats, Points, Pose, three_numbers

_HIDDEN = 0.1
"""A reading is hidden where both neighbours are nearer by this share of its range: it was seen past something."""

_LONGEST_S = 1.0
"""The velocity of the base is not known across a longer pause, seconds."""


@dataclass(frozen=True, eq=False)
class Rig:
    """Named lasers with their mounts on one robot.

    Parameters
    ----------
    mounts : mapping of str to (3,) array_like
        Pose [x, y, theta] of each laser in the frame of the base: metres, metres, radians. At least one.
    body_radius : float
        Readings nearer to the base than this are the robot itself and are left out, metres, >= 0.

    Raises
    ------
    InvalidArgumentError
        When there is no laser, a mount is not three finite numbers, or the radius is negative.

    Examples
    --------
    >>> import curvescan as cs
    >>> rig = cs.Rig({"front": (0.4, 0.3, 0.785), "rear": (-0.4, -0.3, -2.356)})
    >>> sorted(rig.mounts)
    ['front', 'rear']
    """

    mounts: Mapping[str, Pose]
    body_radius: float = 0.0

    def __post_init__(self) -> None:
        mounts = {}
        for name, mount in dict(self.mounts).items():
            pose = three_numbers(mount, f"the mount of {name!r} must be three finite numbers x, y, theta").copy()
            pose.setflags(write=False)
            mounts[name] = pose
        if not mounts:
            raise InvalidArgumentError("mounts must name at least one laser, got none")
        radius = as_float(self.body_radius, "body_radius")
        require(radius >= 0.0, "body_radius must be >= 0 metres", radius)
        object.__setattr__(self, "body_radius", radius)
        object.__setattr__(self, "mounts", mounts)

    def __repr__(self) -> str:
        return f"Rig({', '.join(self.mounts)})"

    def join(self, scans: Mapping[str, LaserScan], velocity: ArrayLike = (0.0, 0.0, 0.0)) -> LaserScan:
        """Return the sweeps of several lasers as one scan of a sensor at the base, at the time of the newest one.

        Parameters
        ----------
        scans : mapping of str to LaserScan
            Sweeps by the names of their lasers; a laser that is silent may be missing.
        velocity : (3,) array_like
            Of the base in its own frame, m/s, m/s, rad/s: moves each sweep to the common time, and its beams to the
            middle of the sweep where the scan has beam times.

        Returns
        -------
        LaserScan
            Beams all around, one a direction of the finest laser, rising; NaN where no laser has a reading. Its stamp
            is the middle of the newest sweep.

        Raises
        ------
        InvalidArgumentError
            When no scan is given, a name is not of this rig, or the velocity is not three finite numbers.
        """
        twist = as_twist(velocity)
        self._check_names(scans, "scans")
        stamps = {name: scan.stamp + middle_of_sweep(scan) for name, scan in scans.items()}
        stamp = max(stamps.values())
        points = np.concatenate(
            [
                se2.transform(
                    se2.compose(se2.exp(twist * (stamps[name] - stamp)), self.mounts[name]),
                    _seen_points(scan, twist, self.mounts[name]),
                )
                for name, scan in scans.items()
            ]
        )
        step = min(abs(scan.angle_increment) for scan in scans.values())
        reach = max(scan.range_max + math.hypot(*self.mounts[name][:2]) for name, scan in scans.items())
        angles, ranges = _from_the_base(points, step, self.body_radius)
        periods = [scan.scan_time for scan in scans.values()]
        return LaserScan(ranges, angles=angles, range_max=reach, stamp=stamp, scan_time=max(periods))

    def together(self, logs: Mapping[str, Iterable[LaserScan]]) -> Iterator[dict[str, LaserScan]]:
        """Yield the sweeps of several lasers in groups of one time, each laser at most once in a group.

        A group is complete when every laser has given a sweep. Where one sends a second sweep before another has sent
        its first, the other is late or dead, and the group goes without it.

        Parameters
        ----------
        logs : mapping of str to iterable of LaserScan
            Scans of each laser by its name, stamps of one clock.

        Raises
        ------
        InvalidArgumentError
            When a name is not of this rig.
        """
        self._check_names(logs, "logs")
        return _groups(logs)

    def _check_names(self, given: Mapping[str, Any], what: str) -> None:
        unknown = sorted(set(given) - set(self.mounts))
        if unknown or not given:
            raise InvalidArgumentError(
                f"{what} must be of {', '.join(self.mounts)}, got {', '.join(unknown) or 'none'}"
            )

    def track(self, logs: Mapping[str, Iterable[LaserScan]], engine: Engine) -> Iterator[Step]:
        """Yield the steps of an odometry, a SLAM or a localizer that is given the joined scans of several lasers.

        Parameters
        ----------
        logs : mapping of str to iterable of LaserScan
            Scans of each laser by its name, stamps of one clock.
        engine : Odometry, Slam or Localizer
            Its poses are those of the base.

        Raises
        ------
        InvalidArgumentError
            When a name is not of this rig.
        """
        self._check_names(logs, "logs")
        return (step for _, step in self.joined(logs, engine))

    def joined(self, logs: Mapping[str, Iterable[LaserScan]], engine: Engine) -> Iterator[tuple[LaserScan, Step]]:
        """Yield the joined scans, each with its step by an engine, whose motion joins the next one."""
        joiner = RigJoiner(len(logs), self)
        for scans in self.together(logs):
            scan = joiner.join(scans)
            step = engine.add(scan)
            joiner.moved(scan, step.motion)
            yield scan, step

    @classmethod
    def of_bag(cls, path: str | os.PathLike[str], *, body_radius: float = 0.0) -> Self:
        """Return the lasers of a bag, by their topics, with the mounts that its transforms give.

        Parameters
        ----------
        path : str or path-like
            A ROS bag.
        body_radius : float
            See :class:`Rig`.

        Raises
        ------
        InvalidArgumentError
            When the transforms do not lead from the robot's base to each laser.
        LogFileError, LogFormatError
            When the bag cannot be read.
        """
        mounts = laser_mounts(as_path(path, "a bag"))
        unknown = [topic for topic, mount in mounts.items() if mount is None]
        if unknown:
            raise InvalidArgumentError(
                f"the transforms of {path} must lead from base_link to each laser, and do not to {', '.join(unknown)}: "
                "find the mounts by calibrate --mounts, and give them to Rig(mounts).read(path)"
            )
        return cls({topic: mount for topic, mount in mounts.items() if mount is not None}, body_radius)

    def read(self, path: str | os.PathLike[str]) -> RigLog:
        """Return the scans of a bag's lasers joined into one at the robot's base, with its wheels, as a log.

        Parameters
        ----------
        path : str or path-like
            A ROS bag whose topics are the names of the lasers.

        Raises
        ------
        LogFileError, LogFormatError
            When the bag cannot be read.
        InvalidArgumentError
            When a laser has no topic in it.
        """
        return RigLog(self, {topic: read_log(path, topic=topic) for topic in self.mounts})


class RigLog(LogView):
    """The scans of a rig's lasers as one log at the robot's base; they are joined when they are first asked for.

    lasers: the log of each, by its name. A laser's faults are mended before its scans are joined with others': a code
    for no return is none any more after the readings have been moved.
    """

    def __init__(self, rig: Rig, lasers: Mapping[str, Log]) -> None:
        self.rig, self.lasers = rig, lasers

    @cached_property
    def _log(self) -> MemoryLog:  # type: ignore[override]  # made when it is first asked for
        scans = tuple(scan for scan, _ in self.rig.joined(self.lasers, Odometry()))
        first = next(iter(self.lasers.values()))
        wheels = first.robot_odometry() if isinstance(first, ScanAccess) else None
        stamps = np.array([scan.stamp for scan in scans])
        return MemoryLog(
            scans=scans,
            odometry=None if wheels is None else Trajectory(stamps=stamps, poses=poses_at(stamps, wheels.to_array())),
            name=first.name,
            format=first.format,
            notes=(f"of {counted(len(self.lasers), 'laser')}, joined at the robot's base: {', '.join(self.lasers)}",),
        )

    @cached_property
    def _n_scans(self) -> int:
        return sum(1 for _ in self.rig.together(self.lasers))

    def __len__(self) -> int:
        return self._n_scans

    def __iter__(self) -> Iterator[LaserScan]:
        return iter(self._log)


def _groups(logs: Mapping[str, Iterable[LaserScan]]) -> Iterator[dict[str, LaserScan]]:
    groups = RigJoiner(len(logs))
    streams = [zip(itertools.repeat(name), log, strict=False) for name, log in logs.items()]
    for name, scan in heapq.merge(*streams, key=lambda item: item[1].stamp):
        if (group := groups.collect(name, scan)) is not None:
            yield group
    if groups.begun:
        yield groups.begun


class RigJoiner:
    """Joins the sweeps of a rig as they come, each group moved by the velocity that the step before it had."""

    def __init__(self, n_lasers: int, rig: Rig | None = None) -> None:
        self.rig, self._n_lasers = rig, n_lasers
        self.begun: dict[str, LaserScan] = {}  # the sweeps of a group that is not complete
        self._velocity, self._before = np.zeros(3), math.nan

    def collect(self, name: str, scan: LaserScan) -> dict[str, LaserScan] | None:
        """Return a group that this sweep completes or ends; None while it waits for the other lasers."""
        ended = self.begun if name in self.begun else None
        if ended is not None:
            self.begun = {}
        self.begun[name] = scan
        if len(self.begun) == self._n_lasers:
            ended, self.begun = self.begun, {}
        return ended

    def join(self, scans: Mapping[str, LaserScan]) -> LaserScan:
        """Return a group of sweeps as one scan of a sensor at the base."""
        assert self.rig is not None
        return self.rig.join(scans, self._velocity)

    def moved(self, scan: LaserScan, motion: Pose) -> None:
        """Take note of the motion of the base up to a joined scan: the next group is moved by it."""
        seconds = scan.stamp - self._before
        is_known = 0.0 < seconds < _LONGEST_S and bool(np.isfinite(motion).all())
        self._velocity, self._before = se2.log(motion) / seconds if is_known else np.zeros(3), scan.stamp


def _seen_points(scan: LaserScan, twist: Floats, mount: Pose) -> Points:
    """Return (k, 2) readings of a sweep as of its middle, in its laser's frame."""
    vx, vy, omega = twist
    at_laser = np.array([vx - omega * mount[1], vy + omega * mount[0]])
    own = np.array([*(se2.rotation(float(mount[2])).T @ at_laser), omega])
    still = deskew(scan, own)
    return still.points[still.valid]


def _from_the_base(points: Points, step: float, body_radius: float) -> tuple[Floats, Floats]:
    """Return rising directions all around, and the ranges of the nearest points in each, NaN without; both (n,)."""
    n = max(int(2.0 * math.pi / step), 1)
    width = 2.0 * math.pi / n
    angles: Floats = np.arange(n, dtype=np.float64) * width + (0.5 * width - math.pi)
    ranges = np.full(n, np.nan)
    distance = np.hypot(points[:, 0], points[:, 1])
    is_other = distance > body_radius
    points, distance = points[is_other], distance[is_other]
    bearing = np.arctan2(points[:, 1], points[:, 0])
    cell = np.clip(((bearing + math.pi) / width).astype(np.int64), 0, n - 1)
    order = np.argsort(-distance, kind="stable")  # the nearest is written last
    angles[cell[order]], ranges[cell[order]] = bearing[order], distance[order]
    beside: Any = np.fmax(_nearest(ranges, 1), _nearest(ranges, -1))
    seen: Floats = np.where(ranges - beside > _HIDDEN * ranges, np.nan, ranges)
    return angles, seen


def _nearest(ranges: Floats, way: int) -> Floats:
    """Return (n,) the nearer of the two readings on one side of each direction; inf without any."""
    shifted = np.fmin(np.roll(ranges, way), np.roll(ranges, 2 * way))
    nearer: Floats = np.where(np.isnan(shifted), np.inf, shifted)
    return nearer
