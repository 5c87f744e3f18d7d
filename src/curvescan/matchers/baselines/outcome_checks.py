"""From where an iterated method stopped to a MatchResult: the checks that all of them pass, in one place."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.matchers.baselines.config import ConvergenceConfig
from curvescan.matchers.baselines.iteration import LEAST_PAIRS, is_constrained, iterate, jacobian
from curvescan.matchers.baselines.points import ScanPoints
from curvescan.matchers.cfsma.trace import labels_of
from curvescan.matchers.result import NO_COVARIANCE, NO_POSE, MatchResult, Outcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Ints, Pose


def start(prior: UncertainPose | None) -> Pose:
    """Return where an iterated method starts: at the pose of the prior, or at no motion."""
    return se2.identity() if prior is None else prior.pose


def has_surfaces(points: ScanPoints) -> bool:
    """Return whether a scan has enough readings on surfaces for a pose."""
    return points.order.size >= LEAST_PAIRS


@dataclass(frozen=True, kw_only=True)
class Iteration:
    """What an iterated method repeats: pair and move. Pairs are (ref_idx, cur_idx, ...), which the others are given."""

    method: str
    pair: Callable[
        [Pose, float], tuple[Any, ...]
    ]  # the pairs at a pose, in iteration 0, 1, ...; inf: at the limits' last
    move: Callable[..., Pose | None]  # the next pose, from a pose and its pairs; None where they do not suffice
    covariance: Callable[..., Cov]  # of a pose, from its pairs
    n_shrinking: int  # iterations until all limits have reached their last values; 0: it may stop before
    readings: Callable[[Ints], Ints] = np.asarray  # the reference's readings that ref_idx stand for


def match_by_iteration(
    one: Iteration,
    reference: ScanPoints,
    current: ScanPoints,
    prior: UncertainPose | None,
    convergence: ConvergenceConfig,
    min_share: float,
) -> MatchResult:
    """Return the result of an iterated method: its pose when it converged and something holds it, or why not."""
    if not (has_surfaces(reference) and has_surfaces(current)):
        return failure(one.method, Outcome.NO_SEGMENTS, reference, current)

    def step(pose: Pose, iteration: int) -> Pose | None:
        pairs = one.pair(pose, iteration)
        return one.move(pose, *pairs) if pairs[1].size >= LEAST_PAIRS else None

    descent = iterate(start(prior), step, convergence, one.n_shrinking)
    pairs = one.pair(descent.pose, math.inf if one.n_shrinking else descent.n_iterations)
    ref_idx, cur_idx, *_ = pairs
    if descent.is_lost or cur_idx.size < max(LEAST_PAIRS, min_share * len(current)):
        return failure(one.method, Outcome.TOO_FEW_PAIRS, reference, current, descent)
    if not _holds(descent.pose, current, cur_idx):
        return failure(one.method, Outcome.UNCONSTRAINED, reference, current, descent)
    if not descent.has_converged:
        return failure(one.method, Outcome.NOT_CONVERGED, reference, current, descent)
    return MatchResult(
        method=one.method,
        outcome=Outcome.MATCHED,
        pose=descent.pose,
        covariance=one.covariance(descent.pose, *pairs),
        n_matched=cur_idx.size,
        trace=descent,
        labels_reference=labels_of(reference.n_beams, reference.beam_idx, one.readings(ref_idx)),
        labels_current=labels_of(current.n_beams, current.beam_idx, cur_idx),
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
        labels_reference=labels_of(reference.n_beams, reference.beam_idx, nothing),
        labels_current=labels_of(current.n_beams, current.beam_idx, nothing),
    )
