"""MapMatcher: matches of a scan with the keyframes of a map that should show it.

A guess is given, from the odometry or from the search: with it a match is sure with keyframes that share little with the scan, and that are
metres away because they look the other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.matchers import PreparedScan
from curvescan.odometry.measurement import as_measurement
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import is_confident
from curvescan.slam.loops.overlap import foretold_overlap, range_profile
from curvescan.slam.map import SlamMap
from curvescan.types import Cov, Pose

_REACH_M = 8.0
"""Keyframes farther away are not matched, metres."""

_LEAST_OVERLAP = 0.15
"""Nor those that share less of what they see, foretold from where they are."""

_DUE_OVERLAP = 0.4
"""A keyframe that shares as much should match."""

_SURE_LOG_ODDS = math.log(99.0)
"""Log-odds of a match of full weight: one in a hundred is wrong."""

_N_FUSED = 3
"""Keyframes whose matches are fused."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hit:
    """A match of a scan with a keyframe of the map.

    Attributes
    ----------
    keyframe : int
        The keyframe.
    here : UncertainPose
        Where the match puts the scan in the map, the keyframe taken to be where the map has it.
    score : float
        Of the match.
    weight : float
        How much of its score speaks for the place, in [0, 1], by its confidence.
    """

    keyframe: int
    here: UncertainPose
    score: float
    weight: float = 1.0


class MapMatcher:
    """Matches scans with the keyframes of a map.

    Parameters
    ----------
    slam_map : SlamMap
        The map.
    keyframes : Keyframes
        Its keyframes.
    config : SlamConfig
        The rules.
    """

    def __init__(self, slam_map: SlamMap, keyframes: Keyframes, config: SlamConfig) -> None:
        self._map, self._keyframes, self._config = slam_map, keyframes, config

    def around(
        self, scan: LaserScan, expected: UncertainPose, *, n_most: int = _N_FUSED
    ) -> tuple[list[Hit], bool]:
        """Return matches with keyframes that should show a scan, within the gate of where it is expected, and whether one was due.

        Parameters
        ----------
        scan : LaserScan
            The scan.
        expected : UncertainPose
            Where it was taken, in the map.
        n_most : int
            Matches wanted; twice as many keyframes are tried.
        """
        poses = self._map.poses
        near = np.flatnonzero(np.hypot(*(poses[:, :2] - expected.pose[:2]).T) < _REACH_M)
        relative = se2.between(poses[near], expected.pose)
        overlap = foretold_overlap(self._keyframes.profiles, near, relative, range_profile(scan))
        order = np.argsort(-overlap, kind="stable")[: 2 * n_most]
        order = order[overlap[order] >= _LEAST_OVERLAP]
        current = self._keyframes.prepare(scan) if len(order) else None
        hits: list[Hit] = []
        for row in order.tolist():
            assert current is not None
            hit = self._hit(int(near[row]), current, relative[row])
            if hit is not None and fuse(expected, hit.here)[1] < self._config.closures.gate:
                hits.append(hit)
                if len(hits) == n_most:
                    break
        is_due = bool(len(order)) and bool(overlap[order[0]] >= _DUE_OVERLAP)
        return hits, is_due

    def similar(self, scan: LaserScan, n_tried: int) -> list[Hit]:
        """Return matches without a guess with keyframes that look like a scan; none that leave a direction open."""
        current = self._keyframes.prepare(scan)
        alike = self._keyframes.index.most_similar(self._keyframes.signature(current), n_tried)
        hits = [self._hit(k, current, None) for k in alike.tolist()]
        return [hit for hit in hits if hit is not None]

    def _hit(self, k: int, current: PreparedScan, guess: Pose | None) -> Hit | None:
        """Return where a match with a keyframe puts a scan; None where it fails or is too likely to be wrong."""
        reference = self._keyframes.prepared(k)
        result = current.matcher.match(reference.features, current.features, guess)
        if not result.ok or not is_confident(result, self._config):
            return None
        if guess is None and result.degenerate_direction is not None:
            return None
        measured = as_measurement(result)
        found = UncertainPose(measured.pose, measured.cov + self._config.noise.floor)
        exact = UncertainPose(self._map.poses[k], np.zeros((3, 3)))
        return Hit(
            keyframe=k,
            here=compose(exact, found),
            score=result.score,
            weight=_weight(result.confidence),
        )

    def in_map(self, here: UncertainPose, keyframe: int) -> tuple[UncertainPose, Cov]:
        """Return a pose with what the map errs around it, and its covariance seen from the first keyframe.

        Parameters
        ----------
        here : UncertainPose
            Pose in the map, the keyframes around taken to be where the map has them.
        keyframe : int
            The keyframe that it was matched with last.
        """
        around = UncertainPose(here.pose, here.cov + 4.0 * self._config.noise.floor)
        origin = UncertainPose(self._map.poses[keyframe], self._map.covariances[keyframe])
        seen = UncertainPose(se2.between(origin.pose, here.pose), np.zeros((3, 3)))
        return around, around.cov + compose(origin, seen).cov


def _weight(confidence: float) -> float:
    """Return what a match of some confidence weighs, by its log-odds; a half where the matcher gives none."""
    if math.isnan(confidence):
        return 0.5
    odds = confidence / max(1.0 - confidence, 1e-6)
    return float(np.clip(math.log(odds) / _SURE_LOG_ODDS, 0.0, 1.0))


def fused(hits: list[Hit]) -> UncertainPose:
    """Return the pose that matches of one scan say together: they share its noise, so that several are worth no more than one."""
    share = float(len(hits))
    total = UncertainPose(hits[0].here.pose, share * hits[0].here.cov)
    for hit in hits[1:]:
        total, _ = fuse(total, UncertainPose(hit.here.pose, share * hit.here.cov))
    return total
