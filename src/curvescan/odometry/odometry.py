"""Odometry: a stream of scans in, a trajectory out.

The only place that holds state. Its one verb is ``add(scan)``. Each scan is matched with a key scan, so that a sensor
at rest does not drift; a new key scan is made when the one in use is left behind, unless the place is known from before.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.matchers import DEFAULT_METHOD, MatchResult, PreparedScan, prepare
from curvescan.matchers.registry import find_matcher
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.deskewing import Sweeps
from curvescan.odometry.gating import Attempt, as_found, judge
from curvescan.odometry.keyframes import Fix, Key, Keys
from curvescan.odometry.motion_model import Motion
from curvescan.odometry.relocalization import find_known_place
from curvescan.odometry.step import OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse
from curvescan.types import Pose


class Odometry:
    """Where the sensor is, scan by scan.

    A scan is matched with the key scan in use, near where the motion leads one to expect it. If that fails or leaves
    doubt, the scan before it is tried, then earlier key scans without a guess; and where nothing matches, the expected
    motion is taken, and said to be. When the key scan in use is left behind, earlier ones are asked whether the place is
    known, and if it is not, the scan becomes the next one.

    Parameters
    ----------
    method : str
        Name of the matcher.
    matcher_config : object or None
        The matcher's configuration; None for its defaults.
    config : OdometryConfig or None
        None for what suits the method: see :meth:`OdometryConfig.of_method`.

    Attributes
    ----------
    keys : Keys
        The key scans in memory, each with its number in the stream and its pose.

    Raises
    ------
    InvalidArgumentError
        When the method is unknown or the config is another method's.
    """

    def __init__(
        self,
        method: str = DEFAULT_METHOD,
        *,
        matcher_config: object | None = None,
        config: OdometryConfig | None = None,
    ) -> None:
        self.method = method
        self.matcher_config = matcher_config
        self.config = config or OdometryConfig.of_method(method)
        self.matcher = find_matcher(method, matcher_config)
        self._n_scans = 0
        self._motion = Motion(self.config.motion)
        self.keys = Keys(self.config.keys.max_keys, self.config.keys.kept)
        self._fix: Fix | None = None
        self._last: PreparedScan | None = None  # the last scan, if it can be a reference
        self._sweeps = Sweeps()
        self._first: LaserScan | None = None
        self._n_searches = 0  # scans for which a known place is still looked for, after a failure

    def add(self, scan: LaserScan, wheels: ArrayLike | None = None) -> OdometryStep:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan; the order of the calls is the order.
        wheels : (3,) array_like or None
            Pose of the sensor at this scan by its wheels, or another odometry, in a frame of their own: metres, metres,
            radians. NaN where it does not tell: (nan, nan, theta) from a gyro. Only its changes are used.

        Returns
        -------
        OdometryStep
            Pose and covariance in the frame of the first scan, and how they came about.

        Raises
        ------
        InvalidArgumentError
            When `scan` is not a LaserScan or `wheels` not a pose.
        """
        if not isinstance(scan, LaserScan):
            raise InvalidArgumentError(f"scan must be a LaserScan, got {type(scan).__name__}")
        motion = self._motion.expect(scan.stamp, None if wheels is None else _as_wheels(wheels))
        self._sweeps.tick(scan)
        current = self._prepare(
            self._sweeps.deskewed(scan, motion.pose) if self.config.deskew else scan
        )
        if self._fix is None:
            self._first = scan
            is_guess = not self.matcher.can_be_reference(current.features)
            key = self.keys.add(current, self._n_scans, None, is_guess=is_guess)
            self._fix, found = Fix(key=key, seen=identity()), _Found(StepOutcome.STARTED)
        else:
            self._fix, found, current = self._locate(scan, current, self._fix, motion)
        world = self._fix.world
        step = OdometryStep(
            index=self._n_scans,
            stamp=scan.stamp,
            pose=world.pose,
            covariance=world.cov,
            outcome=found.outcome,
            match=found.match,
            reference=found.reference,
        )
        self._last = current if current.matcher.can_be_reference(current.features) else None
        self._n_scans += 1
        return step

    def _locate(
        self, scan: LaserScan, current: PreparedScan, last: Fix, motion: UncertainPose
    ) -> tuple[Fix, _Found, PreparedScan]:
        """Return where a scan is: by the key scan in use, else by the scan before it, else as well as it can be told."""
        min_score = self.config.keys.min_score
        reference, origin, outcome = last.key.scan, last.seen, StepOutcome.MATCHED
        attempt = self._attempt(reference, current, compose(origin, motion))
        before = self._last
        if not (before is None or before is reference or attempt.is_sure(min_score)):
            second = self._attempt(before, current, motion)
            if second.is_surer_than(attempt, min_score):
                attempt, outcome = second, StepOutcome.CHAINED
                reference, origin = before, identity()
        if not attempt.is_believed(self.config.keys.least_score):
            return *self._do_without(current, last, motion, attempt.result), current
        key = last.key
        if outcome is StepOutcome.CHAINED:
            key = self.keys.add(reference, self._n_scans - 1, last)
        attempt, current = self._with_better_sweep(scan, current, key, origin, motion, attempt)
        key.used = self._n_scans
        moved = compose(inverse(origin), as_found(attempt.result))
        self._motion.tell(
            fuse(motion, moved)[0], is_plausible=attempt.is_plausible, is_clear=attempt.is_clear
        )
        fix = Fix(key=key, seen=attempt.seen, is_measured=attempt.is_clear)
        found = _Found(outcome, attempt.result, key.index)
        is_due = self._is_leaving(fix, attempt.result.score)
        if is_due or self._n_searches > 0:
            return *self._find_key(current, fix, found, is_due), current
        return fix, found, current

    def _with_better_sweep(
        self,
        scan: LaserScan,
        current: PreparedScan,
        key: Key,
        origin: UncertainPose,
        motion: UncertainPose,
        attempt: Attempt,
    ) -> tuple[Attempt, PreparedScan]:
        """Return the match once more where it found a motion that deskews the sweep better than the expected one."""
        if not self.config.deskew or scan.time_increment == 0.0:
            return attempt, current
        found = se2.between(origin.pose, attempt.seen.pose)
        if not self._sweeps.is_worth_again(scan, motion.pose, found):
            return attempt, current
        better = self._prepare(self._sweeps.deskewed(scan, found))
        if self._first is not None and self._n_scans == 1:  # its velocity was not known
            key.scan = self._prepare(self._sweeps.deskewed(self._first, found))
        again = self._attempt(key.scan, better, compose(origin, motion))
        return (again, better) if again.stands_like(attempt) else (attempt, current)

    def _prepare(self, scan: LaserScan) -> PreparedScan:
        return prepare(scan, method=self.method, config=self.matcher_config)

    def _attempt(
        self, reference: PreparedScan, current: PreparedScan, expected: UncertainPose
    ) -> Attempt:
        result = self.matcher.match(reference.features, current.features, expected.pose)
        return judge(result, expected, self.config.motion)

    def _is_leaving(self, fix: Fix, score: float, share: float = 1.0) -> bool:
        """Return whether a scan is so far from the key scan, or shares so little with it, that another is due."""
        keys, (x, y, theta) = self.config.keys, fix.seen.pose.tolist()
        is_far = math.hypot(x, y) >= share * keys.distance or abs(theta) >= share * keys.turn
        return is_far or score < keys.min_score

    def _find_key(
        self, current: PreparedScan, fix: Fix, found: _Found, is_due: bool
    ) -> tuple[Fix, _Found]:
        """Return the fix by an earlier key scan if one is known here; else the scan becomes a key scan if one is due."""
        keys = self.config.keys
        turn = math.pi if self._n_searches > 0 else 1.5 * keys.turn
        self._n_searches = max(self._n_searches - 1, 0)
        known = find_known_place(current, fix, self.keys, keys, turn=turn)
        if known is not None:
            fix, result = known
            fix.key.used = self._n_scans
            found, self._n_searches = _Found(StepOutcome.REVISITED, result, fix.key.index), 0
            is_due = self._is_leaving(fix, result.score, 0.7)
        if is_due:
            fix = Fix(key=self.keys.add(current, self._n_scans, fix), seen=identity())
        return fix, found

    def _do_without(
        self, current: PreparedScan, last: Fix, motion: UncertainPose, failed: MatchResult
    ) -> tuple[Fix, _Found]:
        """Return where a scan is that neither the key scan nor the scan before it shows."""
        keys = self.config.keys
        # anywhere around by sure matches, else where the motion leads by any that agree
        around, ahead = last.moved(self._motion.vaguely(motion)), last.moved(motion)
        known = find_known_place(current, around, self.keys, keys, turn=math.pi)
        known = known or find_known_place(
            current, ahead, self.keys, keys, turn=math.pi, is_lost=True
        )
        if known is not None:
            fix, result = known
            fix.key.used = self._n_scans
            self._motion.tell(identity(), is_plausible=False, is_clear=False)
            return fix, _Found(StepOutcome.RECOVERED, result, fix.key.index)
        self._n_searches = keys.max_searches
        if failed.ok:  # a match that was not believed: something did happen
            motion = self._motion.vaguely(motion)
        motion, is_held = self._motion.without_match(motion)
        fix = last.moved(motion)
        if self.matcher.can_be_reference(current.features):
            # a robot is never stuck on an old reference; but guesses must not push out what is known
            if last.key.is_guess and last.key.used == last.key.index:
                self.keys.forget(last.key)
            key = self.keys.add(current, self._n_scans, fix, is_guess=True)
            fix = Fix(key=key, seen=identity())
        outcome = StepOutcome.HELD if is_held else StepOutcome.PREDICTED
        return fix, _Found(outcome, failed, last.key.index)


class _Found(NamedTuple):
    """How a scan was found: what OdometryStep tells beside the pose."""

    outcome: StepOutcome
    match: MatchResult | None = None
    reference: int | None = None


def _as_wheels(wheels: ArrayLike) -> Pose:
    try:
        pose = np.asarray(wheels, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"wheels must be three numbers [x, y, theta]: {error}"
        ) from error
    if pose.shape != (3,) or np.isinf(pose).any():
        raise InvalidArgumentError(
            "wheels must be three numbers [x, y, theta], finite or NaN where the wheels do not tell, "
            f"got {wheels!r}"
        )
    return pose
