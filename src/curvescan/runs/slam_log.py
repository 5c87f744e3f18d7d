"""slam_log: SLAM of a whole log, and its results folder; what ``curvescan slam`` calls."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from curvescan.diagnostics.issues import Issue
from curvescan.diagnostics.preparation import PreparedLog, prepare_log
from curvescan.diagnostics.verdict import Verdict, judge_run
from curvescan.io.files.output import output_folder
from curvescan.io.held import HeldLog
from curvescan.io.log import Log
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.runs.odometry_process import OdometryProcess, can_run_ahead
from curvescan.runs.run import RunDisplay, Silent
from curvescan.runs.slam import save_slam_run
from curvescan.slam import Slam, SlamConfig, SlamMap, SlamRun, run_slam


@dataclass(frozen=True, eq=False, kw_only=True)
class SlamResult:
    """What came of a log.

    Attributes
    ----------
    run : SlamRun
        Trajectories, the graph and its loop closures.
    issues : tuple of Issue
        What is wrong or odd with the log.
    verdict : Verdict
        Whether the trajectory can be trusted, and if not, why.
    prepared : PreparedLog
        What was mended in the log, and whether its wheels or gyroscope are used.
    left_out : tuple of str
        What was not written and why, a sentence each.
    """

    run: SlamRun
    issues: tuple[Issue, ...]
    verdict: Verdict
    prepared: PreparedLog
    left_out: tuple[str, ...] = ()


def slam_log(
    log: Log,
    *,
    out: str | os.PathLike[str] | None = None,
    method: Method | str = DEFAULT_METHOD,
    config: SlamConfig | None = None,
    matcher: MatcherConfig | None = None,
    map: SlamMap | None = None,  # noqa: A002 - the name that Slam gives it
    odometry_prior: bool | None = None,
    as_is: bool = False,
    occupancy: OccupancyConfig | None = None,
    command: Sequence[str] = (),
    source: str | os.PathLike[str] | None = None,
    inputs: Sequence[str | os.PathLike[str]] = (),
    display: RunDisplay | None = None,
    n_processes: int = 2,
) -> SlamResult:
    """Return SLAM of a log, and write it with its maps into a folder; Ctrl-C keeps what there is so far.

    out: Folder for the results, made if it is missing; None to write nothing. Raises InvalidArgumentError,
    LogFormatError, OutputError.
    """
    config = config or SlamConfig()
    shown = display or Silent()
    held = HeldLog(log)
    left_out: tuple[str, ...] = ()
    kept = (*inputs, *(() if source is None else (source,)))
    with (
        nullcontext() if out is None else output_folder(out, inputs=kept) as folder,
        _other_process(len(held), n_processes) as other,
    ):
        shown.begin("looking for what is wrong with the log", 0)
        is_order_needed = config.odometry.deskew
        prepared = prepare_log(held, odometry_prior=odometry_prior, as_is=as_is, is_order_needed=is_order_needed)
        mended, odometry_poses, issues = prepared.log, prepared.odometry_poses, prepared.issues
        deskew = config.odometry.deskew and prepared.sensor.can_deskew
        rules = replace(config, odometry=replace(config.odometry, deskew=deskew))
        slam = Slam(method, matcher=matcher, config=rules, map=map)
        shown.begin("SLAM", len(mended))
        run = run_slam(
            mended,
            slam,
            odometry_poses=odometry_poses,
            on_step=lambda _: shown.advance(),
            ahead=other.place(slam.odometry, mended, odometry_poses) if other else None,
        )
        verdict = judge_run(run.revised, issues)
        if folder is not None:
            shown.begin("drawing the maps", 0)
            left_out = save_slam_run(
                folder,
                run,
                mended,
                command=command,
                source=None if source is None else Path(source),
                occupancy=occupancy,
                verdict=verdict,
                further=prepared.as_plain(),
                helper=other,
            )
    return SlamResult(run=run, issues=issues, verdict=verdict, prepared=prepared, left_out=left_out)


def _other_process(n_scans: int, n_processes: int) -> AbstractContextManager[OdometryProcess | None]:
    if n_processes == 1 or not can_run_ahead(n_scans):
        return nullcontext()
    return OdometryProcess()
