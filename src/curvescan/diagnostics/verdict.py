"""A verdict: whether the trajectory of a run can be trusted, and why not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from curvescan.diagnostics.issues import Issue
from curvescan.odometry.run import RunRecord
from curvescan.odometry.step import StepOutcome
from curvescan.types import Bools

MAX_UNMATCHED_SHARE = 0.02
"""A trajectory of which a greater share of the scans is not matched has gaps where a turn is easily lost."""

MAX_UNMATCHED = 2
"""So many scans without a match are bridged on any path, however short."""

MAX_REJECTED_SHARE = 0.1
"""Wheels that contradict more of the matches than this share lag, slip or are another robot's."""

MAX_SIGMA = 0.5
"""Greatest standard deviation of a position on a short path that can still be called known, metres."""

MAX_SIGMA_SHARE = 0.02
"""The same on a long path, as a share of it: what odometry may drift by."""

_SPOILING = ("stale_beams", "turns_against", "undeclared_code", "no_valid_reading")
"""Kinds of issues that spoil readings so that what is made of them is not to be trusted."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a run can be trusted.

    Attributes
    ----------
    is_trusted : bool
        Whether nothing speaks against the trajectory.
    reasons : tuple of str
        What does, a clause each with its figures; empty when trusted.
    """

    is_trusted: bool
    reasons: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The last line of a run."""
        if self.is_trusted:
            return "trusted: nothing in the run speaks against its trajectory"
        return f"not to be trusted: {'; '.join(self.reasons)}"


def judge_run(run: RunRecord, issues: Sequence[Issue] = ()) -> Verdict:
    """Return whether the trajectory of a run can be trusted, and why not."""
    reasons = [
        *_on_lost_tracks(run),
        *_on_matches(run),
        *_on_uncertainty(run),
        *_on_prior(run),
        *(issue.what for issue in issues if issue.kind in _SPOILING),
    ]
    return Verdict(is_trusted=not reasons, reasons=tuple(reasons))


def judge_localization(run: RunRecord, issues: Sequence[Issue] = ()) -> Verdict:
    """Return whether the poses of a localization can be trusted, and why not."""
    reasons = [issue.what for issue in issues if issue.kind in _SPOILING]
    if not np.isfinite(run.trajectory.poses[:, 0]).any():
        reasons.insert(0, "the sensor was not found in the map")
    return Verdict(is_trusted=not reasons, reasons=tuple(reasons))


def _on_matches(run: RunRecord) -> list[str]:
    n_steps = len(run.outcomes) - 1
    if n_steps < 1:
        return [f"the log gave {len(run.outcomes)} scan{'s' * (not run.outcomes)}, a motion needs two"]
    n_failed = int(np.count_nonzero(run.is_failed))
    if n_failed <= max(MAX_UNMATCHED, MAX_UNMATCHED_SHARE * n_steps):
        return []
    return [
        f"{n_failed:,} of {n_steps:,} scans are not matched ({n_failed / n_steps:.0%}), up to "
        f"{_longest(run.is_failed):,} in a row"
    ]


def _on_lost_tracks(run: RunRecord) -> list[str]:
    n_lost = run.outcomes.count(StepOutcome.LOST)
    if not n_lost:
        return []
    first = run.outcomes.index(StepOutcome.LOST)
    return [
        f"the track was lost {f'{n_lost:,} times, first' if n_lost > 1 else 'once,'} at scan {first:,}, and started anew: "
        "where the parts lie to each other is unknown"
    ]


def _on_uncertainty(run: RunRecord) -> list[str]:
    if StepOutcome.LOST in run.outcomes:  # which says more than any figure
        return []
    covariances = run.trajectory.covariances
    if covariances is None or len(covariances) < 2:
        return []
    variance = covariances[:, 0, 0] + covariances[:, 1, 1]
    sigma = math.sqrt(0.5 * float(np.max(variance)))
    steps = np.diff(run.trajectory.poses[:, :2], axis=0)
    path = float(np.sum(np.hypot(steps[:, 0], steps[:, 1])))
    if sigma <= max(MAX_SIGMA, MAX_SIGMA_SHARE * path):
        return []
    n_open = int(np.count_nonzero(run.is_degenerate))
    cause = (
        f"; in {n_open:,} scans, up to {_longest(run.is_degenerate):,} in a row, motion along one direction is "
        "unobservable" + ("" if run.has_prior else ", which wheel odometry could decide")
    )
    return [f"the position is uncertain by up to {sigma:.1f} m (standard deviation)" + cause * (n_open > 0)]


def _on_prior(run: RunRecord) -> list[str]:
    n_steps = len(run.outcomes) - 1
    if run.n_prior_rejected <= MAX_REJECTED_SHARE * n_steps:
        return []
    return [
        f"the log's odometry contradicts the matches in {run.n_prior_rejected:,} of {n_steps:,} scans, where it was left out"
    ]


def _longest(mask: Bools) -> int:
    """Return the greatest number of True in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
