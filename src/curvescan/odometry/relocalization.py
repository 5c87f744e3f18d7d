"""Known places: whether a scan is where an earlier key scan was taken.

A match alone does not say so, for rooms resemble each other: it must also lie where the chain of matches allows. Where
the chain has become too vague to tell, two earlier key scans must agree.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan.matchers import MatchResult, PreparedScan
from curvescan.odometry.config import KeysConfig
from curvescan.odometry.keyframes import Fix, Key, Keys
from curvescan.se2.uncertain import UncertainPose, fuse


def find_known_place(
    current: PreparedScan,
    fix: Fix,
    keys: Keys,
    config: KeysConfig,
    *,
    turn: float,
    is_lost: bool = False,
) -> tuple[Fix, MatchResult] | None:
    """Return where a scan is by an earlier key scan, and the match that says so; None where none does.

    Parameters
    ----------
    current : PreparedScan
        The scan.
    fix : Fix
        Where it is by the key scan in use.
    keys : Keys
        All key scans.
    config : KeysConfig
        The odometry's.
    turn : float
        Key scans whose direction differs by more are not tried, radians.
    is_lost : bool
        Whether nothing else shows where the scan is. Two matches that agree may then score less, if they lie near where
        it is thought to be: other places of the same kind are the same to both.
    """
    if config.max_tries == 0:
        return None
    alone = config.sure_score, config.same_place
    agreeing = (config.least_score, config.likely_place) if is_lost else alone
    hits: list[tuple[Fix, MatchResult]] = []
    n_tried = 0
    for key in keys.nearest(fix.world.pose, config.max_reach, turn):
        if n_tried == config.max_tries:
            break
        if key is fix.key:
            continue
        expected = _vaguely(fix.seen_from(key), config)
        is_certain = _is_certain(expected, config)
        if not (_is_close(expected, config) if is_certain else _is_better_known(key, fix)):
            continue
        n_tried += 1
        # where the chain is vague, it must not talk the matcher into anything
        guess = expected.pose if is_certain else None
        result = current.matcher.match(key.scan.features, current.features, guess)
        min_score, max_distance = alone if is_certain else agreeing
        if not result.ok or result.weak_direction is not None or result.score < min_score:
            continue
        found = UncertainPose(result.pose, result.covariance)
        if fuse(expected, found)[1] > max_distance:
            continue
        hit = (Fix(key=key, seen=found, is_measured=True), result)
        if is_certain:
            return hit
        for other in hits:
            if _agree(hit[0], other[0], config):
                return min(hit, other, key=lambda h: h[0].key.number)
        hits.append(hit)
    return None


def _vaguely(seen: UncertainPose, config: KeysConfig) -> UncertainPose:
    """Return an estimate with all that its covariance may leave out."""
    floor = (config.drift_floor_m, config.drift_floor_m, config.drift_floor_rad)
    return UncertainPose(seen.pose, config.drift**2 * seen.cov + np.diag(np.square(floor)))


def _is_certain(expected: UncertainPose, config: KeysConfig) -> bool:
    x, y, theta = np.diagonal(expected.cov).tolist()
    return bool(max(x, y) < config.certain_m**2 and theta < config.certain_rad**2)


def _is_close(expected: UncertainPose, config: KeysConfig) -> bool:
    """Return whether a place is so near to a key scan that the latter can stay in use for a while."""
    x, y, theta = expected.pose.tolist()
    return bool(math.hypot(x, y) < 0.5 * config.distance and abs(theta) < 0.5 * config.turn)


def _is_better_known(key: Key, fix: Fix) -> bool:
    """Return whether an earlier key scan can put right where the scan is: one that drifted more can't."""
    return bool(np.trace(key.world.cov) < 2.0 * np.trace(fix.world.cov))


def _agree(one: Fix, other: Fix, config: KeysConfig) -> bool:
    """Return whether two key scans put the scan in one place, as far as they know each other's."""
    by_other = _vaguely(other.seen_from(one.key), config)
    return fuse(by_other, one.seen)[1] < config.same_place
