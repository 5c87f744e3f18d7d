"""The result folder of an odometry run: trajectory, map, and all that is needed to repeat it."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from curvescan._version import __version__
from curvescan.diagnostics.verdict import Verdict, judge_run
from curvescan.io.log import Log
from curvescan.io.ros.bags.bag_files import storage_files
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.run_maps import RunMaps
from curvescan.odometry import Odometry, OdometryRun, StepOutcome
from curvescan.runs.plain import as_plain
from curvescan.runs.results import save_trajectory_and_maps, write_record
from curvescan.runs.view_file import write_view_file
from curvescan.types import Pose


def save_run(
    folder: Path,
    run: OdometryRun,
    log: Log,
    *,
    odometry: Odometry,
    command: Sequence[str] = (),
    source: Path | None = None,
    truth: Pose | None = None,
    occupancy: OccupancyConfig | None = None,
    verdict: Verdict | None = None,
    maps: RunMaps | None = None,
    further: Mapping[str, object] | None = None,
) -> tuple[str, ...]:
    """Write the trajectory, the maps and the record of a run into an existing folder.

    trajectory.tum, trajectory.csv, map.png, run.json; and the occupancy map: map.pgm with map.yaml, as a map server
    loads it, and occupancy.png.

    truth (n, 3); occupancy: How to make the occupancy map; None for the defaults; verdict: Whether the run can be
    trusted, for run.json; None to judge the run alone, without its log; maps: The maps, where they have been made
    already; None to read the log once more.
    """
    occupancy = occupancy or OccupancyConfig()
    saved = save_trajectory_and_maps(
        folder, run, log, is_deskewed=odometry.config.deskew, occupancy=occupancy, truth=truth, maps=maps
    )
    write_view_file(folder, log, len(run.outcomes))
    record = describe_run(run, log, odometry, command, source, verdict)
    record |= {"occupancy": as_plain(occupancy), "left_out": list(saved.left_out)}
    write_record(folder, {**record, **(further or {})})
    return saved.left_out


def describe_run(
    run: OdometryRun,
    log: Log,
    odometry: Odometry,
    command: Sequence[str] = (),
    source: Path | None = None,
    verdict: Verdict | None = None,
) -> dict[str, object]:
    """Return what run.json holds: version, command, input, configuration, verdict, outcomes, times."""
    outcomes = Counter(run.outcomes)
    verdict = verdict or judge_run(run)
    median, p99, worst = np.percentile(1e3 * run.seconds, [50.0, 99.0, 100.0])
    return {
        "curvescan": __version__,
        "python": platform.python_version(),
        "packages": {name: version(name) for name in ("numpy", "numba")},
        "machine": platform.machine(),
        "command": list(command),
        "input": {"name": log.name, "format": log.format, "scans": len(log)} | _digest(source),
        "method": run.method,
        "config": {run.method: as_plain(odometry.matcher.config), "odometry": as_plain(odometry.config)},
        "odometry_prior": run.has_prior,
        "is_partial": run.is_partial,
        "verdict": {"is_trusted": verdict.is_trusted, "reasons": list(verdict.reasons)},
        "scans": len(run.outcomes),
        "outcomes": {kind.name.lower(): outcomes[kind] for kind in StepOutcome},
        "failures": {
            outcome.name.lower(): {"count": count, "meaning": outcome.value} for outcome, count in run.failures.items()
        },
        "rejected_matches": run.n_rejected,
        "rejected_odometry": run.n_prior_rejected,
        "milliseconds_per_scan": {
            "median": round(float(median), 4),
            "p99": round(float(p99), 4),
            "max": round(float(worst), 4),
        },
        "milliseconds_between_scans": round(1e3 * run.scan_period, 4) if math.isfinite(run.scan_period) else None,
        "input_faults": [dataclasses.asdict(read_error) for read_error in log.read_errors],
    }


def _digest(source: Path | None) -> dict[str, object]:
    if source is None:
        return {}
    if source.is_dir():  # of a ROS 2 bag
        return {"files": {file.name: _digest(file) for file in storage_files(source)}}
    with source.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": source.stat().st_size, "sha256": digest}
