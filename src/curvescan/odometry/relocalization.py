"""Loop closure and relocalization: whether a scan is where an earlier keyframe was taken.

A match alone does not say so, for rooms resemble each other: it must also lie where the chain of matches allows. Where
the chain has become too vague to tell, two earlier keyframes must agree.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan.matchers import MatchResult, PreparedScan
from curvescan.odometry.config import KeyframesConfig
from curvescan.odometry.keyframes import Keyframe, KeyframeGraph, Localization
from curvescan.se2.uncertain import UncertainPose, fuse


class Closure(NamedTuple):
    """Where a scan is by an earlier keyframe, and the match that says so."""

    localization: Localization
    result: MatchResult


class Search(NamedTuple):
    """What a search gave.

    Attributes
    ----------
    found : Closure or None
        Where the chain allows it.
    disputed : Closure or None
        By two keyframes that agree with each other and surely match, but contradict the chain.
    """

    found: Closure | None = None
    disputed: Closure | None = None


def find_loop_closure(
    current: PreparedScan,
    localization: Localization,
    keyframes: KeyframeGraph,
    config: KeyframesConfig,
    *,
    turn: float,
    is_lost: bool = False,
    doubtful: Closure | None = None,
) -> Closure | None:
    """Return where a scan is by an earlier keyframe, and the match that says so; None where none does.

    The arguments are those of :func:`search_loop_closures`.
    """
    return search_loop_closures(
        current, localization, keyframes, config, turn=turn, is_lost=is_lost, doubtful=doubtful
    ).found


def search_loop_closures(
    current: PreparedScan,
    localization: Localization,
    keyframes: KeyframeGraph,
    config: KeyframesConfig,
    *,
    turn: float,
    is_lost: bool = False,
    doubtful: Closure | None = None,
) -> Search:
    """Return where a scan is by an earlier keyframe, or where two of them would have it against the chain."""
    if config.max_tries == 0:
        return Search()
    alone = config.confident_score, config.closure_gate_chi2
    agreeing = (config.least_score, config.agreeing_gate_chi2) if is_lost else alone
    hits = [] if doubtful is None else [doubtful]
    contrary: list[Closure] = []
    disputed: Closure | None = None
    n_tried = 0
    for keyframe in keyframes.nearest(localization.pose_map_scan.pose, config.max_reach, turn):
        if n_tried == config.max_tries:
            break
        if keyframe is localization.keyframe:
            continue
        expected = _inflated(localization.relative_to(keyframe), config)
        is_certain = _is_certain(expected, config)
        if not (_is_close(expected, config) if is_certain else _is_better_known(keyframe, localization)):
            continue
        n_tried += 1
        # where the chain is vague, it must not talk the matcher into anything
        prior = expected if is_certain else None
        result = current.matcher.match(keyframe.scan.features, current.features, prior)
        min_score, max_distance = alone if is_certain else agreeing
        if not result.ok or result.degenerate_direction is not None or result.score < min_score:
            continue
        found = UncertainPose(result.pose, result.covariance)
        hit = Closure(Localization(keyframe=keyframe, pose_keyframe_scan=found, is_measured=True), result)
        distance = fuse(expected, found)[1]
        if distance > max_distance:
            if not is_certain and _is_disputable(result, distance, config):
                disputed = disputed or _agreeing(hit, contrary, config)
                contrary.append(hit)
            continue
        closure = hit if is_certain else _agreeing(hit, hits, config)
        if closure is not None:
            return Search(found=closure)
        hits.append(hit)
    return Search(disputed=disputed)


def _is_disputable(result: MatchResult, distance: float, config: KeyframesConfig) -> bool:
    return distance <= config.disputed_gate_chi2 and result.confidence >= config.disputed_confidence


def _agreeing(hit: Closure, others: list[Closure], config: KeyframesConfig) -> Closure | None:
    """Return of two closures that agree the one by the older keyframe; None where none of the others agrees."""
    for other in others:
        if _agree(hit.localization, other.localization, config):
            return min(hit, other, key=lambda c: (not c.result.ok, c.localization.keyframe.number))
    return None


def _inflated(pose_keyframe_scan: UncertainPose, config: KeyframesConfig) -> UncertainPose:
    """Return an estimate with all that its covariance may leave out."""
    floor = (config.drift_floor_m, config.drift_floor_m, config.drift_floor_rad)
    return UncertainPose(pose_keyframe_scan.pose, config.drift**2 * pose_keyframe_scan.cov + np.diag(np.square(floor)))


def _is_certain(expected: UncertainPose, config: KeyframesConfig) -> bool:
    x, y, theta = np.diagonal(expected.cov).tolist()
    return bool(max(x, y) < config.certain_m**2 and theta < config.certain_rad**2)


def _is_close(expected: UncertainPose, config: KeyframesConfig) -> bool:
    """Return whether a place is so near to a keyframe that the latter can stay in use for a while."""
    x, y, theta = expected.pose.tolist()
    return bool(math.hypot(x, y) < 0.5 * config.distance and abs(theta) < 0.5 * config.turn)


def _is_better_known(keyframe: Keyframe, localization: Localization) -> bool:
    """Return whether an earlier keyframe can put right where the scan is: one that drifted more can't."""
    return bool(np.trace(keyframe.pose_map_keyframe.cov) < 2.0 * np.trace(localization.pose_map_scan.cov))


def _agree(one: Localization, other: Localization, config: KeyframesConfig) -> bool:
    """Return whether two keyframes put the scan in one place, as far as they know each other's."""
    by_other = _inflated(other.relative_to(one.keyframe), config)
    return fuse(by_other, one.pose_keyframe_scan)[1] < config.closure_gate_chi2
