"""Wheel odometry: what a robot's noisy wheels report of its true motion."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.types import Floats, Pose


@dataclass(frozen=True, kw_only=True)
class OdometryNoise:
    """Noise of wheel odometry: the sampling motion model of Thrun, Burgard and Fox.

    "Probabilistic Robotics", 2005, table 5.6: each step is a turn, a straight drive and a turn; their variances
    are sums of squares weighted by the four alphas below. As in the book the noise of each step is
    independent, so that the drift over a given path depends on how often it is sampled.
    """

    turn_from_turn: float = 0.01  # alpha 1: rad^2 of turn per rad^2 turned
    turn_from_drive: float = 0.004  # alpha 2: rad^2 of turn per m^2 driven
    drive_from_drive: float = 0.002  # alpha 3: m^2 of drive per m^2 driven
    drive_from_turn: float = 0.001  # alpha 4: m^2 of drive per rad^2 turned

    def __post_init__(self) -> None:
        for one in fields(self):
            if not getattr(self, one.name) >= 0.0:
                raise InvalidArgumentError(f"{one.name} must be >= 0, got {getattr(self, one.name)}")


def wheel_odometry(poses: Pose, noise: OdometryNoise, rng: np.random.Generator) -> Pose:
    """Return what noisy wheels report for true poses, (n, 3), in the frame of the first one."""
    steps = se2.between(poses[:-1], poses[1:])
    drive = np.hypot(steps[:, 0], steps[:, 1])
    turn_1 = np.where(drive > 1e-6, np.arctan2(steps[:, 1], steps[:, 0]), 0.0)
    is_backward = np.abs(turn_1) > 0.5 * np.pi
    turn_1 = np.where(is_backward, se2.wrap(turn_1 + np.pi), turn_1)
    drive = np.where(is_backward, -drive, drive)
    turn_2 = se2.wrap(steps[:, 2] - turn_1)
    draws = rng.standard_normal((max(len(poses) - 1, 0), 3))
    sigma_drive = np.sqrt(noise.drive_from_drive * drive**2 + noise.drive_from_turn * (turn_1**2 + turn_2**2))
    turn_1 = turn_1 + draws[:, 0] * _turn_sigma(turn_1, drive, noise)
    turn_2 = turn_2 + draws[:, 2] * _turn_sigma(turn_2, drive, noise)
    drive = drive + draws[:, 1] * sigma_drive
    noisy = np.column_stack([drive * np.cos(turn_1), drive * np.sin(turn_1), se2.wrap(turn_1 + turn_2)])
    odometry = np.zeros((len(poses), 3))
    for i in range(1, len(poses)):
        odometry[i] = se2.compose(odometry[i - 1], noisy[i - 1])
    return odometry


def _turn_sigma(turn: Floats, drive: Floats, noise: OdometryNoise) -> Floats:
    return np.asarray(np.sqrt(noise.turn_from_turn * turn**2 + noise.turn_from_drive * drive**2))
