"""Fits: one match of the current scan with one reference, compared with what was expected of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan.matchers import MatchResult
from curvescan.matchers.prior import GUESS_SIGMA
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.track import Track
from curvescan.se2 import between
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Pose

SURE = 0.8
"""Least confidence of a match that is accepted where it was not expected, or that ends an outage."""

_CHANCE = np.diag(np.square(GUESS_SIGMA))
"""Covariance of where scans that share nothing are matched by chance, about where the matcher was sent."""


_LIKELY_CHI2 = 4.0
"""Squared Mahalanobis distance within which 95 of 100 motions lie, along one direction."""


class Claim(NamedTuple):
    """What a match says: a pose, the (3, 3) information of the scans alone, and the probability that it is right."""

    pose: Pose
    information: Cov
    confidence: float


class Fit(NamedTuple):
    """A match, and the track after it.

    Attributes
    ----------
    result : MatchResult
        How it went.
    track : Track
        The track after the match; what was expected where the match is not accepted.
    expected : Track
        The prediction that it was fused with.
    confidence : float
        Probability that it is right; 0 where it is not accepted.
    is_surprising : bool
        Whether it contradicts what was expected, and is accepted for being sure.
    is_full : bool
        Whether it measures all of the pose.
    claim : Claim or None
        What was fused with the prediction.
    is_prior_rejected : bool
        Whether the wheels were left out because the match contradicts them and not the last motion.
    """

    result: MatchResult
    track: Track
    expected: Track
    confidence: float = 0.0
    is_surprising: bool = False
    is_full: bool = False
    claim: Claim | None = None
    is_prior_rejected: bool = False

    @property
    def is_accepted(self) -> bool:
        """Whether the match decides where the scan is."""
        return self.confidence > 0.0

    def as_keyframe(self, variance_retained: float) -> Track:
        """Return the track as the scan is placed once it is a keyframe: a share of the match's variance is retained."""
        if self.claim is None:
            return self.track
        return self.expected.at_pose(self.claim.pose, self.claim.information / variance_retained)[0]

    def rank(self, min_score: float) -> tuple[bool, bool, bool, float]:
        """Return what makes one fit better than another."""
        score = self.result.score
        return self.is_accepted, not self.is_surprising, self.is_full, min(score, min_score)


def claim_of(result: MatchResult, expected: Track) -> Claim | None:
    """Return what a match says; of a match in doubt the candidate that agrees with the prediction, if one does."""
    if result.ok:
        confidence = SURE if math.isnan(result.confidence) else result.confidence
        return Claim(result.pose, result.information, confidence)
    if not result.candidates:
        return None
    distances = [expected.at_pose(c.pose, c.information)[1] for c in result.candidates]
    log_odds = [c.log_odds - 0.5 * d for c, d in zip(result.candidates, distances, strict=True)]
    odds = np.exp(np.minimum(log_odds, 50.0))
    best = int(np.argmax(odds))
    confidence = float(odds[best] / (1.0 + odds.sum()))
    candidate = result.candidates[best]
    return Claim(candidate.pose, candidate.information, confidence) if confidence > 0.5 else None


def fitted(result: MatchResult, expected: Track, config: OdometryConfig, unknown_speed: Cov, seconds: float) -> Fit:
    """Return the track after a match: fused with the prediction, or begun anew where it is sure and contradicts that."""
    if not config.is_filtered:
        if not result.ok:
            return Fit(result, expected, expected)
        found = UncertainPose(result.pose, result.covariance)
        speed = expected.speed + between(expected.here, found.pose) / seconds
        track = Track.at(expected.pose_map_keyframe, found, speed, unknown_speed)
        return Fit(result, track, expected, SURE, False, True)
    claim = claim_of(result, expected)
    if claim is None:
        return Fit(result, expected, expected)
    is_full = bool(np.linalg.eigvalsh(claim.information)[0] > 0.5)
    if not is_full:
        claim = claim._replace(information=_bent(claim.information, expected))
    track, distance = expected.at_pose(claim.pose, claim.information)
    if distance <= config.motion.gate_chi2:
        track = track if is_full else _along(track, result)
        return Fit(result, track, expected, _foreseen(claim, expected), False, is_full, claim)
    if not is_full or claim.confidence < SURE:
        return Fit(result, expected, expected)
    # its motion may go on, or have been a single leap
    leap = between(expected.here, claim.pose) / seconds
    wide = expected.loosened(np.diag(unknown_speed) + np.square(leap), seconds)
    return Fit(result, wide.at_pose(claim.pose, claim.information)[0], wide, claim.confidence, True, True, claim)


def _bent(information: Cov, expected: Track) -> Cov:
    """Return the information of a match that leaves a direction open: how that points is known as well as the heading is.

    To first order it says that the sensor is on one line; a metre along it the line is off by the error of the heading.
    """
    values, axes = np.linalg.eigh(information[:2, :2])
    if values[0] > 0.5 or information[2, 2] <= 0.0:
        return information
    along, across = axes[:, 0], np.array([*axes[:, 1], 0.0])
    spread = float(along @ expected.seen.cov[:2, :2] @ along) / float(information[2, 2])
    told = information @ across
    bent: Cov = information - np.outer(told, told) * (spread / (1.0 + spread * float(across @ told)))
    return bent


def _along(track: Track, result: MatchResult) -> Track:
    """Return a track with what a match in which a direction is open says along it, where that is more than is known.

    The best place along a corridor is now and then the wrong one: it counts where the motion may lead there. It errs alike
    in all matches with one keyframe: it is not averaged.
    """
    if not result.candidates or result.degenerate_direction is None:
        return track
    best, along = result.candidates[0], result.degenerate_direction
    if not np.linalg.eigvalsh(best.information)[0] > 0.5:
        return track
    # a unit along the direction, as the track knows it and as the candidate does
    known = float(along @ track.seen.cov @ along) / float(along @ along) ** 2
    told = float(along @ np.linalg.inv(best.information) @ along) / float(along @ along) ** 2
    if told > known:
        return track
    more = np.outer(along, along) / told / float(along @ along) ** 2
    nearer, distance = track.at_pose(best.pose, more)
    return nearer if distance <= _LIKELY_CHI2 else track


def _foreseen(claim: Claim, expected: Track) -> float:
    """Return the probability that a match is right which lies about where the motion led."""
    confidence = min(claim.confidence, 1.0 - 1e-6)
    odds = math.exp(max(_log_evidence(claim, expected), 0.0)) * confidence / (1.0 - confidence)
    return odds / (1.0 + odds)


def _log_evidence(claim: Claim, expected: Track) -> float:
    """Return what it says for a match that it lies where the motion led, logarithm of the odds.

    One by chance lies anywhere about there, a right one within the error of the prediction.
    """
    shares = [np.linalg.det(np.eye(3) + claim.information @ cov) for cov in (_CHANCE, expected.seen.cov)]
    distance = expected.at_pose(claim.pose, claim.information)[1]
    return 0.5 * (math.log(max(shares[0] / shares[1], 1.0)) - distance)
