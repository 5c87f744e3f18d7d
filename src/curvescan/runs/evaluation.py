"""What an evaluation found, in a folder: a report, a record and figures."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from curvescan._version import __version__
from curvescan.errors import InvalidArgumentError, require
from curvescan.evaluation.published import find_benchmark
from curvescan.evaluation.reference import ReferenceErrors, reference_errors
from curvescan.evaluation.relations import NEAR, RelationErrors, Which, relation_errors
from curvescan.evaluation.trajectory_errors import Spread
from curvescan.io.files.output import output_folder
from curvescan.io.poses import PoseFile, read_poses
from curvescan.io.trajectories.relations import Relations, read_relations
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.plots.evaluation import draw_overlay, draw_reference_errors, draw_relation_errors, draw_relation_places
from curvescan.runs.document import Part, write_markdown
from curvescan.runs.evaluation_tables import tables_of
from curvescan.runs.result import Run


def evaluate(
    trajectory: Run | Trajectory | str | os.PathLike[str],
    *,
    relations: Relations | str | os.PathLike[str] | None = None,
    reference: Run | Trajectory | str | os.PathLike[str] | None = None,
    laser_pose: ArrayLike = (0.0, 0.0, 0.0),
    near: float = NEAR,
    tolerance: float = 0.01,
    benchmark: str | None = None,
    out: str | os.PathLike[str] | None = None,
) -> RelationErrors | ReferenceErrors:
    """Return the errors of a trajectory against relations, or against reference poses.

    Parameters
    ----------
    trajectory : Run, Trajectory, str or path-like
        Poses of the sensor: a run, its trajectory, a TUM or CSV file, a results folder, or a log with poses.
    relations : Relations, str or path-like
        Relations of the robot, as the Freiburg SLAM benchmark has them, or their file; or `reference`.
    reference : Run, Trajectory, str or path-like
        Reference poses, or their file; those of a Trajectory are of the robot.
    laser_pose : (3,) array_like
        Pose of the laser on the robot: metres, metres, radians.
    near, tolerance : float
        Relations of scans less than `near` seconds apart are near; stamps of poses and references that belong together
        differ by `tolerance` seconds at most.
    benchmark : str or None
        Log of the benchmark whose published errors to add; None for the one that the name of the relations' file says.
    out : str, path-like or None
        Folder for evaluation.md, evaluation.json, errors.png and trajectory.png; None to write nothing.

    Raises
    ------
    InvalidArgumentError
        Unless one of `relations` and `reference` is given, or when nothing of it belongs to the trajectory.
    LogFileError, LogFormatError, OutputError
        When a file cannot be read, or the results cannot be written.
    """
    if (relations is None) == (reference is None):
        raise InvalidArgumentError("a trajectory is measured against one thing: give either relations= or reference=")
    require(near >= 0.0, "near must be at least 0 s", near)
    require(tolerance >= 0.0, "tolerance must be at least 0 s", tolerance)
    own = _poses_of(trajectory).trajectory
    about = _about(trajectory, relations if relations is not None else reference, laser_pose)
    with nullcontext() if out is None else output_folder(out) as folder:
        if relations is not None:
            known = find_benchmark(benchmark, "" if isinstance(relations, Relations) else Path(relations).name)
            given = relations if isinstance(relations, Relations) else read_relations(relations)
            by_relations = relation_errors(own, given, laser_pose, near=near, benchmark=known)
            if folder is not None:
                save_relation_evaluation(folder, by_relations, own, about=about | {"near_s": near})
            return by_relations
        assert reference is not None
        errors = reference_errors(own, _poses_of(reference), laser_pose, tolerance=tolerance)
        if folder is not None:
            save_reference_evaluation(folder, errors, about=about | {"tolerance_s": tolerance})
        return errors


def _about(trajectory: object, measured_against: object, laser_pose: ArrayLike) -> dict[str, object]:
    x, y, theta = np.asarray(laser_pose, dtype=np.float64).tolist()
    names = {"trajectory": _name(trajectory), "measured_against": _name(measured_against)}
    return {**names, "laser_pose_m_m_deg": [x, y, math.degrees(theta)]}


def _poses_of(source: Run | Trajectory | str | os.PathLike[str]) -> PoseFile:
    if isinstance(source, Run):
        return PoseFile(trajectory=source.trajectory, is_of_sensor=True)
    if isinstance(source, Trajectory):
        return PoseFile(trajectory=source, is_of_sensor=False)
    if isinstance(source, str | os.PathLike):
        return read_poses(source)
    raise InvalidArgumentError(f"a trajectory must be a Run, a Trajectory or a path, got {type(source).__name__}")


def _name(source: object) -> str:
    return str(source) if isinstance(source, str | os.PathLike) else repr(source)


def save_relation_evaluation(
    folder: Path, errors: RelationErrors, trajectory: Trajectory, *, about: Mapping[str, object]
) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder."""
    draw_relation_errors(folder / "errors.png", errors)
    draw_relation_places(folder / "trajectory.png", errors, trajectory)
    figures = [
        ("errors.png", "Near relations along the path, and far ones against the path between their scans."),
        ("trajectory.png", "The trajectory, and where the worst near relations are."),
    ]
    _save(folder, about, errors, figures, {"relations": relation_record(errors)})


def relation_record(errors: RelationErrors) -> dict[str, object]:
    """Return the errors of relations as a JSON file holds them: metres, radians."""
    record: dict[str, object] = {"given": errors.n_given, "missing": errors.n_missing}
    for which in get_args(Which):
        translation, rotation = errors.spreads(which)
        record[which] = {"translation_m": _record(translation), "rotation_rad": _record(rotation)}
    return record


def save_reference_evaluation(folder: Path, errors: ReferenceErrors, *, about: Mapping[str, object]) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder."""
    draw_reference_errors(folder / "errors.png", errors)
    draw_overlay(folder / "trajectory.png", errors)
    figures = [
        ("errors.png", "Errors along the path of the reference."),
        ("trajectory.png", "The trajectory, aligned, and the reference."),
    ]
    record: dict[str, object] = {
        "poses": errors.n_poses,
        "reference_poses": errors.n_reference,
        "pairs": len(errors.association),
        "exact_pairs": errors.association.n_exact,
        "paired_by": errors.association.by,
        "ate_best_m": _record(Spread.of(errors.ate_best)),
        "ate_first_m": _record(Spread.of(errors.ate_first)),
    }
    for name, one in (("frame", errors.rpe_frame), ("metre", errors.rpe_metre)):
        record[f"rpe_{name}_translation_m"] = _record(Spread.of(one.translation))
        record[f"rpe_{name}_rotation_rad"] = _record(Spread.of(one.rotation))
    totals = errors.totals
    record |= {
        "path_m": totals.path_length,
        "turned_rad": totals.turned,
        "end_translation_m": totals.end_translation,
        "end_heading_rad": totals.turn_error,
        "translation_drift_per_metre": _number(totals.drift),
        "heading_drift_per_metre_rad": _number(totals.turn_per_metre),
        "heading_drift_per_turn": _number(totals.turn_drift),
    }
    _save(folder, about, errors, figures, {"reference": record})


def _save(
    folder: Path,
    about: Mapping[str, object],
    errors: RelationErrors | ReferenceErrors,
    figures: Sequence[tuple[str, str]],
    record: dict[str, object],
) -> None:
    facts = "\n".join(f"- {key.replace('_', ' ')}: {value}" for key, value in about.items())
    notes, tables = tables_of(errors)
    parts: list[Part] = ["# Evaluation", facts, *notes, *tables, *figures]
    write_markdown(folder / "evaluation.md", parts)
    whole = {"curvescan": __version__, **about, **record}
    (folder / "evaluation.json").write_text(json.dumps(whole, indent=2) + "\n", encoding="utf-8", newline="\n")


def _record(spread: Spread) -> dict[str, object]:
    return {key: value if key == "n" else _number(value) for key, value in dataclasses.asdict(spread).items()}


def _number(value: float) -> float | None:
    """Return a number as JSON has it: NaN is null."""
    return None if np.isnan(value) else value
