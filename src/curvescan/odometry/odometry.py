"""Odometry: a stream of scans in, a trajectory out.

The only place that holds state. Its one verb is ``add(scan)``. Each scan is matched with a keyframe, so that a sensor
at rest does not drift; a new keyframe is made when the one in use is left behind. It closes no loops: SLAM does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.configs import as_config, counted
from curvescan.errors import InvalidArgumentError
from curvescan.matchers import DEFAULT_METHOD
from curvescan.matchers.registry import MatcherConfig, Method, find_matcher
from curvescan.odometry.config import MATCHER_HINT, OdometryConfig
from curvescan.odometry.measurement import Matching
from curvescan.odometry.motion_model import MotionModel
from curvescan.odometry.observation import Observation, Placement, State
from curvescan.odometry.step import Step, StepOutcome
from curvescan.odometry.strategies import place
from curvescan.scan import LaserScan, as_odometry_pose


class Odometry:
    """Where the sensor is, scan by scan.

    A scan is matched with the keyframe in use, near where it is expected. If that fails or leaves doubt, the previous
    scan is tried, then those in use before the last failure; where nothing matches, the expected motion is taken, and
    the outcome says so. When the keyframe in use is left behind, the scan becomes the next one. No loop is closed: the
    trajectory is continuous and drifts. :class:`curvescan.Slam` closes loops.

    Parameters
    ----------
    method : str
        Name of the matcher.
    config : OdometryConfig, mapping or None
        Configuration of the odometry, or a mapping of the fields that differ; None for what suits the method: see
        :meth:`OdometryConfig.of_method`. In every call ``config=`` configures what is called.
    matcher : dataclass, mapping or None
        Configuration of the matcher within: what ``config=`` is for :func:`curvescan.match`.

    Raises
    ------
    InvalidArgumentError
        When the method is unknown, or a configuration is of another class or has an unknown key.
    """

    def __init__(
        self,
        method: Method | str = DEFAULT_METHOD,
        *,
        config: OdometryConfig | Mapping[str, Any] | None = None,
        matcher: MatcherConfig | None = None,
    ) -> None:
        self.method = method
        self.config = as_config(config, OdometryConfig.of_method(method), hint=MATCHER_HINT)
        self.matcher = find_matcher(method, matcher, name="matcher")
        self._matching = Matching(matcher=self.matcher, config=self.config)
        self._state = State(motion=MotionModel.at_start(self.config.motion))

    def __repr__(self) -> str:
        return f"Odometry({self.method!r}, {counted(self._state.n_scans, 'scan')})"

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> Step:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan; the order of the calls is the order.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels, or another odometry, in a frame of their own: metres, metres,
            radians. NaN where it is unknown: (nan, nan, theta) from a gyro. Only its changes are used. None for
            ``scan.odometry``.

        Returns
        -------
        Step
            Pose and covariance in the frame of the first scan, and how they came about.

        Raises
        ------
        InvalidArgumentError
            When `scan` is not a LaserScan or `odometry_pose` not a pose.
        """
        if not isinstance(scan, LaserScan):
            raise InvalidArgumentError(f"scan must be a LaserScan, got {type(scan).__name__}")
        state = self._state
        pose = scan.odometry if odometry_pose is None else as_odometry_pose(odometry_pose, "odometry_pose")
        observation = Observation(
            scan=scan,
            prediction=state.motion.predict(scan.stamp, pose, scan.scan_time),
            state=state,
            matching=self._matching,
        )
        placement = place(observation)
        self._commit(observation, placement)
        watch.report()
        return _as_step(observation, placement)

    def _commit(self, observation: Observation, placement: Placement) -> None:
        """Take up what was found: the one place where anything changes."""
        before, scan = self._state, placement.current
        is_reference = placement.is_reference and self.matcher.can_be_reference(scan.features)
        older, last = before.older, before.localization
        if placement.outcome is StepOutcome.LOST:
            older = None
        elif last is not None and before.gap is None and placement.localization.keyframe is not last.keyframe:
            older = last.keyframe
        self._state = State(
            motion=placement.motion,
            n_scans=before.n_scans + 1,
            localization=placement.localization,
            previous=scan if is_reference else None,
            older=older,
            first=observation.scan if before.n_scans == 0 else None,
            gap=placement.gap,
            score=math.nan if placement.match is None else placement.match.score,
        )


def _as_step(observation: Observation, placement: Placement) -> Step:
    pose_map_scan = placement.localization.pose_map_scan
    is_driven = observation.prediction.is_measured and not placement.is_prior_rejected
    return Step(
        index=observation.index,
        stamp=observation.scan.stamp,
        pose=pose_map_scan.pose,
        covariance=pose_map_scan.covariance,
        # their own: who changes what is returned changes nothing here
        pose_odom=pose_map_scan.pose.copy(),
        covariance_odom=pose_map_scan.covariance.copy(),
        motion=placement.step_motion.pose.copy(),
        motion_covariance=placement.step_motion.covariance.copy(),
        seconds=observation.prediction.deskewer.seconds,
        outcome=placement.outcome,
        match=placement.match,
        reference=placement.reference,
        is_prior_rejected=placement.is_prior_rejected,
        is_unsettled=placement.gap is not None,
        wheel_slip=placement.motion.wheels.slip if is_driven else math.nan,
    )
