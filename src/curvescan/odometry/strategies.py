"""How a scan is placed; nothing here changes any state.

0. The first scan is the origin.
1. ``_track``: matched with the keyframe in use or with the previous scan.
2. ``_extrapolate``: the expected motion is taken, until what was in use before the failure matches; if nothing does
   for a few scans the track is lost, and starts anew.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from curvescan import se2
from curvescan.matchers import PreparedScan
from curvescan.odometry.config import KeyframesConfig
from curvescan.odometry.gaps import open_gap, question_link, settle_gap, with_keyframe
from curvescan.odometry.measurement import GatedMatch
from curvescan.odometry.observation import Keyframe, Localization, Observation, Placement
from curvescan.odometry.step import StepOutcome
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse


class _Attempt(NamedTuple):
    """The better of the matches with the keyframe in use and with the previous scan."""

    gated: GatedMatch  # the match
    outcome: StepOutcome  # MATCHED with the keyframe, CHAINED with the previous scan
    keyframe: Keyframe  # the one it was matched with
    origin: UncertainPose  # the last scan seen from it
    current: PreparedScan  # the scan, as it was deskewed for it


def place(o: Observation) -> Placement:
    """Return where a scan is."""
    last = o.state.localization
    if last is None:
        keyframe = Keyframe(scan=o.current, index=o.index, pose_map_keyframe=identity())
        return Placement(
            outcome=StepOutcome.STARTED,
            localization=Localization(keyframe=keyframe, pose_keyframe_scan=identity()),
            current=o.current,
            motion=o.state.motion.advanced(o.prediction),
            step_motion=identity(),
        )
    attempt, p = _try_references(o, last, o.current), o.prediction
    if not attempt.gated.is_accepted and p.is_measured and o.is_bent(p.motion.pose, p.repeated.pose):
        # by an odometry that leaped, on say: a sweep that it bent matches nothing
        other = _try_references(o, last, o.prepared(p.repeated.pose))
        attempt = other if other.gated.is_accepted else attempt
    return _track(o, last, attempt) or _extrapolate(o, last, attempt)


def _try_references(o: Observation, last: Localization, current: PreparedScan) -> _Attempt:
    """Return the match with the keyframe in use or, where that leaves doubt and it does better, the previous scan.

    Where neither shows the scan near the expected motion, the last one is tried as far around as a sensor moves unseen:
    a robot stops, or begins to turn, at once.
    """
    matching, previous = o.matching, o.state.previous
    prediction, rules = o.prediction, matching.config.keyframes
    attempt = nearest = _Attempt(
        gated=matching.match(last.keyframe.scan, current, last.pose_keyframe_scan, prediction),
        outcome=StepOutcome.MATCHED,
        keyframe=last.keyframe,
        origin=last.pose_keyframe_scan,
        current=current,
    )
    if attempt.gated.is_confident(rules.min_score):
        return attempt
    if previous is not None and previous is not last.keyframe.scan:
        second = matching.match(previous, current, identity(), prediction)
        keyframe = last.as_keyframe(previous, o.index - 1, rules.variance_retained)
        nearest = _Attempt(second, StepOutcome.CHAINED, keyframe, identity(), current)
        attempt = nearest if second.is_better_than(attempt.gated, rules.min_score) else attempt
    if attempt.gated.is_accepted or prediction.is_measured or not matching.config.motion.is_fused:
        return attempt
    return nearest._replace(gated=matching.match_around(nearest.keyframe.scan, current, nearest.origin, prediction))


def _track(o: Observation, last: Localization, attempt: _Attempt) -> Placement | None:
    """Return where the keyframe in use or the previous scan shows a scan; None where neither does."""
    config = o.config.keyframes
    if not attempt.gated.is_accepted:
        return None
    attempt = _with_better_sweep(o, attempt)
    gated, keyframe, result = attempt.gated, attempt.keyframe, attempt.gated.result
    expected = o.prediction.repeated if gated.is_by_last_motion else o.prediction.motion
    measured = compose(inverse(attempt.origin), gated.measured)
    if not gated.is_plausible and not gated.is_opened:
        expected = UncertainPose(expected.pose, expected.covariance + o.prediction.recovery)
    motion = fuse(expected, measured)[0]
    localization = Localization(
        keyframe=keyframe, pose_keyframe_scan=gated.pose_keyframe_scan, is_measured=gated.is_fully_observed
    )
    placement = Placement(
        outcome=attempt.outcome,
        localization=localization,
        current=attempt.current,
        motion=o.state.motion.updated(o.prediction, motion, is_fully_observed=gated.is_fully_observed),
        # as the poses have it
        step_motion=UncertainPose(se2.between(attempt.origin.pose, gated.pose_keyframe_scan.pose), motion.covariance),
        gap=o.state.gap,
        match=result,
        is_prior_rejected=gated.is_prior_rejected,
        reference=keyframe.index,
    )
    questioned = question_link(o, placement, last, gated.log_odds)
    if questioned is not None:
        return questioned
    settled = settle_gap(o, placement)
    if settled.outcome is not placement.outcome or not _is_leaving(localization, result.score, config):
        return settled
    return with_keyframe(o, settled)


def _extrapolate(o: Observation, last: Localization, failed: _Attempt) -> Placement:
    """Return where the expected motion leads; the scan becomes the next reference if it can be one."""
    is_held, motion = o.state.motion.is_exhausted(o.prediction), o.prediction.motion
    motion = o.state.motion.held(motion) if is_held else motion
    gap = o.state.gap or open_gap(o, last)
    placement = Placement(
        outcome=StepOutcome.HELD if is_held else StepOutcome.PREDICTED,
        localization=Localization(last.keyframe, compose(last.pose_keyframe_scan, motion)),
        current=o.current,
        motion=o.state.motion.updated_without_match(o.prediction, motion),
        step_motion=motion,
        gap=gap,
        match=failed.gated.result,
        reference=failed.keyframe.index,
    )
    # the next update of the wheels says where the sensor is, and not where it was at this scan
    if o.prediction.is_missed:
        return placement._replace(is_reference=False)
    if not o.matching.matcher.can_be_reference(o.current.features):
        return placement
    settled = placement if o.state.gap is None else settle_gap(o, placement)
    if settled.outcome is StepOutcome.RELOCALIZED:  # how it moves by now is not known
        still = o.state.motion.updated(o.prediction, identity(), is_fully_observed=False)
        return settled._replace(motion=still)
    return with_keyframe(o, settled)  # a robot is never stuck on an old reference


def _with_better_sweep(o: Observation, attempt: _Attempt) -> _Attempt:
    """Return the match once more where it found a motion that deskews the sweep better than the expected one."""
    if not o.is_deskewed:
        return attempt
    found = se2.between(attempt.origin.pose, attempt.gated.pose_keyframe_scan.pose)
    if not o.is_bent(o.prediction.motion.pose, found):
        return attempt
    if o.state.first is not None:  # its velocity was not known
        first = o.matching.prepare(o.prediction.deskewer.deskewed(o.state.first, found))
        attempt = attempt._replace(keyframe=replace(attempt.keyframe, scan=first))
    better = o.prepared(found)
    again = o.matching.match(attempt.keyframe.scan, better, attempt.origin, o.prediction)
    return attempt._replace(gated=again, current=better) if again.standing >= attempt.gated.standing else attempt


def _is_leaving(localization: Localization, score: float, config: KeyframesConfig) -> bool:
    """Return whether a scan is so far from the keyframe, or shares so little with it, that another is due."""
    x, y, theta = localization.pose_keyframe_scan.pose.tolist()
    is_far = math.hypot(x, y) >= config.distance or abs(theta) >= config.turn
    return is_far or score < config.min_score
