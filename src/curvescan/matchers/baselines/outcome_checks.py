"""From where an iterated method stopped to a MatchResult: the checks that all of them pass, in one place."""

from collections.abc import Callable

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.iteration import LEAST_PAIRS, IterationTrace, is_constrained, jacobian
from curvescan.matchers.baselines.points import ScanPoints
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Codes, Cov, Ints, Pose


def start(prior: UncertainPose | None) -> Pose:
    """Return where an iterated method starts: at the pose of the prior, or at no motion."""
    return se2.identity() if prior is None else prior.pose


def has_surfaces(points: ScanPoints) -> bool:
    """Return whether a scan has enough readings on surfaces for a pose."""
    return points.order.size >= LEAST_PAIRS


def check_outcome(
    method: str,
    descent: IterationTrace,
    reference: ScanPoints,
    current: ScanPoints,
    matched: tuple[Ints, Ints],
    min_share: float,
    covariance: Callable[[], Cov],
) -> MatchResult:
    """Return the result of an iterated method: its pose when it converged and something holds it, or why not."""
    ref_idx, cur_idx = matched
    if descent.is_lost or cur_idx.size < max(LEAST_PAIRS, min_share * len(current)):
        return failure(method, Outcome.TOO_FEW_PAIRS, reference, current, descent)
    if not _holds(descent.pose, current, cur_idx):
        return failure(method, Outcome.UNCONSTRAINED, reference, current, descent)
    if not descent.has_converged:
        return failure(method, Outcome.NOT_CONVERGED, reference, current, descent)
    return MatchResult(
        method=method,
        outcome=Outcome.MATCHED,
        pose=descent.pose,
        covariance=covariance(),
        n_matched=cur_idx.size,
        trace=descent,
        labels_reference=labels(reference, ref_idx),
        labels_current=labels(current, cur_idx),
    )


def _holds(pose: Pose, current: ScanPoints, cur_idx: Ints) -> bool:
    """Return whether the current scan's own surfaces fix the pose: Cox's lines of a round room would have corners."""
    on_surface = cur_idx[~np.isnan(current.tangents[cur_idx, 0])]
    points, normals = current.points[on_surface], current.normals[on_surface]
    return is_constrained(jacobian(points, normals @ se2.rotation(pose[2]).T, pose), points)


def failure(
    method: str, outcome: Outcome, reference: ScanPoints, current: ScanPoints, trace: object = None
) -> MatchResult:
    """Return a result without a pose."""
    nothing = np.empty(0, dtype=np.int64)
    return MatchResult(
        method=method,
        outcome=outcome,
        pose=NO_POSE,
        covariance=NO_COVARIANCE,
        n_matched=0,
        trace=trace,
        labels_reference=labels(reference, nothing),
        labels_current=labels(current, nothing),
    )


def labels(points: ScanPoints, matched: Ints) -> Codes:
    """Return a Label for each beam of a scan."""
    codes = np.full(points.n_beams, Label.NO_READING, dtype=np.uint8)
    codes[points.beam_idx] = Label.UNMATCHED
    codes[points.beam_idx[matched]] = Label.MATCHED
    return codes
