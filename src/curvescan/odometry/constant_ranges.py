"""Constant ranges: readings that stay at one range while the sensor moves are no geometry.

A code for no return, a reflecting rim, the robot's own pole: a wall changes its range in a turning beam, these do not.
"""

from __future__ import annotations

from dataclasses import dataclass

from curvescan.scan import LaserScan
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class ConstantRanges:
    """What turns with the sensor."""

    def without_constant(self, scan: LaserScan) -> tuple[ConstantRanges, LaserScan]:
        """Return the estimate after a scan, and the scan without the readings that are no geometry."""
        return self, scan

    def moved(self, motion: Pose) -> ConstantRanges:
        """Return the estimate after the motion that was found."""
        return self
