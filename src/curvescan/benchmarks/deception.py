"""Sure and wrong: the default matcher in worlds made to deceive, with no guess but where the world gives one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.matchers import DEFAULT_METHOD, match
from curvescan.paper.random_transform import SUCCESS
from curvescan.simulation.deceptive import deceptive_pairs
from curvescan.types import Pose


@dataclass(frozen=True, kw_only=True)
class DeceptionScore:
    """How a matcher did in one deceptive world.

    Attributes
    ----------
    world : str
        Name of the deception.
    n_pairs : int
        How many pairs.
    right : float
        Share of pairs matched within 0.1 m and 2 degrees.
    sure_and_wrong : float
        Share matched elsewhere, without naming a degenerate direction.
    flagged_and_wrong : float
        Share matched elsewhere, naming one.
    """

    world: str
    n_pairs: int
    right: float
    sure_and_wrong: float
    flagged_and_wrong: float

    @property
    def unmatched(self) -> float:
        """Share of pairs with no pose."""
        return 1.0 - self.right - self.sure_and_wrong - self.flagged_and_wrong


def score_deception(
    world: str,
    *,
    method: str = DEFAULT_METHOD,
    n_pairs: int = 100,
    seed: int = 1,
    on_pair: Callable[[], None] | None = None,
) -> DeceptionScore:
    """Return how a method does in one deceptive world."""
    right = sure = flagged = 0
    for pair in deceptive_pairs(world, n_pairs=n_pairs, seed=seed):
        result = match(pair.reference, pair.current, method=method, guess=pair.guess)
        if result.ok and is_right(result.pose, pair.pose):
            right += 1
        elif result.ok and result.degenerate_direction is None:
            sure += 1
        elif result.ok:
            flagged += 1
        if on_pair:
            on_pair()
    return DeceptionScore(
        world=world,
        n_pairs=n_pairs,
        right=right / n_pairs,
        sure_and_wrong=sure / n_pairs,
        flagged_and_wrong=flagged / n_pairs,
    )


def is_right(pose: Pose, true: Pose | None) -> bool:
    """Return whether a (3,) pose lies within 0.1 m and 2 degrees of the true one; never where nothing is shared."""
    if true is None:
        return False
    x, y, theta = se2.between(true, pose)
    return bool(np.hypot(x, y) < SUCCESS[0] and abs(theta) < SUCCESS[1])
