"""Gaps: scans that nothing places, how a later match bridges them, and when the track is lost.

The expected motion carries a track over a few scans. If none of them matches what was known before, nothing says any more
that they are near it: the sensor may have been carried away. The track then starts anew, its place in the old one unknown.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from curvescan.matchers import MatchResult
from curvescan.odometry.gating import GatedMatch, gate
from curvescan.odometry.keyframes import Keyframe, Localization
from curvescan.odometry.observation import Gap, Observation, Placement
from curvescan.odometry.step import StepOutcome
from curvescan.se2.uncertain import UncertainPose, identity

MIN_CONFIDENCE = 0.8
"""Least confidence of a match that bridges a gap: it also lies where it is expected."""

_SHARE = 0.65
"""Share of the scores on either side below which a doubtful match is questioned. A sensor carried to another room leaves one of 0.2 to 0.45
between 0.7 and 0.85, and the next scan, 0.1 m on, is as sure of it, as its guess comes from there; but it scores no more."""

_NEAR_M, _NEAR_RAD = 0.5, 0.5
"""Expected motion, metres and radians, from which on a view may change so much by itself."""

LOST_COVARIANCE = np.diag([1e3**2, 1e3**2, math.pi**2])
"""Covariance of a motion of which nothing is known: a kilometre, half a turn."""
LOST_COVARIANCE.setflags(write=False)


def open_gap(o: Observation, last: Localization) -> tuple[Gap | None, tuple[Keyframe, ...]]:
    """Return the gap that a scan without a match is in, and the keyframe that is to be made of the scan before it."""
    gap, config = o.state.gap, o.config.keyframes
    if gap is not None or config.max_gap == 0:
        return gap, ()
    before: list[Keyframe] = []
    made: tuple[Keyframe, ...] = ()
    if o.matching.as_reference(last.keyframe.scan) is not None:
        before.append(last.keyframe)
    previous = o.state.previous
    if previous is not None and previous is not last.keyframe.scan:
        keyframe = o.keyframes.make(previous, o.index - 1, last)
        before.insert(0, keyframe)
        made = (keyframe,)
    return (Gap(before=tuple(before), n_scans=0, first=o.index), made) if before else (None, ())


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
        is_tracked = placement.match is not None
        joined = replace(
            placement,
            outcome=StepOutcome.LOOP_CLOSED if is_tracked else StepOutcome.RELOCALIZED,
            localization=localization,
            n_searches=0,
            gap=None,
            match=result,
            reference=keyframe.index,
            used=(*placement.used, keyframe),
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
    if keyframe.index < gap.first:  # else it is of the new track, and is disconnected with it
        here = UncertainPose(here.pose, here.cov + LOST_COVARIANCE)
    lost = replace(
        placement,
        outcome=StepOutcome.LOST,
        localization=Localization(keyframe=keyframe, pose_keyframe_scan=here),
        anew_since=gap.first,
        step_motion=UncertainPose(motion.pose, motion.cov + LOST_COVARIANCE),
        n_searches=config.max_searches,
        gap=None,
    )
    return lost


def question_link(o: Observation, placement: Placement, last: Localization) -> Placement | None:
    """Return the placement of a scan that what was in use hardly shows, in a gap; None where the match is sure.

    Its motion is taken, but only a later match with what was in use before it shows that the sensor has not been carried away.
    """
    result, config = placement.match, o.config.keyframes
    if result is None or placement.gap is not None or config.max_gap == 0:
        return None
    x, y, theta = o.expected.pose.tolist()
    is_near = math.hypot(x, y) < _NEAR_M and abs(theta) < _NEAR_RAD
    is_doubtful = result.confidence < MIN_CONFIDENCE or result.score < config.least_score
    if not (is_near and is_doubtful and result.score < _SHARE * o.state.score):
        return None
    gap, made = open_gap(o, last)
    if placement.outcome is StepOutcome.CHAINED:  # the previous scan is a keyframe already
        before = (*placement.used, last.keyframe)
        gap, made = Gap(before=before, n_scans=0, first=o.index), ()
    if gap is None:
        return None
    questioned = replace(
        placement, gap=replace(gap, is_questioned=True), new_keyframes=(*placement.new_keyframes, *made)
    )
    return with_keyframe(o, widen_gap(o, questioned))


def with_keyframe(o: Observation, placement: Placement, *, is_predicted: bool = False) -> Placement:
    """Return the placement with the scan as a new keyframe."""
    keyframe = o.keyframes.make(placement.current, o.index, placement.localization, is_predicted=is_predicted)
    return replace(
        placement,
        localization=Localization(keyframe=keyframe, pose_keyframe_scan=identity()),
        new_keyframes=(*placement.new_keyframes, keyframe),
    )


def _joins(gated: GatedMatch, least_score: float, tracked: MatchResult | None) -> bool:
    """Return whether a match with a reference from before a gap bridges it, one that is questioned where the match within the track is given."""
    result = gated.result
    if not (result.ok and gated.is_plausible) or result.score < least_score:
        return False
    if tracked is not None:
        return not result.score < _SHARE * tracked.score
    return math.isnan(result.confidence) or result.confidence >= MIN_CONFIDENCE
