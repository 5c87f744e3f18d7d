"""Errors of trajectories in a folder: a report with tables, a record and figures."""

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from curvescan._version import __version__
from curvescan.errors import InvalidArgumentError, require
from curvescan.evaluation.reference import ReferenceErrors, reference_errors
from curvescan.evaluation.relations import (
    NEAR,
    SOURCE,
    BenchmarkLog,
    RelationErrors,
    Which,
    find_benchmark,
    relation_errors,
)
from curvescan.evaluation.trajectory_errors import Spread
from curvescan.io.files.output import output_folder
from curvescan.io.reading import PoseFile, read_poses
from curvescan.io.sensor_setup import as_mount
from curvescan.io.trajectories.relations import Relations, read_relations
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.plots.evaluation import draw_overlay, draw_reference_errors, draw_relation_errors, draw_relation_places
from curvescan.runs.document import Part, ResultTable, write_markdown
from curvescan.runs.result import Run
from curvescan.runs.results import write_json

_WHICH: dict[Which, str] = {
    "near": "near, under {near:g} s apart",
    "far": "far, {near:g} s apart or more",
    "all": "all",
}


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
        Unless one of `relations` and `reference` is given, some of it is of the trajectory, and `laser_pose` is finite.
    LogFileError, LogFormatError, OutputError
        When a file cannot be read, or the results cannot be written.
    """
    if (relations is None) == (reference is None):
        raise InvalidArgumentError("a trajectory is measured against one thing: give either relations= or reference=")
    require(near >= 0.0, "near must be at least 0 s", near)
    require(tolerance >= 0.0, "tolerance must be at least 0 s", tolerance)
    mount = as_mount(laser_pose)
    own = _poses_of(trajectory).trajectory
    names = {"trajectory": _name(trajectory), "measured_against": _name(reference if relations is None else relations)}
    about: dict[str, object] = {**names, "laser_pose_m_m_deg": [*mount[:2].tolist(), math.degrees(mount[2])]}
    errors: RelationErrors | ReferenceErrors
    with nullcontext() if out is None else output_folder(out) as folder:
        if relations is not None:
            known = find_benchmark(benchmark, "" if isinstance(relations, Relations) else Path(relations).name)
            given = relations if isinstance(relations, Relations) else read_relations(relations)
            errors = relation_errors(own, given, mount, near=near, benchmark=known)
            about["near_s"] = near
        else:
            assert reference is not None
            errors = reference_errors(own, _poses_of(reference), mount, tolerance=tolerance)
            about["tolerance_s"] = tolerance
        if folder is not None:
            _save(folder, about, errors, own)
    return errors


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


def relation_record(errors: RelationErrors) -> dict[str, object]:
    """Return the errors of relations as the record of a JSON file: metres, radians; NaN without any."""
    record: dict[str, object] = {"given": errors.n_given, "missing": errors.n_missing}
    for which in get_args(Which):
        translation, rotation = errors.spreads(which)
        record[which] = {"translation_m": dataclasses.asdict(translation), "rotation_rad": dataclasses.asdict(rotation)}
    return record


def _reference_record(errors: ReferenceErrors) -> dict[str, object]:
    record: dict[str, object] = {
        "poses": errors.n_poses,
        "reference_poses": errors.n_reference,
        "pairs": len(errors.association),
        "exact_pairs": errors.association.n_exact,
        "paired_by": errors.association.by,
        "ate_best_m": dataclasses.asdict(Spread.of(errors.ate_best)),
        "ate_first_m": dataclasses.asdict(Spread.of(errors.ate_first)),
    }
    for name, one in (("frame", errors.rpe_frame), ("metre", errors.rpe_metre)):
        record[f"rpe_{name}_translation_m"] = dataclasses.asdict(Spread.of(one.translation))
        record[f"rpe_{name}_rotation_rad"] = dataclasses.asdict(Spread.of(one.rotation))
    totals = errors.totals
    return record | {
        "path_m": totals.path_length,
        "turned_rad": totals.turned,
        "end_translation_m": totals.end_translation,
        "end_heading_rad": totals.turn_error,
        "translation_drift_per_metre": totals.drift,
        "heading_drift_per_metre_rad": totals.turn_per_metre,
        "heading_drift_per_turn": totals.turn_drift,
    }


def _save(
    folder: Path, about: Mapping[str, object], errors: RelationErrors | ReferenceErrors, trajectory: Trajectory
) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder."""
    record: dict[str, object]
    if isinstance(errors, RelationErrors):
        draw_relation_errors(folder / "errors.png", errors)
        draw_relation_places(folder / "trajectory.png", errors, trajectory)
        texts = (
            "Near relations along the path, and far ones against the path between their scans.",
            "The trajectory, and where the worst near relations are.",
        )
        record = {"relations": relation_record(errors)}
    else:
        draw_reference_errors(folder / "errors.png", errors)
        draw_overlay(folder / "trajectory.png", errors)
        texts = ("Errors along the path of the reference.", "The trajectory, aligned, and the reference.")
        record = {"reference": _reference_record(errors)}
    facts = "\n".join(f"- {key.replace('_', ' ')}: {value}" for key, value in about.items())
    notes, tables = tables_of(errors)
    figures = zip(("errors.png", "trajectory.png"), texts, strict=True)
    parts: list[Part] = ["# Evaluation", facts, *notes, *tables, *figures]
    write_markdown(folder / "evaluation.md", parts)
    write_json(folder / "evaluation.json", {"curvescan": __version__, **about, **record})


def tables_of(errors: RelationErrors | ReferenceErrors) -> tuple[list[str], list[ResultTable]]:
    """Return what is to be known of how an evaluation was made, a sentence each, and its tables."""
    if isinstance(errors, ReferenceErrors):
        return _reference_notes(errors), _reference_tables(errors)
    notes = [f"{len(errors):,} of {errors.n_given:,} relations join two scans of the trajectory."]
    if errors.n_missing:
        notes.append(f"{errors.n_missing:,} relations are left out: the trajectory has no pose at one of their stamps.")
    rows: list[_Row] = []
    for which, words in _WHICH.items():
        translation, rotation = errors.spreads(which)
        name = words.format(near=errors.near)
        rows += [(f"{name}: translation", translation, 1.0, "m"), (f"{name}: rotation", rotation, _DEGREES, "deg")]
    tables = [_spread_table("Errors of relations", "relations", rows, ("mean", "std", "median", "max"))]
    if errors.benchmark is not None:
        tables.append(_published_table(errors, errors.benchmark))
    return notes, tables


def _reference_tables(errors: ReferenceErrors) -> list[ResultTable]:
    """Return absolute and relative errors, and the drift."""
    totals = errors.totals
    rows: list[_Row] = [
        ("ATE, best alignment", Spread.of(errors.ate_best), 1.0, "m"),
        ("ATE, first poses made equal", Spread.of(errors.ate_first), 1.0, "m"),
    ]
    for name, one in (("pose to pose", errors.rpe_frame), ("each metre", errors.rpe_metre)):
        rows.append((f"RPE, {name}: translation", Spread.of(one.translation), 1.0, "m"))
        rows.append((f"RPE, {name}: rotation", Spread.of(one.rotation), _DEGREES, "deg"))
    return [
        _spread_table("Errors against the reference", "", rows, ("mean", "std", "median", "rmse", "max")),
        ResultTable(
            title=f"Drift over {totals.path_length:.1f} m and {np.degrees(totals.turned):,.0f} deg of turns",
            columns=("", "at the end", "for each metre travelled", "for each degree turned"),
            rows=[
                ("position", f"{totals.end_translation:.3f} m", f"{totals.drift:.4f} m", "-"),
                (
                    "heading",
                    f"{np.degrees(totals.turn_error):.2f} deg",
                    f"{np.degrees(totals.turn_per_metre):.4f} deg",
                    "-" if np.isnan(totals.turn_drift) else f"{totals.turn_drift:.5f} deg",
                ),
            ],
        ),
    ]


_Row: TypeAlias = tuple[str, Spread, float, str]  # what it is of, its figures, and scale and unit to show them in
_DEGREES = 180.0 / np.pi


def _spread_table(title: str, first: str, rows: Sequence[_Row], names: tuple[str, ...]) -> ResultTable:
    """Return a table of the figures of these names, a row a spread."""

    def shown(value: float, scale: float, unit: str) -> str:
        return "-" if np.isnan(value) else f"{scale * value:.4f} {unit}"

    entries = [
        (what, f"{spread.n:,}", *(shown(getattr(spread, name), scale, unit) for name in names))
        for what, spread, scale, unit in rows
    ]
    return ResultTable(title=title, columns=(first, "count", *names), rows=entries)


def _reference_notes(errors: ReferenceErrors) -> list[str]:
    """Return how poses and reference were brought together, a sentence each."""
    pairs = errors.association
    found = f"{len(pairs):,} of {errors.n_poses:,} poses have one of the {errors.n_reference:,} reference poses"
    mount = ["The reference holds poses of the laser: laser_pose= is left aside."] * errors.is_mount_unused
    if pairs.by == "order":
        return [*mount, f"{found}, paired in their order: most time stamps repeat and tell nothing."]
    notes = [*mount, f"{found}, {pairs.n_exact:,} of them at exactly the same stamp."]
    if len(errors.stamps) > 1 and (back := np.count_nonzero(np.diff(errors.stamps) < 0.0)):
        notes.append(f"Time goes back {back:,} times: the poses are taken in the order of the file.")
    return notes


def _published_table(errors: RelationErrors, benchmark: BenchmarkLog) -> ResultTable:
    def shown(name: str, which: Which) -> tuple[str, str, str]:
        moved, turned = errors.spreads(which)
        rotation = f"{np.degrees(turned.mean):.2f} ± {np.degrees(turned.std):.2f} deg"
        return name, f"{moved.mean:.3f} ± {moved.std:.3f} m", rotation

    rows = []
    for one in benchmark.errors:
        mean, std = one.translation
        rotation = " ± ".join(f"{degrees:g}" for degrees in one.rotation)
        rows.append((one.method, f"{mean:.3f} ± {std:.3f} m", f"{rotation} deg" if rotation else "-"))
    return ResultTable(
        title=f"Published on {benchmark.name}, all relations ({SOURCE}), and this trajectory",
        columns=("method", "translation", "rotation"),
        rows=[*rows, shown("this trajectory, all relations", "all"), shown("this trajectory, near relations", "near")],
    )
