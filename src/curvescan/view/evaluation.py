"""What an evaluation found: tables for the terminal, a report, a record, and its figures."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from curvescan import __version__
from curvescan.evaluation.errors import Spread
from curvescan.evaluation.published import SOURCE, BenchmarkLog, PublishedError
from curvescan.evaluation.reference import ReferenceErrors
from curvescan.evaluation.relations import RelationErrors, Which
from curvescan.types import Trajectory
from curvescan.view.document import Part, write_markdown
from curvescan.view.evaluation_figures import (
    draw_overlay,
    draw_reference_errors,
    draw_relation_errors,
    draw_relation_places,
)
from curvescan.view.table import ResultTable

_WHICH: dict[Which, str] = {
    "near": "near, under {near:g} s apart",
    "far": "far, {near:g} s apart or more",
    "all": "all",
}


def relation_tables(errors: RelationErrors, benchmark: BenchmarkLog | None) -> list[ResultTable]:
    """Return the errors of relations, and the published ones of the same log where there are any."""
    rows = []
    for which, words in _WHICH.items():
        translation, rotation = errors.spreads(which)
        name = words.format(near=errors.near)
        rows.append(
            (f"{name}: translation", f"{translation.n:,}", *_entries(translation, 1.0, "m"))
        )
        degrees = 180.0 / np.pi
        rows.append((f"{name}: rotation", f"{rotation.n:,}", *_entries(rotation, degrees, "deg")))
    tables = [
        ResultTable(
            title="Errors of relations",
            columns=("relations", "count", "mean", "std", "median", "max"),
            rows=rows,
        )
    ]
    if benchmark is not None:
        tables.append(_published_table(errors, benchmark))
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
                (
                    "position",
                    f"{totals.end_translation:.3f} m",
                    f"{totals.drift:.4f} m",
                    "-",
                ),
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
        notes.append(
            f"{errors.n_missing:,} relations are left out: the trajectory has no pose at one of their stamps."
        )
    return notes


def reference_notes(errors: ReferenceErrors) -> list[str]:
    """Return how poses and reference were brought together, a sentence each."""
    pairs = errors.association
    found = f"{len(pairs):,} of {errors.n_poses:,} poses have one of the {errors.n_reference:,} reference poses"
    if pairs.by == "order":
        return [f"{found}, paired in their order: most time stamps repeat and tell nothing."]
    notes = [f"{found}, {pairs.n_exact:,} of them at exactly the same stamp."]
    if len(errors.stamps) > 1 and (back := np.count_nonzero(np.diff(errors.stamps) < 0.0)):
        notes.append(
            f"Time goes back {back:,} times: the poses are taken in the order of the file."
        )
    return notes


def save_relation_evaluation(
    folder: Path,
    errors: RelationErrors,
    trajectory: Trajectory,
    *,
    benchmark: BenchmarkLog | None,
    about: Mapping[str, object],
) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder.

    Parameters
    ----------
    folder : Path
        Where to write; see :func:`curvescan.io.output_folder`.
    errors : RelationErrors
        Of the trajectory.
    trajectory : Trajectory
        To be drawn.
    benchmark : BenchmarkLog or None
        Whose published errors stand beside.
    about : mapping
        What was evaluated and how, for the report.
    """
    draw_relation_errors(folder / "errors.png", errors)
    draw_relation_places(folder / "trajectory.png", errors, trajectory)
    figures = [
        (
            "errors.png",
            "Near relations along the path, and far ones against the path between their scans.",
        ),
        ("trajectory.png", "The trajectory, and where the worst near relations are."),
    ]
    tables, record = relation_tables(errors, benchmark), relation_record(errors)
    _save(folder, about, relation_notes(errors), tables, figures, {"relations": record})


def relation_record(errors: RelationErrors) -> dict[str, object]:
    """Return the errors of relations as a JSON file holds them: metres, radians."""
    record: dict[str, object] = {"given": errors.n_given, "missing": errors.n_missing}
    for which in _WHICH:
        translation, rotation = errors.spreads(which)
        record[which] = {"translation_m": _record(translation), "rotation_rad": _record(rotation)}
    return record


def save_reference_evaluation(
    folder: Path, errors: ReferenceErrors, *, about: Mapping[str, object]
) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder.

    Parameters
    ----------
    folder : Path
        Where to write; see :func:`curvescan.io.output_folder`.
    errors : ReferenceErrors
        Of the trajectory.
    about : mapping
        What was evaluated and how, for the report.
    """
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
    tables, notes = reference_tables(errors), reference_notes(errors)
    _save(folder, about, notes, tables, figures, {"reference": record})


def _save(
    folder: Path,
    about: Mapping[str, object],
    notes: Sequence[str],
    tables: Sequence[ResultTable],
    figures: Sequence[tuple[str, str]],
    record: dict[str, object],
) -> None:
    told = "\n".join(f"- {key.replace('_', ' ')}: {value}" for key, value in about.items())
    parts: list[Part] = ["# Evaluation", told, *notes, *tables, *figures]
    write_markdown(folder / "evaluation.md", parts)
    whole = {"curvescan": __version__, **about, **record}
    (folder / "evaluation.json").write_text(json.dumps(whole, indent=2) + "\n", encoding="utf-8")


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
    rotation = "-" if one.rotation is None else "{:.1f} ± {:.1f} deg".format(*one.rotation)
    return (one.method, f"{mean:.3f} ± {std:.3f} m", rotation)


def _entries(spread: Spread, scale: float, unit: str) -> tuple[str, ...]:
    values = (spread.mean, spread.std, spread.median, spread.max)
    return tuple("-" if np.isnan(v) else f"{scale * v:.4f} {unit}" for v in values)


def _row(values: np.ndarray, scale: float, unit: str) -> tuple[str, ...]:
    spread = Spread.of(values)
    mean, std, median, largest = _entries(spread, scale, unit)
    rmse = "-" if np.isnan(spread.rmse) else f"{scale * spread.rmse:.4f} {unit}"
    return (f"{spread.n:,}", mean, std, median, rmse, largest)


def _record(spread: Spread) -> dict[str, object]:
    return {
        key: value if key == "n" else _number(value)
        for key, value in dataclasses.asdict(spread).items()
    }


def _number(value: float) -> float | None:
    """Return a number as JSON has it: NaN is null."""
    return None if np.isnan(value) else value
