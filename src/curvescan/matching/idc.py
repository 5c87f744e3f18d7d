"""The matcher "idc": iterative dual correspondence.

F. Lu, E. Milios, "Robot pose estimation in unknown environments by matching 2D range scans", Journal of Intelligent
and Robotic Systems 18 (1997), and cf-sma section 6: each reading has two partners on the reference's surfaces, the
closest point, which tells translations, and the point at its own range, which tells rotations. Both are looked for
within a rotation window that shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.cfsma.alignment import align
from curvescan.cfsma.covariance import pose_covariance
from curvescan.matching.assembly import Pairs, conclude, failure, has_surfaces, start
from curvescan.matching.result import MatchResult, Outcome
from curvescan.rivals.config import IdcConfig
from curvescan.rivals.correspondences import closest_points, matching_range_points
from curvescan.rivals.filters import is_visible, median_filter
from curvescan.rivals.iteration import LEAST_PAIRS, descend, keep_best
from curvescan.rivals.sweep import Sweep, join
from curvescan.scan import LaserScan, valid_readings
from curvescan.types import Bools, Floats, Ints, Points, Pose


class IdcMatcher:
    """IDC: median filter, projection filter, two rules a step, a window that shrinks."""

    def __init__(self, config: IdcConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> Sweep:
        """Return the median-filtered readings of a scan."""
        return join(median_filter(valid_readings(scan), self.config.median_readings))

    def can_be_reference(self, features: Sweep) -> bool:
        """Return whether the scan has a surface at all."""
        return has_surfaces(features)

    def match(self, reference: Sweep, current: Sweep, guess: Pose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the guess on."""
        if not (has_surfaces(reference) and has_surfaces(current)):
            return failure("idc", Outcome.NO_SEGMENTS, reference, current)
        config = self.config

        def step(pose: Pose, iteration: int) -> Pose | None:
            window, gate = config.window.at(iteration), config.gate.at(iteration)
            near, far = self._pair(reference, current, pose, window, gate)
            if min(near.cur_idx.size, far.cur_idx.size) < LEAST_PAIRS:
                return None
            x, y, _ = align(near.partners, near.points)[0]
            _, _, theta = align(far.partners, far.points)[0]
            return se2.compose(np.array([x, y, theta]), pose)

        n_shrinking = max(config.window.n_shrinking, config.gate.n_shrinking)
        descent = descend(start(guess), step, config.convergence, n_shrinking)
        near, _ = self._pair(
            reference, current, descent.pose, config.window.last, config.gate.last
        )
        pairs = Pairs(cur_idx=near.cur_idx, ref_idx=near.ref_idx, normals=reference.normals[near.ref_idx])
        return conclude(
            "idc",
            descent,
            pairs,
            reference,
            current,
            config.min_share,
            lambda _: pose_covariance(current.points[pairs.cur_idx], descent.pose, near.error),
        )

    def _pair(
        self, reference: Sweep, current: Sweep, pose: Pose, window: float, gate: float
    ) -> tuple[_DualPairs, _DualPairs]:
        """Return the pairs of both rules, hidden readings and outliers left out."""
        points = se2.transform(pose, current.points)
        ref_seen = se2.transform(se2.inverse(pose), reference.points)
        in_sight = is_visible(points, current.is_joined, reference.angle_step)
        ref_in_sight = is_visible(ref_seen, reference.is_joined, current.angle_step)
        found = (
            closest_points(points, reference, window, gate),
            matching_range_points(points, reference, window, gate),
        )
        near, far = (
            _keep(points, rule, in_sight, ref_in_sight, self.config.kept_share) for rule in found
        )
        return near, far


@dataclass(frozen=True, eq=False, kw_only=True)
class _DualPairs:
    """Pairs of one rule: readings of cur, their points and their partners' in ref."""

    cur_idx: Ints
    ref_idx: Ints
    points: Points
    partners: Points
    error: float


def _keep(
    points: Points,
    found: tuple[Points, Floats, Ints],
    in_sight: Bools,
    ref_in_sight: Bools,
    share: float,
) -> _DualPairs:
    partners, squared, ref_idx = found
    squared = np.where(in_sight & ref_in_sight[ref_idx], squared, np.inf)
    cur_idx = np.flatnonzero(keep_best(squared, share))
    return _DualPairs(
        cur_idx=cur_idx,
        ref_idx=ref_idx[cur_idx],
        points=points[cur_idx],
        partners=partners[cur_idx],
        error=float(squared[cur_idx].sum()),
    )
