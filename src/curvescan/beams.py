"""Where the beams of a sweep point: evenly spaced, or given one by one."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.types import Floats, Points

_EVEN = 0.01  # share of a step by which beams may stray from evenly spaced ones and still be looked up as such
_LONE_STEP = math.radians(1.0)  # step of a sweep of fewer than two beams, radians: it has none, and any serves
_MOST_TURNS = 2.0  # a sweep of more turns is one in degrees: drivers overlap the ends of a turn by a few beams, no more


@dataclass(frozen=True, eq=False, kw_only=True)
class Beams:
    """Where the beams of a sweep point, radians."""

    angles: Floats  # (n,): rising or falling, not wrapped; read-only
    angle_min: float  # the first angle
    angle_increment: float  # mean step of uniform beams, else median step
    is_uniform: bool  # whether the angles are angle_min + i * angle_increment, but for a hundredth of a step

    @cached_property
    def directions(self) -> Points:
        """(n, 2) unit vector of each beam, read-only."""
        directions = np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)
        directions.setflags(write=False)
        return directions


@lru_cache(maxsize=32)
def even_beams(n: int, angle_min: float, angle_increment: float) -> Beams:
    """Return n beams evenly spaced, radians; the same object for the same numbers. Raises InvalidArgumentError."""
    # a log has one or two beam layouts: their sines and cosines are taken once, not once a scan
    for name, value in (("angle_min", angle_min), ("angle_increment", angle_increment)):
        if not math.isfinite(value):
            raise InvalidArgumentError(f"{name} must be finite, got {value}")
    if angle_increment == 0.0:
        raise InvalidArgumentError(
            "angle_increment must not be 0: give the angle from a beam to the next, negative for a clockwise sensor"
        )
    if not math.isfinite(angle_min + angle_increment * n):
        raise InvalidArgumentError(f"the angles of {n} beams must be finite, got angle_increment={angle_increment}")
    angles = angle_min + angle_increment * np.arange(n, dtype=np.float64)
    angles.setflags(write=False)
    return Beams(angles=angles, angle_min=angle_min, angle_increment=angle_increment, is_uniform=True)


def beams_at(angles: Floats) -> Beams:
    """Return beams at angles (n,), radians, that keep the rules of LaserScan. Raises InvalidArgumentError."""
    if not np.isfinite(angles).all():
        raise InvalidArgumentError("angles must be finite, got NaN or an infinity among them")
    if angles.size < 2:
        first = float(angles[0]) if angles.size else 0.0
        return Beams(angles=angles, angle_min=first, angle_increment=_LONE_STEP, is_uniform=True)
    steps = np.sort(angles[1:] - angles[:-1])
    if not _is_one_way(steps):
        angles = np.unwrap(angles)
        angles.setflags(write=False)
        steps = np.sort(angles[1:] - angles[:-1])
    if not _is_one_way(steps):
        raise InvalidArgumentError(
            "angles must all rise or all fall from a beam to the next: sort the readings by angle and drop "
            "those that repeat one"
        )
    median, span = 0.5 * float(steps[(steps.size - 1) // 2] + steps[steps.size // 2]), float(angles[-1] - angles[0])
    if abs(span) > 2.0 * math.pi + 2.5 * abs(median):
        raise InvalidArgumentError(
            f"angles must not go round more than once, got {abs(span):.4g} rad: give a LaserScan for each turn, and "
            "convert degrees with numpy.radians"
        )
    mean = span / steps.size
    strays = angles - (angles[0] + mean * np.arange(angles.size))
    is_uniform = bool(np.max(np.abs(strays)) <= _EVEN * abs(mean))
    return Beams(
        angles=angles, angle_min=float(angles[0]), angle_increment=mean if is_uniform else median, is_uniform=is_uniform
    )


def require_radians(beams: Beams) -> None:
    """Raise InvalidArgumentError where beams point in directions that can only be degrees, whichever came first."""
    first, n = beams.angle_min, beams.angles.size
    last = float(beams.angles[-1]) if n else first
    span = abs(last - first)
    if max(span, min(abs(first), abs(last))) > _MOST_TURNS * 2.0 * math.pi:
        raise InvalidArgumentError(
            f"angles must be radians: {n} beams from angle_min={first:g} in steps of {beams.angle_increment:g} go "
            f"round {span / (2.0 * math.pi):.1f} times; if they are degrees, convert them with numpy.radians"
        )


def _is_one_way(steps: Floats) -> bool:
    return bool(steps[0] > 0.0 or steps[-1] < 0.0)  # they are sorted
