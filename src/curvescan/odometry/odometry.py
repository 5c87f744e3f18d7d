"""Odometry: a stream of scans in, a trajectory out.

The only place that holds state. Its one verb is ``add(scan)``. Each scan is matched with a keyframe, so that a sensor
at rest does not drift; a new keyframe is made when the one in use is left behind, unless the place is known from before.
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
from curvescan.odometry.deskewing import Deskewer
from curvescan.odometry.gating import GatedMatch, as_measurement, gate
from curvescan.odometry.keyframes import Keyframe, KeyframeGraph, Localization
from curvescan.odometry.motion_model import MotionModel
from curvescan.odometry.relocalization import find_loop_closure
from curvescan.odometry.step import OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse
from curvescan.types import Pose


class Odometry:
    """Where the sensor is, scan by scan.

    A scan is matched with the keyframe in use, near where the motion leads one to expect it. If that fails or leaves
    doubt, the scan before it is tried, then earlier keyframes without a guess; and where nothing matches, the expected
    motion is taken, and said to be. When the keyframe in use is left behind, earlier ones are asked whether the place is
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
    keyframes : Keys
        The keyframes in memory, each with its number in the stream and its pose.

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
        self._motion = MotionModel(self.config.motion)
        self.keyframes = KeyframeGraph(
            self.config.keyframes.max_keyframes, self.config.keyframes.variance_retained
        )
        self._fix: Localization | None = None
        self._last: PreparedScan | None = None  # the last scan, if it can be a reference
        self._deskewer = Deskewer()
        self._first: LaserScan | None = None
        self._n_searches = 0  # scans for which a known place is still looked for, after a failure

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> OdometryStep:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan; the order of the calls is the order.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels, or another odometry, in a frame of their own: metres, metres,
            radians. NaN where it does not tell: (nan, nan, theta) from a gyro. Only its changes are used.

        Returns
        -------
        OdometryStep
            Pose and covariance in the frame of the first scan, and how they came about.

        Raises
        ------
        InvalidArgumentError
            When `scan` is not a LaserScan or `odometry_pose` not a pose.
        """
        if not isinstance(scan, LaserScan):
            raise InvalidArgumentError(f"scan must be a LaserScan, got {type(scan).__name__}")
        motion = self._motion.predict(
            scan.stamp, None if odometry_pose is None else _as_odometry_pose(odometry_pose)
        )
        self._deskewer.tick(scan)
        current = self._prepare(
            self._deskewer.deskewed(scan, motion.pose) if self.config.deskew else scan
        )
        if self._fix is None:
            self._first = scan
            is_guess = not self.matcher.can_be_reference(current.features)
            keyframe = self.keyframes.add(current, self._n_scans, None, is_guess=is_guess)
            self._fix, found = (
                Localization(keyframe=keyframe, pose_keyframe_scan=identity()),
                _Placement(StepOutcome.STARTED),
            )
        else:
            self._fix, found, current = self._locate(scan, current, self._fix, motion)
        pose_map_scan = self._fix.pose_map_scan
        step = OdometryStep(
            index=self._n_scans,
            stamp=scan.stamp,
            pose=pose_map_scan.pose,
            covariance=pose_map_scan.cov,
            outcome=found.outcome,
            match=found.match,
            reference=found.reference,
        )
        self._last = current if current.matcher.can_be_reference(current.features) else None
        self._n_scans += 1
        return step

    def _locate(
        self, scan: LaserScan, current: PreparedScan, last: Localization, motion: UncertainPose
    ) -> tuple[Localization, _Placement, PreparedScan]:
        """Return where a scan is: by the keyframe in use, else by the scan before it, else as well as it can be told."""
        min_score = self.config.keyframes.min_score
        reference, origin, outcome = (
            last.keyframe.scan,
            last.pose_keyframe_scan,
            StepOutcome.MATCHED,
        )
        gated = self._match(reference, current, compose(origin, motion))
        before = self._last
        if not (before is None or before is reference or gated.is_confident(min_score)):
            second = self._match(before, current, motion)
            if second.is_better_than(gated, min_score):
                gated, outcome = second, StepOutcome.CHAINED
                reference, origin = before, identity()
        if not gated.is_accepted(self.config.keyframes.least_score):
            return *self._without_match(current, last, motion, gated.result), current
        keyframe = last.keyframe
        if outcome is StepOutcome.CHAINED:
            keyframe = self.keyframes.add(reference, self._n_scans - 1, last)
        gated, current = self._with_better_sweep(scan, current, keyframe, origin, motion, gated)
        keyframe.used = self._n_scans
        moved = compose(inverse(origin), as_measurement(gated.result))
        self._motion.update(
            fuse(motion, moved)[0],
            is_plausible=gated.is_plausible,
            is_fully_observed=gated.is_fully_observed,
        )
        localization = Localization(
            keyframe=keyframe,
            pose_keyframe_scan=gated.pose_keyframe_scan,
            is_measured=gated.is_fully_observed,
        )
        found = _Placement(outcome, gated.result, keyframe.index)
        is_due = self._is_leaving(localization, gated.result.score)
        if is_due or self._n_searches > 0:
            return *self._find_key(current, localization, found, is_due), current
        return localization, found, current

    def _with_better_sweep(
        self,
        scan: LaserScan,
        current: PreparedScan,
        keyframe: Keyframe,
        origin: UncertainPose,
        motion: UncertainPose,
        gated: GatedMatch,
    ) -> tuple[GatedMatch, PreparedScan]:
        """Return the match once more where it found a motion that deskews the sweep better than the expected one."""
        if not self.config.deskew or scan.time_increment == 0.0:
            return gated, current
        found = se2.between(origin.pose, gated.pose_keyframe_scan.pose)
        if not self._deskewer.is_worth_again(scan, motion.pose, found):
            return gated, current
        better = self._prepare(self._deskewer.deskewed(scan, found))
        if self._first is not None and self._n_scans == 1:  # its velocity was not known
            keyframe.scan = self._prepare(self._deskewer.deskewed(self._first, found))
        again = self._match(keyframe.scan, better, compose(origin, motion))
        return (again, better) if again.is_as_good_as(gated) else (gated, current)

    def _prepare(self, scan: LaserScan) -> PreparedScan:
        return prepare(scan, method=self.method, config=self.matcher_config)

    def _match(
        self, reference: PreparedScan, current: PreparedScan, expected: UncertainPose
    ) -> GatedMatch:
        result = self.matcher.match(reference.features, current.features, expected.pose)
        return gate(result, expected, self.config.motion)

    def _is_leaving(self, localization: Localization, score: float, share: float = 1.0) -> bool:
        """Return whether a scan is so far from the keyframe, or shares so little with it, that another is due."""
        keyframes, (x, y, theta) = (
            self.config.keyframes,
            localization.pose_keyframe_scan.pose.tolist(),
        )
        is_far = (
            math.hypot(x, y) >= share * keyframes.distance or abs(theta) >= share * keyframes.turn
        )
        return is_far or score < keyframes.min_score

    def _find_key(
        self, current: PreparedScan, localization: Localization, found: _Placement, is_due: bool
    ) -> tuple[Localization, _Placement]:
        """Return the fix by an earlier keyframe if one is known here; else the scan becomes a keyframe if one is due."""
        keyframes = self.config.keyframes
        turn = math.pi if self._n_searches > 0 else 1.5 * keyframes.turn
        self._n_searches = max(self._n_searches - 1, 0)
        known = find_loop_closure(current, localization, self.keyframes, keyframes, turn=turn)
        if known is not None:
            localization, result = known
            localization.keyframe.used = self._n_scans
            found, self._n_searches = (
                _Placement(StepOutcome.LOOP_CLOSED, result, localization.keyframe.index),
                0,
            )
            is_due = self._is_leaving(localization, result.score, 0.7)
        if is_due:
            localization = Localization(
                keyframe=self.keyframes.add(current, self._n_scans, localization),
                pose_keyframe_scan=identity(),
            )
        return localization, found

    def _without_match(
        self, current: PreparedScan, last: Localization, motion: UncertainPose, failed: MatchResult
    ) -> tuple[Localization, _Placement]:
        """Return where a scan is that neither the keyframe nor the scan before it shows."""
        keyframes = self.config.keyframes
        # anywhere around by sure matches, else where the motion leads by any that agree
        around, ahead = last.moved(self._motion.inflated(motion)), last.moved(motion)
        known = find_loop_closure(current, around, self.keyframes, keyframes, turn=math.pi)
        known = known or find_loop_closure(
            current, ahead, self.keyframes, keyframes, turn=math.pi, is_lost=True
        )
        if known is not None:
            localization, result = known
            localization.keyframe.used = self._n_scans
            self._motion.update(identity(), is_plausible=False, is_fully_observed=False)
            return localization, _Placement(
                StepOutcome.RELOCALIZED, result, localization.keyframe.index
            )
        self._n_searches = keyframes.max_searches
        if failed.ok:  # a match that was not believed: something did happen
            motion = self._motion.inflated(motion)
        motion, is_held = self._motion.predict_without_match(motion)
        localization = last.moved(motion)
        if self.matcher.can_be_reference(current.features):
            # a robot is never stuck on an old reference; but guesses must not push out what is known
            if last.keyframe.is_guess and last.keyframe.used == last.keyframe.index:
                self.keyframes.forget(last.keyframe)
            keyframe = self.keyframes.add(current, self._n_scans, localization, is_guess=True)
            localization = Localization(keyframe=keyframe, pose_keyframe_scan=identity())
        outcome = StepOutcome.HELD if is_held else StepOutcome.PREDICTED
        return localization, _Placement(outcome, failed, last.keyframe.index)


class _Placement(NamedTuple):
    """How a scan was found: what OdometryStep tells beside the pose."""

    outcome: StepOutcome
    match: MatchResult | None = None
    reference: int | None = None


def _as_odometry_pose(odometry_pose: ArrayLike) -> Pose:
    try:
        pose = np.asarray(odometry_pose, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"odometry_pose must be three numbers [x, y, theta]: {error}"
        ) from error
    if pose.shape != (3,) or np.isinf(pose).any():
        raise InvalidArgumentError(
            "odometry_pose must be three numbers [x, y, theta], finite or NaN where the odometry does not tell, "
            f"got {odometry_pose!r}"
        )
    return pose
