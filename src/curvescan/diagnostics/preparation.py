"""prepare_log: a log as every run takes it, mended, with the motion prior that agrees with its scans."""

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from curvescan.diagnostics.inspect import LogReport, inspect_log
from curvescan.diagnostics.issues import Issue, find_issues
from curvescan.diagnostics.motion_prior import Prior, choose_prior, straightened
from curvescan.diagnostics.sensor import SensorJudgement, judge_sensor
from curvescan.engines.rig import RigLog
from curvescan.io.arrays.memory import as_log
from curvescan.io.log import HeldLog, Log, LogView, ScanAccess
from curvescan.io.sensor_setup import SensorSetup, apply_setup, setup_of
from curvescan.scan import LaserScan, without_readings
from curvescan.types import Floats, Pose

# kinds of issues whose mending leaves readings out
_DROPS = ("stale_beams", "undeclared_codes", "ring", "floor", "fixed_beams", "empty_beams")
_JUDGED_AT = (100, 1000)  # scans after which a running laser is judged


@dataclass(frozen=True, eq=False, kw_only=True)
class PreparedLog:
    """A log as a run takes it."""

    log: Log  # without what is wrong beyond doubt, its scans with its noise; itself where there is neither
    done: tuple[Issue, ...]  # what was mended; ``mending`` of each says how
    issues: tuple[Issue, ...]  # what is still wrong or odd with it
    report: LogReport  # what is in it now
    prior: Prior = Prior()  # noqa: RUF009 - frozen; the motion by wheels or gyroscope, and why it is used or left out

    @property
    def odometry_poses(self) -> Pose | None:
        """(n, 3) pose at each scan by wheels or gyroscope, for ``add(scan, odometry_pose)``; None if unused."""
        return self.prior.poses

    @property
    def sensor(self) -> SensorJudgement:
        """What the scans say of the sensor."""
        return SensorJudgement(beam_order=self.report.beam_order, rotation=self.report.sense)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended, whether wheels or gyroscope are used, and why: a sentence each."""
        kept = ((issue.mending, "keeps" if issue.kind in _DROPS else "leaves") for issue in self.done)
        return (
            *(f"{mending}; as_is=True {does} them" for mending, does in kept),
            *filter(None, (self.prior.sentence,)),
        )

    def as_plain(self) -> dict[str, object]:
        """Return what run.json holds of it."""
        done = [{"kind": i.kind, "what": i.mending, "argument": i.argument or None} for i in self.done]
        return {"mended": done, "motion_prior": self.prior.sentence}


def mend(log: Log, *, as_is: bool = False, is_order_needed: bool = True) -> PreparedLog:
    """Return a log mended where it is wrong beyond doubt: no-return codes, stale, turned or mirrored beams.

    Its scans say how the noise of the laser grows with the range. as_is: mend nothing, and only say what is wrong;
    is_order_needed: find out in which order the beams were swept, which takes a second and is needed to deskew them.
    """
    given = setup_of(log)
    lasers: tuple[Issue, ...] = ()
    done: tuple[Issue, ...] = ()
    if isinstance(log, RigLog) and not as_is:
        log, lasers = _mended_rig(log, is_order_needed=is_order_needed)
    while True:  # what is mended first can hide what is mended next; each kind is mended once
        report = inspect_log(log, judge_sensor(log, is_order_needed=is_order_needed))
        issues = find_issues(report)
        faults = [i for i in issues if i.mending and not _is_set(given, i) and i.kind not in {d.kind for d in done}]
        if as_is or not faults:
            break
        log, done = HeldLog(_without(log, faults, report)), (*done, *faults)
    if not as_is and report.noise_doubled_at < math.inf:
        log = HeldLog(_Changed(log, lambda _, scan: replace(scan, noise_doubled_at=report.noise_doubled_at)))
    return PreparedLog(log=log, done=(*lasers, *done), issues=issues, report=report)


def _mended_rig(log: RigLog, *, is_order_needed: bool) -> tuple[RigLog, tuple[Issue, ...]]:
    """Return a rig's log of mended lasers, and what was mended in each."""
    lasers = {name: mend(laser, is_order_needed=is_order_needed) for name, laser in log.lasers.items()}
    done = (replace(i, mending=f"{name}: {i.mending}") for name, laser in lasers.items() for i in laser.done)
    return RigLog(log.rig, {name: laser.log for name, laser in lasers.items()}), tuple(done)


def _is_set(given: SensorSetup, fault: Issue) -> bool:
    """Return whether the user has set by hand what the remedy of a fault would set."""
    name = "" if fault.remedy is None else fault.remedy.argument
    if name in ("clockwise", "upside_down"):
        return given.clockwise or given.upside_down is not None
    return bool(np.any(getattr(given, name, False)))


def _without(log: Log, faults: list[Issue], report: LogReport) -> Log:
    """Return a log without its faults."""
    kinds = {fault.kind for fault in faults}
    if filters := _filters(kinds, report):
        log = _Changed(log, lambda _, scan: _filtered(scan, filters))
    if kinds & {"undeclared_codes", "gyro_in_degrees", "gyro_bias", "bent_sweeps"}:
        remedies = dict(fault.remedy for fault in faults if fault.remedy is not None)
        log = _corrected(log, kinds, report, float(str(remedies.get("range_max", math.inf))))
    setup = SensorSetup(
        upside_down=False,
        clockwise="turns_against" in kinds,
        drop_stale="stale_beams" in kinds,
        backwards="beams_reversed" in kinds,
    )
    return apply_setup(log, setup)


def _filters(kinds: Collection[str], report: LogReport) -> list[Callable[[LaserScan], LaserScan]]:
    """Return what leaves out readings of a ring, the floor and beams that see the robot, and beams that do not fire."""
    found = {name: getattr(report, name) for name in ("ring", "floor", "fixed_beams", "empty_beams")}
    return [one.without for kind, one in found.items() if one is not None and kind in kinds]


def _filtered(scan: LaserScan, filters: Iterable[Callable[[LaserScan], LaserScan]]) -> LaserScan:
    for without in filters:
        scan = without(scan)
    return scan


def _limited(scan: LaserScan, range_max: float) -> LaserScan:
    return replace(scan, range_max=range_max) if scan.range_max > range_max else scan


class StreamMender:
    """Mends a running laser's scans by what the first show: codes, a ring, stale beams; it tells when that changes.

    How their noise grows with the range, the first show too.
    """

    def __init__(self, tell: Callable[[str], object]) -> None:
        self._tell = tell
        self._first: list[LaserScan] = []
        self._done: dict[str, Issue] = {}
        self._before, self._range_max, self._noise_doubled_at = np.empty(0), math.inf, math.inf
        self._filters: list[Callable[[LaserScan], LaserScan]] = []

    def add(self, scan: LaserScan) -> LaserScan:
        """Return the next scan, mended."""
        if len(self._first) < _JUDGED_AT[-1]:
            self._first.append(scan)
            if len(self._first) in _JUDGED_AT:
                self._judge()
        before, self._before = self._before, scan.ranges
        scan = _limited(scan, self._range_max)
        if "stale_beams" in self._done and len(before) == len(scan):
            scan = without_readings(scan, scan.valid & (scan.ranges == before))
        if self._noise_doubled_at < math.inf:
            scan = replace(scan, noise_doubled_at=self._noise_doubled_at)
        return _filtered(scan, self._filters)

    def _judge(self) -> None:
        report = inspect_log(as_log(self._first), SensorJudgement(beam_order=None, rotation=None))
        found = {i.kind: i for i in find_issues(report) if i.mending and i.kind in _DROPS}
        since = f"from scan {len(self._first):,} on"
        for kind, issue in found.items():
            if kind not in self._done or issue.argument != self._done[kind].argument:
                self._tell(f"{since} {issue.mending}")
        for kind in self._done.keys() - found.keys():
            self._tell(f"{since} no longer {self._done[kind].mending}")
        limits = dict(i.remedy for i in found.values() if i.remedy)
        self._filters, self._noise_doubled_at = _filters(found, report), report.noise_doubled_at
        self._done, self._range_max = found, float(str(limits.get("range_max", math.inf)))


class _Changed(LogView):
    """A Log whose scans a function of number and scan changes; turned: by its gyroscope, None as the log below says."""

    def __init__(self, log: Log, change: Callable[[int, LaserScan], LaserScan], turned: Floats | None = None) -> None:
        super().__init__(log)
        self._change, self._turned = change, turned

    def turned_by_gyro(self) -> Floats | None:
        """Return the angle that the gyroscope has turned by at each scan, radians."""
        return super().turned_by_gyro() if self._turned is None else self._turned

    def __iter__(self) -> Iterator[LaserScan]:
        return map(self._change, itertools.count(), self._log)

    def _scan_at(self, i: int) -> LaserScan:
        return self._change(i, self._log[i])


def _corrected(log: Log, kinds: Collection[str], report: LogReport, range_max: float) -> Log:
    """Return a log with a limit of its readings, its gyroscope corrected, and its sweeps straightened by it."""
    seconds = report.time.step_median if "bent_sweeps" in kinds else 0.0
    turned, rates = log.turned_by_gyro() if isinstance(log, ScanAccess) else None, np.full(len(log), np.nan)
    if turned is not None:
        bias = report.gyroscope.bias if report.gyroscope and "gyro_bias" in kinds else 0.0
        stamps = np.array([scan.stamp for scan in log])
        turned = (math.radians(1.0) if "gyro_in_degrees" in kinds else 1.0) * turned - bias * (stamps - stamps[:1])
        steps = np.diff(stamps, prepend=np.nan)
        np.divide(np.diff(turned, prepend=np.nan), steps, out=rates, where=steps > 0.0)

    def change(k: int, scan: LaserScan) -> LaserScan:
        scan = _limited(scan, range_max)
        return straightened(scan, float(rates[k]), seconds) if seconds > 0.0 else scan

    return _Changed(log, change, turned)


def prepare_log(
    log: Log, *, odometry_prior: bool | None = None, as_is: bool = False, is_order_needed: bool = True
) -> PreparedLog:
    """Return a log as every run, command and live replay takes it: mended, and with its motion prior.

    odometry_prior: whether to use wheels or gyroscope, None where they agree with the scans; the rest as of
    :func:`mend`. Raises InvalidArgumentError as :func:`choose_prior` does.
    """
    held = log if isinstance(log, RigLog) else HeldLog(log)  # a rig's log holds its joined scans itself
    mended = mend(held, as_is=as_is, is_order_needed=is_order_needed)
    report = mended.report
    lag = report.odometry.lag if report.odometry else 0.0
    return replace(mended, prior=choose_prior(mended.log, sense=report.sense, lag=lag, wanted=odometry_prior))
