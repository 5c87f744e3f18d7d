"""A stream of scans in, a trajectory out. Names are loaded on first use, so that --help loads no kernel."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curvescan.odometry.config import KeyframesConfig, MotionConfig, OdometryConfig
    from curvescan.odometry.odometry import Odometry
    from curvescan.odometry.run import RunRecord, run_odometry
    from curvescan.odometry.step import Step, StepOutcome

_HOMES = {
    "KeyframesConfig": "config",
    "MotionConfig": "config",
    "Odometry": "odometry",
    "OdometryConfig": "config",
    "RunRecord": "run",
    "Step": "step",
    "StepOutcome": "step",
    "run_odometry": "run",
}

__all__ = [
    "KeyframesConfig",
    "MotionConfig",
    "Odometry",
    "OdometryConfig",
    "RunRecord",
    "Step",
    "StepOutcome",
    "run_odometry",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'curvescan.odometry' has no attribute {name!r}")
    return getattr(importlib.import_module(f"curvescan.odometry.{_HOMES[name]}"), name)
