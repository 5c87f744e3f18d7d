"""The result folder of an odometry run: trajectory, map, and all that is needed to repeat it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path

import numpy as np

from curvescan import __version__, se2
from curvescan.io.bag_files import storage_files
from curvescan.io.log import Log
from curvescan.io.trajectory import write_csv, write_tum
from curvescan.odometry import Odometry, OdometryRun, StepOutcome
from curvescan.types import Pose
from curvescan.view.map import draw_map, occupied_cells, standing_and_moved_cells


def save_run(
    folder: Path,
    run: OdometryRun,
    log: Log,
    *,
    odometry: Odometry,
    command: Sequence[str] = (),
    source: Path | None = None,
    truth: Pose | None = None,
) -> None:
    """Write trajectory.tum, trajectory.csv, map.png and run.json of a run into an existing folder.

    Parameters
    ----------
    folder : Path
        Where to write; see :func:`curvescan.io.output_folder`.
    run : OdometryRun
        The run, at least one scan; also a partial one.
    log : Log
        What it ran over; read once more for the map.
    odometry : Odometry
        What ran, for its configuration.
    command : sequence of str
        The command line that asked for it.
    source : Path or None
        The file or folder of the log, for its size and digest.
    truth : (n, 3) float64 or None
        True poses, drawn with the map.
    """
    write_tum(folder / "trajectory.tum", run.trajectory)
    write_csv(folder / "trajectory.csv", run.trajectory, [o.name.lower() for o in run.outcomes])
    _save_map(folder / "map.png", run, log, truth)
    record = describe_run(run, log, odometry, command, source)
    (folder / "run.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")


def describe_run(
    run: OdometryRun,
    log: Log,
    odometry: Odometry,
    command: Sequence[str] = (),
    source: Path | None = None,
) -> dict[str, object]:
    """Return what run.json holds: version, command, input, configuration, outcomes, times."""
    outcomes = Counter(run.outcomes)
    median, p99, worst = np.percentile(1e3 * run.seconds, [50.0, 99.0, 100.0])
    return {
        "curvescan": __version__,
        "command": list(command),
        "input": {"name": log.name, "format": log.format, "scans": len(log)} | _digest(source),
        "method": run.method,
        "config": {
            run.method: as_plain(odometry.matcher.config),
            "odometry": as_plain(odometry.config),
        },
        "is_partial": run.is_partial,
        "scans": len(run.outcomes),
        "outcomes": {kind.name.lower(): outcomes[kind] for kind in StepOutcome},
        "failures": {
            outcome.name.lower(): {"count": count, "meaning": outcome.value}
            for outcome, count in run.failures.items()
        },
        "milliseconds_per_scan": {
            "median": round(float(median), 4),
            "p99": round(float(p99), 4),
            "max": round(float(worst), 4),
        },
        "input_faults": [dataclasses.asdict(fault) for fault in log.faults],
    }


def as_plain(value: object) -> object:
    """Return a configuration as dictionaries, lists, numbers and strings."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: as_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_plain(item) for item in value]
    return value


def _digest(source: Path | None) -> dict[str, object]:
    if source is None:
        return {}
    if source.is_dir():  # of a ROS 2 bag
        return {"files": {file.name: _digest(file) for file in storage_files(source)}}
    with source.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": source.stat().st_size, "sha256": digest}


def _save_map(path: Path, run: OdometryRun, log: Log, truth: Pose | None) -> None:
    poses = run.trajectory.poses
    wheel_poses = wheel_cells = None
    if log.odometry is not None:
        wheel_poses = _from_first(log.odometry.poses[: len(poses)])
        wheel_cells = occupied_cells(log, wheel_poses)
    standing, moved = standing_and_moved_cells(log, poses, run.is_joined)
    title = f"{log.name}: {len(poses):,} scans, {run.method}"
    if run.is_partial:
        title += f" (partial: interrupted, {len(log):,} scans in all)"
    draw_map(
        path,
        title=title,
        cells=standing,
        moved_cells=moved,
        poses=poses,
        failed=run.is_failed,
        wheel_cells=wheel_cells,
        wheel_poses=wheel_poses,
        true_poses=None if truth is None else _from_first(truth[: len(poses)]),
    )


def _from_first(poses: Pose) -> Pose:
    """Return poses seen from the first one that is known."""
    known = np.flatnonzero(~np.isnan(poses[:, 2]))
    if known.size == 0:
        return poses
    return se2.between(poses[known[0]], poses)
