"""curvescan demo: a simulated building, or a public log, mapped."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import tyro

from curvescan.cli.options import ConfigFile, Configs, MethodConfigs, SlamConfigs, SlamFlags
from curvescan.io.datasets import DATASETS
from curvescan.matchers.registry import Method

DatasetName: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="NAME")]


def demo(
    *,
    out: Path = Path("demo"),
    log: DatasetName = None,
    world: str = "office-floor",
    sensor: str = "urg-04lx",
    scans: int = 700,
    people: int = 0,
    seed: int = 0,
    method: Method = "curvescan",
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    slam_config: SlamFlags = SlamConfigs(),  # noqa: B008 - frozen
) -> int:
    """Drive a simulated robot in a loop through a building, close the loop, and compare with the truth.

    Writes what `slam` writes, and loop.png: the map of the odometry alone beside the one whose loop is closed. Prints the errors of
    SLAM, of laser odometry and of wheel odometry.

    Parameters
    ----------
    out
        Folder for the results; made if it is missing.
    log
        A public log instead of the simulated building: it is downloaded on its first use, mapped as by `curvescan slam`, and
        compared with its relations where it has them.
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
    method
        The matcher.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    slam_config
        Parameters of SLAM.
    """
    if log is not None:
        return _map_public_log(log, out, method=method, config=config, configs=configs, slam_config=slam_config)
    from curvescan import simulate
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar
    from curvescan.cli.summary import errors_of, summarise, wrote_slam
    from curvescan.io import output_folder
    from curvescan.plots.side_by_side import draw_side_by_side
    from curvescan.runs.slam import save_slam_run
    from curvescan.slam import Slam, run_slam

    slam = Slam(method, matcher=configs.of(method), config=slam_config.slam)
    with output_folder(out) as folder:
        load_kernels(method, slam=True)
        with ERR.status("simulating"):
            simulation = simulate(world, sensor=sensor, n_scans=scans, n_people=people, seed=seed)
        with progress_bar("SLAM", len(simulation)) as advance:
            run = run_slam(simulation, slam, on_step=advance)
        truth = simulation.truth.poses[: len(run.revised.outcomes)]
        tracks = {"laser odometry": run.odometry.poses, "SLAM, loops closed": run.revised.trajectory.poses}
        with ERR.status("drawing the maps"):
            left_out = save_slam_run(folder, run, simulation, command=sys.argv, truth=truth)
            draw_side_by_side(folder / "loop.png", simulation, tracks, truth)
    OUT.print(summarise(run.revised, len(simulation)))
    OUT.print(f"{slam!r}; finished in {run.seconds_to_finish:.1f} s", markup=False)
    if len(truth) < 2:
        return 0
    if simulation.odometry is not None:
        tracks["wheel odometry"] = simulation.odometry.poses[: len(truth)]
    OUT.print(errors_of(tracks, truth))
    OUT.print(wrote_slam(out, left_out, "loop.png"), markup=False)
    return 0


def _map_public_log(name: str, out: Path, **flags: Any) -> int:
    from curvescan.cli.commands.evaluate import evaluate
    from curvescan.cli.commands.slam import slam
    from curvescan.cli.console import ERR
    from curvescan.io.datasets import fetch

    with ERR.status(f"fetching {name}"):
        log = fetch(name)
        relations = fetch(f"{name}.relations") if f"{name}.relations" in DATASETS else None
    status = slam(log, out=out, **flags)
    if relations is not None:
        evaluate(out, relations=relations)
    return status
