"""Measure the table of docs/logs.md: `python bench/logs.py [--data FOLDER] [--only intel.clf.gz]`.

Reads each log as `curvescan info` does, and follows it as `curvescan odometry` does, the laser alone, with no options
but those that the issues propose. Each row is kept in bench/logs.jsonl as soon as it is measured, in place of the one
before; bench/logs.md has the table.
"""

from __future__ import annotations

import argparse
import ast
import math
import os
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.cli.console import with_flags
from curvescan.evaluation.relations import relation_errors
from curvescan.evaluation.trajectory_errors import ate, travelled
from curvescan.odometry.step import StepOutcome
from kept_rows import markdown, read_rows, write_rows

HERE = Path(__file__).parent
ROWS, TABLE = HERE / "logs.jsonl", HERE / "logs.md"

Truth = Literal["relations", "wheels", "corrected", "still", ""]
"""What the path is compared with: checked relations, the wheels, poses that a SLAM system corrected, a sensor at rest,
nothing."""

LOGS: dict[str, tuple[str, Truth]] = {
    "intel-lab/intel.clf.gz": ("Intel Research Lab, SICK, 45 min", "relations"),
    "aces/aces.clf.gz": ("ACES building, SICK, long corridors", "relations"),
    "intel-lab/intel-corrected.log.gz": ("Intel, keyframes 0.7 m apart", "corrected"),
    "aces/aces-corrected.log.gz": ("ACES, keyframes", "corrected"),
    "keyframed-corrected/belgioioso-corrected.log.gz": ("castle, keyframes 1 m apart", "corrected"),
    "keyframed-corrected/seattle-corrected.log.gz": ("university, corridors of 30 m, keyframes", "corrected"),
    "keyframed-corrected/acapulco-corrected.log.gz": ("convention centre, keyframes", "corrected"),
    "leg-tracker-people/general_tracking_moving_1.bag.gz": ("wheelchair among walking people, Hokuyo", "wheels"),
    "leg-tracker-people/demo_stationary_simple_environment.bag.gz": ("Hokuyo at rest, people walk past", "still"),
    "leg-tracker-people/positive_1.bag.gz": ("Hokuyo at rest, one person", "still"),
    "ccny-handheld-hokuyo/demo.bag": ("Hokuyo carried by hand", ""),
    "mumble-rplidar-a1/kitchen_1": ("RPLIDAR A1 on a rover in a flat", ""),
    "mumble-rplidar-a1/slow_half_hallway": ("the same, a hallway", ""),
    "turtlebot4-rplidar/macfirst_floor_take_2": ("RPLIDAR on a TurtleBot 4", "wheels"),
    "mines-urg04/exp1.dat.gz": ("URG-04LX on a rover", "wheels"),
    "malaga-sena-loop/malaga-sena-loop.clf.gz": ("SICK on a wheelchair, one loop", "wheels"),
    "ual-campus-sick/ual-campus.clf.gz": ("SICK on a car, outdoors, 4 m/s", "wheels"),
}
"""Each log, by its path in the folder of logs: what it is, and what its end is compared with."""

NOT_LISTED = ("note",)
"""Kinds of issues that are remarks of the reader."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A log, its issues, and what became of its odometry; metres."""

    log: str
    format: str
    n_scans: int
    issues: list[str]
    options: list[str]
    n_failed: int
    n_relocalized: int
    length: float
    end: str
    version: str
    measured: str

    @property
    def name(self) -> str:
        """Name of the log in the tables: narrow columns are readable ones."""
        stem = Path(self.log).name.partition(".")[0]
        return f"`{stem.removesuffix('_simple_environment')}`"

    @property
    def given(self) -> list[str]:
        """What the log is."""
        return [
            self.name,
            f"{LOGS[self.log][0]}; {self.format}",
            ", ".join(kind.replace("_", " ") for kind in self.issues) or "none",
            "<br>".join(f"`{option}`" for option in self.options) or "-",
        ]

    @property
    def found(self) -> list[str]:
        """What became of it."""
        return [
            self.name,
            f"{self.n_scans:,}",
            f"{self.n_failed:,} ({100 * self.n_failed / self.n_scans:.1f} %)",
            f"{self.n_relocalized:,}",
            f"{self.length:,.0f} m",
            self.end or "-",
        ]


GIVEN = {"log": ":---", "what": ":---", "issues by `info`": ":---", "options": ":---"}
FOUND = {"log": ":---", "scans": "---:", "no match": "---:", "relocalized": "---:"}
FOUND |= {"path": "---:", "error": ":---"}


def measure(folder: Path, name: str) -> Row:
    """Read a log, and follow it."""
    log = cs.read_log(folder / name)
    issues = cs.find_issues(cs.inspect_log(log))
    words = [issue.argument.partition("=") for issue in issues if issue.argument]
    given = {name: ast.literal_eval(value) for name, _, value in words}
    log = cs.read_log(folder / name, **given)
    run = cs.run(log).record
    poses = run.trajectory.poses
    return Row(
        log=name,
        format=log.format,
        n_scans=len(poses),
        issues=list(dict.fromkeys(i.kind for i in issues if i.kind not in NOT_LISTED)),
        options=[with_flags(issue.argument) for issue in issues if issue.remedy],
        n_failed=int(np.count_nonzero(run.is_failed)),
        n_relocalized=run.outcomes.count(StepOutcome.RELOCALIZED),
        length=round(float(travelled(poses)[-1]), 2),
        end=end_of(run.trajectory, log, LOGS[name][1], folder / name),
        version=cs.__version__,
        measured=date.today().isoformat(),
    )


def end_of(found: cs.Trajectory, log: cs.Log, truth: Truth, path: Path) -> str:
    """Return in words how far the path of a log is from what is known of it."""
    poses = found.poses
    if truth == "relations":
        relations = cs.read_relations(path.with_name(path.name.split(".")[0] + ".relations"))
        errors = relation_errors(found, relations)
        return f"{errors.spreads('all')[0].mean:.3f} m over {len(errors):,} checked relations"
    if truth == "still":
        x, y, theta = se2.between(poses[0], poses[-1]).tolist()
        return f"{1e3 * math.hypot(x, y):.1f} mm, {abs(math.degrees(theta)):.2f} deg of drift"
    if not truth or log.odometry is None:
        return ""
    known = log.odometry.poses
    is_known = np.isfinite(known).all(axis=1)
    poses, known = poses[is_known], known[is_known]
    if truth == "corrected":
        errors = ate(poses, known)
        return f"{float(np.sqrt(np.mean(errors**2))):.2f} m ATE against its corrected poses"
    moved = [se2.between(path[0], path[-1]) for path in (known, poses)]
    x, y, theta = se2.between(*moved).tolist()
    return f"{math.hypot(x, y):.1f} m, {abs(math.degrees(theta)):.0f} deg from the wheels"


def kept() -> dict[str, Row]:
    """Return the rows that were measured, by log."""
    return {row.log: row for row in read_rows(ROWS, Row)}


def keep(rows: dict[str, Row]) -> None:
    """Write all rows, and the table made of them."""
    ordered = [rows[name] for name in LOGS if name in rows]
    write_rows(ROWS, ordered)
    days = sorted({f"{row.measured}, version {row.version}" for row in ordered})
    TABLE.write_text(
        f"{markdown(GIVEN, GIVEN.values(), [row.given for row in ordered])}\n"
        f"{markdown(FOUND, FOUND.values(), [row.found for row in ordered])}\n"
        f"Measured on {'; '.join(days)}.\n",
        "utf-8",
    )


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    default = os.environ.get("CURVESCAN_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default), help="folder of the logs")
    parser.add_argument("--only", nargs="+", default=[], help="names of logs; all if not given")
    parser.add_argument("--tables", action="store_true", help="no row: the tables anew")
    options = parser.parse_args()
    for name in [] if options.tables else LOGS:
        if not options.only or Path(name).name in options.only:
            row = measure(options.data, name)
            print(*row.given, *row.found[1:], flush=True)
            keep(kept() | {name: row})
    keep(kept())


if __name__ == "__main__":
    main()
