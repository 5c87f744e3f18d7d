"""curvescan evaluate: how far a trajectory is from what is known of the motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from curvescan.cli.options import LaserPose, in_radians


def evaluate(
    trajectory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY")],
    /,
    *,
    relations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    reference: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    near: float = 5.0,
    tolerance: float = 0.01,
    benchmark: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    out: Path | None = None,
) -> int:
    """Measure a trajectory against relations of the Freiburg SLAM benchmark, or against reference poses.

    Relations (Kümmerle et al. 2009): translation and rotation errors of near, far and all relations, beside the published
    errors of the same log. Reference poses: absolute errors (ATE), relative errors (RPE) pose to pose and over each
    metre, and the drift for each metre travelled and each degree turned.

    Parameters
    ----------
    trajectory
        Poses of the laser: trajectory.tum or trajectory.csv, or the folder that `curvescan odometry` wrote; or a log, whose own
        poses are then measured.
    relations
        Relations of the robot: lines of t1 t2 x y z roll pitch yaw.
    reference
        Reference poses: TUM, CSV with columns stamp (or timestamp), x, y, theta, or a log with corrected poses.
    laser_pose
        Pose of the laser on the robot: metres, metres, degrees. Relations are of the robot, and so may be references in TUM
        or CSV; the poses in a log are the laser's already.
    near
        Relations of scans less than this apart are near, seconds.
    tolerance
        Largest difference of two time stamps that belong together, seconds; for references. Equal stamps come first.
    benchmark
        Whose published errors to print: aces, intel, mit-killian-court, mit-csail, freiburg-079, freiburg-hospital; by default what
        the name of the relations file says.
    out
        Folder to write evaluation.md, evaluation.json, errors.png and trajectory.png into; nothing is written without.
    """
    from contextlib import nullcontext

    import numpy as np

    from curvescan.cli.console import OUT, show
    from curvescan.errors import InvalidArgumentError, require
    from curvescan.evaluation.published import find_benchmark
    from curvescan.evaluation.reference import reference_errors
    from curvescan.evaluation.relations import relation_errors
    from curvescan.io import output_folder, read_poses, read_relations
    from curvescan.runs import evaluation as view
    from curvescan.runs import evaluation_tables as tables_of

    if (relations is None) == (reference is None):
        raise InvalidArgumentError(
            "a trajectory is measured against one thing: give either --relations FILE or --reference FILE"
        )
    require(near >= 0.0, "near must be at least 0 s", near)
    require(tolerance >= 0.0, "tolerance must be at least 0 s", tolerance)
    mount = in_radians(laser_pose)
    own = read_poses(trajectory).trajectory
    about: dict[str, object] = {
        "trajectory": str(trajectory),
        "measured_against": str(relations or reference),
        "laser_pose_m_m_deg": list(laser_pose),
    }
    with nullcontext() if out is None else output_folder(out) as folder:
        if relations is not None:
            known = find_benchmark(benchmark, relations.name)
            errors = relation_errors(own, read_relations(relations), mount, near=near)
            notes, tables = (tables_of.relation_notes(errors), tables_of.relation_tables(errors, known))
            if folder is not None:
                view.save_relation_evaluation(folder, errors, own, benchmark=known, about=about | {"near_s": near})
        elif reference is not None:
            source = read_poses(reference)
            if source.is_of_sensor and np.any(mount):
                OUT.print("the reference holds poses of the laser: --laser-pose is left aside")
            against = reference_errors(own, source, mount, tolerance=tolerance)
            notes, tables = tables_of.reference_notes(against), tables_of.reference_tables(against)
            if folder is not None:
                about |= {"tolerance_s": tolerance}
                view.save_reference_evaluation(folder, against, about=about)
    for note in notes:
        OUT.print(note)
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/evaluation.md, evaluation.json, errors.png, trajectory.png", markup=False)
    return 0
