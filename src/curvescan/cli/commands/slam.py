"""curvescan slam: a log in, a globally consistent trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from curvescan.cli.options import (
    ConfigFile,
    Configs,
    LogPath,
    MapConfig,
    MethodConfigs,
    MethodName,
    OutFolder,
    Preparation,
    PreparationFlags,
    Reading,
    ReadingFlags,
    SlamConfigs,
    SlamFlags,
)
from curvescan.io.exports import ExportName
from curvescan.mapping.config import OccupancyConfig


def slam(
    log: LogPath,
    /,
    *,
    out: OutFolder,
    map: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,  # noqa: A002 - the flag's name
    method: MethodName = "curvescan",
    export: tuple[ExportName, ...] = (),
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Close the loops of a log: odometry, and a pose graph that revises every pose.

    Writes trajectory.tum and trajectory.csv (every pose revised, with marginal covariances), trajectory_online.tum (poses as they
    were reported), map.png, wheels.png (the map by the log's wheel odometry), graph.png, graph.g2o, closures.csv, map.csmap,
    run.json, and the occupancy map: map.pgm with map.yaml, as Nav2 and map_server load it, and occupancy.png. Ctrl-C ends the run
    and writes the results so far, marked as partial.

    Parameters
    ----------
    map
        A map to continue, map.csmap of an earlier run: the log may begin anywhere in it.
    export
        Further files: kitti (trajectory.kitti, 3x4 rows), mcap (run.mcap, scans and poses for Foxglove and ROS 2); graph.g2o
        is written in any case.
    """
    from curvescan.cli.console import load_kernels, run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import run

    source = reading.open(log)
    with run_display(lambda: load_kernels(method, slam=True)) as display:
        result = run(
            source,
            "slam",
            out=out,
            method=method,
            config=slam_config.slam,
            matcher=configs.of(method),
            map=map,
            odometry_prior=preparation.wanted,
            as_is=preparation.as_is,
            exports=export,
            occupancy=occupancy,
            command=sys.argv,
            source=log,
            display=display,
            keeps_steps=False,
        )
    return report(result, out)
