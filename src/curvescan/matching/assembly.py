"""From where an iterated method stopped to a MatchResult: the checks that all of them pass, in one place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.matching.result import NO_COVARIANCE, NO_POSE, Label, MatchResult, Outcome
from curvescan.rivals.iteration import LEAST_PAIRS, Descent
from curvescan.rivals.least_squares import is_constrained, jacobian
from curvescan.rivals.sweep import Sweep
from curvescan.types import Codes, Cov, Floats, Ints, Points, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Pairs:
    """What a method's last pose stands on.

    Attributes
    ----------
    cur_idx : (n,) int64
        Readings of the current scan that take part.
    ref_idx : (k,) int64
        Readings of the reference that take part, in any order, repeated or not.
    normals : (n, 2) float64
        Unit normal of the surface each current reading is paired with, frame ref.
    """

    cur_idx: Ints
    ref_idx: Ints
    normals: Points


def start(guess: Pose | None) -> Pose:
    """Return where an iterated method starts: at the guess, or at no motion."""
    return se2.identity() if guess is None else guess


def has_surfaces(sweep: Sweep) -> bool:
    """Return whether a scan has enough readings on surfaces for a pose."""
    return sweep.order.size >= LEAST_PAIRS


def conclude(
    method: str,
    descent: Descent,
    pairs: Pairs,
    reference: Sweep,
    current: Sweep,
    min_share: float,
    covariance: Callable[[Floats], Cov],
) -> MatchResult:
    """Return the result of an iterated method: its pose when it converged and something holds it, or why not.

    Parameters
    ----------
    method : str
        Name of the matcher.
    descent : Descent
        How it got there; becomes the trace.
    pairs : Pairs
        At its last pose.
    reference, current : Sweep
        The scans.
    min_share : float
        Least share of the current readings that must take part.
    covariance : callable
        Takes the (n, 3) rows of :func:`curvescan.rivals.least_squares.jacobian`; called for a good pose only.
    """
    n_pairs = pairs.cur_idx.size
    if descent.is_lost or n_pairs < max(LEAST_PAIRS, min_share * len(current)):
        return failure(method, Outcome.TOO_FEW_PAIRS, reference, current, descent)
    rows = jacobian(current.points[pairs.cur_idx], pairs.normals, descent.pose)
    if not is_constrained(rows):
        return failure(method, Outcome.UNCONSTRAINED, reference, current, descent)
    if not descent.has_converged:
        return failure(method, Outcome.NOT_CONVERGED, reference, current, descent)
    return MatchResult(
        method=method,
        outcome=Outcome.MATCHED,
        pose=descent.pose,
        covariance=covariance(rows),
        n_matched=n_pairs,
        trace=descent,
        labels_reference=labels(reference, pairs.ref_idx),
        labels_current=labels(current, pairs.cur_idx),
    )


def failure(
    method: str, outcome: Outcome, reference: Sweep, current: Sweep, trace: object = None
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


def labels(sweep: Sweep, matched: Ints) -> Codes:
    """Return a Label for each beam of a scan."""
    codes = np.full(sweep.n_beams, Label.NO_READING, dtype=np.uint8)
    codes[sweep.beam_idx] = Label.UNMATCHED
    codes[sweep.beam_idx[matched]] = Label.MATCHED
    return codes
