"""Whole floors with truth: what the odometry keeps at the corners of corridors."""

from __future__ import annotations

from curvescan.odometry import Odometry, StepOutcome
from floors import recorded


def outcomes_at_a_corner():
    """Outcomes of the scans before and in a turn of the drive, which begins from one scan to the next."""
    log, _ = recorded("A", 100, has_wheels=False)
    odometry = Odometry()
    return {odometry.add(scan).outcome for scan in log.scans[1450:1530]}


def test_a_robot_that_begins_to_turn_is_not_lost():
    assert StepOutcome.LOST not in outcomes_at_a_corner()
