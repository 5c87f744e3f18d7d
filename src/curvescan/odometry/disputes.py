"""Disputed loop closures: earlier keyframes that agree with each other and contradict the chain of matches.

One such place is not enough, for rooms resemble each other. But a chain in which one match was wrong errs by more than its
covariance says, and then every place that it comes back to contradicts it, all by the same correction. So what several
places in a row ask for is taken.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from curvescan import se2
from curvescan.odometry.config import KeyframesConfig
from curvescan.types import Pose

_MAX_HELD = 8
"""Disputes that are remembered, the last ones."""

_SAME_M, _SAME_RAD = 0.3, 0.06
"""Two disputes ask for the same correction when it leads to within this: metres, radians."""

_ELSEWHERE = 0.5
"""Share of the distance and turn at which a keyframe is due from which on another scan's dispute is one of another place."""


class Dispute(NamedTuple):
    """Where two accounts have one scan, in the frame of the first one.

    Attributes
    ----------
    by_chain : (3,) float64
        By the chain of matches.
    by_closure : (3,) float64
        By earlier keyframes.
    """

    by_chain: Pose
    by_closure: Pose


def is_settled(dispute: Dispute, earlier: tuple[Dispute, ...], config: KeyframesConfig) -> bool:
    """Return whether so many earlier disputes ask for the same correction that it is taken."""
    n_agreeing = sum(_agree(dispute, other) for other in earlier if _is_elsewhere(dispute, other, config))
    return n_agreeing + 1 >= config.min_disputes


def remembered(dispute: Dispute, earlier: tuple[Dispute, ...], config: KeyframesConfig) -> tuple[Dispute, ...]:
    """Return the disputes with another one, unless it is about the place of the last."""
    if earlier and not _is_elsewhere(dispute, earlier[-1], config):
        return earlier
    return (*earlier, dispute)[-_MAX_HELD:]


def _agree(one: Dispute, other: Dispute) -> bool:
    moved = se2.between(other.by_chain, one.by_chain)
    x, y, theta = se2.between(one.by_closure, se2.compose(other.by_closure, moved)).tolist()
    return math.hypot(x, y) < _SAME_M and abs(theta) < _SAME_RAD


def _is_elsewhere(one: Dispute, other: Dispute, config: KeyframesConfig) -> bool:
    x, y, theta = se2.between(other.by_chain, one.by_chain).tolist()
    return math.hypot(x, y) >= _ELSEWHERE * config.distance or abs(theta) >= _ELSEWHERE * config.turn
