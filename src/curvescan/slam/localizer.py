"""Localizer: where a sensor is in a saved map, with no guess, and from then on.

Until the sensor is found, each scan is looked up in the place index and matched with the keyframes most like it; two of them must put it
in one place, or the motion since an earlier find must confirm a single one. Then the odometry leads, and keyframes around correct it; where
several of them that should be seen do not match any more, the sensor has been carried away and is looked for again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import as_config
from curvescan.matchers import DEFAULT_METHOD, PreparedScan
from curvescan.matchers.registry import MatcherConfig
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.overlap import foretold_overlap, range_profile
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.relative import between_steps
from curvescan.types import Cov, Pose

_UNMEASURED = (StepOutcome.PREDICTED, StepOutcome.HELD, StepOutcome.LOST)


class LocalizerOutcome(Enum):
    """How a scan got its pose in the map; the value is a sentence for people."""

    SEARCHING = "Not found in the map yet."
    FOUND = "Found without a guess: keyframes agree where it is."
    TRACKED = "Matched with keyframes around."
    PREDICTED = "Carried on by the odometry from the last scan that was matched with the map."


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalizerStep:
    """Where the sensor was at one scan.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor in the frame ``map``: metres, metres, radians; NaN while it is searched for.
    covariance : (3, 3) float64
        Covariance of the pose; NaN while it is searched for.
    pose_odom : (3,) float64
        Pose by the odometry alone, frame of the first scan.
    covariance_odom : (3, 3) float64
        Covariance of `pose_odom`.
    motion : (3,) float64
        Pose of the sensor seen from where it was at the previous scan, without any leap; see :class:`OdometryStep`.
    motion_covariance : (3, 3) float64
        Covariance of the motion.
    outcome : LocalizerOutcome
        How it was found.
    keyframe : int
        Keyframe of the map that it was matched with; -1 where none was.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    pose_odom: Pose
    covariance_odom: Cov
    motion: Pose
    motion_covariance: Cov
    outcome: LocalizerOutcome
    keyframe: int

    @property
    def ok(self) -> bool:
        """Whether the pose is known."""
        return self.outcome is not LocalizerOutcome.SEARCHING


@dataclass(frozen=True, eq=False, kw_only=True)
class Hit:
    """A match of a scan with a keyframe of the map: where it puts the scan, and how well it explains it."""

    keyframe: int
    here: UncertainPose
    score: float


class Localizer:
    """Finds and follows a sensor in a map.

    Parameters
    ----------
    slam_map : SlamMap
        The map; it is not changed.
    method : str
        Name of the matcher.
    matcher : dataclass, mapping or None
        Its configuration.
    config : SlamConfig or None
        None for the defaults.
    n_tried : int
        Keyframes that a scan is matched with while the sensor is searched for.
    sure_score : float
        Least score of a match while it is searched for, in [0, 1].
    """

    def __init__(
        self,
        slam_map: SlamMap,
        *,
        method: str = DEFAULT_METHOD,
        matcher: MatcherConfig | None = None,
        config: SlamConfig | Mapping[str, Any] | None = None,
        n_tried: int = 12,
        sure_score: float = 0.35,
    ) -> None:
        self.map = slam_map
        hint = "the configuration of the matcher is given as matcher="
        self.config = as_config(config, SlamConfig(), hint=hint)
        self.odometry = Odometry(method, matcher=matcher, config=self.config.odometry)
        self._n_tried = n_tried
        self._sure_score = sure_score
        self._keyframes = Keyframes(
            method, matcher, max(self.config.keyframes.n_prepared, len(slam_map))
        )
        for k, scan in enumerate(slam_map.scans):
            self._keyframes.add(scan, int(slam_map.indices[k]), int(slam_map.sessions[k]))
        self._here: UncertainPose | None = None  # at the last scan matched with the map
        self._anchor: OdometryStep | None = None  # the odometry's step of that scan
        self._hint: tuple[Hit, OdometryStep] | None = None  # a single find that waits for a second
        self._n_missed = 0
        self._n_lost = 0

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> LocalizerStep:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels; see :meth:`Odometry.add`.
        """
        step = self.odometry.add(scan, odometry_pose)
        self._n_lost = self._n_lost + 1 if step.outcome in _UNMEASURED else 0
        if self._n_lost >= self.config.keyframes.n_lost:
            self._here = None
        if self._here is None or self._anchor is None:
            return self._search(scan, step)
        return self._track(scan, step, self._here, self._anchor)

    def locate(self, scan: LaserScan) -> tuple[Hit, ...]:
        """Return where one scan alone may be in the map: matches that agree, the best first; none where too few do.

        Parameters
        ----------
        scan : LaserScan
            Any scan, also one of another session.
        """
        hits = self._hits(self._keyframes.prepare(scan))
        return self._agreeing(hits)

    def _hits(self, current: PreparedScan) -> list[Hit]:
        similar = self._keyframes.index.most_similar(
            self._keyframes.signature(current), self._n_tried
        )
        hits = [self._hit(k, current, None) for k in similar.tolist()]
        return [hit for hit in hits if hit is not None and hit.score >= self._sure_score]

    def _hit(self, k: int, current: PreparedScan, guess: Pose | None) -> Hit | None:
        """Return where a match with a keyframe puts a scan; None where it fails or leaves a direction open."""
        reference = self._keyframes.prepared(k)
        result = current.matcher.match(reference.features, current.features, guess)
        if not result.ok or result.degenerate_direction is not None:
            return None
        noise = self.config.noise
        keyframe = UncertainPose(self.map.poses[k], 4.0 * noise.floor)
        found = UncertainPose(result.pose, result.covariance + noise.floor)
        return Hit(keyframe=k, here=compose(keyframe, found), score=result.score)

    def _agreeing(self, hits: list[Hit]) -> tuple[Hit, ...]:
        """Return the largest set of hits that put the scan where its best does, if it is clearly the largest."""
        gate = self.config.closures.gate
        groups: list[list[Hit]] = []
        for hit in sorted(hits, key=lambda h: -h.score):
            for group in groups:
                if fuse(group[0].here, hit.here)[1] < gate:
                    group.append(hit)
                    break
            else:
                groups.append([hit])
        groups.sort(key=len, reverse=True)
        if not groups or len(groups[0]) < 2:
            return ()
        if len(groups) > 1 and len(groups[0]) < self.config.closures.margin * len(groups[1]):
            return ()
        return tuple(groups[0])

    def _search(self, scan: LaserScan, step: OdometryStep) -> LocalizerStep:
        hits = self._hits(self._keyframes.prepare(scan))
        agreed = self._agreeing(hits)
        found = agreed[0] if agreed else None
        if found is None and hits:
            found = self._confirmed(hits, step)
        if found is None:
            nothing = np.full(3, np.nan)
            unknown = UncertainPose(nothing, np.full((3, 3), np.nan))
            return _step(step, unknown, LocalizerOutcome.SEARCHING, -1)
        here = found.here
        for other in agreed[1:]:
            here, _ = fuse(here, other.here)
        return self._take(step, here, LocalizerOutcome.FOUND, found.keyframe)

    def _confirmed(self, hits: list[Hit], step: OdometryStep) -> Hit | None:
        """Return the best hit if it lies where an earlier one and the motion since have the sensor."""
        best = max(hits, key=lambda h: h.score)
        before, self._hint = self._hint, (best, step)
        if before is None:
            return None
        earlier, then = before
        moved = between_steps(then, step)
        if np.hypot(moved.pose[0], moved.pose[1]) < 0.1 and abs(moved.pose[2]) < 0.1:
            self._hint = before  # the same view again adds nothing
            return None
        if earlier.keyframe == best.keyframe:
            return None
        expected = compose(earlier.here, moved)
        return best if fuse(expected, best.here)[1] < self.config.closures.gate else None

    def _track(
        self, scan: LaserScan, step: OdometryStep, here: UncertainPose, anchor: OdometryStep
    ) -> LocalizerStep:
        moved = between_steps(anchor, step)
        expected = compose(here, moved)
        rules, (x, y, theta) = self.config.keyframes, moved.pose.tolist()
        if np.hypot(x, y) < 0.5 * rules.distance and abs(theta) < 0.5 * rules.turn:
            return _step(step, expected, LocalizerOutcome.PREDICTED, -1)
        current = self._keyframes.prepare(scan)
        hit, is_due = self._matched_around(current, scan, expected)
        if hit is not None:
            fused, _ = fuse(expected, hit.here)
            return self._take(step, fused, LocalizerOutcome.TRACKED, hit.keyframe)
        self._n_missed += is_due
        if self._n_missed >= self.config.keyframes.n_lost:
            self._here = self._hint = None
            return self._search(scan, step)
        return _step(step, expected, LocalizerOutcome.PREDICTED, -1)

    def _matched_around(
        self, current: PreparedScan, scan: LaserScan, expected: UncertainPose
    ) -> tuple[Hit | None, bool]:
        """Return a match with a keyframe that should show the scan, and whether there is any that should."""
        rules = self.config.closures
        relative = se2.between(self.map.poses, expected.pose)
        near = np.flatnonzero(np.hypot(relative[:, 0], relative[:, 1]) < rules.reach)
        overlap = foretold_overlap(
            self._keyframes.profiles, near, relative[near], range_profile(scan)
        )
        near, overlap = near[overlap >= rules.min_overlap], overlap[overlap >= rules.min_overlap]
        near = near[np.argsort(-overlap, kind="stable")][: rules.n_certain]
        vague = UncertainPose(
            expected.pose,
            self.config.noise.drift**2 * expected.cov + 4.0 * self.config.noise.floor,
        )
        for k in near.tolist():
            hit = self._hit(k, current, relative[k])
            if hit is None or hit.score < rules.min_score:
                continue
            if fuse(vague, hit.here)[1] < rules.gate:
                return hit, True
        return None, bool(len(near))

    def _take(
        self, step: OdometryStep, here: UncertainPose, outcome: LocalizerOutcome, keyframe: int
    ) -> LocalizerStep:
        self._here, self._anchor, self._hint = here, step, None
        self._n_missed = 0
        return _step(step, here, outcome, keyframe)


def _step(
    step: OdometryStep, here: UncertainPose, outcome: LocalizerOutcome, keyframe: int
) -> LocalizerStep:
    return LocalizerStep(
        index=step.index,
        stamp=step.stamp,
        pose=here.pose,
        covariance=here.cov,
        pose_odom=step.pose,
        covariance_odom=step.covariance,
        motion=step.motion,
        motion_covariance=step.motion_covariance,
        outcome=outcome,
        keyframe=keyframe,
    )
