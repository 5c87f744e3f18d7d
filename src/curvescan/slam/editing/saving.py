"""The folder of a map that was edited."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from curvescan.io.files.output import output_folder
from curvescan.io.trajectories.relations import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.map_server import write_map
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.slam.editing.edits import Edit, write_edits
from curvescan.slam.map import SlamMap


@contextmanager
def map_folder(
    out: str | os.PathLike[str], given: SlamMap | OccupancyGrid, *, inputs: Sequence[str | os.PathLike[str]] = ()
) -> Iterator[Path]:
    """Write map.pgm with map.yaml into a folder, of keyframes map.csmap and graph.g2o too; yield it for what else."""
    with output_folder(out, inputs=inputs) as folder:
        grid = given.occupancy() if isinstance(given, SlamMap) else given
        if isinstance(given, SlamMap):
            replace(given, grid=grid).save(folder / "map.csmap")
            write_g2o(folder / "graph.g2o", keyframe_trajectory(given), given.edges)
        if grid.log_odds.size:
            write_map(folder, grid)
        yield folder


def save_map_folder(out: str | os.PathLike[str], slam_map: SlamMap, edits: Sequence[Edit]) -> tuple[str, ...]:
    """Write a map into a folder with its edits, and return the names of the files."""
    with map_folder(out, slam_map) as folder:
        write_edits(folder / "edits.json", edits)
        return tuple(sorted(file.name for file in folder.iterdir()))


def keyframe_trajectory(slam_map: SlamMap) -> Trajectory:
    """Return the keyframes of a map as a trajectory."""
    stamps = np.array([scan.stamp for scan in slam_map.scans])
    return Trajectory(stamps=stamps, poses=slam_map.poses, covariances=slam_map.covariances)
