"""Loop closure and relocalization: whether a scan is where an earlier keyframe was taken.

A match alone does not say so, for rooms resemble each other: it must also lie where the chain of matches allows. Where
the chain has become too vague to tell, two earlier keyframes must agree.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan.matchers import MatchResult, PreparedScan
from curvescan.odometry.config import KeyframesConfig
from curvescan.odometry.keyframes import Keyframe, KeyframeGraph, Localization
from curvescan.se2.uncertain import UncertainPose, fuse


def find_loop_closure(
    current: PreparedScan,
    localization: Localization,
    keyframes: KeyframeGraph,
    config: KeyframesConfig,
    *,
    turn: float,
    is_lost: bool = False,
) -> tuple[Localization, MatchResult] | None:
    """Return where a scan is by an earlier keyframe, and the match that says so; None where none does.

    Parameters
    ----------
    current : PreparedScan
        The scan.
    localization : Localization
        Where it is by the keyframe in use.
    keyframes : KeyframeGraph
        All keyframes.
    config : KeyframesConfig
        The odometry's.
    turn : float
        Keyframes whose direction differs by more are not tried, radians.
    is_lost : bool
        Whether nothing else shows where the scan is. Two matches that agree may then score less, if they lie near where
        it is thought to be: other places of the same kind are the same to both.
    """
    if config.max_tries == 0:
        return None
    alone = config.confident_score, config.closure_gate_chi2
    agreeing = (config.least_score, config.agreeing_gate_chi2) if is_lost else alone
    hits: list[tuple[Localization, MatchResult]] = []
    n_tried = 0
    for keyframe in keyframes.nearest(localization.pose_map_scan.pose, config.max_reach, turn):
        if n_tried == config.max_tries:
            break
        if keyframe is localization.keyframe:
            continue
        expected = _inflated(localization.relative_to(keyframe), config)
        is_certain = _is_certain(expected, config)
        if not (
            _is_close(expected, config) if is_certain else _is_better_known(keyframe, localization)
        ):
            continue
        n_tried += 1
        # where the chain is vague, it must not talk the matcher into anything
        guess = expected.pose if is_certain else None
        result = current.matcher.match(keyframe.scan.features, current.features, guess)
        min_score, max_distance = alone if is_certain else agreeing
        if not result.ok or result.degenerate_direction is not None or result.score < min_score:
            continue
        found = UncertainPose(result.pose, result.covariance)
        if fuse(expected, found)[1] > max_distance:
            continue
        hit = (Localization(keyframe=keyframe, pose_keyframe_scan=found, is_measured=True), result)
        if is_certain:
            return hit
        for other in hits:
            if _agree(hit[0], other[0], config):
                return min(hit, other, key=lambda h: h[0].keyframe.number)
        hits.append(hit)
    return None


def _inflated(pose_keyframe_scan: UncertainPose, config: KeyframesConfig) -> UncertainPose:
    """Return an estimate with all that its covariance may leave out."""
    floor = (config.drift_floor_m, config.drift_floor_m, config.drift_floor_rad)
    return UncertainPose(
        pose_keyframe_scan.pose,
        config.drift**2 * pose_keyframe_scan.cov + np.diag(np.square(floor)),
    )


def _is_certain(expected: UncertainPose, config: KeyframesConfig) -> bool:
    x, y, theta = np.diagonal(expected.cov).tolist()
    return bool(max(x, y) < config.certain_m**2 and theta < config.certain_rad**2)


def _is_close(expected: UncertainPose, config: KeyframesConfig) -> bool:
    """Return whether a place is so near to a keyframe that the latter can stay in use for a while."""
    x, y, theta = expected.pose.tolist()
    return bool(math.hypot(x, y) < 0.5 * config.distance and abs(theta) < 0.5 * config.turn)


def _is_better_known(keyframe: Keyframe, localization: Localization) -> bool:
    """Return whether an earlier keyframe can put right where the scan is: one that drifted more can't."""
    return bool(
        np.trace(keyframe.pose_map_keyframe.cov) < 2.0 * np.trace(localization.pose_map_scan.cov)
    )


def _agree(one: Localization, other: Localization, config: KeyframesConfig) -> bool:
    """Return whether two keyframes put the scan in one place, as far as they know each other's."""
    by_other = _inflated(other.relative_to(one.keyframe), config)
    return fuse(by_other, one.pose_keyframe_scan)[1] < config.closure_gate_chi2
