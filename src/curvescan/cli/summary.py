"""A run in a few lines, for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from curvescan.cli.console import table
from curvescan.diagnostics.issues import Issue
from curvescan.odometry import OdometryRun, StepOutcome

_ALWAYS = (StepOutcome.MATCHED, StepOutcome.PREDICTED)


def summarise(run: OdometryRun, n_scans: int) -> Table:
    """Return a table of how a run went: scans, failures by reason, end pose, time."""
    n = len(run.outcomes)
    title = f"{run.method}: {n:,} scans" + (f" of {n_scans:,} (partial)" if run.is_partial else "")
    result = table(title, "", "count", "share")
    n_steps = max(n - 1, 1)
    counts = Counter(run.outcomes)
    for kind in StepOutcome:
        if kind is not StepOutcome.STARTED and (counts[kind] or kind in _ALWAYS):
            result.add_row(kind.value, f"{counts[kind]:,}", f"{100 * counts[kind] / n_steps:.1f} %")
    for outcome, count in run.failures.items():
        result.add_row(f"  {outcome.value}", f"{count:,}", f"{100 * count / n_steps:.1f} %")
    if run.n_rejected:
        share = f"{100 * run.n_rejected / n_steps:.1f} %"
        sentence = "  A match contradicts what was expected, or joins nothing known before."
        result.add_row(sentence, f"{run.n_rejected:,}", share)
    if run.n_prior_rejected:
        share = f"{100 * run.n_prior_rejected / n_steps:.1f} %"
        sentence = "The log's odometry contradicts a match, and was left out."
        result.add_row(sentence, f"{run.n_prior_rejected:,}", share)
    x, y, theta = run.trajectory.poses[-1]
    result.add_section()
    result.add_row(f"end pose: {x:.3f} m, {y:.3f} m, {np.degrees(theta):.2f} deg", "", "")
    median, p99, worst = np.percentile(1e3 * run.seconds, [50, 99, 100])
    result.add_row(
        f"time a scan: {median:.3f} ms median, {p99:.3f} ms at the 99th percentile, {worst:.1f} ms worst",
        "",
        "",
    )
    share = 100.0 * median / (1e3 * run.scan_period)
    if np.isfinite(share):
        result.add_row(
            f"of the {1e3 * run.scan_period:.0f} ms between scans: {share:.2g} %", "", ""
        )
    return result


def wrote(folder: Path, left_out: Sequence[str]) -> str:
    """Return the sentence on the files of a run."""
    maps = "" if left_out else ", occupancy.png, map.pgm with map.yaml"
    return f"wrote {folder}/trajectory.tum, trajectory.csv, map.png{maps}, run.json"


def on_the_file(issues: Sequence[Issue]) -> tuple[str, ...]:
    """Return what of a log could not be read, a sentence each: the results are made from the rest."""
    return tuple(issue.what for issue in issues if issue.kind == "read_error")
