"""The matcher "curvescan": hypotheses from CF-SMA's characteristic points, verified, refined, and judged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

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
from curvescan.types import Codes, Floats, Ints, Pose

_LABELS = np.array([Label.NEW, Label.MATCHED, Label.MOVED], dtype=np.uint8)
_QUICK, _CLOSER, _FULL, _OFFSETS = (
    np.array([0.06, 0.02]),
    np.array([0.03, 0.01]),
    np.array([0.0]),
    np.array([0.1, 0.2, 0.4]),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way.

    Attributes
    ----------
    reference, current : ConsensusFeatures
        Features of both scans.
    n_hypotheses : int
        Poses tried.
    candidates : (k, 3) float64
        Those refined, best first.
    scores : (k,) float64
        How well the scans agree at them, at most 1.
    """

    reference: ConsensusFeatures
    current: ConsensusFeatures
    n_hypotheses: int
    candidates: Floats
    scores: Floats
    beside: list = __import__('dataclasses').field(default_factory=list)


class CurvescanMatcher:
    """Guess-free, robust and certain of itself: the default matcher."""

    def __init__(self, config: ConsensusConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> ConsensusFeatures:
        """Return the surfels, characteristic points and polar frame of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: ConsensusFeatures) -> bool:
        """Return whether the scan has surfaces at all."""
        return len(features.probes) >= 6

    def match(
        self, reference: ConsensusFeatures, current: ConsensusFeatures, guess: Pose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`; the guess is one more hypothesis."""
        ref, cur = reference, current
        if not (self.can_be_reference(ref) and self.can_be_reference(cur)):
            return _failure(Outcome.NO_SEGMENTS, ref, cur, None)
        ref_scan, cur_scan = _arrays(ref), _arrays(cur)
        probes = (*ref_scan, *cur_scan)
        readings = (ref.surfels, *ref_scan[1:], cur.surfels, *cur_scan[1:])
        candidates, scores, n_tried = self._search(ref, cur, guess, probes)
        trace = CurvescanTrace(
            reference=ref, current=cur, n_hypotheses=n_tried,
            candidates=candidates, scores=scores,
        )
        contested = candidates[scores > 0.75 * scores[0]][:2]
        final = refine(refine(contested, *probes, _CLOSER), *readings, _FULL)
        final, scores = select(final, *probes, 0.03, 0.004, 2, 64, 0.2)
        if not len(final):
            return _failure(Outcome.UNSUPPORTED, ref, cur, trace)
        if guess is not None:
            final, scores = _nearer_first(final, scores, guess)
        pose = final[0]
        if len(scores) == 1 and len(trace.scores) > 1 and len(contested) == 1:
            scores = np.append(scores, trace.scores[1] * scores[0] / trace.scores[0])
        codes_cur, partner_cur = compare_readings(cur.surfels, *ref_scan[1:], pose, 0.01)
        codes_ref, partner_ref = compare_readings(ref.surfels, *cur_scan[1:], _inverse(pose), 0.01)
        told, feigned, axes, units = pose_information(
            ref.surfels, partner_ref, cur.surfels, partner_cur, pose
        )
        is_open = (told < 2.0 * feigned) | (told < 100.0)
        if told[0] < 0.1 * told[1] and not is_open[0]:
            beside = best_beside(pose, axes[:, 0] * units, _OFFSETS, *probes, 0.03, 0.004)
            is_open[0] = beside > 0.92 * scores[0]
            trace.beside.append(beside / scores[0])
        cov = covariance(told, axes, units, is_open, 1.0)
        outcome = Outcome.MATCHED
        if scores[0] < 0.15 or is_open.all():
            outcome = Outcome.UNSUPPORTED
        elif len(scores) > 1 and scores[1] > min(0.93 * scores[0], scores[0] - 0.04):
            apart = final[1] - pose if len(final) > 1 else trace.candidates[1] - pose
            apart[2] = math.remainder(apart[2], 2.0 * math.pi)
            along = axes.T @ (apart / units)
            if told[0] < 0.1 * told[1] and along[0] ** 2 > 0.95 * (along @ along):
                is_open[0] = True
                cov = covariance(told, axes, units, is_open, 1.0)
            if apart @ np.linalg.solve(cov, apart) > 16.0:
                outcome = Outcome.AMBIGUOUS
        if outcome is not Outcome.MATCHED:
            return _failure(outcome, ref, cur, trace, scores)
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
            runner_up=float(scores[1]) if len(scores) > 1 else math.nan,
        )

    def _search(
        self, ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose | None, probes: Any
    ) -> tuple[Floats, Floats, int]:
        """Return the best poses, refined, their scores, and how many were tried."""
        if guess is not None:
            near, scores = select(refine(guess[None], *probes, _QUICK), *probes, 0.04, 0.005, 1, 64, 0.3)
            moved = _apart(near[0], guess)
            if scores[0] > 0.5 and moved < 0.3 and not len(slides(near, *probes, 0.15, 1, 0.1)):
                return near, scores, 1
        pairs = pair_frames(
            ref.keypoints, ref.surfels, ref.fan, ref.lookup,
            cur.keypoints, cur.surfels, cur.fan, cur.lookup, 0.4, 4000,
        )
        turned = turns(ref.directions, cur.directions, 4, np.zeros(3))
        if guess is not None:
            turned = np.concatenate((guess[None], turned))
        hypotheses = np.concatenate((turned, most_voted(pairs, 0.3, 0.15, 96)))
        candidates, scores = self._refined(hypotheses, probes)
        if len(scores) == 0 or scores[0] < 0.35:
            dense = lattice(turned, 0.15, 9)
            candidates, scores = self._refined(np.concatenate((candidates, dense)), probes)
            return candidates, scores, len(hypotheses) + len(dense)
        return candidates, scores, len(hypotheses)

    def _refined(self, hypotheses: Floats, probes: tuple[Floats, ...]) -> tuple[Floats, Floats]:
        """Return the best of many poses, refined, and their scores."""
        chosen, _ = select(hypotheses, *probes, 0.08, 0.03, 5, 6, 0.3)
        quick = refine(chosen, *probes, _QUICK)
        slid = slides(quick[:2], *probes, 0.15, 12, 0.1)
        if len(slid):
            chosen, _ = select(np.concatenate((quick, slid)), *probes, 0.06, 0.01, 6, 12, 0.3)
            quick = refine(chosen, *probes, _QUICK)
        return select(quick, *probes, 0.04, 0.005, 3, 64, 0.3)


def _arrays(features: ConsensusFeatures) -> tuple[Floats, Floats, Floats, Ints]:
    return features.probes, features.surfels, features.fan, features.lookup


def _apart(a: Pose, b: Pose) -> float:
    """Return how far apart two poses are: metres, or radians times 2 m, whichever is more."""
    turn = abs(math.remainder(a[2] - b[2], 2.0 * math.pi))
    return max(math.hypot(a[0] - b[0], a[1] - b[1]), 2.0 * turn)


def _nearer_first(poses: Floats, scores: Floats, guess: Pose) -> tuple[Floats, Floats]:
    """Return two poses that are as good as each other with the one first, and alone, that the guess is near."""
    if len(poses) < 2 or scores[1] < min(0.93 * scores[0], scores[0] - 0.04):
        return poses, scores
    distances = [_apart(pose, guess) for pose in poses]
    k = int(np.argmin(distances))
    if 2.0 * distances[k] > distances[1 - k]:
        return poses, scores
    return poses[k : k + 1], scores[k : k + 1]


def _inverse(pose: Pose) -> Pose:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]])


def _labels(features: ConsensusFeatures, codes: Codes) -> Codes:
    labels = np.zeros(features.n_beams, dtype=np.uint8)
    labels[features.beam_idx] = _LABELS[codes]
    return labels


def _failure(
    outcome: Outcome,
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    trace: CurvescanTrace | None,
    scores: Floats = np.empty(0),
) -> MatchResult:
    labels = []
    for features in (ref, cur):
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
        score=float(scores[0]) if len(scores) else math.nan,
        runner_up=float(scores[1]) if len(scores) > 1 else math.nan,
    )
