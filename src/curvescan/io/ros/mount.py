"""How the lasers of a bag are mounted, from its first transforms: before the first scan is read."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path

import numpy as np

from curvescan.errors import LogFormatError
from curvescan.io.files.read_errors import BrokenRecordError
from curvescan.io.ros.bags.bag import Bag
from curvescan.io.ros.messages import LASER_SCAN, TRANSFORMS
from curvescan.io.ros.transforms import FrameTree, frame_name, seven
from curvescan.types import Floats, Pose

_N_FIRST = 1000  # messages of each topic of transforms that are read: robots repeat their mounts many times a second

_LEVEL = ("base_link", "base_footprint", "odom", "map")
"""Frames whose z axis points up (REP-105), the nearest to the laser first."""

_TILTED = math.radians(5.0)


def laser_mounts(path: Path) -> dict[str, Pose | None]:
    """Return the pose of each laser of a bag on the robot's base, by topic, seen from above; None where it is unknown.

    Raises LogFileError, LogFormatError.
    """
    bag = Bag(path)
    tree = _first_transforms(bag)
    known = {name for edge in tree.transforms for name in edge}
    bases = [name for level in _LEVEL[:2] for name in sorted(known) if name.rpartition("/")[2] == level]
    mounts: dict[str, Pose | None] = {}
    for topic, held in bag.topics.items():
        if held.msgtype != LASER_SCAN or not held.count:
            continue
        first = bag.decode(next(iter(bag.messages([topic]))))
        ways = [(base, tree.path(base, frame_name(first.header.frame_id), avoid="")) for base in bases]
        base, way = next(((base, way) for base, way in ways if way is not None), ("", None))
        mounts[topic] = None if way is None else _from_above(tree.along(base, way))
    return mounts


def laser_tilt(bag: Bag, frame: str) -> float:
    """Return the angle between the laser's z axis and the vertical, radians in [0, pi]; 0 where it is unknown."""
    tree = _first_transforms(bag)
    frame = frame_name(frame)
    for level in _LEVEL:
        known = {name for edge in tree.transforms for name in edge if name.rpartition("/")[2] == level}
        for start in sorted(known):
            way = tree.path(start, frame, avoid="")
            if way is not None:
                return _from_vertical(float(tree.along(start, way)[2, 2]))
    root, way = tree.root(frame)
    return _from_vertical(float(tree.along(root, way)[2, 2]))


def tilt_notes(tilt: float) -> tuple[str, ...]:
    """Return what to say of a tilt in radians, a sentence each."""
    notes = []
    if tilt > 0.5 * math.pi:
        notes.append("by the transforms the laser hangs upside down")
    lean = min(tilt, math.pi - tilt)
    if lean > _TILTED:
        notes.append(f"by the transforms the laser leans by {math.degrees(lean):.0f} deg: its scans are taken as level")
    return tuple(notes)


def _first_transforms(bag: Bag) -> FrameTree:
    tree = FrameTree()
    for name, topic in bag.topics.items():
        if topic.msgtype in TRANSFORMS and topic.count:
            _read_first(bag, name, tree)
    return tree


def _from_above(pose: Floats) -> Pose:
    """Return the pose x, y, theta of a (4, 4) pose: theta is where its x axis points."""
    return np.array([pose[0, 3], pose[1, 3], math.atan2(pose[1, 0], pose[0, 0])])


def _read_first(bag: Bag, topic: str, tree: FrameTree) -> None:
    try:
        for message in islice(bag.messages([topic]), _N_FIRST):
            try:
                for item in bag.decode(message).transforms:
                    edge = frame_name(item.header.frame_id), frame_name(item.child_frame_id)
                    tree.add(edge, seven(item.transform.translation, item.transform.rotation))
            except (BrokenRecordError, AttributeError, TypeError, ValueError, OverflowError):
                continue  # counted where the odometry is read
    except LogFormatError:
        pass  # damage from here on: what stands before is used


def _from_vertical(up: float) -> float:
    return math.acos(float(np.clip(up, -1.0, 1.0)))
