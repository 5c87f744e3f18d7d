"""Loop closures: a match between keyframes that do not follow each other, and whether it is accepted.

Where the graph knows the relative pose of two keyframes well, a match that lies there within its covariance is accepted. Where it
does not, matches wait until enough of them agree: Mangelson, Dominic, Eustice and Vasudevan, "Pairwise consistent measurement set
maximization for robust multi-robot map merging", ICRA 2018. Two closures agree when the cycle through both and the graph between
their ends closes within its covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.matchers import MatchResult
from curvescan.odometry.measurement import as_measurement
from curvescan.se2.uncertain import UncertainPose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.types import Bools, Cov, Pose

UNKNOWN_M = 10.0
"""Standard deviation of a relative pose of which the graph knows nothing, metres."""


_N_NEIGHBOURS = 10
"""Keyframes that follow each other so closely, about 5 m or 5 rad of way, see the same place without a loop."""


def is_loop(i: ArrayLike, j: ArrayLike) -> Bools:
    """Return whether keyframes, by their numbers, are so far apart along the path that a match of them is a loop closure."""
    return np.abs(np.subtract(j, i)) > _N_NEIGHBOURS


class ClosureOutcome(Enum):
    """What became of a loop-closure candidate; the value is a sentence for people."""

    ACCEPTED = "It lies where the graph expects it."
    AGREED = "Enough others agree with it."
    WAITING = "It waits for others that agree with it."
    FORGOTTEN = "Too few others agreed with it."
    NO_MATCH = "The scans do not match."
    LOW_CONFIDENCE = "The match is too likely to be wrong."
    DEGENERATE = "The match leaves a direction open where the graph does not know it either."
    UNTESTABLE = "Its keyframes follow each other, and the odometry does not know the way between them."
    NOT_DISTINCTIVE = "Other places look as much alike, and nothing is known of the relative pose."
    UNEXPECTED = "The match lies where the graph cannot have it."
    WITHDRAWN = "It was accepted, and bent the odometry more than it can err: places here look alike."


@dataclass(frozen=True, eq=False, kw_only=True)
class Closure:
    """A loop-closure candidate that was matched.

    Attributes
    ----------
    scan : int
        Number of the scan at which it was tried.
    i, j : int
        Keyframes; j is the later one. Within the back end their rows, in all records their numbers, which stay when others go.
    pose : (3,) float64
        Pose of j in the frame of i by the match; NaN where it failed.
    covariance : (3, 3) float64
        Of the edge that it makes.
    score : float
        Of the match.
    confidence : float
        Of the match: the probability that it is right; NaN of a matcher that gives none.
    distance : float
        Squared Mahalanobis distance from where the graph expected it; NaN where it failed.
    outcome : ClosureOutcome
        What became of it.
    is_doubtful : bool
        Whether twice as many must agree: the graph contradicts it, or knows nothing of the relative pose.
    is_indistinct : bool
        Whether nothing is known of the relative pose and other places look as much alike: only a stretch of the way tells.
    """

    scan: int
    i: int
    j: int
    pose: Pose
    covariance: Cov
    score: float
    distance: float
    outcome: ClosureOutcome
    is_doubtful: bool = False
    is_indistinct: bool = False
    confidence: float = math.nan

    @property
    def is_accepted(self) -> bool:
        """Whether it became an edge of the graph."""
        return self.outcome in (ClosureOutcome.ACCEPTED, ClosureOutcome.AGREED)

    @property
    def is_loop(self) -> bool:
        """Whether it is a loop closure, else a match of neighbours; of a record, where i and j are numbers."""
        return bool(is_loop(self.i, self.j))


def is_certain(expected: UncertainPose, config: SlamConfig) -> bool:
    """Return whether the graph knows a relative pose so well that one match is enough."""
    rules = config.closures
    x, y, theta = np.diagonal(expected.cov).tolist()
    return bool(max(x, y) < rules.certain_m**2 and theta < rules.certain_rad**2)


def vaguely(expected: UncertainPose, config: SlamConfig) -> UncertainPose:
    """Return a relative pose of the graph with all that its covariance may leave out."""
    return UncertainPose(expected.pose, config.noise.drift**2 * expected.cov + 4.0 * config.noise.floor)


def judged(result: MatchResult, expected: UncertainPose, config: SlamConfig, *, scan: int, i: int, j: int) -> Closure:
    """Return a match held against what the graph expects."""
    if not result.ok:
        return Closure(
            scan=scan, i=i, j=j, pose=result.pose, covariance=result.covariance,
            score=result.score, distance=float("nan"), outcome=ClosureOutcome.NO_MATCH,
            confidence=result.confidence,
        )  # fmt: skip
    rules = config.closures
    found = as_measurement(result)
    certain = is_certain(expected, config)
    is_unknown = bool(expected.cov[0, 0] > UNKNOWN_M**2)
    distance = fuse(expected, found)[1]
    sigmas = math.sqrt(max(distance, 0.0)) * config.noise.drift  # of the graph's own covariance
    is_against = distance > rules.gate if certain else sigmas > rules.sigmas
    is_doubtful = is_unknown or is_against or (not certain and sigmas > rules.likely_sigmas)
    is_linked = j - i <= config.keyframes.n_linked
    if not is_confident(result, config):
        outcome = ClosureOutcome.LOW_CONFIDENCE
    elif not certain and not _knows_along(result, expected, config):
        outcome = ClosureOutcome.DEGENERATE
    elif not certain and (is_linked or not (is_unknown or is_loop(i, j))):
        outcome = ClosureOutcome.UNTESTABLE
    elif is_against:
        off = found.pose - expected.pose
        is_turned = abs(float(se2.wrap(off[2]))) > rules.doubt_rad
        is_far = is_turned or math.hypot(off[0], off[1]) > rules.doubt_m
        is_open = result.degenerate_direction is not None
        outcome = ClosureOutcome.UNEXPECTED if is_far or is_linked or is_open else ClosureOutcome.WAITING
    else:
        outcome = ClosureOutcome.ACCEPTED if certain else ClosureOutcome.WAITING
    return Closure(
        scan=scan, i=i, j=j, pose=result.pose, covariance=config.noise.edge(found.cov),
        score=result.score, distance=distance, outcome=outcome,
        is_doubtful=is_doubtful, confidence=result.confidence,
    )  # fmt: skip


def is_confident(result: MatchResult, config: SlamConfig) -> bool:
    """Return whether a match is likely enough to be right; of a matcher that does not say, its score decides."""
    if math.isnan(result.confidence):
        return not result.score < config.closures.min_score
    return result.confidence >= config.closures.min_confidence


def _knows_along(result: MatchResult, expected: UncertainPose, config: SlamConfig) -> bool:
    """Return whether the graph knows what a match leaves open; of a match that leaves nothing open it need not."""
    along = result.degenerate_direction
    if along is None:
        return True
    x, y, theta = along.tolist()
    return bool(
        along @ expected.cov @ along
        < (config.closures.certain_m * math.hypot(x, y)) ** 2 + (config.closures.certain_rad * theta) ** 2
    )
