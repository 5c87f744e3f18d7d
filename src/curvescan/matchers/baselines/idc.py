"""The matcher "idc": iterative dual correspondence.

F. Lu, E. Milios, "Robot pose estimation in unknown environments by matching 2D range scans", Journal of Intelligent and
Robotic Systems 18 (1997), as Núñez et al. 2009, section 3.3, compare with: each reading has two partners on the
reference's surfaces, the closest point, which gives translations, and the point at its own range, which gives
rotations. Both are looked for within a rotation window that shrinks.
"""

from collections.abc import Callable

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import IdcConfig
from curvescan.matchers.baselines.correspondences import closest_points, matching_range_points
from curvescan.matchers.baselines.iteration import LEAST_PAIRS, keep_best
from curvescan.matchers.baselines.outcome_checks import Iteration, has_surfaces, match_by_iteration, start
from curvescan.matchers.baselines.points import ScanPoints, hidden_readings, sweep_of
from curvescan.matchers.cfsma.alignment import align
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.result import MatchResult
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Floats, Ints, Points, Pose

Rule = Callable[[Points, ScanPoints, float, float], tuple[Points, Floats, Ints]]
"""A correspondence rule: points, reference, window and gate in; partners, squared distances, readings out."""

_Aligned = tuple[Points, Points]  # partners, and the readings that they belong to


class IdcMatcher:
    """IDC: median filter, projection filter, two rules a step, a window that shrinks."""

    def __init__(self, config: IdcConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> ScanPoints:
        """Return the median-filtered readings of a scan."""
        return sweep_of(scan, self.config.median_readings)

    def can_be_reference(self, features: ScanPoints) -> bool:
        """Return whether the scan has a surface at all."""
        return has_surfaces(features)

    def match(self, reference: ScanPoints, current: ScanPoints, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the pose of the prior on."""
        config = self.config
        is_hidden, is_ref_hidden = hidden_readings(reference, current, start(prior))

        def kept(rule: Rule, points: Points, iteration: float) -> tuple[Ints, Ints, Points, Floats]:
            partners, squared, ref_idx = rule(points, reference, config.window.at(iteration), config.gate.at(iteration))
            squared[is_hidden | is_ref_hidden[ref_idx]] = np.inf
            cur_idx = np.flatnonzero(keep_best(squared, config.kept_share))
            return ref_idx[cur_idx], cur_idx, partners[cur_idx], squared[cur_idx]

        def pair(pose: Pose, iteration: float) -> tuple[Ints, Ints, Floats, _Aligned, _Aligned]:
            points = se2.transform(pose, current.points)
            ref_idx, cur_idx, closest, squared = kept(closest_points, points, iteration)
            _, by_range_idx, by_range, _ = kept(matching_range_points, points, iteration)
            return ref_idx, cur_idx, squared, (closest, points[cur_idx]), (by_range, points[by_range_idx])

        def move(pose: Pose, _: Ints, __: Ints, squared: Floats, closest: _Aligned, by_range: _Aligned) -> Pose | None:
            if len(by_range[0]) < LEAST_PAIRS:
                return None
            x, y, _theta = align(*closest).pose
            return se2.compose(np.array([x, y, align(*by_range).pose[2]]), pose)

        def covariance(pose: Pose, _: Ints, cur_idx: Ints, squared: Floats, *others: _Aligned) -> Cov:
            return pose_covariance(current.points[cur_idx], pose, float(squared.sum()))

        n_shrinking = max(config.window.n_shrinking, config.gate.n_shrinking)
        idc = Iteration(method="idc", pair=pair, move=move, covariance=covariance, n_shrinking=n_shrinking)
        return match_by_iteration(idc, reference, current, prior, config.convergence, config.min_share)
