"""inspect_log: what is in a log and what is wrong with it, found in one pass over its scans, and one over its turns."""

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.diagnostics.floor import Floor, find_lines, moves_along
from curvescan.diagnostics.motion_prior import Gyroscope, judge_gyroscope
from curvescan.diagnostics.range_noise import noise_doubled_at
from curvescan.diagnostics.rotation_direction import RotationDirection, odometry_lag
from curvescan.diagnostics.sensor import BeamOrder, SensorJudgement, judge_sensor
from curvescan.diagnostics.statistics import EmptyBeams, FixedBeams, LogStatistics
from curvescan.diagnostics.top_of_range import BIN, Ring, TopOfRange, is_of_walls
from curvescan.io.arrays.memory import as_log
from curvescan.io.files.lines import ReadError
from curvescan.io.log import Log, ScanAccess
from curvescan.io.reading import read_log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Bools, Floats


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

    @property
    def n_sweeps(self) -> int:
        """Sweeps that are there, and those that seem to be missing."""
        return self.n_steps + 1 + self.n_missing


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
    empty_beams: EmptyBeams | None  # beams that never read between others that do; None where they are not many
    fixed_beams: FixedBeams | None  # beams that see the robot itself; None without
    largest_reading: float  # largest valid reading, metres; NaN without
    noise_doubled_at: float  # range at which the variance of the range noise has doubled, metres; inf: it does not grow
    # values that are no reading and make up at least 0.1 % of the readings, most frequent first, 8 at most
    codes: tuple[ReadingCode, ...]
    # a valid value that repeats so often at the top of the range that it looks like a code for *no reading*
    suspect: ReadingCode | None
    # lower and upper end, metres, and share of all readings of a band at the top of the range that looks like
    # several codes for *no reading*
    code_band: tuple[float, float, float] | None
    ring: Ring | None  # readings that stay at one range in all directions; None without
    floor: Floor | None  # readings of the floor, which a tilted laser sees; None without
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
        """Whether motion can be estimated: at least two scans have a valid reading."""
        return self.n_scans - self.n_blank_scans >= 2


_MIN_CODE_SHARE = 0.001
_MAX_CODES = 8
_N_SUSPECTS = 3
_MIN_SUSPECT_SHARE = 0.01
_MIN_SUSPECT_COUNT = 20
_LEAP_FACTOR = 10.0
_LEAP_SECONDS = 1.0
_REGULAR = 0.2  # span of the middle half of the steps of a regular clock, as a share of their median
_MISSING = 1.6  # steps from which on a sweep is missing, in medians


@np.errstate(over="ignore", invalid="ignore")  # a file may hold stamps and poses of 1e308
def inspect_log(
    log: Log | Iterable[LaserScan] | str | os.PathLike[str], sensor: SensorJudgement | None = None
) -> LogReport:
    """Return what a log holds and what is wrong with it.

    Reads the scans once, and once more where the robot's turns are measured or readings look like codes.
    :func:`find_issues` says in sentences what the figures mean. log: any source of scans, a simulated one too, it may
    be empty; or the path of a file; sensor: what its scans say of the sensor, where that was judged before. Raises
    InvalidArgumentError, LogFileError and LogFormatError where the log is none.
    """
    log = read_log(log) if isinstance(log, str | os.PathLike) else as_log(log)
    statistics = LogStatistics()
    for scan in log:
        statistics.add(scan)
    frequent_layout = statistics.layouts.most_common(1) or [((0, math.nan, math.nan, False), 0)]
    n_beams, angle_min, step, is_circle = frequent_layout[0][0]
    beam_counts: dict[int, int] = {}
    for (n, *_), n_scans in sorted(statistics.layouts.items()):
        beam_counts[n] = beam_counts.get(n, 0) + n_scans
    odometry, sensor = log.odometry, sensor or judge_sensor(log)
    angles = angle_min + step * np.arange(n_beams, dtype=np.float64)
    code_band, ring, floor = _turning_along(log, statistics.top_of_range, angles)
    return LogReport(
        name=log.name,
        format=log.format,
        n_scans=len(statistics.stamps),
        beam_counts=beam_counts,
        fov_deg=360.0 if is_circle else math.degrees(abs(step)) * max(n_beams - 1, 0),
        first_beam_deg=math.degrees(angle_min),
        angle_step_deg=math.degrees(step),
        range_min=statistics.range_min if statistics.stamps else math.nan,
        range_max=statistics.range_max if statistics.stamps else math.nan,
        time=summarise_time(np.array(statistics.stamps)),
        n_timed_scans=statistics.n_timed,
        sweep_seconds=statistics.sweep_seconds,
        valid_share=statistics.n_valid / statistics.n_readings if statistics.n_readings else math.nan,
        n_blank_scans=statistics.n_blank,
        n_repeated_scans=statistics.n_repeats,
        n_blind_beams=statistics.beams.n_blind,
        stale_share=statistics.beams.stale_share,
        stale_run=statistics.beams.stale_run,
        empty_beams=statistics.beams.empty_beams,
        fixed_beams=statistics.beams.fixed_beams,
        largest_reading=max(statistics.top, default=math.nan),
        noise_doubled_at=noise_doubled_at(statistics.sample),
        codes=_codes(statistics),
        suspect=_suspect(statistics),
        code_band=code_band,
        ring=ring,
        floor=floor,
        odometry=None if odometry is None else _summarise_odometry(odometry, odometry_lag(log, odometry.poses[:, 2])),
        mount=_mount(log, odometry),
        is_upside_down=isinstance(log, ScanAccess) and log.hangs_upside_down(),
        sense=sensor.rotation,
        gyroscope=_gyroscope(log, sensor.rotation),
        beam_order=sensor.beam_order,
        tag_counts=dict(log.tag_counts),
        read_errors=log.read_errors,
        notes=log.notes,
    )


def _turning_along(
    log: Log, top: TopOfRange, angles: Floats
) -> tuple[tuple[float, float, float] | None, Ring | None, Floor | None]:
    """Return what turns with the sensor, one at most: codes at the top of the range, a ring, or the floor."""
    code_band = top.code_band()
    if code_band is not None and not is_of_walls(log, code_band[:2]):
        return code_band, None, None
    ring = top.ring()
    if ring is not None and not is_of_walls(log, ring[:2]):
        return None, ring, None
    lines = find_lines(top.counts[:, : len(angles)], BIN, angles)
    return None, None, next((line for line in lines if moves_along(log, line)), None)


def _gyroscope(log: Log, sense: RotationDirection | None) -> Gyroscope | None:
    """Return what sure matches say of a gyroscope; None where it is unused, reversed or in degrees."""
    is_used = sense is not None and sense.reference == "gyroscope" and not (sense.is_reversed or sense.is_in_degrees)
    turned = log.turned_by_gyro() if is_used and isinstance(log, ScanAccess) else None
    return None if turned is None else judge_gyroscope(log, turned)


def are_leaps(steps: Floats, median: float) -> Bools:
    """Return (n,) which time steps are leaps, seconds; their median is that of the steps that go forward."""
    return steps > max(_LEAP_SECONDS, _LEAP_FACTOR * median)


def summarise_time(stamps: Floats) -> TimeSummary:
    """Return what the time steps between (n,) stamps look like; NaN where there are too few scans."""
    steps = np.diff(stamps)
    if not steps.size:
        return TimeSummary()
    forward, back = steps[steps > 0.0], steps[steps < 0.0]
    median = float(np.median(forward)) if forward.size else math.nan
    # no comparison with NaN holds: without a forward step there is no leap
    is_leap = are_leaps(forward, median)
    leaps, usual = forward[is_leap], forward[~is_leap]
    # a clock is regular where the middle half of its steps lies near their median; else nothing tells what is missing
    is_regular = usual.size and not np.subtract(*np.percentile(usual, [75, 25])) > _REGULAR * median
    n_missing = np.sum(np.round(usual / median) - 1.0, where=usual > _MISSING * median) if is_regular else 0
    duration = float(np.ptp(stamps))
    return TimeSummary(
        duration=duration,
        mean_rate=steps.size / duration if duration > 0.0 else math.nan,
        n_steps=int(steps.size),
        step_min=float(np.min(steps)),
        step_median=median,
        step_max=float(np.max(steps)),
        jitter=float(np.std(usual)) if usual.size else math.nan,
        n_missing=int(n_missing),
        n_equal=int(np.count_nonzero(steps == 0.0)),
        n_back=int(back.size),
        largest_back=float(np.max(-back, initial=0.0)),
        n_leaps=int(leaps.size),
        largest_leap=float(np.max(leaps, initial=0.0)),
    )


def _mount(log: Log, odometry: Trajectory | None) -> tuple[float, float, float] | None:
    """Return the pose of the laser on the robot, from the poses of both."""
    robot = log.robot_odometry() if isinstance(log, ScanAccess) else None
    if robot is None or odometry is None:
        return None
    mounts = se2.between(robot.poses, odometry.poses)
    return next(((x, y, theta) for x, y, theta in mounts.tolist() if math.isfinite(x + y + theta)), None)


def _summarise_odometry(odometry: Trajectory, lag: float) -> OdometrySummary:
    poses = odometry.poses[np.all(np.isfinite(odometry.poses), axis=1)]
    moves = np.diff(poses, axis=0)
    return OdometrySummary(
        path_length=float(np.sum(np.hypot(moves[:, 0], moves[:, 1]))),
        turned_deg=math.degrees(float(np.sum(np.abs(se2.wrap(moves[:, 2]))))),
        n_missing=len(odometry) - len(poses),
        lag=lag,
    )


def _codes(statistics: LogStatistics) -> tuple[ReadingCode, ...]:
    frequent = statistics.codes.most_common(_MAX_CODES)
    codes = (ReadingCode(value=value, share=count / statistics.n_readings) for value, count in frequent)
    return tuple(code for code in codes if code.share >= _MIN_CODE_SHARE)


def _suspect(statistics: LogStatistics) -> ReadingCode | None:
    """Return a value that stands for *no reading* without being declared so, or None.

    A real reading seldom repeats exactly. A driver's code is one of the largest values, and by far the most frequent.
    """
    least = max(_MIN_SUSPECT_COUNT, _MIN_SUSPECT_SHARE * statistics.n_fresh_readings)
    for value in sorted(statistics.top)[-_N_SUSPECTS:]:
        if statistics.top[value] >= least:
            return ReadingCode(value=value, share=statistics.top[value] / statistics.n_fresh_readings)
    return None
