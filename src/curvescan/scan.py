"""LaserScan: one sweep of a 2D laser, with the semantics of sensor_msgs/LaserScan and REP-117.

Beam i points at ``angle_min + i * angle_increment``. A reading is valid when it is a finite, positive
number in ``[range_min, range_max]``; anything else (NaN, an infinity, 0, a negative value, a driver's
code such as 81.91) is *no reading*: data, never an error.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.types import Bools, Floats, Ints, Points


@dataclass(frozen=True, eq=False)
class LaserScan:
    """One sweep of a 2D laser scanner.

    Parameters
    ----------
    ranges : (n,) array_like
        Metres, one a beam, in the order the sensor swept them. Copied as read-only float64. NaN, infinite,
        non-positive and out-of-range values mean *no reading*. n may be 0.
    angle_min : float
        Direction of beam 0 in the sensor frame, radians, counter-clockwise from the x axis.
    angle_increment : float
        Angle from a beam to the next, radians, not 0; negative for a clockwise (or upside-down) sensor.
    range_min, range_max : float
        Limits of a valid reading, metres, both inclusive; 0 <= range_min < range_max, range_max may be inf.
    stamp : float
        Time of the sweep, seconds. Stamps of successive scans may repeat or go back.
    intensities : (n,) array_like or None
        Strength of each return in the driver's unit, or None.

    Raises
    ------
    InvalidArgumentError
        When a shape or a scalar breaks the rules above. Bad *readings* never raise.
    """

    ranges: Floats
    _: KW_ONLY
    angle_min: float
    angle_increment: float
    range_min: float = 0.0
    range_max: float = math.inf
    stamp: float = 0.0
    intensities: Floats | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", _read_only_row(self.ranges, "ranges"))
        for name in ("angle_min", "angle_increment", "range_min", "range_max", "stamp"):
            object.__setattr__(self, name, _as_float(getattr(self, name), name))
        for name in ("angle_min", "angle_increment", "stamp"):
            if not math.isfinite(getattr(self, name)):
                raise InvalidArgumentError(f"{name} must be finite, got {getattr(self, name)}")
        if self.angle_increment == 0.0:
            raise InvalidArgumentError(
                "angle_increment must not be 0: give the angle from a beam to the next, "
                "negative for a clockwise sensor"
            )
        if not 0.0 <= self.range_min < self.range_max:
            raise InvalidArgumentError(
                f"range limits must satisfy 0 <= range_min < range_max, "
                f"got range_min={self.range_min}, range_max={self.range_max}"
            )
        if self.intensities is not None:
            intensities = _read_only_row(self.intensities, "intensities")
            if intensities.shape != self.ranges.shape:
                raise InvalidArgumentError(
                    f"intensities must have one value a beam ({self.ranges.size}), "
                    f"got {intensities.size}"
                )
            object.__setattr__(self, "intensities", intensities)

    def __len__(self) -> int:
        return int(self.ranges.size)

    def __repr__(self) -> str:
        n_valid = int(np.count_nonzero(self.valid))
        span_deg = math.degrees(self.angle_increment) * max(len(self) - 1, 0)
        return (
            f"LaserScan({len(self)} beams over {span_deg:.2f} deg, {n_valid} valid, "
            f"stamp={self.stamp!r})"
        )

    @cached_property
    def valid(self) -> Bools:
        """(n,) mask of the readings that are measurements: finite, positive, within the range limits."""
        ranges = self.ranges
        # comparisons with NaN are False; an infinite range_max does not make +inf a measurement
        return (ranges > 0.0) & (ranges >= self.range_min) & (ranges <= min(self.range_max, _HUGE))

    @property
    def angles(self) -> Floats:
        """(n,) direction of each beam in the sensor frame, radians, read-only, not wrapped."""
        return _beams(len(self), self.angle_min, self.angle_increment)[0]

    @property
    def directions(self) -> Points:
        """(n, 2) unit vector of each beam in the sensor frame, read-only."""
        return _beams(len(self), self.angle_min, self.angle_increment)[1]

    @cached_property
    def points(self) -> Points:
        """(n, 2) Cartesian points in the sensor frame, metres; a row of NaN where there is no reading."""
        return np.where(self.valid, self.ranges, np.nan)[:, np.newaxis] * self.directions

    @property
    def is_full_circle(self) -> bool:
        """Whether the last beam neighbours the first, so that the sweep joins at the seam.

        True when the beams leave a gap of at most two and a half increments: 359, 360 and 361 beams of one
        degree all close the circle.
        """
        step = abs(self.angle_increment)
        return step * (len(self) + 1.5) >= 2.0 * math.pi


@dataclass(frozen=True, eq=False, kw_only=True)
class Readings:
    """The valid readings of one sweep, counter-clockwise, whatever way the sensor turns.

    Attributes
    ----------
    beam_idx : (m,) int64
        Index of each reading in the scan's own order: ascending for a counter-clockwise sensor,
        descending for a clockwise one.
    ranges : (m,) float64
        Metres.
    angles : (m,) float64
        Radians, ascending.
    points : (m, 2) float64
        Metres, sensor frame.
    angle_step : float
        Angle between neighbouring beams, radians, positive.
    n_beams : int
        Beams of the sweep, valid or not.
    is_closed : bool
        Whether the sweep covers the full circle, so that the last reading precedes the first.
    """

    beam_idx: Ints
    ranges: Floats
    angles: Floats
    points: Points
    angle_step: float
    n_beams: int
    is_closed: bool

    def __len__(self) -> int:
        return int(self.beam_idx.size)


def valid_readings(scan: LaserScan) -> Readings:
    """Return the valid readings of a scan in counter-clockwise order.

    A clockwise scan and its mirror image (ranges reversed, increment negated) give the same readings.

    Parameters
    ----------
    scan : LaserScan
        Any scan, also one without a valid reading.

    Returns
    -------
    Readings
        Of length 0 when nothing is valid.
    """
    beam_idx = np.flatnonzero(scan.valid)
    if scan.angle_increment < 0.0:
        beam_idx = np.ascontiguousarray(beam_idx[::-1])
    ranges = scan.ranges[beam_idx]
    return Readings(
        beam_idx=beam_idx,
        ranges=ranges,
        angles=scan.angles[beam_idx],
        points=ranges[:, np.newaxis] * scan.directions[beam_idx],
        angle_step=abs(scan.angle_increment),
        n_beams=len(scan),
        is_closed=scan.is_full_circle,
    )


_HUGE = float(np.finfo(np.float64).max)


@lru_cache(maxsize=32)
def _beams(n: int, angle_min: float, angle_increment: float) -> tuple[Floats, Points]:
    # a log has one or two beam layouts: their sines and cosines are taken once, not once a scan
    angles = angle_min + angle_increment * np.arange(n, dtype=np.float64)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    angles.setflags(write=False)
    directions.setflags(write=False)
    return angles, directions


def _read_only_row(values: ArrayLike, name: str) -> Floats:
    try:
        row = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} must be numbers, one a beam: {error}") from error
    if row.ndim != 1:
        raise InvalidArgumentError(f"{name} must be 1-D, got shape {row.shape}")
    row.setflags(write=False)
    return row


def _as_float(value: object, name: str) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} must be a number, got {value!r}") from error
