"""LogReport: the figures of a log; ``issues.py`` states their consequences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from curvescan.diagnostics.beam_order import BeamOrder
from curvescan.diagnostics.rotation_direction import RotationDirection
from curvescan.io.files.read_errors import ReadError

if TYPE_CHECKING:
    from curvescan.diagnostics.prior.gyroscope import Gyroscope


@dataclass(frozen=True, kw_only=True)
class ReadingCode:
    """A value that stands for *no reading*.

    Attributes
    ----------
    value : float
        Metres; may be NaN or infinite.
    share : float
        Part of all readings, 0 to 1.
    """

    value: float
    share: float


@dataclass(frozen=True, kw_only=True)
class TimeSummary:
    """Time steps from scan to scan; seconds and hertz, NaN where there are too few scans.

    Attributes
    ----------
    duration : float
        From the earliest to the latest stamp.
    mean_rate : float
        Steps per duration, hertz; NaN when all stamps are equal.
    n_steps : int
        One less than scans.
    step_min, step_max : float
        Smallest (negative when time goes back) and largest step.
    step_median : float
        Median of the steps that go forward.
    jitter : float
        Standard deviation of the steps that go forward and are no leaps.
    n_missing : int
        Sweeps that seem to be missing where the clock is regular: whole steps that fit into longer ones.
    n_equal, n_back : int
        Steps of zero, and steps back.
    largest_back : float
        Size of the largest step back, 0 without.
    n_leaps : int
        Steps of more than 1 s and more than ten times the median.
    largest_leap : float
        Size of the largest of them, 0 without.
    """

    duration: float = math.nan
    mean_rate: float = math.nan
    n_steps: int = 0
    step_min: float = math.nan
    step_median: float = math.nan
    step_max: float = math.nan
    jitter: float = math.nan
    n_missing: int = 0
    n_equal: int = 0
    n_back: int = 0
    largest_back: float = 0.0
    n_leaps: int = 0
    largest_leap: float = 0.0


@dataclass(frozen=True, kw_only=True)
class OdometrySummary:
    """Motion by the wheel odometry of a log.

    Attributes
    ----------
    path_length : float
        Sum of the steps, metres.
    turned_deg : float
        Sum of the turns, either way, degrees.
    n_missing : int
        Scans without a pose.
    lag : float
        Seconds by which its headings are late against the scans; 0 where no lag is found.
    """

    path_length: float
    turned_deg: float
    n_missing: int
    lag: float = 0.0


@dataclass(frozen=True, kw_only=True)
class LogReport:
    """What a log holds.

    Attributes
    ----------
    name, format : str
        As the log gives them.
    n_scans : int
        Scans.
    beam_counts : mapping of int to int
        Scans by number of beams.
    fov_deg, first_beam_deg, angle_step_deg : float
        Field of view, direction of beam 0 and angle from beam to beam (negative for a clockwise sensor) of the
        most frequent arrangement of beams, degrees; NaN without scans.
    range_min, range_max : float
        Smallest lower and largest upper limit of a valid reading, metres.
    time : TimeSummary
        Time steps.
    n_timed_scans : int
        Scans that give the time from one beam to the next, without which the motion within a sweep cannot be undone.
    sweep_seconds : float
        Longest time from the first to the last beam of a sweep, by the beams' own times; 0 where they have none.
    valid_share : float
        Valid part of all readings, 0 to 1; NaN without readings.
    n_blank_scans : int
        Scans without a valid reading.
    n_repeated_scans : int
        Scans whose readings are exactly those of the scan before.
    n_blind_beams : int
        Beams, in the arrangement of the first scan, that never give a valid reading.
    stale_share : float
        Share of the readings that repeat the sweep before beyond what noise explains, 0 to 1: bins that kept an old
        value. NaN where the scene does not change enough.
    stale_run : float
        Share of the readings that repeat the sweep before whose next beam does too; NaN without any.
    fixed_beams : tuple of (int, int)
        Runs of beams, first and last, that keep their reading while the sensor moves: they see the robot.
    largest_reading : float
        Largest valid reading, metres; NaN without.
    codes : tuple of ReadingCode
        Values that are no reading and make up at least 0.1 % of the readings, most frequent first, 8 at most.
    suspect : ReadingCode or None
        A valid value that repeats so often at the top of the range that it looks like a code for *no reading*.
    code_band : (float, float, float) or None
        Lower and upper end, metres, and share of all readings of a band at the top of the range that looks like several
        codes for *no reading*.
    odometry : OdometrySummary or None
        None when the log has none.
    mount : tuple of 3 float, or None
        Pose x, y, theta of the laser on the robot, metres, metres, radians; None where the log does not give it.
    is_upside_down : bool
        Whether the log says that the laser hangs upside down.
    sense : RotationDirection or None
        Whether the scans turn as the wheels or a gyroscope do; None where neither turns.
    gyroscope : Gyroscope or None
        What sure matches say of the gyroscope; None without one that turns with the scans, in radians.
    beam_order : BeamOrder or None
        In which order the beams of a sweep were swept; None where the scans have no beam times.
    tag_counts : mapping of str to int
        Messages by kind, where the format has kinds.
    read_errors : tuple of ReadError
        What is broken in the file.
    notes : tuple of str
        What the reader left out or assumed.
    """

    name: str
    format: str
    n_scans: int
    beam_counts: Mapping[int, int]
    fov_deg: float
    first_beam_deg: float
    angle_step_deg: float
    range_min: float
    range_max: float
    time: TimeSummary
    n_timed_scans: int
    sweep_seconds: float
    valid_share: float
    n_blank_scans: int
    n_repeated_scans: int
    n_blind_beams: int
    stale_share: float
    stale_run: float
    fixed_beams: tuple[tuple[int, int], ...]
    largest_reading: float
    codes: tuple[ReadingCode, ...]
    suspect: ReadingCode | None
    code_band: tuple[float, float, float] | None
    odometry: OdometrySummary | None
    mount: tuple[float, float, float] | None
    is_upside_down: bool
    sense: RotationDirection | None
    gyroscope: Gyroscope | None
    beam_order: BeamOrder | None
    tag_counts: Mapping[str, int]
    read_errors: tuple[ReadError, ...]
    notes: tuple[str, ...]

    @property
    def is_usable(self) -> bool:
        """Whether a motion can be looked for: at least two scans with a valid reading."""
        return self.n_scans - self.n_blank_scans >= 2
