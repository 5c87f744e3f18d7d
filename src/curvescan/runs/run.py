"""run and localize: a log in; trajectory, map and verdict out, and a results folder. What the commands call."""

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, TypedDict, Unpack, cast, get_args

from numpy.typing import ArrayLike

from curvescan._compilation import watch
from curvescan.configs import as_config, check_names, nearest
from curvescan.diagnostics.preparation import prepare_log
from curvescan.diagnostics.verdict import judge
from curvescan.engines import run_engine
from curvescan.engines.engine import Engine, in_turn, odometry_of
from curvescan.engines.odometry_process import OdometryProcess, can_run_ahead
from curvescan.errors import InvalidArgumentError, require
from curvescan.io.arrays.memory import as_log
from curvescan.io.files.output import output_folder
from curvescan.io.log import Log
from curvescan.io.reading import read_log
from curvescan.io.writing import ExportName, RunData, check_exports, takes_edges, write_exports
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.odometry import Odometry, OdometryConfig
from curvescan.odometry.config import MATCHER_HINT
from curvescan.runs.graph_files import edges_of
from curvescan.runs.result import Run
from curvescan.runs.results import check_kept, left_out, list_further_files, save_run
from curvescan.scan import LaserScan
from curvescan.slam import Localizer, Slam, SlamConfig, SlamMap
from curvescan.slam.localization.grid_map import opened
from curvescan.slam.map import as_map
from curvescan.types import Pose, UncertainPose

EngineName: TypeAlias = Literal["odometry", "slam"]
PathLike: TypeAlias = str | os.PathLike[str]
LogLike: TypeAlias = Log | Iterable[LaserScan] | PathLike

_STAGES: dict[EngineName, str] = {"odometry": "odometry", "slam": "SLAM"}
_N_FIRST = 4
"""Scans that load the kernels: with the fourth one there is a motion to expect."""


class RunDisplay(Protocol):
    """What shows how far a run has come."""

    def begin(self, stage: str, n_steps: int) -> object:
        """Begin a stage of so many steps; 0: its length is not known."""

    def advance(self) -> None:
        """One step of the stage is done."""


class Silent:
    """Shows nothing."""

    def begin(self, stage: str, n_steps: int) -> None:
        """Show nothing."""

    def advance(self) -> None:
        """Show nothing."""


class LocalizeOptions(TypedDict, total=False):
    """What runs have in common, whatever the engine; see :func:`run`."""

    odometry_prior: bool | None
    as_is: bool
    command: Sequence[str]
    source: PathLike | None
    display: RunDisplay | None
    keeps_steps: bool


class RunOptions(LocalizeOptions, total=False):
    """What odometry and SLAM take besides."""

    occupancy: OccupancyConfig | Mapping[str, Any] | None
    truth: Pose | None
    n_processes: int


def run(
    log: LogLike,
    engine: EngineName = "odometry",
    *,
    out: PathLike | None = None,
    method: Method | str = DEFAULT_METHOD,
    config: OdometryConfig | SlamConfig | Mapping[str, Any] | None = None,
    matcher: MatcherConfig | None = None,
    map: SlamMap | PathLike | None = None,  # noqa: A002 - the name that Slam gives it
    exports: Sequence[ExportName] = (),
    **options: Unpack[RunOptions],
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
    exports : sequence of str
        Further files: ``"kitti"``, ``"g2o"``, ``"mcap"``.
    odometry_prior : bool or None
        Whether to expect of each scan what the log's own wheel odometry or gyroscope gives, instead of the last motion;
        None where it agrees with the scans.
    as_is : bool
        Whether to take the log as it is, and mend nothing.
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
    check_names(options, RunOptions.__annotations__, "run")
    if engine not in get_args(EngineName):
        near = nearest(engine, get_args(EngineName))
        raise InvalidArgumentError(f'engine must be "odometry" or "slam", got {engine!r:.80}; {near}'.rstrip("; "))
    if engine == "odometry" and map is not None:
        raise InvalidArgumentError("odometry continues no map: give engine='slam' with map=")
    check_exports(exports)
    if exports and out is None:
        raise InvalidArgumentError(f"exports {list(exports)} are files of a folder: give out=")
    given: Any = config  # of the engine's class, or its fields
    new: _NewEngine
    if engine == "odometry":
        rules = as_config(given, OdometryConfig.of_method(method), hint=MATCHER_HINT)
        deskew = rules.deskew

        def new(deskew: bool) -> Odometry:
            return Odometry(method, config=replace(rules, deskew=deskew), matcher=matcher)

    else:
        slam_rules, begun = as_config(given, SlamConfig(), hint=MATCHER_HINT), None if map is None else as_map(map)
        deskew = slam_rules.odometry.deskew
        exports = [name for name in exports if name != "g2o"]  # the graph is written as it is

        def new(deskew: bool) -> Slam:
            return Slam(method, matcher=matcher, config=_deskewing(slam_rules, deskew), map=begun)

    n = options.get("n_processes", 2)
    require(type(n) is int and n >= 1, "n_processes must be a whole number of at least 1", n)
    options["keeps_steps"] = options.get("keeps_steps", True) or takes_edges(exports)
    options["n_processes"] = n if engine == "slam" else 1
    result = _run(log, new, options, stage=_STAGES[engine], deskew=deskew, out=out, inputs=_files(map))
    if exports and out is not None:
        (options.get("display") or Silent()).begin("exporting", 0)
        # on their own, so that an error here does not cost the results
        with output_folder(out, inputs=result.inputs) as folder:
            edges = edges_of(result.steps) if takes_edges(exports) else ()
            files = write_exports(folder, exports, RunData(result.trajectory, edges, result.scans))
            list_further_files(folder, Path(out))
        result = replace(result, files=(*result.files, *files))
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
    **options: Unpack[LocalizeOptions],
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
    check_names(options, LocalizeOptions.__annotations__, "localize")
    rules, known = as_config(config, SlamConfig(), hint=MATCHER_HINT), opened(map)

    def new(deskew: bool) -> Localizer:
        found = Localizer(known, method=method, matcher=matcher, config=_deskewing(rules, deskew))
        found.reset(*initial_pose) if isinstance(initial_pose, UncertainPose) else found.reset(initial_pose)
        return found

    given, deskew = cast(RunOptions, options), rules.odometry.deskew
    return _run(log, new, given, stage="localization", deskew=deskew, out=out, inputs=_files(map))


_NewEngine: TypeAlias = Callable[[bool], Engine]  # makes an engine that deskews, or not


def _files(map: SlamMap | OccupancyGrid | PathLike | None) -> tuple[Path, ...]:  # noqa: A002
    return () if map is None or isinstance(map, SlamMap | OccupancyGrid) else (Path(map),)


def _deskewing(rules: SlamConfig, deskew: bool) -> SlamConfig:
    return replace(rules, odometry=replace(rules.odometry, deskew=deskew))


def _run(
    log: LogLike,
    new: _NewEngine,
    options: RunOptions,
    *,
    stage: str,
    deskew: bool,
    out: PathLike | None,
    inputs: tuple[Path, ...],
) -> Run:
    """Run an engine over a log, save the results, and return the run."""
    occupancy = as_config(options.get("occupancy"), OccupancyConfig(), name="occupancy")
    source, shown = options.get("source"), options.get("display") or Silent()
    opened, source = (read_log(log), log) if isinstance(log, str | os.PathLike) else (as_log(log), source)
    require(len(opened) > 0, "a log must hold at least one scan", len(opened))
    inputs = (*inputs, *(() if source is None else (Path(source),)))
    # first of all: a place that cannot be written costs no work
    if source is not None and out is not None:
        check_kept(Path(source), Path(out))
    place = nullcontext() if out is None else output_folder(out, inputs=inputs)
    helper = options.get("n_processes", 1) > 1 and can_run_ahead(len(opened))
    with place as folder, OdometryProcess() if helper else nullcontext() as other:
        shown.begin("looking for what is wrong with the log", 0)
        prior, as_is = options.get("odometry_prior"), options.get("as_is", False)
        prepared = prepare_log(opened, odometry_prior=prior, as_is=as_is, is_order_needed=deskew)
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
            keeps_steps=options.get("keeps_steps", True),
        )
        result = Run(
            log=opened,
            engine=engine,
            record=record,
            prepared=prepared,
            verdict=judge(record, engine, prepared),
            scans=scans,
            occupancy=occupancy,
            truth=options.get("truth"),
            command=tuple(options.get("command", ())),
            source=None if source is None else Path(source),
            inputs=inputs,
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
