"""The motion prior of a log: its wheel odometry, or else its gyroscope, where it agrees with the scans.

Motions from all over a log are matched that are short, and known as no more. A laser without beam times sweeps from one
stamp to the next: on the turn such sweeps are bent, and match better the more of it the gyroscope takes out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from curvescan import se2
from curvescan.deskew import deskew
from curvescan.diagnostics.rotation_direction import RotationDirection, without_lag
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log, ScanAccess
from curvescan.matchers import MatchResult, match
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, fuse
from curvescan.types import Floats, Pose

_N_MOTIONS = 150
_SHORTEST, _LONGEST, _MAX_TURN = 0.1, 0.5, 0.5
"""Motions that are compared: metres, metres, radians. Shorter ones say nothing, longer ones are harder to match."""

_SHORT = UncertainPose(np.zeros(3), np.diag([_LONGEST, _LONGEST, _MAX_TURN]) ** 2)
_MAX_SCANS = 60  # most scans that a motion takes
SURE = 0.9  # confidence from which on a match is taken for right
_N_SURE_MOTIONS = 10  # sure matches that it takes to judge

_OFF, _OFF_RAD, _OFF_SHARE = 0.05, 0.03, 0.25
"""Motions agree that differ by no more than this, metres and radians, and this share of the motion: they may slip."""

_AGREEING = 0.6  # share of the sure matches that agree with wheels that are used


def compare_motion(log: Log, poses: Pose) -> tuple[bool, str]:
    """Return whether (n, 3) poses by wheels, or by a gyroscope (x, y NaN), agree with matched scans, and a sentence.

    Where scans show few motions whole, as along bare walls, what they show of them counts: wheels help most there.
    """
    whole, partly = list[bool](), list[bool]()
    for i, j in _motions(poses[: len(log)]):
        if (found := _sure_match(log[i], log[j])) is not None:
            agreeing = whole if found.degenerate_direction is None else partly
            agreeing.append(_agrees(UncertainPose(found.pose, found.covariance), se2.between(poses[i], poses[j])))
    compared, what = (whole, "the scans in") if len(whole) >= _N_SURE_MOTIONS else (partly, "what the scans show of")
    if len(compared) < _N_SURE_MOTIONS:
        return False, "cannot be compared with the scans: too few motions are matched surely"
    n_agreeing = sum(compared)
    return n_agreeing >= _AGREEING * len(compared), f"agrees with {what} {n_agreeing} of {len(compared)} motions"


def _agrees(seen: UncertainPose, measured: Pose) -> bool:
    """Return whether a match differs no more from a measured motion, (3,), than that may slip; from NaN by nothing."""
    x, y, turn = np.nan_to_num(measured).tolist()
    metres, radians = _OFF + _OFF_SHARE * math.hypot(x, y), _OFF_RAD + _OFF_SHARE * abs(turn)
    known = np.where(np.isnan(measured), seen.pose, measured)
    return fuse(seen, UncertainPose(known, np.diag(np.square([metres, metres, radians]))))[1] <= 1.0


def sure_motion(earlier: LaserScan, later: LaserScan) -> Pose | None:
    """Return the (3,) motion between two scans by a match that knows it is short; None unless all of it is sure."""
    found = _sure_match(earlier, later)
    return None if found is None or found.degenerate_direction is not None else found.pose


def _sure_match(earlier: LaserScan, later: LaserScan) -> MatchResult | None:
    """Return the match of two scans that knows how short the motion is, where it is sure, all of it or in part."""
    found = match(earlier, later, prior=_SHORT)
    return found if found.ok and found.confidence > SURE else None


def _motions(poses: Pose) -> list[tuple[int, int]]:
    """Return pairs of scans: of each part of the log the longest motion from its first scans."""
    found = []
    edges = np.linspace(0, max(len(poses) - 1, 0), _N_MOTIONS + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        best, size = None, 0.0
        for i in range(begin, end, max((end - begin) // 8, 1)):
            moved = se2.between(poses[i], poses[i + 1 : i + 1 + _MAX_SCANS])
            length, turn = np.nan_to_num(np.hypot(moved[:, 0], moved[:, 1])), np.abs(moved[:, 2])
            is_short = (length <= _LONGEST) & (turn <= _MAX_TURN)
            n_short = int(np.argmin(is_short)) if not is_short.all() else is_short.size
            is_motion = (length >= _SHORTEST) | (turn >= _SHORTEST)
            amount = np.where(is_motion, length + turn, 0.0)[:n_short]
            if amount.size and amount.max() > size:
                best, size = (i, i + 1 + int(np.argmax(amount))), float(amount.max())
        if best is not None:
            found.append(best)
    return found


_WAY = 50.0  # least way between two visits of a place, metres
_NEAR = 0.5  # most by which the two poses differ, metres and radians

_EXACT, _EXACT_RAD = 0.15, math.radians(2.0)
"""Poses that never drift agree with the scans within so much: the steps of a search grid, and of rounding."""

_N_VISITS, _N_SURE = 40, 10  # visits that are matched at most, and those that must be sure to judge by
_APART = 10  # scans between a visit that is matched and the one before, at least
_SHARE = 0.9  # share of the sure visits that are exact in poses that never drift


def why_reference(log: Log, poses: Pose) -> str:
    """Return why the poses (n, 3) in a log are a reference; empty for wheel odometry.

    The log says so (NEFF lines, frames of a bag), or the poses come back to places within centimetres: wheels drift.
    """
    if isinstance(log, ScanAccess) and (why := log.why_estimated()):
        return why
    errors = _errors_of_visits(log, poses)
    n_exact = sum(metres < _EXACT and radians < _EXACT_RAD for metres, radians in errors)
    if len(errors) < _N_SURE or n_exact < _SHARE * len(errors):
        return ""
    return (
        f"they never drift: in {n_exact} of {len(errors)} places seen again after {_WAY:g} m and more they agree with "
        f"the scans to {_EXACT:g} m"
    )


def _errors_of_visits(log: Log, poses: Pose) -> list[tuple[float, float]]:
    """Return by how much the poses differ from sure matches of two visits of a place: metres and radians."""
    steps = np.nan_to_num(np.hypot(*np.diff(poses[:, :2], axis=0).T))
    way = np.concatenate(([0.0], np.cumsum(steps)))
    errors: list[tuple[float, float]] = []
    n_matched, last = 0, -_APART
    # in an order that takes visits from all over the log, and is the same each time
    for later in np.random.default_rng(0).permutation(np.flatnonzero(way > _WAY)).tolist():
        if n_matched == _N_VISITS or (n_matched == _N_SURE and not errors):
            break
        beside = np.flatnonzero(np.abs(poses[:, 0] - poses[later, 0]) < _NEAR)  # of few the rest is soon found
        difference = np.abs(poses[beside] - poses[later])
        apart = np.hypot(*difference[:, :2].T)
        is_visit = (way[later] - way[beside] > _WAY) & (np.abs(se2.wrap(difference[:, 2])) < _NEAR) & (apart < _NEAR)
        if not is_visit.any() or abs(later - last) < _APART:
            continue
        earlier = int(beside[is_visit][np.argmin(apart[is_visit])])
        n_matched, last = n_matched + 1, later
        if (motion := sure_motion(log[earlier], log[later])) is not None:
            off = motion - se2.between(poses[earlier], poses[later])
            errors.append((math.hypot(off[0], off[1]), abs(float(se2.wrap(off[2])))))
    return errors


@dataclass(frozen=True, eq=False, kw_only=True)
class Prior:
    """The motion prior of a log."""

    # (n, 3) float64 or None: pose of the sensor at each scan by wheels or gyroscope, without lag; None where it is
    # left out, or there is none
    poses: Pose | None = None
    sentence: str = ""  # whether it is used, and why; empty where the log has none


def choose_prior(
    log: Log, *, sense: RotationDirection | None = None, lag: float = 0.0, wanted: bool | None = None
) -> Prior:
    """Return the motion prior of a log, whose wheels lag by so many seconds; wanted: see :func:`prepare_log`.

    Raises InvalidArgumentError where it is wanted, and there is none, it turns against the scans, or SLAM made it.
    """
    found, poses = _poses_of(log, lag)
    leave_out = "leave odometry_prior=True out"
    if poses is None:
        none = f"{log.name} holds neither wheel odometry nor a gyroscope that could serve as motion prior: {leave_out}"
        return _left_out(wanted, none, "")
    if wanted is False:
        return Prior(sentence=f"left out: the {found} of the log, as odometry_prior=False asks")
    if found == "wheel odometry" and (why := why_reference(log, poses)):
        what = "are a reference and no motion prior"
        error = f"the poses in {log.name} {what}: {why}; {leave_out}"
        return _left_out(wanted, error, f"left out: the poses in the log {what}, {why}")
    if sense is not None and sense.is_reversed:
        turns = f"scans in {sense.n_reversed} of {sense.n_turns} sharp turns"
        helps = f"give clockwise=True if the sensor does, or {leave_out}"
        error = f"the {found} of {log.name} turns against its {turns}: {helps}"
        return _left_out(wanted, error, f"left out: the {found} of the log turns against the {turns}")
    if wanted:
        return Prior(poses=poses, sentence=f"used: the {found} of the log, as odometry_prior=True asks")
    agrees, how = compare_motion(log, poses)
    verb = "used" if agrees else "left out"
    return Prior(poses=poses if agrees else None, sentence=f"{verb}: the {found} of the log, which {how}")


def _left_out(wanted: bool | None, error: str, sentence: str) -> Prior:
    """Return a prior that is left out, or raise InvalidArgumentError where it is wanted."""
    if wanted:
        raise InvalidArgumentError(error)
    return Prior(sentence=sentence)


def _poses_of(log: Log, lag: float) -> tuple[str, Pose | None]:
    """Return what the motion is measured by, and the (n, 3) poses; the positions by a gyroscope are NaN."""
    if (odometry := log.odometry) is not None:
        return "wheel odometry", without_lag(odometry.stamps, odometry.poses, lag) if lag else odometry.poses
    turned = log.turned_by_gyro() if isinstance(log, ScanAccess) else None
    if turned is None:
        return "", None
    nowhere = np.full(turned.size, np.nan)
    return "gyroscope", np.column_stack([nowhere, nowhere, turned])


_N_STEPS, _N_TURNS = 150, 60  # steps that the bias is found from, and turns in which sweeps are straightened, at most
_MIN_STEPS, _MIN_TURNS = 20, 15
_SHARP = math.radians(4.0)  # turns of so much within a sweep bend it by more than a beam
_BIASED = math.radians(1.0)  # bias from which on a gyroscope is worse than the motion model, radians a second
CERTAIN = 4.0  # standard errors that a mean gain must be from zero


@dataclass(frozen=True, kw_only=True)
class Gyroscope:
    """What sure matches say of a gyroscope."""

    bias: float  # rate that it shows at rest, radians a second; 0 where too few steps are matched surely
    n_turns: int  # sharp turns in which sweeps were straightened by it
    gain: float  # mean score of matches of straightened sweeps, less that of the sweeps as they are
    standard_error: float  # of the gain; NaN with fewer than two turns

    @property
    def is_biased(self) -> bool:
        """Whether the bias is worth taking off."""
        return abs(self.bias) > _BIASED

    @property
    def straightens(self) -> bool:
        """Whether sweeps are bent on the turn, and straight once its turn is taken out."""
        return self.n_turns >= _MIN_TURNS and self.gain > CERTAIN * self.standard_error


def judge_gyroscope(log: Log, turned: Floats) -> Gyroscope:
    """Return what sure matches say of a gyroscope that turned by (n,) radians at each scan, NaN where unknown."""
    stamps = np.array([scan.stamp for scan in log])
    seconds = np.diff(stamps)
    rates = np.full(turned.size, np.nan)
    np.divide(np.diff(turned), seconds, out=rates[1:], where=seconds > 0.0)
    steps = np.unique(np.linspace(1, max(len(stamps) - 1, 1), _N_STEPS).astype(int)).tolist()
    biases = [
        float(rates[k] - se2.wrap(motion[2]) / seconds[k - 1])
        for k in steps
        if k < rates.size and math.isfinite(rates[k]) and (motion := sure_motion(log[k - 1], log[k])) is not None
    ]
    bias = float(np.median(biases)) if len(biases) >= _MIN_STEPS else 0.0
    gains = _gains(log, rates - bias, float(np.median(seconds)) if seconds.size else 0.0)
    gain, error = mean_and_error(gains)
    return Gyroscope(bias=bias, n_turns=len(gains), gain=gain, standard_error=error)


def mean_and_error(gains: Sequence[float]) -> tuple[float, float]:
    """Return the mean of some gains and its standard error; NaN where there are too few."""
    mean = float(np.mean(gains)) if gains else math.nan
    return mean, float(np.std(gains, ddof=1)) / math.sqrt(len(gains)) if len(gains) > 1 else math.nan


def straightened(scan: LaserScan, rate: float, seconds: float) -> LaserScan:
    """Return a scan without the turn during its sweep, which took so many seconds and ended at the stamp."""
    if not (math.isfinite(rate) and seconds > 0.0) or scan.time_increment > 0.0:
        return scan
    timed = replace(scan, time_increment=seconds / max(len(scan), 1))
    return replace(deskew(timed, (0.0, 0.0, rate)), stamp=scan.stamp, time_increment=0.0)


def _gains(log: Log, rates: Floats, seconds: float) -> list[float]:
    """Return by how much the matches over sharp turns score more once the sweeps are straightened."""
    turns = np.nan_to_num(np.abs(rates) * seconds)
    sharpest = [k for k in np.argsort(-turns)[:_N_TURNS].tolist() if turns[k] > _SHARP and k > 0]
    gains = []
    for k in sharpest:
        pair = (log[k - 1], log[k])
        if pair[0].time_increment > 0.0:
            return []
        straight = [straightened(scan, float(rates[i]), seconds) for i, scan in zip((k - 1, k), pair, strict=True)]
        gains.append(match(*straight).score - match(*pair).score)
    return [gain for gain in gains if math.isfinite(gain)]
