"""curvescan demo: a simulated building, driven through and mapped; needs no data."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from curvescan.cli.options import ConfigFile, Configs, MethodConfigs, MethodName, OutFolder, SlamConfigs, SlamFlags


def demo(
    *,
    out: OutFolder = Path("demo"),
    world: str = "office-floor",
    sensor: str = "urg-04lx",
    scans: int = 700,
    people: int = 0,
    seed: int = 0,
    method: MethodName = "curvescan",
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Drive a simulated robot in a loop through a building, close the loop, and compare with the truth.

    Writes what `slam` writes, and loop.png: the map of the odometry alone beside the one whose loop is closed. Prints the errors of
    SLAM, of laser odometry and of wheel odometry.

    Parameters
    ----------
    world
        Kind of the simulated world.
    sensor
        Simulated sensor.
    scans
        How many scans.
    people
        How many people walk around the robot.
    seed
        Another seed, another building and another drive.
    """
    from curvescan import run, simulate
    from curvescan.cli.console import ERR, OUT, load_kernels, run_display
    from curvescan.cli.summary import errors_of, report
    from curvescan.io import output_folder
    from curvescan.plots.side_by_side import draw_side_by_side
    from curvescan.runs.results import save_run

    with output_folder(out) as folder:
        with ERR.status("simulating"):
            log = simulate(world, sensor=sensor, n_scans=scans, n_people=people, seed=seed)
        truth = log.truth.poses
        with run_display(lambda: load_kernels(method, slam=True)) as display:
            result = run(
                log,
                "slam",
                method=method,
                matcher=configs.of(method),
                config=slam_config.slam,
                truth=truth,
                command=sys.argv,
                display=display,
            )
            display.begin("drawing the maps", 0)
            record = result.record
            tracks = {"laser odometry": record.odometry.poses, "SLAM, loops closed": result.trajectory.poses}
            draw_side_by_side(folder / "loop.png", log, tracks, truth)
            save_run(folder, result)
        result = replace(result, files=tuple(sorted(file.name for file in folder.iterdir())))
    truth = truth[: len(record.outcomes)]
    if len(truth) > 1:
        if log.odometry is not None:
            tracks["wheel odometry"] = log.odometry.poses[: len(truth)]
        OUT.print(errors_of(tracks, truth))
    report(result, out)
    return 0
