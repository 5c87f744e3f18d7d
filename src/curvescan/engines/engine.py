"""Engines place scans one by one: an odometry, SLAM or a localizer."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import Step
from curvescan.scan import LaserScan
from curvescan.types import Pose

if TYPE_CHECKING:  # a process for the odometry alone loads neither
    from curvescan.slam import Localizer, Slam

Engine: TypeAlias = "Odometry | Slam | Localizer"
"""What has ``add(scan, odometry_pose) -> Step``."""


def odometry_of(engine: Engine) -> Odometry:
    """Return the odometry of an engine, which may be it itself."""
    return engine if isinstance(engine, Odometry) else engine.odometry


class PlacedScan(NamedTuple):
    """A scan, its step, and the seconds that took."""

    scan: LaserScan
    step: Step
    seconds: float


def placed(engine: Engine, scan: LaserScan, odometry_pose: Pose | None) -> PlacedScan:
    """Add a scan to an engine, and return it with its step."""
    started = time.perf_counter()
    step = engine.add(scan, odometry_pose)
    return PlacedScan(scan, step, time.perf_counter() - started)


def in_turn(engine: Engine, scans: Iterable[LaserScan], odometry_poses: Pose | None) -> Iterator[PlacedScan]:
    """Yield the scans with their steps, each placed when it is wanted; odometry_poses (n, 3)."""
    for k, scan in enumerate(scans):
        yield placed(engine, scan, pose_at(odometry_poses, k))


def pose_at(odometry_poses: Pose | None, k: int) -> Pose | None:
    """Return the pose of the sensor at scan k by its wheels; NaN beyond the last, as of a log that grows."""
    if odometry_poses is None:
        return None
    return odometry_poses[k] if k < len(odometry_poses) else np.full(3, np.nan)
