"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

from curvescan.cli.options import (
    Chain,
    LogFlags,
    LogPath,
    LogUse,
    MapConfig,
    OdometryFlags,
    OdometryRules,
    OutFolder,
    results_folder,
    run_options,
)
from curvescan.io.exports import ExportName
from curvescan.mapping.config import OccupancyConfig


def odometry(
    log: LogPath,
    /,
    *,
    out: OutFolder = None,
    chain: Chain = "auto",
    export: tuple[ExportName, ...] = (),
    rules: OdometryRules = OdometryFlags(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
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
    from curvescan.cli.console import run_display
    from curvescan.cli.summary import report
    from curvescan.runs.run import run

    source, out = use.reading.open(log), results_folder(out, log, "odometry")
    with run_display() as display:
        result = run(
            source,
            out=out,
            config=rules.config(chain),
            exports=export,
            occupancy=occupancy,
            display=display,
            **run_options(log, rules.matching, use),
        )
    return report(result, out)
