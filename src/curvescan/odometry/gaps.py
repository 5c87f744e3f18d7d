"""Gaps: scans that nothing places, how a later match bridges them, and when the track is lost.

The expected motion carries a track over a few scans. If none of them matches what was known before, nothing says any
more that they are near it: the sensor may have been carried away. The track then starts anew, its place in the old one
unknown.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from curvescan.matchers import MatchResult
from curvescan.odometry.gating import SURE, GatedMatch, gate
from curvescan.odometry.keyframes import Keyframe, Localization
from curvescan.odometry.motion_model import LONGEST_STEP
from curvescan.odometry.observation import Gap, Observation, Placement
from curvescan.odometry.step import StepOutcome
from curvescan.se2.uncertain import UncertainPose, identity

_SHARE = 0.65
"""Share of the scores on either side below which a doubtful match is questioned. A sensor carried to another room
leaves one of 0.2 to 0.45 between 0.7 and 0.85, and the next scan, 0.1 m on, is as sure of it, as its guess comes from
there; but it scores no more."""

_NEAR_M, _NEAR_RAD = 0.5, 0.5
"""Expected motion, metres and radians, from which on a view may change so much by itself."""

LOST_COVARIANCE = np.diag([LONGEST_STEP**2, LONGEST_STEP**2, math.pi**2])
"""Covariance of a motion of which nothing is known: a kilometre, half a turn."""
LOST_COVARIANCE.setflags(write=False)


def open_gap(o: Observation, last: Localization) -> Gap | None:
    """Return the gap that a scan without a match is in."""
    gap, config = o.state.gap, o.config.keyframes
    if gap is not None or config.max_gap == 0:
        return gap
    before: list[Keyframe] = []
    if o.matching.as_reference(last.keyframe.scan) is not None:
        before.append(last.keyframe)
    previous = o.state.previous
    if previous is not None and previous is not last.keyframe.scan:
        before.insert(0, last.as_keyframe(previous, o.index - 1, config.variance_retained))
    return Gap(before=tuple(before), n_scans=0, first=o.index) if before else None


def close_gap(o: Observation, placement: Placement) -> Placement | None:
    """Return the placement of a scan by a match with what was in use before the gap; None where there is none."""
    config, gap, tracked = o.config, placement.gap, placement.match
    if gap is None or (gap.is_questioned and tracked is None):
        return None
    for keyframe in gap.before:
        expected = placement.localization.relative_to(keyframe)
        if gap.is_questioned:  # it is known as little as the link
            cov = expected.cov + config.motion.recovery_covariance
            expected = UncertainPose(expected.pose, cov)
        result = o.matching.matcher.match(keyframe.scan.features, placement.current.features, expected)
        gated = gate(result, expected, config.motion)
        if not _joins(gated, config.keyframes.least_score, tracked if gap.is_questioned else None):
            continue
        localization = Localization(
            keyframe=keyframe, pose_keyframe_scan=gated.pose_keyframe_scan, is_measured=gated.is_fully_observed
        )
        joined = replace(
            placement,
            outcome=StepOutcome.RELOCALIZED,
            localization=localization,
            gap=None,
            match=result,
            reference=keyframe.index,
        )
        return with_keyframe(o, joined)
    return None


def widen_gap(o: Observation, placement: Placement) -> Placement:
    """Return the placement of one more scan in a gap: as it is, or LOST where the gap has become too wide."""
    gap, config = placement.gap, o.config.keyframes
    if gap is None:
        return placement
    n_scans = gap.n_scans + 1
    if n_scans <= config.max_gap:
        return replace(placement, gap=replace(gap, n_scans=n_scans))
    if o.prediction.is_measured:  # wheels carried the track
        return replace(placement, gap=None)
    here, motion = placement.localization.pose_keyframe_scan, placement.step_motion
    keyframe = placement.localization.keyframe
    if keyframe.index < gap.first:
        here = UncertainPose(here.pose, here.cov + LOST_COVARIANCE)
    else:  # it is of the new track, and is disconnected with it
        pose, cov = keyframe.pose_map_keyframe
        keyframe = replace(keyframe, pose_map_keyframe=UncertainPose(pose, cov + LOST_COVARIANCE))
    lost = replace(
        placement,
        outcome=StepOutcome.LOST,
        localization=Localization(keyframe=keyframe, pose_keyframe_scan=here),
        step_motion=UncertainPose(motion.pose, motion.cov + LOST_COVARIANCE),
        gap=None,
    )
    return lost


def question_link(o: Observation, placement: Placement, last: Localization) -> Placement | None:
    """Return the placement of a scan that what was in use hardly shows, in a gap; None where the match is sure.

    Its motion is taken, but only a later match with what was in use before it shows that the sensor has not been
    carried away.
    """
    result, config = placement.match, o.config.keyframes
    if result is None or placement.gap is not None or config.max_gap == 0:
        return None
    x, y, theta = o.expected.pose.tolist()
    is_near = math.hypot(x, y) < _NEAR_M and abs(theta) < _NEAR_RAD
    is_doubtful = result.confidence < SURE or result.score < config.least_score
    if not (is_near and is_doubtful and result.score < _SHARE * o.state.score):
        return None
    gap = open_gap(o, last)
    if gap is None:
        return None
    questioned = replace(placement, gap=replace(gap, is_questioned=True))
    return with_keyframe(o, widen_gap(o, questioned))


def with_keyframe(o: Observation, placement: Placement) -> Placement:
    """Return the placement with the scan as a new keyframe."""
    share = o.config.keyframes.variance_retained
    keyframe = placement.localization.as_keyframe(placement.current, o.index, share)
    return replace(placement, localization=Localization(keyframe=keyframe, pose_keyframe_scan=identity()))


def _joins(gated: GatedMatch, least_score: float, tracked: MatchResult | None) -> bool:
    """Return whether a match with a reference from before a gap bridges it; tracked: the questioned match."""
    result = gated.result
    if not (result.ok and gated.is_plausible) or result.score < least_score:
        return False
    if tracked is not None:
        return not result.score < _SHARE * tracked.score
    return math.isnan(result.confidence) or result.confidence >= SURE
