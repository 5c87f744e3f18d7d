"""Odometry: a stream of scans in, a trajectory out.

The only place that holds state. Its one verb is ``add(scan)``. Each scan is matched with a keyframe, so that a sensor
at rest does not drift; a new keyframe is made when the one in use is left behind. It closes no loops: SLAM does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.configs import as_config
from curvescan.errors import InvalidArgumentError
from curvescan.matchers import DEFAULT_METHOD
from curvescan.matchers.registry import Matcher, MatcherConfig, Method, find_matcher
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.motion import MotionModel
from curvescan.odometry.observation import Matching, Observation, Placement, Reference, State, step_motion
from curvescan.odometry.step import Step, StepOutcome
from curvescan.odometry.strategies import LOST_COVARIANCE, doubted, start, track
from curvescan.scan import LaserScan
from curvescan.types import Pose


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
        found = find_matcher(method, matcher, name="matcher")
        hint = "the configuration of the matcher is given as matcher="
        self._matching = Matching(
            method=method,
            matcher_config=matcher,
            matcher=found,
            config=as_config(config, OdometryConfig.of_method(method), hint=hint),
        )
        self._state = State(motion=MotionModel.at_start(self.config.motion))

    @property
    def method(self) -> str:
        """Name of the matcher."""
        return self._matching.method

    @property
    def config(self) -> OdometryConfig:
        """The odometry's configuration."""
        return self._matching.config

    @property
    def matcher(self) -> Matcher:
        """The matcher."""
        return self._matching.matcher

    def __repr__(self) -> str:
        return f"Odometry({self.method!r}, {self._state.n_scans:,} scans)"

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> Step:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan; the order of the calls is the order.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels, or another odometry, in a frame of their own: metres, metres,
            radians. NaN where it is unknown: (nan, nan, theta) from a gyro. Only its changes are used.

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
        wheels = None if odometry_pose is None else _as_odometry_pose(odometry_pose)
        clock, seconds = state.clock.ticked(scan.stamp)
        measured = state.motion.measured(wheels, state.last_motion) if self.config.is_filtered else None
        observation = Observation(
            scan=scan,
            state=state,
            matching=self._matching,
            seconds=seconds,
            wheels=measured,
            is_missed=wheels is not None and measured is None and state.motion.wheels is not None,
            deskewer=state.deskewer.ticked(scan),
        )
        placement = _place(observation)
        moved = step_motion(observation, placement.track)
        motion = placement.motion.advanced(wheels, observation.wheels is not None, moved)
        self._state = State(
            motion=motion,
            n_scans=observation.index + 1,
            track=placement.track,
            as_keyframe=placement.as_keyframe,
            keyframe=placement.keyframe,
            previous=_as_reference(observation, placement),
            clock=clock,
            deskewer=observation.deskewer,
            first=scan if observation.index == 0 else None,
            last_motion=moved,
            n_failed=placement.n_failed,
            outage=placement.outage,
        )
        watch.report()
        return _as_step(observation, placement, moved)


def _place(o: Observation) -> Placement:
    """Return where a scan is, and what it says on whether the sensor is still where it was tracked."""
    last = o.state.track
    return start(o) if last is None else doubted(o, last, track(o, last))


def _as_reference(o: Observation, placement: Placement) -> Reference | None:
    is_reference = placement.is_reference and o.matching.is_reference(placement.current)
    return Reference(placement.current, o.index) if is_reference else None


def _as_step(o: Observation, placement: Placement, moved: Pose) -> Step:
    here, fit = placement.track.pose_map_scan, placement.fit
    lost = LOST_COVARIANCE if placement.outcome is StepOutcome.LOST else np.zeros((3, 3))
    is_first = o.state.track is None
    return Step(
        index=o.index,
        stamp=o.scan.stamp,
        pose=here.pose,
        covariance=here.cov,
        pose_odom=here.pose,
        covariance_odom=here.cov,
        motion=moved,
        motion_covariance=np.zeros((3, 3)) if is_first else placement.track.motion(o.seconds).cov + lost,
        outcome=placement.outcome,
        match=None if fit is None else fit.result,
        reference=placement.reference,
        is_prior_rejected=fit is not None and fit.is_prior_rejected,
    )


def _as_odometry_pose(odometry_pose: ArrayLike) -> Pose:
    try:
        pose = np.asarray(odometry_pose, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"odometry_pose must be three numbers [x, y, theta]: {error}") from error
    if pose.shape != (3,) or np.isinf(pose).any():
        raise InvalidArgumentError(
            "odometry_pose must be three numbers [x, y, theta], finite or NaN where it is unknown, "
            f"got {odometry_pose!r}"
        )
    return pose
