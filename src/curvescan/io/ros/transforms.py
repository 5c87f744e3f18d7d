"""The tree of coordinate frames of a bag (/tf, /tf_static), and from it how each laser is mounted on its robot."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from curvescan.io.ros.bags.bag import Bag
from curvescan.io.ros.messages import LASER_SCAN, TRANSFORMS
from curvescan.types import Floats, Pose

Edge: TypeAlias = tuple[str, str]  # parent and child

Transform: TypeAlias = tuple[float, float, float, float, float, float, float]
"""Pose of the child in the parent as ROS writes it: x, y, z, and the quaternion's x, y, z, w."""

FARTHEST = 1e9  # largest translation of a valid transform, metres: no robot drives a million kilometres
_MAX_EDGES = 1024
_SAME = 1e-4  # largest difference of two transforms taken for equal: metres, and elements of the quaternion


@dataclass
class FrameTree:
    """The first transform of each pair of frames, and whether it ever changed."""

    # all numbers finite, none beyond FARTHEST
    transforms: dict[Edge, Transform] = field(default_factory=dict)
    moving: set[Edge] = field(default_factory=set)  # those that changed

    def add(self, edge: Edge, transform: Transform) -> None:
        """Take note of a transform; one with a number beyond FARTHEST, or none, is left out."""
        first = self.transforms.get(edge)
        if first is None:
            if len(self.transforms) < _MAX_EDGES and all(abs(v) <= FARTHEST for v in transform):
                self.transforms[edge] = transform
        elif transform != first and edge not in self.moving and not _is_same(transform, first):
            self.moving.add(edge)

    def add_all(self, message: Any) -> Iterator[tuple[Any, Edge, Transform]]:
        """Add the transforms of a message, and yield each with its frames, its translation and its quaternion."""
        for item in message.transforms:
            edge = frame_name(item.header.frame_id), frame_name(item.child_frame_id)
            transform = seven(item.transform.translation, item.transform.rotation)
            self.add(edge, transform)
            yield item, edge, transform

    def path(self, start: str, end: str, *, avoid: str) -> list[Edge] | None:
        """Return the edges from frame to frame, the shortest way that does not touch `avoid`; None without."""
        beside: dict[str, list[Edge]] = {}
        for edge in self.transforms:
            for frame in edge if avoid not in edge else ():
                beside.setdefault(frame, []).append(edge)
        came_by: dict[str, Edge | None] = {start: None}
        queue = deque([start])
        while queue and end not in came_by:
            frame = queue.popleft()
            for edge in beside.get(frame, ()):
                other = edge[1] if edge[0] == frame else edge[0]
                if other not in came_by:
                    came_by[other] = edge
                    queue.append(other)
        if end not in came_by:
            return None
        path: list[Edge] = []
        frame = end
        while (edge_to := came_by[frame]) is not None:
            path.append(edge_to)
            frame = edge_to[0] if edge_to[1] == frame else edge_to[1]
        return path[::-1]

    def root(self, frame: str) -> tuple[str, list[Edge]]:
        """Return the topmost ancestor of a frame and the edges down from it; the frame itself where it has none."""
        parents = {child: parent for parent, child in reversed(self.transforms)}
        path: list[Edge] = []
        top = frame
        while top in parents and parents[top] != frame and len(path) < len(parents):
            path.append((parents[top], top))
            top = parents[top]
        return top, path[::-1]

    def along(self, start: str, path: list[Edge]) -> Floats:
        """Return the (4, 4) pose of the last frame of a path in the frame it starts from."""
        pose, frame = np.eye(4), start
        for parent, child in path:
            step = matrix(self.transforms[parent, child])
            pose = pose @ (step if frame == parent else np.linalg.inv(step))
            frame = child if frame == parent else parent
        return pose


def frame_name(name: object) -> str:
    """Return the name of a frame without leading slash."""
    return str(name).lstrip("/")


def seven(translation: Any, rotation: Any) -> Transform:
    """Return the numbers of a geometry_msgs Vector3 or Point and of a Quaternion."""
    t, q = translation, rotation
    return (t.x, t.y, t.z, q.x, q.y, q.z, q.w)


def matrix(transform: Transform) -> Floats:
    """Return the (4, 4) matrix of a transform; its quaternion has any length, and zeros mean no rotation."""
    quaternion = np.array(transform[3:])
    norm = math.hypot(*quaternion)
    x, y, z, w = quaternion / norm if norm != 0.0 else (0.0, 0.0, 0.0, 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), transform[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), transform[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), transform[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def planar(transform: Transform) -> tuple[float, float, float]:
    """Return the pose x, y, theta of a transform seen from above: theta is where its x axis points."""
    x, y, _, qx, qy, qz, qw = transform
    theta = math.atan2(2 * (qx * qy + qz * qw), qw * qw + qx * qx - qy * qy - qz * qz)
    return x, y, theta


def _is_same(first: Transform, second: Transform) -> bool:
    # a quaternion and its negative are the same rotation
    sign = 1.0 if sum(a * b for a, b in zip(first[3:], second[3:], strict=True)) >= 0.0 else -1.0
    turned = (*second[:3], *(sign * b for b in second[3:]))
    return all(abs(a - b) <= _SAME for a, b in zip(first, turned, strict=True))


_N_FIRST = 1000  # messages of a topic of transforms that are read first: robots repeat their mounts many times a second

N_FIRST_SCANS = 8  # of a laser that are asked for its frame: some may be broken

_LEVEL = ("base_link", "base_footprint", "odom", "map")
"""Frames whose z axis points up (REP-105), the nearest to the laser first."""

_TILTED = math.radians(5.0)


def laser_mounts(path: Path) -> dict[str, Pose | None]:
    """Return each laser's pose on the robot's base, from above, by topic; None where it is unknown."""
    bag = Bag(path)
    lasers = [name for name, topic in bag.topics.items() if topic.msgtype == LASER_SCAN and topic.count]
    poses = _poses(bag, [_frame_of(bag, topic) for topic in lasers], _LEVEL[:2])[1]
    return {
        topic: None if pose is None else np.array([pose[0, 3], pose[1, 3], math.atan2(pose[1, 0], pose[0, 0])])
        for topic, pose in zip(lasers, poses, strict=True)
    }


def _frame_of(bag: Bag, topic: str) -> str:
    """Return the frame of a laser by the first of its scans that names one; empty where none can be read."""
    frames: list[str] = []
    bag.each([topic], lambda _, decoded: frames.append(frame_name(decoded.header.frame_id)), N_FIRST_SCANS)
    return next(filter(None, frames), "")


def laser_tilt(bag: Bag, frame: str) -> float:
    """Return the angle between the laser's z axis and the vertical, radians in [0, pi]; 0 where it is unknown."""
    frame = frame_name(frame)
    tree, (pose,) = _poses(bag, [frame], _LEVEL)
    pose = tree.along(*tree.root(frame)) if pose is None else pose
    return math.acos(float(np.clip(pose[2, 2], -1.0, 1.0)))


def tilt_notes(tilt: float) -> tuple[str, ...]:
    """Return what to say of a tilt in radians, a sentence each."""
    notes = []
    if tilt > 0.5 * math.pi:
        notes.append("by the transforms the laser hangs upside down")
    lean = min(tilt, math.pi - tilt)
    if lean > _TILTED:
        notes.append(f"by the transforms the laser leans by {math.degrees(lean):.0f} deg: its scans are taken as level")
    return tuple(notes)


def _poses(bag: Bag, frames: list[str], levels: Sequence[str]) -> tuple[FrameTree, list[Floats | None]]:
    """Return the tree of a bag, and the (4, 4) pose of each frame on the first level frame that leads there, or None.

    A driver may start long after the recorder: all transforms are read where the first ones lead to no level frame.
    """
    tree, poses = FrameTree(), list[Floats | None]()
    for n_read, n_most in ((0, _N_FIRST), (_N_FIRST, None)):
        for name, topic in bag.topics.items():
            if topic.msgtype in TRANSFORMS and topic.count > n_read:
                # broken ones are counted where the odometry is read
                bag.each([name], lambda _, decoded: [*tree.add_all(decoded)], n_most)
        poses = [_pose_on(tree, levels, frame) for frame in frames]
        if all(pose is not None for pose in poses):
            break
    return tree, poses


def _pose_on(tree: FrameTree, levels: Sequence[str], frame: str) -> Floats | None:
    known = sorted({name for edge in tree.transforms for name in edge})
    for start in (name for level in levels for name in known if name.rpartition("/")[2] == level):
        if (way := tree.path(start, frame, avoid="")) is not None:
            return tree.along(start, way)
    return None
