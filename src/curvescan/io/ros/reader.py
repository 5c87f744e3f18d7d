"""RosbagLog: the laser scans of a ROS bag, ROS 1 or ROS 2, read without ROS.

Ranges and limits are taken as they are (REP-117): 0, NaN and infinities are *no reading*. So are the beams' directions:
where the transforms say that the laser hangs upside down, :func:`curvescan.io.read_log` mirrors the scans.
"""

from __future__ import annotations

import difflib
import math
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.lines import BrokenRecordError, ReadError, ReadErrorCounter
from curvescan.io.log import ScanAccess
from curvescan.io.ros.bags.bag import Bag, Message
from curvescan.io.ros.messages import LASER_SCAN, has_bad_times, scan_of, short_name, shown, stamp_of
from curvescan.io.ros.odometry import BagOdometry, read_gyro, read_odometry
from curvescan.io.ros.transforms import N_FIRST_SCANS, laser_tilt, tilt_notes
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats

BROKEN_BAG = "bag damaged from here on: what stands before is read"
CUT_BAG = "bag cut short: its end is missing, what stands before is read"
_LATEST = (1 << 63) - 1  # nanoseconds; an MCAP file can claim twice as many
_MAX_LISTED = 12


@dataclass(frozen=True)
class _Survey:
    """What one reading of all scans found."""

    stamps: array[float]
    received: array[int]
    read_errors: tuple[ReadError, ...]
    n_bad_times: int


class RosbagLog(ScanAccess):
    """The scans of one laser of a ROS bag, in the order of reception; a Log that is read when it is first asked."""

    def __init__(self, path: Path, *, range_max: float | None = None, topic: str | None = None) -> None:
        self._bag = Bag(path)
        self.topic = _choose_topic(self._bag, topic)  # the one that is read
        self.name = path.absolute().name
        self.format = self._bag.kind.value  # ``"ROS 1 bag"``, ``"ROS 2 bag (sqlite3)"`` or ``"ROS 2 bag (MCAP)"``
        self._range_max = range_max
        self._survey: _Survey | None = None
        self._frame, self._is_unstamped = "", False
        is_sound = self._look_at_first()
        if not is_sound and next(iter(self), None) is None:
            faults = self._surveyed().read_errors
            reason = faults[0] if faults else "its table of contents promises messages that are not there"
            raise LogFormatError(
                f"{path} is a {self.format} without a scan that can be read on topic {shown(self.topic)}: {reason}"
            )

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry at the stamps of the scans: the pose of the laser, by its mount, in the odometry's frame.

        From nav_msgs/Odometry, else from the transform odom -> base of /tf, interpolated in time; a row of NaN outside
        the time they cover. ``notes`` describes the mount. None without any.
        """
        return self._odometry.trajectory

    @property
    def read_errors(self) -> tuple[ReadError, ...]:
        """Scans that were skipped and damage of the bag, most frequent first."""
        return self._surveyed().read_errors

    @property
    def tag_counts(self) -> Mapping[str, int]:
        """Messages by topic and type, ``"/scan (sensor_msgs/LaserScan)"``, by the bag's own count."""
        counts: dict[str, int] = {}
        for name, topic in self._bag.topics.items():
            tag = f"{shown(name)} ({short_name(topic.msgtype)})"
            counts[tag] = counts.get(tag, 0) + topic.count
        return MappingProxyType(counts)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or assumed."""
        others = [name for name in _laser_topics(self._bag) if name != self.topic]
        notes = [f"laser scans on {shown(name)} are not read: the topic is another" for name in others[:_MAX_LISTED]]
        if self._is_unstamped:
            notes.append("the scans are not stamped (all zeros): the time they were received stands for it")
        if self._surveyed().n_bad_times:
            notes.append(
                f"{self._surveyed().n_bad_times:,} scans have a time_increment or scan_time that is negative or no "
                "number: it is taken as not known"
            )
        return (*notes, *self._bag.notes, *self._odometry.notes, *tilt_notes(self._tilt))

    def robot_odometry(self) -> Trajectory | None:
        """Return ``odometry`` without the laser's mount: the pose of the robot's base at each scan."""
        return self._odometry.robot

    def hangs_upside_down(self) -> bool:
        """Return whether /tf or /tf_static has the laser's z axis point down."""
        return self._tilt > 0.5 * math.pi

    def n_recorded(self) -> int:
        """Return about how many scans on the topic were recorded, by the bag's own count or its length."""
        return self._bag.n_recorded(self.topic)

    def why_estimated(self) -> str:
        """Return what says that the poses are the output of SLAM, localization or laser odometry; empty for none."""
        return self._odometry.why_estimated

    def turned_by_gyro(self) -> Floats | None:
        """Return (n_scans,) the angle about z that the bag's gyroscope has measured by each scan; None without one."""
        stamps = np.array(self._surveyed().stamps)
        return read_gyro(self._bag, stamps, is_unstamped=self._is_unstamped)

    def __len__(self) -> int:
        return len(self._surveyed().stamps)

    def __iter__(self) -> Iterator[LaserScan]:
        read_errors, stamps, received = ReadErrorCounter("message"), array("d"), array("q")
        number, n_bad_times = 0, 0
        try:
            for number, message in enumerate(self._bag.messages([self.topic]), 1):
                try:
                    decoded = self._bag.decode(message)
                    scan = self._scan(decoded, message)
                except BrokenRecordError as error:
                    read_errors.add(str(error), number)
                    continue
                stamps.append(scan.stamp)
                received.append(min(message.received, _LATEST))
                n_bad_times += has_bad_times(decoded)
                yield scan
            if self._bag.is_cut:
                read_errors.add(CUT_BAG, number + 1)
        except LogFormatError:
            read_errors.add(BROKEN_BAG, number + 1)
        self._survey = self._survey or _Survey(stamps, received, read_errors.read_errors(), n_bad_times)

    def __repr__(self) -> str:
        # to count the scans that can be read may take long: the bag's own count will do
        n = self._bag.topics[self.topic].count
        return f"Log({self.name!r}: {self.format}, {counted(n, 'scan')} on {shown(self.topic)})"

    def _scan_at(self, i: int) -> LaserScan:
        """Return a scan by the time it was received at, which the bag has an index of."""
        received = np.array(self._surveyed().received)
        when = int(received[i])
        nth = int(np.count_nonzero(received[:i] == when))
        for message in self._bag.messages([self.topic], when):
            try:
                scan = self._scan(self._bag.decode(message), message)
            except BrokenRecordError:
                continue
            if nth == 0:
                return scan
            nth -= 1
        raise LogFileError(f"{self._bag.path} has changed since it was opened: scan {i} has gone")

    def _surveyed(self) -> _Survey:
        if self._survey is None:
            for _ in self:
                pass
        assert self._survey is not None
        return self._survey

    @cached_property
    def _tilt(self) -> float:
        return laser_tilt(self._bag, self._frame)

    @cached_property
    def _odometry(self) -> BagOdometry:
        stamps = np.array(self._surveyed().stamps)
        return read_odometry(self._bag, stamps, self._frame, is_unstamped=self._is_unstamped)

    def _look_at_first(self) -> bool:
        """Learn the scans' frame, and that they are stamped unless several are at 0; return whether one can be read."""
        stamps, is_sound = [], False
        for message in islice(self._bag.messages([self.topic]), N_FIRST_SCANS):
            try:
                decoded = self._bag.decode(message)
                stamps.append(stamp_of(decoded.header))
                self._frame = self._frame or str(decoded.header.frame_id)
                scan_of(decoded, range_max=self._range_max)
                is_sound = True
            except (BrokenRecordError, AttributeError, TypeError, OverflowError):
                continue
        self._is_unstamped = len(stamps) > 1 and not any(stamps)
        return is_sound

    def _scan(self, decoded: Any, message: Message) -> LaserScan:
        stamp = message.received / 10**9 if self._is_unstamped else None
        return scan_of(decoded, stamp=stamp, range_max=self._range_max)


def _laser_topics(bag: Bag) -> dict[str, int]:
    return {name: topic.count for name, topic in bag.topics.items() if topic.msgtype == LASER_SCAN and topic.count}


def _choose_topic(bag: Bag, topic: str | None) -> str:
    lasers = _laser_topics(bag)
    if not lasers:
        held = [f"{shown(name)} ({topic.count:,} {short_name(topic.msgtype)})" for name, topic in bag.topics.items()]
        more = f" and {len(held) - _MAX_LISTED} more" if len(held) > _MAX_LISTED else ""
        raise LogFormatError(
            f"{bag.path} is a {bag.kind.value} without a laser scan: it needs sensor_msgs/LaserScan messages, and "
            f"holds {', '.join(held[:_MAX_LISTED]) or 'no topic'}{more}"
        )
    listed = ", ".join(f"{shown(name)} ({n:,} scans)" for name, n in list(lasers.items())[:_MAX_LISTED])
    if topic is None:
        if len(lasers) == 1:
            return next(iter(lasers))
        raise InvalidArgumentError(
            f"{bag.path} holds laser scans on {len(lasers)} topics: {listed}; choose one with "
            f"topic={shown(next(iter(lasers)))!r}, or join them with Rig.of_bag"
        )
    for name in lasers:
        if name.strip("/") == topic.strip("/"):
            return name
    near = difflib.get_close_matches(topic, lasers, n=1, cutoff=0.0)[0]
    other = bag.topics.get(topic)
    what = (
        f"topic {topic} of {bag.path} holds {short_name(other.msgtype)}"
        if other
        else f"{bag.path} has no topic {topic!r} with laser scans"
    )
    raise InvalidArgumentError(f"{what}: the nearest is {shown(near)}; it holds {listed}")
