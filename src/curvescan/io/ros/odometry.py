"""Wheel odometry and gyroscope of a bag at the stamps of its scans; odometry is composed with the laser's mount."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.io.ros.bags.bag import Bag, Message
from curvescan.io.ros.messages import IMU, ODOMETRY, TRANSFORMS, shown, stamp_of
from curvescan.io.ros.transforms import FARTHEST, Edge, FrameTree, frame_name, planar, seven
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Floats, Pose

_USUAL_BASES = ("base_link", "base_footprint")


@dataclass(frozen=True, kw_only=True)
class BagOdometry:
    """The odometry in a bag."""

    # pose of the laser at each scan in the odometry's frame; NaN where not covered. None without any
    trajectory: Trajectory | None = None
    robot: Trajectory | None = None  # pose of the robot's base likewise
    notes: tuple[str, ...] = ()  # where it is from and what was assumed of the mount
    why_estimated: str = ""  # what says that SLAM, localization or laser odometry gave it; empty for none


def read_odometry(bag: Bag, stamps: Floats, frame: str, *, is_unstamped: bool) -> BagOdometry:
    """Return the odometry of a bag, from one pass over its odometry and its transforms. stamps (n,)."""
    odometry_topics = [n for n, t in bag.topics.items() if t.msgtype == ODOMETRY and t.count]
    transform_topics = [n for n, t in bag.topics.items() if t.msgtype in TRANSFORMS and t.count]
    usual = [name for name in odometry_topics if name.strip("/") == "odom"]
    chosen = next(iter(odometry_topics if len(odometry_topics) == 1 else usual), None)
    notes = []
    if chosen is None and odometry_topics:
        several = ", ".join(shown(name) for name in odometry_topics[:8])
        notes.append(f"of several odometry topics ({several}) none is /odom: none is read")
    reader = _Reader(is_unstamped=is_unstamped)
    topics = [*transform_topics, *([chosen] if chosen else [])]
    n_broken = bag.each(topics, reader.add) if topics else 0
    if n_broken:
        notes.append(f"{n_broken:,} odometry or transform messages cannot be decoded: they are left out")
    if reader.odometry:
        edge, motion, source = reader.odometry_edge, reader.odometry, shown(chosen or "")
    elif base := _nearest_base(reader.tree, reader.motions, frame_name(frame)):
        edge, motion = base, reader.motions[base]
        source = f"transforms {shown(edge[0])} to {shown(edge[1])}"
    else:
        return BagOdometry(notes=tuple(notes))
    poses = poses_at(stamps, np.array(motion).reshape(-1, 4))
    if np.all(np.isnan(poses)):
        notes.append(f"odometry from {source} does not cover the time of any scan: it is left out")
        return BagOdometry(notes=tuple(notes))
    mount, mount_notes = _mount(reader.tree, edge, frame_name(frame))
    notes.append(f"odometry is from {source}; {mount_notes[0]}")
    return BagOdometry(
        trajectory=Trajectory(stamps=stamps, poses=se2.compose(poses, mount)),
        robot=Trajectory(stamps=stamps, poses=poses),
        notes=(*notes, *mount_notes[1:]),
        why_estimated=_why_estimated(edge, frame_name(frame), source, has_covariance=reader.has_covariance),
    )


def _why_estimated(edge: Edge, laser: str, source: str, *, has_covariance: bool) -> str:
    """Return the sign that an odometry was estimated from scans: its frames, or an estimated covariance."""
    parent, child = edge
    if parent.rpartition("/")[2] == "map":
        return f"{source} is in frame map, which SLAM and localization give"
    if child == laser and has_covariance:
        return f"{source} is of the laser itself and has a covariance, which laser odometry gives"
    return ""


class _Reader:
    """Gathers odometry and transforms."""

    def __init__(self, *, is_unstamped: bool) -> None:
        self._is_unstamped = is_unstamped
        self.tree = FrameTree()
        # poses of a base in the frame of the odometry: stamp, x, y, theta, over and over
        self.odometry = array("d")
        self.odometry_edge: Edge = ("", "")
        self.motions: dict[Edge, array[float]] = {}
        self.has_covariance = False

    def add(self, message: Message, decoded: Any) -> None:
        if message.msgtype == ODOMETRY:
            pose = decoded.pose.pose
            if not self.odometry:
                self.odometry_edge = (frame_name(decoded.header.frame_id), frame_name(decoded.child_frame_id))
            self.has_covariance |= bool(decoded.pose.covariance[0] > 0.0)
            stamp = _time_of(message, decoded.header, is_unstamped=self._is_unstamped)
            self.odometry.extend((stamp, *planar(seven(pose.position, pose.orientation))))
            return
        for item, edge, transform in self.tree.add_all(decoded):
            if "odom" in edge[0].rpartition("/")[2] and edge in self.tree.transforms:
                stamp = _time_of(message, item.header, is_unstamped=self._is_unstamped)
                self.motions.setdefault(edge, array("d")).extend((stamp, *planar(transform)))


def _time_of(message: Message, header: Any, *, is_unstamped: bool) -> float:
    """Return when a message was made, or received where none of the bag is stamped, seconds."""
    return message.received / 10**9 if is_unstamped else stamp_of(header)


def _nearest_base(tree: FrameTree, motions: Collection[Edge], frame: str) -> Edge | None:
    """Return the odometry edge that leads to the laser on the shortest way, or else to a usual base."""
    ways = {edge: tree.path(edge[1], frame, avoid=edge[0]) for edge in motions}
    reaching = {edge: len(way) for edge, way in ways.items() if way is not None}
    if reaching:
        return min(reaching, key=lambda edge: reaching[edge])
    usual = [edge for name in _USUAL_BASES for edge in motions if edge[1] == name]
    return next(iter([*usual, *motions]), None)


def _mount(tree: FrameTree, odometry: Edge, frame: str) -> tuple[Pose, tuple[str, ...]]:
    """Return the pose of the laser on the robot's base, and what to say of it."""
    fixed, base = odometry
    way = tree.path(base, frame, avoid=fixed)
    robot, laser = shown(base) or "the robot", shown(frame) or "the laser"
    if way is None:
        return se2.identity(), (
            f"no transforms lead from {robot} to {laser}: the laser is taken to sit at the robot's "
            "origin, looking ahead",
        )
    if not way:
        return se2.identity(), ("it is the laser's own",)
    transform = tree.along(base, way)
    theta = math.atan2(transform[1, 0], transform[0, 0])
    mount = np.array([transform[0, 3], transform[1, 3], theta])
    notes = [
        f"the laser's mount, from transforms {robot} to {laser}: x {mount[0]:.3f} m, y {mount[1]:.3f} m, "
        f"yaw {math.degrees(mount[2]):.1f} deg"
    ]
    if tree.moving.intersection(way):
        notes.append("the laser's mount changes during the log: the first one is taken throughout")
    return mount, tuple(notes)


def poses_at(stamps: Floats, rows: Floats) -> Pose:
    """Return the (n, 3) poses at these stamps between rows of stamp, x, y, theta; NaN outside their time."""
    # no comparison with NaN holds: a row with one is left out, too
    rows = rows[np.all(np.abs(rows[:, 1:]) <= FARTHEST, axis=1)]
    if not rows.size:
        return np.full((stamps.size, 3), np.nan)
    _, first_idx = np.unique(rows[:, 0], return_index=True)  # sorted, and one row a stamp
    times, x, y, theta = rows[first_idx].T
    columns = [np.interp(stamps, times, column, left=np.nan, right=np.nan) for column in (x, y, np.unwrap(theta))]
    columns[2] = se2.wrap(columns[2])
    return np.stack(columns, axis=-1)


def read_gyro(bag: Bag, stamps: Floats, *, is_unstamped: bool) -> Floats | None:
    """Return (n,) the angle the gyroscope of most messages turned by at (n,) stamps, radians; None without one."""
    counts = {name: topic.count for name, topic in bag.topics.items() if topic.msgtype == IMU}
    if not any(counts.values()):
        return None
    rows = array("d")

    def add(message: Message, decoded: Any) -> None:
        rate = float(decoded.angular_velocity.z)
        rows.extend((_time_of(message, decoded.header, is_unstamped=is_unstamped), rate))

    bag.each([max(counts, key=lambda name: counts[name])], add)  # one that is broken is one of a hundred a second
    times, rates = np.array(rows).reshape(-1, 2).T
    times, first_idx = np.unique(times[np.isfinite(rates)], return_index=True)
    if times.size < 2:
        return None
    rates = rates[np.isfinite(rates)][first_idx]
    turned = np.append(0.0, np.cumsum(np.diff(times) * 0.5 * (rates[1:] + rates[:-1])))
    at_scans: Floats = np.interp(stamps, times, turned, left=np.nan, right=np.nan)
    return at_scans
