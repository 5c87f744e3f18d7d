"""The matcher "idc": iterative dual correspondence.

F. Lu, E. Milios, "Robot pose estimation in unknown environments by matching 2D range scans", Journal of Intelligent and
Robotic Systems 18 (1997), as Núñez et al. 2009, section 3.3, compare with: each reading has two partners on the
reference's surfaces, the closest point, which gives translations, and the point at its own range, which gives
rotations. Both are looked for within a rotation window that shrinks.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import IdcConfig
from curvescan.matchers.baselines.correspondences import closest_points, matching_range_points
from curvescan.matchers.baselines.iteration import LEAST_PAIRS, iterate, keep_best
from curvescan.matchers.baselines.outcome_checks import check_outcome, failure, has_surfaces, start
from curvescan.matchers.baselines.points import ScanPoints, hidden_readings, join, median_filter
from curvescan.matchers.cfsma.alignment import align
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.result import MatchResult, Outcome
from curvescan.scan import LaserScan, valid_readings
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Bools, Floats, Ints, Points, Pose

Rule = Callable[[Points, ScanPoints, float, float], tuple[Points, Floats, Ints]]
"""A correspondence rule: points, reference, window and gate in; partners, squared distances, readings out."""


class IdcMatcher:
    """IDC: median filter, projection filter, two rules a step, a window that shrinks."""

    def __init__(self, config: IdcConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> ScanPoints:
        """Return the median-filtered readings of a scan."""
        return join(median_filter(valid_readings(scan), self.config.median_readings))

    def can_be_reference(self, features: ScanPoints) -> bool:
        """Return whether the scan has a surface at all."""
        return has_surfaces(features)

    def match(self, reference: ScanPoints, current: ScanPoints, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the pose of the prior on."""
        if not (has_surfaces(reference) and has_surfaces(current)):
            return failure("idc", Outcome.NO_SEGMENTS, reference, current)
        config, guess = self.config, start(prior)
        is_hidden, is_ref_hidden = hidden_readings(reference, current, guess)

        def pair(points: Points, rule: Rule, window: float, gate: float) -> _RulePairs:
            partners, squared, ref_idx = rule(points, reference, window, gate)
            squared[is_hidden | is_ref_hidden[ref_idx]] = np.inf
            return _RulePairs(partners, ref_idx, squared, keep_best(squared, config.kept_share))

        def step(pose: Pose, iteration: int) -> Pose | None:
            points = se2.transform(pose, current.points)
            window, gate = config.window.at(iteration), config.gate.at(iteration)
            closest = pair(points, closest_points, window, gate)
            by_range = pair(points, matching_range_points, window, gate)
            if min(closest.n_kept, by_range.n_kept) < LEAST_PAIRS:
                return None
            x, y, _ = align(closest.partners[closest.kept], points[closest.kept]).pose
            _, _, theta = align(by_range.partners[by_range.kept], points[by_range.kept]).pose
            return se2.compose(np.array([x, y, theta]), pose)

        n_shrinking = max(config.window.n_shrinking, config.gate.n_shrinking)
        descent = iterate(guess, step, config.convergence, n_shrinking)
        points = se2.transform(descent.pose, current.points)
        last = pair(points, closest_points, config.window.last, config.gate.last)
        cur_idx = np.flatnonzero(last.kept)
        error = float(last.squared[cur_idx].sum())
        return check_outcome(
            "idc",
            descent,
            reference,
            current,
            (last.ref_idx[cur_idx], cur_idx),
            config.min_share,
            lambda: pose_covariance(current.points[cur_idx], descent.pose, error),
        )


class _RulePairs(NamedTuple):
    """What one rule finds for each current reading, and which of it to keep."""

    partners: Points
    ref_idx: Ints
    squared: Floats
    kept: Bools

    @property
    def n_kept(self) -> int:
        return int(np.count_nonzero(self.kept))
