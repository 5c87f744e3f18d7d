"""The matcher "plicp": point to line ICP.

A. Censi, "An ICP variant using a point-to-line metric", ICRA 2008: each reading is paired with the line through the
reference at its nearest reading, outliers are trimmed, the squared normal distances are minimised, and again.
"""

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import PlIcpConfig
from curvescan.matchers.baselines.correspondences import nearest_readings
from curvescan.matchers.baselines.iteration import (
    jacobian,
    keep_best,
    point_to_line_step,
    propagated_covariance,
    within_quantile,
)
from curvescan.matchers.baselines.outcome_checks import Iteration, has_surfaces, match_by_iteration
from curvescan.matchers.baselines.points import ScanPoints, sweep_of
from curvescan.matchers.result import MatchResult
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Ints, Pose

_ADAPTIVE_ORDER, _ADAPTIVE_FACTOR = 0.7, 2.0
"""The adaptive gate: so many times this quantile of the distances; the values of Censi's program."""


class PlIcpMatcher:
    """PL-ICP.

    Departure: Censi's line goes through the nearest reading and its neighbour. Here its direction is fitted to the
    readings within 0.15 m: with 10 mm of noise, two neighbours 17 mm apart can give any direction. On simulated pairs
    0.6 m and 40 degrees apart it raised the right matches from 83 to 92 %, among people from 57 to 74 %.

    Departure: the greatest distance of a pair shrinks from iteration to iteration, as the scans come together.
    """

    def __init__(self, config: PlIcpConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> ScanPoints:
        """Return the readings of a scan with their tangents."""
        return sweep_of(scan)

    def can_be_reference(self, features: ScanPoints) -> bool:
        """Return whether the scan has a surface at all."""
        return has_surfaces(features)

    def match(self, reference: ScanPoints, current: ScanPoints, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the pose of the prior on."""
        config = self.config

        def pair(pose: Pose, iteration: float) -> tuple[Ints, Ints]:
            points = se2.transform(pose, current.points)
            ref_idx, squared = nearest_readings(points, reference, config.gate.at(iteration))
            squared[np.isnan(reference.tangents[ref_idx, 0])] = np.inf
            kept = keep_best(squared, config.kept_share)
            kept = within_quantile(squared, kept, _ADAPTIVE_ORDER, _ADAPTIVE_FACTOR)
            return ref_idx[kept], np.flatnonzero(kept)

        def move(pose: Pose, ref_idx: Ints, cur_idx: Ints) -> Pose | None:
            anchors, normals = reference.points[ref_idx], reference.normals[ref_idx]
            return point_to_line_step(current.points[cur_idx], anchors, normals, pose)

        def covariance(pose: Pose, ref_idx: Ints, cur_idx: Ints) -> Cov:
            # Censi's closed form: range noise of both scans, each along its own beam
            points, anchors, normals = current.points[cur_idx], reference.points[ref_idx], reference.normals[ref_idx]
            beams_cur = points @ se2.rotation(pose[2]).T / current.ranges[cur_idx, np.newaxis]
            beams_ref = anchors / reference.ranges[ref_idx, np.newaxis]
            errors = np.sum(normals * (se2.transform(pose, points) - anchors), axis=1)
            sources = (
                (np.arange(cur_idx.size), np.sum(normals * beams_cur, axis=1)),
                (ref_idx, np.sum(normals * beams_ref, axis=1)),
            )
            return propagated_covariance(jacobian(points, normals, pose), errors, sources, config.range_sigma)

        plicp = Iteration(method="plicp", pair=pair, move=move, covariance=covariance, n_shrinking=0)
        return match_by_iteration(plicp, reference, current, prior, config.convergence, config.min_share)
