"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys

from curvescan.cli.options import (
    Chain,
    ChainConfig,
    ChainConfigs,
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
    odometry_config,
    results_folder,
)
from curvescan.io.exports import ExportName
from curvescan.mapping.config import OccupancyConfig


def odometry(
    log: LogPath,
    /,
    *,
    out: OutFolder = None,
    method: MethodName = "curvescan",
    chain: Chain = "auto",
    export: tuple[ExportName, ...] = (),
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
    reading: ReadingFlags = Reading(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    chain_config: ChainConfig = ChainConfigs(),  # noqa: B008 - frozen
) -> int:
    """Follow the sensor of a log by matching its scans, and write the trajectory and the maps.

    Writes trajectory.tum, trajectory.csv (with covariances), map.png, wheels.png (the map by the log's wheel odometry),
    run.json, and the occupancy map: map.pgm with map.yaml, as Nav2 and map_server load it, and occupancy.png. Ctrl-C
    ends the run and writes the results so far, marked as partial.

    The last line says whether the trajectory can be trusted and, if not, why. Exit status 0 when it can, 3 when it was
    written but is not to be trusted.

    Parameters
    ----------
    chain
        What a scan is matched with: `keys`, a keyframe until it is left behind, and earlier ones where the place is
        known; `last`, the scan before it; `auto`, keyframes for the default matcher and the last scan for the others.
    export
        Further files: kitti (trajectory.kitti, 3x4 rows), g2o (graph.g2o, the matches as a pose graph), mcap (run.mcap,
        scans and poses for Foxglove and ROS 2).
    """
    from curvescan.cli.console import load_kernels, run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import run

    source, out = reading.open(log), results_folder(out, log, "odometry")
    with run_display(lambda: load_kernels(method)) as display:
        result = run(
            source,
            out=out,
            method=method,
            config=odometry_config(method, chain, chain_config),
            matcher=configs.of(method),
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
