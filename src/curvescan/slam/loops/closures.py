"""Loop closures: a match between keyframes that do not follow each other, and how likely it is.

The log odds of a match are its own, by its confidence, and those of where the graph expects it. Where they suffice it
is accepted alone; else it waits for others that agree with it (:mod:`agreement`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from curvescan.matchers import MatchResult
from curvescan.matchers.result import log_odds
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.odometry.measurement import CERTAIN, as_measurement
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, fuse, inverse3
from curvescan.slam.config import ANYWHERE_M, SlamConfig
from curvescan.slam.loops.cycles import difference
from curvescan.slam.open_direction import within_sight
from curvescan.types import Bools, Cov, Pose

_N_NEIGHBOURS = 10
"""Keyframes that follow each other so closely, about 5 m or 5 rad of way, see the same place without a loop."""

MOST_ODDS = math.log(99.0)  # that one match says for itself: of those of a confidence of 0.99 one in a hundred is wrong

SLIP: Cov = np.diag([ANYWHERE_M**2, ANYWHERE_M**2, 1.0])
"""(3, 3) covariance of what a way may have slipped and bent without the odometry noticing."""


def is_loop(i: ArrayLike, j: ArrayLike) -> Bools:
    """Return whether keyframes, by their numbers, are so far apart along the path that their match closes a loop."""
    return np.abs(np.subtract(j, i)) > _N_NEIGHBOURS


class ClosureOutcome(Enum):
    """What became of a loop-closure candidate; the value is a sentence for people."""

    ACCEPTED = "It lies where the graph expects it."
    AGREED = "Others agree with it, and together they are likelier than anything that contradicts them."
    WAITING = "It waits for others that agree with it."
    NO_MATCH = "The scans do not match."
    UNEXPECTED = "The match lies where the graph does not expect it, and is not likely enough alone."


@dataclass(frozen=True, eq=False, kw_only=True, slots=True, repr=False)
class Closure:
    """A loop-closure candidate that was matched: within the back end keyframes by row, in all records by number."""

    scan: int  # number of the scan at which it was tried
    i: int  # keyframe
    j: int  # the later keyframe
    pose: Pose  # (3,): of j in the frame of i by the match; NaN where it failed
    covariance: Cov  # (3, 3): of the edge that it makes
    score: float  # of the match
    distance: float  # squared Mahalanobis distance from where the graph expected it; NaN where it failed
    outcome: ClosureOutcome  # what became of it
    confidence: float = math.nan  # probability that the match is right; NaN of a matcher that gives none
    expectation: float = math.nan  # log odds that the graph gives a pose there against any nearby; NaN where it failed
    place: UncertainPose | None = None  # the edge, where the scans tell where along an open way it lies: no evidence

    def __repr__(self) -> str:
        x, y, theta = self.pose.tolist()
        return f"Closure({self.i} to {self.j}: {self.outcome.name}, x={x:.3f} m, y={y:.3f} m, theta={theta:.4f} rad)"

    @property
    def log_odds(self) -> float:
        """Log odds of the match by its confidence; even ones without."""
        return min(log_odds(self.confidence), MOST_ODDS)

    @property
    def is_accepted(self) -> bool:
        """Whether it became an edge of the graph."""
        return self.outcome in (ClosureOutcome.ACCEPTED, ClosureOutcome.AGREED)

    @property
    def is_loop(self) -> bool:
        """Whether it is a loop closure, else a match of neighbours; of a record, where i and j are numbers."""
        return bool(is_loop(self.i, self.j))


def is_certain(expected: UncertainPose, config: SlamConfig) -> bool:
    """Return whether the graph knows a relative pose so well that it may guide a match."""
    return bool(max(expected.covariance[0, 0], expected.covariance[1, 1]) < config.closures.certain_m**2)


def closure_of(
    result: MatchResult, expected: UncertainPose, config: SlamConfig, *views: LaserScan,
    scan: int, i: int, j: int, is_apart: bool = False,
) -> Closure:  # fmt: skip
    """Return the record of a match of two views, and whether it alone is likely enough where the graph expects it."""
    tried = Closure(
        scan=scan, i=i, j=j, pose=result.pose, covariance=result.covariance, score=result.score,
        distance=math.nan, outcome=ClosureOutcome.NO_MATCH, confidence=result.confidence,
    )  # fmt: skip
    if not result.ok:
        return tried
    claims = [found := as_measurement(result)]
    if (along := result.degenerate_direction) is not None:  # a corridor seen askew would push what stands afar
        tried = replace(tried, pose=result.pose + ((expected.pose - result.pose) @ along) * along)
        # speaks against it, and not for it: all of a corridor is alike
        claims.append(within_sight(found, along, *views))
    distance = fuse(expected, found)[1]
    off = ((difference(expected.pose, one.pose), expected.covariance + one.covariance) for one in claims)
    expectation = min(expectation_of(*one, config, is_open=along is not None, is_apart=is_apart) for one in off)
    tried = replace(tried, covariance=config.noise.edge(found.covariance), distance=distance, expectation=expectation)
    if expectation + tried.log_odds > config.closures.log_odds:
        return replace(tried, outcome=ClosureOutcome.ACCEPTED)
    return replace(tried, outcome=ClosureOutcome.WAITING if is_loop(i, j) else ClosureOutcome.UNEXPECTED)


def expectation_of(off: Pose, cov: Cov, config: SlamConfig, *, is_open: bool, is_apart: bool = False) -> float:
    """Return how much the graph speaks for a match there: log odds against a wrong match, which may lie anywhere.

    A slip between two keyframes is as unlikely as a closure must be likely; that a sensor was carried away where its
    track was lost, as unlikely as one sure match.

    off (3,): from where the graph expects it, as it is or after a slip; cov (3, 3): of the graph and the match
    together; is_open: whether a direction is not measured: corridors run side by side. Else the heading found tells how
    far a turn that nobody saw has led astray; is_apart: whether the track was lost between the two.
    """
    n = 2 if is_open else 3
    unseen, odds = (LOST_COVARIANCE, CERTAIN) if is_apart else (SLIP, config.closures.log_odds)
    return max(_gained(off, cov, n), _gained(off, cov + unseen, n) - odds)


def _gained(off: Pose, cov: Cov, n: int) -> float:
    distance = float(off @ inverse3(cov) @ off)
    if not math.isfinite(distance):
        return -math.inf
    anywhere = cov + np.diag([ANYWHERE_M**2, ANYWHERE_M**2, 0.0])  # headings, of the walls, tell nothing
    return 0.5 * (math.log(np.linalg.det(anywhere[:n, :n]) / np.linalg.det(cov[:n, :n])) - distance)
