"""curvescan experiments: the paper's experiments and tables, beside the paper's own figures."""

from __future__ import annotations

from pathlib import Path

from curvescan.cli.options import LaserPose, in_radians


def experiments(
    *,
    out: Path,
    logs: tuple[Path, ...] = (),
    relations: tuple[Path, ...] = (),
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    only_logs: bool = False,
    quick: bool = False,
    seed: int = 0,
) -> int:
    """Run the paper's five experiments with every method, and report them beside the paper's figures.

    Writes report.html (self-contained), report.md, results.json and the figures. The same seed gives the same numbers
    to the last digit, times aside.

    Parameters
    ----------
    out
        Folder for the report; made if it is missing.
    logs
        Real logs on which every method is run too: errors, failures and milliseconds a scan.
    relations
        Relations of the Freiburg SLAM benchmark; their time stamps tell which log each file belongs to.
    laser_pose
        Pose of the laser on the robot for the relations: metres, metres, degrees.
    only_logs
        Run the methods on the real logs alone, without the paper's experiments on simulated scans.
    quick
        A tenth of the runs and a quarter of the scans, to see that all works.
    seed
        Seed of all simulated scans.
    """
    from curvescan.cli.console import ERR, OUT, load_usable_methods, progress_bars
    from curvescan.io import output_folder, read_log, read_relations
    from curvescan.paper.experiments import run_experiments
    from curvescan.paper.report import save_experiments

    mount = in_radians(laser_pose)
    sources = [read_log(path) for path in logs]
    known = [read_relations(path) for path in relations]
    with output_folder(out) as folder:
        methods = load_usable_methods()
        with progress_bars() as progress:
            results = run_experiments(
                methods=methods,
                logs=sources,
                relations=known,
                laser_pose=mount,
                only_logs=only_logs,
                is_quick=quick,
                seed=seed,
                progress=progress,
            )
        with ERR.status("drawing and writing the report"):
            save_experiments(folder, results)
    OUT.print(f"wrote {out}/report.html, report.md, results.json")
    return 0
