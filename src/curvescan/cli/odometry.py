"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal, TypeAlias

from curvescan.cli.options import (
    ConfigFile,
    Configs,
    Laser,
    LaserSetUp,
    LogPath,
    Method,
    MethodConfigs,
    Topic,
    open_log,
)

FurtherName: TypeAlias = Literal["kitti", "g2o", "mcap"]
"""Names of the table of further files, written out so that --help loads none of their writers."""


def odometry(
    log: LogPath,
    /,
    *,
    out: Path,
    method: Method = "curvescan",
    range_max: float | None = None,
    topic: Topic = None,
    also: tuple[FurtherName, ...] = (),
    laser: LaserSetUp = Laser(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
) -> int:
    """Match each scan of a log with the one before, and write the trajectory and the map.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png and run.json. Ctrl-C ends the run and writes
    what there is so far, marked as partial.

    Parameters
    ----------
    log
        The log: CARMEN, a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), CSV, NPZ or CoreSLAM, plain or gzip-compressed; or a
        ROS 2 bag's folder.
    out
        Folder for the results; made if it is missing.
    method
        The matcher.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    also
        Further files: kitti (trajectory.kitti, 3x4 rows), g2o (graph.g2o, the matches as a pose graph), mcap (run.mcap, scans and poses
        for Foxglove and ROS 2).
    laser
        How the laser is set up, where its log does not say so or is wrong.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import summarise
    from curvescan.io import output_folder
    from curvescan.io.further import RunData, write_further
    from curvescan.odometry import Odometry, OdometryStep, run_odometry
    from curvescan.view.graph import PoseGraph
    from curvescan.view.run import save_run

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    chain, graph = Odometry(method, matcher_config=configs.of(method)), PoseGraph()
    with output_folder(out) as folder:
        load_kernels(method)
        with progress_bar("odometry", len(source)) as advance:

            def on_step(step: OdometryStep) -> None:
                graph.add(step)
                advance()

            run = run_odometry(source, chain, on_step=on_step)
        with ERR.status("drawing the map"):
            save_run(folder, run, source, odometry=chain, command=sys.argv, source=log)
    OUT.print(summarise(run, len(source)))
    OUT.print(f"wrote {out}/trajectory.tum, trajectory.csv, map.png, run.json", markup=False)
    if also:
        # on their own: what goes wrong here must not cost the results of the run
        data = RunData(trajectory=run.trajectory, edges=graph.edges, scans=source)
        with output_folder(out) as folder:
            files = write_further(folder, also, data)
        OUT.print(f"wrote {out}/{', '.join(files)}", markup=False)
    return 0
