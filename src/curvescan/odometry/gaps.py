"""Gaps: scans that nothing places, how a later match bridges them, and when the track is lost.

The expected motion carries a track over a few scans. Each is matched with what was in use before the failure, and says
how likely it is that the sensor is still near there. If it is not, it has been carried away: the track starts anew, its
place in the old one unknown.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan.matchers.result import WIDE_PRIOR
from curvescan.odometry.measurement import CERTAIN, GatedMatch, gate, odds_against
from curvescan.odometry.observation import Gap, Keyframe, Localization, Observation, Placement
from curvescan.odometry.step import UNMEASURED, StepOutcome
from curvescan.se2.uncertain import UncertainPose, identity

_SHARE = 0.65
"""Share of the last score below which a doubtful match is questioned: a sensor carried to another room leaves a score
of 0.2 to 0.5 after 0.9, and the next scan, 0.1 m on, is as sure of it, but scores no more."""

_SURE = 1.4
"""Log odds (0.8) of a match below which it is questioned."""

_NOTHING = -2.0
"""Log odds of a scan that has nothing to compare with what was in use."""

_ACROSS = 30.0  # metres, standard deviation: how far a sensor is carried unseen
LOST_COVARIANCE = np.diag([_ACROSS**2, _ACROSS**2, math.pi**2])
"""Covariance of a motion of which nothing is known."""
LOST_COVARIANCE.setflags(write=False)


def open_gap(o: Observation, last: Localization, log_odds: float = 0.0) -> Gap | None:
    """Return the gap that begins with a scan that nothing shows surely; None where nothing could bridge it."""
    config, keyframe, previous = o.config.keyframes, last.keyframe, o.state.previous
    if config.max_gap == 0:
        return None
    before = [
        k for k in (keyframe, o.state.older) if k is not None and o.matching.matcher.can_be_reference(k.scan.features)
    ]
    if previous is not None and previous is not keyframe.scan:
        before.insert(0, last.as_keyframe(previous, o.index - 1, config.variance_retained))
    return Gap(before=tuple(before[:2]), n_scans=1, log_odds=log_odds) if before else None


def settle_gap(o: Observation, placement: Placement) -> Placement:
    """Return the placement of one more scan in a gap: RELOCALIZED, LOST, or as it is while neither is likely enough.

    A scan that matches nothing, not even the one before it, says nothing: no track begins with it.
    """
    gap = placement.gap
    if gap is None:
        return placement
    found, said, keyframe = _best_match(o, placement, gap)
    counts, longest = placement.outcome not in UNMEASURED, o.config.keyframes.max_gap
    # scans of one place err alike: their mean
    gap = gap._replace(n_scans=gap.n_scans + counts, log_odds=gap.log_odds + counts * said / longest)
    is_last = counts and gap.n_scans > longest
    if found is not None and (said >= CERTAIN or (is_last and gap.log_odds > 0.0)):
        joined = Localization(
            keyframe=keyframe, pose_keyframe_scan=found.pose_keyframe_scan, is_measured=found.is_fully_observed
        )
        placement = placement._replace(outcome=StepOutcome.RELOCALIZED, localization=joined, gap=None)
        return with_keyframe(o, placement._replace(match=found.result, reference=keyframe.index))
    if not is_last or o.prediction.is_measured or gap.log_odds > 0.0:  # wheels or the motions since carried the track
        return placement._replace(gap=None if is_last else gap)
    return with_keyframe(o, _lost(placement))


def question_link(o: Observation, placement: Placement, last: Localization, log_odds: float) -> Placement | None:
    """Return the placement of a scan that what was in use hardly shows, in a gap; None where the match is sure.

    Its motion is taken, but only a later match with what was in use before it shows that it was not carried away.
    """
    result = placement.match
    if result is None or placement.gap is not None or log_odds >= _SURE or not result.score < _SHARE * o.state.score:
        return None
    gap = open_gap(o, last, log_odds)
    return None if gap is None else with_keyframe(o, placement._replace(gap=gap))


def with_keyframe(o: Observation, placement: Placement) -> Placement:
    """Return the placement with the scan as a new keyframe."""
    share = o.config.keyframes.variance_retained
    keyframe = placement.localization.as_keyframe(placement.current, o.index, share)
    return placement._replace(localization=Localization(keyframe=keyframe, pose_keyframe_scan=identity()))


def _best_match(o: Observation, placement: Placement, gap: Gap) -> tuple[GatedMatch | None, float, Keyframe]:
    """Return the surest match with what was in use before a gap, within what a sensor moves unseen, and with what.

    Between them what the matches say: log odds that the sensor is still near.
    """
    best, said, keyframe = None, -CERTAIN, gap.before[0]
    for one in gap.before:
        expected = placement.localization.relative_to(one)
        expected = UncertainPose(expected.pose, expected.covariance + o.prediction.recovery)
        # the expectation is the same in all matches of a gap, and must not count in each
        known = UncertainPose(expected.pose, WIDE_PRIOR.covariance)
        result = o.matching.matcher.match(one.scan.features, placement.current.features, known)
        gated = gate(result, expected, o.prediction, o.config.motion)
        if gated.is_plausible and (best is None or result.confidence > best.result.confidence):
            best, said, keyframe = gated, gated.log_odds, one
        elif best is None and not result.ok:
            found = result.candidates
            said = max(said, min(-math.log(odds_against(found[0], found)), 0.0) if found else _NOTHING)
    return best, said, keyframe


def _lost(placement: Placement) -> Placement:
    """Return the placement as the begin of a new track: how it lies to the old one is unknown."""
    here, motion = placement.localization.pose_keyframe_scan, placement.step_motion
    unknown = UncertainPose(here.pose, here.covariance + LOST_COVARIANCE)
    return placement._replace(
        outcome=StepOutcome.LOST,
        localization=Localization(placement.localization.keyframe, unknown),
        step_motion=UncertainPose(motion.pose, motion.covariance + LOST_COVARIANCE),
        gap=None,
    )
