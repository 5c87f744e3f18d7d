"""curvescan slam: a log in, a globally consistent trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from curvescan.cli.options import (
    ConfigFile,
    Configs,
    Laser,
    LogPath,
    MapConfig,
    MethodConfigs,
    Preparation,
    PreparationFlags,
    SensorFlags,
    SlamConfigs,
    SlamFlags,
    Topic,
    open_log,
)
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import Method


def slam(
    log: LogPath,
    /,
    *,
    out: Path,
    map: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,  # noqa: A002 - the flag's name
    method: Method = "curvescan",
    range_max: float | None = None,
    topic: Topic = None,
    laser: SensorFlags = Laser(),  # noqa: B008 - frozen
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Close the loops of a log: odometry, and a pose graph that revises every pose.

    Writes trajectory.tum and trajectory.csv (every pose revised, with marginal covariances), trajectory_online.tum (poses as they
    were reported), map.png, graph.png, graph.g2o, closures.csv, map.csmap, run.json, and the occupancy map: map.pgm with map.yaml,
    as Nav2 and map_server load it, and occupancy.png. Ctrl-C ends the run and writes what there is so far, marked as partial.

    Parameters
    ----------
    log
        The log: CARMEN, a ROS bag (ROS 1, ROS 2 sqlite3 or MCAP), CSV, NPZ or CoreSLAM, plain or gzip-compressed; or a
        ROS 2 bag's folder.
    out
        Folder for the results; made if it is missing.
    map
        A map to continue, map.csmap of an earlier run: the log may begin anywhere in it.
    method
        The matcher.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    laser
        How the laser is set up, where its log does not say so or is wrong.
    preparation
        What of the log is used, and what is mended in it.
    occupancy
        How to make the occupancy map.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    slam_config
        Parameters of SLAM.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, run_display
    from curvescan.cli.flags import with_flags
    from curvescan.cli.proposals import propose_commands
    from curvescan.cli.summary import on_the_file, summarise, wrote_slam
    from curvescan.runs.slam_log import slam_log
    from curvescan.slam import load_map

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    begin = None if map is None else load_map(map)
    with run_display(lambda: load_kernels(method, slam=True)) as display:
        result = slam_log(
            source,
            out=out,
            method=method,
            config=slam_config.slam,
            matcher=configs.of(method),
            map=begin,
            odometry_prior=preparation.wanted,
            as_is=preparation.as_is,
            occupancy=occupancy,
            command=sys.argv,
            source=log,
            inputs=() if map is None else (map,),
            display=display,
        )
    for remark in result.prepared.remarks:
        ERR.print(with_flags(remark), markup=False, soft_wrap=True)
    OUT.print(summarise(result.run.revised, len(source)))
    seconds = result.run.seconds_to_finish
    OUT.print(f"{result.run.slam!r}; finished in {seconds:.1f} s", markup=False)
    if result.run.slam.is_deceived:
        OUT.print(
            "places look alike: loop closures bent the odometry more than it can err and were withdrawn; the map is mostly the "
            "odometry's",
            markup=False,
        )
    for remark in (*on_the_file(result.issues), *result.left_out):
        ERR.print(remark, markup=False)
    OUT.print(wrote_slam(out, result.left_out), markup=False)
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], result.issues):
        ERR.print(proposal, markup=False, soft_wrap=True)
    OUT.print(result.verdict.sentence, markup=False, soft_wrap=True)
    return 0 if result.verdict.is_trusted else 3
