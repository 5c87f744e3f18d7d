"""curvescan demo: a simulated building, driven through and mapped; needs no data."""

from __future__ import annotations

import sys
from pathlib import Path

from curvescan.cli.options import (
    Chain,
    ChainConfig,
    ChainConfigs,
    ConfigFile,
    Configs,
    MethodConfigs,
)
from curvescan.matchers.registry import Method


def demo(
    *,
    out: Path = Path("demo"),
    world: str = "office-floor",
    sensor: str = "sick-lms200",
    scans: int = 500,
    people: int = 0,
    seed: int = 0,
    method: Method = "curvescan",
    chain: Chain = "auto",
    config: ConfigFile = None,
    configs: Configs = MethodConfigs(),  # noqa: B008 - frozen
    chain_config: ChainConfig = ChainConfigs(),  # noqa: B008 - frozen
) -> int:
    """Drive a simulated robot through a building, match its scans, and compare with the truth.

    Writes what `odometry` writes, and prints the errors of scan matching and of wheel odometry.

    Parameters
    ----------
    out
        Folder for the results; made if it is missing.
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
    chain
        What a scan is matched with: `keys`, keyframes; `last`, the scan before it; `auto`, keyframes for the default matcher.
    config
        TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags change what it says.
    configs
        Parameters of the methods; those of the method that runs are used.
    chain_config
        Parameters of the odometry, where keyframes are used.
    """
    import numpy as np

    from curvescan import simulate
    from curvescan.cli.console import ERR, OUT, load_kernels, progress_bar, table
    from curvescan.cli.summary import summarise, wrote
    from curvescan.cli.tracker import make_odometry
    from curvescan.evaluation.trajectory_errors import trajectory_errors
    from curvescan.io import output_folder
    from curvescan.odometry import run_odometry
    from curvescan.runs.odometry import save_run

    tracker = make_odometry(method, chain, configs, chain_config)
    with output_folder(out) as folder:
        load_kernels(method)
        with ERR.status("simulating"):
            log = simulate(world, sensor=sensor, n_scans=scans, n_people=people, seed=seed)
        with progress_bar("odometry", len(log)) as advance:
            run = run_odometry(log, tracker, on_step=advance)
        truth = log.truth.poses[: len(run.outcomes)]
        with ERR.status("drawing the maps"):
            left_out = save_run(folder, run, log, odometry=tracker, command=sys.argv, truth=truth)
    OUT.print(summarise(run, len(log)))
    if len(truth) < 2:
        return 0
    errors = table(
        f"errors over {trajectory_errors(truth, truth).path_length:.1f} m",
        "",
        "a step, median",
        "a step, worst",
        "end pose",
    )
    tracks = {f"scan matching ({run.method})": run.trajectory.poses}
    if log.odometry is not None:
        tracks["wheel odometry"] = log.odometry.poses[: len(truth)]
    for name, poses in tracks.items():
        e = trajectory_errors(poses, truth)
        errors.add_row(
            name,
            f"{1e3 * np.median(e.step_translation):.1f} mm, {np.degrees(np.median(e.step_rotation)):.2f} deg",
            f"{1e3 * e.step_translation.max():.0f} mm, {np.degrees(e.step_rotation.max()):.1f} deg",
            f"{e.end_translation:.2f} m, {np.degrees(e.end_rotation):.1f} deg",
        )
    OUT.print(errors)
    OUT.print(wrote(out, left_out), markup=False)
    return 0
