"""Search: from features of two scans to the few poses worth a closer look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import ConsensusConfig
from curvescan.matchers.curvescan.features import ConsensusFeatures
from curvescan.matchers.curvescan.hypotheses import most_voted, pair_frames
from curvescan.matchers.curvescan.pose_difference import distance
from curvescan.matchers.curvescan.range_image import View
from curvescan.matchers.curvescan.refinement import refine
from curvescan.matchers.curvescan.rotation_hypotheses import lattice, slides, turns
from curvescan.matchers.curvescan.scoring import select
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

    Where they find little support, and the best is not where the guess has it, the places of a lattice around standing
    still are tried as well.
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
    if not _is_doubtful(found, config) or _is_expected(found, guess, config):
        return found
    reach = round(steps.lattice_reach / steps.lattice_step)
    places = np.concatenate((found.poses, lattice(turned, steps.lattice_step, reach)))
    return _best(ref, cur, places, config)


def _best(
    ref: ConsensusFeatures, cur: ConsensusFeatures, poses: Floats, config: ConsensusConfig
) -> Candidates:
    rules, steps = config.verification, config.hypotheses
    best, scores = explore(
        poses,
        ref.view,
        cur.view,
        config.refinement.quick_slacks,
        (*rules.rough, *rules.slid, *rules.close),
        (rules.n_kept, rules.n_kept + 1, 3),
        (6, 12, 64),
        steps.slide_step,
        round(steps.slide_reach / steps.slide_step),
        config.information.weak_ratio,
    )
    return Candidates(poses=best, scores=scores, n_tried=len(poses))


@kernel
def stack(first: Floats, second: Floats) -> Floats:
    """Return (h + k, 3) the poses of both; np.concatenate takes half a second to compile."""
    n = first.shape[0]
    both = np.empty((n + second.shape[0], 3))
    for i in range(both.shape[0]):
        for k in range(3):
            both[i, k] = first[i, k] if i < n else second[i - n, k]
    return both


@kernel
def explore(
    poses: Floats,
    ref: View,
    cur: View,
    slacks: Floats,
    tolerances: tuple[float, float, float, float, float, float],
    n_kept: tuple[int, int, int],
    n_first: tuple[int, int, int],
    slide_step: float,
    n_slides: int,
    weak_ratio: float,
) -> tuple[Floats, Floats]:
    """Return a few poses and their scores: the best of those given, refined, and if need be slid and refined.

    `tolerances` are those of rough, slid and closely refined poses, metres and metres for each metre of range; `n_kept`
    and `n_first` what is kept of each and the probes tried first. They are no constants, for each of which Numba would
    compile `select` anew.
    """
    rough, rough_slope, slid_tolerance, slid_slope, close, close_slope = tolerances
    chosen, _ = select(poses, ref, cur, rough, rough_slope, n_kept[0], n_first[0], 0.3)
    quick = refine(chosen, ref, cur, slacks)
    slid = slides(quick[:2], ref, cur, slide_step, n_slides, weak_ratio)
    if slid.shape[0] > 0:
        chosen, _ = select(
            stack(quick, slid), ref, cur, slid_tolerance, slid_slope, n_kept[1], n_first[1], 0.3
        )
        quick = refine(chosen, ref, cur, slacks)
    return select(quick, ref, cur, close, close_slope, n_kept[2], n_first[2], 0.3)


def _is_expected(found: Candidates, guess: Pose | None, config: ConsensusConfig) -> bool:
    """Return whether the best pose lies where the guess has it, and finds some support."""
    if guess is None or not len(found.scores):
        return False
    is_near = distance(found.poses[0], guess) < 2.0 * config.hypotheses.slide_step
    return bool(is_near and found.scores[0] > config.verification.doubtful_score)


def _is_doubtful(found: Candidates, config: ConsensusConfig) -> bool:
    """Return whether the best pose finds little support, or middling with few poses tried or a near rival."""
    verification, scores = config.verification, found.scores
    if not len(scores) or scores[0] < verification.doubtful_score:
        return True
    if found.n_tried < verification.few_tried and scores[0] < verification.certain_score:
        return True
    is_contested = len(scores) > 1 and scores[1] > verification.contested * scores[0]
    return bool(is_contested and scores[0] < verification.trusted_score)
