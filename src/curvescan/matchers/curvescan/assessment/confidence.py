"""Confidence: the probability that a pose is right, from how much agrees, what contradicts, and what else explains it.

Each pose of a match has log odds against there being nothing in common, linear in its evidence, and the probability of
one among all follows. Chance: in a world of right angles a corner of two walls fits any other, so a large motion counts
against a pose at which nothing agrees *beyond* the two longest walls; walls that one scan has where the other saw
through count against any. Repetition: shelves, pillars and bare rooms look the same from several places, and a pose
that explains as much as the best makes the match ambiguous. The model and its fit: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    BEYOND,
    EXCESS,
    MISFIT,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
)
from curvescan.matchers.curvescan.config import NEAR, SAME
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.matchers.curvescan.prior import TOLD
from curvescan.types import Floats

# Metres of surface that are more than chance: a room is bare where less agrees beyond its four walls; people, who hide
# things and agree by chance, are about where small things of more contradict a pose.
ANY = 0.2

# Least share of what supports a pose that another explains at which the two cannot be distinguished.
MAX_REPETITION = 0.45
# Of poses in a row of equal things: least share of the first's support that another explains; least pitch, metres.
REGULAR, PITCH = 0.33, 0.5

COEFFICIENTS = {
    "constant": -5.9,
    "log10_agreeing": 1.5,
    "log10_weakest": 1.9,
    "log10_misfit": -1.4,
    "log10_seen_through": -7.4,
    "prior": 1.0,
    "few_prior": 2.75,
}
"""Log odds of a pose against nothing in common, by terms; by bench/fit_confidence.py, the constant 0.3 more."""

_PRIOR_OF_TWO = 0.3  # share of what the prior weighs where two poses of the same scans are compared
_ENOUGH_EXCESS = 2.0  # metres of excess from which on a pose rests on more than two walls
_FLOOR = 0.1  # metres, and mean square: what is added before a logarithm is taken
# Of the terms in the order of COEFFICIENTS, as plain numbers: a match weighs four poses, and each twice.
_COLUMNS = (AGREEING, WEAKEST, MISFIT)
_WEIGHTS, _N_TERMS = tuple(COEFFICIENTS.values()), len(COEFFICIENTS)
_CONSTANT, *_, _SEEN_THROUGH, _PRIOR, _FEW_PRIOR = range(_N_TERMS)
_LITTLE = 0.5  # metres: so much more explains nothing
_BARE_PRIOR = -0.25  # log odds of the prior below which a bare room may be turned by half: 1 m and 57 degrees
_STILL = -0.015  # log odds of the prior from which on it speaks for the pose there: 0.35 m, 20 degrees
_DOUBTFUL = 0.1  # of what agrees: a pose of which more is contradicted is in doubt
_CONTRADICTED = 0.15  # of what agrees there: a competing pose contradicted beyond that explains nothing
_HOPELESS = -2.0  # log odds: of 13,571 pairs none that is turned away so would match
_MAX_LOG_ODDS = 60  # beyond it a probability is 0 or 1
_ONE_WAY = 0.12  # of what agrees: less of it runs across the rest in a corridor


@dataclass(frozen=True, eq=False)
class ScoredPoses:
    """Poses of one match and what speaks for each, the most likely first."""

    poses: Floats  # (k, 3): of the current scan in the reference
    scores: Floats  # (k,): how well the scans agree there, at most 1
    evidence: Floats  # (k, N_EVIDENCE): what the surfaces say; columns of evidence.py
    priors: Floats  # (k,): log odds of each by what was known before
    wide_priors: Floats  # (k,): the same if that was wrong

    def best_first(self) -> ScoredPoses:
        """Return the poses in order, the best first; of those that the scans do not distinguish the likeliest."""
        n = len(self.poses)
        if n < 2:
            return self
        scored = self.rows(sorted(range(n), key=lambda k: -self.rank(k)))
        alike = [0, *(k for k in range(1, n) if scored.repetition(k) > MAX_REPETITION)]
        best = max(alike, key=scored.log_odds)
        return scored.rows([best, *(k for k in range(n) if k != best)])

    def rows(self, order: list[int]) -> ScoredPoses:
        """Return the poses in another order."""
        if order == sorted(order):
            return self
        poses, scores, evidence = self.poses[order], self.scores[order], self.evidence[order]
        return ScoredPoses(poses, scores, evidence, self.priors[order], self.wide_priors[order])

    @cached_property
    def _rows(self) -> list[list[float]]:
        """Evidence of each pose."""
        rows: list[list[float]] = self.evidence.tolist()
        return rows

    @cached_property
    def _odds(self) -> list[list[float]]:
        """Log odds of each pose, and what the prior weighs in them."""
        rows: list[list[float]] = log_odds_of(self.evidence, self.priors, self.wide_priors).tolist()
        return rows

    def log_odds(self, k: int) -> float:
        """Return the log odds that one pose is right and the scans have not nothing in common."""
        return self._odds[k][0]

    def rank(self, k: int) -> float:
        """Return what poses are compared by: the log odds, in which the prior counts for little."""
        log_odds, by_prior = self._odds[k]
        return log_odds - (1.0 - _PRIOR_OF_TWO) * by_prior

    def expected_more(self, k: int) -> float:
        """Return by how much more the prior weighs in the log odds of pose k than in those of the first."""
        return self._odds[k][1] - self._odds[0][1]

    def competing_log_odds(self, k: int) -> float:
        """Return the log odds that pose k is right and not the first; to be expected more alone counts not."""
        return self.log_odds(k) - self.log_odds(0) - max(self.expected_more(k), 0.0)

    def is_told(self, k: int) -> bool:
        """Return whether the prior itself says that the scan is at pose k."""
        return bool(self.priors[k] > TOLD)

    @property
    def is_bare(self) -> bool:
        """Whether hardly more than four walls agree at the first pose."""
        return bool(self._rows[0][BEYOND] < ANY)

    @property
    def is_bare_and_moved(self) -> bool:
        """Whether nothing but walls agrees at the first pose, no people hide the rest, and nothing else speaks for it.

        That is a prior, or standing still.
        """
        is_told = self.is_told(0) or self.wide_priors[0] > _STILL
        return self.is_bare and not is_told and self._rows[0][SMALL] <= ANY

    def repeated_along(self) -> list[int]:
        """Return the rows of poses beside the first, turned as it is, that explain some of its support."""
        return [k for k in range(1, len(self.poses)) if self.is_beside(k) and self.repetition(k) > REGULAR]

    def is_beside(self, k: int) -> bool:
        """Return whether pose k is the first one moved, as along a row of equal things."""
        x, y, turn = difference(self.poses[k], self.poses[0])
        return abs(turn) < SAME and math.hypot(x, y) > PITCH

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
        is_wrong_somewhere = best[EXCESS] < _ENOUGH_EXCESS and best[SEEN_THROUGH] > _DOUBTFUL * best[AGREEING]
        is_likely = is_wrong_somewhere or self.wide_priors[0] < _BARE_PRIOR
        return self.is_bare and is_likely and not self.is_told(0)

    @property
    def is_along_walls(self) -> bool:
        """Whether nearly all surface that agrees at the first pose runs one way, and no guess lies there."""
        return bool(self._rows[0][WEAKEST] < _ONE_WAY * self._rows[0][AGREEING] and not self.is_told(0))

    def explains_more(self, k: int) -> bool:
        """Return whether walls contradict the first pose, and more agrees at pose k, and better.

        What contradicts pose k is then no argument: something must have changed, as behind the door of an elevator.
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
        what is seen through there and not at the first.
        """
        own, best = self._rows[k], self._rows[0]
        if self.explains_more(k):
            return 1.0
        share = min(1.0, (own[EXCESS] + _LITTLE) / (best[EXCESS] + _LITTLE))
        share *= min(1.0, (own[WEAKEST] + _LITTLE) / (best[WEAKEST] + _LITTLE))
        contradicted = max(own[SEEN_THROUGH] - best[SEEN_THROUGH], 0.0) + max(own[SMALL] - best[SMALL], 0.0)
        allowed = _CONTRADICTED * max(own[AGREEING], _FLOOR)
        share = math.sqrt(max(share, 0.0)) * max(0.0, 1.0 - contradicted / allowed)
        return float(share)

    def fading(self, k: int) -> float:
        """Return the share that is left of a competing pose by how much less the prior has it than the first."""
        return math.exp(min(_PRIOR_OF_TWO * self.expected_more(k), 0.0))


class Support(NamedTuple):
    """What speaks for the first of some poses and against it."""

    log_odds: float  # that it is right and the scans have not nothing in common
    competing: dict[int, float]  # log odds that another pose is right instead, by its row
    # rows that cannot be distinguished from the first: they explain what supports it, or lie to either side of it at
    # one distance and each explain some: shelves in a row, of which it lays those of one scan on the next of the other
    repeated: list[int]
    is_by_prior: bool = False  # whether the scans alone do not distinguish another from the first, and the prior does

    def probabilities(self, accepted: Sequence[int] = ()) -> tuple[float, float]:
        """Return how likely it is that the first pose is right, and that the scans have nothing in common.

        The `accepted` rows are held by the covariance of the first pose.
        """
        odds = {row: math.exp(min(value, _MAX_LOG_ODDS)) for row, value in self.competing.items()}
        nothing = math.exp(min(-self.log_odds, _MAX_LOG_ODDS))
        right = 1.0 + sum(odds[row] for row in accepted if row in odds)
        total = 1.0 + sum(odds.values()) + nothing
        return right / total, nothing / total


def support_of(scored: ScoredPoses, others: Sequence[int]) -> Support:
    """Return what speaks for the first of some poses."""
    shares = {k: scored.repetition(k) for k in others}
    repetitions = {k: share * scored.fading(k) for k, share in shares.items()}
    regular = regular_rows(scored, repetitions)
    return Support(
        log_odds=scored.log_odds(0),
        competing={k: scored.competing_log_odds(k) for k in others},
        repeated=[k for k, share in repetitions.items() if share > MAX_REPETITION or k in regular],
        is_by_prior=any(share > MAX_REPETITION >= repetitions[k] for k, share in shares.items()),
    )


def regular_rows(scored: ScoredPoses, repetitions: dict[int, float]) -> tuple[int, ...]:
    """Return the rows of poses that come in pairs, as far from the first to one side as to the other, turned as it is.

    `repetitions` has the rows to look at and the share of the first's support that each explains.
    """
    rows = [k for k, share in repetitions.items() if share > REGULAR and scored.is_beside(k)]
    sums = {
        (i, j): scored.poses[i] + scored.poses[j] - 2.0 * scored.poses[0] for i, j in itertools.combinations(rows, 2)
    }
    return tuple(row for pair, (x, y, _) in sums.items() if math.hypot(x, y) < NEAR for row in pair)


@kernel
def terms_of(evidence: Floats, priors: Floats, wide_priors: Floats) -> Floats:
    """Return (k, n) what the model weighs of each pose, in the order of COEFFICIENTS."""
    terms = np.zeros((priors.size, _N_TERMS))
    for k in range(priors.size):
        terms[k, _CONSTANT] = 1.0
        for i in range(len(_COLUMNS)):
            terms[k, _CONSTANT + 1 + i] = math.log10(max(evidence[k, _COLUMNS[i]], 0.0) + _FLOOR)
        share = max(evidence[k, SEEN_THROUGH], 0.0) / (max(evidence[k, AGREEING], 0.0) + _FLOOR)
        terms[k, _SEEN_THROUGH] = math.log10(share + _FLOOR)
        terms[k, _PRIOR] = priors[k]
        # 1 where the pose rests on two walls alone, 0 from some more on
        few = max(1.0 - (max(evidence[k, EXCESS], 0.0) + _FLOOR) / _ENOUGH_EXCESS, 0.0)
        terms[k, _FEW_PRIOR] = few * wide_priors[k]
    return terms


@kernel
def log_odds_of(evidence: Floats, priors: Floats, wide_priors: Floats) -> Floats:
    """Return (k, 2) log odds of each pose against there being nothing in common, and what the prior weighs in them."""
    terms, found = terms_of(evidence, priors, wide_priors), np.zeros((priors.size, 2))
    for k in range(priors.size):
        for i in range(_N_TERMS):
            found[k, 0] += _WEIGHTS[i] * terms[k, i]
        found[k, 1] = _WEIGHTS[_PRIOR] * terms[k, _PRIOR] + _WEIGHTS[_FEW_PRIOR] * terms[k, _FEW_PRIOR]
    return found


@kernel
def is_hopeless(evidence: Floats, priors: Floats, wide_priors: Floats) -> bool:
    """Return whether no pose comes near the confidence of a match: neither search along walls nor refinement helps."""
    highest = -math.inf  # np.any would load SciPy's linear algebra with Numba's code for it
    for said in log_odds_of(evidence, priors, wide_priors):
        highest = max(highest, said[0])
    return not highest >= _HOPELESS
