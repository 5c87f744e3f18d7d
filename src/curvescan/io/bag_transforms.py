"""The tree of coordinate frames of a bag (/tf, /tf_static), as far as a laser's mount on a robot needs it.

Frames are compared without their leading slash: ROS 1 knew both ``/base_link`` and ``base_link``.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from curvescan.types import Floats, Pose

Edge: TypeAlias = tuple[str, str]
"""Parent and child."""

_MAX_EDGES = 4096
_SAME = 1e-4
"""Largest difference of two transforms taken for equal: metres, and elements of the rotation."""


@dataclass
class FrameTree:
    """The first transform of each pair of frames, and whether it ever changed.

    Attributes
    ----------
    transforms : dict of Edge to (4, 4) float64
        Pose of the child in the parent.
    moving : set of Edge
        Those that changed.
    """

    transforms: dict[Edge, Floats] = field(default_factory=dict)
    moving: set[Edge] = field(default_factory=set)

    def add(self, edge: Edge, transform: Floats) -> None:
        """Take note of a transform; one with a number that is not finite is left out."""
        first = self.transforms.get(edge)
        if first is None:
            if len(self.transforms) < _MAX_EDGES and np.all(np.isfinite(transform)):
                self.transforms[edge] = transform
        elif edge not in self.moving and not np.all(np.abs(transform - first) <= _SAME):
            self.moving.add(edge)

    def path(self, start: str, end: str, *, avoid: str) -> list[Edge] | None:
        """Return the edges from frame to frame, the shortest way that does not touch `avoid`; None without."""
        came_by: dict[str, Edge | None] = {start: None}
        queue = deque([start])
        while queue and end not in came_by:
            frame = queue.popleft()
            for edge in self.transforms:
                if frame in edge and avoid not in edge:
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

    def along(self, start: str, path: list[Edge]) -> Floats:
        """Return the (4, 4) pose of the last frame of a path in the frame it starts from."""
        pose, frame = np.eye(4), start
        for parent, child in path:
            step = self.transforms[parent, child]
            pose = pose @ (step if frame == parent else np.linalg.inv(step))
            frame = child if frame == parent else parent
        return pose


def frame_name(name: object) -> str:
    """Return the name of a frame without leading slash."""
    return str(name).lstrip("/")


def matrix(translation: Any, rotation: Any) -> Floats:
    """Return the (4, 4) transform of a translation x, y, z and a quaternion x, y, z, w of any length but 0.

    A quaternion of zeros, which some drivers leave where there is no rotation, is no rotation.
    """
    q = np.array([rotation.x, rotation.y, rotation.z, rotation.w], dtype=np.float64)
    norm = math.sqrt(float(q @ q))
    x, y, z, w = q / norm if norm != 0.0 else (0.0, 0.0, 0.0, 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def planar(transform: Floats) -> Pose:
    """Return the (3,) pose x, y, theta that a (4, 4) transform has seen from above."""
    theta = math.atan2(transform[1, 0], transform[0, 0])
    return np.array([transform[0, 3], transform[1, 3], theta])
