"""A run in a few lines, for the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from curvescan.cli.console import table
from curvescan.diagnostics.issues import Issue
from curvescan.evaluation.trajectory_errors import trajectory_errors
from curvescan.odometry import RunRecord, StepOutcome
from curvescan.se2 import between
from curvescan.types import Pose

_ALWAYS = (StepOutcome.MATCHED, StepOutcome.PREDICTED)


def summarise(run: RunRecord, n_scans: int) -> Table:
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
        f"time a scan: {median:.3f} ms median, {p99:.3f} ms at the 99th percentile, {worst:.1f} ms worst", "", ""
    )
    share = 100.0 * median / (1e3 * run.scan_period)
    if np.isfinite(share):
        result.add_row(f"of the {1e3 * run.scan_period:.0f} ms between scans: {share:.2g} %", "", "")
    return result


def errors_of(tracks: Mapping[str, Pose], truth: Pose) -> Table:
    """Return a table of the errors of trajectories against the truth: by name, the ends laid over each other."""
    path_length = trajectory_errors(truth, truth).path_length
    rows = table(
        f"errors over {path_length:.1f} m", "", "a step, median", "positions, mean", "positions, worst", "end pose"
    )
    true = between(truth[0], truth)
    for name, poses in tracks.items():
        e = trajectory_errors(poses, truth)
        off = between(poses[0], poses) - true
        positions = np.hypot(off[:, 0], off[:, 1])
        rows.add_row(
            name,
            f"{1e3 * np.median(e.step_translation):.1f} mm, {np.degrees(np.median(e.step_rotation)):.2f} deg",
            f"{positions.mean():.2f} m",
            f"{positions.max():.2f} m",
            f"{e.end_translation:.2f} m, {np.degrees(e.end_rotation):.1f} deg",
        )
    return rows


def wrote_slam(folder: Path, left_out: Sequence[str], *further: str) -> str:
    """Return the sentence on the files of a SLAM run."""
    maps = "" if left_out else ", occupancy.png, map.pgm with map.yaml"
    more = "".join(f"{name}, " for name in further)
    return (
        f"wrote {folder}/trajectory.tum, trajectory.csv, trajectory_online.tum, map.png{maps}, graph.png, {more}"
        "graph.g2o, closures.csv, map.csmap, run.json"
    )


def wrote(folder: Path, left_out: Sequence[str]) -> str:
    """Return the sentence on the files of a run."""
    maps = "" if left_out else ", occupancy.png, map.pgm with map.yaml"
    return f"wrote {folder}/trajectory.tum, trajectory.csv, map.png{maps}, run.json"


def on_the_file(issues: Sequence[Issue]) -> tuple[str, ...]:
    """Return what of a log could not be read, a sentence each: the results are made from the rest."""
    return tuple(issue.what for issue in issues if issue.kind == "read_error")
