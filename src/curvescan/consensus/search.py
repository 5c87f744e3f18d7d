"""Search: from features of two scans to the few poses worth a closer look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan.consensus.apart import distance
from curvescan.consensus.config import ConsensusConfig
from curvescan.consensus.features import ConsensusFeatures
from curvescan.consensus.hypotheses import most_voted, pair_frames
from curvescan.consensus.refinement import refine
from curvescan.consensus.turns import lattice, slides, turns
from curvescan.consensus.verification import select
from curvescan.types import Floats, Pose

_STAND_STILL = np.zeros(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """The best poses found.

    Attributes
    ----------
    poses : (k, 3) float64
        Poses that differ from one another, refined on the probes, best first; of the current scan in the reference.
    scores : (k,) float64
        How well the scans agree there, at most 1.
    n_tried : int
        Poses that were verified.
    """

    poses: Floats
    scores: Floats
    n_tried: int


def follow(
    ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose, config: ConsensusConfig
) -> Candidates | None:
    """Return the guess refined, where it is to be trusted, else None.

    It is when enough readings agree there, the refinement stays near, and both axes are fixed.
    """
    step = config.hypotheses.slide_step
    views = (ref.view, cur.view)
    near = refine(guess[np.newaxis], *views, config.refinement.quick_slacks)
    near, scores = select(near, *views, *config.verification.close, 1, 64, 0.3)
    if (
        len(near)
        and scores[0] > config.verification.trusted_score
        and distance(near[0], guess) < 2.0 * step
        and not len(slides(near, *views, step, 1, config.information.weak_ratio))
    ):
        return Candidates(poses=near, scores=scores, n_tried=1)
    return None


def search(
    ref: ConsensusFeatures, cur: ConsensusFeatures, guess: Pose | None, config: ConsensusConfig
) -> Candidates:
    """Return the best poses of all that frames, directions of surfaces and the guess propose.

    Where they find little support, the places of a lattice around standing still are tried as well.
    """
    steps = config.hypotheses
    turned = turns(ref.directions, cur.directions, steps.n_turns, _STAND_STILL)
    if guess is not None:
        turned = np.concatenate((guess[np.newaxis], turned))
    pairs = pair_frames(
        ref.frames, cur.frames, ref.view, cur.view, steps.turn_tolerance, steps.max_pairs
    )
    voted = most_voted(pairs, steps.cell, 0.5 * steps.cell, steps.max_tried)
    found = _best(ref, cur, np.concatenate((turned, voted)), config)
    if not _is_doubtful(found, config):
        return found
    reach = round(steps.lattice_reach / steps.lattice_step)
    places = np.concatenate((found.poses, lattice(turned, steps.lattice_step, reach)))
    return _best(ref, cur, places, config)


def _best(
    ref: ConsensusFeatures, cur: ConsensusFeatures, poses: Floats, config: ConsensusConfig
) -> Candidates:
    verification, steps = config.verification, config.hypotheses
    views, slacks = (ref.view, cur.view), config.refinement.quick_slacks
    chosen, _ = select(poses, *views, *verification.rough, verification.n_kept, 6, 0.3)
    quick = refine(chosen, *views, slacks)
    n_slides = round(steps.slide_reach / steps.slide_step)
    slid = slides(quick[:2], *views, steps.slide_step, n_slides, config.information.weak_ratio)
    if len(slid):
        every = np.concatenate((quick, slid))
        chosen, _ = select(every, *views, *verification.slid, verification.n_kept + 1, 12, 0.3)
        quick = refine(chosen, *views, slacks)
    best, scores = select(quick, *views, *verification.close, 3, 64, 0.3)
    return Candidates(poses=best, scores=scores, n_tried=len(poses))


def _is_doubtful(found: Candidates, config: ConsensusConfig) -> bool:
    """Return whether the best pose finds little support, or middling with few poses tried or a near rival."""
    verification, scores = config.verification, found.scores
    if not len(scores) or scores[0] < verification.doubtful_score:
        return True
    if found.n_tried < verification.few_tried and scores[0] < verification.certain_score:
        return True
    is_contested = len(scores) > 1 and scores[1] > verification.contested * scores[0]
    return bool(is_contested and scores[0] < verification.trusted_score)
