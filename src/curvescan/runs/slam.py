"""The result folder of a SLAM run: that of odometry with every pose revised, and the graph, its closures and the map."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from curvescan.diagnostics.verdict import Verdict
from curvescan.io.log import Log
from curvescan.io.trajectories.g2o import write_g2o
from curvescan.io.trajectories.layouts import write_tum
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.run_maps import RunMaps
from curvescan.odometry import OdometryRun
from curvescan.plots.graph import draw_graph
from curvescan.plots.map import draw_map
from curvescan.runs.odometry import describe_run
from curvescan.runs.odometry_process import OdometryProcess
from curvescan.runs.plain import as_plain
from curvescan.runs.results import maps_of, save_trajectory_and_maps, title_of, write_record
from curvescan.runs.view_file import write_view_file
from curvescan.slam import ClosureOutcome, SlamRun
from curvescan.slam.loops.closures import Closure
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Pose

_WHAT = "SLAM"  # ran, in titles

CLOSURE_HEADER = (
    "scan", "keyframe_i", "keyframe_j", "score", "confidence", "squared_mahalanobis", "x", "y", "theta", "kind", "outcome", "meaning",
)  # fmt: skip


def save_slam_run(
    folder: Path,
    run: SlamRun,
    log: Log,
    *,
    command: Sequence[str] = (),
    source: Path | None = None,
    truth: Pose | None = None,
    occupancy: OccupancyConfig | None = None,
    verdict: Verdict | None = None,
    maps: RunMaps | None = None,
    further: Mapping[str, object] | None = None,
    helper: OdometryProcess | None = None,
) -> tuple[str, ...]:
    """Write all results of a SLAM run into an existing folder.

    trajectory.tum, trajectory.csv (with covariances), trajectory_online.tum, map.png, graph.png, graph.g2o,
    closures.csv, map.csmap, run.json; and the occupancy map: map.pgm with map.yaml, and occupancy.png.

    truth (n, 3); occupancy: How to make the occupancy map; None for the defaults; verdict: Whether the run can be
    trusted; None to judge it here; maps: The maps, where they have been made already; None to read the log once more.
    """
    occupancy = occupancy or OccupancyConfig()
    revised, slam = run.revised, run.slam
    slam_map, is_deskewed = slam.map, slam.config.odometry.deskew
    drawn = None
    if helper is not None and maps is None:
        drawn = helper.call_after(_draw_places, folder, revised, log, is_deskewed, slam_map, truth)
        maps = maps_of(revised, log, is_deskewed=is_deskewed, cell=None, occupancy=occupancy)
    saved = save_trajectory_and_maps(
        folder,
        revised,
        log,
        is_deskewed=is_deskewed,
        what=_WHAT,
        occupancy=occupancy,
        truth=truth,
        maps=maps,
        is_map_drawn=drawn is None,
    )
    write_tum(folder / "trajectory_online.tum", run.online)
    # of the sessions before there are only the keyframes
    is_continued = slam_map.n_sessions > 1
    grid = slam_map.occupancy(occupancy) if is_continued else saved.maps.grid
    slam_map = replace(slam_map, grid=grid)
    slam_map.save(folder / "map.csmap")
    save_graph(folder, slam_map)
    write_closures(folder / "closures.csv", slam.closures)
    write_view_file(
        folder,
        log,
        len(revised.outcomes),
        odometry=run.odometry.poses,
        keyframe_numbers=slam.backend.keyframes.numbers,
        keyframe_scans=slam.keyframe_scans(),
    )
    if drawn is None:
        _draw_graph(folder, slam_map, saved.maps, saved.title)
    else:
        drawn()
    record = describe_run(revised, log, slam.odometry, command, source, verdict)
    record |= {"config": {**_as_dict(record["config"]), "slam": as_plain(slam.config)}}
    record |= {"slam": describe_graph(run), "occupancy": as_plain(occupancy)}
    record |= {"left_out": list(saved.left_out)}
    write_record(folder, {**record, **(further or {})})
    return saved.left_out


def _draw_places(
    folder: Path, run: OdometryRun, log: Log, is_deskewed: bool, slam_map: SlamMap, truth: Pose | None
) -> None:
    """Write map.png and graph.png: what needs no occupancy map."""
    maps, title = maps_of(run, log, is_deskewed=is_deskewed), title_of(run, log, _WHAT)
    draw_map(folder / "map.png", run, maps, title=title, wheels=log, truth=truth)
    _draw_graph(folder, slam_map, maps, title)


def _draw_graph(folder: Path, slam_map: SlamMap, maps: RunMaps, title: str) -> None:
    draw_graph(folder / "graph.png", slam_map, maps.standing, title=f"{title}: pose graph")


def save_graph(folder: Path, slam_map: SlamMap) -> None:
    """Write graph.g2o: a vertex a keyframe, and every edge that has a weight."""
    keyframes = Trajectory(stamps=np.array([scan.stamp for scan in slam_map.scans]), poses=slam_map.poses)
    write_g2o(folder / "graph.g2o", keyframes, slam_map.edges)


def write_closures(path: Path, closures: Sequence[Closure]) -> None:
    """Write the log of loop-closure candidates, and of matches of neighbours: when, with what, and why each is accepted or not."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CLOSURE_HEADER)
        for c in closures:
            numbers = [c.score, c.confidence, c.distance, *c.pose.tolist()]
            kind = "loop closure" if c.is_loop else "neighbours"
            words = [kind, c.outcome.name.lower(), c.outcome.value]
            writer.writerow([c.scan, c.i, c.j, *numbers, *words])


def describe_graph(run: SlamRun) -> dict[str, object]:
    """Return what run.json holds of the graph."""
    graph, slam = run.slam.backend.graph, run.slam
    verdicts = Counter(c.outcome for c in slam.closures)
    n_closures, n_neighbours = slam.backend.count_matches()
    return {
        "keyframes": graph.n_poses,
        "loop_closures": n_closures,
        "matches_of_neighbours": n_neighbours,
        "edges": {
            kind.name.lower(): int(np.count_nonzero(graph.kinds == kind))
            for kind in EdgeKind
            if kind is not EdgeKind.CLOSURE
        },
        "closures_without_weight": int(np.count_nonzero(graph.is_closure & (graph.weights < 0.5))),
        "candidates": {v.name.lower(): verdicts[v] for v in ClosureOutcome},
        "fragments": slam.n_fragments,
        "closures_withdrawn_because_places_look_alike": slam.is_deceived,
        "seconds_to_finish": round(run.seconds_to_finish, 3),
    }


def _as_dict(value: object) -> dict[str, object]:
    return dict(value) if isinstance(value, dict) else {}
