"""LogReport: the figures of a log; ``issues.py`` states their consequences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from curvescan.diagnostics.beam_order import BeamOrder
from curvescan.diagnostics.beam_statistics import FixedBeams
from curvescan.diagnostics.rotation_direction import RotationDirection
from curvescan.diagnostics.top_of_range import Ring
from curvescan.io.files.read_errors import ReadError

if TYPE_CHECKING:
    from curvescan.diagnostics.prior.gyroscope import Gyroscope


@dataclass(frozen=True, kw_only=True)
class ReadingCode:
    """A value that stands for *no reading*."""

    value: float  # metres; may be NaN or infinite
    share: float  # part of all readings, 0 to 1


@dataclass(frozen=True, kw_only=True)
class TimeSummary:
    """Time steps from scan to scan; seconds and hertz, NaN where there are too few scans."""

    duration: float = math.nan  # from the earliest to the latest stamp
    mean_rate: float = math.nan  # steps per duration, hertz; NaN when all stamps are equal
    n_steps: int = 0  # one less than scans
    # smallest (negative when time goes back) and largest step
    step_min: float = math.nan
    step_median: float = math.nan  # median of the steps that go forward
    step_max: float = math.nan
    jitter: float = math.nan  # standard deviation of the steps that go forward and are no leaps
    # sweeps that seem to be missing where the clock is regular: whole steps that fit into longer ones
    n_missing: int = 0
    # steps of zero, and steps back
    n_equal: int = 0
    n_back: int = 0
    largest_back: float = 0.0  # size of the largest step back, 0 without
    n_leaps: int = 0  # steps of more than 1 s and more than ten times the median
    largest_leap: float = 0.0  # size of the largest of them, 0 without


@dataclass(frozen=True, kw_only=True)
class OdometrySummary:
    """Motion by the wheel odometry of a log."""

    path_length: float  # sum of the steps, metres
    turned_deg: float  # sum of the turns, either way, degrees
    n_missing: int  # scans without a pose
    lag: float = 0.0  # seconds by which its headings are late against the scans; 0 where no lag is found


@dataclass(frozen=True, kw_only=True)
class LogReport:
    """What a log holds."""

    name: str
    format: str  # as the log gives them
    n_scans: int
    beam_counts: Mapping[int, int]  # scans by number of beams
    # field of view, direction of beam 0 and angle from beam to beam (negative for a clockwise sensor) of the most
    # frequent arrangement of beams, degrees; NaN without scans
    fov_deg: float
    first_beam_deg: float
    angle_step_deg: float
    range_min: float  # of a valid reading, metres: the smallest lower and the largest upper limit
    range_max: float
    time: TimeSummary
    # scans that give the time from one beam to the next, without which the motion within a sweep cannot be undone
    n_timed_scans: int
    # longest time from the first to the last beam of a sweep, by the beams' own times; 0 where they have none
    sweep_seconds: float
    valid_share: float  # valid part of all readings, 0 to 1; NaN without readings
    n_blank_scans: int  # scans without a valid reading
    n_repeated_scans: int  # scans whose readings are exactly those of the scan before
    n_blind_beams: int  # beams, in the arrangement of the first scan, that never give a valid reading
    # share of the readings that repeat the sweep before beyond what noise explains, 0 to 1: bins that kept an old
    # value; NaN where the scene does not change enough
    stale_share: float
    stale_run: float  # share of the readings that repeat the sweep before whose next beam does too; NaN without any
    fixed_beams: FixedBeams | None  # beams that see the robot itself; None without
    largest_reading: float  # largest valid reading, metres; NaN without
    # values that are no reading and make up at least 0.1 % of the readings, most frequent first, 8 at most
    codes: tuple[ReadingCode, ...]
    # a valid value that repeats so often at the top of the range that it looks like a code for *no reading*
    suspect: ReadingCode | None
    # lower and upper end, metres, and share of all readings of a band at the top of the range that looks like
    # several codes for *no reading*
    code_band: tuple[float, float, float] | None
    ring: Ring | None  # readings that stay at one range in all directions; None without
    odometry: OdometrySummary | None  # None when the log has none
    # pose x, y, theta of the laser on the robot, metres, metres, radians; None where the log does not give it
    mount: tuple[float, float, float] | None
    is_upside_down: bool  # whether the log says that the laser hangs upside down
    sense: RotationDirection | None  # whether the scans turn as the wheels or a gyroscope do; None where neither turns
    # what sure matches say of the gyroscope; None without one that turns with the scans, in radians
    gyroscope: Gyroscope | None
    # in which order the beams of a sweep were swept; None where the scans have no beam times
    beam_order: BeamOrder | None
    tag_counts: Mapping[str, int]  # messages by kind, where the format has kinds
    read_errors: tuple[ReadError, ...]  # what is broken in the file
    notes: tuple[str, ...]  # what the reader left out or assumed

    @property
    def is_usable(self) -> bool:
        """Whether a motion can be looked for: at least two scans with a valid reading."""
        return self.n_scans - self.n_blank_scans >= 2
