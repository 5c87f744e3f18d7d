"""Contest: the few best poses refined on all readings, and which of them, if any, stands alone.

Poses are the rows of an array, best first; scores the numbers beside them. A rival is a pose with nearly the best score.
"""

from __future__ import annotations

import numpy as np

from curvescan.matchers.curvescan.assessment import Evidence, gather_evidence
from curvescan.matchers.curvescan.config import ConsensusConfig
from curvescan.matchers.curvescan.features import ConsensusFeatures
from curvescan.matchers.curvescan.pose_difference import difference, distance, is_on_the_way
from curvescan.matchers.curvescan.range_image import View
from curvescan.matchers.curvescan.refinement import refine, refine_fully
from curvescan.matchers.curvescan.scoring import select
from curvescan.matchers.curvescan.search import Candidates
from curvescan.types import Cov, Floats, Pose

_ARMS = np.array([1.0, 1.0, 2.0])
"""What a metre, a metre and a radian of a pose count when slides are measured."""

_SHARE = 0.7
"""Least share of the score that a pose slid along an open direction must keep: two scans taken a metre apart on a bare
corridor have less in common than they seem to where they are laid over each other."""


def finalists(
    ref: ConsensusFeatures, cur: ConsensusFeatures, found: Candidates, config: ConsensusConfig
) -> tuple[Floats, Floats]:
    """Return the best pose and those that come near it, refined on all readings, best first, and their scores."""
    if not len(found.scores):
        return found.poses, found.scores
    near = found.poses[found.scores > config.verification.contested * found.scores[0]]
    return _finish(ref, cur, near, config)


def slide_finely(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    poses: Floats,
    weakest: Pose,
    config: ConsensusConfig,
) -> tuple[Floats, Floats]:
    """Return the poses and the best of those along the weakest direction of the first, best first, and their scores."""
    rules = config.information
    n = round(config.hypotheses.slide_reach / rules.fine_step)
    offsets = np.arange(-n, n + 1) * rules.fine_step
    slid = poses[0] + offsets[:, np.newaxis] * weakest
    slid = slid[np.abs(offsets * weakest[2]) < rules.max_slid_turn]
    best, _ = select(slid, *_wide_views(ref, cur, config), *config.verification.close, 4, 24, 0.1)
    return _finish(ref, cur, np.concatenate((poses, best)), config)


def _finish(
    ref: ConsensusFeatures, cur: ConsensusFeatures, poses: Floats, config: ConsensusConfig
) -> tuple[Floats, Floats]:
    slacks = config.refinement.closer_slacks, config.refinement.full_slacks
    final = refine_fully(poses, ref.view, cur.view, *slacks)
    # one pose has only to be enough; several are told apart by more probes
    views = _wide_views(ref, cur, config) if len(poses) > 1 else (ref.view, cur.view)
    return select(final, *views, *config.verification.fine, 3, 4096, 0.1)


def _wide_views(
    ref: ConsensusFeatures, cur: ConsensusFeatures, config: ConsensusConfig
) -> tuple[View, View]:
    """Return the views of both scans with more probes, to tell apart poses that are nearly as good as each other."""
    n_wide = config.verification.n_wide
    return ref.with_probes(n_wide), cur.with_probes(n_wide)


def without_movers(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    poses: Floats,
    evidence: Evidence,
    config: ConsensusConfig,
) -> tuple[Floats, Evidence]:
    """Return the poses, the first refined without the surfaces that moved, and the evidence for it."""
    if not evidence.n_moved:
        return poses, evidence
    still_ref = ref.view._replace(probes=ref.view.surfels[evidence.at_rest_ref])
    still_cur = cur.view._replace(probes=cur.view.surfels[evidence.at_rest_cur])
    pose = refine(poses[:1], still_ref, still_cur, config.refinement.full_slacks)
    return np.concatenate((pose, poses[1:])), gather_evidence(ref, cur, pose[0], config)


def rivals(scores: Floats, config: ConsensusConfig) -> list[int]:
    """Return the rows of the poses that are as good as the first."""
    share, margin = config.verification.ambiguity
    least = min(share * scores[0], scores[0] - margin)
    return [k for k in range(1, len(scores)) if scores[k] > least]


def prefer(
    guess: Pose | None, poses: Floats, scores: Floats, config: ConsensusConfig
) -> tuple[Floats, Floats]:
    """Return the poses, or of those as good as the first the one that a guess is clearly nearest to, alone."""
    rows = [0, *rivals(scores, config)]
    if guess is None or len(rows) == 1:
        return poses, scores
    distances = [distance(poses[k], guess) for k in rows]
    first, second = np.argsort(distances, kind="stable")[:2].tolist()
    if 2.0 * distances[first] > distances[second]:
        return poses, scores
    kept = rows[first]
    return poses[kept : kept + 1], scores[kept : kept + 1]


def along_the_way(
    poses: Floats, scores: Floats, evidence: Evidence, config: ConsensusConfig
) -> list[int]:
    """Return the rows of the rivals that differ by a motion along the first one's weakest direction."""
    tolerance = config.information.way_tolerance
    return [
        k
        for k in rivals(scores, config)
        if is_on_the_way(evidence.weakest, poses[0], poses[k], tolerance)
    ]


def nearest_of_ties(
    guess: Pose | None, poses: Floats, scores: Floats, rows: list[int], config: ConsensusConfig
) -> Pose:
    """Return of the first pose and those rows that tie with it the one nearest to the guess, or to standing still."""
    around = np.zeros(3) if guess is None else guess
    ties = [0, *(k for k in rows if scores[k] > config.information.tie * scores[0])]
    nearest: Pose = poses[min(ties, key=lambda k: distance(poses[k], around))]
    return nearest


def spread(pose: Pose, ties: Floats) -> Cov:
    """Return the (3, 3) second moment about a pose of those that it may as well be, each as likely, itself among them.

    The covariance of a pose is told at one place along an open direction, and knows the direction there to milliradians:
    a tie a metre along lies beside it by many of its standard deviations.
    """
    apart = np.array([difference(tie, pose) for tie in ties])
    moment: Cov = apart.T @ apart / len(ties)
    return moment


def slide_to_guess(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    guess: Pose,
    pose: Pose,
    evidence: Evidence,
    config: ConsensusConfig,
) -> tuple[Pose, Evidence]:
    """Return a pose slid along its open direction to where a guess has it, and the evidence there, if the scans agree.

    Where nothing tells how far along it went, the pose lies anywhere; and as the direction itself is known to a few
    milliradians only, a slide of half a metre that is made afterwards would turn the pose by as much.
    """
    along = evidence.weakest * _ARMS
    offset = np.array(difference(guess, pose)) * _ARMS
    slide = float(along @ offset) / float(along @ along)
    slid = pose + slide * evidence.weakest
    slid = refine(slid[np.newaxis], ref.whole, cur.whole, config.refinement.closer_slacks)
    views = _wide_views(ref, cur, config)
    before, after = (
        select(one, *views, *config.verification.fine, 1, 4096, 0.0)[1]
        for one in (pose[np.newaxis], slid)
    )
    if not len(after) or after[0] < _SHARE * before[0]:
        return pose, evidence
    found = gather_evidence(ref, cur, slid[0], config)
    return (slid[0], found) if found.is_enough(config.verification) else (pose, evidence)
