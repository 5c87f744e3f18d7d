"""How a scan is placed: a table of strategies, each of which places it or leaves it to the next.

0. ``start``: the first scan is the origin.
1. ``track``: matched with the keyframe in use or with the previous scan.
2. ``bridge``: matched with what was in use before the last failure.
3. ``relocalize``: matched with earlier keyframes, without a guess.
4. ``extrapolate``: the expected motion is taken; after a few such scans the track is lost, and starts anew.

Each takes the observation and what its first matches gave, and returns a placement or None; none changes any state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.matchers import PreparedScan
from curvescan.odometry.config import KeyframesConfig
from curvescan.odometry.disputes import Dispute, is_settled, remembered
from curvescan.odometry.gaps import close_gap, open_gap, question_link, widen_gap, with_keyframe
from curvescan.odometry.gating import GatedMatch
from curvescan.odometry.keyframes import Keyframe, Localization
from curvescan.odometry.measurement import as_measurement, doubtful_pose
from curvescan.odometry.observation import Attempt, Observation, Placement
from curvescan.odometry.relocalization import Closure, find_loop_closure, search_loop_closures
from curvescan.odometry.step import StepOutcome
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse

_SHARE_AFTER_CLOSURE = 0.7
"""After a loop closure a new keyframe is due at this share of the usual distance: the old one was not made for here."""

_TURN_OF_CLOSURE = 1.5
"""Earlier keyframes whose direction differs by more than this many `turn` are not tried for a loop closure."""

Strategy: TypeAlias = Callable[[Observation, Attempt], Placement | None]
"""Places a scan, or leaves it to the next strategy."""


def start(observation: Observation) -> Placement:
    """Return the placement of the first scan: the origin, and the first keyframe."""
    o = observation
    is_blank = o.matching.as_reference(o.current) is None
    keyframe = o.keyframes.make(o.current, o.index, None, is_predicted=is_blank)
    return Placement(
        outcome=StepOutcome.STARTED,
        localization=Localization(keyframe=keyframe, pose_keyframe_scan=identity()),
        current=o.current,
        motion=o.state.motion.advanced(o.prediction),
        n_searches=0,
        step_motion=identity(),
        new_keyframes=(keyframe,),
    )


def track(observation: Observation, attempt: Attempt) -> Placement | None:
    """Return where the keyframe in use or the previous scan shows a scan, with a loop closure where there is one."""
    o, config = observation, observation.config.keyframes
    if not attempt.gated.is_accepted(config.least_score):
        return None
    keyframe = attempt.last.keyframe
    new_keyframes: tuple[Keyframe, ...] = ()
    if attempt.outcome is StepOutcome.CHAINED:
        keyframe = o.keyframes.make(attempt.reference, o.index - 1, attempt.last)
        new_keyframes = (keyframe,)
    sweep = _with_better_sweep(o, attempt, keyframe)
    gated, result = sweep.gated, sweep.gated.result
    expected = o.prediction.repeated if gated.is_by_last_motion else o.expected
    motion = fuse(expected, compose(inverse(attempt.origin), gated.measured or as_measurement(result)))[0]
    localization = Localization(
        keyframe=keyframe, pose_keyframe_scan=gated.pose_keyframe_scan, is_measured=gated.is_fully_observed
    )
    placement = Placement(
        outcome=attempt.outcome,
        localization=localization,
        current=sweep.current,
        motion=o.state.motion.updated(
            o.prediction, motion, is_plausible=gated.is_plausible, is_fully_observed=gated.is_fully_observed
        ),
        n_searches=max(o.state.n_searches - 1, 0),
        step_motion=_step_motion(o, attempt, gated),
        gap=o.state.gap,
        disputes=o.state.disputes,
        match=result,
        is_prior_rejected=gated.is_prior_rejected,
        reference=keyframe.index,
        used=(keyframe,),
        new_keyframes=new_keyframes,
        first_keyframe_scan=sweep.first,
    )
    questioned = question_link(o, placement, attempt.last)
    if questioned is not None:
        return questioned
    is_due = _is_leaving(localization, result.score, config)
    if placement.gap is not None:
        joined = close_gap(o, placement)
        if joined is not None:
            return joined
        placement = widen_gap(o, placement)
        if placement.outcome is StepOutcome.LOST:
            return with_keyframe(o, placement)
    return _close_loop(o, placement, is_due) if is_due or o.state.n_searches > 0 else placement


def bridge(observation: Observation, attempt: Attempt) -> Placement | None:
    """Return where the references from before the last failure show a scan; None where nothing has failed."""
    o, gap = observation, observation.state.gap
    if gap is None:
        return None
    placement = Placement(
        outcome=StepOutcome.RELOCALIZED,
        localization=attempt.last.moved(o.expected),
        current=o.current,
        motion=o.state.motion.updated(o.prediction, identity(), is_plausible=False, is_fully_observed=False),
        n_searches=o.state.n_searches,
        step_motion=o.expected,
        gap=gap,
    )
    return close_gap(o, placement)


def relocalize(observation: Observation, attempt: Attempt) -> Placement | None:
    """Return where earlier keyframes show a scan: anywhere around by confident matches, else near where it is expected."""
    o, config, last = observation, observation.config, attempt.last
    around, ahead = last.moved(o.prediction.inflated(config.motion)), last.moved(o.expected)
    # in a gap the keyframe in use is itself where it was expected: that others agree with it says nothing
    doubtful = _doubtful(attempt) if o.state.gap is None else None
    known = find_loop_closure(
        o.current, around, o.keyframes, config.keyframes, turn=math.pi, doubtful=doubtful
    ) or find_loop_closure(
        o.current, ahead, o.keyframes, config.keyframes, turn=math.pi, is_lost=True, doubtful=doubtful
    )
    if known is None:
        return None
    localization, result = known
    return Placement(
        outcome=StepOutcome.RELOCALIZED,
        localization=localization,
        current=o.current,
        motion=o.state.motion.updated(o.prediction, identity(), is_plausible=False, is_fully_observed=False),
        n_searches=o.state.n_searches,
        step_motion=o.prediction.inflated(config.motion),
        match=result,
        reference=localization.keyframe.index,
        used=(localization.keyframe,),
    )


def _doubtful(attempt: Attempt) -> Closure | None:
    """Return where the keyframe in use would have a scan, though the match with it failed."""
    pose = doubtful_pose(attempt.gated.result)
    if pose is None or attempt.outcome is not StepOutcome.MATCHED:
        return None
    localization = Localization(keyframe=attempt.last.keyframe, pose_keyframe_scan=pose, is_measured=True)
    return Closure(localization, attempt.gated.result)


def extrapolate(observation: Observation, attempt: Attempt) -> Placement:
    """Return where the expected motion leads; the scan becomes the next reference if it can be one."""
    o, last, failed = observation, attempt.last, attempt.gated.result
    # a match that was rejected: something did happen
    motion = o.prediction.inflated(o.config.motion) if failed.ok else o.expected
    is_held = o.state.motion.is_exhausted(o.prediction)
    if is_held:
        motion = UncertainPose(np.zeros(3), motion.cov)
    gap, new_keyframes = open_gap(o, last)
    placement = Placement(
        outcome=StepOutcome.HELD if is_held else StepOutcome.PREDICTED,
        localization=last.moved(motion),
        current=o.current,
        motion=o.state.motion.updated_without_match(o.prediction, motion),
        n_searches=o.config.keyframes.max_searches,
        step_motion=motion,
        gap=gap,
        match=failed,
        reference=last.keyframe.index,
        new_keyframes=new_keyframes,
    )
    # the next update of the wheels says where the sensor is, and not where it was at this scan
    if o.prediction.is_missed:
        return replace(placement, is_reference=False)
    if o.matching.as_reference(o.current) is None:
        return placement
    # a robot is never stuck on an old reference; but predicted keyframes must not push out measured ones
    is_unused = last.keyframe.is_predicted and last.keyframe.used == last.keyframe.index
    placement = replace(placement, obsolete=last.keyframe if is_unused else None)
    if gap is not None and not o.prediction.is_measured:
        placement = widen_gap(o, placement)
    return with_keyframe(o, placement, is_predicted=True)


STRATEGIES: tuple[Strategy, ...] = (track, bridge, relocalize, extrapolate)
"""In the order they are tried; the last one always places the scan."""


class _Sweep(NamedTuple):
    """A match, the scan as it was deskewed for it, and the first scan of the stream where that was deskewed anew."""

    gated: GatedMatch
    current: PreparedScan
    first: PreparedScan | None = None


def _with_better_sweep(o: Observation, attempt: Attempt, keyframe: Keyframe) -> _Sweep:
    """Return the match once more where it found a motion that deskews the sweep better than the expected one."""
    gated = attempt.gated
    if not o.config.deskew or o.scan.time_increment == 0.0:
        return _Sweep(gated, o.current)
    found = se2.between(attempt.origin.pose, gated.pose_keyframe_scan.pose)
    if not o.deskewer.is_worth_again(o.scan, o.expected.pose, found):
        return _Sweep(gated, o.current)
    better, reference, first = o.prepared(found), keyframe.scan, None
    if o.state.first is not None:  # its velocity was not known
        reference = first = o.matching.prepare(o.deskewer.deskewed(o.state.first, found))
    again = o.matching.match(reference, better, attempt.origin, o.prediction)
    if again.is_as_good_as(gated):
        return _Sweep(again, better, first)
    return _Sweep(gated, o.current, first)


def _is_leaving(localization: Localization, score: float, config: KeyframesConfig, share: float = 1.0) -> bool:
    """Return whether a scan is so far from the keyframe, or shares so little with it, that another is due."""
    x, y, theta = localization.pose_keyframe_scan.pose.tolist()
    is_far = math.hypot(x, y) >= share * config.distance or abs(theta) >= share * config.turn
    return is_far or score < config.min_score


def _step_motion(o: Observation, attempt: Attempt, gated: GatedMatch) -> UncertainPose:
    """Return the motion since the previous scan as the poses have it, with the covariance of expectation and match."""
    expected = o.prediction.repeated if gated.is_by_last_motion else o.expected
    if not gated.is_plausible:
        expected = UncertainPose(expected.pose, expected.cov + o.config.motion.recovery_covariance)
    measured = compose(inverse(attempt.origin), gated.measured or as_measurement(gated.result))
    pose = se2.between(attempt.origin.pose, gated.pose_keyframe_scan.pose)
    return UncertainPose(pose, fuse(expected, measured)[0].cov)


def _close_loop(o: Observation, placement: Placement, is_due: bool) -> Placement:
    """Return the placement by an earlier keyframe if one is known here; else the scan becomes a keyframe if one is due."""
    config = o.config.keyframes
    if not config.closes_loops:
        return with_keyframe(o, placement) if is_due else placement
    turn = math.pi if o.state.n_searches > 0 else _TURN_OF_CLOSURE * config.turn
    found, disputed = search_loop_closures(placement.current, placement.localization, o.keyframes, config, turn=turn)
    if found is None and disputed is not None:
        dispute = Dispute(
            by_chain=placement.localization.pose_map_scan.pose, by_closure=disputed.localization.pose_map_scan.pose
        )
        if is_settled(dispute, o.state.disputes, config):
            found = disputed
        else:
            disputes = remembered(dispute, o.state.disputes, config)
            placement = replace(placement, disputes=disputes)
    if found is not None:
        localization, result = found
        placement = replace(
            placement,
            outcome=StepOutcome.LOOP_CLOSED,
            localization=localization,
            n_searches=0,
            match=result,
            reference=localization.keyframe.index,
            used=(*placement.used, localization.keyframe),
            disputes=(),
        )
        is_due = _is_leaving(localization, result.score, config, _SHARE_AFTER_CLOSURE)
    return with_keyframe(o, placement) if is_due else placement
