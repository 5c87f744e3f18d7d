"""run and localize: a log in; trajectory, map and verdict out, and a results folder. What the commands call."""

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, get_args

from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.configs import as_config, nearest
from curvescan.diagnostics.preparation import prepare_log
from curvescan.diagnostics.verdict import judge
from curvescan.errors import InvalidArgumentError
from curvescan.io.arrays.memory import as_log
from curvescan.io.files.output import output_folder
from curvescan.io.log import HeldLog, Log
from curvescan.io.reading import read_log
from curvescan.io.writing import ExportName, RunData, check_exports, takes_edges, write_exports
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.odometry import Odometry, OdometryConfig
from curvescan.odometry.run import in_turn
from curvescan.runs.graph_files import edges_of
from curvescan.runs.odometry_process import OdometryProcess, can_run_ahead
from curvescan.runs.result import Run
from curvescan.runs.results import left_out, list_further_files, save_run
from curvescan.scan import LaserScan
from curvescan.slam import Localizer, Slam, SlamConfig, SlamMap, run_engine
from curvescan.slam.localization.grid_map import opened
from curvescan.slam.map import as_map
from curvescan.slam.run import Engine, odometry_of
from curvescan.types import Pose, UncertainPose

EngineName: TypeAlias = Literal["odometry", "slam"]
PathLike: TypeAlias = str | os.PathLike[str]
LogLike: TypeAlias = Log | Iterable[LaserScan] | PathLike

_STAGES: dict[EngineName, str] = {"odometry": "odometry", "slam": "SLAM"}
_N_FIRST = 4
"""Scans that load the kernels: with the fourth one there is a motion to expect."""

_HINT = "the configuration of the matcher is given as matcher="


class RunDisplay(Protocol):
    """What shows how far a run has come."""

    def begin(self, stage: str, n_steps: int) -> None:
        """Begin a stage of so many steps; 0: its length is not known."""

    def advance(self) -> None:
        """One step of the stage is done."""


class Silent:
    """Shows nothing."""

    def begin(self, stage: str, n_steps: int) -> None:
        """Show nothing."""

    def advance(self) -> None:
        """Show nothing."""


def run(
    log: LogLike,
    engine: EngineName = "odometry",
    *,
    out: PathLike | None = None,
    method: Method | str = DEFAULT_METHOD,
    config: OdometryConfig | SlamConfig | Mapping[str, Any] | None = None,
    matcher: MatcherConfig | None = None,
    map: SlamMap | PathLike | None = None,  # noqa: A002 - the name that Slam gives it
    odometry_prior: bool | None = None,
    as_is: bool = False,
    exports: Sequence[ExportName] = (),
    occupancy: OccupancyConfig | Mapping[str, Any] | None = None,
    truth: Pose | None = None,
    command: Sequence[str] = (),
    source: PathLike | None = None,
    display: RunDisplay | None = None,
    keeps_steps: bool = True,
    n_processes: int = 2,
) -> Run:
    """Return the trajectory and the map of a log, by odometry or SLAM, and write them into a folder.

    Ctrl-C ends the run and keeps the results so far, marked as partial.

    Parameters
    ----------
    log : Log, iterable of LaserScan, str or path-like
        A log, its scans, or the path of its file.
    engine : str
        ``"odometry"``, or ``"slam"``, which closes loops and revises every pose.
    out : str, path-like or None
        Folder for the results, made if it is missing; None to write nothing. See :meth:`Run.save`.
    method : str
        Name of the matcher.
    config : OdometryConfig, SlamConfig, mapping or None
        Configuration of the engine; None for its defaults, of odometry for what suits the method.
    matcher : dataclass, mapping or None
        Configuration of the matcher.
    map : SlamMap, path or None
        SLAM: a map to continue; the log may begin anywhere in it.
    odometry_prior : bool or None
        Whether to expect of each scan what the log's own wheel odometry or gyroscope gives, instead of the last motion;
        None where it agrees with the scans.
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
    keeps_steps : bool
        Whether ``run.steps`` is kept, some 2 kB a scan.
    n_processes : int
        2 to run the odometry of a long log ahead of SLAM in a process of its own: the same bits, sooner.

    Raises
    ------
    InvalidArgumentError
        When an argument is not of the kinds above, or `odometry_prior` is wanted and the log has none that fits its
        scans.
    LogFileError, LogFormatError
        When the log or the map cannot be read.
    OutputError
        When the results cannot be written.
    """
    if engine not in get_args(EngineName):
        near = nearest(engine, get_args(EngineName))
        raise InvalidArgumentError(f'engine must be "odometry" or "slam", got {engine!r:.80}; {near}'.rstrip("; "))
    if engine == "odometry" and map is not None:
        raise InvalidArgumentError("odometry continues no map: give engine='slam' with map=")
    check_exports(exports)
    if exports and out is None:
        raise InvalidArgumentError(f"exports {list(exports)} are files of a folder: give out=")
    given: Any = config  # of the engine's class, or its fields
    if engine == "odometry":
        new, deskew = _new_odometry(method, as_config(given, OdometryConfig.of_method(method), hint=_HINT), matcher)
    else:
        begun = None if map is None else as_map(map)
        new, deskew = _new_slam(method, as_config(given, SlamConfig(), hint=_HINT), matcher, begun)
        exports = [name for name in exports if name != "g2o"]  # the graph is written as it is
    job = _Job(
        out=out,
        odometry_prior=odometry_prior,
        as_is=as_is,
        occupancy=as_config(occupancy, OccupancyConfig(), name="occupancy"),
        display=display or Silent(),
        keeps_steps=keeps_steps or takes_edges(exports),
        about={"truth": truth, "command": tuple(command)},
        inputs=_files(map),
        n_processes=n_processes if engine == "slam" else 1,
    )
    result = job.run(log, source, _STAGES[engine], deskew, new)
    if exports and out is not None:
        job.display.begin("exporting", 0)
        result = _export(result, out, exports)
    return result


def localize(
    log: LogLike,
    map: SlamMap | OccupancyGrid | PathLike,  # noqa: A002 - the name that Slam gives it
    *,
    out: PathLike | None = None,
    method: Method | str = DEFAULT_METHOD,
    config: SlamConfig | Mapping[str, Any] | None = None,
    matcher: MatcherConfig | None = None,
    initial_pose: UncertainPose | ArrayLike | None = None,
    odometry_prior: bool | None = None,
    as_is: bool = False,
    command: Sequence[str] = (),
    source: PathLike | None = None,
    display: RunDisplay | None = None,
    keeps_steps: bool = True,
) -> Run:
    """Localize the sensor of a log in a saved map, and write its poses into a folder.

    Parameters
    ----------
    log : Log, iterable of LaserScan, str or path-like
        A log, its scans, or the path of its file.
    map : SlamMap, OccupancyGrid, str or path-like
        The map, or the path of its file: ``map.csmap`` of a SLAM run, or the YAML or PGM file of a plain map.
    out, method, matcher, odometry_prior, as_is, command, source, display, keeps_steps
        As of :func:`curvescan.run`.
    config : SlamConfig, mapping or None
        Configuration that localization shares with SLAM.
    initial_pose : UncertainPose, (3,) array_like or None
        About where the first scan is taken in the map; None where nothing is known. See :meth:`Localizer.reset`.

    Raises
    ------
    InvalidArgumentError, LogFileError, LogFormatError, OutputError
        As :func:`curvescan.run` does.
    """
    rules, known = as_config(config, SlamConfig(), hint=_HINT), opened(map)

    def new(deskew: bool) -> Localizer:
        found = Localizer(known, method=method, matcher=matcher, config=_deskewing(rules, deskew))
        found.reset(*initial_pose) if isinstance(initial_pose, UncertainPose) else found.reset(initial_pose)
        return found

    job = _Job(
        out=out,
        odometry_prior=odometry_prior,
        as_is=as_is,
        occupancy=OccupancyConfig(),
        display=display or Silent(),
        keeps_steps=keeps_steps,
        about={"command": tuple(command)},
        inputs=_files(map),
    )
    return job.run(log, source, "localization", rules.odometry.deskew, new)


_NewEngine: TypeAlias = Callable[[bool], Engine]  # makes an engine that deskews, or not


def _new_odometry(method: str, rules: OdometryConfig, matcher: MatcherConfig | None) -> tuple[_NewEngine, bool]:
    """Return what makes the engine, and whether it is to deskew."""

    def new(deskew: bool) -> Odometry:
        return Odometry(method, config=replace(rules, deskew=deskew), matcher=matcher)

    return new, rules.deskew


def _new_slam(
    method: str, rules: SlamConfig, matcher: MatcherConfig | None, begun: SlamMap | None
) -> tuple[_NewEngine, bool]:
    def new(deskew: bool) -> Slam:
        return Slam(method, matcher=matcher, config=_deskewing(rules, deskew), map=begun)

    return new, rules.odometry.deskew


def _files(map: SlamMap | OccupancyGrid | PathLike | None) -> tuple[Path, ...]:  # noqa: A002
    return () if map is None or isinstance(map, SlamMap | OccupancyGrid) else (Path(map),)


def _deskewing(rules: SlamConfig, deskew: bool) -> SlamConfig:
    return replace(rules, odometry=replace(rules.odometry, deskew=deskew))


@dataclass(frozen=True, kw_only=True)
class _Job:
    """What runs have in common, whatever the engine."""

    out: PathLike | None
    odometry_prior: bool | None
    as_is: bool
    occupancy: OccupancyConfig
    display: RunDisplay
    keeps_steps: bool
    about: Mapping[str, Any]
    inputs: tuple[Path, ...] = ()
    n_processes: int = 1

    def run(self, log: LogLike, source: PathLike | None, stage: str, deskew: bool, new: _NewEngine) -> Run:
        """Return what an engine makes of a log, and write it."""
        opened, source = (read_log(log), log) if isinstance(log, str | os.PathLike) else (as_log(log), source)
        shown = self.display
        inputs = (*self.inputs, *(() if source is None else (Path(source),)))
        # first of all: a place that cannot be written costs no work
        with _folder(self.out, inputs) as folder, _other_process(len(opened), self.n_processes) as other:
            shown.begin("looking for what is wrong with the log", 0)
            prepared = prepare_log(
                HeldLog(opened), odometry_prior=self.odometry_prior, as_is=self.as_is, is_order_needed=deskew
            )
            scans, odometry_poses = prepared.log, prepared.odometry_poses
            engine = new(deskew and prepared.sensor.can_deskew)
            load_kernels(engine, scans, odometry_poses)
            shown.begin(stage, len(scans))
            ahead = None
            if other is not None and isinstance(engine, Slam):
                ahead = other.place(engine.odometry, scans, odometry_poses)
            record = run_engine(
                scans,
                engine,
                odometry_poses=odometry_poses,
                on_step=lambda _: shown.advance(),
                ahead=ahead,
                keeps_steps=self.keeps_steps,
            )
            result = Run(
                log=opened,
                engine=engine,
                record=record,
                prepared=prepared,
                verdict=judge(record, engine, prepared),
                scans=scans,
                occupancy=self.occupancy,
                source=None if source is None else Path(source),
                inputs=inputs,
                **self.about,
            )
            if folder is not None:
                shown.begin("drawing the maps", 0)
                maps = save_run(folder, result, helper=other)
                files = tuple(sorted(file.name for file in folder.iterdir()))
                result = replace(result, maps=maps, files=files, left_out=left_out(maps))
        return result


def load_kernels(engine: Engine, scans: Iterable[LaserScan], odometry_poses: Pose | None) -> None:
    """Have a copy of the odometry place the first scans, so that their kernels are loaded before time is taken."""
    copied: Odometry = pickle.loads(pickle.dumps(odometry_of(engine)))
    deque(in_turn(copied, islice(scans, _N_FIRST), odometry_poses), maxlen=0)
    watch.report()


def _export(result: Run, out: PathLike, exports: Sequence[ExportName]) -> Run:
    """Write exports into the folder of a run; on their own, so that an error here does not cost the results."""
    data = RunData(
        trajectory=result.trajectory, edges=edges_of(result.steps) if takes_edges(exports) else (), scans=result.scans
    )
    with output_folder(out, inputs=result.inputs) as folder:
        files = write_exports(folder, exports, data)
        list_further_files(folder, Path(out))
    return replace(result, files=(*result.files, *files))


@contextmanager
def _folder(out: PathLike | None, inputs: Sequence[Path]) -> Iterator[Path | None]:
    if out is None:
        yield None
    else:
        with output_folder(out, inputs=inputs) as folder:
            yield folder


def _other_process(n_scans: int, n_processes: int) -> AbstractContextManager[OdometryProcess | None]:
    if n_processes == 1 or not can_run_ahead(n_scans):
        return nullcontext()
    return OdometryProcess()
