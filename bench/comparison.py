"""Measure the rows of docs/comparison.md: `python bench/comparison.py [--data FOLDER] [--logs intel] [--methods plicp] [--left]`.

Runs SLAM with the default matcher and the odometry of every method over the logs of the Freiburg benchmark whose
checked relations are at hand, the laser alone and with the log's wheel odometry as prior, each with its default
parameters. Each row is kept in bench/comparison.jsonl as soon as it is measured, in place of the one before;
bench/comparison.md has the tables, beside what others publish. With --left only rows that are missing are measured,
with --tables none.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import curvescan as cs
from curvescan.evaluation.relations import BENCHMARKS, relation_errors
from curvescan.matchers.registry import DEFAULT_METHOD, MATCHERS
from kept_rows import markdown, read_rows, write_rows

HERE = Path(__file__).parent
ROWS, TABLES = HERE / "comparison.jsonl", HERE / "comparison.md"
LOGS = {"intel": "intel-lab/intel", "aces": "aces/aces", "mit-killian-court": "mit-killian/mit-killian"}
SENSORS = {False: "laser", True: "laser, wheels"}
RUN_BY_US = {"Karto in slam_toolbox, defaults": {"intel": "0.057 (1.9)", "aces": "0.090 (1.0)"}}
"""What was built and run beside curvescan, once, with wheels: metres (degrees)."""


Spread = tuple[float, float]
"""Mean and standard deviation."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One method over one log: errors of all its relations, metres and degrees."""

    log: str
    task: str
    method: str
    wheels: bool
    translation: Spread
    rotation: Spread
    near_translation: Spread
    near_rotation: Spread
    n_relations: int
    version: str
    measured: str

    @property
    def key(self) -> tuple[str, str, str, bool]:
        """What tells the row from others."""
        return (self.log, self.task, self.method, self.wheels)

    @property
    def command(self) -> str:
        """The command that gives the trajectory."""
        flags = f" --method {self.method}" * (self.method != DEFAULT_METHOD)
        return f"curvescan {self.task} {self.log}.clf --out out{flags}" + (
            " --odometry-prior" if self.wheels else " --laser-only"
        )


def rows_wanted(logs: list[str], methods: list[str]) -> Iterator[tuple[str, str, str, bool]]:
    """Yield log, task, method and whether the wheels are used, of each row."""
    for log in logs:
        for wheels in (False, True):
            if DEFAULT_METHOD in methods:
                yield log, "slam", DEFAULT_METHOD, wheels
            for method in methods:
                yield log, "odometry", method, wheels


def measure(data: Path, log: str, task: str, method: str, wheels: bool) -> Row:
    """Run a method over a log and return the errors of its relations."""
    scans = cs.read_log(data / f"{LOGS[log]}.clf.gz")
    if task == "slam":
        trajectory = cs.run(scans, "slam", method=method, odometry_prior=wheels).trajectory
    else:
        trajectory = cs.run(scans, method=method, odometry_prior=wheels).trajectory
    errors = relation_errors(trajectory, cs.read_relations(data / f"{LOGS[log]}.relations"))
    found = {}
    for prefix, which in (("", "all"), ("near_", "near")):
        translation, rotation = errors.spreads(which)
        degrees = (math.degrees(rotation.mean), math.degrees(rotation.std))
        found[f"{prefix}translation"] = (round(translation.mean, 6), round(translation.std, 6))
        found[f"{prefix}rotation"] = (round(degrees[0], 6), round(degrees[1], 6))
    return Row(
        log=log,
        task=task,
        method=method,
        wheels=wheels,
        n_relations=len(errors),
        version=cs.__version__,
        measured=date.today().isoformat(),
        **found,
    )


def kept() -> dict[tuple[str, str, str, bool], Row]:
    """Return the rows that were measured, by log, task, method and wheels."""
    return {row.key: row for row in read_rows(ROWS, Row)}


def keep(rows: dict[tuple[str, str, str, bool], Row]) -> None:
    """Write all rows, and the tables made of them."""
    write_rows(ROWS, [rows[key] for key in sorted(rows)])
    TABLES.write_text(tables(rows), "utf-8")


def tables(rows: dict[tuple[str, str, str, bool], Row]) -> str:
    """Return the tables as Markdown: maps with loops closed, trajectories without, relations of near scans."""
    logs = [log for log in LOGS if any(row.log == log for row in rows.values())]
    head = ["", "sensors", *(BENCHMARKS[log].name for log in logs)]
    slam = [head, *published(("RBPF", "graph mapping", "Cartographer"), logs)]
    slam += [[name, SENSORS[True], *(by.get(log, "") for log in logs)] for name, by in RUN_BY_US.items()]
    slam += [[f"**{one[0]}**", *one[1:]] for one in measured(rows, "slam", logs, "")]
    chains = [head, *published(("scan matching",), logs), *measured(rows, "odometry", logs, "")]
    near = [head, *measured(rows, "odometry", logs, "near_")]
    return (
        "## Loops closed\n\n"
        + table(*slam)
        + "\n## Odometry: past poses are not revised\n\n"
        + table(*chains)
        + "\n## Odometry, relations of scans less than 5 s apart\n\n"
        + table(*near)
        + "\n"
        + when(list(rows.values()))
    )


def when(rows: list[Row]) -> str:
    """Return the sentence that says when the rows were measured, and with which version."""
    by: dict[str, list[Row]] = {}
    for row in rows:
        by.setdefault(f"on {row.measured} with version {row.version}", []).append(row)
    most, *others = sorted(by, key=lambda one: -len(by[one]))
    sentence = f"The rows of this project were measured {most}"
    for other in others:
        methods = {row.method for row in by[other]}
        whole = {m for m in methods if all(row in by[other] for row in rows if row.method == m)}
        names = [f"those of `{method}`" for method in sorted(whole)]
        names += [
            f"{row.log} {row.task} `{row.method}` ({SENSORS[row.wheels]})"
            for row in by[other]
            if row.method not in whole
        ]
        sentence += f"; {', '.join(names)} {other}"
    return f"{sentence}.\n"


def published(methods: tuple[str, ...], logs: list[str]) -> Iterator[list[str]]:
    """Yield what was published of methods, a row each."""
    for method in methods:
        cells = []
        for log in logs:
            (error,) = [one for one in BENCHMARKS[log].errors if one.method.startswith(method)]
            degrees = "" if not error.rotation else f" ({_published(error.rotation[0], 1)})"
            cells.append(f"{_published(error.translation[0], 3)}{degrees}")
        source = "Hess et al. 2016, tuned" if method == "Cartographer" else "Kümmerle et al. 2009"
        yield [f"{method}, {source}", SENSORS[True], *cells]


def _published(figure: float, n_digits: int) -> str:
    """Return a figure with the digits that it was published with, and so many at least."""
    return max(f"{figure:.{n_digits}f}", f"{figure:g}", key=len)


def measured(
    rows: dict[tuple[str, str, str, bool], Row], task: str, logs: list[str], prefix: str
) -> Iterator[list[str]]:
    """Yield the rows that were measured of one task, in the order of the table of methods."""
    for wheels in (False, True):
        for method in MATCHERS:
            found = [rows.get((log, task, method, wheels)) for log in logs]
            if any(found):
                cells = [figures(row, prefix) if row else "" for row in found]
                name = "curvescan" if method == DEFAULT_METHOD else f"`{method}`"
                yield [name, SENSORS[wheels], *cells]


def figures(row: Row, prefix: str) -> str:
    """Return a row's mean errors: metres (degrees)."""
    metres, degrees = getattr(row, f"{prefix}translation")[0], getattr(row, f"{prefix}rotation")[0]
    return f"{metres:.4f} ({degrees:.3f})" if metres < 0.1 else f"{metres:.3f} ({degrees:.2f})"


def table(head: list[str], *rows: list[str]) -> str:
    """Return a table: names, sensors, and the logs."""
    return markdown(head, ["---", "---", *["---:"] * (len(head) - 2)], rows)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    default = os.environ.get("CURVESCAN_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default), help="folder of the logs")
    parser.add_argument("--logs", nargs="+", default=list(LOGS), choices=list(LOGS))
    parser.add_argument("--methods", nargs="+", default=list(MATCHERS), choices=list(MATCHERS))
    parser.add_argument("--left", action="store_true", help="only rows that are missing")
    parser.add_argument("--tables", action="store_true", help="no row: the tables anew")
    options = parser.parse_args()
    for wanted in [] if options.tables else rows_wanted(options.logs, options.methods):
        if not (options.left and wanted in kept()):
            row = measure(options.data, *wanted)
            print(*wanted, figures(row, ""), flush=True)
            keep(kept() | {row.key: row})
    keep(kept())


if __name__ == "__main__":
    main()
