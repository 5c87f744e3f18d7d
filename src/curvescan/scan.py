"""LaserScan: one sweep of a 2D laser, with the semantics of sensor_msgs/LaserScan and REP-117.

Beam i points at ``angle_min + i * angle_increment``, or at ``angles[i]`` where the beams are not evenly spaced. A
reading is valid when it is a positive number in ``[range_min, range_max]`` of 10 km at most; anything else (NaN, an
infinity, 0, a negative value, a driver's code such as 81.91 or 1e9) is *no reading*: data, never an error.
"""

import math
import warnings
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan.beams import Beams, beams_at, even_beams, require_radians
from curvescan.errors import InvalidArgumentError, UnitWarning, require
from curvescan.types import Bools, Floats, Ints, Points, Pose


@dataclass(frozen=True, eq=False)
class LaserScan:
    """One sweep of a 2D laser scanner.

    The beams' directions are given by `angle_min` and `angle_increment`, or one by one by `angles`.

    Parameters
    ----------
    ranges : (n,) array_like
        Metres, one a beam, in the order the sensor swept them. Copied as read-only float64. NaN, infinite, masked,
        non-positive and out-of-range values mean *no reading*. n may be 0.
    angle_min : float
        Direction of beam 0 in the sensor frame, radians, counter-clockwise from the x axis.
    angle_increment : float
        Angle from a beam to the next, radians, not 0; negative for a clockwise (or upside-down) sensor. Where
        `angles` are given it is their mean step if they are evenly spaced, else their median step.
    range_min, range_max : float
        Limits of a valid reading, metres, both inclusive; 0 <= range_min < range_max, range_max may be inf.
    stamp : float
        Time of the first beam, seconds. Stamps of successive scans may repeat or go back.
    intensities : (n,) array_like or None
        Strength of each return in the driver's unit, or None.
    angles : (n,) array_like
        Direction of each beam in the sensor frame, radians: finite, all rising or all falling (a jump by a turn is
        undone), over no more than one turn and two and a half of their steps. Instead of `angle_min` and
        `angle_increment`; together with them only where both say the same, as :func:`dataclasses.replace` has it.
    time_increment : float
        From a beam to the next in the order of `ranges`, seconds, >= 0; 0: not known.
    scan_time : float
        From a sweep to the next, seconds, >= 0; 0: not known.
    odometry : (3,) array_like or None
        Pose of the sensor at this scan by its wheels, [x, y, theta] in a frame of their own, NaN where it is unknown:
        odometry, SLAM and localization expect its motion. None without.
    noise_doubled_at : float
        Range at which the variance of the range noise is twice that at the sensor, metres, >= 0.01: it grows with the
        square of the range. inf: as large everywhere. How large it is, each scan tells.

    Raises
    ------
    InvalidArgumentError
        When a shape or a scalar breaks the rules above, when directions are given twice or not at all, and when they
        are plainly degrees. Bad *readings* never raise.

    Warns
    -----
    UnitWarning
        When no reading is below ten times `range_max` (or below 250 m without a limit) and all would be plausible as
        millimetres.
    """

    ranges: Floats
    _: KW_ONLY
    angle_min: float = None  # type: ignore[assignment]
    angle_increment: float = None  # type: ignore[assignment]
    range_min: float = 0.0
    range_max: float = math.inf
    stamp: float = 0.0
    intensities: Floats | None = None
    angles: Floats = None  # type: ignore[assignment]
    time_increment: float = 0.0
    scan_time: float = 0.0
    odometry: Pose | None = None
    noise_doubled_at: float = math.inf
    _beams: Beams = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", _read_only_row(self.ranges, "ranges"))
        for name in ("range_min", "range_max", "stamp", "time_increment", "scan_time", "noise_doubled_at"):
            object.__setattr__(self, name, as_float(getattr(self, name), name))
        if not math.isfinite(self.stamp):
            raise InvalidArgumentError(f"stamp must be finite, got {self.stamp}")
        for name in ("time_increment", "scan_time"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InvalidArgumentError(
                    f"{name} must be finite and >= 0 seconds, got {getattr(self, name)}: 0 says that it is not known"
                )
        require(self.noise_doubled_at >= 0.01, "noise_doubled_at must be at least 0.01 m", self.noise_doubled_at)
        beams = self._beams_given()
        require_radians(beams)
        for name in ("angle_min", "angle_increment", "angles"):
            object.__setattr__(self, name, getattr(beams, name))
        object.__setattr__(self, "_beams", beams)
        if not 0.0 <= self.range_min < self.range_max:
            raise InvalidArgumentError(
                f"range limits must satisfy 0 <= range_min < range_max, "
                f"got range_min={self.range_min}, range_max={self.range_max}"
            )
        if self.intensities is not None:
            intensities = _read_only_row(self.intensities, "intensities")
            if intensities.shape != self.ranges.shape:
                raise InvalidArgumentError(
                    f"intensities must have one value a beam ({self.ranges.size}), got {intensities.size}"
                )
            object.__setattr__(self, "intensities", intensities)
        if self.odometry is not None:
            object.__setattr__(self, "odometry", as_odometry_pose(self.odometry, "odometry"))
        self._warn_of_millimetres()

    def _warn_of_millimetres(self) -> None:
        """Warn where ranges look like millimetres: a scan without a valid reading says only that nothing was seen."""
        limit = _FAR if self.range_max > _FAR else 10.0 * self.range_max
        if ((self.ranges > 0.0) & (self.ranges <= limit)).any():
            return
        far = self.ranges[(self.ranges > limit) & (self.ranges < 1000.0 * limit)]
        is_code = np.unique(far).size < max(far.size // 10, 10)  # one number for all that saw nothing
        if far.size > len(self) // 2 and not is_code:
            median = float(np.median(far))
            warnings.warn(
                f"ranges must be metres, got a median of {median:.0f} with range_max {self.range_max:g}: if they are "
                "millimetres, divide them by 1000",
                UnitWarning,
                stacklevel=4,
            )

    def _beams_given(self) -> Beams:
        n = len(self)
        if self.angles is None:
            if self.angle_min is None or self.angle_increment is None:
                raise InvalidArgumentError(
                    "the directions of the beams are missing: give angle_min and angle_increment, or angles"
                )
            return self._even_beams()
        angles = _read_only_row(self.angles, "angles")
        if angles.size != n:
            raise InvalidArgumentError(f"angles must have one value a beam ({n}), got {angles.size}")
        if self.angle_min is None and self.angle_increment is None:
            return beams_at(angles)
        # dataclasses.replace hands all fields on: the same directions said twice are no contradiction
        if self.angle_min is not None and self.angle_increment is not None:
            even = self._even_beams()
            if np.array_equal(even.angles, angles):
                return even
            given = beams_at(angles)
            if (given.angle_min, given.angle_increment) == (self.angle_min, self.angle_increment):
                return given
        raise InvalidArgumentError(
            "angles and angle_min, angle_increment contradict each other: give angles alone, or the other two"
        )

    def _even_beams(self) -> Beams:
        angle_min, step = as_float(self.angle_min, "angle_min"), as_float(self.angle_increment, "angle_increment")
        return even_beams(len(self), angle_min, step)

    def __len__(self) -> int:
        return int(self.ranges.size)

    def __repr__(self) -> str:
        n_valid = int(np.count_nonzero(self.valid))
        span_deg = math.degrees(self.angles[-1] - self.angles[0]) if len(self) else 0.0
        return f"LaserScan({len(self)} beams over {span_deg:.2f} deg, {n_valid} valid, stamp={self.stamp!r})"

    @cached_property
    def valid(self) -> Bools:
        """(n,) mask of the readings that are measurements: positive, within the range limits and 10 km."""
        return (self.ranges >= self.valid_range[0]) & (self.ranges <= self.valid_range[1])  # False of NaN

    @property
    def valid_range(self) -> tuple[float, float]:
        """Least and greatest range that is a measurement, metres: neither 0 nor infinite, whatever the limits are."""
        return max(self.range_min, _TINY), min(self.range_max, _FARTHEST)

    @property
    def has_uniform_angles(self) -> bool:
        """Whether every beam lies within a hundredth of a step of ``angle_min + i * angle_increment``."""
        return self._beams.is_uniform

    @property
    def mean_increment(self) -> float:
        """Mean angle from a beam to the next, radians: the increment of as many even beams over the same angle."""
        if self.has_uniform_angles:
            return self.angle_increment
        return float(self.angles[-1] - self.angles[0]) / (len(self) - 1)

    @property
    def directions(self) -> Points:
        """(n, 2) unit vector of each beam in the sensor frame, read-only."""
        return self._beams.directions

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
        span = step * (len(self) - 1) if self.has_uniform_angles else abs(float(self.angles[-1] - self.angles[0]))
        return span + 2.5 * step >= 2.0 * math.pi


def without_readings(scan: LaserScan, is_left_out: Bools) -> LaserScan:
    """Return a scan in which some beams, (n,), have no reading; the scan itself where none of them is left out."""
    return replace(scan, ranges=np.where(is_left_out, np.nan, scan.ranges)) if is_left_out.any() else scan


def mirrored(scan: LaserScan) -> LaserScan:
    """Return a scan mirrored about the sensor's x axis: what one that hangs upside down saw, seen from above."""
    return replace(scan, **_directions(scan, -1.0, 1))


def swept_backwards(scan: LaserScan) -> LaserScan:
    """Return a scan with its beams in reverse order, each where it was: for drivers that turn the readings round."""
    return replace(
        scan,
        ranges=scan.ranges[::-1],
        intensities=None if scan.intensities is None else scan.intensities[::-1],
        **_directions(scan, 1.0, -1),
    )


def _directions(scan: LaserScan, sign: float, way: int) -> dict[str, Any]:
    """Return the directions of a scan times a sign, in their order or the reverse, as arguments of LaserScan."""
    grid = even_beams(len(scan), scan.angle_min, scan.angle_increment)
    if not np.array_equal(grid.angles, scan.angles):
        return {"angle_min": None, "angle_increment": None, "angles": sign * scan.angles[::way]}
    first = scan.angle_min if way > 0 or not len(scan) else float(scan.angles[-1])
    step = sign * way * scan.angle_increment
    return {"angle_min": sign * first, "angle_increment": step, "angles": None}


@dataclass(frozen=True, eq=False, kw_only=True)
class Readings:
    """The valid readings of one sweep, counter-clockwise, whatever way the sensor turns."""

    # (m,): index of each reading in the scan's own order: ascending for a counter-clockwise sensor, descending for a
    # clockwise one
    beam_idx: Ints
    ranges: Floats  # (m,): metres
    angles: Floats  # (m,): radians, ascending
    points: Points  # (m, 2): metres, sensor frame
    # angle between neighbouring beams, radians, positive; the median one where they are not evenly spaced
    angle_step: float
    n_beams: int  # beams of the sweep, valid or not
    is_closed: bool  # whether the sweep covers the full circle, so that the last reading precedes the first

    def __len__(self) -> int:
        return int(self.beam_idx.size)


def valid_readings(scan: LaserScan) -> Readings:
    """Return a scan's valid readings, counter-clockwise; a clockwise scan and its mirror image give the same."""
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


_FAR = 250.0  # metres: no 2D laser without a stated limit measures all of its surroundings farther than this
_TINY = float(np.finfo(np.float64).smallest_subnormal)
_FARTHEST = 1e4
"""Metres: what drivers say beyond is a code for no return (FLT_MAX, 1e9), whose square leaves others no digits."""


def _read_only_row(values: ArrayLike, name: str) -> Floats:
    try:
        with np.errstate(invalid="ignore"):  # a signalling NaN of float32 is a NaN
            if isinstance(values, np.ma.MaskedArray):
                values = np.ma.filled(values.astype(np.float64), np.nan)
            is_shared = type(values) is np.ndarray and values.flags.owndata and not values.flags.writeable
            row = (np.asarray if is_shared else np.array)(values, dtype=np.float64, order="C")  # of another scan
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} must be numbers, one a beam: {error}") from error
    if row.ndim != 1:
        raise InvalidArgumentError(f"{name} must be 1-D, got shape {row.shape}")
    row.setflags(write=False)
    return row


def as_odometry_pose(given: ArrayLike, name: str) -> Pose:
    """Return a pose by wheels, whose values may be NaN. Raises InvalidArgumentError."""
    pose = _read_only_row(given, name)
    if pose.shape != (3,) or np.isinf(pose).any():
        raise InvalidArgumentError(
            f"{name} must be three numbers [x, y, theta], finite or NaN where it is unknown, got {given!r:.80}"
        )
    return pose


def as_float(value: object, name: str) -> float:
    """Return a number. Raises InvalidArgumentError."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} must be a number, got {value!r}") from error
