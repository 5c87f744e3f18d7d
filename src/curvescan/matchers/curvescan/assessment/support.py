"""Support: what speaks for the best of some poses, against it, and which other poses the scans cannot tell from it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from curvescan.matchers.curvescan.assessment.confidence import MAX_REPETITION, REGULAR, WeighedPoses
from curvescan.matchers.curvescan.config import NEAR

_MAX_LOG_ODDS = 60  # beyond it a probability is 0 or 1


class Probabilities(NamedTuple):
    """Of what may come of a match; they sum to 1."""

    accept: float  # the pose is right
    ambiguous: float  # another pose is
    unsupported: float  # the scans have nothing in common


class Support(NamedTuple):
    """What speaks for the first of some poses and against it."""

    log_odds: float  # that it is right and the scans have not nothing in common
    rivals: dict[int, float]  # log odds that another pose is right instead, by its row
    repetitions: dict[int, float]  # share of what supports the first that each explains, less where expected less
    # rows that lie to either side of the first at one distance and each explain some of what supports it: shelves in
    # a row, of which the first lays those of one scan on the next ones of the other
    regular: tuple[int, ...] = ()
    is_by_prior: bool = False  # whether the scans alone do not distinguish another from the first, and the prior does

    def probabilities(self, accepted: Sequence[int] = ()) -> Probabilities:
        """Return what may come of the match; the `accepted` rows are held by the covariance of the first pose."""
        odds = {row: math.exp(min(value, _MAX_LOG_ODDS)) for row, value in self.rivals.items()}
        nothing = math.exp(min(-self.log_odds, _MAX_LOG_ODDS))
        right = 1.0 + sum(odds[row] for row in accepted if row in odds)
        total = 1.0 + sum(odds.values()) + nothing
        return Probabilities(right / total, 1.0 - (right + nothing) / total, nothing / total)

    def repeated(self) -> list[int]:
        """Return the rows of the poses that cannot be distinguished from the first."""
        return [row for row, share in self.repetitions.items() if share > MAX_REPETITION or row in self.regular]


def support_of(weighed: WeighedPoses, others: Sequence[int]) -> Support:
    """Return what speaks for the first of some poses."""
    shares = {k: weighed.repetition(k) for k in others}
    repetitions = {k: share * weighed.fading(k) for k, share in shares.items()}
    return Support(
        log_odds=weighed.log_odds(0),
        rivals={k: weighed.rival_log_odds(k) for k in others},
        repetitions=repetitions,
        regular=regular_rows(weighed, repetitions),
        is_by_prior=any(share > MAX_REPETITION >= repetitions[k] for k, share in shares.items()),
    )


def regular_rows(weighed: WeighedPoses, repetitions: dict[int, float]) -> tuple[int, ...]:
    """Return the rows of poses that come in pairs, as far from the first to one side as to the other, turned as it is.

    `repetitions` has the rows to look at and the share of the first's support that each explains.
    """
    rows = [k for k, share in repetitions.items() if share > REGULAR and weighed.is_beside(k)]
    sums = {
        (i, j): weighed.poses[i] + weighed.poses[j] - 2.0 * weighed.poses[0] for i, j in itertools.combinations(rows, 2)
    }
    return tuple(row for pair, (x, y, _) in sums.items() if math.hypot(x, y) < NEAR for row in pair)
