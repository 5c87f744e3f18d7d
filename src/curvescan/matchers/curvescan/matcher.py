"""The matcher "curvescan": hypotheses from walls and edges that coincide, scored, refined, and assessed.

CF-SMA starts from corners. Walls and edges propose poses in round and bare scenes as well. And the pose is refined
point to line, so that no index-by-index pairs cost accuracy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan.matchers.curvescan.assessment.assessment import AssessedPose, assess_best
from curvescan.matchers.curvescan.assessment.labels import beam_labels
from curvescan.matchers.curvescan.candidates import refine_candidates
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.disambiguation import competing_poses, disambiguate, place
from curvescan.matchers.curvescan.features.features import CurvescanFeatures, extract_features
from curvescan.matchers.curvescan.prior import WIDE, Prior
from curvescan.matchers.curvescan.proposal.search import NOTHING, Candidates, Problem, effort_of, refine_guess, searched
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose

_NO_CODES = np.empty(0, dtype=np.uint8)


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvescanTrace:
    """What the matcher did on the way: the features of both scans, the poses that came into question, and the best."""

    reference: CurvescanFeatures
    current: CurvescanFeatures
    candidates: Candidates
    assessed: AssessedPose


class CurvescanMatcher:
    """The default matcher: guess-free, and certain of itself or silent."""

    def __init__(self, config: CurvescanConfig) -> None:
        self.config = config
        self._effort = effort_of(config)

    def prepare(self, scan: LaserScan) -> CurvescanFeatures:
        """Return the surfels and the range image of a scan."""
        return extract_features(scan, self.config)

    def can_be_reference(self, features: CurvescanFeatures) -> bool:
        """Return whether the scan has surfaces to compare."""
        return len(features.image.samples) > 0

    def match(
        self, reference: CurvescanFeatures, current: CurvescanFeatures, prior: UncertainPose | None
    ) -> MatchResult:
        """Return the pose of `current` in `reference`.

        The pose of a narrow prior is tried first. Where the scans do not match there, or little agrees, it is one more
        hypothesis. A prior also decides between poses that explain the scans as well as each other.
        """
        problem = Problem(reference, current, WIDE if prior is None else Prior.of(prior), self.config, self._effort)
        if not (self.can_be_reference(reference) and self.can_be_reference(current)):
            return replace(judged(problem, NOTHING), outcome=Outcome.NO_SEGMENTS)
        images, told = (reference.image, current.image), problem.prior.is_told
        near, is_likely = refine_guess(*images, problem.prior, self._effort) if told else (NOTHING, False)
        if is_likely and (result := judged(problem, near)).ok:
            return result
        return judged(problem, searched(problem, near))


def judged(problem: Problem, candidates: Candidates) -> MatchResult:
    """Return what comes of the candidates: the pose with its covariance and labels, or the outcome without one."""
    assessed = assess_best(problem, *refine_candidates(problem, candidates))
    outcome, confidence = disambiguate(problem, assessed)
    ref, cur, support = problem.reference, problem.current, assessed.support
    assessment = assessed.assessment if outcome is Outcome.MATCHED else None
    pose, information, cov = NO_POSE, assessed.known[0], NO_COVARIANCE
    if assessment:
        pose, assessment, (information, cov) = place(problem, assessed, assessment)
    codes = (assessment.codes_ref, assessment.codes_cur) if assessment else (_NO_CODES, _NO_CODES)
    labels = [beam_labels(one.n_beams, one.beam_idx, said) for one, said in zip((ref, cur), codes, strict=True)]
    scores: list[float] = assessed.scored.scores.tolist() or [math.nan]
    return MatchResult(
        method="curvescan",
        outcome=outcome,
        pose=pose,
        covariance=cov,
        n_matched=assessment.n_inliers if assessment else 0,
        trace=CurvescanTrace(reference=ref, current=cur, candidates=candidates, assessed=assessed),
        labels_reference=labels[0],
        labels_current=labels[1],
        degenerate_direction=assessment.weakest if assessment and any(assessed.is_degenerate) else None,
        score=scores[0],
        runner_up=max(scores[1:], default=math.nan),
        confidence=confidence,
        candidates=competing_poses(problem, assessed, assessment),
        information=information,
        # the scans alone leave several poses
        is_guess_decisive=bool(assessment and support and problem.prior.is_told and support.is_by_prior),
    )
