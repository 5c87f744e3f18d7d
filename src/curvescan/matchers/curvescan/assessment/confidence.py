"""Confidence: the probability that a pose is right, from how much agrees, what contradicts, and what else explains it.

Each pose of a match has log odds against there being nothing in common, linear in its evidence. Chance: in a world of
right angles a corner of two walls fits any other, so what agrees *beyond* the two longest walls counts in full, and
walls that one scan has where the other saw through count against. Repetition: shelves, pillars and bare rooms look the
same from several places, so each other pose has odds against the best one, and one that explains as much makes the match
ambiguous. The model and its fit: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    EXCESS,
    LARGE,
    MISFIT,
    MISSED,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
    gather_evidence,
)
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.matchers.curvescan.proposal.search import Problem
from curvescan.types import Bools, Floats

MAX_REPETITION = 0.45
"""Least share of what supports a pose that another explains at which the two cannot be distinguished."""

GUESSED_REPETITION = 0.3
"""The same for a guess to decide between the two."""

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
"""Log odds that a pose is right and not nothing in common, by the terms of `Support`; fitted by bench/fit_confidence.py."""

RIVAL_COEFFICIENTS = {
    "constant": -2.06,
    "log10_misfit": -1.89,
    "log10_seen_through": -2.45,
    "motion": -1.0,
    "repetition": 0.54,
}
"""Log odds that another pose is right and not the best, by its terms less those of the best, and its repetition."""

_FREE_MOTION, _MAX_MOTION = (
    1.0,
    4.0,
)  # metres plus radians: less is as likely as none, more as unlikely as that
_MOTION_OF_RANK = 0.2  # share of what a motion weighs where poses are sorted
_ENOUGH_EXCESS = 2.0  # metres of excess from which on a pose rests on more than two walls
_MAX_NEARER = 1.0  # metres plus radians by which a rival nearer to the guess is favoured, at most
_NEAR_GUESS = 0.3  # metres plus radians: a pose within it is where the guess has it
_FLOORS = {
    "log10_excess": 0.1,  # metres
    "log10_agreeing": 0.1,
    "log10_weakest": 0.1,
    "log10_misfit": 0.1,  # no unit
    "log10_missed": 0.05,  # metres
    "log10_seen_through": 0.1,
    "log10_large": 0.2,
}
_COLUMNS = (EXCESS, AGREEING, WEAKEST, MISFIT, MISSED, SEEN_THROUGH, LARGE)
_EXCESS_FLOOR, _WEAKEST_FLOOR = 0.5, 0.3  # metres: so much more explains nothing
_CONTRADICTED = 0.15  # of what agrees there: a rival contradicted beyond that explains nothing
_TWO_WALLS = 0.3  # metres of excess below which a pose rests on two walls alone
_NEARER = 0.7  # metres plus radians by which the best may be nearer to the guess before such a rival counts less
_FADING_OF_TWO, _FADING = (
    0.5,
    0.25,
)  # for each metre and radian: how fast the two kinds count less beyond that
_MAX_LOG_ODDS = 60.0  # beyond it a probability is 0 or 1
_MUCH_NEARER = 2.2  # the same for all others: a bare room turned by 180 degrees, its pose next to standing still


@dataclass(frozen=True, eq=False, kw_only=True)
class WeighedPoses:
    """Poses of one match and what speaks for each, the most likely first.

    Attributes
    ----------
    poses : (k, 3) float64
        Of the current scan in the reference.
    scores : (k,) float64
        How well the scans agree there, at most 1.
    evidence : (k, N_EVIDENCE) float64
        What the surfaces say; columns of evidence.py.
    motions : (k,) float64
        How far each is from the guess, or from standing still: metres plus radians.
    is_guessed : (k,) bool
        Whether it lies where a guess has it.
    """

    poses: Floats
    scores: Floats
    evidence: Floats
    motions: Floats
    is_guessed: Bools

    def rows(self, order: list[int]) -> WeighedPoses:
        """Return some of the poses, in another order."""
        return WeighedPoses(
            poses=self.poses[order],
            scores=self.scores[order],
            evidence=self.evidence[order],
            motions=self.motions[order],
            is_guessed=self.is_guessed[order],
        )

    def terms(self, k: int, is_degenerate: bool = False) -> dict[str, float]:
        """Return what the model weighs of one pose, by the names of its coefficients."""
        evidence = self.evidence[k].tolist()
        columns = zip(_FLOORS.items(), _COLUMNS, strict=True)
        terms = {
            name: math.log10(max(evidence[column], 0.0) + floor)
            for (name, floor), column in columns
        }
        motion = min(max(float(self.motions[k]) - _FREE_MOTION, 0.0), _MAX_MOTION - _FREE_MOTION)
        # 1 where the pose rests on two walls alone, 0 from some more on
        few = max(
            1.0 - (max(evidence[EXCESS], 0.0) + _FLOORS["log10_excess"]) / _ENOUGH_EXCESS, 0.0
        )
        return {
            "constant": 1.0,
            **terms,
            "motion": motion,
            "guessed": float(self.is_guessed[k]),
            "degenerate": float(is_degenerate),
            "few": few,
            "few_motion": few * motion,
            "few_seen_through": few * (terms["log10_seen_through"] + 1.0),
        }

    def log_odds(self, k: int, is_degenerate: bool = False) -> float:
        """Return the log odds that one pose is right and the scans have not nothing in common."""
        terms = self.terms(k, is_degenerate)
        return sum(coefficient * terms[name] for name, coefficient in COEFFICIENTS.items())

    def rank(self, k: int) -> float:
        """Return what poses are sorted by, the least first: the log odds, in which a motion counts for little.

        A large motion makes any pose less certain; which of two is right it hardly says.
        """
        terms = self.terms(k)
        odds = self.log_odds(k)
        for name in ("motion", "few_motion"):
            odds -= (1.0 - _MOTION_OF_RANK) * COEFFICIENTS[name] * terms[name]
        return -odds

    def rival_terms(self, k: int) -> dict[str, float]:
        """Return what the model weighs of pose k against the first."""
        own, best = self.terms(k), self.terms(0)
        terms = {name: own[name] - best[name] for name in RIVAL_COEFFICIENTS if name in own}
        terms["motion"] = max(terms["motion"], -_MAX_NEARER)
        return {**terms, "constant": 1.0, "repetition": self.repetition(k)}

    def repetition(self, k: int) -> float:
        """Return how much of what supports the first pose the pose k explains as well, as a share.

        The geometric mean of the shares of the excess length and of the length that fixes the weakest direction, less
        what is seen through there and not at the first. A pose that rests on two walls alone counts less the farther it
        is from where the sensor is expected, any other where that is much farther.
        """
        own, best = self.evidence[k].tolist(), self.evidence[0].tolist()
        share = min(1.0, (own[EXCESS] + _EXCESS_FLOOR) / (best[EXCESS] + _EXCESS_FLOOR))
        share *= min(1.0, (own[WEAKEST] + _WEAKEST_FLOOR) / (best[WEAKEST] + _WEAKEST_FLOOR))
        contradicted = sum(max(own[one] - best[one], 0.0) for one in (SEEN_THROUGH, SMALL))
        allowed = _CONTRADICTED * max(own[AGREEING], _FLOORS["log10_agreeing"])
        share = math.sqrt(max(share, 0.0)) * max(0.0, 1.0 - contradicted / allowed)
        farther = float(self.motions[k] - self.motions[0])
        if own[EXCESS] < _TWO_WALLS:
            share *= min(1.0, max(0.0, 1.0 - _FADING_OF_TWO * (farther - _NEARER)))
        return float(share * min(1.0, max(0.0, 1.0 - _FADING * (farther - _MUCH_NEARER))))


def weigh(problem: Problem, poses: Floats, scores: Floats) -> WeighedPoses:
    """Return poses with their evidence, the most likely first."""
    ref, cur, guess, config = problem
    around = np.zeros(3) if guess is None else guess
    offsets = [difference(pose, around) for pose in poses]
    motions = np.array([math.hypot(x, y) + abs(theta) for x, y, theta in offsets])
    weighed = WeighedPoses(
        poses=poses,
        scores=scores,
        evidence=gather_evidence(
            ref.image, ref.bounds, cur.image, cur.bounds, poses, config.scoring.margin
        ),
        motions=motions,
        is_guessed=(motions < _NEAR_GUESS) & np.bool_(guess is not None),
    )
    if len(poses) < 2:
        return weighed
    return weighed.rows(sorted(range(len(poses)), key=weighed.rank))


@dataclass(frozen=True, kw_only=True)
class Support:
    """What speaks for the first of some poses and against it.

    Attributes
    ----------
    log_odds : float
        That it is right and the scans have not nothing in common.
    rivals : dict of int to float
        Log odds, for each other pose that may be right instead, by its row.
    repetitions : dict of int to float
        Share of what supports the first that each of them explains.
    """

    log_odds: float
    rivals: dict[int, float]
    repetitions: dict[int, float]

    @property
    def confidence(self) -> float:
        """Probability that the pose is right and no other."""
        return self.confidence_with([])

    def confidence_with(self, accepted: Sequence[int]) -> float:
        """Return the probability that the pose is right, or one of the `accepted` rows, that its covariance holds."""
        odds = {row: math.exp(min(value, _MAX_LOG_ODDS)) for row, value in self.rivals.items()}
        nothing = math.exp(min(-self.log_odds, _MAX_LOG_ODDS))
        right = 1.0 + sum(odds[row] for row in accepted if row in odds)
        return right / (1.0 + sum(odds.values()) + nothing)

    @property
    def is_related(self) -> float:
        """Probability that the scans have anything in common, at any of the poses."""
        return 1.0 - math.exp(min(-self.log_odds, _MAX_LOG_ODDS)) * self.confidence

    def repeated(self) -> list[int]:
        """Return the rows of the poses that cannot be distinguished from the first."""
        return [row for row, share in self.repetitions.items() if share > MAX_REPETITION]


def support_of(weighed: WeighedPoses, others: Sequence[int], is_degenerate: bool) -> Support:
    """Return what speaks for the first of some poses.

    Parameters
    ----------
    weighed : WeighedPoses
        The poses.
    others : sequence of int
        Rows that may be right instead.
    is_degenerate : bool
        Whether the scans leave a direction open at the first.
    """
    terms = {k: weighed.rival_terms(k) for k in others}
    return Support(
        log_odds=weighed.log_odds(0, is_degenerate),
        rivals={
            k: sum(RIVAL_COEFFICIENTS[name] * value for name, value in of.items())
            for k, of in terms.items()
        },
        repetitions={k: of["repetition"] for k, of in terms.items()},
    )
