"""Measure the tables of docs/logs.md: `python bench/logs.py [--data FOLDER] [--only intel.clf.gz]`.

Runs each log as `curvescan slam LOG` does, without any option. Each row is kept in bench/logs.jsonl as soon as it is
measured, in place of the one before; bench/logs.md has the tables.
"""

from __future__ import annotations

import argparse
import math
import os
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Literal

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.evaluation.relations import relation_errors
from curvescan.evaluation.trajectory_errors import ate, travelled
from curvescan.slam.pose_graph.graph import EdgeKind
from kept_rows import markdown, read_rows, write_rows

HERE = Path(__file__).parent
ROWS, TABLE = HERE / "logs.jsonl", HERE / "logs.md"

Truth = Literal["relations", "wheels", "corrected", "still", ""]
"""What the path is compared with: checked relations, the wheels, poses that a SLAM system corrected, a sensor at rest,
nothing."""

LOGS: dict[str, tuple[str, Truth]] = {
    "intel-lab/intel.clf.gz": ("Intel Research Lab, SICK, 45 min", "relations"),
    "aces/aces.clf.gz": ("ACES building, SICK, long corridors", "relations"),
    "mit-killian/mit-killian.clf.gz": ("MIT Killian Court, SICK, 2 h, corridors of 200 m", "relations"),
    "intel-lab/intel-corrected.log.gz": ("Intel, keyframes 0.7 m apart", "corrected"),
    "aces/aces-corrected.log.gz": ("ACES, keyframes", "corrected"),
    "keyframed-corrected/belgioioso-corrected.log.gz": ("castle, keyframes 1 m apart", "corrected"),
    "keyframed-corrected/seattle-corrected.log.gz": ("university, corridors of 30 m, keyframes", "corrected"),
    "keyframed-corrected/acapulco-corrected.log.gz": ("convention centre, keyframes", "corrected"),
    "keyframed-corrected/orebro-corrected.log.gz": ("university, keyframes up to 3.3 m apart", "corrected"),
    "leg-tracker-people/general_tracking_moving_1.bag.gz": ("wheelchair among walking people, Hokuyo", "wheels"),
    "leg-tracker-people/demo_stationary_simple_environment.bag.gz": ("Hokuyo at rest, people walk past", "still"),
    "leg-tracker-people/positive_1.bag.gz": ("Hokuyo at rest, one person", "still"),
    "ccny-handheld-hokuyo/demo.bag": ("Hokuyo carried by hand", ""),
    "mumble-rplidar-a1/kitchen_1": ("RPLIDAR A1 on a rover in a flat", ""),
    "mumble-rplidar-a1/slow_half_hallway": ("the same, a hallway", ""),
    "turtlebot4-rplidar/macfirst_floor_take_2": ("RPLIDAR on a TurtleBot 4", "wheels"),
    "rplidar-slambot/data_6AUG14_16m.clf.gz": ("first RPLIDAR on a tracked rover in a flat", "wheels"),
    "mines-urg04/exp1.dat.gz": ("URG-04LX on a rover", "wheels"),
    "malaga-sena-loop/malaga-sena-loop.clf.gz": ("SICK on a wheelchair, one loop", "wheels"),
    "ual-campus-sick/ual-campus.clf.gz": ("SICK on a car, outdoors, 4 m/s", "wheels"),
}
"""Each log, by its path in the folder of logs: what it is, and what its end is compared with."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A log, what was mended in it, and what became of its SLAM; metres."""

    log: str
    format: str
    n_scans: int
    mended: list[str]
    motion: str
    n_failed: int
    n_closures: int
    length: float
    odometry: str
    slam: str
    reasons: list[str]
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
        mended = ", ".join(kind.replace("_", " ") for kind in self.mended) or "-"
        return [self.name, f"{LOGS[self.log][0]}; {self.format}", mended, self.motion]

    @property
    def found(self) -> list[str]:
        """What became of it."""
        return [
            self.name,
            f"{self.n_scans:,}",
            f"{self.n_failed:,}",
            f"{self.n_closures:,}",
            f"{self.length:,.0f} m",
            self.odometry or "-",
            self.slam or "-",
            "trusted" if not self.reasons else f"not: {self.reasons[0]}",
        ]


GIVEN = {"log": ":---", "what": ":---", "mended": ":---", "wheels or gyroscope": ":---"}
FOUND = {"log": ":---", "scans": "---:", "no match": "---:", "closures": "---:", "path": "---:"}
FOUND |= {"odometry": ":---", "SLAM": ":---", "verdict": ":---"}


def measure(folder: Path, name: str) -> Row:
    """Run SLAM over a log, without any option."""
    run = cs.run(folder / name, engine="slam")
    record, prepared = run.record, run.prepared
    poses = record.trajectory.poses
    return Row(
        log=name,
        format=run.log.format,
        n_scans=len(poses),
        mended=list(dict.fromkeys(issue.kind for issue in prepared.done)),
        motion="used" if record.has_prior else "left out" if prepared.prior.sentence else "none",
        n_failed=int(np.count_nonzero(record.is_failed)),
        n_closures=int(np.count_nonzero(run.map.kinds == EdgeKind.CLOSURE)),
        length=round(float(travelled(poses)[-1]), 2),
        odometry=end_of(record.odometry, run.log, LOGS[name][1], folder / name),
        slam=end_of(record.trajectory, run.log, LOGS[name][1], folder / name),
        reasons=[reason.partition(";")[0] for reason in run.verdict.reasons],
        version=cs.__version__,
        measured=date.today().isoformat(),
    )


def end_of(found: cs.Trajectory, log: cs.Log, truth: Truth, path: Path) -> str:
    """Return in words how far the path of a log is from what is known of it."""
    poses = found.poses
    if truth == "relations":
        relations = cs.read_relations(path.with_name(path.name.split(".")[0] + ".relations"))
        errors = relation_errors(found, relations)
        return f"{errors.spreads('all')[0].mean:.4f} m over {len(errors):,} relations"
    if truth == "still":
        x, y, theta = se2.between(poses[0], poses[-1]).tolist()
        return f"{1e3 * math.hypot(x, y):.1f} mm, {abs(math.degrees(theta)):.2f} deg"
    if not truth or log.odometry is None:
        return ""
    known = log.odometry.poses
    is_known = np.isfinite(known).all(axis=1)
    poses, known = poses[is_known], known[is_known]
    if truth == "corrected":
        errors = ate(poses, known)
        return f"{float(np.sqrt(np.mean(errors**2))):.2f} m ATE"
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
