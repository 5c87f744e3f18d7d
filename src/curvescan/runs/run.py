"""run: the odometry of a whole log, and its results folder; what ``curvescan odometry`` calls."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from curvescan.configs import as_config
from curvescan.diagnostics.issues import Issue
from curvescan.diagnostics.preparation import PreparedLog, prepare_log
from curvescan.diagnostics.verdict import Verdict, judge_run
from curvescan.errors import InvalidArgumentError
from curvescan.io.exports import ExportName, RunData, check_exports, takes_edges, write_exports
from curvescan.io.files.output import output_folder
from curvescan.io.held import HeldLog
from curvescan.io.log import Log
from curvescan.io.reading import read_log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.odometry import Odometry, OdometryConfig, OdometryRun, OdometryStep, run_odometry
from curvescan.runs.odometry import save_run
from curvescan.runs.pose_graph import PoseGraph
from curvescan.runs.results import list_further_files
from curvescan.types import Pose


class RunDisplay(Protocol):
    """What shows how far a run has come."""

    def begin(self, stage: str, n_steps: int) -> None:
        """Begin a stage of so many steps; 0: its length is not known."""
        ...

    def advance(self) -> None:
        """One step of the stage is done."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class RunResult:
    """What came of a log.

    Attributes
    ----------
    log : Log
        The log.
    run : OdometryRun
        Trajectory, outcomes, times.
    odometry : Odometry
        What ran, in its last state.
    prepared : PreparedLog
        What was mended in the log, and whether its wheels or gyroscope are used.
    issues : tuple of Issue
        What is wrong or odd with the log, as :func:`curvescan.find_issues` has it.
    verdict : Verdict
        Whether the trajectory can be trusted, and if not, why.
    files : tuple of str
        Names of the files written; empty without a folder.
    left_out : tuple of str
        What was not written and why, a sentence each.
    """

    log: Log
    run: OdometryRun
    odometry: Odometry
    prepared: PreparedLog
    issues: tuple[Issue, ...]
    verdict: Verdict
    files: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def trajectory(self) -> Trajectory:
        """Stamp, pose and covariance at each scan."""
        return self.run.trajectory

    def __repr__(self) -> str:
        written = f", {len(self.files)} files written" if self.files else ""
        return f"RunResult({self.log.name!r}: {self.run!r}{written})"


def run(
    log: Log | str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    method: Method | str = DEFAULT_METHOD,
    config: OdometryConfig | Mapping[str, Any] | None = None,
    matcher: MatcherConfig | None = None,
    odometry_prior: bool | None = None,
    as_is: bool = False,
    exports: Sequence[ExportName] = (),
    occupancy: OccupancyConfig | Mapping[str, Any] | None = None,
    truth: Pose | None = None,
    command: Sequence[str] = (),
    source: str | os.PathLike[str] | None = None,
    display: RunDisplay | None = None,
) -> RunResult:
    """Return the trajectory of a log, and write it with its maps into a folder.

    The folder holds trajectory.tum, trajectory.csv (with covariances), map.png, run.json, and the occupancy map:
    map.pgm with map.yaml, and occupancy.png. Ctrl-C ends the run and keeps what there is so far, marked as partial.

    Parameters
    ----------
    log : Log, str or path-like
        A log, or the path of one.
    out : str, path-like or None
        Folder for the results, made if it is missing; None to write nothing.
    method : str
        Name of the matcher.
    config : OdometryConfig, mapping or None
        Configuration of the odometry; None for what suits the method.
    matcher : dataclass, mapping or None
        Configuration of the matcher.
    odometry_prior : bool or None
        Whether to expect of each scan what the log's own wheel odometry or gyroscope gives, instead of the last motion; None
        where it agrees with the scans.
    as_is : bool
        Whether to take the log as it is, and mend nothing.
    exports : sequence of str
        Further files: ``"kitti"``, ``"g2o"``, ``"mcap"``.
    occupancy : OccupancyConfig, mapping or None
        How to make the occupancy map.
    truth : (n, 3) float64 or None
        True poses, drawn with the map.
    command : sequence of str
        The command line behind the run, for run.json.
    source : str, path-like or None
        The file or folder that a `log` given as a Log was read from, for its size and digest in run.json.
    display : RunDisplay or None
        Shows how far the run has come.

    Raises
    ------
    InvalidArgumentError
        When an argument is not of the kinds above, or `odometry_prior` is wanted and the log has none that fits its scans.
    LogFileError, LogFormatError
        When the log cannot be read.
    OutputError
        When the results cannot be written.
    """
    opened, source = (read_log(log), log) if isinstance(log, str | os.PathLike) else (log, source)
    scans = HeldLog(opened)
    hint = "the configuration of the matcher is given as matcher="
    config = as_config(config, OdometryConfig.of_method(method), hint=hint)
    map_config = as_config(occupancy, OccupancyConfig(), name="occupancy")
    check_exports(exports)
    if exports and out is None:
        raise InvalidArgumentError(f"exports {list(exports)} are files of a folder: give out=")
    shown = display or Silent()
    graph = PoseGraph() if takes_edges(exports) else None
    # first of all: a place that cannot be written costs no work
    with _folder(out, source) as folder:
        result = _judged_run(
            scans, method, config, matcher, odometry_prior=odometry_prior, as_is=as_is, shown=shown, graph=graph
        )
        result = replace(result, log=opened)
        if folder is not None:
            shown.begin("drawing the maps", 0)
            left_out = save_run(
                folder,
                result.run,
                result.prepared.log,
                odometry=result.odometry,
                command=command,
                source=None if source is None else Path(source),
                occupancy=map_config,
                truth=truth,
                verdict=result.verdict,
                further=result.prepared.as_plain(),
            )
            files = tuple(sorted(file.name for file in folder.iterdir()))
            result = replace(result, files=files, left_out=left_out)
    if exports and out is not None:
        # on their own: what goes wrong here must not cost the results of the run
        shown.begin("exporting", 0)
        edges = graph.edges if graph else ()
        data = RunData(trajectory=result.trajectory, edges=edges, scans=result.prepared.log)
        exported = _write_exports(out, source, exports, data)
        result = replace(result, files=(*result.files, *exported))
    return result


def _judged_run(
    log: Log,
    method: str,
    config: OdometryConfig,
    matcher: MatcherConfig | None,
    *,
    odometry_prior: bool | None,
    as_is: bool,
    shown: RunDisplay,
    graph: PoseGraph | None,
) -> RunResult:
    """Return the odometry of a log, and what is to be thought of it; its steps go to the graph, and nothing is written."""

    def on_step(step: OdometryStep) -> None:
        if graph is not None:
            graph.add(step)
        shown.advance()

    shown.begin("looking for what is wrong with the log", 0)
    prepared = prepare_log(log, odometry_prior=odometry_prior, as_is=as_is, is_order_needed=config.deskew)
    log, issues = prepared.log, prepared.issues
    config = replace(config, deskew=config.deskew and prepared.sensor.can_deskew)
    odometry = Odometry(method, config=config, matcher=matcher)
    shown.begin("odometry", len(log))
    done = run_odometry(log, odometry, odometry_poses=prepared.odometry_poses, on_step=on_step)
    return RunResult(
        log=log, run=done, odometry=odometry, prepared=prepared, issues=issues, verdict=judge_run(done, issues)
    )


def _write_exports(
    out: str | os.PathLike[str], source: str | os.PathLike[str] | None, exports: Sequence[ExportName], data: RunData
) -> tuple[str, ...]:
    """Write exports into the folder of a run's results, and return the names of the files."""
    with _folder(out, source) as folder:
        assert folder is not None
        files = write_exports(folder, exports, data)
        list_further_files(folder, Path(out))
    return files


@contextmanager
def _folder(out: str | os.PathLike[str] | None, source: str | os.PathLike[str] | None) -> Iterator[Path | None]:
    if out is None:
        yield None
    else:
        with output_folder(out, inputs=() if source is None else (source,)) as folder:
            yield folder


class Silent:
    """Shows nothing."""

    def begin(self, stage: str, n_steps: int) -> None:
        """Show nothing."""

    def advance(self) -> None:
        """Show nothing."""
