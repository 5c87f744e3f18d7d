"""The matcher "icp": point to point ICP.

P. J. Besl, N. D. McKay, "A method for registration of 3-D shapes", IEEE Transactions on Pattern Analysis and Machine
Intelligence 14 (1992); partners that are too far are dropped, as Z. Zhang, "Iterative point matching for registration
of free-form curves and surfaces", International Journal of Computer Vision 13 (1994), showed to be needed where one
scan sees what the other does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import IcpConfig
from curvescan.matchers.baselines.iteration import keep_best
from curvescan.matchers.baselines.outcome_checks import Iteration, has_surfaces, match_by_iteration
from curvescan.matchers.baselines.points import ScanPoints, sweep_of
from curvescan.matchers.cfsma.alignment import align
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.result import MatchResult
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Ints, Pose

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


class IcpFeatures(NamedTuple):
    """Readings of one scan and the tree in which the nearest of them is looked up."""

    points: ScanPoints
    tree: cKDTree


class IcpMatcher:
    """ICP: nearest pairs aligned in closed form, again and again. Departure: the greatest distance shrinks."""

    def __init__(self, config: IcpConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> IcpFeatures:
        """Return the readings of a scan, and the k-d tree in which the nearest of them is found."""
        from scipy.spatial import cKDTree  # loaded when it is used, for the other matchers need none

        points = sweep_of(scan)
        return IcpFeatures(points, cKDTree(points.points))

    def can_be_reference(self, features: IcpFeatures) -> bool:
        """Return whether the scan has a surface at all."""
        return has_surfaces(features.points)

    def match(self, reference: IcpFeatures, current: IcpFeatures, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the pose of the prior on."""
        ref, cur, config = reference.points, current.points, self.config

        def pair(pose: Pose, iteration: float) -> tuple[Ints, Ints]:
            points = se2.transform(pose, cur.points)
            distances, ref_idx = reference.tree.query(points, distance_upper_bound=config.gate.at(iteration))
            cur_idx = np.flatnonzero(keep_best(distances * distances, config.kept_share))
            return ref_idx[cur_idx], cur_idx

        def move(pose: Pose, ref_idx: Ints, cur_idx: Ints) -> Pose:
            return align(ref.points[ref_idx], cur.points[cur_idx]).pose

        def covariance(pose: Pose, ref_idx: Ints, cur_idx: Ints) -> Cov:
            # eqs. 16-17, which take pairs for points seen twice: along a surface far too small (docs/baselines.md)
            apart = se2.transform(pose, cur.points[cur_idx]) - ref.points[ref_idx]
            return pose_covariance(cur.points[cur_idx], pose, float(np.vdot(apart, apart)))

        n_shrinking = config.gate.n_shrinking
        icp = Iteration(method="icp", pair=pair, move=move, covariance=covariance, n_shrinking=n_shrinking)
        return match_by_iteration(icp, ref, cur, prior, config.convergence, config.min_share)
