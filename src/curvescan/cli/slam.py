"""curvescan slam: a log in, a globally consistent trajectory and a map out."""

from __future__ import annotations

import sys
from dataclasses import replace
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
    odometry_prior: bool = False,
    range_max: float | None = None,
    topic: Topic = None,
    laser: SensorFlags = Laser(),  # noqa: B008 - frozen
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
    odometry_prior
        Expect of each scan what the log's own wheel odometry says, or its gyroscope, instead of the last motion.
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
    slam_config
        Parameters of SLAM.
    """
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import summarise
    from curvescan.diagnostics.inspect import inspect_log
    from curvescan.diagnostics.issues import find_issues
    from curvescan.diagnostics.motion_prior import motion_prior
    from curvescan.diagnostics.sensor import judge_sensor
    from curvescan.diagnostics.verdict import judge_run, propose_commands
    from curvescan.io import output_folder
    from curvescan.runs.slam import save_slam_run
    from curvescan.slam import Slam, load_map, run_slam

    source = open_log(log, range_max=range_max, topic=topic, laser=laser)
    begin = None if map is None else load_map(map)
    with output_folder(out) as folder:
        load_kernels(method)
        given = slam_config.slam
        with ERR.status("looking for what is wrong with the log"):
            sensor = judge_sensor(source, is_order_needed=given.odometry.deskew)
            issues = find_issues(inspect_log(source, sensor))
        odometry_poses = motion_prior(source, sensor.rotation) if odometry_prior else None
        deskew = given.odometry.deskew and sensor.can_deskew
        rules = replace(given, odometry=replace(given.odometry, deskew=deskew))
        tracker = Slam(method, matcher=configs.of(method), config=rules, map=begin)
        with progress_bar("SLAM", len(source)) as advance:
            run = run_slam(
                source, tracker, odometry_poses=odometry_poses, on_step=lambda _: advance()
            )
        verdict = judge_run(run.revised, issues)
        with ERR.status("drawing the maps"):
            left_out = save_slam_run(
                folder,
                run,
                source,
                command=sys.argv,
                source=log,
                occupancy=occupancy,
                verdict=verdict,
            )
    OUT.print(summarise(run.revised, len(source)))
    OUT.print(f"{tracker!r}; finished in {run.seconds_to_finish:.1f} s", markup=False)
    if tracker.is_deceived:
        OUT.print(
            "places look alike: loop closures bent the odometry more than it can err and were withdrawn; the map is mostly the odometry's"
        )
    for remark in left_out:
        ERR.print(remark, markup=False)
    maps = "" if left_out else ", occupancy.png, map.pgm with map.yaml"
    OUT.print(
        f"wrote {out}/trajectory.tum, trajectory.csv, trajectory_online.tum, map.png{maps}, graph.png, "
        "graph.g2o, closures.csv, map.csmap, run.json",
        markup=False,
    )
    for proposal in propose_commands(["curvescan", *sys.argv[1:]], issues):
        ERR.print(proposal, markup=False, soft_wrap=True)
    OUT.print(verdict.sentence, markup=False, soft_wrap=True)
    return 0 if verdict.is_trusted else 3
