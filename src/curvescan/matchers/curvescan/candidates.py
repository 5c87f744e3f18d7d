"""Candidates: the few best poses refined on all readings, with those along a direction that the scans leave open.

Poses are the rows of an array, best first; scores the numbers beside them. A competing hypothesis is a pose with nearly
the best score.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.assessment import Assessment, assess, assess_pose, limits_of
from curvescan.matchers.curvescan.assessment.confidence import ScoredPoses, is_hopeless
from curvescan.matchers.curvescan.assessment.evidence import gather_evidence
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import SAME
from curvescan.matchers.curvescan.features.features import N_WIDE, CurvescanFeatures
from curvescan.matchers.curvescan.features.range_image import choose_samples, with_samples
from curvescan.matchers.curvescan.features.surfels import X, Y
from curvescan.matchers.curvescan.prior import Prior, log_odds
from curvescan.matchers.curvescan.proposal.scoring import CLOSE, FINE, select
from curvescan.matchers.curvescan.proposal.search import CONTESTED, Candidates, Problem
from curvescan.matchers.curvescan.refinement import EXACTLY, refine
from curvescan.types import Floats, Pose

_N_TOP = 5  # poses that are judged beside one another, at most
_FINE_STEP = 0.5 * SAME  # metres at the typical reading: steps in which the best place along a direction is looked for
_MAX_TURN = 0.5  # radians: turns along it are tried up to this angle
_FINISH = (*FINE, _N_TOP, 4096, SAME, N_WIDE)


def refine_candidates(problem: Problem, found: Candidates) -> tuple[ScoredPoses, Assessment | None]:
    """Return the candidates that come near the best, refined on all readings, and what the scans say of the first.

    Where that is known badly along a direction, runs along walls, or looks the same elsewhere, with what is found
    there. None where no pose finds enough support.
    """
    ref = problem.reference
    scores = found.scores.tolist()
    contested = [k for k, score in enumerate(scores) if score > CONTESTED * scores[0]]
    scored, assessment = look_closer(problem, found.poses[contested])
    if assessment is not None and (assessment.is_weakly_observable(problem.config) or scored.is_along_walls):
        scored, assessment = look_closer(problem, with_places_along(problem, scored.poses, assessment.weakest))
    images = [] if assessment is None else images_of(ref, assessment, scored)
    if images:
        scored, assessment = look_closer(problem, np.array([*scored.poses, *images]))
    return scored, assessment


def images_of(ref: CurvescanFeatures, assessment: Assessment, scored: ScoredPoses) -> list[Pose]:
    """Return poses that look as the best one: turned in a bare room, one thing on in a row of equal ones."""
    best = scored.poses[0]
    images = [2.0 * best - scored.poses[k] for k in scored.repeated_along()]
    if scored.is_bare and (is_agreeing := assessment.codes_ref == INLIER).any():
        # about the middle of the rectangle that agrees
        axis = ref.landmarks.axis
        to_room = np.array([[math.cos(axis), -math.sin(axis)], [math.sin(axis), math.cos(axis)]])
        agreeing = ref.image.surfels[is_agreeing][:, [X, Y]] @ to_room
        middle = np.append(to_room @ (0.5 * (agreeing.min(axis=0) + agreeing.max(axis=0))), 0.0)
        turns = np.outer((0.5, -0.5, 1.0), (0.0, 0.0, math.pi))
        images += [*se2.compose(middle + turns, best - middle)]
    return images


def with_places_along(problem: Problem, poses: Floats, weakest: Pose) -> Floats:
    """Return the poses, and the best of those along the weakest direction of the first."""
    ref, cur, _, config, _ = problem
    n = round(config.hypotheses.along_reach / _FINE_STEP)
    offsets = np.arange(-n, n + 1) * _FINE_STEP
    moved_along = poses[0] + offsets[:, np.newaxis] * weakest
    moved_along = moved_along[np.abs(offsets * weakest[2]) < _MAX_TURN]
    return np.concatenate((poses, select(moved_along, ref.wide_image, cur.wide_image, *CLOSE, 4, 24, SAME)[0]))


def look_closer(problem: Problem, poses: Floats) -> tuple[ScoredPoses, Assessment | None]:
    """Return poses refined on all readings, the best first, and what the scans say of it; None where that is little."""
    ref, cur, prior, config, effort = problem
    *found, known = refine_and_score(poses, ref, cur, prior, (effort.closer, EXACTLY), limits_of(config), _FINISH)
    scored = ScoredPoses(*found)
    best = scored.best_first()
    if not len(known.codes_ref):
        return best, None
    return best, known if best is scored else assess_pose(ref, cur, best.poses[0], config)


@kernel
def refine_and_score(
    poses: Floats,
    ref: CurvescanFeatures,
    cur: CurvescanFeatures,
    prior: Prior,
    schedules: tuple[Floats, Floats],
    rules: tuple[float, float],
    limits: tuple[float, float, int, int, float, int],
) -> tuple[Floats, Floats, Floats, Floats, Floats, Assessment]:
    """Return the fields of ScoredPoses, of poses refined on all readings, and the assessment of the first.

    That has no codes where no pose finds enough support. schedules: on the samples and on all readings; rules: of
    `limits_of`; limits: the arguments of `select`, and the samples on which several poses are compared.
    """
    one, other = ref.image, cur.image
    all_one, all_other = with_samples(one, one.surfels), with_samples(other, other.surfels)
    tolerance, slope, n_kept, n_first, min_difference, n_wide = limits
    final = refine(refine(poses, one, other, schedules[0]), all_one, all_other, schedules[1])
    if len(poses) > 1:
        one = with_samples(one, choose_samples(one.surfels, n_wide))
        other = with_samples(other, choose_samples(other.surfels, n_wide))
    final, scores = select(final, one, other, tolerance, slope, n_kept, n_first, min_difference)
    evidence, compared = gather_evidence(ref, cur, final, rules[0])
    priors, wide_priors = log_odds(final, prior)
    if is_hopeless(evidence, priors, wide_priors):
        none, no_codes = np.empty((0, 0)), compared[0][:0]
        known = Assessment(no_codes, no_codes, 0, 0, (0.0, 0.0, 0.0), none, priors, (True, True, True), False)
    else:
        known = assess(ref, cur, final[0], compared, rules)
    return final, scores, evidence, priors, wide_priors, known
