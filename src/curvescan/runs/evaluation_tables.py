"""The tables of an evaluation, and what is to be known of how it was made."""

from __future__ import annotations

import numpy as np

from curvescan.evaluation.published import SOURCE, BenchmarkLog, PublishedError
from curvescan.evaluation.reference import ReferenceErrors
from curvescan.evaluation.relations import RelationErrors, Which
from curvescan.evaluation.trajectory_errors import Spread
from curvescan.runs.table import ResultTable
from curvescan.types import Floats

_WHICH: dict[Which, str] = {
    "near": "near, under {near:g} s apart",
    "far": "far, {near:g} s apart or more",
    "all": "all",
}


def tables_of(errors: RelationErrors | ReferenceErrors) -> tuple[list[str], list[ResultTable]]:
    """Return what is to be known of how an evaluation was made, a sentence each, and its tables."""
    if isinstance(errors, RelationErrors):
        return relation_notes(errors), relation_tables(errors)
    return reference_notes(errors), reference_tables(errors)


def relation_tables(errors: RelationErrors) -> list[ResultTable]:
    """Return the errors of relations, and the published ones of the same log where there are any."""
    rows = []
    for which, words in _WHICH.items():
        translation, rotation = errors.spreads(which)
        name = words.format(near=errors.near)
        rows.append((f"{name}: translation", f"{translation.n:,}", *_entries(translation, 1.0, "m")))
        degrees = 180.0 / np.pi
        rows.append((f"{name}: rotation", f"{rotation.n:,}", *_entries(rotation, degrees, "deg")))
    tables = [
        ResultTable(
            title="Errors of relations", columns=("relations", "count", "mean", "std", "median", "max"), rows=rows
        )
    ]
    if errors.benchmark is not None:
        tables.append(_published_table(errors, errors.benchmark))
    return tables


def reference_tables(errors: ReferenceErrors) -> list[ResultTable]:
    """Return absolute and relative errors, and the drift."""
    degrees = 180.0 / np.pi
    totals = errors.totals
    rows = [
        ("ATE, best alignment", *_row(errors.ate_best, 1.0, "m")),
        ("ATE, first poses made equal", *_row(errors.ate_first, 1.0, "m")),
        ("RPE, pose to pose: translation", *_row(errors.rpe_frame.translation, 1.0, "m")),
        ("RPE, pose to pose: rotation", *_row(errors.rpe_frame.rotation, degrees, "deg")),
        ("RPE, each metre: translation", *_row(errors.rpe_metre.translation, 1.0, "m")),
        ("RPE, each metre: rotation", *_row(errors.rpe_metre.rotation, degrees, "deg")),
    ]
    return [
        ResultTable(
            title="Errors against the reference",
            columns=("", "count", "mean", "std", "median", "rmse", "max"),
            rows=rows,
        ),
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


def relation_notes(errors: RelationErrors) -> list[str]:
    """Return what is to be known of the relations, a sentence each."""
    notes = [f"{len(errors):,} of {errors.n_given:,} relations join two scans of the trajectory."]
    if errors.n_missing:
        notes.append(f"{errors.n_missing:,} relations are left out: the trajectory has no pose at one of their stamps.")
    return notes


def reference_notes(errors: ReferenceErrors) -> list[str]:
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
    near, everything = errors.spreads("near"), errors.spreads("all")
    rows = [_published_row(one) for one in benchmark.errors]
    for name, (translation, rotation) in (
        ("this trajectory, all relations", everything),
        ("this trajectory, near relations", near),
    ):
        rows.append(
            (
                name,
                f"{translation.mean:.3f} ± {translation.std:.3f} m",
                f"{np.degrees(rotation.mean):.2f} ± {np.degrees(rotation.std):.2f} deg",
            )
        )
    return ResultTable(
        title=f"Published on {benchmark.name}, all relations ({SOURCE}), and this trajectory",
        columns=("method", "translation", "rotation"),
        rows=rows,
    )


def _published_row(one: PublishedError) -> tuple[str, str, str]:
    mean, std = one.translation
    rotation = "-"
    if one.rotation is not None:
        degrees, spread = one.rotation
        rotation = f"{degrees:g} deg" if spread is None else f"{degrees:g} ± {spread:g} deg"
    return (one.method, f"{mean:.3f} ± {std:.3f} m", rotation)


def _entries(spread: Spread, scale: float, unit: str) -> tuple[str, ...]:
    values = (spread.mean, spread.std, spread.median, spread.max)
    return tuple("-" if np.isnan(v) else f"{scale * v:.4f} {unit}" for v in values)


def _row(values: Floats, scale: float, unit: str) -> tuple[str, ...]:
    spread = Spread.of(values)
    mean, std, median, largest = _entries(spread, scale, unit)
    rmse = "-" if np.isnan(spread.rmse) else f"{scale * spread.rmse:.4f} {unit}"
    return (f"{spread.n:,}", mean, std, median, rmse, largest)
