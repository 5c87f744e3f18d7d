"""The matcher "curvescan": hypotheses from CF-SMA's kind of corners, verified, refined, and judged.

It starts where CF-SMA starts, from the characteristic points of surfaces, and closes its two holes. A corner with the
two directions that leave it is a frame, and one pair of frames a pose, so that no single wrong pair decides; and the
pose is refined point to line, so that no index-by-index pairs cost accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan.matchers.curvescan.assessment import gather_evidence, open_directions
from curvescan.matchers.curvescan.config import ConsensusConfig
from curvescan.matchers.curvescan.disambiguation import (
    along_the_way,
    finalists,
    nearest_of_ties,
    prefer,
    rivals,
    slide_finely,
    slide_to_guess,
    spread,
    without_movers,
)
from curvescan.matchers.curvescan.features import ConsensusFeatures, extract_features
from curvescan.matchers.curvescan.search import Candidates, follow, search
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.types import Codes, Floats, Pose

_LABELS = np.array([Label.NEW, Label.MATCHED, Label.MOVED], dtype=np.uint8)
_MIN_PROBES = 6
_NOTHING = Candidates(poses=np.empty((0, 3)), scores=np.empty(0), n_tried=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way: the features of both scans, and the poses that came into question."""

    reference: ConsensusFeatures
    current: ConsensusFeatures
    candidates: Candidates


class CurvescanMatcher:
    """The default matcher: guess-free, and certain of itself or silent."""

    def __init__(self, config: ConsensusConfig) -> None:
        self.config = config

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
        ref, cur, config = reference, current, self.config
        if not (self.can_be_reference(ref) and self.can_be_reference(cur)):
            return _silence(Outcome.NO_SEGMENTS, ref, cur, _NOTHING)
        trusted = None if guess is None else follow(ref, cur, guess, config)
        found = trusted or search(ref, cur, guess, config)
        poses, scores = finalists(ref, cur, found, config)
        if not len(poses) or scores[0] < config.verification.min_score:
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        evidence = gather_evidence(ref, cur, poses[0], config)
        if evidence.is_weak(config.information):
            poses, scores = slide_finely(ref, cur, poses, evidence.weakest, config)
            poses, scores = prefer(guess, poses, scores, config)
            evidence = gather_evidence(ref, cur, poses[0], config)
        elif len(poses) > 1:
            poses, scores = prefer(guess, poses, scores, config)
            evidence = gather_evidence(ref, cur, poses[0], config)
        poses, evidence = without_movers(ref, cur, poses, evidence, config)
        if not evidence.is_enough(config.verification):
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        is_open = open_directions(ref, cur, poses[0], evidence, config)
        on_the_way = along_the_way(poses, scores, evidence, config)
        is_open[0] |= evidence.is_weak(config.information) and len(on_the_way) > 0
        if is_open.all():
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        # a rival along an open direction is no rival: the covariance says as much
        if len(rivals(scores, config)) > (len(on_the_way) if is_open[0] else 0):
            return _silence(Outcome.AMBIGUOUS, ref, cur, found, scores)
        pose, has_ties = poses[0], bool(is_open[0] and on_the_way)
        if has_ties:
            pose = nearest_of_ties(guess, poses, scores, on_the_way, config)
            evidence = gather_evidence(ref, cur, pose, config)
        if is_open[0] and guess is not None:
            pose, evidence = slide_to_guess(ref, cur, guess, pose, evidence, config)
        cov = evidence.covariance(is_open, config.information)
        if has_ties:
            cov += spread(pose, poses[[0, *on_the_way]])
        return MatchResult(
            method="curvescan",
            outcome=Outcome.MATCHED,
            pose=pose,
            covariance=cov,
            n_matched=evidence.n_agree,
            trace=CurvescanTrace(reference=ref, current=cur, candidates=found),
            labels_reference=_labels(ref, evidence.codes_ref),
            labels_current=_labels(cur, evidence.codes_cur),
            weak_direction=evidence.weakest if is_open.any() else None,
            score=_score(scores, 0),
            runner_up=_score(scores, 1),
        )


def _score(scores: Floats, k: int) -> float:
    return float(scores[k]) if len(scores) > k else math.nan


def _labels(features: ConsensusFeatures, codes: Codes) -> Codes:
    labels = np.zeros(features.n_beams, dtype=np.uint8)
    labels[features.beam_idx] = _LABELS[codes]
    return labels


def _silence(
    outcome: Outcome,
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    found: Candidates,
    scores: Floats = _NOTHING.scores,
) -> MatchResult:
    """Return a result without a pose."""
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
        trace=CurvescanTrace(reference=ref, current=cur, candidates=found),
        labels_reference=labels[0],
        labels_current=labels[1],
        score=_score(scores, 0),
        runner_up=_score(scores, 1),
    )
