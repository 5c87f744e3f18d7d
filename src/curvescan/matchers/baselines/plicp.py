"""The matcher "plicp": point to line ICP.

A. Censi, "An ICP variant using a point-to-line metric", ICRA 2008: each reading is paired with the line through the
reference at its nearest reading, outliers are trimmed, the squared normal distances are minimised, and again.
"""

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import PlIcpConfig
from curvescan.matchers.baselines.correspondences import nearest_readings
from curvescan.matchers.baselines.iteration import (
    LEAST_PAIRS,
    iterate,
    jacobian,
    keep_best,
    point_to_line_step,
    propagated_covariance,
    within_quantile,
)
from curvescan.matchers.baselines.outcome_checks import check_outcome, failure, has_surfaces, start
from curvescan.matchers.baselines.points import ScanPoints, sweep_of
from curvescan.matchers.result import MatchResult, Outcome
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
        if not (has_surfaces(reference) and has_surfaces(current)):
            return failure("plicp", Outcome.NO_SEGMENTS, reference, current)
        gate = self.config.gate

        def step(pose: Pose, iteration: int) -> Pose | None:
            ref_idx, cur_idx = self._pair(reference, current, pose, gate.at(iteration))
            if cur_idx.size < LEAST_PAIRS:
                return None
            anchors, normals = reference.points[ref_idx], reference.normals[ref_idx]
            return point_to_line_step(current.points[cur_idx], anchors, normals, pose)

        descent = iterate(start(prior), step, self.config.convergence)
        pairs = self._pair(reference, current, descent.pose, gate.at(descent.n_iterations))
        return check_outcome(
            "plicp",
            descent,
            reference,
            current,
            pairs,
            self.config.min_share,
            lambda: self._covariance(reference, current, descent.pose, pairs),
        )

    def _pair(self, reference: ScanPoints, current: ScanPoints, pose: Pose, gate: float) -> tuple[Ints, Ints]:
        """Return the readings of the reference and of the current scan that belong together."""
        config = self.config
        points = se2.transform(pose, current.points)
        ref_idx, squared = nearest_readings(points, reference, gate)
        squared[np.isnan(reference.tangents[ref_idx, 0])] = np.inf
        kept = keep_best(squared, config.kept_share)
        kept = within_quantile(squared, kept, _ADAPTIVE_ORDER, _ADAPTIVE_FACTOR)
        return ref_idx[kept], np.flatnonzero(kept)

    def _covariance(self, reference: ScanPoints, current: ScanPoints, pose: Pose, pairs: tuple[Ints, Ints]) -> Cov:
        """Return Censi's closed form: range noise of both scans, each along its own beam."""
        ref_idx, cur_idx = pairs
        points, anchors = current.points[cur_idx], reference.points[ref_idx]
        normals = reference.normals[ref_idx]
        beams_cur = points @ se2.rotation(pose[2]).T / current.ranges[cur_idx, np.newaxis]
        beams_ref = anchors / reference.ranges[ref_idx, np.newaxis]
        errors = np.sum(normals * (se2.transform(pose, points) - anchors), axis=1)
        sources = (
            (np.arange(cur_idx.size), np.sum(normals * beams_cur, axis=1)),
            (ref_idx, np.sum(normals * beams_ref, axis=1)),
        )
        rows = jacobian(points, normals, pose)
        return propagated_covariance(rows, errors, sources, self.config.range_sigma)
