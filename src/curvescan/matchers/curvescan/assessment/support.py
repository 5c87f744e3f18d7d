"""Support: what speaks for the best of some poses, against it, and which other poses the scans cannot tell from it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from curvescan.matchers.curvescan.assessment.confidence import WeighedPoses
from curvescan.matchers.curvescan.config import NEAR, SAME
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.types import Floats

# Least share of what supports a pose that another explains at which the two cannot be distinguished.
MAX_REPETITION = 0.45
_REGULAR = 0.33  # the same of two poses as far from it to either side, as in a row of equal things
_PITCH = 0.5  # least distance of the things in a row, metres
_MAX_LOG_ODDS = 60  # beyond it a probability is 0 or 1


@dataclass(frozen=True, kw_only=True)
class Support:
    """What speaks for the first of some poses and against it."""

    log_odds: float  # that it is right and the scans have not nothing in common
    rivals: dict[int, float]  # log odds, for each other pose that may be right instead, by its row
    repetitions: dict[int, float]  # share of what supports the first that each of them explains
    # rows that lie to either side of the first at one distance and each explain some of what supports it: shelves in
    # a row, of which the first lays those of one scan on the next ones of the other
    regular: tuple[int, ...] = ()

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
        return [row for row, share in self.repetitions.items() if share > MAX_REPETITION or row in self.regular]


def support_of(weighed: WeighedPoses, others: Sequence[int], is_degenerate: bool) -> Support:
    """Return what speaks for the first of some poses."""
    found = {k: weighed.rival_log_odds(k) for k in others}
    repetitions = {k: repetition for k, (_, repetition) in found.items()}
    return Support(
        log_odds=weighed.log_odds(0, is_degenerate),
        rivals={k: odds for k, (odds, _) in found.items()},
        repetitions=repetitions,
        regular=regular_rows(weighed.poses, repetitions),
    )


def regular_rows(poses: Floats, repetitions: dict[int, float]) -> tuple[int, ...]:
    """Return the rows of poses that come in pairs, as far from the first to one side as to the other, turned as it is.

    `repetitions` has the rows to look at and the share of the first's support that each explains.
    """
    found = []
    rows = [k for k, share in repetitions.items() if share > _REGULAR]
    offsets = {k: difference(poses[k], poses[0]) for k in rows}
    for i, j in itertools.combinations(rows, 2):
        (x, y, turn), (x_other, y_other, turn_other) = offsets[i], offsets[j]
        is_alike = max(abs(turn), abs(turn_other)) < SAME
        is_mirrored = math.hypot(x + x_other, y + y_other) < NEAR
        if is_alike and is_mirrored and math.hypot(x, y) > _PITCH:
            found += [i, j]
    return tuple(found)
