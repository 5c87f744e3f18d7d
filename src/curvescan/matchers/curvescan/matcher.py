"""The matcher "curvescan": hypotheses from CF-SMA's kind of corners, verified, refined, and judged.

It starts where CF-SMA starts, from the characteristic points of surfaces, and closes its two holes. A corner with the
two directions that leave it is a frame, and one pair of frames a pose, so that no single wrong pair decides; and the
pose is refined point to line, so that no index-by-index pairs cost accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan.matchers.curvescan.assessment import assess_pose, degenerate_directions
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.disambiguation import (
    along_degenerate_direction,
    competing_hypotheses,
    covariance_of_ties,
    move_to_guess,
    nearest_of_ties,
    prefer,
    search_degenerate_direction,
    top_candidates,
    without_dynamic,
)
from curvescan.matchers.curvescan.features import CurvescanFeatures, extract_features
from curvescan.matchers.curvescan.search import Candidates, follow_guess, search
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.types import Codes, Floats, Pose

_LABELS = np.array([Label.NEW, Label.MATCHED, Label.DYNAMIC], dtype=np.uint8)
_MIN_PROBES = 6
_NOTHING = Candidates(poses=np.empty((0, 3)), scores=np.empty(0), n_tried=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way: the features of both scans, and the poses that came into question."""

    reference: CurvescanFeatures
    current: CurvescanFeatures
    candidates: Candidates


class CurvescanMatcher:
    """The default matcher: guess-free, and certain of itself or silent."""

    def __init__(self, config: CurvescanConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> CurvescanFeatures:
        """Return the surfels, corners and polar view of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: CurvescanFeatures) -> bool:
        """Return whether the scan has surfaces to compare."""
        return len(features.image.samples) >= _MIN_PROBES

    def match(
        self, reference: CurvescanFeatures, current: CurvescanFeatures, guess: Pose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`.

        A guess is one more hypothesis. It is taken without a look at others when many readings agree there and fix
        both axes, and it decides between poses that explain the scans as well as each other.
        """
        ref, cur, config = reference, current, self.config
        if not (self.can_be_reference(ref) and self.can_be_reference(cur)):
            return _silence(Outcome.NO_SEGMENTS, ref, cur, _NOTHING)
        trusted = None if guess is None else follow_guess(ref, cur, guess, config)
        found = trusted or search(ref, cur, guess, config)
        poses, scores = top_candidates(ref, cur, found, config)
        if not len(poses) or scores[0] < config.scoring.min_score:
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        assessment = assess_pose(ref, cur, poses[0], config)
        if assessment.is_weakly_observable(config.information):
            poses, scores = search_degenerate_direction(ref, cur, poses, assessment.weakest, config)
            poses, scores = prefer(guess, poses, scores, config)
            assessment = assess_pose(ref, cur, poses[0], config)
        elif len(poses) > 1:
            poses, scores = prefer(guess, poses, scores, config)
            assessment = assess_pose(ref, cur, poses[0], config)
        poses, assessment = without_dynamic(ref, cur, poses, assessment, config)
        if not assessment.is_enough(config.scoring):
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        is_degenerate = degenerate_directions(ref, cur, poses[0], assessment, config)
        on_the_way = along_degenerate_direction(poses, scores, assessment, config)
        is_degenerate[0] |= (
            assessment.is_weakly_observable(config.information) and len(on_the_way) > 0
        )
        if is_degenerate.all():
            return _silence(Outcome.UNSUPPORTED, ref, cur, found, scores)
        # a rival along an open direction is no rival: the covariance says as much
        if len(competing_hypotheses(scores, config)) > (len(on_the_way) if is_degenerate[0] else 0):
            return _silence(Outcome.AMBIGUOUS, ref, cur, found, scores)
        pose, has_ties = poses[0], bool(is_degenerate[0] and on_the_way)
        if has_ties:
            pose = nearest_of_ties(guess, poses, scores, on_the_way, config)
            assessment = assess_pose(ref, cur, pose, config)
        if is_degenerate[0] and guess is not None:
            pose, assessment = move_to_guess(ref, cur, guess, pose, assessment, config)
        cov = assessment.covariance(is_degenerate, config.information)
        if has_ties:
            cov += covariance_of_ties(pose, poses[[0, *on_the_way]])
        return MatchResult(
            method="curvescan",
            outcome=Outcome.MATCHED,
            pose=pose,
            covariance=cov,
            n_matched=assessment.n_inliers,
            trace=CurvescanTrace(reference=ref, current=cur, candidates=found),
            labels_reference=_labels(ref, assessment.codes_ref),
            labels_current=_labels(cur, assessment.codes_cur),
            degenerate_direction=assessment.weakest if is_degenerate.any() else None,
            score=_score(scores, 0),
            runner_up=_score(scores, 1),
        )


def _score(scores: Floats, k: int) -> float:
    return float(scores[k]) if len(scores) > k else math.nan


def _labels(features: CurvescanFeatures, codes: Codes) -> Codes:
    labels = np.zeros(features.n_beams, dtype=np.uint8)
    labels[features.beam_idx] = _LABELS[codes]
    return labels


def _silence(
    outcome: Outcome,
    ref: CurvescanFeatures,
    cur: CurvescanFeatures,
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
