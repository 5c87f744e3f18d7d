"""MapMatcher: matches of a scan with the keyframes of a map that should show it.

With a guess, from the odometry or from the search, a match is sure with keyframes that share little with the scan.
"""

from __future__ import annotations

import math
from functools import reduce
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers import PreparedScan
from curvescan.matchers.result import GUESS_COVARIANCE, WIDE_PRIOR, log_odds
from curvescan.odometry.measurement import as_measurement
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import STEP_M, STEP_RAD
from curvescan.slam.localization.field import DistanceField, lasting_points
from curvescan.slam.loops.closures import MOST_ODDS, is_certain
from curvescan.slam.loops.overlap import predicted_overlap, range_profile
from curvescan.slam.map import SlamMap
from curvescan.types import Cov, Points

_REACH_M = 8.0
"""Keyframes farther away are not matched, metres; one half as far comes behind a near one that shares half as much."""

_LEAST_OVERLAP = 0.15
"""Nor those that share less of what they see, predicted from where they are."""

SCORE = 0.25
"""What the score of a sure match counts for beside the share of readings that the map agrees with."""

WORSE = 0.05
"""The map agrees less with one pose than with another where this share of the readings, or more, does, also with a
match moved a search step along what it leaves open: a corridor has ends and doors that no one keyframe shows."""

_N_FUSED = 3
"""Keyframes whose matches are fused."""

SEARCHED: Cov = np.diag(np.square([0.5 * STEP_M, 0.5 * STEP_M, STEP_RAD]))
"""Covariance of a pose that the search found."""

N_TRIED = 12
"""Keyframes that look alike, and places, that are tried in detail in a search."""


class Hit(NamedTuple):
    """A match of a scan with a keyframe of the map."""

    keyframe: int
    here: UncertainPose  # where it puts the scan in the map, the keyframe taken to be where the map has it
    score: float  # how much speaks for the place, in [0, 1]: the match's score, less where it is not sure


class MapMatcher:
    """Matches scans with the keyframes of a map."""

    def __init__(self, slam_map: SlamMap, keyframes: Keyframes, config: SlamConfig, field: DistanceField) -> None:
        self.field = field
        self._misfits: dict[int, float] = {}
        self._map, self._keyframes, self._config = slam_map, keyframes, config

    def around(
        self, scan: LaserScan, expected: UncertainPose, *, seen_from: int = -1, is_known: bool = True
    ) -> tuple[list[Hit], bool]:
        """Return matches with keyframes that should show a scan, where it is expected, and whether one was due.

        A place that is only asked about, and not known, says nothing for itself.
        """
        poses = self._map.poses
        near = np.flatnonzero(np.hypot(*(poses[:, :2] - expected.pose[:2]).T) < _REACH_M)
        relative = se2.between(poses[near], expected.pose)
        overlap = predicted_overlap(self._keyframes.profiles.array, near, relative, range_profile(scan), 0.0)
        apart = np.hypot(relative[:, 0], relative[:, 1])
        order = np.argsort(-overlap / (1.0 + apart / (0.5 * _REACH_M)), kind="stable")[: 2 * _N_FUSED]
        order = order[overlap[order] >= _LEAST_OVERLAP]
        if not len(order):
            return [], False
        current = self._keyframes.prepare(scan)
        known = GUESS_COVARIANCE if is_known else WIDE_PRIOR.covariance
        hits: list[Hit] = []
        for row in order.tolist():
            hit = self._hit(int(near[row]), current, UncertainPose(relative[row], known))
            if hit is not None and fuse(self.seen_from(expected, seen_from, hit), hit.here)[1] < GATE:
                hits.append(hit)
                if len(hits) == _N_FUSED:
                    break
        return hits, bool(overlap[order[0]] >= self._config.closures.min_overlap)

    def similar(self, scan: LaserScan) -> list[Hit]:
        """Return matches without a guess with keyframes that look like a scan; none that leave a direction open."""
        current = self._keyframes.prepare(scan)
        alike = self._keyframes.index.most_similar(self._keyframes.signature(current), N_TRIED)
        return [hit for k in alike.tolist() if (hit := self._hit(k, current, None)) is not None]

    def _hit(self, k: int, current: PreparedScan, prior: UncertainPose | None) -> Hit | None:
        """Return where a match puts a scan; None where it fails, or leaves a direction open without a prior."""
        result = self._keyframes.match(k, current, prior)
        if not result.ok or (prior is None and result.degenerate_direction is not None):
            return None
        found = as_measurement(result)
        found = UncertainPose(found.pose, found.covariance + self._config.noise.floor)
        exact = UncertainPose(self._map.poses[k], np.zeros((3, 3)))
        sure = log_odds(result.confidence, unknown=0.5 * MOST_ODDS) / MOST_ODDS
        return Hit(keyframe=k, here=compose(exact, found), score=min(max(sure, 0.0), 1.0) * result.score)

    def seen_from(self, expected: UncertainPose, keyframe: int, hit: Hit) -> UncertainPose:
        """Return what is expected by one keyframe, with what the map errs between it and the keyframe of a match.

        A map bends as if edges led from one to the other, a step of keyframes each; nothing is added where none is.
        """
        if keyframe < 0 or keyframe == hit.keyframe:
            return expected
        x, y, _ = self._map.poses[hit.keyframe] - self._map.poses[keyframe]
        position, _, rotation = np.diagonal(self._config.noise.spread)
        apart2 = x * x + y * y
        far, n_edges = position + rotation * apart2, 1.0 + math.sqrt(apart2) / self._config.keyframes.distance
        return UncertainPose(expected.pose, expected.covariance + n_edges * np.diag([far, far, rotation]))

    def settled(self, points: Points, hits: list[Hit]) -> list[Hit]:
        """Return the best match of one scan and those that agree with it: a bent map puts it in several places."""
        if len(hits) < 2:
            return hits
        # by how much less the map agrees with the scan there than with the keyframe itself
        missing = [1.0 - self.misfit(hit.keyframe) - self.field.agreement(points, hit.here.pose) for hit in hits]
        first = hits[int(np.argmax([SCORE * hit.score - m for hit, m in zip(hits, missing, strict=True)]))]
        others = [hit._replace(here=self.seen_from(hit.here, first.keyframe, hit)) for hit in hits if hit is not first]
        return [first, *(hit for hit in others if fuse(first.here, hit.here)[1] < GATE)]

    def held(self, points: Points, place: UncertainPose, hit: Hit) -> Hit:
        """Return a match; what it leaves open is held by a place, where the map agrees less with the scan beside it."""
        if is_certain(hit.here, self._config):
            return hit
        shift = np.array([*(STEP_M * np.linalg.eigh(hit.here.covariance[:2, :2])[1][:, 1]), 0.0])
        fit, *beside = (self.field.agreement(points, place.pose + way * shift) for way in (0.0, -1.0, 1.0))
        return hit._replace(here=fuse(place, hit.here)[0]) if max(beside) <= fit - WORSE else hit

    def misfit(self, k: int) -> float:
        """Return how much of a keyframe's own scan the map does not agree with: a lot where the map is bent."""
        if k not in self._misfits:
            self._misfits[k] = 1.0 - self.field.agreement(lasting_points(self._map.scans[k]), self._map.poses[k])
        return self._misfits[k]

    def in_map(self, here: UncertainPose, keyframe: int) -> tuple[UncertainPose, Cov]:
        """Return a pose with what the map errs around it, and its covariance seen from the first keyframe."""
        around = UncertainPose(here.pose, here.covariance + self._config.noise.spread)
        origin = UncertainPose(self._map.poses[keyframe], self._map.covariances[keyframe])
        seen = UncertainPose(se2.between(origin.pose, here.pose), np.zeros((3, 3)))
        return around, around.covariance + compose(origin, seen).covariance


def fused(hits: list[Hit]) -> UncertainPose:
    """Return the pose that matches of one scan say together: they share its noise, and count as one."""
    several = [UncertainPose(hit.here.pose, len(hits) * hit.here.covariance) for hit in hits]
    return reduce(lambda one, other: fuse(one, other)[0], several)
