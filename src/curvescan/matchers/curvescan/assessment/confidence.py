"""Confidence: the probability that a pose is right, from how much agrees, what contradicts, and what else explains it.

Each pose of a match has log odds against there being nothing in common, linear in its evidence. Chance: in a world of
right angles a corner of two walls fits any other, so what agrees *beyond* the two longest walls counts in full, and
walls that one scan has where the other saw through count against. Repetition: shelves, pillars and bare rooms look the
same from several places, so each other pose has odds against the best one, and one that explains as much makes the
match ambiguous. The model and its fit: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    BEYOND,
    EXCESS,
    LARGE,
    MISFIT,
    MISSED,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
    gather_evidence,
)
from curvescan.matchers.curvescan.config import NEAR
from curvescan.matchers.curvescan.features.objects import Surfaces
from curvescan.matchers.curvescan.proposal.search import Problem
from curvescan.types import Bools, Floats

# Metres of surface that are more than chance: a room is bare where less agrees beyond its four walls; people, who hide
# things and agree by chance, are about where small things of more contradict a pose.
ANY = 0.2
# Least share of what supports a pose that another explains for a guess to decide between the two.
GUESSED_REPETITION = 0.3

COEFFICIENTS = {
    "constant": -1.15,
    "log10_excess": 1.96,
    "log10_agreeing": 0.54,
    "log10_weakest": 1.21,
    "log10_misfit": -1.1,
    "log10_missed": -1.27,
    "log10_seen_through": -1.07,
    "log10_large": -1.37,
    "motion": -1.57,
    "guessed": 2.62,
    "degenerate": -1.59,
    "few": 1.48,
    "few_motion": -1.28,
    "few_seen_through": -3.32,
}
"""Log odds of a pose against nothing in common, by the terms of `Support`; fitted by bench/fit_confidence.py."""

RIVAL_COEFFICIENTS = {
    "constant": -2.06,
    "log10_misfit": -1.89,
    "log10_seen_through": -2.45,
    "motion": -1.0,
    "repetition": 0.54,
}
"""Log odds that another pose is right and not the best, by its terms less those of the best, and its repetition."""

_FREE_MOTION, _MAX_MOTION = (1.0, 4.0)  # metres plus radians: less is as likely as none, more as unlikely as that
_MOTION_OF_RANK = 0.2  # share of what a motion weighs where poses are sorted
_ENOUGH_EXCESS = 2.0  # metres of excess from which on a pose rests on more than two walls
_MAX_NEARER = 1.0  # metres plus radians by which a rival nearer to the guess is favoured, at most
_FLOOR = 0.1  # metres, and mean square: what is added before a logarithm is taken
# Rows of a pose's terms in the order of COEFFICIENTS, as plain numbers: a match weighs four poses, and each twice.
_COLUMNS = (EXCESS, AGREEING, WEAKEST, MISFIT, MISSED, SEEN_THROUGH, LARGE)
_LEAST = (_FLOOR, _FLOOR, _FLOOR, _FLOOR, 0.5 * _FLOOR, _FLOOR, 2.0 * _FLOOR)
_ROW = {name: k for k, name in enumerate(COEFFICIENTS)}
_N_TERMS = len(COEFFICIENTS)
_WEIGHTS, _RIVAL_WEIGHTS = tuple(COEFFICIENTS.values()), tuple(RIVAL_COEFFICIENTS.values())
_MOTION, _SEEN_THROUGH = _ROW["motion"], _ROW["log10_seen_through"]
_DEGENERATE, _FEW_MOTION = _ROW["degenerate"], _ROW["few_motion"]
_CONSTANT, _GUESSED = _ROW["constant"], _ROW["guessed"]
_FEW, _FEW_SEEN_THROUGH = _ROW["few"], _ROW["few_seen_through"]
_COMPARED = tuple(_ROW[name] for name in ("log10_misfit", "log10_seen_through", "motion"))
_STAND_STILL = np.zeros(3)
_EXCESS_FLOOR, _WEAKEST_FLOOR = 0.5, 0.3  # metres: so much more explains nothing
_DOUBTFUL = 0.1  # of what agrees: a pose contradicted beyond that rules out none that explains more
_BARE_MOTION = 1.45  # metres plus radians, 1 m and 26 degrees: in a bare room more may be half a turn
_BARE_CONTRADICTED = 0.05  # of what agrees: more of a bare room is not contradicted at the right pose
_BARE_EXCESS = 3.0  # metres beyond two walls: with more, what contradicts is a thing that changed
_CONTRADICTED = 0.15  # of what agrees there: a rival contradicted beyond that explains nothing
_HOPELESS = -3.0  # log odds: of 5,500 matches none had a first pose with less than -1.3
_AS_LIKELY = 0.6  # log odds by which a place along one long wall may be less likely than the best
_ONE_WAY = 0.12  # of what agrees: less of it runs across the rest in a corridor
_TWO_WALLS = 0.3  # metres of excess below which a pose rests on two walls alone
_NEARER = 0.7  # metres plus radians by which the best may be nearer to the guess before such a rival counts less
_FADING_OF_TWO, _FADING = (0.5, 0.25)  # for each metre and radian: how fast the two kinds count less beyond that
_MUCH_NEARER = 2.2  # the same for all others: a bare room turned by 180 degrees, its pose next to standing still


@dataclass(frozen=True, eq=False)
class WeighedPoses:
    """Poses of one match and what speaks for each, the most likely first."""

    poses: Floats  # (k, 3): of the current scan in the reference
    scores: Floats  # (k,): how well the scans agree there, at most 1
    evidence: Floats  # (k, N_EVIDENCE): what the surfaces say; columns of evidence.py
    motions: Floats  # (k,): how far each is from the guess, or from standing still: metres plus radians
    is_guessed: Bools  # (k,): whether it lies where a guess has it

    def rows(self, order: list[int]) -> WeighedPoses:
        """Return some of the poses, in another order."""
        poses, scores, evidence = self.poses[order], self.scores[order], self.evidence[order]
        return WeighedPoses(poses, scores, evidence, self.motions[order], self.is_guessed[order])

    @cached_property
    def _rows(self) -> list[list[float]]:
        """Evidence of each pose."""
        rows: list[list[float]] = self.evidence.tolist()
        return rows

    @cached_property
    def _terms(self) -> list[list[float]]:
        """What the model weighs of each pose, in the order of COEFFICIENTS, without an open direction."""
        rows: list[list[float]] = terms_of(self.evidence, self.motions, self.is_guessed).tolist()
        return rows

    def terms(self, k: int, is_degenerate: bool = False) -> dict[str, float]:
        """Return what the model weighs of one pose, by the names of its coefficients."""
        return dict(zip(COEFFICIENTS, self._terms_at(k, is_degenerate), strict=True))

    def log_odds(self, k: int, is_degenerate: bool = False) -> float:
        """Return the log odds that one pose is right and the scans have not nothing in common."""
        return _weighted(_WEIGHTS, self._terms_at(k, True)) if is_degenerate else self._odds[k]

    @cached_property
    def _odds(self) -> list[float]:
        return [_weighted(_WEIGHTS, terms) for terms in self._terms]

    def _terms_at(self, k: int, is_degenerate: bool) -> list[float]:
        if not is_degenerate:
            return self._terms[k]
        terms = self._terms[k].copy()
        terms[_DEGENERATE] = 1.0
        return terms

    def rank(self, k: int) -> float:
        """Return what poses are sorted by, the least first: the log odds, in which a motion counts for little.

        A large motion makes any pose less certain; which of two is right it hardly says.
        """
        odds = self._odds[k]
        for row in (_MOTION, _FEW_MOTION):
            odds -= (1.0 - _MOTION_OF_RANK) * _WEIGHTS[row] * self._terms[k][row]
        return -odds

    def rival_terms(self, k: int) -> dict[str, float]:
        """Return what the model weighs of pose k against the first."""
        return dict(zip(RIVAL_COEFFICIENTS, self._rival_terms_at(k), strict=True))

    def rival_log_odds(self, k: int) -> tuple[float, float]:
        """Return the log odds that pose k is right and not the first, and its repetition."""
        terms = self._rival_terms_at(k)
        return _weighted(_RIVAL_WEIGHTS, terms), terms[-1]

    def _rival_terms_at(self, k: int) -> list[float]:
        own, best = self._terms[k], self._terms[0]
        misfit, seen_through, motion = (own[row] - best[row] for row in _COMPARED)
        return [1.0, misfit, seen_through, max(motion, -_MAX_NEARER), self.repetition(k)]

    @property
    def may_be_turned(self) -> bool:
        """Whether the first pose may as well be another, turned.

        It may if only four walls agree, and a wall contradicts it or the motion is large. A rectangle looks the same
        after half a turn, and two of its walls fit any corner. Of a sensor that sees half a circle the right pose may
        share next to nothing with the reference, so that no other pose speaks against the first. A guess decides.
        """
        if not len(self.poses):
            return False
        best = self._rows[0]
        contradicted = best[SEEN_THROUGH] + best[MISSED]
        is_wrong_somewhere = best[EXCESS] < _BARE_EXCESS and contradicted > _BARE_CONTRADICTED * best[AGREEING]
        is_likely = is_wrong_somewhere or self.motions[0] > _BARE_MOTION
        return bool(best[BEYOND] < ANY and is_likely and not self.is_guessed[0])

    @property
    def is_hopeless(self) -> bool:
        """Whether no pose comes near the confidence of a match: neither search along walls nor refinement helps."""
        return max(self._odds) < _HOPELESS

    @property
    def is_one_way(self) -> bool:
        """Whether nearly all surface that agrees at the first pose runs one way, as in a corridor.

        Besides, people are about, and no guess lies there.
        """
        best = self._rows[0]
        is_along_walls = best[WEAKEST] < _ONE_WAY * best[AGREEING] and best[SMALL] > ANY
        return bool(is_along_walls and not self.is_guessed[0])

    def is_as_likely(self, k: int) -> bool:
        """Return whether pose k is hardly less likely than the first."""
        return self.rank(k) < self.rank(0) + _AS_LIKELY

    def explains_more(self, k: int) -> bool:
        """Return whether walls contradict the first pose, and more agrees at pose k, and better.

        What contradicts pose k is then no argument: something must have changed between the scans, as behind the door
        of an elevator.
        """
        own, best = self._rows[k], self._rows[0]
        return bool(
            best[SEEN_THROUGH] > _DOUBTFUL * best[AGREEING]
            and own[AGREEING] > best[AGREEING]
            and own[MISFIT] < best[MISFIT]
            and self.scores[k] > self.scores[0]
        )

    def repetition(self, k: int) -> float:
        """Return how much of what supports the first pose the pose k explains as well, as a share.

        The geometric mean of the shares of the excess length and of the length that fixes the weakest direction, less
        what is seen through there and not at the first. A pose that rests on two walls alone counts less the farther it
        is from where the sensor is expected, any other where that is much farther.
        """
        own, best = self._rows[k], self._rows[0]
        if self.explains_more(k):
            return 1.0
        share = min(1.0, (own[EXCESS] + _EXCESS_FLOOR) / (best[EXCESS] + _EXCESS_FLOOR))
        share *= min(1.0, (own[WEAKEST] + _WEAKEST_FLOOR) / (best[WEAKEST] + _WEAKEST_FLOOR))
        contradicted = sum(max(own[one] - best[one], 0.0) for one in (SEEN_THROUGH, SMALL))
        allowed = _CONTRADICTED * max(own[AGREEING], _FLOOR)
        share = math.sqrt(max(share, 0.0)) * max(0.0, 1.0 - contradicted / allowed)
        farther = float(self.motions[k] - self.motions[0])
        if own[EXCESS] < _TWO_WALLS:
            share *= min(1.0, max(0.0, 1.0 - _FADING_OF_TWO * (farther - _NEARER)))
        return float(share * min(1.0, max(0.0, 1.0 - _FADING * (farther - _MUCH_NEARER))))


def _weighted(weights: tuple[float, ...], terms: list[float]) -> float:
    total: float = sum(map(operator.mul, weights, terms))
    return total


@kernel
def terms_of(evidence: Floats, motions: Floats, is_guessed: Bools) -> Floats:
    """Return (k, n) what the model weighs of each pose, in the order of COEFFICIENTS, without an open direction."""
    terms = np.zeros((motions.size, _N_TERMS))
    for k in range(motions.size):
        terms[k, _CONSTANT] = 1.0
        for i in range(len(_COLUMNS)):
            terms[k, _CONSTANT + 1 + i] = math.log10(max(evidence[k, _COLUMNS[i]], 0.0) + _LEAST[i])
        motion = min(max(motions[k] - _FREE_MOTION, 0.0), _MAX_MOTION - _FREE_MOTION)
        # 1 where the pose rests on two walls alone, 0 from some more on
        few = max(1.0 - (max(evidence[k, EXCESS], 0.0) + _LEAST[0]) / _ENOUGH_EXCESS, 0.0)
        terms[k, _MOTION] = motion
        terms[k, _GUESSED] = 1.0 if is_guessed[k] else 0.0
        terms[k, _FEW] = few
        terms[k, _FEW_MOTION] = few * motion
        terms[k, _FEW_SEEN_THROUGH] = few * (terms[k, _SEEN_THROUGH] + 1.0)
    return terms


@kernel
def weigh_poses(
    ref: Surfaces, cur: Surfaces, poses: Floats, around: Floats, near: float, margin: float
) -> tuple[Floats, Floats, Bools]:
    """Return the evidence of (k, 3) poses, how far each is from (3,) `around`, and whether nearer than `near`."""
    motions, is_near = np.empty(poses.shape[0]), np.empty(poses.shape[0], dtype=np.bool_)
    for k in range(motions.size):
        turn = poses[k, 2] - around[2]
        turn -= 2.0 * math.pi * np.rint(turn / (2.0 * math.pi))
        motions[k] = math.hypot(poses[k, 0] - around[0], poses[k, 1] - around[1]) + abs(turn)
        is_near[k] = motions[k] < near
    return gather_evidence(ref, cur, poses, margin), motions, is_near


def weigh(problem: Problem, poses: Floats, scores: Floats) -> WeighedPoses:
    """Return poses with their evidence, the most likely first."""
    ref, cur, guess, config = problem
    around, near = (_STAND_STILL, 0.0) if guess is None else (guess, NEAR)
    found = weigh_poses(ref.surfaces, cur.surfaces, poses, around, near, config.scoring.margin)
    weighed = WeighedPoses(poses, scores, *found)
    order = sorted(range(len(poses)), key=weighed.rank) if len(poses) > 1 else [0]
    return weighed if order == list(range(len(order))) else weighed.rows(order)
