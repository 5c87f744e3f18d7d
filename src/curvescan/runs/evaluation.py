"""What an evaluation found, in a folder: a report, a record and figures."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from curvescan._version import __version__
from curvescan.evaluation.published import BenchmarkLog
from curvescan.evaluation.reference import ReferenceErrors
from curvescan.evaluation.relations import RelationErrors, Which
from curvescan.evaluation.trajectory_errors import Spread
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.plots.evaluation import draw_overlay, draw_reference_errors, draw_relation_errors, draw_relation_places
from curvescan.runs.document import Part, write_markdown
from curvescan.runs.evaluation_tables import reference_notes, reference_tables, relation_notes, relation_tables
from curvescan.runs.table import ResultTable


def save_relation_evaluation(
    folder: Path,
    errors: RelationErrors,
    trajectory: Trajectory,
    *,
    benchmark: BenchmarkLog | None,
    about: Mapping[str, object],
) -> None:
    """Write evaluation.md, evaluation.json, errors.png and trajectory.png into an existing folder."""
    draw_relation_errors(folder / "errors.png", errors)
    draw_relation_places(folder / "trajectory.png", errors, trajectory)
    figures = [
        ("errors.png", "Near relations along the path, and far ones against the path between their scans."),
        ("trajectory.png", "The trajectory, and where the worst near relations are."),
    ]
    tables, record = relation_tables(errors, benchmark), relation_record(errors)
    _save(folder, about, relation_notes(errors), tables, figures, {"relations": record})


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
    facts = "\n".join(f"- {key.replace('_', ' ')}: {value}" for key, value in about.items())
    parts: list[Part] = ["# Evaluation", facts, *notes, *tables, *figures]
    write_markdown(folder / "evaluation.md", parts)
    whole = {"curvescan": __version__, **about, **record}
    (folder / "evaluation.json").write_text(json.dumps(whole, indent=2) + "\n", encoding="utf-8", newline="\n")


def _record(spread: Spread) -> dict[str, object]:
    return {key: value if key == "n" else _number(value) for key, value in dataclasses.asdict(spread).items()}


def _number(value: float) -> float | None:
    """Return a number as JSON has it: NaN is null."""
    return None if np.isnan(value) else value
