"""The results folder of a run: trajectory, maps along it, graph, and the record run.json with all that repeats it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import platform
from collections import Counter
from collections.abc import Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from curvescan import se2
from curvescan._version import __version__
from curvescan.configs import as_plain, counted
from curvescan.deskew import deskewed_along
from curvescan.engines.engine import odometry_of
from curvescan.engines.odometry_process import OdometryProcess
from curvescan.errors import OutputError
from curvescan.io.ros.bags.bag_files import storage_files
from curvescan.io.trajectories.layouts import write_csv, write_tum
from curvescan.io.trajectories.relations import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.io.writing import EXPORTS
from curvescan.mapping.map_server import write_map_files
from curvescan.mapping.occupied_cells import occupied_cells
from curvescan.mapping.run_maps import RunMaps, build_maps
from curvescan.odometry import Odometry, StepOutcome
from curvescan.odometry.step import IN_MAP
from curvescan.runs.graph_files import VIEW_FILE, describe_graph, write_closures, write_view_file
from curvescan.slam import Localizer, Slam
from curvescan.slam.loop_search import Beside

if TYPE_CHECKING:
    from curvescan.runs.result import Run

RUN_RECORD = "run.json"
_N_BLOCKS = 700  # of cells along a picture of the occupancy map, at most: pixels

_NAMES = {VIEW_FILE, "trajectory.csv", "closures.csv", "map.csmap", "map.pgm", "map.yaml"}
_NAMES |= {export.filename for export in EXPORTS.values()}
"""Names of results that a log or a map may have."""


def save_run(folder: Path, run: Run, *, helper: OdometryProcess | None = None) -> RunMaps:
    """Write all results of a run into an existing folder, run.json last, and return its maps.

    helper: a process that draws meanwhile.
    """
    record, engine = run.record, run.engine
    write_tum(folder / "trajectory.tum", record.trajectory)
    write_csv(folder / "trajectory.csv", record.trajectory, [o.name.lower() for o in record.outcomes])
    n, what = len(record.outcomes), {Slam: "SLAM", Localizer: "localization"}.get(type(engine), "")
    title = ", ".join(filter(None, (f"{run.log.name}: {counted(n, 'scan')}", record.method, what)))
    title += f" (partial: interrupted, {len(run.log):,} scans in all)" * record.is_partial
    graph = engine.map if isinstance(engine, Slam) else None
    beside: Beside = partial if helper is None else helper.call_after
    if (wheels := run.scans.odometry) is not None and (known := np.flatnonzero(np.isfinite(wheels.poses[:n, 0]))).size:
        poses = se2.between(wheels.poses[known[0]], wheels.poses[:n])
        about = f"{run.scans.name}: by wheel odometry alone"
        # to the end: the cells of a map that is smeared take much memory
        beside(_draw, folder, "wheels", occupied_cells(run.scans, poses), poses, title=about)()
    maps = run.maps or maps_of_run(run, cell=0.05)
    lean = dataclasses.replace(record, steps=()), dataclasses.replace(maps, grid=None)
    drawn = [beside(_draw, folder, "map", *lean, title=title, truth=run.truth)]
    if isinstance(engine, Slam) and graph is not None:
        refused = np.array([c.place for c in engine.contradictions]).reshape(-1, 2)
        shown = dataclasses.replace(graph, scans=()), maps.standing, refused
        drawn.append(beside(_draw, folder, "graph", *shown, title=f"{title}: pose graph"))
    if maps.grid is not None:
        poses = record.trajectory.poses[np.isfinite(record.trajectory.poses[:, 0])]
        about = f"{title}: occupancy, cells of {maps.grid.resolution:g} m"
        drawn.append(beside(_draw, folder, "occupancy", maps.grid.blocks(_N_BLOCKS), poses, title=about))
        write_map_files(folder, maps.grid)
    if isinstance(engine, Slam) and graph is not None:
        write_tum(folder / "trajectory_online.tum", record.online)
        slam_map = dataclasses.replace(graph, grid=maps.grid)
        slam_map.save(folder / "map.csmap")
        keyframes = Trajectory(stamps=np.array([scan.stamp for scan in slam_map.scans]), poses=slam_map.poses)
        write_g2o(folder / "graph.g2o", keyframes, slam_map.edges)
        write_closures(folder / "closures.csv", engine.closures)
        write_view_file(
            folder,
            run.scans,
            n,
            odometry=record.odometry.poses,
            keyframe_numbers=engine.keyframes.numbers,
            keyframe_scans=engine.records.keyframe_scans(),
            contradicted=refused,
        )
    elif isinstance(engine, Odometry):
        write_view_file(folder, run.scans, n)
    for finish in drawn:
        finish()
    write_record(folder, describe_run(run, maps))
    return maps


def maps_of_run(run: Run, *, cell: float | None) -> RunMaps:
    """Return the maps of a run from its scans as they were matched, and its occupancy; of localization its map."""
    record, engine = run.record, run.engine
    if isinstance(engine, Localizer):
        return RunMaps(standing=engine.map.occupancy().occupied_centres, moved=np.empty((0, 2)))
    seen = deskewed_along(run.scans, record.trajectory.poses) if odometry_of(engine).config.deskew else run.scans
    if not isinstance(engine, Slam):
        return build_maps(seen, record.trajectory.poses, record.is_joined, cell=cell, occupancy=run.occupancy)
    keyframes = [*engine.keyframes]
    about = occupied_cells([keyframe.scan for keyframe in keyframes], engine.graph.poses, 1.0)
    of_keyframes = zip(keyframes, engine.graph.poses, strict=True)
    before = [(one.scan, pose) for one, pose in of_keyframes if one.session < keyframes[-1].session]
    return build_maps(
        seen, record.trajectory.poses, record.is_joined, cell=cell, occupancy=run.occupancy, about=about, before=before
    )


def _draw(folder: Path, name: str, *args: Any, **options: Any) -> None:
    """Draw one picture; Matplotlib loads in the process that draws."""
    from curvescan.plots import map as pictures

    getattr(pictures, f"draw_{name}")(folder / f"{name}.png", *args, **options)


def describe_run(run: Run, maps: RunMaps) -> dict[str, object]:
    """Return what run.json holds: version, command, input, configuration, verdict, outcomes, times."""
    record, log, engine = run.record, run.log, run.engine
    odometry, outcomes = odometry_of(engine), Counter(record.outcomes)
    config = {record.method: as_plain(odometry.matcher.config), "odometry": as_plain(odometry.config)}
    kinds = IN_MAP if isinstance(engine, Localizer) else [o for o in StepOutcome if o not in IN_MAP[:-1]]
    about: dict[str, object] = {}
    if not isinstance(engine, Odometry):
        config["slam"] = as_plain(engine.config)
    if isinstance(engine, Slam):
        about["slam"] = describe_graph(engine, record.seconds_to_finish)
    if isinstance(engine, Localizer):
        about["first_fix"] = run.first_fix
    return {
        "curvescan": __version__,
        "python": platform.python_version(),
        "packages": {name: version(name) for name in ("numpy", "numba")},
        "machine": platform.machine(),
        "command": list(run.command),
        "input": {"name": log.name, "format": log.format, "scans": len(log)} | _digest(run.source),
        "method": record.method,
        "config": config,
        "odometry_prior": record.has_prior,
        "is_partial": record.is_partial,
        "verdict": {"is_trusted": run.verdict.is_trusted, "reasons": list(run.verdict.reasons)},
        "scans": len(record.outcomes),
        "outcomes": {kind.name.lower(): outcomes[kind] for kind in kinds},
        "failures": {
            outcome.name.lower(): {"count": count, "meaning": outcome.value}
            for outcome, count in record.failures.items()
        },
        "rejected_matches": record.n_rejected,
        "rejected_odometry": record.n_prior_rejected,
        "milliseconds_per_scan": percentiles(record.seconds),
        "milliseconds_between_scans": round(1e3 * record.scan_period, 4) if math.isfinite(record.scan_period) else None,
        "input_faults": [dataclasses.asdict(read_error) for read_error in log.read_errors],
        "occupancy": as_plain(run.occupancy),
        "left_out": list(left_out(maps)),
        **about,
        **({} if run.prepared is None else run.prepared.as_plain()),
        **run.details,
    }


def check_kept(source: Path, out: Path) -> None:
    """Raise OutputError where a result would take the place of the log or map that it is made of."""
    named = out / source.name
    if source.name in _NAMES and source.exists() and named.exists() and named.samefile(source):
        raise OutputError(
            f"{source} has the name of a result, which would replace it: choose another folder than {out}"
        )


def left_out(maps: RunMaps) -> tuple[str, ...]:
    """Return what is not written and why, a sentence each."""
    return (f"no occupancy map: {maps.why_no_grid}",) if maps.why_no_grid else ()


def percentiles(seconds: np.ndarray) -> dict[str, float]:
    """Return median, 99th percentile and maximum in milliseconds; seconds (n,)."""
    values = np.percentile(1e3 * seconds, [50.0, 99.0, 100.0]).tolist()
    return {name: round(value, 4) for name, value in zip(("median", "p99", "max"), values, strict=True)}


def write_record(folder: Path, record: Mapping[str, object], name: str = RUN_RECORD) -> None:
    """Write the record of a run, its last file; "files" names all, so that a later run knows what to replace."""
    files = sorted({file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()} | {name})
    write_json(folder / name, {**record, "files": files})


def list_further_files(folder: Path, results: Path) -> None:
    """Write into `folder` the record of the results that it adds files to, with the names of those."""
    record = json.loads((results / RUN_RECORD).read_text("utf-8"))
    record["files"] = sorted({*record["files"], *(file.name for file in folder.iterdir())})
    write_json(folder / RUN_RECORD, record)


def write_json(path: Path, record: Mapping[str, object]) -> None:
    """Write a record as JSON, which knows finite numbers alone: NaN becomes null, an infinite parameter "inf"."""
    path.write_text(json.dumps(_as_json(record), indent=2, allow_nan=False) + "\n", encoding="utf-8", newline="\n")


def _as_json(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def _digest(source: Path | None) -> dict[str, object]:
    if source is None:
        return {}
    if source.is_dir():  # of a ROS 2 bag
        return {"files": {file.name: _digest(file) for file in storage_files(source)}}
    with source.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return {"bytes": source.stat().st_size, "sha256": digest}
