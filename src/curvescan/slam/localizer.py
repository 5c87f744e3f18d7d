"""Localizer: where a sensor is in a saved map, with no guess, and from then on.

Until the sensor is found, each view is held against the whole map (:mod:`curvescan.slam.localization.search`), and
matches with the keyframes around confirm the place. Then the odometry leads, and keyframes correct it. Where the
odometry breaks, or the map contradicts the scan, the whole map is looked at again, with what was known before.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from curvescan.configs import as_config, counted
from curvescan.deskew import deskew
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers import DEFAULT_METHOD, find_matcher
from curvescan.matchers.registry import MatcherConfig
from curvescan.odometry.config import MATCHER_HINT
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import UNMEASURED, Step, StepOutcome, between_steps
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import contour_length, is_same
from curvescan.slam.localization.field import lasting_points
from curvescan.slam.localization.grid_map import opened, with_field
from curvescan.slam.localization.matching import SEARCHED, WORSE, Hit, MapMatcher, fused
from curvescan.slam.localization.prior import Prior
from curvescan.slam.localization.search import MapSearch, Place, Views, said
from curvescan.slam.loops.closures import is_certain
from curvescan.slam.map import SlamMap
from curvescan.types import with_fields

_NOWHERE = UncertainPose(np.full(3, np.nan), np.full((3, 3), np.nan))
"""The pose of a sensor that is searched for."""


class Fix(NamedTuple):
    """Where the sensor was at the last scan that was matched with the map."""

    here: UncertainPose  # in the map
    step: Step  # of the odometry, at that scan
    keyframe: int  # that it was matched with


class Localizer:
    """Finds and follows a sensor in a map.

    Parameters
    ----------
    slam_map : SlamMap, OccupancyGrid or path
        The map, or its file: ``map.csmap`` of SLAM, or a plain map of cells with its YAML file, as ROS's map_server has
        it. It is not changed.
    method : str
        Name of the matcher.
    matcher : dataclass, mapping or None
        Its configuration.
    config : SlamConfig or None
        None for the defaults.
    """

    def __init__(
        self,
        slam_map: SlamMap | OccupancyGrid | str | os.PathLike[str],
        *,
        method: str = DEFAULT_METHOD,
        matcher: MatcherConfig | None = None,
        config: SlamConfig | Mapping[str, Any] | None = None,
    ) -> None:
        rules = as_config(config, SlamConfig(), hint=MATCHER_HINT)
        self.map, field, self.config = with_field(opened(slam_map), rules)
        self.method, self._matcher = method, matcher
        self._keyframes = Keyframes(find_matcher(method, matcher, name="matcher"))
        self._keyframes.add_all(self.map)
        self._matching = MapMatcher(self.map, self._keyframes, self.config, field)
        self._search = MapSearch(field, self.map.poses, self._keyframes)
        self.reset()

    def __repr__(self) -> str:
        found = "not found" if self._fix is None else "found"
        return f"Localizer({self.method}: in a map of {counted(len(self.map), 'keyframe')}, {found})"

    def reset(
        self, pose: ArrayLike | None = None, covariance: ArrayLike | None = None, *, keeps_odometry: bool = False
    ) -> None:
        """Forget where the sensor is; an initial pose may say about where it is.

        Parameters
        ----------
        pose : (3,) array_like or None
            About where the next scan is taken, x, y, theta in the frame of the map; None where nothing is known. The
            scans decide: a place that it makes likely needs less of them, another one more.
        covariance : (3, 3) array_like or None
            Of `pose`; None for 0.5 m and 15 deg.
        keeps_odometry : bool
            Whether the next scan follows the last one; else it is the first of another log.

        Raises
        ------
        InvalidArgumentError
            When `pose` is not three numbers, or `covariance` no covariance.
        """
        self._prior = None if pose is None else Prior.of(pose, covariance)  # where the sensor is, by all before
        self._is_told = pose is not None  # of the next scan already: its motion is in it
        if not keeps_odometry:
            self.odometry = Odometry(self.method, matcher=self._matcher, config=self.config.odometry)
        self._fix: Fix | None = None
        self._views: tuple[Views, Step] | None = None  # of the search, and the step of the last one
        self._n_missed = 0  # scans in a row that should have matched the map
        self._n_lost = 0
        self._is_motion_unreliable = False  # whether a motion since then was not measured, or is in doubt

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> Step:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels; see :meth:`Odometry.add`.
        """
        step = self.odometry.add(scan, odometry_pose)
        is_unmeasured = step.outcome in UNMEASURED
        self._n_lost = self._n_lost + 1 if is_unmeasured else 0
        self._is_motion_unreliable |= is_unmeasured
        if step.outcome is StepOutcome.LOST or self._n_lost >= self.config.keyframes.n_lost:
            self._fix = None
        if self._prior is not None and not self._is_told:
            moved = self.config.noise.doubled(UncertainPose(step.motion, step.motion_covariance))
            self._prior = self._prior.moved(moved, is_doubtful=is_unmeasured)
        self._is_told = False
        if self.config.odometry.deskew:  # as the map's keyframes are
            scan = deskew(scan, step.velocity)
        return self._look(scan, step) if self._fix is None else self._track(scan, step, self._fix)

    def _look(self, scan: LaserScan, step: Step) -> Step:
        """Look for the sensor in the whole map."""
        before = None
        if self._views is not None and not self._is_motion_unreliable:
            views, at = self._views
            before = views, between_steps(at, step)
            if not self.config.keyframes.is_far(before[1].pose, 0.7):
                return self._at(step, StepOutcome.SEARCHING)
        self._is_motion_unreliable = False
        similar = self._matching.similar(scan)
        views = self._search.look(scan, prior=self._prior, before=before, matched=similar)
        self._views = views, step
        hits = self._confirmed(scan, views.winner)
        return self._take(step, StepOutcome.FOUND, fused(hits), hits) if hits else self._at(step, StepOutcome.SEARCHING)

    def _track(self, scan: LaserScan, step: Step, fix: Fix) -> Step:
        """Follow the sensor from where it was."""
        moved = between_steps(fix.step, step)
        expected = compose(fix.here, moved)
        if not self.config.keyframes.is_far(moved.pose, 0.5) and not self._is_motion_unreliable and self._n_missed == 0:
            return self._at(step, StepOutcome.TRACKED, expected)
        points, field = lasting_points(scan), self._matching.field
        # after a motion in doubt no other place may agree as well
        alone = self._search.look(scan, prior=self._prior) if self._is_motion_unreliable else None
        vague = self.config.noise.doubled(expected)
        found, is_due = self._matching.around(scan, vague, seen_from=fix.keyframe)
        hits = self._matching.settled(points, found)
        now = fuse(self._matching.seen_from(expected, fix.keyframe, hits[0]), fused(hits))[0] if hits else expected
        fit = field.agreement(points, now.pose)
        view = said(contour_length(points), fit).by_walls
        prior = float(self._search.known(self._prior, now.pose[np.newaxis])[0])
        if hits and fit > 0.0 and (alone is None or alone.is_best(now.pose, view + prior)):
            return self._take(step, StepOutcome.TRACKED, now, hits, view)
        self._n_missed += is_due or fit < 0.0 or self._is_motion_unreliable
        if self._n_missed:
            views = alone or self._search.look(scan, prior=self._prior)
            if elsewhere := self._confirmed(scan, views.winner):
                return self._take(step, StepOutcome.FOUND, fused(elsewhere), elsewhere)
        if self._n_missed >= self.config.keyframes.n_lost:
            self._fix, self._views = None, None
            return self._look(scan, step)
        return self._at(step, StepOutcome.PREDICTED, expected)

    def _confirmed(self, scan: LaserScan, place: Place | None) -> list[Hit]:
        """Return matches that put a scan at a place; none where they leave a direction open."""
        if place is None:
            return []
        matching, points = self._matching, lasting_points(scan)
        searched = UncertainPose(place.pose, SEARCHED)
        found, _ = matching.around(scan, searched, is_known=False)
        if not found:
            return []
        hits = matching.settled(points, [matching.held(points, searched, hit) for hit in found])
        here = fused(hits)
        # unless the map does not agree with its own keyframes there
        worse = max(WORSE, matching.misfit(hits[0].keyframe))
        fit, least = (matching.field.agreement(points, pose) for pose in (here.pose, place.pose))
        is_worse = fit < max(0.0, least - worse)
        return [] if is_worse or not is_certain(here, self.config) or not is_same(place.pose, here.pose) else hits

    def _take(self, step: Step, outcome: StepOutcome, here: UncertainPose, hits: list[Hit], view: float = 0.0) -> Step:
        """Take a pose that matches found; view: What the map says of it where it was expected."""
        self._fix = Fix(here, step, hits[0].keyframe)
        is_expected = self._prior is not None and self._search.known(self._prior, here.pose[np.newaxis])[0] > 0.0
        self._prior = self._prior.confirmed(here, view) if self._prior and is_expected else Prior(here=here)
        self._views, self._n_missed, self._is_motion_unreliable = None, 0, False
        return self._at(step, outcome, here, self._fix.keyframe)

    def _at(self, step: Step, outcome: StepOutcome, here: UncertainPose = _NOWHERE, keyframe: int = -1) -> Step:
        """Return the step of a scan whose pose in the map is `here`, by its step of the odometry."""
        around, cov = (here, here.covariance) if self._fix is None else self._matching.in_map(here, self._fix.keyframe)
        pose, own, cov = (one.copy() for one in (around.pose, around.covariance, cov))  # changes stay the caller's
        return with_fields(step, pose=pose, covariance=own, outcome=outcome, keyframe=keyframe, covariance_global=cov)
