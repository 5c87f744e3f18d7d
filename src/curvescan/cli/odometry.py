"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from curvescan.cli.options import (
    Chain,
    ChainConfig,
    ChainConfigs,
    ConfigFile,
    Configs,
    Laser,
    LogPath,
    MapConfig,
    Method,
    MethodConfigs,
    SensorFlags,
    Topic,
    open_log,
)
from curvescan.mapping.config import OccupancyConfig

if TYPE_CHECKING:
    from curvescan.io import Log
    from curvescan.odometry import OdometryStep

FurtherName: TypeAlias = Literal["kitti", "g2o", "mcap"]
"""Names of the table of further files, written out so that --help loads none of their writers."""


def odometry(
    log: LogPath,
    /,
    *,
    out: Path,
    method: Method = "curvescan",
    odometry_prior: bool = False,
    chain: Chain = "auto",
    range_max: float | None = None,
    topic: Topic = None,
    also: tuple[FurtherName, ...] = (),
    laser: SensorFlags = Laser(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    chain_config: ChainConfig = ChainConfigs(),  # noqa: B008 - frozen
) -> int:
    """Follow the sensor of a log by matching its scans, and write the trajectory and the maps.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png, run.json, and the occupancy map: map.pgm with
    map.yaml, as Nav2 and map_server load it, and occupancy.png. Ctrl-C ends the run and writes what there is so far,
    marked as partial.

    The last line says whether the trajectory can be trusted and, if not, why. Exit status 0 when it can, 3 when it was
    written but is not to be trusted.

    Parameters
    ----------
    log
        The log: CARMEN, a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), CSV, NPZ or CoreSLAM, plain or gzip-compressed; or a
        ROS 2 bag's folder.
    out
        Folder for the results; made if it is missing.
    method
        The matcher.
    odometry_prior
        Expect of each scan what the log's own wheel odometry says, or its gyroscope, instead of the last motion. The
        matches decide where they can; along a corridor the odometry does.
    chain
        What a scan is matched with: `keys`, a key scan until it is left behind, and earlier ones where the place is known;
        `last`, the scan before it; `auto`, key scans for the default matcher and the last scan for the others.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    also
        Further files: kitti (trajectory.kitti, 3x4 rows), g2o (graph.g2o, the matches as a pose graph), mcap (run.mcap, scans and poses
        for Foxglove and ROS 2).
    laser
        How the laser is set up, where its log does not say so or is wrong.
    occupancy
        How to make the occupancy map.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    chain_config
        Parameters of the odometry, where key scans are used.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import summarise, wrote
    from curvescan.cli.tracker import make_odometry
    from curvescan.diagnostics.inspect import inspect_log
    from curvescan.diagnostics.issues import find_issues
    from curvescan.diagnostics.motion_prior import motion_prior
    from curvescan.diagnostics.verdict import judge_run, propose_commands
    from curvescan.io import output_folder
    from curvescan.io.trajectories.exports import RunData, takes_edges, write_exports
    from curvescan.odometry import run_odometry
    from curvescan.odometry.pose_graph import PoseGraph
    from curvescan.runs.odometry import save_run

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    odometry_poses = motion_prior(source) if odometry_prior else None
    graph, is_graph_wanted = PoseGraph(), takes_edges(also)
    with output_folder(out) as folder:
        load_kernels(method)
        deskew = chain_config.odometry.deskew and not _lists_beams_backwards(source)
        tracker = make_odometry(method, chain, configs, chain_config, deskew=deskew)
        with progress_bar("odometry", len(source)) as advance:

            def on_step(step: OdometryStep) -> None:
                if is_graph_wanted:
                    graph.add(step)
                advance()

            run = run_odometry(source, tracker, odometry_poses=odometry_poses, on_step=on_step)
        with ERR.status("looking for what is wrong with the log"):
            issues = find_issues(inspect_log(source))
        verdict = judge_run(run, issues)
        with ERR.status("drawing the maps"):
            left_out = save_run(
                folder,
                run,
                source,
                odometry=tracker,
                command=sys.argv,
                source=log,
                occupancy=occupancy,
                verdict=verdict,
            )
    OUT.print(summarise(run, len(source)))
    for remark in left_out:
        ERR.print(remark, markup=False)
    OUT.print(wrote(out, left_out), markup=False)
    if also:
        # on their own: what goes wrong here must not cost the results of the run
        data = RunData(trajectory=run.trajectory, edges=graph.edges, scans=source)
        with output_folder(out) as folder:
            files = write_exports(folder, also, data)
        OUT.print(f"wrote {out}/{', '.join(files)}", markup=False)
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], issues):
        ERR.print(proposal, markup=False, soft_wrap=True)
    OUT.print(verdict.sentence, markup=False, soft_wrap=True)
    return 0 if verdict.is_trusted else 3


def _lists_beams_backwards(source: Log) -> bool:
    """Return whether the log's sweeps must not be deskewed as they are, and print it."""
    from curvescan.cli.console import ERR
    from curvescan.diagnostics.beam_order import lists_beams_reversed

    # with the default matcher, whatever method runs: its kernels may not be there yet
    what = "asking in which order the beams were swept (kernels are compiled in the first run only)"
    with ERR.status(what):
        is_reversed_order = lists_beams_reversed(source)
    if is_reversed_order:
        ERR.print(
            "the beams of each scan seem to be listed against the order they were swept in: "
            "sweeps are not deskewed; with --backwards they are"
        )
    return is_reversed_order
