"""curvescan odometry: a log in, a trajectory and a map out."""

from __future__ import annotations

import sys
from pathlib import Path

from curvescan.cli.options import (
    Chain,
    ChainConfig,
    ChainConfigs,
    ConfigFile,
    Configs,
    Laser,
    LogPath,
    MapConfig,
    MethodConfigs,
    Preparation,
    PreparationFlags,
    SensorFlags,
    Topic,
    open_log,
)
from curvescan.io.exports import EXPORTS, ExportName
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import Method


def odometry(
    log: LogPath,
    /,
    *,
    out: Path,
    method: Method = "curvescan",
    chain: Chain = "auto",
    range_max: float | None = None,
    topic: Topic = None,
    export: tuple[ExportName, ...] = (),
    laser: SensorFlags = Laser(),  # noqa: B008 - frozen
    preparation: PreparationFlags = Preparation(),  # noqa: B008 - frozen
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
    chain
        What a scan is matched with: `keys`, a keyframe until it is left behind, and earlier ones where the place is known;
        `last`, the scan before it; `auto`, keyframes for the default matcher and the last scan for the others.
    range_max
        Upper limit of a valid reading, metres, in place of what the log says.
    topic
        Which topic of a ROS bag to read, where it holds laser scans on several.
    export
        Further files: kitti (trajectory.kitti, 3x4 rows), g2o (graph.g2o, the matches as a pose graph), mcap (run.mcap, scans and poses
        for Foxglove and ROS 2).
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
    chain_config
        Parameters of the odometry, where keyframes are used.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, run_display
    from curvescan.cli.flags import with_flags
    from curvescan.cli.proposals import propose_commands
    from curvescan.cli.summary import on_the_file, summarise, wrote
    from curvescan.cli.tracker import make_config
    from curvescan.runs.run import run

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    with run_display(lambda: load_kernels(method)) as display:
        result = run(
            source,
            out=out,
            method=method,
            config=make_config(method, chain, chain_config),
            matcher=configs.of(method),
            odometry_prior=preparation.wanted,
            as_is=preparation.as_is,
            exports=export,
            occupancy=occupancy,
            command=sys.argv,
            source=log,
            display=display,
        )
    for remark in result.prepared.remarks:
        ERR.print(with_flags(remark), markup=False, soft_wrap=True)
    if not result.prepared.sensor.can_deskew:
        ERR.print("sweeps are not deskewed: their beams are listed in reverse", markup=False)
    OUT.print(summarise(result.run, len(source)))
    for remark in (*on_the_file(result.issues), *result.left_out):
        ERR.print(remark, markup=False)
    OUT.print(wrote(out, result.left_out), markup=False)
    if export:
        exported = ", ".join(EXPORTS[name].filename for name in export)
        OUT.print(f"wrote {out}/{exported}", markup=False)
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], result.issues):
        ERR.print(proposal, markup=False, soft_wrap=True)
    OUT.print(result.verdict.sentence, markup=False, soft_wrap=True)
    return 0 if result.verdict.is_trusted else 3
