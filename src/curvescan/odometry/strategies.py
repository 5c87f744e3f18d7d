"""How a scan is placed: by a match with the keyframe or the previous scan, with what was known before an outage, or not.

Each function takes the observation and returns a placement or None; none changes any state.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from curvescan import se2
from curvescan.matchers import PreparedScan
from curvescan.odometry.fits import SURE, Fit, fitted
from curvescan.odometry.observation import Observation, Placement, Reference
from curvescan.odometry.outage import Anchor, Outage
from curvescan.odometry.step import StepOutcome
from curvescan.odometry.track import Track
from curvescan.se2.uncertain import between, identity

_MAX_REPEATS = 5
"""Scans without a match in a row after which the last motion is no longer repeated."""

LOST_COVARIANCE = np.diag([10.0**2, 10.0**2, math.pi**2])
"""Covariance of where a sensor is that was carried away: within a building, in any direction."""
LOST_COVARIANCE.setflags(write=False)


def start(o: Observation) -> Placement:
    """Return the placement of the first scan: the origin, and the first keyframe."""
    current = o.prepared(np.zeros(3))
    track = Track.at(identity(), identity(), np.zeros(3), o.state.motion.unknown_speed)
    keyframe = Reference(current, o.index)
    return Placement(StepOutcome.STARTED, track, track, current, keyframe, o.state.motion)


def track(o: Observation, last: Track) -> Placement:
    """Return where the keyframe in use or the previous scan shows a scan; where the motion leads if neither does."""
    state, config = o.state, o.config
    fits = [(StepOutcome.MATCHED, *_first(o, last))]
    for outcome, reference, before, by_wheels in _tries(o, last):
        best = max(fits, key=lambda one: one[2].rank(config.keyframes.min_score))[2]
        is_retry = outcome is StepOutcome.MATCHED
        if best.is_accepted if is_retry else _is_confident(best, config.keyframes.min_score):
            continue
        fits.append((outcome, reference, o.fit(reference, before, o.current, by_wheels=by_wheels)))
    outcome, reference, fit = max(fits, key=lambda one: one[2].rank(config.keyframes.min_score))
    if not fit.is_accepted:
        return _extrapolated(o, last, fits[0][2])
    current = o.current
    before = _chained(o) if outcome is StepOutcome.CHAINED else last
    reference, fit, current = _with_better_sweep(o, reference, before, fit)
    motion = state.motion
    if fit.is_full and not fit.is_surprising and config.is_filtered:
        motion = motion.learned(last, fit.track, o.wheels, o.seconds)
    as_keyframe = fit.as_keyframe(config.keyframes.variance_retained)
    placement = Placement(outcome, fit.track, as_keyframe, current, reference, motion, fit, reference.number)
    return with_keyframe(o, placement) if _is_leaving(o, fit) else placement


def _first(o: Observation, last: Track) -> tuple[Reference, Fit]:
    assert o.state.keyframe is not None
    return o.state.keyframe, o.fit(o.state.keyframe, last, o.current)


def _tries(o: Observation, last: Track) -> Iterator[tuple[StepOutcome, Reference, Track, bool]]:
    """Yield what else a scan may be matched with: the previous scan; the keyframe without the wheels, or at rest."""
    state = o.state
    assert state.keyframe is not None
    if state.previous is not None and state.previous.number != state.keyframe.number:
        yield StepOutcome.CHAINED, state.previous, _chained(o), True
    if not o.config.is_filtered:
        return
    if o.wheels is not None:
        yield StepOutcome.MATCHED, state.keyframe, last, False
    if last.speed.any():
        yield StepOutcome.MATCHED, state.keyframe, last.stopped(state.motion.unknown_speed), False


def _chained(o: Observation) -> Track:
    """Return the track seen from the previous scan, which becomes the keyframe."""
    assert o.state.as_keyframe is not None
    return o.state.as_keyframe.with_keyframe()


def _is_confident(fit: Fit, min_score: float) -> bool:
    """Return whether nothing speaks against a match. A matcher without a score is trusted."""
    return fit.is_accepted and fit.is_full and not fit.is_surprising and not fit.result.score < min_score


def _is_leaving(o: Observation, fit: Fit) -> bool:
    """Return whether a scan is so far from the keyframe, or shares so little with it, that another is due."""
    config = o.config.keyframes
    x, y, theta = fit.track.here.tolist()
    is_far = math.hypot(x, y) >= config.distance or abs(theta) >= config.turn
    return (is_far or fit.result.score < config.min_score) and o.matching.is_reference(o.current)


def with_keyframe(o: Observation, placement: Placement) -> Placement:
    """Return the placement with the scan as the keyframe."""
    made = placement.as_keyframe.with_keyframe()
    return placement._replace(track=made, as_keyframe=made, keyframe=Reference(placement.current, o.index))


def _with_better_sweep(
    o: Observation, reference: Reference, before: Track, fit: Fit
) -> tuple[Reference, Fit, PreparedScan]:
    """Return the match once more where it found a motion that deskews the sweep better than the expected one."""
    if not o.config.deskew or o.scan.time_increment == 0.0:
        return reference, fit, o.current
    expected, found = o.motion_of(fit.expected), se2.between(before.here, fit.track.here)
    if not o.deskewer.is_worth_again(o.scan, expected, found):
        return reference, fit, o.current
    better = o.prepared(found)
    if o.state.first is not None:  # its velocity was not known
        first = o.matching.prepare(o.deskewer.deskewed(o.state.first, found))
        reference = Reference(first, reference.number)
    again = o.fit(reference, before, better, by_wheels=not fit.is_prior_rejected)
    if again.rank(0.0)[:3] >= fit.rank(0.0)[:3]:
        return reference, again._replace(is_prior_rejected=fit.is_prior_rejected), better
    return reference, fit, o.current


def _extrapolated(o: Observation, last: Track, failed: Fit) -> Placement:
    """Return where the expected motion leads; the scan becomes the keyframe if it can be one."""
    n_failed, unknown = o.state.n_failed + 1, o.state.motion.unknown_speed
    is_held = n_failed > _MAX_REPEATS and not o.is_wheeled
    here = o.predicted(last.stopped(unknown) if is_held else last)
    if not o.is_wheeled:
        here = here.accelerated(np.diag(unknown))
    assert o.state.keyframe is not None
    outcome = StepOutcome.HELD if is_held else StepOutcome.PREDICTED
    keyframe = o.state.keyframe
    placement = Placement(outcome, here, here, o.current, keyframe, o.state.motion, failed, keyframe.number, n_failed)
    if o.is_missed:  # the next update of the wheels says where the sensor is, and not where it was at this scan
        return placement._replace(is_reference=False)
    return with_keyframe(o, placement) if o.matching.is_reference(o.current) else placement


def doubted(o: Observation, last: Track, placement: Placement) -> Placement:
    """Return a placement with what it says on whether the sensor is still where it was tracked."""
    if not o.config.is_filtered:
        return placement
    fit = placement.fit
    outage = o.state.outage or _opened(o, last)
    confidence = 0.0
    if fit is not None and placement.reference is not None and placement.reference < outage.first:
        confidence = fit.confidence
    outage = outage._replace(is_broken=outage.is_broken or placement.n_failed > 0, seconds=outage.seconds + o.seconds)
    for anchor in outage.anchors if o.state.outage is not None and confidence < SURE else ():
        if anchor.number != placement.reference:
            known = _fit_with(o, placement, anchor, outage)
            confidence = max(confidence, known.confidence)
            if outage.is_broken and known.is_full and known.confidence >= SURE:
                return _reconnected(o, placement, anchor, known)
    after = outage.after(confidence, _nearness(o, placement, outage))
    is_lost = after.log_odds > 0.0 and not outage.is_lost and not o.is_wheeled
    if is_lost:
        after = after._replace(is_lost=True, n_scans=0)
        placement = placement._replace(
            outcome=StepOutcome.LOST,
            track=placement.track.displaced(LOST_COVARIANCE),
            as_keyframe=placement.as_keyframe.displaced(LOST_COVARIANCE),
        )
    if after.is_over or (o.is_wheeled and after.log_odds > 0.0):
        return placement
    return placement._replace(outage=after)


def _nearness(o: Observation, placement: Placement, outage: Outage) -> float:
    """Return how well a scan should see what was known before an outage: 1 from there, less with each keyframe's distance."""
    if not o.matching.is_reference(o.current) or not outage.anchors:
        return 0.0
    rules, here = o.config.keyframes, placement.track.pose_map_scan.pose
    x, y, theta = np.abs(se2.between(outage.anchors[0].place.pose, here)).tolist()
    return float(1.0 / (1.0 + (math.hypot(x, y) / max(rules.distance, 0.1)) ** 2 + (theta / max(rules.turn, 0.1)) ** 2))


def _opened(o: Observation, last: Track) -> Outage:
    """Return an outage that begins with this scan."""
    state, anchors = o.state, []
    assert state.keyframe is not None
    if state.previous is not None and state.previous.number != state.keyframe.number:
        anchors.append(Anchor(state.previous.scan, state.previous.number, last.pose_map_scan))
    if o.matching.is_reference(state.keyframe.scan):
        anchors.append(Anchor(state.keyframe.scan, state.keyframe.number, last.pose_map_keyframe))
    return Outage(tuple(anchors), o.index)


def _fit_with(o: Observation, placement: Placement, anchor: Anchor, outage: Outage) -> Fit:
    """Return the match with what was known before an outage; the sensor is as far as it may have come since."""
    prior = between(anchor.place, placement.track.pose_map_scan)
    if outage.is_lost or np.linalg.eigvalsh(prior.cov)[0] <= 0.0:
        prior = o.state.motion.reach(prior.pose, outage.seconds)
    result = o.matching.matcher.match(anchor.scan.features, placement.current.features, prior)
    unknown = o.state.motion.unknown_speed
    expected = Track.at(anchor.place, prior, np.zeros(3), unknown)
    fit = fitted(result, expected, o.config, unknown, o.seconds)
    return fit._replace(confidence=0.0) if fit.is_surprising else fit


def _reconnected(o: Observation, placement: Placement, anchor: Anchor, fit: Fit) -> Placement:
    """Return the placement by a sure match with what was known before an outage, which ends it."""
    tracked = Track.at(anchor.place, fit.track.seen, np.zeros(3), o.state.motion.unknown_speed)
    joined = placement._replace(
        outcome=StepOutcome.RELOCALIZED,
        track=tracked,
        as_keyframe=tracked,
        keyframe=Reference(anchor.scan, anchor.number),
        fit=fit,
        reference=anchor.number,
        n_failed=0,
        outage=None,
    )
    return with_keyframe(o, joined)
