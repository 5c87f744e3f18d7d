"""curvescan live: a running laser, a log or a simulated robot, tracked while it drives, and a page to look at."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import tyro

import curvescan
from curvescan.cli.options import Flag, MethodName, Preparation, PreparationFlags, Reading, ReadingFlags
from curvescan.errors import InvalidArgumentError
from curvescan.io.files.output import output_folder
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import Method

if TYPE_CHECKING:
    from curvescan.diagnostics.preparation import PreparedLog
    from curvescan.io import Log
    from curvescan.live import LiveReport, ScanSource, Tracker, Viewer
    from curvescan.live.sinks import MapSink
    from curvescan.slam.run import Engine

Mode: TypeAlias = Literal["SLAM", "odometry", "localization"]


def live(
    log: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[LOG]")] = None,
    /,
    *,
    driver: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    port: Annotated[str | None, tyro.conf.arg(metavar="PORT")] = None,
    speed: float = 1.0,
    out: Path | None = None,
    record: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mcap")] = None,
    odometry_only: Flag = False,
    map: Annotated[Path | None, tyro.conf.arg(name="map", metavar="FILE")] = None,  # noqa: A002 - the flag's name
    host: str = "127.0.0.1",
    http_port: int | None = None,
    no_page: Flag = False,
    foxglove: Flag = False,
    foxglove_port: int = 8766,
    keep_open: Flag = False,
    method: MethodName = "curvescan",
    scans: int | None = None,
    people: int = 3,
    seed: int = 0,
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
    occupancy: Annotated[OccupancyConfig, tyro.conf.arg(name="occupancy")] = OccupancyConfig(),  # noqa: B008 - frozen
) -> int:
    """Track a running laser and show map, path and scan on a page in the browser.

    Without LOG and --driver, a simulated robot drives round a building. Ctrl-C ends the run; with --out and --record
    what there is so far is written.

    Parameters
    ----------
    log
        A log to replay, of any format that `curvescan odometry` reads.
    driver
        Driver of a laser, one of lds2d:MODEL, rplidar, hokuyo. lds2d drives lasers of LDROBOT, YDLIDAR, RPLIDAR and
        others (lds2d:LDROBOT-LD19, say). Drivers need the extra curvescan[lidar].
    port
        Where the laser is: /dev/ttyUSB0, COM3, socket://HOST:PORT, rfc2217://HOST:PORT, recording://FILE of raw bytes;
        HOST:PORT for hokuyo.
    speed
        Speed of a replay or the simulation: 1 as recorded, 10 ten times as fast, 0 as fast as it goes.
    out
        Folder for the results: the files of `curvescan slam`, or of `odometry` or `localize`.
    record
        MCAP file for scans, poses and map.
    odometry_only
        Odometry instead of SLAM: past poses are not revised.
    map
        A map saved by `curvescan slam`: localize in it.
    host
        Address that the page is served at; 0.0.0.0 lets other machines look on.
    http_port
        Port of the page; 8765, or a free one if that is in use.
    no_page
        No page: only --out, --record, --foxglove and the summary.
    foxglove
        Serve scans, odometry, transforms and map to Foxglove as well; needs the extra curvescan[foxglove].
    foxglove_port
        Port of the websocket for Foxglove; 0 for any that is free.
    keep_open
        Serve the page after the source has ended, until Ctrl-C.
    scans
        End after so many scans of the simulated robot.
    people
        How many people walk around the simulated robot.
    seed
        Random seed; selects the simulated building and its people.
    occupancy
        How to make the occupancy map.
    """
    import curvescan.live as live_package  # each loads when it is named: the first picture needs neither plots nor bags
    from curvescan.cli.console import ERR, OUT
    from curvescan.cli.serving import free_port, open_browser, wait
    from curvescan.live import LogSource, Tracker, Viewer
    from curvescan.live.server import PageServer
    from curvescan.live.sources import MendedSource

    source: ScanSource
    if log is not None and driver is not None:
        raise InvalidArgumentError("LOG and --driver exclude each other: give one")
    if driver is not None:
        source = _laser(driver, port, reading)
        if not preparation.as_is:
            source = MendedSource(source, lambda sentence: ERR.print(sentence, markup=False))
    elif log is not None:
        source = LogSource(reading.open(log), speed=speed)
    else:
        source = _simulation(scans, people, seed, speed)
    mode = _mode(map, odometry_only)
    saved = None if map is None else _saved_map(map)
    maps: dict[str, Any] = {"mode": mode, "occupancy": occupancy, "is_lossless": not source.is_live}
    with ExitStack() as pages:
        viewer = None
        if not no_page:
            viewer = Viewer(source.name, saved_map=saved, **maps)
            server = PageServer(viewer, host=host, port=free_port(host, http_port))
            ERR.print(f"the page is at {pages.enter_context(server).url}", markup=False)
            open_browser(server.url)
            if saved is None:
                _preview(source, viewer)
        sinks: list[MapSink] = [] if viewer is None else [viewer]
        if foxglove:
            served = live_package.FoxgloveSink(source.name, host=host, port=foxglove_port, saved_map=saved, **maps)
            pages.callback(served.stop)
            sinks.append(served)
            ERR.print(f"Foxglove: open a connection to {served.url}", markup=False)
        with output_folder(out) if out else nullcontext() as folder:
            results = live_package.ResultsSink(**maps) if out else None
            prepared = _prepare(source.log, preparation) if isinstance(source, LogSource) else None
            if prepared is not None and isinstance(source, LogSource):
                source.log = prepared.log
            can_deskew = prepared is None or prepared.sensor.can_deskew
            engine = _engine(mode, method, saved, viewer, can_deskew=can_deskew)
            if results is not None:
                sinks.append(results)
            if record is not None:
                sinks.append(live_package.McapRecorder(record, saved_map=saved, **maps))
            report = _track(source, Tracker(engine, prepared.odometry_poses if prepared else None), viewer, sinks)
            OUT.print(summary(report, source.name), markup=False)
            if folder is not None and results is not None and report.n_scans:
                files = results.write(
                    folder,
                    report,
                    name=source.name,
                    engine=engine,
                    log=source.log if isinstance(source, LogSource) else None,
                    command=sys.argv,
                )
                OUT.print(f"wrote {out}/{', '.join(files)}", markup=False)
        if keep_open and viewer is not None and not report.is_interrupted:
            wait("the source has ended; Ctrl-C closes the page")
    if report.error is not None:
        raise report.error
    return 0


def summary(report: LiveReport, name: str) -> str:
    """Return how a live run went, in a few lines."""
    import numpy as np

    if not report.n_scans:
        return f"{name}: no scan"
    lines = [f"{name}: {report.n_scans:,} scans" + (", interrupted" * report.is_interrupted)]
    lines += [f"  {n:,}  {kind.value}" for kind, n in report.outcomes.most_common()]
    if report.n_closures:
        lines.append(f"  {report.n_closures:,} loop closures")
    lines.append(f"  {report.n_dropped:,} scans dropped because tracking was too slow")
    for what, values in (("time a scan", report.seconds), ("from scan to pose", report.latencies)):
        median, p99, worst = np.percentile(1e3 * values, [50.0, 99.0, 100.0])
        lines.append(f"  {what}: {median:.2f} ms median, {p99:.2f} ms p99, {worst:.1f} ms worst")
    return "\n".join(lines)


def _mode(saved_map: Path | None, odometry_only: bool) -> Mode:
    if saved_map is not None:
        if odometry_only:
            raise InvalidArgumentError("--map and --odometry-only exclude each other: give one")
        return "localization"
    return "odometry" if odometry_only else "SLAM"


def _saved_map(path: Path) -> Any:
    from curvescan import load_map

    return load_map(path)


def _prepare(log: Log, preparation: Preparation) -> PreparedLog:
    """Return the log as `curvescan slam` takes it; what is mended, used and wrong is printed."""
    from curvescan.cli.console import ERR
    from curvescan.cli.flags import with_flags
    from curvescan.cli.proposals import propose_commands
    from curvescan.diagnostics.preparation import prepare_log
    from curvescan.io.held import HeldLog

    with ERR.status("looking for what is wrong with the log"):
        prepared = prepare_log(HeldLog(log), odometry_prior=preparation.wanted, as_is=preparation.as_is)
    for remark in (*prepared.remarks, *propose_commands(["curvescan", *sys.argv[1:]], prepared.issues)):
        ERR.print(with_flags(remark), markup=False, soft_wrap=True)
    if not prepared.sensor.can_deskew:
        ERR.print("sweeps are not deskewed: their beams are listed in reverse", markup=False)
    return prepared


def _simulation(scans: int | None, people: int, seed: int, speed: float) -> ScanSource:
    from curvescan.live import SimulatedSource

    return SimulatedSource(n_scans=scans, n_people=people, seed=seed, speed=speed)


def _laser(driver: str, port: str | None, reading: Reading) -> ScanSource:
    from curvescan.live.drivers.opening import open_driver

    if port is None:
        raise InvalidArgumentError(f"--driver {driver} needs --port: where the laser is")
    return open_driver(
        driver, port, is_mirrored=reading.upside_down != reading.clockwise, ignore_beams=reading.ignore_beams
    )


def _preview(source: ScanSource, viewer: Viewer) -> None:
    """Show the first scan of a source that can wait, before kernels are compiled."""
    from curvescan.live import LogSource, SimulatedSource

    if isinstance(source, LogSource | SimulatedSource) and (first := source.first()) is not None:
        viewer.preview(first)


def _engine(mode: Mode, method: Method, saved: Any, viewer: Viewer | None, *, can_deskew: bool) -> Engine:
    """Return the odometry, SLAM or localizer, its kernels compiled."""
    from curvescan.cli.console import ERR
    from curvescan.live.warm_up import warm_up

    def new() -> Engine:
        if mode == "odometry":
            odometry = curvescan.OdometryConfig.of_method(method)
            return curvescan.Odometry(method, config=replace(odometry, deskew=can_deskew))
        config = curvescan.SlamConfig()
        config = replace(config, odometry=replace(config.odometry, deskew=can_deskew))
        if mode == "localization":
            return curvescan.Localizer(saved, method=method, config=config)
        return curvescan.Slam(method, config=config)

    if viewer is not None:
        viewer.set_status("loading", "loading kernels (they are compiled in the first run only)")
    with ERR.status("loading kernels"):
        warm_up(new, method)
    return new()


def _track(source: ScanSource, tracker: Tracker, viewer: Viewer | None, sinks: Sequence[MapSink]) -> LiveReport:
    """Run and show; every sink has finished when this returns."""
    from curvescan.live import run_live

    if viewer is not None:
        viewer.set_status("running", "running")
    try:
        report = run_live(source, tracker, sinks)
        if report.n_scans and isinstance(tracker.engine, curvescan.Slam):
            started = time.perf_counter()
            poses = tracker.engine.finish().poses
            seconds = time.perf_counter() - started
            for sink in sinks:
                sink.finish_with(poses, seconds)
    finally:
        for sink in sinks:
            sink.close()
    if viewer is not None:
        if report.error is not None:
            viewer.set_status("error", str(report.error))
        else:
            what = "stopped" if report.is_interrupted else "ended"
            viewer.set_status("ended", f"{source.name} has {what} after {report.n_scans:,} scans.")
    for sink in sinks:
        if sink.error is not None:
            raise sink.error
    return report
