"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path

from curvescan.cli.options import (
    ConfigFile,
    Configs,
    Laser,
    LaserSetUp,
    LogPath,
    MapConfig,
    Method,
    MethodConfigs,
    Topic,
    open_log,
)
from curvescan.mapping.config import OccupancyConfig


def odometry(
    log: LogPath,
    /,
    *,
    out: Path,
    method: Method = "curvescan",
    range_max: float | None = None,
    topic: Topic = None,
    laser: LaserSetUp = Laser(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
) -> int:
    """Match each scan of a log with the one before, and write the trajectory and the maps.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png, run.json, and the occupancy map: map.pgm with
    map.yaml, as Nav2 and map_server load it, and occupancy.png. Ctrl-C ends the run and writes what there is so far,
    marked as partial.

    Parameters
    ----------
    log
        The log: CARMEN or a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), plain or gzip-compressed; or a ROS 2 bag's folder.
    out
        Folder for the results; made if it is missing.
    method
        The matcher.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    laser
        How the laser is set up, where its log does not say so or is wrong.
    occupancy
        How to make the occupancy map.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import summarise, wrote
    from curvescan.io import output_folder
    from curvescan.odometry import Odometry, run_odometry
    from curvescan.view.run import save_run

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    chain = Odometry(method, matcher_config=configs.of(method))
    with output_folder(out) as folder:
        load_kernels(method)
        with progress_bar("odometry", len(source)) as advance:
            run = run_odometry(source, chain, on_step=advance)
        with ERR.status("drawing the maps"):
            left_out = save_run(
                folder,
                run,
                source,
                odometry=chain,
                command=sys.argv,
                source=log,
                occupancy=occupancy,
            )
    OUT.print(summarise(run, len(source)))
    for remark in left_out:
        ERR.print(remark, markup=False)
    OUT.print(wrote(out, left_out), markup=False)
    return 0
