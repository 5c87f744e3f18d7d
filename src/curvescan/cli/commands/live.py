"""curvescan live: a running laser, a log or a simulated robot, tracked while it drives, and a page to look at."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
import tyro

import curvescan
from curvescan.cli.console import ERR, OUT, free_port, open_browser, propose_commands, wait, with_flags
from curvescan.cli.options import Flag, LogFlags, LogUse, MethodName, Preparation, Reading
from curvescan.errors import InvalidArgumentError
from curvescan.io.files.output import check_is_other, output_folder
from curvescan.mapping.config import OccupancyConfig

if TYPE_CHECKING:
    from curvescan.diagnostics.preparation import PreparedLog
    from curvescan.diagnostics.verdict import Verdict
    from curvescan.engines.engine import Engine
    from curvescan.io import Log
    from curvescan.live import LiveReport, ScanSource, Tracker, Viewer
    from curvescan.live.sinks import MapSink

Mode: TypeAlias = Literal["SLAM", "odometry", "localization"]


@dataclass(frozen=True, kw_only=True)
class SourceFlags:
    """The laser, or what takes its place."""

    driver: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Driver of a laser, one of lds2d:MODEL, rplidar, hokuyo. lds2d drives lasers of LDROBOT, YDLIDAR, RPLIDAR and
    others (lds2d:LDROBOT-LD19, say). Drivers need the extra curvescan[lidar]."""
    port: Annotated[str | None, tyro.conf.arg(metavar="PORT")] = None
    """Where the laser is: /dev/ttyUSB0, COM3, socket://HOST:PORT, rfc2217://HOST:PORT, recording://FILE of raw bytes;
    HOST:PORT for hokuyo."""
    speed: float = 1.0
    """Speed of a replay or the simulation: 1 as recorded, 10 ten times as fast, 0 as fast as it goes."""
    scans: int | None = None
    """Number of scans after which the simulated robot stops."""
    people: int = 3
    """How many people walk around the simulated robot."""
    seed: int = 0
    """Random seed; selects the simulated building and its people."""

    def open(self, log: Path | None, use: LogFlags) -> ScanSource:
        """Return the source that the flags ask for."""
        from curvescan.live import LogSource, SimulatedSource
        from curvescan.live.drivers import open_driver
        from curvescan.live.sources import MendedSource

        if log is not None and self.driver is not None:
            raise InvalidArgumentError("LOG and --driver exclude each other: give one")
        if self.driver is None and self.port is not None:
            raise InvalidArgumentError(f"--port {self.port} needs --driver: which laser is there")
        if log is not None and self.scans is not None:
            raise InvalidArgumentError(
                "--scans is of the simulated robot, and a LOG is replayed to its end: leave it out"
            )
        if self.driver is not None:
            if self.port is None:
                raise InvalidArgumentError(f"--driver {self.driver} needs --port: where the laser is")
            _check_used(use, ("upside_down", "clockwise", "ignore_beams", "as_is"), "a laser at a port")
            setup = use.reading.setup()
            is_mirrored = bool(setup.upside_down) != setup.clockwise
            source = open_driver(self.driver, self.port, is_mirrored=is_mirrored, ignore_beams=setup.ignore_beams)
            return source if use.preparation.as_is else MendedSource(source, ERR.print)
        if log is not None:
            return LogSource(use.reading.open(log), speed=self.speed)
        _check_used(use, (), "the simulated robot")
        return SimulatedSource(n_scans=self.scans, n_people=self.people, seed=self.seed, speed=self.speed)


def _check_used(use: LogFlags, used: Collection[str], source: str) -> None:
    """Raise InvalidArgumentError where flags are given that a source has no use for."""
    usual = {**vars(Reading()), **vars(Preparation())}
    given = {**vars(use.reading), **vars(use.preparation)}
    if unused := [name for name, value in given.items() if value != usual[name] and name not in used]:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in unused)
        raise InvalidArgumentError(f"{source} has no use for {flags}: give that with a LOG, or leave it out")


@dataclass(frozen=True, kw_only=True)
class EngineFlags:
    """What follows the laser."""

    odometry_only: Flag = False
    """Odometry instead of SLAM: past poses are not revised."""
    map: Annotated[Path | None, tyro.conf.arg(name="map", metavar="FILE")] = None
    """Localize in this map: map.csmap of `curvescan slam`, or the YAML or PGM file of a plain map."""
    method: MethodName = "curvescan"

    def __post_init__(self) -> None:
        if self.map is not None and self.odometry_only:
            raise InvalidArgumentError("--map and --odometry-only exclude each other: give one")

    @property
    def mode(self) -> Mode:
        """SLAM, odometry or localization."""
        return "localization" if self.map is not None else "odometry" if self.odometry_only else "SLAM"

    def engine(self, saved: Any, *, can_deskew: bool) -> Engine:
        """Return the odometry, SLAM or localizer."""
        if self.mode == "odometry":
            odometry = curvescan.OdometryConfig.of_method(self.method)
            return curvescan.Odometry(self.method, config=replace(odometry, deskew=can_deskew))
        config = curvescan.SlamConfig()
        config = replace(config, odometry=replace(config.odometry, deskew=can_deskew))
        if saved is not None:
            return curvescan.Localizer(saved, method=self.method, config=config)
        return curvescan.Slam(self.method, config=config)


@dataclass(frozen=True, kw_only=True)
class PageFlags:
    """Where a run is shown."""

    host: str = "127.0.0.1"
    """Address to serve the page at; with 0.0.0.0 other machines can open it."""
    http_port: int | None = None
    """Port of the page; 8765, or a free one if that is in use."""
    no_page: Flag = False
    """Show no page: only --out, --record, --foxglove and the summary."""
    foxglove: Flag = False
    """Serve scans, odometry, transforms and map to Foxglove as well; needs the extra curvescan[foxglove]."""
    foxglove_port: int = 8766
    """Port of the websocket for Foxglove; 0 for any that is free."""
    keep_open: Flag = False
    """Serve the page after the source has ended, until Ctrl-C."""

    def open(self, pages: ExitStack, source: ScanSource, maps: dict[str, Any]) -> tuple[Viewer | None, list[MapSink]]:
        """Return the page, if there is one, and all that shows the run, served until `pages` are closed."""
        import curvescan.live as live_package  # each loads when it is named: the page needs neither plots nor bags
        from curvescan.live import Viewer
        from curvescan.live.server import PageServer
        from curvescan.live.sources import Paced

        viewer: Viewer | None = None
        sinks: list[MapSink] = []
        if not self.no_page:
            viewer = Viewer(source.name, replay=source if isinstance(source, Paced) else None, **maps)
            sinks.append(viewer)
            server = PageServer(viewer, host=self.host, port=free_port(self.host, self.http_port))
            ERR.print(f"the page is at {pages.enter_context(server).url}")
            open_browser(server.url)
            if maps["saved_map"] is None and isinstance(source, Paced) and (first := source.first()) is not None:
                viewer.preview(first)  # before kernels are compiled
        if self.foxglove:
            served = live_package.FoxgloveSink(source.name, host=self.host, port=self.foxglove_port, **maps)
            pages.callback(served.stop)
            sinks.append(served)
            ERR.print(f"Foxglove: open a connection to {served.url}")
        return viewer, sinks


def live(
    log: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[LOG]")] = None,
    /,
    *,
    source: Annotated[SourceFlags, tyro.conf.arg(name="")] = SourceFlags(),
    out: Path | None = None,
    record: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mcap")] = None,
    engine: Annotated[EngineFlags, tyro.conf.arg(name="")] = EngineFlags(),
    page: Annotated[PageFlags, tyro.conf.arg(name="")] = PageFlags(),
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
    occupancy: Annotated[OccupancyConfig, tyro.conf.arg(name="occupancy")] = OccupancyConfig(),  # noqa: B008 - frozen
) -> int:
    """Track a running laser and show map, path and scan on a page in the browser.

    Without LOG and --driver, a simulated robot drives round a building. Ctrl-C ends the run; with --out or --record
    the results so far are saved.

    Parameters
    ----------
    log
        A log to replay, of any format that `curvescan odometry` reads.
    out
        Folder for the results: the files of `curvescan slam`, or of `odometry` or `localize`.
    record
        MCAP file for scans, poses and map.
    occupancy
        How to make the occupancy map.
    """
    if record is not None and record.suffix != ".mcap":
        raise InvalidArgumentError(f"--record writes MCAP: give it a name that ends in .mcap, got {record}")
    if record is not None and log is not None:
        check_is_other(record, log)
    laser = source.open(log, use)
    with ExitStack() as pages:
        saved: Any = None
        drawn: Any = None
        if engine.map is not None:
            from curvescan.slam.localization.grid_map import map_of_grid, opened

            saved = opened(engine.map)
            drawn = saved if isinstance(saved, curvescan.SlamMap) else map_of_grid(saved)
        maps = {"mode": engine.mode, "occupancy": occupancy, "is_lossless": not laser.is_live}
        viewer, sinks = page.open(pages, laser, {**maps, "saved_map": drawn})
        with output_folder(out) if out else nullcontext() as folder:
            report, verdict = _follow(
                laser, engine, viewer, sinks, use, Outputs(folder, out, record, saved, drawn, maps)
            )
        if page.keep_open and viewer is not None and not report.is_interrupted:
            wait("the source has ended; Ctrl-C closes the page")
    if report.error is not None:
        raise report.error
    return 0 if verdict is None or verdict.is_trusted else 3


class Outputs(NamedTuple):
    """What a run writes: a folder, which is moved to `out`, and a recording."""

    folder: Path | None
    out: Path | None
    record: Path | None
    saved_map: Any  # to localize in
    drawn: Any  # the same as keyframes, to be drawn
    maps: dict[str, Any]


def _follow(
    source: ScanSource,
    flags: EngineFlags,
    viewer: Viewer | None,
    sinks: Sequence[MapSink],
    use: LogFlags,
    outputs: Outputs,
) -> tuple[LiveReport, Verdict | None]:
    """Run a source, print the summary and write the results; the verdict is None where no scan came."""
    import curvescan.live as live_package
    from curvescan.live import LogSource, Tracker
    from curvescan.live.live_map import warm_up

    results = live_package.ResultsSink(**outputs.maps) if outputs.folder is not None else None
    prepared = None
    if isinstance(source, LogSource):
        prepared = _prepare(source.log, use.preparation)
        source.log = prepared.log
    can_deskew = prepared is None or prepared.sensor.can_deskew

    def new_engine() -> Engine:
        return flags.engine(outputs.saved_map, can_deskew=can_deskew)

    if viewer is not None:
        viewer.set_status("loading", "loading kernels (they are compiled in the first run only)")
    with ERR.status("loading kernels"):
        warm_up(new_engine, flags.method)
    engine = new_engine()
    sinks = [*sinks, *([] if results is None else [results])]
    recorder = None
    if outputs.record is not None:
        recorder = live_package.McapRecorder(outputs.record, saved_map=outputs.drawn, **outputs.maps)
        sinks.append(recorder)
    tracker = Tracker(engine, prepared.odometry_poses if prepared else None)
    report, verdict = _track(source, tracker, viewer, sinks, prepared)
    OUT.print(summary(report, source.name, engine))
    if recorder is not None and recorder.n_uneven:
        ERR.print(f"{recorder.n_uneven:,} scans are not in {outputs.record}: their beams are not evenly spaced")
    if outputs.folder is not None and results is not None and report.n_scans:
        files = results.write(outputs.folder, report, name=source.name, engine=engine, log=prepared, command=sys.argv)
        OUT.print(f"wrote {outputs.out}/{', '.join(files)}")
    if verdict is not None:
        OUT.print(with_flags(verdict.sentence))
    return report, verdict


def summary(report: LiveReport, name: str, engine: Engine) -> str:
    """Return how a live run went, in a few lines."""
    if not report.n_scans:
        return f"{name}: no scan"
    lines = [f"{name}: {report.n_scans:,} scans" + (", interrupted" * report.is_interrupted)]
    lines += [f"  {n:,}  {kind.value}" for kind, n in Counter(report.record.outcomes).most_common()]
    if isinstance(engine, curvescan.Slam):
        lines.append(f"  {engine!r}")  # as `slam` counts them
    lines.append(f"  {report.n_dropped:,} scans dropped because tracking was too slow")
    for what, values in (("time a scan", report.record.seconds), ("from scan to pose", report.latencies)):
        median, p99, worst = np.percentile(1e3 * values, [50.0, 99.0, 100.0])
        lines.append(f"  {what}: {median:.2f} ms median, {p99:.2f} ms p99, {worst:.1f} ms worst")
    return "\n".join(lines)


def _prepare(log: Log, preparation: Preparation) -> PreparedLog:
    """Return the log as `curvescan slam` takes it; what is mended, used and wrong is printed."""
    from curvescan.cli.summary import report_preparation
    from curvescan.diagnostics.preparation import prepare_log

    with ERR.status("looking for what is wrong with the log"):
        prepared = prepare_log(log, odometry_prior=preparation.wanted, as_is=preparation.as_is)
    report_preparation(prepared)
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], prepared.issues):
        ERR.print(proposal, soft_wrap=True)
    return prepared


def _track(
    source: ScanSource, tracker: Tracker, viewer: Viewer | None, sinks: Sequence[MapSink], prepared: PreparedLog | None
) -> tuple[LiveReport, Verdict | None]:
    """Run and show; every sink has finished when this returns."""
    from curvescan.diagnostics.verdict import judge
    from curvescan.live import run_live
    from curvescan.live.pipeline import finish

    if viewer is not None:
        viewer.offer(tracker)
        viewer.set_status("running", "running")
    verdict, engine = None, tracker.engine
    try:
        report = run_live(source, tracker, sinks)
        if report.is_interrupted:
            text = f"stopped; finishing {engine!r} and writing what was asked for; Ctrl-C again ends at once"
            ERR.print(text, soft_wrap=True)
            if viewer is not None:
                viewer.set_status("ended", text)
        report = finish(report, tracker, sinks)
        if report.n_scans:
            n_scans = report.n_scans if prepared is None else len(prepared.log)
            verdict = judge(report.record_of(n_scans), engine, prepared)
    finally:
        for sink in sinks:
            sink.close()
    if viewer is not None:
        what = "stopped" if report.is_interrupted else "ended"
        result = "" if verdict is None else f" The result is {verdict.sentence}."
        text = f"{source.name} has {what} after {report.n_scans:,} scans.{result}"
        viewer.set_status("error" if report.error else "ended", str(report.error or text))
    for sink in sinks:
        if sink.error is not None:
            raise sink.error
    return report, verdict
