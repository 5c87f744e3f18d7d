"""A run in a few lines, for the terminal."""

import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.table import Table

from curvescan.cli.console import ERR, OUT, propose_commands, table, with_flags
from curvescan.configs import counted
from curvescan.diagnostics.preparation import PreparedLog
from curvescan.evaluation.trajectory_errors import trajectory_errors
from curvescan.odometry import StepOutcome
from curvescan.odometry.step import IN_MAP
from curvescan.runs.result import Run
from curvescan.se2 import between
from curvescan.slam import Localizer, Slam
from curvescan.types import Pose

_ALWAYS = (StepOutcome.MATCHED, StepOutcome.PREDICTED)


def report(run: Run, out: Path) -> int:
    """Print how a run went, what it wrote and whether it can be trusted, and return the exit status."""
    if run.prepared is not None:
        report_preparation(run.prepared)
    OUT.print(summarise(run))
    engine = run.engine
    if isinstance(engine, Slam):
        OUT.print(f"{engine!r}; finished in {run.record.seconds_to_finish:.1f} s")
    if isinstance(engine, Localizer) and run.first_fix is not None:
        OUT.print(f"first found in {engine.map!r} at scan {run.first_fix:,}")
    for remark in (*(issue.what for issue in run.issues if issue.kind == "read_error"), *run.left_out):
        ERR.print(with_flags(remark), soft_wrap=True)
    OUT.print(f"wrote {out}/{', '.join(run.files)}")
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], run.issues):
        ERR.print(proposal, soft_wrap=True)
    OUT.print(with_flags(run.verdict.sentence))
    return 0 if run.verdict.is_trusted else 3


def report_preparation(prepared: PreparedLog) -> None:
    """Print what was mended in a log, and what of it is used."""
    for remark in prepared.remarks:
        ERR.print(with_flags(remark), soft_wrap=True)
    if not prepared.sensor.can_deskew:
        ERR.print("sweeps are not deskewed: their beams are listed in reverse")


def summarise(result: Run) -> Table:
    """Return a table of how a run went: scans, failures by reason, end pose, time."""
    run, n_scans = result.record, len(result.log)
    n = len(run.outcomes)
    title = f"{run.method}: {counted(n, 'scan')}" + (f" of {n_scans:,} (partial)" if run.is_partial else "")
    rows = table(title, "", "count", "share")
    is_localized = isinstance(result.engine, Localizer)
    n_steps = n if is_localized else max(n - 1, 1)

    def add(sentence: str, count: int) -> None:
        rows.add_row(sentence, f"{count:,}", f"{100 * count / n_steps:.1f} %")

    counts = Counter(run.outcomes)
    for kind in IN_MAP if is_localized else StepOutcome:
        if kind is not StepOutcome.STARTED and (counts[kind] or is_localized or kind in _ALWAYS):
            add(kind.value, counts[kind])
    if not is_localized:
        for outcome, count in run.failures.items():
            add(f"  {outcome.value}", count)
        if run.n_rejected:
            add("  A match contradicts what was expected, or joins nothing known before.", run.n_rejected)
    if run.n_prior_rejected:
        add("The log's odometry contradicts a match, and was left out.", run.n_prior_rejected)
    x, y, theta = run.trajectory.poses[-1]
    rows.add_section()
    if np.isfinite(x):
        rows.add_row(f"end pose: {x:.3f} m, {y:.3f} m, {np.degrees(theta):.2f} deg", "", "")
    median, p99, worst = np.percentile(1e3 * run.seconds, [50, 99, 100])
    rows.add_row(
        f"time a scan: {median:.3f} ms median, {p99:.3f} ms at the 99th percentile, {worst:.1f} ms worst", "", ""
    )
    share = 100.0 * median / (1e3 * run.scan_period)
    if np.isfinite(share):
        rows.add_row(f"of the {1e3 * run.scan_period:.0f} ms between scans: {share:.2g} %", "", "")
    return rows


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
