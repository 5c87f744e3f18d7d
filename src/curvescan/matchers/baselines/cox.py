"""The matcher "cox": points to lines.

I. J. Cox, "Blanche: an experiment in guidance and navigation of an autonomous robot vehicle", IEEE Transactions on
Robotics and Automation 7 (1991); with lines taken from the reference scan by J.-S. Gutmann and C. Schlegel, "AMOS:
comparison of scan matching approaches for self-localization in indoor environments", EUROBOT 1996.
"""

from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import CoxConfig
from curvescan.matchers.baselines.iteration import jacobian, point_to_line_step, propagated_covariance
from curvescan.matchers.baselines.lines import Lines, extract_lines, nearest_lines
from curvescan.matchers.baselines.outcome_checks import Iteration, failure, has_surfaces, match_by_iteration, start
from curvescan.matchers.baselines.points import ScanPoints, hidden_readings, sweep_of
from curvescan.matchers.result import MatchResult, Outcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Bools, Cov, Ints, Points, Pose


class CoxFeatures(NamedTuple):
    """Readings and lines of one scan."""

    points: ScanPoints
    lines: Lines


class CoxMatcher:
    """Cox's matcher: assign each reading to the nearest line, minimise the normal distances, repeat.

    Departure: the greatest distance of a reading from its line shrinks from iteration to iteration, as the scans
    come together. Cox drives between scans and knows his motion to centimetres.
    """

    def __init__(self, config: CoxConfig) -> None:
        self.config = config

    def prepare(self, scan: LaserScan) -> CoxFeatures:
        """Return the readings and the lines of a scan."""
        points = sweep_of(scan, self.config.median_readings)
        return CoxFeatures(points, extract_lines(points, self.config.lines))

    def can_be_reference(self, features: CoxFeatures) -> bool:
        """Return whether the scan has a line."""
        return len(features.lines) > 0

    def match(self, reference: CoxFeatures, current: CoxFeatures, prior: UncertainPose | None) -> MatchResult:
        """Return the pose of `current` in `reference`, found from the pose of the prior on."""
        lines, points, gate = reference.lines, current.points, self.config.gate
        if len(lines) == 0 and has_surfaces(reference.points) and has_surfaces(points):
            return failure("cox", Outcome.NO_LINES, reference.points, points)
        takes_part = _takes_part(reference, points, start(prior), self.config)

        def pair(pose: Pose, iteration: float) -> tuple[Ints, Ints]:
            return _assign(lines, points, pose, gate.at(iteration), takes_part)

        def move(pose: Pose, line_idx: Ints, cur_idx: Ints) -> Pose | None:
            return point_to_line_step(points.points[cur_idx], lines.centres[line_idx], lines.normals[line_idx], pose)

        def covariance(pose: Pose, line_idx: Ints, cur_idx: Ints) -> Cov:
            return _covariance(lines, line_idx, points.points[cur_idx], pose)

        cox = Iteration(
            method="cox",
            pair=pair,
            move=move,
            covariance=covariance,
            n_shrinking=gate.n_shrinking,
            readings=lambda line_idx: lines.readings(reference.points, np.unique(line_idx)),
        )
        return match_by_iteration(cox, reference.points, points, prior, self.config.convergence, self.config.min_share)


def _takes_part(reference: CoxFeatures, current: ScanPoints, guess: Pose, config: CoxConfig) -> tuple[Bools, Bools]:
    """Return which current readings, and which lines by half of theirs, the other scan sees; all without the filter."""
    lines, points = reference.lines, reference.points
    if not config.has_projection_filter:
        return np.ones(len(current), dtype=np.bool_), np.ones(len(lines), dtype=np.bool_)
    is_hidden, is_ref_hidden = hidden_readings(points, current, guess)
    shares = [is_ref_hidden[lines.readings(points, np.array([k]))].mean() for k in range(len(lines))]
    return ~is_hidden, np.array(shares) <= 0.5


def _assign(
    lines: Lines, current: ScanPoints, pose: Pose, gate: float, takes_part: tuple[Bools, Bools]
) -> tuple[Ints, Ints]:
    """Return the lines that readings lie on within the gate, and these readings."""
    line_idx, _ = nearest_lines(se2.transform(pose, current.points), lines, gate)
    reading_takes_part, line_takes_part = takes_part
    cur_idx = np.flatnonzero((line_idx >= 0) & reading_takes_part & line_takes_part[line_idx])
    return line_idx[cur_idx], cur_idx


def _covariance(lines: Lines, line_idx: Ints, points_cur: Points, pose: Pose) -> Cov:
    """Return the covariance of the least squares fit, the lines' own errors included.

    A line fitted to m readings errs by sigma / sqrt(m) across at its centre, and by sigma / sqrt(sum s^2) in angle.

    Departure: Cox's lines are a map and exact. Here they have the noise of the one scan they come from, and
    without it the covariance would be half of what it is.
    """
    normals = lines.normals[line_idx]
    away = se2.transform(pose, points_cur) - lines.centres[line_idx]
    errors = np.sum(normals * away, axis=1)
    along = np.sum(lines.directions[line_idx] * away, axis=1)
    n_readings = (lines.stops - lines.starts)[line_idx]
    length = np.ptp(lines.extents, axis=1)[line_idx]
    sources = (
        (np.arange(line_idx.size), np.ones(line_idx.size)),
        (line_idx, 1.0 / np.sqrt(n_readings)),
        (line_idx, along / (length * np.sqrt(n_readings / 12.0))),  # readings spread evenly
    )
    return propagated_covariance(jacobian(points_cur, normals, pose), errors, sources)
