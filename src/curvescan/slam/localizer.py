"""Localizer: where a sensor is in a saved map, with no guess, and from then on.

Until the sensor is found, each scan is looked up in the place index and matched with the keyframes most like it; two of them must put it
in one place, or the motion since an earlier find must confirm a single one. Then the odometry leads, and keyframes around correct it. Where
the odometry breaks, every scan is held against the map, and found elsewhere if keyframes there agree; where several scans in a row match no
keyframe that should show them, the sensor has been carried away and is looked for again.
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
from curvescan.odometry.measurement import as_measurement
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import is_confident
from curvescan.slam.loops.overlap import foretold_overlap, range_profile
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.relative import between_steps
from curvescan.types import Cov, Floats, Pose

_ONE_VIEW = 0.65
"""Support that one scan alone needs. On simulated floors and on Intel matches of other places had scores up to 0.48."""

_SEVERAL_VIEWS = 1.2
"""Support that scans of several views need together."""

_SECOND_KEYFRAME = 0.15
"""What a second keyframe that agrees adds to the best score of a place: it sees much the same."""

_TORN_SCORE = 0.5
"""Least score of a match where the sensor is expected, once the odometry broke: with a guess other places match by up to 0.3."""

_FADING = 0.8
"""Share of the support of a place that is left at the next view."""

_LEAST_SUPPORT = 0.1
"""A place with less is given up."""

_CLEARLY = 1.4
"""The place of most support has so many times that of the next."""

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


def _support(group: tuple[Hit, ...]) -> float:
    """Return how much one view of the map speaks for a place: keyframes of one place are not independent."""
    return group[0].score + (_SECOND_KEYFRAME if len(group) > 1 else 0.0)


def _winner(support: Floats, least: float) -> int | None:
    """Return the place of most support, if it is enough and clearly more than that of any other."""
    if len(support) == 0:
        return None
    order = np.argsort(-support, kind="stable")
    best = int(order[0])
    if support[best] < least:
        return None
    if len(order) > 1 and support[best] < _CLEARLY * support[order[1]]:
        return None
    return best


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
    """

    def __init__(
        self,
        slam_map: SlamMap,
        *,
        method: str = DEFAULT_METHOD,
        matcher: MatcherConfig | None = None,
        config: SlamConfig | Mapping[str, Any] | None = None,
        n_tried: int = 12,
    ) -> None:
        self.map = slam_map
        hint = "the configuration of the matcher is given as matcher="
        self.config = as_config(config, SlamConfig(), hint=hint)
        self._method, self._matcher = method, matcher
        self._n_tried = n_tried
        self._keyframes = Keyframes(
            method, matcher, max(self.config.keyframes.n_prepared, len(slam_map))
        )
        for k, scan in enumerate(slam_map.scans):
            self._keyframes.add(scan, int(slam_map.indices[k]), int(slam_map.sessions[k]))
        self.reset()

    def reset(self) -> None:
        """Forget where the sensor is: the next scan is the first of another log."""
        self.odometry = Odometry(self._method, matcher=self._matcher, config=self.config.odometry)
        self._here: UncertainPose | None = None  # at the last scan matched with the map
        self._anchor: OdometryStep | None = None  # the odometry's step of that scan
        # where the sensor may be: support, a hit and the odometry's step at it
        self._places: list[tuple[float, Hit, OdometryStep]] = []
        self._view: OdometryStep | None = None  # the last step that added support
        self._n_missed = 0  # scans in a row that should have matched the map
        self._n_unmatched = 0  # and all that did not, also where no keyframe shows the place
        self._n_lost = 0
        self._is_torn = False  # whether a motion since then was not measured, or is in doubt

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
        is_unmeasured = step.outcome in _UNMEASURED
        self._n_lost = self._n_lost + 1 if is_unmeasured else 0
        is_doubtful = step.match is not None and not is_confident(step.match, self.config)
        self._is_torn |= is_unmeasured or is_doubtful
        if step.outcome is StepOutcome.LOST:
            self._here = None
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
        return [hit for hit in hits if hit is not None]

    def _hit(self, k: int, current: PreparedScan, guess: Pose | None) -> Hit | None:
        """Return where a match with a keyframe puts a scan; None where it fails or is too likely to be wrong.

        Without a guess a match that leaves a direction open is none either.
        """
        reference = self._keyframes.prepared(k)
        result = current.matcher.match(reference.features, current.features, guess)
        if not result.ok or not is_confident(result, self.config):
            return None
        if guess is None and result.degenerate_direction is not None:
            return None
        noise = self.config.noise
        keyframe = UncertainPose(self.map.poses[k], 4.0 * noise.floor)
        measured = as_measurement(result)
        found = UncertainPose(measured.pose, measured.cov + noise.floor)
        return Hit(keyframe=k, here=compose(keyframe, found), score=result.score)

    def _groups(self, hits: list[Hit]) -> list[tuple[Hit, ...]]:
        """Return hits by where they put the scan, the best of each first, the place of the best first."""
        gate = self.config.closures.gate
        groups: list[list[Hit]] = []
        for hit in sorted(hits, key=lambda h: -h.score):
            for group in groups:
                if fuse(group[0].here, hit.here)[1] < gate:
                    group.append(hit)
                    break
            else:
                groups.append([hit])
        return [tuple(group) for group in groups]

    def _agreeing(self, hits: list[Hit]) -> tuple[Hit, ...]:
        """Return the hits that alone are evidence enough of where the scan was taken."""
        groups = self._groups(hits)
        support = np.array([_support(group) for group in groups])
        winner = _winner(support, _ONE_VIEW)
        return () if winner is None else groups[winner]

    def _search(self, scan: LaserScan, step: OdometryStep) -> LocalizerStep:
        hits = self._hits(self._keyframes.prepare(scan))
        agreed = self._agreeing(hits)
        found = agreed[0] if agreed else self._confirmed(hits, step)
        if found is None:
            nothing = np.full(3, np.nan)
            unknown = UncertainPose(nothing, np.full((3, 3), np.nan))
            return _step(step, unknown, LocalizerOutcome.SEARCHING, -1)
        return self._take(step, found.here, LocalizerOutcome.FOUND, found.keyframe)

    def _confirmed(self, hits: list[Hit], step: OdometryStep) -> Hit | None:
        """Return a hit that lies where earlier ones and the motion since have the sensor, if they are evidence enough."""
        if self._is_torn:  # nothing says how earlier hits lie to this scan
            self._places, self._is_torn = [], False
        if self._places:
            rules, (x, y, theta) = self.config.keyframes, self._since_view(step).tolist()
            if np.hypot(x, y) < 0.5 * rules.distance and abs(theta) < 0.5 * rules.turn:
                return None  # the same view again adds nothing
        elif not hits:
            return None
        places = [(_support(group), group[0], step) for group in self._groups(hits)]
        for support, earlier, then in self._places:
            expected = compose(earlier.here, between_steps(then, step))
            for n, (of_view, hit, now) in enumerate(places):
                if now is step and fuse(expected, hit.here)[1] < self.config.closures.gate:
                    places[n] = (_FADING * support + of_view, hit, now)
                    break
            else:
                places.append((_FADING * support, earlier, then))
        self._places = [place for place in places if place[0] > _LEAST_SUPPORT]
        self._view = step
        winner = _winner(np.array([place[0] for place in self._places]), _SEVERAL_VIEWS)
        if winner is None or self._places[winner][2] is not step:
            return None
        return self._places[winner][1]

    def _since_view(self, step: OdometryStep) -> Pose:
        assert self._view is not None, "a place was noted at some view"
        return between_steps(self._view, step).pose

    def _track(
        self, scan: LaserScan, step: OdometryStep, here: UncertainPose, anchor: OdometryStep
    ) -> LocalizerStep:
        moved = between_steps(anchor, step)
        expected = compose(here, moved)
        rules, (x, y, theta) = self.config.keyframes, moved.pose.tolist()
        is_near = np.hypot(x, y) < 0.5 * rules.distance and abs(theta) < 0.5 * rules.turn
        if is_near and not self._is_torn:
            return _step(step, expected, LocalizerOutcome.PREDICTED, -1)
        current = self._keyframes.prepare(scan)
        hit, is_due = self._matched_around(current, scan, expected)
        if hit is not None and (not self._is_torn or hit.score >= _TORN_SCORE):
            fused, _ = fuse(expected, hit.here)
            return self._take(step, fused, LocalizerOutcome.TRACKED, hit.keyframe)
        self._n_unmatched += 1
        if self._is_torn or self._n_unmatched % rules.n_lost == 0:
            elsewhere = self._agreeing(self._hits(current))
            if elsewhere:
                best = elsewhere[0]
                return self._take(step, best.here, LocalizerOutcome.FOUND, best.keyframe)
        self._n_missed += is_due or self._is_torn
        if self._n_missed >= rules.n_lost:
            self._here, self._places = None, []
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
            if hit is None:
                continue
            if fuse(vague, hit.here)[1] < rules.gate:
                return hit, True
        return None, bool(len(near))

    def _take(
        self, step: OdometryStep, here: UncertainPose, outcome: LocalizerOutcome, keyframe: int
    ) -> LocalizerStep:
        self._here, self._anchor, self._places = here, step, []
        self._n_missed = self._n_unmatched = 0
        self._is_torn = False
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
