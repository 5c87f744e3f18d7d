"""curvescan evaluate: how far a trajectory is from what is known of the motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from curvescan.cli.options import BenchmarkName, LaserPose, in_radians


def evaluate(
    trajectory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY")],
    /,
    *,
    relations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    reference: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    near: float = 5.0,
    tolerance: float = 0.01,
    benchmark: BenchmarkName | None = None,
    out: Path | None = None,
) -> int:
    """Measure a trajectory against relations of the Freiburg SLAM benchmark, or against reference poses.

    Relations (Kümmerle et al. 2009): translation and rotation errors of near, far and all relations, beside the
    published errors of the same log. Reference poses: absolute errors (ATE), relative errors (RPE) pose to pose and
    over each metre, and the drift for each metre travelled and each degree turned.

    Parameters
    ----------
    trajectory
        Poses of the laser: trajectory.tum or trajectory.csv, a results folder, or a log with poses.
    relations
        Relations of the robot: lines of t1 t2 x y z roll pitch yaw.
    reference
        Reference poses: TUM, CSV with columns stamp (or timestamp), x, y, theta, or a log with corrected poses.
    laser_pose
        Pose of the laser on the robot: metres, metres, degrees; for relations, and for references of the robot.
    near
        Relations of scans less than this apart are near, seconds.
    tolerance
        Largest difference of two time stamps that belong together, seconds; for references. Equal stamps come first.
    benchmark
        Log whose published errors to print; by default what the name of the relations file says.
    out
        Folder for evaluation.md, evaluation.json and two figures; nothing is written without.
    """
    from curvescan.cli.console import OUT, show, with_flags
    from curvescan.runs.evaluation import evaluate as measure
    from curvescan.runs.evaluation import tables_of

    errors = measure(
        trajectory,
        relations=relations,
        reference=reference,
        laser_pose=in_radians(laser_pose),
        near=near,
        tolerance=tolerance,
        benchmark=benchmark,
        out=out,
    )
    notes, tables = tables_of(errors)
    for note in notes:
        OUT.print(with_flags(note))
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/evaluation.md, evaluation.json, errors.png, trajectory.png")
    return 0
