"""How a robot follows a line (pure pursuit with limits on speed, turn rate and acceleration), and what its wheels tell.

Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992. The speed
along the line is planned ahead: slow where it bends, at rest at its end.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from curvescan import se2
from curvescan.errors import require
from curvescan.types import Floats, Points, Pose

_SPACING = 0.05  # metres between points of a line
_SMOOTHING = 6  # points on each side that a corner is rounded over
_LOOK_AHEAD = 9  # points from the nearest one to the one steered at
_REACH = 20  # points in which the nearest one is looked for
_CREEP = 0.08  # m/s, so that the end is reached
_ARRIVED = 0.05  # metres
_TURN_ON_SPOT = math.radians(50.0)  # off by more than this, the robot stops and turns


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How a robot drives."""

    # round the world's route (to random places in a world without one), or small moves about a start and back to it
    path: Literal["route", "home"] = "route"
    speed: float = 0.6  # top speed, m/s
    turn_rate: float = 0.9  # top turn rate, rad/s
    acceleration: float = 0.6  # m/s^2; the turn rate changes by four times this number, rad/s^2
    # planned distance of the robot's centre to anything, metres. Rounding corners may cost 0.1 m of it
    clearance: float = 0.4

    def __post_init__(self) -> None:
        require(self.path in ("route", "home"), "path must be 'route' or 'home'", self.path)
        for name in ("speed", "turn_rate", "acceleration", "clearance"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))


def smooth(walk: Points) -> Points:
    """Return a walk of grid cells as a smooth line: (n, 2), evenly spaced, its ends kept, metres."""
    lengths = np.hypot(*np.diff(walk, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, along[-1], max(int(along[-1] / _SPACING), 2))
    line = np.column_stack([np.interp(at, along, walk[:, 0]), np.interp(at, along, walk[:, 1])])
    padded = np.pad(line, ((_SMOOTHING, _SMOOTHING), (0, 0)), mode="reflect", reflect_type="odd")
    box = np.ones(2 * _SMOOTHING + 1) / (2 * _SMOOTHING + 1)
    return np.column_stack([np.convolve(padded[:, k], box, mode="valid") for k in (0, 1)])


def at_start(line: Points) -> Floats:
    """Return the state [x, y, theta, speed, turn rate] of a robot at rest at the start of a line."""
    ahead = line[min(_LOOK_AHEAD, len(line) - 1)] - line[0]
    return np.array([*line[0], math.atan2(ahead[1], ahead[0]), 0.0, 0.0])


def follow(line: Points, state: Floats, drive: Drive, step: float) -> Iterator[Floats]:
    """Yield the states of a robot that drives along a line to its end. line (n, 2); state (5,); result (5,)."""
    x, y, theta, speed, turn_rate = (float(value) for value in state)
    limits = _speed_limits(line, drive)
    faster, turn_faster = drive.acceleration * step, 4.0 * drive.acceleration * step
    last = len(line) - 1
    i = 0
    # the bound only ends a drive that something keeps from arriving: it is several times what a line takes
    for _ in range(int((20.0 + 10.0 * last * _SPACING / drive.speed) / step)):
        if i > last - _REACH and math.hypot(line[last, 0] - x, line[last, 1] - y) < _ARRIVED:
            return
        near = line[i : i + _REACH] - [x, y]
        i += int(np.argmin(near[:, 0] ** 2 + near[:, 1] ** 2))
        target = line[min(i + _LOOK_AHEAD, last)]
        off = float(se2.wrap(math.atan2(target[1] - y, target[0] - x) - theta))
        if abs(off) > _TURN_ON_SPOT:
            wanted, wanted_turn = 0.0, math.copysign(drive.turn_rate, off)
        else:
            wanted = min(drive.speed * math.cos(off), limits[i])
            to_target = max(math.hypot(target[0] - x, target[1] - y), _SPACING)
            wanted_turn = 2.0 * max(speed, 0.3) * math.sin(off) / to_target
        speed = min(max(wanted, speed - faster), speed + faster)
        wanted_turn = min(max(wanted_turn, -drive.turn_rate), drive.turn_rate)
        turn_rate = min(max(wanted_turn, turn_rate - turn_faster), turn_rate + turn_faster)
        middle = theta + 0.5 * turn_rate * step
        x += speed * step * math.cos(middle)
        y += speed * step * math.sin(middle)
        theta = float(se2.wrap(theta + turn_rate * step))
        yield np.array([x, y, theta, speed, turn_rate])


def _speed_limits(line: Points, drive: Drive) -> list[float]:
    """Return the speed at each point that the bends and the end ahead allow, m/s."""
    limits = np.full(len(line), drive.speed)
    along = np.diff(line, axis=0)
    bends = np.abs(se2.wrap(np.diff(np.arctan2(along[:, 1], along[:, 0]))))
    limits[1:-1] = np.minimum(limits[1:-1], 0.6 * drive.turn_rate * _SPACING / np.maximum(bends, 1e-9))
    limits[-1] = 0.0
    # brake early enough: v^2 may fall by 2 a d, of which a tenth is kept in reserve
    drop = 1.8 * drive.acceleration * _SPACING
    for i in range(len(line) - 2, -1, -1):
        limits[i] = min(limits[i], math.sqrt(limits[i + 1] ** 2 + drop))
    return [max(float(limit), _CREEP) for limit in limits]


@dataclass(frozen=True, kw_only=True)
class OdometryNoise:
    """Noise of wheel odometry: Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 5.6.

    Each step is a turn, a straight drive and a turn, whose variances are sums of squares weighted by the four alphas.
    The noise of steps is independent, so that the drift over a path depends on how often it is sampled.
    """

    turn_from_turn: float = 0.01  # alpha 1: rad^2 of turn per rad^2 turned
    turn_from_drive: float = 0.004  # alpha 2: rad^2 of turn per m^2 driven
    drive_from_drive: float = 0.002  # alpha 3: m^2 of drive per m^2 driven
    drive_from_turn: float = 0.001  # alpha 4: m^2 of drive per rad^2 turned

    def __post_init__(self) -> None:
        for one in fields(self):
            require(getattr(self, one.name) >= 0.0, f"{one.name} must be >= 0", getattr(self, one.name))


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
    turn_1, turn_2 = (
        turn + draw * np.sqrt(noise.turn_from_turn * turn**2 + noise.turn_from_drive * drive**2)
        for turn, draw in ((turn_1, draws[:, 0]), (turn_2, draws[:, 2]))
    )
    drive = drive + draws[:, 1] * sigma_drive
    noisy = np.column_stack([drive * np.cos(turn_1), drive * np.sin(turn_1), se2.wrap(turn_1 + turn_2)])
    odometry = np.zeros((len(poses), 3))
    for i in range(1, len(poses)):
        odometry[i] = se2.compose(odometry[i - 1], noisy[i - 1])
    return odometry
