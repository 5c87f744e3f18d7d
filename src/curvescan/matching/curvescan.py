"""The matcher "curvescan": hypotheses from CF-SMA's kind of corners, verified, refined, and judged.

It starts where CF-SMA starts, from the characteristic points of surfaces, and closes its two holes. A corner with the
two directions that leave it is a frame, and one pair of frames a pose, so that no single wrong pair decides; and the
pose is refined point to line, so that no index-by-index pairs cost accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.consensus.config import ConsensusConfig
from curvescan.consensus.features import ConsensusFeatures, extract_features
from curvescan.consensus.hypotheses import most_voted, pair_frames
from curvescan.consensus.information import covariance, pose_information
from curvescan.consensus.labels import compare_readings
from curvescan.consensus.refinement import refine
from curvescan.consensus.turns import lattice, slides, turns
from curvescan.consensus.verification import best_beside, select
from curvescan.matching.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.types import Bools, Codes, Floats, Pose

_STAND_STILL = np.zeros(3)
_LABELS = np.array([Label.NEW, Label.MATCHED, Label.MOVED], dtype=np.uint8)
_MIN_PROBES = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way.

    Attributes
    ----------
    reference, current : ConsensusFeatures
        Features of both scans.
    n_tried : int
        Poses verified.
    candidates : (k, 3) float64
        The best of them that differ, after a quick refinement, best first.
    scores : (k,) float64
        How well the scans agree there, at most 1.
    """

    reference: ConsensusFeatures
    current: ConsensusFeatures
    n_tried: int
    candidates: Floats
    scores: Floats


class CurvescanMatcher:
    """The default matcher: guess-free, and certain of itself or silent."""

    def __init__(self, config: ConsensusConfig) -> None:
        self.config = config
        refinement = config.refinement
        self._quick = np.array(refinement.quick)
        self._closer = np.array(refinement.closer)
        self._full = np.array(refinement.full)
        self._offsets = np.array(config.information.offsets)

    def prepare(self, scan: LaserScan) -> ConsensusFeatures:
        """Return the surfels, corners and polar view of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: ConsensusFeatures) -> bool:
        """Return whether the scan has surfaces to compare."""
        return len(features.view.probes) >= _MIN_PROBES

    def match(
        self, reference: ConsensusFeatures, current: ConsensusFeatures, guess: Pose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`.

        A guess is one more hypothesis. It is taken without a look at others when many readings agree there and fix
        both axes, and it decides between poses that explain the scans as well as each other.
        """
        ref, cur = reference, current
        if not (self.can_be_reference(ref) and self.can_be_reference(cur)):
            return _silence(Outcome.NO_SEGMENTS, _trace(ref, cur))
        trace = (guess is not None and self._follow(ref, cur, guess)) or self._search(
            ref, cur, guess
        )
        poses, scores = self._finalists(trace)
        if not len(poses):
            return _silence(Outcome.UNSUPPORTED, trace)
        poses, scores = self._prefer(guess, poses, scores)
        pose = poses[0]
        codes_cur, partner_cur = compare_readings(cur.view.surfels, ref.view, pose, 0.01)
        codes_ref, partner_ref = compare_readings(
            ref.view.surfels, cur.view, se2.inverse(pose), 0.01
        )
        told, feigned, axes, units = pose_information(
            ref.view.surfels, partner_ref, cur.view.surfels, partner_cur, pose
        )
        is_open = self._open_directions(trace, poses, scores, told, feigned, axes, units)
        cov = covariance(told, axes, units, is_open, self.config.information.open_sigma)
        outcome = self._judge(poses, scores, is_open, axes[:, 0] * units)
        if outcome is not Outcome.MATCHED:
            return _silence(outcome, trace, scores)
        return MatchResult(
            method="curvescan",
            outcome=outcome,
            pose=pose,
            covariance=cov,
            n_matched=int(np.count_nonzero(partner_cur >= 0)),
            trace=trace,
            labels_reference=_labels(ref, codes_ref),
            labels_current=_labels(cur, codes_cur),
            weak_direction=axes[:, 0] * units if is_open.any() else None,
            score=float(scores[0]),
            runner_up=_runner_up(scores),
        )

    def _follow(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose
    ) -> CurvescanTrace | None:
        """Return the guess refined, when it is trusted."""
        verification, steps = self.config.verification, self.config.hypotheses
        near = refine(guess[np.newaxis], ref.view, cur.view, self._quick)
        near, scores = select(near, ref.view, cur.view, *verification.close, 1, 64, 0.3)
        if (
            len(near)
            and scores[0] > verification.trusted_score
            and _distance(near[0], guess) < 2.0 * steps.lattice_step
            and not len(slides(near, ref.view, cur.view, steps.lattice_step, 1, 0.1))
        ):
            return _trace(ref, cur, 1, near, scores)
        return None

    def _search(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose | None
    ) -> CurvescanTrace:
        """Return the best poses of all that frames, turns and the guess propose."""
        config = self.config.hypotheses
        turned = turns(ref.directions, cur.directions, config.n_turns, _STAND_STILL)
        if guess is not None:
            turned = np.concatenate((guess[np.newaxis], turned))
        pairs = pair_frames(
            ref.frames, cur.frames, ref.view, cur.view, config.turn_tolerance, config.max_pairs
        )
        voted = most_voted(pairs, config.cell, 0.5 * config.cell, config.max_tried)
        tried = np.concatenate((turned, voted))
        candidates, scores = self._try(ref, cur, tried)
        n_tried = len(tried)
        if not len(scores) or scores[0] < self.config.verification.doubtful_score:
            reach = round(config.lattice_reach / config.lattice_step)
            dense = lattice(turned, config.lattice_step, reach)
            candidates, scores = self._try(ref, cur, np.concatenate((candidates, dense)))
            n_tried += len(dense)
        return _trace(ref, cur, n_tried, candidates, scores)

    def _try(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, poses: Floats
    ) -> tuple[Floats, Floats]:
        """Return the best of many poses, refined on the probes, best first, and their scores."""
        config, steps, views = (
            self.config.verification,
            self.config.hypotheses,
            (ref.view, cur.view),
        )
        chosen, _ = select(poses, *views, *config.rough, config.n_kept, 6, 0.3)
        quick = refine(chosen, *views, self._quick)
        n_slides = round(steps.slide_reach / steps.lattice_step)
        slid = slides(quick[:2], *views, steps.lattice_step, n_slides, 0.1)
        if len(slid):
            every = np.concatenate((quick, slid))
            chosen, _ = select(every, *views, *config.slid, config.n_kept + 1, 12, 0.3)
            quick = refine(chosen, *views, self._quick)
        return select(quick, *views, *config.close, 3, 64, 0.3)

    def _finalists(self, trace: CurvescanTrace) -> tuple[Floats, Floats]:
        """Return the best pose, refined on all readings, and its rival if it comes near, and their scores."""
        ref, cur = trace.reference, trace.current
        if not len(trace.scores):
            return trace.candidates, trace.scores
        near = trace.candidates[trace.scores > 0.75 * trace.scores[0]][:2]
        closer = refine(near, ref.view, cur.view, self._closer)
        final = refine(closer, ref.whole, cur.whole, self._full)
        return select(final, ref.view, cur.view, *self.config.verification.fine, 2, 64, 0.2)

    def _as_good(self, scores: Floats) -> bool:
        share, margin = self.config.verification.ambiguity
        return len(scores) > 1 and scores[1] > min(share * scores[0], scores[0] - margin)

    def _prefer(self, guess: Pose | None, poses: Floats, scores: Floats) -> tuple[Floats, Floats]:
        """Return the poses, or of two that are as good as each other the one that the guess is clearly nearer to."""
        if guess is None or not self._as_good(scores):
            return poses, scores
        first, second = _distance(poses[0], guess), _distance(poses[1], guess)
        if 2.0 * first < second:
            return poses[:1], scores[:1]
        if 2.0 * second < first:
            return poses[1:], scores[1:]
        return poses, scores

    def _open_directions(
        self,
        trace: CurvescanTrace,
        poses: Floats,
        scores: Floats,
        told: Floats,
        feigned: Floats,
        axes: Floats,
        units: Floats,
    ) -> Bools:
        """Return which principal directions the scans leave open, (3,) the least informed first."""
        config, views = self.config.information, (trace.reference.view, trace.current.view)
        is_open: Bools = (told < 2.0 * feigned) | (told < config.max_sigma**-2)
        if is_open[0] or told[0] > config.weak_ratio * told[1]:
            return is_open
        beside = best_beside(
            poses[0], axes[:, 0] * units, self._offsets, *views, *self.config.verification.fine
        )
        is_open[0] = beside > config.flat_score * scores[0]
        is_open[0] |= self._as_good(scores) and _is_on_the_way(
            axes[:, 0] * units, poses[0], poses[1], config.way_tolerance
        )
        return is_open

    def _judge(self, poses: Floats, scores: Floats, is_open: Bools, weakest: Floats) -> Outcome:
        """Return whether the best pose may be called the match."""
        if scores[0] < self.config.verification.min_score or is_open.all():
            return Outcome.UNSUPPORTED
        if self._as_good(scores) and not (
            # a rival along an open direction is no rival: the covariance says as much
            is_open[0]
            and _is_on_the_way(
                weakest, poses[0], poses[1], self.config.information.way_tolerance
            )
        ):
            return Outcome.AMBIGUOUS
        return Outcome.MATCHED


def _trace(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    n_tried: int = 0,
    candidates: Floats | None = None,
    scores: Floats | None = None,
) -> CurvescanTrace:
    return CurvescanTrace(
        reference=ref,
        current=cur,
        n_tried=n_tried,
        candidates=np.empty((0, 3)) if candidates is None else candidates,
        scores=np.empty(0) if scores is None else scores,
    )


def _difference(pose: Pose, origin: Pose) -> Pose:
    return np.array(
        [
            pose[0] - origin[0],
            pose[1] - origin[1],
            math.remainder(pose[2] - origin[2], 2.0 * math.pi),
        ]
    )


def _distance(a: Pose, b: Pose) -> float:
    """Return how far apart two poses are: metres, or radians times 2 m, whichever is more."""
    x, y, theta = _difference(a, b).tolist()
    return float(max(math.hypot(x, y), 2.0 * abs(theta)))


def _is_on_the_way(direction: Pose, pose: Pose, other: Pose, tolerance: float) -> bool:
    """Return whether a motion that starts in a direction and keeps to it, a line or an arc, passes another pose."""
    x, y, theta = _difference(other, pose).tolist()
    if abs(direction[2]) < 0.05 * math.hypot(direction[0], direction[1]):
        norm = math.hypot(direction[0], direction[1])
        across = abs(direction[0] * y - direction[1] * x) / norm
        return max(across, abs(theta)) < tolerance
    # the sensor circles around this place, seen from the pose
    cx, cy = -direction[1] / direction[2], direction[0] / direction[2]
    c, s = math.cos(theta), math.sin(theta)
    arc_x, arc_y = cx - c * cx + s * cy, cy - s * cx - c * cy
    return math.hypot(x - arc_x, y - arc_y) < tolerance * (1.0 + abs(theta))


def _runner_up(scores: Floats) -> float:
    return float(scores[1]) if len(scores) > 1 else math.nan


def _labels(features: ConsensusFeatures, codes: Codes) -> Codes:
    labels = np.zeros(features.n_beams, dtype=np.uint8)
    labels[features.beam_idx] = _LABELS[codes]
    return labels


def _silence(outcome: Outcome, trace: CurvescanTrace, scores: Floats | None = None) -> MatchResult:
    """Return a result without a pose."""
    labels = []
    for features in (trace.reference, trace.current):
        one = np.zeros(features.n_beams, dtype=np.uint8)
        one[features.beam_idx] = Label.UNMATCHED
        labels.append(one)
    return MatchResult(
        method="curvescan",
        outcome=outcome,
        pose=NO_POSE,
        covariance=NO_COVARIANCE,
        n_matched=0,
        trace=trace,
        labels_reference=labels[0],
        labels_current=labels[1],
        score=math.nan if scores is None else float(scores[0]),
        runner_up=math.nan if scores is None else _runner_up(scores),
    )
