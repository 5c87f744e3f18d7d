"""The loop all iterated methods share: step, look whether it still moves, step again; and their outlier gates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from curvescan.matchers.baselines.config import ConvergenceConfig
from curvescan.types import Bools, Floats, Pose

LEAST_PAIRS = 5  # pairs under which no step is taken; a pose has three unknowns


@dataclass(frozen=True, eq=False, kw_only=True)
class IterationTrace:
    """The way of an iterated method from its guess to where it stopped."""

    poses: Pose  # (k + 1, 3): pose of cur in ref before the first iteration and after each
    has_converged: bool  # whether the last iteration stayed within the limits of where it, or an earlier one, had been
    is_lost: bool  # whether a step found too little to stand on

    @property
    def pose(self) -> Pose:
        """Where it stopped."""
        last: Pose = self.poses[-1]
        return last

    @property
    def n_iterations(self) -> int:
        """Number of steps taken."""
        return len(self.poses) - 1


def iterate(
    guess: Pose, step: Callable[[Pose, int], Pose | None], config: ConvergenceConfig, n_shrinking: int = 0
) -> IterationTrace:
    """Return the poses of a method that repeats one step until it no longer moves.

    A few pairs that change sides for ever make a method jump between two or three poses. That is convergence too, as
    long as they lie within the limits of each other, and is found by looking at every earlier pose.

    guess (3,); step.
    """
    poses = [(float(guess[0]), float(guess[1]), float(guess[2]))]
    has_converged = is_lost = False
    for iteration in range(max(config.max_iterations, n_shrinking + 1)):
        found = step(np.array(poses[-1]), iteration)
        if found is None:
            is_lost = True
            break
        pose = (float(found[0]), float(found[1]), float(found[2]))
        has_converged = iteration >= n_shrinking and any(
            _is_near(pose, earlier, config) for earlier in poses[n_shrinking:]
        )
        poses.append(pose)
        if has_converged:
            break
    return IterationTrace(poses=np.array(poses), has_converged=has_converged, is_lost=is_lost)


def keep_best(squared: Floats, share: float) -> Bools:
    """Return which pairs belong to the best share of those that have a partner.

    squared (n,): Squared distances; inf where there is no partner.
    """
    paired = np.isfinite(squared)
    n = int(np.count_nonzero(paired))
    n_kept = math.ceil(share * n)
    if n_kept >= n:
        return paired
    limit = np.partition(squared, n_kept - 1)[n_kept - 1]
    kept: Bools = squared <= limit
    return kept


def within_quantile(squared: Floats, kept: Bools, order: float, factor: float) -> Bools:
    """Return which of the kept pairs lie within `factor` times the distance of their own quantile.

    The adaptive gate of Censi's PL-ICP: when most pairs are close, those that are not are outliers.

    squared (n,); kept (n,).
    """
    distances = squared[kept]
    if distances.size == 0:
        return kept
    at = math.ceil(order * distances.size) - 1
    limit = factor * factor * np.partition(distances, at)[at]
    near: Bools = kept & (squared <= limit)
    return near


def _is_near(pose: tuple[float, float, float], other: tuple[float, float, float], config: ConvergenceConfig) -> bool:
    turned = abs((pose[2] - other[2] + math.pi) % (2.0 * math.pi) - math.pi)
    moved = math.hypot(pose[0] - other[0], pose[1] - other[1])
    return moved < config.min_translation and turned < config.min_rotation
